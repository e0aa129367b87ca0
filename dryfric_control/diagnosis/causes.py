"""Description of a cause that was found, and a gain against errors of all base parameters.

Motion depends only on the ratio of all forces to the gain: both may be scaled alike.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace

from dryfric_control.diagnosis.candidates import SLUGS, effect_class, holds
from dryfric_control.diagnosis.report.findings import Cause
from dryfric_control.estimation.parameters import values_of
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.model.effects import InputGain
from dryfric_control.model.effects.effect import REGISTRY
from dryfric_control.model.effects.naming import named, title_of
from dryfric_control.text import rotary_words

#: The effect that scales every force of the drive.
GAIN = "input_gain"
#: Ratio of standard error to value beyond which a record hardly determines a parameter.
HARDLY = 0.3


def cause_of(
    axis: FrictionAxis,
    slug: str,
    own: Mapping[str, str],
    values: Mapping[str, float],
    errors: Mapping[str, float],
    units: Mapping[str, str],
    gain: tuple[float, float],
    alternatives: Sequence[str] = (),
) -> Cause:
    """Cause `slug` from the results of a fit.

    `own`: names of its parameters, mapped to those in the fit, by which `values`, `errors` and
    `units` are; `gain`: on held-out data, with its standard error.
    """
    effect = effect_class(slug)
    title, explanation, experiment = (
        rotary_words(text, axis.units[1])
        for text in (title_of(slug), effect.explanation, effect.experiment)
    )
    if holds(axis, slug):
        explanation = f"Already in the nominal axis, with other values. {explanation}"
    mean, error = gain
    return Cause(
        effect=slug,
        title=title,
        parameters={short: float(values[name]) for short, name in own.items()},
        standard_errors={short: errors[name] for short, name in own.items()},
        units={short: units[name] for short, name in own.items()},
        held_out_gain=mean,
        interval=(mean - 1.645 * error, mean + 1.645 * error),
        alternatives=tuple(alternatives),
        explanation=explanation,
        experiment=experiment,
    )


def hardly_determined(axis: FrictionAxis, causes: Sequence[Cause]) -> list[str]:
    """A message for each parameter that is hardly determined, beside its or the nominal value."""
    messages, present = [], named(axis)
    for cause in causes:
        kinds = effect_class(cause.effect).parameters()
        for name, value in cause.parameters.items():
            if kinds.get(name, {}).get("kind") in ("place", "angle"):
                continue
            nominal = getattr(present.get(cause.effect), name, 0.0)
            if not cause.standard_errors[name] <= HARDLY * max(abs(value), abs(nominal)):
                # A base parameter and its cause may have the same name.
                full = name if name == cause.effect else f"{cause.effect}.{name}"
                messages.append(f"{full} is hardly determined by this record")
    return messages


def every(axis: FrictionAxis) -> list[str]:
    """Base-parameter errors that together are equivalent to a gain; zero values stay zero."""
    values = values_of(axis, tuple(SLUGS))
    return [slug for slug, value in zip(SLUGS.values(), values, strict=True) if value > 0.0]


def left_open(axis: FrictionAxis, told: Collection[str]) -> bool:
    """Whether nothing separates a gain from base parameters, none of which is `told`."""
    return not (axis.effects or {*told} & {*SLUGS})


def or_a_gain(
    axis: FrictionAxis,
    wrong: Sequence[Cause],
    scales: Callable[[Cause], Sequence[str]] = lambda cause: (GAIN,),
) -> list[Cause]:
    """Wrong base parameters, with scales of the drive as alternatives if all are wrong."""
    slugs, scaled = [cause.effect for cause in wrong], every(axis)
    found = list(wrong)
    for i, cause in enumerate(wrong):
        # A scale brings one of them back to nominal; a value of zero cannot be scaled.
        if {*scaled} <= {*slugs} and cause.effect in scaled and all(cause.parameters.values()):
            rest = [s for s in slugs if s != cause.effect]
            others = ("+".join([one, *rest]) for one in scales(cause))
            found[i] = replace(cause, alternatives=(*cause.alternatives, *others))
    return found


def scaled(axis: FrictionAxis, scale: float) -> FrictionAxis:
    """The axis that moves alike: every force, and the gain of the drive, times `scale`."""
    gain, effects = scale, []
    for effect in axis.effects:
        if isinstance(effect, InputGain):
            gain *= effect.gain
            continue
        forces = (n for n, about in effect.parameters().items() if about["unit"][:1] == "N")
        effects.append(replace(effect, **{n: scale * getattr(effect, n) for n in forces}))
    if not math.isclose(gain, 1.0):
        effects.insert(0, InputGain(gain))
    return axis.replace(
        mass=scale * axis.mass, viscous=scale * axis.viscous,
        coulomb=axis.coulomb.scaled(scale), effects=effects,
    )  # fmt: skip


def rival(
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
                return scaled(axis, 1.0 / cause.parameters["gain"]), GAIN, other
            if other.split("+")[0] == GAIN and cause.effect in SLUGS.values():
                (value,), (nominal,) = (
                    values_of(a, tuple(cause.parameters)) for a in (axis, believed)
                )
                return scaled(axis, nominal / value), cause.effect, other
    return None
