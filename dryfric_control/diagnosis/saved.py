"""Diagnoses read back from files."""

from __future__ import annotations

import os

from dryfric_control.diagnosis.experiment import Experiment
from dryfric_control.diagnosis.remaining import Remaining
from dryfric_control.diagnosis.report.diagnosis import Diagnosis
from dryfric_control.diagnosis.report.findings import Cause, Gain, Unexplained
from dryfric_control.records.saved import load_object

SAVED = (Diagnosis, Cause, Gain, Unexplained, Remaining, Experiment)


def load_diagnosis(path: str | os.PathLike[str]) -> Diagnosis:
    """Read a diagnosis back as it was.

    Parameters
    ----------
    path : path-like
        File written by `Diagnosis.save`.

    Returns
    -------
    Diagnosis

    Raises
    ------
    ValueError
        If the file is no diagnosis, of another version, or was changed.
    OSError
        If the file cannot be read.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import numpy as np
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    >>> t = 1e-3 * np.arange(6000)
    >>> u = 20.0 * np.sin(6.0 * t) + 12.0 * np.sin(17.0 * t + 1.0)
    >>> found = dfc.diagnose(axis, dfc.Record(t, u, axis.simulate(u, dt=1e-3).y[0]))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     found.save(pathlib.Path(folder, "diagnosis.json"))
    ...     again = dfc.load_diagnosis(pathlib.Path(folder, "diagnosis.json"))
    >>> again.verdict, again.summary() == found.summary()
    ('nothing to find', True)
    """
    found: Diagnosis = load_object(path, "diagnosis", 1, SAVED)
    return found
