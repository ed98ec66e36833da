"""`sg.enable_cache`: a second process takes what the first has compiled, and says nothing."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import ROOT

from softgrip_jax import cache

CODE = """
import json, logging, sys
import jax
import jax.numpy as jnp
import softgrip_jax as sg
jnp.linspace(0, 1, 7) @ jnp.ones(7)       # something is compiled before: JAX has decided that there is no cache
shell = sg.FlatShell(a=16e-3, b=43e-3, t_m=1.1e-3, material=sg.NeoHookean(mu=175e3))
counts = {"/jax/compilation_cache/cache_hits": 0, "/jax/compilation_cache/cache_misses": 0}
jax.monitoring.register_event_listener(lambda event, **_: counts.update({event: counts.get(event, 0) + 1}))
folder = sg.enable_cache(*sys.argv[1:])
force = float(sg.solve(sg.shell.FlatContact(shell, distance=5e-3), 15e3).force)
print(json.dumps({"folder": str(folder), "force": force, "hits": counts["/jax/compilation_cache/cache_hits"]}))
"""


def answer(environment, *words):
    given = {k: v for k, v in os.environ.items() if k not in (cache.FOLDER, cache.LOG_LEVEL)} | environment
    done = subprocess.run([sys.executable, "-c", CODE, *words], capture_output=True, text=True, env=given, cwd=ROOT)
    assert (done.returncode, done.stderr) == (0, "")
    return json.loads(done.stdout)


def test_the_second_process_reads_what_the_first_has_compiled(tmp_path):
    place = tmp_path / "kept"
    first = answer({}, str(place))
    files = {path.name for path in place.iterdir() if not path.name.endswith("-atime")}
    assert files
    second = answer({}, str(place))
    assert first["folder"] == second["folder"] == str(place)
    assert (first["hits"], second["hits"] > 0) == (0, True)
    assert second["force"] == first["force"]
    assert {path.name for path in place.iterdir() if not path.name.endswith("-atime")} == files


@pytest.mark.parametrize(
    ("environment", "folder"),
    [
        ({"XDG_CACHE_HOME": "/somewhere"}, "/somewhere/softgrip_jax"),
        ({"XDG_CACHE_HOME": "/somewhere", cache.FOLDER: "/jaxs"}, "/jaxs"),
        ({}, str(Path.home() / ".cache" / "softgrip_jax")),
    ],
)
def test_the_folder_without_a_word(environment, folder, monkeypatch):
    for name in ("XDG_CACHE_HOME", cache.FOLDER):
        monkeypatch.delenv(name, raising=False)
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    assert str(cache.user_folder()) == folder


@pytest.mark.parametrize(("given", "after"), [(None, "3"), (cache.JAXS_OWN, "3"), ("0", "0"), ("2", "2")])
def test_what_the_user_wants_to_read_stays(given, after, monkeypatch):
    """JAX, which is imported here, sets its own level where there is none."""
    monkeypatch.setenv(cache.LOG_LEVEL, given or "")
    if given is None:
        monkeypatch.delenv(cache.LOG_LEVEL)
    asked = []
    config = type("Config", (), {"values": {"jax_logging_level": "WARNING"}, "update": lambda *a: asked.append(a[1:])})
    monkeypatch.setitem(sys.modules, "jax", type("Jax", (), {"config": config()}))
    cache.silence()
    assert os.environ[cache.LOG_LEVEL] == after
    levels = [("jax_logging_level", "CRITICAL"), ("jax_logging_level", "WARNING")]
    assert asked == (levels if after == "3" else [])
