"""Force residual of the sliding samples of a record."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.optimize import OptimizeResult, least_squares
from scipy.signal import savgol_coeffs

from dryfric_control.arrays import Floats, Ints
from dryfric_control.compiled.windowed_runs import behind_drive_and_encoder
from dryfric_control.estimation.likelihood import Likelihood
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.model.friction import CoulombMap
from dryfric_control.model.friction_curve import net_force
from dryfric_control.records.motion import directions
from dryfric_control.records.record import Record

# Number of samples used by a regression for the start of a fit; more do not change it
# (`benchmarks/identification.py coverage`).
_REGRESSION_SAMPLES = 5000
# Number of samples that show the force that is missing.
_DISPLAY_SAMPLES = 4000
# Largest acceleration noise of the force that is missing, over Coulomb level / mass.
_MAX_ACCELERATION_NOISE = 0.02
# Longest smoothing to reach it [samples].
_MAX_SMOOTHING = 81
# Difference step of the drive, over its standard deviation, for the sensitivity of the force
# to the drive.
_DRIVE_STEP = 1e-3
# Lower bound of that sensitivity.
_MIN_SENSITIVITY = 1e-6


class Sliding:
    """At most `limit` sliding samples of a record: arrays t, x, v, a, u, load, direction, (n,).

    Position, velocity and acceleration are smoothed over `smoothing` samples, without delay; u and
    load (shape (0,) for none) are the means of what is held before and after each sample, as a is a
    central difference.
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
        kernel = _kernel(size, record.dt) if smooth_drive else None
        drive, load = (_held_mean(one, kernel) for one in (record.u, record.known_force))
        self.smoothing = size
        self.t, self.x = record.t[pick], smooth.x[pick]
        self.v, self.a, self.u = smooth.v[pick], smooth.a[pick], drive[pick]
        self.load = load[pick] if load.size else load
        self.direction = moving[pick].astype(np.int64)

    def _force(self, axis: FrictionAxis, u: Floats, direction: Ints) -> Floats:
        return net_force(axis, self.t, self.x, self.v, u, direction, self.load)

    def force_residual(self, axis: FrictionAxis, direction: Ints | None = None) -> Floats:
        """Force that the axis would need in addition to its drive; friction as in `direction`."""
        direction = self.direction if direction is None else direction
        return np.asarray(axis.mass * self.a - self._force(axis, self.u, direction))

    def answer_to_drive(self, axis: FrictionAxis) -> Floats:
        """Sensitivity of the force on the mass to the drive in these states, shape (n,)."""
        step = _DRIVE_STEP * (float(np.std(self.u)) or 1.0)
        low, high = (self._force(axis, self.u + d, self.direction) for d in (-step, step))
        return np.maximum((high - low) / (2.0 * step), _MIN_SENSITIVITY)


def at_the_samples(force: Floats, hold: str) -> Floats:
    """Held force as the mean before and after each sample, else as it is."""
    return _held_mean(force) if hold == "zero" else force


def _held_mean(force: Floats, kernel: Floats | None = None) -> Floats:
    """Mean of a held force before and after each sample, smoothed by a kernel."""
    mean = 0.5 * (force + np.concatenate((force[:1], force[:-1])))
    if kernel is None or not force.size:
        return mean
    return np.convolve(np.pad(mean, kernel.size // 2, mode="edge"), kernel, "valid")


class Residual(Sliding):
    """Sliding samples with the force that is missing, smoothed as little as friction allows.

    By the shortest window that leaves an acceleration noise of 2 % of level/mass, up to 81 samples.
    """

    def __init__(self, axis: FrictionAxis, record: Record) -> None:
        middle = 0.5 * float(record.x.min() + record.x.max())
        levels = [axis.coulomb(np.array([middle]), s)[0] for s in (1, -1)]
        mean = 0.5 * float(np.sum(np.abs(levels)))
        level = max(mean, 1e-3 * float(np.std(record.u)))
        size = _smoothing_window(record, _MAX_ACCELERATION_NOISE * level / axis.mass)
        super().__init__(record, _DISPLAY_SAMPLES, size, smooth_drive=True)
        self.residual = self.force_residual(axis)


def _smoothing_window(record: Record, allowed: float) -> int:
    """Shortest smoothing window whose acceleration noise is allowed [samples]."""
    longest = min(_MAX_SMOOTHING, ((len(record) - 1) // 4) | 1)
    for size in range(7, longest, 2):
        gain = float(np.linalg.norm(savgol_coeffs(size, 3, deriv=2, delta=record.dt)))
        if gain * record.noise < allowed:
            return size
    return max(longest, 7)


def _kernel(size: int, dt: float) -> Floats:
    """Kernel by which a Savitzky-Golay second derivative smooths the acceleration."""
    second = savgol_coeffs(size, 3, deriv=2, delta=dt)
    kernel = np.zeros(size)
    kernel[1:-1] = np.cumsum(np.cumsum(second))[:-2] * dt**2
    return np.asarray(kernel / kernel.sum())


def net_drive(
    axis: FrictionAxis, x: Floats, v: Floats, u: Floats, actions: Sequence[str]
) -> Floats:
    """Drive after its effects, and the forces of others, that act in some ways."""
    kept = tuple(e for e in axis.effects if e.action in actions)
    bare = FrictionAxis(1.0, 0.0, CoulombMap.of(0.0), effects=kept)
    return net_force(bare, np.zeros(x.size), x, v, u, np.ones(x.size))


def at_the_mass(
    axis: FrictionAxis, record: Record, hold: str = "zero"
) -> tuple[FrictionAxis, Record]:
    """Axis and record with the effects of drive and encoder moved from the axis to the record."""
    axis = axis.effective()
    gone = [e for e in axis.effects if e.action in ("input", "delay", "lag", "reading")]
    if not gone:
        return axis, record
    force = np.empty(len(record))
    x = np.empty(len(record))
    behind_drive_and_encoder(
        axis.arrays(record.dt),
        float(record.t[0]),
        record.dt,
        record.u,
        hold == "first",
        record.x,
        force,
        x,
    )
    kept = tuple(e for e in axis.effects if e not in gone)
    moved = any(e.action == "reading" for e in gone)
    return axis.replace(effects=kept), record.replace(u=force, x=x if moved else None)


def force_start(problem: Likelihood, z: Floats, records: Sequence[Record]) -> Floats:
    """Search coordinates that explain the drive of sliding samples, others as in z."""
    parts = [Sliding(r, _REGRESSION_SAMPLES // len(records)) for r in records]
    count = sum(p.t.size for p in parts)
    if count < 10 * z.size:
        return z
    low, high = problem.low[: z.size], problem.high[: z.size]
    scale = float(np.std(np.concatenate([p.u for p in parts]))) or 1.0

    def residual(point: Floats) -> Floats:
        try:
            axis = problem.axis_at(point)
        except ValueError:
            return np.full(count, 1e3)
        return np.concatenate([p.force_residual(axis) for p in parts]) / scale

    def search_from(start: Floats) -> OptimizeResult:
        robust = {"loss": "soft_l1", "f_scale": 0.1, "max_nfev": 30, "diff_step": 1e-4}
        return least_squares(residual, np.clip(start, low, high), bounds=(low, high), **robust)

    found = search_from(z)
    start = z
    # Of a sine only the part in phase is seen: from the wrong side its amplitude falls to zero.
    for i in np.flatnonzero([p.kind == "angle" for p in problem.parameters]):
        for turn in (0.5, 1.0, 1.5):
            tried = start.copy()
            tried[i] = z[i] + turn * math.pi
            again = search_from(tried)
            if again.cost < found.cost:
                found = again
                start = tried
    return np.asarray(found.x)
