"""Goals and limits: the quantities are those of the library, their slopes are right, and failure leads back."""

import copy

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import ROD, shell

import softgrip_jax as sg
from optim.design.descent import Evaluator, Memory, evaluated
from optim.problem import NEAR_LIMIT, Goal, GoalKind, Limits, Problem, Quantity, Scaling
from optim.space import Space, Variable
from softgrip_jax.commands import programs
from softgrip_jax.errors import InputError
from softgrip_jax.results import Status
from softgrip_jax.units import gram, kPa, mm

PRESSURE = 15 * kPa


def scenes():
    return {
        "lift": sg.shell.Grasp(shell(), mass=563 * gram, friction=0.96, **ROD),
        "free": sg.shell.Free(shell()),
    }


@pytest.fixture(scope="module")
def problem():
    tied = " = ".join(f"{scene}.shell.{{0}}" for scene in ("lift", "free"))
    variables = [
        Variable(tied.format("a"), 8 * mm, 24 * mm),
        Variable(tied.format("b"), 25 * mm, 60 * mm),
        Variable(tied.format("t_m"), 0.4 * mm, 2 * mm, "log"),
    ]
    goals = [
        Goal("minimise", Quantity("pressure", "required", "lift"), weight=2.0),
        Goal("reach", Quantity("inflation", PRESSURE, "free"), target=14 * mm),
    ]
    limits = [
        Limits(Quantity("limit_margin", "required", "lift"), low=1.25),
        Limits(Quantity("stretch", PRESSURE, "free"), low=1.0, high=1.5),
        Limits(Quantity("limit_pressure", None, "free"), low=10 * kPa),
    ]
    return Problem(Space(scenes(), variables), goals, limits)


# Unit values: a good design, one whose grasp is beyond its limit, one whose free inflation is, one that cannot exist.
GOOD, WEAK, THIN, WRONG = [0.5, 0.5, 0.6], [0.3, 0.02, 0.35], [0.9, 0.9, 0.05], [1.0, -0.2, 0.5]


@pytest.fixture(scope="module")
def measured(problem):
    """Every point with its steps for central differences, in one batch."""
    step = 1e-5
    points = [np.array(p) + step * k * e for p in (GOOD, WEAK, THIN, WRONG) for k in (0, 1, -1) for e in np.eye(3)]
    found, slopes = problem.measured_with_slopes(jnp.array(points))
    shape = (4, 3, 3)  # point, step, variable

    def numeric(values):
        values = np.asarray(values).reshape(*shape, *values.shape[1:])
        return np.moveaxis((values[:, 1] - values[:, 2]) / (2 * step), 1, -1)

    first = [0, 9, 18, 27]
    return found, slopes, numeric(found.values), numeric(found.shortfall), first


def test_quantities_are_the_answers_of_the_library(problem, measured):
    found, _, _, _, first = measured
    changed = problem.space.scenes_at(problem.space.from_unit(jnp.array(GOOD)))
    lift, free = sg.pressure_for(changed["lift"]), sg.solve(changed["free"], PRESSURE)
    expected = {
        "lift.pressure at required": lift.pressure,
        "free.inflation at 15 kPa": free.inflation,
        "lift.limit_margin at required": sg.limit_pressure(changed["lift"]) / lift.pressure,
        "free.stretch at 15 kPa": free.stretch,
        "free.limit_pressure": sg.limit_pressure(changed["free"]),
    }
    assert [problem.label(q) for q in problem.quantities] == list(expected)
    expected["lift.margins.membranes_apart at required"] = lift.margins["membranes_apart"]
    np.testing.assert_allclose(found.values[first[0]], list(expected.values()), rtol=1e-10)
    assert float(found.shortfall[first[0]]) == 0


def test_slopes_are_finite_differences(measured):
    found, slopes, by_value, by_shortfall, first = measured
    scale = np.abs(np.asarray(found.values))[first[0]][:, None]
    np.testing.assert_allclose(slopes.values[first[0]] / scale, by_value[0] / scale, rtol=1e-6, atol=1e-7)
    for k in range(1, 4):
        np.testing.assert_allclose(slopes.shortfall[first[k]], by_shortfall[k], rtol=1e-6, atol=1e-7)


def test_a_task_out_of_reach_falls_short_by_what_the_limit_leaves(problem, measured):
    found, slopes, _, _, first = measured
    lift = problem.space.scenes_at(problem.space.from_unit(jnp.array(WEAK)))["lift"]
    assert int(sg.pressure_for(lift).status) == Status.BEYOND_LIMIT
    reached = sg.solve(lift, NEAR_LIMIT * sg.limit_pressure(lift)).security
    short = 1 - float(reached)
    assert short > 0
    np.testing.assert_allclose(found.shortfall[first[1]], short, rtol=1e-9)
    assert np.all(np.isfinite(slopes.shortfall[first[1]]))
    assert np.any(np.asarray(slopes.shortfall[first[1]]) != 0)


def test_a_pressure_out_of_reach_falls_short_by_the_limit_pressure(problem, measured):
    found, _, _, _, first = measured
    free = problem.space.scenes_at(problem.space.from_unit(jnp.array(THIN)))["free"]
    limit = float(sg.limit_pressure(free))
    assert limit < PRESSURE
    expected = 1 / NEAR_LIMIT - limit / PRESSURE
    assert float(found.shortfall[first[2]]) >= expected * (1 - 1e-9)
    assert Status.BEYOND_LIMIT in np.asarray(found.statuses[first[2]])


def test_the_impossible_is_led_back_to_the_start(problem, measured):
    found, slopes, _, _, first = measured
    assert Status.IMPOSSIBLE in np.asarray(found.statuses[first[3]])
    home = problem.space.to_unit(problem.space.reference)
    towards = home - np.array(WRONG)
    assert float(towards @ np.asarray(slopes.shortfall[first[3]])) < 0


def test_what_touches_nothing_falls_short_by_the_contact_pressure():
    def scene_of(t):
        membrane = eqx.tree_at(lambda s: s.a, shell(), jnp.asarray(8 * mm + 16 * mm * t))
        return sg.shell.FlatContact(membrane, distance=5 * mm)

    scene, pressure = scene_of(0.5), 500.0
    space = Space({"plane": scene}, [Variable("shell.a", 8 * mm, 24 * mm)])
    far = Problem(space, [Goal("maximise", Quantity("force", pressure))])
    for start in (0.5, 0.9):  # not towards the start, which touches nothing itself
        found, slopes = far.measured_with_slopes(jnp.array([[0.6]]), jnp.array([start]))
        assert [Status(int(s)) for s in found.statuses[:, 0]] == [Status.NO_CONTACT]
        short, lower, upper = (float(sg.contact_pressure(scene_of(t))) / pressure for t in (0.6, 0.5999, 0.6001))
        np.testing.assert_allclose(found.shortfall[0], short - NEAR_LIMIT, rtol=1e-9)
        np.testing.assert_allclose(slopes.shortfall[0, 0], (upper - lower) / 2e-4, rtol=1e-5)


def test_a_search_says_the_same_from_the_limits_alone(problem, measured, monkeypatch):
    """Where a design nearby leads to no state, each state that is missing is asked by itself, by a smaller program."""
    found, slopes, _, _, first = measured
    points = np.array([GOOD, WEAK, THIN, WRONG])
    evaluate = Evaluator(problem, len(points))
    along = evaluated(jax.tree.map(lambda v: np.array(v[np.array(first)]), found._replace(solutions=())), 3)
    asked = jax.tree.map(np.ones_like, along)
    np.testing.assert_array_equal(evaluate._short(points, asked, np.arange(4), along), [0])
    lost = np.array(first)[1:]
    np.testing.assert_allclose(asked.shortfall[1:], found.shortfall[lost], rtol=1e-9)
    np.testing.assert_allclose(asked.shortfall_slopes[1:], slopes.shortfall[lost], rtol=1e-7, atol=1e-9)
    np.testing.assert_array_equal(asked.statuses[1:], found.statuses[lost])
    assert np.all(np.isfinite(asked.value_slopes[1:]))

    # The same where limit points are known, and no design with the state.
    evaluate.is_near, evaluate.states, evaluate.limits = True, [Memory(3)], [Memory(3)]
    evaluate.limits[0].remember(points, points, np.ones(4, bool))
    monkeypatch.setattr(evaluate, "prepare", lambda: None)
    monkeypatch.setattr(evaluate, "begin", lambda t: jax.tree.map(lambda v: v[1:], along))
    monkeypatch.setattr(evaluate, "_look_for_limits", lambda t, found, of, rows: np.arange(len(found.values[rows])))
    lost = evaluate(points[1:])
    np.testing.assert_array_equal(lost.shortfall, asked.shortfall[1:])
    np.testing.assert_array_equal(lost.shortfall_slopes, asked.shortfall_slopes[1:])
    assert np.all(np.isfinite(lost.value_slopes))


def test_judgement_by_hand(problem):
    values = np.array([12 * kPa, 13 * mm, 1.1, 1.6, 8 * kPa, 2.5 * mm])
    scales = problem.scales([10 * kPa, 1.0, 1.0, 1.0, 1.0])
    judged = problem.score(jnp.array(values), scales)
    np.testing.assert_allclose(judged.objective, 2 * 1.2 + (1 / 14) ** 2, rtol=1e-12)
    expected = [(1.25 - 1.1) / 1.25, (1.0 - 1.6) / 1.0, (1.6 - 1.5) / 1.5, (10 - 8) / 10, -2.5]
    np.testing.assert_allclose(judged.violations, expected, rtol=1e-12)
    assert problem.constraint_labels() == [
        "lift.limit_margin at required at least 1.25",
        "free.stretch at 15 kPa at least 1",
        "free.stretch at 15 kPa at most 1.5",
        "free.limit_pressure at least 10 kPa",
        "rule lift.membranes_apart at required",
    ]


def test_unknown_values_count_for_nothing(problem):
    scales = problem.scales([10 * kPa, 1.0, 1.0, 1.0, 1.0])
    judged = problem.score(jnp.full(6, jnp.nan), scales)
    assert float(judged.objective) == 0
    np.testing.assert_array_equal(judged.violations, np.zeros(5))


def test_what_has_no_end_is_large_and_not_unknown():
    """A membrane without a largest pressure is the best where that is wanted, and breaks an upper bound."""
    space = Space({"free": sg.shell.Free(shell())}, [Variable("shell.t_m", 1 * mm, 2 * mm)])
    largest = Quantity("limit_pressure")

    def score(goal, value):
        wanted = Problem(space, [goal], [Limits(largest, low=10 * kPa, high=30 * kPa)])
        judged = wanted.score(jnp.full(1, value), wanted.scales([20 * kPa]))
        return float(judged.objective), np.asarray(judged.violations)

    best = Goal("maximise", largest)
    assert score(best, np.inf)[0] < score(best, 1e3 * kPa)[0]
    assert score(Goal("reach", largest, target=20 * kPa), np.inf)[0] > 1e3
    low, high = score(best, np.inf)[1]
    assert low < 0 < high
    assert score(best, np.nan) == (0.0, pytest.approx([0, 0]))


def test_terms_of_what_has_no_end_are_those_of_the_score():
    space = Space({"free": sg.shell.Free(shell())}, [Variable("shell.t_m", 1 * mm, 2 * mm)])
    problem = Problem(space, [Goal("maximise", Quantity("limit_pressure"))])
    scales, values = problem.scales([20 * kPa]), jnp.full(1, np.inf)
    (term,) = problem.terms(values, scales)
    assert float(term) == float(problem.score(values, scales).objective) == -100
    assert not np.any(jax.jacfwd(problem.terms)(values, scales))


def test_scales_come_from_the_first_design_that_gives_one():
    """The start (first row) has no force and a pressure of zero, the next design neither, the third has both."""
    goals = [
        Goal("minimise", Quantity("pressure", ("force", 2.0), "lift")),
        Goal("maximise", Quantity("force", 1e3, "lift"), weight=2.0),
        Goal("reach", Quantity("stretch", 1e3, "lift"), target=1.2),
        Goal("minimise", Quantity("height", 1e3, "lift")),
    ]
    problem = _make(goals, [Limits(Quantity("height", 1e3, "lift"), low=0.0, high=7 * mm)])
    scaling = Scaling(problem)
    # Until a design gives them a size: the unit that people read, but where there is a bound that.
    assert scaling.scales == (pytest.approx((kPa, 1.0, 1.2, 7 * mm)), pytest.approx((7 * mm, 7 * mm)))
    scaling.learn([0.0, np.nan, 1.1, np.nan])
    assert scaling.missing() == [0, 1, 3]
    scaling.learn([[np.nan] * 4, [3e3, -5.0, 1.1, np.nan], [4e3, 6.0, 1.1, np.nan]])
    assert scaling.scales == (pytest.approx((3e3, 5.0, 1.2, 7 * mm)), pytest.approx((7 * mm, 7 * mm)))
    scaling.learn([1.0, 1.0, 1.0, 1.0])  # what is known stays
    assert scaling.scales == (pytest.approx((3e3, 5.0, 1.2, 1.0)), pytest.approx((1.0, 7 * mm)))
    assert scaling.remarks()[0] == (
        "lift.pressure at force 2 N has no size at the starting design: its scale is 3 kPa, its size at the first "
        "design that has one; the key scale beside it sets another."
    )
    assert len(scaling.remarks()) == 3


def test_a_scale_that_is_stated_needs_no_design():
    problem = _make([Goal("minimise", Quantity("force", 1e3, "lift"), scale=7.0)])
    scaling = Scaling(problem)
    scaling.learn([np.nan])
    assert scaling.scales.goals == (7.0,)
    assert not scaling.missing()
    assert not scaling.remarks()


def _make(goals, limits=()):
    return Problem(Space(scenes(), [Variable("lift.gap", 2 * mm, 9 * mm)]), goals, limits)


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: _make([]), "There is no goal"),
        (lambda: _make([Goal("shrink", Quantity("force", 1e3, "lift"))]), "'shrink' is not known"),
        (lambda: _make([Goal("reach", Quantity("force", 1e3, "lift"))]), "'reach' needs a target"),
        (lambda: _make([Goal("minimise", Quantity("force", 1e3, "drop"))]), "must be one of lift, free"),
        (
            lambda: _make([Goal("minimise", Quantity("froce", 1e3, "lift"))]),
            "Grasp has no observable 'froce'; it has: force",
        ),
        (lambda: _make([Goal("minimise", Quantity("force", None, "lift"))]), "needs a state"),
        (lambda: _make([Goal("minimise", Quantity("force", "soon", "lift"))]), "the state must be a pressure"),
        (lambda: _make([Goal("minimise", Quantity("force", -1.0, "lift"))]), "must be a finite number, zero or more"),
        (lambda: _make([Goal("minimise", Quantity("force", np.nan, "lift"))]), "the pressure must be a finite number"),
        (
            lambda: Goal(GoalKind("near", lambda *_: 0.0, has_target=True), Quantity("force", 1e3, "lift")),
            "'near' needs a target",
        ),
        (lambda: Goal("minimise", Quantity("force", 1e3, "lift"), target=1.0), "'minimise' takes no target"),
        (
            lambda: _make([Goal("minimise", Quantity("force", 1e3, "lift"))], [Limits(Quantity("force", 1e3, "lift"))]),
            "has no bound",
        ),
        (lambda: Goal("reach", Quantity("force", 1e3, "lift"), target=np.nan), "must be a finite number"),
        (lambda: Goal("minimise", Quantity("force", 1e3, "lift"), weight=-1.0), "weight for .* must be zero or more"),
        (lambda: Goal("minimise", Quantity("force", 1e3, "lift"), scale=0.0), "scale for .* must be above zero"),
        (lambda: Limits(Quantity("force", 1e3, "lift"), high=np.inf), "must be a finite number"),
        (lambda: Limits(Quantity("force", 1e3, "lift"), high=1.0, scale=-1.0), "scale for .* must be above zero"),
    ],
)
def test_mistakes_are_named(make, sentence):
    with pytest.raises(ValueError, match=sentence):
        make()


class OnlyThick(sg.solvers.ExplicitCurve):
    """A solver that knows no limit pressure of thin membranes."""

    def limit_pressure_from(self, scene, found):
        return jnp.where(scene.shell.t_m > 1 * mm, super().limit_pressure_from(scene, found), jnp.nan)


class Unsure(sg.shell.Free):
    """A membrane whose limit pressure is not known where it is thin."""

    no_key: tuple = eqx.field(static=True, kw_only=True)  # keeps the class out of configs

    def solver(self):
        return OnlyThick()


def test_a_problem_may_be_asked_within_a_jitted_function_first():
    """Which rules are held is told by numbers, and was asked of traced ones."""
    space = Space({"held": sg.pneunet.Linear(sg.PneuNet.table_5_1("A"))}, [Variable("finger.a", 4 * mm, 7 * mm)])
    problem = Problem(space, [Goal("maximise", Quantity("tip_force", 3 * kPa))])
    found = jax.eval_shape(problem.measure, jnp.array([0.5]))
    assert found.values.shape == (len(problem.measured.quantities),)
    assert "mould_range" in {rule.rule for rule in problem.rules}


def test_what_is_not_known_keeps_no_constraint():
    space = Space({"free": Unsure(shell(), no_key=())}, [Variable("shell.t_m", 0.8 * mm, 1.8 * mm)])
    goals = [Goal("maximise", Quantity("inflation", 10 * kPa))]
    wanted = Problem(space, goals, [Limits(Quantity("limit_margin", 10 * kPa), low=1.2)])
    found, slopes = wanted.measured_with_slopes(jnp.array([[0.1], [0.4]]))
    assert [Status(int(s)) for s in found.statuses[:, 0]] == [Status.OK, Status.OK]
    assert float(found.shortfall[0]) > 0
    assert float(slopes.shortfall[0, 0]) < 0, "the way back is towards the start"
    assert float(found.shortfall[1]) == 0


def test_where_jax_keeps_no_programs_none_are_prepared(problem, tmp_path, monkeypatch):
    """JAX_ENABLE_COMPILATION_CACHE=0: the search then compiles what it needs when it needs it."""
    monkeypatch.setattr(programs, "_folder", tmp_path)
    alone = copy.copy(problem)
    alone.about, alone._programs = "this test", {}
    jax.config.update("jax_enable_compilation_cache", False)
    try:
        alone.prepare(4, 8, 4)
    finally:
        jax.config.update("jax_enable_compilation_cache", True)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("term", "said"),
    [
        (
            lambda goal, value, scale: 1.0 if value > 0 else 0.0,
            r"cannot be differentiated by JAX \(line \d+ of test_prob",
        ),
        (lambda goal, value, scale: np.log(value), "cannot be .*; use jax.numpy in place of math and NumPy"),
        (lambda goal, value, scale: jnp.stack([value]), r"gives an array of the shape \(1,\); it must be one number"),
        (lambda goal, value, scale: None, "gives None; it must be one number"),
        (lambda goal, value: value, "raises TypeError: .* takes 2 positional arguments but 3 were given"),
    ],
)
def test_the_term_of_a_kind_of_ones_own_is_a_number(term, said):
    """It ended in a trace-back of JAX in the middle of a search."""
    with pytest.raises(InputError, match=f"^The term of the goal kind 'own' {said}"):
        Goal(GoalKind("own", term), Quantity("force", 1e3, "lift"))
