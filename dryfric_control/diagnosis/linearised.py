"""One pass of the filter at a model, and the columns that effects would add to it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property
from typing import cast

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from dryfric_control.compiled import likelihood as compiled
from dryfric_control.compiled.linear import Recursion, adjoint, respond
from dryfric_control.diagnosis.candidates import effect_class
from dryfric_control.diagnosis.problem import Problem
from dryfric_control.diagnosis.thresholds import SAME_FORCE
from dryfric_control.estimation.force_residual import applied
from dryfric_control.estimation.likelihood import Likelihood, Point, recursion
from dryfric_control.estimation.parameters import values_of, with_values
from dryfric_control.model.effects.columns import View, added, difference
from dryfric_control.model.effects.effect import Effect

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

# Shortest period that is searched [encoder increments, and samples], number of peaks, fewest
# periods in the record, and how finely the main lobe is searched.
_SHORTEST, _SOONEST, _PEAKS, _FEWEST, _FINE = 8.0, 10.0, 5, 1.25, 4
# Number of frequencies at which the size of a periodic column is computed; it is interpolated.
_SIZES = 16
#: Relative change of a nominal effect's parameter whose force is a column.
CHANGED = 0.05
# Averaging of the filtered acceleration [samples].
_SMOOTH = 5


class Linearised:
    """Innovations of a model and their linear change by forces and reading errors.

    The records follow each other in all arrays.  It is the `View` of `Effect.columns`.

    Parameters
    ----------
    problem : Problem
    likelihood : Likelihood
    z : ndarray
        Search coordinates of the model.
    """

    def __init__(self, problem: Problem, likelihood: Likelihood, z: FloatArray) -> None:
        self.likelihood, self.z, self.imposed = likelihood, z, problem.imposed
        axis = self.axis = likelihood.axis_at(z, 0)
        self.point = likelihood.at(z)
        records = [run.record for run in likelihood.runs]
        self.slices, self.recursions, at = [], list[Recursion](), 0
        for i, (run, states) in enumerate(zip(likelihood.runs, self.point.states, strict=True)):
            n, dt, one = len(run.record), run.record.dt, likelihood.axis_at(z, i)
            self.slices.append(slice(at, at + n))
            at += n
            self.recursions.append(recursion(one, dt, states, run.w.size > 0))
        out = np.concatenate(self.point.out, axis=1)
        states = np.concatenate(self.point.states, axis=1)
        active = np.concatenate([run.active for run in likelihood.runs])
        for part in self.slices:
            active[part][: compiled.FIRST + 1] = False
        self.ok = active & (out[1] > 0.0) & np.isfinite(out[0])
        s = np.sqrt(np.where(self.ok, out[1], 1.0))
        e = np.where(self.ok, out[0], 0.0) / s
        nu = compiled.FREEDOM
        self.root = np.where(self.ok, np.sqrt((nu + 1.0) / (nu + e * e)), 0.0)
        #: Weight of each innovation: the columns are theirs times it.
        self.scale, self.y = self.root / s, e * self.root
        self.dt, self.quantum = records[0].dt, min(r.resolution.step for r in records)
        self.t = np.concatenate([r.t for r in records])
        self.u = np.concatenate([run.u for run in likelihood.runs])
        loads = [r.known_force for r in records]
        known = any(one.size for one in loads)
        self.load = np.concatenate([
            one if one.size or not known else np.zeros(len(r))
            for one, r in zip(loads, records, strict=True)
        ])  # fmt: skip
        self.x, self.v = states[0], states[1]
        self.a = np.concatenate([
            np.gradient(uniform_filter1d(self.v[part], _SMOOTH)) / self.dt for part in self.slices
        ])  # fmt: skip
        self.direction = np.sign(states[2])
        sides = [axis.coulomb(self.x, side) for side in (1, -1)]
        self.level = np.where(self.direction < 0.0, sides[1], sides[0])
        self.size = max(float(np.mean(self.level)), 1e-3 * float(np.std(self.u)), 1e-300)
        self.middle, self.span = 0.5 * float(self.x.min() + self.x.max()), float(np.ptp(self.x))
        self.fast = max(float(np.quantile(np.abs(self.v), 0.9)), self.quantum / self.duration)
        self.top = float(np.quantile(np.abs(self.drive), 0.999))

    @property
    def duration(self) -> float:
        """Length of the longest record [s]."""
        return max(r.record.duration for r in self.likelihood.runs)

    @cached_property
    def carried(self) -> FloatArray:
        """Load of the transmission: the drive after its gain and limits, and the force effects."""
        return applied(self.axis, self.x, self.v, self.u, ("input", "force"))

    @cached_property
    def drive(self) -> FloatArray:
        """Drive after its gain and limits."""
        return applied(self.axis, self.x, self.v, self.u, ("input",))

    @cached_property
    def lift(self) -> FloatArray:
        """Friction over its level, which a Stribeck peak raises."""
        level = self.direction * self.level
        more = with_values(self.axis, ["coulomb"], [self.axis.coulomb.mean * (1.0 + CHANGED)])
        force = -difference(more, cast(View, self)) / CHANGED
        return np.where(level * force > 0.0, force / np.where(level != 0.0, level, 1.0), 1.0)

    def columns(self, force: FloatArray, reading: FloatArray) -> FloatArray:
        """Weighted changes of the innovations, shape (n, c), see `respond`."""
        out = np.zeros((self.x.size, max(force.shape[1], reading.shape[1])))
        if self.imposed:
            # The innovation is the force that the model would need beside the drive.
            return -force * self.scale[:, None]
        for part, one in zip(self.slices, self.recursions, strict=True):
            f, r = (np.ascontiguousarray(a[part]) for a in (force, reading))
            respond(f, r, one, out[part])
        out *= self.scale[:, None]
        return out

    def of_forces(self, some: Sequence[FloatArray]) -> FloatArray:
        """Columns of forces."""
        return self.columns(np.stack(some, axis=1), np.zeros((0, len(some))))

    def of_readings(self, some: Sequence[FloatArray]) -> FloatArray:
        """Columns of additions to the readings."""
        return self.columns(np.zeros((0, len(some))), np.stack(some, axis=1))

    def of_change(self, point: Point, most: float) -> FloatArray:
        """Column of a model that was simulated, each change at most `most` deviations."""
        out, before = (np.concatenate(one.out, axis=1)[0] for one in (point, self.point))
        change = np.nan_to_num((out - before) * self.scale)
        bound = most * self.root
        return np.clip(change, -bound, bound)

    def base_forces(self, names: Sequence[str]) -> list[FloatArray]:
        """Forces of base parameters, each for a relative change of 1."""
        nominal = dict(zip(names, values_of(self.axis, names), strict=True))
        known = {
            "mass": -self.axis.mass * self.a,
            "viscous": -self.v * (nominal.get("viscous") or self.size / self.fast),
            "coulomb": -self.direction * self.level * self.lift,
        }
        for name in (n for n in names if n not in known):
            more = with_values(self.axis, [name], [nominal[name] * (1.0 + CHANGED)])
            known[name] = difference(more, cast(View, self)) / CHANGED
        return [known[n] for n in names]

    def force_per_unit(self, name: str) -> float:
        """RMS force of a parameter's change by one unit."""
        value = float(values_of(self.axis, [name])[0])
        force = self.base_forces([name])[0]
        return float(np.sqrt(np.mean(force**2))) / max(abs(value), 1e-300)

    def base(self, names: Sequence[str]) -> FloatArray:
        """Columns of base parameters, each for a relative change of 1."""
        return self.of_forces(self.base_forces(names))

    def same_force(
        self, effect: Effect, name: str, names: Sequence[str]
    ) -> tuple[dict[str, float], FloatArray] | None:
        """Values with which another effect acts as one does while the axis slides.

        Also the relative changes of base parameters of these `names` that go with them; None if
        it acts otherwise at all its shapes.
        """
        view, best, found = cast(View, self), SAME_FORCE, None
        values = dict(zip(effect.parameters(), effect.values, strict=True))
        force = added(type(effect), values, view)
        for one in effect_class(name).columns(view):
            columns = [*one.force, *self.base_forces(names)]
            if not one.force or not np.any(force):
                continue
            c, left = self._alike(force, columns)
            if left < best and not (one.positive and c[0] <= 0.0):
                width = len(one.force)
                best, found = left, (one.values(c[:width].tolist()), c[width:])
        return found

    def taken_over(self, effect: Effect, names: Sequence[str]) -> FloatArray:
        """Changes of base parameters of these `names` that act most as an effect does."""
        values = dict(zip(effect.parameters(), effect.values, strict=True))
        force = added(type(effect), values, cast(View, self))
        return self._alike(force, self.base_forces(names))[0] * values_of(self.axis, names)

    def _alike(self, force: FloatArray, columns: Sequence[FloatArray]) -> tuple[FloatArray, float]:
        """Coefficients of the forces that together are nearest to one while sliding; part left."""
        m = np.stack([c * (self.direction != 0.0) for c in columns], axis=1)
        size = np.maximum(np.linalg.norm(m, axis=0), 1e-300)
        c = np.linalg.lstsq(m / size, force, rcond=1e-9)[0] / size
        left = float(np.linalg.norm(force - m @ c)) / max(float(np.linalg.norm(force)), 1e-300)
        return np.asarray(c), left

    def steps(self, names: Sequence[str]) -> FloatArray:
        """Columns of the slopes with free parameters of the model, by differences."""
        found = []
        for j, (name, where) in enumerate(
            zip(self.likelihood.names, self.likelihood.place, strict=True)
        ):
            if name not in names:
                continue
            slopes = []
            for i, part in enumerate(self.slices):
                slope = np.zeros((2, part.stop - part.start))
                if where in (-1, i):
                    self.likelihood.slope(self.z, self.point, i, j, slope)
                slopes.append(slope[0])
            found.append(np.nan_to_num(np.concatenate(slopes)) * self.root)
        return np.stack(found, axis=1) if found else np.zeros((self.x.size, 0))

    def left(self, columns: FloatArray, ridge: float = 1e-6) -> None:
        """Project columns out of the innovations for the search of frequencies."""
        size = np.linalg.norm(columns, axis=0)
        q, r = np.linalg.qr(columns / np.where(size > 0.0, size, 1.0))
        q = q[:, np.abs(np.diag(r)) > ridge]
        self._pull = (self.y - q @ (q.T @ self.y)) * self.root

    @cached_property
    def _slopes(self) -> tuple[FloatArray, FloatArray]:
        """Slopes of the likelihood with the force and the reading at each sample."""
        if self.imposed:
            return self._pull * self.scale / np.where(self.root > 0.0, self.root, 1.0), self._pull
        over = np.where(self.root > 0.0, self.scale / np.where(self.root > 0, self.root, 1.0), 0.0)
        pairs = [
            adjoint(np.ascontiguousarray(self._pull[p] * over[p]), r)
            for p, r in zip(self.slices, self.recursions, strict=True)
        ]
        return np.concatenate([p[0] for p in pairs]), np.concatenate([p[1] for p in pairs])

    def waves(self, kind: str) -> tuple[list[float], float]:
        """Strongest frequencies of "force" or "reading" along x, or of "time"; lobes searched.

        The slopes of the likelihood with the force at each sample, summed over place or time,
        give those with every sine at once, by a Fourier transform.
        """
        force, reading = self._slopes
        along = self.t - self.t.min() if kind == "time" else self.x - self.x.min()
        length = float(np.ptp(along))
        # Along the way samples show no period shorter than twice the way from one to the next.
        moving = np.abs(self.v[self.direction != 0.0])
        step = 2.0 * self.dt * float(np.quantile(moving, 0.25)) if moving.size else 0.0
        shortest = _SOONEST * self.dt if kind == "time" else max(_SHORTEST * self.quantum, step)
        most = min(length / shortest, self.x.size / _SOONEST)
        if not most > 2.0 * _FEWEST:
            return [], 1.0
        bins = 2 ** math.ceil(math.log2(8.0 * most + 64.0))
        place = np.minimum((along / length * bins).astype(int), bins - 1)
        signal = np.bincount(place, reading if kind == "reading" else force, bins)
        power = np.abs(np.fft.rfft(signal, _FINE * bins))[: int(_FINE * most)] ** 2
        wave = np.arange(power.size) / _FINE
        at = np.geomspace(_FEWEST, most, _SIZES)
        angles = 2.0 * np.pi * at * along[:, None] / length
        sines = np.concatenate([np.sin(angles), np.cos(angles)], axis=1)
        none = np.zeros((0, sines.shape[1]))
        found = self.columns(none, sines) if kind == "reading" else self.columns(sines, none)
        size = np.maximum((found**2).sum(axis=0).reshape(2, -1).sum(axis=0), 1e-300)
        power /= np.exp(np.interp(np.log(np.maximum(wave, 1.0)), np.log(at), np.log(size)))
        power[wave < _FEWEST] = 0.0
        peaks: list[float] = []
        while len(peaks) < _PEAKS and power.any():
            k = int(np.argmax(power))
            peaks.append(float(wave[k]) / length)
            power[max(k - _FINE, 0) : k + _FINE + 1] = 0.0
        return peaks, most
