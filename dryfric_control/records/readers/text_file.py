"""Columns of delimited text."""

from __future__ import annotations

import contextlib
import csv
import datetime
import functools
import gzip
import itertools
import json
import math
import re
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import IO, Any

import numpy as np
import numpy.typing as npt

from dryfric_control.records.clock import epoch_of, rises
from dryfric_control.records.readers import channels
from dryfric_control.records.readers.channels import (
    EXTRAS,
    Channels,
    Clues,
    Wanted,
    split_header,
)
from dryfric_control.records.readers.limits import too_long
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
#: Words for no unit, and for a number that is not there.
_NO_UNIT = ("-", "--", "n/a", "none")
_NO_NUMBER = ("", "nan", "-nan", "null", "none", "na", "n/a", "#n/a", "-", "--", "---")
_WHOLE = re.compile(r"[+-]?\d{1,19}", re.ASCII)
_SEPARATOR = re.compile(r'"?sep=(.)"?', re.IGNORECASE)
_DELIMITERS = (";", "\t", ",", "|", None)  # None: runs of blanks
# Rows of an export of TwinCAT Scope that is separated by colons.
_SCOPE_COLONS = ("Name:", "Data-Type:", "SampleTime[ms]:")
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
# Rows of which one shows an export of TwinCAT Scope.
_SCOPE_ROWS = {"Data-Type", "SampleTime[ms]", "SymbolName", "Starttime of export"}
# A unit in brackets behind the word that it belongs to.
_UNIT = re.compile(r"(\S)\s+([\[(][^\[\]()]*[\])])")
#: Encodings of tools that write no UTF-8: Western Europe, Japan, China, Taiwan, Korea, Russia.
_OLD_ENCODINGS = ("latin-1", "cp932", "gb18030", "big5", "euc_kr", "cp1251")
_NO_UTF8 = re.compile("[\udc80-\udcff]")  # a byte that was kept as it is
_PREAMBLE = 200  # lines among which the first row of numbers must be

_Lines = list[tuple[int, str]]  # with their numbers
_Array = npt.NDArray[Any]


@dataclass
class _Text:
    """A text file and its layout, as far as it has been read."""

    path: Path
    wanted: Wanted
    comments: list[str] = field(default_factory=list)  # above the content
    complete: bool = True  # the last line has an end
    delimiter: str | None = None
    headings: list[str] = field(default_factory=list)
    chosen: dict[str, int] = field(default_factory=dict)
    optional: tuple[str, ...] = ()  # channels nobody asked for: their gaps are no errors
    clocks: dict[str, int] = field(default_factory=dict)  # columns of time by channel
    factors: tuple[str, ...] = ()  # notes on factors that the file states
    lacking: str = ""  # what to say of the first number that is missing
    dated: bool = False  # the time is in dates, ns of which are kept
    decimal: str = ""  # "." or "," once one was seen

    @property
    def name(self) -> str:
        return self.path.name

    @property
    def columns(self) -> list[int]:
        """Columns that are read, each once."""
        return list(dict.fromkeys([*self.chosen.values(), *self.clocks.values()]))

    def cells(self, line: str) -> list[str]:
        """Cells of a row, without what follows a delimiter at its end."""
        cells = _cells(line, self.delimiter, width=len(self.headings))
        if self.clocks:  # those of a slower channel end earlier
            cells += [""] * (len(self.headings) - len(cells))
        return cells


def read_text(path: Path, start: Channels, wanted: Wanted) -> Channels:
    """Chosen columns of a text file."""
    text = _Text(path, wanted)
    parts, above = _parse_chunks(text)
    if not text.headings:
        raise ValueError(f"{text.name} holds no data, only blank or comment lines")
    if not parts:
        raise ValueError(f"{text.name} holds a heading and no data rows")
    data = {k: np.concatenate(column) for k, column in zip(text.columns, zip(*parts, strict=True),
                                                           strict=True)}  # fmt: skip
    values = {role: _column(data[k]) for role, k in text.chosen.items()}
    clocks = _separate_clocks(text, values, data)
    _drop_sparse(text, values, clocks)
    units = {r: split_header(text.headings[k])[1] for r, k in text.chosen.items()}
    if text.dated:
        values["t"], units["t"] = _over_midnight(values["t"]), "ns"
    if clocks:
        units["t"] = "" if epoch_of(values.pop("t")) else units["t"]
    start = replace(
        start, values=values, units=units, clocks=clocks, lacking=text.lacking,
        drive=channels.drive_quantity(text.headings, text.chosen),
    )  # fmt: skip
    if own := _own_notes(text):
        return replace(start, **own)
    notes = channels.left_out(text.headings, text.chosen) + text.factors
    notes += channels.guess_notes(text.headings, text.chosen, wanted)
    if above > 1:
        lines, were = ("line", "was") if above == 2 else ("lines", "were")
        notes = (f"{above - 1} {lines} above the heading {were} skipped", *notes)
    return replace(start, notes=notes)


def _drop_sparse(text: _Text, values: dict[str, _Array], clocks: dict[str, _Array]) -> None:
    """Drop optional channels that lack more numbers than are bridged."""
    for role in text.optional:
        lenient = text.wanted.lenient or clocks or text.lacking
        least = 0.8 if lenient else 1.0 - 1e-12
        if not np.isfinite(values[role]).mean() > least:
            del values[role], text.chosen[role]
            clocks.pop(role, None)


def _parse_chunks(text: _Text) -> tuple[list[list[_Array]], int]:
    """Columns of each part of a file, and the number of lines above its numbers."""
    parts: list[list[_Array]] = []
    above = rows = 0
    content = _content_lines(text)
    chunk = list(itertools.islice(content, _CHUNK))
    while chunk:
        following = list(itertools.islice(content, _CHUNK))
        if not text.headings:
            above = _lay_out(text, chunk)
            chunk = chunk[above:]
        if not following and (why := _cut_off(text, chunk)):
            warn(f"{text.name}: row {chunk[-1][0]}, the last, {why}: cut off, and left out")
            chunk = chunk[:-1]
        rows += len(chunk)
        if rows > text.wanted.max_rows:
            raise ValueError(too_long(text.name, text.wanted.max_rows))
        if chunk:
            parts.append(_parse(text, chunk))
        chunk = following
    return parts, above


def _separate_clocks(
    text: _Text, values: dict[str, _Array], data: dict[int, _Array]
) -> dict[str, _Array]:
    """Stamps by channel where several columns of time differ, none where they do not."""
    if not text.clocks:
        return {}
    found = {role: _column(data[k]) for role, k in text.clocks.items()}
    if all(np.array_equal(values["t"], one) for one in found.values()):
        return {}
    return found


def read_column(path: Path, max_rows: int) -> tuple[str, list[_Array]]:
    """Heading and the one or two columns of a file that holds one channel."""
    content = itertools.islice(_content_lines(_Text(path, Wanted())), max_rows + 2)
    rows = [(n, [c for c in re.split(r"[;,\t ]+", line.strip()) if c]) for n, line in content]
    if len(rows) > max_rows + 1:
        raise ValueError(too_long(path.name, max_rows))
    heading = ""
    if rows and not all(map(_is_number, rows[0][1])):
        heading = " ".join(rows.pop(0)[1])
    if not rows:
        raise ValueError(f"{path.name} holds no data rows")
    width = len(rows[0][1])
    for number, row in rows:
        count = sum(map(_is_number, row))
        if not count == len(row) == width <= 2:
            raise ValueError(
                f"{path.name}: row {number}, {' '.join(row)[:40]!r}, has {count} numbers; a file "
                "of one channel has one in each row, or time and value (decimal points, not commas)"
            )
    table = np.array([[_exact(c) for c in row] for _, row in rows], dtype=object)
    return heading, [_column(table[:, k]) for k in range(width)]


def _open(path: Path) -> IO[str]:
    """The file as text, decompressed if its name ends in .gz, in UTF-16 if it says so."""
    opened: Any = gzip.open if path.suffix.lower() == ".gz" else open
    with opened(path, "rb") as raw:
        head = raw.read(64)
    encoding = "utf-8-sig"
    if head[:2] in (b"\xff\xfe", b"\xfe\xff"):
        encoding = "utf-16"
    elif len(head) > 8 and not any(head[1::2]):
        encoding = "utf-16-le"
    return opened(path, "rt", encoding=encoding, errors="surrogateescape")


def _content_lines(text: _Text) -> Iterator[tuple[int, str]]:
    """Lines of the content, and their numbers; comments above it go to the text."""
    name = text.name
    begun = False
    try:
        with _open(text.path) as file:
            read = iter(functools.partial(file.readline, _LINE_LIMIT), "")
            for number, line in enumerate(read, 1):
                if len(line) == _LINE_LIMIT:
                    raise ValueError(f"{name}: line {number} is too long; is it a text file?")
                if "\0" in line:
                    raise ValueError(
                        f"{name}: line {number} is no plain text (a binary file?); "
                        "save it as CSV in UTF-8"
                    )
                stripped = line.strip()
                if not stripped or stripped == "EOF":
                    continue
                if stripped[0] in "#%":
                    if not begun and len(text.comments) < 1000:
                        text.comments.append(stripped)
                    continue
                begun, text.complete = True, line[-1] == "\n"
                if not line.isascii():
                    line = line.replace("\N{MINUS SIGN}", "-")
                yield number, line.rstrip("\r\n").replace(" -> ", "\t", 1)
    except (gzip.BadGzipFile, EOFError, zlib.error) as problem:
        raise ValueError(f"{name} is damaged or not compressed by gzip ({problem})") from None
    except UnicodeError as problem:
        raise ValueError(f"{name} is no plain text ({problem})") from None


def _own_notes(text: _Text) -> dict[str, Any]:
    """What `Record.to_csv` wrote of the record in the first line, if it did."""
    if not text.comments or not text.comments[0].startswith(SIGNATURE):
        return {}
    first = re.fullmatch(r"\s*(\d{1,6}) (.*)", text.comments[0][len(SIGNATURE) :], re.ASCII)
    if first and int(first[1]) > FORMAT:
        raise ValueError(
            f"{text.name} was written in format {first[1]}, this version reads up to {FORMAT}; "
            "update the package, or remove the first line to read plain columns"
        )
    try:
        meta = json.loads(first[2] if first else "")
    except (ValueError, RecursionError):
        meta = None
    return channels.own_notes(meta, f"{text.name}: the first line is damaged; remove it")


def _lay_out(text: _Text, chunk: _Lines) -> int:
    """Find delimiter, headings and the chosen columns; index of the first row of numbers."""
    lines = [line for _, line in chunk[:_PREAMBLE]]
    first = _find_delimiter(text, lines)
    rows = [_cells(line, text.delimiter) for line in lines]
    if len(rows) - first <= 2 and not any(_is_number(c) for row in rows[first:] for c in row):
        raise ValueError(f"{text.name} holds a heading and no data rows")
    clocks: list[int] = []
    if (scope := _scope(text, rows)) is not None:
        start, text.headings, clocks = scope
    else:
        start = _with_headings(text, chunk, rows, first)
        _check_column_count(text)
    _choose_columns(
        text, clocks, _clock_clues([row for row in rows[start:] if len(row) == len(text.headings)])
    )
    return start


def _clock_clues(rows: list[list[str]]) -> Clues:
    """What the first rows of numbers show of clocks."""

    def is_date(cell: str) -> bool:
        return _stamp(cell) is not None or (
            _is_number(cell) and epoch_of([_number(cell)]) is not None
        )

    columns = list(zip(*rows, strict=True))
    numbers = {k: [*map(_number, c)] for k, c in enumerate(columns) if all(map(_is_number, c))}
    return Clues(
        tuple(k for k, cells in enumerate(columns) if is_date(cells[0])),
        tuple(k for k, values in numbers.items() if rises(values)),
    )


def _find_delimiter(text: _Text, lines: list[str]) -> int:
    """Find the delimiter, stated or not; index of the first line of content."""
    stated = _SEPARATOR.fullmatch(lines[0].strip())
    if stated and len(lines) == 1:
        raise ValueError(f"{text.name} holds no data, only its separator")
    text.delimiter = stated[1].strip(" ") or None if stated else _delimiter(lines)
    return 1 if stated else 0


def _check_column_count(text: _Text) -> None:
    """Refuse a file of fewer columns than a record needs."""
    columns = text.wanted.columns
    timed = text.wanted.timed
    needed = 2 if not timed or (isinstance(columns, dict) and None in columns.values()) else 3
    if len(text.headings) < needed:
        raise ValueError(
            f"{text.name} has {len(text.headings)} column(s), at least "
            f"{'t, ' if timed else ''}u and x are "
            "needed; columns are separated by comma, semicolon, tab or blanks. "
            + ("Without a column of time give rate= [samples per s]. " if timed else "")
            + "Of files with one channel each, give all: "
            'read_record({"t": path, "u": path, "x": path})'
        )


def _choose_columns(text: _Text, clocks: list[int], clues: Clues) -> None:
    """Choose the columns by their headings, and to each that of its time, of several."""
    columns = text.wanted.columns or {}
    text.chosen = channels.assign_columns(text.headings, text.wanted, text.name, clues)
    text.optional = tuple(r for r in EXTRAS if r in text.chosen and r not in columns)
    if clocks and "t" in text.chosen and "t" not in columns:
        played = {role: k for role, k in text.chosen.items() if role != "t"}
        text.clocks = {role: max(c for c in clocks if c <= k) for role, k in played.items()}


def _delimiter(above: list[str]) -> str | None:
    """The one that gives most numbers; for text alone, most cells; ties go to the first listed."""
    lines = above[-20:]
    if any(line.startswith(_SCOPE_COLONS) for line in above):
        return ":"

    def cells(delimiter: str | None) -> tuple[int, int]:
        found = [c for line in lines for c in _cells(line, delimiter)]
        return sum(map(_is_number, found)), len(found)

    return max(_DELIMITERS, key=cells)


def _scope(text: _Text, rows: list[list[str]]) -> tuple[int, list[str], list[int]] | None:
    """First row of numbers, headings and columns of time of an export of TwinCAT Scope."""
    # Rows above the numbers begin with what they say; a column of time in ms, under these words,
    # stands before every channel or before all.
    about = {row[0]: k for k, row in enumerate(rows) if len(row) > 1}
    if "Name" not in about or not _SCOPE_ROWS & set(about):
        return None
    names = _decoded(rows[about["Name"]], text.delimiter)
    start = about["Name"]
    while start < len(rows) and not _is_number(rows[start][0]):
        start += 1
    clocks = [k for k, name in enumerate(names) if name == "Name"]

    def cell_of(row: str, k: int) -> str:
        cells = rows[about[row]] if row in about else []
        return cells[k] if k < len(cells) else ""

    headings = [""] * len(names)
    for k, name in enumerate(names):
        if k in clocks:
            continue
        # "V (Voltage)": the unit, then its quantity
        unit = cell_of("Unit", k).partition(" (")[0].strip()
        headings[k] = f"{name} [{unit}]" if known_unit(unit) else name
        for row, usual in (("ScaleFactor", 1.0), ("Offset", 0.0)):
            cell = cell_of(row, k)
            if _is_number(cell) and _number(cell) != usual:
                text.factors += (f"{name} has {row} {cell}: the export says not whether it is in "
                                 "the numbers",)  # fmt: skip
    headings[clocks[0]] = "time [ms]"
    return start, headings, clocks


def _with_headings(text: _Text, chunk: _Lines, rows: list[list[str]], first: int) -> int:
    """Find the headings over the first row of numbers, which nothing like one precedes."""
    last = [row for row in rows[first:][-20:] if any(map(_is_number, row))] or [rows[-1]]
    width = len(last[0])
    start = _first_numbers(rows, first, width)
    if start < len(rows):
        _refuse_other_widths(text, chunk, rows, range(first, start), width)
    if start == len(rows):  # a heading alone, or rows that are told later
        start = min(first + 1, len(rows))
    above = _decoded([line for _, line in chunk[first:start]], text.delimiter)
    trailing = all(len(row) > 1 and row[-1] == "" for row in last)
    if trailing and above:  # unless the empty column has a name
        trailing = not any(_heading_cells(above[-1], text.delimiter, width, cut=False)[-1:])
    width = len(rows[start] if start < len(rows) else rows[-1]) - trailing
    comments = _decoded(text.comments[-20:], text.delimiter)
    text.headings = _headings(above, comments, text.delimiter, width)
    if above and not any(text.headings):
        _tell_of_no_headings(text, above[-1], width)
    return start


def _first_numbers(rows: list[list[str]], first: int, width: int) -> int:
    """First row of a width, from `first` on, that holds a number; behind the last if none does."""
    for k in range(first, len(rows)):
        if len(rows[k]) == width and any(map(_is_number, rows[k])):
            return k
    return len(rows)


def _refuse_other_widths(
    text: _Text, chunk: _Lines, rows: list[list[str]], above: range, width: int
) -> None:
    """Refuse rows of numbers above the first row that has the width of the last ones."""
    for k in above:
        row = rows[k]
        if len(row) > 1 and any(row) and all(_is_number(c) or not c for c in row):
            raise ValueError(
                f"{text.name}: row {chunk[k][0]} has {len(row)} columns, row "
                f"{chunk[above.stop][0]} has {width}"
            )


def _tell_of_no_headings(text: _Text, line: str, width: int) -> None:
    """What stands above the numbers, where it does not name each column once."""
    names = [c for c in _cells(line, text.delimiter) if c and not _is_number(c)]
    if text.delimiter == "," and len(names) > 1 and width == 2 * len(names):
        raise ValueError(
            f"{text.name} has {width} cells a row under {len(names)} headings: decimal commas "
            "between commas? Export it with semicolons between the columns, or with decimal points"
        )
    if len(names) > 1 and not text.wanted.columns:
        warn(
            f"{text.name}: the line above the numbers, {line.strip()[:60]!r}, does "
            f"not name each of the {width} columns: it is passed over, units too. Say what they "
            'are, columns={"t": 0, "u": 1, "x": 2} and units={"x": "..."}'
        )


def _headings(above: list[str], notes: list[str], delimiter: str | None, width: int) -> list[str]:
    """Names over the columns: of the last line above, with one of units, or a comment's."""
    # A heading may hold a "#"; in a row of numbers it starts a comment.
    named = [_heading_cells(line, delimiter, width, cut=False) for line in above[-2:]]
    if named and named[-1]:
        if len(named) == 2 and named[0] and (units := _row_of_units(named[1])):
            return [f"{n} [{u}]" if u else n for n, u in zip(named[0], units, strict=True)]
        return named[-1]
    for line in reversed(notes):
        for mark in (delimiter, None):
            if found := _heading_cells(line.lstrip("#% "), mark, width):
                return found
    return [""] * width


def _row_of_units(cells: list[str]) -> list[str]:
    """Units in a row under the headings, with brackets or not, empty for none; else no cells."""
    units = [cell.strip("[]() ") for cell in cells]
    units = ["" if unit in _NO_UNIT else unit for unit in units]
    known = [known_unit(unit) is not None for unit in units if unit]
    return units if any(known) and all(known) else []


def _heading_cells(line: str, delimiter: str | None, width: int, cut: bool = True) -> list[str]:
    """Cells of a line of names, none if they are not as many as the columns."""
    lines: tuple[str, ...] = (line,) if cut else (line, line.partition("#")[0])
    if delimiter is None:  # a unit belongs to the word before it: Tempo (s) Forza (N m)
        lines += tuple(_UNIT.sub(lambda m: m[1] + m[2].replace(" ", "*"), one) for one in lines)
    for words in lines:
        cells = _cells(words, delimiter, cut, width)
        if len(cells) == width and not any(map(_is_number, cells)):
            return cells
    return []


def _cut_off(text: _Text, chunk: _Lines) -> str:
    """What shows that the last row was not written to its end, if anything does."""
    if len(chunk) < 2:
        return ""
    *others, own = (text.cells(line) for _, line in chunk[-_TAIL:])
    if len(own) < len(text.headings):
        return f"has {len(own)} of {len(text.headings)} columns"
    if text.complete or len(own) > len(text.headings):
        return ""
    begun = re.fullmatch(r"[+-]?(\d+[.,]?\d*[ed][+-]?)?", own[-1], re.IGNORECASE)
    if begun and _is_number(others[-1][-1]):
        return f"ends in {own[-1][:40]!r}"

    def tail(cell: str) -> int:
        return len(re.split("[.,eEdD+-]", cell)[-1]) if re.search("[.,]", cell) else 0

    if _is_number(own[-1]) and tail(own[-1]) < min(tail(row[-1]) for row in others):
        return f"ends in {own[-1][:40]!r}, with fewer digits than all others"
    return ""


def _cells(line: str, delimiter: str | None, cut: bool = True, width: int = -1) -> list[str]:
    """Cells of one line, stripped, quotes honoured, without an empty one beyond the width."""
    if cut:
        line = line.partition("#")[0]
    line = line.strip(" \r\n") if delimiter == "\t" else line.strip()
    if delimiter is None or '"' not in line:
        cells = line.split(delimiter)
    else:
        try:
            cells = next(csv.reader([line], delimiter=delimiter))
        except (csv.Error, ValueError, TypeError) as err:
            raise ValueError(f"line {line[:40]!r} cannot be split into cells ({err})") from err
    if len(cells) == width + 1 and not cells[-1].strip():
        cells.pop()
    return [c.strip() for c in cells]


def _decoded(lines: list[str], delimiter: str | None) -> list[str]:
    """Lines of names; if not in UTF-8, in the encoding in which most cells name a channel."""
    if not any(map(_NO_UTF8.search, lines)):
        return lines
    stored = "\n".join(lines).encode("utf-8", "surrogateescape")

    def recognised(content: str) -> int:
        cells = (c for line in content.split("\n") for c in _cells(line, delimiter, cut=False))
        parts = [split_header(cell) for cell in cells]
        return sum(
            bool(channels.parse_heading(name).role) + bool(unit and known_unit(unit))
            for name, unit in parts
        )

    contents = []
    for encoding in _OLD_ENCODINGS:
        with contextlib.suppress(UnicodeDecodeError):
            contents.append(stored.decode(encoding))
    return max(contents, key=recognised).split("\n")


def _is_number(cell: str) -> bool:
    return _NUMBER.fullmatch(cell) is not None


def _number(cell: str) -> float:
    return float(_FORTRAN.sub(r"e\1\2", cell).replace(",", "."))


def _exact(cell: str) -> float | int:
    return int(cell) if _WHOLE.fullmatch(cell) else _number(cell)


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


def text_values(cells: list[str]) -> _Array | None:
    """Dates or numbers in a column of text, None where it has something else."""
    cells = [cell.strip() for cell in cells]
    stamps = [_stamp(cell) for cell in cells]
    if None not in stamps:
        return _over_midnight(np.array(stamps)).astype("datetime64[ns]")
    there = [cell.lower() not in _NO_NUMBER for cell in cells]
    whole = "\n".join(cells)
    if ("," in whole and "." in whole) or not all(
        map(_is_number, itertools.compress(cells, there))
    ):
        return None
    numbers = [_exact(c) if known else math.nan for c, known in zip(cells, there, strict=True)]
    return _column(np.array(numbers, dtype=object))


def _over_midnight(stamps: _Array) -> _Array:
    """Times of day that go on after midnight; dates as they are."""
    day = 86_400_000_000_000
    back = np.diff(stamps) < -day // 2
    return stamps if not back.any() else stamps + day * np.concatenate(([0], np.cumsum(back)))


def _column(values: _Array) -> _Array:
    """Numbers of one column, whole ones beyond 2^53 as integers if written as such."""
    if values.dtype != object:
        return values
    if all(isinstance(v, int) or (v.is_integer() and abs(v) <= channels.EXACT) for v in values):
        try:
            return np.array([int(v) for v in values], dtype=np.int64)
        except OverflowError:
            pass
    return values.astype(np.float64)


def _parse(text: _Text, chunk: _Lines) -> list[_Array]:
    """Chosen columns of some lines, then those of other times."""
    lines, mark, width = [line for _, line in chunk], text.delimiter, len(text.headings)
    whole = "\n".join(lines)
    count = (lambda line: line.count(mark) + 1) if mark else (lambda line: len(line.split()))
    if '"' not in whole and "#" not in whole and {*map(count, lines)} == {width}:
        cells = (mark or " ").join(lines).split(mark)
    else:
        cells = []
        for number, line in chunk:
            row = text.cells(line)
            if len(row) != width:
                raise ValueError(
                    f"{text.name}: row {number} has {len(row)} columns, the first has {width}"
                )
            cells += row
    clock = text.chosen.get("t")
    text.dated = text.dated or (clock is not None and _stamp(cells[clock].strip()) is not None)
    roles = {k: role for role, k in text.chosen.items()}
    return [_numbers(text, roles.get(k, "t"), k, cells[k::width], chunk) for k in text.columns]


def _numbers(text: _Text, role: str, column: int, cells: list[str], chunk: _Lines) -> _Array:
    """Numbers of some cells of a column: all at once, or one by one where something is amiss."""
    whole = "\n".join(cells)
    comma = "," in whole
    point = "." in whole
    exact = text.dated
    other = comma and (point or text.delimiter == "," or text.decimal == ".")
    if not (other or "_" in whole or not whole.isascii() or (text.decimal == "," and point)):
        try:
            values = np.array(list(map(float, whole.replace(",", ".").split("\n"))))
            text.decimal = text.decimal or "," * comma or "." * point
            if not np.abs(values).max() > channels.EXACT:
                return values
            exact = True
        except ValueError:
            pass  # below is said what cannot be read
    out = [
        _value(text, role, column, cell.strip(), number, exact)
        for (number, _), cell in zip(chunk, cells, strict=True)
    ]
    return np.array(out, dtype=object if exact else np.float64)


def _value(text: _Text, role: str, column: int, cell: str, number: int, exact: bool) -> float | int:
    """Number in a cell of a row, or an error that names both."""
    if role == "t" and text.dated and (stamp := _stamp(cell)) is not None:
        return stamp
    if not _is_number(cell) or (text.delimiter == "," and "," in cell):
        return _missing_value(text, role, column, cell, number)
    mark = "," if "," in cell else "." if "." in cell else ""
    if mark and text.decimal and mark != text.decimal:
        raise ValueError(
            f"{text.name}: row {number}: {cell[:40]!r} mixes decimal commas and points; "
            "write all numbers one way, without thousands separators"
        )
    text.decimal = text.decimal or mark
    return _exact(cell) if exact else _number(cell)


def _missing_value(text: _Text, role: str, column: int, cell: str, number: int) -> float:
    """NaN for a cell without a number where there may be one, or an error that says what is there.

    The first cell that lacks a number of a needed channel goes to `text.lacking`.
    """
    missing = cell.lower() in _NO_NUMBER
    if role in text.optional or (missing and (text.wanted.lenient or text.clocks)):
        return math.nan
    what = f"{cell[:40]!r} is not a number" if cell else _EMPTY
    label = text.headings[column] or str(column)
    message = f"{text.name}: row {number}, column {label!r} ({role}): {what}"
    if _is_number(cell):
        message += (
            ", but one in quotes with a comma, decimal or of thousands: export it with "
            "semicolons between the columns, or with decimal points"
        )
    if missing and role != "t":
        text.lacking = text.lacking or message
        return math.nan
    raise ValueError(message + _DATES * (role == "t" and cell.count(":") + cell.count("-") > 1))
