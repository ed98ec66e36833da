"""A scene of one's own with one unknown: what it must give, and what it says where it does not."""

import math

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

import softgrip_jax as sg
from softgrip_jax.curve_scene import CurveScene
from softgrip_jax.errors import InputError
from softgrip_jax.fields import positive
from softgrip_jax.scene import Scalar
from softgrip_jax.units import kPa


class Spring(CurveScene):
    """p = k theta, with a mistake."""

    k: Scalar = positive("pressure")
    mistake: str = eqx.field(static=True, default="")

    OBSERVABLES = {"turn": "angle", "tip": "position"}

    def interval(self):
        return {"floats": (0.0, 1.0), "one": 0.0}.get(self.mistake, (0 * self.k, 1 + 0 * self.k))

    def load(self, angle):
        if self.mistake == "if":
            return self.k * angle if angle > 0 else 0.0
        if self.mistake == "math":
            return self.k * math.sin(angle)
        if self.mistake == "vector":
            return jnp.stack([self.k * angle])
        if self.mistake == "none":
            return None
        return self.k * angle * (-1 if self.mistake == "sign" else 1)

    def pressure_scale(self):
        return self.k

    def observe(self, angle, pressure):
        tip = jnp.stack([jnp.cos(angle), jnp.sin(angle)])
        if self.mistake == "tuple":
            return angle, tip
        if self.mistake == "missing":
            return {"turn": angle}
        return {"turn": jnp.stack([angle]) if self.mistake == "shape" else angle, "tip": tip}


@pytest.mark.parametrize(
    ("mistake", "said"),
    [
        ("one", "Spring.interval gives one number; it must give 2 numbers: start, end"),
        (
            "if",
            r"Spring.load cannot be differentiated by JAX \(line \d+ of test_own_curve.py\).*jnp.where in place of if",
        ),
        ("math", r"Spring.load cannot be differentiated by JAX \(line \d+ of test_own_curve.py\)"),
        ("vector", r"Spring.load gives an array of the shape \(1,\); it must be one number"),
        ("none", "Spring.load gives None"),
        ("sign", "Spring.load is -950 Pa, and nowhere in its interval positive; it must be the pressure that holds"),
        ("tuple", "Spring.observe gives 2 values; it must give a dict of turn, tip"),
        ("missing", "Spring.observe does not give tip, which OBSERVABLES announces"),
        (
            "shape",
            r"Spring.observe gives turn as an array of the shape \(1,\); it must be one number, of the shape \(\)",
        ),
    ],
)
def test_what_is_no_curve_is_one_sentence(mistake, said):
    assert Spring(1 * kPa).k == 1e3
    with pytest.raises(InputError, match=said):
        Spring(1 * kPa, mistake)


def test_an_unknown_kind_is_told_with_those_that_are_known():
    class Odd(Spring):
        OBSERVABLES = {"turn": "angel"}

    with pytest.raises(
        InputError, match=r"Odd\.OBSERVABLES has 'turn' of the kind 'angel'; it must be one of length, pos"
    ):
        Odd(1 * kPa)


def test_the_interval_may_be_plain_numbers():
    scene = Spring(1 * kPa, "floats")
    np.testing.assert_allclose(sg.solve(scene, 0.5 * kPa).turn, 0.5, rtol=1e-12)
    np.testing.assert_allclose(sg.limit_pressure(scene), 1 * kPa, rtol=1e-9)
