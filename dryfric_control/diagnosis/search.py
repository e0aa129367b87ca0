"""Fit of one hypothesis: free runs on chosen windows, errors narrowed to the noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dryfric_control.compiled.windowed_runs import moved, normal_terms, project
from dryfric_control.estimation.parameters import Parameter, with_values
from dryfric_control.estimation.windows import Windows
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.ties import NEAR, SQUARES, above, ranked

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

# A window pulls in full up to this multiple of the scale of its errors.
ROBUST = 2.0
# Parts of the windows' errors from which the scale starts, and by which it falls.
_TYPICAL, _NARROWER = 0.8, 0.15
# Relative change of base parameters that is nothing to wonder about, and what
# a larger one costs in units of chi^2 (Cauchy's prior: one large change is
# likelier than several middling ones).
BASE_SPREAD, BASE_COST = 0.02, 3.0
# Step of a search coordinate of order 1, for slopes: several standard errors.
_STEPS = (2e-5, 2e-3)
# What acts by break-away alone needs a step that moves one over a sample.
_BY_BREAK_AWAY = ("stribeck.", "dwell_time.", "stick_speed")
# Other speeds at a start, in multiples of its error.
_OFFSETS = np.array([-0.3, 0.3, -1.0, 1.0, -2.0, 2.0])
# A drive later than this is no drive for a position loop [s].
_LATE, _LATEST = ("input_delay.delay", "actuator_lag.time_constant"), 0.1
# Errors of a start beyond which a correction of it is no correction.
_FARTHEST = 100.0
# Parts of the mass that may be a load.
_SHARES = (0.05, 0.95)
# Spread of a random search of rugged coordinates of order 1.
_RADIUS = 0.3
# Its first points, which show where in the record it matters.
_LEARNT = 10
# Steps refused in a row that end a search.
_REFUSED = 4
# Longest step of a search coordinate of order 1.
_REACH = 0.5
_ROUNDS = 2  # of new slopes with the start state


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Errors of the active windows for one axis.

    Attributes
    ----------
    errors, by_x, by_v : ndarray, shape (n,)
        Model less measured position, and its slopes with the start state.
    starts : ndarray, shape (3, nwindows)
        Corrections of the start states; place of a load in its play (-1 to 1)
        where it does not go on from the window before, else NaN.
    costs : ndarray, shape (nwindows,)
        Sum of squares over scale^2, and what the corrections cost.
    """

    errors: FloatArray
    by_x: FloatArray
    by_v: FloatArray
    starts: FloatArray
    costs: FloatArray


class Bench:
    """A record cut into windows, on which hypotheses are run.

    Parameters
    ----------
    windows : Windows
        The windows.
    floor : float, optional
        Default: from the record.

    Attributes
    ----------
    floor : float
        Standard deviation of the readings' noise, quantisation included.
    """

    def __init__(self, windows: Windows, floor: float | None = None) -> None:
        self.windows = windows
        record = windows.record
        self.floor = max(record.noise, 1e-9 * record.range) if floor is None else floor
        self.samples = windows.samples.astype(float)
        starts = windows.edges[:-1]
        reach = np.maximum.reduceat(record.x, starts) - np.minimum.reduceat(record.x, starts)
        self.moving = above(reach, 4.0 * self.floor, NEAR * record.range)

    def sieve(self, active: BoolArray, scores: FloatArray, most: int = 14) -> BoolArray:
        """Some of the windows: the worst, where what is rare shows, and others evenly."""
        picked = np.zeros(active.size, bool)
        known = np.flatnonzero(active)
        picked[known[ranked(-scores[known], SQUARES)[: most // 2]]] = True
        others = np.flatnonzero(active & self.moving & ~picked)
        if others.size:
            some = np.unique(np.linspace(0, others.size - 1, most - most // 2).astype(int))
            picked[others[some]] = True
        return picked

    def evaluate(
        self,
        axis: FrictionAxis,
        active: BoolArray,
        scale: float | None = None,
        starts: FloatArray | None = None,
        rounds: int = _ROUNDS,
        thorough: bool = False,
    ) -> Evaluation:
        """Run an axis over windows, each from its most likely start state.

        `thorough`: windows that end far above the scale are searched again,
        from other speeds.
        """
        w, record = self.windows, self.windows.record
        arrays = axis.arrays(record.dt)
        n, nw = int(w.edges[-1]), len(w)
        if starts is None:
            starts = np.zeros((3, nw))
            starts[2] = np.nan
        else:
            starts = starts.copy()
        result = Evaluation(np.zeros(n), np.zeros(n), np.zeros(n), starts, np.zeros(nw))
        project(
            arrays.numbers, arrays.integers, arrays.memory, linked(axis), uniform(axis), record.u,
            record.x, float(record.t[0]), record.dt, w.hold == "first", w.edges, w.x0, w.v0,
            w.x0_error, w.v0_error, w.rest, active, self.floor if scale is None else scale, rounds,
            _OFFSETS if thorough else _OFFSETS[:0],
            result.starts, result.errors, result.by_x, result.by_v, result.costs,
        )  # fmt: skip
        return result

    def slope(
        self, axis: FrictionAxis, active: BoolArray, at: Evaluation, width: float, out: FloatArray
    ) -> None:
        """Slopes of the errors with a parameter, moved by `width` in `axis`."""
        w, record = self.windows, self.windows.record
        arrays = axis.arrays(record.dt)
        moved(
            arrays.numbers, arrays.integers, arrays.memory, linked(axis), record.u, record.x,
            float(record.t[0]), record.dt, w.hold == "first", w.edges, w.x0, w.v0, w.rest,
            active, at.starts, at.errors, width, out,
        )  # fmt: skip

    def loss(self, costs: FloatArray, active: BoolArray) -> float:
        """Sum over the windows of n c^2 log(1 + cost/(n c^2))."""
        n = self.samples[active] * ROBUST**2
        return float(np.sum(n * np.log1p(costs[active] / n)))

    def scores(self, costs: FloatArray) -> FloatArray:
        """log(1 + cost/(n c^2)) of every window: 0.22 at the noise floor."""
        return np.asarray(np.log1p(costs / (self.samples * ROBUST**2)))

    def mean_squares(self, errors: FloatArray) -> FloatArray:
        """Mean square of the errors in each window."""
        return self.windows.mean_squares(errors)


def uniform(axis: FrictionAxis) -> bool:
    """Whether an axis is the same at every position."""
    constant = len(axis.coulomb.plus) == 1 and len(axis.coulomb.minus) == 1
    return constant and not any(e.depends_on_place for e in axis.effects)


def linked(axis: FrictionAxis) -> bool:
    """Whether windows hand on an internal memory; a drive's is known from its command."""
    return any(e.remembers and e.action not in ("delay", "lag") for e in axis.effects)


def spreads_off(value: float, believed: float) -> float:
    """How many usual spreads a base parameter is off; beyond 1e100 nothing more is said."""
    return min((value / believed - 1.0) / BASE_SPREAD, 1e100)


def base_cost(change: float) -> float:
    """What a base parameter that is so many spreads off costs."""
    return BASE_COST * float(np.log1p(change**2))


class Hypothesis:
    """An axis with free parameters, fitted on chosen windows.

    Parameters
    ----------
    bench : Bench
    axis : FrictionAxis
        Axis that holds what is not free.
    parameters : sequence of Parameter
        Free parameters.
    believed : dict of str to float
        Believed values of those among them that are base parameters.
    """

    def __init__(
        self,
        bench: Bench,
        axis: FrictionAxis,
        parameters: Sequence[Parameter],
        believed: dict[str, float],
    ) -> None:
        self.bench = bench
        self.axis = axis
        self.parameters = tuple(parameters)
        self.names = [p.name for p in parameters]
        self.low = np.array([p.search(p.low) if p.low > -np.inf else -np.inf for p in parameters])
        self.high = np.array([p.search(p.high) if p.high < np.inf else np.inf for p in parameters])
        for i, p in enumerate(self.parameters):
            if p.name in _LATE:
                self.high[i] = p.search(_LATEST)
            if p.name.endswith(".load_fraction"):
                # A load next to nothing is no load but an elastic contact.
                self.low[i], self.high[i] = p.search(_SHARES[0]), p.search(_SHARES[1])
            if 0.0 < p.low < 1e-6 * p.scale and not p.logarithmic:
                # Of what must not vanish, a hundredth of the guess is as good as nothing.
                self.low[i] = p.search(0.01 * p.scale)
                self.high[i] = min(self.high[i], p.search(100.0 * p.scale))
        self._believed = [
            (i, believed[n]) for i, n in enumerate(self.names) if believed.get(n, 0.0) > 0.0
        ]
        rugged = [n.startswith(_BY_BREAK_AWAY) for n in self.names]
        self.least = np.where(rugged, _STEPS[1], _STEPS[0])
        self.steps = np.full(len(self.names), _STEPS[1])

    def axis_at(self, z: FloatArray) -> FrictionAxis:
        """Axis at search coordinates; ValueError where there is none."""
        values = [p.value(c) for p, c in zip(self.parameters, z, strict=True)]
        return with_values(self.axis, self.names, values)

    def search(self, values: dict[str, float]) -> FloatArray:
        """Search coordinates of values, within the bounds."""
        z = np.array([p.search(values[p.name]) for p in self.parameters])
        return np.clip(z, self.low, self.high)

    def values(self, z: FloatArray) -> dict[str, float]:
        """Values at search coordinates."""
        return {p.name: p.value(c) for p, c in zip(self.parameters, z, strict=True)}

    def prior(self, z: FloatArray) -> tuple[float, FloatArray, FloatArray]:
        """What changes of base parameters cost, with gradient/2 and curvature/2."""
        total, g, h = 0.0, np.zeros(z.size), np.zeros(z.size)
        for i, believed in self._believed:
            p = self.parameters[i]
            value = p.value(z[i])
            change = spreads_off(value, believed)
            slope = p.slope(value) / believed / BASE_SPREAD
            total += base_cost(change)
            weight = BASE_COST / (1.0 + change**2)
            g[i], h[i] = weight * change * slope, weight * slope**2
        return float(total), g, h

    def minimise(
        self,
        z: FloatArray,
        active: BoolArray,
        scales: Sequence[float],
        iterations: int,
        starts: FloatArray | None = None,
        rounds: int = 0,
    ) -> tuple[FloatArray, Evaluation, float]:
        """Levenberg-Marquardt, the scale of the errors lowered in steps.

        Returns
        -------
        z : ndarray
            Search coordinates of the end.
        evaluation : Evaluation
            At the last scale.
        loss : float
            At the last scale, prior included.
        """
        z = np.clip(z, self.low, self.high)
        at = None
        loss = np.inf
        if z.size == 0:
            at = self.bench.evaluate(self.axis, active, scales[-1], starts)
            return z, at, self.bench.loss(at.costs, active)
        for scale in scales:
            at = self.bench.evaluate(
                self.axis_at(z), active, scale, starts if at is None else at.starts, max(rounds, 1)
            )
            z, at, loss = self._levenberg(z, active, scale, iterations, at, rounds)
        assert at is not None
        return z, at, loss

    def _levenberg(
        self,
        z: FloatArray,
        active: BoolArray,
        scale: float,
        iterations: int,
        at: Evaluation,
        rounds: int,
    ) -> tuple[FloatArray, Evaluation, float]:
        bench = self.bench
        loss = bench.loss(at.costs, active) + self.prior(z)[0]
        damping = 1e-3
        for _ in range(iterations):
            g, h, back = self.terms(z, active, scale, at)
            g, h = g.sum(axis=0), h.sum(axis=0)
            _, pg, ph = self.prior(z)
            g, h = g + pg, h + np.diag(ph)
            if not (np.all(np.isfinite(g)) and np.all(np.isfinite(h))):
                break  # a law that is not a number somewhere
            size = np.sqrt(np.maximum(np.diag(h), 1e-300))
            self.steps = np.clip(3.0 / size, self.least, _STEPS[1])
            held = ((z <= self.low) & (g > 0.0)) | ((z >= self.high) & (g < 0.0))
            free = np.flatnonzero(~held & (np.diag(h) > 0.0))
            if free.size == 0:
                break
            better = False
            for _ in range(_REFUSED):
                inner = h[np.ix_(free, free)] / np.outer(size[free], size[free])
                inner[np.diag_indices_from(inner)] += damping
                new = z.copy()
                new[free] -= (
                    np.linalg.lstsq(inner, g[free] / size[free], rcond=1e-12)[0] / size[free]
                )
                # No farther than a coordinate's own size: slopes hold nearby only.
                reach = np.maximum(_REACH, np.abs(z))
                new = np.clip(np.clip(new, z - reach, z + reach), self.low, self.high)
                # The start states move along, as far as the slopes tell.
                starts = at.starts.copy()
                starts[:2] += back[:, :, 0].T + (back[:, :, 1:] @ (new - z)).T
                w = bench.windows
                starts[0] = np.clip(starts[0], -_FARTHEST * w.x0_error, _FARTHEST * w.x0_error)
                starts[1] = np.clip(starts[1], -_FARTHEST * w.v0_error, _FARTHEST * w.v0_error)
                try:
                    there = bench.evaluate(self.axis_at(new), active, scale, starts, rounds)
                    new_loss = bench.loss(there.costs, active) + self.prior(new)[0]
                except ValueError:  # a Coulomb map that turns negative
                    new_loss = np.inf
                if new_loss < loss:
                    better = True
                    damping = max(0.1 * damping, 1e-6)
                    break
                damping *= 10.0
                if np.max(np.abs(new - z) * size) < 1e-2:
                    break
            if not better:
                break
            fall, z, at, loss = loss - new_loss, new, there, new_loss
            if fall < 0.1 + 1e-4 * loss:
                break
        return z, at, loss

    @property
    def rugged(self) -> NDArray[np.int64]:
        """Coordinates that act by break-away alone: the loss has many valleys."""
        return np.flatnonzero([n.startswith(_BY_BREAK_AWAY) for n in self.names])

    def scatter(
        self, z: FloatArray, active: BoolArray, starts: FloatArray, tries: int, seed: int = 0
    ) -> tuple[FloatArray, Evaluation]:
        """Random search around a point in its rugged coordinates, ever closer."""
        rng = np.random.default_rng(seed)
        where = self.rugged
        best = self.bench.evaluate(self.axis_at(z), active, None, starts, 1)
        loss = self.bench.loss(best.costs, active)
        radius = _RADIUS
        # Windows in which nothing of this changes anything need not run again.
        some, touched = active, np.zeros_like(active)
        for turn in range(tries):
            there = z.copy()
            there[where] += radius * rng.standard_normal(where.size)
            there = np.clip(there, self.low, self.high)
            at = self.bench.evaluate(self.axis_at(there), some, None, starts, 1)
            new = self.bench.loss(at.costs, some)
            if turn < _LEARNT:
                touched |= at.costs != best.costs
            if new < loss:
                z, best, loss = there, at, new
                radius = min(1.5 * radius, _RADIUS)
            else:
                radius = max(0.94 * radius, 1e-3)
            if turn == _LEARNT - 1 and np.any(touched):
                some = active & touched
                loss = self.bench.loss(best.costs, some)
        return z, self.bench.evaluate(self.axis_at(z), active, None, starts, 1)

    def terms(
        self, z: FloatArray, active: BoolArray, scale: float, at: Evaluation
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Weighted gradient and normal matrix of each window, and how starts follow."""
        bench, w = self.bench, self.bench.windows
        slopes = np.zeros((z.size, int(w.edges[-1])))
        for j in range(z.size):
            there = z.copy()
            # Away from the nearer bound.
            side = -1.0 if z[j] + self.steps[j] > self.high[j] else 1.0
            there[j] += side * self.steps[j]
            try:
                axis = self.axis_at(there)
            except ValueError:
                side = -side
                there[j] = z[j] + side * self.steps[j]
                axis = self.axis_at(there)
            bench.slope(axis, active, at, side * self.steps[j], slopes[j])
        nw = len(w)
        g, h = np.zeros((nw, z.size)), np.zeros((nw, z.size, z.size))
        back = np.zeros((nw, 2, z.size + 1))
        normal_terms(
            w.edges, active, at.errors, slopes, at.by_x, at.by_v, at.starts, scale,
            w.x0_error, w.v0_error, g, h, back,
        )  # fmt: skip
        weight = 1.0 / (1.0 + at.costs / (bench.samples * ROBUST**2))
        return g * weight[:, None], h * weight[:, None, None], back

    def scales(self, z: FloatArray, active: BoolArray) -> list[float]:
        """Scales from the present error down to the floor."""
        bench = self.bench
        at = bench.evaluate(self.axis_at(np.clip(z, self.low, self.high)), active, rounds=1)
        rms = np.sqrt(bench.mean_squares(at.errors))[active & bench.moving]
        scale = float(np.quantile(rms, _TYPICAL)) if rms.size else bench.floor
        found = []
        while scale > bench.floor:
            found.append(scale)
            scale *= _NARROWER
        return [*found, bench.floor]
