"""Grippers and objects that go together."""

import math

import jax.numpy as jnp
import pytest

import softgrip_jax as sg
from softgrip_jax.errors import InputError
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
        (lambda F: 0.96 - 0.2 * F, "is -0.04 under 5 N"),
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
