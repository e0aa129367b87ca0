"""What an answer must keep, whatever the nominal values, the samples, the names and the order."""

from functools import cache

import numpy as np
import pytest
from diagnosis_cases import among, believed, causes, driven, foreign, record
from truth import make_case

import dryfric_control as dfc
from dryfric_control.diagnosis.invariants import unsound
from dryfric_control.diagnosis.problem import Problem
from dryfric_control.estimation.likelihood import prepare
from dryfric_control.model.effects.effect import REGISTRY

# A cause of each kind: one way, over position, over velocity, in the drive, none.
HIDDEN = ("bias_force", "position_dependence", "quadratic_drag", "actuator_lag", ())
CANDIDATES = (
    "bias_force", "coulomb_asymmetry", "position_dependence", "spring", "quadratic_drag",
    "stribeck", "input_delay", "actuator_lag",
)  # fmt: skip


@cache
def case_of(slug):
    return make_case(slug, 3, "short")


def asked(axis, measured, jobs=1, candidates=CANDIDATES):
    with among(*candidates):
        return dfc.diagnose(axis, measured, jobs=jobs, progress=False)


@cache
def plain(slug):
    return asked(believed(case_of(slug)), record(case_of(slug)))


def nominal(axis, measured):
    return axis.replace(mass=1.1 * axis.mass, viscous=0.9 * axis.viscous), measured


def shorter(axis, measured):
    return axis, dfc.Record(measured.t[:-1], measured.u[:-1], measured.x[:-1])


def rounded(axis, measured):
    """The record off by 1e-12 of its range, less than it resolves."""
    noise = 1e-12 * np.random.default_rng(3).standard_normal((2, len(measured)))
    u, x = (v + np.ptp(v) * part for v, part in zip((measured.u, measured.x), noise, strict=True))
    return axis, dfc.Record(measured.t, u, x)


@pytest.mark.slow
@pytest.mark.parametrize("slug", HIDDEN, ids=str)
@pytest.mark.parametrize("change", [nominal, shorter, rounded])
def test_the_answer_is_the_same(change, slug):
    right = plain(slug)
    found = asked(*change(believed(case_of(slug)), record(case_of(slug))))
    new, old = (sorted(foreign([c.effect for c in one.main_causes])) for one in (found, right))
    assert new == old, str(found)
    assert found.verdict in ("explained", "nothing to find")
    if change is not nominal:
        assert found.verdict == right.verdict
        assert causes(found) == causes(right)
    if change is rounded:
        for first, second in zip(right.causes, found.causes, strict=True):
            assert first.alternatives == second.alternatives
            for parameter, error in first.standard_errors.items():
                # Where the cost is rough, a search ends within a standard error of the minimum.
                there = (second.parameters[parameter] - first.parameters[parameter]) / error
                assert abs(there) < 1.0


@pytest.mark.slow
@pytest.mark.parametrize("jobs", [1, 2])
def test_two_calls_agree_and_so_do_one_and_two_jobs(jobs):
    case, first, known = case_of("bias_force"), plain("bias_force"), dict(REGISTRY)
    axis, measured = believed(case), record(case)
    assert asked(axis, measured, jobs).to_json() == first.to_json()
    assert known == REGISTRY and axis == believed(case)


@pytest.mark.slow
def test_the_answer_hangs_on_no_name_and_no_order():
    case = make_case("bias_force", 0, "short")
    rivals = "bias_force coulomb_asymmetry spring quadratic_drag stribeck input_gain".split()
    right = asked(believed(case), record(case), candidates=rivals)
    told = dfc.Record(case.t, case.u, case.x, name="spring")
    classes = dict(REGISTRY)
    REGISTRY.clear()  # until the end of the test
    REGISTRY.update((slug, classes[slug]) for slug in sorted(classes)[::-1])
    found = asked(believed(case).replace(name="spring"), told, candidates=rivals)
    assert causes(found) == causes(right)
    # The order in which candidates are fitted leaves no trace in the numbers.
    assert found.causes[0].parameters == right.causes[0].parameters


# -- one at a time --------------------------------------------------------------------------


@pytest.fixture(scope="module")
def fitted():
    """A fit with a spring that the record shows."""
    axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    machine = axis.replace(effects=(dfc.effects.Spring(stiffness=40.0, rest=0.05),))
    problem = Problem(axis, (prepare(driven(machine)),))
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
