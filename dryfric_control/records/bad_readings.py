"""Readings that say nothing about the motion: neighbours on both sides agree on another value."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.interpolate import PchipInterpolator

from dryfric_control.arrays import Bools, Floats, Ints
from dryfric_control.records.resolution import ROUNDING
from dryfric_control.text import table

#: Reasons for which a reading is masked: away from where its neighbours put it; the one
#: before written down again; none at all, interpolated; left out by the user.
JUMP, REPEATED, FILLED, GIVEN = "jump", "repeated", "filled", "given"
REASONS = (JUMP, REPEATED, FILLED, GIVEN)

# What follows was set so that none of the sound records of tests/truth loses a reading
# and those of the recorder "outliers" lose what was spoiled (tests/records/test_bad_readings.py).
# Least distance from the neighbours, in standard deviations of the noise,
_DEVIATIONS = 20.0
# in quanta of the encoder,
_QUANTA = 3.0
# and in typical misfits of a cubic nearby.
_LOCAL = 12.0
# Samples before and after a reading that are nearby.
_NEAR = 10
# Distance from the median of all that is no reading at all, in that of all other readings.
_BEYOND = 30.0
# Part of the jump by which the two lines and the cubic may differ.
_AGREED = 0.5
# Longest run of a repeated reading [samples].
_LONGEST = 5
# Least step of the motion around it, in standard deviations of the noise.
_STEP = 8.0
# More bad readings than this are no exceptions: such a record is left as it is.
_MOST = 0.05
_PASSES = 3
# Fewest changes of a reading that a slower source holds.
_CHANGES = 20
# Part of them that must be about as far apart.
_ON_CLOCK = 0.8
# Runs of masked readings that print lists.
_LISTED = 20
# A grid point further than this from every stamp, in steps, has no reading of its own.
_OWN = 0.75


class Masked(NamedTuple):
    """Readings that are not used.

    Examples
    --------
    >>> Masked(np.array([30, 51, 52]), ("jump", "filled", "filled"), np.zeros(3))
    masked  from sample  to sample  readings
    jump    30           30         1
    filled  51           52         2
    """

    indices: Ints  # samples, increasing
    reasons: tuple[str, ...]  # "jump", "repeated", "filled" or "given", one each
    readings: Floats  # as recorded [unit of x]

    def in_slice(self, part: slice) -> Masked:
        """Those of a slice with a positive step, counted from its start."""
        step = part.step or 1
        inside = (self.indices >= part.start) & (self.indices < part.stop)
        inside &= (self.indices - part.start) % step == 0
        return Masked(
            (self.indices[inside] - part.start) // step,
            tuple(r for r, k in zip(self.reasons, inside, strict=True) if k),
            self.readings[inside],
        )

    def rows(self) -> list[tuple[str, ...]]:
        """Table of the runs: reason, first and last sample, how many; headings first."""
        known = np.unique(self.reasons, return_inverse=True)[1]
        ends = (np.diff(self.indices) != 1) | (np.diff(known) != 0)
        runs = np.split(np.arange(self.indices.size), np.flatnonzero(ends) + 1)
        rows: list[tuple[str, ...]] = [("masked", "from sample", "to sample", "readings")]
        for run in runs[:_LISTED]:
            first, last = self.indices[run[[0, -1]]]
            rows.append((self.reasons[run[0]], str(first), str(last), str(run.size)))
        if left := runs[_LISTED:]:
            rows.append((f"{len(left)} more runs", "", "", str(sum(run.size for run in left))))
        return rows

    def __repr__(self) -> str:
        return table(self.rows()) if self.reasons else "no readings masked"


class Masks(tuple[Masked, ...]):
    """Masked readings of several records that show themselves; a tuple otherwise.

    Examples
    --------
    >>> Masks([NONE, Masked(np.array([30]), ("jump",), np.zeros(1))])
    record 1:
    no readings masked
    record 2:
    masked  from sample  to sample  readings
    jump    30           30         1
    """

    __slots__ = ()

    def __repr__(self) -> str:
        if len(self) == 1:
            return repr(self[0])
        return "\n".join(f"record {i}:\n{one!r}" for i, one in enumerate(self, 1))


NONE = Masked(np.empty(0, np.int64), (), np.empty(0))


def find(x: Floats, noise: float, quantum: float) -> dict[int, str]:
    """Bad readings of uniformly sampled positions with noise and quantum: sample to reason."""
    found = dict.fromkeys(fault_codes(x), JUMP)
    path = interpolate_bad(x, mask_without(x.size, found)) if found else x
    noise = max(noise, ROUNDING * float(np.ptp(path)))
    for _ in range(_PASSES):
        # Readings that were found to be bad are no neighbours for the next ones.
        good = np.flatnonzero(mask_without(x.size, found))
        new = dict.fromkeys(_jumps(good, x[good], noise, quantum), JUMP)
        new |= dict.fromkeys(_repeats(path, noise, quantum), REPEATED)
        new = {k: why for k, why in new.items() if k not in found}
        if not new:
            break
        found |= new
        if len(found) > _MOST * x.size:
            return {}
        path = interpolate_bad(x, mask_without(x.size, found))
    return dict(sorted(found.items()))


def fault_codes(x: Floats) -> list[int]:
    """Short runs of readings far beyond all others: a code for a fault, or bits that were lost."""
    away = np.abs(x - np.median(x))
    most = np.sort(away)[int((1.0 - _MOST) * x.size) :]
    beyond = (most[1:] > _BEYOND * most[:-1]) & (most[:-1] > 0.0)
    if not beyond.any():
        return []
    far = away > most[int(np.argmax(beyond))]
    edges = np.flatnonzero(np.diff(far, prepend=False, append=False))
    return [k for a, b in edges.reshape(-1, 2).tolist() if b - a <= _LONGEST for k in range(a, b)]


def mask_without(size: int, indices: dict[int, str] | Ints) -> Bools:
    """True but at some samples, shape (size,)."""
    good = np.ones(size, bool)
    good[np.fromiter(indices, np.int64, len(indices))] = False
    return good


def interpolate_bad(x: Floats, good: Bools) -> Floats:
    """Positions with a smooth, monotone path over those that are not good."""
    index = np.arange(x.size)
    path = x.copy()
    inside = np.clip(index[~good], *index[good][[0, -1]])
    path[~good] = PchipInterpolator(index[good], x[good])(inside)
    return path


def _jumps(at: Ints, x: Floats, noise: float, quantum: float) -> list[int]:
    """Samples of single jumps among readings `x` at some samples, of neighbours the larger one."""
    # The two lines and the cubic through two readings on either side miss it by nearly the same.
    a, b, c, d = (at[k : at.size - 4 + k] - at[2:-2] for k in (0, 1, 3, 4))
    left = x[2:-2] - (b * x[:-4] - a * x[1:-3]) / (b - a)
    right = x[2:-2] - (c * x[4:] - d * x[3:-1]) / (c - d)
    cubic = sum(
        x[k : at.size - 4 + k] * math.prod(o / (o - own) for o in others)
        for k, own, others in ((0, a, (b, c, d)), (1, b, (a, c, d)), (3, c, (a, b, d)),
                               (4, d, (a, b, c)))
    )  # fmt: skip
    miss = x[2:-2] - cubic
    least = np.minimum(np.minimum(np.abs(left), np.abs(right)), np.abs(miss))
    spread = np.ptp(np.stack((left, right, miss)), axis=0)
    least[spread > _AGREED * least] = 0.0
    floor = max(_DEVIATIONS * noise, _QUANTA * quantum)
    found: list[int] = []
    misses = np.abs(miss)
    for k in np.flatnonzero(least > floor)[np.argsort(-least[least > floor], kind="stable")]:
        near = misses[max(0, k - _NEAR) : k + _NEAR + 1]
        # The jump itself is in the misses of five samples.
        usual = float(np.median(np.sort(near)[: max(near.size - 5, 1)]))
        if least[k] > _LOCAL * usual and not any(abs(k + 2 - other) <= 2 for other in found):
            found.append(int(k) + 2)
    return [int(k) for k in at[found]]


def _repeats(x: Floats, noise: float, quantum: float) -> list[int]:
    """Samples at which a moving axis has the reading of the sample before."""
    steps = np.diff(x)
    least = max(_STEP * noise, _QUANTA * quantum)
    found: list[int] = []
    same = np.flatnonzero(steps == 0.0)
    starts = same[np.diff(same, prepend=-2) > 1]
    ends = same[np.diff(same, append=x.size + 2) > 1]
    for a, b in zip(starts, ends, strict=True):  # steps[a..b] are zero: x[a+1..b+1] repeat x[a]
        m = b - a + 1
        if m > _LONGEST or a < 3 or b + 5 >= x.size:
            continue
        # Another reading may be repeated nearby: least and greatest step do not count.
        around = np.sort((*steps[a - 3 : a], *steps[b + 2 : b + 5]))[1:-1]
        low = around[0]
        high = around[-1]
        if low < 0.0 < high or min(abs(low), abs(high)) <= least:
            continue
        made_up = steps[b + 1] / np.median(around)  # the next step makes up for all repetitions
        if m + 0.5 < made_up < m + 1.5:
            found.extend(range(int(a) + 1, int(b) + 2))
    return found


def held_for(x: Floats, quantum: float) -> tuple[int, int]:
    """Samples for which a slower source holds each reading, 1 if none, and the first new one."""
    steps = np.diff(x)
    changes = np.flatnonzero(steps) + 1
    gaps = np.diff(changes)
    count = int(np.median(gaps)) if gaps.size >= _CHANGES else 1
    usual = np.abs(gaps - count) <= max(1, count // 4)
    regular = count > 1 and np.mean(usual) >= _ON_CLOCK
    if not regular or np.median(np.abs(steps[changes - 1])) <= _STEP * quantum:
        return 1, 0
    return count, int(np.bincount(changes % count).argmax())


def uniform_stamps(t: Floats, x: Floats, noise: float) -> Floats | None:
    """Stamps on a uniform clock, if the readings were taken on one; None if not."""
    # A logger may stamp late what was sampled on time: about lines between their neighbours
    # the readings then scatter less on the clock than on the stamps.
    steps = np.diff(t)
    median = float(np.median(steps))
    counts = np.maximum(np.rint(steps / median), 1.0)
    n = np.concatenate(([0.0], np.cumsum(counts)))
    dt, start = np.polyfit(n, t, 1)
    off = t - (start + dt * n)
    size = float(np.std(off))
    if not np.abs(off).max() < dt or size <= 1e-6 * dt:
        return None
    inner = np.flatnonzero((counts[:-1] == 1.0) & (counts[1:] == 1.0))
    if inner.size < _NEAR:
        return None
    a = x[inner]
    b = x[inner + 1]
    c = x[inner + 2]
    share = steps[inner] / (steps[inner] + steps[inner + 1])
    clock = np.abs(b - 0.5 * (a + c))
    stamps = np.abs(b - (a + share * (c - a)))
    # Where the motion is fast enough that a stamp matters.
    fast = np.abs(c - a) * size / dt > 4.0 * noise
    if np.count_nonzero(fast) < _NEAR or np.median(clock[fast]) > 0.7 * np.median(stamps[fast]):
        return None
    return np.asarray(t[0] + round_within(dt, 4.0 * size * np.sqrt(12.0) / n[-1] ** 1.5) * n)


def round_within(number: float, tolerance: float) -> float:
    """The number with the fewest digits within a tolerance of one."""
    rounded = (float(f"{number:.{digits}g}") for digits in range(1, 10))
    return next((one for one in rounded if abs(one - number) <= tolerance), number)


def mask_filled(t: Floats, grid: Floats, x: Floats, step: float) -> Masked:
    """Readings on a grid that have no stamp near."""
    after = np.clip(np.searchsorted(t, grid), 1, t.size - 1)
    away = np.minimum(np.abs(grid - t[after - 1]), np.abs(t[after] - grid))
    lost = np.flatnonzero(away > _OWN * max(step, float(np.median(np.diff(t)))))
    return Masked(lost, (FILLED,) * lost.size, x[lost])
