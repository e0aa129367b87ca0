"""Free runs over short windows, each restarted from the smoothed record."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_coeffs, savgol_filter

from dryfric_control.checks import instance, positive
from dryfric_control.compiled.axis_step import N_INNER, STRUCTURE
from dryfric_control.compiled.free_runs import free_runs
from dryfric_control.estimation.motion import LONGEST, least_motion, rest_times
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.records.record import Record
from dryfric_control.ties import above, samples

FloatArray = NDArray[np.float64]


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
    """

    record: Record
    edges: NDArray[np.int64]
    x0: FloatArray
    v0: FloatArray
    x0_error: FloatArray
    v0_error: FloatArray
    rest: FloatArray
    hold: str

    def __len__(self) -> int:
        return self.edges.size - 1

    @property
    def samples(self) -> NDArray[np.int64]:
        """Number of samples in each window, shape (nwindows,)."""
        return np.diff(self.edges)

    @property
    def start_times(self) -> FloatArray:
        """Time at which each window starts [s], shape (nwindows,)."""
        return np.asarray(self.record.t[self.edges[:-1]])

    def run(
        self,
        axis: FrictionAxis,
        shift: float = 0.0,
        dx: FloatArray | float = 0.0,
        dv: FloatArray | float = 0.0,
        active: NDArray[np.bool_] | None = None,
        inner: FloatArray | None = None,
        carry: bool = False,
    ) -> FloatArray:
        """Positions of the free runs.

        Parameters
        ----------
        axis : FrictionAxis
            The axis to run.
        shift : float, optional
            Time by which the input acts later than recorded, negative if
            sooner [s].  Unlike a delay it belongs to the record.
        dx, dv : float or ndarray, shape (nwindows,)
            Added to the state at the starts.
        active : ndarray of bool, shape (nwindows,), optional
            Windows to run; the others get no value.  Default: all.
        inner : ndarray, shape (nwindows, axis_step.N_INNER), optional
            Inner states (deflection, offset and slip of the load, mode) at
            the starts, which no record tells.  Default: those with which the
            run of the window before has ended; all windows are run then.
        carry : bool, optional
            Fill `inner` in place with those states instead of using it.

        Returns
        -------
        ndarray, shape (n,)
            One position for each sample of the record.

        Examples
        --------
        Runs near a base run keep its inner states, window by window:

        >>> import numpy as np
        >>> import dryfric_control as dfc
        >>> from dryfric_control.compiled.axis_step import N_INNER
        >>> t = 1e-3 * np.arange(1000)
        >>> windows = cut(dfc.Record(t, np.cos(t), np.sin(3 * t)), window=0.25)
        >>> axis = dfc.FrictionAxis(mass=1.0, viscous=0.0, coulomb=0.5)
        >>> inner = np.zeros((len(windows), N_INNER))
        >>> base = windows.run(axis, inner=inner, carry=True)
        >>> near = windows.run(axis, dv=1e-3, inner=inner)
        >>> round(float(near[249] - base[249]), 6)
        0.000249
        """
        if inner is None:
            inner, carry = np.zeros((len(self), N_INNER)), True
        arrays = axis.arrays(self.record.dt)
        if carry and arrays.integers[STRUCTURE]:
            active = None
        out = np.zeros(int(self.edges[-1]))
        free_runs(
            arrays.numbers,
            arrays.integers,
            arrays.memory,
            shifted(self.record.u, shift / self.record.dt),
            float(self.record.t[0]),
            self.record.dt,
            self.hold == "first",
            self.edges,
            self.x0 + dx,
            self.v0 + dv,
            self.rest,
            np.ones(len(self), bool) if active is None else active,
            inner,
            carry,
            out,
        )
        return out

    def spread(self, values: NDArray) -> NDArray:
        """One value a window, repeated over its samples, shape (n,)."""
        return np.repeat(values, self.samples)

    def mean_squares(self, errors: FloatArray) -> FloatArray:
        """Mean square of the errors in each window, shape (nwindows,)."""
        return np.asarray(np.add.reduceat(errors**2, self.edges[:-1]) / self.samples)


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
    noise = max(record.noise, 1e-9 * record.range)
    errors = []
    for order, values in ((0, smooth.x), (1, smooth.v)):
        spread = noise * float(np.linalg.norm(savgol_coeffs(size, 3, order, record.dt)))
        # Where a shorter smoothing says something else, motion was smeared.
        other = savgol_filter(record.x, shorter, 3, order, record.dt)
        errors.append(np.hypot(spread, (values - other)[starts]))
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
    )
