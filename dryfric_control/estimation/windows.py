"""Free runs over short windows, each restarted from the smoothed record."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_coeffs, savgol_filter

from dryfric_control.checks import instance, positive
from dryfric_control.compiled.axis_step import STRUCTURE
from dryfric_control.compiled.windowed_runs import (
    Evaluation,
    Search,
    Windowed,
    free_runs,
    project,
)
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.records.motion import LONGEST, least_motion, rest_times
from dryfric_control.records.record import Record
from dryfric_control.ties import NEAR, SQUARES, above, ranked, samples

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

#: Median score of the moving windows up to which free runs reach the readings' noise, 0.22.
REACHED = 0.35
#: A window pulls in full up to this multiple of the scale of its errors: the few with a
#: mistimed break-away count less, but no whole direction is given up
#: (`benchmarks/identification.py coverage`, `benchmarks/diagnosis.py`).
ROBUST = 2.0
# A window moves if its readings range over this many standard deviations of their
# noise (`benchmarks/diagnosis.py`, condition short).
_MOVING = 4.0
# Rounds of new slopes in the search of a start, and other speeds from which a window far
# above the scale is searched again, over their error (`benchmarks/diagnosis.py
# dwell_time stribeck`).
_ROUNDS, _OFFSETS = 2, np.array([-0.3, 0.3, -1.0, 1.0, -2.0, 2.0])
# Windows that a quick look at a candidate runs (`benchmarks/diagnosis.py`, run times).
_FEW = 14


def shifted(u: FloatArray, samples: float) -> FloatArray:
    """Held input that acts some samples later, as means over each sample.

    The mean keeps the impulse, which is all that position and speed at the
    next sample see of it but for a part of order dt^2.
    """
    if samples == 0.0:
        return u
    whole = math.floor(samples)
    part = samples - whole
    index = np.arange(u.size)
    newer = u[np.clip(index - whole, 0, u.size - 1)]
    older = u[np.clip(index - whole - 1, 0, u.size - 1)]
    return np.asarray((1.0 - part) * newer + part * older)


@dataclass(frozen=True, eq=False)
class Windows:
    """A record cut into windows, with the state at each start.

    Made by `cut`.

    Attributes
    ----------
    record : Record
    edges : ndarray of int64, shape (nwindows + 1,)
        First sample of each window, and the end.
    x0, v0 : ndarray, shape (nwindows,)
        Smoothed state at each start.
    x0_error, v0_error : ndarray, shape (nwindows,)
        Standard deviation of that state: encoder noise through the
        smoothing, and what the smoothing itself may have smeared.
    rest : ndarray, shape (nwindows,)
        Time at rest before each start [s].
    hold : str
        "zero" or "first".
    floor : float
        Standard deviation of the readings' noise, quantisation included.
    """

    record: Record
    edges: NDArray[np.int64]
    x0: FloatArray
    v0: FloatArray
    x0_error: FloatArray
    v0_error: FloatArray
    rest: FloatArray
    hold: str
    floor: float

    def __len__(self) -> int:
        return self.edges.size - 1

    @cached_property
    def samples(self) -> NDArray[np.int64]:
        """Number of samples in each window, shape (nwindows,)."""
        return np.diff(self.edges)

    @property
    def start_times(self) -> FloatArray:
        """Time at which each window starts [s], shape (nwindows,)."""
        return np.asarray(self.record.t[self.edges[:-1]])

    @cached_property
    def moving(self) -> BoolArray:
        """Windows whose readings move by more than noise, shape (nwindows,)."""
        x, starts = self.record.x, self.edges[:-1]
        reach = np.maximum.reduceat(x, starts) - np.minimum.reduceat(x, starts)
        return above(reach, _MOVING * self.floor, NEAR * self.record.range)

    def arrays(self, shift: float = 0.0) -> Windowed:
        """The same as arrays for compiled functions, the input acting later by a shift."""
        record = self.record
        return Windowed(
            shifted(record.u, shift / record.dt), record.x, float(record.t[0]), record.dt,
            self.hold == "first", self.edges, self.x0, self.v0, self.x0_error, self.v0_error,
            self.rest,
        )  # fmt: skip

    def run(
        self,
        axis: FrictionAxis,
        shift: float = 0.0,
        dx: FloatArray | float = 0.0,
        dv: FloatArray | float = 0.0,
        active: BoolArray | None = None,
    ) -> FloatArray:
        """Positions of the free runs.

        Parameters
        ----------
        axis : FrictionAxis
            The axis to run.  Its inner states, which no record shows, go on from
            window to window.
        shift : float, optional
            Time by which the input acts later than recorded, negative if
            sooner [s].  Unlike a delay it belongs to the record.
        dx, dv : float or ndarray, shape (nwindows,)
            Added to the state at the starts.
        active : ndarray of bool, shape (nwindows,), optional
            Windows to run; the others get no value.  Default: all, as where
            the axis has inner states.

        Returns
        -------
        ndarray, shape (n,)
            One position for each sample of the record.

        Examples
        --------
        >>> import numpy as np
        >>> import dryfric_control as dfc
        >>> t = 1e-3 * np.arange(1000)
        >>> windows = cut(dfc.Record(t, np.cos(t), np.sin(3 * t)), window=0.25)
        >>> axis = dfc.FrictionAxis(mass=1.0, viscous=0.0, coulomb=0.5)
        >>> near = windows.run(axis, dv=1e-3)
        >>> round(float(near[249] - windows.run(axis)[249]), 6)
        0.000249
        """
        windowed = self.arrays(shift)._replace(x0=self.x0 + dx, v0=self.v0 + dv)
        return positions(axis, windowed, active)

    def evaluate(
        self,
        axis: FrictionAxis,
        active: BoolArray,
        scale: float | None = None,
        starts: FloatArray | None = None,
        rounds: int = _ROUNDS,
        thorough: bool = False,
        shift: float = 0.0,
    ) -> Evaluation:
        """Errors of an axis over windows, each from its most likely start state.

        Parameters
        ----------
        axis : FrictionAxis
        active : ndarray of bool, shape (nwindows,)
            Windows to run.
        scale : float, optional
            Standard deviation of the errors.  Default: `floor`.
        starts : ndarray, shape (3, nwindows), optional
            Where the search of the starts begins, as in `Evaluation`.
        rounds : int, optional
            Rounds of the search; below 0 the runs are from `starts` as they are.
        thorough : bool, optional
            Whether windows that end far above the scale are searched again, from
            other speeds.
        shift : float, optional
            Time by which the input acts later than recorded [s].
        """
        n, offsets = int(self.edges[-1]), _OFFSETS if thorough else _OFFSETS[:0]
        starts = no_corrections(len(self)) if starts is None else starts.copy()
        at = Evaluation(np.zeros(n), np.zeros(n), np.zeros(n), starts, np.zeros(len(self)))
        scale = self.floor if scale is None else scale
        search = Search(active, linked(axis), uniform(axis), scale, rounds, offsets)
        project(axis.arrays(self.record.dt), self.arrays(shift), search, at)
        return at

    def loss(self, costs: FloatArray, active: BoolArray) -> float:
        """Sum over the windows of n c^2 log(1 + cost/(n c^2))."""
        n = self.samples[active] * ROBUST**2
        return float(np.sum(n * np.log1p(costs[active] / n)))

    def scores(self, costs: FloatArray) -> FloatArray:
        """log(1 + cost/(n c^2)) of every window: 0.22 at the noise floor."""
        return np.asarray(np.log1p(costs / (self.samples * ROBUST**2)))

    def reached(self, scores: FloatArray, seen: BoolArray | bool = True) -> bool:
        """Whether free runs err by no more than the readings' noise, by the median.

        Then no random force is at work, and free runs are the sharpest judge.

        Parameters
        ----------
        scores : ndarray, shape (nwindows,)
            `scores` at the noise of the readings.
        seen : ndarray of bool, shape (nwindows,), optional
            Windows that count, of those that move.
        """
        seen = seen & self.moving
        return bool(np.any(seen) and np.median(scores[seen]) < REACHED)

    def weights(self, costs: FloatArray) -> FloatArray:
        """Pull of every window on the parameters, the slope of its part of the loss."""
        return np.asarray(1.0 / (1.0 + costs / (self.samples * ROBUST**2)))

    def sieve(self, active: BoolArray, scores: FloatArray, most: int = _FEW) -> BoolArray:
        """Some of the windows: the worst, where what is rare shows, and others evenly."""
        picked = np.zeros(active.size, bool)
        known = np.flatnonzero(active)
        picked[known[ranked(-scores[known], SQUARES)[: most // 2]]] = True
        others = np.flatnonzero(active & self.moving & ~picked)
        if others.size:
            some = np.unique(np.linspace(0, others.size - 1, most - most // 2).astype(int))
            picked[others[some]] = True
        return picked

    def spread(self, values: NDArray) -> NDArray:
        """One value a window, repeated over its samples, shape (n,)."""
        return np.repeat(values, self.samples)

    def mean_squares(self, errors: FloatArray) -> FloatArray:
        """Mean square of the errors in each window, shape (nwindows,)."""
        return np.asarray(np.add.reduceat(errors**2, self.edges[:-1]) / self.samples)


def no_corrections(count: int) -> FloatArray:
    """Start states as they are, shape (3, nwindows), see `Evaluation`."""
    starts = np.zeros((3, count))
    starts[2] = np.nan
    return starts


def positions(
    axis: FrictionAxis,
    windowed: Windowed,
    active: BoolArray | None = None,
    starts: FloatArray | None = None,
) -> FloatArray:
    """Positions of free runs over the active windows, shape (n,).

    Without `starts` all windows of an axis with inner states are run; with them
    (see `Evaluation`), the active ones and those that hand on to them.
    """
    arrays, count = axis.arrays(windowed.dt), windowed.edges.size - 1
    if active is None or (starts is None and arrays.integers[STRUCTURE]):
        active = np.ones(count, bool)
    out = np.zeros(int(windowed.edges[-1]))
    hand_on = starts is not None and linked(axis)
    starts = no_corrections(count) if starts is None else starts
    free_runs(arrays, windowed, active, hand_on, starts, out)
    return out


def uniform(axis: FrictionAxis) -> bool:
    """Whether an axis is the same at every position."""
    constant = len(axis.coulomb.plus) == 1 and len(axis.coulomb.minus) == 1
    return constant and not any(e.depends_on_place for e in axis.effects)


def linked(axis: FrictionAxis) -> bool:
    """Whether windows hand on an internal memory; a drive's is known from its command."""
    return any(e.remembers and e.action not in ("delay", "lag") for e in axis.effects)


def cut(
    record: Record,
    window: float = 0.25,
    hold: str = "zero",
    smoothing: int | None = None,
    edges: NDArray[np.int64] | None = None,
) -> Windows:
    """Cut a record into windows and find the state at their starts.

    Parameters
    ----------
    record : Record
        The record.
    window : float, optional
        Length of a window [s].
    hold : {"zero", "first"}, optional
        Whether the recorded input is held or runs linearly between samples.
    smoothing : int, optional
        Samples of the Savitzky-Golay window, odd.  Default: the record's own
        `smoothing_window`.
    edges : ndarray of int64, shape (nwindows + 1,), optional
        First sample of each window and the end, in place of equal windows;
        the first must be 0 and the last the record's length.

    Returns
    -------
    Windows

    Raises
    ------
    ValueError
        If the window holds fewer than 5 samples or more than the record.

    Examples
    --------
    >>> import numpy as np
    >>> from dryfric_control.records.record import Record
    >>> t = 1e-3 * np.arange(1000)
    >>> windows = cut(Record(t, np.cos(t), np.sin(3 * t)), window=0.25)
    >>> len(windows), round(float(windows.v0[1]), 3)     # 3 cos(0.75)
    (4, 2.195)
    """
    instance("record", record, Record, "from dfc.read_record(...) or dfc.Record(t, u, x)")
    window = positive("window", window, unit="s")
    if hold not in ("zero", "first"):
        raise ValueError(f'hold must be "zero" or "first", got {hold!r}')
    length = samples(window, record.dt)
    if not 5 <= length <= len(record):
        slow = "" if record.dt < 0.1 else f" (dt = {record.dt:g} s: is its time in ms?)"
        raise ValueError(
            f"window = {window:g} s is {length} samples of this record of {len(record)}{slow}: "
            f"choose between {5 * record.dt:g} and {len(record) * record.dt:g} s"
        )
    if edges is None:
        edges = np.arange(0, len(record), length, dtype=np.int64)
        if len(record) - edges[-1] < max(5, length // 2) and edges.size > 1:
            edges = edges[:-1]
        edges = np.append(edges, len(record))
    starts = edges[:-1]
    size = record.smoothing_window if smoothing is None else smoothing
    smooth = record.derivatives(size)
    shorter = max(5, (size // 2) | 1)
    noise = record.resolution.deviation
    errors = []
    for order, values in ((0, smooth.x), (1, smooth.v)):
        spread = noise * float(np.linalg.norm(savgol_coeffs(size, 3, order, record.dt)))
        # Where a shorter smoothing says something else, motion was smeared.
        other = savgol_filter(record.x, shorter, 3, order, record.dt)
        errors.append(np.hypot(spread, (values - other)[starts]))
    # A held input makes the acceleration jump at each sample, which a polynomial through
    # the readings takes for a slope: the speed at the sample is off by up to that.
    jump = savgol_filter(record.x, size, 3, 3, record.dt) * record.dt**2 / 6.0
    errors[1] = np.hypot(errors[1], jump[starts])
    rest = rest_times(record)[starts]
    # An axis that has not moved for so long has no speed but what escapes the
    # readings; the slope of their noise would set it sliding.
    still = ~above(LONGEST, rest)
    return Windows(
        record,
        np.asarray(edges, dtype=np.int64),
        smooth.x[starts],
        np.where(still, 0.0, smooth.v[starts]),
        errors[0],
        np.where(still, np.minimum(errors[1], least_motion(record) / (2.0 * LONGEST)), errors[1]),
        rest,
        hold,
        noise,
    )
