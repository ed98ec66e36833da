"""Solutions as pictures. The only room that imports matplotlib; every function returns what it drew on.

Lengths in mm, pressures in kPa. A kind of scene that has its own look registers a painter with `@paints(SceneClass)`;
`draw` takes the nearest class of the scene that has one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon, Rectangle

from .results import Solution, Status
from .scene import Scene, branch, limit_pressure
from .shell.cylinder import CylinderContact
from .shell.flat import FlatContact, InclinedContact
from .shell.flat_shell import ShellScene
from .units import DISPLAY, kPa, mm

# Okabe and Ito's palette: told apart by every kind of colour vision, and in grey.
BLUE, ORANGE, GREEN, VERMILION = "#0072B2", "#E69F00", "#009E73", "#D55E00"
OBJECT_FACE, OBJECT_EDGE, BODY = "#EFE3C6", "#8A6D1D", "#4D4D4D"

STYLE: dict[str, Any] = {
    "font.size": 9,
    "axes.titlesize": 9,
    "axes.labelsize": 9,
    "legend.fontsize": 8,
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.8,
    "lines.linewidth": 1.8,
    "legend.frameon": False,
    "savefig.dpi": 200,
    "savefig.bbox": "tight",
    "savefig.pad_inches": 0.05,
    "figure.constrained_layout.use": True,
}
"""One look for every figure, readable at the width of a column (85 mm)."""

RIM = 4.0
"""mm of the rigid shell that a picture shows around and under the membrane."""

POINTS = 301
"""Points on a membrane: a corner of its profile is off by less than a line's width."""

WIDTH = 7.0
"""Inches: both columns of a page."""

Painter = Callable[[Solution, Sequence[Axes]], None]
_PAINTERS: dict[type[Scene], tuple[tuple[str, ...], Painter]] = {}


def paints(scene: type[Scene], *views: str) -> Callable[[Painter], Painter]:
    """Register a painter of `scene` and its subclasses; `views` label the axes that it is given."""

    def register(painter: Painter) -> Painter:
        _PAINTERS[scene] = (views, painter)
        return painter

    return register


def draw(solution: Solution) -> Figure:
    """A picture of one solved scene, to scale."""
    return compare({"": solution})


def compare(solutions: Mapping[str, Solution]) -> Figure:
    """Several solutions of one kind of scene under each other, on one scale: before and after, for instance."""
    painters = {label: _painter(solution) for label, solution in solutions.items()}
    views = max((views for views, _ in painters.values()), key=len)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(WIDTH, WIDTH))
        grid = figure.subplots(len(solutions), len(views), squeeze=False, sharex="col", sharey=True)
        for row, (label, solution) in zip(grid, solutions.items(), strict=True):
            painters[label][1](solution, list(row))
            pressure = f"{float(solution.pressure) / kPa:.3g} kPa"
            row[0].set_title(f"{label}: {pressure}" if label else pressure, loc="left", fontweight="bold")
        for ax, view in zip(grid[-1], views, strict=True):
            ax.set_xlabel(view)
        for ax in grid[:, 0]:
            ax.set_ylabel("z (mm)")
        for ax in grid.ravel():
            ax.set_aspect("equal")
            ax.tick_params(labelbottom=ax in grid[-1], labelleft=ax in grid[:, 0])
        # One scale for all views: columns as wide as what they show, rows as high.
        spans = [np.ptp(ax.get_xlim()) for ax in grid[0]]
        grid[0, 0].get_gridspec().set_width_ratios(spans)
        figure.set_layout_engine("constrained", h_pad=0.06)
        height = len(solutions) * (0.86 * WIDTH * np.ptp(grid[0, 0].get_ylim()) / sum(spans) + 0.3) + 0.4
        figure.set_size_inches(WIDTH, height)
    return figure


def has_picture(scene: Scene) -> bool:
    """Whether `draw` knows this kind of scene."""
    return any(cls in _PAINTERS for cls in type(scene).__mro__)


def pressure_curve(scene: Any, observable: str = "", ax: Axes | None = None, label: str = "") -> Axes:
    """Pressure against an observable (the scene's first, where none is named), through the limit point.

    Behind the limit, where equilibrium exists at a given volume but not at a given pressure, the curve is dashed.
    """
    name = observable or next(iter(scene.OBSERVABLES))
    if name not in scene.OBSERVABLES:
        raise ValueError(f"{type(scene).__name__} has no observable {name!r}; it has: {', '.join(scene.OBSERVABLES)}.")
    curve, limit = branch(scene), float(limit_pressure(scene))
    unit_label, unit = DISPLAY[scene.OBSERVABLES[name]]
    good = np.asarray(curve.status) == Status.OK
    x, y = np.asarray(curve.observables[name])[good] / unit, np.asarray(curve.pressure)[good] / kPa
    top = int(np.argmax(y)) if np.isfinite(limit) else len(y) - 1
    with mpl.rc_context(STYLE):
        own = ax is None
        ax = Figure(figsize=(WIDTH / 2, 2.5)).subplots() if ax is None else ax
        (line,) = ax.plot(x[: top + 1], y[: top + 1], color=None if label else BLUE, label=label or None)
        ax.plot(x[top:], y[top:], color=line.get_color(), linestyle=(0, (3, 2)))
        if np.isfinite(limit):
            ax.plot(x[top], limit / kPa, "o", color=VERMILION, markersize=5, zorder=5)
            ax.annotate(
                f"limit {limit / kPa:.4g} kPa",
                (x[top], limit / kPa),
                (0, 6),
                textcoords="offset points",
                ha="center" if top < len(x) - 1 else "right",
            )
        if np.isfinite(limit) and own:
            # Behind the limit the curve runs far away: as much of it as there is before the limit says enough.
            ax.set_xlim(0, 2 * x[top] if top < len(x) - 1 else None)
            ax.set_ylim(0, 1.15 * limit / kPa)
        ax.set_xlabel(_with_unit(name, unit_label))
        ax.set_ylabel("pressure (kPa)")
        if label:
            ax.legend()
    return ax


def convergence(history: Mapping[str, np.ndarray], label: str = "best objective") -> Figure:
    """How a search went: its best objective, and the lanes that have an equilibrium, are feasible, still move."""
    best = np.asarray(history["best_objective"])
    steps = np.arange(1, len(best) + 1)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(WIDTH / 2, 3.6))
        above, below = figure.subplots(2, 1, sharex=True, height_ratios=[1.3, 1])
        above.plot(steps, best, color=BLUE)
        above.set_ylabel(label)
        colours = {"with_equilibrium": BLUE, "feasible": GREEN, "moving": VERMILION}
        words = {"with_equilibrium": "solved", "feasible": "feasible", "moving": "moving"}
        styles = {"with_equilibrium": "-", "feasible": (0, (5, 2)), "moving": (0, (1, 1))}
        for name, colour in colours.items():
            below.plot(steps, history[name], color=colour, linestyle=styles[name], label=words[name])
        below.set_ylim(bottom=0)
        below.set_xlabel("step")
        below.set_ylabel("lanes")
        below.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=3, columnspacing=1.0, borderaxespad=0.1)
    return figure


# --- painters ---------------------------------------------------------------------------------------------------------


@paints(ShellScene, "along the length, y (mm)", "across the width, x (mm)")
def _paint_shell(solution: Solution, axes: Sequence[Axes]) -> None:
    shape = {name: np.asarray(v) / mm for name, v in solution.shape(POINTS).items()}
    _paint_section(axes[0], solution, "length", shape["y"], shape["z_length"])
    _paint_section(axes[1], solution, "width", shape["x"], shape["z"])


def _paint_section(ax: Axes, solution: Solution, view: str, s: np.ndarray, z: np.ndarray) -> None:
    scene: Any = solution.scene
    half = float(scene.shell.b if view == "length" else scene.shell.a) / mm
    _paint_surroundings(scene, solution, ax, view, half, s, z)
    # The rigid shell holds the edges of the membrane; the dashes are where it lies without pressure.
    body = {"facecolor": BODY, "edgecolor": "none", "zorder": 1}
    ax.add_patch(Rectangle((-half - RIM, -RIM), 2 * (half + RIM), RIM, **body))
    ax.plot([-half, half], [0, 0], color="white", linewidth=1, linestyle=(0, (4, 3)), zorder=2)
    ax.plot(s, z, color=BLUE, linewidth=2, solid_capstyle="round", zorder=4)
    ax.plot([-half, half], [0, 0], "s", color="black", markersize=3.5, zorder=5)


def _paint_surroundings(scene, solution, ax, view, half, s, z) -> None:
    """What the membrane touches: a plane as a slab, a cylinder as its section."""
    look = {"facecolor": OBJECT_FACE, "edgecolor": OBJECT_EDGE, "linewidth": 1.0, "zorder": 0}
    slab = 2 * RIM
    if isinstance(scene, FlatContact):
        ax.add_patch(Rectangle((-half - RIM, float(scene.distance) / mm), 2 * (half + RIM), slab, **look))
    elif isinstance(scene, InclinedContact) and view == "width":
        lean = float(scene.angle)
        along, normal = np.array([np.cos(lean), -np.sin(lean)]), np.array([np.sin(lean), np.cos(lean)])
        middle = np.max(s * normal[0] + z * normal[1]) * normal
        reach = 1.3 * half
        corners = [middle - reach * along, middle + reach * along]
        ax.add_patch(Polygon([*corners, corners[1] + slab * normal, corners[0] + slab * normal], closed=True, **look))
    elif isinstance(scene, CylinderContact):
        radius, gap = float(scene.radius) / mm, float(scene.gap) / mm
        if view == "length":
            ax.add_patch(Circle((half - _axis_height(solution), gap + radius), radius, **look))
        else:
            ax.add_patch(Rectangle((-half - RIM, gap), 2 * (half + RIM), 2 * radius, **look))


def _axis_height(solution: Solution) -> float:
    """Distance (mm) of the cylinder's axis from the near end of the membrane: b where the state is symmetric."""
    scene: Any = solution.scene
    height = solution.observables.get("height", getattr(scene, "height", scene.shell.b))
    return float(height) / mm


@paints(InclinedContact, "across the width, x (mm)")
def _paint_inclined(solution: Solution, axes: Sequence[Axes]) -> None:
    shape = {name: np.asarray(v) / mm for name, v in solution.shape(POINTS).items()}
    _paint_section(axes[0], solution, "width", shape["x"], shape["z"])


# --- figures ----------------------------------------------------------------------------------------------------------


def _painter(solution: Solution) -> tuple[tuple[str, ...], Painter]:
    if np.ndim(solution.status):
        raise ValueError("This solution is a batch; draw one scene of it.")
    if int(solution.status) != Status.OK:
        raise ValueError(f"There is no state to draw: {Status(int(solution.status)).message}.")
    for cls in type(solution.scene).__mro__:
        if cls in _PAINTERS:
            return _PAINTERS[cls]
    raise ValueError(f"There is no picture of a {type(solution.scene).__name__} yet.")


def _with_unit(name: str, unit: str) -> str:
    words = name.replace("_", " ")
    return f"{words} ({unit})" if unit else words
