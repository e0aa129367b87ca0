"""Description of a cause, whether found by free runs or by likelihood."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from dryfric_control.diagnosis.candidates import effect_class, holds
from dryfric_control.diagnosis.report.findings import Cause
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.model.effects.naming import named, title_of
from dryfric_control.text import rotary_words

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
    """Cause from the results of a fit.

    Parameters
    ----------
    axis : FrictionAxis
        The nominal axis.
    slug : str
        Name of the effect.
    own : mapping of str to str
        Names of its parameters, mapped to those in the fit.
    values, errors, units : mapping
        By the names in the fit.
    gain : tuple of float
        Gain on held-out data, and its standard error.
    alternatives : sequence of str, optional
        Equivalent effects or base parameters.
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
    """A message for each parameter that the record hardly determines.

    Compared with its value, or that in the nominal axis if this is larger.
    """
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
