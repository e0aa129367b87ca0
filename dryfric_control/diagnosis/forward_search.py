"""Stepwise search for causes by the hybrid filter's likelihood, forward and backward."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

from dryfric_control.diagnosis.candidates import (
    catalogue,
    effect_class,
    holds,
    own_names,
    with_effect,
)
from dryfric_control.diagnosis.likelihood_fits import LATE, hard
from dryfric_control.diagnosis.likelihood_search import EQUAL, SLACK, Search
from dryfric_control.diagnosis.screening import Candidate
from dryfric_control.estimation.solution import Solution
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.model.effects.naming import followed, named, put, renumbered

# A further cause must bring this fraction of the total gain, or reduce the random force by this
# fraction (gain of log-likelihood per sample): unmodelled force is not white, and the likelihood
# rewards any effect that resembles it.
_FURTHER, _QUIETER = 0.02, 0.02
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
# Iterations after which a trial fit is abandoned unless it is predicted to be better.
_SOME_TURNS = 5


@dataclass(eq=False)
class State:
    """Causes found so far, and the fit that includes them.

    Attributes
    ----------
    fit : Solution
    causes : list of str
    free : dict of str to tuple of str
        Free parameters of each cause.
    alternatives : dict of str to tuple of str
        Effects that fit equally well in place of each cause.
    rivals : dict of str to dict of str to FrictionAxis
        The axes fitted with these alternatives.
    close : dict of str to list of Candidate
        Candidates that were nearly as good when the cause was chosen, with no more parameters.
    first : dict of str to float
        Gain of log-likelihood of every candidate in the first round, after a quick fit.
    refuted : set of str
        Causes that were dropped after others had joined; they are not tried again.
    settled : set of str
        Causes with a memory that were compared with all others that have one.
    late : bool
        Whether time ran out.
    """

    fit: Solution
    causes: list[str] = field(default_factory=list)
    free: dict[str, tuple[str, ...]] = field(default_factory=dict)
    alternatives: dict[str, tuple[str, ...]] = field(default_factory=dict)
    rivals: dict[str, dict[str, FrictionAxis]] = field(default_factory=dict)
    close: dict[str, list[Candidate]] = field(default_factory=dict)
    first: dict[str, float] = field(default_factory=dict)
    refuted: set[str] = field(default_factory=set)
    settled: set[str] = field(default_factory=set)
    late: bool = False

    @property
    def names(self) -> tuple[str, ...]:
        """Free parameters of all causes."""
        return tuple(n for slug in self.causes for n in self.free[slug])

    def drop(self, slug: str, less: Solution) -> None:
        """Remove a cause; `less` is the fit without it."""
        self.causes.remove(slug)
        for table in (self.free, self.alternatives, self.rivals, self.close):
            table.pop(slug)
        self.fit = less

    def add(self, candidate: Candidate, fit: Solution) -> None:
        """Add a cause."""
        slug = candidate.slug
        self.causes.append(slug)
        self.free[slug] = candidate.free
        self.alternatives[slug], self.rivals[slug], self.close[slug] = (), {}, []
        self.fit = fit

    def swap(self, slug: str, candidate: Candidate, fit: Solution) -> None:
        """Put another cause in the place of one."""
        place = self.causes.index(slug)
        self.drop(slug, fit)
        self.add(candidate, fit)
        self.causes.insert(place, self.causes.pop())


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
        _in_time(search, state)
        _compare(search, state)
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
    _tidy(search, held)
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
        if not (_sift(search, state, edge=False) or _other_memory(search, state)):
            return False


def _ended(
    search: Search, state: State, candidates: Sequence[Candidate], end: Ends | None
) -> bool:
    """Whether `end` ends the search, for a reason other than inputs that act early.

    Free runs take the inputs as they are, and would name what imitates the lead.
    """
    if end is None or not end(state, candidates):
        return False
    early = search.earlier(state.fit)
    return early is None or any(c.cost < early.cost for c in candidates)


def _added(search: Search, state: State, most: int, end: Ends | None, alone: bool) -> bool:
    """Add causes to a state while they gain enough; whether `end` ended the search."""
    first = state.fit.cost
    while len(state.causes) < most and not search.late:
        now = search.quieter(state.fit)
        # The gain from smoother inputs must not be credited to a cause.
        first += now.cost - state.fit.cost
        state.fit = now
        if state.causes:
            search.tell(f"cause {len(state.causes) + 1}")
        # The first cause has no minimum gain relative to others.
        so_far = first - now.cost if state.causes else -math.inf
        enough = partial(_adds, so_far, search.samples)
        needed = _least(so_far, search.samples) if state.causes else 0.0
        candidates: list[Candidate] = []
        for stiff in (False, True):
            some = search.screen(now, not state.causes, stiff, needed)
            some = [c for c in some if c.slug not in state.refuted]
            # A candidate that brings free runs down to the noise of the readings gains a lot.
            likely = [c for c in some if stiff or now.cost - c.cost >= needed]
            if _ended(search, state, likely, end):
                return True
            candidates = sorted([*candidates, *some], key=lambda c: c.cost)
            ranked = search.extend(now, candidates, needed)
            # Beside a cause that leaves no structure, they are asked in the next round.
            if not stiff and ranked and search.nothing_left(ranked[0][2]):
                break
        if not state.causes:
            state.first = {c.slug: now.cost - c.cost for c in candidates}
        # Full fits, confirmed or not, tell the candidates' order better than the first ones.
        full = [*search.unsure, *ranked]
        fitted = {c.slug: replace(c, axis=s.axis, cost=s.cost) for _, c, s in full}
        candidates = sorted([fitted.get(c.slug, c) for c in candidates], key=lambda c: c.cost)
        better = _better(search, now, ranked)
        if better is not None:
            ranked = [(w - (now.cost - better.cost), c, s) for w, c, s in ranked]
            state.fit = now = better
            first = first if state.causes else better.cost
            _, _, fit = ranked[0]
            if ranked[0][0] < 0.0 or not (
                search.simpler(fit, now) or search.held_out(now, fit).sure
            ):
                continue
        early = search.earlier(now)
        if early is not None:
            gain = search.worth(now.cost - early.cost, 1)
            if not ranked or gain > ranked[0][0]:
                search.shifted_by(early)
                state.fit = early
                continue
        least = max(ranked[0][0], 0.0) if ranked else 0.0
        ahead = _apart(one for one in search.unsure if one[0] - SLACK > least)
        if (least == 0.0 or ahead) and not (alone or search.late):
            pair = _pair(search, now, candidates, least, enough, bool(state.causes))
            # An unconfirmed cause plus its successor may gain more than a confirmed pair.
            if pair is None or any(half.cost < pair[1].cost for _, _, half in ahead):
                found = [pair, _ahead(search, now, ahead, least, enough)]
                pair = min(filter(None, found), key=lambda p: p[1].cost, default=None)
            if pair is not None:
                for c in pair[0]:
                    state.add(c, pair[1])
                    # Single gains say little about members of a pair: keep every candidate
                    # with no more parameters.
                    others = [o for o in candidates if o.slug not in {m.slug for m in pair[0]}]
                    state.close[c.slug] = _no_more(others, c)[:_REMEMBERED]
                _tidy(search, state)
                continue
        if least == 0.0:
            break
        _, chosen, fit = _plainest(ranked)
        if state.causes:
            # A subset of the samples may contain little of an effect that acts rarely.
            if not enough(max(now.cost - fit.cost, search.part * search.held_out(now, fit).gain)):
                break
        state.add(chosen, fit)
        equal = [c for w, c, _ in ranked if c is not chosen and w > ranked[0][0] - EQUAL]
        state.alternatives[chosen.slug] = tuple(c.slug for c in equal)
        state.rivals[chosen.slug] = {c.slug: s.axis for w, c, s in ranked if c in equal}
        state.close[chosen.slug] = _close(search, now, fitted[chosen.slug], candidates)
        if len(state.causes) > 1:
            _tidy(search, state)
    return False


def notable(gain: float, whole: float, samples: int) -> bool:
    """Whether a further cause gains more than unmodelled force could simulate.

    `whole`: the gain of all causes, including this one.
    """
    return gain >= min(_FURTHER * whole, _QUIETER * samples)


def _adds(so_far: float, samples: int, gain: float) -> bool:
    """Whether a gain in addition to `so_far` is notable."""
    return notable(gain, so_far + gain, samples)


def _least(so_far: float, samples: int) -> float:
    """Smallest gain in addition to `so_far` that is notable."""
    return min(_FURTHER / (1.0 - _FURTHER) * so_far, _QUIETER * samples)


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


def _plainest(ranked):  # type: ignore[no-untyped-def]
    """Of equally good fits, the one with the fewest parameters, then of the lowest rank."""
    level = [one for one in ranked if one[0] > ranked[0][0] - EQUAL]
    return min(level, key=lambda one: (len(one[1].free), effect_class(one[1].slug).rank))


def _tidy(search: Search, state: State) -> None:
    """Reconsider all causes after one has been added."""
    _backward(search, state)
    _exchange(search, state)
    _sift(search, state)


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
        fit = search.fit(axis, (*free, *names), noises, _SOME_TURNS)
        hoped = now.cost - fit.cost + fit.promised
        if search.worth(hoped, len(names), 2) < least - SLACK or not enough(hoped + SLACK):
            return None
        return search.fit(fit.axis, (*free, *names), fit.z[len(fit.problem.names) :], _SOME_TURNS)

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


def _sift(search: Search, state: State, edge: bool = True) -> bool:
    """Drop causes that are no longer determined or have left the travelled range.

    `edge`: whether a cause may lie at the edge of the range.  Returns whether any was dropped.
    """
    before = len(state.causes)
    for slug in list(state.causes):
        if followed(slug, state.causes) or search.late:
            continue
        if not search.sound(state.fit, slug, state.free[slug], edge):
            state.refuted.add(slug)
            state.drop(slug, without(search, state, slug))
    return len(state.causes) < before


def _backward(search: Search, state: State) -> None:
    """Drop causes that a later one has made redundant."""
    for slug in list(state.causes):
        if followed(slug, state.causes) or search.late:
            continue
        less = without(search, state, slug)
        gain = less.cost - state.fit.cost
        if search.worth(gain, len(state.free[slug])) < 0.0:
            state.drop(slug, less)


def _in_place(search: Search, state: State, slug: str, other: Candidate) -> Solution | None:
    """Fit with another effect in place of a cause; None if it is predicted to be worse."""
    if search.late or other.slug in state.causes or effect_class(other.slug).action in LATE:
        return None
    fit, own = state.fit, state.free[slug]
    free = (*names_without(search, fit, slug, own), *other.free)
    noises = fit.z[len(fit.problem.names) :]
    # Its values of the first round absorbed part of the causes that were missing then.
    axis = search.nearest(search.less(fit.axis, slug), other, free, noises)
    if axis is None:
        return None
    found = search.fit(axis, free, noises, _SOME_TURNS)
    if found.cost - found.promised > fit.cost + EQUAL + _fewer(search, own, other.free):
        return None
    found = search.fit(found.axis, free, found.z[len(found.problem.names) :])
    return found if search.sound(found, other.slug, other.free) else None


def _fewer(search: Search, own: Sequence[str], others: Sequence[str]) -> float:
    """Cost by which a replacement may be higher because it has fewer parameters."""
    return search.penalty(len(own)) - search.penalty(len(others))


def _may_go(state: State, slug: str) -> bool:
    """Whether another effect may replace a cause.

    Delay and lag are compared separately, see `_in_time`: a lag also smooths noise of the
    recorded input, and that gain is no evidence for it.
    """
    return not followed(slug, state.causes) and effect_class(slug).action not in LATE


def _exchange(search: Search, state: State) -> None:
    """Replace causes by close alternatives that are better beside the other causes.

    The first cause is chosen while the others are missing, and its parameters absorb some of
    their effect: gravity looks like a bias, cogging with one period per turn like gravity.
    """
    for slug in [one for one in state.causes if _may_go(state, one)]:
        # Beside the new one, another may be better still, as may any once more causes are found.
        cause: str | None = slug
        while cause is not None:
            cause = _replaced(search, state, cause)
    _backward(search, state)


def _replaced(search: Search, state: State, slug: str) -> str | None:
    """The close alternative that has taken the place of a cause, if one is better."""
    own, cost = state.free[slug], state.fit.cost
    better: list[tuple[float, Candidate, Solution]] = []
    for other in state.close[slug]:
        found = _in_place(search, state, slug, other)
        if found is None:
            continue
        ahead = _fewer(search, own, other.free)
        if found.cost < cost + (ahead if ahead else -EQUAL) or (
            found.cost < cost + EQUAL and _spares(search, state, found, slug)
        ):
            better.append((ahead - found.cost, other, found))
    if not better:
        return None
    _, other, found = _plainest(sorted(better, key=lambda one: -one[0]))
    left = [c for c in state.close[slug] if c is not other]
    state.swap(slug, other, found)
    state.close[other.slug] = left
    return str(other.slug)


def _other_memory(search: Search, state: State) -> bool:
    """Replace a cause with a memory by another that is better beside all other causes.

    Play, compliance and elastic contact look alike while other causes are missing, and have
    different numbers of parameters; each is started anew.  Returns whether any was replaced.
    """
    for slug in [s for s in state.causes if hard(s) and _may_go(state, s)]:
        if len(state.causes) < 2 or slug in state.settled or search.late:
            continue
        search.tell(f"{slug} or another memory")
        state.settled.add(slug)
        less = without(search, state, slug)
        gain = less.cost - state.fit.cost
        mine = search.worth(gain, len(state.free[slug]))
        others = search.screen(less, False, True, gain, thorough=True)
        others = [c for c in others if c.slug != slug]
        ranked = search.extend(less, others, gain)
        if ranked and ranked[0][0] > mine + EQUAL:
            _, other, fit = ranked[0]
            state.swap(slug, other, fit)
            state.settled.add(other.slug)
            _tidy(search, state)
            return True
    return False


def _in_time(search: Search, state: State) -> None:
    """Decide between delay and lag, with all other causes in the model."""
    for slug in [one for one in state.causes if effect_class(one).action in LATE]:
        fit, own = state.fit, state.free[slug]
        less, time = search.less(fit.axis, slug), fit.values()[own[0]]
        ranked = [(0.0, Candidate(slug, own, fit.axis, fit.cost), fit)]
        for other in [one for one in catalogue(less) if effect_class(one).action in LATE]:
            if other == slug or other in state.causes or search.late:
                continue
            start = with_effect(less, other, {n.partition(".")[2]: time for n in own_names(other)})
            free = (*names_without(search, fit, slug, own), *start.free)
            found = search.fit(start.axis, free, fit.z[len(fit.problem.names) :])
            if search.sound(found, other, start.free):
                ranked.append((0.0, Candidate(other, start.free, found.axis, found.cost), found))
        ranked = search.weighed(ranked)
        level = [one for one in ranked if one[0] > ranked[0][0] - EQUAL]
        _, chosen, best = _plainest(level)
        if chosen.slug != slug:
            state.swap(slug, chosen, best)
        equal = {c.slug: s.axis for _, c, s in level if c.slug != chosen.slug}
        state.alternatives[chosen.slug], state.rivals[chosen.slug] = tuple(equal), equal


def _compare(search: Search, state: State) -> None:
    """Find equally good alternatives of each cause, with all others in the model."""
    search.tell("alternatives")
    for slug in [one for one in state.causes if _may_go(state, one)]:
        fits = {other.slug: _in_place(search, state, slug, other) for other in state.close[slug]}
        equal = {s: f.axis for s, f in fits.items() if f and f.cost < state.fit.cost + EQUAL}
        state.alternatives[slug], state.rivals[slug] = tuple(equal), equal


def _spares(search: Search, state: State, fit: Solution, slug: str) -> bool:
    """Whether replacing `slug` makes the last cause redundant, which only compensated for it."""
    last = state.causes[-1]
    if last == slug or followed(last, state.causes):
        return False
    own = state.free[last]
    names = names_without(search, fit, last, own)
    less = search.fit(search.less(fit.axis, last), names, fit.z[len(fit.problem.names) :])
    return search.worth(less.cost - fit.cost, len(own)) < 0.0


def names_without(search: Search, fit: Solution, slug: str, own: Sequence[str]) -> tuple[str, ...]:
    """Free parameters other than the base, by their names in the axis without a cause."""
    names = [n for n in search.free_of(fit) if n not in own]
    return tuple(names if holds(search.believed, slug) else renumbered(names, slug))


def without(search: Search, state: State, slug: str, **settings: Any) -> Solution:
    """Fit without one cause."""
    fit = state.fit
    axis = search.less(fit.axis, slug)
    free = names_without(search, fit, slug, state.free[slug])
    return search.fit(axis, free, **settings)
