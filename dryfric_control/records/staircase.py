"""A channel that a slower source holds: its readings are repeated on the rows of a faster one."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dryfric_control.arrays import Floats, Ints

# Changes that a staircase has at least, and its longest stay at one value [samples].
_CHANGES = 40
_LONGEST = 200
# Largest distance of a change from the even clock of all of them [samples].
_OFF_CLOCK = 1.0
# Mean square of the changes over the variance, above which the channel is switched, not sampled:
# 2 for steps of random size, 4 for a square wave.
_SWITCHED = 0.5
# Median change in steps of the recording, below which it is coarse, not held.
_COARSE = 4.0
# Part of the changes that may be of one size: the steps of a ramp are.
_ONE_SIZE = 0.8


class Staircase(NamedTuple):
    """Where a held channel changes."""

    changes: Ints  # samples
    reads: Floats  # when it was read [samples]: by its own clock, at most one sample earlier
    period: float  # from change to change [samples], not always a whole number


def find_staircase(values: Floats, quantum: float) -> Staircase | None:
    """The staircase that a channel is, None if it is none.

    A channel is one if it changes on an even clock slower than its own, by many small steps. A
    square wave changes by large ones, a coarse channel on no clock.
    """
    steps = np.diff(values)
    changes = np.flatnonzero(steps) + 1
    if changes.size < _CHANGES or changes.size > 0.7 * values.size:
        return None
    size = np.abs(steps[changes - 1])
    usual = float(np.median(size))
    levels = values[changes]
    if np.mean(size**2) > _SWITCHED * np.var(levels) or usual < _COARSE * quantum:
        return None
    if np.mean(np.abs(size - usual) < 0.01 * usual) > _ONE_SIZE:
        return None
    period = float(np.median(np.diff(changes)))
    # Readings that happen to be equal leave a change out.
    for _ in range(3):
        numbers = np.append(0.0, np.cumsum(np.maximum(np.rint(np.diff(changes) / period), 1.0)))
        period, start = np.polyfit(numbers, changes, 1)
    off = np.abs(changes - start - period * numbers).max()
    there = changes.size / (numbers[-1] + 1.0)
    if not 1.4 < period < _LONGEST or off > _OFF_CLOCK or there < 0.5:
        return None
    since = changes - period * numbers
    return Staircase(changes, period * numbers + since.min(), float(period))
