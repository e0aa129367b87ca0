"""Linear response of the filter's innovations to small forces and reading errors, compiled.

Between readings the error of a sliding axis obeys m v' = -f v + c; each reading corrects it
by the filter's gains.  A force or an error of the reading therefore changes the innovations
by a linear recursion, whose adjoint gives the slopes of a sum of innovations with the force
and the reading of every sample.
"""
# mypy: disallow-untyped-defs=False

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from dryfric_control.compiled.cached import njit


class Recursion(NamedTuple):
    """Coefficients of the recursion over one record."""

    slide: Any  # (n,) 1 while sliding in the sample that starts here
    k1: Any  # (n,) correction of the position over the innovation
    k2: Any  # (n,) correction of the velocity over the innovation [1/s]
    f01: float  # change of the position over the velocity [s]
    f11: float  # change of the velocity over the velocity
    b0: float  # change of the position over the force [m/N]
    b1: float  # change of the velocity over the force [m/(N s)]
    rate: float = 0.0  # 1/sampling time if velocities were read, 0 if positions [1/s]


@njit(cache=True, error_model="numpy", fastmath=True, nogil=True)
def innovation_change(force, reading, r, out):
    """Change of the innovations if the model gains forces and reading errors, shape (n or 0, c)."""
    n, c = out.shape
    forced = force.shape[0] == n
    read = reading.shape[0] == n
    x = np.zeros(c)
    v = np.zeros(c)
    fast = r.rate > 0.0
    out[0] = 0.0
    for k in range(1, n):
        s = r.slide[k]
        a01 = s * r.f01
        a11 = s * r.f11
        c0 = s * r.b0
        c1 = s * r.b1
        g1 = r.k1[k]
        g2 = r.k2[k]
        for j in range(c):
            here = x[j] + a01 * v[j]
            there = a11 * v[j]
            if forced:
                here += c0 * force[k - 1, j]
                there += c1 * force[k - 1, j]
            e = -there if fast else -here
            if read:
                e -= (reading[k, j] - reading[k - 1, j]) * r.rate if fast else reading[k, j]
            out[k, j] = e
            x[j] = here + g1 * e
            v[j] = there + g2 * e


@njit(cache=True, error_model="numpy", nogil=True)
def adjoint(weights, r):
    """Slopes of sum(weights * innovations) with the force and the reading of each sample."""
    n = weights.size
    force = np.zeros(n)
    reading = np.zeros(n)
    px = pv = 0.0
    for k in range(n - 1, 0, -1):
        s = r.slide[k]
        e = weights[k] + r.k1[k] * px + r.k2[k] * pv
        if r.rate > 0.0:
            pv -= e
            reading[k] -= e * r.rate
            reading[k - 1] += e * r.rate
        else:
            px -= e
            reading[k] = -e
        force[k - 1] = s * (r.b0 * px + r.b1 * pv)
        pv = s * (r.f01 * px + r.f11 * pv)
    return force, reading


@njit(cache=True)
def play(x, gap):
    """Position behind a play of a total width `gap`, shape (n,)."""
    y = np.empty(x.size)
    half = 0.5 * gap
    y[0] = x[0]
    for k in range(1, x.size):
        y[k] = min(max(y[k - 1], x[k] - half), x[k] + half)
    return y


@njit(cache=True, error_model="numpy", nogil=True)
def behind_bristles(level, x, length):
    """Friction by a small change of the level, shape (n,), behind bristles of a length.

    Their force F = k z follows dF/dx = k (1 - s F/level), so that a small change of the level
    appears in the share F/level that the bristles have built up, and over the same length.
    """
    force = np.zeros(x.size)
    share = 0.0
    for k in range(1, x.size):
        way = x[k] - x[k - 1]
        rest = np.exp(-abs(way) / length)
        share = np.sign(way) + (share - np.sign(way)) * rest
        aim = -share * level[k]
        force[k] = aim + (force[k - 1] - aim) * rest
    return force
