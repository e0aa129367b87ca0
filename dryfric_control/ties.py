"""Choices that round-off must not make: which numbers are equal, and who wins then.

A sum in another order or another processor changes results in their last digits.
Wherever numbers that differ by no more are compared to choose something, the rule
is this one: they are equal, and the first wins, which is the simplest or the
coarsest.  Differences that a record resolves are far larger than `NEAR`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

#: Part of a range, or of a number, below which a difference is round-off: some
#: hundred times what long sums lose, and finer than an encoder of 32 bit.
NEAR = 1e-10
#: Difference of two sums of squared errors, each over its variance, that tells
#: nothing: a parameter a thousandth of its standard error off makes as much.
SQUARES = 1e-6


def above(a: ArrayLike, b: ArrayLike, least: float = 0.0) -> NDArray[np.bool_]:
    """Whether numbers exceed a limit by more than round-off.

    Parameters
    ----------
    a : array_like
        Numbers.
    b : array_like
        Limit.
    least : float, optional
        Difference that tells nothing, beside round-off of the limit itself:
        that of positions is a part of their range.

    Returns
    -------
    ndarray of bool
        a > b + 1e-10 abs(b) + least

    Examples
    --------
    >>> bool(above(3 * 0.1, 0.3)), bool(above(0.31, 0.3))
    (False, True)
    """
    return np.asarray(np.asarray(a) > np.asarray(b) + NEAR * np.abs(b) + least)


def ranked(values: ArrayLike, least: float = 0.0) -> list[int]:
    """Indices from the smallest value to the largest; equal ones in the order given.

    Parameters
    ----------
    values : array_like, shape (n,)
        Values; those that are not numbers come last.
    least : float, optional
        Difference that tells nothing, beside round-off.

    Returns
    -------
    list of int

    Examples
    --------
    >>> ranked([3 * 0.1, 0.3, 0.2])
    [2, 0, 1]
    """
    numbers = np.nan_to_num(np.asarray(values, dtype=float), nan=np.inf, posinf=np.inf)
    found: list[int] = []
    equal: list[int] = []
    limit = -np.inf
    for i in np.argsort(numbers, kind="stable").tolist():
        if numbers[i] > limit:
            found += sorted(equal)
            equal, limit = [], numbers[i] + NEAR * abs(numbers[i]) + least
        equal.append(i)
    return found + sorted(equal)


def samples(time: float, dt: float) -> int:
    """Whole number of steps nearest to a time; the even one of two as near.

    Parameters
    ----------
    time : float
        Time [s].
    dt : float
        Step [s].

    Returns
    -------
    int

    Examples
    --------
    >>> samples(0.25, 0.004), samples(0.25, 0.004 * (1.0 - 1e-15))
    (62, 62)
    """
    ratio = time / dt
    half = 0.5 * round(2.0 * ratio)
    return round(half if abs(ratio - half) <= NEAR * abs(half) else ratio)
