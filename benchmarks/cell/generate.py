"""States of many cells by the three-dimensional solid: the data that the cell law is fitted to.

    python benchmarks/cell/generate.py OUT --first 0 --count 30 --seconds 2400

Every geometry is taken from rest through the pressures without curvature, and from each of these states to curvatures
about the one of the free finger and to negative ones, without axial force. At each state the moment, the stretch and
the contact force are noted with their derivatives by pressure, angle and all dimensions: adjoints give them for the
price of one more solution. Results are written to OUT/MESH_FIRST.npz after each geometry. Lengths in mm, pressures over
mu, moments in mu mm^3 and forces in mu mm^2, of the full width.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from scipy.linalg import cho_factor, cho_solve, lu_factor, lu_solve
from scipy.stats import qmc

from softgrip_jax.pneunet.cell import solid as S

VARIED = ("a", "b", "t_m", "h_x", "h_L", "H")
LOW = S.Sizes(a=4.2, b=6.7, t_m=0.85, h_x=0.55, h_L=3.8, H=3.8, B=20.0, top=2.0)
HIGH = S.Sizes(a=7.2, b=9.2, t_m=1.55, h_x=0.95, h_L=4.9, H=6.2, B=20.0, top=2.0)
ROOM = 0.8
"""Least length of a cavity along the finger, mm."""
KNOWN = [
    S.Sizes(5.0, 8.0, 1.1, 0.9, 4.2, 5.0, 20.0, 2.0),
    S.Sizes(6.5, 7.0, 1.1, 0.9, 4.2, 5.0, 20.0, 2.0),
    S.Sizes(5.0, 8.0, 1.5, 0.75, 4.5, 5.0, 20.0, 2.0),
]
"""Types A (and B), E, and C (and D)."""
PRESSURES = np.array([5.0, 12.0, 21.0, 32.0]) / 136
"""Over mu: these numbers in kPa for type A."""
FORWARDS = np.array([1.0, 2.0])
"""Over the curvature of the free finger, as the tangent of the straight one estimates it."""
LEAST_FAR, MOST_BENT = 0.05, 0.13
"""1/mm, about the last of these curvatures."""
BACKWARDS = np.array([0.6, 1.5])
"""Over the curvature at which the rims of rigid neighbours would meet."""
DEGREES = {
    "coarse": S.Degrees((1, 2, 1), (2, 2, 4, 2, 1), (4, 2, 2)),
    "fine": S.Degrees((1, 2, 1), (2, 2, 3, 3, 3, 2, 1), (3, 3, 2, 1)),
}
"""Coarse: every curvature, with errors of 3 % in the moment and 6 % in the force. Fine: 1 % and 2 %, one more at the
pressure where walls begin to touch; only the straight cell, the free one, and one bent back before rims meet."""
MOST_STEPS = 14
FINEST = 0.05
SETTLED = 1e-5
"""The last Newton step, mm: what is left of the error is its square."""
NEAR = 2e-3
"""Below such a step, mm, the last Hessian serves again."""
STEP = 1e-3
"""Of the central differences of the volume, which is a cubic."""
LONGEST = 1.5
"""... and the longest, mm."""


CORNER_LOW = dict(zip(VARIED, (4.5, 7.0, 0.9, 0.6, 4.1, 4.0), strict=True))
CORNER_HIGH = dict(zip(VARIED, (7.0, 9.0, 1.5, 0.9, 4.7, 6.0), strict=True))
FIRST_CORNER, CORNERS = 12, 16


def corner(number: int) -> S.Sizes:
    """One of the 2^(6-2) corners of a fractional factorial design, so ordered that each is far from those before."""
    signs = np.array([[1 if i >> j & 1 else -1 for j in range(4)] for i in range(CORNERS)])
    a, b, t, h = signs.T
    signs = np.stack([a, b, t, h, a * b * t, b * t * h], 1)
    order = [0]
    while len(order) <= number:
        distance = np.abs(signs[:, None] - signs[order]).sum(-1)
        distance = np.where(np.isin(np.arange(CORNERS), order), -1, np.min(distance, 1) * 100 + distance.mean(1))
        order.append(int(np.argmax(distance)))
    chosen = zip(VARIED, signs[order[number]], strict=True)
    return LOW._replace(**{n: (CORNER_HIGH if sign > 0 else CORNER_LOW)[n] for n, sign in chosen})


def geometry(index: int) -> S.Sizes:
    """A, E, C, then a Sobol sequence, from FIRST_CORNER on two corners to each point of it."""
    if index < len(KNOWN):
        return KNOWN[index]
    number, place = divmod(index - FIRST_CORNER, 3)
    if index >= FIRST_CORNER and number < CORNERS // 2:
        if place < 2:
            return corner(2 * number + place)
        index = FIRST_CORNER + number
    elif index >= FIRST_CORNER:
        index -= CORNERS
    points, found = qmc.Sobol(len(VARIED), seed=7).random(4096), len(KNOWN) - 1
    for point in points:
        values = {
            n: getattr(LOW, n) + u * (getattr(HIGH, n) - getattr(LOW, n)) for n, u in zip(VARIED, point, strict=True)
        }
        found += values["h_L"] - 2 * values["t_m"] >= ROOM
        if found == index:
            return LOW._replace(**values)
    raise ValueError(index)


def rims_meet(s: S.Sizes) -> float:
    return s.h_x / ((0.5 * s.h_L + s.h_x) * (0.5 * s.H + 2 * s.a + s.top))


class Follower:
    """One cell, from state to state. Factors of the Hessian are kept: near a root they serve again, and they give the
    adjoints. Second derivatives along a direction are central differences of the gradient."""

    def __init__(self, solid: S.Solid):
        self.solid = solid

        def varied(sizes, x):
            return sizes._replace(**dict(zip(VARIED, x, strict=True)))

        def energy(q, z, sizes):
            return solid.total(q, varied(sizes, z[2:]), z[0], z[1])

        def force(q, z, sizes):
            sizes = varied(sizes, z[2:])
            y, c = solid.to_places(q, sizes, z[1])
            gap, weight, height = solid.pressing(y, c, sizes, z[1])
            push = -weight * jnp.minimum(gap, 0.0)
            full = jnp.zeros(3 * solid.mesh.count + 1).at[solid.free].set(q)
            tau = full[3 * solid.mesh.middle_of_cut + 1]
            total = jnp.sum(push)
            return total, jnp.sum(push * height) / jnp.where(total > 0, total, 1.0) - tau

        self.gradient = jax.jit(jax.grad(energy, argnums=(0, 1)))
        self.force = jax.jit(jax.value_and_grad(force, argnums=(0, 1), has_aux=True))
        self.hessian = jax.jit(lambda q, pi, z, sizes: solid.hessian(q, pi, varied(sizes, z[2:]), z[0], z[1]))
        self.pressures = jax.jit(lambda q, z, sizes: solid.pressures(q, varied(sizes, z[2:]), z[1]))
        self.rest = jax.jit(solid.start)
        self.ticks = 0

    def factor(self, q, pi, z, sizes):
        self.ticks += 1
        K = np.asarray(self.hessian(q, pi, z, sizes))
        try:
            factor = cho_factor(K, check_finite=False)
            return lambda right: cho_solve(factor, right, check_finite=False)
        except np.linalg.LinAlgError:
            factor = lu_factor(K, check_finite=False)
            return lambda right: lu_solve(factor, right, check_finite=False)

    def carried(self, q, z, d, dz, sizes):
        """K (J - 1) after a step, to first order from the state before it."""
        moved = [np.asarray(self.pressures(q + e * d, z + e * dz, sizes)) for e in (STEP, -STEP)]
        return np.asarray(self.pressures(q, z, sizes)) + (moved[0] - moved[1]) / (2 * STEP)

    def newton(self, q, pi, z, sizes):
        """(q, what solves with the last Hessian), or None."""
        last, back = np.inf, None
        for k in range(MOST_STEPS):
            g = np.asarray(self.gradient(q, z, sizes)[0])
            if back is None or last > NEAR:
                back = self.factor(q, pi, z, sizes)
            d = -back(g)
            big = np.abs(d).max()
            if not np.isfinite(big) or (k > 4 and big > 5 * last):
                return None
            d = d * min(1.0, LONGEST / big)
            pi = self.carried(q, z, d, 0 * z, sizes)
            q = q + d
            if big < SETTLED:
                # Of the state itself: contact may have changed since the last Hessian.
                return q, self.factor(q, pi, z, sizes)
            last = big
        return None

    def seen(self, q, back, z, sizes):
        """Values and derivatives by (p, phi, dimensions), and the directions in which the state moves."""
        (F, lever), (F_q, F_z) = self.force(q, z, sizes)

        def by(direction):
            e = 1e-7
            ends = [np.asarray(self.gradient(q, z + s * e * direction, sizes)[0]) for s in (1, -1)]
            return (ends[0] - ends[1]) / (2 * e)

        unit = np.eye(len(z))
        e_c = np.zeros(len(q))
        e_c[-1] = 1.0
        rights = np.stack([-by(unit[0]), -by(unit[1]), e_c, np.asarray(F_q)], 1)
        q_p, q_phi, q_n, q_F = back(rights).T

        def along(move, turn):
            """d/dz of the change of Pi along a move of the state and of phi."""
            e = 1e-6 / max(np.abs(move).max(), 1e-3)
            ends = [np.asarray(self.gradient(q + s * e * move, z + s * e * turn, sizes)[1]) for s in (1, -1)]
            return (ends[0] - ends[1]) / (2 * e)

        M = float(self.gradient(q, z, sizes)[1][1])
        slopes = [2 * along(q_phi, unit[1]), -along(q_n, 0 * z), 2 * (np.asarray(F_z) - along(q_F, 0 * z))]
        values = np.array([2 * M, q[-1], 2 * float(F), float(lever), 0.5 * q_n[-1]])
        return values, np.stack(slopes), q_p, q_phi

    def go(self, state, sizes, x, goal):
        """From (q, seen, at) to the waypoint (p, phi); None where it is not reached."""
        share, start = 1.0, np.asarray(state[2])
        whole = np.asarray(goal) - start
        while True:
            q, (_, _, q_p, q_phi), at = state
            left = np.asarray(goal) - at
            move = left if np.abs(left).max() <= share * np.abs(whole).max() * (1 + 1e-9) else share * whole
            z, dz = np.concatenate([at, x]), np.concatenate([move, 0 * x])
            d = q_p * move[0] + q_phi * move[1]
            pi, z = self.carried(q, z, d, dz, sizes), z + dz
            new = self.newton(q + d, pi, z, sizes)
            if new is None:
                share *= 0.4
                if share < FINEST:
                    return None
                continue
            state = (new[0], self.seen(*new, z, sizes), at + move)
            if np.allclose(state[2], goal, atol=1e-12):
                return state


def run(out: Path, first: int, count: int, seconds: float, mesh: str) -> None:
    began = time.time()
    follower = Follower(S.Solid(S.Mesh(DEGREES[mesh])))
    rows = []
    out.mkdir(parents=True, exist_ok=True)
    for index in range(first, first + count):
        s = S.Sizes(*[jnp.asarray(float(v)) for v in geometry(index)])
        x_B = float(0.5 * s.h_L + s.h_x)
        x = np.array([getattr(geometry(index), n) for n in VARIED])
        q, z = np.asarray(follower.rest(s)), np.concatenate([np.zeros(2), x])
        back = follower.factor(q, np.asarray(follower.pressures(q, z, s)), z, s)
        root = (q, follower.seen(q, back, z, s), np.zeros(2))
        lost = 0

        def note(state, index=index):
            values, slopes = state[1][:2]
            rows.append(np.concatenate([[index], state[2], np.asarray(values), np.asarray(slopes).reshape(-1)]))

        for p in [0.0, *PRESSURES]:
            if p:
                root = follower.go(root, s, x, (p, 0.0))
                if root is None:
                    lost += 1
                    break
            note(root)
            values, slopes = root[1][:2]
            bent = FORWARDS * min(-values[0] / slopes[0, 1], MOST_BENT * x_B / FORWARDS[-1] * 1.2)
            up = [*bent[:-1], np.clip(bent[-1], LEAST_FAR * x_B, MOST_BENT * x_B)] if p else [LEAST_FAR * x_B]
            if mesh == "fine":
                up = up[:-1]
            down = [
                -k * float(rims_meet(s)) * x_B
                for k in (BACKWARDS[:1] if mesh == "fine" else BACKWARDS if p else BACKWARDS[-1:])
            ]
            if mesh == "fine" and not p:
                up = down = []
            for way in (up, down):
                state = root
                for phi in way:
                    state = follower.go(state, s, x, (p, phi))
                    if state is None:
                        lost += 1
                        break
                    note(state)
            print(
                f"  {time.time() - began:.0f} s: p {136 * p:.1f}, {len(rows)} states, {follower.ticks} steps",
                flush=True,
            )
            if time.time() - began > seconds:
                break
        np.savez(
            out / f"{mesh}_{first}.tmp.npz",
            rows=np.array(rows),
            sizes=np.array([list(geometry(i)) for i in range(index + 1)]),
        )
        (out / f"{mesh}_{first}.tmp.npz").rename(out / f"{mesh}_{first}.npz")
        print(f"{time.time() - began:.0f} s: geometry {index}, {len(rows)} states, {lost} ways lost", flush=True)
        if time.time() - began > seconds:
            break


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("out", type=Path)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--count", type=int, default=30)
    parser.add_argument("--seconds", type=float, default=2400)
    parser.add_argument("--mesh", choices=DEGREES, default="coarse")
    a = parser.parse_args()
    run(a.out, a.first, a.count, a.seconds, a.mesh)
