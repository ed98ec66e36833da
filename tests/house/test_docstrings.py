"""Every public docstring has one form, and what its example prints is what it says.

The form: one line of meaning; every argument or field by its name, with its unit; `Raises` where an InputError may be
raised; a source for physics; an example, which is run.
"""

import ast
import dataclasses
import doctest
import functools
import importlib
import inspect
import re
import textwrap
from typing import Any

import jax
import jax.numpy as jnp
import matplotlib as mpl
import numpy as np
import pytest
from test_public_names import PUBLIC

import optim
import softgrip_jax as sg
from softgrip_jax import units
from softgrip_jax.fields import Checked, documented
from softgrip_jax.units import SI

ROOMS_OF_PHYSICS = ("shell", "pneunet", "materials", "objects")
SECTIONS = ("Args:", "Observables:", "Returns:", "Raises:", "Examples:")
UNITS = r"m|m\^2|N|N m|N/m|Pa|kg|rad|1/m|s|J/m\^3|SI|dimensionless|units? of (the axes|y)|any unit|shape"
UNIT = re.compile(rf"(?<![\w.])({UNITS})(?![\w/^])")
NUMBERS = ("Float", "Array", "float", "Scalar", "ndarray", "PerSegment")
"""In annotations: what has a unit. Whole numbers, names and other objects have none."""
QUANTITIES = ("pressure", "pressures", "inclination", "guess")
"""Arguments of functions that have a unit though any value may be given for them, lists for instance."""
WITHOUT_PHYSICS = {"friction", "to_friction", "friction_coefficient", "ClosedForms", "Object"}
"""Of the rooms of physics: what only holds, or hands on, a value."""


def public():
    """name -> object, for every class and function that a public module shows."""
    found: dict[str, Any] = {}
    seen = set()
    for module in ("softgrip_jax", *PUBLIC):
        for name in dir(importlib.import_module(module)):
            value = getattr(importlib.import_module(module), name)
            if (inspect.isclass(value) or inspect.isroutine(value)) and id(value) not in seen:
                seen.add(id(value))
                found[f"{module.removeprefix('softgrip_jax').removeprefix('.') or 'sg'}.{name}"] = value
    return found


NAMES = public()
FORMED = sorted(NAMES)


def doc_of(value):
    return inspect.cleandoc(value.__doc__ or "")


def section(value, title):
    """The indented lines under a title, as {name: text}."""
    found, inside, current = {}, False, ""
    for line in doc_of(value).splitlines():
        if line in SECTIONS:
            inside, current = line == title, ""
        elif inside and line and not line.startswith(" "):
            inside = False
        elif inside and line.strip():
            head = re.match(r"    (?:- )?([\w, ]+?): (.*)", line)
            if head and not line.startswith("     "):
                current = head[1]
                for name in current.split(", "):
                    found[name] = head[2]
            elif current:
                for name in current.split(", "):
                    found[name] += " " + line.strip()
    return found


def arguments(value: Any):
    """name -> annotation of every argument, or field, that a user may give."""
    if inspect.isclass(value) and dataclasses.is_dataclass(value):
        return {f.name: str(f.type) for f in dataclasses.fields(value) if f.init and f.repr and f.name[0] != "_"}
    if inspect.isclass(value) and issubclass(value, tuple):
        return {name: str(words) for name, words in value.__annotations__.items()}
    if inspect.isclass(value) and (issubclass(value, int | Warning) or inspect.isabstract(value)):
        return {}
    given = inspect.signature(value).parameters.values()
    return {one.name: str(one.annotation) for one in given if one.name != "self"}


def fields_of(cls):
    return {f.name: f for f in dataclasses.fields(cls)} if dataclasses.is_dataclass(cls) else {}


def told_of(value: Any):
    """name -> what is said of it, by the class itself, by one above it, or by the words under a field."""
    told = section(value, "Args:")
    if not inspect.isclass(value):
        return told
    for base in value.__mro__[1:]:
        if base.__module__.split(".")[0] in ("softgrip_jax", "optim"):
            for name, text in section(base, "Args:").items():
                # "as in CylinderContact" says less than what that class says.
                if told.get(name, "as in ").startswith("as in "):
                    told[name] = text
            for name, text in words_under(base).items():
                told.setdefault(name, text)
    return words_under(value) | told


@functools.cache
def words_under(cls):
    """name -> the string that stands under a field."""
    try:
        tree: Any = ast.parse(textwrap.dedent(inspect.getsource(cls))).body[0]
    except (OSError, TypeError):
        return {}
    found: dict[str, str] = {}
    for field, below in zip(tree.body, tree.body[1:], strict=False):
        if isinstance(field, ast.AnnAssign) and isinstance(below, ast.Expr) and isinstance(below.value, ast.Constant):
            found[ast.unparse(field.target)] = str(below.value.value)
    return found


@pytest.mark.parametrize("name", sorted(NAMES))
def test_it_begins_with_one_sentence(name):
    first, *rest = doc_of(NAMES[name]).splitlines() or [""]
    assert first.endswith("."), first
    assert not rest or rest[0] == "", "the first sentence is longer than its line"


@pytest.mark.parametrize("name", FORMED)
def test_every_argument_is_named_with_its_unit(name):
    value = NAMES[name]
    told = told_of(value)
    quantities = () if inspect.isclass(value) else QUANTITIES
    for argument, annotation in arguments(value).items():
        assert argument in told, argument
        text = told[argument]
        if text.startswith("as in ") or annotation.startswith("Callable"):
            # What stands there is held by the test of that class.
            continue
        field = fields_of(value).get(argument)
        kind = field.metadata.get("kind") if field else None
        if kind is not None:
            unit = SI[kind] or "dimensionless"
            assert re.search(rf"(?<![\w/]){re.escape(unit)}(?![\w/^])", text), f"{argument} has no {unit!r}: {text}"
        elif argument in quantities or any(word in annotation for word in NUMBERS):
            assert UNIT.search(text), f"{argument} has no unit: {text}"
        if " n" in annotation or '"2"' in annotation:
            assert "shape" in text, f"{argument} has no shape: {text}"


def source_of(function):
    """Its text; none of what a dataclass generates."""
    try:
        return inspect.getsource(function)
    except OSError:
        return ""


def called_by(function, known):
    """A function and those of its own file that it calls, directly or not."""
    known.add(function)
    around = vars(inspect.getmodule(function))
    for name in inspect.unwrap(function).__code__.co_names:
        one = around.get(name)
        if inspect.isfunction(one) and one.__module__ == function.__module__ and one not in known:
            called_by(one, known)
    return known


def raises(value):
    """Whether the source of a function, or of what makes an object, raises an error of the user's."""
    error = re.compile(r"raise (Input|JoinedRule|Config)Error")
    if not inspect.isclass(value):
        return any(error.search(source_of(one)) for one in called_by(value, set()))
    if inspect.isabstract(value):
        return False
    if issubclass(value, Checked) and any({"rule", "types"} & f.metadata.keys() for f in fields_of(value).values()):
        return True
    names = ("__check_init__", "__post_init__", "__init__")
    makers = [vars(base).get(name) for base in value.__mro__ for name in names]
    own = [one for one in makers if inspect.isfunction(one) and one.__module__.startswith(("softgrip_jax", "optim"))]
    return any(error.search(source_of(one)) for one in own)


@pytest.mark.parametrize("name", FORMED)
def test_it_says_what_is_raised(name):
    value = NAMES[name]
    if raises(value):
        assert re.search(r"^Raises:\n    \w+Error: ", doc_of(value), re.MULTILINE)


PHYSICS = [
    name
    for name in FORMED
    if NAMES[name].__module__.split(".")[1] in ROOMS_OF_PHYSICS
    and name.rpartition(".")[2] not in WITHOUT_PHYSICS
    and ".obstacles" not in NAMES[name].__module__
]


@pytest.mark.parametrize("name", PHYSICS)
def test_physics_has_a_source(name):
    assert re.search(r"^Source: .*(thesis|own|docs/theory|\d{4}|law)", doc_of(NAMES[name]), re.MULTILINE)


@pytest.mark.parametrize("name", FORMED)
def test_its_observables_are_named_with_their_units(name):
    value: Any = NAMES[name]
    observables = getattr(value, "OBSERVABLES", {})
    told = {}
    for base in reversed(value.__mro__ if observables else ()):
        told |= section(base, "Observables:")
    for observable, kind in observables.items():
        assert observable in told
        unit = SI[kind] or "dimensionless"
        assert re.search(rf"(?<![\w/]){re.escape(unit)}(?![\w/^])", told[observable]), f"{observable}: no {unit!r}"


def test_methods_of_public_classes_have_a_line():
    missing = []
    for name, cls in NAMES.items():
        if inspect.isclass(cls):
            missing += [
                f"{name}.{method}"
                for method, value in vars(cls).items()
                if method[0] != "_" and isinstance(value, property | classmethod) | inspect.isfunction(value)
                if not inspect.getdoc(getattr(cls, method))
            ]
    assert missing == []


def test_a_config_reads_the_words_of_fields_from_there():
    """`softgrip new` and the schema take the same words, without the units of constructors."""
    assert documented(sg.shell.FlatContact)["distance"] == "d, from the flat membrane to the plane"
    assert documented(sg.PneuNet)["t_m"] == "thickness of the wall"


def names_of_examples():
    """What an example may use without saying so."""
    numbers = {name: getattr(units, name) for name in dir(units) if isinstance(getattr(units, name), float)}
    return {"__name__": "__main__", "sg": sg, "optim": optim, "jax": jax, "jnp": jnp, "np": np} | numbers


def test_every_public_name_has_an_example():
    missing = [name for name in FORMED if ">>> " not in doc_of(NAMES[name]).partition("\nExamples:\n")[2]]
    assert missing == []


@pytest.mark.parametrize("room", sorted({name.rpartition(".")[0] for name in FORMED}))
def test_examples_print_what_they_say(room, tmp_path, monkeypatch):
    """One room, one process and one order, so that a program that several examples need is compiled once."""
    monkeypatch.chdir(tmp_path)
    mpl.use("agg")
    said: list[str] = []
    parser, runner = doctest.DocTestParser(), doctest.DocTestRunner()
    for name in FORMED:
        if name.rpartition(".")[0] == room:
            test = parser.get_doctest(doc_of(NAMES[name]), names_of_examples(), name, None, 0)
            runner.run(test, out=said.append)
    assert not said, "".join(said)
    assert runner.tries > 0
