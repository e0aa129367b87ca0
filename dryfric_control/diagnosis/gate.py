"""Whether free runs decide: some hypothesis brings them down to the noise of the readings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dryfric_control.diagnosis.candidate_fits import Fitted, Race
from dryfric_control.diagnosis.candidates import catalogue
from dryfric_control.diagnosis.causes_found import State
from dryfric_control.diagnosis.likelihood_fits import hard
from dryfric_control.diagnosis.screening import Candidate
from dryfric_control.estimation.likelihood import BASE
from dryfric_control.estimation.parameters import typical
from dryfric_control.estimation.windows import Windows
from dryfric_control.model.axis import FrictionAxis

BoolArray = NDArray[np.bool_]

# Windows (to fit, to judge) that decide whether free runs reach the noise of the readings.
_GATE_FIT, _GATE_JUDGE = 8, 4
# Largest number of causes tried together there, and number of the likeliest candidates tried.
_TOGETHER, _LIKELY = 2, 6
# The first of two causes must lower the mean score to this fraction or less.
_HELPS = 0.95


@dataclass(eq=False)
class Gate:
    """Test whether some hypothesis brings free runs down to the noise of the readings.

    If so, no random force acts, and free runs are the sharpest criterion.

    Parameters
    ----------
    windows : Windows
    axis : FrictionAxis
    fit, judge : ndarray of bool
        Windows on which free runs are fitted and judged.
    settings : dict
        Keyword arguments of `Race`.

    Attributes
    ----------
    hints : list of FrictionAxis
        Axes of the candidates as fitted by likelihood.
    """

    windows: Windows
    axis: FrictionAxis
    fit: BoolArray
    judge: BoolArray
    settings: dict[str, Any]
    hints: list[FrictionAxis] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.race = Race(
            self.windows, self.axis, self._some(self.fit, _GATE_FIT),
            self._some(self.judge, _GATE_JUDGE), typical([self.windows.record]), **self.settings,
        )  # fmt: skip
        self.seen = self.race.fit | self.race.judge

    def _some(self, mask: BoolArray, most: int) -> BoolArray:
        index = np.flatnonzero(mask & self.windows.moving)
        if index.size > most:
            index = index[np.linspace(0, index.size - 1, most).astype(int)]
        chosen = np.zeros(len(self.windows), bool)
        chosen[index] = True
        return chosen

    def at(self, axis: FrictionAxis, free: Sequence[str]) -> bool:
        """Whether an axis with free base and further parameters reaches the noise."""
        return self._reached(self.race.alone(axis, free))

    def _reached(self, one: Fitted) -> bool:
        return self.windows.reached(one.scores, self.seen)

    def _beside(self, base: Fitted) -> list[Fitted]:
        """A fit with each effect of the catalogue added."""
        free = [n for n in base.hypothesis.names if n not in BASE]
        found = dict.fromkeys(n.partition(".")[0] for n in free)
        effects = catalogue(base.axis, list(found))
        return [r for r in self.race.among(base, free, effects) if r.scores.size]

    def opens(self, state: State, candidates: Sequence[Candidate]) -> bool:
        """Whether the axis with its causes and one more candidate reaches the noise."""
        if len(state.causes) >= _TOGETHER:
            return False
        self.hints += [c.axis for c in candidates]
        likely = list(candidates[:_LIKELY])
        # `hard` effects may rank low, as their slopes are no guide far from the optimum.
        likely += [c for c in candidates[_LIKELY:] if hard(c.slug)]
        return any(self.at(c.axis, (*state.names, *c.free)) for c in likely)

    def opens_wide(self) -> bool:
        """Whether one or two effects of the catalogue reach the noise.

        Asked where the answer of the likelihood leaves something unexplained.
        """
        base = self.race.alone(self.axis, ())
        for _ in range(_TOGETHER):
            runners = self._beside(base)
            if self.race.late:
                return False
            if any(map(self._reached, runners)):
                return True
            best = min(runners, key=lambda r: r.scores[self.seen].mean(), default=base)
            # One of several causes lowers the score clearly; a random force cannot be modelled.
            if best.scores[self.seen].mean() > _HELPS * base.scores[self.seen].mean():
                return False
            base = best
        return False
