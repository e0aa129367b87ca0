"""Bias of a fit by noise of its recorded inputs: errors in variables."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dryfric_control.arrays import Floats
from dryfric_control.compiled import likelihood as compiled
from dryfric_control.compiled.linear import Recursion, innovation_change
from dryfric_control.compiled.windowed_runs import accelerations
from dryfric_control.estimation.input_noise import noise_of, without_noise
from dryfric_control.estimation.likelihood import Run, recursion
from dryfric_control.estimation.solution import Solution
from dryfric_control.model.axis import FrictionAxis

# Records of simulated noise over which products are averaged.
_DRAWS = 16
# Half width of the intervals of the smoothing [standard errors].
_WIDTH = 1.0
# Part of the noise of an input that is taken off to see whether the readings lack it.
_STEP = 0.2


def input_bias(found: Solution, seed: int = 0) -> Floats:
    """Gradient of each block that noise of the recorded inputs causes, shape (nblocks, nfree).

    Noise of a recorded input enters the innovations and their slopes with the mass alike, as errors
    in variables do (W. Fuller, Measurement Error Models, 1987): the mean of their product is not
    zero at the true parameters, which makes a mass too large.  Here it is computed from the
    filter's linear recursion.  A random force that acts on the axis has no such effect: what
    counts is the noise of the input that the readings do not show.
    """
    problem = found.problem
    rng = np.random.default_rng(seed)
    rows = []
    for i, run in enumerate(problem.runs):
        bias = np.zeros((run.edges.size - 1, len(problem.names)))
        spread = _measured_noise(found, i)
        axis = problem.axis_at(found.z, i)
        if spread > 0.0 and all(e.has_linear_states() for e in axis.effects):
            noise = spread * rng.standard_normal((run.u.size, _DRAWS))
            out = found.point.out[i]
            states = found.point.states[i]
            linear = recursion(axis, run.record.dt, states, run.w.size > 0)
            seen = run.active & (out[1] > 0.0)
            size = np.where(seen, out[1], 1.0)
            nu = compiled.FREEDOM
            weight = np.where(seen, (nu + 1.0) / (nu + out[0] ** 2 / size) / size, 0.0)
            innovations = _response(noise, linear)
            for j, slope in enumerate(_drive_slopes(found, i, axis, spread)):
                if np.any(slope):
                    products = innovations * _response(slope[:, None] * noise, linear)
                    sums = np.add.reduceat(weight * products.mean(axis=1), run.edges[:-1])
                    bias[:, j] = sums * found.curvature()
        rows.append(bias)
    return np.concatenate(rows)


def _response(force: Floats, linear: Recursion) -> Floats:
    """Change of the innovations under model forces, shape (n, ncolumns)."""
    out = np.zeros_like(force)
    innovation_change(force, force[:0], linear, out)
    return out


def _drive_slopes(found: Solution, i: int, axis: FrictionAxis, spread: float) -> list[Floats]:
    """Slope with the drive of the force by which each parameter acts, at every sample."""
    problem, run, states = found.problem, found.problem.runs[i], found.point.states[i]
    direction = np.sign(states[2]).astype(np.int64)

    def force(one: FrictionAxis, drive: float) -> Floats:
        arrays = one.arrays(1.0)
        record = run.record
        motion = (record.t, states[0], states[1], run.u + drive, record.known_force, direction)
        return axis.mass * accelerations(arrays.numbers, arrays.integers, *motion)

    here = [force(axis, side * spread) for side in (-1.0, 1.0)]
    rows = []
    for j, name in enumerate(problem.names):
        moved = found.z.copy()
        moved[j] += problem.steps[j] * (1.0 if moved[j] < problem.high[j] else -1.0)
        slope = np.zeros(direction.size)
        if name not in problem.late and problem.place[j] in (-1, i):
            try:
                there = problem.axis_at(moved, i)
            except ValueError:  # no such axis on this side
                there = axis
            low, high = (force(there, side * spread) for side in (-1.0, 1.0))
            rise = (high - here[1]) - (low - here[0])
            slope = np.where(direction != 0, rise, 0.0) / (2.0 * spread * (moved[j] - found.z[j]))
        # What differences leave of rounding is no slope.
        rows.append(np.where(np.abs(slope) > 1e-6, slope, 0.0))
    return rows


def _with_input(run: Run, u: Floats) -> Run:
    return replace(run, u=u)


def _measured_noise(found: Solution, i: int) -> float:
    """Standard deviation of noise in the input of record i that did not act on the axis."""
    # Of the noise that the input shows, the part whose removal the innovations ask for.
    problem = found.problem
    run = found.problem.runs[i]
    noise = noise_of(run.u)
    rough = run.u - without_noise(run.u, _WIDTH)
    if noise == 0.0 or not np.any(rough):
        return 0.0
    here = found.point.out[i]
    there = list(problem.runs)
    there[i] = _with_input(run, run.u - _STEP * rough)
    out = problem.on(there).innovations(found.z, i)[0]
    slopes = np.zeros((1, 2, run.u.size))
    compiled.slopes(here, here, out, 0.0, _STEP, slopes[0])
    blocks = run.edges.size - 1
    g = np.zeros((blocks, 1))
    h = np.zeros((blocks, 1, 1))
    compiled.normal_terms(here, run.active, run.edges, slopes, g, h)
    bent = found.curvature() * h.sum()
    part = -g.sum() / bent if bent > 0.0 else 0.0
    return float(noise * np.sqrt(np.clip(part, 0.0, 1.0)))
