"""Input decks for Abaqus, CalculiX and FEBio: `bricks` says what stands in them, `deck_text` writes it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ..errors import InputError
from ..folders import write_whole
from . import deck_text
from .bricks import deck_of

FORMATS = ("abaqus", "calculix", "febio")


def write_deck(scene: Any, pressure: float, format: str, path: Path) -> None:
    """Write the input deck of a scene's finite elements.

    Args:
        scene: of a shell, or a uniform finger: its cell, straight; bent where the scene is a `pneunet.Cell` that is.
        pressure: gauge pressure, Pa.
        format: "abaqus", "calculix" or "febio".
        path: of the file.

    Raises:
        InputError: for another format, a scene without a deck, and a material that the program has no law for.
    """
    if format not in FORMATS:
        raise InputError(f"the deck is for {format!r}; it must be one of {', '.join(FORMATS)}.")
    write = deck_text.febio if format == "febio" else deck_text.abaqus
    write_whole(path, write(deck_of(scene, pressure), format).encode())
