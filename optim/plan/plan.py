"""What a plan is made of: derivatives of every candidate at draws of the numbers, the choice, and what it is worth."""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from scipy import stats
from scipy.stats import qmc

from softgrip_jax.draws import other_laws, read_draws
from softgrip_jax.errors import ConfigError, InputError
from softgrip_jax.numerics.xla import traced_once
from softgrip_jax.progress import Tell, silent
from softgrip_jax.results import NORMAL_95

from ..calibration.identifiability import HELPFUL, TAKES_PART, UNKNOWN, combination, directions
from .decision import LEAST_SHARE, Verdict, decided, verdict
from .information import Candidates, choose, evenly
from .settings import Settings

MOST_EXACT = 1e9
"""A measured value over its noise: nobody measures better."""
BLIND = 1e3
"""Relative standard deviation of what nothing is known of: large, and safe to invert."""


@dataclasses.dataclass(frozen=True)
class Open:
    """Numbers that one measurement alone leaves open, however often it is made."""

    measurement: str
    """Empty for all of them together."""
    names: tuple[str, ...]
    combination: str
    """What it does determine, in words; empty where one number is left open by itself."""
    remedies: tuple[tuple[str, int, float], ...]
    """(measurement, how many of it, their cost), the cheapest first."""

    def sentence(self) -> str:
        """The verdict for people."""
        who = f"{self.measurement} alone" if self.measurement else "All that can be measured here, together,"
        if len(self.names) > 1:
            what = f"cannot tell {' and '.join(self.names)} apart: it determines only {self.combination}"
        else:
            what = f"does not determine {' and '.join(self.names)}"
        for name, count, cost in self.remedies:
            return f"{who} {what}. The cheapest here that does: {name} ({count} of it, cost {cost:g})."
        return f"{who} {what}. What would: measuring {'one of them' if len(self.names) > 1 else 'it'} itself."


@dataclasses.dataclass(frozen=True)
class Plan:
    """Measurements that were chosen, and what they are worth."""

    settings: Settings
    candidates: Candidates
    of: np.ndarray
    """The measurement of every candidate."""
    x: np.ndarray
    """Its pressure (Pa) or strain; NaN for a number itself."""
    values: np.ndarray
    """What is expected to be measured, SI, shape (draws, candidates); NaN where a draw has no state."""
    shares: np.ndarray
    """Of the draws that have a state, for every candidate."""
    chosen: list[int]
    evenly: dict[str, list[int]]
    """By measurement: as many of it alone, evenly spaced."""
    open: tuple[Open, ...]
    verdict: Verdict | None
    remarks: tuple[str, ...] = ()
    """Of which laws the numbers of the posterior are, where these scenes have others."""

    def half_widths(self, chosen: list[int]) -> np.ndarray:
        """Half of the 95 % interval of every number after measuring these, relative, shape (n,)."""
        variances = np.einsum("mjj->mj", self.candidates.covariance(chosen))
        return NORMAL_95 * np.sqrt(np.mean(variances, axis=0))

    def steps(self) -> np.ndarray:
        """The half widths before and after each measurement, shape (chosen + 1, n)."""
        return np.stack([self.half_widths(self.chosen[:k]) for k in range(len(self.chosen) + 1)])

    @property
    def left_out(self) -> list[int]:
        """Candidates that too many draws have no state for."""
        return [int(k) for k in np.flatnonzero(self.shares < LEAST_SHARE)]


def make(settings: Settings, tell: Tell = silent) -> Plan:
    """Choose the measurements.

    Args:
        settings: the section [plan].
        tell: told of every stage.

    Raises:
        InputError: where nothing that could be measured depends on the numbers.
    """
    table, fitting = settings.table, settings.fitting
    reference = np.asarray(fitting.space.reference)
    draws, prior, remarks = _known(settings, reference)
    tell("compiling once, then every candidate at every draw")
    program = traced_once(jax.vmap(fitting.predict_with_slopes, in_axes=(0, None)))
    everywhere = np.concatenate([reference[None], draws])
    predicted = jax.tree.map(np.asarray, program(jnp.asarray(everywhere), fitting.points()))
    rows, values, known, of, x = [], [], [], [], []
    start = 0
    for k, one in enumerate(settings.measurements):
        if one.curve is None:
            row = np.zeros((len(everywhere), 1, len(reference)))
            unit = one.table.noise * settings.factor(one)
            row[:, 0, one.index] = everywhere[:, one.index] / unit
            rows.append(row)
            values.append(everywhere[:, [one.index]])
            known.append(np.ones((len(everywhere), 1), bool))
            x.append(np.array([np.nan]))
        else:
            place = slice(start, start + len(one.curve.x))
            start = place.stop
            rows.append(predicted.slopes[:, place] * everywhere[:, None, :] / one.curve.noise)
            known.append(predicted.response.ok[:, place])
            values.append(np.where(known[-1], predicted.response.values[:, place], np.nan))
            x.append(one.curve.x)
        of.append(np.full(len(x[-1]), k))
    for one, row, good in zip(settings.measurements, rows, known, strict=True):
        most = float(np.max(np.abs(np.where(good[..., None], row, 0.0)), initial=0.0))
        if most > MOST_EXACT:
            raise InputError(
                f"{one.table.name}: the noise is {one.table.noise:g} {one.table.unit}, {1 / most:.0e} of what is "
                f"measured; it must be at least {1 / MOST_EXACT:g} of that."
            )
    ok = np.concatenate(known, axis=1)
    row = np.where(ok[..., None], np.concatenate(rows, axis=1), 0.0)
    place = np.concatenate(of)
    shares = ok[1:].mean(axis=0)
    repeats = np.array([settings.measurements[k].table.repeats for k in place])
    costs = np.array([settings.measurements[k].table.cost for k in place])
    about = None if settings.decision is None else decided(settings, settings.decision, draws, tell)
    most = np.where(shares < LEAST_SHARE, 0, repeats)
    given = Candidates(row[1:], costs, most, prior, None if about is None else about.slopes)
    if not np.any(row):
        raise InputError("Nothing that could be measured has a state and depends on the numbers of the plan.")
    tell("choosing")
    chosen = choose(given, settings.criterion, table.points, table.budget or np.inf)
    if not chosen:
        raise InputError(
            "No measurement can be chosen: each costs more than the budget, tells nothing, or has no state for "
            "more than a tenth of the draws."
        )
    spaced = {
        one.table.name: evenly(group, len(chosen))
        for k, one in enumerate(settings.measurements)
        for group in [np.flatnonzero((place == k) & (most > 0))]
        if len(group) > 1
    }
    plan = Plan(
        settings,
        given,
        place,
        np.concatenate(x),
        np.concatenate(values, axis=1)[1:],
        shares,
        chosen,
        spaced,
        _open(settings, np.where((most > 0)[:, None], row[0], 0.0), place, costs, most),
        None,
        remarks,
    )
    if about is None or settings.decision is None:
        return plan
    return dataclasses.replace(plan, verdict=verdict(about, settings.decision, prior, given.covariance(chosen)))


def _known(settings: Settings, reference: np.ndarray) -> tuple[np.ndarray, np.ndarray, tuple[str, ...]]:
    """(draws of the numbers in SI, the covariance of their logarithms, what is to be said of them)."""
    table = settings.table
    if settings.spreads is not None:
        points = qmc.Sobol(len(reference), rng=table.seed).random(table.draws)
        normal = stats.norm.ppf(np.clip(points, 1e-6, 1 - 1e-6))
        draws = reference * np.exp(settings.spreads * (normal if table.draws > 1 else 0 * normal))
        return draws, np.diag(settings.spreads**2), ()
    path = settings.folder / str(table.posterior)
    found = {one.number.name: one for one in read_draws(settings.scenes, path, settings.where)}
    missing = [number.key for number in settings.numbers if number.name not in found]
    if missing:
        raise ConfigError(f"{settings.where}: the posterior {str(path)!r} says nothing of {' and '.join(missing)}.")
    drawn = [found[number.name] for number in settings.numbers]
    whole = np.stack([one.values for one in drawn], axis=1)
    if np.any(whole <= 0):
        raise ConfigError(
            f"{settings.where}: the posterior {str(path)!r} has draws at or below zero; a plan needs logarithms."
        )
    covariance = np.atleast_2d(np.cov(np.log(whole), rowvar=False))
    evenly_taken = np.unique(np.linspace(0, len(whole) - 1, min(table.draws, len(whole))).astype(int))
    return whole[evenly_taken], covariance, tuple(other_laws(settings.scenes, drawn))


# --- what cannot be told apart ----------------------------------------------------------------------------------------


def _open(
    settings: Settings, rows: np.ndarray, of: np.ndarray, costs: np.ndarray, most: np.ndarray
) -> tuple[Open, ...]:
    """What every measurement alone, and all together, leave open, by the derivatives where the config is."""
    names = [number.key for number in settings.numbers]
    found = []
    for k, one in enumerate(settings.measurements):
        own = rows[of == k]
        if one.curve is not None and np.any(own):
            found += [
                Open(one.table.name, *words, _remedies(settings, rows, of, costs, most, k, direction))
                for direction, words in _unknown(names, own)
            ]
    together = [Open("", *words, ()) for _, words in _unknown(names, rows)]
    return (*found, *together)


def _unknown(names: list[str], rows: np.ndarray) -> list[tuple[np.ndarray, tuple[tuple[str, ...], str]]]:
    """Directions that rows leave open, each with the numbers that take part and what is determined, in words."""
    s, v = directions(rows)
    found = []
    for k in np.flatnonzero(s < 1 / UNKNOWN):
        direction = v[k] / v[k][np.argmax(np.abs(v[k]))]
        part = np.flatnonzero(np.abs(direction) > TAKES_PART)
        taking = tuple(names[j] for j in part)
        words = combination(taking, direction[part]) if len(part) > 1 else ""
        found.append((v[k], (taking, words)))
    return found


def _told(C: np.ndarray, row: np.ndarray) -> np.ndarray:
    """The covariance after a measurement of noise 1 with this row: (C^-1 + row row^T)^-1."""
    moved = C @ row
    return C - np.outer(moved, moved) / (1 + row @ moved)


def _remedies(
    settings: Settings,
    rows: np.ndarray,
    of: np.ndarray,
    costs: np.ndarray,
    most: np.ndarray,
    k: int,
    direction: np.ndarray,
) -> tuple[tuple[str, int, float], ...]:
    """The other measurements that determine a direction together with the k-th, the cheapest first; each point of them
    as often as it may be measured."""
    found = []
    own = rows[of == k]
    for other, one in enumerate(settings.measurements):
        added = rows[of == other]
        if other == k or not np.any(added):
            continue
        # By one row after the other: with small noises the sum of their squares could not be inverted.
        C = BLIND**2 * np.eye(len(direction))
        for row in own:
            C = _told(C, row)
        left = most[of == other].copy()
        for count in range(1, int(left.sum()) + 1):
            moved = added @ C
            told = (moved @ direction) ** 2 / (1 + np.einsum("ij,ij->i", moved, added))
            best = int(np.argmax(np.where(left > 0, told, -1.0)))
            left[best] -= 1
            C = _told(C, added[best])
            if np.sqrt(max(direction @ C @ direction, 0.0)) < HELPFUL:
                found.append((one.table.name, count, count * float(costs[of == other][0])))
                break
    return tuple(sorted(found, key=lambda remedy: remedy[2]))
