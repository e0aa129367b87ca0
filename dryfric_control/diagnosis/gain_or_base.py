"""A gain of the drive, or base parameters that are all wrong: motion alone does not tell."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace

from dryfric_control.diagnosis.candidates import SLUGS
from dryfric_control.diagnosis.report.findings import SMALL, Cause
from dryfric_control.estimation.parameters import values_of
from dryfric_control.model.axis import FrictionAxis

#: The effect that scales every force of the drive.
GAIN = "input_gain"


def every(axis: FrictionAxis) -> list[str]:
    """Errors of base parameters that do together what a gain does: what is zero stays zero."""
    values = values_of(axis, tuple(SLUGS))
    return [slug for slug, value in zip(SLUGS.values(), values, strict=True) if value > 0.0]


def left_open(axis: FrictionAxis, told: Collection[str]) -> bool:
    """Whether nothing that is known of an axis tells a gain from base parameters.

    The motion follows from all forces over the gain: with another gain all forces may be
    scaled alike.  `told`: parameters whose nominal values are known, or to a tolerance.
    """
    return not (axis.effects or {*told} & {*SLUGS})


def far_off(
    values: Mapping[str, float], nominal: Mapping[str, float], names: Collection[str]
) -> bool:
    """Whether a gain leaves base parameters far off, so that it is no simpler answer.

    Then these are named: that they are wrong is certain, that the gain is as well is not.
    """
    return any(abs(values[n] - nominal[n]) > SMALL * nominal[n] for n in names)


def or_a_gain(
    axis: FrictionAxis,
    wrong: Sequence[Cause],
    scales: Callable[[Cause], Sequence[str]] = lambda cause: (GAIN,),
) -> list[Cause]:
    """Wrong base parameters with what does the very same where all of them are wrong.

    Each of the scales takes the place of any one of them that it can bring back to nominal:
    no scale does with a value that is zero.
    """
    slugs = [cause.effect for cause in wrong]
    scaled = every(axis)
    if not {*scaled} <= {*slugs}:
        return list(wrong)

    def instead(cause: Cause) -> tuple[str, ...]:
        if cause.effect not in scaled or not all(cause.parameters.values()):
            return ()
        rest = [s for s in slugs if s != cause.effect]
        return tuple("+".join([one, *rest]) for one in scales(cause))

    return [replace(c, alternatives=(*c.alternatives, *instead(c))) for c in wrong]
