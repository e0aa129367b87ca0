"""Candidates of a diagnosis: what may be added to an axis, and where its fit starts."""

from __future__ import annotations

from dataclasses import dataclass

from dryfric_control.model.axis import FrictionAxis
from dryfric_control.model.effects import Effect
from dryfric_control.model.effects.effect import REGISTRY
from dryfric_control.model.friction import Stribeck

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


def catalogue(axis: FrictionAxis, found: tuple[str, ...] = ()) -> tuple[type[Effect], ...]:
    """Effects that may be tried on an axis: all that is registered and not found yet.

    One that the axis already has may be there with the wrong numbers.
    """
    present = {e.slug for e in axis.effects}
    actions = {e.action for e in axis.effects}
    return tuple(
        effect
        for slug, effect in REGISTRY.items()
        if slug not in BASE
        and slug not in found
        and (slug in present or effect.action not in actions.intersection(_SINGLE))
    )


def holds(axis: FrictionAxis, slug: str) -> bool:
    """Whether an axis has an effect, a Stribeck peak as its own field."""
    if slug == "stribeck":
        return axis.stribeck is not None
    return effect_of(axis, slug) is not None


def effect_of(axis: FrictionAxis, slug: str) -> Effect | None:
    """The effect of an axis by its slug."""
    return next((e for e in axis.effects if e.slug == slug), None)


def other_numbers(axis: FrictionAxis, effect: type[Effect]) -> list[dict[str, float]]:
    """First guesses of the parameters of an effect that an axis has already."""
    if effect.slug == "stribeck":
        now = {"excess": axis.stribeck.excess, "speed": axis.stribeck.speed}  # type: ignore[union-attr]
    else:
        mine = next(e for e in axis.effects if e.slug == effect.slug)
        now = {name: float(getattr(mine, name)) for name in effect.parameters()}
    first = next(iter(now))
    return [now, now | {first: 0.2 * now[first]}, now | {first: 2.0 * now[first]}]


def with_effect(axis: FrictionAxis, effect: type[Effect], values: dict[str, float]) -> Start:
    """Axis with one effect more or another in its place, a Stribeck peak as its own field.

    A guess outside the bounds of its parameter is moved to the nearer one.
    """
    for name, meta in effect.parameters().items():
        if name in values:
            low, high = meta["bounds"]
            values[name] = min(max(values[name], low), high)
    if effect.slug == "stribeck":
        free = ("stribeck.excess", "stribeck.speed")
        return Start(axis.replace(stribeck=Stribeck(**values)), free)
    held = HELD.get(effect.slug, ())
    own = tuple(f"{effect.slug}.{p}" for p in values if p not in held)
    others = tuple(e for e in axis.effects if e.slug != effect.slug)
    return Start(axis.replace(effects=(*others, effect(**values))), own)
