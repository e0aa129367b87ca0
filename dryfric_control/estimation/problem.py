"""Least squares over windowed free runs, with the start states projected out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dryfric_control.compiled.free_runs import normal_terms, start_steps
from dryfric_control.estimation.parameters import SHIFT, Parameter, with_values
from dryfric_control.estimation.windows import Windows
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.ties import NEAR, SQUARES, above

FloatArray = NDArray[np.float64]

# Change of a search coordinate by which slopes are taken: a few of its standard
# errors within these bounds; more would be a chord over what the fit resolves.
_SHORT_STEP, _STEP = 5e-5, 2e-3
# Break-away under a held input moves from sample to sample: what acts by it takes
# at least this change, a smaller one would see nothing.
_BY_BREAK_AWAY = ("stribeck.excess", "stribeck.speed", "stick_speed")
_BREAK_AWAY_STEP = 5e-4
# Slopes to both sides whose sizes differ by this hold such a jump on one side.
_JUMP = 3.0
# The scale of the errors is what this part of the windows stays below, and the
# pull of a window on the parameters fades from a multiple of it: the few windows
# with a mistimed break-away count less, but no whole direction is given up.
_TYPICAL, _ROBUST = 0.8, 2.0
# Error of a free run that the arithmetic itself may make, relative to travel.
_ROUNDING = 1e-9
# Steps towards the most likely start states, worth another where a window's cost
# fell by this; their slopes are taken over a part of the start's error.
_START_STEPS, _START_FALL, _START_SLOPE = 10, 0.02, 0.01
# A start is looked for at these corrections of the speed, in standard deviations,
# and over these parts of the window; during a descent only where the cost exceeds
# that of noise by so many sqrt(samples), some three of its standard deviations.
_SIDES = (-2.0, -1.5, -1.0, -0.5, 0.0, 0.5, 1.0, 1.5, 2.0)
_HORIZONS = (0.25, 0.5, 1.0)
_LOST = 4.0
_STAGES, _ITERATIONS = 6, 25
# Change of the search coordinates, which are of order 1, that is only rounding.
_CLOSE = 1e-8
# Relative fall of the loss below which a step is not worth another: with 1e4
# samples a tenth of a standard error.
_FLAT = 1e-6
# Fall of the loss for which a search goes on from start states found anew.
_WORTH = 1.0


class Model(NamedTuple):
    """What is run: an axis, and how much later than recorded the input acts."""

    axis: FrictionAxis
    shift: float


@dataclass(frozen=True, eq=False)
class Part:
    """Errors of one record's windows at one point of the search.

    Attributes
    ----------
    errors : ndarray, shape (n,)
        Model less measured position, from the corrected starts.
    by_x, by_v : ndarray, shape (n,)
        Change of the errors with the start state.
    starts : ndarray, shape (2, nwindows)
        Corrections of the start states.
    costs : ndarray, shape (nwindows,)
        Sum of squares over scale^2, and what the corrections cost.
    """

    errors: FloatArray
    by_x: FloatArray
    by_v: FloatArray
    starts: FloatArray
    costs: FloatArray


class Problem:
    """Windowed free runs of one or more records as a least-squares problem.

    Parameters
    ----------
    axis : FrictionAxis
        Axis that holds what is not free.
    parameters : sequence of Parameter
        Free parameters.
    windows : sequence of Windows
        One entry for each record.
    """

    def __init__(
        self, axis: FrictionAxis, parameters: Sequence[Parameter], windows: Sequence[Windows]
    ) -> None:
        self.axis = axis
        self.parameters = tuple(parameters)
        self.names = [p.name for p in self.parameters]
        self.windows = tuple(windows)
        # Known noise bounds the error from below, per record.
        self.floors = [max(w.record.noise, _ROUNDING * w.record.range) for w in self.windows]
        self.scales = list(self.floors)
        self.steps = np.full(len(self.parameters), _STEP)
        # Chords over break-aways lead out of the many valleys that they make; near
        # the end of the search only true slopes count.
        self.far = False
        self.low = np.array([p.search(p.low) if p.low > -np.inf else -np.inf for p in parameters])
        self.high = np.array([p.search(p.high) if p.high < np.inf else np.inf for p in parameters])

    def values(self, z: FloatArray) -> FloatArray:
        """Values of the parameters at search coordinates."""
        return np.array([p.value(c) for p, c in zip(self.parameters, z, strict=True)])

    def model_at(self, z: FloatArray) -> Model:
        """Axis and time shift of the input at search coordinates.

        Raises
        ------
        ValueError
            If there is no such axis: a Coulomb map may turn negative.
        """
        given = dict(zip(self.names, self.values(z).tolist(), strict=True))
        shift = given.pop(SHIFT, 0.0)
        return Model(with_values(self.axis, list(given), list(given.values())), shift)

    def parts(self, z: FloatArray, near: Sequence[Part] | None = None) -> list[Part]:
        """Errors at a point, one entry for each record.

        Parameters
        ----------
        z : ndarray, shape (nparameters,)
        near : sequence of Part, optional
            `parts` at a point nearby, whose start states are tried too.
        """
        model = self.model_at(z)
        return [
            self._part(model, i, None if near is None else near[i].starts)
            for i in range(len(self.windows))
        ]

    def _part(self, model: Model, i: int, near: FloatArray | None) -> Part:
        w = self.windows[i]
        whole, lost = np.ones(int(w.edges[-1])), np.ones(len(w), bool)
        starts = np.zeros((2, len(w)))
        if near is not None:
            closer = self._at(model, i, near)[1] < self._at(model, i, starts)[1]
            starts = np.where(closer, near, starts)
        found = self._descend(model, i, starts, lost, whole)
        if near is not None:
            lost = found.costs > w.samples + _LOST * np.sqrt(w.samples)
        if lost.any():
            other = self._search(model, i, lost)
            better = lost & (other.costs < found.costs)
            chosen = w.spread(better)
            for name in ("errors", "by_x", "by_v"):
                getattr(found, name)[chosen] = getattr(other, name)[chosen]
            found.starts[:, better] = other.starts[:, better]
            found.costs[better] = other.costs[better]
        return found

    def _search(self, model: Model, i: int, active: NDArray[np.bool_]) -> Part:
        """Start states looked for at several speeds, over longer and longer runs.

        A run that starts inside the Stribeck peak magnifies its first error by
        orders of magnitude, one that starts at rest may miss a creeping motion
        for good: over a whole window a descent from the smoothed state ends in
        a minimum next to it, with an error far above the noise.
        """
        w = self.windows[i]
        starts, least = np.zeros((2, len(w))), np.full(len(w), np.inf)
        position = np.arange(int(w.edges[-1])) - w.spread(w.edges[:-1])
        seen = [(position < part * w.spread(w.samples)).astype(float) for part in _HORIZONS]
        for side in _SIDES:
            tried = np.array([np.zeros(len(w)), side * w.v0_error])
            costs = self._at(model, i, tried, seen[0], active)[1]
            better = active & above(least, costs + SQUARES)
            starts[:, better], least[better] = tried[:, better], costs[better]
        for one in seen:
            found = self._descend(model, i, starts, active, one)
            starts = found.starts
        return found

    def _at(
        self,
        model: Model,
        i: int,
        starts: FloatArray,
        seen: FloatArray | None = None,
        active: NDArray[np.bool_] | None = None,
    ) -> tuple[FloatArray, FloatArray]:
        """Errors of the samples seen, and costs of the windows, from given starts."""
        w = self.windows[i]
        errors = w.run(model.axis, model.shift, starts[0], starts[1], active) - w.record.x
        if seen is not None:
            errors *= seen
        squares = w.samples * w.mean_squares(errors) / self.scales[i] ** 2
        prior = (starts[0] / w.x0_error) ** 2 + (starts[1] / w.v0_error) ** 2
        return errors, np.asarray(squares + prior)

    def _descend(
        self,
        model: Model,
        i: int,
        starts: FloatArray,
        active: NDArray[np.bool_],
        seen: FloatArray,
    ) -> Part:
        """Most likely start states of the active windows, near given ones."""
        w = self.windows[i]
        starts, steps, active = starts.copy(), np.empty((2, len(w))), active.copy()
        errors, costs = self._at(model, i, starts, seen, active)
        by_x, by_v = np.zeros_like(errors), np.zeros_like(errors)
        for _ in range(_START_STEPS):
            chosen = w.spread(active)
            for by, row, size in ((by_x, 0, w.x0_error), (by_v, 1, w.v0_error)):
                moved = starts.copy()
                moved[row] += _START_SLOPE * size
                change = self._at(model, i, moved, seen, active)[0] - errors
                by[chosen] = (change / w.spread(_START_SLOPE * size))[chosen]
            start_steps(
                w.edges, errors, by_x, by_v, starts, self.scales[i], w.x0_error, w.v0_error, steps
            )
            # Near a break-away a slope may mislead: shorten the step, or stay.
            searching = active.copy()
            active[:] = False
            for part in (1.0, 0.25):
                tried = starts + part * steps * searching
                new, new_costs = self._at(model, i, tried, seen, searching)
                better = searching & (new_costs < costs)
                active |= better & (new_costs < costs - _START_FALL)
                chosen = w.spread(better)
                errors[chosen] = new[chosen]
                starts[:, better], costs[better] = tried[:, better], new_costs[better]
                searching &= ~better
                if not searching.any():
                    break
            if not active.any():
                break
        return Part(errors, by_x, by_v, starts, costs)

    def loss(self, parts: Sequence[Part]) -> float:
        """Sum over the windows of n c^2 log(1 + cost/(n c^2))."""
        return float(
            sum(
                np.sum(w.samples * _ROBUST**2 * np.log1p(p.costs / (w.samples * _ROBUST**2)))
                for w, p in zip(self.windows, parts, strict=True)
            )
        )

    def narrow(self, z: FloatArray) -> bool:
        """Lower the scale to the present error; whether that changed much.

        The scale of a record is an upper quantile of the errors of its windows
        that move.
        """
        changed = False
        for i, (w, part) in enumerate(zip(self.windows, self.parts(z), strict=True)):
            rms = np.sqrt(w.mean_squares(part.errors))
            starts = w.edges[:-1]
            travel = np.maximum.reduceat(w.record.x, starts) - np.minimum.reduceat(
                w.record.x, starts
            )
            moving = above(travel, 4.0 * self.floors[i], NEAR * w.record.range)
            scale = float(np.quantile(rms[moving], _TYPICAL)) if moving.any() else 0.0
            scale = max(scale, self.floors[i])
            changed |= not 0.8 * self.scales[i] < scale < 1.25 * self.scales[i]
            self.scales[i] = scale
        return changed

    def window_terms(self, z: FloatArray, parts: Sequence[Part]) -> tuple[FloatArray, FloatArray]:
        """Weighted gradient and normal matrix of every window, in a row.

        Parameters
        ----------
        z : ndarray, shape (nparameters,)
        parts : sequence of Part
            `parts` at z.

        Returns
        -------
        gradients : ndarray, shape (nwindows, nparameters)
        normals : ndarray, shape (nwindows, nparameters, nparameters)
        """
        here, ends = self.model_at(z), [self._ends(z, j) for j in range(z.size)]
        gradients, normals = [], []
        for i, (w, part) in enumerate(zip(self.windows, parts, strict=True)):
            base = w.run(*here, *part.starts)
            slopes = np.empty((z.size, int(w.edges[-1])))
            for j, both in enumerate(ends):
                sides = [
                    (w.run(*model, *part.starts) - base) / step
                    for model, step in both
                    if step != 0.0
                ]
                slopes[j] = np.mean(sides, axis=0) if self.far and sides else _slope(w, sides)
            g, h = np.empty((len(w), z.size)), np.empty((len(w), z.size, z.size))
            normal_terms(
                w.edges, part.errors, slopes, part.by_x, part.by_v, part.starts,
                self.scales[i], w.x0_error, w.v0_error, g, h,
            )  # fmt: skip
            weight = 1.0 / (1.0 + part.costs / (w.samples * _ROBUST**2))
            gradients.append(g * weight[:, None])
            normals.append(h * weight[:, None, None])
        return np.concatenate(gradients), np.concatenate(normals)

    def refine(self, normal: FloatArray) -> None:
        """Fit the steps of the slopes to how well the coordinates are known."""
        known = 1.0 / np.sqrt(np.maximum(np.diag(normal), 1e-300))
        by_break_away = _STEP if self.far else _BREAK_AWAY_STEP
        least = np.where(np.isin(self.names, _BY_BREAK_AWAY), by_break_away, _SHORT_STEP)
        self.steps = np.clip(5.0 * known, least, _STEP)

    def _ends(self, z: FloatArray, j: int) -> list[tuple[Model, float]]:
        """Models a little below and above in one coordinate, and how far."""
        found = []
        for side in (-1.0, 1.0):
            moved = z.copy()
            moved[j] = min(max(z[j] + side * self.steps[j], self.low[j]), self.high[j])
            try:
                found.append((self.model_at(moved), float(moved[j] - z[j])))
            except ValueError:
                found.append((self.model_at(z), 0.0))
        return found


def _slope(w: Windows, sides: Sequence[FloatArray]) -> FloatArray:
    """Slopes of the errors from differences to both sides.

    Where they disagree, a break-away has moved by a sample on one side: the
    other one, smaller, is the slope (the minmod limiter of hyperbolic schemes).
    """
    if len(sides) < 2:
        return sides[0] if sides else np.zeros(int(w.edges[-1]))
    mean = 0.5 * (sides[0] + sides[1])
    sizes = [np.sqrt(w.mean_squares(one)) for one in sides]
    for one, size, other in ((sides[0], *sizes), (sides[1], *sizes[::-1])):
        chosen = w.spread(_JUMP * size < other)
        mean[chosen] = one[chosen]
    return np.asarray(mean)


def minimise(problem: Problem, z: FloatArray) -> FloatArray:
    """Fit from one start: Levenberg-Marquardt, the loss narrowed in stages.

    Each stage takes its scale from where the one before ended, so the loss
    narrows from the error at the start down to what the data allow.

    Returns
    -------
    ndarray, shape (nparameters,)
    """
    z = np.clip(z, problem.low, problem.high)
    rugged = bool(np.any(np.isin(problem.names, _BY_BREAK_AWAY)))
    for problem.far in (True, False) if rugged else (False,):
        loss = np.inf
        for stage in range(_STAGES):
            changed = problem.narrow(z)
            parts = problem.parts(z)
            if stage > 0 and not changed and problem.loss(parts) > loss - _WORTH:
                break
            z, loss = _levenberg(problem, z, parts)
    return z


def _levenberg(problem: Problem, z: FloatArray, parts: list[Part]) -> tuple[FloatArray, float]:
    loss = problem.loss(parts)
    damping = 1e-3
    for _ in range(_ITERATIONS):
        gradients, normals = problem.window_terms(z, parts)
        g, h = gradients.sum(axis=0), normals.sum(axis=0)
        problem.refine(h)
        # A coordinate at its bound that would leave it stays there.
        held = ((z <= problem.low) & (g > 0.0)) | ((z >= problem.high) & (g < 0.0))
        held |= np.diag(h) <= 0.0
        free = np.flatnonzero(~held)
        if free.size == 0:
            return z, loss
        inner = h[np.ix_(free, free)]
        while True:
            damped = inner + damping * np.diag(np.diag(inner))
            new = z.copy()
            new[free] -= np.linalg.lstsq(damped, g[free], rcond=1e-12)[0]
            new = np.clip(new, problem.low, problem.high)
            try:
                new_parts = problem.parts(new, parts)
                new_loss = problem.loss(new_parts)
            except ValueError:
                new_loss = np.inf
            step = float(np.max(np.abs(new - z)))
            if new_loss < loss:
                damping = max(0.1 * damping, 1e-9)
                break
            damping *= 10.0
            if step < _CLOSE or damping > 1e9:
                return z, loss
        fall = loss - new_loss
        z, parts, loss = new, new_parts, new_loss
        if step < _CLOSE or fall < _FLAT * loss:
            return z, loss
    return z, loss
