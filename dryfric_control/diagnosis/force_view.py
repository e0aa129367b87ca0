"""The force that the motion needs and the model lacks, and the columns that effects add to it.

    S u = m S a + f S v + S F + S (missing force),

with one smoothing kernel S for all terms, in the samples that slide.  The regression is linear,
global and robust against a wrong base: it proposes causes before any fit.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from dryfric_control.arrays import Floats
from dryfric_control.diagnosis.model_view import ModelView
from dryfric_control.diagnosis.problem import Problem
from dryfric_control.estimation.force_residual import at_the_mass, at_the_samples
from dryfric_control.estimation.likelihood import BASE_LOG_DEVIATION, load_error_names
from dryfric_control.estimation.parameters import SHIFT, values_of, with_values
from dryfric_control.estimation.smoothed_motion import drive_at_the_mass, known_force, missing_force
from dryfric_control.model.axis import FrictionAxis

# Autocorrelation below which samples count as independent.
_UNCORRELATED = 0.05
# Longest delay of the drive that is looked for, over the length of the record.
_LATEST = 0.03
# Number of delays, or limits, on a grid, and on the finer one around the best of them.
_GRID = 12
# Number of knots of the curve of the drive.
_KNOTS = 9
# Largest ratio of the squares that are left with a delay, or a limit, to those without it.
_HALVED = 0.5
# Largest part of the squared force of the motion that the curve, or the limited drive, leaves.
_EXPLAINED = 0.2
# Relative step of a free parameter whose column is a difference.
_STEP = 1e-3


class ForceView(ModelView):
    """Force residual of an axis in the sliding samples of the records.

    Parameters
    ----------
    problem : Problem
    axis : FrictionAxis
        The model.
    """

    # The bias of the smoothing is of that size.
    least_fall = 0.96

    def __init__(self, problem: Problem, axis: FrictionAxis) -> None:
        self.problem, self.axis = problem, axis
        self.motions = problem.motions
        records = [m.record for m in self.motions]
        ends = np.cumsum([0, *(len(r) for r in records)])
        self.slices = [slice(a, b) for a, b in zip(ends[:-1], ends[1:], strict=True)]
        self.dt = records[0].dt
        self.quantum = min(r.resolution.step for r in records)
        self.duration = max(r.duration for r in records)
        self.t = np.concatenate([r.t for r in records])
        self.readings = np.concatenate([r.x for r in records])
        self.x = np.concatenate([m.x for m in self.motions])
        self.v = np.concatenate([m.v for m in self.motions])
        self.a = np.concatenate([m.a for m in self.motions])
        self.direction = np.concatenate([m.direction for m in self.motions])
        self.u = self._drive_at_the_mass(axis)
        hold = problem.hold
        self.load = np.concatenate([known_force(m.record, hold) for m in self.motions])
        self.scale = 1.0
        self.y = self._smooth_forces([self._missing(axis)])[:, 0]
        self._set_scale()

    def _drive_at_the_mass(self, axis: FrictionAxis) -> Floats:
        # As recorded: the kernel takes off what noise it can on both sides.
        hold = self.problem.hold
        return np.concatenate([drive_at_the_mass(axis, m.record, hold) for m in self.motions])

    def _missing(self, axis: FrictionAxis, u: Floats | None = None) -> Floats:
        """Force that the motion needs beyond what the axis has, shape (n,)."""
        u = self.u if u is None else u
        rows = zip(self.motions, self.slices, strict=True)
        found = [missing_force(axis, m, u[part], self.load[part]) for m, part in rows]
        needed = np.concatenate(found)
        if not any(effect.action == "reading" for effect in axis.effects):
            return needed
        hold = self.problem.hold
        errors = [m.record.x - at_the_mass(axis, m.record, hold)[1].x for m in self.motions]
        return needed - self._moving_force(np.concatenate(errors))

    def _smooth_forces(self, some: Sequence[Floats]) -> Floats:
        columns = np.stack(some, axis=1)
        rows = zip(self.motions, self.slices, strict=True)
        return np.concatenate([m.smooth_columns(columns[part]) for m, part in rows])

    def _set_scale(self) -> None:
        """The unit of the residual: what the base leaves; and the number of independent samples."""
        columns = self._smooth_forces(
            self.base_forces(self.problem.base) or [np.zeros(self.x.size)]
        )
        ridge = np.eye(columns.shape[1]) / BASE_LOG_DEVIATION
        left = self.y
        unit = max(float(np.std(self.y)), 1e-300)
        for _ in range(2):
            # The prior of the base counts in units of what is left, by its independent samples.
            rows = np.concatenate((columns / unit, ridge))
            aim = np.concatenate((self.y / unit, np.zeros(len(ridge))))
            left = self.y - columns @ np.linalg.lstsq(rows, aim, rcond=None)[0]
            time = self.correlation_time(left)
            unit = max(float(np.sqrt(np.mean(left**2) * time)), 1e-300)
        self.scale = 1.0 / unit
        self.y = self.y * self.scale
        self.count = self.effective_sample_size(left)

    def effective_sample_size(self, left: Floats) -> float:
        return left.size / self.correlation_time(left)

    def correlation_time(self, left: Floats) -> float:
        """Number of samples of a residual that say the same thing; each breakaway is one."""
        if left.size < 3 or self.problem.moves_in_jumps:
            return 1.0
        power = np.abs(np.fft.rfft(left - left.mean(), 2 * left.size)) ** 2
        c = np.fft.irfft(power)[: left.size]
        stop = int(np.argmax(c < _UNCORRELATED * c[0])) or left.size - 1
        return float(1.0 + 2.0 * c[1:stop].sum() / max(c[0], 1e-300))

    @property
    def squares(self) -> float:
        """Sum of the squares of the force that is missing [N^2]."""
        return float(self.y @ self.y) / self.scale**2

    def late_drive(self) -> tuple[float, float]:
        """Delay [s] and limit [N] with which the drive gives the force of the motion.

        Zero and infinity where they do not halve what is left, or leave more than a fifth of the
        force: what mutes the drive leaves all of it; and where there is no drive.  The delay is
        that of a curve h(u(t - d)), piecewise linear: a gain, a limit and a dead zone are shapes of
        it, so none of them hides a delay.
        """
        if not self.u.any():
            return 0.0, math.inf
        none = np.zeros(self.u.size)
        needed = self._smooth_forces([self._missing(self.axis, none)])[:, 0]
        longest = min(_LATEST * self.duration / self.dt, 0.05 * self.x.size)
        late = _minimise_on_grid(
            lambda d: self._left_by_curve(needed, round(d)), 1.0, max(longest, 2.0)
        )
        late = round(late)
        most = _EXPLAINED * float(needed @ needed)
        if self._left_by_curve(needed, late) > min(_HALVED * self._left_by_curve(needed, 0), most):
            late = 0
        u = self._delayed_drive(late)
        size = np.abs(u).max()

        def left(limit: float) -> float:
            rest = needed - self._smooth_forces([np.clip(u, -limit, limit)])[:, 0]
            return float(rest @ rest)

        limit = _minimise_on_grid(left, 1e-3 * size, size)
        limited = left(limit) < min(_HALVED * left(size), most)
        return late * self.dt, limit if limited else math.inf

    def _delayed_drive(self, samples: int) -> Floats:
        """Drive some samples later."""
        drives = [self.u[part] for part in self.slices]
        late = [np.pad(one, (samples, 0), mode="edge")[: one.size] for one in drives]
        return np.concatenate(late)

    def _left_by_curve(self, needed: Floats, late: int) -> float:
        """Squares of the force of the motion that a curve of the late drive leaves."""
        u = self._delayed_drive(late)
        knots = np.unique(np.quantile(u, np.linspace(0.0, 1.0, _KNOTS)))
        if knots.size < 2:
            return float(needed @ needed)
        columns = self._smooth_forces([np.interp(u, knots, row) for row in np.eye(knots.size)])
        left = needed - columns @ np.linalg.lstsq(columns, needed, rcond=None)[0]
        return float(left @ left)

    def of_forces(self, some: Sequence[Floats]) -> Floats:
        # A force that the model gains is missing no more.
        return -self.scale * self._smooth_forces(some)

    def of_readings(self, some: Sequence[Floats]) -> Floats:
        # The machine moves by as much less than its readings.
        return -self.scale * self._smooth_forces([self._moving_force(one) for one in some])

    def _moving_force(self, path: Floats) -> Floats:
        """Force that moves the axis by an addition to its path, shape (n,)."""
        found = []
        for part in self.slices:
            v = np.gradient(path[part], self.dt)
            found.append(self.axis.mass * np.gradient(v, self.dt) + self.axis.viscous * v)
        return np.concatenate(found)

    def steps(self, names: Sequence[str]) -> Floats:
        found = []
        errors = self._load_errors()
        # Of an amount with a prior the size of the column counts, of others its direction.
        keep = np.isin(names, list(errors))
        now = self._missing(self.axis)
        for name in names:
            if name in errors:
                found.append(-errors[name])
                continue
            if name == SHIFT:
                found.append(np.gradient(self.u))
                continue
            value = float(values_of(self.axis, [name])[0])
            step = _STEP * (abs(value) or self.size)
            try:
                other = with_values(self.axis, [name], [value + step])
            except ValueError:
                other = with_values(self.axis, [name], [value - step])
            found.append(self._missing(other, self._drive_at_the_mass(other)) - now)
        if not found:
            return np.zeros((self.y.size, 0))
        columns = self.scale * self._smooth_forces(found)
        size = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
        return np.asarray(columns / np.where(keep, 1.0, size))

    def _load_errors(self) -> dict[str, Floats]:
        """Forces by which the known loads may be off, by the names of their amounts."""
        runs = self.problem.runs
        found = {}
        for k, name in enumerate(load_error_names(runs)):
            parts = [
                at_the_samples(run.load_errors[k], self.problem.hold)
                if k < len(run.load_errors) else np.zeros(len(run.record))
                for run in runs
            ]  # fmt: skip
            found[name] = np.concatenate(parts)
        return found

    def slopes(self, left: Floats) -> tuple[Floats, Floats]:
        at = 0
        found = []
        for motion in self.motions:
            end = at + motion.places.size
            found.append(motion.spread(left[at:end]))
            at = end
        force = np.concatenate(found) * self.scale
        # The adjoint of `_moving_force`: a difference in time is that of its opposite.
        reading = []
        for part in self.slices:
            rate = np.gradient(force[part], self.dt)
            reading.append(self.axis.mass * np.gradient(rate, self.dt) - self.axis.viscous * rate)
        return force, np.concatenate(reading)


def _minimise_on_grid(function: Callable[[float], float], low: float, high: float) -> float:
    """Argument with the least value of a function, on a geometric grid and between its points."""
    for _ in range(2):
        grid = np.geomspace(low, high, _GRID)
        k = int(np.argmin([function(one) for one in grid]))
        low = grid[max(k - 1, 0)]
        high = grid[min(k + 1, _GRID - 1)]
    return float(grid[k])
