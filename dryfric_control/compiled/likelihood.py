"""Compiled likelihood of innovations, which follow Student's t, and its slopes."""
# mypy: disallow-untyped-defs=False

from __future__ import annotations

import math

import numpy as np

from dryfric_control.compiled.cached import njit

#: Degrees of freedom of the innovations.
FREEDOM = 4.0
#: Number of samples at the start of a record from which the filter takes its initial velocity;
#: they are not part of the likelihood.
FIRST = 10
# Products between this number and its inverse are accumulated without taking a logarithm.
_SMALLEST = 1e-200


@njit(cache=True, error_model="numpy", nogil=True)
def cost_of(out, active, start, end):
    """`cost` of samples start to end - 1, half the log of the product of S (1 + e^2/(nu S))^5."""
    total = 0.0
    product = 1.0
    for k in range(start, end):
        s = out[1, k]
        if active[k] and s > 0.0:
            e = out[0, k]
            wide = 1.0 + e * e / (FREEDOM * s)
            square = wide * wide
            more = product * (s * square * square * wide)
            if _SMALLEST < more < 1.0 / _SMALLEST:
                product = more
            else:
                total += math.log(product) + math.log(s) + (FREEDOM + 1.0) * math.log(wide)
                product = 1.0
    return 0.5 * (total + math.log(product))


@njit(cache=True, error_model="numpy", nogil=True)
def cost(out, active):
    """Negative log-likelihood of active samples: log(S)/2 + (nu + 1)/2 log(1 + e^2/(nu S)) each."""
    return cost_of(out, active, FIRST + 1, out.shape[1])


@njit(cache=True, error_model="numpy", nogil=True)
def profile_cost(out, active, turns):
    """`cost` with one factor of all variances fitted in some turns; nan without a number."""
    ratios = np.empty(out.shape[1])
    count = 0
    logs = 0.0
    product = 1.0
    for k in range(out.shape[1]):
        s = out[1, k]
        if active[k] and s > 0.0:
            ratios[count] = out[0, k] * out[0, k] / s
            count += 1
            if _SMALLEST < product * s < 1.0 / _SMALLEST:
                product *= s
            else:
                logs += math.log(product) + math.log(s)
                product = 1.0
    logs += math.log(product)
    factor = 1.0
    ratios = ratios[:count]
    for _ in range(turns):
        total = 0.0
        for ratio in ratios:
            total += (FREEDOM + 1.0) / (FREEDOM + ratio / factor) * ratio
        before = factor
        factor = max(total / max(count, 1), 1e-12)
        if abs(factor - before) < 1e-4 * before:
            break
    spread = 0.0
    product = 1.0
    for ratio in ratios:
        wide = 1.0 + ratio / (FREEDOM * factor)
        if product * wide < 1.0 / _SMALLEST:
            product *= wide
        else:
            spread += math.log(product) + math.log(wide)
            product = 1.0
    spread += math.log(product)
    return 0.5 * (logs + count * math.log(factor) + (FREEDOM + 1.0) * spread)


@njit(cache=True, error_model="numpy", nogil=True)
def block_costs(out, active, edges, costs):
    """`cost` of each block; block b covers the samples edges[b] to edges[b+1] - 1."""
    for b in range(edges.shape[0] - 1):
        costs[b] = cost_of(out, active, max(edges[b], FIRST + 1), edges[b + 1])


@njit(cache=True, error_model="numpy", nogil=True)
def slopes(out, before, after, low, high, slope):
    """Slopes of the normalised innovations and of the log of their deviation, shape (2, n).

    `before` and `after` are the filter's results `low` below and `high` above in one
    coordinate; for a missing side its distance is 0 and its result that of the point itself.
    A change by more than a standard deviation is no slope, as a switch has moved.
    """
    wide = low + high
    for k in range(out.shape[1]):
        slope[0, k] = 0.0
        slope[1, k] = 0.0
        s = out[1, k]
        if s > 0.0 and wide > 0.0:
            change = (after[0, k] - before[0, k]) / math.sqrt(s)
            if abs(change) < 1.0:
                slope[0, k] = change / wide
            change = 0.5 * (after[1, k] - before[1, k]) / s
            if abs(change) < 1.0:
                slope[1, k] = change / wide


@njit(cache=True, error_model="numpy", nogil=True)
def normal_terms(out, active, edges, slope, g, h):
    """Gradient and information of each block of samples.

    `slope` contains `slopes` of each coordinate, shape (p, 2, n).  The information is
    that of the location of Student's t, with the weights of the readings, and of its
    scale.
    """
    p = slope.shape[0]
    scale = 2.0 * FREEDOM / (FREEDOM + 3.0)
    for b in range(edges.shape[0] - 1):
        g[b] = 0.0
        h[b] = 0.0
        for k in range(max(edges[b], FIRST + 1), edges[b + 1]):
            s = out[1, k]
            if not (active[k] and s > 0.0):
                continue
            e = out[0, k] / math.sqrt(s)
            weight = (FREEDOM + 1.0) / (FREEDOM + e * e)
            pull = weight * e
            spread = 1.0 - weight * e * e
            for i in range(p):
                de = slope[i, 0, k]
                ds = slope[i, 1, k]
                if de == 0.0 and ds == 0.0:
                    continue
                g[b, i] += pull * de + spread * ds
                de *= weight
                ds *= scale
                for j in range(i + 1):
                    h[b, i, j] += de * slope[j, 0, k] + ds * slope[j, 1, k]
        for i in range(p):
            for j in range(i):
                h[b, j, i] = h[b, i, j]
