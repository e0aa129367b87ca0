"""Stick phases of a record and the size of its stick-slip ripple."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from dryfric_control.estimation.motion import directions
from dryfric_control.records.record import Record
from dryfric_control.ties import NEAR, above

# Shorter halts are not told from a reading that lags.
_SHORTEST = 10
# A move shorter than this part of the long slips is part of one stick phase:
# noise, or the creep at its beginning.
_SLIP = 0.1


@dataclass(frozen=True, eq=False)
class Sticks:
    """Stick phases that end in motion.

    Attributes
    ----------
    begin, end : ndarray of int, shape (n,)
        First sample at rest, and first sample in motion after it.
    direction : ndarray of int, shape (n,)
        Direction of that motion.
    """

    begin: NDArray[np.int64]
    end: NDArray[np.int64]
    direction: NDArray[np.int64]


@dataclass(frozen=True)
class Ripple:
    """Size of stick-slip ripple, medians over the slips.

    Attributes
    ----------
    amplitude : float
        Rise of the drive force's magnitude from its lowest to break-away.
    period : float
        Time from one break-away to the next [s].
    slip : float
        Way of one slip.
    count : int
        Number of slips.
    """

    amplitude: float
    period: float
    slip: float
    count: int

    def to_dict(self) -> dict[str, float]:
        """The numbers by name."""
        return asdict(self)


def stick_phases(record: Record) -> Sticks:
    """Stick phases of a record, found from the readings.

    Parameters
    ----------
    record : Record

    Returns
    -------
    Sticks
    """
    moving = directions(record)
    rest = np.flatnonzero(np.diff((moving == 0).astype(np.int8), prepend=0, append=0))
    begin, end = rest[::2], rest[1::2]
    keep = (end - begin >= _SHORTEST) & (end < len(record))
    begin, end = begin[keep], end[keep]
    if end.size > 1:
        ways = np.abs(record.x[begin[1:]] - record.x[end[:-1]])
        real = ~above(_SLIP * np.quantile(ways, 0.9), ways, NEAR * record.range)
        begin, end = begin[np.r_[True, real]], end[np.r_[real, True]]
    return Sticks(begin, end, moving[end].astype(np.int64))


def ripple(record: Record) -> Ripple | None:
    """Amplitude and period of a record's stick-slip ripple.

    Parameters
    ----------
    record : Record

    Returns
    -------
    Ripple or None
        None if fewer than three slips follow each other in one direction.

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> from dryfric_control.identification import ripple, slow_ramp_experiment
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0, travel=(0.0, 0.1),
    ...                         stribeck=dfc.Stribeck(excess=0.3, speed=0.01))
    >>> ripple(slow_ramp_experiment(axis, duration=20.0, quantum=1e-6).record).count > 3
    True
    """
    sticks = stick_phases(record)
    rows = []
    for i in range(sticks.end.size - 1):
        a, b = int(sticks.end[i]), int(sticks.end[i + 1])
        after = int(sticks.end[i + 2]) if i + 2 < sticks.end.size else len(record)
        if sticks.direction[i] != sticks.direction[i + 1]:
            continue
        # From trough to trough: noise may show a break-away too early.
        force = sticks.direction[i] * record.u
        trough = a + int(force[a:b].argmin())
        following = b + int(force[b:after].argmin())
        slip = abs(record.x[sticks.begin[i + 1]] - record.x[a])
        rows.append((force[trough:following].max() - force[trough], (b - a) * record.dt, slip))
    if len(rows) < 3:
        return None
    amplitude, period, slip = np.median(rows, axis=0)
    return Ripple(float(amplitude), float(period), float(slip), len(rows))
