"""A search and a bootstrap on several processes give what one process gives, to the bit."""

import numpy as np
import pytest
from helpers import shell

import optim
import softgrip_jax as sg
from optim.calibration.intervals import bootstrap_fits
from optim.design.islands import evaluator_on
from softgrip_jax.cli import run
from softgrip_jax.units import kPa, mm

pytest.importorskip("distributed")
pytestmark = pytest.mark.filterwarnings("default")  # what Dask warns of is its own


@pytest.fixture(scope="module")
def workers():
    from softgrip_jax.spread import spread_over

    with spread_over(2, None) as spread:
        yield spread


def shells():
    scene = sg.shell.FlatContact(shell(), distance=5 * mm)
    variables = [optim.Variable("shell.t_m", 0.8 * mm, 2 * mm), optim.Variable("shell.a", 12 * mm, 20 * mm)]
    return scene, variables, optim.Quantity("force", at=10 * kPa)


def fingers():
    """Solved from what is known nearby, which the workers are told."""
    scene = sg.pneunet.TipContact(sg.PneuNet.table_5_1("A"), beam=sg.pneunet.Collocation(points=4))
    variables = [optim.Variable("finger.H", 4.5 * mm, 6 * mm), optim.Variable("finger.t_m", 1.0 * mm, 1.3 * mm)]
    return scene, variables, optim.Quantity("tip_force", at=20 * kPa)


@pytest.mark.parametrize("ask", [shells, pytest.param(fingers, marks=pytest.mark.slow)])
def test_a_search_is_the_same_on_workers(workers, ask):
    """Every step has several batches."""

    def problem():
        scene, variables, quantity = ask()
        return optim.Problem(optim.Space({"scene": scene}, variables), [optim.Goal("maximise", quantity)])

    asked = {"starts": 70, "steps": 3, "finishes": 2, "seed": 3}
    alone, spread = optim.search(problem(), **asked), problem()
    with evaluator_on(workers, spread) as evaluator:
        there = optim.search(spread, evaluator=evaluator, **asked)
        busy = workers.client.run(functions_there)
    assert set(busy.values()) == {1}, "a worker had nothing to do"
    assert not spread._programs, "the search solved something itself"
    assert len(alone.designs) == len(there.designs)
    for one, two in zip(alone.designs, there.designs, strict=True):
        for name in ("t", "x", "values", "violations", "margins"):
            assert getattr(one, name).tobytes() == getattr(two, name).tobytes()
    assert alone.paths.tobytes() == there.paths.tobytes()
    assert alone.solves == there.solves


def functions_there():
    from softgrip_jax import spread

    return len(spread._functions)


def test_a_bootstrap_is_the_same_on_workers(workers):
    strain = np.linspace(0.1, 1.0, 10)
    stress = 100 * kPa * (1 + strain - (1 + strain) ** -2) * (1 + 0.02 * np.cos(9 * strain))
    curve = optim.Curve("test", "strip", "stress", "pressure", strain, stress)
    strip = optim.Tension(sg.NeoHookean(mu=150 * kPa))
    moduli = [optim.Variable("material.mu", 10 * kPa, 1000 * kPa, "log")]
    fit = optim.calibrate(optim.Fitting({"strip": strip}, moduli, [curve]), starts=1)
    alone, spread = bootstrap_fits(fit, 45, 7), bootstrap_fits(fit, 45, 7, spread=workers)
    assert len(np.unique(alone)) > 20
    assert alone.tobytes() == spread.tobytes()
    ends = optim.intervals(fit, "bootstrap", 45, 7, spread=workers)
    assert ends.low.tobytes() == optim.intervals(fit, "bootstrap", 45, 7).low.tobytes()


@pytest.mark.parametrize("command", ["design", "calibrate"])
def test_mistakes_are_one_sentence(tmp_path, capsys, command):
    config = tmp_path / "any.toml"
    config.write_text("")
    assert run([command, str(config), "--insecure"]) == 2
    assert "--insecure is given without --scheduler" in capsys.readouterr().err
    assert run([command, str(config), "--scheduler", "tcp://10.0.0.7:8786"]) == 2
    assert "without encryption" in capsys.readouterr().err
