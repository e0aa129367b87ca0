"""Fit of an axis to records by the likelihood of a hybrid filter.

Two noises are estimated together with the parameters: a white random force of
intensity q [N^2 s], and noise of the readings with variance R.  An incomplete model
needs a large q, which lowers its likelihood at every sample; so does a model whose
drive has little effect.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dryfric_control.compiled import innovations as hybrid
from dryfric_control.compiled import likelihood as compiled
from dryfric_control.compiled.axis_step import ALLOWED, N_NUMBERS
from dryfric_control.compiled.linear import Recursion, innovation_change
from dryfric_control.compiled.windowed_runs import accelerations
from dryfric_control.estimation.parameters import (
    SHIFT,
    Parameter,
    Scales,
    choose,
    typical,
    values_of,
    with_values,
)
from dryfric_control.estimation.stiffness import stiffness
from dryfric_control.estimation.windows import delay_input
from dryfric_control.model.axis import FrictionAxis, check_pace, inverse_masses
from dryfric_control.model.effects.effect import Inner
from dryfric_control.model.effects.naming import named
from dryfric_control.records.motion import rest_times
from dryfric_control.records.record import Record
from dryfric_control.records.record_checks import estimated_quantum, spread_of

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IndexArray = NDArray[np.intp]

#: Amounts of what a known load may be off, of each record its own: "load_error[0]", ...
LOAD_ERROR = "load_error"
# What a load may be off, of a record whose load is right.
_RIGHT_LOAD = np.zeros((0, 0))
#: Base parameters, which have a prior unless they are known.
BASE = ("mass", "viscous", "coulomb")
#: Prior standard deviation of a base parameter's logarithm: a factor of 2 is two standard
#: deviations.
BASE_LOG_DEVIATION = 0.5 * math.log(2.0)
#: Ratio of a mass to its nominal value: upper bound.
MAX_MASS_RATIO = 4.0
#: Ratio of the nominal value of a mass to that mass: upper bound.
MAX_MASS_REDUCTION = 30.0
# Fraction of a nominal value below which the prior changes from logarithmic to linear, as
# values may be zero.
_LINEAR_PRIOR_BELOW = 0.1
# Factor of the cost of a wrong base parameter in the search for causes, log(1 + (relative change /
# _NOMINAL_DEVIATION)^2).  A few per cent cost little; where several are wrong, none of them counts
# as known.
_NOMINAL_ERROR_WEIGHT = 2.0
# Relative change of a base parameter from which it costs notably.
_NOMINAL_DEVIATION = 0.02
#: Log-likelihood that an assumption costs: a cause, or that all nominal values are wrong.
ASSUMPTION_COST = 6.0
# Length of the blocks over which scores are summed for standard errors [s].
_BLOCK_LENGTH = 0.5
#: Ratio of the variance found by Student's t with 4 degrees of freedom to the true one, for
#: normal innovations.
NORMAL_VARIANCE_RATIO = 0.6516
# Difference step of a search coordinate for slopes: initial value.
_FIRST_STEP = 1e-3
# The same later [standard errors].
_STEP_ERRORS = 0.5
# Its lower and upper bound.
_STEP_LIMITS = (1e-7, 1e-2)
# Shortest length over which a force may change, in encoder increments: below, readings do not
# show it, and it takes endless steps.
_MIN_LENGTH_INCREMENTS = 0.1
#: Largest step of a search coordinate of order 1.
MAX_STEP = 0.7
# Largest step of a search coordinate that is poorly determined [standard errors].
_MAX_STEP_ERRORS = 2.0
#: Largest step of the logarithm of a noise variance.
MAX_NOISE_STEP = 3.0
# Lower bound of the ratio of the cost's curvature to the information, for a noise.
_MIN_NOISE_CURVATURE = 0.15
# Difference step of the logarithm of a noise variance.
_NOISE_STEP = 0.05
# Allowed integration error of the velocity, over the effect of the random force in one sample.
_INTEGRATION_ERROR_RATIO = 0.05
# Factor by which an elastic part that is too stiff already may become stiffer.
_MAX_STIFFENING = 1.5
# Bounds of the standard deviation of the random force, over the RMS drive.
_RANDOM_FORCE_LIMITS = (1e-5, 10.0)


# Actions of effects that shift the drive in time.
_TIMING_ACTIONS = ("delay", "lag")
# Numbers of an effect without a state of its own.
_RIGID = Inner()


def _is_rigid(axis: FrictionAxis, but: Sequence[str] = ()) -> bool:
    """Whether the states of an axis are those of its motion and its drive, but for some actions."""
    acting = [e for e in axis.effects if e.action not in (*_TIMING_ACTIONS, *but)]
    return all(e.action != "memory" and e.inner(axis) == _RIGID for e in acting)


def recursion(axis: FrictionAxis, dt: float, states: FloatArray, fast: bool) -> Recursion:
    """Linear recursion of the filter's errors, from its states; `fast`: by read velocities."""
    moving = (states[2] != 0.0).astype(float)
    moving[1:] = np.maximum(moving[1:], moving[:-1])
    loss = -axis.viscous / axis.mass * dt
    f11 = math.exp(loss)
    f01 = dt * math.expm1(loss) / loss if abs(loss) > 1e-6 else dt
    return Recursion(
        moving,
        states[4],
        states[5],
        f01,
        f11,
        0.5 * dt * dt / axis.mass,
        dt / axis.mass,
        1.0 / dt if fast else 0.0,
    )


@dataclass(frozen=True, eq=False)
class Run:
    """One record, prepared for the filter."""

    record: Record
    u: FloatArray  # its input; zeros for a model without drive
    w: FloatArray  # velocities, if these were read and the positions are their integral
    cell: float  # increment of the readings
    span: float  # range of the readings
    noise: float  # standard deviation of their noise
    good: BoolArray  # readings that may be used
    active: BoolArray  # samples whose innovations are used
    edges: NDArray[np.int64]  # blocks over which scores are summed
    rest: FloatArray  # time at rest before each sample [s]
    # First sample and end of each stretch over which the filter runs.
    pieces: tuple[tuple[int, int], ...]
    floor: float  # lower bound of the variance of a reading
    # RMS of the input, or the force of the motion if more: the scale of the random force.
    drive: float
    # What the known load may be off, each row by one standard deviation, shape (k, n).
    load_errors: FloatArray = field(default_factory=lambda: _RIGHT_LOAD, kw_only=True)

    def on_stretch(self, start: int, end: int) -> Run:
        """The record on the samples from `start` to before `end` alone."""
        active = self.active.copy()
        active[:start] = active[end:] = False
        return replace(self, active=active, pieces=((start, end),))


def load_error_names(runs: Sequence[Run]) -> tuple[str, ...]:
    """Names of the amounts of what the known loads of some records may be off."""
    most = max((len(run.load_errors) for run in runs), default=0)
    return tuple(f"{LOAD_ERROR}[{k}]" for k in range(most))


def prepare(
    record: Record,
    active: BoolArray | None = None,
    block: float = _BLOCK_LENGTH,
    mass: float = 0.0,
    load_errors: FloatArray = _RIGHT_LOAD,
) -> Run:
    """A record prepared for the filter; all samples active by default, `block` in s.

    The force of its motion, `mass` v^2 over its length, is the scale where the drive is less.
    `load_errors`: what its known load may be off, see `Run`.
    """
    n = len(record)
    size = max(1, round(block / record.dt))
    starts = np.arange(0, max(n - size // 2, 1), size)
    edges = np.append(starts, n).astype(np.int64)
    w = record.x[:0]
    cell = record.quantum or 0.0
    span = record.range
    noise = record.noise
    if record.integrated:
        w = record.channels["v"]
        cell = estimated_quantum(w) or 0.0
        span = float(np.ptp(w))
        noise = spread_of(w, cell)
    floor = max(cell**2 / 12.0 * NORMAL_VARIANCE_RATIO, (1e-9 * span) ** 2)
    scales = typical([record])
    moving = mass * scales.length / scales.time**2
    drive = max(float(np.sqrt(np.mean(record.u**2))), moving) or 1.0
    active = np.ones(n, bool) if active is None else active
    rest = rest_times(record)
    return Run(
        record,
        record.u,
        w,
        cell,
        span,
        noise,
        record.good,
        active,
        edges,
        rest,
        ((0, n),),
        floor,
        drive,
        load_errors=load_errors,
    )


@dataclass(frozen=True, eq=False)
class Point:
    """Result of the filter at one point of the search."""

    cost: float  # negative log-likelihood and prior
    out: list[FloatArray]  # innovations and their variances, one entry a record
    # Filtered position, velocity and mode, the correction of the velocity by each reading,
    # and the filter's gains for position and velocity.
    states: list[FloatArray]
    #: Accelerations at the filtered states of records, once they are known.
    rates: dict[int, FloatArray] = field(default_factory=dict)


def _free_parameters(
    axis: FrictionAxis,
    free: Sequence[str],
    loads: Sequence[str],
    records: Sequence[Record],
    scales: Scales | None,
) -> tuple[FrictionAxis, tuple[Parameter, ...]]:
    """An axis with free parameters, and these; errors of known loads, in `loads`, come last."""
    found: tuple[Parameter, ...] = ()
    free = [name for name in free if name not in loads]
    if free:
        axis, found = choose(axis, free, scales or typical(records))
    return axis, found + tuple(Parameter(n, "", -math.inf, math.inf, False, 1.0) for n in loads)


def _forceless_names(axis: FrictionAxis, names: Sequence[str]) -> set[str]:
    """Parameters that do not act as a force on the mass of a sliding axis."""
    effects = {name for name, effect in named(axis).items() if not effect.acts_as_force()}
    return {name for name in names if name == SHIFT or name.partition(".")[0] in effects}


class Likelihood:
    """Likelihood of the parameters and noises of an axis in one or more records.

    Parameters
    ----------
    axis : FrictionAxis
        Axis with the values of all fixed parameters, and start values of the free ones.
    free : sequence of str
        Names, see `choose`.
    runs : sequence of Run
        The records.
    believed : FrictionAxis, optional
        Nominal axis, the centre of the prior of base parameters; `axis` by default.
    tolerance : mapping of str to float, optional
        Relative standard deviation of a prior.
    priors : sequence of str, optional
        Parameters with a prior where no tolerance is given: a factor of 2 for those of the
        base, and for amounts of effects only what `wonder` says.
    wonder : bool, optional
        Whether changes of base parameters cost as assumptions do.
    own : sequence of str, optional
        Free parameters with a separate value for every record.
    each : mapping of tuple to float, optional
        Start values of these, by name and number of the record.
    hold : {"zero", "first"}, optional
    scales : Scales, optional
        Typical sizes; of the records by default.
    shift : float, optional
        Start value of the time by which the inputs act after their time stamps [s].
    """

    def __init__(
        self,
        axis: FrictionAxis,
        free: Sequence[str],
        runs: Sequence[Run],
        *,
        believed: FrictionAxis | None = None,
        tolerance: Mapping[str, float] | None = None,
        priors: Sequence[str] = BASE,
        wonder: bool = False,
        own: Sequence[str] = (),
        each: Mapping[tuple[str, int], float] | None = None,
        hold: str = "zero",
        scales: Scales | None = None,
        shift: float = 0.0,
    ) -> None:
        self.runs, self.shift, self.each = tuple(runs), shift, dict(each or {})
        records = [r.record for r in self.runs]
        loads = [name for name in load_error_names(self.runs) if name in free]
        axis, found = _free_parameters(axis, free, loads, records, scales)
        self.axis = axis
        self._made: tuple[dict[str, float], FrictionAxis] = {}, axis
        self.first = hold == "first"
        tolerance = dict(tolerance or {})
        believed = (believed or axis).effective()
        self._stiffest = [max(1.0, _MAX_STIFFENING * stiffness(believed, r.dt)) for r in records]
        self.parameters: list[Parameter] = []
        self.place: list[int] = []  # record of a parameter, -1: all
        for p in found:
            places = range(len(runs)) if p.name in (*own, *loads) else (-1,)
            self.parameters += [p] * len(places)
            self.place += places
        names = [p.name for p in self.parameters]
        self.names = names
        self._of_axis = {n for n in names if n != SHIFT and n not in loads}
        self.beliefs = self._prior_numbers(believed, tolerance, priors, wonder)
        # Coordinates of load errors, in their standard deviations.
        self.of_loads = np.flatnonzero(np.isin(names, loads))
        n = len(names)
        self.size = n + 2 * len(runs)
        self.low = np.full(self.size, -np.inf)
        self.high = np.full(self.size, np.inf)
        self._bound_parameters()
        self.late = _forceless_names(axis, names)
        self._bound_noises()
        noise_steps = np.full(2 * len(runs), _NOISE_STEP)
        self.steps = np.concatenate((np.full(n, _FIRST_STEP), noise_steps))
        # Curvature of the cost along each coordinate, from its last slopes.
        self.bends = np.full(self.size, np.nan)
        # Applies a function to coordinates that do not depend on each other, in threads if any.
        self.map: Callable[..., Iterable[Any]] = map

    def _prior_numbers(
        self,
        believed: FrictionAxis,
        tolerance: Mapping[str, float],
        priors: Sequence[str],
        wonder: bool,
    ) -> dict[int, tuple[float, float, bool]]:
        """Numbers of the prior of each parameter that has one, by its coordinate.

        Nominal value, standard deviation of the logarithm, and whether a change costs as an
        assumption does.
        """
        found = {}
        for j, p in enumerate(self.parameters):
            if p.name not in (*priors, *tolerance):
                continue
            value = float(values_of(believed, [p.name])[0])
            if value != 0.0:
                # An amount of an effect may have either sign.
                spread = tolerance.get(p.name, BASE_LOG_DEVIATION if p.name in BASE else math.inf)
                found[j] = (value, spread, wonder and p.name not in tolerance)
        return found

    def _bound_parameters(self) -> None:
        """Bound the coordinates of the parameters."""
        for j, p in enumerate(self.parameters):
            if p.low > -np.inf:
                self.low[j] = p.search(p.low)
            if p.high < np.inf:
                self.high[j] = p.search(p.high)
            if p.name == "mass" and j in self.beliefs:
                value, spread, _ = self.beliefs[j]
                most = max(MAX_MASS_RATIO, math.exp(min(4.0 * spread, 6.0)))
                least = 1.0 / max(most, MAX_MASS_REDUCTION)
                self.low[j], self.high[j] = (p.search(value * f) for f in (least, most))

    def _bound_noises(self) -> None:
        """Bound the coordinates of the noises."""
        n = len(self.names)
        for i, run in enumerate(self.runs):
            a = n + 2 * i
            b = n + 2 * i + 1
            self.low[a], self.high[a] = (
                2.0 * math.log(f * run.drive) for f in _RANDOM_FORCE_LIMITS
            )
            self.low[b] = math.log(run.floor)
            self.high[b] = 2.0 * math.log(max(run.span, 1e-12))

    def on(self, runs: Sequence[Run]) -> Likelihood:
        """The same problem on other samples of the same records."""
        other = copy.copy(self)
        other.runs, other.steps, other.bends = tuple(runs), self.steps.copy(), self.bends.copy()
        return other

    def start(self, force: float = 0.1, noises: FloatArray | None = None) -> FloatArray:
        """Search coordinates of the axis; `force`: random force over the RMS drive.

        `noises`: search coordinates of the noises, those of another problem's result.
        """
        here = dict.fromkeys(self.names, 0.0) | {SHIFT: self.shift}
        own = [n for n in self.names if n in self._of_axis]
        here |= dict(zip(own, values_of(self.axis, own).tolist(), strict=True))
        z = [
            p.search(self.each.get((p.name, i), here[p.name]))
            for p, i in zip(self.parameters, self.place, strict=True)
        ]
        for run in self.runs:
            z += [
                2.0 * math.log(force * run.drive),
                math.log(max(run.floor, run.noise**2)),
            ]
        if noises is not None:
            z[len(self.names) :] = noises
        return np.clip(z, self.low, self.high)

    def _values(self, z: FloatArray, i: int) -> dict[str, float]:
        """Values of the parameters of record i at search coordinates."""
        rows = zip(self.parameters, z, self.place, strict=False)
        return {p.name: p.value(c) for p, c, where in rows if where in (-1, i)}

    def axis_at(self, z: FloatArray, i: int = 0) -> FrictionAxis:
        """Axis of record i at search coordinates."""
        values = {n: v for n, v in self._values(z, i).items() if n in self._of_axis}
        made = self._made  # reused for records with equal values; other threads may replace it
        if made[0] != values:
            made = values, with_values(self.axis, list(values), list(values.values()))
            self._made = made
        return made[1]

    def noises(self, z: FloatArray, i: int = 0) -> tuple[float, float]:
        """Variances of the random force, held over a sample, and of a reading."""
        n = len(self.names)
        return math.exp(z[n + 2 * i]), math.exp(z[n + 2 * i + 1])

    def load_error(self, z: FloatArray, i: int) -> FloatArray:
        """Force by which the known load of record i is off, shape (n,); (0,) for none."""
        errors = self.runs[i].load_errors
        amounts = [z[j] for j in self.of_loads if self.place[j] == i][: len(errors)]
        # Of a likelihood in which they are not free, the load is right.
        return np.asarray(np.array(amounts) @ errors[: len(amounts)]) if amounts else np.zeros(0)

    def known_force(self, z: FloatArray, i: int) -> FloatArray:
        """Known force of record i with its error, as kernels take it."""
        known, error = self.runs[i].record.known_force, self.load_error(z, i)
        if not error.size:
            return known
        force = known + error if known.size else error
        # One type of array: kernels are compiled for each.
        force.setflags(write=False)
        return force

    def innovations(self, z: FloatArray, i: int) -> tuple[FloatArray, FloatArray]:
        """Innovations and states of record i."""
        run = self.runs[i]
        record = run.record
        axis = self.axis_at(z, i)
        check_pace(axis, record.dt)
        arrays = axis.arrays(record.dt)
        numbers = arrays.numbers.copy()
        if stiffness(axis, record.dt) > self._stiffest[i]:
            raise ValueError("an elastic part far too stiff to be seen at this sampling time")
        finest = min((e.shortest_length for e in axis.effects), default=math.inf)
        if finest < _MIN_LENGTH_INCREMENTS * record.resolution.step:
            raise ValueError("a force that repeats within a part of an increment")
        force, reading = self.noises(z, i)
        # Integration errors far below the effect of the random force do not matter.
        hidden = (
            _INTEGRATION_ERROR_RATIO
            * math.sqrt(force)
            * record.dt
            * inverse_masses(axis, record.dt)
        )
        numbers[ALLOWED] = numbers[arrays.integers[N_NUMBERS] + ALLOWED] = hidden
        u = delay_input(run.u, self._values(z, i).get(SHIFT, self.shift) / record.dt)
        # One type of array, whether shifted or not: the filter is compiled for each.
        u.setflags(write=False)
        known = self.known_force(z, i)
        out = np.zeros((2, len(record)))
        state = np.zeros((6, len(record)))
        for start, end in run.pieces:
            here = slice(start, end)
            mine = np.zeros((2, end - start))
            states = np.zeros((6, end - start))
            hybrid.innovations(
                numbers,
                arrays.integers,
                arrays.memory,
                u[here],
                known[here],
                record.x[here],
                run.w[here],
                run.good[here],
                float(record.t[start]),
                float(run.rest[start]),
                record.dt,
                self.first,
                force,
                reading,
                run.cell,
                record.range,
                states,
                mine,
            )
            if end - start == len(record):
                return mine, states
            out[:, here], state[:, here] = mine, states
        return out, state

    def at(self, z: FloatArray) -> Point:
        """Cost and innovations at search coordinates."""
        pairs = [self.innovations(z, i) for i in range(len(self.runs))]
        cost = self.prior(z)
        for run, (out, _) in zip(self.runs, pairs, strict=True):
            cost += compiled.cost(out, run.active)
        return Point(
            cost if math.isfinite(cost) else math.inf, [a for a, _ in pairs], [b for _, b in pairs]
        )

    def tried(self, z: FloatArray) -> Point:
        """As `at`, with infinite cost if there is no such axis."""
        try:
            return self.at(z)
        except ValueError:
            return Point(math.inf, [], [])

    def blocks(self, i: int, out: FloatArray) -> FloatArray:
        """Cost of each block of record i."""
        run = self.runs[i]
        costs = np.empty(run.edges.size - 1)
        compiled.block_costs(out, run.active, run.edges, costs)
        return costs

    def prior(self, z: FloatArray) -> float:
        """Prior cost of deviations from the nominal values."""
        return self.prior_terms(z)[0]

    def prior_terms(self, z: FloatArray) -> tuple[float, FloatArray, FloatArray]:
        """Prior cost with its gradient and curvature, each shape (ncoordinates,)."""
        total = 0.0
        g = np.zeros(self.size)
        h = np.zeros(self.size)
        wonders, trusted = joint_nominal_error_cost(self.nominal_error_costs(z))
        for j, (nominal, spread, wonder) in self.beliefs.items():
            p = self.parameters[j]
            value = p.value(z[j])
            ratio = value / nominal
            slope = p.slope(value) / nominal
            if spread < math.inf:
                off = math.log((ratio + _LINEAR_PRIOR_BELOW) / (1.0 + _LINEAR_PRIOR_BELOW)) / spread
                by = slope / (ratio + _LINEAR_PRIOR_BELOW) / spread
                total += 0.5 * off * off
                g[j] += off * by
                h[j] += by * by
            if wonder:
                off = (ratio - 1.0) / _NOMINAL_DEVIATION
                by = slope / _NOMINAL_DEVIATION
                weight = 2.0 * _NOMINAL_ERROR_WEIGHT * trusted / (1.0 + off * off)
                g[j] += weight * off * by
                h[j] += weight * by * by
        amounts = z[self.of_loads]
        g[self.of_loads] = amounts
        h[self.of_loads] = 1.0
        return total + wonders + 0.5 * float(amounts @ amounts), g, h

    def nominal_error_costs(self, z: FloatArray) -> FloatArray:
        """Cost of each nominal value that is wrong, as an assumption of its own."""
        wonders = [(j, nominal) for j, (nominal, _, wonder) in self.beliefs.items() if wonder]
        return nominal_error_cost(
            np.array([self.parameters[j].value(z[j]) / one for j, one in wonders])
        )

    def _touches(self, j: int) -> list[int]:
        """Records that depend on coordinate j."""
        n = len(self.names)
        if j >= n:
            return [(j - n) // 2]
        return list(range(len(self.runs))) if self.place[j] < 0 else [self.place[j]]

    def terms(
        self, z: FloatArray, point: Point, sides: int = 2, noises: bool = False
    ) -> tuple[FloatArray, FloatArray]:
        """Gradient and information of each block, without the prior.

        `sides`: 2 for central differences, 1 for one-sided ones at half the cost, 0 for a
        linear recursion where a parameter acts as a force.  `noises`: of these alone.

        Returns
        -------
        gradients : ndarray, shape (nblocks, ncoordinates)
        information : ndarray, shape (nblocks, ncoordinates, ncoordinates)
        """
        all_g = []
        all_h = []
        n = len(self.names)
        for i, run in enumerate(self.runs):
            slope = np.zeros((self.size, 2, len(run.record)))
            blocks = run.edges.size - 1
            g = np.zeros((blocks, self.size))
            h = np.zeros((blocks, self.size, self.size))
            exact = np.zeros((blocks, self.size))
            a = n + 2 * i
            b = n + 2 * i + 1
            own = [j for j in range(n if noises else 0, self.size) if i in self._touches(j)]
            # Both noises together scale the variances and hardly change the innovations; a
            # reading's noise that is at its bound is not searched.
            scaled = self.low[b] < self.high[b] and (sides < 2 or z[b] <= self.low[b])
            if scaled:
                own.remove(b)
            found = self.map(lambda j: self.slope(z, point, i, j, slope[j], sides), own)  # noqa: B023
            for j, rise in zip(own, found, strict=True):
                exact[:, j] = rise
            if scaled:
                slope[b] = -slope[a]
                slope[b, 1, point.out[i][1] > 0.0] += 0.5
            compiled.normal_terms(point.out[i], run.active, run.edges, slope, g, h)
            if scaled:
                exact[:, b] = g[:, a] + g[:, b] - exact[:, a]
            all_g.append(exact)
            all_h.append(h)
        return np.concatenate(all_g), np.concatenate(all_h)

    def slope(
        self, z: FloatArray, point: Point, i: int, j: int, slope: FloatArray, sides: int = 2
    ) -> FloatArray:
        """Gradient of record i's block costs with coordinate j; fills `slope`.

        The gradient is a difference of costs: a switch that moves by a sample changes it
        little, but would change a linear estimate from the innovations' slopes much.  The
        error of a one-sided difference is corrected by the information.
        """
        run = self.runs[i]
        if sides == 0 and self._slope_of_force(z, point, i, j, slope):
            blocks = run.edges.size - 1
            g = np.zeros((blocks, 1))
            h = np.zeros((blocks, 1, 1))
            compiled.normal_terms(point.out[i], run.active, run.edges, slope[None], g, h)
            return g[:, 0]
        here = point.out[i]
        ends = [here] * 2
        widths = [0.0, 0.0]
        both = sides == 2 or j >= len(self.names)
        for side, sign in ((1, 1.0), (0, -1.0)):
            if widths[1] > 0.0 and not both:
                break
            moved = z.copy()
            there = z[j] + sign * self.steps[j]
            moved[j] = min(max(there, self.low[j]), self.high[j])
            if moved[j] == z[j]:
                continue
            try:
                out = self.innovations(moved, i)[0]
            except ValueError:
                continue
            if np.isfinite(out).all():
                ends[side], widths[side] = out, abs(moved[j] - z[j])
        wide = sum(widths)
        if wide == 0.0:
            return np.zeros(run.edges.size - 1)
        compiled.slopes(here, ends[0], ends[1], widths[0], widths[1], slope)
        below, above = (self.blocks(i, end) for end in ends)
        if min(widths) > 0.0:
            at = compiled.cost(here, run.active)
            self.bends[j] = (below.sum() + above.sum() - 2.0 * at) / (0.25 * wide**2)
        rise = (above - below) / wide
        if not both:
            g = np.zeros((rise.size, 1))
            h = np.zeros((rise.size, 1, 1))
            compiled.normal_terms(here, run.active, run.edges, slope[None], g, h)
            rise -= 0.5 * (widths[1] - widths[0]) * h[:, 0, 0]
        return rise

    @property
    def is_recursive(self) -> bool:
        """Whether slopes with forces come from the filter's linear recursion: of a rigid axis."""
        return _is_rigid(self.axis)

    def _slope_of_force(
        self, z: FloatArray, point: Point, i: int, j: int, slope: FloatArray
    ) -> bool:
        """Fill the slopes with a parameter that acts as a force while sliding; False if none.

        From the filter's own linear recursion, at a fraction of the cost of another pass; it
        leaves out that switches move.
        """
        if j >= len(self.names) or self.names[j] in self.late:
            return False
        run, states = self.runs[i], point.states[i]
        axis = self.axis_at(z, i)
        # A contact that slides passes on the level, as friction of a rigid axis does.
        if not _is_rigid(axis, ("contact",)):
            return False
        moved = z.copy()
        step = self.steps[j]
        moved[j] += step if z[j] + step <= self.high[j] else -step
        direction = np.sign(states[2]).astype(np.int64)
        if j in self.of_loads:
            force = self._load_error_change(z, moved, i)
        else:
            try:
                there = self.axis_at(moved, i)
            except ValueError:
                return False  # no such axis on this side
            before = point.rates.get(i)
            if before is None:
                now = self._rate(z, i, axis, states, direction)
                before = point.rates.setdefault(i, now)
            force = axis.mass * (self._rate(z, i, there, states, direction) - before)
        force = np.where(direction != 0, force, 0.0)[:, None]
        out = np.zeros((direction.size, 1))
        innovation_change(
            force, force[:0], recursion(axis, run.record.dt, states, run.w.size > 0), out
        )
        seen = point.out[i][1] > 0.0
        deviations = np.sqrt(point.out[i][1, seen])
        slope[0, seen] = np.clip(out[seen, 0] / deviations, -1.0, 1.0)
        slope[0] /= moved[j] - z[j]
        slope[1] = 0.0
        return True

    def _load_error_change(self, z: FloatArray, moved: FloatArray, i: int) -> FloatArray:
        """Change of the known force of record i between two points, shape (n,)."""
        change = self.load_error(moved, i) - self.load_error(z, i)
        return change if change.size else np.zeros(len(self.runs[i].record))

    def _rate(
        self,
        z: FloatArray,
        i: int,
        axis: FrictionAxis,
        states: FloatArray,
        direction: NDArray[np.int64],
    ) -> FloatArray:
        """Accelerations of an axis at filtered states of record i."""
        arrays = axis.arrays(1.0)
        run = self.runs[i]
        motion = (run.record.t, states[0], states[1], run.u, self.known_force(z, i), direction)
        return accelerations(arrays.numbers, arrays.integers, *motion)

    def rescale_information(self, h: FloatArray) -> FloatArray:
        """Information, for noises scaled to the curvature of the cost.

        The curvature is below the sum of squares if readings scatter less than normal
        noise does, in particular quantised ones.
        """
        n = len(self.names)
        part = np.ones(self.size)
        bends = self.bends[n:]
        whole = np.diag(h)[n:]
        seen = np.isfinite(bends) & (whole > 0.0)
        part[n:][seen] = np.clip(bends[seen] / whole[seen], _MIN_NOISE_CURVATURE, 1.0)
        return h * np.sqrt(np.outer(part, part))

    def reach(self, free: IndexArray, size: FloatArray) -> FloatArray:
        """Largest step of coordinates, in their conditional standard errors 1/size."""
        parameter = free < len(self.names)
        return np.maximum(
            np.where(parameter, MAX_STEP, MAX_NOISE_STEP) * size,
            np.where(parameter, _MAX_STEP_ERRORS, 0.0),
        )

    def refine(self, h: FloatArray, wider: float = 1.0) -> None:
        """Set the difference steps from the standard errors of the coordinates."""
        n = len(self.names)
        known = 1.0 / np.sqrt(np.maximum(np.diag(h)[:n], 1e-300))
        self.steps[:n] = np.clip(wider * _STEP_ERRORS * known, *_STEP_LIMITS)


def nominal_error_cost(ratio: FloatArray) -> FloatArray:
    """Cost of each base parameter, over its nominal value, as an assumption of its own."""
    return np.asarray(_NOMINAL_ERROR_WEIGHT * np.log1p(((ratio - 1.0) / _NOMINAL_DEVIATION) ** 2))


def joint_nominal_error_cost(surprises: FloatArray) -> tuple[Any, Any]:
    """Cost of wrong nominal values together, and the probability that they can be trusted.

    Either each is right but for its own surprise, or none is known to _NOMINAL_DEVIATION, only to
    BASE_LOG_DEVIATION.  In the last axis: one for each value.
    """
    each = surprises.sum(axis=-1)
    doubt = ASSUMPTION_COST + surprises.shape[-1] * math.log(
        BASE_LOG_DEVIATION / _NOMINAL_DEVIATION
    )
    both = np.logaddexp(-each, -doubt)
    return np.logaddexp(0.0, -doubt) - both, np.exp(-each - both)
