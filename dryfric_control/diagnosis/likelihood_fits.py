"""Fits of an axis with causes by the likelihood of the hybrid filter."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dryfric_control.diagnosis.candidates import (
    effect_class,
    guesses,
    holds,
    travelled,
)
from dryfric_control.diagnosis.held_out import LEAST
from dryfric_control.diagnosis.starts import beside_jumps
from dryfric_control.estimation.force_residual import View
from dryfric_control.estimation.force_view import ForceView
from dryfric_control.estimation.likelihood import (
    BASE,
    Likelihood,
    Run,
    prepare,
    some_of,
    worst_of,
)
from dryfric_control.estimation.parameters import SHIFT, typical, values_of, with_values
from dryfric_control.estimation.scoring import maximise
from dryfric_control.estimation.solution import Solution
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.model.effects.effect import KINDS
from dryfric_control.model.effects.naming import named, put
from dryfric_control.records.record import Record

FloatArray = NDArray[np.float64]

# Number of samples, of all records together, on which candidates are compared, and on which a
# grid of starting points is evaluated.
_SOME, _NET = 8000, 4000
#: Largest number of iterations of a fit that compares candidates, and of a final fit.
ITERATIONS, LAST = 15, 30
# Number of guesses, for effects that act only at breakaway, from which the fit to all samples is
# restarted.
_ANEW = 2
# Lower bound of speed parameters [encoder increments per sample]: slower sliding looks like rest.
_SLOWEST = 0.1
#: The effect that is a constant force.
BIAS = "bias_force"
#: Actions of effects that shift the drive in time.
LATE = ("delay", "lag")


def hard(slug: str) -> bool:
    """Whether an effect has inner states or a memory of the mode, delay and lag excepted.

    Then slopes are a poor guide far from the optimum.
    """
    effect = effect_class(slug)
    return effect.remembers and effect.action not in LATE


@dataclass(eq=False)
class Fits:
    """Fits of an axis with causes to records of one machine.

    Parameters
    ----------
    believed : FrictionAxis
        The nominal axis.
    records : sequence of Record
    known : sequence of str
        Parameters that stay at their nominal values.
    tolerance : mapping of str to float
        Relative standard deviations of priors.
    own : sequence of str
        Parameters with a separate value for each record.
    also : sequence of str
        Further parameters of the nominal axis that are free.
    hold : str
    jobs : int
    until, end : float
        Readings of `time.monotonic` at which the search ends, and the final answer.
    tell : callable
        Called with the name of each step, for the progress bar.
    """

    believed: FrictionAxis
    records: Sequence[Record]
    known: Sequence[str] = ()
    tolerance: Mapping[str, float] = field(default_factory=dict)
    own: Sequence[str] = ()
    also: Sequence[str] = ()
    hold: str = "zero"
    jobs: int = 1
    until: float = math.inf
    end: float = math.inf
    tell: Callable[[str], None] = lambda what: None

    def __post_init__(self) -> None:
        self.believed = self.believed.effective()
        self.whole = sum(len(r) for r in self.records)
        self.recorded: list[Run] = [prepare(r) for r in self.records]
        # Width with which measurement noise, which does not act, is taken off the inputs.
        self.width = 0.0
        # The runs with those samples alone that a fit foresees worst, if they are compared on.
        self.worst: list[Run] = []
        self._take(self.recorded)
        self.samples = sum(int(r.active.sum()) for r in self.few)
        self.part = self.samples / self.whole
        self.scales = typical(self.records)
        values = values_of(self.believed, BASE)
        self.nominal = {n: v for n, v in zip(BASE, values.tolist(), strict=True)}
        # A nominal value of zero, such as no viscous friction, may be wrong too.
        self.base = tuple(n for n in BASE if n not in self.known)
        # Time by which the inputs act after their time stamps [s], and its name if it is free.
        # Only negative values: acting later is a delay of the machine.
        self.clock: tuple[str, ...] = ()
        self.shift = 0.0
        self.view: type[Likelihood] = Likelihood
        # Whether an imposed motion has nearly one velocity in each direction.
        self.steady = False
        # Record-specific values, by parameter and number of the record.
        self.each: dict[tuple[str, int], float] = {}
        # Threads, and whether fits keep them all busy.
        self._pool, self._busy = ThreadPoolExecutor(self.jobs), False

    def _take(self, runs: list[Run]) -> None:
        """Use these runs from now on, and subsets of their samples."""
        self.runs = runs
        self.few, self.fewer = self._some(runs), self._some(runs, _NET)
        if self.worst:
            self.few = [
                replace(r, active=w.active, pieces=w.pieces)
                for r, w in zip(runs, self.worst, strict=True)
            ]

    def _some(self, runs: Sequence[Run], most: int = _SOME) -> list[Run]:
        """A subset of about `most` samples of all runs together."""
        return [some_of(r, self._part_of(r, most)) for r in runs]

    def _part_of(self, run: Run, most: int) -> int:
        """Number of samples of a run, if about `most` of all are taken."""
        return max(most * len(run.record) // self.whole, 500)

    def aim(self, fit: Solution) -> None:
        """Compare from now on where a fit to all samples foresees them worst.

        What acts rarely may not have acted in evenly spread samples.
        """
        rows = zip(fit.problem.runs, fit.point.out, strict=True)
        self.worst = [worst_of(run, out, self._part_of(run, _SOME)) for run, out in rows]
        self._take(self.runs)

    @property
    def late(self) -> bool:
        """Whether the time limit has passed."""
        return time.monotonic() > self.until

    def penalty(self, count: int) -> float:
        """Largest gain of log-likelihood that `count` parameters bring by chance."""
        return 0.5 * count * math.log(self.samples)

    def worth(self, gain: float, count: int, causes: int = 1) -> float:
        """Gain of log-likelihood less the penalty for its parameters and causes."""
        return gain - self.penalty(count) - causes * LEAST

    def problem(
        self, axis: FrictionAxis, free: Sequence[str], runs: Sequence[Run] | None = None,
        base: Sequence[str] | None = None, wonder: bool = True,
    ) -> Likelihood:  # fmt: skip
        """Likelihood problem of an axis with the base and further parameters free."""
        base = self.base if base is None else base
        problem = self.view(
            axis, (*base, *self.clock, *free), self.few if runs is None else runs,
            believed=self.believed, tolerance=self.tolerance, own=self.own, each=self.each,
            hold=self.hold, scales=self.scales, wonder=wonder, shift=self.shift,
        )  # fmt: skip
        problem.map = self._map
        if self.clock:
            problem.high[problem.names.index(SHIFT)] = 0.0
        for j, p in enumerate(problem.parameters):
            if p.kind == "share":
                # A very light mass would vibrate over thousands of steps while the other rests.
                problem.low[j], problem.high[j] = map(p.search, KINDS["share"])
            elif p.kind == "speed":
                slowest = min(r.resolution.step / r.dt for r in self.records)
                problem.low[j] = max(problem.low[j], p.search(max(_SLOWEST * slowest, p.low)))
            elif p.kind == "place" and not holds(self.believed, p.name.partition(".")[0]):
                problem.low[j], problem.high[j] = map(p.search, travelled(self.records))
        return problem

    def fit(
        self, axis: FrictionAxis, free: Sequence[str], noises: FloatArray | None = None,
        iterations: int = LAST, **settings: Any,
    ) -> Solution:  # fmt: skip
        """Most likely parameters, starting from the values of an axis."""
        problem = self.problem(axis, free, **settings)
        found = maximise(problem, problem.start(1.0, noises), iterations, self.until)
        rough = self.rough(found)
        if not rough or iterations < ITERATIONS or self.late:
            return found
        z = beside_jumps(problem, found.z, rough, lambda: self.late)
        return min(found, maximise(problem, z, iterations, self.until), key=lambda s: s.cost)

    def constant(self, name: str) -> bool:
        """Whether a parameter only adds a force of which every record has its own."""
        owner, _, part = name.partition(".")
        return f"{BIAS}.force" in self.own and part == effect_class(owner).adds_constant

    def rough(self, fit: Solution) -> list[str]:
        """Free parameters that act only at breakaway, of effects that are `hard`."""
        return [
            p.name for p in fit.problem.parameters
            if p.breaks_away and p.name not in self.own and hard(p.name.partition(".")[0])
        ]  # fmt: skip

    def anew(self, fit: Solution, **settings: Any) -> Solution:
        """The fit, or a better one restarted from guesses of parameters acting at breakaway.

        A subset of the samples has few breakaways and may have led to another optimum.
        """
        names = self.rough(fit)
        noises = fit.z[len(fit.problem.names) :]
        for slug in dict.fromkeys(n.partition(".")[0] for n in names):
            own = [n for n in names if n.startswith(f"{slug}.")]
            view = View(self.less(fit.axis, slug), self.records[0], self.nominal)
            tried = list[tuple[float, int, FrictionAxis]]()
            for values, _ in guesses(slug, view):
                axis = with_values(fit.axis, own, [values[n.partition(".")[2]] for n in own])
                tried.append((fit.problem.tried(self._at(fit, axis, own)).cost, len(tried), axis))
            for _, _, axis in sorted(tried)[:_ANEW]:
                if not self.late:
                    other = self.fit(axis, self.free_of(fit), noises, **settings)
                    fit = min(fit, other, key=lambda s: s.cost)
        return fit

    def _at(self, fit: Solution, axis: FrictionAxis, names: Sequence[str]) -> FloatArray:
        """Search coordinates of a fit, with some parameters set to the values of an axis."""
        z = fit.z.copy()
        for name, value in zip(names, values_of(axis, names), strict=True):
            j = fit.problem.names.index(name)
            z[j] = fit.problem.parameters[j].search(float(value))
        return np.clip(z, fit.problem.low, fit.problem.high)

    def possible(self, axis: FrictionAxis, free: Sequence[str]) -> bool:
        """Whether a fit can start from an axis: its cost is finite, unless it is too stiff."""
        problem = self.problem(axis, free)
        return math.isfinite(problem.tried(problem.start(1.0)).cost)

    def reference(
        self, axis: FrictionAxis, idle: bool = False, runs: Sequence[Run] | None = None,
        shift: float = 0.0,
    ) -> Solution:  # fmt: skip
        """Fit of the noises of a fixed axis; `idle`: without its drive."""
        runs = self.runs if runs is None else runs
        runs = [replace(r, u=np.zeros(r.u.size)) if idle else r for r in runs]
        problem = self.view(axis, (), runs, hold=self.hold, scales=self.scales, shift=shift)
        return maximise(problem, problem.start(1.0), 12)

    @property
    def imposed(self) -> bool:
        """Whether the motion is imposed by something other than the drive."""
        return self.view is ForceView

    def _map(self, function, values):  # type: ignore[no-untyped-def]
        """Results of a function for each value, in threads unless fits keep them busy."""
        alone = self.jobs == 1 or self._busy or len(values) < 2
        return map(function, values) if alone else self._pool.map(function, values)

    def _parallel(self, tasks):  # type: ignore[no-untyped-def]
        """Results of fits that do not depend on each other, in threads if none is busy."""
        if self.jobs == 1 or self._busy or len(tasks) < 2:
            return [f(*a) for f, a in tasks]
        # As long as a fit runs here: one that waited for its slopes would wait for ever.
        self._busy = True
        running = [self._pool.submit(f, *a) for f, a in tasks]
        try:
            return [one.result() for one in running]
        finally:
            for one in running:
                one.cancel()
            wait(running)
            self._busy = False

    def less(self, axis: FrictionAxis, slug: str) -> FrictionAxis:
        """The axis with an effect as in the nominal axis, or without it if that has none."""
        return put(axis, slug, named(self.believed).get(slug))

    def free_of(self, now: Solution) -> tuple[str, ...]:
        """Free parameters of a model other than those of the base."""
        others = (*self.base, SHIFT)
        return tuple(dict.fromkeys(n for n in now.problem.names if n not in others))
