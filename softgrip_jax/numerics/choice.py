"""Choices between values: by a condition, or of the larger or the smaller, with the derivatives of the chosen one.

jnp.maximum, jnp.min and their like compare the result with each argument to learn whose derivative it has. Where XLA
has computed an argument twice and rounded it otherwise, the result equals none of them, and the derivative is zero
without a word (seen in JAX 0.10.1 without LLVM's optimisation). Here the choice is made once. What is not known (NaN)
stays so: jnp.max and jnp.min of JAX 0.11 and 0.12 forget it on a CPU where a program asks for it of 4,096 numbers or
more, in however many rows, and a row of NaN alone has the maximum -inf.
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

Number = Float[Array, "..."]


def larger(a: Number | float, b: Number | float) -> Number:
    """The larger of a and b, entry by entry; a where they are equal."""
    return jnp.where((a >= b) | jnp.isnan(a), a, b)


def smaller(a: Number, b: Number | float) -> Number:
    """The smaller of a and b, entry by entry; a where they are equal."""
    return jnp.where((a <= b) | jnp.isnan(a), a, b)


def largest(values: Number) -> Float[Array, ""]:
    """The largest entry; the first of equals."""
    return values.reshape(-1)[jnp.argmax(values)]


def smallest(values: Number) -> Float[Array, ""]:
    """The smallest entry; the first of equals."""
    return values.reshape(-1)[jnp.argmin(values)]


def select(condition: Bool[Array, ""], a: Any, b: Any) -> Any:
    """The tree a where the condition holds, else b."""
    return jax.tree.map(lambda x, y: jnp.where(condition, x, y), a, b)
