"""Steps of the filter of the diagnosis, against closed forms and the axis' own exact step."""

import math

import numpy as np
import pytest
from numba import njit

import dryfric_control as dfc
from dryfric_control.compiled import axis_step, innovations, two_masses

H = 1e-3


@njit(error_model="numpy")
def coarse(numbers, integers, force, h, x, v):
    """A sample from one velocity under one force."""
    plant = axis_step.point(numbers, integers)
    fall = -math.expm1(-plant.numbers[axis_step.STICK_RATE] * h)
    return innovations._coarse_step(plant, axis_step.held_force(force), 0.0, h, x, v, 0.0, fall)


@njit(error_model="numpy")
def slopes(numbers, integers, x, v, s, dx):
    """Change of the sliding acceleration with position and velocity."""
    plant = axis_step.point(numbers, integers)
    held = axis_step.held_force(0.0)
    k = innovations._rate(plant, held, 0.0, x, v, s)
    return innovations._slopes(plant, 0.0, x, v, held, s, dx, k)


@njit(error_model="numpy")
def transition(numbers, integers, h, mode, touches):
    """How motor and load move in one sample, with their spring or within its gap."""
    return two_masses.transition(axis_step.point(numbers, integers), h, mode, touches)


@njit(error_model="numpy")
def read(cov, at, variance):
    """Covariance of two masses after a reading of a state."""
    two_masses.correct(cov, at, variance, np.empty((4, 4)))
    return cov


@njit(error_model="numpy")
def turned(p, g, d):
    """A covariance with its states in the other order."""
    return innovations._swap_states(p, g, d)


@pytest.mark.parametrize("h", (1e-4, 1e-3, 4e-3))
def test_two_masses_move_as_the_simulated_ones(h):
    # The load slides one way for ever, so that motions differ linearly with their start.
    spring = dfc.effects.Compliance(stiffness=3e4, damping=20.0, load_fraction=0.4)
    axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=1.0, effects=spring)
    arrays = axis.arrays(h)
    moves = transition(arrays.numbers, arrays.integers, h, 1.0, True)
    runs = [axis.simulate([20.0 + push] * 2, dt=h, x0=0.1, v0=1.0 + more).y[:2, 1]
            for push, more in ((0.0, 0.0), (1.0, 0.0), (0.0, 1e-2))]  # fmt: skip
    assert runs[1] - runs[0] == pytest.approx(moves[:2, 4], rel=1e-6)
    # At the start the load moves with the motor.
    assert (runs[2] - runs[0]) / 1e-2 == pytest.approx(moves[:2, 1] + moves[:2, 3], rel=1e-6)
    # The sum of both momenta changes by viscous friction and the force alone.
    momentum = np.array([0.0, 1.2, 0.0, 0.8]) @ moves[:4]
    assert momentum[1] == pytest.approx(1.2, rel=15.0 * h)
    assert momentum[4:] == pytest.approx([h, h], rel=15.0 * h)
    # A load at rest stays where it is.
    rests = transition(arrays.numbers, arrays.integers, h, 0.0, True)
    assert np.array_equal(rests[2:4], np.eye(6)[2:4])
    # Within a gap the motor flies alone, and the load is braked by its viscous friction.
    apart = transition(arrays.numbers, arrays.integers, h, 1.0, False)
    assert apart[:2, :2] == pytest.approx(np.array([[1.0, h], [0.0, 1.0]]), rel=1e-12)
    assert not apart[:2, 2:4].any() and not apart[2:4, :2].any()
    assert apart[3, 3] == pytest.approx(math.exp(-15.0 / 0.8 * h), rel=1e-9)


@pytest.mark.parametrize("at", (0, 1))
def test_a_reading_of_the_motor_tells_of_both_masses(at):
    root = np.random.default_rng(3).standard_normal((4, 4))
    cov, seen = root @ root.T, np.eye(4)[at]
    variance = cov[at, at] + 0.5
    expected = cov - np.outer(cov @ seen, seen @ cov) / variance
    assert read(cov.copy(), at, variance) == pytest.approx(expected, rel=1e-12, abs=1e-12)


def test_states_of_a_covariance_change_places():
    p, g, d = 0.3, -2.0, 0.7
    q, h, e = turned(p, g, d)
    assert (q, h * q, e + h * h * q) == pytest.approx((d + g * g * p, g * p, p), rel=1e-12)
    assert turned(q, h, e) == pytest.approx((p, g, d), rel=1e-12)
    assert turned(0.3, 0.0, 0.0) == (0.0, 0.0, 0.3)  # a velocity that is known


@pytest.mark.parametrize("way", (1, -1))
@pytest.mark.parametrize(("force", "v", "mode"), [
    (5.0, 0.02, 1),  # slides on, slower
    (5.0, 0.0008, 0),  # comes to rest inside the sample
    (-20.0, 0.005, -1),  # stops and sets out the other way
    (12.0, 0.0, 1),  # breaks away
    (7.0, 0.0, 0),  # is held
])  # fmt: skip
def test_a_coarse_sample_of_constant_friction_is_exact(force, v, mode, way):
    axis = dfc.FrictionAxis(mass=2.0, viscous=0.0, coulomb=8.0, stick_speed=1e-9)
    arrays = axis.arrays(H)
    x1, v1, mode1 = coarse(arrays.numbers, arrays.integers, way * force, H, 0.1, way * v)
    run = axis.simulate([way * force] * 2, dt=H, x0=0.1, v0=way * v)
    assert mode1 == way * mode
    # Constant acceleration is the motion, but for what is left of it at the stick velocity.
    assert x1 - 0.1 == pytest.approx(run.y[0][1] - 0.1, rel=1e-5, abs=1e-12)
    assert v1 == pytest.approx(run.y[1][1], rel=1e-5, abs=1e-8)


@pytest.mark.parametrize("s", (1.0, -1.0))
def test_slopes_of_the_acceleration(s):
    effects = (dfc.effects.QuadraticDrag(30.0), dfc.effects.Spring(stiffness=40.0))
    axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0, effects=effects)
    arrays = axis.arrays(H)
    by_x, by_v = slopes(arrays.numbers, arrays.integers, 0.1, s * 0.2, s, 1e-6)
    assert by_x == pytest.approx(-40.0 / 2.0, rel=1e-5)
    assert by_v == pytest.approx(-(15.0 + 2.0 * 30.0 * 0.2) / 2.0, rel=1e-3)
    plain = axis.replace(effects=()).arrays(H)
    assert slopes(plain.numbers, plain.integers, 0.1, s * 0.2, s, 1e-6) == (0.0, -15.0 / 2.0)


def test_a_coarse_sample_follows_viscous_friction_to_second_order():
    axis = dfc.FrictionAxis(mass=2.0, viscous=200.0, coulomb=8.0, stick_speed=1e-9)
    arrays = axis.arrays(H)
    _, v1, _ = coarse(arrays.numbers, arrays.integers, 30.0, H, 0.0, 0.05)
    end = (30.0 - 8.0) / 200.0
    exact = end + (0.05 - end) * np.exp(-100.0 * H)
    # (lambda h)^3/6 of what is left to the end speed; a first-order step is 30 times off.
    assert v1 == pytest.approx(exact, abs=1.1 * (100.0 * H) ** 3 / 6.0 * (end - 0.05))
