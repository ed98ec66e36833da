"""How scenes and actuators print: numbers with units, every choice, and never an exception."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import CASES

import softgrip_jax as sg
from softgrip_jax.units import gram, kPa, mm

SHELL = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
FREE = sg.shell.Free(SHELL)
FINGER = sg.PneuNet.table_5_1("A")


@pytest.mark.parametrize(
    ("made", "printed"),
    [
        (SHELL, "FlatShell(a=16 mm, b=43 mm, t_m=1.1 mm, material=NeoHookean(mu=175 kPa))"),
        (sg.Ogden(mu=[1e5, 2e3], alpha=[2.0, -4.5]), "Ogden(mu=[100, 2] kPa, alpha=[2, -4.5])"),
        (
            sg.shell.FlatContact(SHELL, distance=5 * mm, model="energy"),
            f"FlatContact(shell={SHELL}, distance=5 mm, model='energy', bending=True)",
        ),
        (
            sg.pneunet.Free(FINGER, clamp_angle=np.pi / 6),
            f"Free(finger={FINGER}, weight=[0, -2] N/m, tip_load=None, clamp_angle=30 deg, section='exact', "
            "inclination='segment', combination='sum', points=16, loading='first', "
            "drive='thesis', moment_spread='root')",
        ),
        (
            sg.objects.Cylinder(radius=18 * mm, mass=26 * gram, friction=jnp.tanh),
            "Cylinder(radius=18 mm, mass=26 g, friction=FrictionLaw(law=tanh))",
        ),
    ],
    ids=lambda value: type(value).__name__,
)
def test_numbers_carry_units(made, printed):
    assert repr(made) == str(made) == printed


def test_arrays_print_by_what_they_hold():
    many = jax.tree.map(lambda leaf: leaf * jnp.linspace(1, 2, 30), SHELL)
    assert repr(many).startswith("FlatShell(a=30 values from 16 mm to 32 mm, b=30 values from 43 mm to 86 mm")
    alike = jax.tree.map(lambda leaf: jnp.stack([leaf, leaf]), SHELL)
    assert repr(alike).startswith("FlatShell(a=2 values of 16 mm")
    two = jax.tree.map(lambda leaf: leaf * jnp.ones((2, 3)), SHELL)
    assert repr(two).startswith("FlatShell(a=2 x 3 values of 16 mm")
    empty = jax.tree.map(lambda leaf: leaf * jnp.ones(0), SHELL)
    assert repr(empty).startswith("FlatShell(a=[] mm, b=[] mm,")


def test_derivatives_print_without_the_units_of_the_scene():
    scene = sg.shell.FlatContact(SHELL, distance=5 * mm)
    slopes = jax.grad(lambda s: sg.solve(s, 15 * kPa).force)(scene)
    assert f"a={float(slopes.shell.a):.6g}, b=" in repr(slopes)
    assert "mm" not in repr(slopes)


@pytest.mark.parametrize("case", CASES, ids=str)
def test_every_scene_prints_wherever_jax_puts_it(case):
    """Traced, as shapes, as a structure, and as the placeholders that JAX and Equinox rebuild trees with."""
    scene = case.make()
    printed = []
    jax.eval_shape(lambda s: printed.append(repr(s)), scene)
    batch = jax.tree.map(lambda leaf: jnp.stack([leaf, leaf]), scene)
    jax.eval_shape(jax.vmap(lambda s: (printed.append(repr(s)), 0.0)[1]), batch)
    assert all("traced" in text for text in printed)
    for stand_in in (object(), None, jax.ShapeDtypeStruct((2,), float), np.zeros((), dtype=jax.dtypes.float0), "x", 1):
        rebuilt = jax.tree.map(lambda _, one=stand_in: one, scene)
        assert repr(rebuilt).startswith(type(scene).__name__)
    assert repr(jax.tree.structure(scene))


def test_a_module_prints_while_it_is_made():
    half = object.__new__(sg.FlatShell)
    object.__setattr__(half, "a", jnp.asarray(0.016))
    assert repr(half) == "FlatShell(a=16 mm)"


def test_numbers_that_are_gone_print():
    gone = jnp.asarray(0.016)
    scene = sg.FlatShell(a=gone, b=0.043, t_m=0.0011, material=SHELL.material)
    held = scene.a
    held.delete()
    assert "a=float64[]" in repr(scene)
