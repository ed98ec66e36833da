"""A parameter study: quantities of many designs, in chunks of one size through one compiled function."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jax import lax
from jaxtyping import Array, Float

from ..errors import InputError
from ..parameters import Named, Parameter, Parameters, Scenes
from ..quantities import Quantity, QuantitySet
from ..scene import Scene
from .dataset import labelled
from .designs import Designs

CHUNK = 4096
"""Designs per call: seconds of work between two marks of progress, kilobytes of memory per quantity."""

BATCH = 128
"""Lanes that run together within a call. A batch runs to its slowest lane, so more of them only wait for each other."""


class Study:
    """A parameter study: what to vary, what to look at, and which designs.

    Designs run in chunks of one size through one compiled program, so a design gives the same bits wherever it stands.

    Args:
        scenes: one scene, or a dictionary of several that share what varies.
        leaves: names of the varied numbers, for instance "shell.t_m", see `softgrip_jax.parameters`.
        quantities: what to compute of every design, see `softgrip_jax.quantities`.
        designs: Grid, LatinHypercube, Sobol or Table of SI values, one column per varied number.
        gradients: whether to compute the derivatives of every quantity by every varied number too.

    Raises:
        InputError: for an unknown name, no quantity, or designs with another number of columns.

    Examples:
        >>> shell = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
        >>> walls = sg.study.Grid([np.array([1.0, 1.1]) * mm])
        >>> study = sg.Study(sg.shell.Free(shell), ["shell.t_m"], [sg.Quantity("inflation", at=15 * kPa)], walls)
        >>> data = study.run()
        >>> print(f"{float(data.inflation_at_15_kPa[1]) / mm:.4f} mm")
        13.4067 mm
    """

    def __init__(
        self,
        scenes: Scene | Scenes,
        leaves: Sequence[str | Named],
        quantities: Sequence[Quantity],
        designs: Designs,
        gradients: bool = False,
    ):
        scenes = {"scene": scenes} if isinstance(scenes, Scene) else scenes
        self.leaves = Parameters(scenes, [Parameter(leaf) if isinstance(leaf, str) else leaf for leaf in leaves])
        if not quantities:
            raise InputError("There is no observable; say what to compute of every design.")
        self.asked, self.designs, self.gradients = QuantitySet(scenes, quantities), designs, gradients
        if designs.columns != self.leaves.size:
            raise InputError(f"The designs have {designs.columns} columns for {self.leaves.size} varied numbers.")
        self.chunk = min(CHUNK, -(-designs.count // BATCH) * BATCH)
        """Designs per call; small studies do not pay for a full one."""

    @property
    def chunks(self) -> int:
        """Number of chunks."""
        return -(-self.designs.count // self.chunk)

    def measure(self, x: Float[Array, " n"]) -> dict[str, Array]:
        """One design at SI values x: values, statuses, reasons and, where asked for, slopes (quantity by variable)."""

        def values(x):
            found = self.asked.measure(self.leaves.scenes_at(x))
            return found.values, {"values": found.values, "statuses": found.statuses, "reasons": found.reasons}

        if not self.gradients:
            return values(x)[1]
        slopes, found = jax.jacfwd(values, has_aux=True)(x)
        # A lane without an answer has no slope either: zero would be read as one.
        return {**found, "slopes": jnp.where(jnp.isfinite(found["values"])[:, None], slopes, jnp.nan)}

    def shapes(self, count: int) -> dict[str, tuple[int, ...]]:
        """Of the arrays that `evaluate` gives for so many designs."""
        quantities, states = len(self.asked.quantities), len(self.asked.states)
        shapes = {"values": (count, quantities), "statuses": (count, states), "reasons": (count, states)}
        return shapes | ({"slopes": (count, quantities, self.leaves.size)} if self.gradients else {})

    @cached_property
    def compiled(self) -> Any:
        """`measure` of a whole chunk, as one program."""
        return jax.jit(lambda x: lax.map(self.measure, x, batch_size=BATCH))

    def evaluate(self, rows: np.ndarray) -> dict[str, np.ndarray]:
        """Up to `chunk` designs. A part of a chunk is filled up with its last row, so that one program runs them all
        and a design gives the same bits wherever it stands."""
        missing = self.chunk - len(rows)
        found = self.compiled(jnp.asarray(np.concatenate([rows, np.repeat(rows[-1:], missing, axis=0)])))
        return {name: np.asarray(value)[: len(rows)] for name, value in found.items()}

    def measured_alone(self, x: np.ndarray) -> dict[str, np.ndarray]:
        """One design, without the cost of a batch."""
        return {name: np.asarray(value) for name, value in jax.jit(self.measure)(jnp.asarray(x)).items()}

    def parts(self, skip: Sequence[int] = ()) -> Iterator[tuple[int, dict[str, np.ndarray]]]:
        """(number, results) of every chunk but those in `skip`."""
        for k in sorted(set(range(self.chunks)) - set(skip)):
            yield k, self.evaluate(self.rows(k))

    def rows(self, k: int) -> np.ndarray:
        """The designs of chunk k."""
        return self.designs.rows(k * self.chunk, min((k + 1) * self.chunk, self.designs.count))

    def run(self) -> xr.Dataset:
        """The whole study in memory; `softgrip_jax.study.run_in` works in a folder, for more than fits."""
        parts = [part for _, part in self.parts()]
        arrays = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
        return labelled(self, self.designs.rows(0, self.designs.count), arrays)
