"""Names of what can be fitted, and the axis that belongs to given values."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import MISSING, dataclass, fields

import numpy as np
from numpy.typing import NDArray

from dryfric_control.model.axis import FrictionAxis
from dryfric_control.model.effects import Effect
from dryfric_control.model.effects.effect import REGISTRY
from dryfric_control.model.friction import MOST_EXCESS, CoulombMap, Stribeck

#: Names of base parameters, with the power of force, length and time in their unit.
_BASE = {
    "mass": (1, -1, 2),
    "viscous": (1, -1, 1),
    "coulomb": (1, 0, 0),
    "coulomb_plus": (1, 0, 0),
    "coulomb_minus": (1, 0, 0),
    "stribeck.excess": (0, 0, 0),
    "stribeck.speed": (0, 1, -1),
    "stick_speed": (0, 1, -1),
    "stick_rate": (0, 0, -1),
}
#: Time by which the recorded input acts late: of the record, not of the axis.
SHIFT = "input_shift"
# Always positive and of unknown magnitude: searched on a logarithmic scale.
_LOGARITHMIC = ("mass", "stribeck.speed", "stick_speed", "stick_rate")
# How far from the starting value a search on a logarithmic scale may go.
_DECADES = 3.0
# A shift is a matter of conventions, at most some samples; more is a delay.
_LATEST = 5.0
_SPELLINGS = {
    "stribeck_excess": "stribeck.excess",
    "stribeck_speed": "stribeck.speed",
    "inertia": "mass",
}
_UNITS = {
    "N": (1, 0, 0),
    "m": (0, 1, 0),
    "s": (0, 0, 1),
    "1": (0, 0, 0),
    "rad": (0, 0, 0),
    "N/m": (1, -1, 0),
    "N s/m": (1, -1, 1),
    "N s^2/m^2": (1, -2, 2),
    "m/s": (0, 1, -1),
    "1/s": (0, 0, -1),
    "N m": (1, 0, 0),
    "N/s": (1, 0, -1),
    "Hz": (0, 0, -1),
    "1/m": (0, -1, 0),
    "1/m^2": (0, -2, 0),
}


def powers(unit: str) -> tuple[int, int, int]:
    """Powers of force, length and time in a unit; zeros for what it does not know.

    Examples
    --------
    >>> powers("N s/m"), powers("N m^2"), powers("V")
    ((1, -1, 1), (1, 2, 0), (0, 0, 0))
    """
    if unit in _UNITS:
        return _UNITS[unit]
    total = [0, 0, 0]
    above, _, below = unit.partition("/")
    for sign, factors in ((1, above), (-1, below)):
        for factor in factors.split():
            name, _, power = factor.partition("^")
            count = sign * int(power) if power.isdigit() else sign
            for i, own in enumerate(_UNITS.get(name, (0, 0, 0))):
                total[i] += count * own
    return (total[0], total[1], total[2])


@dataclass(frozen=True)
class Parameter:
    """One free parameter.

    Attributes
    ----------
    name : str
        "mass", "coulomb_plus", "coulomb_plus[1]" or "spring.stiffness".
    unit : str
        Unit, for print.
    low, high : float
        Bounds.
    logarithmic : bool
        Whether the search runs on a logarithmic scale.
    scale : float
        Change of the parameter that matters in the record, in its unit.
    """

    name: str
    unit: str
    low: float
    high: float
    logarithmic: bool
    scale: float

    def search(self, value: float) -> float:
        """Search coordinate of a value, of order 1."""
        return math.log(value) if self.logarithmic else value / self.scale

    def value(self, search: float) -> float:
        """Value at a search coordinate, within the bounds."""
        if self.logarithmic:
            return math.exp(min(max(search, math.log(self.low)), math.log(self.high)))
        return float(min(max(search * self.scale, self.low), self.high))

    def slope(self, value: float) -> float:
        """Change of the value with the search coordinate."""
        return value if self.logarithmic else self.scale


@dataclass(frozen=True)
class Scales:
    """Typical force, length and time of the records, and their sampling time."""

    force: float
    length: float
    time: float
    step: float

    def of(self, powers: tuple[int, int, int]) -> float:
        """Typical size of a quantity with these powers."""
        return self.force ** powers[0] * self.length ** powers[1] * self.time ** powers[2]


def choose(
    axis: FrictionAxis, free: Sequence[str], scales: Scales
) -> tuple[FrictionAxis, tuple[Parameter, ...]]:
    """Free parameters by name, and the axis with the effects they need.

    Parameters
    ----------
    axis : FrictionAxis
        The axis as believed.
    free : sequence of str
        Names.  "stribeck" stands for excess and speed, "coulomb_map" for all
        coefficients of both directions, an effect's slug for all its
        parameters.
    scales : Scales
        Typical size of things in the records.

    Returns
    -------
    axis : FrictionAxis
        With effects added, without action, where a name asks for one.
    parameters : tuple of Parameter

    Raises
    ------
    ValueError
        If a name is unknown, given twice, or cannot be fitted on this axis.
    """
    if isinstance(free, str):
        free = (free,)
    if not isinstance(free, Iterable):
        raise ValueError(f"free must hold names such as 'mass', got {free!r}")
    names: list[str] = []
    for name in free:
        if not isinstance(name, str):
            raise ValueError(f"free must hold names such as 'mass', got {name!r}")
        axis, found = _expand(axis, _SPELLINGS.get(name, name), scales)
        names += found
    if not names:
        raise ValueError("free is empty: name at least one parameter, e.g. free=('coulomb',)")
    twice = sorted({n for n in names if names.count(n) > 1})
    if twice:
        raise ValueError(f"free names {', '.join(twice)} more than once")
    sided = [n for n in names if n.startswith(("coulomb_plus", "coulomb_minus"))]
    if "coulomb" in names and sided:
        raise ValueError(
            f"free holds both 'coulomb' and {sided[0]!r}: the first is the common level of both "
            "directions; take one or the other"
        )
    return axis, tuple(_parameter(axis, name, scales) for name in names)


def values_of(axis: FrictionAxis, names: Sequence[str]) -> NDArray[np.float64]:
    """Values of parameters in an axis, shape (nparameters,)."""
    return np.array([_get(axis, name) for name in names])


def with_values(
    axis: FrictionAxis, names: Sequence[str], values: Sequence[float] | NDArray[np.float64]
) -> FrictionAxis:
    """Axis with parameters changed.

    Parameters
    ----------
    axis : FrictionAxis
        The axis.
    names : sequence of str
        Names of parameters, as `choose` gives them.
    values : sequence of float
        One value for each.

    Returns
    -------
    FrictionAxis

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=1.0, viscous=0.4, coulomb=(2.0, 3.0))
    >>> with_values(axis, ["mass", "coulomb_minus"], [1.5, 4.0]).coulomb
    CoulombMap(plus=(2.0,), minus=(4.0,))
    """
    given = {name: float(value) for name, value in zip(names, values, strict=True)}
    changes: dict[str, object] = {
        name: given[name]
        for name in ("mass", "viscous", "stick_speed", "stick_rate")
        if name in given
    }
    plus, minus = _levels(axis, given)
    changes["coulomb"] = CoulombMap(plus, minus)
    if axis.stribeck is not None and not _peak_effect(axis):
        changes["stribeck"] = Stribeck(
            given.get("stribeck.excess", axis.stribeck.excess),
            given.get("stribeck.speed", axis.stribeck.speed),
        )
    effects = []
    for effect in axis.effects:
        parts = {
            item.name: given.get(f"{effect.slug}.{item.name}", getattr(effect, item.name))
            for item in fields(effect)
        }
        effects.append(type(effect)(**parts))
    return axis.replace(effects=tuple(effects), **changes)


def _levels(
    axis: FrictionAxis, given: dict[str, float]
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    sides = []
    for side in ("plus", "minus"):
        coefficients = list(getattr(axis.coulomb, side))
        for name, now in (("coulomb", _mean_level(axis)), (f"coulomb_{side}", coefficients[0])):
            if name in given:
                # A map keeps its shape; a level of zero has none to keep.
                ratio = given[name] / now if now > 0.0 else 0.0
                coefficients = [ratio * c for c in coefficients]
                if now <= 0.0:
                    coefficients[0] = given[name]
        for i in range(len(coefficients)):
            coefficients[i] = given.get(f"coulomb_{side}[{i}]", coefficients[i])
        sides.append(tuple(coefficients))
    return sides[0], sides[1]


def _mean_level(axis: FrictionAxis) -> float:
    """Mean of the two levels at x = 0, what "coulomb" stands for."""
    return 0.5 * (axis.coulomb.plus[0] + axis.coulomb.minus[0])


def _expand(axis: FrictionAxis, name: str, scales: Scales) -> tuple[FrictionAxis, list[str]]:
    if name in ("stribeck", "stribeck.excess", "stribeck.speed") and not _peak_effect(axis):
        if axis.stribeck is None:
            # No peak yet: a small one, as narrow as the stick band is wide.
            speed = max(axis.stick_speed, 0.02 * scales.of((0, 1, -1)))
            axis = axis.replace(stribeck=Stribeck(0.05, speed))
        return axis, ["stribeck.excess", "stribeck.speed"] if name == "stribeck" else [name]
    if name == "coulomb_map":
        return axis, [
            f"coulomb_{side}[{i}]"
            for side in ("plus", "minus")
            for i in range(len(getattr(axis.coulomb, side)))
        ]
    if name in (*_BASE, SHIFT) or _coefficient(axis, name) is not None:
        return axis, [name]
    slug, _, part = name.partition(".")
    known = REGISTRY.get(slug)
    if known is None:
        raise ValueError(
            f"free: {name!r} is no parameter; choose from {', '.join(_BASE)}, stribeck, "
            f"coulomb_map, coulomb_plus[i], coulomb_minus[i], {SHIFT}, or an effect: "
            f"{', '.join(REGISTRY)}"
        )
    if part and part not in known.parameters():
        raise ValueError(
            f"free: {slug} has no parameter {part!r}; it has {', '.join(known.parameters())}"
        )
    present = [e for e in axis.effects if e.slug == slug]
    if len(present) > 1:
        raise ValueError(f"free: the axis has {slug} {len(present)} times: {name!r} is ambiguous")
    if not present:
        axis = axis.replace(effects=(*axis.effects, _neutral(known)))
    return axis, [f"{slug}.{part}"] if part else [f"{slug}.{p}" for p in known.parameters()]


def _peak_effect(axis: FrictionAxis) -> bool:
    """Whether the axis' Stribeck peak is that of an effect."""
    return any(effect.slug == "stribeck" for effect in axis.effects)


def _neutral(effect: type[Effect]) -> Effect:
    """Effect that does nothing yet."""
    values: dict[str, float] = {}
    for item in fields(effect):
        low, high = item.metadata["bounds"]
        if item.default is not MISSING:
            values[item.name] = float(item.default)
        elif item.name in ("gain", "factor"):
            values[item.name] = 1.0
        elif item.name != "limit" and low <= 0.0 <= high:
            values[item.name] = 0.0
        else:
            raise ValueError(
                f"free: {effect.slug}.{item.name} has no neutral value to start from: put the "
                f"effect with a first guess into the axis, axis.replace(effects=({effect.__name__}"
                "(...),))"
            )
    return effect(**values)


def _coefficient(axis: FrictionAxis, name: str) -> tuple[str, int] | None:
    for side in ("plus", "minus"):
        for i in range(len(getattr(axis.coulomb, side))):
            if name == f"coulomb_{side}[{i}]":
                return side, i
    return None


def _get(axis: FrictionAxis, name: str) -> float:
    if name == SHIFT:
        return 0.0
    if name == "coulomb":
        return _mean_level(axis)
    if name in ("coulomb_plus", "coulomb_minus"):
        return float(getattr(axis.coulomb, name.removeprefix("coulomb_"))[0])
    place = _coefficient(axis, name)
    if place is not None:
        return float(getattr(axis.coulomb, place[0])[place[1]])
    owner, _, part = name.partition(".")
    if owner == "stribeck" and not _peak_effect(axis):
        return float(getattr(axis.stribeck, part))
    if part:
        effect = next(e for e in axis.effects if e.slug == owner)
        return float(getattr(effect, part))
    return float(getattr(axis, name))


def _parameter(axis: FrictionAxis, name: str, scales: Scales) -> Parameter:
    length, force = axis.units
    place = _coefficient(axis, name)
    if place is not None:
        power = (1, -place[1], 0)
        unit = f"{force}/{length}^{place[1]}" if place[1] > 1 else f"{force}/{length}"
        bounds = (-math.inf, math.inf) if place[1] else (0.0, math.inf)
        return Parameter(name, unit if place[1] else force, *bounds, False, scales.of(power))
    value = _get(axis, name)
    if name == SHIFT:
        return Parameter(
            name, "s", -_LATEST * scales.step, _LATEST * scales.step, False, scales.step
        )
    if name in _BASE:
        units = {
            "mass": f"{force} s^2/{length}" if length != "m" else "kg",
            "viscous": f"{force} s/{length}",
            "stribeck.excess": "1",
            "stick_rate": "1/s",
        }
        default = f"{length}/s" if name.endswith("speed") else force
        unit = units.get(name, default)
        if name in _LOGARITHMIC:
            reach = 10.0**_DECADES
            return Parameter(name, unit, value / reach, value * reach, True, value)
        scale = scales.of(_BASE[name])
        high = MOST_EXCESS if name == "stribeck.excess" else math.inf
        return Parameter(name, unit, 0.0, high, False, scale)
    slug, _, part = name.partition(".")
    meta = REGISTRY[slug].parameters()[part]
    low, high = meta["bounds"]
    scale = abs(value) or scales.of(powers(meta["unit"]))
    if meta["unit"] == "s" and value == 0.0:
        scale = scales.step
    return Parameter(name, meta["unit"], low, high, False, scale)
