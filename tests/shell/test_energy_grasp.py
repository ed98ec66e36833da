"""Grasps by energy beside the arcs: what the page of the documentation says."""

import numpy as np
import pytest

import softgrip_jax as sg
from softgrip_jax import thesis
from softgrip_jax.thesis import energy_grasp
from softgrip_jax.units import mm


@pytest.fixture(scope="module")
def found():
    return energy_grasp.compute(thesis.TABLE_6_1[4:5], thesis.TABLE_6_2[7:])


@pytest.mark.slow
def test_arcs_and_energy_are_near(found):
    (held,), (tilted,) = found
    one = sg.solve(thesis.cylinder_contact(gap=held.row.gap), held.row.pressure.value)
    assert held.arc == pytest.approx(float(one.force), rel=1e-9)
    # The tension around the cylinder presses, too, which the arcs leave out.
    assert 1 < held.middle / held.arc < 4
    assert 1 < tilted.area / tilted.arc_area < 1.6
    # Towards the end of the membrane, which the offset is nearer to, and less than presses.
    assert 0 < held.along < 0.5 * held.offset


@pytest.mark.slow
def test_the_moment_of_a_pressure_is_that_of_its_sum(found):
    """An even pressure on an ellipse of the computed area and of the arcs' axis ratio, turned about its middle."""
    _, (tilted,) = found
    size = np.sqrt(tilted.area / tilted.arc_area)
    assert tilted.energy / (tilted.arc * size**3) == pytest.approx(1, abs=0.25)


def test_the_page_has_every_row():
    held = energy_grasp.Held(thesis.TABLE_6_1[4], arc=1.0, middle=3.0, offset=2.5, along=0.25)
    tilted = energy_grasp.Tilted(thesis.TABLE_6_2[7], 5e-4, 7e-4, arc=0.1, rim=0.2, energy=0.12)
    text = energy_grasp.page([held], [tilted])
    assert "263 g | 10 mm | 14.5 kPa | 27.9 mm | 1 N | 3 N (+200 %) | 2.5 N (+150 %) | 0.25 N" in text
    assert "563 g | 15 mm | 18.38 kPa | 500, 700 mm² | 200 N mm | 100 N mm | 120 N mm (+20 %) | 0.41, 0.69" in text


@pytest.mark.slow
def test_a_cylinder_in_the_middle_is_pushed_nowhere(found):
    """Without offset nothing pushes along, and the force is that of the scene with more symmetry."""
    (held,), _ = found
    aside = sg.shell.AxialOffset(thesis.shell(), radius=thesis.ROD, gap=held.row.gap, height=43 * mm, model="energy")
    solution = sg.solve(aside, held.row.pressure.value)
    assert abs(float(solution.force_y)) < 1e-9
    np.testing.assert_allclose(solution.force, held.middle, rtol=1e-9)
