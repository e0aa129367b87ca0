"""What a model explains and what it leaves: free runs against replays, or imposed motion."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from dryfric_control.arrays import Floats
from dryfric_control.diagnosis.evidence import where
from dryfric_control.diagnosis.noise_floor import far_above, noise_floor, usual_rms
from dryfric_control.diagnosis.problem import Problem
from dryfric_control.diagnosis.report.findings import Gain, Unexplained
from dryfric_control.diagnosis.thresholds import REPLAYED, REPLAYS, SMOOTH, WORSE
from dryfric_control.estimation.solution import Solution
from dryfric_control.estimation.uncertainty import ratio_interval
from dryfric_control.estimation.windows import Windows, linked


class Judged(NamedTuple):
    """What a fit explains and leaves."""

    gain: Gain  # errors on data that the parameters were not fitted to
    left: Unexplained
    worse: bool  # whether the errors exceed those of the nominal axis
    muted: bool = False  # whether the random force is too large for anything to be explained

    @property
    def explained(self) -> bool:
        """Whether what is left is noise."""
        return not (self.left.significant or self.worse or self.muted)


def judged(problem: Problem, windows: Sequence[Windows], final: Solution) -> Judged:
    """Measure what a fit explains and what it leaves."""
    found = _imposed(problem, final) if problem.imposed else _motion(problem, windows, final)
    return found._replace(muted=problem.muted(final))


def shows(problem: Problem, final: Solution) -> bool:
    """Whether the random force of a fit moves free runs by more than the noise of the readings."""
    # White force F moves them by F/m sqrt(dt T^3/3); a fitted start state leaves about a tenth.
    for i, w in enumerate(problem.windows):
        dt, length = w.record.dt, w.record.duration / max(len(w), 1)
        moved = final.random_force(i) / final.axis.mass * math.sqrt(dt * length**3 / 3.0)
        if 0.1 * moved > w.floor:
            return True
    return problem.imposed or not problem.windows


def _motion(problem: Problem, windows: Sequence[Windows], final: Solution) -> Judged:
    """Errors of free runs, compared with replays in which the random force acts."""
    squares: list[list[Floats]] = [[], [], []]
    replays: list[Floats] = []
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
        # The gain is of parameters fitted without the half of the record that a window is in.
        before = w.evaluate(problem.believed, active)
        unseen = w.unseen(*final.unseen(i), active)
        axis = final.problem.axis_at(final.z, i)
        at = w.evaluate(axis, active)
        for row, one in zip(squares, (before, unseen, at), strict=True):
            row.append(w.mean_squares(one.errors)[active])
        floor = noise_floor(w, axis, drawn[i], at, active, force=final.random_force(i))
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
    return Judged(gain, left, worse)


def _but_the_worst(
    found: Sequence[Floats], replays: Sequence[Floats]
) -> tuple[list[Floats], list[Floats]]:
    """Errors of all windows but one, as one breakaway may be mistimed by a sample."""
    over = [one / rows.max(axis=0) for one, rows in zip(found, replays, strict=True)]
    i = int(np.argmax([one.max() for one in over]))
    k, errors, others = int(np.argmax(over[i])), list(found), list(replays)
    errors[i], others[i] = np.delete(errors[i], k), np.delete(others[i], k, axis=1)
    return errors, others


def _imposed(problem: Problem, final: Solution) -> Judged:
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
                if run.active[a:b].any():
                    row.append(float(np.sum(one[a:b] ** 2 * there[a:b]) / run.active[a:b].sum()))
    gain = _gain([np.array(row) for row in blocks], problem.believed.units[1])
    structured = gain.after > SMOOTH * gain.floor
    left = Unexplained(gain.left if structured else 0.0, structured, ())
    return Judged(gain, left, gain.interval[1] < 1.0 / WORSE)


def _gain(squares: Sequence[Floats], unit: str) -> Gain:
    """Error reduction from mean squares before, after and of the floor, shape (nblocks,)."""
    before, after, _ = squares
    low, high = ratio_interval(before, np.maximum(after, 1e-300))
    first, last, floor = (float(np.sqrt(row.mean())) for row in squares)
    return Gain(first, last, floor, (low, high), unit)
