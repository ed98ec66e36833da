"""A study in a folder: it may be stopped at any moment, even killed, and goes on where it was.

manifest.json says what is being run; chunks/000012.npz holds one chunk and appears complete or not at all; study.nc
and study.csv are written from the chunks when all are there, and the chunks are then removed. A chunk is computed by
one program from its own rows alone, so a study in two parts equals one that was never stopped, bit for bit. A chunk
that cannot be read any more is computed again.
"""

from __future__ import annotations

import csv
import hashlib
import json
import platform
import shutil
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import numpy as np
import xarray as xr

from .._version import __version__
from ..errors import ConfigError
from ..folders import write_whole
from .dataset import csv_rows, labelled
from .study import Study

MANIFEST, RESULT, TABLE, CHUNKS = "manifest.json", "study.nc", "study.csv", "chunks"

Report = Callable[[int, int], None]


def load_study(folder: str | Path) -> xr.Dataset:
    """The result of `softgrip sweep` or `run_in`, opened lazily: what is not looked at stays on the disk.

    Args:
        folder: of the study.

    Returns:
        An xarray Dataset in SI.

    Raises:
        ConfigError: where there is no finished study.

    Examples:
        >>> sg.load_study("nowhere")
        Traceback (most recent call last):
        softgrip_jax.errors.ConfigError: nowhere cannot be opened: there is no study.nc in it.
    """
    path = Path(folder) / RESULT
    if not path.is_file():
        started = (Path(folder) / MANIFEST).is_file()
        words = (
            "its study is not finished; run it again with the same --out" if started else f"there is no {RESULT} in it"
        )
        raise ConfigError(f"{folder} cannot be opened: {words}.")
    return xr.open_dataset(path, engine="h5netcdf")


def run_in(
    folder: Path,
    study: Study,
    identity: str,
    report: Report = lambda done, skipped: None,
    remark: Callable[[str], None] = lambda sentence: None,
) -> None:
    """Run a study in a folder; where the folder holds a part of it already, go on from there.

    Args:
        folder: made where it does not exist.
        study: what to run.
        identity: what tells this study from others, the text of its config for instance: a folder that was begun with
            another one, by another version or on another kind of machine is refused.
        report: called with (designs done, designs that were found done) at the start and after every chunk.
        remark: called with a sentence where chunks that were found cannot be read, and are computed again.

    Raises:
        ConfigError: where the folder holds something else.

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
    begun = _manifest(study, identity)
    previous = _read_manifest(folder)
    if previous is None:
        (folder / CHUNKS).mkdir(parents=True, exist_ok=True)
        write_whole(folder / MANIFEST, json.dumps(begun | {"finished": False}, indent=2).encode())
    elif {k: v for k, v in previous.items() if k != "finished"} != begun:
        differing = ", ".join(k for k in begun if previous.get(k) != begun[k])
        raise ConfigError(f"{folder} holds another study (different: {differing}); give --out a new name.")
    elif previous["finished"]:
        shutil.rmtree(folder / CHUNKS, ignore_errors=True)
        report(study.designs.count, study.designs.count)
        return
    (folder / CHUNKS).mkdir(exist_ok=True)
    there = [k for k in range(study.chunks) if _chunk_path(folder, k).is_file()]
    done = [k for k in there if _is_whole(folder, k, study)]
    lost = [_chunk_path(folder, k) for k in there if k not in set(done)]
    if lost:
        others = f" and {len(lost) - 1} more" if lost[1:] else ""
        remark(f"{lost[0]}{others} cannot be read, of {len(there)} that were there; the designs are computed again.")
    skipped = sum(len(study.rows(k)) for k in done)
    report(skipped, skipped)
    finished = skipped
    for k, part in study.parts(skip=done):
        write_whole(_chunk_path(folder, k), lambda path, part=part: np.savez(path, **part))
        finished += len(part["values"])
        report(finished, skipped)
    _collect(folder, study)
    write_whole(folder / MANIFEST, json.dumps(begun | {"finished": True}, indent=2).encode())
    shutil.rmtree(folder / CHUNKS)


def _manifest(study: Study, identity: str) -> dict[str, Any]:
    return {
        "designs": study.designs.count,
        "designs_per_chunk": study.chunk,
        "chunks": study.chunks,
        "config": hashlib.sha256(identity.encode()).hexdigest(),
        "softgrip_jax": __version__,
        "jax": jax.__version__,
        "numpy": np.__version__,
        "device": f"{jax.devices()[0].device_kind} {platform.machine()}",
    }


def _read_manifest(folder: Path) -> dict[str, Any] | None:
    try:
        return json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
    except FileNotFoundError:
        if folder.exists() and any(path.name != CHUNKS and not path.name.startswith(".") for path in folder.iterdir()):
            raise ConfigError(f"{folder} exists already and holds no study; give --out a new name.") from None
        return None
    except (json.JSONDecodeError, UnicodeDecodeError):
        raise ConfigError(f"{folder / MANIFEST} is not readable; give --out a new name.") from None


def _chunk_path(folder: Path, k: int) -> Path:
    return folder / CHUNKS / f"{k:06d}.npz"


def _chunk(folder: Path, k: int) -> dict[str, np.ndarray]:
    # NumPy leaves a file open that it cannot read, where it has opened it itself.
    with _chunk_path(folder, k).open("rb") as file, np.load(file) as arrays:
        return dict(arrays)


def _is_whole(folder: Path, k: int, study: Study) -> bool:
    """Whether a chunk holds what it was written with: its checksums are right, and it has every number of its rows."""
    try:
        chunk = _chunk(folder, k)
    except (zipfile.BadZipFile, zlib.error, ValueError, KeyError, EOFError, NotImplementedError):
        return False
    shapes = study.shapes(len(study.rows(k)))
    return all(name in chunk and chunk[name].shape == shape for name, shape in shapes.items())


def _collect(folder: Path, study: Study) -> None:
    """study.csv and study.nc from all chunks, with one chunk and one column in memory at a time."""
    count, first = study.designs.count, _chunk(folder, 0)
    like = first | {"designs": study.rows(0)}
    # Files in place of arrays: the system keeps of them in memory what there is room for.
    whole = {
        name: np.lib.format.open_memmap(folder / CHUNKS / f"all_{name}.npy", "w+", part.dtype, (count, *part.shape[1:]))
        for name, part in like.items()
    }

    def write_table(path: Path) -> None:
        with path.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            for k in range(study.chunks):
                rows, part = study.rows(k), _chunk(folder, k)
                for name, values in (part | {"designs": rows}).items():
                    whole[name][k * study.chunk : k * study.chunk + len(rows)] = values
                names, lines = csv_rows(study, rows, part)
                writer.writerows([names, *lines] if k == 0 else lines)

    write_whole(folder / TABLE, write_table)
    data = labelled(study, whole.pop("designs"), whole)
    write_whole(folder / RESULT, lambda path: data.to_netcdf(path, engine="h5netcdf"))
