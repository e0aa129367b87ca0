"""What a fit explains and leaves: free runs against replays, or forces of an imposed motion."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dryfric_control.diagnosis.evidence import where
from dryfric_control.diagnosis.likelihood_search import Search
from dryfric_control.diagnosis.noise_floor import Floor, far_above, noise_floor, usual_rms
from dryfric_control.diagnosis.report.findings import Gain, Unexplained
from dryfric_control.estimation.solution import Solution
from dryfric_control.estimation.windows import Windows

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

# Windows of each record that are replayed, and number of replays: enough that a window in which
# the axis breaks away only sometimes does so in some replay.
_REPLAYED, _REPLAYS = 40, 20
# Free-run error, over that of the nominal axis, beyond which no cause is shown.
_WORSE = 1.1
# Fraction of the windows that may have larger errors than all their replays, and excess of the
# mean score over that of the replays that is still no structure.
_STRAY, _EXCESS = 0.1, 0.2
# Ratio of the RMS of the force residual to that of its sample-to-sample changes beyond which it
# has structure.
_SMOOTH = 1.5


def judge(search: Search) -> Callable[..., tuple[Gain, Unexplained, bool]]:
    """The function that measures what a fit explains and what it leaves."""
    return _needed if search.imposed else _motion


def _motion(
    search: Search, windows: Sequence[Windows], final: Solution
) -> tuple[Gain, Unexplained, bool]:
    """Errors of free runs, compared with replays in which the random force acts.

    Returned last: whether, by median or RMS, the errors exceed both those of the nominal
    axis and those that the random force causes.
    """
    squares: list[list[FloatArray]] = [[], []]
    replays: list[FloatArray] = []
    structured, places = False, list[str]()
    drawn = final.drawn(_REPLAYS)
    for i, w in enumerate(windows):
        axis = final.problem.axis_at(final.z, i)
        active = np.zeros(len(w), bool)
        moving = np.flatnonzero(w.moving)
        if moving.size > _REPLAYED:
            moving = moving[np.linspace(0, moving.size - 1, _REPLAYED).astype(int)]
        active[moving] = True
        if not moving.size:
            continue
        before = w.evaluate(search.believed, active)
        at = w.evaluate(axis, active)
        floor: Floor = noise_floor(w, axis, drawn[i], at, active, force=final.random_force(i))
        for row, one in zip(squares, (before, at), strict=True):
            row.append(w.mean_squares(one.errors)[active])
        replays.append(floor.squares[:, active])
        scores = w.scores(at.costs)
        if not _as_replayed(floor, scores, active):
            structured = True
            here = where(
                np.where(active, scores, np.nan), float(floor.worst[active].max()), w,
                search.believed.units,
            )  # fmt: skip
            which = f" in record {i + 1}" if len(windows) > 1 else ""
            places += [f"{t}{which}" for t in here]
    usual = [one.mean(axis=0) for one in replays]
    rows = [np.concatenate(r) if r else np.ones(1) for r in (*squares, usual)]
    gain = _gain(rows, search.believed.units[0])
    if replays:
        gain = replace(gain, floor=usual_rms(replays))
        structured = structured or far_above(squares[1], replays)
    left_over = Unexplained(gain.left if structured else 0.0, structured, tuple(places[:3]))
    medians = [math.sqrt(float(np.median(row))) for row in rows]
    nominal, there, noise = medians
    # A single window with a mistimed breakaway may give the RMS its size.
    worse = there > max(_WORSE * nominal, noise) or (
        gain.after > gain.floor and gain.interval[1] < 1.0 / _WORSE
    )
    return gain, left_over, worse


def _needed(
    search: Search, windows: Sequence[Windows], final: Solution
) -> tuple[Gain, Unexplained, bool]:
    """Counterpart of `_motion` for an imposed motion: required force less drive.

    The floor is the part of it that changes from sample to sample.
    """
    nominal = search.reference(search.believed)
    blocks: list[list[float]] = [[], [], []]
    for run, before, after in zip(
        final.problem.runs, nominal.point.out, final.point.out, strict=True
    ):
        noise = np.diff(after[0], prepend=after[0, :1]) / math.sqrt(2.0)
        together = run.active & np.roll(run.active, 1)
        for row, one, where_ in zip(
            blocks, (before[0], after[0], noise), (run.active, run.active, together), strict=True
        ):
            for a, b in itertools.pairwise(run.edges):
                if run.active[a:b].any():
                    row.append(float(np.sum(one[a:b] ** 2 * where_[a:b]) / run.active[a:b].sum()))
    gain = _gain([np.array(row) for row in blocks], search.believed.units[1])
    structured = gain.after > _SMOOTH * gain.floor
    return gain, Unexplained(gain.left if structured else 0.0, structured, ()), False


def _gain(squares: Sequence[FloatArray], unit: str) -> Gain:
    """Error reduction from mean squares before, after and of the floor, shape (nblocks,)."""
    before, after, _ = squares
    picks = np.random.default_rng(0).integers(0, before.size, size=(1000, before.size))
    ratios = np.sqrt(before[picks].sum(axis=1) / np.maximum(after[picks].sum(axis=1), 1e-300))
    low, high = np.quantile(ratios, [0.05, 0.95])
    first, last, floor = (float(np.sqrt(row.mean())) for row in squares)
    return Gain(first, last, floor, (float(low), float(high)), unit)


def _as_replayed(floor: Floor, scores: FloatArray, active: BoolArray) -> bool:
    """Whether the errors of free runs are those of replays with the random force."""
    out = floor.outliers(scores, active)
    if out.sum() > max(2, _STRAY * active.sum()):
        return False
    excess, spread = floor.excess(scores, active & ~out)
    return bool(excess < max(_EXCESS, 4.0 * spread))
