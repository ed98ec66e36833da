"""What holds for every test: float64, no silent broadcasting of ranks, programs compiled once and kept.

Warnings are errors and the annotations of arrays are checked (see pyproject.toml). The package is not imported here:
the checks of the annotations are put in place after this file is read.
"""

import gc
import os
from pathlib import Path

import jax
import pytest
from jaxlib.version import __version_info__ as jaxlib_version

ROOT = Path(__file__).resolve().parent.parent

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_rank_promotion", "raise")
# Compiling is most of the time of a run: done as for the commands (see softgrip_jax/cli/programs.py), and what has not
# changed is taken from here.
gc.set_threshold(1_000_000)
if jaxlib_version < (0, 11):
    os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} --xla_cpu_use_fusion_emitters=false"
jax.config.update("jax_compilation_cache_dir", str(ROOT / ".pytest_cache" / "jax"))
jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.3)


@pytest.fixture(autouse=True, scope="module")
def programs_are_let_go():
    """A program takes some twenty memory mappings, of which Linux gives a process 65,530: then compiling crashes."""
    yield
    jax.clear_caches()
