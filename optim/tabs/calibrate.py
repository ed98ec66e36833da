"""The tab "Calibrate": a CSV file of a measured curve, the numbers that shall explain it, and how sure they are.

It is `optim.calibrate` in a thread of the explorer's process. The file stays in memory as text: nothing is written, and
nothing in it is run.
"""

from __future__ import annotations

import re
import threading
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import panel as pn
from bokeh.models import ColumnDataSource, HoverTool, Span
from panel.models.file_dropper import FileDropper

from softgrip_jax.config.csv_text import cells_of
from softgrip_jax.errors import ConfigError, InputError
from softgrip_jax.explorer.looks import BLUE, VERMILION
from softgrip_jax.explorer.page import CSS, Page, list_html, table_html
from softgrip_jax.explorer.tabs import Line, Newest, chart, ended, side_by_side, told
from softgrip_jax.progress import Tell
from softgrip_jax.results import in_units
from softgrip_jax.units import kPa, number_of

from ..calibration.data import MISSING, UNITS, Column, Curve, check_pressures, columns_of, decoded, heading_of
from ..calibration.fit import calibrate
from ..calibration.intervals import METHODS
from ..calibration.model import Fitting
from ..calibration.report import WORDS, Findings, examine, interval_text
from .numbers import SCENE, Ticks, variables

LARGEST = 2 * 1024 * 1024
"""Bytes of a file: a hundred thousand points of two columns, which no fit needs."""
MOST_POINTS = 5000
"""Each point is solved at every step of the fit."""
HEAD_LINES = 200
"""A header stands within so many lines."""
REPEATS = 200
"""Fits of a bootstrap: quick enough to wait for; the command does 1000."""
GREY = "#8A8A8A"
UNSAID = "?"
"""The unit of a column whose heading has one that is not known, until somebody chooses one."""


class CalibrateTab:
    """The tab: a file and its columns, the parameters, the fit.

    Args:
        page: of the explorer.
    """

    def __init__(self, page: Page):
        self.page, self.session = page, page.session
        self.text, self.name = "", ""
        self.findings: Findings | None = None
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None
        self.file = pn.widgets.FileDropper(
            multiple=False, max_file_size=f"{LARGEST // 1024}KB", max_files=1, height=105, sizing_mode="stretch_width"
        )
        self.x_column = pn.widgets.Select(name="column of the pressure", options=[], width=190)
        self.x_unit = pn.widgets.Select(name="unit", options=list(UNITS["pressure"]), width=80)
        self.y_column = pn.widgets.Select(name="column of the measurement", options=[], width=190)
        known = list(self.session.observables)
        self.observable = pn.widgets.Select(name="which is", options=known, value=self.session.observable, width=150)
        self.y_unit = pn.widgets.Select(name="unit", options=self._units(), width=80)
        self.method = pn.widgets.Select(name="intervals", options={WORDS[m]: m for m in METHODS}, width=160)
        self.ticks = Ticks(page, "what shall be fitted")
        self.run_button = pn.widgets.Button(name="fit", button_type="primary", width=80)
        self.stop_button = pn.widgets.Button(name="stop", disabled=True, width=80)
        self.use_button = pn.widgets.Button(name="use these numbers", disabled=True, width=160)
        self.line = Line()
        self.pictures = pn.FlexBox(sizing_mode="stretch_width", align_items="flex-start")
        self.table = pn.pane.HTML("", stylesheets=[CSS], sizing_mode="stretch_width")
        self.file.param.watch(lambda event: self._dropped(event.new), "value")
        self.observable.param.watch(lambda event: self._observable_set(), "value")
        self.x_column.param.watch(lambda event: self._column_set(0), "value")
        self.y_column.param.watch(lambda event: self._column_set(1), "value")
        self.run_button.on_click(lambda event: self.run())
        self.stop_button.on_click(lambda event: self.stop())
        self.use_button.on_click(lambda event: self.use())
        page.after_opening.append(self._refill)
        ended(page, self._stop.set)
        drop = pn.pane.HTML(
            "<b>a measured curve</b>: drop a CSV file with a header here, or choose one", margin=(4, 10, 0, 10)
        )
        columns = pn.FlexBox(self.x_column, self.x_unit, self.y_column, self.observable, self.y_unit, self.method)
        dropper = pn.Column(sizing_mode="stretch_width", min_height=105)
        page.with_library(FileDropper, lambda: dropper.append(self.file))
        self.panel = pn.Column(
            drop,
            dropper,
            columns,
            self.ticks.panel,
            pn.FlexBox(self.run_button, self.stop_button, self.use_button),
            self.line.pane,
            self.pictures,
            self.table,
            sizing_mode="stretch_width",
        )

    # --- what a user does ---------------------------------------------------------------------------------------------

    @property
    def is_running(self) -> bool:
        """Whether a fit is under way."""
        return self._thread is not None and self._thread.is_alive()

    def upload(self, name: str, content: bytes | str) -> None:
        """Take a file: its columns go to the menus."""
        self.text, self.name = "", name
        try:
            if len(content) > LARGEST:
                raise ConfigError(f"{name}: the file has {len(content):,} bytes; it may have {LARGEST:,} at most.")
            text = content if isinstance(content, str) else decoded(content, Path(name))
            header = header_of(text, name)
        except InputError as error:
            self.line.say(str(error), True)
            return
        self.text = text
        x = next((c for c in header if re.match(r"p($|[\W_])|.*pressure", c, re.IGNORECASE)), header[0])
        y = next((c for c in header if c != x and self.observable.value.split(".")[0] in c), None)
        y = y or next(c for c in header if c != x)
        self.x_column.param.update(options=header, value=x)
        self.y_column.param.update(options=header, value=y)
        self._guess(0)
        self._guess(1)
        said, is_wrong = self._units_said()
        self.line.say(f"{name}: the columns are {', '.join(header)}. {said}", is_wrong)

    def curve(self) -> Curve:
        """The measured curve that the menus name; InputError for what cannot be meant."""
        if not self.text:
            raise InputError("There is no measured curve; drop a CSV file first.")
        if self.x_column.value == self.y_column.value:
            raise InputError(f"Column {self.x_column.value!r} is both pressure and measurement; choose another one.")
        name, component, kind = self.session.observables[self.observable.value]
        if kind not in UNITS:
            raise InputError(f"{self.observable.value} is not measured by any file; choose another observable.")
        if UNSAID in (self.x_unit.value, self.y_unit.value):
            raise InputError(self._units_said()[0])
        path = Path(self.name)
        columns = [
            Column(self.x_column.value, "pressure", self.x_unit.value),
            Column(self.y_column.value, kind, self.y_unit.value),
        ]
        data, notes = columns_of(self.text, path, columns)
        if len(data) > MOST_POINTS:
            raise ConfigError(f"{path}: the curve has {len(data):,} points; it may have {MOST_POINTS:,} at most.")
        notes += check_pressures(path.stem, data[:, 0], path)
        return Curve(path.stem, SCENE, name, kind, data[:, 0], data[:, 1], component, notes=tuple(notes))

    def run(self) -> None:
        """Begin a fit from the state of the sliders."""
        if self.is_running:
            self.line.say("A fit runs already; stop it first.", True)
            return
        try:
            moving = variables(self.session, self.ticks.keys)
            fitting = Fitting({SCENE: self.session.current()}, moving, [self.curve()])
        except InputError as error:
            self.line.say(str(error), True)
            return
        self.findings = None
        self._stop.clear()
        self.stop_button.disabled, self.use_button.disabled = False, True
        self.table.object, self.pictures.objects = "", []
        self.line.say("compiling ...")
        self._thread = self.page.in_background(partial(self._fit, fitting, self.method.value))

    def stop(self) -> None:
        """End the work; a fit that is there is kept."""
        if self.is_running:
            self._stop.set()
            self.line.say("stopping ...")

    def use(self) -> None:
        """Set the sliders to the fitted numbers."""
        if self.findings is not None:
            self.page.open_scene(self.findings.fit.modules()[SCENE])

    # --- the menus ----------------------------------------------------------------------------------------------------

    def _dropped(self, files: dict[str, Any]) -> None:
        if files:
            name, content = list(files.items())[-1]
            self.upload(Path(name).name, content)

    def _kind(self) -> str:
        return self.session.observables[self.observable.value][2]

    def _units(self) -> list[str]:
        return list(UNITS.get(self._kind(), {}))

    def _observable_set(self) -> None:
        units = self._units()
        if units != [unit for unit in self.y_unit.options if unit != UNSAID]:
            self.y_unit.param.update(options=units, value=units[0] if units else None)
            self._column_set(1)

    def _column_set(self, which: int) -> None:
        self._guess(which)
        if self.text:
            self.line.say(*self._units_said())

    def _menus(self) -> list[tuple[Any, Any, str]]:
        """Of pressure and measurement: column, unit and kind."""
        return [(self.x_column, self.x_unit, "pressure"), (self.y_column, self.y_unit, self._kind())]

    def _guess(self, which: int) -> None:
        """The unit that stands in the name of a column; one that is not known there has to be chosen."""
        column, unit, kind = self._menus()[which]
        found, units = heading_of(str(column.value or ""), kind), list(UNITS.get(kind, {}))
        if found.unknown and units:
            unit.param.update(options=[UNSAID, *units], value=UNSAID)
        else:
            kept = unit.value if unit.value in units else next(iter(units), None)
            unit.param.update(options=units, value=found.unit or kept)

    def _units_said(self) -> tuple[str, bool]:
        """(a sentence about the unit of each column, whether one has to be chosen)."""
        said, is_wrong = [], False
        for column, unit, kind in self._menus():
            found = heading_of(str(column.value or ""), kind)
            if unit.value == UNSAID:
                is_wrong = True
                known = ", ".join(UNITS[kind])
                said.append(f"{column.value!r}: {found.unknown!r} is none of the units {known}; choose one of them.")
            elif found.unit is not None or found.unknown:
                said.append(f"{column.value!r} is read in {unit.value}.")
            else:
                said.append(f"{column.value!r} names no unit and is read in {unit.value}.")
        return " ".join(said), is_wrong

    def _refill(self) -> None:
        known = list(self.session.observables)
        if known != list(self.observable.options):
            kept = self.observable.value if self.observable.value in known else known[0]
            self.observable.param.update(options=known, value=kept)
            self._observable_set()

    # --- in the thread of the fit -------------------------------------------------------------------------------------

    def _fit(self, fitting: Fitting, method: str, tell: Tell) -> None:
        say = Newest(self.page, self._say)

        def report(stage: str, done: int = 0, total: int = 0) -> None:
            if self._stop.is_set():
                raise KeyboardInterrupt
            say.put(f"{stage}: {done} of {total}" if total else stage)

        with told(self.page, self._end, "The fit was stopped before it was found."):
            fit = calibrate(fitting, report=report)
            findings = examine(fit, [method], REPEATS, 0, report)
            band = fit.band(0)
            self.page.later(lambda: self._show(findings, band))

    # --- what is shown ------------------------------------------------------------------------------------------------

    def _say(self, sentence: str) -> None:
        if not self._stop.is_set() and self.findings is None:
            self.line.progress(sentence)

    def _end(self, sentence: str, is_wrong: bool = False) -> None:
        self.stop_button.disabled = True
        self.line.say(sentence, is_wrong)

    def _show(self, findings: Findings, band: Any) -> None:
        self.findings = findings
        fit, curve = findings.fit, findings.fit.fitting.curves[0]
        used = f"{int(fit.used.sum())} of {len(curve.x)} points"
        error = in_units(float(f"{fit.rmse(0):.3g}"), curve.kind)
        self._end(f"{used}; RMS error {error}{curve.share(fit.rmse(0), ' of the largest')}.")
        self.use_button.disabled = False
        space = fit.fitting.space
        rows = []
        for j, (name, kind) in enumerate(zip(space.names, space.kinds, strict=True)):
            ends = [interval_text(fit, one, j) for one in findings.intervals]
            rows.append([name, in_units(space.reference[j], kind), in_units(fit.x[j], kind), *ends])
        table = table_html(["", "start", "fit", *(WORDS[one.method] for one in findings.intervals)], rows)
        self.table.object = table + list_html(findings.remarks)
        fitted, residuals = fitted_figure(findings, band), residuals_figure(findings)
        residuals.x_range = fitted.x_range
        self.pictures.objects = [side_by_side(fitted), side_by_side(residuals)]


def header_of(text: str, name: str) -> list[str]:
    """The names of the columns: the line before the first line of numbers; ConfigError where there is none."""
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith("#")][:HEAD_LINES]
    for mark in ",;\t":
        rows = [_cells(line, mark) for line in lines]
        for head, row in pairwise(rows):
            if len(row) == len(head) > 1 and all(map(_is_number, row)) and any(map(_is_value, row)):
                header = [cell for cell in head if cell and head.count(cell) == 1]
                if len(header) > 1 and not any(map(_is_value, header)):
                    return header
    raise ConfigError(
        f"{name}: there is no header line with two names of columns above a line of numbers; decimals need a point."
    )


def _cells(line: str, mark: str) -> list[str]:
    """Empty where the line cannot be read: what is wrong with it is said where it is read for its numbers."""
    try:
        return [cell.strip() for cell in cells_of(line, mark)]
    except InputError:
        return []


def _is_number(cell: str) -> bool:
    return cell.lower() in MISSING or _is_value(cell)


def _is_value(cell: str) -> bool:
    value = number_of(cell)
    return value is not None and bool(np.isfinite(value))


def _points(made: Any, findings: Findings, values: np.ndarray) -> None:
    fit, curve = findings.fit, findings.fit.fitting.curves[0]
    for is_used, colour in ((True, VERMILION), (False, GREY)):
        own = fit.used == is_used
        if own.any():
            data = {"x": curve.x[own] / kPa, "y": values[own] / curve.unit[1]}
            dots = made.scatter(
                "x",
                "y",
                source=ColumnDataSource(data),
                size=7,
                color=colour,
                legend_label="measured" if is_used else "left out",
            )
            made.add_tools(HoverTool(tooltips=[("pressure", "@x kPa"), ("value", "@y")], renderers=[dots]))


def fitted_figure(findings: Findings, band: Any) -> Any:
    """Points, fit and its interval over the pressure."""
    curve = findings.fit.fitting.curves[0]
    label, unit = curve.unit
    x, y, half = (np.asarray(part) for part in band)
    known = np.isfinite(y) & np.isfinite(half)
    made = chart("pressure (kPa)", f"{curve.label} ({label})" if label else curve.label)
    x, y, half = x[known] / kPa, y[known] / unit, half[known] / unit
    made.varea(x=x, y1=y - half, y2=y + half, color=BLUE, alpha=0.25, legend_label="95 % interval of the fit")
    made.line(x, y, line_color=BLUE, line_width=2, legend_label="fit")
    _points(made, findings, curve.y)
    made.legend.location, made.legend.background_fill_alpha = "top_left", 0.6
    return made


def residuals_figure(findings: Findings) -> Any:
    """Fit less measurement over the pressure."""
    fit, curve = findings.fit, findings.fit.fitting.curves[0]
    label = curve.unit[0]
    made = chart("pressure (kPa)", f"fit - measured ({label})" if label else "fit - measured")
    made.add_layout(Span(location=0, dimension="width", line_color="#333333", line_width=1))
    _points(made, findings, fit.errors)
    made.legend.visible = False
    return made


def calibrate_tab(page: Page) -> Any:
    """What Panel shows in the tab."""
    return CalibrateTab(page).panel
