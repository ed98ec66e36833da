"""The explorer without a browser: what moves, what is answered, what is told, and that nothing queues."""

import argparse
import asyncio
import dataclasses
import re
import threading
import time
import urllib.error
import urllib.request
from contextlib import contextmanager

import numpy as np
import pytest

import softgrip_jax as sg
from softgrip_jax import config as configs
from softgrip_jax.errors import CellRangeWarning, ConfigError, InputError
from softgrip_jax.explorer import answers, models
from softgrip_jax.explorer.controls import numbers_of
from softgrip_jax.explorer.latest import Latest
from softgrip_jax.explorer.session import PRESSURE, Session, answer, session_of_config
from softgrip_jax.fidelity import LadderModel
from softgrip_jax.units import kPa, mm

pytest.importorskip("panel", reason="Panel is missing: pip install softgrip_jax[explore]")
from tornado.web import Application, RequestHandler

from softgrip_jax.explorer.front import Front
from softgrip_jax.explorer.looks import CurveView


def free():
    return sg.shell.Free(plane().shell)


def plane():
    shell = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
    return sg.shell.FlatContact(shell, distance=5 * mm)


def answered(session):
    question = session.question()
    for stage in answer(question):
        session.take(question, stage)
    return session


@pytest.fixture(scope="module")
def first():
    return answered(Session(plane(), 15 * kPa))


def test_the_state_is_that_of_solve(first):
    force = sg.solve(plane(), 15 * kPa).force
    assert float(first.good.solution.force) == pytest.approx(float(force), rel=1e-12)
    assert len(first.good.sections) == 2


def test_the_curve_begins_at_contact_and_goes_through_the_limit(first):
    assert first.curve.contact == pytest.approx(float(sg.contact_pressure(plane())), rel=1e-9)
    assert first.curve.limit == pytest.approx(float(sg.limit_pressure(plane())), rel=1e-9)
    inside = first.curve.stable
    k = int(np.count_nonzero(inside)) // 2
    found = sg.solve(plane(), first.curve.pressure[k]).force
    assert first.curve.value[k] == pytest.approx(float(found), rel=1e-6)


def test_a_curve_does_not_move_what_a_hand_holds():
    """The curve gives the pressure another range. A slider that is under way has the old one: the next place on it is
    a step further, and not that part of the new range."""
    session = Session(plane(), 15 * kPa)
    shown = session.numbers[PRESSURE]
    answered(session)
    assert session.numbers[PRESSURE].high != shown.high
    assert session.move(PRESSURE, 0.24, shown) == ""
    assert session.values[PRESSURE] == pytest.approx(0.24 * shown.high)
    assert session.move(PRESSURE, 0.24) == ""
    assert session.values[PRESSURE] == pytest.approx(0.24 * session.numbers[PRESSURE].high)


@pytest.mark.filterwarnings("ignore:Widget.name")
def test_a_key_that_was_under_way_means_what_the_hand_saw():
    """The curve sets another range; then the browser tells a place that a hand set on the range before. That value is
    asked for, and the slider goes to its place on the range of now. The same once more, back at the first places."""
    from softgrip_jax.explorer.page import STEPS, Control

    number = Session(plane(), 15 * kPa).numbers[PRESSURE]
    heard, told = [], []
    control = Control(number, 15 * kPa, lambda *said: heard.append(said[1:]), told.append, lambda act: act())
    slider, before = control.slider, number
    for high in (40 * kPa, 70 * kPa, 55 * kPa):
        seen = slider.start
        now = dataclasses.replace(number, low=0.0, high=high)
        control.show(now, 20 * kPa)
        assert not heard
        assert slider.end - slider.start == STEPS
        assert slider.start != seen
        assert slider.value == pytest.approx(slider.start + 20 * kPa / high * STEPS, abs=0.5)
        slider.value = seen + 250  # as Bokeh has it where the browser tells
        slider.value = slider.start + 250
        assert heard == [(0.25, before, False), (0.25, now, True)]
        control.show(now, before.at(0.25))
        assert slider.value == pytest.approx(slider.start + before.at(0.25) / high * STEPS, abs=0.5)
        heard.clear()
        before = now
    control.show(before, 10 * kPa)
    assert slider.value == pytest.approx(slider.start + 10 / 55 * STEPS, abs=0.5)
    assert not heard
    assert not told


@pytest.mark.filterwarnings("ignore:Widget.name")
def test_what_the_page_sets_itself_is_no_hand():
    """Within one message Bokeh tells of a change only when the message is done, whoever made it: a point that the page
    placed was taken for one that was dragged, and the task of the config ended by itself."""
    from bokeh.document import Document

    from softgrip_jax.explorer.page import Control

    number = Session(plane(), 15 * kPa).numbers[PRESSURE]
    heard = []
    control = Control(number, 15 * kPa, lambda *said: heard.append(said[1]), lambda *said: None, lambda act: act())
    view = CurveView(heard.append)
    document = Document()
    document.add_root(view.figure)
    document.add_root(control.slider)
    document.hold("combine")
    view.show_state(12.3456789 * kPa, 3.0, "force")
    control.show(number, 20 * kPa)
    control.show(dataclasses.replace(number, high=50 * kPa), 21 * kPa)
    document.unhold()
    assert heard == []
    view.now.data = {"x": [14.0], "y": [3.0]}  # a hand's, and then back to where the page had put it
    view.now.data = {"x": [12.3456789], "y": [3.0]}
    assert heard == [14 * kPa, pytest.approx(12.3456789 * kPa)]
    place = control.slider.value
    control.slider.value = place + 10
    control.slider.value = place
    assert heard[2:] == [pytest.approx(0.43), pytest.approx(0.42)]


def test_every_material_is_chosen_as_stiff_as_the_one_before():
    session = Session(plane(), 15 * kPa)
    choice = session.choices["shell.material.type"]
    own = ("MooneyRivlin", "Yeoh", "Gent", "Ogden", "NeoHookean")
    assert set(own) <= set(choice.options)
    for name in own:
        assert session.choose(choice.key, name) == ""
        assert type(session.scene.shell.material).__name__ == name
        assert float(session.scene.shell.material.shear_modulus()) == pytest.approx(175 * kPa, rel=1e-12)
    assert session.values["shell.material.mu_kPa"] == pytest.approx(175 * kPa, rel=1e-12)


def test_every_object_and_number_of_fingers_that_fits_can_be_chosen():
    session = Session(configs.load("configs/finger_grasp.toml").scene, None)
    assert min(session.choices["gripper.n"].options) == 2
    for name in session.choices["object.type"].options:
        assert session.choose("gripper.n", 3) == ""
        assert session.choose("object.type", name) == ""
        assert type(session.scene.object).__name__ == name
        faces = session.scene.object.FACES
        for count in session.choices["gripper.n"].options:
            # Fingers that would meet edges are refused in a sentence, and the scene stays as it is.
            said = session.choose("gripper.n", count)
            assert (said == "") == (faces % count == 0)
            assert (session.scene.gripper.n == count) == (said == "")
    assert session.choose("gripper.n", 1).startswith("[scene.gripper]: Gripper.n is 1; it must be")


def test_what_was_typed_far_away_leaves_no_trace_on_the_slider():
    session = Session(plane(), 15 * kPa)
    for text in ("1e6", "1e-6", "16"):
        assert session.type_in("shell.a_mm", text) == ""
    number = session.numbers["shell.a_mm"]
    assert 1 * mm < number.low < 16 * mm < number.high < 100 * mm


def test_pins_tell_choices_that_differ():
    session = answered(Session(plane(), 15 * kPa))
    session.pin()
    assert session.choose("shell.material.type", "Gent") == ""
    answered(session)
    heads, rows = session.differences()
    assert heads == ["", "pin 1", "now"]
    assert ["shell.material.type", "NeoHookean", "Gent"] in rows
    assert next(row for row in rows if row[0].startswith("shell.material.") and row[1] == "")[2] != ""


def test_what_follows_a_state_that_is_none():
    """Where a task has no state nothing is asked of its pressure, which is no number."""
    session = Session(plane(), None, {"force": 1e4})
    answered(session)
    assert (session.good, session.helps) == (None, None)
    assert "BEYOND_LIMIT" in session.message


def test_elasticities_are_those_of_differences(first):
    step, bars = 1e-4, dict(first.helps.bars)
    for key in ("shell.a_mm", "distance_mm", PRESSURE):
        forces = []
        for factor in (1 + step, 1 - step):
            session = Session(plane(), 15 * kPa)
            session.values[key] = session.values[key] * factor
            forces.append(float(sg.solve(session.current(), session.values[PRESSURE]).force))
        slope = (np.log(forces[0]) - np.log(forces[1])) / (np.log1p(step) - np.log1p(-step))
        assert bars["pressure" if key == PRESSURE else key] == pytest.approx(slope, rel=1e-5)
    # At a given p / mu forces are in proportion to mu.
    assert bars["pressure"] + bars["shell.material.mu_kPa"] == pytest.approx(1)


def test_every_slider_goes_to_both_ends():
    """A state, or a sentence that says why there is none; the last good picture stays."""
    session = answered(Session(plane(), 15 * kPa))
    for key in list(session.numbers):
        for place in (0.0, 1.0):
            assert session.move(key, place) == ""
            number = session.numbers[key]
            assert session.values[key] == pytest.approx((number.low, number.high)[int(place)], rel=1e-4)
            question = session.question()
            stages = list(answer(question))
            session.take(question, stages[0])
            assert session.good is not None
            assert bool(session.message) == (isinstance(stages[0], str) or not stages[0].ok)
        session.type_in(key, number.shown(session.numbers[key].value))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("abc", "shell.a_mm is 'abc'; it must be a positive finite number in mm."),
        ("-3", "shell.a_mm is -3; it must be a positive finite number in mm."),
        ("1e400", "shell.a_mm is inf; it must be a positive finite number in mm."),
        ("__import__('os')", "it must be a positive finite number in mm."),
        ("", "it must be a positive finite number in mm."),
    ],
)
def test_nonsense_is_told_and_changes_nothing(first, text, words):
    before = dict(first.values)
    assert words in first.type_in("shell.a_mm", text)
    assert first.values == before


def test_a_state_that_is_none_leaves_the_last_good_one():
    session = answered(Session(plane(), 15 * kPa))
    good = session.good
    session.type_in("shell.b_mm", "10")  # shorter than wide
    answered(session)
    assert session.message
    assert session.good is good
    session.type_in("shell.b_mm", "43")
    answered(session)
    assert session.message == ""


def test_a_number_beyond_the_slider_makes_it_longer(first):
    session = Session(plane(), 15 * kPa)
    assert session.type_in("distance_mm", "33 mm") == ""
    assert session.numbers["distance_mm"].high >= 33 * mm
    assert session.values["distance_mm"] == pytest.approx(33 * mm)


def test_what_is_taken_along_gives_the_same(first, tmp_path, capsys):
    session = Session(plane(), 15 * kPa)
    session.type_in("shell.t_m_mm", "1.2")
    answered(session)
    file = tmp_path / "explored.toml"
    file.write_text(session.toml(), encoding="utf-8")
    read = configs.load(file)
    wanted = float(session.good.solution.force)
    assert float(sg.solve(read.scene, configs.question(read)["pressure"]).force) == pytest.approx(wanted, rel=1e-12)
    *lines, last = session.python().strip().splitlines()
    names = {}
    exec("\n".join([*lines, last.replace("print(", "found = (", 1)]), names)
    assert float(names["found"].force) == pytest.approx(wanted, rel=1e-12)
    rows = session.table().splitlines()
    assert rows[0] == "pressure_kPa,force_N,before_limit"
    assert len(rows) == 1 + len(session.curve.pressure)
    assert session.picture("svg").startswith(b"<?xml")


def test_a_force_that_is_asked_for_finds_its_pressure(tmp_path):
    session = answered(Session(plane(), None, {"force": 10.0}))
    assert session.has_task
    assert float(sg.solve(plane(), session.values[PRESSURE]).force) == pytest.approx(10, rel=1e-9)
    assert session.task_words() == "at the pressure with force 10 N"
    file = tmp_path / "explored.toml"
    file.write_text(session.toml(), encoding="utf-8")
    assert configs.question(configs.load(file)) == {"force": 10.0}
    assert "force=10.0" in session.python()
    session.move("distance_mm", 0.6)
    answered(session)
    found = sg.solve(session.current(), session.values[PRESSURE])
    assert float(found.force) == pytest.approx(10, rel=1e-9)
    session.move(PRESSURE, 0.3)
    assert not session.own_task
    assert session.question().pressure == session.values[PRESSURE]
    session.open(free())  # it has no force
    assert not session.has_task


def test_choices_keep_the_numbers_that_both_have():
    session = Session(plane(), 15 * kPa)
    session.type_in("shell.a_mm", "15")
    assert session.choose("shell.material.type", "Gent") == ""
    assert isinstance(session.scene.shell.material, sg.Gent)
    assert session.values["shell.a_mm"] == pytest.approx(15 * mm)
    assert len([key for key in session.numbers if key.startswith("shell.material.")]) == 2
    assert session.values["shell.material.mu_kPa"] == pytest.approx(175 * kPa)


def test_pins_are_compared(first):
    session = answered(Session(plane(), 15 * kPa))
    session.pin()
    session.type_in("distance_mm", "6")
    answered(session)
    head, rows = session.differences()
    assert head == ["", "pin 1", "now"]
    assert ["distance_mm", "5", "6"] in rows
    assert not [row for row in rows if row[0] == "shell.a_mm"]


def test_what_is_not_ok_cannot_be_pinned():
    """Neither a broken design, in whose place the last good one was pinned with the numbers of the broken one, nor a
    scene that has not been answered yet, in whose place the scene before was."""
    session = answered(Session(free(), 15 * kPa))
    session.type_in("shell.t_m_mm", "0.5")
    answered(session)
    assert session.pin() == f"Nothing is pinned, because this design is not OK: {session.message}"
    assert session.message.startswith("BEYOND_LIMIT")
    session.type_in("shell.t_m_mm", "1.1")
    answered(session)
    session.open(plane())
    assert session.pin() == "Nothing is pinned, because the state is still being computed."
    assert session.pins == []
    with pytest.raises(InputError, match="no state to draw"):
        session.picture("png")
    session.type_in(PRESSURE, "1")
    answered(session)
    assert session.pin().startswith("Nothing is pinned, because this design is not OK: NO_CONTACT")


def test_a_pin_has_the_numbers_of_its_state():
    """And not those of the sliders, which have gone on, nor a curve of other numbers."""
    session = answered(Session(free(), 15 * kPa))
    assert session.pin() == ""
    session.type_in("shell.t_m_mm", "1.2")
    session.type_in(PRESSURE, "14")
    assert session.pin() == ""
    question = session.question()
    session.take(question, next(answer(question)))
    session.type_in("shell.t_m_mm", "0.5")
    assert session.pin() == ""
    pins = session.pins
    assert [pin.inputs["shell.t_m_mm"] for pin in pins] == ["1.1", "1.1", "1.2"]
    assert [pin.inputs[PRESSURE] for pin in pins] == ["15", "15", "14"]
    assert pins[0].rows == pins[1].rows != pins[2].rows
    assert (pins[0].curve, pins[1].curve, pins[2].curve) == (session.curve, session.curve, None)
    answered(session)
    heads, rows = session.differences()
    assert heads[-1] == "last state"
    assert next(row for row in rows if row[0] == "shell.t_m_mm")[-1] == "1.2"


def test_a_pin_that_was_made_before_its_curve_has_it_once_it_is_there():
    """A pin that was made while the first curve was compiled, which takes a minute, had no curve ever."""
    session = Session(free(), 15 * kPa)
    question = session.question()
    stages = answer(question)
    session.take(question, next(stages))
    session.pin()
    for stage in stages:
        session.take(question, stage)
    assert session.pins[0].curve is session.curve is not None
    session.type_in("shell.t_m_mm", "1.2")
    answered(session)
    assert session.pins[0].curve is not session.curve


def test_answers_of_a_scene_that_is_open_no_more_are_dropped():
    from softgrip_jax.explorer.page import Page

    session = Session(free(), 15 * kPa)
    old = session.question()
    stages = [*answer(old), "a sentence"]
    session.open(plane())
    shown = []
    page = object.__new__(Page)
    page.session, page._grey, page.say = session, shown.append, lambda *words: shown.append(words)
    page.curve = page.helps = page
    page.show = page._show_state = page._show_words = lambda *parts: shown.append(parts)
    for stage in stages:
        session.take(old, stage)
        page._show(old, stage)
    assert len(stages) == 4
    assert (session.good, session.curve, session.helps, session.message, shown) == (None, None, None, "", [])
    with pytest.raises(InputError, match="curve of this design is still being computed"):
        session.table()
    answered(session)
    assert session.table().startswith("pressure_kPa,force_N")


@pytest.mark.parametrize(
    ("solve", "words"),
    [
        ("presure_kPa = 5", "there is no key presure_kPa; did you mean pressure_kPa"),
        ("pressure_kPa = -5", "pressure_kPa is -5"),
        ("pressure_kPa = 'five'", "pressure_kPa is 'five'"),
        ("", "there is nothing to solve for"),
    ],
)
def test_a_mistake_in_the_question_of_a_config_is_told(tmp_path, solve, words):
    """Each opened at 15 kPa, as a config without a question does."""
    file = tmp_path / "scene.toml"
    file.write_text(configs.dump(free()), encoding="utf-8")
    assert session_of_config(file).values[PRESSURE] == 15 * kPa
    file.write_text(f"{configs.dump(free())}\n[solve]\n{solve}\n", encoding="utf-8")
    with pytest.raises(ConfigError, match=words):
        session_of_config(file)


def test_models_are_compared_at_one_pressure():
    """At that of the click, where a hand moves the slider meanwhile; a model without a state says why."""
    session = Session(free(), 15 * kPa)

    def tell(stage, done=0, total=0):
        session.type_in(PRESSURE, "8")

    (_, rows), ladder = models.compared(session.question(), tell)
    shown = [sg.solve(model.scene, 15 * kPa).inflation / mm for model in ladder]
    assert [float(row[4].split()[0]) for row in rows] == pytest.approx([float(one) for one in shown], rel=1e-3)
    assert rows[0][5] == f"{100 * (shown[0] / shown[-1] - 1):+.3g} %"
    session.type_in(PRESSURE, "60")
    (_, rows), _ = models.compared(session.question(), lambda *words: None)
    assert rows[-1][4] == f"BEYOND_LIMIT: {sg.solve(free(), 60 * kPa).reason_text()}"
    assert len(rows) > 1
    assert [row[5] for row in rows] == [""] * len(rows)


def test_nothing_is_compared_with_a_value_of_zero(monkeypatch):
    found = iter(argparse.Namespace(status=sg.Status.OK, observables={"inflation": value}) for value in (1.0, 0.0))
    monkeypatch.setattr(models, "model_ladder", lambda *asked: [LadderModel(free(), (), "", 1.0)] * 2)
    monkeypatch.setattr(models, "solve", lambda *asked: next(found))
    (_, rows), _ = models.compared(Session(free(), 15 * kPa).question(), lambda *words: None)
    assert [row[5] for row in rows] == ["", ""]


def test_a_fault_of_work_in_the_background_is_told():
    """It left the progress on the page for ever."""
    from softgrip_jax.explorer.page import Page

    page, said = object.__new__(Page), []
    page.later, page.say = lambda act: act(), lambda *words: said.append(words)
    page.in_background(lambda tell: 1 / 0).join(10)
    assert said == [("This is a fault of softgrip_jax: ZeroDivisionError: division by zero", True)]


GAP, NONE = (sg.Status.IMPOSSIBLE, sg.Reason.CHAMBERS_APART), (sg.Status.OK, sg.Reason.NONE)


@pytest.mark.parametrize(
    ("states", "end"),
    [
        ([NONE, NONE, GAP, NONE, NONE, NONE], "limit 30 kPa"),
        ([NONE, NONE, NONE, GAP, NONE, NONE], "X between 20 and 30 kPa"),
        ([NONE, NONE, NONE, GAP, GAP, GAP], "X between 20 and 30 kPa"),
        ([NONE, NONE, NONE, NONE, GAP, NONE], "limit 30 kPa"),
    ],
)
def test_a_curve_has_gaps_and_its_limit_where_it_is(monkeypatch, states, end):
    pressure, value = np.array([5.0, 10, 20, 30, 25, 24]) * kPa, np.arange(6.0)
    status, reason = np.array(states).T
    branch = argparse.Namespace(status=status, reason=reason, pressure=pressure, observables={"inflation": value})
    monkeypatch.setattr(answers, "_beside", lambda *asked: (30 * kPa, branch))
    curve = answers.curve_of(free(), "inflation")
    good = status == sg.Status.OK
    count = int(np.flatnonzero(good)[-1]) + 1
    np.testing.assert_array_equal(curve.value, np.where(good, value, np.nan)[:count])
    np.testing.assert_array_equal(curve.pressure, np.where(good, pressure, np.nan)[:count])
    np.testing.assert_array_equal(curve.stable, (np.arange(6) < 4)[:count])
    assert curve.end == end.replace("X", sg.Reason.CHAMBERS_APART.name.lower())
    session = Session(free(), 15 * kPa)
    session.take(session.question(), curve)
    assert len(session.table().splitlines()) == 1 + np.count_nonzero(good)
    view = CurveView(lambda pressure: None)
    view.show(curve, "length")
    last = int(np.flatnonzero(good[:4])[-1])
    assert view.marks.data["text"] == [curve.end, "contact"]
    assert view.marks.data["x"] == [pressure[last] / kPa, 5]
    assert view.marks.data["y"] == [value[last] / mm, 0]


def test_words_on_the_curve_go_towards_its_middle():
    """They ended at the end of the curve, and the left border cut them off where a pinned curve reached much farther;
    'contact' began at its mark, and the right border cut it off where that is the last state."""
    pressure = np.linspace(1, 10, 10) * kPa
    curve = answers.CurveData(
        "inflation", pressure, pressure * mm / kPa, pressure > 0, 10 * kPa, 10 * kPa, "limit 10 kPa", free()
    )
    view = CurveView(lambda pressure: None)
    view.show(curve, "length")
    assert view.marks.data["align"] == ["right", "right"]
    far = dataclasses.replace(curve, pressure=10 * pressure)
    view.show_pins([("far", far)], "length")
    assert view.marks.data["align"] == ["left", "left"]
    view.show_pins([], "length")
    view.show(dataclasses.replace(curve, contact=1 * kPa), "length")
    assert view.marks.data["align"] == ["right", "left"]


def test_sessions_do_not_see_each_other():
    one, other = Session(plane(), 15 * kPa), Session(plane(), 15 * kPa)
    one.type_in("distance_mm", "7")
    assert other.values["distance_mm"] == pytest.approx(5 * mm)


def test_zero_and_arrays_have_sliders_too():
    finger = sg.PneuNet.table_5_1("A")
    numbers = {number.key: number for number in numbers_of(sg.pneunet.TipContact(finger, weight=(0.0, -2.0)))}
    assert numbers["weight_N_per_m[1]"].value == -2.0
    assert numbers["tip_offset_mm"].low < 0 < numbers["tip_offset_mm"].high
    assert numbers["finger.a_mm"].is_log
    assert not numbers["tip_offset_mm"].is_log


def test_only_the_newest_question_is_answered():
    """Ten questions while one is computed: that one and the newest are begun, and the old one is given up."""
    begun, delivered, wait = [], [], threading.Event()

    def slow(question):
        begun.append(question)
        if question == 0:
            wait.wait(5)
        yield "picture"
        yield "curve"

    work = Latest(slow, lambda question, stage: delivered.append((question, stage)), lambda *fault: None)
    work.ask(0)
    while not begun:
        time.sleep(0.001)
    for question in range(1, 11):
        work.ask(question)
    wait.set()
    assert work.settle(5.0)
    work.close()
    assert begun == [0, 10]
    assert delivered == [(0, "picture"), (10, "picture"), (10, "curve")]
    assert (work.never_begun, work.given_up) == (9, 1)


def test_the_slider_of_the_pressure_stays_while_it_fits(first):
    """A little thicker: a little more pressure can be held, and the same range will do. Half as thick: it will not."""
    session = Session(plane(), 15 * kPa)
    question = session.question()
    session.take(question, first.curve)
    before = session.numbers[PRESSURE]
    assert before.high == pytest.approx(1.25 * first.curve.limit, rel=5e-3)
    session.take(question, dataclasses.replace(first.curve, limit=1.1 * first.curve.limit))
    assert session.numbers[PRESSURE] is before
    session.take(question, dataclasses.replace(first.curve, limit=0.5 * first.curve.limit))
    assert session.numbers[PRESSURE].high == pytest.approx(1.25 * 0.5 * first.curve.limit, rel=5e-3)


class Document:
    """As Bokeh's, whose next tick comes when it is told to."""

    def __init__(self):
        self.ticks = []

    def add_next_tick_callback(self, act):
        self.ticks.append(act)


def test_nothing_changes_while_a_page_is_on_its_way():
    """Until the browser has the page, what is to be shown waits; then it comes, in its order."""
    from softgrip_jax.explorer.page import Page

    page, done = object.__new__(Page), []
    page.document, page._lock, page._waiting = Document(), threading.Lock(), []
    page.later(lambda: done.append("first"))
    page.later(lambda: done.append("second"))
    assert (done, page.document.ticks) == ([], [])
    page._loaded()
    assert done == ["first", "second"]
    page.later(lambda: done.append("third"))
    [tick] = page.document.ticks
    assert len(done) == 2
    tick()
    assert done == ["first", "second", "third"]


def test_what_follows_waits_for_a_quiet_moment_but_not_for_ever():
    """Questions every 20 ms: the first answer comes after four pauses; after the last question, one pause is enough."""
    begun = []

    def answered(question):
        begun.append((question, time.monotonic()))
        yield question

    work = Latest(answered, lambda question, stage: None, lambda *fault: None, 0.2)
    began = time.monotonic()
    while not begun and time.monotonic() < began + 10:
        work.ask(len(begun))
        time.sleep(0.02)
    assert begun[0][1] - began >= 0.8
    assert work.settle(5.0)
    asked = time.monotonic()
    work.ask("last")
    assert work.settle(5.0)
    work.close()
    assert begun[-1][0] == "last"
    assert 0.2 <= begun[-1][1] - asked < 0.8


def test_a_fault_does_not_end_the_thread():
    told = []

    def faulty(question):
        if question == 1:
            raise ZeroDivisionError
        yield question

    found = []
    work = Latest(faulty, lambda question, stage: found.append(stage), lambda question, error: told.append(error))
    for question in (1, 2):
        work.ask(question)
        assert work.settle(5.0)
    work.close()
    assert found == [2]
    assert isinstance(told[0], ZeroDivisionError)


# --- the server -------------------------------------------------------------------------------------------------------


class Behind(Application):
    """In the place of Panel's server."""

    def __init__(self):
        class Answer(RequestHandler):
            def get(self):
                self.write("a page")

        super().__init__([("/explorer", Answer)])

    def initialize(self, loop):
        pass

    start = stop = lambda self: None


@contextmanager
def front(host="localhost"):
    """(a server that runs, what makes its second part come)."""
    comes, made = threading.Event(), Front(lambda: None, host, 0)

    def explorer():
        comes.wait(10)
        return Behind()

    made._explorer = explorer

    def run():
        asyncio.set_event_loop(asyncio.new_event_loop())
        made.run()

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield made, comes
    finally:
        comes.set()
        made.stop()
        thread.join(10)
        assert not thread.is_alive()


def get(address):
    """(status, body)."""
    try:
        with urllib.request.urlopen(address, timeout=10) as answer:
            return answer.status, answer.read().decode()
    except urllib.error.HTTPError as error:
        return error.code, ""


def test_the_frame_is_there_before_the_page():
    found = []
    with front() as (made, comes):
        status, frame = get(made.address)
        assert status == 200
        for script in re.findall(r'src="(static/[^"]+)"', frame):
            assert get(made.address + script)[0] == 200
        asked = threading.Thread(target=lambda: found.append(get(f"{made.address}explorer")))
        asked.start()
        asked.join(0.3)
        assert found == []
        comes.set()
        asked.join(10)
    assert found == [(200, "a page")]


def test_a_fault_of_the_page_ends_its_server():
    made, raised = Front(lambda: None, "localhost", 0), []

    def faulty():
        raise ZeroDivisionError

    def run():
        asyncio.set_event_loop(asyncio.new_event_loop())
        try:
            made.run()
        except ZeroDivisionError as error:
            raised.append(error)

    made._explorer = faulty
    thread = threading.Thread(target=run)
    thread.start()
    thread.join(10)
    assert len(raised) == 1


def test_another_host_needs_the_token():
    with front("127.0.0.2") as (made, _):
        bare = made.address.partition("?")[0]
        assert get(bare)[0] == 403
        assert get(f"{bare}?token=guessed")[0] == 403
        assert get(made.address)[0] == 200


def test_files_outside_of_the_scripts_are_not_given():
    with front() as (made, _):
        for path in ("static/../../../../etc/passwd", "static/js/%2e%2e/%2e%2e/%2e%2e/server.py", "static//etc/passwd"):
            assert get(made.address + path)[0] in (403, 404)


def test_a_port_that_is_taken_is_told():
    with front() as (made, _), pytest.raises(InputError, match="cannot listen at localhost, port"):
        Front(lambda: None, "localhost", made.port)


def test_a_cell_outside_of_its_law_s_range_says_so():
    """Within it, its rules are what is near; the range is no rule that something could be broken by."""
    from softgrip_jax.explorer.page import near_words

    finger = sg.PneuNet.table_5_1("A")

    def said(finger):
        state = answers.state_of(sg.pneunet.Cell(finger), 10 * kPa, {})
        assert state.ok
        return near_words(state.margins[0])

    assert re.match(r"; nearest rule \w+: [\d.]+ mm left$", said(finger))
    with pytest.warns(CellRangeWarning):
        assert said(dataclasses.replace(finger, a=9 * mm)) == (
            "; a dimension is 1.8 mm outside of what the cell law was fitted to"
        )


def test_what_was_refused_stays_said_and_the_program_is_of_the_state_that_is_shown():
    """An answer that was on its way took the sentence's place; the text of the tab Out stayed that of another state."""
    from softgrip_jax.explorer.page import Control, Page

    session, said, greys = Session(free(), 8 * kPa), [], []
    answered(session)
    page = object.__new__(Page)
    page.session, page.refused, page.ask = session, "", lambda: None
    page.say, page._grey = (lambda *words: said.append(words)), greys.append
    page.rows, page.code = argparse.Namespace(object=""), argparse.Namespace(object="")
    page.tabs, page.task = argparse.Namespace(active=1), argparse.Namespace(value=False)
    page.curve = argparse.Namespace(show_state=lambda *place: None, show_pins=lambda *pins: None)
    page._drawn = session.good
    control = object.__new__(Control)
    control.key, control.say = "shell.b_mm", lambda sentence: None
    kind = session.observables[session.observable][2]
    page._done(control, "shell.b_mm is 10; it must be larger.")
    assert "value of the last state, at 8 kPa" in page.rows.object
    page._show_words(session.good, session.question(), kind)
    assert said == [("shell.b_mm is 10; it must be larger.", True)]
    assert "pressure_kPa = 8" in page.code.object
    session.type_in(PRESSURE, "9")
    page._done(control, "")
    answered(session)
    page._show_words(session.good, session.question(), kind)
    assert said[-1][0].startswith("9 kPa")
    assert "pressure_kPa = 9" in page.code.object
    assert "of the last state" not in page.rows.object


def test_no_file_is_of_another_design_than_that_of_the_sliders():
    """A picture was that of the last good state, and a curve that of the last numbers: no file said so."""
    session = answered(Session(free(), 8 * kPa))
    curve = session.table()
    session.type_in(PRESSURE, "900")
    answered(session)
    with pytest.raises(InputError, match="There is no picture of this design: BEYOND_LIMIT"):
        session.picture("png")
    assert session.table() == curve  # it goes to the limit of this design
    session.type_in(PRESSURE, "8")
    session.type_in("shell.b_mm", "10")
    answered(session)
    for taken in (session.table, session.toml, session.python, lambda: session.picture("png")):
        with pytest.raises(InputError, match=r"FlatShell\.b is 10 mm; it must be at least a"):
            taken()
    session.type_in("shell.b_mm", "44")
    session.message = ""
    for taken in (session.table, lambda: session.picture("png")):
        with pytest.raises(InputError, match="of this design is still being computed"):
            taken()
    answered(session)
    assert session.table() != curve
    assert session.picture("png")


def shown_page(session, active):
    """(a page whose parts keep what they are given, what the curve was given as pins)."""
    from softgrip_jax.explorer.page import Page

    page, pins = object.__new__(Page), []
    page.session, page.refused, page._drawn, page.say = session, "", session.good, lambda *words: None
    page.later = lambda act: act()
    parts = ["rows", "code", "compared", "pictures", "space", "bars", "curves"]
    page.__dict__.update({name: argparse.Namespace(object="", styles={}) for name in parts})
    page.tabs, page._answered = argparse.Namespace(active=active), set()
    page.curve = argparse.Namespace(
        show_state=lambda *place: None,
        show_pins=lambda curves, kind: pins.append([curve for _, curve in curves]),
        dim_point=lambda is_last: None,
    )
    return page, pins


def test_numbers_that_do_not_go_together_leave_nothing_that_looks_like_theirs():
    """Bars, curve, program and table of pins stayed in full colour those of the state before."""
    session = answered(Session(free(), 8 * kPa))
    session.pin()
    for active in (0, 1):
        page, _ = shown_page(session, active)
        page._show_words(session.good, session.question(), "length")
        session.type_in("shell.b_mm", "10")
        question = session.question()
        for stage in answer(question):
            page._show(question, stage)
        assert all("grayscale" in part.styles["filter"] for part in (page.pictures, page.rows, page.bars, page.curves))
        assert "value of the last state, at 8 kPa" in page.rows.object
        assert ("last state" in page.compared.object) == (active == 0)
        assert ("FlatShell.b is 10 mm" in page.code.object) == (active == 1)
        assert "sg.solve" not in page.code.object
        session.type_in("shell.b_mm", "43")
        answered(session)
    page._show_words(session.good, session.question(), "length")
    assert "of the last state" not in page.rows.object
    session.type_in(PRESSURE, "900")
    page._show(question := session.question(), next(answer(question)))
    assert "value of the last state, at 8 kPa" in page.rows.object
    page._grey(True, has_curve=True)  # a design without a state has a curve
    assert page.curves.styles["filter"] == "none"
    assert "grayscale" in page.bars.styles["filter"]


def test_pinned_curves_are_those_of_the_observable_on_the_axis():
    """With another tab open, pins of a force stayed on the axis of a length, and the table kept an older design."""
    session = answered(Session(free(), 8 * kPa))
    session.pin()
    page, pins = shown_page(session, active=1)
    other = next(name for name in session.observables if name != session.observable)
    for name, count in ((session.observable, 1), (other, 0)):
        session.look_at(name)
        page._show_words(session.good, session.question(), session.observables[name][2])
        assert len(pins[-1]) == count
    assert page.compared.object == ""
    page.tabs.active, page._unread = 0, {}
    page._turned_to(0)
    assert "pin 1" in page.compared.object


def test_numbers_wait_for_no_compiler():
    """While the first curve was compiled, for up to a minute, pictures went on beside the numbers of the first one."""
    from softgrip_jax.explorer.page import Page, Words

    session, acts = answered(Session(free(), 8 * kPa)), []
    page = object.__new__(Page)
    page.session, page.later, page.further = session, acts.append, argparse.Namespace(ask=lambda asked: None)
    question, curve = session.question(), session.curve
    for known, count in ((curve, 0), (None, 1)):
        session.curve = known
        acts.clear()
        page._deliver(question, session.good)
        told = [act for act in acts if any(isinstance(part, Words) for part in getattr(act, "args", ()))]
        assert len(told) == count


@pytest.mark.filterwarnings("ignore")
def test_nothing_of_the_scene_before_looks_like_that_of_the_one_that_is_open():
    """Picture, numbers, curve and bars stood in full colour below the other scene's name until it was compiled."""
    from softgrip_jax.explorer.page import Page

    page = Page(Session(free(), 8 * kPa))
    page.work.close()
    page.further.close()
    page.work, page.later = argparse.Namespace(ask=lambda question: None), lambda act: act()
    question = page.session.question()
    for stage in answer(question):
        page._show(question, stage)
    page._show_rows(page.session.good, False)
    assert page.pictures.styles == page.bars.styles == {}
    assert len(page.curve.stable.data["x"]) > 2
    assert page.helps.source.data["key"]
    page.session.pin()
    page._show_pins()
    assert ">now<" in page.compared.object
    page.open_scene(plane())
    assert "pin 1" in page.compared.object
    assert ">now<" not in page.compared.object
    assert "shell.FlatContact" in page.title.object
    assert "grayscale" in page.pictures.styles["filter"]
    assert "grayscale" in page.rows.styles["filter"]
    assert "value of the last state, at 8 kPa" in page.rows.object
    shown = (page.curve.stable, page.curve.unstable, page.curve.now, page.curve.marks, page.helps.source)
    assert all(len(column) == 0 for source in shown for column in source.data.values())
