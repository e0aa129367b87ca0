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


def test_a_point_without_a_drive_has_the_one_that_keeps_its_velocity():
    pendulum = made("gravity").mode_ss(1, at=(0.7, 0.2))
    assert pendulum.A[1] == pytest.approx([-40.0 / 2.0 * np.cos(0.7 - 0.3), -7.5], rel=1e-8)
    # Behind a dead zone the slope at no drive is zero.
    axis = dfc.FrictionAxis(**STAGE, effects=fx.DeadZone(width=3.0))
    assert axis.mode_ss(1, at=(0.0, 0.1)).B[1, 0] == pytest.approx(0.5)
    assert axis.mode_ss(1, at=(0.0, 0.1, 0.5)).B[1, 0] == 0.0


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


LATE = {
    "a delay of whole samples": (fx.InputDelay(delay=5e-3),),
    "a delay of part of a sample": (fx.InputDelay(delay=0.4e-3),),
    "a delay between samples": (fx.InputDelay(delay=3.4e-3),),
    "a lag": (fx.ActuatorLag(time_constant=4e-3),),
    "delay, lag and gain": (
        fx.InputDelay(delay=3.4e-3),
        fx.ActuatorLag(time_constant=4e-3),
        fx.InputGain(gain=0.8),
    ),
}


@pytest.mark.parametrize("name", LATE)
def test_delay_and_lag_are_states_of_the_mode(name):
    """A sliding axis is linear: two runs differ by the response of the mode to their drives."""
    axis = dfc.FrictionAxis(**STAGE, effects=LATE[name])
    rng = np.random.default_rng(3)
    u, change = np.full(400, 30.0), rng.standard_normal(400)
    runs = [axis.simulate(drive, DT, v0=0.5) for drive in (u, u + change)]
    assert all((run.mode == 1).all() for run in runs)
    system = axis.mode_ss(1, DT, "zoh", at=(0.0, 0.1))
    response = ct.forced_response(system, runs[0].t, change)
    expected = runs[1].y[0] - runs[0].y[0]
    # The simulation integrates a lag to some 1e-10 m; a sample of delay would be 1e-5 m.
    np.testing.assert_allclose(response.outputs, expected, rtol=0.0, atol=1e-9)
    assert np.ptp(expected[1:] - expected[:-1]) > 1e-6


def test_the_lag_is_a_state_of_the_continuous_mode():
    """Behind the other effects on the drive, as in the simulation."""
    effects = (fx.DeadZone(width=3.0), fx.ActuatorLag(time_constant=0.02))
    axis = dfc.FrictionAxis(**STAGE, effects=effects)
    t = np.arange(101) * DT
    run = axis.simulate(np.full(t.size, 20.0), DT, v0=0.5)
    assert (run.mode == 1).all()
    exactly = {"rtol": 1e-10, "atol": 1e-12}
    alone = ct.input_output_response(
        axis.mode(1), t, 20.0, [0.0, 0.5, 0.0], solve_ivp_kwargs=exactly
    )
    np.testing.assert_allclose(alone.outputs, run.y[:3], rtol=1e-8, atol=1e-10)


def test_a_mode_reads_the_position_as_the_encoder_does():
    disc = fx.EccentricEncoder(amplitude=1e-3, period=0.04, phase=0.3)
    axis, x = dfc.FrictionAxis(**STAGE, effects=disc), 0.013
    turn = 2.0 * np.pi / 0.04
    assert axis.mode(1).output(0.0, [x, 0.1], [9.0])[0] == pytest.approx(
        x + 1e-3 * np.sin(turn * x + 0.3), rel=1e-12
    )
    for index in (0, 1):
        slope = axis.mode_ss(index, DT, at=(x, 0.1)).C[0, 0]
        assert slope == pytest.approx(1.0 + 1e-3 * turn * np.cos(turn * x + 0.3), rel=1e-7)


@pytest.mark.parametrize(
    "effect",
    [
        fx.Presliding(distance=1e-5),
        fx.Backlash(gap=1e-4, load_fraction=0.5),
        fx.Compliance(stiffness=2e4, damping=3.0, load_fraction=0.4),
    ],
)
def test_what_a_mode_cannot_contain_is_refused(effect):
    axis = dfc.FrictionAxis(**STAGE, effects=effect)
    for call in (axis.mode, axis.mode_ss, lambda i: axis.mode_ss(i, DT, at=(0.0, 0.1))):
        with pytest.raises(ValueError, match=f"no place for {effect.slug}: leave it out"):
            call(1)
    # A controller is designed for the rigid axis, as it says.
    rigid = axis.replace(effects=())
    made, plain = (
        dfc.PositionController.from_bandwidth(a, 5.0, DT, limit=9.0) for a in (axis, rigid)
    )
    np.testing.assert_array_equal(made.gains, plain.gains)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda a: a.mode(1), r"no states in continuous time: take mode_ss\(1, dt, at=\.\.\.\)"),
        (lambda a: a.mode_ss(1), "no states in continuous time: give dt"),
        (lambda a: a.mode_ss(1, 1e-6), "3.4e.03 states at dt = 1e-06 s, at most 1000"),
        (
            lambda a: a.replace(effects=fx.ActuatorLag(time_constant=0.4e-3)).mode_ss(1, DT),
            r"dt \* 1 / lag < 2, got 2\.5",
        ),
    ],
)
def test_delays_and_lags_that_have_no_states_are_refused(call, words):
    with pytest.raises(ValueError, match=words):
        call(dfc.FrictionAxis(**STAGE, effects=LATE["a delay between samples"]))
