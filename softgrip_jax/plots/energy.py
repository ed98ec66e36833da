"""The energy membrane: two sections with whatever it touches, and maps of contact pressure and stretch."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from ..results import Solution
from ..shell.energy_scene import EnergyScene
from ..units import kPa, mm
from .figures import BLUE, BODY, OBJECT_EDGE, OBJECT_FACE, WIDTH, composes, paints, pressure_text
from .shell import POINTS, RIM

MAP_POINTS = 81
"""On each side of a map."""


@paints(EnergyScene, "along the length, y (mm)", "across the width, x (mm)")
def _paint(solution: Solution, axes: Sequence[Axes]) -> None:
    shell = solution.scene.shell  # type: ignore[attr-defined]
    shape = {name: np.asarray(v) / mm for name, v in solution.shape(POINTS).items()}
    _paint_section(axes[0], solution, 1, float(shell.b) / mm, shape["y"], shape["z_length"])
    _paint_section(axes[1], solution, 0, float(shell.a) / mm, shape["x"], shape["z"])


def _paint_section(ax: Axes, solution: Solution, axis: int, half: float, s: np.ndarray, z: np.ndarray) -> None:
    """The middle surface, seen along the other axis, and the object's section in the plane x = 0 or y = 0."""
    scene: Any = solution.scene
    thickness = float(scene.shell.t_m) / mm
    top = max(1.15 * float(np.max(z)), float(np.max(z)) + 2 * RIM)
    reach = max(half + RIM, float(np.max(np.abs(s))) + RIM)
    if scene.body is not None:
        across, up = np.meshgrid(np.linspace(-reach, reach, 241), np.linspace(0, top, 121))
        places = np.zeros((*across.shape, 3))
        places[..., axis], places[..., 2] = across, up
        distance = jax.vmap(scene.body.distance)(jnp.asarray(places.reshape(-1, 3) * mm))
        distance = np.asarray(distance).reshape(across.shape)
        # The object is placed from the outer face, the profile is the middle surface.
        ax.contourf(across, up + thickness / 2, distance, levels=[-1e3, 0], colors=[OBJECT_FACE], zorder=0)
        ax.contour(across, up + thickness / 2, distance, levels=[0], colors=[OBJECT_EDGE], linewidths=1, zorder=0)
    ax.add_patch(Rectangle((-half - RIM, -RIM), 2 * (half + RIM), RIM, facecolor=BODY, edgecolor="none", zorder=1))
    ax.plot([-half, half], [0, 0], color="white", linewidth=1, linestyle=(0, (4, 3)), zorder=2)
    ax.plot(s, z, color=BLUE, linewidth=2, solid_capstyle="round", zorder=4)
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
    figure = Figure(figsize=(WIDTH, 2.1 + 2.0 * len(shown)))
    halves: Any = figure.subfigures(2, 1, height_ratios=[1.0, 0.85 * len(shown)])
    above, below = halves
    spans = [float(scene.shell.b), float(scene.shell.a)]
    sections = above.subplots(1, 2, sharey=True, width_ratios=[spans[0] + 2 * RIM * mm, spans[1] + 2 * RIM * mm])
    _paint(solution, list(sections))
    for ax, label in zip(sections, ("along the length, y (mm)", "across the width, x (mm)"), strict=True):
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
