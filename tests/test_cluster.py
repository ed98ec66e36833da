"""A study on several processes equals one of a single process to the bit, whoever is killed on the way."""

import os
import signal
import socket
import subprocess
import sys
import time

import pytest
from helpers import shell
from test_study import same

import softgrip_jax as sg
from softgrip_jax.cli import run
from softgrip_jax.errors import ConfigError
from softgrip_jax.study import Range, Sobol, run_in
from softgrip_jax.study import study as blocks
from softgrip_jax.study.cluster import _Ranges, client, refuse_plain
from softgrip_jax.units import kPa, mm

distributed = pytest.importorskip("distributed")
pytestmark = pytest.mark.filterwarnings("default")  # what Dask warns of is its own


@pytest.mark.parametrize(
    "address", ["tls://far.example.org:8786", "tcp://127.0.0.1:8786", "tcp://[::1]:8786", "localhost:8786"]
)
def test_addresses_that_are_safe(address):
    refuse_plain(address, insecure=False)


@pytest.mark.parametrize("address", ["tcp://far.example.org:8786", "10.0.0.7:8786", "tcp://192.168.1.2:8786"])
def test_another_machine_is_not_talked_to_in_the_clear(address):
    with pytest.raises(ConfigError, match="without encryption"):
        refuse_plain(address, insecure=False)
    refuse_plain(address, insecure=True)


@pytest.mark.parametrize("address", ["http://host:1", "tls://", ""])
def test_what_is_no_address_is_one_sentence(address):
    with pytest.raises(ConfigError, match="must be an address"):
        refuse_plain(address, insecure=True)


def test_ranges_grow_to_seconds():
    ranges = _Ranges(range(100))
    assert ranges.next() == [0]
    for expected in (2, 4, 8, 10, 10):
        ranges.learn(1, 0.3)
        assert len(ranges.next()) == expected
    ranges.learn(10, 30.0)
    assert len(ranges.next()) == 1
    assert len(ranges) == 100 - 1 - 34 - 1


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--workers", "2", "--scheduler", "tls://a:1"], "give one of them"),
        (["--scheduler", "tcp://10.0.0.7:8786"], "without encryption"),
        (["--scheduler", "tcp://127.0.0.1:1"], "cannot be reached"),
        (["--insecure"], "--insecure is given without --scheduler"),
    ],
)
def test_mistakes_are_one_sentence(tmp_path, capsys, words, sentence, monkeypatch):
    config = tmp_path / "study.toml"
    config.write_text(CONFIG)
    import dask

    monkeypatch.setattr("softgrip_jax.study.cluster.REACHED_SECONDS", 1)
    with dask.config.set({"distributed.comm.timeouts.connect": "1s"}):
        assert run(["sweep", str(config), "--out", str(tmp_path / "out"), *words]) == 2
    said = capsys.readouterr().err
    assert sentence in said
    assert len(said.splitlines()) == 1
    assert not (tmp_path / "out").exists()


CONFIG = """
[scene]
type = "shell.FlatContact"
distance_mm = 5
[scene.shell]
a_mm = 16
b_mm = 43
t_m_mm = 1.1
material = { type = "NeoHookean", mu_kPa = 175 }
[sweep]
method = "sobol"
samples = 5000
[[sweep.variables]]
name = "distance_mm"
low = 2
high = 9
[[sweep.observables]]
name = "force_N"
at = { pressure_kPa = 10 }
"""


def slow_study():
    scene = sg.shell.FlatContact(shell(), distance=5 * mm)
    return sg.Study(scene, ["distance"], [sg.Quantity("force", 10 * kPa)], Sobol([Range(2 * mm, 9 * mm)], 300 * 128))


def test_workers_are_killed_and_others_go_on(tmp_path, monkeypatch):
    """Two processes; one is killed in the middle, and the nanny's next one takes its place."""
    monkeypatch.setattr(blocks, "BLOCK", 128)
    monkeypatch.setattr(blocks, "BATCH", {"cpu": 128})
    monkeypatch.setattr("softgrip_jax.study.cluster.RANGE_SECONDS", 0.2)
    one, study = tmp_path / "one", slow_study()
    run_in(one, study, "x")
    killed = []
    with client(2, None) as spread:
        dask_client = spread.args[0]

        def report(done, skipped):
            if done > 0.2 * study.designs.count and not killed:
                killed.append(next(iter(dask_client.run(os.getpid).values())))
                os.kill(killed[0], signal.SIGKILL)

        run_in(tmp_path / "two", study, "x", report, spread=spread)
    assert killed
    same(one, tmp_path / "two")


def certificates(folder):
    """A certificate for this test alone, and what tells Dask of it."""
    from distributed.security import Security

    made = Security.temporary()
    folder.mkdir()
    for name, content in (("ca", made.tls_ca_file), ("cert", made.tls_client_cert), ("key", made.tls_client_key)):
        (folder / f"{name}.pem").write_text(content)
    tls = "DASK_DISTRIBUTED__COMM__TLS__"
    settings = {f"{tls}CA_FILE": str(folder / "ca.pem"), "DASK_DISTRIBUTED__COMM__REQUIRE_ENCRYPTION": "True"}
    for role in ("SCHEDULER", "WORKER", "CLIENT"):
        settings |= {f"{tls}{role}__CERT": str(folder / "cert.pem"), f"{tls}{role}__KEY": str(folder / "key.pem")}
    return settings


@pytest.mark.slow
def test_a_scheduler_with_tls_whose_workers_come_and_go(tmp_path):
    """dask scheduler and dask worker as processes of their own: one is killed for good, another joins, the client is
    killed too, and the store equals that of one process."""
    env = os.environ | certificates(tmp_path / "tls")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    address, started = f"tls://127.0.0.1:{port}", []

    def start(*words, **more):
        started.append(subprocess.Popen([sys.executable, *words], env=env, stderr=subprocess.DEVNULL, **more))
        return started[-1]

    def worker():
        return start("-m", "distributed.cli.dask_worker", address, "--no-nanny", "--nthreads", "1", "--no-dashboard")

    config, two = tmp_path / "study.toml", tmp_path / "two"
    config.write_text(CONFIG.replace("5000", "1000000"))
    sweep = ["-c", SMALL, "sweep", str(config)]

    def wait_for(count, process):
        deadline = time.monotonic() + 120
        while len(list((two / "study.zarr" / "reason_10_kPa" / "c").glob("*"))) < count:
            assert process.poll() is None
            assert time.monotonic() < deadline
            time.sleep(0.01)

    try:
        start("-m", "distributed.cli.dask_scheduler", "--host", address, "--no-dashboard")
        first, _ = worker(), worker()
        client = start(*sweep, "--out", str(two), "--scheduler", address, stdout=subprocess.DEVNULL)
        wait_for(20, client)
        first.kill()
        worker()
        wait_for(60, client)
        client.kill()
        client.wait()
        client = start(*sweep, "--out", str(two), "--scheduler", address, stdout=subprocess.PIPE, text=True)
        said = client.communicate(timeout=240)[0]
        assert client.returncode == 0
        assert "going on with" in said
        assert subprocess.run([sys.executable, *sweep, "--out", str(tmp_path / "one")], env=env).returncode == 0
        same(tmp_path / "one", two)
    finally:
        for process in started:
            process.kill()
            process.wait()


SMALL = """
from softgrip_jax.study import study
study.BLOCK = 4096
from softgrip_jax.cli import main
main()
"""
