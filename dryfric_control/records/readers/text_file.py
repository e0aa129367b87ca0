"""Columns of delimited text."""

from __future__ import annotations

import csv
import datetime
import gzip
import io
import json
import math
import re
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from dryfric_control.records.bad_readings import REASONS
from dryfric_control.records.readers.channels import (
    EXTRAS,
    assign_columns,
    left_out,
    split_header,
    too_long,
)
from dryfric_control.records.record_warning import warn
from dryfric_control.units import known_unit

SIGNATURE = "# dryfric-control record"
FORMAT = 1
SUFFIXES = (".csv", ".tsv", ".txt", ".dat", ".t")
# The exponent of Fortran has a D, or no letter where it has three digits.
_NUMBER = re.compile(
    r"[+-]?(?:(?:\d+(?:[.,]\d*)?|[.,]\d+)(?:[ed][+-]?\d+|(?<=\d)[+-]\d{3})?|nan|inf(?:inity)?)",
    re.ASCII | re.IGNORECASE,
)
_FORTRAN = re.compile(r"(?<=[\d.])(?:[dD]([+-]?)|([+-]))(?=\d)")
#: Words for a number that is not there.
_NO_NUMBER = ("", "nan", "-nan", "null", "none", "na", "n/a", "#n/a", "-", "--", "---")
_WHOLE = re.compile(r"[+-]?\d{1,19}", re.ASCII)
_EXACT = 2.0**53  # beyond, float64 leaves whole numbers out
_SEPARATOR = re.compile(r'"?sep=(.)"?', re.IGNORECASE)

_DELIMITERS = (";", "\t", ",", None)  # None: runs of blanks
_LINE_LIMIT = 1_000_000
_CHUNK = 65_536
_STAMP = re.compile(
    r"(?:(\d{4}-\d\d-\d\d|\d{1,2}\.\d{1,2}\.\d{4})[T ])?"
    r"(\d{1,2}):(\d\d):(\d\d)(?:[.,](\d{1,9})\d*)? ?(Z|[+-]\d\d:?\d\d)?",
    re.ASCII | re.IGNORECASE,
)
_DATES = (
    "; of dates, those of ISO 8601 and 31.12.2026 are read, others from a data frame: "
    "pandas.read_csv(..., parse_dates=[...])"
)
_EMPTY = "the cell is empty; give dt= [s], which fills and masks what is lost"
_TAIL = 50  # rows whose last cells show whether that of the last row is cut off
_PREAMBLE = 200  # lines among which the first row of numbers must be


class TextColumns(NamedTuple):
    """Chosen columns of a text file, their units, notes, and what `Record.to_csv` left."""

    values: dict[str, Any]
    stored: dict[str, str]
    notes: tuple[str, ...]
    meta: dict[str, Any]


@dataclass
class _Layout:
    """What the first lines of a text file tell about the rest."""

    where: str
    delimiter: str | None
    headings: list[str]
    chosen: dict[str, int]
    optional: tuple[str, ...]  # channels nobody asked for: their gaps are no errors
    lenient: bool = False  # words for a missing number make nan
    trailing: bool = False  # every line ends with a delimiter
    dated: bool = False  # the time is in dates, ns of which are kept
    twins: tuple[int, ...] = ()  # columns of time of other channels
    decimal: str = ""  # "." or "," once one was seen


@dataclass
class _Source:
    """A text file, the comments above its content, and whether its last line is complete."""

    path: Path
    comments: list[str]
    complete: bool = True


def read_text(
    path: Path, columns: Any, max_rows: int, timed: bool | None = True, lenient: bool = False,
    joint: Any = None,
) -> TextColumns:  # fmt: skip
    """Chosen columns of a text file; if lenient, a number that is missing is nan."""
    layout: _Layout | None = None
    source = _Source(path, [])
    parts: list[list[npt.NDArray[Any]]] = []
    notes: tuple[str, ...] = ()
    rows = 0
    for chunk, last in _chunks(source):
        if layout is None:
            layout, start = _sniff(path.name, chunk, source.comments, columns, timed, joint)
            layout.lenient = lenient
            if start > 1:
                lines = "1 line" if start == 2 else f"{start - 1} lines"
                were = "was" if start == 2 else "were"
                notes += (f"{lines} above the heading {were} skipped",)
            chunk = chunk[start:]
        if last and (why := _cut_off(layout, chunk, source.complete)):
            warn(f"{path.name}: row {chunk[-1][0]}, the last, {why}: cut off, and left out")
            chunk = chunk[:-1]
        rows += len(chunk)
        if rows > max_rows:
            raise ValueError(too_long(path.name, max_rows))
        if chunk:
            parts.append(_parse(layout, chunk))
    if layout is None:
        raise ValueError(f"{path.name} holds no data, only blank or comment lines")
    if not parts:
        raise ValueError(f"{path.name} holds a heading and no data rows")
    data = [np.concatenate(column) for column in zip(*parts, strict=True)]
    values = {role: _column(data.pop(0)) for role in layout.chosen}
    if not all(np.array_equal(values["t"], times) for times in data):
        raise ValueError(
            f"{path.name}: its channels have times of their own; export them with one time"
        )
    for role in layout.optional:
        if not np.isfinite(values[role]).mean() > (0.8 if lenient else 1.0 - 1e-12):
            del values[role], layout.chosen[role]
    stored = {r: split_header(layout.headings[k])[1] for r, k in layout.chosen.items()}
    if layout.dated:
        values["t"], stored["t"] = _over_midnight(values["t"]), "ns"
    notes += left_out(layout.headings, layout.chosen)
    return TextColumns(values, stored, notes, _own_notes(path.name, source.comments))


def _cut_off(layout: _Layout, chunk: list[tuple[int, str]], complete: bool) -> str:
    """What shows that the last row was not written to its end, if anything does."""
    if len(chunk) < 2:
        return ""
    rows = [_row(layout, line) for _, line in chunk[-_TAIL:]]
    own, others = rows.pop(), rows
    if len(own) < len(layout.headings):
        return f"has {len(own)} of {len(layout.headings)} columns"
    if complete or len(own) > len(layout.headings):
        return ""
    begun = re.fullmatch(r"[+-]?(\d+[.,]?\d*[ed][+-]?)?", own[-1], re.IGNORECASE)
    if begun and _is_number(others[-1][-1]):
        return f"ends in {own[-1][:40]!r}"

    def tail(cell: str) -> int:
        return len(re.split("[.,eEdD+-]", cell)[-1]) if re.search("[.,]", cell) else 0

    if _is_number(own[-1]) and tail(own[-1]) < min(tail(row[-1]) for row in others):
        return f"ends in {own[-1][:40]!r}, with fewer digits than all others"
    return ""


def _stamp(cell: str) -> int | None:
    """A date or a time of day in ns, None for anything else."""
    if (found := _STAMP.fullmatch(cell)) is None:
        return None
    date, hour, minute, second, fraction, zone = found.groups()
    try:
        if date and "." in date:
            date = "-".join(part.zfill(2) for part in date.split(".")[::-1])
        day = datetime.date.fromisoformat(date).toordinal() if date else 0
    except ValueError:
        return None
    seconds = 86_400 * (day - 719_163 * bool(date)) + 3600 * int(hour) + 60 * int(minute)
    if zone and zone not in "zZ":
        ahead = 3600 * int(zone[1:3]) + 60 * int(zone[-2:])
        seconds -= -ahead if zone[0] == "-" else ahead
    return 1_000_000_000 * (seconds + int(second)) + int((fraction or "0").ljust(9, "0"))


def _over_midnight(stamps: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Times of day that go on after midnight; dates as they are."""
    day = 86_400_000_000_000
    back = np.diff(stamps) < -day // 2
    return stamps if not back.any() else stamps + day * np.concatenate(([0], np.cumsum(back)))


def read_column(path: Path, max_rows: int) -> tuple[str, list[npt.NDArray[Any]]]:
    """Heading and the one or two columns of a file that holds one channel."""
    rows: list[list[str]] = []
    for chunk, _ in _chunks(_Source(path, [])):
        for number, line in chunk:
            rows.append([c for c in re.split(r"[;,\t ]+", line.strip()) if c])
            if len(rows) > max_rows + 1:
                raise ValueError(too_long(path.name, max_rows))
            if len(rows[-1]) not in (1, 2) and not (len(rows) == 1):
                raise ValueError(
                    f"{path.name}: row {number} has {len(rows[-1])} numbers; a file of one channel "
                    "has one in a row, or time and value (decimal points, not commas)"
                )
    heading = ""
    if rows and not all(_is_number(c) for c in rows[0]):
        heading = " ".join(rows.pop(0))
    if not rows:
        raise ValueError(f"{path.name} holds no data rows")
    width = len(rows[0])
    for number, row in enumerate(rows):
        if len(row) != width or not all(_is_number(c) and "," not in c for c in row):
            raise ValueError(
                f"{path.name}: data row {number} is {' '.join(row)[:40]!r}, not {width} number(s)"
            )
    table = np.array([[_exact(c) for c in row] for row in rows], dtype=object)
    return heading, [_column(table[:, k]) for k in range(width)]


def _column(values: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Numbers of one column, whole ones beyond 2^53 as integers.

    Beyond 2^53, what is written with a point or an exponent is no count, but a float64.
    """
    if values.dtype != object:
        return values
    if all(isinstance(v, int) or (v.is_integer() and abs(v) <= _EXACT) for v in values):
        try:
            return np.array([int(v) for v in values], dtype=np.int64)
        except OverflowError:
            pass
    return values.astype(np.float64)


def _number(cell: str) -> float:
    return float(_FORTRAN.sub(r"e\1\2", cell).replace(",", "."))


def _exact(cell: str) -> float | int:
    return int(cell) if _WHOLE.fullmatch(cell) else _number(cell)


def _open(path: Path) -> IO[str]:
    """The file as text, decompressed if its name ends in .gz, in UTF-16 if it says so."""
    packed = path.suffix.lower() == ".gz"
    with gzip.open(path, "rb") if packed else path.open("rb") as file:
        head = file.read(64)
    encoding = "utf-8-sig"
    if head[:2] in (b"\xff\xfe", b"\xfe\xff"):
        encoding = "utf-16"
    elif len(head) > 8 and not any(head[1::2]):
        encoding = "utf-16-le"
    if packed:
        raw = gzip.open(path, "rb")
        return io.TextIOWrapper(raw, encoding=encoding, errors="surrogateescape")
    return path.open(encoding=encoding, errors="surrogateescape")


def _chunks(source: _Source) -> Iterator[tuple[list[tuple[int, str]], bool]]:
    """Numbered content lines, and whether they are the last; comments go to the source."""
    try:
        yield from _content(source)
    except (gzip.BadGzipFile, EOFError, zlib.error) as problem:
        raise ValueError(
            f"{source.path.name} is damaged or not compressed by gzip ({problem})"
        ) from None
    except UnicodeError as problem:
        raise ValueError(f"{source.path.name} is no plain text ({problem})") from None


def _content(source: _Source) -> Iterator[tuple[list[tuple[int, str]], bool]]:
    found_any = False
    chunk: list[tuple[int, str]] = []
    where = source.path.name
    with _open(source.path) as file:
        number = 0
        while line := file.readline(_LINE_LIMIT):
            number += 1
            if len(line) == _LINE_LIMIT:
                raise ValueError(f"{where}: line {number} is too long; is it a text file?")
            if "\0" in line:
                raise ValueError(
                    f"{where}: line {number} is no plain text (a binary file?); "
                    "save it as CSV in UTF-8"
                )
            stripped = line.strip()
            if not stripped or stripped == "EOF":
                continue
            if stripped[0] in "#%":
                if not found_any and len(source.comments) < 1000:
                    source.comments.append(stripped)
                continue
            found_any = True
            if len(chunk) == _CHUNK:
                yield chunk, False
                chunk = []
            source.complete = line[-1] == "\n"
            if not line.isascii():
                line = line.replace("\N{MINUS SIGN}", "-")
            chunk.append((number, line.rstrip("\r\n").replace(" -> ", "\t", 1)))
    if chunk:
        yield chunk, True


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
            and all(_is_raw(pair) for pair in meta.get("raw", {}).values())
            and all(reason in REASONS for reason in meta.get("masked", []))
        )
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        sound = False
    if not sound:
        raise ValueError(f"{where}: the first line is damaged; remove it to read plain columns")
    return dict(meta)


def _is_raw(pair: Any) -> bool:
    """Whether this is a unit and a factor."""
    return (
        isinstance(pair, list)
        and [type(part) for part in pair] == [str, float]
        and 0 < abs(pair[1]) < 1e100
    )


def _sniff(
    where: str, chunk: list[tuple[int, str]], comments: list[str], columns: Any,
    timed: bool | None, joint: Any,
) -> tuple[_Layout, int]:  # fmt: skip
    """Delimiter, headings and the chosen columns; index of the first row of numbers."""
    lines = [text for _, text in chunk[:_PREAMBLE]]
    said = _SEPARATOR.fullmatch(lines[0].strip())
    first = 1 if said else 0
    if first == len(lines):
        raise ValueError(f"{where} holds no data, only its separator")
    sample = lines[first:][-20:]

    def numeric_cells(delimiter: str | None) -> int:
        return sum(_is_number(c) for s in sample for c in _cells(s, delimiter))

    def all_cells(delimiter: str | None) -> int:
        return sum(len(_cells(s, delimiter)) for s in sample)

    if said:
        delimiter: str | None = said[1] if said[1] != " " else None
    else:  # most numbers; for text alone, most cells; ties go to the first listed
        delimiter = max(_DELIMITERS, key=lambda d: (numeric_cells(d), all_cells(d)))
    rows = [_cells(text, delimiter) for text in lines]
    if len(rows) - first <= 2 and not any(_is_number(c) for row in rows[first:] for c in row):
        raise ValueError(f"{where} holds a heading and no data rows")
    if (scope := _scope(rows)) is not None:
        start, headings, clocks = scope
        chosen = assign_columns(headings, columns, where, timed, joint)
        own = {max((c for c in clocks if c <= k), default=0) for k in chosen.values()}
        optional = tuple(r for r in EXTRAS if r in chosen and r not in (columns or {}))
        twins = tuple(own - {chosen.get("t")}) if "t" in chosen else ()
        return _Layout(where, delimiter, headings, chosen, optional, twins=twins), start
    last = [row for row in rows[first:][-20:] if any(map(_is_number, row))] or [rows[-1]]
    trailing = all(len(row) > 1 and row[-1] == "" for row in last)
    start = _first_numbers(where, chunk, rows, first, len(last[0]))
    if trailing and start > first:  # unless the empty column has a name
        trailing = not any(_fitting(lines[start - 1], delimiter, len(last[0]), cut=False)[-1:])
    width = len(rows[start] if start < len(rows) else rows[-1]) - trailing
    headings = _headings(lines[first:start], comments, delimiter, width)
    needed = 2 if not timed or (isinstance(columns, dict) and None in columns.values()) else 3
    if len(headings) < needed:
        raise ValueError(
            f"{where} has {len(headings)} column(s), at least {'t, ' if timed else ''}u and x are "
            "needed; columns are separated by comma, semicolon, tab or blanks. "
            + ("Without a column of time give rate= [samples per s]. " if timed else "")
            + "Of files with one channel each, give all: "
            'read_record({"t": path, "u": path, "x": path})'
        )
    chosen = assign_columns(headings, columns, where, timed, joint)
    optional = tuple(r for r in EXTRAS if r in chosen and r not in (columns or {}))
    return _Layout(where, delimiter, headings, chosen, optional, trailing=trailing), start


def _scope(rows: list[list[str]]) -> tuple[int, list[str], list[int]] | None:
    """First row of numbers, headings and columns of time of an export of TwinCAT Scope.

    Over its numbers are rows that begin with what they say: names, symbols, units.  Every
    channel, or all, have a column of time in ms before them, under these words.
    """
    about = {row[0]: k for k, row in enumerate(rows) if len(row) > 2}
    if "Name" not in about or not {"Data-Type", "SampleTime[ms]", "SymbolName"} & set(about):
        return None
    names, units = rows[about["Name"]], rows[about["Unit"]] if "Unit" in about else []
    start = next((k for k in range(about["Name"], len(rows)) if _is_number(rows[k][0])), len(rows))
    clocks = [k for k, name in enumerate(names) if name == "Name"]
    headings = []
    for k, name in enumerate(names):
        unit = units[k] if k < len(units) and known_unit(units[k]) else ""
        headings.append("" if k in clocks else f"{name} [{unit}]" if unit else name)
    headings[clocks[0]] = "time [ms]"
    return start, headings, clocks


def _first_numbers(
    where: str, chunk: list[tuple[int, str]], rows: list[list[str]], first: int, width: int
) -> int:
    """Index of the first row of numbers; what is above must not look like one."""
    for start in range(first, len(rows)):
        if len(rows[start]) == width and any(map(_is_number, rows[start])):
            break
    else:
        return min(first + 1, len(rows))  # a heading alone, or rows that are told later
    above = next((k for k in range(first, start) if _is_data(rows[k])), None)
    if above is not None:
        raise ValueError(
            f"{where}: row {chunk[above][0]} has {len(rows[above])} columns, row {chunk[start][0]} "
            f"has {width}"
        )
    return start


def _is_data(row: list[str]) -> bool:
    """Whether a row holds numbers alone, two at least."""
    return len(row) > 1 and all(_is_number(c) or not c for c in row) and any(row)


def _headings(
    above: list[str], comments: list[str], delimiter: str | None, width: int
) -> list[str]:
    """Names over the columns: of the last line above, with one of units, or a comment's."""
    # A heading may hold a "#"; in a row of numbers it starts a comment.
    named = [_fitting(line, delimiter, width, cut=False) for line in above[-2:]]
    if named and named[-1]:
        if len(named) == 2 and named[0] and all(not c or known_unit(c) for c in named[1]):
            return [f"{n} [{u}]" if u else n for n, u in zip(named[0], named[1], strict=True)]
        return named[-1]
    for line in reversed(comments[-20:]):
        for mark in (delimiter, None):
            if found := _fitting(line.lstrip("#% "), mark, width):
                return found
    return [""] * width


def _fitting(line: str, delimiter: str | None, width: int, cut: bool = True) -> list[str]:
    """Cells of a line of names, none if they are not as many as the columns."""
    for text in (line, line.partition("#")[0]) if not cut else (line,):
        cells = [_readable(c) for c in _cells(text, delimiter, cut)]
        if len(cells) == width + 1 and cells[-1] == "":
            cells.pop()
        if len(cells) == width and not any(map(_is_number, cells)):
            return cells
    return []


def _cells(line: str, delimiter: str | None, cut: bool = True) -> list[str]:
    """Cells of one line, quotes honoured, blanks around them removed."""
    if cut:
        line = line.partition("#")[0]
    line = line.strip(" \r\n") if delimiter == "\t" else line.strip()
    if delimiter is None:
        return line.split()
    if '"' not in line:
        return [c.strip() for c in line.split(delimiter)]
    try:
        return [c.strip() for c in next(csv.reader([line], delimiter=delimiter), [])]
    except (csv.Error, ValueError, TypeError) as err:
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


def _parse(layout: _Layout, chunk: list[tuple[int, str]]) -> list[npt.NDArray[Any]]:
    """Chosen columns of some lines, then those of other times."""
    lines, mark, width = [line for _, line in chunk], layout.delimiter, len(layout.headings)
    text = "\n".join(lines)
    count = (lambda line: line.count(mark) + 1) if mark else (lambda line: len(line.split()))
    if '"' not in text and "#" not in text and {*map(count, lines)} == {width}:
        cells = (mark or " ").join(lines).split(mark)
    else:
        cells = []
        for number, line in chunk:
            row = _row(layout, line)
            if len(row) != width:
                raise ValueError(
                    f"{layout.where}: row {number} has {len(row)} columns, the first has {width}"
                )
            cells += row
    clock = layout.chosen.get("t")
    layout.dated = layout.dated or (clock is not None and _stamp(cells[clock].strip()) is not None)
    pick = [*layout.chosen.items(), *(("t", k) for k in layout.twins)]
    return [_numbers(layout, role, k, cells[k::width], chunk) for role, k in pick]


def _numbers(
    layout: _Layout, role: str, column: int, cells: list[str], chunk: list[tuple[int, str]]
) -> npt.NDArray[Any]:
    """Numbers of some cells of a column: all at once, or one by one where something is amiss."""
    text = "\n".join(cells)
    comma, point = "," in text, "." in text
    exact = layout.dated
    other = comma and (point or layout.delimiter == "," or layout.decimal == ".")
    if not (other or "_" in text or not text.isascii() or (layout.decimal == "," and point)):
        try:
            values = np.array(list(map(float, text.replace(",", ".").split("\n"))))
            layout.decimal = layout.decimal or "," * comma or "." * point
            if not np.abs(values).max() > _EXACT:
                return values
            exact = True
        except ValueError:
            pass  # below is said what cannot be read
    out: list[float | int] = []
    for (number, _), cell in zip(chunk, map(str.strip, cells), strict=True):
        if role == "t" and layout.dated and (stamp := _stamp(cell)) is not None:
            out.append(stamp)
            continue
        if not _is_number(cell) or (layout.delimiter == "," and "," in cell):
            if role in layout.optional or (layout.lenient and cell.lower() in _NO_NUMBER):
                out.append(math.nan)
                continue
            what = f"{cell[:40]!r} is not a number" if cell else _EMPTY
            label = layout.headings[column] or str(column)
            raise ValueError(
                f"{layout.where}: row {number}, column {label!r} ({role}): {what}"
                + _DATES * (role == "t" and cell.count(":") + cell.count("-") > 1)
            )
        mark = "," if "," in cell else "." if "." in cell else ""
        if mark and layout.decimal and mark != layout.decimal:
            raise ValueError(
                f"{layout.where}: row {number}: {cell[:40]!r} mixes decimal commas and points; "
                "write all numbers one way, without thousands separators"
            )
        layout.decimal = layout.decimal or mark
        out.append(_exact(cell) if exact else _number(cell))
    return np.array(out, dtype=object if exact else np.float64)


def _row(layout: _Layout, line: str) -> list[str]:
    """Cells of a row, without what follows a delimiter at its end."""
    cells = _cells(line, layout.delimiter)
    if len(cells) == len(layout.headings) + 1 and cells[-1] == "":
        cells.pop()
    return cells
