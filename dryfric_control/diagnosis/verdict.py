"""What a model explains and what it leaves: free runs against replays, or imposed motion."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dryfric_control.diagnosis.evidence import where
from dryfric_control.diagnosis.noise_floor import Floor, far_above, noise_floor, usual_rms
from dryfric_control.diagnosis.problem import Problem
from dryfric_control.diagnosis.report.findings import Gain, Unexplained
from dryfric_control.diagnosis.thresholds import (
    REPLAYED,
    REPLAYS,
    SMOOTH,
    WORSE,
)  # fmt: skip
from dryfric_control.estimation.solution import Solution
from dryfric_control.estimation.uncertainty import ratio_interval
from dryfric_control.estimation.windows import Evaluation, Windows, linked

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


class Judged(NamedTuple):
    """What a fit explains and leaves.

    Attributes
    ----------
    gain : Gain
        Errors on data that the parameters were not fitted to.
    left : Unexplained
    worse : bool
        Whether the errors exceed those of the nominal axis.
    muted : bool
        Whether the random force is too large, beside the friction, for anything to be explained.
    """

    gain: Gain
    left: Unexplained
    worse: bool
    muted: bool

    @property
    def explained(self) -> bool:
        """Whether what is left is noise."""
        return not (self.left.significant or self.worse or self.muted)


def judged(problem: Problem, windows: Sequence[Windows], final: Solution) -> Judged:
    """Measure what a fit explains and what it leaves."""
    found = _imposed(problem, final) if problem.imposed else _motion(problem, windows, final)
    return found._replace(muted=problem.muted(final))


def shows(problem: Problem, final: Solution) -> bool:
    """Whether the random force of a fit moves free runs by more than the noise of the readings.

    White force of standard deviation F moves them by F/m sqrt(dt T^3/3); a fitted start state
    leaves about a tenth of it.
    """
    for i, w in enumerate(problem.windows):
        dt, length = w.record.dt, w.record.duration / max(len(w), 1)
        moved = final.random_force(i) / final.axis.mass * math.sqrt(dt * length**3 / 3.0)
        if 0.1 * moved > w.floor:
            return True
    return problem.imposed or not problem.windows


def _motion(problem: Problem, windows: Sequence[Windows], final: Solution) -> Judged:
    """Errors of free runs, compared with replays in which the random force acts.

    For the gain, each window is predicted with parameters fitted without its half of the
    record; structure is what the fit itself leaves beyond its replays.
    """
    squares: list[list[FloatArray]] = [[], [], []]
    replays: list[FloatArray] = []
    structured, places = False, list[str]()
    drawn = final.drawn(REPLAYS)
    for i, w in enumerate(windows):
        active = np.zeros(len(w), bool)
        moving = np.flatnonzero(w.moving)
        if linked(final.axis):
            moving = moving[moving > 0]  # an inner state is unknown where the record starts
        if not moving.size:
            continue
        if moving.size > REPLAYED:
            moving = moving[np.linspace(0, moving.size - 1, REPLAYED).astype(int)]
        active[moving] = True
        axes, half = final.unseen(i)
        half = half[w.edges[:-1]]
        before = w.evaluate(problem.believed, active)
        unseen = _merged(w, [w.evaluate(a, active & (half == k)) for k, a in enumerate(axes)], half)
        axis = final.problem.axis_at(final.z, i)
        at = w.evaluate(axis, active)
        for row, one in zip(squares, (before, unseen, at), strict=True):
            row.append(w.mean_squares(one.errors)[active])
        floor: Floor = noise_floor(w, axis, drawn[i], at, active, force=final.random_force(i))
        replays.append(floor.squares[:, active])
        scores = w.scores(at.costs)
        if not floor.reached(scores, active):
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
    left = Unexplained(gain.left if structured else 0.0, structured, tuple(places[:3]))
    nominal, there, noise = (math.sqrt(float(np.median(row))) for row in rows)
    # A single window with a mistimed breakaway may give the RMS its size.
    worse = there > max(WORSE * nominal, noise) or (
        gain.after > gain.floor and gain.interval[1] < 1.0 / WORSE
    )
    return Judged(gain, left, worse, False)


def _but_the_worst(
    found: Sequence[FloatArray], replays: Sequence[FloatArray]
) -> tuple[list[FloatArray], list[FloatArray]]:
    """Errors of all windows but one, as one breakaway may be mistimed by a sample."""
    pairs = zip(found, replays, strict=True)
    worst = [float((one / rows.max(axis=0)).max()) for one, rows in pairs]
    i = int(np.argmax(worst))
    k = int(np.argmax(found[i] / replays[i].max(axis=0)))
    return (
        [np.delete(one, k) if j == i else one for j, one in enumerate(found)],
        [np.delete(rows, k, axis=1) if j == i else rows for j, rows in enumerate(replays)],
    )


def _merged(w: Windows, parts: Sequence[Evaluation], half: NDArray[np.int64]) -> Evaluation:
    """Evaluations of two halves as one."""
    by_sample, (one, two) = np.repeat(half, w.samples) == 1, parts
    return Evaluation(
        np.where(by_sample, two.errors, one.errors),
        np.where(half == 1, two.starts, one.starts),
        np.where(half == 1, two.costs, one.costs),
    )


def _imposed(problem: Problem, final: Solution) -> Judged:
    """Counterpart of `_motion` for an imposed motion: required force less drive.

    The floor is the part of it that changes from sample to sample.
    """
    nominal = problem.nominal_fit
    blocks: list[list[float]] = [[], [], []]
    for run, before, after in zip(
        final.problem.runs, nominal.point.out, final.point.out, strict=True
    ):
        noise = np.diff(after[0], prepend=after[0, :1]) / math.sqrt(2.0)
        together = run.active & np.roll(run.active, 1)
        for row, one, there in zip(
            blocks, (before[0], after[0], noise), (run.active, run.active, together), strict=True
        ):
            for a, b in itertools.pairwise(run.edges):
                if run.active[a:b].any():
                    row.append(float(np.sum(one[a:b] ** 2 * there[a:b]) / run.active[a:b].sum()))
    gain = _gain([np.array(row) for row in blocks], problem.believed.units[1])
    structured = gain.after > SMOOTH * gain.floor
    left = Unexplained(gain.left if structured else 0.0, structured, ())
    return Judged(gain, left, gain.interval[1] < 1.0 / WORSE, False)


def _gain(squares: Sequence[FloatArray], unit: str) -> Gain:
    """Error reduction from mean squares before, after and of the floor, shape (nblocks,)."""
    before, after, _ = squares
    low, high = ratio_interval(before, np.maximum(after, 1e-300))
    first, last, floor = (float(np.sqrt(row.mean())) for row in squares)
    return Gain(first, last, floor, (low, high), unit)
