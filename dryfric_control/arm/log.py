"""One log of all joints of an arm: a record of each, on one clock."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import numpy as np
from scipy.interpolate import PchipInterpolator

from dryfric_control.arm.rigid_model import RigidArm
from dryfric_control.arrays import Floats
from dryfric_control.records.bad_readings import mask_filled
from dryfric_control.records.read import read_record
from dryfric_control.records.readers.reading import call_text
from dryfric_control.records.record import Record
from dryfric_control.records.record_warning import warn
from dryfric_control.records.refusal import RefusalError
from dryfric_control.records.scaling import Scaling

# Difference of two clocks, over the step, below which they are one.
_SAME = 1e-3
# Largest difference of the steps of two joints, relative.
_SAME_STEP = 0.01
# Largest distance of a joint beyond its limits [rad or m].
_OVER = 0.2
# Largest position over the limits of a joint, from which it is in another unit.
_OTHER_UNIT = 3.0
# Force that a motion needs over the largest one of the log, from which the log is another robot's.
_TOO_STRONG = 3.0


def joint_records(arm: RigidArm, log: Any, scaling: Any, /, **options: Any) -> dict[str, Record]:
    """A record of each joint of an arm, on one clock; `options` as `read_record` takes them.

    `log`: a source of `read_record` with the columns of all joints, or records by joint.
    """
    if log is None:
        raise ValueError(
            "log is None: give one log of all joints, or a mapping of joints to Record"
        )
    own = isinstance(log, Mapping) and all(isinstance(one, Record) for one in log.values())
    found: dict[str, Record] = {}
    for joint in arm.joints:
        if own:
            found[joint] = _joint_record(log, joint, arm)
            continue
        gain = scaling.get(joint) if isinstance(scaling, Mapping) else scaling
        try:
            found[joint] = read_record(log, joint=joint, name=joint, gain=gain or 1.0, **options)
        except ValueError as problem:
            if "no column of joint" in str(problem):
                raise _missing(joint, problem) from None
            problem.add_note(
                f'in joint {joint}; one that does not move: held={{"{joint}": its position}}'
            )
            if isinstance(problem, RefusalError):
                raise _refusal_of_log(problem) from None
            raise
    for joint, record in found.items():
        found[joint] = _in_units(arm, joint, record)
    return _on_one_clock(found)


def _refusal_of_log(problem: RefusalError) -> RefusalError:
    """A refusal with the line that reads all joints, where its arguments are those of all."""
    shared = {k: v for k, v in problem.arguments.items() if k not in ("joint", "name", "columns")}
    if not shared or problem.arguments.get("columns"):
        return problem
    line = call_text("arm_records", ["model", "log"], shared)
    reasons = problem.reasons.removesuffix(".")
    found = problem.with_line(f"{reasons}. Read all joints by {line}", shared)
    for note in problem.__notes__:
        found.add_note(note)
    return found


def _joint_record(log: Mapping[str, Record], joint: str, arm: RigidArm) -> Record:
    if joint not in log:
        raise _missing(joint, f"it has {', '.join(map(str, log)) or 'none'}")
    return log[joint]


def _missing(joint: str, why: Any) -> ValueError:
    return ValueError(
        f"the model has a joint {joint!r} and the log has none of that name ({why}). Rename its "
        f'columns; if it did not move, give held={{"{joint}": its position}}; if this is the log '
        "of another robot, give the model of that one"
    )


def _in_units(arm: RigidArm, joint: str, record: Record) -> Record:
    """The record in the units of the joint, if what it states and its range agree with them."""
    length, force = arm.units[joint]
    for role, unit in (("x", length), ("u", force)):
        got = record.units.get(role, unit)
        if got != unit:
            raise ValueError(
                f"joint {joint}: {role} is in {got!r}, the model needs {unit!r}: read it with "
                f'units={{"{role}": ...}}, or give the numbers of the motor, '
                f'scaling={{"{joint}": dfc.Scaling(...)}}'
            )
    low, high = arm.limits(joint)
    least = float(record.x.min())
    most = float(record.x.max())
    if least < low - _OVER or most > high + _OVER:
        far = max(abs(least), abs(most)) > _OTHER_UNIT * max(abs(low), abs(high))
        hint = 'is it in degrees (units={"x": "deg"})' if length == "rad" else "is it in mm"
        hint = hint if far else "is its zero another one, or the log another robot's"
        raise ValueError(
            f"joint {joint}: positions run from {least:.4g} to {most:.4g} {length}, the model's "
            f"range is {low:.4g} to {high:.4g} {length}: {hint}?"
        )
    if {"x", "u"} <= set(record.units):
        return record
    return record._with_changes(units={"x": length, "u": force, **record.units})


def _on_one_clock(found: dict[str, Record]) -> dict[str, Record]:
    """The records at the same instants; those with stamps of their own are put on one clock."""
    first = next(iter(found.values()))
    for joint, record in found.items():
        if abs(record.dt / first.dt - 1.0) > _SAME_STEP:
            raise ValueError(
                f"joint {joint} has a step of {record.dt:g} s and {next(iter(found))} one of "
                f"{first.dt:g} s: give one step, dt={max(r.dt for r in found.values()):g}"
            )
    if all(_same_stamps(first, record) for record in found.values()):
        return found
    begin = max(float(r.t[0]) for r in found.values())
    end = min(float(r.t[-1]) for r in found.values())
    count = int((end - begin) / first.dt * (1.0 + 1e-9)) + 1
    if count < 0.5 * len(first):
        raise ValueError(
            f"the joints have only {max(end - begin, 0.0):.3g} s in common: give one log with one "
            "clock"
        )
    clock: Floats = begin + first.dt * np.arange(count, dtype=float)
    late = {joint: float(r.t[0] - first.t[0]) for joint, r in found.items()}
    most = max(late, key=lambda joint: abs(late[joint]))
    warn(
        f"the joints have stamps of their own ({most} begins {late[most]:.4g} s after "
        f"{next(iter(found))}): they were put on one clock"
    )
    return {joint: _interpolate_record(record, clock) for joint, record in found.items()}


def _same_stamps(one: Record, other: Record) -> bool:
    """Whether two records were taken at the same instants."""
    return len(one) == len(other) and bool(np.abs(one.t - other.t).max() <= _SAME * one.dt)


def _interpolate_record(record: Record, clock: Floats) -> Record:
    """A record at other instants of the same step."""
    dt = record.dt
    t = record.t
    edges = np.append(t, t[-1] + dt)
    impulse = np.concatenate(([0.0], np.cumsum(record.u) * dt))
    u = np.diff(np.interp(np.append(clock, clock[-1] + dt), edges, impulse)) / dt
    inside = np.clip(clock, t[0], t[-1])
    x = PchipInterpolator(t, record.x)(inside)
    masked = mask_filled(t[record.good], clock, x, dt)
    return record._with_changes("put on the clock of the other joints", t=clock, u=u, x=x, dt=dt,
                        channels={}, reference=None, masked=masked)  # fmt: skip


def refuse_other_robot(joint: str, record: Record, needed: Floats, unit: str) -> None:
    """Refuse a log whose drive is far too weak for the motion of the model."""
    most = float(np.abs(record.u).max())
    force = float(np.quantile(np.abs(needed), 0.95))
    if force > _TOO_STRONG * most > 0.0:
        raise ValueError(
            f"joint {joint}: the model needs {force:.3g} {unit} for this motion, the log has at "
            f"most {most:.3g} {unit}: is u a current or the torque of the motor (scaling={{"
            f'"{joint}": dfc.Scaling(torque_constant=..., gear_ratio=...)}}), or the log another '
            "robot's?"
        )


def checked_scaling(scaling: Any, joints: tuple[str, ...]) -> Any:
    """Factors for every joint, or of each by its name."""
    if scaling is None or isinstance(scaling, Scaling):
        return scaling
    if isinstance(scaling, Mapping) and all(isinstance(s, Scaling) for s in scaling.values()):
        for joint in scaling:
            if joint not in joints:
                raise ValueError(
                    f"scaling: the model has no joint {joint!r}; it has {', '.join(joints)}"
                )
        return scaling
    names = ", ".join(item.name for item in fields(Scaling)[1:4])
    raise ValueError(f"scaling must be dfc.Scaling({names}, ...) or one by joint, got {scaling!r}")
