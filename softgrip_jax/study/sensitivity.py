"""What matters: elasticities of quantities by the numbers of a design, and what manufacturing tolerances do to them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np
import xarray as xr

from ..errors import InputError
from ..fields import admissible
from ..parameters import Named, Parameter, Parameters, Scenes
from ..progress import Tell, silent
from ..quantities import Quantity
from ..results import Status, in_units
from ..units import SI
from .designs import Table
from .study import Study


def sensitivity(
    scenes: Scenes,
    leaves: Sequence[str | Named],
    quantities: Sequence[Quantity],
    tolerances: Sequence[float | None] = (),
    samples: int = 10_000,
    seed: int = 0,
    report: Tell = silent,
    draws: np.ndarray | None = None,
) -> xr.Dataset:
    """Elasticities of quantities by the numbers of a design, and what manufacturing tolerances do to them.

    The Dataset holds value (quantity), slope dy/dx (quantity, by) in SI, and elasticity d ln y / d ln x = (x / y)
    dy/dx, how many per cent y changes for one per cent of x; NaN where y is zero.

    A tolerance of t means x within x0 - t and x0 + t, evenly distributed, and independent of the others: its standard
    deviation is t / sqrt(3). deviation_by_gradient (quantity) is sqrt(sum of (dy/dx t / sqrt(3))^2); share (quantity,
    by) is how much of its square is due to each number. deviation_by_sampling is that of `samples` designs drawn at
    random, with deviation_error, its own standard error, mean_by_sampling, and answered, the part of the samples that
    have an answer: only these are counted in the others. "No limit" (inf) is an answer, left out of the others.

    Args:
        scenes: a dictionary of scenes by name.
        leaves: names of the varied numbers, see `softgrip_jax.parameters`.
        quantities: what to look at, see `softgrip_jax.quantities`.
        tolerances: in SI, one per varied number; None where the number is exact.
        samples: designs that are drawn at random.
        seed: of these.
        report: told of every stage, and of how many samples are done.
        draws: of the varied numbers, jointly, SI, shape (m, n), such as those of a posterior; NaN in the columns of
            numbers that are known by their tolerances. Samples then take whole rows. Shares are those of correlated
            numbers, dy/dx_i cov(x_i, y) over the variance of y, and may be negative.

    Raises:
        InputError: for an unknown name, and where a tolerance leads to what a number cannot be, as a thickness below
            zero.

    Source: GUM (JCGM 100:2008) 4.3.7 and 5.1.2.

    Examples:
        >>> shell = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
        >>> scenes = {"free": sg.shell.Free(shell)}
        >>> data = sg.study.sensitivity(scenes, ["shell.material.mu"], [sg.Quantity("limit_pressure")])
        >>> print(f"{float(data.elasticity[0, 0]):.6f}")  # every pressure is proportional to mu
        1.000000
    """
    numbers = Parameters(scenes, [Parameter(leaf) if isinstance(leaf, str) else leaf for leaf in leaves])
    reference = numbers.reference
    study = Study(scenes, leaves, quantities, Table(reference), gradients=True)
    report("compiling, then differentiating")
    found = study.measured_alone(reference)
    values, slopes = found["values"], found["slopes"]
    statuses = found["statuses"][study.asked.state_of]
    with np.errstate(divide="ignore", invalid="ignore"):
        elasticity = np.where(values[:, None] == 0, np.nan, slopes * reference / values[:, None])
    data: dict[str, Any] = {
        "value": ("quantity", values),
        "status": ("quantity", statuses.astype(np.int8), {"flag_meanings": " ".join(s.name for s in Status)}),
        "slope": (("quantity", "by"), slopes),
        "elasticity": (("quantity", "by"), elasticity),
    }
    coords: dict[str, Any] = {
        "quantity": study.asked.labels(),
        "kind": ("quantity", study.asked.kinds),
        "unit": ("quantity", [SI[kind] for kind in study.asked.kinds]),
        "by": numbers.names,
        "design": ("by", reference),
        "design_unit": ("by", [SI[kind] for kind in numbers.kinds]),
    }
    if any(tolerances) or draws is not None:
        widths = np.array([t or 0.0 for t in tolerances]) if any(tolerances) else np.zeros(numbers.size)
        _require_possible(numbers, reference, widths)
        coords["tolerance"] = ("by", widths)
        rng = np.random.default_rng(seed)
        drawn = reference + widths * rng.uniform(-1, 1, (samples, numbers.size))
        covariance = np.diag(widths**2 / 3)
        if draws is not None:
            joint = np.flatnonzero(np.all(np.isfinite(draws), axis=0))
            drawn[:, joint] = draws[:, joint][rng.integers(len(draws), size=samples)]
            covariance[np.ix_(joint, joint)] = np.cov(draws[:, joint], rowvar=False).reshape(len(joint), len(joint))
        data |= _spread(Study(scenes, leaves, quantities, Table(drawn)), slopes, covariance, report)
    return xr.Dataset(data, coords)


def _require_possible(numbers: Parameters, reference: np.ndarray, widths: np.ndarray) -> None:
    """An InputError where a tolerance leads to what a number cannot be, as a thickness below zero."""
    for k, (name, kind) in enumerate(zip(numbers.names, numbers.kinds, strict=True)):
        for end in (-widths[k], widths[k]):
            moved = numbers.scenes_at(jnp.asarray(reference).at[k].add(end))
            if not all(bool(admissible(scene)) for scene in moved.values()):
                here, width, there = (in_units(v, kind) for v in (reference[k], widths[k], reference[k] + end))
                raise InputError(
                    f"{name} is {here}, and its tolerance of {width} leads to {there}, which it cannot be; lower it."
                )


def _spread(study: Study, slopes: np.ndarray, covariance: np.ndarray, report: Tell) -> dict[str, Any]:
    variances = slopes * (slopes @ covariance)
    parts = []
    report("samples of the tolerances", 0, study.designs.count)
    for done, part in study.parts():
        parts.append(part)
        report("samples of the tolerances", done, study.designs.count)
    seen = np.concatenate([part["values"] for part in parts])
    answered = np.concatenate([part["statuses"] for part in parts])[:, study.asked.state_of] == Status.OK
    answered &= ~np.isnan(seen)
    deviation, error, mean = (np.full(len(slopes), np.nan) for _ in range(3))
    for k in range(len(slopes)):
        good = seen[answered[:, k] & np.isfinite(seen[:, k]), k]
        if good.size > 1:
            mean[k], deviation[k] = good.mean(), good.std(ddof=1)
            # Of a sample standard deviation: sqrt((m4 - s^4) / n) / (2 s), m4 the fourth central moment.
            fourth = np.mean((good - mean[k]) ** 4)
            error[k] = np.sqrt(max(fourth - deviation[k] ** 4, 0) / good.size) / (2 * deviation[k] or np.inf)
    total = np.sum(variances, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = variances / total[:, None]
    return {
        "deviation_by_gradient": ("quantity", np.sqrt(total)),
        "share": (("quantity", "by"), share),
        "deviation_by_sampling": ("quantity", deviation),
        "deviation_error": ("quantity", error),
        "mean_by_sampling": ("quantity", mean),
        "answered": ("quantity", np.mean(answered, axis=0)),
    }
