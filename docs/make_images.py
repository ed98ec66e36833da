"""The pictures of the README and the site: `python docs/make_images.py [NAME ...]` writes them into images/."""

from __future__ import annotations

import re
import sys
import tempfile
from functools import cache
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch
from rich.console import Console

import softgrip_jax as sg
from optim.calibration.run import run_calibrate
from optim.design.run import run_design
from softgrip_jax import cad, plots, thesis
from softgrip_jax.commands.export import draw_all
from softgrip_jax.commands.reproduce import run_reproduce
from softgrip_jax.commands.verify import run_verify
from softgrip_jax.plots import animate
from softgrip_jax.plots.figures import BLUE, BODY, ORANGE, STYLE, VERMILION
from softgrip_jax.study import Grid, Range
from softgrip_jax.units import gram, kPa, mm

HERE = Path(__file__).resolve().parent
IMAGES = HERE / "images"

SOLVER_STOPPED = 41.0
"""kPa: as far as the thesis's model predicts the blocked force of type A (section 6.3.2)."""


GROUND, PHYSICS, QUESTIONS, PEOPLE, SEARCHES = "#e4e4e4", "#cfe3f1", "#d9ead3", "#fdf0cc", "#f8d9c4"
KINDS = {
    PHYSICS: "materials objects membrane equations shell pneunet geometry model_error",
    QUESTIONS: "scene solvers questions results curve_scene quantities parameters study fidelity verify spread",
    PEOPLE: "config commands cli explorer plots report thesis cad draws __main__",
}
"""Colours of rooms; what is left is the ground, or of the package `optim`."""


def rooms() -> None:
    """The rooms in layers, each above all that it imports: read from the table of architecture.md."""
    page = (HERE / "architecture.md").read_text(encoding="utf-8")
    row = re.compile(r"^\| `([\w.]+)` \| [^|]+ \| ?([^|]*?) ?\|$", re.MULTILINE)
    below = {room: set(may.split(", ")) - {""} for room, may in row.findall(page)}

    def reached(room: str, seen: set[str]) -> set[str]:
        for other in below[room] - seen:
            seen.add(other)
            reached(other, seen)
        return seen

    everything = {room: reached(room, set()) for room in below}

    @cache
    def layer(room: str) -> int:
        """One above the highest room below; rooms that import each other share theirs."""
        same = {other for other in everything[room] if room in everything[other]} | {room}
        return max((layer(other) + 1 for one in same for other in below[one] - same), default=0)

    colours = {room: colour for colour, names in KINDS.items() for room in names.split()}
    layers = [sorted(room for room in below if layer(room) == k) for k in range(1 + max(map(layer, below)))]
    with mpl.rc_context(STYLE | {"svg.fonttype": "none", "svg.hashsalt": "rooms"}):
        ax = Figure(figsize=(8.4, 8.4)).subplots()
        for height, names in enumerate(layers):
            for k, name in enumerate(names):
                x = k - (len(names) - 1) / 2
                colour = colours.get(name, SEARCHES if name.startswith("optim") else GROUND)
                look = {"fc": colour, "ec": "none"}
                box = FancyBboxPatch((x - 0.46, height - 0.26), 0.92, 0.52, "round,pad=0,rounding_size=0.08", **look)
                ax.add_patch(box)
                ax.text(x, height, name, ha="center", va="center", fontsize=6)
        wide = max(map(len, layers)) / 2
        arrow = {"arrowstyle": "->", "color": BODY}
        ax.annotate("", (-wide - 0.2, -0.3), (-wide - 0.2, len(layers) - 0.7), arrowprops=arrow)
        words = {"rotation": 90, "ha": "right", "va": "center", "fontsize": 8, "color": BODY}
        ax.text(-wide - 0.3, len(layers) / 2, "may import", **words)
        ax.set(xlim=(-wide - 0.7, wide), ylim=(-0.6, len(layers) - 0.4))
        ax.axis("off")
        assert isinstance(ax.figure, Figure)
        ax.figure.savefig(IMAGES / "rooms.svg", metadata={"Date": None})


def fold() -> None:
    """Blocked force of type A against pressure, through the fold, for the exact section law and the thesis's."""
    laws = {"exact": ("exact law", BLUE), "thesis": ("the thesis's law", ORANGE)}
    with mpl.rc_context(STYLE):
        ax = Figure(figsize=(4.2, 3.0)).subplots()
        for law, (label, colour) in laws.items():
            # Next to the fold the chambers near the clamp would meet at their tops.
            scene = sg.pneunet.TipContact(sg.PneuNet.table_5_1("A"), section=law, ignored_rules=("chambers_apart",))
            curve, limit = sg.branch(scene), float(sg.limit_pressure(scene)) / kPa
            good = np.asarray(curve.status) == sg.Status.OK
            pressure, force = np.asarray(curve.pressure)[good] / kPa, np.asarray(curve.tip_force)[good]
            top = int(np.argmax(pressure))
            ax.plot(pressure[: top + 1], force[: top + 1], color=colour, label=label)
            ax.plot(pressure[top:], force[top:], color=colour, linestyle=(0, (3, 2)))
            ax.plot(limit, np.interp(limit, pressure[: top + 1], force[: top + 1]), "o", color=VERMILION, zorder=5)
            where, side = ((-7, 0), "right") if law == "thesis" else ((7, 0), "left")
            at = (limit, force[top])
            ax.annotate(f"limit {limit:.1f} kPa", at, where, textcoords="offset points", ha=side, va="center")
        ax.axvline(SOLVER_STOPPED, color=BODY, linewidth=0.9, linestyle=(0, (1, 1.5)))
        words = f"thesis's solver\nstopped: {SOLVER_STOPPED:.0f} kPa"
        ax.text(SOLVER_STOPPED - 0.4, 0.02, words, ha="right", color=BODY)
        ax.set(xlim=(20, 48), ylim=(0, 0.6), xlabel="pressure (kPa)", ylabel="tip force (N)")
        ax.legend(loc="upper left")
        figure = ax.figure
        assert isinstance(figure, Figure)
        figure.savefig(IMAGES / "fold.png")


def shell_grasp() -> None:
    """The shell gripper before and after `softgrip design configs/shell_grasp.toml`."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "run"
        run_design(HERE.parent / "configs" / "shell_grasp.toml", out, Console())
        (IMAGES / "shell_grasp.png").write_bytes((out / "before_after.png").read_bytes())


def reproduction() -> None:
    """The page of the comparison with the thesis, and its pictures."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "run"
        run_reproduce(out, Console())
        (HERE / "reproduction.md").write_bytes((out / "reproduction.md").read_bytes())
        for picture in (out / "images").iterdir():
            (IMAGES / picture.name).write_bytes(picture.read_bytes())


def verified() -> None:
    """A shell and a finger's cell by finite elements, with our models over them: some minutes."""
    with tempfile.TemporaryDirectory() as folder:
        for name, config in (("shell", "shell_free"), ("finger", "finger_free")):
            out = Path(folder) / name
            run_verify(
                HERE.parent / "configs" / f"{config}.toml",
                None,
                None,
                False,
                out,
                Path(folder) / "kept",
                True,
                Console(),
            )
            (IMAGES / f"verified_{name}.png").write_bytes((out / "shapes.png").read_bytes())


def inflation() -> None:
    """The shell of the thesis closes around its cylinder."""
    animate(thesis.cylinder_contact(), np.linspace(2.4, 20, 30) * kPa, IMAGES / "inflation.gif")


def gallery_scenes() -> None:
    """Pictures of scenes, as docs/gallery.md shows them."""
    shell, finger = thesis.shell(), sg.PneuNet.table_5_1("A")
    gripper = sg.pneunet.Gripper(finger, n=3, base_radius=19.61 * mm)
    rubber = {"friction": 0.96}
    objects = {
        "cylinder": (sg.objects.Cylinder(radius=18 * mm, mass=26 * gram, **rubber), None),
        "hexagonal_cylinder": (sg.objects.HexagonalCylinder(side=15 * mm, mass=35 * gram, **rubber), None),
        "three_face_cone": (sg.objects.ThreeFaceCone(side=70 * mm, height=80 * mm, mass=15 * gram, **rubber), 95 * mm),
        "cone": (sg.objects.Cone(radius=24 * mm, height=80 * mm, mass=15 * gram, **rubber), 100 * mm),
    }
    states = {
        "shell_flat": sg.solve(sg.shell.FlatContact(shell, distance=5 * mm), 15 * kPa),
        "shell_cylinder": sg.solve(thesis.cylinder_contact(), 15 * kPa),
        "chamber": sg.pneunet.chamber(finger, 31 * kPa, inclination=0.1),
        "finger_free": sg.solve(sg.pneunet.Free(finger, weight=(0.0, 0.0)), 31 * kPa),
        "finger_held": sg.solve(sg.pneunet.TipContact(finger), 31 * kPa),
        "finger_cell": sg.solve(sg.pneunet.TipContact(finger, drive="cell"), 20 * kPa),
    }
    for name, (held, distance) in objects.items():
        states[f"grasp_{name}"] = sg.pressure_for(sg.pneunet.Grasp(gripper, held, stand_distance=distance))
    for name, state in states.items():
        assert int(state.status) == sg.Status.OK, (name, state.reason_text())
        plots.draw(state).savefig(IMAGES / f"gallery_{name}.png", dpi=GALLERY_DPI)
    curve = plots.pressure_curve(sg.shell.Free(shell)).figure
    assert isinstance(curve, Figure)
    curve.savefig(IMAGES / "gallery_limit.png", dpi=GALLERY_DPI)


def gallery_runs() -> None:
    """Pictures of studies, searches and calibrations, as docs/gallery.md shows them."""
    grasp = thesis.shell_grasp(mass=563 * gram, friction=0.96)
    quantities = [sg.Quantity("pressure", at="required"), sg.Quantity("limit_margin", at="required")]
    designs = Grid([Range(8 * mm, 24 * mm).points(49), Range(0.5 * mm, 2 * mm).points(46)])
    data = sg.Study(grasp, ["shell.a", "shell.t_m"], quantities, designs).run()
    plots.study(data).savefig(IMAGES / "gallery_map.png", dpi=GALLERY_DPI)
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder)
        configs = HERE.parent / "configs"
        run_design(configs / "shell_trade_off.toml", out / "front", Console())
        run_design(configs / "shell_grasp.toml", out / "search", Console())
        run_calibrate(configs / "calibrate_shell.toml", out / "fit", Console())
        for run, name in (("front", "front"), ("search", "convergence"), ("fit", "fit")):
            (IMAGES / f"gallery_{name}.png").write_bytes((out / run / f"{name}.png").read_bytes())


def moulds() -> None:
    """Parts and moulds, as docs/guides/mould.md shows them."""
    table = cad.ManufactureTable()
    shell = cad.shell_export(thesis.shell(), table, 5.0, True)
    finger = cad.finger_export(sg.PneuNet.table_5_1("A"), table, True)
    with tempfile.TemporaryDirectory() as folder:
        for export, own in ((shell, "membrane"), (finger, "body")):
            draw_all(Path(folder), export)
            for name, said in (("parts", "parts"), (f"mould_{own}", own)):
                picture = (Path(folder) / f"{name}.png").read_bytes()
                (IMAGES / f"mould_{export.kind}_{said}.png").write_bytes(picture)


GALLERY_DPI = 130
"""Enough for a screen."""

MAKE = {
    "rooms": rooms,
    "fold": fold,
    "shell_grasp": shell_grasp,
    "reproduction": reproduction,
    "inflation": inflation,
    "verified": verified,
    "gallery_scenes": gallery_scenes,
    "gallery_runs": gallery_runs,
    "moulds": moulds,
}

if __name__ == "__main__":
    for name in sys.argv[1:] or MAKE:
        MAKE[name]()
