"""A crawl: pieces of motion averaged over the way travelled, and levels over position."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import ArrayLike
from scipy.linalg import cholesky_banded, solve_banded
from scipy.signal import savgol_coeffs, savgol_filter

from dryfric_control.arrays import Bools, Floats, Ints
from dryfric_control.records.motion import directions
from dryfric_control.records.record import Record
from dryfric_control.ties import NEAR, exceeds, samples

# Longest piece of motion that is averaged, as a part of the travel.
_PIECE = 1.0 / 80.0
# Part of the typical speed to which the speed is to be known.
_KNOWN = 0.02
#: Slower than this part of the typical speed, friction may be off its Coulomb level.
SLOW = 0.6
#: Highest degree; polynomials beyond do not behave between the data.
HIGHEST = 8
# Blocks that a direction's way is cut into.
_BLOCKS = 20
# Motion for less than this part of the time is stick-slip.
_SMOOTH = 0.5
# Huber's limit, in standard deviations.
_LIMIT = 1.5
# Rounds of finding level and noise in turn.
_ROUNDS = 4
# The part of the noise's variance that is at least left to friction itself.
_LEAST = 1e-4


class Pieces(NamedTuple):
    """Averages over pieces of motion, weighted by the way travelled; columns of shape (n,)."""

    way: Floats  # travelled in the piece, positive
    x: Floats  # means over the way of position, drive force and velocity
    u: Floats
    v: Floats
    rise: Floats  # rise of v^2/2 over the piece, per way: what inertia multiplies
    direction: Ints
    slide: Ints  # number of the slide, from rest to rest, that the piece is part of
    begin: Floats  # velocity at the ends of the piece
    end: Floats
    t: Floats  # time at its beginning [s]
    noise: Floats  # standard deviation of `rise`

    def select_pieces(self, keep: Bools) -> Pieces:
        """The pieces marked in `keep`."""
        return Pieces(*(column[keep] for column in self))  # type: ignore[arg-type]


def average(record: Record, piece: float = _PIECE) -> Pieces:
    """Pieces of motion, no longer than a part of the range, averaged over the way."""
    moving = directions(record).astype(int)
    x, v, noise = _smooth_motion(record)
    # Not the raw readings: their noise is in the drive force too, through the
    # loop, and would do work.
    middle = 0.5 * (v[1:] + v[:-1])
    step = middle * record.dt
    # An interval counts if it slides at both ends, the same way.
    s = np.where(moving[1:] == moving[:-1], moving[1:], 0)
    slid = np.abs(np.where(s != 0, step, 0.0))
    typical = np.sum(slid * np.abs(middle)) / max(slid.sum(), 1e-300)
    s = np.where(s * middle > SLOW * typical, s, 0)
    longest = piece * record.range
    starts = np.flatnonzero((s != 0) & (np.diff(s, prepend=0) != 0))
    least = 10.0 * max(record.quantum or 0.0, record.noise)
    rows = []
    for number, a in enumerate(starts):
        rest = np.flatnonzero(s[a:] != s[a])
        way = s[a]
        b = a + int(rest[0]) if rest.size else s.size
        total = way * (record.x[b] - record.x[a])
        parts = max(1, samples(total, longest))
        marks = record.x[a] + way * total * np.arange(1, parts) / parts
        inner = a + np.searchsorted(way * record.x[a:b], way * marks - NEAR * record.range)
        for c, d in zip([a, *inner], [*inner, b], strict=True):
            far = way * (record.x[d] - record.x[c])
            if d > c and exceeds(far, least, NEAR * record.range):
                w = step[c:d] / step[c:d].sum()
                place = w @ (0.5 * (x[c:d] + x[c + 1 : d + 1]))
                speed = w @ middle[c:d]
                speed -= noise**2 / speed  # the weights hold the same noise: its square is none
                rise = way * 0.5 * (v[d] ** 2 - v[c] ** 2) / far
                means = far, place, w @ record.net_input[c:d], speed, rise
                unsure = noise * np.hypot(v[c], v[d]) / far
                rows.append((*means, way, number, v[c], v[d], record.t[c], unsure))
    columns = np.array(rows, float).reshape(-1, 11).T
    return Pieces(*columns[:5], *columns[5:7].astype(np.int64), *columns[7:])


def _smooth_motion(record: Record) -> tuple[Floats, Floats, float]:
    """Position and speed, smoothed to know the speed to 2 %, and its noise."""
    # Noise of the speed enters the work squared, and through the loop it is in the drive
    # force: at 5 % it would bias a smooth crawl by more than its error.
    apart = max(1, len(record) // 2000)
    moves = np.sort(np.abs(np.diff(record.x[::apart])))
    # Half of the way is travelled faster than this.
    half = int(np.searchsorted(np.cumsum(moves), 0.5 * moves.sum()))
    typical = max(float(moves[min(half, moves.size - 1)]), 1e-300) / (apart * record.dt)
    for size in (5, 7, 9, 11, 15, 21, 31, 41, 61, 81, 101):
        spread = record.noise * float(np.linalg.norm(savgol_coeffs(size, 3, 1, record.dt)))
        if spread < _KNOWN * typical or size + 2 > len(record) // 5:
            break
    x, v = (savgol_filter(record.x, size, 3, order, record.dt) for order in (0, 1))
    return x, v, spread


@dataclass(frozen=True, eq=False)
class Level:
    """Level of one direction, as fitted."""

    coefficients: Floats  # of Legendre polynomials over the travel, shape (degree + 1,)
    rows: Floats  # whitened regressors, shape (n, degree + 1)
    values: Floats  # whitened works, shape (n,)
    least: float  # what round-off of the works leaves in `values`
    blocks: Ints  # block of each piece
    shared: Floats  # covariance of the coefficients from what was found along the way, too

    @cached_property
    def without_each(self) -> Floats:
        """Coefficients found without each of the blocks, shape (nblocks, degree + 1)."""
        left = (self.blocks != g for g in range(int(self.blocks.max()) + 1))
        rows = [np.linalg.lstsq(self.rows[k], self.values[k], rcond=None)[0] for k in left]
        return np.array(rows)

    @cached_property
    def covariance(self) -> Floats:
        """Covariance of the coefficients."""
        return spread_without(self.without_each) + self.shared


def spread_without(each: Floats) -> Floats:
    """Covariance of what is found without each of some blocks, as rows."""
    moved = each - each.mean(axis=0)
    return np.asarray((len(moved) - 1) / len(moved) * moved.T @ moved)


def inner(x: ArrayLike, travel: tuple[float, float]) -> Floats:
    """Positions on [-1, 1], those outside held at the ends."""
    low, high = travel
    return np.clip((2.0 * np.asarray(x, dtype=float) - low - high) / (high - low), -1.0, 1.0)


def blocks_of(pieces: Pieces) -> Ints:
    """Contiguous block, of at most 20 of nearly equal way, of each piece of one direction."""
    done = (np.cumsum(pieces.way) - 0.5 * pieces.way) / pieces.way.sum()
    # In stick-slip a slip is never cut: what the forces within it share, its neighbours do not.
    lasts = pieces.way / np.abs(pieces.v)
    if lasts.sum() < _SMOOTH * (pieces.t[-1] + lasts[-1] - pieces.t[0]):
        member = np.unique(pieces.slide, return_inverse=True)[1]
        way = np.bincount(member, pieces.way)
        done = ((np.cumsum(way) - 0.5 * way) / way.sum())[member]
    label = np.minimum((done * _BLOCKS + NEAR).astype(np.int64), _BLOCKS - 1)
    return np.unique(label, return_inverse=True)[1].astype(np.int64)


def level_of(
    pieces: Pieces, force: Floats, travel: tuple[float, float], blocks: Ints, degree: int
) -> Level:
    """Level of one direction by generalised least squares with Huber's loss.

    `pieces` in order of time, `force` their mean friction, a magnitude.
    """
    # The error in the work of a piece has two parts: that of friction itself, variance b times
    # the way, and that of the kinetic energy at its ends, variance a v^2, which the piece before
    # and the piece after share with opposite signs.  Both are found from the residuals.  Least
    # squares without the second is several times less accurate on a smooth crawl.  Errors of
    # 1e-10 of the force are round-off: neither part is taken for smaller.
    least = NEAR * np.abs(force).max() * pieces.way
    basis = legendre.legvander(inner(pieces.x, travel), degree) * pieces.way[:, None]
    work = force * pieces.way
    factor = np.vstack([np.sqrt(pieces.way), np.zeros(work.size)])
    for _ in range(_ROUNDS):
        rows = solve_banded((1, 0), factor, basis)
        values = solve_banded((1, 0), factor, work)
        small = float(np.median(least / factor[0]))
        coefficients, root = _huber(rows, values, small)
        factor = _factor(pieces, work - basis @ coefficients, float(np.median(least)))
    none = np.zeros((degree + 1, degree + 1))
    return Level(coefficients, rows * root[:, None], values * root, small, blocks, none)


def _huber(rows: Floats, values: Floats, least: float) -> tuple[Floats, Floats]:
    """Coefficients, and roots of the weights; errors below `least` are round-off."""
    root = np.ones(values.size)
    coefficients = np.zeros(rows.shape[1])
    for _ in range(20):
        new = np.linalg.lstsq(rows * root[:, None], values * root, rcond=None)[0]
        done = np.max(np.abs(new - coefficients)) < 1e-10 * np.max(np.abs(new))
        coefficients = np.asarray(new, dtype=np.float64)
        if done:
            break
        error = np.abs(values - rows @ coefficients)
        scale = max(1.4826 * float(np.median(error)), least)
        limit = _LIMIT * scale if scale > 0.0 else np.inf
        root = np.sqrt(np.minimum(1.0, limit / np.maximum(error, 1e-300)))
    return coefficients, root


def _factor(pieces: Pieces, error: Floats, least: float) -> Floats:
    """Banded Cholesky factor of the covariance of the works; below `least` is round-off."""
    scale = max(1.4826 * float(np.median(np.abs(error))), least)
    error = np.clip(error, -3.0 * scale, 3.0 * scale) if scale > 0.0 else error
    total = max(float(np.sum(error**2)), error.size * least**2)
    if total == 0.0:
        return np.vstack([np.sqrt(pieces.way), np.zeros(error.size)])
    begin = pieces.begin**2
    end = pieces.end**2
    shared = np.where(pieces.slide[1:] == pieces.slide[:-1], end[:-1], 0.0)
    ends = begin + end
    a = -float(np.sum((error[1:] * error[:-1])[shared > 0.0])) / max(float(shared.sum()), 1e-300)
    a = min(max(a, 0.0), (1.0 - _LEAST) * total / float(ends.sum()))
    b = (total - a * float(ends.sum())) / float(pieces.way.sum())
    band = np.vstack([a * ends + b * pieces.way, np.append(-a * shared, 0.0)])
    return np.asarray(cholesky_banded(band, lower=True))


def best_level(
    pieces: Pieces, force: Floats, travel: tuple[float, float], blocks: Ints
) -> tuple[Floats, Level]:
    """Held-out RMS error of the force for each degree, and the level of the degree to take."""
    count = int(blocks.max()) + 1
    highest = max(0, min(HIGHEST, count // 3 - 1))  # three blocks a coefficient
    errors = np.zeros((highest + 1, count))
    levels = [level_of(pieces, force, travel, blocks, d) for d in range(highest + 1)]
    # Judged in the rows of the highest degree: those are whitened as the noise is.
    whole = levels[-1]
    typical = 1.4826 * float(np.median(np.abs(whole.values - whole.rows @ whole.coefficients)))
    limit = _LIMIT * max(typical, whole.least)
    for d, level in enumerate(levels):
        for g, left in enumerate(level.without_each):
            out = blocks == g
            error = whole.values[out] - whole.rows[out, : d + 1] @ left
            size = np.minimum(np.abs(error), limit)
            errors[d, g] = np.sum(size * (2.0 * np.abs(error) - size))
    equal = 2.0 * limit * whole.least * len(force)
    best = int(np.argmin(errors.sum(axis=1)))
    # The smallest that is as good as the best: within one standard error of the difference, over
    # the blocks, or within round-off.
    for d in range(best + 1):
        worse = errors[d] - errors[best]
        if worse.sum() <= np.sqrt(count) * np.std(worse, ddof=1) + equal:
            break
    return np.sqrt(errors.sum(axis=1) / len(force)), levels[d]
