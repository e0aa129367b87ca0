"""Search for the most likely parameters by damped Fisher scoring, noises first."""

from __future__ import annotations

import itertools
import math
import time
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from dryfric_control.arrays import Floats, Ints
from dryfric_control.compiled import likelihood as compiled
from dryfric_control.estimation.likelihood import MAX_STEP, Likelihood, Point
from dryfric_control.estimation.solution import Solution

# Predicted fall of the cost below which the search ends.
_CONVERGED_FALL = 0.05
# Number of successive iterations that may bring less.
_MAX_SMALL_STEPS = 2
# Predicted fall above which the search has not converged, unless nothing near is lower.
_UNCONVERGED_FALL = 1.0
# Predicted fall of the cost above which slopes are one-sided where no recursion gives them.
_DIFFERENCES_FALL = 30.0
# Predicted fall below which slopes are central differences.
_CENTRAL_DIFFERENCE_FALL = 3.0
# Usual number of iterations.
_MAX_ITERATIONS = 40
#: Ratio of what a fit may still gain to what its last step promises.
REMAINING_GAIN_RATIO = 5.0
#: Iterations of a first fit.
FIRST_ITERATIONS = 4
#: Iterations of a fit that compares.
COMPARISON_ITERATIONS = 15
#: Iterations of the last fit.
FINAL_ITERATIONS = 30
# Factor of the difference steps where the cost is rough.
_WIDE_STEP_FACTOR = 4.0
# Iterations of the initial search for the noises alone.
_NOISE_ITERATIONS = 8
# Change of the logarithm of a noise variance below which that search ends.
_NOISE_CONVERGED = 0.3
# Ratio of actual to predicted fall above which damping is reduced.
_GOOD_FALL_RATIO = 0.6
# The same below which damping is raised.
_POOR_FALL_RATIO = 0.25
# Least damping from which it is raised.
_MIN_RAISED_DAMPING = 1e-2
# Lengths of the steps along the principal axes, in standard errors, that are tried where the cost
# is rough.
_POLL_LENGTHS = (3.0, 10.0)
# Continuation over the random force: the first one, over the drive.
_FIRST_FORCE_RATIO = 0.3
# Ratio of a random force to the one before.
_FORCE_REDUCTION = 1.0 / 3.0
# Least number of random forces.
_MIN_FORCE_LEVELS = 2
# Fractions of the random force that are tried where a search ends: the first crosses a ridge of a
# rough cost.
_FORCE_FRACTIONS = (0.9, 0.5, 0.2, 0.07)


def _lower_random_force(problem: Likelihood, z: Floats, point: Point) -> tuple[Floats, Point]:
    """A point with as much random force in each record as is best: the cost may have two minima."""
    n, quiet = len(problem.names), z.copy()
    for i, run in enumerate(problem.runs):
        least = compiled.cost(point.out[i], run.active)
        for part in _FORCE_FRACTIONS:
            new = z.copy()
            new[n + 2 * i] = max(z[n + 2 * i] + 2.0 * math.log(part), problem.low[n + 2 * i])
            cost = compiled.cost(problem.innovations(new, i)[0], run.active)
            if cost < least:
                least, quiet[n + 2 * i] = cost, new[n + 2 * i]
    return (quiet, problem.at(quiet)) if np.any(quiet != z) else (z, point)


def _noises(problem: Likelihood, z: Floats, point: Point) -> tuple[Floats, Point]:
    """Noises for fixed parameters; with a much too large one readings say little about these."""
    for _ in range(_NOISE_ITERATIONS):
        gradients, information = problem.terms(z, point, 1, noises=True)
        g, h = gradients.sum(axis=0), problem.rescale_information(information.sum(axis=0))
        free, size = _search_coordinates(problem, z, g, h)
        if not free.size:
            break
        unit = h[np.ix_(free, free)] / np.outer(size, size) + 1e-3 * np.eye(free.size)
        step = within_reach(unit, g[free] / size, problem.reach(free, size)) / size
        new = z.copy()
        new[free] += step
        new = np.clip(new, problem.low, problem.high)
        tried = problem.tried(new)
        if not tried.cost < point.cost:
            break
        moved_by = float(np.max(np.abs(new - z)))
        z, point = new, tried
        if moved_by < _NOISE_CONVERGED:
            break
    return z, point


def _search_coordinates(
    problem: Likelihood, z: Floats, g: Floats, h: Floats
) -> tuple[Ints, Floats]:
    """Coordinates that are not held at a bound and matter, and the roots of their information."""
    held = ((z <= problem.low) & (g > 0.0)) | ((z >= problem.high) & (g < 0.0))
    free = np.flatnonzero(~held & (np.diag(h) > 1e-12))
    return free, np.sqrt(np.diag(h)[free])


def _predicted_fall(unit: Floats, slope: Floats) -> float:
    """Fall of the cost that a Newton step in coordinates of unit information predicts."""
    step = np.linalg.lstsq(unit + 1e-9 * np.eye(slope.size), slope, rcond=None)[0]
    return 0.5 * float(slope @ step)


def within_reach(unit: Floats, g: Floats, reach: Floats) -> Floats:
    """Newton step in coordinates of unit information, each limited to its reach."""
    # One that would go farther is fixed there, so that it does not shorten the step of the others.
    step, fixed = np.zeros(g.size), np.zeros(g.size, bool)
    while not fixed.all():
        free = ~fixed
        rest = -g[free] - unit[np.ix_(free, fixed)] @ step[fixed]
        step[free] = np.linalg.solve(unit[np.ix_(free, free)], rest)
        over = np.where(free, np.abs(step) / reach, 0.0)
        worst = int(np.argmax(over))
        if over[worst] <= 1.0:
            break
        step[worst] = math.copysign(reach[worst], step[worst])
        fixed[worst] = True
    return step


def _poll_axes(
    problem: Likelihood, z: Floats, point: Point, free: Ints, h: Floats
) -> tuple[Floats, Point] | None:
    """The lowest point on the principal axes of the information h, or None if none is lower."""
    own = free < len(problem.names)
    free, h = free[own], h[np.ix_(own, own)]
    size = np.sqrt(np.diag(h))
    values, vectors = np.linalg.eigh(h / np.outer(size, size))
    far = problem.reach(free, size) / size
    best = z, point
    for value, vector in zip(values, vectors.T, strict=True):
        step = vector / math.sqrt(max(value, 1e-9)) / size
        for length in _POLL_LENGTHS:
            part = min(length, 1.0 / float(np.max(np.abs(step) / far)))
            for sign in (part, -part):
                new = z.copy()
                new[free] += sign * step
                new = np.clip(new, problem.low, problem.high)
                tried = problem.tried(new)
                if tried.cost < best[1].cost:
                    best = new, tried
    return best if point.cost - best[1].cost > _CONVERGED_FALL else None


def maximise(
    problem: Likelihood,
    z: Floats,
    iterations: int = _MAX_ITERATIONS,
    until: float = math.inf,
    quick: bool = False,
    again: bool = False,
    recursion: bool = True,
    than: float = math.inf,
) -> Solution:
    """Most likely parameters from one starting point, by damped Fisher scoring.

    Infinite cost where there is no axis with the start values, whose `Likelihood.at` says why.
    `until`: reading of `time.monotonic` at which the search stops.  `quick`: only as far as
    slopes of forces from a linear recursion lead.  `again`: from where another search ended.
    `recursion`: whether such slopes are used at all.  `than`: cost above which the search ends once
    its steps do not promise to come below it.
    """
    z = np.clip(z, problem.low, problem.high)
    point = problem.tried(z)
    if not point.out:
        none = np.zeros(0)
        return Solution(problem, z, point, none, none, False, math.inf, 0)
    if iterations and not again:
        z, point = _noises(problem, z, point)
    search, turn = _Scoring(problem, z, point, until, linear=recursion), 0
    for turn in range(iterations):
        if (quick and not search.linear) or not search.iterate():
            break
        hope = REMAINING_GAIN_RATIO * search.promised
        if turn >= FIRST_ITERATIONS and search.point.cost - hope > than:
            break
    return search.solution(turn)


class _Quadratic(NamedTuple):
    """Quadratic model of the cost at a point."""

    h: Floats  # information with the prior, of all coordinates
    free: Ints  # coordinates that are searched
    size: Floats  # roots of their information
    unit: Floats  # their information, scaled to a unit diagonal
    slope: Floats  # their gradient in the same units


@dataclass(eq=False)
class _Scoring:
    """State of a search by damped Fisher scoring."""

    problem: Likelihood
    z: Floats
    point: Point
    until: float  # reading of `time.monotonic` at which it stops
    damping: float = 1e-3
    promised: float = math.inf  # predicted fall of the cost
    wider: float = 1.0  # factor of the difference steps
    creeping: int = 0  # number of successive iterations that brought little
    quiet: bool = False  # whether smaller random forces have been tried
    settled: bool = False  # whether nothing near is lower
    linear: bool = True  # whether slopes of forces come from a linear recursion
    gradients: Floats = field(default_factory=lambda: np.zeros(0))
    information: Floats = field(default_factory=lambda: np.zeros(0))

    def iterate(self) -> bool:
        """One iteration; whether the search goes on."""
        if self.linear and (self.promised > _DIFFERENCES_FALL or self.problem.is_recursive):
            sides = 0
        else:
            sides = 1 if self.promised > _CENTRAL_DIFFERENCE_FALL else 2
        model = self._quadratic_model(sides)
        self.promised = _predicted_fall(model.unit, model.slope)
        if time.monotonic() > self.until:
            return False
        if self.promised <= _CONVERGED_FALL:
            return self._at_minimum(sides)
        if self._step(model):
            return True
        if sides == 0:
            # Slopes that leave out the switches lead no farther.
            self.linear, self.damping = False, 1e-3
            return True
        return self._on_rough_cost(model)

    def _quadratic_model(self, sides: int) -> _Quadratic:
        """Quadratic model of the cost, with slopes as `Likelihood.terms` computes them."""
        problem, z = self.problem, self.z
        self.gradients, self.information = problem.terms(z, self.point, sides)
        g, h = self.gradients.sum(axis=0), self.information.sum(axis=0)
        problem.refine(h, self.wider)
        _, prior_g, prior_h = problem.prior_terms(z)
        g = g + prior_g
        h = problem.rescale_information(h) + np.diag(prior_h)
        free, size = _search_coordinates(problem, z, g, h)
        unit = h[np.ix_(free, free)] / np.outer(size, size)
        return _Quadratic(h, free, size, unit, g[free] / size)

    def _at_minimum(self, sides: int) -> bool:
        """Where slopes promise nothing: go on with better slopes, or a smaller random force."""
        if sides == 0:
            self.linear = False
            return True
        before = self.point
        if not self.quiet:
            self.z, self.point = _lower_random_force(self.problem, self.z, self.point)
        if self.point is before:
            return False
        self.quiet, self.creeping = True, 0
        return True

    def _step(self, model: _Quadratic) -> bool:
        """Take the least damped Newton step that lowers the cost; whether there is one."""
        problem, (_, free, size, unit, slope) = self.problem, model
        far = problem.reach(free, size)
        while self.damping < 1e7 and self.creeping < _MAX_SMALL_STEPS:
            step = np.zeros(problem.size)
            damped = unit + self.damping * np.eye(free.size)
            step[free] = within_reach(damped, slope, far) / size
            new = np.clip(self.z + step, problem.low, problem.high)
            by = (new - self.z)[free] * size
            predicted = -float(slope @ by + 0.5 * by @ unit @ by)
            if predicted < _CONVERGED_FALL:
                return False
            point = problem.tried(new)
            if point.cost < self.point.cost:
                self._adapt_damping(float(self.point.cost - point.cost), predicted)
                self.z, self.point = new, point
                return True
            self.damping *= 10.0 if self.damping > 1e-3 else 100.0
        return False

    def _adapt_damping(self, fall: float, predicted: float) -> None:
        """Adapt the damping to how well a step was predicted."""
        kept = fall / predicted  # no number where the cost was infinite, nor a warning
        if kept > _GOOD_FALL_RATIO:
            self.damping = max(0.1 * self.damping, 1e-9)
        self.linear = self.linear and kept >= _POOR_FALL_RATIO
        if kept < _POOR_FALL_RATIO:
            self.damping = 10.0 * max(self.damping, _MIN_RAISED_DAMPING)
        self.creeping = self.creeping + 1 if fall < _CONVERGED_FALL else 0

    def _on_rough_cost(self, model: _Quadratic) -> bool:
        """Where no step lowers the cost: slopes over wider steps may still find a descent."""
        h, free, _, unit, slope = model
        if self.wider > 1.0:
            inner = h[np.ix_(free, free)]
            lower = _poll_axes(self.problem, self.z, self.point, free, inner)
            if lower is None:
                self.settled = True
                # The noises were searched without slopes, which are no guide to a rough cost.
                own = free < len(self.problem.names)
                self.promised = _predicted_fall(unit[np.ix_(own, own)], slope[own])
                return False
            self.z, self.point = lower
        elif not self.quiet:
            self.z, self.point = _lower_random_force(self.problem, self.z, self.point)
        self.damping, self.wider, self.quiet, self.creeping = 1e-3, _WIDE_STEP_FACTOR, True, 0
        self.problem.refine(h, self.wider)
        return True

    def solution(self, iterations: int) -> Solution:
        """The result, with the parameters that ended at a bound."""
        problem, z = self.problem, self.z
        rows = zip(problem.parameters, z, problem.low, problem.high, strict=False)
        ended = ((p, c) for p, c, low, high in rows if c <= low or c >= high)
        bound = tuple(p.name for p, c in ended if not (p.optional and p.value(c) == p.neutral))
        done = self.settled or self.promised < _UNCONVERGED_FALL
        return Solution(
            problem, z, self.point, self.gradients, self.information, done, self.promised,
            iterations, bound, self.linear and bool(self.gradients.size),
        )  # fmt: skip


def with_force(likelihood: Likelihood, z: Floats, part: float = _FIRST_FORCE_RATIO) -> Floats:
    """Coordinates with the random force a part of the drive."""
    z = z.copy()
    z[len(likelihood.names) :][::2] = [2.0 * math.log(part * r.drive) for r in likelihood.runs]
    return z


def fit_with_fixed_noises(
    likelihood: Likelihood, z: Floats, turns: int = FIRST_ITERATIONS, until: float = math.inf
) -> Solution:
    """Parameters fitted with the noises held, as far as slopes of forces lead."""
    one, noises = likelihood.on(likelihood.runs), slice(len(likelihood.names), None)
    one.low, one.high = likelihood.low.copy(), likelihood.high.copy()
    one.low[noises] = one.high[noises] = z[noises]
    return maximise(one, z, turns, until, True)


def force_continuation(likelihood: Likelihood, z: Floats, until: float = math.inf) -> Floats:
    """Parameters fitted at random forces that are held, each lower, until below the friction."""
    level, drive = likelihood.axis.coulomb.mean, max(r.drive for r in likelihood.runs)
    below = (
        math.log(max(_FIRST_FORCE_RATIO * drive / level, 1.0), 1.0 / _FORCE_REDUCTION)
        if level > 0.0
        else 0.0
    )
    for rung in range(max(math.ceil(below), _MIN_FORCE_LEVELS)):
        part = _FIRST_FORCE_RATIO * _FORCE_REDUCTION**rung
        z = fit_with_fixed_noises(
            likelihood, with_force(likelihood, z, part), COMPARISON_ITERATIONS, until
        ).z
    return z


def breakaway_search(likelihood: Likelihood, z: Floats) -> list[Floats]:
    """Points at ever lower random forces, from the likeliest one: the rest held, what acts at
    breakaway is likeliest there.

    The right peak is likelier than any larger one only within a range that shrinks with the random
    force, to where each breakaway is on time: a search looks near and far at each of them.
    """
    own = [j for j, p in enumerate(likelihood.parameters) if p.breaks_away]
    force, reading = (slice(len(likelihood.names) + i, None, 2) for i in (0, 1))
    z = with_force(likelihood, z)
    z[reading] = likelihood.low[reading]
    rungs = math.ceil(
        float(np.max(z[force] - likelihood.low[force])) / (-2.0 * math.log(_FORCE_REDUCTION))
    )
    lengths = MAX_STEP * _FORCE_REDUCTION ** np.arange(rungs)
    lengths, unit = np.concatenate((lengths, -lengths))[:, None], np.eye(z.size)
    costs, found = [], []
    for _ in range(rungs + 1):
        z = np.clip(z, likelihood.low, likelihood.high)
        cost, idle = likelihood.tried(z).cost, 0
        for j in itertools.cycle(own):
            near = np.clip(z + lengths * unit[j], likelihood.low, likelihood.high)
            all_costs = [likelihood.tried(one).cost for one in near]
            best = int(np.argmin(all_costs))
            idle = 0 if cost - all_costs[best] > _CONVERGED_FALL else idle + 1
            if all_costs[best] < cost:
                cost, z = all_costs[best], near[best]
            if idle == len(own):
                break
        costs.append(cost)
        found.append(z)
        z = z.copy()
        z[force] += 2.0 * math.log(_FORCE_REDUCTION)
    return found[int(np.argmin(costs)) :]
