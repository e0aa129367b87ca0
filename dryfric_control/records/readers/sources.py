"""Channels out of a file, a data frame or a mapping of arrays.

Nothing here judges the data: that is the business of `records`.  Nothing
from a file is ever executed.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from dryfric_control.records.readers.channels import (
    ALIASES,
    Channels,
    assign_columns,
    scaled,
    split_header,
    to_si,
    too_long,
)
from dryfric_control.records.readers.mat_file import read_mat
from dryfric_control.records.readers.text_file import SUFFIXES, read_text
from dryfric_control.store.files import existing_file

MAX_ROWS = 10_000_000  # 0.3 GB for four columns


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
        if suffix in SUFFIXES:
            values, stored, meta = read_text(path, columns, max_rows)
            name = meta.get("name", name) if meta else name
            quantum, extra = meta.get("quantum"), tuple(meta.get("notes", ()))
            return _with(to_si(values, stored, gain, units, where), extra, name, quantum)
        if suffix != ".mat":
            raise ValueError(_unsupported(path))
        table = read_mat(path)
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
            raise ValueError(too_long(where, max_rows))
        values[role] = _as_seconds(array) if role == "t" else array
    if _scales_by_gtau(table, headings, chosen, columns):
        factor = float(np.ravel(table["gtau"])[0])
        values["u"] = scaled(values["u"], factor)
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
        f"Read are {', '.join(SUFFIXES)} and .mat"
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
    if index is not None and not any(n in ALIASES["t"] for n in names):
        label = str(index.name) if index.name is not None else "t"
        if label not in table and (
            index.dtype.kind in "mMf" or split_header(label)[0].lower() in ALIASES["t"][1:]
        ):
            table[label if split_header(label)[0].lower() in ALIASES["t"] else "t"] = (
                index.to_numpy()
            )
    return table
