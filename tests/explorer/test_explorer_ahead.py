"""The process that compiles beside the explorer: what it leaves, and what happens where it cannot."""

import os
import subprocess
import sys
import textwrap

import pytest
from conftest import ROOT

from softgrip_jax.explorer.ahead import Ahead


def roots(numbers):
    return numbers**0.5


@pytest.fixture
def ahead():
    made = Ahead()
    yield made
    made.end()


def test_what_cannot_travel_is_compiled_here(ahead):
    assert ahead.compiled(roots, (lambda: None,), {}).result(10) is False
    assert ahead._process is None


def test_a_process_that_has_ended_says_so_and_another_one_begins(ahead):
    """Killed before it answers: the explorer is told to compile by itself, and not left waiting."""
    waiting = ahead.compiled(roots, (1.0,), {})
    first = ahead._process
    first.kill()
    assert waiting.result(20) is False
    ahead.compiled(roots, (2.0,), {})
    assert ahead._process is not first
    assert len(ahead._asked) == 1


@pytest.mark.slow
def test_a_program_is_read_and_one_that_runs_long_is_compiled_again(tmp_path):
    """In a process like that of `softgrip explore`, from an empty folder of programs: the curve comes from the process
    beside it (XLA compiles nothing large here), answers are those of the library, and the improved program is used."""
    code = textwrap.dedent("""
        from softgrip_jax.commands import programs as kept
        kept.settings()
        import jax, numpy as np, time
        import softgrip_jax as sg
        from softgrip_jax.explorer import answers
        from softgrip_jax.explorer.ahead import Ahead
        from softgrip_jax.units import kPa, mm

        shell = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
        scene = sg.shell.FlatContact(shell, distance=5 * mm)
        answers.LONG = 0.0
        own = answers.programs
        own.ahead = Ahead()
        hits, misses = [], []
        jax.monitoring.register_event_listener(
            lambda name, **more: hits.append(name) if name.endswith("cache_hits") else
            misses.append(name) if name.endswith("cache_misses") else None)
        state = answers.state_of(scene, 12 * kPa, {})
        begun = len(misses)
        curve = answers.curve_of(scene, "force")
        assert len(misses) == begun and hits, (hits, misses)
        np.testing.assert_allclose(curve.limit, sg.limit_pressure(scene), rtol=1e-12)
        assert np.all(np.diff(curve.pressure[curve.stable]) > 0)
        helps = answers.helps_of(scene, state, "force", ["shell.a_mm"], [0])
        slope = jax.grad(lambda a: sg.solve(sg.shell.FlatContact(sg.FlatShell(a=a, b=43 * mm, t_m=1.1 * mm,
            material=sg.NeoHookean(mu=175 * kPa)), distance=5 * mm), 12 * kPa).force)(16 * mm)
        asked = sg.solve(scene, 12 * kPa).force
        name = next(k for k in jax.tree.leaves(scene))
        assert float(name) == 16 * mm
        np.testing.assert_allclose(dict(helps.bars)["shell.a_mm"], slope * 16 * mm / asked, rtol=1e-8)
        question = answers.asked_of(scene, 12 * kPa, {})
        quick = own.traced(*question)
        own.improve(*question)
        for _ in range(600):
            if own.traced(*question) is not quick:
                break
            time.sleep(0.1)
        assert own.traced(*question) is not quick
        again = answers.state_of(scene, 12 * kPa, {})
        np.testing.assert_allclose(again.solution.force, state.solution.force, rtol=1e-12)
        own.ahead.end()
        print("good")
    """)
    environment = {k: v for k, v in os.environ.items() if k not in ("XLA_FLAGS", "JAX_COMPILATION_CACHE_DIR")}
    environment |= {"XDG_CACHE_HOME": str(tmp_path)}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, timeout=300)
    assert done.stdout.strip() == "good", done.stderr[-3000:]


def test_what_draws_a_state_is_compiled_beside_it(tmp_path):
    """As a command: once a state of zeros has been drawn, drawing the first state compiles nothing more."""
    code = textwrap.dedent("""
        from softgrip_jax.commands import programs
        programs.settings()
        import jax, softgrip_jax as sg
        from softgrip_jax.explorer import answers
        from softgrip_jax.units import kPa, mm

        shell = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
        asked = sg.shell.FlatContact(shell, distance=5 * mm), 15 * kPa, {}
        answers.prepare_drawing(*asked)
        state = answers.programs(*answers.asked_of(*asked))
        compiled = []
        jax.monitoring.register_event_duration_secs_listener(
            lambda event, duration, **more: compiled.append(event) if "backend_compile" in event else None
        )
        assert len(answers.sections(state)) == 2
        print("good" if compiled == [] else compiled)
    """)
    environment = {k: v for k, v in os.environ.items() if k not in ("XLA_FLAGS", "JAX_COMPILATION_CACHE_DIR")}
    environment |= {"XDG_CACHE_HOME": str(tmp_path)}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, timeout=300)
    assert done.stdout.strip() == "good", done.stdout + done.stderr[-3000:]


@pytest.mark.parametrize(("cores", "own", "threads"), [(2, None, "8"), (16, None, "16"), (2, "3", "3")])
def test_the_command_gives_xla_threads_to_spare(cores, own, threads, monkeypatch):
    """Two batches of linear systems at once waited for each other for ever in the two threads of two processors."""
    from softgrip_jax.commands.explore import run_explore
    from softgrip_jax.explorer import front

    monkeypatch.delenv("PJRT_NPROC", raising=False)
    if own is not None:
        monkeypatch.setenv("PJRT_NPROC", own)
    monkeypatch.setattr(os, "cpu_count", lambda: cores)
    monkeypatch.setattr(front, "serve", lambda *args: None)
    run_explore(ROOT / "configs" / "finger_tip_contact.toml", None, "localhost", 0, False)
    assert os.environ["PJRT_NPROC"] == threads
