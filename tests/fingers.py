"""Fingers in the units of `reference_beam` (mm, N, MPa), solved by the package in batches of one size: one program."""

import jax
import jax.numpy as jnp
import numpy as np

import softgrip_jax as sg
from softgrip_jax.reasons import RULE_NAMES
from softgrip_jax.units import N_mm, mm

MPa = 1e6
TYPE_A = {"a": 5.0, "b": 8.0, "h_x": 0.9, "t_m": 1.1, "h_L": 4.2, "H": 5.0, "B": 20.0, "L": 77.0, "mu": 0.136}
TYPE_C = TYPE_A | {"h_x": 0.75, "t_m": 1.5, "h_L": 4.5}
TYPES = {"A": TYPE_A, "B": TYPE_A | {"mu": 0.198}, "C": TYPE_C, "D": TYPE_C | {"mu": 0.198}}
"""Thesis table 5.1."""

LANES = 16
"""Every batch is filled up to a multiple of this."""

ALL_RULES = {"ignored_rules": RULE_NAMES}
"""Checks of the equations go through fingers that no mould could hold and bend them further than neighbours allow."""

solve = jax.jit(jax.vmap(sg.solve))


def pneunet(f):
    """The finger of a dict."""
    lengths = {name: value * mm for name, value in f.items() if name != "mu"}
    return sg.PneuNet(**lengths, material=sg.NeoHookean(f["mu"] * MPa))


def stacked(scenes):
    """Scenes of one kind as one scene with a leading axis."""
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *scenes)


def solved(scenes, pressures):
    """Observables of a list of scenes at pressures in MPa, in N, mm, N mm and rad, with the status and the residual."""
    out = []
    for k in range(0, len(scenes), LANES):
        some = list(zip(scenes, pressures, strict=True))[k : k + LANES]
        filled = some + [some[0]] * (LANES - len(some))
        batch = stacked([scene for scene, _ in filled])
        solution = solve(batch, jnp.array([p * MPa for _, p in filled]))
        seen = solution.observables | {"status": solution.status, "residual": solution.residual}
        out.append({name: np.asarray(value)[: len(some)] for name, value in seen.items()})
    result = {name: np.concatenate([part[name] for part in out]) for name in out[0]}
    return result | {"tip": result["tip"] / mm, "end_moment": result["end_moment"] / N_mm}


def contact(f, law, offset=0.0, pull=0.0, weight=(0.0, 0.0)):
    """A TipContact from mm, N and N/mm."""
    return sg.pneunet.TipContact(
        pneunet(f),
        tip_offset=offset * mm,
        tip_pull=pull,
        weight=jnp.asarray(weight, float) / mm,
        section=law,
        **ALL_RULES,
    )


def free(f, law, weight=(0.0, 0.0), tip_load=(0.0, 0.0), clamp=0.0, **options):
    """A Free with loads (zeros too: arrays keep the beam equations) from mm, N and N/mm."""
    return sg.pneunet.Free(
        pneunet(f),
        weight=jnp.asarray(weight, float) / mm,
        tip_load=jnp.asarray(tip_load, float),
        clamp_angle=clamp,
        section=law,
        **ALL_RULES,
        **options,
    )
