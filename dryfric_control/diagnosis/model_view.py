"""A model in its records as effects see it: states, typical sizes, and forces of its parameters."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import cached_property
from typing import Any, cast

import numpy as np

from dryfric_control.arrays import Floats
from dryfric_control.compiled.linear import behind_bristles
from dryfric_control.diagnosis.candidates import effect_class
from dryfric_control.diagnosis.thresholds import MIN_PERIODS, NEGLIGIBLE_RATIO
from dryfric_control.estimation.force_residual import net_drive
from dryfric_control.estimation.likelihood import Point
from dryfric_control.estimation.parameters import values_of, with_values
from dryfric_control.estimation.smoothed_motion import distance_since_reversal
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.model.effects.columns import (
    View,
    difference,
    effect_contribution,
    friction,
)
from dryfric_control.model.effects.effect import Effect
from dryfric_control.model.friction import middle_level

#: Relative change of a nominal effect's parameter whose force is a column.
CHANGED = 0.05
# Shortest period that is searched over position, in encoder increments.
_SHORTEST_INCREMENTS = 8.0
# Shortest period that is searched over time, in samples.
_SHORTEST_SAMPLES = 10.0
# Number of spectral peaks that become columns.
_PEAKS = 5
# Frequencies per main lobe of the spectrum.
_PER_LOBE = 4
# Number of frequencies at which the size of a periodic column is computed; it is interpolated.
_SIZES = 16
# Lengths after a reversal or a start over which friction may still build up: the shortest one in
# increments of the readings and as a part of the travel, the longest one as a part of the travel.
_SHORTEST_BUILDUP_INCREMENTS = 2.0
_SHORTEST_BUILDUP = 1e-5
_LONGEST_BUILDUP = 0.1
_BUILDUPS = 12


class ModelView:
    """States of a model in its records, one after the other: the `View` of `Effect.columns`.

    A subclass sets the arrays below, and says how a small force changes what it compares with the
    data, in the units of its weighted residual y.

    Attributes
    ----------
    axis : FrictionAxis
        The model.
    t, x, v, a, u : ndarray, shape (n,)
        Time, position, velocity, acceleration and drive.
    load : ndarray, shape (n,) or (0,)
        Known force on the mass.
    direction : ndarray, shape (n,)
        Direction of sliding, 0 at rest.
    y : ndarray, shape (m,)
        Weighted residual.
    slices : list of slice
        Samples of each record.
    count : float
        Number of independent residuals.
    dt, quantum, duration : float
        Sampling time [s], resolution of the readings [m] and length of the longest record [s].
    """

    axis: FrictionAxis
    t: Floats
    readings: Floats
    x: Floats
    v: Floats
    a: Floats
    u: Floats
    load: Floats
    direction: Floats
    y: Floats
    scale: Any  # of the residual, over what it is a residual of
    slices: list[slice]
    count: float
    dt: float
    quantum: float
    duration: float
    #: Largest ratio of the squared residual after to before with which an effect may join.
    least_fall = 1.0

    def effective_sample_size(self, left: Floats) -> float:
        """Number of independent samples of a residual."""
        return self.count

    def of_forces(self, some: Sequence[Floats]) -> Floats:
        """Weighted changes of the residual by forces, shape (m, len(some))."""
        raise NotImplementedError

    def of_readings(self, some: Sequence[Floats]) -> Floats:
        """The same by additions to the readings; nothing where these are not predicted."""
        return np.zeros((self.y.size, len(some)))

    def of_change(self, point: Point, most: float) -> Floats:
        """Column of a model that was simulated, each change at most `most` deviations."""
        raise NotImplementedError

    def slopes(self, left: Floats) -> tuple[Floats, Floats]:
        """Slopes of half the squared residual `left` with the force and the reading of a sample."""
        raise NotImplementedError

    def steps(self, names: Sequence[str]) -> Floats:
        """Columns of the slopes with free parameters of the model's effects, shape (m, c)."""
        raise NotImplementedError

    @cached_property
    def level(self) -> Floats:
        """Coulomb level in the direction of motion [N]."""
        sides = [self.axis.coulomb(self.x, side) for side in (1, -1)]
        return np.where(self.direction < 0.0, sides[1], sides[0])

    @cached_property
    def size(self) -> float:
        """Typical Coulomb level [N]."""
        return max(float(np.mean(self.level)), 1e-3 * float(np.std(self.u)), 1e-300)

    @cached_property
    def middle(self) -> float:
        """Middle of the travel [m]."""
        return 0.5 * float(self.x.min() + self.x.max())

    @cached_property
    def span(self) -> float:
        """Length of the travel [m]."""
        return float(np.ptp(self.x))

    @cached_property
    def fast(self) -> float:
        """Largest usual speed, of its motion where it rests most of the time [m/s]."""
        least = self.quantum / self.duration
        usual = float(np.quantile(np.abs(self.v), 0.9))
        slides = self.direction != 0.0
        if usual <= least and slides.any():
            usual = float(np.quantile(np.abs(self.v[slides]), 0.9))
        return max(usual, least)

    @cached_property
    def top(self) -> float:
        """Largest usual drive [N]."""
        return float(np.quantile(np.abs(self.drive), 0.999))

    @cached_property
    def carried(self) -> Floats:
        """Load of the transmission: the drive after its gain and limits, less the other forces."""
        forces = net_drive(self.axis, self.x, self.v, self.u, ("input", "force")) - self.drive
        return self.drive - forces - (self.load if self.load.size else 0.0)

    @cached_property
    def drive(self) -> Floats:
        """Drive after its gain and limits."""
        return net_drive(self.axis, self.x, self.v, self.u, ("input",))

    @cached_property
    def largest_force(self) -> float:
        """Norm over all samples of the drive, or of the force of the mass if that is more."""
        return max(float(np.linalg.norm(self.u)), self.axis.mass * float(np.linalg.norm(self.a)))

    @cached_property
    def lift(self) -> Floats:
        """Friction over its level, which a Stribeck peak raises."""
        level = self.direction * self.level
        more = with_values(self.axis, ["coulomb"], [self.axis.coulomb.mean * (1.0 + CHANGED)])
        force = -difference(more, cast(View, self)) / CHANGED
        return np.where(level * force > 0.0, force / np.where(level != 0.0, level, 1.0), 1.0)

    @cached_property
    def bristle_length(self) -> float:
        """Length over which bristles of the model build their force up [m]; 0 without bristles."""
        inner = (e.inner(self.axis) for e in self.axis.effects)
        stiffness = next((i.contact for i in inner if i.bristles > 0.0), 0.0)
        level = middle_level(self.axis.coulomb, self.axis.travel)
        return level / stiffness if stiffness > 0.0 else 0.0

    def behind_bristles(self, force: Floats) -> Floats:
        """A friction force, as its level alone would give it, behind the bristles of the model."""
        if not self.bristle_length > 0.0:
            return force
        level = -self.direction * force
        parts = [
            behind_bristles(level[part], self.x[part], self.bristle_length) for part in self.slices
        ]
        return np.concatenate(parts)

    def base_forces(self, names: Sequence[str]) -> list[Floats]:
        """Forces of base parameters, each for a relative change of 1."""
        nominal = dict(zip(names, values_of(self.axis, names), strict=True))
        known = {
            "mass": -self.axis.mass * self.a,
            "viscous": -self.v * (nominal.get("viscous") or self.size / self.fast),
            "coulomb": self.behind_bristles(-self.direction * self.level * self.lift),
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

    def base(self, names: Sequence[str]) -> Floats:
        """Columns of base parameters, each for a relative change of 1."""
        return self.of_forces(self.base_forces(names))

    def after_reversal(self) -> Iterator[Floats]:
        """Forces that friction lacks for a distance after a reversal, or after any start.

        Play, elastic contacts and compliance do so, whatever their law; a dwell time adds to it.
        """
        shortest = max(_SHORTEST_BUILDUP_INCREMENTS * self.quantum, _SHORTEST_BUILDUP * self.span)
        longest = max(_LONGEST_BUILDUP * self.span, 2.0 * shortest)
        for rests in (False, True):
            since = np.concatenate(
                [
                    distance_since_reversal(self.x[part], self.direction[part], rests)
                    for part in self.slices
                ]
            )
            for length in np.geomspace(shortest, longest, _BUILDUPS):
                yield -self.direction * self.level * np.exp(-since / length)
                yield -self.direction * self.level * (since < length)

    def same_force(
        self, effect: Effect, name: str, names: Sequence[str]
    ) -> tuple[dict[str, float], Floats] | None:
        """Values with which another effect acts as one does while the axis slides.

        Also the relative changes of base parameters of these `names` that go with them; None if
        it acts otherwise at all its shapes.
        """
        view = cast(View, self)
        best = NEGLIGIBLE_RATIO
        found = None
        values = dict(zip(effect.parameters(), effect.values, strict=True))
        force = effect_contribution(type(effect), values, view)
        for one in effect_class(name).columns(view):
            columns = [*one.force, *self.base_forces(names)]
            if not one.force or not np.any(force):
                continue
            c, left = self._fit_forces(force, columns)
            if left < best and not (one.positive and c[0] <= 0.0):
                width = len(one.force)
                best = left
                found = (one.values(c[:width].tolist()), c[width:])
        return found

    def taken_over(self, effect: Effect, names: Sequence[str]) -> Floats:
        """Changes of base parameters of these `names` that act most as an effect does."""
        values = dict(zip(effect.parameters(), effect.values, strict=True))
        force = effect_contribution(type(effect), values, cast(View, self))
        return self._fit_forces(force, self.base_forces(names))[0] * values_of(self.axis, names)

    def _fit_forces(self, force: Floats, columns: Sequence[Floats]) -> tuple[Floats, float]:
        """Coefficients of the forces that together are nearest to one while sliding; part left."""
        m = np.stack([c * (self.direction != 0.0) for c in columns], axis=1)
        size = np.maximum(np.linalg.norm(m, axis=0), 1e-300)
        c = np.linalg.lstsq(m / size, force, rcond=1e-9)[0] / size
        whole = max(float(np.linalg.norm(force)), 1e-300)
        left = float(np.linalg.norm(force - m @ c)) / whole
        return np.asarray(c), left

    def project_out(self, columns: Floats, ridge: float = 1e-6) -> None:
        """Leave out of the residual what some columns explain, for the search of frequencies."""
        size = np.linalg.norm(columns, axis=0)
        q, r = np.linalg.qr(columns / np.where(size > 0.0, size, 1.0))
        q = q[:, np.abs(np.diag(r)) > ridge]
        self._left = self.y - q @ (q.T @ self.y)
        vars(self).pop("_slopes", None)

    @cached_property
    def _slopes(self) -> tuple[Floats, Floats]:
        return self.slopes(self._left)

    def _shortest_period(self, kind: str) -> float:
        """Shortest period that samples show: over time [s], or over position [m]."""
        if kind == "time":
            return _SHORTEST_SAMPLES * self.dt
        # Along the way samples show no period shorter than twice the way from one to the next.
        moving = np.abs(self.v[self.direction != 0.0])
        step = 2.0 * self.dt * float(np.quantile(moving, 0.25)) if moving.size else 0.0
        return max(_SHORTEST_INCREMENTS * self.quantum, step)

    def waves(self, kind: str) -> tuple[list[float], float]:
        """Strongest frequencies of a kind, see `sines`, and the number of lobes searched.

        The slopes of the residual's square with the force at each sample, summed over position or
        time, give those with every sine at once, by a Fourier transform.
        """
        force, reading = self._slopes
        along = self.t - self.t.min() if kind == "time" else self.x - self.x.min()
        length = float(np.ptp(along))
        shortest = self._shortest_period(kind)
        most = min(length / shortest, self.x.size / _SHORTEST_SAMPLES)
        if not most > 2.0 * MIN_PERIODS:
            return [], 1.0
        bins = 2 ** math.ceil(math.log2(8.0 * most + 64.0))
        place = np.minimum((along / length * bins).astype(int), bins - 1)
        size = friction(cast(View, self)) if kind == "friction" else 1.0
        signal = np.bincount(place, reading if kind == "reading" else size * force, bins)
        spectrum = np.abs(np.fft.rfft(signal, _PER_LOBE * bins))
        power = spectrum[: int(_PER_LOBE * most)] ** 2
        wave = np.arange(power.size) / _PER_LOBE
        at = np.geomspace(MIN_PERIODS, most, _SIZES)
        angles = 2.0 * np.pi * at * along[:, None] / length
        sines = [size * one for one in (*np.sin(angles).T, *np.cos(angles).T)]
        found = self.of_readings(sines) if kind == "reading" else self.of_forces(sines)
        squares = (found**2).sum(axis=0).reshape(2, -1).sum(axis=0)
        squares = np.maximum(squares, 1e-300)
        logarithm = np.log(np.maximum(wave, 1.0))
        power /= np.exp(np.interp(logarithm, np.log(at), np.log(squares)))
        power[wave < MIN_PERIODS] = 0.0
        peaks: list[float] = []
        while len(peaks) < _PEAKS and power.any():
            k = int(np.argmax(power))
            peaks.append(float(wave[k]) / length)
            power[max(k - _PER_LOBE, 0) : k + _PER_LOBE + 1] = 0.0
        return peaks, most
