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


def start(cost_of, gap, share, noises=()):
    """A start of a backlash whose cost is a function of gap, share and noises."""
    same = SimpleNamespace(search=lambda v: v, value=lambda z: z)
    n = 3 + len(noises)
    problem = SimpleNamespace(
        names=NAMES, parameters=[same] * 3, low=np.r_[np.zeros(3), np.full(n - 3, -30.0)],
        high=np.full(n, 10.0), tried=lambda z: SimpleNamespace(cost=cost_of(*z[1:])),
    )  # fmt: skip
    problem.on = lambda runs: problem
    z = np.array([1.0, gap, share, *noises])
    return Start(cost_of(*z[1:]), problem, z, "backlash")


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


def test_a_net_finds_a_valley_that_a_large_random_force_hides():
    # The force was fitted without the effect, and made up for it.
    def cost(g, s, force, reading):
        depth = 100.0 if force < -2.0 else 0.0
        wrong = 20.0 * math.exp(-((math.log(g / 0.03) / 0.3) ** 2))
        there = math.exp(-((math.log(g / 0.013) / 0.1) ** 2) - ((s - 0.44) / 0.04) ** 2)
        return -wrong - depth * there

    guesses = [start(cost, 0.004 * 2.0**k, s, (0.0, -20.0)) for k in range(4) for s in (0.35, 0.65)]
    best = in_valleys(guesses, NAMES[1:], never, ())[0]
    assert best.value(NAMES[1]) == pytest.approx(0.013, rel=0.05)
    assert best.z[3] < -2.0
    assert best.z[4] == -20.0  # the noise of the readings stays


def test_a_net_finds_a_narrow_valley_beside_a_wide_one():
    # At another share, the narrow one is not seen.
    def cost(g, s):
        near = math.exp(-(((s - 0.44) / 0.05) ** 2))
        wide = 50.0 * math.exp(-((math.log(g / 0.026) / 0.5) ** 2)) * near
        return -wide - 100.0 * math.exp(
            -((math.log(g / 0.0123) / 0.05) ** 2) - ((s - 0.44) / 0.008) ** 2
        )

    guesses = [start(cost, 0.004 * 2.0**k, s) for k in range(4) for s in (0.35, 0.65)]
    best = in_valleys(guesses, NAMES[1:], never, ())
    assert best[0].value(NAMES[1]) == pytest.approx(0.0123, rel=0.02)
    assert best[0].value(NAMES[2]) == pytest.approx(0.44, abs=0.005)
    # The wide one is among the starts too.
    assert any(abs(math.log(one.value(NAMES[1]) / 0.026)) < 0.1 for one in best[1:3])


def test_all_samples_show_a_valley_more_narrowly_than_a_few():
    few_say = lambda g, s: -100.0 * math.exp(-(((s - 0.446) / 0.05) ** 2))  # noqa: E731
    guesses = [
        start(lambda g, s: -100.0 * math.exp(-(((s - 0.4376) / 0.003) ** 2)), 0.004 * 2.0**k, 0.35)
        for k in range(3)
    ]
    whole = guesses[0].problem
    few = SimpleNamespace(**vars(whole))
    few.tried, few.on = lambda z: SimpleNamespace(cost=few_say(z[1], z[2])), lambda runs: few
    whole.on = lambda runs: few
    best = in_valleys(guesses, NAMES[1:], never, ())[0]
    assert best.value(NAMES[2]) == pytest.approx(0.4376, abs=0.002)


def test_a_length_that_only_the_true_share_shows_is_looked_for_again():
    # On a few samples twice the gap is likelier, at a slightly wrong share.
    def wide(g, s, share):
        return -60.0 * math.exp(-((math.log(g / 0.026) / 0.3) ** 2) - ((s - share) / 0.05) ** 2)

    def all_say(g, s):
        there = math.exp(-((math.log(g / 0.013) / 0.08) ** 2) - ((s - 0.668) / 0.003) ** 2)
        return wide(g, s, 0.668) - 100.0 * there

    guesses = [start(all_say, 0.004 * 2.0**k, s) for k in range(4) for s in (0.35, 0.65)]
    whole = guesses[0].problem
    few = SimpleNamespace(**vars(whole))
    few.tried = lambda z: SimpleNamespace(cost=wide(z[1], z[2], 0.676))
    few.on = whole.on = lambda runs: few
    best = in_valleys(guesses, NAMES[1:], never, ())[0]
    assert best.value(NAMES[1]) == pytest.approx(0.013, rel=0.02)
    assert best.value(NAMES[2]) == pytest.approx(0.668, abs=0.002)


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
