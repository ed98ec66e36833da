"""The load of a limit point, with its derivatives."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from ..implicit import implicit
from ..small_linear import solve_small
from .newton import Scalar, Vector, value_and_jacobian


class Border(NamedTuple):
    """Frozen vectors that make the equations of a fold regular: see `fold_load`."""

    load: Vector
    null: Vector


def _border(jacobian: Float[Array, "n m"]) -> Border:
    """The border for folds near u: d residual / d load, and the direction of y that the path takes there."""
    matrix = jnp.concatenate([jacobian, null_direction(jacobian)[None]])
    tangent = solve_small(matrix, jnp.zeros(len(matrix)).at[-1].set(1.0))
    return lax.stop_gradient(Border(jacobian[:, -1], tangent[:-1] / jnp.linalg.norm(tangent)))


def null_direction(jacobian: Float[Array, "n m"]) -> Float[Array, " m"]:
    """A vector that is not orthogonal to the null space: the cross product of the rows, or its projection."""
    m = jacobian.shape[1]
    scale = jnp.max(jnp.abs(jacobian))
    gram = jacobian.T @ jacobian + 1e-10 * scale**2 * jnp.eye(m, dtype=jacobian.dtype)
    v = jnp.ones(m, jacobian.dtype)
    for _ in range(2):
        v = solve_small(gram, v)
        v = v / jnp.linalg.norm(v)
    return v


def _singular(jacobian: Float[Array, "n m"], border: Border) -> tuple[Vector, Scalar]:
    """(w, g): g is zero where J = d residual / d y is singular, and w is then its left null vector.

    [[J, b], [c, 0]]^T [w; g] = [0; 1] (Keller; Govaerts 2000, bordered systems). Unlike the determinant g is scaled,
    and both are smooth for any number of unknowns; where g is zero does not depend on the border.
    """
    n = jacobian.shape[1]
    matrix = jnp.zeros((n, n), jacobian.dtype)
    matrix = matrix.at[:-1, :-1].set(jacobian[:, :-1].T)
    matrix = matrix.at[:-1, -1].set(border.null).at[-1, :-1].set(border.load)
    solution = solve_small(matrix, jnp.zeros(n, jacobian.dtype).at[-1].set(1.0))
    return solution[:-1], solution[-1]


def fold_load(residual: Callable[[Vector, Any], Vector], u: Vector, args: Any) -> Scalar:
    """The load u[-1] of a limit point u of residual(u, args) = 0, with its derivatives of any order by `args`.

    dp = -(w . dr/dargs dargs) / (w . dr/dp) with the left null vector w of dr/dy: how y moves along with the limit
    point plays no part. Only a second derivative asks for that, and only then are its equations compiled.
    """

    def with_border(u, args):
        return value_and_jacobian(lambda u: residual(u, args), u)

    @jax.custom_jvp
    def load(u, args):
        return u[-1]

    @load.defjvp
    def load_jvp(primals, tangents):
        u, args = primals
        border = _border(with_border(u, lax.stop_gradient(args))[1])

        def at_fold(u, args):
            args, border = args
            value, jacobian = with_border(u, args)
            return jnp.append(value, _singular(jacobian, border)[1])

        moving = implicit(at_fold, u, (args, border))
        jacobian = with_border(moving, args)[1]
        w, _ = _singular(jacobian, border)
        _, along_args = jax.jvp(lambda a: residual(moving, a), (args,), (tangents[1],))
        return load(u, args), -jnp.dot(w, along_args) / jnp.dot(w, jacobian[:, -1])

    return load(lax.stop_gradient(u), args)
