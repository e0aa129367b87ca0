"""Clocks: the unit of bare stamps, what stamps resolve, and the even clock behind them."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from dryfric_control.arrays import Floats
from dryfric_control.records.bad_readings import round_within


class Epoch(NamedTuple):
    """A way to count time from a date, by the numbers that the years 2001 to 2049 have in it."""

    unit: str
    words: str
    least: float
    most: float


_EPOCHS = (
    Epoch("ns", "ns since 1970", 0.97e18, 2.53e18),
    Epoch("us", "us since 1970", 0.97e15, 2.53e15),
    Epoch("ms", "ms since 1970", 0.97e12, 2.53e12),
    Epoch("100 ns", "100 ns since 1601", 1.26e17, 1.42e17),
)

#: Part of a step by which an even clock may be off without a word.
JITTER_LIMIT = 0.01
# Numbers of which it is said that they only rise.
_LEAST_RISING = 3
# Shortest run of stamps of which a clock is fitted.
_LEAST_STAMPS = 20
# Largest distance of a rounded stamp from the clock, in steps of its rounding: half a step, and
# what a least-squares line adds to it.
_ROUNDED = 0.55
# The same in single precision, where the rounding grows with the time.
_ROUNDED_SINGLE = 0.65
# Part of decimal stamps that may repeat; of more it is not clear that they belong to one clock.
_REPEATED = 0.05
# Part of the steps between decimal stamps that are not the usual one: fewer are samples lost.
_UNUSUAL = 0.05


class Rounding(NamedTuple):
    """What stamps were rounded to."""

    step: float  # [s]
    limit: float  # largest distance of a rounded stamp from the clock [s]
    kind: str


class EvenClock(NamedTuple):
    """Stamps on the even clock that explains them."""

    t: Floats
    note: str


def epoch_of(stamps: Any) -> Epoch | None:
    """The epoch that bare stamps are counted from, None where their size does not show it."""
    array = np.asarray(stamps)
    if array.dtype.kind not in "iuf" or array.size == 0:
        return None
    there = array[np.isfinite(array)]
    first, last = (float(there.min()), float(there.max())) if there.size else (0.0, 0.0)
    known = (epoch for epoch in _EPOCHS if epoch.least <= first and last <= epoch.most)
    return next(known, None)


def stamp_text(stamp: float, step: float) -> str:
    """A moment in seconds, with the digits that tell it from the samples beside it."""
    told = math.isfinite(stamp) and step > 0.0
    digits = math.ceil(math.log10(max(abs(stamp), step) / step)) + 2 if told else 0
    return f"{stamp:.{min(max(6, digits), 17)}g}"


def rises(values: Any) -> bool:
    """Whether numbers only rise, and not by 1 each, as those of the rows do."""
    array = np.asarray(values)
    if array.dtype.kind not in "iuf" or array.ndim != 1 or array.size < _LEAST_RISING:
        return False
    steps = np.diff(array.astype(np.float64))
    return bool((steps > 0.0).all() and (steps != 1.0).any())


def even_clock(t: Floats) -> EvenClock | None:
    """The even clock of stamps that were rounded; None for those that need no mend or have none.

    Offset and rate are fitted first: a step between two coarse stamps is no measure of a loss.
    """
    if t.ndim != 1 or t.size < _LEAST_STAMPS or not np.isfinite(t).all():
        return None
    steps = np.diff(t)
    if not _is_jittery(steps, float((t[-1] - t[0]) / (t.size - 1))):
        return None
    rounding = _rounding(t, steps)
    if rounding is None:
        return None
    numbers = np.arange(t.size, dtype=np.float64)
    rate, off = _line(numbers, t)
    if off > rounding.limit and rate > 2.0 * rounding.step and float(np.median(steps)) > 0.0:
        # Steps longer than twice the rounding count the samples that are not there.
        numbers = _sample_numbers(t, steps)
        rate, off = _line(numbers, t)
    if off > rounding.limit:
        return None
    dt = round_within(rate, 4.0 * rounding.step / numbers[-1])
    lost = round(float(numbers[-1])) + 1 - t.size
    note = (
        f"t is {rounding.kind}, to {rounding.step:.2g} s: put on the clock of {dt:.6g} s that fits "
        f"all stamps within {off:.2g} s, {lost or 'no'} sample{'s' * (lost != 1)} lost"
    )
    return EvenClock(t[0] + dt * numbers, note)


def _rounding(t: Floats, steps: Floats) -> Rounding | None:
    """The rounding of stamps in single precision or decimals, None where they show neither."""
    single = single_spacing(t)
    if single:
        return Rounding(single, _ROUNDED_SINGLE * single, "in single precision")
    decimal = _decimal_spacing(t)
    if decimal and _rounded_often(steps, decimal):
        return Rounding(decimal, _ROUNDED * decimal, "rounded")
    return None


def _is_jittery(steps: Floats, mean: float) -> bool:
    """Whether steps that go forward differ from their mean by more than the limit."""
    if steps.min() < 0.0 or mean <= 0.0:
        return False
    return not np.abs(steps - mean).max() <= JITTER_LIMIT * mean


def _rounded_often(steps: Floats, rounding: float) -> bool:
    """Whether steps between decimal stamps vary as rounding has it, not as a few losses do."""
    unusual = np.abs(steps - np.median(steps)) > 0.5 * rounding
    return bool(np.mean(steps == 0.0) <= _REPEATED and np.mean(unusual) > _UNUSUAL)


def single_spacing(t: Floats) -> float:
    """What stamps in single precision resolve at the latest of them; 0 for others."""
    with np.errstate(over="ignore"):  # beyond single precision
        single = t.astype(np.float32)
    if not np.array_equal(single, t):
        return 0.0
    return float(np.spacing(np.abs(single).max()))


def _decimal_spacing(t: Floats) -> float:
    """Power of ten to which stamps were rounded; 0 if to none down to 1 ns."""
    for digits in range(10):
        spacing = 10.0**-digits
        whole = t / spacing
        if np.abs(whole - np.rint(whole)).max() <= 8.0 * np.spacing(np.abs(whole).max()):
            return spacing
    return 0.0


def _line(numbers: Floats, t: Floats) -> tuple[float, float]:
    """Rate of the line through stamps over sample numbers, and the largest distance from it."""
    since = t - t[0]
    centre = numbers - numbers.mean()
    rate = float(centre @ since / (centre @ centre))
    off = since - rate * numbers
    return rate, float(0.5 * np.ptp(off))


def _sample_numbers(t: Floats, steps: Floats) -> Floats:
    """Sample numbers of stamps of which some are missing: steps in units of the usual one."""
    usual = float(np.median(steps))
    for _ in range(3):
        numbers = np.append(0.0, np.cumsum(np.maximum(np.rint(steps / usual), 1.0)))
        usual = _line(numbers, t)[0]
    return numbers
