"""`softgrip evidence RUN RUN ...`: which of several models, calibrated to the same data, predicts it best.

The score of a run is the sum of its leave-one-out scores (see `optim.posterior.evidence`). Two runs are compared point
by point: the difference of their sums has the standard error sqrt(n) sd(elpd_i - elpd'_i). A difference below 4 says
nothing whatever its error (Sivula et al. 2020); from there on twice its error is asked for.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from softgrip_jax.errors import ConfigError
from softgrip_jax.tables import Table

from .evidence import ROUGH, difference
from .posterior import Posterior
from .write import FILE, number

LEAST, ERRORS = 4.0, 2.0
"""A difference of scores that tells: at least so much, and so many of its standard errors."""
COMMON = 0.5
"""Runs that share fewer of their points are not about the same data."""


@dataclasses.dataclass(frozen=True)
class Run:
    """The scores of one run."""

    name: str
    points: tuple[tuple[str, float, float], ...]
    """(curve, x, y) of every point, SI."""
    elpd: np.ndarray
    shape: np.ndarray
    errors: dict[str, tuple[float, float, float]]
    """Of every curve: ends of the 95 % interval, and in the middle the median, of the model's error."""
    usable: bool


def read_run(path: Path, name: str) -> Run:
    """The scores of a run's folder, or of its posterior.nc."""
    import xarray as xr

    file = path / FILE if path.is_dir() else path
    if not file.is_file():
        raise ConfigError(f"{path} holds no {FILE}; make one with softgrip calibrate CONFIG --posterior.")
    try:
        with xr.open_dataset(file, group="evidence", engine="h5netcdf") as data:
            columns = {key: np.array(data[key].values) for key in ("elpd", "pareto_k", "y", "x", "curve")}
        with xr.open_dataset(file, group="posterior", engine="h5netcdf") as data:
            usable = bool(int(data.attrs.get("usable", 1)))
            errors = {
                str(key).removeprefix(ERROR): tuple(float(v) for v in np.quantile(data[key], [0.025, 0.5, 0.975]))
                for key in data.data_vars
                if str(key).startswith(ERROR)
            }
    except (OSError, KeyError):
        raise ConfigError(f"{file} holds no scores; make it with softgrip calibrate CONFIG --posterior.") from None
    points = zip(columns["curve"].tolist(), columns["x"].tolist(), columns["y"].tolist(), strict=True)
    return Run(name, tuple(points), columns["elpd"], columns["pareto_k"], errors, usable)


ERROR = "model error of "


@dataclasses.dataclass(frozen=True)
class Compared:
    """Runs from the best to the worst."""

    runs: tuple[Run, ...]
    scores: np.ndarray
    """Of the points that all runs have, one row per run."""
    apart: tuple[tuple[float, float], ...]
    """(difference to the best, its standard error)."""
    lost: tuple[int, ...]
    """Points that a run left out, and another has."""

    def sentence(self) -> str:
        """What the numbers say."""
        best = self.runs[0].name
        worse, alike = [], []
        for run, (change, error) in zip(self.runs[1:], self.apart[1:], strict=True):
            told = -change >= LEAST and -change >= ERRORS * error
            (worse if told else alike).append(f"{run.name} (by {-change:.3g}, standard error {error:.2g})")
        said = []
        if worse:
            said.append(f"{best} predicts the points better than {' and than '.join(worse)}.")
        if alike:
            said.append(f"The data do not tell {best} from {' or from '.join(alike)}.")
        return " ".join(said)


def compared(runs: Sequence[Run]) -> Compared:
    """Runs on the points that all of them have; ConfigError where they are about other data."""
    if len(runs) < 2:
        raise ConfigError("Evidence compares models; name two runs or more.")
    common = set(runs[0].points).intersection(*(run.points for run in runs[1:]))
    every = set().union(*(run.points for run in runs))
    for run in runs:
        if len(common) < COMMON * len(run.points):
            raise ConfigError(
                f"{run.name} has {len(run.points)} points, of which {len(common)} are in every other run; evidence "
                "compares models of the same data."
            )
    order = [p for p in runs[0].points if p in common]
    scores = np.array([run.elpd[[run.points.index(p) for p in order]] for run in runs])
    ranks = np.argsort(-scores.sum(axis=1), kind="stable")
    best = scores[ranks[0]]
    apart = tuple(difference(best, scores[k]) for k in ranks)
    lost = tuple(len(every) - len(set(runs[k].points)) for k in ranks)
    return Compared(tuple(runs[k] for k in ranks), scores[ranks], apart, lost)


def run_of(name: str, found: Posterior) -> Run:
    """The scores of a posterior that is at hand."""
    density, fitting, at = found.density, found.fit.fitting, found.scores.points
    curves = [fitting.curves[k].name for k in fitting.of_curve[at]]
    errors = {}
    for k in np.flatnonzero(density.sampled_delta):
        low, middle, high = (float(v) for v in np.quantile(found.unknowns.delta[..., k], [0.025, 0.5, 0.975]))
        errors[fitting.curves[k].name] = (low, middle, high)
    points = tuple(zip(curves, fitting.x[at].tolist(), density.y[at].tolist(), strict=True))
    return Run(name, points, found.scores.elpd, found.scores.shape, errors, found.diagnosis.usable)


def run_evidence(paths: Sequence[Path], as_json: bool, console: Console) -> dict[str, Any]:
    """Compare the runs and print it; plain data of it."""
    names = [str(path) for path in paths]
    if len({path.resolve() for path in paths}) < len(paths):
        raise ConfigError(f"One run is named twice among {', '.join(names)}; a run differs from itself by nothing.")
    found = compared([read_run(path, name) for path, name in zip(paths, names, strict=True)])
    if not as_json:
        report(found, console)
    return as_data(found)


def as_data(found: Compared) -> dict[str, Any]:
    """Plain data, for JSON."""
    return {
        "runs": {
            run.name: {
                "elpd": number(found.scores[k].sum()),
                "difference": number(found.apart[k][0]),
                "standard_error": number(found.apart[k][1]),
                "points": found.scores.shape[1],
                "left_out": found.lost[k],
                "rough_scores": int(np.sum(run.shape > ROUGH)),
                "model_error": {curve: list(ends) for curve, ends in run.errors.items()},
                "usable": run.usable,
            }
            for k, run in enumerate(found.runs)
        },
        "verdict": found.sentence(),
    }


def report(found: Compared, console: Console) -> None:
    """A row for each run, and the verdict."""
    table = Table(title=f"evidence from {found.scores.shape[1]} points", title_justify="left")
    for heading in ("", "score", "less than the best", "model error"):
        table.add_column(heading, justify="right" if heading else "left")
    for k, run in enumerate(found.runs):
        change, error = found.apart[k]
        words = "-" if k == 0 else f"{-change:.3g}, standard error {error:.2g}"
        errors = ", ".join(f"{100 * ends[1]:.2g} %" for ends in run.errors.values()) or "none assumed"
        table.add_row(run.name, f"{found.scores[k].sum():.2f}", words, errors)
    console.print(table)
    console.print(found.sentence(), soft_wrap=True, highlight=False)
    for k, run in enumerate(found.runs):
        if found.lost[k]:
            console.print(
                f"{run.name} left out {found.lost[k]} points that another run has: it has no equilibrium there, which "
                "the score does not count.",
                soft_wrap=True,
                highlight=False,
            )
        rough = int(np.sum(run.shape > ROUGH))
        if rough:
            console.print(
                f"{run.name}: {rough} of {len(run.shape)} scores are rough (Pareto k above {ROUGH:g}).",
                soft_wrap=True,
                highlight=False,
            )
        if not run.usable:
            console.print(
                f"{run.name}: DO NOT USE its score; its chains have not converged.", soft_wrap=True, highlight=False
            )
