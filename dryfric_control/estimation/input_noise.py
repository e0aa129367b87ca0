"""Noise that was recorded with an input, and rounding with which it was recorded."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator

import numpy as np
from scipy.signal import savgol_coeffs, savgol_filter

from dryfric_control.arrays import Floats
from dryfric_control.records.resolution import QUANTA

# Windows of the local polynomials [samples], each about 1.4 times the one before.
_WINDOWS = (9, 13, 17, 25, 33, 49, 65, 97, 129, 193, 257)
# Order of the local polynomials: of the fourth they bend little of an input, where parabolas seem
# to delay it.
_POLYNOMIAL_ORDER = 4
# Standard deviations by which noise hardly ever exceeds: what is farther off is no noise.
_MAX_NOISE_DEVIATIONS = 3.0
# Median size of a second difference of white noise with unit variance.
_MEDIAN_SECOND_DIFFERENCE = 0.6745 * math.sqrt(6.0)
# Half width of the intervals, in standard errors, where what is taken off is rounding.
_ROUNDING_WIDTH = 1.5


def noise_of(u: Floats) -> float:
    """Standard deviation of the white noise of an input, by its second differences."""
    return float(np.median(np.abs(np.diff(u, 2)))) / _MEDIAN_SECOND_DIFFERENCE


def without_noise(u: Floats, width: float) -> Floats:
    """Input without the white noise recorded with it; intervals of `width` standard errors."""
    noise = noise_of(u)
    return _smooth_adaptively(u, noise, width, _MAX_NOISE_DEVIATIONS * noise) if width > 0.0 else u


def before_rounding(u: Floats, quantum: float, rng: np.random.Generator) -> Iterator[Floats]:
    """Inputs that may have acted where `u` was recorded in steps of `quantum`, without end.

    Nowhere more than half a step from `u`, from another place of the steps, which the record does
    not show: while the input changes by less than a step, the error of rounding stays.
    """
    if quantum == 0.0:
        yield from itertools.repeat(u)
    smooth = _smooth_adaptively(u, quantum / QUANTA, _ROUNDING_WIDTH, 0.5 * quantum)
    while True:
        steps = (smooth - rng.uniform(0.0, quantum)) / quantum
        yield u + quantum * (steps - np.round(steps))


def _smooth_adaptively(u: Floats, noise: float, width: float, surely: float) -> Floats:
    """Local polynomials over the longest windows that agree with all shorter ones.

    They agree where their intervals, of `width` standard errors of white `noise`, have a point in
    common (intersection of confidence intervals: Goldenshluger and Nemirovski 1997, Katkovnik
    1999); `surely`: distance that the noise hardly exceeds.
    """
    low = u - surely
    high = u + surely
    found = u
    agree = np.ones(u.size, bool)
    for n in (n for n in _WINDOWS if n <= u.size):
        smooth = savgol_filter(u, n, _POLYNOMIAL_ORDER)
        error = width * noise * float(np.linalg.norm(savgol_coeffs(n, _POLYNOMIAL_ORDER)))
        low = np.maximum(low, smooth - error)
        high = np.minimum(high, smooth + error)
        agree &= low <= high
        found = np.where(agree, smooth, found)
    return found
