"""`softgrip export CONFIG.toml`: solids of a design, its moulds, and the sheet for the bench.

Reads the scene of a config and its section [manufacture]; writes a folder of STEP and STL files, pictures, the
sheet as HTML and as PDF.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from rich.console import Console

from ..errors import located
from ..folders import contents, new_folder
from .expected import as_data, expectations
from .files import one_scene, tell_folder


def run_export(
    config: Path,
    step: bool,
    stl: bool,
    mould: bool,
    scene: str | None,
    out: Path | None,
    console: Console,
    as_json: bool,
) -> bool:
    """Write a design as solids; returns whether all checks hold. Without step and stl both are written."""
    from .. import cad
    from .. import config as configs

    if not step and not stl:
        step = stl = True
    read = one_scene(config, scene)
    table = configs.validated(cad.ManufactureTable, read.tables.get("manufacture", {}), f"{config}, [manufacture]")
    with new_folder(out, f"{config.stem}-export") as (folder, final):
        with console.status("building solids") as status, located(str(config)):
            export = cad.export_of(read.scene, table, mould)
            checks = cad.check_solids(export, status.update)
            status.update("writing")
            checks += write_solids(folder, export, cad.growth(table), step, stl)
            plates = write_plates(folder, export, table) if stl else 0
            status.update("solving the scene")
            expected = expectations(read)
            status.update("drawing")
            pictures = draw_all(folder, export, cad.growth(table))
        title = f"{read.path.stem}: {export.kind}"
        content = cad.sheet(export, table, checks, expected, pictures, cad.growth(table))
        (folder / "sheet.html").write_text(cad.as_html(title, content), encoding="utf-8")
        has_pdf = cad.write_pdf(folder / "sheet.pdf", title, content)
        (folder / "config.toml").write_bytes(configs.standalone(config))
        found = {
            "kind": export.kind,
            "fingers": export.fingers,
            "silicone": [
                dict(zip(("pour", "volume_cm3", "mass_g", "part_A_g", "part_B_g"), row, strict=True))
                for row in cad.silicone(export, table)
            ],
            **as_data(expected),
            "plates": plates,
            "checks": [check.as_data() for check in checks],
            "all_good": all(check.good for check in checks),
        }
        (folder / "result.json").write_text(json.dumps(found, indent=2), encoding="utf-8")
    bad = [check for check in checks if not check.good]
    if not has_pdf and not as_json:
        console.print(r'There is no sheet.pdf: it needs reportlab, pip install "softgrip_jax\[cad]".', soft_wrap=True)
    if as_json:
        tell_folder(as_json, final)
    else:
        for name, volume, mass, part_a, part_b in cad.silicone(export, table):
            console.print(
                f"{name}: {volume:.2f} cm^3, {mass:.1f} g; weigh {part_a:.1f} g of A and {part_b:.1f} g of B."
            )
        if export.fingers > 1:
            console.print(cad.silicone_of_all(export, table), soft_wrap=True)
        for check in bad:
            console.print(f"FAILS: {check.what} of {check.piece}: {check.found:.6g}, expected {check.expected:.6g}.")
        console.print(f"{len(checks) - len(bad)} of {len(checks)} checks hold.")
        console.print(f"{final} has {contents(final)}.", soft_wrap=True)
    return not bad


def write_solids(folder: Path, export: Any, scale: int | float, step: bool, stl: bool) -> list[Any]:
    """The files of all pieces, moulds larger by `scale`; returns the checks of what was read back from them."""
    from .. import cad
    from ..cad import solids

    checks, read = [], {}
    kinds = [("parts", export.pieces, 1.0), ("moulds", [one for mould in export.moulds for one in mould.pieces], scale)]
    for place, pieces, factor in kinds:
        if pieces:
            (folder / place).mkdir()
        for piece in pieces:
            solid = solids.scaled(piece.solid, factor)
            path = folder / place / piece.name.replace(" ", "_")
            expected = piece.volume * factor**3
            if step:
                solids.write_step(solid, path.with_suffix(".step"))
                back = solids.read_step(path.with_suffix(".step"))
                found = solids.volume(back) if len(back) == 1 else float("nan")
                checks.append(cad.Check("volume of the STEP", piece.name, expected, found, 1e-6 * expected, "mm^3"))
                if factor == 1 and len(back) == 1:
                    read[piece.name] = back[0]
            if stl:
                solids.write_stl(solid, path.with_suffix(".stl"))
                checks += cad.check_mesh(path.with_suffix(".stl"), piece.name, expected)
    return checks + list(cad.check_thicknesses(export, read or {piece.name: piece.solid for piece in export.pieces}))


def write_plates(folder: Path, export: Any, table: Any) -> int:
    """What is printed, laid out on beds of the printer, a 3MF file each; returns how many."""
    from .. import cad

    plates = cad.laid_out(cad.printed(export, cad.growth(table)), table)
    for number, plate in enumerate(plates, 1):
        (folder / "plates").mkdir(exist_ok=True)
        cad.write_plate(plate, folder / "plates" / f"plate_{number}.3mf")
    return len(plates)


def draw_all(folder: Path, export: Any, scale: int | float) -> list[str]:
    """A picture of the parts and one of each mould, larger by `scale` as it is printed; their names."""
    from ..cad import solids
    from ..plots.solids import solids_figure

    rows = {"parts": (export.pieces, "", 1.0)}
    rows |= {f"mould_{mould.name}": (mould.pieces, f"mould of the {mould.casts}", scale) for mould in export.moulds}
    names = []
    for name, (pieces, title, factor) in rows.items():
        shown = []
        for one in pieces:
            solid = solids.scaled(solids.turned(one.solid) if one.hangs else one.solid, factor)
            words = f"{one.name}, turned over" if one.hangs else one.name
            shown.append((words, solids.triangles(solid), solids.edges(solid)))
        solids_figure(shown, title).savefig(folder / f"{name}.png", dpi=110)
        names.append(f"{name}.png")
    return names
