"""Whether a section law or a wall model of the user's own is one: scenes use each of its methods and compare none."""

from __future__ import annotations

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..errors import InputError
from ..own import is_known, is_own, require_numbers
from .finger import SEGMENT_FIELDS, PneuNet
from .section.base import SectionLaw
from .wall.base import WallModel

LOADS = np.array([[0.05, 0.0], [-0.05, 0.02], [0.1, -0.02], [0.02, 0.05]])
"""(m, n) at which the methods of a law are compared: type A bends by m = 0.09 at 31 kPa."""
SAME = 1e-6
"""Of the larger of |m| and |n|: a law that is the way back is so to rounding, or to the tolerance of a root."""
ROUNDING = 1e3
"""Machine epsilons of a stretch that count as nothing: a stiff law makes much of them."""


def require_law(law: Any) -> None:
    """An InputError where the methods of a section law of the user's own are not one law; nothing where it is one of
    this package, or its numbers are traced."""
    if not isinstance(law, SectionLaw) or not is_own(law) or not is_known(law):
        return
    name, one = type(law).__name__, jnp.ones(())
    single = require_numbers(f"{name}.__call__", law, law, 0 * one, 0 * one, names=("z", "lambda"))
    single &= require_numbers(f"{name}.loads", law, law.loads, 0 * one, one, names=("m", "n"))
    bounds = ("a bound from below", "one from above", "a guess")
    single &= require_numbers(f"{name}.stretches", law, law.stretches, 0 * one, 0 * one, names=bounds)
    if not single:
        return  # several laws in one, made for vmap
    loads = LOADS if law.stretches_at_all else LOADS * np.array([1.0, 0.0])
    with jax.ensure_compile_time_eval():  # under jit, too
        at_rest, *looked = [np.asarray(values) for values in _looked(law, jnp.asarray(loads))]
    if not np.max(np.abs(at_rest - np.array([0.0, 1.0]))) <= SAME:
        z, stretch = at_rest
        raise InputError(
            f"{name}() is ({z:.6g}, {stretch:.6g}) without any load; a cover at rest has (z, lambda) = (0, 1)."
        )
    for load, state, back, ends, stiff in zip(loads, *looked, strict=True):
        _compare(law, load, state, back, ends, stiff)


@jax.jit
def _looked(law: SectionLaw, loads: Float[Array, "k 2"]) -> tuple[Array, ...]:
    """The state at rest; then at each of the loads the state, the loads of that state, n at both bounds of the stretch,
    and how n rises with it."""

    def at(load):
        z, stretch = law(load[0], load[1])
        low, high, _ = law.stretches(z, load[1])
        ends = [law.loads(z, jnp.asarray(end, float))[1] for end in (low, high)]
        stiff = jax.jvp(lambda x: jnp.asarray(law.loads(z, x)[1]), (stretch,), (jnp.ones_like(stretch),))[1]
        return jnp.stack([z, stretch]), jnp.stack(law.loads(z, stretch)), jnp.stack(ends), stiff

    zero = jnp.zeros(())
    return jnp.stack(law(zero, zero)), *jax.vmap(at)(loads)


def _compare(law: SectionLaw, load: Any, state: Any, back: Any, ends: Any, stiff: Any) -> None:
    """An InputError where a law says one thing by one method and another by the next. What is NaN is no state."""
    name, (m, n), (z, stretch) = type(law).__name__, load, state
    if not np.all(np.isfinite(state)):
        return
    at = f"{name}({m:g}, {n:g}) is (z, lambda) = ({z:.6g}, {stretch:.6g})"
    if m * z <= 0:
        raise InputError(f"{at}; z must have the sign of m.")
    nothing = np.array([SAME * max(abs(m), abs(n))] * 2)
    if law.stretches_at_all:
        nothing[1] += ROUNDING * np.finfo(float).eps * abs(np.nan_to_num(stiff))
    else:  # it carries any axial force
        back = np.array([back[0], n])
    if not np.all(np.abs(back - load) <= nothing):
        raise InputError(
            f"{at}, but {name}.loads gives (m, n) = ({back[0]:.6g}, {back[1]:.6g}) there; loads must be the way back, "
            f"({m:g}, {n:g})."
        )
    if not law.stretches_at_all or type(law).bent is not SectionLaw.bent:
        return  # nothing is searched for
    if ends[0] > n + nothing[1] or ends[1] < n - nothing[1]:
        raise InputError(
            f"{name}.stretches({z:.6g}, {n:g}) gives bounds at which {name}.loads has n = {ends[0]:.6g} and "
            f"{ends[1]:.6g}; n must rise with the stretch, and {n:g} lie between the two."
        )


def require_walls(drive: Any, finger: PneuNet) -> None:
    """An InputError where a wall model of the user's own gives no numbers, or ends nowhere or before it begins; nothing
    where it is one of this package, or numbers are traced."""
    if not isinstance(drive, WallModel) or not is_own(drive) or not is_known((drive, finger)):
        return
    name = type(drive).__name__
    if any(jnp.ndim(value) for value in (finger.H, finger.B, finger.L)):
        return  # several fingers in one, made for vmap
    count, zero = finger.segments or 1, jnp.zeros(())
    with jax.ensure_compile_time_eval():  # under jit, too
        fields = {field: jnp.broadcast_to(getattr(finger, field), (count,)) for field in SEGMENT_FIELDS}
        chambers = [dataclasses.replace(finger, **{field: v[k] for field, v in fields.items()}) for k in range(count)]
    begins, ends = drive.contact_pressure, drive.largest_pressure
    single = require_numbers(f"{name}.end_moment", drive, drive.end_moment, chambers[0], zero, zero)
    single &= require_numbers(f"{name}.contact_pressure", drive, begins, chambers[0])
    single &= require_numbers(f"{name}.largest_pressure", drive, ends, chambers[0])
    if not single:
        return  # several models in one, made for vmap
    for one in chambers:
        with jax.ensure_compile_time_eval():  # under jit, too
            low, high = float(begins(one)), float(ends(one))
        if not np.isfinite(high):
            raise InputError(f"{name}.largest_pressure is {high:g} Pa; it must be finite: where the model ends.")
        if not 0 <= low < high:
            raise InputError(
                f"{name}.contact_pressure is {low:.6g} Pa and its largest_pressure {high:.6g} Pa; the first must be "
                "zero or more, and below the second."
            )
