"""The causes that a search has found so far, and its fit with and without one of them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

from dryfric_control.diagnosis.candidates import holds, with_effect
from dryfric_control.diagnosis.likelihood_search import EQUAL, Search
from dryfric_control.diagnosis.screening import Candidate
from dryfric_control.estimation.solution import Solution
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.model.effects.naming import class_of, named, renumbered

# A further cause must bring this fraction of the total gain, this gain of log-likelihood per
# sample, or reduce the random force by this fraction: unmodelled force is not white, and the
# likelihood rewards any effect that resembles it.
_FURTHER, _PER_SAMPLE, _QUIETER = 0.02, 0.02, 0.1


@dataclass(eq=False)
class State:
    """Causes found so far, and the fit that includes them.

    Attributes
    ----------
    fit : Solution
    causes : list of str
    free : dict of str to tuple of str
        Free parameters of each cause.
    rivals : dict of str to dict of str to FrictionAxis
        Effects that fit equally well in place of each cause, and the axes fitted with them.
    close : dict of str to list of Candidate
        Candidates that were nearly as good when the cause was chosen, with no more parameters.
    first : dict of str to float
        Gain of log-likelihood of every candidate in the first round, after a quick fit.
    refuted : set of str
        Causes that were dropped after others had joined; they are not tried again.
    settled : set of str
        Causes with a memory that were compared with all others that have one.
    gained : float
        Gain of log-likelihood of all causes together.
    late : bool
        Whether time ran out.
    """

    fit: Solution
    causes: list[str] = field(default_factory=list)
    free: dict[str, tuple[str, ...]] = field(default_factory=dict)
    rivals: dict[str, dict[str, FrictionAxis]] = field(default_factory=dict)
    close: dict[str, list[Candidate]] = field(default_factory=dict)
    first: dict[str, float] = field(default_factory=dict)
    refuted: set[str] = field(default_factory=set)
    settled: set[str] = field(default_factory=set)
    gained: float = 0.0
    late: bool = False

    @property
    def names(self) -> tuple[str, ...]:
        """Free parameters of all causes."""
        return tuple(n for slug in self.causes for n in self.free[slug])

    @property
    def alternatives(self) -> dict[str, tuple[str, ...]]:
        """Effects that fit equally well in place of each cause."""
        return {slug: tuple(some) for slug, some in self.rivals.items()}

    def drop(self, slug: str, less: Solution) -> str:
        """Remove a cause; `less` is the fit without it.

        Later ones of its kind move up by one number; returns the name that is no longer used.
        """
        before = [*self.causes]
        self.causes.remove(slug)
        for table in (self.free, self.rivals, self.close):
            table.pop(slug)
        if any(one not in named(less.axis) for one in self.causes):
            self._move_up(slug)
        self.fit = less
        return next(one for one in before if one not in self.causes)

    def _move_up(self, slug: str) -> None:
        """Renumber the causes of the kind of one that was removed."""
        now = dict(zip(self.causes, renumbered(self.causes, slug), strict=True))
        self.causes[:] = now.values()
        self.free = {now[s]: tuple(renumbered(names, slug)) for s, names in self.free.items()}
        # Candidates of the kind were fitted beside the one that was removed.
        self.rivals = {
            now[s]: {a: axis for a, axis in some.items() if not _alike(a, slug)}
            for s, some in self.rivals.items()
        }
        self.close = {
            now[s]: [c for c in some if not _alike(c.slug, slug)] for s, some in self.close.items()
        }

    def add(self, candidate: Candidate, fit: Solution) -> None:
        """Add a cause."""
        slug = candidate.slug
        self.causes.append(slug)
        self.free[slug] = candidate.free
        self.rivals[slug], self.close[slug] = {}, []
        self.fit = fit

    def swap(self, slug: str, candidate: Candidate, fit: Solution) -> None:
        """Put another cause in the place of one."""
        place = self.causes.index(slug)
        self.drop(slug, fit)
        self.add(candidate, fit)
        self.causes.insert(place, self.causes.pop())


def least_addition(so_far: float, samples: int, heard: float) -> float:
    """Smallest gain of a further cause, in addition to `so_far`, that is notable.

    `heard`: see `Solution.heard`, of the fit without it.
    """
    return min(_FURTHER / (1.0 - _FURTHER) * so_far, _PER_SAMPLE * samples, _QUIETER * heard)


def _alike(one: str, other: str) -> bool:
    """Whether two names are of effects of a kind."""
    return class_of(one) is class_of(other)


def names_without(search: Search, fit: Solution, slug: str, own: Sequence[str]) -> tuple[str, ...]:
    """Free parameters other than the base, by their names in the axis without a cause."""
    return tuple(moved_up(search, [n for n in search.free_of(fit) if n not in own], slug))


def moved_up(search: Search, names: Iterable[str], slug: str) -> list[str]:
    """Names of parameters once a cause is gone, unless the nominal axis has it too."""
    return [*names] if holds(search.believed, slug) else renumbered(names, slug)


def without(search: Search, state: State, slug: str, **settings: Any) -> Solution:
    """Fit without one cause."""
    fit = state.fit
    axis = search.less(fit.axis, slug)
    free = names_without(search, fit, slug, state.free[slug])
    return search.fit(axis, free, **settings)


def restarted(search: Search, state: State, slug: str, less: Solution) -> bool:
    """Fit again from `less`, a fit without a cause, if it is more likely than that with it.

    A fit cannot be less likely than one it contains, unless it has missed the optimum.  Returns
    whether the new one is notably better.
    """
    before = state.fit
    if less.cost >= before.cost or search.late:
        return False
    values = before.values()
    own = {n.partition(".")[2]: values[n] for n in state.free[slug]}
    names = (*names_without(search, before, slug, state.free[slug]), *state.free[slug])
    noises = less.z[len(less.problem.names) :]
    found = search.fit(with_effect(less.axis, slug, own).axis, names, noises)
    if found.cost < before.cost:
        state.fit = found
    return found.cost < before.cost - EQUAL
