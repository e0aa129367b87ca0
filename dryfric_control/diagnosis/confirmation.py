"""Causes that held-out data confirm, and the base parameters that are needed beside them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

from dryfric_control.diagnosis.candidates import SLUGS
from dryfric_control.diagnosis.causes_found import (
    State,
    moved_up,
    names_without,
    restarted,
    without,
)
from dryfric_control.diagnosis.gain_or_base import GAIN, every, far_off
from dryfric_control.diagnosis.held_out import CLEAR, LEAST, HeldOut
from dryfric_control.diagnosis.likelihood_search import EQUAL, MOVED, Search
from dryfric_control.estimation.parameters import with_values
from dryfric_control.estimation.solution import Solution

# Random force without a cause over that with it that no false cause reaches, and the held-out gain
# in total, in standard errors, that is sufficient there, however few blocks gain.
_MUCH_LOUDER, _ON_THE_WHOLE = 2.0, 1.5
# Gain of a base parameter, as its standard error predicts it, over the least, from which it is
# needed without a fit that says so: where the cost is rough, standard errors are too small.
_PLAINLY = 10.0
# Largest logarithm of a ratio of innovations.
_MOST_LOUDER = 50.0
# Random force without an unconfirmed cause, over that with it, above which another cause must
# have its place: the search looks for it again.
_MISSED = 1.25


class Judged(NamedTuple):
    """Evidence of the records for one cause.

    Attributes
    ----------
    sure : bool
        Whether held-out data confirm it.
    held_out : HeldOut
        Its gain there.
    others : str
        Parameters that only together have the same effect, joined by "+".
    louder : float
        Ratio of the random force without the cause to that with it.
    """

    sure: bool
    held_out: HeldOut
    others: str = ""
    louder: float = math.inf

    @property
    def by_size_alone(self) -> bool:
        """Whether it is sure only for its share of the random force."""
        confirmed = self.held_out.sure or bool(self.others)
        return self.sure and not confirmed and self.held_out.gain > LEAST


def confirmed(search: Search, state: State) -> tuple[Solution, list[str], dict[str, Judged]]:
    """The fit with the causes that held-out data confirm, and the evidence for each.

    Between them: the base parameters that are off nominal.
    """
    while True:
        search.tell("base parameters needed")
        if search.clock and not search.late and not search.still_early(state.fit):
            search.shifted_by(None)
            state.fit = search.fit(state.fit.axis, search.free_of(state.fit))
        final, kept = _base(search, state)
        if search.clock:
            search.shifted_by(final)
        judged: dict[str, Judged] = {}
        with_all = final
        if state.causes and not search.late:
            noises = final.z[len(final.problem.names) :]
            with_all = search.fit(final.axis, search.free_of(final), noises, 6, wonder=False)
        for slug in state.causes:
            search.tell(f"{slug} confirmed")
            if search.late:
                judged[slug] = Judged(True, HeldOut(0.0, 0.0, 0.0))
            else:
                judged[slug] = _judged(search, state, final, with_all, slug)
        weakest = _weakest(search, state, judged)
        if weakest:
            less = without(search, state, weakest)
            if restarted(search, state, weakest, less):
                continue
            name = state.drop(weakest, less)
            if judged[weakest].louder > _MISSED:
                state.refuted.add(name)
        elif _gain_is_choice(search, state, final, kept, judged):
            state.drop(GAIN, without(search, state, GAIN))
        else:
            return final, kept, judged


def _base(search: Search, state: State) -> tuple[Solution, list[str]]:
    """The fit with only those base parameters off nominal that need it, and their names."""
    fit = state.fit
    noises = fit.z[len(fit.problem.names) :]
    names = search.free_of(fit)
    every = [n for n in search.base if n in fit.problem.names]
    full = search.fit(fit.axis, names, noises, wonder=False)
    values, errors = full.values(), full.standard_errors()
    least = search.penalty(1) + LEAST
    sure = {n: abs(values[n] - search.nominal[n]) / max(errors[n], 1e-300) for n in every}
    kept = [n for n in every if 0.5 * sure[n] ** 2 > _PLAINLY * least]
    while len(kept) < len(every):
        held = [n for n in every if n not in kept]
        axis = with_values(full.axis, held, [search.nominal[n] for n in held])
        less = search.fit(axis, names, noises, base=kept, wonder=False)
        if search.late:
            return full, every
        if less.cost - full.cost < least * len(held):
            full = less
            break
        kept.append(max(held, key=sure.__getitem__))
    every_sample: dict[str, Any] = {"base": kept, "wonder": False, "runs": search.runs}
    if search.part < 1.0:
        full = search.fit(full.axis, names, full.z[len(full.problem.names) :], **every_sample)
    return search.anew(full, **every_sample), kept


def _weakest(search: Search, state: State, judged: dict[str, Judged]) -> str | None:
    """The cause to drop if held-out data leave any open; None if they confirm all.

    Not simply the first one left open: two causes that share an effect weaken each other, and
    the one with less evidence has to go.
    """
    if all(judged[s].sure for s in state.causes):
        return None
    weak = [s for s in state.causes if not judged[s].sure or judged[s].by_size_alone]
    return min(weak, key=lambda s: judged[s].held_out.strength)


def _gain_is_choice(
    search: Search, state: State, final: Solution, kept: Sequence[str], judged: dict[str, Judged]
) -> bool:
    """Whether an input gain leaves base parameters far off that alone are equivalent to it."""
    if GAIN not in state.causes or not search.gain_is_open:
        return False
    alike = {*judged[GAIN].others.split("+")} == {*every(search.believed)}
    return alike and far_off(final.values(), search.nominal, kept)


def _judged(search: Search, state: State, final: Solution, with_all: Solution, slug: str) -> Judged:
    """Evidence for one cause: its gain over the best fit without it, all else free.

    `with_all`: the fit with all causes and base parameters.
    """
    names = names_without(search, final, slug, state.free[slug])
    noises = final.z[len(final.problem.names) :]
    kept = [n for n in search.base if n in final.problem.names]
    rest = search.less(final.axis, slug)
    few: dict[str, Any] = {"wonder": False}
    nominal = with_values(rest, list(search.base), [search.nominal[n] for n in search.base])
    tries = [search.fit(rest, names, noises, **few)]
    if not search.late and search.possible(nominal, names):
        tries.append(search.fit(nominal, names, None, **few))
    less = min(tries, key=lambda s: s.cost)
    found = search.held_out(less, with_all)
    equal = less.cost - with_all.cost < EQUAL
    if equal or (search.simpler(final, less) and not found.sure):
        alone = search.fit(rest, names, noises, base=kept, **few)
        by_itself = search.held_out(alone, with_all)
        if equal or by_itself.sure:
            others = _moved(search, final, less, slug)
            louder = _louder(alone, with_all)
            return Judged(_sure(found, louder) or bool(others), by_itself, others, louder)
    louder = _louder(less, with_all)
    return Judged(_sure(found, louder), found, "", louder)


def _sure(found: HeldOut, louder: float) -> bool:
    """Whether held-out data confirm a cause.

    `louder`: ratio of the random force without it to that with it.  The larger it is, the
    smaller a gain is sufficient: half of a short record determines several causes poorly.
    """
    part = min(max(math.log(louder) / math.log(_MUCH_LOUDER), 0.0), 1.0)
    needed = CLEAR + part * (_ON_THE_WHOLE - CLEAR)
    return found.sure or (found.gain > LEAST and found.gain > needed * found.error)


def _louder(less: Solution, fit: Solution) -> float:
    """Ratio of the random forces of two fits, in the record where it is largest.

    At least that of their typical innovations: a fit that misses what moves the axis may put it
    down to the readings.
    """
    runs = fit.problem.runs
    samples = sum(int(run.active.sum()) for run in runs)
    typical = math.exp(min((less.point.cost - fit.point.cost) / samples, _MOST_LOUDER))
    return max(typical, *(less.random_force(i) / fit.random_force(i) for i in range(len(runs))))


def _moved(search: Search, final: Solution, less: Solution, slug: str) -> str:
    """Parameters that together are equivalent to a cause, joined by "+"."""
    before, after = final.values(), less.values()
    before = {n: v for n, v in before.items() if n.partition(".")[0] != slug}
    before = dict(zip(moved_up(search, before, slug), before.values(), strict=True))
    slugs: list[str] = []
    for name, value in after.items():
        now = before.get(name, search.nominal.get(name, 0.0))
        size = max(abs(now), abs(value))
        if size > 0.0 and abs(value - now) > MOVED * size:
            slugs.append(SLUGS.get(name, name.partition(".")[0]))
    return "+".join(dict.fromkeys(slugs))
