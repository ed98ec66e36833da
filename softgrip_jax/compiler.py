"""With which of XLA's options a program is compiled: how often it will run decides."""

from __future__ import annotations

import functools
from typing import Any

SIDE_BY_SIDE = {"xla_cpu_parallel_codegen_split_count": 4}
"""For a program that runs often: all optimisation, on several cores."""
QUICKLY = SIDE_BY_SIDE | {"xla_backend_optimization_level": 0}
"""For a program that runs once: LLVM's optimisation takes a third of its compile time or more, and saves a finger less
than a millisecond, an energy membrane 20."""
CALLED = {"xla_cpu_opt_preset": "CPU_OPT_PRESET_FAST_COMPILE"}
"""Functions that are called from many places are simplified once and put in their places at the end."""
MANY_CALLS = QUICKLY | CALLED
"""For one that calls the same functions from many places: a shell's search compiles in two thirds of the time (jaxlib
0.10.1)."""
IN_TURN = SIDE_BY_SIDE | CALLED
"""For a study of what is solved one after the other, energy membranes: it compiles in two thirds of the time and runs
as fast, where QUICKLY would have it run five times as long (jaxlib 0.10.1)."""


def known_options(options: dict[str, Any] | None) -> dict[str, Any] | None:
    """The options where XLA knows them all, on a CPU; None elsewhere."""
    import jax

    wanted = options and jax.default_backend() == "cpu" and _are_known(tuple(options.items()))
    return options if wanted else None


@functools.cache
def _are_known(options: tuple[tuple[str, Any], ...]) -> bool:
    """What XLA does not know it refuses: a program of one number tells, in some hundredths of a second. Versions have
    other options, so that a list of them would have to be kept."""
    import jax

    try:
        jax.jit(lambda: 0.0, compiler_options=dict(options)).lower().compile()
    except jax.errors.JaxRuntimeError:
        return False
    return True
