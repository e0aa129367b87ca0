"""Starting points of a candidate's fit, and a grid of them between first guesses."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dryfric_control.diagnosis.candidates import effect_class
from dryfric_control.estimation.likelihood import Likelihood, Run

# Grid step as a fraction of the distance between two guesses, and the step of a second grid at the
# best share.
_RUNG, _FINE = 0.25, 0.05
# Standard deviations of the random force tried at each point, over the present one, with the shares
# tried at each.  Fitted without the effect the random force makes up for it, and hides it where it
# is too large.
_SHARES = np.arange(0.05, 0.96, 0.06)
_QUIETER = ((1.0, _SHARES), (0.2, _SHARES[::2]))
# Number of best grid points that are refined, scales of the line searches around them, and the
# changes tried: of the logarithm of a parameter; of a share, a fifth of them.
_VALLEYS, _CLOSER, _CLOSEST, _ASIDE = 3, (1.0, 0.3), (0.1,), np.linspace(-0.2, 0.2, 9)
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

    def quieter(self, part: float) -> Start:
        """The start with a fraction of its random forces; its cost is not computed (inf)."""
        p, z = self.problem, self.z.copy()
        forces = slice(len(p.names), None, 2)
        z[forces] = np.clip(z[forces] + 2.0 * math.log(part), p.low[forces], p.high[forces])
        return self._replace(cost=math.inf, z=z)

    def evaluated(self, problem: Likelihood | None = None) -> Start:
        """The start with its cost, that of another problem with the same coordinates if given."""
        problem = problem or self.problem
        return self._replace(cost=problem.tried(self.z).cost, problem=problem)

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
    whole, few = starts[0].problem, starts[0].problem.on(runs)
    net = few.on([replace(run, pieces=run.pieces[::_STRETCHES]) for run in runs])
    best: list[tuple[float, Start]] = []
    for place, one in _between(starts[0]._replace(problem=net), others, rows, _RUNG):
        for part, tried in _QUIETER:
            if late():
                break
            quiet = one.quieter(part)
            if shares:
                best.append((place, quiet.best_of(shares[0], tried)))
            else:
                best.append((place, quiet.evaluated()))
    best = _lowest(best)[: 2 * _VALLEYS]
    best = _lowest((place, one.evaluated(few)) for place, one in best)
    # The share is nearly the same in every valley, but the best length may be another's: the better
    # the share is known, the more valleys a fine grid of lengths shows.
    for problem, scales in ((few, _CLOSER), (whole, _CLOSEST)):
        if shares and best:
            top = best[0][1].evaluated(problem)
            for part in scales:
                top = top.best_of(shares[0], top.value(shares[0]) + 0.2 * part * _ASIDE)
            fine = (o for o in _between(top, others, rows, _FINE) if not late())
            best = _lowest([*best, *((place, one.evaluated()) for place, one in fine)])
        # All samples show a valley more narrowly than a few.
        steps = [(whole, _CLOSER[-1])]
        if problem is few:
            steps = [(few, part) for part in _CLOSER] + steps
        near = _apart(best)
        best = _lowest((i, _refined(one, steps, others, shares, late)) for i, one in near)
        if not shares:
            break
    return sorted([*(one for _, one in best), *starts], key=lambda one: one.cost)


def _refined(
    one: Start, steps: Sequence[tuple[Likelihood, float]], others: Sequence[str],
    shares: Sequence[str], late: Callable[[], bool],
) -> Start:  # fmt: skip
    """The lowest point near a start, by line searches: problems and scales of each."""
    for problem, part in steps:
        one = one.evaluated(problem)
        for name in (*others, *shares):
            if late():
                break
            value, by = one.value(name), part * _ASIDE
            close = value + 0.2 * by if name in shares else value * np.exp(by)
            one = one.best_of(name, close)
    return one


def _between(
    start: Start, names: Sequence[str], rows: NDArray[np.float64], rung: float
) -> Iterator[tuple[float, Start]]:
    """Starts on the line through the logarithms of the guesses, with their places on it."""
    for place in np.arange(0.0, len(rows) - 1 + 1e-9, rung):
        k = min(int(place), max(len(rows) - 2, 0))
        row = rows[k] + (place - k) * (rows[min(k + 1, len(rows) - 1)] - rows[k])
        one = start
        for name, value in zip(names, np.exp(row), strict=True):
            one = one.moved(name, value)
        yield place, one


def _lowest(points: Iterable[tuple[float, Start]]) -> list[tuple[float, Start]]:
    """Points of the grid by cost.

    Where the coupling is too stiff for the sampling time the cost is infinite.
    """
    finite = (point for point in points if math.isfinite(point[1].cost))
    return sorted(finite, key=lambda point: point[1].cost)


def _apart(points: Sequence[tuple[float, Start]]) -> list[tuple[float, Start]]:
    """The lowest few of sorted points, of neighbours only the lowest."""
    some: list[tuple[float, Start]] = []
    for place, one in points:
        if all(abs(place - other) > _RUNG for other, _ in some):
            some.append((place, one))
    return some[:_VALLEYS]
