"""Free runs over short windows, each restarted from the smoothed record."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.signal import savgol_coeffs, savgol_filter

from dryfric_control.arrays import Bools, Floats, Ints
from dryfric_control.checks import instance, positive
from dryfric_control.compiled.axis_step import STRUCTURE
from dryfric_control.compiled.windowed_runs import Evaluation, Search, Windowed, free_runs, project
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.records.motion import LONGEST, least_motion, rest_times
from dryfric_control.records.record import Record
from dryfric_control.ties import NEAR, exceeds, samples

# Multiple of the noise from which a score grows with the logarithm of the errors alone.
_ROBUST_SCALE = 2.0
# A window moves if the range of its readings exceeds this many standard deviations of their
# noise (`benchmarks/diagnosis.py`, condition short).
_MIN_MOTION = 4.0
# Rounds of new slopes in the search for a start state.
_ROUNDS = 2
# Offsets of the start velocity [standard deviations] from which a window far above the scale is
# searched again (`benchmarks/diagnosis.py dwell_time stribeck`).
_VELOCITY_OFFSETS = np.array([-0.3, 0.3, -1.0, 1.0, -2.0, 2.0])


def delay_input(u: Floats, samples: float) -> Floats:
    """Held input delayed by some samples, as means over each sample, which keep the impulse."""
    index = np.arange(u.size)
    if samples:
        u = np.interp(index - samples, index, u)
        u.setflags(write=False)  # as a record's: free runs are compiled for each type of array
    return u


@dataclass(frozen=True, eq=False)
class Windows:
    """A record cut into windows, with the state at each start, shape (nwindows,); made by `cut`."""

    record: Record
    edges: Ints  # first sample of each window, and the end
    x0: Floats  # smoothed state at each start
    v0: Floats
    x0_error: Floats  # its standard deviation: noise after smoothing, and its possible bias
    v0_error: Floats
    rest: Floats  # time at rest before each start [s]
    hold: str  # "zero" or "first"
    floor: float  # standard deviation of the readings' noise, quantisation included

    def __len__(self) -> int:
        return self.edges.size - 1

    @cached_property
    def samples(self) -> Ints:
        """Number of samples in each window, shape (nwindows,)."""
        return np.diff(self.edges)

    @property
    def start_times(self) -> Floats:
        """Time at which each window starts [s], shape (nwindows,)."""
        return np.asarray(self.record.t[self.edges[:-1]])

    @cached_property
    def moving(self) -> Bools:
        """Windows whose readings move by more than noise, shape (nwindows,)."""
        x = self.record.x
        starts = self.edges[:-1]
        reach = np.maximum.reduceat(x, starts) - np.minimum.reduceat(x, starts)
        return exceeds(reach, _MIN_MOTION * self.floor, NEAR * self.record.range)

    def arrays(self, shift: float = 0.0) -> Windowed:
        """The windows as arrays for compiled functions, the input delayed by `shift` [s]."""
        record = self.record
        return Windowed(
            delay_input(record.u, shift / record.dt),
            record.x,
            float(record.t[0]),
            record.dt,
            self.hold == "first",
            self.edges,
            self.x0,
            self.v0,
            self.x0_error,
            self.v0_error,
            self.rest,
            record.known_force,
        )

    def run(
        self,
        axis: FrictionAxis,
        shift: float = 0.0,
        dx: Floats | float = 0.0,
        dv: Floats | float = 0.0,
        active: Bools | None = None,
    ) -> Floats:
        """Positions of the free runs of an axis at every sample, shape (n,); see `positions`.

        The input acts `shift` [s] later than recorded; dx, dv are added to the start states.
        """
        windowed = self.arrays(shift)._replace(x0=self.x0 + dx, v0=self.v0 + dv)
        return positions(axis, windowed, active)

    def evaluate(self, axis: FrictionAxis, active: Bools, thorough: bool = False) -> Evaluation:
        """Errors of an axis over active windows, each from its most likely start state.

        `thorough`: windows that end far above the noise are searched again from other velocities.
        """
        count = len(self)
        errors = np.zeros(int(self.edges[-1]))
        at = Evaluation(errors, np.zeros((3, count)), np.zeros(count))
        at.starts[2] = np.nan
        offsets = _VELOCITY_OFFSETS if thorough else _VELOCITY_OFFSETS[:0]
        search = Search(
            active, passes_inner_states(axis), uniform(axis), self.floor, _ROUNDS, offsets
        )
        project(axis.arrays(self.record.dt), self.arrays(), search, at)
        return at

    def cross_validate(self, axes: Sequence[FrictionAxis], half: Ints, active: Bools) -> Evaluation:
        """Errors of two axes, each over the active windows of its half of the samples."""
        half = half[self.edges[:-1]]
        one, two = (self.evaluate(a, active & (half == k)) for k, a in enumerate(axes))
        return Evaluation(
            np.where(np.repeat(half, self.samples) == 1, two.errors, one.errors),
            np.where(half == 1, two.starts, one.starts),
            np.where(half == 1, two.costs, one.costs),
        )

    def scores(self, costs: Floats) -> Floats:
        """log(1 + cost/(n c^2)) of every window: 0.22 at the noise floor."""
        return np.asarray(np.log1p(costs / (self.samples * _ROBUST_SCALE**2)))

    def mean_squares(self, errors: Floats) -> Floats:
        """Mean square of the errors in each window, shape (nwindows,)."""
        return np.asarray(np.add.reduceat(errors**2, self.edges[:-1]) / self.samples)


def positions(axis: FrictionAxis, windowed: Windowed, active: Bools | None = None) -> Floats:
    """Positions of free runs over the active windows, shape (n,); all with inner states."""
    arrays = axis.arrays(windowed.dt)
    count = windowed.edges.size - 1
    if active is None or arrays.integers[STRUCTURE]:
        active = np.ones(count, bool)
    out = np.zeros(int(windowed.edges[-1]))
    free_runs(arrays, windowed, active, out)
    return out


def uniform(axis: FrictionAxis) -> bool:
    """Whether an axis is the same at every position."""
    return axis.coulomb.constant and not any(e.depends_on_place for e in axis.effects)


def passes_inner_states(axis: FrictionAxis) -> bool:
    """Whether windows pass on inner states; those of the drive follow from its command."""
    return any(e.remembers and e.action not in ("delay", "lag") for e in axis.effects)


def cut(record: Record, window: float = 0.25, hold: str = "zero") -> Windows:
    """Cut a record into windows of a length [s], with the state at their starts."""
    instance("record", record, Record, "from dfc.read_record(...) or dfc.Record(t, u, x)")
    window = positive("window", window, unit="s")
    if hold not in ("zero", "first"):
        raise ValueError(f'hold must be "zero" or "first", got {hold!r}')
    length = samples(window, record.dt)
    if not 5 <= length <= len(record):
        slow = "" if record.dt < 0.1 else f" (dt = {record.dt:g} s: is its time in ms?)"
        this = f"this record of {len(record)} samples, {record.duration:.3g} s{slow}"
        asked = f"window = {window:g} s, {length} samples"
        mend = f"choose between {5 * record.dt:g} and {record.duration:g} s"
        if length > len(record):
            raise ValueError(f"{this}, is too short for {asked}: record for longer, or {mend}")
        raise ValueError(f"{asked}, is too short for {this}: {mend}")
    edges = np.arange(0, len(record), length, dtype=np.int64)
    if len(record) - edges[-1] < max(5, length // 2) and edges.size > 1:
        edges = edges[:-1]
    edges = np.append(edges, len(record)).astype(np.int64)
    starts = edges[:-1]
    size = record.smoothing_window
    smooth = record.derivatives(size)
    shorter = max(5, (size // 2) | 1)
    noise = record.resolution.deviation
    errors = []
    for order, values in ((0, smooth.x), (1, smooth.v)):
        spread = noise * float(np.linalg.norm(savgol_coeffs(size, 3, order, record.dt)))
        # The difference to a shorter smoothing estimates the bias of the smoothing.
        other = savgol_filter(record.x, shorter, 3, order, record.dt)
        errors.append(np.hypot(spread, (values - other)[starts]))
    # Under a held input the acceleration jumps at each sample, which a polynomial through the
    # readings approximates by a slope: bound of the resulting velocity error.
    jump = savgol_filter(record.x, size, 3, 3, record.dt) * record.dt**2 / 6.0
    errors[1] = np.hypot(errors[1], jump[starts])
    rest = rest_times(record)[starts]
    # After a long rest the velocity is zero up to the resolution of the readings; the slope of
    # their noise would make the axis slide.
    still = ~exceeds(LONGEST, rest)
    v0 = np.where(still, 0.0, smooth.v[starts])
    slow = np.minimum(errors[1], least_motion(record) / (2.0 * LONGEST))
    errors[1] = np.where(still, slow, errors[1])
    return Windows(record, edges, smooth.x[starts], v0, errors[0], errors[1], rest, hold, noise)
