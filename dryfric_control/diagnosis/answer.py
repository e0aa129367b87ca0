"""From the model that a search has found to the causes, as a user reads them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from dryfric_control.diagnosis.candidates import SLUGS
from dryfric_control.diagnosis.causes import GAIN, cause_of, every, left_open, or_a_gain
from dryfric_control.diagnosis.problem import Problem, each_of, noises_of
from dryfric_control.diagnosis.report.findings import Cause
from dryfric_control.diagnosis.search import Model, Search, evidence
from dryfric_control.diagnosis.thresholds import CLEAR, EQUAL, NOTABLE, RIGHT
from dryfric_control.estimation.likelihood import BASE
from dryfric_control.estimation.parameters import with_values
from dryfric_control.estimation.scoring import FEW, SOME
from dryfric_control.estimation.solution import Solution
from dryfric_control.model.effects.effect import REGISTRY
from dryfric_control.model.effects.levels import carrying

#: The effect that is equivalent to an input gain where the drive never brakes.
_LOAD = "load_dependence"


def causes_of(
    search: Search, model: Model, final: Solution, rivals: dict[str, dict[str, Solution]]
) -> list[Cause]:
    """Causes of a model in the order found, and wrong base parameters."""
    problem = search.problem
    units = {p.name: p.unit for p in final.problem.parameters}
    values, errors = final.values(), final.standard_errors()
    gain_open = left_open(problem.believed, {*problem.known, *problem.tolerance})
    found = []
    for name in model.causes:
        own = {n.partition(".")[2]: n for n in model.own(name) if n in values}
        less = search.less_by(name)
        fall = np.zeros(1)
        if less is not None and less.fit.point.out:
            fall = less.fit.held_out() - model.fit.held_out()
        fall = fall[np.isfinite(fall)]
        size = 2.0 / problem.samples
        gain = size * float(fall.sum()), size * float(np.std(fall) * math.sqrt(fall.size))
        others = [*rivals.get(name, ())]
        if name == GAIN and gain_open:
            others.append("+".join(every(problem.believed)))
        found.append(cause_of(problem.believed, name, own, values, errors, units, gain, others))
    return found + _wrong_base(search, model, final)


def _wrong_base(search: Search, model: Model, final: Solution) -> list[Cause]:
    """Base parameters with a notable and significant error, as causes."""
    problem = search.problem
    values, errors = final.values(), final.standard_errors()
    units = {p.name: p.unit for p in final.problem.parameters}
    found = []
    for name in (n for n in problem.base if n in values):
        nominal = problem.nominal[name]
        effect, _, part = name.partition(".")
        change = values[name] - nominal
        if abs(change) <= RIGHT * abs(nominal) or abs(change) < CLEAR * errors[name]:
            continue
        if abs(change) * _size(search, name) < NOTABLE * final.random_force():
            continue
        if part and effect in model.causes:
            continue
        # Quadratic for a small change; logarithmic for a large one, as without it the random
        # force would grow.
        wald = (change / max(errors[name], 1e-300)) ** 2
        gain = math.log1p(wald / problem.samples)
        error = 2.0 * math.sqrt(wald) / (problem.samples + wald)
        slug, own = (effect, {part: name}) if part else (SLUGS[name], {name: name})
        cause = cause_of(problem.believed, slug, own, values, errors, units, (gain, error))
        found.append((gain, cause))
    wrong = [cause for _, cause in sorted(found, key=lambda one: -one[0])]
    told = {*problem.known, *problem.tolerance}
    if GAIN in model.causes or not left_open(problem.believed, told):
        return wrong

    def scales(cause: Cause) -> tuple[str, ...]:
        alike = _load_does_the_same(problem, model, final, *cause.parameters)
        return (GAIN, _LOAD) if alike else (GAIN,)

    wrong = or_a_gain(problem.believed, wrong, scales)
    if len(wrong) == 1 and not model.causes:
        # One wrong base parameter may be an effect that was not needed beside it.
        others = (*wrong[0].alternatives, *_instead(search, final, wrong[0]))
        return [replace(wrong[0], alternatives=others)]
    return wrong


def _instead(search: Search, final: Solution, cause: Cause) -> tuple[str, ...]:
    """Effects that explain the records as well as one wrong base parameter, held at nominal."""
    problem = replace(search.problem, known=(*search.problem.known, *cause.parameters))
    other = Search(problem, odds=dict(search.odds))
    rows = other.round(Model(other.alone()))
    alone = (row for row in rows if len(row.names) == 1 and not row.reason)
    return tuple(row.names[0] for row in alone if row.fit.cost < final.cost + EQUAL)


def _load_does_the_same(problem: Problem, model: Model, final: Solution, held: str) -> bool:
    """Whether load-dependent friction, with base parameter `held` at nominal, fits as well."""
    if _LOAD not in REGISTRY or _LOAD in model.causes or problem.late:
        return False
    values, nominal = final.values(), problem.nominal[held]
    shares = [p.name for p in final.problem.parameters if p.kind == "share"]
    scale = nominal / values[held]
    if held == "mass" and shares:  # of the load in the mass
        scale = 1.0 - (1.0 - scale) / values[shares[0]]
    if not 0.0 < scale < 1.0:
        return False
    changed = {n: v for n, v in carrying(final.axis, scale).items() if n in values}
    axis = with_values(final.axis, [*changed], [*changed.values()])
    axis = axis.replace(effects=(*axis.effects, REGISTRY[_LOAD](**{"coefficient": 1.0 - scale})))
    base = [n for n in problem.base if n != held]
    free = (*problem.free_of(final), f"{_LOAD}.coefficient")
    fit = problem.fit(axis, free, noises_of(final), SOME, base=base, each=each_of(final))
    costs = [one.cost - one.problem.prior(one.z) for one in (fit, final)]
    return costs[0] < costs[1] + EQUAL


def _size(search: Search, name: str) -> float:
    """RMS force per unit of a base parameter, or of an amount of a nominal effect."""
    if name not in BASE:
        return math.inf if search.view is None else search.view.force_per_unit(name)
    if name == "coulomb":
        return 1.0
    smooth = [r.record.derivatives() for r in search.problem.runs]
    rows = [one.a if name == "mass" else one.v for one in smooth]
    return float(np.sqrt(np.mean(np.concatenate(rows) ** 2)))


def varying(
    problem: Problem, final: Solution
) -> tuple[dict[str, dict[str, list[float]]], Solution, Problem]:
    """Parameters that differ between records, with standard errors, and the fit with them."""
    count = len(problem.runs)
    now, own = final, list(problem.own)
    free = problem.free_of(final)
    names = [n for n in dict.fromkeys((*BASE, *free)) if n not in problem.known]
    penalty = 0.5 * math.log(problem.samples) * (count - 1)
    while count > 1 and not problem.late:
        best: tuple[float, str, Solution] | None = None
        for name in (n for n in names if n not in own):
            one = replace(problem, own=(*own, name))
            base = [n for n in BASE if n in names and (n in final.problem.names or n == name)]
            settings = {"base": base, "wonder": False, "each": each_of(now)}
            # Most parameters do not differ; a few iterations show it.
            fit = one.fit(final.axis, free, noises_of(final), FEW, **settings)
            if now.cost - fit.cost + 3.0 * fit.promised < penalty:
                continue
            fit = one.fit(fit.axis, free, noises_of(fit), SOME, **settings | {"each": each_of(fit)})
            worth = evidence(now, fit, [penalty])
            if worth > (best[0] if best else 0.0) and _separate(now, fit):
                best = worth, name, fit
        if best is None:
            break
        own.append(best[1])
        now = best[2]
    both = {"values": now.values(), "standard_errors": now.standard_errors()}
    table = {
        n: {what: [found[f"{n}@{i}"] for i in range(count)] for what, found in both.items()}
        for n in own
    }
    return table, now, replace(problem, own=tuple(own))


def _separate(less: Solution, more: Solution) -> bool:
    """Whether a further record-specific parameter leaves the others determined, and is itself."""
    before, after, values = less.standard_errors(), more.standard_errors(), more.values()
    new = [n for n in after if "@" in n and n not in before]
    differ = float(np.ptp([values[n] for n in new]))
    known = all(after[n] < 2.0 * before[n] for n in before if "@" in n)
    return known and all(CLEAR * after[n] < differ for n in new)
