"""A first guess for a fit: regression of the force residual."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from dryfric_control.compiled.free_runs import accelerations
from dryfric_control.estimation.motion import directions
from dryfric_control.estimation.problem import Problem
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.records.record import Record

FloatArray = NDArray[np.float64]

# Samples that the regression reads; more do not make a better start.
_ENOUGH = 5000


class Sliding:
    """Sliding samples of a record with their smoothed motion.

    Parameters
    ----------
    record : Record
        The record.
    limit : int, optional
        Largest number of samples to keep.

    Attributes
    ----------
    t, x, v, a : ndarray, shape (n,)
        Time, and zero-phase position, speed, acceleration.
    u : ndarray, shape (n,)
        Mean of the held input before and after each sample, which is what a
        central difference sees.
    direction : ndarray of int64, shape (n,)
    """

    def __init__(self, record: Record, limit: int | None = None) -> None:
        smooth = record.derivatives()
        # The smoothing must not reach across a start or a stop.
        half = record.smoothing_window // 2
        moving = directions(record)
        steady = np.ones(len(record), bool)
        changes = np.flatnonzero(np.diff(moving) != 0)
        for offset in range(-half, half + 2):
            steady[np.clip(changes + offset, 0, len(record) - 1)] = False
        steady[: half + 1] = steady[len(record) - half - 1 :] = False
        pick = np.flatnonzero((moving != 0) & steady & (moving * smooth.v > 0.0))
        if limit is not None and pick.size > limit:
            pick = pick[:: -(-pick.size // limit)]
        self.t, self.x = record.t[pick], smooth.x[pick]
        self.v, self.a = smooth.v[pick], smooth.a[pick]
        self.u = 0.5 * (record.u[pick] + record.u[np.maximum(pick - 1, 0)])
        self.direction = moving[pick].astype(np.int64)

    def residual(self, axis: FrictionAxis) -> FloatArray:
        """Drive that the axis would need less the drive it had, shape (n,)."""
        arrays = axis.arrays(1.0)
        model = np.empty(self.t.size)
        accelerations(
            arrays.numbers, arrays.integers, self.t, self.x, self.v, self.u, self.direction, model
        )
        return np.asarray(axis.mass * (self.a - model))


def forces(
    axis: FrictionAxis, x: FloatArray, v: FloatArray, u: FloatArray, direction: NDArray[np.int64]
) -> FloatArray:
    """Force with which an axis' sliding mode differs from the drive, shape (n,)."""
    arrays = axis.arrays(1.0)
    model = np.empty(x.size)
    accelerations(arrays.numbers, arrays.integers, np.zeros(x.size), x, v, u, direction, model)
    return np.asarray(axis.mass * model - u)


def force_start(problem: Problem, z: FloatArray, records: Sequence[Record]) -> FloatArray:
    """Search coordinates that explain the drive force of sliding samples.

    Parameters
    ----------
    problem : Problem
        The problem, for its parameters and bounds.
    z : ndarray, shape (nparameters,)
        Where to start from; what the sliding samples do not show stays there.
    records : sequence of Record
        The records.

    Returns
    -------
    ndarray, shape (nparameters,)
    """
    parts = [Sliding(r, _ENOUGH // len(records)) for r in records]
    if sum(p.t.size for p in parts) < 10 * z.size:
        return z
    scale = float(np.std(np.concatenate([p.u for p in parts]))) or 1.0

    def residual(point: FloatArray) -> FloatArray:
        try:
            axis = problem.model_at(point).axis
        except ValueError:
            return np.full(sum(p.t.size for p in parts), 1e3)
        return np.concatenate([p.residual(axis) for p in parts]) / scale

    inside = np.clip(z, problem.low, problem.high)
    found = least_squares(
        residual,
        inside,
        bounds=(problem.low, problem.high),
        loss="soft_l1",
        f_scale=0.1,
        max_nfev=30,
        diff_step=1e-4,
    )
    return np.asarray(found.x)
