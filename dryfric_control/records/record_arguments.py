"""What a call lacks or misnames around a record, told with what to type."""

from __future__ import annotations

import inspect
import os
from collections.abc import Callable
from dataclasses import fields
from functools import wraps
from typing import Any, ParamSpec, TypeVar

from dryfric_control.arguments import function_with_hints
from dryfric_control.records.record import Record
from dryfric_control.records.scaling import Scaling

P = ParamSpec("P")
R = TypeVar("R")

#: How to give an axis, where something else stands in its place.
HOW_TO_GIVE = "it comes first; dfc.axis_from(record) or dfc.read_axis(file) makes one"
# What users call an argument of `read_record`, in lower case, and what it is here.
_UNITS = 'units={"x": "mm"}, the unit of each channel as it is stored'
_GAIN = 'gain={"u": 35.0}, the factor on each channel'
_COLUMNS = 'columns={"t": "time", "u": "force", "x": "position"}, with the headings of the file'
_ARRAYS = _COLUMNS + "; arrays make dfc.Record(t, u, x)"
_RATE, _STEP = "rate=1000.0, the samples per second", "dt=1e-3, the step [s]"
_LAYOUT = (
    "the file alone, whose layout is recognised, or pandas.read_csv(...), a data frame, in its "
    "place"
)
_MEANT = {
    **dict.fromkeys(("unit", "x_unit", "u_unit", "t_unit", "unit_x", "unit_u"), _UNITS),
    **dict.fromkeys(("scale", "scales", "factor", "factors", "gains", "sign"), _GAIN),
    "scaling": "gain=dfc.Scaling(...), the numbers of the machine",
    **dict.fromkeys(("column", "cols", "col", "usecols", "names", "headings", "header"), _COLUMNS),
    **dict.fromkeys(("t", "u", "x", "time", "force", "position", "torque", "angle"), _ARRAYS),
    **dict.fromkeys(("fs", "sample_rate", "sampling_rate", "frequency", "freq", "hz"), _RATE),
    **dict.fromkeys(("ts", "sampling_time", "sample_time", "step", "period"), _STEP),
    **dict.fromkeys(("sep", "delimiter", "decimal", "encoding", "comment", "skiprows"), _LAYOUT),
    **dict.fromkeys(("sheet", "sheet_name"), "pandas.read_excel(...), a data frame, in its place"),
    **dict.fromkeys(("file", "path", "filename"), 'the file first, read_record("run.csv")'),
    **dict.fromkeys(("title", "label"), 'name="run 3"'),
}


def reading_arguments(read: Callable[P, R]) -> Callable[P, R]:
    """Let a reader of records name the right argument for a wrong one."""

    def meant(name: str) -> str:
        if name in {item.name for item in fields(Scaling)}:
            return f"gain=dfc.Scaling({name}=...)"
        return _MEANT.get(name, "")

    _OF_READING.update(inspect.signature(read).parameters)
    found: Callable[P, R] = function_with_hints(read, meant=meant)
    return found


_OF_READING: set[str] = set()


def reading_hint(name: str) -> str:
    """What to give for an argument of a reader where a record, or the path of one, is taken."""
    if name not in _OF_READING:
        return ""
    return f'the record as it is read with it, dfc.read_record("run.csv", {name}=...)'


def record_hint(name: str) -> str:
    """What to give for an argument that a `Record` does not have."""
    if name in ("rate", "fs", "dt", "ts"):
        return "t=, the time of each sample [s], such as dt * numpy.arange(len(x))"
    return ""


def axis_first(function: Callable[P, R]) -> Callable[P, R]:
    """Let a function of an axis and its record say what to type where one of the two lacks."""

    @wraps(function)
    def call_checked(*args: P.args, **given: P.kwargs) -> R:
        there = dict(zip(("axis", "record"), args, strict=False)) | given
        if len(there.keys() & {"axis", "record"}) == 1:
            raise TypeError(_lacking_message(function.__name__, there))
        return function(*args, **given)

    return call_checked


def _lacking_message(function: str, there: dict[str, Any]) -> str:
    """Message for a call with an axis or a record alone."""
    alone = there.get("axis", there.get("record"))
    if "axis" in there and not isinstance(alone, (Record, str, os.PathLike, list, tuple)):
        return f'{function}(axis, record) lacks the record: dfc.{function}(axis, "run.csv")'
    one = "record"
    first = "record[0]" if isinstance(alone, (list, tuple)) else "record"
    if isinstance(alone, (str, os.PathLike)):
        one = first = repr(os.fspath(alone))
    return (
        f"{function}(axis, record) takes the axis first, then the record: "
        f"dfc.{function}(dfc.axis_from({first}), {one}) begins with mass and friction that the "
        "record shows, dfc.FrictionAxis(...) with what you know"
    )
