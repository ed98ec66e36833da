"""The public API as a type checker sees it from outside of the package."""

import subprocess
import sys

from conftest import ROOT

PROGRAM = """
from typing import assert_type

import jax

import optim
import softgrip_jax as sg
from softgrip_jax.units import kPa, mm

shell = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
scene = sg.shell.FlatContact(shell, distance=5 * mm)
solution = sg.solve(scene, 15 * kPa, solver=sg.solvers.ExplicitCurve())
assert_type(solution, sg.Solution)
curve: sg.Solution = sg.path(scene, [1 * kPa, 2 * kPa])
needed: sg.Solution = sg.pressure_for(scene, force=2.0)
limit: jax.Array = sg.limit_pressure(scene)
finger = sg.PneuNet.table_5_1("A")
assert_type(finger, sg.PneuNet)
tip: sg.Scene = sg.pneunet.TipContact(finger, beam=sg.pneunet.Shooting(rtol=1e-8))
wanted: list[optim.Goal] = []
searched = optim.search
"""
WRONG = PROGRAM + "sg.solve(scene)\nsg.no_such_name\noptim.serach\n"


def test_a_program_of_a_user_is_well_typed_and_its_mistakes_are_seen(tmp_path):
    """Programs that stand beside the package, not in it."""
    (tmp_path / "right.py").write_text(PROGRAM)
    (tmp_path / "wrong.py").write_text(WRONG)
    (tmp_path / "pyrightconfig.json").write_text(f'{{"extraPaths": ["{ROOT}"], "reportArgumentType": false}}')
    command = [sys.executable, "-m", "pyright", "--pythonpath", sys.executable, "--project", str(tmp_path)]
    said = subprocess.run(command, capture_output=True, text=True, check=False).stdout
    errors = [line for line in said.splitlines() if " - error" in line]
    assert not [line for line in errors if "right.py" in line.split(" - ")[0]], said
    assert len(errors) == 3, said
