"""Causes found reconsidered: which are redundant, and which effect takes the place of another."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from dryfric_control.diagnosis.candidates import catalogue, effect_class, own_names, with_effect
from dryfric_control.diagnosis.causes_found import (
    State,
    least_addition,
    names_without,
    restarted,
    without,
)
from dryfric_control.diagnosis.likelihood_fits import LATE, hard
from dryfric_control.diagnosis.likelihood_search import EQUAL, SLACK, Search
from dryfric_control.diagnosis.screening import Candidate
from dryfric_control.estimation.solution import Solution
from dryfric_control.model.effects.naming import followed

#: Iterations after which a trial fit is abandoned unless it is predicted to be better.
SOME_TURNS = 5
# Fraction of the gain of a cause with a memory from which another is a rival, and the number of
# rivals that are tried together with one more cause.
_RIVAL, _LOOKED_AHEAD = 0.5, 2


def tidy(search: Search, state: State) -> None:
    """Reconsider all causes after one has been added."""
    _backward(search, state)
    _exchange(search, state)
    sift(search, state)


def sift(search: Search, state: State, edge: bool = True) -> bool:
    """Drop causes that are no longer determined or have left the travelled range.

    One whose mass share vanishes becomes the simpler effect that it is then.
    `edge`: whether a cause may lie at the edge of the range.  Returns whether any was dropped.
    """
    before, i = len(state.causes), 0
    while i < len(state.causes) and not search.late:
        slug = state.causes[i]
        if search.sound(state.fit, slug, state.free[slug], edge):
            i += 1
            continue
        less, fit = without(search, state, slug), state.fit
        own = Candidate(slug, state.free[slug], fit.axis, fit.cost)
        other, fit = search.simplest(less, own, fit)
        if other is not own and search.sound(fit, other.slug, other.free, edge):
            state.swap(slug, other, fit)
        else:
            state.refuted.add(state.drop(slug, less))
    return len(state.causes) < before


def _backward(search: Search, state: State) -> None:
    """Drop causes that a later one has made redundant."""
    i = 0
    while i < len(state.causes) and not search.late:
        slug = state.causes[i]
        less = without(search, state, slug)
        restarted(search, state, slug, less)
        gain = less.cost - state.fit.cost
        if search.worth(gain, len(state.free[slug])) < 0.0:
            state.drop(slug, less)
        else:
            i += 1


def _exchange(search: Search, state: State) -> None:
    """Replace causes by close alternatives that are better beside the other causes.

    The first cause is chosen while the others are missing, and its parameters absorb some of
    their effect: gravity looks like a bias, cogging with one period per turn like gravity.
    """
    for slug in [one for one in state.causes if _may_go(state, one)]:
        # Beside the new one, another may be better still, as may any once more causes are found.
        gone: list[Candidate] = []
        cause: str | None = slug
        while cause is not None:
            last, old = cause, Candidate(cause, state.free[cause], state.fit.axis, state.fit.cost)
            cause = _replaced(search, state, cause)
            gone += [old] if cause is not None else []
        # What was replaced may do the same, but must not come back at once.
        state.close[last] += gone
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
    _, other, found = plainest(sorted(better, key=lambda one: -one[0]))
    left = [c for c in state.close[slug] if c is not other]
    state.swap(slug, other, found)
    state.close[other.slug] = left
    return str(other.slug)


def _spares(search: Search, state: State, fit: Solution, slug: str) -> bool:
    """Whether replacing `slug` makes the last cause redundant, which only compensated for it."""
    last = state.causes[-1]
    if last == slug or followed(last, state.causes):
        return False
    own = state.free[last]
    names = names_without(search, fit, last, own)
    less = search.fit(search.less(fit.axis, last), names, fit.z[len(fit.problem.names) :])
    return search.worth(less.cost - fit.cost, len(own)) < 0.0


def other_memory(search: Search, state: State) -> bool:
    """Replace a cause with a memory by another that is better beside all other causes.

    Play, compliance and elastic contact look alike while other causes are missing, and have
    different numbers of parameters; each is started anew, alone and together with one more
    cause.  Where nothing is left, only for one with no more parameters.  Returns whether any
    was replaced.
    """
    for slug in [s for s in state.causes if hard(s) and _may_go(state, s)]:
        if len(state.causes) < 2 or slug in state.settled or search.late:
            continue
        search.tell(f"{slug} or another memory")
        state.settled.add(slug)
        less = without(search, state, slug)
        rivals = [s for s in catalogue(less.axis) if hard(s) and s != slug]
        if search.nothing_left(state.fit):
            rivals = [s for s in rivals if len(own_names(s)) <= len(state.free[slug])]
        if not rivals:
            continue
        gain = less.cost - state.fit.cost
        mine = search.worth(gain, len(state.free[slug]))
        others = search.screen(less, False, True, gain, thorough=True)
        ranked = search.extend(less, [c for c in others if c.slug in rivals], _RIVAL * gain)
        found = [one[1:] for one in ranked[:1] if one[0] > mine + EQUAL]
        found = found or _with_the_next(search, ranked, mine, gain)
        if found:
            (other, _), *more = found
            state.swap(slug, other, found[-1][1])
            state.settled.add(other.slug)
            for candidate, fit in more:
                state.add(candidate, fit)
            tidy(search, state)
            return True
    return False


def _with_the_next(
    search: Search, ranked: Sequence[Any], worth: float, gain: float
) -> list[tuple[Candidate, Solution]]:
    """A rival and one more cause that are worth more than a cause with a memory; or none.

    `worth`, `gain`: of that cause.  The one with the most parameters absorbs part of what is
    missing, and leaves too little for a further cause to be noticed.
    """
    for mine, rival, half in ranked[:_LOOKED_AHEAD]:
        least = worth - mine + EQUAL
        others = search.screen(half, False, False, least)
        notable = least_addition(gain, search.samples, half.heard())
        for more, other, fit in search.extend(half, others, least)[:1]:
            if more > least and half.cost - fit.cost >= notable:
                return [(rival, half), (other, fit)]
    return []


def delay_or_lag(search: Search, state: State) -> None:
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
        _decide(search, state, slug, ranked)


def compare_alternatives(search: Search, state: State) -> None:
    """Find equally good alternatives of each cause, with all others in the model."""
    search.tell("alternatives")
    for slug in [one for one in state.causes if _may_go(state, one)]:
        fit, close = state.fit, state.close[slug]
        ranked = [(0.0, Candidate(slug, state.free[slug], fit.axis, fit.cost), fit)]
        for other in close:
            found = _in_place(search, state, slug, other)
            # On all samples the two may be closer.
            if found is not None and found.cost < fit.cost + SLACK:
                one = Candidate(other.slug, other.free, found.axis, found.cost)
                ranked.append((0.0, one, found))
        _decide(search, state, slug, ranked)


def _decide(search: Search, state: State, slug: str, ranked: Sequence[Any]) -> None:
    """Of effects in the place of a cause that are equal on all samples, name the plainest.

    `ranked`: worth, candidate and fit of the cause and of those in its place.
    """
    if len(ranked) > 1:
        ranked = search.weighed(ranked)
    level = [one for one in ranked if one[0] > ranked[0][0] - EQUAL]
    _, chosen, best = plainest(level)
    if chosen.slug != slug:
        state.swap(slug, chosen, best)
    state.rivals[chosen.slug] = {c.slug: s.axis for _, c, s in level if c.slug != chosen.slug}


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
    found = search.fit(axis, free, noises, SOME_TURNS)
    if found.cost - found.promised > fit.cost + EQUAL + _fewer(search, own, other.free):
        return None
    found = search.fit(found.axis, free, found.z[len(found.problem.names) :])
    return found if search.sound(found, other.slug, other.free) else None


def _fewer(search: Search, own: Sequence[str], others: Sequence[str]) -> float:
    """Cost by which a replacement may be higher because it has fewer parameters."""
    return search.penalty(len(own)) - search.penalty(len(others))


def _may_go(state: State, slug: str) -> bool:
    """Whether another effect may replace a cause.

    Delay and lag are compared separately, see `delay_or_lag`: a lag also smooths noise of the
    recorded input, and that gain is no evidence for it.
    """
    return not followed(slug, state.causes) and effect_class(slug).action not in LATE


def plainest(ranked):  # type: ignore[no-untyped-def]
    """Of equally good fits, the one with the fewest parameters, then of the lowest rank."""
    level = [one for one in ranked if one[0] > ranked[0][0] - EQUAL]
    return min(level, key=lambda one: (len(one[1].free), effect_class(one[1].slug).rank))
