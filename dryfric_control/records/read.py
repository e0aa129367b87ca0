"""Records from files, data frames and arrays."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from dryfric_control.records.readers.bam_log import read_bam_entries
from dryfric_control.records.readers.channels import MAX_ROWS
from dryfric_control.records.record import Record, record_of
from dryfric_control.records.scaling import Scaling


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
) -> Record:
    """Read a record from a file, data frame or mapping.

    Parameters
    ----------
    source : path-like, DataFrame or mapping
        Delimited text (.csv, .tsv, .txt, .dat, .t, each also with .gz; comma, semicolon, tab or
        blanks; decimal comma unless commas separate; ``#`` and ``%`` comments; with or without
        headings), a MAT-file of version 4 to 7, .xlsx and .parquet (need pandas), .mcap (needs
        the extra ``mcap``), or arrays by name, where a path is a file with this channel alone.
    columns : mapping, optional
        Heading or index for any of ``t``, ``u``, ``x``, ``reference`` and the known
        channels ``v`` (velocity), ``a`` (acceleration), ``x2`` (second encoder); None for
        none. The rest is recognised by usual names; without headings, three or
        four columns are t, u, x, reference in this order. In the EMPS benchmark layout
        (``t``, ``qm``, ``qg``, ``vir``, ``gtau``) u is gtau * vir.
    gain : float, mapping or Scaling
        Factor on ``u``, such as N per V; factors by channel, such as
        ``{"u": 35.0, "x": 1e-6}``, after the conversion to SI; or a `Scaling`: counts per turn,
        gear ratio, torque constant, rated force.
    units : mapping, optional
        Units by channel, where the headings (``x [mm]``, ``time (ms)``, ``u / N``) do
        not state them: as stored, of a channel with a gain after it.
    name : str, optional
        Title; the file's name when left out.
    dt : float, optional
        Resample irregular time stamps to this step [s], see
        `Record.from_irregular`; without a column of time, the sampling step.
    rate : float, optional
        Samples per second of a source without a column of time.
    max_gap : float, optional
        Longest step that `dt` may fill [s], see `Record.from_irregular`.
    unwrap : float, optional
        Encoder period [unit of x], see `Record`.
    max_rows : int
        Longer sources are refused.

    Returns
    -------
    Record
        In SI units; ``record.notes`` lists what was converted and which columns
        were left out, ``record.raw`` the raw units and factors.

    Raises
    ------
    FileNotFoundError, IsADirectoryError
        When the path leads to no file.
    TypeError
        When the source is of another kind.
    ValueError
        For everything wrong inside, with row and column.

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
    return record_of(
        source, columns, gain, units=units, name=name, dt=dt, rate=rate, max_gap=max_gap,
        unwrap=unwrap, max_rows=max_rows,
    )  # fmt: skip


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

    Raises
    ------
    FileNotFoundError, IsADirectoryError
        When the path leads to no file.
    ValueError
        When the file is no such log or its data cannot be used.

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
    head, log = read_bam_entries(path)
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
