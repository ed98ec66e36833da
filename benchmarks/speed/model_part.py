"""How far the models are from finite elements: the thesis's, the better one of this package, and the elements.

Finite elements were computed for this project with FElupe 11.3 (27-node hexahedra or 9-node plane-strain
quadrilaterals, Taylor-Hood, nearly incompressible neo-Hookean, follower pressure, frictionless planes, clamped edges);
uncertainty 0.2 % for the free shell, 0.5 % on a plane. Those of the shell on a cylinder and of the square one on a
plane that leans are of `softgrip verify` (0.2 to 0.8 % from mesh to mesh).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

import softgrip_jax as sg
from softgrip_jax.units import N_mm, kPa, mm

from . import cases

FIELDS = ("quantity", "at", "unit", "finite_elements", "thesis_model", "better_model", "better")

FREE = {5: 7.9015, 10: 11.5134, 15: 15.7501, 17.5: 18.9282}
FREE_LARGEST = 19.55
ON_PLANE = {5: 3.31149, 10: 11.21384, 15: 20.72738, 20: 31.30903}
ON_CYLINDER = {5: 0.985210, 10: 4.109744, 15: 8.872733}
ON_LEANING_PLANE = {10: 0.334668, 15: 1.998581}
CHAMBER = {20: 1.254112, 28: 2.049192, 31: 2.369260, 41: 3.491714}
PURE_MOMENT = {3.430561: 0.152477, 6.000336: 0.270593, 8.437209: 0.388814}
TIP_HELD = {3.460927: 0.069245, 5.536734: 0.116583, 7.258761: 0.165379}
TIP_HELD_LARGEST = 9.09
WEIGHT = {-1.0: -32.86516, -2.0: -49.68945, -3.0: -57.71167}
"""kPa: mm, N, N; N mm: H theta', N; N/m: mm."""


def measure(quick: bool) -> Iterator[dict[str, Any]]:
    """Rows of quantities at loads."""
    shell, finger = cases.shell(), sg.PneuNet.table_5_1("A")

    def compared(quantity, unit, better, true, thesis: Callable[[float], Any], ours: Callable[[float], Any] | None):
        for at, value in list(true.items())[: 1 if quick else None]:
            ours_value = "" if ours is None else float(ours(at))
            numbers = (quantity, at, unit, value, float(thesis(at)), ours_value, better)
            yield dict(zip(FIELDS, numbers, strict=True))

    def free(model):
        return lambda p: sg.solve(sg.shell.Free(shell, model=model), p * kPa).inflation / mm

    def on_plane(model):
        return lambda p: sg.solve(sg.shell.FlatContact(shell, distance=5 * mm, model=model), p * kPa).force

    def on_cylinder(model):
        scene = sg.shell.CylinderContact(shell, radius=20 * mm, gap=5 * mm, model=model)
        return lambda p: sg.solve(scene, p * kPa).force

    def leaning(model):
        square = dataclasses.replace(shell, b=shell.a)
        scene = sg.shell.InclinedContact(square, distance=5 * mm, angle=np.deg2rad(10), model=model)
        return lambda p: sg.solve(scene, p * kPa).force

    def limit(model):
        return lambda _: sg.limit_pressure(sg.shell.Free(shell, model=model)) / kPa

    def held(section):
        scene = sg.pneunet.TipContact(finger, section=section, **cases.ALL_RULES)
        return lambda moment: sg.pressure_for(scene, end_moment=moment * N_mm).tip_force

    def largest(section):
        def moment(_):
            scene = sg.pneunet.TipContact(finger, section=section, **cases.ALL_RULES)
            return sg.solve(scene, sg.limit_pressure(scene) * (1 - 1e-9)).end_moment / N_mm

        return moment

    def hanging(section):
        def tip(weight):
            scene = sg.pneunet.Free(finger, weight=(0.0, weight), section=section, inclination="none")
            return sg.solve(scene, 0.0).tip[1] / mm

        return tip

    def curved(section):
        from softgrip_jax.pneunet.section.choice import curvature_and_stretch

        return lambda m: curvature_and_stretch(section, finger, m * N_mm, 0.0)[0] * finger.H

    def walled():
        wall = sg.FlatShell(a=finger.a, b=finger.b, t_m=finger.t_m, material=finger.material)
        plane = sg.shell.obstacles.Plane(finger.h_x)
        scene = sg.shell.ObstacleContact(wall, plane)
        return lambda p: sg.solve(scene, p * kPa).force

    energy, exact = "energy membrane", "exact section law"
    yield from compared("shell, free: inflation", "mm", energy, FREE, free("arc"), None if quick else free("energy"))
    yield from compared(
        "shell on a plane: force", "N", energy, ON_PLANE, on_plane("arc"), None if quick else on_plane("energy")
    )
    yield from compared(
        "chamber wall on its neighbour: force",
        "N",
        energy,
        CHAMBER,
        lambda p: sg.pneunet.chamber(finger, p * kPa).force,
        None if quick else walled(),
    )
    yield from compared("cover, end moment: H theta'", "", exact, PURE_MOMENT, curved("thesis"), curved("exact"))
    if not quick:
        for quantity, true, force in (
            ("shell on a cylinder: force", ON_CYLINDER, on_cylinder),
            ("shell on a leaning plane: force", ON_LEANING_PLANE, leaning),
        ):
            yield from compared(quantity, "N", energy, true, force("arc"), force("energy"))
        yield from compared(
            "shell, free: largest pressure", "kPa", energy, {"": FREE_LARGEST}, limit("arc"), limit("energy")
        )
        yield from compared("cover, tip held: force", "N", exact, TIP_HELD, held("thesis"), held("exact"))
        yield from compared(
            "cover, tip held: largest moment",
            "N mm",
            exact,
            {"": TIP_HELD_LARGEST},
            largest("thesis"),
            largest("exact"),
        )
        yield from compared("cover, its weight: tip y", "mm", exact, WEIGHT, hanging("thesis"), hanging("exact"))
