"""Compensations from files, checked."""

from __future__ import annotations

import os
from dataclasses import replace

import numpy as np

from dryfric_control.checks import finite, one_of, positive, whole
from dryfric_control.compensation.design import KIND, SAVED, Compensation, Promise, certified
from dryfric_control.compensation.tuning import LAWS
from dryfric_control.observer.certificate import CertificateError
from dryfric_control.observer.storage import checked as checked_design
from dryfric_control.store.saved import load_object

_POSITIVE = ("dt", "bandwidth", "kp", "tolerance", "disturbance_bandwidth")
_MAY_BE_ZERO = ("encoder_quantum", "input_delay", "ki", "filter_time", "learning", "mismatch",
                "correction")  # fmt: skip


def load_compensation(path: str | os.PathLike[str]) -> Compensation:
    """Read a compensation back and check its certificate.

    Parameters
    ----------
    path : str or path
        File written by `Compensation.save`.

    Returns
    -------
    Compensation
        Its certificate is computed anew; a ValueError if the file states a smaller tube, is
        damaged or newer than this package.

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
    found: Compensation = load_object(path, KIND, SAVED, _checked, CertificateError)
    return found


def _checked(stated: Promise) -> Compensation:
    """The design of a file, every part in its range, which keeps what the file states."""
    comp = stated.design
    for name in _POSITIVE:
        positive(name, getattr(comp, name))
    for name in _MAY_BE_ZERO:
        positive(name, getattr(comp, name), zero=True)
    finite("kd", comp.kd)
    whole("lead", comp.lead, least=0)
    one_of("law", comp.law, LAWS)
    if not comp.mismatch < 1.0:
        raise ValueError(f"mismatch must be below 1, got {comp.mismatch!r}")
    if comp.limit != np.inf:
        positive("limit", comp.limit)
    if (comp.observer is None) == (comp.law in ("learned", "fixed")):
        raise ValueError(f"law {comp.law!r} and observer do not fit together")
    if comp.observer is not None:
        if comp.observer.dt != comp.dt:
            raise ValueError("dt differs from that of the observer")
        comp = replace(comp, observer=checked_design(comp.observer))
    comp = certified(comp)
    if not np.array_equal(stated.numbers, comp.controller.law.numbers):
        raise ValueError("numbers of its law are not those that this package gives the design")
    tube = comp.certificate.tube
    if not tube <= stated.tube * (1.0 + 1e-9):
        raise ValueError(f"its numbers give a tube of {tube:.6g}, not {stated.tube:.6g} as stated")
    return comp
