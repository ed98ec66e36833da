"""Every page of docs/extending shows one file of a user's own, and that file works as it stands there."""

import re

import jax
import pytest
from conftest import ROOT

from softgrip_jax import cli

FOLDER = ROOT / "docs" / "extending"
PAGES = sorted(page for page in FOLDER.glob("*.md") if page.stem != "index")
PYTHON = re.compile(r"^```python\n(.*?)^```", re.DOTALL | re.MULTILINE)


def blocks(page):
    """The Python of a page, each block behind as many empty lines as there are before it on the page."""
    text = page.read_text(encoding="utf-8")
    return ["\n" * (text.count("\n", 0, found.start(1))) + found[1] for found in PYTHON.finditer(text)]


@pytest.fixture
def commands(monkeypatch):
    """What a page adds to the command is gone after it, and nothing else."""
    cli.find_commands()
    monkeypatch.setattr(cli.app, "registered_commands", list(cli.app.registered_commands))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_the_page_works(page, commands, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    # A reader's JAX is not as strict about ranks as the tests are.
    with jax.numpy_rank_promotion("allow"):
        names: dict = {"__name__": "__page__"}
        for block in blocks(page):
            exec(compile(block, str(page.relative_to(ROOT)), "exec"), names)


def test_every_page_is_listed_and_shows_code():
    listed = re.findall(r"\]\(([\w-]+)\.md\)", (FOLDER / "index.md").read_text(encoding="utf-8"))
    assert sorted(listed) == [page.stem for page in PAGES]
    assert len(PAGES) >= 8
    assert all(blocks(page) for page in PAGES)


def test_a_shell_scene_takes_less_than_fifty_lines():
    scene = blocks(FOLDER / "shell-scene.md")[0].lstrip("\n")
    assert "class RoundPad" in scene
    assert len([line for line in scene.splitlines() if line.strip()]) < 50
