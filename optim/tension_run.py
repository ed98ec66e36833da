"""[tension]: which material describes a tension test, over which strains, and where it would go wrong beyond them.

    [tension]
    file = "tension.csv"                        # beside the config; a list: several specimens
    strain = { column = "strain", unit = "%" }           # engineering
    stress = { column = "stress", unit = "MPa" }         # engineering: force over undeformed area
    window_percent = 100                        # the strains that shall be met; left out: the whole test
    compare_percent = [25, 50, 100, 200]        # windows in which the neo-Hookean mu is compared
    materials = ["NeoHookean", "Yeoh"]          # left out: all of them

Every material is fitted by least squares in the window, and they are compared by Akaike's criterion in its corrected
form (Hurvich and Tsai 1989), n ln(SSR/n) + 2 K + 2 K (K + 1) / (n - K - 1) with K parameters, the noise among them: the
lowest is the best, and a difference of ten leaves little doubt. The points of one test follow each other, so it tends
to choose the larger of two materials; the table shows the errors too. Written is the best that is stable up to twice
the window.

The folder: config.toml, material.toml (the best), materials.csv, result.json, fit.png.
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
from softgrip_jax.errors import ConfigError, InputError, located
from softgrip_jax.materials import Material
from softgrip_jax.progress import Tell, silent, stages
from softgrip_jax.results import in_units
from softgrip_jax.sections import Table
from softgrip_jax.tables import Table as PrintedTable
from softgrip_jax.units import kPa

from .calibrate import Fit, calibrate, finished, with_noise
from .calibrate_files import material_text, provenance
from .calibrate_settings import ColumnTable, column, read_specimens
from .curve_files import Curve
from .fitting import Fitting
from .records import told, versions
from .run import new_folder
from .tension import BEYOND, CANDIDATES, Softening, Tension, candidate, softening
from .variables import to_free

COMPARED = (25.0, 50.0, 100.0, 200.0, 400.0)
"""Percent: windows in which mu is compared, where a config names none."""

DEPENDS = 1.2
"""mu that differs by more than this factor between windows depends on the window."""

STARTS = 16
"""Several exponents of an Ogden material fit nearly as well: more starts than for a scene."""


class TensionTable(Table):
    file: str | list[str]
    strain: ColumnTable
    stress: ColumnTable
    materials: list[Literal[tuple(CANDIDATES)]] = pydantic.Field(  # type: ignore[valid-type]
        default=list(CANDIDATES), min_length=1
    )
    window_percent: float | None = pydantic.Field(default=None, gt=0)
    compare_percent: list[float] | None = None
    seed: int = pydantic.Field(default=0, ge=0)


@dataclasses.dataclass(frozen=True)
class Judged:
    """One material on the test."""

    name: str
    fit: Fit
    material: Material
    akaike: float
    softens: list[Softening]

    @property
    def rmse(self) -> float:
        """Pa."""
        return self.fit.rmse(0)


@dataclasses.dataclass(frozen=True)
class Window:
    """The neo-Hookean mu of one window, Pa."""

    strain: float
    mu: float
    low: float
    high: float


@dataclasses.dataclass(frozen=True)
class Comparison:
    """All materials on one test."""

    curve: Curve
    window: float
    """Largest strain that was fitted."""
    judged: list[Judged]
    """Best first."""
    windows: list[Window]
    remarks: tuple[str, ...] = ()
    """What was left out, in sentences."""

    @property
    def chosen(self) -> Judged:
        """The best that is stable; the best, where none is."""
        return next((one for one in self.judged if not one.softens), self.judged[0])


def compare(
    curve: Curve, materials: list[str], window: float, windows: list[float], seed: int = 0, tell: Tell = silent
) -> Comparison:
    """Fit every material to a curve up to a strain, and the neo-Hookean mu in several windows."""
    inside = curve.x <= window * (1 + 1e-9)
    _require_points(curve, inside, window)
    judged, remarks = [], []
    for name in materials:
        tell(f"fitting {name}")
        tried = candidate(name, curve.x[inside], curve.y[inside])
        fitting = Fitting({TEST: Tension(tried.start)}, tried.variables, [_part(curve, inside)])
        fit = calibrate(fitting, STARTS if len(tried.variables) > 1 else 1, seed, canonical=tried.canonical)
        material = fit.modules()[TEST].material
        if not bool(material.is_stable_at_rest()):
            remarks.append(f"{name} is left out: {_softer_than_nothing(material)}.")
            continue
        judged.append(Judged(name, fit, material, akaike(fit), softening(material, window)))
    if not judged:
        raise InputError(f"No material describes this test. {' '.join(remarks)}")
    judged.sort(key=lambda one: one.akaike)
    found = neo_hookean_windows(curve, windows)
    known = {one.strain for one in found}
    weak = [f"{100 * w:.0f} %" for w in windows if w not in known and _points_inside(curve, w) >= LEAST_POINTS]
    if weak:
        remarks.append(
            f"There is no neo-Hookean mu up to {' and '.join(weak)} strain: on the whole the stresses there are not "
            "above zero."
        )
    return Comparison(curve, window, judged, found, tuple(remarks))


def _softer_than_nothing(material: Material) -> str:
    modulus = in_units(float(f"{float(material.shear_modulus()):.3g}"), "pressure")
    return f"its best fit has a shear modulus of {modulus} at rest, and no material has a negative one"


TEST = "test"


def akaike(fit: Fit) -> float:
    """Corrected Akaike criterion."""
    n, k = int(fit.used.sum()), fit.fitting.space.size + 1
    square = float(np.sum(fit.errors[fit.used] ** 2))
    correction = 2 * k * (k + 1) / (n - k - 1) if n > k + 1 else np.inf
    # Numbers that were computed and not measured may be met exactly.
    return n * float(np.log(max(square / n, np.finfo(float).tiny))) + 2 * k + correction


def neo_hookean_windows(curve: Curve, windows: list[float]) -> list[Window]:
    """mu and its 95 % interval in each window that has three points or more, and on the whole a positive stress."""
    tried = candidate("NeoHookean", curve.x, curve.y)
    fitting = Fitting({TEST: Tension(tried.start)}, tried.variables, [curve])
    start = to_free(fitting.space.inside(fitting.space.to_unit(fitting.space.reference)))
    found = []
    for window in windows:
        inside = curve.x <= window * (1 + 1e-9)
        if _points_inside(curve, window) >= LEAST_POINTS:
            lane = fitting.lane(start, weight=jnp.asarray(inside.astype(float)))
            fit = finished(fitting, with_noise(fitting, lane))
            if fit.on_bound.any():
                continue  # the least-squares mu is zero or negative: a slack specimen, or a load cell below its zero
            found.append(Window(window, float(fit.x[0]), float(fit.low[0]), float(fit.high[0])))
    return found


LEAST_POINTS = 3


def _points_inside(curve: Curve, window: float) -> int:
    return int(np.sum(curve.x <= window * (1 + 1e-9)))


def _part(curve: Curve, inside: np.ndarray) -> Curve:
    specimen = None if curve.specimen is None else curve.specimen[inside]
    return dataclasses.replace(curve, x=curve.x[inside], y=curve.y[inside], specimen=specimen)


def _require_points(curve: Curve, inside: np.ndarray, window: float) -> None:
    if inside.sum() < LEAST_POINTS + 3:
        raise InputError(
            f"{inside.sum()} of {len(curve.x)} points are in the window of {100 * window:g} % strain; materials are "
            f"compared on {LEAST_POINTS + 3} or more."
        )
    if np.max(curve.x[inside]) <= 0 or np.max(curve.y[inside]) <= 0:
        raise InputError("The test has no positive strains and stresses; both are positive in tension.")


# --- the command ------------------------------------------------------------------------------------------------------


def read(path: Path) -> tuple[TensionTable, Curve]:
    """The section [tension] and its data."""
    where = f"{path}, [tension]"
    table: TensionTable = configs.validated(TensionTable, configs.read_sections(path)["tension"], where)
    x, y = column(table.strain, "number", where), column(table.stress, "pressure", where)
    found = read_specimens(path.parent, table.file, "tension", x, y)
    if table.compare_percent is not None and any(not w > 0 for w in table.compare_percent):
        raise ConfigError(f"{where}: compare_percent is {table.compare_percent}; strains are positive.")
    return table, Curve("tension test", TEST, "stress", "pressure", **found)


def run_tension(config: Path, out: Path | None, console: Console) -> Path:
    """Compare materials as the config says; the folder that holds it."""
    table, curve = read(config)
    given = configs.standalone(config)
    largest = float(curve.x.max())
    window = largest if table.window_percent is None else table.window_percent / 100
    windows = [w / 100 for w in table.compare_percent or COMPARED if w / 100 <= largest * (1 + 1e-9)]
    if table.compare_percent is None and largest not in windows:
        windows.append(largest)
    with new_folder(out, config.stem) as (folder, final):
        with located(f"{config}, [tension]"), stages(console) as tell:
            found = compare(curve, table.materials, min(window, largest), windows, table.seed, tell)
        remarks = verdicts(found)
        comment = "\n".join([provenance(config.name), *_words_of(found)])
        (folder / "config.toml").write_bytes(given)
        (folder / "material.toml").write_text(material_text(found.chosen.material, comment), encoding="utf-8")
        _write_table(folder / "materials.csv", found)
        (folder / "result.json").write_text(json.dumps(_summary(found, remarks), indent=2), encoding="utf-8")
        draw(found, folder / "fit.png")
    report(found, remarks, console)
    command = 'material = "material.toml" in a config in this folder.'
    console.print(told("fit", final, command), soft_wrap=True)
    return final


def verdicts(found: Comparison) -> list[str]:
    """How far to trust it, in sentences."""
    said = [*found.curve.notes, *found.remarks]
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
    if chosen is not found.judged[0]:
        said.append(f"{found.judged[0].name} fits best but softens; {chosen.name} is the best that stays stable.")
    said.append(
        f"Written is {chosen.name}, fitted up to {100 * found.window:.0f} % strain; beyond, and in stretches other "
        "than those of a strip, it is an extrapolation."
    )
    return said


SOFT, STIFF = 1e3, 20e6
"""Pa: shear moduli of the softest gels and the hardest rubbers."""


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
            f"{name.removeprefix('material.')} {in_units(float(f'{x:.4g}'), kind)} {_half(one.fit, j)}"
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


def _half(fit: Fit, j: int) -> str:
    """Half of the interval of a parameter, relative."""
    half = 0.5 * (fit.high[j] - fit.low[j]) / abs(fit.x[j])
    return f"±{100 * half:.1f} %" if half < 1 else "(uncertain)"


def _write_table(path: Path, found: Comparison) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["material", "constant", "value_SI", "low_SI", "high_SI", "rmse_kPa", "aic"])
        for one in found.judged:
            for j, name in enumerate(one.fit.fitting.space.names):
                ends = (float(one.fit.x[j]), float(one.fit.low[j]), float(one.fit.high[j]))
                writer.writerow([one.name, name.removeprefix("material."), *ends, one.rmse / kPa, one.akaike])


def _summary(found: Comparison, remarks: list[str]) -> dict[str, Any]:
    def one(judged: Judged) -> dict[str, Any]:
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
        test = one.fit.modules()[TEST]
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
