"""A parameter study: quantities of many designs, in blocks of one size through one compiled function."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jax import lax
from jax.sharding import AxisType, NamedSharding, PartitionSpec
from jaxtyping import Array, Float

from ..compiler import IN_TURN, known_options
from ..equations import CurveEquations
from ..errors import InputError
from ..numerics.xla import traced_once
from ..parameters import Named, Parameter, Parameters, Scenes
from ..quantities import (
    AT_REST,
    LIMIT_MARGIN,
    MARGINS,
    NO_LIMIT_MARGIN,
    Quantity,
    QuantitySet,
    all_rules,
    rules_at_rest,
)
from ..reasons import BROKEN, Reason
from ..results import Status
from ..scene import Scene
from .blocks import Blocks
from .dataset import columns, labelled
from .designs import Designs

BLOCK = 1 << 17
"""Designs per block, which is computed by one call and stored in one chunk per variable, of scenes with one unknown: to
write a chunk costs a millisecond whatever its size."""
SLOW_BLOCK = 1 << 13
"""... and of others, whose designs take tens of microseconds and more: a study that is killed loses a block."""

BATCH = {"cpu": 1024}
"""Designs that are solved together within a call: on a CPU as many as its second cache holds. Free fingers, shells and
held fingers are within a tenth of their best between 512 and 4096."""
DEVICE_BATCH = 1 << 16
"""... and on other devices."""
LEAST_BATCH = 128
"""For studies of less than a batch."""
IN_TURN_BATCH = 128
"""At most, of scenes whose designs a CPU solves in turn, some milliseconds each: in a batch each begins from those
before it. A block is one batch, so that only the last one is filled up with copies, which take as long as designs."""


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
        InputError: for an unknown name, no quantity, two quantities with one label, or designs with another number of
            columns.

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
        ranges = {name: _ranges_of_state(scene) for name, scene in scenes.items()}
        margins = [
            Quantity(MARGINS + rule, at, name)
            for name, at in self.asked.states
            if at not in (None, AT_REST)
            for rule in ranges[name]
        ]
        self.known = QuantitySet(scenes, [*self.asked.quantities, *margins]) if margins else self.asked
        """What is asked, and then the margins of ranges that the same states may be beyond: they cost no solve."""
        self.ranges = [
            (self.known.index(margin), self.asked.states.index(margin.state), int(Reason[rule.upper()]))
            for margin in margins
            if (rule := margin.rule)
        ]
        """(place of the margin, of its state, number of its reason) of each."""
        if designs.columns != self.leaves.size:
            raise InputError(f"The designs have {designs.columns} columns for {self.leaves.size} varied numbers.")
        self.in_turn = any(scene.prepared().solver().in_turn() for scene in scenes.values())
        if self.in_turn:
            self.blocks = Blocks.of(designs.shape, IN_TURN_BATCH)
            self.batch = self.blocks.size
        else:
            most = BATCH.get(jax.default_backend(), DEVICE_BATCH)
            # It is solved together: small studies do not pay for a full one.
            self.batch = min(most, _power_of_two(max(designs.count, LEAST_BATCH)))
            self.blocks = Blocks.of(designs.shape, BLOCK if _is_quick(scenes) else SLOW_BLOCK, self.batch)
        names = [column.name for column in columns(self)]
        twice = next((name for name in names if names.count(name) > 1), None)
        if twice is not None:
            raise InputError(
                f"Two columns of the study would be called {twice}; states must differ in their first five digits."
            )

    def measure(self, x: Float[Array, " n"]) -> dict[str, Array]:
        """One design at SI values x: values, statuses, reasons and, where asked for, slopes (quantity by variable).

        The reason of a state that is OK, and beyond a range of its own, is that range.
        """

        is_margin = np.array([q.observable == LIMIT_MARGIN for q in self.asked.quantities])

        def values(x):
            found = self.known.measure(self.leaves.scenes_at(x))
            whys = list(found.reasons)
            for margin, state, reason in self.ranges:
                # A margin of a state that is not there is NaN, and below nothing.
                beyond = (found.statuses[state] == Status.OK) & (found.values[margin] < -BROKEN)
                whys[state] = jnp.where(beyond, reason, whys[state])
            statuses, reasons = found.statuses.astype(jnp.int8), jnp.stack(whys).astype(jnp.int16)
            own = found.values[: len(is_margin)]
            seen = jnp.where(is_margin & (own == NO_LIMIT_MARGIN), jnp.inf, own)
            return own, {"values": seen, "statuses": statuses, "reasons": reasons}

        if not self.gradients:
            return values(x)[1]
        slopes, found = jax.jacfwd(values, has_aux=True)(x)
        # A lane without an answer has no slope either: zero would be read as one.
        return {**found, "slopes": jnp.where(jnp.isfinite(found["values"])[:, None], slopes, jnp.nan)}

    @cached_property
    def compiled(self) -> Any:
        """The function of a call's designs. Where the process has several devices each takes its part of them."""
        devices, options = jax.devices(), known_options(IN_TURN if self.in_turn else None)
        if len(devices) == 1 or self.call % (self.batch * len(devices)):
            return traced_once(self._batches, compiler_options=options)
        mesh = jax.make_mesh((len(devices),), ("devices",), axis_types=(AxisType.Auto,))
        parts = PartitionSpec("devices")
        each = jax.shard_map(self._batches, mesh=mesh, in_specs=parts, out_specs=parts, check_vma=False)
        return jax.jit(each, in_shardings=NamedSharding(mesh, parts), compiler_options=options)

    def _batches(self, x: Float[Array, "d n"]) -> dict[str, Array]:
        return lax.map(self.measure, x, batch_size=self.batch)

    @property
    def call(self) -> int:
        """Designs of a call: those of a block, filled up to whole batches, of which every device gets as many."""
        whole, devices = -(-self.blocks.size // self.batch), len(jax.devices())
        return self.batch * (whole if whole < devices else -(-whole // devices) * devices)

    def evaluate(self, rows: np.ndarray) -> dict[str, np.ndarray]:
        """Up to a block of designs. What is missing to a call is filled up with the last row, so that one program runs
        them all and a design gives the same bits wherever it stands."""
        missing = self.call - len(rows)
        if missing:
            rows, count = np.concatenate([rows, np.repeat(rows[-1:], missing, axis=0)]), len(rows)
        else:
            count = len(rows)
        return {name: np.asarray(value)[:count] for name, value in self.compiled(rows).items()}

    def measured_alone(self, x: np.ndarray) -> dict[str, np.ndarray]:
        """One design, without the cost of a batch."""
        return {name: np.asarray(value) for name, value in traced_once(self.measure)(jnp.asarray(x)).items()}

    def rows(self, k: int) -> np.ndarray:
        """The designs of block k."""
        return self.designs.rows(self.blocks[k].start, self.blocks[k].stop)

    def parts(self) -> Iterator[tuple[int, dict[str, np.ndarray]]]:
        """(designs done, results) of every block."""
        for block in self.blocks:
            yield block.stop, self.evaluate(self.designs.rows(block.start, block.stop))

    def run(self) -> xr.Dataset:
        """The whole study in memory; `softgrip_jax.study.run_in` works in a store, for more than fits."""
        parts = [part for _, part in self.parts()]
        arrays = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
        return labelled(self, self.designs.rows(0, self.designs.count), arrays)

    def __getstate__(self) -> dict[str, Any]:
        """What goes to another process, which compiles for itself."""
        return {name: value for name, value in self.__dict__.items() if name != "compiled"}


def _power_of_two(count: int) -> int:
    return 1 << (count - 1).bit_length()


def _ranges_of_state(scene: Scene) -> list[str]:
    """The rules that forbid nothing and belong to a state: the parts at rest are looked at apart."""
    at_rest = rules_at_rest(scene)
    return [rule for rule in all_rules(scene) if rule not in at_rest and not Reason[rule.upper()].forbids]


def _is_quick(scenes: Scenes) -> bool:
    """Whether every scene has one unknown, or a closed form."""
    prepared = [scene.prepared() for scene in scenes.values()]
    return all(isinstance(scene, CurveEquations) or scene.unknown_shape() == (1,) for scene in prepared)
