"""A log that is not of the model: another robot, or readings of another sign, zero, unit or joint.

The linear model of `model_errors` fits such a log by masses that no arm has.  Then readings that a
user may have meant are tried, one after the other: what leaves much less of the drive unexplained
is named.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import combinations
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from dryfric_control.arm.rigid_model import Motion
from dryfric_control.records.record import Record

if TYPE_CHECKING:
    from dryfric_control.arm.arm_records import ArmRecords
    from dryfric_control.arm.model_errors import ModelError, Scale

# Deviation from the model over what one has beforehand, from which a link is hardly that one.
HARDLY = 3.5
# Such links from which a log is not of the model.
_LINKS = 2
# Mass of a link over that of the model below which it is none.
_LEAST = 0.2
# Scale of a drive that is no torque constant: below, or above its inverse.
_SCALE = 1.0 / 3.0
# Standard errors by which a scale must be away from that.
_SURE = 4.0
# Gain of the logarithm of what remains, over all joints, from which another reading is meant.
_MEANT = 4.0
# Gain over the next one, from which it is that one.
_ALONE = 0.7
# Zeros that are tried [rad].
_ZEROS = (0.5 * math.pi, -0.5 * math.pi, math.pi)


class Remains(NamedTuple):
    """How well masses and friction explain the drives of a log."""

    part: float  # logarithm of the part of the drive that is not explained, sum over the joints
    likely: bool  # whether the masses are as those of a model may be


class Reading(NamedTuple):
    """Another way to read a log."""

    words: str
    records: ArmRecords


def wrong_scales(scales: Sequence[Scale]) -> list[Scale]:
    """Drives whose scale is surely another unit or sign."""
    return [
        one for one in scales
        if one.value + _SURE * one.standard_error < _SCALE
        or one.value - _SURE * one.standard_error > 1.0 / _SCALE
    ]  # fmt: skip


def why_not_this_log(
    records: ArmRecords,
    errors: Sequence[ModelError],
    unlikely: Sequence[str],
    scales: Sequence[Scale],
    remains: Callable[[ArmRecords], Remains],
) -> str:
    """What is wrong with a log that does not fit the model; empty where it fits.

    Parameters
    ----------
    records : ArmRecords
    errors : sequence of ModelError
        Errors of the model that were found.
    unlikely : sequence of str
        Links that deviate from the model by more than `HARDLY` allows.
    scales : sequence of Scale
        Scales of the drives, whatever they are.
    remains : callable
        How well masses and friction explain the drives.
    """
    wrong = wrong_scales(scales)
    if not wrong and len(unlikely) < _LINKS and not any(map(_has_impossible_mass, errors)):
        return ""
    if words := _better_readings(records, wrong, remains):
        return f"the log fits the model if {' or '.join(words)}"
    off = [
        f"{one.link} {100.0 * (one.value - 1.0):+.0f} %" for one in errors
        if one.kind == "mass" and one.named
    ]  # fmt: skip
    masses = f" with masses off by {', '.join(off)}" if off else ""
    return (
        f"the log does not fit the model, or only{masses}: is it of another robot, or are columns, "
        "units, signs or zeros of joints other ones?"
    )


def _has_impossible_mass(error: ModelError) -> bool:
    """Whether no arm has the mass of a link, or of the payload, that an error makes."""
    if error.kind == "mass":
        return error.value < _LEAST
    return error.kind == "payload" and error.value < 0.0


def _better_readings(
    records: ArmRecords, wrong: Sequence[Scale], remains: Callable[[ArmRecords], Remains]
) -> list[str]:
    """Words of the readings that leave much less of the drives, none if none does."""
    most = remains(records).part - _MEANT
    tried = [(remains(one.records), one.words) for one in _readings(records, wrong)]
    found = [(left.part, words) for left, words in tried if left.likely and left.part < most]
    best = min((part for part, _ in found), default=0.0)
    return [words for part, words in found if part < best + _ALONE]


def undirected_joints(
    records: ArmRecords, remains: Callable[[ArmRecords], Remains]
) -> tuple[str, ...]:
    """Joints whose positions and drives, both with the opposite sign, fit as well.

    Inertia and friction of a joint are the same then: only its load, and that of others by its
    motion, has a direction.

    Parameters
    ----------
    records : ArmRecords
    remains : callable
        How well masses and friction explain the drives.
    """
    most = remains(records).part + _ALONE
    turned = ((joint, remains(_signed(records, joint, x=-1.0, u=-1.0))) for joint in records)
    return tuple(joint for joint, left in turned if left.likely and left.part < most)


def _readings(records: ArmRecords, wrong: Sequence[Scale]) -> Iterator[Reading]:
    """Readings that a user may have meant."""
    if wrong:
        yield _at_scales(records, wrong)
    for joint in records:
        yield Reading(
            f"positions of {joint} have the opposite sign (-x)", _signed(records, joint, x=-1.0)
        )
        yield Reading(
            f"drives of {joint} have the opposite sign (-u)", _signed(records, joint, u=-1.0)
        )
        yield Reading(
            f"the axis of {joint} has the opposite direction (-x and -u)",
            _signed(records, joint, x=-1.0, u=-1.0),
        )
        if records.arm.units[joint][0] == "rad":
            for zero in _ZEROS:
                yield Reading(
                    f"the zero of {joint} is another one (x {math.degrees(zero):+.0f} deg)",
                    _moved(records, joint, zero),
                )
    for one, other in combinations(records, 2):
        if records.arm.units[one] == records.arm.units[other]:
            yield Reading(f"{one} and {other} are exchanged", _exchanged(records, one, other))


def _at_scales(records: ArmRecords, wrong: Sequence[Scale]) -> Reading:
    """Drives at the scales at which the model shows them."""
    changed = dict(records.records)
    for one in wrong:
        record = changed[one.joint]
        changed[one.joint] = record._with_changes(u=record.u / one.value)
    words = ", ".join(f"{one.joint} {one.value:.3g}" for one in wrong)
    return Reading(
        f"drives are of another unit, sign, or of the motors: scaling={{joint: dfc.Scaling(...)}} "
        f"(logged over needed: {words})",
        replace(records, records=changed),
    )


def _signed(records: ArmRecords, joint: str, x: float = 1.0, u: float = 1.0) -> ArmRecords:
    """A joint with other signs."""
    record = records.records[joint]
    j = list(records).index(joint)
    motion = Motion(*(one.copy() for one in records.motion))
    for one in motion:
        one[:, j] *= x
    return _with_record(
        records, joint, record._with_changes(x=x * record.x, u=u * record.u), motion
    )


def _moved(records: ArmRecords, joint: str, zero: float) -> ArmRecords:
    """A joint with another zero."""
    record = records.records[joint]
    motion = records.motion._replace(q=records.motion.q.copy())
    motion.q[:, list(records).index(joint)] += zero
    return _with_record(records, joint, record._with_changes(x=record.x + zero), motion)


def _exchanged(records: ArmRecords, one: str, other: str) -> ArmRecords:
    """Readings of two joints, each as the other one's."""
    names = list(records)
    order = np.arange(len(names))
    i = names.index(one)
    k = names.index(other)
    order[[i, k]] = k, i
    motion = Motion(*(part[:, order] for part in records.motion))
    changed = {**records.records, one: records.records[other], other: records.records[one]}
    return replace(records, records=changed, motion=motion)


def _with_record(records: ArmRecords, joint: str, record: Record, motion: Motion) -> ArmRecords:
    return replace(records, records={**records.records, joint: record}, motion=motion)
