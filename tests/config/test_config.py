"""Configs: every key becomes the SI value that it says, and a scene written to a config comes back the same."""

from typing import ClassVar

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pydantic
import pytest
from conftest import ROOT
from jaxtyping import Array, Float

import softgrip_jax as sg
from optim.calibration import settings as calibrate_settings
from optim.plan import settings as plan_settings
from softgrip_jax import config, fields, units
from softgrip_jax.config.keys import varied
from softgrip_jax.objects.friction import FrictionTable
from softgrip_jax.scene import Scene
from softgrip_jax.units import gram, kPa, mm

GRASP = """
[scene]
type = "shell.Grasp"
radius_mm = 20
gap_mm = 5
mass_g = 563
eccentricity_mm = 2.5
lever = "rim"
fingers = 3

[scene.friction]
force_N = [0.5, 1, 3]
coefficient = [1.5, 1.3, 0.96]

[scene.shell]
a_mm = 16
b_mm = 43
t_m_mm = 1.1

[scene.shell.material]
type = "NeoHookean"
mu_kPa = 175
"""


def read(text, tmp_path):
    path = tmp_path / "config.toml"
    path.write_text(text, encoding="utf-8")
    return config.load(path)


def same(one, other):
    """Equal in structure, static choices and values (to the last bit but one)."""
    assert jax.tree.structure(one) == jax.tree.structure(other)
    for a, b in zip(jax.tree.leaves(one), jax.tree.leaves(other), strict=True):
        np.testing.assert_allclose(a, b, rtol=2.3e-16)


def test_a_byte_order_mark_is_no_part_of_a_config(tmp_path):
    """Editors on Windows write one; the copies in the folders of runs have none."""
    path = tmp_path / "windows.toml"
    path.write_bytes(b"\xef\xbb\xbf" + GRASP.encode())
    assert config.load(path).scene.radius == pytest.approx(20 * mm)
    assert config.standalone(path) == GRASP.encode()


def test_every_key_is_its_si_value(tmp_path):
    scene = read(GRASP, tmp_path).scene
    assert isinstance(scene, sg.shell.Grasp)
    numbers = [scene.radius, scene.gap, scene.mass, scene.eccentricity, scene.fingers]
    np.testing.assert_allclose(numbers, [0.020, 0.005, 0.563, 0.0025, 3], rtol=1e-15)
    assert scene.lever == "rim"
    assert isinstance(scene.friction, FrictionTable)
    np.testing.assert_allclose(scene.friction.force, [0.5, 1.0, 3.0])
    np.testing.assert_allclose(scene.friction.coefficient, [1.5, 1.3, 0.96])
    np.testing.assert_allclose([scene.shell.a, scene.shell.b, scene.shell.t_m], [0.016, 0.043, 0.0011], rtol=1e-15)
    assert float(scene.shell.material.mu) == 175e3


def test_angles_are_given_in_degrees(tmp_path):
    scene = config.load(ROOT / "configs" / "shell_inclined.toml").scene
    np.testing.assert_allclose(scene.angle, 0.17453292519943295, rtol=1e-15)


@pytest.mark.parametrize("path", sorted((ROOT / "configs").glob("*.toml")), ids=lambda path: path.stem)
def test_every_config_of_the_project_loads_and_asks_something(path):
    sections = config.read_sections(path)
    if "tension" in sections:  # a test of a material has no scene; tests/optim/test_calibrate_run.py runs it
        return
    read = config.load(path)
    assert all(isinstance(scene, Scene) for scene in read.scenes.values())
    if "calibrate" in sections:
        assert calibrate_settings.read(read).fitting.space.size >= 1
    elif "plan" in sections:
        assert plan_settings.read(read).fitting.space.size >= 1
    elif not sections.keys() & {"design", "sweep"}:
        assert len(config.question(read)) <= 1


SHELL = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
MATERIALS = [
    sg.NeoHookean(mu=136.7 * kPa),
    sg.MooneyRivlin(c1=60 * kPa, c2=-3.3 * kPa),
    sg.Yeoh(c1=68 * kPa, c3=0.1 * kPa),
    sg.Gent(mu=1e5 / 3, j_m=43.21),
    sg.Ogden(mu=[1e5, 2e4 / 7], alpha=[1.3, 3.1]),
]
SCENES = [
    sg.shell.Free(SHELL),
    sg.shell.Plate(SHELL),
    sg.shell.FlatContact(SHELL, distance=5.1 * mm),
    sg.shell.InclinedContact(SHELL, distance=5 * mm, angle=0.17),
    sg.shell.CylinderContact(SHELL, radius=20 * mm, gap=mm / 3),
    sg.shell.AxialOffset(SHELL, radius=20 * mm, gap=5 * mm, height=41.7 * mm),
    sg.shell.Grasp(SHELL, radius=20 * mm, gap=5 * mm, mass=563 * gram, friction=0.96, lever="rim", fingers=3),
    sg.shell.Grasp(SHELL, 20 * mm, 5 * mm, friction=FrictionTable(force=[0.5, 1.0], coefficient=[1.5, 1.3])),
    *(sg.shell.Free(sg.FlatShell(16 * mm, 43 * mm, 1.1 * mm, material)) for material in MATERIALS),
]
TYPE_A = sg.PneuNet.table_5_1("A")
GRIPPER = sg.pneunet.Gripper(TYPE_A, n=4, base_radius=20 * mm)
ON_FACES = sg.pneunet.Gripper(TYPE_A, n=3, base_radius=20 * mm)
FINGER_SCENES = [
    sg.pneunet.Free(TYPE_A, weight=(0.0, 0.0), clamp_angle=0.3, inclination="gap"),
    sg.pneunet.Free(eqx.tree_at(lambda f: f.h_x, TYPE_A, jnp.array([0.7, 0.8, 0.9]) * mm), tip_load=(0.1, -0.2)),
    sg.pneunet.TipContact(TYPE_A, tip_offset=-3.3 * mm, tip_pull=0.1, weight=(0.0, -2.0), section="thesis"),
    sg.pneunet.Chamber(TYPE_A, inclination=0.07),
    sg.pneunet.Free(TYPE_A, beam="shooting"),
    sg.pneunet.Free(TYPE_A, beam={"type": "shooting", "rtol": 1e-6, "segments": 2}),
    sg.pneunet.Free(TYPE_A, beam=sg.pneunet.Collocation(points=8)),
    sg.pneunet.Free(TYPE_A, beam=sg.pneunet.Collocation()),
    sg.pneunet.Grasp(GRIPPER, sg.objects.Cylinder(18 * mm, 26 * gram, 0.96), weight=None),
    sg.pneunet.Grasp(ON_FACES, sg.objects.HexagonalCylinder(15 * mm, 35 * gram, 0.96), tip_offset=-5 * mm),
    sg.pneunet.Grasp(GRIPPER, sg.objects.Cone(30 * mm, 80 * mm, 20 * gram, 0.96), stand_distance=110 * mm),
    sg.pneunet.Grasp(
        ON_FACES,
        sg.objects.ThreeFaceCone(50 * mm, 80 * mm, 19 * gram, FrictionTable(force=[0.5, 1.0], coefficient=[1.5, 1.3])),
        stand_distance=110 * mm,
        section="inextensible",
    ),
]


def _label(scene):
    parts = (getattr(getattr(scene, "shell", None), "material", None), getattr(scene, "object", None))
    return "-".join(type(part).__name__ for part in (scene, *parts) if part is not None)


@pytest.mark.parametrize("scene", SCENES + FINGER_SCENES, ids=_label)
def test_a_scene_written_to_a_config_comes_back_the_same(scene, tmp_path):
    text = config.dump(scene, "two lines\nof comment", solve={"pressure_kPa": 12.5})
    back = read(text, tmp_path)
    same(back.scene, scene)
    assert config.question(back) == {"pressure": 12500.0}
    assert text.startswith("# two lines\n# of comment\n")


def test_numbers_are_written_as_people_would(tmp_path):
    assert "t_m_mm = 1.1\n" in config.dump(SCENES[0])
    values = np.random.default_rng(0).lognormal(sigma=9, size=10_000)
    for label, unit in units.DISPLAY.values():
        back = np.asarray([config.modules._in_unit(v, unit) * unit for v in values])
        np.testing.assert_allclose(back, values, rtol=2.3e-16, err_msg=label)


def test_a_friction_that_is_code_cannot_be_written():
    scene = sg.shell.Grasp(SHELL, radius=20 * mm, gap=5 * mm, friction=lambda force: 1 / (1 + force))
    with pytest.raises(config.ConfigError, match="A FrictionLaw cannot be written to a config"):
        config.dump(scene)


def test_a_method_that_is_code_cannot_be_written():
    scene = sg.pneunet.Free(TYPE_A, beam=sg.pneunet.Shooting(diffrax.Tsit5()))
    with pytest.raises(config.ConfigError, match="beam is a Shooting that no config can say: beam has no key 'solver'"):
        config.dump(scene)


def test_a_preset_may_be_changed(tmp_path):
    start = '[scene]\ntype = "shell.Free"\n[scene.shell]\na_mm = 16\nb_mm = 43\nt_m_mm = 1\n[scene.shell.material]\n'
    assert float(read(start + 'preset = "dragon_skin_30"', tmp_path).scene.shell.material.mu) == 198e3
    changed = read(start + 'preset = "dragon_skin_30"\nmu_kPa = 200', tmp_path).scene
    assert float(changed.shell.material.mu) == 200e3


@pytest.mark.parametrize(
    ("solve", "asked"),
    [
        ("[solve]\npressure_kPa = 15", {"pressure": 15000.0}),
        ("[solve]\nforce_N = 2.87", {"force": 2.87}),
        ("[solve]\nheight_mm = 33.7", {"height": 0.0337}),
        ("[solve]\ncontact_angle_deg = 180", {"contact_angle": np.pi}),
        ("[solve]\nsecurity = 2", {"security": 2.0}),
        ("[solve]", {}),
        ("", {}),
    ],
)
def test_questions(solve, asked, tmp_path):
    assert config.question(read(GRASP + solve, tmp_path)) == pytest.approx(asked, rel=1e-15)


def test_leaf_of_a_dotted_key():
    scene = SCENES[6]
    leaf = config.leaf(scene, "shell.t_m_mm", "here")
    assert (leaf.names, leaf.kind, leaf.rule, leaf.unit) == (("shell", "t_m"), "length", "positive", 1e-3)
    assert float(leaf.get(scene)) == 1.1 * mm
    assert config.leaf(scene, "friction", "here").kind == "number"
    with pytest.raises(config.ConfigError, match=r"here: there is no number 'shell.t_mm'; did you mean shell.t_m_mm\?"):
        config.leaf(scene, "shell.t_mm", "here")
    for key, meant in {"a_mm": "shell.a_mm", "shell.material.mu": "shell.material.mu_kPa"}.items():
        with pytest.raises(config.ConfigError, match=rf"no scene has a number '{key}'; did you mean {meant}\?"):
            varied({"one": scene, "two": scene}, key, "here")


class Steps(pydantic.BaseModel):
    """A section as a run might have it."""

    model_config = pydantic.ConfigDict(extra="forbid", strict=True)
    steps: int = pydantic.Field(ge=1)


@pytest.mark.parametrize(
    ("table", "says"),
    [
        ({"stepps": 3}, "here: there is no key stepps; did you mean steps?"),
        ({}, "here: the key steps is missing."),
        ({"steps": 0}, "here: steps is 0; it should be greater than or equal to 1."),
        ({"steps": "many"}, "here: steps is 'many'; it should be a valid integer."),
    ],
)
def test_sections_of_runs(table, says):
    assert config.validated(Steps, {"steps": 3}, "here").steps == 3
    with pytest.raises(config.ConfigError) as caught:
        config.validated(Steps, table, "here")
    assert str(caught.value) == says


class Pusher(Scene):
    """A scene that the package has never heard of, with every sort of field."""

    reach: Float[Array, ""] = fields.positive("length")
    stiff: Float[Array, ""] | Float[Array, " n"] = fields.positive("number")
    weight: Float[Array, "2"] = fields.finite("force_per_length", default=(0.0, -2.0))
    law: str = fields.choice("exact", "thesis", default="exact")
    steps: int = eqx.field(static=True, default=4)
    coupled: bool = eqx.field(static=True, default=False)
    extra: Float[Array, ""] | None = fields.finite("moment", default=None)

    OBSERVABLES: ClassVar = {"force": "force"}

    def solver(self):
        raise NotImplementedError

    residual = observe = solver


def test_a_new_scene_needs_nothing_here(tmp_path):
    text = (
        '[scene]\ntype = "Pusher"\nreach_mm = 3\nstiff = [1, 2.5, 3]\nweight_N_per_m = [1, 2]\n'
        'law = "thesis"\nsteps = 7\ncoupled = true\nextra_N_mm = -3\n[solve]\nforce_N = 1'
    )
    back = read(text, tmp_path)
    expected = Pusher(
        reach=3 * mm,
        stiff=jnp.asarray([1.0, 2.5, 3.0]),
        weight=jnp.asarray([1.0, 2.0]),
        law="thesis",
        steps=7,
        coupled=True,
        extra=-3e-3,
    )
    same(back.scene, expected)
    same(read(config.dump(expected), tmp_path).scene, expected)
    few = read('[scene]\ntype = "Pusher"\nreach_mm = 3\nstiff = 2\n[solve]\nforce_N = 1', tmp_path)
    same(few.scene, Pusher(reach=3 * mm, stiff=2.0))
    same(read(config.dump(few.scene), tmp_path).scene, few.scene)


def test_every_kind_has_a_unit_for_people_and_one_in_si():
    assert units.DISPLAY.keys() == units.SI.keys()


def test_the_same_key_for_every_unit_label():
    keys = [config.unit_key("x", kind) for kind in units.DISPLAY]
    assert set(keys) >= {"x_mm", "x_mm2", "x_N", "x_N_per_m", "x_N_mm", "x_kPa", "x_deg", "x_g", "x"}
    assert all(part.isidentifier() for part in keys)


def test_an_annotation_without_a_shape_is_one_sentence():
    class Bare(fields.Checked):
        lip: jax.Array = fields.positive("length")

    with pytest.raises(config.ConfigError, match=r"Bare.lip is annotated Array, .* write Float\[Array, ''\]"):
        config.keys_of(Bare)
