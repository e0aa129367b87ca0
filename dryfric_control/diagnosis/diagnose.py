"""Diagnose records: the whole procedure from data to cause."""

from __future__ import annotations

import functools
import math
import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from threadpoolctl import threadpool_limits

from dryfric_control._version import __version__
from dryfric_control.checks import check_boolean, instance, positive, whole
from dryfric_control.diagnosis.candidates import SLUGS, effect_class
from dryfric_control.diagnosis.causes import (
    causes_of,
    changing_cause,
    equivalent_axis,
    hardly_determined,
    own_values_differ,
    varying_parameters,
    with_own,
    with_weights_apart,
)
from dryfric_control.diagnosis.criterion import cost_of, evidence
from dryfric_control.diagnosis.experiment import Experiment, next_experiment
from dryfric_control.diagnosis.inputs import (
    as_recorded,
    denoised_inputs,
    driven_model,
    imposed_search,
    with_input_lead,
)
from dryfric_control.diagnosis.invariants import is_pressed_to_bound
from dryfric_control.diagnosis.problem import BIAS, Problem, each_of, noises_of, with_found_load
from dryfric_control.diagnosis.remaining import Remaining, remaining_force
from dryfric_control.diagnosis.report.diagnosis import Diagnosis
from dryfric_control.diagnosis.report.findings import LATE
from dryfric_control.diagnosis.search import Model, Search
from dryfric_control.diagnosis.thresholds import (
    ANSWER_TIME_FRACTION,
    CONVERGED_GAIN,
    FREE_RUN_LENGTH,
    MAX_EXPERIMENT_ALTERNATIVES,
    MAX_UNEXPLAINED_FRACTION,
    MIN_VISIBLE_DELAY,
    MIN_WINDOWS,
    REMAINING_GAIN_RATIO,
)
from dryfric_control.diagnosis.verdict import Judged, judge_fit, shows
from dryfric_control.estimation.likelihood import LOAD_ERROR, prepare
from dryfric_control.estimation.parameters import SHIFT, checked_knowledge
from dryfric_control.estimation.plausibility import (
    check_plausible,
    checked_records,
    refuse_implausible,
)
from dryfric_control.estimation.scoring import COMPARISON_ITERATIONS, FINAL_ITERATIONS, maximise
from dryfric_control.estimation.solution import Solution
from dryfric_control.estimation.windows import Windows, cut, delay_input
from dryfric_control.identification.identifiability import far_from_zero_messages
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.model.effects.forces import TimePeriodic
from dryfric_control.model.effects.naming import title_of
from dryfric_control.progress import ProgressLine
from dryfric_control.records.bad_readings import REASONS
from dryfric_control.records.motion import directions, is_undriven
from dryfric_control.records.read import RecordLike
from dryfric_control.records.record import Record, counts_text
from dryfric_control.records.record_arguments import HOW_TO_GIVE, axis_first
from dryfric_control.store.batch import fingerprint, raise_failures, run_batch
from dryfric_control.text import length_text, page_reference, percent
from dryfric_control.units import check_units

FloatArray = NDArray[np.float64]

# Messages.
_LINE = (
    "a straight line predicts the readings better than the model does: the drive and the friction "
    "of the model do not explain this motion; check first the units, factors and signs of input "
    "and position"
)
_IMPOSED = (
    "the motion is imposed by something other than the drive, such as a bench or a tight loop: it "
    "says nothing about the forces, so the drive was compared with the force the motion requires"
)
_ONE_VELOCITY = (
    "each direction has nearly one velocity: effects that depend on velocity cannot be separated "
    "from the Coulomb level and were not tried; viscous friction keeps its nominal value"
)
_MUTED = (
    "the random force that is left is more than a fifth of the Coulomb level: what acts on the "
    "axis is mostly unknown"
)
_RATIOS = (
    "the record fixes mass, friction and all forces only as ratios to the gain of the drive, "
    "which keeps its nominal value: the errors include a factor of 1.4 for it; if the gain or "
    'the mass is known, say so: known=("mass",)'
)
_UNDRIVEN = (
    "no drive acts in the record: its motion shows friction and forces only as ratios to the mass, "
    "which keeps its nominal value"
)
_IMPOSSIBLE_MASS = (
    "the mass ended at a bound, {:.2g} times its nominal value, to make up for what is missing, so "
    "no causes are reported: what acts is not in the catalogue, or the nominal mass lacks a part, "
    "as that of a rotor behind its gear"
)
_LITTLE = (
    "{} of the error is left by the best set of candidates, so none is reported as a cause: what "
    "acts is not in the catalogue, or several effects hide each other; nearest to it: {}"
)
_CHANGES = (
    "what fits the first half of the record does not fit the second half, and the difference is "
    "largest in: {}. Something that changes in the record is missing from the model"
)
_INTERRUPTED = "interrupted: the best answer so far; causes may be missing"
# Verdict on a record of several, or a joint, that cannot be diagnosed.
NOT_DIAGNOSED = "not diagnosed"


@axis_first
def diagnose(
    axis: FrictionAxis,
    record: RecordLike | Sequence[RecordLike],
    *,
    known: Sequence[str] = (),
    tolerance: Mapping[str, float] | None = None,
    window: float | None = None,
    hold: str = "zero",
    time_limit: float | None = None,
    jobs: int = 2,
    progress: bool | None = None,
    on_update: Callable[[str, tuple[str, ...]], None] | None = None,
    anyway: bool = False,
    load_errors: ArrayLike | None = None,
) -> Diagnosis:
    """Find where simulation and measurement differ, and why.

    Parameters
    ----------
    axis : FrictionAxis
        The nominal axis.
    record : Record or path-like, or a sequence of them
        The measured record: time, drive force, position, or the path of its file.  Several
        records of one machine share their causes.  Without a drive (u = 0) the mass is held.
    known : sequence of str, optional
        Parameters whose nominal values are right, such as ``("mass",)``; those of an effect
        that the nominal axis has not, such as "input_gain.gain", if it is none.
    tolerance : mapping of str to float, optional
        Relative standard deviation of a nominal value, such as
        ``{"viscous": 0.5}``: a change within it is not reported as a finding.
    window : float, optional
        Length of the free runs [s].  Default: 0.25 s, or as long as friction takes to
        show above the noise of the readings.
    hold : {"zero", "first"}, optional
        Whether the recorded input is held or interpolated linearly between samples.
    time_limit : float, optional
        Wall time [s] after which the best answer so far is returned: its verdict is then
        "not finished".  So it is after Ctrl-C.
    jobs : int, optional
        Number of candidates fitted in parallel.
    progress : bool, optional
        Whether to show a progress bar.  Default: in a terminal or a notebook; elsewhere the
        steps go to the log "dryfric_control".
    on_update : callable, optional
        Called with the name of each step and the causes found so far.
    anyway : bool, optional
        Whether to go on, with a warning, where a record certainly has a wrong unit or sign.
    load_errors : array_like, shape (k, n), optional
        What the known load of one record may be off: forces at each sample, each by one standard
        deviation, independent of each other.  What they explain is no cause.

    Returns
    -------
    Diagnosis

    Raises
    ------
    ValueError
        If an argument is of the wrong kind, or a record is too short to fit
        on one part and judge on another, or the axis does not move in it; or if
        the drive certainly has the wrong sign, or mass and friction differ from
        those of the axis as only a wrong unit can make them, by more than a
        factor of 100.

    Warns
    -----
    RecordWarning
        When a unit or a sign seems wrong.

    Notes
    -----
    A random force acts in addition to the model: noise of the drive, and whatever the model
    leaves out.  Its size and that of the readings' noise are estimated together with the
    parameters, by the likelihood of a hybrid filter's innovations, which are those of a
    Student's t distribution with 4 degrees of freedom.

    One pass of the filter at a model linearises the innovations in every effect of the
    catalogue, over a grid of its shapes; the normal equations of all these columns propose
    causes, single and joined.  The proposals are fitted in full, and the one with most
    evidence joins: the gain of log-likelihood on parts of the record that its parameters
    were not fitted to, less 6 and the logarithm of the number of shapes for each cause.
    Causes without evidence beside the others are dropped, and exchanged where another
    explains more.  Errors of base parameters count as assumptions; a factor of 2 is already
    a strong one.

    What remains is compared with replays of the final model in which a random force of the
    estimated size acts.

    The answer holds for what the record excites: a cause that never acts in it
    is not found, and "nothing to find" is no proof of its absence.

    Examples
    --------
    >>> import numpy as np
    >>> import dryfric_control as dfc
    >>> believed = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    >>> machine = believed.replace(effects=(dfc.effects.Spring(stiffness=40.0, rest=0.05),))
    >>> t = 1e-3 * np.arange(6000)
    >>> u = 20.0 * np.sin(6.0 * t) + 12.0 * np.sin(17.0 * t + 1.0)
    >>> x = 1e-6 * np.round(1e6 * machine.simulate(u, dt=1e-3).y[0])
    >>> d = dfc.diagnose(believed, dfc.Record(t, u, x))
    >>> d.verdict, [cause.effect for cause in d.causes]
    ('explained', ['spring'])
    >>> round(d.causes[0].parameters["stiffness"], 1)
    40.0
    """
    begun = time.monotonic()
    instance("axis", axis, FrictionAxis, HOW_TO_GIVE)
    whole("jobs", jobs)
    check_boolean("anyway", anyway)
    if on_update is not None and not callable(on_update):
        raise ValueError(
            f"on_update must be a function of a step and the causes, or None, got {on_update!r}"
        )
    if window is not None:
        window = positive("window", window, unit="s")
    limit = math.inf if time_limit is None else positive("time_limit", time_limit, unit="s")
    known, tolerance = checked_knowledge(known, tolerance)
    axis = axis.effective()
    several = isinstance(record, (list, tuple))
    records = list(checked_records(record))
    loads = checked_load_errors(load_errors, records)
    if all(map(is_undriven, records)) and "mass" not in {*known, *tolerance}:
        known = (*known, "mass")
    window = _window(axis, records) if window is None else window
    windows = []
    for i, one in enumerate(records):
        name = f"record[{i}]" if several else "record"
        windows.append(_cut(axis, one, window, hold, name, MIN_WINDOWS // len(records)))
        check_plausible(axis, one, name, anyway=anyway)
    _check_motion(windows, several)
    with ProgressLine("diagnose", progress) as line:

        def tell(step: str, causes: Sequence[str] = ()) -> None:
            line(step, causes)
            if on_update is not None:
                on_update(step, tuple(causes))

        problem = Problem(
            axis,
            tuple(prepare(r, mass=axis.mass, load_errors=loads) for r in records),
            known,
            tolerance,
            hold=hold,
            jobs=jobs,
            until=begun + (1.0 - ANSWER_TIME_FRACTION) * limit,
            windows=tuple(windows),
        )
        # Candidates are fitted in parallel: threads of the linear algebra would only wait.
        with threadpool_limits(1, user_api="blas"):
            return _search_and_judge(problem, records, windows, window, tell, begun + limit)


def _search_and_judge(
    problem: Problem,
    records: list[Record],
    windows: list[Windows],
    window: float,
    tell: Callable[..., None],
    end: float,
) -> Diagnosis:
    """Search for causes, judge what they explain, and describe them."""
    tell("base parameters")
    search, model, interrupted = _search(with_weights_apart(problem), tell)
    if not interrupted:
        search, model, interrupted = _with_any_shape(search, model, problem.runs)
    if not interrupted:
        search, model, interrupted = _beside_own_values(search, model, problem.also, tell)
    message = [LATE] if search.problem.is_overdue else []
    if interrupted:
        message = [_INTERRUPTED]
    answer = functools.partial(
        _Answer, search, model, problem.runs, records, windows, window, tell, end
    )
    try:
        return answer(message).build_diagnosis()
    except KeyboardInterrupt:
        return answer([_INTERRUPTED]).build_diagnosis()


@dataclass(eq=False)
class _Answer:
    """The steps from the model that a search has found to a diagnosis.

    With a message from the search, which has then not finished, only the steps that are needed.
    """

    search: Search
    model: Model
    recorded: Sequence[Any]  # the runs with their inputs as recorded
    records: list[Record]
    windows: list[Windows]
    window: float  # length of the free runs [s]
    tell: Callable[..., None]
    end: float  # reading of `time.monotonic` at which fits end
    messages: list[str]
    varies: dict[str, dict[str, list[float]]] = field(default_factory=dict)
    lead: str = ""  # of the inputs over their time stamps
    # Records and free runs with the inputs at their time stamps.
    stamped: tuple[list[Record], list[Windows]] = ([], [])

    def __post_init__(self) -> None:
        self.finished = not self.messages

    @property
    def problem(self) -> Problem:
        """The problem of the search, as it is now."""
        return self.search.problem

    def build_diagnosis(self) -> Diagnosis:
        """Judge what the model explains and describe it."""
        references = _reference_costs(self.problem)
        self.search.problem = replace(self.problem, until=self.end)
        self.model = self.search.without_followers(self.model)
        self.tell("all data", self.model.causes)
        final = self.law = self._final_fit()
        self._shift_records(final)
        self._correct_load(final)
        rivals = self.search.alternatives(self.model)
        self.causes = causes_of(self.search, self.model, final, rivals)
        self.tell("replays", self.model.causes)
        self._judge_fit(final)
        if not (self.causes or self.problem.own):
            no_lead = self.lead and (self.found.muted or _leaves_most(self.found))
            final = self._without_causes(final) if no_lead else self._nominal_fit(final)
        better = [name for name, cost in references.items() if cost < final.cost]
        if self.found.worse:
            better.append("free runs of the nominal axis")
        if self.causes and self._reject_causes(better, final):
            final = self._without_causes(final)
        if self.finished:
            self._compare_records(final)
        changes = self._change_within_records()
        if "straight line" in better:
            self.messages.append(_LINE)
        self.messages += self._limit_messages(final)
        experiment = None
        if self.finished:
            self.tell("next experiment", self.model.causes)
            experiment = _experiment(
                self.problem, self.model, final, rivals, self.causes, self.records[0]
            )
        causes = [*self.causes, *self.varies]
        search = self.search
        samples = self.problem.samples
        return Diagnosis(
            axis=self.problem.believed,
            record=self.records[0],
            verdict=_verdict(self.found, causes, final, self.finished, changes),
            causes=tuple(self.causes),
            extended=final.axis,
            gain=self.found.gain,
            unexplained=self.found.left,
            next_experiment=experiment,
            messages=(
                *self.messages,
                *_left_out(self.records),
                *far_from_zero_messages(final.axis, self.records),
            ),
            scores={k: -2.0 * v / samples for k, v in search.first.items()} | {"": 0.0},
            window=self.window,
            hold=self.problem.hold,
            roles=self.heard.held_out_axes(0)[1][self.windows[0].edges[:-1]],
            remaining=self._remaining_force(),
            references={name: cost - final.cost for name, cost in references.items()},
            varies=self.varies,
            others=tuple(self.records[1:]),
            not_tried=dict(search.not_tried),
            standard_errors={
                name: error
                for name, error in final.standard_errors().items()
                if not name.startswith(LOAD_ERROR)
            },
        )

    def _final_fit(self) -> Solution:
        """The model fitted to all data; without a lead of the input that is too short to be one."""
        problem = self.problem
        final = self.model.fit
        if self.finished and not final.promised < CONVERGED_GAIN:
            # With slopes that switches belong to: near the end those of a recursion creep.  And
            # from a large random force, with which the cost is smooth.
            likelihood = problem.likelihood(final.axis, problem.free_of(final), each=each_of(final))
            turns, until = FINAL_ITERATIONS, problem.until
            final = maximise(final.problem, final.z, turns, until, again=True, recursion=False)
            start = likelihood.start(1.0)
            other = maximise(likelihood, start, turns, until, recursion=False, than=final.cost)
            final = min(final, other, key=cost_of)
        shift = final.values().get(SHIFT, 0.0)
        if problem.shift is not None and shift > -MIN_VISIBLE_DELAY * problem.scales.step:
            problem = self.search.problem = replace(problem, shift=None)
            final = _continue_fit(problem, final, COMPARISON_ITERATIONS)
        return final

    def _shift_records(self, final: Solution) -> None:
        """Shift the inputs of the records by the lead that was found, if any."""
        if self.problem.shift is None:
            return
        self.stamped = list(self.records), list(self.windows)
        shift = final.values().get(SHIFT, 0.0)
        self.records = [r.replace(u=delay_input(r.u, shift / r.dt)) for r in self.records]
        self.windows = [cut(r, self.window, self.problem.hold) for r in self.records]
        self.lead = length_text(-shift, "s")

    def _withdraw_lead(self) -> None:
        """Take the lead of the input back: what explains little of a motion does not show one."""
        if self.lead:
            self.records, self.windows = self.stamped
            self.search.problem = replace(self.problem, shift=None)
            self.lead = ""

    def _correct_load(self, final: Solution) -> None:
        """Correct the known load of a record by what it was found to be off."""
        error = final.problem.load_error(final.z, 0)
        if not error.size:
            return
        off = float(np.sqrt(np.mean(error**2)))
        unit = self.problem.believed.units[1]
        note = f"load: corrected by {off:.2g} {unit} RMS, within what it may be off"
        self.records = [with_found_load(final, self.records[0], note=note)]
        self.windows = [cut(r, self.window, self.problem.hold) for r in self.records]

    def _judge_fit(self, fit: Solution) -> None:
        """Measure what a fit explains, on the inputs as recorded."""
        self.heard = as_recorded(fit, self.recorded)
        self.found = judge_fit(self.problem, self.windows, self.heard)

    def _nominal_fit(self, final: Solution) -> Solution:
        """The nominal axis with its noises fitted."""
        return self.problem.reference(self.problem.believed, noises=noises_of(final))

    def _reject_causes(self, better: Sequence[str], final: Solution) -> bool:
        """Whether the causes explain too little to be reported, with a message if so."""
        slugs = [cause.effect for cause in self.causes]
        if better:
            text = f"not better than {' and '.join(better)}: no causes are reported"
        elif "inertia" not in slugs and is_pressed_to_bound(final, "mass"):
            # A mass that no one would name takes part in all forces.
            text = _IMPOSSIBLE_MASS.format(final.axis.mass / self.problem.believed.mass)
        elif _leaves_most(self.found):
            names = ", ".join(cause.title for cause in self.causes)
            text = _LITTLE.format(percent(self.found.left.fraction), names)
        else:
            return False
        self.messages.append(text)
        return True

    def _without_causes(self, final: Solution) -> Solution:
        """The nominal axis in place of the model, judged as one that leaves something."""
        self._withdraw_lead()
        self.causes, self.model = [], Model(self.model.fit)
        final = self.law = self._nominal_fit(final)
        self._judge_fit(final)
        left = replace(self.found.left, significant=True)
        self.found = self.found._replace(left=left)
        return final

    def _compare_records(self, final: Solution) -> None:
        """Find the parameters that differ between several records."""
        if len(self.records) < 2:
            return
        self.tell("differences between the records", self.model.causes)
        self.varies, apart = varying_parameters(self.problem, final, self.problem.free_of(final))
        if self.varies:
            self.law = apart
            self._judge_fit(apart)

    def _change_within_records(self) -> str:
        """What changes within the records, with a message; empty if nothing does."""
        changes = changing_cause(self.search, self.model, self.law) if self.finished else ""
        if changes:
            self.messages.append(_CHANGES.format(title_of(SLUGS.get(changes, changes))))
        return changes

    def _limit_messages(self, final: Solution) -> list[str]:
        """Messages about what limits the answer."""
        problem = self.problem
        found = list[str]()
        if self.lead:
            found.append(
                f"the recorded input acts {self.lead} before its time stamp: d.record has it "
                "shifted"
            )
        found += [
            f"{name} ended at a bound: the model does not fit, or the records do not determine it"
            for name in final.at_bound
        ]
        found += hardly_determined(problem.believed, self.causes)
        if self.found.muted:
            found.append(_MUTED)
        if problem.scale_open:
            found.append(_RATIOS)
        if all(map(is_undriven, self.records)):
            found.append(_UNDRIVEN)
        if problem.is_imposed:
            found += [_IMPOSED] + [_ONE_VELOCITY] * problem.steady
        pairs = zip(self.recorded, problem.runs, strict=True)
        differences = np.concatenate([a.u - b.u for a, b in pairs])
        noise = math.sqrt(np.mean(differences**2))
        if noise > 0.0:
            unit = problem.believed.units[1]
            found.append(
                f"noise of {noise:.2g} {unit} RMS was recorded with the input "
                "and does not act on the axis: it was removed"
            )
        return found

    def _remaining_force(self) -> Remaining:
        """The random force that is left, if free runs show one."""
        left = self.found.left
        unit = self.problem.believed.units[1]
        if left.significant or self.found.muted or shows(self.problem, self.heard):
            return remaining_force(self.heard, left.significant, left.where, unit)
        return Remaining(unit=unit)


def _leaves_most(found: Judged) -> bool:
    """Whether a model leaves more than half of the squared error."""
    return found.left.significant and found.left.fraction > MAX_UNEXPLAINED_FRACTION


def _reference_costs(problem: Problem) -> dict[str, float]:
    """Costs of the models that an answer must beat."""
    costs = {"nominal axis": problem.nominal_fit.cost}
    if not problem.is_imposed:
        costs["straight line"] = problem.straight_line.cost
    return costs


def _continue_fit(problem: Problem, fit: Solution, iterations: int) -> Solution:
    """The same model fitted on in a problem."""
    free = problem.free_of(fit)
    return problem.fit(fit.axis, free, noises_of(fit), iterations, each=each_of(fit))


def _search(problem: Problem, tell: Callable[..., None]) -> tuple[Search, Model, bool]:
    """Search for causes; whether it was interrupted."""
    search = Search(problem, tell)
    search.now = Model(problem.nominal_fit)
    recorded = problem.runs
    try:
        forces, builds_up = search.by_force()
        shown = _force_first(search, recorded, forces, builds_up)
        if shown is not None and not shown[0].problem.is_muted(shown[1].fit):
            return *shown, False
        first_search = search
        search = Search(problem, tell, search.not_tried, now=search.now)
        begun = search.fit_nominal()
        if not forces.causes:
            begun = min(begun, forces.fit, key=cost_of)
        # The least smoothing: a smoother input may hide that it does not cause the motion.
        problem = search.problem = denoised_inputs(problem, recorded, begun, most=False)
        if problem.runs is not recorded:
            begun = problem.fit(begun.axis, noises=noises_of(begun), turns=COMPARISON_ITERATIONS)
        search.now = Model(begun)
        if begun.cost > problem.straight_line.cost:
            found = _by_force(search, begun, builds_up)
            if found is not None:
                return *found, False
        if shown is not None and first_search.has_begun_at(begun):
            return *shown, False
        first = search.best_proposal(Model(begun))
        fall = 0.0 if first is None else begun.cost - first.fit.cost
        early = (
            with_input_lead(problem, begun) if REMAINING_GAIN_RATIO * search.early > fall else None
        )
        if early is not None and (first is None or evidence(first.fit, early[1], ()) > 0.0):
            problem, begun = early
            search = Search(problem, tell, now=Model(begun))
        model = search.run(Model(begun))
        again = _search_other_inputs(search, model, recorded)
        if again is not None:
            search, model = again
    except KeyboardInterrupt:
        return search, search.now, True
    if shown is not None and shown[0].net_evidence(shown[1], model) > 0.0:
        return *shown, False  # what the force shows, though not all is known
    return search, model, False


def _force_first(
    search: Search, recorded: Sequence[Any], found: Model, builds_up: bool
) -> tuple[Search, Model] | None:
    """The search from the causes that the force shows; None where these do not explain the motion.

    What builds up after reversals, and beside which a straight line predicts better, is a contact.
    """
    problem = search.problem
    if builds_up and found.fit.cost > problem.straight_line.cost:
        found = driven_model(problem, found.fit, found) or found
    if not found.causes or found.fit.cost > problem.straight_line.cost:
        return None
    problem = search.problem = denoised_inputs(problem, recorded, found.fit, most=True)
    fit = found.fit
    if any(a.u is not b.u for a, b in zip(recorded, problem.runs, strict=True)):
        fit = _continue_fit(problem, fit, COMPARISON_ITERATIONS)
    search.now = Model(fit, found.causes)
    begin = search.eliminate_causes(search.now)
    if builds_up:
        begin = search.after_reversals(search.now, begin)
    if not begin.causes:
        begin = search.with_any_shape(begin) or begin  # their shapes reject them, not their force
    model = search.run(begin)
    again = _search_other_inputs(search, model, recorded)
    if again is not None:
        search, model = again
    return (search, model) if problem.clear_of_line(model.fit) else None


def _with_any_shape(
    search: Search, model: Model, recorded: Sequence[Any]
) -> tuple[Search, Model, bool]:
    """The search continued with an effect whose law may have any shape, where that explains more.

    It is tried last: it may do what any effect with a law of its own does.
    """
    found = search, model, False
    try:
        if search.problem.is_overdue or search.problem.shift is not None:
            return found
        begun = search.with_any_shape(model)
        more = None if begun is None else _force_first(search, recorded, begun, False)
        return found if more is None else (*more, False)
    except KeyboardInterrupt:
        return *found[:2], True


def _beside_own_values(
    search: Search, model: Model, also: tuple[str, ...], tell: Callable[..., None]
) -> tuple[Search, Model, bool]:
    """The search continued beside base parameters that differ between records, where some do.

    Such as the mass under another load: what is common to all records is bent by it.  What does not
    differ any more beside the causes found is common again.  `also`: further free parameters of the
    nominal axis as it was given.
    """
    problem = search.problem
    found = search, model
    try:
        if len(problem.runs) < 2 or problem.is_imposed or problem.is_overdue:
            return *found, False
        varies, apart = varying_parameters(problem, model.fit, ())
        if not varies:
            return *found, False
        own = tuple(dict.fromkeys((*problem.own, *varies)))
        if own != problem.own:
            other = with_own(problem, model.fit, own)
            fit = _continue_fit(other, apart, COMPARISON_ITERATIONS)
            beside = Search(other, tell, search.not_tried, now=Model(fit, model.causes))
            found = beside, beside.run(beside.eliminate_causes(beside.now))
        beside, end = found
        alike = replace(beside.problem, own=(), also=also)
        common = _continue_fit(alike, end.fit, COMPARISON_ITERATIONS)
        if not own_values_differ(alike, common, end.fit):
            # A common force is a cause as any other.
            more = (BIAS,) * (beside.problem.also != also)
            same = Search(alike, tell, search.not_tried, now=Model(common, (*end.causes, *more)))
            found = same, same.run(same.eliminate_causes(same.now))
    except KeyboardInterrupt:
        return *found, True
    return *found, False


def _by_force(search: Search, begun: Solution, builds_up: bool) -> tuple[Search, Model] | None:
    """The search continued from what the force of the motion shows, if that explains it.

    In the view of the force itself where the drive follows an imposed motion.
    """
    problem = search.problem
    other = imposed_search(problem, search.tell)
    if other is None:
        return None
    found = other.run(other.now)
    there = None if problem.is_overdue else driven_model(problem, begun, found, builds_up)
    if there is not None:
        motion = Search(problem, search.tell, search.not_tried, now=there)
        model = motion.run(motion.eliminate_causes(there))
        if problem.clear_of_line(model.fit):
            return motion, model
    return (other, found) if problem.behind_line(begun) else None


def _search_other_inputs(
    search: Search, model: Model, recorded: Sequence[Any]
) -> tuple[Search, Model] | None:
    """The search continued with inputs that suit the causes found, if others do."""
    problem = search.problem
    if problem.is_overdue:
        return None
    other = denoised_inputs(problem, recorded, model.fit, most=True)
    fit = model.fit
    if any(a.u is not b.u for a, b in zip(other.runs, problem.runs, strict=True)):
        fit = _continue_fit(other, fit, COMPARISON_ITERATIONS)
    if problem.shift is None:
        early = with_input_lead(other, fit) if search.early > 0.0 else None
        other, fit = early if early is not None else (other, fit)
    else:
        less = replace(other, shift=None)
        alone = _continue_fit(less, fit, COMPARISON_ITERATIONS)
        if with_input_lead(less, alone) is None:
            other = less
            fit = alone
    if fit is model.fit:
        early_instead = _lead_instead_of_periods(search, model)
        if early_instead is None:
            return None
        other, model = early_instead
        fit = model.fit
    again = Search(
        other,
        search.tell,
        search.not_tried,
        dict(search.odds),
        search.first,
        before=search,
    )
    again.now = Model(fit, model.causes)
    return again, again.run(again.eliminate_causes(again.now))


def _lead_instead_of_periods(search: Search, model: Model) -> tuple[Problem, Model] | None:
    """Inputs that act early in place of disturbances that are periodic in time, where likelier.

    A drive of a few frequencies that acts before its stamps lacks forces of just these.
    """
    if search.problem.shift is not None:
        return None
    rest = model
    for name in reversed(model.causes):  # those of a kind are counted from the first
        if effect_class(name).slug == TimePeriodic.slug:
            rest = search.remove_cause(rest, name)
    early = with_input_lead(search.problem, rest.fit) if rest is not model else None
    if early is None or evidence(model.fit, early[1], ()) <= 0.0:
        return None
    return early[0], Model(early[1], rest.causes)


def _verdict(
    found: Judged, causes: Sequence[Any], final: Solution, finished: bool, changes: str
) -> str:
    """The verdict from what was found, what is left, and what changes in the records."""
    if not finished:
        return "not finished"
    if not causes:
        wrong = found.left.significant or found.muted or changes
        return "unexplained" if wrong else "nothing to find"
    doubtful = changes or final.at_bound or not final.converged
    better = found.gain.ratio >= 1.0
    return "explained" if found.is_noise and better and not doubtful else "partly explained"


def _experiment(
    problem: Problem,
    model: Model,
    final: Solution,
    rivals: Mapping[str, dict[str, Solution]],
    causes: Sequence[Any],
    record: Record,
) -> Experiment | None:
    """The experiment that separates the first doubtful cause from its alternatives."""
    if not record.u.any():
        return None  # what the drive of the bench can do is not known
    doubtful = next((n for n in model.causes if rivals.get(n)), None)
    if doubtful is None:
        other = equivalent_axis(final.axis, problem.believed, causes)
        return other and next_experiment(final.axis, other[:1], record, names=other[1:])
    some = dict(list(rivals[doubtful].items())[:MAX_EXPERIMENT_ALTERNATIVES])
    axes = [fit.axis for fit in some.values()]
    return next_experiment(final.axis, axes, record, names=[doubtful, *some])


def checked_load_errors(load_errors: ArrayLike | None, records: Sequence[Record]) -> FloatArray:
    """What the known load may be off, shape (k, n), read-only; k = 0 for nothing."""
    if load_errors is None:
        return np.zeros((0, len(records[0])))
    errors = np.array(load_errors, dtype=float)
    if len(records) > 1:
        raise ValueError("load_errors are of one record: diagnose the records one by one")
    if errors.ndim != 2 or errors.shape[1] != len(records[0]) or not np.isfinite(errors).all():
        given = f"shape {errors.shape}" if errors.ndim else repr(load_errors)
        raise ValueError(
            f"load_errors must be finite forces of shape (k, {len(records[0])}), one for each "
            f"sample of the record, got {given}"
        )
    errors.setflags(write=False)
    return errors


def _window(axis: FrictionAxis, records: Sequence[Record]) -> float:
    """Length of free runs in which the friction shows above the noise of the readings.

    Of the parabola that a friction error F bends a free run by, a fitted start state leaves
    F T^2 / (12 sqrt(5) m) RMS.
    """
    noise = max(max(r.noise, (r.quantum or 0.0) / math.sqrt(12.0)) for r in records)
    force = max(axis.coulomb.mean, 1e-3 * float(np.std(records[0].u)), 1e-300)
    needed = math.sqrt(12.0 * math.sqrt(5.0) * 3.0 * noise * axis.mass / force)
    shortest = min(r.duration for r in records) / MIN_WINDOWS
    return min(max(FREE_RUN_LENGTH, needed), max(shortest, FREE_RUN_LENGTH))


def _cut(
    axis: FrictionAxis, record: Record, window: float, hold: str, name: str, least: int
) -> Windows:
    """Windows of a record; ValueError if it cannot be diagnosed."""
    windows = cut(record, window, hold)
    check_units(axis, record, name)
    if len(windows) < least:
        raise ValueError(
            f"{name} lasts {record.duration:.3g} s, which is {len(windows)} windows of "
            f"{window:g} s: give at least {least} windows, or a shorter window"
            + page_reference("howto/diagnose")
        )
    return windows


def _check_motion(windows: Sequence[Windows], several: bool) -> None:
    enough = [one.moving.sum() > 1 and bool(directions(one.record).any()) for one in windows]
    for i in range(len(windows)):
        if not enough[i] and not (several and any(enough)):
            name = f"record[{i}]" if several else "record"
            raise ValueError(
                f"{name}: the axis hardly moves, so friction cannot be determined; use a record "
                "with slow and fast moves in both directions" + page_reference("howto/diagnose")
            )


def _left_out(records: Sequence[Record]) -> list[str]:
    """Messages about readings that were not used."""
    found = []
    for i, record in enumerate(records):
        if record.masked.reasons:
            which = f" of record {i + 1}" if len(records) > 1 else ""
            kinds = counts_text({kind: record.bad[kind] for kind in REASONS})
            found.append(f"readings{which} left out: {kinds} (d.masked lists them)")
    return found


def diagnose_batch(
    axis: FrictionAxis,
    records: Mapping[str, Record] | Sequence[Record],
    *,
    window: float | None = None,
    hold: str = "zero",
    store: str | os.PathLike[str] | None = None,
    jobs: int | None = None,
    progress: bool = True,
    anyway: bool = False,
) -> dict[Any, dict[str, Any]]:
    """Diagnose many records of one axis, resumable.

    Parameters
    ----------
    axis : FrictionAxis
        The nominal axis.
    records : mapping of str to Record, or sequence of Record
        The measured records by name; those of a sequence are numbered from 0.
    window : float, optional
        Length of the free runs [s], see `diagnose`.
    hold : {"zero", "first"}, optional
        Whether the recorded inputs are held or interpolated linearly between samples.
    store : path-like, optional
        File that keeps each finished record, see `run_batch`.
    jobs : int, optional
        Number of records in parallel, -1 for one on each core.  Default: the setting
        of `joblib.parallel_config`, else one.
    progress : bool, optional
        Whether to show a progress bar.
    anyway : bool, optional
        Whether to go on where a record certainly has a wrong unit or sign, see `diagnose`.

    Returns
    -------
    dict
        `Diagnosis.to_dict` of each record, by its name or number.  A record that cannot be
        diagnosed has the `verdict` "not diagnosed" and a `reason`, and no more.

    Raises
    ------
    ValueError
        If an argument is out of its range, no record can be diagnosed (the first is named in
        a note), or the store is of another axis, window, hold or version.

    Notes
    -----
    A store identifies records by their name and their data: a new measurement under
    an old name is diagnosed again.

    Examples
    --------
    >>> import numpy as np
    >>> import dryfric_control as dfc
    >>> believed = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    >>> machine = believed.replace(effects=(dfc.effects.InputGain(gain=1.2),))
    >>> t = 1e-3 * np.arange(6000)
    >>> u = 20.0 * np.sin(6.0 * t) + 12.0 * np.sin(17.0 * t + 1.0)
    >>> x = 1e-6 * np.round(1e6 * machine.simulate(u, dt=1e-3).y[0])
    >>> found = dfc.diagnose_batch(believed, {"monday": dfc.Record(t, u, x)}, progress=False)
    >>> [cause["effect"] for cause in found["monday"]["causes"]]
    ['input_gain']
    """
    instance("axis", axis, FrictionAxis)
    if not isinstance(records, (Mapping, list, tuple)):
        raise ValueError(
            f"records must be a mapping of names to Record, or a list of Record, got {records!r}"
        )
    named = records.items() if isinstance(records, Mapping) else enumerate(records)
    cases: dict[Any, tuple[FrictionAxis, tuple[Record, ...]]] = {}
    for name, record in named:
        instance(f"records[{name!r}]", record, Record, "see dfc.read_record")
        cases[name] = axis, (record,)
    found = run_cases(
        functools.partial(_diagnose_case, window, hold, anyway),
        "records",
        cases,
        window=window,
        hold=hold,
        settings={"task": "diagnose", "axis": fingerprint(axis)},
        store=store,
        jobs=jobs,
        progress=progress,
        anyway=anyway,
    )
    return {name: failure_entry(one) or one for name, one in found.items()}


def failure_entry(result: Any) -> dict[str, str]:
    """What stands for a diagnosis that failed; nothing for one that did not."""
    if not isinstance(result, Exception):
        return {}
    known = isinstance(result, (ValueError, OSError))
    reason = str(result) if known else f"{type(result).__name__}: {result}"
    return {"verdict": NOT_DIAGNOSED, "reason": reason}


def run_cases(
    function: Callable[[Any], Any],
    label: str,
    named: Mapping[Any, tuple[Any, ...]],
    *,
    window: float | None,
    hold: str,
    settings: Mapping[str, Any],
    store: str | os.PathLike[str] | None,
    jobs: int | None,
    progress: bool,
    anyway: bool,
    own: Callable[[FrictionAxis], tuple[str, ...]] = lambda axis: (),
) -> dict[Any, Any]:
    """Run a diagnosis over axes with their records, each checked before any work.

    A case is an axis, its records, and any arrays beside them.  A store identifies it by its name,
    these data and `own` of its axis.
    A case that cannot be diagnosed has its exception for a result, unless all have.
    """
    check_boolean("anyway", anyway)
    cases: dict[Any, Any] = {}
    results: dict[Any, Any] = dict.fromkeys(named)
    for name, (axis, records, *more) in named.items():
        try:
            for record in records:
                check_units(axis, record, f"{label}[{name!r}]")
                cut(record, _window(axis, records) if window is None else window, hold)
                if not anyway:  # else said by the diagnosis itself
                    refuse_implausible(axis, record, f"{label}[{name!r}]")
        except ValueError as problem:
            problem.add_note(f"in {label}[{name!r}]")
            results[name] = problem
            continue
        data: list[Any] = []
        for r in records:
            data += [r.t, r.u, r.x, r.reference, r.quantum, r.good]
        data += [r.known_load for r in records if r.known_load is not None]
        cases[name, fingerprint(*data, *more), *own(axis)] = axis, records, *more
    raise_failures(results, all_only=True)
    found = run_batch(
        function,
        cases,
        store=store,
        settings={
            "version": __version__,
            "window": None if window is None else float(window),
            "hold": hold,
            **settings,
        },
        jobs=jobs,
        progress=progress,
        failures="return",
    )
    return results | {key[0]: result for key, result in found.items()}


def _diagnose_case(
    window: float | None,
    hold: str,
    anyway: bool,
    case: tuple[FrictionAxis, tuple[Record, ...]],
) -> dict[str, Any]:
    axis, (record,) = case
    # Records already run in parallel.
    options: dict[str, Any] = {"window": window, "hold": hold, "anyway": anyway}
    return diagnose(axis, record, jobs=1, progress=False, **options).to_dict()
