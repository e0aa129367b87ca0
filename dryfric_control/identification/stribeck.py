"""Stick phases and stick-slip ripple of a record; Stribeck peak and stick velocity from them."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import joblib
import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import NDArray
from tqdm import tqdm

from dryfric_control.checks import instance, whole
from dryfric_control.drawing import MEASURED, legend_above, panels
from dryfric_control.estimation.force_residual import Sliding
from dryfric_control.estimation.parameters import Scales, choose, typical
from dryfric_control.estimation.problem import Problem, minimise
from dryfric_control.estimation.windows import Windows, cut
from dryfric_control.identification.fit import Fit, FitWarning, assess, fit_windows
from dryfric_control.identification.replay import LoopReplay, replay_loop
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.model.friction import CoulombMap, Stribeck
from dryfric_control.model.loops import PositionController, simulate_loop
from dryfric_control.records.motion import directions
from dryfric_control.records.record import Record
from dryfric_control.text import Result, fields_of, plain_data
from dryfric_control.ties import NEAR, above, ranked
from dryfric_control.units import check_units

FloatArray = NDArray[np.float64]

_FEWEST = 5
# Points of the regression that are replayed; ripple this close is as good as equal.
_TRIED, _CLOSE = 8, 0.05
# Fall of a fit's loss that is not worth another step: valleys differ by hundreds.
_LEAST = 0.5
# Slips of each direction that the first fit reads, from this part of their way on.
_SOME, _GONE = 8, 0.03
# Where the peak is looked for first, as parts of the slips' speed.
_SPEEDS = np.geomspace(0.01, 1.0, 21)
# Sliding samples that the regression reads.
_ENOUGH = 5000
# Shorter halts do not differ from a reading that lags.
_SHORTEST = 10
# A move shorter than this part of the long slips is part of one stick phase:
# noise, or the creep at its beginning.
_SLIP = 0.1
# Slips that a replay runs on before it starts anew.
_STRETCH = 5


@dataclass(frozen=True, eq=False)
class Sticks:
    """Stick phases that end in motion.

    Attributes
    ----------
    begin, end : ndarray of int, shape (n,)
        First sample at rest, and first sample in motion after it.
    direction : ndarray of int, shape (n,)
        Direction of that motion.
    """

    begin: NDArray[np.int64]
    end: NDArray[np.int64]
    direction: NDArray[np.int64]


@dataclass(frozen=True)
class Ripple:
    """Size of stick-slip ripple, medians over the slips.

    Attributes
    ----------
    amplitude : float
        Rise of the drive force's magnitude from its lowest to breakaway.
    period : float
        Time from one breakaway to the next [s].
    slip : float
        Way of one slip.
    count : int
        Number of slips.
    """

    amplitude: float
    period: float
    slip: float
    count: int

    def to_dict(self) -> dict[str, float]:
        """The numbers by name."""
        return fields_of(self)


@dataclass(frozen=True, eq=False, repr=False)
class StribeckIdentification(Result):
    """Stribeck peak found in a record, and how well its ripple comes back.

    Made by `identify_stribeck`.

    Attributes
    ----------
    fit : Fit
        The fit: parameters, standard errors, what is not determined.
    measured : Ripple or None
        Ripple of the record.
    replayed : Ripple or None
        Ripple of the model in the same loop, where the controller is known.
    loop : LoopReplay or None
        That replay.
    branches : tuple of Record
        The same in stretches of some slips, each from the rest before its first: a replay of
        the whole record falls out of step with it.
    """

    fit: Fit
    measured: Ripple | None
    replayed: Ripple | None
    loop: LoopReplay | None
    branches: tuple[Record, ...] = ()

    @property
    def axis(self) -> FrictionAxis:
        """The axis with its Stribeck peak and stick velocity."""
        return self.fit.axis

    @property
    def stribeck(self) -> Stribeck:
        """The peak found."""
        assert self.axis.stribeck is not None
        return self.axis.stribeck

    def _shown(self) -> Iterator[str | list[tuple[str, ...]]]:
        yield from self.fit._shown()
        length, force = self.axis.units
        for name, one in (("measured", self.measured), ("replayed", self.replayed)):
            if one is not None:
                yield (
                    f"ripple {name}: amplitude {one.amplitude:.4g} {force}, period "
                    f"{one.period:.4g} s, slip {one.slip:.4g} {length}, {one.count} slips"
                )

    def to_dict(self) -> dict[str, Any]:
        """Numbers of the result, ready for JSON."""
        return {name: plain_data(getattr(self, name)) for name in ("fit", "measured", "replayed")}

    @panels(2, sharex=False, figsize=(7.0, 6.0))
    def plot(self, axes: Any) -> str:
        """Draw drive force over position, measured and replayed (paper, Fig. 6)."""
        length, force = self.axis.units
        record = self.fit.training[0].windows.record
        some = slice(None, None, max(1, len(record) // 20_000))
        axes[0].plot(record.x[some], record.u[some], ".", color=MEASURED, ms=2, label="measured")
        axes[1].plot(record.t[some], record.u[some], ".", color=MEASURED, ms=2)
        for i, one in enumerate(self.branches):
            name = f"model, restarted every {_STRETCH} slips" if i == 0 else None
            axes[0].plot(one.x[some], one.u[some], "k-", lw=0.8, label=name)
            axes[1].plot(one.t[some], one.u[some], "k-", lw=0.8)
        places = np.linspace(float(record.x.min()), float(record.x.max()), 200)
        for s in (1, -1):
            axes[0].plot(
                places, s * self.axis.coulomb(places, s), "--", color="C2", lw=1,
                label="Coulomb level" if s == 1 else None,
            )  # fmt: skip
            axes[0].plot(
                places, s * self.axis.breakaway(places, s), ":", color="C3", lw=1,
                label="breakaway friction force" if s == 1 else None,
            )  # fmt: skip
        axes[0].set_xlabel(f"position [{length}]")
        axes[1].set_xlabel("Time [s]")
        for one in axes:
            one.set_ylabel(f"drive force [{force}]")
        legend_above(axes[0])
        if self.measured is not None:
            # A dozen periods: the whole record would hide the ripple.
            middle = float(record.t[len(record) // 4])
            reach = 6.0 * self.measured.period
            shown = (record.t > middle - reach) & (record.t < middle + reach)
            axes[1].set_xlim(record.t[shown][0], record.t[shown][-1])
            low, high = record.u[shown].min(), record.u[shown].max()
            axes[1].set_ylim(low - 0.2 * (high - low), high + 0.2 * (high - low))
        return f"{self.axis.name}: stick-slip"


def stick_phases(record: Record) -> Sticks:
    """Stick phases of a record, found from the readings."""
    moving = directions(record)
    rest = np.flatnonzero(np.diff((moving == 0).astype(np.int8), prepend=0, append=0))
    begin, end = rest[::2], rest[1::2]
    keep = (end - begin >= _SHORTEST) & (end < len(record))
    begin, end = begin[keep], end[keep]
    if end.size > 1:
        ways = np.abs(record.x[begin[1:]] - record.x[end[:-1]])
        real = ~above(_SLIP * np.quantile(ways, 0.9), ways, NEAR * record.range)
        begin, end = begin[np.r_[True, real]], end[np.r_[real, True]]
    return Sticks(begin, end, moving[end].astype(np.int64))


def ripple(record: Record) -> Ripple | None:
    """Amplitude and period of a record's stick-slip ripple.

    Returns
    -------
    Ripple or None
        None if fewer than three slips follow each other in one direction.

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> from dryfric_control.identification import ripple, slow_ramp_experiment
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0, travel=(0.0, 0.1),
    ...                         stribeck=dfc.Stribeck(excess=0.3, speed=0.01))
    >>> ripple(slow_ramp_experiment(axis, duration=20.0, quantum=1e-6).record).count > 3
    True
    """
    sticks = stick_phases(record)
    rows = []
    for i in range(sticks.end.size - 1):
        a, b = int(sticks.end[i]), int(sticks.end[i + 1])
        after = int(sticks.end[i + 2]) if i + 2 < sticks.end.size else len(record)
        if sticks.direction[i] != sticks.direction[i + 1]:
            continue
        # From trough to trough: noise may show a breakaway too early.
        force = sticks.direction[i] * record.u
        trough = a + int(force[a:b].argmin())
        following = b + int(force[b:after].argmin())
        slip = abs(record.x[sticks.begin[i + 1]] - record.x[a])
        rows.append((force[trough:following].max() - force[trough], (b - a) * record.dt, slip))
    if len(rows) < 3:
        return None
    amplitude, period, slip = np.median(rows, axis=0)
    return Ripple(float(amplitude), float(period), float(slip), len(rows))


def identify_stribeck(
    axis: FrictionAxis,
    record: Record,
    controller: PositionController | None = None,
    *,
    free: Sequence[str] = ("stribeck", "stick_speed", "coulomb_map"),
    starts: int = 2,
    jobs: int = 1,
    progress: bool = False,
) -> StribeckIdentification:
    """Stick velocity, excess and Stribeck velocity from stick-slip.

    Parameters
    ----------
    axis : FrictionAxis
        The axis with its Coulomb levels, see `identify_coulomb`.
    record : Record
        A crawl in which the axis sticks and slips.
    controller : PositionController, optional
        The loop that ran, to replay the ripple with the model.
    free : sequence of str, optional
        What to fit, see `fit`.  The Coulomb levels are fitted again by
        default: a crawl inside the peak has raised them.
    starts : int, optional
        Number of starting points, the most promising of a coarse search.
    jobs : int, optional
        Number of starts that run at the same time.
    progress : bool, optional
        Whether to show a progress bar.

    Returns
    -------
    StribeckIdentification

    Raises
    ------
    ValueError
        If the record holds fewer than five stick phases.

    Notes
    -----
    Free runs as in `fit`, but each window starts in the middle of a stick
    phase and ends in the next: it holds one breakaway, which shows the
    excess, and one slip, which shows over what velocity the excess decays.

    Their cost has several minima.  So the forces of sliding and of breakaway
    are regressed first, over a grid of vs, and refined by free runs of slips
    alone; the fit starts from the peak whose ripple comes closest, and where it
    ends with a worse one, that peak is kept.

    A stick velocity far below `vs` acts only through v - Sigma and is
    poorly determined; see ``fit.messages`` for what the record does not determine.

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> from dryfric_control.identification import slow_ramp_experiment
    >>> true = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0, travel=(0.0, 0.1),
    ...                         stribeck=dfc.Stribeck(excess=0.3, speed=0.01))
    >>> ramp = slow_ramp_experiment(true, duration=20.0, quantum=1e-6)
    >>> found = dfc.identify_stribeck(true.replace(stribeck=None), ramp.record, starts=2)
    >>> round(found.stribeck.excess, 2), round(found.stribeck.speed, 3)
    (0.3, 0.01)
    """
    instance("axis", axis, FrictionAxis)
    instance("record", record, Record)
    check_units(axis, record)
    if not isinstance(free, Sequence):
        raise ValueError(f"free must hold names such as 'mass', got {free!r}")
    if controller is not None:
        instance("controller", controller, PositionController)
    whole("starts", starts)
    whole("jobs", jobs)
    sticks = stick_phases(record)
    if sticks.end.size < _FEWEST:
        raise ValueError(
            f"record holds {sticks.end.size} stick phases that end in motion, at least {_FEWEST} "
            "are needed: crawl slower, or with a softer loop"
        )
    middles = (sticks.begin + sticks.end) // 2
    inner = middles[(middles >= 5) & (middles <= len(record) - 5)]
    edges = np.unique([0, *inner, len(record)])
    windows = cut(record, edges=edges)

    def miss(one: FrictionAxis) -> tuple[float, float]:
        """How far the ripple of an axis is off, where that is equal its free runs."""
        squares = windows.mean_squares(windows.run(one) - record.x)
        floor = sum(part**2 for part in record.resolution)
        cost = float(np.mean(np.log(squares + floor)))
        if controller is None or measured is None:
            return 0.0, cost
        own = _replayed(replay_loop(one, record, controller))
        if own is None:
            return np.inf, cost
        off = np.log([own.amplitude / measured.amplitude, own.period / measured.period])
        return max(float(np.max(np.abs(off))), _CLOSE), cost

    def closest(axes: list[FrictionAxis]) -> list[FrictionAxis]:
        """The same, the closest first; those that tie in the order given."""
        misses = [miss(one) for one in axes]
        order = ranked([cost for _, cost in misses])
        again = ranked([misses[i][0] for i in order])
        return [axes[order[i]] for i in again]

    measured = ripple(record)
    coarse = _coarse(axis, record, sticks, free)[:_TRIED]
    points = closest(coarse)
    points += _refined(
        points[:starts], _slips(record, sticks), typical([record]), free, jobs, progress
    )
    best = closest(points)[0]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FitWarning)
        # Which run comes closest may depend on one breakaway: where there may be more
        # than one start, the forces count too.
        ends = [
            fit_windows(p, [windows], free, starts=1, least=_LEAST)
            for p in dict.fromkeys((best, coarse[0])[:starts])
        ]
        nearest = closest([end.axis for end in ends])[0]
        found = next(end for end in ends if end.axis is nearest)
        if closest([found.axis, best])[0] is best:
            found = assess(best, [windows], free)  # the search went to a wrong valley
    for message in found.messages:
        warnings.warn(message, FitWarning, stacklevel=2)
    loop = replayed = None
    branches: tuple[Record, ...] = ()
    if controller is not None:
        loop = replay_loop(found.axis, record, controller)
        replayed = _replayed(loop)
        branches = _branches(found.axis, record, controller, sticks)
    return StribeckIdentification(found, measured, replayed, loop, branches)


def _branches(
    axis: FrictionAxis, record: Record, controller: PositionController, sticks: Sticks
) -> tuple[Record, ...]:
    """Replays of stretches of some slips one way, each from the rest before its first."""
    turns = np.flatnonzero(np.diff(sticks.direction, prepend=0) != 0)
    since = np.arange(sticks.begin.size)
    since -= np.maximum.accumulate(np.where(np.isin(since, turns), since, 0))
    first = np.flatnonzero(since % _STRETCH == 0)
    ends = np.append(sticks.begin[first[1:]], len(record))
    found = []
    for a, b in zip(sticks.begin[first], ends, strict=True):
        part = record[a:b]
        r = np.asarray(part.reference)
        start = {"quantum": record.quantum or 0.0, "x0": float(part.x[0])}
        # What the controller has summed up before is a constant force.
        push = part.u[0] - simulate_loop(axis, controller, r, **start).y[4][0]
        run = simulate_loop(axis, controller, r, disturbance=np.full(r.size, push), **start)
        found.append(part.replace(u=run.y[4] + push, x=run.y[0]))
    return tuple(found)


def _replayed(loop: LoopReplay) -> Ripple | None:
    y, record = loop.response.y, loop.record
    if np.ptp(y[5]) == 0.0:  # held by its friction all along
        return None
    return ripple(Record(record.t, y[4], y[5], record.reference, quantum=record.quantum or 0.0))


def _coarse(
    axis: FrictionAxis, record: Record, sticks: Sticks, free: Sequence[str]
) -> list[FrictionAxis]:
    """Peaks that explain the forces, the best first, each in a valley of its own.

    Force of sliding samples: Fc(x) + sigma Fc0(x) g(v), of breakaway:
    Fc(x) + sigma Fc0(x), with the levels given as Fc0: for each vs a linear
    regression for the coefficients of Fc and for sigma.
    """
    slide = Sliding(record, _ENOUGH)
    bare = axis.replace(coulomb=0.0, viscous=0.0, stribeck=None)
    friction = -slide.force_residual(bare) - axis.viscous * slide.v
    at = _break_aways(record, sticks)
    sides = np.concatenate([slide.direction, sticks.direction])
    places = np.concatenate([slide.x, record.x[at]])
    force = sides * np.concatenate([friction, record.u[at]])
    level = np.where(sides > 0, axis.coulomb(places, 1), axis.coulomb(places, -1))
    speed = np.concatenate([np.abs(slide.v), np.zeros(at.size)])
    weight = np.ones(sides.size)
    weight[slide.t.size :] = np.sqrt(max(slide.t.size, 1) / at.size)
    fastest = float(np.quantile(speed[: slide.t.size], 0.9)) if slide.t.size else axis.stick_speed
    levels_free = any(name.startswith("coulomb") for name in free)
    bases = _bases(axis, places, sides) if levels_free else np.empty((sides.size, 0))
    found = [] if axis.stribeck is None else [(-1.0, axis)]
    for vs in _SPEEDS * fastest:
        # The nominal stick velocity, and where the paper starts: at vs.
        for stick in {axis.stick_speed, vs if "stick_speed" in free else axis.stick_speed}:
            g = np.exp(-((np.maximum(speed - stick, 0.0) / vs) ** 2))
            rows = np.column_stack([bases, level * g])
            coefficients, cost = _regression(rows, force if levels_free else force - level, weight)
            try:
                one = axis.replace(
                    coulomb=_map(axis, coefficients[:-1]) if levels_free else axis.coulomb,
                    stribeck=Stribeck(float(np.clip(coefficients[-1], 0.02, 3.0)), float(vs)),
                    stick_speed=float(stick),
                )
            except ValueError:  # a map that turns negative
                continue
            found.append((cost, one))
    chosen: list[FrictionAxis] = []
    for i in ranked([cost for cost, _ in found], NEAR * float(np.abs(force).max())):
        one = found[i][1]
        if all(_apart(one, other) for other in chosen):
            chosen.append(one)
    return chosen or [axis.replace(stribeck=Stribeck(0.2, 0.3 * fastest))]


def _bases(axis: FrictionAxis, x: FloatArray, sides: NDArray[np.int64]) -> FloatArray:
    """Powers of position of each direction, as many as its level has."""
    low, high = axis.travel or (0.0, 1.0)
    z = (x - low) / (high - low)
    plus = np.vander(z, len(axis.coulomb.plus), increasing=True) * (sides > 0)[:, None]
    minus = np.vander(z, len(axis.coulomb.minus), increasing=True) * (sides < 0)[:, None]
    return np.column_stack([plus, minus])


def _map(axis: FrictionAxis, coefficients: FloatArray) -> CoulombMap:
    """Levels from coefficients of the columns of `_bases`."""
    domain = axis.travel or (0.0, 1.0)
    plus, minus = (
        np.resize(Polynomial(c, domain=domain, window=(0.0, 1.0)).convert().coef, c.size)
        for c in np.split(coefficients, [len(axis.coulomb.plus)])
    )
    return CoulombMap(tuple(plus.tolist()), tuple(minus.tolist()))


def _break_aways(record: Record, sticks: Sticks) -> NDArray[np.int64]:
    """Last samples of the stick phases at which the reading has not moved yet."""
    least = max(2.0 * (record.quantum or 0.0), 6.0 * record.noise)
    after = np.append(sticks.begin[1:], len(record))
    found = []
    for a, b, c, s in zip(sticks.begin, sticks.end, after, sticks.direction, strict=True):
        middle = (a + b) // 2
        rest = float(np.median(record.x[middle:b]))
        gone = ~above(least, s * (record.x[middle:c] - rest), NEAR * record.range)
        found.append(middle + int(np.argmax(gone)) - 1 if gone.any() else b)
    return np.array(found)


def _regression(rows: FloatArray, y: FloatArray, weight: FloatArray) -> tuple[FloatArray, float]:
    """Coefficients by Huber's loss, and the mean absolute error."""
    root = weight
    for _ in range(10):
        scaled = rows * root[:, None]
        found = np.linalg.lstsq(scaled.T @ scaled, scaled.T @ (y * root), rcond=None)[0]
        error = np.abs(y - rows @ found)
        limit = 1.5 * 1.4826 * float(np.median(error))
        root = weight * np.sqrt(np.minimum(1.0, limit / np.maximum(error, 1e-300)))
    return np.asarray(found), float(np.average(error, weights=weight**2))


def _apart(a: FrictionAxis, b: FrictionAxis) -> bool:
    """Whether two peaks differ enough to lie in different valleys."""
    assert a.stribeck is not None and b.stribeck is not None
    ratio = abs(np.log(a.stribeck.speed / b.stribeck.speed))
    return bool(ratio > np.log(2.0) or abs(np.log(a.stick_speed / b.stick_speed)) > np.log(2.0))


def _slips(record: Record, sticks: Sticks) -> list[Windows]:
    """Some slips of each direction, from just after breakaway to the next rest.

    Without the breakaway itself the free runs depend smoothly on the peak.
    """
    at = _break_aways(record, sticks)
    spans = []
    for s in (1, -1):
        own = np.flatnonzero(sticks.direction[:-1] == s)
        for i in own[:: max(1, own.size // _SOME)][:_SOME]:
            end = int(sticks.begin[i + 1])
            way = s * (record.x[at[i] : end] - record.x[at[i]])
            start = int(at[i]) + int(np.argmax(above(way, _GONE * way[-1], NEAR * record.range)))
            if way[-1] > 0.0 and end - start >= 20:
                spans.append((start, end))
    if not spans:
        return []
    edges = np.unique([0, *np.ravel(spans), len(record)])
    whole = cut(record, edges=edges)
    parts = []
    for start, end in spans:
        pick = slice(i := int(np.searchsorted(edges, start)), i + 1)
        piece = record[start:end]
        one = cut(piece, 5.0 * record.dt, edges=np.array([0, len(piece)]))
        parts.append(
            replace(
                one,
                x0=whole.x0[pick],
                v0=whole.v0[pick],
                x0_error=whole.x0_error[pick],
                v0_error=whole.v0_error[pick],
                rest=np.zeros(1),
            )
        )
    return parts


def _refined(
    points: Sequence[FrictionAxis],
    parts: Sequence[Windows],
    scales: Scales,
    free: Sequence[str],
    jobs: int,
    progress: bool,
) -> list[FrictionAxis]:
    """Some axes after a fit of peak and levels to some slips."""
    names = [name for name in free if name.startswith(("stribeck", "coulomb"))]
    if not names or not parts:
        return []
    # Slips that are cut out never stick: a stick velocity would only hold them up.
    slow = 1e-4 * scales.length / scales.time

    def search(point: FrictionAxis) -> FrictionAxis:
        axis, parameters = choose(point.replace(stick_speed=slow), names, scales)
        problem = Problem(axis, parameters, parts)
        found = problem.axis_at(minimise(problem, problem.start, _LEAST))
        return found.replace(stick_speed=point.stick_speed)

    run = joblib.Parallel(n_jobs=jobs, backend="threading", return_as="generator")
    return list(
        tqdm(
            run(joblib.delayed(search)(point) for point in points),
            total=len(points),
            desc="identify_stribeck",
            unit="start",
            disable=not progress,
        )
    )
