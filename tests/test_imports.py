"""The rooms of the house import downwards, in this order, and never back."""

import ast
from pathlib import Path

import pytest
from conftest import ROOT

ORDER = [
    "_version",
    "names",
    "units",
    "errors",
    "plugins",
    "cache",
    "folders",
    "progress",
    "tables",
    "numerics",
    "reasons",
    "display",
    "plausible",
    "fields",
    "materials",
    "membrane",
    "batches",
    "results",
    "scene",
    "curve_scene",
    "load_path",
    "path_scene",
    "questions",
    "solvers",
    "parameters",
    "quantities",
    "objects",
    "shell",
    "pneunet",
    "fidelity",
    "study",
    "plots",
    "thesis",
    "config",
    "commands",
    "cli",
    "__main__",
]
"""Rooms of softgrip_jax from the ground up. numerics knows no gripper, so the physics may stand on it; objects hold the
friction that shells and fingers need. `__init__` only hands out what is in the rooms."""


def imports(path: Path, package: str) -> list[tuple[str, bool]]:
    """Every module that a file imports, by its full name, and whether only for the type checker."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    typing_only = {
        node
        for block in ast.walk(tree)
        if isinstance(block, ast.If) and ast.unparse(block.test) in ("TYPE_CHECKING", "typing.TYPE_CHECKING")
        for statement in block.body
        for node in ast.walk(statement)
    }
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found += [(alias.name, node in typing_only) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = package.split(".")[: len(package.split(".")) - node.level + 1] if node.level else []
            module = ".".join([*base, *([node.module] if node.module else [])])
            found += [(f"{module}.{alias.name}", node in typing_only) for alias in node.names]
    return found


def files(package: str) -> list[Path]:
    return sorted((ROOT / package).rglob("*.py"))


def faults(path: Path, package: str) -> list[str]:
    """Sentences about every import of a file of softgrip_jax that climbs."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    room = parts[1]
    if room not in ORDER:
        return [f"{room} is not in the list of rooms"]
    said = []
    for name, typing_only in imports(path, package):
        head, *rest = name.split(".")
        if head == "optim":
            said.append(f"{room} imports optim")
        if head == "matplotlib" and room != "plots":
            said.append(f"{room} imports matplotlib")
        if head == "softgrip_jax" and rest and not typing_only:
            other = rest[0]
            if other in ORDER and ORDER.index(other) > ORDER.index(room):
                said.append(f"{room} imports {other}, which stands above it")
            elif other not in ORDER and not other.startswith("__"):
                said.append(f"{room} imports {other}, which is not in the list of rooms")
    return said


ROOM_FILES = [
    path for path in files("softgrip_jax") if path.name != "__init__.py" or path.parent.name != "softgrip_jax"
]


@pytest.mark.parametrize("path", ROOM_FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_rooms_import_downwards(path):
    assert faults(path, ".".join(path.relative_to(ROOT).parent.parts)) == []


OPTIM_FILES = [path for path in files("optim") if path.name != "cli.py"]


@pytest.mark.parametrize("path", OPTIM_FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_optim_leaves_the_command_line_and_matplotlib_alone(path):
    names = [name for name, _ in imports(path, ".".join(path.relative_to(ROOT).parent.parts))]
    assert not [name for name in names if name.startswith(("softgrip_jax.cli", "matplotlib"))]


@pytest.mark.parametrize(
    ("room", "source", "fault"),
    [
        ("units", "from . import scene", "units imports scene, which stands above it"),
        ("scene", "from .shell.arc.grasp import Grasp", "scene imports shell, which stands above it"),
        ("scene", "import softgrip_jax.cli", "scene imports cli, which stands above it"),
        ("shell", "from ..config import load", "shell imports config, which stands above it"),
        ("config", "def f():\n    from optim.design.run import run_design", "config imports optim"),
        ("results", "import matplotlib.pyplot as plt", "results imports matplotlib"),
        ("attic", "import os", "attic is not in the list of rooms"),
    ],
)
def test_a_climbing_import_is_seen(room, source, fault, tmp_path, monkeypatch):
    monkeypatch.setattr("test_imports.ROOT", tmp_path)
    inside = room in ("shell",)
    path = tmp_path / "softgrip_jax" / room / "part.py" if inside else tmp_path / "softgrip_jax" / f"{room}.py"
    path.parent.mkdir(parents=True)
    path.write_text(source)
    assert faults(path, ".".join(path.relative_to(tmp_path).parent.parts)) == [fault]
