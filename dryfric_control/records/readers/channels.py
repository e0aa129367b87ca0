"""The four channels of a source: which column each is, and in which unit."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from dryfric_control.text import did_you_mean

ROLES = ("t", "u", "x", "reference")
ALIASES = {
    "t": ("t", "time", "timestamp", "time_stamp", "zeit", "temps", "seconds"),
    "u": ("u", "input", "force", "torque", "vir", "effort", "command", "voltage", "current",
          "kraft", "moment", "drehmoment", "couple"),
    "x": ("x", "position", "pos", "qm", "q", "angle", "theta", "y", "output", "weg", "lage",
          "winkel"),
    "reference": ("reference", "ref", "r", "qg", "goal", "goal_position", "setpoint", "target",
                  "x_ref", "xref", "desired", "soll", "sollwert", "consigne"),
}  # fmt: skip

# unit -> (factor to SI, SI unit, kind)
_UNITS = {
    **{k: (f, "s", "time") for k, f in
       {"s": 1.0, "sec": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0}.items()},
    **{k: (f, "m", "length") for k, f in
       {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "nm": 1e-9, "inch": 0.0254}.items()},
    **{k: (f, "rad", "angle") for k, f in
       {"rad": 1.0, "mrad": 1e-3, "deg": math.pi / 180, "°": math.pi / 180,
        "rev": 2 * math.pi}.items()},
    **{k: (f, "N", "force") for k, f in
       {"N": 1.0, "uN": 1e-6, "mN": 1e-3, "kN": 1e3, "MN": 1e6}.items()},
    **{k: (f, "N m", "torque") for k, f in
       {"Nm": 1.0, "mNm": 1e-3, "Ncm": 1e-2, "kNm": 1e3}.items()},
    **{k: (f, "V", "voltage") for k, f in {"V": 1.0, "mV": 1e-3}.items()},
    **{k: (f, "A", "current") for k, f in {"A": 1.0, "mA": 1e-3}.items()},
}  # fmt: skip

_BRACKETS = re.compile(r"(.*\S)\s*(?:\[([^\[\]]*)\]|\(([^()]*)\))")


@dataclass(frozen=True)
class Channels:
    """The channels of one source, in SI units, not yet judged."""

    values: dict[str, Any]
    units: dict[str, str]
    notes: tuple[str, ...] = ()
    name: str | None = None
    quantum: float | None = None


def si_unit(role: str, unit: str) -> tuple[float, str]:
    """Factor to SI and SI name of a unit.

    A unit this module does not know is kept, with factor 1; only for the
    time it is refused.

    Parameters
    ----------
    role : str
        ``"t"``, ``"u"``, ``"x"`` or ``"reference"``.
    unit : str
        Unit as written, such as ``"mm"`` or ``"N m"``.

    Returns
    -------
    tuple of float and str

    Raises
    ------
    ValueError
        When the unit cannot belong to this channel.

    Examples
    --------
    >>> si_unit("x", "mm")
    (0.001, 'm')
    >>> si_unit("u", "Nm")
    (1.0, 'N m')
    """
    if not isinstance(unit, str):
        raise ValueError(f"the unit of {role} must be text, got {unit!r}")
    unit = unit.strip()
    key = re.sub(r"[\s·⋅*.]", "", unit).replace("µ", "u").replace("μ", "u")
    factor, si, kind = _UNITS.get(key, (1.0, unit, "unknown"))
    if role == "t" and kind != "time":
        raise ValueError(f"unit {unit!r} of the time is not known; use s, ms, us, ns or min")
    if role != "t" and kind == "time":
        raise ValueError(f"{role} cannot be in {unit!r}, a unit of time; check the columns")
    if not unit.isprintable() or len(unit) > 20 or re.search(r"[\[\](),;\"#]", unit):
        raise ValueError(
            f"unit {unit[:40]!r} of {role} must be a short word without brackets, commas, "
            'semicolons, quotes or "#"'
        )
    return factor, si


def split_header(cell: str) -> tuple[str, str]:
    """Name and unit of a column heading.

    Examples
    --------
    >>> split_header("x [mm]"), split_header("time_ms"), split_header("u / N")
    (('x', 'mm'), ('time', 'ms'), ('u', 'N'))
    """
    cell = cell.strip()
    if len(cell) > 200:  # no heading, and the pattern takes quadratic time
        return cell, ""
    match = _BRACKETS.fullmatch(cell)
    if match:
        return match[1], (match[2] if match[2] is not None else match[3]).strip()
    for mark in ("/", "_"):
        name, found, unit = cell.rpartition(mark)
        known = unit.strip().replace("µ", "u").replace("μ", "u") in _UNITS
        if found and known and any(name.strip().lower() in a for a in ALIASES.values()):
            return name.strip(), unit.strip()
    return cell, ""


def assign_columns(
    headings: list[str], columns: Mapping[str, str | int | None] | None, where: str
) -> dict[str, int]:
    """Index of the column that plays each role.

    Parameters
    ----------
    headings : list of str
        Column headings, with or without units.
    columns : mapping or None
        Role to heading or index; roles left out are recognised by name.
    where : str
        The source, for messages.

    Returns
    -------
    dict of str to int

    Raises
    ------
    ValueError
        For an unknown role or column, an ambiguous or a missing one.
    """
    columns = {} if columns is None else columns
    if not isinstance(columns, Mapping):
        raise ValueError(
            f"columns must map t, u, x and reference to columns, such as "
            f'{{"t": "time", "u": "force", "x": "position"}}; got {columns!r}'
        )
    names = [split_header(h)[0] for h in headings]
    if not headings:
        raise ValueError(f"{where} holds no columns; at least t, u and x are needed")
    chosen: dict[str, int] = {}
    for role, wanted in columns.items():
        if role not in ROLES:
            raise ValueError(
                f"columns: {role!r} is no role; the roles are {', '.join(ROLES)}"
                + did_you_mean(str(role), list(ROLES))
            )
        if wanted is None and role == "reference":
            continue
        chosen[role] = _find_column(role, wanted, headings, names, where)
    for role in ROLES:
        if role not in columns and (found := _recognise(role, names, where)) is not None:
            chosen[role] = found
    if not columns and "t" not in chosen and all(h == "" for h in headings):
        if len(headings) not in (3, 4):
            raise ValueError(
                f"{where} has {len(headings)} columns and no heading; say which is which by "
                'index: columns={"t": 0, "u": 1, "x": 2}'
            )
        return dict(zip(ROLES, range(len(headings)), strict=False))
    for role in ("t", "u", "x"):
        if role not in chosen:
            raise ValueError(
                f"{where}: no column recognised as {role}; available: {_listing(headings)}. "
                f'Say which it is: columns={{"{role}": ...}}'
            )
    for a, b in itertools.combinations(chosen, 2):
        if chosen[a] == chosen[b]:
            raise ValueError(f"{where}: column {headings[chosen[a]]!r} serves as both {a} and {b}")
    return chosen


def _find_column(role: str, wanted: Any, headings: list[str], names: list[str], where: str) -> int:
    """Index of the column the caller asked for."""
    if isinstance(wanted, int) and not isinstance(wanted, bool):
        if not -len(headings) <= wanted < len(headings):
            raise ValueError(
                f"columns[{role!r}] = {wanted}: {where} has {len(headings)} columns, "
                f"0 to {len(headings) - 1}"
            )
        return wanted % len(headings)
    if not isinstance(wanted, str):
        raise ValueError(f"columns[{role!r}] must be a name or an index, got {wanted!r}")
    low = wanted.strip().lower()
    for candidates in (
        [k for k, h in enumerate(headings) if h.strip() == wanted.strip()],
        [k for k, n in enumerate(names) if n == wanted.strip()],
        [k for k, n in enumerate(names) if n.lower() == low],
    ):
        if len(candidates) > 1:
            raise ValueError(
                f"{where}: column {wanted!r} appears {len(candidates)} times; give its index, "
                f"one of {candidates}"
            )
        if candidates:
            return candidates[0]
    raise ValueError(
        f"columns[{role!r}] = {wanted!r} is not in {where}; available: {_listing(headings)}"
        + did_you_mean(wanted, names)
    )


def _recognise(role: str, names: list[str], where: str) -> int | None:
    """Index of the column whose name tells its role, if there is one."""
    exact = [k for k, n in enumerate(names) if n.lower() == role]
    found = exact or [k for k, n in enumerate(names) if n.lower() in ALIASES[role]]
    if len(found) > 1:
        raise ValueError(
            f"{where}: {', '.join(repr(names[k]) for k in found)} could each be {role}; "
            f'say which: columns={{"{role}": ...}}'
        )
    return found[0] if found else None


def _listing(headings: list[str]) -> str:
    shown = ", ".join(repr(h[:40]) for h in headings[:20]) or "none"
    return shown + (f" and {len(headings) - 20} more" if len(headings) > 20 else "")


def to_si(
    values: dict[str, Any],
    stored: Mapping[str, str],
    gain: float,
    declared: Mapping[str, str] | None,
    where: str,
) -> Channels:
    """Convert channels to SI units and apply the input gain.

    Parameters
    ----------
    values : dict
        Role to array.
    stored : mapping
        Units the source states; empty text where it does not.
    gain : float
        Factor on ``u`` after its conversion to SI.
    declared : mapping or None
        Units the caller states: of ``t`` and ``x`` as stored, of ``u``
        after the gain.
    where : str
        The source, for messages.

    Returns
    -------
    Channels

    Raises
    ------
    ValueError
        For a bad gain or units that contradict each other.
    """
    if isinstance(gain, bool) or not isinstance(gain, (int, float, np.number)):
        raise ValueError(f"gain must be a number, got {gain!r}")
    try:
        gain = float(gain)
    except OverflowError:
        gain = math.inf
    if not math.isfinite(gain) or gain == 0:
        raise ValueError(f"gain must be finite and not zero, got {gain}")
    if declared is not None and not isinstance(declared, Mapping):
        raise ValueError(f'units must be a mapping such as {{"x": "mm"}}, got {declared!r}')
    declared = dict(declared or {})
    for key in declared:
        if key not in ("t", "u", "x"):
            raise ValueError(f"units: {key!r} is no channel; the channels are t, u and x")
    units: dict[str, str] = {}
    notes: list[str] = []
    out = dict(values)
    for role in values:
        unit = stored.get(role, "")
        said = declared.get("x" if role == "reference" else role, "")
        factor, si = si_unit(role, unit) if unit else (1.0, "")
        if role == "u" and gain != 1:
            si, factor = "", factor * gain
            notes.append(f"u multiplied by gain {gain:g}")
        if said:
            more, said_si = si_unit(role, said)
            if si and (si, factor) != (said_si, more):
                raise ValueError(
                    f"{where} gives {role} in {unit!r}, units= says {said!r}; leave one out"
                )
            factor, si = (factor if si else factor * more), said_si
            unit = unit or said
        if factor != 1:
            out[role] = scaled(out[role], factor)
            if not (role == "u" and factor == gain):
                notes.append(f"{role} converted from {unit} to {si or 'SI'}")
        if si:
            units[role] = si
    if (r := units.pop("reference", "")) and "x" in units and r != units["x"]:
        raise ValueError(f"{where}: reference is in {r} but x in {units['x']}; they must agree")
    return Channels(out, units, tuple(notes))


def scaled(values: Any, factor: float) -> Any:
    """Values times factor; what cannot be scaled is left to be judged later."""
    array = np.asarray(values)
    return array * factor if array.dtype.kind in "biuf" else values


def too_long(where: str, max_rows: int) -> str:
    return (
        f"{where} has more than {max_rows} rows; cut or decimate it first, "
        "or allow more with max_rows="
    )
