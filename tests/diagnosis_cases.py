"""Blind cases for the diagnosis: from a case of the bench to a mark.

The bench of `truth` speaks its own language (an asymmetry relative to the
Coulomb level, a drag coefficient, a gravity phase of the other sign); here, and
nowhere else, both are translated.  `diagnose` itself gets (t, u, x) alone.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import numpy as np
from truth import Case

import dryfric_control as dfc
from dryfric_control.model.effects.effect import REGISTRY

#: Slug of a wrong base parameter and the parameter.
BASE = {"inertia": "mass", "viscous": "viscous", "coulomb": "coulomb"}

#: Truth parameter -> parameter of the package, where the name differs.
RENAMED = {
    ("coulomb_asymmetry", "asymmetry"): "force",
    ("quadratic_drag", "coefficient"): "drag",
    ("spring", "centre"): "rest",
    ("cogging", "pitch"): "period",
}


def believed(case: Case) -> dfc.FrictionAxis:
    """The axis that the user of the case believes in."""
    b = case.believed
    return dfc.FrictionAxis(
        mass=b["mass"], viscous=b["viscous"], coulomb=b["coulomb"],
        stribeck=dfc.Stribeck(**b["stribeck"]) if b["stribeck"] else None,
        stick_speed=b["stick_speed"], travel=b["travel"],
        units=("rad", "N m") if case.unit == "rad" else ("m", "N"),
    )  # fmt: skip


def machine(case: Case) -> dfc.FrictionAxis:
    """The axis as it is, its hidden effects under the package's names and parameters."""
    axis = believed(case).replace(**{name: case.actual[name] for name in BASE.values()})
    low, high = case.actual["travel"]
    half = 0.5 * (high - low)
    effects = []
    for slug in case.truth.keys() - BASE.keys():
        values = {RENAMED.get((slug, name), name): v for name, v in case.truth[slug].items()}
        if slug == "coulomb_asymmetry":
            values["force"] *= axis.coulomb.mean
        elif slug == "gravity":
            values["phase"] *= -1.0
        elif slug == "position_dependence":
            values = {"slope": values["slope"] / half, "curvature": values["curvature"] / half**2,
                      "centre": low + half}  # fmt: skip
        effects.append(REGISTRY[slug](**values))
    return axis.replace(effects=tuple(effects))


def record(case: Case) -> dfc.Record:
    """What the user measured: time, force, encoder reading, and no more."""
    make = dfc.Record.from_irregular if case.condition == "jitter" else dfc.Record
    return make(case.t, case.u, case.x)


def driven(
    machine: dfc.FrictionAxis, seconds: float = 3.0, noise: float = 0.0, seed: int = 0
) -> dfc.Record:
    """A record of an axis under two sines; `noise` is that of the recorded input."""
    t = 1e-3 * np.arange(round(1e3 * seconds))
    u = 20.0 * np.sin(6.0 * t) + 12.0 * np.sin(17.0 * t + 1.0)
    x = 1e-6 * np.round(1e6 * machine.simulate(u, dt=1e-3).y[0])
    if noise:
        u = u + noise * np.random.default_rng(seed).standard_normal(t.size)
    return dfc.Record(t, u, x)


@contextmanager
def among(*slugs: str) -> Iterator[None]:
    """Base parameters and these effects alone are candidates: those that a test is about.

    Some of the blind tests of `test_hidden_effects` have the whole catalogue.
    """
    before = dict(REGISTRY)
    try:
        for slug in before.keys() - {*BASE, *slugs}:
            del REGISTRY[slug]
        yield
    finally:
        REGISTRY.clear()
        REGISTRY.update(before)


def causes(found: Any) -> list[str]:
    """Slugs of the causes that a diagnosis names."""
    return [cause.effect for cause in found.causes]


def foreign(causes: list[str]) -> list[str]:
    """Causes that are not wrong base parameters."""
    return [slug for slug in causes if slug not in BASE]


def named_right(truth: list[str], twins: Mapping[str, Any], causes: list[str]) -> bool:
    """Whether the causes are the hidden ones, no more and no fewer.

    Corrected base parameters beside a hidden effect are left out of the mark;
    a hidden wrong base parameter must be among them, with nothing else named.
    A twin gives the very same record and counts as the effect itself.
    """
    true = sorted(foreign(truth))
    allowed = [true]
    for slug in true:
        allowed += [sorted({*true} - {slug} | {twin}) for twin in twins.get(slug, ())]
    return sorted(foreign(causes)) in allowed and {*truth} & {*BASE} <= {*causes}


def right_or_alternative(
    truth: list[str], twins: Mapping[str, Any], causes: list[str], alternatives: list[list[str]]
) -> bool:
    """Whether one hidden effect is named, or held among the alternatives."""
    if named_right(truth, twins, causes):
        return True
    rivals = [a for c, a in zip(causes, alternatives, strict=True) if c not in BASE]
    return len(rivals) == 1 and any(slug in rivals[0] for slug in truth)


def parameter_errors(case: Case, found: Any) -> dict[str, float]:
    """Relative errors of the parameters of all causes that are named right.

    Parameters that may vanish are related to what gives them their size: a
    curvature to its slope, a centre to half the travel, a phase (taken in the
    middle of the record, where a period's error does not enlarge it) to 1 rad.
    """
    errors: dict[str, float] = {}
    causes = {cause.effect: cause.parameters for cause in found.causes}
    low, high = case.believed["travel"]
    half = 0.5 * (high - low)
    for slug, true in case.truth.items():
        if slug not in causes:
            continue
        got = dict(causes[slug])
        if slug == "position_dependence":
            got = _normalised(found, 0.5 * (low + high), half)
        for name, value in true.items():
            named = RENAMED.get((slug, name), name)
            if named not in got:
                continue
            estimate, target, size = got[named], value, abs(value)
            if slug == "coulomb_asymmetry":
                target = value * case.actual["coulomb"]
                size = abs(target)
            elif name == "curvature":
                size = abs(true["slope"])
            elif name == "centre":
                size = half
            elif name == "phase":
                estimate, target, size = _phase(case, slug, true, got), 0.0, 1.0
            errors[f"{slug}.{name}"] = abs(estimate - target) / size
    return errors


def _normalised(found: Any, middle: float, half: float) -> dict[str, float]:
    """Slope and curvature in q = (x - middle)/half, as the bench has them.

    The package's level Fc (1 + s (x - c) + k (x - c)^2), expanded at `middle`.
    """
    effect = next(e for e in found.extended.effects if e.slug == "position_dependence")
    d = middle - effect.centre
    level = 1.0 + effect.slope * d + effect.curvature * d * d
    slope = (effect.slope + 2.0 * effect.curvature * d) * half / level
    return {"slope": slope, "curvature": effect.curvature * half * half / level}


def _phase(case: Case, slug: str, true: dict[str, float], got: dict[str, float]) -> float:
    """Difference of the phases in the middle of the record, -pi to pi."""
    if slug == "gravity":  # sin(x + phase) of the bench, sin(x - phase) of the package
        difference = -got["phase"] - true["phase"]
    elif "period" in got:
        place = 0.5 * (float(case.x.min()) + float(case.x.max()))
        period = true["pitch"] if slug == "cogging" else true["period"]
        rate = 2.0 * math.pi * (1.0 / got["period"] - 1.0 / period)
        difference = got["phase"] - true["phase"] + rate * place
    else:
        rate = 2.0 * math.pi * (got["frequency"] - true["frequency"])
        difference = got["phase"] - true["phase"] + rate * 0.5 * float(case.t[-1])
    return float(np.angle(np.exp(1j * difference)))
