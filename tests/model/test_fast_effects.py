"""Effects that vary fast within a sample, and samples with very many switches."""

import math

import numpy as np
import pytest
from dryfric_control.effects import Backlash, Cogging, Compliance, InputDelay, TimePeriodic
from scipy.integrate import solve_ivp

import dryfric_control as dfc


def axis_with(*effects):
    return dfc.FrictionAxis(mass=1.0, viscous=1.0, coulomb=1.0, effects=effects)


def slid(axis, force, extra, duration, v0):
    """Position and velocity of an axis that slides forwards all the time, by scipy alone."""

    def rate(t, state):
        x, v = state
        load = axis.viscous * v + axis.coulomb.plus[0]
        return [v, (force + extra(t, x) - load) / axis.mass]

    found = solve_ivp(rate, (0.0, duration), [0.0, v0], method="DOP853", rtol=1e-11, atol=1e-12)
    return found.y[:, -1]


def test_cogging_of_which_several_periods_pass_in_a_sample():
    cogging = Cogging(amplitude=0.1, period=2.0 * np.pi / 42.0)
    axis = axis_with(cogging).replace(mass=1e-3, viscous=1e-3, coulomb=0.02, units=("rad", "N m"))
    resp = axis.simulate([0.34] * 801, 1e-3, v0=250.0)
    state = slid(axis, 0.34, lambda t, x: 0.1 * math.sin(42.0 * x), 0.8, 250.0)
    assert resp.y[:2, -1] == pytest.approx(state, rel=1e-6)


@pytest.mark.parametrize("frequency", [1999.0, 2000.0, 4000.0, 501.0])
@pytest.mark.parametrize("phase", [0.5, np.pi / 2])
def test_disturbance_near_multiples_of_the_sampling_rate(frequency, phase):
    axis = axis_with(TimePeriodic(amplitude=3.0, frequency=frequency, phase=phase))
    resp = axis.simulate([4.0] * 301, 1e-3, v0=0.5)

    def extra(t, x):
        return 3.0 * math.sin(2.0 * math.pi * frequency * t + phase)

    # Local errors of 3e-9 add up over thousands of steps.
    np.testing.assert_allclose(resp.y[:2, -1], slid(axis, 4.0, extra, 0.3, 0.5), rtol=1e-6)


@pytest.mark.parametrize("more", [(), (Compliance(stiffness=1e4, damping=20.0, load_fraction=0.6),),
                                  (Backlash(gap=1e-5, load_fraction=0.6),)])  # fmt: skip
def test_a_sample_may_hold_any_number_of_switches(more):
    axis = axis_with(TimePeriodic(amplitude=30.0, frequency=100.0), *more)
    # A longer sample is refused with the compliance: it swings by 82 rad in this one.
    coarse = axis.simulate([0.0] * 6, 0.4)
    fine = axis.simulate([0.0] * 2001, 1e-3)
    assert len(fine.events.time) > 5 * 64
    np.testing.assert_allclose(coarse.events.time, fine.events.time, rtol=0.0, atol=1e-7)
    assert np.array_equal(coarse.events.after, fine.events.after)
    np.testing.assert_allclose(coarse.y[:2, -1], fine.y[:2, -1], rtol=0.0, atol=2e-8)


def test_more_switches_than_the_list_has_room_for():
    axis = axis_with(TimePeriodic(amplitude=300.0, frequency=500.0))
    coarse, fine = axis.simulate([0.0] * 2, 2.0), axis.simulate([0.0] * 2001, 1e-3)
    assert len(coarse.events.time) == len(fine.events.time) > 1500
    np.testing.assert_allclose(coarse.events.time, fine.events.time, rtol=0.0, atol=1e-7)
    controller = dfc.PositionController(kp=1e-3, ki=0.0, kd=0.0, dt=2.0)
    assert len(dfc.simulate_loop(axis, controller, [0.0] * 3).events) > 3000


def test_a_force_that_peaks_between_the_looks_releases():
    """The peak exceeds breakaway for 2 % of a period only."""
    axis = axis_with(TimePeriodic(amplitude=1.002, frequency=400.0, phase=0.3))
    resp = axis.simulate([0.0] * 11, 1e-3)
    first = (np.arcsin(1.0 / 1.002) - 0.3) / (2.0 * np.pi * 400.0)
    assert resp.events.time[0] == pytest.approx(first, abs=1e-9)


def test_what_would_take_for_ever_is_refused():
    with pytest.raises(ValueError, match=r"input_delay.*1e\+12 s.*check the units of delay"):
        axis_with(InputDelay(delay=1e12)).simulate([0.0] * 5, 1e-3)
    with pytest.raises(ValueError, match="time_periodic.*check its units"):
        axis_with(TimePeriodic(1.0, 1e12)).simulate([0.0] * 5, 1e-3)
