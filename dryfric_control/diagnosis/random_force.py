"""Diagnosis by likelihood, for records in which a random force acts."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from dryfric_control.diagnosis.between_records import varying
from dryfric_control.diagnosis.causes import cause_of, hardly_determined
from dryfric_control.diagnosis.causes_found import State, without
from dryfric_control.diagnosis.confirmation import Judged, confirmed
from dryfric_control.diagnosis.explained import judge
from dryfric_control.diagnosis.forward_search import forward, resumed
from dryfric_control.diagnosis.gate import Gate
from dryfric_control.diagnosis.likelihood_search import STRAIGHT, Search
from dryfric_control.diagnosis.remaining import Remaining, remaining
from dryfric_control.diagnosis.report.findings import LATE, Cause, Gain, Unexplained
from dryfric_control.diagnosis.screening import Candidate
from dryfric_control.diagnosis.wrong_base import or_equivalents, wrong_base
from dryfric_control.estimation.solution import Solution
from dryfric_control.estimation.windows import Windows
from dryfric_control.model.axis import FrictionAxis

# Least random force without a cause, over that with it, where structure is left in the residual.
_LOUDER = 1.1
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
        return not judge(search)(search, cut(search.shift), search.as_recorded(fit))[1].significant

    search.free_runs = nothing_left
    state = forward(search, end=ends)
    if state is None:
        return None
    messages: list[str] = []
    until, search.until = search.until, search.end
    references = search.references()
    while True:
        refuted = {*state.refuted}
        final, kept, judged = confirmed(search, state)
        # In the place of a cause that unseen data do not confirm, another may be.
        if state.late or state.refuted == refuted or not resumed(search, state, until):
            break
    if state.late:
        messages.append(LATE)
    while True:
        search.tell("replays")
        windows = cut(search.shift)
        heard = search.as_recorded(final)
        motion, left, worse = judge(search)(search, windows, heard)
        # On all samples a cause may turn out not to be there.
        gone = [c for c in state.causes if search.vanished(final, c, state.free[c])]
        if gone and not search.late:
            state.drop(gone[0], without(search, state, gone[0]))
            final, kept, judged = confirmed(search, state)
            continue
        # Where structure is left, a cause that hardly lowers the random force may be false.
        # Where none is, it is not needed if few events confirm it and it leaves none either.
        quiet = [
            c for c in state.causes
            if judged[c].louder < _LOUDER and (left.significant or judged[c].held_out.few_events)
        ]  # fmt: skip
        quiet.sort(key=lambda c: judged[c].louder)
        fits = ((c, without(search, state, c)) for c in quiet if not search.late)
        fallen = next((one for one in fits if left.significant or nothing_left(one[1])), None)
        if fallen is None:
            break
        state.drop(*fallen)
        final, kept, judged = confirmed(search, state)
    better = [name for name, cost in references.items() if cost < final.cost]
    if worse:
        better.append("free runs of the nominal axis")
    if better and (state.causes or kept):
        messages.append(f"not better than {' and '.join(better)}: no causes are reported")
        state.causes.clear()
        state.free.clear()
        kept, final = [], search.reference(search.believed)
        heard = search.as_recorded(final)
        motion, left, _ = judge(search)(search, windows, heard)
    if references.get(STRAIGHT, math.inf) < final.cost:
        messages.append(LINE)
    left = _in_all(motion, left, messages)
    causes = [_cause(search, state, final, slug, judged[slug]) for slug in state.causes]
    causes += or_equivalents(
        search, state, final, wrong_base(search, final, kept, heard.random_force())
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


def _warnings(final: Solution, causes: Sequence[Cause]) -> list[str]:
    messages = []
    for name in final.at_bound:
        messages.append(f"{name} ended at a bound: the model does not fit, or the records do not "
                        "determine it")  # fmt: skip
    if not final.converged:
        messages.append(UNFINISHED)
    return [*messages, *hardly_determined(causes)]


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
    found.gain, left, _ = judge(search)(search, windows, heard)
    found.unexplained = left = _in_all(found.gain, left, found.messages)
    found.remaining = remaining(heard, left.significant, left.where, search.believed.units[1])
    found.verdict = _verdict([*found.causes, *found.varies], left, found.messages)
