"""Fingers whose parts are circular arcs: no part's moment depends on the others."""

from __future__ import annotations

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..numerics.scalar_roots import bracketed_root
from ..reasons import RULE_NAMES, Reason
from ..results import Status
from ..scene import Found, frozen
from ..solvers.arc_length import asked_for
from .finger_scene import opening

Scalar = Float[Array, ""]

MATCHED = 1e-6
"""Moments (in EI/L) closer than this belong to a root, whose residual is then judged; others to no equilibrium."""


def found(scene: Any, pressure: Scalar) -> Found:
    """The state at a pressure: the moment of every part, explicit or, where walls incline, by the path of each part."""
    each = _each(scene, pressure)
    residual, observed = scene.evaluated(each.unknowns, pressure)
    # Beyond the section's reach the moments do not match, or are NaN.
    carried = jnp.all(jnp.isfinite(scene.turns(each.unknowns)[0]))
    ended = jnp.any(each.status != Status.OK)
    curled = scene.passed(observed) > 0
    exists = jnp.all(jnp.abs(residual) < MATCHED) & ~curled & ~ended
    end = scene.pressure_span().end
    closed = pressure > end
    # The part that ends first.
    places = jnp.nan_to_num(jnp.asarray(each.detail), nan=jnp.inf, posinf=jnp.inf)
    first = jnp.argmin(jnp.where(each.status == Status.OK, jnp.inf, places))
    first = jnp.where(jnp.any(jnp.isfinite(places)), first, jnp.argmax(each.status != Status.OK))
    cases = [
        (exists, Status.OK, 0, jnp.nan),
        (closed, Status.BEYOND_LIMIT, scene.end_reason(), end),
        (ended, each.status[first], jnp.asarray(each.reason)[first], jnp.asarray(each.detail)[first]),
        (~carried, Status.BEYOND_LIMIT, Reason.SECTION_FULL, jnp.nan),
        (jnp.asarray(True), Status.BEYOND_LIMIT, Reason.CURLED_UP, jnp.nan),
    ]
    here = [case[0] for case in cases]
    status, reason, detail = (jnp.select(here, [jnp.asarray(case[k]) for case in cases]) for k in (1, 2, 3))
    possible, held = scene.can_exist(), _is_held(scene)
    status = jnp.where(possible & held, status, Status.IMPOSSIBLE)
    reason = jnp.where(possible, jnp.where(held, reason, int(Reason.LOAD_NOT_HELD)), 0)
    detail = jnp.where(held, detail, jnp.nan)
    taken = jnp.max(each.iterations)
    return asked_for(pressure, Found(each.unknowns, pressure, status, taken, reason=reason, detail=detail))


def _is_held(scene: Any) -> Bool[Array, ""]:
    """False where the weight alone curls the finger up, or is more than its cover carries."""
    if scene.combination == "sum" or scene.weight is None:
        return jnp.asarray(True)
    return scene.passed(scene.evaluated(scene.unloaded_state(), jnp.zeros_like(scene.finger.L))[1]) <= 0


def limit(scene: Any) -> Found:
    """Where the first of the parts ends, or the finger is curled up, as `ArcLength.find_limit` has it."""
    ends = jax.vmap(lambda one: one.solver().find_limit(one))(frozen(_alone(scene)))
    first = jnp.argmin(ends.pressure)
    end = ends.pressure[first]
    parts, _ = scene.chambers()
    most = ends.unknowns[:, 0] / (parts.high - parts.low)

    def moments(pressure):
        """Of a part below its own end: on its branch they rise with the pressure, up to `most`."""
        there = jax.vmap(lambda *part: _balanced(scene, pressure, *part))(most, parts.chamber, parts.high - parts.low)
        return scene.ruled(jnp.where(ends.pressure <= pressure, most, there), parts)

    def excess(pressure):
        return scene.passed(scene.evaluated(moments(pressure), pressure)[1])

    curled = excess(end) > 0
    pressure = bracketed_root(excess, 0 * end, jnp.where(curled, end, 0 * end)).x
    pressure = jnp.where(curled, pressure, end)
    reason = jnp.where(curled, int(Reason.CURLED_UP), jnp.asarray(ends.reason)[first])
    status = jnp.where(scene.can_exist() & _is_held(scene), ends.status[first], Status.IMPOSSIBLE)
    return Found(moments(pressure), pressure, status, jnp.max(ends.iterations), reason=reason)


def begun_state(scene: Any, pressure: Scalar) -> Array:
    """The moment of one arc alone at a pressure at which its chambers have just begun to push: the only one there."""
    scene = frozen(scene)
    parts, _ = scene.chambers()
    most = scene.applied(parts.chamber, 0 * parts.low, pressure)
    return jax.vmap(lambda *part: _balanced(scene, pressure, *part))(most, parts.chamber, parts.high - parts.low)


def _balanced(scene: Any, pressure: Scalar, most: Scalar, chamber: Any, length: Scalar) -> Scalar:
    """The moment of one part, between none and `most`, that its chamber applies as it then inclines."""
    slenderness = scene.finger.H / scene.finger.L

    def surplus(y):
        z, _ = scene.law()(y * slenderness / 3, jnp.zeros_like(y))
        inclination = opening(chamber.inclining * z / slenderness * length)
        found = y - 3 / slenderness * scene.push(chamber, pressure, inclination)
        return jnp.where(jnp.isfinite(found), found, jnp.inf)  # beyond the section's reach, or the wall's: too much

    return bracketed_root(surplus, 0 * most, most).x


def _each(scene: Any, pressure: Scalar) -> Found:
    """The moments of all parts at a pressure, and what became of each."""
    if scene.inclines():
        alone = frozen(_alone(scene))
        each = jax.vmap(lambda one: one.solver().find(one, pressure, None))(alone)
        return each._replace(unknowns=_of_whole(scene, each.unknowns))
    parts, _ = scene.chambers()
    moments = scene.applied(parts.chamber, jnp.zeros_like(parts.low), pressure)
    fine, none = jnp.full(moments.shape, int(Status.OK)), jnp.zeros(moments.shape, int)
    return Found(moments, pressure, fine, none, reason=none, detail=none * jnp.nan)


def _of_whole(scene: Any, moments: Array) -> Array:
    """Moments of parts alone, (parts, 1), as unknowns of the scene."""
    parts, _ = scene.chambers()
    return scene.ruled(moments[:, 0] / (parts.high - parts.low), parts)


def _alone(scene: Any) -> Any:
    """Every part as a uniform finger of its length, a batch of scenes: one arc each, whose path ends at its limit."""
    parts, _ = scene.chambers()

    def one(fields, length):
        finger = dataclasses.replace(scene.finger, **fields, L=scene.finger.L * length)
        free = {"combination": "sum", "weight": None, "tip_load": None, "ignored_rules": RULE_NAMES}
        return dataclasses.replace(scene, finger=finger, **free)

    return jax.vmap(one)(parts.chamber.fields, parts.high - parts.low)
