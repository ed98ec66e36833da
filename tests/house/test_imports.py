"""Rooms import what docs/architecture.md allows and nothing else; no files need each other; optim stands above."""

import ast
import re
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest
from conftest import ROOT

PAGE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
ROW = re.compile(r"^\| `([\w.]+)` \| [^|]+ \| ?([^|]*?) ?\|$", re.MULTILINE)
ALLOWED = {room: set(allowed.split(", ")) - {""} for room, allowed in ROW.findall(PAGE)}
"""Room -> rooms that it may import; those of optim with `optim.` before them."""


def modules(root: Path) -> dict[str, Path]:
    """Every file of both packages by its full name; a package by that of its folder."""
    found = {}
    for package in ("softgrip_jax", "optim"):
        for path in sorted((root / package).rglob("*.py")):
            parts = path.relative_to(root).with_suffix("").parts
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def imports(name: str, path: Path, known: dict[str, Path]) -> set[str]:
    """Every module that a file imports, for the type checker too, by its full name."""
    found = set()
    package = name if path.name == "__init__.py" else name.rpartition(".")[0]
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = package.split(".")[: len(package.split(".")) - node.level + 1] if node.level else []
            module = ".".join([*base, *([node.module] if node.module else [])])
            full = {f"{module}.{alias.name}" for alias in node.names}
            found |= {one if one in known else module for one in full}
    return found


def room_of(name: str) -> str | None:
    """The room of a module; None for the packages themselves and for what is not ours."""
    package, *rest = name.split(".")
    if not rest or package not in ("softgrip_jax", "optim"):
        return None
    return rest[0] if package == "softgrip_jax" else f"optim.{rest[0]}"


def faults(name: str, path: Path, known: dict[str, Path]) -> list[str]:
    """Sentences about the imports of a file that the page does not allow."""
    room, said = room_of(name), []
    if room is not None and room not in ALLOWED:
        return [f"{room} is not on the page"]
    for other in sorted(imports(name, path, known)):
        target = room_of(other)
        if other.split(".")[0] == "optim" and name.startswith("softgrip_jax"):
            said.append(f"{room} imports optim")
        elif target is not None and room is not None and target not in {room} | ALLOWED[room]:
            said.append(f"{room} imports {target}")
        if other.split(".")[0] == "matplotlib" and room != "plots":
            said.append(f"{room} imports matplotlib")
    return said


KNOWN = modules(ROOT)


@pytest.mark.parametrize("name", KNOWN)
def test_rooms_import_what_the_page_allows(name):
    assert faults(name, KNOWN[name], KNOWN) == []


def test_no_files_need_each_other():
    graph = {name: imports(name, path, KNOWN) & set(KNOWN) - {name} for name, path in KNOWN.items()}
    TopologicalSorter(graph).prepare()


def test_the_figure_has_every_room_above_those_that_it_imports():
    """It is drawn by docs/make_images.py, from the same table."""
    figure = (ROOT / "docs" / "images" / "rooms.svg").read_text(encoding="utf-8")
    places = re.findall(r'<text [^>]*?y="([\d.]+)"[^>]*>([\w.]+)</text>', figure)
    height = {name: -float(y) for y, name in places}
    assert height.keys() == set(ALLOWED)
    for room, below in ALLOWED.items():
        for other in below:
            needs, found = {other}, set()
            while needs != found:
                found, needs = needs, needs.union(*(ALLOWED[name] for name in needs))
            # Rooms of which each needs the other one stand side by side.
            assert height[room] == height[other] if room in needs else height[room] > height[other], (room, other)


def test_the_page_names_every_room_and_no_other():
    assert {room_of(name) for name in KNOWN} - {None} == set(ALLOWED)


@pytest.mark.parametrize(("heading", "most"), [("From `sg.solve(", 10), ("From `softgrip design", 18)])
def test_the_walks_are_short_and_their_files_exist(heading, most):
    section = PAGE.split(f"## {heading}")[1].split("\n## ")[0]
    files = re.findall(r"^\| `([\w/]+\.py)` \|", section, re.MULTILINE)
    assert 5 <= len(files) <= most
    assert all((ROOT / file).is_file() for file in files)


@pytest.mark.parametrize(
    ("name", "source", "fault"),
    [
        ("softgrip_jax.units", "from . import scene", "units imports scene"),
        ("softgrip_jax.scene", "from .shell.arc.grasp import Grasp", "scene imports shell"),
        ("softgrip_jax.scene", "import softgrip_jax.cli", "scene imports cli"),
        ("softgrip_jax.config", "def f():\n    from optim.design.run import run_design", "config imports optim"),
        ("softgrip_jax.results", "import matplotlib.pyplot as plt", "results imports matplotlib"),
        ("softgrip_jax.results", "if TYPE_CHECKING:\n    from .scene import Scene", "results imports scene"),
        ("softgrip_jax.attic", "import os", "attic is not on the page"),
        ("optim.space", "from .design.run import run_design", "optim.space imports optim.design"),
    ],
)
def test_an_import_that_is_not_allowed_is_seen(name, source, fault, tmp_path):
    path = tmp_path / "part.py"
    path.write_text(source)
    assert faults(name, path, KNOWN) == [fault]


def test_a_circle_is_seen():
    with pytest.raises(CycleError):
        TopologicalSorter({"a": {"b"}, "b": {"a"}}).prepare()
