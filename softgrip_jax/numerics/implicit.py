"""Derivatives of what a search has found, by the implicit function theorem.

Finding a root and differentiating it are two steps here. The search runs on values without derivatives;
:func:`implicit` then attaches the derivative of the root, in forward and reverse mode and to any order.

Libraries that were looked at: `optimistix.ImplicitAdjoint` does the same for roots that optimistix finds itself, and
the tests compare both; here the root may come from anywhere. `jax.lax.custom_root` wants the search as a function of
its own, too.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from .small_linear import solve_small


def implicit(residual: Callable[[Any, Any], Any], y: Float[Array, "*n"], args: Any) -> Float[Array, "*n"]:
    """`y`, which solves residual(y, args) = 0, with its derivative by `args`: dy = -(dr/dy)^-1 (dr/dargs) dargs.

    `y` is a scalar or a vector and the residual has its shape; `args` is any pytree of arrays. Where dr/dy is
    singular (a limit point) the derivative does not exist; a scalar root is then given derivative zero.
    `residual` must take every traced value through `args`: one that it closes over would outlive its trace.

    Not inside a `lax.scan`: where one is differentiated in reverse JAX drops custom rules from what it keeps for the
    next derivative (its partial evaluation keeps those of known arguments only; seen in 0.10.1), and that one would be
    wrong without a word.
    """

    @jax.custom_jvp
    def root(y, args):
        return y

    @root.defjvp
    def root_jvp(primals, tangents):
        y, args = primals
        y = root(y, args)  # differentiable again: second and higher derivatives

        def jacobian(y, args):
            if y.ndim:
                return jax.jacfwd(residual)(y, args)
            _, slope = jax.jvp(lambda x: residual(x, args), (y,), (jnp.ones_like(y),))
            return slope

        def move(jacobian, value):
            if y.ndim:
                return solve_small(jacobian, value)
            return jnp.where(jacobian == 0, 0.0, value / jnp.where(jacobian == 0, 1.0, jacobian))

        _, along_args = jax.jvp(lambda a: residual(y, a), (args,), (tangents[1],))
        return y, -move(jacobian(y, args), along_args)

    return root(lax.stop_gradient(y), args)


def with_derivatives_of(function: Callable[[Any], Any], value: Any, args: Any) -> Any:
    """`value`, which is function(args) and known already, with that function's derivatives; it runs for those alone.

    As in `implicit`, `function` must take every traced value through `args`.
    """

    @jax.custom_jvp
    def same(value, args):
        return value

    @same.defjvp
    def rule(primals, tangents):
        # The value again, not that of `function`: under vmap JAX takes for granted that the values of a rule have their
        # batch along the same axis as those of what it is the rule of (0.10.1).
        return same(*primals), jax.jvp(function, (primals[1],), (tangents[1],))[1]

    return same(lax.stop_gradient(value), args)
