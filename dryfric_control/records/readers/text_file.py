"""Columns of delimited text."""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from dryfric_control.records.readers.channels import assign_columns, split_header, too_long

SIGNATURE = "# dryfric-control record"
FORMAT = 1
SUFFIXES = (".csv", ".tsv", ".txt", ".dat")
_NUMBER = re.compile(
    r"[+-]?(?:(?:\d+(?:[.,]\d*)?|[.,]\d+)(?:[eE][+-]?\d+)?|nan|inf(?:inity)?)",
    re.ASCII | re.IGNORECASE,
)

_DELIMITERS = (";", "\t", ",", None)  # None: runs of blanks
_LINE_LIMIT = 1_000_000
_CHUNK = 65_536


@dataclass
class _Layout:
    """What the first lines of a text file tell about the rest."""

    where: str
    delimiter: str | None
    headings: list[str]
    chosen: dict[str, int]
    decimal: str = ""  # "." or "," once one was seen


def read_text(
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
            raise ValueError(too_long(path.name, max_rows))
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
