"""A section law and a wall model of one's own are one law: each scene uses some of their methods and compares none."""

import dataclasses
import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import softgrip_jax as sg
from softgrip_jax.errors import InputError
from softgrip_jax.pneunet import SectionLaw, WallModel
from softgrip_jax.units import kPa, mm

FINGER = sg.PneuNet.table_5_1("A")


class Fibres(SectionLaw):
    """m = z / 3, n = k (lambda - 1), in one of its methods with a mistake."""

    k: jax.Array
    mistake: str = eqx.field(static=True, default="")

    def __call__(self, m, n):
        if self.mistake == "if":
            return (3 * m, 1 + n / self.k) if m > 0 else (3 * m, 1 - n / self.k)
        bend = {"sign of m": -3.0, "at rest": 3.0}.get(self.mistake, 3.0)
        return bend * m + 0 * n + (0.1 if self.mistake == "at rest" else 0.0), 1 + self.sign() * n / self.k + 0 * m

    def sign(self):
        return -1 if self.mistake == "sign of n" else 1

    def loads(self, z, stretch):
        if self.mistake == "one value":
            return z / 3
        if self.mistake == "vector":
            return jnp.stack([z / 3]), self.k * (stretch - 1)
        bend = {"loads": 0.5, "sign of m": -1 / 3}.get(self.mistake, 1 / 3)
        return z * bend + 0 * stretch, self.sign() * self.k * (stretch - 1) + 0 * z

    def stretches(self, z, n):
        stretch = 1 + self.sign() * n / self.k + 0 * z
        if self.mistake == "two values":
            return stretch - 0.5, stretch + 0.5
        if self.mistake == "floats":
            return 0.5, 1.5, 1.0
        return (
            (stretch + 0.1, stretch + 0.5, stretch)
            if self.mistake == "interval"
            else (stretch - 0.5, stretch + 0.5, stretch)
        )


def held(law):
    return sg.pneunet.TipContact(FINGER, section=law, points=6)


@pytest.mark.parametrize(
    ("mistake", "said"),
    [
        ("loads", r"Fibres\(0.05, 0\) is \(z, lambda\) = \(0.15, 1\), but Fibres.loads gives \(m, n\) = \(0.075, 0\)"),
        ("interval", r"Fibres.stretches\(0.15, 0\) gives bounds at which Fibres.loads has n = 1 and 5; n must rise"),
        ("sign of n", "gives bounds at which Fibres.loads has n = 5 and -5; n must rise with the stretch"),
        ("sign of m", "z must have the sign of m"),
        ("at rest", r"Fibres\(\) is \(0.1, 1\) without any load; a cover at rest has \(z, lambda\) = \(0, 1\)"),
        ("if", r"Fibres.__call__ cannot be differentiated by JAX \(line \d+ of test_own_parts.py\)"),
        ("one value", "Fibres.loads gives one number; it must give 2 numbers: m, n"),
        ("vector", r"Fibres.loads gives \(m, n\), and m is an array of the shape \(1,\); it must be one number"),
        ("two values", "Fibres.stretches gives 2 values; it must give 3 numbers"),
    ],
)
def test_a_section_law_is_one_law(mistake, said):
    """Arcs ask it for the state, beams for the loads: a law that is two gave different numbers, each of them OK."""
    with pytest.raises(InputError, match=said):
        held(Fibres(jnp.asarray(10.0), mistake))
    with pytest.raises(InputError, match=said):
        sg.pneunet.Free(FINGER, section=Fibres(jnp.asarray(10.0), mistake))


@pytest.mark.parametrize("k", [0.5, 1e3, 1e9])
def test_a_law_that_is_one_is_taken(k):
    """However stiff it is, with floats for bounds, several at once, and where its numbers are traced."""
    assert held(Fibres(jnp.asarray(k))).section.k == k
    held(Fibres(jnp.asarray(k * np.ones(3))))
    jax.jit(lambda k: held(Fibres(k)).section.k)(k)


def test_bounds_may_be_floats():
    one, other = (Fibres(jnp.asarray(10.0), kind).bent(jnp.asarray(0.1), jnp.asarray(0.2)) for kind in ("floats", ""))
    np.testing.assert_allclose(one, other, rtol=1e-12)


class Piston(WallModel):
    """A force on a part of the wall, with a mistake."""

    mistake: str = eqx.field(static=True, default="")

    def end_moment(self, finger, pressure, inclination):
        if self.mistake == "math":
            return math.sqrt(pressure) * finger.a**3
        if self.mistake == "None":
            return None
        return 0.4 * finger.a * finger.b * pressure * finger.H

    def largest_pressure(self, finger):
        return {"inf": jnp.inf, "None": 60 * kPa}.get(self.mistake, 60 * kPa + 0 * finger.a)

    def contact_pressure(self, finger):
        return (70 if self.mistake == "late" else 2) * kPa + 0 * finger.a


@pytest.mark.parametrize(
    ("mistake", "said"),
    [
        ("inf", "Piston.largest_pressure is inf Pa; it must be finite"),
        (
            "late",
            "Piston.contact_pressure is 70000 Pa and its largest_pressure 60000 Pa; the first must be zero or more",
        ),
        ("math", r"Piston.end_moment cannot be differentiated by JAX \(line \d+ of test_own_parts.py\)"),
        ("None", "Piston.end_moment gives None; it must be one number"),
    ],
)
def test_a_wall_model_begins_and_ends(mistake, said):
    """The state was OK, and the limit pressure NaN."""
    assert sg.pneunet.Free(FINGER, drive=Piston()).drive == Piston()
    with pytest.raises(InputError, match=said):
        sg.pneunet.Free(FINGER, drive=Piston(mistake))


@pytest.mark.parametrize("finger", [FINGER, dataclasses.replace(FINGER, t_m=[1.1 * mm, 1.2 * mm])])
def test_a_wall_model_whose_numbers_are_known_serves_where_others_are_traced(finger):
    """A trace-back of JAX was the answer: to `jax.grad` by the object, and to a search in which no finger moves."""

    def lifted(offset):
        return sg.pneunet.TipContact(finger, drive=Piston(), tip_offset=offset).tip_offset

    assert jax.jit(lifted)(1 * mm) == 1 * mm


def test_a_finger_has_a_segment():
    """No value at all as an array, which as a list was refused."""
    for none in ([], np.array([])):
        with pytest.raises(InputError, match="PneuNet"):
            dataclasses.replace(FINGER, a=none)
