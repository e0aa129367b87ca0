"""A law explains a record only if it is the same throughout it."""

import numpy as np
import pytest
from diagnosis_cases import among, driven

import dryfric_control as dfc
from dryfric_control.diagnosis.causes import changing
from dryfric_control.diagnosis.problem import Problem
from dryfric_control.diagnosis.search import Model, Search
from dryfric_control.estimation.likelihood import prepare

AXIS = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)


def changed(first, second):
    """A record of one axis that goes on as another one."""
    t = 2e-3 * np.arange(2000)
    u = 20.0 * np.sin(6.0 * t) + 12.0 * np.sin(17.0 * t + 1.0)
    early = first.simulate(u[:1001], dt=2e-3).y
    x0, v0 = (float(row[-1]) for row in early[:2])
    late = second.simulate(u[1000:], dt=2e-3, x0=x0, v0=v0).y
    x = np.concatenate((early[0, :-1], late[0]))
    return dfc.Record(t, u, 1e-6 * np.round(1e6 * x))


@pytest.mark.slow
def test_friction_that_rises_half_way_is_not_explained():
    record = changed(AXIS.replace(coulomb=9.0), AXIS.replace(coulomb=9.4))
    with among("bias_force"):
        found = dfc.diagnose(AXIS, record, jobs=1, progress=False)
    assert found.verdict == "partly explained", str(found)
    (warning,) = (m for m in found.messages if "half" in m)
    assert "Coulomb level" in warning


def test_a_payload_that_comes_half_way_is_a_change_of_the_mass():
    record = changed(AXIS.replace(mass=2.0), AXIS.replace(mass=2.2))
    problem = Problem(AXIS, (prepare(record),))
    fit = problem.fit(AXIS)
    assert changing(Search(problem), Model(fit), fit) == "mass"


def test_a_cause_that_acts_in_one_half_alone_is_the_same_throughout():
    machine = AXIS.replace(effects=(dfc.effects.Spring(stiffness=40.0, rest=0.05),))
    whole = driven(machine)
    still = np.arange(len(whole)) >= len(whole) // 2
    u = np.where(still, 0.0, whole.u)
    x = 1e-6 * np.round(1e6 * machine.simulate(u, dt=1e-3).y[0])
    problem = Problem(AXIS, (prepare(dfc.Record(whole.t, u, x)),))
    fit = problem.fit(machine, ("spring.stiffness", "spring.rest"))
    search = Search(problem)
    now = search.pruned(Model(fit, ("spring",)))
    assert now.causes == ("spring",)
    assert changing(search, now, now.fit) == ""
