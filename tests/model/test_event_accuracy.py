"""Switching times of stick-slip against an independent event-driven integration.

A mass is pulled through a spring whose other end moves at constant speed: m = 1,
Fc = 1, Fs = 1.5, vs = 0.001, k = 2, belt 0.1 m/s. The reference below is written from
the equations and integrates each mode by scipy between located switches.
"""

import functools
import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import dryfric_control as dfc

MASS, COULOMB, EXCESS, STRIBECK_SPEED = 1.0, 1.0, 0.5, 1e-3
STIFFNESS, BELT, RATE = 2.0, 0.1, 500.0
BREAKAWAY = (1 + EXCESS) * COULOMB
DURATION = 39.0  # the fifth break-away comes at 38.2 s
# One band far below the Stribeck speed, so that sticking is nearly a stop, and one that
# is a tenth of it, so that entering the band at speed Sigma, the decay at rate p and
# F(x, 0+) < Fs (1.495 against 1.5) all show.
BANDS = (1e-6, 1e-4)


@functools.cache
def reference_switches(band):
    """Rows of (time, mode before, mode after) by scipy, mode by mode, of an upward motion."""

    def sliding(t, y):
        peak = EXCESS * math.exp(-(((y[1] - band) / STRIBECK_SPEED) ** 2))
        force = STIFFNESS * (BELT * t - y[0]) - COULOMB * (1 + peak)
        return [y[1], force / MASS]

    def reaches_band(t, y):
        return y[1] - band

    reaches_band.terminal, reaches_band.direction = True, -1
    t, x, v, mode = 0.0, 0.0, 0.0, 0
    switches = []
    while t < DURATION:
        if mode == 0:

            def place(at, x=x, v=v, t=t):
                return x - v * math.expm1(-RATE * (at - t)) / RATE

            def short(at, place=place):
                return STIFFNESS * (BELT * at - place(at)) - BREAKAWAY

            if short(DURATION) <= 0.0:
                break
            until = brentq(short, t, DURATION, xtol=1e-15, rtol=1e-15)
            x, v = place(until), v * math.exp(-RATE * (until - t))
            t, mode = until, 1
            switches.append((t, 0, 1))
            continue
        # A step across the Stribeck peak, 2 ms wide at these decelerations, would leave the
        # event to an interpolation that cannot see it.
        run = solve_ivp(
            sliding, (t, DURATION), [x, v], method="DOP853", rtol=1e-12, atol=1e-14,
            max_step=1e-3, events=reaches_band,
        )  # fmt: skip
        t, (x, v) = run.t[-1], run.y[:, -1]
        assert v >= 0.0
        if run.status == 1:
            # Inside the Coulomb band at the band's speed: it sticks. The completed rule at v = 0
            # has nothing left to decide on this path.
            assert abs(STIFFNESS * (BELT * t - x)) <= COULOMB
            mode = 0
            switches.append((t, 1, 0))
    return np.array(switches)


@pytest.mark.parametrize("dt", [1e-4, 1e-3, 3e-3, 5e-3, 0.05, 0.5])
@pytest.mark.parametrize("band", BANDS)
def test_accuracy_does_not_depend_on_the_sampling_time(band, dt):
    axis = dfc.FrictionAxis(
        mass=MASS, viscous=0.0, coulomb=COULOMB, stribeck=dfc.Stribeck(EXCESS, STRIBECK_SPEED),
        stick_speed=band, stick_rate=RATE, effects=dfc.effects.Spring(STIFFNESS, rest=0.0),
    )  # fmt: skip
    # The spring's end moves linearly, so every sampling time describes the same motion.
    u = STIFFNESS * BELT * np.arange(round(DURATION / dt) + 1) * dt
    events = axis.simulate(u, dt=dt, hold="first").events
    ours = np.column_stack([events.time, events.before, events.after])
    theirs = reference_switches(band)
    assert np.count_nonzero(theirs[:, 2] == 1) == 5
    np.testing.assert_array_equal(ours[:, 1:], theirs[:, 1:])
    np.testing.assert_allclose(ours[:, 0], theirs[:, 0], rtol=0.0, atol=1e-6)


@pytest.mark.parametrize("dt", [1e-3, 7e-3, 0.1])
def test_reversals_of_a_coulomb_oscillator_come_every_half_period(dt):
    # m x'' + k x = -Fc sign(x'): each half swing is harmonic about -+Fc/k, so the speed
    # passes zero at n pi / omega, and the mass rests at the first turn within Fc/k.
    spring = dfc.effects.Spring(stiffness=40.0, rest=0.0)
    axis = dfc.FrictionAxis(mass=2.0, viscous=0.0, coulomb=3.0, stick_speed=1e-9, effects=spring)
    events = axis.simulate(np.zeros(round(6.0 / dt)), dt=dt, x0=1.0).events
    turns = math.ceil((40.0 / 3.0 - 1.0) / 2.0)
    expected = np.arange(1, turns + 1) * math.pi / math.sqrt(40.0 / 2.0)
    assert events.after[-1] == 0
    # The last event comes 2e-9 s early, at speed Sigma instead of 0; the others carry the
    # integration error alone.
    np.testing.assert_allclose(events.time, expected, rtol=0.0, atol=1e-8)


def test_an_axis_whose_friction_rises_with_velocity_creeps_below_the_stick_speed():
    # More than it holds at rest, less than it resists at the stick speed: nothing but the
    # velocity at which load and friction are equal is an equilibrium.
    level, deficit, speed, band = 0.694, 0.95, 7.8e-4, 1e-4
    film = dfc.effects.VelocityStrengthening(deficit=deficit, speed=speed)
    axis = dfc.FrictionAxis(mass=0.5, viscous=1.7, coulomb=level, stick_speed=band, effects=film)

    def resists(v):
        return level * (1 - deficit * (1 - math.tanh(v / speed))) + 1.7 * v

    load = 0.5 * (resists(0.0) + resists(band))
    expected = brentq(lambda v: resists(v) - load, 0.0, band)
    for v0 in (0.0, 0.9 * band, 20 * band):
        run = axis.simulate(np.full(2000, load), dt=2e-3, v0=v0)
        assert run.y[1, -1] == pytest.approx(expected, rel=1e-6)
        assert np.all(run.mode[1:] == 1)
