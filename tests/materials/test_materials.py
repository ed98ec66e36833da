"""Every energy against its closed form in uniaxial, equibiaxial and pure shear: textbook nominal stresses."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import MATERIALS

import softgrip_jax as sg
from softgrip_jax.materials.base import nominal_stresses
from softgrip_jax.materials.presets import PRESETS
from softgrip_jax.membrane import tensions
from softgrip_jax.units import kPa, mm

STRETCHES = np.array([0.7, 0.9, 1.0, 1.1, 1.5, 2.0, 2.9])


def slope_of_energy(name, i1, i2):
    """(dW/dI_1, dW/dI_2) written out."""
    return {
        "neo": (87.5e3, 0.0),
        "mooney": (80e3, 7e3),
        "yeoh": (85e3 - 2 * 1.5e3 * (i1 - 3) + 3 * 0.4e3 * (i1 - 3) ** 2, 0.0),
        "gent": (85e3 * 40 / (40 - (i1 - 3)), 0.0),
    }[name]


def closed_form(name, mode, s):
    """Nominal stress along 1 of an incompressible sheet at stretch s, from the invariants of each test."""
    if name == "ogden":
        # S = sum mu (lambda^(alpha-1) - lambda_3^alpha / lambda), with lambda_3 by the test.
        l3 = {"uniaxial": s**-0.5, "equibiaxial": s**-2.0, "pure shear": 1 / s}[mode]
        pairs = zip((120e3, 4e3, -6e3), (1.6, 5.0, -2.1), strict=True)
        return sum(mu * (s**alpha - l3**alpha) / s for mu, alpha in pairs)
    i1, i2 = {
        "uniaxial": (s**2 + 2 / s, 2 * s + s**-2.0),
        "equibiaxial": (2 * s**2 + s**-4.0, s**4 + 2 * s**-2.0),
        "pure shear": (s**2 + 1 + s**-2.0, s**2 + 1 + s**-2.0),
    }[mode]
    w1, w2 = slope_of_energy(name, i1, i2)
    return {
        "uniaxial": 2 * (s - s**-2.0) * (w1 + w2 / s),
        "equibiaxial": 2 * (s - s**-5.0) * (w1 + s**2 * w2),
        "pure shear": 2 * (s - s**-3.0) * (w1 + w2),
    }[mode]


@pytest.mark.parametrize("mode", ["uniaxial", "equibiaxial", "pure shear"])
@pytest.mark.parametrize("name", MATERIALS)
def test_stress_is_the_closed_form(name, mode):
    material = MATERIALS[name]()
    across = {"uniaxial": STRETCHES**-0.5, "equibiaxial": STRETCHES, "pure shear": np.ones_like(STRETCHES)}[mode]
    along, other = jax.jit(jax.vmap(lambda l1, l2: nominal_stresses(material, l1, l2)))(STRETCHES, across)
    wanted = closed_form(name, mode, STRETCHES)
    np.testing.assert_allclose(along, wanted, rtol=1e-12, atol=1e-9)
    if mode == "uniaxial":
        np.testing.assert_allclose(other, 0, atol=1e-9)
    if mode == "equibiaxial":
        np.testing.assert_allclose(other, wanted, rtol=1e-12, atol=1e-9)


@pytest.mark.parametrize("name", MATERIALS)
def test_undeformed_material_has_no_energy_and_its_shear_modulus(name):
    material = MATERIALS[name]()
    one = jnp.ones(())
    assert abs(float(material.energy(one, one, one))) < 1e-9
    # Small pure shear: S = 4 mu (lambda - 1).
    along, _ = nominal_stresses(material, jnp.asarray(1 + 1e-7), one)
    assert float(along) == pytest.approx(4 * float(material.shear_modulus()) * 1e-7, rel=1e-6)


@pytest.mark.parametrize("name", ["neo", "mooney", "yeoh", "gent"])
def test_line_tensions_are_those_of_the_thesis(name):
    """(2.2): T_1 = 2 t_m lambda_3 (lambda_1^2 - lambda_3^2)(U_1 + lambda_2^2 U_2)."""
    l1, l2, t_m = 1.7, 1.2, 1.1 * mm
    l3 = 1 / (l1 * l2)
    i1, i2 = l1**2 + l2**2 + l3**2, l1**-2 + l2**-2 + l3**-2
    u1, u2 = slope_of_energy(name, i1, i2)
    t1, t2 = tensions(MATERIALS[name](), jnp.asarray(t_m), jnp.asarray(l1), jnp.asarray(l2))
    assert float(t1) == pytest.approx(2 * t_m * l3 * (l1**2 - l3**2) * (u1 + l2**2 * u2), rel=1e-13)
    assert float(t2) == pytest.approx(2 * t_m * l3 * (l2**2 - l3**2) * (u1 + l1**2 * u2), rel=1e-13)


def test_presets_are_the_values_of_the_thesis():
    assert {name: float(make().mu) / kPa for name, make in PRESETS.items()} == pytest.approx(
        {"dragon_skin_20": 136, "dragon_skin_30": 198, "dragon_skin_20_shell": 175}
    )


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: sg.NeoHookean(mu=-1.0), "NeoHookean.mu"),
        (lambda: sg.MooneyRivlin(c1=1e3, c2=-2e3), "MooneyRivlin"),
        (lambda: sg.Ogden(mu=np.array([1e3]), alpha=np.array([-2.0])), "Ogden"),
        (lambda: sg.Ogden(mu=np.array([1e3, 1e3]), alpha=np.array([2.0, 0.0])), "Ogden.alpha"),
        (lambda: sg.Ogden(mu=np.array([1e3, 1e3]), alpha=np.array([2.0])), "Ogden.mu"),
    ],
)
def test_materials_that_cannot_be_meant(make, words):
    with pytest.raises(ValueError, match=words):
        make()
