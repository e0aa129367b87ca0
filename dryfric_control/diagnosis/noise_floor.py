"""The noise floor: errors that a perfect model would have on this record."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dryfric_control.arrays import Bools, Floats
from dryfric_control.diagnosis.thresholds import EXCESS, STRAY
from dryfric_control.estimation.input_noise import before_rounding
from dryfric_control.estimation.windows import Evaluation, Windows
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.records.record import Record
from dryfric_control.records.resolution import QUANTA

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
        return np.asarray(active & (scores > self.worst + _BEYOND))

    def reached(self, scores: Floats, active: Bools) -> bool:
        """Whether scores of a record are consistent with noise, in their tail and their mean."""
        # Some windows may be outliers, as a breakaway may lie at the edge of a sample.
        out = self.outliers(scores, active)
        if out.sum() > max(2, STRAY * active.sum()):
            return False
        excess, spread = self.excess(scores, active & ~out)
        return bool(excess < max(EXCESS, 4.0 * spread))

    def excess(self, scores: Floats, active: Bools) -> tuple[float, float]:
        """Mean score above the replays' mean, and its standard error."""
        above = (scores - self.expected)[active]
        if above.size < 2:
            return 0.0, np.inf
        spread = float(np.std(above)) / np.sqrt(above.size)
        return float(above.mean()), max(spread, float(np.std(self.scores[:, active].mean(axis=1))))


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
    beyond = math.exp(_BEYOND)
    above = [
        np.maximum(one - beyond * replays.max(axis=0, initial=0.0), 0.0)
        for one, replays in zip(found, squares, strict=True)
    ]
    return bool(np.sqrt(np.concatenate(above).mean()) > _SEVERAL * usual_rms(squares))


def noise_floor(
    w: Windows,
    model: FrictionAxis,
    truths: list[FrictionAxis],
    at: Evaluation,
    active: Bools,
    seed: int = 0,
    force: float = 0.0,
) -> Floor:
    """Replay axes through the record's own encoder and score the model on the replays.

    `truths`: the model within the uncertainty of its parameters; `at`: its start states on the
    record; `force`: random force that acts in the replays.  Those that diverge are left out.
    """
    rng = np.random.default_rng(seed)
    record, thorough = w.record, force == 0.0
    step = record.input_quantum  # an input that was recorded in steps acted in between them
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
        x0, v0 = w.x0 + begun[0] + errors[0] * w.x0_error, w.v0 + begun[1] + errors[1] * w.v0_error
        made = replace(w, record=readings, x0=x0, v0=v0)
        found = made.evaluate(model, active, thorough=thorough)
        scores.append(w.scores(found.costs))
        squares.append(made.mean_squares(found.errors))
    none = np.zeros((1, len(w)))
    return Floor(np.array(scores or none), np.array(squares or none))
