"""Motion and drive of a record through one smoothing kernel, and the samples that slide.

The force that a motion needs is compared with the drive after both went through the same kernel,
so that its bias is on both sides.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.ndimage import binary_dilation, gaussian_filter1d

from dryfric_control.arrays import Bools, Floats, Ints
from dryfric_control.compiled.cached import njit
from dryfric_control.estimation.force_residual import at_the_mass, at_the_samples
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.model.friction import CoulombMap
from dryfric_control.model.friction_curve import net_force
from dryfric_control.records.motion import breakaways, directions
from dryfric_control.records.record import Record

# Largest noise of the force that the mass needs, over the standard deviation of the drive.
_FORCE_NOISE = 0.03
# Widest kernel [samples].
_WIDEST = 40.0
# Ratio from one width to the next that is tried.
_WIDER = 1.15
# Length of the kernel to each side, in its standard deviations.
_TRUNCATED = 4.0
# Least velocity that counts as sliding, over the standard deviation of the velocity.
_SLOW = 0.02
# Samples left out around slow ones, in widths of the kernel.
_GUARD = 2.0
# Width of a kernel that leaves readings as they are [samples].
_NO_KERNEL = 0.1


@njit(cache=True, nogil=True, fastmath=True)
def _smoothed_at(columns, places, weights, out):  # type: ignore[no-untyped-def]
    """Smoothed columns, shape (n, c), at some samples; ends count as often as the kernel needs."""
    n, count = columns.shape
    half = weights.size // 2
    for i in range(places.size):
        for j in range(count):
            out[i, j] = 0.0
        for k in range(-half, half + 1):
            at = min(max(places[i] + k, 0), n - 1)
            w = weights[k + half]
            for j in range(count):
                out[i, j] += w * columns[at, j]


@njit(cache=True, nogil=True)
def _spread_from(values, places, weights, out):  # type: ignore[no-untyped-def]
    """Adjoint of `_smoothed_at`: each value spread over the samples that it is the mean of."""
    half = weights.size // 2
    for i in range(places.size):
        for k in range(-half, half + 1):
            at = min(max(places[i] + k, 0), out.size - 1)
            out[at] += weights[k + half] * values[i]


@dataclass(frozen=True, eq=False)
class SmoothedMotion:
    """Motion and drive of one record for a regression of forces.

    Columns are functions of states that are sharpened, x + (x - S x), as they are smoothed by S
    afterwards, like the drive: the bias of S is then of fourth order in its width.

    Attributes
    ----------
    record : Record
    width : float
        Standard deviation of the Gaussian kernel S [samples].
    x, v, a : ndarray, shape (n,)
        Sharpened position, velocity and acceleration.
    direction : ndarray, shape (n,)
        Direction of motion, 0 where it is too slow to be seen.
    places : ndarray, shape (m,)
        Sliding samples, one a width of the kernel.
    """

    record: Record
    width: float
    x: Floats
    v: Floats
    a: Floats
    direction: Floats
    places: Ints

    @classmethod
    def from_record(cls, record: Record, mass: float) -> SmoothedMotion:
        """Motion of a record with the narrowest kernel that makes the force clear.

        Its noise, `mass` times that of the acceleration, is then 3 % of the drive.
        """
        dt = record.dt
        width = kernel_width(record, mass)
        reading = record.channels["v"] if record.integrated else record.x
        good = record.good
        if not good.all():
            reading = np.interp(record.t, record.t[good], reading[good])
        smooth = gaussian_filter1d(reading, width, mode="nearest", truncate=_TRUNCATED)
        again = gaussian_filter1d(smooth, width, mode="nearest", truncate=_TRUNCATED)
        if record.integrated:
            x = record.x
            v = 2.0 * smooth - again
            a = np.gradient(v, dt)
            seen = smooth
        else:
            x = 2.0 * smooth - again
            ends = np.pad(x, 1, mode="edge")
            v = (ends[2:] - ends[:-2]) / (2.0 * dt)
            a = (ends[2:] - 2.0 * x + ends[:-2]) / dt**2
            seen = np.gradient(smooth, dt)
        noise = reading_noise(record) * (1.0 if record.integrated else 1.0 / dt)
        slow = max(2.0 * noise * width**-1.5, _SLOW * float(np.std(seen)))
        direction = np.where(np.abs(seen) < 0.5 * slow, 0.0, np.sign(seen))
        places = _sliding(np.abs(seen) >= slow, good, width)
        return cls(record, width, x, v, a, direction, places)

    @classmethod
    def where_force_shows(cls, record: Record, mass: float) -> SmoothedMotion:
        """Motion of a record with its sliding samples, or the breakaways if it moves in jumps.

        Jumps that end within the kernel show no force while they last, but one where they begin:
        the drive that just moves the axis, with no velocity and no acceleration yet.
        """
        motion = cls.from_record(record, mass)
        starts, ways = breakaways(record)
        if record.integrated or not starts.size or not _in_jumps(record, _guard(motion.width)):
            return motion
        x, v, a, direction = (
            one.copy() for one in (motion.x, motion.v, motion.a, motion.direction)
        )
        x[starts], v[starts], a[starts], direction[starts] = record.x[starts], 0.0, 0.0, ways
        return cls(record, _NO_KERNEL, x, v, a, direction, starts)

    @property
    def in_jumps(self) -> bool:
        """Whether the samples are breakaways."""
        return self.width == _NO_KERNEL

    @cached_property
    def weights(self) -> Floats:
        """Weights of the kernel."""
        half = int(_TRUNCATED * self.width + 0.5)
        weights = np.exp(-0.5 * (np.arange(-half, half + 1) / self.width) ** 2)
        return np.asarray(weights / weights.sum())

    def smooth_columns(self, columns: Floats) -> Floats:
        """Columns of all samples, shape (n, c), smoothed at the sliding ones, shape (m, c)."""
        out = np.empty((self.places.size, columns.shape[1]))
        _smoothed_at(np.ascontiguousarray(columns), self.places, self.weights, out)
        return out

    def spread(self, values: Floats) -> Floats:
        """Adjoint of `smooth_columns` for one column, shape (m,) to (n,)."""
        out = np.zeros(self.x.size)
        _spread_from(np.ascontiguousarray(values), self.places, self.weights, out)
        return out


def _guard(width: float) -> int:
    """Number of samples next to slow ones in which a kernel still sees these."""
    return int(_GUARD * width) + 1


def _in_jumps(record: Record, guard: int) -> bool:
    """Whether most of the way is made in motions too short to have samples `guard` inside."""
    moving = np.pad(directions(record) != 0, 1)
    starts, ends = np.flatnonzero(np.diff(moving)).reshape(-1, 2).T
    way = np.abs(record.x[np.minimum(ends, len(record) - 1)] - record.x[np.maximum(starts - 1, 0)])
    short = ends - starts <= 2 * guard
    return bool(way[short].sum() > way[~short].sum())


def _sliding(fast: Bools, good: Bools, width: float) -> Ints:
    """Samples that slide, away from reversals, ends and missing readings, one a width."""
    guard = _guard(width)
    ok = ~binary_dilation(~fast | ~good, iterations=guard)
    ok[: 3 * guard] = ok[max(ok.size - 3 * guard, 0) :] = False
    step = max(int(width), 1)
    return np.asarray(np.flatnonzero(ok)[::step], np.int64)


def reading_noise(record: Record) -> float:
    """Standard deviation of a reading's noise, rounding included."""
    if record.integrated:
        third = np.diff(record.channels["v"], 3)
        return 1.4826 * float(np.median(np.abs(third - np.median(third)))) / math.sqrt(20.0)
    return max(record.noise, record.resolution.step / math.sqrt(12.0))


def kernel_width(record: Record, mass: float) -> float:
    """Standard deviation of the narrowest kernel that makes the force clear [samples]."""
    order = 1 if record.integrated else 2
    allowed = _FORCE_NOISE * float(np.std(record.u))
    noise = 0.5 * mass * reading_noise(record) / record.dt**order
    width = 1.0
    widest = min(_WIDEST, max(len(record) / 100.0, 1.0))
    while noise * width ** -(order + 0.5) > allowed and width < widest:
        width *= _WIDER
    return width


def drive_at_the_mass(axis: FrictionAxis, record: Record, hold: str = "zero") -> Floats:
    """Drive after the delay and lag of an axis, shape (n,).

    Held, it is the mean of the input before and after each sample, as a is a central difference.
    """
    late = tuple(e for e in axis.effects if e.action in ("delay", "lag"))
    line = FrictionAxis(axis.mass, 0.0, CoulombMap.of(0.0), effects=late)
    return at_the_samples(at_the_mass(line, record, hold)[1].u, hold)


def known_force(record: Record, hold: str = "zero") -> Floats:
    """Known force on the mass in the same way, shape (n,); zeros where there is none."""
    force = record.known_force
    return at_the_samples(force, hold) if force.size else np.zeros(len(record))


def missing_force(axis: FrictionAxis, motion: SmoothedMotion, u: Floats, known: Floats) -> Floats:
    """Force that a motion needs beyond what the axis has under a drive and a known force, (n,)."""
    way = motion.direction.astype(np.int64)
    given = net_force(axis, motion.record.t, motion.x, motion.v, u, way, known)
    return np.asarray(axis.mass * motion.a - given)


def distance_since_reversal(x: Floats, direction: Floats, rests: bool = False) -> Floats:
    """Distance from the last change of direction; `rests`: or from the last rest, shape (n,)."""
    way = direction
    samples = np.arange(direction.size)
    if not rests:
        # At rest the direction is that of the motion before.
        way = way[np.maximum.accumulate(np.where(way != 0.0, samples, 0))]
    changes = np.concatenate(([True], way[1:] != way[:-1]))
    start = np.maximum.accumulate(np.where(changes, samples, 0))
    return np.abs(x - x[start])
