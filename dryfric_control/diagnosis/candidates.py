"""Candidates of a diagnosis: what may be added to an axis, and where its fit starts."""

from __future__ import annotations

from dataclasses import dataclass

from dryfric_control.axis import FrictionAxis
from dryfric_control.effects import REGISTRY, Effect
from dryfric_control.friction import Stribeck

#: Base parameters by the slug of the cause that a wrong value is.
BASE = {"inertia": "mass", "viscous": "viscous", "coulomb": "coulomb"}

# Actions of which an axis holds one.
_SINGLE = ("delay", "lag", "contact", "transmission")

#: Parameters that a fit leaves where the guess put them.
HELD = {"position_dependence": ("centre",)}

#: Fewer assumptions first: the order in which equally good causes are named.
#: A constant force is simpler than friction that knows directions; a spring is
#: simpler than the sine of a position.
PLAINNESS = (
    "bias_force", "input_gain", "spring", "quadratic_drag", "input_delay", "actuator_lag",
    "position_dependence", "drift", "stribeck", "load_dependence", "dead_zone", "saturation",
    "cogging", "time_periodic", "gravity", "coulomb_asymmetry", "viscous_asymmetry",
    "presliding", "dwell_time", "backlash", "compliance",
)  # fmt: skip


@dataclass(frozen=True)
class Start:
    """An axis with a candidate in it, and names of what is free beside the base."""

    axis: FrictionAxis
    free: tuple[str, ...]
    base: dict[str, float]


def catalogue(axis: FrictionAxis, found: tuple[str, ...] = ()) -> tuple[type[Effect], ...]:
    """Effects that may be tried on an axis: registered, and not yet in it."""
    present = {e.slug for e in axis.effects} | set(found)
    actions = {e.action for e in axis.effects}
    tried = []
    for slug, effect in REGISTRY.items():
        if slug in present or slug in BASE:
            continue
        if slug == "stribeck" and axis.stribeck is not None:  # a peak has no second one
            continue
        if (
            effect.action in ("delay", "lag", "contact", "transmission")
            and effect.action in actions
        ):
            continue
        tried.append(effect)
    return tuple(tried)


def with_effect(
    axis: FrictionAxis, effect: type[Effect], values: dict[str, float], base: dict[str, float]
) -> Start:
    """Axis with one effect more, a Stribeck peak as its own field.

    A guess outside the bounds of its parameter is moved to the nearer one.
    """
    for name, meta in effect.parameters().items():
        if name in values:
            low, high = meta["bounds"]
            values[name] = min(max(values[name], low), high)
    if effect.slug == "stribeck":
        return Start(
            axis.replace(stribeck=Stribeck(**values)), ("stribeck.excess", "stribeck.speed"), base
        )
    held = HELD.get(effect.slug, ())
    free = tuple(f"{effect.slug}.{p}" for p in values if p not in held)
    return Start(axis.replace(effects=(*axis.effects, effect(**values))), free, base)
