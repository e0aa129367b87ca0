"""Names of the parameters that can be fitted, and the axis for given values."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dryfric_control.arrays import Floats
from dryfric_control.checks import positive
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.model.effects.effect import REGISTRY
from dryfric_control.model.effects.naming import class_of, named, put, with_named
from dryfric_control.model.friction import CoulombMap
from dryfric_control.records.record import Record
from dryfric_control.text import did_you_mean
from dryfric_control.units import powers

#: Base parameters of the axis: their units.
_BASE = {"mass": "kg", "viscous": "N s/m"}
_BASE |= dict.fromkeys(("coulomb", "coulomb_plus", "coulomb_minus"), "N")
_BASE |= {"stick_speed": "m/s", "stick_rate": "1/s"}
#: Time by which the input acts after its time stamps: property of the record, not of the axis.
SHIFT = "input_shift"
# Always positive and of unknown magnitude: searched on a logarithmic scale.
_LOGARITHMIC = ("mass", "stick_speed", "stick_rate")
# These only shift the time of breakaway, in whole samples under a held input.
_BREAKS_AWAY = ("stick_speed",)
# Range of a search on a logarithmic scale around the start value, in decades.
_DECADES = 3.0
# Largest shift of the input [samples]: it stems from sampling conventions; more is a delay.
_LATEST = 5.0
# Parameters that the user may declare known, exactly or to a tolerance.
_BASES = ("mass", "viscous", "coulomb")
#: Other spellings of parameters.
SPELLINGS = {f"stribeck_{name}": f"stribeck.{name}" for name in ("excess", "speed")}
SPELLINGS["inertia"] = "mass"


def checked_knowledge(
    known: Sequence[str], tolerance: Mapping[str, float] | None
) -> tuple[tuple[str, ...], dict[str, float]]:
    """Knowledge of the user by parameter names; ValueError for invalid arguments."""
    known = (known,) if isinstance(known, str) else known
    if not isinstance(known, Sequence):
        raise ValueError(f"known must hold names such as 'mass', got {known!r}")
    tolerance = {} if tolerance is None else tolerance
    if not isinstance(tolerance, Mapping):
        meant = "names to numbers, such as {'viscous': 0.5}"
        raise ValueError(f"tolerance must map {meant}, got {tolerance!r}")
    for argument, some in (("known", known), ("tolerance", tolerance)):
        for name in some:
            if name not in (*_BASES, "inertia") and not (
                argument == "known" and _is_of_effect(name)
            ):
                raise ValueError(
                    f"{argument}: {name!r} is no base parameter{did_you_mean(name, _BASES)}; "
                    f"choose from {', '.join(_BASES)}"
                )
    names = tuple(SPELLINGS.get(n, n) for n in known)
    given = {SPELLINGS.get(n, n): positive(f"tolerance[{n!r}]", v) for n, v in tolerance.items()}
    if both := sorted({*names} & {*given}):
        raise ValueError(f"tolerance: {both[0]} is known already: name it in one of the two")
    return names, given


def _is_of_effect(name: str) -> bool:
    """Whether a name is that of a parameter of an effect, such as "input_gain.gain"."""
    effect, _, own = name.partition(".")
    found = class_of(effect)
    return found is not None and own in found.parameters()


@dataclass(frozen=True)
class Parameter:
    """One free parameter."""

    name: str  # "mass", "coulomb_plus[1]", or "cogging_2.period" for the second effect of a kind
    unit: str  # for output
    low: float
    high: float
    logarithmic: bool  # whether the search runs on a logarithmic scale
    scale: float  # typical significant change in the record, in its unit
    kind: str = "amount"  # of quantity, see `dfc.effects.parameter`
    breaks_away: bool = False  # whether it acts only at breakaway
    neutral: float = 0.0  # value at which it has no effect
    optional: bool = False  # whether its effect may do without it

    def search(self, value: float) -> float:
        """Search coordinate of a value, of order 1."""
        return math.log(value) if self.logarithmic else value / self.scale

    def value(self, search: float) -> float:
        """Value at a search coordinate, within the bounds."""
        if self.logarithmic:
            return math.exp(min(max(search, math.log(self.low)), math.log(self.high)))
        return float(min(max(search * self.scale, self.low), self.high))

    def slope(self, value: float) -> float:
        """Derivative of the value with respect to the search coordinate."""
        return value if self.logarithmic else self.scale


@dataclass(frozen=True)
class Scales:
    """Typical force, length and time of the records, and their sampling time."""

    force: float
    length: float
    time: float
    step: float

    def size_of(self, powers: tuple[int, int, int]) -> float:
        """Typical size of a quantity with these powers of force, length and time."""
        return self.force ** powers[0] * self.length ** powers[1] * self.time ** powers[2]


def typical(records: Sequence[Record]) -> Scales:
    """Typical force, length and time in records."""
    force = float(np.sqrt(np.mean([np.mean(r.u**2) for r in records])))
    length = float(np.mean([np.std(r.x) for r in records]))
    squares = [np.mean(r.derivatives().v ** 2) for r in records]
    speed = float(np.sqrt(np.mean(squares)))
    return Scales(force or 1.0, length, length / speed, records[0].dt)


def choose(
    axis: FrictionAxis, free: Sequence[str], scales: Scales
) -> tuple[FrictionAxis, tuple[Parameter, ...]]:
    """The axis with the effects that free names require, at neutral values, and its parameters.

    "coulomb_map" means all coefficients of both directions, the name of an effect all its
    parameters that may be free.
    """
    free = (free,) if isinstance(free, str) else free
    if not isinstance(free, Iterable):
        raise ValueError(f"free must hold names such as 'mass', got {free!r}")
    names: list[str] = []
    for name in free:
        if not isinstance(name, str):
            raise ValueError(f"free must hold names such as 'mass', got {name!r}")
        axis, found = _expand(axis, SPELLINGS.get(name, name), scales)
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


def values_of(axis: FrictionAxis, names: Sequence[str]) -> Floats:
    """Values of parameters in an axis, shape (nparameters,)."""
    return np.array([_get(axis, name) for name in names])


def with_values(
    axis: FrictionAxis, names: Sequence[str], values: Sequence[float] | Floats
) -> FrictionAxis:
    """Axis with parameters, by their names of `choose`, changed to these values."""
    given = {name: float(value) for name, value in zip(names, values, strict=True)}
    own: dict[str, dict[str, float]] = {}
    changes: dict[str, object] = {}
    for name, value in given.items():
        owner, dot, part = name.partition(".")
        if dot:
            own.setdefault(owner, {})[part] = value
        elif name.startswith("coulomb"):
            changes["coulomb"] = _levels(axis, given)
        else:
            changes[name] = value
    present = named(axis) if own else {}
    changed = {n: replace(present[n], **parts) for n, parts in own.items() if n in present}
    return with_named(axis, changed, **changes)


def _levels(axis: FrictionAxis, given: dict[str, float]) -> CoulombMap:
    """Coulomb levels of an axis with the given parameters."""
    sides = []
    for side in ("plus", "minus"):
        coefficients = list(getattr(axis.coulomb, side))
        for name, now in (("coulomb", axis.coulomb.mean), (f"coulomb_{side}", coefficients[0])):
            if name in given:
                # A map keeps its shape, unless its level is zero.
                ratio = given[name] / now if now > 0.0 else 0.0
                coefficients = [ratio * c for c in coefficients]
                if now <= 0.0:
                    coefficients[0] = given[name]
        named_ones = (f"coulomb_{side}[{i}]" for i in range(len(coefficients)))
        sides.append([given.get(n, c) for n, c in zip(named_ones, coefficients, strict=True)])
    return CoulombMap(*map(tuple, sides))


def _coefficients(axis: FrictionAxis) -> dict[str, float]:
    """Coefficients of the Coulomb levels by name, "coulomb_plus[0]" first."""
    return {
        f"coulomb_{side}[{i}]": float(c)
        for side in ("plus", "minus")
        for i, c in enumerate(getattr(axis.coulomb, side))
    }


def _expand(axis: FrictionAxis, name: str, scales: Scales) -> tuple[FrictionAxis, list[str]]:
    """The axis that a name requires, and the names of the parameters that it means."""
    if name == "coulomb_map":
        return axis, list(_coefficients(axis))
    if name in (*_BASE, SHIFT) or name in _coefficients(axis):
        return axis, [name]
    owner, _, part = name.partition(".")
    known = class_of(owner)
    if known is None:
        raise ValueError(
            f"free: {name!r} is no parameter{did_you_mean(name, (*_BASE, *REGISTRY))}; choose from "
            f"{', '.join(_BASE)}, coulomb_map, "
            f"coulomb_plus[i], coulomb_minus[i], {SHIFT}, or an effect: {', '.join(REGISTRY)}"
        )
    if part and part not in known.parameters():
        raise ValueError(
            f"free: {owner} has no parameter {part!r}; it has {', '.join(known.parameters())}"
        )
    if owner not in named(axis):
        start = known.start(axis, lambda unit: scales.size_of(powers(unit)))
        there = put(axis, owner, start)
        if owner not in named(there):
            raise ValueError(
                f"free: {name!r} counts from the effects that the axis has, which are "
                f"{', '.join(named(axis)) or 'none'}: name the first one {known.slug!r}"
            )
        axis = there
    return axis, [name] if part else [f"{owner}.{p}" for p in known.named_parameters()]


def _get(axis: FrictionAxis, name: str) -> float:
    """Value of a parameter in an axis."""
    levels = axis.coulomb
    own = {"coulomb": levels.mean, "coulomb_plus": levels.plus[0], "coulomb_minus": levels.minus[0]}
    own |= {SHIFT: 0.0} | _coefficients(axis)
    if name in own:
        return float(own[name])
    owner, _, part = name.partition(".")
    return float(getattr(named(axis)[owner] if part else axis, part or name))


def base_unit(name: str) -> str:
    """Unit of a base parameter, or of a coefficient of a Coulomb level, of a linear axis."""
    base, _, degree = name.removesuffix("]").partition("[")
    power = int(degree or 0)
    if power == 0:
        return _BASE[base]
    return "N/m" if power == 1 else f"N/m^{power}"


def _parameter(axis: FrictionAxis, name: str, scales: Scales) -> Parameter:
    """One free parameter of an axis, from its name."""
    if name == SHIFT:
        reach = _LATEST * scales.step
        return Parameter(name, "s", -reach, reach, False, scales.step)
    value, (owner, _, part) = _get(axis, name), name.partition(".")
    about: tuple[Any, ...] = ("amount", name in _BREAKS_AWAY)
    if not part:
        unit = axis.unit(base_unit(name))
        logarithmic = name in _LOGARITHMIC
        low = 0.0 if name in _BASE or name.endswith("[0]") else -math.inf
        high = math.inf
        scale = value if logarithmic else scales.size_of(powers(base_unit(name)))
    else:
        effect = type(named(axis)[owner])
        meta = effect.parameters()[part]
        unit = effect.units(axis.units)[part]
        logarithmic = meta["logarithmic"]
        low, high = meta["bounds"]
        about = meta["kind"], meta["breaks_away"], meta["neutral"] or 0.0, meta["optional"]
        # For a parameter that starts at zero, the scale follows from its unit.
        unknown = 1.0 if meta["kind"] == "angle" else scales.size_of(powers(meta["unit"]))
        scale = (None if logarithmic else meta["size"]) or abs(value)
        scale = scale or (scales.step if meta["unit"] == "s" else unknown)
    if logarithmic:
        low = max(low, value / 10.0**_DECADES)
        high = min(high, value * 10.0**_DECADES)
    return Parameter(name, unit, low, high, logarithmic, scale, *about)
