"""What must hold of every shell, whatever its numbers: invariants over random designs, against a scan in NumPy.

The branch from zero load is the free membrane's up to its first maximum or to where it touches, whichever comes first;
from there the contact's own, up to its first maximum or to the end of the model.
"""

from __future__ import annotations

from collections import Counter
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import reference as ref
from random_shells import KINDS, LAWS, Kind, Law, designs, for_reference, scene_of

import softgrip_jax as sg

OK, NO_CONTACT, BEYOND, IMPOSSIBLE, LOST = (int(s) for s in sg.Status)

NEAR = np.array([1e-3, 1e-6])
"""How close to contact and limit the statuses are looked at."""
FALL = 1e-6
"""Of the pressure: a load that falls by less from where contact begins snaps by nothing."""
HIGH = 30.0
"""In mu t_m / a: the pressure that stands for any where there is no limit."""
SAME = 1e-12
"""Two pressures that differ by less are one."""
POINTS = 400
"""Of each of the scan's four rounds."""
SCAN = 1e-4
"""The scan's relative error of a pressure at a maximum or an end (measured: below 1e-5 in all but steep ends)."""


def measured(kind: Kind, law: Law) -> Any:
    """A compiled function of a batch: all that is checked."""

    def one(numbers, constants, share):
        scene = scene_of(kind, law, numbers, constants)
        scale = scene.pressure_scale()
        contact, limit = sg.contact_pressure(scene), sg.limit_pressure(scene)
        top = jnp.where(jnp.isfinite(limit), limit, jnp.maximum(HIGH * scale, 10 * contact))
        top = jnp.where(jnp.isfinite(top), top, HIGH * scale)
        least = jnp.where(jnp.isfinite(contact), contact, 0.0)
        pressures = jnp.concatenate(
            [
                (least + share * (top - least))[None],
                top * (1 + jnp.array([-1, 1, -1, 1]) * jnp.repeat(NEAR, 2)),
                least * (1 + jnp.array([-1, 1, -1, 1]) * jnp.repeat(NEAR, 2)),
            ]
        )
        found = jax.vmap(lambda p: sg.solve(scene, p))(pressures)
        state = jax.tree.map(lambda leaf: leaf[0], (found.observables, found.margins))
        name = "force" if "force" in scene.OBSERVABLES else "inflation"
        back = sg.pressure_for(scene, **{name: state[0][name]})
        again = sg.solve(scene, back.pressure)
        return {
            "scale": scale,
            "contact": contact,
            "limit": limit,
            "pressures": pressures,
            "status": found.status,
            "residual": found.residual,
            "finite": jnp.all(jnp.stack([~jnp.isnan(v[0]) for v in found.observables.values()])),
            "margin": jnp.min(jnp.stack([*state[1].values(), jnp.asarray(jnp.inf)])),
            "angle": state[0]["clamp_angle"],
            "aim": state[0][name],
            "back": back.pressure,
            "back_status": back.status,
            "again": again.observables[name],
        }

    return jax.jit(jax.vmap(one))


def reference_branch(kind: Kind, numbers: dict) -> dict[str, np.ndarray]:
    """By NumPy alone: where the branch from zero load goes, and where it ends."""
    end = np.full_like(numbers["a"], np.pi - 1e-7)
    if kind.touch is None:
        angle, pressure, stop = ref.first_rise(kind.load, numbers, 1e-6, end, points=POINTS)
        top = _top(kind.load, numbers, angle, stop)
        return {"angle": angle, "pressure": pressure, "stop": stop, "top": top, "quiet": np.ones_like(end, bool)}
    touch = np.minimum(kind.touch(numbers), end)
    load = (lambda angle, p: (kind.load(angle, p)[0], [])) if kind.square else kind.load
    angle, pressure, stop = ref.first_rise(load, numbers, touch, end, points=POINTS)
    begins = None
    if kind.square:
        # It presses from where c_1 + c_2 = 0, or never; before, the model has it inflate freely.
        wide = kind.load(angle, numbers)[1][0] >= 0
        k = np.argmax(wide, axis=0)
        below, above = _at(angle, np.maximum(k - 1, 0)), _at(angle, k)
        for _ in range(50):  # the pressure of one cell further on may be more than the free membrane's limit
            middle = 0.5 * (below + above)
            is_wide = kind.load(middle, numbers)[1][0] >= 0
            below, above = np.where(is_wide, below, middle), np.where(is_wide, middle, above)
        begins = np.where(np.any(wide, axis=0), kind.load(above, numbers)[0], np.inf)
    quiet, peak = ref.approach(ref.free_square if kind.square else ref.free, numbers, touch, begins)
    return {
        "angle": angle,
        "pressure": pressure,
        "stop": stop,
        "top": _top(load, numbers, angle, stop),
        "quiet": quiet,
        "free_limit": peak,
    }


def _top(load: Any, numbers: dict, angle: np.ndarray, stop: np.ndarray) -> np.ndarray:
    """The largest pressure of the rising part, by a second scan of its last cells."""
    low, high = _at(angle, np.clip(stop - 2, 0, POINTS - 1)), _at(angle, np.minimum(stop, POINTS - 1))
    _, pressure, last = ref.first_rise(load, numbers, low, high, points=POINTS, rounds=1)
    return np.nanmax(np.where(np.arange(POINTS)[:, None] < last, pressure, -np.inf), axis=0)


def _at(values: np.ndarray, k: np.ndarray) -> np.ndarray:
    return np.take_along_axis(values, k[None], 0)[0]


WORST: dict[str, Any] = {}
"""The first design that breaks an invariant, by the invariant's name: to look at."""


def violations(kind_name: str, law_name: str, draw: np.random.Generator, n: int, compiled: Any) -> Counter:
    """How many of n random designs break what; under "designs" and statuses, what was seen."""
    kind, law = KINDS[kind_name], LAWS[law_name]
    numbers, constants = designs(kind, law, draw, n)
    share = draw.uniform(0.001, 0.999, n)
    seen = {k: np.asarray(v) for k, v in compiled(numbers, constants, share).items()}
    status, counts = seen["status"], Counter(designs=n)
    possible = status[:, 0] != IMPOSSIBLE
    for code in sg.Status:
        counts[code.name] += int(np.sum(status[:, 0] == code))

    def broken(what: str, where: np.ndarray) -> None:
        counts[f"! {what}"] += int(np.sum(where))
        if np.any(where) and np.ndim(where):
            i = int(np.argmax(where))
            picked = jax.tree.map(lambda v: np.asarray(v)[i].tolist(), (numbers, constants))
            WORST[f"{kind_name} {law_name}: {what}"] = (*picked, {k: v[i].tolist() for k, v in seen.items()})

    contact, limit, is_ok = seen["contact"], seen["limit"], status[:, 0] == OK
    bounded = possible & np.isfinite(limit)
    broken("not converged", np.any(status == LOST, axis=1))
    broken("limit not positive", possible & ~(limit > 0))
    broken("beyond the limit, which is infinite", possible & np.isinf(limit) & np.any(status == BEYOND, axis=1))
    broken("NaN under OK", is_ok & ~seen["finite"])
    broken("large residual under OK", np.any((status == OK) & ~(seen["residual"] < 1e-11), axis=1))
    broken("a rule is broken under OK", is_ok & (seen["margin"] < -1e-6))

    touches = kind.touch is not None
    # A membrane that never touches ends at the free limit in both: two programs, which may round differently.
    quiet = contact < limit * (1 - SAME) if touches else possible
    for k, side in enumerate(("1e-3 below", "1e-3 above", "1e-6 below", "1e-6 above")):
        below = "below" in side
        wanted = np.where(quiet, OK, NO_CONTACT) if below else BEYOND
        # A narrow window between contact and limit has no room for a pressure that is 1e-3 away from both.
        room = bounded & (~quiet | ~touches | (limit * (1 - 2e-3) > contact))
        broken(f"status {side} the limit", room & (status[:, 1 + k] != wanted))
        if touches:
            wanted = NO_CONTACT if below else OK
            broken(f"status {side} contact", room & quiet & (status[:, 5 + k] != wanted))

    # Connected to zero load, by the reference.
    with np.errstate(all="ignore"):
        scan = reference_branch(kind, for_reference(law, numbers, constants))
        pressure, p = scan["pressure"], seen["pressures"][:, 0]
        index = np.arange(len(pressure))[:, None]
        rising = index < scan["stop"]
        top = np.maximum(np.nanmax(np.where(rising, pressure, -np.inf), axis=0), scan["top"])
        # No maximum, and no end of the model but where the material locks (NaN): no limit.
        locks = np.isnan(_at(pressure, np.minimum(scan["stop"], len(pressure) - 1)))
        own_limit = np.where((scan["stop"] >= len(pressure)) | locks, np.inf, top)
        # A load that falls at first, by less than a cell shows, ends where it begins.
        first = np.geomspace(1e-8, 1e-2, 25)[:, None] * (scan["angle"][-1] - scan["angle"][0]) + scan["angle"][0]
        numbers_of = for_reference(law, numbers, constants)
        change = kind.load(first, numbers_of)[0] / pressure[0] - 1
        falls = np.any((change < -FALL) & ~np.maximum.accumulate(change > FALL, axis=0), axis=0)
        own_limit = np.where(falls & touches, pressure[0], own_limit)
        scanned = np.where(scan["quiet"], own_limit, scan.get("free_limit", np.inf))
        sure = possible & np.isfinite(scanned)
        if touches:
            # The free maximum and the first contact within rounding of each other: either may come first.
            sure &= ~(np.abs(scan["free_limit"] / pressure[0] - 1) < SAME * 100)
        off = sure & ~(np.abs(limit / scanned - 1) < SCAN)
        broken("limit is not the scan's", off & ~_steep(scan, scanned))
        if touches:
            clear = np.abs(scan["free_limit"] / np.where(scan["quiet"], np.inf, contact) - 1) < 1
            broken("contact after the free limit", possible & quiet & ~scan["quiet"] & clear)
        # The angle at the pressure asked for, between two neighbours of the rising scan.
        above = rising & (pressure >= p)
        k = np.argmax(above, axis=0)
        there = is_ok & np.any(above, axis=0) & (k > 0)
        low, high = _at(scan["angle"], np.maximum(k - 1, 0)), _at(scan["angle"], k)
        slack = 1e-9 + 0.01 * (high - low)
        broken("another state", there & ~((seen["angle"] >= low - slack) & (seen["angle"] <= high + slack)))

    # pressure_for inverts solve: the same pressure, or a lower one at which the value is met first.
    solved = is_ok & (seen["back_status"] == OK)
    broken("pressure_for finds nothing", is_ok & ~solved)
    with np.errstate(all="ignore"):
        # Next to a closed arc rounding of the angle is all that is left of a pressure.
        close = 1e-9 * (1 + 1e-6 / (np.pi - seen["angle"]))
        same = np.abs(seen["back"] / seen["pressures"][:, 0] - 1) < close
        met = np.abs(seen["again"] / seen["aim"] - 1) < 1e3 * close
    first = (seen["back"] < seen["pressures"][:, 0]) & met
    broken("pressure_for is not the inverse", solved & ~(same | first))
    counts["value met at a lower pressure first"] += int(np.sum(solved & ~same & first))

    # One of a batch is what it is alone.
    alone = [compiled(*jax.tree.map(lambda v, i=i: v[i : i + 1], (numbers, constants, share))) for i in range(4)]
    for i, one in enumerate(alone):
        for name in ("contact", "limit", "status", "angle", "aim", "back"):
            value = one[name]
            same = np.allclose(np.asarray(value)[0], seen[name][i], rtol=1e-9, atol=0, equal_nan=True)
            broken(f"{name} in a batch differs from one alone", np.asarray(not same))
    return counts


def _steep(scan: dict, scanned: np.ndarray) -> np.ndarray:
    """Where the scan's last cell changes the pressure by more than its error: the end of a model, not a maximum."""
    last = np.minimum(scan["stop"], len(scan["pressure"])) - 1
    before = _at(scan["pressure"], np.maximum(last - 1, 0))
    return np.abs(before / scanned - 1) > SCAN
