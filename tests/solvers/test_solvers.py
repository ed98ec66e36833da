"""Solvers as a choice: the same answers by each, certificates, warm starts, and what cannot be used."""

from dataclasses import replace
from functools import cache

import jax
import jax.numpy as jnp
import lineax
import numpy as np
import optimistix as optx
import pytest
from fingers import TYPE_A, contact
from hard_cases import FINGERS, SHELLS, Hard, free_top
from helpers import CASES, Case, cheap, reference, shell
from jax import lax

import softgrip_jax as sg
from softgrip_jax.numerics.implicit import implicit
from softgrip_jax.pneunet import Shooting
from softgrip_jax.solvers import ArcLength, ExplicitCurve, MinimumEnergy, Newton
from softgrip_jax.solvers.settings import require_number
from softgrip_jax.units import kPa

OK, BEYOND, NOT_CONVERGED = sg.Status.OK, sg.Status.BEYOND_LIMIT, sg.Status.NOT_CONVERGED
FAST = ("free", "flat-yeoh", "cylinder")
NEARBY = 0.98
"""A guess is the solution at this share of the pressure."""


def catalogue():
    """Every scene of the catalogue by every solver that suits it, and by Newton's method from nearby, too."""
    for case in CASES:
        names = ["MinimumEnergy"] if "energy" in case.name else ["ExplicitCurve", "Newton", "Newton from nearby"]
        for name in names:
            fast = case.name in FAST and name == "Newton"
            yield pytest.param(case, name, id=f"{case}-{name}", marks=[] if fast else pytest.mark.slow)


@pytest.mark.parametrize(("case", "name"), list(catalogue()))
def test_every_solver_finds_what_the_default_finds(case: Case, name: str):
    scene, observed = reference(case)
    solver = getattr(sg.solvers, name.split()[0])()
    near = sg.solve(scene, NEARBY * case.pressure) if "nearby" in name else None
    found = sg.solve(scene, case.pressure, solver=solver, guess=near)
    assert int(found.status) == OK
    for name, value in observed.items():
        np.testing.assert_allclose(found.observables[name], value, rtol=1e-9)


def finger(offset=-3.0, weight=(5e-4, -1e-3)):
    return contact(TYPE_A, "exact", offset, 0.05, weight)


def answers(scene, pressure):
    """By every solver; other tests have the programs of the first and the last."""
    return [sg.solve(scene, pressure, solver=s) for s in (None, ArcLength(largest_step=1.0, turn=0.95), Newton())]


def test_a_finger_by_every_solver():
    found = answers(finger(), 25 * kPa)
    for other in found[1:]:
        assert int(other.status) == OK
        np.testing.assert_allclose(other.tip_force, found[0].tip_force, rtol=1e-12)
    # Beyond the limit there is nothing to be found; that there is no equilibrium Newton's method cannot know.
    found = answers(finger(), 60 * kPa)
    assert [int(s.status) for s in found[:2]] == [BEYOND, BEYOND]
    assert int(found[2].status) in (BEYOND, NOT_CONVERGED)
    assert np.isnan(found[2].tip_force)


@pytest.mark.slow
def test_states_behind_a_limit_have_no_certificate():
    """Equilibria under volume control, unstable under pressure: they solve the equations, and are no answer."""
    scene = finger()
    curve = sg.branch(scene, 60)
    top = int(np.argmax(np.where(curve.status == OK, curve.pressure, 0)))
    before, behind = top - 4, top + 4
    newton = jax.jit(lambda p, y: sg.solve(scene, p, solver=Newton(), guess=y))
    for k, status, reason in ((before, OK, sg.Reason.NONE), (behind, NOT_CONVERGED, sg.Reason.ANOTHER_BRANCH)):
        found = newton(curve.pressure[k], curve.unknowns[k])
        assert int(found.residual < 1e-12)
        assert (int(found.status), int(found.reason)) == (status, reason)
        np.testing.assert_allclose(found.unknowns, curve.unknowns[k], rtol=0, atol=1e-6)
    assert "not on the branch" in found.reason_text()
    assert jax.grad(lambda p: newton(p, curve.unknowns[behind]).tip_force)(curve.pressure[behind]) == 0


def test_a_membrane_behind_its_largest_pressure_has_no_certificate():
    top, largest = free_top()
    newton = jax.jit(lambda p, y: sg.solve(sg.shell.Free(shell()), p, solver=Newton(), guess=y))
    status = [int(newton(0.9 * largest, guess).status) for guess in (0.7 * top, 1.25 * top)]
    assert status == [OK, NOT_CONVERGED]
    assert int(newton(1.1 * largest, top).status) == NOT_CONVERGED


def test_a_column_that_has_buckled_has_no_certificate():
    """Pressed along its axis by three times Euler's load, straight it is in equilibrium but not stable."""
    case = next(case for case in FINGERS if "Euler" in case.name)
    found = sg.solve(case.make(), 0.0, solver=Newton())
    assert int(found.residual < 1e-12)
    assert int(found.reason) == sg.Reason.ANOTHER_BRANCH


def test_a_loop_beyond_the_limit_has_no_certificate():
    """A held tip that has turned by 396 degrees has a Jacobian of the right sign; there is no state at 44 kPa."""
    held = sg.pneunet.TipContact(sg.PneuNet.table_5_1("A"), points=8)
    assert sg.limit_pressure(held) < 42 * kPa
    guess = sg.solve(held, 1 * kPa)
    newton = jax.vmap(lambda p: sg.solve(held, p, solver=sg.solvers.Newton(), guess=guess))
    assert not np.any(newton(jnp.array([43, 44, 45, 46]) * kPa).status == sg.Status.OK)


def test_warm_starts_along_a_parameter():
    """Each from the solution before, in a scan; the same as from zero load, in fewer steps."""
    scene = finger()
    pressures = jnp.linspace(20, 30, 6) * kPa

    @jax.jit
    def along(start):
        def next_one(guess, pressure):
            found = sg.solve(scene, pressure, solver=Newton(), guess=guess)
            return found.unknowns, (found.tip_force, found.iterations, found.status)

        return lax.scan(next_one, start, pressures)[1]

    first = sg.solve(scene, pressures[0])
    force, steps, status = along(first.unknowns)
    np.testing.assert_array_equal(status, OK)
    np.testing.assert_allclose(force, [sg.solve(scene, p).tip_force for p in pressures], rtol=1e-12)
    assert np.max(steps) <= 5
    # A Solution is a guess as it is.
    again = sg.solve(scene, pressures[0], solver=Newton(), guess=first)
    np.testing.assert_allclose(again.tip_force, first.tip_force, rtol=1e-12)


@pytest.mark.slow
def test_derivatives_do_not_depend_on_the_solver():
    scene = finger()

    def force(share, solver):
        return sg.solve(replace(scene, tip_offset=share * scene.tip_offset), 25 * kPa * share, solver=solver).tip_force

    for derivative in (jax.grad(force), jax.jacfwd(force), jax.grad(jax.grad(force))):
        ours, other = (jax.jit(derivative, static_argnums=1)(jnp.asarray(1.0), s) for s in (Newton(), None))
        np.testing.assert_allclose(ours, other, rtol=1e-9)


def test_the_implicit_rule_is_optimistixs():
    """implicit at a root = optimistix.root_find with its ImplicitAdjoint, gradient and second derivative."""

    def residual(y, a):
        return jnp.stack([y[0] ** 3 + y[1] - a, y[1] - jnp.sin(y[0])])

    def by_optimistix(a):
        found = optx.root_find(residual, optx.Newton(1e-12, 1e-12), jnp.ones(2), a, adjoint=optx.ImplicitAdjoint())
        return found.value[0]

    def by_implicit(a):
        return implicit(residual, optx.root_find(residual, optx.Newton(1e-12, 1e-12), jnp.ones(2), 2.0).value, a)[0]

    a, h = jnp.asarray(2.0), 1e-4
    theirs = jax.jit(jax.grad(by_optimistix))
    ours = jax.jit(lambda a: [of(a) for of in (jax.grad(by_implicit), jax.jacfwd(by_implicit))])
    np.testing.assert_allclose(ours(a), [theirs(a)] * 2, rtol=1e-12)
    second = (theirs(a + h) - theirs(a - h)) / (2 * h)
    np.testing.assert_allclose(jax.jit(jax.grad(jax.grad(by_implicit)))(a), second, rtol=1e-6)


@pytest.mark.slow
def test_the_energy_membrane_by_its_solver():
    scene = cheap(sg.shell.Free(shell(), model="energy"))
    ours, other = (sg.solve(scene, 12 * kPa, solver=s) for s in (MinimumEnergy(largest_step=0.6), None))
    assert int(ours.status) == OK
    assert int(ours.iterations) > int(other.iterations)
    np.testing.assert_allclose(ours.inflation, other.inflation, rtol=1e-9)


# --- hard cases by every method and solver ----------------------------------------------------------------------------


BEAMS = {"collocation": None, "shooting": Shooting()}
BY_NEWTON = ("Newton", "Newton from nearby")
COMPILED = ("finger, tip held", "finger without", "first contact", "without a gap", "Euler")
"""Fingers whose program by Newton's method and collocation another test of the default selection compiles."""
WRONG = ("soft and heavy: 80 kPa, 6 N/m", "shooting", "Newton")
"""From the unloaded finger it gets to one that is curled the other way round (-4.2 rad in place of 1.5) and calls it
OK: the determinant has the sign that it has without load there, too."""


@cache
def truth(name: str) -> float | None:
    """The catalogue's value of a case, computed once; None where it has none, or where SciPy's ramp gets no further
    (then the default's answer stands for it, which test_hard_cases.py holds to it)."""
    case = next(case for case in (*SHELLS, *FINGERS) if case.name == name)
    try:
        return None if case.truth is None else case.truth()
    except (AssertionError, ArithmeticError):
        return None


def nearby(case: Hard, scene: sg.Scene) -> sg.Solution | None:
    """A state at a little less pressure, or a little more, by the default solver; None where there is none."""
    for share in (NEARBY, 1 / NEARBY):
        found = sg.solve(scene, share * case.pressure())
        if int(found.status) == OK:
            return found
    return None


def check(case: Hard, scene: sg.Scene, name: str, rtol: float) -> None:
    """What is called OK is the catalogue's answer, and where it has none the default's; what is not has no values.

    Newton's method may give up where the catalogue has an answer, with a reason; the others may not.
    """
    guess = nearby(case, scene) if "nearby" in name else None
    found = sg.solve(scene, case.pressure(), solver=getattr(sg.solvers, name.split()[0])(), guess=guess)
    status = sg.Status(int(found.status))
    if status is NOT_CONVERGED and name in BY_NEWTON:
        reasons = (sg.Reason.ANOTHER_BRANCH, sg.Reason.RESIDUAL_TOO_LARGE)
        assert sg.Reason(int(found.reason)) in reasons
        assert found.reason_text()
    else:
        assert status in case.status, found.reason_text()
    if status is not OK:
        empty = 0 if status is sg.Status.NO_CONTACT else np.nan
        for value in found.observables.values():
            np.testing.assert_array_equal(value, np.broadcast_to(empty, np.shape(value)))
    elif (value := truth(case.name)) is not None:
        np.testing.assert_allclose(found.observables[case.observable], value, rtol=rtol)
    else:  # 16 points leave 6e-6 of where the heaviest finger hangs
        usual = sg.solve(case.make(), case.pressure())
        for key, value in usual.observables.items():
            np.testing.assert_allclose(found.observables[key], value, rtol=1e-5, atol=1e-9)


def hard(cases, methods, solvers):
    """Every case by every method and solver; fast where the program is compiled in a second, or by another test."""
    for case in cases:
        for method in methods:
            for name in solvers:
                shared = method == "collocation" and any(words in case.name for words in COMPILED)
                fast = name == "Newton" and (shared or method == "curve")
                marks = [] if fast else [pytest.mark.slow]
                if (case.name, method, name) == WRONG:
                    marks.append(pytest.mark.xfail(strict=True, reason="another branch has a certificate"))
                yield pytest.param(case, method, name, id=f"{case}-{method}-{name}", marks=marks)


@pytest.mark.parametrize(("case", "method", "name"), list(hard(SHELLS, ["curve"], ["ExplicitCurve", *BY_NEWTON])))
def test_hard_shells(case, method, name):
    check(case, case.make(), name, case.tolerance)


@pytest.mark.parametrize(("case", "method", "name"), list(hard(FINGERS, BEAMS, ["ArcLength", *BY_NEWTON])))
def test_hard_fingers(case, method, name):
    scene = replace(case.make(), beam=BEAMS[method])
    check(case, scene, name, case.tolerance if method == "collocation" else max(case.tolerance, 1e-6))


# --- what cannot be used ----------------------------------------------------------------------------------------------

BAD = {
    "a curve for a finger": (
        lambda: sg.solve(finger(), 1e4, solver=ExplicitCurve()),
        "TipContact cannot be solved by ExplicitCurve; it can by ArcLength or Newton",
    ),
    "an arc length for a shell": (
        lambda: sg.solve(sg.shell.Free(shell()), 1e4, solver=ArcLength()),
        "Free cannot be solved by ArcLength; it can by ExplicitCurve or Newton",
    ),
    "Newton for an energy": (
        lambda: sg.solve(sg.shell.Free(shell(), model="energy"), 1e4, solver=Newton()),
        "^Free with model='energy' cannot be solved by Newton; it can by MinimumEnergy",
    ),
    "a class": (lambda: sg.solve(finger(), 1e4, solver=Newton), "it must be one of sg.solvers"),
    "a name": (lambda: sg.solve(finger(), 1e4, solver="newton"), "solver is 'newton'; it must be one of sg.solvers"),
    "a guess alone": (lambda: sg.solve(finger(), 1e4, guess=jnp.zeros(17)), "give solver=sg.solvers.Newton"),
    "a guess for arc length": (
        lambda: sg.solve(finger(), 1e4, solver=ArcLength(), guess=jnp.zeros(17)),
        "ArcLength begins at zero load and takes no guess",
    ),
    "a guess of another size": (
        lambda: sg.solve(finger(), 1e4, solver=Newton(), guess=jnp.zeros(9)),
        r"unknowns of the shape \(9,\), and the unknowns of this TipContact have the shape \(17,\)",
    ),
    "no guess at all": (lambda: sg.solve(finger(), 1e4, solver=Newton(), guess="near"), "guess is 'near'"),
    "a tolerance": (lambda: Newton(rtol=0.0), "Newton.rtol is 0.0; it must be a number between 0 and 1"),
    "no steps": (lambda: Newton(max_steps=0), "Newton.max_steps is 0; it must be a whole number"),
    "no linear solver": (lambda: Newton(linear_solver="LU"), "Newton.linear_solver is 'LU'; it must be a solver"),
    "a step": (lambda: ArcLength(largest_step=0.0), "ArcLength.largest_step is 0.0; it must be a positive number"),
    "a turn": (lambda: ArcLength(turn=1.0), "ArcLength.turn is 1.0; it must be a cosine between 0 and 1"),
    "a load step": (lambda: MinimumEnergy(largest_step=-1.0), "MinimumEnergy.largest_step is -1.0"),
    "an endless step": (lambda: MinimumEnergy(largest_step=float("inf")), "MinimumEnergy.largest_step is inf"),
    "a step in words": (
        lambda: require_number("ArcLength.largest_step", "big"),
        "ArcLength.largest_step is 'big'; it must be a positive number",
    ),
    "a switch": (
        lambda: require_number("ArcLength.turn", True),
        "ArcLength.turn is True; it must be a positive",
    ),
}


@pytest.mark.parametrize(("ask", "said"), BAD.values(), ids=BAD)
def test_what_cannot_be_used_is_said(ask, said):
    with pytest.raises(ValueError, match=said):
        ask()


@pytest.mark.slow
def test_a_linear_solver_of_ones_own():
    found = sg.solve(finger(), 25 * kPa, solver=Newton(linear_solver=lineax.QR()))
    np.testing.assert_allclose(found.tip_force, sg.solve(finger(), 25 * kPa).tip_force, rtol=1e-12)


def test_every_scene_names_its_solvers():
    """What a scene says that it can use is there, and the first of them does what is done by default."""
    for case in CASES:
        scene = case.make().prepared()
        assert all(hasattr(sg.solvers, name) for name in scene.SOLVERS)
    scene = sg.shell.Free(shell())
    ours, other = (sg.solve(scene, 12 * kPa, solver=s) for s in (ExplicitCurve(), None))
    assert float(ours.inflation) == float(other.inflation)
