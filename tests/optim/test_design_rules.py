"""Rules in searches: an optimum that would break one ends on it, unless it is ignored by name. One finger, one law."""

import dataclasses
import importlib
import io

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import ROOT
from helpers import shell
from rich.console import Console
from scipy.optimize import brentq

import softgrip_jax as sg
from optim.design import settings
from optim.design.descent import Evaluator, search
from optim.design.pareto import pareto
from optim.drives import beyond_law
from optim.laws import differing_laws
from optim.problem import Goal, Limits, Problem, Quantity
from optim.records import agreed, design_row, in_si
from optim.space import Space, Variable
from softgrip_jax import config as configs
from softgrip_jax.config import ConfigError
from softgrip_jax.config.keys import quantity
from softgrip_jax.errors import CellRangeWarning
from softgrip_jax.quantities import kind_of
from softgrip_jax.reasons import Reason
from softgrip_jax.results import Status
from softgrip_jax.units import kPa, mm

runs = importlib.import_module("optim.design.run")

FINGER = sg.PneuNet.table_5_1("A")
PRESSURE = 10 * kPa
ALLOWED = 12 * mm


class Ruled(sg.shell.Free):
    """A free membrane with two rules: no thicker than an eighth of a, and no inflation beyond what is allowed."""

    allowed: float = eqx.field(static=True, default=ALLOWED, kw_only=True)
    no_key: tuple = eqx.field(static=True, kw_only=True)  # keeps the class out of configs

    def margins_at_rest(self):
        return {"walls_fit": self.shell.a / 8 - self.shell.t_m, "one_segment": self.shell.b - self.shell.a}

    def margins_of_state(self, unknowns, pressure):
        return {"chambers_apart": self.allowed - self.observe(unknowns, pressure)["inflation"]}


def ruled(**kwargs):
    return Ruled(shell(), no_key=(), **kwargs)


THICKNESS = Variable("shell.t_m", 0.8 * mm, 3 * mm)
WIDTH = Variable("shell.a", 12 * mm, 20 * mm)
LEAST_STRETCH = Goal("minimise", Quantity("stretch", PRESSURE))
MOST_INFLATION = Goal("maximise", Quantity("inflation", PRESSURE))


def problem(goal=LEAST_STRETCH, variables=(THICKNESS,), limits=(), scene=None, **kwargs):
    return Problem(Space({"scene": scene or ruled()}, variables), [goal], limits, **kwargs)


@pytest.fixture(scope="module")
def kept():
    return search(problem(), starts=4, steps=2, finishes=2)


@pytest.fixture(scope="module")
def ignored():
    return search(problem(ignore_rules=["walls_fit"]), starts=4, steps=2, finishes=2)


def test_an_optimum_beyond_a_rule_of_the_parts_ends_on_it(kept):
    """The thicker the less stretch: the optimum is the thickest wall that fits, a / 8."""
    best = kept.best
    assert best.feasible
    assert best.statuses == (Status.OK,)
    assert best.x[0] == pytest.approx(2 * mm, abs=1e-9)
    assert best.margins[kept.problem.rules.index(Quantity("margins.walls_fit", "rest", "scene"))] == pytest.approx(
        0, abs=1e-9
    )
    assert "rule walls_fit" in best.active
    assert int(sg.solve(kept.problem.scenes_at(best.x)["scene"], PRESSURE).status) == Status.OK


def test_an_optimum_beyond_a_rule_of_a_state_ends_on_it():
    """The thinner the more inflation: the optimum is where the membrane reaches just what is allowed."""
    found = search(problem(MOST_INFLATION), starts=4, steps=2, finishes=2)
    thinnest = brentq(lambda t: float(sg.solve(sg.shell.Free(shell(t_m=t)), PRESSURE).inflation) - ALLOWED, 8e-4, 2e-3)
    assert found.best.x[0] == pytest.approx(thinnest, rel=1e-6)
    assert found.best.statuses == (Status.OK,)
    assert found.best.active == ("rule chambers_apart at 10 kPa",)


def test_a_rule_that_is_ignored_by_name_holds_nothing(ignored):
    best = ignored.best
    assert best.feasible
    assert best.x[0] == pytest.approx(3 * mm, rel=1e-12)
    assert best.statuses == (Status.OK,)
    assert best.active == ("shell.t_m at its upper bound",)
    scene = ignored.problem.scenes_at(best.x)["scene"]
    assert scene.ignored_rules == ("walls_fit",)
    assert int(sg.solve(scene, PRESSURE).status) == Status.OK
    strict = dataclasses.replace(scene, ignored_rules=())
    assert int(sg.solve(strict, PRESSURE).status) == Status.IMPOSSIBLE


def test_a_scene_that_ignores_a_rule_need_not_keep_it():
    own = problem(scene=ruled(ignored_rules=("walls_fit",)), ignore_rules="one_segment")
    assert [rule.rule for rule in own.rules] == ["chambers_apart"]
    assert own.ignored == ("walls_fit", "one_segment")


def test_an_energy_membrane_ignores_what_its_scene_does():
    scene = sg.shell.FlatContact(shell(), distance=5 * mm, model="energy", ignored_rules="membrane_clear_at_rest")
    assert scene.prepared().ignored_rules == ("membrane_clear_at_rest",)


def test_statuses_and_reasons_are_those_of_the_scenes_with_their_rules_on(kept):
    wanted = kept.problem
    t = np.array([[0.0], [0.05], [0.4], [0.7], [1.0]])
    found = Evaluator(wanted, 2)(t)  # the program that the search compiled
    for k, row in enumerate(t):
        scene = wanted.scenes_at(wanted.space.from_unit(jnp.asarray(row)))["scene"]
        solution = sg.solve(scene, PRESSURE)
        assert int(found.statuses[k, 0]) == int(solution.status)
        assert int(found.reasons[k, 0]) == int(solution.reason)
        np.testing.assert_allclose(found.details[k, 0], solution.detail, rtol=1e-12)
        assert np.isfinite(found.values[k]).all(), "values exist on both sides of a rule"
        assert float(found.shortfall[k]) == 0
    assert {Reason(int(r)) for r in found.reasons[:, 0]} == {Reason.NONE, Reason.WALLS_FIT, Reason.CHAMBERS_APART}


def test_what_is_reported_names_rules_that_hold_and_no_others(kept, ignored):
    printed = io.StringIO()
    runs.report(kept, Console(file=printed, width=120))
    assert "rule walls_fit" in printed.getvalue()
    assert "on it" in printed.getvalue()
    assert "rule one_segment" not in printed.getvalue()
    assert "Every design keeps these rules: walls_fit, one_segment, chambers_apart." in printed.getvalue()
    assert "ignored" not in printed.getvalue()
    told = in_si(kept.problem, kept.best)
    assert [rule["rule"] for rule in told["rules"]] == ["rule walls_fit"]
    assert told["rules"][0]["margin_mm"] == pytest.approx(0, abs=1e-6)
    assert list(told["quantities"]) == ["stretch at 10 kPa"]
    assert agreed(kept.problem)["rules_ignored"] == []

    printed = io.StringIO()
    runs.report(ignored, Console(file=printed, width=120))
    assert "Every design keeps these rules: one_segment, chambers_apart." in printed.getvalue()
    assert "These rules were ignored: walls_fit." in printed.getvalue()
    assert agreed(ignored.problem)["rules_ignored"] == ["walls_fit"]


def test_a_start_that_breaks_a_rule_says_so():
    thick = dataclasses.replace(ruled(), shell=shell(t_m=2.5 * mm))
    found = search(problem(scene=thick), starts=2, steps=1, finishes=1)
    assert found.reference.statuses == (Status.IMPOSSIBLE,)
    assert not found.reference.feasible
    assert np.isfinite(found.reference.values).all()
    printed = io.StringIO()
    runs.report(found, Console(file=printed, width=120))
    assert "broken by 0.5 mm" in printed.getvalue()
    assert "The start has no answer: two walls of a chamber are 0.5 mm too thick for its length." in printed.getvalue()
    row = design_row(found.problem, found.reference)
    assert row["rules"] == "rule walls_fit -0.5 mm"
    assert row["status"] == "IMPOSSIBLE"
    assert found.best.x[0] == pytest.approx(2 * mm, abs=1e-9)


def test_a_search_stays_where_the_cell_law_is_known():
    """The thinner the walls the harder the cell pushes, by a polynomial that nothing holds below 0.85 mm."""
    walls = Variable("finger.t_m", 0.5 * mm, 1.5 * mm)
    hardest = Goal("minimise", Quantity("moment", PRESSURE))

    def pushed(finger, **changes):
        return problem(hardest, [walls], scene=sg.pneunet.Cell(finger), **changes)

    found = search(pushed(FINGER), starts=4, steps=30, finishes=1)
    assert found.best.feasible
    np.testing.assert_allclose(found.best.x, [0.85 * mm], rtol=1e-6)
    assert "cell_law_range" in agreed(found.problem)["rules_kept"]
    free = search(pushed(FINGER, ignore_rules=["cell_law_range"]), starts=4, steps=30, finishes=1)
    assert free.best.objective < found.best.objective
    (said,) = beyond_law(free.problem, free.best.x)
    assert "t_m" in said
    # One that begins outside is not held there, for it may have nothing that lies inside; its report says so.
    with pytest.warns(CellRangeWarning, match="h_L"):
        outside = pushed(dataclasses.replace(FINGER, h_L=5.2 * mm))
    assert "cell_law_range" not in {rule.rule for rule in outside.rules}
    (said,) = beyond_law(outside, [1.1 * mm])
    assert "h_L = 5.2 mm" in said


def test_a_front_keeps_the_rules():
    """Less stretch costs inflation; of the front without rules only the part that keeps both of them is left."""
    goals = [LEAST_STRETCH, MOST_INFLATION]
    front = pareto(Problem(Space({"scene": ruled()}, [THICKNESS, WIDTH]), goals), points=5, starts=8)
    assert all(design.feasible and design.statuses == (Status.OK,) for design in front.designs)
    assert np.min([design.margins for design in front.designs]) > -1e-9
    assert front.designs[0].x[0] == pytest.approx(front.designs[0].x[1] / 8, abs=1e-8)
    assert front.designs[-1].values[1] == pytest.approx(ALLOWED, abs=1e-8)


def test_least_squares_end_on_a_rule_too():
    """The nearest to a stretch that only a wall of 2.4 mm has is the thickest wall that fits."""
    wanted = float(sg.solve(sg.shell.Free(shell(t_m=2.4 * mm)), PRESSURE).stretch)
    reach = Goal("reach", Quantity("stretch", PRESSURE), target=wanted)
    assert search(problem(reach), starts=2, steps=1).best.x[0] == pytest.approx(2 * mm, abs=1e-8)


# --- margins as quantities --------------------------------------------------------------------------------------------


def test_margins_are_quantities_with_their_slopes():
    rest, bent = Quantity("margins.walls_fit"), Quantity("margins.chambers_apart", PRESSURE)
    limits = [Limits(rest, low=0.1 * mm), Limits(bent, low=0.5 * mm)]
    wanted = problem(variables=(THICKNESS, WIDTH), limits=limits)
    # What the user asks for is measured once, rule or not.
    assert len(wanted.measured.quantities) == 1 + 3
    t, step = jnp.array([0.3, 0.4]), 1e-5
    found, slopes = jax.jit(wanted.measure_with_slopes)(t, jnp.asarray(wanted.home()))
    x = np.asarray(wanted.space.from_unit(t))
    np.testing.assert_allclose(found.values[1], x[1] / 8 - x[0], rtol=1e-12)
    np.testing.assert_allclose(slopes.values[1], [-2.2 * mm, 8 * mm / 8], rtol=1e-10)

    def inflation(t):
        return sg.solve(wanted.scenes_at(wanted.space.from_unit(jnp.asarray(t)))["scene"], PRESSURE).inflation

    np.testing.assert_allclose(found.values[2], ALLOWED - inflation(t), rtol=1e-10)
    numeric = [-(inflation(t + step * e) - inflation(t - step * e)) / (2 * step) for e in np.eye(2)]
    np.testing.assert_allclose(slopes.values[2], numeric, rtol=1e-6)


def test_a_study_has_margins_on_both_sides_of_a_rule():
    quantities = [Quantity("margins.walls_fit", PRESSURE), Quantity("margins.chambers_apart", PRESSURE)]
    thicknesses = np.array([0.8, 1.9, 2.5]) * mm
    study = sg.Study(ruled(), ["shell.t_m"], quantities, sg.study.Grid([thicknesses]), gradients=True)
    data = study.run()
    np.testing.assert_allclose(data["margins.walls_fit"], 2 * mm - thicknesses, rtol=1e-12)
    np.testing.assert_allclose(data["slope_of_margins.walls_fit"].squeeze(), -1.0, rtol=1e-12)
    # Parts that do not fit together have no other state.
    np.testing.assert_array_equal(np.sign(data["margins.chambers_apart_at_10_kPa"]), [-1, 1, np.nan])
    assert list(data["status_10_kPa"].values) == [Status.IMPOSSIBLE, Status.OK, Status.IMPOSSIBLE]
    assert list(data["status_rest"].values) == [Status.OK] * 3


@pytest.mark.parametrize(
    ("asked", "sentence"),
    [
        (Quantity("margins.wals_fit"), "There is no rule 'wals_fit'"),
        (Quantity("margins.chambers_apart"), "is not known at rest: say in which state"),
        (Quantity("margins.fingers_apart", PRESSURE), "Ruled has no rule 'fingers_apart'; it has: walls_fit"),
    ],
)
def test_margins_that_are_not_there_are_named(asked, sentence):
    with pytest.raises(ValueError, match=sentence):
        problem(Goal("maximise", asked))


def test_rules_that_are_not_there_are_named():
    with pytest.raises(ValueError, match="ignore_rules has 'wall_fit', which is no rule; did you mean 'walls_fit'"):
        problem(ignore_rules=["wall_fit"])


def test_configs_ignore_rules_by_name(tmp_path):
    text = (ROOT / "configs" / "shell_grasp.toml").read_text()
    path = tmp_path / "config.toml"
    path.write_text(text.replace("[design]", '[design]\nignore_rules = ["walls_fit"]'))
    assert settings.read(configs.load(path)).problem.ignored == ("walls_fit",)
    path.write_text(text.replace("[design]", '[design]\nignore_rules = ["wall_fit"]'))
    with pytest.raises(ConfigError, match=r"\[design\]: ignore_rules has 'wall_fit'.*did you mean 'walls_fit'"):
        settings.read(configs.load(path))
    path.write_text(text.replace('minimise = "pressure_kPa"', 'minimise = "margins.wall_fit_mm"'))
    with pytest.raises(ConfigError, match=r"the margin of a rule is 'margins\.wall_fit_mm'; did you mean"):
        settings.read(configs.load(path))


def test_margins_are_keys_with_their_unit():
    scenes = {"scene": sg.pneunet.TipContact(FINGER)}
    for at in (None, {"pressure_kPa": 31}):  # the parts at rest are the same in every state
        found, unit = quantity(scenes, "margins.walls_fit_mm", at, "here")
        assert (found.observable, found.at, unit) == ("margins.walls_fit", "rest", 1e-3)
    assert kind_of(found, scenes) == "length"
    with pytest.raises(ConfigError, match=r"here: margins\.chambers_apart of TipContact is not known at rest"):
        quantity(scenes, "margins.chambers_apart_mm", None, "here")
    with pytest.raises(ConfigError, match=r"margins\. and a rule"):
        quantity(scenes, "walls_fit_mm", None, "here")


def test_scenes_keep_the_rules_that_they_ignore_in_a_config(tmp_path):
    scene = sg.shell.Free(shell(), ignored_rules=("walls_fit", "fingers_apart"))
    path = tmp_path / "config.toml"
    path.write_text(configs.dump(scene))
    assert configs.load(path).scene.ignored_rules == ("walls_fit", "fingers_apart")
    assert "ignored_rules" not in configs.dump(sg.shell.Free(shell()))
    for wrong in ('"walls_fit"', '["wall_fit"]', "[1]"):
        path.write_text(configs.dump(sg.shell.Free(shell())).replace("[scene]", f"[scene]\nignored_rules = {wrong}"))
        with pytest.raises(ConfigError, match="ignored_rules is"):
            configs.load(path)


# --- one finger, one law ----------------------------------------------------------------------------------------------


def space(blocked, free, names=("finger.H",)):
    return Space({"blocked": blocked, "free": free}, [Variable(name, 4 * mm, 7 * mm) for name in names])


def test_a_finger_under_two_laws_is_refused():
    blocked, free = sg.pneunet.TipContact(FINGER), sg.pneunet.Free(FINGER, weight=(0, 0))
    goals = [Goal("maximise", Quantity("tip_force", 31 * kPa, "blocked"))]
    sentence = (
        "The scenes blocked and free share a finger, but treat it by different laws: "
        "inclination is 'none' in blocked and 'segment' in free"
    )
    with pytest.raises(ValueError, match=f"{sentence}; give them the same, or set different_laws = true"):
        Problem(space(blocked, free), goals)
    allowed = Problem(space(blocked, free), goals, different_laws=True)
    assert allowed.different_laws == (f"{sentence}.",)
    assert agreed(allowed)["different_laws"] == [f"{sentence}."]
    alike = sg.pneunet.TipContact(FINGER, inclination="segment")
    assert Problem(space(alike, free), goals).different_laws == ()


def test_a_config_may_allow_different_laws(tmp_path):
    text = (ROOT / "configs" / "finger_tip_force.toml").read_text()
    path = tmp_path / "config.toml"
    path.write_text(text.replace('inclination = "segment"', 'inclination = "none"', 1))
    with pytest.raises(ConfigError, match=r"\[design\]: The scenes blocked and free share a finger, but"):
        settings.read(configs.load(path))
    path.write_text(path.read_text().replace("[design]", "[design]\ndifferent_laws = true"))
    assert len(settings.read(configs.load(path)).problem.different_laws) == 1


def test_every_choice_and_the_material_is_a_law():
    one = sg.pneunet.TipContact(FINGER, section="thesis", inclination="segment")
    other = sg.pneunet.Free(dataclasses.replace(FINGER, material=sg.Gent(mu=136e3, j_m=50.0)), weight=(0, 0))
    [sentence] = differing_laws(space(one, other))
    assert "section is 'thesis' in blocked and 'exact' in free" in sentence
    assert "material is 'NeoHookean' in blocked and 'Gent' in free" in sentence
    assert "inclination" not in sentence


def test_fingers_that_share_nothing_may_have_laws_of_their_own():
    blocked, free = sg.pneunet.TipContact(FINGER), sg.pneunet.Free(FINGER, weight=(0, 0))
    assert differing_laws(space(blocked, free, ["blocked.finger.H", "free.finger.L"])) == []
    assert len(differing_laws(space(blocked, free, ["blocked.finger.H = free.finger.H"]))) == 1
    tied = Space(
        {"blocked": blocked, "free": free},
        [Variable("H", 4 * mm, 7 * mm, where=lambda s: (s["blocked"].finger.H, s["free"].finger.H), kind="length")],
    )
    assert len(differing_laws(tied)) == 1


def test_the_parts_of_grippers_share_laws_too():
    gripper = sg.pneunet.Gripper(FINGER, n=3)
    lift = sg.pneunet.Grasp(gripper, sg.objects.Cylinder(radius=18 * mm, mass=0.026, friction=0.96))
    free = sg.pneunet.Free(FINGER, weight=(0, 0))
    shared = Space({"lift": lift, "free": free}, [Variable("lift.gripper.finger.H = free.finger.H", 4 * mm, 7 * mm)])
    assert "inclination is 'none' in lift and 'segment' in free" in differing_laws(shared)[0]


def test_arcs_and_energy_are_laws_of_a_shell():
    arc, energy = (sg.shell.FlatContact(shell(), distance=5 * mm, model=m) for m in ("arc", "energy"))
    [sentence] = differing_laws(Space({"one": arc, "two": energy}, [THICKNESS]))
    assert "share a shell" in sentence
    assert "model is 'arc' in one and 'energy' in two" in sentence


def on_a_plane():
    """A problem of an energy membrane, whose states have as many unknowns as its basis has polynomials."""
    scene = sg.shell.ObstacleContact(shell(), sg.shell.obstacles.Plane(5 * mm), symmetry="both", across=2, lengthwise=2)
    goal = Goal("maximise", Quantity("force", at=12 * kPa))
    return Problem(Space({"held": scene}, [Variable("shell.t_m", 1.0 * mm, 2 * mm)]), [goal])


def test_energy_membranes_keep_their_rules_too():
    labels = [rule.label() for rule in on_a_plane().rules]
    assert labels == ["held.margins.membrane_clear_at_rest", "held.margins.membrane_above_clamp at 12 kPa"]


@pytest.mark.slow
def test_an_energy_membrane_is_searched_and_its_margins_are_those_of_its_state():
    problem = on_a_plane()
    best = search(problem, starts=3, steps=3, finishes=1).best
    state = sg.solve(problem.scenes_at(best.x)["held"], 12 * kPa)
    assert best.feasible
    assert best.x[0] == pytest.approx(1 * mm, rel=1e-9)  # the thinnest wall inflates most
    assert best.values[0] == pytest.approx(float(state.force), rel=1e-9)
    assert best.margins == pytest.approx([float(state.margins[rule.rule]) for rule in problem.rules], rel=1e-9)


def test_a_bound_that_is_broken_is_not_broken_by_nothing():
    """Of a robust design, which may end a few millionths beyond its bound, the table said "broken by 0.00%"."""
    assert [runs._room(one) for one in (0.05, 2.2e-6, 9e-7, -0.2)] == [
        "broken by 5.00%",
        "broken by 2.2e-06 of it",
        "on it",
        "room 20.0%",
    ]
