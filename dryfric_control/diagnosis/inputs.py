"""How the recorded inputs act: noise that was recorded with them, leads, imposed motion."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import cast

import numpy as np

from dryfric_control.diagnosis import thresholds
from dryfric_control.diagnosis.candidates import (
    catalogue,
    effect_class,
    forms,
    holds,
    own_names,
    with_effect,
    with_held,
)
from dryfric_control.diagnosis.criterion import evidence
from dryfric_control.diagnosis.linearised import Linearised
from dryfric_control.diagnosis.problem import BIAS_FORCE, Problem, each_of, noises_of
from dryfric_control.diagnosis.search import Model, Search
from dryfric_control.estimation.force_view import ForceRun, ForceView, prepare_force
from dryfric_control.estimation.input_noise import without_noise
from dryfric_control.estimation.likelihood import Run
from dryfric_control.estimation.parameters import SHIFT
from dryfric_control.estimation.scoring import (
    COMPARISON_ITERATIONS,
    FINAL_ITERATIONS,
    FIRST_ITERATIONS,
    maximise,
)
from dryfric_control.estimation.solution import Solution
from dryfric_control.model.effects.columns import View
from dryfric_control.records.motion import ONE_VELOCITY, usual_speeds

# Number of shapes of a contact whose fit goes on after the first steps of all.
_CONTINUED_SHAPES = 2


def denoised_inputs(
    problem: Problem, recorded: Sequence[Run], fit: Solution, most: bool
) -> Problem:
    """The problem with as little, or as much (`most`), noise taken off its inputs as is likely.

    Measurement noise of the input does not act on the axis.  Left in, it would count as random
    force, and a lag that filters it would seem to be a cause.
    """
    if problem.is_overdue:
        return problem
    found = {0.0: tuple(recorded)}
    force = fit.largest_force
    for width in thresholds.INPUT_NOISE_WIDTHS[1:]:
        runs = tuple(replace(r, u=without_noise(r.u, width)) for r in recorded)
        off = [a.u - b.u for a, b in zip(recorded, runs, strict=True)]
        white = all(e[1:] @ e[:-1] <= thresholds.MAX_LAG_ONE_CORRELATION * (e @ e) for e in off)
        # Noise far below the random force makes no difference.
        if white and any(np.std(e) > thresholds.MIN_INPUT_NOISE_RATIO * force for e in off):
            found[width] = runs
    if problem.is_imposed or len(found) == 1:
        same = problem.is_imposed or problem.runs == tuple(recorded)
        return problem if same else replace(problem, runs=tuple(recorded))
    shift = fit.values().get(SHIFT)

    def cost(runs: tuple[Run, ...]) -> float:
        one = replace(problem, runs=runs, shift=shift)
        return one.reference(fit.axis, noises=noises_of(fit)).cost

    costs = dict(zip(found, problem.parallel(cost, found.values()), strict=True))
    enough = min(costs.values()) + thresholds.FIT_SLACK
    widths = [width for width, cost in costs.items() if cost < enough]
    runs = found[max(widths) if most else min(widths)]
    return problem if runs == problem.runs else replace(problem, runs=runs)


def as_recorded(fit: Solution, recorded: Sequence[Run]) -> Solution:
    """The fit on inputs as recorded, with only the noises fitted again."""
    runs = [replace(r, u=one.u) for r, one in zip(fit.problem.runs, recorded, strict=True)]
    if all(np.array_equal(a.u, b.u) for a, b in zip(runs, fit.problem.runs, strict=True)):
        return fit
    problem = fit.problem.on(runs)
    known = slice(len(fit.problem.names))
    problem.low, problem.high = problem.low.copy(), problem.high.copy()
    problem.low[known] = problem.high[known] = fit.z[known]
    return maximise(problem, fit.z, 12)


def with_input_lead(problem: Problem, fit: Solution) -> tuple[Problem, Solution] | None:
    """The problem and fit with inputs that act before their time stamps, if data require it."""
    if problem.is_imposed or problem.shift is not None:
        return None
    if any(e.action in ("delay", "lag") for e in fit.axis.effects):
        return None
    free = problem.free_of(fit)
    dt = problem.scales.step
    costs = {}
    for samples in thresholds.INPUT_LEADS:
        one = replace(problem, shift=-samples * dt)
        likelihood = one.likelihood(fit.axis, free, each=each_of(fit))
        costs[samples] = likelihood.tried(likelihood.start(noises=noises_of(fit))).cost
    # Parameters may have compensated for the lead, so no cost needs to be lower yet.
    with_lead = replace(problem, shift=-min(costs, key=costs.__getitem__) * dt)
    found = with_lead.fit(fit.axis, free, noises_of(fit), COMPARISON_ITERATIONS, each=each_of(fit))
    shift = found.values()[SHIFT]
    sure = shift < -max(
        thresholds.MIN_STANDARD_ERRORS * found.standard_errors()[SHIFT],
        thresholds.MIN_VISIBLE_DELAY * dt,
    )
    if sure and evidence(fit, found) > 0.0:
        return replace(with_lead, shift=shift), found
    return None


def imposed_search(problem: Problem, tell: Callable[..., None]) -> Search | None:
    """A search in the view of the force; None if the drive is not what the motion requires."""
    runs = tuple(prepare_force(r.record, problem.hold, r.load_errors) for r in problem.runs)
    force = replace(problem, runs=runs, view=ForceView)
    fit = Search(force).fit_nominal()
    if len(runs) > 1:
        force, fit = _per_record_problem(force, fit)
    if _one_velocity(force):
        force = replace(force, steady=True)
        fit = Search(force).fit_nominal()
    search = Search(force, tell, now=Model(fit))
    # An effect such as gravity may make up most of the required force.
    if _matches_force(fit) or any(
        _matches_force(r.fit) for r in search.round(search.now) if not r.reason
    ):
        return search
    return None


def driven_model(
    problem: Problem, begun: Solution, found: Model, builds_up: bool = True
) -> Model | None:
    """The axis with the causes that its force shows, where these make its drive move it.

    A drive that holds an axis near breakaway bends its contact, where a rigid one predicts no
    motion: so with an elastic contact, too, where friction `builds_up` after reversals, unless the
    nominal axis has one.
    """
    free = problem.free_of(found.fit)
    axis = found.fit.axis
    try:
        fit = problem.fit(axis, free, turns=COMPARISON_ITERATIONS)
    except ValueError:
        return None
    bending = (n for n in catalogue(problem.believed) if effect_class(n).action == "contact")
    name = next((n for n in bending if not holds(problem.believed, n)), None)
    if builds_up and name is not None:
        view = cast(View, Linearised(problem, begun.problem, begun.z))
        # Fits find the way from one shape to the next but one.
        starts = [
            forms(with_effect(axis, name, shape.values((1.0,))).axis, [name])[-1]
            for shape in [*effect_class(name).columns(view)][1::2]
        ]
        own = with_held(starts[0], [name], (*free, *own_names(name)))
        part = replace(problem, runs=problem.fast_stretches)
        fits = problem.parallel(lambda start: part.fit(start, own, turns=FIRST_ITERATIONS), starts)
        fits = problem.parallel(
            lambda fit: problem.fit(fit.axis, own, noises_of(fit), FINAL_ITERATIONS),
            sorted(fits, key=lambda fit: fit.largest_force)[:_CONTINUED_SHAPES],
        )
        # With a large random force the filter follows the readings, whatever the model.
        fits = [s for s in fits if not problem.behind_line(s)]
        if fits:
            best = min(fits, key=lambda s: s.largest_force)
            return Model(best, tuple(dict.fromkeys((*found.causes, name))))
    return Model(fit, found.causes) if problem.clear_of_line(fit) else None


def _per_record_problem(problem: Problem, now: Solution) -> tuple[Problem, Solution]:
    """The problem with a Coulomb level and offset per record, where the records differ."""
    for names in ((BIAS_FORCE, "coulomb"), ("coulomb",)):
        if "coulomb" not in problem.base or not set(names).isdisjoint(problem.known):
            continue
        also, own = (tuple(dict.fromkeys((*some, *names))) for some in (problem.also, problem.own))
        one = replace(problem, also=also, own=own)
        fit = Search(one).fit_nominal()
        # A cause that is still missing correlates what is left, whatever differs between records.
        fall = now.held_out() - fit.held_out()
        penalty = 0.5 * math.log(one.samples) * len(names) * len(one.runs)
        if float(fall[np.isfinite(fall)].sum()) > thresholds.MIN_EVIDENCE + penalty:
            return one, fit
    return problem, now


def _one_velocity(problem: Problem) -> bool:
    """Whether each direction has nearly one velocity, in each record that has its own level."""
    # Then only the samples next to the turns separate what depends on velocity from the level.
    motions = [run.sliding.v for run in problem.runs if isinstance(run, ForceRun)]
    if "coulomb" not in problem.own:
        motions = [np.concatenate(motions)]
    speeds = [usual_speeds(v[s * v > 0.0]) for v in motions for s in (1.0, -1.0)]
    return all(fast < ONE_VELOCITY * slow for slow, fast in speeds if fast > 0.0)


def _matches_force(fit: Solution) -> bool:
    """Whether the drive, but for its mean, matches the required force of each record."""
    drives = [float(np.std(run.u)) or run.drive for run in fit.problem.runs]
    return (
        max(fit.random_force(i) / drive for i, drive in enumerate(drives))
        < thresholds.MAX_IMPOSED_FORCE_RATIO
    )
