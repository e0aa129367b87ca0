"""The noise floor: errors that a perfect model would have on this record."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dryfric_control.diagnosis.thresholds import EXCESS, STRAY
from dryfric_control.estimation.input_noise import before_rounding
from dryfric_control.estimation.windows import Evaluation, Windows
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.records.record import Record
from dryfric_control.records.resolution import QUANTA

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

# A window is an outlier if its score exceeds the worst of its replays by this much: errors
# about 1.7 times as large as any that noise caused.
_BEYOND = 1.0
# Random force, over that of an input's rounding, below which the rounding does not act.
_ACTS = 0.5
# RMS error over that of a usual replay from which something is left to find.
_SEVERAL = 4.0
# Standard errors from the smoothed readings beyond which a start state is no estimate.
_LOST = 5.0


@dataclass(frozen=True, eq=False)
class Floor:
    """Scores of a model on replays of itself, for comparison with those on the record.

    Attributes
    ----------
    scores : ndarray, shape (nreplays, nwindows)
        Score of every window in every replay; 0 in windows not evaluated.
    squares : ndarray, shape (nreplays, nwindows)
        Mean square error of every window.
    """

    scores: FloatArray
    squares: FloatArray

    @property
    def expected(self) -> FloatArray:
        """Mean score of each window, shape (nwindows,)."""
        return np.asarray(self.scores.mean(axis=0))

    @property
    def worst(self) -> FloatArray:
        """Largest score of each window, shape (nwindows,)."""
        return np.asarray(self.scores.max(axis=0))

    def outliers(self, scores: FloatArray, active: BoolArray) -> BoolArray:
        """Windows whose score clearly exceeds that of every replay."""
        return np.asarray(active & (scores > self.worst + _BEYOND))

    def reached(self, scores: FloatArray, active: BoolArray) -> bool:
        """Whether the scores of a record are consistent with noise alone.

        Tests the tail (some windows may be outliers, as a breakaway may lie at the edge of a
        sample) and the mean of the other windows.
        """
        out = self.outliers(scores, active)
        if out.sum() > max(2, STRAY * active.sum()):
            return False
        excess, spread = self.excess(scores, active & ~out)
        return bool(excess < max(EXCESS, 4.0 * spread))

    def excess(self, scores: FloatArray, active: BoolArray) -> tuple[float, float]:
        """Mean score above the replays' mean, and its standard error."""
        above = (scores - self.expected)[active]
        if above.size < 2:
            return 0.0, np.inf
        spread = float(np.std(above)) / np.sqrt(above.size)
        return float(above.mean()), max(spread, float(np.std(self.scores[:, active].mean(axis=1))))


def usual_rms(squares: Sequence[FloatArray]) -> float:
    """RMS error of a whole replay, the median over all replays.

    In some replays a breakaway comes much later, which would dominate a mean.
    `squares`: mean square errors of each record, each shape (nreplays, nwindows).
    """
    count = min(one.shape[0] for one in squares)
    if not count:
        return 0.0
    whole = np.concatenate([one[:count] for one in squares], axis=1)
    return float(np.sqrt(np.median(whole.mean(axis=1))))


def far_above(found: Sequence[FloatArray], squares: Sequence[FloatArray]) -> bool:
    """Whether errors are orders of magnitude above those of replays.

    A few windows may err beyond all their replays, but not such that the RMS error is
    several times the usual one.  `found`: mean square errors of each record, each shape
    (nwindows,); `squares`: those of replays, as in `usual_rms`.
    """
    beyond = math.exp(_BEYOND)
    above = [
        np.maximum(one - beyond * replays.max(axis=0, initial=0.0), 0.0)
        for one, replays in zip(found, squares, strict=True)
    ]
    return bool(np.sqrt(np.concatenate(above).mean()) > _SEVERAL * usual_rms(squares))


def noise_floor(
    bench: Windows,
    model: FrictionAxis,
    truths: list[FrictionAxis],
    at: Evaluation,
    active: BoolArray,
    seed: int = 0,
    force: float = 0.0,
) -> Floor:
    """Replay axes through the record's own encoder and score the model on the replays.

    `truths` are simulated: the model within the uncertainty of its parameters.  `at` holds
    the start states of the model on the record.  `force`: standard deviation of a random
    force that acts in the replays, held over each sample.  An input that was recorded in
    steps acted in between them.
    Replays that diverge are left out; all zeros if all do.
    """
    rng = np.random.default_rng(seed)
    w, record, thorough = bench, bench.record, force == 0.0
    step = record.input_quantum
    # A random force far below the rounding tells that the drive acts in these steps.
    if 0.0 < force < _ACTS * step / QUANTA:
        step = 0.0
    force = math.sqrt(max(force**2 - (step / QUANTA) ** 2, 0.0))
    acted = before_rounding(record.u, step, np.random.default_rng(seed + 1))
    # A run that is lost may start where no reading allows it; the machine did not.
    far = np.hypot(at.starts[0] / w.x0_error, at.starts[1] / w.v0_error) > _LOST
    begun = np.where(far, 0.0, at.starts[:2])
    scores, squares = [], []
    for truth in truths:
        pushed = w
        if step > 0.0 or force > 0.0:
            u = next(acted) + force * rng.standard_normal(len(record))
            driven = Record(record.t, u, record.x, quantum=record.quantum, units=record.units)
            pushed = replace(w, record=driven)
        x = pushed.run(truth, dx=begun[0], dv=begun[1])
        if not np.all(np.isfinite(x)):
            continue
        readings = record.read(x, rng)
        errors = rng.standard_normal((2, len(w)))
        made = replace(
            w,
            record=readings,
            x0=w.x0 + begun[0] + errors[0] * w.x0_error,
            v0=w.v0 + begun[1] + errors[1] * w.v0_error,
        )
        found = made.evaluate(model, active, thorough=thorough)
        scores.append(bench.scores(found.costs))
        squares.append(made.mean_squares(found.errors))
    none = np.zeros((1, len(w)))
    return Floor(np.array(scores or none), np.array(squares or none))
