"""Variables: the right leaves move, bounds hold by construction, and the maps go both ways."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import shell

import softgrip_jax as sg
from optim.space import Space, Variable, to_free, to_unit
from softgrip_jax.units import mm


def scenes():
    return {
        "free": sg.shell.Free(shell()),
        "flat": sg.shell.FlatContact(shell("ogden"), distance=5 * mm),
    }


def test_named_leaves_move_and_nothing_else_does():
    space = Space(scenes(), [Variable("free.shell.a", 8 * mm, 24 * mm), Variable("flat.distance", 1 * mm, 9 * mm)])
    moved = space.scenes_at(jnp.array([10 * mm, 2 * mm]))
    assert float(moved["free"].shell.a) == 10 * mm
    assert float(moved["flat"].distance) == 2 * mm
    before, after = (len(jax.tree.leaves(s)) for s in (scenes(), moved))
    changed = sum(not np.array_equal(a, b) for a, b in zip(*map(jax.tree.leaves, (scenes(), moved)), strict=True))
    assert before == after
    assert changed == 2
    assert space.kinds == ["length", "length"]
    np.testing.assert_array_equal(space.reference, [16 * mm, 5 * mm])


def test_tied_leaves_move_as_one():
    space = Space(scenes(), [Variable("free.shell.a = flat.shell.a", 8 * mm, 24 * mm)])
    moved = space.scenes_at(jnp.array([11 * mm]))
    assert space.size == 1
    assert float(moved["free"].shell.a) == float(moved["flat"].shell.a) == 11 * mm


def test_a_leaf_without_a_scene_is_that_of_every_scene_that_has_it():
    space = Space(scenes(), [Variable("shell.a", 8 * mm, 24 * mm), Variable("distance", 1 * mm, 9 * mm)])
    moved = space.scenes_at(jnp.array([11 * mm, 3 * mm]))
    assert float(moved["free"].shell.a) == float(moved["flat"].shell.a) == 11 * mm
    assert float(moved["flat"].distance) == 3 * mm


def test_where_names_leaves_by_a_function():
    space = Space(
        scenes(), [Variable("both", 1 * mm, 3 * mm, where=lambda s: (s["free"].shell.t_m, s["flat"].shell.t_m))]
    )
    moved = space.scenes_at(jnp.array([2 * mm]))
    assert float(moved["free"].shell.t_m) == float(moved["flat"].shell.t_m) == 2 * mm


def test_every_element_of_an_array_is_a_variable():
    space = Space({"scene": scenes()["flat"]}, [Variable("shell.material.mu", -2e5, 2e5)])
    assert space.names == ["shell.material.mu[0]", "shell.material.mu[1]", "shell.material.mu[2]"]
    moved = space.scenes_at(jnp.array([1e5, 2e3, -3e3]))["scene"]
    np.testing.assert_array_equal(moved.shell.material.mu, [1e5, 2e3, -3e3])


def test_bounds_hold_for_every_free_value():
    space = Space(
        {"scene": scenes()["free"]},
        [Variable("shell.a", 8 * mm, 24 * mm), Variable("shell.b", 25 * mm, 50 * mm, "log")],
    )
    free = np.random.default_rng(1).standard_cauchy((1000, 2)) * 10
    x = np.asarray(jax.vmap(space.from_unit)(to_unit(jnp.asarray(free))))
    assert np.all(x >= space.low * (1 - 1e-15))
    assert np.all(x <= space.high * (1 + 1e-15))
    assert np.ptp(x, axis=0) == pytest.approx(space.high - space.low, rel=1e-3)


def test_maps_go_both_ways_and_log_is_a_ratio():
    space = Space(
        {"scene": scenes()["free"]},
        [Variable("shell.a", 8 * mm, 24 * mm), Variable("shell.b", 25 * mm, 100 * mm, "log")],
    )
    t = np.array([0.25, 0.5])
    x = space.from_unit(jnp.asarray(t))
    np.testing.assert_allclose(x, [12 * mm, 50 * mm], rtol=1e-14)  # 50 is the geometric mean of 25 and 100
    np.testing.assert_allclose(space.to_unit(x), t, rtol=1e-14)
    np.testing.assert_allclose(to_unit(to_free(t)), t, rtol=1e-14)


@pytest.mark.parametrize(
    ("variable", "sentence"),
    [
        (lambda: Variable("free.shell.c", 1.0, 2.0), "free.shell has no field 'c'; it has a, b, t_m, material"),
        (lambda: Variable("shell.c", 1.0, 2.0), "is in no scene; name one of free, flat before it"),
        (lambda: Variable("free.shell", 1.0, 2.0), "must be a number that a scene holds"),
        (lambda: Variable("free.shell.a", 2.0, 1.0), "low must be below high"),
        (lambda: Variable("free.shell.a", 0.0, 1.0, "log"), "on a log scale it must be positive"),
        (lambda: Variable("free.shell.a", 0.0, 1.0, "sqrt"), "must be 'linear' or 'log'"),
        (lambda: Variable("free.shell.a = flat.shell.material.mu", 1.0, 2.0), "have different shapes"),
    ],
)
def test_mistakes_are_named(variable, sentence):
    with pytest.raises(ValueError, match=sentence):
        Space(scenes(), [variable()])


def test_a_variable_twice_is_a_mistake():
    twice = [Variable("free.shell.a", 8 * mm, 24 * mm)] * 2
    with pytest.raises(ValueError, match="given twice"):
        Space(scenes(), twice)


def test_a_number_under_two_names_is_a_mistake():
    """Only the last of them counted, in every scene that both name."""
    both = [Variable("shell.t_m", 1 * mm, 2 * mm), Variable("flat.shell.t_m", 1 * mm, 2 * mm)]
    with pytest.raises(ValueError, match=r"moves a number that variable 'shell\.t_m' moves, too"):
        Space(scenes(), both)
    with pytest.raises(ValueError, match="moves a number that variable 'one' moves, too"):
        Space(scenes(), [Variable("one", 1 * mm, 2 * mm, where=lambda s: s["free"].shell.t_m), both[0]])
    apart = [Variable("free.shell.t_m", 1 * mm, 2 * mm), both[1]]
    assert Space(scenes(), apart).names == ["free.shell.t_m", "flat.shell.t_m"]
