"""Which samples of a record slide, and which way: from the data alone."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dryfric_control.ties import NEAR, samples

#: A `Record`, which is built upon this module.
Record = Any

# A motion counts once it exceeds what a reading at rest can do: toggling
# between two codes, or white noise at some five standard deviations of a
# difference of two readings.
_CODES, _DEVIATIONS = 1.5, 8.0
#: Longest half width over which a motion is looked for [s].
LONGEST = 0.05
#: Largest over smallest velocity below which there is only one.
ONE_VELOCITY = 2.0


def least_motion(record: Record) -> float:
    """Smallest way that quantum and noise of a record do not explain."""
    return max(_CODES * (record.quantum or 0.0), _DEVIATIONS * record.noise, NEAR * record.range)


def usual_speeds(v: NDArray[np.float64]) -> tuple[float, float]:
    """Smallest and largest absolute velocity in 90 % of some motion."""
    slow, fast = np.quantile(np.abs(v), (0.05, 0.95)) if v.size else (0.0, 0.0)
    return float(slow), float(fast)


def directions(record: Record) -> NDArray[np.int8]:
    """Direction of motion at every sample, found from the readings.

    Parameters
    ----------
    record : Record
        The record.

    Returns
    -------
    ndarray of int8, shape (n,)
        +1 or -1 sliding, 0 motionless.

    Notes
    -----
    A sample slides if, over some half width h of at most 0.05 s, the readings
    h before and h after it differ by more than quantum and noise explain, and
    the halves on both sides go the same way.  Both halves must move, so that a
    resting axis shortly before its break-away still counts as motionless.

    Examples
    --------
    >>> import numpy as np
    >>> import dryfric_control as dfc
    >>> t = 1e-3 * np.arange(900)
    >>> x = np.interp(t, [0.0, 0.3, 0.6, 0.9], [0.0, 0.0, 0.03, 0.03])
    >>> moving = directions(dfc.Record(t, np.cos(t), 1e-5 * np.round(1e5 * x)))
    >>> int(moving[100]), int(moving[450]), int(moving[800])
    (0, 1, 0)
    """
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


def rest_times(record: Record) -> NDArray[np.float64]:
    """Time for which the axis has been motionless at every sample [s].

    Parameters
    ----------
    record : Record
        The record.

    Returns
    -------
    ndarray, shape (n,)
        0 while sliding.
    """
    last = latest(directions(record) != 0, 0)
    return np.asarray((np.arange(len(record)) - last) * record.dt)


def latest(there: NDArray[np.bool_], none: int) -> NDArray[np.int64]:
    """Index of the last sample so far at which something is there, `none` before the first.

    Examples
    --------
    >>> latest(np.array([False, True, False, True]), -1).tolist()
    [-1, 1, 1, 3]
    """
    index = np.where(there, np.arange(there.size), none)
    return np.asarray(np.maximum.accumulate(index), dtype=np.int64)


def reversals(record: Record) -> NDArray[np.bool_]:
    """Samples at which motion sets in the other way than before."""
    moving = directions(record).astype(int)
    way = moving[latest(moving != 0, 0)]
    return np.asarray(way * np.concatenate((way[:1], way[:-1])) < 0)
