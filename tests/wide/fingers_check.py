"""What must hold of every finger: invariants over random designs, against natural continuation in small steps."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from random_shells import decades

import softgrip_jax as sg
from softgrip_jax.equations import PathEquations
from softgrip_jax.reasons import BROKEN, RULE_NAMES
from softgrip_jax.units import GRAVITY

OK, NO_CONTACT, BEYOND, IMPOSSIBLE, LOST = (int(s) for s in sg.Status)
NEAR = np.array([1e-3, 1e-6])
SHARE = (0.02, 0.95)
"""Of the limit pressure: where states are looked at."""
STEPS, CORRECTIONS = 40, 3
"""Of the continuation: first the loads, then the pressure, in so many steps each."""
POINTS = 8


class Kind(NamedTuple):
    make: Callable[[sg.PneuNet, dict[str, Any], tuple[str, ...]], sg.Scene]
    """From a finger, loads and the names of rules that are ignored."""
    target: str
    share: float
    """Of all fingers that are looked at: less where one costs more."""


def _grasp(finger, p, ignored):
    held = sg.objects.Cylinder(radius=p["radius"], mass=p["mass"], friction=0.9)
    gripper = sg.pneunet.Gripper(finger, base_radius=p["radius"] + p["clear"])
    return sg.pneunet.Grasp(gripper, held, weight=p["weight"], points=POINTS, ignored_rules=ignored)


KINDS = {
    "TipContact": Kind(
        lambda finger, p, ignored: sg.pneunet.TipContact(
            finger,
            tip_offset=p["offset"],
            tip_pull=p["pull"],
            weight=p["weight"],
            points=POINTS,
            ignored_rules=ignored,
        ),
        "tip_force",
        10,
    ),
    "Grasp": Kind(_grasp, "tip_force", 5),
    "Free": Kind(
        lambda finger, p, ignored: sg.pneunet.Free(
            finger, weight=p["weight"], inclination="none", points=POINTS, ignored_rules=ignored
        ),
        "tip_angle",
        5,
    ),
    "Free segment": Kind(
        lambda finger, p, ignored: sg.pneunet.Free(finger, weight=p["weight"], points=POINTS, ignored_rules=ignored),
        "tip_angle",
        0.2,
    ),
    "Free arcs": Kind(
        lambda finger, p, ignored: sg.pneunet.Free(finger, weight=None, ignored_rules=ignored), "tip_angle", 5
    ),
    "TipContact segment": Kind(
        lambda finger, p, ignored: sg.pneunet.TipContact(
            finger, tip_offset=p["offset"], inclination="segment", points=POINTS, ignored_rules=ignored
        ),
        "tip_force",
        0.2,
    ),
    "Chamber": Kind(
        lambda finger, p, ignored: sg.pneunet.Chamber(finger, p["inclination"], ignored_rules=ignored),
        "end_moment",
        5,
    ),
}


def designs(draw: np.random.Generator, n: int) -> dict[str, Any]:
    """Fingers of two decades of size and stiffness, with loads in units of what bends them."""
    a, mu = decades(draw, 1e-3, 1e-1, n), decades(draw, 2e4, 2e6, n)
    f = {"a": a, "b": a * draw.uniform(1, 2.5, n), "h_x": a * decades(draw, 0.05, 0.5, n), "mu": mu}
    f["t_m"] = a * decades(draw, 0.05, 0.4, n)
    f["h_L"] = 2 * f["t_m"] + a * draw.uniform(0.1, 1.5, n)
    f["H"], f["B"] = a * draw.uniform(0.4, 2, n), 2 * f["b"] * draw.uniform(1.05, 2, n)
    f["L"] = (2 * f["h_x"] + f["h_L"]) * draw.uniform(3, 30, n)
    bending = mu * f["B"] * f["H"] ** 3 / 3 / f["L"] ** 2  # EI / L^2, N
    f["offset"] = f["L"] * draw.uniform(-0.3, 0.3, n)
    f["pull"] = bending * decades(draw, 0.02, 2, n) * draw.choice([-1, 1], n)
    f["weight"] = (bending / f["L"])[:, None] * decades(draw, 0.02, 2, n)[:, None] * draw.uniform(-1, 1, (n, 2))
    f["mass"] = 3 * bending * decades(draw, 0.02, 2, n) / GRAVITY
    f["radius"], f["clear"] = f["B"] * draw.uniform(0.5, 2, n), f["L"] * draw.uniform(0.0, 0.2, n)
    f["inclination"] = draw.uniform(0, 0.2, n)
    return f


def continued(scene: PathEquations, pressure: Any) -> Any:
    """(unknowns, residual) by Newton's method in small steps of the loads, then of the pressure."""
    begin = scene.pressure_span().begin

    def residual(unknowns, share, p):
        return scene.residual_and_observables(unknowns, share, scene.load_of(p))[0]

    def step(unknowns, at):
        share, p = at
        for _ in range(CORRECTIONS):
            jacobian = jax.jacfwd(residual)(unknowns, share, p)
            unknowns = unknowns - jnp.linalg.solve(jacobian, residual(unknowns, share, p))
        return unknowns, jnp.max(jnp.abs(residual(unknowns, share, p)))

    way = jnp.linspace(0.0, 1.0, STEPS + 1)[1:]
    shares = jnp.concatenate([way, jnp.ones_like(way)])
    low = jnp.minimum(begin, pressure)
    pressures = jnp.concatenate([jnp.full_like(way, low), low + way * (pressure - low)])
    unknowns, left = jax.lax.scan(step, scene.unloaded_state(), (shares, pressures))
    return unknowns, jnp.max(left)


def measured(kind: Kind) -> Any:
    """A compiled function of a batch: all that is checked."""

    def one(p, share):
        sizes = {k: p[k] for k in ("a", "b", "h_x", "t_m", "h_L", "H", "B", "L")}
        finger = sg.PneuNet(**sizes, material=sg.NeoHookean(mu=p["mu"]))
        scene, kept = kind.make(finger, p, RULE_NAMES), kind.make(finger, p, ())
        limit = sg.limit_pressure(scene)
        top = jnp.where(jnp.isfinite(limit), limit, 1.0)
        begin = sg.contact_pressure(scene)
        state_at = begin + share * (top - begin)
        near = top * (1 + jnp.array([-1, 1, -1, 1]) * jnp.repeat(NEAR, 2))
        pressures = jnp.concatenate([state_at[None], near])
        found = jax.lax.map(lambda q: sg.solve(scene, q), pressures)
        state = jax.tree.map(lambda leaf: leaf[0], found.observables)
        judged = sg.solve(kept, pressures[0])
        back = sg.pressure_for(scene, **{kind.target: state[kind.target]})
        out = {
            "limit": limit,
            "pressure": pressures[0],
            "status": found.status,
            "reasons": found.reason,
            "residual": found.residual,
            "nan": jnp.any(jnp.stack([jnp.any(jnp.isnan(v)) for v in state.values()])),
            "judged": judged.status,
            "reason": judged.reason,
            "margin": jnp.min(jnp.stack(list(judged.margins.values()))),
            "aim": state[kind.target],
            "back": back.pressure,
            "back_status": back.status,
        }
        prepared = scene.prepared()
        if isinstance(prepared, PathEquations) and not getattr(prepared, "is_arcs", lambda: False)():
            unknowns, left = continued(prepared, pressures[0])
            out |= {"unknowns": found.unknowns[0], "continued": unknowns, "left": left}
        return out

    return jax.jit(jax.vmap(one))


WORST: dict[str, Any] = {}
"""The first design that breaks an invariant, by the invariant's name: to look at."""


def violations(name: str, draw: np.random.Generator, n: int, compiled: Any) -> Counter:
    """How many of n random designs break what; under "designs" and statuses, what was seen."""
    p, share = designs(draw, n), draw.uniform(*SHARE, n)
    seen = {k: np.asarray(v) for k, v in compiled(p, share).items()}
    status, counts = seen["status"], Counter(designs=n)
    for code in sg.Status:
        counts[code.name] += int(np.sum(status[:, 0] == code))
        counts[f"{code.name} by the rules"] += int(np.sum(seen["judged"] == code))

    def broken(what: str, where: np.ndarray) -> None:
        counts[f"! {what}"] += int(np.sum(where))
        if np.any(where) and np.ndim(where):
            i = int(np.argmax(where))
            picked = {k: np.asarray(v)[i].tolist() for k, v in p.items()}
            WORST[f"{name}: {what}"] = (picked, {k: v[i].tolist() for k, v in seen.items()})

    is_ok, limit = status[:, 0] == OK, seen["limit"]
    known = np.isfinite(limit) & np.isin(status[:, 0], (OK, NO_CONTACT))
    broken("not converged", (status[:, 0] == LOST) & (seen["reasons"][:, 0] != sg.Reason.SHAPE_NOT_RESOLVED))
    broken("NaN under OK", is_ok & seen["nan"])
    broken("no limit of a state that is OK", is_ok & np.isnan(limit))
    broken("large residual under OK", np.any((status == OK) & ~(seen["residual"] < 1e-11), axis=1))
    # A fold's own pressure is rounded; within 1e-6 of it a state may not be told from none (NOT_CONVERGED).
    # Nor may a few points tell the shape of a beam that is about to curl up: said so, and no number is given.
    rough = seen["reasons"] == sg.Reason.SHAPE_NOT_RESOLVED
    counts["too few points for the shape near the limit"] += int(np.sum(np.any(rough, axis=1)))
    for k, (side, wanted) in enumerate((("1e-3 below", OK), ("1e-3 above", BEYOND)), start=1):
        near = np.where(status[:, k] == NO_CONTACT, wanted if wanted == OK else -1, status[:, k])
        broken(f"status {side} the limit", known & (near != wanted) & ~rough[:, k])
    for k, (side, wanted) in enumerate((("1e-6 below", OK), ("1e-6 above", BEYOND)), start=3):
        near = np.where(status[:, k] == NO_CONTACT, wanted if wanted == OK else -1, status[:, k])
        broken(f"status {side} the limit", known & (near != wanted) & (near != LOST))
        counts["not converged within 1e-6 of the limit"] += int(np.sum(known & (near == LOST)))

    # A rule that is broken makes a state IMPOSSIBLE, and nothing else does.
    ruled = np.where(seen["margin"] < -BROKEN, IMPOSSIBLE, OK)
    sure = is_ok & ~(np.abs(seen["margin"] + BROKEN) < 1e-9)
    broken("rules and status disagree", sure & (seen["judged"] != ruled))
    broken("a rule that is broken has no name", sure & (ruled == IMPOSSIBLE) & (seen["reason"] < 100))

    broken("pressure_for finds nothing", is_ok & (seen["back_status"] != OK))
    same = np.abs(seen["back"] / seen["pressure"] - 1) < 1e-8
    before = seen["back"] < seen["pressure"]
    broken("pressure_for is not the inverse", is_ok & (seen["back_status"] == OK) & ~same & ~before)
    counts["value met at a lower pressure first"] += int(np.sum(is_ok & before & ~same))

    if "continued" in seen:
        sure = is_ok & (seen["left"] < 1e-9)
        scale = np.maximum(1.0, np.max(np.abs(seen["unknowns"]), axis=1))
        apart = np.max(np.abs(seen["unknowns"] - seen["continued"]), axis=1) / scale
        broken("another state than by small steps", sure & (apart > 1e-6))
        counts["followed by small steps"] += int(np.sum(sure))

    alone = compiled(*jax.tree.map(lambda v: v[:1], (p, share)))
    for key in ("limit", "status", "aim", "judged"):
        same = np.allclose(np.asarray(alone[key])[0], seen[key][0], rtol=1e-8, atol=0, equal_nan=True)
        broken(f"{key} in a batch differs from one alone", np.asarray(not same))
    return counts
