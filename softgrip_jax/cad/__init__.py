"""Solids of a design: parts, moulds, and what is checked of them.

Everything here is in mm, as CAD programs are. build123d is imported when the first solid is made.
"""

from __future__ import annotations

import dataclasses
from typing import Any

from ..errors import InputError
from ..pneunet import Gripper
from ..pneunet.finger import PneuNet
from ..scene import Scene
from ..shell import FlatShell
from ..shell.flat_shell import ShellScene
from . import solids as solids
from .checks import Check as Check
from .checks import check_mesh as check_mesh
from .checks import check_solids as check_solids
from .checks import check_thicknesses as check_thicknesses
from .finger_parts import counts_of
from .finger_parts import finger_export as finger_export
from .finger_parts import gripper_base as gripper_base
from .limits import check_bed
from .parts import Export as Export
from .parts import Piece as Piece
from .pdf import write_pdf as write_pdf
from .plates import laid_out as laid_out
from .plates import printed as printed
from .plates import write_plate as write_plate
from .rules import ManufactureTable as ManufactureTable
from .sheet import Expected as Expected
from .sheet import as_html as as_html
from .sheet import sheet as sheet
from .sheet import silicone as silicone
from .sheet import silicone_of_all as silicone_of_all
from .shell_parts import check_ring as check_ring
from .shell_parts import shell_export as shell_export


def actuator_of(module: Any) -> FlatShell | PneuNet | None:
    """The shell or the finger within a scene; None where there is neither."""
    if isinstance(module, FlatShell | PneuNet):
        return module
    if not dataclasses.is_dataclass(module):
        return None
    parts = (getattr(module, field.name) for field in dataclasses.fields(module))
    return next((found for found in map(actuator_of, parts) if found is not None), None)


def growth(table: ManufactureTable) -> float:
    """How much larger moulds are than what comes out of them."""
    return 1 / (1 - table.shrinkage_percent / 100)


def export_of(scene: Scene, table: ManufactureTable, with_moulds: bool = True, drawn: Scene | None = None) -> Export:
    """The parts of a scene's actuator, and its moulds; an InputError in one sentence where that cannot be made.

    drawn: the scene of the mould, where that is there already: a finger has as many chambers as it.
    """
    actuator = actuator_of(scene)
    if actuator is None:
        raise InputError(f"A {type(scene).__name__} has neither a shell nor a finger to be made.")
    if isinstance(actuator, FlatShell):
        if isinstance(scene, ShellScene) and type(scene).energy_scene is ShellScene.energy_scene:
            raise InputError(
                f"A {type(scene).__name__} does not say what its membrane touches, so that the ring cannot be kept "
                "clear of it; export shell.Free with the same shell where it touches nothing."
            )
        export = shell_export(actuator, table, with_moulds)
        fingers, every = getattr(scene, "fingers", 1), "every part"
    else:
        mould = actuator if drawn is None else actuator_of(drawn)
        assert isinstance(mould, PneuNet)
        export = finger_export(actuator, table, with_moulds, counts_of(mould))
        fingers, every = 1, "every part but the base"
        gripper = getattr(scene, "gripper", None)
        if isinstance(gripper, Gripper):
            export = dataclasses.replace(export, pieces=[*export.pieces, gripper_base(gripper, table)])
            fingers = gripper.n
    if fingers > 1:
        facts = export.facts | {"fingers": f"{fingers}: cast and print {every} as often"}
        export = dataclasses.replace(export, facts=facts, fingers=fingers)
    check_bed(printed(export, growth(table)), table)
    if isinstance(actuator, FlatShell):
        # The arcs know their object by its numbers, their twin by energy by its distance.
        twin = scene.energy_scene() if isinstance(scene, ShellScene) else scene.prepared()
        check_ring(getattr(twin, "body", None), actuator, table)
    return export
