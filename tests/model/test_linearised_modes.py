"""Modes linearised with their effects, against differences of the simulation."""

import control as ct
import numpy as np
import pytest

import dryfric_control as dfc
from dryfric_control import effects as fx

DT = 1e-3
SHORT = 2e-5  # over it the slopes change by less than the differences show
STAGE = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0, stick_speed=1e-3)
PENDULUM = STAGE.replace(effects=fx.Gravity(amplitude=40.0, phase=0.3))
CASES = [
    PENDULUM.effects,
    fx.Spring(stiffness=300.0, rest=0.02),
    fx.Cogging(amplitude=1.5, period=0.004),
    fx.QuadraticDrag(drag=30.0),
    fx.ViscousAsymmetry(viscous=4.0),
    fx.CoulombAsymmetry(force=2.0),
    fx.PositionDependence(slope=6.0),
    fx.LoadDependence(coefficient=0.1),
    fx.InputGain(gain=0.8),
    (fx.Gravity(amplitude=40.0), fx.Cogging(amplitude=1.0, period=0.01), fx.QuadraticDrag(10.0)),
]


def differences(axis, x, v, u):
    """Matrices of one sample, by central differences of the simulation."""

    def after(x, v, u):
        return axis.simulate([u, u], SHORT, x0=x, v0=v).y[:2, 1]

    here, steps = np.array([x, v, u]), np.diag([1e-6, 1e-4, 1e-2])
    columns = [(after(*here + h) - after(*here - h)) / (2.0 * h.sum()) for h in steps]
    return np.array(columns).T


@pytest.mark.parametrize("effects", CASES, ids=lambda given: getattr(given, "slug", None))
@pytest.mark.parametrize("side", [1, -1])
def test_a_sample_of_the_simulation_has_these_slopes(effects, side):
    axis = STAGE.replace(effects=effects, stribeck=dfc.Stribeck(0.3, 0.02))
    x, v, u = 0.0135, 0.03 * side, 25.0 * side
    linear = axis.mode_ss(side, SHORT, "zoh", at=(x, v, u))
    scale = np.array([[1.0, SHORT, SHORT**2], [1.0 / SHORT, 1.0, SHORT]])
    plain = axis.mode_ss(side, SHORT, "zoh")
    expected = differences(axis, x, v, u)
    error, left_out = (
        np.max(np.abs(np.hstack([system.A, system.B]) - expected) / scale)
        for system in (linear, plain)
    )
    assert error < 0.02 * left_out


def test_a_point_without_a_drive_has_the_one_that_keeps_its_velocity():
    pendulum = PENDULUM.mode_ss(1, at=(0.7, 0.2))
    assert pendulum.A[1] == pytest.approx([-40.0 / 2.0 * np.cos(0.7 - 0.3), -7.5], rel=1e-8)
    # Behind a dead zone the slope at no drive is zero.
    axis = STAGE.replace(effects=fx.DeadZone(width=3.0))
    assert axis.mode_ss(1, at=(0.0, 0.1)).B[1, 0] == pytest.approx(0.5)
    assert axis.mode_ss(1, at=(0.0, 0.1, 0.5)).B[1, 0] == 0.0


def test_a_pendulum_has_the_closed_loop_poles_it_was_given():
    arm, at = PENDULUM.replace(coulomb=0.5), (1.0, 0.0)
    sliding = arm.mode_ss(1, DT, "zoh", at=at)
    a = np.block([[sliding.A, np.zeros((2, 1))], [-DT * sliding.C, np.ones((1, 1))]])
    b = np.vstack([sliding.B, [[0.0]]])

    def poles(loop):
        return np.abs(np.linalg.eigvals(a - b @ np.array([[loop.kp, loop.kd, -loop.ki]])))

    given = poles(dfc.PositionController.from_bandwidth(arm, 10.0, DT, at=at))
    # Coinciding poles: their error is the root of round-off's.
    assert np.sort(given)[-2:] == pytest.approx(np.exp(-10.0 * DT), abs=1e-4)
    blind = poles(dfc.PositionController.from_bandwidth(arm, 10.0, DT))
    assert np.max(np.abs(blind - np.exp(-10.0 * DT))) > 1e-3


LATE, LAG = fx.InputDelay(delay=3.4e-3), fx.ActuatorLag(time_constant=4e-3)


@pytest.mark.parametrize(
    "effects",
    [fx.InputDelay(5e-3), fx.InputDelay(0.4e-3), LATE, LAG, (LATE, LAG, fx.InputGain(0.8))],
    ids=["whole samples", "part of a sample", "between samples", "lag", "delay, lag and gain"],
)
def test_delay_and_lag_are_states_of_the_mode(effects):
    """A sliding axis is linear: two runs differ by the response of the mode to their drives."""
    axis = STAGE.replace(effects=effects)
    change = np.random.default_rng(3).standard_normal(400)
    runs = [axis.simulate(drive, DT, v0=0.5) for drive in (np.full(400, 30.0), 30.0 + change)]
    assert all((run.mode == 1).all() for run in runs)
    system = axis.mode_ss(1, DT, "zoh", at=(0.0, 0.1))
    response = ct.forced_response(system, runs[0].t, change)
    expected = runs[1].y[0] - runs[0].y[0]
    # The simulation integrates a lag to some 1e-10 m; a sample of delay would be 1e-5 m.
    np.testing.assert_allclose(response.outputs, expected, rtol=0.0, atol=1e-9)
    assert np.ptp(expected[1:] - expected[:-1]) > 1e-6


def test_the_lag_is_a_state_of_the_continuous_mode():
    """Behind the other effects on the drive, as in the simulation."""
    axis = STAGE.replace(effects=(fx.DeadZone(width=3.0), fx.ActuatorLag(time_constant=0.02)))
    run = axis.simulate(np.full(101, 20.0), DT, v0=0.5)
    assert (run.mode == 1).all()
    start, exactly = [0.0, 0.5, 0.0], {"rtol": 1e-10, "atol": 1e-12}
    alone = ct.input_output_response(axis.mode(1), run.t, 20.0, start, solve_ivp_kwargs=exactly)
    np.testing.assert_allclose(alone.outputs, run.y[:3], rtol=1e-8, atol=1e-10)


def test_a_mode_reads_the_position_as_the_encoder_does():
    disc = fx.EccentricEncoder(amplitude=1e-3, period=0.04, phase=0.3)
    axis, x, turn = STAGE.replace(effects=disc), 0.013, 2.0 * np.pi / 0.04
    read = axis.mode(1).output(0.0, [x, 0.1], [9.0])[0]
    assert read == pytest.approx(x + 1e-3 * np.sin(turn * x + 0.3), rel=1e-12)
    for index in (0, 1):
        slope = axis.mode_ss(index, DT, at=(x, 0.1)).C[0, 0]
        assert slope == pytest.approx(1.0 + 1e-3 * turn * np.cos(turn * x + 0.3), rel=1e-7)


@pytest.mark.parametrize(
    "effect", [fx.Presliding(1e-5), fx.Backlash(1e-4, 0.5), fx.Compliance(2e4, 3.0, 0.4)]
)
def test_what_a_mode_cannot_contain_is_refused(effect):
    axis = STAGE.replace(effects=effect)
    for call in (axis.mode, axis.mode_ss, lambda i: axis.mode_ss(i, DT, at=(0.0, 0.1))):
        with pytest.raises(ValueError, match=f"no place for {effect.slug}: leave it out"):
            call(1)
    # A controller is designed for the rigid axis, as it says.
    made, plain = (
        dfc.PositionController.from_bandwidth(a, 5.0, DT, limit=9.0) for a in (axis, STAGE)
    )
    np.testing.assert_array_equal(made.gains, plain.gains)


@pytest.mark.parametrize(("effect", "call", "words"), [
    (LATE, lambda a: a.mode(1), r"no states in continuous time: take mode_ss\(1, dt, at=\.\.\.\)"),
    (LATE, lambda a: a.mode_ss(1), "no states in continuous time: give dt"),
    (LATE, lambda a: a.mode_ss(1, 1e-6), "3.4e.03 states at dt = 1e-06 s, at most 1000"),
    (fx.ActuatorLag(0.4e-3), lambda a: a.mode_ss(1, DT), r"dt \* 1 / lag < 2, got 2\.5"),
])  # fmt: skip
def test_delays_and_lags_that_have_no_states_are_refused(effect, call, words):
    with pytest.raises(ValueError, match=words):
        call(STAGE.replace(effects=effect))
