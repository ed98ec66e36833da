"""Loops whose members differ in length, in a batch: a member that has ended makes room for the next one.

Under `vmap` a `lax.while_loop` runs every member as often as the slowest. A thousand searches of 20 to 300 iterations
each then cost 300 iterations each. Here a batch goes through a number of slots instead: each iteration works on what is
in the slots, and a slot whose member has ended takes the next member of the batch.

Libraries that were looked at: JAX itself masks what has ended and goes on with the whole batch, and so does all that is
made of its loops (optimistix, diffrax, equinox); `lax.map` with a batch size waits for the slowest of each block.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax
from jax.custom_batching import custom_vmap, sequential_vmap
from jax.flatten_util import ravel_pytree

SLOTS = {"cpu": 64}
"""Members at work at the same time: on a CPU as many as its first cache holds with all that an iteration needs."""
MANY_SLOTS = 1 << 18
"""... and on other devices. Smaller batches wait for their slowest member: to fill slots again costs a GPU more."""


def one_at_a_time() -> bool:
    """Whether the members of a batch are better solved one after the other: on a CPU one that is full of products of
    matrices has no use for others beside it, and does not wait for them."""
    return jax.default_backend() == "cpu"


def in_turn(function: Callable[..., Any]) -> Callable[..., Any]:
    """A function whose members of a batch are computed one after the other where that is better, else side by side."""
    turn = sequential_vmap(function)
    return lambda *args: turn(*args) if one_at_a_time() else function(*args)


def lane_pool(
    busy: Callable[[Any], Any],
    iterate: Callable[[Any, Any], Any],
    start: Any,
    context: Any,
    slots: int | None = None,
) -> Any:
    """lax.while_loop(busy, lambda state: iterate(state, context), start), for batches of any size.

    Neither function may hold traced values: those come through `start` and `context`. No derivatives pass through.
    """
    iterate = jax.jit(iterate)  # traced once, for one member and for many

    def loop(start, context):
        return lax.while_loop(busy, lambda state: iterate(state, context), start)

    run = custom_vmap(loop)

    @run.def_vmap
    def batched(size, is_batched, start, context):
        # All of a state becomes a batch: said at once, or JAX looks for that in the loop's body, several times.
        start = jax.tree.map(lambda v, b: v if b else jnp.broadcast_to(v, (size, *jnp.shape(v))), start, is_batched[0])
        axes = jax.tree.map(lambda b: 0 if b else None, is_batched[1])
        width = slots or SLOTS.get(jax.default_backend(), MANY_SLOTS)
        if size <= width:
            found = jax.vmap(loop, (0, axes), axis_size=size)(start, context)
        else:
            found = _through_pool(busy, iterate, start, context, is_batched[1], size, width)
        return found, jax.tree.map(lambda _: True, found)

    return run(start, context)


def _through_pool(busy, iterate, start, context, is_batched, size: int, width: int):
    one, packed = jax.tree.map(lambda v: v[0], start), jax.vmap(lambda state: ravel_pytree(state)[0])(start)
    unpack = ravel_pytree(one)[1]
    axes = jax.tree.map(lambda b: 0 if b else None, is_batched)

    def contexts(members):
        return jax.tree.map(lambda v, b: v[members] if b else v, context, is_batched)

    def one_on(state, context):
        """One iteration of what is busy, and whether it still is."""
        before = unpack(state)
        after = iterate(before, context)
        new = jnp.where(busy(before), ravel_pytree(after)[0], state)
        return new, busy(unpack(new))

    def step(state):
        members, current, following, done, found = state
        occupied = members < size
        new, going = jax.vmap(one_on, (0, axes))(current, contexts(jnp.minimum(members, size - 1)))
        ended = occupied & ~going
        # What has ended goes to the front of a block, and the next block over the rest of this one: rows written to
        # places of their own would be a loop over the slots.
        rows = jnp.concatenate([new, members[:, None].astype(new.dtype)], axis=1)
        so_far = jnp.cumsum(ended)
        first = jnp.searchsorted(so_far, jnp.arange(1, width + 1), method="compare_all" if width < 1000 else "scan")
        found = lax.dynamic_update_slice(found, rows[first], (done, 0))
        taken = following + so_far - 1
        members = jnp.where(ended, taken, members)
        new = jnp.where(ended[:, None], packed[jnp.minimum(members, size - 1)], new)
        count = so_far[-1]
        return members, new, following + count, done + count, found

    members, none = jnp.arange(width), jnp.asarray(0)
    start_state = (members, packed[:width], none + width, none)
    found = jnp.zeros((size + width, packed.shape[1] + 1), packed.dtype)
    *_, found = lax.while_loop(lambda state: state[3] < size, step, (*start_state, found))
    return jax.vmap(unpack)(found[jnp.argsort(found[:size, -1]), :-1])
