"""Trade-offs: on the known front of published problems, evenly spread, and at least as good as NSGA-II's."""

import dataclasses
import io
import re
import shlex
import signal

import jax.numpy as jnp
import numpy as np
import pytest
from helpers import shell
from rich.console import Console

import optim
import softgrip_jax as sg
from optim.design.descent import FEASIBLE, Evaluator, search
from optim.design.front_run import report as tell
from optim.design.pareto import pareto
from optim.problem import Goal, Limits, Measured, Problem, Quantity
from optim.space import Space, Variable
from softgrip_jax import config as configs
from softgrip_jax.cli import run
from softgrip_jax.units import gram, kPa, mm

LEAVES = ("shell.a", "shell.b", "shell.t_m", "gap")


class Formulas(Problem):
    """Goals and limits (at most zero) that are formulas of the variables instead of physics."""

    def __init__(self, goals, low, high, limits=(), targets=()):
        scene = sg.shell.Grasp(shell(), radius=20 * mm, gap=5 * mm, ignored_rules=("membranes_apart",))
        space = Space(
            {"toy": scene}, [Variable(n, lo, hi) for n, lo, hi in zip(LEAVES[: len(low)], low, high, strict=True)]
        )
        space.reference = 0.5 * (space.low + space.high)
        # Any observable will do: `measure` below gives them their values.
        quantities = [Quantity(name, "required", "toy") for name in list(sg.shell.Grasp.OBSERVABLES)]
        wanted = [Goal("reach", quantities[k], target=target, scale=1.0) for k, target in enumerate(targets)]
        wanted += [Goal("minimise", quantities[k], scale=1.0) for k in range(len(targets), len(goals))]
        kept = [Limits(quantities[len(goals) + k], high=0.0, scale=1.0) for k in range(len(limits))]
        super().__init__(space, wanted, kept)
        self.formulas = [*goals, *limits]

    def measure(self, t, home=None):
        x = self.space.from_unit(t)
        return Measured(jnp.stack([f(x) for f in self.formulas]), jnp.asarray(0.0), jnp.zeros(1, int))


def gaps(terms):
    """Distances of neighbours on a front of two goals, in the ranges of the goals."""
    return np.hypot(*np.diff((terms - terms.min(0)) / np.ptp(terms, axis=0), axis=0).T)


def is_front(terms):
    better = np.all(terms[None] <= terms[:, None], axis=2) & np.any(terms[None] < terms[:, None], axis=2)
    return not np.any(better)


def test_a_convex_front():
    """Schaffer 1985: f = (x^2, (x - 2)^2), the front is sqrt(f1) + sqrt(f2) = 2; a second variable must vanish."""
    front = pareto(
        Formulas([lambda x: x[0] ** 2 + x[1] ** 2, lambda x: (x[0] - 2) ** 2 + x[1] ** 2], [-3.0, -1.0], [3.0, 2.0]),
        points=21,
    )
    assert len(front.designs) == 21
    np.testing.assert_allclose(np.sum(np.sqrt(front.terms), axis=1), 2, atol=1e-5)
    np.testing.assert_allclose(front.terms[[0, -1]], [[0, 4], [4, 0]], atol=0.02)
    assert gaps(front.terms).max() < 1.25 * gaps(front.terms).min()


def test_a_front_of_one_design_says_why():
    """The table had one row, and no word about it."""
    front = pareto(Formulas([lambda x: x[0] ** 2 + x[1], lambda x: 2.0 + 0 * x[0]], [1.0] * 2, [3.0] * 2), points=3)
    assert len(front.designs) == 1
    constant, alone = front.notes
    assert constant.startswith("No variable changes ")
    assert alone == "One design is the best in every goal: there is nothing to trade off."


def test_a_front_says_which_limits_always_hold(monkeypatch):
    """A search said it of the same limits."""
    sentence = "limit_margin at 15 kPa at least 0.2 holds for every state that exists."
    monkeypatch.setattr(Problem, "always_kept", lambda problem: [sentence])
    assert sentence in pareto(binh_korn(), points=3, starts=8).notes


def test_a_front_of_one_design_that_only_a_constraint_keeps_from_a_better_one():
    """Designs that broke the constraint were nearer than the only one on the front, and a traceback was the answer."""
    goals = [lambda x: x[0] + x[1] ** 2, lambda x: 2 * x[0] + x[1] ** 2]
    front = pareto(Formulas(goals, [1.0, -1.0], [4.0, 2.0], limits=[lambda x: 2 - x[0]]), points=3, starts=8)
    np.testing.assert_allclose(front.terms, [[2, 4]], atol=1e-6)
    assert front.notes == ("One design is the best in every goal: there is nothing to trade off.",)


@pytest.mark.parametrize("stage", ["front between them", "designs evenly along it"])
def test_what_was_found_until_it_is_stopped_is_kept(stage):
    def report(name, solves):
        if name == stage:
            raise KeyboardInterrupt

    found = pareto(binh_korn(), points=15, starts=32, report=report)
    assert found.stopped
    assert len(found.designs) >= 3
    assert is_front(found.terms)
    assert all(design.feasible for design in found.designs)
    whole = pareto(binh_korn(), points=15, starts=32)
    assert not whole.stopped
    worst = np.maximum(found.terms.max(axis=0), whole.terms.max(axis=0))
    assert 0.7 * volume(whole.terms, worst) < volume(found.terms, worst) <= 1.001 * volume(whole.terms, worst)


@pytest.fixture
def ctrl_c_in(monkeypatch):
    """Press Ctrl-C within the call of this number of a method of `Evaluator`; a list of the calls of `solve`."""

    def at_once(number, frame):
        pytest.fail("Ctrl-C was not kept until the designs were solved")  # KeyboardInterrupt would end all tests

    before = signal.signal(signal.SIGINT, at_once)

    def press_in(method, number):
        calls = {"solve": [], "solutions": []}
        for name, whole in (("solve", Evaluator.solve), ("solutions", Evaluator.solutions)):

            def watched(self, t, name=name, whole=whole):
                calls[name].append(t)
                if (name, len(calls[name])) == (method, number):
                    signal.raise_signal(signal.SIGINT)
                return whole(self, t)

            monkeypatch.setattr(Evaluator, name, watched)
        return calls["solve"]

    yield press_in
    signal.signal(signal.SIGINT, before)


@pytest.mark.parametrize(("method", "number", "solves"), [("solve", 1, 2), ("solve", 3, 3), ("solutions", 1, 3)])
def test_a_search_that_is_stopped_in_its_last_solves_is_kept(method, number, solves, ctrl_c_in):
    """Between descent and finish, where no finish follows then; of the start; and of the pictures."""
    seen = ctrl_c_in(method, number)
    problem = Formulas([lambda x: jnp.sum((x - 1) ** 2)], [0.0, 0.0], [3.0, 3.0])
    found = search(problem, starts=4, steps=30, finishes=2)
    assert found.stopped
    assert len(seen) == solves
    np.testing.assert_allclose(found.best.x, 1, atol=0.1)
    assert found.reference.objective == pytest.approx(0.5)


def test_a_front_that_is_stopped_while_its_designs_are_solved_is_kept(ctrl_c_in):
    ctrl_c_in("solve", 1)
    found = pareto(binh_korn(), points=5, starts=8)
    assert found.stopped
    assert len(found.designs) >= 3
    assert all(design.feasible for design in found.designs)
    said = io.StringIO()
    tell(found, Console(file=said))  # what summary.txt keeps
    assert said.getvalue().startswith("Stopped before the front was found; ")
    near = dataclasses.replace(found.designs[0], limit_margins={"15 kPa": 1.004, "10 kPa": 1.2})
    said = io.StringIO()
    tell(dataclasses.replace(found, designs=[near, *found.designs[1:]]), Console(file=said, width=200))
    (words,) = (line for line in said.getvalue().splitlines() if "limit pressure" in line)
    assert words.startswith("Design 1, 15 kPa: the limit pressure is 0.4% above it.")


def test_designs_that_prove_to_have_no_equilibrium_are_not_on_the_front(monkeypatch):
    """Along the whole way from zero load, on which all are solved in the end."""
    whole, lost = Evaluator.solve, [0, 2]

    def solve(self, t):
        found = whole(self, t)
        shortfall = np.array(found.shortfall)
        shortfall[[k for k in lost if k < len(t)]] = 1.0
        return found._replace(shortfall=shortfall)

    before = pareto(binh_korn(), points=5, starts=8)
    monkeypatch.setattr(Evaluator, "solve", solve)
    found = pareto(binh_korn(), points=5, starts=8)
    np.testing.assert_array_equal(found.terms, np.delete(before.terms, lost, axis=0))
    assert len(found.designs) == len(found.terms)
    assert all(design.feasible for design in found.designs)
    lost.extend(range(100))
    with pytest.raises(ValueError, match="there is no front"):
        pareto(binh_korn(), points=5, starts=8)


def test_a_front_that_no_weighted_sum_finds():
    """Fonseca and Fleming 1995: a concave front, x = y in [-1/sqrt(2), 1/sqrt(2)]."""
    half = 1 / np.sqrt(2)
    goals = [lambda x, s=s: 1 - jnp.exp(-jnp.sum((x - s * half) ** 2)) for s in (1, -1)]
    front = pareto(Formulas(goals, [-4.0, -4.0], [4.0, 4.0]), points=15)
    x = np.stack([d.x for d in front.designs])
    np.testing.assert_allclose(x[:, 0], x[:, 1], atol=1e-3)
    assert len(x) == 15
    assert gaps(front.terms).max() < 1.25 * gaps(front.terms).min()


def test_three_goals():
    """Deb et al. 2002 (DTLZ2): the front is the part of the unit sphere with positive coordinates."""

    def radius(x):
        return 1 + (x[2] - 0.5) ** 2

    c, s = (lambda x: jnp.cos(0.5 * jnp.pi * x)), (lambda x: jnp.sin(0.5 * jnp.pi * x))
    goals = [
        lambda x: radius(x) * c(x[0]) * c(x[1]),
        lambda x: radius(x) * c(x[0]) * s(x[1]),
        lambda x: radius(x) * s(x[0]),
    ]
    front = pareto(Formulas(goals, [0.0] * 3, [1.0] * 3), points=28)
    assert 24 <= len(front.designs) <= 28
    np.testing.assert_allclose(np.linalg.norm(front.terms, axis=1), 1, atol=1e-4)
    assert is_front(front.terms)
    # Evenly: nobody's nearest neighbour is much further than another's.
    apart = np.linalg.norm(front.terms[:, None] - front.terms[None], axis=2) + 9 * np.eye(len(front.terms))
    assert apart.min(axis=1).max() < 3 * apart.min(axis=1).min()


def test_the_ends_of_three_goals_are_the_best_of_each():
    """Squared distances from the corners of a triangle: every point of it is on the front, and so are its corners. A
    front between the best of every two goals covered the middle quarter."""
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [0.5, 0.8]])
    goals = [lambda x, c=c: jnp.sum((x - c) ** 2) for c in corners]
    front = pareto(Formulas(goals, [-1.0, -1.0], [2.0, 2.0]), points=28)
    np.testing.assert_allclose(front.terms.min(axis=0), 0, atol=1e-4)
    x = np.stack([d.x for d in front.designs])
    inside = np.linalg.solve(np.vstack([corners.T, np.ones(3)]), np.vstack([x.T, np.ones(len(x))]))
    assert inside.min() > -1e-3
    # Nobody inside of the triangle is far from a design.
    rng = np.random.default_rng(0)
    anywhere = rng.dirichlet(np.ones(3), 200) @ corners
    assert np.linalg.norm(anywhere[:, None] - x, axis=2).min(axis=1).max() < 0.12
    assert is_front(front.terms)


@pytest.mark.parametrize("place", [0, 1])
def test_an_end_at_a_target_is_on_it(place):
    """The other goal, a thousandth of which counts at an end, drew it 1e-4 and more from the target."""
    goals = [lambda x: x[0], lambda x: x[0] + 0.5 * x[1]]
    problem = Formulas(goals, [0.5, 0.5], [2.0, 2.0], targets=[1.2])
    if place:
        problem.goals = problem.goals[::-1]
    front = pareto(problem, points=9)
    ends = np.stack([d.x for d in front.designs])[[0, -1]]
    np.testing.assert_allclose(ends[place and -1], [1.2, 0.5], atol=1e-6)
    np.testing.assert_allclose(ends[place - 1], [0.5, 0.5], atol=1e-6)


def binh_korn():
    """Binh and Korn 1997: two goals, two limits."""
    goals = [lambda x: 4 * x[0] ** 2 + 4 * x[1] ** 2, lambda x: (x[0] - 5) ** 2 + (x[1] - 5) ** 2]
    limits = [
        lambda x: ((x[0] - 5) ** 2 + x[1] ** 2 - 25) / 25,
        lambda x: (7.7 - (x[0] - 8) ** 2 - (x[1] + 3) ** 2) / 7.7,
    ]
    return Formulas(goals, [0.0, 0.0], [5.0, 3.0], limits)


def rival(problem, solves, population=50, seed=1):
    """The front of pymoo's NSGA-II (Deb et al. 2002) with a number of solves."""
    from pymoo.algorithms.moo.nsga2 import NSGA2
    from pymoo.core.problem import Problem as Rivals
    from pymoo.optimize import minimize

    evaluate = Evaluator(problem, 128)
    scales = problem.scales(evaluate(problem.space.to_unit(problem.space.reference)).values[0])

    class Wrapped(Rivals):
        def _evaluate(self, x, out, *args, **kwargs):
            found = evaluate(x)
            lost = found.shortfall > 0
            terms = np.stack([problem.terms(jnp.asarray(v), scales) for v in found.values])
            broken = np.stack([problem.score(jnp.asarray(v), scales).violations for v in found.values])
            out["F"] = np.where(lost[:, None], 1e3, terms)
            out["G"] = np.column_stack([broken, np.where(lost, found.shortfall, -1.0)])

    n = problem.space.size
    wrapped = Wrapped(n_var=n, n_obj=len(problem.goals), n_ieq_constr=len(problem.constrained) + 1, xl=0.0, xu=1.0)
    generations = solves // population
    return minimize(wrapped, NSGA2(pop_size=population), ("n_gen", generations), seed=seed).F


def volume(terms, worst):
    from pymoo.indicators.hv import HV

    return HV(ref_point=worst)(terms)


def beats(problem, front, times):
    """Hypervolume over that of NSGA-II with `times` the solves, from the worst of both."""
    other = rival(problem, times * front.solves)
    worst = np.maximum(front.terms.max(axis=0), other.max(axis=0))
    low = np.minimum(front.terms.min(axis=0), other.min(axis=0))
    worst = low + 1.1 * (worst - low)
    return volume(front.terms, worst) / volume(other, worst)


@pytest.mark.slow
@pytest.mark.filterwarnings("default")
def test_a_tenth_of_the_solves_of_nsga_ii():
    problem = binh_korn()
    front = pareto(problem, points=50)
    assert all(design.feasible and design.violation <= FEASIBLE for design in front.designs)
    assert is_front(front.terms)
    assert beats(problem, front, 10) >= 1 - 2e-3


@pytest.mark.slow
@pytest.mark.filterwarnings("default")
def test_the_gripper_with_a_tenth_of_the_solves_of_nsga_ii():
    grasp = sg.shell.Grasp(shell(), radius=20 * mm, gap=5 * mm, mass=563 * gram, friction=0.96)
    bounds = np.array([(8, 24), (25, 50), (0.8, 2), (2, 12)]) * mm
    space = Space({"scene": grasp}, [Variable(n, *b) for n, b in zip(LEAVES, bounds, strict=True)])
    goals = [
        Goal("minimise", Quantity("pressure", "required"), scale=10 * kPa),
        Goal("maximise", Quantity("limit_margin", "required"), scale=1.0),
    ]
    limits = [Limits(Quantity("stretch", "required"), high=1.12), Limits(Quantity("limit_margin", "required"), low=1.2)]
    problem = Problem(space, goals, limits)
    front = pareto(problem, points=41)
    assert len(front.designs) >= 38
    assert all(design.feasible for design in front.designs)
    assert gaps(front.terms).max() < 1.5 * gaps(front.terms).min()
    assert beats(problem, front, 10) >= 1


def test_a_goal_without_an_end_is_the_best_of_it():
    """Where x is above 2 the second goal has no end: that design is an end of the front, the other is x = 0."""
    goals = [lambda x: x[0] ** 2, lambda x: jnp.where(x[0] > 2, -jnp.inf, 4 - x[0])]
    front = pareto(Formulas(goals, [0.0], [3.0]), points=5, starts=16)
    x = np.array([design.x[0] for design in front.designs])
    assert x[0] == pytest.approx(0, abs=1e-3)
    assert 2 < x[-1] < 2.2
    assert is_front(front.terms)
    assert front.terms[-1][1] == -100


@pytest.mark.parametrize("endless", [0, 1])
def test_a_goal_that_never_ends_asks_nothing(endless):
    goals = [lambda x: jnp.exp(x[0] - 1) - x[0] + jnp.cosh(x[1] - x[0])] * 2
    goals[endless] = lambda x: 0 * x[0] - jnp.inf
    front = pareto(Formulas(goals, [0.0, 0.0], [3.0, 3.0]), points=5, starts=8)
    assert len(front.designs) == 1
    np.testing.assert_allclose(front.designs[0].x, 1, atol=1e-3)


def test_goals_must_be_two_or_three():
    with pytest.raises(ValueError, match="between two or three goals; there are 1"):
        pareto(Formulas([lambda x: x[0]], [0.0], [1.0]))


FRONT = """
[scene]
type = "shell.Free"
[scene.shell]
a_mm = 16
b_mm = 43
t_m_mm = 1.1
material = { preset = "dragon_skin_20_shell" }
[manufacture]
top_wall_mm = 2
[design]
front = 9
starts = 16
[[design.variables]]
name = "shell.a_mm"
low = 10
high = 20
[[design.variables]]
name = "shell.t_m_mm"
low = 1
high = 2
[[design.goals]]
maximise = "inflation_mm"
at = { pressure_kPa = 10 }
[[design.goals]]
minimise = "stretch"
at = { pressure_kPa = 10 }
[[design.constraints]]
keep = "limit_margin"
at = { pressure_kPa = 10 }
low = 1.2
"""


def test_where_there_is_no_front_a_search_says_what_is_in_the_way(tmp_path, capsys):
    config = tmp_path / "none.toml"
    changes = ("low = 1.2", "low = 20"), ("front = 9", "front = 5\nsteps = 5"), ("starts = 16", "starts = 4")
    text = FRONT
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    config.write_text(text)
    out = tmp_path / "out"
    assert run(["design", str(config), "--out", str(out)]) == 1
    said = " ".join(capsys.readouterr().out.split())
    assert "there is no front. A search of all goals added up says what is in the way." in said
    assert "limit_margin at 10 kPa at least 20 │ broken by" in said
    assert {"best.toml", "result.json", "report.html"} <= {path.name for path in out.iterdir()}


def test_a_front_by_config_is_kept_in_a_folder(tmp_path, capsys):
    """A free membrane: more inflation at 10 kPa costs stretch."""
    config = tmp_path / "front.toml"
    config.write_text(FRONT)
    out = tmp_path / "out"
    assert run(["design", str(config), "--out", str(out)]) == 0
    printed = capsys.readouterr().out
    assert "a front of 9 designs" in printed
    assert "Design 1: inflation: 8 to 20 % less than by the energy membrane" in " ".join(printed.split())
    assert "designs/ (9 files)" in printed
    assert run(shlex.split(printed.partition("Next: softgrip ")[2])) == 0
    capsys.readouterr()
    assert {path.name for path in out.iterdir()} == {
        "config.toml",
        "designs.csv",
        "designs",
        "front.png",
        "report.html",
        "summary.txt",
        "result.json",
    }
    kept = optim.load_run(out)
    assert "objective" not in kept.designs[0]
    inflations = [float(row["inflation_at_10_kPa_mm"]) for row in kept.designs]
    stretches = [float(row["stretch_at_10_kPa"]) for row in kept.designs]
    assert np.all(np.diff(inflations) < 0)
    assert np.all(np.diff(stretches) < 0)
    told = re.findall(r"Design (\d), 10 kPa: stretch ([\d.]+) is more than the 1.5", " ".join(printed.split()))
    trusted = [k for k in range(9) if stretches[k] <= 1.5]
    assert told == [(str(k + 1), f"{stretches[k]:.3g}") for k in range(trusted[0])]
    read = configs.load(out / "designs" / "09.toml")
    assert read.tables["manufacture"] == {"top_wall_mm": 2}
    last = sg.solve(read.scene, 10 * kPa)
    assert float(last.inflation) / mm == pytest.approx(inflations[-1], rel=1e-9)
    # The least stretch is that of the smallest and thickest membrane.
    smallest = sg.solve(sg.shell.Free(shell(a=10 * mm, t_m=2 * mm)), 10 * kPa)
    assert stretches[-1] == pytest.approx(float(smallest.stretch), rel=1e-6)
    text = config.read_text()
    config.write_text(text[: text.index("[[design.goals]]\nminimise")])
    assert run(["design", str(config), "--out", str(tmp_path / "other")]) == 2
    assert "between two or three goals; there are 1" in capsys.readouterr().err


FINGERS = """
[scene]
type = "pneunet.Free"
[scene.finger]
preset = "table_5_1_A"
[design]
front = 3
starts = 4
[[design.variables]]
name = "finger.H_mm"
low = 4
high = 6
[[design.goals]]
maximise = "tip_angle_deg"
at = { pressure_kPa = 15 }
[[design.goals]]
minimise = "inclination_deg"
at = { pressure_kPa = 15 }
"""


@pytest.mark.slow
def test_a_front_of_fingers_is_told_by_both_drives(tmp_path, capsys):
    config, out = tmp_path / "front.toml", tmp_path / "out"
    config.write_text(FINGERS)
    assert run(["design", str(config), "--out", str(out)]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert "Two laws push this finger" in printed
    (first, *_) = optim.load_run(out).designs
    scene = configs.load(out / "designs" / "01.toml").scene
    by_cell = sg.solve(dataclasses.replace(scene, drive="cell"), 15 * kPa)
    assert f"{np.rad2deg(float(sg.solve(scene, 15 * kPa).tip_angle)):.5g}" in printed
    assert f"{np.rad2deg(float(by_cell.tip_angle)):.5g}" in printed
    assert float(first["finger.H_mm"]) < 6
