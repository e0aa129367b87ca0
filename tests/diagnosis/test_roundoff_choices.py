"""Round-off chooses nothing: the same record, written a little otherwise, is told the same.

A record off by 1e-12 of its range, or one whose numbers were summed in another
order, differs by less than anything that it resolves.
"""

from functools import cache

import numpy as np
import pytest

import dryfric_control as dfc
from dryfric_control.estimation.windows import cut
from dryfric_control.identification import slow_ramp_experiment
from dryfric_control.identification.stribeck import stick_phases
from dryfric_control.records.motion import directions
from dryfric_control.ties import NEAR, above, ranked, samples

BASE = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0, travel=(-1.0, 1.0))
SLIPPING = dfc.FrictionAxis(
    mass=2.0, viscous=15.0, coulomb=8.0, travel=(0.0, 0.1),
    stribeck=dfc.Stribeck(excess=0.3, speed=0.01),
)  # fmt: skip


BIAS = dfc.effects.BiasForce(force=2.0)
CHANGES = ("noise", "thirds", "tenths")


def noisy(values, rng):
    return values + 1e-12 * np.ptp(values) * rng.standard_normal(values.size)


def changed(record, how):
    """The record off by less than it resolves."""
    rng = np.random.default_rng(3)
    change = {
        "noise": lambda v: noisy(v, rng),
        "thirds": lambda v: v * (1.0 / 3.0) * 3.0,
        "tenths": lambda v: sum([v * 0.1] * 10),
    }[how]
    u, x = change(record.u), change(record.x)
    assert not np.array_equal(x, record.x)
    return dfc.Record(record.t, u, x, record.reference)


@cache
def run(*effects):
    t = 2e-3 * np.arange(1500)
    pace = 2.0 * np.pi * t
    u = 22.0 * np.sin(0.5 * pace) + 6.0 * np.sin(3.1 * pace + 1.0) + 4.0 * np.sin(0.83 * pace)
    x = BASE.replace(effects=effects).simulate(u, dt=2e-3).y[0]
    return dfc.Record(t, u, 1e-6 * np.round(1e6 * x))


@cache
def crawl():
    ramp = slow_ramp_experiment(SLIPPING, duration=20.0, quantum=1e-6).record
    return dfc.Record(ramp.t, ramp.u, ramp.x, ramp.reference)


# --- the rule ---------------------------------------------------------------


def test_equal_numbers_keep_their_order_and_others_are_sorted():
    rng = np.random.default_rng(0)
    values = np.repeat(rng.permutation(20) + 1.0, 3) * (1.0 + 1e-14 * rng.standard_normal(60))
    expected = np.argsort(np.round(values), kind="stable")
    assert ranked(values) == expected.tolist()
    assert ranked([np.nan, np.inf, 1.0, -np.inf]) == [3, 2, 0, 1]
    assert ranked([0.0, -0.5e-6], 1e-6) == [0, 1]
    assert ranked([0.0, -2.0e-6], 1e-6) == [1, 0]
    assert ranked([]) == []


def test_only_what_exceeds_round_off_is_above():
    assert above([0.3 * (1.0 + 1e-15), 0.3 * (1.0 + 3.0 * NEAR)], 0.3).tolist() == [False, True]
    assert above([1e-300, -1.0], 0.0).tolist() == [True, False]


@pytest.mark.parametrize("dt", [0.004, 0.02, 0.1 / 3.0, 1e-3, 0.25 / 7.5])
def test_whole_samples_do_not_depend_on_the_last_digit_of_the_step(dt):
    whole = samples(0.25, dt)
    assert abs(whole * dt - 0.25) <= 0.5 * dt * (1.0 + 1e-9)
    assert {samples(0.25, dt * (1.0 + k * 2e-16)) for k in range(-5, 6)} == {whole}


# --- records ----------------------------------------------------------------


@pytest.mark.parametrize("how", CHANGES)
def test_what_moves_and_where_windows_lie_is_the_same(how):
    record = crawl()
    other = changed(record, how)
    assert np.array_equal(directions(record), directions(other))
    for window in (0.25, 0.0625, 0.0125):
        one, two = cut(record, window), cut(other, window)
        assert np.array_equal(one.edges, two.edges)
        assert np.array_equal(one.rest >= 0.05, two.rest >= 0.05)
    sticks, again = stick_phases(record), stick_phases(other)
    assert sticks.end.size > 3
    assert np.array_equal(sticks.begin, again.begin) and np.array_equal(sticks.end, again.end)


def test_an_exact_rest_is_no_motion():
    # Most of it at rest, without an encoder: neither quantum nor noise bounds a motion.
    t = 1e-3 * np.arange(4000)
    x = 0.1 * np.clip(t - 3.0, 0.0, 0.5)
    record = dfc.Record(t, np.cos(t), x, quantum=0.0)
    moving = directions(record)
    assert not moving[:2900].any() and not moving[3600:].any() and np.all(moving[3100:3400] == 1)


# --- identification ---------------------------------------------------------


@pytest.mark.parametrize(
    ("how", "quantum", "known"),
    [*((h, 1e-6, True) for h in CHANGES), ("noise", 0.0, True), ("thirds", 0.0, False)],
)
def test_degrees_are_the_same(how, quantum, known):
    axis, record = ramp(quantum)
    for one in (record, changed(record, how)):
        found = dfc.identify_coulomb(one, axis=axis if known else None)
        assert found.degrees == (1, 0)


@cache
def ramp(quantum):
    axis = dfc.FrictionAxis(
        mass=2.0, viscous=15.0, travel=(0.0, 0.3), coulomb=dfc.CoulombMap([8.0, 10.0], 7.0)
    )
    return axis, slow_ramp_experiment(axis, quantum=quantum).record


def test_a_fit_ends_in_the_same_place():
    found = [
        dfc.fit(BASE.replace(mass=3.0, coulomb=5.0), record, ("mass", "viscous", "coulomb"))
        for record in (run(), changed(run(), "noise"))
    ]
    assert list(found[1].parameters) == list(found[0].parameters)
    for name, value in found[0].parameters.items():
        assert found[1].parameters[name] == pytest.approx(value, rel=1e-6)
    assert found[1].messages == found[0].messages


@pytest.mark.parametrize("how", ["noise", "thirds"])
def test_the_next_experiment_is_the_same(how):
    bias = BASE.replace(effects=(BIAS,))
    rivals = [
        BASE.replace(effects=(dfc.effects.Spring(stiffness=10.0, rest=0.2),)),
        BASE.replace(effects=(dfc.effects.CoulombAsymmetry(force=-2.0),)),
    ]
    one, two = (
        dfc.next_experiment(bias, rivals, record) for record in (run(BIAS), changed(run(BIAS), how))
    )
    assert (one.name, one.separates) == (two.name, two.separates)
    assert list(one.tried) == list(two.tried)
    assert np.allclose(one.reference, two.reference, rtol=0.0, atol=1e-6 * np.ptp(one.reference))
