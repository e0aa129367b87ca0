"""Search for causes: screen all effects at once, fit the promising ones, let evidence decide."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dryfric_control.diagnosis.candidates import (
    Start,
    catalogue,
    effect_class,
    forms,
    holds,
    with_effect,
    with_held,
)
from dryfric_control.diagnosis.criterion import cost_of, evidence, nominal_error_costs, odds_of
from dryfric_control.diagnosis.force_view import ForceView
from dryfric_control.diagnosis.gram import REVERSAL, Gram, Proposal
from dryfric_control.diagnosis.invariants import in_free_runs, rejection_reason
from dryfric_control.diagnosis.looks import FittedProposal, ProposalFits, fit_beside
from dryfric_control.diagnosis.model_view import ModelView
from dryfric_control.diagnosis.problem import Problem, each_of, noises_of
from dryfric_control.diagnosis.thresholds import (
    EQUAL_EVIDENCE,
    FIT_SLACK,
    MAX_CAUSES,
    MAX_EXCHANGED_CAUSES,
    MAX_SINGLE_PROPOSALS,
    MAX_UNEXPLAINED_FRACTION,
    MIN_BASE_CHANGE,
    MIN_EVIDENCE,
    MIN_SCORE_FALL,
    MIN_SCORE_FALL_ERRORS,
    REMAINING_GAIN_RATIO,
    STRONG_EVIDENCE,
    STRONG_EVIDENCE_FRACTION,
)
from dryfric_control.estimation.parameters import values_of, with_values
from dryfric_control.estimation.scoring import (
    COMPARISON_ITERATIONS,
    FIRST_ITERATIONS,
    force_continuation,
    maximise,
)
from dryfric_control.estimation.solution import Solution
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.model.effects.effect import Effect
from dryfric_control.model.effects.naming import named, put
from dryfric_control.records.motion import least_motion

FloatArray = NDArray[np.float64]
#: The effects that are a delay and a limit of the drive.
DELAY = "input_delay"
LIMIT = "saturation"
#: The effect that makes the level of a breakaway higher than that of sliding.
PEAK = "stribeck"
#: What gives the filter other states, with which it follows the readings more closely: its
#: likelihood counts that for the cause, so free runs must show it.
_OTHER_STATES = ("contact", "transmission")
# Least excess from which the fit of a peak begins.
_LEAST_PEAK = 0.1
# Largest ratio of the squared force that an effect leaves to that which a cause leaves in its place
# with which it may do the same.
_MAX_SQUARES_RATIO = 1.5
# Largest ratio of the squared force that is left beside a late drive to that without it.
_MAX_LATE_SQUARES_RATIO = 0.5
# Part of what a cause explains of the squared force that an effect must explain to do the same.
_MIN_EXPLAINED_FRACTION = 0.7
#: Causes, their free parameters, the random force, and whether they are instead of the base.
_Start = tuple[frozenset[str], frozenset[str], float, bool]


@dataclass(frozen=True, eq=False)
class Model:
    """A fit with its causes."""

    fit: Solution
    causes: tuple[str, ...] = ()  # in the order found
    # Of each cause beside the others: the evidence for it, and the model without it.
    worth: dict[str, float] = field(default_factory=dict)
    less: dict[str, Model] = field(default_factory=dict)

    def cause_parameters(self, name: str) -> tuple[str, ...]:
        """Free parameters of one cause."""
        names = dict.fromkeys(self.fit.problem.names)
        return tuple(n for n in names if n.startswith(f"{name}."))


@dataclass(eq=False)
class Search:
    """Rounds of the search, remembered by the causes of their model."""

    problem: Problem
    # Called with the name of each step and the causes so far.
    tell: Callable[[str, Sequence[str]], None] = lambda step, causes: None
    #: Why effects were not tried.
    not_tried: dict[str, str] = field(default_factory=dict)
    #: Logarithm of the number of shapes of each effect that were searched.
    odds: dict[str, float] = field(default_factory=dict)
    #: Gains of log-likelihood of single effects as the first cause.
    first: dict[str, float] = field(default_factory=dict)
    #: Gain of log-likelihood that is predicted of an input that acts before its time stamps.
    early: float = 0.0
    #: The best model so far.
    now: Any = None
    _rounds: dict[frozenset[str], tuple[Solution, list[FittedProposal]]] = field(
        default_factory=dict
    )
    #: Those without shapes that take passes, which another explanation spared.
    _spared_rounds: set[frozenset[str]] = field(default_factory=set)
    #: The effects that were proposed in each of them, if not all.
    _among: dict[frozenset[str], set[str]] = field(default_factory=dict)
    #: Starts with one effect in the place of a cause or two.
    _merges: dict[frozenset[str], list[Any]] = field(default_factory=dict)
    #: Sets of causes in which nothing was worth an exchange.
    kept: set[frozenset[str]] = field(default_factory=set)
    #: Effects that were fitted beside sets of causes and came to nothing.
    idle: dict[frozenset[str], set[frozenset[str]]] = field(default_factory=dict)
    #: The search with other inputs, whose decisions against effects and exchanges still hold.
    before: Search | None = None
    #: The pass of the last round.
    view: ModelView | None = None

    def fit_nominal(self) -> Solution:
        """The nominal structure with its base fitted, from the nominal values and by continuation.

        The prior has a narrow valley at the nominal values, which continuation must not see.
        """
        problem = self.problem
        axis = problem.believed
        nominal = problem.nominal
        speed = problem.scales.length / problem.scales.time
        level = nominal["coulomb"]
        # The other start: 80 % of the dry friction replaced by viscous friction.
        other = {"coulomb": 0.2 * level, "viscous": nominal["viscous"] + 0.8 * level / speed}
        other = {n: v for n, v in other.items() if n in problem.base}
        starts = [axis, with_values(axis, list(other), list(other.values()))] if other else [axis]

        def fit(start: FrictionAxis, held: bool) -> Solution:
            if held:
                return problem.fit(start, turns=FIRST_ITERATIONS)
            open_minded = problem.likelihood(start, wonder=False)
            z = force_continuation(open_minded, open_minded.start(), until=problem.until)
            return maximise(problem.likelihood(start), z, FIRST_ITERATIONS, problem.until)

        best = fit(axis, True)
        if not (problem.is_overdue or problem.is_exhausted(best)):
            rows = problem.parallel(fit, starts, [False] * len(starts))
            best = min([best, *rows], key=cost_of)
        return maximise(best.problem, best.z, COMPARISON_ITERATIONS, problem.until, again=True)

    def by_force(self) -> tuple[Model, bool]:
        """The model with all causes that the force of the motion shows, fitted.

        With its base alone where it shows none.  And whether it shows that friction builds up
        after reversals.
        """
        problem, nominal = self.problem, self.problem.nominal_fit
        axis = problem.believed
        names = tuple[str, ...]()
        free = tuple[str, ...]()
        gram = self._by_force(problem.fit(axis, (), noises_of(nominal), 0))
        late, limit = 0.0, math.inf
        if not problem.moves_in_jumps:
            late, limit = ForceView(problem, axis).late_drive()
        for name, values in ((DELAY, {"delay": late}), (LIMIT, {"limit": limit})):
            if all(0.0 < v < math.inf for v in values.values()) and name in gram.names:
                start = with_effect(axis, name, values)
                axis = start.axis
                names = (*names, name)
                free = (*free, *start.free)
        if names:
            beside = self._by_force(problem.fit(axis, free, noises_of(nominal), 0), names)
            # A late drive may do what another missing force does: it must leave less.
            if beside.least_squares(MAX_CAUSES) < _MAX_LATE_SQUARES_RATIO * gram.least_squares(
                MAX_CAUSES
            ):
                gram = beside
            else:
                axis = problem.believed
                names = ()
                free = ()
        self.first = gram.single_gains | self.first
        for name, odds in gram.odds.items():
            self.odds[name] = max(odds, self.odds.get(name, 0.0))
        room = MAX_CAUSES - len(names)
        shown, builds_up = gram.forces_shown(room)
        begins = self._force_starts(gram, names, shown, builds_up)
        if any(gram.items[g].is_made_of_drive for g in shown):
            # The drive balances all forces, so what is made of it may take the place of any.
            others = gram.forces_shown(room, by_drive=False)
            begins += self._force_starts(gram, names, *others, by_drive=False)
        if not begins:
            start = Start(gram.base_alone, problem.free_of(nominal))
            return self._fit_starts([(start, ())])[0], builds_up
        level_free = problem.moves_in_jumps and "coulomb" in problem.base
        if level_free and PEAK in self._candidate_effects(Model(nominal)):
            begins += [(self._with_peak(start), (*causes, PEAK)) for start, causes in begins]
        models = self._fit_starts(begins)
        return min(models, key=lambda one: one.fit.cost), builds_up

    def _force_starts(
        self,
        gram: Gram,
        names: tuple[str, ...],
        shown: list[int],
        builds_up: bool,
        by_drive: bool = True,
    ) -> list[tuple[Start, tuple[str, ...]]]:
        """Starts with the forces that a forward selection has shown, with their causes.

        What repeats joins line by line: each bends the spectrum in which the next one shows; not
        where friction builds up after reversals, which bends it, too.
        `by_drive`: also what is made of the drive.
        """
        problem = self.problem
        while not builds_up and (line := gram.first_line(shown)) is not None:
            start, added = line
            names = (*names, *added)
            fit = problem.fit(start.axis, start.free, noises_of(problem.nominal_fit), 0)
            gram = self._by_force(fit, names)
            shown, builds_up = gram.forces_shown(MAX_CAUSES - len(names), by_drive)
        free = problem.free_of(gram.fit)
        starts = gram.starts(shown)
        begins = [(Start(one.axis, (*free, *one.free)), (*names, *one.names)) for one in starts]
        return begins or [(Start(gram.fit.axis, free), names)] * bool(names)

    def _fit_starts(self, starts: Iterable[tuple[Start, tuple[str, ...]]]) -> list[Model]:
        """Models fitted from some axes, with their causes."""

        def fit(start: Start, causes: tuple[str, ...]) -> Model:
            nominal = self.problem.nominal_fit
            return Model(fit_beside(self.problem, start.axis, start.free, nominal), causes)

        return self.problem.parallel(fit, *zip(*starts, strict=True))

    def _with_peak(self, start: Start) -> Start:
        """A start whose level at breakaway is that of a Stribeck peak, the sliding one nominal.

        The peak ends at a velocity that is too low for a reading to move between two samples.
        """
        problem = self.problem
        level = values_of(start.axis, ["coulomb"])[0] / values_of(problem.believed, ["coulomb"])[0]
        speed = min(least_motion(run.record) / run.record.dt for run in problem.runs)
        axis = with_values(start.axis, problem.base, values_of(problem.believed, problem.base))
        peak = with_effect(axis, PEAK, {"excess": max(level - 1.0, _LEAST_PEAK), "speed": speed})
        return Start(peak.axis, (*start.free, *peak.free))

    def with_any_shape(self, now: Model) -> Model | None:
        """A model with an effect whose law may have any shape, beside or in place of the causes.

        If that leaves less than half of the squared force that any effect with a law of its own
        leaves, and is likelier.
        """
        problem, nominal = self.problem, Model(self.problem.nominal_fit)
        best, most = now, math.inf
        for one in (now, nominal) if now.causes else (nominal,):
            gram = self._by_force(one.fit, one.causes, self._effects_of_any_shape())
            most = min(most, MAX_UNEXPLAINED_FRACTION**2 * gram.least_left_by_law())
            shape = gram.item_of_any_shape(most)
            for start in gram.starts([shape]) if shape is not None else ():
                free = (*problem.free_of(one.fit), *start.free)
                fit = fit_beside(problem, start.axis, free, one.fit)
                model = self.eliminate_causes(Model(fit, (*one.causes, *start.names)))
                best = model if self.net_evidence(model, best) > 0.0 else best
        return None if best is now else best

    def _effects_of_any_shape(self) -> list[str]:
        """Effects whose law may have any shape, which the nominal axis lacks."""
        axis = self.problem.believed
        return [n for n in catalogue(axis) if effect_class(n).any_shape and not holds(axis, n)]

    def _by_force(
        self, fit: Solution, causes: Sequence[str] = (), also: Sequence[str] = ()
    ) -> Gram:
        """Normal equations of the force that a model lacks; `also`: further effects."""
        names = [*self._candidate_effects(Model(fit, tuple(causes))), *also]
        if self.problem.moves_in_jumps:
            names = [name for name in names if _shows_in_balance(effect_class(name), steady=True)]
        view = ForceView(self.problem, fit.axis)
        return Gram(self.problem, fit, names, self._note_failure, view)

    def after_reversals(self, forces: Model, begin: Model) -> Model:
        """The likeliest of three: a model by forces, one effect with a memory, and both together.

        Beside friction that builds up too soon false forces seem to act, and beside those the
        contact is another one: each is found without the other first.
        """
        problem = self.problem
        if not begin.causes:
            return begin  # the search begins with an effect beside none anyway
        found = any(effect_class(n).remembers for n in begin.causes)
        if (found or len(begin.causes) == 1) and problem.is_exhausted(begin.fit):
            return begin  # these leave nothing that another would explain
        alone = Model(problem.fit(problem.believed, noises=noises_of(problem.nominal_fit)))
        some = {n for n in self._candidate_effects(alone) if effect_class(n).remembers}
        row = self._select_proposal(alone, self.round(alone, among=some) if some else ())
        if row is None:
            return begin
        contact = Model(row.fit, row.names)
        axis = row.fit.axis
        # The contact in the place of another one that was fitted with the forces.
        others = [n for n in forces.causes if not effect_class(n).remembers]
        for name, effect in named(forces.fit.axis).items():
            if name in others:
                axis = put(axis, name, effect)
        own = [n for n in problem.free_of(forces.fit) if n.partition(".")[0] in others]
        free = (*problem.free_of(row.fit), *own)
        joined = Model(fit_beside(problem, axis, free, row.fit), (*row.names, *others))
        best = begin
        for one in (contact, self.eliminate_causes(joined)):
            if len(one.causes) <= MAX_CAUSES and self.net_evidence(one, best) > 0.0:
                best = one
        return self.weigh_causes(best)

    def run(self, now: Model) -> Model:
        """Causes added, exchanged and dropped until the set stays; the likeliest set on the way."""
        seen = dict[frozenset[str], float]()
        top = now
        while not self.problem.is_overdue:
            top = now if self.net_evidence(now, top) > 0.0 else top
            self.now, key = now, frozenset(now.causes)
            # A model that is found again likelier than before is searched again.
            if now.fit.cost < seen.get(key, math.inf) - FIT_SLACK:
                seen[key] = now.fit.cost
                step = f"cause {len(now.causes) + 1}" if now.causes else "first cause"
                self.tell(step, now.causes)
                row = self.best_proposal(now)
                there = self.restart_model(now)
                if there is not None:
                    now = self.eliminate_causes(there)
                    continue
                if row is not None:
                    joined = self.weigh_causes(Model(row.fit, (*now.causes, *row.names)))
                    now = self.refit_forms(self.eliminate_causes(joined))
                    # What the force shows clearly may be hidden in free runs by another cause.
                    strong = self._strong_evidence(joined)
                    if frozenset(now.causes) == key and row.evidence > strong:
                        now = self.add_hidden_cause(joined) or now
                # Nothing joins, or what did is not there beside the others.
                if now.causes and frozenset(now.causes) == key and not self._kept_before(key):
                    self.tell("exchange", now.causes)
                    now = self.exchange_cause(now)
                    if frozenset(now.causes) == key:
                        self.kept.add(key)
                continue
            break
        return now if self.net_evidence(now, top) > -EQUAL_EVIDENCE else top

    def has_begun_at(self, nominal: Solution) -> bool:
        """Whether a search from a nominal model would be this one: the same inputs, as likely."""
        known = self._rounds.get(frozenset())
        if known is None or known[0].cost > nominal.cost + FIT_SLACK:
            return False
        runs = zip(self.problem.runs, nominal.problem.runs, strict=True)
        return all(one.u is other.u for one, other in runs)

    def _kept_before(self, key: frozenset[str]) -> bool:
        """Whether an exchange in a set of causes was decided against with other inputs."""
        return self.before is not None and key in self.before.kept

    def add_hidden_cause(self, joined: Model) -> Model | None:
        """A model with one cause more, if free runs show that, or what joined, beside each other.

        One may hide the other: the errors that one leaves alone are then all that free runs show.
        """
        alone = self.eliminate_causes(joined, free_runs=False)
        row = self.best_proposal(alone) if {*alone.causes} == {*joined.causes} else None
        if row is None:
            return None
        found = self.refit_forms(self.eliminate_causes(Model(row.fit, (*alone.causes, *row.names))))
        return found if len(found.causes) >= len(alone.causes) else None

    def refit_forms(self, now: Model) -> Model:
        """The model with what its causes have held free, or in another form, if likelier."""
        free = self.problem.free_of(now.fit)
        every = forms(now.fit.axis, now.causes)
        starts = [(one, with_held(one, now.causes, free)) for one in every]
        if starts[0][1] == (*free,):
            starts = starts[1:]
        if not starts:
            return now
        fits = self.problem.parallel(
            lambda axis, own: fit_beside(self.problem, axis, own, now.fit, FIRST_ITERATIONS),
            *zip(*starts, strict=True),
        )
        fit = min(fits, key=lambda one: one.cost - REMAINING_GAIN_RATIO * one.promised)
        if fit.cost - REMAINING_GAIN_RATIO * fit.promised < now.fit.cost:
            fit = maximise(
                fit.problem, fit.z, COMPARISON_ITERATIONS, self.problem.until, again=True
            )
        if evidence(now.fit, fit) <= 0.0:
            return now
        # What made up for the wrong form is no cause any more.
        return self.eliminate_causes(Model(fit, now.causes))

    def restart_model(self, now: Model) -> Model | None:
        """The model likelier than before, from where the likeliest fit with no cause ended.

        What is likelier with a cause at no amount is a better fit of the model itself.
        """
        rows = self.round(now) if len(now.causes) < MAX_CAUSES else []
        row = min(rows, key=lambda r: r.fit.cost, default=None)
        if row is None or not row.reason or row.fit.cost > now.fit.cost - FIT_SLACK:
            return None
        there = Model(row.fit, (*now.causes, *row.names))
        for name in reversed(row.names):
            there = self.remove_cause(there, name)
        return there if there.fit.cost < now.fit.cost - FIT_SLACK else None

    def best_proposal(self, now: Model) -> FittedProposal | None:
        """The proposal that joins; of equally good ones the one with fewest assumptions."""
        return self._select_proposal(now, self.round(now) if len(now.causes) < MAX_CAUSES else ())

    def _select_proposal(self, now: Model, rows: Sequence[FittedProposal]) -> FittedProposal | None:
        room = MAX_CAUSES - len(now.causes)
        good = [r for r in rows if r.good and len(r.names) <= room]
        # What fits no better than one with fewer parameters gains nothing over it on unseen data.
        good = [r for r in good if not any(_is_simpler(o, r) for o in good)]
        if not good:
            return None
        top = max(r.evidence for r in good)
        return min((r for r in good if r.evidence > top - EQUAL_EVIDENCE), key=_assumptions)

    def round(
        self,
        now: Model,
        other: Solution | None = None,
        among: Collection[str] = (),
        known: tuple[str, Solution] | None = None,
    ) -> list[FittedProposal]:
        """Proposals beside a model, fitted; none where nothing is left to explain.

        `other`: another explanation; `among`: the effects that are proposed, all if empty;
        `known`: an effect that was fitted beside it, and that fit.
        """
        if self.problem.is_exhausted(now.fit):
            return []
        key = frozenset(now.causes)
        if self._is_known_round(now, other is not None, among):
            return self._rounds[key][1]
        grams = self._grams(now)
        looks = ProposalFits(self.problem, now.fit, self.odds, self._note_failure)
        if known is not None:
            self.odds.setdefault(known[0], self._odds(known[0]))
            looks.begin_with(*known)
        tried = self._open(key, _filter_proposals(among, self._proposals(now, grams)))
        looks.fit(tried)
        found = [now.fit, *(r.fit for r in looks.good), *(() if other is None else (other,))]
        asked = self._memory_is_open(found, among)
        shown = asked and self._memory_shows(now, grams, looks, other)
        hidden = asked and not shown and self._memory_may_hide(now, found)
        if shown or hidden:
            for gram in grams:
                gram.simulate()
            shapes = self._open(key, _filter_proposals(among, self._proposals(now, grams)))
            looks.fit(shapes)
            tried += shapes
            self._spared_rounds.discard(key)
        elif other is not None:
            self._spared_rounds.add(key)
        self._among[key] = {*among}
        if self.view is not None:
            looks.translate(self.view)
        rows = [r for r in looks.rows if not (hidden and self._stays_muted(r))]
        good = {frozenset(r.names) for r in looks.good}
        self.idle.setdefault(key, set()).update({frozenset(p.names) for p in tried} - good)
        if not now.causes:
            single = [r for r in rows if len(r.names) == 1]
            gains = {r.names[0]: now.fit.cost - r.fit.cost for r in single}
            self.first = self.first | gains
        self._rounds[key] = now.fit, rows
        return rows

    def _stays_muted(self, row: FittedProposal) -> bool:
        """Whether a cause with a memory leaves a random force as large as the friction."""
        remembers = any(effect_class(n).remembers for n in row.names)
        return remembers and self.problem.is_muted(row.fit)

    def _is_known_round(self, now: Model, explained: bool, among: Collection[str]) -> bool:
        """Whether a round beside a model was made; where `explained`, one without memory does."""
        key = frozenset(now.causes)
        if key not in self._rounds or self._rounds[key][0].cost > now.fit.cost + FIT_SLACK:
            return False
        if self._among.get(key) and not ({*among} and {*among} <= self._among[key]):
            return False
        return explained or key not in self._spared_rounds

    def _open(self, key: frozenset[str], some: list[Proposal]) -> list[Proposal]:
        """Proposals beside a set of causes that were not decided against with other inputs."""
        idle = self.before.idle.get(key, ()) if self.before is not None else ()
        return [one for one in some if frozenset(one.names) not in idle]

    def _memory_is_open(self, found: Sequence[Solution], among: Collection[str]) -> bool:
        """Whether effects with a memory may be proposed, and no explanation leaves nothing."""
        if among and not any(effect_class(n).remembers for n in among):
            return False
        return all(self.problem.left(fit) >= MIN_EVIDENCE for fit in found)

    def _memory_shows(
        self, now: Model, grams: Sequence[Gram], looks: ProposalFits, other: Solution | None
    ) -> bool:
        """Whether the record shows that shapes with a memory, which take passes, may explain it.

        Where friction builds up after reversals, the breakaways tell of a dwell time, or single
        readings are far off; beside or in the place of another cause, the first of these only where
        it is the first thing to be seen, the last not.
        """
        last = MAX_CAUSES if other is None and not looks.good else 1
        return (
            self._after_reversal(now, grams) < last
            or any(gram.is_told for gram in grams)
            or (last > 1 and self.problem.outliers(now.fit) > STRONG_EVIDENCE)
            or self.problem.is_imposed  # where a shape takes no pass of the filter
        )

    def _memory_may_hide(self, now: Model, found: Sequence[Solution]) -> bool:
        """Whether a first cause with a memory may hide behind a random force.

        Where that is as large as the friction and mutes every explanation.  The cause ends it; one
        beside which it stays is none.
        """
        return not now.causes and all(map(self.problem.is_muted, found))

    def _after_reversal(self, now: Model, grams: Sequence[Gram]) -> int:
        """Place at which friction after reversals joins a model.

        0 if first, MAX_CAUSES if it does not join.
        """
        places = [gram.after_reversal for gram in grams if gram.fit is now.fit]
        if grams and not any(effect_class(n).remembers for n in now.causes):
            places.append(self._by_force(now.fit, now.causes).after_reversal)
        return min(places, default=MAX_CAUSES)

    def _grams(self, now: Model) -> list[Gram]:
        """Normal equations beside the model, and with its base at nominal if that has moved."""
        names = self._candidate_effects(now)
        found = list[Gram]()
        for fit in (now.fit, *self._nominal(now.fit)):
            if not self.problem.is_overdue:
                found.append(Gram(self.problem, fit, names, self._note_failure, beside=now.fit))
        if found and now.causes:
            self._merges[frozenset(now.causes)] = [*found[0].merges(now.causes)]
        return found

    def _proposals(self, now: Model, grams: Sequence[Gram]) -> list[Proposal]:
        """New starts beside the model, with its base as it is and at nominal."""
        best = dict[_Start, Proposal]()
        chosen = list[_Start]()
        self.early = 0.0
        for gram in grams:
            if self.problem.is_overdue:
                break
            count = MAX_SINGLE_PROPOSALS if gram.fit is now.fit else MAX_SINGLE_PROPOSALS // 2
            for name, odds in gram.odds.items():
                self.odds[name] = max(odds, self.odds.get(name, 0.0))
            self.early, self.view = max(self.early, gram.input_lead_gain()), gram.here
            proposals = gram.proposals()
            if not now.causes and gram.fit is now.fit:
                self.first = gram.single_gains | self.first
            for one in proposals:
                # What holds the base is wanted where that is at nominal: beside the last model.
                key = _start_of(one)
                before = best.get(key, one)
                best[key] = replace(min(one, before, key=lambda p: p.cost), held=one.held)
            # The likeliest in one pass, and those of which most is predicted beside this model.
            some = _first_effects(sorted(proposals, key=lambda p: p.cost), count)
            most = sorted(proposals, key=lambda p: -p.predicted)
            some += _first_effects(most, MAX_SINGLE_PROPOSALS // 2)
            chosen += map(_start_of, some)
        return _likeliest_shapes([best[key] for key in dict.fromkeys(chosen)])

    def _candidate_effects(self, now: Model) -> list[str]:
        """Effects that may be added to a model."""
        problem = self.problem
        found = []
        for name in catalogue(now.fit.axis, now.causes):
            effect = effect_class(name)
            if problem.is_imposed and not _shows_in_balance(effect, problem.steady, ("contact",)):
                continue  # of effects with a memory a contact alone follows from the motion
            if problem.shift is not None and effect.action in ("delay", "lag"):
                continue  # a free lead of the input is no different from a delay
            if any(f"{name}.{p}" in problem.known for p in effect.named_parameters()):
                continue
            if effect.any_shape and not holds(problem.believed, name):
                continue  # it may do what any of the others does
            found.append(name)
        return sorted(found)  # sums over columns in another order differ by round-off

    def _note_failure(self, name: str, reason: str) -> None:
        self.not_tried.setdefault(name, reason)

    def _base_differs(self, fit: Solution) -> bool:
        """Whether a base parameter is notably off its nominal value."""
        values = fit.values()
        nominal = self.problem.nominal
        names = [n for n in self.problem.base if n in values and nominal[n] != 0.0]
        ratios = (max(values[n] / nominal[n], 1e-300) for n in names)
        return any(abs(math.log(ratio)) > MIN_BASE_CHANGE for ratio in ratios)

    def _nominal(self, fit: Solution) -> list[Solution]:
        """The model with its base at nominal, its noises fitted, if that has moved notably.

        None where its effects allow no such axis: a spring that is far too stiff for the mass.
        """
        problem = self.problem
        if not self._base_differs(fit):
            return []
        names = [n for n in problem.base if n in fit.problem.names]
        axis = with_values(fit.axis, names, [problem.nominal[n] for n in names])
        noises = problem.reference(axis, noises=noises_of(fit)).z[-2 * len(problem.runs) :]
        there = problem.fit(axis, problem.free_of(fit), noises, 0, each=each_of(fit))
        return [there] if math.isfinite(there.cost) else []

    def remove_cause(self, now: Model, name: str) -> Model:
        """The model fitted without one cause; those of its kind are counted again."""
        problem = self.problem
        fit = now.fit
        axis = self._reduced_axis(fit, name)
        rest = problem.free_without(problem.free_of(fit), name)
        causes = problem.free_without(now.causes, name)
        before = self._rounds.get(frozenset(causes))
        if before is None:
            return Model(fit_beside(problem, axis, rest, fit), causes)
        # It is known: fitted again only as far as it may become likelier than it was.
        less = fit_beside(problem, axis, rest, fit, FIRST_ITERATIONS)
        if less.cost - REMAINING_GAIN_RATIO * less.promised < before[0].cost:
            less = maximise(less.problem, less.z, COMPARISON_ITERATIONS, problem.until, again=True)
        return Model(min(less, before[0], key=cost_of), causes)

    def _reduced_axis(self, fit: Solution, name: str) -> FrictionAxis:
        """The axis without a cause, the base in its place where that is likelier to begin with."""
        problem, axis = self.problem, self.problem.remove_effects(fit.axis, name)
        base = [n for n in problem.base if n in fit.problem.names]
        if self.view is None or not base:
            return axis
        values = values_of(axis, base)
        change = self.view.taken_over(named(fit.axis)[name], base)
        size = np.abs(values)
        moved = with_values(axis, base, values + np.clip(change, -0.8 * size, 4.0 * size))

        def cost(one: FrictionAxis) -> float:
            likelihood = problem.likelihood(one, each=each_of(fit))
            return likelihood.tried(likelihood.start(noises=noises_of(fit))).cost

        return min((axis, moved), key=cost)

    def weigh_causes(self, now: Model) -> Model:
        """The model with those without each cause, and the evidence for each."""
        if now.less or self.problem.is_overdue:
            return now
        lesser = self.problem.parallel(self.remove_cause, [now] * len(now.causes), now.causes)
        less = dict(zip(now.causes, lesser, strict=True))
        worth = {n: evidence(less[n].fit, now.fit, [self._odds(n)]) for n in now.causes}
        return replace(now, worth=worth, less=less)

    def eliminate_causes(self, now: Model, free_runs: bool = True) -> Model:
        """Backward elimination: causes without evidence beside the others go, worst first.

        `free_runs`: also those that free runs do not show.
        """
        now = self._remove_implausible(now)
        while (now := self.weigh_causes(now)).less:
            worth = now.worth
            less = now.less
            worst = min(worth, key=worth.__getitem__)
            lost = worst if worth[worst] <= 0.0 else None
            if free_runs and lost is None:
                alone = self._strong_evidence(now)
                lost = next((n for n in now.causes if not self._is_kept(now, n, alone)), None)
            if lost is None:
                return now
            now = self._remove_implausible(less[lost])
        return now

    def _is_kept(self, now: Model, name: str, alone: float) -> bool:
        """Whether free runs leave a cause in a model; `alone`: evidence that needs none."""
        effect = effect_class(name)
        less = now.less[name].fit
        if now.worth[name] < alone or self._has_other_states(name):
            return self._is_visible(less, now.fit)
        return not (effect.remembers and self._is_harmful(less, now.fit))

    def without_followers(self, now: Model) -> Model:
        """The model without causes that give the filter other states, if what acts is unknown.

        Under a random force that mutes the friction these states follow the readings, whatever
        the values of the cause.
        """
        while self.problem.is_muted(now.fit) and not self.problem.is_overdue:
            name = next((n for n in now.causes if self._has_other_states(n)), None)
            if name is None:
                break
            now = self.remove_cause(now, name)
        return now

    def _has_other_states(self, name: str) -> bool:
        """Whether a cause gives the filter other states, by which it follows the readings."""
        return effect_class(name).action in _OTHER_STATES and not self.problem.is_imposed

    @staticmethod
    def _strong_evidence(now: Model) -> float:
        """Evidence from which the force alone shows a cause of a model."""
        most = max((w for w in now.worth.values() if math.isfinite(w)), default=0.0)
        return max(STRONG_EVIDENCE, STRONG_EVIDENCE_FRACTION * most)

    def _remove_implausible(self, now: Model) -> Model:
        """The model without causes that are none: those cost a pass each to see, no fit.

        Its shape rejects such a cause, not its force, which may hide others: a simpler effect that
        acts as it does takes its place.
        """
        while not self.problem.is_overdue:
            name = next((n for n in now.causes if self._is_implausible(now, n)), None)
            if name is None:
                break
            less = now.less[name] if name in now.less else self.remove_cause(now, name)
            now = self._with_stand_in(now, name, less)
        return now

    def _is_implausible(self, now: Model, name: str) -> bool:
        """Whether a cause of a model cannot be one."""
        return bool(rejection_reason(self.problem, now.fit, name, now.cause_parameters(name)))

    def _with_stand_in(self, now: Model, name: str, less: Model) -> Model:
        """The model with the simplest effect that acts as a rejected cause does, or without it."""
        if self.net_evidence(now, less) <= 0.0:
            return less  # what brings nothing needs none
        merges = self._by_force(now.fit, now.causes).merges([name])
        for _, other, axis, free in merges:
            causes = (*self.problem.free_without(now.causes, name), other)
            model = Model(fit_beside(self.problem, axis, free, now.fit), causes)
            if not self._is_implausible(model, other) and self.net_evidence(model, less) > 0.0:
                return model
        return less

    def _is_visible(self, less: Solution, more: Solution) -> bool:
        """Whether a cause shows in free runs too, unless it is there for simpler assumptions.

        In the place of one wrong base parameter it is one assumption for another.
        """
        before = nominal_error_costs(less)
        after = nominal_error_costs(more)
        simpler = before.sum() - after.sum() > before.max(initial=0.0) + MIN_EVIDENCE
        fall, error = in_free_runs(self.problem, less, more)
        return bool(simpler) or fall > max(MIN_SCORE_FALL, MIN_SCORE_FALL_ERRORS * error)

    def _is_harmful(self, less: Solution, more: Solution) -> bool:
        """Whether free runs on unseen data err more with a cause than without."""
        fall, error = in_free_runs(self.problem, less, more)
        return fall < -max(MIN_SCORE_FALL, MIN_SCORE_FALL_ERRORS * error)

    def _odds(self, name: str) -> float:
        return odds_of(self.odds, name)

    def exchange_cause(self, now: Model) -> Model:
        """The model with a cause exchanged for what explains more in its place, if anything.

        Another one is no less likely than a cause that it makes superfluous.
        """
        least = -MIN_EVIDENCE - max(map(self._odds, now.causes)) - EQUAL_EVIDENCE
        for some, name, axis, free in self._merges.get(frozenset(now.causes), ()):
            causes = self.problem.free_without(now.causes, *some)
            other = Model(fit_beside(self.problem, axis, free, now.fit), (*causes, name))
            if self.net_evidence(other, now) > 0.5 * EQUAL_EVIDENCE:
                return self.eliminate_causes(other)
        for name in sorted(now.worth, key=now.worth.__getitem__)[:MAX_EXCHANGED_CAUSES]:
            less = now.less[name]
            rivals = self._substitute_effects(less, name)
            # Those of a kind are counted again without it: it would be the last of them.  One that
            # the nominal axis has keeps its name.
            alike = [n for n in catalogue(less.fit.axis) if effect_class(n) is effect_class(name)]
            nominal = name in named(self.problem.believed)
            known = (name if nominal else max(alike, default=name), now.fit)
            for row in self.round(less, now.fit, rivals, known) if rivals else ():
                causes = (*less.causes, *row.names)
                same = {*causes} == {*now.causes} or len(causes) > MAX_CAUSES
                if same or row.reason or self.net_evidence(Model(row.fit, causes), now) < least:
                    continue
                other = self.eliminate_causes(Model(row.fit, causes))
                if {*other.causes} == {*now.causes}:
                    continue
                gain = self.net_evidence(other, now)
                if gain > 0.5 * EQUAL_EVIDENCE or (
                    gain > -EQUAL_EVIDENCE and _simpler_set(other, now)
                ):
                    return other
        return now

    def _substitute_effects(self, less: Model, name: str) -> set[str]:
        """Effects that leave about as little of the force as a cause does in its place.

        Those with a memory leave nothing where friction after reversals does.
        """
        gram = self._by_force(less.fit, less.causes)
        left = gram.squares_left(any(effect_class(n).remembers for n in less.causes))
        remembers = effect_class(name).remembers
        mine = left.get(REVERSAL if remembers else name, math.inf)
        found = _doing_as_much(left, mine)
        if remembers or REVERSAL in found:
            found |= {n for n in gram.names if effect_class(n).remembers}
        return found - {name, REVERSAL}

    def rivals_of_base(self, found: Solution) -> set[str]:
        """Effects that leave as little of the force as another base does, beside a nominal one."""
        problem = self.problem
        nominal = problem.fit(problem.believed, noises=noises_of(problem.nominal_fit), turns=0)
        left = self._by_force(nominal).squares_left()
        mine = ForceView(problem, found.axis).squares
        return _doing_as_much(left, mine) - {REVERSAL}

    def net_evidence(self, one: Model, other: Model) -> float:
        """Evidence for a model over another, net of the causes of both."""
        own = sum(MIN_EVIDENCE + self._odds(cause) for cause in one.causes)
        others = sum(MIN_EVIDENCE + self._odds(cause) for cause in other.causes)
        return evidence(other.fit, one.fit, ()) - own + others

    def alternatives(self, now: Model) -> dict[str, dict[str, Solution]]:
        """Effects that explain the records as well in the place of each cause.

        As they were found with other inputs, where exchanges were decided on those.
        """
        key = frozenset(now.causes)
        if self.before is not None and self._kept_before(key):
            earlier = self.before.now
            if frozenset(earlier.causes) == key:
                return self.before.alternatives(earlier)
        found: dict[str, dict[str, Solution]] = {}
        for name in now.causes:
            less = now.less.get(name)
            rows = self._rounds.get(frozenset(less.causes), (None, []))[1] if less else []
            count = len(now.cause_parameters(name))
            found[name] = {
                r.names[0]: r.fit
                for r in rows
                if len(r.names) == 1
                and effect_class(r.names[0]) is not effect_class(name)
                and not r.reason
                and r.fit.cost < now.fit.cost + EQUAL_EVIDENCE
                and len(r.free) <= count + 1
            }
        return found


def _doing_as_much(left: dict[str, float], mine: float) -> set[str]:
    """Effects that explain most of what one does and leave about as little of the force."""
    whole = left.pop("")
    enough = min(_MAX_SQUARES_RATIO * mine, whole - _MIN_EXPLAINED_FRACTION * (whole - mine))
    return {name for name, one in left.items() if one <= enough}


def _shows_in_balance(effect: type[Effect], steady: bool, memory: Sequence[str] = ()) -> bool:
    """Whether an effect shows where the drive just balances the friction.

    The drive follows the friction there: as the load it would explain itself.

    Parameters
    ----------
    effect : type
    steady : bool
        Whether at one velocity only.
    memory : sequence of str
        Actions with a memory that show, too.
    """
    if effect.action not in ("force", "friction", "axis", *memory):
        return False
    remembers = effect.remembers and effect.action not in memory
    return not (remembers or effect.loaded() or (steady and effect.needs_velocities()))


def _first_effects(some: list[Proposal], count: int) -> list[Proposal]:
    """Proposals of the first sets of effects: a form of one does not crowd out another."""
    names = {*[*dict.fromkeys(frozenset(one.names) for one in some)][:count]}
    return [one for one in some if frozenset(one.names) in names]


def _likeliest_shapes(some: list[Proposal]) -> list[Proposal]:
    """Proposals, of each form of a shape with a memory that at the likelier random force.

    Of the effect that gains most those at both: the likelier one may be a wider play than any
    crossing.
    """
    shapes = [one for one in some if one.remembers]
    first = max(shapes, key=lambda p: p.predicted, default=None)
    best = dict[tuple[frozenset[str], frozenset[str]], Proposal]()
    for one in shapes:
        key = frozenset(one.names), frozenset(one.free)
        best[key] = min(one, best.get(key, one), key=lambda p: p.cost)
    kept = {id(p) for p in best.values()}
    return [
        one
        for one in some
        if not one.remembers or id(one) in kept or (first and one.names == first.names)
    ]


def _filter_proposals(among: Collection[str], some: list[Proposal]) -> list[Proposal]:
    """Proposals of some effects alone; all if none are named."""
    return [one for one in some if not among or {*one.names} <= {*among}]


def _start_of(one: Proposal) -> _Start:
    """What tells starts of fits apart: causes, random force, whether instead of the base."""
    return frozenset(one.names), frozenset(one.free), one.quieter, one.held is None


def _simpler_set(one: Model, other: Model) -> bool:
    """Whether a model makes fewer assumptions than another, as `_assumptions` orders them."""

    def size(model: Model) -> tuple[int, float]:
        rank = sum(effect_class(name).rank for name in model.causes)
        return len(model.fit.problem.names), rank

    return size(one) < size(other)


def _is_simpler(one: FittedProposal, other: FittedProposal) -> bool:
    """Whether a row has fewer parameters than another and fits as well."""
    fewer = len(one.fit.problem.names) < len(other.fit.problem.names)
    return fewer and one.fit.cost <= other.fit.cost


def _assumptions(row: FittedProposal) -> tuple[int, float, float]:
    rank = max(effect_class(n).rank for n in row.names)
    return len(row.fit.problem.names), rank, -row.evidence
