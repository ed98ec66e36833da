"""Fingers that are pushed by walls of small strain, drive = "small_strain": against beams by SciPy under the same
moment, against the fold that every drive of a held finger shares, and by differences."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import reference_beam as beams
from conftest import ROOT
from fingers import TYPE_A, contact, free, solved

import softgrip_jax as sg
from softgrip_jax import config as configs
from softgrip_jax.errors import InputError
from softgrip_jax.membrane import plate_coefficient
from softgrip_jax.model_error import model_error
from softgrip_jax.pneunet.drives import remarks, with_other_drive
from softgrip_jax.units import GRAVITY, N_mm, kPa, mm

A = sg.PneuNet.table_5_1("A")
FREE, HELD = sg.pneunet.Free, sg.pneunet.TipContact
CONTACT = 0.001055463748074  # MPa, of type A


def exerted(f, p):
    """M_T, N mm, of a dict at a pressure in MPa beyond the step at contact, from (2.1), (4.5) and (4.39)."""
    stiffness = float(plate_coefficient(jnp.asarray(f["a"] / f["b"]))) * 3 * f["mu"] * f["t_m"] / f["a"] ** 4
    delta = np.cbrt(p / stiffness)
    force = 3 * np.pi * f["a"] ** 2 * delta * p / (4 * (delta + f["h_x"]))
    return force * (f["H"] / 2 + f["a"]) * np.sqrt(2 * f["h_x"] / (2 * f["h_x"] + f["h_L"]))


def pushed(scene):
    return dataclasses.replace(scene, drive="small_strain")


@pytest.mark.slow
def test_held_fingers_are_those_of_scipy():
    loads = [{}, {"weight": (0.0, -0.002), "offset": -5.0}, {"pull": 0.1}]
    pressures = [0.002, 0.015, 0.031]
    scenes = [pushed(contact(TYPE_A, "exact", **load)) for load in loads for _ in pressures]
    found = solved(scenes, pressures * len(loads))
    assert np.all(found["status"] == sg.Status.OK)
    k = 0
    for load in loads:
        for p in pressures:
            moment = exerted(TYPE_A, p)
            _, force, end = beams.held_tip(TYPE_A, "exact", [(TYPE_A["L"], moment)], **load)
            np.testing.assert_allclose(found["tip_force"][k], force, rtol=1e-8)
            np.testing.assert_allclose(found["tip_angle"][k], -end[0], rtol=1e-8, atol=1e-10)
            np.testing.assert_allclose(found["end_moment"][k], moment, rtol=1e-12)
            k += 1


def test_free_fingers_are_those_of_scipy():
    scenes = [pushed(free(TYPE_A, "exact", weight=(0.0, -0.002))) for _ in range(2)]
    found = solved(scenes, [0.0005, 0.02])
    for k, moment in enumerate([0.0, exerted(TYPE_A, 0.02)]):
        end = beams.cantilever(TYPE_A, "exact", [(TYPE_A["L"], moment)], weight=(0.0, -0.002))[-1]
        np.testing.assert_allclose(found["tip_angle"][k], -end[0], rtol=1e-8)
        np.testing.assert_allclose(found["tip"][k], end[2:], rtol=1e-8)


@pytest.mark.slow
def test_segments_touch_one_after_the_other():
    """Gaps of 0.9 and 0.6 mm: at 0.5 kPa the second segment pushes alone."""
    gaps = np.array([0.9, 0.6])
    finger = dataclasses.replace(A, h_x=jnp.asarray(gaps) * mm)
    lengths = TYPE_A["L"] * (2 * gaps + 4.2) / np.sum(2 * gaps + 4.2)
    scene = HELD(finger, drive="small_strain", points=32)
    assert sg.contact_pressure(scene) == pytest.approx(CONTACT * 1e6 * (0.6 / 0.9) ** 3, rel=1e-9)
    for p in (0.0005, 0.015):
        moments = [exerted(TYPE_A | {"h_x": h}, p) for h in gaps]
        moments[0] *= p > CONTACT
        _, force, _ = beams.held_tip(TYPE_A, "exact", list(zip(lengths, moments, strict=True)))
        assert sg.solve(scene, p * 1e6).tip_force == pytest.approx(force, rel=1e-7)


def test_at_contact_the_moment_comes_up_on_a_short_way():
    walls = sg.pneunet.SmallStrainWalls()
    begin = walls.contact_pressure(A)
    assert begin == pytest.approx(CONTACT * 1e6, rel=1e-12)
    assert begin == pytest.approx(float(sg.contact_pressure(sg.pneunet.SmallStrainChamber(A))), rel=1e-12)
    shares = [0.0, 0.25, 0.5, 1.0]
    for share, part in zip(shares, [0.0, 0.103515625, 0.5, 1.0], strict=True):
        pressure = begin * (1 + 0.02 * share)
        expected = part * exerted(TYPE_A, float(pressure) / 1e6) * N_mm
        np.testing.assert_allclose(walls.end_moment(A, pressure, 0.0), expected, rtol=1e-9, atol=1e-20)
    pressed = sg.pressure_for(HELD(A, drive="small_strain"), tip_force=0.0010)  # in the middle of the step
    assert pressed.status == sg.Status.OK
    assert 1 < pressed.pressure / begin < 1.02
    assert pressed.tip_force == pytest.approx(0.0010, rel=1e-9)


def test_a_gapless_finger_pushes_from_the_first_pressure_on():
    gapless = dataclasses.replace(A, h_x=jnp.asarray(1e-9))
    walls = sg.pneunet.SmallStrainWalls()
    assert walls.contact_pressure(dataclasses.replace(A, h_x=0 * mm)) == 0
    np.testing.assert_allclose(
        walls.end_moment(gapless, 5 * kPa, 0.0), exerted(TYPE_A | {"h_x": 1e-6}, 0.005) * N_mm, rtol=1e-9
    )


@pytest.mark.slow
def test_the_fold_is_at_the_same_moment_as_by_the_thesis():
    """A held finger folds where the moment on its cover is too large, whatever makes that moment."""
    moments = []
    for drive in ("small_strain", "thesis"):
        scene = HELD(A, drive=drive)
        limit = sg.limit_pressure(scene)
        assert sg.solve(scene, 1.001 * limit).status == sg.Status.BEYOND_LIMIT
        chamber = sg.pneunet.SmallStrainChamber(A) if drive == "small_strain" else sg.pneunet.Chamber(A, 0.0)
        moments.append(sg.solve(chamber, limit).end_moment)
    assert moments[0] == pytest.approx(float(moments[1]), rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("pressure", [15 * kPa, 1.01 * CONTACT * 1e6], ids=["beyond", "in the step"])
def test_derivatives(pressure):
    def force(x):
        finger = dataclasses.replace(A, h_x=A.h_x * x[0], t_m=A.t_m * x[1], H=A.H * x[2])
        return sg.solve(HELD(finger, drive="small_strain", points=8), pressure * x[3]).tip_force

    one, step = jnp.ones(4), 1e-5
    value = jax.jit(force)
    reverse, forward, second = (jax.jit(f(force))(one) for f in (jax.grad, jax.jacfwd, jax.hessian))
    moves = step * np.eye(4)
    differences = np.array([(value(one + move) - value(one - move)) / (2 * step) for move in moves])
    slope = jax.jit(jax.grad(force))
    bends = np.array([(slope(one + move) - slope(one - move)) / (2 * step) for move in moves])
    np.testing.assert_allclose(reverse, forward, rtol=1e-9)
    np.testing.assert_allclose(reverse, differences, rtol=2e-5)
    np.testing.assert_allclose(second, bends, rtol=2e-4, atol=1e-4 * np.abs(bends).max())


def test_inclination_has_no_part_in_it_and_the_root_has():
    scene = FREE(A, weight=None, drive="small_strain")
    turn = sg.solve(scene, 15 * kPa).tip_angle
    flat = dataclasses.replace(scene, inclination="none")
    assert sg.solve(flat, 15 * kPa).tip_angle == pytest.approx(float(turn), rel=1e-12)
    whole = sg.solve(dataclasses.replace(scene, moment_spread="none"), 15 * kPa)
    assert whole.end_moment / sg.solve(scene, 15 * kPa).end_moment == pytest.approx(np.sqrt(6 / 1.8), rel=1e-12)


@pytest.mark.slow
def test_other_methods_find_the_same_finger():
    usual = sg.solve(HELD(A, drive="small_strain"), 20 * kPa).tip_force
    shot = sg.solve(HELD(A, drive="small_strain", beam=sg.pneunet.Shooting()), 20 * kPa)
    together = sg.solve(HELD(A, drive="small_strain", loading="proportional"), 20 * kPa)
    assert shot.tip_force == pytest.approx(float(usual), rel=1e-7)
    assert together.tip_force == pytest.approx(float(usual), rel=1e-9)


@pytest.mark.slow
def test_a_gripper_from_a_config(tmp_path):
    """Each finger is a held one that carries its third of the object."""
    text = (ROOT / "configs" / "finger_grasp.toml").read_text(encoding="utf-8")
    path = tmp_path / "grasp.toml"
    path.write_text(
        text.replace('section = "exact" ', 'drive = "small_strain" ').replace('"face" ', '"midline" '), encoding="utf-8"
    )
    scene = configs.load(path).scenes["scene"]
    assert scene.drive == "small_strain"
    held = sg.solve(scene, 28 * kPa)
    assert held.status == sg.Status.OK
    alone = HELD(A, drive="small_strain", weight=(2.0, 0.0), tip_offset=held.tip[1], tip_pull=26e-3 * GRAVITY / 3)
    alone = sg.solve(alone, 28 * kPa)
    assert held.tip_force == pytest.approx(float(alone.tip_force), rel=1e-9)
    assert held.tip[0] == pytest.approx(float(alone.tip[0]), rel=1e-9)


def test_the_cell_law_stands_beside_it():
    scene = HELD(A, drive="small_strain")
    assert with_other_drive(scene).drive == "cell"
    assert "small_strain" in remarks(scene)[0]
    assert "drive = 'cell'" in model_error(scene, "tip_force")
    with pytest.raises(InputError, match="small_strain"):
        HELD(A, drive="small")


def test_what_is_told_of_a_drive_is_about_that_drive():
    """Chambers without the root of (4.39), and those of a user, were said to give a quarter, too."""
    for name in ("end_moment", "tip_force"):
        assert "half" in model_error(HELD(A, moment_spread="none"), name)
        assert model_error(HELD(A, drive=sg.pneunet.SmallStrainWalls()), name) == ""


def test_walls_are_drawn_as_plates():
    from softgrip_jax.geometry import finger as drawn

    solution = sg.solve(HELD(A, drive="small_strain"), 0.9 * CONTACT * 1e6)
    chambers = drawn.chambers_of(solution, drawn.line_of(solution))
    widest = chambers[3].near_tip[:, 0].max() - chambers[3].near_tip[0, 0]  # mm, from the wall's foot
    assert widest == pytest.approx(0.9 * np.cbrt(0.9), rel=1e-3)
