"""Fits the numbers of the cell law to the states that `generate.py` made, and to finite elements.

    python benchmarks/cell/fit.py OUT.npz benchmarks/cell/states/*.npz --folds 6

The form of the law is in softgrip_jax/pneunet/cell/form.py. The moment (with p_c) and the contact force are found by
Gauss-Newton steps with damping, on values and on the derivatives by pressure, angle and all dimensions; stretch, lever
and compliance are linear in their numbers. Polynomials of the geometry are held near constants (`prior`).

States come from three sources: finite elements, the solid with a fine mesh and with a coarse one. Each mesh of the
solid has an error of its own in A and p_c, a polynomial of first degree, which is fitted along and left out of the law:
the law is the one of finite elements, the solid tells how it goes with the dimensions.

--folds n: leaves out every n-th geometry in turn and reports the errors there, before the fit of all.
"""

from __future__ import annotations

import argparse
import csv
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from softgrip_jax.pneunet.cell import form

B = 20.0
HERE = Path(__file__).parent
SOURCES = ("finite elements", "fine", "coarse")
WEIGHTS = (1.0, 1.0, 0.2)
"""Of a state of each source; finite elements count for less where a grid of them is one geometry's."""
CROWD = 15
"""States of one geometry by finite elements beyond which each counts for less: those of a grid are of one mind."""
THESIS = 1.5
"""How much more the straight and the free states of types A and E count, the fingers that the thesis built."""
SPREAD = np.array([0.02, 0.05, 0.6 / B, 0.5 / B, 0.15 / B, 0.1 / B, 0.25 / B, 0.6 / B])
"""Of p / mu, phi and the six lengths over B: what a derivative is multiplied with."""
SLOPES = (0.0, 0.2, 0.0)
"""Weight of the derivatives beside the values, of each source."""
DOUBTFUL = 0.06
"""Derivatives that are off by more than so much of the tolerance count less: contact that comes or goes spoils some."""
ERROR = 0.01
"""What is expected of a state, over the tolerance: weighs the states against the priors."""
START = {"p_c": -4.0, "m": 1.3, "n": 0.95, "A": -1.0, "c": 0.93}
FIRST, SECOND = {"p_c": 1.0, "A": 0.5}, {"p_c": 0.15, "A": 0.1, "c": 0.05}
"""Standard deviations of coefficients of first and second degree, of numbers that are not like the rest."""
CONSTANTS, OTHERS, BIAS = 2.0, 0.25, 0.03
PRESSED = 0.03
"""Of the pressure on the wall: forces below it tell nothing of the lever."""
GEOMETRY_OF = {"A": 0, "E": 1}
FIRST_CORNER = 1000
"""Number of the first geometry of corners.csv: no solid has such a one."""


def finite_elements() -> list[list[float]]:
    """Rows (source, geometry, p, phi, six lengths, M, lambda, F, lever, compliance, 24 derivatives), dimensionless."""
    known = {"A": (5.0, 8.0, 1.1, 0.9, 4.2, 5.0), "E": (6.5, 7.0, 1.1, 0.9, 4.2, 5.0)}
    rows, mu = [], 0.136
    with (HERE / "finite_elements.csv").open() as file:
        for row in csv.DictReader(line for line in file if not line.startswith("#")):
            p, kappa, stretch, moment, force, lever = (float(v) for v in list(row.values())[2:])
            if p / 136 > form.MOST_PRESSURE:
                continue
            x = np.array(known[row["geometry"]]) / B
            phi = kappa * B * (0.5 * x[4] + x[3])
            values = [moment / mu / B**3, stretch, force / mu / B**2, np.nan * lever, np.nan]
            rows.append([0, GEOMETRY_OF[row["geometry"]], p / 136, phi, *x, *values, *[np.nan] * 24])
    seen: dict[tuple[float, ...], int] = {}
    with (HERE / "corners.csv").open() as file:
        for row in csv.DictReader(line for line in file if not line.startswith("#")):
            *sizes, p, kappa, stretch, moment, force, _lever = (float(v) for v in row.values())
            geometry = seen.setdefault(tuple(sizes), FIRST_CORNER + len(seen))
            x = np.array(sizes) / B
            phi = kappa * B * (0.5 * x[4] + x[3])
            values = [moment / mu / B**3, stretch, force / mu / B**2, np.nan, np.nan]
            rows.append([0, geometry, p / 136, phi, *x, *values, *[np.nan] * 24])
    return rows


def solids(paths) -> list[list[float]]:
    """The same of the states by `generate`."""
    rows = []
    for path in paths:
        with np.load(path) as data:
            source = 1 if Path(path).name.startswith("fine") else 2
            for r in data["rows"]:
                x = data["sizes"][int(r[0])][:6] / B
                half = 0.5 * x[4] + x[3]
                slopes = r[8:].reshape(3, 8) * np.array([1, 1, *[B] * 6])
                # Place of the cut -> stretch.
                c = r[4] / B
                slopes[1] = slopes[1] / B / half - c / half**2 * np.array([0, 0, 0, 0, 0, 1, 0.5, 0])
                slopes[0], slopes[2] = slopes[0] / B**3, slopes[2] / B**2
                values = [r[3] / B**3, c / half, r[5] / B**2, r[6] / B, r[7] * B / half]
                rows.append([source, r[0], r[1], r[2], *x, *values, *slopes.reshape(-1)])
    return rows


class Data:
    """All states; the latest of a geometry and source that come twice."""

    def __init__(self, paths):
        rows = np.array(finite_elements() + solids(paths))
        self.source, self.geometry = rows[:, 0].astype(int), rows[:, 1].astype(int)
        self.z, values = rows[:, 2:10], rows[:, 10:15]
        self.moment, self.stretch, self.force, self.lever, self.compliance = values.T
        self.slopes = rows[:, 15:].reshape(-1, 3, 8)
        a, b, _, gap, length, H = self.z[:, 2:].T
        p, phi = self.z[:, 0], self.z[:, 1]
        self.half, self.arm = 0.5 * length + gap, a + 0.5 * H
        self.k = phi / self.half
        self.opening = 1 + self.k / np.asarray(jax.vmap(form.rims_meet)(jnp.asarray(self.z[:, 2:])))
        key = [(s, g, round(v, 6)) for s, g, v in zip(self.source, self.geometry, p, strict=True)]
        blocked = {q: abs(m) for q, m, turn in zip(key, self.moment, phi, strict=True) if turn == 0}
        self.blocked = np.array([blocked.get(q, 0.0) for q in key])
        EI = H**3 / 3
        # Where rims have met, moments are large and count less; so do states far from the free one.
        rims = np.where(self.opening < 0.3, np.maximum(np.abs(self.moment - EI * self.k) - 1.6 * self.blocked, 0), 0)
        far = np.maximum(self.moment - 0.5 * self.blocked, 0)
        floor = 0.01 * 0.15 * 4 * a * b * self.arm
        self.tolerance = self.blocked + floor + 0.3 * rims + 0.5 * far + 0.04 * EI * np.abs(self.k)
        per_fe = {g: np.sum((self.source == 0) & (self.geometry == g)) for g in np.unique(self.geometry)}
        crowd = np.array([CROWD / max(per_fe[g], CROWD) for g in self.geometry])
        self.weight = np.array(WEIGHTS)[self.source] * np.where(self.source == 0, np.sqrt(crowd), 1.0)
        # Straight and free states are what is asked for: of the thesis's types they count more than those of the grid.
        asked = (self.source == 0) & (np.abs(self.moment) < 1e-4 * self.blocked) | (phi == 0)
        self.weight *= np.where(asked & (self.geometry < FIRST_CORNER) & (self.source == 0), THESIS, 1.0)


class Numbers:
    """Coefficients of the law's first groups as one vector, with its prior; at its end the solids' own errors."""

    GROUPS = ("touch", "moment", "force")
    OWN = (form.PLACES["touch"].start, form.PLACES["moment"].start, form.PLACES["force"].start)
    """p_c, A of the moment, A of the force."""

    def __init__(self):
        places, means, widths = [], [], []
        row = 0
        for head, group in form.NUMBERS.items():
            for name, count in group.items():
                for j in range(count if head in self.GROUPS else 0):
                    places.append((row, j))
                    degree = 0 if j == 0 else 1 if j < form.LINEAR else 2
                    means.append(START.get(name, 0.0) if degree == 0 else 0.0)
                    width = (CONSTANTS, FIRST.get(name, OTHERS), SECOND.get(name, OTHERS))[degree]
                    widths.append(width * (3.0 if name.startswith("rim") else 1.0))
                row += 1
        self.rows, self.columns = np.array(places).T
        own = 2 * len(self.OWN) * form.LINEAR
        self.means = np.concatenate([means, np.zeros(own)])
        self.widths = np.concatenate([widths, np.full(own, BIAS)])

    def own(self, vector):
        """(fine and coarse, of OWN, geometry functions)."""
        return vector[len(self.rows) :].reshape(2, len(self.OWN), form.LINEAR)

    def table(self, vector, source):
        """(numbers, geometry functions) as a state of a source sees them; source 0 is the law."""
        C = jnp.zeros((len(form.COUNTS), form.QUADRATIC)).at[self.rows, self.columns].set(vector[: len(self.rows)])
        own = jnp.concatenate([jnp.zeros((1, len(self.OWN), form.LINEAR)), self.own(vector)])[source]
        return C.at[np.array(self.OWN), : form.LINEAR].add(own)


NUMBERS = Numbers()


def both(vector, z, source):
    """Moment and force of a state."""
    p, phi, x = z[0], z[1], z[2:]
    c = form.loaded(NUMBERS.table(vector, source), x, p)
    f = form.functions(c, phi / (0.5 * x[4] + x[3]))
    return jnp.stack([form.moment(c, f), form.force(c, f)])


def gauss_newton(data, which, vector, rounds):
    """The vector of NUMBERS that fits the states `which` best."""
    with_slopes = which & (np.array(SLOPES)[data.source] > 0) & (data.opening > 0.2) & (data.z[:, 0] > 0)
    z, source = jnp.asarray(data.z), jnp.asarray(data.source)
    seen, sloped = np.where(which)[0], np.where(with_slopes)[0]
    wanted = np.stack([data.moment, data.force], 1)
    tolerance = np.stack([data.tolerance, data.tolerance / data.arm], 1)
    scale = data.weight[:, None] / tolerance / ERROR
    slope = data.slopes[:, [0, 2]] * SPREAD
    robust = np.ones((len(sloped), 2, 8))

    def slopes(vector, z, s):
        return jax.jacrev(both, argnums=1)(vector, z, s) * SPREAD

    def rows(function, vector, where, weight):
        J = jax.lax.map(lambda a: jax.jacfwd(function)(vector, *a), (z[where], source[where]), batch_size=64)
        return (J * weight[..., None]).reshape(-1, len(vector))

    @jax.jit
    def normal(vector, robust):
        r = ((jax.vmap(both, (None, 0, 0))(vector, z[seen], source[seen]) - wanted[seen]) * scale[seen]).reshape(-1)
        J = rows(both, vector, seen, scale[seen])
        A, g, cost = J.T @ J, J.T @ r, r @ r
        if len(sloped):
            w = scale[sloped][..., None] * robust * np.array(SLOPES)[data.source[sloped]][:, None, None]
            rs = (jax.vmap(slopes, (None, 0, 0))(vector, z[sloped], source[sloped]) - slope[sloped]) * w
            J, rs = rows(slopes, vector, sloped, w), rs.reshape(-1)
            A, g, cost = A + J.T @ J, g + J.T @ rs, cost + rs @ rs
        d = (vector - NUMBERS.means) / NUMBERS.widths
        return A + jnp.diag(NUMBERS.widths**-2.0), g + d / NUMBERS.widths, cost + d @ d

    misses = jax.jit(lambda v: jax.vmap(slopes, (None, 0, 0))(v, z[sloped], source[sloped]) - slope[sloped])
    damping = 1e-4
    A, g, cost = normal(vector, robust)
    for step in range(rounds):
        if step in (6, 14) and len(sloped):
            off = np.asarray(misses(vector)) / tolerance[sloped][..., None]
            robust = 1 / np.sqrt(1 + (off / DOUBTFUL) ** 2)
            A, g, cost = normal(vector, robust)
        if step % 10 == 0:
            print(f"  {step}: {float(cost):.1f} damping {damping:.0e}", flush=True)
        new = vector - np.linalg.solve(A + damping * np.diag(np.diag(A)), g)
        A_new, g_new, cost_new = normal(new, robust)
        if np.isfinite(cost_new) and cost_new < cost:
            gain = (cost - cost_new) / cost
            vector, A, g, cost, damping = new, A_new, g_new, cost_new, max(damping / 5, 1e-9)
            if gain < 3e-4 and step > 16:
                break
        else:
            damping *= 8
            if damping > 1e6:
                break
    return vector


def linear_heads(C, data, which):
    """C with the numbers of stretch, lever and compliance, each by one regularised linear problem."""
    C = np.array(C)

    def terms(z):
        c = form.loaded(C, z[2:], z[0])
        f = form.functions(c, z[1] / (0.5 * z[6] + z[5]))
        G = form.geometry_functions(z[2:])

        def products(head, of_numbers):
            """What the head, a sum of its numbers times functions of the state, is a sum of."""
            values = jax.grad(of_numbers)(c.numbers[form.PLACES[head]])
            return jnp.concatenate([t * G[:n] for t, n in zip(values, form.NUMBERS[head].values(), strict=True)])

        F, M = form.force(c, f), form.moment(c, f)
        return (
            products("stretch", lambda numbers: form.strain(numbers, f, c.x[5], F, M)),
            products("lever", lambda numbers: form.more_lever(numbers, f)),
            products("compliance", lambda numbers: form.log_compliance(numbers, f)),
        )

    H, coarse = data.z[:, 7], data.source == 2
    pressed = data.force > PRESSED * 4 * data.z[:, 2] * data.z[:, 3] * np.maximum(data.z[:, 0], 0.02)
    wanted = [data.stretch - 1, data.lever / data.arm - 1, np.log(np.maximum(data.compliance, 1e-9) * 4 * H)]
    errors = [0.003 + 0.03 * np.abs(wanted[0]), 0.02 + 0.1 * coarse, 0.05 + 0 * H]
    known = [np.isfinite(y) & which for y in wanted]
    known[1] &= pressed
    rows = [np.asarray(r) for r in jax.jit(jax.vmap(terms))(jnp.asarray(data.z))]
    for head, A, y, use, error in zip(("stretch", "lever", "compliance"), rows, wanted, known, errors, strict=True):
        ridge = np.concatenate([np.repeat([1.0, 3.0, 6.0], [1, 6, 21])[:n] for n in form.NUMBERS[head].values()])
        size = np.sqrt(np.mean(A[use] ** 2, 0)) + 1e-9
        M = A[use] / size * (data.weight / error)[use][:, None]
        found = np.linalg.solve(M.T @ M + np.diag(ridge**2), M.T @ (y * data.weight / error)[use]) / size
        begin = 0
        for row, count in zip(range(len(C))[form.PLACES[head]], form.NUMBERS[head].values(), strict=True):
            C[row, :count] = found[begin : begin + count]
            begin += count
        off, mask = A @ found - y, use & ~coarse & (data.opening > 0.3)
        print(f"  {head}: rms {np.sqrt(np.mean(off[mask] ** 2)):.4f}, most {np.abs(off[mask]).max():.4f}", flush=True)
    return C


def fitted(data, which, start=None, rounds=60):
    """The vector of NUMBERS from the states `which`."""
    vector = gauss_newton(data, which, jnp.asarray(NUMBERS.means) if start is None else start, rounds)
    print("  the solids' own (fine, coarse; p_c, A, A of the force):", np.asarray(NUMBERS.own(vector))[..., 0].round(3))
    return vector


def seen_as(vector, data):
    """Moment and force of the law at all states, with each solid's own error."""
    every = jax.jit(jax.vmap(both, (None, 0, 0)))
    return np.asarray(every(vector, jnp.asarray(data.z), jnp.asarray(data.source))).T


def report(label, data, moment, force, which):
    off = 100 * (moment - data.moment) / np.maximum(data.blocked, 1e-12)
    off_F = 100 * (force - data.force) / np.maximum(data.blocked / data.arm, 1e-12)
    straight = np.abs(data.k) < 1e-9
    near = (data.k > 1e-9) & (data.moment < 0.3 * data.blocked)
    back = (data.k < -1e-9) & (data.opening > 0.3)
    for source in np.unique(data.source):
        for low, high in ((4, 6), (6, 16), (16, 40)):
            for name, place in (("straight", straight), ("bent", near), ("bent back", back)):
                mask = which & place & (data.source == source)
                mask &= (data.z[:, 0] * 136 > low) & (data.z[:, 0] * 136 <= high) & (data.blocked > 0)
                if mask.any():
                    print(
                        f"{label}, {SOURCES[source]}, {low} to {high} kPa, {name} ({mask.sum()}), % of blocked:"
                        f" M {np.sqrt(np.mean(off[mask] ** 2)):.1f}/{np.abs(off[mask]).max():.1f}"
                        f"  F {np.sqrt(np.mean(off_F[mask] ** 2)):.1f}/{np.abs(off_F[mask]).max():.1f}",
                        flush=True,
                    )


def main(out, paths, folds):
    data = Data(paths)
    everything = np.ones(len(data.source), bool)
    geometries = np.unique(data.geometry)
    print(len(data.source), "states,", len(geometries), "geometries, of each source", np.bincount(data.source))
    vector = fitted(data, everything)
    report("fitted", data, *seen_as(vector, data), everything)
    C = linear_heads(np.asarray(NUMBERS.table(vector, 0)), data, everything)
    np.savez_compressed(out, C=C.astype(np.float32))
    if folds:
        moment, force = 0 * data.moment, 0 * data.force
        for fold in range(folds):
            left = np.isin(data.geometry, geometries[fold::folds])
            own = fitted(data, ~left, vector, 8)
            moment[left], force[left] = (values[left] for values in seen_as(own, data))
        report("left out", data, moment, force, everything)


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("out")
    parser.add_argument("data", nargs="+")
    parser.add_argument("--folds", type=int, default=0)
    a = parser.parse_args()
    main(a.out, a.data, a.folds)
