"""Modes linearised with their effects, against differences of the simulation."""

from __future__ import annotations

import control as ct
import numpy as np
import pytest

import dryfric_control as dfc
from dryfric_control import effects as fx

DT = 1e-3
SHORT = 2e-5  # over it the slopes change by less than the differences show
STAGE = {"mass": 2.0, "viscous": 15.0, "coulomb": 8.0, "stick_speed": 1e-3}
CASES = {
    "gravity": (fx.Gravity(amplitude=40.0, phase=0.3),),
    "spring": (fx.Spring(stiffness=300.0, rest=0.02),),
    "cogging": (fx.Cogging(amplitude=1.5, period=0.004),),
    "drag": (fx.QuadraticDrag(drag=30.0),),
    "viscous asymmetry": (fx.ViscousAsymmetry(viscous=4.0),),
    "coulomb asymmetry": (fx.CoulombAsymmetry(force=2.0),),
    "position dependence": (fx.PositionDependence(slope=6.0),),
    "load dependence": (fx.LoadDependence(coefficient=0.1),),
    "input gain": (fx.InputGain(gain=0.8),),
    "several": (
        fx.Gravity(amplitude=40.0),
        fx.Cogging(amplitude=1.0, period=0.01),
        fx.QuadraticDrag(drag=10.0),
    ),
}
each_case = pytest.mark.parametrize("name", CASES)


def made(name, **changes):
    return dfc.FrictionAxis(**(STAGE | {"effects": CASES[name]} | changes))


def differences(axis, x, v, u):
    """Matrices of one sample, by central differences of the simulation."""

    def after(x, v, u):
        return axis.simulate([u, u], SHORT, x0=x, v0=v).y[:2, 1]

    columns = []
    for place, h in enumerate((1e-6, 1e-4, 1e-2)):
        change = np.zeros(3)
        change[place] = h
        up, down = np.array([x, v, u]) + change, np.array([x, v, u]) - change
        columns.append((after(*up) - after(*down)) / (2.0 * h))
    return np.array(columns).T


@each_case
@pytest.mark.parametrize("side", [1, -1])
def test_a_sample_of_the_simulation_has_these_slopes(name, side):
    axis = made(name, stribeck=dfc.Stribeck(0.3, 0.02))
    x, v, u = 0.0135, 0.03 * side, 25.0 * side
    linear = axis.mode_ss(side, SHORT, "zoh", at=(x, v, u))
    scale = np.array([[1.0, SHORT, SHORT**2], [1.0 / SHORT, 1.0, SHORT]])
    got = np.hstack([linear.A, linear.B])
    expected = differences(axis, x, v, u)
    plain = axis.mode_ss(side, SHORT, "zoh")
    left_out = np.abs(np.hstack([plain.A, plain.B]) - expected) / scale
    assert np.max(np.abs(got - expected) / scale) < 0.02 * np.max(left_out)


@each_case
def test_slopes_of_the_acceleration(name):
    """python-control's own linearisation of the mode, at a step it needs chosen."""
    axis = made(name)
    x, v, u = 0.0135, 0.03, 25.0
    linear = axis.mode_ss(1, at=(x, v, u))
    expected = ct.linearize(axis.mode(1), [x, v], [u], eps=1e-6)
    np.testing.assert_allclose(linear.A, expected.A, rtol=2e-3, atol=2e-3)
    np.testing.assert_allclose(linear.B, expected.B, rtol=2e-3, atol=1e-6)


def test_closed_forms():
    x, v = 0.7, 0.2
    pendulum = made("gravity").mode_ss(1, at=(x, v))
    assert pendulum.A[1, 0] == pytest.approx(-40.0 / 2.0 * np.cos(x - 0.3), rel=1e-8)
    assert pendulum.A[1, 1] == pytest.approx(-7.5, rel=1e-8)
    spring = made("spring").mode_ss(1, DT, at=(x, v))
    assert spring.A[1, 0] == pytest.approx(-DT * 300.0 / 2.0, rel=1e-8)
    drag = made("drag").mode_ss(-1, at=(x, -v))
    assert drag.A[1, 1] == pytest.approx(-7.5 - 2.0 * 30.0 * v / 2.0, rel=1e-8)
    peak = dfc.FrictionAxis(**STAGE, stribeck=dfc.Stribeck(0.3, 0.02)).mode_ss(1, at=(0.0, 0.01))
    z = (0.01 - 1e-3) / 0.02
    slope = 8.0 * 0.3 * np.exp(-z * z) * 2.0 * z / 0.02
    assert peak.A[1, 1] == pytest.approx((slope - 15.0) / 2.0, rel=1e-7)


def test_the_drive_is_the_one_that_keeps_the_velocity():
    """Behind a dead zone the slope at no drive is zero."""
    axis = dfc.FrictionAxis(**STAGE, effects=fx.DeadZone(width=3.0))
    assert axis.mode_ss(1, at=(0.0, 0.1)).B[1, 0] == pytest.approx(0.5)
    assert axis.mode_ss(1, at=(0.0, 0.1, 0.5)).B[1, 0] == 0.0


def test_rest_and_axes_without_effects_stay_as_they_were():
    axis, plain = made("several"), dfc.FrictionAxis(**STAGE)
    for method in ("euler", "zoh"):
        for given in ("drive", "force"):
            one = axis.mode_ss(0, DT, method, given, at=(0.01, 0.0))
            other = axis.mode_ss(0, DT, method, given)
            np.testing.assert_array_equal(one.A, other.A)
            np.testing.assert_array_equal(one.B, other.B)
            one = plain.mode_ss(1, DT, method, given, at=(0.01, 0.1))
            other = plain.mode_ss(1, DT, method, given)
            np.testing.assert_allclose(one.A, other.A, rtol=1e-9, atol=1e-12)
            np.testing.assert_allclose(one.B, other.B, rtol=1e-9, atol=1e-15)


def test_a_pendulum_has_the_closed_loop_poles_it_was_given():
    arm = made("gravity", coulomb=0.5)
    at = (1.0, 0.0)
    loop = dfc.PositionController.from_bandwidth(arm, 10.0, DT, at=at)
    sliding = arm.mode_ss(1, DT, "zoh", at=at)
    a = np.block([[sliding.A, np.zeros((2, 1))], [-DT * sliding.C, np.ones((1, 1))]])
    b = np.vstack([sliding.B, [[0.0]]])
    poles = np.linalg.eigvals(a - b @ np.array([[loop.kp, loop.kd, -loop.ki]]))
    # Coinciding poles: their error is the root of round-off's.
    assert np.sort(np.abs(poles))[-2:] == pytest.approx(np.exp(-10.0 * DT), abs=1e-4)
    blind = dfc.PositionController.from_bandwidth(arm, 10.0, DT)
    poles = np.linalg.eigvals(a - b @ np.array([[blind.kp, blind.kd, -blind.ki]]))
    assert np.max(np.abs(np.abs(poles) - np.exp(-10.0 * DT))) > 1e-3


@pytest.mark.parametrize(
    ("at", "message"),
    [
        (0.1, r"at must be \(position, velocity\)"),
        ((0.1, 0.2, 3.0, 4.0), r"at must be \(position, velocity\)"),
        (("here", 0.1), r"at\[0\] must be a number"),
        ((0.0, float("nan")), r"at\[1\] must be a finite number"),
        ((0.0, -0.1), r"at\[1\] = -0\.1 moves against mode \+1"),
    ],
)
def test_bad_points_are_named(at, message):
    with pytest.raises(ValueError, match=message):
        dfc.FrictionAxis(**STAGE).mode_ss(1, at=at)
