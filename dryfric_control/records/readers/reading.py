"""From a source to a record: what is read, brought to one clock, and all that stands in the way."""

from __future__ import annotations

import json
import os
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from dryfric_control.checks import one_of, positive
from dryfric_control.records.clock import even_clock
from dryfric_control.records.readers.channels import EXTRAS, MAX_ROWS, Channels, Wanted
from dryfric_control.records.readers.sources import read_channels
from dryfric_control.records.record_warning import warn
from dryfric_control.records.refusal import RefusalError
from dryfric_control.records.scaling import Gain, Scaling
from dryfric_control.units import usual_units

# Arguments that need not be said.
_USUAL = (("max_rows", MAX_ROWS), ("hold", "zero"))
# Reasons that are looked for before all are told.
_MOST_REASONS = 8


def read_as(
    record: Any,
    source: Any,
    columns: Mapping[str, str | int | None] | None = None,
    gain: Gain = 1.0,
    **options: Any,
) -> Any:
    """A record, of the class `record`, from a source; arguments as in `read_record`.

    Where the source is refused, what else would be refused with that mended is looked for, and all
    is told at once, with one line that reads the source.
    """
    try:
        return _read(record, source, columns, gain, **options)
    except RefusalError as problem:
        said = str(problem)
        reasons = [said]
        mend = problem.mend
    given = {"columns": columns, **options}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        while len(reasons) < _MOST_REASONS and mend and ... not in _plain_values(mend):
            given = _merge_options(given, mend)
            try:
                _read(record, source, gain=gain, **given)
                mend = {}
            except RefusalError as problem:
                if str(problem) in reasons:
                    break
                reasons.append(str(problem))
                mend = problem.mend
            except ValueError as problem:
                reasons.append(str(problem))
                mend = {}
    mended = _merge_options(given, mend)
    line = f"Read it by {_line(source, mended, gain)}"
    if len(reasons) == 1:
        only = RefusalError(said, **mend)
        if mended == {"columns": columns, **options}:  # a mend beyond the arguments has no line
            raise only
        raise only.with_line(f"{said.removesuffix('.')}. {line}", mended)
    listed = "".join(f"\n  {k}. {reason}" for k, reason in enumerate(reasons, 1))
    all_of_them = RefusalError(f"not read as it is, for {len(reasons)} reasons:{listed}")
    raise all_of_them.with_line(f"{all_of_them.reasons}\n{line}", mended)


def _read(
    record: Any,
    source: Any,
    columns: Mapping[str, str | int | None] | None = None,
    gain: Gain = 1.0,
    *,
    units: Mapping[str, str] | None = None,
    name: str | None = None,
    dt: float | None = None,
    rate: float | None = None,
    max_gap: float | None = None,
    unwrap: float | None = None,
    max_rows: int,
    joint: str | int | None = None,
    hold: str = "zero",
    database: Any = None,
) -> Any:
    """A record from a source, or the first reason against it."""
    _check_options(dt, rate, max_gap, hold, database)
    step = _stated_step(dt, rate)
    timed = _needs_time(dt, rate)
    wanted = Wanted(columns, joint, timed, step is not None, max_rows, hold, database)
    found = _on_even_clock(read_channels(source, wanted, gain, units, step))
    values: dict[str, Any] = {"u": None, "x": None, **found.values}
    if found.lacking and not wanted.lenient:
        raise RefusalError(found.lacking, dt=_usual_step(values["t"]))
    if values["x"] is None:
        found = _without_position(found, wanted)
    options = {**_record_options(found, values, name), "unwrap": unwrap}
    try:
        gaps = step is not None and any(map(_has_gaps, values.values()))
        if gaps or (dt is not None and found.timed):
            return record.from_irregular(**values, dt=step, max_gap=max_gap, hold=hold, **options)
        made = record(**values, **options)
    except ValueError as problem:
        if not isinstance(source, (str, os.PathLike)):
            raise
        mend = problem.mend if isinstance(problem, RefusalError) else {}
        raise RefusalError(f"{Path(source).name}: {problem}", **mend) from None
    if found.masked and len(found.masked) == len(made.masked.reasons):
        return made._with_changes(masked=made.masked._replace(reasons=found.masked))
    return made


def _check_options(
    dt: float | None, rate: float | None, max_gap: float | None, hold: str, database: Any
) -> None:
    """Refuse arguments of no use, or that exclude one another."""
    if rate is not None and dt is not None:
        raise ValueError(
            "rate and dt are both given: rate is for a source without a column of time"
        )
    if max_gap is not None and dt is None:
        raise ValueError("max_gap is for resampling: give dt= too")
    one_of("hold", hold, ("zero", "first"))
    if database is not None and not isinstance(database, (str, os.PathLike, list, tuple)):
        raise ValueError(f"database must be the path of a DBC or an EDS, got {database!r}")


def _without_position(found: Channels, wanted: Wanted) -> Channels:
    """Channels with a doubt about the velocity as a note; warns unless the caller asked for it."""
    doubt = _velocity_doubt(found)
    if "x" not in (wanted.columns or {}):
        where = found.name or "the source"
        behind = f"; {doubt}" if doubt else ""
        warn(f"{where} has no position: it is the integral of the velocity{behind}")
    return replace(found, notes=(*found.notes, doubt)) if doubt else found


def _velocity_doubt(found: Channels) -> str:
    """What is taken for the unit of a velocity that makes the position, if nobody stated it."""
    if "v" not in found.values or "v" in found.units:
        return ""
    length = usual_units(found.units)[0]
    return f'v has no unit: taken in {length}/s; give it, units={{"v": "rpm"}} for example'


def _needs_time(dt: float | None, rate: float | None) -> bool | None:
    """Whether a source must have a column of time; None where it may have one."""
    if rate is not None:
        return False
    return True if dt is None else None


def _stated_step(dt: float | None, rate: float | None) -> float | None:
    """Sampling time that the arguments state, if they do."""
    if rate is not None:
        return 1.0 / positive("rate", rate)
    return None if dt is None else positive("dt", dt)


def _record_options(found: Channels, values: dict[str, Any], name: str | None) -> dict[str, Any]:
    """Arguments of a record beside its channels; what becomes one is taken from the values."""
    good = values.pop("good", None)
    kept = ("units", "notes", "quantum", "raw")
    options: dict[str, Any] = {field: getattr(found, field) for field in kept}
    options["name"] = found.name if name is None else name
    options["channels"] = {role: values.pop(role) for role in EXTRAS if role in values}
    if good is not None or found.masked is not None:
        options["good"] = np.ones(np.size(values["t"]), bool) if good is None else good != 0
    return options


def _on_even_clock(found: Channels) -> Channels:
    """Channels with coarse stamps put on the even clock behind them."""
    t = np.asarray(found.values["t"])
    if not found.timed or t.dtype.kind != "f" or (even := even_clock(t.astype(np.float64))) is None:
        return found
    return replace(found, values={**found.values, "t": even.t}, notes=(*found.notes, even.note))


def _usual_step(t: Any) -> Any:
    """Step that most rows have, ... if there is none."""
    steps = np.diff(np.asarray(t, dtype=np.float64))
    steps = steps[np.isfinite(steps) & (steps > 0.0)]
    return float(f"{np.median(steps):.3g}") if steps.size else ...


def _has_gaps(values: Any) -> bool:
    """Whether some of the numbers are missing."""
    if np.ma.is_masked(values):
        return True
    array = np.asarray(values if values is not None else ())
    return array.dtype.kind == "f" and not np.isfinite(array).all()


def _plain_values(mend: Mapping[str, Any]) -> list[Any]:
    """Values of arguments, those within mappings too."""
    inner = [list(v.values()) if isinstance(v, Mapping) else [v] for v in mend.values()]
    return [value for values in inner for value in values]


def _merge_options(given: Mapping[str, Any], mend: Mapping[str, Any]) -> dict[str, Any]:
    """Arguments with more of them; what is told by channel is added."""
    out = dict(given)
    for key, value in mend.items():
        out[key] = {**(out.get(key) or {}), **value} if isinstance(value, Mapping) else value
    return out


def _line(source: Any, given: Mapping[str, Any], gain: Gain) -> str:
    """A call of `read_record` to copy."""
    first = _argument_text(source) if isinstance(source, (str, os.PathLike)) else "source"
    usual = isinstance(gain, (float, Scaling)) and gain in (1.0, Scaling())
    return call_text("read_record", [first], {**given, "gain": None if usual else gain})


def call_text(function: str, first: Sequence[str], arguments: Mapping[str, Any]) -> str:
    """A call to copy: without the arguments that are None or usual."""
    words = [*first]
    for key, value in arguments.items():
        if value is not None and (key, value) not in _USUAL:
            words.append(f"{key}={_argument_text(value)}")
    return f"{function}({', '.join(words)})"


def _argument_text(value: Any) -> str:
    """An argument as one types it."""
    if value is ...:
        return "..."
    if isinstance(value, (str, os.PathLike)):
        return json.dumps(os.fspath(value), ensure_ascii=False)
    if isinstance(value, Mapping):
        return (
            "{"
            + ", ".join(f"{_argument_text(k)}: {_argument_text(v)}" for k, v in value.items())
            + "}"
        )
    return repr(value)
