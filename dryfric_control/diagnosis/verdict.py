"""What a model explains and what it leaves: free runs against replays, or imposed motion."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from dryfric_control.arrays import Bools, Floats
from dryfric_control.diagnosis.evidence import where
from dryfric_control.diagnosis.problem import Problem
from dryfric_control.diagnosis.report.findings import Gain, Unexplained
from dryfric_control.diagnosis.thresholds import (
    MAX_ERROR_RATIO,
    MAX_EXCESS_SCORE,
    MAX_OUTLIER_FRACTION,
    MAX_REPLAYED_WINDOWS,
    MAX_WHITE_RESIDUAL_RATIO,
    NEGLIGIBLE_RATIO,
    REPLAY_COUNT,
)
from dryfric_control.estimation.input_noise import before_rounding
from dryfric_control.estimation.solution import Solution
from dryfric_control.estimation.uncertainty import ratio_interval
from dryfric_control.estimation.windows import Evaluation, Windows, passes_inner_states
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.records.record import Record
from dryfric_control.records.resolution import QUANTA

# A window is an outlier if its score exceeds the worst of its replays by this much: errors
# about 1.7 times as large as any that noise caused.
_OUTLIER_MARGIN = 1.0
# Random force, over that of an input's rounding, below which the rounding does not act.
_MIN_FORCE_TO_ROUNDING = 0.5
# RMS error over that of a usual replay from which something is left to find.
_MAX_RMS_RATIO = 4.0
# Standard errors from the smoothed readings beyond which a start state is no estimate.
_MAX_START_ERRORS = 5.0


@dataclass(frozen=True, eq=False)
class Floor:
    """Scores of a model on replays of itself, shape (nreplays, nwindows), and mean square errors.

    Scores are 0 in windows that were not evaluated.
    """

    scores: Floats
    squares: Floats

    @property
    def expected(self) -> Floats:
        """Mean score of each window, shape (nwindows,)."""
        return np.asarray(self.scores.mean(axis=0))

    @property
    def worst(self) -> Floats:
        """Largest score of each window, shape (nwindows,)."""
        return np.asarray(self.scores.max(axis=0))

    def outliers(self, scores: Floats, active: Bools) -> Bools:
        """Windows whose score clearly exceeds that of every replay."""
        return np.asarray(active & (scores > self.worst + _OUTLIER_MARGIN))

    def is_noise(self, scores: Floats, active: Bools) -> bool:
        """Whether scores of a record are consistent with noise, in their tail and their mean."""
        # Some windows may be outliers, as a breakaway may lie at the edge of a sample.
        out = self.outliers(scores, active)
        if out.sum() > max(2, MAX_OUTLIER_FRACTION * active.sum()):
            return False
        excess, spread = self.excess(scores, active & ~out)
        return bool(excess < max(MAX_EXCESS_SCORE, 4.0 * spread))

    def excess(self, scores: Floats, active: Bools) -> tuple[float, float]:
        """Mean score above the replays' mean, and its standard error."""
        above = (scores - self.expected)[active]
        if above.size < 2:
            return 0.0, np.inf
        spread = float(np.std(above)) / np.sqrt(above.size)
        of_replays = float(np.std(self.scores[:, active].mean(axis=1)))
        return float(above.mean()), max(spread, of_replays)


def usual_rms(squares: Sequence[Floats]) -> float:
    """Median RMS error of whole replays, from mean squares of each record (nreplays, nwindows)."""
    # In some replays a breakaway comes much later, which would dominate a mean.
    count = min(one.shape[0] for one in squares)
    if not count:
        return 0.0
    whole = np.concatenate([one[:count] for one in squares], axis=1)
    return float(np.sqrt(np.median(whole.mean(axis=1))))


def far_above(found: Sequence[Floats], squares: Sequence[Floats]) -> bool:
    """Whether mean square errors of each record are far above those of replays.

    A few windows may err beyond all of them, but not several times the usual RMS error.
    """
    beyond = math.exp(_OUTLIER_MARGIN)
    above = [
        np.maximum(one - beyond * replays.max(axis=0, initial=0.0), 0.0)
        for one, replays in zip(found, squares, strict=True)
    ]
    return bool(np.sqrt(np.concatenate(above).mean()) > _MAX_RMS_RATIO * usual_rms(squares))


def noise_floor(
    w: Windows,
    model: FrictionAxis,
    truths: list[FrictionAxis],
    at: Evaluation,
    active: Bools,
    seed: int = 0,
    force: float = 0.0,
    velocity: float = 0.0,
) -> Floor:
    """Replay axes through the record's own encoder and score the model on the replays.

    `truths`: the model within the uncertainty of its parameters; `at`: its start states on the
    record; `force`: random force that acts in the replays; `velocity`: noise of the velocities of
    which the positions are the integral.  Those that diverge are left out.
    """
    rng = np.random.default_rng(seed)
    record = w.record
    thorough = force == 0.0
    step = record.input_quantum  # an input that was recorded in steps acted in between them
    # A random force far below the rounding tells that the drive acts in these steps.
    if 0.0 < force < _MIN_FORCE_TO_ROUNDING * step / QUANTA:
        step = 0.0
    force = math.sqrt(max(force**2 - (step / QUANTA) ** 2, 0.0))
    acted = before_rounding(record.u, step, np.random.default_rng(seed + 1))
    # A run that is lost may start where no reading allows it; the machine did not.
    far = np.hypot(at.starts[0] / w.x0_error, at.starts[1] / w.v0_error) > _MAX_START_ERRORS
    begun = np.where(far, 0.0, at.starts[:2])
    scores = []
    squares = []
    for truth in truths:
        pushed = w
        if step > 0.0 or force > 0.0:
            u = next(acted) + force * rng.standard_normal(len(record))
            driven = Record(
                record.t,
                u,
                record.x,
                quantum=record.quantum,
                units=record.units,
                load=record.known_load,
            )
            pushed = replace(w, record=driven)
        drift = np.zeros(len(record))
        if velocity > 0.0:
            # Their integral departs from the places where forces act.
            noise = velocity * record.dt * rng.standard_normal(len(record))
            drift = np.cumsum(noise) - 0.5 * noise
            drift -= drift.mean()
        x = pushed.run(truth, dx=begun[0] - drift[w.edges[:-1]], dv=begun[1])
        if not np.all(np.isfinite(x)):
            continue
        readings = record.read(x + drift, rng)
        errors = rng.standard_normal((2, len(w)))
        x0 = w.x0 + begun[0] + errors[0] * w.x0_error
        v0 = w.v0 + begun[1] + errors[1] * w.v0_error
        made = replace(w, record=readings, x0=x0, v0=v0)
        found = made.evaluate(model, active, thorough=thorough)
        scores.append(w.scores(found.costs))
        squares.append(made.mean_squares(found.errors))
    none = np.zeros((1, len(w)))
    return Floor(np.array(scores or none), np.array(squares or none))


class Judged(NamedTuple):
    """What a fit explains and leaves."""

    gain: Gain  # errors on data that the parameters were not fitted to
    left: Unexplained
    worse: bool  # whether the errors exceed those of the nominal axis
    muted: bool = False  # whether the random force is too large for anything to be explained

    @property
    def is_noise(self) -> bool:
        """Whether what is left is noise."""
        return not (self.left.significant or self.worse or self.muted)


def judge_fit(problem: Problem, windows: Sequence[Windows], final: Solution) -> Judged:
    """Measure what a fit explains and what it leaves."""
    found = (
        _judge_imposed(problem, final) if problem.is_imposed else _motion(problem, windows, final)
    )
    return found._replace(muted=problem.is_muted(final))


def shows(problem: Problem, final: Solution) -> bool:
    """Whether the random force of a fit moves free runs by more than the noise of the readings."""
    # White force F moves them by F/m sqrt(dt T^3/3); a fitted start state leaves about a tenth.
    for i, w in enumerate(problem.windows):
        dt = w.record.dt
        length = w.record.duration / max(len(w), 1)
        moved = final.random_force(i) / final.axis.mass * math.sqrt(dt * length**3 / 3.0)
        if 0.1 * moved > w.floor:
            return True
    return problem.is_imposed or not problem.windows


def _motion(problem: Problem, windows: Sequence[Windows], final: Solution) -> Judged:
    """Errors of free runs, compared with replays in which the random force acts."""
    squares: list[list[Floats]] = [[], [], []]
    replays: list[Floats] = []
    structured = False
    places = list[str]()
    drawn = final.draw_axes(REPLAY_COUNT)
    for i, w in enumerate(windows):
        active = _judged_windows(w, passes_inner_states(final.axis))
        if not active.any():
            continue
        # The gain is of parameters fitted without the half of the record that a window is in.
        before = w.evaluate(problem.believed, active)
        unseen = w.cross_validate(*final.held_out_axes(i), active)
        axis = final.problem.axis_at(final.z, i)
        at = w.evaluate(axis, active)
        for row, one in zip(squares, (before, unseen, at), strict=True):
            row.append(w.mean_squares(one.errors)[active])
        velocity = final.reading_noise(i) if w.record.integrated else 0.0
        floor = noise_floor(
            w, axis, drawn[i], at, active, force=final.random_force(i), velocity=velocity
        )
        replays.append(floor.squares[:, active])
        scores = w.scores(at.costs)
        if not floor.is_noise(scores, active):
            structured = True
            most = float(floor.worst[active].max())
            here = where(np.where(active, scores, np.nan), most, w, problem.believed.units)
            which = f" in record {i + 1}" if len(windows) > 1 else ""
            places += [f"{t}{which}" for t in here]
    usual = [one.mean(axis=0) for one in replays]
    rows = [np.concatenate(r) if r else np.ones(1) for r in (*squares[:2], usual)]
    gain = _gain(rows, problem.believed.units[0])
    if replays:
        gain = replace(gain, floor=usual_rms(replays))
        structured = structured or far_above(*_but_the_worst(squares[2], replays))
    # Beside which no law of friction is right.
    structured = structured and gain.after > NEGLIGIBLE_RATIO * gain.before
    left = Unexplained(gain.left if structured else 0.0, structured, tuple(places[:3]))
    return Judged(gain, left, _is_worse(rows, gain))


def _judged_windows(w: Windows, inner: bool) -> Bools:
    """Windows with motion that are judged; `inner`: whether they pass on inner states."""
    active = np.zeros(len(w), bool)
    moving = np.flatnonzero(w.moving)
    if inner:
        moving = moving[moving > 0]  # an inner state is unknown where the record starts
    if moving.size > MAX_REPLAYED_WINDOWS:
        moving = moving[np.linspace(0, moving.size - 1, MAX_REPLAYED_WINDOWS).astype(int)]
    active[moving] = True
    return active


def _is_worse(rows: Sequence[Floats], gain: Gain) -> bool:
    """Whether free runs err more than at nominal; `rows`: squares of nominal, found, noise."""
    nominal, there, noise = (math.sqrt(float(np.median(row))) for row in rows)
    # A single window with a mistimed breakaway may give the RMS its size, so the median counts,
    # unless a cause that acts in few windows lowers the RMS for certain.  Errors that grow for
    # certain are no noise, however large the model says that it is.
    usually_worse = there > max(MAX_ERROR_RATIO * nominal, noise)
    surely_better = gain.interval[0] > MAX_ERROR_RATIO
    return (usually_worse and not surely_better) or gain.interval[1] < 1.0 / MAX_ERROR_RATIO


def _but_the_worst(
    found: Sequence[Floats], replays: Sequence[Floats]
) -> tuple[list[Floats], list[Floats]]:
    """Errors of all windows but one, as one breakaway may be mistimed by a sample."""
    over = [one / rows.max(axis=0) for one, rows in zip(found, replays, strict=True)]
    i = int(np.argmax([one.max() for one in over]))
    k = int(np.argmax(over[i]))
    errors = list(found)
    others = list(replays)
    errors[i] = np.delete(errors[i], k)
    others[i] = np.delete(others[i], k, axis=1)
    return errors, others


def _judge_imposed(problem: Problem, final: Solution) -> Judged:
    """Counterpart of `_motion` for an imposed motion: required force less drive."""
    outs = problem.nominal_fit.point.out, final.point.out
    blocks: list[list[float]] = [[], [], []]
    for run, before, after in zip(final.problem.runs, *outs, strict=True):
        # The floor is the part that changes from sample to sample.
        noise = np.diff(after[0], prepend=after[0, :1]) / math.sqrt(2.0)
        together = run.active & np.roll(run.active, 1)
        kinds = (before[0], run.active), (after[0], run.active), (noise, together)
        for row, (one, there) in zip(blocks, kinds, strict=True):
            for a, b in itertools.pairwise(run.edges):
                if not run.active[a:b].any():
                    continue
                squares = np.sum(one[a:b] ** 2 * there[a:b])
                row.append(float(squares / run.active[a:b].sum()))
    gain = _gain([np.array(row) for row in blocks], problem.believed.units[1])
    structured = gain.after > MAX_WHITE_RESIDUAL_RATIO * gain.floor
    left = Unexplained(gain.left if structured else 0.0, structured, ())
    return Judged(gain, left, gain.interval[1] < 1.0 / MAX_ERROR_RATIO)


def _gain(squares: Sequence[Floats], unit: str) -> Gain:
    """Error reduction from mean squares before, after and of the floor, shape (nblocks,)."""
    before, after, _ = squares
    low, high = ratio_interval(before, np.maximum(after, 1e-300))
    first, last, floor = (float(np.sqrt(row.mean())) for row in squares)
    return Gain(first, last, floor, (low, high), unit)
