"""What a command keeps of what it traced: the same answer the second time, whatever has become of the file."""

import gc
import importlib
import json
import os
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor

import jax
import pytest
from conftest import ROOT

import softgrip_jax as sg
from softgrip_jax.commands import programs

CODE = """
import sys
from softgrip_jax.cli import main
from softgrip_jax.shell.arc import flat
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


@pytest.mark.parametrize(
    ("given", "wanted"),
    [
        ("", "--xla_cpu_use_fusion_emitters=false"),
        ("--xla_cpu_use_fusion_emitters=true", "--xla_cpu_use_fusion_emitters=true"),
        ("--xla_dump_to=here", "--xla_dump_to=here --xla_cpu_use_fusion_emitters=false"),
    ],
)
def test_what_the_user_set_stays(given, wanted, monkeypatch):
    monkeypatch.setattr(programs, "_folder", None)
    for name, value in (("XLA_FLAGS", given), ("JAX_COMPILATION_CACHE_DIR", "mine"), ("TF_CPP_MIN_LOG_LEVEL", "0")):
        monkeypatch.setenv(name, value)
    monkeypatch.setenv("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "1")
    programs.settings()
    assert os.environ["XLA_FLAGS"] == wanted
    assert gc.isenabled()
    assert gc.get_threshold()[0] == programs.COLLECTED
    assert (os.environ["JAX_COMPILATION_CACHE_DIR"], os.environ["TF_CPP_MIN_LOG_LEVEL"]) == ("mine", "0")

    # A version of XLA that was not seen yet may not know the flag, and would leave the process over it.
    monkeypatch.setattr("jaxlib.version.__version_info__", (0, 11, 0))
    monkeypatch.setenv("XLA_FLAGS", given)
    programs.settings()
    assert os.environ["XLA_FLAGS"] == given


def test_a_program_belongs_to_the_files_that_it_is_made_of(tmp_path, monkeypatch):
    """A class of one's own, whose formula may change, and the numbers of the cell law."""

    def names(found):
        return {os.path.basename(path) for path, *_ in found}

    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "__init__.py").write_text("from .laws import Mine\n")
    laws = tmp_path / "mine" / "laws.py"
    laws.write_text("from typing import NamedTuple\nclass Mine(NamedTuple):\n    x: float\n")
    monkeypatch.syspath_prepend(tmp_path)
    mine = jax.tree.structure({"scene": importlib.import_module("mine").Mine(1.0)})
    before = programs.files_of(mine)
    assert {"laws.py", "law.npz", "scene.py"} <= names(before)
    os.utime(laws, ns=(1, 1))
    assert programs.files_of(mine) != before
    ours = programs.files_of(jax.tree.structure(sg.NeoHookean(mu=1e5)), "optim.problem")
    assert "laws.py" in names(ours)  # of our own materials
    assert not any("mine" in path for path, *_ in ours)
    assert "descent.py" in names(ours)


def test_what_is_compiled_beside_is_waited_for():
    gate, pool, heard = threading.Event(), ThreadPoolExecutor(1), []

    def hear(event, seconds, **_):
        if event == programs.WAITED:
            heard.append(seconds)

    jax.monitoring.register_event_duration_secs_listener(hear)
    try:
        found = pool.submit(gate.wait, 60)
        threading.Timer(0.05, gate.set).start()
        assert programs._waited_for(found) is True
        assert programs._waited_for(found) is True
        with pytest.raises(ZeroDivisionError):
            programs._waited_for(pool.submit(lambda: 1 / 0))
    finally:
        jax.monitoring.unregister_event_duration_listener(hear)
    assert 0.02 < heard[0] < 60
    assert len(heard) <= 2  # the second time it was there
