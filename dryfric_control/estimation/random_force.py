"""What the random force of a fit tells: whether it acts, where it biases, whether it is white."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from dryfric_control.arrays import Floats
from dryfric_control.estimation.likelihood import Run
from dryfric_control.estimation.solution import Solution

# Time from a start or stop of motion [s] within which samples are not used for parameters of
# sliding (`benchmarks/identification.py coverage`).
_SWITCH_TIME = 0.01
# Speed over the fast speed below which samples are not used either.
_SLOW_FRACTION = 0.02
# Quantile of the speed that is the fast speed.
_FAST_QUANTILE = 0.95
# Least fraction of the sliding samples that must remain without them.
_MIN_SAMPLE_FRACTION = 0.3
# Longest lag of the autocorrelation of the innovations [s]: where only short correlation matters.
_SHORT_LAG = 0.025
# The same for the variance of their long-run mean.
_LONG_LAG = 1.0
# Size at which innovations are clipped [standard deviations].
_MAX_INNOVATION = 4.0
# Log-likelihood that a random force must bring.
_MIN_FORCE_GAIN = 6.0


def has_random_force(found: Solution, i: int) -> bool:
    """Whether the readings of record i are likelier with a random force than without."""
    problem = found.problem
    without = found.z.copy()
    k = len(found.problem.names) + 2 * i
    without[k] = problem.low[k]
    return problem.tried(without).cost > found.cost + _MIN_FORCE_GAIN


def away_from_rest(run: Run, states: Floats) -> Run:
    """The run without the samples close to rest, if enough samples remain."""
    # There the noise of the recorded input releases the model but not the machine, and a creeping
    # axis stops where an unknown force holds it.
    sliding = states[2] != 0.0
    speed = np.abs(states[1])
    if not sliding.any():
        return run
    clear = ~sliding | (speed > _SLOW_FRACTION * np.quantile(speed[sliding], _FAST_QUANTILE))
    reach = max(1, round(_SWITCH_TIME / run.record.dt))
    for k in np.flatnonzero(np.diff(states[2]) != 0.0):
        clear[max(0, k - reach + 1) : k + reach + 1] = False
    if np.sum(clear & sliding) < _MIN_SAMPLE_FRACTION * np.sum(sliding):
        return run
    return replace(run, active=run.active & clear)


def products(values: Floats, lags: int) -> Floats:
    """Sum of the products of values and those 0 to `lags` samples later."""
    size = 2 * (values.size + lags)
    power = np.abs(np.fft.rfft(values, size)) ** 2
    return np.asarray(np.fft.irfft(power, size)[: lags + 1])


def integrate_autocorrelation(part: Floats, count: float) -> float:
    """Twice the sum of an autocorrelation up to the first lag at which it is no more than chance.

    `part`: over the lag, 1 at none; `count`: of the values that it is of.
    """
    chance = np.flatnonzero(part[1:] < 2.0 / math.sqrt(count))
    last = int(chance[0]) + 1 if chance.size else part.size
    return 2.0 * float(part[1:last].sum())


def _innovation_products(found: Solution, longest: float) -> Iterator[tuple[Floats, Floats]]:
    """Products of the innovations of each record while sliding, and their pairs, over the lag."""
    point = found.point
    for run, out, states in zip(found.problem.runs, point.out, point.states, strict=True):
        seen = run.active & (out[1] > 0.0) & (states[2] != 0.0)
        e = np.zeros(seen.size)
        normal = out[0, seen] / np.sqrt(out[1, seen])
        e[seen] = np.clip(normal, -_MAX_INNOVATION, _MAX_INNOVATION)
        lags = min(max(2, round(longest / run.record.dt)), seen.size // 4)
        yield products(e, lags), products(seen.astype(float), lags)


def low_frequency_ratio(found: Solution) -> float:
    """Ratio of the innovations' low-frequency power to that of white ones, sliding."""
    worst = 0.0
    for sums, pairs in _innovation_products(found, _SHORT_LAG):
        correlation = sums / np.maximum(pairs, 1.0)
        weights = 1.0 - np.arange(correlation.size) / correlation.size
        total = correlation[0] + 2.0 * float(weights[1:] @ correlation[1:])
        worst = max(worst, total / max(correlation[0], 1e-300))
    return worst


def long_run(found: Solution) -> float:
    """Ratio of the long-run variance of innovations while sliding to their variance, at least 1."""
    rows = list(_innovation_products(found, _LONG_LAG))
    total = np.zeros((2, max(one.size for one, _ in rows)))
    for row in rows:
        total[:, : row[0].size] += row
    if total[0, 0] <= 0.0:
        return 1.0
    part = total[0] / np.maximum(total[1], 1.0)
    return max(1.0, 1.0 + integrate_autocorrelation(part / part[0], total[1, 0]))
