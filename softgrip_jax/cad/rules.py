"""The section [manufacture] of a config: what the physics does not know, with defaults and rules.

    [manufacture]
    top_wall_mm = 2          # of a chamber; a tenth of the cover's width without it
    channel_mm = 2           # side of the square air channel from chamber to chamber
    bed_mm = [220, 220, 250] # of the printer

docs/guides/mould.md has every key.
"""

from __future__ import annotations

from typing import Annotated

import pydantic

from ..config.keys import Table

LARGEST = 10_000.0
"""mm: no printer and no bench is larger."""
Length = Annotated[float, pydantic.Field(gt=0, le=LARGEST, strict=False)]
Width = Annotated[float, pydantic.Field(ge=0, le=LARGEST, strict=False)]


class ManufactureTable(Table):
    """How a design is made. Lengths in mm."""

    # A finger.
    side_wall_mm: Length | None = None
    """Of a chamber, to its sides; (B - 2b)/2 without it, which the cell law of the finger assumes."""
    top_wall_mm: Length | None = None
    """Of a chamber; B/10 without it, which the cell law of the finger assumes."""
    channel_mm: Width = 2.0
    """Side of the square air channel from chamber to chamber, on the cover."""
    channel_wall_mm: Length = 1.5
    """Of the channel where it crosses a gap."""
    foot_mm: Length = 12.0
    """Length of the silicone behind the clamp, which the clamp holds."""

    # A shell.
    rim_mm: Length = 6.0
    """Of the membrane beyond its opening: between frame and ring."""
    bead_mm: Length = 2.0
    """Width and height of the bead around the rim, which holds it in a groove of the frame."""
    cavity_mm: Length = 6.0
    """Depth of the air below the membrane."""
    ring_mm: Length = 2.0
    """Thickness of the ring that presses the rim on the frame."""

    # Printed parts.
    frame_mm: Length = 7.0
    """Width of printed borders that hold screws."""
    floor_mm: Length = 3.0
    """Thickness of the frame's floor and of the end cap."""
    port_mm: Length = 4.0
    """Outer diameter of the air tube."""
    screw_mm: Length = 3.2
    """Diameter of screw holes (M3)."""
    clearance_mm: Width = 0.2
    """Between printed parts, and between a printed part and what it holds."""

    # Moulds.
    mould_wall_mm: Length = 8.0
    """Beside the cavity."""
    mould_floor_mm: Length = 4.0
    """Below the cavity, and thickness of lids."""
    pin_mm: Length = 4.0
    """Diameter of alignment pins; they are as high as mould_floor_mm."""
    draft_deg: Annotated[float, pydantic.Field(ge=0, le=10, strict=False)] = 3.0
    """Of alignment pins. Walls of a cavity have none: silicone bends out of them, and they are as thick as asked."""
    pour_mm: Length = 4.0
    """Diameter of pour holes."""
    vent_mm: Length = 1.0
    """Diameter of vent holes."""
    shrinkage_percent: Annotated[float, pydantic.Field(ge=0, lt=10, strict=False)] = 0.1
    """Of the silicone as it cures; moulds are larger by 1/(1 - s). Smooth-On's data sheet of Dragon Skin 20 and 30 says
    less than 0.001 in/in."""

    # The silicone.
    density_g_per_cm3: Annotated[float, pydantic.Field(gt=0, le=25, strict=False)] = 1.08
    """Specific gravity 1.08 in Smooth-On's data sheet of Dragon Skin 20 and 30."""
    parts_a_to_b: Length = 1.0
    """Mass of part A over that of part B (1A:1B in the data sheet)."""
    spare_percent: Annotated[float, pydantic.Field(ge=0, le=200, strict=False)] = 15.0
    """What stays in cups, in pour holes and in vents."""

    # What printer and silicone can do.
    bed_mm: Annotated[list[Length], pydantic.Field(min_length=3, max_length=3)] = [220.0, 220.0, 250.0]
    """Of the printer: width, depth, height."""
    least_wall_mm: Length = 0.8
    """Of printed parts: two lines of a nozzle of 0.4 mm."""
    least_core_mm: Length = 1.0
    """Thickness of a core, and of the fins between chambers."""
    most_slender: Length = 15.0
    """Height of a core or a fin over its thickness."""
    least_silicone_mm: Length = 0.5
    """Of a wall that liquid silicone still fills."""
