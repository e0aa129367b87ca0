"""Fits of proposals beside a model: all for a few steps, the promising ones to the end."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dryfric_control.diagnosis.candidates import with_effect
from dryfric_control.diagnosis.criterion import cost_of, evidence, odds_of, prior_of
from dryfric_control.diagnosis.gram import Proposal, screening_noises, with_force_factor
from dryfric_control.diagnosis.invariants import infeasible_reason, rejection_reason
from dryfric_control.diagnosis.model_view import ModelView
from dryfric_control.diagnosis.problem import Problem, each_of, noises_of
from dryfric_control.diagnosis.thresholds import (
    FINE_GRID_FACTORS,
    FIT_SLACK,
    GRID_FACTORS,
    MIN_DECIDING_GAIN,
    MIN_EVIDENCE,
    REMAINING_GAIN_RATIO,
)
from dryfric_control.estimation.likelihood import Likelihood
from dryfric_control.estimation.parameters import values_of, with_values
from dryfric_control.estimation.scoring import (
    COMPARISON_ITERATIONS,
    FIRST_ITERATIONS,
    fit_with_fixed_noises,
    force_continuation,
    maximise,
    with_force,
)
from dryfric_control.estimation.solution import Solution
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.model.effects.naming import named

FloatArray = NDArray[np.float64]
#: Gain of a fit in the end, and falls of the cost at its first look.
_Top = tuple[float, tuple[float, float]]


def fit_beside(
    problem: Problem,
    axis: FrictionAxis,
    free: Sequence[str],
    now: Solution,
    turns: int = COMPARISON_ITERATIONS,
    **settings: Any,
) -> Solution:
    """Fit beside a model, from its noises if it starts as likely, else from a large random force.

    From far away a small random force leads to a local minimum, thousands of units too high: with
    a large one the filter follows the readings, and the cost is smooth.  A motion in jumps has such
    minima next to every model.
    """
    likelihood = problem.likelihood(axis, free, each=each_of(now), **settings)
    z = likelihood.start(noises=noises_of(now))
    if problem.moves_in_jumps or likelihood.tried(z).cost > now.cost + FIT_SLACK:
        z = likelihood.start(1.0)
    return maximise(likelihood, z, turns, problem.until)


def grid_search(
    likelihood: Likelihood, z: FloatArray, own: Sequence[str], noises: FloatArray
) -> FloatArray:
    """Parameters of a shape with a memory, each tried at factors of its value.

    With a large random force the filter follows the readings and the cost is smooth, but for
    ridges that slopes do not cross.
    """
    start = z = with_force(likelihood, z)
    for factors in GRID_FACTORS:
        z = best_factors(likelihood, z, own, factors)
    # What a large random force hides is not decided there.
    return min((start, z), key=lambda at: likelihood.tried(with_noises(at, noises)).cost)


def best_factors(
    likelihood: Likelihood, z: FloatArray, own: Sequence[str], factors: Sequence[float]
) -> FloatArray:
    """Each of some parameters in turn at the likeliest factor of its value.

    A play that is wider than any crossing is as likely at any width: the right one is a ridge
    beside a plain, and slopes do not lead there.
    """
    for j, p in enumerate(likelihood.parameters):
        if p.name not in own or p.value(z[j]) == 0.0:
            continue
        tried = [z.copy() for _ in factors]
        for new, factor in zip(tried, factors, strict=True):
            new[j] = np.clip(
                p.search(factor * p.value(z[j])), likelihood.low[j], likelihood.high[j]
            )
        z = min((z, *tried), key=lambda at: likelihood.tried(at).cost)
    return z


def with_noises(z: FloatArray, noises: FloatArray) -> FloatArray:
    """Coordinates with other noises."""
    return np.concatenate((z[: z.size - noises.size], noises))


def restore_base(problem: Problem, fit: Solution, start: FrictionAxis | None) -> Solution:
    """The fit, or one with base parameters back at nominal if that is likelier.

    Where a cause and all base parameters together do the same, their prior alone decides, and
    its valley at the nominal values is narrow.  `start`: where to begin.
    """
    names = [n for n in problem.base if n in fit.problem.names and n not in problem.own]
    if start is None or not names or prior_of(fit) < MIN_EVIDENCE:
        return fit
    free = problem.free_of(fit)
    axis = with_values(start, names, [problem.nominal[n] for n in names])
    back = fit_beside(problem, axis, free, fit, base=())
    if back.cost > fit.cost:
        return fit
    again = problem.fit(back.axis, free, noises_of(back), COMPARISON_ITERATIONS, each=each_of(back))
    return min(fit, again, key=cost_of)


@dataclass(frozen=True, eq=False)
class PartialFit:
    """A proposal while it is fitted.

    `hope`: fall of the cost that another step may bring; `first`: falls at the first look, where
    the cost is smooth and with free noises.
    """

    proposal: Proposal
    fit: Solution
    hope: float
    first: tuple[float, float]
    turns: int = 0


@dataclass(frozen=True, eq=False)
class FittedProposal:
    """A proposal after its fit."""

    names: tuple[str, ...]
    free: tuple[str, ...]
    fit: Solution
    evidence: float
    first: tuple[float, float]  # falls of the cost at its first look
    reason: str = ""

    @property
    def good(self) -> bool:
        """Whether held-out data know of it and it may be a cause."""
        return self.evidence > 0.0 and not self.reason


@dataclass(eq=False)
class ProposalFits:
    """Fits of proposals beside one model."""

    problem: Problem
    now: Solution  # the model
    odds: Mapping[str, float]  # logarithm of the number of shapes of each effect
    fail: Callable[[str, str], None]  # called with names and the reason why they were not tried
    rows: list[FittedProposal] = field(default_factory=list)
    #: Proposals of one effect whose fits did not promise enough to go on.
    left: list[PartialFit] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.free = self.problem.free_of(self.now)
        self.noises = screening_noises(self.problem, self.now)
        self._levels = dict[float, float]()

    def begin_with(self, name: str, fit: Solution) -> None:
        """Add the row of an effect that was fitted beside the model before."""
        own = _cause_parameters(self.problem.free_of(fit), name)
        worth = self._row_evidence(fit, (name,))
        self.rows.append(FittedProposal((name,), own, fit, worth, (-math.inf, -math.inf)))

    def fit(self, proposals: Sequence[Proposal]) -> None:
        """Fit some proposals, and add their rows."""
        top = self._top()
        joined = [p for p in proposals if len(p.names) > 1]
        waiting = self._first_fits([p for p in proposals if len(p.names) == 1], proposals)
        while True:
            going = self._worth_a_step(waiting, top)
            ended = [one for one in waiting if one not in going]
            self.left += [one for one in ended if len(one.proposal.names) == 1]
            waiting = going
            if not waiting and joined:
                # Joined causes are looked at if they promise more than single ones reached.
                some = [p for p in joined if p.predicted > top[0] - FIT_SLACK]
                waiting = self._first_fits(some, proposals)
                joined = []
                continue
            if not waiting:
                return
            # The most promising goes on.
            last = min(waiting, key=lambda one: one.fit.cost - REMAINING_GAIN_RATIO * one.hope)
            waiting.remove(last)
            fit = self._continued_fit(last)
            if fit is None:
                continue
            turns = last.turns + FIRST_ITERATIONS
            hope = min(fit.promised, last.fit.cost - fit.cost)
            if (
                REMAINING_GAIN_RATIO * hope < MIN_DECIDING_GAIN
                or fit.iterations < FIRST_ITERATIONS - 1
                or turns >= COMPARISON_ITERATIONS
            ):
                self.rows.append(self._restore_base(self._row(last, fit), last.proposal.held))
                waiting += self._without_rejected(replace(last, fit=fit), proposals)
                top = self._top()
            else:
                waiting.append(PartialFit(last.proposal, fit, hope, last.first, turns))

    def _worth_a_step(self, waiting: Sequence[PartialFit], top: _Top) -> list[PartialFit]:
        """Fits that go on.

        What can neither pay nor outdo the best is left, and joined causes of which one alone fits
        better: the next round begins there.
        """
        reached = [(r.names, r.fit.cost) for r in self.rows]
        reached += [(one.proposal.names, one.fit.cost) for one in waiting]

        def is_needless(one: PartialFit) -> bool:
            """Whether some of its causes fit as well alone."""
            return any(
                {*names} < {*one.proposal.names} and cost <= one.fit.cost for names, cost in reached
            )

        return [one for one in waiting if self._can_gain(one, top) and not is_needless(one)]

    def _level(self, part: float) -> float:
        """Cost of the model at a factor of the raised random force.

        A proposal must gain at the noises at which it was proposed, where the cost is smooth.
        """
        if part not in self._levels:
            model = self.problem.likelihood(self.now.axis, self.free, each=each_of(self.now))
            start = model.start(noises=with_force_factor(self.noises, part))
            self._levels[part] = fit_with_fixed_noises(model, start, until=self.problem.until).cost
        return self._levels[part]

    def _first_fits(
        self, some: Sequence[Proposal], proposals: Sequence[Proposal]
    ) -> list[PartialFit]:
        """First looks of some of the proposals that may gain.

        What no machine can have must not outdo what it may; the others of a joined proposal go
        on without it.
        """
        found = list[PartialFit]()
        rest = list[Proposal]()
        for one in filter(None, self.problem.parallel(self._first_fit, some)):
            names = one.proposal.names
            own = one.proposal.free
            lost = [
                n
                for n in names
                if infeasible_reason(self.problem, one.fit, n, _cause_parameters(own, n))
            ]
            if not lost:
                found.append(one)
            elif len(lost) < len(names):
                rest.append(self._rest(one, lost))
        tried = {frozenset(one.names) for some in (proposals, self.rows) for one in some}
        rest = [one for one in rest if frozenset(one.names) not in tried]
        return [*found, *self._first_fits(rest, proposals)] if rest else found

    def _without_rejected(
        self, look: PartialFit, proposals: Sequence[Proposal]
    ) -> list[PartialFit]:
        """First looks of a joined proposal without those of its causes that its fit rejects.

        The others may have been too far off to gain alone, where they were proposed.
        """
        one = look.proposal
        lost = [
            n
            for n in one.names
            if rejection_reason(self.problem, look.fit, n, _cause_parameters(one.free, n))
        ]
        if not 0 < len(lost) < len(one.names):
            return []
        rest = self._rest(look, lost)
        fitted = {frozenset(row.names) for row in self.rows}
        return [] if frozenset(rest.names) in fitted else self._first_fits([rest], proposals)

    def _first_fit(self, one: Proposal) -> PartialFit | None:
        problem = self.problem
        now = self.now
        until = problem.until
        if problem.is_overdue:
            return None
        try:
            likelihood = problem.likelihood(one.axis, (*self.free, *one.free), each=each_of(now))
            # A random force that accelerates as much.
            alike = with_force_factor(self.noises, one.quieter * one.axis.mass / now.axis.mass)
            start = likelihood.start(noises=alike)
            if one.remembers:
                start = self._remembering_start(likelihood, start, one.remembers, alike)
            fit = fit_with_fixed_noises(likelihood, start, until=until)
            if not math.isfinite(fit.cost):
                likelihood.at(fit.z)  # says why there is no such axis
                return None
            smooth = self._level(one.quieter) - fit.cost
            if smooth + REMAINING_GAIN_RATIO * fit.promised < 0.5 * self._required_gain(one):
                return None
            fit = maximise(likelihood, fit.z, FIRST_ITERATIONS, until, True)
            return PartialFit(one, fit, fit.promised, (smooth, now.cost - fit.cost))
        except (ValueError, ArithmeticError) as wrong:
            self.fail("+".join(one.names), str(wrong))
            return None

    def _remembering_start(
        self, likelihood: Likelihood, z: FloatArray, own: Sequence[str], noises: FloatArray
    ) -> FloatArray:
        """Where to begin with a shape with a memory, from a part of the records."""
        part = likelihood.on(self.problem.fast_stretches)
        until = self.problem.until
        starts = [grid_search(part, z, own, noises)]
        if not self.problem.is_imposed:
            # There the base takes up what the shape should, which may lead astray.  An imposed
            # motion is followed by no filter, and costs as much at any random force.
            starts.append(force_continuation(part, starts[0], until=until))
        fits = [
            fit_with_fixed_noises(part, with_noises(one, noises), until=until) for one in starts
        ]
        fit = min(fits, key=cost_of)
        if not math.isfinite(fit.cost):
            return z
        return best_factors(part, fit.z, own, FINE_GRID_FACTORS)

    def _rest(self, look: PartialFit, lost: Sequence[str]) -> Proposal:
        """A proposal without some of its effects, from where its look ended."""
        problem = self.problem
        one = look.proposal

        names, free, remembers = (
            problem.free_without(some, *lost) for some in (one.names, one.free, one.remembers)
        )
        return replace(
            one,
            names=names,
            free=free,
            remembers=remembers,
            cost=-look.first[0],
            predicted=0.0,
            axis=problem.remove_effects(look.fit.axis, *lost),
            held=one.held and problem.remove_effects(one.held, *lost),
        )

    def _continued_fit(self, look: PartialFit) -> Solution | None:
        one = look.proposal
        fit = look.fit
        until = self.problem.until
        try:
            if look.turns:
                return maximise(fit.problem, fit.z, FIRST_ITERATIONS, until, again=True)
            names = (*self.free, *one.free)
            return self.problem.fit(
                fit.axis, names, noises_of(fit), FIRST_ITERATIONS, each=each_of(fit)
            )
        except (ValueError, ArithmeticError) as wrong:
            self.fail("+".join(one.names), str(wrong))
            return None

    def _row(self, look: PartialFit, fit: Solution) -> FittedProposal:
        one = look.proposal
        reasons = [
            rejection_reason(self.problem, fit, n, _cause_parameters(one.free, n))
            for n in one.names
        ]
        reason = next(filter(None, reasons), "")
        return FittedProposal(
            one.names, one.free, fit, self._row_evidence(fit, one.names), look.first, reason
        )

    def _row_evidence(self, fit: Solution, names: Sequence[str]) -> float:
        return evidence(self.now, fit, [odds_of(self.odds, n) for n in names])

    @property
    def good(self) -> list[FittedProposal]:
        """Rows that are good."""
        return [r for r in self.rows if r.good]

    def _top(self) -> _Top:
        """The largest gain of a row."""
        gains = [(self.now.cost - r.fit.cost, r.first) for r in self.good]
        return max(gains, default=(-math.inf, (-math.inf, -math.inf)))

    def _restore_base(self, row: FittedProposal, start: FrictionAxis | None) -> FittedProposal:
        """The row with the base back at nominal where that may decide which one is best."""
        most = max((r.evidence for r in self.rows if not r.reason), default=0.0)
        if row.reason or row.evidence + prior_of(row.fit) < max(most, 0.0):
            return row
        fit = restore_base(self.problem, row.fit, start)
        if fit is row.fit:
            return row
        return replace(row, fit=fit, evidence=self._row_evidence(fit, row.names))

    def translate(self, view: ModelView) -> None:
        """Fit what acts as the best row does again from where that one ended.

        A rough cost would choose between equals by chance, and leave one for the other.
        """
        good = [r for r in self.rows if len(r.names) == 1 and not r.reason]
        if not good:
            return
        top, problem = max(good, key=lambda r: r.evidence), self.problem
        effect, base = named(top.fit.axis)[top.names[0]], problem.base

        def one(row: FittedProposal) -> FittedProposal:
            name = row.names[0]
            if row is top or len(row.names) > 1 or row.fit.cost <= top.fit.cost:
                return row
            same = view.same_force(effect, name, base)
            if same is None:
                return row
            axis = problem.remove_effects(top.fit.axis, top.names[0])
            moved = values_of(axis, base) * (1.0 - same[1])
            free = (*self.free, *row.free)
            try:
                axis = with_effect(with_values(axis, base, moved), name, same[0]).axis
                fit = problem.fit(
                    axis, free, noises_of(top.fit), COMPARISON_ITERATIONS, each=each_of(top.fit)
                )
            except ValueError:
                return row  # no axis can have these values
            if fit.cost >= row.fit.cost:
                return row
            reason = rejection_reason(problem, fit, name, _cause_parameters(row.free, name))
            return replace(row, fit=fit, evidence=self._row_evidence(fit, row.names), reason=reason)

        fitted = {row.names for row in self.rows}
        left = {
            one.proposal.names: self._row(one, one.fit)
            for one in self.left
            if one.proposal.names not in fitted
        }
        again = problem.parallel(one, left.values())
        self.rows = problem.parallel(one, self.rows)
        self.rows += [new for new, old in zip(again, left.values(), strict=True) if new is not old]

    def _required_gain(self, one: Proposal) -> float:
        """What the causes of a proposal cost."""
        return sum(MIN_EVIDENCE + odds_of(self.odds, n) for n in one.names)

    def _can_gain(self, look: PartialFit, top: _Top) -> bool:
        """Whether a fit may still gain what its causes cost, and as much as the best one.

        `top`: what that gained in the end, and at its first look: looks are compared with looks.
        """
        one = look.proposal
        fit = look.fit
        prior = prior_of(fit) - prior_of(self.now)
        gain = self.now.cost - fit.cost + REMAINING_GAIN_RATIO * look.hope
        equal = not look.turns and any(
            one > other - FIT_SLACK for one, other in zip(look.first, top[1], strict=True)
        )
        if not look.turns:
            gain = max(gain, one.predicted)  # a quick look may end where a cost is rough
        pays = gain + max(prior, 0.0) > 0.5 * self._required_gain(one)
        return pays and (equal or gain > top[0] - FIT_SLACK)


def _cause_parameters(free: Sequence[str], name: str) -> tuple[str, ...]:
    return tuple(n for n in free if n.startswith(f"{name}."))
