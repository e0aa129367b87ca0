"""Fits of an axis with each effect of the catalogue, by the likelihood of the hybrid filter."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import joblib
import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_filter

from dryfric_control.compiled import likelihood as compiled
from dryfric_control.diagnosis.candidates import (
    catalogue,
    effect_class,
    guesses,
    holds,
    placed,
    travelled,
    with_effect,
)
from dryfric_control.diagnosis.held_out import CLEAR, LEAST, HeldOut
from dryfric_control.diagnosis.starts import Start, beside_jumps, in_valleys
from dryfric_control.estimation.force_residual import View
from dryfric_control.estimation.force_view import ForceView, prepare_force
from dryfric_control.estimation.likelihood import (
    BASE,
    Likelihood,
    Run,
    prepare,
    some_of,
)
from dryfric_control.estimation.parameters import SHIFT, typical, values_of, with_values
from dryfric_control.estimation.scoring import maximise, within_reach
from dryfric_control.estimation.solution import Solution
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.model.effects.effect import KINDS
from dryfric_control.model.effects.naming import named, put
from dryfric_control.model.friction import CoulombMap
from dryfric_control.records.record import Record

FloatArray = NDArray[np.float64]

# Samples of all records together on which candidates are compared, and those on which a net
# of starts is hung.
_SOME, _NET = 8000, 4000
# Guesses of a candidate that are refined, candidates that are refined to the end, and
# those that are fitted in full.
_REFINED, _AHEAD, _FITTED = 2, 10, 8
# Guesses of an effect with inner states that are fitted for some turns, of the first cause
# and of further ones; how many turns, and those that may be of use which are fitted for more.
_HARD_TRIED, _HARD_TURNS, _HARD_REFINED = (6, 2), (3, 10), 2
# Turns of the quick refinement, along slopes of the base that stay as they are.
_TURNS = 4
# Turns of a fit beside the nominal base.
_LED_TURNS = 8
#: Relative change of a parameter by less than this is none.
MOVED = 0.01
#: Causes whose costs differ by less do equally well.
EQUAL = 4.0
# Part of the best quick gain below which a candidate is not fitted in full, the same for
# hard ones, which have been, and what a full fit may add to a quick one.
_SHARE, _HARD_SHARE, SLACK = 0.4, 0.8, 8.0
# Iterations of a fit while candidates are compared, and of a fit that ends.
_ITERATIONS, _LAST = 15, 30
# Base values whose logarithm is off by more may be bent by what is missing, beside none and
# beside some causes.
_BENT, _BOLD = 0.1, math.log(2.0)
# Errors of a parameter within which its neutral value means that nothing is there.
_SURE = 2.0
# Part of the best worth within which causes are compared on all samples.
_CLOSE = 0.25
# Time constants over which the input is smoothed where causes are compared with a lag.
_OVER = (2.0, 4.0, 8.0, 16.0)
# Samples over which recorded inputs are smoothed, and correlation from one sample to the next
# up to which what that takes off is noise.
_SMOOTHER, _WHITE = (1, 5, 9, 17, 33, 65, 129), 0.1
# Part of the gain on few samples that must be clear for a doubt to be followed, and the turns
# of the fits that follow it.
_DOUBTED, _DOUBTED_TURNS = 0.2, 8
# Increments a sample below which no speed of sliding is told from rest.
_SLOWEST = 0.1
# Samples of corrections at which first guesses look.
_SEEN = 8000
_BIAS = "bias_force"
#: Name of the reference without drive and friction.
STRAIGHT = "straight line"
#: Actions of effects that move the drive in time.
LATE = ("delay", "lag")
# Units a sample by which a straight line is ahead of the base where the motion is imposed, and
# by which no cause is ahead of the line; the part of the drive that the force which the motion
# needs may then leave.
_BEHIND, _CLEAR_OF, _IMPOSED = 0.1, 0.2, 0.25
# Actions of effects that show as a force in a motion that is imposed.
_FORCES = ("force", "friction", "contact")
# Samples by which the recorded input may be late, tried first.
_EARLIER = (0.5, 1.0, 2.0, 4.0, 8.0)


@dataclass(frozen=True, eq=False)
class Candidate:
    """A cause on trial: its name, free parameters, the axis with it, cost."""

    slug: str
    free: tuple[str, ...]
    axis: FrictionAxis
    cost: float


def hard(slug: str) -> bool:
    """Whether an effect has states that move with every reading, or a memory of the mode.

    Then slopes tell little far from the best values.
    """
    effect = effect_class(slug)
    return effect.remembers and effect.action not in LATE


def _hidden_shares(fit: Solution) -> list[str]:
    """Shares that ended at a bound: one of the two parts is too light to be seen."""
    p = fit.problem
    rows = zip(p.names, p.parameters, strict=True)
    return [n for n, one in rows if one.kind == "share" and n in fit.at_bound]


def _time_of(fit: Solution) -> float:
    """Time constant of the lag in a fit."""
    return max(e.inner(fit.axis).lag for e in fit.axis.effects if e.action == "lag")


class Corrections(View):
    """What first guesses look at: the force by which the filter corrects a model.

    Readings that it believes, in place of derivatives of all readings: far less noisy
    where the readings are.
    """

    def __init__(self, found: Solution, believed: dict[str, float]) -> None:
        axis, run = found.axis, found.problem.runs[0]
        record, state = run.record, found.point.states[0]
        super().__init__(axis, record, believed)
        pick = np.flatnonzero((state[2] != 0.0) & run.active)
        if pick.size < self.t.size // 4:
            return
        stride = -(-pick.size // _SEEN)
        force = axis.mass * state[3] / record.dt
        force = np.convolve(force, np.full(stride, 1.0 / stride), "same")
        pick = pick[::stride]
        self.t, self.x, self.v, self.u = record.t[pick], record.x[pick], state[1][pick], run.u[pick]
        self.a = (np.gradient(state[1]) / record.dt)[pick]
        self.direction = np.sign(state[2][pick]).astype(np.int64)
        self.residual = force[pick]


@dataclass(eq=False)
class Search:
    """Fits of an axis with causes to records of one machine.

    Parameters
    ----------
    believed : FrictionAxis
    records : sequence of Record
    known : sequence of str
        Parameters that stay as believed.
    tolerance : mapping of str to float
        Relative standard deviations of priors.
    own : sequence of str
        Parameters of which every record has its own value.
    also : sequence of str
        Further parameters of the believed axis that are free.
    hold : str
    jobs : int
    until, end : float
        Readings of `time.monotonic` at which the search ends, and the answer too.
    tell : callable
        Is told each step.
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
        # Noise that was recorded with the inputs pushes nothing: how smooth they are taken.
        self.smooth = 1
        self._quiet: Solution | None = None
        self._take(self.recorded)
        self.samples = sum(int(r.active.sum()) for r in self.few)
        self.part = self.samples / self.whole
        self._costs: dict[Solution, FloatArray] = {}
        self._whole: dict[Solution, Solution] = {}
        self._screened: dict[tuple[Solution, bool], list[Candidate]] = {}
        self.scales = typical(self.records)
        values = values_of(self.believed, BASE)
        self.nominal = {n: v for n, v in zip(BASE, values.tolist(), strict=True)}
        # What is zero by belief, such as an axis without viscous friction, may be wrong too.
        self.base = tuple(n for n in BASE if n not in self.known)
        # Time by which the recorded inputs act later than their time stamps say, and its
        # name where it is free: before them only, as after them is a delay of the machine.
        self.clock: tuple[str, ...] = ()
        self.shift = 0.0
        self.view: type[Likelihood] = Likelihood
        # What each record has of its own, by parameter and number of the record.
        self.each: dict[tuple[str, int], float] = {}
        # Causes of the last round that unseen data do not confirm: worth, candidate, fit.
        self.unsure: list[tuple[float, Candidate, Solution]] = []

    def _take(self, runs: list[Run]) -> None:
        """Go on with runs, and with some of their samples."""
        self.runs = runs
        self.few, self.fewer = self._some(runs, _SOME), self._some(runs, _NET)

    def _some(self, runs: Sequence[Run], most: int) -> list[Run]:
        """Some samples of runs, so many of all together."""
        return [some_of(r, max(most * len(r.record) // self.whole, 500)) for r in runs]

    @property
    def late(self) -> bool:
        """Whether time is over."""
        return time.monotonic() > self.until

    def _less_dry(self) -> dict[str, float]:
        """Base values with most of the dry friction exchanged for viscous friction."""
        level, speed = self.nominal["coulomb"], self.scales.length / self.scales.time
        return {"coulomb": 0.2 * level, "viscous": self.nominal["viscous"] + 0.8 * level / speed}

    def penalty(self, count: int) -> float:
        """Gain that so many parameters bring by chance, at most."""
        return 0.5 * count * math.log(self.samples)

    # -- fits ----------------------------------------------------------------------

    def problem(
        self, axis: FrictionAxis, free: Sequence[str], runs: Sequence[Run] | None = None,
        base: Sequence[str] | None = None, wonder: bool = True,
    ) -> Likelihood:  # fmt: skip
        """Likelihood of an axis with the base and further parameters free."""
        base = self.base if base is None else base
        problem = self.view(
            axis, (*base, *self.clock, *free), self.few if runs is None else runs,
            believed=self.believed, tolerance=self.tolerance, own=self.own, each=self.each,
            hold=self.hold, scales=self.scales, wonder=wonder, shift=self.shift,
        )  # fmt: skip
        if self.clock:
            problem.high[problem.names.index(SHIFT)] = 0.0
        for j, p in enumerate(problem.parameters):
            if p.kind == "share":
                # One so light rattles by the thousand steps where the other stands.
                problem.low[j], problem.high[j] = map(p.search, KINDS["share"])
            elif p.kind == "speed":
                slowest = min(r.resolution.step / r.dt for r in self.records)
                problem.low[j] = max(problem.low[j], p.search(max(_SLOWEST * slowest, p.low)))
            elif p.kind == "place" and not holds(self.believed, p.name.partition(".")[0]):
                problem.low[j], problem.high[j] = map(p.search, travelled(self.records))
        return problem

    def fit(
        self, axis: FrictionAxis, free: Sequence[str], noises: FloatArray | None = None,
        iterations: int = _LAST, **settings: Any,
    ) -> Solution:  # fmt: skip
        """Most likely parameters from one axis."""
        problem = self.problem(axis, free, **settings)
        z = problem.start(1.0)
        if noises is not None:
            z[len(problem.names) :] = noises
        found = maximise(problem, z, iterations, self.until)
        # What acts at breakaway alone, and by a memory.
        rough = [
            p.name for p in problem.parameters
            if p.breaks_away and p.name not in self.own and hard(p.name.partition(".")[0])
        ]  # fmt: skip
        if not rough or iterations < _ITERATIONS or self.late:
            return found
        z = beside_jumps(problem, found.z, rough, lambda: self.late)
        return min(found, maximise(problem, z, iterations, self.until), key=lambda s: s.cost)

    def possible(self, axis: FrictionAxis, free: Sequence[str]) -> bool:
        """Whether there is a fit from an axis: it may be stiffer than the samples show."""
        problem = self.problem(axis, free)
        return math.isfinite(problem.tried(problem.start(1.0)).cost)

    def reference(
        self, axis: FrictionAxis, idle: bool = False, runs: Sequence[Run] | None = None,
        shift: float = 0.0,
    ) -> Solution:  # fmt: skip
        """An axis as it is, its noises fitted alone; `idle`: without its drive."""
        runs = self.runs if runs is None else runs
        runs = [replace(r, u=np.zeros(r.u.size)) if idle else r for r in runs]
        problem = self.view(axis, (), runs, hold=self.hold, scales=self.scales, shift=shift)
        return maximise(problem, problem.start(1.0), 12)

    def references(self) -> dict[str, float]:
        """Costs of the nominal axis and of a straight line, their noises fitted alone.

        The line has no drive and no friction: what a model that mutes the drive
        comes to.
        """
        found = {"nominal axis": self.reference(self.believed).cost}
        return found if self.imposed else found | {STRAIGHT: self._line(self.runs)}

    def _line(self, runs: Sequence[Run]) -> float:
        """Cost of a straight line."""
        line = FrictionAxis(mass=self.believed.mass, viscous=0.0, coulomb=CoulombMap.of(0.0))
        return self.reference(line, idle=True, runs=runs).cost

    @property
    def imposed(self) -> bool:
        """Whether something other than the drive makes the motion."""
        return self.view is ForceView

    def _look_at_the_force(self) -> None:
        """Go on with the force that the motion needs, as the motion itself says nothing."""
        self.view, self.smooth = ForceView, 1
        self.runs = self.few = self.fewer = [prepare_force(r, self.hold) for r in self.records]
        self.whole = self.samples = sum(int(r.active.sum()) for r in self.runs)
        self.part = 1.0

    def _by_force(self) -> Solution | None:
        """The fit to the force that the motion needs, where the drive follows it."""
        before = dict(self.__dict__)
        self._look_at_the_force()
        found = self.alone()
        if len(self.records) > 1:
            found = self._apart(found)
        if self._follows(found):
            return found
        # A force such as gravity may be most of what the drive has to do.
        best = next(iter(self.screen(found)), None)
        if best and self._follows(self.fit(best.axis, (*self.free_of(found), *best.free))):
            return found
        # The drive does not follow the motion either: a cause is what is missing.
        self.__dict__.update(before)
        return None

    def _follows(self, fit: Solution) -> bool:
        """Whether the drive does what the motion of each record needs, but for a part."""
        runs = fit.problem.runs
        return max(fit.random_force(i) / run.drive for i, run in enumerate(runs)) < _IMPOSED

    def _apart(self, now: Solution) -> Solution:
        """The same with levels and offsets of each record's own, where they differ."""
        base, also, own = self.base, self.also, self.own
        for names in ((f"{_BIAS}.force", "coulomb"), ("coulomb",)):
            if "coulomb" not in base or not set(names).isdisjoint(self.known):
                continue
            self.base = tuple(n for n in base if n not in names)
            self.also, self.own = (*also, *names), (*own, *names)
            fit = self.alone()
            more = len(names) * len(self.records) - 1
            if self.worth(now.cost - fit.cost, more) > 0.0 and self.held_out(now, fit).sure:
                return fit
        self.base, self.also, self.own = base, also, own
        return now

    def alone(self) -> Solution:
        """The believed structure, its base parameters free: best of several starts."""
        starts = [self.believed]
        other = {n: c for n, c in self._less_dry().items() if n in self.base}
        if other:
            starts += [with_values(self.believed, list(other), list(other.values()))]
        found = self._parallel([(self.fit, (a, self.also, None, _ITERATIONS)) for a in starts])
        return min(found, key=lambda s: s.cost)

    @cached_property
    def first(self) -> tuple[Solution, list[Candidate]]:
        """The fit without causes, and every candidate beside it that is not hard, best first.

        Where a straight line does better than any, of the force that the motion needs.
        """
        self.tell("base parameters")
        now = self.quieter(self.alone())
        line = self._line(self.few)
        self.tell("first cause")
        found = self.screen(now)

        def lost(candidates: Sequence[Candidate]) -> bool:
            return all(c.cost > line - _CLEAR_OF * self.samples for c in candidates)

        # A drive with a limit is no match for the line either, until that is tried.
        if now.cost > line + _BEHIND * self.samples and lost(found) and not self.late:
            if lost(self.screen(now, stiff=True)):
                by_force = self._by_force()
                if by_force is not None:
                    return by_force, self.screen(by_force)
        return now, found

    def _parallel(self, tasks):  # type: ignore[no-untyped-def]
        if self.jobs == 1 or len(tasks) < 2:
            return [f(*a) for f, a in tasks]
        run = joblib.Parallel(n_jobs=self.jobs, backend="threading")
        return run(joblib.delayed(f)(*a) for f, a in tasks)

    # -- one step ------------------------------------------------------------------

    def earlier(self, now: Solution) -> Solution | None:
        """A model beside inputs that act before their time stamps, where data ask for it."""
        if self.imposed or self.clock or any(e.action in LATE for e in now.axis.effects):
            return None
        noises = now.z[len(now.problem.names) :]
        self.clock = (SHIFT,)
        costs = {}
        for samples in _EARLIER:
            self.shift = -samples * self.scales.step
            problem = self.problem(now.axis, self.free_of(now))
            z = problem.start()
            z[len(problem.names) :] = noises
            costs[self.shift] = problem.at(z).cost
        # The model may have bent for want of it: no cost need be lower yet.
        self.shift = min(costs, key=costs.__getitem__)
        fit = self.fit(now.axis, self.free_of(now), noises, _ITERATIONS)
        sure = fit.values()[SHIFT] < -CLEAR * fit.standard_errors()[SHIFT]
        paid = self.worth(now.cost - fit.cost, 1) > 0.0
        found = fit if sure and paid and self.held_out(now, fit).sure else None
        self.clock, self.shift = (), 0.0
        return found

    def quieter(self, now: Solution) -> Solution:
        """A model beside inputs as smooth as suits it, by which the search goes on.

        Noise that was recorded with an input and pushes nothing counts as random force
        else, and is what a lag seems to take off.
        """
        if self.imposed or self.late or now is self._quiet:
            return now
        shift, inputs = now.values().get(SHIFT, self.shift), self._smoother
        found = self._parallel([
            (self.reference, (now.axis, False, self._some(runs, _SOME), shift))
            for runs in inputs.values()
        ])  # fmt: skip
        fits = dict(zip(inputs, found, strict=True))
        enough = min(fit.cost for fit in found) + SLACK
        smooth = next(count for count in inputs if fits[count].cost < enough)
        if smooth != self.smooth:
            self.smooth_by(smooth)
            now = self.fit(now.axis, self.free_of(now), fits[smooth].z)
        self._quiet = now
        return now

    def smooth_by(self, count: int) -> None:
        """Go on with inputs smoothed over some samples."""
        if count != self.smooth:
            self.smooth = count
            self._take(self._smoother[count])

    @cached_property
    def _smoother(self) -> dict[int, list[Run]]:
        """The records with inputs from which smoothing takes only noise, by its samples."""
        return {n: runs for n in _SMOOTHER if self._takes_noise(runs := self._smooth(n))}

    def _takes_noise(self, runs: Sequence[Run]) -> bool:
        """Whether what smoothing takes off the inputs is white."""
        off = [one.u - smooth.u for one, smooth in zip(self.recorded, runs, strict=True)]
        return all(e[1:] @ e[:-1] <= _WHITE * (e @ e) for e in off)

    def as_recorded(self, fit: Solution) -> Solution:
        """A fit with the random force that the inputs leave as they were recorded."""
        if self.smooth == 1:
            return fit
        problem, known = fit.problem.on(self.recorded), slice(len(fit.problem.names))
        problem.low, problem.high = problem.low.copy(), problem.high.copy()
        problem.low[known] = problem.high[known] = fit.z[known]
        return maximise(problem, fit.z, 12)

    def still_early(self, fit: Solution) -> bool:
        """Whether unseen data still ask for inputs that act before their time stamps."""
        noises = fit.z[len(fit.problem.names) :]
        shift, self.clock = self.shift, ()
        less = self.fit(fit.axis, self.free_of(fit), noises)
        self.clock, self.shift = (SHIFT,), shift
        return self.held_out(less, fit).sure

    def shifted_by(self, fit: Solution | None) -> None:
        """Go on with the inputs as early as in a fit, or as recorded."""
        self.clock = () if fit is None else (SHIFT,)
        self.shift = 0.0 if fit is None else fit.values()[SHIFT]

    def _at_nominal(self, now: Solution) -> Solution:
        """A fit with the base as believed."""
        names = [n for n in self.base if n in now.problem.names]
        axis = with_values(now.axis, names, [self.nominal[n] for n in names])
        alone = self.view(axis, (), self.few, hold=self.hold, scales=self.scales)
        noises = maximise(alone, alone.start(1.0), 6).z
        return self.fit(axis, self.free_of(now), noises, 0)

    def screen(self, now: Solution, first: bool = True, stiff: bool = False) -> list[Candidate]:
        """Effects of the catalogue beside a model, quickly refined, best first.

        Those that are `hard`, or all others: these take as long again.
        """
        if (now, stiff) not in self._screened:
            self._screened[now, stiff] = self._screen(now, first, stiff)
        return self._screened[now, stiff]

    def _screen(self, now: Solution, first: bool, stiff: bool) -> list[Candidate]:
        rows = zip(now.problem.parameters, now.problem.place, now.z, strict=False)
        self.each = {(one.name, i): one.value(c) for one, i, c in rows if i >= 0}
        present = named(now.axis)
        effects = catalogue(now.axis, tuple(n for n in present if self._is_free(now, n)))
        if self.imposed:
            # Of what remembers, a contact shows in a motion as it is: since the last turn.
            shown = [e for e in effects if not hard(e) or effect_class(e).action == "contact"]
            effects = tuple(e for e in shown if effect_class(e).action in _FORCES)
        if self.clock:
            # An input that may be early cannot tell a delay, and with a lag it is smoothed.
            effects = tuple(e for e in effects if effect_class(e).action not in LATE)
        effects = tuple(e for e in effects if hard(e) is stiff)
        besides = [now]
        if effects and self._bent(now, _BENT if first else _BOLD):
            # The base may have bent only for want of the cause.
            besides.append(self._at_nominal(now))
        if stiff:
            # Beside causes the model is nearly right, however far its base has moved.
            starts = self._guessed(besides[-1] if first else now, effects)
            found = self._parallel([(self._patiently, (now, one, first)) for one in starts])
        else:
            terms = now.problem._terms(now.z, now.point)
            found = [c for b in besides for c in self._easily(now, b, terms, effects)]
        best: dict[str, Candidate] = {}
        for c in found:
            if c and (c.slug not in best or c.cost < best[c.slug].cost):
                best[c.slug] = c
        return sorted(best.values(), key=lambda c: c.cost)

    def _guessed(self, beside: Solution, effects: Sequence[str]) -> list[list[Start]]:
        """First guesses of each effect that has some."""
        views = [
            View(beside.axis, self.records[0], self.nominal),
            Corrections(beside, self.nominal),
        ]
        return [one for one in self._parallel(
            [(self._guess, (beside, e, views)) for e in effects]
        ) if one]  # fmt: skip

    def _easily(
        self, now: Solution, beside: Solution, terms: Any, effects: Sequence[str]
    ) -> list[Candidate | None]:
        """Candidates beside a model, from guesses beside it or beside the nominal base."""
        led, plain = list[list[Start]](), list[list[Start]]()
        for one in self._guessed(beside, effects):
            # What the base has bent for shows where all is free; so does what moves
            # the drive in time, and every other parameter with it.
            late = effect_class(one[0].slug).action in LATE
            (led if beside is not now or late else plain).append(one)
        found = self._parallel([(self._fitted, (now, [one[0]], _LED_TURNS)) for one in led])
        return found + self._quickly(now, terms, plain)

    def _is_free(self, now: Solution, name: str) -> bool:
        return any(n.startswith(f"{name}.") for n in now.problem.names)

    def bold(self, fit: Solution) -> bool:
        """Whether a fit has moved a base parameter by more than a factor of two."""
        return self._bent(fit, _BOLD)

    def _bent(self, now: Solution, most: float) -> bool:
        values = now.values()
        return any(
            self.nominal[n] > 0.0 and abs(math.log(max(values[n], 1e-300) / self.nominal[n])) > most
            for n in self.base
            if n in values
        )

    def _guess(self, now: Solution, effect: str, views: Sequence[View]) -> list[Start]:
        """The guesses of one effect, best first."""
        tried: list[Start] = []
        seen: list[Any] = []
        if self.late:
            return tried
        noises = now.z[len(now.problem.names) :]
        for values, base in (guess for view in views for guess in guesses(effect, view)):
            change = {n: c for n, c in base.items() if n in self.base}
            if (values, change) in seen:
                continue
            seen.append((dict(values), change))
            axis = now.axis
            if change:
                axis = with_values(axis, list(change), list(change.values()))
            for beside in (now.axis, axis) if change else (axis,):
                try:
                    start = with_effect(beside, effect, dict(values))
                    free = (*self.free_of(now), *(n for n in start.free if n not in self.known))
                    problem = self.problem(start.axis, free)
                    z = problem.start()
                    z[len(problem.names) :] = noises
                    cost = problem.at(np.clip(z, problem.low, problem.high)).cost
                except ValueError:
                    continue
                tried.append(Start(cost, problem, np.clip(z, problem.low, problem.high), effect))
        tried.sort(key=lambda one: one.cost)
        return tried

    def _refine(self, now: Solution, terms, guessed, turns: int):  # type: ignore[no-untyped-def]
        """The best of some guesses after a quick refinement."""
        best = None
        for one in guessed:
            found = self._quick(now, terms, one.slug, one.problem, one.z, turns)
            if best is None or found[0].cost < best[0].cost:
                best = found
        return best

    def _quickly(self, now: Solution, terms, begun):  # type: ignore[no-untyped-def]
        """Candidates after a quick refinement of their best guesses, the best ones longer."""
        begun = sorted((one[:_REFINED] for one in begun), key=lambda one: one[0].cost)
        runs = self._parallel([(self._refine, (now, terms, one, 1)) for one in begun])
        runs = sorted((r for r in runs if r), key=lambda r: r[0].cost)
        ahead = self._parallel(
            [(self._refine, (now, terms, [Start(c.cost, p, z, c.slug)], _TURNS))
             for c, p, z in runs[:_AHEAD]]
        )  # fmt: skip
        return [c for c, _, _ in [*ahead, *runs[_AHEAD:]]]

    def _patiently(self, now: Solution, guessed: Sequence[Start], first: bool) -> Candidate | None:
        """A candidate from many guesses; to the end those that promise to be of use.

        Beside a cause the model is nearly right: what does not help it as it is hardly
        helps it changed.
        """
        own = [n for n in guessed[0].problem.names if n not in now.problem.names]
        guessed = in_valleys(guessed, own, lambda: self.late, self.fewer)
        guessed = guessed[: _HARD_TRIED[0 if first else 1]]
        if not first and not self.own:  # by itself it would have one record's values in all
            guessed = [one for one in guessed if not self.late and self._helps(now, one)]
        return self._fitted(now, [] if self.late else guessed, _HARD_TURNS[0], now.cost)

    def _helps(self, now: Solution, start: Start) -> bool:
        """Whether an effect, fitted by itself, promises to lower the cost of a model as it is."""
        problem, z = start.problem, start.z
        own = [n for n in problem.names if n not in now.problem.names]
        alone = self.problem(problem.axis_at(z), own, base=())
        begin = alone.start()
        begin[len(alone.names) :] = z[len(problem.names) :]
        fit = maximise(alone, begin, _HARD_TURNS[0], self.until)
        return fit.cost - fit.promised < now.cost - now.problem.prior(now.z)

    def _fitted(
        self, now: Solution, guessed: Sequence[Start], turns: int, below: float | None = None
    ) -> Candidate | None:
        """The best of an effect's guesses, fitted with everything free for some turns.

        Those that promise to come `below` a cost are fitted for more.
        """
        fits = [maximise(one.problem, one.z, turns, self.until) for one in guessed]
        if below is not None:
            fits = sorted((f for f in fits if f.cost - f.promised < below), key=lambda f: f.cost)
            fits = [
                maximise(f.problem, f.z, _HARD_TURNS[1], self.until) for f in fits[:_HARD_REFINED]
            ]
        fits = [f for f in fits if not _hidden_shares(f)]
        if not fits:
            return None
        best, slug = min(fits, key=lambda f: f.cost), guessed[0].slug
        free = tuple(n for n in best.problem.names if n not in now.problem.names)
        return Candidate(slug, free, best.axis, best.cost)

    def less(self, axis: FrictionAxis, slug: str) -> FrictionAxis:
        """An axis with an effect as it is in the nominal one, or not at all."""
        return put(axis, slug, named(self.believed).get(slug))

    def free_of(self, now: Solution) -> tuple[str, ...]:
        """Free parameters of a model beside the base."""
        others = (*self.base, SHIFT)
        return tuple(dict.fromkeys(n for n in now.problem.names if n not in others))

    def _quick(self, now, terms, slug, problem: Likelihood, z, turns):  # type: ignore[no-untyped-def]
        """A few joint steps along new slopes of the candidate and old ones of the rest."""
        count = len(problem.names)
        old = len(now.problem.names)
        own = list(range(old, count))
        place = [*range(old), *range(count, problem.size)]  # where old coordinates are now
        point = problem.at(z)
        damping, fall = 1e-3, 0.0
        for turn in range(turns):
            if self.late:
                break
            _, g, curvature = problem.prior_terms(z)
            h = np.diag(curvature)
            for i, run in enumerate(problem.runs):
                slope = np.zeros((problem.size, 2, len(run.record)))
                slope[place] = terms[2][i]
                exact = [problem.slope(z, point, i, j, slope[j]).sum() for j in own]
                edges = np.array([0, len(run.record)])
                gi, hi = np.zeros((1, problem.size)), np.zeros((1, problem.size, problem.size))
                compiled.normal_terms(point.out[i], run.active, edges, slope, gi, hi)
                gi[0, own] = exact
                g = g + gi[0]
                h = h + hi[0]
            held = ((z <= problem.low) & (g > 0.0)) | ((z >= problem.high) & (g < 0.0))
            held |= np.diag(h) <= 1e-12
            free = np.flatnonzero(~held)
            size = np.sqrt(np.diag(h)[free])
            unit = h[np.ix_(free, free)] / np.outer(size, size)
            far = problem.reach(free, size)
            moved = False
            for _ in range(3):
                step = np.zeros(problem.size)
                damped = unit + damping * np.eye(free.size)
                step[free] = within_reach(damped, g[free] / size, far) / size
                new = np.clip(z + step, problem.low, problem.high)
                tried = problem.tried(new)
                if tried.cost < point.cost:
                    fall = point.cost - tried.cost
                    z, point, moved = new, tried, True
                    damping *= 0.1
                    break
                damping = max(10.0 * damping, 0.1)
            if not moved or fall < 0.5:
                break
            if point.cost - (turns - turn) * fall > now.cost:
                # At this pace it would not even reach the model without it.
                break
        free_names = tuple(problem.names[j] for j in own)
        return Candidate(slug, free_names, problem.axis_at(z), point.cost), problem, z

    def worth(self, gain: float, count: int, causes: int = 1) -> float:
        """Gain of log-likelihood less what so many parameters and causes must bring."""
        return gain - self.penalty(count) - causes * LEAST

    def extend(self, now: Solution, candidates: Sequence[Candidate]):  # type: ignore[no-untyped-def]
        """Fits of the most promising candidates beside a model: worth, candidate, fit."""
        noises = now.z[len(now.problem.names) :]
        names = [n for n in self.base if n in now.problem.names]
        bent = list(map(now.values().__getitem__, names))

        def one(c: Candidate) -> Solution:
            # Beside the nominal base too, and beside the one that bent for want of it: where
            # a parameter starts far from its value, what is believed of it may hold it.
            free = (*self.free_of(now), *c.free)
            other = with_values(c.axis, names, bent)
            starts = [c.axis, *([other] if self.possible(other, free) else [])]
            fits = [self.fit(axis, free, noises, _ITERATIONS) for axis in starts]
            return min(fits, key=lambda s: s.cost)

        left = list(candidates[:_FITTED])
        self.unsure = []
        while left and not self.late:
            best = now.cost - left[0].cost
            chosen = [
                c for c in left
                if now.cost - c.cost > max(self._share(c.slug) * best - SLACK, 0.0)
                and self.worth(now.cost - c.cost, len(c.free)) > -SLACK
            ]  # fmt: skip
            if not chosen:
                break
            fits = self._parallel([(one, (c,)) for c in chosen])
            whole = [
                (self.worth(now.cost - s.cost, len(c.free)), c, s)
                for c, s in zip(chosen, fits, strict=True)
                if self.sound(s, c.slug, c.free)
            ]
            found = [
                one for one in whole
                if self.simpler(one[2], now) or self.held_out(now, one[2]).sure
            ]  # fmt: skip
            doubted = [*self.unsure, *(one for one in whole if one not in found)]
            self.unsure = sorted(doubted, key=lambda one: -one[0])
            if found:
                return self._ranked(sorted(found, key=lambda one: -one[0]))
            # What gains most may be refused: then it is no measure for the others.
            left = [c for c in left if c not in chosen]
        return []

    def _ranked(self, found):  # type: ignore[no-untyped-def]
        """Fits with a cause, those that are close to the best by all samples of the records."""
        if not found:
            return found
        best = found[0][0]
        close = [one for one in found if one[0] > best - max(_CLOSE * best, EQUAL)]
        lags = any(effect_class(c.slug).action == "lag" for _, c, _ in close)
        if len(close) < 2 or (self.part == 1.0 and not lags):
            return found
        close = self.weighed(close)
        last = close[-1][0]
        return close + [(min(w, last), c, s) for w, c, s in found[len(close) :]]

    def weighed(self, found):  # type: ignore[no-untyped-def]
        """Fits with a cause in the order of all samples of the records, the best first.

        A lag also smooths noise that was recorded with the input, which speaks for none:
        beside one, every cause has the input as smooth as suits it.
        """
        lags = [s for _, c, s in found if effect_class(c.slug).action == "lag"]
        counts = {round(part * _time_of(s) / self.scales.step) for s in lags for part in _OVER}
        versions = [self.runs, *map(self._smooth, counts)]

        def whole(c: Candidate, s: Solution) -> float:
            noises = s.z[len(s.problem.names) :]
            free = self.free_of(s)
            fits = [self.fit(s.axis, free, noises, _ITERATIONS, runs=runs) for runs in versions]
            return -min(fit.cost for fit in fits) - self.penalty(len(c.free))

        gains = self._parallel([(whole, (c, s)) for _, c, s in found])
        best = max(w for w, _, _ in found)
        found = [(best + g - max(gains), c, s) for g, (_, c, s) in zip(gains, found, strict=True)]
        return sorted(found, key=lambda one: -one[0])

    def _smooth(self, count: int) -> list[Run]:
        """The records with inputs smoothed over some samples, by local parabolas."""
        if count == 1:
            return self.recorded
        # Windows are odd, and no longer than the record.
        return [
            replace(r, u=savgol_filter(r.u, max(min(count, r.u.size - 2), 2) | 1, 2))
            for r in self.recorded
        ]

    def _share(self, slug: str) -> float:
        return _HARD_SHARE if hard(slug) else _SHARE

    def held_out(self, less: Solution, fit: Solution) -> HeldOut:
        """Gain of a fit over another on all samples of the records.

        What a few samples say of the noises may be far off: where they leave doubt about a
        cause that may be there, both are fitted to all.
        """
        found = HeldOut.of(*(self._costs_of(one) for one in (less, fit)))
        likely = max(found.gain, _DOUBTED * (less.cost - fit.cost)) > LEAST
        if found.sure or self.part == 1.0 or not likely or self.late:
            return found
        return HeldOut.of(*(self._costs_of(self._on_all(one)) for one in (less, fit)))

    def _costs_of(self, one: Solution) -> FloatArray:
        """Cost of each block under parameters to which it did not contribute."""
        if one not in self._costs:
            whole = one.problem.runs[0] is self.runs[0]
            self._costs[one] = one.held_out(None if whole else self.runs)
        return self._costs[one]

    def _on_all(self, one: Solution) -> Solution:
        """A fit to few samples, fitted to all."""
        if one not in self._whole:
            problem = one.problem.on(self.runs)
            self._whole[one] = maximise(problem, one.z, _DOUBTED_TURNS, self.until)
        return self._whole[one]

    def off(self, fit: Solution) -> list[str]:
        """Base parameters that a fit surely moves."""
        values, errors = fit.values(), fit.standard_errors()
        return [
            n for n, nominal in self.nominal.items()
            if n in values
            and abs(values[n] - nominal) > max(CLEAR * errors[n], MOVED * nominal)
        ]  # fmt: skip

    def simpler(self, fit: Solution, less: Solution) -> bool:
        """Whether one cause stands for several base parameters, wrong all at once without it."""
        return len(self.off(less)) > len(self.off(fit)) + 1

    def sound(self, fit: Solution, slug: str, free: Sequence[str], edge: bool = False) -> bool:
        """Whether a cause is determined, and where the machine has been, or at the `edge` of it."""
        values, errors = fit.values(), fit.standard_errors()
        own = {n: values[n] for n in free if n in values}
        if not placed(slug, own, self.records):
            return False
        effect, runs = named(fit.axis)[slug], fit.problem.runs
        if not any(effect.beyond_noise(r.u, fit.random_force(i)) for i, r in enumerate(runs)):
            return False
        kinds = effect_class(slug).parameters()
        hidden = _hidden_shares(fit)
        needed: list[bool] = []
        further: list[bool] = []
        for name, value in own.items():
            of_kind = kinds[name.partition(".")[2]]
            kind = of_kind["kind"]
            if name in hidden or (kind == "speed" and name in fit.at_bound):
                return False
            if kind == "place" and name in fit.at_bound and not edge:
                return False
            # Of what acts at breakaway alone the cost is too rough for standard errors: that it
            # gains is what says that it is there.
            smooth = of_kind["neutral"] is not None and not of_kind["breaks_away"]
            if kind == "amount" and smooth:
                parameter = fit.problem.parameters[fit.problem.names.index(name)]
                there = abs(value - parameter.neutral) > _SURE * errors[name]
                (further if of_kind["optional"] else needed).append(there)
        # What may be left out is one term of a sum, and one of them is enough.
        return all(needed) or any(further)
