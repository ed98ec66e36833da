"""Commands and sections of other packages are found by their entry points; a broken one breaks nothing else."""

import tomllib
from importlib.metadata import EntryPoint

import pytest
import typer
from conftest import ROOT

from softgrip_jax import cli, config, plugins

POINTS = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["entry-points"]


@pytest.mark.parametrize("group", [plugins.COMMANDS, plugins.SECTIONS])
def test_what_pyproject_names_is_installed_and_there(group):
    """Where this fails the package is to be installed anew: `make setup`."""
    found = plugins.found(group)
    assert {
        name: point.value for name, point in found.items() if point.value.startswith(("optim.", "softgrip_jax."))
    } == POINTS[group]
    for name in POINTS[group]:
        assert callable(found[name].load())


@pytest.fixture
def others(monkeypatch):
    """A package with one command that works and one that cannot be imported."""

    def found(group):
        values = {"works": "test_plugins:_greet", "broken": "no_such_package.cli:command"}
        return {name: EntryPoint(name, value, group) for name, value in values.items()}

    app = typer.Typer()
    app.registered_commands = list(cli.app.registered_commands)
    monkeypatch.setattr(cli, "app", app)
    monkeypatch.setattr(plugins, "found", found)
    cli.find_commands.cache_clear()
    yield
    cli.find_commands.cache_clear()


def _greet() -> None:
    """Greet."""
    typer.echo("hello")


def test_a_command_that_cannot_be_imported_is_named_and_the_others_work(others, capsys):
    assert cli.run(["works"]) == 0
    out, err = capsys.readouterr()
    assert out == "hello\n"
    assert "the command broken cannot be used: no_such_package.cli:command" in err
    assert cli.run(["--help"]) == 0
    assert "works" in capsys.readouterr().out


def test_a_section_of_another_package_may_stand_in_a_config(others):
    assert config.section_names()[-2:] == ("works", "broken")
