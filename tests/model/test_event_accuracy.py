"""Switching times of stick-slip against an independent event-driven integration.

A mass is pulled through a spring whose other end moves at constant speed: m = 1,
Fc = 1, Fs = 1.5, vs = 0.001, k = 2, belt 0.1 m/s. The reference below is written from
the equations and integrates each mode by scipy between located switches.
"""

from __future__ import annotations

import functools
import itertools
import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import dryfric_control as dfc

MASS, COULOMB, EXCESS, STRIBECK_SPEED = 1.0, 1.0, 0.5, 1e-3
STIFFNESS, BELT, RATE = 2.0, 0.1, 500.0
BREAKAWAY = (1 + EXCESS) * COULOMB
DT = 1e-3
DURATION = 39.0  # the fifth break-away comes at 38.2 s
# One band far below the Stribeck speed, so that sticking is nearly a stop, and one that
# is a tenth of it, so that entering the band at speed Sigma, the decay at rate p and
# F(x, 0+) < Fs (1.495 against 1.5) all show.
BANDS = (1e-6, 1e-4)


def axis_with(band):
    return dfc.FrictionAxis(
        mass=MASS,
        viscous=0.0,
        coulomb=COULOMB,
        stribeck=dfc.Stribeck(excess=EXCESS, speed=STRIBECK_SPEED),
        stick_speed=band,
        stick_rate=RATE,
        effects=(dfc.effects.Spring(stiffness=STIFFNESS, rest=0.0),),
    )


def reference_switches(band, held):
    """Rows of (time, mode before, mode after) by scipy, mode by mode.

    The motion is upwards only, which is asserted. `held` moves the spring's end in steps
    of one sample; otherwise it moves continuously.
    """

    def end_force(t, start):
        return STIFFNESS * BELT * (start if held else t)

    def sliding(t, y, start):
        peak = EXCESS * math.exp(-(((y[1] - band) / STRIBECK_SPEED) ** 2))
        force = end_force(t, start) - STIFFNESS * y[0] - COULOMB * (1 + peak)
        return [y[1], force / MASS]

    def reaches_band(t, y, start):
        return y[1] - band

    reaches_band.terminal, reaches_band.direction = True, -1
    edges = np.arange(round(DURATION / DT) + 1) * DT if held else np.array([0.0, DURATION])
    x, v, mode = 0.0, 0.0, 0
    switches = []
    for start, stop in itertools.pairwise(edges):
        t = start
        while t < stop:
            if mode == 0:

                def place(at, x=x, v=v, t=t):
                    return x - v * math.expm1(-RATE * (at - t)) / RATE

                def short(at, start=start, place=place):
                    return end_force(at, start) - STIFFNESS * place(at) - BREAKAWAY

                until = stop
                if short(t) > 0.0:
                    until = t
                elif short(stop) > 0.0:
                    until = brentq(short, t, stop, xtol=1e-15, rtol=1e-15)
                x, v = place(until), v * math.exp(-RATE * (until - t))
                if short(until) > 0.0 or until < stop:
                    mode = 1
                    switches.append((until, 0, 1))
                t = until
                continue
            run = solve_ivp(
                sliding,
                (t, stop),
                [x, v],
                method="DOP853",
                rtol=1e-12,
                atol=1e-14,
                # A step across the Stribeck peak, 2 ms wide at these decelerations,
                # would leave the event to an interpolation that cannot see it.
                max_step=1e-3,
                first_step=min(1e-3, stop - t) if held and v > 2 * STRIBECK_SPEED else None,
                events=reaches_band,
                args=(start,),
            )
            t, (x, v) = run.t[-1], run.y[:, -1]
            if run.status == 1:
                # Inside the Coulomb band at the band's speed: it sticks. The completed
                # rule at v = 0 has nothing left to decide on this path.
                assert abs(end_force(t, start) - STIFFNESS * x) <= COULOMB
                mode = 0
                switches.append((t, 1, 0))
            assert v >= 0.0
    return np.array(switches)


reference = functools.cache(reference_switches)


def simulated_switches(band, held, dt=DT):
    u = STIFFNESS * BELT * np.arange(round(DURATION / dt) + 1) * dt
    events = axis_with(band).simulate(u, dt=dt, hold="zero" if held else "first").events
    return np.column_stack([events.time, events.before, events.after])


@pytest.mark.slow
@pytest.mark.parametrize("band", BANDS)
def test_switching_times_under_a_held_input_agree_with_scipy(band):
    ours, theirs = simulated_switches(band, True), reference(band, True)
    breaks = theirs[theirs[:, 2] == 1, 0]
    assert len(breaks) == 5
    np.testing.assert_array_equal(ours[:, 1:], theirs[:, 1:])
    # The accuracy promised for switching times, sticking included.
    np.testing.assert_allclose(ours[:, 0], theirs[:, 0], rtol=0.0, atol=1e-6)
    # It sticks inside samples: otherwise this would not look there at all.
    sticks = theirs[theirs[:, 2] == 0, 0]
    assert np.all(np.abs(sticks / DT - np.round(sticks / DT)) > 1e-3)


@pytest.mark.parametrize("dt", [1e-4, 1e-3, 3e-3, 5e-3, 0.05, 0.5])
@pytest.mark.parametrize("band", BANDS)
def test_accuracy_does_not_depend_on_the_sampling_time(band, dt):
    # The spring's end moves linearly, so every sampling time describes the same motion.
    ours, theirs = simulated_switches(band, False, dt), reference(band, False)
    assert np.count_nonzero(theirs[:, 2] == 1) == 5
    np.testing.assert_array_equal(ours[:, 1:], theirs[:, 1:])
    np.testing.assert_allclose(ours[:, 0], theirs[:, 0], rtol=0.0, atol=1e-6)


@pytest.mark.parametrize("dt", [1e-3, 7e-3, 0.1])
def test_reversals_of_a_coulomb_oscillator_come_every_half_period(dt):
    # m x'' + k x = -Fc sign(x'): each half swing is harmonic about -+Fc/k, so the speed
    # passes zero at n pi / omega, and the mass rests at the first turn within Fc/k.
    omega, width, start = math.sqrt(40.0 / 2.0), 3.0 / 40.0, 1.0
    axis = dfc.FrictionAxis(
        mass=2.0,
        viscous=0.0,
        coulomb=3.0,
        stick_speed=1e-9,
        effects=(dfc.effects.Spring(stiffness=40.0, rest=0.0),),
    )
    events = axis.simulate(np.zeros(round(6.0 / dt)), dt=dt, x0=start).events
    turns = math.ceil((start / width - 1.0) / 2.0)
    assert turns == 7
    expected = np.arange(1, turns + 1) * math.pi / omega
    assert events.after[-1] == 0
    # The last event comes 2e-9 s early, at speed Sigma instead of 0; the others carry the
    # integration error alone.
    np.testing.assert_allclose(events.time, expected, rtol=0.0, atol=1e-8)
