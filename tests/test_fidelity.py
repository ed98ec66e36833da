"""The cheapest model for a wanted error: its estimate is a bound, and nothing dearer is taken than is needed."""

import dataclasses
import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import reference_beam as ref
from conftest import ROOT
from fingers import TYPE_A, MPa, contact, pneunet, stacked
from helpers import ROD, shell

import softgrip_jax as sg
from softgrip_jax import fidelity
from softgrip_jax.cli import run
from softgrip_jax.errors import InputError
from softgrip_jax.units import kPa, mm

OK = int(sg.Status.OK)
TOLERANCES = (0.3, 0.03, 1e-2, 1e-3, 1e-4, 1e-6)


def random_fingers(rng, count):
    """(scene, pressure in MPa, its dict and loads): builds within 40 %, weights, pulls and offsets, 0.3 to 0.9 of what
    bends an unloaded finger to its fold."""
    cases = []
    while len(cases) < count:
        f = {name: value * np.exp(rng.uniform(-0.4, 0.4)) for name, value in TYPE_A.items()}
        stiffness = f["mu"] * f["B"] * f["H"] ** 3 / 3
        wanted = rng.uniform(0.3, 0.9) * 6.278 * stiffness / f["L"]
        pressure = ref.pressure_of(f, wanted)
        size, angle = 10 ** rng.uniform(-4, 0.3) * stiffness / f["L"] ** 3, rng.uniform(0, 2 * np.pi)
        loads = (
            rng.uniform(-0.2, 0.2) * f["L"],
            rng.uniform(-2, 4) * stiffness / f["L"] ** 2,
            (size * np.cos(angle), size * np.sin(angle)),
        )
        cases.append((contact(f, "exact", *loads), pressure, f, loads))
    return cases


@jax.jit
def answer(scenes, pressures):
    """The solutions of a batch, in chunks."""
    return jax.lax.map(lambda lane: sg.solve(*lane), (scenes, pressures), batch_size=64)


def forces(scenes, cases):
    """(tip forces, statuses) of a batch of scenes at the pressures of the cases."""
    found = answer(scenes, jnp.asarray([p * MPa for _, p, *_ in cases]))
    return np.asarray(found.tip_force), np.asarray(found.status)


def compared(cases, kept, truth):
    """Every case decided on the models that are kept: (bounds that hold, all bounds, tolerances that are missed, cases
    that took the dearest model though a cheaper one was good enough, how many models)."""
    ladder = fidelity.model_ladder(cases[0][0], ["tip_force"])
    places = [k for k, model in enumerate(ladder) if kept(model)]
    batch = stacked([scene for scene, *_ in cases])
    models = jax.vmap(lambda scene: [model.scene for model in fidelity.model_ladder(scene, ["tip_force"])])(batch)
    table = [forces(models[k], cases) for k in places]
    kept_models = [ladder[k] for k in places]
    bounded, total, missed, needless = 0, 0, [], []
    for lane, true in enumerate(truth):
        if not np.isfinite(true) or table[-1][1][lane] != OK:
            continue

        def read(k, lane=lane):
            return fidelity.Reading(table[k][0][lane, None], int(table[k][1][lane]))

        real = np.array([abs(force[lane] / true - 1) if s[lane] == OK else np.inf for force, s in table])
        _, errors = fidelity.decide(kept_models, read, 1e-300)
        known = [k for k in errors if np.isfinite(errors[k])]
        bounded += sum(real[k] <= errors[k] for k in known)
        total += len(known)
        for tolerance in TOLERANCES:
            chosen, errors = fidelity.decide(kept_models, read, tolerance)
            if errors[chosen] <= tolerance < real[chosen]:
                missed.append((lane, tolerance, real[chosen]))
            if chosen == len(places) - 1 and np.min(real[:-1]) <= tolerance:
                needless.append((lane, tolerance, real))
    return bounded, total, missed, needless, len(kept_models)


def few(model):
    """A handful of programs: the linear finger, without the stretch, without the weight, and the dearest two."""
    kept = [(("stretch of the cover",), "4"), (("weight of the finger",), "9"), ((), "14"), ((), "21")]
    return model.numerics == "explicit" or (model.left_out, model.numerics.split()[0]) in kept


@pytest.mark.slow  # compiles every model of the ladder
def test_estimates_bound_the_error_at_random_fingers():
    """Against SciPy, at the tip force; the truth of a few lanes, each by another code, to 1e-9."""
    cases = random_fingers(np.random.default_rng(3), 8)
    truth = []
    for _, p, f, loads in cases:
        try:
            truth.append(ref.held_tip(f, "exact", [(f["L"], ref.end_moment(f, p))], *loads)[1])
        except AssertionError:  # beyond its fold
            truth.append(np.nan)
    assert np.sum(np.isfinite(truth)) >= 6
    bounded, total, missed, needless, models = compared(cases, few, truth)
    assert models == 5
    assert bounded == total
    assert total > 25
    assert not missed
    assert not needless


@pytest.mark.slow
def test_estimates_bound_the_error_at_a_thousand_fingers():
    """Against twice the points of the dearest model, on every model of the ladder."""
    cases = random_fingers(np.random.default_rng(4), 1000)
    truth, status = forces(stacked([dataclasses.replace(scene, points=32) for scene, *_ in cases]), cases)
    truth = np.where(status == OK, truth, np.nan)
    bounded, total, missed, needless, models = compared(cases, lambda _: True, truth)
    print(f"{np.sum(status == OK)} fingers with an equilibrium, {models} models: bounds hold in {bounded} of {total}")
    print("missed:", missed, "needlessly dear:", needless)
    assert np.sum(status == OK) > 900
    assert bounded >= 0.99 * total
    assert not needless


def test_more_points_of_a_cell_finger_claim_no_gain():
    """Its law bends sharply where walls begin to touch: from 21 to 42 points random fingers changed by up to 2e-4."""
    ladder = fidelity.model_ladder(sg.pneunet.TipContact(sg.PneuNet.table_5_1("A"), drive="cell"), ["tip_force"])
    last = len(ladder) - 1

    def read(k):
        return fidelity.Reading(np.array([1.0 if k == last else 1.0001]), OK)

    _, errors = fidelity.decide(ladder, read, 1e-9)
    assert errors[last] > 0.99e-4


def test_coarse_numerics_that_agree_by_chance_do_not_rule_out_finer_ones():
    """Errors of two coarse models may be equal; where nothing is left out, finer ones always help."""
    errors = [4e-1, 7.13e-5, 7.15e-5, 2.4e-7, 7.8e-10, 0.0]
    finer = [fidelity.LadderModel(None, (), f"{2**k} points", float(k), fidelity.POINT_GAIN) for k in range(5)]
    ladder = [fidelity.LadderModel(None, ("all loads",), "explicit", 0.0), *finer]
    for tolerance, wanted in ((1e-4, 1), (1e-6, 3), (1e-8, 4)):
        chosen, _ = fidelity.decide(ladder, lambda k: fidelity.Reading(np.array([1 + errors[k]]), OK), tolerance)
        assert chosen == wanted


def test_a_choice_says_what_it_leaves_out_and_why():
    scene = sg.shell.Free(shell())
    small, large = fidelity.choose(scene, 1 * kPa, 0.1), fidelity.choose(scene, 12 * kPa, 0.1)
    assert (small.left_out, small.met, type(small.scene)) == (("large strains",), True, sg.shell.Plate)
    assert (large.left_out, large.met, large.scene) == ((), True, scene)
    plate, arc = (float(sg.solve(s, 12 * kPa).inflation) for s in (sg.shell.Plate(shell()), scene))
    assert large.trials[0].error == pytest.approx(abs(plate / arc - 1))
    assert "left out for 10 % of inflation: large strains (explicit)" in str(small)
    assert "left out for 10 % of inflation: nothing" in str(large)
    # An inverse question: whose pressure is how far off?
    inverse = fidelity.choose(scene, tolerance=0.5, inflation=5 * mm)
    pressures = [float(sg.pressure_for(s, inflation=5 * mm).pressure) for s in (sg.shell.Plate(shell()), scene)]
    assert (inverse.observable, inverse.left_out) == ("pressure", ("large strains",))
    assert inverse.error == pytest.approx(abs(pressures[0] / pressures[1] - 1))


def test_without_a_value_nothing_is_left_out():
    beyond = fidelity.choose(sg.shell.Free(shell()), 500 * kPa, 0.5)
    assert (int(beyond.solution.status), beyond.left_out, beyond.error) == (int(sg.Status.BEYOND_LIMIT), (), np.inf)
    assert "BEYOND_LIMIT" in str(beyond)
    untouched = fidelity.choose(sg.shell.CylinderContact(shell(), **ROD), 1.0)
    assert (int(untouched.solution.status), untouched.error) == (int(sg.Status.NO_CONTACT), 0.0)
    # A linear finger is straight below first contact: zero force is right, the tip of a held finger it does not know.
    linear = fidelity.model_ladder(contact(TYPE_A, "exact"), ["tip_force"])[0].scene
    assert isinstance(linear, sg.pneunet.Linear)
    ladder = fidelity.model_ladder(contact(TYPE_A, "exact"), ["tip"])
    assert not any(isinstance(model.scene, sg.pneunet.Linear) for model in ladder)


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ({"observable": "force"}, "Free has no observable 'force'; it has: inflation"),
        ({"tolerance": 0.0}, "tolerance is 0; it must be a positive finite number"),
        ({"tolerance": np.nan}, "tolerance is nan; it must be a positive finite number"),
        ({"pressure": np.array([1e3, 2e3])}, "one known pressure"),
    ],
)
def test_mistakes_are_told(arguments, sentence):
    with pytest.raises(ValueError, match=sentence):
        fidelity.choose(sg.shell.Free(shell()), **({"pressure": 1e3} | arguments))


def test_command_line(capsys):
    config = str(ROOT / "configs" / "shell_free.toml")
    assert run(["solve", config, "--tolerance", "30%"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    assert "left out for 30 % of inflation: large strains (explicit)" in out
    assert run(["solve", config, "--tolerance", "0.01", "--observable", "stretch", "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["fidelity"]["observable"] == "stretch"
    assert (data["fidelity"]["left_out"], data["fidelity"]["met"]) == ([], True)
    for wrong in (["--tolerance", "lots"], ["--tolerance", "-1%"], ["--tolerance", "1"], ["--observable", "stretch"]):
        assert run(["solve", config, *wrong]) == 2
        assert len(capsys.readouterr().err.splitlines()) == 1


def test_ladders_of_every_kind_are_ordered_and_complete():
    """Cheapest first, the dearest leaves nothing out; each simplification is there alone and with the others."""
    finger = pneunet(TYPE_A)
    free = fidelity.model_ladder(sg.pneunet.Free(finger), ["tip"])
    assert [r.cost for r in free[:-1]] == sorted(r.cost for r in free[:-1])
    assert free[-1].left_out == ()
    assert {len(r.left_out) for r in free} == {0, 1, 2, 3}
    assert len({r.left_out for r in free}) == 9  # 2^3 and the linear finger
    assert len(free[-1].scene.chambers()[1].places) == 6  # in each of 13 parts; with 4 in each the error is estimated
    cell = fidelity.model_ladder(sg.pneunet.TipContact(finger, drive="cell"), ["tip_force"])
    assert {r.left_out for r in cell if getattr(r.scene, "drive", "") == "thesis"} >= {(fidelity.CELL_LEFT_OUT,)}
    assert cell[-1].scene.drive == "cell"
    # The cell law has neither section nor inclination, and a scene keeps its rules (cover_bears_pull) on every model.
    for scene in (sg.pneunet.TipContact(finger, drive="cell"), sg.pneunet.Free(finger, drive="cell", weight=None)):
        by_cell = [r for r in fidelity.model_ladder(scene, ["tip_angle"]) if getattr(r.scene, "drive", "") == "cell"]
        assert {(r.left_out, r.scene.section, r.scene.inclination) for r in by_cell} == {
            ((), scene.section, scene.inclination)
        }
    assert cell[0].left_out == ("large deflections and strains", "all loads", fidelity.CELL_LEFT_OUT)
    plates = fidelity.model_ladder(sg.pneunet.Free(finger, drive="small_strain"), ["tip"])
    assert not any("inclination of the walls" in r.left_out for r in plates)  # they know none
    energy = fidelity.model_ladder(sg.shell.FlatContact(shell(), distance=5 * mm, model="energy"), ["force"])
    assert [r.numerics.split(" poly")[0] for r in energy[1:]] == ["2 x 3", "3 x 4", "4 x 6", "5 x 8"]
    assert energy[0].scene.model == "arc"
    assert len(fidelity.model_ladder(sg.shell.CylinderContact(shell(), **ROD), ["force"])) == 1


def test_models_under_strong_loads_have_the_points_that_they_say():
    """`solve` raised the points of all of them to one number: the error was that of a model beside itself, nothing."""
    pulled = sg.pneunet.TipContact(pneunet(TYPE_A), tip_pull=0.5, drive="cell")
    ladder = fidelity.model_ladder(pulled, ["tip_force"])[1:]
    assert len(ladder) > 3
    for model in ladder:
        assert model.numerics == f"{model.scene.prepared().method().points} points along the finger"


def test_every_model_ignores_the_rules_that_its_scene_ignores():
    """Energy membranes had them all: of a scene that broke one no model had a value."""
    ignored = ("membrane_above_clamp", "membrane_clear_at_rest")
    for scene in (
        sg.shell.Free(shell(), model="energy", ignored_rules=ignored),
        sg.shell.FlatContact(shell(), distance=5 * mm, model="energy", ignored_rules=ignored),
    ):
        ladder = fidelity.model_ladder(scene, [])
        assert {model.scene.ignored_rules for model in ladder} == {ignored}


def test_a_pressure_and_a_target_are_two_questions():
    """The target had no part in the answer."""
    with pytest.raises(InputError, match="got a pressure and a target"):
        fidelity.choose(sg.shell.Free(shell()), 10 * kPa, inflation=5 * mm)
