"""Checks and estimates on the arrays of a record: plain arrays in, arrays or an error out."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np
from scipy import ndimage
from scipy.integrate import cumulative_trapezoid
from scipy.interpolate import CubicSpline, PchipInterpolator

from dryfric_control.arrays import Bools, Floats, Ints
from dryfric_control.checks import finite, one_of, positive
from dryfric_control.records.bad_readings import round_within
from dryfric_control.records.clock import JITTER_LIMIT, single_spacing, stamp_text
from dryfric_control.records.readers.channels import EXTRAS, MAX_ROWS, units_by_role
from dryfric_control.records.record_warning import warn
from dryfric_control.records.refusal import RefusalError
from dryfric_control.records.resolution import QUANTA
from dryfric_control.ties import NEAR
from dryfric_control.units import si_unit

MIN_SAMPLES = 10
_MAX_MAGNITUDE = 1e100  # squares stay finite


#: Notes of a record without a drive, and of one without a position.
NO_DRIVE = "no drive: u = 0"
INTEGRAL = "x is the integral of v, from 0: its offset is free, that of v makes it drift"


def plain_text(text: str) -> str:
    """Text without control characters, which no page or table shows."""
    return "".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in text)


def checked_raw(raw: Any) -> dict[str, tuple[str, float]]:
    """Raw unit and factor by channel."""
    if raw is not None and not isinstance(raw, Mapping):
        raise ValueError(f'raw must be a mapping such as {{"x": ("counts", 1e-6)}}, got {raw!r}')
    found: dict[str, tuple[str, float]] = {}
    for role, value in (raw or {}).items():
        try:
            unit, factor = value
        except (TypeError, ValueError):
            raise ValueError(f"raw[{role!r}] must be a unit and a factor, got {value!r}") from None
        if not isinstance(unit, str):
            raise ValueError(f"raw[{role!r}] must begin with the name of a unit, got {unit!r}")
        found[str(role)] = plain_text(unit), finite(f"raw[{role!r}]", factor)
    return found


def checked_notes(notes: Any) -> tuple[str, ...]:
    """Notes as a tuple of texts."""
    if isinstance(notes, str) or not isinstance(notes, Iterable):
        raise ValueError(f'notes must be a sequence of text such as ["filtered"], got {notes!r}')
    notes = tuple(notes)
    for note in notes:
        if not isinstance(note, str):
            raise ValueError(f"notes must hold text, got {note!r}")
    return tuple(map(plain_text, notes))


def checked_units(units: Mapping[str, str] | None) -> dict[str, str]:
    """Units under their SI names; time is always in seconds."""
    labels = {"t": "s"}
    for role, unit in units_by_role(units).items():
        if unit == "" or unit is None:
            continue
        factor, si = si_unit(role, unit)
        if factor != 1:
            raise ValueError(
                f"units: {role} in {unit} is not taken; pass {role} * {factor:g} in {si}, or let "
                "read_record convert it"
            )
        labels[role] = si
    return labels


def vector(name: str, value: Any, gaps: bool = False) -> Floats:
    """A fresh finite float64 vector; with `gaps`, what is not finite or masked is nan."""
    if value is None:
        raise ValueError(f"{name} is missing")
    if np.ma.is_masked(value) and gaps:
        value = value.astype(np.float64).filled(np.nan)
    elif np.ma.is_masked(value):
        raise ValueError(
            f"{name} has {int(np.ma.getmaskarray(value).sum())} masked values; fill them, or use "
            "Record.from_irregular, which bridges and masks them"
        )
    try:
        array = np.asarray(value)
    except ValueError as err:
        raise ValueError(f"{name} is no array of numbers (rows of unequal length?)") from err
    _require_numbers(name, array)
    with np.errstate(over="ignore"):  # beyond float64 becomes inf, told below
        out = np.array(array, dtype=np.float64)
    bad = ~np.isfinite(out)
    if gaps and not bad.all():
        out[bad] = np.nan
    elif bad.any():
        k = int(np.argmax(bad))
        raise ValueError(
            f"{name} has {int(bad.sum())} values that are not finite, the first {name}[{k}] = "
            f"{out[k]}; remove these samples, or bridge and mask them by "
            "Record.from_irregular(...) or read_record(..., dt=...)"
        )
    k = int(np.nanargmax(np.abs(out)))
    if abs(out[k]) > _MAX_MAGNITUDE:
        raise ValueError(f"{name}[{k}] = {out[k]:g} is no physical value; check the column")
    return out


def _require_numbers(name: str, array: np.ndarray) -> None:
    """Refuse what is no vector of numbers that float64 can hold."""
    mend = {
        "b": "holds true and false, not numbers; the wrong column? If meant, .astype(float)",
        "c": "is complex; pass its real part",
        **dict.fromkeys("US", "holds text; convert it with np.asarray(..., dtype=float)"),
        "O": "is of dtype object (None, text or mixed values inside); convert it to float, such as "
        "with pandas.to_numeric or pandas.read_csv(..., decimal=',')",
        "M": "holds dates; pass seconds: (t - t[0]) / np.timedelta64(1, 's')",
        "m": "holds durations; pass seconds: t / np.timedelta64(1, 's')",
        "V": "is a structured array; pass one of its fields",
    }.get(array.dtype.kind)
    if mend:
        raise ValueError(f"{name} {mend}")
    if array.ndim != 1:
        hint = "; use .ravel()" if array.size == max(array.shape, default=0) > 1 else ""
        raise ValueError(f"{name} must be 1-D, got shape {array.shape}{hint}")
    if array.size == 0:
        raise ValueError(f"{name} is empty")
    if array.dtype.kind in "iu" and max(abs(int(array.max())), abs(int(array.min()))) > 2**53:
        raise ValueError(
            f"{name} holds whole numbers beyond 2^53, such as {array[0]}, which float64 cannot "
            f"distinguish; pass {name} - {name}[0]"
        )


def vectors(
    t: Any, u: Any, x: Any, reference: Any, channels: Any = None, gaps: bool = False
) -> tuple[dict[str, Floats], tuple[str, ...]]:
    """Channels by name as vectors, and what was made up: no drive is 0, no x the integral of v."""
    _check_names(channels)
    tv = vector("t", t, gaps)

    def check_vector(name: str, values: Any) -> Floats:
        array = vector(name, values, gaps)
        if array.size != tv.size:
            raise ValueError(
                f"{name} has {array.size} samples but t has {tv.size}; cut them to one length"
            )
        return array

    given = {n: n if n == "load" else f"channels[{n!r}]" for n in channels or {}}
    more = {name: check_vector(given[name], one) for name, one in (channels or {}).items()}
    notes = (NO_DRIVE,) * (u is None)
    u = np.zeros(tv.size) if u is None else u
    if x is None and "v" in more:
        sound = np.isfinite(tv) & np.isfinite(more["v"])
        x = np.full(tv.size, np.nan)
        x[sound] = cumulative_trapezoid(more["v"][sound], tv[sound], initial=0.0)
        notes = (*notes, INTEGRAL)
    found = {"t": tv, "u": check_vector("u", u), "x": check_vector("x", x)}
    if reference is not None:
        found["reference"] = check_vector("reference", reference)
    if tv.size < MIN_SAMPLES:
        raise ValueError(f"{tv.size} samples are too few; at least {MIN_SAMPLES} are needed")
    return found | more, notes


def _check_names(channels: Any) -> None:
    """Refuse channels that are no mapping, or have a name that no channel has."""
    if channels is not None and not isinstance(channels, Mapping):
        raise ValueError(f'channels must be a mapping such as {{"v": velocity}}, got {channels!r}')
    for name in channels or {}:
        if name not in EXTRAS:
            raise ValueError(f"channels: {name!r} is none; known are {', '.join(EXTRAS)}")


def with_load(channels: Any, load: Any) -> Any:
    """Channels with a known load among them, which is no channel for the caller."""
    if load is None:
        return channels
    if isinstance(channels, Mapping) and "load" in channels:
        raise ValueError("load is given twice: leave it out of channels")
    return {**(channels or {}), "load": load}


def without_load(units: dict[str, str]) -> dict[str, str]:
    """Units of the channels; a known load has that of the input."""
    own = units.get("load")
    if own is not None and own != units.get("u", own):
        raise ValueError(
            f"load is in {own} and u in {units['u']}: they add up, give the load in {units['u']}"
        )
    return {role: unit for role, unit in units.items() if role != "load"}


# Largest part of the rows that may lack a number, and be bridged.
_LACKING = 0.2
# Largest part of the rows that may repeat a stamp.
_DOUBLED = 0.05


def sound_rows(
    found: dict[str, Floats], good: Bools | None
) -> tuple[dict[str, Floats], Bools | None, str]:
    """Channels and mask without rows that lack a number or repeat a stamp, and what was wrong."""
    t, u, x = (found[name] for name in "tux")
    whole = np.isfinite(t) & np.isfinite(u) & np.isfinite(x)
    lacking = int(np.count_nonzero(~whole))
    if lacking > _LACKING * t.size:
        raise ValueError(
            f"{lacking} of {t.size} rows have no number for t, u or x, the first is row "
            f"{np.argmin(whole)}: too many to be bridged"
        )
    doubled = np.diff(t, prepend=np.nan) == 0.0
    repeats = int(np.count_nonzero(doubled & whole))
    if repeats > _DOUBLED * t.size:
        repeats = 0  # no accident: refused with what it may be
    keep = np.flatnonzero(whole & ~doubled if repeats else whole)

    def part(values: Floats) -> Floats:
        values = values[keep]
        there = np.isfinite(values)
        return values if there.all() else np.interp(t[keep], t[keep][there], values[there])

    kinds = (lacking, "without a number"), (repeats, "with the stamp of the row before")
    words = [f"{n} row{'s' * (n > 1)} {what}" for n, what in kinds if n]
    sound = {name: part(values) for name, values in found.items()}
    return sound, None if good is None else good[keep], " and ".join(words)


def increasing_steps(t: Floats) -> Floats:
    """The steps of a time that increases."""
    steps = np.diff(t)
    usual = float(np.median(np.abs(steps)))
    back = steps < 0
    if back.any():
        k = int(np.argmax(back))
        raise ValueError(
            f"t goes back {int(back.sum())} times, first from t[{k}] = "
            f"{stamp_text(t[k], usual)} to t[{k + 1}] = {stamp_text(t[k + 1], usual)}; sort the "
            "samples by time, or split where runs were joined"
        )
    same = steps == 0
    if same.any():
        k = int(np.argmax(same))
        few = same.sum() <= _DOUBLED * t.size
        raise RefusalError(
            f"t has {int(same.sum())} duplicated time stamps, first t[{k}] = t[{k + 1}] = "
            f"{stamp_text(t[k], usual)}; keep one of each: keep = np.r_[True, "
            "np.diff(t) > 0], or, of an even clock in coarse stamps, give rate= and "
            "columns={'t': None}",
            **(
                {"dt": _suggested_step(steps[~same])}
                if few
                else {"rate": ..., "columns": {"t": None}}
            ),
        )
    return steps


# Longest gap that a line to copy fills, in usual steps.
_SHORT_GAP = 50.0


def short_gap(steps: Floats) -> dict[str, float]:
    """The argument that fills the gaps of a record, none where one is too long to be filled."""
    longest = float(steps.max())
    short = longest <= _SHORT_GAP * float(np.median(steps))
    return {"max_gap": float(f"{1.01 * longest:.3g}")} if short else {}


def _suggested_step(steps: Floats) -> float:
    """Step to which a record is resampled where the user names none [s]."""
    return float(f"{np.median(steps):.3g}")


def uniform_step(t: Floats) -> float:
    """Step of a uniform time; errors for gaps and jitter."""
    steps = increasing_steps(t)
    median = float(np.median(steps))
    long = steps > 1.5 * median
    regular = np.abs(steps - median) <= 0.2 * median
    if long.any() and np.mean(regular) >= 0.9:
        k = int(np.argmax(long))
        missing = int(np.sum(np.rint(steps[long] / median) - 1))
        longest = float(steps.max())
        allowed = f", max_gap={1.01 * longest:.3g}" if longest > 5.0 * median else ""
        more = short_gap(steps) if allowed else {}
        raise RefusalError(
            f"{int(long.sum())} gaps in t, about {missing} samples dropped; the first of "
            f"{steps[k]:.4g} s (step {median:.4g} s) after t[{k}] = {stamp_text(t[k], median)} s, "
            f"the longest of {longest:.4g} s. Split there with Record.split_at_gaps(...), or fill "
            "short ones with Record.from_irregular(...) or "
            f"read_record(..., dt={median:.4g}{allowed})",
            dt=_suggested_step(steps),
            **more,
        )
    dt = float((t[-1] - t[0]) / (t.size - 1))
    resolution = single_spacing(t) or float(np.spacing(np.abs(t).max()))
    jitter = float(np.abs(steps - dt).max())
    if jitter > JITTER_LIMIT * dt:
        coarse = (
            f" At {stamp_text(t[-1], dt)} s the stamps resolve {resolution:.2g} s: "
            "subtract the start first."
            if resolution > 0.1 * JITTER_LIMIT * dt
            else ""
        )
        raise RefusalError(
            f"t is not uniform: steps from {steps.min():.4g} s to {steps.max():.4g} s, jitter "
            f"{100 * jitter / dt:.3g} % of dt = {dt:.4g} s (limit {100 * JITTER_LIMIT:g} %). "
            f"Resample with Record.from_irregular(...) or read_record(..., dt={dt:.3g}); "
            f"if only the stamps are coarse, pass t = t0 + dt * np.arange(n).{coarse}",
            dt=float(f"{dt:.3g}"),
        )
    off = float(np.abs(t - t[0] - dt * np.arange(t.size)).max())
    if off > 0.5 * dt:
        raise RefusalError(
            f"the clock of t drifts: {off:.3g} s away from uniform, more than half of dt = "
            f"{dt:.4g} s. Resample with Record.from_irregular(...)",
            dt=_suggested_step(steps),
        )
    # the roundest step that the stamps cannot tell from the mean
    return round_within(dt, (off + 4 * resolution) / (t.size - 1))


# Way back and forth, as a part of the range, of an axis that does not turn round; one that does is
# not driven by a constant force.
_TURNS_BACK = 0.05


def check_motion(u: Floats, x: Floats, grid: float | None = None) -> None:
    """Errors for what never moves and for an encoder that wraps, on a grid if it has one."""
    # a few units in the last place are rounding, not motion
    if _constant(x):
        raise ValueError(f"x is constant ({x[0]:.6g}): the axis never moved, or the wrong column")
    if _constant(u) and u.any():
        if float(np.abs(np.diff(x)).sum() - abs(x[-1] - x[0])) > _TURNS_BACK * float(np.ptp(x)):
            raise ValueError(
                f"u is constant ({u[0]:.6g}): without excitation nothing can be learned; check the "
                "column. A free motion has u = 0 throughout"
            )
        warn(f"u is constant ({u[0]:.6g}): a run under one force, which shows little")

    def jump(k: int) -> str:
        return f"x[{k}] = {x[k]:.6g} to x[{k + 1}] = {x[k + 1]:.6g}"

    steps = np.abs(np.diff(x))
    span = float(np.ptp(x))
    usual = float(np.median(steps[steps > 0]))
    jumps = np.flatnonzero(steps > 0.5 * span)
    if usual > 0.1 * span:
        return
    beside = np.pad(steps, 1)
    lone = np.maximum(beside[jumps], beside[jumps + 2]) < 0.1 * steps[jumps]
    ends = np.sort((x[jumps], x[jumps + 1]), axis=0)
    wraps = jumps[lone & (ends[0] <= x.min() + 0.1 * span) & (ends[1] >= x.max() - 0.1 * span)]
    if wraps.size:
        period = _period(x, wraps, grid)
        raise RefusalError(
            f"x jumps {wraps.size} times across its whole range, first from {jump(wraps[0])}: the "
            f"encoder wraps around. Pass its period, unwrap={period:.10g} perhaps;"
            " if runs were joined, or the counter was set to zero, split there",
            unwrap=float(f"{period:.10g}"),
        )
    if (last := _set_to_zero(x, steps)) is not None:
        warn(
            f"x jumps from {jump(last)}: was the counter set to zero there? Then split the record: "
            f"record[:{last + 1}] and record[{last + 1}:]"
        )
    elif jumps.size:
        warn(
            f"x jumps {jumps.size} times by more than half its range in one sample, first from "
            f"{jump(jumps[0])}; a glitch?"
        )


def _constant(values: Floats) -> bool:
    return bool(np.ptp(values) <= 8 * np.spacing(np.abs(values).max()))


# A counter was set to zero: least jump over the steps nearby,
_RESET = 20.0
# over the largest other step,
_LARGEST = 3.0
# and largest position after it over the steps nearby.
_AT_ZERO = 2.0


def _set_to_zero(x: Floats, steps: Floats) -> int | None:
    """Last sample before a counter was set to zero in mid-record, None if it was not."""
    if steps.size < 2 * MIN_SAMPLES:
        return None
    near = ndimage.maximum_filter1d(np.where(steps < 0.5 * steps.max(), steps, 0.0), 7)
    near = np.maximum(near, np.min(steps[steps > 0.0]))
    jumps = (steps > _RESET * near) & (np.abs(x[1:]) <= _AT_ZERO * near)
    found = np.flatnonzero(jumps & (steps > _LARGEST * steps[~jumps].max(initial=0.0)))
    return int(found[0]) if found.size else None


#: Turns and counters that encoders have, in rad, degrees, turns or increments.
_COUNTS = [*(2.0**k for k in range(8, 33)),
           *(f * 10.0**k for k in (2, 3, 4) for f in (1, 2, 3.6, 4, 5, 8))]  # fmt: skip
_TURNS = [2 * math.pi, math.pi, 360.0, 180.0, 1.0, *_COUNTS]


def _period(x: Floats, wraps: Ints, grid: float | None) -> float:
    """Period of an encoder whose readings, `grid` apart, wrap after some samples."""
    steps = np.diff(x)
    inner = wraps[(wraps > 0) & (wraps < steps.size - 1)]
    wraps = inner if inner.size else wraps
    before = steps[np.maximum(wraps - 1, 0)]
    after = steps[np.minimum(wraps + 1, steps.size - 1)]
    if not inner.size:
        before = after = np.zeros(wraps.size)
    way = 0.5 * (before + after)
    sign = np.sign(steps[wraps] - way)
    period = float(np.median(sign * (steps[wraps] - way)))
    # What acceleration and the grid leave open.
    unsure = 1e-9 * period + (grid or 0.0) + float(np.median(np.abs(after - before)))
    known = _TURNS + [grid * one for one in _COUNTS if grid]
    near = min(known, key=lambda one: abs(one - period))
    if abs(near - period) <= unsure:
        return near
    return grid * round(period / grid) if grid else period


# Error of a period of the encoder from which on it is another one, in changes of the step from
# sample to sample.
_OTHER = 8.0
# The same where several wraps have about the same error.
_ALIKE_OTHER = 3.0
# The same as a part of the period.
_SHARE = 1e-4
# Fewest wraps that are several.
_SURE = 3


def unwrap_encoder(
    found: dict[str, Floats], period: float | None, factor: float
) -> dict[str, Floats]:
    """Channels without the jumps of an encoder of a period, None for none."""
    if period is None:
        return found
    x = found["x"]
    period = positive("unwrap", period)
    grid = grid_of(x, factor)
    steps = np.abs(np.diff(x))
    if np.mean(steps[steps > 0] > 0.5 * period) > 0.1:
        raise ValueError(
            f"unwrap = {period:g} is shorter than twice most steps of x, {np.median(steps):.4g} "
            "usually: it is the period of the encoder in the unit of x"
        )
    path = np.unwrap(x, period=period)
    step = np.diff(path)
    turns = np.rint((step - np.diff(x)) / period)
    if (wraps := np.flatnonzero(turns[1:-1]) + 1).size:
        # Motion goes on over a wrap as before and after it.
        off = turns[wraps] * (step[wraps] - 0.5 * (step[wraps - 1] + step[wraps + 1]))
        usual = float(np.median(np.abs(np.diff(step))))
        wrong = abs(float(np.median(off)))
        alike = wraps.size >= _SURE and np.median(np.abs(off - np.median(off))) < 0.5 * wrong
        limit = (_ALIKE_OTHER if alike else _OTHER) * usual
        if wrong > max(limit, 2.0 * (grid or 0.0), _SHARE * period):
            message = (
                f"unwrap = {period:.10g} leaves a jump of {wrong:.4g} where x wraps around, "
                f"{wraps.size} times, first after x[{wraps[0]}]: is the period unwrap="
                f"{_period(x, wraps, grid):.10g}?"
            )
            if alike:
                raise ValueError(message)
            warn(message)
    found = found | {"x": path}
    if "reference" in found:
        asked = np.unwrap(found["reference"], period=period)
        found["reference"] = asked - period * np.rint((asked[0] - path[0]) / period)
    return found


# Suspected unit of time: name, short name, factor, step and time since 1970 from which on.
_CLOCKS = (
    ("nanoseconds", "ns", 1e-9, 5e4, 1e17),
    ("microseconds", "us", 1e-6, 50.0, 1e14),
    ("milliseconds", "ms", 1e-3, 0.1, 1e11),
)


def warn_if_suspect(t: Floats, dt: float, u: Floats, timed: bool = False) -> None:
    """Warnings for a time not in seconds, unless its unit is `timed`, and for a clipped input."""
    if dt >= 0.1 and not timed:
        epoch = next((clock for clock in _CLOCKS if t[0] >= clock[4]), None)
        name, unit, factor, *_ = epoch or next(clock for clock in _CLOCKS if dt >= clock[3])
        warn(
            f"dt = {dt:g} s: time suspected in {name}; then pass t * {factor:g}, or "
            f'units={{"t": "{unit}"}} to read_record'
        )
    clipped = [samples_at_limit(u, level) for level in (float(u.min()), float(u.max()))]
    if all(clipped):
        warn(
            f"u rests {clipped[0]} samples at its minimum {u.min():.6g} and {clipped[1]} at its "
            f"maximum {u.max():.6g}: clipped? Then make sure that u is the force that acted, not "
            "the one commanded"
        )


def samples_at_limit(u: Floats, level: float) -> int:
    """Samples at a level that u reaches at speed and stays at, where it moves much of the time."""
    # A smooth crest slows down before it rests; a square wave comes in one step.
    steps = np.abs(np.diff(u))
    if np.mean(steps > 0) < 0.2:
        return 0
    at = np.concatenate(([False], u == level, [False]))
    starts = np.flatnonzero(at[1:] & ~at[:-1])
    lengths = np.flatnonzero(~at[1:] & at[:-1]) - starts
    runs = starts[(lengths >= 3) & (starts >= 2)]
    if runs.size == 0 or np.mean(steps[runs - 2] > 0.25 * np.median(steps[steps > 0])) < 0.5:
        return 0
    return int(at.sum())


# Largest noise of an input whose limits are looked for in it, as a part of its range.
_NOISY = 0.015
# Noise of a median of 5 readings over that of one.
_MEDIAN = 0.54
# Half width of a limit, in standard deviations of the median.
_BAND = 4.0
# Shortest stay at a limit [samples].
_STAY = 16
# Fewest stays.
_STAYS = 3
# Least change of the input in the last quarter of a stay's length before it, in standard
# deviations of the median: a crest of a sine has 5.
_RUN_IN = 15.0
# Range of the ratio of its two halves: a step that lags slows down.
_EVEN = (0.7, 1.5)
# Least change of the velocity during the stays, as a part of its range: what friction alone asks
# for at constant velocity is no limit.
_CHANGE = 0.05


def clipped_samples(u: Floats, x: Floats) -> Bools:
    """Samples at which the input rests at both its limits, exactly or but for its noise."""
    # Noise hides a limit: there the input must run into its extremes, stay and change the velocity
    # meanwhile, three times each way, which no sine, triangle, square wave or mere friction does.
    extremes = float(u.min()), float(u.max())
    if all(samples_at_limit(u, one) for one in extremes):
        return np.asarray(np.isin(u, extremes))
    mask = np.zeros(u.size, bool)
    spread = _MEDIAN * spread_of(u, 0.0)
    if not 0.0 < spread < _NOISY * np.ptp(u):
        return mask
    for smooth in (ndimage.median_filter(u, 5), ndimage.median_filter(-u, 5)):
        highest = np.sort(smooth[smooth >= smooth.max() - 2.0 * _BAND * spread])
        within = np.searchsorted(highest, highest + 2.0 * spread, side="right")
        level = highest[np.argmax(within - np.arange(highest.size))] + spread
        inside = smooth >= level - _BAND * spread
        edges = np.flatnonzero(np.diff(inside, prepend=False, append=False))
        starts = edges[::2]
        ends = edges[1::2]
        long = (ends - starts >= _STAY) & (starts > (ends - starts) // 4)
        starts = starts[long]
        ends = ends[long]
        if starts.size < _STAYS or not _runs_in(smooth, x, starts, ends, spread):
            return np.zeros(u.size, bool)
        for start, end in zip(starts, ends, strict=True):
            mask[start:end] = True
    return mask


def _runs_in(u: Floats, x: Floats, starts: Ints, ends: Ints, spread: float) -> bool:
    """Whether an input runs into its upper limit, and the axis accelerates there."""
    long = ends - starts
    before = np.stack([u[starts - 1 - k * (long // 8)] for k in range(3)])
    late, early = np.average(-np.diff(before, axis=0), axis=1, weights=long)
    if late + early < _RUN_IN * spread or not _EVEN[0] * early < late < _EVEN[1] * early:
        return False
    quarter = long // 4
    last = x[ends - 1] - x[ends - 1 - quarter]
    second = x[starts + 2 * quarter - 1] - x[starts + quarter - 1]
    change = np.average(np.abs(last - second) / quarter, weights=long)
    lag = int(np.median(quarter))
    return bool(change > _CHANGE * np.ptp(x[lag:] - x[:-lag]) / lag)


def spread_of(x: Floats, quantum: float) -> float:
    """Standard deviation of the fast noise of positions, at least that of a quantum."""
    floor = quantum / QUANTA
    if x.size < MIN_SAMPLES:
        return floor
    spread = float(np.median(np.abs(np.diff(x, 4))))
    # 0.6745: median of |N(0, 1)|; 70 = 1 + 16 + 36 + 16 + 1
    return max(floor, spread / 0.6745 / math.sqrt(70))


# Part of the steps that have one size, from which on they must lie on the grid.
_ALIKE = 0.9
# Largest distance from the grid, as a part of it.
_EXACT = 0.01


def estimated_quantum(x: Floats, factor: float = 1.0) -> float | None:
    """Largest grid of the positions, else that of the decimals before `factor`; None if none."""
    resolution = float(np.spacing(np.abs(x).max()))
    steps = np.abs(np.diff(x))
    gaps = np.diff(np.unique(x))
    least = max(64 * resolution, NEAR * float(np.ptp(x)))
    steps = steps[steps > least]
    gaps = gaps[gaps > least]
    repeated = gaps.size + 1 < x.size / 2
    if gaps.size == 0 or (not repeated and min(gaps.size, steps.size) < MIN_SAMPLES):
        return None
    # at constant speed every step is the same: no sign of an encoder
    if not repeated and np.ptp(steps) < 0.1 * steps.min():
        return None
    seen = np.concatenate([steps, gaps])
    for start in np.unique(np.quantile(gaps, [0.5, 0.2, 0.05, 0.01, 0.0], method="lower"))[::-1]:
        step = float(start)
        for reach in (1.5, 4.5, 16.5, 64.5, 256.5):  # longer differences sharpen the step
            count = np.rint(seen / step)
            sound = (seen < reach * step) & (np.abs(seen / step - count) < 0.1)
            longest = sound & (count >= max(1, 0.5 * count[sound].max()))
            step = float(np.median(seen[longest] / count[longest]))
        near = seen[seen < 256.5 * step] / step
        # So are nearly all of a motion that runs up to it, but for what disturbs them.
        far = np.abs(near - np.rint(near))
        on_grid = np.mean(far < 0.1)
        alike = np.unique(np.rint(near), return_counts=True)[1].max() > _ALIKE * near.size
        if alike and np.median(far) > _EXACT:
            continue
        if on_grid >= 0.98 and near.size >= 0.5 * gaps.size and step > 1e3 * resolution:
            return step
    return decimal_grid(x, factor)


def grid_of(x: Floats, factor: float) -> float | None:
    """Distance between two readings: one raw number if all are whole ones, else as estimated."""
    whole = x / factor
    if factor != 1.0 and np.all(np.abs(whole - np.rint(whole)) < 1e-3):
        return abs(factor)
    return estimated_quantum(x, factor)


def decimal_grid(x: Floats, factor: float = 1.0) -> float | None:
    """Largest power of ten, times a factor, of which all positions are multiples."""
    read = x / factor
    resolution = float(np.spacing(np.abs(read).max()))
    digits = math.floor(math.log10(np.ptp(read)))
    while 10.0**digits > 1e3 * resolution:
        # A power of ten is exact upward, a fraction is not: 0.1 times 3 is not 0.3.
        whole = read * 10.0**-digits if digits < 0 else read / 10.0**digits
        if np.all(np.abs(whole - np.rint(whole)) <= 8 * np.spacing(np.abs(whole).max())):
            return abs(factor) * 10.0**digits
        digits -= 1
    return None


def _with_lost(t: Floats, u: Floats) -> tuple[Floats, Floats]:
    """Stamps and inputs with the samples in between that were lost, along straight lines."""
    # A value held over several steps would be an impulse that did not act.
    steps = np.diff(t)
    at = np.append(0.0, np.cumsum(np.maximum(np.rint(steps / np.median(steps)), 1.0)))
    every = np.arange(at[-1] + 1.0)
    return np.interp(every, at, t), np.interp(every, at, u)


# Channels that are held from one sample to the next.
_HELD = ("u", "load")


def resample(
    found: dict[str, Floats], dt: float, hold: str, interpolation: str
) -> dict[str, Floats]:
    """The channels on a uniform grid that starts at t[0]."""
    found = dict(found)
    t = found["t"]
    one_of("hold", hold, ("zero", "first"))
    one_of("interpolation", interpolation, ("monotone", "linear", "cubic"))
    count = (t[-1] - t[0] + 2 * np.spacing(np.abs(t).max())) / dt + 1e-6
    if not MIN_SAMPLES - 1 <= count <= 10 * MAX_ROWS:
        raise ValueError(
            f"dt = {dt:g} s would make {count + 1:.3g} samples of {t[-1] - t[0]:.4g} s; it takes "
            f"{MIN_SAMPLES} to {10 * MAX_ROWS}"
        )
    grid = t[0] + dt * np.arange(int(count) + 1)
    inside = np.minimum(grid, t[-1])

    def smooth(values: Floats) -> Floats:
        if interpolation == "linear":
            return np.asarray(np.interp(inside, t, values))
        curve = PchipInterpolator if interpolation == "monotone" else CubicSpline
        # Readings of damaged files; what is not finite is refused when the record is made.
        with np.errstate(over="ignore", invalid="ignore"):
            return np.asarray(curve(t, values)(inside))

    def mean(force: Floats) -> Floats:
        """A held force over each new sample."""
        if hold == "first":
            return np.asarray(np.interp(inside, t, force))
        at, drive = _with_lost(t, force)
        slack = 1e-6 * dt  # a stamp this close to the grid counts as on it
        first = np.searchsorted(at, grid + slack, side="right") - 1
        last = np.searchsorted(at, grid + dt - slack, side="left") - 1
        impulse = np.concatenate(([0.0], np.cumsum(drive[:-1] * np.diff(at))))
        upto = np.interp(grid, at, impulse), np.interp(grid + dt, at, impulse)
        beyond = force[-1] * np.maximum(0.0, grid + dt - t[-1])
        return np.where(first == last, drive[first], (upto[1] + beyond - upto[0]) / dt)

    del found["t"]
    return {"t": grid} | {k: (mean if k in _HELD else smooth)(one) for k, one in found.items()}


_LATEST = 0.1  # s, delay that is looked for


class Comparison(NamedTuple):
    """How a channel differs from what is expected of it."""

    gain: float  # factor on the expected channel; far from 1, its unit is another one
    offset: float  # [unit of the channel]
    delay: float  # time by which the channel comes later [s]
    rms: float  # of what is left [unit of the channel]


def compare_channels(expected: Floats, measured: Floats, dt: float) -> Comparison:
    """Gain, offset and delay that bring a channel closest to what is expected."""
    longest = min(round(_LATEST / dt), expected.size // 4)
    inside = slice(longest, expected.size - longest)
    wanted = expected[inside]
    if wanted.size < 3 or np.ptp(wanted) == 0.0:
        raise ValueError("the position does not move enough to compare a channel with it")
    centred = wanted - wanted.mean()

    def compare_at(lag: int) -> Comparison:
        seen = measured[longest + lag : expected.size - longest + lag]
        gain = float(centred @ seen) / float(centred @ centred)
        offset = float(seen.mean() - gain * wanted.mean())
        rms = float(np.sqrt(np.mean((seen - gain * wanted - offset) ** 2)))
        return Comparison(gain, offset, lag * dt, rms)

    return min(map(compare_at, range(-longest, longest + 1)), key=lambda one: one.rms)
