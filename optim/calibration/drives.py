"""The same curves explained by the other of the two laws that push a finger, and which of the two does it better.

The thesis's chambers and the cell law differ by a factor of about four in moment and tip force, nobody knows why
(`softgrip_jax.pneunet.drives`). Measured curves can say which of them a built finger follows: both are fitted to the
same data, and compared by the likelihood of what was measured.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from softgrip_jax.errors import InputError
from softgrip_jax.pneunet.drives import with_other_drive
from softgrip_jax.progress import Tell, silent
from softgrip_jax.results import in_units
from softgrip_jax.tables import Table

from .fit import Fit, calibrate
from .model import LEAST_NOISE, Fitting

TOLD_APART = 3.0
"""Difference of the logarithms of the likelihoods from which one law is called the better: 20 times as likely."""

FOLLOWED = 0.15
"""No law explains a curve that it misses by more than this part of the curve's range (RMS): a wrong unit or column does
as badly."""

NOISY = 2.0
"""Errors up to so many times a stated noise are the noise, however large a part of the range that is."""


def misses(fit: Any) -> dict[str, float]:
    """Of every fitted curve of a `Fit`: the RMS error as a part of the range of the points that were used, of the size
    of the curve where all are at one pressure or strain, whose range is that of the noise; 0 where that is the stated
    noise."""
    found = {}
    for k, curve in enumerate(fit.fitting.curves):
        if curve.fit:
            error, used = fit.rmse(k), fit.used[fit.fitting.of_curve == k]
            x, y = (curve.x[used], curve.y[used]) if used.any() else (curve.x, curve.y)
            is_noise = curve.noise is not None and error <= NOISY * curve.noise
            span = float(np.ptp(y)) if np.ptp(x) > 0 else 0.0
            found[curve.name] = 0.0 if is_noise else error / (span or curve.size)
    return found


class Rival(NamedTuple):
    """A fit, and that of the same curves by the other drive of the fingers."""

    fits: tuple[Fit, Fit]
    drives: tuple[str, str]
    likelihoods: tuple[float, float]
    """Natural logarithms, up to the same constant, over the points that both reach; of the one that reaches fewer
    points -inf."""
    lost: tuple[int, int] = (0, 0)
    """Fitted points without a state."""
    over_both: tuple[float, float] = (0.0, 0.0)
    """The likelihoods of both over the points that both reach."""

    @property
    def better(self) -> str | None:
        """The drive that explains the curves better; None where they do not tell the two apart."""
        one, other = self.likelihoods
        if one == other or abs(one - other) < TOLD_APART:
            return None
        return self.drives[int(other > one)]

    def misses(self, drive: str) -> dict[str, float]:
        """`misses` of the fit by a drive."""
        return misses(self.fits[self.drives.index(drive)])

    @property
    def nearer(self) -> str:
        """The better drive, or where there is none the one with the smaller errors."""
        if self.better is not None:
            return self.better
        worst = [np.nan_to_num(list(self.misses(drive).values()), nan=np.inf).max() for drive in self.drives]
        return self.drives[int(np.argmin(worst))]

    @property
    def explained(self) -> bool:
        """Whether the curves are followed by the nearer drive at all."""
        return all(share <= FOLLOWED for share in self.misses(self.nearer).values())

    def sentence(self) -> str:
        """Which law follows the curves, and what that rests on."""
        one, other = (fit.fitting.space for fit in self.fits)
        held = [
            f"by {drive!r} {' and '.join(space.names[j] for j in np.flatnonzero(fit.on_bound))} "
            f"{'ends' if np.sum(fit.on_bound) == 1 else 'end'} on a bound"
            for fit, drive, space in zip(self.fits, self.drives, (one, other), strict=True)
            if fit.on_bound.any()
        ]
        rests = f" ({'; '.join(held)})" if held else ""
        if not self.explained:
            missed = [
                f"the RMS error is {100 * share:.0f} % of the range of {name!r}"
                if np.isfinite(share)
                else f"{name!r} has no state"
                for name, share in self.misses(self.nearer).items()
                if share
            ]
            return (
                f"Neither the drive {self.drives[0]!r} nor {self.drives[1]!r} explains the curves: by {self.nearer!r}, "
                f"the nearer one, {' and '.join(missed)}{rests}; are the units and the columns right?"
            )
        over = "" if not min(self.lost) else " over the points that both reach"
        if self.better is None:
            return f"The curves do not tell the drives {self.drives[0]!r} and {self.drives[1]!r} apart{over}{rests}."
        gain = abs(self.likelihoods[0] - self.likelihoods[1])
        place = self.drives.index(self.better)
        worse = self.drives[1 - place]
        verb = "comes nearer to" if self.fits[place].on_bound.any() else "explains"
        if not np.isfinite(gain):
            some = "more points" if min(self.lost) else "some points"
            said = f"The drive {self.better!r} {verb} the curves; by {worse!r} {some} have no state{rests}."
            ahead = self.over_both[1 - place] - self.over_both[place]
            if ahead >= TOLD_APART:
                said += (
                    f" Over the points that both reach {worse!r} is the better (the logarithm of the likelihood is "
                    f"{ahead:.3g} larger): are the others measured right?"
                )
            return said
        than = f"than {worse!r}" if verb != "explains" else f"better than {worse!r}"
        return (
            f"The drive {self.better!r} {verb} the curves {than}: the logarithm of the likelihood is "
            f"{gain:.3g} larger{over}{rests}."
        )

    def table(self) -> Table:
        """Parameters and errors by both."""
        table = Table(title="both drives of the finger, fitted to the same curves", title_justify="left")
        table.add_column("", no_wrap=True)
        for drive in self.drives:
            table.add_column(f"drive {drive}", justify="right")
        first = self.fits[0]
        for j, (name, kind) in enumerate(zip(first.fitting.space.names, first.fitting.space.kinds, strict=True)):
            values = [in_units(fit.x[j], kind) + (" (bound)" if fit.on_bound[j] else "") for fit in self.fits]
            table.add_row(name, *values)
        for k, curve in enumerate(first.fitting.curves):
            errors = [fit.rmse(k) for fit in self.fits]
            words = [f"{in_units(float(f'{e:.3g}'), curve.kind)}{curve.share(e)}" for e in errors]
            table.add_row(f"RMS error of {curve.name}", *words)
        return table


def by_other_drive(fit: Fit, starts: int, seed: int, tell: Tell = silent) -> Rival | str | None:
    """The fit of the same curves by the other drive; a sentence where there is none, and None where no fitted curve is
    that of a finger with such a choice."""
    fitting = fit.fitting
    used = {curve.model for curve in fitting.curves if curve.fit}
    others = {name: other for name in used if (other := with_other_drive(fitting.given.scenes[name])) is not None}
    drives = {(fitting.given.scenes[name].drive, other.drive) for name, other in others.items()}
    if len(drives) != 1:
        return None
    tell("the same curves by the other drive")
    models = {name: others.get(name, model) for name, model in fitting.given.scenes.items()}
    try:
        second = calibrate(Fitting(models, fitting.given.variables, fitting.curves, fitting.loss), starts, seed)
    except InputError as error:
        return f"By the other drive the curves have no fit: {error}"
    return rival(fit, second, drives.pop())


def rival(fit: Any, second: Any, drives: tuple[str, str]) -> Rival:
    """Both `Fit`s with their likelihoods over the points that both reach; a point that only one of them reaches speaks
    against the other, and as many on either side cancel out."""
    used = np.isin(fit.fitting.of_curve, [k for k, curve in enumerate(fit.fitting.curves) if curve.fit])
    has = np.isfinite(fit.errors) & used, np.isfinite(second.errors) & used
    lost = int((used & ~has[0]).sum()), int((used & ~has[1]).sum())
    one, other = (likelihood(each, has[0] & has[1]) for each in (fit, second))
    return Rival(
        (fit, second),
        drives,
        (one if lost[0] <= lost[1] else -np.inf, other if lost[1] <= lost[0] else -np.inf),
        lost,
        (one, other),
    )


def likelihood(fit: Any, points: np.ndarray) -> float:
    """Logarithm of the likelihood of some of the points, without its constant.

    With n points of root mean square error e, a curve of the stated noise sigma adds -n e^2 / (2 sigma^2), one whose
    noise is estimated -n ln(e): normal errors, independent of each other.
    """
    total = 0.0
    for k, curve in enumerate(fit.fitting.curves):
        errors = fit.errors[(fit.fitting.of_curve == k) & points]
        if not errors.size:
            continue
        mean = float(np.mean(errors**2))
        if curve.noise is None:
            total -= 0.5 * len(errors) * np.log(max(mean, (LEAST_NOISE * curve.size) ** 2))
        else:
            total -= 0.5 * len(errors) * mean / curve.noise**2
    return total
