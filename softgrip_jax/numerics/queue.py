"""Loops whose lanes differ in length, in a batch: a lane that has ended makes room for the next one.

Under `vmap` a `lax.while_loop` runs every lane as often as the slowest. A thousand searches of 20 to 300 iterations
each then cost 300 iterations each. Here a batch goes through a number of slots instead: each iteration works on what is
in the slots, and a slot whose lane has ended takes the next lane of the batch.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax
from jax.custom_batching import custom_vmap
from jax.flatten_util import ravel_pytree

SLOTS = {"cpu": 64}
"""Lanes at work at the same time: on a CPU as many as its first cache holds with all that an iteration needs."""
MANY_SLOTS = 16384
"""... and on other devices."""


def in_slots(busy: Callable[[Any], Any], iterate: Callable[[Any, Any], Any], start: Any, context: Any) -> Any:
    """lax.while_loop(busy, lambda state: iterate(state, context), start), for batches of any size.

    Neither function may hold traced values: those come through `start` and `context`. No derivatives pass through.
    """
    iterate = jax.jit(iterate)  # traced once, for one lane and for many

    def loop(start, context):
        return lax.while_loop(busy, lambda state: iterate(state, context), start)

    run = custom_vmap(loop)

    @run.def_vmap
    def batched(size, is_batched, start, context):
        axes = jax.tree.map(lambda b: 0 if b else None, is_batched)
        slots = SLOTS.get(jax.default_backend(), MANY_SLOTS)
        if size <= slots:
            found = jax.vmap(loop, axes, axis_size=size)(start, context)
        else:
            found = _through_slots(busy, iterate, start, context, is_batched, size, slots)
        return found, jax.tree.map(lambda _: True, found)

    return run(start, context)


def _through_slots(busy, iterate, start, context, is_batched, size: int, slots: int):
    start = jax.tree.map(lambda v, b: v if b else jnp.broadcast_to(v, (size, *jnp.shape(v))), start, is_batched[0])
    one, packed = jax.tree.map(lambda v: v[0], start), jax.vmap(lambda state: ravel_pytree(state)[0])(start)
    unpack = ravel_pytree(one)[1]
    axes = jax.tree.map(lambda b: 0 if b else None, is_batched[1])

    def contexts(lanes):
        return jax.tree.map(lambda v, b: v[lanes] if b else v, context, is_batched[1])

    def states(lanes):
        return jax.vmap(unpack)(packed[jnp.minimum(lanes, size - 1)])

    def step(state):
        lanes, current, following, results = state
        occupied = lanes < size
        going = occupied & jax.vmap(busy)(current)
        new = jax.vmap(iterate, (0, axes))(current, contexts(jnp.minimum(lanes, size - 1)))
        new = jax.vmap(lambda go, a, b: jax.tree.map(lambda x, y: jnp.where(go, x, y), a, b))(going, new, current)
        ended = occupied & ~jax.vmap(busy)(new)
        rows = jax.vmap(lambda state: ravel_pytree(state)[0])(new)
        results = results.at[jnp.where(ended, lanes, size)].set(rows, mode="drop")
        taken = following + jnp.cumsum(ended) - 1
        lanes = jnp.where(ended, taken, lanes)
        new = jax.vmap(lambda end, a, b: jax.tree.map(lambda x, y: jnp.where(end, x, y), a, b))(
            ended, states(lanes), new
        )
        return lanes, new, following + jnp.sum(ended), results

    lanes = jnp.arange(slots)
    *_, results = lax.while_loop(
        lambda state: jnp.any(state[0] < size), step, (lanes, states(lanes), jnp.asarray(slots), jnp.zeros_like(packed))
    )
    return jax.vmap(unpack)(results)
