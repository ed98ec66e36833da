"""What comes back: a status for every scene of a batch, and a Solution with its observables in SI."""

from __future__ import annotations

import dataclasses
import enum
from functools import partial
from importlib import import_module
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, PyTree

from .batches import Batched
from .errors import require_whole
from .reasons import Reason
from .units import DISPLAY

NORMAL_95 = 1.96
"""Standard deviations of half of a 95 % interval of what is normal."""


class Status(enum.IntEnum):
    """Why a result is as it is, as a number.

    Failure is a result: nothing is raised for a scene without equilibrium. OK: solved. NO_CONTACT: nothing is touched
    yet, forces are exactly zero. BEYOND_LIMIT: there is no equilibrium at this load. IMPOSSIBLE: a rule is broken.
    NOT_CONVERGED: the residual is not small, and the values are withheld.

    Examples:
        >>> sg.Status(2).name
        'BEYOND_LIMIT'
    """

    OK = 0
    NO_CONTACT = 1
    BEYOND_LIMIT = 2
    IMPOSSIBLE = 3
    NOT_CONVERGED = 4

    @property
    def message(self) -> str:
        """One sentence for people."""
        return _MESSAGES[self]


_MESSAGES = {
    Status.OK: "solved",
    Status.NO_CONTACT: "the pressure is too low: nothing is touched yet, and the force is exactly zero",
    Status.BEYOND_LIMIT: "no equilibrium: the load is beyond the limit point or the end of the model",
    Status.IMPOSSIBLE: "the scene cannot exist: a dimension breaks its rule, or the parts do not fit together",
    Status.NOT_CONVERGED: "the solver stopped before the residual was small; the values are withheld",
}


class Solution(Batched):
    """The state of one scene at one pressure, or of a batch of them.

    Observables are attributes (`sol.force`), in SI. Where the status is not OK they are NaN (NO_CONTACT: zeros), and no
    gradient passes.

    Args:
        scene: what was solved.
        pressure: gauge pressure, Pa, shape (*batch).
        status: number of a `Status`, shape (*batch).
        residual: scaled residual norm of the equations that were solved, dimensionless, shape (*batch).
        iterations: of the solver, shape (*batch).
        unknowns: what the equations were solved for, in the scene's own order and scaling.
        observables: name -> value in SI, shape (*batch), of points (*batch, 2).
        reason: number of a `Reason`, shape (*batch); see `reason_text`.
        detail: the number that belongs to the reason, in SI, such as a limit pressure (Pa) or by how much a rule is
            broken (m); NaN where there is none.
        margins: name of a rule -> its margin, m, negative where it is broken; NaN where the state that it asks for is
            missing.

    Examples:
        >>> shell = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
        >>> state = sg.solve(sg.shell.Free(shell), 25 * kPa)
        >>> state.reason_text()
        'no equilibrium: the pressure has its largest value, 20.18 kPa, at a limit point'
        >>> float(state.inflation)
        nan
    """

    scene: Any
    pressure: Float[Array, "*batch"]
    status: Int[Array, "*batch"]
    residual: Float[Array, "*batch"]
    iterations: Int[Array, "*batch"]
    unknowns: PyTree
    observables: dict[str, Array]
    reason: Int[Array, "*batch"]
    detail: Float[Array, "*batch"]
    margins: dict[str, Array]

    STATUSES = Status

    def __getattr__(self, name: str) -> Any:
        observables = self.__dict__.get("observables")
        if observables is not None and name in observables:
            return observables[name]
        known = ", ".join(sorted(observables)) if observables else "none"
        raise AttributeError(f"{name!r} is not an observable of this solution; it has: {known}")

    def at_pressure(self, pressure: Array) -> Solution:
        """The same solution, reported at another pressure."""
        return dataclasses.replace(self, pressure=pressure)

    def reason_text(self) -> Any:
        """The reason in words: one sentence, or an array of sentences for a batch."""
        sentences = np.vectorize(lambda reason, detail: Reason(int(reason)).text(float(detail)), otypes=[object])
        said = sentences(np.asarray(self.reason), np.asarray(self.detail))
        return said if self.reason.ndim else str(said)

    def shape(self, n: int = 101) -> dict[str, Array]:
        """The deformed shape at n points, as arrays by name (see the scene's ``profile``), NaN where the state is not
        OK; InputError where n is not a whole number, 2 or more."""
        require_whole("n", n, 2)
        one = partial(_shape, n=n)
        for _ in range(self.status.ndim):
            one = jax.vmap(one)
        return one(self.scene, self.unknowns, self.pressure, self.status)

    def mesh(self) -> Any:
        """The deformed gripper in space, a `geometry.Mesh`: triangles by parts, m; it writes .vtk, .stl and .obj."""
        # Meshes know every kind of scene, and scenes know solutions: by name, no room needs another in a circle.
        return import_module(f"{__package__}.geometry").mesh(self)

    def __str__(self) -> str:
        if self.status.ndim:
            return self.table()
        return "\n".join([type(self.scene).__name__, *(f"  {name:<24}{text}" for name, text in self.rows())])

    def rows(self) -> list[tuple[str, str]]:
        """(name, value with unit) of everything a person would want to read, for one scene."""
        status = Status(int(self.status))
        rows = [
            ("status", status.name + ("" if status is Status.OK else f": {self.reason_text()}")),
            ("pressure", in_units(self.pressure, "pressure")),
        ]
        for name, kind in self.scene.OBSERVABLES.items():
            known = status is not Status.NO_CONTACT or is_zero_apart(name, kind)
            rows.append((name.replace("_", " "), in_units(self.observables[name], kind) if known else "-"))
        rows.append(("scaled residual", f"{float(self.residual):.1e}, {int(self.iterations)} iterations"))
        return rows


@partial(jax.jit, static_argnames="n")
def _shape(scene: Any, unknowns: Array, pressure: Array, status: Array, n: int) -> dict[str, Array]:
    drawn = scene.profile(unknowns, pressure, n)
    return {name: jnp.where(status == Status.OK, values, jnp.nan) for name, values in drawn.items()}


def in_units(value: Any, kind: str) -> str:
    """A value in SI as people read it: '13.41 mm', '(1.2, 3.4) mm', and '-' where there is none."""
    label, unit = DISPLAY[kind]
    numbers = np.asarray(value) / unit
    if np.all(np.isnan(numbers)):
        return "-"
    # Of a point, what is nothing beside its other component is shown as nothing.
    numbers = np.where(np.abs(numbers) < 1e-9 * np.max(np.abs(numbers)), 0.0, numbers)
    text = f"{numbers:.5g}" if numbers.ndim == 0 else "(" + ", ".join(f"{v:.5g}" for v in numbers) + ")"
    return f"{text} {label}".strip()


def is_zero_apart(name: str, kind: str) -> bool:
    """Whether an observable is zero where nothing is touched; `mask` has zeros for the others, too."""
    return (kind == "force" and name != "required_force") or name.startswith("contact")


def stop_gradient_where_failed(ok: Array, tree: PyTree) -> PyTree:
    """The same values, but where `ok` is false no derivative passes, forward or reverse, whatever happens inside."""
    return jax.tree.map(lambda x: jnp.where(ok, x, jax.lax.stop_gradient(x)), tree)


def mask(status: Array, observables: dict[str, Array]) -> dict[str, Array]:
    """Observables as they are reported: zeros where nothing is touched, NaN where there is no answer."""
    withheld = jnp.where(status == Status.NO_CONTACT, 0.0, jnp.nan)
    return {
        name: jnp.where(status == Status.OK, value, withheld.astype(value.dtype)) for name, value in observables.items()
    }
