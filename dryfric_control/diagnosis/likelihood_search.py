"""Steps of the search for causes by the likelihood of the hybrid filter."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dryfric_control.diagnosis.candidates import (
    amounts,
    catalogue,
    effect_class,
    placed,
    wide,
    with_effect,
)
from dryfric_control.diagnosis.causes import HARDLY
from dryfric_control.diagnosis.gain_or_base import left_open
from dryfric_control.diagnosis.held_out import CLEAR, LEAST, HeldOut
from dryfric_control.diagnosis.likelihood_fits import BIAS, ITERATIONS, LATE, hard
from dryfric_control.diagnosis.screening import Candidate, Screening, hidden_shares
from dryfric_control.estimation.force_view import ForceRun, ForceView, prepare_force
from dryfric_control.estimation.input_noise import without_noise
from dryfric_control.estimation.likelihood import Run
from dryfric_control.estimation.parameters import SHIFT, with_values
from dryfric_control.estimation.scoring import maximise
from dryfric_control.estimation.solution import Solution
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.model.effects.naming import named
from dryfric_control.model.friction import CoulombMap
from dryfric_control.records.motion import ONE_VELOCITY, usual_speeds

FloatArray = NDArray[np.float64]

# Time for the final answer, as a multiple of the time for the fit without causes.
_ANSWER = 5.0
# Largest number of candidates that are fitted in full.
_FITTED = 8
#: Relative change below which a parameter counts as unchanged.
MOVED = 0.01
#: Difference of cost (log-likelihood) below which fits are equally good.
EQUAL = 4.0
# Fraction of the best quick gain below which a candidate is not fitted in full, the same for
# effects that are `hard` and therefore fitted longer before, and the log-likelihood that a full
# fit may add to a quick one.
_SHARE, _HARD_SHARE, SLACK = 0.4, 0.8, 8.0
# Largest expected ratio of a full fit's gain to that of a quick one, in addition to SLACK.
_FULLER = 2.0
# Standard errors by which an amount must differ from its neutral value to be determined.
_SURE = 2.0
# Candidates within this fraction of the best worth are compared on all samples.
_CLOSE = 0.25
# Widths with which noise is taken off the recorded inputs, see `without_noise`, and the largest
# lag-one autocorrelation of the removed part at which it counts as noise.
_WIDTHS, _WHITE = (0.0, 0.8, 1.0, 1.25), 0.1
# Fraction of the gain on the subset of samples that is tested against LEAST to decide whether a
# doubtful cause is refitted to all samples, and the iterations of these fits.
_DOUBTED, _DOUBTED_TURNS = 0.2, 8
#: Name of the reference model without drive and friction.
STRAIGHT = "straight line"
# Signs of an imposed motion: log-likelihood per sample by which the straight line beats the base
# fit, log-likelihood per sample by which a candidate would have to beat the line, and the
# largest random force, as a fraction of the drive, that the required force may then leave.
_BEHIND, _CLEAR_OF, _IMPOSED = 0.1, 0.2, 0.25
# Leads of the input over its time stamps that are tried as starting values [samples].
_EARLIER = (0.5, 1.0, 2.0, 4.0, 8.0)


class Search(Screening):
    """The steps of a search for causes in records of one machine, see `Fits`."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._quiet: Solution | None = None
        self._costs: dict[Solution, FloatArray] = {}
        self._whole: dict[Solution, Solution] = {}
        self._earlier: dict[Solution, Solution | None] = {}
        # Candidates of the last round that held-out data do not confirm: worth, candidate, fit.
        self.unsure: list[tuple[float, Candidate, Solution]] = []
        # Tells whether a fit leaves no structure in free runs; set by the caller that has these.
        self.free_runs: Callable[[Solution], bool] | None = None
        # Full fits of candidates beside a model.
        self._full: dict[tuple[Solution, Candidate], tuple[Candidate, Solution]] = {}

    def _less_dry(self) -> dict[str, float]:
        """Base values with 80 % of the dry friction replaced by viscous friction."""
        level, speed = self.nominal["coulomb"], self.scales.length / self.scales.time
        return {"coulomb": 0.2 * level, "viscous": self.nominal["viscous"] + 0.8 * level / speed}

    def references(self) -> dict[str, float]:
        """Costs of the nominal axis and of a straight line, only their noises fitted.

        The straight line has no drive and no friction.  A model whose inertia or gain
        makes the drive ineffective approaches it.
        """
        found = {"nominal axis": self.reference(self.believed).cost}
        return found if self.imposed else found | {STRAIGHT: self._line(self.runs)}

    def _line(self, runs: Sequence[Run]) -> float:
        """Cost of the straight line, the axis without drive and friction."""
        line = FrictionAxis(mass=self.believed.mass, viscous=0.0, coulomb=CoulombMap.of(0.0))
        return self.reference(line, idle=True, runs=runs).cost

    def _look_at_the_force(self) -> None:
        """Switch to the force view: compare the drive with the force that the motion requires."""
        self.view, self.width = ForceView, 0.0
        self.runs = self.few = self.fewer = [prepare_force(r, self.hold) for r in self.records]
        self.whole = self.samples = sum(int(r.active.sum()) for r in self.runs)
        self.part = 1.0

    def _by_force(self) -> Solution | None:
        """Fit in the force view; None if the drive does not follow the required force."""
        before = dict(self.__dict__)
        self._look_at_the_force()
        found = self.alone()
        if len(self.records) > 1:
            found = self._apart(found)
        self.steady = self._one_velocity()
        if self.steady and "viscous" in self.base:
            self.base = tuple(n for n in self.base if n != "viscous")
            found = self.alone()
        if self._follows(found):
            return found
        # An effect such as gravity may make up most of the required force.
        best = next(iter(self.screen(found)), None)
        if best and self._follows(self.fit(best.axis, (*self.free_of(found), *best.free))):
            return found
        # The motion is not imposed: restore the likelihood view, a cause is missing.
        self.__dict__.update(before)
        return None

    def _one_velocity(self) -> bool:
        """Whether each direction has nearly one velocity, in each record that has its own level.

        Then only the samples next to the turns separate what depends on velocity from the
        level, and there the motion changes in other ways, too.
        """
        motions = [run.sliding.v for run in self.runs if isinstance(run, ForceRun)]
        if "coulomb" not in self.own:
            motions = [np.concatenate(motions)]
        speeds = [usual_speeds(v[s * v > 0.0]) for v in motions for s in (1.0, -1.0)]
        return all(fast < ONE_VELOCITY * slow for slow, fast in speeds if fast > 0.0)

    def _follows(self, fit: Solution) -> bool:
        """Whether the drive matches the required force of each record up to a fraction."""
        runs = fit.problem.runs
        return max(fit.random_force(i) / run.drive for i, run in enumerate(runs)) < _IMPOSED

    def _apart(self, now: Solution) -> Solution:
        """The fit with a Coulomb level and offset per record, where the records differ."""
        base, also, own = self.base, self.also, self.own
        for names in ((f"{BIAS}.force", "coulomb"), ("coulomb",)):
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
        """Best fit of the nominal structure with free base parameters, from several starts."""
        starts = [self.believed]
        other = {n: c for n, c in self._less_dry().items() if n in self.base}
        if other:
            starts += [with_values(self.believed, list(other), list(other.values()))]
        found = self._parallel([(self.fit, (a, self.also, None, ITERATIONS)) for a in starts])
        return min(found, key=lambda s: s.cost)

    @cached_property
    def begun(self) -> Solution:
        """The fit without causes; its duration predicts the time for the final answer."""
        self.tell("base parameters")
        begun = time.monotonic()
        # The least smoothing: a smoother input may hide that it does not cause the motion.
        found = self.quieter(self.alone(), most=False)
        self.until = max(self.until, self.end - _ANSWER * (time.monotonic() - begun))
        return found

    @cached_property
    def _line_of_few(self) -> float:
        return self._line(self.few)

    @property
    def driven(self) -> bool:
        """Whether the nominal structure predicts the motion at least as well as a straight line."""
        return self.begun.cost <= self._line_of_few + _BEHIND * self.samples

    @cached_property
    def first(self) -> tuple[Solution, list[Candidate]]:
        """The fit without causes, and its candidates that are not `hard`, best first.

        If a straight line is better than all of them, both are those of the force view.
        """
        now, line = self.begun, self._line_of_few
        self.tell("first cause")
        found = self.screen(now)

        def lost(candidates: Sequence[Candidate]) -> bool:
            return all(c.cost > line - _CLEAR_OF * self.samples for c in candidates)

        # A drive that saturates may lose to the line too, until the `hard` effects are tried.
        if not self.driven and lost(found) and not self.late:
            if lost(self.screen(now, stiff=True)):
                by_force = self._by_force()
                if by_force is not None:
                    return by_force, self.screen(by_force)
        return now, found

    def earlier(self, now: Solution) -> Solution | None:
        """The model with inputs that act before their time stamps, if the data require it."""
        if self.imposed or self.clock or any(e.action in LATE for e in now.axis.effects):
            return None
        if now not in self._earlier:
            self._earlier[now] = self._led(now)
        return self._earlier[now]

    def _led(self, now: Solution) -> Solution | None:
        """A fit of the lead; None if it does not pay or held-out data do not confirm it."""
        noises = now.z[len(now.problem.names) :]
        self.clock = (SHIFT,)
        costs = {}
        for samples in _EARLIER:
            self.shift = -samples * self.scales.step
            problem = self.problem(now.axis, self.free_of(now))
            costs[self.shift] = problem.at(problem.start(noises=noises)).cost
        # Parameters may have compensated for the lead, so no cost needs to be lower yet.
        self.shift = min(costs, key=costs.__getitem__)
        fit = self.fit(now.axis, self.free_of(now), noises, ITERATIONS)
        sure = fit.values()[SHIFT] < -CLEAR * fit.standard_errors()[SHIFT]
        paid = self.worth(now.cost - fit.cost, 1) > 0.0
        found = fit if sure and paid and self.held_out(now, fit).sure else None
        self.clock, self.shift = (), 0.0
        return found

    def quieter(self, now: Solution, most: bool = True) -> Solution:
        """The model with as smooth an input as it allows; the search continues with it.

        Measurement noise of the input does not act on the axis.  Without smoothing it would
        count as random force, a lag that filters it would seem to be a cause, and the axis
        would break away too early, each time by another amount.
        `most`: whether the smoothest or the least smooth of equally likely inputs is taken.
        """
        if self.imposed or self.late or now is self._quiet:
            return now
        shift, inputs = now.values().get(SHIFT, self.shift), self._smoother
        found = self._parallel([
            (self.reference, (now.axis, False, self._some(runs), shift))
            for runs in inputs.values()
        ])  # fmt: skip
        fits = dict(zip(inputs, found, strict=True))
        enough = min(fit.cost for fit in found) + SLACK
        widths = [width for width in inputs if fits[width].cost < enough]
        width = max(widths) if most else min(widths)
        if width != self.width:
            self.smooth_by(width)
            now = self.fit(now.axis, self.free_of(now), fits[width].z)
        self._quiet = now
        return now

    def smooth_by(self, width: float) -> None:
        """Use inputs without their noise, taken off with some width, from now on."""
        if width != self.width:
            self.width = width
            self._take(self._smoother[width])

    @cached_property
    def _smoother(self) -> dict[float, list[Run]]:
        """Runs by the width with which noise is taken off their inputs, if only noise is."""
        found = {0.0: self.recorded}
        for width in _WIDTHS[1:]:
            runs = [replace(r, u=without_noise(r.u, width)) for r in self.recorded]
            if all(e[1:] @ e[:-1] <= _WHITE * (e @ e) for e in self._taken_off(runs)):
                found[width] = runs
        return found

    def _taken_off(self, runs: Sequence[Run]) -> list[FloatArray]:
        """What the inputs as recorded have more than those of some runs."""
        return [one.u - smooth.u for one, smooth in zip(self.recorded, runs, strict=True)]

    @property
    def input_noise(self) -> float:
        """RMS of the noise that is taken off the inputs."""
        return float(np.sqrt(np.mean(np.concatenate(self._taken_off(self.runs)) ** 2)))

    @property
    def gain_is_open(self) -> bool:
        """Whether nothing separates an input gain from errors of all base parameters."""
        return left_open(self.believed, {*self.known, *self.tolerance})

    def as_recorded(self, fit: Solution) -> Solution:
        """The fit on inputs as recorded, with only the noises fitted again."""
        if self.width == 0.0:
            return fit
        problem, known = fit.problem.on(self.recorded), slice(len(fit.problem.names))
        problem.low, problem.high = problem.low.copy(), problem.high.copy()
        problem.low[known] = problem.high[known] = fit.z[known]
        return maximise(problem, fit.z, 12)

    def still_early(self, fit: Solution) -> bool:
        """Whether held-out data still require inputs that act before their time stamps."""
        noises = fit.z[len(fit.problem.names) :]
        shift, self.clock, self.shift = self.shift, (), 0.0
        less = self.fit(fit.axis, self.free_of(fit), noises)
        self.clock, self.shift = (SHIFT,), shift
        return self.held_out(less, fit).sure

    def shifted_by(self, fit: Solution | None) -> None:
        """Use the input lead of a fit from now on; None: inputs as recorded."""
        self.clock = () if fit is None else (SHIFT,)
        self.shift = 0.0 if fit is None else fit.values()[SHIFT]

    def extend(self, now, candidates, notable=0.0):  # type: ignore[no-untyped-def]
        """Full fits of the most promising candidates: worth, candidate, fit.

        Only candidates whose gain may reach `notable`, on the subset or on all samples.
        """
        noises = now.z[len(now.problem.names) :]
        names = [n for n in self.base if n in now.problem.names]
        bent = list(map(now.values().__getitem__, names))

        def one(c: Candidate) -> tuple[Candidate, Solution]:
            # Start from the candidate's base values and from those of the present fit: from
            # far away, the prior may hold a parameter near its nominal value.
            free = (*self.free_of(now), *c.free)
            other = with_values(c.axis, names, bent)
            starts = [c.axis, *([other] if self.possible(other, free) else [])]
            fits = [self.fit(axis, free, noises, ITERATIONS) for axis in starts]
            return self.simplest(now, c, min(fits, key=lambda s: s.cost))

        left = [c for c in candidates[:_FITTED] if self._may_gain(now, c, notable)]
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
            new = [c for c in chosen if (now, c) not in self._full]
            full = self._parallel([(one, (c,)) for c in new])
            self._full |= {(now, c): fit for c, fit in zip(new, full, strict=True)}
            fits = sorted((self._full[now, c] for c in chosen), key=lambda f: -f[1].cost)
            # The best fit of each effect, which may come from another that it is nested in.
            best_of = {c.slug: (c, s) for c, s in fits}
            whole = [
                (self.worth(now.cost - s.cost, len(c.free)), c, s)
                for c, s in best_of.values()
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
            # All these were rejected: compare the others with the best of the rest.
            left = [c for c in left if c not in chosen]
        return []

    def simplest(self, now: Solution, c: Candidate, fit: Solution) -> tuple[Candidate, Solution]:
        """A candidate and its fit; if a mass share vanishes, the simpler effect that it is then."""
        other = named(fit.axis)[c.slug].nested(fit.axis) if hidden_shares(fit) else None
        if other is None or other[0] in named(now.axis) or other[0] not in catalogue(now.axis):
            return c, fit
        start = with_effect(self.less(fit.axis, c.slug), *other)
        free = (*self.free_of(now), *start.free)
        if not self.possible(start.axis, free):
            return c, fit
        found = self.fit(start.axis, free, fit.z[len(fit.problem.names) :], ITERATIONS)
        return Candidate(other[0], start.free, found.axis, found.cost), found

    def _may_gain(self, now: Solution, c: Candidate, least: float) -> bool:
        """Whether a full fit of a candidate may gain `least`, on the subset or on all samples."""
        if _FULLER * (now.cost - c.cost) + SLACK >= least or self.part == 1.0:
            return _FULLER * (now.cost - c.cost) + SLACK >= least
        noises = now.z[len(now.problem.names) :]
        shift = now.values().get(SHIFT, self.shift)
        costs = [
            self.view(axis, (), self.runs, hold=self.hold, scales=self.scales, shift=shift)
            .tried(noises)
            .cost
            for axis in (now.axis, c.axis)
        ]
        return _FULLER * self.part * (costs[0] - costs[1]) + SLACK >= least

    def _ranked(self, found):  # type: ignore[no-untyped-def]
        """Fits with a cause, those close to the best reordered by all samples."""
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
        """Fits with a cause, ordered by their costs on all samples, best first.

        A lag also filters noise that was recorded with the input, which is no evidence for
        it: in a comparison with a lag, every cause gets the input smoothing that suits it best.
        """
        lags = any(effect_class(c.slug).action == "lag" for _, c, _ in found)
        versions = list(self._smoother.values()) if lags else [self.runs]

        def whole(c: Candidate, s: Solution) -> float:
            noises = s.z[len(s.problem.names) :]
            free = self.free_of(s)
            fits = [self.fit(s.axis, free, noises, ITERATIONS, runs=runs) for runs in versions]
            return -min(fit.cost for fit in fits) - self.penalty(len(c.free))

        gains = self._parallel([(whole, (c, s)) for _, c, s in found])
        best = max(w for w, _, _ in found)
        found = [(best + g - max(gains), c, s) for g, (_, c, s) in zip(gains, found, strict=True)]
        return sorted(found, key=lambda one: -one[0])

    def _share(self, slug: str) -> float:
        return _HARD_SHARE if hard(slug) else _SHARE

    def held_out(self, less: Solution, fit: Solution) -> HeldOut:
        """Held-out gain of `fit` over `less` on all samples of the records.

        The noises estimated on a subset of the samples may be far off.  If they leave a
        likely cause in doubt, both fits are repeated on all samples.
        """
        found = HeldOut.of(*(self._costs_of(one) for one in (less, fit)))
        likely = max(found.gain, _DOUBTED * (less.cost - fit.cost)) > LEAST
        if found.sure or self.part == 1.0 or not likely or self.late:
            return found
        return HeldOut.of(*(self._costs_of(self._on_all(one)) for one in (less, fit)))

    def nothing_left(self, now: Solution) -> bool:
        """Whether free runs show no structure that a fit leaves; False where none judge."""
        return self.free_runs is not None and self.free_runs(now)

    def looked_closer(self, now: Solution) -> Solution | None:
        """The fit on samples where it leaves structure; None if it leaves none, or was there."""
        if self.part == 1.0 or self.worst or self.imposed or self.late:
            return None
        if self.free_runs is None or self.free_runs(now):
            return None
        self.tell("where structure is left")
        self.aim(self._on_all(now))
        return self.fit(now.axis, self.free_of(now), now.z[len(now.problem.names) :])

    def _costs_of(self, one: Solution) -> FloatArray:
        """Cost of each block under parameters fitted without that block."""
        if one not in self._costs:
            whole = one.problem.runs[0] is self.runs[0]
            self._costs[one] = one.held_out(None if whole else self.runs)
        return self._costs[one]

    def _on_all(self, one: Solution) -> Solution:
        """A fit to a subset of the samples, continued on all of them."""
        if one not in self._whole:
            problem = one.problem.on(self.runs)
            self._whole[one] = maximise(problem, one.z, _DOUBTED_TURNS, self.until)
        return self._whole[one]

    def off(self, fit: Solution) -> list[str]:
        """Base parameters that a fit changes significantly from nominal."""
        values, errors = fit.values(), fit.standard_errors()
        return [
            n for n, nominal in self.nominal.items()
            if n in values
            and abs(values[n] - nominal) > max(CLEAR * errors[n], MOVED * nominal)
        ]  # fmt: skip

    def simpler(self, fit: Solution, less: Solution) -> bool:
        """Whether a cause replaces errors of at least two base parameters."""
        return len(self.off(less)) > len(self.off(fit)) + 1

    def vanished(self, fit: Solution, slug: str, free: Sequence[str]) -> bool:
        """Whether an amount without which a cause is not there is no larger than its error."""
        return not self._there(fit, slug, free, 1.0)

    def _there(
        self, fit: Solution, slug: str, free: Sequence[str], least: float, everywhere: bool = False
    ) -> bool:
        """Whether the amounts of a cause are larger than some number of standard errors.

        Optional amounts are terms of a sum: one significant term is sufficient.
        """
        values, errors = fit.values(), fit.standard_errors()
        own = [n for n in free if n in values]
        rows = [
            (abs(values[name] - neutral) > least * errors[name], optional)
            for name, neutral, optional in amounts(slug, own, everywhere)
        ]
        needed = all(there for there, optional in rows if not optional)
        return needed or any(there for there, optional in rows if optional)

    def sound(self, fit: Solution, slug: str, free: Sequence[str], edge: bool = False) -> bool:
        """Whether a cause is determined and lies in the travelled range.

        `edge`: whether a position at the edge of the range is accepted.
        """
        values = fit.values()
        own = {n: values[n] for n in free if n in values}
        if not placed(slug, own, self.records):
            return False
        effect, runs = named(fit.axis)[slug], fit.problem.runs
        if not any(effect.beyond_noise(r.u, fit.random_force(i)) for i, r in enumerate(runs)):
            return False
        axes = [fit.problem.axis_at(fit.z, i) for i in range(len(runs))]
        if not all(named(axis)[slug].plausible(axis) for axis in axes):
            return False
        kinds = effect_class(slug).parameters()
        hidden = hidden_shares(fit)
        for name in own:
            of_kind = kinds[name.partition(".")[2]]
            kind = of_kind["kind"]
            # A peak narrower than the record shows still raises breakaway.
            gone = kind == "speed" and not of_kind["breaks_away"] and name in fit.at_bound
            if name in hidden or gone:
                return False
            if kind == "place" and name in fit.at_bound and not edge:
                return False
        # An effect with a memory can imitate much of what is missing.
        least = 1.0 / HARDLY if hard(slug) else _SURE
        return self._there(fit, slug, free, least, wide(slug, own, self.records))
