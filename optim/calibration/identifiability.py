"""Can the data tell the parameters apart? And if not, which further measurement would.

Near the fit a relative change e = d log x of the parameters changes the residuals by S e, with S the derivatives in
units of the noise. With the singular values s and right vectors v of S, the data fix the combination sum_j v_j log x_j
to a relative standard deviation 1/s. A direction with a large 1/s is one along which the parameters may move together
and the data hardly change: v ~ (1, -1) means that only the product of the two is determined, (1, 1) only their ratio.

A further measurement adds its own rows to S. Candidates are what can be measured on the same actuator; each is judged
by the derivatives of its own scene at the fit, by the same laws and at the same pressures, with 1 % noise.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

import softgrip_jax as sg
from softgrip_jax.scene import Scene

from ..space import Variable
from ..tension.test import Tension, material_of
from .data import Curve
from .fit import Fit
from .model import Fitting

UNKNOWN = 0.3
"""A direction is not determined when the data leave the parameters along it to within a factor e^0.3 = 1.35 or worse
(standard deviation): the interval then spans a factor of three."""

TAKES_PART = 0.1
"""Entries of a direction (largest: 1) below this do not take part in it."""

EQUAL = 0.02
"""Two entries this near to each other are equal: a product or a ratio."""

HELPFUL = 0.1
"""A further measurement is named when it determines the direction to this relative standard deviation."""

ASSUMED_NOISE, ASSUMED_POINTS = 0.01, 10
"""A further measurement has this noise, as a part of its largest value, and so many points."""

BELOW_LIMIT = 0.8
"""Pressures of a scene without any of its own go up to this part of its limit."""

NOTHING = 1e-12
"""Relative derivatives below this are rounding."""

STRAINS = (0.05, 1.0)
"""A further tension test covers these strains."""


@dataclasses.dataclass(frozen=True)
class Direction:
    """Parameters that the data cannot tell apart."""

    names: tuple[str, ...]
    change: np.ndarray
    """Relative change of each along the direction; the largest is 1."""
    deviation: float
    """Relative standard deviation along it; inf where the data do not depend on it at all."""
    combination: str
    """What the data do determine, in words."""
    remedies: tuple[str, ...]

    def sentence(self) -> str:
        """The verdict for people."""
        if len(self.names) == 1:
            what = f"The data do not determine {self.names[0]}"
        else:
            what = f"The data cannot tell {' and '.join(self.names)} apart: they determine only {self.combination}"
        size = "" if np.isinf(self.deviation) else f" (standard deviation {self.deviation:.0%})"
        helps = f" What would: {'; '.join(self.remedies)}." if self.remedies else ""
        return f"{what}{size}.{helps}"


def unknown_directions(fit: Fit) -> list[Direction]:
    """The directions that the data leave open, worst first; empty where every parameter is determined."""
    s, v = directions(_relative_jacobian(fit))
    found = []
    weakest = [k for k in range(len(s)) if s[k] < 1 / UNKNOWN]
    if not weakest:
        return []
    added = candidates(fit)
    for k in sorted(weakest, key=lambda k: s[k]):
        direction = v[k] / v[k][np.argmax(np.abs(v[k]))]
        part = np.flatnonzero(np.abs(direction) > TAKES_PART)
        names = tuple(fit.fitting.space.names[j] for j in part)
        deviation = np.inf if s[k] < NOTHING * max(s.max(), 1.0) else 1 / s[k]
        remedies = [words for words, rows in added if _parts(fit, rows, v[k])]
        remedies.append("measuring one of them itself" if len(part) > 1 else f"measuring {names[0]} itself")
        found.append(Direction(names, direction[part], deviation, combination(names, direction[part]), tuple(remedies)))
    return found


def _relative(fit: Fit) -> np.ndarray:
    """dx of a relative change of each parameter."""
    return fit.fitting.sizes_of(fit.x)


def _relative_jacobian(fit: Fit) -> np.ndarray:
    sigma = np.asarray(fit.member.sigma)[fit.fitting.of_curve]
    return np.asarray(fit.predicted.slopes) * _relative(fit) * (np.sqrt(np.asarray(fit.member.weight)) / sigma)[:, None]


def directions(jacobian: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Singular values and right vectors, one per parameter, also where there are fewer points."""
    n = jacobian.shape[1]
    _, s, vt = np.linalg.svd(np.concatenate([jacobian, np.zeros((n, n))]), full_matrices=False)
    return s, vt


def combination(names: Sequence[str], change: np.ndarray) -> str:
    if len(names) == 2:
        first, second = names
        ratio = -change[1] / change[0]  # d log second / d log first, of what stays the same: first^ratio * second
        if abs(ratio - 1) < EQUAL:
            return f"the product {first} * {second}"
        if abs(ratio + 1) < EQUAL:
            return f"the ratio {first} / {second}"
        return f"{first}^{ratio:.3g} * {second}"
    together = ", ".join(f"{name} by {c:+.2g} %" for name, c in zip(names, change, strict=True))
    return f"what stays when they change together ({together})"


def _parts(fit: Fit, rows: np.ndarray, direction: np.ndarray) -> bool:
    """Whether a further measurement determines a direction well enough, together with the data."""
    jacobian = np.concatenate([_relative_jacobian(fit), rows])
    s, v = directions(jacobian)
    variance = np.sum(((v @ direction) / np.maximum(s, 1e-300)) ** 2)
    return bool(np.sqrt(variance) < HELPFUL)


# --- what else could be measured --------------------------------------------------------------------------------------


def _shell_scenes(scene: Any) -> list[tuple[str, Scene]]:
    shell, distance = scene.shell, 0.3 * scene.shell.a
    model = "energy" if isinstance(scene, sg.shell.ObstacleContact) else getattr(scene, "model", "arc")
    law = {"model": model, "bending": getattr(scene, "bending", True)}
    plane = sg.shell.FlatContact(shell, distance=distance, **law)
    return [
        ("free inflation of the shell", sg.shell.Free(shell, **law)),
        (f"its force on a plane {float(distance) * 1e3:.2g} mm away", plane),
    ]


def _finger_scenes(scene: Any) -> list[tuple[str, Scene]]:
    law = {name: getattr(scene, name) for name in ("drive", "section", "moment_spread") if hasattr(scene, name)}
    if isinstance(scene, sg.pneunet.Cell):
        law["drive"] = "cell"
    return [
        (
            "the free bending of the finger without weight",
            sg.pneunet.Free(finger=scene.finger, weight=(0.0, 0.0), inclination="none", **law),
        ),
        ("the blocked force of the finger", sg.pneunet.TipContact(finger=scene.finger, **law)),
    ]


ACTUATORS: dict[str, Callable[[Any], list[tuple[str, Scene]]]] = {"shell": _shell_scenes, "finger": _finger_scenes}
"""Attribute of a scene that holds its actuator -> the measurements that are made of it."""


def candidates(fit: Fit) -> list[tuple[str, np.ndarray]]:
    """(words, rows that it would add to the Jacobian) of what else could be measured."""
    fitting = fit.fitting
    have = {type(fitting.space.scenes[c.model]) for c in fitting.curves if c.fit}
    found = []
    seen: set[type] = set()
    for name, model in fit.modules().items():
        part = next((p for p in ACTUATORS if hasattr(model, p)), None)
        largest = max((c.x.max() for c in fitting.curves if c.model == name), default=None)
        if part is not None and largest is None:  # only a tension test of its material was made
            limit = float(sg.limit_pressure(model))
            largest = BELOW_LIMIT * limit if np.isfinite(limit) else None
        if part is not None and largest is not None:
            x = np.linspace(0.2, 1.0, ASSUMED_POINTS) * largest
            for words, scene in ACTUATORS[part](model):
                if type(scene) not in have | seen:
                    seen.add(type(scene))
                    found += [(words, rows) for rows in [_rows(fit, name, part, scene, x)] if rows is not None]
        material = material_of(model)
        if material is not None and Tension not in have | seen:
            seen.add(Tension)
            rows = _rows(fit, name, "material", Tension(material), np.linspace(*STRAINS, ASSUMED_POINTS))
            found += [("a tension test of the material", rows)] if rows is not None else []
    return found


def _rows(fit: Fit, name: str, part: str, model: Any, x: np.ndarray) -> np.ndarray | None:
    """Derivatives of a candidate's first number, relative and in units of its noise; None where it has no answer.

    Parameters of the fit that live in `part` of the model called `name` are looked up in the candidate.
    """
    fitting = fit.fitting
    rows = np.zeros((len(x), fitting.space.size))
    columns, variables, start = [], [], 0
    for variable, size in zip(fitting.space.variables, fitting.space.sizes, strict=True):
        for option in variable.name.split("="):
            path = option.strip().split(".")
            if path[0] in fitting.space.scenes:
                if path[0] != name:
                    continue
                path = path[1:]
            if part in path:
                short = ".".join(path[path.index(part) :])
                variables.append(Variable(short, variable.low, variable.high, variable.scale))
                columns += range(start, start + size)
                break
        start += size
    if not variables:
        return None
    if isinstance(model, Tension):
        quantity, kind, component = "stress", "pressure", None
    else:
        quantity, kind = next(iter(model.prepared().OBSERVABLES.items()))
        component = 1 if kind == "position" else None
    kind = "length" if kind == "position" else kind
    curve = Curve("further", "further", quantity, kind, x, np.ones_like(x), component)
    predicted = Fitting({"further": model}, variables, [curve])
    found = predicted.predict_at(predicted.space.reference)
    size = float(np.max(np.abs(np.asarray(found.response.values))))
    if not size > 0:
        return None
    rows[:, columns] = np.asarray(found.slopes) / (ASSUMED_NOISE * size)
    return rows * _relative(fit)
