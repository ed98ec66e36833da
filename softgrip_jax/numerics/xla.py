"""What XLA is to compute once, and JAX to trace once.

XLA writes a loop for every array that it stores and computes there again whatever it thinks cheap, cosines among it:
what is used in ten loops is computed ten times. It never does so with a quotient.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.custom_derivatives import SymbolicZero
from jaxtyping import Array, ArrayLike


class traced_once:
    """jax.jit(function), whose parts JAX does not trace again for derivatives and batches.

    Where JAX goes through what it has traced, to batch or to differentiate it, it has set a mesh of devices, the empty
    one where the user has none; where it traces a function for the first time it has set none. What is traced without
    is therefore not found there: custom rules and loops are traced once more, a fifth of a batch's tracing and a
    quarter of a derivative's (jax 0.10.1). Here the mesh that holds is set from the beginning.

    options: as of jax.jit. `__wrapped__` is the function itself, as of whatever functools wraps.
    """

    def __init__(self, function: Callable[..., Any], **options: Any):
        self.__wrapped__ = function
        self.program = jax.jit(function, **options)
        for name in ("__module__", "__name__", "__qualname__", "__doc__"):
            setattr(self, name, getattr(function, name, None))

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        with jax.sharding.use_abstract_mesh(jax.sharding.get_abstract_mesh()):
            return self.program(*args, **kwargs)


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


NUMBERS_APART = 32
"""Numbers of an argument that are worth a derivative each."""


def differentiated_once(function: Callable[..., Any], apart: bool = False) -> Callable[..., Any]:
    """The same function of few numbers, whose derivatives are taken once and then combined for every direction.

    Where a Jacobian is wanted in many directions, each of which reaches the function through one or two arguments,
    JAX would go through all of its operations once for each. An argument of more than NUMBERS_APART numbers is followed
    along each direction all the same: there are fewer of those. Differentiable again; arguments must be passed, not
    closed over.

    apart: by one argument after the other, so that what depends on one alone is not worked out along the others, and
    along each direction of every array; all at once compiles faster.
    """

    @jax.custom_jvp
    def same(*args):
        return function(*args)

    def groups(primals, few):
        """The places of the leaves whose derivatives are taken together."""
        if not apart:
            return [few] if few else []
        ends = np.cumsum([len(jax.tree.leaves(argument)) for argument in primals])
        own = [[k for k in few if np.searchsorted(ends, k, side="right") == i] for i in range(len(primals))]
        return [places for places in own if places]

    def rule(primals, tangents):
        leaves, tree = jax.tree.flatten(primals)
        directions = tree.flatten_up_to(tangents)
        moving = [k for k, direction in enumerate(directions) if not isinstance(direction, SymbolicZero)]
        few = [k for k in moving if jnp.size(leaves[k]) <= (1 if apart else NUMBERS_APART)]
        many = [k for k in moving if k not in few]

        def of(places, values):
            given = dict(zip(places, values, strict=True))
            return function(*jax.tree.unflatten(tree, [given.get(k, leaf) for k, leaf in enumerate(leaves)]))

        def along(k, slope):
            """Numbers are multiplied as such: as products of matrices they would take many times as long."""
            axes = slope.ndim - jnp.ndim(leaves[k])
            direction = jnp.expand_dims(directions[k], tuple(range(axes)))
            return jnp.sum(materialised(slope) * direction, axis=tuple(range(axes, slope.ndim)))

        # The value comes with any of the derivatives.
        result, parts = None, []
        for places in groups(primals, few):
            slopes, result = jax.jacfwd(lambda values, places=places: (of(places, values),) * 2, has_aux=True)(
                [leaves[k] for k in places]
            )
            parts += [
                jax.tree.map(lambda _, row, i=i, k=k: along(k, row[i]), result, slopes) for i, k in enumerate(places)
            ]
        if many:
            result, along_many = jax.jvp(
                partial(of, many), ([leaves[k] for k in many],), ([directions[k] for k in many],)
            )
            parts.append(along_many)
        if result is None:
            result = function(*primals)
        return result, jax.tree.map(lambda value, *each: sum(each, jnp.zeros_like(value)), result, *parts)

    same.defjvp(rule, symbolic_zeros=True)
    return same
