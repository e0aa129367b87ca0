"""Columns of numbers out of files, frames and mappings.

A source (delimited text, MAT-file, data frame, mapping of arrays) becomes
the four channels ``t``, ``u``, ``x`` and ``reference`` in SI units.
Nothing here judges the data: that is the business of `records`. Nothing
from a file is ever executed.
"""

from __future__ import annotations

import csv
import difflib
import itertools
import json
import math
import os
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from .matfile import DamagedMatError, mat_variables

ROLES = ("t", "u", "x", "reference")
MAX_ROWS = 10_000_000  # 0.3 GB for four columns
SIGNATURE = "# dryfric-control record"
FORMAT = 1

_ALIASES = {
    "t": ("t", "time", "timestamp", "time_stamp", "zeit", "seconds"),
    "u": ("u", "input", "force", "torque", "vir", "effort", "command", "voltage", "current"),
    "x": ("x", "position", "pos", "qm", "q", "angle", "theta", "y", "output"),
    "reference": ("reference", "ref", "r", "qg", "goal", "goal_position", "setpoint", "target",
                  "x_ref", "xref", "desired"),
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

_NUMBER = re.compile(
    r"[+-]?(?:(?:\d+(?:[.,]\d*)?|[.,]\d+)(?:[eE][+-]?\d+)?|nan|inf(?:inity)?)",
    re.ASCII | re.IGNORECASE,
)
_BRACKETS = re.compile(r"(.*\S)\s*(?:\[([^\[\]]*)\]|\(([^()]*)\))")
_DELIMITERS = (";", "\t", ",", None)  # None: runs of blanks
_LINE_LIMIT = 1_000_000
_CHUNK = 65_536
_TEXT_SUFFIXES = (".csv", ".tsv", ".txt", ".dat")


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
        if found and known and any(name.strip().lower() in a for a in _ALIASES.values()):
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
                + _did_you_mean(str(role), list(ROLES))
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
        + _did_you_mean(wanted, names)
    )


def _recognise(role: str, names: list[str], where: str) -> int | None:
    """Index of the column whose name tells its role, if there is one."""
    exact = [k for k, n in enumerate(names) if n.lower() == role]
    found = exact or [k for k, n in enumerate(names) if n.lower() in _ALIASES[role]]
    if len(found) > 1:
        raise ValueError(
            f"{where}: {', '.join(repr(names[k]) for k in found)} could each be {role}; "
            f'say which: columns={{"{role}": ...}}'
        )
    return found[0] if found else None


def _did_you_mean(word: str, choices: list[str]) -> str:
    lowered = {c.lower(): c for c in choices}
    close = difflib.get_close_matches(word.lower(), lowered, n=1, cutoff=0.5)
    return f". Did you mean {lowered[close[0]]!r}?" if close else ""


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
            out[role] = _scaled(out[role], factor)
            if not (role == "u" and factor == gain):
                notes.append(f"{role} converted from {unit} to {si or 'SI'}")
        if si:
            units[role] = si
    if (r := units.pop("reference", "")) and "x" in units and r != units["x"]:
        raise ValueError(f"{where}: reference is in {r} but x in {units['x']}; they must agree")
    return Channels(out, units, tuple(notes))


def _scaled(values: Any, factor: float) -> Any:
    """Values times factor; what cannot be scaled is left to be judged later."""
    array = np.asarray(values)
    return array * factor if array.dtype.kind in "biuf" else values


# ----------------------------------------------------------------- sources


def read_channels(
    source: Any,
    columns: Mapping[str, str | int | None] | None = None,
    gain: float = 1.0,
    units: Mapping[str, str] | None = None,
    max_rows: int = MAX_ROWS,
) -> Channels:
    """Read the channels of a file, data frame or mapping.

    Raises
    ------
    FileNotFoundError, IsADirectoryError
        When the path leads nowhere or to a directory.
    ValueError
        For everything that is wrong inside.
    TypeError
        When the source is none of these.
    """
    if isinstance(max_rows, bool) or not isinstance(max_rows, int) or max_rows < 1:
        raise ValueError(f"max_rows must be a positive whole number, got {max_rows!r}")
    name: str | None = None
    quantum: float | None = None
    extra: tuple[str, ...] = ()
    if isinstance(source, (str, os.PathLike)):
        path = existing_file(source)
        where, name = path.name, path.stem
        suffix = path.suffix.lower()
        if suffix in _TEXT_SUFFIXES:
            values, stored, meta = _read_text(path, columns, max_rows)
            name = meta.get("name", name) if meta else name
            quantum, extra = meta.get("quantum"), tuple(meta.get("notes", ()))
            return _with(to_si(values, stored, gain, units, where), extra, name, quantum)
        if suffix != ".mat":
            raise ValueError(_unsupported(path))
        table = _read_mat(path)
    elif isinstance(source, Mapping):
        where, table = "the mapping", {str(k): v for k, v in source.items()}
    elif hasattr(source, "columns") and hasattr(source, "__getitem__"):
        where, table = "the data frame", _frame_columns(source, columns)
        if isinstance(kept := getattr(source, "attrs", {}).get("dryfric_control"), Mapping):
            name, quantum, extra = kept.get("name"), kept.get("quantum"), tuple(kept["notes"])
    else:
        raise TypeError(
            "read_record takes a path, a data frame or a mapping of arrays, "
            f"got {type(source).__name__}"
        )
    headings = list(table)
    chosen = assign_columns(headings, columns, where)
    values = {role: table[headings[k]] for role, k in chosen.items()}
    stored = {role: split_header(headings[k])[1] for role, k in chosen.items()}
    for role, array in values.items():
        if np.size(array) > max_rows:
            raise ValueError(_too_long(where, max_rows))
        values[role] = _as_seconds(array) if role == "t" else array
    if _scales_by_gtau(table, headings, chosen, columns):
        factor = float(np.ravel(table["gtau"])[0])
        values["u"] = _scaled(values["u"], factor)
        stored |= {"t": "s", "u": "N", "x": "m", "reference": "m"}
        extra += (f"u = gtau * vir with gtau = {factor:g} N/V",)
    return _with(to_si(values, stored, gain, units, where), extra, name, quantum)


def _with(found: Channels, notes: tuple[str, ...], name: Any, quantum: Any) -> Channels:
    return Channels(
        found.values,
        found.units,
        notes + found.notes,
        name if isinstance(name, str) else None,
        float(quantum) if isinstance(quantum, (int, float)) else None,
    )


def _scales_by_gtau(
    table: Mapping[str, Any], headings: list[str], chosen: Mapping[str, int], columns: Any
) -> bool:
    """True for the EMPS layout, unless the caller names the input himself."""
    return (
        headings[chosen["u"]] == "vir"
        and headings[chosen["x"]] == "qm"
        and "u" not in (columns or {})
        and "gtau" in table
        and np.size(table["gtau"]) == 1
        and np.asarray(table["gtau"]).dtype.kind in "iuf"
    )


def existing_file(source: str | os.PathLike[str]) -> Path:
    """The path, once it is known to lead to a file with something in it."""
    try:
        path = Path(source)
        if path.is_dir():
            raise IsADirectoryError(f"{path} is a directory; give one file in it")
        if not path.is_file():
            near = os.listdir(path.parent) if path.parent.is_dir() else []
            raise FileNotFoundError(
                f"there is no file {str(path)!r}" + _did_you_mean(path.name, near)
            )
        if path.stat().st_size == 0:
            raise ValueError(f"{path.name} is empty (0 bytes)")
    except (UnicodeEncodeError, TypeError) as err:
        raise ValueError(f"{source!r} is no file name") from err
    return path


def _unsupported(path: Path) -> str:
    mend = {
        ".json": "read_bam() reads BAM logs; otherwise load it and pass a dict of arrays",
        ".xlsx": "export it as CSV",
        ".xls": "export it as CSV",
        ".parquet": "read it with pandas and pass the data frame",
        ".gz": "decompress it first",
    }.get(path.suffix.lower(), "save it as CSV, or pass a dict of arrays")
    return (
        f"{path.name}: files of type {path.suffix!r} are not read; {mend}. "
        f"Read are {', '.join(_TEXT_SUFFIXES)} and .mat"
    )


def _too_long(where: str, max_rows: int) -> str:
    return (
        f"{where} has more than {max_rows} rows; cut or decimate it first, "
        "or allow more with max_rows="
    )


def _as_seconds(values: Any) -> Any:
    """Date and duration arrays as seconds; anything else unchanged."""
    array = np.asarray(values)
    if array.dtype.kind == "M" and array.size and not np.isnat(array).any():
        array = array - array.ravel()[0]
    if array.dtype.kind == "m" and not np.isnat(array).any():
        return array / np.timedelta64(1, "s")
    return values


def _frame_columns(frame: Any, columns: Any) -> dict[str, Any]:
    """Columns of a data frame; its index too when that carries the time."""
    table: dict[str, Any] = {}
    for k, label in enumerate(frame.columns):
        if str(label) in table:
            raise ValueError(f"the data frame has two columns {str(label)!r}; rename one")
        series = frame.iloc[:, k] if hasattr(frame, "iloc") else frame[label]
        table[str(label)] = series.to_numpy()
    index = getattr(frame, "index", None)
    names = [split_header(h)[0].lower() for h in table]
    if index is not None and not any(n in _ALIASES["t"] for n in names):
        label = str(index.name) if index.name is not None else "t"
        if label not in table and (
            index.dtype.kind in "mMf" or split_header(label)[0].lower() in _ALIASES["t"][1:]
        ):
            table[label if split_header(label)[0].lower() in _ALIASES["t"] else "t"] = (
                index.to_numpy()
            )
    return table


def _read_mat(path: Path) -> dict[str, Any]:
    """Numeric variables of a MAT-file up to version 7, structs flattened."""
    with path.open("rb") as file:
        head = file.read(128)
    if head.startswith(b"\x89HDF") or head.startswith(b"MATLAB 7.3"):
        raise ValueError(
            f"{path.name} is a MAT-file of version 7.3 (HDF5), which is not read; save it in "
            "MATLAB with save(..., '-v7'), or read it with h5py and pass a dict of arrays"
        )
    try:
        table: dict[str, Any] = {}
        _flatten("", mat_variables(path.read_bytes()), table)
    except DamagedMatError as err:
        raise ValueError(
            f"{path.name} is damaged or no MAT-file of version 5 to 7 ({err})"
        ) from err
    if not table:
        raise ValueError(f"{path.name} holds no numeric variable")
    return table


def _flatten(prefix: str, content: Mapping[str, Any], table: dict[str, Any]) -> None:
    """Vectors and scalars as 1-D arrays; matrices as ``name.j``."""
    for key, value in content.items():
        if isinstance(value, dict):
            _flatten(f"{prefix}{key}.", value, table)
        elif value.ndim == 2 and 1 < value.shape[1] <= 64 and value.shape[0] > 1:
            table.update({f"{prefix}{key}.{j}": value[:, j] for j in range(value.shape[1])})
        elif value.size:
            table[f"{prefix}{key}"] = value.ravel() if max(value.shape) == value.size else value


# ------------------------------------------------------------ delimited text


@dataclass
class _Layout:
    """What the first lines of a text file tell about the rest."""

    where: str
    delimiter: str | None
    headings: list[str]
    chosen: dict[str, int]
    decimal: str = ""  # "." or "," once one was seen


def _read_text(
    path: Path, columns: Any, max_rows: int
) -> tuple[dict[str, Any], dict[str, str], dict[str, Any]]:
    """Chosen columns of a text file, their units, the file's own notes."""
    layout: _Layout | None = None
    comments: list[str] = []
    parts: list[npt.NDArray[np.float64]] = []
    rows = 0
    for chunk in _chunks(path, comments):
        if layout is None:
            layout, has_heading = _sniff(path.name, chunk, comments, columns)
            chunk = chunk[1:] if has_heading else chunk
        rows += len(chunk)
        if rows > max_rows:
            raise ValueError(_too_long(path.name, max_rows))
        if chunk:
            parts.append(_parse(layout, chunk))
    if layout is None:
        raise ValueError(f"{path.name} holds no data, only blank or comment lines")
    if not parts:
        raise ValueError(f"{path.name} holds a heading and no data rows")
    data = np.concatenate(parts)
    values = {role: data[:, k].copy() for k, role in enumerate(layout.chosen)}
    stored = {r: split_header(layout.headings[k])[1] for r, k in layout.chosen.items()}
    return values, stored, _own_notes(path.name, comments)


def _chunks(path: Path, comments: list[str]) -> Iterator[list[tuple[int, str]]]:
    """Numbered content lines; comments met before the first go to the list."""
    found_any = False
    chunk: list[tuple[int, str]] = []
    with path.open(encoding="utf-8-sig", errors="surrogateescape") as file:
        number = 0
        while line := file.readline(_LINE_LIMIT):
            number += 1
            if len(line) == _LINE_LIMIT:
                raise ValueError(f"{path.name}: line {number} is too long; is it a text file?")
            if "\0" in line or (number == 1 and line.startswith("\udcff\udcfe")):
                raise ValueError(
                    f"{path.name}: line {number} is no plain text (a binary file, or UTF-16); "
                    "save it as CSV in UTF-8"
                )
            stripped = line.strip()
            if not stripped:
                continue
            if stripped[0] == "#":
                if not found_any and len(comments) < 1000:
                    comments.append(stripped)
                continue
            found_any = True
            chunk.append((number, line.rstrip("\r\n")))
            if len(chunk) == _CHUNK:
                yield chunk
                chunk = []
    if chunk:
        yield chunk


def _own_notes(where: str, comments: list[str]) -> dict[str, Any]:
    """Name, quantum and notes that `Record.to_csv` wrote, if it did."""
    if not comments or not comments[0].startswith(SIGNATURE):
        return {}
    version, _, text = comments[0][len(SIGNATURE) :].strip().partition(" ")
    if not version.isascii() or not version.isdigit() or len(version) > 6:
        raise ValueError(f"{where}: the first line is damaged; remove it to read plain columns")
    if int(version) > FORMAT:
        raise ValueError(
            f"{where} was written in format {version}, this version reads up to {FORMAT}; "
            "update the package, or remove the first line to read plain columns"
        )
    try:
        meta = json.loads(text)
        quantum = meta["quantum"]
        sound = (
            isinstance(meta["name"], (str, type(None)))
            and (quantum is None or (type(quantum) is float and 0 <= quantum < 1e100))
            and isinstance(meta["notes"], list)
            and all(isinstance(n, str) for n in meta["notes"])
        )
    except (ValueError, KeyError, TypeError, RecursionError):
        sound = False
    if not sound:
        raise ValueError(f"{where}: the first line is damaged; remove it to read plain columns")
    return dict(meta)


def _sniff(
    where: str, chunk: list[tuple[int, str]], comments: list[str], columns: Any
) -> tuple[_Layout, bool]:
    """Delimiter, headings and the chosen columns from the first lines."""
    sample = [text for _, text in chunk[:20]]

    def numeric_cells(delimiter: str | None) -> int:
        return sum(_is_number(c) for s in sample for c in _cells(s, delimiter))

    def all_cells(delimiter: str | None) -> int:
        return sum(len(_cells(s, delimiter)) for s in sample)

    # most numbers; for text alone, most cells; ties go to the first listed
    delimiter = max(_DELIMITERS, key=lambda d: (numeric_cells(d), all_cells(d)))
    first = [_readable(c) for c in _cells(sample[0], delimiter)]
    has_heading = not any(_is_number(c) for c in first)
    headings = first if has_heading else [""] * len(first)
    if not has_heading and comments:
        above = [_readable(c) for c in _cells(comments[-1].lstrip("# "), delimiter)]
        if len(above) == len(first) and not any(_is_number(c) for c in above):
            headings = above
    if len(headings) < 3:
        raise ValueError(
            f"{where} has {len(headings)} column(s), at least t, u and x are needed; columns are "
            "separated by comma, semicolon, tab or blanks"
        )
    return _Layout(
        where, delimiter, headings, assign_columns(headings, columns, where)
    ), has_heading


def _cells(line: str, delimiter: str | None) -> list[str]:
    """Cells of one line, quotes honoured, blanks around them removed."""
    line = (
        line.partition("#")[0].strip(" \r\n")
        if delimiter == "\t"
        else line.partition("#")[0].strip()
    )
    if delimiter is None:
        return line.split()
    if '"' not in line:
        return [c.strip() for c in line.split(delimiter)]
    try:
        return [c.strip() for c in next(csv.reader([line], delimiter=delimiter), [])]
    except csv.Error as err:
        raise ValueError(f"line {line[:40]!r} cannot be split into cells ({err})") from err


def _readable(cell: str) -> str:
    """Text with bytes that are no UTF-8 read as Latin-1 (µ, °)."""
    return (
        cell.encode("utf-8", "surrogateescape").decode("latin-1")
        if not cell.isprintable()
        else cell
    )


def _is_number(cell: str) -> bool:
    return _NUMBER.fullmatch(cell) is not None


def _parse(layout: _Layout, chunk: list[tuple[int, str]]) -> npt.NDArray[np.float64]:
    """Chosen columns of some lines, shape (lines, chosen columns)."""
    text = "\n".join(line for _, line in chunk)
    decimal = layout.decimal
    if layout.delimiter != ",":
        if decimal == "," and "." not in text:
            text = text.replace(",", ".")
        elif decimal == "," or "," in text:
            return _parse_slowly(layout, chunk)
    if '"' in text or "#" in text or not text.isascii():
        return _parse_slowly(layout, chunk)
    try:
        data = np.loadtxt(text.split("\n"), delimiter=layout.delimiter, comments=None, ndmin=2)
    except ValueError:
        return _parse_slowly(layout, chunk)  # reads what can be read, or says what cannot
    if data.shape != (len(chunk), len(layout.headings)):
        return _parse_slowly(layout, chunk)
    if "." in text and decimal != ",":
        layout.decimal = "."
    return np.ascontiguousarray(data[:, list(layout.chosen.values())])


def _parse_slowly(layout: _Layout, chunk: list[tuple[int, str]]) -> npt.NDArray[np.float64]:
    """Cell by cell: text in other columns is fine, errors say the place."""
    width = len(layout.headings)
    out = np.empty((len(chunk), len(layout.chosen)))
    for i, (number, line) in enumerate(chunk):
        cells = _cells(line, layout.delimiter)
        if len(cells) == width + 1 and cells[-1] == "":
            cells.pop()
        if len(cells) != width:
            raise ValueError(
                f"{layout.where}: row {number} has {len(cells)} columns, the first has {width}"
            )
        for j, (role, k) in enumerate(layout.chosen.items()):
            cell = cells[k]
            if not _is_number(cell) or (layout.delimiter == "," and "," in cell):
                what = f"{cell[:40]!r} is not a number" if cell else "the cell is empty"
                label = layout.headings[k] or str(k)
                raise ValueError(f"{layout.where}: row {number}, column {label!r} ({role}): {what}")
            mark = "," if "," in cell else "." if "." in cell else ""
            if mark and layout.decimal and mark != layout.decimal:
                raise ValueError(
                    f"{layout.where}: row {number}: {cell[:40]!r} mixes decimal commas and points; "
                    "write all numbers one way, without thousands separators"
                )
            layout.decimal = layout.decimal or mark
            out[i, j] = float(cell.replace(",", "."))
    return out


# ------------------------------------------------------------------ BAM logs

BAM_FULL_DUTY = 885.0  # `load` at 100 % PWM duty of the XL330
BAM_KEYS = (
    "timestamp",
    "position",
    "goal_position",
    "load",
    "input_volts",
    "temp",
    "torque_enable",
)


def read_bam_entries(path: str | os.PathLike[str]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Head and columns of a BAM servo log (JSON), as stored.

    Returns
    -------
    head : dict
        Everything but the entries.
    columns : dict of str to ndarray
        One float array per key of the entries; ``duty`` signed, 1 at full.

    Raises
    ------
    ValueError
        When the file is not such a log.
    """
    file = existing_file(path)
    try:
        content = json.loads(file.read_text(encoding="utf-8-sig"))
    except (ValueError, RecursionError) as err:
        raise ValueError(f"{file.name} is no valid JSON ({str(err)[:80]})") from err
    entries = content.get("entries") if isinstance(content, dict) else None
    if not isinstance(entries, list) or not entries:
        raise ValueError(f"{file.name} is no BAM log: it has no list `entries`")
    columns: dict[str, Any] = {}
    for key in BAM_KEYS:
        values = [e.get(key) if isinstance(e, dict) else None for e in entries]
        bad = next((k for k, v in enumerate(values) if not isinstance(v, (int, float))), None)
        if bad is not None:
            raise ValueError(
                f"{file.name}: entry {bad} has {key} = {str(values[bad])[:40]}, not a number"
            )
        try:
            columns[key] = np.array(values, dtype=float)
        except OverflowError as err:
            raise ValueError(f"{file.name}: {key} holds a number that is too large") from err
    load = columns.pop("load")  # unsigned 16 bit on the wire
    columns["duty"] = np.where(load > 32767, load - 65536, load) / BAM_FULL_DUTY
    return {k: v for k, v in content.items() if k != "entries"}, columns
