"""A known load that may be off: amounts of the record, known to a standard deviation of 1."""

import numpy as np
import pytest

import dryfric_control as dfc
from dryfric_control.estimation.force_view import ForceView, prepare_force
from dryfric_control.estimation.likelihood import Likelihood, load_error_names, prepare
from dryfric_control.estimation.scoring import maximise

AXIS = dfc.FrictionAxis(mass=1.0, viscous=2.0, coulomb=3.0)
T = 2e-3 * np.arange(4000)
U = 8.0 * np.sin(3.0 * T) + 3.0 * np.sin(11.0 * T)
# What the load may be off, and what it is off [N].
ERRORS = 0.3 * np.array([np.sin(1.3 * T), np.cos(0.7 * T)])
AMOUNTS = np.array([1.0, -0.5])
NAMES = ("load_error[0]", "load_error[1]")
BASE = ("mass", "viscous", "coulomb")


@pytest.fixture(scope="module")
def record():
    x = AXIS.simulate(U, dt=T[1], load=AMOUNTS @ ERRORS).y[0]
    return dfc.Record(T, U, 1e-6 * np.round(1e6 * x))


def likelihood(record, errors=ERRORS, names=NAMES):
    return Likelihood(AXIS, (*BASE, *names), [prepare(record, load_errors=errors)])


def test_what_a_load_is_off_is_found(record):
    problem = likelihood(record)
    assert load_error_names(problem.runs) == NAMES
    found = maximise(problem, problem.start())
    values = [found.values()[f"{name}@0"] for name in NAMES]
    # 5 %: a tenth of the friction level in 8 s.
    np.testing.assert_allclose(values, AMOUNTS, atol=0.05)
    np.testing.assert_allclose(problem.load_error(found.z, 0), AMOUNTS @ ERRORS, atol=0.015)
    assert found.axis.coulomb.mean == pytest.approx(3.0, rel=2e-3)
    # The axis is none with a load.
    assert found.axis.effects == ()


def test_without_them_the_load_is_right(record):
    one, two = likelihood(record, names=()), likelihood(record, ERRORS[:0], ())
    assert one.load_error(one.start(), 0).size == 0
    assert one.at(one.start()).cost == two.at(two.start()).cost


def test_what_the_record_does_not_show_stays_as_known(record):
    found = maximise(problem := likelihood(record, 1e-5 * ERRORS), problem.start())
    errors = found.standard_errors()
    for name in NAMES:
        assert abs(found.values()[f"{name}@0"]) < 0.05
        assert errors[f"{name}@0"] == pytest.approx(1.0, abs=0.05)


def test_their_slopes_by_the_recursion_are_those_of_differences(record):
    problem = likelihood(record)
    z = problem.start(0.1)
    point = problem.at(z)
    own = [problem.names.index(name) for name in NAMES]
    linear, exact = (problem.terms(z, point, sides)[1].sum(axis=0) for sides in (0, 2))
    # 10 %: the recursion leaves out that switches move.
    np.testing.assert_allclose(linear[np.ix_(own, own)], exact[np.ix_(own, own)], rtol=0.1, atol=1)


@pytest.mark.parametrize("hold", ["zero", "first"])
def test_of_an_imposed_motion_they_are_taken_off_the_force(record, hold):
    problem = ForceView(AXIS, NAMES, [prepare_force(record, hold, ERRORS)], hold=hold)
    z = problem.start()
    there = z.copy()
    there[:2] = AMOUNTS
    index = problem.runs[0].index
    change = (problem.innovations(there, 0)[0] - problem.innovations(z, 0)[0])[0, index]
    error = AMOUNTS @ ERRORS
    if hold == "zero":
        error = 0.5 * (error + np.append(error[:1], error[:-1]))
    np.testing.assert_allclose(change, -error[index], atol=1e-12)
