"""Units: names in SI, whether a record and an axis agree, powers, and how an axis prints them.

A table of its own: a general reader of units takes ``MM`` for megamolar and ``counts`` for the
number 1, and does not know ``kNm``; here a name is converted rightly or refused.
"""

from __future__ import annotations

import difflib
import functools
import itertools
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple
from unicodedata import normalize

from dryfric_control.order import check_drive_and_reading
from dryfric_control.text import page_reference


class Unit(NamedTuple):
    """What a name of a unit says: number of `si` in one of it, the SI or raw unit, the quantity."""

    factor: float
    si: str
    kind: str


# A turn and a degree [rad].
_TURN = 2 * math.pi
_DEGREE = math.pi / 180
# An inch and a foot [m].
_INCH = 0.0254
_FOOT = 0.3048
# A pound of force [N].
_POUND = 4.4482216152605
# Prefixes before symbols, and before words.
_PREFIXES = {"": 1.0, "n": 1e-9, "u": 1e-6, "m": 1e-3, "c": 1e-2, "d": 0.1, "da": 10.0, "h": 1e2,
             "k": 1e3, "M": 1e6}  # fmt: skip
_SPOKEN = {"n": ("nano",), "u": ("micro", "mikro"), "m": ("milli", "mili"), "c": ("centi", "zenti"),
           "d": ("deci", "dezi"), "k": ("kilo",), "M": ("mega",)}  # fmt: skip


def _prefixed(symbol: str, prefixes: str, factor: float = 1.0) -> dict[str, float]:
    """A symbol of SI without a prefix and with those that engineers use before it."""
    return {f"{p}{symbol}": _PREFIXES[p] * factor for p in ("", *prefixes.split())}


_SI_LENGTHS = _prefixed("m", "n u m c d")
_SI_ANGLES = _prefixed("rad", "n u m") | _prefixed("deg", "u m", _DEGREE)
_SI_FORCES = _prefixed("N", "n u m c d da k M")
_SI_TIMES = _prefixed("s", "n u m")
_LENGTHS = {**_SI_LENGTHS, "in": _INCH, "mil": 1e-3 * _INCH, "ft": _FOOT}
_ANGLES = {**_SI_ANGLES, "°": _DEGREE, "Grad": _DEGREE, "arcmin": _DEGREE / 60,
           "arcsec": _DEGREE / 3600, "rev": _TURN, "revs": _TURN, "turn": _TURN,
           "turns": _TURN}  # fmt: skip
_FORCES = {**_SI_FORCES, "lbf": _POUND, "lb": _POUND, "kip": 1e3 * _POUND, "klbf": 1e3 * _POUND,
           "ozf": _POUND / 16, "oz": _POUND / 16, "kgf": 9.80665, "gf": 9.80665e-3}  # fmt: skip
_TIMES = {**_SI_TIMES, "100 ns": 1e-7, "min": 60.0}
_SI_OTHERS = (
    (_prefixed("V", "u m k"), "V", "voltage"),
    (_prefixed("A", "n u m k"), "A", "current"),
    (_prefixed("Pa", "h k M"), "Pa", "pressure"),
)
_TABLE: dict[str, Unit] = {
    **{k: Unit(f, "s", "time") for k, f in _TIMES.items()},
    **{k: Unit(f, "m", "length") for k, f in _LENGTHS.items()},
    **{k: Unit(f, "rad", "angle") for k, f in _ANGLES.items()},
    **{k: Unit(f, "N", "force") for k, f in _FORCES.items()},
    **{f"{a}{b}": Unit(_FORCES[a] * _LENGTHS[b], "N m", "torque") for a, b in (
        *itertools.product(_SI_FORCES, ("m", "cm", "mm")),
        ("lbf", "in"), ("lbf", "ft"), ("lb", "in"), ("lb", "ft"), ("ozf", "in"), ("oz", "in"),
        ("kip", "in"), ("kip", "ft"), ("kgf", "cm"), ("kgf", "m"), ("gf", "cm"))},
    **{f"{b}{a}": Unit(_FORCES[a] * _LENGTHS[b], "N m", "torque") for a, b in (
        ("lbf", "in"), ("lbf", "ft"), ("lb", "in"), ("lb", "ft"), ("ozf", "in"), ("oz", "in"),
        ("kip", "in"), ("kip", "ft"))},
    **{k: Unit(f, si, kind) for names, si, kind in _SI_OTHERS for k, f in names.items()},
    **{k: Unit(f, "Pa", "pressure") for k, f in {
        "bar": 1e5, "mbar": 1e2, "psi": 6894.757293168}.items()},
    **{f"{k}/{t}": Unit(f / s, "m/s", "velocity") for k, f in _LENGTHS.items()
       for t, s in _TIMES.items()},
    **{f"{k}/{t}": Unit(f / s, "rad/s", "angular velocity") for k, f in _ANGLES.items()
       for t, s in _TIMES.items()},
    # Turns a minute as drives of each country print them.
    **dict.fromkeys(("rpm", "RPM", "r/min", "U/min", "Umdr/min", "1/min", "min-1", "min^-1",
                     "tr/min", "giri/min", "omw/min", "obr/min"),
                    Unit(_TURN / 60, "rad/s", "angular velocity")),
    **{f"{k}/{s}": Unit(f, "m/s^2", "acceleration") for k, f in _LENGTHS.items()
       for s in ("s2", "s^2")},
    **{f"{k}/{s}": Unit(f, "rad/s^2", "angular acceleration") for k, f in _ANGLES.items()
       for s in ("s2", "s^2")},
    "g": Unit(9.80665, "m/s^2", "acceleration"),
    **dict.fromkeys(("counts", "count", "cnt", "cnts", "cts", "inc", "incs", "increments", "ticks",
                     "tick", "LSB", "lsb", "digits", "pulses", "pulse", "pls", "Inkremente", "Ink",
                     "Impulse", "impulsions", "imp", "pts", "pulsos", "impulsi", "脉冲", "パルス",
                     "펄스"), Unit(1.0, "counts", "raw")),
    **dict.fromkeys(("%", "percent"), Unit(1.0, "%", "raw")),
    **dict.fromkeys(("‰", "permille", "0.1 %", "0.1%"), Unit(0.1, "%", "raw")),
    **dict.fromkeys(("pu", "p.u."), Unit(100.0, "%", "raw")),
}  # fmt: skip

#: Units that are no words and no label, and so are units behind any name: disp_mm, load_kN. In
#: letters of one size nm is a torque as well as a length; A counts the sensors of a machine.
SUFFIXES = frozenset((
    *_SI_LENGTHS, *_SI_ANGLES, *_SI_FORCES, *_SI_TIMES, "bar",
    *(name for names, *_ in _SI_OTHERS for name in names),
    *(name for name, unit in _TABLE.items() if unit.kind == "torque"),
)) - {"nm", "A"}  # fmt: skip

# Quantities that a channel may be; a sensor may give the position as a voltage.
_SENSED = ("raw", "voltage", "current")
_KINDS = {
    "t": ("time",),
    "u": ("force", "torque", *_SENSED, "pressure"),
    "x": ("length", "angle", *_SENSED),
    "v": ("velocity", "angular velocity", *_SENSED),
    "a": ("acceleration", "angular acceleration", *_SENSED),
}
_SAME = {"reference": "x", "x2": "x", "load": "u"}
_USUAL = {
    "t": "s, ms, us, ns or min",
    "u": "N, kN, lbf, N m, N cm, lbf in, V, A, mA, bar, % or counts",
    "x": "m, mm, um, in, ft, rad, deg, rev, V or counts",
    "v": "m/s, mm/s, rad/s, deg/s or rpm",
    "a": "m/s^2, mm/s^2, g, rad/s^2 or deg/s^2",
}


# Words for units in several languages, small letters or not; of metres, newtons and the like also
# behind a prefix. Volts and amperes are not among them: input_volts is no input.
_WITH_PREFIX = {
    "m": "meter meters metre metres mètre mètres metro metros metri",
    "rad": "radian radians radiant radians radianes radianti radianos",
    "N": "newton newtons",
    "Nm": "newtonmeter newtonmeters newtonmetre newtonmetres",
    "s": "second seconds seconde secondes sekunde sekunden segundo segundos secondo secondi",
}
_WORDS = {
    word: name
    for name, words in {
        "s": "sec secs 秒", "ms": "msec 毫秒 ミリ秒", "us": "usec 微秒", "ns": "nsec",
        "m": "米 メートル", "mm": "毫米 ミリ", "um": "micron microns 微米",
        "in": "inch inches", "ft": "foot feet",
        "rad": "rad 弧度 ラジアン",
        "deg": "deg degree degrees degré degrés grados gradi graus graden 度",
        "N": "牛 牛顿 ニュートン", "bar": "bars",
        "%": "percent", "rev": "revolution revolutions",
    }.items()
    for word in words.split()
} | {
    f"{spoken}{word}": f"{prefix}{symbol}"
    for symbol, words in _WITH_PREFIX.items()
    for prefix, said in (("", ("",)), *_SPOKEN.items())
    if f"{prefix}{symbol}" in _TABLE
    for spoken in said
    for word in words.split()
}  # fmt: skip

# Letters of a word in which a slip is recognised, and how near it is to the right one, of 1.
_LEAST_WORD = 6
_NEAR = 0.9

# A power of ten before a unit: 0.1 %, 0,01 mm, 1000 N.
_TIMES_TEN = re.compile(r"(10+|0[.,]0*1)\s*(\D.*)")


def known_unit(unit: str) -> Unit | None:
    """The unit of a name, None for a name that is not known."""
    # Wide letters and signs, and µ of either kind, by the usual ones.
    text = normalize("NFKC", unit.strip()).replace("μ", "u")
    found = _TABLE.get(text)
    if found is None and (match := _TIMES_TEN.fullmatch(text)):
        part = known_unit(match[2])
        return part and part._replace(factor=float(match[1].replace(",", ".")) * part.factor)
    if found is None:
        text = re.sub(r"[^\W\d_]+", lambda word: _WORDS.get(word[0].casefold(), word[0]), text)
        text = text.replace(" per ", "/")
        # Only a product or a quotient has marks in it: "m rad" is not "mrad".
        joined = _TABLE.get(re.sub(r"[\s·⋅・*.-]", "", text))
        marked = joined and (joined.kind == "torque" or "/" in joined.si)
        found = _TABLE.get(text) or (joined if marked else None)
    return found


def _meant_unit(unit: str, kinds: Sequence[str]) -> str:
    """Question that names what a unit is but for its capitals or a slip in a word.

    Nothing where names of several units, or of one ten times as large, are as near.
    """
    names = {name: found for name, found in _TABLE.items() if found.kind in kinds}
    names.pop("Grad", None)  # grad is 1/400 of a turn
    names |= {word: names[name] for word, name in _WORDS.items() if name in names}
    near = [name for name in names if name.casefold() == unit.casefold()]
    if not near and len(unit) >= _LEAST_WORD:
        near = difflib.get_close_matches(unit.casefold(), names, n=5, cutoff=_NEAR)
    one = len({names[name] for name in near}) == 1
    return f". Did you mean {near[0]!r}?" if one else ""


def si_unit(role: str, unit: str) -> tuple[float, str]:
    """Factor to SI and SI name of the unit of a channel; counts and per cent keep their name."""
    if not isinstance(unit, str):
        raise ValueError(f"the unit of {role} must be text, got {unit!r}")
    unit = unit.strip()
    base = _SAME.get(role, role)
    found = known_unit(unit)
    if found is None and (
        not unit.isprintable() or len(unit) > 20 or re.search(r"[\[\](),;\"#]", unit)
    ):
        raise ValueError(
            f"unit {unit[:40]!r} of {role} must be a short word without brackets, commas, "
            f'semicolons, quotes or "#"; state it, units={{"{base}": "..."}}: {_USUAL[base]}'
        )
    if base == "t" and (found is None or found.kind != "time"):
        raise ValueError(f"unit {unit!r} of the time is not known; use {_USUAL['t']}")
    if found is None:
        raise ValueError(
            f"unit {unit!r} of {role} is not known{_meant_unit(unit, _KINDS[base])}; state it, "
            f'units={{"{base}": "..."}}: use {_USUAL[base]}, or give what one is worth: '
            f'gain={{"{base}": ...}} and units={{"{base}": "..."}} of the product'
        )
    if found.kind not in _KINDS[base]:
        raise ValueError(f"{role} cannot be in {unit!r}, a unit of {found.kind}; check the columns")
    return found.factor, found.si


_SYSTEMS = (("m", "N"), ("rad", "N m"))


def axis_units(units: Any) -> tuple[str, str]:
    """Units of position and force of an axis, by the names that are used in print."""
    mend = 'give ("m", "N") or ("rad", "N m")'
    if not isinstance(units, (tuple, list)) or [type(unit) for unit in units] != [str, str]:
        raise ValueError(f'units must be of position and force, such as ("m", "N"), got {units!r}')
    names = list(units)
    kinds = []
    for k, (role, what) in enumerate((("x", "position"), ("u", "force"))):
        found = known_unit(units[k])
        kinds.append(found.kind if found else "")
        if found is None or found.kind == "raw":
            continue
        if found.kind not in _KINDS[role]:
            raise ValueError(
                f"units = {tuple(units)}: {what} cannot be in {units[k]!r}, a unit of "
                f"{found.kind}; {mend}, position first"
            )
        if found.factor != 1.0:
            raise ValueError(
                f"units = {tuple(units)}: an axis has its numbers in {found.si!r}, not in "
                f"{units[k]!r}; {mend}, and mass, friction and effects in these units. Records "
                f"in {units[k]!r} are converted as they are read"
            )
        names[k] = found.si
    if kinds in (["length", "torque"], ["angle", "force"]):
        raise ValueError(f"units = {tuple(units)} are not those of one axis; {mend}")
    return names[0], names[1]


def usual_units(stated: Mapping[str, str]) -> tuple[str, str]:
    """Units of position and drive of a record, one that nobody stated as the other has it."""
    length, force = _SYSTEMS[stated.get("x") == "rad" or stated.get("u") == "N m"]
    return stated.get("x") or length, stated.get("u") or force


def check_units(axis: Any, record: Any, name: str = "record") -> None:
    """Refuse a record whose units, or drive and position, are not those of the axis."""
    for role, wanted in zip("xu", axis.units, strict=True):
        unit = record.units.get(role, "")
        if not unit or not wanted or same_unit(unit, wanted):
            continue
        if role == "u" and any(effect.slug == "input_gain" for effect in axis.effects):
            continue
        have = (record.units.get("x") or axis.units[0], record.units.get("u") or axis.units[1])
        raise ValueError(
            f"{name}: {role} is in {unit!r}, the axis has {wanted!r} (axis.units = {axis.units}). "
            f"Convert the record as it is read, gain={{'{role}': ...}} [{wanted} per {unit}] and "
            f"units={{'{role}': '{wanted}'}}, or gain=dfc.Scaling(...)"
            + (
                f", or give the axis its numbers in {have[0]} and {have[1]} with units={have}"
                if have in _SYSTEMS
                else ", or check the columns"
            )
            + (f", or an effect InputGain [{wanted} per {unit}]" if role == "u" else "")
            + page_reference("howto/read_csv")
        )
    check_drive_and_reading(axis, record.dt, record.u, record.x, (f"{name}.u", f"{name}.x"))


def same_unit(one: str, other: str) -> bool:
    """Whether two names mean one unit."""
    a = known_unit(one)
    b = known_unit(other)
    if a is None or b is None:
        return one.strip() == other.strip()
    return (a.factor, a.si) == (b.factor, b.si)


#: Powers of force, length and time; on a rotary axis the radian is the length.
_SYMBOLS = {
    "N": (1, 0, 0),
    "m": (0, 1, 0),
    "rad": (0, 1, 0),
    "s": (0, 0, 1),
    "Hz": (0, 0, -1),
    "kg": (1, -1, 2),
}
# A torque is the force of a rotary axis, and so on.
_TURNING = {("N", "m"): "N", ("kg", "m^2"): "kg"}
_MASS = {("m", "N"): "kg", ("rad", "N m"): "kg m^2"}


def powers(unit: str) -> tuple[int, int, int]:
    """Powers of force, length and time in a unit such as "N s/m"; zeros for an unknown one."""
    total = [0, 0, 0]
    for symbol, power in _factors(unit):
        for i, own in enumerate(_SYMBOLS.get(symbol, (0, 0, 0))):
            total[i] += power * own
    return (total[0], total[1], total[2])


@functools.cache
def on_axis(unit: str, units: tuple[str, str]) -> str:
    """A unit, given for metres and newtons, such as "N s/m", in the units of an axis."""
    length, force = units
    factors = list(_factors(unit))
    if factors == [("kg", 1)] and units in _MASS:
        return _MASS[units]
    named = {"N": force, "m": length, "rad": length}
    above: list[str] = []
    below: list[str] = []
    for symbol, power in factors:
        parts = [(symbol, power)]
        if symbol == "kg":
            parts = [("N", power), ("s", 2 * power), ("m", -power)]
        for name, p in parts:
            text = named.get(name, name)
            if abs(p) > 1:
                text = f"({text})^{abs(p)}" if " " in text else f"{text}^{abs(p)}"
            elif " " in text and p < 0:
                text = f"({text})"
            (above if p > 0 else below).append(text)
    top = " ".join(above) or "1"
    return f"{top}/{' '.join(below)}" if below else top


def _factors(unit: str) -> Iterator[tuple[str, int]]:
    """Symbols of a unit with their powers."""
    above, _, below = unit.partition("/")
    for sign, side in ((1, above), (-1, below)):
        words = side.replace("(N m)", "N").split()
        while words:
            pair = tuple(words[:2])
            if pair in _TURNING:
                yield _TURNING[pair], sign
                del words[:2]
                continue
            name, _, power = words.pop(0).partition("^")
            if name != "1":
                yield name, sign * int(power) if power.isdigit() else sign
