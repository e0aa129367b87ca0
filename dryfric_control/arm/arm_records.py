"""Records of the joints of an arm, with the coupling torque that its model knows as their load."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dryfric_control.arm.log import checked_scaling, joint_records, refuse_other_robot
from dryfric_control.arm.model_errors import ModelError, find_model_errors
from dryfric_control.arm.rigid_model import Motion, RigidArm, means_of_samples
from dryfric_control.arrays import Floats
from dryfric_control.checks import check_boolean, instance
from dryfric_control.diagnosis.joints import base_words
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.records.record import Record
from dryfric_control.text import Result, documented, percent, stated

# Change of the inertia over the motion, relative to its mean, that is worth a note.
_CHANGES = 0.1
# Coulomb level to start from, over the 95 % quantile of what the drive has beyond the model, where
# the model has none.
_GUESS = 0.5


@documented
@dataclass(frozen=True, eq=False, repr=False)
class ArmRecords(Result, Mapping[str, tuple[FrictionAxis, Record]]):
    """Axis and record of each joint of an arm; made by `arm_records`.

    A mapping that `diagnose_joints` takes as it is.

    Examples
    --------
    A pendulum:

    >>> import numpy as np
    >>> import mujoco
    >>> import dryfric_control as dfc
    >>> model = mujoco.MjModel.from_xml_string('''<mujoco><worldbody><body name="arm">
    ...   <joint name="swing" axis="0 1 0"/><inertial pos="0.5 0 0" mass="1"
    ...   diaginertia="0.01 0.01 0.01"/></body></worldbody></mujoco>''')
    >>> true = dfc.FrictionAxis(mass=0.26, viscous=0.2, coulomb=0.5, units=("rad", "N m"),
    ...                         effects=(dfc.effects.Gravity(amplitude=4.905, phase=1.571),))
    >>> t = 2e-3 * np.arange(3000)
    >>> u = 4.0 * np.sin(2.0 * t) + np.sin(11.0 * t)
    >>> x = 1e-5 * np.round(1e5 * true.simulate(u, dt=2e-3, x0=1.5).y[0])
    >>> log = {"time": t, "swing.effort": u, "swing.position": x}
    >>> records = dfc.arm_records(model, log)
    >>> [record.known_load is not None for axis, record in records.values()]
    [True]
    """

    axes: dict[str, FrictionAxis] = stated(
        "Nominal axis of each joint: mean inertia over the motion, friction of the model."
    )
    records: dict[str, Record] = stated(
        "Record of each joint; its load is the coupling torque, with the opposite sign."
    )
    inertia: dict[str, tuple[float, float]] = stated(
        "Least and largest inertia about each joint over the motion [kg m^2 or kg]."
    )
    body_inertia: dict[str, float] = stated(
        "Mean of it over the motion, less that of the rotor: `load` of `to_mjcf`."
    )
    arm: RigidArm = stated("The model.")
    motion: Motion = stated("Smoothed motion of the joints.")
    given: tuple[str, ...] = stated("Joints whose axes the user gave.")
    late: dict[str, float] = stated(
        "Time by which the clock of a joint is behind the others [s], as `without` took it off.",
        default_factory=dict,
    )

    def __getitem__(self, joint: str) -> tuple[FrictionAxis, Record]:
        return self.axes[joint], self.records[joint]

    def __iter__(self) -> Iterator[str]:
        return iter(self.axes)

    def __len__(self) -> int:
        return len(self.axes)

    def motion_of(self, joint: str, late: Mapping[str, float] | None = None) -> Motion:
        """Motion of all joints at the instants of one joint's samples.

        Parameters
        ----------
        joint : str
            Name of the joint.
        late : mapping of str to float, optional
            Times by which the clocks of joints are further behind [s].
        """
        delays = {name: self.late.get(name, 0.0) + (late or {}).get(name, 0.0) for name in self}
        return _shifted(self.motion, self.records, delays, joint)

    def model_errors(self, *, anyway: bool = False) -> tuple[ModelError, ...]:
        """Errors of the model and of the log, see `diagnose_arm`.

        Parameters
        ----------
        anyway : bool, optional
            Whether to go on, with a warning, where the log does not fit the model.

        Raises
        ------
        ValueError
            If the log fits the model only with other units, signs, zeros or joints, or not at all.
        """
        return find_model_errors(self, check_boolean("anyway", anyway))

    def without(self, errors: Sequence[ModelError]) -> ArmRecords:
        """The records with the coupling of the model without some errors.

        A drive that is logged at another scale is put at its own; a joint whose clock is behind
        keeps its samples, and its coupling is that of the instants at which they were taken.

        Parameters
        ----------
        errors : sequence of ModelError
            What `model_errors` found.
        """
        given = {joint: self.axes[joint] for joint in self.given}
        records = dict(self.records)
        late = dict(self.late)
        for error in errors:
            if error.kind == "drive":
                record = records[error.link]
                note = f"u: over {error.value:.4g}, the scale at which the model shows it"
                records[error.link] = record._with_changes(note, u=record.u / error.value)
            elif error.kind == "clock":
                late[error.link] = late.get(error.link, 0.0) + error.value
        return _with_coupling(self.arm.without(errors), records, self.motion, given, late)

    def _summary_parts(self) -> Iterator[str | list[tuple[str, ...]]]:
        # A mass where a joint slides.
        name = base_words(axis for axis, _ in self.values())[0]
        head = ("joint", name, "least", "largest", "unit", "load RMS", "drive RMS", "unit")
        rows: list[tuple[str, ...]] = [head]
        for joint, (axis, record) in self.items():
            least, most = self.inertia[joint]
            sizes = (float(np.sqrt(np.mean(f**2))) for f in (record.known_force, record.u))
            inertia = (f"{one:.4g}" for one in (axis.mass, least, most))
            force = (f"{one:.4g}" for one in sizes)
            rows.append((joint, *inertia, axis.unit("kg"), *force, axis.units[1]))
        yield rows

    def to_dict(self) -> dict[str, Any]:
        """Numbers of the table by joint."""
        return {
            joint: {
                "inertia": axis.mass, "least": self.inertia[joint][0],
                "largest": self.inertia[joint][1],
                "load_rms": float(np.sqrt(np.mean(record.known_force**2))),
                "drive_rms": float(np.sqrt(np.mean(record.u**2))),
            }
            for joint, (axis, record) in self.items()
        }  # fmt: skip


def arm_records(
    model: Any,
    log: Any,
    *,
    axes: Mapping[str, FrictionAxis] | None = None,
    held: Mapping[str, float] | Sequence[str] = (),
    gravity: ArrayLike | None = None,
    payload: Mapping[str, Any] | None = None,
    scaling: Any = None,
    **reading: Any,
) -> ArmRecords:
    """Records of the joints of an arm, coupled by its model.

    Parameters
    ----------
    model : path-like or mujoco.MjModel
        The arm: MJCF, URDF, or a compiled model.  Its joints are hinges and slides with names.
    log : path-like, data frame, or mapping
        One log of all joints, as `read_record` takes it; or a `Record` of each joint by its name.
        Stamps of its own for each joint are put on one clock.
    axes : mapping of str to FrictionAxis, optional
        Nominal axes.  Default: mean inertia over the motion, and friction of the model; the
        Coulomb level of a joint without friction is half of what its drive has beyond the model.
    held : mapping or sequence, optional
        Joints of the model that do not move and are not in the log: their positions, or their
        names, at the reference positions.
    gravity : array_like, shape (3,), optional
        Gravity in the frame of the base [m/s^2], for a base that is not upright.
    payload : mapping, optional
        What a body carries beyond the model: ``{"hand": 0.8}`` [kg] at the origin of its frame,
        or ``{"hand": (0.8, (0.0, 0.0, 0.05))}`` at a place in it.
    scaling : Scaling or mapping, optional
        Factors of encoders and currents of the motors, for all joints or by their names.
    **reading
        Further arguments of `read_record`, such as ``dt=0.01`` where rows were lost.

    Returns
    -------
    ArmRecords
        A mapping of joints to their axis and record.

    Raises
    ------
    ValueError
        If a joint is missing in the log, its units or range are not those of the model, or the
        model has a floating base or a closed chain.
    ImportError
        If MuJoCo is not installed.

    Notes
    -----
    The force of joint j along the smoothed motion without friction is, by MuJoCo's inverse
    dynamics,

    ::

        tau_j = sum_i M_ji(q) a_i + c_j(q, v) + g_j(q)

    with the inertia of the rotors (`armature`) in M and joints that a coupling moves in the row of
    their leader.  The axis has the mean I_j of M_jj over the motion as its mass, and the record the
    load ``-(tau_j - I_j a_j)``, the mean over each sample.  So what the inertia changes over the
    motion acts at the smoothed acceleration; a note says so where it is more than a tenth.

    An acceleration that changes within the smoothing, as at a breakaway, is smeared in the load
    of the *other* joints.

    Examples
    --------
    A pendulum on a slider:

    >>> import numpy as np
    >>> import mujoco
    >>> import dryfric_control as dfc
    >>> model = mujoco.MjModel.from_xml_string('''<mujoco><worldbody>
    ...   <body><joint name="slider" type="slide" axis="1 0 0"/>
    ...     <inertial pos="0 0 0" mass="2" diaginertia="0.1 0.1 0.1"/>
    ...     <body><joint name="swing" axis="0 1 0"/>
    ...       <inertial pos="0 0 -0.5" mass="1" diaginertia="0.01 0.01 0.01"/></body>
    ...   </body></worldbody></mujoco>''')
    >>> t = 1e-2 * np.arange(1000)
    >>> log = {"time": t, "slider.position": 0.1 * np.sin(t), "slider.effort": np.cos(t),
    ...        "swing.position": 0.5 * np.sin(2.0 * t), "swing.effort": 2.5 * np.sin(2.0 * t)}
    >>> found = dfc.arm_records(model, log)
    >>> {joint: round(axis.mass, 2) for joint, (axis, record) in found.items()}
    {'slider': 3.0, 'swing': 0.26}
    """
    arm = RigidArm(model, held, gravity, payload)
    axes = _checked_axes(axes, arm.joints)
    scaling = checked_scaling(scaling, arm.joints)
    records = joint_records(arm, log, scaling, **reading)
    smooth = [record.derivatives() for record in records.values()]
    motion = Motion(*(np.stack(one, axis=1) for one in zip(*smooth, strict=True)))
    return _with_coupling(arm, records, motion, axes)


def _checked_axes(axes: Any, joints: Sequence[str]) -> dict[str, FrictionAxis]:
    """Axes that a user gives, by their joints."""
    if axes is None:
        return {}
    if not isinstance(axes, Mapping):
        raise ValueError(f"axes must be a mapping of joints to dfc.FrictionAxis, got {axes!r}")
    for joint, axis in axes.items():
        if joint not in joints:
            raise ValueError(f"axes: the model has no joint {joint!r}; it has {', '.join(joints)}")
        instance(f"axes[{joint!r}]", axis, FrictionAxis)
    return dict(axes)


def _with_coupling(
    arm: RigidArm,
    records: Mapping[str, Record],
    motion: Motion,
    axes: Mapping[str, FrictionAxis],
    late: Mapping[str, float] | None = None,
) -> ArmRecords:
    """The records with the coupling of a model, and axes where none are given."""
    late = dict(late or {})
    force, inertia = arm.forces(motion)
    if any(late.values()):
        for j, joint in enumerate(records):
            own = arm.forces(_shifted(motion, records, late, joint))
            force[:, j], inertia[:, j] = (one[:, j] for one in own)
    means = inertia.mean(axis=0)
    found = dict[str, FrictionAxis]()
    loaded = dict[str, Record]()
    for j, (joint, record) in enumerate(records.items()):
        unit = arm.units[joint][1]
        refuse_other_robot(joint, record, force[:, j], unit)
        changes = float(np.ptp(inertia[:, j])) / means[j]
        note = f"load: coupling of the model, RMS {np.std(force[:, j]):.3g} {unit}"
        if changes > _CHANGES:
            note += (
                f"; the inertia changes by {percent(changes)}, which acts at the smoothed "
                "acceleration"
            )
        one = loaded[joint] = _with_load(record, force[:, j] - means[j] * motion.a[:, j], note)
        found[joint] = axes.get(joint) or _nominal(joint, arm, means[j], one, motion.v[:, j])
    spans = zip(inertia.min(axis=0).tolist(), inertia.max(axis=0).tolist(), strict=True)
    inertias = dict(zip(records, spans, strict=True))
    bodies = dict(zip(records, (means - arm.rotor_inertia).tolist(), strict=True))
    return ArmRecords(found, loaded, inertias, bodies, arm, motion, tuple(axes), late)


def _shifted(
    motion: Motion, records: Mapping[str, Record], late: Mapping[str, float], joint: str
) -> Motion:
    """Motion of all joints at the instants of one of them, whose clocks are some seconds behind."""
    if not any(late.values()):
        return motion
    moved = Motion(*(one.copy() for one in motion))
    for i, (name, record) in enumerate(records.items()):
        # The sample of `joint` at t was taken at t - late[joint]; another logs that at t + ahead.
        ahead = late.get(name, 0.0) - late.get(joint, 0.0)
        if ahead:
            for one, all_joints in zip(moved, motion, strict=True):
                one[:, i] = np.interp(record.t + ahead, record.t, all_joints[:, i])
    return moved


def _with_load(record: Record, coupling: Floats, note: str) -> Record:
    """A record whose load is a coupling force with the opposite sign, its mean over each sample."""
    notes = tuple(one for one in record.notes if not one.startswith("load: "))
    load = -means_of_samples(coupling)
    return record._with_changes(channels={**record.channels, "load": load}, notes=(*notes, note))


def _nominal(
    joint: str, arm: RigidArm, mass: float, record: Record, velocity: Floats
) -> FrictionAxis:
    """Axis of a joint by its model; a level that nobody has given, by its drive."""
    viscous, level = arm.friction[joint]
    beyond = np.abs(record.net_input[np.abs(velocity) > 0.1 * np.abs(velocity).max()])
    if level == 0.0:
        level = _GUESS * float(np.quantile(beyond, 0.95))
    fast = float(np.quantile(np.abs(velocity), 0.95))
    return FrictionAxis(
        float(mass), viscous, level, name=joint, units=arm.units[joint],  # type: ignore[arg-type]
        stick_speed=1e-3 * fast,
    )  # fmt: skip
