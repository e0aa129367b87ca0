"""Selection of causes by free runs: forward, backward, and equivalent alternatives."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from dryfric_control.diagnosis.candidate_fits import CAUSE_COST, Fitted, Race
from dryfric_control.diagnosis.candidates import (
    BASE,
    amounts,
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

# A gain is significant if it is _SURE standard errors above zero (two dozen candidates are
# tried), or if improvements exceed deteriorations _SURE times; the mean score must fall by
# _LEAST. Two fits tie if their mean scores differ by less than _TIE.
_SURE, _LEAST, _TIE = 3.0, 0.03, 0.03
# Fraction of the score above the noise floor that a cause must remove to be named.
_SHARE = 0.05
# Relative error of a base parameter up to which it counts as right.
_RIGHT = 0.004
_MOST_CAUSES = 4
# Number of causes proposed in one step; each is rejected if the fit without it is as good.
_PROPOSED = 4
# Difference of likelihood plus assumptions, in units of chi^2, up to which hypotheses
# are equally good.
_PLAIN = 4.0
# Score above the worst replay up to which a window is used to compare likelihoods.
_LINED = 0.1
# Largest cost of a wrong base parameter, less than that of any other cause.
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
        For each cause, the effects that explain the record equally well in its place.
    first : dict of str to float
        Mean held-out score of every candidate of the first round.
    earlier : dict of frozenset to Fitted
        Fits with the sets of causes from which the search has continued.
    """

    best: Fitted
    causes: list[str] = field(default_factory=list)
    free: dict[str, tuple[str, ...]] = field(default_factory=dict)
    alternatives: dict[str, tuple[str, ...]] = field(default_factory=dict)
    rivals: dict[str, dict[str, FrictionAxis]] = field(default_factory=dict)
    first: dict[str, float] = field(default_factory=dict)
    earlier: dict[frozenset[str], Fitted] = field(default_factory=dict)

    def drop(self, slug: str) -> None:
        """Remove a cause."""
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
        # Causes found by a search but refuted by the fit without them.
        self.refuted: set[str] = set()

    @property
    def late(self) -> bool:
        """Whether the time limit has passed."""
        return self.race.late

    # -- tests -----------------------------------------------------------------

    def floor_of(self, fitted: Fitted) -> Floor:
        """Noise floor of a fitted hypothesis, parameter uncertainty included."""
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
        """Covariance of the search coordinates, by a jackknife over blocks."""
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

    def standard_errors(self, fitted: Fitted) -> dict[str, float]:
        """Standard errors of the free parameters, by name."""
        if not fitted.z.size:
            return {}
        at = self.bench.evaluate(fitted.axis, self.known, None, fitted.starts)
        spread = np.sqrt(np.diag(self.covariance(fitted, at)))
        rows = zip(fitted.hypothesis.parameters, fitted.z, spread, strict=True)
        return {p.name: float(s * p.slope(p.value(c))) for p, c, s in rows}

    def gain(self, before: FloatArray, after: FloatArray) -> tuple[float, float]:
        """Mean fall of the held-out scores, and its standard error from blocks."""
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
        """Whether the fall of the held-out scores is significant enough to name a cause."""
        mean, error = self.gain(before, after)
        above = max(self.excess(before, floor), 0.0)
        if self.rids(before, after, floor):
            return True
        fall = (before - after)[self.race.judge]
        won, lost = fall[fall > 0.0], -fall[fall < 0.0]
        # An effect that acts rarely shows in few blocks: then it must not do harm in others.
        sure = mean > _SURE * error or (won.sum() > _SURE * lost.sum() and (won > 0.3).sum() > 1)
        return bool(mean > max(_LEAST, _SHARE * above) and sure)

    def earns(self, without: Fitted, fitted: Fitted, floor: Floor, causes: int) -> bool:
        """Whether a fit with one more cause is justified.

        It must have the lower loss on the data of the fit, and either lower the held-out
        score, or tie with a fit without it whose changes of base parameters are the
        stronger assumption: by the cost of a cause, or by any amount if one of the two
        fits reaches the noise floor.
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
        """Whether windows that were outliers of the noise floor no longer are.

        An effect that acts rarely shows in one or two of the judging windows, where a
        mean over all windows does not reveal it.
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
        """Whether no further cause could be named.

        One outlier among the judging windows is not enough to name a cause, see
        `better`, nor are two among all windows, see `rids`.
        """
        out = floor.outliers(scores, self.known)
        return bool(
            out.sum() < 3
            and (out & self.race.judge).sum() < 2
            and floor.excess(scores, self.known & ~out)[0] < NONE
        )

    def ties(self, one: FloatArray, best: FloatArray, floor: Floor) -> bool:
        """Whether held-out scores tie with the best."""
        if self.rids(one, best, floor):
            return False
        mean, error = self.gain(one, best)
        return mean < max(_TIE, 0.02 * self.excess(best, floor)) or (
            mean < 2.0 * error and mean < 0.1
        )

    def cost(self, fitted: Fitted, causes: int) -> float:
        """Cost of the assumptions of a hypothesis: causes and wrong base parameters."""
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
        """Free parameters of the causes, by their names in the axis without one of them."""
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
            # Refit without the cause from the winner's values: the earlier fit without it
            # may have stopped early.
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
        """Whether a cause acts at positions, speeds and times that the record covers."""
        values = fitted.hypothesis.values(fitted.z)
        return placed(slug, {n: values[n] for n in own}, [self.bench.record])

    def _determined(
        self, slug: str, fitted: Fitted, own: Sequence[str], errors: Mapping[str, float]
    ) -> bool:
        """Whether any amount of a cause exceeds its standard error."""
        values = fitted.hypothesis.values(fitted.z)
        there = [abs(values[n] - neutral) > errors[n] for n, neutral, _ in amounts(slug, own)]
        return any(there) or not there

    def _own(self, fitted: Fitted) -> tuple[str, ...]:
        return tuple(n for n in fitted.hypothesis.names if n.partition(".")[0] == fitted.slug)

    def _choose(
        self, judged: list[Fitted], current: Fitted, floor: Floor, causes: int
    ) -> tuple[Fitted | None, list[Fitted]]:
        """The simplest of the best candidates, and those that tie with it."""
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
            # Not one without effect, whose base parameters make the fit.
            and (
                self.better(current.scores, r.scores, floor)
                or self.cost(r, causes + 1) < self.cost(current, causes)
            )
        ]
        return winner, rivals

    def _plainest(self, level: list[Fitted], causes: int, floor: Floor) -> Fitted:
        """The likeliest of fits that tie; of equally likely ones, the lowest in rank."""
        judge = self.race.judge
        weight = self.bench.samples * ROBUST**2
        costs = {id(r): self.cost(r, causes) for r in level}
        totals = [float(weight[judge] @ r.scores[judge]) + costs[id(r)] for r in level]
        best = level[ranked(totals, SQUARES)[0]]
        level = [r for r in level if costs[id(r)] < costs[id(best)] + _PLAIN]
        if len(level) == 1:
            return best
        # Held-out data do not separate them; all data to fit and to judge may.
        scores = []
        for r in level:
            base = [n for n in r.hypothesis.names if n in self.race.believed]
            own = [n for n in r.hypothesis.names if n not in base]
            scores.append(self.race.alone(r.axis, own, r.slug, base, active=self.known).scores)
        # A breakaway that one fit times right by chance must not decide: use only windows
        # that are no outliers in any fit.
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
        """Drop causes that later ones or a better fit made redundant, one at a time."""
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
                        # Without it, a second effect of its kind is no alternative.
                        for name in [n for n in rivals if followed(slug, [n])]:
                            del rivals[name]
                            found.alternatives[one] = tuple(rivals)
                    found.best = less
                    floor = self.floor_of(less)
                    changed = True
                    break
        return floor

    def without_refuted(self, found: Selection) -> Floor:
        """Drop the causes that have been refuted, where no search takes their place."""
        for slug in [s for s in found.causes if s in self.refuted]:
            names = self.names(found, slug)
            found.best = self.race.alone(self.without(found.best.axis, slug), names)
            found.drop(slug)
        return self.floor_of(found.best)

    def _swap(self, found: Selection, floor: Floor) -> Floor:
        """Compare each cause with its alternatives once the others are known."""
        count = len(found.causes)
        for i, slug in enumerate(list(found.causes)):
            if self.followed(slug, found):
                continue
            # The best fit may carry the name of another effect.
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
        """The axis with an effect as in the nominal axis, or without it if that has none."""
        return put(axis, name, named(self.axis).get(name))

    def followed(self, name: str, found: Selection) -> bool:
        """Whether a cause must stay because a second effect of its kind is a cause too."""
        return not holds(self.axis, name) and followed(name, found.causes)

    def base(self, found: Selection, floor: Floor) -> tuple[Fitted, list[str]]:
        """Fit with only the base corrections that the data support, and their names."""
        best = found.best
        kept = names = [n for n in BASE.values() if n in best.hypothesis.names]
        for i in ranked([self.change(best, n) for n in kept], SQUARES):
            name = names[i]
            self.tell(f"nominal {name}")
            left = [n for n in kept if n != name]
            there = self.hold(best.axis, [n for n in BASE.values() if n not in left])
            less = self.race.alone(there, self.names(found), base=left)
            if not self.better(less.scores, best.scores, floor):
                best, kept = less, left
        return best, kept

    def without_a_gain(
        self, found: Selection, best: Fitted, kept: list[str], floor: Floor
    ) -> tuple[Fitted, list[str]]:
        """Base parameters instead of an input gain, if equivalent and far off beside it."""
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
        """Whether a cause is refuted once only the needed base parameters are free.

        So is a cause that has left the travelled range or that nothing determines.  Refuted
        causes are not proposed again.
        """
        fallen, errors = set(), self.standard_errors(best) if found.causes else {}
        for slug in found.causes:
            if self.followed(slug, found):
                continue
            own = found.free[slug]
            if not (self._placed(slug, best, own) and self._determined(slug, best, own, errors)):
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
        """Relative change of a base parameter from its nominal value."""
        value = fitted.hypothesis.values(fitted.z)[name]
        believed = self.race.believed[name]
        return abs(value / believed - 1.0) if believed > 0.0 else abs(value)

    def wrong(self, fitted: Fitted, kept: Sequence[str]) -> list[str]:
        """Base parameters whose error is large enough to be named."""
        return [n for n in kept if self.change(fitted, n) > _RIGHT]

    def hold(self, axis: FrictionAxis, names: Sequence[str]) -> FrictionAxis:
        """The axis with base parameters back at their nominal values."""
        return with_values(axis, list(names), [self.race.believed[n] for n in names])


def in_place(axis: FrictionAxis, rival: FrictionAxis, name: str) -> FrictionAxis:
    """The axis with an alternative's effect and the base parameters fitted with it."""
    there = put(axis, name, named(rival).get(name))
    return there.replace(mass=rival.mass, viscous=rival.viscous, coulomb=rival.coulomb)
