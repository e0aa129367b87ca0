"""The noise floor: what a perfect model's own errors would look like on this record."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dryfric_control.estimation.windows import Evaluation, Windows
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.records.record import Record

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

REPLAYS = 6
# A window is out of line if its score exceeds the worst of its replays by this
# much: errors some 1.7 times as large as any that chance made.
_BEYOND = 1.0
# Mean scores further apart than this many standard errors are no accident, if
# they are further apart than the estimate of the noise itself may be off.
_FAR, _LEAST = 4.0, 0.15
#: Scores this close to their replays leave nothing to look for.
NONE = 0.05


@dataclass(frozen=True, eq=False)
class Floor:
    """Scores of replays of an axis by itself, and how the record compares.

    Attributes
    ----------
    scores : ndarray, shape (nreplays, nwindows)
        Score of every window in every replay; windows not asked for hold 0.
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
        """Windows whose score no replay comes near."""
        return np.asarray(active & (scores > self.worst + _BEYOND))

    def reached(self, scores: FloatArray, active: BoolArray) -> bool:
        """Whether the scores of a record are what chance alone makes.

        Looks at the tail (single windows far beyond their replays: one in forty
        may be, a breakaway sits on the edge of a sample) and at the mean of
        the others.
        """
        out = self.outliers(scores, active)
        if out.sum() > max(1, active.sum() // 40):
            return False
        excess, spread = self.excess(scores, active & ~out)
        return bool(excess < max(_LEAST, _FAR * spread))

    def nothing(self, scores: FloatArray, active: BoolArray) -> bool:
        """Whether the scores are so close to chance that nothing can be gained."""
        out = self.outliers(scores, active)
        return not out.any() and self.excess(scores, active)[0] < NONE

    def excess(self, scores: FloatArray, active: BoolArray) -> tuple[float, float]:
        """Mean score above the replays' mean, and its standard error."""
        above = (scores - self.expected)[active]
        if above.size < 2:
            return 0.0, np.inf
        spread = float(np.std(above)) / np.sqrt(above.size)
        return float(above.mean()), max(spread, float(np.std(self.scores[:, active].mean(axis=1))))


def usual_rms(squares: Sequence[FloatArray]) -> float:
    """RMS error of a whole replay, the median of all.

    In one replay or another a breakaway comes much later, which no mean should hang on.
    `squares`: mean square errors of each record, each shape (nreplays, nwindows).
    """
    count = min(one.shape[0] for one in squares)
    if not count:
        return 0.0
    whole = np.concatenate([one[:count] for one in squares], axis=1)
    return float(np.sqrt(np.median(whole.mean(axis=1))))


def noise_floor(
    bench: Windows,
    model: FrictionAxis,
    truths: list[FrictionAxis],
    at: Evaluation,
    active: BoolArray,
    seed: int = 0,
    force: float = 0.0,
) -> Floor:
    """Replay axes through the record's own encoder and score the model on that.

    `truths` make the replays: the model within what is known of it.  `at` holds the
    start states of the model on the record.  `force`: standard deviation of a random
    force that acts in the replays, held over each sample.
    Replays that diverge are left out; all zeros if all do.
    """
    rng = np.random.default_rng(seed)
    w, record = bench, bench.record
    scores, squares = [], []
    for truth in truths:
        pushed = w
        if force > 0.0:
            u = record.u + force * rng.standard_normal(len(record))
            driven = Record(record.t, u, record.x, quantum=record.quantum, units=record.units)
            pushed = replace(w, record=driven)
        x = pushed.run(truth, dx=at.starts[0], dv=at.starts[1])
        if not np.all(np.isfinite(x)):
            continue
        readings = record.read(x, rng)
        errors = rng.standard_normal((2, len(w)))
        made = replace(
            w,
            record=readings,
            x0=w.x0 + at.starts[0] + errors[0] * w.x0_error,
            v0=w.v0 + at.starts[1] + errors[1] * w.v0_error,
        )
        found = made.evaluate(model, active, thorough=force == 0.0)
        scores.append(bench.scores(found.costs))
        squares.append(made.mean_squares(found.errors))
    none = np.zeros((1, len(w)))
    return Floor(np.array(scores or none), np.array(squares or none))
