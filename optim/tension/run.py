"""[tension]: which material describes a tension test, over which strains, and where it would go wrong beyond them.

    [tension]
    file = "tension.csv"                        # beside the config; a list: several specimens
    strain = { column = "strain", unit = "%" }           # engineering
    stress = { column = "stress", unit = "MPa" }         # engineering: force over undeformed area
    window_percent = 100                        # the strains that shall be met; left out: the whole test
    compare_percent = [25, 50, 100, 200]        # windows in which the neo-Hookean mu is compared
    materials = ["NeoHookean", "Yeoh"]          # left out: all of them

    posterior = true                            # their leave-one-out scores, too

Every material is fitted by least squares in the window, and they are compared by Akaike's criterion in its corrected
form (Hurvich and Tsai 1989), n ln(SSR/n) + 2 K + 2 K (K + 1) / (n - K - 1) with K parameters, the noise among them: the
lowest is the best, and a difference of ten leaves little doubt. The points of one test follow each other, so it tends
to choose the larger of two materials; the table shows the errors too. Written is the best that is stable up to twice
the window.

The folder: config.toml with the files that it names, material.toml (the best), materials.csv, result.json, summary.txt,
report.html, fit.png.
"""

from __future__ import annotations

import csv
import dataclasses
import json
from pathlib import Path
from typing import Any, Literal

import jax.numpy as jnp
import numpy as np
import pydantic
from rich.console import Console

from softgrip_jax import config as configs
from softgrip_jax.config.keys import Seed, Table
from softgrip_jax.errors import ConfigError, located
from softgrip_jax.folders import DeferInterrupt, new_folder
from softgrip_jax.progress import Tell, stages
from softgrip_jax.report.inputs import keep_inputs
from softgrip_jax.report.run import tell_and_keep, write_report
from softgrip_jax.results import in_units
from softgrip_jax.tables import Table as PrintedTable
from softgrip_jax.units import kPa

from ..calibration.data import Curve
from ..calibration.provenance import material_text, provenance
from ..calibration.report import STOPPED, misfit, over_specimens
from ..calibration.settings import ColumnTable, column, read_specimens
from ..posterior.compare import Run, as_data, compared, run_of
from ..posterior.compare import report as report_evidence
from ..posterior.posterior import posterior
from ..posterior.priors import Sampling, weak
from ..posterior.sample import extra
from ..records import summary, versions
from .compare import (
    COMPARED,
    DEPENDS,
    LEAST_POINTS,
    SOFT,
    STIFF,
    STRIP,
    Comparison,
    FittedMaterial,
    compare,
    points_inside,
)
from .test import BEYOND, CANDIDATES


class TensionTable(Table):
    file: str | list[str]
    strain: ColumnTable
    stress: ColumnTable
    materials: list[Literal[tuple(CANDIDATES)]] = pydantic.Field(  # type: ignore[valid-type]
        default=list(CANDIDATES), min_length=1
    )
    window_percent: float | None = pydantic.Field(default=None, gt=0)
    compare_percent: list[float] | None = None
    seed: Seed = 0
    posterior: bool = False


# --- the command ------------------------------------------------------------------------------------------------------


def read(path: Path) -> tuple[TensionTable, Curve]:
    """The section [tension] and its data."""
    where = f"{path}, [tension]"
    table: TensionTable = configs.validated(TensionTable, configs.read_sections(path)["tension"], where)
    x, y = column(table.strain, "number", where), column(table.stress, "pressure", where)
    with located(where):
        found = read_specimens(path.parent, table.file, "tension", x, y)
    if table.compare_percent is not None and any(not w > 0 for w in table.compare_percent):
        raise ConfigError(f"{where}: compare_percent is {table.compare_percent}; strains are positive.")
    return table, Curve("tension test", STRIP, "stress", "pressure", **found)


OWN_FILES = ("material.toml", "materials.csv", "result.json", "summary.txt")
"""Files of the run whose names a measured file may have."""


def run_tension(config: Path, out: Path | None, console: Console, with_posterior: bool = False) -> Path:
    """Compare materials as the config says; the folder that holds it. with_posterior: whatever the config says.

    Ctrl-C after the fits keeps them, and is raised again.
    """
    table, curve = read(config)
    largest = float(curve.x.max())
    window = largest if table.window_percent is None else table.window_percent / 100
    windows = [w / 100 for w in table.compare_percent or COMPARED if w / 100 <= largest * (1 + 1e-9)]
    if table.compare_percent is None and largest not in windows:
        windows.append(largest)
    with new_folder(out, config.stem) as (folder, final):
        with located(f"{config}, [tension]"), stages(console) as tell:
            evidence, remarks = None, beyond_the_data(table, curve)
            stopped = False
            if table.posterior or with_posterior:
                extra()
            found = compare(curve, table.materials, min(window, largest), windows, table.seed, tell)
            if (table.posterior or with_posterior) and len(found.judged) > 1:
                try:
                    evidence = compared([_scored(one, table.seed, tell) for one in found.judged])
                except KeyboardInterrupt:
                    stopped = True
        remarks += [*verdicts(found), *([STOPPED] if stopped else [])]
        with DeferInterrupt() as writing:
            comment = "\n".join([provenance(config.name), *_words_of(found)])
            keep_inputs(folder, config, OWN_FILES)
            (folder / "material.toml").write_text(material_text(found.chosen.material, comment), encoding="utf-8")
            _write_table(folder / "materials.csv", found)
            result = _summary(found, remarks) | ({} if evidence is None else {"evidence": as_data(evidence)})
            (folder / "result.json").write_text(json.dumps(result, indent=2), encoding="utf-8")
            draw(found, folder / "fit.png")

            def tell_all(console: Console) -> None:
                report(found, remarks, console)
                if evidence is not None:
                    report_evidence(evidence, console)

            tell_and_keep(folder, console, tell_all)
            write_report(folder, final.name)
    command = 'material = "material.toml" in a config in this folder.'
    console.print(summary("fit", final, command), soft_wrap=True)
    if stopped or writing.asked:
        raise KeyboardInterrupt
    return final


def beyond_the_data(table: TensionTable, curve: Curve) -> list[str]:
    """What the config asks for and the data do not reach, in sentences."""
    largest = float(curve.x.max())
    ends = f"the test ends at {100 * largest:.5g} %"
    said = []
    if table.window_percent is not None and table.window_percent / 100 > largest * (1 + 1e-9):
        said.append(f"window_percent is {table.window_percent:g}, but {ends}: so far the materials are fitted.")
    for percent in table.compare_percent or []:
        is_beyond = percent / 100 > largest * (1 + 1e-9)
        if is_beyond or points_inside(curve, percent / 100) < LEAST_POINTS:
            why = ends if is_beyond else f"fewer than {LEAST_POINTS} points are there"
            said.append(f"There is no neo-Hookean mu up to {percent:g} % strain: {why}.")
    return said


def _scored(one: FittedMaterial, seed: int, tell: Tell) -> Run:
    """A material's leave-one-out scores, its constants with wide priors around their first guesses. The materials are
    taken as they stand: what one does not follow is noise to it."""
    space = one.fit.fitting.space
    priors = [weak(space, j) for j in range(space.size)]
    priors = [dataclasses.replace(p, spread=WIDE_SPREAD) if p.distribution == "lognormal" else p for p in priors]
    return run_of(one.name, posterior(one.fit, priors, Sampling(seed=seed, discrepancy=0.0), tell))


WIDE_SPREAD = 2.0
"""Of the logarithm of a constant: a factor of seven."""


LEAST_STRAIN = 0.05
"""A test that ends below this strain is hardly one of an elastomer."""

LARGEST_STRAIN = 15.0
"""No silicone or rubber is stretched further."""


def verdicts(found: Comparison) -> list[str]:
    """How far to trust it, in sentences."""
    said = [*found.curve.notes, *found.remarks]
    if found.curve.x.max() < LEAST_STRAIN:
        said.append(
            f"The test ends at {100 * found.curve.x.max():.4g} % strain, and one of an elastomer at tens of per cent: "
            "is the unit of the strain right?"
        )
    if found.curve.x.max() > LARGEST_STRAIN:
        said.append(
            f"The test goes to {100 * found.curve.x.max():.0f} % strain, and no silicone or rubber beyond "
            f"{100 * LARGEST_STRAIN:.0f} %: is the unit of the strain right?"
        )
    if found.windows and not SOFT < found.windows[0].mu < STIFF:
        said.append(
            f"mu of about {in_units(found.windows[0].mu, 'pressure')} is not that of a silicone or rubber: is the unit "
            "of the stress right?"
        )
    for one in found.judged:
        for soft in one.softens:
            where = "inside" if soft.strain <= found.window else "outside"
            said.append(
                f"{one.name} softens from {100 * soft.strain:.0f} % strain on in {soft.mode}, {where} its window of "
                f"{100 * found.window:.0f} %: do not use it there."
            )
    said += [f"{one.name}: {note}" for one in found.judged for note in one.fit.notes]
    said += [f"{one.name}: a constant is held by a bound." for one in found.judged if one.fit.on_bound.any()]
    if len(found.windows) > 1:
        mus = [window.mu for window in found.windows]
        if max(mus) > DEPENDS * min(mus):
            pairs = ", ".join(f"{w.mu / kPa:.4g} kPa up to {100 * w.strain:.0f} %" for w in found.windows)
            said.append(
                f"The neo-Hookean mu depends on the window by a factor {max(mus) / min(mus):.2f} ({pairs}): choose the "
                "strains of the actuator."
            )
    chosen = found.chosen
    said += [*misfit(chosen.fit), *_of_specimens(chosen)]
    if chosen is not found.judged[0]:
        said.append(f"{found.judged[0].name} fits best but softens; {chosen.name} is the best that stays stable.")
    said.append(
        f"Written is {chosen.name}, fitted up to {100 * found.window:.0f} % strain; beyond, and in stretches other "
        "than those of a strip, it is an extrapolation."
    )
    return said


def _of_specimens(chosen: FittedMaterial) -> list[str]:
    """A sentence about each constant by specimen: its interval is that of all such specimens, however far they differ,
    wherever that is the wider one."""
    fit, specimens, said = chosen.fit, chosen.specimens, []
    if specimens is None:
        return said
    for j, (name, kind) in enumerate(zip(fit.fitting.space.names, fit.fitting.space.kinds, strict=True)):
        over = over_specimens(fit, specimens, j)
        if over is None:
            continue
        low, high = in_units(specimens.low[j], kind), in_units(specimens.high[j], kind)
        sentence = f"{name} by specimen: {over.values}; 95 % interval of their mean {low} to {high}"
        if chosen.ends(j) == (specimens.low[j], specimens.high[j]):
            sentence += ", which is the one to quote"
        if over.differ:
            sentence += f"; the specimens differ by more than the noise explains ({over.test})"
        said.append(f"{sentence}.")
    return said


def _words_of(found: Comparison) -> list[str]:
    chosen = found.chosen
    return [
        f"{chosen.name} by uniaxial tension up to {100 * found.window:.0f} % strain, RMS error "
        f"{in_units(chosen.rmse, 'pressure')} of stress; looked at for softening up to twice that strain."
    ]


def report(found: Comparison, remarks: list[str], console: Console) -> None:
    """Materials by rank, mu by window, and the verdicts."""
    table = PrintedTable(title=f"materials up to {100 * found.window:.0f} % strain", title_justify="left")
    for heading in ("", "constants", "mu at rest", "RMS error", "AIC", "stable"):
        words = heading in ("", "constants")
        table.add_column(heading, justify="left" if words else "right", no_wrap=words)
    best = found.judged[0].akaike
    for one in found.judged:
        space = one.fit.fitting.space
        constants = "\n".join(
            f"{name.removeprefix('material.')} {in_units(float(f'{x:.4g}'), kind)} {_half(one, j)}"
            for j, (name, kind, x) in enumerate(zip(space.names, space.kinds, one.fit.x, strict=True))
        )
        table.add_row(
            one.name,
            constants,
            in_units(float(f"{float(one.material.shear_modulus()):.4g}"), "pressure"),
            in_units(float(f"{one.rmse:.3g}"), "pressure"),
            f"+{one.akaike - best:.1f}" if np.isfinite(one.akaike) else "too few points",
            "yes" if not one.softens else f"to {100 * min(s.strain for s in one.softens):.0f} %",
        )
    console.print(table)
    windows = PrintedTable(title="neo-Hookean mu by window", title_justify="left")
    for heading in ("strain up to", "mu", "95 % interval"):
        windows.add_column(heading, justify="right")
    for one in found.windows:
        ends = f"{in_units(one.low, 'pressure')} to {in_units(one.high, 'pressure')}"
        windows.add_row(f"{100 * one.strain:.0f} %", in_units(one.mu, "pressure"), ends)
    if found.windows:
        console.print(windows)
    for remark in remarks:
        console.print(remark, soft_wrap=True, highlight=False)


def _half(one: FittedMaterial, j: int) -> str:
    """Half of the interval of a constant, relative."""
    low, high = one.ends(j)
    half = 0.5 * (high - low) / abs(one.fit.x[j])
    return f"±{100 * half:.1f} %" if half < 1 else "(uncertain)"


def _write_table(path: Path, found: Comparison) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["material", "constant", "value_SI", "low_SI", "high_SI", "rmse_kPa", "aic"])
        for one in found.judged:
            for j, name in enumerate(one.fit.fitting.space.names):
                ends = (float(one.fit.x[j]), *one.ends(j))
                writer.writerow([one.name, name.removeprefix("material."), *ends, one.rmse / kPa, one.akaike])


def _summary(found: Comparison, remarks: list[str]) -> dict[str, Any]:
    def one(judged: FittedMaterial) -> dict[str, Any]:
        names = [name.removeprefix("material.") for name in judged.fit.fitting.space.names]
        return {
            "constants": dict(zip(names, map(float, judged.fit.x), strict=True)),
            "rmse": judged.rmse,
            "aic": judged.akaike if np.isfinite(judged.akaike) else None,
            "softens": [{"mode": s.mode, "strain": s.strain} for s in judged.softens],
        }

    return {
        "units": "SI",
        "window": found.window,
        "chosen": found.chosen.name,
        "materials": {judged.name: one(judged) for judged in found.judged},
        "neo_hookean_mu": [dataclasses.asdict(window) for window in found.windows],
        "remarks": remarks,
        **versions(),
    }


def draw(found: Comparison, path: Path) -> None:
    """The test and every material over twice its window; the mu of every window."""
    from softgrip_jax import plots

    top = min(BEYOND * found.window, float(found.curve.x.max()) * 1.05)
    x = np.linspace(0, top, 120)
    lines = []
    for one in found.judged:
        test = one.fit.modules()[STRIP]
        y = np.array(
            [float(test.stress(jnp.asarray(v))) if float(test.bearable(jnp.asarray(v))) > 0 else np.nan for v in x]
        )
        lines.append(plots.Line(one.name, x, y / kPa, np.full_like(x, np.nan)))
    curve = found.curve
    shown = curve.x <= top
    points = plots.Points("measured", curve.x[shown], curve.y[shown] / kPa, (curve.x <= found.window)[shown])
    title = f"fitted up to {100 * found.window:.0f} % strain"
    panels = [plots.Panel(title, "engineering strain", "engineering stress (kPa)", [points], lines)]
    if len(found.windows) > 1:
        at = np.array([w.strain for w in found.windows])
        mu = np.array([w.mu for w in found.windows]) / kPa
        line = plots.Line("neo-Hookean", at, mu, np.full_like(mu, np.nan))
        own = plots.Points("fits", at, mu, np.ones_like(at, dtype=bool))
        panels.append(plots.Panel("mu by window", "largest strain of the window", "mu (kPa)", [own], [line]))
    plots.measured_and_fitted(panels).savefig(path)
