"""Ctrl-C while a command compiles: exit code 130, one line, no crash, nothing half written."""

import os
import random
import signal
import subprocess
import sys
import time

import pytest
from conftest import ROOT

from softgrip_jax.folders import DeferInterrupt

# A shell's job in the background begins with Ctrl-C ignored.
START = """
import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)
sys.argv[0] = "softgrip"
from softgrip_jax.cli import main
print("Finished importing", file=sys.stderr, flush=True)
main()
"""

SECONDS = 120
"""Until a command must have come to what it is stopped in, and again until it must have ended."""

# A command, and the program that takes it longest to compile. JAX logs the names of programs where it is told to.
COMMANDS = {
    "solve": (["configs/shell_cylinder.toml"], "call"),
    "path": (["configs/shell_cylinder.toml", "--to-kPa", "12", "--csv", "OUT.csv", "--plot", "OUT.png"], "_path"),
    "design": (["SEARCH", "--out", "OUT"], "call"),
    "sensitivity": (["configs/shell_free.toml", "--out", "OUT"], "measure"),
}

SEARCH = """
[design]
[[design.goals]]
maximise = "inflation_mm"
at = { pressure_kPa = 10 }
[[design.variables]]
name = "shell.t_m_mm"
low = 1
high = 2
"""


def stopped(tmp_path, command, said, wait=0.0):
    """(exit code, stderr without what JAX logs) of a command that gets Ctrl-C `wait` seconds after JAX said that."""
    (tmp_path / "search.toml").write_text((ROOT / "configs" / "shell_free.toml").read_text() + SEARCH)
    places = {"SEARCH": tmp_path / "search.toml", "OUT": tmp_path / "out"}
    arguments = [str(places.get(word, word)).replace("OUT.", f"{tmp_path}/out.") for word in COMMANDS[command][0]]
    environment = os.environ | {"XDG_CACHE_HOME": str(tmp_path / "cache"), "JAX_LOG_COMPILES": "1"}
    environment.pop("JAX_COMPILATION_CACHE_DIR", None)
    log = tmp_path / "err.txt"
    with log.open("w") as err:
        process = subprocess.Popen(
            [sys.executable, "-c", START, command, *arguments],
            cwd=ROOT,
            env=environment,
            stdout=subprocess.DEVNULL,
            stderr=err,
        )
    deadline = time.monotonic() + SECONDS
    try:
        while said not in log.read_text():
            assert process.poll() is None, log.read_text()
            assert time.monotonic() < deadline
            time.sleep(0.01)
        time.sleep(wait)
        process.send_signal(signal.SIGINT)
        code = process.wait(SECONDS)
    finally:
        process.kill()
    lines = log.read_text().splitlines()
    return code, [line for line in lines if not line.startswith(("WARNING:", "Finished ", "Compiling ", "  "))]


def check(tmp_path, command, said, wait=0.0, may_have_ended=False):
    """Whether it was stopped; one that may have ended by itself before may have written files, whole ones."""
    code, lines = stopped(tmp_path, command, said, wait)
    assert (code, lines) == (130, ["stopped."]) or (may_have_ended and (code, lines) == (0, []))
    written = {path.name for path in tmp_path.iterdir()} - {"cache", "err.txt", "search.toml"}
    if not may_have_ended:
        assert not written
    elif code == 0:
        assert written == {word.lower() for word in COMMANDS[command][0] if word.startswith("OUT")}
    else:
        assert written <= {"out.csv"}, "of several files the first may be there"
    if "out.csv" in written:
        lengths = [line.count(",") for line in (tmp_path / "out.csv").read_text().splitlines()]
        assert len(set(lengths)) == 1 < len(lengths)
    return code == 130


@pytest.mark.parametrize("command", COMMANDS)
def test_ctrl_c_while_xla_compiles(command, tmp_path):
    """Of all moments the one that ended in a segmentation fault."""
    check(tmp_path, command, f"Finished jaxpr to MLIR module conversion jit({COMMANDS[command][1]})", 0.2)


@pytest.mark.slow
@pytest.mark.parametrize("command", COMMANDS)
def test_ctrl_c_at_any_moment_of_the_first_seconds(command, tmp_path):
    drawn = random.Random(0)
    early = []
    for attempt in range(6):
        folder = tmp_path / str(attempt)
        folder.mkdir()
        early.append(check(folder, command, "Finished importing", drawn.uniform(0.0, 2.5), may_have_ended=True))
    assert any(early)


def test_a_job_in_the_background_writes_on():
    """It begins with Ctrl-C ignored, and the first one, and the second, are nothing to it while it writes either."""
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with DeferInterrupt() as writing:
            signal.raise_signal(signal.SIGINT)
            signal.raise_signal(signal.SIGINT)
        assert not writing.asked
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)
