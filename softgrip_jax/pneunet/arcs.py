"""Fingers whose parts are circular arcs, found without a path: each part is one scalar root."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..numerics.scalar_roots import bracketed_root
from ..reasons import Reason
from ..results import Status
from ..scene import Found
from ..solvers.arc_length import asked_for

Scalar = Float[Array, ""]

MATCHED = 1e-6
"""Moments (in EI/L) closer than this belong to a root, whose residual is then judged; others to no equilibrium."""


def found(scene: Any, pressure: Scalar) -> Found:
    """The state at a pressure: the moment of every part, explicit or as one bracketed root each."""
    parts, _ = scene.chambers()
    highest = scene.applied(parts.chamber, jnp.zeros_like(parts.low), pressure)

    def surplus(y, chamber, part_length):
        """Moment carried minus applied, rising with y, for one part; beyond the section's reach: too much."""
        z, _ = scene.law()(y * scene.finger.H / scene.finger.L / 3, jnp.zeros_like(y))
        turn = z * scene.finger.L / scene.finger.H * part_length
        applied = scene.push(chamber, pressure, chamber.inclining * turn) * 3 * scene.finger.L / scene.finger.H
        return jnp.where(jnp.isfinite(z), y - applied, jnp.inf)

    if not scene.inclines():
        unknowns, iterations = highest, jnp.asarray(0)
    else:
        roots = jax.vmap(lambda top, c, length: bracketed_root(lambda y: surplus(y, c, length), 0 * top, top))(
            highest, parts.chamber, parts.high - parts.low
        )
        unknowns, iterations = jnp.where(highest > 0, roots.x, 0.0), jnp.max(roots.iterations)
    # Beyond the section's reach, or the wall's, the search ends where the moments do not match, or at NaN.
    residual, observed = scene.evaluated(unknowns, pressure)
    carried = jnp.all(jnp.isfinite(scene.turns(unknowns)[0]))
    curled = scene.passed(observed) > 0
    exists = (jnp.max(jnp.abs(residual)) < MATCHED) & ~curled
    status = jnp.where(exists, Status.OK, Status.BEYOND_LIMIT)
    end = scene.pressure_span().end
    closed = ~exists & (pressure > end)
    reason = jnp.where(carried, int(Reason.INCLINED_WALL), int(Reason.SECTION_FULL))
    reason = jnp.where(closed, int(scene.end_reason()), jnp.where(curled, int(Reason.CURLED_UP), reason))
    reason, detail = jnp.where(exists, 0, reason), jnp.where(closed, end, jnp.nan)
    status = jnp.where(scene.can_exist(), status, Status.IMPOSSIBLE)
    reason = jnp.where(scene.can_exist(), reason, 0)
    return asked_for(pressure, Found(unknowns, pressure, status, iterations, reason=reason, detail=detail))
