"""Search for causes by the likelihood of the hybrid filter, over the catalogue.

`diagnose` does not use it yet: `benchmarks/likelihood_real.py` shows what it finds on
measured machines, and what it does not.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import joblib
import numpy as np
from numpy.typing import NDArray

from dryfric_control.compiled import likelihood as compiled
from dryfric_control.diagnosis.candidates import catalogue, guesses, with_effect
from dryfric_control.estimation.force_residual import View
from dryfric_control.estimation.likelihood import (
    BASE,
    Likelihood,
    Point,
    Run,
    Solution,
    maximise,
    prepare,
)
from dryfric_control.estimation.parameters import typical, values_of, with_values
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.model.effects.naming import named
from dryfric_control.model.friction import CoulombMap
from dryfric_control.records.record import Record

FloatArray = NDArray[np.float64]

# Guesses of a candidate that are refined, and candidates that are fitted in full.
_REFINED, _FITTED = 2, 5
# Turns of the quick refinement, along slopes of the base that stay as they are.
_TURNS = 4
# Gain of log-likelihood beyond that of its parameters which a cause must bring,
# and beside a better one to count as a rival.
_LEAST = 6.0
# Part of the best quick gain below which a candidate is not fitted in full, and what
# a full fit may add to a quick one.
_SHARE, _SLACK = 0.4, 8.0
# Iterations of a full fit while candidates are compared.
_ITERATIONS = 15


@dataclass(frozen=True, eq=False)
class Candidate:
    """A cause on trial.

    Attributes
    ----------
    slug : str
    free : tuple of str
        Its free parameters.
    axis : FrictionAxis
        Axis with it.
    z : ndarray
        Search coordinates: of its parameters after those of the model before it.
    cost : float
    """

    slug: str
    free: tuple[str, ...]
    axis: FrictionAxis
    cost: float


@dataclass(eq=False)
class Search:
    """Fits of an axis with causes to records of one machine.

    Parameters
    ----------
    believed : FrictionAxis
    records : sequence of Record
    known : sequence of str
        Base parameters that stay as believed.
    tolerance : mapping of str to float
    own : sequence of str
        Parameters of which every record has its own value.
    also : sequence of str
        Further parameters of the believed axis that are free.
    hold : str
    jobs : int
    """

    believed: FrictionAxis
    records: Sequence[Record]
    known: Sequence[str] = ()
    tolerance: Mapping[str, float] = field(default_factory=dict)
    own: Sequence[str] = ()
    also: Sequence[str] = ()
    hold: str = "zero"
    jobs: int = 1

    def __post_init__(self) -> None:
        self.believed = self.believed.effective()
        self.runs: list[Run] = [prepare(r) for r in self.records]
        self.scales = typical(self.records)
        self.base = tuple(n for n in BASE if n not in self.known)
        self.samples = sum(len(r) for r in self.records)
        values = values_of(self.believed, BASE)
        self.nominal = dict(zip(BASE, values.tolist(), strict=True))

    def _less_dry(self) -> dict[str, float]:
        """Base values with most of the dry friction exchanged for viscous friction."""
        level, speed = self.nominal["coulomb"], self.scales.length / self.scales.time
        return {"coulomb": 0.2 * level, "viscous": self.nominal["viscous"] + 0.8 * level / speed}

    def penalty(self, count: int) -> float:
        """Gain that so many parameters bring by chance, at most."""
        return 0.5 * count * math.log(self.samples)

    # -- fits ----------------------------------------------------------------------

    def problem(self, axis: FrictionAxis, free: Sequence[str]) -> Likelihood:
        """Likelihood of an axis with the base and further parameters free."""
        return Likelihood(
            axis, (*self.base, *free), self.runs, believed=self.believed,
            tolerance=self.tolerance, own=self.own, hold=self.hold, scales=self.scales,
        )  # fmt: skip

    def fit(
        self, axis: FrictionAxis, free: Sequence[str], noises: FloatArray | None = None,
        iterations: int = 40,
    ) -> Solution:  # fmt: skip
        """Most likely parameters from one axis."""
        problem = self.problem(axis, free)
        z = problem.start(1.0)
        if noises is not None:
            z[len(problem.names) :] = noises
        return maximise(problem, z, iterations)

    def references(self) -> dict[str, float]:
        """Costs of the nominal axis and of a straight line, their noises fitted alone.

        The line has no drive and no friction: what a model that mutes the drive
        comes to.
        """
        nominal = Likelihood(self.believed, (), self.runs, hold=self.hold)
        costs = {"nominal axis": maximise(nominal, nominal.start(1.0)).cost}
        line = FrictionAxis(mass=self.believed.mass, viscous=0.0, coulomb=CoulombMap.of(0.0))
        idle = [replace(run, u=np.zeros(run.u.size)) for run in self.runs]
        straight = Likelihood(line, (), idle)
        costs["straight line"] = maximise(straight, straight.start(1.0)).cost
        return costs

    def alone(self) -> Solution:
        """The believed structure, its base parameters free: best of several starts."""
        starts = [self.believed]
        other = {n: c for n, c in self._less_dry().items() if n in self.base}
        if other:
            starts += [with_values(self.believed, list(other), list(other.values()))]
        found = self._parallel([(self.fit, (a, self.also)) for a in starts])
        return min(found, key=lambda s: s.cost)

    def _parallel(self, tasks):  # type: ignore[no-untyped-def]
        run = joblib.Parallel(n_jobs=self.jobs, backend="threading")
        return run(joblib.delayed(f)(*a) for f, a in tasks)

    # -- one step ------------------------------------------------------------------

    def screen(self, now: Solution) -> list[Candidate]:
        """Every effect of the catalogue beside a model, quickly refined, best first."""
        present = named(now.axis)
        effects = [e for e in catalogue(now.axis, tuple(present)) if e not in present]
        best: dict[str, Candidate] = {}
        # From this model, and from the believed base: the first may be muted.
        for beside in (now, self._at_nominal(now)):
            terms = beside.problem._terms(beside.z, beside.point)
            v = View(beside.axis, self.records[0], self.nominal)
            lists = self._parallel([(self._screen_one, (beside, terms, e, v)) for e in effects])
            for c in (c for one in lists for c in one[:1]):
                if c.slug not in best or c.cost < best[c.slug].cost:
                    best[c.slug] = c
        return sorted(best.values(), key=lambda c: c.cost)

    def _at_nominal(self, now: Solution) -> Solution:
        """The same model at the believed base values, its noises fitted alone."""
        names = [n for n in self.base if n in now.problem.names]
        axis = with_values(now.axis, names, [self.nominal[n] for n in names])
        alone = Likelihood(axis, (), self.runs, hold=self.hold, scales=self.scales)
        noises = maximise(alone, alone.start(1.0), 6).z
        return self.fit(axis, self._free(now), noises, 0)

    def _screen_one(self, now, terms, effect: str, v):  # type: ignore[no-untyped-def]
        """Candidates of one effect from its best guesses, best first."""
        tried: list[Any] = []
        noises = now.z[len(now.problem.names) :]
        for values, base in guesses(effect, v):
            none: dict[str, float] = {}
            for beside in (none, base) if base else (none,):
                axis = now.axis
                change = {n: c for n, c in beside.items() if n in self.base}
                if change:
                    axis = with_values(axis, list(change), list(change.values()))
                try:
                    start = with_effect(axis, effect, dict(values))
                    problem = self.problem(start.axis, (*self._free(now), *start.free))
                    z = np.clip(np.concatenate((problem.start()[: len(problem.names)], noises)),
                                problem.low, problem.high)  # fmt: skip
                    tried.append((problem.at(z).cost, len(tried), start, problem, z))
                except ValueError:
                    continue
        tried.sort(key=lambda one: one[:2])
        refined = [
            self._quick(now, terms, effect, start, problem, z)
            for _, _, start, problem, z in tried[:_REFINED]
        ]
        return sorted(refined, key=lambda c: c.cost)

    def _free(self, now: Solution) -> tuple[str, ...]:
        """Free parameters of a model beside the base."""
        return tuple(dict.fromkeys(n for n in now.problem.names if n not in self.base))

    def _quick(self, now, terms, slug, start, problem: Likelihood, z):  # type: ignore[no-untyped-def]
        """A few joint steps along new slopes of the candidate and old ones of the rest."""
        count = len(problem.names)
        old = len(now.problem.names)
        own = list(range(old, count))
        place = [*range(old), *range(count, problem.size)]  # where old coordinates are now
        prior = np.zeros(problem.size)
        centre = np.zeros(problem.size)
        prior[:count], centre[:count] = problem.spread**-2.0, problem.centre
        point = problem.at(z)
        damping = 1e-3
        for turn in range(_TURNS):
            g = prior * (z - centre)
            h = np.diag(prior)
            for i, run in enumerate(self.runs):
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
            moved = False
            for _ in range(3):
                step = np.zeros(problem.size)
                step[free] = (
                    -np.linalg.solve(unit + damping * np.eye(free.size), g[free] / size) / size
                )
                step *= min(1.0, 0.7 / max(np.max(np.abs(step[:count])), 1e-300))
                new = np.clip(z + step, problem.low, problem.high)
                try:
                    tried = problem.at(new)
                except ValueError:
                    tried = Point(math.inf, [], [])
                if tried.cost < point.cost:
                    fall = point.cost - tried.cost
                    z, point, moved = new, tried, True
                    damping *= 0.1
                    break
                damping = max(10.0 * damping, 0.1)
            if not moved or fall < 0.5:
                break
            if point.cost - (_TURNS - turn) * fall > now.cost:
                # At this pace it would not even reach the model without it.
                break
        axis = problem.axis_at(z)
        free_names = tuple(problem.names[j] for j in own)
        return Candidate(slug, free_names, axis, point.cost)

    def worthwhile(self, now: Solution, candidates: Sequence[Candidate]) -> list[Candidate]:
        """Candidates whose quick gain makes a full fit worth its time."""
        if not candidates:
            return []
        best = now.cost - candidates[0].cost
        return [
            c
            for c in candidates[:_FITTED]
            if now.cost - c.cost > max(_SHARE * best, self.penalty(len(c.free)) + _LEAST - _SLACK)
        ]

    def extend(self, now: Solution, candidates: Sequence[Candidate]) -> list[Solution]:
        """Full fits of candidates beside a model, best first."""
        noises = now.z[len(now.problem.names) :]

        def one(c: Candidate) -> Solution:
            return self.fit(c.axis, (*self._free(now), *c.free), noises, _ITERATIONS)

        found = self._parallel([(one, (c,)) for c in candidates])
        return list(found)

    def settle(self, now: Solution) -> Solution:
        """The best of this fit and fits of the same model from other base values."""
        names = [n for n in self.base if n in now.problem.names]
        if not names or self.own:
            return now
        noises = now.z[len(now.problem.names) :]
        starts = [self.nominal, self.nominal | self._less_dry()]
        tasks = [
            (self.fit, (with_values(now.axis, names, [s[n] for n in names]), self._free(now),
                        noises, _ITERATIONS))
            for s in starts
        ]  # fmt: skip
        return min((now, *self._parallel(tasks)), key=lambda s: s.cost)


def forward(search: Search, most: int = 5, tell=None):  # type: ignore[no-untyped-def]
    """Causes one after the other as long as they pay; the steps that were made."""
    now = search.alone()
    steps: list[Any] = [("", now, [])]
    while len(steps) <= most:
        candidates = search.screen(now)
        chosen = search.worthwhile(now, candidates)
        if not chosen:
            if tell is not None:
                tell(steps[-1][0], now, candidates, [])
            break
        fits = search.extend(now, chosen)
        ranked = sorted(
            ((now.cost - s.cost - search.penalty(len(c.free)), c, s)
             for c, s in zip(chosen, fits, strict=True) if s.converged),
            key=lambda one: -one[0],
        )  # fmt: skip
        if tell is not None:
            tell(steps[-1][0], now, candidates, ranked)
        if not ranked or ranked[0][0] < _LEAST:
            break
        best = ranked[0]
        steps.append((best[1].slug, best[2], ranked))
        now = search.settle(best[2])
        steps[-1] = (best[1].slug, now, ranked)
    return steps
