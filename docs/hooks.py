"""What mkdocs is told beyond mkdocs.yml: the tutorials are the notebooks, and written pages find their place."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import nbformat
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from nbconvert import MarkdownExporter

ROOT = Path(__file__).resolve().parent.parent

ORDER = (
    "one_chamber",
    "one_finger",
    "contact_and_limit_points",
    "design_search",
    "parameter_study",
    "calibration",
    "your_own_scene",
)
"""The notebooks from the first steps on."""


def notebooks() -> list[Path]:
    """The notebooks with their outputs."""
    return [path for name in ORDER if (path := ROOT / "notebooks" / f"{name}.ipynb").is_file()]


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Entries for the tutorials, and for pages that a command of the project writes (the reproduction, the speeds)."""
    nav: list[Any] = list(config.nav or [])
    tutorials = [f"tutorials/{path.stem}.md" for path in notebooks()]
    if tutorials:
        nav.insert(1, {"Tutorials": tutorials})
    named = str(nav)
    written = [p.name for p in sorted(Path(config.docs_dir).glob("*.md")) if f"'{p.name}'" not in named]
    if written:
        nav.insert(next(k for k, part in enumerate(nav) if "Trust" in part), {"Numbers": written})
    config.nav = nav
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Every notebook becomes a page, its pictures files beside it."""
    for path in notebooks():
        body, resources = MarkdownExporter().from_notebook_node(nbformat.read(path, as_version=4))
        for name, content in resources["outputs"].items():
            body = body.replace(f"({name})", f"({path.stem}_{name})")
            files.append(File.generated(config, f"tutorials/{path.stem}_{name}", content=content))
        files.append(File.generated(config, f"tutorials/{path.stem}.md", content=body))
    return files
