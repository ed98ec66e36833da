"""Loops whose members differ in length, in a batch: what has ended is not gone through again.

Under `vmap` a `lax.while_loop` runs every member as often as the slowest. A thousand searches of 20 to 300 iterations
each then cost 300 iterations each. Here a batch is gone through in blocks instead: a block goes on until a part of it
has ended, and what is left of all blocks is packed into fewer of them for the next round.

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

from .choice import select

BLOCK = {"cpu": 64}
"""Members at work at the same time: on a CPU as many as its first cache holds with all that an iteration needs."""
LARGE_BLOCK = 1 << 15
"""... and on other devices, which start some hundred kernels for each iteration. Smaller batches wait for their slowest
member."""
LEFT = 0.75
"""A block of several goes on until no more than this part of it is left."""


def one_at_a_time() -> bool:
    """Whether the members of a batch are better solved one after the other: on a CPU one that is full of products of
    matrices has no use for others beside it, and does not wait for them."""
    return jax.default_backend() == "cpu"


def in_turn(function: Callable[..., Any]) -> Callable[..., Any]:
    """A function whose members of a batch are computed one after the other where that is better, else side by side."""
    turn = sequential_vmap(function)
    return lambda *args: turn(*args) if one_at_a_time() else function(*args)


def in_blocks(
    busy: Callable[[Any], Any],
    iterate: Callable[[Any, Any], Any],
    start: Any,
    context: Any,
    block: int | None = None,
) -> Any:
    """lax.while_loop(busy, lambda state: iterate(state, context), start), for batches of any size.

    Neither function may hold traced values: those come through `start` and `context`. No derivatives pass through.
    block: members at work at the same time; by default as many as suit the device.
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
        width = block or BLOCK.get(jax.default_backend(), LARGE_BLOCK)
        if size <= width:
            found = jax.vmap(loop, (0, axes), axis_size=size)(start, context)
        else:
            found = _in_rounds(busy, iterate, start, context, is_batched[1], size, width)
        return found, jax.tree.map(lambda _: True, found)

    return run(start, context)


def _in_rounds(busy, iterate, start, context, is_batched, size: int, width: int):
    """Rounds of blocks, until all members have ended."""
    unpack = ravel_pytree(jax.tree.map(lambda v: v[0], start))[1]
    axes = jax.tree.map(lambda b: 0 if b else None, is_batched)

    def pack(states):
        return jax.vmap(lambda state: ravel_pytree(state)[0])(states)

    def once(state, going, context):
        after = select(going, iterate(state, context), state)
        return after, busy(after)

    def block(k, carried):
        rows, going, order, few = carried
        # The last block begins where it just fits: members of two blocks are where the first one left them.
        members = lax.dynamic_slice_in_dim(order, k * width, width)
        own = jax.tree.map(lambda v, b: v[members] if b else v, context, is_batched)
        found, still = lax.while_loop(
            lambda state: jnp.sum(state[1]) > few,
            lambda state: jax.vmap(once, (0, 0, axes))(*state, own),
            (jax.vmap(unpack)(rows[members]), going[members]),
        )
        return rows.at[members].set(pack(found)), going.at[members].set(still), order, few

    def one_round(state):
        rows, going = state
        count = jnp.sum(going)
        few = jnp.where(count > width, int(LEFT * width), 0)
        order = jnp.argsort(~going)  # the members that are left first
        rows, going, *_ = lax.fori_loop(0, -(-count // width), block, (rows, going, order, few))
        return rows, going

    rows, _ = lax.while_loop(lambda state: jnp.any(state[1]), one_round, (pack(start), jax.vmap(busy)(start)))
    return jax.vmap(unpack)(rows)
