"""Numbers in the wrong unit and arrays in place of numbers: what is said, where, and when nothing is."""

import dataclasses
import re
import subprocess
import sys
import warnings

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import ROOT
from helpers import CASES

import softgrip_jax as sg
from softgrip_jax import config
from softgrip_jax.plausible import units_are_stated
from softgrip_jax.units import gram, kPa, mm

RUBBER = sg.NeoHookean(mu=175 * kPa)
SHELL = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=RUBBER)
FREE = sg.shell.Free(SHELL)


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (
            lambda: sg.FlatShell(a=16, b=43, t_m=1.1 * mm, material=RUBBER),
            "FlatShell.a is 16 m, FlatShell.b is 43 m; did you mean 16 mm, 43 mm? Numbers are in SI units: write "
            "16 * softgrip_jax.units.mm.",
        ),
        (lambda: sg.NeoHookean(mu=175), "NeoHookean.mu is 175 Pa; did you mean 175 kPa?"),
        (lambda: sg.NeoHookean(mu=0.136), "NeoHookean.mu is 0.136 Pa; did you mean 0.136 MPa?"),
        (lambda: sg.MooneyRivlin(c1=80, c2=7), "MooneyRivlin.c1 is 80 Pa; did you mean 80 kPa?"),
        (lambda: sg.PneuNet.table_5_1("A", L=77), "PneuNet.L is 77 m; did you mean 77 mm?"),
        (
            lambda: sg.PneuNet([5, 6], 8e-3, 1e-3, 1e-3, 4e-3, 5e-3, 2e-2, 7e-2, RUBBER),
            "PneuNet.a is 5 m; did you mean 5 mm?",
        ),
        (
            lambda: sg.objects.Cylinder(radius=18 * mm, mass=563, friction=1.0),
            "Cylinder.mass is 563 kg; did you mean 563 g? Numbers are in SI units: write 563 * softgrip_jax.units.gram",
        ),
        (
            lambda: sg.pneunet.Free(sg.PneuNet.table_5_1("A"), clamp_angle=30),
            "Free.clamp_angle is 30 rad; did you mean 30 degree?",
        ),
        (lambda: sg.shell.CylinderContact(SHELL, radius=20, gap=5 * mm), "CylinderContact.radius is 20 m"),
    ],
)
def test_a_number_in_the_wrong_unit_is_told(make, says):
    with pytest.warns(sg.UnitWarning, match=re.escape(says)) as caught:
        make()
    assert len(caught) == 1
    assert caught[0].filename == __file__


@pytest.mark.parametrize(
    "make",
    [
        lambda: sg.solve(FREE, 0.0),
        lambda: sg.solve(FREE, jnp.asarray(15.0)),  # computed, not typed
        lambda: sg.path(FREE, np.linspace(0, 12e3, 3)),
        lambda: sg.NeoHookean(mu=jnp.array([10.0, 1e5])),  # a batch may span decades
        lambda: sg.Yeoh(c1=80 * kPa, c2=-150.0, c3=4.0),
        lambda: jax.jit(lambda a: sg.FlatShell(a=a, b=43.0, t_m=a, material=RUBBER).a)(16.0),
        lambda: sg.FlatShell(a=0.9, b=1.0, t_m=1 * mm, material=RUBBER),
        lambda: sg.objects.Cylinder(radius=200 * mm, mass=26.0, friction=1.0),
        lambda: jax.tree.map(lambda leaf: 1000 * leaf, SHELL),
    ],
)
def test_what_can_be_meant_is_not_told(make):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        make()


def test_units_that_are_stated_are_not_doubted(tmp_path):
    path = tmp_path / "large.toml"
    text = (ROOT / "configs" / "shell_free.toml").read_text(encoding="utf-8")
    path.write_text(re.sub(r"(?m)^b_mm = .*$", "b_mm = 2000", text))
    loaded = config.load(path)
    assert "b=2000 mm" in repr(list(loaded.scenes.values()))
    with units_are_stated():
        assert float(sg.NeoHookean(mu=175).mu) == 175
    with pytest.warns(sg.UnitWarning):
        sg.NeoHookean(mu=175)


TYPED = """
import softgrip_jax as sg
rubber = sg.NeoHookean(mu=175)
"""


def test_the_warning_names_the_line(tmp_path):
    script = tmp_path / "typed.py"
    script.write_text(TYPED)
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, cwd=ROOT, timeout=120)
    assert done.returncode == 0
    assert "typed.py:3: UnitWarning: NeoHookean.mu is 175 Pa; did you mean 175 kPa?" in done.stderr
    assert "rubber = sg.NeoHookean(mu=175)" in done.stderr


CONFIG = """
[scene]
type = "shell.FlatContact"
distance_mm = 5
[scene.shell]
a_mm = {a}
b_mm = 43
t_m_mm = 1.1
[scene.shell.material]
type = "NeoHookean"
mu_kPa = {mu}
"""


@pytest.mark.parametrize(
    ("numbers", "says"),
    [
        ({"a": 0.016}, "[scene.shell]: a_mm is 0.016, and that is 0.016 mm; did you mean 16?"),
        ({"mu": 0.175}, "[scene.shell.material]: mu_kPa is 0.175, and that is 0.175 kPa; did you mean 175?"),
    ],
)
def test_a_number_of_a_config_in_a_unit_that_is_a_thousand_times_larger(numbers, says, tmp_path):
    path = tmp_path / "typed.toml"
    path.write_text(CONFIG.format(**{"a": 16, "mu": 175} | numbers))
    with pytest.warns(sg.UnitWarning, match=re.escape(says)) as caught:
        config.load(path)
    assert len(caught) == 1
    path.write_text(CONFIG.format(a=16, mu=1.5))  # a gel
    config.load(path)


def test_a_command_tells_a_warning_in_a_line(tmp_path):
    path = tmp_path / "typed.toml"
    path.write_text(CONFIG.format(a=0.016, mu=175))
    done = subprocess.run(
        [sys.executable, "-m", "softgrip_jax", "solve", path, "--pressure-kPa", "1"], capture_output=True, text=True
    )
    assert done.returncode == 1
    # Whole lines of ours: where XLA reads a program of another processor it has lines of its own.
    said = [line for line in done.stderr.splitlines() if "cpu_aot_loader" not in line]
    assert said == [f"{path}, [scene.shell]: a_mm is 0.016, and that is 0.016 mm; did you mean 16?"]
    (row,) = (line for line in done.stdout.splitlines() if line.startswith("│ stretch"))
    assert row.split("│")[2].strip() == "-"  # of a membrane that touches nothing it is not known here
    (row,) = (line for line in done.stdout.splitlines() if line.startswith("│ force"))
    assert row.split("│")[2].strip() == "0 N"


# --- an array where a number is expected ------------------------------------------------------------------------------


def line_in(message):
    """The line to type that an error names."""
    return re.search(r"(jax\.vmap\(.*\))\.$", message)[1]


def test_an_array_of_pressures():
    with pytest.raises(ValueError, match=r"pressure has the shape \(3,\), and solve takes one number") as caught:
        sg.solve(FREE, jnp.linspace(5e3, 15e3, 3))
    assert "sg.path(scene, pressures)" in str(caught.value)
    names = {"jax": jax, "sg": sg, "scene": FREE, "pressures": jnp.linspace(5e3, 15e3, 3)}
    typed = eval(line_in(str(caught.value)), names)
    curve = sg.path(FREE, names["pressures"])
    np.testing.assert_allclose(typed.inflation, curve.inflation, rtol=1e-12)


def test_an_array_of_targets():
    with pytest.raises(ValueError, match=r"inflation has the shape \(2,\)") as caught:
        sg.pressure_for(FREE, inflation=np.array([5, 8]) * mm)
    values = jnp.array([5, 8]) * mm
    typed = eval(line_in(str(caught.value)), {"jax": jax, "sg": sg, "scene": FREE, "values": values})
    np.testing.assert_allclose(typed.inflation, values, rtol=1e-12)
    with pytest.raises(ValueError, match=r"pressures has the shape \(2, 2\); it must be one list"):
        sg.path(FREE, np.ones((2, 2)) * kPa)


QUESTIONS = [
    lambda scene: sg.solve(scene, 15 * kPa),
    lambda scene: sg.path(scene, [15 * kPa]),
    lambda scene: sg.branch(scene, 5),
    sg.limit_pressure,
    sg.contact_pressure,
    lambda scene: sg.pressure_for(scene, inflation=5 * mm),
]


@pytest.mark.parametrize("ask", QUESTIONS)
def test_an_array_in_a_scene(ask):
    widths = jnp.array([14, 15]) * mm
    scene = sg.shell.Free(dataclasses.replace(SHELL, a=widths))
    with pytest.raises(ValueError, match=r"FlatShell.a has the shape \(2,\), and one scene has one number there"):
        ask(scene)


def test_what_to_type_for_an_array_in_a_scene():
    widths = jnp.array([14, 15]) * mm

    def make_scene(a):
        return sg.shell.Free(dataclasses.replace(SHELL, a=a))

    with pytest.raises(ValueError, match="make it inside of vmap") as caught:
        sg.solve(make_scene(widths), 15 * kPa)
    names = {"jax": jax, "sg": sg, "make_scene": make_scene, "values": widths, "pressure": 15 * kPa}
    typed = eval(line_in(str(caught.value)), names)
    whole = jax.tree.map(lambda leaf: jnp.stack([leaf, leaf]), FREE)
    whole = dataclasses.replace(whole, shell=dataclasses.replace(whole.shell, a=widths))
    with pytest.raises(ValueError, match="solve the batch with") as caught:
        sg.solve(whole, 15 * kPa)
    batch = eval(line_in(str(caught.value)), names | {"scene": whole})
    np.testing.assert_array_equal(typed.inflation, batch.inflation)


@pytest.mark.parametrize("case", CASES, ids=str)
def test_lists_that_belong_to_one_scene_pass(case):
    """Ogden's lists, tables of friction, weights: each is part of one scene, and two of them are seen as a batch."""
    from softgrip_jax.fields import batched_field

    scene = case.make()
    assert batched_field(scene) is None
    assert batched_field(jax.tree.map(lambda leaf: jnp.stack([leaf, leaf]), scene)) is not None


def test_lists_of_fingers_pass():
    from softgrip_jax.fields import batched_field

    finger = sg.PneuNet(jnp.array([5, 6]) * mm, 8e-3, 1e-3, 1e-3, 4e-3, 5e-3, 2e-2, 7e-2, RUBBER)
    held = sg.objects.Cylinder(radius=18 * mm, mass=26 * gram, friction=0.96)
    assert batched_field(sg.pneunet.Grasp(sg.pneunet.Gripper(finger), held)) is None
    assert batched_field(sg.pneunet.Free(dataclasses.replace(finger, L=jnp.array([0.07, 0.08])))) == ("PneuNet.L", (2,))
