"""Comparisons that do not depend on round-off: of equal numbers the first one wins."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from dryfric_control.arrays import Bools

#: Difference, relative to a range or a number, up to which it is round-off: some
#: hundred times the error of long sums, and finer than a 32-bit encoder.
NEAR = 1e-10


def exceeds(a: ArrayLike, b: ArrayLike, least: float = 0.0) -> Bools:
    """Whether a > b + 1e-10 abs(b) + least: numbers exceed a limit by more than round-off."""
    return np.asarray(np.asarray(a) > np.asarray(b) + NEAR * np.abs(b) + least)


def stable_order(values: ArrayLike, least: float = 0.0) -> list[int]:
    """Indices from the smallest to the largest value, NaN last; equal ones in the given order."""
    numbers = np.nan_to_num(np.asarray(values, dtype=float), nan=np.inf, posinf=np.inf)
    found: list[int] = []
    equal: list[int] = []
    limit = -np.inf
    for i in np.argsort(numbers, kind="stable").tolist():
        if numbers[i] > limit:
            found += sorted(equal)
            equal = []
            limit = numbers[i] + NEAR * abs(numbers[i]) + least
        equal.append(i)
    return found + sorted(equal)


def samples(time: float, dt: float) -> int:
    """Number of steps nearest to a time; halves are rounded to even."""
    ratio = time / dt
    half = 0.5 * round(2.0 * ratio)
    return round(half if abs(ratio - half) <= NEAR * abs(half) else ratio)
