"""A first nominal axis from a record alone, by a regression of the drive on the motion."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from dryfric_control.checks import warn
from dryfric_control.estimation.drive_regression import CONSTANT, VISCOUS, DriveRegression
from dryfric_control.estimation.plausibility import STICK_RATIO
from dryfric_control.identification.fit import FitWarning
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.model.friction import CoulombMap
from dryfric_control.records.data_check import speed_message
from dryfric_control.records.motion import fast_speed, is_undriven
from dryfric_control.records.read import RecordLike, as_record
from dryfric_control.records.record import Record
from dryfric_control.result_table import Quantity, format_table
from dryfric_control.text import Result, documented, page_reference, percent, stated
from dryfric_control.units import usual_units

# Ratio of standard error to value beyond which a parameter is not determined.
_HARDLY = 0.5
# Inertial force of a mass that is not determined, over the Coulomb level, at most.
_FAINT = 0.1
# Drive that is left, over the Coulomb level, from which on its cause may matter.
_LEFT = 0.05
_NAMES = ("mass", "viscous", "coulomb")
# Why a record may not determine them, and what to do.
_MENDS = {
    "mass": "it hardly accelerates, give axis.replace(mass=...) what you know",
    "viscous": "its velocity hardly changes, or other forces hide it",
    "coulomb": "it does not slide slowly both ways, or other forces hide it",
}


@documented
@dataclass(frozen=True, eq=False, repr=False)
class ForceRegression(Result):
    """Mass, viscous friction and Coulomb level from the drive alone.

    Made by `force_regression`.

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> found = dfc.identification.force_regression(dfc.datasets.belt_stage())
    >>> list(found.standard_errors)
    ['mass', 'viscous', 'coulomb']
    """

    axis: FrictionAxis = stated("Axis with these values.")
    parameters: dict[str, float] = stated("Values as the regression gives them.")
    standard_errors: dict[str, float] = stated("Their standard errors, of correlated residuals.")
    constant: float = stated("Constant force beside them, which is not in the axis [N].")
    slope: float = stated("Slope of the force over position beside them, not in the axis [N/m].")
    rms: float = stated("RMS of the drive that is left [N].")
    messages: tuple[str, ...] = stated("What the record does not determine, and a doubtful unit.")

    def table(self, form: str = "markdown") -> str:
        """Values and standard errors as a table.

        Parameters
        ----------
        form : {"markdown", "latex", "csv"}, optional
        """
        units = dict(zip(_NAMES, ("kg", "N s/m", "N"), strict=True))
        rows = [
            (name, Quantity(value, self.standard_errors[name], self.axis.unit(units[name])))
            for name, value in self.parameters.items()
        ]
        return format_table(("parameter", "value"), rows, form)

    def _summary_parts(self) -> Iterator[str | list[list[str]]]:
        lines = [line.strip("| ").split(" | ") for line in self.table().splitlines()]
        yield [lines[0], *lines[2:]]
        force = self.axis.units[1]
        length = self.axis.units[0]
        yield (
            f"left of the drive: {self.rms:.3g} {force} RMS; beside these the drive has a constant "
            f"part of {self.constant:.3g} {force} and {self.slope:.3g} {force}/{length} over "
            "position"
        )
        level = self.axis.coulomb.mean
        if self.rms > _LEFT * level:
            yield (
                f"what is left is {percent(self.rms / level)} of the Coulomb level: where the axis "
                "lacks what makes it, the values are off by more than their errors, those "
                "of noise; fit and diagnose go on from them"
            )
        yield from (f"warning: {message}" for message in self.messages)


def axis_from(record: RecordLike) -> FrictionAxis:
    """A first nominal axis: mass, viscous and Coulomb friction.

    Parameters
    ----------
    record : Record or path-like
        A measured run that accelerates and slides both ways.

    Returns
    -------
    FrictionAxis
        In the units of the record; the errors of its values are those of
        ``dfc.identification.force_regression(record)``.

    Raises
    ------
    ValueError
        If the record hardly moves, no drive acts in it or one of the wrong sign, or its units are
        not of one axis.

    Warns
    -----
    FitWarning
        Where the record does not determine a value, or has no unit and is too fast for metres.

    Notes
    -----
    The drive is regressed on acceleration, velocity and direction of motion, all through one
    smoothing kernel, with a constant force and one linear in position beside them, which are left
    out of the axis: what they are is for `diagnose` to say.  A cause that the axis lacks bends the
    values; `fit` and `diagnose` go on from them.

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> axis = dfc.axis_from(dfc.datasets.belt_stage())
    >>> round(axis.mass, 1), round(axis.coulomb.mean)
    (2.4, 9)
    """
    found = force_regression(record)
    for message in found.messages:
        warn(message, FitWarning)
    return found.axis


def force_regression(record: RecordLike) -> ForceRegression:
    """Mass, viscous friction and Coulomb level with standard errors.

    In a tenth of a second; the notes of `axis_from` say how.

    Parameters
    ----------
    record : Record or path-like
        As in `axis_from`.

    Returns
    -------
    ForceRegression

    Raises
    ------
    ValueError
        If the record hardly moves, or no drive acts in it or one of the wrong sign.

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> found = dfc.identification.force_regression(dfc.datasets.belt_stage())
    >>> round(found.parameters["mass"], 1), round(found.standard_errors["mass"], 3)
    (2.4, 0.007)
    """
    record = as_record(record)
    _check_drive(record)
    found = DriveRegression.from_record(record)
    if found.exchange:
        raise ValueError(f"record: {found.exchange}" + page_reference("troubleshooting"))
    messages = []
    if not found.both_ways:
        found = found.without(CONSTANT)
        messages.append(
            "the record moves one way only: the Coulomb level has what constant force there is; "
            "drive it both ways"
        )
    if not found.errors[2] < _HARDLY * found.values[2]:
        found = found.without(VISCOUS)
        messages.append(
            "viscous and coulomb are not separated by this record, of nearly one velocity: the "
            "level has both, viscous is taken as 0"
        )
    values = found.values
    errors = found.errors
    parameters = dict(zip(_NAMES, values[:3].tolist(), strict=True))
    deviations = dict(zip(_NAMES, errors[:3].tolist(), strict=True))
    if found.has_opposed_drive:
        raise ValueError(
            "record: the drive acts against the acceleration and along friction, as with the wrong "
            "sign: read_record(..., gain=-1) turns the drive, gain={'x': -1.0} the position"
        )
    if not np.any(errors[:3] < _HARDLY * values[:3]):
        shown = ", ".join(f"{k} {v:.3g} +- {deviations[k]:.2g}" for k, v in parameters.items())
        raise ValueError(
            f"record: the drive shows neither mass nor friction ({shown}), so there is no axis to "
            "begin with: check columns and units, and that u is the force that acted"
            + page_reference("troubleshooting")
        )
    if (fast := speed_message(record)) is not None:
        messages.append(fast)
    for name, mend in _MENDS.items():
        is_left_out = name == "viscous" and VISCOUS in found.out
        if not deviations[name] < _HARDLY * parameters[name] and not is_left_out:
            messages.append(
                f"{name} is hardly determined by this record ({parameters[name]:.3g} +- "
                f"{deviations[name]:.2g}): {mend}"
            )
    level = max(float(values[2]), float(errors[2]), 1e-12)
    mass = float(values[0])
    if not errors[0] < _HARDLY * mass:
        # One that hardly matters in this motion.
        mass = _FAINT * level / max(float(np.abs(found.motion.a).max()), 1e-300)
    units = usual_units(record.units)
    axis = FrictionAxis(
        mass=mass, viscous=max(float(values[1]), 0.0), coulomb=CoulombMap.of(level),
        stick_speed=_stick_speed(record, units[0]), name=record.name or "axis",
        units=units,
    )  # fmt: skip
    return ForceRegression(
        axis, parameters, deviations, float(values[3]), float(values[4]), found.rms, tuple(messages)
    )


def _check_drive(record: Record) -> None:
    """Refuse a record in which nothing drives, or whose force is not one along its position."""
    if is_undriven(record):
        raise ValueError(
            "record: neither a drive nor a load acts (u = 0), so the motion shows friction only as "
            "ratios to the mass: give dfc.FrictionAxis(mass=..., viscous=..., coulomb=...) with "
            "the mass that you know, from which diagnose(axis, record) finds the friction"
        )
    length = record.units.get("x")
    force = record.units.get("u")
    if (length, force) in (("m", "N m"), ("rad", "N")):
        turned = "lead= or pinion_radius= [m]" if length == "m" else "pinion_radius= [m]"
        raise ValueError(
            f"record: x is in {length!r} and u in {force!r}, which are not those of one axis: give "
            f"the {turned} of the machine to gain=dfc.Scaling(...) as the file is read"
            + page_reference("howto/read_csv")
        )


def _stick_speed(record: Record, length: str) -> float:
    """Stick velocity that is rest for this record: the default is for machines in m or rad."""
    small = STICK_RATIO * fast_speed(record)
    return min(FrictionAxis.stick_speed, small) if length in ("m", "rad") else small
