"""What data that no fit has seen say about a cause."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm, wilcoxon

#: Gain of log-likelihood beyond that of its parameters which a cause must bring.
LEAST = 6.0
#: Standard errors by which what is sure must differ from zero.
CLEAR = 3.0
# Separate events that must gain where most blocks say nothing, and the part of their
# gain that others may lose: of a small gain, and of one so large that it is no chance
# (causes that were not there gained up to 50, and lost 0.33 of it and more).
_EVENTS, _LOST, _LARGE, _LOST_OF_LARGE = 3, 0.15, 300.0, 0.3


class HeldOut(NamedTuple):
    """Gain of a fit over another on data that neither was fitted to.

    Attributes
    ----------
    gain, error : float
        Log-likelihood of all blocks, and its standard error from their differences.
    order : float
        Standard score of the signed ranks of the blocks' gains (Wilcoxon 1945): high
        where most blocks gain, however unequally.
    usual : float
        Gain over its standard error where no block counts for more than the upper quartile
        does: a few that gain most widen the spread and say all the more.
    events : int
        Events that each gain, of two blocks side by side at most, where the others lose little:
        a drive that is limited now and then says nothing in between.
    """

    gain: float
    error: float
    order: float
    usual: float = 0.0
    events: int = 0

    @classmethod
    def of(cls, less: NDArray[np.float64], more: NDArray[np.float64]) -> HeldOut:
        """From the costs of each block without and with a cause."""
        fall = less - more
        gains = np.isfinite(fall) & (fall > LEAST)
        ends = np.flatnonzero(np.diff(gains.astype(int), prepend=0, append=0))
        fall = fall[np.isfinite(fall) & (fall != 0.0)]
        if fall.size == 0:
            return cls(0.0, 0.0, 0.0)
        chance = wilcoxon(fall, alternative="greater").pvalue
        error = float(np.std(fall) * math.sqrt(fall.size))
        part = _LOST if fall.sum() < _LARGE else _LOST_OF_LARGE
        lost = -fall[fall < 0.0].sum() > part * fall[fall > 0.0].sum()
        # One event may lie across the edge of two blocks, not of more.
        events = 0 if lost else int(np.sum((ends[1::2] - ends[::2] + 1) // 2))
        most = np.quantile(np.abs(fall), 0.75)
        limited = np.clip(fall, -most, most)
        usual = float(limited.sum() / max(np.std(limited) * math.sqrt(fall.size), 1e-300))
        return cls(float(fall.sum()), error, float(norm.isf(chance)), usual, events)

    @property
    def sure(self) -> bool:
        """Whether unseen data speak for the cause."""
        often = max(self.gain / max(self.error, 1e-300), self.order, self.usual) > CLEAR
        return self.gain > LEAST and (often or self.events >= _EVENTS)
