"""Published numbers of the flat shell, each with its source, and how far the model is from finite elements."""

import dataclasses

import numpy as np
import pytest
import reference as ref
from helpers import shell
from scipy.optimize import brentq

import softgrip_jax as sg
from softgrip_jax import thesis
from softgrip_jax.model_error import PLANE, model_error, of_material, of_shell
from softgrip_jax.units import GRAVITY, degree, gram, kPa, mm

NEO_175 = {"kind": ref.NEO, "mu": 175e3}
DESIGN = {"a": 16e-3, "b": 43e-3, "t_m": 1.1e-3, "material": NEO_175}


def test_thesis_figures_within_half_a_percent():
    """Figures 5.1, 5.2, 5.3, whose modulus is printed with three digits: see tests/test_reproduce.py."""
    pressure = thesis.FIGURE_PRESSURE
    free = sg.solve(thesis.free_shell(), pressure)
    assert float(free.inflation) == pytest.approx(thesis.FIGURE_5_1.value, rel=5e-3)
    flat = sg.solve(thesis.flat_contact(), pressure)
    assert float(flat.force) == pytest.approx(thesis.FIGURE_5_2.value, rel=5e-3)
    rod = sg.solve(thesis.cylinder_contact(), pressure)
    assert float(rod.force_z) == pytest.approx(thesis.FIGURE_5_3.value, rel=5e-3)


# One required force per weight (g: N) reproduces all rows of table 6.1, with the friction coefficients that they imply:
# mu_f = m g / 2 / F_ext (the thesis took another one for each object, section 6.2.4). Found by an independent solver.
REQUIRED = {137: 0.4491, 263: 0.9944, 563: 2.870}


@pytest.mark.parametrize("row", thesis.TABLE_6_1)
def test_table_6_1(row):
    force = REQUIRED[round(row.mass / gram)]
    grasp = sg.pressure_for(thesis.shell_grasp(row.gap, row.mass, row.mass * GRAVITY / 2 / force))
    assert float(grasp.required_force) == pytest.approx(force, rel=1e-12)
    assert float(grasp.force) == pytest.approx(force, rel=1e-12)
    # The thesis steps the pressure (algorithm 4) and cuts digits: one unit of the last printed digit.
    assert float(grasp.pressure) == pytest.approx(row.pressure.value, abs=row.pressure.digit)
    if row.height.text == "26.4":
        # A misprint, most likely: no pressure near 13.0 kPa gives it, and every other row fits.
        assert float(grasp.height) / mm == pytest.approx(25.5, abs=0.1)
    else:
        assert float(grasp.height) == pytest.approx(row.height.value, abs=row.height.digit)


def test_the_order_of_friction_coefficients():
    """The implied coefficients fall with the force, as measured."""
    implied = [weight * gram * GRAVITY / 2 / force for weight, force in REQUIRED.items()]
    assert implied == sorted(implied, reverse=True)
    assert implied == pytest.approx([1.50, 1.30, 0.96], abs=0.01)


def test_contact_begins_where_appendix_a_says():
    """(A.1)-(A.4): theta_in = 2 atan(gap / a) in the free equations (3.7)."""
    gap = 5e-3
    wanted = ref.free(2 * np.arctan(gap / DESIGN["a"]), DESIGN)[0]
    for scene in (
        sg.shell.CylinderContact(shell(), radius=20 * mm, gap=gap),
        sg.shell.FlatContact(shell(), distance=gap),
    ):
        below, above = sg.path(scene, [wanted * (1 - 1e-9), wanted * (1 + 1e-9)]).status
        assert (sg.Status(int(below)), sg.Status(int(above))) == (sg.Status.NO_CONTACT, sg.Status.OK)
    # Recomputed with an independent solver: 2.31593 kPa.
    assert wanted / kPa == pytest.approx(2.31593, rel=1e-5)
    nothing = sg.solve(sg.shell.FlatContact(shell(), distance=gap), wanted * 0.5)
    assert float(nothing.force) == 0.0


def test_appendix_b_square_membrane():
    """Side 15 mm, 1.1 mm, mu 111 kPa, d 5 mm, 41 kPa: 0.7554 N parallel; inclined by 10 degrees as by (4.18)-(B.3)."""
    square = sg.FlatShell(a=7.5 * mm, b=7.5 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=111 * kPa))
    p = {"a": 7.5e-3, "b": 7.5e-3, "t_m": 1.1e-3, "material": {"kind": ref.NEO, "mu": 111e3}, "distance": 5e-3}
    for angle in (0.0, 10 * degree):
        q = p | {"angle": angle}
        theta = brentq(lambda x, q=q: float(ref.inclined(x, q)[0]) - 41e3, 1.2, 3.1, xtol=1e-15)
        width = float(ref.inclined(theta, q)[1][0])
        rho = q["a"] * angle / float(ref.touch_angle(5 / 7.5, angle))
        force = 41e3 * np.pi / 4 * width**2 * (q["a"] - rho) / q["a"]
        solution = sg.solve(sg.shell.InclinedContact(square, distance=5 * mm, angle=angle), 41 * kPa)
        assert float(solution.force) == pytest.approx(force, rel=1e-9)
        if angle == 0:
            assert force == pytest.approx(0.7554, abs=5e-5)


def test_smallest_object():
    """Thesis 3.4.4: an object of height a or less cannot be held."""
    assert float(sg.shell.smallest_object(shell())) == pytest.approx(16 * mm)


# Finite elements of the same plates (FElupe 11.3, 27-node hexahedra, nearly incompressible neo-Hookean, clamped edges,
# frictionless plane by penalty; uncertainty 0.2 to 0.5 %): what the assumption of circular arcs costs. Users are told.
FE_FREE = {5.0: 7.9015, 10.0: 11.5134, 15.0: 15.7501}  # kPa: mm
FE_FLAT = {5.0: 3.3115, 10.0: 11.2138, 15.0: 20.7274, 20.0: 31.3090}  # kPa: N, plane at 5 mm
FE_LARGEST_PRESSURE = 19.55  # kPa


def test_model_error_of_the_free_shell():
    for pressure, inflation in FE_FREE.items():
        model = float(sg.solve(sg.shell.Free(shell()), pressure * kPa).inflation) / mm
        assert -0.155 < model / inflation - 1 < -0.12
    assert float(sg.limit_pressure(sg.shell.Free(shell()))) / kPa / FE_LARGEST_PRESSURE - 1 == pytest.approx(
        0.032, abs=0.002
    )


def test_model_error_of_flat_contact():
    for pressure, force in FE_FLAT.items():
        model = float(sg.solve(sg.shell.FlatContact(shell(), distance=5 * mm), pressure * kPa).force)
        assert -0.22 < model / force - 1 < -0.10


def test_plate_law_meets_the_finite_element_plate_at_low_pressure():
    """(2.1) with C from `plate_coefficient`, at 2.5 kPa where delta / a = 0.36: 7 % below the finite elements.

    That is the finite strain which the law leaves out (the neo-Hookean sheet softens); the arc model is 15 % below.
    """
    plate = sg.solve(sg.shell.Plate(shell()), 2.5 * kPa)
    assert float(plate.inflation) / mm / 5.794 - 1 == pytest.approx(-0.07, abs=0.01)
    assert np.isinf(float(sg.limit_pressure(sg.shell.Plate(shell()))))


def test_a_model_error_is_told_of_shells_like_that_of_the_finite_elements():
    """Of a small and thick one it was off by 150 %, and "11 to 21 % less" stood beside it."""

    def told(a=16, b=43, t_m=1.1, distance=5, material=None, model="arc"):
        made = sg.FlatShell(a=a * mm, b=b * mm, t_m=t_m * mm, material=material or sg.NeoHookean(mu=175 * kPa))
        return model_error(sg.shell.FlatContact(made, distance=distance * mm, model=model), "force")

    assert told() == PLANE["arc"] + ", 5 to 20 kPa"
    assert told(model="energy") == PLANE["energy"] + ", 5 to 20 kPa"
    assert told(a=32, b=86, t_m=2.2, distance=10) == PLANE["arc"] + ", 5 to 20 kPa"
    assert told(a=18, b=48, t_m=1.2, distance=6).startswith(PLANE["arc"])
    assert told(a=10, b=30, t_m=2.5, distance=2) == ""
    assert told(distance=8).startswith("31 % less to 4 % more than by the energy membrane")
    assert told(distance=8, model="energy") == ""
    assert told(material=sg.Gent(mu=175 * kPa, j_m=1.0)) == ""
    # Twice the modulus at twice the pressure is the same shape.
    assert told(material=sg.NeoHookean(mu=350 * kPa)) == PLANE["arc"] + ", 10 to 40 kPa"


def test_a_stretch_that_a_neo_hookean_law_is_not_trusted_with_is_told():
    """Silicones stiffen, and such a law does not: a search that inflates as far as it can ends there."""
    free = sg.shell.Free(shell())
    near, far = (sg.solve(free, p * kPa) for p in (15, 19))
    assert float(near.stretch) < 1.5 < float(far.stretch)
    assert of_material(near) == {}
    assert of_material(far)["stretch"].startswith("1.74 is more than the 1.5 or so up to which a neo-Hookean law is")
    assert of_material(sg.solve(free, 25 * kPa)) == {}
    stiff = sg.shell.Free(shell("gent"))
    assert of_material(sg.solve(stiff, 19 * kPa)) == {}


FE_CYLINDER = {5.0: 0.9852, 10.0: 4.1097, 15.0: 8.8727}  # kPa: N, radius 20 mm, 5 mm away; `softgrip verify`
FE_LEANING = {10.0: 0.3347, 15.0: 1.9986}  # kPa: N, a = b = 16 mm, 5 mm away, 10 degrees


def test_model_error_on_a_cylinder_and_on_a_plane_that_leans():
    rod = sg.shell.CylinderContact(shell(), radius=20 * mm, gap=5 * mm)
    square = dataclasses.replace(shell(), b=shell().a)
    leaning = sg.shell.InclinedContact(square, distance=5 * mm, angle=np.deg2rad(10))
    for scene, true, low, high in ((rod, FE_CYLINDER, -0.67, -0.31), (leaning, FE_LEANING, -1.0, -0.89)):
        errors = [float(sg.solve(scene, p * kPa).force) / force - 1 for p, force in true.items()]
        assert (round(min(errors), 2), round(max(errors), 2)) == (low, high)
        assert model_error(scene, "force").startswith(f"{-100 * high:.0f} to {-100 * low:.0f} % less than finite")
    assert model_error(rod, "force_z") == model_error(rod, "force")
    assert "required" in model_error(sg.shell.Grasp(shell(), radius=20 * mm, gap=5 * mm, mass=0.5), "pressure")
    assert of_shell(rod, ["stretch"]) == []
    assert of_shell(rod, ["force", "force_z"]) == [f"force, force z: {model_error(rod, 'force')}."]
    held = sg.pneunet.TipContact(sg.PneuNet.table_5_1("A"))
    assert of_shell(held, ["tip_force"]) == []  # both of its drives say it


def test_a_model_error_is_told_of_the_energy_membrane_whose_error_it_is():
    """Without bending the force on the plane was 4.3 % more, and "within 1.2 %" stood beside it."""
    free = sg.shell.Free(shell(), model="energy")
    plane = sg.shell.FlatContact(shell(), distance=5 * mm, model="energy")
    for scene, name in ((free, "inflation"), (free, "limit_pressure"), (plane, "force")):
        assert model_error(scene, name)
        assert model_error(dataclasses.replace(scene, bending=False), name) == ""
    usual = free.prepared()
    assert model_error(usual, "inflation") == model_error(free, "inflation")
    assert model_error(dataclasses.replace(usual, across=2, lengthwise=3), "inflation") == ""
