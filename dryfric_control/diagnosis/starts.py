"""Starting points of a candidate's fit, and a grid of them between first guesses."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dryfric_control.diagnosis.candidates import effect_class
from dryfric_control.estimation.likelihood import Likelihood, Run

# Grid step as a fraction of the distance between two guesses, and shares tried at each point.
_RUNG, _SHARES = 0.25, np.arange(0.05, 0.96, 0.06)
# Number of best grid points that are refined, scales of the line searches around them, and the
# changes tried: of the logarithm of a parameter; of a share, a fifth of them.
_VALLEYS, _CLOSER, _ASIDE = 3, (1.0, 0.3), np.linspace(-0.2, 0.2, 9)
# The grid is evaluated on one of this many stretches of samples.
_STRETCHES = 2
# Scales of the line searches around the end of a fit whose cost has jumps.
_FAR_AND_CLOSE = (4.0, 1.0, 0.3)


class Start(NamedTuple):
    """A starting point of a fit.

    Attributes
    ----------
    cost : float
    problem : Likelihood
    z : ndarray, shape (ncoordinates,)
    slug : str
        The effect on trial.
    """

    cost: float
    problem: Likelihood
    z: NDArray[np.float64]
    slug: str

    def value(self, name: str) -> float:
        """Value of one parameter."""
        j = self.problem.names.index(name)
        return self.problem.parameters[j].value(self.z[j])

    def moved(self, name: str, value: float) -> Start:
        """The start with another value of one parameter; its cost is not computed (inf)."""
        p, z = self.problem, self.z.copy()
        j = p.names.index(name)
        z[j] = np.clip(p.parameters[j].search(value), p.low[j], p.high[j])
        return self._replace(cost=math.inf, z=z)

    def best_of(self, name: str, values: Iterable[float]) -> Start:
        """The best of this start and those with other values of one parameter."""
        best = self
        for value in values:
            one = self.moved(name, float(value))
            cost = one.problem.tried(one.z).cost
            if cost < best.cost:
                best = one._replace(cost=cost)
        return best


def beside_jumps(
    problem: Likelihood, z: NDArray[np.float64], names: Sequence[str], late: Callable[[], bool]
) -> NDArray[np.float64]:
    """Line search near `z` over parameters that act only at breakaway; best coordinates.

    At certain values a breakaway moves to another sample and the cost jumps.  It is nearly
    flat between the jumps, so that a gradient-based fit stops at the first one.
    """
    best = Start(problem.tried(z).cost, problem, z, "")
    for part in _FAR_AND_CLOSE:
        for group in (names, *((n,) for n in names)) if len(names) > 1 else (names,):
            if late():
                break
            begin = best
            for by in part * _ASIDE[_ASIDE != 0.0]:
                one = begin
                for name in group:
                    one = one.moved(name, begin.value(name) * math.exp(by))
                cost = problem.tried(one.z).cost
                if cost < best.cost:
                    best = one._replace(cost=cost)
    return best.z


def in_valleys(
    starts: Sequence[Start], own: Sequence[str], late: Callable[[], bool], runs: Sequence[Run]
) -> Sequence[Start]:
    """Starts of a two-mass or contact effect, and the best of a grid between them.

    With a slightly wrong mass share or play, the masses touch and separate at wrong times;
    with a slightly wrong length, a contact slides at wrong times.  Only within about 10 %
    of the true values does the cost fall towards them.

    Parameters
    ----------
    starts : sequence of Start
        Starts of one effect.
    own : sequence of str
        Its free parameters.
    late : callable
        Returns whether the time limit has passed.
    runs : sequence of Run
        Samples of the records on which the grid is evaluated.
    """
    kinds = effect_class(starts[0].slug).parameters()
    shares = [n for n in own if kinds[n.partition(".")[2]]["kind"] == "share"]
    others = [n for n in own if n not in shares]
    if not others or (not shares and len(others) > 1):
        return starts
    values = [[one.value(n) for n in others] for one in starts]
    rows = np.log(np.unique(np.maximum(values, 1e-300), axis=0))
    best: list[Start] = []
    whole, few = starts[0].problem, starts[0].problem.on(runs)
    net = few.on([replace(run, pieces=run.pieces[::_STRETCHES]) for run in runs])
    for place in np.arange(0.0, len(rows) - 1 + 1e-9, _RUNG):
        if late():
            break
        k = min(int(place), max(len(rows) - 2, 0))
        row = rows[k] + (place - k) * (rows[min(k + 1, len(rows) - 1)] - rows[k])
        one = starts[0]._replace(problem=net)
        for name, value in zip(others, np.exp(row), strict=True):
            one = one.moved(name, value)
        if shares:
            best.append(one.best_of(shares[0], _SHARES))
        else:
            best.append(one._replace(cost=net.tried(one.z).cost))
    # At some grid points the coupling may be too stiff for the sampling time: infinite cost.
    best = sorted((one for one in best if math.isfinite(one.cost)), key=lambda one: one.cost)
    best = [one._replace(cost=few.tried(one.z).cost, problem=few) for one in best[: 2 * _VALLEYS]]
    best = sorted((one for one in best if math.isfinite(one.cost)), key=lambda one: one.cost)
    best = best[:_VALLEYS]
    for i, one in enumerate(best):
        for part in _CLOSER:
            for name in (*others, *shares):
                if late():
                    break
                value, by = one.value(name), part * _ASIDE
                close = value + 0.2 * by if name in shares else value * np.exp(by)
                one = one.best_of(name, close)
        best[i] = one._replace(cost=whole.tried(one.z).cost, problem=whole)
    best = [one for one in best if math.isfinite(one.cost)]  # finite on all samples too
    return sorted([*best, *starts], key=lambda one: one.cost)
