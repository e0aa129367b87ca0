"""Least squares over windowed free runs, with the start states projected out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dryfric_control.axis import FrictionAxis
from dryfric_control.identification.parameters import SHIFT, Parameter, with_values
from dryfric_control.identification.run_kernels import normal_terms, start_steps
from dryfric_control.identification.windows import Windows

FloatArray = NDArray[np.float64]

# Change of a search coordinate by which slopes are taken: a few of its standard
# errors within these bounds.  Break-away under a held input moves from sample to
# sample: for what acts by break-away alone a smaller change would see nothing.
_SHORT_STEP, _STEP = 5e-5, 2e-3
_BY_BREAK_AWAY = ("stribeck.excess", "stribeck.speed", "stick_speed")
# The scale of the errors is what this part of the windows stays below, and the
# pull of a window on the parameters fades from a multiple of it: the few windows
# with a mistimed break-away count less, but no whole direction is given up.
_TYPICAL, _ROBUST = 0.8, 2.0
# Error of a free run that the arithmetic itself may make, relative to travel.
_ROUNDING = 1e-9
# Steps towards the most likely start states, worth another where a window's cost
# fell by this; their slopes are taken over a part of the start's error.
_START_STEPS, _START_FALL, _START_SLOPE = 10, 0.02, 0.1
_STAGES, _ITERATIONS = 6, 25
# Change of the search coordinates, which are of order 1, that is only rounding.
_CLOSE = 1e-8
# Relative fall of the loss below which a step is not worth another: with 1e4
# samples a tenth of a standard error.
_FLAT = 1e-6


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

    def parts(self, z: FloatArray) -> list[Part]:
        """Errors at a point, one entry for each record."""
        model = self.model_at(z)
        return [self._part(model, i) for i in range(len(self.windows))]

    def _part(self, model: Model, i: int) -> Part:
        w = self.windows[i]
        x = w.record.x
        starts, steps = np.zeros((2, len(w))), np.empty((2, len(w)))
        errors = w.run(*model) - x
        costs = self._costs(i, errors, starts)
        by_x, by_v = np.empty_like(errors), np.empty_like(errors)
        active = np.ones(len(w), bool)
        for _ in range(_START_STEPS):
            chosen = w.spread(active)
            for by, row, size in ((by_x, 0, w.x0_error), (by_v, 1, w.v0_error)):
                moved = starts.copy()
                moved[row] += _START_SLOPE * size
                change = w.run(model.axis, model.shift, moved[0], moved[1], active) - x - errors
                by[chosen] = (change / w.spread(_START_SLOPE * size))[chosen]
            start_steps(
                w.edges, errors, by_x, by_v, starts, self.scales[i], w.x0_error, w.v0_error, steps
            )
            # Near a break-away a slope may mislead: shorten the step, or stay.
            searching = active.copy()
            active[:] = False
            for part in (1.0, 0.25):
                tried = starts + part * steps * searching
                new = w.run(model.axis, model.shift, tried[0], tried[1], searching) - x
                new_costs = self._costs(i, new, tried)
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

    def _costs(self, i: int, errors: FloatArray, starts: FloatArray) -> FloatArray:
        w = self.windows[i]
        squares = w.samples * w.mean_squares(errors) / self.scales[i] ** 2
        prior = (starts[0] / w.x0_error) ** 2 + (starts[1] / w.v0_error) ** 2
        return np.asarray(squares + prior)

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
            moving = travel > 4.0 * self.floors[i]
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
        ends = [self._ends(z, j) for j in range(z.size)]
        gradients, normals = [], []
        for i, (w, part) in enumerate(zip(self.windows, parts, strict=True)):
            slopes = np.empty((z.size, int(w.edges[-1])))
            for j, (below, above, width) in enumerate(ends):
                slopes[j] = w.run(*above, *part.starts)
                slopes[j] -= w.run(*below, *part.starts)
                slopes[j] /= width
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
        steps = np.clip(5.0 * known, _SHORT_STEP, _STEP)
        self.steps = np.where(np.isin(self.names, _BY_BREAK_AWAY), _STEP, steps)

    def _ends(self, z: FloatArray, j: int) -> tuple[Model, Model, float]:
        """Models a little below and above in one coordinate, and their distance."""
        found = []
        for side in (-1.0, 1.0):
            moved = z.copy()
            moved[j] = min(max(z[j] + side * self.steps[j], self.low[j]), self.high[j])
            try:
                found.append((self.model_at(moved), moved[j]))
            except ValueError:
                found.append((self.model_at(z), z[j]))
        return found[0][0], found[1][0], float(found[1][1] - found[0][1])


def minimise(problem: Problem, z: FloatArray) -> FloatArray:
    """Fit from one start: Levenberg-Marquardt, the loss narrowed in stages.

    Each stage takes its scale from where the one before ended, so the loss
    narrows from the error at the start down to what the data allow.

    Returns
    -------
    ndarray, shape (nparameters,)
    """
    z = np.clip(z, problem.low, problem.high)
    for stage in range(_STAGES):
        if not problem.narrow(z) and stage > 0:
            break
        z = _levenberg(problem, z)
    return z


def _levenberg(problem: Problem, z: FloatArray) -> FloatArray:
    parts = problem.parts(z)
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
            return z
        inner = h[np.ix_(free, free)]
        while True:
            damped = inner + damping * np.diag(np.diag(inner))
            new = z.copy()
            new[free] -= np.linalg.lstsq(damped, g[free], rcond=1e-12)[0]
            new = np.clip(new, problem.low, problem.high)
            try:
                new_parts = problem.parts(new)
                new_loss = problem.loss(new_parts)
            except ValueError:
                new_loss = np.inf
            step = float(np.max(np.abs(new - z)))
            if new_loss < loss:
                damping = max(0.1 * damping, 1e-9)
                break
            damping *= 10.0
            if step < _CLOSE or damping > 1e9:
                return z
        fall = loss - new_loss
        z, parts, loss = new, new_parts, new_loss
        if step < _CLOSE or fall < _FLAT * loss:
            return z
    return z
