"""What would have to differ between the drawn finger and the built one for the tip forces that the thesis measured.

    python -m benchmarks.missing_factor

For type A with its tip held at the clamp's height: the tip force by the cell law, and by what factor a plausible change
of each thing that nobody has measured multiplies it. Prints the table of docs/theory/missing-factor.md.
"""

from __future__ import annotations

import dataclasses
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import softgrip_jax as sg
from softgrip_jax.units import kPa, mm

PRESSURES = (15.0, 20.0, 25.0)
"""kPa: at 31 the held finger is near its limit by the cell law."""


class Change(NamedTuple):
    """One thing that may differ."""

    words: str
    scene: Any
    share: float = 1.0
    """Of the pressure that reaches the chambers."""
    tared: bool = False
    """The sensor is set to zero with the finger resting on it."""


def held(finger: sg.PneuNet, weight: float = 0.0, offset: float = 0.0, pull: float = 0.0) -> Any:
    """Type A's blocked state by the cell law."""
    return sg.pneunet.TipContact(finger, drive="cell", weight=(0.0, -weight), tip_offset=offset, tip_pull=pull)


def changes() -> list[Change]:
    """The base first."""
    base = sg.PneuNet.table_5_1("A")
    replace = dataclasses.replace

    def of(**sizes: float) -> Any:
        return held(replace(base, **{k: v * mm for k, v in sizes.items()}))

    def softer(factor: float) -> Any:
        return held(replace(base, material=sg.NeoHookean(mu=factor * 136 * kPa)))

    return [
        Change("type A as drawn, by the cell law", held(base)),
        Change("walls 0.2 mm thicker", of(t_m=1.3)),
        Change("walls 0.4 mm thicker", of(t_m=1.5)),
        Change("gap between chambers 0.2 mm wider (2 h_x by 0.4 mm)", of(h_x=1.1)),
        Change("cavity 0.5 mm lower (a by 0.25 mm)", of(a=4.75)),
        Change("cavity 0.5 mm narrower (b by 0.25 mm)", of(b=7.75)),
        Change("cover 0.5 mm thicker", of(H=5.5)),
        Change("silicone 30 % stiffer", softer(1.3)),
        Change("silicone 30 % softer", softer(0.7)),
        Change("a tenth of the pressure lost on the way", held(base), share=0.9),
        Change("weight of 2 N/m on the sensor", held(base, weight=2.0)),
        Change("the same, the sensor set to zero under it", held(base, weight=2.0), tared=True),
        Change("tip held 5 mm higher", held(base, offset=5 * mm)),
        Change("tip held 5 mm lower", held(base, offset=-5 * mm)),
        Change("friction pulls the tip outwards with 0.05 N", held(base, pull=0.05)),
        Change("friction pushes the tip inwards with 0.05 N", held(base, pull=-0.05)),
    ]


def forces(found: list[Change]) -> np.ndarray:
    """Tip forces in N, one row per change, one column per pressure; NaN where there is no such state."""
    at = jnp.asarray([1e-3, *PRESSURES]) * kPa

    @jax.jit
    def row(scene: Any, share: Any) -> Any:
        return jax.vmap(lambda p: sg.solve(scene, share * p).tip_force)(at)

    values = np.array([row(c.scene, c.share) for c in found])
    tared = np.array([c.tared for c in found])
    return values[:, 1:] - np.where(tared, values[:, 0], 0.0)[:, None]


def main() -> None:
    """Print the table in Markdown."""
    found = changes()
    values = forces(found)
    print("| change | " + " | ".join(f"{p:g} kPa" for p in PRESSURES) + " |")
    print("|---" * (len(PRESSURES) + 1) + "|")
    for change, row in zip(found, values, strict=True):
        cells = [f"{v:.3f} N" if change is found[0] else f"{v / b:.2f}" for v, b in zip(row, values[0], strict=True)]
        print(f"| {change.words} | " + " | ".join(c.replace("nan", "no state") for c in cells) + " |")


if __name__ == "__main__":
    main()
