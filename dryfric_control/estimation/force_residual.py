"""Force residual of the sliding samples of a record."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import OptimizeResult, least_squares
from scipy.signal import savgol_coeffs

from dryfric_control.compiled.windowed_runs import accelerations, behind_drive_and_encoder
from dryfric_control.estimation.likelihood import Likelihood
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.model.friction import CoulombMap
from dryfric_control.records.motion import directions
from dryfric_control.records.record import Record

FloatArray = NDArray[np.float64]

# Number of samples used by a regression for the start of a fit, more do not change it
# (`benchmarks/identification.py coverage`), and of those that show the force that is missing.
_ENOUGH, _ENOUGH_TO_SEE = 5000, 4000
# The force that is missing: largest acceleration noise, over Coulomb level / mass, and longest
# smoothing to reach it [samples].
_NOISE, _LONGEST = 0.02, 81
# Difference step of the drive, over its standard deviation, for the sensitivity of the force
# to the drive, and lower bound of that sensitivity.
_STEP, _ANSWERS = 1e-3, 1e-6


class Sliding:
    """Sliding samples of a record with their smoothed motion.

    Parameters
    ----------
    record : Record
        The record.
    limit : int, optional
        Largest number of samples to keep.
    smoothing : int, optional
        Length of the Savitzky-Golay window in samples, odd.  Default: the record's
        `smoothing_window`.
    smooth_drive : bool, optional
        Whether the drive is smoothed by the same window as the acceleration.

    Attributes
    ----------
    t, x, v, a : ndarray, shape (n,)
        Time, and zero-phase position, velocity, acceleration.
    u : ndarray, shape (n,)
        Mean of the held input before and after each sample, which corresponds to
        the acceleration from a central difference.
    direction : ndarray of int64, shape (n,)
    smoothing : int
        Length of the Savitzky-Golay window in samples.
    """

    def __init__(
        self,
        record: Record,
        limit: int | None = None,
        smoothing: int | None = None,
        smooth_drive: bool = False,
    ) -> None:
        size = record.smoothing_window if smoothing is None else smoothing
        smooth = record.derivatives(size)
        # The smoothing must not reach across a start or a stop.
        half = size // 2
        moving = directions(record)
        steady = np.ones(len(record), bool)
        changes = np.flatnonzero(np.diff(moving) != 0)
        for offset in range(-half, half + 2):
            steady[np.clip(changes + offset, 0, len(record) - 1)] = False
        steady[: half + 1] = steady[len(record) - half - 1 :] = False
        pick = np.flatnonzero((moving != 0) & steady & (moving * smooth.v > 0.0))
        if limit is not None and pick.size > limit:
            pick = pick[:: -(-pick.size // limit)]
        drive = 0.5 * (record.u + np.concatenate((record.u[:1], record.u[:-1])))
        if smooth_drive:
            drive = np.convolve(np.pad(drive, half, mode="edge"), _kernel(size, record.dt), "valid")
        self.smoothing = size
        self.t, self.x = record.t[pick], smooth.x[pick]
        self.v, self.a, self.u = smooth.v[pick], smooth.a[pick], drive[pick]
        self.direction = moving[pick].astype(np.int64)

    def force_residual(
        self, axis: FrictionAxis, direction: NDArray[np.int64] | None = None
    ) -> FloatArray:
        """Force that the axis would need in addition to its drive, shape (n,).

        `direction`: direction of motion for the friction; as measured by default.
        """
        direction = self.direction if direction is None else direction
        model = _accelerations(axis, self.t, self.x, self.v, self.u, direction)
        return np.asarray(axis.mass * (self.a - model))

    def answer_to_drive(self, axis: FrictionAxis) -> FloatArray:
        """Sensitivity of the force on the mass to the drive in these states, shape (n,)."""
        step = _STEP * (float(np.std(self.u)) or 1.0)
        ends = [
            _accelerations(axis, self.t, self.x, self.v, self.u + side, self.direction)
            for side in (-step, step)
        ]
        return np.maximum(axis.mass * (ends[1] - ends[0]) / (2.0 * step), _ANSWERS)


class Residual(Sliding):
    """Sliding samples smoothed as little as the friction allows, with the force that is missing.

    The smoothing is the shortest that leaves an acceleration noise of 2 % of level/mass, up to
    81 samples.

    Attributes
    ----------
    residual : ndarray, shape (n,)
        Force that the axis would need in addition to its drive.

    Examples
    --------
    A missing bias force is the residual at every sample:

    >>> import numpy as np
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    >>> t = 1e-3 * np.arange(4000)
    >>> u = 20.0 * np.sin(6.0 * t)
    >>> pushed = axis.replace(effects=(dfc.effects.BiasForce(force=1.5),))
    >>> x = pushed.simulate(u, dt=1e-3).y[0]
    >>> round(float(np.median(Residual(axis, dfc.Record(t, u, x)).residual)), 2)
    1.5
    """

    def __init__(self, axis: FrictionAxis, record: Record) -> None:
        middle = 0.5 * float(record.x.min() + record.x.max())
        levels = [axis.coulomb(np.array([middle]), s)[0] for s in (1, -1)]
        level = max(0.5 * float(np.sum(np.abs(levels))), 1e-3 * float(np.std(record.u)))
        super().__init__(
            record, _ENOUGH_TO_SEE, _quiet(record, _NOISE * level / axis.mass), smooth_drive=True
        )
        self.residual = self.force_residual(axis)


def _quiet(record: Record, allowed: float) -> int:
    """Shortest smoothing window whose acceleration noise is allowed [samples]."""
    longest = min(_LONGEST, ((len(record) - 1) // 4) | 1)
    for size in range(7, longest, 2):
        gain = float(np.linalg.norm(savgol_coeffs(size, 3, deriv=2, delta=record.dt)))
        if gain * record.noise < allowed:
            return size
    return max(longest, 7)


def _kernel(size: int, dt: float) -> FloatArray:
    """Kernel by which a Savitzky-Golay second derivative smooths the acceleration."""
    second = savgol_coeffs(size, 3, deriv=2, delta=dt)
    kernel = np.zeros(size)
    kernel[1:-1] = np.cumsum(np.cumsum(second))[:-2] * dt**2
    return np.asarray(kernel / kernel.sum())


def _accelerations(
    axis: FrictionAxis,
    t: FloatArray,
    x: FloatArray,
    v: FloatArray,
    u: FloatArray,
    direction: NDArray[np.int64],
) -> FloatArray:
    """Acceleration of the sliding mode at given states, shape (n,)."""
    arrays = axis.arrays(1.0)
    found = np.empty(x.size)
    accelerations(arrays.numbers, arrays.integers, t, x, v, u, direction, found)
    return found


def forces(
    axis: FrictionAxis, x: FloatArray, v: FloatArray, u: FloatArray, direction: NDArray[np.int64]
) -> FloatArray:
    """Force on the sliding mass minus the drive, shape (n,)."""
    return np.asarray(axis.mass * _accelerations(axis, np.zeros(x.size), x, v, u, direction) - u)


def applied(
    axis: FrictionAxis, x: FloatArray, v: FloatArray, u: FloatArray, actions: Sequence[str]
) -> FloatArray:
    """Drive after its effects, and the forces of others, that act in some ways."""
    kept = tuple(e for e in axis.effects if e.action in actions)
    bare = FrictionAxis(1.0, 0.0, CoulombMap.of(0.0), effects=kept)
    return u + forces(bare, x, v, u, np.ones(x.size, np.int64))


def at_the_mass(
    axis: FrictionAxis, record: Record, hold: str = "zero"
) -> tuple[FrictionAxis, Record]:
    """Axis and record with the effects of drive and encoder moved into the record.

    Gain, dead zone, saturation, delay and lag of the drive are applied to the input,
    encoder errors are removed from the positions, and the axis is without these effects.

    Examples
    --------
    >>> import numpy as np
    >>> import dryfric_control as dfc
    >>> t = 1e-3 * np.arange(2000)
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0, effects=(
    ...     dfc.effects.InputGain(gain=1.2), dfc.effects.InputDelay(delay=4e-3)))
    >>> bare, behind = at_the_mass(axis, dfc.Record(t, t, np.sin(t)))
    >>> bare.effects, round(float(behind.u[1000]), 6)     # 1.2 (1 - 0.004)
    ((), 1.1952)
    """
    axis = axis.effective()
    gone = [e for e in axis.effects if e.action in ("input", "delay", "lag", "reading")]
    if not gone:
        return axis, record
    force, x = np.empty(len(record)), np.empty(len(record))
    behind_drive_and_encoder(
        axis.arrays(record.dt), float(record.t[0]), record.dt, record.u, hold == "first",
        record.x, force, x,
    )  # fmt: skip
    kept = tuple(e for e in axis.effects if e not in gone)
    moved = any(e.action == "reading" for e in gone)
    return axis.replace(effects=kept), record.replace(u=force, x=x if moved else None)


def force_start(problem: Likelihood, z: FloatArray, records: Sequence[Record]) -> FloatArray:
    """Search coordinates that explain the drive force of sliding samples.

    Parameters
    ----------
    problem : Likelihood
        The problem, for its parameters and bounds.
    z : ndarray, shape (nparameters,)
        Starting point; coordinates that the sliding samples do not determine stay there.
    records : sequence of Record
        The records.

    Returns
    -------
    ndarray, shape (nparameters,)
    """
    parts = [Sliding(r, _ENOUGH // len(records)) for r in records]
    if sum(p.t.size for p in parts) < 10 * z.size:
        return z
    low, high = problem.low[: z.size], problem.high[: z.size]
    scale = float(np.std(np.concatenate([p.u for p in parts]))) or 1.0

    def residual(point: FloatArray) -> FloatArray:
        try:
            axis = problem.axis_at(point)
        except ValueError:
            return np.full(sum(p.t.size for p in parts), 1e3)
        return np.concatenate([p.force_residual(axis) for p in parts]) / scale

    def searched(start: FloatArray) -> OptimizeResult:
        return least_squares(
            residual,
            np.clip(start, low, high),
            bounds=(low, high),
            loss="soft_l1",
            f_scale=0.1,
            max_nfev=30,
            diff_step=1e-4,
        )

    found, start = searched(z), z
    # Of a sine only the part in phase is seen: from the wrong side its amplitude falls to zero.
    for i in np.flatnonzero([p.kind == "angle" for p in problem.parameters]):
        for turn in (0.5, 1.0, 1.5):
            tried = start.copy()
            tried[i] = z[i] + turn * math.pi
            again = searched(tried)
            if again.cost < found.cost:
                found, start = again, tried
    return np.asarray(found.x)
