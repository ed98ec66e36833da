"""What XLA is to compute once.

XLA writes a loop for every array that it stores and computes there again whatever it thinks cheap, cosines among it:
what is used in ten loops is computed ten times. It never does so with a quotient.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax.custom_derivatives import SymbolicZero
from jaxtyping import Array, ArrayLike


@jax.custom_jvp
def materialised(x: Array) -> Array:
    """x, computed once for all that uses it; its derivatives, too."""
    return x / (1 + 0 * x)


@materialised.defjvp
def _once_along(primals, tangents):
    (x,), (along,) = primals, tangents
    return materialised(x), along / (1 + 0 * x)


@jax.custom_jvp
def cos_and_sin(angle: ArrayLike) -> tuple[Array, Array]:
    """(cos, sin), computed once for all that uses them and for their derivatives."""
    return materialised(jnp.cos(angle)), materialised(jnp.sin(angle))


@cos_and_sin.defjvp
def _turned(primals, tangents):
    cosine, sine = cos_and_sin(*primals)
    (turn,) = tangents
    return (cosine, sine), (-sine * turn, cosine * turn)


def differentiated_once(function: Callable[..., Any]) -> Callable[..., Any]:
    """The same function of few numbers, whose derivatives are taken once and then combined for every direction.

    Where a Jacobian is wanted in many directions, each of which reaches the function through one or two arguments,
    JAX would go through all of its operations once for each. Differentiable again; arguments must be passed, not
    closed over.
    """

    @jax.custom_jvp
    def same(*args):
        return function(*args)

    def rule(primals, tangents):
        leaves, tree = jax.tree.flatten(primals)
        directions = tree.flatten_up_to(tangents)
        moving = [k for k, direction in enumerate(directions) if not isinstance(direction, SymbolicZero)]

        def of(values):
            every = list(leaves)
            for k, value in zip(moving, values, strict=True):
                every[k] = value
            result = function(*jax.tree.unflatten(tree, every))
            return result, result

        columns, result = jax.jacfwd(of, has_aux=True)([leaves[k] for k in moving])
        columns = jax.tree.map(materialised, columns)

        def spread(direction, axes: int):
            return jnp.expand_dims(direction, tuple(range(axes)))

        tangent = jax.tree.map(
            lambda value, *slopes: sum(
                # Numbers are multiplied as such: as products of matrices they would take many times as long.
                jnp.sum(slope * spread(directions[k], value.ndim), axis=tuple(range(value.ndim, slope.ndim)))
                for k, slope in zip(moving, slopes, strict=True)
            ),
            result,
            *[jax.tree.map(lambda _, row, i=i: row[i], result, columns) for i in range(len(moving))],
        )
        return result, tangent

    same.defjvp(rule, symbolic_zeros=True)
    return same
