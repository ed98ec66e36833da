"""A study on several processes equals one of a single process to the bit, whoever is killed on the way."""

import os
import signal
import socket
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest
from conftest import ROOT
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


class Cluster:
    """dask scheduler, dask worker and softgrip as processes of their own, which talk by TLS."""

    def __init__(self, folder):
        self.env, self.started = os.environ | certificates(folder / "tls"), []
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.address = f"tls://127.0.0.1:{free.getsockname()[1]}"
        self.config = folder / "study.toml"
        self.config.write_text(CONFIG.replace("5000", "4000000"))

    def __enter__(self):
        return self

    def __exit__(self, *_):
        for process in self.started:
            process.kill()
            process.communicate()

    def start(self, *words, **more):
        self.started.append(subprocess.Popen([sys.executable, *words], env=self.env, text=True, **QUIET | more))
        return self.started[-1]

    def scheduler(self):
        return self.start("-m", "distributed.cli.dask_scheduler", "--host", self.address, "--no-dashboard")

    def worker(self):
        words = ("--no-nanny", "--nthreads", "1", "--no-dashboard")
        return self.start("-m", "distributed.cli.dask_worker", self.address, *words)

    def sweep(self, out, *words, **more):
        return self.start("-c", SMALL, "sweep", str(self.config), "--out", str(out), *words, **more)

    def sweep_there(self, out, **more):
        return self.sweep(out, "--scheduler", self.address, **more)


QUIET = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
HEARD = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
MOST_SECONDS = 240


def chunks_there(out):
    return len(list((out / "study.zarr" / "reason_10_kPa" / "c").glob("[0-9]*")))


def wait_for(count, out, process):
    """Until a study that a process computes has so many chunks."""
    deadline = time.monotonic() + MOST_SECONDS
    while chunks_there(out) < count:
        assert process.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.01)


@pytest.mark.slow
def test_a_scheduler_with_tls_whose_workers_come_and_go(tmp_path):
    """Four million designs; one worker is killed for good, another joins, the client is killed, then the scheduler, and
    the store equals that of one process."""
    out = tmp_path / "two"
    with Cluster(tmp_path) as cluster:
        scheduler = cluster.scheduler()
        first, second = cluster.worker(), cluster.worker()
        client = cluster.sweep_there(out)
        wait_for(20, out, client)
        first.kill()
        third = cluster.worker()
        wait_for(60, out, client)
        client.kill()
        client.wait()
        client = cluster.sweep_there(out, **HEARD)
        assert "going on with" in client.stdout.readline() + client.stdout.readline()
        wait_for(chunks_there(out) + 20, out, client)
        scheduler.kill()
        said = client.communicate(timeout=MOST_SECONDS)[1]
        assert client.returncode == 2, said
        assert "the scheduler was lost; when it is back, run it again" in said
        assert len(said.splitlines()) == 1
        for worker in (second, third):
            worker.wait(timeout=MOST_SECONDS)  # they leave by themselves
        cluster.scheduler(), cluster.worker(), cluster.worker()
        client = cluster.sweep_there(out, **HEARD)
        said = client.communicate(timeout=MOST_SECONDS)[0]
        assert client.returncode == 0
        assert "going on with" in said
        assert cluster.sweep(tmp_path / "one").wait(timeout=MOST_SECONDS) == 0
    same(tmp_path / "one", out)


def processes_of(session):
    """Of a session that was begun by a process, who is alive."""
    found = []
    for place in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            words = place.read_text().rpartition(")")[2].split()
            if int(words[3]) == session and words[0] != "Z":
                found.append(place.parent.name)
    return found


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="looks for processes in /proc")
@pytest.mark.parametrize("how", ["Ctrl-C", "killed"])
def test_a_study_that_is_stopped_leaves_no_processes(tmp_path, how):
    """Ctrl-C reaches the command and all of its workers, as in a terminal; SIGKILL the command alone."""
    out = tmp_path / "two"
    with Cluster(tmp_path) as cluster:
        client = cluster.sweep(out, "--workers", "2", start_new_session=True, **HEARD)
        wait_for(30, out, client)
        assert len(processes_of(client.pid)) > 2
        if how == "Ctrl-C":
            os.killpg(client.pid, signal.SIGINT)
            assert client.communicate(timeout=60)[1] == "stopped.\n"
            assert client.returncode == 130
        else:
            client.kill()
            client.wait()
        deadline = time.monotonic() + 60
        while processes_of(client.pid):
            assert time.monotonic() < deadline, "workers outlive the command"
            time.sleep(0.1)
        again = cluster.sweep(out, "--workers", "2", **HEARD)
        assert "going on with" in again.communicate(timeout=MOST_SECONDS)[0]
        assert again.returncode == 0
        assert cluster.sweep(tmp_path / "one").wait(timeout=MOST_SECONDS) == 0
    same(tmp_path / "one", out)


SBATCH = """#!/bin/sh
cp "$1" "$0.$$"
setsid sh "$0.$$" >"$0.log" 2>&1 &
echo "Submitted batch job $$"
"""


@pytest.mark.slow
def test_the_jobs_of_slurm(tmp_path):
    """The program of the docs, whose job scripts are run here in place of being queued."""
    pytest.importorskip("dask_jobqueue", reason="dask-jobqueue is not installed")
    page = (ROOT / "docs" / "guides" / "cluster.md").read_text()
    program = page.split("```py\n")[1].split("```")[0].replace("jobs=128", "jobs=2")
    sbatch = tmp_path / "bin" / "sbatch"
    sbatch.parent.mkdir()
    sbatch.write_text(SBATCH)
    sbatch.chmod(0o755)
    with Cluster(tmp_path) as cluster:
        cluster.env["PATH"] = f"{sbatch.parent}:{cluster.env['PATH']}"
        queue = cluster.start("-c", program, cwd=tmp_path, **HEARD)
        cluster.address = queue.stdout.readline().strip()
        assert cluster.address.startswith("tls://")
        client = cluster.sweep_there(tmp_path / "two", **HEARD)
        said = client.communicate(timeout=MOST_SECONDS)[1]
        assert client.returncode == 0, said
        scripts = list(sbatch.parent.glob("sbatch.[0-9]*"))
        assert len(scripts) == 2
        for script in scripts:
            words = script.read_text()
            assert "#SBATCH --cpus-per-task=1\n#SBATCH --mem=2G\n#SBATCH -t 04:00:00" in words
            assert "--tls-ca-file" in words
        assert cluster.sweep(tmp_path / "one").wait(timeout=MOST_SECONDS) == 0
    same(tmp_path / "one", tmp_path / "two")


@pytest.fixture
def small_disk(tmp_path):
    """A folder that holds a megabyte, and what makes it larger."""
    place = tmp_path / "disk"
    place.mkdir()
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", str(place)], capture_output=True)
    if mounted.returncode:
        pytest.skip("only who may mount a file system can fill one")
    yield place, lambda: subprocess.run(["mount", "-o", "remount,size=64m", str(place)], check=True)
    subprocess.run(["umount", str(place)], check=True)


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="makes a small disk by mount")
@pytest.mark.parametrize("words", [[], ["--workers", "2"]])
def test_a_disk_that_is_full_is_one_sentence(tmp_path, small_disk, words):
    """The command is told beforehand that there is room: other programs may take it."""
    place, enlarge = small_disk
    with Cluster(tmp_path) as cluster:
        cluster.config.write_text(CONFIG.replace("5000", "60000"))
        room = SMALL.replace("from softgrip_jax.cli", NO_LOOK + "    from softgrip_jax.cli", 1)
        sweep = ["-c", room, "sweep", str(cluster.config), "--out", str(place / "study"), *words]
        full = cluster.start(*sweep, **HEARD)
        said = full.communicate(timeout=MOST_SECONDS)[1]
        assert full.returncode == 2, said
        assert "no space left on device; when that is mended, run it again" in said
        assert len(said.splitlines()) == 1
        enlarge()
        again = cluster.start(*sweep, **HEARD)
        assert "going on with" in again.communicate(timeout=MOST_SECONDS)[0]
        assert again.returncode == 0
        assert cluster.sweep(tmp_path / "one").wait(timeout=MOST_SECONDS) == 0
    same(tmp_path / "one", place / "study")


NO_LOOK = """from softgrip_jax.commands import sweep
    sweep.refuse_what_cannot_end = lambda *_: None
"""


# A shell's job in the background begins with Ctrl-C ignored.
SMALL = """
import signal
signal.signal(signal.SIGINT, signal.default_int_handler)
if __name__ == "__main__":
    from softgrip_jax.study import cluster, study
    study.BLOCK = 2048
    cluster.RANGE_SECONDS = 0.2
    from softgrip_jax.cli import main
    main()
"""
