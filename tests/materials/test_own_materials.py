"""A material of the user's own has the physics of its energy and of nothing else.

The same energy is written twice, once as a law of the package with all that the package knows of it, and once as a
plain energy of which nothing is known: every scene must give the same numbers for both.
"""

import dataclasses
import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import CASES, MATERIALS, shell

import softgrip_jax as sg
from softgrip_jax.errors import InputError
from softgrip_jax.materials.base import ClosedForms, Material, nominal_stresses
from softgrip_jax.materials.laws import InvariantMaterial
from softgrip_jax.pneunet.section.choice import section_law
from softgrip_jax.pneunet.section.exact import ExactNeoHookean
from softgrip_jax.pneunet.section.quadrature import ExactQuadrature
from softgrip_jax.units import kPa, mm

FINGER = sg.PneuNet.table_5_1("A")
YEOH = sg.Yeoh(c1=68 * kPa, c2=-1.5 * kPa, c3=0.4 * kPa)
"""Its shear modulus is the one of the finger's own material, 136 kPa."""


class EnergyOnly(Material):
    """The energy of a law, and nothing else of it."""

    law: Material  # not a field of a config: this class is no material of the package's configs

    def energy(self, l1, l2, l3):
        return self.law.energy(l1, l2, l3)


class ByEnergy(sg.NeoHookean):
    """A neo-Hookean material by its name, of another energy."""

    law: Material

    def energy(self, l1, l2, l3):
        return self.law.energy(l1, l2, l3)


class ByInvariants(sg.NeoHookean):
    """The same by the invariants."""

    law: InvariantMaterial

    def of_invariants(self, i1, i2):
        return self.law.of_invariants(i1, i2)


class Mixin:
    """Half of a material: an energy to be mixed in."""

    def energy(self, l1, l2, l3):
        return self.law.energy(l1, l2, l3)


class ByMixin(Mixin, sg.NeoHookean):
    """The same by a base of its own."""

    law: Material


class LockedNoMore(sg.Gent):
    """A Gent material by its name, of an energy that does not lock."""

    law: Material

    def energy(self, l1, l2, l3):
        return self.law.energy(l1, l2, l3)


DISGUISES = {
    "energy": lambda law: ByEnergy(mu=1 * kPa, law=law),
    "invariants": lambda law: ByInvariants(mu=1 * kPa, law=law),
    "mixin": lambda law: ByMixin(mu=1 * kPa, law=law),
    "gent": lambda law: LockedNoMore(mu=1 * kPa, j_m=0.05, law=law),
}


def same(plain, built_in, rtol=1e-9):
    """The observables, pressure and status of two solutions agree."""
    assert int(plain.status) == int(built_in.status) == sg.Status.OK
    np.testing.assert_allclose(plain.pressure, built_in.pressure, rtol=rtol)
    for name, value in built_in.observables.items():
        scale = np.max(np.abs(value))
        np.testing.assert_allclose(plain.observables[name], value, rtol=rtol, atol=rtol * scale, err_msg=name)


@pytest.mark.parametrize("disguise", DISGUISES)
def test_a_subclass_with_another_energy_keeps_nothing(disguise):
    material = DISGUISES[disguise](YEOH)
    assert material.closed_forms() == ClosedForms()
    assert float(material.shear_modulus()) == pytest.approx(136 * kPa, rel=1e-12)
    l1, l2 = jnp.asarray(1.7), jnp.asarray(1.2)
    assert float(material.stretchable(l1, l2)) > 0
    stresses = nominal_stresses(YEOH, l1, l2)
    np.testing.assert_allclose(nominal_stresses(material, l1, l2), stresses, rtol=1e-14)
    sheet = l1**2 + l2**2, (l1 * l2) ** 2
    # Any energy's sheet keeps squared stretches apart by 1e-4: its energy changes by 1e-8.
    assert float(material.sheet_energy(*sheet)) == pytest.approx(float(YEOH.sheet_energy(*sheet)), rel=1e-7)


def test_a_subclass_with_the_same_energy_keeps_all():
    class Named(sg.NeoHookean):
        """A name for a silicone."""

        batch: int = eqx.field(static=True)

    plain, named = sg.NeoHookean(mu=136 * kPa), Named(mu=136 * kPa, batch=3)
    forms, others = plain.closed_forms()._asdict(), named.closed_forms()._asdict()
    strain, t_m = jnp.asarray(0.3), jnp.asarray(1.1 * mm)
    assert others.pop("tension_over_strain")(t_m, strain) == forms.pop("tension_over_strain")(t_m, strain)
    assert others == forms
    assert isinstance(section_law("exact", named), ExactNeoHookean)


@pytest.mark.parametrize("disguise", DISGUISES)
def test_chambers_and_covers_follow_the_energy(disguise):
    """What the finger is made of: the contact force, its end, and the section law, at 31 kPa on type A."""
    finger = dataclasses.replace(FINGER, material=DISGUISES[disguise](YEOH))
    yeoh = dataclasses.replace(FINGER, material=YEOH)
    law, wanted = section_law("exact", finger.material), section_law("exact", YEOH)
    assert isinstance(law, ExactQuadrature)
    np.testing.assert_allclose(law.loads(jnp.asarray(0.2), jnp.asarray(1.1)), wanted.loads(0.2, 1.1), rtol=1e-12)
    if disguise == "energy":
        same(sg.pneunet.chamber(finger, 31 * kPa), sg.pneunet.chamber(yeoh, 31 * kPa), 1e-12)


def test_the_chamber_of_the_disguise_is_not_neo_hookean():
    """What made the fault visible: a different number, and the same one by the equilibrium written out by hand."""
    finger = dataclasses.replace(FINGER, material=ByEnergy(mu=1 * kPa, law=YEOH))
    seen = sg.pneunet.chamber(finger, 31 * kPa)
    assert abs(float(seen.force) - float(sg.pneunet.chamber(FINGER, 31 * kPa).force)) > 1e-3
    # Equal stretch both ways: s = 2 (l - l^-5) W', with W' of Yeoh, and p = 2 T / R with T = s t_m / l.
    stretch = float(seen.stretch)
    i1 = 2 * stretch**2 + stretch**-4 - 3
    slope = 68e3 - 2 * 1.5e3 * i1 + 3 * 0.4e3 * i1**2
    tension = 2 * (stretch - stretch**-5) * slope * 1.1e-3 / stretch
    radius = 0.9e-3 / (2 * np.sin(0.5 * float(seen.clamp_angle)) ** 2)
    assert 2 * tension / radius == pytest.approx(31e3, rel=1e-9)


def as_plain(scene):
    """The same scene with nothing known of its material but the energy."""
    return eqx.tree_at(lambda s: s.shell.material, scene, EnergyOnly(law=scene.shell.material))


def test_a_shell_of_a_plain_energy():
    (case,) = (case for case in CASES if case.name == "flat-yeoh")
    scene = case.make()
    same(sg.solve(as_plain(scene), case.pressure), sg.solve(scene, case.pressure))


@pytest.mark.slow
@pytest.mark.parametrize("case", [case for case in CASES if case.name != "free-energy"], ids=str)
def test_every_shell_of_a_plain_energy(case):
    """solve, pressure_for and the limit of the whole catalogue."""
    scene = case.make()
    plain, built_in = as_plain(scene), sg.solve(scene, case.pressure)
    same(sg.solve(plain, case.pressure), built_in)
    target = {case.target: built_in.observables[case.target]}
    same(sg.pressure_for(plain, **target), sg.pressure_for(scene, **target))
    np.testing.assert_allclose(sg.limit_pressure(plain), sg.limit_pressure(scene), rtol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("law", MATERIALS)
@pytest.mark.parametrize("kind", ["free", "flat", "cylinder", "grasp", "inclined", "chamber", "energy"])
def test_every_scene_and_law_of_a_plain_energy(kind, law):
    """Random designs of every shell scene and of the chamber, near and far from their limits. Energy membranes of Gent
    and Ogden crumple before their limit (docs/theory/energy.md), have no state at 0.9 of it, and are asked below."""
    rng = np.random.default_rng(7)
    material = MATERIALS[law]()

    def make(material, a, slender, thin):
        wall = sg.FlatShell(a=a, b=a * slender, t_m=a * thin, material=material)
        return {
            "free": lambda: sg.shell.Free(wall),
            "flat": lambda: sg.shell.FlatContact(wall, distance=0.3 * a),
            "cylinder": lambda: sg.shell.CylinderContact(wall, radius=1.3 * a, gap=0.3 * a),
            "grasp": lambda: sg.shell.Grasp(wall, radius=1.3 * a, gap=0.3 * a, mass=0.1, friction=0.9),
            "inclined": lambda: sg.shell.InclinedContact(wall, distance=0.3 * a, angle=0.1),
            "chamber": lambda: sg.pneunet.Chamber(dataclasses.replace(FINGER, material=material), 0.03),
            "energy": lambda: dataclasses.replace(
                sg.shell.Free(wall, model="energy").prepared(), across=2, lengthwise=2
            ),
        }[kind]()

    for _ in range(2 if kind == "energy" else 6):
        design = rng.uniform(8 * mm, 30 * mm), rng.uniform(1.05, 3.0), rng.uniform(0.03, 0.1)
        scene, plain = make(material, *design), make(EnergyOnly(law=material), *design)
        start, end = sg.contact_pressure(scene), sg.limit_pressure(scene)
        top = jnp.where(jnp.isfinite(end), end, start + 100 * kPa)
        rtol = 1e-6 if kind == "energy" else 1e-9
        np.testing.assert_allclose(sg.limit_pressure(plain), end, rtol=rtol)
        for part in (0.1, 0.3) if kind == "energy" and law in ("gent", "ogden") else (0.3, 0.9):
            pressure = start + part * (top - start)
            same(sg.solve(plain, pressure), sg.solve(scene, pressure), rtol)


@pytest.mark.slow
@pytest.mark.parametrize("disguise", ["energy", "invariants"])
def test_fingers_follow_the_energy(disguise):
    """A tip in contact, its limit and the pressure for a force: of the disguise, exactly those of Yeoh's law."""
    held = sg.pneunet.TipContact(dataclasses.replace(FINGER, material=YEOH))
    other = sg.pneunet.TipContact(dataclasses.replace(FINGER, material=DISGUISES[disguise](YEOH)))
    wanted = sg.solve(held, 31 * kPa)
    same(sg.solve(other, 31 * kPa), wanted)
    np.testing.assert_allclose(sg.limit_pressure(other), sg.limit_pressure(held), rtol=1e-9)
    neo = sg.solve(sg.pneunet.TipContact(FINGER), 31 * kPa)
    assert abs(float(neo.tip_force) - float(wanted.tip_force)) > 1e-4


@pytest.mark.slow
def test_a_plain_neo_hookean_finger():
    """The closed forms of fingers against the searches that replace them."""
    plain = dataclasses.replace(FINGER, material=EnergyOnly(law=FINGER.material))
    for make in (sg.pneunet.TipContact, sg.pneunet.Free):
        same(sg.solve(make(plain), 31 * kPa), sg.solve(make(FINGER), 31 * kPa), 1e-8)


# --- what a class states and its energy does not have -----------------------------------------------------------------


class WrongModulus(Material):
    mu: sg.scene.Scalar
    law: Material

    def energy(self, l1, l2, l3):
        return self.law.energy(l1, l2, l3)

    def shear_modulus(self):
        return self.mu


class WrongSheet(sg.NeoHookean):
    law: Material

    def sheet_energy(self, trace, determinant):
        return self.law.sheet_energy(trace, determinant)


NEO = sg.NeoHookean(mu=136 * kPa)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (
            lambda: WrongModulus(mu=jnp.asarray(150e3), law=NEO),
            r"WrongModulus.shear_modulus\(\) is 150000 Pa, but by its",
        ),
        (lambda: WrongSheet(mu=150e3, law=NEO), r"WrongSheet.sheet_energy at the stretches 1.2 and 1.05 is \d+"),
        (
            lambda: ByEnergy(mu=1e3, law=eqx.tree_at(lambda m: m.mu, NEO, jnp.asarray(-1e3))),
            "shear modulus of -1000 Pa",
        ),
    ],
)
def test_statements_that_are_not_true(make, words):
    with pytest.raises(ValueError, match=words):
        make()
    assert WrongModulus(mu=jnp.asarray(136e3), law=NEO).shear_modulus() == 136e3


def test_a_material_is_made_and_varied_under_transformations():
    """Inside jit and vmap nothing can be raised, and nothing is; known numbers inside jit are still checked."""

    def force(mu):
        material = WrongModulus(mu=mu, law=sg.NeoHookean(mu=mu))
        return nominal_stresses(material, jnp.asarray(1.3), jnp.asarray(1.1))[0]

    mus = jnp.array([1e5, 2e5])
    forces = jax.jit(jax.vmap(force))(mus)
    np.testing.assert_allclose(forces[1], 2 * forces[0], rtol=1e-12)
    known = jnp.asarray(1e5)
    with pytest.raises(ValueError, match="shear_modulus"):
        jax.jit(lambda x: WrongModulus(mu=known, law=NEO).shear_modulus() + x)(1.0)


def test_a_plain_energy_locks_where_it_ends():
    """Gent's energy without a word about its lock: the curve of the membrane ends where the package's law ends it."""
    gent = sg.shell.Free(shell("gent"))
    plain = as_plain(gent)
    end = gent.interval()[1]
    assert float(end) < 0.99 * float(gent.geometry()[1])
    np.testing.assert_allclose(plain.interval()[1], end, rtol=1e-12)
    assert bool(plain.unbounded())


def test_an_energy_without_a_second_derivative_at_rest_is_named():
    """The message compared two numbers that are none, and asked for a method to be left out that was not there."""

    class Rooted(Material):
        law: Material  # as above

        def energy(self, l1, l2, l3):
            first = l1 * l1 + l2 * l2 + l3 * l3 - 3
            return self.law.energy(l1, l2, l3) + 1e4 * jnp.sqrt(jnp.abs(first) ** 3)

    with pytest.raises(ValueError, match=r"Rooted\.energy has no second derivative in the undeformed state"):
        Rooted(law=sg.NeoHookean(mu=100 * kPa))


def energy_of(function):
    """A material of one's own whose energy is a function of mu = 100 kPa and the stretches."""

    class Rubber(Material):
        mu: sg.scene.Scalar

        def energy(self, l1, l2, l3):
            return function(self.mu, l1, l2, l3)

    return Rubber(jnp.asarray(100 * kPa))


@pytest.mark.parametrize(
    ("energy", "said"),
    [
        (
            lambda mu, l1, l2, l3: 0.5 * mu * (l1**2 + l2**2 - 2),
            "is stressed at rest, by 100000 and 100000 Pa along the first two stretches",
        ),
        (
            lambda mu, l1, l2, l3: 0.5 * mu * (l1**2 + l2**2 + l3**2 - 3) + mu * l1,
            "is stressed at rest, by 100000 and 0 Pa",
        ),
        (
            lambda mu, l1, l2, l3: 0.5 * mu * (l1**2 + l2**2 + l3**2 - 3 + 0.2 * (l1 - 1) ** 2),
            r"of the stretches 1.2, 1.05 and 0.794 is between \d+.\d+ and \d+.?\d* J/m\^3, as they are ordered",
        ),
        (lambda mu, l1, l2, l3: 0.5 * mu * math.log(l1), r"cannot be differentiated by JAX \(line \d+ of test_own_mat"),
        (lambda mu, l1, l2, l3: mu * np.log(l1), "cannot .*; use jax.numpy in place of math and NumPy"),
        (lambda mu, l1, l2, l3: mu * np.interp(l1, [0, 1], [1, 2]), "cannot .*; use jax.numpy in place of math"),
        (lambda mu, l1, l2, l3: mu * l1 if l1 > 1 else mu, "cannot .* jnp.where in place of if"),
        (lambda mu, l1, l2, l3: mu * jnp.stack([l1]), r"gives an array of the shape \(1,\); it must be one number"),
        (lambda mu, l1, l2, l3: None, "gives None; it must be one number"),
        (lambda mu, l1, l2: mu * l1, "raises TypeError .* positional arguments but 4 were given"),
    ],
)
def test_what_is_no_energy(energy, said):
    """A membrane that is stressed at rest, or knows its directions, was OK; what JAX cannot take was a trace-back."""
    with pytest.raises(InputError, match=rf"^Rubber\.energy {said}"):
        energy_of(energy)


def test_an_energy_may_have_any_zero_and_what_is_constant_along_it():
    """W + c, and W + f(l1 l2 l3), is the same material."""
    energy_of(lambda mu, l1, l2, l3: 0.5 * mu * (l1**2 + l2**2 + l3**2) - 7 * mu * l1 * l2 * l3)
