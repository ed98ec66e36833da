"""`dir()` of what users import shows what is there for them, and nothing that it was made with."""

import ast
import importlib
from pathlib import Path

import pytest
from conftest import ROOT

import softgrip_jax as sg

STUB = ast.parse((ROOT / "softgrip_jax" / "__init__.pyi").read_text(encoding="utf-8"))
MODULES = [
    f"softgrip_jax.{alias.name}"
    for node in STUB.body
    if isinstance(node, ast.ImportFrom) and node.module is None
    for alias in node.names
]
PUBLIC = [*MODULES, "softgrip_jax.shell.obstacles", "softgrip_jax.plots", "optim"]


@pytest.mark.parametrize("name", PUBLIC)
def test_only_public_names_are_shown(name):
    module = importlib.import_module(name)
    shown = dir(module)
    assert shown == sorted(shown)
    assert len(shown) >= 5
    assert not [one for one in shown if one.startswith("_")]
    for one in shown:
        value = getattr(module, one)
        # A class or a function says where it is from; a module has a name; what is left are numbers and tables of ours.
        origin = getattr(value, "__module__", None) or getattr(value, "__name__", None)
        assert origin is None or origin.split(".")[0] in ("softgrip_jax", "optim"), one
    assert {"jax", "jnp", "np", "annotations", "eqx", "Any"}.isdisjoint(shown)


@pytest.mark.parametrize("name", PUBLIC)
def test_nothing_that_a_package_hands_out_is_missing(name):
    """Every `from .x import Name as Name` of an __init__ is there to be seen; so is every unit."""
    module = importlib.import_module(name)
    tree = ast.parse(Path(module.__file__).read_text(encoding="utf-8"))
    handed = {
        alias.asname
        for node in tree.body
        if isinstance(node, ast.ImportFrom) and node.level == 1
        for alias in node.names
        if alias.asname and alias.asname == alias.name and node.module
    }
    defined = {
        node.name for node in tree.body if isinstance(node, ast.ClassDef | ast.FunctionDef) and node.name[0] != "_"
    }
    assert handed | defined <= set(dir(module))


def test_units_and_the_package_itself():
    assert {"mm", "kPa", "gram", "degree", "N"} <= set(dir(sg.units))
    assert "math" not in dir(sg.units)
    assert {"solve", "FlatShell", "enable_cache", "shell"} <= set(dir(sg))
    assert "lazy_loader" not in dir(sg)
    assert "os" not in dir(sg)
