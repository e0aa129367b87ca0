"""The model that the observer runs, from the nominal axis."""

from __future__ import annotations

import warnings

from dryfric_control.checks import instance, positive
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.model.friction import CoulombMap

#: What acts through states that the observer does not have, or on what it reads.
LEFT_OUT = ("contact", "transmission", "reading")


class ObserverWarning(UserWarning):
    """Part of an axis that its observer leaves out."""


def own_axis(
    axis: FrictionAxis,
    coulomb: CoulombMap | float | None = None,
    stick_speed: float | None = None,
) -> FrictionAxis:
    """Axis that the observer believes in."""
    instance("axis", axis, FrictionAxis)
    acting = axis.effective()
    if stick_speed is None:
        stick_speed = acting.stick_speed / 2.0
    speed = positive("stick_speed", stick_speed, unit="m/s")
    left = [effect for effect in acting.effects if effect.action in LEFT_OUT]
    if left:
        names = ", ".join(effect.slug for effect in left)
        warnings.warn(
            f"the observer leaves out {names}: it runs the axis as one rigid mass that either "
            "rests or slides, and what that misses goes into its integral term and its mode",
            ObserverWarning,
            stacklevel=3,  # the caller of design_pi_observer
        )
    return acting.replace(
        stribeck=None,
        stick_speed=speed,
        coulomb=acting.coulomb if coulomb is None else CoulombMap.of(coulomb),
        effects=tuple(effect for effect in acting.effects if effect not in left),
    )
