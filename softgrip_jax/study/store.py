"""A study in a store (Zarr, version 3): it may be stopped at any moment, even killed, and goes on where it was.

The store is made as a whole first, with its labels and units and nothing in it; then every block of designs writes its
own chunk of every variable, which appears complete or not at all. A block is computed by one program from its own
designs alone, so a study in two parts, or by many processes, equals one that was never stopped, bit for bit. Every
chunk has a checksum: one that cannot be read any more is computed again.
"""

from __future__ import annotations

import json
import platform
import time
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from importlib.util import find_spec
from pathlib import Path
from typing import Any, cast

import jax
import numpy as np
import xarray as xr

from .._version import __version__
from ..errors import ConfigError
from ..results import Status
from .blocks import Block
from .dataset import BY, TITLE, axes, by_names, columns, pieces, states_of
from .designs import Grid
from .study import Study

STORE, OLD_RESULT, OLD_MANIFEST = "study.zarr", "study.nc", "manifest.json"
BEGUN = "study"
"""The attribute that says which study the store is of, and makes a folder of arrays a store of ours."""
COMPRESSION = {"cname": "lz4", "clevel": 1, "shuffle": "shuffle"}
"""Blosc: as quick as the disk. What is computed has few digits in common, and slower ways save 1 % more."""
WAITING = 2
"""Blocks that are computed and not yet written."""

Report = Callable[[int, int], None]
Computing = Callable[["Store", Sequence[int], Callable[[int, str], None]], None]
"""Like `compute`."""
AGAIN = "run it again with the same --out or --to"


def address_of(place: str | Path) -> str:
    """Where the store is: study.zarr in a folder, or what is named, where that is an address (s3://...) or ends in
    .zarr."""
    text = str(place)
    is_store = "://" in text or text.rstrip("/").endswith(".zarr")
    return text if is_store else str(Path(text) / STORE)


def load_study(place: str | Path) -> xr.Dataset:
    """The result of `softgrip sweep` or `run_in`, opened lazily: what is not looked at stays on the disk.

    Where dask is installed its arrays are those of dask, so that computations go through a study of any size.

    Args:
        place: the folder of a study, or its store: a path that ends in .zarr, or an address (s3://...) that fsspec
            knows.

    Returns:
        An xarray Dataset in SI.

    Raises:
        ConfigError: where there is no finished study.

    Examples:
        >>> sg.load_study("nowhere")
        Traceback (most recent call last):
        softgrip_jax.errors.ConfigError: nowhere cannot be opened: there is no such folder.
    """
    old = Path(place) / OLD_RESULT
    if "://" not in str(place) and old.is_file():
        return xr.open_dataset(old, engine="h5netcdf")
    return opened(place, {} if find_spec("dask") else None)


def opened(place: str | Path, chunks: dict[str, int] | None = None) -> xr.Dataset:
    """The Dataset of a finished study; without dask where no chunks are given."""
    address = address_of(place)
    if "://" not in address and not Path(place).exists():
        raise ConfigError(f"{place} cannot be opened: there is no such folder.")
    begun = _begun(address, to_write=False)
    if begun is None:
        is_old = "://" not in address and (Path(place) / OLD_MANIFEST).is_file()
        why = f"its study is not finished; {AGAIN}" if is_old else "there is no study in it"
        raise ConfigError(f"{place} cannot be opened: {why}.")
    if not begun["finished"]:
        raise ConfigError(f"{place} cannot be opened: its study is not finished; {AGAIN}.")
    return _dataset(address, chunks)


def _dataset(address: str, chunks: dict[str, int] | None = None) -> xr.Dataset:
    try:
        data = xr.open_dataset(_target(address), engine="zarr", consolidated=False, chunks=chunks)
    except Exception as error:  # a damaged store has no exception of its own
        raise ConfigError(f"{address} cannot be read: {str(error).rstrip('.')}; compute it under a new name.") from None
    said = data.attrs[BEGUN]
    lost = next((name for name in said["variables"] + said["varied"] if name not in data.variables), None)
    if lost is not None:
        raise ConfigError(f"{address} cannot be read: it lacks {lost}; compute it under a new name.")
    # A store has no order: that of the study is in the attributes. So are the names of what the derivatives are taken
    # by: Zarr has no type for words yet that all its readers know.
    coords: dict[str, Any] = {name: data[name].variable for name in said["varied"]}
    coords |= by_names(said["varied"]) if BY in data.dims else {}
    variables = {name: data[name].variable for name in said["variables"] if name not in coords}
    found = xr.Dataset(variables, coords, data.attrs)
    found.encoding["source"] = address.rstrip("/")
    return found


def run_in(
    place: str | Path,
    study: Study,
    identity: str,
    report: Report = lambda done, skipped: None,
    remark: Callable[[str], None] = lambda sentence: None,
    spread: Computing | None = None,
) -> None:
    """Run a study in a store, or go on with it.

    Args:
        place: a folder, which is made where it does not exist, or a store (see `load_study`).
        study: what to run.
        identity: what tells this study from others, the text of its config for instance: a store that was begun with
            another one or by another version is refused; without `spread` also one that is not finished and was begun
            on another kind of machine.
        report: called with (designs done, designs that were found done) at the start and after every block.
        remark: called with a sentence where chunks that were found cannot be read, and are computed again.
        spread: what computes in place of this process: `softgrip_jax.study.cluster.client` gives one.

    Raises:
        ConfigError: where the place holds something else, or cannot be written.

    Examples:
        >>> from pathlib import Path
        >>> shell = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
        >>> walls = sg.study.Grid([np.array([1.0, 1.1]) * mm])
        >>> study = sg.Study(sg.shell.Free(shell), ["shell.t_m"], [sg.Quantity("inflation", at=15 * kPa)], walls)
        >>> sg.study.run_in(Path("walls"), study, "two walls")
        >>> with sg.load_study("walls") as data:
        ...     print(f"{float(data.inflation_at_15_kPa[1]) / mm:.4f} mm")
        13.4067 mm
    """
    address, start = address_of(place), time.monotonic()
    here = device()
    begun = _identity(study, identity)
    previous = _begun(address)
    try:
        if previous is None:
            state = {"begun": begun, "varied": study.leaves.names, "finished": False}
            state["variables"] = [column.name for column in columns(study)]
            _make(address, study, state | {"devices": [here] if spread is None else []})
        else:
            differing = [k for k, v in begun.items() if previous["begun"].get(k) != v]
            if differing:
                raise ConfigError(f"{place} holds another study (different: {', '.join(differing)}); give a new name.")
            known = previous["devices"]
            if spread is None and known and here not in known and not previous["finished"]:
                raise ConfigError(
                    f"{place} was begun on another kind of machine, {' and '.join(known)}, and this one is {here}; go "
                    "on with it there, or give a new name."
                )
        store = Store(address, study)
        lost, todo, skipped = store.missing() if previous is not None else ([], range(len(study.blocks)), 0)
        if lost:
            others = f" and {len(lost) - 1} more" if lost[1:] else ""
            there = len(study.blocks) - len(todo) + len(lost)
            remark(
                f"{lost[0]}{others} cannot be read, of {there} blocks that were there; the designs are computed again."
            )
        report(skipped, skipped)
        if not todo and previous is not None and previous["finished"]:
            return
        store.mark({"finished": False})
        done = skipped

        def tell(count: int, by: str) -> None:
            nonlocal done
            done += count
            store.mark_device(by)
            report(done, skipped)

        (spread or compute)(store, todo, tell)
        store.finish(time.monotonic() - start)
    except OSError as error:
        why = (error.strerror or str(error)).lower()
        raise ConfigError(f"{address} cannot be written: {why}; when that is mended, {AGAIN}.") from None


def compute(store: Store, todo: Sequence[int], tell: Callable[[int, str], None]) -> None:
    """Compute blocks and write them, the next one while the last one is written; tell(designs, kind of device) after
    every one."""
    study, here = store.study, device()
    with ThreadPoolExecutor(1) as writer:
        waiting: deque[tuple[Block, Future[None]]] = deque()

        def settle(most: int) -> None:
            while len(waiting) > most:
                block, written = waiting.popleft()
                written.result()
                tell(block.stop - block.start, here)

        for k in todo:
            block = study.blocks[k]
            rows = study.designs.rows(block.start, block.stop)
            waiting.append((block, writer.submit(store.write, block, rows, study.evaluate(rows))))
            settle(WAITING)
        settle(0)


class Store:
    """The arrays of a study that was begun, open for writing."""

    def __init__(self, address: str, study: Study):
        import zarr

        self.address, self.study, self.columns = address, study, columns(study)
        self.group = zarr.open_group(_target(address), mode="r+", zarr_format=3)
        try:
            self.arrays: dict[str, Any] = {column.name: self.group[column.name] for column in self.columns}
        except (KeyError, ValueError, TypeError):
            raise ConfigError(f"{address} lacks a part of its study, or it is not readable; give a new name.") from None

    def write(self, block: Block, rows: np.ndarray, found: dict[str, np.ndarray]) -> None:
        for column in self.columns:
            values = column.of(rows, found)
            self.arrays[column.name][block.box] = values.reshape(*block.shape, *values.shape[1:])

    def missing(self) -> tuple[list[str], list[int], int]:
        """(chunks that are there and cannot be read, blocks to compute, designs that are done); what cannot be read is
        removed."""
        lost, todo, done = [], [], 0
        for k, block in enumerate(self.study.blocks):
            keys = [self._key(column, block) for column in self.columns]
            there = [self._exists(key) for key in keys]
            bad = next((key for key, is_there in zip(keys, there, strict=True) if is_there and self._spoilt(key)), None)
            if bad is not None:
                lost.append(f"{self.address.rstrip('/')}/{bad}")
            if bad is None and all(there):
                done += block.stop - block.start
                continue
            todo.append(k)
            for key, is_there in zip(keys, there, strict=True):
                if is_there:
                    self._sync(self.group.store.delete(key))
        return lost, todo, done

    def _key(self, column: Any, block: Block) -> str:
        further = (0,) * (len(column.dims) - len(block.place))
        return "/".join(map(str, (column.name, "c", *block.place, *further)))

    def _spoilt(self, key: str) -> bool:
        """Whether a chunk does not hold what was written: its checksum, or anything else of it, is wrong."""
        name, _, places = key.partition("/c/")
        array = self.arrays[name]
        box = tuple(slice(int(i) * c, (int(i) + 1) * c) for i, c in zip(places.split("/"), array.chunks, strict=True))
        try:
            array[box]
        except OSError:
            raise
        except Exception:  # the codecs have no exception in common
            return True
        return False

    def _exists(self, key: str) -> bool:
        return self._sync(self.group.store.exists(key))

    @staticmethod
    def _sync(coroutine: Any) -> Any:
        from zarr.core.sync import sync

        return sync(coroutine)

    def mark(self, changes: dict[str, Any]) -> None:
        """Change what the attributes say of the run."""
        now: dict[str, Any] = dict(cast(Any, self.group.attrs[BEGUN]))
        if any(now.get(name) != value for name, value in changes.items()):
            self.group.update_attributes({BEGUN: now | changes})

    def mark_device(self, name: str) -> None:
        """A kind of device that has computed a part of the study."""
        devices = cast(Any, self.group.attrs[BEGUN])["devices"]
        if name not in devices:
            self.mark({"devices": sorted([*devices, name])})

    def finish(self, seconds: float) -> None:
        counts = status_counts(_dataset(self.address))
        self.mark({"finished": True, "seconds": round(seconds, 3), "statuses": counts})


def status_counts(data: xr.Dataset) -> dict[str, dict[str, int]]:
    """For every state how many designs have which status."""
    names = states_of(data)
    totals = {name: np.zeros(len(Status), dtype=np.int64) for name in names}
    for part in pieces(data, names):
        for name in names:
            totals[name] += np.bincount(part[name], minlength=len(Status))
    return {name: {s.name: int(total[s]) for s in Status if total[s]} for name, total in totals.items()}


def device() -> str:
    """The kind of device that this process computes on."""
    return f"{jax.devices()[0].device_kind} {platform.machine()}"


def _identity(study: Study, identity: str) -> dict[str, Any]:
    """What must be the same for a study to go on."""
    return {
        "designs": study.designs.count,
        "block": list(study.blocks.chunk),
        "config": identity,
        "seed": getattr(study.designs, "seed", None),
        "softgrip_jax": __version__,
        "jax": jax.__version__,
        "numpy": np.__version__,
    }


def _target(address: str) -> Any:
    """What zarr opens."""
    from zarr.storage import FsspecStore, LocalStore

    if "://" not in address:
        return LocalStore(address)
    try:
        # What is not local has no folders that must be made first.
        options = {"auto_mkdir": True} if address.startswith(("file://", "local://")) else {}
        return FsspecStore.from_url(address, storage_options=options)
    except (ImportError, ValueError) as error:
        raise ConfigError(f"{address} cannot be opened: {str(error).rstrip('.')}.") from None


def _begun(address: str, to_write: bool = True) -> dict[str, Any] | None:
    """What the store says of its study, None where there is none yet; a ConfigError where it is of something else, and
    nothing should be written there."""
    import zarr

    place = Path(address)
    if "://" not in address and to_write:
        _refuse_others(place)
    try:
        attributes = zarr.open_group(_target(address), mode="r", zarr_format=3).attrs
        state = cast(Any, attributes.get(BEGUN))
    except FileNotFoundError:
        return None
    except ConfigError:
        raise
    except Exception as error:
        words = error.strerror if isinstance(error, OSError) and error.strerror else "its zarr.json is damaged"
        raise ConfigError(f"{address} is not readable: {words.lower()}; give a new name.") from None
    return None if state is None else dict(state)


def _refuse_others(store: Path) -> None:
    """A ConfigError where the folder has other things and no store, or the store is a folder of something else."""
    if store.is_dir() and any(store.iterdir()) and not (store / "zarr.json").is_file():
        raise ConfigError(f"{store} exists already and holds no study; give a new name.")
    folder = store.parent
    if store.name == STORE and not store.exists() and folder.is_dir():
        ours = {"config.toml", STORE}
        if any(path.name not in ours and not path.name.startswith(".") for path in folder.iterdir()):
            raise ConfigError(f"{folder} exists already and holds no study; give a new name.")


def _make(address: str, study: Study, state: dict[str, Any]) -> None:
    """The store with all its labels and no results. What it is of is written last: before that it is no study."""
    import zarr
    from zarr.codecs import BloscCodec, Crc32cCodec

    group = zarr.open_group(_target(address), mode="a", zarr_format=3)
    known = {column.name for column in columns(study)} | set(axes(study))
    others = sorted(set(group.array_keys()) - known)
    if others or dict(group.attrs):
        raise ConfigError(f"{address} exists already and holds no study; give a new name.")
    settings: dict[str, Any] = {"overwrite": True, "compressors": [BloscCodec(**COMPRESSION), Crc32cCodec()]}
    for name, (dim, values, attributes) in axes(study).items():
        values = np.asarray(values)
        array = group.create_array(
            name,
            shape=values.shape,
            dtype=values.dtype,
            dimension_names=[dim],
            attributes=_plain(attributes),
            **settings,
        )
        array[:] = values
    for column in columns(study):
        further = (study.leaves.size,) * (len(column.dims) - len(study.designs.shape))
        group.create_array(
            column.name,
            shape=(*study.designs.shape, *further),
            chunks=(*study.blocks.chunk, *further),
            dtype=column.dtype,
            fill_value=np.nan if column.dtype is float else -1,
            dimension_names=column.dims,
            attributes=_plain(column.attributes),
            config={"write_empty_chunks": True},
            **settings,
        )
    coordinates = {} if isinstance(study.designs, Grid) else {"coordinates": " ".join(study.leaves.names)}
    group.update_attributes({**TITLE, **coordinates, BEGUN: state})


def _plain(attributes: dict[str, Any]) -> dict[str, Any]:
    """As JSON has them."""
    return json.loads(json.dumps(attributes, default=lambda value: value.tolist()))
