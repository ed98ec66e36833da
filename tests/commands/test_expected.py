"""What the sheet for the bench expects of a design: by both laws of a finger, and up to where its rules hold."""

from collections import Counter
from types import SimpleNamespace

import numpy as np
import pytest

import softgrip_jax as sg
from softgrip_jax import config as configs
from softgrip_jax.cli import run
from softgrip_jax.commands.expected import Asked, _end, as_data, ends_of_rules, expectations
from softgrip_jax.pneunet.drives import remarks, with_other_drive
from softgrip_jax.reasons import Reason
from softgrip_jax.results import in_units
from softgrip_jax.units import kPa

HELD = """
[scene]
type = "pneunet.TipContact"
inclination = "segment"
[scene.finger]
a_mm = 7
b_mm = 8
h_x_mm = 1.08
t_m_mm = 0.9
h_L_mm = 4.2
H_mm = 5.12
B_mm = 20
L_mm = 60
material = { type = "NeoHookean", mu_kPa = 136 }
[solve]
pressure_kPa = 31
"""
FREE = """
[scene]
type = "pneunet.Free"
weight_N_per_m = [0, 0]
inclination = "none"
[scene.finger]
preset = "table_5_1_A"
H_mm = 3
[solve]
pressure_kPa = 15
"""


@pytest.fixture(scope="module")
def held(tmp_path_factory):
    path = tmp_path_factory.mktemp("held") / "held.toml"
    path.write_text(HELD)
    return configs.load(path)


@pytest.fixture(scope="module")
def expected(held):
    return expectations(held)


@pytest.mark.filterwarnings("ignore::softgrip_jax.errors.CellRangeWarning")
def test_both_laws_of_a_finger_stand_side_by_side(held, expected):
    """One law alone went to the bench, of a state that the other law does not have."""
    assert expected.header == ("quantity", 'by "thesis"', 'by "cell"')
    rows = {name: values for name, *values in expected.rows}
    scenes = held.scene, with_other_drive(held.scene)
    states = [sg.solve(scene, 31 * kPa) for scene in scenes]
    assert [int(state.status) for state in states] == [sg.Status.OK, sg.Status.BEYOND_LIMIT]
    assert rows["tip force"] == [in_units(states[0].tip_force, "force"), "-"]
    assert rows["status"] == ["OK", f"BEYOND_LIMIT: {states[1].reason_text()}"]
    assert rows["limit pressure"] == [in_units(sg.limit_pressure(scene), "pressure") for scene in scenes]
    assert expected.sentences[-2:] == remarks(held.scene)
    assert "h_x = 1.08 mm" in expected.sentences[-1]
    told = as_data(expected)
    assert told["expected"]["tip force"] == rows["tip force"][0]
    assert told["expected_by"]["cell"].keys() == {"status", "pressure", "limit pressure", "rules hold up to"}
    assert told["remarks"] == list(expected.sentences)


def test_the_pressure_up_to_which_rules_hold_is_told(held, expected):
    """Chambers overlap at little more than half of the limit pressure, which stood there alone."""
    rows = {name: values for name, *values in expected.rows}
    most = float(rows["rules hold up to"][0].removesuffix(" kPa")) * kPa
    assert rows["rules hold up to"][1] == "the limit pressure"
    below, above = (sg.solve(held.scene, factor * most) for factor in (0.9999, 1.0001))
    assert int(below.status) == sg.Status.OK
    assert int(above.reason) == Reason.CHAMBERS_APART
    assert most < 0.6 * float(sg.limit_pressure(held.scene))
    sentence = f'By "thesis", the rules of the scene hold only up to {rows["rules hold up to"][0]}; beyond it '
    assert expected.sentences[0] == f"{sentence}{Reason.CHAMBERS_APART.text()}."


def test_where_a_finger_begins_to_lie_on_itself_is_told(tmp_path):
    """The pressure at which a free finger has turned by 360 degrees, sought by itself."""
    path = tmp_path / "free.toml"
    path.write_text(FREE)
    read = configs.load(path)
    wanted = float(sg.pressure_for(read.scene, tip_angle=2 * np.pi).pressure)
    forbidding, ranges, known = ends_of_rules(Asked(read.scene, read), 25 * kPa)
    assert (forbidding, known) == (None, 25 * kPa)
    assert [end.rule for end in ranges] == [Reason.ONE_TURN]
    assert ranges[0].pressure == pytest.approx(wanted, rel=1e-4)
    assert ends_of_rules(Asked(read.scene, read), 0.9 * wanted) == (None, [], 0.9 * wanted)


def test_an_ignored_rule_is_told_all_the_same(tmp_path, held):
    path = tmp_path / "held.toml"
    path.write_text(HELD.replace("[scene.finger]", 'ignored_rules = ["chambers_apart"]\n[scene.finger]'))
    read = configs.load(path)
    most = 40 * kPa
    assert int(sg.solve(read.scene, most).status) == sg.Status.OK
    assert ends_of_rules(Asked(read.scene, read), most) == ends_of_rules(Asked(held.scene, held), most)


class Answers(Asked):
    """A scene whose margin is known at some pressures alone."""

    def __init__(self, scene, margin):
        self.scene, self.margin = scene, margin

    def at(self, pressure):
        return SimpleNamespace(margins={"clear_of_object": np.float64(self.margin(pressure))})


@pytest.mark.parametrize(
    ("margin", "first", "known"),
    [
        (lambda p: 1.0 if p > 4 else np.nan, None, 10.0),
        (lambda p: 1.0 if p < 6.1 else np.nan, None, 6.0),
        (lambda p: np.nan, None, 0.0),
        (lambda p: -1.0 if p > 4 else np.nan, 0.0, 10.0),  # in no state kept
        (lambda p: 7.3 - p if p > 4 else np.nan, 7.3, 10.0),
    ],
)
def test_where_there_is_no_state_nothing_is_said_of_its_rules(held, monkeypatch, margin, first, known):
    """Before a tip presses, a grasp has no state: it counted as one that keeps its rules."""
    monkeypatch.setattr("softgrip_jax.commands.expected.LOOKED_AT", 10)
    found = ends_of_rules(Answers(held.scene, margin), 10.0)
    assert found[1:] == ([], known)
    assert (found[0] is None) == (first is None)
    if found[0] is not None:
        assert found[0].pressure == pytest.approx(first, abs=1e-2)


@pytest.mark.parametrize(
    ("breaks", "expected"),
    [
        (lambda p: p > 3.3, 3.3),
        (lambda p: p < 2.5, None),  # kept from there on
        (lambda p: p < 2.5 or p > 7.7, 7.7),
        (lambda p: p < 2.5 or 4.4 < p < 5.4, 4.4),
        (lambda p: True, 0.0),
        (lambda p: False, None),
    ],
)
def test_the_end_is_the_first_behind_a_state_that_keeps_the_rules(breaks, expected):
    asked = Counter()

    def at(pressure):
        asked[pressure] += 1
        return pressure

    pressures = np.arange(1.0, 11.0)
    found = _end(pressures, list(pressures), lambda p: [(-1.0, "walls_fit")] if breaks(p) else [], at)
    assert (found is None) == (expected is None)
    if found is not None:
        assert found.pressure == pytest.approx(expected, abs=1e-3)
        assert found.rule == Reason.WALLS_FIT
    assert max(asked.values(), default=1) == 1


def test_the_command_writes_both_laws_to_the_sheet(tmp_path, monkeypatch, held, expected):
    pytest.importorskip("build123d", reason="the extra cad is not installed")
    monkeypatch.setattr("softgrip_jax.commands.export.expectations", lambda read: expected)
    monkeypatch.setattr("softgrip_jax.commands.export.draw_all", lambda *_: [])
    out = tmp_path / "held"
    assert run(["export", str(held.path), "--stl", "--out", str(out)]) == 0
    page = (out / "sheet.html").read_text()
    for words in ("by &quot;cell&quot;", "24.", "rules hold up to", "The cell law was not fitted to such a finger"):
        assert words in page
