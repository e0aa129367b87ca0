"""An axis as a text file (TOML), for the command line and for keeping."""

from __future__ import annotations

import difflib
import json
import os
from collections.abc import Iterable, Mapping
from dataclasses import MISSING, asdict, fields
from typing import Any

from dryfric_control.checks import instance
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.model.effects import Effect
from dryfric_control.model.effects.effect import REGISTRY
from dryfric_control.model.friction import CoulombMap, Stribeck
from dryfric_control.store.files import read_toml, replacing

_KEYS = tuple(item.name for item in fields(FrictionAxis))
_NEEDED = ("mass", "viscous", "coulomb")
#: Tables that are read by `Scaling.from_file` and by `read_knowledge`.
_OTHERS = ("record", "knowledge")
_EXAMPLE = "mass = 2.0, viscous = 15.0, coulomb = 8.0"


def read_axis(path: str | os.PathLike[str]) -> FrictionAxis:
    """Read an axis from a TOML file.

    Parameters
    ----------
    path : path-like
        The file.  Its keys are the fields of `FrictionAxis`: `coulomb` is a
        level, ``[plus, minus]``, or ``{plus = [c0, c1], minus = [c0]}``;
        ``[stribeck]`` holds excess and speed; every ``[[effects]]`` names its
        effect and the effect's parameters. ``[record]`` is left to `Scaling.from_file`.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import dryfric_control as dfc
    >>> text = '''
    ... mass = 2.0
    ... viscous = 15.0
    ... coulomb = [8.0, 7.5]
    ... [[effects]]
    ... effect = "spring"
    ... stiffness = 40.0
    ... '''
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "axis.toml")
    ...     _ = path.write_text(text)
    ...     axis = dfc.read_axis(path)
    >>> axis.coulomb, axis.effects
    (CoulombMap(plus=(8.0,), minus=(7.5,)), (Spring(stiffness=40.0, rest=0.0),))
    """
    data = read_toml(path)
    try:
        return axis_from_dict({k: v for k, v in data.items() if k not in _OTHERS})
    except ValueError as problem:
        raise ValueError(f"{path}: {problem}") from None


def read_axes(path: str | os.PathLike[str]) -> dict[str, FrictionAxis]:
    """Axes of several joints by the name of their table in a TOML file, see `read_axis`."""
    found = {}
    for name, table in read_toml(path).items():
        if name in _OTHERS:
            continue
        try:
            found[name] = axis_from_dict({"name": name} | _table(name, table, f"{{{_EXAMPLE}}}"))
        except ValueError as problem:
            raise ValueError(f"{path}: [{name}]: {problem}") from None
    if not found:
        raise ValueError(f"{path} has no joint: write a table [elbow] with {_EXAMPLE} for each")
    return found


def read_knowledge(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Arguments `known` and `tolerance` in the table ``[knowledge]`` of an axis file."""
    found = read_toml(path).get("knowledge", {})
    if not isinstance(found, dict) or set(found) - {"known", "tolerance"}:
        raise ValueError(
            f'{path}: knowledge must be a table with known = ["mass"] and '
            f"tolerance = {{viscous = 0.5}}, got {found!r}"
        )
    return dict(found)


def write_axis(axis: FrictionAxis, path: str | os.PathLike[str]) -> None:
    """Write an axis to a TOML file that `read_axis` reads.

    Parameters
    ----------
    axis : FrictionAxis
    path : path-like
        The file to make or to replace, whole or not at all.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0, travel=(0.0, 0.3))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "axis.toml")
    ...     dfc.write_axis(axis, path)
    ...     dfc.read_axis(path) == axis
    True
    """
    instance("axis", axis, FrictionAxis)
    with replacing(path) as part:
        part.write_text(axis_text(axis), encoding="utf-8")


def axis_text(axis: FrictionAxis, record: Mapping[str, Any] | None = None) -> str:
    """An axis as TOML text, with a table ``[record]`` where one is given."""
    data = axis_to_dict(axis)
    effects = data.pop("effects")
    lines = [f"{key} = {_toml(value)}" for key, value in data.items()]
    for effect in effects:
        lines += ["", "[[effects]]", *(f"{key} = {_toml(value)}" for key, value in effect.items())]
    if record:
        lines += ["", "[record]", *(f"{key} = {_toml(value)}" for key, value in record.items())]
    return "\n".join(lines) + "\n"


def axis_to_dict(axis: FrictionAxis) -> dict[str, Any]:
    """An axis as numbers, texts, lists and dicts, ready for any file format."""
    data: dict[str, Any] = {
        "name": axis.name,
        "units": list(axis.units),
        "mass": axis.mass,
        "viscous": axis.viscous,
        "coulomb": {"plus": list(axis.coulomb.plus), "minus": list(axis.coulomb.minus)},
        "stick_speed": axis.stick_speed,
        "stick_rate": axis.stick_rate,
        "switching": axis.switching,
    }
    if axis.travel is not None:
        data["travel"] = list(axis.travel)
    if axis.stribeck is not None:
        data["stribeck"] = {"excess": axis.stribeck.excess, "speed": axis.stribeck.speed}
    data["effects"] = [{"effect": effect.slug} | asdict(effect) for effect in axis.effects]
    return data


def _toml(value: Any) -> str:
    """A value as TOML on one line; repr of a float is exact."""
    if isinstance(value, str):
        return _string(value)
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list):
        return f"[{', '.join(map(_toml, value))}]"
    if isinstance(value, dict):
        return f"{{{', '.join(f'{key} = {_toml(one)}' for key, one in value.items())}}}"
    return repr(float(value))


def _string(text: str) -> str:
    # JSON strings are TOML strings but for one character that TOML wants escaped.
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def _check_keys(name: str, given: Mapping[str, Any], known: Iterable[str]) -> None:
    """Refuse keys that nobody reads, with the nearest that somebody does."""
    known = list(known)
    for key, value in given.items():
        if key not in known:
            hint = _hint(key, known)
            if key == "inertia" and "mass" in known:
                hint = f'write mass = {value!r}, the inertia with units = ["rad", "N m"]'
            raise ValueError(f"{name}{key} = {value!r} is not known: {hint}")


def _hint(word: str, known: Iterable[str]) -> str:
    """The nearest of some words, or all of them."""
    near = difflib.get_close_matches(word, known := list(known), n=1)
    return f"did you mean {near[0]!r}?" if near else f"known are {', '.join(known)}"


def _table(name: str, value: Any, example: str) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise ValueError(f"{name} must be a table such as {example}, got {value!r}")
    return value


def axis_from_dict(data: Mapping[str, Any]) -> FrictionAxis:
    """An axis from what `axis_to_dict` gives, or a file that a user wrote holds."""
    data = _table("axis", data, f"{{{_EXAMPLE}}}")
    _check_keys("", data, _KEYS)
    missing = [key for key in _NEEDED if key not in data]
    if missing:
        raise ValueError(f"{missing[0]} is missing: give at least {_EXAMPLE}")
    found = dict(data)
    found["coulomb"] = _coulomb(data["coulomb"])
    if data.get("stribeck") is not None:
        peak = _table("stribeck", data["stribeck"], "{excess = 0.3, speed = 0.01}")
        _check_keys("stribeck.", peak, ("excess", "speed"))
        for key in ("excess", "speed"):
            if key not in peak:
                raise ValueError(f"stribeck.{key} is missing: add {key} = ... to [stribeck]")
        found["stribeck"] = Stribeck(**peak)
    for key in ("name", "switching"):
        if not isinstance(data.get(key, ""), str):
            raise ValueError(f'{key} must be text in quotes, such as "axis", got {data[key]!r}')
    if "units" in data:
        units = data["units"]
        if (
            not isinstance(units, list)
            or len(units) != 2
            or not all(isinstance(unit, str) for unit in units)
        ):
            raise ValueError(
                f'units must be those of position and force, such as ["m", "N"], got {units!r}'
            )
        found["units"] = (units[0], units[1])
    effects = data.get("effects", [])
    if not isinstance(effects, list):
        raise ValueError(f"effects must be tables headed [[effects]], got {effects!r}")
    found["effects"] = tuple(
        _effect(i, item, found.get("units", ("m", "N"))) for i, item in enumerate(effects)
    )
    return FrictionAxis(**found)


def _coulomb(value: Any) -> CoulombMap:
    if isinstance(value, dict):
        _check_keys("coulomb.", value, ("plus", "minus"))
        if "plus" not in value:
            raise ValueError(
                f"coulomb = {value!r} lacks plus: write coulomb = {{plus = [8.0], minus = [7.5]}}"
            )
        plus: Any = value["plus"]
        return CoulombMap(plus, value.get("minus", plus))
    return CoulombMap.of(value)


def _effect(number: int, data: Any, units: tuple[str, str]) -> Effect:
    """One effect of the list, its parameters named with units where one is missing."""
    place = f"effects[{number}]"
    table = _table(place, data, '{effect = "spring", stiffness = 40.0}')
    slug = table.get("effect")
    if not isinstance(slug, str):
        raise ValueError(f'{place}.effect is {slug!r}: name the effect, such as effect = "spring"')
    if slug not in REGISTRY:
        raise ValueError(f"{place}.effect = {slug!r} is not known: {_hint(slug, REGISTRY)}")
    cls = REGISTRY[slug]
    values = {key: value for key, value in table.items() if key != "effect"}
    _check_keys(f"{place} ({slug}): ", values, [item.name for item in fields(cls)])
    for item in fields(cls):
        if item.default is MISSING and item.name not in values:
            unit = cls.units(units)[item.name]
            raise ValueError(
                f"{place} ({slug}): {item.name} is missing: add {item.name} = ... [{unit}], "
                f"the {item.metadata['doc']}"
            )
    try:
        return cls(**values)
    except ValueError as problem:
        raise ValueError(f"{place}: {problem}") from None
