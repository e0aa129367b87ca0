"""Measured machines of which more than one benchmark makes use; their records are public."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from harness import DATA

import dryfric_control as dfc

EMPS = DATA / "emps" / "DATA_EMPS.mat"
PENDULUM = DATA / "bam_xl330"


class Pendulum(NamedTuple):
    """A servo pendulum: nominal axis, logs at kp = 100, and those at kp = 400 by trajectory."""

    axis: dfc.FrictionAxis
    train: list[dfc.Record]
    test: list[tuple[str, dfc.Record]]


def pendulum() -> Pendulum:
    """The pendulum; no logs where the folder is missing.

    u is in V: its gain is kt/R, and the back-EMF kt^2/R is part of the viscous term.
    """
    axis = dfc.FrictionAxis(
        mass=0.49 * 0.1**2, viscous=0.1, coulomb=0.05, stick_speed=1e-2, units=("rad", "N m"),
        effects=(dfc.effects.Gravity(0.49 * 9.81 * 0.1), dfc.effects.InputGain(0.2)),
    )  # fmt: skip
    logs = [dfc.read_bam(path) for path in sorted(PENDULUM.glob("*.json"))]
    train = [enabled(log) for log in logs if log["kp"] == 100]
    test = [(log["trajectory"], enabled(log)) for log in logs if log["kp"] == 400]
    return Pendulum(axis, train, test)


def enabled(log) -> dfc.Record:  # type: ignore[no-untyped-def]
    """The record of a log until the torque is switched off."""
    off = np.flatnonzero(~log["torque_enable"])
    return log["record"][: int(off[0])] if off.size else log["record"]
