"""Which samples of a record slide, and which way: from the data alone."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dryfric_control.arrays import Bools, Floats, Ints
from dryfric_control.ties import NEAR, samples

#: A `Record`, which is built upon this module.
Record = Any

# A motion counts once it exceeds what a reading at rest can do.
# Toggling between two codes, in encoder quanta.
_CODES = 1.5
# White noise, in standard deviations: some five of a difference of two readings.
_DEVIATIONS = 8.0
#: Longest half width over which a motion is looked for [s].
LONGEST = 0.05
#: Largest over smallest velocity below which there is only one.
ONE_VELOCITY = 2.0


def least_motion(record: Record) -> float:
    """Smallest way that quantum and noise of a record do not explain."""
    steps = _CODES * (record.quantum or 0.0)
    noise = _DEVIATIONS * record.noise
    return float(max(steps, noise, NEAR * record.range))


def is_undriven(record: Record) -> bool:
    """Whether no known force acts: the motion then fixes all forces only as ratios to the mass."""
    return not record.net_input.any()


def usual_speeds(v: Floats) -> tuple[float, float]:
    """Smallest and largest absolute velocity in 90 % of some motion."""
    slow, fast = np.quantile(np.abs(v), (0.05, 0.95)) if v.size else (0.0, 0.0)
    return float(slow), float(fast)


def fast_speed(record: Record) -> float:
    """Largest usual velocity of a record in motion, infinite for one without."""
    moving = directions(record) != 0
    return usual_speeds(record.derivatives().v[moving])[1] if moving.any() else math.inf


def directions(record: Record) -> NDArray[np.int8]:
    """Direction of motion at every sample from the readings: +1 or -1 sliding, 0 motionless."""
    # Over some half width h, readings h before and after differ by more than quantum and noise
    # explain.  Both halves must move: an axis about to break away still counts as motionless.
    x = record.x
    least = least_motion(record)
    result = np.zeros(x.size, np.int8)
    longest = min(max(5, samples(LONGEST, record.dt)), (x.size - 1) // 2)
    h = 1
    while True:
        back = x[h:-h] - x[: -2 * h]
        ahead = x[2 * h :] - x[h:-h]
        for s in (1, -1):
            goes = s * (back + ahead) >= least
            goes &= (s * back >= 0.35 * least) & (s * ahead >= 0.35 * least)
            goes &= result[h:-h] == 0
            result[h:-h][goes] = s
        if h >= longest:
            return result
        h = min(longest, max(h + 1, round(1.4 * h)))


def rest_times(record: Record) -> Floats:
    """Time for which the axis has been motionless at every sample [s], 0 while sliding."""
    last = last_index_so_far(directions(record) != 0, 0)
    return np.asarray((np.arange(len(record)) - last) * record.dt)


def breakaways(record: Record) -> tuple[Ints, Floats]:
    """Last samples at rest before a motion that the next reading shows, and its directions."""
    least = least_motion(record)
    step = np.diff(record.x)
    still = np.abs(record.x[2:] - record.x[:-2]) <= least
    starts = 2 + np.flatnonzero(still[:-1] & (np.abs(step[2:]) > least))
    return starts, np.sign(step[starts])


def last_index_so_far(there: Bools, none: int) -> Ints:
    """Index of the last sample so far at which something is there, `none` before the first."""
    index = np.where(there, np.arange(there.size), none)
    return np.asarray(np.maximum.accumulate(index), dtype=np.int64)


def reversals(record: Record) -> Bools:
    """Samples at which motion sets in the other way than before."""
    moving = directions(record).astype(int)
    way = moving[last_index_so_far(moving != 0, 0)]
    return np.asarray(way * np.concatenate((way[:1], way[:-1])) < 0)
