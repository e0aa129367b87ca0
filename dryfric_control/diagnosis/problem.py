"""The question of a diagnosis, and fits of a model to its records by one likelihood."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dryfric_control.compiled.likelihood import FREEDOM
from dryfric_control.diagnosis.candidates import (
    effect_class,
    free_amounts,
    holds,
    own_names,
    shown_range,
)
from dryfric_control.diagnosis.remaining import mutes_friction
from dryfric_control.diagnosis.thresholds import (
    MIN_EVIDENCE,
    MIN_LINE_LEAD,
    MIN_MODEL_LEAD,
    NEGLIGIBLE_RATIO,
    SEARCH_REVERSALS,
)
from dryfric_control.estimation.force_view import ForceView
from dryfric_control.estimation.likelihood import (
    BASE,
    NORMAL_VARIANCE_RATIO,
    Likelihood,
    Run,
    load_error_names,
)
from dryfric_control.estimation.parameters import SHIFT, Scales, typical, values_of, with_values
from dryfric_control.estimation.scoring import COMPARISON_ITERATIONS, maximise
from dryfric_control.estimation.smoothed_motion import SmoothedMotion
from dryfric_control.estimation.solution import Solution
from dryfric_control.estimation.windows import Windows
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.model.effects.naming import named, put, renumber_names
from dryfric_control.model.friction import CoulombMap
from dryfric_control.records.record import Record

FloatArray = NDArray[np.float64]

#: The effect that is a constant force.
BIAS = "bias_force"
BIAS_FORCE = f"{BIAS}.force"
#: The factor of the drive.
GAIN = "input_gain.gain"
# Actions of nominal effects whose amounts are uncertain.
_UNSURE = ("force", "friction", "input")
# Iterations of a fit of the noises alone.
_NOISES = 3


@dataclass(frozen=True, eq=False)
class Problem:
    """Records of one machine, its nominal axis, and what is known about it."""

    believed: FrictionAxis  # the nominal axis
    runs: tuple[Run, ...]  # the records
    known: tuple[str, ...] = ()  # parameters that stay at their nominal values
    # Relative standard deviations of priors.
    tolerance: Mapping[str, float] = field(default_factory=dict)
    own: tuple[str, ...] = ()  # parameters with a separate value for each record
    also: tuple[str, ...] = ()  # further free parameters of the nominal axis
    hold: str = "zero"
    # Likelihood of the motion, or of the force where the motion is imposed.
    view: type[Likelihood] = Likelihood
    # Start value of the time by which the inputs act after their time stamps [s]; None: not
    # free, and zero.
    shift: float | None = None
    steady: bool = False  # whether each direction has nearly one velocity
    jobs: int = 1  # number of fits in parallel
    until: float = math.inf  # reading of `time.monotonic` at which fits end
    windows: tuple[Windows, ...] = ()  # free runs of each record

    @cached_property
    def samples(self) -> int:
        """Number of samples whose innovations count."""
        return sum(int(r.active.sum()) for r in self.runs)

    @cached_property
    def motions(self) -> tuple[SmoothedMotion, ...]:
        """Motion of each record where it shows the force."""
        mass = self.believed.mass
        return tuple(SmoothedMotion.where_force_shows(r.record, mass) for r in self.runs)

    @property
    def moves_in_jumps(self) -> bool:
        """Whether only breakaways show the force."""
        return any(motion.in_jumps for motion in self.motions)

    @cached_property
    def fast_stretches(self) -> tuple[Run, ...]:
        """Each record on the stretch with the fastest strokes: it tells where a fit begins."""
        pairs = zip(self.runs, self.motions, strict=True)
        return tuple(_with_long_strokes(run, motion) for run, motion in pairs)

    @cached_property
    def scales(self) -> Scales:
        """Typical sizes in the records."""
        return typical([r.record for r in self.runs])

    @cached_property
    def nominal(self) -> dict[str, float]:
        """Nominal values of what is uncertain in the nominal axis: base, amounts of its effects."""
        names = (*BASE, *self.force_amounts)
        return dict(zip(names, values_of(self.believed, names).tolist(), strict=True))

    @cached_property
    def force_amounts(self) -> tuple[str, ...]:
        """Amounts of the nominal effects that act as a force: no more certain than the base."""
        found = []
        for name, effect in named(self.believed).items():
            if effect.action in _UNSURE and not (self.is_imposed and effect.action == "input"):
                found += [full for full, _, _ in free_amounts(name, own_names(name))]
        values = values_of(self.believed, found)
        return tuple(n for n, v in zip(found, values, strict=True) if v != 0.0)

    @cached_property
    def scale_open(self) -> bool:
        """Whether the records fix all forces only as ratios to the gain of the drive.

        The nominal axis has a gain, and the user knows neither that nor a base parameter: nothing
        then separates the gain from one factor of mass, friction and every other force.
        """
        sure = {*self.known, *self.tolerance}
        return GAIN in self.force_amounts and not sure & {*BASE, GAIN}

    @property
    def base(self) -> tuple[str, ...]:
        """Base parameters that are free, and amounts of the nominal effects."""
        held = (*self.known, *self.also, *(("viscous",) if self.steady else ()))
        held = (*held, *((GAIN,) if self.scale_open else ()))
        return tuple(n for n in self.nominal if n not in held)

    @property
    def is_imposed(self) -> bool:
        """Whether the motion is imposed by something other than the drive."""
        return issubclass(self.view, ForceView)

    def is_muted(self, fit: Solution) -> bool:
        """Whether the random force is too large, beside the friction, to explain anything."""
        return not self.is_imposed and mutes_friction(fit.largest_force, fit.axis)

    def left(self, fit: Solution) -> float:
        """Log-likelihood that causes may still gain on the data; infinite with a force left.

        What acts rarely gains no more than what its outliers cost above those of normal noise.
        """
        if self.is_imposed or not fit.largest_force < NEGLIGIBLE_RATIO * fit.axis.coulomb.mean:
            return math.inf
        return self.outliers(fit)

    def outliers(self, fit: Solution) -> float:
        """Log-likelihood that innovations cost beyond the tail of as many normal ones."""
        rows = []
        for run, one in zip(fit.problem.runs, fit.point.out, strict=True):
            innovation, variance, *_ = one[:, run.active & (one[1] > 0.0)]
            rows.append(innovation**2 / variance)
        ratios = np.concatenate(rows)
        # The largest of n squares of a normal variable is about 2 log n.
        normal = 2.0 * math.log(max(ratios.size, 1)) / NORMAL_VARIANCE_RATIO
        lost = np.log((FREEDOM + np.maximum(ratios, normal)) / (FREEDOM + normal))
        return float(0.5 * (FREEDOM + 1.0) * lost.sum())

    def is_exhausted(self, fit: Solution) -> bool:
        """Whether no cause can be left: what spares assumptions gains what these cost, no more."""
        return self.left(fit) + fit.problem.prior(fit.z) < MIN_EVIDENCE

    @property
    def is_overdue(self) -> bool:
        """Whether the time limit has passed."""
        return time.monotonic() > self.until

    def likelihood(
        self,
        axis: FrictionAxis,
        free: Sequence[str] = (),
        base: Sequence[str] | None = None,
        wonder: bool = True,
        each: Mapping[tuple[str, int], float] | None = None,
    ) -> Likelihood:
        """Likelihood of an axis with the base and further parameters free."""
        clock = () if self.shift is None else (SHIFT,)
        base = self.base if base is None else base
        loads = load_error_names(self.runs)
        names = tuple(dict.fromkeys((*base, *clock, *self.also, *free, *loads)))
        axis = _effective_but_free(axis, names)
        problem = self.view(
            axis,
            names,
            self.runs,
            believed=self.believed,
            tolerance=self.tolerance,
            own=self.own,
            each=each,
            hold=self.hold,
            scales=self.scales,
            wonder=wonder,
            priors=tuple(self.nominal),
            shift=self.shift or 0.0,
        )
        nearer = self._bound_by_records(problem, axis)
        return problem if nearer is None else self.likelihood(nearer, free, base, wonder, each)

    def _bound_by_records(self, problem: Likelihood, axis: FrictionAxis) -> FrictionAxis | None:
        """Bound parameters by what the records show; another start where this one is far off."""
        records = [r.record for r in self.runs]
        for j, p in enumerate(problem.parameters):
            if p.name == SHIFT:
                problem.high[j] = 0.0  # acting later is a delay of the machine
            elif not holds(self.believed, p.name.partition(".")[0]) and "." in p.name:
                low, high = shown_range(p.name, records, self.believed.travel)
                problem.low[j] = max(problem.low[j], p.search(max(low, p.low)))
                problem.high[j] = min(problem.high[j], p.search(min(high, p.high)))
                if problem.low[j] > problem.high[j]:
                    # A start that is far from all that the records show begins at the end of that.
                    value = float(np.clip(values_of(axis, [p.name])[0], low, high))
                    return with_values(axis, [p.name], [value])
        return None

    def fit(
        self,
        axis: FrictionAxis,
        free: Sequence[str] = (),
        noises: FloatArray | None = None,
        turns: int = COMPARISON_ITERATIONS,
        **settings: Any,
    ) -> Solution:
        """Most likely parameters, starting from the values of an axis."""
        problem = self.likelihood(axis, free, **settings)
        return maximise(problem, problem.start(1.0, noises), turns, self.until)

    def reference(
        self, axis: FrictionAxis, idle: bool = False, noises: FloatArray | None = None
    ) -> Solution:
        """Fit of the noises of a fixed axis, from those of a similar one if given.

        `idle`: without its drive.
        """
        runs = [replace(r, u=np.zeros(r.u.size)) if idle else r for r in self.runs]
        problem = self.view(
            axis.effective(),
            (),
            runs,
            believed=self.believed,
            hold=self.hold,
            scales=self.scales,
            shift=self.shift or 0.0,
        )
        return maximise(problem, problem.start(1.0, noises), _NOISES, self.until)

    @cached_property
    def nominal_fit(self) -> Solution:
        """The nominal axis, only its noises fitted; ValueError if it cannot be simulated."""
        found = self.reference(self.believed)
        if not found.point.out:
            found.problem.at(found.z)
        return found

    @cached_property
    def straight_line(self) -> Solution:
        """The axis without drive and friction, only its noises fitted."""
        line = FrictionAxis(mass=self.believed.mass, viscous=0.0, coulomb=CoulombMap.of(0.0))
        return self.reference(line, idle=True)

    def clear_of_line(self, fit: Solution) -> bool:
        """Whether a model clearly beats a straight line: its drive moves the axis."""
        return fit.cost < self.straight_line.cost - MIN_MODEL_LEAD * self.samples

    def behind_line(self, fit: Solution) -> bool:
        """Whether a straight line clearly beats a model."""
        return fit.cost > self.straight_line.cost + MIN_LINE_LEAD * self.samples

    def constant(self, name: str) -> bool:
        """Whether a parameter only adds a force of which every record has its own."""
        owner, _, part = name.partition(".")
        return BIAS_FORCE in self.own and part == effect_class(owner).adds_constant

    def remove_effects(self, axis: FrictionAxis, *names: str) -> FrictionAxis:
        """The axis with effects as in the nominal axis, or without them if that has none."""
        for name in reversed(names):
            axis = put(axis, name, named(self.believed).get(name))
        return axis

    def free_of(self, now: Solution) -> tuple[str, ...]:
        """Free parameters of the effects of a model."""
        others = (*self.base, SHIFT, *self.also, *load_error_names(self.runs))
        return tuple(dict.fromkeys(n for n in now.problem.names if n not in others))

    def free_without(self, free: Sequence[str], *names: str) -> tuple[str, ...]:
        """Free parameters, or causes, of a model without some of its effects."""
        for name in reversed(names):
            rest = [n for n in free if n.partition(".")[0] != name]
            free = rest if name in named(self.believed) else renumber_names(rest, name)
        return tuple(free)

    def parallel(self, function: Callable[..., Any], *arguments: Iterable[Any]) -> list[Any]:
        """Results of a function for each of some arguments, in threads."""
        rows = list(zip(*arguments, strict=True))
        if self.jobs == 1 or len(rows) < 2:
            return [function(*row) for row in rows]
        with ThreadPoolExecutor(self.jobs) as pool:
            return list(pool.map(function, *zip(*rows, strict=True)))


def _effective_but_free(axis: FrictionAxis, names: Sequence[str]) -> FrictionAxis:
    """The axis with effects on its base as part of that, but for those of free parameters."""
    owners = {name.partition(".")[0] for name in names}
    effects = named(axis).items()
    kept = [e for n, e in effects if n in owners and e.action == "axis" and e in axis.effects]
    rest = axis.replace(effects=tuple(e for e in axis.effects if e not in kept)).effective()
    return rest.replace(effects=(*rest.effects, *kept)) if kept else rest


def noises_of(fit: Solution) -> FloatArray:
    """Search coordinates of the noises of a fit."""
    return np.asarray(fit.z[len(fit.problem.names) :])


def each_of(fit: Solution) -> dict[tuple[str, int], float]:
    """Values of the parameters that every record has of its own."""
    rows = zip(fit.problem.parameters, fit.problem.place, fit.z, strict=False)
    return {(one.name, i): one.value(c) for one, i, c in rows if i >= 0}


def with_found_load(fit: Solution, record: Record, i: int = 0, note: str = "") -> Record:
    """Record i with its known load as a fit found it."""
    if not fit.problem.load_error(fit.z, i).size:
        return record
    load = fit.problem.known_force(fit.z, i)
    return record._with_changes(note, channels={**record.channels, "load": load})


def _with_long_strokes(run: Run, motion: SmoothedMotion) -> Run:
    """A record on the stretch of `SEARCH_REVERSALS` successive reversals with the fastest strokes.

    What builds up after a reversal ends within a long stroke; whole if it has no more reversals.
    """
    sliding = np.flatnonzero(motion.direction)
    turned = np.flatnonzero(np.diff(motion.direction[sliding]))
    reversals = np.array([0, *sliding[turned + 1], len(run.record)])
    starts = reversals[: -SEARCH_REVERSALS - 1]
    ends = reversals[SEARCH_REVERSALS + 1 :]
    if not starts.size or len(run.pieces) > 1:
        return run
    path = np.concatenate(([0.0], np.cumsum(np.abs(np.diff(motion.x)))))
    path = np.append(path, path[-1])
    best = int(np.argmax((path[ends] - path[starts]) / (ends - starts)))
    return run.on_stretch(int(starts[best]), int(ends[best]))
