"""Stick phases and stick-slip ripple of a record; Stribeck peak and stick velocity from them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dryfric_control.arrays import Ints
from dryfric_control.checks import instance, whole
from dryfric_control.drawing import MEASURED, TIME_LABEL, label_axes, panels
from dryfric_control.estimation.likelihood import Run
from dryfric_control.estimation.parameters import choose, typical, values_of
from dryfric_control.identification.fit import WINDOW, Fit, maximise_likelihood, problem_of
from dryfric_control.identification.replay import LoopReplay, replay_loop
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.model.friction import Stribeck
from dryfric_control.model.loops import PositionController, simulate_loop
from dryfric_control.records.motion import directions
from dryfric_control.records.read import RecordLike, as_record
from dryfric_control.records.record import Record
from dryfric_control.text import Result, fields_of, plain_data
from dryfric_control.ties import NEAR, exceeds
from dryfric_control.units import check_units

# Where the search starts.
# Excess of the breakaway force over the Coulomb level, relative.
_EXCESS = 0.2
# Quantile of the speed that counts as a high velocity.
_FAST = 0.98
# Stribeck velocities over the high velocity.
_SPEEDS = (0.3, 0.03, 0.003)
# Stick velocities over the Stribeck velocity.
_STICK = (1.0, 0.01)
# Fewest stick phases.
_FEWEST = 5
# Shortest stick phase [samples]: a shorter one does not differ from a reading that lags.
_SHORTEST = 10
# Least move between two stick phases over the long slips: a shorter one is noise, or the creep at
# the beginning of a phase.
_SLIP = 0.1
# Breakaways in which the peak is looked for.
_SEARCHED = 10
# Slips that a replay runs on before it starts anew.
_STRETCH = 5


@dataclass(frozen=True, eq=False)
class Sticks:
    """Stick phases that end in motion, shape (n,)."""

    begin: Ints  # first sample at rest
    end: Ints  # first sample in motion after it
    direction: Ints  # of that motion


@dataclass(frozen=True)
class Ripple:
    """Size of stick-slip ripple, medians over the slips."""

    amplitude: float  # rise of the drive force's magnitude from its lowest to breakaway
    period: float  # time from one breakaway to the next [s]
    slip: float  # way of one slip
    count: int  # number of slips

    def to_dict(self) -> dict[str, float]:
        """The numbers by name."""
        return fields_of(self)


@dataclass(frozen=True, eq=False, repr=False)
class StribeckIdentification(Result):
    """Stribeck peak found in a record, and how well its ripple comes back.

    Made by `identify_stribeck`.
    """

    fit: Fit  # parameters, standard errors, what is not determined
    measured: Ripple | None  # of the record
    replayed: Ripple | None  # of the model in the same loop, where the controller is known
    loop: LoopReplay | None  # that replay
    # The same in stretches of some slips, each from the rest before its first: a replay of the
    # whole record falls out of step with it.
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

    def _summary_parts(self) -> Iterator[str | list[tuple[str, ...]]]:
        yield from self.fit._summary_parts()
        length, force = self.axis.units
        for name, one in (("measured", self.measured), ("replayed", self.replayed)):
            if one is not None:
                size = f"amplitude {one.amplitude:.4g} {force}, period {one.period:.4g} s"
                yield f"ripple {name}: {size}, slip {one.slip:.4g} {length}, {one.count} slips"

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
        for s, level, most in ((1, "Coulomb level", "breakaway friction force"), (-1, None, None)):
            low, high = s * self.axis.coulomb(places, s), s * self.axis.breakaway(places, s)
            axes[0].plot(places, low, "--", color="C2", lw=1, label=level)
            axes[0].plot(places, high, ":", color="C3", lw=1, label=most)
        label_axes(axes[0], f"position [{length}]", f"drive force [{force}]")
        label_axes(axes[1], TIME_LABEL, f"drive force [{force}]", legend=False)
        if self.measured is not None:
            # A dozen periods: the whole record would hide the ripple.
            middle = float(record.t[len(record) // 4])
            reach = 6.0 * self.measured.period
            shown = (record.t > middle - reach) & (record.t < middle + reach)
            axes[1].set_xlim(record.t[shown][0], record.t[shown][-1])
            weak, strong = float(record.u[shown].min()), float(record.u[shown].max())
            room = 0.2 * (strong - weak)
            axes[1].set_ylim(weak - room, strong + room)
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
        real = ~exceeds(_SLIP * np.quantile(ways, 0.9), ways, NEAR * record.range)
        begin, end = begin[np.r_[True, real]], end[np.r_[real, True]]
    return Sticks(begin, end, moving[end].astype(np.int64))


def ripple(record: Record) -> Ripple | None:
    """Amplitude and period of a record's stick-slip ripple; None with fewer than three slips."""
    sticks = stick_phases(record)
    rows = []
    for i in range(sticks.end.size - 1):
        a, b = int(sticks.end[i]), int(sticks.end[i + 1])
        after = int(sticks.end[i + 2]) if i + 2 < sticks.end.size else len(record)
        if sticks.direction[i] != sticks.direction[i + 1]:
            continue
        # From trough to trough: noise may show a breakaway too early.
        force = sticks.direction[i] * record.net_input
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
    record: RecordLike,
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
    record : Record or path-like
        A crawl in which the axis sticks and slips.
    controller : PositionController, optional
        The loop that ran, to replay the ripple with the model.
    free : sequence of str, optional
        What to fit, see `fit`; by default the Coulomb levels too, raised by a crawl in the peak.
    starts : int, optional
        Number of the most likely ends of the first search from which it goes on.
    jobs : int, optional
        Number of starts that run at the same time.
    progress : bool, optional
        Whether to show a progress bar.

    Raises
    ------
    ValueError
        If the record holds fewer than five stick phases.

    Notes
    -----
    The likelihood of `fit` has several maxima here: each breakaway shows the excess, each slip
    over what velocity it decays.  So the search starts from peaks of three widths, each with a
    stick velocity as large and a hundredth of it.  Besides, with the levels held, it follows the
    likeliest peak down to a random force that moves nothing, where only the right one breaks away
    on time, and fits all together from there.  It goes on from the likeliest ends.

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> true = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0, travel=(0.0, 0.1),
    ...                         stribeck=dfc.Stribeck(excess=0.3, speed=0.01))
    >>> ramp = dfc.slow_ramp_experiment(true, duration=20.0, quantum=1e-6)
    >>> found = dfc.identify_stribeck(true.replace(stribeck=None), ramp.record, starts=2)
    >>> round(found.stribeck.excess, 2), round(found.stribeck.speed, 3)
    (0.3, 0.01)
    """
    instance("axis", axis, FrictionAxis)
    record = as_record(record)
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
    axis, guesses = _starting_axes(axis, record, free)
    problem = problem_of(axis, [record], free)
    points = [
        np.array([p.search(v) for p, v in zip(problem.parameters, values, strict=True)])
        for values in (values_of(one, problem.names) for one in guesses)
    ]
    found = maximise_likelihood(
        problem, points, WINDOW, jobs, progress, "identify_stribeck", starts,
        [_around_breakaways(problem.runs[0], sticks)],
    )  # fmt: skip
    if controller is None:
        return StribeckIdentification(found, ripple(record), None, None)
    loop = replay_loop(found.axis, record, controller)
    x, u, quantum = loop.response.y[5], loop.response.y[4], record.quantum or 0.0
    replayed = None  # where friction holds the axis all along
    if np.ptp(x) > 0.0:
        replayed = ripple(Record(record.t, u, x, record.reference, quantum=quantum))
    branches = _branches(found.axis, record, controller, sticks)
    return StribeckIdentification(found, ripple(record), replayed, loop, branches)


def _around_breakaways(run: Run, sticks: Sticks) -> Run:
    """A record on the stretch of `_SEARCHED` breakaways in its middle, whole if it has few more."""
    first = (sticks.end.size - _SEARCHED) // 2
    if first < 1:
        return run
    return run.on_stretch(int(sticks.begin[first]), int(sticks.begin[first + _SEARCHED]))


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


def _starting_axes(
    axis: FrictionAxis, record: Record, free: Sequence[str]
) -> tuple[FrictionAxis, list[FrictionAxis]]:
    """The axis with a peak, in the middle of what is searched, and axes to start from."""
    fast = float(np.quantile(np.abs(record.derivatives().v), _FAST))
    peak = axis.stribeck or Stribeck(_EXCESS, _SPEEDS[1] * fast)
    names = [p.name for p in choose(axis.replace(stribeck=peak), free, typical([record]))[1]]
    found = [] if axis.stribeck is None else [axis]
    for ratio in _STICK if "stick_speed" in names else _STICK[:1]:
        for part in _SPEEDS if "stribeck.speed" in names else _SPEEDS[:1]:
            one = Stribeck(
                _EXCESS if "stribeck.excess" in names else peak.excess,
                part * fast if "stribeck.speed" in names else peak.speed,
            )
            stick = ratio * one.speed if "stick_speed" in names else axis.stick_speed
            found.append(axis.replace(stribeck=one, stick_speed=stick))
    middle = found[-1 - len(_SPEEDS) // 2] if len(found) > len(_SPEEDS) else found[0]
    return axis.replace(stribeck=middle.stribeck, stick_speed=middle.stick_speed), found
