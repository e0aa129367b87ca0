"""Least squares over windowed free runs, with the start states eliminated."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dryfric_control.compiled.windowed_runs import Evaluation, normal_terms
from dryfric_control.estimation.parameters import SHIFT, Parameter, values_of, with_values
from dryfric_control.estimation.stiffness import stiffness
from dryfric_control.estimation.windows import Windows, no_corrections, positions
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.ties import SQUARES, above

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

# Relative change of a base parameter up to which the cost stays small, and the cost factor
# of a larger one in units of chi^2 (Cauchy prior: one large change is likelier than several
# medium ones).  Set by `benchmarks/diagnosis.py`, condition off.
BASE_SPREAD, BASE_COST = 0.02, 3.0
# Largest difference step for slopes, in search coordinates of order 1: a wider one would
# exceed the resolution of a fit (`benchmarks/identification.py coverage`).
_WIDEST = 2e-3
# Factor by which an elastic part that is too stiff already may become stiffer.
_STIFFER = 1.5
# Ratio of the one-sided slopes' sizes beyond which the larger one contains a jump
# (`benchmarks/identification.py stribeck`).
_JUMP = 3.0
# The scale of the errors is this quantile of the moving windows' RMS errors
# (`benchmarks/diagnosis.py`, `benchmarks/identification.py coverage`).
_TYPICAL = 0.8
# Largest number of stages in which a fit's scale is lowered, each from the end of the previous
# one; no further stage if the scale ratio lies in this range and the loss falls by less than
# _WORTH (`benchmarks/identification.py stribeck`).
_STAGES, _SAME_SCALE, _WORTH = 6, (0.8, 1.25), 1.0
# Factor by which a candidate's scale falls (`benchmarks/diagnosis.py`, run times).
_NARROWER = 0.15
# Largest correction of a start state, in its standard deviations.
_FARTHEST = 100.0
# Start states of a fit, for all windows at once: largest number of steps, fall of a window's
# cost that justifies another, difference step over the start's standard deviation, fractions
# of a step that are tried.  The search begins at the velocities _SIDES, in standard deviations,
# and extends over the fractions _HORIZONS of the window; during a descent only windows are
# searched again whose cost exceeds that of noise by _LOST sqrt(samples), about three of its
# standard deviations (`benchmarks/identification.py stribeck`).
_START_STEPS, _START_FALL, _START_SLOPE, _START_PARTS = 10, 0.02, 0.01, (1.0, 0.25)
_SIDES = (-2.0, -1.5, -1.0, -0.5, 0.0, 0.5, 1.0, 1.5, 2.0)
_HORIZONS = (0.25, 0.5, 1.0)
_LOST = 4.0


class Options(NamedTuple):
    """Schedule of a descent by `levenberg`.

    Attributes
    ----------
    iterations : int
        Largest number of steps.
    refused : int
        Number of successive rejected steps that ends the descent.
    damping : tuple of float
        Smallest and largest damping; the initial one is 1e-3.
    reach : float
        Largest step of a coordinate, or the coordinate's magnitude if that is larger.
    scaled : bool
        Whether the normal matrix is scaled to a unit diagonal.
    close : tuple of float
        Step size that ends the descent, in search coordinates of order 1 and, after a
        rejected step, in standard errors.
    flat : tuple of float
        Fall of the loss that ends the descent, in units of chi^2 and relative.
    width : float
        Difference step for slopes, in standard errors.
    least : tuple of float
        Smallest difference step, of smooth coordinates and of those that act only at
        breakaway.
    sides : int
        1: one-sided differences.  2: both sides; where they disagree, the smaller.
        3: central differences, which lead out of the local minima caused by breakaways.
    rounds : int or None
        Rounds of the search for start states, window by window, from the prediction of
        the slopes.  None: all windows at once, with a new search for start states.
    """

    iterations: int
    refused: int
    damping: tuple[float, float]
    reach: float
    scaled: bool
    close: tuple[float, float]
    flat: tuple[float, float]
    width: float
    least: tuple[float, float]
    sides: int
    rounds: int | None


#: Schedule of `fit` and `identify_*`, to convergence: with 1e4 samples a relative fall of
#: 1e-6 is a tenth of a standard error (`benchmarks/identification.py coverage`).
FIT = Options(
    iterations=25, refused=100, damping=(1e-9, 1e9), reach=np.inf, scaled=False,
    close=(1e-8, 0.0), flat=(0.0, 1e-6), width=5.0, least=(5e-5, 5e-4), sides=2, rounds=None,
)  # fmt: skip
#: The same far from the optimum, where breakaways cause many local minima.
FAR = FIT._replace(least=(5e-5, _WIDEST), sides=3)
#: Quick schedule for the candidates of a diagnosis (`benchmarks/diagnosis.py`).
CANDIDATE = Options(
    iterations=4, refused=4, damping=(1e-6, np.inf), reach=0.5, scaled=True,
    close=(0.0, 1e-2), flat=(0.1, 1e-4), width=3.0, least=(2e-5, _WIDEST), sides=1, rounds=0,
)  # fmt: skip


class Model(NamedTuple):
    """An axis, and the time by which the input acts later than recorded [s]."""

    axis: FrictionAxis
    shift: float


class Problem:
    """An axis with free parameters, as windowed free runs of one or more records.

    Parameters
    ----------
    axis : FrictionAxis
        Axis with the values of all fixed parameters.
    parameters : sequence of Parameter
        Free parameters.
    windows : sequence of Windows
        One entry for each record.
    believed : mapping of str to float, optional
        Nominal values of base parameters; a free one that is off costs
        3 log(1 + (relative change/0.02)^2), see `prior`.
    bounds : tuple of ndarray, shape (nparameters,), optional
        Lowest and highest search coordinates.  Default: of the parameters.
    tolerance : mapping of str to float, optional
        Relative standard deviations of the values that the axis has.

    Attributes
    ----------
    scales : list of float
        Standard deviation of the errors in each record, at least the noise.
    active : list of ndarray of bool
        Windows of each record that are used; initially all.
    steps : ndarray, shape (nparameters,)
        Difference steps of the coordinates for slopes.
    until : float
        Reading of `time.monotonic` at which a descent stops.
    """

    def __init__(
        self,
        axis: FrictionAxis,
        parameters: Sequence[Parameter],
        windows: Sequence[Windows],
        believed: Mapping[str, float] | None = None,
        bounds: tuple[FloatArray, FloatArray] | None = None,
        tolerance: Mapping[str, float] | None = None,
    ) -> None:
        self.axis = axis
        self.parameters = tuple(parameters)
        self.names = [p.name for p in self.parameters]
        self.breaks_away = np.array([p.breaks_away for p in self.parameters], bool)
        self.windows = tuple(windows)
        self.scales = [w.floor for w in self.windows]
        self.active = [np.ones(len(w), bool) for w in self.windows]
        self._stiff = [max(1.0, _STIFFER * stiffness(axis, w.record.dt)) for w in self.windows]
        self.steps = np.full(len(self.parameters), _WIDEST)
        self.until = math.inf
        self.low, self.high = search_bounds(self.parameters) if bounds is None else bounds
        known = {} if believed is None else believed
        self._believed = [
            (i, known[n]) for i, n in enumerate(self.names) if known.get(n, 0.0) > 0.0
        ]

        self._tolerance = []
        for name, share in (tolerance or {}).items():
            if name in self.names:
                i = self.names.index(name)
                now = float(values_of(axis, [name])[0])
                if now != 0.0:
                    self._tolerance.append((i, now, share * abs(now)))

    @property
    def start(self) -> FloatArray:
        """Search coordinates of the axis as it stands."""
        values = values_of(self.axis, self.names).tolist()
        return self.search(dict(zip(self.names, values, strict=True)))

    @property
    def rugged(self) -> NDArray[np.int64]:
        """Coordinates that act only at breakaway: the loss has many local minima."""
        return np.flatnonzero(self.breaks_away)

    def search(self, values: Mapping[str, float]) -> FloatArray:
        """Search coordinates of values, within the bounds."""
        z = np.array([p.search(values[p.name]) for p in self.parameters])
        return np.clip(z, self.low, self.high)

    def values(self, z: FloatArray) -> dict[str, float]:
        """Values of the parameters at search coordinates."""
        return {p.name: p.value(c) for p, c in zip(self.parameters, z, strict=True)}

    def model_at(self, z: FloatArray) -> Model:
        """Axis and time shift of the input at search coordinates.

        Raises
        ------
        ValueError
            If there is no such axis: a Coulomb map may turn negative.  If an elastic part
            has become stiffer than the samples show.
        """
        given = self.values(z)
        shift = given.pop(SHIFT, 0.0)
        axis = with_values(self.axis, list(given), list(given.values()))
        if any(
            stiffness(axis, w.record.dt) > m for w, m in zip(self.windows, self._stiff, strict=True)
        ):
            raise ValueError("an elastic part far too stiff to be seen at this sampling time")
        return Model(axis, shift)

    def axis_at(self, z: FloatArray) -> FrictionAxis:
        """Axis at search coordinates; ValueError where there is none."""
        return self.model_at(z).axis

    def prior(self, z: FloatArray) -> tuple[float, FloatArray, FloatArray]:
        """Cost of the changes of base parameters, with gradient/2 and curvature/2."""
        total, g, h = 0.0, np.zeros(z.size), np.zeros(z.size)
        for i, believed in self._believed:
            p = self.parameters[i]
            value = p.value(z[i])
            change = spreads_off(value, believed)
            slope = p.slope(value) / believed / BASE_SPREAD
            total += base_cost(change)
            weight = BASE_COST / (1.0 + change**2)
            g[i], h[i] = weight * change * slope, weight * slope**2
        for i, now, spread in self._tolerance:
            p = self.parameters[i]
            value = p.value(z[i])
            off, slope = (value - now) / spread, p.slope(value) / spread
            total += off**2
            g[i] += off * slope
            h[i] += slope**2
        return float(total), g, h

    def evaluate(
        self,
        z: FloatArray,
        options: Options = FIT,
        near: Sequence[FloatArray] | None = None,
    ) -> list[Evaluation]:
        """Errors at a point, one entry for each record.

        Parameters
        ----------
        z : ndarray, shape (nparameters,)
        options : Options, optional
        near : sequence of ndarray, shape (3, nwindows), optional
            Start states from which the search begins.
        """
        model, found = self.model_at(z), []
        for i, (w, active, scale) in enumerate(
            zip(self.windows, self.active, self.scales, strict=True)
        ):
            starts = None if near is None else near[i]
            if options.rounds is None:
                found.append(_Together(w, model, scale).search(starts))
            else:
                found.append(
                    w.evaluate(model.axis, active, scale, starts, options.rounds, shift=model.shift)
                )
        return found

    def loss(self, z: FloatArray, at: Sequence[Evaluation]) -> float:
        """Sum over the windows of n c^2 log(1 + cost/(n c^2)), and the prior."""
        rows = zip(self.windows, at, self.active, strict=True)
        return sum(w.loss(one.costs, active) for w, one, active in rows) + self.prior(z)[0]

    def scale_of(self, i: int, at: Evaluation) -> float:
        """Upper quantile of the errors of record i in its windows that move."""
        w = self.windows[i]
        rms = np.sqrt(w.mean_squares(at.errors))[self.active[i] & w.moving]
        return float(np.quantile(rms, _TYPICAL)) if rms.size else 0.0

    def narrow(self, z: FloatArray) -> bool:
        """Set the scales to the present errors; whether one changed much."""
        changed = False
        for i, one in enumerate(self.evaluate(z)):
            scale = max(self.scale_of(i, one), self.windows[i].floor)
            least, most = (part * self.scales[i] for part in _SAME_SCALE)
            changed |= not least < scale < most
            self.scales[i] = scale
        return changed

    def terms(
        self, z: FloatArray, at: Sequence[Evaluation], options: Options = FIT
    ) -> tuple[FloatArray, FloatArray, list[FloatArray]]:
        """Weighted gradient and normal matrix of every window, all records in sequence.

        Parameters
        ----------
        z : ndarray, shape (nparameters,)
        at : sequence of Evaluation
            `evaluate` at z.
        options : Options, optional

        Returns
        -------
        gradients : ndarray, shape (nwindows, nparameters)
        normals : ndarray, shape (nwindows, nparameters, nparameters)
            Without the prior; zero for windows that are not used.
        back : list of ndarray, shape (nwindows, 2, nparameters + 1)
            Dependence of the start states on the parameters, see `normal_terms`.
        """
        ends = [self._ends(z, j, options) for j in range(z.size)]
        gradients, normals, back = [], [], []
        for i, (w, one) in enumerate(zip(self.windows, at, strict=True)):
            slopes = np.zeros((z.size, int(w.edges[-1])))
            base = w.run(*self.model_at(z), *one.starts[:2]) if options.sides > 1 else None
            for j, both in enumerate(ends):
                if base is None:
                    [(model, step)] = both
                    windowed = w.arrays(model.shift)
                    out = positions(model.axis, windowed, self.active[i], one.starts)
                    slopes[j] = (out - w.record.x - one.errors) / step
                else:
                    sides = [
                        (w.run(*model, *one.starts[:2]) - base) / step
                        for model, step in both
                        if step != 0.0
                    ]
                    chord = options.sides == 3 and sides
                    slopes[j] = np.mean(sides, axis=0) if chord else _slope(w, sides)
            g, h, b = normal_terms(w.arrays(), self.active[i], one, slopes, self.scales[i])
            weight = w.weights(one.costs)
            gradients.append(g * weight[:, None])
            normals.append(h * weight[:, None, None])
            back.append(b)
        return np.concatenate(gradients), np.concatenate(normals), back

    def refine(self, normal: FloatArray, options: Options = FIT) -> None:
        """Set the difference steps from the standard errors of the coordinates."""
        size = np.sqrt(np.maximum(np.diag(normal), 1e-300))
        least = np.where(self.breaks_away, options.least[1], options.least[0])
        self.steps = np.clip(options.width / size, least, _WIDEST)

    def _ends(self, z: FloatArray, j: int, options: Options) -> list[tuple[Model, float]]:
        """Models with one coordinate changed to one or both sides, and the changes."""
        if options.sides == 1:
            # Step away from a bound, and from values for which there is no axis.
            side = -1.0 if z[j] + self.steps[j] > self.high[j] else 1.0
            for step in (side * self.steps[j], -side * self.steps[j]):
                there = z.copy()
                there[j] = z[j] + step
                try:
                    return [(self.model_at(there), float(step))]
                except ValueError:
                    if step == -side * self.steps[j]:
                        raise
        found = []
        for side in (-1.0, 1.0):
            moved = z.copy()
            moved[j] = min(max(z[j] + side * self.steps[j], self.low[j]), self.high[j])
            try:
                found.append((self.model_at(moved), float(moved[j] - z[j])))
            except ValueError:
                found.append((self.model_at(z), 0.0))
        return found

    def follow(
        self, at: Sequence[Evaluation], back: Sequence[FloatArray], step: FloatArray
    ) -> list[FloatArray]:
        """Start states after a step of the parameters, to first order."""
        found = []
        for w, one, b in zip(self.windows, at, back, strict=True):
            starts = one.starts.copy()
            starts[:2] += b[:, :, 0].T + (b[:, :, 1:] @ step).T
            for row, error in ((0, w.x0_error), (1, w.v0_error)):
                starts[row] = np.clip(starts[row], -_FARTHEST * error, _FARTHEST * error)
            found.append(starts)
        return found


def search_bounds(parameters: Sequence[Parameter]) -> tuple[FloatArray, FloatArray]:
    """Lowest and highest search coordinates of parameters."""
    low = [p.search(p.low) if p.low > -np.inf else -np.inf for p in parameters]
    high = [p.search(p.high) if p.high < np.inf else np.inf for p in parameters]
    return np.array(low), np.array(high)


def spreads_off(value: float, believed: float) -> float:
    """Deviation of a base parameter in units of BASE_SPREAD, at most 1e100."""
    return min((value / believed - 1.0) / BASE_SPREAD, 1e100)


def base_cost(change: float) -> float:
    """Cost of a base parameter that is off by `change` spreads."""
    return BASE_COST * float(np.log1p(change**2))


def _slope(w: Windows, sides: Sequence[FloatArray]) -> FloatArray:
    """Slopes of the errors from differences to both sides.

    Where they disagree, a breakaway has moved by a sample on one side: the slope is
    the other, smaller one (minmod limiter of hyperbolic schemes).
    """
    if len(sides) < 2:
        return sides[0] if sides else np.zeros(int(w.edges[-1]))
    mean = 0.5 * (sides[0] + sides[1])
    sizes = [np.sqrt(w.mean_squares(one)) for one in sides]
    for one, size, other in ((sides[0], *sizes), (sides[1], *sizes[::-1])):
        chosen = w.spread(_JUMP * size < other)
        mean[chosen] = one[chosen]
    return np.asarray(mean)


class Descent(NamedTuple):
    """End of a descent: coordinates, errors there, loss."""

    z: FloatArray
    at: list[Evaluation]
    loss: float


def levenberg(
    problem: Problem, z: FloatArray, options: Options, at: list[Evaluation] | None = None
) -> Descent:
    """Minimise the loss of a problem at its scales by Levenberg-Marquardt.

    Parameters
    ----------
    problem : Problem
    z : ndarray, shape (nparameters,)
        Start, within the bounds.
    options : Options
        The schedule.
    at : list of Evaluation, optional
        `Problem.evaluate` at z.

    Returns
    -------
    Descent
    """
    at = problem.evaluate(z, options) if at is None else at
    loss, damping = problem.loss(z, at), 1e-3
    for _ in range(options.iterations):
        if time.monotonic() > problem.until:
            break
        gradients, normals, back = problem.terms(z, at, options)
        _, prior_g, prior_h = problem.prior(z)
        g, h = gradients.sum(axis=0) + prior_g, normals.sum(axis=0) + np.diag(prior_h)
        if not (np.all(np.isfinite(g)) and np.all(np.isfinite(h))):
            break  # a friction law returns NaN somewhere
        problem.refine(h, options)
        # A coordinate stays at its bound if the step would cross it.
        held = ((z <= problem.low) & (g > 0.0)) | ((z >= problem.high) & (g < 0.0))
        free = np.flatnonzero(~held & (np.diag(h) > 0.0))
        if free.size == 0:
            break
        size = np.sqrt(np.maximum(np.diag(h), 1e-300))
        unit = size[free] if options.scaled else np.ones(free.size)
        inner = h[np.ix_(free, free)] / np.outer(unit, unit)
        diagonal = np.ones(free.size) if options.scaled else np.diag(inner)
        reach = np.maximum(options.reach, np.abs(z))
        better = False
        for _ in range(options.refused):
            damped = inner + damping * np.diag(diagonal)
            new = z.copy()
            new[free] -= np.linalg.lstsq(damped, g[free] / unit, rcond=1e-12)[0] / unit
            # Limit the step to the coordinate's magnitude: slopes are valid only nearby.
            new = np.clip(np.clip(new, z - reach, z + reach), problem.low, problem.high)
            near = [one.starts for one in at]
            if options.rounds is not None:
                near = problem.follow(at, back, new - z)
            try:
                new_at = problem.evaluate(new, options, near)
                new_loss = problem.loss(new, new_at)
            except ValueError:  # a Coulomb map that turns negative
                new_loss = np.inf
            step = np.abs(new - z)
            better = new_loss < loss
            if better:
                damping = max(0.1 * damping, options.damping[0])
                break
            damping *= 10.0
            close = np.max(step) < options.close[0] or np.max(step * size) < options.close[1]
            if close or damping > options.damping[1]:
                break
        if not better:
            break
        fall, z, at, loss = loss - new_loss, new, new_at, new_loss
        if np.max(step) < options.close[0] or fall < options.flat[0] + options.flat[1] * loss:
            break
    return Descent(z, at, loss)


def minimise(problem: Problem, z: FloatArray, least: float = 0.0) -> FloatArray:
    """Fit from one start, with the scale of the loss lowered in stages.

    Each stage takes its scale from the end of the previous one, so that it falls from
    the error at the start to the level that the data allow.  A fall of the loss by
    less than `least`, in units of chi^2, ends a stage.

    Returns
    -------
    ndarray, shape (nparameters,)
    """
    z = np.clip(z, problem.low, problem.high)
    for options in (FAR, FIT) if problem.rugged.size else (FIT,):
        options = options._replace(flat=(least, options.flat[1]))
        loss = np.inf
        for stage in range(_STAGES):
            changed = problem.narrow(z)
            at = problem.evaluate(z)
            if stage > 0 and not changed and problem.loss(z, at) > loss - _WORTH:
                break
            z, _, loss = levenberg(problem, z, options, at)
    return z


def narrowing(problem: Problem, z: FloatArray, active: BoolArray) -> list[float]:
    """Scales of one record from the present error down to the noise."""
    floor = problem.windows[0].floor
    problem.active, problem.scales = [active], [floor]
    near = CANDIDATE._replace(rounds=1)
    scale = problem.scale_of(0, problem.evaluate(np.clip(z, problem.low, problem.high), near)[0])
    found = []
    while scale > floor:
        found.append(scale)
        scale *= _NARROWER
    return [*found, floor]


def through(
    problem: Problem,
    z: FloatArray,
    active: BoolArray,
    scales: Sequence[float],
    options: Options,
    starts: FloatArray | None = None,
) -> Descent:
    """Descents on windows of one record through falling scales, from given start states."""
    problem.active, problem.scales = [active], [scales[-1]]
    z = np.clip(z, problem.low, problem.high)
    near = None if starts is None else [starts]
    if z.size == 0:
        at = problem.evaluate(z, options._replace(rounds=2), near)
        return Descent(z, at, problem.loss(z, at))
    first = options._replace(rounds=max(options.rounds or 0, 1))
    for scale in scales:
        problem.scales = [scale]
        at = problem.evaluate(z, first, near)
        found = levenberg(problem, z, options, at)
        z, near = found.z, [one.starts for one in found.at]
    return found


class _Together(NamedTuple):
    """Most likely start states of one record's windows, all searched at once."""

    windows: Windows
    model: Model
    scale: float

    def search(self, near: FloatArray | None) -> Evaluation:
        """Start states near given ones; a new search in windows where these are bad."""
        w = self.windows
        whole, lost = np.ones(int(w.edges[-1])), np.ones(len(w), bool)
        starts = no_corrections(len(w))
        if near is not None:
            starts = np.where(self._at(near)[1] < self._at(starts)[1], near, starts)
        found = self._descend(starts, lost, whole)
        if near is not None:
            lost = found.costs > w.samples + _LOST * np.sqrt(w.samples)
        if lost.any():
            other = self._anew(lost)
            better = lost & (other.costs < found.costs)
            chosen = w.spread(better)
            for mine, its in zip(found[:3], other[:3], strict=True):
                mine[chosen] = its[chosen]
            found.starts[:, better] = other.starts[:, better]
            found.costs[better] = other.costs[better]
        return found

    def _anew(self, active: BoolArray) -> Evaluation:
        """New search for start states, from several velocities and over growing horizons.

        A run that starts inside the Stribeck peak magnifies its initial error by
        orders of magnitude; one that starts at rest may miss a creeping motion
        entirely.  Over a whole window a descent from the smoothed state would end in
        a nearby local minimum, with an error far above the noise.
        """
        w = self.windows
        starts, least = no_corrections(len(w)), np.full(len(w), np.inf)
        position = np.arange(int(w.edges[-1])) - w.spread(w.edges[:-1])
        seen = [(position < part * w.spread(w.samples)).astype(float) for part in _HORIZONS]
        for side in _SIDES:
            tried = no_corrections(len(w))
            tried[1] = side * w.v0_error
            costs = self._at(tried, seen[0], active)[1]
            better = active & above(least, costs + SQUARES)
            starts[:, better], least[better] = tried[:, better], costs[better]
        for one in seen:
            found = self._descend(starts, active, one)
            starts = found.starts
        return found

    def _at(
        self, starts: FloatArray, seen: FloatArray | None = None, active: BoolArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Errors weighted by `seen`, and costs of the windows, from given starts."""
        w = self.windows
        errors = w.run(*self.model, starts[0], starts[1], active) - w.record.x
        if seen is not None:
            errors *= seen
        squares = w.samples * w.mean_squares(errors) / self.scale**2
        prior = (starts[0] / w.x0_error) ** 2 + (starts[1] / w.v0_error) ** 2
        return errors, np.asarray(squares + prior)

    def _descend(self, starts: FloatArray, active: BoolArray, seen: FloatArray) -> Evaluation:
        """Most likely start states of the active windows, near given ones."""
        w, none = self.windows, np.empty((0, int(self.windows.edges[-1])))
        starts, active = starts.copy(), active.copy()
        errors, costs = self._at(starts, seen, active)
        at = Evaluation(errors, np.zeros_like(errors), np.zeros_like(errors), starts, costs)
        for _ in range(_START_STEPS):
            chosen = w.spread(active)
            for by, row, size in ((at.by_x, 0, w.x0_error), (at.by_v, 1, w.v0_error)):
                moved = starts.copy()
                moved[row] += _START_SLOPE * size
                change = self._at(moved, seen, active)[0] - errors
                by[chosen] = (change / w.spread(_START_SLOPE * size))[chosen]
            steps = normal_terms(w.arrays(), active, at, none, self.scale)[2][:, :, 0].T
            # Near a breakaway a slope may be wrong: shorten the step, or make none.
            searching = active.copy()
            active[:] = False
            for part in _START_PARTS:
                tried = starts.copy()
                tried[:2] += part * steps * searching
                new, new_costs = self._at(tried, seen, searching)
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
        return at
