"""What a run keeps and says of a posterior: posterior.nc, pictures, entries of result.json, a printed table.

posterior.nc is netCDF with the groups that ArviZ knows:

    posterior        dims chain, draw: each parameter by its key and in its unit (of the next part where there are
                     several specimens), with the laws of the scenes that it was fitted with (drive, model ...);
                     "mean of KEY" and "scatter of KEY" of their population, "KEY of the specimens", noise and model
                     error of each curve
    sample_stats     diverging, energy, n_steps, acceptance_rate
    observed_data    y of the fitted points, with x, curve and specimen beside it, SI
    log_likelihood   log p(y_i | y_-i, theta) of some of the draws
    evidence         leave-one-out scores of the points: what `softgrip evidence` compares
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from rich.console import Console

from softgrip_jax.config.keys import Varied
from softgrip_jax.draws import GROUP, LAWS, OWNER, TIED, USABLE, VERDICT, Laws, owner_of
from softgrip_jax.laws import laws_of
from softgrip_jax.results import in_units
from softgrip_jax.tables import Table
from softgrip_jax.units import DISPLAY

from ..calibration.model import Fitting
from ..calibration.points import points_of
from .evidence import ROUGH
from .posterior import Posterior

FILE = "posterior.nc"
ENDS = [0.025, 0.5, 0.975]


def entries(found: Posterior, numbers: Sequence[Varied]) -> list[tuple[str, Varied]]:
    """(key, number) of every entry of the parameters: an array has one entry per element."""
    sizes = found.fit.fitting.space.sizes
    return [
        (number.key if size == 1 else f"{number.key}[{i}]", number)
        for number, size in zip(numbers, sizes, strict=True)
        for i in range(size)
    ]


def safe(name: str) -> str:
    """A name as netCDF takes it."""
    return name.replace("/", "_")


def laws_behind(fitting: Fitting, j: int) -> Laws:
    """The laws of the scenes that an entry of the parameters moves and that curves were fitted with."""
    given = fitting.given
    # Where the models hold NaN in place of the entry, the entry is.
    marked = given.scenes_at(jnp.asarray(np.where(np.arange(given.size) == j, np.nan, given.reference)))
    laws: Laws = {}
    for name in dict.fromkeys(curve.model for curve in fitting.curves if curve.fit):
        if any(np.isnan(leaf).any() for leaf in jax.tree.leaves(marked[name])):
            for law, value in laws_of(given.scenes[name]).items():
                laws[law] = [*dict.fromkeys([*laws.get(law, []), value])]
    return laws


def write_file(folder: Path, found: Posterior, numbers: Sequence[Varied]) -> None:
    """posterior.nc."""
    import xarray as xr

    density, diagnosis, fitting = found.density, found.diagnosis, found.fit.fitting
    scenes = fitting.given.scenes
    two = ("chain", "draw")
    data: dict[str, Any] = {}
    varying = {j: i for i, j in enumerate(np.flatnonzero(density.varying))}
    for j, (key, number) in enumerate(entries(found, numbers)):
        label, unit = DISPLAY[number.kind]
        about = {"units": label or "1", OWNER: owner_of(scenes, number.name), "long_name": fitting.space.names[j]}
        if key == number.key:  # an element of an array is no number that others may read
            about[TIED] = " ".join(number.keys)
            about[LAWS] = json.dumps(laws_behind(fitting, j))
        data[key] = (two, found.next_part[..., j] / unit, about)
        if j in varying:
            tau = np.asarray(found.unknowns.tau)[..., varying[j]]
            parts = np.asarray(found.unknowns.parts)[..., j] / unit
            data[f"mean of {key}"] = (two, np.asarray(found.unknowns.x)[..., j] / unit, {"units": label or "1"})
            data[f"scatter of {key}"] = (two, tau, {"units": "1", "long_name": "standard deviation of its logarithm"})
            data[f"{key} of the specimens"] = ((*two, "specimen"), parts, {"units": label or "1"})
    for k, curve in enumerate(fitting.curves):
        for what, values, own, unit in (
            ("noise", found.unknowns.sigma, density.sampled_noise, DISPLAY[curve.kind]),
            ("model error", found.unknowns.delta, density.sampled_delta, ("1", 1.0)),
        ):
            if own[k]:
                values = np.asarray(values)[..., k] / unit[1]
                data[safe(f"{what} of {curve.name}")] = (two, values, {"units": unit[0] or "1"})
    coords = {"specimen": [s or "others" for s in density.specimens]} if density.specimens else {}
    about = {USABLE: int(diagnosis.usable), VERDICT: diagnosis.sentence(), "inference_library": "numpyro"}
    sampled, points = found.sampled, found.scores.points
    stats = {
        "diverging": (two, sampled.diverging.astype(np.int8)),
        "energy": (two, sampled.energy),
        "n_steps": (two, sampled.steps),
        "acceptance_rate": (two, sampled.accepted),
    }
    where = {
        "x": ("point", fitting.x[points], {"long_name": "pressure in Pa, or strain"}),
        "curve": ("point", np.array([fitting.curves[k].name for k in fitting.of_curve[points]], dtype=object)),
    }
    given = found.log_likelihood
    groups = {
        GROUP: xr.Dataset(data, coords, about),
        "sample_stats": xr.Dataset(stats),
        "observed_data": xr.Dataset({"y": ("point", density.y[points])}, where),
        "log_likelihood": xr.Dataset({"y": ((*two, "point"), given[None])}, where),
        "evidence": xr.Dataset(
            {"elpd": ("point", found.scores.elpd), "pareto_k": ("point", found.scores.shape)}
            | {"y": ("point", density.y[points])},
            where,
        ),
    }
    # HDF5 itself, on a disk that is full, would end the process.
    (folder / FILE).write_bytes(xr.DataTree.from_dict(groups).to_netcdf(engine="h5netcdf"))


def write_pictures(folder: Path, found: Posterior, numbers: Sequence[Varied]) -> None:
    """corner.png and predictive.png."""
    from softgrip_jax import plots

    fitting = found.fit.fitting
    units = np.array([DISPLAY[number.kind][1] for _, number in entries(found, numbers)])
    names = [
        f"{name.split('.')[-1]} ({DISPLAY[kind][0]})" if DISPLAY[kind][0] else name.split(".")[-1]
        for name, kind in zip(fitting.space.names, fitting.space.kinds, strict=True)
    ]
    prior = found.prior_quantiles((np.arange(4000) + 0.5) / 4000)
    plots.corner(names, found.x / units, prior / units).savefig(folder / "corner.png")
    bands = []
    for k, curve in enumerate(fitting.curves):
        label, unit = curve.unit
        is_test = curve.quantity == "stress"
        x_unit = 1.0 if is_test else DISPLAY["pressure"][1]
        x, model, data = found.band(k)
        used = (found.fit.used | (not curve.fit))[fitting.of_curve == k]
        words = (curve.name, "engineering strain" if is_test else "pressure (kPa)", f"{curve.label} ({label})")
        bands.append(plots.Band(*words, points_of(curve, used, x_unit, unit), x / x_unit, model / unit, data / unit))
    plots.predictive(bands).savefig(folder / "predictive.png")


def summary(found: Posterior) -> dict[str, Any]:
    """What result.json holds of it, SI."""
    density, diagnosis, fitting = found.density, found.diagnosis, found.fit.fitting
    space = fitting.space
    ends, prior = found.quantiles(ENDS), found.prior_quantiles(ENDS)
    names = density.names
    parameters = {
        name: {
            **dict(zip(("low", "median", "high"), map(float, ends[:, j]), strict=True)),
            "prior": [float(v) for v in prior[:, j]],
            "r_hat": number(diagnosis.r_hat[j]),
            "effective_draws": number(min(diagnosis.bulk[j], diagnosis.tail[j])),
        }
        for j, name in enumerate(space.names)
    }
    curves = {}
    for k, curve in enumerate(fitting.curves):
        if not curve.fit:
            continue
        own = fitting.of_curve[found.scores.points] == k
        curves[curve.name] = {
            "noise": _quantiles(found.unknowns.sigma, k)
            if density.sampled_noise[k]
            else float(density.noise_scales[k]),
            "model_error": _quantiles(found.unknowns.delta, k) if density.sampled_delta[k] else None,
            "elpd": number(found.scores.elpd[own].sum()),
        }
    specimens = {}
    for s, name in enumerate(density.specimens):
        parts = np.asarray(found.unknowns.parts)[..., s, :].reshape(-1, space.size)
        specimens[name or "others"] = {
            space.names[j]: [float(v) for v in np.quantile(parts[:, j], ENDS)] for j in np.flatnonzero(density.varying)
        }
    worst = int(np.argmax(np.where(np.isfinite(diagnosis.r_hat), diagnosis.r_hat, 1e300)))
    return {
        "usable": diagnosis.usable,
        "parameters": parameters,
        "curves": curves,
        "specimens": specimens or None,
        "chains": found.settings.chains,
        "draws": found.settings.draws,
        "divergences": diagnosis.divergences,
        "worst": {"unknown": names[worst], "r_hat": number(diagnosis.r_hat[worst])},
        "elpd": number(found.scores.total),
        "rough_scores": int(np.sum(found.scores.shape > ROUGH)),
        "remarks": found.remarks(),
    }


def number(value: Any) -> float | None:
    """As JSON has it."""
    return float(value) if np.isfinite(value) else None


def _quantiles(values: Any, k: int) -> list[float]:
    return [float(v) for v in np.quantile(np.asarray(values)[..., k], ENDS)]


def report(found: Posterior, console: Console) -> None:
    """Print it: parameters, then noise and model error of the curves, then the verdict."""
    density, fitting = found.density, found.fit.fitting
    space = fitting.space
    table = Table(title="posterior", title_justify="left")
    for heading in ("", "prior, 95 %", "median", "95 % interval", "R-hat", "ESS"):
        table.add_column(heading, justify="right" if heading else "left", no_wrap=not heading)
    ends, prior = found.quantiles(ENDS), found.prior_quantiles(ENDS)

    def of(values: Any, kind: str) -> tuple[str, str]:
        label, unit = DISPLAY[kind]
        low, middle, high = np.asarray(values) / unit
        return f"{middle:.4g} {label}".strip(), f"{low:.4g} to {high:.4g} {label}".strip()

    def sure(k: int) -> tuple[str, str]:
        diagnosis = found.diagnosis
        return f"{diagnosis.r_hat[k]:.3f}", f"{min(diagnosis.bulk[k], diagnosis.tail[k]):.0f}"

    varying = list(np.flatnonzero(density.varying))
    for j, (name, kind) in enumerate(zip(space.names, space.kinds, strict=True)):
        is_part = j in varying
        words = f"{name} of the next part" if is_part else name
        table.add_row(words, of(prior[:, j], kind)[1], *of(ends[:, j], kind), *sure(j))
        if is_part:
            i = varying.index(j)
            mean = np.quantile(np.asarray(found.unknowns.x)[..., j], ENDS)
            tau = 100 * np.quantile(np.asarray(found.unknowns.tau)[..., i], ENDS)
            count = len(varying)
            table.add_row("  mean of all parts", "", *of(mean, kind), *sure(j))
            words = (f"{tau[1]:.2g} %", f"{tau[0]:.2g} to {tau[2]:.2g} %")
            table.add_row("  scatter of parts", "", *words, *sure(space.size + len(density.specimens) * count + i))
            for s, specimen in enumerate(density.specimens):
                own = np.quantile(np.asarray(found.unknowns.parts)[..., s, j], ENDS)
                table.add_row(f"  {specimen or 'others'}", "", *of(own, kind), *sure(space.size + s * count + i))
    names = density.names
    for k, curve in enumerate(fitting.curves):
        if density.sampled_noise[k]:
            values = np.quantile(np.asarray(found.unknowns.sigma)[..., k], ENDS)
            table.add_row(
                f"noise of {curve.name}", "", *of(values, curve.kind), *sure(names.index(f"the noise of {curve.name}"))
            )
        if density.sampled_delta[k]:
            low, middle, high = 100 * np.quantile(np.asarray(found.unknowns.delta)[..., k], ENDS)
            at = names.index(f"the model error of {curve.name}")
            table.add_row(
                f"model error of {curve.name}", "", f"{middle:.2g} %", f"{low:.2g} to {high:.2g} %", *sure(at)
            )
    console.print(table)
    console.print(
        f"Leave-one-out score of the points (elpd): {found.scores.total:.2f}; softgrip evidence compares runs by it.",
        soft_wrap=True,
        highlight=False,
    )
    for remark in found.remarks():
        console.print(remark, soft_wrap=True, highlight=False)


def comment(found: Posterior) -> list[str]:
    """Lines for files with fitted numbers."""
    space = found.fit.fitting.space
    ends = found.quantiles(ENDS)
    return [
        f"{name}: posterior median {in_units(ends[1, j], kind)}, 95 % {in_units(ends[0, j], kind)} to "
        f"{in_units(ends[2, j], kind)}"
        for j, (name, kind) in enumerate(zip(space.names, space.kinds, strict=True))
    ]
