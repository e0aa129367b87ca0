"""Where the fits of candidates start."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

import dryfric_control as dfc
from dryfric_control.diagnosis.likelihood_search import Search
from dryfric_control.diagnosis.starts import Start, beside_jumps, in_valleys

NAMES = ["mass", "backlash.gap", "backlash.load_fraction"]


def start(cost_of, gap, share):
    """A start of a backlash whose cost is a function of gap and share."""
    same = SimpleNamespace(search=lambda v: v, value=lambda z: z)
    problem = SimpleNamespace(
        names=NAMES, parameters=[same] * 3, low=np.zeros(3), high=np.full(3, 10.0),
        tried=lambda z: SimpleNamespace(cost=cost_of(z[1], z[2])),
    )  # fmt: skip
    problem.on = lambda runs: problem
    return Start(cost_of(gap, share), problem, np.array([1.0, gap, share]), "backlash")


def never():
    return False


@pytest.mark.parametrize(("gap", "share"), [(0.013, 0.44), (0.0052, 0.83), (0.031, 0.12)])
def test_a_net_finds_a_valley_between_the_guesses(gap, share):
    def cost(g, s):
        return -100.0 * math.exp(-((math.log(g / gap) / 0.1) ** 2) - ((s - share) / 0.04) ** 2)

    guesses = [start(cost, 0.004 * 2.0**k, s) for k in range(4) for s in (0.35, 0.65)]
    assert min(one.cost for one in guesses) > -50.0
    best = in_valleys(guesses, NAMES[1:], never, ())[0]
    assert best.cost < -90.0
    assert best.value(NAMES[1]) == pytest.approx(gap, rel=0.05)
    assert best.value(NAMES[2]) == pytest.approx(share, abs=0.02)


def test_a_net_that_hangs_nowhere_leaves_the_guesses():
    """Costs are infinite where the parts are stiffer than the samples show."""
    guesses = [
        start(lambda g, s: 1.0 if s in (0.363, 0.637) else math.inf, 0.01, s)
        for s in (0.363, 0.637)
    ]
    assert list(map(id, in_valleys(guesses, NAMES[1:], never, ()))) == list(map(id, guesses))


def test_a_net_of_one_parameter_lies_along_it():
    guesses = [start(lambda g, s: abs(math.log(g / 0.013)), 0.004 * 4.0**k, 0.5) for k in range(3)]
    best = in_valleys(guesses, NAMES[1:2], never, ())[0]
    assert best.value(NAMES[1]) == pytest.approx(0.013, rel=0.05)


def test_a_net_that_hangs_on_its_samples_alone_is_not_started_from():
    guesses = [start(lambda g, s: 1.0, 0.004 * 4.0**k, 0.5) for k in range(3)]
    whole = guesses[0].problem
    whole.on = lambda runs: SimpleNamespace(**(vars(whole) | {"tried": whole.tried}))
    few = whole.on(())
    whole.on, whole.tried = lambda runs: few, lambda z: SimpleNamespace(cost=math.inf)
    assert all(math.isfinite(one.cost) for one in in_valleys(guesses, NAMES[1:2], never, ()))


def test_of_a_share_alone_there_is_no_net():
    guesses = [start(lambda g, s: 1.0, 0.01, 0.35)]
    assert in_valleys(guesses, NAMES[2:], never, ()) is guesses


@pytest.mark.parametrize("share", [1e-5, 1.0 - 1e-5])
def test_a_part_too_light_to_be_seen_is_not_tried(share):
    """It would rattle by the thousand where the other stands."""
    axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    light = axis.replace(effects=(dfc.effects.Backlash(gap=1e-4, load_fraction=share),))
    t = 1e-3 * np.arange(800)
    u = 20.0 * np.sin(40.0 * t)
    search = Search(axis, [dfc.Record(t, u, axis.simulate(u, dt=1e-3).y[0])])
    problem = search.problem(light, ["backlash.load_fraction"])
    tried = problem.axis_at(problem.start()).effects[0].load_fraction
    assert min(tried, 1.0 - tried) == pytest.approx(0.05)


def test_parameters_of_breakaways_are_found_across_jumps():
    # The cost is flat between whole breakaways and tells the ratio of both best, as short rests do.
    def cost(rise, time):
        return round(8.0 * abs(math.log(rise / time))) + round(4.0 * abs(math.log(time / 0.4)))

    one = start(cost, 0.8, 0.8)
    found = beside_jumps(one.problem, one.z, NAMES[1:], never)
    assert found[0] == one.z[0]
    assert cost(found[1], found[2]) == 0
    assert found[1:] == pytest.approx([0.4, 0.4], rel=0.2)


def test_no_jump_is_crossed_when_time_is_over():
    one = start(lambda gap, share: gap + share, 0.8, 0.8)
    assert np.array_equal(beside_jumps(one.problem, one.z, NAMES[1:], lambda: True), one.z)
