"""Held-out costs and axes of a fit: each half is predicted from the other."""

import numpy as np
import pytest
from scipy.signal import lfilter

import dryfric_control as dfc
from dryfric_control.diagnosis.criterion import evidence
from dryfric_control.diagnosis.problem import Problem
from dryfric_control.estimation.likelihood import Likelihood, prepare
from dryfric_control.estimation.random_force import integrate_autocorrelation, long_run, products
from dryfric_control.estimation.scoring import maximise

DT = 1e-3
AXIS = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)


def driven(machine, seconds=4.0, seed=0, levels=None):
    """A record of a machine under a noisy drive; `levels`: a force on each block of samples."""
    rng = np.random.default_rng(seed)
    t = DT * np.arange(round(seconds / DT))
    u = 24.0 * np.sin(6.0 * t) + 14.0 * np.sin(17.0 * t + 1.0)
    acts = u + 0.3 * rng.standard_normal(t.size)
    acts = acts if levels is None else acts + levels
    x = 1e-6 * np.round(1e6 * machine.simulate(acts, dt=DT).y[0])
    return dfc.Record(t, u, x)


def halves(run):
    """Half of each sample, by the rule that `Solution.cross_validation` states."""
    return np.repeat(np.arange(run.edges.size - 1) // 2 % 2, np.diff(run.edges))


@pytest.fixture(scope="module")
def lopsided():
    """A record whose bias is of one sign in the first half's blocks and of the other elsewhere.

    It is small, as the one Newton step between the halves has a limited length.
    """
    half = halves(prepare(driven(AXIS)))
    record = driven(AXIS, levels=np.where(half == 0, 0.014, -0.014))
    return half, record, fitted(record)


def fitted(record, active=None):
    """The most likely bias, on the samples that are active."""
    axis = AXIS.replace(effects=dfc.effects.BiasForce(force=0.01))
    problem = Likelihood(axis, ("bias_force.force",), [prepare(record, active)])
    return maximise(problem, problem.start(0.1))


def test_parameters_of_each_half_are_those_of_a_fit_without_it(lopsided):
    half, record, found = lopsided
    axes, where = found.held_out_axes(0)
    np.testing.assert_array_equal(where, half)
    first, second = (axis.effects[0].force for axis in axes)
    for k, one in enumerate((first, second)):
        alone = fitted(record, half != k)
        force, error = (d["bias_force.force"] for d in (alone.values(), alone.standard_errors()))
        # One step from the fit of all data; the halves themselves are two errors apart.
        assert one == pytest.approx(force, abs=0.5 * error)
    # Without the first half, whose bias is positive, a negative one is seen.
    assert first < found.values()["bias_force.force"] < second


def test_held_out_costs_are_those_of_the_axes_of_the_other_half(lopsided):
    """Each block as the filter sees it under the axis that was not fitted to it."""
    *_, found = lopsided
    costs, z, half = found.cross_validation
    problem = found.problem
    seen = problem.blocks(0, found.point.out[0])
    for k in (0, 1):
        there = problem.blocks(0, problem.at(z[k]).out[0])
        np.testing.assert_allclose(costs[half == k], there[half == k], rtol=1e-12)
        # With the bias of the other every half is predicted worse than it is fitted.
        assert costs[half == k].sum() > seen[half == k].sum() + 0.5


def test_where_both_halves_agree_little_is_lost():
    found = fitted(driven(AXIS.replace(effects=dfc.effects.BiasForce(force=0.5))))
    for one in found.held_out_axes(0)[0]:
        assert one.effects[0].force == pytest.approx(0.5, abs=0.15)
    lost = found.held_out().sum() - found.problem.blocks(0, found.point.out[0]).sum()
    # Three coordinates, fitted twice: half a unit each is expected.
    assert abs(lost) < 10.0


@pytest.fixture(scope="module")
def plain():
    return Problem(AXIS, (prepare(driven(AXIS, seed=3)),))


def test_a_nested_model_that_adds_nothing_has_no_evidence(plain):
    less = plain.fit(AXIS)
    assert evidence(less, less) == -6.0
    for effect, name in (
        (dfc.effects.BiasForce(force=0.01), "bias_force.force"),
        (dfc.effects.QuadraticDrag(drag=0.01), "quadratic_drag.drag"),
    ):
        more = plain.fit(AXIS.replace(effects=(effect,)), (name,))
        assert more.cost < less.cost + 1.0  # it can be as likely
        assert evidence(less, more) < 0.0
        assert evidence(less, more, [2.0]) == pytest.approx(evidence(less, more) - 2.0)


def test_a_cause_that_is_there_has():
    machine = AXIS.replace(effects=dfc.effects.BiasForce(force=0.6))
    problem = Problem(AXIS, (prepare(driven(machine)),))
    less, more = problem.fit(AXIS), problem.fit(machine, ("bias_force.force",))
    assert evidence(less, more) > 50.0
    assert evidence(more, less) < -50.0


def walk_of_first_order(samples, keep, seed):
    """Normal values, of which each keeps so much of the one before."""
    return lfilter([1.0], [1.0, -keep], np.random.default_rng(seed).standard_normal(samples))


def test_white_innovations_count_in_full_and_coloured_ones_as_fewer(plain):
    assert 1.0 <= long_run(plain.fit(AXIS)) < 1.3
    # A slow force that no parameter describes: neighbouring samples tell the same.
    keep = np.exp(-DT / 0.05)
    slow = 1.5 * np.sqrt(1.0 - keep**2) * walk_of_first_order(4000, keep, 5)
    problem = Problem(AXIS, (prepare(driven(AXIS, levels=slow)),))
    assert long_run(problem.fit(AXIS)) > 2.0


def test_long_run_power_of_a_process_of_first_order():
    """Of correlation p from sample to sample: (1 + p)/(1 - p) times that of white noise."""
    n, p = 200_000, 0.8
    walk = walk_of_first_order(n, p, 2)
    sums = products(walk, 200)
    np.testing.assert_allclose(sums[[0, 3]], [walk @ walk, walk[3:] @ walk[:-3]], rtol=1e-9)
    # The sum over some 25 lags is known to 2 %.
    assert 1.0 + integrate_autocorrelation(sums / sums[0], n) == pytest.approx(9.0, rel=0.06)
