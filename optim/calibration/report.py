"""What a fit says to people: tables of parameters and curves, and sentences about how far to trust them."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from rich.console import Console
from scipy import stats

from softgrip_jax.pneunet.drives import sentence_of, with_other_drive
from softgrip_jax.progress import Tell, silent
from softgrip_jax.results import in_units
from softgrip_jax.spread import Spread
from softgrip_jax.tables import Table
from softgrip_jax.units import DISPLAY

from .cross_validation import UNLIKELY, Specimens, by_specimen, held_out
from .data import rounded
from .drives import FOLLOWED, Rival, by_other_drive, misses
from .fit import Fit, implausible
from .identifiability import Direction, unknown_directions
from .intervals import Intervals, intervals
from .systematic import SYSTEMATIC, SYSTEMATIC_POINTS, autocorrelation, offset

NOT_DETERMINED = 3.0
"""An interval that spans more than e^3 = 20 fold each way (log parameters; three ranges of linear ones) is none."""

CORRELATED = 0.95
"""Parameters more correlated than this are named."""

WORDS = {"gauss_newton": "95 % interval", "bootstrap": "95 %, bootstrap", "profile": "95 %, profile"}

AT_THE_END = 0.998
"""A point at more than this part of the limit pressure holds the fit: the slopes there are those of the end."""

STOPPED = "Stopped after the fit: the checks that are not reported here were not done."

ROUNDING = 1e-5
"""Errors below this part of the largest value of a curve are rounding of its numbers or of the solver: no measurement
is as good, and whether they go together says nothing."""


@dataclasses.dataclass(frozen=True)
class Findings:
    """All that is told of a fit."""

    fit: Fit
    intervals: tuple[Intervals, ...]
    held_out: Mapping[str, tuple[np.ndarray, float]]
    specimens: Specimens | None
    directions: tuple[Direction, ...]
    remarks: tuple[str, ...]
    """In sentences: what was left out, what looks odd, how far to trust it."""
    stopped: bool = False
    """By Ctrl-C: what was not looked at until then is missing."""
    rival: Rival | None = None
    """The same curves by the other drive of their finger."""


def examine(
    fit: Fit,
    methods: Sequence[str],
    repeats: int,
    seed: int,
    report: Tell = silent,
    spread: Spread | None = None,
) -> Findings:
    """Intervals, held-out errors, specimens and verdicts of a fit.

    Ctrl-C ends it with what was found until then, the fit at least; `report` is told of every stage.
    """
    found: list[Intervals] = []
    without, specimens = {}, None
    try:
        report("what the data determine")
        directions = unknown_directions(fit)
        for method in methods:
            found.append(intervals(fit, method, repeats, seed, report, spread))
        report("every curve and specimen apart")
        without, specimens = held_out(fit), by_specimen(fit)
    except KeyboardInterrupt:
        return Findings(fit, tuple(found), without, specimens, (), (*fit.notes, STOPPED), stopped=True)
    remarks = [note for curve in fit.fitting.curves for note in curve.notes]
    remarks += [*implausible(fit.fitting), *fit.notes, *(note for one in found for note in one.notes)]
    held, correlated = [*on_bounds(fit), *at_the_end(fit)], _correlated(fit, directions)
    remarks += [*held, *misfit(fit), *correlated, *spread_of_specimens(fit, specimens)]
    remarks += [direction.sentence() for direction in directions]
    open_ended = any(not np.all(np.isfinite([one.low, one.high])) for one in found)
    mostly_lost = 2 * int(fit.used.sum()) < int(np.sum(fit.fitting.weight))
    if not (directions or held or correlated or open_ended or mostly_lost):
        remarks.append(
            "The data determine every parameter." if fit.fitting.space.size > 1 else "The data determine the parameter."
        )
    return Findings(fit, tuple(found), without, specimens, tuple(directions), tuple(dict.fromkeys(remarks)))


def with_rival(findings: Findings, starts: int, seed: int, tell: Tell = silent) -> Findings:
    """With the fit by the other drive, where the curves are those of a finger; Ctrl-C leaves it out."""
    try:
        rival = by_other_drive(findings.fit, starts, seed, tell)
    except KeyboardInterrupt:
        return dataclasses.replace(findings, remarks=(*findings.remarks, STOPPED), stopped=True)
    if rival is None:
        return findings
    said = (rival,) if isinstance(rival, str) else (rival.sentence(), sentence_of(rival.drives[0]))
    found = None if isinstance(rival, str) else rival
    return dataclasses.replace(findings, rival=found, remarks=(*findings.remarks, *said))


def report(findings: Findings, console: Console) -> None:
    """Print it."""
    fit = findings.fit
    console.print(parameter_table(findings))
    console.print(curve_table(findings))
    space = fit.fitting.space
    if space.size > 1 and not findings.directions:
        pairs = [
            f"{space.names[i]} with {space.names[j]} {fit.correlation[i, j]:+.2f}"
            for i in range(space.size)
            for j in range(i)
        ]
        console.print(f"Correlations: {', '.join(pairs)}.", soft_wrap=True)
    if findings.rival is not None:
        console.print(findings.rival.table())
    for remark in findings.remarks:
        console.print(remark, soft_wrap=True, highlight=False)


def parameter_table(findings: Findings) -> Table:
    """Start, fit and intervals."""
    fit, space = findings.fit, findings.fit.fitting.space
    table = Table(title="parameters", title_justify="left")
    for heading in ("", "start", "fit", *(WORDS[i.method] for i in findings.intervals)):
        table.add_column(heading, justify="right" if heading else "left", no_wrap=not heading)
    for j, (name, kind) in enumerate(zip(space.names, space.kinds, strict=True)):
        ends = [interval_text(fit, one, j) for one in findings.intervals]
        table.add_row(name, in_units(space.reference[j], kind), in_units(fit.x[j], kind), *ends)
    return table


def interval_text(fit: Fit, one: Intervals, j: int) -> str:
    """'170.2 to 178.1 kPa', or why there is none."""
    if fit.on_bound[j] and one.method == "gauss_newton":
        return "on its bound"
    if not is_determined(fit, j):
        return "not determined"
    label, unit = DISPLAY[fit.fitting.space.kinds[j]]
    low, high = (f"{end / unit:.5g}" if np.isfinite(end) else "open" for end in (one.low[j], one.high[j]))
    return f"{low} to {high} {label}".strip()


def is_determined(fit: Fit, j: int) -> bool:
    """Whether the interval of a parameter says anything."""
    return bool(fit.quantile[j] * fit.deviation[j] < NOT_DETERMINED)


def curve_table(findings: Findings) -> Table:
    """How well each curve is met."""
    fit = findings.fit
    table = Table(title="curves", title_justify="left")
    for heading in ("", "points", "noise", "RMS error", *(["when kept out"] if findings.held_out else [])):
        table.add_column(heading, justify="right" if heading else "left", no_wrap=not heading)
    for k, curve in enumerate(fit.fitting.curves):
        used = int((fit.used & (fit.fitting.of_curve == k)).sum())
        sigma = f"{rounded(float(fit.member.sigma[k]), curve.kind)} {'(stated)' if curve.noise else ''}".strip()
        row = [curve.name, f"{used} of {len(curve.x)}" if curve.fit else "predicted", sigma if curve.fit else "-"]
        row.append(f"{rounded(fit.rmse(k), curve.kind)}{curve.share(fit.rmse(k))}")
        if findings.held_out:
            without = findings.held_out.get(curve.name)
            row.append("-" if without is None else rounded(without[1], curve.kind))
        table.add_row(*row)
    return table


# --- verdicts ---------------------------------------------------------------------------------------------------------


def on_bounds(fit: Fit) -> list[str]:
    """A sentence about each parameter that a bound holds."""
    space = fit.fitting.space
    held = [space.names[j] for j in np.flatnonzero(fit.on_bound)]
    return [f"{name} is held by a bound: widen it, or ask whether the model or a unit is wrong." for name in held]


def at_the_end(fit: Fit) -> list[str]:
    """A sentence for each curve with a point next to where the model ends: a little softer, and it is lost, so that no
    fit goes on from there, whether or not a better one lies beyond."""
    share, said = np.asarray(fit.predicted.response.share), []
    for k, curve in enumerate(fit.fitting.curves):
        held = fit.used & (fit.fitting.of_curve == k) & (share > AT_THE_END)
        if held.any():
            there = in_units(fit.fitting.x[held].max(), "pressure")
            said.append(
                f"{curve.name}: the model of the fit ends just above {there}, "
                "where there is a point: that holds the fit, so the interval says too little, and starts elsewhere may "
                "find a better one."
            )
    return said


def misfit(fit: Fit) -> list[str]:
    """Sentences about curves that the model does not follow to within their noise."""
    said, missed = [], misses(fit)
    for k, curve in enumerate(fit.fitting.curves):
        count = int((fit.used & (fit.fitting.of_curve == k)).sum())
        if not curve.fit or count == 0:
            continue
        share = missed[curve.name]
        # Of a finger, whose other drive may explain the curve, the comparison of the two says it.
        if share > FOLLOWED and with_other_drive(fit.fitting.given.scenes[curve.model]) is None:
            said.append(
                f"{curve.name}: the RMS error is {100 * share:.0f} % of the range of the curve, so the model does not "
                "follow it; are the units and the columns right?"
            )
        if curve.noise is not None and fit.fitting.loss == "linear":
            mean = fit.chi_square(k)
            if stats.chi2.sf(mean * count, max(fit.freedoms[k], 1.0)) < UNLIKELY:
                said.append(
                    f"{curve.name}: the errors are {np.sqrt(mean):.2g} times the stated noise, so the model does not "
                    "follow the curve to within it; the intervals, which take the model as right, are too narrow."
                )
        is_rounding = fit.rmse(k) < ROUNDING * curve.size
        sentence = None if is_rounding else offset(fit, k)
        if sentence is not None:
            said.append(sentence)
        elif count >= SYSTEMATIC_POINTS and not is_rounding and autocorrelation(fit, k) > SYSTEMATIC:
            said.append(
                f"{curve.name}: the errors of neighbouring points go together (correlation "
                f"{autocorrelation(fit, k):.2f}): they are the model's rather than noise, and the intervals, which "
                "know of noise alone, are too narrow."
            )
    return said


def _correlated(fit: Fit, directions: Sequence[Direction]) -> list[str]:
    space, apart = fit.fitting.space, {name for d in directions for name in d.names}
    return [
        f"{space.names[i]} and {space.names[j]} are strongly correlated ({fit.correlation[i, j]:+.3f}): the data "
        "determine a combination of them much better than either of them; quote both with their correlation."
        for i in range(space.size)
        for j in range(i)
        if abs(fit.correlation[i, j]) > CORRELATED and not {space.names[i], space.names[j]} <= apart
    ]


class OverSpecimens(NamedTuple):
    """What the specimens' own values of one parameter say."""

    values: str
    """Each with the name of its specimen."""
    differ: bool
    """By more than the noise explains."""
    test: str
    low: float
    """95 % interval of their mean, SI, cut at the bounds of the parameter, beyond which it cannot be."""
    high: float
    ends: str
    cut: int
    """Ends that are bounds: both where so few specimens tell nothing of their mean."""

    @property
    def is_to_quote(self) -> bool:
        """Whether the interval of the mean is the one to quote."""
        return self.differ and self.cut < 2


def over_specimens(fit: Fit, specimens: Specimens, j: int) -> OverSpecimens | None:
    """Of parameter j; None where no curve of a specimen depends on it."""
    space, values = fit.fitting.space, specimens.x[:, j]
    if np.ptp(values) <= 1e-6 * abs(fit.x[j]):
        return None
    kind, chance = space.kinds[j], float(specimens.chance[j])
    words = ", ".join(f"{one} {in_units(x, kind)}" for one, x in zip(specimens.names, values, strict=True))
    low, high = max(specimens.low[j], space.low[j]), min(specimens.high[j], space.high[j])
    is_cut = bool(specimens.low[j] < space.low[j]), bool(specimens.high[j] > space.high[j])
    ends = [in_units(end, kind) + " (its bound)" * cut for end, cut in zip((low, high), is_cut, strict=True)]
    return OverSpecimens(
        words,
        bool(specimens.differ[j]),
        f"Cochran's test, p {_probability(chance)}",
        float(low),
        float(high),
        " to ".join(ends),
        sum(is_cut),
    )


SMALLEST = 1e-6
"""Smaller probabilities are not told apart."""


def _probability(p: float) -> str:
    return f"= {p:.2g}" if p >= SMALLEST else f"< {SMALLEST:g}"


def spread_of_specimens(fit: Fit, specimens: Specimens | None) -> list[str]:
    """A sentence about each parameter: its values by specimen, whether they differ, and which interval is to quote."""
    if specimens is None:
        return []
    said = []
    for j, name in enumerate(fit.fitting.space.names):
        found = over_specimens(fit, specimens, j)
        if found is None:
            continue
        if not found.differ:
            verdict = f"they agree within the noise ({found.test})"
            verdict += ", taken alone" if specimens.differ_together else ", and the fit to all of them stands"
            # Of three such 90 % pass the test, and the fit's 95 % interval holds the mean in 83 % of these.
            if found.cut < 2 and not specimens.differ_together:
                verdict += (
                    "; the test does not see specimens that differ by no more than each is uncertain, which this "
                    f"interval allows for: {found.ends} (95 %, their mean)"
                )
        else:
            verdict = f"they differ by more than the noise explains ({found.test}), "
            verdict += (
                f"so that the 95 % interval of their mean is the one to quote: {found.ends}"
                if found.is_to_quote
                else f"and the 95 % interval of their mean has no end within the bounds: {len(specimens.names)} "
                "specimens are too few to tell it"
            )
        said.append(f"{name} by specimen: {found.values}; {verdict}.")
    if said and specimens.differ_together:
        said.append(
            "The specimens differ by more than the noise explains (all parameters together, p "
            f"{_probability(specimens.chance_together)}), though no parameter alone does: the intervals of the fit, "
            "which know of noise alone, are too narrow."
        )
    return said
