"""When the search for causes ends: what is left to explain, by force, by event, by assumption."""

import numpy as np

import dryfric_control as dfc
from dryfric_control.diagnosis.problem import Problem
from dryfric_control.estimation.likelihood import prepare

DT = 1e-3
AXIS = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)


def spent(machine, push=0.0):
    """Whether nothing is left where the base is fitted to a record of 4 s of a machine."""
    t = DT * np.arange(4000)
    u = np.round(22.0 * np.sin(5.0 * t) + 12.0 * np.sin(16.0 * t + 1.0), 4)
    acts = u.copy()
    acts[2000:2005] += push  # what the record does not contain
    x = 1e-6 * np.round(1e6 * machine.simulate(acts, dt=DT).y[0])
    problem = Problem(AXIS, (prepare(dfc.Record(t, u, x)),))
    return problem.spent(problem.fit(AXIS))


def test_nothing_is_left_of_the_nominal_axis_itself():
    assert spent(AXIS)
    assert spent(AXIS.replace(mass=2.02))


def test_a_force_is_left():
    assert not spent(AXIS.replace(effects=(dfc.effects.BiasForce(0.2),)))


def test_a_single_event_is_left():
    assert not spent(AXIS, push=15.0)


def test_assumptions_that_one_cause_would_spare_are_left():
    # A gain of 0.7 is the same as three base parameters 43 % too small.
    assert not spent(AXIS.replace(effects=(dfc.effects.InputGain(0.7),)))
