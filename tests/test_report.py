"""Reports: everything of the run is in one file, nothing is fetched, and two runs are told apart."""

import base64
import csv
import gzip
import io
import json
import re
import shlex
import tomllib
from html import escape
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT
from rich.console import Console

from softgrip_jax import cli, model_error
from softgrip_jax.reasons import Reason
from softgrip_jax.report.inputs import keep_inputs
from softgrip_jax.report.run import (
    change,
    command_of,
    compare_runs,
    differs,
    flat,
    how_to_repeat,
    numbers_of,
    tell_and_keep,
    write_report,
)
from softgrip_jax.tables import Table

CONFIG = """
[scene]
type = "shell.FlatContact"
distance_mm = {distance}
shell = {{ a_mm = 16, b_mm = 43, t_m_mm = 1.1, material = {{ type = "NeoHookean", mu_kPa = 175 }} }}

[solve]
pressure_kPa = 15

[sensitivity]

[[sensitivity.variables]]
name = "distance_mm"
"""


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Two runs of `softgrip sensitivity` that differ in one number."""
    place, found = tmp_path_factory.mktemp("runs"), []
    for name, distance in (("near", 5.0), ("far", 6.5)):
        config = place / f"{name}.toml"
        config.write_text(CONFIG.format(distance=distance), encoding="utf-8")
        assert cli.run(["sensitivity", str(config), "--out", str(place / name)]) == 0
        found.append(place / name)
    return found


def test_the_report_of_a_run_is_whole(runs):
    text = (runs[0] / "report.html").read_text(encoding="utf-8")
    assert "distance_mm = 5.0" in text
    words = (runs[0] / "summary.txt").read_text(encoding="utf-8")
    assert "clamp angle at 15 kPa" in words
    shown = re.sub(r"</?span[^>]*>", "", text)
    assert all(escape(line) in shown for line in words.splitlines())
    assert "softgrip sensitivity config.toml" in text
    assert "11 to 21 % less than finite elements" in text
    assert "data:image/png;base64," in text
    tags = re.sub(r"(<script[^>]*>).*?</script>", r"\1", text, flags=re.DOTALL)
    outside = re.findall(r'<(?:script|link|img)[^>]+(?:src|href)="(?!data:)([^"]+)"', tags)
    assert outside == []
    value = next(line for line in (runs[0] / "elasticities.csv").read_text().splitlines() if line.startswith("force"))
    assert f"{float(value.split(',')[1]):.6g}" in text


def test_what_is_printed_is_kept_as_it_stands(tmp_path):
    """A table and sentences, before anything else is printed and not after."""
    out = io.StringIO()
    console = Console(file=out, width=60)
    console.print("before")

    def tell(console):
        table = Table(title="[1] two")
        table.add_column("name")
        table.add_row("t_m[0]")
        console.print(table)
        console.print("as long as it takes " * 5, soft_wrap=True, markup=False)
        return "told"

    assert tell_and_keep(tmp_path, console, tell) == "told"
    words = (tmp_path / "summary.txt").read_text(encoding="utf-8")
    assert out.getvalue() == "before\n" + words
    assert "t_m[0]" in words
    console.print("after")
    assert not console.record


def test_a_table_of_few_rows_and_many_columns_stands_on_its_side(tmp_path):
    (tmp_path / "config.toml").write_text(CONFIG.format(distance=5.0), encoding="utf-8")
    names = [f"number_{k}" for k in range(9)]
    (tmp_path / "designs.csv").write_text(f"design,{','.join(names)}\nstart,{'1.5,' * 8}2\nbest,{'2.5,' * 8}3\n")
    text = write_report(tmp_path).read_text(encoding="utf-8")
    assert "<tr><th>design</th><th>start</th><th>best</th></tr>" in text
    assert "<tr><td>number_8</td><td>2</td><td>3</td></tr>" in text


def test_nothing_of_a_config_becomes_html(tmp_path):
    folder = tmp_path / "run"
    folder.mkdir()
    (folder / "config.toml").write_text(f"# <script>alert(1)</script>\n{CONFIG.format(distance=5.0)}")
    (folder / "result.json").write_text(json.dumps({"<b>best</b>": 1.0}))
    text = write_report(folder).read_text(encoding="utf-8")
    assert "<script>alert(1)" not in text
    assert "<b>best" not in text


def test_two_runs_are_compared(runs, tmp_path, capsys):
    out = tmp_path / "both.html"
    assert cli.run(["report", *map(str, runs), "--out", str(out)]) == 0
    text = out.read_text(encoding="utf-8")
    assert re.search(r"<tr><td>scene.distance_mm</td><td>5</td><td>6.5</td></tr>", text)
    assert "scene.shell.a_mm" not in text.partition("Results")[0]
    assert shlex.join(["softgrip", "sensitivity", str(runs[1] / "config.toml")]) in text
    # Of each quantity's elasticity both values stand in one row, as people read them, with the change.
    texts = [(run / "elasticities.csv").read_text(encoding="utf-8") for run in runs]
    tables = [next(csv.DictReader(text.splitlines())) for text in texts]
    before, after = (float(table["distance"]) for table in tables)
    row = re.search(rf"<td>{tables[0]['quantity']}: distance</td><td>(.*?)</td><td>(.*?)</td><td>(.*?)</td>", text)
    assert row is not None
    assert row.groups() == (f"{before:.6g}", f"{after:.6g}", change(before, after))


def test_tables_of_other_rows_follow_each_other(runs, tmp_path):
    """A study that has other designs is not compared row by row."""
    places = []
    for name, rows in (("one", "a,1\nb,2\n"), ("other", "a,1\nc,3.0000000000001\n")):
        place = tmp_path / name
        place.mkdir()
        (place / "config.toml").write_bytes((runs[0] / "config.toml").read_bytes())
        (place / "found.csv").write_text(f"what,value\n{rows}", encoding="utf-8")
        places.append(place)
    text = compare_runs(*places, tmp_path / "both.html").read_text(encoding="utf-8")
    assert "<td>b</td><td>2</td>" in text
    assert "<td>c</td><td>3</td>" in text


def test_a_run_is_called_by_its_folder_wherever_one_stands(runs, monkeypatch):
    monkeypatch.chdir(runs[0])
    text = write_report(Path()).read_text(encoding="utf-8")
    assert "softgrip sensitivity: near<" in text
    text = compare_runs(Path(), runs[1], runs[0].parent / "both.html").read_text(encoding="utf-8")
    assert "near and far<" in text


@pytest.mark.parametrize(
    ("left", "command"),
    [("materials.csv", "calibrate"), ("points.csv", "calibrate"), ("study.png", "sweep"), ("study.csv", "sweep")],
)
def test_what_a_run_leaves_says_which_of_the_sections_it_is_of(tmp_path, left, command):
    """A study may be kept elsewhere (--to): then its folder has no store."""
    (tmp_path / left).touch()
    asked = command_of({"design": {}, "sweep": {}, "tension": {}}, {}, tmp_path)
    assert asked == ["softgrip", command, "config.toml"]


def test_mistakes_are_one_sentence(tmp_path, capsys):
    assert cli.run(["report", str(tmp_path / "nowhere")]) == cli.MISTAKE
    assert "there is no such folder" in capsys.readouterr().err
    assert cli.run(["report", str(tmp_path)]) == cli.MISTAKE
    assert "there is no config.toml in it" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("config.toml", b"[scene"),
        ("config.toml", b"# \xff"),
        ("result.json", b"{"),
        ("result.json", b"[1]"),
        ("found.csv", b"a,b\n\xff,1\n"),
        ("summary.txt", b"\xff"),
    ],
)
def test_a_damaged_file_of_a_run_is_one_sentence(tmp_path, capsys, name, content):
    (tmp_path / "config.toml").write_text(CONFIG.format(distance=5.0), encoding="utf-8")
    (tmp_path / name).write_bytes(content)
    assert cli.run(["report", str(tmp_path)]) == cli.MISTAKE
    said = capsys.readouterr().err
    assert said.startswith(f"{tmp_path / name} cannot be read: ")
    assert len(said.splitlines()) == 1
    assert not (tmp_path / "report.html").exists()


def test_the_report_of_a_curve(tmp_path):
    config, page = tmp_path / "flat.toml", tmp_path / "curve.html"
    config.write_text(CONFIG.format(distance=5.0), encoding="utf-8")
    options = ["--to-kPa", "20", "--points", "5", "--report", str(page)]
    assert cli.run(["path", str(config), *options]) == 0
    text = page.read_text(encoding="utf-8")
    assert "status: " in text
    assert "--to-kPa 20 --points 5" in text


def points_of(text):
    """The columns of the first interactive plot of a page as Bokeh's script has them."""
    documents = json.loads(re.search(r"const docs_json = '(.*?)';", text)[1].replace("\\\\", "\\"))
    (document,) = documents.values()
    data = {}

    def look(value):
        if isinstance(value, dict):
            if value.get("type") == "map" and any(entry[0] == "colour" for entry in value.get("entries", [])):
                data.update(value.get("entries", []))
            value = list(value.values())
        for one in value if isinstance(value, list) else ():
            look(one)

    look(document)
    found = {}
    for name, values in data.items():
        if isinstance(values, dict):
            bytes_ = base64.b64decode(values["array"]["data"])
            values = np.frombuffer(gzip.decompress(bytes_) if bytes_[:2] == b"\x1f\x8b" else bytes_, values["dtype"])
        found[name] = values
    return found


@pytest.mark.slow
def test_what_has_no_state_is_not_drawn(tmp_path):
    """A curve that goes on where the scene cannot exist: its values are missing, not zero; reasons are sentences."""
    page = tmp_path / "curve.html"
    config = ROOT / "configs" / "finger_tip_contact.toml"
    options = ["--through-limit", "--observable", "tip_angle_deg", "--report", str(page)]
    assert cli.run(["path", str(config), *options]) == 0
    text = page.read_text(encoding="utf-8")
    points = points_of(text)
    good = np.array(points["status"]) == "OK"
    assert 0 < good.sum() < len(good)
    np.testing.assert_array_equal(np.isfinite(points["y"]), good)
    np.testing.assert_array_equal(points["y"], points["tip_angle_deg"])
    np.testing.assert_array_equal(points["x"], points["pressure_kPa"])
    assert f"{(~good).sum()} CHAMBERS_APART ({Reason.CHAMBERS_APART.text()})" in text
    assert text.count("<figure>") == 1
    assert model_error.TIP.split(";")[0] in text
    assert "--points 41 --through-limit --observable tip_angle_deg</pre>" in text


def test_points_of_two_units_are_two_plots_and_mixed_columns_none(tmp_path):
    (tmp_path / "config.toml").write_text(CONFIG.format(distance=5.0), encoding="utf-8")
    head = "curve,pressure_kPa,strain,quantity,unit,measured,fitted"
    lines = [f"{name},{k},,{what},{unit},{k}.5,{k}" for name, what, unit in CURVES for k in range(3)]
    (tmp_path / "points.csv").write_text("\n".join([head, *lines]) + "\n")
    (tmp_path / "elasticities.csv").write_text("quantity,value_SI,a\nforce,1,2\narea,3,4\npressure,5,6\n")
    text = write_report(tmp_path).read_text(encoding="utf-8")
    assert text.count('class="plot"') == 2
    np.testing.assert_array_equal(points_of(text)["y"], [0.5, 1.5, 2.5])
    assert '"force, measured (N)"' in text
    assert '"inflation, measured (mm)"' in text


CURVES = (("free", "inflation", "mm"), ("held", "force", "N"))

SWEEP = """
[[sweep.observables]]
name = "force_N"
at = { pressure_kPa = [4, 15] }

[sweep]
method = "csv"
file = "../designs.csv"
"""


def test_a_sweep_says_why_and_is_repeated_from_its_folder(tmp_path, monkeypatch):
    """Reasons in words; the first varied number across, the first quantity up, in mm and N; its designs beside it."""
    (tmp_path / "configs").mkdir()
    (tmp_path / "designs.csv").write_text("distance_mm,shell.a_mm\n4,16\n5,16\n6,15\n")
    config = tmp_path / "configs" / "flat.toml"
    config.write_text(CONFIG.format(distance=5.0) + SWEEP, encoding="utf-8")
    assert cli.run(["sweep", str(config), "--out", str(tmp_path / "out")]) == 0
    text = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert f"NO_CONTACT, NOTHING_TOUCHED: {escape(Reason.NOTHING_TOUCHED.text())}" in text
    np.testing.assert_allclose(points_of(text)["x"], [4, 5, 6])
    assert '"force_at_4_kPa_N"' in text
    assert "softgrip sweep config.toml" in text
    (tmp_path / "designs.csv").unlink()
    monkeypatch.chdir(tmp_path / "out")
    assert cli.run(["sweep", "config.toml", "--out", "again"]) == 0
    assert (tmp_path / "out" / "again" / "summary.txt").read_text() == (tmp_path / "out" / "summary.txt").read_text()


def test_files_of_a_run_never_replace_each_other(tmp_path):
    """Files outside the folder of the config, or named as the run names its own, go to data/ under free names."""
    given, run = tmp_path / "given", tmp_path / "run"
    for folder in (given, given / "in", run):
        folder.mkdir()
    for place, words in (("x.csv", "outside"), ("given/points.csv", "own"), ("given/in/x.csv", "inside")):
        (tmp_path / place).write_text(words)
    config = given / "c.toml"
    config.write_text('[tension]\nfile = ["../x.csv", "points.csv", "in/x.csv"]\nfit = "../x.csv"\n')
    keep_inputs(run, config, ["points.csv"])
    table = tomllib.loads((run / "config.toml").read_text())["tension"]
    assert table == {"file": ["data/x.csv", "data/points.csv", "in/x.csv"], "fit": "../x.csv"}
    assert [(run / name).read_text() for name in table["file"]] == ["outside", "own", "inside"]
    assert not (run / "points.csv").exists()
    assert how_to_repeat(run, {"tension": table}).endswith("Type in that folder:")
    (run / "in" / "x.csv").unlink()
    assert "not kept in the folder of the run (in/x.csv)" in how_to_repeat(run, {"tension": table})


def test_rounding_is_no_change(tmp_path):
    assert change(1.0, 1.0 + 1e-12) == ""
    assert change(0.0, -1.84e-14) == ""
    assert change(1.0, 1.0 + 1e-8) == "1e-08 (+1e-06 %)"
    assert not differs([1.0, 0.0], [1.0 + 1e-12, 1e-13])
    assert differs([1.0, 0.0], [1.0, 1e-3])
    assert differs(None, 1.0)
    assert differs(True, False)
    places = [tmp_path / "one", tmp_path / "other"]
    for place, area in zip(places, (2.0, 2.0 + 1e-13), strict=True):
        place.mkdir()
        (place / "config.toml").write_text(CONFIG.format(distance=5.0), encoding="utf-8")
        (place / "result.json").write_text(json.dumps({"area": area}))
    assert 'class="differs"' not in compare_runs(*places, tmp_path / "both.html").read_text(encoding="utf-8")


def test_tables_are_read_as_numbers():
    found = numbers_of(["a", "b", "c"], [["1", "x", ""], ["2.5", "y", "3"]])
    assert list(found) == ["a", "c"]
    np.testing.assert_array_equal(found["c"], [np.nan, 3.0])
    assert flat({"a": {"b": [{"c": 1}, {"c": 2}]}}) == {"a.b[1].c": 1, "a.b[2].c": 2}
    assert change(2.0, 3.0) == "1 (+50 %)"
    assert change("a", "b") == ""
