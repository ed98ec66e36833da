"""Nobody who installs the package gets code under a copyleft licence with it."""

import importlib.metadata as metadata
import re
import tomllib

from conftest import ROOT

COPYLEFT = re.compile(r"\bA?L?GPL|Affero|General Public|EUPL|CeCILL", re.IGNORECASE)
TOOLS = {"moocore"}
"""Of the tests alone: LGPL, comes with pymoo, a rival that searches are compared with. Nothing of it is distributed."""


def name_of(requirement: str) -> str:
    return re.sub(r"[-_.]+", "-", re.match(r"[\w.-]+", requirement)[0]).lower()


def licences(name: str) -> str:
    about = metadata.metadata(name)
    # Some write the whole text of a licence into the old field: its first line names it.
    named = [about.get("License-Expression") or "", (about.get("License") or "").partition("\n")[0]]
    return ", ".join([*named, *(c for c in about.get_all("Classifier") or [] if c.startswith("License"))])


def needed(names: list[str]) -> set[str]:
    """The packages and what they need in turn, without extras, as far as it is installed here."""
    found: set[str] = set()
    todo = list(names)
    while todo:
        name = todo.pop()
        if name in found:
            continue
        try:
            requirements = metadata.requires(name) or []
        except metadata.PackageNotFoundError:
            continue  # of another system
        found.add(name)
        todo += [name_of(r) for r in requirements if "extra ==" not in r]
    return found


def test_what_the_package_needs_is_free_of_copyleft():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    found = needed([name_of(r) for r in project["dependencies"]])
    assert {"jax", "jaxlib", "numpy", "scipy", "matplotlib", "pydantic"} <= found
    assert {name: licences(name) for name in found if COPYLEFT.search(licences(name))} == {}


def test_of_the_tools_one_is_known():
    named = set(re.findall(r"^([\w.-]+)==", (ROOT / "requirements.lock").read_text(), re.MULTILINE))
    installed = {name for name in map(name_of, named) if needed([name])}
    assert {name for name in installed if COPYLEFT.search(licences(name))} <= TOOLS
