"""Grippers and objects that go together."""

import pytest

import softgrip_jax as sg
from softgrip_jax.errors import InputError
from softgrip_jax.units import gram, mm

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
