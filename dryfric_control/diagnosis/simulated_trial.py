"""Simulated experiments, and the distance of two hypotheses in them."""

from __future__ import annotations

import itertools
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dryfric_control.arrays import Bools, Floats
from dryfric_control.compiled.axis_step import TooManySwitchesError
from dryfric_control.compiled.windowed_runs import Windowed
from dryfric_control.diagnosis.candidates import BASE, own_names
from dryfric_control.diagnosis.excitations import Excitation, Limits, Stage
from dryfric_control.estimation.likelihood import Likelihood, prepare
from dryfric_control.estimation.parameters import Parameter, values_of
from dryfric_control.estimation.windows import cut, positions
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.model.loops import PositionController, simulate_loop
from dryfric_control.records.motion import last_index_so_far
from dryfric_control.records.record import Record
from dryfric_control.ties import NEAR, exceeds, samples

# Length of the free runs [s].
_WINDOW_LENGTH = 0.25
# Least number of samples of a free run.
_MIN_WINDOW_SAMPLES = 20
# Closed-loop bandwidth times the sampling time [rad].
_BANDWIDTH_TIMES_STEP = 0.03
# Largest closed-loop bandwidth [rad/s].
_MAX_BANDWIDTH = 30.0
# Fractions of an excitation's size that are tried until it keeps the limits.
_SIZES = (1.0, 0.7, 0.5, 0.35, 0.2, 0.1)
# Number of windows of the known record that constrain a refit.
_KNOWN_WINDOWS = 16
# Difference step of a search coordinate (of order 1).
_DIFFERENCE_STEP = 1e-4
# Largest step of a search coordinate in an iteration of the refit.
_MAX_STEP = 0.5
# A refit may weaken an effect to this fraction of its strength, or strengthen it as much:
# beyond, it is no longer the same rival. Its position may change freely.
_MIN_STRENGTH_RATIO = 0.7
# Number of scales of the errors, from the first error down to the quantum.
_SCALE_COUNT = 4
# Iterations at each scale.
_ITERATIONS_PER_SCALE = 2
# Fractions of a step that are tried until one lowers the loss.
_STEP_FRACTIONS = (1.0, 0.4, 0.1)
# Ridge of the normal matrix, over the mean of its diagonal.
_RIDGE = 1e-9


@dataclass(frozen=True, eq=False)
class Runs:
    """Free runs over windows of one length, from given states, and what they are held against."""

    windowed: Windowed
    active: Bools  # windows that are used
    truth: Floats  # positions there, shape (nactive, length)

    def positions(self, axis: FrictionAxis) -> Floats:
        """Positions of the active windows, shape (nactive, length)."""
        out = positions(axis, self.windowed, self.active)
        return out.reshape(self.active.size, -1)[self.active]

    def errors(self, axis: FrictionAxis) -> Floats:
        """Position errors of an axis, without a line that another start state could explain."""
        errors = self.positions(axis) - self.truth
        time = np.linspace(-1.0, 1.0, errors.shape[1])
        q, _ = np.linalg.qr(np.vander(time, 2))
        return np.asarray(errors - (errors @ q) @ q.T)


def _cut_windows(
    u: Floats, dt: float, length: int, x0: Floats, v0: Floats, rest: Floats
) -> Windowed:
    """Windows of `length` samples each, from known states."""
    edges = length * np.arange(x0.size + 1)
    sure = np.zeros(x0.size)
    u = u.view()
    u.setflags(write=False)  # as a record's: free runs are compiled for each type of array
    return Windowed(u, u, 0.0, dt, False, edges, x0, v0, sure, sure, rest)


def mean_squares(errors: Floats) -> Floats:
    """Mean square of each window."""
    return np.asarray(np.mean(errors**2, axis=1))


@dataclass(frozen=True, eq=False)
class Trial(Runs):
    """One excitation, simulated with one hypothesis, from whose states its windows start."""

    x: Floats
    v: Floats
    u: Floats  # drive force as commanded

    def keeps_limits(self, limits: Limits) -> bool:
        """Whether travel and speed keep the limits."""
        low, high = limits.travel
        inside = low <= self.x.min() and self.x.max() <= high
        return bool(inside and np.abs(self.v).max() <= limits.speed)


def simulate(
    axis: FrictionAxis, loop: PositionController, reference: Floats, force: Floats, quantum: float
) -> Trial:
    """Simulate an experiment on an axis, and cut it into windows."""
    with warnings.catch_warnings():
        # The caller rejects a trial that exceeds its limits.
        warnings.filterwarnings("ignore", "the loop diverges", RuntimeWarning)
        begin = float(reference[0])
        run = simulate_loop(axis, loop, reference, quantum, x0=begin, disturbance=force)
    x = run.y[0].copy()
    v = run.y[1].copy()
    mode = run.y[3]
    u = run.y[4] + force
    dt = loop.dt
    length = max(
        min(samples(_WINDOW_LENGTH, dt), x.size // 4), min(_MIN_WINDOW_SAMPLES, x.size // 4)
    )
    count = x.size // length
    starts = length * np.arange(count)
    rest = (dt * (np.arange(x.size) - last_index_so_far(mode != 0.0, -1) - 1))[starts] * (
        mode[starts] == 0.0
    )
    windowed = _cut_windows(u, dt, length, x[starts], v[starts], rest)
    truth = x[: count * length].reshape(count, length)
    return Trial(windowed, np.ones(count, bool), truth, x, v, u)


@dataclass(frozen=True, eq=False)
class Staged:
    """An excitation scaled to the limits, simulated with every hypothesis."""

    excitation: Excitation
    stage: Stage
    reference: Floats
    force: Floats
    axes: tuple[FrictionAxis, ...]  # the hypotheses, with the change of the bench, if any
    trials: tuple[Trial, ...]  # one for each


def largest_trial(
    excitation: Excitation, stage: Stage, axes: Sequence[FrictionAxis], quantum: float, dt: float
) -> Staged | None:
    """An excitation at the largest size that keeps the limits with every hypothesis, if any."""
    limits, changed = stage.limits, tuple(excitation.bench_axis(stage, axis) for axis in axes)
    bandwidth = min(_BANDWIDTH_TIMES_STEP / dt, _MAX_BANDWIDTH)
    gains = PositionController.from_bandwidth(stage.axis, bandwidth, dt, limits.drive)
    for size in _SIZES:
        reference, force = excitation.signals_at(stage, size)
        left = limits.drive - float(np.abs(force).max())
        if left <= 0.0:
            continue
        loop = replace(gains, limit=left)
        made = (simulate(axis, loop, reference, force, quantum) for axis in changed)
        try:
            trials = tuple(itertools.takewhile(lambda trial: trial.keeps_limits(limits), made))
        except TooManySwitchesError:
            continue  # the loop runs away with a hypothesis
        if len(trials) == len(changed):
            return Staged(excitation, stage, reference, force, changed, trials)
    return None


@dataclass(frozen=True, eq=False)
class Refit:
    """Refit of a hypothesis, constrained by the known record."""

    problem: Likelihood  # the hypothesis with its parameters free
    known: Runs  # windows of the known record, held against the prediction before the refit
    quantum: float

    @classmethod
    def from_axis(cls, axis: FrictionAxis, record: Record, quantum: float) -> Refit:
        """Refit of the base and all effects of an axis, with some windows of a record."""
        names = [n for n in BASE.values() if values_of(axis, [n])[0] > 0.0]
        names += [n for effect in axis.named_effects() for n in own_names(effect)]
        windows = cut(record, min(_WINDOW_LENGTH, max(record.duration / 8.0, 5.5 * record.dt)))
        length = int(windows.samples[0])
        last = int(windows.samples[-1])
        count = len(windows) - (last < length)
        starts = windows.edges[:count]
        reach = np.maximum.reduceat(record.x, starts) - np.minimum.reduceat(record.x, starts)
        moving = np.flatnonzero(exceeds(reach, 4.0 * quantum, NEAR * record.range))
        active = np.zeros(count, bool)
        if moving.size:
            active[moving[np.linspace(0, moving.size - 1, _KNOWN_WINDOWS).astype(int)]] = True
        states = (one[:count] for one in (windows.x0, windows.v0, windows.rest))
        windowed = _cut_windows(record.u, record.dt, length, *states)
        known = Runs(windowed._replace(known=record.known_force), active, np.empty(0))
        problem = Likelihood(axis, names, [prepare(record)])
        return cls(problem, replace(known, truth=known.positions(axis)), quantum)

    def refit_errors(self, staged: Staged, trial: Trial) -> Floats:
        """Mean square errors of a trial's windows after the best refit, shape (nwindows,).

        Gauss-Newton on the mean of log(1 + square/scale^2) over the windows of the trial plus the
        same over changes in the known record; the scale falls from the first error to the quantum.
        """
        problem = self.problem
        first = problem.start()[: len(problem.names)]
        reach = np.array([_freedom(p, c) for p, c in zip(problem.parameters, first, strict=True)])

        def errors(z: Floats) -> tuple[Floats, ...] | None:
            try:
                axis = problem.axis_at(z)
                new = trial.errors(staged.excitation.bench_axis(staged.stage, axis))
            except ValueError:
                return None
            return (new, self.known.errors(axis)) if self.known.truth.size else (new,)

        def loss(parts: tuple[Floats, ...], scale: float) -> float:
            return float(sum(np.mean(np.log1p(mean_squares(e) / scale**2)) for e in parts))

        def flat(parts: Sequence[Floats]) -> Floats:
            return np.concatenate([e.ravel() for e in parts])

        z, e = first, errors(first)
        if e is None:
            return mean_squares(trial.errors(staged.axes[0]))
        least = loss(e, self.quantum)
        found = mean_squares(e[0])
        widest = max(float(np.sqrt(found.mean())), self.quantum)
        for scale in np.repeat(
            np.geomspace(widest, self.quantum, _SCALE_COUNT), _ITERATIONS_PER_SCALE
        ).tolist():
            now = flat(e)
            j = np.zeros((z.size, now.size))
            for i, step in enumerate(_DIFFERENCE_STEP * np.eye(z.size)):
                for way in (step, -step):
                    moved = errors(z + way)
                    if moved is not None:
                        j[i] = (flat(moved) - now) / way[i]
                        break
            parts = ((len(part) * (scale**2 + mean_squares(part)), part.shape[1]) for part in e)
            weight = np.concatenate([np.repeat(1.0 / size, n) for size, n in parts])
            normal = (j * weight) @ j.T
            normal += _RIDGE * (np.trace(normal) / z.size + 1e-300) * np.eye(z.size)
            step = -np.linalg.solve(normal, (j * weight) @ now)
            step *= min(1.0, _MAX_STEP / max(float(np.abs(step).max()), 1e-300))
            here = loss(e, scale)
            for part in _STEP_FRACTIONS:
                target = np.clip(z + part * step, first - reach, first + reach)
                there = errors(target)
                if there is not None and loss(there, scale) < here:
                    z, e = target, there
                    break
            if loss(e, self.quantum) < least:
                least = loss(e, self.quantum)
                found = mean_squares(e[0])
        return found


def _freedom(parameter: Parameter, search: float) -> float:
    """How far a search coordinate may move in a refit."""
    if "." not in parameter.name or parameter.kind in ("place", "angle"):
        return np.inf
    value = parameter.value(search)
    return (1.0 - _MIN_STRENGTH_RATIO) * abs(value - parameter.neutral) / parameter.slope(value)
