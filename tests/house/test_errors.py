"""What is the user's mistake is one sentence and code 2; what is a fault of the package is seen as one."""

import ast
import importlib
import sys

import pytest
from conftest import ROOT

from softgrip_jax import cli
from softgrip_jax.cli import MISTAKE, run
from softgrip_jax.errors import ConfigError, InputError, located

FILES = sorted([*(ROOT / "softgrip_jax").rglob("*.py"), *(ROOT / "optim").rglob("*.py")])
TESTED = {
    "softgrip_jax/commands/programs.py": "a kept program that cannot be read, for whatever reason, is traced again",
    "optim/design/finish.py": "what one thread raises is raised again in the others",
    "softgrip_jax/cli/__init__.py": "a fault is printed as one",
    "softgrip_jax/draws.py": "what h5netcdf says of a file that holds no posterior is a mistake in its name",
    "softgrip_jax/explorer/ahead.py": "the explorer compiles what this cannot, and tells what is wrong with it",
    "softgrip_jax/explorer/code.py": "values that cannot be compared are not the same, and both are written",
    "softgrip_jax/explorer/page.py": "told on the page: a thread has nobody else to tell",
    "softgrip_jax/explorer/study.py": "told on the page: a thread has nobody else to tell, and a store may be damaged",
    "softgrip_jax/explorer/tabs.py": "told on the page: a thread has nobody else to tell",
    "softgrip_jax/explorer/latest.py": "told on the page; the thread goes on with the next question",
    "softgrip_jax/explorer/front.py": "raised again in the thread that serves",
    "softgrip_jax/own.py": "a function of the user's is called, which may raise anything, and is named with its line",
    "softgrip_jax/verify/kept.py": "a file that holds no verification is named",
    "softgrip_jax/study/cluster.py": "what Dask says of an address or of certificates is a mistake in them",
    "softgrip_jax/study/dataset.py": "a chunk that cannot be read, for whatever reason, is named",
    "softgrip_jax/study/store.py": "a chunk that cannot be read, for whatever reason, is computed again",
}
"""Files with a catch of everything, and why it hides nothing."""
BLANKET = {"Exception", "BaseException", "ValueError", "TypeError", "RuntimeError", "ArithmeticError", "LookupError"}
READS = {"float", "int"}
"""Built-in conversions of a text, which raise a plain ValueError for one that is no number."""


def blanket_catches(tree: ast.AST) -> list[int]:
    """Lines of the catches that would hold more than one conversion of a text."""
    lines = []
    for block in ast.walk(tree):
        if not isinstance(block, ast.Try):
            continue
        calls = [ast.unparse(node.func) for part in block.body for node in ast.walk(part) if isinstance(node, ast.Call)]
        reads_a_number = len(block.body) == 1 and any(c in READS for c in calls)
        reads_a_number &= all(c in READS or c.split(".")[-1] in ("removesuffix", "endswith", "strip") for c in calls)
        for handler in block.handlers:
            names = [ast.unparse(n) for n in getattr(handler.type, "elts", [handler.type] if handler.type else [])]
            if (not names or BLANKET & set(names)) and not (reads_a_number and names == ["ValueError"]):
                lines.append(handler.lineno)
    return lines


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_no_catch_dresses_a_fault_up_as_a_mistake(path):
    """Mistakes are raised as InputError and caught as such; nothing else is caught and given another name."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    raised = [
        node.lineno for node in ast.walk(tree) if isinstance(node, ast.Raise) and "ValueError(" in ast.unparse(node)
    ]
    assert raised == [], "the user's mistakes are InputError, or ConfigError with their place"
    if str(path.relative_to(ROOT)) not in TESTED:
        assert blanket_catches(tree) == []


@pytest.mark.parametrize(
    ("code", "is_blanket"),
    [
        ("try:\n    value = float(text)\nexcept ValueError:\n    pass", False),
        ("try:\n    found = compare(float(x))\nexcept ValueError:\n    pass", True),
        ("try:\n    value = float(x)\n    work()\nexcept ValueError:\n    pass", True),
        ("try:\n    work()\nexcept (OSError, ValueError):\n    pass", True),
        ("try:\n    work()\nexcept Exception:\n    pass", True),
        ("try:\n    work()\nexcept:\n    pass", True),
        ("try:\n    work()\nexcept InputError:\n    pass", False),
    ],
)
def test_a_blanket_catch_is_seen(code, is_blanket):
    assert bool(blanket_catches(ast.parse(code))) == is_blanket


def test_a_place_is_said_once():
    with pytest.raises(ConfigError, match=r"^here: mu is -1\.$"), located("there"), located("here"):
        raise InputError("mu is\n-1.")
    with pytest.raises(ZeroDivisionError), located("here"):
        raise ZeroDivisionError
    with pytest.raises(ValueError, match=r"^zero-size") as caught, located("here"):
        raise ValueError("zero-size array")
    assert not isinstance(caught.value, InputError)


CALLS = {
    "solve": ("shell_free", "softgrip_jax.commands.solve.solving"),
    "path": ("shell_free", "softgrip_jax.questions.limit_pressure"),
    "sweep": ("shell_sweep", "softgrip_jax.commands.sweep.Study"),
    "sensitivity": ("shell_free", "softgrip_jax.commands.sensitivity.sensitivity"),
    "design": ("shell_grasp", "optim.design.run.search"),
    "design of a front": ("shell_trade_off", "optim.design.front_run.pareto"),
    "design, its problem": ("shell_grasp", "optim.design.settings.Problem"),
    "calibrate": ("calibrate_shell", "optim.calibration.run.calibrate"),
    "calibrate, its models": ("calibrate_shell", "optim.calibration.settings.Fitting"),
    "calibrate, a tension test": ("calibrate_tension", "optim.tension.run.compare"),
    "solve, its scene": ("shell_free", "softgrip_jax.shell.arc.free.Free.__check_init__"),
}
"""Command -> (config, what it calls that may raise anything)."""


@pytest.mark.parametrize("command", CALLS)
@pytest.mark.parametrize("mistake", [True, False])
def test_every_command_tells_a_mistake_from_a_fault(command, mistake, monkeypatch, tmp_path, capsys):
    config, target = CALLS[command]

    def fail(*args, **kwargs):
        if mistake:
            raise InputError("The number is -1; it must be positive.")
        raise ValueError("zero-size array to reduction operation maximum which has no identity")

    importlib.import_module("optim.tension.run")
    monkeypatch.setattr(target, fail, raising=not target.endswith("__check_init__"))
    if "trade_off" in config:
        monkeypatch.setattr("optim.design.front_run.pareto", fail)
    words = [command.split()[0].rstrip(","), str(ROOT / "configs" / f"{config}.toml")]
    words += [] if words[0] in ("solve", "path") else ["--out", str(tmp_path / "out")]
    if mistake:
        assert run(words) == MISTAKE
        said = capsys.readouterr().err.splitlines()[-1]
        assert said.endswith("The number is -1; it must be positive.")
    else:
        with pytest.raises(ValueError, match="zero-size array") as caught:
            run(words)
        assert not isinstance(caught.value, InputError)
    assert list(tmp_path.iterdir()) == []


def test_a_fault_has_a_code_of_its_own(monkeypatch, capsys):
    """Not that of a question without an answer, which a script would take it for."""

    def fail(arguments):
        raise ValueError("zero-size array")

    monkeypatch.setattr(cli, "run", fail)
    monkeypatch.setattr(cli.programs, "settings", lambda: None)
    monkeypatch.setattr(cli.ending, "hear_ctrl_c", lambda: None)
    monkeypatch.setattr(cli.ending, "leave", sys.exit)  # a command leaves its process for good
    with pytest.raises(SystemExit) as left:
        cli.main()
    assert left.value.code == cli.FAULT
    assert cli.FAULT not in (0, cli.NO_ANSWER, MISTAKE, cli.STOPPED)
    said = capsys.readouterr().err
    assert "ValueError: zero-size array" in said
    assert "a fault of softgrip_jax" in said


def test_a_store_that_is_no_json_is_the_users(tmp_path):
    from softgrip_jax.study import store

    (tmp_path / "zarr.json").write_bytes(b"\xff{")
    with pytest.raises(ConfigError, match="is not readable"):
        store._begun(str(tmp_path))
    assert store._begun(str(tmp_path / "nothing")) is None
