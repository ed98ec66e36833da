"""The energy membrane: two sections with whatever it touches, and maps of contact pressure and stretch."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon, Rectangle

from ..results import Solution
from ..shell.energy.scene import EnergyScene
from ..units import kPa, mm
from .figures import BLUE, BODY, OBJECT_EDGE, OBJECT_FACE, WIDTH, composes, paints, pressure_text
from .shell import FACE, POINTS, RIM

MAP_POINTS = 81
"""Points on each side of a map."""


VIEWS = ("along the length, y (mm)", "across the width, x (mm)")


@paints(EnergyScene, *VIEWS)
def _paint(solution: Solution, axes: Sequence[Axes]) -> None:
    scene: Any = solution.scene
    shape = {name: np.asarray(v) / mm for name, v in solution.shape(POINTS).items()}
    top = _top(shape)
    for ax, axis, half, names in (
        (axes[0], 1, scene.shell.b, ("y", "z_length")),
        (axes[1], 0, scene.shell.a, ("x", "z")),
    ):
        middle, face = (np.stack([shape[name + kind] for name in names], axis=-1) for kind in ("", "_face"))
        _paint_section(ax, scene, axis, float(half) / mm, middle, face, top)


def _top(shape: dict[str, np.ndarray]) -> float:
    """How high the sections are drawn, mm."""
    highest = max(float(np.max(shape[name])) for name in ("z_face", "z_length_face"))
    return max(1.15 * highest, highest + 2 * RIM)


def _paint_section(
    ax: Axes, scene: Any, axis: int, half: float, middle: np.ndarray, face: np.ndarray, top: float
) -> None:
    """The sheet, seen along the other axis, and the object's section in the plane x = 0 or y = 0.

    Heights are those of the outer face, from where it is at rest, as in the scene: the middle surface is half the
    thickness below.
    """
    middle = middle - [0.0, 0.5 * float(scene.shell.t_m) / mm]
    reach = max(half + RIM, float(np.max(np.abs(face[:, 0]))) + RIM)
    if scene.body is not None:
        across, up = np.meshgrid(np.linspace(-reach, reach, 241), np.linspace(0, top, 121))
        places = np.zeros((*across.shape, 3))
        places[..., axis], places[..., 2] = across, up
        distance = jax.vmap(scene.body.distance)(jnp.asarray(places.reshape(-1, 3) * mm))
        distance = np.asarray(distance).reshape(across.shape)
        ax.contourf(across, up, distance, levels=[-1e3, 0], colors=[OBJECT_FACE], zorder=0)
        ax.contour(across, up, distance, levels=[0], colors=[OBJECT_EDGE], linewidths=1, zorder=0)
    ax.add_patch(Rectangle((-half - RIM, -RIM), 2 * (half + RIM), RIM, facecolor=BODY, edgecolor="none", zorder=1))
    ax.plot([-half, half], [0, 0], color="white", linewidth=1, linestyle=(0, (4, 3)), zorder=2)
    sheet = np.concatenate([face, (2 * middle - face)[::-1]])
    ax.add_patch(Polygon(sheet, closed=True, facecolor=BLUE, edgecolor="none", zorder=3))
    ax.plot(*face.T, color=BLUE, linewidth=FACE, solid_capstyle="round", zorder=4)
    ax.plot([-half, half], [0, 0], "s", color="black", markersize=3.5, zorder=5)
    ax.set_xlim(-reach, reach)
    ax.set_ylim(-RIM, top)


@composes(EnergyScene)
def _compose(solution: Solution) -> Figure:
    scene: Any = solution.scene
    maps = scene.surface(solution.unknowns, solution.pressure, MAP_POINTS)
    shown = [("larger_stretch", "larger principal stretch", 1.0, "viridis")]
    if "contact_pressure" in maps:
        shown.insert(0, ("contact_pressure", "contact pressure (kPa)", kPa, "magma_r"))
    # One scale for both sections: columns as wide as what they show.
    drawn = list(Figure().subplots(1, 2))
    _paint(solution, drawn)
    spans = [np.ptp(ax.get_xlim()) for ax in drawn]
    section = 0.84 * WIDTH * float(np.ptp(drawn[0].get_ylim())) / sum(spans) + 0.75
    figure = Figure(figsize=(WIDTH, section + 2.0 * len(shown) + 0.1))
    halves: Any = figure.subfigures(2, 1, height_ratios=[section, 2.0 * len(shown) + 0.1])
    above, below = halves
    sections = above.subplots(1, 2, sharey=True, width_ratios=spans)
    _paint(solution, list(sections))
    for ax, label in zip(sections, VIEWS, strict=True):
        ax.set_aspect("equal")
        ax.set_xlabel(label)
    sections[0].set_ylabel("z (mm)")
    sections[0].set_title(pressure_text(solution), loc="left", fontweight="bold")
    for ax, (name, label, unit, colours) in zip(
        np.atleast_1d(below.subplots(len(shown), 1, sharex=True)), shown, strict=True
    ):
        image = ax.pcolormesh(
            np.asarray(maps["Y"]) / mm,
            np.asarray(maps["X"]) / mm,
            np.asarray(maps[name]) / unit,
            cmap=colours,
            shading="gouraud",
            rasterized=True,
        )
        ax.set_aspect("equal")
        ax.set_ylabel("X (mm)")
        below.colorbar(image, ax=ax, label=label, shrink=0.9)
        ax.label_outer()
    ax.set_xlabel("Y of the flat membrane (mm)")
    return figure
