"""The search: known optima of published problems, and the shell gripper against SciPy's differential evolution."""

import dataclasses
import importlib
import signal
import threading
from unittest.mock import Mock

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest
from conftest import ROOT
from helpers import MATERIALS, shell
from scipy.optimize import differential_evolution

import softgrip_jax as sg
from optim.design import settings
from optim.design.descent import FEASIBLE, Design, search
from optim.design.front_run import errors_of_shells, near_limits, of_materials
from optim.design.run import _batch
from optim.problem import Goal, Limits, Measured, Problem, Quantity
from optim.space import Space, Variable
from softgrip_jax import config as configs
from softgrip_jax.commands import programs
from softgrip_jax.errors import ConfigError, InputError
from softgrip_jax.model_error import model_error
from softgrip_jax.quantities import QuantitySet
from softgrip_jax.results import Status
from softgrip_jax.units import gram, kPa, mm

searching = importlib.import_module("optim.design.descent")  # the package's own `search` is the function


class Formulas(Problem):
    """A problem of mathematics instead of physics: quantities are formulas of the variables, the first the objective.

    The scene only lends its numbers to be the variables.
    """

    LEAVES = ("shell.a", "shell.b", "shell.t_m", "gap")

    def __init__(self, formulas, low, high, limits=(), start=None):
        scene = sg.shell.Grasp(shell(), radius=20 * mm, gap=5 * mm, ignored_rules=("membranes_apart",))
        names = [self.LEAVES[k] for k in range(len(low))]
        space = Space({"toy": scene}, [Variable(n, lo, hi) for n, lo, hi in zip(names, low, high, strict=True)])
        space.reference = np.array(start, dtype=float) if start is not None else 0.5 * (space.low + space.high)
        # Any observable will do: `measure` below gives them their values.
        labels = list(sg.shell.Grasp.OBSERVABLES)
        quantities = [Quantity(labels[k], "required", "toy") for k in range(len(formulas))]
        sides = [Limits(q, high=bound, scale=1.0) for q, bound in zip(quantities[1:], limits, strict=True)]
        super().__init__(space, [Goal("minimise", quantities[0], scale=1.0)], sides)
        self.formulas = formulas

    def measure(self, t, home=None):
        x = self.space.from_unit(t)
        return Measured(jnp.stack([f(x) for f in self.formulas]), jnp.asarray(0.0), jnp.zeros(1, int))


def rosen_suzuki():
    """Hock and Schittkowski 1981, problem 43: the optimum is -44 at (0, 1, 2, -1), the first and third limit active."""

    def objective(x):
        a, b, c, d = x
        return a**2 + b**2 + 2 * c**2 + d**2 - 5 * a - 5 * b - 21 * c + 7 * d

    limits = [
        lambda x: x[0] ** 2 + x[1] ** 2 + x[2] ** 2 + x[3] ** 2 + x[0] - x[1] + x[2] - x[3],
        lambda x: x[0] ** 2 + 2 * x[1] ** 2 + x[2] ** 2 + 2 * x[3] ** 2 - x[0] - x[3],
        lambda x: 2 * x[0] ** 2 + x[1] ** 2 + x[2] ** 2 + 2 * x[0] - x[1] - x[3],
    ]
    return Formulas([objective, *limits], [-3.0] * 4, [3.0] * 4, [8.0, 10.0, 5.0])


def test_constrained_optimum_is_the_published_one():
    found = search(rosen_suzuki(), starts=16, steps=60)
    assert found.best.objective == pytest.approx(-44, abs=1e-5)
    np.testing.assert_allclose(found.best.x, [0, 1, 2, -1], atol=1e-4)
    assert found.best.violation <= FEASIBLE
    assert found.best.active == ("force_z at required at most 8 N", "flat_length at required at most 5000 mm")


@pytest.mark.parametrize("size", [1.0, 1e6, 1e9])
def test_a_feasible_design_is_feasible_however_large_its_objective(size):
    """A weight, a small scale or a small target make it so; it passed for a design that breaks a constraint."""
    limits = [lambda x: -x[0] * x[1]]  # the optimum is 2 at (1, 1)
    problem = Formulas([lambda x: size * (x[0] ** 2 + x[1] ** 2), *limits], [0.1, 0.1], [3.0, 3.0], [-1.0])
    found = search(problem, starts=8, steps=30)
    assert found.best.feasible
    assert found.best.answered
    assert found.best.objective == pytest.approx(2 * size, rel=1e-5)
    np.testing.assert_allclose(found.best.x, 1.0, rtol=1e-3)


def test_designs_that_differ_in_what_nothing_depends_on_are_one():
    """There were several "distinct" designs of the same values, and no word about it."""

    def found(limited):
        problem = Formulas([lambda x: (x[0] - 1) ** 2 + 1, limited], [0.0] * 3, [3.0] * 3, [8.0])
        return search(problem, starts=8, steps=30)

    several = found(lambda x: x[0] + x[1] + x[2])
    assert len(several.designs) > 1
    assert not several.remarks
    one = found(lambda x: x[0])
    assert one.reached == (8,)
    (said,) = one.remarks
    assert said.startswith("Nothing that is asked for depends on shell.b, shell.t_m: ")


def test_a_goal_that_no_variable_changes_is_named():
    problem = Formulas([lambda x: 3.0 + 0 * x[0], lambda x: x[0] + x[1]], [0.0] * 2, [3.0] * 2, [5.0])
    name = problem.label(problem.goals[0].quantity)
    found = search(problem, starts=8)
    assert found.remarks == (f"No variable changes {name}: as a goal it prefers no design to another.",)


def test_a_start_outside_of_the_bounds_is_named():
    """Its design is a column of the report, and the search begins elsewhere."""
    found = search(Formulas([lambda x: x[0] ** 2 + x[1]], [1.0] * 2, [3.0] * 2, start=[2.0, 4.0]), starts=2, steps=2)
    assert found.remarks == (
        "The start is outside of the bounds of shell.b: the search begins from the nearest bound.",
    )


def test_a_start_at_several_values_of_one_number_is_named(monkeypatch):
    """A column of the report was about another start than the one that was given."""
    monkeypatch.setattr(Formulas, "LEAVES", ("shell.a = shell.b", "shell.t_m"))
    found = search(Formulas([lambda x: x[0] ** 2 + x[1]], [1.0] * 2, [3.0] * 2), starts=2, steps=2)
    assert found.remarks == (
        "shell.a = shell.b is one number, of which the scenes have 16 mm, 43 mm: the start has the first.",
    )


def test_the_report_tells_where_the_best_design_is_stretched_too_far():
    """Only of the best design, and by the state; a problem may have states that were not solved for."""
    free = sg.shell.Free(shell())
    goals = [Goal("maximise", Quantity("inflation", at=19 * kPa)), Goal("minimise", Quantity("stretch", at=15 * kPa))]
    problem = Problem(Space({"free": free}, [Variable("shell.t_m", 1 * mm, 2 * mm)]), goals)
    near, far = (sg.solve(free, p * kPa) for p in (15, 19))
    (words,) = of_materials(problem, {("free", 19 * kPa): [near, far]}, 1, 1)
    assert words.startswith("Design 1, 19 kPa: stretch 1.74 is more than the 1.5 or so")
    assert of_materials(problem, {("free", 19 * kPa): [far, near]}, 1, 1) == []


def test_the_error_of_a_force_is_told_where_its_pressure_is_sought():
    rod = sg.shell.CylinderContact(shell(), radius=20 * mm, gap=5 * mm)
    space = Space({"rod": rod}, [Variable("shell.t_m", 0.8 * mm, 2 * mm)])
    problem = Problem(space, [Goal("minimise", Quantity("pressure", ("force", 12.0)))])
    known = f"force: {model_error(rod, 'force')}."
    for status, told in ((Status.OK, [known]), (Status.NO_CONTACT, []), (Status.BEYOND_LIMIT, [])):
        assert errors_of_shells(problem, Mock(spec=Design, x=space.reference, statuses=(status,))) == told


def test_limits_that_contradict_each_other_are_refused():
    scene = sg.shell.Free(shell())
    space, height = Space({"free": scene}, [Variable("shell.t_m", 1 * mm, 2 * mm)]), Quantity("inflation", at=15 * kPa)
    goals, least = [Goal("minimise", Quantity("stretch", at=15 * kPa))], Limits(height, low=14 * mm)
    with pytest.raises(InputError, match="inflation at 15 kPa contradict each other: at least 14 mm and at most 12 mm"):
        Problem(space, goals, [least, Limits(height, high=12 * mm)])
    Problem(space, goals, [least, Limits(height, high=14 * mm)])


def test_the_descent_alone_comes_near():
    found = search(rosen_suzuki(), starts=16, steps=300, learning_rate=0.1, finishes=0)
    assert found.best.objective == pytest.approx(-44, rel=2e-3)
    assert found.descended == found.best.objective
    assert found.paths.shape == (len(found.history["moving"]), 16)
    assert np.nanmin(found.paths) == pytest.approx(-44, rel=2e-3)
    assert 12 <= found.reached[0] <= 16  # a convex problem
    said = _batch(found)
    assert said.startswith("16 designs descended at once: ")
    assert "finish" not in said
    finished = dataclasses.replace(found, descended=0.999 * found.best.objective)
    assert _batch(finished).endswith(" The finish improved the objective of the best of them by 0.1%.")


def test_a_large_gain_of_the_finish_is_told_by_both_values():
    """A fall from 4.77e-4 to 6.67e-7 was "7e+02 of its objective"; a goal that is maximised grows."""
    found = search(rosen_suzuki(), starts=1, steps=1, finishes=0)

    def said(before, after, kind):
        goals = [Goal(kind, found.problem.goals[0].quantity, target=1.0 if kind == "reach" else None)]
        best = dataclasses.replace(found.best, objective=after, feasible=True)
        problem = Problem(found.problem.space, goals)
        changed = dataclasses.replace(found, problem=problem, designs=[best, *found.designs[1:]], descended=before)
        return _batch(changed).partition("The finish ")[2]

    assert said(4.77e-4, 6.67e-7, "reach") == "improved the objective of the best of them from 0.00048 to 6.7e-07."
    assert said(-1.0, -1.5, "maximise") == "improved the objective of the best of them from 1 to 1.5."
    assert said(-1.0, -1.0 - 2e-7, "maximise") == "improved the objective of the best of them by 2e-05%."
    assert said(0.0, -0.2, "minimise") == "improved the objective of the best of them from 0 to -0.2."
    assert said(-1.0, -1.0, "maximise") == ""


def test_any_transformation_of_optax_will_do():
    rule = optax.chain(optax.scale_by_adam(), optax.scale(-0.05))
    found = search(rosen_suzuki(), starts=8, steps=100, optimiser=rule)
    assert found.best.objective == pytest.approx(-44, abs=1e-5)


def test_the_memory_finds_the_nearest_and_forgets_the_oldest(monkeypatch):
    monkeypatch.setattr(searching, "REMEMBERED", 32)
    rng, memory = np.random.default_rng(4), searching.Memory(3)
    seen = rng.random((50, 3))
    for start in range(0, 50, 7):  # 7 does not divide 32: what is written goes round
        rows = seen[start : start + 7]
        memory.remember(rows, {"name": np.arange(start, start + len(rows))}, np.ones(len(rows), bool))
    asked = rng.random((20, 3))
    nearest, squared = memory.nearest(asked)
    distances = np.sum((asked[:, None] - seen[-32:]) ** 2, axis=2)
    np.testing.assert_array_equal(memory.places["name"][nearest], 18 + np.argmin(distances, axis=1))
    np.testing.assert_allclose(squared, distances.min(axis=1), rtol=1e-12)
    # Steps that grow without bound come to no number: that design begins anywhere, the others where they did.
    beyond, _ = memory.nearest(np.concatenate([asked[:1], np.full((1, 3), np.nan)]))
    assert beyond[0] == nearest[0]
    assert 0 <= beyond[1] < 32


def test_a_finger_is_solved_from_the_nearest_one(tmp_path, monkeypatch):
    """By the same numbers as along the whole way, with derivatives that differences confirm; in a command, which has
    the programs made that it needs, and no others."""
    monkeypatch.setattr(programs, "_folder", tmp_path)
    finger = sg.PneuNet(**{k: v * mm for k, v in SIZES.items()}, material=MATERIALS["neo"]())
    held = sg.pneunet.TipContact(finger, points=6)
    space = Space({"held": held}, [Variable("finger.a", 4 * mm, 6 * mm), Variable("finger.H", 4 * mm, 6 * mm)])
    force = Quantity("tip_force", 25 * kPa, "held")
    problem = Problem(space, [Goal("maximise", force)])
    problem.about = "this test"
    evaluate = searching.Evaluator(problem, 4)
    t = np.random.default_rng(3).uniform(0.05, 0.95, (40, 2))
    found, whole = evaluate(t), evaluate.solve(t)
    assert np.all(found.shortfall == 0)
    np.testing.assert_allclose(found.values, whole.values, rtol=1e-9)
    step = 1e-4
    for k in range(2):
        up, down = (evaluate.solve(t + sign * step * np.eye(2)[k]).values[:, 0] for sign in (1, -1))
        np.testing.assert_allclose(found.value_slopes[:, 0, k], (up - down) / (2 * step), rtol=1e-4)
    assert len(evaluate.states[0].at) == 41  # the first one is solved along the whole way, and then again from there
    assert len(problem._programs) == len(list(tmp_path.glob("*.traced"))) == 2


@pytest.mark.slow
def test_beyond_a_limit_point_a_finger_says_how_far():
    """From the limit points of others, as `Problem.measured_with_slopes` says it with derivatives of the whole way."""
    finger = sg.PneuNet(**{k: v * mm for k, v in SIZES.items()}, material=MATERIALS["neo"]())
    held = sg.pneunet.TipContact(finger, points=6)
    space = Space({"held": held}, [Variable("finger.a", 4.5 * mm, 5.5 * mm), Variable("finger.H", 4 * mm, 5 * mm)])
    problem = Problem(space, [Goal("maximise", Quantity("tip_force", 40 * kPa, "held"))])
    evaluate = searching.Evaluator(problem, 8)
    t = np.random.default_rng(4).uniform(0.05, 0.95, (16, 2))
    found = evaluate(t)
    t = t + 0.01
    found = evaluate(t)  # now from limit points of before
    whole, slopes = jax.tree.map(np.asarray, problem.measured_with_slopes(t))
    lost = whole.shortfall > 0
    assert 0 < np.sum(lost) < len(t)
    np.testing.assert_array_equal(found.shortfall > 0, lost)
    np.testing.assert_allclose(found.shortfall, whole.shortfall, atol=1e-7)
    np.testing.assert_allclose(found.shortfall_slopes[lost], slopes.shortfall[lost], rtol=2e-3, atol=1e-4)
    np.testing.assert_array_equal(found.statuses, whole.statuses)
    assert np.all(found.value_slopes[lost][np.isnan(found.values[lost])] == 0)
    limits = jax.vmap(lambda t: sg.limit_pressure(space.scenes_at(space.from_unit(t))["held"]))(jnp.asarray(t))
    np.testing.assert_allclose(evaluate.solve(t).limit_margins[:, 0], limits / (40 * kPa), rtol=1e-9)
    # No design with the state has been seen yet, only limit points.
    evaluate = searching.Evaluator(problem, 8)
    for _ in range(2):
        found = evaluate(t[lost])
        assert not evaluate.can_begin
        np.testing.assert_allclose(found.shortfall, whole.shortfall[lost], atol=1e-7)
        np.testing.assert_allclose(found.shortfall_slopes, slopes.shortfall[lost], rtol=2e-3, atol=1e-4)
        assert np.all(np.isfinite(found.value_slopes))


@pytest.mark.slow
def test_a_task_out_of_reach_says_so_without_limit_points():
    """A state whose pressure is sought lies beyond no pressure: nothing is followed, and nothing fails."""
    finger = sg.PneuNet(**{k: v * mm for k, v in SIZES.items()}, material=MATERIALS["neo"]())
    held = sg.pneunet.TipContact(finger, points=6)
    space = Space({"held": held}, [Variable("finger.a", 4.5 * mm, 5.5 * mm)])
    problem = Problem(space, [Goal("minimise", Quantity("pressure", ("tip_force", 0.1), "held"))])
    assert problem.followed
    assert not problem.pressed
    evaluate = searching.Evaluator(problem, 4)
    t = np.array([[0.2], [0.6]])
    found = evaluate(t)
    np.testing.assert_array_equal(found.shortfall, 0)
    lost = found._replace(values=found.values * np.nan, shortfall=found.shortfall + 1)
    np.testing.assert_array_equal(evaluate._lost(t, lost, np.arange(2)), [0, 1])
    np.testing.assert_array_equal(evaluate._limits_first(t, lost, np.arange(2)), [0, 1])
    assert not evaluate._is_doubtful(t).any()


SIZES = {"a": 5, "b": 8, "h_x": 0.9, "t_m": 1.1, "h_L": 4.2, "H": 5, "B": 20, "L": 77}


def test_what_was_found_until_it_is_stopped_is_kept():
    seen = []

    def report(step, best, feasible, moving):
        seen.append(best)
        if step == 20:
            raise KeyboardInterrupt

    found = search(rosen_suzuki(), starts=16, steps=60, learning_rate=0.1, report=report)
    assert found.stopped
    assert len(found.history["moving"]) == 20
    # The descent charges what a design breaks by up to NEARLY, the report does not: the best one is as good or better.
    assert -44 - 1 < found.best.objective <= seen[-1] + 1e-9


def test_before_the_first_step_there_is_nothing_to_keep(monkeypatch):
    def stop(*args, **kwargs):
        raise KeyboardInterrupt

    monkeypatch.setattr(searching, "_step", stop)
    with pytest.raises(KeyboardInterrupt):
        search(rosen_suzuki(), starts=4, steps=5)


def test_a_finish_in_threads_is_stopped(monkeypatch, request):
    """Ctrl-C reaches the main thread while others solve: they are given up, and the descent's designs stay."""
    whole, asked = searching.Evaluator.__call__, []

    def evaluate(self, t):
        if threading.current_thread() is not threading.main_thread():
            asked.append(len(t))
            if len(asked) == 2:
                signal.pthread_kill(threading.main_thread().ident, signal.SIGINT)
        return whole(self, t)

    # A shell's job in the background begins with Ctrl-C ignored.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    request.addfinalizer(lambda: signal.signal(signal.SIGINT, before))
    unstopped = search(rosen_suzuki(), starts=16, steps=20)
    monkeypatch.setattr(searching.Evaluator, "__call__", evaluate)
    found = search(rosen_suzuki(), starts=16, steps=20)
    assert found.stopped
    assert len(asked) < 20  # a whole finish asks more often
    assert -44 < unstopped.best.objective + 1e-5 < found.best.objective < -40


def test_least_squares_pass_what_has_no_end():
    """A quantity that ends only at one side of the range, and is reached there, from a start without an end."""
    problem = Formulas([lambda x: jnp.where(x[0] > 2, jnp.inf, x[0] ** 2)], [0.0], [3.0], start=[2.5])
    problem.goals = (dataclasses.replace(problem.goals[0], kind="reach", target=2.25),)
    found = search(problem, starts=4, steps=5)
    np.testing.assert_allclose(found.best.x, 1.5, rtol=1e-6)


def test_a_step_that_is_stopped_between_its_records_leaves_none(monkeypatch):
    def stop(*args):
        raise KeyboardInterrupt

    monkeypatch.setattr(searching.Company, "look", stop)  # after as many steps as a period has
    found = search(rosen_suzuki(), starts=4, steps=30)
    assert found.stopped
    assert len(found.paths) == len(found.history["moving"]) == searching.PERIOD - 1


def test_every_start_is_told_of_one_design():
    """Designs may be nearer to each other than starts that are counted as near."""
    designs = np.array([[0.50, 0.5], [0.52, 0.5], [0.9, 0.9]])
    ends = np.array([[0.50, 0.5], [0.505, 0.5], [0.53, 0.51], [0.57, 0.5], [0.9, 0.88], [0.1, 0.1]])
    assert searching._reached(ends, designs) == (2, 2, 1)
    assert searching._reached(np.zeros((3, 0)), np.zeros((1, 0))) == (3,), "variables that nothing depends on"


def test_the_same_seed_gives_the_same_answer():
    problem = rosen_suzuki()
    one, two = (search(problem, starts=8, steps=20, seed=5) for _ in range(2))
    other = search(problem, starts=8, steps=20, seed=6)
    np.testing.assert_array_equal([d.x for d in one.designs], [d.x for d in two.designs])
    for name, values in one.history.items():
        np.testing.assert_array_equal(values, two.history[name])
    assert not np.array_equal(one.history["best_objective"], other.history["best_objective"])
    assert one.solves == two.solves


def test_a_second_search_of_a_problem_compiles_nothing():
    problem, compiled = rosen_suzuki(), []

    def hear(event, seconds, **more):
        if "backend_compile" in event:
            compiled.append(event)

    first = search(problem, starts=8, steps=12, finishes=1)
    jax.monitoring.register_event_duration_secs_listener(hear)
    try:
        second = search(problem, starts=8, steps=12, finishes=1)
        assert not compiled
        slower = search(problem, starts=8, steps=12, finishes=1, learning_rate=0.1)
        assert compiled  # another rate is another program
    finally:
        jax.monitoring.unregister_event_duration_listener(hear)
    np.testing.assert_array_equal(first.paths, second.paths)
    assert second.descended == first.descended != slower.descended


def test_problems_that_share_the_physics_keep_their_own_goals():
    """As in the explorer, where another goal for the same scene compiles nothing new."""

    def reach(target):
        space = Space({"free": sg.shell.Free(shell())}, [Variable("shell.t_m", 0.8 * mm, 2 * mm)])
        return Problem(space, [Goal("reach", Quantity("inflation", at=15 * kPa), target=target)])

    one, two = reach(12 * mm), reach(9 * mm)
    two._programs = one._programs
    asked = {"starts": 4, "steps": 10, "finishes": 1}
    for problem, target in ((one, 12 * mm), (two, 9 * mm)):
        assert search(problem, **asked).best.values[0] == pytest.approx(target, rel=1e-6)
    assert two._programs is one._programs


def test_all_distinct_optima_are_found():
    found = search(himmelblau(), starts=32, steps=40)
    minima = [(3, 2), (-2.805118, 3.131312), (-3.779310, -3.283186), (3.584428, -1.848126)]
    assert len(found.designs) == 4
    for minimum in minima:
        assert min(np.max(np.abs(d.x - minimum)) for d in found.designs) < 1e-4


def test_an_optimum_on_a_bound_is_on_it():
    slope = Formulas([lambda x: x[0] + (x[1] - 1.0) ** 2], [2.0, 0.0], [7.0, 3.0])
    best = search(slope, starts=4, steps=40).best
    assert best.x[0] == 2.0
    assert best.x[1] == pytest.approx(1.0, abs=1e-5)
    assert best.active == ("shell.a at its lower bound",)


def test_what_cannot_be_kept_is_reported_with_its_violation():
    torn = Formulas([lambda x: x[0], lambda x: x[0], lambda x: -x[0]], [0.0], [1.0], [0.3, -0.5])
    best = search(torn, starts=4, steps=40).best
    assert not best.feasible
    assert best.violation >= 0.1 * (1 - 1e-6)  # halfway between 0.3 and 0.5 is the least


@pytest.mark.parametrize("optimiser", ["adabelief", "nadam", "sgd", "lion"])
def test_optimisers_by_name(optimiser):
    bowl = Formulas([lambda x: (x[0] - 1) ** 2 + 10 * (x[1] - 2) ** 2], [0.0, 0.0], [3.0, 3.0])
    np.testing.assert_allclose(search(bowl, starts=4, steps=30, optimiser=optimiser).best.x, [1, 2], atol=1e-4)


def test_lanes_stop_when_they_rest():
    bowl = Formulas([lambda x: (x[0] - 1) ** 2], [0.0], [3.0])
    found = search(bowl, starts=8, steps=200)
    assert len(found.history["moving"]) < 200
    assert found.solves < 8 * 200
    assert found.history["moving"][-1] == 0


def himmelblau():
    """Himmelblau 1972: four minima of value zero."""
    return Formulas([lambda x: (x[0] ** 2 + x[1] - 11) ** 2 + (x[0] + x[1] ** 2 - 7) ** 2], [-5.0] * 2, [5.0] * 2)


def test_of_many_lanes_those_beside_a_better_one_are_left_to_it(monkeypatch):
    """The same four minima, with as many descents at each, for half of the solves."""
    few = search(himmelblau(), starts=256, steps=60)
    assert 150 < few.merged <= 256 - searching.NEARBY_CHUNK
    assert few.history["moving"][searching.PERIOD] == 256  # one look is not enough
    monkeypatch.setattr(searching, "LOOKS", 1000)
    every = search(himmelblau(), starts=256, steps=60)
    assert every.merged == 0
    least = 256 * 2 * searching.PERIOD + 64 * (60 - 2 * searching.PERIOD)  # all until the second look, then one call
    assert least <= few.solves < 1.05 * least < 0.53 * every.solves
    assert len(few.designs) == len(every.designs) == 4

    def basins(found):
        return sorted((tuple(np.round(d.x, 4) + 0.0), n) for d, n in zip(found.designs, found.reached, strict=True))

    for (one, ends), (other, all_ends) in zip(basins(few), basins(every), strict=True):
        np.testing.assert_allclose(one, other, atol=2e-4)
        assert abs(ends - all_ends) <= 10
    assert sum(few.reached) > 240
    assert np.isnan(few.paths[-1]).sum() >= few.merged  # a path ends where its lane is left to another


def test_company_by_hand(monkeypatch):
    """Five lanes on a line: two pairs and a fifth; the worse of each pair goes at the second look, the worst first."""
    monkeypatch.setattr(searching, "NEARBY_CHUNK", 2)
    three = searching.Company(3)
    looks = [three.look(np.arange(3), np.zeros((3, 1)), np.array([2.0, 3.0, 1.0])).tolist() for _ in range(2)]
    assert looks == [[], [1]]  # two may go, one is enough: the worst
    monkeypatch.setattr(searching, "NEARBY_CHUNK", 4)
    company = searching.Company(5)
    t = np.array([[0.10], [0.14], [0.50], [0.54], [0.90]])
    rank = np.array([1.0, 2.0, 5.0, 4.0, 3.0])
    moving = np.arange(5)
    assert company.look(moving, t, rank).tolist() == []
    apart = t + np.array([[0], [0.02], [0], [0], [0]])  # the first pair is 0.06 apart now, and begins anew
    assert company.look(moving, apart, rank).tolist() == [2]
    assert company.into.tolist() == [0, 1, 3, 3, 4]
    moving = np.array([0, 1, 3, 4])
    for _ in range(3):  # as few as one call takes are never left
        assert company.look(moving, t, rank).tolist() == []
    monkeypatch.setattr(searching, "NEARBY_CHUNK", 1)
    t[3] = 0.12
    assert company.look(moving, t, rank).tolist() == [1]  # lane 3 has only now come to lanes 0 and 1
    assert company.look(np.array([0, 3, 4]), t, rank).tolist() == [3]
    assert company.into.tolist() == [0, 0, 3, 0, 4]
    assert company.merged == 3
    assert company.look(np.arange(0), t, rank).tolist() == []
    ends, ranks = company.ends(t, rank)
    assert ends[2] == ends[3] == ends[1] == 0.1
    assert ranks.tolist() == [1.0, 1.0, 1.0, 1.0, 3.0]
    # One whose own best is better keeps it.
    ends, ranks = company.ends(t, np.array([1.0, 0.5, 5.0, 4.0, 3.0]))
    assert (ends[1], ranks[1]) == (0.14, 0.5)


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [({"optimiser": "adma"}, "must be one of adam"), ({"starts": 0}, "starts is 0"), ({"steps": 0}, "steps is 0")],
)
def test_mistakes_are_named(arguments, sentence):
    with pytest.raises(ValueError, match=sentence):
        search(rosen_suzuki(), **arguments)


# --- the shell gripper ------------------------------------------------------------------------------------------------

LOW, HIGH = np.array([8, 25, 0.8, 2]) * mm, np.array([24, 50, 2, 12]) * mm
MARGIN, STRETCH = 1.25, 1.12


def gripper(x):
    """A shell gripper of dimensions a, b, t_m, gap that shall hold 563 g."""
    membrane = sg.FlatShell(a=x[0], b=x[1], t_m=x[2], material=sg.NeoHookean(mu=175 * kPa))
    return sg.shell.Grasp(membrane, radius=20 * mm, gap=x[3], mass=563 * gram, friction=0.96)


@pytest.fixture(scope="module")
def found():
    """From a start that is far too weak to hold the cylinder."""
    weak = gripper(np.array([13, 25.5, 0.9, 5]) * mm)
    assert int(sg.pressure_for(weak).status) == Status.BEYOND_LIMIT
    names = ("shell.a", "shell.b", "shell.t_m", "gap")
    space = Space({"scene": weak}, [Variable(n, lo, hi) for n, lo, hi in zip(names, LOW, HIGH, strict=True)])
    limits = [
        Limits(Quantity("limit_margin", "required"), low=MARGIN),
        Limits(Quantity("stretch", "required"), high=STRETCH),
    ]
    problem = Problem(space, [Goal("minimise", Quantity("pressure", "required"), scale=10 * kPa)], limits)
    return search(problem, starts=16, steps=50, seed=1)


def test_designs_without_equilibrium_climb_back(found):
    assert not found.reference.feasible
    assert found.reference.statuses == (Status.BEYOND_LIMIT,)
    with_equilibrium = found.history["with_equilibrium"]
    assert with_equilibrium[0] < 12
    assert with_equilibrium[-1] == 16


def test_designs_that_touch_nothing_climb_to_contact():
    """At 500 Pa a membrane touches the plane in a corner of the box alone, where no start is."""
    plane = sg.shell.FlatContact(shell(), distance=5 * mm)
    space = Space({"plane": plane}, [Variable("shell.a", 8 * mm, 24 * mm), Variable("shell.t_m", 0.8 * mm, 2 * mm)])
    found = search(Problem(space, [Goal("maximise", Quantity("force", 500.0))]), starts=4, steps=30, finishes=1)
    assert found.history["with_equilibrium"][0] == 0
    np.testing.assert_allclose(found.best.x, [24 * mm, 0.8 * mm], rtol=1e-9)
    best = sg.solve(space.scenes_at(jnp.asarray(found.best.x))["plane"], 500.0)
    assert best.status == Status.OK
    np.testing.assert_allclose(found.best.values[0], best.force, rtol=1e-9)


def test_what_ends_on_a_limit_point_says_so_and_a_margin_below_one_is_no_bound():
    """The thinner a membrane the more it inflates, down to where its limit pressure, in proportion to the thickness, is
    the pressure."""
    free = sg.shell.Free(shell())
    space = Space({"scene": free}, [Variable("shell.t_m", 0.5 * mm, 2 * mm)])
    goal, margin = Goal("maximise", Quantity("inflation", 15 * kPa)), Quantity("limit_margin", 15 * kPa)
    found = search(Problem(space, [goal], [Limits(margin, low=0.2)]), starts=4, steps=60, finishes=2)
    sentence = (
        "limit_margin at 15 kPa at least 0.2 holds for every state that exists: the margin is the limit pressure "
        "over the pressure, 1 at the limit."
    )
    assert found.remarks == (sentence,)
    thinnest = float(free.shell.t_m) * 15 * kPa / float(sg.limit_pressure(free))
    assert found.best.x[0] == pytest.approx(thinnest, rel=1e-4)
    assert found.best.active == ("15 kPa: at its limit pressure",)
    assert found.reference.active == ()
    # Nobody asks for the margin here.
    found = search(Problem(space, [goal]), starts=4, steps=60, finishes=2)
    assert found.best.active == ("15 kPa: at its limit pressure",)
    assert found.best.limit_margins["15 kPa"] == pytest.approx(1, abs=1e-4)
    limit = float(sg.limit_pressure(free))
    assert found.reference.limit_margins["15 kPa"] == pytest.approx(limit / (15 * kPa), rel=1e-9)
    (words,) = near_limits(dataclasses.replace(found.best, limit_margins={"15 kPa": 1.004, "10 kPa": 1.2}))
    assert words.startswith("15 kPa: the limit pressure is 0.4% above it.")
    assert Problem(space, [goal], [Limits(margin, low=1.2)]).always_kept() == []


def test_the_shell_optimum_is_not_beaten_by_differential_evolution(found):
    @jax.jit
    @jax.vmap
    def judge(x):
        solution, limit = sg.pressure_for(gripper(x)), sg.limit_pressure(gripper(x))
        ok = solution.status == Status.OK
        broken = jnp.maximum(0, MARGIN - limit / solution.pressure) + jnp.maximum(0, solution.stretch - STRETCH)
        return jnp.where(ok, solution.pressure / kPa + 1e3 * broken, 1e4)

    # Chunks of one size: the population is compiled once.
    def cost(columns):
        return np.asarray(judge(jnp.asarray(columns.T)))

    best = found.best
    assert best.feasible
    assert float(cost(best.x[:, None] * np.ones(40))[0]) == pytest.approx(best.values[0] / kPa, rel=1e-3)
    rival = differential_evolution(
        cost,
        list(zip(LOW, HIGH, strict=True)),
        popsize=10,
        maxiter=150,
        tol=0,
        rng=3,
        vectorized=True,
        updating="deferred",
        polish=False,
    )
    assert best.values[0] / kPa <= rival.fun * (1 + 1e-6)
    # The rival comes near: neither of the two is lost in another valley.
    assert rival.fun == pytest.approx(best.values[0] / kPa, rel=2e-2)


# --- the configs of the project, and curves to follow -----------------------------------------------------------------


SEARCHES = sorted(path.name for path in (ROOT / "configs").glob("*.toml") if "[design]" in path.read_text())


@pytest.mark.parametrize("name", SEARCHES)
def test_every_search_of_the_project_is_read(name):
    wanted = settings.read(configs.load(ROOT / "configs" / name))
    assert wanted.problem.space.size >= 1
    start = wanted.problem.space.to_unit(wanted.problem.space.reference)
    assert np.all((start >= 0) & (start <= 1)), "the start is within the bounds"


SHELL = """
[scene]
type = "shell.Free"
shell = { a_mm = 16, b_mm = 43, t_m_mm = 1.1, material = { type = "NeoHookean", mu_kPa = 175 } }
[design]
[[design.variables]]
name = "shell.t_m_mm"
low = 0.8
high = 2
[[design.goals]]
"""
AT = "at = { pressure_kPa = 8 }"
FOLLOW = f"follow = [[0, 0], [5, -1], [9, -3]]\n{AT}"


@pytest.mark.parametrize(
    ("goal", "sentence"),
    [
        (FOLLOW, "Free is no finger; only the line that a finger bends to has shape.x."),
        (f"{FOLLOW}\ntarget = 1", "a goal has target beside follow; the points are what is to be reached; leave out"),
        (f"{FOLLOW}\nscale = 1", "a goal has scale beside follow; the length of the curve is the scale; leave out"),
        (f'minimise = "stretch"\n{AT}\nscene = "scene"', "a goal has scene beside minimise; of several scenes the key"),
        (f'reach = "stretch"\n{AT}\ntarget = 1.2\nscene = "x"', "a goal has scene beside reach"),
        (f'minimise = "stretch"\n{AT}\ntarget = 1', "the goal minimise = 'stretch' takes no target; leave it out"),
    ],
)
def test_goals_that_cannot_be_meant_are_one_sentence(goal, sentence, tmp_path):
    (tmp_path / "shell.toml").write_text(SHELL + goal)
    with pytest.raises(ConfigError) as error:
        settings.read(configs.load(tmp_path / "shell.toml"))
    assert sentence in str(error.value)


def test_points_of_a_curve_have_labels_of_their_own():
    scenes = {"scene": sg.pneunet.Free(sg.PneuNet.table_5_1("A"), weight=None, inclination="none")}

    def labels(points):
        parts = np.linspace(0, 1, points)[1:]
        return QuantitySet(scenes, [Quantity("shape.x", 31 * kPa, along=float(part)) for part in parts]).labels()

    assert labels(13)[:2] == ["shape.x 8% along at 31 kPa", "shape.x 17% along at 31 kPa"]
    for points in (101, 102, 1500):
        assert len(set(labels(points))) == points - 1
    assert labels(101)[49] == "shape.x 50% along at 31 kPa"


@pytest.mark.slow
def test_a_curve_that_a_finger_can_have_is_found_again():
    """The shape of a known finger of four segments is followed by least squares from another; its walls come back."""
    walls = np.array([1.3, 1.1, 0.9, 1.2]) * mm
    plain = sg.PneuNet.table_5_1("A")
    finger = dataclasses.replace(plain, t_m=jnp.full(4, 1.1 * mm))
    known = dataclasses.replace(plain, t_m=jnp.asarray(walls))
    free = {"weight": None, "inclination": "none"}
    shape = sg.solve(sg.pneunet.Free(known, **free), 25 * kPa).shape(101)
    scene = sg.pneunet.Free(finger, **free)
    goals = [
        Goal("reach", Quantity(f"shape.{axis}", 25 * kPa, along=k / 100), float(shape[axis][k]), scale=0.1)
        for k in (25, 50, 75, 100)
        for axis in "xy"
    ]
    problem = Problem(Space({"scene": scene}, [Variable("finger.t_m", 0.8 * mm, 1.6 * mm)]), goals)
    found = search(problem, starts=4, steps=3)
    np.testing.assert_allclose(found.best.x, walls, rtol=1e-5)
    assert found.best.objective < 1e-12


def test_components_of_a_point_are_quantities():
    scene = sg.pneunet.Free(sg.PneuNet.table_5_1("A"), weight=None, inclination="none")
    quantities = [Quantity("tip.x", 31 * kPa), Quantity("tip.y", 31 * kPa), Quantity("shape.y", 31 * kPa, along=1.0)]
    asked = QuantitySet({"scene": scene}, quantities)
    x, y, end = jax.jit(lambda scene: asked.measure({"scene": scene}).values)(scene)
    tip = sg.solve(scene, 31 * kPa).tip
    np.testing.assert_allclose([x, y, end], [tip[0], tip[1], tip[1]], rtol=1e-9)
