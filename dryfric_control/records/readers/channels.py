"""The channels of a source: which column each is, and in which unit."""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from dryfric_control.records.scaling import Scaling
from dryfric_control.text import did_you_mean
from dryfric_control.units import known_unit, si_unit

ROLES = ("t", "u", "x", "reference")
MAX_ROWS = 10_000_000  # 0.3 GB for four columns
#: Channels that are kept with a record beside those that it needs.
EXTRAS = ("v", "a", "x2")

# What a column is called, and how what was measured and what was asked for are marked.
_POSITION = ("x", "pos", "position", "q", "angle", "theta", "phi", "enc", "encoder", "weg", "lage",
             "winkel", "joint_position", "joint_pos", "joint_angle", "axis_position")  # fmt: skip
_DRIVE = ("u", "i", "iq", "i_q", "current", "tau", "torque", "force", "effort", "voltage", "kraft",
          "moment", "drehmoment", "strom", "motor_current", "motor_torque", "motor_force",
          "motor_voltage", "joint_torque")  # fmt: skip
_VELOCITY = ("v", "velocity", "vel", "speed", "omega", "dq", "qd", "qdot", "geschwindigkeit",
             "drehzahl", "vitesse")  # fmt: skip
_ACCELERATION = ("a", "acceleration", "acc", "accel", "ddq", "qdd", "beschleunigung")
_MEASURED = ("act", "actual", "actual_value", "meas", "measured", "fb", "feedback", "ist")
_ASKED = ("cmd", "command", "commanded", "ref", "reference", "des", "desired", "set", "setpoint",
          "sp", "target", "demand", "demand_value", "goal", "soll")  # fmt: skip


def _marked(stems: tuple[str, ...], marks: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(n for s in stems for m in marks for n in (f"{s}_{m}", f"{m}_{s}"))


#: Usual names of the channels, in lower case, words joined by "_"; the first group of which a
#: source has a column decides.  A position that was asked for is the reference; a drive that was
#: asked for is the input where none was measured.
NAMES = {
    "t": (("t", "time", "timestamp", "time_stamp", "zeit", "temps", "seconds"),),
    "u": (("u",),
          ("input", "force", "torque", "vir", "effort", "command", "voltage", "current", "kraft",
           "moment", "drehmoment", "couple"),
          ("motor_current", "motor_torque", "drive_force", "motor_force"),
          ("iq", "i_q", "tau", "motor_voltage", "joint_torque", "pwm", "duty", "strom",
           *_marked(_DRIVE, _MEASURED)),
          _marked(_DRIVE, _ASKED)),
    "x": (("x",),
          ("position", "pos", "qm", "q", "angle", "theta", "y", "output", "weg", "lage", "winkel"),
          (*_marked(_POSITION, _MEASURED), "joint_position", "joint_pos", "joint_angle",
           "axis_position", "phi"),
          ("counts", "encoder", "encoder_counts", "encoder_position", "enc", "enc_pos")),
    "reference": (("reference",),
                  ("ref", "r", "qg", "goal", "goal_position", "setpoint", "target", "x_ref",
                   "xref", "desired", "soll", "sollwert", "consigne"),
                  _marked(_POSITION, _ASKED)),
    "v": (_VELOCITY, _marked(_VELOCITY, _MEASURED)),
    "a": (_ACCELERATION, _marked(_ACCELERATION, _MEASURED)),
    "x2": (("x2", "second_encoder", "encoder2", "load_position", "x_load", "motor_position",
            "x_motor"),),
}  # fmt: skip
_ROLES = {n: role for role, groups in NAMES.items() for names in groups for n in names}

_BRACKETS = re.compile(r"(.*\S)\s*(?:\[([^\[\]]*)\]|\(([^()]*)\))")


@dataclass(frozen=True)
class Channels:
    """The channels of one source, in SI units, not yet judged."""

    values: dict[str, Any]
    units: dict[str, str]
    notes: tuple[str, ...] = ()
    name: str | None = None
    quantum: float | None = None
    raw: dict[str, tuple[str, float]] = field(default_factory=dict)
    timed: bool = True


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
        roles = [_ROLES[n] for n in spellings(name) if n in _ROLES]
        if found and roles and known_unit(unit) and _fits(roles[0], unit):
            return name.strip(), unit.strip()
    return cell, ""


def spellings(name: str) -> set[str]:
    """A heading in lower case, and with its words joined by "_".

    Examples
    --------
    >>> sorted(spellings("ActualPosition")), sorted(spellings("Torque cmd"))
    (['actual_position', 'actualposition'], ['torque cmd', 'torque_cmd'])
    """
    name = name.strip()
    words = re.sub(r"(?<=[a-z])(?=[A-Z])|[ -]+", "_", name)
    return {name.lower(), words.lower()}


def _fits(role: str, unit: str) -> bool:
    """Whether a channel may be in a unit."""
    try:
        si_unit(role, unit)
    except ValueError:
        return False
    return True


def assign_columns(
    headings: list[str],
    columns: Mapping[str, str | int | None] | None,
    where: str,
    timed: bool | None = True,
) -> dict[str, int]:
    """Index of the column that plays each role.

    Parameters
    ----------
    headings : list of str
        Column headings, with or without units.
    columns : mapping or None
        Role to heading or index; roles left out are recognised by name, those with None not.
    where : str
        The source, for messages.
    timed : bool, optional
        Whether a column of time is needed; False for none, None for perhaps.

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
        if role not in (*ROLES, *EXTRAS):
            raise ValueError(
                f"columns: {role!r} is no role; the roles are {', '.join((*ROLES, *EXTRAS))}"
                + did_you_mean(str(role), [*ROLES, *EXTRAS])
            )
        if wanted is None and (role not in ("t", "u", "x") or (role == "t" and not timed)):
            continue
        chosen[role] = _find_column(role, wanted, headings, names, where)
    if not columns and all(h == "" for h in headings):
        roles = ROLES[1:] if timed is False or (timed is None and len(headings) < 3) else ROLES
        if len(headings) not in (len(roles) - 1, len(roles)):
            raise ValueError(
                f"{where} has {len(headings)} columns and no heading; say which is which by "
                'index: columns={"t": 0, "u": 1, "x": 2}'
            )
        return dict(zip(roles, range(len(headings)), strict=False))
    for role in ROLES[:3]:
        if role not in columns and (found := _recognise(role, names, where)) is not None:
            chosen[role] = found
    for role in ("reference", *EXTRAS):
        found = None if role in columns else _extra(role, headings, names)
        if found is not None and found not in chosen.values():
            chosen[role] = found
    for role in ("t", "u", "x"):
        if role not in chosen and (role != "t" or timed):
            raise ValueError(
                f"{where}: no column recognised as {role}; available: {_listing(headings)}. "
                f'Say which it is: columns={{"{role}": ...}}'
                + (", or give rate= [samples per s] if there is none" if role == "t" else "")
            )
    for a, b in itertools.combinations(chosen, 2):
        if chosen[a] == chosen[b]:
            raise ValueError(f"{where}: column {headings[chosen[a]]!r} serves as both {a} and {b}")
    return chosen


def _extra(role: str, headings: list[str], names: list[str]) -> int | None:
    """Index of a column that is such a channel beyond doubt, by name and unit."""
    found = named(role, names)
    if len(found) != 1:
        return None
    unit = split_header(headings[found[0]])[1]
    return found[0] if not unit or _fits(role, unit) else None


def left_out(headings: list[str], chosen: Mapping[str, int]) -> tuple[str, ...]:
    """Note that names the columns of a source that play no role."""
    rest = [h for k, h in enumerate(headings) if k not in chosen.values() and h]
    return (f"left out: {_listing(rest)}",) if rest else ()


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


def named(role: str, names: list[str]) -> list[int]:
    """Columns of the first group of usual names of which there are any."""
    for usual in NAMES[role]:
        if found := [k for k, n in enumerate(names) if not spellings(n).isdisjoint(usual)]:
            return found
    return []


def _recognise(role: str, names: list[str], where: str) -> int | None:
    """Index of the column whose name shows its role, if there is one."""
    found = named(role, names)
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
    gain: float | Mapping[str, float] | Scaling,
    declared: Mapping[str, str] | None,
    where: str,
) -> Channels:
    """Convert channels to SI units and apply the gains.

    Parameters
    ----------
    values : dict
        Role to array.
    stored : mapping
        Units the source states; empty text where it does not.
    gain : float, mapping or Scaling
        Factor on ``u``, factors by channel, or numbers of the machine; applied after
        the conversion to SI.
    declared : mapping or None
        Units the caller states: as stored, of a channel with a gain after it.
    where : str
        The source, for messages.

    Raises
    ------
    ValueError
        For a bad gain or units that contradict each other.
    """
    scaling = Scaling.of(gain)
    if declared is not None and not isinstance(declared, Mapping):
        raise ValueError(f'units must be a mapping such as {{"x": "mm"}}, got {declared!r}')
    declared = dict(declared or {})
    for key in declared:
        if key not in ("t", "u", "x", *EXTRAS):
            raise ValueError(f"units: {key!r} is no channel; the channels are t, u and x")
    for key in scaling.gain:
        if key not in values:
            raise ValueError(f"gain: {where} has no channel {key!r}; it has {', '.join(values)}")
    units: dict[str, str] = {}
    notes: list[str] = []
    raw: dict[str, tuple[str, float]] = {}
    out = dict(values)
    for role in values:
        unit = stored.get(role, "")
        said = declared.get("x" if role == "reference" else role, "")
        own = scaling.gain.get("x" if role == "reference" else role)
        factor, si = si_unit(role, unit) if unit else (1.0, "")
        if own is not None:
            si, factor = "", factor * own
            notes.append(f"{role} multiplied by gain {own:g}")
        if said:
            more, said_si = si_unit(role, said)
            if si and (si, factor) != (said_si, more):
                raise ValueError(
                    f"{where} gives {role} in {unit!r}, units= says {said!r}; leave one out"
                )
            factor, si = (factor if si else factor * more), said_si
            unit = unit or (said if own is None else "")
        if own is None and (found := scaling.conversion(role, si)):
            factor, unit, si = factor * found.factor, unit or found.raw, found.unit
            notes.append(f"{role} converted from {unit} to {si} with factor {factor:.6g}")
        elif factor != 1 and factor != own:
            notes.append(f"{role} converted from {unit or said} to {si or 'SI'}")
        if factor != 1:
            out[role] = scaled(out[role], factor)
        if factor != 1 or (unit and unit != si):
            raw[role] = (unit, factor)
        if si:
            units[role] = si
    if (r := units.pop("reference", "")) and "x" in units and r != units["x"]:
        raise ValueError(
            f"{where}: reference is in {r} but x in {units['x']}; they must agree, "
            "or leave it out: columns={'reference': None}"
        )
    return Channels(out, units, tuple(notes), raw=raw)


def scaled(values: Any, factor: float) -> Any:
    """Values times factor; what cannot be scaled is left to be judged later."""
    array = np.asarray(values)
    if array.dtype.kind not in "iuf":
        return values
    with np.errstate(over="ignore"):  # beyond float64 becomes inf, refused later
        return np.asarray(array, dtype=np.float64) * factor


def too_long(where: str, max_rows: int) -> str:
    return (
        f"{where} has more than {max_rows} rows; cut or decimate it first, "
        "or allow more with max_rows="
    )
