"""The extended state observer against closed forms and the equations of its sources."""

import numpy as np
import pytest
from observers import DT, QUANTUM, drive_and_reading
from scipy.linalg import expm

import dryfric_control as dfc

AXIS = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0, stick_speed=1e-3)


def sampled(axis, dt):
    """Position, velocity and constant force over a sample, by the matrix exponential."""
    rates = np.zeros((3, 3))
    rates[0, 1] = 1.0
    rates[1, 1] = -axis.viscous / axis.mass
    rates[1, 2] = 1.0 / axis.mass
    return expm(rates * dt)


@pytest.mark.parametrize("bandwidth", (30.0, 300.0, 900.0))
def test_without_damping_the_gains_are_those_of_the_source(bandwidth):
    axis, b = AXIS.replace(viscous=0.0), np.exp(-bandwidth * DT)
    published = (1 - b**3, 1.5 * (1 - b) ** 2 * (1 + b) / DT, 2.0 * (1 - b) ** 3 / DT**2)
    gains = dfc.extended_state_observer(axis, DT, bandwidth=bandwidth).gains
    # Ackermann's formula loses digits by the condition of three equal poles.
    assert gains == pytest.approx(published, rel=1e-7)


@pytest.mark.parametrize("bandwidth", (30.0, 900.0))
def test_all_poles_lie_at_the_bandwidth(bandwidth):
    plant = sampled(AXIS, DT)
    gains = dfc.extended_state_observer(AXIS, DT, bandwidth=bandwidth).gains
    error = (np.eye(3) - np.outer(gains, [1.0, 0.0, 0.0])) @ plant
    b = np.exp(-bandwidth * DT)
    # Coefficients, since a triple root moves by the third root of round-off.
    assert np.poly(error) == pytest.approx([1.0, -3 * b, 3 * b**2, -(b**3)], rel=1e-7)


def textbook(observer, u, y):
    """Correction and prediction in matrices, with the nominal friction taken off the drive."""
    plant, axis = sampled(observer.axis, observer.dt), observer.axis
    level = axis.coulomb(0.0, 1) if observer.feedforward else 0.0
    state, rows = np.array([y[0], 0.0, 0.0]), []
    for drive, reading in zip(u, y, strict=True):
        state = state + observer.gains * (reading - state[0])
        mode = np.sign(state[1]) if abs(state[1]) > observer.rest_speed else 0.0
        nominal = mode * level if mode else np.clip(drive, -level, level)
        rows.append([state[0], state[1], nominal - state[2], state[2], mode])
        state = plant @ [state[0], state[1], drive - nominal + state[2]]
        state[2] = rows[-1][3]
    return np.transpose(rows)


@pytest.mark.parametrize("feedforward", (False, True))
def test_it_runs_its_equation(feedforward):
    u, y = drive_and_reading(1500, AXIS)
    observer = dfc.extended_state_observer(AXIS, DT, QUANTUM, feedforward=feedforward)
    rows, run = textbook(observer, u, y), observer.run(u, y).y
    scale = np.abs(rows).max(axis=1, keepdims=True)
    # The same sums in another order, with poles at one half.
    assert np.abs(run - rows).max(where=scale > 0.0, initial=0.0) < 1e-9 * scale.max()
    assert np.array_equal(run[4], rows[4])


def test_a_constant_force_leaves_no_error():
    axis = AXIS.replace(coulomb=0.0, stick_speed=1e-6)
    pushed = axis.replace(effects=(dfc.effects.BiasForce(1.5),))
    u = np.full(3000, 4.0)
    plant = pushed.simulate(u, DT)
    observer = dfc.extended_state_observer(axis, DT, 1e-9, bandwidth=100.0)
    x, v, friction = observer.run(u, plant.y[0]).y[:3, -1]
    assert (x, v) == pytest.approx(plant.y[:2, -1], rel=1e-9)
    # A bias of 1.5 N in the direction of motion is a friction of -1.5 N, or the other way round.
    assert abs(friction) == pytest.approx(1.5, rel=1e-6)


@pytest.mark.parametrize("feedforward", (False, True))
def test_it_follows_a_plant_within_what_the_arena_shows(feedforward):
    u, y = drive_and_reading(4000, AXIS)
    plant = AXIS.simulate(u, DT)
    run = dfc.extended_state_observer(AXIS, DT, QUANTUM, feedforward=feedforward).run(u, y)
    error = (run.y[1] - plant.y[1])[200:]
    # 1 % of the velocity on closed loops of the arena, without the jumps of this drive.
    assert np.sqrt(np.mean(error**2)) < 0.05 * np.std(plant.y[1][200:])


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"bandwidth": 0.0}, "bandwidth"),
        ({"feedforward": "yes"}, "feedforward must be True or False"),
        ({"rest_speed": -1.0}, "rest_speed"),
        ({"encoder_quantum": 0.0}, "encoder_quantum"),
    ],
)
def test_arguments_are_checked(change, words):
    with pytest.raises(ValueError, match=words):
        dfc.extended_state_observer(AXIS, **change)


def test_an_axis_without_coulomb_friction_needs_a_bandwidth():
    with pytest.raises(ValueError, match="bandwidth has no default"):
        dfc.extended_state_observer(AXIS.replace(coulomb=0.0))


def test_one_increment_is_no_motion_wherever_the_axis_rests():
    for quantum in (1e-6, 3.7e-6, QUANTUM):
        observer = dfc.extended_state_observer(AXIS, DT, quantum)
        for place in (*range(0, 2000, 7), *range(10**6, 10**6 + 50)):
            y = quantum * (place + np.array([0.0, 0.0, 1.0]))
            assert observer.run(np.zeros(3), y).y[4].tolist() == [0.0, 0.0, 0.0]
