"""Input gain against errors of all base parameters: motion alone does not separate them."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import replace

from dryfric_control.diagnosis.candidates import SLUGS
from dryfric_control.diagnosis.report.findings import Cause
from dryfric_control.estimation.parameters import values_of
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.model.effects import InputGain
from dryfric_control.model.effects.effect import REGISTRY

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
