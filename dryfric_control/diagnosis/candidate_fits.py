"""Fits of all candidates in parallel; hopeless ones are stopped early."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import joblib
import numpy as np
from numpy.typing import NDArray

from dryfric_control.diagnosis.candidates import (
    BASE,
    effect_class,
    guesses,
    own_names,
    with_effect,
)
from dryfric_control.estimation.force_residual import View
from dryfric_control.estimation.parameters import (
    Parameter,
    Scales,
    choose,
    values_of,
    with_values,
)
from dryfric_control.estimation.problem import (
    BASE_COST,
    CANDIDATE,
    Problem,
    narrowing,
    scatter,
    search_bounds,
    through,
)
from dryfric_control.estimation.windows import ROBUST, Windows
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.model.effects.effect import KINDS
from dryfric_control.model.effects.naming import named
from dryfric_control.ties import SQUARES, ranked

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

# All these values are set by `benchmarks/diagnosis.py`: by the causes named right under its
# conditions *exact* and *off*, or, where given in brackets, by one of its effects or run times.

# Cost of one more cause, in units of the prior of base parameters: equal to the cost of
# one of them being off by some seven times its usual spread (clean, pair).
CAUSE_COST = BASE_COST * 4.0
# Largest number of candidates kept after the first round, and largest ratio of their loss
# to the best (run times).
_KEPT, _NEAR = 6, 3.0
# A second guess is followed if its loss is within this factor of the best.
_CLOSE = 1.1
# Mean score below which a fit has nearly reached the noise floor of 0.22.
_SETTLED = 0.4
# Number of points of the random search where the loss is rugged (dwell_time, stribeck).
_TRIES = 120
# Iterations of a first fit; more if the base alone reaches the floor, as then only the
# base values that a fit needs decide, which takes a converged fit.
_TURNS = {False: 2, True: 6}
# Fall of the loss, in units of chi^2, that does not justify a further fit (clean).
_LOWER = 2.0
# Difference of search coordinates up to which fits count as the same.
_SAME = 2e-3
# Number of first guesses left after single runs (run times).
_MANY = 4
# Bounds, as multiples of the guess, of a parameter that must not vanish
# (presliding, backlash).
_VANISHING = (0.01, 100.0)
# Iterations of the final descent of a fit, and rounds of its search for start states.
_LAST_TURNS, _LAST_ROUNDS = 10, 2
# Mean score below which a search for better start states of single windows pays.
_THOROUGH = 1.5


@dataclass(frozen=True, eq=False)
class Fitted:
    """One hypothesis after its fit.

    Attributes
    ----------
    slug : str
        Name of the effect added; empty for the axis itself with its base free.
    hypothesis : Problem
    z : ndarray
        Search coordinates.
    axis : FrictionAxis
        The fitted axis.
    loss : float
        On the windows of the fit, prior included, at the scale of the noise floor;
        before `Race.judged`, on the windows that the fit used so far.
    starts : ndarray, shape (3, nwindows)
        Start states found.
    scores : ndarray, shape (nwindows,)
        Score of every window; empty before `Race.judged`.
    """

    slug: str
    hypothesis: Problem
    z: FloatArray
    axis: FrictionAxis
    loss: float
    starts: FloatArray
    scores: FloatArray


class Race:
    """Fits of hypotheses on one record.

    Parameters
    ----------
    bench : Windows
    believed : FrictionAxis
        The nominal axis; its base parameters are the centre of the prior.
    fit, judge : ndarray of bool, shape (nwindows,)
        Windows to fit on and to judge on.
    scales : Scales
        Typical sizes in the record.
    jobs : int
        Number of fits in parallel.
    known : sequence of str
        Base parameters that stay at nominal.
    tolerance : mapping of str to float
        Base parameters whose errors do not count as assumptions.
    until : float
        Reading of `time.monotonic` at which fits stop where they are.
    """

    def __init__(
        self,
        bench: Windows,
        believed: FrictionAxis,
        fit: BoolArray,
        judge: BoolArray,
        scales: Scales,
        jobs: int = 2,
        known: Sequence[str] = (),
        tolerance: Mapping[str, float] | None = None,
        until: float = math.inf,
    ) -> None:
        self.until = until
        self.bench, self.fit, self.judge = bench, fit, judge
        self.sieve = fit
        self.sizes = scales
        self.jobs = jobs
        names = list(BASE.values())
        self.known, self.tolerance = tuple(known), dict(tolerance or {})
        # Axes with causes fitted elsewhere, used as further starts of the same causes.
        self.hints: Sequence[FrictionAxis] = ()
        self.believed = dict(zip(names, values_of(believed, names).tolist(), strict=True))
        # Cache of fits: a search asks for the same one repeatedly, and so does the next search.
        self._answers: dict[tuple, Any] = {}

    def hypothesis(
        self, axis: FrictionAxis, free: Sequence[str], base: Sequence[str] | None = None
    ) -> Problem:
        """Hypothesis with base parameters (default: all) and others free."""
        names = list(BASE.values()) if base is None else list(base)
        names = [n for n in names if n not in self.known]
        free = [n for n in free if n not in self.known]
        if not names and not free:
            return Problem(axis, (), [self.bench])
        axis, parameters = choose(axis, [*names, *free], self.sizes)
        believed = {n: v for n, v in self.believed.items() if n not in self.tolerance}
        problem = Problem(axis, parameters, [self.bench], believed, _bounds(parameters))
        problem.until = self.until
        return problem

    @property
    def late(self) -> bool:
        """Whether the time limit has passed."""
        return time.monotonic() > self.until

    def _once(self, key: tuple, answer: Callable[[], Any]) -> Any:
        if key not in self._answers:
            self._answers[key] = answer()
        return self._answers[key]

    def _run(self, function, items: Iterable):  # type: ignore[no-untyped-def]
        """Run those fits in parallel that are not in the cache yet."""
        asked = [(function.__name__, *item) for item in items]
        new = [key for key in dict.fromkeys(asked) if key not in self._answers]
        if self.jobs == 1:
            answers = [function(*key[1:]) for key in new]
        else:
            run = joblib.Parallel(n_jobs=self.jobs, backend="threading")
            answers = run(joblib.delayed(function)(*key[1:]) for key in new)
        self._answers |= zip(new, answers, strict=True)
        return [self._answers[key] for key in asked]

    def alone(
        self,
        axis: FrictionAxis,
        free: Sequence[str],
        slug: str = "",
        base: Sequence[str] | None = None,
        active: BoolArray | None = None,
        search: bool = False,
    ) -> Fitted:
        """Fit of an axis with base parameters and `free`, no effect added.

        `search`: add a random search where breakaways make the loss rugged.
        """
        fit = self.fit if active is None else active
        of = None if base is None else tuple(base)
        key = ("alone", axis, tuple(free), slug, of, fit.tobytes(), search)
        return self._once(key, lambda: self._alone(axis, free, slug, base, fit, search))

    def _alone(
        self,
        axis: FrictionAxis,
        free: Sequence[str],
        slug: str,
        base: Sequence[str] | None,
        fit: BoolArray,
        search: bool,
    ) -> Fitted:
        h = self.hypothesis(axis, free, base)
        z = h.start
        return self._finished(slug, h, z, fit, narrowing(h, z, fit), None, search)

    def _finished(
        self,
        slug: str,
        h: Problem,
        z: FloatArray,
        fit: BoolArray,
        scales: Sequence[float],
        starts: FloatArray | None,
        search: bool,
    ) -> Fitted:
        """Complete fit from search coordinates and start states, with its scores."""
        z, [at], loss = through(h, z, fit, scales, CANDIDATE, starts)
        starts = at.starts
        if h.rugged.size and search and not self._settled(loss, fit):
            z, starts = scatter(h, z, fit, starts, _TRIES)
        last = CANDIDATE._replace(iterations=_LAST_TURNS, rounds=_LAST_ROUNDS)
        z, [at], loss = through(h, z, fit, scales[-1:], last, starts)
        return self.judged(Fitted(slug, h, z, h.axis_at(z), loss, at.starts, np.empty(0)))

    def judged(self, one: Fitted) -> Fitted:
        """The fit with the scores of all windows and the loss of all windows to fit."""
        known = self.fit | self.judge
        at = self.bench.evaluate(one.axis, known, None, one.starts)
        if self.bench.scores(at.costs)[known].mean() < _THOROUGH:
            at = self.bench.evaluate(one.axis, known, None, at.starts, thorough=True)
        loss = self.bench.loss(at.costs, self.fit) + one.hypothesis.prior(one.z)[0]
        return Fitted(
            one.slug, one.hypothesis, one.z, one.axis, loss, at.starts,
            self.bench.scores(at.costs),
        )  # fmt: skip

    def among(self, base: Fitted, free: Sequence[str], names: Sequence[str]) -> list[Fitted]:
        """Every candidate added to a fitted axis, best first by its loss.

        Candidates that are far behind after a short fit are not fitted further.
        """
        self.sieve = self.bench.sieve(self.fit, base.scores)
        # Computed before the parallel fits, which all need it.
        self._once(("views", base), lambda: self._views(base))
        # Elastic contacts and transmissions are slow to simulate: try them only if nothing
        # simpler reaches the floor.
        slow = [n for n in names if effect_class(n).action in ("contact", "transmission")]
        settled = self._settled(base.loss, self.fit)
        at = self.bench.evaluate(base.axis, self.sieve, None, base.starts, 1)
        without = self.bench.loss(at.costs, self.sieve) + base.hypothesis.prior(base.z)[0]
        runners: list[Fitted] = []
        done: dict[int, Fitted] = {}
        for group in ([n for n in names if n not in slow], slow):
            if any(self._settled(r.loss, self.fit) for r in done.values()):
                break
            tried = self._run(self._first, ((base, n, tuple(free), settled) for n in group))
            started = _sorted(r for runs in tried for r in runs)
            if settled:
                # Ignore candidates that do not lower the loss.
                started = [r for r in started if r.loss < without - _LOWER]
            least = min(r.loss for r in [*started, *runners]) if started else 0.0
            far = [i > 1 and r.loss > _NEAR * least for i, r in enumerate(started)]
            ahead = [r for r, late in zip(started, far, strict=True) if not late]
            runners += self._run(self._on, ((r, _TURNS[settled] + 2) for r in ahead))
            runners += [r for r, late in zip(started, far, strict=True) if late]
            runners = _sorted(runners)
            keep = [r for r in self._near(runners) if id(r) not in done]
            ends = self._run(self._second, ((r, settled) for r in keep))
            done |= {id(r): end for r, end in zip(keep, ends, strict=True)}
        first: dict[str, Fitted] = {}
        for r in _sorted(done.values()):
            first.setdefault(r.slug, r)
        left = {r.slug: r for r in reversed(runners) if r.slug not in first}
        return list(first.values()) + self._run(self.judged, ((r,) for r in left.values()))

    def instead(self, nominal: Fitted, names: Sequence[str], enough: Fitted) -> list[Fitted]:
        """Effects with one parameter that alone, the base fixed, come near the fit `enough`.

        With two, degenerate ones would too: a warm-up with an endless time constant is
        just a higher Coulomb level.
        """
        self.sieve = self.bench.sieve(self.fit, nominal.scores)
        seen = View(nominal.axis, self.bench.record, self.believed)
        plain = [n for n in names if len(own_names(n)) == 1]
        runs = self._run(self._quick, ((nominal, seen, n) for n in plain))
        at = self.bench.evaluate(enough.axis, self.sieve, None, enough.starts, 1)
        most = _NEAR * self.bench.loss(at.costs, self.sieve)
        near = [r for r in runs if r and r.loss < most]
        return [
            self.alone(r.axis, [*r.hypothesis.names], r.slug, (), self.fit | self.judge)
            for r in near
        ]

    def _quick(self, nominal: Fitted, seen: View, name: str) -> Fitted | None:
        """The best guess of an effect after a few iterations, the base fixed."""
        best = None
        for values, _ in guesses(name, seen):
            try:
                start = with_effect(nominal.axis, name, values)
                h = self.hypothesis(start.axis, start.free, ())
            except ValueError:
                continue
            at = self.bench.evaluate(h.axis_at(h.start), self.sieve, None, nominal.starts, 1)
            loss = self.bench.loss(at.costs, self.sieve)
            if best is None or loss < best.loss:
                best = Fitted(name, h, h.start, h.axis_at(h.start), loss, at.starts, np.empty(0))
        return None if best is None else self._on(best, _TURNS[True])

    def _views(self, base: Fitted) -> tuple[tuple[View, dict[str, float]], ...]:
        """Views for first guesses: of a fitted axis, and with its base at nominal."""
        record = self.bench.record
        known = base.hypothesis.values(base.z)
        views = [(View(base.axis, record, self.believed), known)]
        if any(abs(known[n] - v) > 0.005 * v for n, v in self.believed.items() if n in known):
            # Base values may be biased only because the cause is still missing.
            straight = known | {n: v for n, v in self.believed.items() if n in known}
            names = [n for n in self.believed if n in known]
            axis = with_values(base.axis, names, [straight[n] for n in names])
            views.append((View(axis, record, self.believed), straight))
        return tuple(views)

    def _near(self, runners: list[Fitted]) -> list[Fitted]:
        """Those of sorted candidates that are worth a complete fit."""
        if not runners:
            return []
        best = runners[0].loss
        most = len(runners) if self._settled(best, self.sieve) else _KEPT
        return [r for i, r in enumerate(runners[:most]) if i < 2 or r.loss < _NEAR * best]

    def _settled(self, loss: float, active: BoolArray) -> bool:
        """Whether the loss over windows is close to the noise floor."""
        n = self.bench.samples[active] * ROBUST**2
        return loss < _SETTLED * float(n.sum())

    def _first(self, base, name, free, settled):  # type: ignore[no-untyped-def]
        """First fits of an effect from its best guesses, those that tie with the best."""
        options = list[Any]()
        if self.late:
            return options
        for number, (seen, known) in enumerate(self._answers["views", base]):
            some = []
            for values, regressed in guesses(name, seen):
                origin = known | regressed
                try:
                    start = with_effect(base.axis, name, values)
                    h = self.hypothesis(start.axis, [*free, *start.free])
                    here = dict(zip(h.names, values_of(h.axis, h.names).tolist(), strict=True))
                    z = h.search(here | {n: v for n, v in origin.items() if n in h.names})
                    axis = h.axis_at(z)
                except ValueError:
                    continue
                # If the base reaches the floor, keep guesses apart that leave it unchanged.
                origin_of = (number, bool(regressed) and settled)
                some.append((origin_of, h, z, axis))
            if len(some) > _MANY:
                runs = [self.bench.evaluate(o[3], self.fit, None, base.starts, -1) for o in some]
                losses = [self.bench.loss(at.costs, self.fit) for at in runs]
                some = [some[i] for i in ranked(losses, SQUARES)[:_MANY]]
            options += some
        present = named(base.axis)
        for axis in self.hints:
            if name not in present and set(named(axis)) == {*present, name}:
                h = self.hypothesis(axis, [*free, *own_names(name)])
                options.append(("hint", h, h.start, axis))
        # If the base fit is close to the floor, its start states are reliable.
        starts = base.starts if settled else None
        tried = []
        for number, h, z, axis in options:
            some = self.fit if h.rugged.size else self.sieve
            at = self.bench.evaluate(axis, some, None, starts, 1)
            tried.append((self.bench.loss(at.costs, some) + h.prior(z)[0], number, h, z))
        if not tried:
            return []
        tried = [tried[i] for i in ranked([item[0] for item in tried], SQUARES)]
        # The best guess of every origin, and the second best of all if it is as good.
        firsts = {number: i for i, (_, number, _, _) in reversed(list(enumerate(tried)))}
        chosen = set(firsts.values())
        if len(tried) > 1 and tried[1][0] < _CLOSE * tried[0][0]:
            chosen.add(1)
        runs = []
        for _, _, h, z in [tried[i] for i in sorted(chosen)]:
            scales = narrowing(h, z, self.sieve)
            turns = CANDIDATE._replace(iterations=_TURNS[settled])
            z, [at], _ = through(h, z, self.sieve, scales[:1], turns, starts)
            axis = h.axis_at(z)
            # Evaluate from the base fit's start states too: those fitted here may time a
            # breakaway right by chance and hide that the fit is equivalent to the base.
            known = [at.starts] if starts is None else [at.starts, starts]
            ends = [self.bench.evaluate(axis, self.sieve, None, s, 1) for s in known]
            losses = [self.bench.loss(end.costs, self.sieve) for end in ends]
            at = ends[ranked(losses, SQUARES)[0]]
            loss = self.bench.loss(at.costs, self.sieve) + h.prior(z)[0]
            runs.append(Fitted(name, h, z, axis, loss, at.starts, np.empty(0)))
        # Keep all different fits that tie: their base parameters may differ.
        runs = _sorted(runs)
        apart: list[Fitted] = []
        for r in runs:
            same = any(np.allclose(r.z, other.z, rtol=_SAME, atol=_SAME) for other in apart)
            if r.loss < _CLOSE * runs[0].loss and not same:
                apart.append(r)
        return apart

    def _on(self, one: Fitted, turns: int) -> Fitted:
        """The fit after some more iterations, with scales narrowed down to the floor."""
        h = one.hypothesis
        scales = narrowing(h, one.z, self.sieve)
        more = CANDIDATE._replace(iterations=turns)
        z, [at], loss = through(h, one.z, self.sieve, scales, more, one.starts)
        if loss > one.loss:
            return one
        return Fitted(one.slug, h, z, h.axis_at(z), loss, at.starts, np.empty(0))

    def _second(self, one: Fitted, settled: bool) -> Fitted:
        """The complete fit, on all windows to fit."""
        h = one.hypothesis
        scales = narrowing(h, one.z, self.fit)[-3:]
        starts = one.starts if settled else None
        return self._finished(one.slug, h, one.z, self.fit, scales, starts, True)


def _sorted(runs: Iterable[Fitted]) -> list[Fitted]:
    """Fits, lowest loss first; ties in the given order."""
    runs = list(runs)
    return [runs[i] for i in ranked([r.loss for r in runs], SQUARES)]


def _bounds(parameters: Sequence[Parameter]) -> tuple[FloatArray, FloatArray]:
    """Plausible lower and upper bounds of a candidate's search coordinates."""
    low, high = search_bounds(parameters)
    for i, p in enumerate(parameters):
        least, most = KINDS[p.kind]
        if least > p.low:
            low[i] = p.search(least)
        if most < p.high:
            high[i] = p.search(most)
        if 0.0 < p.low < 1e-6 * p.scale and not p.logarithmic:
            low[i] = p.search(_VANISHING[0] * p.scale)
            high[i] = min(high[i], p.search(_VANISHING[1] * p.scale))
    return low, high
