"""What mkdocs is told beyond mkdocs.yml: the tutorials are the notebooks, written pages find their place, and formulas
become MathML, which browsers draw themselves: the site can be read offline and asks no other host for anything."""

from __future__ import annotations

import html
import re
from pathlib import Path
from typing import Any

import nbformat
from latex2mathml.converter import convert
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page
from nbconvert import MarkdownExporter

ROOT = Path(__file__).resolve().parent.parent

ORDER = (
    "one_chamber",
    "one_finger",
    "contact_and_limit_points",
    "design_search",
    "parameter_study",
    "calibration",
    "from_design_to_cast",
    "your_own_scene",
)
"""The notebooks from the first steps on."""


FORMULA = re.compile(r'(<(?:span|div) class="arithmatex">)\\([(\[])(.*?)\\[)\]](</(?:span|div)>)', re.DOTALL)
"""As pymdownx.arithmatex leaves it: \\( in a line \\), \\[ on its own \\]."""


NAME = "<mi>(?:arc)?(?:sin|cos|tan|cot|exp|ln|log|min|max|det)</mi>"
FUNCTION = re.compile(
    rf"(</m(?:i|n|row|sub|sup|subsup|frac)>)?(<msup>{NAME}<m\w+>[^<]*</m\w+></msup>|{NAME})(?=(<m(?!o))?)"
)
"""A function's name, with what stands before it and what begins behind it where that is no sign."""
THIN = '<mspace width="0.167em"/>'
PRIMED = re.compile(r"<msup>(<mi>[^<]*</mi>)(?:<mi>&#x02032;</mi>|<mrow><mi>&#x02032;</mi>(<mn>\d</mn>)</mrow>)</msup>")
"""x' and x'^2."""


def primed(found: re.Match[str]) -> str:
    """The sign of a derivative from a text font, where it is high already: fonts for formulas differ in that."""
    symbol = f'<mrow>{found[1]}<mtext class="prime">&#x02032;</mtext></mrow>'
    return f"<msup>{symbol}{found[2]}</msup>" if found[2] else symbol


def mathml(formula: str, display: str) -> str:
    """TeX as MathML, with the thin spaces around the names of functions that TeX makes."""
    text = PRIMED.sub(primed, convert(formula, display=display))
    return FUNCTION.sub(
        lambda found: (found[1] + THIN if found[1] else "") + found[2] + (THIN if found[3] else ""), text
    )


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
        trust = next(part for part in nav if "Trust" in part)
        trust["Trust"] = [*trust["Trust"], *written]
    config.nav = nav
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Every notebook becomes a page, its pictures files beside it."""
    for path in notebooks():
        notebook = nbformat.read(path, as_version=4)
        notebook.metadata["language_info"] = {"name": "python"}  # for colours: it is not stored
        body, resources = MarkdownExporter().from_notebook_node(notebook)
        for name, content in resources["outputs"].items():
            body = body.replace(f"({name})", f"({path.stem}_{name})")
            files.append(File.generated(config, f"tutorials/{path.stem}_{name}", content=content))
        files.append(File.generated(config, f"tutorials/{path.stem}.md", content=body))
    return files


def on_page_markdown(markdown: str, page: Page, **kwargs: Any) -> str:
    """A table of seven columns needs the room of the table of contents."""
    if page.file.src_uri == "reproduction.md":
        page.meta["hide"] = ["toc"]
    return markdown


def on_page_content(html_text: str, **kwargs: Any) -> str:
    """Formulas as MathML."""

    def drawn(found: re.Match[str]) -> str:
        before, kind, formula, after = found.groups()
        formula = html.unescape(formula).replace(":=", r"\coloneqq ")
        if kind == "(":
            return before + mathml(formula, "inline") + after
        # Formulas side by side may stand below each other where the page is too narrow for them.
        parts = [formula] if r"\begin" in formula else re.split(r"\\q?quad\b", formula)
        return before + "".join(mathml(part, "block") for part in parts) + after

    return FORMULA.sub(drawn, html_text)
