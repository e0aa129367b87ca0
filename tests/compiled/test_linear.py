"""The linear response of the filter: its adjoint, and a closed form."""

import numpy as np
import pytest

from dryfric_control.compiled.linear import Recursion, adjoint, innovation_change, play

N = 400


@pytest.fixture(params=[0.0, 1e3])
def recursion(request):
    """An axis that slides, sticks now and then, and is corrected by uneven gains."""
    rng = np.random.default_rng(0)
    slide = (rng.uniform(size=N) < 0.8).astype(float)
    gains = rng.uniform(0.0, 1.0, N), rng.uniform(0.0, 30.0, N)
    if request.param:  # those of read velocities
        gains = 1e-3 * gains[0], gains[1] / 30.0
    return Recursion(slide, *gains, 9.7e-4, 0.94, 2.4e-7, 4.8e-4, request.param)


def response(recursion, force, reading):
    out = np.empty((N, max(force.shape[1], reading.shape[1])))
    innovation_change(force, reading, recursion, out)
    return out


def test_the_adjoint_is_the_transpose(recursion):
    rng = np.random.default_rng(1)
    force, reading = rng.standard_normal((2, N, 1))
    weights, none = rng.standard_normal(N), np.zeros((0, 1))
    by_force, by_reading = adjoint(weights, recursion)
    # The sums differ by their order alone.
    change, moved = response(recursion, force, none), response(recursion, none, reading)
    assert weights @ change == pytest.approx(by_force @ force, rel=1e-12)
    assert weights @ moved == pytest.approx(by_reading @ reading, rel=1e-12)


def test_without_corrections_a_force_moves_the_axis_as_newton_says():
    """Constant force c on a mass: the reading runs behind by c t^2/(2 m)."""
    mass, dt, c = 2.0, 1e-3, 3.0
    free = Recursion(np.ones(N), np.zeros(N), np.zeros(N), dt, 1.0, 0.5 * dt * dt / mass, dt / mass)
    change = response(free, np.full((N, 1), c), np.zeros((0, 1)))[:, 0]
    t = dt * np.arange(N)
    np.testing.assert_allclose(change, -0.5 * c / mass * t * t, rtol=1e-9, atol=1e-15)


def test_a_velocity_is_read_as_the_change_of_a_position():
    """Where no correction follows: the reading runs behind by c t/m, and shows rates of errors."""
    dt, c = 1e-3, 3.0
    free = Recursion(np.ones(N), *np.zeros((2, N)), dt, 1.0, 0.25 * dt * dt, 0.5 * dt, 1.0 / dt)
    t, none = dt * np.arange(N)[:, None], np.zeros((0, 1))
    change = response(free, np.full((N, 1), c), none)
    np.testing.assert_allclose(change, -0.5 * c * t, rtol=1e-9, atol=1e-15)
    np.testing.assert_allclose(response(free, none, 4.0 * t)[1:], -4.0, rtol=1e-9)


def test_a_load_follows_within_its_play():
    x = np.array([0.0, 0.4, 1.0, 3.0, 2.5, 2.0, 0.0])
    assert play(x, 2.0).tolist() == [0.0, 0.0, 0.0, 2.0, 2.0, 2.0, 1.0]
