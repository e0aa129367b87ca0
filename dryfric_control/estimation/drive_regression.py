"""Mass and friction by a regression of the drive on the motion, in a tenth of a second."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from dryfric_control.arrays import Floats
from dryfric_control.estimation.smoothed_motion import (
    SmoothedMotion,
    drive_at_the_mass,
    known_force,
)
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.model.friction import CoulombMap
from dryfric_control.records.record import Record

#: Column of the velocity, which may be left out.
VISCOUS = 1
#: Column of the constant force, which may be left out.
CONSTANT = 3
# Rounds of mass and of the smoothing that its noise asks for.
_ROUNDS = 3
# Samples of smoothed motion that are needed.
_ENOUGH = 50
# Standard errors beyond which a value has a sign.
_CLEAR = 3.0
# Share of the sliding samples either way that tells friction from a constant force.
_EITHER_WAY = 0.05
# Autocorrelation below which samples count as independent.
_UNCORRELATED = 0.05


@dataclass(frozen=True, eq=False)
class DriveRegression:
    """The drive, regressed on acceleration, velocity, direction, a constant and the position.

    All go through one smoothing kernel; a known force on the mass counts as drive.

    Attributes
    ----------
    record : Record
    motion : SmoothedMotion
    values, errors : ndarray, shape (5,)
        Mass, viscous coefficient, Coulomb level, constant force and its slope over the position,
        and their standard errors, of correlated residuals.
    rms : float
        RMS of the drive that is left.
    out : tuple of int
        Columns that are left out, whose values are zero.
    """

    record: Record
    motion: SmoothedMotion
    values: Floats
    errors: Floats
    rms: float
    out: tuple[int, ...] = ()

    @classmethod
    def from_record(cls, record: Record) -> DriveRegression:
        """The regression, with the kernel that the noise of the inertial force asks for."""
        # At most the whole drive accelerates the mass.
        acceleration = float(np.std(record.derivatives().a))
        mass = float(np.std(record.u)) / max(acceleration, 1e-300)
        for _ in range(_ROUNDS):
            motion = SmoothedMotion.from_record(record, mass)
            if motion.places.size < _ENOUGH:
                raise ValueError(
                    f"record slides in {motion.places.size} smoothed samples only, {_ENOUGH} are "
                    "needed: it must move for longer"
                )
            found = cls(record, motion, *_regression(record, motion))
            mass = max(float(found.values[0]), 0.1 * mass)
        return found

    def without(self, column: int) -> DriveRegression:
        """The same without what the motion does not tell from another column."""
        out = (*self.out, column)
        values, errors, rms = _regression(self.record, self.motion, out)
        return replace(self, values=values, errors=errors, rms=rms, out=out)

    @cached_property
    def both_ways(self) -> bool:
        """Whether the motion goes both ways: else a constant force is like the Coulomb level."""
        ahead = float(np.mean(self.motion.direction[self.motion.places] > 0.0))
        return _EITHER_WAY < ahead < 1.0 - _EITHER_WAY

    def is_sure(self, i: int, error: float) -> bool:
        """Whether a value is positive, with at most a relative standard error."""
        return bool(self.errors[i] < error * self.values[i]) and (i != 2 or self.both_ways)

    @property
    def has_opposed_drive(self) -> bool:
        """Whether the drive acts against the acceleration or along friction."""
        mass, level = self._ratios[[0, 2]]
        return bool(mass < -_CLEAR or (self.both_ways and level < -_CLEAR))

    @property
    def _ratios(self) -> Floats:
        """Values over their standard errors."""
        return np.asarray(self.values / np.maximum(self.errors, 1e-300))

    @property
    def has_driving_sign(self) -> bool:
        """Whether the drive acts along the acceleration or against friction."""
        return any(self.is_sure(i, 1.0 / _CLEAR) for i in (0, 2))

    @cached_property
    def exchange(self) -> str:
        """What makes an exchange of drive and position certain; empty where it is not.

        That a drive and a motion show mass and friction depends on no unit or sign of the two.
        """
        if self.has_driving_sign or self.has_opposed_drive:
            return ""
        try:
            with warnings.catch_warnings(action="ignore"):
                other = Record(self.record.t, self.record.x, self.record.u)
                shown = DriveRegression.from_record(other)
        except ValueError:  # what would be the position does not move
            return ""
        mass, level = shown._ratios[[0, 2]]
        if not (shown.both_ways and mass * level > 0.0 and min(abs(mass), abs(level)) > _CLEAR):
            return ""
        return (
            "u and x look exchanged: as drive and position they show neither mass nor friction, "
            'the other way round both: give columns={"u": ..., "x": ...} as the file is read, or '
            "dfc.Record(t, u, x) the drive first"
        )


def _regression(
    record: Record, motion: SmoothedMotion, out: Sequence[int] = ()
) -> tuple[Floats, Floats, float]:
    """Values of a, v, direction, constant and place, their standard errors, RMS of the rest."""
    bare = FrictionAxis(1.0, 0.0, CoulombMap.of(1.0))
    u = drive_at_the_mass(bare, record) + known_force(record)
    middle = motion.x - float(np.mean(motion.x[motion.places]))
    columns = [motion.a, motion.v, motion.direction, np.ones_like(u), middle, u]
    rows = motion.smooth_columns(np.stack(columns, axis=1))
    rows[:, list(out)] = 0.0
    size = np.abs(rows[:, :5]).max(axis=0)
    there = size > 0.0  # what is left out is zero, and so is its error
    terms = rows[:, :5][:, there] / size[there]
    drive = rows[:, 5]
    found = np.linalg.lstsq(terms, drive, rcond=None)[0]
    left = drive - terms @ found
    degrees = max(left.size - found.size, 1)
    variance = float(left @ left) / degrees * _correlation_time(left)
    values = np.zeros((2, 5))
    values[0, there] = found / size[there]
    spreads = variance * np.sum(np.linalg.pinv(terms) ** 2, axis=1)
    values[1, there] = np.sqrt(spreads) / size[there]
    return values[0], values[1], float(np.sqrt(np.mean(left**2)))


def _correlation_time(left: Floats) -> float:
    """Number of samples of a residual that say the same."""
    power = np.abs(np.fft.rfft(left - left.mean(), 2 * left.size)) ** 2
    correlation = np.fft.irfft(power)[: left.size]
    correlation /= max(correlation[0], 1e-300)
    stop = int(np.argmax(correlation < _UNCORRELATED)) or left.size - 1
    return float(1.0 + 2.0 * correlation[1:stop].sum())
