"""What an answer must keep, whatever the nominal values and the number of samples."""

from functools import cache

import numpy as np
import pytest
from diagnosis_cases import among, believed, causes, record
from truth import make_case

import dryfric_control as dfc
from dryfric_control.diagnosis.invariants import unsound
from dryfric_control.diagnosis.problem import Problem
from dryfric_control.estimation.likelihood import prepare

# A cause of each kind: one way, over position, over velocity, in the drive, none.
HIDDEN = ("bias_force", "position_dependence", "quadratic_drag", "actuator_lag", ())
CANDIDATES = (
    "bias_force", "coulomb_asymmetry", "position_dependence", "spring", "quadratic_drag",
    "stribeck", "input_delay", "actuator_lag",
)  # fmt: skip


@cache
def case_of(slug):
    return make_case(slug, 3, "short")


def asked(axis, measured):
    with among(*CANDIDATES):
        return dfc.diagnose(axis, measured, jobs=1, progress=False)


@cache
def plain(slug):
    case = case_of(slug)
    return asked(believed(case), record(case))


def main(found):
    """The main causes that are effects."""
    base = {"inertia", "viscous", "coulomb"}
    return sorted(c.effect for c in found.main_causes if c.effect not in base)


@pytest.mark.slow
@pytest.mark.parametrize("slug", HIDDEN, ids=str)
@pytest.mark.parametrize("change", ["nominal", "sample"])
def test_the_same_main_causes(slug, change):
    case = case_of(slug)
    axis, measured = believed(case), record(case)
    if change == "nominal":
        axis = axis.replace(mass=1.1 * axis.mass, viscous=0.9 * axis.viscous)
    else:
        measured = dfc.Record(case.t[:-1], case.u[:-1], case.x[:-1])
    found = asked(axis, measured)
    assert main(found) == main(plain(slug)), str(found)
    if change != "nominal":
        assert found.verdict == plain(slug).verdict
        assert causes(found) == causes(plain(slug))
    assert found.verdict in ("explained", "nothing to find")


@pytest.mark.slow
@pytest.mark.parametrize("slug", HIDDEN, ids=str)
def test_what_is_explained_is_so(slug):
    found = plain(slug)
    if found.causes:
        assert found.verdict == "explained" and found.gain.ratio > 1.0
    assert found.remaining.rms < 0.2 * found.extended.coulomb.mean
    assert not found.unexplained.significant
    for effect in found.extended.effects:
        assert effect.plausible(found.extended)


# -- one at a time --------------------------------------------------------------------------


@pytest.fixture(scope="module")
def fitted():
    """A fit with a spring that the record shows."""
    axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    machine = axis.replace(effects=(dfc.effects.Spring(stiffness=40.0, rest=0.05),))
    t = 1e-3 * np.arange(3000)
    u = 20.0 * np.sin(6.0 * t) + 12.0 * np.sin(17.0 * t + 1.0)
    x = 1e-6 * np.round(1e6 * machine.simulate(u, dt=1e-3).y[0])
    problem = Problem(axis, (prepare(dfc.Record(t, u, x)),))
    return problem, machine, ("spring.stiffness", "spring.rest")


def test_a_cause_that_the_record_determines_is_sound(fitted):
    problem, machine, own = fitted
    assert unsound(problem, problem.fit(machine, own), "spring", own) == ""


def test_a_cause_without_a_size_is_not(fitted):
    problem, machine, own = fitted
    both = machine.replace(effects=(*machine.effects, dfc.effects.BiasForce(force=0.0)))
    fit = problem.fit(both, (*own, "bias_force.force"))
    assert unsound(problem, fit, "bias_force", ("bias_force.force",)) == "not determined"
    assert unsound(problem, fit, "gravity", ()) == "not in the model"


def test_a_cause_acts_within_the_travel_of_the_record(fitted):
    problem, machine, own = fitted
    far = machine.replace(effects=(dfc.effects.Spring(stiffness=0.1, rest=50.0),))
    likelihood = problem.likelihood(far, own)
    x = problem.runs[0].record.x
    rest = likelihood.axis_at(likelihood.start()).effects[0].rest
    assert x.max() < rest < x.max() + 0.2 * np.ptp(x)
