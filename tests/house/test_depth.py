"""A scene is a statement and no tower: nothing is more than two classes below `Scene`, and none of it is a solver."""

import importlib
import re
from pathlib import Path

import pytest

import softgrip_jax
from softgrip_jax.equations import CurveEquations, PathEquations
from softgrip_jax.scene import Scene

MOST = 2
FOR_SOLVERS = {"find", "find_limit", "limit_pressure_from", "solve_for", "branch", "along", "onset"}
"""What solvers answer, see `BranchSolver`."""


def scenes() -> list[type[Scene]]:
    """Every scene of the package, the hidden ones too."""
    root = Path(softgrip_jax.__file__).parent
    for path in sorted(root.rglob("*.py")):
        if re.search(r"^class \w+\(", path.read_text(encoding="utf-8"), re.MULTILINE) and path.parent.name != "cli":
            importlib.import_module(".".join(path.relative_to(root.parent).with_suffix("").parts))
    found, at_hand = [], [Scene]
    while at_hand:
        below = [cls for cls in at_hand.pop().__subclasses__() if cls.__module__.startswith("softgrip_jax.")]
        found += below
        at_hand += below
    return sorted(set(found), key=lambda cls: (cls.__module__, cls.__name__))


def depth(cls: type) -> int:
    """How many classes are on the longest way from `Scene` down to a class."""
    return max((depth(base) + 1 for base in cls.__bases__ if issubclass(base, Scene)), default=0)


@pytest.mark.parametrize("cls", scenes(), ids=lambda cls: f"{cls.__module__}.{cls.__name__}")
def test_no_scene_is_deep(cls):
    assert depth(cls) <= MOST
    # No bases beside `Scene` that would be more of the same tower: only statements of equations, which hold no state.
    beside = {base for base in cls.__mro__ if base.__module__.startswith("softgrip_jax.")} - set(Scene.__mro__)
    assert {base for base in beside if not issubclass(base, Scene)} <= {CurveEquations, PathEquations}
    assert not any(base.__annotations__.keys() - {"CONTACT"} for base in (CurveEquations, PathEquations))
    assert not FOR_SOLVERS & set().union(*(vars(base) for base in beside))


def test_all_kinds_of_scenes_are_walked():
    names = {cls.__name__ for cls in scenes()}
    assert {"Free", "Plate", "Grasp", "AxialOffset", "TipContact", "Cell", "Linear", "EnergyGrasp"} <= names


def test_a_tower_is_seen():
    class Base(Scene): ...

    class Middle(Base): ...

    class Top(Middle): ...

    assert depth(Top) == MOST + 1
