"""Plausibility of a record for an axis: units, signs, columns."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np

from dryfric_control.checks import warn
from dryfric_control.estimation.drive_regression import DriveRegression
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.records.data_check import energy_message, speed_message
from dryfric_control.records.motion import fast_speed
from dryfric_control.records.read import as_record
from dryfric_control.records.record import Record
from dryfric_control.records.record_warning import RecordWarning
from dryfric_control.text import page_reference, rotary_words

# Excursion beyond the travel, as a fraction of its length, that cannot be an overshoot.
_MAX_OVERSHOOT = 0.25
# Ratio of the largest drive to the lowest Coulomb level below which it cannot move the axis.
_MIN_DRIVE_RATIO = 0.5
# Ratio of the force that the motion needs, exceeded in 5 % of the samples, to the largest drive
# beyond which no mass, however wrong, but a unit is off.
_MAX_FORCE_RATIO = 30.0
# Ratio of the mass that the drive shows to that of the axis beyond which a unit is wrong, not the
# model; the same of the Coulomb level, and the relative standard error up to which they count.
_UNIT_RATIO = 100.0
_SURE = 0.1
# Ratio of a value to that of the axis within which it is the same, and to a factor of ten that a
# prefix makes, within which it is that prefix.
_ALIKE = 10.0
_NEAR = 5.0
# Ratio of the stick velocity to the largest usual velocity beyond which the axis is at rest for
# much of what the record calls motion.
_MAX_STICK_RATIO = 0.05
#: The ratio at which it is rest.
STICK_RATIO = 1e-3
# Effect with which a stuck axis moves on.
_CREEPING = "presliding"
# Units by the factor on a channel that was taken for the SI unit.
_PREFIXED = {
    "m": {1e3: "mm", 1e6: "um"},
    "rad": {1e3: "mrad", 1e6: "urad"},
    "N": {1e-3: "kN", 1e3: "mN"},
    "N m": {1e-3: "kN m", 1e3: "mN m"},
    "s": {1e3: "ms", 1e6: "us"},
}


class Doubt(NamedTuple):
    """What speaks against a record; `proof`: the same with its mend where it is certain."""

    message: str
    proof: str = ""


def warn_if_implausible(axis: FrictionAxis, record: Record) -> None:
    """RecordWarning about wrong units, reversed sign or swapped columns.

    Positions lie far outside the travel, or the drive extracts energy from the machine, is too weak
    for the friction of the axis or for its acceleration, or shows another mass by orders.
    """
    check_plausible(axis, record, anyway=True)


def check_plausible(
    axis: FrictionAxis,
    record: Record,
    name: str = "record",
    *,
    anyway: bool = False,
    gain_free: bool = False,
) -> None:
    """`warn_if_implausible`, but ValueError with what to type where a doubt is certain.

    Told to go on `anyway`, it only warns; `gain_free`: whether the gain of the drive is looked for.
    """
    found = record_doubts(axis, record, gain_free)
    if not anyway:
        _raise_certain(found, name)
    for doubt in found:
        warn(doubt.message, RecordWarning)


def refuse_implausible(axis: FrictionAxis, record: Record, name: str = "record") -> None:
    """ValueError with what to type where a wrong unit or a reversed sign is certain."""
    _raise_certain(record_doubts(axis, record), name)


def _raise_certain(found: list[Doubt], name: str) -> None:
    certain = [doubt.proof for doubt in found if doubt.proof]
    if certain:
        raise ValueError(
            f"{name}: {'; '.join(certain)}; anyway=True goes on with it as it is"
            + page_reference("troubleshooting")
        )


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


def record_doubts(axis: FrictionAxis, record: Record, gain_free: bool = False) -> list[Doubt]:
    """What speaks against units, sign and columns of a record, if it is one of this axis.

    Certain is what the regression of the drive on the motion confirms; the rest may be a wrong
    model.
    """
    axis = axis.effective()
    found = []
    if outside := _positions_outside(axis, record):
        found.append(Doubt(outside))
    strongest = float(np.abs(record.u).max())
    if strongest == 0.0:
        return found  # something else moves it: nothing is known of the drive
    shown = _drive_regression(record)
    if shown is not None and shown.exchange:
        return [*found, Doubt(shown.exchange, shown.exchange)]
    scaled = gain_free or any(effect.slug == "input_gain" for effect in axis.effects)
    found += _drive_doubts(axis, record, shown, strongest, scaled)
    fast = fast_speed(record)
    if slow := _slow_motion(axis, fast):
        found.append(Doubt(slow, slow if fast < axis.stick_speed else ""))
    if not (found or scaled) and axis.units[0] == "m" and (text := speed_message(record)):
        # No proof: an axis whose mass and friction are those of the record may be in other units.
        found.append(Doubt(text))
    return found


def _positions_outside(axis: FrictionAxis, record: Record) -> str:
    """What to say of positions far outside the travel of the axis; empty if there are none."""
    if axis.travel is None:
        return ""
    start, end = axis.travel
    low = float(record.x.min())
    high = float(record.x.max())
    room = _MAX_OVERSHOOT * (end - start)
    if start - room <= low and high <= end + room:
        return ""
    length = axis.units[0]
    return (
        f"positions run from {low:.4g} to {high:.4g} {length}, the axis' travel is "
        f"{start:.4g} to {end:.4g} {length}: is x in another unit, "
        'such as mm (then read_record(..., units={"x": "mm"})), or counted from elsewhere?'
    )


def _drive_doubts(
    axis: FrictionAxis,
    record: Record,
    shown: DriveRegression | None,
    strongest: float,
    scaled: bool,
) -> Iterator[Doubt]:
    """What speaks against sign and unit of the drive; `scaled`: whether it has a gain."""
    energy = energy_message(record, axis.units)
    if energy:
        yield Doubt(energy, _wrong_sign(axis, shown))
    unit = "" if scaled else _wrong_unit(axis, record, shown)
    if unit:
        yield Doubt(unit, unit)
    elif weak := _weak_drive(axis, record, strongest, scaled):
        yield Doubt(weak)


def _weak_drive(axis: FrictionAxis, record: Record, strongest: float, scaled: bool) -> str:
    """What to say of a drive that is too weak for friction or acceleration; empty if it is not."""
    force = axis.units[1]
    places = np.linspace(float(record.x.min()), float(record.x.max()), 33)
    least = min(float(axis.coulomb(places, s).min()) for s in (1, -1))
    if not axis.effects and strongest < _MIN_DRIVE_RATIO * least:
        return (
            f"the drive is at most {strongest:.3g} {force} and moves an axis whose Coulomb level "
            f"is at least {least:.3g} {force}: is u in another unit, such as V or kN (gain=...)?"
        )
    motion = record.derivatives()
    needed = float(np.quantile(np.abs(axis.mass * motion.a + axis.viscous * motion.v), 0.95))
    if not scaled and needed > _MAX_FORCE_RATIO * strongest:
        return (
            f"the motion needs about {needed:.3g} {force} for the mass and viscous friction of the "
            f"axis, the drive is at most {strongest:.3g} {force}: is x in another unit, such as mm "
            '(then read_record(..., units={"x": "mm"})), or u in another (gain=...)?'
        )
    return ""


def _slow_motion(axis: FrictionAxis, fast: float) -> str:
    """What to say of motion that is slow beside the stick velocity of the axis; empty if none."""
    if any(effect.slug == _CREEPING for effect in axis.effects):
        return ""
    if axis.stick_speed <= _MAX_STICK_RATIO * fast:
        return ""
    unit = axis.unit("m/s")
    return (
        f"the record moves at up to {fast:.2g} {unit} in 95 % of its motion, and the axis counts "
        f"as motionless below its stick velocity of {axis.stick_speed:.2g} {unit}: lower that, "
        f"axis.replace(stick_speed={STICK_RATIO * fast:.1g})"
    )


def _drive_regression(record: Record) -> DriveRegression | None:
    """Mass and friction that the drive shows; None where the record slides too little."""
    try:
        return DriveRegression.from_record(record)
    except ValueError:
        return None


def _wrong_sign(axis: FrictionAxis, shown: DriveRegression | None) -> str:
    """What makes a reversed sign certain, and its mend; empty where it is not."""
    if shown is None or not shown.has_opposed_drive or shown.has_driving_sign:
        return ""
    mass, level = shown.values[[0, 2]]
    return rotary_words(
        "the drive takes energy out of the machine and acts against acceleration and friction: by "
        f"drive and motion the mass is {mass:.3g} {axis.unit('kg')} and the Coulomb level "
        f"{level:.3g} {axis.units[1]}, as with the wrong sign. read_record(..., gain=-1) turns the "
        "drive, gain={'x': -1.0} the position",
        axis.units[1],
    )


def _wrong_unit(axis: FrictionAxis, record: Record, shown: DriveRegression | None) -> str:
    """What to say of mass and friction that differ from the axis as only units can; empty if not.

    A Coulomb level alone may differ so where nobody knew it, unless the mass does not show.
    """
    if shown is None:
        return ""
    ratios = {}
    here = []
    there = []
    for name, i, value, unit in (
        ("mass", 0, axis.mass, axis.unit("kg")),
        ("Coulomb level", 2, axis.coulomb.mean, axis.units[1]),
    ):
        if value > 0.0 and shown.is_sure(i, _SURE):
            ratios[name] = float(shown.values[i]) / value
            here.append(f"the {name} is {shown.values[i]:.3g} {unit}")
            there.append(f"{value:.3g} {unit}")
    first = next(iter(ratios.values()), 1.0)
    if 1.0 / _UNIT_RATIO < first < _UNIT_RATIO:
        return ""
    return rotary_words(
        f"by drive and motion {' and '.join(here)}, in the axis {' and '.join(there)}: "
        f"{_unit_mend(axis, record, first, ratios.get('Coulomb level', 1.0))}; where the axis is "
        "wrong, dfc.axis_from(record) makes another",
        axis.units[1],
    )


def _unit_mend(axis: FrictionAxis, record: Record, first: float, level: float) -> str:
    """Which unit may be wrong, and what to type, by the ratios of mass and Coulomb level."""
    length, force = axis.units
    if 1.0 / _ALIKE < level < _ALIKE:
        # Forces agree: accelerations are off, by x or by the square of t.
        asked = [("x", length, 1.0 / first), ("t", "s", math.sqrt(first))]
    elif 1.0 / _ALIKE < level / first < _ALIKE:
        asked = [("u", force, first)]
    else:
        asked = []
    for role, unit, factor in asked:
        for known, name in _PREFIXED.get(unit, {}).items():
            stated = record.raw if role == "t" else record.units
            if role not in stated and 1.0 / _NEAR < factor / known < _NEAR:
                mend = f'read_record(..., units={{"{role}": "{name}"}})'
                return f"{role} seems to be in {name}, which {mend} converts"
    mend = "a unit is wrong, which read_record(..., units=...) or gain=... mends"
    if 1.0 / _ALIKE < level < _ALIKE and first > 1.0:
        return f"the mass of the axis lacks a part, as of a rotor behind its gear, or {mend}"
    return mend
