"""Evidence of held-out data for a cause."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm, wilcoxon

#: Gain of log-likelihood that a cause must bring beyond the penalty of its parameters.
LEAST = 6.0
#: Number of standard errors by which a significant value differs from zero.
CLEAR = 3.0
# For causes that act rarely: number of separate events that must gain, and the fraction of
# their gain that other blocks may lose: of a gain below _LARGE, and of a larger one, which
# is no chance (false causes gained up to 50 and lost at least 0.33 of it).  Above _OF_TWO two
# events are sufficient.
_EVENTS, _LOST, _LARGE, _LOST_OF_LARGE, _OF_TWO = 3, 0.15, 300.0, 0.3, 100.0


class HeldOut(NamedTuple):
    """Gain of a fit over another on held-out data.

    Attributes
    ----------
    gain, error : float
        Gain of log-likelihood of all blocks, and its standard error from their spread.
    order : float
        Standard score of the signed ranks of the blocks' gains (Wilcoxon 1945): high
        if most blocks gain, however unequally.
    usual : float
        Gain over its standard error with the blocks' gains limited to the upper quartile of
        their magnitudes: a few large gains would widen the spread, although they are evidence.
    events : int
        Number of separate events that gain, each at most two adjacent blocks; 0 if the other
        blocks lose too much.  A drive that saturates rarely says nothing in between.
    needed : int
        Number of events that are sufficient for this gain.
    """

    gain: float
    error: float
    order: float
    usual: float = 0.0
    events: int = 0
    needed: int = _EVENTS

    @classmethod
    def of(cls, less: NDArray[np.float64], more: NDArray[np.float64]) -> HeldOut:
        """Held-out gain from the costs of each block without and with a cause."""
        fall = less - more
        gains = np.isfinite(fall) & (fall > LEAST)
        ends = np.flatnonzero(np.diff(gains.astype(int), prepend=0, append=0))
        fall = fall[np.isfinite(fall) & (fall != 0.0)]
        if fall.size == 0:
            return cls(0.0, 0.0, 0.0)
        chance = wilcoxon(fall, alternative="greater").pvalue
        error = float(np.std(fall) * math.sqrt(fall.size))
        lost = -fall[fall < 0.0].sum() / max(fall[fall > 0.0].sum(), 1e-300)
        # One event may straddle the edge of two blocks, not of more.
        events = int(np.sum((ends[1::2] - ends[::2] + 1) // 2))
        if lost > (_LOST if fall.sum() < _LARGE else _LOST_OF_LARGE):
            events = 0
        apart = ends.size > 2 and lost < _LOST and fall.sum() > _OF_TWO
        most = np.quantile(np.abs(fall), 0.75)
        limited = np.clip(fall, -most, most)
        usual = float(limited.sum() / max(np.std(limited) * math.sqrt(fall.size), 1e-300))
        return cls(
            float(fall.sum()), error, float(norm.isf(chance)), usual, events,
            2 if apart else _EVENTS,
        )  # fmt: skip

    @property
    def strength(self) -> float:
        """Number of standard errors by which the gain differs from zero, by its best measure."""
        return max(self.gain / max(self.error, 1e-300), self.order, self.usual)

    @property
    def few_events(self) -> bool:
        """Whether only single events confirm the cause."""
        return self.sure and self.strength <= CLEAR

    @property
    def sure(self) -> bool:
        """Whether held-out data confirm the cause."""
        return self.gain > LEAST and (self.strength > CLEAR or self.events >= self.needed)
