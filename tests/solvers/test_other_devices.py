"""What a device that is no CPU does in another way, done on the CPU: its name is all that is changed."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import softgrip_jax as sg
from softgrip_jax.units import kPa, mm


@pytest.fixture
def as_on_a_gpu(monkeypatch):
    """Batches are built as for a GPU, from nothing that was traced before."""
    jax.clear_caches()
    monkeypatch.setattr(jax, "default_backend", lambda: "gpu")
    yield
    jax.clear_caches()


def same(together, alone):
    """All that solutions say, batch beside members."""
    assert len(set(np.asarray(together.status).tolist())) > 1
    for k, one in enumerate(alone):
        assert together.status[k] == one.status
        for name, value in one.observables.items():
            np.testing.assert_allclose(together.observables[name][k], value, rtol=1e-10, atol=1e-13, err_msg=name)


@pytest.mark.slow
def test_membranes_side_by_side_are_those_in_turn(as_on_a_gpu):
    """Also one that stays off the plane, and one beyond its largest pressure."""

    def lane(mu, pressure):
        shell = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=mu))
        plane = sg.shell.obstacles.Plane(5 * mm)
        return sg.solve(sg.shell.ObstacleContact(shell, plane, symmetry="both", across=2, lengthwise=3), pressure)

    mu, pressures = jnp.asarray([175, 175, 150, 400, 60]) * kPa, jnp.asarray([12, 7, 14, 0.01, 31]) * kPa
    alone = jax.jit(lane)
    same(jax.jit(jax.vmap(lane))(mu, pressures), [alone(*one) for one in zip(mu, pressures, strict=True)])


@pytest.mark.slow
def test_fingers_of_many_points_in_a_batch_are_those_alone(as_on_a_gpu):
    """More unknowns than are eliminated entry by entry; the last pressure is beyond the limit."""
    held = sg.pneunet.TipContact(sg.PneuNet.table_5_1("A"), points=16)
    pressures = jnp.asarray([5, 15, 31, 60]) * kPa
    alone = jax.jit(sg.solve)
    same(jax.jit(jax.vmap(sg.solve, (None, 0)))(held, pressures), [alone(held, p) for p in pressures])
