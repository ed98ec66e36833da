"""Grippers and objects that go together."""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import softgrip_jax as sg
from softgrip_jax.errors import InputError
from softgrip_jax.fields import finite, positive
from softgrip_jax.objects import Object, friction
from softgrip_jax.scene import Scalar
from softgrip_jax.units import gram, kPa, mm

TYPE_A = sg.PneuNet.table_5_1("A")
HELD = {
    "round": sg.objects.Cylinder(18 * mm, 26 * gram, 0.96),
    "hexagon": sg.objects.HexagonalCylinder(15 * mm, 35 * gram, 0.96),
    "pyramid": sg.objects.ThreeFaceCone(50 * mm, 80 * mm, 19 * gram, 0.96),
}


@pytest.mark.parametrize(
    ("name", "fitting"),
    [("round", {2, 3, 4, 5, 6}), ("hexagon", {2, 3, 6}), ("pyramid", {3})],
)
@pytest.mark.parametrize("n", [2, 3, 4, 5, 6])
def test_every_finger_meets_the_middle_of_a_face(name, fitting, n):
    gripper = sg.pneunet.Gripper(TYPE_A, n=n, base_radius=25 * mm)
    if n in fitting:
        assert sg.pneunet.Grasp(gripper, HELD[name], stand_distance=110 * mm).gripper.n == n
        return
    with pytest.raises(InputError, match=f"Gripper.n is {n}, and a .* n that fit: {', '.join(map(str, fitting))}"):
        sg.pneunet.Grasp(gripper, HELD[name], stand_distance=110 * mm)


@pytest.mark.parametrize(
    ("law", "said"),
    [
        (lambda F: -0.96 + 0 * F, "is -0.96 under 0.01 N; a coefficient of friction must be a finite number, zero or"),
        (lambda F: jnp.log(-F), "is nan under 0.01 N"),
        (lambda F: 0.96 - 2 * F, "is -0.04 under 0.5 N"),
        (lambda F: 1 / jnp.maximum(F - 0.01, 0.0), "is inf under 0.01 N"),
        (lambda F: math.exp(-F), r"cannot be differentiated by JAX \(line \d+ of test_grasp.py\)"),
        (lambda F: 0.96 if F < 1 else 0.5, "cannot .* jnp.where in place of if"),
        (lambda F: jnp.stack([F]), r"gives an array of the shape \(1,\); it must be one number"),
        (lambda F: None, "gives None"),
        (lambda: 0.96, "raises TypeError"),
    ],
)
def test_a_friction_law_gives_a_coefficient(law, said):
    """As a number -0.96 was refused; as a law it was OK, with a negative security."""
    with pytest.raises(InputError, match=f"^The friction law {said}"):
        sg.objects.Cylinder(18 * mm, 26 * gram, law)


def test_a_constant_law_is_the_number():
    """A plain number of Python, whole or not."""
    for number in (0.96, 1):
        assert sg.objects.Cylinder(18 * mm, 26 * gram, lambda F, mu=number: mu).friction.law(1.0) == number


def test_a_list_of_coefficients_is_several_objects():
    """One scene has one; it ended in a trace-back of JAX."""
    grasp = sg.pneunet.Grasp(sg.pneunet.Gripper(TYPE_A), sg.objects.Cylinder(18 * mm, 26 * gram, [0.96]))
    with pytest.raises(InputError, match=r"Cylinder.friction has the shape \(1,\), and one scene has one number there"):
        sg.solve(grasp, 20 * kPa)


class Cup(Object):
    """A cone by its radius alone, which says of its faces what `said` is."""

    radius: Scalar = positive("length")
    narrowing: Scalar = finite("number")
    mass: Scalar = positive("mass")
    friction: Scalar = friction()
    said: str = eqx.field(static=True, default="tapers")

    def radius_at(self, height):
        return self.radius - self.narrowing * height

    def slope(self):
        return (jnp.ones(()), jnp.zeros(())) if self.said == "upright slope" else super().slope()

    @property
    def tapers(self):
        return self.said != "nothing"


NARROW = {"radius": 22 * mm, "narrowing": 22 / 70, "mass": 8 * gram, "friction": 1.2}


def test_an_object_of_ones_own_leans_as_its_radius_does():
    """Without a slope it was taken as upright, and held from 12 kPa on; a cone of the same radius from 17.

    By hand, with the forces along the face and across it: (mu - f) / (1 + mu f) of the force, where the radius falls by
    f."""
    cone, falls = sg.objects.Cone(22 * mm, 70 * mm, 8 * gram, 1.2), 22 / 70
    for held in (Cup(**NARROW), cone):
        lifted = sg.objects.friction_force(held.lift(), jnp.asarray(0.5))
        assert float(lifted) == pytest.approx(0.5 * (1.2 - falls) / (1 + 1.2 * falls), rel=1e-12)


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"said": "nothing"}, r"Cup.radius_at falls by 0.3143 m per metre of height, and Cup.tapers is False; give it"),
        ({"said": "upright slope"}, r"and Cup.slope is \(1, 0\), which falls by 0"),
        ({"said": "nothing", "narrowing": -0.1}, "Cup.radius_at falls by -0.1 m per metre"),
    ],
)
def test_an_object_that_leans_says_so(changed, said):
    assert Cup(**NARROW | {"said": "nothing", "narrowing": 0.0}).lift() == 1.2
    with pytest.raises(InputError, match=said):
        Cup(**NARROW | changed)


def test_an_object_whose_slope_cannot_follow_from_its_radius_gives_it():
    class Curved(Object):
        mass: Scalar = positive("mass")
        friction: Scalar = friction()

        def radius_at(self, height):
            return 20 * mm - 0.1 * height - 5 * height**2

        @property
        def tapers(self):
            return True

    with pytest.raises(InputError, match=r"falls by 0.1 to 0.3 m per metre of height; give Curved.slope"):
        Curved(8 * gram, 1.2)


def test_an_object_without_mass_or_radius_is_named():
    class Thing(Object):
        friction: Scalar = friction()

        def radius_at(self, height):
            return 20 * mm if height < 1 else 10 * mm

    class Heavy(Thing):
        mass: Scalar = positive("mass")

    with pytest.raises(InputError, match=r"Thing has no mass \(kg\); an object to be grasped needs it"):
        Thing(1.2)
    with pytest.raises(
        InputError, match=r"Heavy.radius_at cannot be differentiated by JAX \(line \d+ of test_grasp.py"
    ):
        Heavy(1.2, 8 * gram)


def test_a_curve_over_pressure_of_a_grasp_has_slopes():
    """The required force depends on the object alone: a batch of pressures has one of it, and a calibration to what a
    gripper presses with ended in a trace-back of JAX."""
    shell = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
    grasp = sg.shell.Grasp(shell, radius=20 * mm, gap=5 * mm, mass=563 * gram, friction=0.96)
    pressures = jnp.asarray([8.0, 10.0, 12.0]) * kPa

    @jax.jit
    def curve(factors):
        changed = eqx.tree_at(
            lambda g: (g.shell.material.mu, g.mass), grasp, (175 * kPa * factors[0], 563 * gram * factors[1])
        )
        sol = jax.vmap(lambda pressure: sg.solve(changed, pressure))(pressures)
        return jnp.stack([sol.force, sol.required_force, sol.security])

    now, step = jnp.ones(2), 1e-5
    slopes = jax.jit(jax.jacfwd(curve))(now)
    by_differences = [(curve(now.at[k].add(step)) - curve(now.at[k].add(-step))) / (2 * step) for k in range(2)]
    np.testing.assert_allclose(slopes, jnp.stack(by_differences, axis=-1), rtol=1e-6, atol=1e-8)


@pytest.mark.parametrize("model", ["arc", "energy"])
def test_no_pressure_is_sought_for_the_force_that_a_shell_needs(model):
    """The weight and the friction alone make it; a value below it was said to be passed where nothing is touched."""
    made = sg.FlatShell(a=0.016, b=0.043, t_m=0.0011, material=sg.NeoHookean(mu=175e3))
    grasp = sg.shell.Grasp(made, radius=0.02, gap=0.005, mass=0.5, friction=0.9, model=model)
    with pytest.raises(InputError, match="required_force is the same at every pressure"):
        sg.pressure_for(grasp, required_force=1.0)


def test_no_pressure_is_sought_for_the_force_that_a_tip_needs():
    rod = sg.objects.Cylinder(radius=0.018, mass=0.026, friction=0.96)
    grasp = sg.pneunet.Grasp(sg.pneunet.Gripper(sg.PneuNet.table_5_1("A")), rod)
    with pytest.raises(InputError, match="required_force is the same at every pressure"):
        sg.pressure_for(grasp, required_force=0.05)
