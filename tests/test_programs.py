"""What a command keeps of what it traced: the same answer the second time, whatever has become of the file."""

import json
import os
import subprocess
import sys

import pytest
from conftest import ROOT

CODE = """
import sys
from softgrip_jax.cli import main, programs, scenes
import softgrip_jax.shell.flat as flat
if "known" in sys.argv:
    sys.argv.remove("known")
    def traced(*args):
        raise AssertionError("traced again")
    flat.FlatContact.observe = traced
main()
"""


def test_the_second_run_does_not_trace(tmp_path):
    environment = os.environ | {"XDG_CACHE_HOME": str(tmp_path)}
    environment.pop("JAX_COMPILATION_CACHE_DIR", None)

    def answer(pressure: str, *words: str) -> dict:
        command = [sys.executable, "-c", CODE, "solve", "configs/shell_flat.toml", "--json", "--pressure-kPa", pressure]
        done = subprocess.run([*command, *words], capture_output=True, text=True, cwd=ROOT, env=environment)
        assert (done.returncode, done.stderr) == (0, "")
        return json.loads(done.stdout)["observables"]

    first = answer("15")
    (kept,) = (tmp_path / "softgrip_jax").glob("*.traced")
    assert answer("15", "known") == first
    # Another pressure is the same program with another number.
    other = answer("12", "known")
    assert 0.2 * first["force"] < other["force"] < 0.8 * first["force"]
    kept.write_bytes(kept.read_bytes()[:1000])
    assert answer("15") == pytest.approx(first, rel=1e-12)
    assert answer("15", "known") == first
