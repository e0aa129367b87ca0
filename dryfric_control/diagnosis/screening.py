"""Screening of the catalogue: first guesses of every effect, quickly refined."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from dryfric_control.compiled import likelihood as compiled
from dryfric_control.diagnosis.candidates import (
    amounts,
    catalogue,
    effect_class,
    guesses,
    own_names,
    placed,
    with_effect,
)
from dryfric_control.diagnosis.likelihood_fits import LATE, Fits, hard
from dryfric_control.diagnosis.starts import Start, in_valleys
from dryfric_control.estimation.force_residual import View
from dryfric_control.estimation.likelihood import (
    Likelihood,
)
from dryfric_control.estimation.parameters import with_values
from dryfric_control.estimation.scoring import maximise, within_reach
from dryfric_control.estimation.solution import Solution
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.model.effects.naming import named

# Number of guesses per candidate that are refined, and of candidates refined for all iterations.
_REFINED, _AHEAD = 2, 10
# For `hard` effects: number of guesses that are fitted (first cause, further causes), iterations
# of a first and of a continued fit, and number of promising fits that are continued.
_HARD_TRIED, _HARD_TURNS, _HARD_REFINED = (6, 2), (3, 10), 2
# Largest further gain of such a fit, over the predicted gain of its last step.
_AHEAD_OF = 2.0
# Iterations of the quick refinement, in which the slopes of the base stay constant.
_TURNS = 4
# Iterations of a fit that starts from the nominal base.
_LED_TURNS = 8
# Deviation of ln(base value / nominal) beyond which missing causes may have biased the base
# values: before the first cause, where no candidate gains enough, and always.
_BENT, _AWAY, _BOLD = 0.1, 0.3, math.log(2.0)
# Number of force corrections from which first guesses are made.
_SEEN = 8000
# Actions of effects that are visible as a force in an imposed motion.
_FORCES = ("force", "friction", "contact")


@dataclass(frozen=True, eq=False)
class Candidate:
    """A possible cause: its name, free parameters, the axis with it, and the cost."""

    slug: str
    free: tuple[str, ...]
    axis: FrictionAxis
    cost: float


def hidden_shares(fit: Solution) -> list[str]:
    """Mass shares that ended at a bound: one of the two masses is too light to be identified."""
    p = fit.problem
    rows = zip(p.names, p.parameters, strict=True)
    return [n for n, one in rows if one.kind == "share" and n in fit.at_bound]


def _best_of(candidates: Sequence[Candidate | None]) -> list[Candidate]:
    """The best candidate of each effect, lowest cost first."""
    best: dict[str, Candidate] = {}
    for c in candidates:
        if c and (c.slug not in best or c.cost < best[c.slug].cost):
            best[c.slug] = c
    return sorted(best.values(), key=lambda c: c.cost)


class Corrections(View):
    """View for first guesses: the force by which the filter corrects the model.

    Velocity and acceleration come from the filter instead of numerical derivatives, which
    makes them far less noisy where the readings are noisy.
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


class Screening(Fits):
    """Fits, and the screening of catalogue effects on top of them."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._seen: dict[Solution, list[Candidate]] = {}
        self._screened: dict[tuple[Solution, bool], list[Candidate]] = {}

    def glance(self, now: Solution) -> list[Candidate]:
        """Candidates that are not `hard`, fitted from the present model only, best first."""
        if now not in self._seen:
            self._seen[now] = _best_of(self._easily(now, now, self._effects(now, False)))
        return self._seen[now]

    def screen(
        self, now: Solution, first: bool = True, stiff: bool = False, notable: float = 0.0,
        thorough: bool = False,
    ) -> list[Candidate]:  # fmt: skip
        """Effects of the catalogue added to a model, quickly refined, best first.

        `stiff`: the effects that are `hard`, else all others.  `hard` effects take as long as
        all others and are given up where their expected gain is below half of `notable`.
        `first`: whether the model has no causes yet.
        `thorough`: `hard` effects are fitted from as many guesses as a first cause.
        """
        if (now, stiff) not in self._screened:
            self._screened[now, stiff] = self._screen(now, first, stiff, notable, thorough or first)
        return self._screened[now, stiff]

    def _effects(self, now: Solution, stiff: bool) -> tuple[str, ...]:
        """Effects of the catalogue that may be added to a model."""
        rows = zip(now.problem.parameters, now.problem.place, now.z, strict=False)
        self.each = {(one.name, i): one.value(c) for one, i, c in rows if i >= 0}
        present = named(now.axis)
        effects = catalogue(now.axis, tuple(n for n in present if self._is_free(now, n)))
        if self.imposed:
            # Of effects with memory only a contact follows from the motion since the last reversal.
            shown = [e for e in effects if not hard(e) or effect_class(e).action == "contact"]
            forces = (e for e in shown if effect_class(e).action in _FORCES)
            # The drive follows the friction there: as the load it would explain itself.
            effects = tuple(e for e in forces if not effect_class(e).loaded())
            if self.steady:
                effects = tuple(e for e in effects if not effect_class(e).needs_velocities())
        if self.clock:
            # A free input lead cannot be separated from a delay; a lag would smooth the input.
            effects = tuple(e for e in effects if effect_class(e).action not in LATE)
        return tuple(e for e in effects if hard(e) is stiff)

    def _screen(
        self, now: Solution, first: bool, stiff: bool, notable: float, thorough: bool
    ) -> list[Candidate]:
        found: list[Candidate | None] = [] if stiff else [*self.glance(now)]
        effects = self._effects(now, stiff)
        # Base values may be biased only because the cause is still missing.
        stalled = not stiff and all(now.cost - c.cost < notable for c in self.glance(now))
        bent = effects and self._bent(now, _BENT if first else _AWAY if stalled else _BOLD)
        if stiff:
            # With causes found, the model is nearly right even if its base values have moved.
            beside = self._at_nominal(now) if bent and first else now
            starts = self._guessed(beside, effects)
            found = self._parallel(
                [(self._patiently, (now, one, thorough, 0.5 * notable)) for one in starts]
            )
        elif bent:
            found = found + self._easily(now, self._at_nominal(now), effects)
        return _best_of(found)

    def _at_nominal(self, now: Solution) -> Solution:
        """The model with its base at nominal, noises fitted."""
        names = [n for n in self.base if n in now.problem.names]
        axis = with_values(now.axis, names, [self.nominal[n] for n in names])
        alone = self.view(axis, (), self.few, hold=self.hold, scales=self.scales, shift=self.shift)
        noises = maximise(alone, alone.start(1.0), 6).z
        return self.fit(axis, self.free_of(now), noises, 0)

    def _guessed(self, beside: Solution, effects: Sequence[str]) -> list[list[Start]]:
        """First guesses, one list for each effect that has any."""
        views = [
            View(beside.axis, self.records[0], self.nominal),
            Corrections(beside, self.nominal),
        ]
        return [one for one in self._parallel(
            [(self._guess, (beside, e, views)) for e in effects]
        ) if one]  # fmt: skip

    def _easily(
        self, now: Solution, beside: Solution, effects: Sequence[str]
    ) -> list[Candidate | None]:
        """Candidates added to the model `now`, from guesses made for `beside`.

        `beside` is the same model, or the one with its base at nominal.
        """
        led, plain = list[list[Start]](), list[list[Start]]()
        for one in self._guessed(beside, effects):
            # Starting from the nominal base, or with an effect that shifts the drive in time,
            # all parameters change and must be fitted jointly.
            late = effect_class(one[0].slug).action in LATE
            (led if beside is not now or late else plain).append(one)
        found = self._parallel([(self._fitted, (now, [one[0]], _LED_TURNS)) for one in led])
        return found + self._quickly(now, plain)

    def _is_free(self, now: Solution, name: str) -> bool:
        return any(n.startswith(f"{name}.") for n in now.problem.names)

    def bold(self, fit: Solution) -> bool:
        """Whether a fit has changed a base parameter by more than a factor of two."""
        return self._bent(fit, _BOLD)

    def _bent(self, now: Solution, most: float) -> bool:
        values = now.values()
        return any(
            self.nominal[n] > 0.0 and abs(math.log(max(values[n], 1e-300) / self.nominal[n])) > most
            for n in self.base
            if n in values
        )

    def _guess(self, now: Solution, effect: str, views: Sequence[View]) -> list[Start]:
        """Starts from the guesses of one effect, lowest cost first."""
        tried: list[Start] = []
        seen: list[Any] = []
        if self.late:
            return tried
        noises = now.z[len(now.problem.names) :]
        may_change = {*self.base, *self.free_of(now)}
        for values, base in (guess for view in views for guess in guesses(effect, view)):
            change = {n: c for n, c in base.items() if n in may_change}
            if (values, change) in seen:
                continue
            seen.append((dict(values), change))
            axis = now.axis
            if change:
                axis = with_values(axis, list(change), list(change.values()))
            held = [n for n in own_names(effect) if n in self.known or self.constant(n)]
            values = dict(values)
            values |= {n.partition(".")[2]: views[0].middle for n in held if self.constant(n)}
            for beside in (now.axis, axis) if change else (axis,):
                try:
                    start = with_effect(beside, effect, dict(values))
                    free = (*self.free_of(now), *(n for n in start.free if n not in held))
                    problem = self.problem(start.axis, free)
                    z = problem.start(noises=noises)
                    cost = problem.at(z).cost
                except ValueError:
                    continue
                tried.append(Start(cost, problem, z, effect))
        tried.sort(key=lambda one: one.cost)
        return [*self._without_any(now, tried), *tried]

    def _without_any(self, now: Solution, tried: Sequence[Start]) -> list[Start]:
        """The start with none of an effect, where all guesses are worse; none if it has a shape.

        Guesses made while other causes are missing may be far off, or of the wrong sign.
        """
        if not tried or tried[0].cost <= now.cost:
            return []
        problem, known = tried[0].problem, len(now.problem.names)
        own = problem.parameters[known:]
        neutral = {n: v for n, v, _ in amounts(tried[0].slug, [p.name for p in own], True)}
        if len(neutral) < len(own) or any(p.logarithmic for p in own):
            return []
        z = tried[0].z.copy()
        z[: known + len(own)] = [*now.z[:known], *(p.search(neutral[p.name]) for p in own)]
        return [tried[0]._replace(cost=problem.tried(z).cost, z=z)]

    def nearest(
        self, less: FrictionAxis, one: Candidate, free: Sequence[str], noises: Any
    ) -> FrictionAxis | None:
        """An axis with a candidate added, at its own values or the likeliest guess for the axis."""
        best: tuple[float, FrictionAxis | None] = (math.inf, None)
        view = View(less, self.records[0], self.nominal)
        mine = asdict(named(one.axis)[one.slug])
        for values in (mine, *(guess for guess, _ in guesses(one.slug, view))):
            fixed = {n: v for n, v in mine.items() if f"{one.slug}.{n}" not in one.free}
            try:
                axis = with_effect(less, one.slug, mine | values | fixed).axis
                problem = self.problem(axis, free)
            except ValueError:
                continue
            cost = problem.tried(problem.start(noises=noises)).cost
            if cost < best[0]:
                best = cost, axis
        return best[1]

    def _refine(self, now: Solution, terms, guessed, turns: int):  # type: ignore[no-untyped-def]
        """The best of several guesses after a quick refinement."""
        best = None
        for one in guessed:
            found = self._quick(now, terms, one.slug, one.problem, one.z, turns)
            if best is None or found[0].cost < best[0].cost:
                best = found
        return best

    def _quickly(self, now: Solution, begun):  # type: ignore[no-untyped-def]
        """Candidates after a quick refinement; the best ones are refined longer."""
        if not begun:
            return []
        terms = now.problem.with_slopes(now.z, now.point)
        begun = sorted((one[:_REFINED] for one in begun), key=lambda one: one[0].cost)
        runs = self._parallel([(self._refine, (now, terms, one, 1)) for one in begun])
        runs = sorted((r for r in runs if r), key=lambda r: r[0].cost)
        ahead = self._parallel(
            [(self._refine, (now, terms, [Start(c.cost, p, z, c.slug)], _TURNS))
             for c, p, z in runs[:_AHEAD]]
        )  # fmt: skip
        return [c for c, _, _ in [*ahead, *runs[_AHEAD:]]]

    def _patiently(
        self, now: Solution, guessed: Sequence[Start], thorough: bool, least: float
    ) -> Candidate | None:
        """A candidate from many guesses; only promising ones are fitted to the end.

        With a cause found the model is nearly right: unless `thorough`, an effect is given up
        that gains nothing with all other parameters fixed.
        """
        own = [n for n in guessed[0].problem.names if n not in now.problem.names]
        guessed = in_valleys(guessed, own, lambda: self.late, self.fewer)
        guessed = guessed[: _HARD_TRIED[0 if thorough else 1]]
        if not thorough and not self.own:  # `_helps` would use one record's own values for all
            guessed = [one for one in guessed if not self.late and self._helps(now, one, least)]
        return self._fitted(now, [] if self.late else guessed, _HARD_TURNS[0], now.cost - least)

    def _helps(self, now: Solution, start: Start, least: float) -> bool:
        """Whether an effect alone, the model fixed, is predicted to gain more than `least`."""
        problem, z = start.problem, start.z
        own = [n for n in problem.names if n not in now.problem.names]
        alone = self.problem(problem.axis_at(z), own, base=())
        begin = alone.start(noises=z[len(problem.names) :])
        fit = maximise(alone, begin, _HARD_TURNS[0], self.until)
        return fit.cost - fit.promised < now.cost - now.problem.prior(now.z) - least

    def _fitted(
        self, now: Solution, guessed: Sequence[Start], turns: int, below: float | None = None
    ) -> Candidate | None:
        """The best guess of an effect after a joint fit of `turns` iterations.

        With `below`: only fits that are predicted to reach a cost below it, fitted longer.
        """
        fits = [maximise(one.problem, one.z, turns, self.until) for one in guessed]
        if below is not None:
            # Far from the optimum the quadratic prediction is too small.  Fits with a share at
            # its bound come last, as it may stay there.
            ahead = [(len(hidden_shares(f)), f.cost - _AHEAD_OF * f.promised, f) for f in fits]
            ahead.sort(key=lambda one: one[:2])
            fits = [f for _, cost, f in ahead if cost < below]
            # The others stay: one that has arrived promises nothing more, and may be the best.
            fits[:_HARD_REFINED] = [
                maximise(f.problem, f.z, _HARD_TURNS[1], self.until) for f in fits[:_HARD_REFINED]
            ]
            fits = [f for f in fits if self._shown(now, f, guessed[0].slug)]
        fits = [f for f in fits if not hidden_shares(f)]
        if not fits:
            return None
        best, slug = min(fits, key=lambda f: f.cost), guessed[0].slug
        free = tuple(n for n in best.problem.names if n not in now.problem.names)
        return Candidate(slug, free, best.axis, best.cost)

    def _shown(self, now: Solution, fit: Solution, slug: str) -> bool:
        """Whether the records show an effect where a fit has put it, see `placed`."""
        values = fit.values()  # without those that each record has of its own
        names = [n for n in fit.problem.names if n in values and n not in now.problem.names]
        return placed(slug, {n: values[n] for n in names}, self.records)

    def _quick(self, now, terms, slug, problem: Likelihood, z, turns):  # type: ignore[no-untyped-def]
        """A few joint steps: new slopes of the candidate, constant slopes of the rest."""
        count = len(problem.names)
        old = len(now.problem.names)
        own = list(range(old, count))
        place = [*range(old), *range(count, problem.size)]  # new indices of the old coordinates
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
                # At this rate it would not even reach the cost of the model without it.
                break
        free_names = tuple(problem.names[j] for j in own)
        return Candidate(slug, free_names, problem.axis_at(z), point.cost), problem, z
