"""`softgrip calibrate CONFIG.toml`: parameters from measured curves, in a folder that keeps everything.

The folder: config.toml as given and the measured files that it names, so that the run is repeated from there;
calibrated.toml (the scenes with the fitted numbers), material.toml (its section [material], for
`material = "material.toml"` in another config), points.csv (every point, its fit and error), result.json, summary.txt,
report.html, fit.png; of a finger calibrated_cell.toml or calibrated_thesis.toml, the fit by its other drive; with a
posterior posterior.nc, corner.png and predictive.png, see `optim.posterior.write`. It appears complete or not at all,
and never replaces another. Stopped by Ctrl-C after the fit, it holds that and the intervals until then.

A config with a section [tension] in place of [calibrate] compares materials on tension tests: see `optim.tension.run`.
"""

from __future__ import annotations

import csv
import dataclasses
import json
import shlex
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from softgrip_jax import config as configs
from softgrip_jax.config import ConfigError
from softgrip_jax.errors import InputError, located
from softgrip_jax.folders import DeferInterrupt, new_folder
from softgrip_jax.materials.base import Material
from softgrip_jax.progress import stages
from softgrip_jax.report.inputs import keep_inputs
from softgrip_jax.report.run import tell_and_keep, write_report
from softgrip_jax.spread import Spread
from softgrip_jax.units import DISPLAY, unit_key

from ..posterior.density import require_normal, require_touched
from ..posterior.posterior import Posterior, posterior
from ..posterior.sample import extra
from ..posterior.write import comment as comment_of
from ..posterior.write import report as report_posterior
from ..posterior.write import summary as summary_of
from ..posterior.write import write_file, write_pictures
from ..records import as_given, summary, versions
from ..tension.run import run_tension
from ..tension.test import material_of
from . import settings
from .drives import Rival
from .fit import Fit, calibrate
from .points import points_of
from .provenance import material_text, provenance
from .report import (
    STOPPED,
    Findings,
    OverSpecimens,
    examine,
    is_determined,
    over_specimens,
    report,
    with_rival,
)
from .systematic import autocorrelation

OWN_FILES = ("points.csv", "result.json", "summary.txt")
"""Files of the run whose names a measured file may have."""


def run_calibrate(
    config: Path, out: Path | None, console: Console, spread: Spread | None = None, with_posterior: bool = False
) -> Path:
    """Fit as the config says, print what was found, and return the folder that holds it; Ctrl-C as in `run_design`.
    spread: who does the fits of the bootstrap in place of this process. with_posterior: whatever the config says."""
    sections = configs.read_sections(config)
    if {"tension", "calibrate"} <= set(sections):
        raise ConfigError(f"{config} has [tension] and [calibrate]; one run does one of them.")
    if "tension" in sections:
        if spread is not None:
            raise ConfigError(f"{config}, [tension]: its fits are few and run in one process; leave out --workers.")
        return run_tension(config, out, console, with_posterior)
    read = configs.load(config)
    wanted = settings.read(read)
    table = wanted.table
    sampling = wanted.sampling(with_posterior)
    if sampling is not None:
        with located(f"{config}, [calibrate]"):
            extra()
    found = None
    with new_folder(out, config.stem) as (folder, final):
        keep_inputs(folder, config, OWN_FILES)
        with located(f"{config}, [calibrate]"), stages(console) as tell:
            fit = calibrate(wanted.fitting, table.starts, table.seed, tell)
            if sampling is not None:
                require_touched(fit)
                require_normal(fit)
            findings = examine(fit, table.intervals, table.repeats, table.seed, tell, spread)
            findings = findings if findings.stopped else with_rival(findings, table.starts, table.seed, tell)
            if sampling is not None and not findings.stopped:
                try:
                    found = posterior(fit, wanted.priors, sampling, tell)
                except KeyboardInterrupt:
                    findings = dataclasses.replace(findings, remarks=(*findings.remarks, STOPPED), stopped=True)
        with DeferInterrupt() as writing:
            _write(folder, read, findings, found)
            if found is not None:
                write_file(folder, found, wanted.numbers)
                write_pictures(folder, found, wanted.numbers)

            def tell_all(console: Console) -> None:
                report(findings, console)
                if found is not None:
                    report_posterior(found, console)

            tell_and_keep(folder, console, tell_all)
            write_report(folder, final.name)
    command = _next_command(final / "calibrated.toml", read, findings.fit)
    console.print(summary("fit", final, command), soft_wrap=True)
    if findings.stopped or writing.asked:
        raise KeyboardInterrupt
    return final


def _next_command(file: Path, read: configs.Config, fit: Fit) -> str:
    """Solve the calibrated scene of the first curve: for its own task, or at the largest pressure that was measured and
    that the model reaches."""
    number, curve = next(
        ((k, curve) for k, curve in enumerate(fit.fitting.curves) if curve.model in read.scenes), (0, None)
    )
    name = next(iter(read.scenes)) if curve is None else curve.model
    words = ["softgrip", "solve", str(file)] + (["--scene", name] if len(read.scenes) > 1 else [])
    try:
        read.scenes[name].target()
    except InputError:
        if curve is None:
            words[1] = "path"
        else:
            used = fit.fitting.x[fit.used & (fit.fitting.of_curve == number)]
            largest = np.max(used) if len(used) else curve.x.max()
            words += ["--pressure-kPa", f"{largest / DISPLAY['pressure'][1]:.6g}"]
    return shlex.join(words)


def _write(folder: Path, read: configs.Config, findings: Findings, found: Posterior | None = None) -> None:
    fit = findings.fit
    scenes, kept = _scenes_of(read, fit)
    said = _lines(findings) + ([] if found is None else comment_of(found))
    comment = provenance(read.path.name) + "\n" + "\n".join(said)
    (folder / "calibrated.toml").write_text(configs.dump(scenes, comment, **kept), encoding="utf-8")
    material = _one_material(scenes)
    if material is not None:
        (folder / "material.toml").write_text(material_text(material, comment), encoding="utf-8")
    if findings.rival is not None:
        scenes, kept = _scenes_of(read, findings.rival.fits[1])
        drive = findings.rival.drives[1]
        said = f"{provenance(read.path.name)}\nThe fit by the other drive of the finger, {drive}."
        (folder / f"calibrated_{drive}.toml").write_text(configs.dump(scenes, said, **kept), encoding="utf-8")
    write_points(folder / "points.csv", fit)
    result = _summary(findings) | ({} if found is None else {"posterior": summary_of(found)})
    (folder / "result.json").write_text(json.dumps(result, indent=2), encoding="utf-8")
    draw(fit, folder / "fit.png")


def _scenes_of(read: configs.Config, fit: Fit) -> tuple[dict[str, Any], dict[str, Any]]:
    """(the scenes of the config with the fitted numbers, its sections that belong to the part)."""
    modules = fit.modules()
    return as_given(read, {name: modules[name] for name in read.scenes})


def _one_material(scenes: dict[str, Any]) -> Material | None:
    """The material of all the scenes; None where they differ."""
    found = [material_of(scene) for scene in scenes.values()]
    if any(m is None or str(m) != str(found[0]) for m in found):
        return None
    return found[0]


def _lines(findings: Findings) -> list[str]:
    """One line per parameter: what a file with fitted numbers should say of them."""
    fit, lines = findings.fit, []
    for j, (name, kind) in enumerate(zip(fit.fitting.space.names, fit.fitting.space.kinds, strict=True)):
        unit = DISPLAY[kind][1]
        text = f"{unit_key(name, kind)} = {fit.x[j] / unit:.6g}"
        for one in findings.intervals:
            low, high = (f"{end / unit:.6g}" if np.isfinite(end) else "open" for end in (one.low[j], one.high[j]))
            if fit.on_bound[j] and one.method == "gauss_newton":
                text += ", on its bound"
            elif is_determined(fit, j):
                text += f", 95 % {low} to {high} ({one.method})"
            else:
                text += ", not determined by the data"
        over = None if findings.specimens is None else over_specimens(fit, findings.specimens, j)
        if over is not None:
            text += f"; {_of_specimens(over, unit)} ({over.test})"
            if findings.specimens is not None and findings.specimens.differ_together:
                text += ", but differ in all parameters together: the interval is too narrow"
        lines.append(text)
    return lines


def _of_specimens(over: OverSpecimens, unit: float) -> str:
    if not over.differ:
        return "the specimens agree within the noise"
    said = "the specimens differ by more than the noise explains"
    if not over.is_to_quote:
        return f"{said}, and are too few for an interval of their mean"
    return f"{said}: quote 95 % {over.low / unit:.6g} to {over.high / unit:.6g} (mean of the specimens)"


def write_points(path: Path, fit: Fit) -> None:
    """Every point: measured, fitted, error, whether it was used; in the units of people."""
    fitting = fit.fitting
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["curve", "specimen", "pressure_kPa", "strain", "quantity", "unit", *COLUMNS])
        for k, curve in enumerate(fitting.curves):
            label, unit = curve.unit
            of = np.flatnonzero(fitting.of_curve == k)
            for i, at in enumerate(of):
                specimen = "" if curve.specimen is None else curve.specimens[int(curve.specimen[i])]
                x = ("", curve.x[i]) if curve.quantity == "stress" else (curve.x[i] / DISPLAY["pressure"][1], "")
                numbers = (curve.y[i] / unit, (curve.y[i] + fit.errors[at]) / unit, fit.errors[at] / unit)
                writer.writerow([curve.name, specimen, *x, curve.label, label, *numbers, bool(fit.used[at])])


COLUMNS = ("measured", "fitted", "error", "used")


def plain(values: Any) -> list[float | None]:
    """As JSON has it."""
    return [float(v) if np.isfinite(v) else None for v in values]


def _summary(findings: Findings) -> dict[str, Any]:
    fit, space = findings.fit, findings.fit.fitting.space

    def vector(values: Any) -> dict[str, float | None]:
        return dict(zip(space.names, plain(values), strict=True))

    curves = {}
    for k, curve in enumerate(fit.fitting.curves):
        without = findings.held_out.get(curve.name)
        curves[curve.name] = {
            "quantity": curve.label,
            "points": len(curve.x),
            "used": int((fit.used & (fit.fitting.of_curve == k)).sum()),
            "noise": float(fit.member.sigma[k]) if curve.fit else None,
            "noise_stated": curve.noise is not None,
            "rmse": plain([fit.rmse(k)])[0],
            "rmse_when_kept_out": None if without is None else plain([without[1]])[0],
            "parameters_without_it": None if without is None else vector(without[0]),
            "autocorrelation": autocorrelation(fit, k),
        }
    specimens, rival = findings.specimens, findings.rival
    over = [None if specimens is None else over_specimens(fit, specimens, j) for j in range(space.size)]
    return {
        "units": "SI",
        "parameters": vector(fit.x),
        "start": vector(space.reference),
        "intervals": {one.method: {"low": vector(one.low), "high": vector(one.high)} for one in findings.intervals},
        "correlation": [plain(row) for row in fit.correlation],
        "on_bound": [space.names[j] for j in np.flatnonzero(fit.on_bound)],
        "curves": curves,
        "specimens": None if specimens is None else dict(zip(specimens.names, map(vector, specimens.x), strict=True)),
        "interval_over_specimens": None
        if specimens is None
        else {
            "low": vector(np.maximum(specimens.low, space.low)),
            "high": vector(np.minimum(specimens.high, space.high)),
            "differ_by_chance": vector(specimens.chance),
            "differ_by_chance_together": specimens.chance_together,
            "to_quote": [name for name, one in zip(space.names, over, strict=True) if one and one.is_to_quote],
        },
        "not_told_apart": [list(d.names) for d in findings.directions],
        "remarks": list(findings.remarks),
        "other_drive": None if rival is None else _other(rival, vector),
        "loss": fit.fitting.loss,
        "steps": fit.steps,
        **versions(),
    }


def _other(rival: Rival, vector: Any) -> dict[str, Any]:
    """The fit by the other drive, in SI."""
    other = rival.fits[1]
    return {
        "drives": list(rival.drives),
        "log_likelihoods": plain(rival.likelihoods),
        "better": rival.better,
        "explained": rival.explained,
        "parameters": vector(other.x),
        "rmse": {curve.name: plain([other.rmse(k)])[0] for k, curve in enumerate(other.fitting.curves)},
    }


def draw(fit: Fit, path: Path) -> None:
    """Data, fit and interval of every curve."""
    # matplotlib takes a second to load: only a run that draws waits for it.
    from softgrip_jax import plots

    panels = []
    for k, curve in enumerate(fit.fitting.curves):
        label, unit = curve.unit
        is_test = curve.quantity == "stress"
        x_unit = 1.0 if is_test else DISPLAY["pressure"][1]
        x, y, half = fit.band(k)
        error = f"{float(f'{fit.rmse(k) / unit:.2g}'):g} {label}"
        words = f"{'fit' if curve.fit else 'predicted'} and 95 %: error {error}"
        line = plots.Line(words, x / x_unit, y / unit, half / unit)
        used = (fit.used | (not curve.fit))[fit.fitting.of_curve == k]
        x_label = "engineering strain" if is_test else "pressure (kPa)"
        panels.append(
            plots.Panel(curve.name, x_label, f"{curve.label} ({label})", points_of(curve, used, x_unit, unit), [line])
        )
    plots.measured_and_fitted(panels).savefig(path)
