"""A batch of solutions as a sequence and as a table: `curve[2]`, `len(curve)`, `print(curve)`, pandas, xarray.

`Solution` inherits all of it. A batch has its axes in front, on every array of the solution. The scene has them too
where it was batched with the rest (`jax.vmap` does so); a scene that has no such axes belongs to every state.
"""

from __future__ import annotations

import dataclasses
import enum
import html
import textwrap
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import numpy as np
from jax.core import Tracer
from jaxtyping import Array

from .fields import Checked
from .units import DISPLAY, SI

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

ROWS = 10
"""A longer batch is printed by its first rows."""
WIDTH = 110
"""Characters of a printed table; what does not fit is named below it."""
COMPONENTS = ("x", "y", "z")


class Column(NamedTuple):
    """One number of every state, in SI."""

    name: str
    values: np.ndarray
    kind: str = "number"
    is_detail: bool = False
    """Not printed: for those who compute with it."""


class Batched(eqx.Module):
    """What a solution of several states is beyond one of a single state."""

    STATUSES: ClassVar[type[enum.IntEnum]]
    if TYPE_CHECKING:
        scene: Any
        pressure: Array
        status: Array
        residual: Array
        iterations: Array
        observables: dict[str, Array]

    def __len__(self) -> int:
        if not self.status.ndim:
            raise TypeError(
                f"this solution is one state of {type(self.scene).__name__}; a batch of states has a length"
            )
        return self.status.shape[0]

    def __bool__(self) -> bool:
        """A solution is something, whatever its length."""
        return True

    def __iter__(self) -> Iterator[Any]:
        return (self[i] for i in range(len(self)))

    def __getitem__(self, index: Any) -> Any:
        """The states at an index, a slice, a mask or an array of indices, as NumPy understands them; differentiable."""
        batch = self.status.shape
        if not batch:
            raise TypeError(f"this solution is one state of {type(self.scene).__name__}; only a batch can be indexed")
        count = len(batch)
        # NumPy says which states are meant, and refuses an index that is out of range, which JAX does not.
        wanted = np.arange(self.status.size).reshape(batch)[index]

        def pick(leaf):
            if not eqx.is_array(leaf) or leaf.shape[:count] != batch:
                return leaf
            return leaf.reshape(-1, *leaf.shape[count:])[wanted]

        # All of a scene is batched or nothing of it: a finger of n segments has arrays of its own.
        is_batched = all(leaf.shape[:count] == batch for leaf in jax.tree.leaves(self.scene) if eqx.is_array(leaf))
        rest = {field.name: getattr(self, field.name) for field in dataclasses.fields(self) if field.name != "scene"}
        rest = jax.tree.map(pick, rest)
        return dataclasses.replace(self, scene=jax.tree.map(pick, self.scene) if is_batched else self.scene, **rest)

    # --- tables

    def columns(self) -> list[Column]:
        """Every number of every state: what varies in the scene, the pressure, the status, what was observed."""
        found = [Column(name, values, kind) for name, values, kind in self._varied()]
        found.append(Column("pressure", self._flat(self.pressure), "pressure"))
        found.append(
            Column("status", np.array([self.STATUSES(int(s)).name for s in self._flat(self.status)], dtype=str))
        )
        for name, kind in self.scene.OBSERVABLES.items():
            values = self._flat(self.observables[name])
            if values.ndim == 1:
                found.append(Column(name, values, kind))
            else:
                found += [
                    Column(f"{name}_{c}", values[:, k], kind) for k, c in enumerate(COMPONENTS[: values.shape[1]])
                ]
        plain = ("scene", "pressure", "status", "observables", "unknowns")
        for field in dataclasses.fields(self):
            if field.name in plain:
                continue
            value = getattr(self, field.name)
            parts = value if isinstance(value, dict) else {"": value}
            for key, part in parts.items():
                if eqx.is_array(part) and part.shape == self.status.shape:
                    name = f"{field.name}.{key}" if key else field.name
                    kind = "length" if field.name == "margins" else "number"
                    found.append(Column(name, self._flat(part), kind, is_detail=True))
        return found

    def _flat(self, value: Array) -> np.ndarray:
        """One row per state."""
        rows, batch = np.asarray(value), self.status.shape
        if rows.shape[: len(batch)] != batch:  # the same for every state
            rows = np.broadcast_to(rows, batch + rows.shape)
        return rows.reshape(-1, *rows.shape[len(batch) :])

    def _varied(self) -> list[tuple[str, np.ndarray, str]]:
        """(path, values, kind) of the numbers of the scene that are not the same in all states."""
        found: list[tuple[str, np.ndarray, str]] = []

        def walk(module, path):
            for field in dataclasses.fields(module):
                value, name = getattr(module, field.name), f"{path}{field.name}"
                if isinstance(value, Checked):
                    walk(value, f"{name}.")
                elif eqx.is_array(value) and value.shape == self.status.shape and value.ndim:
                    values = self._flat(value)
                    if np.any(values != values[:1]):
                        found.append((name, values, field.metadata.get("kind", "number")))

        walk(self.scene, "")
        return found

    def _indices(self) -> list[str]:
        return [", ".join(map(str, index)) for index in np.ndindex(self.status.shape)]

    def counts(self) -> str:
        """'38 OK, 2 BEYOND_LIMIT'."""
        values, counts = np.unique(np.asarray(self.status), return_counts=True)
        return ", ".join(f"{count} {self.STATUSES(int(v)).name}" for v, count in zip(values, counts, strict=True))

    def _heading(self) -> str:
        shape = " x ".join(map(str, self.status.shape))
        return f"{type(self.scene).__name__}, {shape} states: {self.counts() or 'none'}"

    def _cells(self, most: int) -> list[list[str]]:
        """The printed columns, each with its name and unit on top, of the first `most` states."""
        cells = [["", *self._indices()[:most]]]
        for column in self.columns():
            if column.is_detail:
                continue
            if column.values.dtype.kind == "U":
                cells.append([column.name, *column.values[:most]])
                continue
            label, unit = DISPLAY[column.kind]
            # Observables in words; the path of a number in the scene as it is typed.
            name = column.name if "." in column.name else column.name.replace("_", " ")
            head = f"{name} {label}".strip()
            shown = ["-" if np.isnan(v) else f"{v / unit + 0.0:.5g}" for v in column.values[:most]]
            cells.append([head, *shown])
        return cells

    def table(self) -> str:
        """The batch as text: a heading with the counts of statuses, and its first states in the units of people."""
        lines, omitted, used = [""] * (min(ROWS, self.status.size) + 1), [], 0
        for column in self._cells(ROWS):
            width = max(map(len, column))
            if used and used + 2 + width > WIDTH:
                omitted.append(column[0])
                continue
            gap = "  " if used else ""
            lines = [f"{line}{gap}{cell:>{width}}" for line, cell in zip(lines, column, strict=True)]
            used += len(gap) + width
        if self.status.size > ROWS:
            lines.append(f"... and {self.status.size - ROWS} more")
        if omitted:
            lines.append(textwrap.fill(f"Not shown: {', '.join(omitted)}; to_pandas() has all.", WIDTH))
        return "\n".join([self._heading(), *lines])

    def __repr__(self) -> str:
        if any(isinstance(leaf, Tracer) or not eqx.is_array_like(leaf) for leaf in jax.tree.leaves(self)):
            return eqx.tree_pformat(self)
        return str(self)

    def _repr_html_(self) -> str:
        """For notebooks."""
        if not self.status.ndim or isinstance(self.status, Tracer):
            return f"<pre>{html.escape(repr(self))}</pre>"
        columns = self._cells(ROWS)
        head, *rows = (
            "".join(f"<{tag}>{html.escape(column[i])}</{tag}>" for column in columns)
            for i, tag in [(0, "th"), *((i, "td") for i in range(1, len(columns[0])))]
        )
        body = "".join(f"<tr>{row}</tr>" for row in rows)
        more = f"<p>... and {self.status.size - ROWS} more</p>" if self.status.size > ROWS else ""
        return (
            f"<p>{html.escape(self._heading())}</p>"
            f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>{more}"
        )

    def to_pandas(self) -> pd.DataFrame:
        """A pandas DataFrame with one row per state, in SI; `frame.attrs["units"]` names the unit of every column.

        Columns: the numbers of the scene that vary (``shell.a``), pressure, status (its name), observables (a point as
        ``tip_x`` and ``tip_y``), residual, iterations.
        """
        import pandas as pd

        columns, batch = self.columns(), self.status.shape
        index = pd.MultiIndex.from_tuples(list(np.ndindex(batch))) if len(batch) > 1 else None
        frame = pd.DataFrame({column.name: column.values for column in columns}, index=index)
        frame.attrs["units"] = {c.name: SI[c.kind] or "1" for c in columns if c.values.dtype.kind != "U"}
        return frame

    def to_xarray(self) -> xr.Dataset:
        """An xarray Dataset in SI, with units in the attributes of every variable; its dimension is ``state``
        (``state_0``, ``state_1``, ... for a batch of several axes, none for one state).

        The pressure and what varies in the scene are coordinates. The status is a small integer, whose attributes name
        it (CF conventions: flag_values, flag_meanings).
        """
        import xarray as xr

        batch = self.status.shape
        dims = ("state",) if len(batch) == 1 else tuple(f"state_{k}" for k in range(len(batch)))
        varied = {name for name, _, _ in self._varied()}
        coords: dict[str, Any] = {}
        data: dict[str, Any] = {}
        flags = {
            "flag_values": np.array([int(s) for s in self.STATUSES], dtype=np.int8),
            "flag_meanings": " ".join(s.name for s in self.STATUSES),
        }
        data["status"] = (dims, np.asarray(self.status).astype(np.int8), {"long_name": "status"} | flags)
        for column in self.columns():
            words = {"long_name": column.name.replace("_", " "), "units": SI[column.kind] or "1"}
            if column.values.dtype.kind != "U":
                place = coords if column.name in varied or column.name == "pressure" else data
                place[column.name] = (dims, column.values.reshape(batch), words)
        return xr.Dataset(data, coords, {"title": type(self.scene).__name__, "source": "softgrip_jax"})
