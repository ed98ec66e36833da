"""Why a design has no answer, as a number per design and in words; and the rules that a scene's parts keep.

A rule is a margin in metres: positive where the rule is kept, negative by how much it is broken, differentiable, so
that it can be reported, constrained and climbed. What a scene's margins are called is the name of a `Reason` in small
letters: the margin "walls_fit" belongs to `Reason.WALLS_FIT`.
"""

from __future__ import annotations

import enum

import numpy as np

from .units import DISPLAY

FIRST_RULE = 100
"""Reasons from here on are rules."""
FIRST_RANGE = 200
"""Rules from here on say how far a law is known, and what can be moulded. Searches keep them; a state beyond has its
answer, with a remark."""

BROKEN = 1e-6
"""A rule counts as broken when its margin is below minus this (m): a thousandth of what a mould can hold, and far above
what rounding leaves of parts that just touch."""


class Reason(enum.IntEnum):
    """Why a design is not OK (NONE where it is).

    The numbers are fixed, since they are written into files. Those from 100 on are rules, with a margin in metres.

    Examples:
        >>> sg.Reason.WALLS_FIT.rule
        'walls_fit'
    """

    NONE = 0
    NOTHING_TOUCHED = 1
    LIMIT_POINT = 2
    LIMIT_BEFORE_CONTACT = 3
    MEMBRANE_USED_UP = 4
    MEMBRANE_COVERED = 5
    ARC_CLOSED = 6
    WALL_CLOSED = 7
    MATERIAL_LOCKED = 8
    LOAD_NOT_HELD = 9
    VALUE_NOT_REACHED = 10
    NO_EQUILIBRIUM = 11
    VALUE_PASSED = 12
    TIPS_APART = 13
    LOADS_AND_PRESSURE_NOT_HELD = 14
    CURLED_UP = 15
    INCLINED_WALL = 16
    SECTION_FULL = 17
    CELL_LAW_ENDS = 18
    RESIDUAL_TOO_LARGE = 20
    SHAPE_NOT_RESOLVED = 21
    ANOTHER_BRANCH = 22
    OBJECT_NOT_RESOLVED = 23
    VALUE_NOT_SOUGHT = 24
    VALUE_BEYOND_CELL_LAW = 25
    FIELD_RULE = 30
    PARTS_DO_NOT_FIT = 31
    PRESSURE_RULE = 32
    TIP_PULLS = 33

    WALLS_FIT = 100
    CHAMBER_ON_COVER = 101
    ONE_SEGMENT = 102
    CHAMBERS_APART = 103
    CLEAR_OF_CLAMP = 104
    CLEAR_OF_OBJECT_AT_REST = 105
    CLEAR_OF_OBJECT = 106
    CLEAR_OF_PALM = 107
    FINGERS_APART = 108
    FINGERS_APART_AT_REST = 109
    CLEAR_OF_GROUND = 110
    MEMBRANE_CLEAR_AT_REST = 111
    MEMBRANE_ABOVE_CLAMP = 112
    MEMBRANES_APART = 113
    CLEAR_OF_GROUND_AT_REST = 114
    TIP_IN_REACH = 120
    COVER_BEARS_PULL = 121

    CELL_LAW_RANGE = 200
    WALL_LAW_RANGE = 201
    MOULD_RANGE = 202
    ONE_TURN = 203

    @property
    def rule(self) -> str | None:
        """The name of the margin that the reason belongs to; None where it is no rule."""
        return self.name.lower() if self >= FIRST_RULE else None

    @property
    def forbids(self) -> bool:
        """Whether nothing that breaks the rule can exist."""
        return FIRST_RULE <= self < FIRST_RANGE

    def text(self, detail: float = np.nan) -> str:
        """One sentence for people; `detail` (SI) is the number that belongs to it, NaN where there is none."""
        kind, sentence, without = _SENTENCES[self]
        if np.isnan(detail) or not kind:
            return without
        label, unit = DISPLAY[kind]
        return sentence.format(f"{abs(detail) / unit:.4g} {label}".strip())


# Reason -> (kind of quantity of its detail, sentence with that number, sentence without it)
_SENTENCES: dict[Reason, tuple[str, str, str]] = {
    Reason.NONE: ("", "", "solved"),
    Reason.NOTHING_TOUCHED: (
        "pressure",
        "the pressure is too low: nothing is touched below {}, and the force is exactly zero",
        "the pressure is too low: nothing is touched yet, and the force is exactly zero",
    ),
    Reason.LIMIT_POINT: (
        "pressure",
        "no equilibrium: the pressure has its largest value, {}, at a limit point",
        "no equilibrium: the load is beyond the limit point",
    ),
    Reason.LIMIT_BEFORE_CONTACT: (
        "pressure",
        "no equilibrium: the free membrane reaches its largest pressure, {}, before it touches anything",
        "no equilibrium: the free membrane reaches its largest pressure before it touches anything",
    ),
    Reason.MEMBRANE_USED_UP: (
        "pressure",
        "no equilibrium: a straight part of the membrane is used up at {}",
        "no equilibrium: a straight part of the membrane is used up",
    ),
    Reason.MEMBRANE_COVERED: (
        "pressure",
        "no equilibrium: the contact reaches the edge of the membrane at {}",
        "no equilibrium: the contact reaches the edge of the membrane",
    ),
    Reason.ARC_CLOSED: (
        "pressure",
        "no equilibrium: the arcs of the membrane are closed at {}, where the model ends",
        "no equilibrium: the arcs of the membrane are closed, where the model ends",
    ),
    Reason.WALL_CLOSED: (
        "pressure",
        "no equilibrium: the arcs of the chamber walls are closed at {}, where the model of the chambers ends",
        "no equilibrium: the arcs of the chamber walls are closed, where the model of the chambers ends",
    ),
    Reason.MATERIAL_LOCKED: (
        "pressure",
        "no equilibrium: the material is stretched to its limit at {}",
        "no equilibrium: the material is stretched to its limit",
    ),
    Reason.LOAD_NOT_HELD: (
        "number",
        "the weight and the other loads cannot be held, with or without pressure: {} of them could be",
        "the weight and the other loads cannot be held, with or without pressure",
    ),
    Reason.VALUE_NOT_REACHED: (
        "pressure",
        "no pressure gives the wanted value: equilibrium ends at {} before it is reached",
        "no pressure gives the wanted value: equilibrium ends before it is reached",
    ),
    Reason.VALUE_BEYOND_CELL_LAW: (
        "pressure",
        "no pressure that is known gives the wanted value: the cell law of the finger ends at {} before it is reached",
        "no pressure that is known gives the wanted value: the cell law of the finger ends before it is reached",
    ),
    Reason.VALUE_PASSED: (
        "pressure",
        "no pressure gives the wanted value: it is passed already at {}, where the pressure begins to act",
        "no pressure gives the wanted value: it is passed before the pressure begins to act",
    ),
    Reason.TIPS_APART: (
        "force",
        "the tip does not press: it would have to be pulled with {} to stay where the object is, and the force is "
        "exactly zero",
        "the tip does not press, and the force is exactly zero",
    ),
    Reason.LOADS_AND_PRESSURE_NOT_HELD: (
        "number",
        "no equilibrium: of the loads and the pressure, which grow together, {} could be held",
        "no equilibrium: the loads and the pressure, which grow together, cannot be held",
    ),
    Reason.CURLED_UP: (
        "pressure",
        "no equilibrium that a finger could have: it has curled up by two full turns at {}, where the model ends",
        "no equilibrium that a finger could have: it would have curled up by more than two full turns",
    ),
    Reason.INCLINED_WALL: (
        "pressure",
        "no equilibrium: where the finger bends most the inclined walls of its chambers hold no more than {}",
        "no equilibrium: the inclined walls of the chambers hold no more where the finger bends most",
    ),
    Reason.SECTION_FULL: (
        "pressure",
        "no equilibrium: the cover carries no larger moment than that of the chambers at {}",
        "no equilibrium: the chambers' moment is larger than any that the cover carries",
    ),
    Reason.CELL_LAW_ENDS: (
        "pressure",
        "nothing is known: the cell law of the finger ends at {}",
        "nothing is known: the state is beyond the end of the finger's cell law",
    ),
    Reason.NO_EQUILIBRIUM: ("", "", "no equilibrium: the load is beyond the limit point or the end of the model"),
    Reason.RESIDUAL_TOO_LARGE: (
        "",
        "",
        "the solver stopped before the residual was small; the values are withheld",
    ),
    Reason.SHAPE_NOT_RESOLVED: (
        "",
        "",
        "the points along the beam are too few to tell its shape; the values are withheld: give more points",
    ),
    Reason.OBJECT_NOT_RESOLVED: (
        "",
        "",
        "a part of the object is behind the membrane: the contact points are too far apart for it; the values are "
        "withheld: give more polynomials (across, lengthwise), or a larger object",
    ),
    Reason.VALUE_NOT_SOUGHT: (
        "pressure",
        "no pressure up to {} gives the wanted value, and none above it was looked at",
        "no pressure that was looked at gives the wanted value",
    ),
    Reason.ANOTHER_BRANCH: (
        "",
        "",
        "the equations are solved, but by a state that is not on the branch connected to zero load; the values are "
        "withheld",
    ),
    Reason.FIELD_RULE: ("", "", "a dimension breaks its own rule, or is not a number"),
    Reason.PARTS_DO_NOT_FIT: ("", "", "the scene cannot exist: its parts do not fit together"),
    Reason.PRESSURE_RULE: ("", "", "the pressure or the wanted value is negative or not a finite number"),
    Reason.TIP_PULLS: (
        "force",
        "the tip would have to be pulled with {}: a tip presses or is free",
        "the tip would have to be pulled: a tip presses or is free",
    ),
    Reason.WALLS_FIT: ("length", "two walls of a chamber are {} too thick for its length", "the walls do not fit"),
    Reason.CHAMBER_ON_COVER: (
        "length",
        "a chamber is {} wider than the cover that carries it",
        "a chamber is wider than the cover that carries it",
    ),
    Reason.ONE_SEGMENT: (
        "length",
        "the finger is {} shorter than one segment",
        "the finger is shorter than one segment",
    ),
    Reason.CHAMBERS_APART: (
        "length",
        "neighbouring chambers overlap by {} where the finger bends backwards",
        "neighbouring chambers overlap where the finger bends backwards",
    ),
    Reason.CLEAR_OF_CLAMP: (
        "length",
        "the finger bends back by {} into the palm that it is clamped to",
        "the finger bends back into the palm that it is clamped to",
    ),
    Reason.CLEAR_OF_OBJECT_AT_REST: (
        "length",
        "the cover is {} inside the object at rest",
        "the cover is inside the object at rest",
    ),
    Reason.CLEAR_OF_OBJECT: (
        "length",
        "the bent cover is {} inside the object: one of its faces, or the edge of its end",
        "the bent cover is inside the object",
    ),
    Reason.CLEAR_OF_PALM: ("length", "the object is {} inside the palm", "the object is inside the palm"),
    Reason.TIP_IN_REACH: (
        "length",
        "the finger is {} too short for the place where its tip is held",
        "the finger is too short for the place where its tip is held",
    ),
    Reason.COVER_BEARS_PULL: (
        "length",
        "the pull at the tip stretches the cover to more than twice its length, {} longer than that",
        "the pull at the tip stretches the cover to more than twice its length",
    ),
    Reason.CELL_LAW_RANGE: (
        "length",
        "a dimension is {} outside of what the cell law was fitted to",
        "a dimension is outside of what the cell law was fitted to",
    ),
    Reason.WALL_LAW_RANGE: (
        "length",
        "a chamber's wall is {} too high for its width or too thick for its height: the laws of walls are not for that",
        "a chamber's wall is higher than wide or thick for its height: the laws of walls are not for that",
    ),
    Reason.MOULD_RANGE: (
        "length",
        "what is left of a chamber's air or side walls is {} less than a mould and liquid silicone can do",
        "what is left of a chamber's air or side walls is less than a mould and liquid silicone can do",
    ),
    Reason.FINGERS_APART: ("length", "neighbouring fingers overlap by {}", "neighbouring fingers overlap"),
    Reason.FINGERS_APART_AT_REST: (
        "length",
        "neighbouring fingers overlap by {} at rest",
        "neighbouring fingers overlap at rest",
    ),
    Reason.CLEAR_OF_GROUND: (
        "length",
        "the bent fingers reach {} below the plane that the object stands on",
        "the bent fingers reach below the plane that the object stands on",
    ),
    Reason.CLEAR_OF_GROUND_AT_REST: (
        "length",
        "the fingers reach {} below the plane that the object stands on",
        "the fingers reach below the plane that the object stands on",
    ),
    Reason.ONE_TURN: (
        "length",
        "the finger has curled by more than one turn, by {} of its length: it would lie on itself, as no law knows",
        "the finger has curled by more than one turn: it would lie on itself, as no law knows",
    ),
    Reason.MEMBRANE_CLEAR_AT_REST: (
        "length",
        "the flat membrane is {} inside the object at rest",
        "the flat membrane is inside the object at rest",
    ),
    Reason.MEMBRANE_ABOVE_CLAMP: (
        "length",
        "the membrane bulges {} too far back through the plane of its clamp",
        "the membrane bulges back through the plane of its clamp",
    ),
    Reason.MEMBRANES_APART: (
        "length",
        "the membranes of opposite shells pass through each other beside the cylinder: each is {} beyond the middle",
        "the membranes of opposite shells pass through each other beside the cylinder",
    ),
}

RULE_NAMES = tuple(reason.rule for reason in Reason if reason.rule)
"""The rules by name, as `Solution.margins` has them and `ignored_rules` takes them."""
