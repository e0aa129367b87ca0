"""Other names for the arguments of an axis: inertia is taken, the rest is told the right one."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any

from dryfric_control.arguments import unknown_argument
from dryfric_control.units import axis_units

_ROTARY = ("rad", "N m")
_NEEDED = ("mass", "viscous", "coulomb")
# What users call an argument, in lower case, and what it is here.
_MASS = "mass=, the mass [kg], or inertia= [kg m^2] of a rotary axis"
_VISCOUS = "viscous=, the viscous coefficient [N s/m]"
_COULOMB = "coulomb=, the Coulomb level [N], one value or (plus, minus)"
_STRIBECK = (
    "stribeck=dfc.Stribeck(excess=0.3, speed=0.01): breakaway is (1 + excess) times the Coulomb "
    "level, the peak falls within speed [m/s]"
)
_EFFECTS = "effects=(dfc.effects.{}(...),)"
_MEANT = {
    **dict.fromkeys(("m", "weight", "payload"), _MASS),
    **dict.fromkeys(("j", "i", "moment_of_inertia", "armature"), _MASS),
    **dict.fromkeys(("visc", "viscosity", "viscous_friction", "damping", "damper"), _VISCOUS),
    **dict.fromkeys(("b", "f", "fv", "d", "sigma2"), _VISCOUS),
    **dict.fromkeys(("fc", "dry", "dry_friction", "friction", "frictionloss", "tc"), _COULOMB),
    **dict.fromkeys(("coulomb_friction", "coulomb_level", "kinetic"), _COULOMB),
    **dict.fromkeys(("fs", "static", "stiction", "static_friction", "breakaway"), _STRIBECK),
    **dict.fromkeys(("vs", "stribeck_speed", "stribeck_velocity"), _STRIBECK),
    "gravity": _EFFECTS.format("Gravity"),
    "spring": _EFFECTS.format("Spring"),
    "stiffness": _EFFECTS.format("Spring"),
    "bias": _EFFECTS.format("BiasForce"),
    "offset": _EFFECTS.format("BiasForce"),
    "delay": _EFFECTS.format("InputDelay"),
    "backlash": _EFFECTS.format("Backlash"),
    "cogging": _EFFECTS.format("Cogging"),
}


def with_mass(given: dict[str, Any], units: object = _ROTARY) -> dict[str, Any]:
    """Arguments with the mass in place of an inertia; `units`: those of the axis by default."""
    if "inertia" not in given:
        return given
    inertia = given["inertia"]
    found = {"units": units} | {k: v for k, v in given.items() if k != "inertia"}
    if "mass" in given:
        raise ValueError(
            f"mass = {given['mass']!r} and inertia = {inertia!r} are the same argument: give one"
        )
    length, force = axis_units(found["units"])
    if length == "m" or force == "N":
        raise ValueError(
            f"inertia = {inertia!r} is that of a rotary axis, and units = {found['units']!r} are "
            'of a linear one: give units=("rad", "N m"), or mass='
        )
    return found | {"mass": inertia}


def with_inertia(cls: type[Any]) -> type[Any]:
    """Let the dataclass of an axis take `inertia`, and name the right argument for a wrong one."""
    make: Callable[..., None] = cls.__init__
    own = cls.__name__
    known = tuple(cls.__dataclass_fields__)

    @wraps(make)
    def init(self: Any, *args: Any, **given: Any) -> None:
        given = with_mass(given)
        for name in given:
            if name not in known:
                meant = _MEANT.get(name.lower(), "")
                raise TypeError(unknown_argument(own, name, (*known, "inertia"), meant))
        if lacking := [name for name in _NEEDED[len(args) :] if name not in given]:
            raise TypeError(
                f"FrictionAxis lacks {', '.join(f'{name}=' for name in lacking)}: give each, 0 for "
                "none, or take them from a record, dfc.axis_from(record)"
            )
        make(self, *args, **given)

    vars(init)["has_hints"] = True
    cls.__init__ = init
    return cls
