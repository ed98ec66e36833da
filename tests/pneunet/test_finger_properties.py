"""Properties that every finger has, whatever its dimensions: no false state, scaling laws, mirror images.

hypothesis draws whole batches over the admissible space; all of them go through one compiled program.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import reference_beam as ref
from fingers import TYPE_A, contact, pneunet, solved
from hypothesis import given, settings
from hypothesis import strategies as st

import softgrip_jax as sg
from softgrip_jax.reasons import RULE_NAMES

FEW = settings(max_examples=6, deadline=None, derandomize=True)
OK = int(sg.Status.OK)
HALF = 8
"""Fingers of an example; a batch of 16 has a variation of each, too."""

FINGERS = st.lists(
    st.fixed_dictionaries({
        **{name: st.floats(0.5 * value, 2.0 * value) for name, value in TYPE_A.items()},
        "load": st.floats(0.02, 1.2),
        "offset": st.floats(-0.25, 0.25),
        "pull": st.floats(-1.5, 6.0),
        "weight": st.floats(0.0, 4.0),
        "towards": st.floats(0.0, 2 * np.pi),
    }),
    min_size=HALF,
    max_size=HALF,
)  # fmt: skip


def case(d):
    """(finger, offset, pull, weight, pressure in MPa): loads in units that make them matter."""
    f = {name: d[name] for name in TYPE_A}
    stiffness = f["mu"] * f["B"] * f["H"] ** 3 / 3
    size = d["weight"] * stiffness / f["L"] ** 3
    weight = (size * np.cos(d["towards"]), size * np.sin(d["towards"]))
    pressure = ref.pressure_of(f, d["load"] * 6.278 * stiffness / f["L"])
    return f, d["offset"] * f["L"], d["pull"] * stiffness / f["L"] ** 2, weight, pressure


def both(cases, others):
    """Solutions of two lists of cases in one batch, as arrays by name."""
    every = [*cases, *others]
    found = solved([contact(f, "exact", *loads) for f, *loads, _ in every], [p for *_, p in every])
    assert not np.any(np.isnan(found["tip_force"][found["status"] == OK]))
    assert np.max(found["residual"][found["status"] == OK], initial=0.0) <= 1e-12
    first, second = ({name: value[part] for name, value in found.items()} for part in (slice(HALF), slice(HALF, None)))
    # Next to a limit rounding decides; everywhere else a variation that changes nothing has the same status.
    assert np.mean(first["status"] == second["status"]) >= 1 - 1 / HALF
    return first, second, (first["status"] == OK) & (second["status"] == OK)


@FEW
@given(drawn=FINGERS, factor=st.floats(0.05, 20))
def test_stiffer_means_more_pressure_and_force_and_nothing_else(drawn, factor):
    cases = [case(d) for d in drawn]
    stiffer = [
        (f | {"mu": factor * f["mu"]}, offset, factor * pull, (factor * w[0], factor * w[1]), factor * p)
        for f, offset, pull, w, p in cases
    ]
    soft, stiff, known = both(cases, stiffer)
    np.testing.assert_allclose(stiff["tip_force"][known], factor * soft["tip_force"][known], rtol=1e-7, atol=1e-12)
    np.testing.assert_allclose(stiff["tip_angle"][known], soft["tip_angle"][known], rtol=1e-7, atol=1e-9)


@pytest.mark.filterwarnings("ignore::softgrip_jax.errors.UnitWarning")
@FEW
@given(drawn=FINGERS, factor=st.floats(0.1, 10))
def test_size_does_not_matter_at_equal_pressure(drawn, factor):
    """All lengths times k: forces times k^2, weight per length times k, the same shape."""
    cases = [case(d) for d in drawn]
    larger = [
        (
            {name: value if name == "mu" else factor * value for name, value in f.items()},
            factor * offset, factor**2 * pull, (factor * w[0], factor * w[1]), p,
        )
        for f, offset, pull, w, p in cases
    ]  # fmt: skip
    small, large, known = both(cases, larger)
    np.testing.assert_allclose(large["tip_force"][known], factor**2 * small["tip_force"][known], rtol=1e-7, atol=1e-12)
    np.testing.assert_allclose(large["tip"][known], factor * small["tip"][known], rtol=1e-7, atol=1e-7 * factor)


@FEW
@given(drawn=FINGERS)
def test_a_state_keeps_the_equations_that_it_was_made_of(drawn):
    """M_T is that of the walls, the tip is where it is held, and the beam as integrated by SciPy ends in it."""
    cases = [case(d) for d in drawn]
    found, _, known = both(cases, cases)
    for k in np.flatnonzero(known):
        f, offset, _, _, p = cases[k]
        np.testing.assert_allclose(found["end_moment"][k], ref.end_moment(f, p), rtol=1e-7, atol=1e-12)
        np.testing.assert_allclose(found["tip"][k, 1], offset, rtol=0, atol=1e-10 * f["L"])
    if np.any(known):
        k = int(np.flatnonzero(known)[0])
        f, offset, pull, weight, p = cases[k]
        # The foot's moment by the balance of the whole finger: SciPy then runs from there to the tip.
        stiffness = f["mu"] * f["B"] * f["H"] ** 3 / 3
        scene = contact(f, "exact", offset, pull, weight)
        foot = float(FOOT(scene, jnp.asarray(p * 1e6))) * f["mu"] * f["B"] * f["H"] ** 2
        end = ref.integrate(
            f, "exact", [(f["L"], ref.end_moment(f, p))], [0.0, foot, 0.0, 0.0],
            ((pull, found["tip_force"][k]), weight), ref.FINE,
        )[-1]  # fmt: skip
        np.testing.assert_allclose(end[2:], found["tip"][k], rtol=0, atol=2e-6 * f["L"])
        np.testing.assert_allclose(end[1] / stiffness * f["L"], 0, atol=2e-5)


@jax.jit
def FOOT(scene, pressure):
    """M_ext at the clamp over mu B H^2."""
    return scene.bent(sg.solve(scene, pressure).unknowns, jnp.ones_like(pressure), pressure).line.at_clamp


@settings(max_examples=40, deadline=None, derandomize=True)
@given(d=FINGERS.map(lambda drawn: drawn[0]), share=st.floats(0.0, 1.2), inclination=st.floats(0.0, 0.4))
def test_walls_are_those_of_the_equations_wherever_they_have_a_state(d, share, inclination):
    """(4.18)-(4.39) by SciPy, from a wall that just touches to the end of the model; none beyond it."""
    f = {name: d[name] for name in TYPE_A}
    pressure = share * ref.wall_limit(f)
    for angle in (0.0, inclination):
        found = CHAMBER(pneunet(f), jnp.asarray(pressure * 1e6), jnp.asarray(angle))
        status = sg.Status(int(found.status))
        if status is sg.Status.OK:
            np.testing.assert_allclose(
                float(found.end_moment) * 1e3, ref.end_moment(f, pressure, angle), rtol=1e-7, atol=1e-9
            )
        elif status is sg.Status.NO_CONTACT:
            assert float(found.end_moment) == 0
        else:
            assert status is sg.Status.BEYOND_LIMIT
            assert np.isnan(float(found.end_moment))
    if share > 1 + 1e-9:
        assert int(CHAMBER(pneunet(f), jnp.asarray(pressure * 1e6), jnp.asarray(0.0)).status) == sg.Status.BEYOND_LIMIT


CHAMBER = jax.jit(
    # The wall's equations, whatever a mould could hold.
    lambda finger, pressure, inclination: sg.pneunet.chamber(finger, pressure, inclination, ignored_rules=RULE_NAMES)
)
