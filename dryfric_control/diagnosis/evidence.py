"""Comparison of simulation and measurement: what differs, and where."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import binary_dilation, maximum_filter1d, minimum_filter1d
from scipy.signal import correlate
from scipy.stats import hypergeom

from dryfric_control.estimation.force_residual import Residual, at_the_mass
from dryfric_control.estimation.windows import Windows, cut
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.records.motion import directions, last_index_so_far, reversals
from dryfric_control.records.record import Record
from dryfric_control.ties import stable_order

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

# Longest lag of the autocorrelation [s].
_LONGEST_LAG = 0.5
# Number of quantile bins of position, speed and time in which large errors are located.
_BINS = 40
# A place is named if the probability of that many bad windows there by chance is below
# this: over all ranges tried, about 1 in 100 for randomly spread bad windows.
_MAX_CHANCE = 1e-4
# Fraction of bad windows at a place from which it is named.
_MIN_BAD_FRACTION = 0.3
# The same over the fraction of bad windows elsewhere.
_MIN_BAD_RATIO = 3.0
# Fraction of a window's samples that must lie in a speed range for the window to count.
_MIN_SAMPLE_FRACTION = 0.3
# Number of places that are named.
_MAX_PLACES = 3
#: Samples of a bin from which its median is shown: with white noise its standard error is then
#: 0.4 of the standard deviation of the samples.
ENOUGH_IN_BIN = 10


@dataclass(frozen=True, eq=False)
class Evidence:
    """An axis compared with a record.

    Made by `evidence`.
    """

    axis: FrictionAxis
    record: Record
    # Time, position and velocity (zero-phase) of the sliding samples that are not `blind_samples`.
    t: FloatArray
    x: FloatArray
    v: FloatArray
    # Force that the axis would need in addition to its drive to move as measured, m a - (u -
    # f v - F): positive where a force in positive direction is missing. u is the force after
    # gain, delay and lag of the drive.
    residual: FloatArray
    hidden: float  # fraction of the sliding samples that is left out as `blind_samples`
    # Time since the motion last changed direction [s]; NaN before the first time.
    since_reversal: FloatArray
    # Autocorrelation of the residual over the lag [s], and the half-width of the 95 % band of
    # white noise. Smoothing alone correlates the shortest lags.
    lags: FloatArray
    autocorrelation: FloatArray
    white: FloatArray
    windows: Windows  # windows of the free runs
    # Free-run position - measured position at every sample of the record, each run from its
    # most likely start state.
    errors: FloatArray
    error_by_window: FloatArray  # RMS of those errors
    # +1 or -1 moving, 0 motionless: in the readings, and in the free runs as read by the same
    # encoder.
    mode_measured: NDArray[np.int8]
    mode_simulated: NDArray[np.int8]

    @property
    def positions(self) -> FloatArray:
        """Position of the free runs at every sample, shape (nsamples,)."""
        return np.asarray(self.record.x + self.errors)

    @property
    def force_rms(self) -> float:
        """RMS of the force residual."""
        return float(np.sqrt(np.mean(self.residual**2))) if self.residual.size else 0.0

    @property
    def position_rms(self) -> float:
        """RMS error of all free runs."""
        return float(np.sqrt(np.mean(self.errors**2)))

    @property
    def stick_slip_mismatch(self) -> float:
        """Stick/slip mismatch: fraction of the samples in which the modes differ."""
        return float(np.mean(self.mode_measured != self.mode_simulated))

    def to_dict(self) -> dict[str, float]:
        """Numbers, ready for JSON."""
        return {
            "force_rms": self.force_rms,
            "position_rms": self.position_rms,
            "mode_disagreement": self.stick_slip_mismatch,
        }


def evidence(
    axis: FrictionAxis,
    record: Record,
    window: float = 0.25,
    hold: str = "zero",
    hide: BoolArray | None = None,
) -> Evidence:
    """Compare the simulation of an axis with a record.

    Parameters
    ----------
    axis : FrictionAxis
        The axis.
    record : Record
        The measured record.
    window : float, optional
        Length of the free runs [s].
    hold : {"zero", "first"}, optional
        Whether the recorded input is held or interpolated linearly between samples.
    hide : ndarray of bool, shape (nsamples,), optional
        Samples that are left out of the force residual.  Default: those of `blind_samples`.

    Returns
    -------
    Evidence

    Raises
    ------
    ValueError
        If the window holds fewer than 5 samples or more than the record.

    Notes
    -----
    The force residual is that of one rigid mass behind the drive of the axis.  Effects at
    rest or between two masses (presliding, backlash, compliance) are no force on this
    mass; they show in the free runs and the modes.

    Examples
    --------
    >>> import numpy as np
    >>> import dryfric_control as dfc
    >>> from dryfric_control.diagnosis.evidence import evidence
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    >>> machine = axis.replace(effects=(dfc.effects.BiasForce(force=0.5),))
    >>> u = 20.0 * np.sin(6e-3 * np.arange(4000))
    >>> x = 1e-6 * np.round(1e6 * machine.simulate(u, dt=1e-3).y[0])
    >>> shown = evidence(axis, dfc.Record(1e-3 * np.arange(4000), u, x))
    >>> round(float(np.median(shown.residual)), 2)
    0.5
    """
    axis = axis.effective()
    windows = cut(record, window, hold)
    behind = at_the_mass(axis, record, hold)
    seen = Residual(*behind)
    moving = directions(record)
    numbers = np.rint((seen.t - record.t[0]) / record.dt)
    index = np.clip(numbers, 0, len(record) - 1).astype(int)
    hidden = blind_samples(*behind) if hide is None else hide
    # Smoothing spreads the hidden samples over its whole window.
    shown = ~binary_dilation(hidden, np.ones(seen.smoothing, bool))[index]
    left_out = float(np.mean(~shown)) if shown.size else 0.0
    # Leave out short rests between two motions in the same direction: no sliding friction.
    highest, lowest = (f(record.x, seen.smoothing) for f in (maximum_filter1d, minimum_filter1d))
    shown &= (highest > lowest)[index]
    index = index[shown]
    residual = seen.residual[shown]
    lags, correlation, white = autocorrelation(residual, index, record.dt)
    at = windows.evaluate(axis, np.ones(len(windows), bool), thorough=True)
    return Evidence(
        axis,
        record,
        seen.t[shown],
        seen.x[shown],
        seen.v[shown],
        residual,
        left_out,
        since_reversal(record)[index],
        lags,
        correlation,
        white,
        windows,
        at.errors,
        np.sqrt(windows.mean_squares(at.errors)),
        moving,
        _modes(windows, record.x + at.errors),
    )


def blind_samples(axis: FrictionAxis, record: Record) -> BoolArray:
    """Samples at which effects of an axis are no force on one rigid mass.

    These are the samples within a distance and a time after each reversal, which
    `Effect.blind` returns.

    Parameters
    ----------
    axis : FrictionAxis
        The axis.
    record : Record
        The measured record.

    Returns
    -------
    ndarray of bool, shape (nsamples,)

    Examples
    --------
    >>> import numpy as np
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0,
    ...                         effects=(dfc.effects.Presliding(distance=5e-3),))
    >>> t = 1e-3 * np.arange(4000)
    >>> hidden = blind_samples(axis, dfc.Record(t, np.cos(t), 0.1 * np.abs(t - 2.0)))
    >>> round(1e-3 * float(hidden[2000:].sum()), 1)     # 0.1 m/s for 2 * 5 mm
    0.1
    """
    axis, record = at_the_mass(axis, record)
    drive = float(np.sqrt(np.mean(record.u**2)))
    hidden = np.zeros(len(record), bool)
    index = np.arange(len(record))
    for effect in axis.effects:
        way, time = effect.blind(axis, drive)
        if way == time == 0.0:
            continue
        turns = np.diff(directions(record), prepend=0) != 0
        share = effect.inner(axis).load_fraction
        if share > 0.0:
            motor = (1.0 - share) * axis.mass * record.derivatives().a
            turns |= np.diff(np.sign(record.u - motor), prepend=0.0) != 0.0
        turns[0] = True
        last = last_index_so_far(turns, 0)
        hidden |= np.abs(record.x - record.x[last]) < way
        hidden |= (index - last) * record.dt < time
    return hidden


def since_reversal(record: Record) -> FloatArray:
    """Time since the motion last changed direction, from the readings.

    Parameters
    ----------
    record : Record
        The record.

    Returns
    -------
    ndarray, shape (n,)
        Time [s]; NaN before the first reversal.  A rest between two motions
        the same way is no reversal.

    Examples
    --------
    >>> import numpy as np
    >>> import dryfric_control as dfc
    >>> t = 1e-3 * np.arange(2000)
    >>> since = since_reversal(dfc.Record(t, np.cos(t), 0.1 * np.abs(t - 0.5)))
    >>> bool(np.isnan(since[100])), round(float(since[1500]), 1)
    (True, 1.0)
    """
    last = last_index_so_far(reversals(record), -1)
    return np.where(last < 0, np.nan, (np.arange(len(record)) - last) * record.dt)


def _modes(windows: Windows, positions: FloatArray) -> NDArray[np.int8]:
    """Directions of the free runs, read by the record's own encoder."""
    record = windows.record
    steps = np.diff(positions)
    restarts = windows.edges[1:-1] - 1
    # The jump at a restart is no motion of the model: repeat the step before it.
    steps[restarts] = steps[restarts - 1]
    path = np.concatenate(([0.0], np.cumsum(steps)))
    return directions(record.read(path, np.random.default_rng(0), origin=0.0))


def autocorrelation(
    values: ArrayLike, index: ArrayLike, dt: float, longest: float = _LONGEST_LAG
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Autocorrelation of a signal with missing samples.

    Parameters
    ----------
    values : array_like, shape (n,)
        Values.
    index : array_like of int, shape (n,)
        Sample at which each was taken, increasing.
    dt : float
        Sampling time [s].
    longest : float, optional
        Longest lag [s].

    Returns
    -------
    lags : ndarray, shape (nlags,)
        Lags with at least 20 pairs of values [s].
    correlation : ndarray, shape (nlags,)
        Mean product of the pairs over the mean square of their members.
    white : ndarray, shape (nlags,)
        1.96 / sqrt(number of pairs).

    Examples
    --------
    >>> lags, correlation, _ = autocorrelation([1.0, -1.0] * 50, range(100), dt=0.01)
    >>> correlation[:3].round(6).tolist()
    [1.0, -1.0, 1.0]
    """
    r = np.asarray(values, dtype=float)
    k = np.asarray(index, dtype=np.int64)
    if r.size < 2:
        return np.zeros(0), np.zeros(0), np.zeros(0)
    r = r - r.mean()
    step = int(np.median(np.diff(k)))
    held = np.zeros(int(k[-1] - k[0]) + 1)
    held[k - k[0]] = 1.0
    signal = np.zeros_like(held)
    signal[k - k[0]] = r
    middle = held.size - 1
    lags = np.arange(0, min(middle, round(longest / dt)) + 1, max(step, 1))

    def pairs(a: FloatArray, b: FloatArray) -> FloatArray:
        return np.asarray(correlate(a, b, mode="full", method="fft")[middle + lags])

    count = np.rint(pairs(held, held))
    early = pairs(held, signal**2)
    late = pairs(signal**2, held)
    enough = count >= 20
    size: FloatArray = np.sqrt(np.maximum(early * late, 0.0))[enough]
    products = pairs(signal, signal)[enough]
    correlation = np.divide(products, size, out=np.zeros_like(size), where=size > 0.0)
    white = np.asarray(1.96 / np.sqrt(count[enough]))
    return np.asarray(dt * lags[enough], dtype=float), np.asarray(correlation), white


class Binned(NamedTuple):
    """Quartiles of values in bins, each shape (nbins,)."""

    centre: FloatArray
    median: FloatArray
    low: FloatArray
    high: FloatArray
    samples: NDArray[np.int64]


def bin_values(values: ArrayLike, by: ArrayLike, bins: int | ArrayLike = 24) -> Binned:
    """Median and quartiles of values over a variable that they may depend on.

    Parameters
    ----------
    values : array_like, shape (n,)
        Values.
    by : array_like, shape (n,)
        The variable; samples where it is NaN are left out.
    bins : int or array_like, shape (nbins + 1,), optional
        Number of equal bins, or their edges.

    Returns
    -------
    Binned
        NaN in bins of fewer than `ENOUGH_IN_BIN` values, so that no line is drawn across them.

    Examples
    --------
    >>> found = bin_values(range(12), [0] * 11 + [1], bins=[0, 0.5, 1])
    >>> found.median.tolist(), found.samples.tolist()
    ([5.0, nan], [11, 1])
    """
    y = np.asarray(values, dtype=float)
    z = np.asarray(by, dtype=float)
    known = np.isfinite(y) & np.isfinite(z)
    y = y[known]
    z = z[known]
    if y.size == 0:
        none = np.zeros(0)
        return Binned(none, none, none, none, np.zeros(0, np.int64))
    edges = np.histogram_bin_edges(z, bins) if np.ndim(bins) == 0 else np.asarray(bins, float)
    number = np.clip(np.searchsorted(edges, z, side="right") - 1, 0, edges.size - 2)
    inside = (z >= edges[0]) & (z <= edges[-1])
    quartiles = np.full((edges.size - 1, 3), np.nan)
    samples = np.bincount(number[inside], minlength=edges.size - 1)
    for i in np.flatnonzero(samples >= ENOUGH_IN_BIN):
        quartiles[i] = np.quantile(y[inside & (number == i)], [0.25, 0.5, 0.75])
    low, median, high = quartiles.T
    return Binned(0.5 * (edges[:-1] + edges[1:]), median, low, high, samples)


class _Place(NamedTuple):
    """A part of the record to which the large errors may be confined."""

    kind: str
    words: str
    there: BoolArray  # windows that lie in it
    width: int = 0  # of places with the same windows, the narrowest is named


def where(
    scores: FloatArray, expected: float, windows: Windows, units: tuple[str, str] = ("m", "N")
) -> tuple[str, ...]:
    """Describe in words where the windows with large scores lie.

    Parameters
    ----------
    scores : ndarray, shape (nwindows,)
        Score of each window, larger is worse; NaN for windows not judged.
    expected : float
        Largest score that noise alone causes.
    windows : Windows
        The windows.
    units : tuple of str, optional
        Units of position and force.

    Returns
    -------
    tuple of str
        At most three places, the clearest first; one phrase that says so if the
        bad windows have no clear location; empty if no window is bad.

    Notes
    -----
    The bad windows are those above `expected`; if these are more than half of all and
    have no clear location, the worse half.  They are counted inside and outside of
    every range of position, speed and time between quantiles, of windows with a
    reversal, with a breakaway and at rest, and by direction of motion.  A range is
    named if that many bad windows are improbable there by chance (hypergeometric
    tail) and if they are several times as frequent there as elsewhere.

    Examples
    --------
    >>> import numpy as np
    >>> import dryfric_control as dfc
    >>> from dryfric_control.estimation.windows import cut
    >>> t = 1e-3 * np.arange(20_000)
    >>> windows = cut(dfc.Record(t, np.cos(t), 0.1 * np.sin(9.0 * t)), window=0.25)
    >>> bad = (windows.start_times > 5.0) & (windows.start_times < 7.9)
    >>> where(np.where(bad, 3.0, 0.1), 1.0, windows)
    ('between t = 5 and 8 s (11 of 12 windows there, none of 68 elsewhere)',)
    """
    judged = np.isfinite(scores)
    bad = judged & (scores > expected)
    if not bad.any():
        return ()
    places = list(_places(windows, units[0]))
    words = _significant_places(places, judged, bad)
    if not words and bad.sum() > 0.5 * judged.sum():
        words = _significant_places(places, judged, judged & (scores > np.median(scores[judged])))
    if words:
        return words
    return (f"spread over the record, no clear location: {bad.sum()} of {judged.sum()} windows",)


def _significant_places(places: list[_Place], judged: BoolArray, bad: BoolArray) -> tuple[str, ...]:
    """Places that contain significantly many bad windows, in words."""
    inside = np.array([place.there & judged for place in places]).reshape(-1, judged.size)
    total = int(judged.sum())
    count = int(bad.sum())
    size = inside.sum(axis=1)
    hits = (inside & bad).sum(axis=1)
    chance = hypergeom.sf(hits - 1, total, count, size)
    share = hits / np.maximum(size, 1)
    elsewhere = (count - hits) / np.maximum(total - size, 1)
    clear = (
        (chance < _MAX_CHANCE)
        & (share >= _MIN_BAD_FRACTION)
        & (share >= _MIN_BAD_RATIO * elsewhere)
    )
    order = np.flatnonzero(clear)
    for key in (np.array([place.width for place in places]), chance):
        order = order[stable_order(key[order])]
    named: dict[str, str] = {}
    for i in order:
        # A place that is far less significant most likely only overlaps the clearest one.
        if chance[i] > np.sqrt(chance[order[0]]):
            break
        others = str(count - hits[i]) if hits[i] < count else "none"
        named.setdefault(
            places[i].kind,
            f"{places[i].words} ({hits[i]} of {size[i]} windows there, "
            f"{others} of {total - size[i]} elsewhere)",
        )
    return tuple(named.values())[:_MAX_PLACES]


def _places(windows: Windows, unit: str) -> Iterator[_Place]:
    record = windows.record
    edges = windows.edges
    starts = edges[:-1]
    moving = directions(record)
    speed = np.abs(record.derivatives().v)
    sliding = moving != 0
    if not np.any(sliding):
        return

    def part(mask: BoolArray) -> FloatArray:
        return np.asarray(np.add.reduceat(mask.astype(float), starts) / windows.samples)

    low = np.minimum.reduceat(record.x, starts)
    high = np.maximum.reduceat(record.x, starts)
    for a, b, words, width in _ranges(record.x[sliding], "x", unit):
        there = (high > a) & (low < b) & (part(sliding) > 0.0)
        yield _Place("position", words, there, width)
    for a, b, words, width in _ranges(speed[sliding], "|v|", f"{unit}/s"):
        there = part(sliding & (speed >= a) & (speed <= b)) > _MIN_SAMPLE_FRACTION
        yield _Place("speed", words, there, width)
    times = record.t[starts]
    for a, b, words, width in _ranges(np.append(times, record.t[-1] + record.dt), "t", "s"):
        yield _Place("time", words, (times >= a) & (times < b), width)
    turns = reversals(record)
    yield _Place("reversal", "where the motion reverses", part(turns) > 0.0)
    free = np.concatenate(([False], sliding[1:] & ~sliding[:-1])) & ~turns
    yield _Place("break-away", "where the axis breaks away", part(free) > 0.0)
    yield _Place("rest", "where the axis rests", part(~sliding) > 0.5)
    for s, name in ((1, "positive"), (-1, "negative")):
        yield _Place("direction", f"moving in {name} direction", part(moving == s) > 0.5)


def _ranges(values: FloatArray, name: str, unit: str) -> Iterator[tuple[float, float, str, int]]:
    """Every range between two quantiles of values, in words, with its width in bins.

    A range open to one side is the simplest statement: its width is 0.
    """
    edges = np.unique(np.quantile(values, np.linspace(0.0, 1.0, _BINS + 1)))
    low, high = ("before", "after") if name == "t" else ("below", "above")
    for i in range(edges.size - 1):
        for j in range(i + 1, edges.size):
            a = float(edges[i])
            b = float(edges[j])
            if i == 0:
                yield a, b, f"{low} {name} = {b:.3g} {unit}", 0
            elif j == edges.size - 1:
                yield a, b, f"{high} {name} = {a:.3g} {unit}", 0
            else:
                yield a, b, f"between {name} = {a:.3g} and {b:.3g} {unit}", j - i
