"""Minima of a scene's energy that are followed as the load grows, and batches of them.

On a CPU the members of a batch are solved one after the other, each from a guess that those before it give: one member
alone makes better use of matrix products than many side by side, and does not wait for others. The guess is a linear
fit, by least squares, of the coefficients over the numbers in which members differ. It decides what a member costs and
not what is found: where the minimum is not close to the guess (BESIDE), the member is followed from the flat membrane
as if it were alone. Elsewhere members are solved side by side, all as if they were alone.

A step of the load may be longer than the object is thick. Where the membrane has the object behind itself, the load is
followed again by finer steps.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jax.custom_batching import custom_vmap, sequential_vmap
from jaxtyping import Array, Float

from ..numerics.batching import in_turn, one_at_a_time
from ..numerics.choice import select
from ..numerics.minimise import Minimum, minimise
from ..numerics.small_linear import solve

Scalar = Float[Array, ""]
Vector = Float[Array, " n"]
Numbers = Float[Array, " m"]

BESIDE = 0.3
"""A minimum that is this close to its guess (coefficients, of order one) is on the same branch."""
FINER, TRIES = 0.25, 3
"""The load steps of the next try over those of the last one, and how often it is tried."""
NEIGHBOURS = 0.2
"""Members whose numbers differ by less, in standard deviations, follow one from the other, along its tangent."""
MOST_DEVIATIONS = 3.0
"""A number that is further from the mean, in standard deviations, counts as this far."""
MOST = 24
"""The fit is over at most so many numbers: with more it costs more than it saves."""
PRIOR = 0.01
"""Slopes of zero weigh as much as so many members: few members determine no slopes."""


def follow(
    scene: Any, start: Vector, start_load: Scalar, guess: Vector, load: Scalar, largest: Scalar | float
) -> Minimum:
    """The minimum at `load`, from a known one, by load steps of at most `largest`."""
    return _follow(scene, start, start_load, guess, load, jnp.asarray(largest))


@in_turn
def _follow(scene: Any, start: Vector, start_load: Scalar, guess: Vector, load: Scalar, largest: Scalar) -> Minimum:
    return minimise(type(scene).expansion, scene, start, start_load, guess, load, largest)


def minimum_at(scene: Any, load: Scalar, largest: float) -> Minimum:
    """The minimum at `load` on the branch that begins at the flat membrane, by load steps of at most `largest`."""
    if one_at_a_time():
        return _finder(largest)(scene, load)
    return in_front(scene, *_flat(scene, load), load, largest)


def in_front(
    scene: Any,
    start: Vector,
    start_load: Scalar,
    guess: Vector,
    load: Scalar,
    largest: Scalar | float,
    to_end: bool = False,
) -> Minimum:
    """As `follow`, by FINER and finer steps where they lead the membrane past the object. Where the finest do, too,
    that is the answer, and `verified` says so. to_end: whether the end of the branch is an answer as good as `load`."""
    known = start, start_load, guess
    return _tried(scene, known, known, load, jnp.asarray(largest), 1, to_end)


def _tried(
    scene: Any, near: Any, flat: Any, load: Scalar, largest: Scalar, first: Any, to_end: bool = False
) -> Minimum:
    """The minimum at `load`: try 0 is from what is `near`, and counts where it ends beside its guess; later ones are
    from what is `flat`, by finer and finer steps, until one stays in front of the object. One loop does it, so that the
    energy is compiled once."""
    last = 1 if scene.body is None else TRIES

    def going(state):
        return state[1]

    def next_try(state):
        number, _, before = state
        start, start_load, guess = select(number == 0, near, flat)
        met = follow(scene, start, start_load, guess, load, largest * FINER ** jnp.maximum(number - 1, 0))
        beside = (number > 0) | (met.reached & jnp.all(jnp.abs(met.y - guess) < BESIDE))
        # Where the branch ended it is asked, too: that may be the end of a branch behind the object.
        passed = scene.has_passed(met.y)
        # A finer step that leads nowhere says nothing: the object was passed, whatever lies ahead.
        told = (number <= 1) | ((met.reached | to_end) & ~passed)
        return number + 1, (~beside | passed | ~told) & (number < last), select(told, met, before)

    start, start_load, guess = flat
    shapes = jax.eval_shape(lambda: follow(scene, start, start_load, guess, load, largest))
    nothing = jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), shapes)
    return lax.while_loop(going, next_try, (jnp.asarray(first), jnp.asarray(True), nothing))[2]


@functools.cache
def _finder(largest: float) -> Callable[[Any, Scalar], Minimum]:
    """`minimum_at` with its rule for batches."""

    @custom_vmap
    def _find(scene: Any, load: Scalar) -> Minimum:
        return in_front(scene, *_flat(scene, load), load, largest)

    @_find.def_vmap
    def _find_batch(axis_size, is_batched, *members):
        met = one_after_other(axis_size, tuple(is_batched), members, largest)
        return met, jax.tree.map(lambda _: True, met)

    return _find


def _flat(scene: Any, load: Scalar) -> tuple[Vector, Scalar, Vector]:
    """Where a membrane that nothing is known of starts: its unknowns, their load, and a guess for `load`."""
    return scene.unloaded_state(), jnp.zeros_like(load), scene.first_guess(load)


class _Known(NamedTuple):
    """Sums over the members that were solved before."""

    products: Float[Array, "m m"]
    """Of the numbers of each member with each other, plus PRIOR."""
    found: Float[Array, "m k"]
    """Products of numbers and coefficients."""
    numbers: Numbers
    """Of the last member that was met,"""
    last: Minimum
    """and its minimum; `reached` says whether there is one."""


def one_after_other(size: int, is_batched: Any, members: Any, largest: float) -> Minimum:
    """The minima of all members (scene, load)."""

    def spread(leaf, batched):
        return leaf if batched else jnp.broadcast_to(leaf, (size, *jnp.shape(leaf)))

    members = jax.tree.map(spread, members, is_batched)
    pairs = zip(jax.tree.leaves(members), jax.tree.leaves(is_batched), strict=True)
    *varied, load = [leaf if batched else jnp.zeros((size, 0)) for leaf, batched in pairs]
    numbers = _numbers(load, varied, size)
    # In a batch of batches each has its own fit, and none is computed that is not needed.
    return sequential_vmap(lambda numbers, members: _in_turn(numbers, members, largest))(numbers, members)


def _numbers(load: Array, varied: list[Array], size: int) -> Float[Array, "n m"]:
    """One, the load and what scenes differ in, in standard deviations from their mean, and the load squared."""
    raw = jnp.concatenate([jnp.reshape(leaf, (size, -1)) for leaf in (load, *varied)], axis=1)[:, :MOST]
    known = jnp.where(jnp.isfinite(raw), raw, jnp.nan)
    spread = jnp.nanstd(known, axis=0, keepdims=True)
    scaled = (known - jnp.nanmean(known, axis=0, keepdims=True)) / jnp.where(spread > 0, spread, 1.0)
    usual = jnp.where(jnp.isfinite(scaled), jnp.clip(scaled, -MOST_DEVIATIONS, MOST_DEVIATIONS), 0.0)
    loads = usual[:, : jnp.reshape(load, (size, -1)).shape[1]]
    return jnp.concatenate([jnp.ones((size, 1)), usual, loads**2], axis=1)


def _in_turn(numbers: Float[Array, "n m"], members: Any, largest: float) -> Minimum:
    def next_member(known: _Known, member):
        here, (scene, load) = member
        guess = _guess(known, here, load)
        first = jnp.where(known.last.reached, 0, 1)
        met = _tried(scene, (guess, load, guess), _flat(scene, load), load, jnp.asarray(largest), first)
        sums = known.products + jnp.outer(here, here), known.found + jnp.outer(here, met.y)
        more = _Known(*sums, here, met)
        return select(met.reached, more, known), met

    first = jax.tree.map(lambda leaf: leaf[0], members)
    shapes = jax.eval_shape(lambda scene, load: follow(scene, *_flat(scene, load), load, largest), *first)
    nothing = jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), shapes)
    count = numbers.shape[1]
    begun = _Known(PRIOR * jnp.eye(count), jnp.zeros((count, nothing.y.size)), jnp.zeros(count), nothing)
    return lax.scan(next_member, begun, (numbers, members))[1]


def _guess(known: _Known, here: Numbers, load: Scalar) -> Vector:
    """By the fit; from the last member where that is close, along its tangent with the load."""
    tangent = known.last.y + (load - known.last.load) * known.last.slope
    close = jnp.all(jnp.abs(here - known.numbers) < NEIGHBOURS)
    return jnp.where(close, tangent, solve(known.products, here) @ known.found)
