"""Diagnosis by likelihood, for records in which a random force acts."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dryfric_control.diagnosis.candidate_fits import Fitted, Race
from dryfric_control.diagnosis.candidates import SLUGS, catalogue, holds, with_effect
from dryfric_control.diagnosis.causes import cause_of, hardly_determined
from dryfric_control.diagnosis.causes_found import State, names_without, without
from dryfric_control.diagnosis.evidence import where
from dryfric_control.diagnosis.forward_search import forward, resumed
from dryfric_control.diagnosis.gain_or_base import GAIN, every, far_off, left_open, or_a_gain
from dryfric_control.diagnosis.held_out import CLEAR, LEAST, HeldOut
from dryfric_control.diagnosis.likelihood_fits import hard
from dryfric_control.diagnosis.likelihood_search import EQUAL, MOVED, STRAIGHT, Search
from dryfric_control.diagnosis.noise_floor import Floor, far_above, noise_floor, usual_rms
from dryfric_control.diagnosis.remaining import Remaining, remaining
from dryfric_control.diagnosis.report.findings import LATE, Cause, Gain, Unexplained
from dryfric_control.diagnosis.screening import Candidate
from dryfric_control.estimation.likelihood import BASE
from dryfric_control.estimation.parameters import typical, with_values
from dryfric_control.estimation.solution import Solution
from dryfric_control.estimation.windows import Windows
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.model.effects.naming import class_of, followed

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

# Windows (to fit, to judge) that decide whether free runs reach the noise of the readings.
_GATE_FIT, _GATE_JUDGE = 8, 4
# Largest number of causes tried together there, and number of the likeliest candidates tried.
_TOGETHER, _LIKELY = 2, 6
# The first of two causes must lower the mean score to this fraction or less.
_HELPS = 0.95
# Windows of each record that are replayed, and number of replays: enough that a window in which
# the axis breaks away only sometimes does so in some replay.
_REPLAYED, _REPLAYS = 40, 20
# Relative error of a base parameter up to which it counts as right.
_RIGHT = 0.004
# RMS force of a base-parameter error, as a fraction of the random force, from which it is named.
_NOTABLE = 0.25
# Factors of random force without a cause over that with it: the least for a cause where structure
# is left in the residual; one that no false cause reaches; and the held-out gain in total, in
# standard errors, that is sufficient there, however few blocks gain.
_LOUDER, _MUCH_LOUDER, _ON_THE_WHOLE = 1.1, 2.0, 1.5
# Largest logarithm of a ratio of innovations.
_MOST_LOUDER = 50.0
# Random force without an unconfirmed cause, over that with it, above which another cause must
# have its place: the search looks for it again.
_MISSED = 1.25
# Free-run error, over that of the nominal axis, beyond which no cause is shown.
_WORSE = 1.1
# Fraction of the windows that may have larger errors than all their replays, and excess of the
# mean score over that of the replays that is still no structure.
_STRAY, _EXCESS = 0.1, 0.2
# Growth of the standard errors of record-specific parameters, by one parameter more, beyond which
# the two cannot be separated.
_BLURRED = 2.0
# Iterations of a trial fit with one more record-specific parameter, and its largest further gain
# over the predicted gain of its last step.
_OWN_TURNS, _OWN_AHEAD = 3, 3.0
# Ratio of the RMS of the force residual to that of its sample-to-sample changes beyond which it
# has structure.
_SMOOTH = 1.5
# The effect that is equivalent to an input gain if the drive never brakes, and the iterations of
# a fit with it.
_LOAD, _LOAD_TURNS = "load_dependence", 10
# Messages: the fit did not converge; a straight line is the better model; the motion is imposed.
UNFINISHED = "the last fit had not converged"
LINE = (
    "a straight line predicts the readings better than the model does: the drive and the friction "
    "of the model do not explain this motion; check first the units, factors and signs of input "
    "and position"
)
IMPOSED = (
    "the motion is imposed by something other than the drive, such as a bench or a tight loop: it "
    "says nothing about the forces, so the drive was compared with the force the motion requires"
)
ONE_VELOCITY = (
    "each direction has nearly one velocity: effects that depend on velocity cannot be separated "
    "from the Coulomb level and were not tried; viscous friction keeps its nominal value"
)


@dataclass(eq=False)
class Gate:
    """Test whether some hypothesis brings free runs down to the noise of the readings.

    If so, no random force acts, and free runs are the sharpest criterion.

    Parameters
    ----------
    windows : Windows
    axis : FrictionAxis
    fit, judge : ndarray of bool
        Windows on which free runs are fitted and judged.
    settings : dict
        Keyword arguments of `Race`.

    Attributes
    ----------
    hints : list of FrictionAxis
        Axes of the candidates as fitted by likelihood.
    """

    windows: Windows
    axis: FrictionAxis
    fit: BoolArray
    judge: BoolArray
    settings: dict[str, Any]
    hints: list[FrictionAxis] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.race = Race(
            self.windows, self.axis, self._some(self.fit, _GATE_FIT),
            self._some(self.judge, _GATE_JUDGE), typical([self.windows.record]), **self.settings,
        )  # fmt: skip
        self.seen = self.race.fit | self.race.judge

    def _some(self, mask: BoolArray, most: int) -> BoolArray:
        index = np.flatnonzero(mask & self.windows.moving)
        if index.size > most:
            index = index[np.linspace(0, index.size - 1, most).astype(int)]
        chosen = np.zeros(len(self.windows), bool)
        chosen[index] = True
        return chosen

    def at(self, axis: FrictionAxis, free: Sequence[str]) -> bool:
        """Whether an axis with free base and further parameters reaches the noise."""
        return self._reached(self.race.alone(axis, free))

    def _reached(self, one: Fitted) -> bool:
        return self.windows.reached(one.scores, self.seen)

    def _beside(self, base: Fitted) -> list[Fitted]:
        """A fit with each effect of the catalogue added."""
        free = [n for n in base.hypothesis.names if n not in BASE]
        found = dict.fromkeys(n.partition(".")[0] for n in free)
        effects = catalogue(base.axis, list(found))
        return [r for r in self.race.among(base, free, effects) if r.scores.size]

    def opens(self, state: State, candidates: Sequence[Candidate]) -> bool:
        """Whether the axis with its causes and one more candidate reaches the noise."""
        if len(state.causes) >= _TOGETHER:
            return False
        self.hints += [c.axis for c in candidates]
        likely = list(candidates[:_LIKELY])
        # `hard` effects may rank low, as their slopes are no guide far from the optimum.
        likely += [c for c in candidates[_LIKELY:] if hard(c.slug)]
        return any(self.at(c.axis, (*state.names, *c.free)) for c in likely)

    def opens_wide(self) -> bool:
        """Whether one or two effects of the catalogue reach the noise.

        Asked where the answer of the likelihood leaves something unexplained.
        """
        base = self.race.alone(self.axis, ())
        for _ in range(_TOGETHER):
            runners = self._beside(base)
            if self.race.late:
                return False
            if any(map(self._reached, runners)):
                return True
            best = min(runners, key=lambda r: r.scores[self.seen].mean(), default=base)
            # One of several causes lowers the score clearly; a random force cannot be modelled.
            if best.scores[self.seen].mean() > _HELPS * base.scores[self.seen].mean():
                return False
            base = best
        return False


@dataclass(eq=False)
class Answer:
    """Result of the diagnosis by likelihood for the records of one machine.

    Attributes
    ----------
    verdict : str
    causes : list of Cause
    final : Solution
    gain : Gain
    unexplained : Unexplained
    remaining : Remaining
    references : dict of str to float
        Gain of log-likelihood of the answer over each reference.
    varies : dict
    messages : list of str
    scores : dict of str to float
    rivals : dict of str to dict of str to FrictionAxis
    free : tuple of str
        Free parameters of the causes.
    """

    verdict: str
    causes: list[Cause]
    final: Solution
    gain: Gain
    unexplained: Unexplained
    remaining: Remaining
    references: dict[str, float]
    messages: list[str]
    scores: dict[str, float]
    rivals: dict[str, dict[str, FrictionAxis]]
    free: tuple[str, ...] = ()
    varies: dict[str, dict[str, list[float]]] = field(default_factory=dict)


def answer(
    search: Search,
    cut: Callable[[float], Sequence[Windows]],
    gate: Callable[[float], Gate] | None = None,
) -> Answer | None:
    """Search for causes by likelihood and describe them; None if free runs decide instead.

    `cut` and `gate` return the windows and the gate of the records with their inputs
    delayed by some seconds.
    """

    def ends(state: State, candidates: Sequence[Candidate]) -> bool:
        # Free runs are uninformative about an imposed motion.
        judged = gate is not None and not search.imposed
        return judged and gate(search.shift).opens(state, candidates)  # type: ignore[misc]

    def nothing_left(fit: Solution) -> bool:
        return not _judge(search)(search, cut(search.shift), search.as_recorded(fit))[1].significant

    search.nothing_left = nothing_left
    state = forward(search, end=ends)
    if state is None:
        return None
    messages: list[str] = []
    until, search.until = search.until, search.end
    references = search.references()
    while True:
        refuted = {*state.refuted}
        final, kept, judged = _confirmed(search, state)
        # In the place of a cause that unseen data do not confirm, another may be.
        if state.late or state.refuted == refuted or not resumed(search, state, until):
            break
    if state.late:
        messages.append(LATE)
    while True:
        search.tell("replays")
        windows = cut(search.shift)
        heard = search.as_recorded(final)
        motion, left, worse = _judge(search)(search, windows, heard)
        # Where structure is left, a cause that hardly lowers the random force may be false.
        quiet = [c for c in state.causes if left.significant and judged[c].louder < _LOUDER]
        if not quiet or search.late:
            break
        fallen = min(quiet, key=lambda c: judged[c].louder)
        state.drop(fallen, without(search, state, fallen))
        final, kept, judged = _confirmed(search, state)
    better = [name for name, cost in references.items() if cost < final.cost]
    if worse:
        better.append("free runs of the nominal axis")
    if better and (state.causes or kept):
        messages.append(f"not better than {' and '.join(better)}: no causes are reported")
        state.causes.clear()
        state.free.clear()
        kept, final = [], search.reference(search.believed)
        heard = search.as_recorded(final)
        motion, left, _ = _judge(search)(search, windows, heard)
    if references.get(STRAIGHT, math.inf) < final.cost:
        messages.append(LINE)
    left = _in_all(motion, left, messages)
    causes = [_cause(search, state, final, slug, judged[slug]) for slug in state.causes]
    causes += _or_a_gain(
        search, state, final, _wrong_base(search, final, kept, heard.random_force())
    )
    messages += _warnings(final, causes)
    if search.imposed:
        messages.append(IMPOSED)
        if search.steady and "viscous" not in search.known:
            messages.append(ONE_VELOCITY)
    unit = search.believed.units[1]
    if search.width > 0.0:
        messages.append(f"noise of {search.input_noise:.2g} {unit} RMS was recorded with the input "
                        "and does not act on the axis: it was taken off")  # fmt: skip
    scores = {slug: -2.0 * gain / search.samples for slug, gain in state.first.items()}
    return Answer(
        _verdict(causes, left, messages), causes, final, motion, left,
        remaining(heard, left.significant, left.where, unit),
        {name: cost - final.cost for name, cost in references.items()},
        messages, scores | {"": 0.0}, state.rivals, state.names,
    )  # fmt: skip


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
    kept = [n for n in every if 0.5 * sure[n] ** 2 > least]
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
    if search.part == 1.0:
        return full, kept
    every_sample: dict[str, Any] = {"base": kept, "wonder": False, "runs": search.runs}
    whole = search.fit(full.axis, names, full.z[len(full.problem.names) :], **every_sample)
    return search.anew(whole, **every_sample), kept


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


def _confirmed(search: Search, state: State) -> tuple[Solution, list[str], dict[str, Judged]]:
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
        for slug in state.causes:
            search.tell(f"{slug} confirmed")
            if search.late:
                judged[slug] = Judged(True, HeldOut(0.0, 0.0, 0.0))
            else:
                judged[slug] = _judged(search, state, final, slug)
        weakest = _weakest(search, state, judged)
        if weakest:
            if judged[weakest].louder > _MISSED:
                state.refuted.add(weakest)
            state.drop(weakest, without(search, state, weakest))
        elif _gain_is_choice(search, state, final, kept, judged):
            state.drop(GAIN, without(search, state, GAIN))
        else:
            return final, kept, judged


def _weakest(search: Search, state: State, judged: dict[str, Judged]) -> str | None:
    """The cause to drop if held-out data leave any open; None if they confirm all.

    Not simply the first one left open: two causes that share an effect weaken each other, and
    the one with less evidence has to go.
    """
    # The first of two effects of a kind stays as long as the second does.
    single = [s for s in state.causes if holds(search.believed, s) or not followed(s, state.causes)]
    if all(judged[s].sure for s in single):
        return None
    weak = [s for s in single if not judged[s].sure or judged[s].by_size_alone]
    return min(weak, key=lambda s: judged[s].held_out.strength)


def _left_open(search: Search) -> bool:
    return left_open(search.believed, {*search.known, *search.tolerance})


def _gain_is_choice(
    search: Search, state: State, final: Solution, kept: Sequence[str], judged: dict[str, Judged]
) -> bool:
    """Whether an input gain leaves base parameters far off that alone are equivalent to it."""
    if GAIN not in state.causes or not _left_open(search):
        return False
    alike = {*judged[GAIN].others.split("+")} == {*every(search.believed)}
    return alike and far_off(final.values(), search.nominal, kept)


def _judged(search: Search, state: State, final: Solution, slug: str) -> Judged:
    """Evidence for one cause: its gain over the best fit without it, all else free."""
    names = names_without(search, final, slug, state.free[slug])
    noises = final.z[len(final.problem.names) :]
    kept = [n for n in search.base if n in final.problem.names]
    rest = search.less(final.axis, slug)
    few: dict[str, Any] = {"wonder": False}
    free = search.free_of(final)
    with_all = search.fit(final.axis, free, noises, 6, **few)
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
            others = _moved(search, final, less)
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


def _moved(search: Search, final: Solution, less: Solution) -> str:
    """Parameters that together are equivalent to a cause, joined by "+"."""
    before, after = final.values(), less.values()
    slugs: list[str] = []
    for name, value in after.items():
        now = before.get(name, search.nominal.get(name, 0.0))
        size = max(abs(now), abs(value))
        if size > 0.0 and abs(value - now) > MOVED * size:
            slugs.append(SLUGS.get(name, name.partition(".")[0]))
    return "+".join(dict.fromkeys(slugs))


def _cause(
    search: Search,
    state: State,
    final: Solution,
    slug: str,
    judged: Judged,
) -> Cause:
    units = {p.name: p.unit for p in final.problem.parameters}
    own = {n.partition(".")[2]: n for n in state.free[slug]}
    found, others = judged.held_out, judged.others
    size = 2.0 / search.whole
    alike = state.alternatives.get(slug, ())
    return cause_of(
        search.believed, slug, own, final.values(), final.standard_errors(), units,
        (size * found.gain, size * found.error), (*alike, others) if others else alike,
    )  # fmt: skip


def _wrong_base(search: Search, final: Solution, kept: Sequence[str], random: float) -> list[Cause]:
    """Base parameters with a notable and significant error, as causes.

    `random`: the remaining random force.
    """
    values, errors = final.values(), final.standard_errors()
    units = {p.name: p.unit for p in final.problem.parameters}
    found = []
    sizes = _sizes(search)
    for name in kept:
        nominal = search.nominal[name]
        if nominal > 0.0 and abs(values[name] / nominal - 1.0) <= _RIGHT:
            continue
        if abs(values[name] - nominal) < CLEAR * errors[name]:
            continue
        if abs(values[name] - nominal) * sizes[name] < _NOTABLE * random:
            continue
        # Quadratic for a small change; logarithmic for a large one, as without it the random
        # force would grow.
        wald = ((values[name] - nominal) / max(errors[name], 1e-300)) ** 2
        gain = math.log1p(wald / search.whole)
        error = 2.0 * math.sqrt(wald) / (search.whole + wald)
        cause = cause_of(
            search.believed, SLUGS[name], {name: name}, values, errors, units, (gain, error)
        )
        found.append((gain, cause))
    return [cause for _, cause in sorted(found, key=lambda one: -one[0])]


def _or_a_gain(search: Search, state: State, final: Solution, wrong: list[Cause]) -> list[Cause]:
    """Wrong base parameters, with the equivalent gain as alternative if all are wrong.

    Load-dependent friction is equivalent too, if the drive never brakes.
    """
    if not _left_open(search) or GAIN in state.causes:
        return wrong

    def scales(cause: Cause) -> tuple[str, ...]:
        alike = _load_does_the_same(search, state, final, *cause.parameters)
        return (GAIN, _LOAD) if alike else (GAIN,)

    return or_a_gain(search.believed, wrong, scales)


def _load_does_the_same(search: Search, state: State, final: Solution, held: str) -> bool:
    """Whether load-dependent friction, with base parameter `held` at nominal, fits as well."""
    values = final.values()
    scale = search.nominal[held] / values[held]
    if class_of(_LOAD) is None or _LOAD in state.causes or scale >= 1.0 or search.late:
        return False
    base = [n for n in search.base if n != held]
    axis = with_values(final.axis, [*base, held], [scale * values[n] for n in (*base, held)])
    start = with_effect(axis, _LOAD, {"coefficient": 1.0 - scale})
    noises = final.z[len(final.problem.names) :]
    runs, free = final.problem.runs, (*state.names, *start.free)
    fit = search.fit(start.axis, free, noises, _LOAD_TURNS, runs=runs, base=base)
    costs = [one.cost - one.problem.prior(one.z) for one in (fit, final)]
    return costs[0] < costs[1] + EQUAL


def _sizes(search: Search) -> dict[str, float]:
    """RMS force per unit of each base parameter."""
    smooth = [r.derivatives() for r in search.records]
    v = np.concatenate([one.v for one in smooth])
    a = np.concatenate([one.a for one in smooth])
    return {
        "mass": float(np.sqrt(np.mean(a**2))), "viscous": float(np.sqrt(np.mean(v**2))),
        "coulomb": 1.0,
    }  # fmt: skip


def _warnings(final: Solution, causes: Sequence[Cause]) -> list[str]:
    messages = []
    for name in final.at_bound:
        messages.append(f"{name} ended at a bound: the model does not fit, or the records do not "
                        "determine it")  # fmt: skip
    if not final.converged:
        messages.append(UNFINISHED)
    return [*messages, *hardly_determined(causes)]


def _gain(squares: Sequence[FloatArray], unit: str) -> Gain:
    """Error reduction from mean squares before, after and of the floor, shape (nblocks,)."""
    before, after, _ = squares
    picks = np.random.default_rng(0).integers(0, before.size, size=(1000, before.size))
    ratios = np.sqrt(before[picks].sum(axis=1) / np.maximum(after[picks].sum(axis=1), 1e-300))
    low, high = np.quantile(ratios, [0.05, 0.95])
    first, last, floor = (float(np.sqrt(row.mean())) for row in squares)
    return Gain(first, last, floor, (float(low), float(high)), unit)


def _motion(
    search: Search, windows: Sequence[Windows], final: Solution
) -> tuple[Gain, Unexplained, bool]:
    """Errors of free runs, compared with replays in which the random force acts.

    Returned last: whether, by median or RMS, the errors exceed both those of the nominal
    axis and those that the random force causes.
    """
    squares: list[list[FloatArray]] = [[], []]
    replays: list[FloatArray] = []
    structured, places = False, list[str]()
    for i, w in enumerate(windows):
        axis = final.problem.axis_at(final.z, i)
        active = np.zeros(len(w), bool)
        moving = np.flatnonzero(w.moving)
        if moving.size > _REPLAYED:
            moving = moving[np.linspace(0, moving.size - 1, _REPLAYED).astype(int)]
        active[moving] = True
        if not moving.size:
            continue
        before = w.evaluate(search.believed, active)
        at = w.evaluate(axis, active)
        floor: Floor = noise_floor(
            w, axis, [axis] * _REPLAYS, at, active, force=final.random_force(i)
        )
        for row, one in zip(squares, (before, at), strict=True):
            row.append(w.mean_squares(one.errors)[active])
        replays.append(floor.squares[:, active])
        scores = w.scores(at.costs)
        if not _as_replayed(floor, scores, active):
            structured = True
            here = where(
                np.where(active, scores, np.nan), float(floor.worst[active].max()), w,
                search.believed.units,
            )  # fmt: skip
            which = f" in record {i + 1}" if len(windows) > 1 else ""
            places += [f"{t}{which}" for t in here]
    usual = [one.mean(axis=0) for one in replays]
    rows = [np.concatenate(r) if r else np.ones(1) for r in (*squares, usual)]
    gain = _gain(rows, search.believed.units[0])
    if replays:
        gain = replace(gain, floor=usual_rms(replays))
        structured = structured or far_above(squares[1], replays)
    left_over = Unexplained(gain.left if structured else 0.0, structured, tuple(places[:3]))
    medians = [math.sqrt(float(np.median(row))) for row in rows]
    worse = any(
        there > max(_WORSE * nominal, noise)
        for nominal, there, noise in (medians, (gain.before, gain.after, gain.floor))
    )
    return gain, left_over, worse


def _needed(
    search: Search, windows: Sequence[Windows], final: Solution
) -> tuple[Gain, Unexplained, bool]:
    """Counterpart of `_motion` for an imposed motion: required force less drive.

    The floor is the part of it that changes from sample to sample.
    """
    nominal = search.reference(search.believed)
    blocks: list[list[float]] = [[], [], []]
    for run, before, after in zip(
        final.problem.runs, nominal.point.out, final.point.out, strict=True
    ):
        noise = np.diff(after[0], prepend=after[0, :1]) / math.sqrt(2.0)
        together = run.active & np.roll(run.active, 1)
        for row, one, where_ in zip(
            blocks, (before[0], after[0], noise), (run.active, run.active, together), strict=True
        ):
            for a, b in itertools.pairwise(run.edges):
                if run.active[a:b].any():
                    row.append(float(np.sum(one[a:b] ** 2 * where_[a:b]) / run.active[a:b].sum()))
    gain = _gain([np.array(row) for row in blocks], search.believed.units[1])
    structured = gain.after > _SMOOTH * gain.floor
    return gain, Unexplained(gain.left if structured else 0.0, structured, ()), False


def _judge(search: Search) -> Callable[..., tuple[Gain, Unexplained, bool]]:
    """The function that measures what a fit explains and what it leaves."""
    return _needed if search.imposed else _motion


def _as_replayed(floor: Floor, scores: FloatArray, active: BoolArray) -> bool:
    """Whether the errors of free runs are those of replays with the random force."""
    out = floor.outliers(scores, active)
    if out.sum() > max(2, _STRAY * active.sum()):
        return False
    excess, spread = floor.excess(scores, active & ~out)
    return bool(excess < max(_EXCESS, 4.0 * spread))


def _apart(less: Solution, more: Solution) -> bool:
    """Whether the record-specific parameters of two fits can be separated.

    The new parameter of `more` must not blur the standard errors of the earlier ones, and
    its own must be smaller than its spread over the records.
    """
    before, after = less.standard_errors(), more.standard_errors()
    values = more.values()
    new = [n for n in after if "@" in n and n not in before]
    differ = max(values[n] for n in new) - min(values[n] for n in new)
    return all(after[n] < _BLURRED * before[n] for n in before if "@" in n) and all(
        after[n] < differ for n in new
    )


def _in_all(motion: Gain, left: Unexplained, messages: Sequence[str]) -> Unexplained:
    """What is left; significant too if a straight line is better."""
    return replace(left, fraction=motion.left, significant=True) if LINE in messages else left


def _verdict(found: Sequence[Any], left: Unexplained, messages: Sequence[str]) -> str:
    """The verdict from what was found, what is left and the messages about the last fit."""
    if not found:
        return "unexplained" if left.significant else "nothing to find"
    doubtful = any("bound" in m or m == UNFINISHED for m in messages)
    return "partly explained" if left.significant or doubtful else "explained"


def apart(search: Search, found: Answer, windows: Sequence[Windows]) -> None:
    """Add parameters that differ between records, and judge each record with its values."""
    found.varies, own = varying(search, found.final)
    if own is found.final:
        return
    heard = search.as_recorded(own)
    found.gain, left, _ = _judge(search)(search, windows, heard)
    found.unexplained = left = _in_all(found.gain, left, found.messages)
    found.remaining = remaining(heard, left.significant, left.where, search.believed.units[1])
    found.verdict = _verdict([*found.causes, *found.varies], left, found.messages)


def varying(search: Search, final: Solution) -> tuple[dict[str, dict[str, list[float]]], Solution]:
    """Parameters that differ between records, with standard errors, and the fit with them."""
    if len(search.runs) < 2:
        return {}, final
    names, free = list(final.problem.names), search.free_of(final)
    base = [n for n in BASE if n not in search.known and n not in free]
    noises = final.z[len(names) :]
    own = list(search.own)
    now = final
    while not search.late:
        best = None
        for name in dict.fromkeys([*base, *free]):
            if name in own:
                continue
            search.own = (*own, name)
            settings: dict[str, Any] = {
                "base": [n for n in base if n in names or n in search.own],
                "wonder": False, "runs": search.runs,
            }  # fmt: skip
            # Most parameters do not differ; a few iterations show it.
            some = search.fit(final.axis, free, noises, _OWN_TURNS, **settings)
            hoped = now.cost - some.cost + _OWN_AHEAD * some.promised
            if search.worth(hoped, len(search.runs) - 1) < 0.0:
                continue
            one = search.fit(final.axis, free, noises, **settings)
            gain = search.worth(now.cost - one.cost, len(search.runs) - 1)
            if not _apart(now, one):
                continue
            if best is None or gain > best[0]:
                best = (gain, name, one)
        if best is None or best[0] < 0.0:
            break
        own.append(best[1])
        now = best[2]
    search.own = tuple(own)
    values, errors = now.values(), now.standard_errors()
    count = range(len(search.runs))
    return {
        n: {
            "values": [values[f"{n}@{i}"] for i in count],
            "standard_errors": [errors[f"{n}@{i}"] for i in count],
        }
        for n in own
    }, now
