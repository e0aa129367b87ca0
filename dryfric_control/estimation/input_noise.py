"""Noise that was recorded with an input, and rounding with which it was recorded."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_coeffs, savgol_filter

from dryfric_control.records.resolution import QUANTA

FloatArray = NDArray[np.float64]

# Windows [samples], each about 1.4 times the one before, and order of the local polynomials: of
# the fourth they bend little of an input, where parabolas seem to delay it.
_WINDOWS, _ORDER = (9, 13, 17, 25, 33, 49, 65, 97, 129, 193, 257), 4
# Standard deviations by which noise hardly ever exceeds: what is farther off is no noise.
_SURELY = 3.0
# Median size of a second difference of white noise with unit variance.
_MEDIAN = 0.6745 * math.sqrt(6.0)
# Half width of the intervals, in standard errors, where what is taken off is rounding.
_ROUNDED = 1.5


def without_noise(u: FloatArray, width: float) -> FloatArray:
    """Input without the white noise that was recorded with it.

    Every sample is smoothed by a local polynomial over the longest window whose estimate
    agrees with those of all shorter ones: their intervals of `width` standard errors have a
    point in common.  Where the input is smooth windows are long, at its edges short.

    Parameters
    ----------
    u : ndarray, shape (n,)
        Recorded input [N].
    width : float
        Half width of the intervals in standard errors; 0 leaves the input as it is.

    Returns
    -------
    ndarray, shape (n,)

    Notes
    -----
    The rule is the intersection of confidence intervals (Goldenshluger and Nemirovski 1997,
    "On spatially adaptive estimation of nonparametric regression"; Katkovnik 1999, "A new
    method for varying adaptive bandwidth selection").  The noise is estimated from the
    median size of second differences.

    Examples
    --------
    >>> t = np.linspace(0.0, 1.0, 2001)
    >>> u = 5.0 * np.sign(t - 0.5) + np.sin(6.0 * t)
    >>> noisy = u + 0.2 * np.random.default_rng(0).standard_normal(t.size)
    >>> bool(np.std(without_noise(noisy, 1.25) - u) < 0.4 * np.std(noisy - u))
    True
    """
    noise = float(np.median(np.abs(np.diff(u, 2)))) / _MEDIAN
    return _smoothed(u, noise, width, _SURELY * noise) if width > 0.0 else u


def before_rounding(
    u: FloatArray, quantum: float, rng: np.random.Generator
) -> Iterator[FloatArray]:
    """Inputs that may have acted where `u` was recorded in steps of `quantum`, without end.

    While the input changes by less than a step, the error of rounding stays: it is white
    only where the input is fast.

    Parameters
    ----------
    u : ndarray, shape (n,)
        Recorded input [N].
    quantum : float
        Its steps [N]; 0 for none.
    rng : numpy.random.Generator
        Source of the place of the steps, which the record does not show.

    Yields
    ------
    ndarray, shape (n,)
        Nowhere more than half a step from `u`.

    Examples
    --------
    >>> t = np.linspace(0.0, 1.0, 1001)
    >>> u = 0.1 * np.round(10.0 * np.sin(2.0 * t))
    >>> acted = next(before_rounding(u, 0.1, np.random.default_rng(0)))
    >>> float(np.abs(acted - u).max()) <= 0.05, bool(np.std(acted - u) > 0.02)
    (True, True)
    """
    if quantum == 0.0:
        yield from itertools.repeat(u)
    smooth = _smoothed(u, quantum / QUANTA, _ROUNDED, 0.5 * quantum)
    while True:
        steps = (smooth - rng.uniform(0.0, quantum)) / quantum
        yield u + quantum * (steps - np.round(steps))


def _smoothed(u: FloatArray, noise: float, width: float, surely: float) -> FloatArray:
    """Local polynomials over the longest windows that agree with all shorter ones.

    `noise`: standard deviation of the noise; `surely`: distance that it hardly exceeds.
    """
    low, high = u - surely, u + surely
    found, agree = u, np.ones(u.size, bool)
    for n in (n for n in _WINDOWS if n <= u.size):
        smooth = savgol_filter(u, n, _ORDER)
        error = width * noise * float(np.linalg.norm(savgol_coeffs(n, _ORDER)))
        low, high = np.maximum(low, smooth - error), np.minimum(high, smooth + error)
        agree &= low <= high
        found = np.where(agree, smooth, found)
    return found
