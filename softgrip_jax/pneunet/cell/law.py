"""The cell law of a finger: what one segment's chamber, walls, rims and cover do together (see docs/theory/cell.md).

Under uniform bending with the curvature kappa (per reference length, positive as the chambers bend the finger) and the
axial force N, a segment needs the external moment M_ext about the cover's mid-height:

    M_ext = M_0(kappa) - N lambda_0'(kappa) - N^2 C'(kappa) / 2,   lambda = lambda_0(kappa) + N C(kappa)

both from one potential. M_0, lambda_0 and the axial compliance C depend on the pressure over mu and on the geometry;
`form` holds their form, and `law.npz` the numbers, fitted to finite elements and to three-dimensional solids (`solid`)
of neo-Hookean material. Other strain energies enter by their shear modulus at rest.
"""

from __future__ import annotations

import warnings
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float

from ...errors import CellRangeWarning
from ...fields import is_concrete
from ...numerics.choice import larger, largest, smaller, smallest
from ...numerics.implicit import implicit
from ...numerics.scalar_roots import newton_bracketed
from ...numerics.xla import differentiated_once, materialised
from ..finger import PneuNet
from ..section.base import SectionLaw
from . import form

Scalar = Float[Array, ""]

NUMBERS = Path(__file__).with_name("law.npz")
LARGEST_PRESSURE = form.MOST_PRESSURE
"""Over mu: 32.6 kPa for Dragon Skin 20. The states that the law was fitted to end there."""
CHECKED_WIDTH = 20.0
CHECKED = {n: (float(v), float(w)) for n, v, w in zip(form.SIZES, 20 * form.LOW, 20 * form.HIGH, strict=True)}
"""Dimensions that the law was fitted to, mm for a cover of the width B = 20 mm; others scale with B."""


@cache
def numbers() -> np.ndarray:
    """C of `form`."""
    with np.load(NUMBERS) as data:
        return data["C"].astype(float)


class LoadedCell(NamedTuple):
    """One cell at one pressure."""

    loaded: form.Loaded

    def bent(self, k: Scalar, nu: Scalar) -> tuple[Scalar, Scalar]:
        """(M_ext, stretch) at the curvature k = kappa B under nu = N / (mu B^2)."""
        v = _at_curvature(self.loaded, k)
        moment = v["moment"] - nu * (v["strain_slope"] + 0.5 * nu * v["compliance_slope"])
        return moment, 1 + v["strain"] + nu * v["compliance"]

    def touched(self, k: Scalar) -> tuple[Scalar, Scalar]:
        """(force of one wall on the next, its lever) at the curvature k."""
        f = form.functions(self.loaded, k)
        return larger(form.force(self.loaded, f), 0.0), form.lever(self.loaded, f)

    def straight_moment(self) -> Scalar:
        """The moment of a straight cell without axial force, over mu B^3."""
        return form.straight_moment(self.loaded)


@differentiated_once
def _at_curvature(loaded: form.Loaded, k: Scalar) -> dict[str, Array]:
    return jax.tree.map(materialised, form.at_curvature(loaded, k))


def sizes(finger: PneuNet) -> Array:
    """The finger's lengths over B, in the order of the form."""
    return jnp.stack([getattr(finger, name) / finger.B for name in form.SIZES])


MOST_OPEN, MOST_CLOSED = 2.6, 2.5
"""Where the states end that the law was fitted to: curvature times B forwards, and backwards over that at which rims of
rigid neighbours meet. Not far beyond the law says of a cell without pressure that it bends itself."""


def known_curvatures(finger: PneuNet) -> tuple[Scalar, Scalar]:
    """The curvatures (1/m) of a uniform finger, or of one segment, between which its cell is known."""
    return -MOST_CLOSED * form.rims_meet(sizes(finger)) / finger.B, MOST_OPEN / finger.B


def cell_of(finger: PneuNet, pressure: Scalar) -> LoadedCell:
    """The cell of a uniform finger, or of one segment, at a pressure (Pa)."""
    return LoadedCell(form.loaded(numbers(), sizes(finger), pressure / finger.material.shear_modulus()))


class CellSection(SectionLaw):
    """The cell as the section law of the beam, in its signs and units: z = H theta', m = M / (mu B H^2)."""

    cell: LoadedCell
    slenderness: Scalar
    """H / B."""

    def axis(self):
        return 0 if self.slenderness.ndim else None

    def bent(self, z, n):
        h = self.slenderness
        moment, stretch = self.cell.bent(-z / h, n * h)
        return -moment / h**2, stretch

    def loads(self, z, stretch):
        h = self.slenderness
        free = _at_curvature(self.cell.loaded, -z / h)
        n = (stretch - 1 - free["strain"]) / free["compliance"] / h
        return self.bent(z, n)[0], n

    def bent_once(self, z, n):
        """As `bent`: what takes long is the cell without axial force, and that is differentiated once."""
        return self.bent(z, n)

    def stiffnesses(self, z: Array, n: Array) -> Array:
        """As of any law, with the cell worked out once at each place."""
        h = self.slenderness
        free = jax.vmap(_at_curvature, (None, 0))(self.cell.loaded, -z / h)
        nu = 0.5 * h * (n[1:] + n[:-1])

        def moment(here):
            return free["moment"][here] - nu * (free["strain_slope"][here] + 0.5 * nu * free["compliance_slope"][here])

        rise, step = (moment(np.s_[:-1]) - moment(np.s_[1:])) / h**2, z[1:] - z[:-1]
        return jnp.where(step == 0, jnp.inf, rise / jnp.where(step == 0, 1.0, step))

    def straight_moment(self) -> Scalar:
        """m of a straight segment without axial force."""
        return -self.cell.straight_moment() / self.slenderness**2

    def stretches(self, z, n):
        stretch = self.bent(z, n)[1]
        return stretch, stretch, stretch

    def __call__(self, m, n):
        """The curvature is searched where the cell is known, and the moment rises with it."""
        law, *given = lax.stop_gradient((self, m, n))
        low = jnp.full_like(given[0] + given[1], -MOST_OPEN * law.slenderness)
        high = jnp.full_like(low, MOST_CLOSED * law.cell.loaded.rims_meet * law.slenderness)
        found = newton_bracketed(lambda z: law.bent(z, given[1])[0] - given[0], low, high, 3 * given[0]).x
        z = implicit(lambda z, args: args[0].bent(z, args[2])[0] - args[1], found, (self, m, n))
        return z, self.bent(z, n)[1]


def cell_section(finger: PneuNet, pressure: Scalar) -> CellSection:
    """The section law of a cell at a pressure (Pa)."""
    return CellSection(cell_of(finger, pressure), finger.H / finger.B)


def range_margin(finger: PneuNet) -> Scalar:
    """How far (m) the dimensions are inside of what the law was fitted to: the least of all."""
    low, high = (jnp.stack(ends) * finger.B / CHECKED_WIDTH for ends in zip(*CHECKED.values(), strict=True))
    values = [jnp.atleast_1d(getattr(finger, name)) for name in CHECKED]
    inside = [
        smaller(smallest(value) - least, most - largest(value))
        for value, least, most in zip(values, low, high, strict=True)
    ]
    return smallest(jnp.stack(inside))


def warn_outside(finger: Any, stacklevel: int) -> None:
    """One warning where known dimensions are outside of what the law was fitted to."""
    if is_concrete(*(getattr(finger, name) for name in (*CHECKED, "B"))):
        for sentence in range_remarks(finger):
            warnings.warn(sentence, CellRangeWarning, stacklevel=stacklevel + 1)


def range_remarks(finger: Any) -> list[str]:
    """A sentence about a finger of known numbers to which the law was not fitted; none about others."""
    beyond = outside(finger)
    return [f"The cell law was not fitted to such a finger: {'; '.join(beyond)}."] if beyond else []


def outside(finger: Any) -> list[str]:
    """The dimensions that lie outside of what the law was fitted to, in words; for known numbers."""
    scale = CHECKED_WIDTH / (1e3 * np.asarray(finger.B))
    found = []
    for name, (low, high) in CHECKED.items():
        value = np.atleast_1d(1e3 * np.asarray(getattr(finger, name))) * scale
        if np.any(value < low * (1 - 1e-9)) or np.any(value > high * (1 + 1e-9)):
            worst = value[np.argmax(np.maximum(low - value, value - high))]
            low, high, worst = (v / scale.max() for v in (low, high, worst))
            found.append(f"{name} = {worst:.4g} mm (checked: {low:.4g} to {high:.4g} mm)")
    return found
