"""The resolution of a record, and its encoder applied to another path."""

import numpy as np
import pytest

import dryfric_control as dfc

T = 1e-3 * np.arange(2000)


def record(quantum=0.0, noise=0.0):
    x = np.sin(7.0 * T) + noise * np.random.default_rng(1).standard_normal(T.size)
    return dfc.Record(T, np.cos(T), quantum * np.round(x / quantum) if quantum else x)


def test_the_resolution_is_noise_quantum_and_rounding():
    clean, coarse, noisy = record(), record(quantum=1e-3), record(noise=1e-3)
    assert clean.resolution.quantum == noisy.resolution.quantum == 0.0
    assert coarse.resolution.quantum == pytest.approx(1e-3)
    assert clean.resolution.rounding == 1e-9 * clean.range
    assert noisy.resolution.deviation == pytest.approx(1e-3, rel=0.1)
    assert noisy.resolution.step == pytest.approx(np.sqrt(12) * 1e-3, rel=0.1)
    assert coarse.resolution.step >= coarse.resolution.quantum


def test_a_path_is_read_on_the_grid_and_with_the_noise_of_the_record():
    path = 0.3 * np.sin(5.0 * T)
    again = record(quantum=1e-3).read(path, np.random.default_rng(0), origin=0.0)
    np.testing.assert_allclose(again.x / 1e-3, np.round(again.x / 1e-3), atol=1e-9)
    noisy = record(noise=1e-3)
    error = noisy.read(path, np.random.default_rng(0)).x - path
    assert np.std(error) == pytest.approx(noisy.noise, rel=0.05)
    still = record(quantum=1e-3).read(np.zeros(T.size), np.random.default_rng(0))
    assert np.ptp(still.x) <= 2e-3


def test_record_with_another_input_or_other_positions():
    one = record(quantum=1e-3)
    other = one.replace(u=2.0 * one.u)
    np.testing.assert_array_equal(other.u, 2.0 * one.u)
    np.testing.assert_array_equal(other.x, one.x)
    assert other.quantum == one.quantum and one.replace(x=-one.x).x[5] == -one.x[5]
    with pytest.raises(ValueError, match="u has 3 samples"):
        one.replace(u=np.zeros(3))
    with pytest.raises(ValueError, match="x"):
        one.replace(x=np.full(T.size, np.nan))
