"""A record that ships, and a loader of a public one."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

from dryfric_control.arguments import unknown_name
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.model.effects import BiasForce
from dryfric_control.model.friction import CoulombMap
from dryfric_control.records import Record, read_record
from dryfric_control.store.files import existing_file

__all__ = ["belt_stage", "belt_stage_axis", "emps", "emps_axis"]

if not TYPE_CHECKING:  # which would take every name for one of this module

    def __getattr__(name: str) -> object:
        """Say which name is meant by one that is not there."""
        raise AttributeError(unknown_name(__name__, name, __all__))


def belt_stage() -> Record:
    """Record of 8 s of a belt-driven stage, simulated.

    Notes
    -----
    Drive force [N] and position [m] at 500 Hz, encoder of 5 µm, by a time-stepping simulator that
    shares no code with this package.  The machine has what `belt_stage_axis` lacks: a force of the
    belt's teeth of 1.6 N with a period of 5 mm, and friction that is 12 % higher forwards and lower
    backwards.  Noise of 0.1 N acts on the drive.

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> record = dfc.datasets.belt_stage()
    >>> len(record), record.dt
    (4000, 0.002)
    """
    return read_record(Path(__file__).with_name("belt_stage.csv"), name="belt stage")


def belt_stage_axis() -> FrictionAxis:
    """Nominal axis of `belt_stage`.

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> dfc.datasets.belt_stage_axis().mass
    2.4
    """
    return FrictionAxis(mass=2.4, viscous=12.0, coulomb=CoulombMap.of(9.0), name="belt stage")


def emps(path: str | os.PathLike[str]) -> Record:
    """Record of the EMPS benchmark, a linear drive.

    Parameters
    ----------
    path : path-like
        DATA_EMPS.mat, from nonlinearbenchmark.org; it does not ship with this package.

    Notes
    -----
    Drive force [N], position and reference [m] at 1 kHz.  A. Janot, M. Gautier, M. Brunot, "Data
    set and reference models of EMPS", Nonlinear System Identification Benchmarks, 2019.

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> try:
    ...     dfc.datasets.emps("elsewhere/DATA_EMPS.mat")
    ... except FileNotFoundError as problem:
    ...     print(problem)
    there is no file 'elsewhere/DATA_EMPS.mat': download it from nonlinearbenchmark.org
    """
    try:
        record = read_record(existing_file(path), name="EMPS linear drive")
    except FileNotFoundError as err:
        raise FileNotFoundError(f"{err}: download it from nonlinearbenchmark.org") from None
    if record.reference is None or len(record) != 24841:
        raise ValueError(
            f"{path} is not the EMPS record: it has {len(record)} samples, not 24841 with a "
            "reference; use read_record for other files"
        )
    return record


def emps_axis() -> FrictionAxis:
    """Symmetric model that the authors of the EMPS record published.

    Notes
    -----
    M = 95.11 kg, Fv = 203.5 N s/m, Fc = 20.39 N.  The offset of -3.16 N counts as friction
    there; as a force on the axis it is 3.16 N.

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> dfc.datasets.emps_axis().effects[0].force
    3.16
    """
    return FrictionAxis(
        mass=95.11, viscous=203.5, coulomb=CoulombMap.of(20.39),
        effects=(BiasForce(force=3.16),), name="EMPS linear drive",
    )  # fmt: skip
