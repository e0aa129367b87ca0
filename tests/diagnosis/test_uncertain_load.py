"""What a known load may be off is no cause."""

import numpy as np
import pytest
from diagnosis_cases import among

import dryfric_control as dfc
from dryfric_control.diagnosis.invariants import in_free_runs
from dryfric_control.diagnosis.problem import Problem
from dryfric_control.estimation.likelihood import prepare
from dryfric_control.estimation.windows import cut

AXIS = dfc.FrictionAxis(mass=1.0, viscous=2.0, coulomb=3.0)
T = 2e-3 * np.arange(4000)
U = 8.0 * np.sin(3.0 * T) + 3.0 * np.sin(11.0 * T)
ERRORS = 0.3 * np.array([np.sin(2.0 * np.pi * 0.5 * T + 0.4), np.cos(0.7 * T)])


def recorded(axis=AXIS, error=1.2 * ERRORS[0]):
    load = 0.5 * np.cos(0.9 * T)
    x = axis.simulate(U, dt=T[1], load=load + error).y[0]
    return dfc.Record(T, U, 1e-6 * np.round(1e6 * x), load=load)


@pytest.mark.slow
def test_what_a_load_may_be_off_is_no_cause():
    record = recorded()
    with among("time_periodic", "viscous_asymmetry"):
        alone = dfc.diagnose(AXIS, record, progress=False)
        found = dfc.diagnose(AXIS, record, progress=False, load_errors=ERRORS)
    assert "time_periodic" in [cause.effect for cause in alone.causes]
    assert found.causes == () and found.verdict == "nothing to find"
    assert not any(name.startswith("load_error") for name in found.standard_errors)


@pytest.mark.slow
def test_a_cause_beside_a_load_that_is_off_is_found_and_the_load_corrected():
    machine = AXIS.replace(effects=(dfc.effects.Spring(stiffness=4.0, rest=0.3),))
    record = recorded(machine)
    with among("spring", "time_periodic"):
        found = dfc.diagnose(AXIS, record, progress=False, load_errors=ERRORS)
    assert [cause.effect for cause in found.causes] == ["spring"]
    assert found.verdict == "explained"
    assert found.causes[0].parameters["stiffness"] == pytest.approx(4.0, rel=0.02)
    off = found.record.known_load - record.known_load
    np.testing.assert_allclose(off, 1.2 * ERRORS[0], atol=0.03)  # a hundredth of the level
    assert "within what it may be off" in found.record.notes[-1]


def test_free_runs_are_under_the_load_that_was_found():
    """Else what the load is off hides a cause that is small beside it."""
    machine = AXIS.replace(effects=(dfc.effects.Spring(stiffness=0.1, rest=0.3),))
    record = recorded(machine)
    runs = (prepare(record, load_errors=ERRORS),)
    problem = Problem(AXIS, runs, windows=(cut(record, 0.25, "zero"),))
    less = problem.fit(AXIS)
    more = problem.fit(machine, ("spring.stiffness",))
    fall, error = in_free_runs(problem, less, more)
    # Logarithms of squares: the errors fall by a factor of more than 4, beside the wrong load of 1.3.
    assert fall > 3.0 and fall > 2.0 * error


@pytest.mark.parametrize(
    ("errors", "said"),
    [
        (ERRORS[:, :-1], r"shape \(k, 4000\).* got shape \(2, 3999\)"),
        (ERRORS[0], r"got shape \(4000,\)"),
        (ERRORS * np.nan, "finite"),
    ],
)
def test_errors_of_another_shape_are_refused(errors, said):
    with pytest.raises(ValueError, match=f"load_errors must be .*{said}|load_errors .*{said}"):
        dfc.diagnose(AXIS, recorded(), load_errors=errors)


def test_they_are_of_one_record_and_of_joints_that_are_there():
    record = recorded()
    with pytest.raises(ValueError, match="one by one"):
        dfc.diagnose(AXIS, [record, recorded(error=0.0)], load_errors=ERRORS)
    with pytest.raises(ValueError, match="'wrist' is no joint; they are elbow"):
        dfc.diagnose_joints({"elbow": (AXIS, record)}, load_errors={"wrist": ERRORS})
