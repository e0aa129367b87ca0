"""One pass of the filter at a model, and the columns that effects would add to it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.ndimage import uniform_filter1d

from dryfric_control.arrays import Floats
from dryfric_control.compiled import likelihood as compiled
from dryfric_control.compiled.linear import Recursion, adjoint, innovation_change
from dryfric_control.diagnosis.model_view import ModelView
from dryfric_control.diagnosis.problem import Problem
from dryfric_control.estimation.likelihood import Likelihood, Point, recursion
from dryfric_control.records.record import Record

# Averaging of the filtered acceleration [samples].
_SMOOTH = 5


def _known_forces(records: Sequence[Record]) -> Floats:
    """Known forces on the mass in all records, zero in those without; empty if none has one."""
    known = [r.known_force for r in records]
    if not any(force.size for force in known):
        return np.zeros(0)
    pairs = zip(known, records, strict=True)
    return np.concatenate([force if force.size else np.zeros(len(r)) for force, r in pairs])


class Linearised(ModelView):
    """Innovations of a model and their linear change by forces and reading errors.

    Parameters
    ----------
    problem : Problem
    likelihood : Likelihood
    z : ndarray
        Search coordinates of the model.
    """

    def __init__(self, problem: Problem, likelihood: Likelihood, z: Floats) -> None:
        self.likelihood = likelihood
        self.z = z
        self.imposed = problem.is_imposed
        self.axis = likelihood.axis_at(z, 0)
        self.point = likelihood.at(z)
        records = [run.record for run in likelihood.runs]
        self.slices = []
        self.recursions: list[Recursion] = []
        start = 0
        for i, (run, states) in enumerate(zip(likelihood.runs, self.point.states, strict=True)):
            one = likelihood.axis_at(z, i)
            end = start + len(run.record)
            self.slices.append(slice(start, end))
            self.recursions.append(recursion(one, run.record.dt, states, run.w.size > 0))
            start = end
        out = np.concatenate(self.point.out, axis=1)
        states = np.concatenate(self.point.states, axis=1)
        active = np.concatenate([run.active for run in likelihood.runs])
        for part in self.slices:
            active[part][: compiled.FIRST + 1] = False
        self.ok = active & (out[1] > 0.0) & np.isfinite(out[0])
        self.count = float(self.ok.sum())
        s = np.sqrt(np.where(self.ok, out[1], 1.0))
        e = np.where(self.ok, out[0], 0.0) / s
        nu = compiled.FREEDOM
        self.root = np.where(self.ok, np.sqrt((nu + 1.0) / (nu + e * e)), 0.0)
        #: Weight of each innovation: the columns are theirs times it.
        self.scale = self.root / s
        self.y = e * self.root
        self.dt = records[0].dt
        self.quantum = min(r.resolution.step for r in records)
        self.duration = max(r.duration for r in records)
        self.t = np.concatenate([r.t for r in records])
        self.readings = np.concatenate([r.x for r in records])
        self.u = np.concatenate([run.u for run in likelihood.runs])
        self.load = _known_forces(records)
        self.x = states[0]
        self.v = states[1]
        self.a = np.concatenate(
            [np.gradient(uniform_filter1d(self.v[part], _SMOOTH)) / self.dt for part in self.slices]
        )
        self.direction = np.sign(states[2])
        if self.bristle_length > 0.0:  # which bend while the contact counts as at rest
            self.direction = np.where(self.direction == 0.0, np.sign(self.v), self.direction)

    def columns(self, force: Floats, reading: Floats) -> Floats:
        """Weighted changes of the innovations, shape (n, c), see `innovation_change`."""
        out = np.zeros((self.x.size, max(force.shape[1], reading.shape[1])))
        if self.imposed:
            # The innovation is the force that the model would need beside the drive.
            return -force * self.scale[:, None]
        for part, one in zip(self.slices, self.recursions, strict=True):
            f, r = (np.ascontiguousarray(a[part]) for a in (force, reading))
            innovation_change(f, r, one, out[part])
        out *= self.scale[:, None]
        return out

    def of_forces(self, some: Sequence[Floats]) -> Floats:
        return self.columns(np.stack(some, axis=1), np.zeros((0, len(some))))

    def of_readings(self, some: Sequence[Floats]) -> Floats:
        return self.columns(np.zeros((0, len(some))), np.stack(some, axis=1))

    def of_change(self, point: Point, most: float) -> Floats:
        out, before = (np.concatenate(one.out, axis=1)[0] for one in (point, self.point))
        ok = self.ok  # a pass that runs away is infinite at readings that do not count, too
        change = np.zeros(out.size)
        change[ok] = np.nan_to_num((out[ok] - before[ok]) * self.scale[ok])
        bound = most * self.root
        return np.clip(change, -bound, bound)

    def steps(self, names: Sequence[str]) -> Floats:
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

    def slopes(self, left: Floats) -> tuple[Floats, Floats]:
        pull = left * self.scale
        if self.imposed:
            return pull, pull
        pairs = [
            adjoint(np.ascontiguousarray(pull[p]), r)
            for p, r in zip(self.slices, self.recursions, strict=True)
        ]
        return np.concatenate([p[0] for p in pairs]), np.concatenate([p[1] for p in pairs])
