"""The rules that every design of a search keeps: which there are, what they make of a status, what is said of them.

Within a search the scenes are solved with all their rules ignored, so that values and derivatives exist on both sides
of a rule, and every margin becomes a constraint, margin >= 0. A design is reported as the scenes see it with their
rules on: one that breaks a rule is IMPOSSIBLE, but for the range that a law is known for (`reasons.FIRST_RANGE`), which
the search alone keeps.
"""

from __future__ import annotations

import dataclasses
import difflib
from collections.abc import Iterable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from softgrip_jax.errors import InputError
from softgrip_jax.quantities import (
    AT_REST,
    MARGINS,
    Observed,
    Quantity,
    State,
    all_rules,
    margins_at_rest,
    rules_at_rest,
)
from softgrip_jax.reasons import BROKEN, RULE_NAMES, Reason
from softgrip_jax.results import Status
from softgrip_jax.scene import Scene, with_rules
from softgrip_jax.units import mm

SCALE = 1 * mm
"""What makes a margin a pure number: the size of the walls and gaps that the rules are about."""


def require_rules(names: Iterable[str]) -> tuple[str, ...]:
    """Names of rules, or a ValueError that names the first one that is none."""
    names = (names,) if isinstance(names, str) else tuple(names)
    for name in names:
        if name not in RULE_NAMES:
            close = difflib.get_close_matches(name, RULE_NAMES, 1)
            words = f"did you mean {close[0]!r}?" if close else f"there are {', '.join(RULE_NAMES)}."
            raise InputError(f"ignore_rules has {name!r}, which is no rule; {words}")
    return names


def without_rules(scenes: dict[str, Scene]) -> dict[str, Scene]:
    """The scenes with all rules ignored: their margins are reported all the same."""
    return {name: dataclasses.replace(scene, ignored_rules=RULE_NAMES) for name, scene in scenes.items()}


def ignoring(scenes: dict[str, Scene], names: tuple[str, ...]) -> dict[str, Scene]:
    """The scenes with these rules ignored beside those that they ignore themselves."""
    return {
        name: dataclasses.replace(scene, ignored_rules=tuple(dict.fromkeys((*scene.ignored_rules, *names))))
        for name, scene in scenes.items()
    }


def rules_of(scenes: dict[str, Scene], states: Iterable[tuple[str, State]]) -> list[Quantity]:
    """The margins of all scenes at rest, and of the states that are asked for."""
    rules = [Quantity(MARGINS + rule, AT_REST, name) for name, scene in scenes.items() for rule in rules_at_rest(scene)]
    known = {(q.scene, q.rule) for q in rules}
    for name, at in states:
        if at is not None and at != AT_REST:
            bent = [rule for rule in all_rules(scenes[name]) if (name, rule) not in known]
            rules += [Quantity(MARGINS + rule, at, name) for rule in bent]
    return rules


def is_held(scene: Scene, rule: Quantity) -> bool:
    """Whether a search keeps a rule that begins with this scene. One whose parts are outside of what a law is known for
    at the beginning is not held there: its report says what is outside. States are always held."""
    with jax.ensure_compile_time_eval():  # whoever asks within a jitted function wants numbers, too
        margin = margins_at_rest(scene).get(str(rule.rule))
    return Reason[str(rule.rule).upper()].forbids or margin is None or float(margin) >= -BROKEN


def with_rules_on(
    found: Observed, states: Sequence[tuple[str, State]], rules: Sequence[Quantity], margins: Float[Array, " r"]
) -> Observed:
    """`found` as scenes report it whose rules are on: a state that breaks one is IMPOSSIBLE (`scene.with_rules`)."""
    seen = []
    for *of_state, state in zip(found.statuses, found.reasons, found.details, states, strict=True):
        status, reason, _ = of_state
        is_open = (status == Status.OK) | ((status == Status.IMPOSSIBLE) & (reason == Reason.PARTS_DO_NOT_FIT))
        own = [
            (str(rule.rule), margin)
            for rule, margin in zip(rules, margins, strict=True)
            if rule.state in (state, (state[0], AT_REST))
        ]
        seen.append(with_rules(own, is_open, *of_state))
    statuses, reasons, details = (jnp.stack(column) for column in zip(*seen, strict=True))
    return found._replace(statuses=statuses, reasons=reasons, details=details)


def label(rule: Quantity, several: bool) -> str:
    """'rule walls_fit', 'rule free.chambers_apart at 31 kPa'."""
    return f"rule {rule.label(several).replace(MARGINS, '')}"


def words(margin: float) -> str:
    """A margin for people: 'broken by 5.5 mm', 'on it', 'room 0.31 mm'."""
    if not np.isfinite(margin):
        return "-"
    if margin < -BROKEN:
        return f"broken by {-margin / mm:.3g} mm"
    return "on it" if margin < BROKEN else f"room {margin / mm:.3g} mm"


def is_told(margin: Any) -> np.ndarray:
    """True for margins that are worth a word: broken, or within BROKEN of it."""
    return np.asarray(margin) < BROKEN


@dataclasses.dataclass(frozen=True)
class Told:
    """One line of a report: a rule, and its margin (m) in several designs."""

    label: str
    margins: tuple[float, ...]


def summary(rules: Sequence[Quantity], margins: Sequence[np.ndarray], several: bool) -> list[Told]:
    """The rules that any of some designs breaks or is held by; one line for scenes in which a rule says the same.

    margins: of every design, in the order of `rules`.
    """
    lines: dict[tuple[Any, ...], list[Quantity]] = {}
    for k, rule in enumerate(rules):
        seen = tuple(float(design[k]) for design in margins)
        if any(is_told(seen)):
            lines.setdefault((rule.rule, rule.at, seen), []).append(rule)
    return [Told(label(same[0], several and len(same) == 1), seen) for (_, _, seen), same in lines.items()]


def kept(rules: Sequence[Quantity]) -> list[str]:
    """The names of rules, each once."""
    return [name for name in RULE_NAMES if name in {rule.rule for rule in rules}]
