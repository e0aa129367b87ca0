"""Noise is taken off an input, and nothing else is."""

import numpy as np
import pytest
from scipy.signal import savgol_filter

from dryfric_control.estimation.input_noise import before_rounding, without_noise

T = 1e-3 * np.arange(8000)
# A smooth drive with jumps, as of steps of a reference.
U = 6.0 * np.sin(9.0 * T) + 4.0 * np.sign(np.sin(5.0 * T)) + 0.5 * np.sin(60.0 * T)


def heard(seed: int = 0) -> np.ndarray:
    return U + 0.3 * np.random.default_rng(seed).standard_normal(T.size)


def test_it_errs_less_than_any_window_of_one_length():
    left = np.std(without_noise(heard(), 1.25) - U)
    fixed = min(np.std(savgol_filter(heard(), n, 2) - U) for n in range(5, 131, 4))
    assert left < 0.5 * fixed


def test_what_it_takes_off_is_no_motion():
    off = heard() - without_noise(heard(), 1.25)
    # Slightly negative: where a window is short a sample keeps a part of its own noise.
    assert -0.2 < (off[1:] @ off[:-1]) / (off @ off) < 0.05
    assert np.std(off) == pytest.approx(0.3, rel=0.1)


def test_an_input_without_noise_stays():
    held = np.repeat(U[::50], 50)
    np.testing.assert_array_equal(without_noise(held, 2.0), held)
    np.testing.assert_array_equal(without_noise(heard(), 0.0), heard())
    # At the edge the polynomials of the first samples hold.
    np.testing.assert_allclose(without_noise(U[200:600], 1.5), U[200:600], atol=5e-3)


@pytest.mark.parametrize("samples", [3, 8, 9, 10, 64, 65])
def test_short_inputs_keep_their_length(samples):
    assert without_noise(heard()[:samples], 1.5).size == samples


def test_inputs_before_rounding_lie_within_half_a_step():
    u = 0.1 * np.round(10.0 * np.sin(2.0 * np.linspace(0.0, 1.0, 1001)))
    acted = next(before_rounding(u, 0.1, np.random.default_rng(0)))
    # Of an input that changes slowly, the error of rounding is nearly uniform: 0.1/sqrt(12).
    assert np.abs(acted - u).max() <= 0.05 and np.std(acted - u) > 0.02
