"""The uniaxial tension test, and which strain energy describes it.

A strip of an incompressible material stretched by lambda along its length narrows by 1/sqrt(lambda) across. Its
engineering stress (force per undeformed area) is the derivative of the energy along that line,

    s(lambda) = d/dlambda W(lambda, lambda^-1/2, lambda^-1/2)        (Ogden, Non-linear Elastic Deformations, 1984)

so a new material needs no line here. Only tension is tested: what a material does in the two-way stretch of a membrane
is an extrapolation, and `softening` says where it would go wrong.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from softgrip_jax import materials
from softgrip_jax.fields import Checked, part
from softgrip_jax.materials.base import Material, nominal_stresses

from ..space import Variable

Scalar = Float[Array, ""]


class Tension(Checked):
    """A specimen in uniaxial tension.

    The engineering stress is dW(lambda, lambda^-1/2, lambda^-1/2) / dlambda at the stretch lambda = 1 + strain.

    Args:
        material: strain energy of the specimen.

    Raises:
        InputError: where material is not one.

    Source: Treloar 1975; mu (lambda - 1/lambda^2) for a neo-Hookean material.

    Examples:
        >>> strip = optim.Tension(sg.NeoHookean(mu=100 * kPa))
        >>> print(f"{strip.stress(jnp.asarray(1.0)) / kPa:.1f} kPa")  # mu (2 - 1/4)
        175.0 kPa
    """

    material: Material = part(Material)

    def stress(self, strain: Scalar) -> Scalar:
        """Engineering stress, Pa, at an engineering strain."""

        def energy(stretch):
            across = 1 / jnp.sqrt(stretch)
            return self.material.energy(stretch, across, across)

        return jax.grad(energy)(1 + strain)

    def bearable(self, strain: Scalar) -> Scalar:
        """Positive where the material can follow the strain."""
        return self.material.stretchable(1 + strain, 1 / jnp.sqrt(1 + strain))


class Candidate(NamedTuple):
    """A material to be tried on a test: where it starts and what may move."""

    start: Material
    variables: list[Variable]
    canonical: Callable[[np.ndarray], np.ndarray] = lambda x: x
    """Constants that describe the same material in one form."""


WIDE = 1e3
"""A modulus lies within this factor of the first guess, both ways."""


def _modulus(mu: float) -> tuple[float, float]:
    return mu / WIDE, mu * WIDE


def _neo_hookean(mu: float, largest: float) -> Candidate:
    return Candidate(materials.NeoHookean(mu=mu), [Variable("material.mu", *_modulus(mu), "log")])


def _mooney_rivlin(mu: float, largest: float) -> Candidate:
    """C_2 may be negative, as far as mu = 2 (C_1 + C_2) stays positive where the fit ends (checked there)."""
    return Candidate(
        materials.MooneyRivlin(c1=mu / 2, c2=0.0),
        [Variable("material.c1", *_modulus(mu / 2), "log"), Variable("material.c2", -10 * mu, 10 * mu)],
    )


def _yeoh(mu: float, largest: float) -> Candidate:
    """C_2 and C_3 are bounded by a hundred times the stress of C_1 at the largest strain of the window."""
    c2, c3 = 100 * mu / largest, 100 * mu / largest**2
    return Candidate(
        materials.Yeoh(c1=mu / 2),
        [
            Variable("material.c1", *_modulus(mu / 2), "log"),
            Variable("material.c2", -c2, c2),
            Variable("material.c3", -c3, c3),
        ],
    )


def _gent(mu: float, largest: float) -> Candidate:
    """J_m is above the largest I_1 - 3 of the window, which was reached."""
    return Candidate(
        materials.Gent(mu=mu, j_m=10 * largest),
        [
            Variable("material.mu", *_modulus(mu), "log"),
            Variable("material.j_m", 1.0001 * largest, WIDE * largest, "log"),
        ],
    )


def _ogden(terms: int) -> Callable[[float, float], Candidate]:
    """Terms with positive mu and alpha, which no stretch makes unstable: one soft, a second one that stiffens."""

    def make(mu: float, largest: float) -> Candidate:
        start = materials.Ogden(mu=[mu / 2, mu / 8][:terms], alpha=[2.0, 4.0][:terms])
        # A term may vanish: its mu goes further down than a modulus needs to.
        variables = [
            Variable("material.mu", mu / WIDE**2, mu * WIDE, "log"),
            Variable("material.alpha", 0.3, 20.0, "log"),
        ]
        return Candidate(start, variables, _terms_by_exponent)

    return make


def _terms_by_exponent(x: np.ndarray) -> np.ndarray:
    """(mu_1, ..., alpha_1, ...) with the terms of the sum in the order of their exponents."""
    mu, alpha = np.split(x, 2)
    order = np.argsort(alpha)
    return np.concatenate([mu[order], alpha[order]])


CANDIDATES: dict[str, Callable[[float, float], Candidate]] = {
    "NeoHookean": _neo_hookean,
    "MooneyRivlin": _mooney_rivlin,
    "Yeoh": _yeoh,
    "Gent": _gent,
    "Ogden": _ogden(1),
    "Ogden2": _ogden(2),
}
"""Name -> candidate from (first guess of mu in Pa, largest I_1 - 3 of the window)."""


def candidate(name: str, strain: np.ndarray, stress: np.ndarray) -> Candidate:
    """Where to start from on these points: mu is the neo-Hookean least-squares value, which is closed form."""
    stretch = 1 + strain
    shape = stretch - stretch**-2
    mu = float(shape @ stress / (shape @ shape))
    largest = float(np.max(stretch**2 + 2 / stretch - 3))
    return CANDIDATES[name](max(mu, 1.0), largest)


# --- stability beyond the window --------------------------------------------------------------------------------------

BEYOND = 2.0
"""Stability is looked at up to this many times the largest strain of the window."""

CHECKED = 400
"""Number of stretches that are looked at."""


class Softening(NamedTuple):
    """Where a material first gives way: its engineering stress falls while it is stretched on."""

    mode: str
    strain: float


def _uniaxial(material: Material, stretch: Scalar) -> Scalar:
    return Tension(material).stress(stretch - 1)


def _equibiaxial(material: Material, stretch: Scalar) -> Scalar:
    return nominal_stresses(material, stretch, stretch)[0]


def _planar(material: Material, stretch: Scalar) -> Scalar:
    return nominal_stresses(material, stretch, jnp.ones_like(stretch))[0]


MODES = {"uniaxial tension": _uniaxial, "equal stretch both ways": _equibiaxial, "stretch at fixed width": _planar}
"""The stretches of a strip and of a membrane."""


def softening(material: Material, strain: float) -> list[Softening]:
    """Where the material softens, up to BEYOND times a strain, in each mode; empty where it is stable."""
    found = []
    # In equal stretch a sheet reaches the energy of a strip at smaller strain; the same range is looked at.
    stretches = jnp.linspace(1.0, 1 + BEYOND * strain, CHECKED)
    for mode, stress in MODES.items():
        slopes = np.asarray(jax.vmap(jax.grad(lambda s, stress=stress: stress(material, s)))(stretches))
        falling = slopes < 0  # behind the lock of a Gent material the slope is NaN: no softening
        if falling.any():
            found.append(Softening(mode, float(stretches[int(np.argmax(falling))]) - 1))
    return found


def material_of(model: Any) -> Material | None:
    """The material of a scene's actuator, or of a test."""
    for owner in (model, getattr(model, "shell", None), getattr(model, "finger", None)):
        material = getattr(owner, "material", None)
        if isinstance(material, Material):
            return material
    gripper = getattr(model, "gripper", None)
    return None if gripper is None else material_of(gripper)
