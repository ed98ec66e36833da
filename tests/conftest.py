"""What holds for every test: float64, no silent broadcasting of ranks, programs compiled once and kept.

Warnings are errors and the annotations of arrays are checked (see pyproject.toml). The package is not imported here:
the checks of the annotations are put in place after this file is read.
"""

import gc
import itertools
import os
from pathlib import Path

import jax
import pytest
from jaxlib.version import __version_info__ as jaxlib_version

ROOT = Path(__file__).resolve().parent.parent

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_rank_promotion", "raise")
# Compiling is most of the time of a run: done as for the commands (see softgrip_jax/commands/programs.py), and what has
# not changed is taken from here.
gc.set_threshold(1_000_000)
# LLVM's optimisation is much of that time, and saves a program that runs a few times nothing; the commands do without
# it, too. `make test-all` and `make check` go through the optimised programs.
unoptimised = os.environ.setdefault("JAX_DISABLE_MOST_OPTIMIZATIONS", "1") not in ("0", "false")
jax.config.update("jax_disable_most_optimizations", unoptimised)
# Places in Python's sources travel through XLA with every operation, for messages that nobody reads.
jax.config.update("jax_traceback_in_locations_limit", 0)
if jaxlib_version < (0, 11):
    # Both processors have a worker already: a program in parts, side by side, only takes longer.
    flags = "--xla_cpu_use_fusion_emitters=false --xla_cpu_parallel_codegen_split_count=1"
    flags += " --xla_cpu_opt_preset=CPU_OPT_PRESET_FAST_COMPILE" if unoptimised else ""
    os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} {flags}"
jax.config.update("jax_compilation_cache_dir", str(ROOT / ".pytest_cache" / "jax"))
# Small ones, too: every worker, and every module whose programs were let go, would compile them again.
jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
# Commands that tests run as processes of their own share it.
os.environ["JAX_COMPILATION_CACHE_DIR"] = str(ROOT / ".pytest_cache" / "jax")


LONGEST = [
    "energy",
    "docstrings",
    "study",
    "calibrate",
    "rules",
    "arcs",
    "search",
    "verify",
    "plots",
    "measure",
    "cell",
    "docs",
    "design_rules",
    "plan",
    "finger_values",
    "robust",
    "connected",
    "solvers",
    "expected",
    "islands",
    "extending",
    "posterior",
    "batch",
    "tension",
    "run",
    "calibrate_run",
    "chamber",
    "sensitivity",
    "limits",
    "nearby",
    "shell_scipy",
    "continuation",
    "cluster",
    "cli_path",
    "cad",
    "problem",
    "drives",
    "finger_derivatives",
    "reproduce",
    "shooting",
    "explorer_tabs",
    "space",
    "pareto",
    "batches",
    "finger_reasons",
    "hard_cases",
    "small_problems",
    "fold",
    "beam",
    "finger_ends",
    "explorer_browser",
    "explorer",
    "programs",
    "minimise",
    "bad_input",
]
"""Modules that take more than some twenty seconds of a processor, the longest first."""


SISTERS = {
    "batch": [
        "test_every_lane_is_solved_or_honestly_labelled[offset]",
        "test_every_lane_is_solved_or_honestly_labelled[flat]",
        "test_random_materials_find_the_first_crossing[gent]",
        "test_random_materials_find_the_first_crossing[mooney]",
        "test_random_materials_find_the_first_crossing[yeoh]",
        "test_every_lane_is_solved_or_honestly_labelled[inclined]",
        "test_vmap_is_the_loop[inclined-gent]",
        "test_vmap_is_the_loop[offset-ogden]",
        "test_vmap_is_the_loop[cylinder-mooney]",
        "test_vmap_is_the_loop[grasp-rim]",
        "test_vmap_is_the_loop[free-energy]",
    ],
    "beam": [
        "test_held_tip_matches_scipy_at_random_fingers[inextensible]",
        "test_held_tip_matches_scipy_at_random_fingers[exact]",
    ],
    "chamber": [
        "test_any_strain_energy[MooneyRivlin]",
        "test_any_strain_energy[Gent]",
        "test_any_strain_energy[Yeoh]",
    ],
    "connected": [
        "test_a_limit_that_a_locking_material_does_not_set_keeps_its_slope[offset]",
        "test_what_is_touched_only_beyond_the_free_limit_is_never_touched[inclined]",
    ],
    "ctrl_c": [
        "test_ctrl_c_while_xla_compiles[design]",
        "test_ctrl_c_while_xla_compiles[path]",
    ],
    "derivatives": [
        "test_forward_reverse_and_differences_agree[offset-ogden]",
        "test_forward_reverse_and_differences_agree[flat-yeoh]",
        "test_forward_reverse_and_differences_agree[inclined-parallel]",
        "test_forward_reverse_and_differences_agree[grasp-table]",
    ],
    "docs": [
        "test_python_of_the_page[docs/guides/design.md]",
        "test_python_of_the_page[docs/guides/solvers.md]",
        "test_python_of_the_page[docs/guides/explore.md]",
        "test_python_of_the_page[docs/guides/pareto.md]",
        "test_python_of_the_page[docs/guides/sweep.md]",
        "test_python_of_the_page[docs/guides/calibrate.md]",
        "test_python_of_the_page[docs/guides/sensitivity.md]",
    ],
    "energy": [
        "test_the_expanded_energy_has_the_derivatives_that_jax_finds[False]",
    ],
    "explorer_browser": [
        "test_words_have_contrast[Study]",
        "test_words_have_contrast[Pins]",
        "test_words_have_contrast[Calibrate]",
    ],
    "finger_ends": [
        "test_the_limit_is_where_the_model_ends[rolled up]",
    ],
    "finger_values": [
        "test_blocked_force_of_type_a[inextensible-0.127148-1.08029]",
        "test_blocked_force_of_type_a[exact-0.126622-1.08341]",
    ],
    "limits": [
        "test_limit_pressure_and_its_neighbourhood[cylinder-mooney]",
        "test_limit_pressure_and_its_neighbourhood[cylinder-ogden]",
        "test_limit_pressure_and_its_neighbourhood[cylinder-yeoh]",
        "test_limit_pressure_and_its_neighbourhood[cylinder-gent]",
    ],
    "nearby": [
        "test_the_state_next_door_is_the_one_along_the_whole_way[required]",
    ],
}
"""Slow, too: other cases of the same test are in `make test`, these in `make test-all` alone."""


def pytest_collection_modifyitems(items):
    """A worker that takes the longest module last would work on alone."""
    place = {f"test_{name}": k for k, name in enumerate(LONGEST)}
    items.sort(key=lambda item: place.get(item.path.stem, len(place)))
    for item in items:
        if item.name in SISTERS.get(item.path.stem.removeprefix("test_"), ()):
            item.add_marker(pytest.mark.slow)


@pytest.fixture(autouse=True)
def environment_stays():
    """A page of the docs sets flags of XLA; the commands that a later test starts would compile with those."""
    before = dict(os.environ)
    yield
    for name in os.environ.keys() - before.keys():
        del os.environ[name]
    os.environ.update(before)


MAPPINGS, PAGES = 30_000, 2 * 2**30 // os.sysconf("SC_PAGE_SIZE")
"""A program takes some twenty memory mappings, of which Linux gives a process 65,530: then compiling crashes. And a
worker should do with 4 GB."""


LOOK_EVERY = 8
"""Tests between two looks at the mappings: a look takes up to 20 ms."""
ended = itertools.count(1)


def are_many() -> bool:
    """Whether this process has more mappings than it should; False where the system does not tell."""
    maps = Path("/proc/self/maps")
    return maps.exists() and maps.read_bytes().count(b"\n") > MAPPINGS


def let_go() -> None:
    """Forget every program."""
    jax.clear_caches()
    gc.collect()


@pytest.fixture(autouse=True)
def many_programs_are_let_go():
    """Within a module, too: the hard cases by every method and solver are more than a process can hold."""
    yield
    if next(ended) % LOOK_EVERY == 0 and are_many():
        let_go()


@pytest.fixture(autouse=True, scope="module")
def programs_are_let_go():
    """Those of a module may serve the next one; where they have become many, all are let go."""
    yield
    size = Path("/proc/self/statm")
    if not size.exists() or int(size.read_text().split()[1]) > PAGES or are_many():
        let_go()
