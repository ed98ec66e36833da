"""Fits the coefficients of the cell law to the states that `generate.py` made, and to finite elements of type A.

    python benchmarks/cell/fit.py OUT.npz benchmarks/cell/states/*.npz --finite-elements AE --keep-back 5

The form of the law is in softgrip_jax/pneunet/cell/form.py. It is linear in its coefficients, so one regularised least
squares problem for each function finds them. Values and derivatives of the moment, the stretch and the contact force
are fitted together: a derivative counts by what it would change over half of the range of a dimension. --keep-back n
leaves out every geometry whose number modulo 6 is n, and reports the errors there.
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
SPREAD = np.array([0.02, 0.05, 0.6, 0.5, 0.15, 0.1, 0.25, 0.6])
"""Of p / mu, phi and the dimensions a, b, t_m, h_x, h_L, H in mm: what a derivative is multiplied with."""
SLOPES = 0.5
"""Weight of the derivatives beside the values."""
RIDGE = 1.5e-2
"""Of the regularisation; more for higher powers of the dimensions: see `penalties`."""
LEAST_SLOPE, ROUNDS = 0.5, 4
DOUBTFUL = 0.15
"""Derivatives that are off by more than so much of the tolerance count less: contact that comes or goes spoils some."""
FINER = 1.02
"""What finite elements give (types A and E, 10 to 31 kPa) over
what the solid gives, whose polynomials are few: of the moment beside the cover's, and of the force."""
NOTHING = 0.1
"""Where nothing touches, the force before rounding off is to be at least so far below zero."""
KINDS = ("A", "E")
SIZES_OF_KINDS = ((5.0, 8.0, 1.1, 0.9, 4.2, 5.0, 20.0, 2.0), (6.5, 7.0, 1.1, 0.9, 4.2, 5.0, 20.0, 2.0))


def finite_elements(kinds: str) -> np.ndarray:
    """States by finite elements as rows of `generate`, without derivatives."""
    rows = []
    with (Path(__file__).parent / "finite_elements.csv").open() as file:
        for row in csv.DictReader(line for line in file if not line.startswith("#")):
            if row["geometry"] not in kinds or float(row["p_kPa"]) / 136 > form.MOST_PRESSURE:
                continue
            p, kappa, stretch, moment, force, lever = (float(v) for v in list(row.values())[2:])
            half, mu = 3.0, 0.136
            values = [moment / mu, stretch * half, force / mu, lever, np.nan]
            rows.append([KINDS.index(row["geometry"]), p / 136, kappa * half, *values, *[np.nan] * 24])
    return np.array(rows).reshape(-1, 32)


def row_of(z):
    """Products of the functions at (p, phi, a, b, t_m, h_x, h_L, H), and at the same cell without load."""
    p, phi, x = z[0], z[1], z[2:] / B
    half = 0.5 * z[6] + z[5]

    def products(p, kappa):
        K = form.curvature_functions(form.SPREAD * kappa * B / form.rims_meet(x))[0]
        PG = (form.pressure_functions(p)[:, None] * form.geometry_functions(x)).reshape(-1)
        return (K[:, None] * PG).reshape(-1)

    return products(p, phi / half), products(0 * p, 0 * phi), form.scales(x), half


def moment_row(z):
    loaded, rest, scale, _ = row_of(z)
    return scale[0] * B**3 * (loaded - rest)


def covers_moment(z):
    return form.COVER * B * z[7] ** 3 / 3 * z[1] / (0.5 * z[6] + z[5])


def place_row(z):
    loaded, rest, scale, half = row_of(z)
    return scale[3] * half * (loaded - rest)


def force_row(z):
    loaded, _, scale, _ = row_of(z)
    return scale[1] * B**2 * loaded


def penalties() -> np.ndarray:
    """Of each coefficient."""
    degree = np.array([0] + [1] * 6 + [2] * 21)
    geometry = np.array([1.0, 2.0, 5.0])[degree]
    pressure = np.array([1.0, 1.0, 1.0, 1.0, 1.0, 1.0])
    curvature = np.concatenate([[1.0, 1.0], np.full(len(form.KNOTS), 1.0)])
    return (curvature[:, None, None] * pressure[:, None] * geometry).reshape(-1)


def solve(rows, right, ridge):
    """Least squares with `ridge` times the penalties, by the smaller of the two normal matrices."""
    weight = 1 / (ridge * penalties())
    A = rows * weight
    if len(A) < A.shape[1]:
        return weight * (A.T @ np.linalg.solve(A @ A.T + np.eye(len(A)), right))
    return weight * np.linalg.solve(A.T @ A + np.eye(A.shape[1]), A.T @ right)


def samples(sizes: np.ndarray, count: int = 4000) -> np.ndarray:
    """Cells at which the moment is to rise with the curvature: half of them of the sizes that were solved for."""
    rng = np.random.default_rng(1)
    x = rng.uniform(20 * form.LOW, 20 * form.HIGH, (count, 6))
    x[: count // 2] = sizes[rng.integers(0, len(sizes), count // 2), :6]
    p = rng.uniform(0, form.MOST_PRESSURE, count)
    meet = jax.vmap(form.rims_meet)(jnp.asarray(x / B)) / B
    kappa = np.asarray(meet) * rng.uniform(-2.8, 6.0, count)
    return np.concatenate([p[:, None], (kappa * (0.5 * x[:, 4] + x[:, 3]))[:, None], x], 1)


def rising(C, z, D, EI_slope, ridge, rows, right):
    """Coefficients of the moment again, with its slope by phi raised to LEAST_SLOPE of the cover's where it is less."""
    weight = 1 / (3 * EI_slope)
    for _ in range(ROUNDS):
        low = (LEAST_SLOPE - form.COVER) * EI_slope > (D @ C)
        rows, right = (
            np.concatenate([rows, (D * weight[:, None])[low]]),
            np.concatenate([right, ((LEAST_SLOPE + 0.2 - form.COVER) * EI_slope * weight)[low]]),
        )
        C = solve(rows, right, ridge)
    print("cells whose moment falls with the curvature:", int(np.sum(-form.COVER * EI_slope > D @ C)), "of", len(z))
    return C


def main(out, paths, keep_back, kinds, ridge):
    data = np.concatenate([np.load(path)["rows"] for path in paths] + [finite_elements(kinds)])
    sizes = max((np.load(path)["sizes"] for path in paths), key=len)
    sizes = np.concatenate([np.array(SIZES_OF_KINDS), sizes[len(KINDS) :]])
    g = data[:, 0].astype(int)
    z = np.concatenate([data[:, 1:3], sizes[g][:, :6]], 1)
    values, slopes = data[:, 3:8], data[:, 8:32].reshape(-1, 3, 8)
    has = np.isfinite(slopes).all((1, 2))
    slopes = np.nan_to_num(slopes)
    M, c, F, lever, compliance = values.T
    half, EI = 0.5 * z[:, 6] + z[:, 5], B * z[:, 7] ** 3 / 3
    # The solid of `generate` is softer than finer meshes.
    cover = form.COVER * EI * z[:, 1] / half
    M, F = np.where(has, cover + FINER * (M - cover), M), np.where(has, FINER * F, F)
    blocked = {(i, round(p, 9)): abs(m) for i, p, phi, m in zip(g, z[:, 0], z[:, 1], M, strict=True) if phi == 0}
    reference = np.array([blocked.get((i, round(p, 9)), 0.0) for i, p in zip(g, z[:, 0], strict=True)])
    # Where rims have met, moments are large and count less.
    rim = np.maximum(np.abs(M - EI * z[:, 1] / half) - 1.6 * reference, 0)
    tolerance = reference + 0.5 + 0.1 * rim
    arm = 0.5 * z[:, 7] + z[:, 2]
    kept = (g % 6 == keep_back) if keep_back >= 0 else np.zeros(len(g), bool)
    seen = ~kept
    print(
        "states",
        len(g),
        "with derivatives",
        has.sum(),
        "geometries",
        len(np.unique(g)),
        "kept back",
        np.unique(g[kept]),
    )

    def fitted(row, value, offset, slope, scale, trust):
        """Coefficients of a function that is linear in them, from values and derivatives."""
        R = np.asarray(jax.jit(jax.vmap(row))(z))
        weight = seen * counts / scale
        A, right = R * weight[:, None], (value - offset[0]) * weight
        use = np.where(seen & has & (trust > 0.05))[0]
        if len(use):
            D = np.asarray(jax.jit(jax.vmap(jax.jacfwd(row)))(z[use])).transpose(0, 2, 1)
            w = SLOPES * SPREAD * (trust[use] / scale[use])[:, None]
            D, aim = (D * w[:, :, None]).reshape(-1, R.shape[1]), ((slope[use] - offset[1][use]) * w).reshape(-1)
            robust = np.ones(len(aim))
            for _ in range(3):
                rows, wanted = np.concatenate([A, D * robust[:, None]]), np.concatenate([right, aim * robust])
                C = solve(rows, wanted, ridge)
                robust = 1 / np.sqrt(1 + ((D @ C - aim) / DOUBTFUL) ** 2)
            A, right = rows, wanted
        C = solve(A, right, ridge)
        rows = A
        if row is moment_row:
            cells = samples(sizes[np.unique(g)])
            D = np.asarray(jax.jit(jax.vmap(jax.jacfwd(row)))(cells))[:, :, 1]
            C = rising(C, cells, D, B * cells[:, 7] ** 3 / 3 / (0.5 * cells[:, 6] + cells[:, 5]), ridge, rows, right)
        return C, R @ C + offset[0]

    none = (np.zeros(len(g)), np.zeros((len(g), 8)))
    # Where there are finite elements they count, and of the solid the derivatives alone.
    counts = np.where(has & np.isin(g, [KINDS.index(kind) for kind in kinds]), 0.0, np.where(has, 1.0, 2.0))
    trust = 1 / (1 + 5 * rim / (reference + 1.0))
    C = {}
    bent = (cover, np.asarray(jax.vmap(jax.grad(covers_moment))(jnp.asarray(z))))
    C["moment"], model_M = fitted(moment_row, M, bent, slopes[:, 0], tolerance, trust)
    by_half = np.zeros((len(g), 8))
    by_half[:, 5], by_half[:, 6] = 1.0, 0.5
    tight = half * (0.005 + 0.2 * np.abs(c / half - 1))
    C["stretch"], model_c = fitted(place_row, c, (half, by_half), slopes[:, 1], tight, trust)
    # The force before it is rounded off: known where something presses, below zero elsewhere.
    unit = np.asarray(jax.vmap(lambda z: row_of(z)[2][1])(z)) * B**2
    share = F / unit
    touching = share > 0.02
    target = np.where(touching, np.log(np.expm1(np.clip(form.SHARP * share, 1e-9, 30))) / form.SHARP, -NOTHING)
    target = np.where(form.SHARP * share > 30, share, target) * unit
    trust_F = np.where(share > 0.12, trust, 0.0)
    raw = None
    for _ in range(4):
        aim = target if raw is None else np.where(touching, target, np.minimum(raw, -NOTHING * unit))
        C["force"], raw = fitted(force_row, aim, none, slopes[:, 2], tolerance / arm, trust_F)
    model_F = unit * np.logaddexp(0, form.SHARP * raw / unit) / form.SHARP
    zero = np.zeros(len(g))
    loose = np.where(touching & (F > 0.3), 0.5, 1e9)
    C["lever"], model_l = fitted(lambda z: row_of(z)[0], lever / arm - 1, none, slopes[:, 0], loose, zero)
    known = np.isfinite(compliance)
    log = np.where(known, np.log(np.where(known, compliance, 1.0) * B**2 / half / (0.25 / (z[:, 7] / B))), 0.0)
    C["compliance"], _ = fitted(lambda z: row_of(z)[0], log, none, slopes[:, 0], np.where(known, 0.6, 1e9), zero)
    shape = (form.CURVATURES, form.PRESSURES * form.GEOMETRIES)
    np.savez_compressed(out, C=np.stack([C[name].reshape(shape) for name in form.HEADS]).astype(np.float32))
    errors = {
        "M": (model_M - M) / np.maximum(reference, 10.0),
        "c": (model_c - c) / half,
        "F": (model_F - F) / np.maximum(reference / arm, 1.0),
        "lever": np.where(F > 1, (model_l - (lever / arm - 1)), 0.0),
    }
    for label, which in (("seen", seen), ("kept back", kept)):
        for where, mask in (
            ("kappa = 0", z[:, 1] == 0),
            ("kappa > 0", z[:, 1] > 0),
            ("rims apart, kappa < 0", (z[:, 1] < 0) & (rim <= 0)),
            ("rims pressed", (z[:, 1] < 0) & (rim > 0)),
        ):
            mask = mask & which & (z[:, 0] > 0.03)
            if mask.any():
                said = [
                    f"{n} {100 * np.sqrt(np.mean(e[mask] ** 2)):.2f}/{100 * np.abs(e[mask]).max():.2f}"
                    for n, e in errors.items()
                ]
                print(f"{label}, {where} ({mask.sum()}): rms/most, % of blocked: {'  '.join(said)}", flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("out")
    parser.add_argument("data", nargs="+")
    parser.add_argument("--keep-back", type=int, default=-1)
    parser.add_argument("--finite-elements", default="A", help="kinds whose finite elements are fitted: A, AE or none")
    parser.add_argument("--ridge", type=float, default=RIDGE)
    a = parser.parse_args()
    main(a.out, a.data, a.keep_back, a.finite_elements, a.ridge)
