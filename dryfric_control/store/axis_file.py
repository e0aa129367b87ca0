"""An axis as a text file (TOML), for the command line and for keeping."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import MISSING, fields
from typing import Any

from dryfric_control.checks import instance, known_keys
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.model.axis_arguments import with_mass
from dryfric_control.model.effects import Effect
from dryfric_control.model.effects.effect import REGISTRY
from dryfric_control.model.friction import CoulombMap, Stribeck
from dryfric_control.store.files import read_toml, write_file
from dryfric_control.text import fields_of
from dryfric_control.units import axis_units

_KEYS = tuple(item.name for item in fields(FrictionAxis))
_NEEDED = ("mass", "viscous", "coulomb")
#: Tables that are read by `Scaling.from_file` and by `read_knowledge`.
_OTHERS = ("record", "knowledge")
_EXAMPLE = "mass = 2.0, viscous = 15.0, coulomb = 8.0"
_AXIS = f"{{{_EXAMPLE}}}"


def read_axis(path: str | os.PathLike[str]) -> FrictionAxis:
    """Read an axis from a TOML file.

    Parameters
    ----------
    path : path-like
        Its keys are the fields of `FrictionAxis`: `coulomb` is a level, ``[plus, minus]``, or
        ``{plus = [c0, c1], minus = [c0]}``; ``[stribeck]`` holds excess and speed; every
        ``[[effects]]`` names its effect and the effect's parameters.

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
    return read_toml(
        path,
        lambda data: axis_from_dict({k: v for k, v in data.items() if k not in _OTHERS}),
    )


def read_axes(path: str | os.PathLike[str]) -> dict[str, FrictionAxis]:
    """Axes of several joints by the name of their table in a TOML file, see `read_axis`."""

    def axes(data: dict[str, Any]) -> dict[str, FrictionAxis]:
        found = {}
        for name in [name for name in data if name not in _OTHERS]:
            try:
                found[name] = axis_from_dict({"name": name} | _table(name, data[name], _AXIS))
            except ValueError as problem:
                raise ValueError(f"[{name}]: {problem}") from None
        if not found:
            raise ValueError(f"it has no joint: write a table [elbow] with {_EXAMPLE} for each")
        return found

    return read_toml(path, axes)


def read_knowledge(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Arguments `known` and `tolerance` in the table ``[knowledge]`` of an axis file."""

    def parse_knowledge(found: dict[str, Any]) -> dict[str, Any]:
        if set(found) - {"known", "tolerance"}:
            raise ValueError(
                'knowledge must be a table with known = ["mass"] and tolerance = {viscous = 0.5}, '
                f"got {found!r}"
            )
        return found

    return read_toml(path, parse_knowledge, "knowledge")


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
    write_file(path, axis_text(axis))


def axis_text(axis: FrictionAxis, record: Mapping[str, Any] | None = None) -> str:
    """An axis as TOML text, with a table ``[record]`` where one is given."""
    data = axis_to_dict(axis)
    effects = data.pop("effects")
    lines = [f"{key} = {_toml(value)}" for key, value in data.items()]
    for effect in effects:
        lines += [
            "",
            "[[effects]]",
            *(f"{key} = {_toml(value)}" for key, value in effect.items()),
        ]
    if record:
        lines += [
            "",
            "[record]",
            *(f"{key} = {_toml(value)}" for key, value in record.items()),
        ]
    return "\n".join(lines) + "\n"


def axis_to_dict(axis: FrictionAxis) -> dict[str, Any]:
    """An axis as numbers, texts, lists and dicts, ready for any file format."""
    data = {key: value for key, value in fields_of(axis).items() if value is not None}
    data["effects"] = data.pop("effects")
    return data


def _toml(value: Any) -> str:
    """A value as TOML on one line; repr of a float is exact."""
    if isinstance(value, str):
        # JSON strings are TOML strings but for one character that TOML wants escaped.
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list):
        return f"[{', '.join(map(_toml, value))}]"
    if isinstance(value, dict):
        return f"{{{', '.join(f'{key} = {_toml(one)}' for key, one in value.items())}}}"
    return repr(float(value))


def _table(name: str, value: Any, example: str) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise ValueError(f"{name} must be a table such as {example}, got {value!r}")
    return value


def axis_from_dict(data: Mapping[str, Any]) -> FrictionAxis:
    """An axis from what `axis_to_dict` gives, or a file that a user wrote holds."""
    data = _table("axis", data, _AXIS)
    data = with_mass(dict(data))
    known_keys("", data, _KEYS)
    missing = [key for key in _NEEDED if key not in data]
    if missing:
        raise ValueError(f"{missing[0]} is missing: give at least {_EXAMPLE}")
    found = dict(data)
    found["coulomb"] = _coulomb(data["coulomb"])
    if data.get("stribeck") is not None:
        peak = _table("stribeck", data["stribeck"], "{excess = 0.3, speed = 0.01}")
        known_keys("stribeck.", peak, ("excess", "speed"))
        for key in ("excess", "speed"):
            if key not in peak:
                raise ValueError(f"stribeck.{key} is missing: add {key} = ... to [stribeck]")
        found["stribeck"] = Stribeck(**peak)
    effects = data.get("effects", [])
    if not isinstance(effects, list):
        raise ValueError(f"effects must be tables headed [[effects]], got {effects!r}")
    units = axis_units(data.get("units", ("m", "N")))
    found["effects"] = tuple(_effect(i, item, units) for i, item in enumerate(effects))
    return FrictionAxis(**found)


def _coulomb(value: Any) -> CoulombMap:
    if isinstance(value, dict):
        known_keys("coulomb.", value, ("plus", "minus"))
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
    values = dict(table)
    slug = values.pop("effect", None)
    if not isinstance(slug, str):
        raise ValueError(f'{place}.effect is {slug!r}: name the effect, such as effect = "spring"')
    known_keys(f"{place}.effect = ", [slug], REGISTRY)
    cls = REGISTRY[slug]
    known_keys(f"{place} ({slug}): ", values, [item.name for item in fields(cls)])
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
