"""The pictures of the README: `python docs/make_images.py` writes them beside this file, into images/."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from rich.console import Console

import softgrip_jax as sg
from optim.run import run_design
from softgrip_jax import thesis
from softgrip_jax.plots import animate
from softgrip_jax.plots.figures import BLUE, BODY, ORANGE, STYLE, VERMILION
from softgrip_jax.reproduce import run_reproduce
from softgrip_jax.units import kPa

HERE = Path(__file__).resolve().parent
IMAGES = HERE / "images"

SOLVER_STOPPED = 41.0
"""kPa: as far as the thesis's model predicts the blocked force of type A (section 6.3.2)."""


def fold() -> None:
    """Blocked force of type A against pressure, through the fold, for the exact section law and the thesis's."""
    laws = {"exact": ("exact law", BLUE), "thesis": ("the thesis's law", ORANGE)}
    with mpl.rc_context(STYLE):
        ax = Figure(figsize=(4.2, 3.0)).subplots()
        for law, (label, colour) in laws.items():
            scene = sg.pneunet.TipContact(sg.PneuNet.table_5_1("A"), section=law)
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


def inflation() -> None:
    """The shell of the thesis closes around its cylinder."""
    animate(thesis.cylinder_contact(), np.linspace(2.4, 20, 30) * kPa, IMAGES / "inflation.gif")


MAKE = {"fold": fold, "shell_grasp": shell_grasp, "reproduction": reproduction, "inflation": inflation}

if __name__ == "__main__":
    for name in sys.argv[1:] or MAKE:
        MAKE[name]()
