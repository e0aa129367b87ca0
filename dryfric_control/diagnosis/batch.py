"""Diagnose many records of one axis, and keep what is finished."""

from __future__ import annotations

import functools
import os
from collections.abc import Mapping, Sequence
from typing import Any

from dryfric_control._version import __version__
from dryfric_control.checks import instance
from dryfric_control.diagnosis.diagnose import diagnose
from dryfric_control.estimation.windows import cut
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.records.record import Record
from dryfric_control.store.batch import fingerprint, run_batch


def diagnose_batch(
    axis: FrictionAxis,
    records: Mapping[str, Record] | Sequence[Record],
    *,
    window: float = 0.25,
    hold: str = "zero",
    store: str | os.PathLike[str] | None = None,
    jobs: int | None = None,
    progress: bool = True,
) -> dict[Any, dict[str, Any]]:
    """Diagnose many records of one axis, resumable.

    Parameters
    ----------
    axis : FrictionAxis
        The axis as believed.
    records : mapping of str to Record, or sequence of Record
        The measured records by name; those of a sequence are numbered from 0.
    window : float, optional
        Length of the free runs [s].
    hold : {"zero", "first"}, optional
        Whether the recorded inputs are held or run linearly between samples.
    store : path-like, optional
        File that keeps each finished record, see `run_batch`.
    jobs : int, optional
        Records at the same time, -1 for one on each core.  Default: what
        `joblib.parallel_config` says, else one.
    progress : bool, optional
        Whether to show a progress bar.

    Returns
    -------
    dict
        `Diagnosis.to_dict` of each record, by its name or number.

    Raises
    ------
    ValueError
        If an argument is out of its range, a record cannot be diagnosed (named in
        a note), or the store is of another axis, window, hold or version.

    Notes
    -----
    A store tells records by their name and their data: one that was measured
    anew under an old name is diagnosed anew.

    Examples
    --------
    >>> import numpy as np
    >>> import dryfric_control as dfc
    >>> believed = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    >>> machine = believed.replace(effects=(dfc.effects.InputGain(gain=1.2),))
    >>> t = 1e-3 * np.arange(6000)
    >>> u = 20.0 * np.sin(6.0 * t) + 12.0 * np.sin(17.0 * t + 1.0)
    >>> x = 1e-6 * np.round(1e6 * machine.simulate(u, dt=1e-3).y[0])
    >>> found = dfc.diagnose_batch(believed, {"monday": dfc.Record(t, u, x)}, progress=False)
    >>> [cause["effect"] for cause in found["monday"]["causes"]]
    ['input_gain']
    """
    instance("axis", axis, FrictionAxis)
    if not isinstance(records, (Mapping, list, tuple)):
        raise ValueError(
            f"records must be a mapping of names to Record, or a list of Record, got {records!r}"
        )
    named = records.items() if isinstance(records, Mapping) else enumerate(records)
    cases: dict[Any, Record] = {}
    for name, record in named:
        instance(f"records[{name!r}]", record, Record, "see dfc.read_record")
        try:
            cut(record, window, hold)
        except ValueError as problem:
            problem.add_note(f"in records[{name!r}]")
            raise
        data = fingerprint(record.t, record.u, record.x, record.reference, record.quantum)
        cases[name, data] = record
    found = run_batch(
        functools.partial(_found, axis, window, hold),
        cases,
        store=store,
        settings={
            "task": "diagnose",
            "version": __version__,
            "axis": fingerprint(axis),
            "window": float(window),
            "hold": hold,
        },
        jobs=jobs,
        progress=progress,
    )
    return {name: result for (name, _), result in found.items()}


def _found(axis: FrictionAxis, window: float, hold: str, record: Record) -> dict[str, Any]:
    # The records are what runs at the same time.
    return diagnose(axis, record, window=window, hold=hold, jobs=1).to_dict()
