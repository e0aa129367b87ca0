"""Stepwise search for causes by the hybrid filter's likelihood."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

from dryfric_control.diagnosis.causes_found import State, least_addition, names_without
from dryfric_control.diagnosis.likelihood_search import EQUAL, SLACK, Search
from dryfric_control.diagnosis.replacement import (
    SOME_TURNS,
    compare_alternatives,
    delay_or_lag,
    other_memory,
    plainest,
    sift,
    tidy,
)
from dryfric_control.diagnosis.screening import Candidate
from dryfric_control.estimation.solution import Solution
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.model.effects.naming import named, put

# Number of best candidates that are combined into pairs, before the first cause and later, and
# the largest expected ratio of a pair's gain to the sum of its members' single gains.
_PAIRED, _HOPE = (5, 3), 3.0
# Largest number of causes.  A false one that joined before the others may have to go at the end.
_MOST = 5
# Number of causes not confirmed individually from which the search looks one round ahead.
_UNSURE = 2
# Number of alternatives of a chosen cause that are tried in its place later, and the fraction of
# its worth that they must have reached.
_REMEMBERED, _CLOSE = 4, 0.5

#: Callback that may end the search; called with the state and the candidates of each round.
Ends = Callable[[State, Sequence[Candidate]], bool]


def forward(search: Search, most: int = _MOST, end: Ends | None = None) -> State | None:
    """Add causes one at a time, or two at once, while the likelihood gains enough.

    Returns None if `end`, which is called with the candidates of each round, reports
    that free runs decide instead of the likelihood.
    """
    # Ask with quickly fitted candidates first: they show most records that free runs decide.
    if not search.clock and search.driven:
        if _ended(search, State(search.begun), search.glance(search.begun), end):
            return None
    # A lead of the inputs that was found earlier is kept.
    state = State(search.alone() if search.clock else search.first[0])
    if _rounds(search, state, most, end):
        return None
    if search.bold(state.fit) and not search.late:
        state = _from_nominal(search, state, most)
    _end(search, state)
    return state


def _end(search: Search, state: State) -> None:
    """Compare the causes found with what does the same."""
    if len(state.causes) > 1:
        delay_or_lag(search, state)
        compare_alternatives(search, state)
    state.late = search.late


def resumed(search: Search, state: State, until: float) -> bool:
    """Whether other causes were found in the place of some that have been refuted.

    `until`: reading of `time.monotonic` at which the search ends.
    """
    before = {*state.causes}
    search.until, end = until, search.until
    if not search.late:
        _rounds(search, state, _MOST, None)
        _end(search, state)
    search.until = end
    return {*state.causes} != before


def _from_nominal(search: Search, state: State, most: int) -> State:
    """Repeat the search with the base parameters held at nominal; the likelier state.

    Used where a base parameter has changed by more than a factor of two: while causes are
    missing, base parameters may absorb so much of their effect that they hide them.
    """
    search.tell("causes beside the nominal base")
    base, search.base, width = search.base, (), search.width
    held = State(search.alone(), refuted=state.refuted)
    _rounds(search, held, most, None, alone=True)
    search.base = base
    # Costs are comparable only with equally smoothed inputs.
    search.smooth_by(width)
    if not held.causes:
        return state
    noises = held.fit.z[len(held.fit.problem.names) :]
    held.fit = search.fit(held.fit.axis, search.free_of(held.fit), noises)
    if held.fit.cost > state.fit.cost - SLACK:
        return state
    held.first = state.first
    tidy(search, held)
    return held


def _rounds(search: Search, state: State, most: int, end: Ends | None, alone: bool = False) -> bool:
    """Add causes to a state while they gain enough; whether `end` ended the search.

    A cause whose position has moved to the edge of the travelled range may return once a
    further cause is added.  If it does not, it is dropped, and the search continues, as
    other causes may be better without it.
    `alone`: add single causes only, no pairs.
    """
    while True:
        if _added(search, state, most, end, alone):
            return True
        if sift(search, state, edge=False) or other_memory(search, state):
            continue
        closer = None if alone else search.looked_closer(state.fit)
        if closer is None:
            return False
        state.fit = closer


def _ended(search: Search, state: State, candidates: Sequence[Candidate], end: Ends | None) -> bool:
    """Whether `end` ends the search, for a reason other than inputs that act early.

    Free runs take the inputs as they are, and would name what imitates the lead.
    """
    if end is None or not end(state, candidates):
        return False
    early = search.earlier(state.fit)
    return early is None or any(c.cost < early.cost for c in candidates)


def _added(search: Search, state: State, most: int, end: Ends | None, alone: bool) -> bool:
    """Add causes to a state while they gain enough; whether `end` ended the search."""
    # Of the causes found earlier, on whichever samples.
    first = state.fit.cost + state.gained
    while len(state.causes) < most and not search.late:
        now = search.quieter(state.fit)
        # The gain from smoother inputs must not be credited to a cause.
        first += now.cost - state.fit.cost
        state.fit = now
        if state.causes:
            search.tell(f"cause {len(state.causes) + 1}")
        # The first cause has no minimum gain relative to others.
        this = _Round(search, state, now, first - now.cost if state.causes else -math.inf)
        if this.ended(end):
            return True
        if this.refitted():
            first = first if state.causes else this.now.cost
            if not this.holds():
                continue
        if this.early() or (not alone and this.several()):
            continue
        if this.least == 0.0:
            if not alone:
                this.leave_open()
            break
        if not this.single():
            break
    state.gained = max(first - state.fit.cost, 0.0)
    return False


class _Round:
    """The choice of one more cause, or of two at once, beside those of a state.

    Attributes
    ----------
    now : Solution
        Fit of the causes found before.
    candidates : list of Candidate
        Best first.
    ranked : list of (float, Candidate, Solution)
        Worth, candidate and full fit of those that held-out data confirm, best first.
    ahead : list of (float, Candidate, Solution)
        Those that held-out data leave open, worth more than the best confirmed one.
    """

    def __init__(self, search: Search, state: State, now: Solution, so_far: float) -> None:
        self.search, self.state, self.now = search, state, now
        least = least_addition(so_far, search.samples, now.heard())
        self.enough = partial(operator.le, least)
        self.needed = least if state.causes else 0.0
        self.candidates: list[Candidate] = []
        self.ranked: list[tuple[float, Candidate, Solution]] = []
        self.ahead: list[tuple[float, Candidate, Solution]] = []

    @property
    def least(self) -> float:
        """Worth of the best confirmed candidate, or zero."""
        return max(self.ranked[0][0], 0.0) if self.ranked else 0.0

    def ended(self, end: Ends | None) -> bool:
        """Fit the candidates; whether `end` ended the search."""
        search, state, now = self.search, self.state, self.now
        candidates: list[Candidate] = []
        for stiff in (False, True):
            some = search.screen(now, not state.causes, stiff, self.needed)
            some = [c for c in some if c.slug not in state.refuted]
            # A candidate that brings free runs down to the noise of the readings gains a lot.
            likely = [c for c in some if stiff or now.cost - c.cost >= self.needed]
            if _ended(search, state, likely, end):
                return True
            candidates = sorted([*candidates, *some], key=lambda c: c.cost)
            self.ranked = search.extend(now, candidates, self.needed)
            # Beside a cause that leaves no structure, they are asked in the next round.
            if not stiff and self.ranked and search.nothing_left(self.ranked[0][2]):
                break
        if not state.causes:
            state.first = {c.slug: now.cost - c.cost for c in candidates}
        # Full fits, confirmed or not, tell the candidates' order better than the first ones.
        full = [*search.unsure, *self.ranked]
        fitted = {c.slug: replace(c, axis=s.axis, cost=s.cost) for _, c, s in full}
        self.candidates = sorted([fitted.get(c.slug, c) for c in candidates], key=lambda c: c.cost)
        return False

    def refitted(self) -> bool:
        """Whether the causes found before fit better, started from the best candidate's fit."""
        better = _better(self.search, self.now, self.ranked)
        if better is None:
            return False
        deficit = self.now.cost - better.cost
        self.ranked = [(worth - deficit, c, fit) for worth, c, fit in self.ranked]
        self.state.fit = self.now = better
        return True

    def holds(self) -> bool:
        """Whether the best candidate still gains over the better fit without it."""
        worth, _, fit = self.ranked[0]
        search, now = self.search, self.now
        return worth >= 0.0 and (search.simpler(fit, now) or search.held_out(now, fit).sure)

    def early(self) -> bool:
        """Whether inputs that act early are worth more than any candidate."""
        early = self.search.earlier(self.now)
        if early is None:
            return False
        gain = self.search.worth(self.now.cost - early.cost, 1)
        if self.ranked and gain <= self.ranked[0][0]:
            return False
        self.search.shifted_by(early)
        self.state.fit = early
        return True

    def several(self) -> bool:
        """Whether two causes are confirmed only together, and were added."""
        search, state, now = self.search, self.state, self.now
        least, enough = self.least, self.enough
        self.ahead = _apart(one for one in search.unsure if one[0] - SLACK > least)
        if search.late or (least > 0.0 and not self.ahead):
            return False
        # An unconfirmed cause plus its successor may gain more than a confirmed pair.
        found = [
            _pair(search, now, self.candidates, least, enough, bool(state.causes)),
            _ahead(search, now, self.ahead, least, enough),
        ]
        pair = min(filter(None, found), key=lambda p: p[1].cost, default=None)
        if pair is None:
            return False
        for c in pair[0]:
            state.add(c, pair[1])
            # Single gains say little about members of a pair: keep every candidate
            # with no more parameters.
            others = [o for o in self.candidates if o.slug not in {m.slug for m in pair[0]}]
            state.close[c.slug] = _no_more(others, c)[:_REMEMBERED]
        tidy(search, state)
        return True

    def leave_open(self) -> None:
        """Add a cause that held-out data leave open beside others.

        All causes are judged in the end, and another may have less evidence beside it.
        """
        if self.ahead and self.state.causes and not self.search.late:
            _, chosen, half = self.ahead[0]
            if self.enough(self.now.cost - half.cost):
                self.state.add(chosen, half)

    def single(self) -> bool:
        """Whether the best candidate gains enough, and was added."""
        search, state, now = self.search, self.state, self.now
        _, chosen, fit = plainest(self.ranked)
        if state.causes:
            # A subset of the samples may contain little of an effect that acts rarely.
            gain = max(now.cost - fit.cost, search.part * search.held_out(now, fit).gain)
            if not self.enough(gain):
                return False
        state.add(chosen, fit)
        best = self.ranked[0][0]
        equal = [c for w, c, _ in self.ranked if c is not chosen and w > best - EQUAL]
        state.rivals[chosen.slug] = {c.slug: s.axis for _, c, s in self.ranked if c in equal}
        own = replace(chosen, axis=fit.axis, cost=fit.cost)
        state.close[chosen.slug] = _close(search, now, own, self.candidates)
        if len(state.causes) > 1:
            tidy(search, state)
        return True


def _better(search: Search, now: Solution, ranked) -> Solution | None:  # type: ignore[no-untyped-def]
    """Better fit of the present model, restarted from the fit with the best candidate.

    Where the present fit had ended early, its deficit would count as the candidates' gain.
    """
    if not ranked or search.late:
        return None
    _, chosen, fit = ranked[0]
    names = names_without(search, fit, chosen.slug, chosen.free)
    noises = fit.z[len(fit.problem.names) :]
    less = search.fit(search.less(fit.axis, chosen.slug), names, noises)
    return less if less.cost < now.cost - SLACK else None


def _pair(search, now, candidates, least, enough, beside):  # type: ignore[no-untyped-def]
    """The best pair that is confirmed only together and worth more than a single cause.

    `least`: worth of the best single cause.  `enough`: whether a gain is notable.
    `beside`: whether causes have been found already.
    """
    some = candidates[: _PAIRED[beside]]
    gains = sum(now.cost - c.cost for c in some[:2])
    if search.worth(_HOPE * gains, sum(len(c.free) for c in some[:2]), 2) < least:
        return None
    if not enough(_HOPE * gains):
        return None
    search.tell("pairs")
    tasks = []
    for i, a in enumerate(some):
        for b in some[i + 1 :]:
            try:
                axis = put(a.axis, b.slug, named(b.axis)[b.slug])
            except (ValueError, KeyError):
                continue
            tasks.append((a, b, axis))
    noises = now.z[len(now.problem.names) :]
    free = search.free_of(now)

    def tried(a: Candidate, b: Candidate, axis: FrictionAxis) -> Solution | None:
        names = (*a.free, *b.free)
        fit = search.fit(axis, (*free, *names), noises, SOME_TURNS)
        hoped = now.cost - fit.cost + fit.promised
        if search.worth(hoped, len(names), 2) < least - SLACK or not enough(hoped + SLACK):
            return None
        return search.fit(fit.axis, (*free, *names), fit.z[len(fit.problem.names) :], SOME_TURNS)

    fits = [
        (fit.cost, i, fit) for i, fit in enumerate(search._parallel([(tried, t) for t in tasks]))
        if fit is not None
    ]  # fmt: skip
    if not fits:
        return None
    _, i, best = min(fits)
    a, b, _ = tasks[i]
    names = (*a.free, *b.free)
    if search.worth(now.cost - best.cost, len(names), 2) < least - SLACK:
        return None
    fit = search.fit(best.axis, (*free, *names), noises)
    if (
        search.worth(now.cost - fit.cost, len(names), 2) > least
        and enough(now.cost - fit.cost)
        and search.sound(fit, a.slug, a.free)
        and search.sound(fit, b.slug, b.free)
        and (search.simpler(fit, now) or search.held_out(now, fit).sure)
    ):
        return (a, b), fit
    return None


def _ahead(search, now, unsure, least, enough):  # type: ignore[no-untyped-def]
    """A cause that held-out data confirm only together with the next one."""
    for _, a, half in unsure:
        search.tell(f"{a.slug} and another")
        for stiff in (False, True):
            for _, b, fit in search.extend(half, search.screen(half, False, stiff)):
                gain = now.cost - fit.cost
                if (
                    search.worth(gain, len(a.free) + len(b.free), 2) > least
                    and enough(gain)
                    and search.sound(fit, a.slug, a.free)
                    and search.held_out(now, fit).sure
                ):
                    return (a, b), fit
    return None


def _apart(unsure):  # type: ignore[no-untyped-def]
    """The first few candidates that are not equivalent (their costs differ)."""
    some: list[Any] = []
    for one in unsure:
        if all(abs(one[2].cost - other[2].cost) > EQUAL for other in some):
            some.append(one)
    return some[:_UNSURE]


def _close(search, now, chosen, candidates):  # type: ignore[no-untyped-def]
    """Candidates with no more parameters that may replace a cause once others are known.

    Unconfirmed ones are included: held-out data may confirm them beside further causes.
    """

    def worth(c: Candidate) -> float:
        return search.worth(now.cost - c.cost, len(c.free))

    least = _CLOSE * worth(chosen)
    some = [c for c in _no_more(candidates, chosen) if worth(c) > least]
    return sorted(some, key=worth, reverse=True)[:_REMEMBERED]


def _no_more(candidates: Sequence[Candidate], one: Candidate) -> list[Candidate]:
    """Other candidates with no more parameters than `one`."""
    return [c for c in candidates if c.slug != one.slug and len(c.free) <= len(one.free)]
