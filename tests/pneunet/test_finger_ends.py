"""Where a free finger ends before any fold: rolled up, with its inclined walls closed, with its section full."""

import dataclasses
from fractions import Fraction

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import reference_beam as ref
from fingers import TYPE_A, pneunet
from scipy.optimize import brentq

import softgrip_jax as sg
from softgrip_jax.load_path import LoadPath
from softgrip_jax.reasons import Reason

OK, BEYOND = int(sg.Status.OK), int(sg.Status.BEYOND_LIMIT)
LIMIT = jax.jit(jax.value_and_grad(sg.limit_pressure))
SOLVE = jax.jit(jax.vmap(sg.solve, in_axes=(None, 0)))
SOFT_WALLS = {
    "a": 6.6,
    "b": 15.8,
    "h_x": 0.458,
    "t_m": 0.46,
    "h_L": 5.42,
    "H": 10.8,
    "B": 60.0,
    "L": 101.0,
    "mu": 0.558,
}
"""Its inclined walls close at 3.1 rad, long before parallel ones would: 472 kPa and 1,035 kPa."""


def rolled_up(f, law):
    """The pressure (MPa) at which the curvature is two full turns over the length."""
    unit = f["mu"] * f["B"] * f["H"] ** 2

    def turn(p):
        return ref.LAWS[law](ref.end_moment(f, p) / unit, 0.0)[0] * f["L"] / f["H"]

    # The thesis's law has no state at all a little above this.
    return brentq(lambda p: turn(p) - 4 * np.pi, 0.01, 0.065 if law == "exact" else 0.045, xtol=1e-15)


def walls_closed(f):
    """The pressure (MPa) at which walls, as inclined as one arc makes them, are closed."""
    unit, pitch = f["mu"] * f["B"] * f["H"] ** 2, 2 * f["h_x"] + f["h_L"]

    def surplus(turn):
        """What the chambers exert when their walls are just closed, less what holds the cover at this turn."""
        incline = 0.5 * pitch / f["L"] * turn
        moment = ref.end_moment(f, ref.wall_limit(f, incline) * (1 - 1e-12), incline)
        return ref.exact_law(moment / unit, 0.0)[0] * f["L"] / f["H"] - turn

    return ref.wall_limit(f, 0.5 * pitch / f["L"] * brentq(surplus, 2.0, 4.0, xtol=1e-12))


CASES = {
    "rolled up": (TYPE_A, {"inclination": "none"}, Reason.CURLED_UP, lambda f: rolled_up(f, "exact")),
    "rolled up, thesis": (
        TYPE_A,
        {"inclination": "none", "section": "thesis"},
        Reason.CURLED_UP,
        lambda f: rolled_up(f, "thesis"),
    ),
    "walls closed": (SOFT_WALLS, {"inclination": "segment"}, Reason.INCLINED_WALL, walls_closed),
}


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.slow if name == "walls closed" else ()) for name in CASES]
)
def test_the_limit_is_where_the_model_ends(name):
    """Against SciPy on the thesis's equations, its derivative by the wall's thickness, and the labels next to it."""
    numbers, options, why, wanted = CASES[name]
    scene = sg.pneunet.Free(pneunet(numbers), weight=None, **options)
    if name == "rolled up, thesis":  # derivatives of another section law are another program of the same kind
        limit = sg.limit_pressure(scene)
    else:
        limit, slopes = LIMIT(scene)
        step = 1e-4 * numbers["t_m"]
        high, low = (wanted(numbers | {"t_m": numbers["t_m"] + k * step}) for k in (1, -1))
        np.testing.assert_allclose(slopes.finger.t_m, (high - low) * 1e6 / (2e-3 * step), rtol=1e-5)
    np.testing.assert_allclose(limit, wanted(numbers) * 1e6, rtol=1e-8)
    near = SOLVE(scene, limit * jnp.array([1 - 1e-6, 1 + 1e-6]))
    np.testing.assert_array_equal(near.status, [OK, BEYOND])
    assert int(near.reason[1]) == why


@pytest.mark.slow
def test_a_heavy_finger_rolls_up_too():
    """The beam with weight, which knows no closed form: at its limit the tip has turned twice."""
    scene = sg.pneunet.Free(pneunet(TYPE_A), inclination="none", points=8)
    limit = float(sg.solve(scene, 70e3).detail)
    np.testing.assert_allclose(limit, 1e6 * rolled_up(TYPE_A, "exact"), rtol=2e-2)
    near = SOLVE(scene, limit * jnp.array([1 - 1e-6, 1 + 1e-6]))
    np.testing.assert_array_equal(near.status, [OK, BEYOND])
    np.testing.assert_allclose(near.tip_angle[0], 4 * np.pi, rtol=1e-4)
    assert int(near.reason[1]) == Reason.CURLED_UP


@pytest.mark.parametrize("degrees", [400.0, 600.0])
def test_what_no_pressure_gives_ends_with_the_law(degrees):
    """However far the wanted value is: 600 degrees, which the path passes beyond that end, ended at 38.3 kPa. It is
    the law that ends there, and equilibrium goes on."""
    found = sg.pressure_for(sg.pneunet.Free(pneunet(TYPE_A), drive="cell"), tip_angle=np.deg2rad(degrees))
    assert (int(found.status), int(found.reason)) == (BEYOND, Reason.VALUE_BEYOND_CELL_LAW)
    assert float(found.detail) == pytest.approx(0.24 * 136e3, rel=1e-12)


def test_a_moment_that_no_section_carries():
    """The thesis's law ends at M = mu B H^2 / 6; a short thick finger is nowhere near two turns there."""
    short = dataclasses.replace(pneunet(TYPE_A), L=0.02)
    scene = sg.pneunet.Free(short, weight=None, inclination="none", section="thesis")
    limit = float(sg.limit_pressure(scene))
    largest = brentq(lambda p: ref.end_moment(TYPE_A, p) - 13.6 * 5 / 6, 0.01, 0.2, xtol=1e-15)
    np.testing.assert_allclose(limit, largest * 1e6, rtol=1e-6)
    found = sg.solve(scene, 1.01 * limit)
    assert (int(found.status), int(found.reason)) == (BEYOND, Reason.SECTION_FULL)


@pytest.mark.parametrize(("H", "curls_up", "weight"), [(3.0, True, None), (9.0, False, None), (9.0, False, -1e-4)])
def test_walls_that_lock_before_they_close_have_no_end_of_their_own(H, curls_up, weight):
    """Gent's walls lock where the pressure is infinite. A thin cover curls up, the inner fibre of a thick one locks.
    With a weight, here one of 3e-6 of the moment, the limit of that was NaN."""
    j_m, (places, weights) = 0.4, np.polynomial.legendre.leggauss(16)
    finger = dataclasses.replace(pneunet(TYPE_A), H=H * 1e-3, material=sg.Gent(mu=136e3, j_m=j_m))
    locked = np.exp(-2 * np.arcsinh(0.5 * np.sqrt(j_m)))  # square of the least stretch: I_1 - 3 = s^2 + s^-2 - 2

    def stresses(z, middle):
        square = middle + z * places
        return 0.25 * (1 - square**-2) / (1 - (square + 1 / square - 2) / j_m)

    if curls_up:
        z = 4 * np.pi * H / 77
        middle = np.sqrt(1 + z * z)
    else:
        z = brentq(lambda z: np.dot(weights, stresses(z, z + locked)), 0.6, 0.663, xtol=1e-14)
        middle = z + locked
    moment = np.dot(weights * places, stresses(z, middle)) * finger.moment_scale()
    loads = {"weight": None} if weight is None else {"weight": (0.0, weight), "points": 4}
    limit = sg.limit_pressure(sg.pneunet.Free(finger, inclination="none", **loads))
    np.testing.assert_allclose(
        sg.pneunet.chamber(finger, limit).end_moment, moment, rtol=1e-6 if weight is None else 1e-5
    )


def test_a_way_without_end_has_all_of_its_places():
    zero = jnp.asarray(0.0)
    way = LoadPath(zero, zero, zero + 1, zero + jnp.inf, zero + 1e-3)
    assert way.last() == jnp.inf
    np.testing.assert_allclose(way.pressure_at(way.coordinate_of(jnp.asarray(7.0))[None]), 7.0, rtol=1e-14)
    x, early = Fraction(1e-6), Fraction(1e-3)
    place = float(x * (x + early) / (x + 2))
    np.testing.assert_allclose(way.coordinate_of(jnp.asarray(1e-6)), place, rtol=1e-15)
