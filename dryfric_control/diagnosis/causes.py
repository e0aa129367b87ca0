"""From the model that a search has found to the causes, as a user reads them."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from dryfric_control.diagnosis.candidates import SLUGS, effect_class, holds
from dryfric_control.diagnosis.criterion import evidence, prior_of
from dryfric_control.diagnosis.problem import BIAS_FORCE, Problem, each_of, noises_of
from dryfric_control.diagnosis.report.findings import Cause
from dryfric_control.diagnosis.search import Model, Search
from dryfric_control.diagnosis.thresholds import (
    EQUAL_EVIDENCE,
    MAX_RIGHT_ERROR,
    MAX_SAME_RESIDUAL,
    MIN_EVIDENCE,
    MIN_FORCE_TO_NOISE_RATIO,
    MIN_STANDARD_ERRORS,
)
from dryfric_control.estimation.likelihood import BASE, BASE_LOG_DEVIATION
from dryfric_control.estimation.parameters import values_of, with_values
from dryfric_control.estimation.random_force import long_run
from dryfric_control.estimation.scoring import COMPARISON_ITERATIONS, FIRST_ITERATIONS, maximise
from dryfric_control.estimation.solution import Solution
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.model.effects import InputGain
from dryfric_control.model.effects.effect import REGISTRY
from dryfric_control.model.effects.levels import equivalent_values
from dryfric_control.model.effects.naming import named, title_of
from dryfric_control.text import rotary_words

#: The effect that scales every force of the drive.
GAIN = "input_gain"
# The effect that is equivalent to it where the drive never brakes.
_LOAD = "load_dependence"
# Ratio of standard error to value beyond which a record hardly determines a parameter.
_MAX_RELATIVE_ERROR = 0.3


def cause_of(
    axis: FrictionAxis,
    slug: str,
    own: Mapping[str, str],
    fitted: Mapping[str, tuple[float, float, str]],
    gain: tuple[float, float],
    alternatives: Sequence[str] = (),
) -> Cause:
    """Cause `slug` from the results of a fit.

    `own`: names of its parameters, mapped to those in the fit; `fitted`: value, standard error and
    unit by the latter; `gain`: on held-out data, with its standard error.
    """
    effect = effect_class(slug)
    texts = title_of(slug), effect.explanation, effect.experiment
    title, explanation, experiment = (rotary_words(text, axis.units[1]) for text in texts)
    if holds(axis, slug):
        explanation = f"Already in the nominal axis, with other values. {explanation}"
    values = {short: fitted[name][0] for short, name in own.items()}
    errors = {short: fitted[name][1] for short, name in own.items()}
    units = {short: fitted[name][2] for short, name in own.items()}
    mean, error = gain
    interval = mean - 1.645 * error, mean + 1.645 * error
    others = tuple(alternatives)
    return Cause(
        slug, title, values, errors, units, mean, interval, others, explanation, experiment
    )


def hardly_determined(axis: FrictionAxis, causes: Sequence[Cause]) -> list[str]:
    """A message for each parameter that is hardly determined, beside its or the nominal value."""
    messages = []
    present = named(axis)
    for cause in causes:
        if effect_class(cause.effect).any_shape:
            continue  # its curve is known, whichever coefficient is next to nothing
        kinds = effect_class(cause.effect).parameters()
        for name, value in cause.parameters.items():
            if kinds.get(name, {}).get("kind") in ("place", "angle"):
                continue
            nominal = getattr(present.get(cause.effect), name, 0.0)
            if not cause.standard_errors[name] <= _MAX_RELATIVE_ERROR * max(
                abs(value), abs(nominal)
            ):
                # A base parameter and its cause may have the same name.
                full = name if name == cause.effect else f"{cause.effect}.{name}"
                messages.append(f"{full} is hardly determined by this record")
    return messages


def causes_of(
    search: Search, model: Model, final: Solution, rivals: dict[str, dict[str, Solution]]
) -> list[Cause]:
    """Causes of a model, those with most evidence first, and wrong base parameters."""
    problem = search.problem
    errors = final.standard_errors()
    units = {p.name: p.unit for p in final.problem.parameters}
    if problem.scale_open:
        errors |= {
            n: math.hypot(errors[n], BASE_LOG_DEVIATION * abs(v))
            for n, v in scaling_with_gain(final)
        }
    fitted = {n: (v, errors[n], units.get(n, "")) for n, v in final.values().items()}
    # Motion depends only on the ratio of all forces to a gain: nothing separates it from errors of
    # base parameters that together scale the others, if none of them is known.
    sure = {*problem.known, *problem.tolerance}
    gain_open = not problem.believed.effects and not sure & {*SLUGS, f"{GAIN}.gain"}
    every = [SLUGS[n] for n in SLUGS if float(values_of(problem.believed, [n])[0]) > 0.0]
    alternatives = {name: [*rivals.get(name, ())] for name in model.causes}
    if GAIN in alternatives and gain_open:
        alternatives[GAIN].append("+".join(every))
    found = _effects_of(search, model, fitted, alternatives)
    wrong = _wrong_base(search, model, final, fitted)
    if GAIN in model.causes or not gain_open:
        return found + wrong
    _name_scales(search, model, final, wrong, every)
    if len(wrong) == 1 and not model.causes:
        # One wrong base parameter may be an effect that was not needed beside it.
        others = [*wrong[0].alternatives, *_alternative_effects(search, final, wrong[0])]
        return [replace(wrong[0], alternatives=tuple(others))]
    return found + wrong


def _effects_of(
    search: Search,
    model: Model,
    fitted: Mapping[str, tuple[float, float, str]],
    alternatives: Mapping[str, Sequence[str]],
) -> list[Cause]:
    """The effects of a model as causes, those with most evidence first."""
    problem = search.problem
    found = []
    for name in sorted(model.causes, key=lambda n: -model.worth.get(n, 0.0)):
        own = {n.partition(".")[2]: n for n in model.cause_parameters(name) if n in fitted}
        less = model.less.get(name)
        fall = np.zeros(1)
        if less is not None and less.fit.point.out:
            fall = less.fit.held_out() - model.fit.held_out()
        fall = fall[np.isfinite(fall)]
        size = 2.0 / problem.samples
        gain = size * float(fall.sum()), size * float(np.std(fall) * math.sqrt(fall.size))
        found.append(cause_of(problem.believed, name, own, fitted, gain, alternatives[name]))
    return found


def _name_scales(
    search: Search, model: Model, final: Solution, wrong: list[Cause], every: Sequence[str]
) -> None:
    """Name a gain of the drive as an alternative of base parameters that are all wrong.

    A scale brings one of them back to nominal; a value of zero cannot be scaled.
    """
    slugs = [cause.effect for cause in wrong]
    for i, cause in enumerate(wrong):
        if {*every} <= {*slugs} and cause.effect in every and all(cause.parameters.values()):
            alike = _load_does_the_same(search.problem, model, final, *cause.parameters)
            rest = [c.effect for c in wrong if _differ_in_scale(search.problem, c, cause)]
            scales = ["+".join([one, *rest]) for one in (GAIN, _LOAD)[: 1 + alike]]
            wrong[i] = replace(cause, alternatives=(*cause.alternatives, *scales))


def scaling_with_gain(fit: Solution) -> list[tuple[str, float]]:
    """Parameters of a fit that are forces or per unit of force, with their values.

    Motion depends only on their ratios to the gain of the drive.
    """
    found = []
    for p, (name, value) in zip(fit.problem.parameters, fit.values().items(), strict=False):
        if p.name in BASE or p.unit[:1] == "N" or p.unit[:2] == "kg":
            found.append((name, value))
    return found


def _wrong_base(
    search: Search, model: Model, final: Solution, fitted: Mapping[str, tuple[float, float, str]]
) -> list[Cause]:
    """Base parameters with a notable and significant error, as causes."""
    problem = search.problem
    found = []
    for name in (n for n in problem.base if n in fitted):
        nominal, (value, spread, _) = problem.nominal[name], fitted[name]
        effect, _, part = name.partition(".")
        change = value - nominal
        if (
            _is_hidden(search, final, name, change)
            or abs(change) < MIN_STANDARD_ERRORS * spread
            or (part and effect in model.causes)
        ):
            continue
        # Quadratic for a small change; logarithmic for a large one, as without it the random
        # force would grow.
        wald = (change / max(spread, 1e-300)) ** 2
        gain = math.log1p(wald / problem.samples)
        error = 2.0 * math.sqrt(wald) / (problem.samples + wald)
        slug, own = (effect, {part: name}) if part else (SLUGS[name], {name: name})
        found.append((gain, cause_of(problem.believed, slug, own, fitted, (gain, error))))
    return [cause for _, cause in sorted(found, key=lambda one: -one[0])]


def _is_hidden(search: Search, final: Solution, name: str, change: float) -> bool:
    """Whether a change of a base parameter is too small, or its force beside the random one."""
    noise = MIN_FORCE_TO_NOISE_RATIO * final.random_force()
    right = MAX_RIGHT_ERROR * abs(search.problem.nominal[name])
    return abs(change) <= right or abs(change) * _size(search, name) < noise


def _differ_in_scale(problem: Problem, *two: Cause) -> bool:
    """Whether two values are off by different factors: the same one brings both to nominal."""
    ratios = []
    errors = []
    for cause in two:
        ((name, value),) = cause.parameters.items()
        unit = problem.nominal.get(name) or 1e-300
        ratios.append(value / unit)
        errors.append(cause.standard_errors[name] / unit)
    return abs(ratios[0] - ratios[1]) > max(
        MAX_RIGHT_ERROR, MIN_STANDARD_ERRORS * math.hypot(*errors)
    )


def _alternative_effects(search: Search, final: Solution, cause: Cause) -> tuple[str, ...]:
    """Effects that explain the records as well as one wrong base parameter, held at nominal."""
    problem = replace(search.problem, known=(*search.problem.known, *cause.parameters))
    other = Search(problem, odds=dict(search.odds))
    among = other.rivals_of_base(final)
    rows = other.round(Model(other.fit_nominal()), final, among) if among else []
    alone = (row for row in rows if len(row.names) == 1 and not row.reason)
    return tuple(row.names[0] for row in alone if row.fit.cost < final.cost + EQUAL_EVIDENCE)


def _load_does_the_same(problem: Problem, model: Model, final: Solution, held: str) -> bool:
    """Whether load-dependent friction, with base parameter `held` at nominal, fits as well."""
    if _LOAD not in REGISTRY or _LOAD in model.causes or problem.is_overdue:
        return False
    values = final.values()
    nominal = problem.nominal[held]
    shares = [p.name for p in final.problem.parameters if p.kind == "share"]
    scale = nominal / values[held]
    if held == "mass" and shares:  # of the load in the mass
        scale = 1.0 - (1.0 - scale) / values[shares[0]]
    if not 0.0 < scale < 1.0:
        return False
    changed = {n: v for n, v in equivalent_values(final.axis, scale).items() if n in values}
    axis = with_values(final.axis, [*changed], [*changed.values()])
    axis = axis.replace(effects=(*axis.effects, REGISTRY[_LOAD](**{"coefficient": 1.0 - scale})))
    base = [n for n in problem.base if n != held]
    free = (*problem.free_of(final), f"{_LOAD}.coefficient")
    likelihood = problem.likelihood(axis, free, base=base, each=each_of(final))
    start = likelihood.start(noises=noises_of(final))
    enough = final.cost - prior_of(final) + EQUAL_EVIDENCE
    than = enough + likelihood.prior(start)
    fit = maximise(likelihood, start, COMPARISON_ITERATIONS, problem.until, than=than)
    return fit.cost - prior_of(fit) < enough


def _size(search: Search, name: str) -> float:
    """RMS force per unit of a base parameter, or of an amount of a nominal effect."""
    if name not in BASE:
        return math.inf if search.view is None else search.view.force_per_unit(name)
    if name == "coulomb":
        return 1.0
    smooth = [r.record.derivatives() for r in search.problem.runs]
    rows = [one.a if name == "mass" else one.v for one in smooth]
    return float(np.sqrt(np.mean(np.concatenate(rows) ** 2)))


def varying_parameters(
    problem: Problem, final: Solution, also: Sequence[str]
) -> tuple[dict[str, dict[str, list[float]]], Solution]:
    """Parameters that differ between records, with standard errors, and the fit with them.

    Of the base, a constant force, such as the weight of a load, and of what may differ `also`.
    """
    count = len(problem.runs)
    now = final
    own = problem.own
    while count > 1 and not problem.is_overdue:
        best = _next_varying(with_own(problem, final, own), final, now, also)
        if best is None:
            break
        own = (*own, best[0])
        now = best[1]
    both = {"values": now.values(), "standard_errors": now.standard_errors()}
    table = {
        n: {what: [found[f"{n}@{i}"] for i in range(count)] for what, found in both.items()}
        for n in own
    }
    return table, now


def _penalty(problem: Problem, count: int) -> float:
    """Log-likelihood that so many more parameters must gain."""
    return 0.5 * math.log(problem.samples) * count


def with_own(problem: Problem, fit: Solution, own: Sequence[str]) -> Problem:
    """The problem with values of some parameters for each record; a bias force need not be one."""
    bias = BIAS_FORCE in own and BIAS_FORCE not in (*problem.also, *fit.problem.names)
    return replace(problem, own=tuple(own), also=(*problem.also, *(BIAS_FORCE,) * bias))


def with_weights_apart(problem: Problem) -> Problem:
    """The problem with a constant force for each record, where that alone tells a motion.

    Such as the weights of loads: they bend all that the records share before any cause is sought.
    """
    if len(problem.runs) < 2 or BIAS_FORCE in (*problem.known, *problem.also):
        return problem
    common = problem.fit(problem.believed, noises=noises_of(problem.nominal_fit))
    one = with_own(problem, common, (*problem.own, BIAS_FORCE))
    apart = one.fit(problem.believed, noises=noises_of(common))
    differ = one.clear_of_line(apart) and own_values_differ(problem, common, apart)
    return one if differ and _is_determined(common, apart) else problem


def own_values_differ(problem: Problem, common: Solution, apart: Solution) -> bool:
    """Whether values of each record explain more than common ones."""
    count = len(apart.problem.names) - len(common.problem.names)
    return evidence(common, apart, [_penalty(problem, count)]) > 0.0


def _next_varying(
    problem: Problem, final: Solution, now: Solution, also: Sequence[str]
) -> tuple[str, Solution] | None:
    """Parameter that differs most between records beside those that do in `now`, and its fit."""
    names = [n for n in (*BASE, BIAS_FORCE, *also) if n not in problem.known]
    most = 0.0
    best: tuple[str, Solution] | None = None
    for name in dict.fromkeys(names):
        if name in problem.own:
            continue
        one = with_own(problem, final, (*problem.own, name))
        penalty = _penalty(problem, len(problem.runs) - (name not in one.also))
        kept = [n for n in problem.base if n in final.problem.names]
        base = [*dict.fromkeys((*kept, *(n for n in BASE if n == name)))]
        fit = _varying_fit(one, final, now, base, penalty)
        if fit is None:
            continue
        worth = evidence(now, fit, [penalty])
        if worth > most and _is_determined(now, fit):
            most = worth
            best = name, fit
    return best


def _varying_fit(
    problem: Problem, final: Solution, now: Solution, base: Sequence[str], penalty: float
) -> Solution | None:
    """Fit with one more record-specific parameter than `now`; None if records do not need it."""
    refit = functools.partial(problem.fit, base=base, wonder=False)
    free = problem.free_of(final)
    # Most parameters do not differ; a few iterations show it.
    fit = refit(final.axis, free, noises_of(final), FIRST_ITERATIONS, each=each_of(now))
    if now.cost - fit.cost + 3.0 * fit.promised < penalty:
        return None
    return refit(fit.axis, free, noises_of(fit), COMPARISON_ITERATIONS, each=each_of(fit))


def _is_determined(less: Solution, more: Solution) -> bool:
    """Whether a further record-specific parameter leaves the others determined, and is itself."""
    before = less.standard_errors()
    after = more.standard_errors()
    values = more.values()
    new = [n for n in after if "@" in n and n not in before]
    differ = float(np.ptp([values[n] for n in new]))
    known = all(after[n] < 2.0 * before[n] for n in before if "@" in n)
    return known and all(MIN_STANDARD_ERRORS * after[n] < differ for n in new)


def changing_cause(search: Search, model: Model, final: Solution) -> str:
    """The cause or base parameter that differs most between the halves of the records, if any does.

    What differs by a part of its amount gains a quarter of that part's square of what it brings.
    A base parameter that differs by less than an error of it that would be named is the same.
    """
    falls = {"": search.problem.nominal_fit.cost - final.cost + prior_of(final)}
    own = {"": {*final.problem.names}} | {name: {name} for name in BASE}
    for name in model.causes:
        own[name], less = {*model.cause_parameters(name)}, model.less.get(name)
        if less is not None:
            falls[name] = less.fit.cost - prior_of(less.fit) - model.fit.cost + prior_of(model.fit)
    halves = {name: final.in_halves(names) for name, names in own.items()}
    gains = {name: final.cost - both.cost for name, (both, _) in halves.items()}
    apart = (
        gains[name]
        > max(
            long_run(halves[name][0]) * (MIN_EVIDENCE + len(own[name])),
            (0.5 * MAX_SAME_RESIDUAL) ** 2 * fall,
        )
        for name, fall in falls.items()
    )
    if not any(apart):
        return ""
    most = max(filter(None, own), key=gains.__getitem__)
    if most not in BASE:
        return most
    axes = (final.problem.axis_at(z) for z in halves[most][1])
    first, second = (values_of(axis, [most])[0] for axis in axes)
    return "" if _is_hidden(search, final, most, second - first) else most


def scale_forces(axis: FrictionAxis, scale: float) -> FrictionAxis:
    """The axis that moves alike: every force, and the gain of the drive, times `scale`."""
    gain = scale
    effects = []
    for effect in axis.effects:
        if isinstance(effect, InputGain):
            gain *= effect.gain
            continue
        forces = (n for n, about in effect.parameters().items() if about["unit"][:1] == "N")
        effects.append(replace(effect, **{n: scale * getattr(effect, n) for n in forces}))
    if not math.isclose(gain, 1.0):
        effects.insert(0, InputGain(gain))
    return axis.replace(
        mass=scale * axis.mass,
        viscous=scale * axis.viscous,
        coulomb=axis.coulomb.scaled(scale),
        effects=effects,
    )


def equivalent_axis(
    axis: FrictionAxis, believed: FrictionAxis, causes: Sequence[Cause]
) -> tuple[FrictionAxis, str, str] | None:
    """An axis that moves alike by another gain, and names of the cause and what replaces it."""
    # A dead zone, say, may come before or behind the gain.
    between = any(e.action == "input" and not isinstance(e, InputGain) for e in axis.effects)
    if between or GAIN not in REGISTRY:
        return None
    for cause in causes:
        for other in cause.alternatives:
            if cause.effect == GAIN and "+" in other:
                return scale_forces(axis, 1.0 / cause.parameters["gain"]), GAIN, other
            if other.split("+")[0] == GAIN and cause.effect in SLUGS.values():
                (value,), (nominal,) = (
                    values_of(a, tuple(cause.parameters)) for a in (axis, believed)
                )
                return scale_forces(axis, nominal / value), cause.effect, other
    return None
