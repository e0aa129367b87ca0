"""Channels out of a file, a data frame or a mapping of arrays; nothing here judges the data."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping
from contextlib import closing, suppress
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from dryfric_control.checks import describe_value
from dryfric_control.records.clock import epoch_of, rises
from dryfric_control.records.readers import channels
from dryfric_control.records.readers.can_log import CanLog
from dryfric_control.records.readers.channels import Channels, Clues, Wanted
from dryfric_control.records.readers.common_clock import on_position_clock, with_own_clocks
from dryfric_control.records.readers.limits import too_long
from dryfric_control.records.readers.log_file import Channel, LogFile
from dryfric_control.records.readers.mat_file import read_mat
from dryfric_control.records.readers.mcap_log import McapLog
from dryfric_control.records.readers.mdf_file import MdfFile
from dryfric_control.records.readers.ros_bag import RosBag
from dryfric_control.records.readers.tables import read_frame, read_json_lines, read_numpy
from dryfric_control.records.readers.tdms_file import TdmsFile
from dryfric_control.records.readers.text_file import (
    SUFFIXES,
    read_column,
    read_text,
    text_values,
)
from dryfric_control.records.readers.ulog_file import UlogFile
from dryfric_control.records.refusal import RefusalError
from dryfric_control.records.scaling import Gain
from dryfric_control.store.files import existing_file

_LOOKED_AT = 200  # values that show whether a column only rises
_SOUND = 0.8  # part of a channel that must be numbers; those that are not are bridged
#: Units of the EMPS layout, which its file does not have.
_EMPS_UNITS = {"t": "s", "u": "N", "x": "m", "reference": "m"}


def read_channels(
    source: Any, wanted: Wanted, gain: Gain, units: Any, step: float | None
) -> Channels:
    """Channels of a file, data frame or mapping in SI; `step` [s] of one without stamps."""
    most = wanted.max_rows
    if isinstance(most, bool) or not isinstance(most, int) or most < 1:
        raise ValueError(f"max_rows must be a positive whole number, got {most!r}")
    found = _stored_channels(source, wanted)
    found = with_own_clocks(_with_unit_of_time(found, units), wanted.hold)
    if found.clocks:
        found = replace(found, lacking="")
    asked = tuple(role for role, column in (wanted.columns or {}).items() if column is not None)
    found = on_position_clock(found, wanted.hold, asked)
    values = found.values
    notes = found.notes
    own_time = "t" in values
    if own_time and wanted.timed is False:
        raise ValueError(
            f"{found.where} has a column of time: leave rate= out, or ignore the column with "
            "columns={'t': None}"
        )
    if step is not None and not own_time:
        values = {"t": step * np.arange(np.size(values["x" if "x" in values else "v"])), **values}
        notes += (f"time from a step of {step:g} s",)
    values, counted = _from_first(values)
    found = replace(found, values=values, notes=notes + counted, timed=own_time)
    return channels.to_si(found, gain, units)


def _stored_channels(source: Any, wanted: Wanted) -> Channels:
    """Channels of a file, data frame or mapping as it stores them."""
    if isinstance(source, (str, os.PathLike)):
        return _of_file(_bag_or_file(source), wanted)
    if isinstance(source, Mapping):
        table = _with_files({str(k): v for k, v in source.items()}, wanted.max_rows)
        return _select_columns(table, Channels("the mapping"), wanted)
    if _is_frame(source):
        kept = Channels("the data frame")
        if (meta := getattr(source, "attrs", {}).get("dryfric_control")) is not None:
            damaged = "the data frame: attrs['dryfric_control'] is damaged; remove it"
            kept = replace(kept, **channels.own_notes(meta, damaged))
        return _select_columns(frame_columns(source), kept, wanted, listed=not kept.raw)
    raise ValueError(
        "source must be a path, a data frame or a mapping of arrays, got " + describe_value(source)
    )


def _of_file(path: Path, wanted: Wanted) -> Channels:
    """Channels of a file as it stores them."""
    packed = path.suffix.lower() == ".gz"
    inner = Path(path.stem) if packed else path
    suffix = ".db3" if path.is_dir() else inner.suffix.lower()
    start = Channels(path.name, name=inner.stem)
    if suffix in SUFFIXES:
        return read_text(path, start, wanted)
    if packed or suffix not in _TABLES:
        raise ValueError(_unsupported_text(path))
    table = _TABLES[suffix](path, wanted)
    if not isinstance(table, LogFile):
        return _select_columns(table, start, wanted, listed=True)
    with closing(table):
        try:
            return _select_log_channels(table, start, wanted)
        except RefusalError as problem:
            raise RefusalError(f"{problem}{table.hint}", **problem.mend) from None


def _bag_or_file(source: str | os.PathLike[str]) -> Path:
    """The path of a file, or of the folder that a bag of ROS 2 is."""
    if isinstance(source, (str, os.PathLike)) and (Path(source) / "metadata.yaml").is_file():
        return Path(source)
    return existing_file(source)


def _with_unit_of_time(found: Channels, units: Any) -> Channels:
    """Bare stamps that are too large for anything but a count from a date get its unit."""
    stamps = next(iter(found.clocks.values()), found.values.get("t"))
    if found.units.get("t") or (channels.units_by_role(units)).get("t"):
        return found
    epoch = epoch_of(stamps)
    if epoch is None:
        return found
    note = f"t taken as {epoch.words}"
    return replace(found, units={**found.units, "t": epoch.unit}, notes=(*found.notes, note))


def _select_columns(
    table: Mapping[str, Any], start: Channels, wanted: Wanted, listed: bool = False
) -> Channels:
    """The columns of a table that play a role; if listed, the others are noted."""
    headings = list(table)
    named = wanted.columns or {}
    unnamed = all(h.isdigit() for h in headings)  # columns of an array
    known = [""] * len(headings) if unnamed else headings
    chosen = channels.assign_columns(known, wanted, start.where, _clock_clues(table))
    _drop_unusable(chosen, table, headings, named)
    values = {role: table[headings[k]] for role, k in chosen.items()}
    units = {role: channels.split_header(headings[k])[1] for role, k in chosen.items()}
    if not any(map(np.size, values.values())):
        raise ValueError(f"{start.where} holds headings and no data rows")
    for role, array in values.items():
        if np.size(array) > wanted.max_rows:
            raise ValueError(too_long(start.where, wanted.max_rows))
        if role == "t" and (seconds := _as_seconds(array)) is not None:
            values[role], units[role] = seconds, "s"
    found = replace(start, values=values, units=units)
    # The EMPS layout, unless the caller names the input himself.
    gain = None if "u" in named else _emps_gain(table, headings, chosen)
    if gain is not None:
        found = _emps_channels(found, gain)
    elif listed:
        found = replace(found, notes=found.notes + channels.left_out(headings, chosen))
    notes = found.notes + channels.guess_notes(known, chosen, wanted)
    return replace(found, notes=notes, drive=channels.drive_quantity(known, chosen))


def _emps_gain(
    table: Mapping[str, Any], headings: list[str], chosen: dict[str, int]
) -> float | None:
    """Drive gain of a table in the EMPS layout [N/V], None of any other."""
    if [headings[chosen[role]] for role in ("u", "x") if role in chosen] != ["vir", "qm"]:
        return None
    gtau = np.ravel(table.get("gtau", ()))
    return float(gtau[0]) if gtau.size == 1 and gtau.dtype.kind in "iuf" else None


def _emps_channels(found: Channels, gain: float) -> Channels:
    """Channels of the EMPS layout with the force of the drive and their units."""
    values = {**found.values, "u": channels.scale_values(found.values["u"], gain)}
    units = {role: _EMPS_UNITS.get(role, unit) for role, unit in found.units.items()}
    notes = (*found.notes, f"u = gtau * vir with gtau = {gain:g} N/V")
    return replace(found, values=values, units=units, notes=notes)


def _drop_unusable(
    chosen: dict[str, int], table: Mapping[str, Any], headings: list[str], named: Mapping[str, Any]
) -> None:
    """Drop further channels, unless asked for, that are not numbers, one for each sample."""
    for role in (*channels.EXTRAS, "good"):
        if role in chosen and role not in named and (role != "v" or "x" in chosen):
            if not _is_channel(table[headings[chosen[role]]], table[headings[chosen["x"]]]):
                del chosen[role]


def _select_log_channels(log: LogFile, start: Channels, wanted: Wanted) -> Channels:
    """Chosen channels of a log, each with its own clock."""
    headings = log.headings
    named = wanted.columns or {}
    # Each channel has a clock; a channel of time is one only where the caller says so.
    untimed = wanted._replace(timed=None, columns={"t": None, **named})
    chosen = channels.assign_columns(headings, untimed, start.where)
    own = chosen.pop("t", None)
    found: dict[str, Channel] = {role: log[headings[k]] for role, k in chosen.items()}
    found = {role: one for role, one in found.items() if role in named or _is_usable(role, one)}
    chosen = {role: chosen[role] for role in found}
    sent = all(one.sent is not None for one in found.values())
    clocks = {role: one.sent if sent else one.stamps for role, one in found.items()}
    units = {role: channels.split_header(headings[chosen[role]])[1] for role in found}
    units["t"] = "ns" if sent else next(iter(found.values())).unit
    if own is not None and "t" in named:
        clocks = dict.fromkeys(found, _common_time(log, headings[own], found, start.where))
        units["t"] = channels.split_header(headings[own])[1]
    values = {role: one.values for role, one in found.items()}
    notes = start.notes + channels.left_out(headings, chosen)
    notes += channels.guess_notes(headings, chosen, wanted)
    drive = channels.drive_quantity(headings, chosen)
    return replace(start, values=values, units=units, notes=notes, clocks=clocks, drive=drive)


def _common_time(log: LogFile, heading: str, found: dict[str, Channel], where: str) -> Any:
    """Values of a channel of a log that is the time of others, one for each of theirs."""
    times = log[heading].values
    if any(len(one.values) != len(times) for one in found.values()):
        raise ValueError(
            f"{where}: {heading!r} is no time of the other channels, which were "
            "not read with it: leave columns={'t': ...} out, each has a clock of its own"
        )
    return times


def _is_usable(role: str, channel: Channel) -> bool:
    """Whether a channel of a log is one that is needed, or has values that vary."""
    if role == "good":
        return False
    return role not in channels.EXTRAS or len(channel.values) > 1


def _from_first(values: dict[str, Any]) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Whole numbers too large for float64, counted from the first one."""
    out = dict(values)
    notes = []
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


def _unsupported_text(path: Path) -> str:
    mend = {
        ".json": "read_bam() reads BAM logs, and objects, one a line, are read as .jsonl; "
        "otherwise load it and pass a dict of arrays",
        ".xls": "save it as .xlsx or CSV",
        ".gz": "only text such as run.csv.gz is read compressed; decompress it first",
    }.get(path.suffix.lower(), "save it as CSV, or pass a dict of arrays")
    return (
        f"{path.name}: files of type {path.suffix!r} are not read; {mend}. "
        f"Read are {', '.join((*SUFFIXES, '.csv.gz', *_TABLES))}"
    )


def _clock_clues(table: Mapping[str, Any]) -> Clues:
    """What the columns of a table show of clocks; those that are no arrays are told later."""
    arrays = {}
    for k, values in enumerate(table.values()):
        with suppress(ValueError):
            arrays[k] = np.ravel(np.asarray(values))
    return Clues(
        tuple(k for k, one in arrays.items() if _holds_dates(one)),
        tuple(k for k, one in arrays.items() if rises(one[:_LOOKED_AT])),
    )


def _holds_dates(array: Any) -> bool:
    """Whether an array has dates or durations, or counts from a date."""
    if array.dtype.kind == "O":
        return array.size > 0 and isinstance(array[0], datetime)
    return array.dtype.kind in "mM" or epoch_of(array) is not None


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


def _is_frame(source: Any) -> bool:
    """Whether a source is a data frame of pandas or polars, or a table of Arrow."""
    return hasattr(source, "columns") and hasattr(source, "__getitem__")


def frame_columns(frame: Any) -> dict[str, Any]:
    """Columns of a data frame; its index too when that carries the time."""
    arrow = hasattr(frame, "column_names")  # whose `columns` are the columns themselves
    table: dict[str, Any] = {}
    for k, label in enumerate(frame.column_names if arrow else frame.columns):
        # A heading of several levels is a path: ("axis1", "pos").
        heading = ".".join(filter(None, map(str, label))) if type(label) is tuple else str(label)
        if heading in table:
            raise ValueError(f"the data frame has two columns {heading!r}; rename one")
        series = frame.iloc[:, k] if hasattr(frame, "iloc") else frame[k if arrow else label]
        table[heading] = _column_values(series)
    index = getattr(frame, "index", None)
    if index is None or _has_time(table):
        return table
    label = str(index.name) if index.name is not None else "t"
    timed = _has_time([label])
    # Whole numbers without the name of a time count the rows.
    if label not in table and (index.dtype.kind in "mMf" or (timed and label.lower() != "t")):
        table[label if timed else "t"] = _column_values(index)
    return table


def _has_time(headings: Iterable[str]) -> bool:
    """Whether there is a column of time by its name."""
    return bool(channels.columns_by_name("t", [channels.split_header(h)[0] for h in headings]))


def _column_values(series: Any) -> Any:
    """Values of a column; dates of any time zone as those of UTC."""
    try:
        if getattr(getattr(series, "dtype", None), "tz", None) is not None:
            # A column has its dates under .dt, an index is its dates.
            utc = getattr(series, "dt", series).tz_convert("UTC")
            return getattr(utc, "dt", utc).tz_localize(None).to_numpy()
        values = series.to_numpy()
    except ImportError as problem:
        raise ImportError(
            f"a column of this data frame needs {problem.name or 'another library'} to become "
            'numbers: pip install "dryfric-control[tables]"'
        ) from None
    if values.dtype.kind == "O" and getattr(series.dtype, "kind", "") in "iuf":
        return series.to_numpy(dtype=np.float64, na_value=np.nan)  # whole numbers with gaps
    plain = (str, int, float)
    if values.dtype.kind in "OU" and values.size and all(isinstance(v, plain) for v in values):
        found = text_values([str(v) for v in values])
        return values if found is None else found
    return values


_TABLES: dict[str, Callable[[Path, Wanted], Mapping[str, Any]]] = {
    **dict.fromkeys((".npz", ".npy"), read_numpy),
    **dict.fromkeys((".jsonl", ".ndjson"), read_json_lines),
    **dict.fromkeys((".xlsx", ".parquet"), lambda path, w: frame_columns(read_frame(path, w))),
    ".mat": read_mat,
    ".mcap": McapLog,
    **dict.fromkeys((".mf4", ".mdf"), MdfFile),
    ".tdms": TdmsFile,
    **dict.fromkeys((".bag", ".db3"), RosBag),
    **dict.fromkeys((".blf", ".asc", ".trc", ".log"), CanLog),
    ".ulg": UlogFile,
}
