"""Channels that were read at moments of their own, brought to the clock of the position."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from dryfric_control.arrays import Bools, Floats
from dryfric_control.records.readers.channels import Channels
from dryfric_control.records.staircase import Staircase, find_staircase
from dryfric_control.units import si_unit

# Part of the step of the position that the step of an input may be shorter before it is averaged.
_FASTER = 0.75
# Part of a channel's numbers that are missing from which on it has a clock of its own.
SPARSE = 0.2
# Numbers that such a channel has at least.
_LEAST = 10


class _Readings(NamedTuple):
    """Numbers of a channel and when they were read, in order of time, each moment once."""

    stamps: Floats
    values: Any

    @property
    def step(self) -> float:
        return float(np.median(np.diff(self.stamps))) if len(self.stamps) > 1 else np.inf

    def covers(self, grid: Floats) -> bool:
        """Whether stamps on a grid lie within those of the channel."""
        return bool(self.stamps[0] <= grid[0] and grid[-1] <= self.stamps[-1] + self.step)


def with_own_clocks(found: Channels, hold: str) -> Channels:
    """Channels of a table that joins several rates, each with the stamps of its own rows."""
    t = np.asarray(found.values.get("t", ()))
    arrays = {role: np.asarray(found.values[role]) for role in found.values if role != "t"}
    if found.clocks or not _is_table(t, arrays.values()):
        return found
    there = {role: np.isfinite(arrays[role]) for role in arrays}
    sparse = [role for role in ("u", "x") if role in there and there[role].mean() < 1.0 - SPARSE]
    clocks: dict[str, Any] = {}
    if sparse and all(there[role].sum() >= _LEAST for role in sparse):
        clocks = dict.fromkeys(arrays, t)
    elif hold == "first" and (steps := _input_staircase(arrays)) is not None:
        # The rows on which a held input changes are those on which it was read.
        clocks = dict.fromkeys(arrays, t)
        clocks["u"] = np.interp(steps.reads, np.arange(t.size), t.astype(np.float64))
        arrays["u"] = arrays["u"][steps.changes]
    if not clocks:
        return found
    return replace(found, values=arrays, clocks=clocks)


def _input_staircase(arrays: Mapping[str, Any]) -> Staircase | None:
    """Staircase of an input without gaps, if it is one."""
    u = arrays.get("u")
    if u is None or u.size < 2 or not np.isfinite(u).all():
        return None
    return find_staircase(u.astype(np.float64), 0.0)


def _is_table(t: Any, columns: Iterable[Any]) -> bool:
    """Whether stamps and columns are numbers, as many of each."""
    if t.dtype.kind not in "iuf" or t.ndim != 1:
        return False
    return all(one.shape == t.shape and one.dtype.kind in "iuf" for one in columns)


def on_position_clock(found: Channels, hold: str, needed: tuple[str, ...] = ()) -> Channels:
    """Channels with clocks of their own on that of the position, which is never resampled.

    The input is held (``hold="zero"``; of a faster one the mean over each step, which keeps the
    impulse), or runs along straight lines (``"first"``).  Whole numbers of other channels are
    counts, and held; everything else runs along straight lines.  Only the time that the input and
    the channels in `needed` cover is kept.
    """
    if not found.clocks:
        return found
    base = "x" if "x" in found.values else "v"
    origin = _first_stamp(found.clocks.values())
    read = {
        role: _sort_readings(found.clocks[role], values, origin)
        for role, values in found.values.items()
    }
    for role, one in read.items():
        if len(one.stamps) < 2:
            raise ValueError(f"{found.where}: {role} has fewer than two numbers")
    clock = read[base].stamps
    unit = found.units.get("t", "") or "s"
    factor = si_unit("t", unit)[0]
    must = [role for role in read if role in ("u", *needed)]
    inside = _covered_stamps(read, base, must, f"{found.where}: {base}", unit)
    grid = clock[inside]
    values: dict[str, Any] = {"t": grid}
    notes = []
    for role, one in read.items():
        if role == base or np.array_equal(one.stamps, clock):
            values[role] = one.values[inside]
        elif role in must or one.covers(grid):
            values[role], how = _resample_channel(role, one, grid, hold)
            own = f"{1e3 * factor * one.step:.4g} ms"
            its = f"{1e3 * factor * read[base].step:.4g} ms"
            notes.append(f"{role}, read every {own}, {how} onto the clock of {base}, every {its}")
    if lost := int((~inside).sum()):
        notes.append(f"{lost} readings of {base} left out: before or after the other channels")
    return replace(found, values=values, clocks={}, notes=(*found.notes, *notes))


def _covered_stamps(
    read: Mapping[str, _Readings], base: str, must: list[str], what: str, unit: str
) -> Bools:
    """Stamps of a channel within the time that all channels in `must` cover."""
    clock = read[base].stamps
    start = max((read[role].stamps[0] for role in must), default=clock[0])
    end = min((read[role].stamps[-1] + read[role].step for role in must), default=clock[-1])
    slack = 1e-6 * read[base].step  # stamps that were written with few digits
    inside = (clock >= start - slack) & (clock <= end + slack)
    if inside.sum() < 2:
        raise ValueError(
            f"{what} was read from {clock[0]:.6g} to {clock[-1]:.6g} {unit}, the "
            f"other channels from {start:.6g} to {end:.6g} {unit}: they have no time in common"
        )
    return np.asarray(inside)


def _first_stamp(clocks: Any) -> int | float:
    """First of the whole stamps, 0 where all are in floating point."""
    firsts = [np.asarray(one).min() for one in clocks if len(one)]
    whole = [int(one) for one in firsts if one.dtype.kind in "iu"]
    return min(whole) if whole else 0.0


def _sort_readings(stamps: Any, values: Any, origin: int | float) -> _Readings:
    """Numbers of a channel in order of time, without those that are missing or come twice."""
    when = np.asarray(stamps)
    with np.errstate(invalid="ignore"):  # a stamp that is no number is left out below
        since = (when - origin).astype(np.float64) if when.dtype.kind in "iu" else when - origin
    array = np.asarray(values)
    there = np.isfinite(since)
    if array.dtype.kind == "f":
        there &= np.isfinite(array)
    since = since[there]
    array = array[there]
    order = np.argsort(since, kind="stable")
    since = since[order]
    array = array[order]
    first = np.diff(since, prepend=-np.inf) > 0.0
    return _Readings(since[first], array[first])


def _resample_channel(role: str, one: _Readings, grid: Floats, hold: str) -> tuple[Any, str]:
    """A channel at other moments, and how it came there."""
    stamps, values = one
    if role == "u" and hold == "zero":
        step = float(np.median(np.diff(grid)))
        if one.step < _FASTER * step:
            return _means(stamps, values, grid, step), "averaged over each step"
        return _hold_values(
            stamps, values, grid, 1e-6 * step
        ), 'held (hold="first": straight lines)'
    if role != "u" and values.dtype.kind in "iu":
        return _hold_values(stamps, values, grid, 0.0), "held"
    return np.interp(grid, stamps, values.astype(np.float64)), "brought along straight lines"


def _hold_values(stamps: Floats, values: Any, grid: Floats, slack: float) -> Any:
    """The last value before each moment."""
    last = np.searchsorted(stamps, grid + slack, side="right") - 1
    return values[np.maximum(last, 0)]


def _means(stamps: Floats, values: Any, grid: Floats, step: float) -> Floats:
    """Mean of a held input from each moment to the next."""
    ends = np.append(grid, grid[-1] + step)
    beyond = max(float(stamps[-1] + np.diff(stamps[-2:])[0]), float(ends[-1]))
    edges = np.append(stamps, beyond)
    impulse = np.append(0.0, np.cumsum(values.astype(np.float64) * np.diff(edges)))
    return np.asarray(np.diff(np.interp(ends, edges, impulse)) / np.diff(ends))
