"""Every case of the catalogue: the status that it must have, no NaN under OK, and the value of another code."""

import numpy as np
import pytest
from hard_cases import CASES, FINGERS, SHELLS, Hard

import softgrip_jax as sg

OK, NO_CONTACT = sg.Status.OK, sg.Status.NO_CONTACT
SLOW = [case for case in FINGERS if "grasp" in case.name or "heavy" in case.name]
"""Programs that no other test of the default selection compiles."""


def check(case: Hard) -> None:
    """One case against its catalogue."""
    pressure = case.pressure()
    found = sg.solve(case.make(), pressure)
    status = sg.Status(int(found.status))
    assert status in case.status, f"{status.name}"
    values = {name: np.asarray(value) for name, value in found.observables.items()}
    if status is OK:
        assert all(np.all(np.isfinite(value)) for value in values.values())
        assert float(found.residual) <= 1e-12
        if case.truth is not None:
            np.testing.assert_allclose(values[case.observable], case.truth(), rtol=case.tolerance)
    else:
        assert all(np.all(value == 0 if status is NO_CONTACT else np.isnan(value)) for value in values.values())


@pytest.mark.parametrize("case", SHELLS, ids=str)
def test_shell(case):
    check(case)


@pytest.mark.parametrize("case", [case for case in FINGERS if case not in SLOW], ids=str)
def test_finger(case):
    check(case)


@pytest.mark.slow
@pytest.mark.parametrize("case", SLOW, ids=str)
def test_finger_of_its_own_program(case):
    check(case)


def test_every_case_says_what_is_hard():
    assert len({case.name for case in CASES}) == len(CASES) >= 20
    assert all(case.what and case.status for case in CASES)
