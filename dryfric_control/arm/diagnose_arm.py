"""Diagnose a whole arm: what is wrong with its model, and with each joint."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dryfric_control.arm.arm_records import ArmRecords, arm_records
from dryfric_control.arm.model_errors import ModelError, load_errors, undirected
from dryfric_control.arm.rigid_model import OF_LINKS
from dryfric_control.checks import check_boolean, one_of, positive
from dryfric_control.diagnosis.joints import JointDiagnoses, diagnose_joints
from dryfric_control.estimation.parameters import checked_knowledge
from dryfric_control.estimation.windows import cut
from dryfric_control.model.effects.effect import REGISTRY
from dryfric_control.records.record import Record
from dryfric_control.store.files import file_path
from dryfric_control.text import documented, stated

#: Name among `known` for a model whose masses are right.
MODEL = "model"
# Effects that all joints together have shown or ruled out: errors of masses, scales of drives.  In
# a single joint they would be what the masses still lack, by another name.
_WEIGHT = "gravity"
_SCALE = "input_gain"


@documented
@dataclass(frozen=True, eq=False, repr=False)
class ArmDiagnoses(JointDiagnoses):
    """Diagnoses of the joints of an arm, and errors of its model; made by `diagnose_arm`."""

    model_errors: tuple[ModelError, ...] = stated(
        "What is wrong with masses of the model.", kw_only=True
    )
    nominal: ArmRecords = stated("Records with the coupling of the nominal model.", kw_only=True)
    corrected: ArmRecords = stated(
        "Records with the coupling of the corrected model.", kw_only=True
    )
    undirected: tuple[str, ...] = stated(
        "Joints whose positions and drives may both have the other sign: the log fits as well.",
        default=(),
        kw_only=True,
    )

    @property
    def body_inertia(self) -> dict[str, float]:
        """Inertia of the bodies in the axes of the joints, as `ArmRecords` has it."""
        return self.corrected.body_inertia

    def _summary_parts(self) -> Iterator[str | list[tuple[str, ...]]]:
        named = [error for error in self.model_errors if error.named]
        if not any(error.kind in OF_LINKS for error in named):
            yield "masses of the model: nothing to find"
        for error in named:
            yield f"{'model' if error.kind in OF_LINKS else 'log'}: {error.sentence}"
        unsure = [error.link for error in self.model_errors if not error.named]
        if unsure:
            yield f"model: the motion does not separate the masses of {', '.join(unsure)}"
        if self.undirected:
            yield (
                f"log: it does not show the direction of {', '.join(self.undirected)}: with the "
                "other sign of both position and drive it fits as well"
            )
        yield from super()._summary_parts()

    def to_dict(self) -> dict[str, Any]:
        """`Diagnosis.to_dict` of each joint under "joints", beside what is said of the arm."""
        return {
            "model": [error.to_dict() for error in self.model_errors],
            "undirected": list(self.undirected),
            "joints": super().to_dict(),
        }  # fmt: skip

    def to_html(self, path: str | os.PathLike[str]) -> Path:
        """Write a page on the arm.

        Parameters
        ----------
        path : path-like
            The file; it stands alone.
        """
        from dryfric_control.arm.report import write_page

        return write_page(self, path)


def diagnose_arm(
    model: Any,
    log: Any,
    *,
    known: Sequence[str] = (),
    tolerance: Mapping[str, float] | None = None,
    store: str | os.PathLike[str] | None = None,
    jobs: int | None = None,
    time_limit: float | None = None,
    window: float | None = None,
    hold: str = "zero",
    progress: bool = True,
    anyway: bool = False,
    **options: Any,
) -> ArmDiagnoses:
    """Diagnose an arm: the masses of its model, and its joints.

    Parameters
    ----------
    model, log
        As for `arm_records`.
    known : sequence of str, optional
        Parameters of the joints whose nominal values are right; "model" for the masses of the
        model.
    tolerance, store, jobs, time_limit, window, hold, progress, anyway
        As for `diagnose_joints`; `anyway` goes on, too, where the log does not fit the model.
    **options
        All further arguments of `arm_records`.

    Returns
    -------
    ArmDiagnoses
        A mapping of joints to their `Diagnosis`, which `to_mjcf` and `to_urdf` take as it is.

    Notes
    -----
    First all joints together show errors of the model: mass and centre of mass of each link, and a
    payload at the last one.  The force that the joints need beyond the model while they slide is
    linear in the inertial parameters of the links (Atkeson, An and Hollerbach 1986); friction takes
    part by columns of each joint. An error counts if the evidence of that linear model grows by
    more than a cause must explain, where masses are off by 15 % and centres by a tenth of their
    distance before the log is seen.  A payload is a compact body.  What the motion does not
    separate has alternatives, or is not named.

    Errors of the log are found beside them: the scale of a drive, and a joint whose samples are
    behind those of the others (5 ms standard deviation before the log is seen), by the force of
    the model along the motion at shifted instants.  A joint whose position and drive both have the
    wrong sign moves as before but for its load: where that is too small to show it, `undirected`
    names the joint.  Samples in which another joint starts or stops
    are left out where half of them remain: the smoothing smears its acceleration.

    Then each joint is diagnosed beside the coupling torque of the corrected model.  What the log
    does not show about masses, centres and a payload leaves that torque uncertain: it may change
    by so much in every joint, and only what is beyond it is a cause.  A gravity and a gain of the
    drive are no causes of a single joint there.  A joint that cannot be diagnosed does not end the
    others: it is in `failed`.

    Examples
    --------
    One joint, which turns a table:

    >>> import numpy as np
    >>> import mujoco
    >>> import dryfric_control as dfc
    >>> model = mujoco.MjModel.from_xml_string('''<mujoco><worldbody><body>
    ...   <joint name="table" axis="0 0 1" damping="0.2" frictionloss="1.5"/>
    ...   <inertial pos="0 0 0" mass="2" diaginertia="0.3 0.3 0.3"/></body></worldbody></mujoco>''')
    >>> axis = dfc.FrictionAxis(mass=0.3, viscous=0.2, coulomb=1.5, units=("rad", "N m"))
    >>> t = 2e-3 * np.arange(3000)
    >>> u = 4.0 * np.sin(3.0 * t) + 2.0 * np.sin(11.0 * t)
    >>> x = 1e-5 * np.round(1e5 * axis.simulate(u, dt=2e-3).y[0])
    >>> log = {"time": t, "table.effort": u, "table.position": x}
    >>> found = dfc.diagnose_arm(model, log, progress=False)
    >>> found["table"].verdict, found.model_errors
    ('nothing to find', ())
    """
    check_boolean("anyway", anyway)
    names, tolerance, time_limit = _check_options(known, tolerance, store, time_limit, hold)
    nominal = arm_records(model, log, **options)
    if window is not None:
        for joint, (_, record) in nominal.items():
            _check_window(joint, record, window, hold)
    errors = () if MODEL in names else nominal.model_errors(anyway=anyway)
    corrected = nominal.without(errors) if errors else nominal
    unsure = None if MODEL in names else load_errors(corrected)
    found = diagnose_joints(
        corrected,
        known=_known_of_joints(names),
        tolerance=tolerance,
        window=window,
        hold=hold,
        time_limit=time_limit,
        store=store,
        jobs=jobs,
        progress=progress,
        anyway=anyway,
        load_errors=unsure,
    )
    return ArmDiagnoses(
        found.diagnoses,
        found.failed,
        model_errors=errors,
        nominal=nominal,
        corrected=corrected,
        undirected=undirected(corrected),
    )


def _known_of_joints(names: Sequence[str]) -> tuple[str, ...]:
    """What is known of each joint beside the coupling of the model."""
    shared = (_WEIGHT,) if MODEL in names else (_WEIGHT, _SCALE)
    amounts = tuple(
        f"{slug}.{own}"
        for slug in shared if slug in REGISTRY
        for own in REGISTRY[slug].parameters()
    )  # fmt: skip
    return (*(name for name in names if name != MODEL), *amounts)


def _check_window(joint: str, record: Record, window: float, hold: str) -> None:
    """Refuse a window that the record of a joint does not allow."""
    try:
        cut(record, window, hold)
    except ValueError as problem:
        problem.add_note(f"in joint {joint}")
        raise


def _check_options(
    known: Any, tolerance: Any, store: Any, time_limit: Any, hold: Any
) -> tuple[tuple[str, ...], Any, float | None]:
    """Arguments that are used only after the model, looked at before."""
    names = (known,) if isinstance(known, str) else known
    if not isinstance(names, Iterable):
        raise ValueError(f'known must hold names such as "mass", got {known!r}')
    names = tuple(names)
    _, tolerance = checked_knowledge([name for name in names if name != MODEL], tolerance)
    if store is not None and not file_path("store", store).parent.is_dir():
        raise ValueError(f"store {store} lies in a folder that does not exist: make it first")
    one_of("hold", hold, ("zero", "first"))
    limit = None if time_limit is None else positive("time_limit", time_limit, unit="s")
    return names, tolerance, limit
