"""Diagnosis where a random force acts: by the likelihood of both noises."""

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
from dryfric_control.diagnosis.evidence import where
from dryfric_control.diagnosis.forward_search import State, forward, names_without, without
from dryfric_control.diagnosis.gain_or_base import GAIN, every, far_off, left_open, or_a_gain
from dryfric_control.diagnosis.held_out import CLEAR, LEAST, HeldOut
from dryfric_control.diagnosis.likelihood_fits import hard
from dryfric_control.diagnosis.likelihood_search import EQUAL, MOVED, STRAIGHT, Search
from dryfric_control.diagnosis.noise_floor import Floor, noise_floor, usual_rms
from dryfric_control.diagnosis.remaining import Remaining, remaining
from dryfric_control.diagnosis.report.findings import LATE, Cause, Gain, Unexplained
from dryfric_control.diagnosis.screening import Candidate
from dryfric_control.estimation.likelihood import BASE
from dryfric_control.estimation.parameters import typical, with_values
from dryfric_control.estimation.solution import Solution
from dryfric_control.estimation.windows import Windows
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.model.effects.naming import class_of, followed
from dryfric_control.text import length_text

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

# Windows by which it is seen whether free runs reach the noise of the readings.
_GATE_FIT, _GATE_JUDGE = 8, 4
# Causes that are tried together there, and how many of the likeliest candidates.
_TOGETHER, _LIKELY = 2, 6
# Part of the score that the first of two causes must leave at most.
_HELPS = 0.95
# Windows of each record that are replayed, and how often: one that breaks away now and then
# must have done so in a replay too.
_REPLAYED, _REPLAYS = 40, 20
# A base parameter off by less than this is what anybody would call right.
_RIGHT = 0.004
# Part of the random force that a wrong base parameter must make to be named.
_NOTABLE = 0.25
# What a cause must take off the random force, as a factor, where structure is left; and what
# no false one takes off: then unseen data may gain on the whole, in however few blocks.
_LOUDER, _MUCH_LOUDER, _ON_THE_WHOLE = 1.1, 2.0, 1.5
# Errors of free runs, over those of the nominal axis, with which no cause is shown.
_WORSE = 1.1
# Part of the windows that may err more than all their replays, and mean score above the
# replays that is none.
_STRAY, _EXCESS = 0.1, 0.2
# Standard errors of what each record has of its own over those without one parameter more,
# beyond which the two are not told apart.
_BLURRED = 2.0
# Turns of a fit with one parameter of each record's own, and what may lie ahead of it, over what
# its last step promised, where a gain may come of it.
_OWN_TURNS, _OWN_AHEAD = 3, 3.0
# RMS of the force left over that of its changes from sample to sample beyond which it has
# structure.
_SMOOTH = 1.5
# The effect that scales every force of the drive that never brakes, and turns of a fit with it.
_LOAD, _LOAD_TURNS = "load_dependence", 10
# What is said of a fit that did not end, where a line is the better model, and where the force
# decides.
UNFINISHED = "the last fit had not converged"
LINE = (
    "a straight line predicts the readings better than the model does: the drive and the friction "
    "of the model are not those of this motion; look first whether units, factors and signs of "
    "input and position are right"
)
IMPOSED = (
    "something other than the drive makes the motion, such as a bench or a tight loop: it tells "
    "nothing of the forces, and the drive was held against the force that the motion needs"
)
ONE_VELOCITY = (
    "each direction has nearly one velocity: what depends on it cannot be separated from the "
    "Coulomb level, was not tried, and viscous friction is the nominal one"
)


@dataclass(eq=False)
class Gate:
    """Whether some hypothesis reaches the readings' noise in free runs.

    Then no random force is at work, and free runs are the sharpest judge.

    Parameters
    ----------
    windows : Windows
    axis : FrictionAxis
    fit, judge : ndarray of bool
        Windows that free runs are fitted to and judged by.
    settings : dict
        Those of `Race`.

    Attributes
    ----------
    hints : list of FrictionAxis
        What the likelihood has made of the candidates it was asked about.
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
        """Whether an axis with its base and further parameters free reaches it."""
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
        """Whether the axis with its causes and one candidate more reaches it."""
        if len(state.causes) >= _TOGETHER:
            return False
        self.hints += [c.axis for c in candidates]
        likely = list(candidates[:_LIKELY])
        # Slopes tell little of effects with states of their own: they may lie behind.
        likely += [c for c in candidates[_LIKELY:] if hard(c.slug)]
        return any(self.at(c.axis, (*state.names, *c.free)) for c in likely)

    def opens_wide(self) -> bool:
        """Whether one or two of all effects reach it, where the likelihood has left something."""
        base = self.race.alone(self.axis, ())
        for _ in range(_TOGETHER):
            runners = self._beside(base)
            if self.race.late:
                return False
            if any(map(self._reached, runners)):
                return True
            best = min(runners, key=lambda r: r.scores[self.seen].mean(), default=base)
            # One of several causes helps a good deal; against a random force nothing does.
            if best.scores[self.seen].mean() > _HELPS * base.scores[self.seen].mean():
                return False
            base = best
        return False


@dataclass(eq=False)
class Answer:
    """What the likelihood says about the records of one machine.

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
    """Search for causes, and everything that is said about them; None where the gate opens.

    `cut` and `gate`: the windows and the gate of the records with their inputs acting
    some seconds later than recorded.
    """

    def ends(state: State, candidates: Sequence[Candidate]) -> bool:
        # Free runs say nothing of a motion that something else makes.
        judged = gate is not None and not search.imposed
        return judged and gate(search.shift).opens(state, candidates)  # type: ignore[misc]

    state = forward(search, end=ends)
    if state is None:
        return None
    messages: list[str] = []
    search.until = search.end
    if state.late:
        messages.append(LATE)
    references = search.references()
    while True:
        final, kept, judged = _confirmed(search, state)
        search.tell("replays")
        windows = cut(search.shift)
        heard = search.as_recorded(final)
        motion, left, worse = _judge(search)(search, windows, heard)
        # Structure that is left may follow a cause that is not there.
        quiet = [c for c in state.causes if left.significant and judged[c].louder < _LOUDER]
        if not quiet or search.late:
            break
        fallen = min(quiet, key=lambda c: judged[c].louder)
        state.drop(fallen, without(search, state, fallen))
    better = [name for name, cost in references.items() if cost < final.cost]
    if worse:
        better.append("free runs of the nominal axis")
    if better and (state.causes or kept):
        messages.append(f"not better than {' and '.join(better)}: the causes found are not shown")
        state.causes.clear()
        state.free.clear()
        kept, final = [], search.reference(search.believed)
        heard = search.as_recorded(final)
        motion, left, _ = _judge(search)(search, windows, heard)
    if references.get(STRAIGHT, math.inf) < final.cost:
        messages.append(LINE)
    left = _in_all(search, motion, left, messages)
    causes = [_cause(search, state, final, slug, judged[slug]) for slug in state.causes]
    causes += _or_a_gain(
        search, state, final, _wrong_base(search, final, kept, heard.random_force())
    )
    messages += _warnings(final, causes)
    if search.imposed:
        messages.append(IMPOSED)
        if search.steady and "viscous" not in search.known:
            messages.append(ONE_VELOCITY)
    elif search.smooth > 1:
        over = length_text(search.smooth * search.scales.step, "s")
        messages.append(f"noise was recorded with the input: it was smoothed over {over}")
    unit = search.believed.units[1]
    scores = {slug: -2.0 * gain / search.samples for slug, gain in state.first.items()}
    return Answer(
        _verdict(causes, left, messages), causes, final, motion, left,
        remaining(heard, left.significant, left.where, unit),
        {name: cost - final.cost for name, cost in references.items()},
        messages, scores | {"": 0.0}, state.rivals, state.names,
    )  # fmt: skip


def _base(search: Search, state: State) -> tuple[Solution, list[str]]:
    """The fit with no more base parameters off than the records ask for."""
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
    """What the records say about one cause.

    Attributes
    ----------
    sure : bool
        Whether unseen data confirm it.
    held_out : HeldOut
        What it gains there.
    others : str
        Parameters that only together do the same, joined by "+".
    louder : float
        Random force without it over that with it.
    """

    sure: bool
    held_out: HeldOut
    others: str = ""
    louder: float = math.inf


def _confirmed(search: Search, state: State) -> tuple[Solution, list[str], dict[str, Judged]]:
    """The fit with the causes that unseen data confirm, and what they say about each."""
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
                continue
            judged[slug] = _judged(search, state, final, slug)
            # A second of its kind is none without the first.
            second = followed(slug, state.causes) and not holds(search.believed, slug)
            if not judged[slug].sure and not second:
                state.drop(slug, without(search, state, slug))
                break
        else:
            if not _gain_is_choice(search, state, final, kept, judged):
                return final, kept, judged
            state.drop(GAIN, without(search, state, GAIN))


def _left_open(search: Search) -> bool:
    return left_open(search.believed, {*search.known, *search.tolerance})


def _gain_is_choice(
    search: Search, state: State, final: Solution, kept: Sequence[str], judged: dict[str, Judged]
) -> bool:
    """Whether a gain is found that leaves base parameters far off, while they do the same."""
    if GAIN not in state.causes or not _left_open(search):
        return False
    alike = {*judged[GAIN].others.split("+")} == {*every(search.believed)}
    return alike and far_off(final.values(), search.nominal, kept)


def _judged(search: Search, state: State, final: Solution, slug: str) -> Judged:
    """One cause taken out, everything else free: what it gains over the best of that."""
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
    """Whether unseen data confirm a cause without which the random force is so much louder.

    Of a short record a half tells the parameters of several causes badly.
    """
    much = louder > _MUCH_LOUDER and found.gain > _ON_THE_WHOLE * found.error
    return found.sure or (much and found.gain > LEAST)


def _louder(less: Solution, fit: Solution) -> float:
    """Random force of one fit over that of another, in the record where it differs most."""
    count = range(len(fit.problem.runs))
    return max(less.random_force(i) / fit.random_force(i) for i in count)


def _moved(search: Search, final: Solution, less: Solution) -> str:
    """Parameters that together do what a cause does, joined by "+"."""
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
    """Base parameters that are off by more than anybody would call right.

    `random`: the random force that is left.
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
        # A parabola in the change, but logarithmic where the random force would grow with it.
        wald = ((values[name] - nominal) / max(errors[name], 1e-300)) ** 2
        gain = math.log1p(wald / search.whole)
        error = 2.0 * math.sqrt(wald) / (search.whole + wald)
        cause = cause_of(
            search.believed, SLUGS[name], {name: name}, values, errors, units, (gain, error)
        )
        found.append((gain, cause))
    return [cause for _, cause in sorted(found, key=lambda one: -one[0])]


def _or_a_gain(search: Search, state: State, final: Solution, wrong: list[Cause]) -> list[Cause]:
    """Wrong base parameters with what does the very same where all of them are wrong.

    Friction that grows with the load is a gain to a drive that never brakes.
    """
    if not _left_open(search) or GAIN in state.causes:
        return wrong

    def scales(cause: Cause) -> tuple[str, ...]:
        alike = _load_does_the_same(search, state, final, *cause.parameters)
        return (GAIN, _LOAD) if alike else (GAIN,)

    return or_a_gain(search.believed, wrong, scales)


def _load_does_the_same(search: Search, state: State, final: Solution, held: str) -> bool:
    """Whether load-dependent friction fits as well, one base parameter as believed."""
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
    """RMS of the force that base parameters of 1 make while the axis moves."""
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
    """Gain from mean squares before, after and of the floor, each shape (nblocks,)."""
    before, after, _ = squares
    picks = np.random.default_rng(0).integers(0, before.size, size=(1000, before.size))
    ratios = np.sqrt(before[picks].sum(axis=1) / np.maximum(after[picks].sum(axis=1), 1e-300))
    low, high = np.quantile(ratios, [0.05, 0.95])
    first, last, floor = (float(np.sqrt(row.mean())) for row in squares)
    return Gain(first, last, floor, (float(low), float(high)), unit)


def _motion(
    search: Search, windows: Sequence[Windows], final: Solution
) -> tuple[Gain, Unexplained, bool]:
    """Errors of free runs, beside replays in which the random force acts.

    Last, whether by their median or their RMS they are larger than those of the nominal axis,
    and than the random force makes them.
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
    """`_motion` where the motion is imposed: the force that it needs beside the drive.

    The floor is what changes from one sample to the next.
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
    """What says how much a fit explains and how much it leaves."""
    return _needed if search.imposed else _motion


def _as_replayed(floor: Floor, scores: FloatArray, active: BoolArray) -> bool:
    """Whether free runs err as much as those of replays with the random force."""
    out = floor.outliers(scores, active)
    if out.sum() > max(2, _STRAY * active.sum()):
        return False
    excess, spread = floor.excess(scores, active & ~out)
    return bool(excess < max(_EXCESS, 4.0 * spread))


def _apart(less: Solution, more: Solution) -> bool:
    """Whether what each record has of its own is told as well beside one parameter more.

    And whether no record tells that parameter worse than the records differ.
    """
    before, after = less.standard_errors(), more.standard_errors()
    values = more.values()
    new = [n for n in after if "@" in n and n not in before]
    differ = max(values[n] for n in new) - min(values[n] for n in new)
    return all(after[n] < _BLURRED * before[n] for n in before if "@" in n) and all(
        after[n] < differ for n in new
    )


def _in_all(
    search: Search, motion: Gain, left: Unexplained, messages: Sequence[str]
) -> Unexplained:
    """What is left of free runs, and of what else says that something is."""
    if LINE in messages or (not search.imposed and motion.beyond):
        return replace(left, fraction=motion.left, significant=True)
    return left


def _verdict(found: Sequence[Any], left: Unexplained, messages: Sequence[str]) -> str:
    """The verdict, with what was found, what is left, and what is said of the last fit."""
    if not found:
        return "unexplained" if left.significant else "nothing to find"
    doubtful = any("bound" in m or m == UNFINISHED for m in messages)
    return "partly explained" if left.significant or doubtful else "explained"


def apart(search: Search, found: Answer, windows: Sequence[Windows]) -> None:
    """Add what differs from record to record, and judge each record with its own values."""
    found.varies, own = varying(search, found.final)
    if own is found.final:
        return
    heard = search.as_recorded(own)
    found.gain, left, _ = _judge(search)(search, windows, heard)
    found.unexplained = left = _in_all(search, found.gain, left, found.messages)
    found.remaining = remaining(heard, left.significant, left.where, search.believed.units[1])
    found.verdict = _verdict([*found.causes, *found.varies], left, found.messages)


def varying(search: Search, final: Solution) -> tuple[dict[str, dict[str, list[float]]], Solution]:
    """Parameters that differ from record to record: values and standard errors; their fit."""
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
            # Most parameters do not differ, which a few turns show.
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
