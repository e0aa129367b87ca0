"""Result of the search for the most likely parameters, with their uncertainty."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from dryfric_control.arrays import Bools, Floats, Ints
from dryfric_control.compiled import likelihood as compiled
from dryfric_control.estimation.likelihood import NORMAL_VARIANCE_RATIO, Likelihood, Point
from dryfric_control.model.axis import FrictionAxis

# Eigenvalue of the information, scaled to unit diagonal, below which differences cannot
# distinguish it from 0.
_MIN_EIGENVALUE = 1e-9
# Square root of the information below which it counts as zero.
_MIN_INFORMATION = 1e-100
# Fractions of a Newton step that are tried until one lowers the cost.
_STEP_FRACTIONS = (1.0, 0.3, 0.1)
# Step of the logarithm of the random force's variance on data that were not fitted.
_LOG_VARIANCE_STEP = 2.0


def _inverse(h: Floats) -> Floats:
    """Inverse of an information matrix; undetermined directions get a large variance."""
    size = np.sqrt(np.maximum(np.diag(h), 0.0))
    size[size < _MIN_INFORMATION] = 1.0
    values, vectors = np.linalg.eigh(h / np.outer(size, size))
    inverse = (vectors / np.maximum(values, _MIN_EIGENVALUE)) @ vectors.T
    return np.asarray(inverse / np.outer(size, size))


@dataclass(frozen=True, eq=False)
class Solution:
    """Result of a search."""

    problem: Likelihood
    z: Floats  # search coordinates
    point: Point
    first_gradients: Floats  # of `Likelihood.terms` at z, and the information
    first_information: Floats
    # Whether the predicted fall of the cost is below 1, or nothing near is lower, where the cost
    # is so rough that no step achieves its prediction.
    converged: bool
    promised: float  # fall of the cost that a full Newton step predicts
    iterations: int
    at_bound: tuple[str, ...] = ()  # parameters that ended at a bound
    # Whether the first two are slopes of forces by a linear recursion, which leaves switches out.
    by_recursion: bool = False

    @cached_property
    def _terms(self) -> tuple[Floats, Floats]:
        if self.by_recursion and self.point.out:
            return self.problem.terms(self.z, self.point, 2)
        return self.first_gradients, self.first_information

    @property
    def gradients(self) -> Floats:
        """Gradient of each block, shape (nblocks, ncoordinates)."""
        return self._terms[0]

    @property
    def information(self) -> Floats:
        """Information of each block, shape (nblocks, ncoordinates, ncoordinates)."""
        return self._terms[1]

    @property
    def cost(self) -> float:
        """Negative log-likelihood plus prior."""
        return self.point.cost

    @property
    def axis(self) -> FrictionAxis:
        """Axis of the first record."""
        return self.problem.axis_at(self.z)

    def values(self) -> dict[str, float]:
        """Values by name; names of record-specific ones end with the record's number."""
        p = self.problem
        return {
            name if where < 0 else f"{name}@{where}": par.value(c)
            for name, where, par, c in zip(p.names, p.place, p.parameters, self.z, strict=False)
        }

    def curvature(self) -> float:
        """Ratio of the cost's curvature to the information of the weighted innovations.

        The weights w = (nu + 1)/(nu + e^2/S) fall with the innovation: 5/7 for Student's t, two
        thirds for normal ones.  At rest these are encoder noise and say nothing.
        """
        bent = 0.0
        total = 0.0
        nu = compiled.FREEDOM
        rows = zip(self.problem.runs, self.point.out, self.point.states, strict=True)
        for run, out, states in rows:
            seen = run.active & (out[1] > 0.0) & (states[2] != 0.0)
            square = out[0, seen] ** 2 / out[1, seen]
            bent += float(np.sum((nu + 1.0) * (nu - square) / (nu + square) ** 2))
            total += float(np.sum((nu + 1.0) / (nu + square)))
        return max(bent / total, 0.1) if total > 0.0 else 1.0

    def covariance(self) -> Floats:
        """Sandwich covariance of the search coordinates."""
        h = self.information.sum(axis=0) * self.curvature()
        h += np.diag(self.problem.prior_terms(self.z)[2])
        inverse = _inverse(h)
        g = self.gradients
        blocks = max(len(g) - 1, 1)
        meat = g.T @ g * (len(g) / blocks)
        # Not below the inverse information: few blocks may agree by chance.
        sandwich = inverse @ meat @ inverse
        scale = np.sqrt(np.maximum(np.diag(inverse), np.diag(sandwich)))
        own = np.sqrt(np.maximum(np.diag(sandwich), 0.0))
        own[own < _MIN_INFORMATION] = 1.0
        found = sandwich * np.outer(scale / own, scale / own)
        np.fill_diagonal(found, scale**2)
        return found

    def draw_axes(self, count: int) -> list[list[FrictionAxis]]:
        """Axes of every record with parameters drawn from their covariance, this one first."""
        rng = np.random.default_rng(1)
        n = len(self.problem.names)
        records = range(len(self.problem.runs))
        axes = [[self.problem.axis_at(self.z, i)] * count for i in records]
        if not n:
            return axes
        values, vectors = np.linalg.eigh(self.covariance()[:n, :n])
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        for k in range(1, count):
            z = self.z.copy()
            z[:n] += root @ rng.standard_normal(n)
            z = np.clip(z, self.problem.low, self.problem.high)
            try:
                for i in records:
                    axes[i][k] = self.problem.axis_at(z, i)
            except ValueError:
                continue  # no such axis
        return axes

    def information_of(self, steps: Floats) -> Floats:
        """Information about steps of the parameters, one a row, from differences along them."""
        problem = self.problem
        count = len(steps)
        total = np.zeros((count, count))
        for i, run in enumerate(problem.runs):
            here = self.point.out[i]
            blocks = run.edges.size - 1
            slopes = np.zeros((count, 2, len(run.record)))
            for step, slope in zip(steps, slopes, strict=True):
                for side in (1.0, -1.0):
                    there = self.z.copy()
                    there[: step.size] += side * step
                    if np.any(there != np.clip(there, problem.low, problem.high)):
                        continue
                    try:
                        out = problem.innovations(there, i)[0]
                    except ValueError:  # no such axis
                        continue
                    compiled.slopes(here, here, out, 0.0, side, slope)
                    break
            g = np.zeros((blocks, count))
            h = np.zeros((blocks, count, count))
            compiled.normal_terms(here, run.active, run.edges, slopes, g, h)
            total += h.sum(axis=0)
        return total

    def _blocks(self, at: Point) -> Floats:
        """Cost of each block of all records at a point."""
        return np.concatenate([self.problem.blocks(i, out) for i, out in enumerate(at.out)])

    def _refit_without(self, mine: Bools, moved: Bools | bool = True) -> tuple[Floats, Point]:
        """Coordinates fitted without some blocks, by one Newton step, and the point there.

        `moved`: which may differ from those of all blocks.
        """
        problem = self.problem
        before = self._blocks(self.point)
        if not self.gradients.size:
            return self.z, self.point
        _, slope, curvature = problem.prior_terms(self.z)
        g = self.gradients.sum(axis=0) + slope
        h = self.information.sum(axis=0) + np.diag(curvature)
        size = np.sqrt(np.maximum(np.diag(h), 1e-12))
        far = problem.reach(np.arange(problem.size), size) / size
        rest = h - self.information[mine].sum(axis=0) + 1e-9 * np.diag(np.diag(h))
        pull = self.gradients[mine].sum(axis=0) - g
        step = np.zeros(self.z.size)
        free = (self.z > problem.low) & (self.z < problem.high) & moved
        while np.any(free):
            # Fix coordinates that are at a bound or reach one, and solve for the others
            # again: clipping afterwards would leave correlated ones at wrong values.
            left = pull[free] - rest[np.ix_(free, ~free)] @ step[~free]
            step[free] = np.linalg.lstsq(rest[np.ix_(free, free)], left, rcond=1e-12)[0]
            there = np.clip(self.z + step, problem.low, problem.high)
            beyond = free & (there != self.z + step)
            if not np.any(beyond):
                break
            step[beyond] = (there - self.z)[beyond]
            free &= ~beyond
        step *= min(1.0, 1.0 / max(float(np.max(np.abs(step) / far)), 1e-300))
        # A rough cost may rise: then take a shorter step, judged by the fitted blocks.
        most = before[~mine].sum() + problem.prior(self.z)
        for part in _STEP_FRACTIONS:
            there = np.clip(self.z + part * step, problem.low, problem.high)
            point = problem.tried(there)
            if point.out and self._blocks(point)[~mine].sum() + problem.prior(there) <= most:
                return there, point
        return self.z, self.point

    @cached_property
    def cross_validation(self) -> tuple[Floats, tuple[Floats, Floats], Ints]:
        """Held-out costs of the blocks, parameters fitted without each half, half of each block.

        Two blocks at a time belong to either half; the parameters follow by one Newton step.
        """
        problem = self.problem
        costs = self._blocks(self.point)
        half = np.concatenate([np.arange(r.edges.size - 1) // 2 % 2 for r in problem.runs])
        found = [self.z, self.z]
        noise = slice(len(problem.names), None, 2)
        for k in (0, 1) if self.gradients.size else ():
            mine = half == k
            found[k], point = self._refit_without(mine)
            costs[mine] = self._blocks(point)[mine]
            # What the parameters miss on unseen data acts there as a random force.
            there = found[k].copy()
            while np.all(there[noise] < problem.high[noise]):
                there[noise] = np.minimum(there[noise] + _LOG_VARIANCE_STEP, problem.high[noise])
                point = problem.tried(there)
                here = self._blocks(point)[mine] if point.out else costs[mine]
                if not here.sum() < costs[mine].sum():
                    break
                costs[mine] = here
        return costs, (found[0], found[1]), half

    def in_halves(self, names: Collection[str]) -> tuple[Solution, tuple[Floats, Floats]]:
        """The same with other values of some parameters in each half of every record.

        Its coordinates are those of all data, its cost and its point those of both halves, whose
        own coordinates are the second result.
        """
        runs, moved = self.problem.runs, np.zeros(self.z.size, bool)
        moved[: len(self.problem.names)] = np.isin(self.problem.names, [*names])
        late = np.concatenate([np.arange(r.edges.size - 1) >= r.edges.size // 2 for r in runs])
        (z1, first), (z2, second) = (self._refit_without(mine, moved) for mine in (late, ~late))

        def join_halves(first: list[Floats], second: list[Floats]) -> list[Floats]:
            middle = (run.edges[run.edges.size // 2] for run in runs)
            rows = zip(first, second, middle, strict=True)
            return [np.concatenate((a[:, :k], b[:, k:]), axis=1) for a, b, k in rows]

        out = join_halves(first.out, second.out)
        both = Point(0.0, out, join_halves(first.states, second.states))
        cost = float(self._blocks(both).sum()) + self.problem.prior(self.z)
        whole = replace(self, point=replace(both, cost=cost), by_recursion=False)
        return whole, (z1, z2)

    def held_out(self) -> Floats:
        """Held-out cost of each block: under parameters fitted without its half."""
        return self.cross_validation[0]

    def held_out_axes(self, i: int) -> tuple[tuple[FrictionAxis, FrictionAxis], Ints]:
        """Axes of record i fitted without each half, and the half of each of its samples."""
        _, z, half = self.cross_validation
        runs = self.problem.runs
        first = sum(r.edges.size - 1 for r in runs[:i])
        own = half[first : first + runs[i].edges.size - 1]
        axes = self.problem.axis_at(z[0], i), self.problem.axis_at(z[1], i)
        return axes, np.repeat(own, np.diff(runs[i].edges))

    def standard_errors(self) -> dict[str, float]:
        """Standard errors by name."""
        spread = np.sqrt(np.maximum(np.diag(self.covariance()), 0.0))
        rows = zip(self.values(), spread, self.problem.parameters, self.z, strict=False)
        return {name: float(s * p.slope(p.value(c))) for name, s, p, c in rows}

    def random_force(self, i: int = 0) -> float:
        """Standard deviation of the random force in record i, held over a sample [N]."""
        return math.sqrt(self.problem.noises(self.z, i)[0] / NORMAL_VARIANCE_RATIO)

    @property
    def largest_force(self) -> float:
        """Standard deviation of the random force in the record where it is largest [N]."""
        return max(self.random_force(i) for i in range(len(self.problem.runs)))

    def reading_noise(self, i: int = 0) -> float:
        """Standard deviation of a reading's noise in record i."""
        return math.sqrt(self.problem.noises(self.z, i)[1] / NORMAL_VARIANCE_RATIO)
