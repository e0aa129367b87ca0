"""Parameters, evidence per block and both noises, for records with a random force."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dryfric_control.estimation.likelihood import Likelihood, Run, prepare
from dryfric_control.estimation.parameters import typical, values_of, with_values
from dryfric_control.estimation.problem import Problem
from dryfric_control.estimation.scoring import maximise
from dryfric_control.estimation.solution import Solution
from dryfric_control.estimation.uncertainty import block_labels, block_length
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.ties import ranked

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

# Samples that are not used for parameters of sliding: within this time of a start or stop of
# motion [s], and below this fraction of the fast speed (95 % quantile)
# (`benchmarks/identification.py coverage`).
_ABOUT, _SLOW, _FAST = 0.01, 0.02, 0.95
# Least fraction of the sliding samples that must remain without them.
_LEFT = 0.3
# Initial random force in the search for the noises, over the RMS drive.
_FORCE = 0.03
# Iterations for the noises alone, and for all parameters.
_ALONE, _ITERATIONS = 6, 8
# Longest lag of the autocorrelation of the innovations [s], and size at which they are
# clipped, in standard deviations.
_LASTING, _LARGEST = 0.025, 4.0


class Evidence(NamedTuple):
    """Evidence of the records' blocks for parameters, in search coordinates.

    Attributes
    ----------
    z : ndarray, shape (nparameters,)
        The estimate.
    gradients : ndarray, shape (nblocks, nparameters)
    normals : ndarray, shape (nblocks, nparameters, nparameters)
    labels : ndarray of int64, shape (nblocks,)
    force, reading : tuple of float
        Standard deviations of both noises of each record: random force within one
        sample (0 if free runs reach the noise of the readings, NaN if it is not
        estimated), and readings.
    lasting : float
        Ratio of the innovations' power below some 40 Hz to that of white ones.
    """

    z: FloatArray
    gradients: FloatArray
    normals: FloatArray
    labels: NDArray[np.int64]
    force: tuple[float, ...]
    reading: tuple[float, ...]
    lasting: float = 1.0


def by_free_runs(problem: Problem, z: FloatArray, block: float | None) -> tuple[Evidence, bool]:
    """Evidence of free runs, and whether they reach the noise of the readings."""
    at = problem.evaluate(z)
    problem.refine(problem.terms(z, at)[1].sum(axis=0))
    gradients, normals, _ = problem.terms(z, at)
    labels = block_labels(problem.windows, block)
    reached = True
    for w, one in zip(problem.windows, at, strict=True):
        scores = w.scores(w.samples * w.mean_squares(one.errors) / w.floor**2)
        reached &= w.reached(scores) or not w.moving.any()
    force = (0.0 if reached else math.nan,) * len(problem.windows)
    reading = tuple(w.floor for w in problem.windows)
    return Evidence(z, gradients, normals, labels, force, reading), reached


def by_likelihood(
    problem: Problem,
    points: Sequence[FloatArray],
    nominal: FrictionAxis,
    tolerance: Mapping[str, float],
    block: float | None,
) -> Evidence | None:
    """Evidence by likelihood with both noises, the best that is reached from some points.

    None if the filter cannot simulate the axis or the fit fails.
    """
    windows = problem.windows
    records, hold = [w.record for w in windows], windows[0].hold
    length = block_length(records) if block is None else block
    runs = [prepare(r, block=length) for r in records]
    n = len(problem.names)

    def noises_alone(z: FloatArray) -> Solution:
        alone = Likelihood(problem.model_at(z).axis, (), runs, hold=hold)
        return maximise(alone, alone.start(_FORCE), _ALONE)

    def from_point(z: FloatArray, still: Solution) -> Solution:
        model = problem.model_at(z)
        held = [n for n in tolerance if n in problem.names]
        full = Likelihood(
            model.axis, problem.names, runs, hold=hold, scales=typical(records),
            believed=with_values(model.axis, held, values_of(nominal, held)), tolerance=tolerance,
        )  # fmt: skip
        start = [
            p.search(v) for p, v in zip(full.parameters, problem.values(z).values(), strict=True)
        ]
        return maximise(full, np.concatenate((start, still.z)), _ITERATIONS)

    try:
        stills = [noises_alone(z) for z in points]
        if not problem.breaks_away.any():
            states = stills[0].point.states
            runs = [away_from_rest(r, s) for r, s in zip(runs, states, strict=True)]
        ends = list(map(from_point, points, stills))
    except ValueError:  # a contact far too stiff for the sampling time
        return None
    found = ends[ranked([s.cost for s in ends])[0]]
    full = found.problem
    if not math.isfinite(found.cost) or found.gradients.size == 0:
        return None
    count = range(len(runs))
    values = [p.value(c) for p, c in zip(full.parameters, found.z, strict=False)]
    end = np.array([p.search(v) for p, v in zip(problem.parameters, values, strict=True)])
    # The scale of a coordinate depends on the start value of its parameter.
    rows = zip(problem.parameters, full.parameters, values, strict=True)
    unit = np.array([p.slope(v) / q.slope(v) for p, q, v in rows])
    return Evidence(
        end,
        unit * found.gradients[:, :n],
        unit * unit[:, None] * (found.curvature() * found.information[:, :n, :n]),
        np.arange(len(found.gradients)),
        tuple(found.random_force(i) for i in count),
        tuple(found.reading_noise(i) for i in count),
        lasting(found),
    )


def away_from_rest(run: Run, states: FloatArray) -> Run:
    """The run without the samples close to rest, if enough samples remain.

    Close to rest the noise of the recorded input causes a bias, since it releases the
    model but not the machine, and a creeping axis stops where an unknown force holds it.
    """
    sliding = states[2] != 0.0
    speed = np.abs(states[1])
    if not sliding.any():
        return run
    clear = ~sliding | (speed > _SLOW * np.quantile(speed[sliding], _FAST))
    reach = max(1, round(_ABOUT / run.record.dt))
    for k in np.flatnonzero(np.diff(states[2]) != 0.0):
        clear[max(0, k - reach + 1) : k + reach + 1] = False
    if np.sum(clear & sliding) < _LEFT * np.sum(sliding):
        return run
    return replace(run, active=run.active & clear)


def lasting(found: Solution) -> float:
    """Ratio of the innovations' low-frequency power to that of white ones, sliding."""
    worst = 0.0
    for run, out, states in zip(
        found.problem.runs, found.point.out, found.point.states, strict=True
    ):
        seen = run.active & (out[1] > 0.0) & (states[2] != 0.0)
        if not seen.any():
            continue
        e = np.zeros(seen.size)
        e[seen] = np.clip(out[0, seen] / np.sqrt(out[1, seen]), -_LARGEST, _LARGEST)
        longest = max(2, round(_LASTING / run.record.dt))
        size = 2 * (e.size + longest)
        products, pairs = (
            np.fft.irfft(np.abs(np.fft.rfft(one, size)) ** 2, size)[: longest + 1]
            for one in (e, seen.astype(float))
        )
        correlation = products / np.maximum(pairs, 1.0)
        weights = 1.0 - np.arange(longest + 1) / (longest + 1)
        total = correlation[0] + 2.0 * float(weights[1:] @ correlation[1:])
        worst = max(worst, total / max(correlation[0], 1e-300))
    return worst
