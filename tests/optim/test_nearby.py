"""A state from a state nearby: the same as along the whole way, with the same derivatives, or NOT_CONVERGED."""

import jax
import jax.numpy as jnp
import pytest
from helpers import MATERIALS

import softgrip_jax as sg
from optim.nearby import PRESSURE, can_begin_nearby, is_covered, known_state, limit_nearby, limit_of, state_at
from softgrip_jax.numerics.nearby import root_by_chords, root_nearby
from softgrip_jax.quantities import solution_at
from softgrip_jax.units import gram, kPa, mm


def finger(a):
    sizes = {"b": 8, "h_x": 0.9, "t_m": 1.1, "h_L": 4.2, "H": 5, "B": 20, "L": 77}
    return sg.PneuNet(a=a, **{k: v * mm for k, v in sizes.items()}, material=MATERIALS["neo"]())


def held(a):
    return sg.pneunet.TipContact(finger(a), points=6, tip_offset=-3 * mm)


def grasping(a):
    rod = sg.objects.Cylinder(radius=18 * mm, mass=26 * gram, friction=0.96)
    return sg.pneunet.Grasp(sg.pneunet.Gripper(finger(a)), rod, points=6)


class Case:
    """One kind of scene, by the half height a of its chambers, with the programs of both ways."""

    def __init__(self, make, at, name):
        def along(a):
            solution = solution_at(make(a), at)
            return solution.observables[name], known_state(at, solution, jnp.asarray(a)[None])

        def near(a, known):
            def equations(u, t):
                residual, solution = state_at(make(t[0]), at, u)
                return (residual, solution.observables[name][None]), solution

            found = root_nearby(equations, jnp.asarray(a)[None], known)
            covered = is_covered(make(a), at, found.told)
            return found.observed[0], found.slopes[0, 0], found.good & covered, found.known

        def by_chords(a, known):
            def equations(u, t):
                residual, solution = state_at(make(t[0]), at, u)
                return (residual, solution.observables[name][None]), None

            observed, _, good, _ = root_by_chords(equations, jnp.asarray(a)[None], known)
            return observed[0], good

        self.by_chords = jax.jit(by_chords)
        self.along = jax.jit(jax.value_and_grad(along, has_aux=True))
        self.near = jax.jit(near)

    def known(self, a):
        return self.along(a)[0][1]


@pytest.fixture(scope="module", params=["pressure", "required"])
def case(request):
    if request.param == "pressure":
        return Case(held, 25 * kPa, "tip_force")
    return Case(grasping, "required", "tip_angle")


A = 5 * mm


def test_the_state_next_door_is_the_one_along_the_whole_way(case):
    known = case.known(A)
    for a in (1.0 * A, 1.02 * A, 1.05 * A):
        for _ in range(4):  # as a search does where the way is far: each time with a new Jacobian
            value, slope, good, known = case.near(a, known)
            if good:
                break
        (expected, _), derivative = case.along(a)
        assert good
        assert value == pytest.approx(float(expected), rel=1e-9)
        assert slope == pytest.approx(float(derivative), rel=1e-5)  # the Jacobian is that of the last but one point


@pytest.mark.slow
def test_the_slope_is_exact_where_the_state_is_known_already(case):
    *_, known = case.near(A, case.known(A))
    value, slope, good, _ = case.near(A, known)
    (expected, _), derivative = case.along(A)
    assert good
    assert value == pytest.approx(float(expected), rel=1e-11)
    assert slope == pytest.approx(float(derivative), rel=1e-9)
    step = 1e-5 * A
    difference = (case.along(A + step)[0][0] - case.along(A - step)[0][0]) / (2 * step)
    assert slope == pytest.approx(float(difference), rel=1e-5)


@pytest.mark.slow
def test_another_sign_of_the_determinant_is_no_answer(case):
    *_, good, known = case.near(A, case.known(A))
    assert good
    assert not case.near(A, known._replace(side=-known.side))[2]


def test_chords_alone_lead_to_the_same_state_or_to_none(case):
    *_, known = case.near(A, case.known(A))
    found = 0
    for a in (1.0 * A, 0.98 * A, 1.02 * A, 1.3 * A):
        value, good = case.by_chords(a, known)
        (expected, _), _ = case.along(a)
        assert not good or value == pytest.approx(float(expected), rel=1e-8)
        found += int(good)
    assert found >= 3  # of those that are near
    assert not case.by_chords(A, case.known(A))[1]  # nothing is known of its Jacobian


def test_nonsense_is_no_answer(case):
    known = case.known(A)
    assert not case.near(A, known._replace(u=known.u + 1e3))[2]
    assert not case.near(-A, known)[2]


def test_scenes_of_one_unknown_have_no_need_of_it():
    assert can_begin_nearby(held(A))
    assert not can_begin_nearby(
        sg.shell.Free(sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=MATERIALS["neo"]()))
    )


@pytest.mark.slow
def test_the_limit_point_next_door_is_the_one_along_the_whole_way():
    """With its slope, which is that of `limit_pressure`."""

    def along(a):
        return limit_of(held(a), jnp.asarray(a)[None])

    def near(a, known):
        return limit_nearby(lambda t: held(t[0]), jnp.asarray(a)[None], known)

    along, near = jax.jit(along), jax.jit(near)
    known, is_fold = along(5 * mm)
    assert is_fold
    for a in (5 * mm, 5.05 * mm, 5.3 * mm, 4.6 * mm):
        known, good = near(a, known)
        limit, slope = jax.value_and_grad(lambda a: sg.limit_pressure(held(a)))(a)
        assert good
        assert known.u[-1] * PRESSURE == pytest.approx(float(limit), rel=1e-7)
        assert known.moved[-1, 0] * PRESSURE == pytest.approx(float(slope), rel=1e-3)
