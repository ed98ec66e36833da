"""Every mistake of a user is told in one sentence that says where, what was found and what is allowed."""

import dataclasses
import re
import subprocess
import sys
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
from conftest import ROOT
from helpers import shell

import softgrip_jax as sg
from optim.design import settings
from optim.problem import Goal
from softgrip_jax import config as configs
from softgrip_jax import thesis
from softgrip_jax.cli import MISTAKE, run
from softgrip_jax.config.keys import varied
from softgrip_jax.errors import ConfigError
from softgrip_jax.objects.friction import FrictionTable
from softgrip_jax.units import kPa, mm

GOOD = """[scene]
type = "shell.Grasp"
radius_mm = 20
gap_mm = 5
mass_g = 563
friction = 0.96
lever = "exact"
fingers = 2
[scene.shell]
a_mm = 16
b_mm = 43
t_m_mm = 1.1
[scene.shell.material]
type = "NeoHookean"
mu_kPa = 175
[solve]
pressure_kPa = 15
"""
MATERIAL = 'type = "NeoHookean"\nmu_kPa = 175'
POSITIVE_MM = "it must be a positive finite number in mm."

EDITS = {
    # what is wrong: (text in GOOD, what stands there instead, what the sentence says)
    "empty": (GOOD, "", "there is no section [scene], which says what to solve."),
    "not toml": ("gap_mm = 5", "gap_mm: 5", "this is not TOML"),
    "half a line": ("gap_mm = 5", "gap_mm =", "this is not TOML"),
    "key twice": ("gap_mm = 5", "gap_mm = 5\ngap_mm = 5", "this is not TOML"),
    "unknown section": ("[solve]", "[solv]", "there is no section [solv]; did you mean solve?"),
    "far-off section": ("[solve]", "[zzz]", "there is no section [zzz]; allowed are scene, scenes, solve, sweep"),
    "a key above the sections": ("[scene]\n", "radius_mm = 2\n[scene]\n", "there is no section [radius_mm]"),
    "section as number": (GOOD, "scene = 3", "scene is 3; it must be a section, [scene]."),
    "sections in a list": ("[scene]\n", "[[scene]]\n", "; it must be a section, [scene]."),
    "no type of scene": ('type = "shell.Grasp"\n', "", "the key type is missing; it must be one of"),
    "unknown scene": ("shell.Grasp", "shell.Graps", "type is 'shell.Graps'; did you mean 'shell.Grasp'?"),
    "scene type as number": ('"shell.Grasp"', "7", "type is 7; it must be one of"),
    "abstract scene": ("shell.Grasp", "shell.ShellScene", "type is 'shell.ShellScene'"),
    "unknown key": ("gap_mm = 5", "gap_mm = 5\ncolour = 3", "there is no key colour of shell.Grasp; allowed are"),
    "misspelt key": ("radius_mm", "raduis_mm", "there is no key raduis_mm of shell.Grasp; did you mean radius_mm?"),
    "other unit": (
        "radius_mm = 20",
        "radius_cm = 2",
        "there is no key radius_cm of shell.Grasp; did you mean radius_mm",
    ),
    "no unit": ("radius_mm", "radius", "there is no key radius of shell.Grasp; did you mean radius_mm?"),
    "no unit on a short name": ("a_mm", "a", "there is no key a of FlatShell; did you mean a_mm?"),
    "thickness by a short name": ("t_m_mm", "t_mm", "there is no key t_mm of FlatShell; did you mean t_m_mm?"),
    "unit in capitals": ("mu_kPa", "mu_KPA", "there is no key mu_KPA of NeoHookean; did you mean mu_kPa?"),
    "missing key": ("radius_mm = 20\n", "", "the key radius_mm of shell.Grasp is missing."),
    "missing thickness": ("t_m_mm = 1.1\n", "", "the key t_m_mm of FlatShell is missing."),
    "missing shell": (GOOD[GOOD.index("[scene.shell]") : GOOD.index("[solve]")], "", "the key shell of shell.Grasp"),
    "missing material": (
        GOOD[GOOD.index("[scene.shell.m") : GOOD.index("[solve]")],
        "",
        "the key material of",
    ),
    "text for a number": ("gap_mm = 5", 'gap_mm = "5"', f"gap_mm is '5'; {POSITIVE_MM}"),
    "truth for a number": ("gap_mm = 5", "gap_mm = true", f"gap_mm is true; {POSITIVE_MM}"),
    "list for a number": ("gap_mm = 5", "gap_mm = [5]", f"gap_mm is [5]; {POSITIVE_MM}"),
    "table for a number": ("gap_mm = 5", "gap_mm = {x = 1}", f"gap_mm is a table; {POSITIVE_MM}"),
    "date for a number": ("gap_mm = 5", "gap_mm = 2020-01-01", POSITIVE_MM),
    "nan": ("gap_mm = 5", "gap_mm = nan", f"gap_mm is nan; {POSITIVE_MM}"),
    "infinity": ("gap_mm = 5", "gap_mm = inf", f"gap_mm is inf; {POSITIVE_MM}"),
    "negative": ("gap_mm = 5", "gap_mm = -5", f"gap_mm is -5; {POSITIVE_MM}"),
    "too large for a float": ("gap_mm = 5", f"gap_mm = 1{'0' * 400}", POSITIVE_MM),
    "zero thickness": ("t_m_mm = 1.1", "t_m_mm = 0", f"t_m_mm is 0; {POSITIVE_MM}"),
    "negative modulus": ("mu_kPa = 175", "mu_kPa = -1", "mu_kPa is -1; it must be a positive finite number in kPa."),
    "negative mass": ("mass_g = 563", "mass_g = -1", "mass_g is -1; it must be a finite number, zero or more in g."),
    "sides exchanged": ("b_mm = 43", "b_mm = 15", "FlatShell.b is 15 mm; it must be at least a (16 mm)"),
    "soft all together": (
        MATERIAL,
        'type = "Ogden"\nmu_kPa = [100, -200]\nalpha = [2, 2]',
        "Ogden has a shear modulus of -100 kPa; its constants must make it positive.",
    ),
    "unknown choice": ('"exact"', '"exakt"', "lever is 'exakt'; did you mean 'exact'?"),
    "number for a choice": ('"exact"', "1", "lever is 1; it must be one of 'exact', 'rim'."),
    "part of a finger": ("fingers = 2", "fingers = 2.5", "fingers is 2.5; it must be a whole number."),
    "no fingers": ("fingers = 2", "fingers = 0", "Grasp.fingers is 0; it must be a whole number, 1 or more."),
    "truth for fingers": ("fingers = 2", "fingers = true", "fingers is true; it must be a whole number."),
    "unknown material": ('"NeoHookean"', '"NeoHokean"', "type is 'NeoHokean'; did you mean 'NeoHookean'?"),
    "material of another": ("mu_kPa", "c1_kPa", "there is no key c1_kPa of NeoHookean; did you mean mu_kPa?"),
    "material as text": (f"[scene.shell.material]\n{MATERIAL}", 'material = "rubber"', "it must be a table."),
    "unknown preset": (MATERIAL, 'preset = "dragon_skin_40"', "preset is 'dragon_skin_40'; did you mean 'dragon_skin_"),
    "preset and other type": (MATERIAL, 'preset = "dragon_skin_30"\ntype = "Gent"', "the preset is a NeoHookean"),
    "uneven lists": (
        MATERIAL,
        'type = "Ogden"\nmu_kPa = [1, 2]\nalpha = [1]',
        "Ogden.mu and Ogden.alpha have shapes (2,) and (1,); they must be two lists of the same length.",
    ),
    "empty list": (
        MATERIAL,
        'type = "Ogden"\nmu_kPa = []\nalpha = []',
        "mu_kPa is []; it must be a list of numbers, each a finite number in kPa.",
    ),
    "number for a list": (
        MATERIAL,
        'type = "Ogden"\nmu_kPa = 1\nalpha = 1',
        "mu_kPa is 1; it must be a list of",
    ),
    "text in a list": (MATERIAL, 'type = "Ogden"\nmu_kPa = [1, "x"]\nalpha = [1, 2]', "mu_kPa is [1, 'x']; it must be"),
    "no friction": ("friction = 0.96", "friction = 0", "friction is 0; it must be a positive finite number."),
    "friction as text": ("friction = 0.96", 'friction = "rough"', "friction is 'rough'; it must be a positive"),
    "falling friction table": (
        "friction = 0.96",
        "friction = {force_N = [2, 1], coefficient = [1, 1]}",
        "[scene.friction]: FrictionTable.force is [2.0, 1.0]; it must increase from row to row.",
    ),
    "friction table without unit": (
        "friction = 0.96",
        "friction = {force = [1, 2], coefficient = [1, 1]}",
        "there is no key force of FrictionTable; did you mean force_N?",
    ),
    "negative pressure": ("= 15", "= -15", "pressure_kPa is -15; it must be a finite number, zero or more in kPa."),
    "pressure as text": ("= 15", '= "high"', "pressure_kPa is 'high'; it must be"),
    "two targets": ("= 15", "= 15\nforce_N = 2", "pressure_kPa and force_N are both given"),
    "unknown observable": ("pressure_kPa", "torque_N_mm", "there is no key torque_N_mm; allowed are pressure_kPa"),
    "observable without unit": ("pressure_kPa", "force", "there is no key force; did you mean force_N?"),
    "pressure in bar": ("pressure_kPa", "pressure_bar", "there is no key pressure_bar; did you mean pressure_kPa?"),
    "target as nan": ("pressure_kPa = 15", "force_N = nan", "force_N is nan; it must be a finite number in N."),
}


FINGER_EDITS = {
    # what is wrong: (config, text in it, what stands there instead, what the sentence says)
    "unknown section law": (
        "finger_grasp",
        'section = "exact"',
        'section = "euler"',
        "section is 'euler'; it must be one of 'exact', 'thesis', 'inextensible'.",
    ),
    "one finger": (
        "finger_grasp",
        "n = 3 ",
        "n = 1 ",
        "[scene.gripper]: Gripper.n is 1; it must be a whole number, 2 or more.",
    ),
    "unknown preset": (
        "finger_grasp",
        "table_5_1_A",
        "table_5_1_E",
        "preset is 'table_5_1_E'; did you mean 'table_5_1_D'?",
    ),
    "no finger": (
        "finger_grasp",
        'preset = "table_5_1_A"',
        "",
        "[scene.gripper.finger]: the key a_mm of PneuNet is missing.",
    ),
    "preset and a bad field": (
        "finger_grasp",
        'preset = "table_5_1_A"',
        'preset = "table_5_1_A"\nH_mm = 0',
        "H_mm is 0; it must be a positive finite number in mm.",
    ),
    "weight as one number": (
        "finger_grasp",
        "= [2, 0] ",
        "= 2 ",
        "weight_N_per_m is 2; it must be a list of 2 numbers, each a finite number in N/m.",
    ),
    "weight in space": (
        "finger_grasp",
        "= [2, 0] ",
        "= [2, 0, 1] ",
        "weight_N_per_m is [2, 0, 1]; it must be a list of 2 numbers",
    ),
    "weight as nan": (
        "finger_grasp",
        "= [2, 0] ",
        "= [nan, 0] ",
        "weight_N_per_m is [nan, 0]; it must be a list of 2 numbers",
    ),
    "unknown object": (
        "finger_grasp",
        '"Cylinder"',
        '"Sphere"',
        "[scene.object]: type is 'Sphere'; it must be one of 'Cylinder', 'HexagonalCylinder',",
    ),
    "cone without height": (
        "finger_grasp",
        'type = "Cylinder"',
        'type = "Cone"',
        "[scene.object]: the key height_mm of Cone is missing.",
    ),
    "cone without its place": (
        "finger_grasp",
        'type = "Cylinder"',
        'type = "Cone"\nheight_mm = 80',
        "Grasp.stand_distance is missing: the radius of a Cone depends on the height of the tip",
    ),
    "negative radius": (
        "finger_grasp",
        "radius_mm = 18",
        "radius_mm = -18",
        "radius_mm is -18; it must be a positive finite number in mm.",
    ),
    "no points": (
        "finger_grasp",
        'section = "exact"',
        "points = 0",
        "Grasp.points is 0; it must be a whole number, 1 or more.",
    ),
    "half a point": ("finger_grasp", 'section = "exact"', "points = 2.5", "points is 2.5; it must be a whole number."),
    "lists of two lengths": (
        "finger_nonuniform",
        "1.2, 1.2, 1.2, 1.2]",
        "1.2, 1.2, 1.2]",
        "'h_x': (12,), 't_m': (11,)",
    ),
    "negative in a list": (
        "finger_nonuniform",
        "[0.7, 0.7",
        "[-0.7, 0.7",
        "it must be a finite number, zero or more in mm, or a list of such numbers.",
    ),
    "empty list": (
        "finger_nonuniform",
        "h_x_mm = [0.7, 0.7, 0.7, 0.8, 0.8, 0.8, 0.9, 0.9, 0.9, 1, 1, 1]",
        "h_x_mm = []",
        "h_x_mm is []; it must be a finite number, zero or more in mm, or a list of such numbers.",
    ),
    "list of covers": (
        "finger_nonuniform",
        'preset = "table_5_1_A"',
        'preset = "table_5_1_A"\nH_mm = [5, 5]',
        "H_mm is [5, 5]; it must be a positive finite number in mm.",
    ),
    "unknown combination": (
        "finger_nonuniform",
        '"sum"',
        '"least"',
        "combination is 'least'; it must be one of 'sum', 'larger'.",
    ),
    "unknown inclination": (
        "finger_nonuniform",
        'combination = "sum"',
        'inclination = "full"',
        "inclination is 'full'; it must be one of 'segment', 'gap', 'none'.",
    ),
    "angle as word": (
        "finger_nonuniform",
        'combination = "sum"',
        'clamp_angle_deg = "up"',
        "clamp_angle_deg is 'up'; it must be a finite number in deg.",
    ),
    "half a force": (
        "finger_nonuniform",
        'combination = "sum"',
        "tip_load_N = [0.1]",
        "tip_load_N is [0.1]; it must be a list of 2 numbers, each a finite number in N.",
    ),
    "angle as text": (
        "finger_nonuniform",
        "pressure_kPa = 25",
        "tip_angle_deg = 'all'",
        "tip_angle_deg is 'all'; it must be a finite number in deg.",
    ),
    "one number for a point": (
        "finger_nonuniform",
        "pressure_kPa = 25",
        "tip_mm = 5",
        "there is no key tip_mm; did you mean tip_angle_deg?",
    ),
}


def in_one_sentence(text: str) -> bool:
    return text.count("\n") == 1 and text.endswith((".\n", "?\n")) and "Traceback" not in text


def told(arguments, capsys) -> str:
    """The sentence on stderr, after the checks that hold for every mistake."""
    code = run([str(argument) for argument in arguments])
    out, err = capsys.readouterr()
    assert (code, out) == (MISTAKE, "")
    assert in_one_sentence(err), err
    return err


def check_edit(good, edit, tmp_path, capsys):
    """One sentence about a config in which (old text, new text, what is said) was changed, and nothing written."""
    old, new, says = edit
    assert old in good
    path = tmp_path / "bad.toml"
    path.write_text(good.replace(old, new, 1), encoding="utf-8")
    sentence = told(["solve", path], capsys)
    assert sentence.startswith(f"{path}")
    assert says in sentence
    assert list(tmp_path.iterdir()) == [path]


def test_a_far_off_scene_is_told_which_there_are(tmp_path, capsys):
    """Those of the package, in whatever place: scenes that other tests have defined stand among them."""
    path = tmp_path / "bad.toml"
    path.write_text(GOOD.replace("shell.Grasp", "banana", 1), encoding="utf-8")
    sentence = told(["solve", path], capsys)
    assert sentence.startswith(f"{path}, [scene]: type is 'banana'; it must be one of '")
    named = re.findall(r"'([\w.]+)'", sentence.partition("it must be one of ")[2])
    assert {"shell.Free", "shell.Grasp", "pneunet.TipContact", "pneunet.Grasp"} <= set(named)


@pytest.mark.parametrize("name", EDITS)
def test_config(name, tmp_path, capsys):
    check_edit(GOOD, EDITS[name], tmp_path, capsys)


@pytest.mark.parametrize("name", FINGER_EDITS)
def test_finger_config(name, tmp_path, capsys):
    config, *edit = FINGER_EDITS[name]
    check_edit((ROOT / "configs" / f"{config}.toml").read_text(encoding="utf-8"), edit, tmp_path, capsys)


@pytest.mark.parametrize(
    ("scene", "says"),
    [
        ("mass_g = 0", "pressure_for(Grasp) needs Grasp.mass > 0, or a target such as force=2.0 (in N)"),
        ("", "there is nothing to solve for"),
    ],
)
def test_nothing_is_asked(scene, says, tmp_path, capsys):
    path = tmp_path / "bad.toml"
    path.write_text(GOOD.replace("mass_g = 563", scene).replace("[solve]\npressure_kPa = 15\n", ""))
    assert says in told(["solve", path], capsys)


def test_a_scene_without_a_task_of_its_own_is_asked_nothing(tmp_path, capsys):
    path = tmp_path / "bad.toml"
    text = GOOD.replace("shell.Grasp", "shell.CylinderContact").partition("[solve]")[0]
    held = ("mass_g", "friction", "lever", "fingers")
    path.write_text("\n".join(line for line in text.splitlines() if not line.startswith(held)))
    said = told(["solve", path], capsys)
    assert (
        "there is nothing to solve for; give pressure_kPa or an observable, for instance force_N, in [solve]." in said
    )


@pytest.mark.parametrize("pressure", [jnp.asarray(True), jnp.asarray(1e4 + 1j), np.asarray(True)])
def test_an_array_that_holds_no_real_number(pressure):
    with pytest.raises(sg.errors.InputError, match="it must be a finite number, zero or more in Pa"):
        sg.solve(sg.shell.Free(shell()), pressure)


@pytest.mark.parametrize("n", [1, -3, True])
def test_points_of_a_shape_are_counted(n):
    solution = sg.solve(sg.shell.Free(shell()), 1e4)
    with pytest.raises(ValueError, match=f"n is {n}; it must be a whole number, 2 or more"):
        solution.shape(n)


def test_files(tmp_path, capsys):
    assert "no such file or directory" in told(["solve", tmp_path / "absent.toml"], capsys)
    assert "is a directory" in told(["solve", tmp_path], capsys)
    latin = tmp_path / "latin.toml"
    latin.write_bytes("# caf\xe9".encode("latin-1"))
    assert "this is not a text file in UTF-8 (byte 5)." in told(["solve", latin], capsys)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["solve"], "Missing argument"),
        (["slove"], "No such command 'slove'"),
        (["solve", "x.toml", "--bogus"], "No such option: --bogus"),
        (["solve", "x.toml", "y.toml"], "unexpected extra argument"),
        (["solve", "x.toml", "--pressure-kPa", "high"], "Invalid value for '--pressure-kPa'"),
        (["solve", "x.toml", "--plot", "picture.bmp"], "--plot is 'picture.bmp'; it must be a file that ends in .png"),
        (
            ["solve", "x.toml", "--plot", "/no/such/x.png"],
            "/no/such/x.png'; a file cannot be written there: there is no",
        ),
        (["path", "x.toml", "--csv", "/proc/x.csv"], "--csv is '/proc/x.csv'; a file cannot be written there: "),
        (["path", "x.toml", "--animate", "/x.gif/x.gif"], "a file cannot be written there: there is no folder /x.gif."),
        (["design"], "Missing argument"),
    ],
)
def test_command_line(arguments, says, capsys):
    assert says in told(arguments, capsys)


@pytest.mark.parametrize("value", ["-1", "nan", "inf"])
def test_pressure_option(value, tmp_path, capsys):
    path = tmp_path / "good.toml"
    path.write_text(GOOD)
    sentence = told(["solve", path, "--pressure-kPa", value], capsys)
    assert sentence.startswith("--pressure-kPa is ")
    assert "it must be a finite number, zero or more in kPa." in sentence


def test_as_a_process(tmp_path):
    path = tmp_path / "bad.toml"
    path.write_text(GOOD.replace("radius_mm", "radius_cm"))
    script = Path(sys.executable).with_name("softgrip")
    for command in ([sys.executable, "-m", "softgrip_jax", "solve", path], [script, "solve", tmp_path / "no.toml"]):
        done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, timeout=120)
        assert (done.returncode, done.stdout) == (2, "")
        assert in_one_sentence(done.stderr), done.stderr


SHELL = {"a": 16 * mm, "b": 43 * mm, "t_m": 1.1 * mm, "material": sg.NeoHookean(mu=175 * kPa)}


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: sg.FlatShell(**SHELL | {"t_m": 0.0}), "FlatShell.t_m is 0; it must be a positive finite number in m."),
        (lambda: sg.FlatShell(**SHELL | {"a": float("nan")}), "FlatShell.a is nan"),
        (lambda: sg.FlatShell(**SHELL | {"a": "16 mm"}), "FlatShell.a is '16 mm'"),
        (lambda: sg.FlatShell(**SHELL | {"a": True}), "FlatShell.a is True"),
        (lambda: sg.FlatShell(**SHELL | {"a": None}), "FlatShell.a is None"),
        (lambda: sg.FlatShell(**SHELL | {"a": 1j}), "FlatShell.a is 1j"),
        (lambda: sg.FlatShell(**SHELL | {"b": 10 * mm}), "FlatShell.b is 0.01 m; it must be at least a (0.016 m)"),
        (lambda: sg.NeoHookean(mu=-1), "NeoHookean.mu is -1; it must be a positive finite number in Pa."),
        (lambda: sg.Ogden(mu="soft", alpha=[1.0]), "Ogden.mu is 'soft'"),
        (lambda: sg.Ogden(mu=[1.0, 2.0], alpha=[1.0]), "Ogden.mu and Ogden.alpha have shapes (2,) and (1,)"),
        (lambda: sg.Ogden(mu=[1.0, float("inf")], alpha=[1.0, 2.0]), "Ogden.mu is inf (in an array of 2)"),
        (lambda: sg.shell.FlatContact(sg.FlatShell(**SHELL), distance=-1), "FlatContact.distance is -1"),
        (lambda: sg.shell.InclinedContact(sg.FlatShell(**SHELL), 1 * mm, angle=10), "InclinedContact.angle is 10"),
        (lambda: sg.shell.Grasp(sg.FlatShell(**SHELL), 1.0, 1.0, friction="wet"), "Grasp.friction is 'wet'"),
        (lambda: sg.shell.Grasp(sg.FlatShell(**SHELL), 1.0, 1.0, lever="x"), "Grasp.lever is 'x'; it must be one of"),
        (lambda: sg.shell.Grasp(sg.FlatShell(**SHELL), 1.0, 1.0, fingers=0), "Grasp.fingers is 0"),
        (lambda: FrictionTable(force=[1.0, 1.0], coefficient=[1.0, 1.0]), "it must increase from row to row."),
        (lambda: FrictionTable(force=1.0, coefficient=1.0), "they must be two lists of the same length."),
        (lambda: sg.solve(sg.shell.Free(sg.FlatShell(**SHELL)), -1.0), "pressure is -1; it must be"),
        (lambda: sg.solve(sg.shell.Free(sg.FlatShell(**SHELL)), "low"), "pressure is 'low'"),
        (lambda: sg.path(sg.shell.Free(sg.FlatShell(**SHELL)), [1.0, float("nan")]), "pressures is nan"),
        (lambda: sg.pressure_for(sg.shell.Free(sg.FlatShell(**SHELL)), force=1.0), "Free has no observable 'force'"),
        (lambda: sg.pressure_for(sg.shell.Free(sg.FlatShell(**SHELL))), "pressure_for(Free) needs a target"),
        (lambda: sg.pressure_for(sg.shell.Free(sg.FlatShell(**SHELL)), inflation="big"), "inflation is 'big'"),
        (lambda: sg.pressure_for(sg.shell.Free(sg.FlatShell(**SHELL)), a=1.0, b=2.0), "got 2 targets"),
    ],
)
def test_constructors_and_questions(make, says):
    with pytest.raises(ValueError, match=re.escape(says)) as caught:
        make()
    assert "\n" not in str(caught.value)


WRONG_PARTS = """
import softgrip_jax as sg
shell = sg.FlatShell(0.016, 0.043, 0.0011, sg.NeoHookean(175e3))
for make in (
    lambda: sg.FlatShell(0.016, 0.043, 0.0011, 175e3),
    lambda: sg.shell.Free(3),
    lambda: sg.pneunet.largest_mass(sg.shell.Grasp(shell, radius=0.02, gap=0.005), 1e4),
    lambda: sg.solve(sg.NeoHookean(175e3), 1e3),
):
    try:
        make()
    except ValueError as error:
        print(error)
"""


def test_wrong_parts():
    """In a process of its own: here the annotations would be checked before the package can say anything."""
    done = subprocess.run([sys.executable, "-c", WRONG_PARTS], capture_output=True, text=True, cwd=ROOT, timeout=120)
    shell, scene, grasp, *rest = done.stdout.splitlines()
    assert shell == "FlatShell.material is 175000.0; it must be a Material."
    assert scene == "Free.shell is 3; it must be a FlatShell."
    assert grasp == "grasp is a shell.Grasp; it must be a pneunet.Grasp."
    assert rest[0].startswith("scene is NeoHookean")
    assert "it must be a Scene" in rest[-1]


def test_a_preset_without_its_table_is_told_how_to_write_it(tmp_path, capsys):
    (tmp_path / "bad.toml").write_text(
        """
[scene]
type = "shell.Free"
shell = { a_mm = 16, b_mm = 43, t_m_mm = 1.1, material = "dragon_skin_20" }
"""
    )
    said = told(["solve", tmp_path / "bad.toml"], capsys)
    assert """is 'dragon_skin_20'; it must be a table, for instance { preset = "dragon_skin_20" }.""" in said


# (section, text in it, what stands there instead, what is said)
OWN_UNITS = [
    ("design", "low = 1", "low = 3", "shell.t_m_mm goes from 3 to 2; low must be below high."),
    ("design", "low = 1", "low = 0", "low of shell.t_m_mm is 0; it must be a positive finite number in mm."),
    ("design", 'name = "shell.t_m_mm"\nlow = 1', 'name = "weight_N_per_m"\nlow = 1', "there is no number"),
    ("design", "minimise", "minimse", "there is no key goals.1.minimse; did you mean minimise?"),
    ("design", "[design]", "[design]\nuncertain = 3", "[design]: uncertain is 3; it must be a table."),
    ("design", "high = 2", "higth = 2", "there is no key variables.1.higth; did you mean high?"),
    ("sweep", "low = 1", "low = 3", "shell.t_m_mm goes from 3 to 2; low must be below high"),
]
SECTIONS = {
    "design": """
[design]
[[design.variables]]
name = "shell.t_m_mm"
low = 1
high = 2
[[design.goals]]
minimise = "force_N"
at = { pressure_kPa = 12 }
""",
    "sweep": """
[sweep]
method = "sobol"
samples = 4
[[sweep.variables]]
name = "shell.t_m_mm"
low = 1
high = 2
[[sweep.observables]]
name = "force_N"
at = { pressure_kPa = 12 }
""",
}


@pytest.mark.parametrize(("section", "old", "new", "says"), OWN_UNITS)
def test_sections_speak_in_the_units_that_were_typed(section, old, new, says, tmp_path, capsys):
    path = tmp_path / "bad.toml"
    assert old in SECTIONS[section]
    path.write_text(GOOD + SECTIONS[section].replace(old, new, 1))
    assert says in told([section, path, "--out", tmp_path / "out"], capsys)


def test_bounds_of_a_logarithm_are_named_in_the_units_that_were_typed():
    number = varied({"scene": thesis.blocked_finger("A")}, "tip_offset_mm", "here")
    with pytest.raises(ConfigError, match=r"tip_offset_mm begins at -2; on a log scale low must be above zero"):
        number.bounds(-2.0, 3.0, "log", "here")


@pytest.mark.parametrize(("british", "other"), [("minimise", "minimize"), ("maximise", "maximize")])
def test_goals_may_be_spelt_in_two_ways(british, other, tmp_path):
    goals = []
    for word in (british, other):
        path = tmp_path / f"{word}.toml"
        path.write_text(GOOD + SECTIONS["design"].replace("minimise", word))
        [goal] = settings.read(configs.load(path)).problem.goals
        goals.append(goal)
    assert goals[0] == goals[1]
    assert goals[0].kind == british
    assert Goal(other, goals[0].quantity) == goals[0]


def test_numbers_of_32_bits_are_numbers():
    """JAX stopped at one of them, in a loop whose parts "must have equal types"."""
    wide, narrow = (
        dataclasses.replace(sg.PneuNet.table_5_1("A"), a=jnp.asarray(5e-3, kind)) for kind in (float, "float32")
    )
    assert narrow.a.dtype == wide.a.dtype
    expected = sg.solve(sg.pneunet.Linear(wide), 25e3).tip_force
    np.testing.assert_allclose(sg.solve(sg.pneunet.Linear(narrow), 25e3).tip_force, expected, rtol=1e-6)
