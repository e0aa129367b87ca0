"""Base parameters with an error as causes, and the effects that are equivalent to them."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from dryfric_control.diagnosis.candidates import SLUGS, Start, with_effect
from dryfric_control.diagnosis.causes import cause_of
from dryfric_control.diagnosis.causes_found import State
from dryfric_control.diagnosis.gain_or_base import GAIN, or_a_gain
from dryfric_control.diagnosis.held_out import CLEAR
from dryfric_control.diagnosis.likelihood_search import EQUAL, Search
from dryfric_control.diagnosis.report.findings import Cause
from dryfric_control.estimation.parameters import with_values
from dryfric_control.estimation.solution import Solution
from dryfric_control.model.effects.levels import carrying
from dryfric_control.model.effects.naming import class_of

# Relative error of a base parameter up to which it counts as right.
_RIGHT = 0.004
# RMS force of a base-parameter error, as a fraction of the random force, from which it is named.
_NOTABLE = 0.25
# The effect that is equivalent to an input gain if the drive never brakes, and the iterations of
# a fit with it.
_LOAD, _LOAD_TURNS = "load_dependence", 10


def wrong_base(search: Search, final: Solution, kept: Sequence[str], random: float) -> list[Cause]:
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


def or_equivalents(
    search: Search, state: State, final: Solution, wrong: list[Cause]
) -> list[Cause]:
    """Wrong base parameters, with the equivalent gain as alternative if all are wrong.

    Load-dependent friction is equivalent too, if the drive never brakes.
    """
    if not search.gain_is_open or GAIN in state.causes:
        return wrong

    def scales(cause: Cause) -> tuple[str, ...]:
        alike = _load_does_the_same(search, state, final, *cause.parameters)
        return (GAIN, _LOAD) if alike else (GAIN,)

    return or_a_gain(search.believed, wrong, scales)


def _load_does_the_same(search: Search, state: State, final: Solution, held: str) -> bool:
    """Whether load-dependent friction, with base parameter `held` at nominal, fits as well."""
    if class_of(_LOAD) is None or _LOAD in state.causes or search.late:
        return False
    start = _with_a_load(search, state, final, held)
    if start is None:
        return False
    base = [n for n in search.base if n != held]
    noises = final.z[len(final.problem.names) :]
    runs, free = final.problem.runs, (*state.names, *start.free)
    fit = search.fit(start.axis, free, noises, _LOAD_TURNS, runs=runs, base=base)
    costs = [one.cost - one.problem.prior(one.z) for one in (fit, final)]
    return costs[0] < costs[1] + EQUAL


def _with_a_load(search: Search, state: State, final: Solution, held: str) -> Start | None:
    """The axis with load-dependent friction that moves alike while its drive does not brake.

    The base parameter `held` is then as in the nominal axis.
    """
    values, nominal = final.values(), search.nominal[held]
    shares = [p.name for p in final.problem.parameters if p.kind == "share"]
    scale = nominal / values[held]
    if held == "mass" and shares:  # of the load in the mass
        scale = 1.0 - (1.0 - scale) / values[shares[0]]
    if not 0.0 < scale < 1.0:
        return None
    changed = {n: v for n, v in carrying(final.axis, scale).items() if n in values}
    axis = with_values(final.axis, [*changed], [*changed.values()])
    return with_effect(axis, _LOAD, {"coefficient": 1.0 - scale})


def _sizes(search: Search) -> dict[str, float]:
    """RMS force per unit of each base parameter."""
    smooth = [r.derivatives() for r in search.records]
    v = np.concatenate([one.v for one in smooth])
    a = np.concatenate([one.a for one in smooth])
    return {
        "mass": float(np.sqrt(np.mean(a**2))), "viscous": float(np.sqrt(np.mean(v**2))),
        "coulomb": 1.0,
    }  # fmt: skip
