"""Both laws of what pushes a finger, side by side: in `softgrip solve`, in the report of a search, and as a search's
constraints."""

import json
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import shell
from typer.testing import CliRunner

import softgrip_jax as sg
from optim.calibration import report as rival_fits
from optim.calibration.drives import Rival, rival
from optim.calibration.fit import Fit
from optim.calibration.run import _other
from optim.design import settings
from optim.design.descent import Evaluator
from optim.drives import BELOW_LIMIT, SUFFIX, OtherDrive, by_both_drives, by_other_drive, other_drive
from optim.problem import Goal, Limits, Problem, Quantity
from optim.space import Space, Variable
from softgrip_jax import config as configs
from softgrip_jax.cli import app, run
from softgrip_jax.commands import asked
from softgrip_jax.errors import InputError
from softgrip_jax.pneunet.drives import OTHER, remarks, with_other_drive
from softgrip_jax.quantities import Observed, QuantitySet
from softgrip_jax.units import kPa, mm

CONFIG = """
[scene]
type = "pneunet.TipContact"
points = 6
[scene.finger]
preset = "table_5_1_A"
[solve]
pressure_kPa = 15
[design]
{drive}
[[design.variables]]
name = "finger.H_mm"
low = 4
high = 6
[[design.goals]]
maximise = "tip_force_N"
at = {{ pressure_kPa = 15 }}
[[design.constraints]]
keep = "tip_angle_deg"
at = {{ pressure_kPa = 15 }}
high = 90
"""


def held(**changes):
    return sg.pneunet.TipContact(sg.PneuNet.table_5_1("A"), **({"points": 6} | changes))


def test_the_other_drive_changes_nothing_else():
    scene = held(tip_offset=3 * mm, section="inextensible")
    other = with_other_drive(scene)
    assert other.drive == "cell"
    assert (other.points, other.section) == (6, "inextensible")
    assert float(other.tip_offset) == float(scene.tip_offset)
    assert with_other_drive(other).drive == "thesis"
    by_shooting = with_other_drive(held(points=sg.pneunet.TipContact.__dataclass_fields__["points"].default,
                                        beam=sg.pneunet.Shooting()))  # fmt: skip
    assert by_shooting.method() == sg.pneunet.Collocation()


def test_what_has_no_such_choice():
    assert with_other_drive(sg.shell.Free(shell())) is None
    assert with_other_drive(sg.pneunet.Linear(sg.PneuNet.table_5_1("A"))) is None


def test_dimensions_outside_of_the_fit_are_named():
    assert len(remarks(held())) == 1
    thick = sg.pneunet.TipContact(sg.PneuNet(**(sizes() | {"t_m": 0.4 * mm}), material=sg.NeoHookean(mu=136 * kPa)))
    assert "t_m = 0.4 mm (checked" in remarks(thick)[1]


def sizes():
    finger = sg.PneuNet.table_5_1("A")
    return {name: getattr(finger, name) for name in ("a", "b", "t_m", "h_x", "h_L", "H", "B", "L")}


@pytest.fixture
def config(tmp_path):
    path = tmp_path / "finger.toml"
    path.write_text(CONFIG.format(drive=""))
    return path


@pytest.fixture(scope="module")
def forces():
    """Tip forces (N) of the finger at 15 kPa by both drives."""
    return {drive: float(sg.solve(held(drive=drive), 15 * kPa).tip_force) for drive in ("thesis", "cell")}


def test_solve_prints_both_numbers(config, forces):
    printed = CliRunner().invoke(app, ["solve", str(config)]).output
    row = next(line for line in printed.split("by both drives")[1].splitlines() if "tip force" in line)
    numbers = [float(word) for word in row.replace("│", " ").split() if word[0].isdigit()]
    np.testing.assert_allclose(numbers, [forces["thesis"], forces["cell"]], rtol=1e-4)
    assert "Nobody knows yet why they differ" in printed


def test_json_has_both(config, forces):
    data = json.loads(CliRunner().invoke(app, ["solve", str(config), "--json"]).stdout)
    assert data["other_drive"]["drive"] == "cell"
    assert data["other_drive"]["observables"]["tip_force"] == pytest.approx(forces["cell"], rel=1e-9)
    assert data["observables"]["tip_force"] == pytest.approx(forces["thesis"], rel=1e-9)


def test_both_programs_are_made_before_either_is_waited_for(config, monkeypatch):
    happened = []

    def program(function, scene, *rest, **options):
        happened.append(("made", scene.drive))

        def run(*given):
            happened.append(("run", scene.drive))
            return function(*given)

        return run

    monkeypatch.setattr(asked, "program", program)
    assert CliRunner().invoke(app, ["solve", str(config)]).exit_code == 0
    assert happened == [("made", "thesis"), ("made", "cell"), ("run", "thesis"), ("run", "cell")]
    happened.clear()
    done = CliRunner().invoke(app, ["solve", str(config), "--pressure-kPa", "500"])
    assert done.exit_code == 1
    assert "by both drives" not in done.stdout
    assert ("run", "cell") not in happened  # one law without a state is answer enough


def test_what_the_other_law_was_not_fitted_to_is_a_sentence_and_no_warning(tmp_path):
    path = tmp_path / "thick.toml"
    path.write_text(CONFIG.format(drive="").replace('preset = "table_5_1_A"', 'preset = "table_5_1_A"\nt_m_mm = 1.8'))
    done = CliRunner().invoke(app, ["solve", str(path), "--pressure-kPa", "5"])  # a warning would be an error here
    assert done.exit_code == 0
    assert "t_m = 1.8 mm (checked" in done.stdout


@pytest.fixture(scope="module")
def problem():
    space = Space({"held": held()}, [Variable("finger.H", 4 * mm, 6 * mm)])
    force = Quantity("tip_force", 15 * kPa, "held")
    return Problem(space, [Goal("maximise", force)], [Limits(Quantity("pressure", 15 * kPa, "held"), high=20 * kPa)])


@pytest.mark.slow
def test_designs_are_reported_by_the_other_drive(problem):
    made = other_drive(problem, 3)  # as a command has it made before it knows how many there are
    beside = by_other_drive(problem, [np.array([5 * mm]), np.array([4.5 * mm])], made)
    assert [label for label, _ in beside.rows(problem)] == [
        "tip_force at 15 kPa, drive cell",
        "pressure at 15 kPa, drive cell",
    ]
    for H, row in zip((5 * mm, 4.5 * mm), beside.values, strict=True):
        finger = sg.PneuNet(**(sizes() | {"H": jnp.asarray(H)}), material=sg.NeoHookean(mu=136 * kPa))
        expected = sg.solve(sg.pneunet.TipContact(finger, points=6, drive="cell"), 15 * kPa).tip_force
        np.testing.assert_allclose(row[0], expected, rtol=1e-9)
    assert beside.reasons == [[], []]


def test_a_limit_pressure_is_reported_by_the_other_drive():
    """It has no state, and so no pressure."""
    space = Space({"held": held()}, [Variable("finger.H", 4 * mm, 6 * mm)])
    beside = by_other_drive(Problem(space, [Goal("maximise", Quantity("limit_pressure"))]), [np.array([5 * mm])])
    ((label, _),) = beside.rows(Problem(space, [Goal("maximise", Quantity("limit_pressure"))]))
    assert label == "limit_pressure, drive cell"
    expected = sg.limit_pressure(held(drive="cell"))
    np.testing.assert_allclose(beside.values, [[expected]], rtol=1e-9)
    assert beside.reasons == [[]]


def test_a_state_whose_parts_overlap_by_the_other_drive_is_not_there():
    """The thesis's chambers push a finger to 0.5 N at a pressure at which they overlap."""
    space = Space({"held": held(drive="cell", inclination="segment")}, [Variable("finger.H", 4 * mm, 6 * mm)])
    asked = Problem(space, [Goal("minimise", Quantity("pressure", ("tip_force", 0.5)))])
    beside = by_other_drive(asked, [np.array([5 * mm])])
    assert np.isnan(beside.values).all()
    assert "neighbouring chambers overlap by 1.06" in beside.reasons[0][0]


@pytest.mark.slow
def test_what_is_outside_of_the_law_is_told_of_the_best_design(problem):
    """The start is the first of the designs, the best one the second, others follow."""
    thin, thick, inside = ([H * mm] for H in (3.0, 7.0, 5.0))

    def told(*designs):
        beside = by_other_drive(problem, [np.array(x) for x in designs])
        return [sentence for sentence in beside.remarks if "not fitted" in sentence]

    assert "H = 7 mm" in told(inside, thick, inside)[0]
    assert told(inside, inside, thin) == []


@pytest.mark.slow
def test_designs_without_a_state_are_compared_at_a_lower_pressure():
    """The thin one snaps at a pressure below 31 kPa by the cell law: both are reported where both have a state."""
    space = Space({"held": held(points=16)}, [Variable("finger.H", 3 * mm, 6 * mm)])
    force = Quantity("tip_force", 31 * kPa, "held")
    problem = Problem(space, [Goal("maximise", force)])
    beside = by_other_drive(problem, [np.array([5 * mm]), np.array([3.9 * mm])], other_drive(problem, 4))
    quantity, drive, values = beside.compared(force)
    assert (quantity.observable, drive) == ("tip_force", "cell")
    assert np.isfinite(values).all()
    assert quantity.at == np.floor(quantity.at / kPa) * kPa
    for H, value, at_31 in zip((5 * mm, 3.9 * mm), values, beside.values[:, 0], strict=True):
        finger = sg.PneuNet(**(sizes() | {"H": jnp.asarray(H)}), material=sg.NeoHookean(mu=136 * kPa))
        scene = sg.pneunet.TipContact(finger, drive="cell")
        assert value == pytest.approx(float(sg.solve(scene, quantity.at).tip_force), rel=1e-9)
        later = sg.solve(scene, (quantity.at + 1 * kPa) / BELOW_LIMIT)
        assert (later.status == sg.Status.OK) == np.isfinite(at_31)
    assert [len(reasons) for reasons in beside.reasons] == [0, 1]
    assert f"{quantity.at / kPa:g} kPa, drive cell" in beside.rows(Problem(space, [Goal("maximise", force)]))[1][0]


@pytest.mark.slow
def test_a_curve_that_is_followed_is_told_by_the_other_drive_too(tmp_path):
    """A search for a shape said nothing of the other law, by which its best finger may have no state there."""
    points = [[0, 0], [24, -6], [38, -26]]
    text = f"""
[scene]
type = "pneunet.Free"
weight_N_per_m = [0, 0]
[scene.finger]
preset = "table_5_1_A"
[design]
starts = 1
steps = 1
finishes = 1
[[design.variables]]
name = "finger.t_m_mm"
low = 1.0
high = 1.4
[[design.goals]]
follow = {points}
at = {{{{ pressure_kPa = {{}} }}}}
"""
    said, told = {}, {}
    for pressure in (20, 45):
        path = tmp_path / f"at_{pressure}.toml"
        path.write_text(text.format(pressure))
        assert run(["design", str(path), "--out", str(tmp_path / str(pressure))]) == 0
        said[pressure] = (tmp_path / str(pressure) / "summary.txt").read_text()
        row = next(line for line in said[pressure].splitlines() if "(rms), drive cell" in line)
        told[pressure] = [cell.strip() for cell in row.split("│")[2:-1]]
    best = with_other_drive(configs.load(tmp_path / "20" / "best.toml").scene)
    shape = sg.solve(best, 20 * kPa).shape(1001)
    way = np.cumsum(np.hypot(*np.diff(points, axis=0).T))
    there = [np.interp(way / way[-1], np.linspace(0, 1, 1001), shape[axis]) / mm for axis in "xy"]
    far = np.hypot(*(np.array(there) - np.array(points[1:]).T))
    assert float(told[20][1].removesuffix(" mm")) == pytest.approx(np.sqrt(np.mean(far**2)), rel=1e-4)
    assert told[45] == ["-", "-"]
    assert "by the other drive" not in said[20]
    reason = sg.solve(with_other_drive(configs.load(tmp_path / "45" / "best.toml").scene), 45 * kPa).reason_text()
    assert f"Design 1 by the other drive, 45 kPa: {reason}." in said[45]
    for words in said.values():
        assert remarks(best)[0] in words


def test_two_pressures_that_come_down_to_the_same_one():
    """A finished search was lost by that: what is asked at both is asked there once."""
    space = Space({"held": held()}, [Variable("finger.H", 3 * mm, 6 * mm)])
    forces = [Quantity("tip_force", at * kPa, "held") for at in (30, 31)]
    problem = Problem(space, [Goal("maximise", force) for force in forces])
    limit = 22.7 * kPa

    def answers(rows, pressures):
        """A force of a tenth of the pressure (kPa), up to the limit."""
        given = np.broadcast_to(pressures, (len(rows), 2))
        there = given < limit
        status = np.where(there, int(sg.Status.OK), int(sg.Status.BEYOND_LIMIT))
        return Observed(np.where(there, given / 1e4, np.nan), status, 0 * status, np.where(there, np.nan, limit))

    asked_for = QuantitySet(space.scenes, forces)
    other = OtherDrive({"held": with_other_drive(held())}, asked_for, np.array([30, 31]) * kPa, answers, 2)
    beside = by_other_drive(problem, [np.array([5 * mm]), np.array([4 * mm])], other)
    assert [q.at for q in beside.quantities] == [30 * kPa, 31 * kPa, 22 * kPa]
    np.testing.assert_array_equal(beside.values, 2 * [[np.nan, np.nan, 2.2]])
    assert [len(reasons) for reasons in beside.reasons] == [2, 2]


def test_both_drives_double_the_scenes_and_the_constraints(problem):
    space, limits, reported = by_both_drives(problem.space, problem.goals, problem.limits)
    assert [scene.drive for scene in space.scenes.values()] == ["thesis", "cell"]
    assert [c.quantity.scene for c in limits] == ["held", "held" + SUFFIX]
    assert [q.scene for q in reported] == ["held" + SUFFIX]
    moved = space.scenes_at(jnp.array([4.2 * mm]))
    assert [float(scene.finger.H) for scene in moved.values()] == pytest.approx([4.2 * mm] * 2)


def test_a_rule_that_the_other_drive_lacks_is_not_asked_of_it(problem):
    """Chambers by the cell law may meet, and have no margin to overlapping: in a report that was a KeyError."""
    apart = Quantity("margins.chambers_apart", 15 * kPa, "held")
    alone = Problem(problem.space, [Goal("maximise", apart)])
    assert by_other_drive(alone, [problem.space.reference]) is None
    limits = [*problem.limits, Limits(apart, low=0.1 * mm)]
    _, doubled, reported = by_both_drives(problem.space, [*problem.goals, Goal("maximise", apart)], limits)
    names = [(c.quantity.observable, c.quantity.scene) for c in doubled]
    own = [("pressure", "held"), ("margins.chambers_apart", "held")]
    assert names == [*own, ("pressure", "held" + SUFFIX)]
    assert [q.observable for q in reported] == ["tip_force"]


@pytest.mark.slow
def test_both_drives_in_a_config(config, forces):
    config.write_text(CONFIG.format(drive='drive = "both"'))
    problem = settings.read(configs.load(config)).problem
    assert len(problem.limits) == 2
    assert "by both drives" in " ".join(problem.different_laws)
    assert by_other_drive(problem, [problem.space.reference]) is None
    # The state that is asked of the twin is the cell law's, and belongs to what every design must have.
    at = problem.solve(jnp.asarray(problem.space.to_unit(problem.space.reference)))
    values = dict(zip([problem.label(q) for q in problem.quantities], at.values, strict=False))
    name = next(label for label in values if label.endswith("tip_force at 15 kPa") and SUFFIX in label)
    np.testing.assert_allclose(values[name], forces["cell"], rtol=1e-9)
    assert float(at.shortfall) == 0


@pytest.mark.slow
def test_a_search_takes_no_state_beyond_a_limit_point_for_an_answer():
    """Chambers of this finger snap one by one; from a thicker one Newton's method leads over the first snaps."""
    snapping = sizes() | {"a": 5.653 * mm, "h_x": 0.806 * mm, "t_m": 1.485 * mm, "L": 60.015 * mm, "H": 4.6 * mm}
    finger = sg.PneuNet(**snapping, material=sg.NeoHookean(mu=136 * kPa))
    scene = sg.pneunet.TipContact(finger, drive="cell", inclination="segment")
    space = Space({"held": scene}, [Variable("finger.H", 4.0 * mm, 4.8 * mm)])
    problem = Problem(space, [Goal("maximise", Quantity("tip_force", 31.5 * kPa, "held"))])
    assert problem.doubted == [("held", 31.5 * kPa)]
    evaluate = Evaluator(problem, 2)
    for H in (4.6, 4.55, 4.5, 4.45, 4.4, 4.35, 4.3, 4.272):
        t = space.to_unit(np.array([H * mm]))
        exists = sg.solve(space.scenes_at(jnp.array([H * mm]))["held"], 31.5 * kPa).status == sg.Status.OK
        assert exists == (H > 4.45)  # sg.limit_pressure is 31.71 kPa at 4.5 mm and 31.26 at 4.4
        assert (evaluate(t[None]).shortfall[0] == 0) == exists


def test_shells_have_no_two_drives():
    space = Space({"free": sg.shell.Free(shell())}, [Variable("shell.t_m", 0.8 * mm, 2 * mm)])
    with pytest.raises(InputError, match='drive is "both", but no scene is a finger'):
        by_both_drives(space, [Goal("maximise", Quantity("inflation", 15 * kPa, "free"))], [])


@pytest.mark.slow
def test_a_scene_of_ones_own_is_not_replaced_by_a_twin():
    """Its name may end as those of twins do: it is compared like any other, and no twin takes its place."""
    force = Quantity("tip_force", 15 * kPa, "held" + SUFFIX)
    scenes = {"held": held(), "held" + SUFFIX: held(tip_offset=2 * mm)}
    space = Space(scenes, [Variable("finger.H", 4 * mm, 6 * mm)])
    with pytest.raises(InputError, match="drive is \"both\" and adds a scene 'held_other'; there is one already"):
        by_both_drives(space, [Goal("maximise", force)], [])
    assert by_other_drive(Problem(space, [Goal("maximise", force)]), [np.array([5 * mm])]).drives == ["cell"]


@pytest.mark.slow
def test_curves_name_the_drive_that_explains_them(tmp_path, capsys):
    scene = sg.pneunet.Free(sg.PneuNet.table_5_1("A"), weight=(0.0, 0.0), inclination="none", points=4, drive="cell")
    pressures = jnp.array([6.0, 12.0, 18.0]) * kPa
    angles = np.asarray(jax.vmap(lambda p: sg.solve(scene, p).tip_angle)(pressures))
    rows = "\n".join(f"{p / kPa},{angle}" for p, angle in zip(pressures, angles, strict=True))
    (tmp_path / "angles.csv").write_text(f"p,angle\n{rows}\n")
    (tmp_path / "fit.toml").write_text(CALIBRATE)
    assert run(["calibrate", str(tmp_path / "fit.toml"), "--out", str(tmp_path / "out")]) == 0
    assert "The drive 'cell' explains the curves better than 'thesis'" in capsys.readouterr().out
    result = json.loads((tmp_path / "out" / "result.json").read_text())["other_drive"]
    assert result["drives"] == ["thesis", "cell"]
    assert result["better"] == "cell"
    assert result["parameters"]["finger.material.mu"] == pytest.approx(136 * kPa, rel=1e-6)
    assert result["rmse"]["free"] < 1e-6
    fitted = configs.load(tmp_path / "out" / "calibrated_cell.toml").scenes["scene"]
    assert fitted.drive == "cell"
    assert float(fitted.finger.material.mu) == pytest.approx(136 * kPa, rel=1e-6)


def test_curves_without_a_state_speak_against_a_drive():
    def of(*likelihoods):
        return Rival((None, None), ("thesis", "cell"), likelihoods)

    assert of(0.0, -np.inf).better == "thesis"
    assert of(-np.inf, 0.0).better == "cell"
    assert of(-np.inf, -np.inf).better is None
    assert of(1.0, 1.5).better is None


def test_points_that_neither_drive_reaches_do_not_hide_the_others():
    """Where each of the two lost a point both likelihoods were nothing, and nothing told the drives apart."""

    def fit(errors):
        curve = SimpleNamespace(name="force", fit=True, noise=None, x=np.arange(5), y=np.linspace(0, 2, 5), size=2.0)
        space = SimpleNamespace(names=["finger.t_m"])
        fitting = SimpleNamespace(space=space, curves=[curve], of_curve=np.zeros(5, int))
        errors = np.array(errors)
        left = errors[np.isfinite(errors)]
        return SimpleNamespace(
            on_bound=np.array([False]),
            fitting=fitting,
            used=np.isfinite(errors),
            errors=errors,
            rmse=lambda k: float(np.sqrt(np.mean(left**2))),
        )

    good, bad = fit([0.01, -0.01, 0.01, -0.01, np.nan]), fit([0.2, -0.2, 0.2, -0.2, np.nan])
    found = rival(bad, good, ("thesis", "cell"))
    assert found.better == "cell"
    assert found.likelihoods[1] - found.likelihoods[0] == pytest.approx(4 * np.log(20), rel=1e-12)
    assert found.sentence() == (
        "The drive 'cell' explains the curves better than 'thesis': the logarithm of the likelihood is 12 larger over "
        "the points that both reach."
    )
    fewer = rival(good, fit([0.2, -0.2, np.nan, np.nan, np.nan]), ("thesis", "cell"))
    assert fewer.lost == (1, 3)
    assert fewer.sentence() == "The drive 'thesis' explains the curves; by 'cell' more points have no state."
    beside = rival(bad, fit([0.01, -0.01, 0.01, np.nan, np.nan]), ("thesis", "cell"))
    assert beside.sentence() == (
        "The drive 'thesis' explains the curves; by 'cell' more points have no state. Over the points that both reach "
        "'cell' is the better (the logarithm of the likelihood is 8.99 larger): are the others measured right?"
    )
    apart = rival(fit([np.nan, -0.01, 0.01, -0.01, 0.01]), bad, ("thesis", "cell"))
    assert apart.likelihoods[0] - apart.likelihoods[1] == pytest.approx(3 * np.log(20), rel=1e-12)
    assert rival(good, fit([0.01, 0.01, 0.01, 0.01, np.nan]), ("thesis", "cell")).better is None


def fit_of(error=0.1, on_bound=False, noise=None):
    """A fit of one curve with a range of 2, by its RMS error."""
    curve = SimpleNamespace(name="force", fit=True, noise=noise, x=np.arange(2), y=np.array([1.0, 3.0]), size=3.0)
    fitting = SimpleNamespace(space=SimpleNamespace(names=["finger.t_m"]), curves=[curve], of_curve=np.zeros(2, int))
    used = np.ones(2, bool)
    return SimpleNamespace(on_bound=np.array([on_bound]), fitting=fitting, used=used, rmse=lambda k: error)


def test_no_drive_explains_what_neither_follows():
    """A quarter of the range off is not explained, however much worse the other law does; a stated noise of that size
    explains it."""
    drives = ("thesis", "cell")
    said = Rival((fit_of(0.5, on_bound=True), fit_of(0.9)), drives, (-5.0, -np.inf)).sentence()
    assert said == (
        "Neither the drive 'thesis' nor 'cell' explains the curves: by 'thesis', the nearer one, the RMS error is 25 % "
        "of the range of 'force' (by 'thesis' finger.t_m ends on a bound); are the units and the columns right?"
    )
    tied = Rival((fit_of(0.9), fit_of(0.5)), drives, (-5.0, -4.0))
    assert not tied.explained
    assert "by 'cell', the nearer one, the RMS error is 25 % of" in tied.sentence()
    lost = Rival((fit_of(np.nan), fit_of(np.nan)), drives, (-np.inf, -np.inf)).sentence()
    assert "by 'thesis', the nearer one, 'force' has no state; are" in lost
    noisy = Rival((fit_of(0.5, noise=0.4), fit_of(0.9)), drives, (-5.0, -20.0))
    assert noisy.explained
    assert noisy.sentence().startswith("The drive 'thesis' explains the curves better than 'cell'")


def test_a_fit_on_a_bound_comes_nearer_and_explains_nothing():
    fits = fit_of(on_bound=True), fit_of()
    said = Rival(fits, ("thesis", "cell"), (-5.0, -20.0)).sentence()
    assert said.startswith("The drive 'thesis' comes nearer to the curves than 'cell': the logarithm")
    assert said.endswith("(by 'thesis' finger.t_m ends on a bound).")
    assert "explains" not in said + Rival(fits, ("thesis", "cell"), (-5.0, -np.inf)).sentence()


def test_a_fit_without_a_state_is_json():
    """It was NaN, which JSON does not have."""

    def curve(name):
        return SimpleNamespace(name=name, fit=True, noise=None, x=np.arange(2), y=np.array([1.0, 2.0]), size=2.0)

    other = SimpleNamespace(
        rmse=lambda k: [np.nan, 0.5][k],
        x=np.array([1.0]),
        fitting=SimpleNamespace(curves=[curve("lost"), curve("free")], of_curve=np.array([0, 0, 1, 1])),
        used=np.array([False, False, True, True]),
    )
    rival = Rival((other, other), ("thesis", "cell"), (0.0, -np.inf))
    found = _other(rival, lambda x: {"mu": x[0]})
    assert found["rmse"] == {"lost": None, "free": 0.5}
    assert found["log_likelihoods"] == [0.0, None]


@pytest.mark.parametrize("drive", ["thesis", "cell", "small_strain"])
def test_a_fit_tells_of_its_own_drive_and_the_other_one(drive, monkeypatch):
    fit = object.__new__(Fit)  # nothing of it is asked
    rival = Rival((fit, fit), (drive, OTHER[drive]), (0.0, 0.0))
    monkeypatch.setattr(rival_fits, "by_other_drive", lambda *_: rival)
    monkeypatch.setattr(rival_fits.Rival, "sentence", lambda _: "They are equal.")
    found = rival_fits.with_rival(rival_fits.Findings(fit, (), {}, None, (), ()), 1, 0)
    assert found.remarks[0] == "They are equal."
    assert f'"{drive}"' in found.remarks[1]
    assert '"cell"' in found.remarks[1]


def test_the_better_drive_is_said_in_words():
    fits = [fit_of(on_bound=bound) for bound in (True, False)]
    said = Rival((fits[0], fits[1]), ("thesis", "cell"), (-20.0, -5.0)).sentence()
    assert said == (
        "The drive 'cell' explains the curves better than 'thesis': the logarithm of the likelihood is 15 larger "
        "(by 'thesis' finger.t_m ends on a bound)."
    )
    assert "some points have no state" in Rival((fits[1], fits[1]), ("thesis", "cell"), (-np.inf, -5.0)).sentence()
    assert "do not tell" in Rival((fits[1], fits[1]), ("thesis", "cell"), (-4.0, -5.0)).sentence()


CALIBRATE = """
[scene]
type = "pneunet.Free"
weight_N_per_m = [0, 0]
inclination = "none"
points = 4
[scene.finger]
preset = "table_5_1_A"
material = { type = "NeoHookean", mu_kPa = 120 }
[calibrate]
starts = 1
[[calibrate.parameters]]
name = "finger.material.mu_kPa"
low = 20
high = 1000
scale = "log"
[[calibrate.curves]]
name = "free"
file = "angles.csv"
pressure = { column = "p", unit = "kPa" }
measured = { quantity = "tip_angle", column = "angle", unit = "rad" }
"""
