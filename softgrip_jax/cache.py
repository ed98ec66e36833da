"""What JAX compiles is kept on the disk, so that the next process does not compile it again.

The commands do this by themselves (`softgrip_jax.commands.programs`); in Python it is one line, before the first
question:

>>> import softgrip_jax as sg
>>> folder = sg.enable_cache()
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

FOLDER = "JAX_COMPILATION_CACHE_DIR"
"""The variable by which JAX itself is told where to keep programs."""

LEAST_SECONDS = 0.2
"""A program that compiles in less is not kept: to read it would save nothing."""


def user_folder() -> Path:
    """Where programs are kept: the folder that JAX is told of, else softgrip_jax in the user's folder of caches."""
    own = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "softgrip_jax"
    return Path(os.environ.get(FOLDER) or own)


LOG_LEVEL = "TF_CPP_MIN_LOG_LEVEL"
"""The variable by which XLA, when it is loaded, is told what to print."""

JAXS_OWN = "1"
"""What JAX sets it to where nobody has: errors, and not warnings."""


def silence() -> None:
    """No lines of XLA on stderr about programs that it takes from the cache, unless the user has asked for them.

    XLA calls two of its own settings (prefer-no-gather, prefer-no-scatter) CPU features that the machine lacks, in
    long lines for every such program; nothing is wrong.
    """
    there = "jax" in sys.modules
    if os.environ.get(LOG_LEVEL) not in ([None, JAXS_OWN] if there else [None]):
        return
    os.environ[LOG_LEVEL] = "3"
    if there:
        # XLA has read the variable already. JAX's own level sets that of XLA too, and setting it back leaves XLA's
        # alone, unless the user has chosen one.
        config = sys.modules["jax"].config
        before = config.values["jax_logging_level"]
        config.update("jax_logging_level", "CRITICAL")
        config.update("jax_logging_level", before or "NOTSET")


def enable_cache(folder: str | Path | None = None) -> Path:
    """Keep what JAX compiles in this process, and take from there what an earlier one has compiled.

    The first process pays for compiling as before; a later one that asks the same question of scenes of the same types
    and shapes only reads. It holds for everything that JAX compiles in this process, and for programs that take
    0.2 s or longer to compile. Nothing is ever removed from the folder; delete it whenever you like.

    Args:
        folder: where to keep programs; it need not exist. Without it, the one of JAX_COMPILATION_CACHE_DIR, else
            softgrip_jax in $XDG_CACHE_HOME or ~/.cache, which the commands use too.

    Returns:
        The folder.

    Examples:
        >>> import subprocess, sys  # a process of its own, for the cache is the whole process's
        >>> program = "import softgrip_jax as sg; print(sg.enable_cache('programs'))"
        >>> print(subprocess.run([sys.executable, "-c", program], capture_output=True, text=True).stdout.strip())
        programs
    """
    silence()
    import jax
    from jax.experimental.compilation_cache import compilation_cache

    place = user_folder() if folder is None else Path(folder).expanduser()
    jax.config.update("jax_enable_compilation_cache", True)
    jax.config.update("jax_compilation_cache_dir", str(place))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", LEAST_SECONDS)
    # JAX looks once, when it first compiles anything, whether there is a cache: what was decided then is forgotten.
    compilation_cache.reset_cache()
    return place
