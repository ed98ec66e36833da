"""The tab "Study": a study beneath the folder that the explorer was started in, as scatter, parallel axes and map.

A click on a design opens it. The scenes are those of the config that `softgrip sweep` leaves beside the store; where
there is none, the numbers of the design go into the scene of the page.
"""

from __future__ import annotations

import dataclasses
import math
from collections import deque
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
import panel as pn
import xarray as xr
from bokeh.models import ColorBar, ColumnDataSource, HoverTool, LinearColorMapper, TapTool
from bokeh.palettes import Viridis256
from panel.models.plotly import PlotlyPlot

from .. import config as configs
from ..commands.sweep import SweepTable, keys_in, table_of_designs
from ..config.keys import observed, varied
from ..errors import ConfigError, InputError
from ..parameters import Parameter, Parameters
from ..progress import Tell
from ..quantities import LIMIT_MARGIN, NO_LIMIT_MARGIN, REQUIRED, Quantity, QuantitySet
from ..results import Status
from ..scene import Scene
from ..study import load_study
from ..study.dataset import answers, designs_in, pieces, quantities_of, rows_of, tied_in, variable_name, varied_in
from ..study.store import BEGUN, OLD_RESULT, STORE, opened
from ..units import DISPLAY
from .answers import with_unit
from .page import Page
from .tabs import Line, chart

DEEP, MOST_FOLDERS, MOST_STUDIES = 6, 3000, 200
"""How far a folder is looked through: a home directory would take minutes."""
MOST_POINTS, MOST_LINES = 4000, 800
"""Designs in the scatter, and lines through parallel axes: more are too slow in a browser, and nobody tells them
apart."""
MOST_TOLD = 4
"""Questions of a study whose statuses are told."""
MOST_AXES = 10
"""Parallel ones."""
A_CELL, MOST_BINS = 6, 40
"""Designs in a cell of a map on average, and cells along each side at most."""
NARROW = 40
"""A grid of so few values along a side has a cell for each."""
COLOURS = {
    Status.OK: "#0072B2",
    Status.NO_CONTACT: "#8A8A8A",
    Status.BEYOND_LIMIT: "#D55E00",
    Status.IMPOSSIBLE: "#CC79A7",
    Status.NOT_CONVERGED: "#000000",
}
LARGE_POINT, SMALL_POINT, FEW_POINTS = 8, 5, 1500
"""Sizes of points, of so many and of more."""
SEEN, FAINT = 0.85, 0.05
"""How dark a point is between the marks on the parallel axes, and elsewhere."""


def is_inside(path: Path, root: Path) -> bool:
    """Whether a path, all its links followed, is in a folder or is it."""
    return path.resolve().is_relative_to(root.resolve())


def _require_inside(paths: list[Path], place: Path, root: Path) -> None:
    if not all(is_inside(path, root) for path in paths):
        raise ConfigError(f"{place} is not in {root}, where the explorer was started.")


def studies_beneath(root: Path) -> dict[str, Path]:
    """The folders and stores of studies in a folder, by their path from it; links are not followed out of it."""
    found: dict[str, Path] = {}
    at_hand = deque([(root.resolve(), 0)])
    for _ in range(MOST_FOLDERS):
        if not at_hand or len(found) >= MOST_STUDIES:
            break
        folder, deep = at_hand.popleft()
        try:
            entries = sorted(folder.iterdir())
        except OSError:
            continue
        names = {entry.name for entry in entries}
        if STORE in names or OLD_RESULT in names:
            inside = [folder / name for name in (STORE, OLD_RESULT) if name in names]
            if all(is_inside(path, root) for path in inside):
                found[str(folder.relative_to(root.resolve()))] = folder
        for entry in entries:
            if entry.name.startswith(".") or entry.is_symlink() or not entry.is_dir():
                continue
            if entry.suffix == ".zarr":
                if entry.name != STORE and (entry / "zarr.json").is_file():
                    found[str(entry.relative_to(root.resolve()))] = entry
            elif deep < DEEP:
                at_hand.append((entry, deep + 1))
    return found


@dataclasses.dataclass(frozen=True)
class Studied:
    """A study that is open: some of its designs in memory, the others on the disk.

    Args:
        data: the whole, lazily.
        varied: names of the numbers that vary.
        quantities: names of the variables that hold quantities.
        kinds: of both, by name.
        rows: of the designs in memory, SI, by name; statuses, too.
        parameters: how a design's numbers go into scenes; None where the study has no config.
        asked: the quantities by the names of their variables, as far as the config tells them.
    """

    data: xr.Dataset
    varied: list[str]
    quantities: list[str]
    kinds: dict[str, str]
    rows: dict[str, np.ndarray]
    parameters: Parameters | None
    asked: dict[str, Quantity]

    @property
    def count(self) -> int:
        """Designs in memory."""
        return len(self.rows[self.varied[0]])

    def shown(self, name: str) -> np.ndarray:
        """A column in the unit that people read."""
        return self.rows[name] / DISPLAY[self.kinds[name]][1]

    def label(self, name: str) -> str:
        """The name of a column with its unit."""
        return with_unit(tied_in(self.data, name), self.kinds[name])

    def status(self, name: str) -> np.ndarray:
        """The statuses of the state of a quantity; of the first one for a number that varies."""
        of = name if name in self.quantities else self.quantities[0]
        return self.rows[self.data[of].attrs["status"]]

    def scene(self, row: int, name: str, present: Scene) -> tuple[Scene, float | dict[str, float] | None]:
        """(the scene of a design, the pressure or the task at which a quantity is asked, as `Session.open` takes it);
        present: what takes the numbers where the study has no config."""
        parameters = self.parameters or _parameters({"scene": present}, self.varied, {})
        x = jnp.asarray([float(self.rows[one][row]) for one in self.varied])
        scenes = parameters.scenes_at(x)
        about = self.asked.get(name) or next(iter(self.asked.values()), None)
        if about is None:
            return next(iter(scenes.values())), None
        scene, at = scenes[about.scene], about.at
        if isinstance(at, tuple):
            return scene, dict([at])
        return scene, {} if at == REQUIRED else at if isinstance(at, float) else None


def _parameters(scenes: Mapping[str, Any], names: list[str], whole: dict[str, str]) -> Parameters:
    """How numbers of a study go into scenes; whole: the names of tied numbers by the first of them."""
    leaves = list(dict.fromkeys(name.partition("[")[0] for name in names))
    found = Parameters(scenes, [Parameter(whole.get(leaf, leaf)) for leaf in leaves])
    if found.names != names:
        raise InputError(f"The study varies {', '.join(names)}; the scene has {', '.join(found.names)}.")
    return found


def _config_of(folder: Path, root: Path, names: list[str]) -> tuple[Parameters | None, dict[str, Quantity]]:
    """What the config beside a store says of its scenes and quantities."""
    path = folder / "config.toml"
    if not path.is_file():
        return None, {}
    read = configs.load(path)
    where = f"{path}, [sweep]"
    table: SweepTable = configs.validated(SweepTable, read.tables.get("sweep", {}), where)
    keys = [variable.name for variable in table.variables]
    if not keys:  # the columns of a CSV are named as variables are
        file = folder / str(table.file)
        _require_inside([file], file, root)
        keys = [keys_in(column) for column in table_of_designs(file, str(path))[0][1]]
    whole = {}
    for key in keys:
        name = varied(read.scenes, key, where).name
        whole[name.split("=")[0].strip()] = name
    wanted = QuantitySet(read.scenes, observed(read.scenes, table.observables, where))
    by_name = dict(zip(map(variable_name, wanted.labels()), wanted.quantities, strict=True))
    return _parameters(read.scenes, names, whole), by_name


def _spread(count: int, most: int) -> np.ndarray:
    """Places of so many out of a count at most, evenly spread."""
    return np.linspace(0, max(count - 1, 0), min(count, most)).round().astype(int)


def _require_known(place: Path, kinds: dict[str, str], statuses: dict[str, np.ndarray]) -> None:
    """ConfigError where a study has a kind of quantity or a status that is not known here: another version wrote it."""
    strange = [f"{name} is of the kind {kind!r}" for name, kind in kinds.items() if kind not in DISPLAY]
    for name, values in statuses.items():
        strange += [f"{name} has the status {code}" for code in sorted(set(values.ravel().tolist()) - set(Status))]
    if strange:
        raise ConfigError(f"{place} cannot be read: {strange[0]}, which this version of softgrip_jax does not know.")


def open_study(place: Path, root: Path) -> Studied:
    """Open the study in a folder or a store.

    Args:
        place: the folder, or a store.
        root: the folder outside of which nothing is read.

    Raises:
        InputError: where there is no finished study, or the place is outside.
    """
    files = [place, place / STORE, place / OLD_RESULT, place / "config.toml"]
    _require_inside(files, place, root)
    data = load_study(place) if (place / OLD_RESULT).is_file() else opened(place)
    names, quantities = varied_in(data), quantities_of(data)
    total = designs_in(data)
    part = rows_of(data, _spread(total, MOST_POINTS))
    statuses = [data[name].attrs["status"] for name in quantities]
    rows = {name: np.asarray(part[name].values) for name in (*names, *quantities, *statuses)}
    kinds = {name: data[name].attrs["kind"] for name in (*names, *quantities)}
    _require_known(place, kinds, {name: rows[name] for name in statuses})
    parameters, asked = _config_of(place, root, names)
    return Studied(data, names, quantities, kinds, rows, parameters, asked)


# --- a map ------------------------------------------------------------------------------------------------------------


def edges_of(study: Studied, name: str) -> np.ndarray:
    """The edges of the cells along a number that varies, SI: around the values of a grid, else evenly spaced."""
    values = np.unique(study.data[name].values if study.data[name].dims == (name,) else study.rows[name])
    if 1 < len(values) <= NARROW:
        middle = 0.5 * (values[1:] + values[:-1])
        return np.concatenate([[2 * values[0] - middle[0]], middle, [2 * values[-1] - middle[-1]]])
    low, high = float(values[0]), float(values[-1])
    bins = int(np.clip(np.sqrt(designs_in(study.data) / A_CELL), 3, MOST_BINS))
    return np.linspace(low, high, bins + 1) if high > low else np.array([0.9 * low, 1.1 * low + (low == 0)])


def binned_mean(study: Studied, x: str, y: str, value: str) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """(edges of x, edges of y, means, counts) of a quantity over two numbers, SI, over all designs that have an answer.

    A design without a limit has no margin before it: inf, or `NO_LIMIT_MARGIN` in older studies. The means have shape
    (cells of x, cells of y), NaN where a cell has no design.
    """
    ends = edges_of(study, x), edges_of(study, y)
    shape = len(ends[0]) - 1, len(ends[1]) - 1
    is_margin = LIMIT_MARGIN in value
    total, count = np.zeros(shape), np.zeros(shape, int)
    for part in pieces(study.data, list(dict.fromkeys([x, y, value, study.data[value].attrs["status"]]))):
        known = answers(study.data, part, value) & np.isfinite(part[value])
        known &= ~(is_margin & (part[value] == NO_LIMIT_MARGIN))
        places = [
            np.clip(np.searchsorted(edges, part[name][known], side="right") - 1, 0, size - 1)
            for name, edges, size in zip((x, y), ends, shape, strict=True)
        ]
        np.add.at(total, tuple(places), part[value][known])
        np.add.at(count, tuple(places), 1)
    mean = np.where(count > 0, total / np.maximum(count, 1), np.nan)
    return *ends, mean, count


# --- the tab ----------------------------------------------------------------------------------------------------------


class StudyTab:
    """The tab: a menu of studies, a scatter, parallel axes and a map.

    Args:
        page: of the explorer.
        root: the folder that is looked through; by default the one that the explorer was started in.
    """

    def __init__(self, page: Page, root: Path | None = None):
        self.page, self.session = page, page.session
        self.root = (root or Path.cwd()).resolve()
        self.study: Studied | None = None
        self.places: dict[str, Path] = {}
        self._brushed: dict[int, list[tuple[float, float]]] = {}
        self.menu = pn.widgets.Select(name="study", options=[], width=300)
        self.again = pn.widgets.Button(name="look again", width=100)
        self.open_button = pn.widgets.Button(name="open study", button_type="primary", width=110)
        self.x = pn.widgets.Select(name="across", options=[], width=180)
        self.y = pn.widgets.Select(name="up", options=[], width=180)
        self.map_x = pn.widgets.Select(name="map across", options=[], width=150)
        self.map_y = pn.widgets.Select(name="map up", options=[], width=150)
        self.map_value = pn.widgets.Select(name="map of", options=[], width=180)
        self.line = Line()
        self.points = ColumnDataSource({})
        self.parallel: Any = pn.Column(sizing_mode="stretch_width", height=330)
        self.scatter, self.map = pn.Column(sizing_mode="stretch_width"), pn.Column(sizing_mode="stretch_width")
        for column in (self.scatter, self.map):
            column.styles, column.min_width = {"flex": "1 1 380px"}, 260
        self._filling = False
        self._place: Path | None = None
        """What was asked for last: one that was read slowly does not take the place of it."""
        self.again.on_click(lambda event: self.look())
        self.open_button.on_click(lambda event: self.open())
        for menu in (self.x, self.y):
            menu.param.watch(lambda event: self._scatter_again(), "value")
        for menu in (self.map_x, self.map_y, self.map_value):
            menu.param.watch(lambda event: self._map_again(), "value")
        self.points.selected.on_change("indices", lambda attribute, old, new: self._tapped(new))
        self.axes = pn.FlexBox(self.x, self.y, self.map_x, self.map_y, self.map_value, visible=False)
        self.panel = pn.Column(
            pn.FlexBox(self.menu, self.open_button, self.again, align_items="flex-end"),
            self.line.pane,
            self.axes,
            pn.FlexBox(self.scatter, self.map, sizing_mode="stretch_width", align_items="flex-start"),
            self.parallel,
            sizing_mode="stretch_width",
        )
        self.look()

    # --- what a user does ---------------------------------------------------------------------------------------------

    def look(self) -> None:
        """Look for studies again."""
        self.places = studies_beneath(self.root)
        names = list(self.places)
        kept = self.menu.value if self.menu.value in names else (names[0] if names else None)
        self.menu.param.update(options=names, value=kept)
        found = f"{len(names)} stud{'y' if len(names) == 1 else 'ies'}" if names else "There is no study"
        where = "in the folder that the explorer was started in"
        self.line.say(f"{found} {where}" + ("." if names else ": softgrip sweep writes one."))

    def open(self) -> None:
        """Open the study that the menu names."""
        place = self.places.get(self.menu.value or "")
        if place is None:
            self.line.say("There is no study to open.", True)
            return
        self.line.say("reading ...")
        self._place = place
        self.page.in_background(partial(self._read, place))

    def open_design(self, row: int) -> None:
        """Show a design that is in memory on the sliders."""
        if self.study is None or not 0 <= row < self.study.count:
            return
        try:
            name = next((n for n in (self.y.value, self.x.value) if n in self.study.quantities), "")
            scene, at = self.study.scene(row, name, self.session.current())
            self.page.open_scene(scene, at)
        except InputError as error:
            self.line.say(str(error), True)
            return
        numbers = ", ".join(f"{n} {self.study.shown(n)[row]:.5g}" for n in self.study.varied)
        self.line.say(f"opened: {numbers}")

    def brush(self, restyled: Any) -> None:
        """Marks on the parallel axes: points outside of them are faint. restyled: as Plotly tells it."""
        if self.study is None or not restyled:
            return
        for key, value in restyled[0].items():
            head, _, rest = key.partition("].")
            if rest != "constraintrange" or not head.removeprefix("dimensions[").isdigit():
                continue
            axis = int(head.removeprefix("dimensions["))
            ranges = np.array(value if value is not None else [], dtype=float).reshape(-1, 2)
            self._brushed[axis] = [(float(low), float(high)) for low, high in ranges]
        self.points.patch({"alpha": [(slice(None), self._alpha())]})

    # --- in a thread --------------------------------------------------------------------------------------------------

    def _read(self, place: Path, tell: Tell) -> None:
        def if_wanted(act: Callable[[], None]) -> None:
            self.page.later(lambda: act() if place == self._place else None)

        try:
            study = open_study(place, self.root)
            if_wanted(lambda: self._show(study))
        except InputError as error:
            sentence = str(error)
            if_wanted(lambda: self.line.say(sentence, True))
        except Exception as error:  # a store may be damaged in many ways
            fault = f"{place.name} cannot be read: {type(error).__name__}: {error}"
            if_wanted(lambda: self.line.say(fault, True))

    # --- what is shown ------------------------------------------------------------------------------------------------

    def _show(self, study: Studied) -> None:
        if self.study is not None:
            self.study.data.close()
        self.study, self._brushed = study, {}
        every = [*study.quantities, *study.varied]
        self._filling = True
        self.x.param.update(options=study.varied + study.quantities, value=study.varied[0])
        self.y.param.update(options=every, value=study.quantities[0])
        self.map_x.param.update(options=study.varied, value=study.varied[0])
        self.map_y.param.update(options=study.varied, value=study.varied[min(1, len(study.varied) - 1)])
        self.map_value.param.update(options=study.quantities, value=study.quantities[0])
        self._filling = False
        for menu in (self.map_x, self.map_y, self.map_value):
            menu.visible = len(study.varied) > 1
        self.axes.visible = True
        self._scatter_again()
        self._map_again()
        self.page.with_library(PlotlyPlot, lambda: self._show_axes(parallel_axes(study)))
        total = designs_in(study.data)
        counts = study.data.attrs.get(BEGUN, {}).get("statuses", {})
        told = [", ".join(f"{n} {status}" for status, n in one.items()) for one in counts.values()][:MOST_TOLD]
        if len(told) > 1:
            labels = [study.data[name].attrs["long_name"].removeprefix("status at ") for name in counts]
            told = [f"{label}: {words}" for label, words in zip(labels, told, strict=False)]
        part = f", {study.count:,} of them drawn" if study.count < total else ""
        words = f" ({'; '.join(told)})" if told else ""
        self.line.say(f"{total:,} designs{part}{words}. A click on a point opens its design.")

    def _show_axes(self, shown: dict[str, Any]) -> None:
        if self.parallel.objects:
            self.parallel[0].object = shown
            return
        pane = pn.pane.Plotly(shown, sizing_mode="stretch_width", height=330)
        pane.param.watch(lambda event: self.brush(event.new), "restyle_data")
        self.parallel.append(pane)

    def _scatter_again(self) -> None:
        study = self.study
        if study is None or self._filling:
            return
        statuses = study.status(self.y.value if self.y.value in study.quantities else self.x.value)
        made = chart(study.label(self.x.value), study.label(self.y.value))
        self.points.selected.indices = []
        self.points.data = {
            "x": study.shown(self.x.value),
            "y": study.shown(self.y.value),
            "status": [Status(int(s)).name for s in statuses],
            "colour": [COLOURS[Status(int(s))] for s in statuses],
            "alpha": self._alpha(),
        }
        size = LARGE_POINT if study.count < FEW_POINTS else SMALL_POINT
        made.scatter("x", "y", source=self.points, size=size, color="colour", alpha="alpha", legend_group="status")
        made.add_tools(TapTool(), HoverTool(tooltips=[("across", "@x"), ("up", "@y"), ("status", "@status")]))
        words = made.legend[0]
        words.orientation, words.border_line_color, words.padding = "horizontal", None, 0
        made.add_layout(words, "above")
        self.scatter.objects = [pn.pane.Bokeh(made, sizing_mode="stretch_width")]

    def _alpha(self) -> np.ndarray:
        assert self.study is not None
        inside = np.ones(self.study.count, bool)
        for axis, ranges in self._brushed.items():
            if ranges:
                values = self.study.shown(axes_of(self.study)[axis])
                inside &= np.any([(values >= low) & (values <= high) for low, high in ranges], axis=0)
        return np.where(inside, SEEN, FAINT)

    def _map_again(self) -> None:
        study = self.study
        if study is None or self._filling:
            return
        if len(study.varied) < 2:
            self.map.objects = []
            return
        x, y, value = self.map_x.value, self.map_y.value, self.map_value.value
        if x == y:
            self.map.objects = [pn.pane.HTML("A map needs two different numbers.")]
            return

        def work(tell: Tell) -> None:
            found = binned_mean(study, x, y, value)
            self.page.later(lambda: self._show_map(study, (x, y, value), found))

        self.page.in_background(work)

    def _show_map(self, study: Studied, names: tuple[str, str, str], found: Any) -> None:
        if study is self.study and names == (self.map_x.value, self.map_y.value, self.map_value.value):
            self.map.objects = [pn.pane.Bokeh(map_figure(study, *names, *found), sizing_mode="stretch_width")]

    def _tapped(self, rows: list[int]) -> None:
        if rows:
            self.open_design(int(rows[0]))


def axes_of(study: Studied) -> list[str]:
    """What the parallel axes are of."""
    return [*study.varied, *study.quantities][:MOST_AXES]


def parallel_axes(study: Studied) -> dict[str, Any]:
    """Lines through one axis a number and a quantity, as a figure of Plotly; designs without an answer have none."""
    names = axes_of(study)
    columns = np.array([study.shown(name) for name in names])
    answered = [answers(study.data, study.rows, name) for name in study.quantities]
    whole = np.flatnonzero(np.all(np.isfinite(columns), axis=0) & np.all(answered, axis=0))
    kept = (
        whole[np.unique(np.linspace(0, max(len(whole) - 1, 0), MOST_LINES).round().astype(int))]
        if len(whole)
        else whole
    )
    axes = [
        {"label": study.label(name), "values": column[kept].tolist()}
        for name, column in zip(names, columns, strict=True)
    ]
    line = {"color": columns[names.index(study.quantities[0])][kept].tolist(), "colorscale": "Viridis"}
    layout = {"margin": {"l": 60, "r": 80, "t": 80, "b": 20}, "font": {"size": 11}, "autosize": True}
    return {"data": [{"type": "parcoords", "line": line, "dimensions": axes, "labelangle": -20}], "layout": layout}


def map_figure(
    study: Studied, x: str, y: str, value: str, x_edges: np.ndarray, y_edges: np.ndarray, mean: Any, count: Any
) -> Any:
    """The means of a quantity over two numbers, as coloured cells."""
    units = [DISPLAY[study.kinds[name]][1] for name in (x, y, value)]
    made = chart(study.label(x), study.label(y))
    i, j = np.nonzero(count)
    shown = mean[i, j] / units[2]
    low, high = (float(np.min(shown)), float(np.max(shown))) if len(shown) else (0.0, 1.0)
    colours = LinearColorMapper(
        palette=Viridis256, low=low, high=high if high > low else math.nextafter(high, math.inf)
    )
    cells = {
        "left": x_edges[i] / units[0],
        "right": x_edges[i + 1] / units[0],
        "bottom": y_edges[j] / units[1],
        "top": y_edges[j + 1] / units[1],
        "mean": shown,
        "count": count[i, j],
    }
    made.quad(
        left="left",
        right="right",
        bottom="bottom",
        top="top",
        source=ColumnDataSource(cells),
        line_color=None,
        fill_color={"field": "mean", "transform": colours},
    )
    made.add_layout(ColorBar(color_mapper=colours, title=study.label(value), title_text_font_style="normal"), "right")
    made.add_tools(HoverTool(tooltips=[("mean", "@mean"), ("designs", "@count")]))
    return made


def study_tab(page: Page) -> Any:
    """What Panel shows in the tab."""
    return StudyTab(page).panel
