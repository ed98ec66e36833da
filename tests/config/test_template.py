"""Starters for every scene, and the schema by which editors check configs."""

import contextlib
import io
import json
import re
import tomllib

import jsonschema
import pytest
from conftest import ROOT

import softgrip_jax as sg
from optim.design import settings as design_settings
from softgrip_jax import config as configs
from softgrip_jax.cli import MISTAKE, run
from softgrip_jax.commands import sensitivity, sweep
from softgrip_jax.config.schema import schema
from softgrip_jax.config.template import PRESSURE, example, starter
from softgrip_jax.errors import ConfigError
from softgrip_jax.fields import documented, part, positive
from softgrip_jax.scene import Scene

TYPES = [name for name, cls in configs.classes_of((Scene,)).items() if cls.__module__.startswith("softgrip_jax.")]


@pytest.fixture(scope="module")
def validator():
    text = io.StringIO()
    with contextlib.redirect_stdout(text):
        assert run(["schema"]) == 0
    schema = json.loads(text.getvalue())
    jsonschema.Draft202012Validator.check_schema(schema)
    return jsonschema.Draft202012Validator(schema)


@pytest.mark.parametrize("name", TYPES)
def test_a_starter_of_every_scene_loads_and_says_every_key(name, tmp_path, validator):
    file = tmp_path / "mine.toml"
    file.write_text(starter(name))
    read = configs.load(file)
    cls = configs.classes_of((Scene,))[name]
    assert type(read.scene) is cls
    configs.question(read)
    assert list(validator.iter_errors(tomllib.loads(file.read_text()))) == []
    for key in configs.keys_of(cls).values():
        assert f"{key.key} =" in file.read_text() or f".{key.key}]" in file.read_text()


@pytest.mark.parametrize("name", ["shell.Grasp", "shell.InclinedContact", "pneunet.Free", "pneunet.Grasp"])
def test_what_is_in_comments_is_what_holds_without_it(name, tmp_path):
    """Optional keys taken out of their comments give the same scene."""
    text = starter(name).split("\n# Without [solve]")[0].split("\n[solve]")[0]
    skipped = ("# preset", "# tip_offset", "# stand_distance")  # not a value, or None by default
    optional = [line for line in text.splitlines() if re.match(r"# \w+ = ", line) and not line.startswith(skipped)]
    lines = [line[2:] if line in optional else line for line in text.splitlines()]
    plain, full = tmp_path / "plain.toml", tmp_path / "full.toml"
    plain.write_text(text)
    full.write_text("\n".join(lines))
    assert full.read_text() != text
    scenes = [configs.load(file).scene for file in (plain, full)]
    assert configs.dump(scenes[0]) == configs.dump(scenes[1])


@pytest.mark.parametrize(
    "name", ["shell.InclinedContact", *(pytest.param(name, marks=pytest.mark.slow) for name in TYPES)]
)
def test_a_starter_has_an_answer(name):
    """That of a plane that leans was touched at no less than 26 kPa, and asked at 15."""
    scene = example(configs.classes_of((Scene,))[name])
    if callable(getattr(scene, "target", None)) and "mass" in starter(name):
        assert int(sg.pressure_for(scene).status) == sg.Status.OK
    else:
        assert int(sg.solve(scene, PRESSURE).status) == sg.Status.OK


def test_words_of_fields_come_from_docstrings():
    grasp = configs.classes_of((Scene,))["shell.Grasp"]
    words = documented(grasp)
    assert words["fingers"] == "shells that share the weight (2 in a parallel gripper)"
    # "as in CylinderContact" in the docstring of Grasp: what that one says.
    assert words["gap"].startswith("d - r, its distance from the membrane")


def test_words_of_fields_may_stand_in_their_field_but_not_twice():
    class Pad(sg.scene.Checked):
        """A pad. thickness: of something else.

        Args:
            side: of the square, m; of no use.
        """

        side: sg.scene.Scalar = positive("length")
        thickness: sg.scene.Scalar = positive("length", doc="thickness of the pad")

    class Twice(Pad):
        side: sg.scene.Scalar = positive("length", doc="of the square")

    assert documented(Pad) == {"side": "of the square", "thickness": "thickness of the pad"}
    with pytest.raises(TypeError, match=r"Twice\.side is described twice"):
        documented(Twice)


def test_a_part_of_the_schema_may_hold_its_own_kind():
    class Blend(sg.materials.Material):
        """A blend of two."""

        first: sg.materials.Material = part(sg.materials.Material)
        second: sg.materials.Material = part(sg.materials.Material)
        first_part: sg.scene.Scalar = positive("number", doc="of the first")

        def energy(self, c):
            return 0.0

        def shear_modulus(self):
            return self.first.shear_modulus()

    checked = jsonschema.Draft202012Validator(schema({}))
    neo = {"type": "NeoHookean", "mu_kPa": 100}
    blend = {"type": "Blend", "first_part": 0.5, "first": neo, "second": neo}

    def faults(material):
        shell = {"a_mm": 16, "b_mm": 43, "t_m_mm": 1, "material": material}
        return list(checked.iter_errors({"scene": {"type": "shell.Free", "shell": shell}}))

    assert not faults(blend | {"second": blend})
    assert faults(blend | {"second": blend | {"first_part": -0.5}})


def test_new_writes_once_and_names_what_exists(tmp_path, capsys):
    file = tmp_path / "mine.toml"
    assert run(["new", "shell.Free", str(file)]) == 0
    assert run(["new", "shell.Free", str(file)]) == MISTAKE
    assert "exists already" in capsys.readouterr().err
    assert run(["new", "shell.Fre"]) == MISTAKE
    assert capsys.readouterr().err == "TYPE is 'shell.Fre'; did you mean 'shell.Free'?\n"
    with pytest.raises(ConfigError):
        starter("nothing of the kind")
    assert run(["new"]) == 0
    listed = capsys.readouterr().out
    assert all(name in listed for name in TYPES)
    assert list(tmp_path.iterdir()) == [file]


@pytest.mark.parametrize("file", sorted((ROOT / "configs").glob("*.toml")), ids=lambda file: file.stem)
def test_every_sample_config_is_valid(file, validator):
    assert [error.message for error in validator.iter_errors(tomllib.loads(file.read_text()))] == []


@pytest.mark.parametrize(
    ("config", "old", "new"),
    [
        ("shell_cylinder", "radius_mm = 20", "radius_mm = -20"),
        ("shell_cylinder", "radius_mm = 20", "radius_cm = 2"),
        ("shell_cylinder", "gap_mm = 5", ""),
        ("shell_cylinder", "shell.CylinderContact", "shell.Cylinder"),
        ("shell_cylinder", "dragon_skin_20_shell", "dragon_skin_21"),
        ("finger_grasp", 'section = "exact"', 'section = "precise"'),
        ("finger_grasp", "[2, 0]", "[2]"),
        ("shell_grasp", 'minimise = "pressure_kPa"', 'minimse = "pressure_kPa"'),
        ("shell_grasp", "[design]", "[desing]"),
    ],
)
def test_a_mistake_is_seen_by_schema_and_command(config, old, new, validator, tmp_path, capsys):
    text = (ROOT / "configs" / f"{config}.toml").read_text()
    assert old in text
    file = tmp_path / "bad.toml"
    file.write_text(text.replace(old, new, 1))
    assert list(validator.iter_errors(tomllib.loads(file.read_text())))
    assert run(["design" if "[design]" in file.read_text() else "solve", str(file)]) == MISTAKE
    assert capsys.readouterr().err


@pytest.mark.parametrize("name", TYPES)
def test_the_searches_of_a_starter_are_understood(name, tmp_path):
    """[design], [sweep] and [sensitivity] out of their comments."""
    before, after = starter(name).split("\n# Better designs")
    lines = [line[2:] if re.match(r"# (\[|\w+ = )", line) else line for line in after.splitlines()]
    file = tmp_path / "mine.toml"
    file.write_text(before + "\n#" + "\n".join(lines))
    read = configs.load(file)
    settings = design_settings.read(read)
    (variable,) = settings.problem.space.names
    assert variable
    study, _ = sweep.read(read)
    assert study.designs.count == 21
    matters = sensitivity.read(read)
    assert "sensitivity" in read.tables
    assert matters.samples == 10_000
    (number,), (tolerance,) = matters.numbers, matters.tolerances
    assert number.name == variable.split("[")[0]
    assert 0 < tolerance < 0.1 * settings.problem.space.high[0]
    assert len(matters.quantities) == 1
