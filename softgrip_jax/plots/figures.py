"""Figures: one scene, several on one scale, a curve through its limit, a search.

A kind of scene that has its own look registers a painter with `@paints(SceneClass)`; `draw` takes the nearest class of
the scene that has one. Where a picture needs more than flat views, `@composes(SceneClass)` makes the whole figure.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from textwrap import fill
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ..errors import InputError
from ..questions import branch, limit_pressure
from ..results import Solution, Status
from ..scene import Scene
from ..units import DISPLAY, kPa

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
    "figure.dpi": 150,
    "savefig.dpi": 200,
    "savefig.bbox": "tight",
    "savefig.pad_inches": 0.05,
    "figure.constrained_layout.use": True,
}
"""One look for every figure, readable at the width of a column (85 mm)."""

WIDTH = 7.0
"""Inches: both columns of a page."""

Painter = Callable[[Solution, Sequence[Axes]], None]
Composer = Callable[[Solution], Figure]


class Look(NamedTuple):
    """How a kind of scene is drawn: its views, by the label of their horizontal axis, and who paints them."""

    views: tuple[str, ...]
    vertical: str
    paint: Painter


_PAINTERS: dict[type[Scene], Look] = {}
_COMPOSERS: dict[type[Scene], Composer] = {}


def paints(scene: type[Scene], *views: str, vertical: str = "z (mm)") -> Callable[[Painter], Painter]:
    """Register a painter of a kind of scene and its subclasses; a decorator.

    Args:
        scene: the class.
        views: labels of the horizontal axes that the painter is given, with units.
        vertical: label of the vertical axis, with its unit.

    Examples:
        >>> class Mine(sg.Scene): ...
        >>> @sg.plots.paints(Mine, "x (mm)")
        ... def paint(solution, axes):
        ...     axes[0].plot(*solution.shape(11).values())
    """

    def register(painter: Painter) -> Painter:
        _PAINTERS[scene] = Look(views, vertical, painter)
        return painter

    return register


def composes(scene: type[Scene]) -> Callable[[Composer], Composer]:
    """Register what `draw` shows of `scene` and its subclasses, where that is more than the views of a painter."""

    def register(composer: Composer) -> Composer:
        _COMPOSERS[scene] = composer
        return composer

    return register


def draw(solution: Solution) -> Figure:
    """A picture of one solved scene, to scale, lengths in mm.

    Args:
        solution: of one scene, not a batch.

    Raises:
        InputError: for a batch, a state that is not OK, or a scene without a picture.

    Examples:
        >>> shell = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
        >>> sg.plots.draw(sg.solve(sg.shell.Free(shell), 15 * kPa)).savefig("shell.png")
    """
    look(solution)
    for cls in type(solution.scene).__mro__:
        if cls in _COMPOSERS:
            with mpl.rc_context(STYLE):
                return _COMPOSERS[cls](solution)
    return compare({"": solution})


def compare(solutions: Mapping[str, Solution]) -> Figure:
    """Several solutions of one kind of scene under each other, on one scale.

    Args:
        solutions: label -> solution, in the order of the rows.

    Raises:
        InputError: as `draw`.

    Examples:
        >>> shell = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
        >>> states = {"low": sg.solve(sg.shell.Free(shell), 5 * kPa), "high": sg.solve(sg.shell.Free(shell), 15 * kPa)}
        >>> len(sg.plots.compare(states).axes)  # two views of each
        4
    """
    looks = {label: look(solution) for label, solution in solutions.items()}
    views, vertical, _ = max(looks.values(), key=lambda look: len(look.views))
    width = WIDTH if len(views) > 1 else 0.6 * WIDTH
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(width, width))
        grid = figure.subplots(len(solutions), len(views), squeeze=False, sharex="col", sharey=True)
        for row, (label, solution) in zip(grid, solutions.items(), strict=True):
            looks[label].paint(solution, list(row))
            pressure = pressure_text(solution)
            row[0].set_title(f"{label}: {pressure}" if label else pressure, loc="left", fontweight="bold")
        for ax, view in zip(grid[-1], views, strict=True):
            ax.set_xlabel(view)
        for ax in grid[:, 0]:
            ax.set_ylabel(vertical)
        for ax in grid.ravel():
            ax.set_aspect("equal")
            ax.tick_params(labelbottom=ax in grid[-1], labelleft=ax in grid[:, 0])
        # One scale for all views: columns as wide as what they show, rows as high.
        spans = [np.ptp(ax.get_xlim()) for ax in grid[0]]
        grid[0, 0].get_gridspec().set_width_ratios(spans)
        figure.set_layout_engine("constrained", h_pad=0.06)
        height = len(solutions) * (0.86 * width * np.ptp(grid[0, 0].get_ylim()) / sum(spans) + 0.3) + 0.4
        figure.set_size_inches(width, height)
        figure.draw_without_rendering()  # room for the words is right once the ticks of this size are known
    return figure


def has_picture(scene: Scene) -> bool:
    """Whether `draw` knows this kind of scene.

    Args:
        scene: any scene.

    Examples:
        >>> sg.plots.has_picture(sg.pneunet.TipContact(sg.PneuNet.table_5_1("A")))
        True
    """
    return any(cls in _PAINTERS for cls in type(scene).__mro__)


def pressure_curve(scene: Any, observable: str = "", ax: Axes | None = None, label: str = "") -> Axes:
    """Pressure against an observable, through the limit point.

    Behind the limit, where equilibrium exists at a given volume but not at a given pressure, the curve is dashed. It
    has gaps where states are not OK, and no mark at the limit where that is one of them.

    Args:
        scene: what to show.
        observable: its name; the scene's first, where none is given.
        ax: axes to draw on; new ones by default.
        label: for the legend.

    Raises:
        InputError: for an observable that the scene does not have.

    Examples:
        >>> shell = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
        >>> sg.plots.pressure_curve(sg.shell.Free(shell)).get_xlabel()
        'inflation (mm)'
    """
    known = scene.prepared().OBSERVABLES
    name = observable or next(iter(known))
    if name not in known:
        raise InputError(f"{type(scene).__name__} has no observable {name!r}; it has: {', '.join(known)}.")
    curve, limit = branch(scene), float(limit_pressure(scene))
    unit_label, unit = DISPLAY[known[name]]
    good, pressure = np.asarray(curve.status) == Status.OK, np.asarray(curve.pressure)
    x, y = (np.where(good, v, np.nan) for v in (np.asarray(curve.observables[name]) / unit, pressure / kPa))
    top = int(np.nanargmax(pressure)) if np.isfinite(limit) else len(y) - 1
    is_drawn = np.isclose(pressure[top], limit) and good[top]  # the limit is one of the points
    with mpl.rc_context(STYLE):
        own = ax is None
        ax = Figure(figsize=(WIDTH / 2, 2.5)).subplots() if ax is None else ax
        (line,) = ax.plot(x[: top + 1], y[: top + 1], color=None if label else BLUE, label=label or None)
        ax.plot(x[top:], y[top:], color=line.get_color(), linestyle=(0, (3, 2)))
        if is_drawn:
            ax.plot(x[top], limit / kPa, "o", color=VERMILION, markersize=5, zorder=5)
            ax.annotate(
                f"limit {limit / kPa:.4g} kPa",
                (x[top], limit / kPa),
                (0, 6),
                textcoords="offset points",
                ha="center" if top < len(x) - 1 else "right",
            )
        if np.isfinite(limit) and own:
            ax.set_xlim(left=0)
            ax.set_ylim(0, 1.15 * limit / kPa)
        ax.set_xlabel(_with_unit(name, unit_label))
        ax.set_ylabel("pressure (kPa)")
        if label:
            ax.legend()
    return ax


FEW_STEPS = 10
BESIDE, ABOVE = 22, 38
"""Letters in a line beside and above the diagrams of a search."""


def convergence(
    history: Mapping[str, np.ndarray],
    label: str = "best objective",
    title: str = "",
    finished: float | None = None,
    paths: np.ndarray | None = None,
) -> Figure:
    """How a search went, step by step.

    Above, the best objective so far and once finished; below, how many designs have an equilibrium, have been feasible,
    still move.

    Args:
        history: best_objective, with_equilibrium, feasible and moving, each of shape (steps,), dimensionless.
        label: of the objective.
        title: above the figure.
        finished: the best objective in the end, dimensionless.
        paths: the objective of every design at every step, dimensionless, shape (steps, designs); NaN where it is not
            feasible.

    Examples:
        >>> steps = np.arange(1, 4)
        >>> history = {"best_objective": 1 / steps, "with_equilibrium": steps, "feasible": steps, "moving": steps}
        >>> len(sg.plots.convergence(history).axes)
        2
    """
    best = np.asarray(history["best_objective"])
    steps = np.arange(1, len(best) + 1)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(WIDTH / 2, 3.6))
        above, below = figure.subplots(2, 1, sharex=True, height_ratios=[1.3, 1])
        # A search of few steps is points rather than lines.
        marker = "o" if len(best) < FEW_STEPS else None
        if paths is not None and np.size(paths):
            above.plot(steps, paths, color="0.6", linewidth=0.4, alpha=0.35, rasterized=True, zorder=0)
        above.plot(steps, best, color=BLUE, marker=marker)
        if finished is not None:
            above.plot(len(best) + 1, finished, "o", color=VERMILION)
            falls = finished < np.nanmean([finished, *best])  # its name is where the line does not come from
            place = {"xytext": (3, -6 if falls else 6), "va": "top" if falls else "bottom"}
            place |= {"textcoords": "offset points", "ha": "right"}
            above.annotate("finished", (len(best) + 1, finished), color=VERMILION, **place)
        above.margins(x=0.1 if marker else 0.05, y=0.25)
        # Words beside an axis are as long as it is at most, and those above it as wide as the figure.
        above.set_ylabel("\n".join(fill(line, BESIDE) for line in label.splitlines()))
        above.set_title(fill(title, ABOVE), loc="left", fontweight="bold")
        colours = {"with_equilibrium": BLUE, "feasible": GREEN, "moving": VERMILION}
        words = {"with_equilibrium": "solved", "feasible": "feasible so far", "moving": "moving"}
        styles = {"with_equilibrium": "-", "feasible": (0, (5, 2)), "moving": (0, (1, 1))}
        for name, colour in colours.items():
            below.plot(steps, history[name], color=colour, linestyle=styles[name], label=words[name], marker=marker)
        below.set_ylim(0, 1.1 * max(np.max(history[name]) for name in colours))
        below.xaxis.set_major_locator(MaxNLocator(integer=True))
        below.set_xlabel("step")
        below.set_ylabel("designs")
        below.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=3, columnspacing=1.0, borderaxespad=0.1)
    return figure


def pressure_text(solution: Solution) -> str:
    """The pressure as the title of a picture."""
    return f"{float(solution.pressure) / kPa:.3g} kPa"


def look(solution: Solution) -> Look:
    """Who paints a solution, or a ValueError that says why nobody can."""
    if np.ndim(solution.status):
        raise InputError("This solution is a batch; draw one scene of it.")
    if int(solution.status) != Status.OK:
        raise InputError(f"There is no state to draw: {Status(int(solution.status)).message}.")
    for cls in type(solution.scene).__mro__:
        if cls in _PAINTERS:
            return _PAINTERS[cls]
    raise InputError(f"There is no picture of a {type(solution.scene).__name__} yet.")


def _with_unit(name: str, unit: str) -> str:
    words = name.replace("_", " ")
    return f"{words} ({unit})" if unit else words
