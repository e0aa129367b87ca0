"""The channels of a source: which column each is, and in which unit."""

from __future__ import annotations

import itertools
import re
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple
from unicodedata import normalize

import numpy as np

from dryfric_control.records.bad_readings import REASONS
from dryfric_control.records.record_warning import warn
from dryfric_control.records.refusal import RefusalError
from dryfric_control.records.scaling import Gain, Scaling
from dryfric_control.text import did_you_mean, page_reference
from dryfric_control.units import SUFFIXES, known_unit, si_unit, usual_units

ROLES = ("t", "u", "x", "reference")
MAX_ROWS = 10_000_000  # 0.3 GB for four columns
EXACT = 2**53  # beyond, float64 leaves whole numbers out
#: Channels that are kept with a record beside those that it needs.
EXTRAS = ("v", "a", "x2", "load")

# What a column is called.
_SAID = tomllib.loads(Path(__file__).with_name("headings.toml").read_text(encoding="utf-8"))


def _names(entry: str) -> tuple[str, ...]:
    """Names that an entry of the file stands for: itself, or stems with or without marks."""
    if entry[0] != "<":
        return (entry,)
    kind, _, mark = entry.strip("<>").partition(" ")
    stems = _SAID["stems"][kind]
    marks = _SAID["marks"].get(mark)
    close = _SAID["marks"]["joined"]
    if marks is None:
        return tuple(stems)
    parted = (n for s in stems for m in marks for n in (f"{s}_{m}", f"{m}_{s}"))
    # A short stem of a language with letters, joined to a mark, may be another word.
    joined = (n for s in stems if len(s) > 2 or not s.isascii() for m in marks if m in close
              for n in (f"{s}{m}", f"{s}s{m}", f"{m}{s}"))  # fmt: skip
    return (*parted, *joined)


#: Usual names of the channels in groups, see the file.
NAMES = {
    role: tuple(tuple(n for entry in group for n in _names(entry)) for group in groups)
    for role, groups in _SAID["channels"].items()
}
_ROLES = {n: role for role, groups in NAMES.items() for names in groups for n in names}
_DIRECTIONS, _FILLING, _PREFIXES, _LETTERS, _DERIVED, _DERIVED_WITHIN, _BEFORE = map(
    set, _SAID["parts"].values()
)
#: Letters of physics that are taken where no name is recognised, and noted.
_SYMBOLS = {letter: role for role, letters in _SAID["symbols"].items() for letter in letters}
#: Quantities of the units that show what a column is where no name does, the surest first.
_BY_UNIT = {
    "u": (("force", "torque"), ("pressure",), ("current",), ("voltage",)),
    "x": (("length", "angle"),),
    "t": (("time",),),
}

_BRACKETS = re.compile(r"(.*\S)\s*(?:\[([^\[\]]*)\]|\(([^()]*)\))")
# Numbers of words that a unit may have behind a mark: _rad_s2, _N_m, _N.
_UNIT_WORDS = {"/": (1,), " in ": (1,), "_": (3, 2, 1), " ": (1,)}


class Meaning(NamedTuple):
    """What a heading says, each empty where it does not say it."""

    role: str = ""
    usual: str = ""  # the name of the role that is in the heading
    joint: str = ""


class DriveQuantity(NamedTuple):
    """What a drive is by its heading, both empty where this does not say it."""

    quantity: str = ""
    heading: str = ""


@dataclass(frozen=True)
class Channels:
    """The channels of one source by role, not yet judged, and what is known of them."""

    where: str
    values: dict[str, Any] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    name: str | None = None
    quantum: float | None = None
    raw: dict[str, tuple[str, float]] = field(default_factory=dict)
    timed: bool = True
    masked: tuple[str, ...] | None = None
    clocks: dict[str, Any] = field(default_factory=dict)  # stamps of channels with their own
    lacking: str = ""  # what to say of the first number that is missing
    drive: DriveQuantity = field(default_factory=DriveQuantity)


class Wanted(NamedTuple):
    """What a caller says of the columns of a source."""

    columns: Any = None  # by role: heading, index, or None for none
    joint: str | int | None = None  # that of which columns are wanted
    timed: bool | None = True  # whether there is a column of time, None for perhaps
    lenient: bool = False  # numbers may be missing
    max_rows: int = MAX_ROWS
    hold: str = "zero"  # how the input runs between its stamps, if it has its own
    database: Any = None  # what says where the channels are in the frames of a bus


class Clues(NamedTuple):
    """Columns, by index, of which the first values are those of a clock."""

    dates: tuple[int, ...] = ()  # or durations, or counts from a date
    rising: tuple[int, ...] = ()  # numbers that only rise, not those of the rows


def own_notes(meta: Any, damaged: str) -> dict[str, Any]:
    """What `Record.to_csv` and `to_pandas` keep beside the columns, as fields of `Channels`."""
    try:
        name, quantum, notes = meta["name"], meta["quantum"], meta["notes"]
        raw = {role: (unit, factor) for role, (unit, factor) in meta.get("raw", {}).items()}
        masked = tuple(meta["masked"]) if "masked" in meta else None
        said = [*notes, *(unit for unit, _ in raw.values()), *([] if name is None else [name])]
        sound = (
            isinstance(notes, list)
            and all(isinstance(one, str) for one in said)
            and all(_is_factor(factor) for _, factor in raw.values())
            and _is_quantum(quantum)
            and set(masked or ()) <= set(REASONS)
        )
    except (ValueError, KeyError, TypeError, AttributeError):
        sound = False
    if not sound:
        raise ValueError(f"{damaged} to read plain columns")
    return {"name": name, "quantum": quantum, "notes": tuple(notes), "raw": raw, "masked": masked}


def _is_factor(value: Any) -> bool:
    """Whether a value is a float that may convert a unit."""
    return type(value) is float and 0.0 < abs(value) < 1e100


def _is_quantum(value: Any) -> bool:
    """Whether a value is the increment of an encoder, or None."""
    return value is None or (type(value) is float and 0.0 <= value < 1e100)


@lru_cache(maxsize=4096)
def split_header(cell: str) -> tuple[str, str]:
    """Name and unit of a column heading."""
    cell = cell.strip()
    if any("\u3000" <= letter for letter in cell):  # brackets and signs as wide as a character
        cell = normalize("NFKC", cell)
    if len(cell) > 200:  # no heading, and the pattern takes quadratic time
        return cell, ""
    if match := _BRACKETS.fullmatch(cell):
        return _split_brackets(match)
    if found := _split_usual_name(cell):
        return found
    return (cell, "") if parse_heading(cell).role else _split_other_name(cell)


def _split_brackets(match: re.Match[str]) -> tuple[str, str]:
    """Name and unit of a heading with brackets; a number in them is no unit."""
    unit = (match[2] if match[2] is not None else match[3]).strip()
    unit = unit.removeprefix("in ").strip()
    return (match[0], "") if unit.isdigit() else (match[1].rstrip(" /"), unit)


def _split_usual_name(cell: str) -> tuple[str, str] | None:
    """Name of a channel and a unit that it may have; None where a heading does not end in one."""
    for mark, tails in _UNIT_WORDS.items():
        words = cell.split(mark)
        for tail in tails:
            name = mark.join(words[:-tail])
            role = parse_heading(name).role or (mark == "/" and _symbol_role(name))
            for unit in {"/".join(words[-tail:]), " ".join(words[-tail:])}:
                if role and known_unit(unit) and _fits(role, unit):
                    return name.strip(), unit.strip()
    return None


def _split_other_name(cell: str) -> tuple[str, str]:
    """Name and unit of a column whose name is not known: DIN 1313 writes Hubkraft / N."""
    parts: list[tuple[str, str, Callable[[str], Any]]] = [
        (*cell.rpartition(mark)[::2], known_unit) for mark in (" in ", " / ")
    ]
    # Parts of a path and words of a name have no blanks either: only what is no word.
    parts.append((*cell.partition("/")[::2], SUFFIXES.__contains__))
    words = cell.split("_")
    for tail in _UNIT_WORDS["_"]:
        if words[-tail:][0] in SUFFIXES:
            for mark in ("/", " "):
                parts.append(("_".join(words[:-tail]), mark.join(words[-tail:]), known_unit))
    for name, unit, is_unit in parts:
        if len(name.strip()) > 1 and is_unit(unit.strip()) and not parse_heading(name).role:
            return name.strip(), unit.strip()
    return cell, ""


def _symbol_role(name: str) -> str:
    """Role of a letter of physics; empty for any other name."""
    return _SYMBOLS.get(name.strip().casefold(), "")


def normalize_heading(name: str) -> str:
    """A heading in lower case without accents, its words joined by "_"."""
    # Accents are marks of Latin, Greek and Cyrillic; those of kana make another syllable.
    name = re.sub("[\u0300-\u036f]", "", normalize("NFKD", name.strip(" _")))
    name = normalize("NFC", name)
    return re.sub(r"(?<=[a-z])(?=[A-Z])|[ -]+", "_", name).casefold()


@lru_cache(maxsize=4096)
def parse_heading(name: str) -> Meaning:
    """Role of a heading, its usual name, and the joint it is of."""
    usual = normalize_heading(name)
    of_machine = [usual.removeprefix(word) for word in _BEFORE if usual.startswith(word)]
    for one in (usual, name.strip().casefold(), *of_machine):
        if one in _ROLES:
            return Meaning(_ROLES[one], one)
    return Meaning() if _is_derived(name) else _path_meaning(name)


def _path_meaning(name: str) -> Meaning:
    """Meaning of a heading by its last parts, as of a path."""
    for marks in (r"[./\\:()\[\]]+", r"[./\\:()\[\]\s]+"):  # a name may have blanks in it
        parts = [part for part in re.split(marks, name) if part.strip()]
        last = range(len(parts), max(0, len(parts) - 3), -1)
        if found := [meaning for k in last if (meaning := _part_meaning(parts, k))]:
            break
    else:
        return Meaning()
    # A letter may be the name of a joint or a direction in space, behind what it is of.
    best = min(found, key=lambda meaning: len(meaning.usual) == 1)
    is_path = sum(not part.isdigit() for part in parts) > 1
    if is_path and len(best.usual) == 1 and best.usual not in _LETTERS:
        return Meaning()
    return best


def _is_derived(name: str) -> bool:
    """Whether a heading says that it is an error, a limit or a share of a channel."""
    words = re.findall(r"[^\W\d_]+", normalize_heading(name))
    return any(w in _DERIVED or any(part in w for part in _DERIVED_WITHIN) for w in words)


def _part_meaning(parts: list[str], k: int) -> Meaning | None:
    """Meaning of the k-th part of a name; what follows is the joint, or a number in it."""
    found = re.findall(r"[^\W\d_]+|\d+", normalize_heading(parts[k - 1]))
    words = _stem_words(found)
    without_prefix = words[1:] if set(words[:1]) & _PREFIXES else []
    undirected = words[:-1] if len(words) > 1 and words[-1] in _DIRECTIONS else []
    for form in (words, without_prefix, undirected):
        usual = "_".join(form)
        role = _ROLES.get(usual, "")
        if role in ("", "x2", "good"):
            continue
        if form == undirected:
            return Meaning(role, usual, words[-1])
        numbers = [word for word in found if word.isdigit()]
        before = [n for part in parts[: k - 1] for n in re.findall(r"\d+", part)]
        return Meaning(role, usual, ".".join(parts[k:] or numbers or before[-1:]))
    return None


def _stem_words(words: list[str]) -> list[str]:
    """Words of a part of a name without the joint, numbers and filling words."""
    if len(words) > 2 and words[1].isdigit() and words[0] in _SAID["stems"]["position"]:
        words = words[2:]  # q3_tau: the torque of a joint that is called q3
    following = [*words[1:], ""][: len(words)]  # M1: the first motor
    words = [w for w, n in zip(words, following, strict=True) if w != "m" or not n.isdigit()]
    return [w for w in _of_franka(words) if not w.isdigit() and w not in _FILLING]


def _of_franka(words: list[str]) -> list[str]:
    """Words of a heading from `tau_J` on, what stands before it left out unless it asks."""
    for k in range(1, len(words) - 1):
        if words[k : k + 2] == ["tau", "j"]:
            asked = set(words[:k]) & set(_SAID["marks"]["asked"])
            return ["tau", "j", "d"] if asked else words[k:]
    return words


def _fits(role: str, unit: str) -> bool:
    """Whether a channel may be in a unit, if it has one."""
    try:
        return not unit or bool(si_unit(role, unit))
    except (ValueError, KeyError):  # a mask is in no unit
        return False


def assign_columns(
    headings: list[str], wanted: Wanted | None, where: str, clues: Clues | None = None
) -> dict[str, int]:
    """Index of the column for each role, as the caller says or by usual names."""
    wanted = wanted or Wanted()
    clues = clues or Clues()
    columns = _checked_columns(wanted.columns)
    timed = wanted.timed
    if not headings:
        raise ValueError(f"{where} holds no columns; at least t, u and x are needed")
    names = _column_names(headings, wanted.joint, where)
    if not columns and not any(headings):
        return _in_order(len(headings), where, timed)
    chosen = _caller_columns(columns, headings, names, timed, where)
    for role in NAMES:
        if role in columns:
            continue
        found = _usual_columns(role, headings, names, chosen, timed, clues)
        if len(found) > 1 and role in ROLES[:3]:
            raise _ambiguity_error(role, found, headings, names, where)
        if found:
            chosen[role] = found[0]
    _check_roles(chosen, "u" not in columns, timed, headings, where, clues)
    if timed is False and not {"t"} & {*chosen, *columns}:
        _warn_of_unseen(_without_role(clues.dates, chosen), headings, where)
    return chosen


def _caller_columns(
    columns: Mapping[str, Any], headings: list[str], names: list[str], timed: bool | None,
    where: str,
) -> dict[str, int]:  # fmt: skip
    """Index of each column that the caller names."""
    return {
        role: _find_column(role, column, headings, names, where)
        for role, column in columns.items()
        if column is not None or (role == "t" and timed)
    }


def _warn_of_unseen(dates: list[int], headings: list[str], where: str) -> None:
    """Tell of dates that a rate takes the place of."""
    if dates:
        warn(
            f"{where}: with rate= the dates of {headings[dates[0]]!r} are left out, so that lost "
            "rows cannot be seen: leave rate= out, or, if there are none, say columns={'t': None}"
        )


def _without_role(found: tuple[int, ...], chosen: Mapping[str, int]) -> list[int]:
    """Of some columns those that play no role."""
    return [k for k in found if k not in chosen.values()]


def _column_names(headings: list[str], joint: str | int | None, where: str) -> list[str]:
    """Names in headings; of a joint those of its columns without it, others empty."""
    names = [split_header(h)[0] for h in headings]
    return names if joint is None else _of_joint(names, str(joint), where)


def _check_roles(
    chosen: dict[str, int], driven: bool, timed: bool | None, headings: list[str], where: str,
    clues: Clues,
) -> None:  # fmt: skip
    """Refuse columns of which roles are missing, or one that has two roles."""
    missing = {
        role: none
        for role, needed, none in (
            ("t", timed, "rate= [samples per s]"),
            ("u", driven, 'columns={"u": None} for a free motion'),
            ("x", "v" not in chosen, "a column of velocity, v"),
        )
        if needed and role not in chosen
    }
    if missing:
        raise _missing_roles_error(missing, headings, chosen, where, clues)
    for a, b in itertools.combinations(chosen, 2):
        if chosen[a] == chosen[b]:
            raise ValueError(f"{where}: column {headings[chosen[a]]!r} serves as both {a} and {b}")


def _usual_columns(
    role: str, headings: list[str], names: list[str], chosen: dict[str, int], timed: bool | None,
    clues: Clues,
) -> list[int]:  # fmt: skip
    """Columns that may play a role by name, or by dates or units where one must play it."""
    found = _in_best_unit(role, _same_joint(role, names, chosen), headings)
    if role not in ROLES[:3]:  # only what is beyond doubt, by name and unit
        sure = [k for k in found if k not in chosen.values()]
        sure = [k for k in sure if _fits(role, split_header(headings[k])[1])]
        return sure if len(found) == 1 else []
    if not found and _may_be_guessed(role, timed, names):
        dates = _without_role(clues.dates if role == "t" else (), chosen)
        found = [k for k in dates if not _has_meaning(names[k])]
        return found or _columns_by_unit(role, headings, set(chosen.values()))
    return found


def _in_best_unit(role: str, found: list[int], headings: list[str]) -> list[int]:
    """Of columns of one name that of the surest unit: newtons before the volts of the sensor."""
    parts = [split_header(headings[k]) for k in found]
    if len(found) < 2 or len({name for name, _ in parts}) > 1:
        return found
    units = {k: known_unit(unit) for k, (_, unit) in zip(found, parts, strict=True)}
    for kinds in _BY_UNIT.get(role, ()):
        if best := [k for k, unit in units.items() if unit and unit.kind in kinds]:
            return best
    return found


def _may_be_guessed(role: str, timed: bool | None, names: list[str]) -> bool:
    """Whether a source must have a column of this role."""
    return {"t": timed is not False, "x": not columns_by_name("v", names)}.get(role, True)


def _columns_by_unit(role: str, headings: list[str], taken: set[int]) -> list[int]:
    """Columns that a letter of physics, or else a unit, shows to play a role."""
    parts = [split_header(heading) for heading in headings]
    free = [k for k, (name, _) in enumerate(parts) if k not in taken and not _has_meaning(name)]
    letters = [k for k in free if _is_symbol(role, *parts[k])]
    if letters:
        return letters
    units = {k: known_unit(parts[k][1]) if parts[k][1] else None for k in free}
    for kinds in _BY_UNIT.get(role, ()):
        found = [k for k, unit in units.items() if unit and unit.kind in kinds]
        if found:
            return found
    return []


def _is_symbol(role: str, name: str, unit: str) -> bool:
    """Whether a name is the letter of a channel, in a unit that this may be in."""
    return _symbol_role(name) == role and _fits(role, unit)


def _has_meaning(name: str) -> bool:
    """Whether a heading names a channel, or what is derived of one."""
    return bool(parse_heading(name).role) or _is_derived(name)


def _ambiguity_error(
    role: str, found: list[int], headings: list[str], names: list[str], where: str
) -> RefusalError:
    """The error for several columns that could play a role, with a line for each."""
    joints = [parse_heading(names[k]).joint for k in found]
    several = len(set(joints)) == len(found)
    first = joints[0] if several and not _has_common_channel(role, names) else ""
    joint: Any = int(first) if first.isdigit() else first
    said = _distinct_headings(found, headings)
    mend = {"joint": joint} if first else {"columns": {role: said[0]}}
    ways = " or ".join(f'columns={{"{role}": {one!r}}}' for one in said[:4])
    return RefusalError(
        f"{where}: {', '.join(repr(names[k]) for k in found)} could each be {role}; "
        f'say which: columns={{"{role}": ...}}, that is {ways}'
        + f", or one joint: joint={joint or '...'!r}"
        * several,
        **mend,
    )


def _has_common_channel(role: str, names: list[str]) -> bool:
    """Whether u or x, beside a role, has columns of no joint, which one joint would leave out."""
    others = [columns_by_name(other, names) for other in ("u", "x") if other != role]
    return any(one and not any(parse_heading(names[k]).joint for k in one) for one in others)


def _distinct_headings(found: list[int], headings: list[str]) -> list[Any]:
    """Headings of columns; of two with one heading only the index says which."""
    own = [headings[k].strip() for k in found]
    return [h if own.count(h) == 1 else k for k, h in zip(found, own, strict=True)]


def _suits_role(role: str, heading: str) -> bool:
    """Whether the first or last word of a heading, and its unit, suit a role."""
    name, unit = split_header(heading)
    words = re.findall(r"[^\W\d_]+", normalize_heading(name))
    stems = {"u": "drive", "x": "position"}
    suited = _SAID["stems"][stems[role]] if role in stems else ("time", "timestamp", "stamp")
    ends = set(words[-1:]) | (set(words[:1]) if len("".join(words[1:])) < 3 else set())
    return bool(ends & set(suited)) and _fits(role, unit) and parse_heading(name).role in ("", role)


def _missing_roles_error(
    missing: Mapping[str, str],
    headings: list[str],
    chosen: dict[str, int],
    where: str,
    clues: Clues,
) -> RefusalError:
    """The error for roles that no column is recognised to play, and what to give for none."""
    mend = _proposed_columns(missing, headings, chosen, clues)
    ordered = [*mend.get("columns", {}).values()] == headings
    asked = ", ".join(f'"{role}": ...' for role in missing)
    which = "which it is"
    ways = [f"give {none} if there is none" for none in missing.values()]
    if len(missing) > 1:
        which = "which they are"
        ways = [f"give {none} if there is no {role}" for role, none in missing.items()]
    return RefusalError(
        f"{where}: no column recognised as {', '.join(missing)}; "
        f"available: {_list_headings(headings)}"
        + ", in this order as the line takes them" * ordered
        + f". Say {which}: columns={{{asked}}}, or {', '.join(ways)}"
        + page_reference("howto/read_csv"),
        **mend,
    )


def _proposed_columns(
    missing: Mapping[str, str], headings: list[str], chosen: Mapping[str, int], clues: Clues
) -> dict[str, Any]:
    """Arguments that say what plays the missing roles, as far as headings and clues show it."""
    own = [headings[k].strip() for k in _without_role((*range(len(headings)),), chosen)]
    columns: dict[str, Any] = {}
    for role in missing:
        columns[role] = next((h for h in own if _suits_role(role, h)), ...)
    if {*columns.values()} == {...} and _may_be_in_order(missing, headings, clues):
        return {"columns": dict(zip(missing, headings, strict=True))}
    if columns.get("u") is ... and all(map(_is_other_channel, filter(None, own))):
        columns["u"] = None
    if columns.get("t") is not ...:
        return {"columns": columns}
    rising = [headings[k].strip() for k in _without_role(clues.rising, chosen)]
    clocks = [h for h in rising if not _has_meaning(split_header(h)[0])]
    if len(clocks) == 1:
        columns["t"] = clocks[0]
        return {"columns": columns}
    del columns["t"]
    return {"columns": columns, "rate": ...} if columns else {"rate": ...}


def _may_be_in_order(missing: Mapping[str, str], headings: list[str], clues: Clues) -> bool:
    """Whether columns may be the missing roles one by one, as those without headings are."""
    if not 1 < len(missing) == len(headings) == len({*headings}):
        return False
    return "t" not in missing or clues.rising[:1] == (0,)


def _is_other_channel(heading: str) -> bool:
    """Whether a heading names a channel, and does not by its letter: T may be a torque."""
    name = split_header(heading)[0]
    return bool(parse_heading(name).role) and len(name.strip()) > 1


def _checked_columns(columns: Any) -> Mapping[str, str | int | None]:
    """What the caller says of columns: a mapping of roles."""
    if columns is not None and not isinstance(columns, Mapping):
        raise ValueError(
            f"columns must map t, u, x and reference to columns, such as "
            f'{{"t": "time", "u": "force", "x": "position"}}; got {columns!r}'
        )
    roles = [*ROLES, *EXTRAS]
    for role in columns or {}:
        if role not in (*roles, "good"):
            raise ValueError(
                f"columns: {role!r} is no role; the roles are {', '.join(roles)}"
                + (_suggest_channel(role) or did_you_mean(str(role), roles))
            )
    return columns or {}


def _suggest_channel(heading: Any) -> str:
    """The channel that the heading of a column names, for the end of a message."""
    role = parse_heading(split_header(str(heading))[0]).role
    return f". Did you mean {role!r}, the channel that {heading!r} is?" if role else ""


def _in_order(count: int, where: str, timed: bool | None) -> dict[str, int]:
    """Roles of columns without headings: t, u, x, reference."""
    roles = ROLES[1:] if timed is False or (timed is None and count < 3) else ROLES
    if count not in (len(roles) - 1, len(roles)):
        raise ValueError(
            f"{where} has {count} columns and no heading; say which is which by "
            'index: columns={"t": 0, "u": 1, "x": 2}'
        )
    return dict(zip(roles, range(count), strict=False))


def _of_joint(names: list[str], joint: str, where: str) -> list[str]:
    """Names of the columns of a joint, without it, and of time; others empty."""
    sides = (r"(?<!\d)", r"(?!\d)") if joint.isdigit() else (r"(?<![^\W_])", r"(?![^\W_])")
    pattern = re.compile(sides[0] + re.escape(joint) + sides[1], re.IGNORECASE)
    if not any(map(pattern.search, names)):
        raise ValueError(
            f"{where} has no column of joint {joint!r}; available: {_list_headings(names)}"
        )
    out = []
    for name in names:
        if parse_heading(name).role == "t" or (pattern.search(name) and joint.isdigit()):
            out.append(name)
        else:
            out.append(pattern.sub("", name).strip(" _./:()[]-") * bool(pattern.search(name)))
    return out


def _same_joint(role: str, names: list[str], chosen: Mapping[str, int]) -> list[int]:
    """Columns of a role, of the joint of which others were chosen where it has one."""
    joints = {joint for k in chosen.values() if (joint := parse_heading(names[k]).joint)}
    own = [name if parse_heading(name).joint in joints else "" for name in names]
    return columns_by_name(role, own) or columns_by_name(role, names)


def drive_quantity(headings: list[str], chosen: Mapping[str, int]) -> DriveQuantity:
    """Quantity that the heading of the drive names, and the heading."""
    heading = headings[chosen["u"]].strip() if "u" in chosen else ""
    name = split_header(heading)[0]
    usual = parse_heading(name).usual or name.casefold()
    for quantity, parts in _SAID["quantities"].items():
        if any(_has_part(usual, one) for one in parts):
            return DriveQuantity(quantity, heading)
    return DriveQuantity()


def _has_part(usual: str, part: str) -> bool:
    """Whether a name has a part in it; a short one only as a word of its own."""
    is_long = len(part) > 2 or not part.isascii()
    return part in re.split(r"[_.]", usual) or (is_long and part in usual)


def left_out(headings: list[str], chosen: Mapping[str, int]) -> tuple[str, ...]:
    """Notes that name the columns of a source that play no role, and a unit that hindered one."""
    rest = [h for k, h in enumerate(headings) if k not in chosen.values() and h]
    notes = [f"left out: {_list_headings(rest)}"] if rest else []
    for heading in rest:
        name, unit = split_header(heading)
        role = parse_heading(name).role
        if role in EXTRAS and role not in chosen and unit and known_unit(unit) is None:
            notes.append(
                f"the unit of {heading.strip()!r} is not known; to read it, "
                f'columns={{"{role}": {heading.strip()!r}}}, units={{"{role}": "..."}}'
            )
    return tuple(notes)


def guess_notes(headings: list[str], chosen: Mapping[str, int], wanted: Wanted) -> tuple[str, ...]:
    """Notes on columns that were taken by a letter, a unit or dates, not by a name."""
    notes = []
    for role in [role for role in ROLES if role in chosen and role not in (wanted.columns or {})]:
        heading = headings[chosen[role]].strip()
        name, unit = split_header(heading)
        found = known_unit(unit)
        if wanted.joint is not None or parse_heading(name).role == role:
            continue
        if _symbol_role(name) == role:
            notes.append(f"{heading!r} taken as {role}: by its letter")
        elif found is not None:
            notes.append(f"{heading!r} taken as {role}: the only column in a unit of {found.kind}")
        elif role == "t" and heading:
            notes.append(f"{heading!r} taken as t: the only column of dates")
    return tuple(notes)


def _find_column(role: str, wanted: Any, headings: list[str], names: list[str], where: str) -> int:
    """Index of the column the caller asked for."""
    if isinstance(wanted, str) and wanted.isdigit() and not any(headings):
        wanted = int(wanted)
    if isinstance(wanted, int) and not isinstance(wanted, bool):
        if not -len(headings) <= wanted < len(headings):
            raise ValueError(
                f"columns[{role!r}] = {wanted}: {where} has columns 0 to {len(headings) - 1}"
            )
        return wanted % len(headings)
    if not isinstance(wanted, str):
        raise ValueError(f"columns[{role!r}] must be a name or an index, got {wanted!r}")
    candidates = _find_heading(wanted.strip(), headings, names)
    if len(candidates) > 1:
        raise ValueError(
            f"{where}: column {wanted!r} appears {len(candidates)} times; give its index, "
            f"one of {candidates}"
        )
    if candidates:
        return candidates[0]
    raise ValueError(
        f"columns[{role!r}] = {wanted!r} is not in {where}; available: {_list_headings(headings)}"
        + did_you_mean(wanted, names)
    )


def _find_heading(name: str, headings: list[str], names: list[str]) -> list[int]:
    """Columns of a heading, else of a name, else of a name in other letters."""
    for candidates in (
        [k for k, h in enumerate(headings) if h.strip() == name],
        [k for k, n in enumerate(names) if n == name],
        [k for k, n in enumerate(names) if n.lower() == name.lower()],
    ):
        if candidates:
            return candidates
    return []


def columns_by_name(role: str, names: list[str]) -> list[int]:
    """Columns of the first group of usual names of which there are any; plain names go first."""
    means = [parse_heading(n) for n in names]
    for plain in (True, False):
        for group in NAMES[role]:
            found = [k for k, one in enumerate(means) if one.role == role and one.usual in group]
            if plain:
                found = [k for k in found if _is_plain(names[k], means[k])]
            if found:
                exact = [k for k in found if normalize_heading(names[k]) == means[k].usual]
                return exact or found
    return []


def _is_plain(name: str, meaning: Meaning) -> bool:
    """Whether a heading is a usual name, with nothing but its joint behind: pos_x, q3."""
    _, usual, joint = meaning
    own = (usual, f"{usual}{joint}", f"{usual}_{joint}")
    return normalize_heading(name) in own or name.casefold() == usual


def _list_headings(headings: list[str]) -> str:
    shown = ", ".join(repr(h[:40]) for h in headings[:20]) or "none"
    return shown + (f" and {len(headings) - 20} more" if len(headings) > 20 else "")


def units_by_role(units: Any) -> dict[str, Any]:
    """Units that a caller states by channel."""
    if units is not None and not isinstance(units, Mapping):
        raise ValueError(f'units must be a mapping such as {{"x": "mm"}}, got {units!r}')
    for role in units or {}:
        if role not in ("t", "u", "x", *EXTRAS):
            raise ValueError(
                f"units: {role!r} is no channel; the channels are t, u and x"
                + _suggest_channel(role)
            )
    return dict(units or {})


# What a drive is in that is no force and has no unit, in words, and how to fix it.
_NO_FORCES = {
    "current": (
        "A",
        "taken in amperes",
        "give what one makes, gain=dfc.Scaling(torque_constant=...) [N m/A] or "
        'force_constant= [N/A], or state another unit, units={"u": "..."}',
    ),
    "voltage": (
        "V",
        "taken in volts",
        'give what one makes, gain={"u": ...} [N/V], or state another unit, units={"u": "..."}',
    ),
    # Bar or pascal: nobody knows.
    "pressure": (
        "",
        "taken as",
        'give its unit and the area, units={"u": "bar"} and gain=dfc.Scaling(piston_area=...) '
        '[m^2], or state that of a force, units={"u": "N"}',
    ),
    # A part of one, percent or counts of a timer: nobody knows.
    "duty cycle": (
        "",
        "taken as",
        'give the force or torque of a duty of one, gain={"u": ...}, or state the unit of a force, '
        'units={"u": "N"}',
    ),
}


def to_si(found: Channels, gain: Gain, declared: Any = None) -> Channels:
    """Channels in SI units with the gains applied; `declared`: units as stored or of products."""
    scaling = Scaling.of(gain)
    said_units = units_by_role(declared)
    _check_gain_channels(scaling, found)
    values = dict(found.values)
    units = {}
    notes = [*found.notes]
    raw = dict(found.raw)
    quantum = found.quantum
    for role in values:
        key = "x" if role == "reference" else role
        unit = found.units.get(role, "")
        said = said_units.get(key, "")
        factor, unit, si, done = _conversion(role, unit, said, scaling, found.where)
        notes += done
        if factor != 1:
            values[role] = scale_values(values[role], factor)
        if factor != 1 or (unit and unit != si):
            before = raw.get(role, (unit, 1.0))
            raw[role] = (before[0], before[1] * factor)
        if role == "x" and quantum is not None:
            quantum *= abs(factor)
        if si:
            units[role] = si
    if found.drive.quantity in _NO_FORCES and not {"u"} & {*units, *scaling.gain}:
        unit, note = _taken_drive(found, units)
        notes.append(note)
        if unit:
            units["u"] = unit
    _check_reference_unit(units.pop("reference", ""), units.get("x", ""), found.where)
    return replace(found, values=values, units=units, notes=tuple(notes), raw=raw, quantum=quantum)


def _check_gain_channels(scaling: Scaling, found: Channels) -> None:
    """Refuse the gain of a channel that is not there."""
    for key in scaling.gain:
        if key not in found.values:
            raise ValueError(
                f"gain: {found.where} has no channel {key!r}; it has {', '.join(found.values)}"
            )


def _taken_drive(found: Channels, units: Mapping[str, str]) -> tuple[str, str]:
    """Unit of a drive that is no force and has none, and the note of it; a warning says it, too."""
    quantity, heading = found.drive
    unit, words, mend = _NO_FORCES[quantity]
    if unit:
        note = f"u is in {unit}: {heading!r} is a {quantity}"
    else:
        words += f" {usual_units(units)[1]}"
        note = f"u is {words}: {heading!r} is a {quantity} without a unit; {mend}"
    warn(f"{found.where}: {heading!r} is a {quantity}, not a force, and is {words}: {mend}")
    return unit, note


def _check_reference_unit(reference: str, x: str, where: str) -> None:
    """Refuse a reference in another unit than the position, where both are known."""
    if reference and x and reference != x:
        raise ValueError(
            f"{where}: reference is in {reference} but x in {x}; they must agree, "
            "or leave it out: columns={'reference': None}"
        )


def _conversion(
    role: str, unit: str, said: str, scaling: Scaling, where: str
) -> tuple[float, str, str, list[str]]:
    """Factor of a channel, its raw unit and that of the product, and what to note of it."""
    own = scaling.gain.get("x" if role == "reference" else role)
    factor, unit, si, notes = _unit_conversion(role, unit, said, own, where)
    found = scaling.conversion(role, si) if own is None else None
    if found:
        factor *= found.factor
        unit = unit or found.raw
        si = found.unit
        notes.append(f"{role} converted from {unit} to {si} with factor {factor:.6g}")
    elif factor not in (1.0, own):
        notes.append(f"{role} converted from {unit or said} to {si or 'SI'}")
    return factor, unit, si, notes


def _unit_conversion(
    role: str, unit: str, said: str, own: float | None, where: str
) -> tuple[float, str, str, list[str]]:
    """As `_conversion`, by the unit of the heading, the stated one and the gain `own` alone."""
    notes = []
    if said and own is None and _is_unknown(unit):
        notes.append(f"{role} is in {said}, as stated, not in {unit!r}")
        unit = ""
    turned = own == -1.0 and said in ("", unit)  # a sign that is turned keeps the unit
    factor = 1.0
    si = ""
    if unit and (own is None or turned):
        factor, si = si_unit(role, unit)
    if own is not None:
        per = ""
        if not turned:
            _check_gain(role, unit, said, own, where)
            per = f" per {unit}" if unit else ""
        factor *= own
        notes.append(f"{role} multiplied by gain {own:g}{per}")
    if said and not turned:
        factor, si = _stated_conversion(role, unit, said, (factor, si), where)
        if not unit and own is None:
            unit = said
    return factor, unit, si, notes


def _is_unknown(unit: str) -> bool:
    """Whether a heading has a unit that is not known."""
    return bool(unit) and known_unit(unit) is None


def _stated_conversion(
    role: str, unit: str, said: str, stored: tuple[float, str], where: str
) -> tuple[float, str]:
    """Factor and unit of a channel in the unit `said`; `stored`: those by its heading."""
    factor, si = stored
    more, said_si = si_unit(role, said)
    if not si:
        return factor * more, said_si
    if (si, factor) != (said_si, more):
        raise ValueError(f"{where} gives {role} in {unit!r}, units= says {said!r}; omit one")
    return factor, said_si


def _check_gain(role: str, unit: str, said: str, own: float, where: str) -> None:
    """Tell of a gain that could be meant before or after the factor of the heading's unit."""
    found = known_unit(unit)
    if found is None or found.factor == 1.0 or said not in ("", unit):
        return
    sensed = found.kind in ("voltage", "current", "pressure")
    product = ("N" if role == "u" else "m") if sensed else found.si
    mend = f'units={{"{role}": "{product}"}}'
    if said:
        raise ValueError(
            f"{where} gives {role} in {unit!r} and units= says {said!r} beside a gain: "
            f"{own:g} {product} per {unit}, which is {mend}, or {own:g} times as many {unit}, "
            f'which is gain={{"{role}": {own * found.factor:g}}} and units={{"{role}": '
            f'"{found.si}"}}?'
        )
    if not sensed:
        warn(
            f"{where}: {role} [{unit}] is multiplied by the gain {own:g} alone, not by the "
            f"{found.factor:g} {found.si} per {unit} as well: state the unit of the product, {mend}"
        )


def scale_values(values: Any, factor: float) -> Any:
    """Values times factor; what cannot be scaled is left to be judged later."""
    array = np.asarray(values)
    if array.dtype.kind not in "iuf":
        return values
    with np.errstate(over="ignore"):  # beyond float64 becomes inf, refused later
        return np.asarray(array, dtype=np.float64) * factor
