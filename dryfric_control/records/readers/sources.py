"""Channels out of a file, a data frame or a mapping of arrays; nothing here judges the data."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from dryfric_control.records.readers import channels
from dryfric_control.records.readers.array_file import read_json_lines, read_numpy
from dryfric_control.records.readers.channels import Channels
from dryfric_control.records.readers.limits import too_long
from dryfric_control.records.readers.mat_file import read_mat
from dryfric_control.records.readers.mcap_log import read_mcap
from dryfric_control.records.readers.tables import read_parquet, read_xlsx
from dryfric_control.records.readers.text_file import SUFFIXES, read_column, read_text
from dryfric_control.records.scaling import Scaling
from dryfric_control.store.files import existing_file

_SOUND = 0.8  # part of a channel that must be numbers; those that are not are bridged


def read_channels(
    source: Any,
    columns: Mapping[str, str | int | None] | None = None,
    gain: float | Mapping[str, float] | Scaling = 1.0,
    units: Mapping[str, str] | None = None,
    max_rows: int = channels.MAX_ROWS,
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
    if isinstance(source, (str, os.PathLike)):
        found = _of_file(existing_file(source), columns, max_rows, timed, step is not None, joint)
    elif isinstance(source, Mapping):
        table = _with_files({str(k): v for k, v in source.items()}, max_rows)
        found = _selected(table, Channels("the mapping"), columns, max_rows, timed, joint)
    elif hasattr(source, "columns") and hasattr(source, "__getitem__"):
        kept = _kept_in(source)
        listed = not kept.raw
        found = _selected(frame_columns(source), kept, columns, max_rows, timed, joint, listed)
    else:
        raise TypeError(
            "read_record takes a path, a data frame or a mapping of arrays, "
            f"got {type(source).__name__}"
        )
    values, notes = found.values, found.notes
    if "t" in values and timed is False:
        raise ValueError(
            f"{found.where} has a column of time: leave rate= out, or ignore the column with "
            "columns={'t': None}"
        )
    own_time = "t" in values
    if step is not None and not own_time:
        values = {"t": step * np.arange(np.size(values["x" if "x" in values else "v"])), **values}
        notes += (f"time from a step of {step:g} s",)
    values, counted = _from_first(values)
    found = replace(found, values=values, notes=notes + counted, timed=own_time)
    return channels.to_si(found, gain, units)


def _of_file(
    path: Path, columns: Any, max_rows: int, timed: bool | None, lenient: bool, joint: Any
) -> Channels:
    """Channels of a file as it stores them."""
    packed = path.suffix.lower() == ".gz"
    inner = Path(path.stem) if packed else path
    suffix = inner.suffix.lower()
    start = Channels(path.name, name=inner.stem)
    if suffix in SUFFIXES:
        return read_text(path, start, columns, max_rows, timed, lenient, joint)
    if packed or suffix not in (".mcap", *_TABLES):
        raise ValueError(_unsupported(path))
    if suffix == ".mcap":
        table = read_mcap(path, columns, max_rows, joint)
    else:
        table = _TABLES[suffix](path, max_rows)
    return _selected(table, start, columns, max_rows, timed, joint, listed=True)


def _kept_in(frame: Any) -> Channels:
    """What `Record.to_pandas` left in a data frame beside its columns."""
    kept = getattr(frame, "attrs", {}).get("dryfric_control")
    if not isinstance(kept, Mapping):
        return Channels("the data frame")
    name, quantum = kept.get("name"), kept.get("quantum")
    return Channels(
        "the data frame",
        notes=tuple(kept["notes"]),
        name=name if isinstance(name, str) else None,
        quantum=float(quantum) if isinstance(quantum, (int, float)) else None,
        raw=dict(kept.get("raw", {})),
        masked=tuple(kept["masked"]) if "masked" in kept else None,
    )


def _selected(
    table: Mapping[str, Any],
    start: Channels,
    columns: Any,
    max_rows: int,
    timed: bool | None,
    joint: Any,
    listed: bool = False,
) -> Channels:
    """The columns of a table that play a role; if listed, the others are noted."""
    headings = list(table)
    unnamed = all(h.isdigit() for h in headings)  # columns of an array
    known = [""] * len(headings) if unnamed else headings
    chosen = channels.assign_columns(known, columns, start.where, timed, joint)
    for role in (*channels.EXTRAS, "good"):  # kept where they are numbers, one for each sample
        if role in chosen and role not in (columns or {}) and (role != "v" or "x" in chosen):
            if not _is_channel(table[headings[chosen[role]]], table[headings[chosen["x"]]]):
                del chosen[role]
    values = {role: table[headings[k]] for role, k in chosen.items()}
    units = {role: channels.split_header(headings[k])[1] for role, k in chosen.items()}
    for role, array in values.items():
        if np.size(array) > max_rows:
            raise ValueError(too_long(start.where, max_rows))
        if role == "t" and (seconds := _as_seconds(array)) is not None:
            values[role], units[role] = seconds, "s"
    notes = start.notes
    if _scales_by_gtau(table, headings, chosen, columns):
        factor = float(np.ravel(table["gtau"])[0])
        values["u"] = channels.scaled(values["u"], factor)
        usual = {"t": "s", "u": "N", "x": "m", "reference": "m"}
        units = {role: usual.get(role, unit) for role, unit in units.items()}
        notes += (f"u = gtau * vir with gtau = {factor:g} N/V",)
    elif listed:
        notes += channels.left_out(headings, chosen)
    return replace(start, values=values, units=units, notes=notes)


def _from_first(values: dict[str, Any]) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Whole numbers too large for float64, counted from the first one."""
    out, notes = dict(values), []
    for role in ("t", "x", "x2"):
        array = np.asarray(values.get(role, ()))
        if array.dtype.kind not in "iu" or array.size == 0 or array.ndim != 1:
            continue
        if max(abs(int(array.max())), abs(int(array.min()))) <= channels.EXACT:
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
        unit = channels.split_header(heading)[1]
        out[key if not unit or channels.split_header(key)[1] else f"{key} [{unit}]"] = parts[-1]
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
    if index is not None and not channels.named("t", [channels.split_header(h)[0] for h in table]):
        label = str(index.name) if index.name is not None else "t"
        timed = bool(channels.named("t", [channels.split_header(label)[0]]))
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
