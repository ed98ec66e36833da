"""Loops of different lengths in a batch: every lane ends where a loop of its own would."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from softgrip_jax.numerics.batching import in_blocks
from softgrip_jax.numerics.xla import traced_once


class Counted(NamedTuple):
    number: jax.Array
    steps: jax.Array
    odd: jax.Array


def collatz(number, end):
    """Steps of the Collatz sequence from `number` to `end`."""
    start = Counted(number, jnp.asarray(0), number % 2 == 1)

    def iterate(state, end):
        following = jnp.where(state.number % 2 == 1, 3 * state.number + 1, state.number // 2)
        odd = state.odd ^ (following % 2 == 1)
        return Counted(jnp.where(state.number == end, state.number, following), state.steps + 1, odd)

    return in_blocks(lambda state: state.number != 1, iterate, start, end)


def expected(number):
    steps, odd = 0, number % 2 == 1
    while number != 1:
        number = 3 * number + 1 if number % 2 else number // 2
        steps, odd = steps + 1, odd ^ (number % 2 == 1)
    return steps, odd


@pytest.mark.parametrize("size", [1, 5, 64, 65, 1000])
def test_each_lane_of_a_batch_ends_where_its_own_loop_ends(size):
    numbers = np.random.default_rng(size).integers(1, 3000, size).astype(float)
    found = jax.jit(jax.vmap(collatz, (0, None)))(jnp.asarray(numbers), jnp.asarray(0.0))
    assert np.all(found.number == 1)
    assert [(int(s), bool(o)) for s, o in zip(found.steps, found.odd, strict=True)] == [expected(n) for n in numbers]


def test_a_batch_of_batches_and_a_context_with_lanes_of_its_own():
    numbers = np.random.default_rng(1).integers(1, 3000, (3, 130)).astype(float)
    ends = jnp.zeros((130,))
    found = jax.vmap(jax.vmap(collatz), (0, None))(jnp.asarray(numbers), ends)
    assert np.array_equal(found.steps, [[expected(n)[0] for n in row] for row in numbers])


def test_lanes_that_have_nothing_to_do():
    found = jax.vmap(collatz, (0, None))(jnp.ones(200), jnp.asarray(0.0))
    assert np.all(found.steps == 0)


def test_every_lane_has_its_own_context():
    """As many additions of its own number as a lane has steps."""
    steps, numbers = np.arange(200) % 37, np.random.default_rng(2).random(200)

    def added(steps, number):
        start = jnp.asarray(steps), jnp.asarray(0.0)
        return in_blocks(lambda s: s[0] > 0, lambda s, number: (s[0] - 1, s[1] + number), start, number)[1]

    np.testing.assert_allclose(jax.jit(jax.vmap(added))(steps, numbers), steps * numbers, rtol=1e-12)
    together = np.full(200, 5)  # every member of a block ends at once
    np.testing.assert_allclose(jax.jit(jax.vmap(added))(together, numbers), 5 * numbers, rtol=1e-12)


@pytest.mark.parametrize(("size", "block"), [(16, 16), (17, 16), (31, 16), (33, 16), (100, 16), (100, 1)])
def test_a_batch_of_any_size_is_gone_through_in_blocks_of_any(size, block):
    """The last block begins where it just fits, so that some members are looked at twice: they step no further."""
    steps = jnp.asarray(np.random.default_rng(size).permutation(size) ** 2 % 53)

    def counted(steps):
        start = steps, jnp.asarray(0)
        return in_blocks(lambda s: s[0] > 0, lambda s, _: (s[0] - 1, s[1] + 1), start, 0.0, block=block)[1]

    assert np.array_equal(jax.jit(jax.vmap(counted))(steps), steps)


def test_few_long_loops_do_not_hold_up_a_batch():
    """Iterations of whole blocks are counted by a callback: 64 members of 1,024 need a hundred iterations, the others
    four. All of them side by side would take 1,024 x 100."""
    steps, worked = jnp.where(jnp.arange(1024) % 16 == 3, 100, 4), []

    def iterate(state, _):
        jax.debug.callback(lambda going: worked.append(going), state > 0)
        return state - 1

    found = jax.vmap(lambda n: in_blocks(lambda s: s > 0, iterate, n, 0.0, block=32))(steps)
    jax.effects_barrier()
    assert np.all(found == 0)
    needed = int(jnp.sum(steps))
    assert needed <= len(worked) < 1.2 * needed


def times_traced(batched):
    """How often a loop's body is traced for one answer, or for a batch, of a function that is compiled by itself."""
    traced = []

    def iterate(state, step):
        traced.append(step)
        return state + step

    def added(step):
        return in_blocks(lambda state: state < 10, iterate, 0.0 * step, step)

    function = traced_once(added)
    jax.jit(jax.vmap(function) if batched else function)(jnp.array([1.0, 3.0]) if batched else 1.0)
    return len(traced)


def test_a_loop_is_traced_once_for_one_member_and_for_many():
    assert times_traced(False) == 1
    assert times_traced(True) == 1


@pytest.mark.parametrize("taken", [jax.grad, jax.jacfwd], ids=["reverse", "forward"])
def test_a_function_is_traced_once_where_it_is_a_derivative_of_another(taken):
    traced = []

    @jax.jit
    def three_squares(x):
        traced.append(x)
        return 3 * x**2

    @jax.custom_jvp
    def cube(x):
        return x**3

    cube.defjvp(lambda at, along: (cube(*at), three_squares(*at) * along[0]))
    both = traced_once(lambda x: cube(x) + three_squares(x))
    assert jax.jit(taken(both))(2.0) == 12 + 12
    assert len(traced) == 1


def test_options_and_words_go_through():
    power = traced_once(lambda x, n: x**n, static_argnames="n")
    assert power(2.0, n=3) == 8
    assert traced_once(collatz).__name__ == "collatz"
