"""Many random designs at once: every lane solved or honestly labelled, checked by a scan that shares no code.

The scan (reference.first_rise) walks each load curve from zero load in NumPy, in another parametrisation, and says
where the rising part ends and in which cell the pressure is first crossed.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import reference as ref
from helpers import CASES, reference

import softgrip_jax as sg

LANES = 100_000
CHUNK = 4096
CHECKED = 2000
"""Lanes that the scan looks at: 6,000 points each."""


def spread(rng, low, high, n=LANES):
    """Random numbers, even on a logarithmic scale."""
    return np.exp(rng.uniform(np.log(low), np.log(high), n))


def shells(rng, n=LANES):
    a = spread(rng, 1e-3, 0.1, n)
    design = {"a": a, "b": a * spread(rng, 1.02, 10, n), "t_m": a * spread(rng, 0.01, 0.5, n)}
    return design | {"material": {"kind": ref.NEO, "mu": spread(rng, 1e4, 2e6, n)}}


def free(rng):
    return shells(rng), ref.free, lambda shell, _: sg.shell.Free(shell)


def flat(rng):
    p = shells(rng)
    p["distance"] = p["a"] * spread(rng, 0.01, 10)
    return p, ref.flat, lambda shell, q: sg.shell.FlatContact(shell, distance=q["distance"])


def inclined(rng):
    p = shells(rng)
    p["b"] = p["a"]
    p |= {
        "distance": p["a"] * spread(rng, 0.01, 10),
        "angle": rng.uniform(0, 1.5, LANES) * (rng.uniform(size=LANES) > 0.05),
    }
    return p, ref.inclined, lambda shell, q: sg.shell.InclinedContact(shell, distance=q["distance"], angle=q["angle"])


def cylinder(rng):
    p = shells(rng)
    p |= {"radius": p["a"] * spread(rng, 0.05, 50), "gap": p["a"] * spread(rng, 0.01, 10)}
    return p, ref.cylinder, lambda shell, q: sg.shell.CylinderContact(shell, radius=q["radius"], gap=q["gap"])


def offset(rng):
    p, load, _ = cylinder(rng)
    p["height"] = p["a"] + (2 * p["b"] - 2 * p["a"]) * rng.uniform(0.01, 0.99, LANES)
    make = lambda shell, q: sg.shell.AxialOffset(shell, radius=q["radius"], gap=q["gap"], height=q["height"])  # noqa: E731
    return p, load, make


def first_touch(p):
    """theta_m2 where the width of an inclined contact begins, by scan and bisection; NaN where it never does."""
    angle = np.linspace(1e-5, np.pi, 4001)[:, None]
    with np.errstate(all="ignore"):
        width = ref.inclined(angle, p)[1][0]
        k = np.argmax(width > 0, axis=0)
        low, high = angle[np.maximum(k - 1, 0), 0], angle[k, 0]
        for _ in range(55):
            middle = (low + high) / 2
            wide = ref.inclined(middle, p)[1][0] > 0
            low, high = np.where(wide, low, middle), np.where(wide, middle, high)
    return np.where((width > 0).any(axis=0), high, np.nan)


def start_of(kind, p):
    """The angle where each lane's curve begins."""
    if kind is free:
        return np.full_like(p["a"], 1e-9)
    if kind is inclined:
        return first_touch(p)
    return 2 * np.arctan((p["distance"] if kind is flat else p["gap"]) / p["a"])


def pick(p, index):
    return {k: pick(v, index) if isinstance(v, dict) else (v if isinstance(v, str) else v[index]) for k, v in p.items()}


@pytest.mark.parametrize("kind", [free, flat, inclined, cylinder, offset], ids=lambda kind: kind.__name__)
def test_every_lane_is_solved_or_honestly_labelled(kind):
    rng = np.random.default_rng(2026)
    p, load, make = kind(rng)
    numbers = {k: jnp.asarray(v) for k, v in p.items() if k != "material"} | {"mu": jnp.asarray(p["material"]["mu"])}
    traces = []

    def scene_of(q):
        traces.append(1)
        shell = sg.FlatShell(a=q["a"], b=q["b"], t_m=q["t_m"], material=sg.NeoHookean(mu=q["mu"]))
        return make(shell, q)

    def lane(lane):
        q, u, wide = lane
        scene = scene_of(q)
        start, _ = scene.interval()
        first, last = scene.load(start), sg.limit_pressure(scene)
        # Most pressures lie between first contact and the limit, the others anywhere.
        scale = q["mu"] * q["t_m"] / q["a"]
        pressure = jnp.where(wide, scale * 10 ** (5 * u - 3), first + 1.05 * u * (last - first))
        pressure = jnp.where(jnp.isfinite(pressure), pressure, scale * u)
        s = sg.solve(scene, pressure)
        seen = {"clamp_angle": s.clamp_angle, **{k: v for k, v in s.observables.items() if k in PHYSICAL}}
        return pressure, s.status, s.residual, seen, last

    solve = jax.jit(lambda *lanes: jax.lax.map(lane, lanes, batch_size=CHUNK))
    u, wide = jnp.asarray(rng.uniform(0, 1, LANES)), jnp.asarray(rng.uniform(size=LANES) < 0.3)
    pressure, status, residual, seen, limit = jax.tree.map(np.asarray, solve(numbers, u, wide))
    ok = status == sg.Status.OK

    # Nothing is left unsolved, and what is solved is on the physical branch.
    assert not np.any(status == sg.Status.NOT_CONVERGED)
    assert np.mean(ok) > 0.3
    assert np.max(residual[ok]) <= 1e-12
    for name, (low, high) in PHYSICAL.items():
        if name in seen:
            value = seen[name][ok] / p["a"][ok] if high is not None else seen[name][ok]
            assert np.all(value >= low - 1e-12), name
            assert high is None or np.all(value <= high + 1e-12), name

    # The labels and the roots of a sample, by the scan.
    some = rng.choice(LANES, CHECKED, replace=False)
    q, pressure, status, limit = pick(p, some), pressure[some], status[some], limit[some]
    start = start_of(kind, q)
    exists = np.isfinite(start)
    begin = np.where(exists, start, 1.0)
    curve = (lambda x, q: (load(x, q)[0], [])) if kind is inclined else load
    angle, curve_pressure, stop = ref.first_rise(curve, q, begin, np.full(CHECKED, np.pi - 1e-9))
    lanes = np.arange(CHECKED)
    first = np.nan_to_num(curve_pressure[0])
    below, above = curve_pressure[stop - 1, lanes], curve_pressure[np.minimum(stop, len(angle) - 1), lanes]
    best = np.fmax(below, above)
    label = np.where(pressure > below, sg.Status.BEYOND_LIMIT, sg.Status.OK)
    label = np.where(pressure <= first, sg.Status.OK if kind is free else sg.Status.NO_CONTACT, label)
    quiet, free_limit = np.ones(CHECKED, bool), np.full(CHECKED, np.inf)
    if kind is not free:
        # Free inflation up to the smaller of contact and its own limit comes first.
        touch = ref.touch_angle(q["distance"] / q["a"], q["angle"]) if kind is inclined else start
        presses = np.where(exists, first, np.inf) if kind is inclined else None
        quiet, free_limit = ref.approach(ref.free_square if kind is inclined else ref.free, q, touch, presses)
        below = np.where(quiet, below, free_limit)
        best = np.where(quiet, best, free_limit)
    label = np.where(quiet, label, np.where(pressure <= free_limit, sg.Status.NO_CONTACT, sg.Status.BEYOND_LIMIT))
    # The scan knows the limit to its own cell only, and the first contact to its bisection.
    doubtful = (np.abs(pressure - below) <= 2 * np.abs(best - below) + 1e-5 * below) | (
        np.abs(pressure - first) < 1e-9 * first
    )
    assert np.mean(doubtful) < 0.02
    np.testing.assert_array_equal(status[~doubtful], label[~doubtful])
    certain = np.isfinite(limit)
    assert np.all(np.abs(limit[certain] / below[certain] - 1) < 5e-3)

    solved = (status == sg.Status.OK) & ~doubtful & (pressure > first)
    k = np.argmax(curve_pressure >= pressure, axis=0)
    low, high = angle[np.maximum(k - 1, 0), lanes], angle[k, lanes]
    got = seen["clamp_angle"][some]
    assert np.all(((got >= low - 1e-8) & (got <= high + 1e-8))[solved])


# Observables that have a sign or a bound on the physical branch: lowest value, highest value over a (None: not scaled).
PHYSICAL = {
    "contact_angle": (0.0, None),
    "flat_length": (0.0, None),
    "flat_length_far": (0.0, None),
    "flat_length_near": (0.0, None),
    "contact_half_width": (0.0, 1.0),
    "contact_width": (0.0, None),
    "force": (0.0, None),
    "stretch": (1.0, None),
}


def random_materials(rng, n):
    """Yeoh, Gent and Ogden with constants as wide as their rules, many of them with two limit points."""
    c1 = spread(rng, 5e3, 1e6, n)
    mu = spread(rng, 1e4, 2e6, n)
    yeoh = {"kind": ref.YEOH, "c1": c1, "c2": c1 * rng.uniform(-0.05, 0.05, n), "c3": c1 * spread(rng, 1e-6, 1e-1, n)}
    gent = {"kind": ref.GENT, "mu": mu, "j_m": spread(rng, 1, 200, n)}
    alpha = np.stack([rng.uniform(1.2, 2.5, n), rng.uniform(2, 8, n), -rng.uniform(1, 4, n)])
    ogden = {
        "kind": ref.OGDEN,
        "alpha": alpha,
        "mu": mu / alpha * np.stack([np.ones(n), spread(rng, 1e-4, 0.1, n), rng.uniform(0, 0.2, n)]),
    }
    mooney = {"kind": ref.MOONEY, "c1": c1, "c2": c1 * rng.uniform(0, 0.3, n)}
    return {"yeoh": yeoh, "gent": gent, "ogden": ogden, "mooney": mooney}


def as_material(m):
    kind = m["kind"]
    if kind == ref.OGDEN:
        return sg.Ogden(mu=m["mu"], alpha=m["alpha"])
    fields = {k: v for k, v in m.items() if k != "kind"}
    return {ref.YEOH: sg.Yeoh, ref.GENT: sg.Gent, ref.MOONEY: sg.MooneyRivlin}[kind](**fields)


@pytest.mark.parametrize("name", ["yeoh", "gent", "ogden", "mooney"])
def test_random_materials_find_the_first_crossing(name):
    n = 2000
    rng = np.random.default_rng(7)
    p = shells(rng, n)
    p["material"] = m = random_materials(rng, n)[name]
    kind = m["kind"]
    numbers = {k: jnp.asarray(v).T for k, v in m.items() if k != "kind"}

    def lane(a, b, t_m, numbers, scaled):
        material = as_material({"kind": kind, **numbers})
        scene = sg.shell.Free(sg.FlatShell(a=a, b=b, t_m=t_m, material=material))
        s = sg.solve(scene, scaled * scene.pressure_scale())
        return s.pressure, s.status, s.clamp_angle

    scaled = spread(rng, 0.05, 5, n)
    pressure, status, got = jax.jit(jax.vmap(lane))(p["a"], p["b"], p["t_m"], numbers, scaled)
    pressure, status, got = (np.asarray(v) for v in (pressure, status, got))
    if kind == ref.OGDEN:
        p["material"] = m | {"mu": m["mu"].T, "alpha": m["alpha"].T}
    angle, curve, stop = ref.first_rise(ref.free, p, np.full(n, 1e-9), np.full(n, np.pi - 1e-9), points=4001)
    lanes = np.arange(n)
    top = curve[np.minimum(stop, len(angle)) - 1, lanes]
    endless = (stop == len(angle)) | ~np.isfinite(curve[np.minimum(stop, len(angle) - 1), lanes])
    label = np.where((pressure > top) & ~endless, sg.Status.BEYOND_LIMIT, sg.Status.OK)
    doubtful = (np.abs(pressure / top - 1) < 1e-4) | (endless & (pressure > top))
    assert np.mean(doubtful) < 0.05
    assert np.mean(status == sg.Status.OK) > 0.3
    np.testing.assert_array_equal(status[~doubtful], label[~doubtful])
    k = np.argmax(curve >= pressure, axis=0)
    solved = (status == sg.Status.OK) & ~doubtful
    inside = (got >= angle[np.maximum(k - 1, 0), lanes] - 1e-8) & (got <= angle[k, lanes] + 1e-8)
    assert np.all(inside[solved])


@pytest.mark.parametrize("case", CASES, ids=str)
def test_vmap_is_the_loop(case):
    scene, _ = reference(case)
    pressures = case.pressure * np.array([0.01, 0.8, 1.0, 20.0])
    batch = sg.path(scene, pressures)
    for k, pressure in enumerate(pressures):
        one = sg.solve(scene, pressure)
        assert int(one.status) == int(batch.status[k])
        for name, value in one.observables.items():
            np.testing.assert_allclose(batch.observables[name][k], value, rtol=1e-12, atol=1e-15)


def test_a_scene_type_is_compiled_once():
    from softgrip_jax.scene import equilibrium

    scene, _ = reference(CASES[0])
    sg.solve(scene, 5e3)
    before = equilibrium.program._cache_size()
    for pressure in (6e3, 7e3, 90e3):
        sg.solve(CASES[0].make(), pressure)
    assert equilibrium.program._cache_size() == before
