"""What every answer must keep, whatever found it."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dryfric_control.arrays import Floats
from dryfric_control.diagnosis.candidates import (
    effect_class,
    free_amounts,
    is_within_records,
    repeat_apart,
)
from dryfric_control.diagnosis.problem import Problem, with_found_load
from dryfric_control.diagnosis.thresholds import MIN_EVIDENCE, NEGLIGIBLE_RATIO
from dryfric_control.estimation.force_residual import net_drive
from dryfric_control.estimation.solution import Solution
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.model.effects.naming import named
from dryfric_control.model.friction_curve import net_force
from dryfric_control.records.record import Record

# Slope of the log-likelihood with the logarithm of a parameter at a bound that presses it there.
_PRESSED = 1.0


def infeasible_reason(problem: Problem, fit: Solution, name: str, own: Sequence[str]) -> str:
    """Why no machine can have a cause with these values; empty if one may."""
    values = fit.values()
    here = {n: values[n] for n in own if n in values}
    records = [r.record for r in fit.problem.runs]
    effect = named(fit.axis).get(name)
    if effect is None:
        return "not in the model"
    if not is_within_records(here, records, problem.believed.travel):
        return "outside what the records show"
    axes = [fit.problem.axis_at(fit.z, i) for i in range(len(records))]
    if not all(named(axis)[name].plausible(axis) for axis in axes):
        return "implausible values"
    if min(_force_ratios(problem, fit, name), default=0.0) > 1.0:
        return "a larger force than any in the records"
    drives = [_drive(axis, name, run.u) for axis, run in zip(axes, fit.problem.runs, strict=True)]
    if not any(effect.beyond_noise(u, fit.random_force(i)) for i, u in enumerate(drives)):
        return "no different from noise of the drive"
    rows = zip(axes, fit.problem.runs, strict=True)
    if not any(named(axis)[name].told_from_drive(r.u, r.record.dt) for axis, r in rows):
        return "at a frequency of the drive, where any law of the motion has a force"
    if all(_is_like_another(axis, name, records) for axis in axes):
        return "no different from another of its kind within the records"
    return ""


def _is_like_another(axis: FrictionAxis, name: str, records: Sequence[Record]) -> bool:
    """Whether one of its kind before it repeats so alike that no record holds a beat of both."""
    effects = named(axis)
    return any(
        type(effects[other]) is type(effects[name])
        and not repeat_apart(effects[name], effects[other], records)
        for other in itertools.takewhile(lambda n: n != name, effects)
    )


def _force_ratios(problem: Problem, fit: Solution, name: str) -> list[float]:
    """Force of a cause over the largest of each record; none where the motion tells no force of it.

    Beyond it another one takes it back.  What it has beyond a nominal effect of its name counts.
    """
    effect = effect_class(name)
    if effect.action not in ("force", "friction") or effect.remembers:
        return []
    found = []
    for i, (motion, run) in enumerate(zip(problem.motions, problem.runs, strict=True)):
        axis = fit.problem.axis_at(fit.z, i)
        bare = problem.remove_effects(axis, name)
        way = motion.direction.astype(np.int64)
        forces = [
            net_force(one, run.record.t, motion.x, motion.v, run.u, way) for one in (axis, bare)
        ]
        drive = float(np.linalg.norm(run.u))
        inertia = float(np.linalg.norm(motion.a))
        force = float(np.linalg.norm((forces[0] - forces[1])[way != 0]))
        found.append(force / max(drive, problem.believed.mass * inertia, 1e-300))
    return found


def _drive(axis: FrictionAxis, name: str, u: Floats) -> Floats:
    """The drive as it comes to an effect: after those before it."""
    before = itertools.takewhile(lambda item: item[0] != name, named(axis).items())
    axis = axis.replace(effects=tuple(e for _, e in before if e in axis.effects))
    return net_drive(axis, np.zeros(u.size), np.zeros(u.size), u, ("input",))


def rejection_reason(problem: Problem, fit: Solution, name: str, own: Sequence[str]) -> str:
    """Why a cause cannot be one; empty if it may be."""
    reason = infeasible_reason(problem, fit, name, own)
    if reason:
        return reason
    if any(is_pressed_to_bound(fit, full) for full in own):
        return "ended at a bound"
    there: dict[bool, list[bool]] = {False: [], True: []}
    for full, neutral, optional in free_amounts(name, own):
        there[optional].append(_loss(fit, full, neutral) > MIN_EVIDENCE)
    if not (all(there[False]) or any(there[True])):
        return "not determined"
    return "smaller than laws of friction are right" if is_negligible(problem, fit, name) else ""


def is_negligible(problem: Problem, fit: Solution, name: str) -> bool:
    """Whether a cause is a force that is nothing beside those that move the axis."""
    return max(_force_ratios(problem, fit, name), default=math.inf) < NEGLIGIBLE_RATIO


def is_pressed_to_bound(fit: Solution, name: str) -> bool:
    """Whether data want a parameter beyond the bound at which it ended."""
    return name in fit.at_bound and _is_beyond_bound(fit, name)


def _is_beyond_bound(fit: Solution, name: str) -> bool:
    """Whether data want a parameter beyond its bound, rather than leave it open."""
    slopes = fit.gradients.sum(axis=0) if fit.gradients.size else np.full(fit.z.size, np.inf)
    own = np.array(fit.problem.names) == name
    return bool(np.any(np.abs(slopes[: own.size][own]) > _PRESSED))


def _loss(fit: Solution, name: str, neutral: float) -> float:
    """Log-likelihood that is lost without an amount, the other parameters as they are."""
    # Standard errors do not show it: where it acts at single events, differences have no slope.
    z = fit.z.copy()
    problem = fit.problem
    for j, p in enumerate(problem.parameters):
        z[j] = p.search(max(neutral, p.low)) if p.name == name else z[j]
    return problem.tried(np.clip(z, problem.low, problem.high)).cost - fit.cost


def in_free_runs(problem: Problem, less: Solution, more: Solution) -> tuple[float, float]:
    """Fall of the mean score of unseen free runs that a cause brings, and its standard error.

    Each model runs under the load that it was fitted with.
    """
    falls = []
    for i, w in enumerate(problem.windows):
        moving = w.moving
        if not problem.is_imposed and moving.any():
            pairs = [(replace(w, record=with_found_load(f, w.record, i)), f) for f in (less, more)]
            runs = [one.cross_validate(*fit.held_out_axes(i), moving) for one, fit in pairs]
            before, after = (w.scores(run.costs)[moving] for run in runs)
            falls.append(before - after)
    fall = np.concatenate(falls) if falls else np.zeros(0)
    fall = fall[np.isfinite(fall)]
    if not fall.size:
        # Of an imposed motion there are no free runs: the force alone must show the cause.
        return (0.0, 0.0) if problem.is_imposed else (math.inf, 0.0)
    return float(fall.mean()), float(fall.std() / math.sqrt(fall.size))
