"""Channels out of a file, a data frame or a mapping of arrays.

Nothing here judges the data: that is the business of `records`.  Nothing
from a file is ever executed.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from dryfric_control.records.readers.array_file import read_json_lines, read_numpy
from dryfric_control.records.readers.channels import (
    EXTRAS,
    MAX_ROWS,
    Channels,
    assign_columns,
    left_out,
    named,
    scaled,
    split_header,
    to_si,
    too_long,
)
from dryfric_control.records.readers.mat_file import read_mat
from dryfric_control.records.readers.mcap_log import read_mcap
from dryfric_control.records.readers.tables import read_parquet, read_xlsx
from dryfric_control.records.readers.text_file import SUFFIXES, read_column, read_text
from dryfric_control.records.scaling import Scaling
from dryfric_control.store.files import existing_file

_SOUND = 0.8  # part of a channel that must be numbers; those that are not are bridged
_EXACT = 2**53  # beyond, float64 leaves whole numbers out


def read_channels(
    source: Any,
    columns: Mapping[str, str | int | None] | None = None,
    gain: float | Mapping[str, float] | Scaling = 1.0,
    units: Mapping[str, str] | None = None,
    max_rows: int = MAX_ROWS,
    step: float | None = None,
    timed: bool | None = True,
    joint: str | int | None = None,
) -> Channels:
    """Channels of a file, data frame or mapping.

    `step` [s] is that of a source without a column of time or of the record, and makes words for a
    missing number nan; `timed`: whether there is such a column, None for perhaps.
    """
    if isinstance(max_rows, bool) or not isinstance(max_rows, int) or max_rows < 1:
        raise ValueError(f"max_rows must be a positive whole number, got {max_rows!r}")
    name: str | None = None
    quantum: float | None = None
    raw: dict[str, tuple[str, float]] = {}
    extra: tuple[str, ...] = ()
    masked: tuple[str, ...] | None = None
    if isinstance(source, (str, os.PathLike)):
        path = existing_file(source)
        where, name = path.name, path.stem
        suffix = path.suffix.lower()
        if suffix == ".gz":
            name, suffix = Path(name).stem, Path(name).suffix.lower()
            if suffix not in SUFFIXES:
                raise ValueError(_unsupported(path))
        if suffix in SUFFIXES:
            found = read_text(path, columns, max_rows, timed, step is not None, joint)
            values, stored, meta = found.values, found.stored, found.meta
            name = meta.get("name", name) if meta else name
            quantum, extra = meta.get("quantum"), tuple(meta.get("notes", ()))
            raw = {k: (str(u), float(f)) for k, (u, f) in meta.get("raw", {}).items()}
            extra += () if meta else found.notes
            masked = tuple(meta["masked"]) if "masked" in meta else None
            return _finished(
                values, stored, gain, units, where, step, timed, extra, name, quantum, raw, masked
            )
        if suffix == ".mcap":
            table = read_mcap(path, columns, max_rows, joint)
        elif suffix in _TABLES:
            table = _TABLES[suffix](path, max_rows)
        else:
            raise ValueError(_unsupported(path))
    elif isinstance(source, Mapping):
        where, table = "the mapping", {str(k): v for k, v in source.items()}
        table = _with_files(table, max_rows)
    elif hasattr(source, "columns") and hasattr(source, "__getitem__"):
        where, table = "the data frame", frame_columns(source)
        if isinstance(kept := getattr(source, "attrs", {}).get("dryfric_control"), Mapping):
            name, quantum, extra = kept.get("name"), kept.get("quantum"), tuple(kept["notes"])
            raw = dict(kept.get("raw", {}))
            masked = tuple(kept["masked"]) if "masked" in kept else None
    else:
        raise TypeError(
            "read_record takes a path, a data frame or a mapping of arrays, "
            f"got {type(source).__name__}"
        )
    headings = list(table)
    unnamed = all(h.isdigit() for h in headings)  # columns of an array
    chosen = assign_columns(
        [""] * len(headings) if unnamed else headings, columns, where, timed, joint
    )
    for role in (*EXTRAS, "good"):  # kept where they are numbers, one for each sample
        if role in chosen and role not in (columns or {}) and (role != "v" or "x" in chosen):
            if not _is_channel(table[headings[chosen[role]]], table[headings[chosen["x"]]]):
                del chosen[role]
    values = {role: table[headings[k]] for role, k in chosen.items()}
    stored = {role: split_header(headings[k])[1] for role, k in chosen.items()}
    for role, array in values.items():
        if np.size(array) > max_rows:
            raise ValueError(too_long(where, max_rows))
        if role == "t" and (seconds := _as_seconds(array)) is not None:
            values[role], stored[role] = seconds, "s"
    if _scales_by_gtau(table, headings, chosen, columns):
        factor = float(np.ravel(table["gtau"])[0])
        values["u"] = scaled(values["u"], factor)
        stored |= {"t": "s", "u": "N", "x": "m", "reference": "m"}
        stored = {role: unit for role, unit in stored.items() if role in values}
        extra += (f"u = gtau * vir with gtau = {factor:g} N/V",)
        headings = [h for h in headings if h != "gtau"]
    elif not isinstance(source, Mapping) and not raw:
        extra += left_out(headings, chosen)
    return _finished(
        values, stored, gain, units, where, step, timed, extra, name, quantum, raw, masked
    )


def _finished(
    values: dict[str, Any],
    stored: dict[str, str],
    gain: Any,
    units: Any,
    where: str,
    step: float | None,
    timed: bool | None,
    notes: tuple[str, ...],
    name: Any,
    quantum: Any,
    raw: dict[str, tuple[str, float]],
    masked: tuple[str, ...] | None,
) -> Channels:
    """Channels in SI units, with a time of their own where they came without."""
    if "t" in values and timed is False:
        raise ValueError(
            f"{where} has a column of time: leave rate= out, or ignore the column with "
            "columns={'t': None}"
        )
    own = "t" in values
    if step is not None and not own:
        values = {"t": step * np.arange(np.size(values["x" if "x" in values else "v"])), **values}
        notes += (f"time from a step of {step:g} s",)
    values, said = _from_first(values)
    found = to_si(values, stored, gain, units, where)
    # What is known of the source goes with what is done to it now.
    if isinstance(quantum, (int, float)):
        quantum = float(quantum) * abs(found.raw.get("x", ("", 1.0))[1])
    else:
        quantum = None
    for role, (unit, factor) in found.raw.items():
        before = raw.get(role, (unit, 1.0))
        raw = raw | {role: (before[0], before[1] * factor)}
    return Channels(
        found.values,
        found.units,
        notes + said + found.notes,
        name if isinstance(name, str) else None,
        quantum,
        raw,
        own,
        masked,
    )


def _from_first(values: dict[str, Any]) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Whole numbers too large for float64, counted from the first one."""
    out, notes = dict(values), []
    for role in ("t", "x", "x2"):
        array = np.asarray(values.get(role, ()))
        if array.dtype.kind not in "iu" or array.size == 0 or array.ndim != 1:
            continue
        if max(abs(int(array.max())), abs(int(array.min()))) <= _EXACT:
            continue
        origin = int(array[0])
        for one in (role, "reference") if role == "x" else (role,):
            if one in values and (part := np.asarray(values[one])).dtype.kind in "iu":
                out[one] = np.array([int(v) - origin for v in part.ravel()], dtype=np.float64)
                notes.append(f"{one} counted from {origin}")
    return out, tuple(notes)


def _is_channel(values: Any, x: Any) -> bool:
    """Whether values are finite numbers, as many as positions."""
    try:
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        return False
    return array.shape == np.shape(x) and bool(np.isfinite(array).mean() > _SOUND)


def _with_files(table: dict[str, Any], max_rows: int) -> dict[str, Any]:
    """The mapping with the columns of files that hold one channel each."""
    out: dict[str, Any] = {}
    clock: tuple[str, Any] | None = None
    for key, value in table.items():
        if not isinstance(value, (str, os.PathLike)):
            out[key] = value
            continue
        path = existing_file(value)
        heading, parts = read_column(path, max_rows)
        unit = split_header(heading)[1]
        out[key if not unit or split_header(key)[1] else f"{key} [{unit}]"] = parts[-1]
        if len(parts) == 2:
            if clock is not None and not np.array_equal(clock[1], parts[0]):
                raise ValueError(
                    f"{path.name} and {clock[0]} have other time stamps: bring them onto one time "
                    "first, such as with numpy.interp"
                )
            clock = clock or (path.name, parts[0])
    if clock is not None and "t" not in out:
        out["t"] = clock[1]
    return out


def _scales_by_gtau(
    table: Mapping[str, Any], headings: list[str], chosen: Mapping[str, int], columns: Any
) -> bool:
    """True for the EMPS layout, unless the caller names the input himself."""
    return (
        [headings[chosen[role]] for role in ("u", "x") if role in chosen] == ["vir", "qm"]
        and "u" not in (columns or {})
        and "gtau" in table
        and np.size(table["gtau"]) == 1
        and np.asarray(table["gtau"]).dtype.kind in "iuf"
    )


def _unsupported(path: Path) -> str:
    mend = {
        ".json": "read_bam() reads BAM logs, and objects, one a line, are read as .jsonl; "
        "otherwise load it and pass a dict of arrays",
        ".xls": "save it as .xlsx or CSV",
        ".gz": "only text such as run.csv.gz is read compressed; decompress it first",
        ".bag": "convert it to .mcap",
    }.get(path.suffix.lower(), "save it as CSV, or pass a dict of arrays")
    return (
        f"{path.name}: files of type {path.suffix!r} are not read; {mend}. "
        f"Read are {', '.join((*SUFFIXES, '.csv.gz', *_TABLES))} and .mcap"
    )


def _as_seconds(values: Any) -> Any:
    """Date and duration arrays as seconds from the first; None for anything else."""
    array = np.asarray(values)
    if array.dtype.kind == "O" and array.size and isinstance(array.ravel()[0], datetime):
        try:
            array = np.array([(v - array[0]).total_seconds() for v in array], dtype=np.float64)
        except (TypeError, AttributeError, ValueError):
            raise ValueError("t holds dates with and without a time zone, or gaps") from None
        return array
    if array.dtype.kind not in "mM":
        return None
    missing = np.isnat(array)
    if missing.any():
        raise ValueError(
            f"t has {int(missing.sum())} missing times (NaT), the first in row "
            f"{int(np.argmax(missing))}; remove these rows"
        )
    if array.dtype.kind == "M":
        array = array - array.ravel()[:1]
    return array / np.timedelta64(1, "s")


def frame_columns(frame: Any) -> dict[str, Any]:
    """Columns of a data frame; its index too when that carries the time."""
    table: dict[str, Any] = {}
    for k, label in enumerate(frame.columns):
        if str(label) in table:
            raise ValueError(f"the data frame has two columns {str(label)!r}; rename one")
        series = frame.iloc[:, k] if hasattr(frame, "iloc") else frame[label]
        table[str(label)] = _plain(series)
    index = getattr(frame, "index", None)
    if index is not None and not named("t", [split_header(h)[0] for h in table]):
        label = str(index.name) if index.name is not None else "t"
        timed = bool(named("t", [split_header(label)[0]]))
        if label not in table and (index.dtype.kind in "mMf" or (timed and label.lower() != "t")):
            table[label if timed else "t"] = _plain(index)
    return table


def _plain(series: Any) -> Any:
    """Values of a column; dates of any time zone as those of UTC."""
    if getattr(series.dtype, "tz", None) is None:
        return series.to_numpy()
    # A column has its dates under .dt, an index is its dates.
    utc = getattr(series, "dt", series).tz_convert("UTC")
    return getattr(utc, "dt", utc).tz_localize(None).to_numpy()


_TABLES: dict[str, Callable[[Path, int], dict[str, Any]]] = {
    ".npz": read_numpy,
    ".npy": read_numpy,
    ".jsonl": read_json_lines,
    ".ndjson": read_json_lines,
    ".mat": lambda path, _: read_mat(path),
    ".xlsx": lambda path, _: frame_columns(read_xlsx(path)),
    ".parquet": lambda path, max_rows: frame_columns(read_parquet(path, max_rows)),
}
