"""A batch of solutions as a sequence, as text and as tables of other packages."""

import html.parser
import re

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import softgrip_jax as sg
from softgrip_jax.results import Solution
from softgrip_jax.units import kPa, mm

SHELL = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
PLANE = sg.shell.FlatContact(SHELL, distance=5 * mm)
PRESSURES = np.linspace(0, 40, 25) * kPa
FINGER = sg.pneunet.Linear(sg.PneuNet.table_5_1("A"))


@pytest.fixture(scope="module")
def curve():
    return sg.path(PLANE, PRESSURES)


@pytest.fixture(scope="module")
def grid():
    """Two widths by three pressures: a batch of two axes, solved by two vmaps."""

    def solved(a, pressure):
        shell = sg.FlatShell(a=a, b=43 * mm, t_m=1.1 * mm, material=SHELL.material)
        return sg.solve(sg.shell.FlatContact(shell, distance=5 * mm), pressure)

    rows = jax.vmap(jax.vmap(solved, in_axes=(None, 0)), in_axes=(0, None))
    return jax.jit(rows)(jnp.array([14, 16]) * mm, jnp.array([5, 10, 15]) * kPa)


def assert_same(one, other):
    """Two solutions are equal in every array, NaN included."""
    assert jax.tree.structure(one) == jax.tree.structure(other)
    jax.tree.map(np.testing.assert_array_equal, one, other)


def test_an_index_is_the_state_of_its_own(curve):
    alone = sg.solve(PLANE, PRESSURES[9])
    third = curve[9]
    assert isinstance(third, Solution)
    assert third.status.shape == ()
    for name, value in alone.observables.items():
        np.testing.assert_allclose(getattr(third, name), value, rtol=1e-12)
    assert repr(third.scene) == repr(PLANE)
    assert third.rows()[0] == ("status", "OK")
    assert_same(curve[-1], curve[24])
    shape = third.shape(7)
    np.testing.assert_allclose(shape["x"], alone.shape(7)["x"], atol=1e-12)


def test_what_has_no_state_has_no_shape(curve):
    """At the first pressures the membrane is short of the plane."""
    drawn, solved = curve.shape(7), np.asarray(curve.status) == sg.Status.OK
    assert 0 < solved.sum() < len(curve)
    for values in drawn.values():
        assert np.isfinite(values[solved]).all()
        assert np.isnan(values[~solved]).all()


def test_slices_masks_and_loops(curve):
    assert len(curve) == 25
    part = curve[2:10:3]
    assert (len(part), type(part)) == (3, Solution)
    np.testing.assert_array_equal(part.pressure, PRESSURES[2:10:3])
    held = curve[np.asarray(curve.status) == sg.Status.OK]
    assert np.all(held.status == sg.Status.OK)
    assert 0 < len(held) < 25
    np.testing.assert_array_equal(curve[[3, 1]].pressure, PRESSURES[[3, 1]])
    assert [float(one.pressure) for one in curve] == list(PRESSURES)
    assert len(curve[:0]) == 0
    assert curve[:0]
    with pytest.raises(IndexError, match="25"):
        curve[25]


def test_one_state_is_no_sequence():
    alone = sg.solve(PLANE, 15 * kPa)
    assert alone
    for ask in (len, iter, lambda one: one[0]):
        with pytest.raises(TypeError, match="this solution is one state of FlatContact"):
            ask(alone)


def test_batches_of_two_axes(grid):
    assert len(grid) == 2
    assert grid[1].status.shape == (3,)
    assert_same(grid[1][2], grid[1, 2])
    assert_same(grid[:, 1][0], grid[0, 1])
    assert float(grid[1, 2].scene.shell.a) == 16 * mm
    assert float(grid[1, 2].force) == pytest.approx(18.3565, abs=1e-4)  # thesis figure 5.2


def test_a_scene_that_was_not_batched_is_kept():
    """As `sg.Solution` is put together by hand: a finger of five segments at five pressures has its own arrays."""
    sizes = jnp.linspace(4, 5, 5) * mm
    table = sg.PneuNet.table_5_1("A")
    finger = sg.PneuNet(sizes, 8 * mm, 0.9 * mm, 1.1 * mm, 4.2 * mm, 5 * mm, 20 * mm, 77 * mm, table.material)
    scene = sg.pneunet.Free(finger, weight=None)
    state = {"tip": jnp.arange(10.0).reshape(5, 2), "tip_angle": jnp.arange(5.0)}
    state |= {name: jnp.zeros(5) for name in ("end_moment", "inclination")}
    zeros = jnp.zeros(5, int)
    why = zeros, jnp.full(5, jnp.nan), {}
    batch = Solution(scene, jnp.arange(5.0), zeros, jnp.zeros(5), zeros, jnp.zeros((5, 7)), state, *why)
    assert_same(batch[3].scene, scene)
    np.testing.assert_array_equal(batch[3].tip, [6.0, 7.0])
    # ... and under vmap every one of its arrays has the axis of the batch in front.
    stacked = jax.tree.map(lambda leaf: jnp.stack([leaf] * 5), scene)
    batched = Solution(stacked, jnp.arange(5.0), zeros, jnp.zeros(5), zeros, jnp.zeros((5, 7)), state, *why)
    assert_same(batched[3].scene, scene)


def test_derivatives_pass_through_an_index():
    def force(scene):
        return sg.path(scene, jnp.array([10, 15]) * kPa)[1].force

    whole = jax.jit(jax.grad(lambda scene: sg.solve(scene, 15 * kPa).force))(PLANE)
    part = jax.jit(jax.grad(force))(PLANE)
    jax.tree.map(lambda one, other: np.testing.assert_allclose(one, other, rtol=1e-10), part, whole)


def test_a_batch_prints_as_a_table(curve, grid):
    text = str(curve)
    lines = text.splitlines()
    counts = {s.name: int(np.sum(np.asarray(curve.status) == s)) for s in sg.Status}
    assert lines[0].startswith("FlatContact, 25 states: ")
    for name, count in counts.items():
        assert (f"{count} {name}" in lines[0]) == (count > 0)
    assert lines[1].split()[:4] == ["pressure", "kPa", "status", "force"]
    assert lines[11].split()[:4] == ["9", "15", "OK", "18.357"]
    assert lines[12] == "... and 15 more"
    assert max(map(len, lines)) <= 110
    assert "clamp angle deg" in lines[-1]
    assert repr(curve) == text
    assert "shell.a mm" in str(grid)
    wide = sg.path(sg.shell.Grasp(SHELL, 20 * mm, 5 * mm, mass=0.5, friction=0.9), PRESSURES[:3])
    assert max(map(len, str(wide).splitlines())) <= 110
    assert str(grid).splitlines()[4].split()[:4] == ["0,", "2", "14", "15"]
    assert "more" not in str(grid)
    assert repr(sg.solve(PLANE, 15 * kPa)) == str(sg.solve(PLANE, 15 * kPa))


def test_what_is_not_known_prints_too(curve):
    printed = []
    jax.eval_shape(lambda one: (printed.append(repr(one)), printed.append(one._repr_html_()), 0.0)[2], curve)
    printed.append(repr(jax.eval_shape(lambda one: one, curve)))
    printed.append(repr(jax.tree.map(lambda _: object(), curve)))
    assert all("Solution" in text for text in printed)


def test_html_is_the_same_table(curve):
    class Table(html.parser.HTMLParser):
        cells: list[str]
        depth = 0

        def handle_starttag(self, tag, attrs):
            self.depth += 1

        def handle_endtag(self, tag):
            self.depth -= 1

        def handle_data(self, data):
            self.cells.append(data)

    parser = Table()
    parser.cells = []
    parser.feed(curve._repr_html_())
    assert parser.depth == 0
    assert parser.cells[0] == str(curve).splitlines()[0]
    assert {"force N", "clamp angle deg", "18.357", "... and 15 more"} <= set(parser.cells)
    assert sg.solve(PLANE, 15 * kPa)._repr_html_().startswith("<pre>FlatContact")


def test_pandas(curve, grid):
    frame = curve.to_pandas()
    assert list(frame.columns[:3]) == ["pressure", "status", "force"]
    np.testing.assert_array_equal(frame["force"], curve.force)
    assert list(frame["status"]) == [sg.Status(int(s)).name for s in curve.status]
    assert frame.attrs["units"]["contact_area"] == "m^2"
    assert set(frame.attrs["units"]) == set(frame.columns) - {"status"}
    table = grid.to_pandas()
    assert table.loc[(1, 2), "shell.a"] == 16 * mm
    assert table.loc[(1, 2), "force"] == float(grid[1, 2].force)
    tip = sg.path(FINGER, PRESSURES[:4]).to_pandas()
    np.testing.assert_array_equal(tip["tip_y"], sg.path(FINGER, PRESSURES[:4]).tip[:, 1])
    assert len(sg.solve(PLANE, 15 * kPa).to_pandas()) == 1


def test_xarray(curve, grid, tmp_path):
    data = grid.to_xarray()
    assert dict(data.sizes) == {"state_0": 2, "state_1": 3}
    assert set(data.coords) == {"pressure", "shell.a"}
    assert (data["force"].attrs["units"], data["shell.a"].attrs["units"]) == ("N", "m")
    np.testing.assert_array_equal(data["force"], grid.force)
    flags = data["status"].attrs
    meanings = dict(zip(flags["flag_values"], flags["flag_meanings"].split(), strict=True))
    assert meanings == {int(s): s.name for s in sg.Status}
    one = curve.to_xarray()
    assert one["force"].dims == ("state",)
    one.to_netcdf(tmp_path / "curve.nc", engine="h5netcdf")
    assert sg.solve(PLANE, 15 * kPa).to_xarray()["force"].shape == ()


def test_a_batch_calls_lapack_for_one_member_after_the_other():
    """jaxlib 0.10 hangs where as many batches are factorised side by side as there are threads."""

    def of_thickness(t_m):
        finger = eqx.tree_at(lambda finger: finger.t_m, sg.PneuNet.table_5_1("A"), t_m)
        return sg.solve(sg.pneunet.TipContact(finger), 20 * kPa).tip_force

    program = jax.jit(jax.vmap(jax.grad(of_thickness))).lower(jnp.linspace(1.0, 1.4, 64) * mm).as_text()
    calls = re.findall(r"custom_call @lapack_\w+\(.*: \(tensor<([\dx]+)xf64>", program)
    assert len(calls) >= 3
    assert all(shape.count("x") == 1 for shape in calls)
