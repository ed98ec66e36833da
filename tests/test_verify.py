"""Finite elements of a scene: against finite differences, closed forms, and curves computed by another program."""

import dataclasses
import json
import re
import shutil
import subprocess

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import softgrip_jax as sg
from softgrip_jax import cli, fidelity
from softgrip_jax.commands.verify import finger_case
from softgrip_jax.errors import InputError
from softgrip_jax.pneunet.wall.small_strain import SmallStrainWalls
from softgrip_jax.units import N_mm, kPa, mm

pytest.importorskip("skfem", reason="needs scikit-fem")

from softgrip_jax.verify import bricks, deck_text, decks, equilibrium, kept, rows, run
from softgrip_jax.verify.boxes import divided, facets_on, line, mesh
from softgrip_jax.verify.bricks import deck_of
from softgrip_jax.verify.cell import CellSolid
from softgrip_jax.verify.cover import CoverSolid
from softgrip_jax.verify.shell import Plate
from softgrip_jax.verify.solid import Solid
from softgrip_jax.verify.stretches import Stretches
from softgrip_jax.verify.transfer import place_of

SHELL = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
FINGER = sg.PneuNet.table_5_1("A")
MATERIALS = {
    "neo-Hookean": sg.NeoHookean(mu=100 * kPa),
    "Gent": sg.Gent(mu=100 * kPa, j_m=20.0),
    "Ogden": sg.Ogden(mu=[100 * kPa, 9 * kPa], alpha=[2.0, 8.0]),
}
FREE = """
[scene]
type = "shell.Free"
shell = { a_mm = 16, b_mm = 24, t_m_mm = 2, material = { type = "NeoHookean", mu_kPa = 175 } }

[solve]
pressure_kPa = 4
"""


def silent(share, left):
    pass


# --- the material -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", MATERIALS)
def test_stress_and_tangent_are_derivatives_of_the_energy(name):
    law, rng = Stretches(MATERIALS[name]), np.random.default_rng(0)
    F = np.eye(3) + 0.2 * rng.normal(size=(6, 3, 3))
    F[0], F[1] = np.eye(3), np.diag([1.2, 1.2, 1 / 1.44])  # equal stretches
    q, H, step = 1e4 * rng.normal(size=6), rng.normal(size=(6, 3, 3)), 1e-5

    def energy(F):
        s = np.linalg.svd(F, compute_uv=False)
        J = np.linalg.det(F)
        kept_ = s / J[:, None] ** (1 / 3)
        values = [float(MATERIALS[name].energy(*(jnp.asarray(v) for v in one))) for one in kept_]
        return np.array(values) + q * (J - 1)

    both = law(F, q)
    slope = (energy(F + step * H) - energy(F - step * H)) / (2 * step)
    assert np.allclose(np.einsum("naJ,naJ->n", both.stress, H), slope, rtol=1e-6, atol=1e-3)
    change = (law(F + step * H, q).stress - law(F - step * H, q).stress) / (2 * step)
    tangent = both.tangent.reshape(-1, 3, 3, 3, 3)
    assert np.allclose(np.einsum("nJaLc,ncL->naJ", tangent, H), change, rtol=1e-5, atol=1.0)


def test_forces_of_elements_and_of_the_air_have_their_derivatives():
    box = mesh(np.linspace(0, 1, 3), np.linspace(0, 1.5, 3), np.linspace(0, 0.7, 2))
    solid = Solid(box, sg.NeoHookean(mu=1e5))
    rng = np.random.default_rng(1)
    u, v = 0.02 * rng.normal(size=(2, *solid.X.shape))
    q, step = 1e4 * rng.normal(size=(len(solid.cells), 4)), 1e-5
    _, _, blocks, (B, _) = solid.assemble(u, q)
    own = blocks - np.einsum("enk,ek,emk->enm", B, solid.bulk / solid.mass, B)
    plain = [solid.gather(solid.assemble(u + sign * step * v, q)[0]) for sign in (1, -1)]
    assert np.allclose(solid.matrix(own) @ v.ravel(), (plain[0] - plain[1]) / (2 * step), rtol=1e-6, atol=1e-3)
    top = solid.faces(facets_on(box, 2, 0.7, 1.0))
    assert np.isclose(top.areas.sum(), 1.5)
    assert np.allclose(top.normals, [0, 0, 1])
    # At nodes within the face, where its edge does not matter, the symmetric derivative is the derivative.
    within = np.repeat((np.abs(solid.X[:, 0] - 0.5) < 0.4) & (np.abs(solid.X[:, 1] - 0.75) < 0.7), 3)

    def gathered(forces):
        return np.bincount(solid.dofs[top.elements].ravel(), weights=forces.ravel(), minlength=solid.size)

    change = gathered(solid.push(top, u + step * v)[0] - solid.push(top, u - step * v)[0]) / (2 * step)
    by_u = gathered(np.einsum("fij,fj->fi", solid.push(top, u)[1], v.ravel()[solid.dofs[top.elements]]))
    assert np.allclose(by_u[within], change[within], atol=1e-8 * np.abs(change).max() + 1e-9)


def test_lines_of_cells_end_where_they_should():
    places = line(1.0, 2.0, 5, low=2.0, high=4.0)
    sizes = np.diff(places)
    assert places[0] == 1.0
    assert np.isclose(places[-1], 2.0)
    assert np.isclose(sizes.max() / sizes[-1], 4.0)
    assert np.isclose(sizes.max() / sizes[0], 2.0)
    assert np.allclose(divided(places, 2)[::2], places)


def test_scipy_does_what_pardiso_does(monkeypatch):
    import scipy.sparse as sp

    rng = np.random.default_rng(2)
    half = sp.random(40, 40, 0.2, random_state=rng)
    matrix, right = (half + half.T + 10 * sp.eye(40)).tocsr(), rng.normal(size=40)
    found = [equilibrium.linear_solver()(matrix, right)]
    monkeypatch.setitem(__import__("sys").modules, "pypardiso", None)
    found.append(equilibrium.linear_solver()(matrix, right))
    for one in found:
        assert np.allclose(matrix @ one, right)


# --- shells -----------------------------------------------------------------------------------------------------------


def test_a_thin_plate_under_little_pressure_bends_as_a_plate():
    """Timoshenko and Woinowsky-Krieger, table 35: 0.00254 p (2a)^4 / D for a clamped plate of 1 : 2, D = mu t^3 / 3."""
    shell = sg.FlatShell(a=16 * mm, b=32 * mm, t_m=0.8 * mm, material=sg.NeoHookean(mu=175 * kPa))
    plate = Plate(sg.shell.Free(shell))
    pressure = 1e-5 * kPa
    state, _ = plate.model.newton(equilibrium.State(pressure, plate.model.rest().y, plate.model.rest().q))
    rigidity = 175 * kPa * (0.8 * mm) ** 3 / 3
    assert plate.observe(state)["inflation"] == pytest.approx(0.00254 * pressure * (32 * mm) ** 4 / rigidity, rel=0.01)


@pytest.mark.slow
def test_free_inflation_is_that_of_other_finite_elements():
    """FElupe 11.3, 27-node hexahedra, three meshes: 7.9015 and 15.7501 mm, uncertain by 0.2 %."""
    (low, high) = list(
        run.compare(
            lambda parts: Plate(sg.shell.Free(SHELL), parts), [run.Target(5e3), run.Target(15e3)], (1, 2), silent
        )
    )[-1]
    for one, expected in ((low, 7.9015 * mm), (high, 15.7501 * mm)):
        assert len(one.values) == 2
        off = abs(one.values[-1]["inflation"] - expected)
        assert off < one.mesh_error("inflation") + 0.002 * expected
        assert one.mesh_error("inflation") < 0.002 * expected


@pytest.mark.slow
def test_force_on_a_plane_is_that_of_other_finite_elements():
    """FElupe 11.3: 3.311 N at 5 kPa, uncertain by 0.5 %; the coarse mesh alone, which is 0.4 % above the next one."""
    plate = Plate(sg.shell.FlatContact(SHELL, distance=5 * mm))
    (state,) = plate.follow([run.Target(5e3)])
    values = plate.observe(state)
    assert values["force"] == pytest.approx(3.311, rel=0.01)
    assert values["force_z"] == pytest.approx(values["force"])
    assert values["penetration"] < 1e-3 * mm
    # All that the object takes is missing at the clamp: the air's resultant through the plane of the clamp is p 2a 2b.
    model = plate.model
    reactions = model.balance(state, matrix=False).reactions.reshape(-1, 3)[:, 2].sum() * plate.copies
    assert abs(reactions + 5e3 * 32 * mm * 86 * mm - values["force"]) < 0.02 * values["force"]


@pytest.mark.slow
@pytest.mark.parametrize(("pressure", "force"), [(20.0, 1.2541), (31.0, 2.3693)])
def test_a_chambers_wall_on_a_plane(pressure, force):
    """FElupe 11.3: the wall 10 x 16 x 1.1 mm of type A, mu 136 kPa, a plane at 0.9 mm."""
    scene = sg.pneunet.Chamber(FINGER, inclination=0.0)
    (one,) = list(run.compare(lambda parts: Plate(scene, parts), [run.Target(pressure * 1e3)], (1, 2), silent))[-1]
    assert abs(one.values[-1]["force"] - force) < one.mesh_error("force") + 0.01 * force


@pytest.mark.slow
def test_inclined_walls_press_along_the_normal_of_their_plane():
    """A wall that hardly inclines presses as a parallel one, a quarter of which is looked at; the axis along which it
    inclines is its height, 2a."""
    forces = {}
    for inclination in (0.0, 1e-6, 0.05):
        plate = Plate(sg.pneunet.Chamber(FINGER, inclination=inclination))
        assert plate.mirrors == (True, inclination == 0)
        edge = plate.sizes[1] * np.array([-1.0, 1.0])
        gaps = [float(plate.obstacle.distance(np.array([0.0, y, 0.0]))) for y in edge]
        assert sorted(gaps) == pytest.approx([0.9 * mm, 0.9 * mm + 10 * mm * np.sin(inclination)])
        (state,) = plate.follow([run.Target(20e3)])
        values = forces[inclination] = plate.observe(state)
        assert abs(values["force_y"] / values["force_z"]) == pytest.approx(np.tan(inclination), abs=1e-9)
    assert forces[1e-6]["force"] == pytest.approx(forces[0.0]["force"], rel=1e-3)
    assert 0 < forces[0.05]["force"] < 0.9 * forces[0.0]["force"]


def test_walls_that_overlap_are_one_sentence():
    with pytest.raises(InputError, match=r"^the walls overlap by 0\.\d+ mm before there is any pressure\.$"):
        Plate(sg.pneunet.Chamber(FINGER, inclination=-0.12))


@pytest.mark.slow
def test_a_tilted_plane_is_pressed_along_its_normal():
    square = sg.FlatShell(a=16 * mm, b=16 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
    plate = Plate(sg.shell.InclinedContact(square, distance=5 * mm, angle=0.17))
    assert plate.mirrors == (False, True)
    (state,) = plate.follow([run.Target(15e3)])
    values = plate.observe(state)
    assert values["force_x"] / values["force_z"] == pytest.approx(np.tan(0.17))


# --- the cell of a finger ---------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_straight_cell_is_that_of_other_finite_elements():
    """FElupe 11.3, type A at 15 kPa, three meshes: M 7.386 N mm, F 0.8896 N, uncertain by 1 %."""
    (one,) = list(run.compare(lambda parts: CellSolid(FINGER, parts), [run.Target(15e3, 0.0)], (1, 2), silent))[-1]
    values = one.values[-1]
    for name, expected in (("moment", -7.386 * N_mm), ("contact_force", 0.8896)):
        assert abs(values[name] - expected) < one.mesh_error(name) + 0.01 * abs(expected)
        assert one.mesh_error(name) < 0.03 * abs(expected)
    assert values["stretch"] == pytest.approx(1.0252, abs=0.001)


def test_a_cell_without_pressure_is_bent_by_a_moment_alone():
    """FElupe 11.3: EI 105.3 to 105.7 N mm^2 at rest; one coarse mesh."""
    cell = CellSolid(FINGER)
    model = cell.model
    (bent,) = model.follow(model.rest(), [(0.0, 0.1)], cell.most)
    assert cell.observe(bent)["moment"] == pytest.approx(0.1 * 105.5 * N_mm * mm, rel=0.02)


@pytest.mark.slow
def test_a_cell_bends_freely_where_its_moment_vanishes():
    """FElupe 11.3: 0.08502 / mm at 31 kPa; one coarse mesh."""
    cell = CellSolid(FINGER)
    *_, free = cell.follow([run.Target(31e3, 40.0), run.Target(31e3, free=True)])
    values = cell.observe(free)
    assert values["free_curvature"] == pytest.approx(85.02, rel=0.03)
    assert abs(values["moment"]) < 1e-3 * 21.5 * N_mm


def test_moments_are_the_derivative_of_the_work():
    """M = dPi/dphi at a constant pressure, so by the pressure dM/dp = -dV/dphi: here M over an arc against energies."""
    cell = CellSolid(FINGER)
    model = cell.model

    def energy(bend):
        (state,) = model.follow(model.rest(), [(0.0, bend)], cell.most)
        F = model.solid.gradients_of(model.displacement(state.y))
        s = np.linalg.svd(F, compute_uv=False)
        s = s / np.linalg.det(F)[..., None] ** (1 / 3)
        W = 0.5 * float(FINGER.material.mu) * (np.sum(s**2, axis=2) - 3)
        return 2 * float(np.sum(W * model.solid.weights)), cell.observe(state)["moment"]

    (low, _), (_, moment), (high, _) = (energy(bend) for bend in (19.0, 20.0, 21.0))
    assert moment == pytest.approx((high - low) / (2.0 * cell.x_B), rel=2e-3)


# --- the cover --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("moment", [5.93, pytest.param(8.0, marks=pytest.mark.slow)])
def test_a_cover_with_a_held_tip(moment):
    """FElupe 11.3, 9-node quadrilaterals in plane strain, 77 x 5 x 20 mm: 0.12663 and 0.19279 N."""
    cover = CoverSolid(FINGER, moment * N_mm)
    (state,) = cover.follow([run.Target(31e3)])
    values = cover.observe(state)
    assert values["moment"] == pytest.approx(moment * N_mm, rel=1e-3)
    assert values["tip_force"] == pytest.approx({5.93: 0.12663, 8.0: 0.19279}[moment], rel=0.005)


def test_a_moment_beyond_the_fold_has_no_state():
    assert list(CoverSolid(FINGER, 100 * N_mm).follow([run.Target(31e3)])) == []


def test_a_cover_is_compared_where_one_moment_acts_on_it():
    """Walls that incline give every part a moment of its own: 5.9 to 2.7 N mm along type A at 31 kPa."""
    inclining = finger_case(sg.pneunet.TipContact(FINGER, inclination="gap"), 5e3, "")
    assert len(inclining.parts) == 1
    assert "the beam itself is not: as the walls incline" in " ".join(inclining.remarks)
    assert finger_case(sg.pneunet.Free(FINGER), 5e3, "").remarks == ()


@pytest.mark.slow
def test_a_held_cover_is_compared():
    parallel = finger_case(sg.pneunet.TipContact(FINGER, inclination="none"), 5e3, "")
    assert (len(parallel.parts), parallel.remarks) == (2, ())


# --- what is kept -----------------------------------------------------------------------------------------------------


def table(pressures, errors, quantity="inflation", curvature=None, model="arc"):
    made = [
        rows.Row(quantity, "length", p, curvature, {model: 2.0 * (1 + e)}, 2.0, 0.02, 1.0)
        for p, e in zip(pressures, errors, strict=True)
    ]
    return [row.as_data() for row in made]


def test_a_design_near_a_verified_one_has_its_error(tmp_path):
    kept.keep(sg.shell.Free(SHELL), table([5e3, 15e3], [-0.1, -0.2]), tmp_path)

    def said(pressure=10e3, model="arc", **changes):
        fields = {"a": 16 * mm, "b": 43 * mm, "t_m": 1.1 * mm, "material": SHELL.material} | changes
        return fidelity.against_elements(sg.shell.Free(sg.FlatShell(**fields), model=model), pressure, tmp_path)

    near = said(a=16.8 * mm)["inflation"]
    assert near.error == pytest.approx(-0.15)
    assert near.mesh_error == pytest.approx(0.01)
    assert near.distance == pytest.approx(0.8 / 16.8)
    assert "-15 %" in str(near)
    assert said(a=18 * mm) == {}
    assert said(material=sg.NeoHookean(mu=200 * kPa)) == {}
    assert said(material=sg.Gent(mu=175 * kPa, j_m=20.0)) == {}
    assert said(pressure=20e3) == {}
    assert said(model="energy") == {}
    assert fidelity.against_elements(sg.shell.FlatContact(SHELL, distance=5 * mm), 10e3, tmp_path) == {}


def test_the_nearest_design_speaks(tmp_path):
    for a, error in ((15.5 * mm, -0.3), (16 * mm, -0.1)):
        shell = sg.FlatShell(a=a, b=43 * mm, t_m=1.1 * mm, material=SHELL.material)
        kept.keep(sg.shell.Free(shell), table([10e3], [error]), tmp_path)
    near = fidelity.against_elements(sg.shell.Free(SHELL), 10e3, tmp_path)
    assert near["inflation"].error == pytest.approx(-0.1)


def test_a_finger_has_the_errors_of_its_straight_cell(tmp_path):
    scene = sg.pneunet.TipContact(FINGER)
    both = [
        *table([31e3], [-0.7], "moment", 0.0, "thesis"),
        *table([31e3], [-0.9], "moment", 20.0, "thesis"),
    ]
    kept.keep(sg.pneunet.Free(FINGER), both, tmp_path)
    assert fidelity.against_elements(scene, 31e3, tmp_path)["moment"].error == pytest.approx(-0.7)


@pytest.mark.parametrize(
    ("verified", "other", "quantity"),
    [
        (
            sg.pneunet.TipContact(FINGER, moment_spread="none"),
            sg.pneunet.TipContact(FINGER, moment_spread="root"),
            "moment",
        ),
        (sg.pneunet.TipContact(FINGER), sg.pneunet.TipContact(FINGER, section="thesis"), "moment"),
        (sg.pneunet.Chamber(FINGER, inclination=0.3), sg.pneunet.Chamber(FINGER, inclination=0.0), "force"),
        (sg.shell.Free(SHELL, model="energy"), sg.shell.Free(SHELL, model="energy", bending=False), "inflation"),
        (
            sg.shell.Free(SHELL, model="energy"),
            dataclasses.replace(sg.shell.Free(SHELL).energy_scene(), across=2, lengthwise=3),
            "inflation",
        ),
    ],
)
def test_another_model_of_the_same_design_is_not_near(verified, other, quantity, tmp_path):
    model = "energy" if quantity == "inflation" else "thesis"
    curvature = 0.0 if quantity == "moment" else None
    kept.keep(verified, table([10e3, 20e3], [-0.5, -0.5], quantity, curvature, model), tmp_path)
    near = fidelity.against_elements(verified, 15e3, tmp_path)[quantity]
    assert (near.error, near.distance) == (-0.5, 0.0)
    assert fidelity.against_elements(other, 15e3, tmp_path) == {}


def test_an_inclination_is_a_number_of_a_chamber(tmp_path):
    kept.keep(sg.pneunet.Chamber(FINGER, inclination=0.3), table([10e3], [-0.5], "force", None, "thesis"), tmp_path)
    near = fidelity.against_elements(sg.pneunet.Chamber(FINGER, inclination=0.285), 10e3, tmp_path)["force"]
    assert near.distance == pytest.approx(0.05)


def test_of_walls_of_ones_own_nothing_was_verified(tmp_path):
    class Mine(SmallStrainWalls):
        factor: jax.Array = eqx.field(default_factory=lambda: jnp.asarray(2.0))

    kept.keep(sg.pneunet.Free(FINGER), table([10e3], [-0.7], "moment", 0.0, "thesis"), tmp_path)
    assert fidelity.against_elements(sg.pneunet.TipContact(FINGER, drive=Mine()), 10e3, tmp_path) == {}


@pytest.mark.parametrize("change", [None, {"numbers": [1]}, {"rows": [{}]}, {"rows": 1}])
def test_what_is_no_verification_is_named(change, tmp_path):
    file = kept.keep(sg.shell.Free(SHELL), table([10e3], [-0.1]), tmp_path)
    record = {} if change is None else json.loads(file.read_text(encoding="utf-8")) | change
    (tmp_path / "notes.json").write_text(json.dumps(record), encoding="utf-8")
    with pytest.raises(InputError, match=r"notes\.json is no verification"):
        fidelity.against_elements(sg.shell.Free(SHELL), 10e3, tmp_path)


def test_no_state_has_a_mesh_error_by_accident():
    found = []
    for pressure, coarse, fine in ((5e3, 1.0, 1.0), (10e3, 2.2, 2.0)):
        made = run.Found(run.Target(pressure), [{"inflation": coarse}, {"inflation": fine}], [1.0, 2.0], parts=(1, 2))
        found.append(made)
    told = rows.rows_of(found, {"inflation": "length"}, {"arc": [{"inflation": 1.1}, {}]})
    assert [row.pressure for row in told] == [5e3]  # of the other the model says nothing
    told = rows.rows_of(found, {"inflation": "length"}, {"arc": [{"inflation": 1.1}, {"inflation": 1.9}]})
    assert [row.mesh_error for row in told] == pytest.approx([0.2, 0.1])
    assert [row.difference("arc") for row in told] == pytest.approx([-0.05, 0.1])
    assert run.Found(run.Target(5e3), [{"x": 1.0}, {"x": 1.1}, {"x": 1.2}], parts=(1, 2, 3)).mesh_error(
        "x"
    ) == pytest.approx(0.2)


# --- the command ------------------------------------------------------------------------------------------------------


@pytest.fixture
def quick_mesh(monkeypatch):
    """A plate of few elements, where what is done with the numbers is the subject."""
    monkeypatch.setattr("softgrip_jax.verify.shell.ACROSS", 3)
    monkeypatch.setattr("softgrip_jax.verify.shell.ALONG", 3)


def test_the_command_writes_a_folder_that_fidelity_reads(quick_mesh, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("softgrip_jax.commands.verify.SHARES", (1.0,))
    monkeypatch.setattr("softgrip_jax.commands.verify.remarks", lambda found: ["A mesh was left out."])
    (tmp_path / "free.toml").write_text(FREE, encoding="utf-8")
    assert cli.run(["verify", "free.toml", "--out", "seen", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["remarks"] == ["A mesh was left out."]
    assert {path.name for path in (tmp_path / "seen").iterdir()} == {"result.json", "table.csv", "shapes.png"}
    inflation = next(row for row in told["rows"] if row["quantity"] == "inflation")
    assert set(inflation["models"]) == {"arc", "energy"}
    assert inflation["pressure"] == 4e3
    assert abs(inflation["differences"]["energy"]) < 0.1
    assert cli.run(["solve", "free.toml"]) == 0
    words = r"inflation: [+-][\d.]+ % against finite elements.*, from a verification of this design: verified"
    assert re.search(words, capsys.readouterr().out)
    assert cli.run(["verify", "free.toml", "--out", "seen"]) == cli.MISTAKE
    assert "seen exists already" in capsys.readouterr().err


def test_where_it_shall_be_kept_is_looked_at_first(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("softgrip_jax.commands.verify.case_of", lambda *_: pytest.fail("the work has begun"))
    (tmp_path / "free.toml").write_text(FREE, encoding="utf-8")
    assert cli.run(["verify", "free.toml", "--keep", "free.toml"]) == cli.MISTAKE
    told = capsys.readouterr().err
    assert "kept in free.toml" in told
    assert "--keep" in told
    assert "--out" not in told


def test_ctrl_c_keeps_what_is_there(quick_mesh, tmp_path, monkeypatch, capsys):
    from softgrip_jax.commands import verify

    monkeypatch.chdir(tmp_path)
    (tmp_path / "free.toml").write_text(FREE, encoding="utf-8")

    monkeypatch.setattr(verify, "SHARES", (1.0,))
    monkeypatch.setattr("softgrip_jax.verify.rows.shell_models", lambda scene: {"arc": scene})

    def interrupted(share, left):
        if share > 0.5:
            raise KeyboardInterrupt

    monkeypatch.setattr(verify, "watched", lambda tell: interrupted)
    assert cli.run(["verify", "free.toml", "--out", "seen"]) == cli.STOPPED
    assert "stopped." in capsys.readouterr().err
    found = json.loads((tmp_path / "seen" / "result.json").read_text(encoding="utf-8"))
    assert found["stopped"]
    assert {row["pressure"] for row in found["rows"] if row["mesh_error"] is None}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ("pressure_kPa = 0", "pressure_kPa is 0"),
        ("pressure_kPa = 4000", "no equilibrium"),
    ],
)
def test_pressures_that_cannot_be_verified_are_one_sentence(quick_mesh, change, words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("softgrip_jax.verify.rows.model_values", lambda models, targets: {})
    monkeypatch.setattr("softgrip_jax.verify.equilibrium.LEAST_STEP", 0.01)
    (tmp_path / "free.toml").write_text(FREE.replace("pressure_kPa = 4", change), encoding="utf-8")
    assert cli.run(["verify", "free.toml"]) == cli.MISTAKE
    told = capsys.readouterr().err
    assert words in told
    assert "Traceback" not in told
    assert not (tmp_path / "runs").exists() or not list((tmp_path / "runs").iterdir())


@pytest.mark.parametrize(
    ("changes", "words"),
    [({"h_x": 0.0}, "h_x is 0 mm"), ({"t_m": 2.2 * mm}, "half of h_L"), ({"b": 10.5 * mm}, "half of B")],
)
def test_fingers_that_are_no_solid_are_one_sentence(changes, words):
    fields = {name: getattr(FINGER, name) for name in ("a", "b", "h_x", "t_m", "h_L", "H", "B", "L")} | changes
    with pytest.raises(InputError, match=words):
        CellSolid(sg.PneuNet(**fields, material=FINGER.material))


def test_segments_of_their_own_are_refused():
    fields = {name: getattr(FINGER, name) for name in ("a", "b", "h_x", "h_L", "H", "B", "L")}
    with pytest.raises(InputError, match="segments of its own"):
        CellSolid(sg.PneuNet(**fields, t_m=[1 * mm, 1.2 * mm], material=FINGER.material))


# --- decks ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("format", decks.FORMATS)
def test_a_deck_has_every_node_face_and_number(format, tmp_path, monkeypatch):
    monkeypatch.setattr(bricks, "PARTS", 1)
    path = tmp_path / "deck"
    decks.write_deck(sg.shell.FlatContact(SHELL, distance=5 * mm), 15e3, format, path)
    text = path.read_text(encoding="utf-8")
    plate = deck_of(sg.shell.FlatContact(SHELL, distance=5 * mm), 15e3).bricks
    assert [(side, len(faces)) for side, faces in plate.pressed.items()] == [(0, 8 * 12)]
    assert [(side, len(faces)) for side, faces in plate.touching.items()] == [(1, 8 * 12)]
    assert plate.cells.shape == (8 * 12, 20)
    if format == "febio":
        from xml.etree import ElementTree

        tree = ElementTree.fromstring(text)
        (plate_nodes, object_nodes) = tree.findall("Mesh/Nodes")
        assert len(plate_nodes) == len(plate.nodes)
        assert sorted({float(node.text.split(",")[2]) for node in object_nodes}) == pytest.approx([5.0, 6.1])
        assert float(tree.find("Loads/surface_load/pressure").text) == pytest.approx(0.015)
        assert float(tree.find("Material/material/c1").text) == pytest.approx(0.0875)
    else:
        assert text.count("*ELEMENT") == 2
        assert "*HYPERELASTIC, NEO HOOKE\n0.0875," in text
        assert "PRESSED1, P1, 0.015" in text
        assert ("C3D20RH" in text) == (format == "abaqus")


def test_every_law_of_a_deck_has_our_shear_modulus():
    """mu = 2 C10, 2 (C10 + C01), 2 C10 and sum mu_i of the programs' definitions."""
    for material, modulus in (
        (sg.MooneyRivlin(c1=60 * kPa, c2=8 * kPa), lambda v: 2 * (v[0] + v[1])),
        (sg.Yeoh(c1=68 * kPa, c2=2 * kPa), lambda v: 2 * v[0]),
        (MATERIALS["Ogden"], lambda v: v[0] + v[2]),
    ):
        values = [float(v) for v in ",".join(deck_text._hyperelastic(material, "Abaqus")[1:]).split(",")]
        assert 1e6 * modulus(values) == pytest.approx(float(material.shear_modulus()))


@pytest.mark.parametrize(
    ("scene", "format", "words"),
    [
        (sg.shell.Free(SHELL), "ansys", "must be one of abaqus"),
        (sg.pneunet.Free(FINGER), "ansys", "must be one of abaqus"),
        (sg.pneunet.Cell(FINGER, axial_force=0.2), "abaqus", "Cell.axial_force is 0.2 N"),
        (sg.shell.Plate(SHELL), "abaqus", "Plate has no input deck"),
        (
            sg.shell.Free(sg.FlatShell(16 * mm, 43 * mm, 1.1 * mm, sg.Gent(mu=175 * kPa, j_m=20.0))),
            "abaqus",
            "^a deck for Abaqus is written for NeoHookean, MooneyRivlin, Yeoh and Ogden of at most 3 terms; "
            r"the material is Gent\.$",
        ),
        (
            sg.shell.Free(sg.FlatShell(16 * mm, 43 * mm, 1.1 * mm, sg.Ogden(mu=[50 * kPa] * 4, alpha=[2, 3, 4, 5]))),
            "calculix",
            r"^a deck for CalculiX is written for .* Ogden of at most 3 terms; the material is Ogden of 4 terms\.$",
        ),
        (
            sg.shell.Free(sg.FlatShell(16 * mm, 43 * mm, 1.1 * mm, MATERIALS["Ogden"])),
            "febio",
            r"^a deck for FEBio is written for NeoHookean and MooneyRivlin; the material is Ogden of 2 terms\.$",
        ),
    ],
)
def test_decks_that_cannot_be_written_are_one_sentence(scene, format, words, tmp_path):
    with pytest.raises(InputError, match=words):
        decks.write_deck(scene, 15e3, format, tmp_path / "deck")
    assert not list(tmp_path.iterdir())


def displacements(path, node):
    """Of a node at the end of the run, from CalculiX's tables."""
    lines = path.read_text(encoding="utf-8").splitlines()
    found = [line.split() for line in lines if line.split()[:1] == [str(node)]]
    return np.array([float(v) for v in found[-1][1:4]])


@pytest.mark.parametrize("curvature", [0.0, 60.0, -25.0])
def test_the_cut_of_a_cells_deck_stays_in_its_plane(curvature, monkeypatch):
    """Any displacements that obey the deck's equations leave the cut in a plane, which the touched plane goes on with;
    at rest nothing has moved, at the end its normal is that of the curvature."""
    monkeypatch.setattr(bricks, "PARTS", 1)
    deck = deck_of(sg.pneunet.Cell(FINGER, curvature=curvature), 15e3)
    assert {side: len(faces) for side, faces in deck.bricks.pressed.items()} == {0: 4, 2: 3, 4: 3, 5: 12}
    assert {side: len(faces) for side, faces in deck.bricks.touching.items()} == {3: 20}
    X = np.concatenate([deck.bricks.nodes, deck.body.nodes])
    (cut,) = (nodes for what, _, nodes in deck.bricks.held if what == "CUT")
    x_B = 1e3 * float(0.5 * FINGER.h_L + FINGER.h_x)
    assert np.all(X[cut, 0] == pytest.approx(x_B))
    phi = curvature * 1e-3 * x_B
    for part, angle in ((0.0, 0.0), (1.0, phi)):
        u = np.random.default_rng(1).normal(size=X.shape) * (0.0 if part == 0 else [0.1, 0.1, 0.0])
        for tie in reversed(deck.ties):  # nodes of the plane first, on which the others rest
            node, axis = tie.node
            u[node, axis] = sum(by * u[other, along] for other, along, by in tie.others) + part * tie.moved
        n = np.array([np.cos(angle), -np.sin(angle)])
        places = (X + u)[:, :2] @ n
        front = len(deck.bricks.nodes) + np.arange(4)
        assert np.ptp(places[np.concatenate([cut, front])]) < 1e-12
        assert np.ptp(places[front + 4] - places[front]) < 1e-12
    lengths = [np.linalg.norm((X + u)[a] - (X + u)[b]) for a, b in zip(front, np.roll(front, 1), strict=True)]
    assert sorted(lengths)[0] == pytest.approx(sorted(np.ptp(deck.body.nodes, axis=0))[1])


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("ccx") is None, reason="needs CalculiX")
@pytest.mark.parametrize(("curvature", "pressure"), [(0.0, 5e3), (40.0, 5e3)])
def test_calculix_finds_the_moment_of_a_cell(curvature, pressure, tmp_path, monkeypatch):
    """Its bricks of 20 nodes are 3 % off without contact on the first mesh, 9 % with it; 0.2 and 5 % on the second."""
    monkeypatch.setattr(bricks, "PARTS", 1)
    scene = sg.pneunet.Cell(sg.PneuNet.table_5_1("A"), curvature=curvature)
    decks.write_deck(scene, pressure, "calculix", tmp_path / "cell.inp")
    subprocess.run(["ccx", "cell"], cwd=tmp_path, check=True, capture_output=True, timeout=1200)
    deck, tables = deck_of(scene, pressure), last_tables(tmp_path / "cell.dat")
    half = CellSolid(scene.finger, 1)
    (state,) = half.follow([run.Target(pressure, curvature)])
    phi = curvature * half.x_B
    n, t = np.array([np.cos(phi), -np.sin(phi)]), np.array([np.sin(phi), np.cos(phi)])
    (cut,) = (nodes for what, _, nodes in deck.bricks.held if what == "CUT")
    moment, along = 0.0, 0.0
    for nodes, X, where in (
        (cut, deck.bricks.nodes[cut], ("SOLID", "CUT")),
        (len(deck.bricks.nodes) + np.arange(8), deck.body.nodes, ("OBJECT", "OBJECT")),
    ):
        x = X[:, :2] + np.array([tables["displacements", where[0]][node][:2] for node in nodes])
        force = np.array([tables["forces", where[1]][node][:2] for node in nodes])
        moment += 2 * float(np.sum((force @ n) * (x @ t) - (force @ t) * (x @ n)))
        along += float(np.sum(force @ n))
    ours = half.observe(state)
    assert abs(along) < 1e-6
    assert 1e-3 * moment == pytest.approx(ours["moment"], rel=0.1 if curvature == 0 else 0.04)


def last_tables(path):
    """{(what, set): {node from 0: values}} of the last increment in CalculiX's tables."""
    found, now = {}, None
    for row in path.read_text(encoding="utf-8").splitlines():
        words = row.split()
        if words[:1] in (["displacements"], ["forces"]):
            now = found[words[0], row.split("for set")[1].split()[0]] = {}
        elif words[:1] == ["total"]:
            now = None
        elif words and now is not None:
            now[int(words[0]) - 1] = np.array([float(value) for value in words[1:4]])
    return found


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("ccx") is None, reason="needs CalculiX")
def test_calculix_finds_what_we_find(tmp_path):
    scene, pressure = sg.shell.Free(SHELL), 5e3
    decks.write_deck(scene, pressure, "calculix", tmp_path / "free.inp")
    subprocess.run(["ccx", "free"], cwd=tmp_path, check=True, capture_output=True, timeout=1200)
    plate = Plate(scene)
    (state,) = plate.follow([run.Target(pressure)])
    plate = deck_of(scene, pressure).plate
    middle = int(np.argmin(np.linalg.norm(plate.nodes - [0.0, 0.0, -0.55], axis=1)))
    theirs = displacements(tmp_path / "free.dat", middle + 1)[2] * mm
    solid, u = plate.model.solid, plate.model.displacement(state.y)
    ours = place_of(solid, u, plate.nodes[middle] * mm)[2] - plate.nodes[middle, 2] * mm
    # Twenty-node plate with reduced integration were 0.5 to 1.1 % stiffer in a study of meshes.
    assert theirs == pytest.approx(ours, rel=0.012)


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("ccx") is None, reason="needs CalculiX")
def test_calculix_finds_the_force_on_a_plane(tmp_path, monkeypatch):
    """FElupe 11.3: 3.311 N at 5 kPa; CalculiX's bricks on the first mesh are up to two percent off."""
    monkeypatch.setattr(bricks, "PARTS", 1)
    decks.write_deck(sg.shell.FlatContact(SHELL, distance=5 * mm), 5e3, "calculix", tmp_path / "flat.inp")
    subprocess.run(["ccx", "flat"], cwd=tmp_path, check=True, capture_output=True, timeout=1200)
    lines = (tmp_path / "flat.dat").read_text(encoding="utf-8").splitlines()
    last = max(i for i, line in enumerate(lines) if "total force" in line and "OBJECT" in line)
    assert "0.1000000E+01" in lines[last]
    assert -4 * float(lines[last + 2].split()[2]) == pytest.approx(3.311, rel=0.02)
