"""What is wrong with the model of an arm: masses, centres of mass and a payload.

An error joins if the evidence of the linear model of `error_regression`, with normal distributions
of what a model may be off, grows by more than a cause must explain.

Two errors are of the log: the scale of a drive, and the clock of a joint that is behind the others,
which is linear in the time by which it is.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from dryfric_control.arm.error_regression import (
    Compact,
    Estimate,
    Regression,
    groups_of,
    link_groups,
    sliding_rows,
)
from dryfric_control.arm.rigid_model import means_of_samples
from dryfric_control.arm.wrong_log import Remains, undirected_joints, why_not_this_log
from dryfric_control.arrays import Floats
from dryfric_control.records.record_warning import warn
from dryfric_control.text import Result, documented, stated

if TYPE_CHECKING:
    from dryfric_control.arm.arm_records import ArmRecords

# Most searches for the place of a payload.
_TURNS = 10
# Change of the place of a payload below which they end [m].
_SETTLED = 1e-4
# Standard errors from which a mass among those of all links is named.
_SURE = 2.0
# Most searches after clocks were put right.
_CLOCKS = 2
# Most steps of each by which clocks are put right.
_STEPS = 8
# Step of the clocks that ends them [s].
_SETTLED_CLOCK = 3e-4
# Most directions in which the load of a joint may be off.
_MOST_DIRECTIONS = 4
# Deviation of the load over the standard error of the linear model, whose friction is approximate.
_DEVIATIONS = 2.0
# Most samples of a joint where the log is compared with other readings.
_FEW = 200
# Scale of a drive that may be any.
_ANY = 1e4


@documented
@dataclass(frozen=True, eq=False, repr=False)
class ModelError(Result):
    """An error of the model of an arm; made by `diagnose_arm`."""

    kind: str = stated(
        '"mass", "centre" (of mass) or "payload"; of the log: "drive" (its scale) or "clock".'
    )
    link: str = stated("Link of the model; for an error of the log the joint.")
    value: float = stated(
        "True mass over that of the model; for a payload its mass [kg]; for a centre 1; for a "
        "drive its logged over its true value; for a clock the time by which it is behind the "
        "others [s]."
    )
    standard_error: float = stated("Standard error of the value.")
    place: tuple[float, ...] = stated(
        "Shift of the centre of mass, or place of the payload, in the frame of the link [m]; () "
        "for a mass."
    )
    place_errors: tuple[float, ...] = stated("Standard errors of the place [m].")
    moments: tuple[float, ...] = stated(
        "Second moments of a payload about the frame of the link, xx, yy, zz, xy, xz, yz [kg m^2]; "
        "else ()."
    )
    gain: float = stated("Gain of the logarithm of the evidence.")
    alternatives: tuple[str, ...] = stated("Errors that explain the record as well.")
    named: bool = stated(
        "Whether it is sure by itself; else the motion shows it with other masses alone.", True
    )

    @property
    def sentence(self) -> str:
        """What is wrong, in words."""
        where = ", ".join(f"{round(1e3 * x)}" for x in self.place)
        if self.kind == "payload":
            text = (
                f"payload {self.value:.3g} ± {self.standard_error:.2g} kg at {self.link}, at "
                f"({where}) mm of its frame"
            )
        elif self.kind == "mass":
            percent = 100.0 * (self.value - 1.0)
            text = f"mass of {self.link} {percent:+.1f} ± {100 * self.standard_error:.1f} %"
        elif self.kind == "drive":
            text = (
                f"drive of {self.link} is logged at {self.value:.3g} ± {self.standard_error:.2g} "
                "of the value that the model needs"
            )
        elif self.kind == "clock":
            way = "behind" if self.value > 0.0 else "ahead of"
            off = f"{1e3 * abs(self.value):.2g} ± {1e3 * self.standard_error:.1g} ms"
            text = f"samples of {self.link} are {off} {way} those of the other joints"
        else:
            text = f"centre of mass of {self.link} off by ({where}) mm"
        others = f"; or as well {' or '.join(self.alternatives)}" if self.alternatives else ""
        return text + others

    def _summary_parts(self) -> list[str]:
        return [self.sentence]


class Scale(NamedTuple):
    """Logged over needed drive of a joint."""

    joint: str
    value: float
    standard_error: float


def find_model_errors(records: ArmRecords, anyway: bool = False) -> tuple[ModelError, ...]:
    """Errors of the model that the records of all joints show together.

    Parameters
    ----------
    records : ArmRecords
        Records of the joints, with the coupling of the nominal model.
    anyway : bool, optional
        Whether to go on where the log does not fit the model, with a warning.
    """
    # On small matrices, threads cost more than they gain.
    with threadpool_limits(1):
        errors, unlikely = _search_errors(records)
        why = why_not_this_log(records, errors, unlikely, _any_scales(records), _what_remains)
    if why and not anyway:
        raise ValueError(f"{why}; anyway=True goes on with it as it is")
    if why:
        warn(why)
    return errors


def _search_errors(records: ArmRecords) -> tuple[tuple[ModelError, ...], list[str]]:
    """Errors of the model, and links that deviate from it as hardly any does."""
    late = dict[str, ModelError]()
    right = set[str]()
    regression = _regression_of(records)
    chosen = regression.search()
    for _ in range(_CLOCKS):
        clocks = _clocks_of(regression, chosen)
        if not clocks:
            break
        # The force is linear in small delays only: other errors are found beside clocks put right.
        for _ in range(_STEPS):
            for one in clocks:
                first = late.get(one.link, replace(one, value=0.0))
                late[one.link] = replace(first, value=first.value + one.value)
            regression = _regression_of(_with_clocks(records, late))
            if all(abs(one.value) < _SETTLED_CLOCK for one in clocks):
                break
            clocks = _clocks_of(regression, chosen)
        least = regression.rows.least_late
        small = {name for name, one in late.items() if abs(one.value) < least}
        if small:
            right |= small
            late = {name: one for name, one in late.items() if name not in small}
            regression = _regression_of(_with_clocks(records, late))
        chosen = regression.search(right)
    found = (one for one in _errors_of(regression.estimates(chosen)) if one.kind != "clock")
    return (*late.values(), *found), regression.unlikely_links(chosen)


def _clocks_of(regression: Regression, chosen: Sequence[int]) -> list[ModelError]:
    """Clocks among the chosen groups."""
    return [one for one in _errors_of(regression.estimates(chosen)) if one.kind == "clock"]


def _with_clocks(records: ArmRecords, late: Mapping[str, ModelError]) -> ArmRecords:
    """The records with clocks put right."""
    return replace(records, late=records.late | {name: one.value for name, one in late.items()})


def undirected(records: ArmRecords) -> tuple[str, ...]:
    """Joints of which the log does not show the direction.

    Parameters
    ----------
    records : ArmRecords
        Records with the coupling of the corrected model.
    """
    with threadpool_limits(1):
        return undirected_joints(records, _what_remains)


def load_errors(records: ArmRecords) -> dict[str, Floats]:
    """What the coupling of each joint may still be off, each shape (k, n).

    The covariance of all masses, centres and payloads beside the friction of the joints, as forces
    at each sample: the largest independent directions, each by one standard deviation.  What the
    inertia of the joint makes up for is left out.

    Parameters
    ----------
    records : ArmRecords
        Records with the coupling of the corrected model.
    """
    arm = records.arm
    links = arm.links()
    payloads = {link.name: Compact() for link in links if link.last}
    found = {}
    with threadpool_limits(1):
        rows = sliding_rows(records, links, clocks=False)
        regression = Regression(rows, link_groups(rows.regressor, links, payloads))
        root = _DEVIATIONS * regression.root_of_covariance()
        for j, joint in enumerate(records):
            motion = records.motion_of(joint)
            matrix = arm.regression_matrix(motion, links)[:, j]
            a = motion.a[:, j]
            groups = link_groups(matrix, links, payloads)
            force = np.concatenate([one.columns for one in groups], axis=1) @ root
            force -= np.outer(a, a @ force / max(float(a @ a), 1e-300))
            series, sizes, _ = np.linalg.svd(force, full_matrices=False)
            some = (series * sizes)[:, sizes > 0.0][:, :_MOST_DIRECTIONS].T
            found[joint] = means_of_samples(some)
    return found


def _regression_of(records: ArmRecords) -> Regression:
    """The linear model, with payloads about their places."""
    links = records.arm.links()
    rows = sliding_rows(records, links)
    joints = records.arm.joints
    payloads = {link.name: Compact() for link in links if link.last}
    for _ in range(_TURNS):
        regression = Regression(rows, groups_of(rows, links, joints, payloads))
        payloads, change = regression.update_payloads(payloads)
        if change < _SETTLED:
            break
    return Regression(rows, groups_of(rows, links, joints, payloads))


def _without_errors(records: ArmRecords, drive: float | None) -> Regression:
    """The linear model of few rows with any masses, and scales of the drives if given a spread."""
    links = records.arm.links()
    rows = sliding_rows(records, links, _FEW, clocks=False)
    payloads = {link.name: Compact() for link in links if link.last}
    kinds = ("masses", "payload", *(("drive",) if drive else ()))
    groups = [g for g in groups_of(rows, links, records.arm.joints, payloads) if g.kind in kinds]
    return Regression(
        rows, [g._replace(spread=np.array([drive])) if g.kind == "drive" else g for g in groups]
    )


def _any_scales(records: ArmRecords) -> list[Scale]:
    """Scale of each drive, whatever it is."""
    regression = _without_errors(records, _ANY)
    solved = regression.solve_groups(range(len(regression.groups)))
    return [
        Scale(group.of, 1.0 - float(one.mean[0]), math.sqrt(one.covariance[0, 0]))
        for group, one in zip(regression.groups, solved.values(), strict=True)
        if group.kind == "drive"
    ]


def _what_remains(records: ArmRecords) -> Remains:
    """How well masses and friction explain the drives."""
    regression = _without_errors(records, None)
    rows = regression.rows
    chosen = range(len(regression.groups))
    left = regression.residuals(chosen)
    drive = rows.y + rows.force
    parts = [
        float(np.median(np.abs(left[mine])) / max(np.median(np.abs(drive[mine])), 1e-12))
        for mine in (rows.joint == j for j in range(len(records)))
        if mine.any()
    ]
    part = float(np.log(np.maximum(parts, 1e-6)).sum())
    return Remains(part, not regression.unlikely_links(chosen))


def _errors_of(estimates: Iterable[Estimate]) -> Iterator[ModelError]:
    """Errors of the model and of the log: of masses, one of each link whose mass is another."""
    for group, mean, unsure, gain, others in estimates:
        if group.kind in ("drive", "clock"):
            value = 1.0 - float(mean[0]) if group.kind == "drive" else float(mean[0])
            yield ModelError(
                group.kind, group.of, value, float(unsure[0]), (), (), (), gain, others
            )
        elif group.kind == "centre":
            place = tuple(mean.tolist())
            place_by = tuple(unsure.tolist())
            yield ModelError("centre", group.of, 1.0, 0.0, place, place_by, (), gain, others)
        elif group.payload is not None:
            mass, centre, second = group.payload.body_parameters(mean)
            yield ModelError(
                "payload", group.of, mass, float(unsure[0]), tuple(centre.tolist()),
                tuple(unsure[1:4].tolist()), tuple(second.tolist()), gain, others,
            )  # fmt: skip
        else:
            for link, off, off_by in zip(group.of.split(", "), mean, unsure, strict=True):
                named = group.kind == "mass" or abs(off) > _SURE * off_by
                yield ModelError(
                    "mass", link, 1.0 + float(off), float(off_by), (), (), (), gain, others, named
                )  # fmt: skip
