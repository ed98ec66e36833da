"""What JAX traces and compiles for a command is kept for the next one."""

from __future__ import annotations

import contextlib
import gc
import hashlib
import os
import pickle
import sys
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

from ..cache import FOLDER, LEAST_SECONDS, silence, user_folder
from ..compiler import QUICKLY, known_options
from ..folders import write_whole

PACKAGE = Path(__file__).resolve().parent.parent
OLDER_LOOPS = "--xla_cpu_use_fusion_emitters"
"""XLA's newer way of writing loops takes more than half of the time in which a finger compiles, and saves a single
solve nothing. XLA leaves the process over a flag that it does not know."""
LOOPS_BELOW = (0, 11)
"""The first version of jaxlib that does not know the flag, and has the newer way alone."""
BLAS_THREADS = 1
"""Of OpenBLAS, with which SciPy's LAPACK inverts the Jacobians of fingers one by one: two threads that share 40
unknowns wait for each other. Where another program has one of the processors that takes a hundred times as long."""
COLLECTED = 1_000_000
"""Objects between two looks for what nobody holds any more: while JAX is imported and traces nearly all of them are
kept, and with Python's 700 looking takes a sixth of the first answer."""

WAITED = "/softgrip_jax/waited_for_a_program"
"""What JAX's monitoring hears of the seconds in which nothing was done but to wait for the compiler."""

_folder: Path | None = None
"""Where programs are kept; nowhere unless this process is a command."""


def settings() -> None:
    """For Python, XLA and JAX in this process, before JAX is imported; what the user has set for those stays."""
    global _folder
    gc.set_threshold(COLLECTED)
    _folder = user_folder()
    os.environ.setdefault(FOLDER, str(_folder))
    os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", str(LEAST_SECONDS))
    os.environ.setdefault("OPENBLAS_NUM_THREADS", str(BLAS_THREADS))
    # Places in Python's sources would travel through XLA with every operation: a twentieth of its time.
    os.environ.setdefault("JAX_TRACEBACK_IN_LOCATIONS_LIMIT", "0")
    silence()
    from jaxlib.version import __version_info__ as version

    flags = os.environ.get("XLA_FLAGS", "")
    if OLDER_LOOPS not in flags and version < LOOPS_BELOW:
        os.environ["XLA_FLAGS"] = f"{flags} {OLDER_LOOPS}=false".strip()


def is_used() -> bool:
    """Whether this process keeps programs, as commands do: others compile with other options."""
    return _folder is not None


def kept(function: Callable[..., Any], *args: Any) -> Any:
    """function(*args), jitted, without tracing it where an earlier process did, for arguments of the same shapes."""
    return program(function, *args, options=QUICKLY)(*args)


def program(
    function: Callable[..., Any], *args: Any, about: str = "", options: dict[str, Any] | None = None
) -> Callable[..., Any]:
    """A jitted function, for arguments of the shapes of args, without tracing it where an earlier process did.

    What JAX exports is kept beside its own cache, for the versions and the sources as they are. What cannot be read or
    written is traced as if nobody had kept it.

    What was exported has the shapes of its answer, `shapes`. It is compiled, or read, on a thread of its own, and
    waited for when it is called: whoever asks for several programs before he calls one has the next ones traced
    meanwhile.

    about: what the function holds beside its arguments, in words that are different where that is. options: see
    `compiler`.
    """
    import jax
    import numpy as np
    from jax import export

    if _folder is None or not jax.config.values["jax_enable_compilation_cache"]:
        return function
    leaves, tree = jax.tree.flatten(args)
    numbers = [k for k, leaf in enumerate(leaves) if not isinstance(leaf, str)]
    words = [leaf for leaf in leaves if isinstance(leaf, str)]
    # Not `jnp.asarray`, which compiles a program for every shape.
    arrays = [jax.device_put(leaves[k]) for k in numbers]
    file = _folder / f"{_key(function, tree, arrays, [*words, about])}.traced"
    try:
        content, template = pickle.loads(file.read_bytes())
        exported, out = export.deserialize(bytearray(content)), jax.tree.structure(template)
    except Exception:  # whatever is wrong with it
        trees = []

        def of_arrays(*arrays):
            given = dict(zip(numbers, arrays, strict=True))
            every = [given.get(k, leaf) for k, leaf in enumerate(leaves)]
            found, out = jax.tree.flatten(function(*jax.tree.unflatten(tree, every)))
            trees.append(out)
            return found

        with jax.sharding.use_abstract_mesh(jax.sharding.get_abstract_mesh()):  # see numerics.xla.traced_once
            exported = export.export(jax.jit(of_arrays))(*arrays)
        out = trees[0]
        # A tree of our own classes cannot be pickled, what has its structure can.
        template = jax.tree.unflatten(out, [0] * out.num_leaves)
        with contextlib.suppress(Exception):
            content = pickle.dumps((bytes(exported.serialize()), template))
            file.parent.mkdir(parents=True, exist_ok=True)
            write_whole(file, content)
    in_jax = jax.jit(exported.call, compiler_options=known_options(options))
    compiled = ThreadPoolExecutor(1).submit(lambda: in_jax.lower(*arrays).compile())

    def run(*args):
        called = _waited_for(compiled)
        given = jax.tree.leaves(args)
        # JAX takes NumPy's arrays as they are, in a tenth of the time; a bare number it would take for another type.
        of_numpy = [given[k] if isinstance(given[k], np.ndarray) else jax.device_put(given[k]) for k in numbers]
        return jax.tree.unflatten(out, called(*of_numpy))

    run.shapes = jax.tree.unflatten(out, exported.out_avals)  # type: ignore[attr-defined]
    return run


def _waited_for(found: Future[Any]) -> Any:
    """Its result; JAX's monitoring hears how long that took."""
    if not found.done():
        from jax import monitoring

        begin = time.perf_counter()
        found.exception()
        monitoring.record_event_duration_secs(WAITED, time.perf_counter() - begin)
    return found.result()


KNOWN_BY_VERSION = ("builtins", "jax", "jaxlib", "equinox", "optax", "numpy")
"""Whose classes are as their versions say."""


def files_of(tree: Any, *modules: str) -> list[tuple[str, int, int]]:
    """(path, size, time) of every file that the classes of a tree's structure, and modules by name, are made of: this
    package, and the package or the file of whoever wrote a class of his own."""
    inside, left = set(), [tree]
    while left:
        node = left.pop()
        left += node.children()
        if node.node_data() is not None:
            inside.add(node.node_data()[0].__module__)
    tops = {name.partition(".")[0] for name in (*inside, *modules)}.difference(KNOWN_BY_VERSION)
    files = set(PACKAGE.rglob("*.npz"))
    for top in tops | {__name__.partition(".")[0]}:
        file = Path(getattr(sys.modules.get(top), "__file__", None) or "")
        files |= set(file.parent.rglob("*.py")) if file.name == "__init__.py" else {file} if file.is_file() else set()
    return sorted((str(file), file.stat().st_size, file.stat().st_mtime_ns) for file in files)


def _key(function: Callable[..., Any], tree: Any, arrays: Any, words: list[str]) -> str:
    """What a program depends on, in one word."""
    import jax
    from jaxlib.version import __version__ as jaxlib_version

    shapes = [(a.shape, str(a.dtype), a.weak_type) for a in arrays]
    parts = (
        *(function.__module__, function.__qualname__, str(tree), shapes, words, files_of(tree, function.__module__)),
        *(jax.__version__, jaxlib_version, jax.default_backend(), jax.config.read("jax_enable_x64")),
    )
    return hashlib.sha256(repr(parts).encode()).hexdigest()
