"""How a page draws sections, curves and elasticities: Bokeh figures that are filled again and again."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
from bokeh.events import Tap
from bokeh.models import (
    ColumnDataSource,
    CustomJS,
    DataRange1d,
    FactorRange,
    HoverTool,
    LabelSet,
    PanTool,
    PointDrawTool,
    Range1d,
    ResetTool,
    SaveTool,
    Span,
    TapTool,
    WheelZoomTool,
)
from bokeh.plotting import figure

from ..geometry import Force, Outline, Section
from ..geometry.sections import LINES, ROLES
from ..units import DISPLAY, kPa
from .answers import CurveData, Helps, with_unit

BLUE, VERMILION, GREEN = "#0072B2", "#D55E00", "#00795A"
LOOKS: dict[str, dict[str, Any]] = {
    "object": {"fill": "#EFE3C6", "line": "#8A6D1D", "width": 1.0, "alpha": 1.0},
    "ghost": {"fill": "#FFFFFF", "line": "#A0A0A0", "width": 0.8, "alpha": 0.0},
    "air": {"fill": "#D3E4F1", "line": "#D3E4F1", "width": 0.0, "alpha": 1.0},
    "body": {"fill": "#4D4D4D", "line": "#4D4D4D", "width": 0.0, "alpha": 1.0},
    "wall": {"fill": BLUE, "line": BLUE, "width": 0.3, "alpha": 1.0},
    "tight": {"fill": VERMILION, "line": VERMILION, "width": 0.3, "alpha": 1.0},
    "membrane": {"fill": BLUE, "line": BLUE, "width": 0.0, "alpha": 1.0},
    "cover": {"fill": BLUE, "line": "#FFFFFF", "width": 0.5, "alpha": 1.0},
    "force": {"fill": VERMILION, "line": VERMILION, "width": 0.5, "alpha": 1.0},
}
"""Areas: colour, edge, its width in points and how far they cover what is behind."""
LINE_LOOKS = {"face": (BLUE, 1.2), "edge": ("#333333", 1.5), "contact": (VERMILION, 4.0), "axis": ("#8A6D1D", 1.0)}
"""Lines: colour and width."""
HEAD, SHAFT = 0.35, 0.06
"""Of an arrow's length: its head, and half the width of its shaft."""
ROOM, FULL = 0.12, 0.6
"""Axes are wider than what is first drawn by this part of it. They stay as they are while that fills more than this
part of them: moving a slider does not move the axes, which cost more to draw than all the rest."""
FINE = 60
"""An outline of more points is drawn by every second of them."""
Columns = dict[str, Any]
"""Of a data source: name -> list."""
PIN_COLOURS = ("#E69F00", "#00795A", "#CC79A7", "#56B4E9", "#6E6E6E", "#000000")
SPREAD = """
const {points, rest} = packed.data;
const flat = new Float32Array(points[0].buffer, points[0].byteOffset, points[0].length);
const {areas: of_areas, lines: of_lines, counts} = JSON.parse(rest[0]);
let at = 0;
const next = (count) => flat.subarray(at, at += count);
const filled = (columns, counts) => {
  const pairs = counts.map((count) => [next(count), next(count)]);
  return {...columns, xs: pairs.map(([x]) => x), ys: pairs.map(([, y]) => y)};
};
areas.setv({data: filled(of_areas, counts[0])}, {sync: false});
lines.setv({data: filled(of_lines, counts[1])}, {sync: false});
"""
"""Fills areas and lines of a view from what `packed` holds. The server need not know."""
DRAWN = """
requestAnimationFrame(() => setTimeout(() => {
  const mine = (window.softgrip ||= {drawn: []});
  mine.drawn.push(performance.now());
}, 0));
"""
"""The browser's own clock, each time that a picture has been drawn."""


def arrow(force: Force) -> np.ndarray:
    """The outline of an arrow."""
    ahead = force.end - force.start
    side = np.array([-ahead[1], ahead[0]])
    neck = force.start + (1 - HEAD) * ahead
    half = SHAFT * side
    left = [force.start + half, neck + half, neck + 3 * half]
    return np.array([*left, force.end, neck - 3 * half, neck - half, force.start - half])


def _joined(outlines: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """x and y of several outlines as one, with NaN between them: arrays travel many times faster than lists."""
    gap = np.full((1, 2), np.nan)
    parts: list[np.ndarray] = []
    for points in outlines:
        shown = points if len(points) < FINE else np.concatenate([points[::2], points[-1:]])
        parts += [shown, gap]
    x, y = np.concatenate(parts[:-1]).astype(np.float32).T
    return np.ascontiguousarray(x), np.ascontiguousarray(y)


def areas_and_lines(section: Section) -> tuple[Columns, Columns, Columns]:
    """Columns of the areas and the lines of a view, from the back to the front, a row a role; and of its words."""
    areas: Columns = {name: [] for name in ("xs", "ys", "fill", "line", "width", "alpha", "role")}
    lines: Columns = {name: [] for name in ("xs", "ys", "line", "width", "role")}
    words: Columns = {name: [] for name in ("x", "y", "text")}

    def add(columns: Columns, role: str, outlines: list[np.ndarray], look: dict[str, Any]) -> None:
        if outlines:
            x, y = _joined(outlines)
            for name, value in ({"xs": x, "ys": y, "role": role} | look).items():
                columns[name].append(value)

    for role in ROLES:
        outlines = list(section.of_role(role))
        if role in LINES:
            add(lines, role, outlines, dict(zip(("line", "width"), LINE_LOOKS[role], strict=True)))
        else:
            add(areas, role, outlines, LOOKS[role])
    add(areas, "force", [arrow(force) for force in section.forces], LOOKS["force"])
    # Fingers that press alike do it on each other's words.
    for force in {force.text: force for force in section.forces}.values():
        x, y = np.round(force.start + 1.2 * (force.end - force.start), 3)
        for name, value in (("x", float(x)), ("y", float(y)), ("text", force.text)):
            words[name].append(value)
    return areas, lines, words


def packed(areas: Columns, lines: Columns) -> Columns:
    """All points as one array, x and y of an outline after the other: every array is two messages of its own."""
    rows = [pair for one in (areas, lines) for pair in zip(one["xs"], one["ys"], strict=True)]
    points = np.concatenate([part for pair in rows for part in pair]) if rows else np.zeros(0, np.float32)
    rest = {
        name: {key: column for key, column in one.items() if key not in ("xs", "ys")}
        for name, one in (("areas", areas), ("lines", lines))
    }
    counts = [[len(x) for x in one["xs"]] for one in (areas, lines)]
    return {"points": [points], "rest": [json.dumps(rest | {"counts": counts})]}


class View:
    """One flat view."""

    def __init__(self, section: Section, is_timed: bool):
        areas, lines, words = areas_and_lines(section)
        self.areas, self.lines, self.words = ColumnDataSource(areas), ColumnDataSource(lines), ColumnDataSource(words)
        self.packed = ColumnDataSource({"points": [], "rest": []})
        self.corners = ColumnDataSource({"x": [], "y": []})
        self._frame(section)
        tools = [PanTool(), WheelZoomTool(), ResetTool(), SaveTool()]
        self.figure: Any = figure(
            tools=tools,
            active_scroll=None,
            match_aspect=True,
            x_range=DataRange1d(range_padding=0.02),
            y_range=DataRange1d(range_padding=0.02),
            x_axis_label=section.horizontal,
            y_axis_label=section.vertical,
            sizing_mode="stretch_width",
            height=330,
            min_width=200,
            toolbar_location="above",
            output_backend="canvas",
        )
        plain_figure(self.figure)
        frame = self.figure.scatter("x", "y", source=self.corners, alpha=0.0)
        self.figure.x_range.renderers = self.figure.y_range.renderers = [frame]
        self.figure.patches(
            "xs",
            "ys",
            source=self.areas,
            fill_color="fill",
            line_color="line",
            line_width="width",
            fill_alpha="alpha",
        )
        self.figure.multi_line("xs", "ys", source=self.lines, line_color="line", line_width="width")
        labels = LabelSet(
            x="x",
            y="y",
            text="text",
            source=self.words,
            text_color="#A03F00",
            text_align="center",
            text_font_size="12px",
        )
        self.figure.add_layout(labels)
        filled = CustomJS(args={"packed": self.packed, "areas": self.areas, "lines": self.lines}, code=SPREAD)
        self.packed.js_on_change("data", filled)
        if is_timed:
            self.packed.js_on_change("data", CustomJS(code=DRAWN))
        self.figure.tags = [self.packed]  # what nothing of the page refers to does not reach the browser

    def show(self, section: Section) -> None:
        """Fill it again."""
        areas, lines, words = areas_and_lines(section)
        self._frame(section)
        if words != self.words.data:
            self.words.data = words
        self.packed.data = packed(areas, lines)

    def _frame(self, section: Section) -> None:
        """Axes that hold all of it, with some room, where those of now do not or are much too wide."""
        left, right, low, high = section.limits()
        frame: Any = self.corners.data
        x, y = frame["x"], frame["y"]
        holds = bool(x) and x[0] <= left and right <= x[1] and y[0] <= low and high <= y[1]
        if holds and max((right - left) / (x[1] - x[0]), (high - low) / (y[1] - y[0])) > FULL:
            return
        wide, tall = ROOM * (right - left), ROOM * (high - low)
        self.corners.data = {"x": [left - wide, right + wide], "y": [low - tall, high + tall]}


def plain_figure(one: Any) -> None:
    """One look for every figure; words dark enough to be read."""
    one.toolbar.logo = None
    one.grid.grid_line_color = "#ECECEC"
    one.outline_line_color = None
    for axis in one.axis:
        axis.axis_label_text_font_style = "normal"
        axis.axis_label_text_color = axis.major_label_text_color = "#333333"


class Axis:
    """The range of one axis: it stays while what is drawn fills it well, and where the user has moved it."""

    def __init__(self, room: float = ROOM):
        """room: beside what is drawn, a part of its length."""
        self.range, self._room = Range1d(0, 1), room
        self._held: tuple[float, float] | None = None

    @property
    def middle(self) -> float:
        """Of what is shown."""
        shown: Any = self.range
        return 0.5 * (shown.start + shown.end)

    def hold(self, values: Any) -> None:
        """Be wide enough for all finite values."""
        known = np.asarray(values, dtype=float)
        known = known[np.isfinite(known)]
        if not len(known):
            return
        low, high = float(known.min()), float(known.max())
        if self._held is not None:
            left, right = self._held
            if left <= low and high <= right and high - low > FULL * (right - left):
                return
        wide = self._room * (high - low) or 0.1 * abs(high) or 1.0
        self._held = low - wide, high + wide
        start, end = self._held
        self.range.update(start=start, end=end, reset_start=start, reset_end=end)


class CurveView:
    """An observable over the pressure, with the limit, the first contact, pinned curves and a point to be dragged."""

    def __init__(self, dragged: Any):
        """dragged: called with a pressure, Pa."""
        empty = {"x": [], "y": []}
        self.stable, self.unstable = ColumnDataSource(dict(empty)), ColumnDataSource(dict(empty))
        self.marks = ColumnDataSource({"x": [], "y": [], "text": [], "align": []})
        self.now = ColumnDataSource(dict(empty))
        self.pins = ColumnDataSource({"xs": [], "ys": [], "colour": [], "name": []})
        self._across, self._up = Axis(), Axis(room=0.2)
        self.figure: Any = figure(
            tools=[PanTool(), WheelZoomTool(), ResetTool(), SaveTool()],
            active_scroll=None,
            active_drag=None,
            x_axis_label="pressure (kPa)",
            x_range=self._across.range,
            y_range=self._up.range,
            sizing_mode="stretch_width",
            height=280,
            min_width=200,
            toolbar_location="above",
        )
        plain_figure(self.figure)
        self.figure.multi_line("xs", "ys", source=self.pins, line_color="colour", line_width=1.5, line_dash="dotdash")
        self.figure.line("x", "y", source=self.stable, line_color=BLUE, line_width=2.2)
        self.figure.line("x", "y", source=self.unstable, line_color=BLUE, line_width=2.0, line_dash="dashed")
        self.figure.scatter("x", "y", source=self.marks, size=9, marker="diamond", color=GREEN)
        labels = LabelSet(x="x", y="y", text="text", source=self.marks, y_offset=6, text_font_size="11px")
        labels.text_align, labels.text_color = "align", "#005A43"
        self.figure.add_layout(labels)
        self._point = point = self.figure.scatter(
            "x", "y", source=self.now, size=14, color=VERMILION, line_color="white"
        )
        drag = PointDrawTool(renderers=[point], add=False)
        self.figure.add_tools(drag)
        self.figure.toolbar.active_tap = drag
        self.figure.add_tools(HoverTool(tooltips=[("pressure", "@x{0.000} kPa"), ("value", "@y")], renderers=[point]))
        self._placed: float | None = None
        """Where the page itself has put the point, kPa. Bokeh tells of that only when its whole message is written."""

        def moved(attribute: str, old: Any, new: Any) -> None:
            if len(new["x"]) == 1 and new["x"][0] != self._placed:
                self._placed = None
                dragged(max(float(new["x"][0]), 0.0) * kPa)

        self.now.on_change("data", moved)

    def show(self, curve: CurveData, kind: str) -> None:
        """Another curve."""
        unit = DISPLAY[kind][1]
        x, y = curve.pressure / kPa, curve.value / unit
        last = int(np.count_nonzero(curve.stable))
        before = np.flatnonzero(curve.stable & np.isfinite(y))
        self.stable.data = {"x": x[:last].tolist(), "y": y[:last].tolist()}
        self.unstable.data = {"x": x[max(last - 1, 0) :].tolist(), "y": y[max(last - 1, 0) :].tolist()}
        marks: Columns = {"x": [], "y": [], "text": []}
        if curve.end:
            marks = {"x": [x[before[-1]]], "y": [y[before[-1]]], "text": [curve.end]}
        if curve.contact is not None:
            marks["x"].append(curve.contact / kPa)
            marks["y"].append(y[curve.pressure == curve.contact][0])
            marks["text"].append("contact")
        marks["align"] = ["left"] * len(marks["x"])
        self.marks.data = marks
        self._hold()
        self.figure.yaxis.axis_label = with_unit(curve.observable, kind)

    def clear(self) -> None:
        """Nothing but the pins: another scene has another curve, and a compiler may be waited for until it is there."""
        self.marks.data = {"x": [], "y": [], "text": [], "align": []}
        for source in (self.stable, self.unstable, self.now):
            source.data = {"x": [], "y": []}

    def _hold(self) -> None:
        """Axes for the curve, its pins and the present state."""
        each: list[Any] = [self.stable.data, self.unstable.data, self.now.data]
        pins: Any = self.pins.data
        for axis, one, many in ((self._across, "x", "xs"), (self._up, "y", "ys")):
            axis.hold([value for data in each for value in data[one]] + [v for row in pins[many] for v in row])
        # Words go from their mark towards the middle, so that no border cuts them off.
        marks: Any = self.marks.data
        middle = self._across.middle
        align = ["left" if x < middle else "right" for x in marks["x"]]
        if align != marks["align"]:
            self.marks.data = marks | {"align": align}

    def show_state(self, pressure: float, value: float, kind: str) -> None:
        """The point of the present state."""
        self._placed = pressure / kPa
        self.now.data = {"x": [self._placed], "y": [value / DISPLAY[kind][1]]}
        self._hold()

    def dim_point(self, is_last: bool) -> None:
        """Whether the point is of the last state, and not of what is asked."""
        colour = LOOKS["ghost"]["line"] if is_last else VERMILION
        if self._point.glyph.fill_color != colour:
            self._point.glyph.fill_color = colour

    def show_pins(self, curves: list[tuple[str, CurveData]], kind: str) -> None:
        """The curves of pinned designs."""
        columns: Columns = {"xs": [], "ys": [], "colour": [], "name": []}
        for k, (name, curve) in enumerate(curves):
            columns["xs"].append((curve.pressure / kPa).tolist())
            columns["ys"].append((curve.value / DISPLAY[kind][1]).tolist())
            columns["colour"].append(PIN_COLOURS[k % len(PIN_COLOURS)])
            columns["name"].append(name)
        shown: Any = self.pins.data
        if columns["name"] or shown["name"]:
            self.pins.data = columns
            self._hold()


class HelpView:
    """Elasticities as bars; a click on one moves its slider so that the observable grows."""

    def __init__(self, clicked: Any):
        """clicked: called with (key, elasticity)."""
        self.source = ColumnDataSource({"key": [], "value": [], "colour": [], "text": []})
        self._across = Axis()
        self.figure: Any = figure(
            x_range=self._across.range,
            y_range=FactorRange(),
            tools=[TapTool()],
            toolbar_location=None,
            sizing_mode="stretch_width",
            height=240,
            min_width=200,
            x_axis_label="% for 1 % more of",
        )
        plain_figure(self.figure)
        self.figure.hbar(y="key", right="value", height=0.7, source=self.source, color="colour", nonselection_alpha=1.0)
        self.figure.add_layout(Span(location=0, dimension="height", line_color="#333333", line_width=1))

        def tapped(event: Any) -> None:
            keys = list(self.source.data["key"])
            if not keys or event.y is None:
                return
            # A click anywhere in the row of a bar counts: short bars are hard to hit.
            row = round(float(event.y) - 0.5)
            if 0 <= row < len(self.figure.y_range.factors):
                key = self.figure.y_range.factors[row]
                clicked(key, self.source.data["value"][keys.index(key)])

        self.figure.on_event(Tap, tapped)

    def show(self, helps: Helps) -> None:
        """Other bars, the longest above."""
        bars = helps.bars[:12]
        keys = [key for key, _ in bars]
        if list(self.figure.y_range.factors) != keys[::-1]:
            self.figure.y_range.factors = keys[::-1]
        values = [round(value, 4) for _, value in bars]
        colours = [BLUE if value >= 0 else VERMILION for value in values]
        self.source.data = {"key": keys, "value": values, "colour": colours, "text": [f"{v:+.2f}" for v in values]}
        self._across.hold([0.0, *values])
        self.figure.height = 90 + 22 * max(len(keys), 2)


IN_FRONT = 0.3
"""mm by which lines in space are drawn before the surfaces that they lie on, which would hide half of them."""
HEAD_FACES = 12
"""Of the cone that is the head of an arrow in space."""
GAP = np.full((1, 3), np.nan)
"""Between two lines in space."""
DIAGONAL = 1.5
"""Of the box around a picture in space, in the units of Plotly's camera, which stands right for a little more."""
BEYOND = 1.25
"""The text of an arrow in space stands so many of its lengths from its start."""


def outline_in_space(section: Section, outline: Outline) -> list[np.ndarray]:
    """The edges of what a view shows as one outline, in space, mm; of something flat where its width is not known."""
    points, half = outline.points, outline.across
    if not half:
        return section.in_space(np.column_stack([points + np.array([0.0, IN_FRONT]), np.zeros(len(points))]))
    near, far = (np.column_stack([points, np.full(len(points), side * (half + IN_FRONT))]) for side in (-1, 1))
    if outline.role in LINES or len(points) == 2:
        return section.in_space(np.concatenate([near, far[::-1], near[:1]]))
    between = np.stack([near, far, np.full(near.shape, np.nan)], axis=1).reshape(-1, 3)
    return section.in_space(np.concatenate([near, near[:1], GAP, far, far[:1], GAP, between[:-1]]))


def arrows_in_space(sections: tuple[Section, ...]) -> list[tuple[np.ndarray, str]]:
    """Start and end of every force, mm, shape (2, 3), and its text. Two views of a membrane show the same force, where
    they cut the contact: those of the first view that has any are all."""
    for section in sections:
        if section.forces:
            flat = [(np.column_stack([np.stack([f.start, f.end]), np.zeros(2)]), f.text) for f in section.forces]
            return [(placed, text) for points, text in flat for placed in section.in_space(points)]
    return []


def _line_trace(name: str, lines: list[np.ndarray], colour: str, width: float) -> dict[str, Any]:
    """Several lines in space as one trace, with NaN between them."""
    x, y, z = np.round(np.concatenate([part for line in lines for part in (line, GAP)]), 3).T
    look = {"mode": "lines", "line": {"color": colour, "width": width}, "hoverinfo": "name", "showlegend": False}
    return {"type": "scatter3d", "x": x, "y": y, "z": z, "name": name, "connectgaps": False} | look


def _cones(arrows: list[np.ndarray]) -> dict[str, Any]:
    """The heads of arrows as one trace: each its tip and a ring around its neck."""
    turn = np.arange(HEAD_FACES) * 2 * np.pi / HEAD_FACES
    points, faces = [], []
    for start, end in arrows:
        ahead = end - start
        side, up = np.linalg.svd(ahead[None])[2][1:]
        ring = np.outer(np.cos(turn), side) + np.outer(np.sin(turn), up)
        neck = end - HEAD * ahead + 2 * SHAFT * np.linalg.norm(ahead) * ring
        first, k = (1 + HEAD_FACES) * len(points), np.arange(HEAD_FACES)
        faces.append(first + np.stack([0 * k, 1 + k, 1 + (k + 1) % HEAD_FACES], axis=-1))
        points.append(np.concatenate([end[None], neck]))
    (x, y, z), (i, j, k) = np.round(np.concatenate(points), 3).T, np.concatenate(faces).T
    look = {"color": VERMILION, "flatshading": True, "hoverinfo": "skip", "name": "force"}
    return {"type": "mesh3d", "x": x, "y": y, "z": z, "i": i, "j": j, "k": k} | look


def _section_traces(sections: tuple[Section, ...]) -> list[dict[str, Any]]:
    """What is without pressure, what touches, and the forces: from the flat views, each in its plane in space."""
    traces = []
    for role, colour, width in (("ghost", LOOKS["ghost"]["line"], 1.5), ("contact", VERMILION, 6.0)):
        each = [(section, one) for section in sections for one in section.outlines if one.role == role]
        lines = [line for section, one in each for line in outline_in_space(section, one)]
        if lines:
            traces.append(_line_trace(role, lines, colour, width))
    arrows = arrows_in_space(sections)
    if arrows:
        ends = [points for points, _ in arrows]
        beyond = [start[None] + BEYOND * (end - start) for start, end in ends]
        lines = [line for pair in zip(ends, beyond, strict=True) for line in pair]
        shafts = _line_trace("force", lines, VERMILION, 6.0)
        shown = [text for _, text in arrows]
        if len(shown) > 1 and len(set(shown)) == 1:  # around an axis: where the arrows end there is room for one text
            shown = [f"each {shown[0]}", *[""] * (len(shown) - 1)]
        words = [word for text in shown for word in ("", "", "", text, "")]
        font = {"color": "#A03F00", "size": 12}
        shafts |= {"mode": "lines+text", "text": words, "textfont": font, "textposition": "middle center"}
        shafts |= {"hoverinfo": "text", "hovertext": [f"force {text}" for _, text in arrows for _ in range(5)]}
        traces += [shafts, _cones(ends)]
    return traces


def space_figure(mesh: Any, sections: tuple[Section, ...] = ()) -> dict[str, Any]:
    """A mesh as a figure of Plotly, as plain data: to be turned and zoomed; with what the sections of the same solution
    add: the ghost without pressure, the contact, and the forces as arrows."""
    colours = {"cover": BLUE, "chamber": "#8FBFE0", "membrane": BLUE, "object": "#D9C48F", "body": "#6A6A6A"}
    traces = _section_traces(sections)
    for kind, colour in colours.items():
        three = mesh.of_kind(kind)
        if not len(three):
            continue
        used, places = np.unique(three, return_inverse=True)
        i, j, k = places.reshape(-1, 3).T
        x, y, z = np.round(mesh.points[used].T * 1e3, 3)
        trace = {"type": "mesh3d", "x": x, "y": y, "z": z, "i": i, "j": j, "k": k, "name": kind, "color": colour}
        trace |= {"flatshading": kind != "membrane", "hoverinfo": "name", "opacity": 0.55 if kind == "object" else 1.0}
        pressed = mesh.values.get("contact_pressure")
        if kind == "membrane" and pressed is not None:
            trace |= {"intensity": pressed[used] / kPa, "colorscale": "Viridis", "colorbar": {"title": "contact (kPa)"}}
        traces.append(trace)
    axes = {f"{name}axis": {"title": {"text": f"{name} (mm)"}} for name in "xyz"}
    size = np.array([np.ptp(np.concatenate([t[name][np.isfinite(t[name])] for t in traces])) for name in "xyz"])
    ratio = DIAGONAL * size / np.linalg.norm(size)
    box = dict(zip("xyz", map(float, ratio), strict=True))
    scene = axes | {"aspectmode": "manual", "aspectratio": box}
    margin = dict.fromkeys("lrtb", 0)
    return {"data": traces, "layout": {"scene": scene, "margin": margin, "uirevision": "kept", "autosize": True}}
