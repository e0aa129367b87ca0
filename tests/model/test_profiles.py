"""Reference motions: exact limits, exact ends, the closed form of the textbook."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import dryfric_control as dfc
from dryfric_control.model.profiles import move_phases

limit = st.floats(1e-3, 1e3)


@settings(max_examples=200, deadline=None)
@given(way=st.floats(1e-6, 1e2), v=limit, a=limit, j=limit)
def test_phases_meet_the_end_within_the_limits(way, v, a, j):
    jerks, lengths = move_phases(way, v, a, j)
    assert np.all(lengths >= 0.0)
    x = u = b = top_v = top_a = 0.0
    for jerk, h in zip(jerks, lengths, strict=True):
        x += h * (u + h * (b / 2.0 + h * jerk / 6.0))
        u += h * (b + h * jerk / 2.0)
        b += h * jerk
        top_v, top_a = max(top_v, u), max(top_a, abs(b))
    # Seven phases, each of a few operations: round-off relative to the largest values.
    assert abs(x - way) <= 1e-12 * way
    assert abs(u) <= 1e-12 * top_v and abs(b) <= 1e-12 * top_a
    assert top_v <= v * (1 + 1e-12) and top_a <= a * (1 + 1e-12)


def test_duration_of_a_known_move():
    """D/v + v/a + a/j with speed and acceleration both reached."""
    move = dfc.motion_profile(0.1, 1e-3, velocity=0.2, acceleration=2.0, jerk=40.0)
    assert move.duration == pytest.approx(0.1 / 0.2 + 0.2 / 2.0 + 2.0 / 40.0)
    assert move.position[-1] == 0.1 and move.velocity[-1] == 0.0


def test_rows_are_derivatives_of_each_other():
    move = dfc.motion_profile(
        [0.02, 0.1, -0.3], 1e-3, velocity=0.2, acceleration=2.0, jerk=40.0, dwell=[0.1, 0.0, 0.2]
    )
    # Between samples the jerk is constant but for one change: dt^2 j and dt j at most.
    middle = 0.5 * (move.velocity[1:] + move.velocity[:-1])
    assert np.abs(np.diff(move.position) / 1e-3 - middle).max() < 40.0 * 1e-6
    middle = 0.5 * (move.acceleration[1:] + move.acceleration[:-1])
    assert np.abs(np.diff(move.velocity) / 1e-3 - middle).max() < 40.0 * 1e-3
    assert np.all(move.position[:101] == 0.02)
    assert np.all(move.position[-201:] == -0.3) and np.all(move.velocity[-201:] == 0.0)


def test_positions_alone_are_differenced():
    t = np.arange(400) * 1e-3
    motion = dfc.MotionProfile.of(0.5 * t**2, 1e-3)
    # Central differences of a parabola are exact but for round-off: eps x / dt^2.
    assert np.abs(motion.velocity[1:-1] - t[1:-1]).max() < 1e-10
    assert np.abs(motion.acceleration[1:-1] - 1.0).max() < 1e-7


def test_a_rotary_motion_is_shown_in_radians():
    move = dfc.motion_profile(1.0, 1e-3, velocity=2.0, acceleration=10.0, jerk=200.0, unit="rad")
    assert "to 1 rad, at most 2 rad/s and 10 rad/s^2" in repr(move)
    labels = [ax.get_ylabel() for ax in move.plot().axes.flat]
    assert labels == ["position [rad]", "velocity [rad/s]", "acceleration [rad/s²]"]


def test_a_profile_in_other_units_than_the_axis_is_refused():
    axis = dfc.FrictionAxis(mass=0.01, viscous=0.1, coulomb=0.5, units=("rad", "N m"))
    loop = dfc.PositionController.from_bandwidth(axis, 5.0, 1e-3)
    given = dict(velocity=2.0, acceleration=10.0, jerk=200.0)
    with pytest.raises(ValueError, match=r"reference is in 'm', the axis in 'rad'.*unit='rad'"):
        dfc.simulate_loop(axis, loop, dfc.motion_profile(1.0, 1e-3, **given))
    with pytest.raises(ValueError, match="one sampling time"):
        dfc.simulate_loop(axis, loop, dfc.motion_profile(1.0, 2e-3, unit="rad", **given))
    move = dfc.motion_profile(1.0, 1e-3, unit="rad", **given)
    assert dfc.simulate_loop(axis, loop, move).time.size == move.position.size
