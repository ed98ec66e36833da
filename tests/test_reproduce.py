"""The comparison with the thesis: verdicts, the claims behind the reasons, and what is written."""

import csv
import dataclasses
import json

import numpy as np
import pytest
from rich.console import Console
from scipy.integrate import quad

import softgrip_jax as sg
from softgrip_jax import thesis
from softgrip_jax.commands import reproduce
from softgrip_jax.pneunet.drives import with_other_drive
from softgrip_jax.thesis import cell, cell_rows, finger_rows, fingers, rows, shells
from softgrip_jax.thesis.rows import Verdict
from softgrip_jax.units import GRAVITY, gram, kPa, mm


@pytest.fixture(scope="module")
def found():
    return shells.compute()


def test_a_printed_number_knows_its_last_digit():
    printed = thesis.Printed("13.0", "pressure")
    assert (printed.value, printed.digit, str(printed)) == (13000.0, 100.0, "13.0 kPa")
    assert thesis.Printed("28", "pressure").digit == 1000.0


@pytest.mark.parametrize(
    ("ours", "explained", "verdict"),
    [
        (13.1, False, Verdict.REPRODUCED),
        (12.9, False, Verdict.REPRODUCED),
        (13.11, False, Verdict.DIFFERS),
        (13.11, True, Verdict.EXPLAINED),
        (np.nan, False, Verdict.DIFFERS),
    ],
)
def test_verdicts(ours, explained, verdict):
    row = rows.number("table", "p", thesis.Printed("13.0", "pressure"), ours * kPa, "because", explained)
    assert row.verdict is verdict
    assert (row.reason == "") == (verdict is Verdict.REPRODUCED)


def test_every_number_of_the_shell_is_accounted_for(found):
    compared = shells.rows(found)
    counts = reproduce.counts(compared)
    assert counts[Verdict.DIFFERS] == 0
    # 3 figures, 12 numbers of table 6.1, 16 of table 6.2, 7 errors from experiment, 2 moduli and a time; 7 trends.
    assert len(compared) == 3 + 12 + 16 + 7 + 2 + 1 + 7
    for row in compared:
        assert row.verdict is Verdict.REPRODUCED or row.reason


def test_one_modulus_gives_the_three_figures(found):
    """mu is printed as 175 kPa; a number that rounds to it gives all digits of figures 5.1 to 5.3."""
    moduli = shells.common_moduli(found)
    assert np.all(np.abs(moduli / kPa - 175) < 0.5)
    mu, p = moduli[0], thesis.FIGURE_PRESSURE
    assert f"{float(sg.solve(thesis.free_shell(mu), p).inflation) / mm:.2f}" == thesis.FIGURE_5_1.text
    assert f"{float(sg.solve(thesis.flat_contact(mu), p).force):.2f}" == thesis.FIGURE_5_2.text
    assert f"{float(sg.solve(thesis.cylinder_contact(mu), p).force_z):.2f}" == thesis.FIGURE_5_3.text


def test_friction_of_table_6_2_by_quadrature(found):
    """mu_f that (3.41) with (3.40) needs, integrated by SciPy; and the power law of the traction."""
    implied, state = shells.tilt(found), found.cylinder["tilt"]
    for k, row in enumerate(thesis.TABLE_6_2):
        c_a, c_b = float(state.contact_half_width[k]), float(state.contact_half_length[k])
        if row.eccentricity == 0:
            assert implied.rim[k] == pytest.approx(row.mass * GRAVITY / 2 / float(state.force[k]))
            continue

        def moment(y, c_a=c_a, c_b=c_b):
            x2 = c_a**2 * (1 - y**2 / c_b**2)
            return np.sqrt(x2 + y**2) * np.sqrt(x2)

        per_friction = 4 * row.pressure.value * quad(moment, 0, c_b, epsabs=0)[0]
        assert implied.rim[k] == pytest.approx(row.mass * GRAVITY * row.eccentricity / per_friction, rel=1e-6)
    np.testing.assert_allclose(implied.law(implied.force), implied.traction, rtol=0.011)
    # The answer: one law for the traction, none for the pressures.
    assert np.ptp(implied.rim[1:4]) < 0.02 * implied.rim[1]
    assert implied.force[3] > implied.force[5]
    assert implied.rim[3] > 1.2 * implied.rim[5]
    assert "no law of the normal force explains both" in shells.tilt_text(found)


def test_rising_sees_a_fall_and_skips_what_has_no_state():
    assert shells.rising([1.0, np.nan, 2.0])
    assert not shells.rising([1.0, 2.0, 1.5])
    assert not shells.rising([1.0, 1.0])


def test_overshoots_are_more_than_nothing_and_two_steps_at_most():
    printed = 28 * kPa
    assert list(finger_rows.overshoots(printed, np.array([25.9, 26.0, 27.9, 28.0]) * kPa)) == [False, True, True, False]


@pytest.mark.slow
def test_a_finger_of_equal_segments_is_the_uniform_one():
    """What lets uniform and nonuniform fingers share a program; without weight, where both are arcs."""

    def light(scene):
        return dataclasses.replace(scene, weight=None)

    uniform = sg.solve(light(thesis.free_finger("A")), 31 * kPa)
    arrays = sg.solve(light(fingers.free("A")), 31 * kPa)
    np.testing.assert_allclose(arrays.tip, uniform.tip, rtol=1e-10)


def test_scenes_of_tapering_objects_need_more_force():
    """Section 5.2.3: F_ext >= H_ext / (mu_f sin^2 beta)."""
    wide, high = thesis.CONES["circular cone"]
    scene = thesis.finger_grasp("A", 20 * gram, 18 * mm, 1 + (wide / high) ** 2)
    sine = np.sin(np.arctan(high / wide))
    needed = 0.020 * GRAVITY / 3 / (thesis.FRICTION * sine**2)
    observed = scene.pull() / scene.object.friction
    np.testing.assert_allclose(observed, needed, rtol=1e-12)


def test_files_and_count(found, tmp_path, capsys):
    compared = shells.rows(found)
    text = reproduce.page(compared, [("a", "A picture.")], shells.tilt_text(found))
    assert reproduce.count_text(compared) in text
    assert text.count("\n| ") == len(compared) + 1
    table = list(csv.DictReader(reproduce.table_of(compared).splitlines()))
    assert [row["printed"] for row in table] == [row.printed for row in compared]
    reproduce.report(compared, Console(width=200))
    assert reproduce.count_text(compared) in " ".join(capsys.readouterr().out.split())


def test_what_is_done_is_told_when_it_is_stopped(found, tmp_path, monkeypatch, capsys):
    def stop(tell):
        raise KeyboardInterrupt

    monkeypatch.setattr(shells, "compute", lambda: found)
    monkeypatch.setattr(fingers, "compute", stop)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(KeyboardInterrupt):
        reproduce.run_reproduce(tmp_path / "out", Console(), as_json=True)
    assert len(json.loads(capsys.readouterr().out)) == len(shells.rows(found))
    assert "The run was stopped" in (tmp_path / "out" / "reproduction.md").read_text()
    assert len((tmp_path / "out" / "reproduction.csv").read_text().splitlines()) == 1 + len(shells.rows(found))


@pytest.fixture(scope="module")
def held_by_cell():
    """Type A with its tip held, by the cell law: its curve, and a state beyond its end."""
    return cell.curve(with_other_drive(thesis.blocked_finger("A")))


def test_tip_forces_by_the_cell_law_are_those_of_finite_elements(held_by_cell):
    """A beam with the law of the finite elements at every section, without weight (docs/theory/cell.md)."""
    for pressure, force in ((5, 0.028), (15, 0.148), (25, 0.340), (31, 0.573)):
        assert held_by_cell[0].tip_force[cell.place(pressure * kPa)] == pytest.approx(force, rel=0.06)


def test_a_curve_by_the_cell_law_ends_where_its_limit_point_is(held_by_cell):
    curve, end = held_by_cell
    last = cell.last_pressure(end)
    assert cell.has_limit_point(end)
    assert 31 * kPa < last < 32 * kPa
    assert list(curve.status == sg.Status.OK) == list(last > cell.PRESSURES)
    np.testing.assert_allclose(curve.pressure, cell.PRESSURES)
    assert set(curve.reason_text()) == {"solved", end.reason_text()[0]}


@pytest.mark.slow
def test_a_grasp_by_the_cell_law_is_a_held_tip_that_carries_its_load():
    """Table 6.3: at the pressure of the row the tips of a finger alone, pulled by a third of the weight, press as hard
    as friction needs."""
    mass = thesis.MASSES["circular cylinder"]
    grasp = with_other_drive(thesis.finger_grasp("A", mass, 18 * mm))
    assert isinstance(grasp, sg.pneunet.Grasp)
    assert grasp.drive == "cell"
    pressure = float(sg.pressure_for(grasp).pressure)
    assert pressure == pytest.approx(11.14 * kPa, rel=2e-3)
    pull = mass * GRAVITY / 3
    alone = sg.pneunet.TipContact(
        thesis.finger("A"),
        tip_offset=thesis.CYLINDER_OFFSET,
        tip_pull=pull,
        weight=thesis.printed.HANGING,
        drive="cell",
    )
    assert sg.solve(alone, pressure).tip_force == pytest.approx(pull / thesis.FRICTION, rel=1e-6)


def test_the_cell_law_stands_beside_the_rows(found, capsys):
    """On the page, in the CSV and in the report; rows of shells have nothing."""
    printed = thesis.FIGURE_5_6
    row = rows.number("figure 5.6", "tip force of type A, 31 kPa", printed, 0.128)
    row = row._replace(cell="0.599 N", ratio="4.67", cell_remark="just below the last pressure")
    compared = [*shells.rows(found), row]
    section = reproduce.page(compared, [], "", "Two laws.").partition("## The same fingers by the cell law")[2]
    section = section.partition("## Pictures")[0]
    assert section.count("\n| ") == 2
    assert "| 0.12 N | 0.128 N | 0.599 N | 4.67 | just below the last pressure |" in section
    assert "Two laws." in section
    table = list(csv.DictReader(reproduce.table_of(compared).splitlines()))
    assert [line["cell"] for line in table] == [""] * (len(compared) - 1) + ["0.599 N"]
    reproduce.report(compared, Console(width=200))
    assert "by the thesis's chambers" in capsys.readouterr().out
    assert "cell law" not in reproduce.page(shells.rows(found), [], "")


def test_a_dimension_beyond_the_fit_is_said_on_the_page():
    none: dict[str, list[str]] = {kind: [] for kind in thesis.KINDS}
    known = cell.ByCell({}, {}, {}, {}, {}, {}, none)
    assert "All four types" in cell_rows.text(known)
    beyond = known._replace(outside=none | {"B": ["a = 9 mm (checked: 4.2 to 7.2 mm)"]})
    assert "type B: a = 9 mm (checked: 4.2 to 7.2 mm)" in cell_rows.text(beyond)
    assert cell.outside(fingers.nonuniform().finger)


def test_a_stop_during_the_cell_law_keeps_the_rows_of_the_thesis(found, tmp_path, monkeypatch, capsys):
    def stop(*_):
        raise KeyboardInterrupt

    row = rows.number("figure 5.6", "tip force of type A, 31 kPa", thesis.FIGURE_5_6, 0.128)
    monkeypatch.setattr(shells, "compute", lambda: found)
    monkeypatch.setattr(fingers, "compute", lambda tell: None)
    monkeypatch.setattr(finger_rows, "rows", lambda found: [row])
    monkeypatch.setattr(cell, "compute", stop)
    with pytest.raises(KeyboardInterrupt):
        reproduce.run_reproduce(tmp_path / "out", Console(), as_json=True)
    told = json.loads(capsys.readouterr().out)
    assert told[-1]["quantity"] == row.quantity
    assert told[-1]["cell"] == ""
    page = (tmp_path / "out" / "reproduction.md").read_text()
    assert "The run was stopped" in page
    assert reproduce.CELL_TITLE not in page


def test_our_nonuniform_finger_can_be_made():
    """Its walls were thicker than its shortest chambers are long: a rule that came later left it without an answer."""
    margins = fingers.nonuniform().margins_at_rest()
    assert all(float(margin) >= 0 for margin in margins.values())
    assert {"walls_fit", "mould_range"} <= set(margins)


@pytest.mark.slow
def test_every_number_of_the_finger_is_accounted_for():
    found = fingers.compute()
    compared = finger_rows.rows(found)
    differing = {row.quantity for row in compared if row.verdict is Verdict.DIFFERS}
    assert not differing
    for name in fingers.RADII:  # where the tips may touch does not end where we stopped to look
        ends, scanned = finger_rows.touching_radii(found, name)[[0, -1]], fingers.RADII[name]
        assert scanned[0] < ends[0]
        assert ends[-1] < scanned[-1]
    by_name = {row.quantity: row for row in compared}
    assert by_name["tip force of type A, 31 kPa"].verdict is Verdict.REPRODUCED
    assert np.isfinite(float(by_name["pressure, hexagonal cylinder of 35 g, type A"].ours.split()[0]))
    # The cell law: 4 figures and forces, 16 grasps, 6 reaches, 2 of section 5.2.3 and 7 trends.
    beside = reproduce.beside(cell_rows.beside(compared, found, cell.compute(found)))
    assert len(beside) == 4 + 16 + 6 + 2 + 7
    assert all(row.cell_remark for row in beside if row.cell == "-")
    grasps = [row for row in beside if row.source == "table 6.3"]
    assert all(0.39 < float(row.ratio) < 0.5 for row in grasps)
    by_name = {row.quantity: row for row in beside}
    assert float(by_name["tip force of type A, 31 kPa"].ratio) == pytest.approx(0.599 / 0.1285, rel=0.01)
    assert "limit point" in by_name["type A, tip held, is predicted up to"].cell_remark
    assert "holds for A and B" in next(row for row in beside if row.source == "figure 6.21").cell_remark
