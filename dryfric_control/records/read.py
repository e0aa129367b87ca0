"""Records from files, data frames and arrays."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dryfric_control.checks import instance
from dryfric_control.records.readers.channels import MAX_ROWS
from dryfric_control.records.readers.reading import read_as
from dryfric_control.records.record import Record
from dryfric_control.records.record_arguments import reading_arguments
from dryfric_control.records.record_checks import vector
from dryfric_control.records.scaling import Scaling
from dryfric_control.store.files import read_json

_BAM_FULL_DUTY = 885.0  # `load` at 100 % PWM duty of the XL330
_BAM_KEYS = "timestamp position goal_position load input_volts temp torque_enable".split()


@reading_arguments
def read_record(
    source: str | os.PathLike[str] | Mapping[str, Any] | Any,
    columns: Mapping[str, str | int | None] | None = None,
    gain: float | Mapping[str, float] | Scaling = 1.0,
    *,
    units: Mapping[str, str] | None = None,
    name: str | None = None,
    dt: float | None = None,
    rate: float | None = None,
    max_gap: float | None = None,
    unwrap: float | None = None,
    max_rows: int = MAX_ROWS,
    joint: str | int | None = None,
    hold: str = "zero",
    database: str | os.PathLike[str] | Sequence[str | os.PathLike[str]] | None = None,
) -> Record:
    """Read a record from a file, data frame or mapping.

    Parameters
    ----------
    source : path-like, DataFrame or mapping
        Delimited text (.csv, .tsv, .txt, .dat, .t, each also with .gz; comma, semicolon, tab or
        blanks; decimal comma unless commas separate; ``#`` and ``%`` comments; with or without
        headings; UTF-8 or UTF-16; exports of TwinCAT Scope), a MAT-file of version 4 to 7, .npz,
        .npy, .jsonl (an object a line), or arrays by name, where a path is a file with this channel
        alone. With extras: .xlsx and .parquet (``tables``), a MAT-file of version 7.3 (``mat73``),
        .mf4 and .mdf (``mdf``), .tdms (``tdms``), .mcap (``mcap``), .bag, .db3 or the folder of a
        bag (``ros``), .blf, .asc, .trc and .log of a CAN bus (``can``), .ulg (``ulog``).
    columns : mapping, optional
        Heading or index for any of ``t``, ``u``, ``x``, ``reference`` and the known channels ``v``
        (velocity), ``a`` (acceleration), ``x2`` (second encoder), ``good`` (0 where x may not be
        used); None for none: ``u`` is then 0, ``x`` the integral of ``v``. The rest is recognised
        by usual names; without headings, three or four columns are t, u, x, reference. In the EMPS
        benchmark layout (``t``, ``qm``, ``qg``, ``vir``, ``gtau``) u is gtau * vir.
    gain : float, mapping or Scaling
        Factor on ``u``, such as N per V; factors by channel, such as ``{"u": 35.0, "x": 1e-6}``; or
        the numbers of the machine. A factor converts the number in the file, and a unit in the
        heading then only labels it (-1 turns the sign and keeps the unit).
    units : mapping, optional
        Units by channel, where the headings (``x [mm]``, ``time (ms)``, ``u / N``) do not state
        them: as stored, of a channel with a gain after it.
    name : str, optional
        Title; the file's name when left out.
    dt : float, optional
        Resample irregular time stamps to this step [s], see `Record.from_irregular`; without a
        column of time, the step. Rows lost, with a stamp twice or without a number are masked.
    rate : float, optional
        Samples per second of a source without a column of time.
    max_gap : float, optional
        Longest step that `dt` may fill [s].
    unwrap : float, optional
        Encoder period [unit of x].
    max_rows : int
        Longer sources are refused.
    joint : str or int, optional
        Joint of a log of several, by its name or number in the headings, such as ``"elbow"`` of
        ``position.elbow`` or 3 of ``q3``.
    hold : {"zero", "first"}
        How the input runs between its own stamps, where it comes to those of the position: held,
        or along straight lines. The position is never resampled, unless `dt` asks for it.
    database : path-like or sequence of them, optional
        What the frames of a CAN log hold: a DBC, or the EDS or DCF of a drive of CiA 402.

    Returns
    -------
    Record
        In SI units; ``record.notes`` lists what was converted and which columns
        were left out, ``record.raw`` the raw units and factors.

    Raises
    ------
    ValueError
        For everything wrong inside, with row and column: all reasons at once, and the call that
        reads the source, where arguments can mend it.
    ImportError
        Where a file needs an extra, with the line to type.

    Examples
    --------
    >>> import numpy as np
    >>> import dryfric_control as dfc
    >>> t = np.arange(0, 2000.0)
    >>> record = dfc.read_record({"time [ms]": t, "force": np.cos(t), "pos [mm]": np.sin(t / 99)})
    >>> record.dt, dict(record.units)
    (0.001, {'t': 's', 'x': 'm'})
    >>> record.notes
    ('t converted from ms to s', 'x converted from mm to m')
    """
    return read_as(
        Record, source, columns, gain, units=units, name=name, dt=dt, rate=rate, max_gap=max_gap,
        unwrap=unwrap, max_rows=max_rows, joint=joint, hold=hold, database=database,
    )  # fmt: skip


#: Under the name beside `read_record`.
load_record = Record.load


#: What functions take in place of a record: the path of its file.
RecordLike = Record | str | os.PathLike[str]


def as_record(record: Any, name: str = "record") -> Record:
    """A record, or the one that a path names, read with the headings' own units."""
    if isinstance(record, (str, os.PathLike)):
        return read_record(record)
    instance(name, record, Record, 'or the path of its file, such as "run.csv"')
    return record


def read_bam(path: str | os.PathLike[str], dt: float | None = None) -> dict[str, Any]:
    """Read a servo log of the BAM project (JSON).

    Parameters
    ----------
    path : path-like
        Log of an XL330 servo that drives a pendulum.
    dt : float, optional
        Step of the uniform record [s]; the median step when left out.

    Returns
    -------
    dict
        ``record``: `Record` with u = duty * supply [V] and x [rad], 0 hanging;
        ``volts`` [V], ``temperature`` [deg C] and ``torque_enable`` (bool), each shape (n,), held
        onto the record's time; and the head of the log: ``mass`` [kg], ``length`` [m], ``kp``,
        ``vin`` [V], ``motor``, ``trajectory``.

    Notes
    -----
    The torque is kt/R u - kt^2/R v. Where ``torque_enable`` is false there is neither, not even
    the second term: leave these samples out of a fit, or treat them as a passive pendulum.
    Time stamps 3.5 to 7 ms apart are resampled, see `Record.from_irregular`.

    Examples
    --------
    A log as the project writes it, here one that is made up:

    >>> import json, math, pathlib, tempfile
    >>> import dryfric_control as dfc
    >>> entries = [
    ...     {"timestamp": 5e-3 * k, "position": math.sin(0.02 * k), "speed": 0.0,
    ...      "goal_position": 0.0, "load": 177 + k % 2, "input_volts": 5.0, "temp": 30.0,
    ...      "torque_enable": True}
    ...     for k in range(400)
    ... ]
    >>> head = {"mass": 0.1, "length": 0.15, "kp": 100, "vin": 5.0, "motor": "xl330",
    ...         "trajectory": "sin"}
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "log.json")
    ...     _ = path.write_text(json.dumps(head | {"entries": entries}))
    ...     log = dfc.read_bam(path, dt=5e-3)
    >>> log["kp"], len(log["record"]), float(log["record"].u[0])
    (100, 400, 1.0)
    """
    head, log = _bam_entries(path)
    log = {key: vector(key, values) for key, values in log.items()}
    enabled = log["torque_enable"] != 0
    record = Record.from_irregular(
        log["timestamp"],
        np.where(enabled, log["duty"] * log["input_volts"], 0.0),
        log["position"],
        log["goal_position"],
        dt=dt,
        units={"u": "V", "x": "rad"},
        name=Path(path).stem,
        notes=("u = PWM duty * supply voltage",),
    )
    held = np.searchsorted(log["timestamp"], record.t + 1e-6 * record.dt, side="right") - 1
    return {
        **head,
        "record": record,
        "volts": log["input_volts"][held],
        "temperature": log["temp"][held],
        "torque_enable": enabled[held],
    }


def _bam_entries(path: str | os.PathLike[str]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Head and columns of a BAM servo log (JSON): signed ``duty`` for `load`, else as stored."""
    content = read_json(path)
    entries = content.get("entries") if isinstance(content, dict) else None
    if not isinstance(entries, list) or not entries:
        raise ValueError(f"{path} is no BAM log: it has no list `entries`")
    columns: dict[str, Any] = {}
    for key in _BAM_KEYS:
        values = [e.get(key) if isinstance(e, dict) else None for e in entries]
        bad = next((k for k, v in enumerate(values) if not isinstance(v, (int, float))), None)
        if bad is not None:
            raise ValueError(
                f"{path}: entry {bad} has {key} = {str(values[bad])[:40]}, not a number"
            )
        try:
            columns[key] = np.array(values, dtype=float)
        except OverflowError as err:
            raise ValueError(f"{path}: {key} holds a number that is too large") from err
    load = columns.pop("load")  # unsigned 16 bit on the wire
    columns["duty"] = np.where(load > 32767, load - 65536, load) / _BAM_FULL_DUTY
    return {k: v for k, v in content.items() if k != "entries"}, columns
