"""Compensations as text files: JSON, versioned, checked when read."""

from __future__ import annotations

import math
import os
from typing import Any

from dryfric_control.checks import finite, positive, whole
from dryfric_control.compensation.design import (
    KIND,
    MAY_BE_ZERO,
    POSITIVE,
    VERSION,
    Compensation,
    certified,
)
from dryfric_control.compensation.tuning import LAWS
from dryfric_control.observer.certificate import CertificateError
from dryfric_control.observer.storage import design_of
from dryfric_control.store.axis_file import axis_from_dict
from dryfric_control.store.files import load_document
from dryfric_control.text import plain_data


def load_compensation(path: str | os.PathLike[str]) -> Compensation:
    """Read a compensation back and check its certificate.

    Parameters
    ----------
    path : str or path
        File written by `Compensation.save`.

    Returns
    -------
    Compensation
        Its certificate is computed anew from the numbers in the file.

    Raises
    ------
    ValueError
        If the file is no compensation, is damaged, newer than this package, or
        states a smaller tube than its numbers give.

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> import pathlib, tempfile
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    >>> comp = dfc.design_compensation(axis, dt=1e-3)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     comp.save(pathlib.Path(folder) / "compensation.json")
    ...     again = dfc.load_compensation(pathlib.Path(folder) / "compensation.json")
    >>> again.certificate.tube == comp.certificate.tube
    True
    """
    return load_document(path, KIND, VERSION, _rebuild, CertificateError)


def _rebuild(data: dict[str, Any]) -> Compensation:
    """Compensation of the numbers in a file, checked."""
    fields: dict[str, Any] = {name: positive(name, data[name]) for name in POSITIVE}
    fields |= {name: positive(name, data[name], zero=True) for name in MAY_BE_ZERO}
    fields["kd"] = finite("kd", data["kd"])
    fields["lead"] = whole("lead", data["lead"], least=0)
    if data["law"] not in LAWS:
        raise ValueError(f"law must be one of {', '.join(LAWS)}, got {data['law']!r}")
    if not fields["mismatch"] < 1.0:
        raise ValueError(f"mismatch must be below 1, got {fields['mismatch']!r}")
    fields["law"] = data["law"]
    fields["limit"] = math.inf if data["limit"] is None else positive("limit", data["limit"])
    fields["axis"] = axis_from_dict(data["axis"])
    fields["observer"] = None if data["observer"] is None else design_of(data["observer"])
    if (fields["observer"] is None) == (data["law"] in ("learned", "fixed")):
        raise ValueError(f"law {data['law']!r} and observer do not fit together")
    if fields["observer"] is not None and fields["observer"].dt != fields["dt"]:
        raise ValueError("dt differs from that of the observer")
    comp = certified(fields)
    if data["numbers"] != plain_data(comp.controller.law.numbers):
        raise ValueError("numbers of its law are not those that this package gives the design")
    stated = math.inf if data["tube"] is None else positive("tube", data["tube"], zero=True)
    if not comp.certificate.tube <= stated * (1.0 + 1e-9):
        raise ValueError(
            f"its numbers give a tube of {comp.certificate.tube:.6g}, not {stated:.6g} as stated"
        )
    return comp
