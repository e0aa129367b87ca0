"""Plausibility of a record for an axis: units, signs, columns, stiffness."""

from __future__ import annotations

from itertools import combinations
from typing import Any

import numpy as np

from dryfric_control.checks import warn
from dryfric_control.model.axis import FrictionAxis, elastic_rates
from dryfric_control.records.data_check import energy_message, speed_message
from dryfric_control.records.read import as_record
from dryfric_control.records.record import Record
from dryfric_control.records.record_warning import RecordWarning

# Excursion beyond the travel, as a fraction of its length, that cannot be an overshoot.
_MAX_OVERSHOOT = 0.25
# Ratio of the largest drive to the lowest Coulomb level below which it cannot move the axis.
_MIN_DRIVE_RATIO = 0.5
# Ratio of the force that the motion needs, exceeded in 5 % of the samples, to the largest drive
# beyond which no mass, however wrong, but a unit is off.
_MAX_FORCE_RATIO = 30.0
# Natural frequency of a contact times the sampling time [rad] beyond which it is too stiff: a
# sample takes dozens of steps. How far it yields shows beyond the frequency of the samples, too.
_MAX_CONTACT_FREQUENCY = 30.0
# The same of a damped transmission: how that swings does not show beyond this frequency.
_MAX_TRANSMISSION_FREQUENCY = 4.0


def stiffness(axis: FrictionAxis, dt: float) -> float:
    """Rate of the elastic parts over the fastest that samples show; 0 without such parts."""
    rates = elastic_rates(axis, dt)
    turn = rates["transmission"] + rates["damping"]
    return max(rates["contact"] / _MAX_CONTACT_FREQUENCY, turn / _MAX_TRANSMISSION_FREQUENCY) * dt


def warn_if_implausible(axis: FrictionAxis, record: Record) -> None:
    """RecordWarning about wrong units, reversed sign or swapped columns.

    Positions lie far outside the travel, or the drive extracts energy from the machine or is too
    weak for the friction of the axis or for its acceleration.
    """
    for message in doubts(axis, record):
        warn(message, RecordWarning)


def checked_records(records: Any, name: str = "record") -> tuple[Record, ...]:
    """One record or a list of several, as a tuple; one that stands twice would count double.

    A path is the record in its file.
    """
    several = isinstance(records, (list, tuple))
    given = tuple(records) if several else (records,)
    if not given:
        raise ValueError(f"{name}: the list of records is empty: give at least one Record")
    found = tuple(
        as_record(one, f"{name}[{i}]" if several else name) for i, one in enumerate(given)
    )
    for (i, one), (j, other) in combinations(enumerate(found), 2):
        if np.array_equal(one.x, other.x) and np.array_equal(one.u, other.u):
            raise ValueError(
                f"{name}[{i}] and {name}[{j}] hold the same data, which would count double: give "
                "each record once"
            )
    return found


def doubts(axis: FrictionAxis, record: Record) -> list[str]:
    """What speaks against units, sign and columns of a record, if it is one of this axis."""
    found = []
    low, high = float(record.x.min()), float(record.x.max())
    length, force = axis.units
    if axis.travel is not None:
        room = _MAX_OVERSHOOT * (axis.travel[1] - axis.travel[0])
        if low < axis.travel[0] - room or high > axis.travel[1] + room:
            found.append(
                f"positions run from {low:.4g} to {high:.4g} {length}, the axis' travel is "
                f"{axis.travel[0]:.4g} to {axis.travel[1]:.4g} {length}: is x in another unit, "
                'such as mm (then read_record(..., units={"x": "mm"})), or counted from elsewhere?'
            )
    strongest = float(np.abs(record.u).max())
    if strongest == 0.0:
        return found  # something else moves it: nothing is known of the drive
    energy = energy_message(record, axis.units)
    if energy:
        found.append(energy)
    places = np.linspace(low, high, 33)
    least = min(float(axis.coulomb(places, s).min()) for s in (1, -1))
    motion = record.derivatives()
    inertial = np.abs(axis.mass * motion.a + axis.viscous * motion.v)
    needed = float(np.quantile(inertial, 0.95))
    scaled = any(effect.slug == "input_gain" for effect in axis.effects)
    if not axis.effects and strongest < _MIN_DRIVE_RATIO * least:
        found.append(
            f"the drive is at most {strongest:.3g} {force} and moves an axis whose Coulomb level "
            f"is at least {least:.3g} {force}: is u in another unit, such as V or kN (gain=...)?"
        )
    elif not scaled and needed > _MAX_FORCE_RATIO * strongest:
        found.append(
            f"the motion needs about {needed:.3g} {force} for the mass and viscous friction of the "
            f"axis, the drive is at most {strongest:.3g} {force}: is x in another unit, such as mm "
            '(then read_record(..., units={"x": "mm"})), or u in another (gain=...)?'
        )
    if not (found or scaled) and axis.units[0] == "m" and (fast := speed_message(record)):
        found.append(fast)
    return found
