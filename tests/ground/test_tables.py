"""Tables in a terminal of 80 columns, and narrower ones: every name and every number can be read."""

import ast
import io
from unittest.mock import Mock

import numpy as np
import pytest
import xarray as xr
from conftest import ROOT
from rich.cells import cell_len
from rich.console import Console

from optim.design import run as design_run
from optim.design import settings
from optim.design.descent import Design, SearchResult
from softgrip_jax import config as configs
from softgrip_jax.cli import run
from softgrip_jax.commands import sensitivity
from softgrip_jax.commands.reproduce import report as report_of_rows
from softgrip_jax.results import Status
from softgrip_jax.scene import Scene
from softgrip_jax.tables import Table
from softgrip_jax.thesis.rows import Row, Verdict


def printed(thing, width=80):
    console = Console(file=io.StringIO(), width=width)
    thing(console) if callable(thing) else console.print(thing)
    lines = console.file.getvalue().splitlines()
    assert "…" not in console.file.getvalue()
    # Sentences below a table are not broken into lines: a terminal does that, and a file has them whole.
    assert max(cell_len(line) for line in lines if line[:1] in "┏┃┡│└├") <= width
    return lines


def cells(lines):
    """The rows of the parts of a printed table: cells that go on in further lines are put together."""
    rows, open_row = [], None
    for line in lines:
        if line[:1] not in "│┃":
            open_row = None
            continue
        found = [cell.strip() for cell in line.replace("┃", "│").strip("│").split("│")]
        if open_row is not None and not found[0] and rows[-1][0]:
            rows[-1] = [a + b for a, b in zip(rows[-1], found, strict=True)]
        else:
            rows.append(found)
        open_row = found
    return rows


def test_the_twelve_numbers_of_a_vector_have_twelve_names():
    """The design of configs/finger_shape.toml, whose report was twelve rows of one name."""
    wanted = settings.read(configs.load(ROOT / "configs" / "finger_shape.toml"))
    problem = wanted.problem
    rng = np.random.default_rng(0)

    def design():
        return Mock(
            spec=Design,
            x=rng.uniform(0.7e-3, 2e-3, 12),
            values=rng.uniform(-0.05, 0.05, len(problem.quantities)),
            objective=1.0,
            violations=np.zeros(len(problem.constrained)),
            statuses=(Status.OK,),
            reasons=("solved",),
            margins=np.ones(len(problem.rules)),
            answered=True,
            feasible=True,
            active=(),
            limit_margins={},
        )

    designs = [design() for _ in range(5)]
    result = Mock(
        spec=SearchResult,
        problem=problem,
        reference=design(),
        designs=designs,
        best=designs[0],
        solves=1,
        seconds={"descend": 1.0},
        paths=np.ones((3, 5)),
        descended=1.0,
        reached=(3, 1, 0, 0, 0),
        remarks=[],
        solutions={},
        notes=(),
    )
    rows = cells(printed(lambda console: design_run.report(result, console)))
    for k in range(12):
        mine = [row for row in rows if row[0] == f"finger.t_m[{k}]"]
        numbers = [float(cell.removesuffix(" mm")) for row in mine for cell in row[1:]]
        np.testing.assert_allclose(numbers, [1e3 * d.x[k] for d in [result.reference, *designs]], rtol=1e-4)


@pytest.mark.parametrize("width", [80, 60, 40])
@pytest.mark.parametrize("seed", range(6))
def test_no_cell_is_lost(width, seed):
    """Any names and numbers, as many columns as may be: what is printed is what was given."""
    rng = np.random.default_rng(seed)
    letters = list("abcdefg._[]0123456789")
    names = [f"{'.'.join(''.join(rng.choice(letters, rng.integers(2, 12))) for _ in range(3))}.{k}" for k in range(8)]
    columns = int(rng.integers(1, 9))
    values = [[f"{v:.6g}" for v in rng.normal(size=columns)] for _ in names]
    table = Table(title="numbers")
    table.add_column("")
    for k in range(columns):
        table.add_column(str(k), justify="right")
    for name, row in zip(names, values, strict=True):
        table.add_row(name, *row)
    found: dict[str, list[str]] = {}
    lines = "\n".join(printed(table, width))
    for block in lines.split("└"):
        # A name that is broken goes on in the first cell of the next line, beside cells that are empty.
        name = ""
        row: list[str] = []
        for line in block.splitlines():
            if line[:1] != "│":
                continue
            first, *others = [cell.strip() for cell in line.strip("│").split("│")]
            if any(others):
                name, row = first, others
            else:
                name += first
            if name in names:
                found.setdefault(name, []).extend(row)
    assert found == dict(zip(names, values, strict=True))


def test_a_table_that_fits_is_one_table():
    table = Table(title="one", title_justify="left")
    for name in ("", "a", "b"):
        table.add_column(name, justify="right" if name else "left")
    table.add_row("shell.t_m", "1.1 mm", "0.3 mm", style="bold")
    table.add_section()
    table.add_row("distance from the curve (rms)", "1.1 mm", "0.3 mm")
    lines = printed(table)
    assert lines[0].strip() == "one"
    assert sum(line.startswith("└") for line in lines) == 1
    assert cells(lines)[1:] == [
        ["shell.t_m", "1.1 mm", "0.3 mm"],
        ["distance from the curve (rms)", "1.1 mm", "0.3 mm"],
    ]
    assert any(line.startswith("├") for line in lines)


def test_the_table_of_elasticities_has_every_quantity_and_every_number():
    names = [f"gripper.finger.t_m[{k}]" for k in range(12)]
    quantities = [f"{q} at 12 kPa" for q in ("force_z", "contact_angle", "flat_length", "pressure", "limit_margin")]
    values = np.arange(60.0).reshape(5, 12) / 10 + 0.1
    values[0, 0], values[1, 1] = -3e-16, np.nan
    data = xr.Dataset(
        {
            "value": ("quantity", np.ones(5)),
            "status": ("quantity", np.zeros(5, np.int8)),
            "elasticity": (("quantity", "by"), values),
        },
        {"quantity": quantities, "kind": ("quantity", ["number"] * 5), "by": names},
    )
    lines = printed(lambda console: sensitivity.report(data, console))
    rows = cells(lines)
    for k, name in enumerate(names):
        told = [cell for row in rows if row[0] == name for cell in row[1:]]
        assert told == [sensitivity._signed(v) for v in values[:, k]]
    told = [cell for row in rows if row[0] == names[0] for cell in row[1:]]
    assert told[0] == "0.000"  # the rounding of a derivative has no sign
    heads = " ".join(cell for line in lines if line.startswith("┃") for cell in line.replace("┃", " ").split())
    for word in ("contact", "limit", "margin", "pressure"):
        assert word in heads


def test_the_comparison_with_the_thesis_keeps_its_words():
    quantity, reason = (
        "pressure that holds a cylinder of 30 mm",
        "the text leaves out the weight per length of the finger",
    )
    row = Row("table 6.3, row 4", quantity, "13.0 kPa", "13.0418 kPa", "+0.3 %", Verdict.NOT_IN_TEXT, reason)
    lines = printed(lambda console: report_of_rows([row], console))
    text = " ".join(lines).replace("│", " ")
    for word in [*quantity.split(), *reason.split(), "13.0418", "+0.3", "6.3,"]:
        assert word in text


def test_names_of_scenes_are_whole(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    assert run(["new"]) == 0
    told = capsys.readouterr().out
    assert "…" not in told
    assert max(map(cell_len, told.splitlines())) <= 80
    starts = [line.split()[0] for line in told.splitlines() if line[:2].strip()]
    assert {name for name, cls in configs.classes_of((Scene,)).items() if cls.__module__.startswith("soft")} <= {
        *starts
    }


def test_every_table_is_printed_by_the_one_that_loses_nothing():
    """No other room takes rich's own table."""
    for path in [*(ROOT / "softgrip_jax").rglob("*.py"), *(ROOT / "optim").rglob("*.py")]:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.module == "rich.table":
                assert path.name == "tables.py", path
