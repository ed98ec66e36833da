"""What the documentation shows runs: its Python samples, page by page, and the files and commands that it names."""

import re
import shlex
import sys
import tomllib
import types

import jax
import pytest
from conftest import ROOT

from optim.calibration.settings import CalibrateTable
from optim.design.settings import DesignTable
from softgrip_jax.cad import ManufactureTable
from softgrip_jax.commands.sensitivity import SensitivityTable
from softgrip_jax.commands.sweep import SweepTable
from softgrip_jax.config import read_module
from softgrip_jax.materials import Material
from softgrip_jax.pneunet.finger_scene import SNAPPING
from softgrip_jax.reasons import RULE_NAMES

TABLES = {"design": DesignTable, "sweep": SweepTable, "sensitivity": SensitivityTable, "calibrate": CalibrateTable}
TABLES |= {"manufacture": ManufactureTable}
PAGES = [*sorted((ROOT / "docs").rglob("*.md")), ROOT / "README.md"]
PYTHON = re.compile(r"^```python\n(.*?)^```", re.DOTALL | re.MULTILINE)
TOML = re.compile(r"^```toml\n(.*?)^```", re.DOTALL | re.MULTILINE)


def text_of(page):
    return page.read_text(encoding="utf-8")


def name_of(page):
    return str(page.relative_to(ROOT))


WITH_PYTHON = [page for page in PAGES[:-1] if PYTHON.search(text_of(page)) and page.parent.name != "extending"]
"""The README has a test of its own, test_readme.py, and so have the pages of docs/extending, test_extending.py."""


@pytest.mark.parametrize("page", WITH_PYTHON, ids=name_of)
def test_python_of_the_page(page, tmp_path, monkeypatch):
    """The blocks of a page are one program, in their order, run where nothing else is."""
    monkeypatch.chdir(tmp_path)
    # A reader's JAX is not as strict about ranks as the tests are.
    with jax.numpy_rank_promotion("allow"):
        names: dict = {"__name__": "__page__"}
        text = text_of(page)
        for block in PYTHON.finditer(text):
            line = text.count("\n", 0, block.start(1))
            exec(compile("\n" * line + block[1], name_of(page), "exec"), names)


def test_pages_with_samples_are_found():
    assert {"docs/quick-start.md", "docs/guides/solve.md", "docs/guides/design.md", "docs/theory/section.md"} <= {
        name_of(page) for page in WITH_PYTHON
    }


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_what_the_page_names_exists(page):
    text = text_of(page)
    for path in re.findall(r"\b(?:configs|softgrip_jax|optim|tests|notebooks|benchmarks)/[\w/]+\.\w+", text):
        assert (ROOT / path).is_file() or (page.parent / path).is_file(), path
    for block in TOML.findall(text):
        for name, table in tomllib.loads(block).items():
            TABLES[name].model_validate(table)


def test_the_guide_of_moulds_has_every_key_and_its_default():
    [block] = [found for found in TOML.findall(text_of(ROOT / "docs/guides/mould.md")) if "[manufacture]" in found]
    told = tomllib.loads(block)["manufacture"]
    assert told.keys() == ManufactureTable.model_fields.keys()
    for key, field in ManufactureTable.model_fields.items():
        assert field.default in (None, told[key]), key


OWN_MATERIAL = """
from softgrip_jax.materials import NeoHookean

class OwnRubber(NeoHookean):
    pass

PRESETS = {"my_silicone": lambda: OwnRubber(mu=136e3)}
"""


def test_a_config_takes_the_preset_of_a_material_of_ones_own(monkeypatch):
    [line] = re.findall(r"`(material = .*?)`", text_of(ROOT / "docs/extending/material.md"))
    own = types.ModuleType("own_material")
    monkeypatch.setitem(sys.modules, own.__name__, own)
    exec(OWN_MATERIAL, own.__dict__)
    found = read_module((Material,), tomllib.loads(line)["material"], "[scene.shell.material]")
    assert (type(found), found.mu) == (own.OwnRubber, 136e3)


def test_the_grasping_page_has_every_rule():
    text = text_of(ROOT / "docs/theory/grasping.md")
    assert [rule for rule in RULE_NAMES if f"`{rule}`" not in text] == []


def test_corrections_of_held_fingers_are_as_short_as_the_theory_says():
    assert "than a two-thousandth" in " ".join(text_of(ROOT / "docs/theory/numerics.md").split())
    assert SNAPPING == 1 / 2000


SHELL = re.compile(r"^    (?:\.venv/bin/)?softgrip (.*?)(?: *#.*| > .*)?$", re.MULTILINE)
INLINE = re.compile(r"`softgrip ([^`]*\.toml[^`]*)`")
LINES = sorted({line for page in PAGES for form in (SHELL, INLINE) for line in form.findall(text_of(page))})


@pytest.mark.parametrize("line", LINES)
def test_commands_are_understood(line):
    """Every command with its arguments and options, parsed and not run."""
    import typer

    from softgrip_jax.cli import app, find_commands

    find_commands()

    name, *arguments = shlex.split(line)
    command = typer.main.get_command(app).commands[name]  # type: ignore[attr-defined]
    command.make_context(name, arguments)


def test_commands_are_found():
    named = {line.split()[0] for line in LINES}
    assert named >= {"new", "solve", "path", "sweep", "design", "calibrate", "sensitivity"}
