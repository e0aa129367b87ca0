"""Input gain against errors of all base parameters: motion alone does not separate them."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace

from dryfric_control.diagnosis.candidates import SLUGS
from dryfric_control.diagnosis.report.findings import Cause
from dryfric_control.estimation.parameters import values_of
from dryfric_control.model.axis import FrictionAxis

#: The effect that scales every force of the drive.
GAIN = "input_gain"


def every(axis: FrictionAxis) -> list[str]:
    """Base-parameter errors that together are equivalent to a gain; zero values stay zero."""
    values = values_of(axis, tuple(SLUGS))
    return [slug for slug, value in zip(SLUGS.values(), values, strict=True) if value > 0.0]


def left_open(axis: FrictionAxis, told: Collection[str]) -> bool:
    """Whether no knowledge about an axis separates a gain from its base parameters.

    The motion depends only on the ratio of all forces to the gain, so that both may be scaled
    alike.  `told`: parameters whose nominal values are known exactly or to a tolerance.
    """
    return not (axis.effects or {*told} & {*SLUGS})


def or_a_gain(
    axis: FrictionAxis,
    wrong: Sequence[Cause],
    scales: Callable[[Cause], Sequence[str]] = lambda cause: (GAIN,),
) -> list[Cause]:
    """Wrong base parameters, with scales of the drive as alternatives if all are wrong.

    Each of the scales can replace any one of them by bringing it back to nominal; a value of
    zero cannot be scaled.
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
