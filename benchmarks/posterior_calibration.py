"""Simulation-based calibration of posteriors: is a 95 % interval right in 95 % of cases?

    python -m benchmarks.posterior_calibration --sets 500

Parameters are drawn from their priors, a curve of 20 points of free inflation of a shell from them (with noise and
model error), and the posterior from that curve; the truth is then equally likely to have any rank among the draws
(Talts, Betancourt, Simpson, Vehtari and Gelman 2018). Writes docs/benchmarks/posterior.csv: for mu, noise and model
error a p value of uniform ranks (chi square over 20 bins), and in how many sets the central 50 and 95 % held the truth.
"""

from __future__ import annotations

import argparse
import csv
import time
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from scipy import stats

import optim
import softgrip_jax as sg
from optim.posterior.density import Density
from optim.posterior.priors import Prior
from optim.posterior.sample import advanced, kernel
from softgrip_jax.units import kPa, mm

POINTS, WARMUP, RANKED, EVERY = 20, 300, 99, 5
"""Draws are taken every fifth, so that they are nearly independent of each other."""
BINS = 20
AT_ONCE = 50
MEDIAN, SPREAD = 175 * kPa, 0.15
FILE = Path(__file__).resolve().parent.parent / "docs" / "benchmarks" / "posterior.csv"


def density() -> Density:
    """The posterior of mu, noise and model error by 20 points of free inflation."""
    shell = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=MEDIAN))
    pressures = np.linspace(1, 9, POINTS) * kPa
    y = np.asarray(sg.path(sg.shell.Free(shell), pressures).inflation)
    y = y * (1 + 0.01 * np.cos(np.arange(POINTS)))
    curve = optim.Curve("free", "free", "inflation", "length", pressures, y)
    variable = optim.Variable("shell.material.mu", 80 * kPa, 400 * kPa, "log")
    fit = optim.calibrate(optim.Fitting({"free": sg.shell.Free(shell)}, [variable], [curve]), starts=1)
    return Density(fit, [Prior("lognormal", MEDIAN, SPREAD)])


def synthetic(known: Density, sets: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """(truths, curves): mu, sigma and delta from their priors, and data from them."""
    rng = np.random.default_rng(seed)
    space, one = known.fitting.space, known.errors[0]
    mu = known.priors[0].quantiles(space.low[0], space.high[0], rng.random(sets))
    sigma = known.noise_scales[0] * np.abs(rng.normal(size=sets))
    delta = known.discrepancy * np.abs(rng.normal(size=sets))
    values = jax.jit(lambda mu: jax.lax.map(lambda m: known.modelled(jnp.reshape(m, (1, 1)), slopes=False), mu))
    modelled = values(jnp.asarray(mu))
    if not bool(jnp.all(modelled.ok)):
        raise SystemExit("A set has a point without equilibrium.")
    noise = sigma[:, None] ** 2 + known.floor[0] ** 2 + delta[:, None] ** 2 * one.lam[None, :]
    errors = (np.sqrt(noise) * rng.normal(size=noise.shape)) @ one.q.T
    return np.stack([mu, sigma, delta], axis=1), np.asarray(modelled.values) + errors


def ranks(known: Density, truths: np.ndarray, curves: np.ndarray, seed: int) -> np.ndarray:
    """The rank of every truth among the draws of its posterior, one row per set."""
    centre, scale = (jnp.asarray(v) for v in known.start())

    def one(y: Any, truth: Any, key: Any) -> Any:
        nuts = kernel(lambda e: known.potential(centre + scale * e, y))
        start = jax.random.normal(key, (known.size,))
        state, _ = advanced(nuts, nuts.init(key, WARMUP, start, (), {}), WARMUP)
        _, (e, _, diverging, *_) = advanced(nuts, state, EVERY * RANKED)
        found = jax.vmap(lambda e: known.unknowns(centre + scale * e, y))(e[::EVERY])
        drawn = jnp.stack([found.x[:, 0], found.sigma[:, 0], found.delta[:, 0]], axis=-1)
        return jnp.sum(drawn < truth, axis=0), jnp.sum(diverging)

    run = jax.jit(jax.vmap(one))
    keys = jax.random.split(jax.random.key(seed), len(truths))
    found, diverged = [], 0
    for k in range(0, len(truths), AT_ONCE):
        part = slice(k, k + AT_ONCE)
        rank, bad = run(jnp.asarray(curves[part]), jnp.asarray(truths[part]), keys[part])
        found.append(np.asarray(rank))
        diverged += int(jnp.sum(bad))
        print(f"{min(k + AT_ONCE, len(truths))} of {len(truths)}, {diverged} divergences", flush=True)
    return np.concatenate(found)


def main() -> None:
    """Run it and write the table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--sets", type=int, default=500, help="a multiple of 50")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    began = time.process_time()
    known = density()
    truths, curves = synthetic(known, given.sets, given.seed)
    found = ranks(known, truths, curves, given.seed)
    rows = []
    for name, column in zip(("mu", "noise", "model error"), found.T, strict=True):
        counts = np.bincount(column * BINS // (RANKED + 1), minlength=BINS)
        place = (column + 0.5) / (RANKED + 1)
        rows.append(
            {
                "parameter": name,
                "sets": len(column),
                "p_uniform": round(float(stats.chisquare(counts).pvalue), 3),
                "inside_50_percent": round(float(np.mean(np.abs(place - 0.5) < 0.25)), 3),
                "inside_95_percent": round(float(np.mean(np.abs(place - 0.5) < 0.475)), 3),
            }
        )
        print(rows[-1])
    print(f"{time.process_time() - began:.0f} s of processor time")
    with FILE.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)


if __name__ == "__main__":
    main()
