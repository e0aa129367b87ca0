"""Which causes a record shows: forward, backward, and what it cannot tell apart."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from dryfric_control.diagnosis.candidate_fits import CAUSE_COST, Fitted, Race
from dryfric_control.diagnosis.candidates import (
    BASE,
    catalogue,
    effect_class,
    holds,
    own_names,
    placed,
)
from dryfric_control.diagnosis.gain_or_base import GAIN, far_off, left_open
from dryfric_control.diagnosis.noise_floor import NONE, REPLAYS, Floor, noise_floor
from dryfric_control.estimation.parameters import values_of, with_values
from dryfric_control.estimation.problem import CANDIDATE, base_cost, spreads_off
from dryfric_control.estimation.uncertainty import block_labels, jackknife
from dryfric_control.estimation.windows import ROBUST, Evaluation
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.model.effects.naming import followed, named, put, renumbered
from dryfric_control.ties import SQUARES, above, ranked

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

# A gain counts if it is this many standard errors above zero (two dozen
# candidates are tried) or wins this many times what it loses, and this much in
# the mean score; two fits tie if their scores differ by less.
_SURE, _LEAST, _TIE = 3.0, 0.03, 0.03
# Part of the structured error that a cause must take away to be named.
_SHARE = 0.05
# A base parameter off by less than this is what anybody would call right.
_RIGHT = 0.004
_MOST_CAUSES = 4
# Causes proposed in one step, each refused if the fit without it does as well.
_PROPOSED = 4
# Hypotheses whose likelihood and assumptions differ by less than this, in units
# of chi^2, are equally good.
_PLAIN = 4.0
# A window is in line for comparing likelihoods up to this much above its replays.
_LINED = 0.1
# What a wrong base parameter costs at most, less than any other cause.
_BASE_MOST = 0.8 * CAUSE_COST


@dataclass(eq=False)
class Selection:
    """State of the search.

    Attributes
    ----------
    causes : list of str
        Names of the effects found, in order; base parameters not among them.
    best : Fitted
        Fit with all causes and base parameters free.
    alternatives : dict of str to tuple of str
        For each cause, what explains the record as well in its place.
    first : dict of str to float
        Mean held-out score of every candidate of the first round.
    earlier : dict of frozenset to Fitted
        Fit with each set of causes that the search went on from.
    """

    best: Fitted
    causes: list[str] = field(default_factory=list)
    free: dict[str, tuple[str, ...]] = field(default_factory=dict)
    alternatives: dict[str, tuple[str, ...]] = field(default_factory=dict)
    rivals: dict[str, dict[str, FrictionAxis]] = field(default_factory=dict)
    first: dict[str, float] = field(default_factory=dict)
    earlier: dict[frozenset[str], Fitted] = field(default_factory=dict)

    def drop(self, slug: str) -> None:
        """Go on without a cause."""
        self.causes.remove(slug)
        for table in (self.free, self.alternatives, self.rivals):
            table.pop(slug, None)


class Selector:
    """Forward selection of causes on one record, with a backward pass."""

    def __init__(
        self,
        race: Race,
        axis: FrictionAxis,
        tell: Callable[[str], None],
    ) -> None:
        self.race, self.axis, self.tell = race, axis, tell
        self.bench = race.bench
        self.known = race.fit | race.judge
        self.labels = block_labels([self.bench])
        # Causes that a search named and the fit without them refuted.
        self.refuted: set[str] = set()

    @property
    def late(self) -> bool:
        """Whether time is over."""
        return self.race.late

    # -- tests -----------------------------------------------------------------

    def floor_of(self, fitted: Fitted) -> Floor:
        """Floor of a fitted hypothesis, its uncertainty included."""
        h, z = fitted.hypothesis, fitted.z
        at = self.bench.evaluate(fitted.axis, self.known, None, fitted.starts)
        truths = [fitted.axis]
        if z.size:
            rng = np.random.default_rng(1)
            covariance = self.covariance(fitted, at)
            values, vectors = np.linalg.eigh(covariance)
            root = vectors * np.sqrt(np.maximum(values, 0.0))
            for _ in range(REPLAYS - 1):
                there = np.clip(z + root @ rng.standard_normal(z.size), h.low, h.high)
                try:
                    truths.append(h.axis_at(there))
                except ValueError:
                    truths.append(fitted.axis)
        else:
            truths *= REPLAYS
        return noise_floor(self.bench, fitted.axis, truths, at, self.known)

    def covariance(self, fitted: Fitted, at: Evaluation) -> FloatArray:
        """Covariance of the search coordinates, from leaving out blocks."""
        h, z = fitted.hypothesis, fitted.z
        h.active, h.scales = [self.known], [self.bench.floor]
        g, normal, _ = h.terms(z, [at], CANDIDATE)
        prior = h.prior(z)[2] + 1e-9
        known = np.flatnonzero(self.known)
        labels = np.unique(self.labels[known], return_inverse=True)[1]
        covariance, _ = jackknife(g[known], normal[known], labels, prior)
        if not np.all(np.isfinite(covariance)):
            covariance = np.diag(1.0 / (normal.sum(axis=0).diagonal() + prior))
        return covariance

    def gain(self, before: FloatArray, after: FloatArray) -> tuple[float, float]:
        """Mean fall of the held-out scores, and its standard error by blocks."""
        judge = np.flatnonzero(self.race.judge)
        fall = (before - after)[judge]
        labels = np.unique(self.labels[judge], return_inverse=True)[1]
        count = np.bincount(labels)
        mean = float(fall.mean())
        blocks = np.bincount(labels, fall - mean) / count.mean()
        if blocks.size < 2:
            return mean, np.inf
        return mean, float(np.std(blocks, ddof=1) / np.sqrt(blocks.size))

    def better(self, before: FloatArray, after: FloatArray, floor: Floor) -> bool:
        """Whether a fall of the held-out scores names a cause."""
        mean, error = self.gain(before, after)
        above = max(self.excess(before, floor), 0.0)
        if self.rids(before, after, floor):
            return True
        fall = (before - after)[self.race.judge]
        won, lost = fall[fall > 0.0], -fall[fall < 0.0]
        # What is rare is seen in few blocks: then it must cost nowhere else.
        sure = mean > _SURE * error or (won.sum() > _SURE * lost.sum() and (won > 0.3).sum() > 1)
        return bool(mean > max(_LEAST, _SHARE * above) and sure)

    def earns(self, without: Fitted, fitted: Fitted, floor: Floor, causes: int) -> bool:
        """Whether a fit with one cause more is worth it.

        It tells more; or else the fit without it bends base parameters, which
        is the bolder claim: by a whole cause, unless one of the two leaves
        nothing to tell.  Either way it must fit the better, on the data that it
        was fitted to.
        """
        if not above(without.loss, fitted.loss + SQUARES):
            return False
        if self.better(without.scores, fitted.scores, floor):
            return True
        bolder = self.cost(without, causes - 1) - self.cost(fitted, causes)
        complete = any(floor.reached(r.scores, self.known) for r in (without, fitted))
        return bolder > (0.0 if complete else CAUSE_COST) and self.ties(
            fitted.scores, without.scores, floor
        )

    def rids(self, before: FloatArray, after: FloatArray, floor: Floor) -> bool:
        """Whether windows that nothing else explains fall into line.

        What acts rarely is seen in a window or two of those that judge: a mean
        over all says nothing.
        """
        bad, left = floor.outliers(before, self.known), floor.outliers(after, self.known)
        judged = bad & self.race.judge
        mended = bad & ~left
        return bool(
            mended.sum() >= 3
            and 3 * left.sum() <= bad.sum()
            and np.any(judged)
            and 3 * (left & self.race.judge).sum() <= judged.sum()
        )

    def excess(self, scores: FloatArray, floor: Floor) -> float:
        """Mean held-out score above the floor."""
        return float((scores - floor.expected)[self.race.judge].mean())

    def nothing_left(self, scores: FloatArray, floor: Floor) -> bool:
        """Whether no further cause could earn its name.

        One window out of line among those that judge names none, see `better`,
        nor do two in all, see `rids`.
        """
        out = floor.outliers(scores, self.known)
        return bool(
            out.sum() < 3
            and (out & self.race.judge).sum() < 2
            and floor.excess(scores, self.known & ~out)[0] < NONE
        )

    def ties(self, one: FloatArray, best: FloatArray, floor: Floor) -> bool:
        """Whether held-out scores are as good as the best."""
        if self.rids(one, best, floor):
            return False
        mean, error = self.gain(one, best)
        return mean < max(_TIE, 0.02 * self.excess(best, floor)) or (
            mean < 2.0 * error and mean < 0.1
        )

    def cost(self, fitted: Fitted, causes: int) -> float:
        """What a hypothesis assumes: its causes, and its wrong base parameters."""
        total = CAUSE_COST * causes
        values = fitted.hypothesis.values(fitted.z)
        for name, believed in self.race.believed.items():
            if believed > 0.0 and name in values and name not in self.race.tolerance:
                total += min(base_cost(spreads_off(values[name], believed)), _BASE_MOST)
        return total

    # -- search ----------------------------------------------------------------

    def run(self) -> tuple[Selection, Floor]:
        """Search until nothing significant is left."""
        self.tell("base parameters")
        best = self.race.alone(self.axis, ())
        floor = self.floor_of(best)
        found = Selection(best)
        found.first[""] = float(best.scores[self.race.judge].mean())
        while len(found.causes) < _MOST_CAUSES and not self.late:
            settled = self.nothing_left(best.scores, floor)
            if settled and self.cost(best, 0) < CAUSE_COST:
                break
            self.tell(f"cause {len(found.causes) + 1}")
            step = self._step(found, floor)
            if step is None:
                break
            best = found.best = step
            floor = self.floor_of(best)
        floor = self._backward(found, floor)
        if len(found.causes) > 1 and not self.late:
            floor = self._swap(found, floor)
        return found, floor

    def names(self, found: Selection, without: str = "") -> list[str]:
        """Free parameters of the causes, as they are in the axis without one of them."""
        names = [n for slug, names in found.free.items() if slug != without for n in names]
        return names if holds(self.axis, without) else renumbered(names, without)

    def _step(self, found: Selection, floor: Floor) -> Fitted | None:
        candidates = catalogue(found.best.axis, (*found.causes, *self.refuted))
        runners = self.race.among(found.best, self.names(found), candidates)
        judged = [r for r in runners if r.scores.size and self._placed(r.slug, r, self._own(r))]
        if not found.causes:
            for r in judged:
                found.first[r.slug] = float(r.scores[self.race.judge].mean())
        if not judged:
            return None
        count = len(found.causes)
        for _ in range(min(_PROPOSED, len(judged))):
            winner, rivals = self._choose(judged, found.best, floor, count)
            if winner is None:
                return None
            # The same without the cause, from where the winner got to: the fit
            # without it may only have ended early.
            less = self.race.alone(self.without(winner.axis, winner.slug), self.names(found))
            if above(found.best.loss, less.loss + SQUARES):
                found.best = less
            if self.earns(found.best, winner, floor, count + 1):
                break
            judged.remove(winner)
        else:
            return None
        found.earlier[frozenset(found.causes)] = found.best
        found.causes.append(winner.slug)
        found.free[winner.slug] = self._own(winner)
        found.alternatives[winner.slug] = tuple(r.slug for r in rivals if r.slug)
        found.rivals[winner.slug] = {r.slug: r.axis for r in rivals if r.slug}
        return winner

    def _placed(self, slug: str, fitted: Fitted, own: Sequence[str]) -> bool:
        """Whether a cause, by its own parameters, acts where and when the record can tell."""
        values = fitted.hypothesis.values(fitted.z)
        return placed(slug, {n: values[n] for n in own}, [self.bench.record])

    def _own(self, fitted: Fitted) -> tuple[str, ...]:
        return tuple(n for n in fitted.hypothesis.names if n.partition(".")[0] == fitted.slug)

    def _choose(
        self, judged: list[Fitted], current: Fitted, floor: Floor, causes: int
    ) -> tuple[Fitted | None, list[Fitted]]:
        """The plainest of the best, and those that tie with it."""
        judge = self.race.judge
        best = judged[ranked([r.scores[judge].mean() for r in judged])[0]]
        level = [r for r in judged if self.ties(r.scores, best.scores, floor)]
        if self.ties(current.scores, best.scores, floor) or not self.better(
            current.scores, best.scores, floor
        ):
            level = [r for r in level if self.earns(current, r, floor, causes + 1)]
            if not level:
                return None, []
        winner = self._plainest(level, causes + 1, floor)
        most = self.cost(winner, causes + 1) + _PLAIN
        rivals = [
            r
            for r in level
            if r is not winner
            and self.cost(r, causes + 1) < most
            # Not one that does nothing and leaves the work to the base parameters.
            and (
                self.better(current.scores, r.scores, floor)
                or self.cost(r, causes + 1) < self.cost(current, causes)
            )
        ]
        return winner, rivals

    def _plainest(self, level: list[Fitted], causes: int, floor: Floor) -> Fitted:
        """The likeliest of fits that tie; of those as likely, the plainest."""
        judge = self.race.judge
        weight = self.bench.samples * ROBUST**2
        costs = {id(r): self.cost(r, causes) for r in level}
        totals = [float(weight[judge] @ r.scores[judge]) + costs[id(r)] for r in level]
        best = level[ranked(totals, SQUARES)[0]]
        level = [r for r in level if costs[id(r)] < costs[id(best)] + _PLAIN]
        if len(level) == 1:
            return best
        # Held-out data has not told them apart; all that may be looked at might.
        scores = []
        for r in level:
            base = [n for n in r.hypothesis.names if n in self.race.believed]
            own = [n for n in r.hypothesis.names if n not in base]
            scores.append(self.race.alone(r.axis, own, r.slug, base, active=self.known).scores)
        # A break-away that one fit hits by luck must not decide: only windows
        # count that are in line in all of them.
        lined = self.known & np.all(np.array(scores) < floor.worst + _LINED, axis=0)
        if lined.sum() < 2:
            lined = self.known
        totals = [
            float(weight[lined] @ told[lined]) + costs[id(r)]
            for r, told in zip(level, scores, strict=True)
        ]
        likely = [r for r, t in zip(level, totals, strict=True) if t < min(totals) + _PLAIN]
        return min(likely, key=lambda r: effect_class(r.slug).rank)

    def _backward(self, found: Selection, floor: Floor) -> Floor:
        """Drop what later causes or a better fit made superfluous, one at a time."""
        changed = True
        while changed and found.causes and not self.late:
            changed = False
            for slug in list(found.causes):
                if self.followed(slug, found):
                    continue
                self.tell(f"without {slug}")
                less = self.race.alone(self.without(found.best.axis, slug), self.names(found, slug))
                earlier = found.earlier.get(frozenset(found.causes) - {slug}, less)
                if above(less.loss, earlier.loss + SQUARES):
                    less = earlier
                if not self.earns(less, found.best, floor, len(found.causes)):
                    found.drop(slug)
                    for one, rivals in found.rivals.items():
                        # A second of its kind is none without it.
                        for name in [n for n in rivals if followed(slug, [n])]:
                            del rivals[name]
                            found.alternatives[one] = tuple(rivals)
                    found.best = less
                    floor = self.floor_of(less)
                    changed = True
                    break
        return floor

    def _swap(self, found: Selection, floor: Floor) -> Floor:
        """Weigh each cause against its alternatives once the others are known."""
        count = len(found.causes)
        for i, slug in enumerate(list(found.causes)):
            if self.followed(slug, found):
                continue
            # The fit may stem from one that another effect was added to, or taken from.
            runs = {slug: replace(found.best, slug=slug)}
            names = {slug: found.free[slug]}
            rest = self.without(found.best.axis, slug)
            for other, rival in found.rivals.get(slug, {}).items():
                if other in found.causes:
                    continue
                self.tell(f"{other} for {slug}")
                axis = in_place(rest, rival, other)
                names[other] = own_names(other)
                free = [*self.names(found, slug), *names[other]]
                runs[other] = self.race.alone(axis, free, slug=other)
            if len(runs) == 1:
                continue
            judge = self.race.judge
            best = list(runs.values())[ranked([r.scores[judge].mean() for r in runs.values()])[0]]
            level = [r for r in runs.values() if self.ties(r.scores, best.scores, floor)]
            winner = self._plainest(level, count, floor)
            chosen = next(s for s, r in runs.items() if r is winner)
            found.causes[i] = chosen
            for table in (found.free, found.alternatives, found.rivals):
                table.pop(slug, None)
            found.free[chosen] = names[chosen]
            rivals = {s: r.axis for s, r in runs.items() if r in level and s != chosen}
            found.alternatives[chosen], found.rivals[chosen] = tuple(rivals), rivals
            if chosen != slug:
                found.best = winner
                floor = self.floor_of(winner)
        return floor

    def without(self, axis: FrictionAxis, name: str) -> FrictionAxis:
        """The axis less one effect, or with it as believed."""
        return put(axis, name, named(self.axis).get(name))

    def followed(self, name: str, found: Selection) -> bool:
        """Whether a cause must stay, for a second of its kind is one too."""
        return not holds(self.axis, name) and followed(name, found.causes)

    def base(self, found: Selection, floor: Floor) -> tuple[Fitted, list[str]]:
        """Fit without the base corrections that nothing speaks for, and the others."""
        best = found.best
        kept = names = [n for n in BASE.values() if n in best.hypothesis.names]
        for i in ranked([self.change(best, n) for n in kept], SQUARES):
            name = names[i]
            self.tell(f"believed {name}")
            left = [n for n in kept if n != name]
            there = self.hold(best.axis, [n for n in BASE.values() if n not in left])
            less = self.race.alone(there, self.names(found), base=left)
            if not self.better(less.scores, best.scores, floor):
                best, kept = less, left
        return best, kept

    def without_a_gain(
        self, found: Selection, best: Fitted, kept: list[str], floor: Floor
    ) -> tuple[Fitted, list[str]]:
        """Base parameters in place of a gain that leaves them far off, where they do the same."""
        race = self.race
        if GAIN not in found.causes or not left_open(self.axis, {*race.known, *race.tolerance}):
            return best, kept
        values = best.hypothesis.values(best.z)
        if not far_off(values, race.believed, kept):
            return best, kept
        rest = self.without(best.axis, GAIN)
        gain = values[f"{GAIN}.gain"]
        scaled = with_values(rest, [*BASE.values()], values_of(rest, [*BASE.values()]) / gain)
        less = race.alone(scaled, self.names(found, GAIN))
        if not self.ties(less.scores, best.scores, floor):
            return best, kept
        found.drop(GAIN)
        return less, [*BASE.values()]

    def refutes(self, found: Selection, best: Fitted, kept: Sequence[str], floor: Floor) -> bool:
        """Whether a cause falls once no more base parameters than needed are free.

        So does what has moved to where the machine was not.  What falls is remembered, and
        not proposed again.
        """
        fallen = set()
        for slug in found.causes:
            if self.followed(slug, found):
                continue
            if not self._placed(slug, best, found.free[slug]):
                fallen.add(slug)
                continue
            self.tell(f"{slug} confirmed")
            less = self.race.alone(
                self.without(best.axis, slug), self.names(found, slug), base=kept
            )
            if not self.earns(less, best, floor, len(found.causes)):
                fallen.add(slug)
        self.refuted |= fallen
        return bool(fallen)

    def change(self, fitted: Fitted, name: str) -> float:
        """Relative change of a base parameter from its believed value."""
        value = fitted.hypothesis.values(fitted.z)[name]
        believed = self.race.believed[name]
        return abs(value / believed - 1.0) if believed > 0.0 else abs(value)

    def wrong(self, fitted: Fitted, kept: Sequence[str]) -> list[str]:
        """Base parameters that are off by more than anybody would call right."""
        return [n for n in kept if self.change(fitted, n) > _RIGHT]

    def hold(self, axis: FrictionAxis, names: Sequence[str]) -> FrictionAxis:
        """The axis with base parameters back at their believed values."""
        return with_values(axis, list(names), [self.race.believed[n] for n in names])


def in_place(axis: FrictionAxis, rival: FrictionAxis, name: str) -> FrictionAxis:
    """The axis with an alternative's effect, and the base that goes with it."""
    there = put(axis, name, named(rival).get(name))
    return there.replace(mass=rival.mass, viscous=rival.viscous, coulomb=rival.coulomb)
