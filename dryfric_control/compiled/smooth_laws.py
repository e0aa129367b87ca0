"""Compiled run of the smooth but stiff friction laws: tanh, Dahl, LuGre.

They use the numbers, load and friction level of the switched axis and are integrated by
an L-stable Rosenbrock method of order 4(3), with substeps from its error estimate.
"""

# mypy: allow-untyped-defs

from __future__ import annotations

import math

import numpy as np
from numba import njit

from dryfric_control.compiled.axis_step import (
    EXCESS,
    INVERSE_MASS,
    INVERSE_STRIBECK_SPEED,
    SHORT_TIME,
    SHORT_WAY,
    STICK_SPEED,
    VISCOUS,
    load,
    point,
    sliding_level,
)
from dryfric_control.compiled.switched_laws import (
    GIVE_UP,
    MOST_SUBSTEPS,
    force_scale,
    sampled_drive,
)

TANH, BRISTLE = 0, 1

# RODAS4 of Hairer & Wanner, Solving ODEs II (1996), section IV.7: order 4(3), L-stable.
_RO_A = np.array(
    [
        [1.544, 0, 0, 0],
        [0.9466785280815826, 0.2557011698983284, 0, 0],
        [3.314825187068521, 2.896124015972201, 0.9986419139977817, 0],
        [1.221224509226641, 6.019134481288629, 12.53708332932087, -0.687886036105895],
    ]
)
_RO_C = np.array(
    [
        [-5.6688, 0, 0, 0, 0],
        [-2.430093356833875, -0.2063599157091915, 0, 0, 0],
        [-0.1073529058151375, -9.594562251023355, -20.47028614809616, 0, 0],
        [7.496443313967647, -10.24680431464352, -33.99990352819905, 11.7089089320616, 0],
        [
            8.083246795921522,
            -7.981132988064893,
            -31.52159432874371,
            16.31930543123136,
            -6.058818238834054,
        ],
    ]
)
_RO_TIME = np.array([0.0, 0.386, 0.21, 0.63, 1.0, 1.0])
_RO_DRIFT = np.array([0.25, -0.1043, 0.1035, -0.0362, 0.0, 0.0])
_RO_GAMMA = 0.25


@njit(cache=True, error_model="numpy")
def _law(kind, stiffness, damping, level, v, z):
    """Friction and bristle rate for a level; for tanh, stiffness is 1 / speed."""
    if kind == BRISTLE:
        dz = v - stiffness * abs(v) / level * z
        return stiffness * z + damping * dz, dz
    return level * math.tanh(v * stiffness), 0.0


@njit(cache=True, error_model="numpy")
def _smooth_rates(plant, drive, t0, tau, law, x, v, z):
    """Time derivatives of v and z, and the friction."""
    s = 1.0 if v >= 0.0 else -1.0
    w = load(plant, drive, t0, tau, x, v, s, 0.0)
    level = sliding_level(plant, t0 + tau, x, v, w, s)
    friction, dz = _law(law[0], law[1], law[2], level, v, z)
    return (w - plant.numbers[VISCOUS] * v - friction) * plant.numbers[INVERSE_MASS], dz, friction


@njit(cache=True, error_model="numpy")
def _slopes(plant, drive, t0, tau, law, nudges, x, v, z, s, axis):
    """Derivatives of v' and z' with x (axis 0), v (1) or time (2) through load and level.

    Central differences of load and level in the fixed direction s, where both are smooth;
    the steep friction law itself is differentiated by `_smooth_jacobian`.
    """
    d = nudges[axis]
    dx, dv, dtau = (d if axis == 0 else 0.0), (d if axis == 1 else 0.0), (d if axis == 2 else 0.0)
    upper = load(plant, drive, t0, tau + dtau, x + dx, v + dv, s, 0.0)
    lower = load(plant, drive, t0, tau - dtau, x - dx, v - dv, s, 0.0)
    high = sliding_level(plant, t0 + tau + dtau, x + dx, v + dv, upper, s)
    low = sliding_level(plant, t0 + tau - dtau, x - dx, v - dv, lower, s)
    level = 0.5 * (high + low)
    w_slope = (upper - lower) / (2 * d)
    level_slope = (high - low) / (2 * d)
    if law[0] == BRISTLE:
        dz = law[1] * abs(v) / level * z * level_slope / level
        friction = law[2] * dz
    else:
        dz = 0.0
        friction = math.tanh(v * law[1]) * level_slope
    return (w_slope - friction) * plant.numbers[INVERSE_MASS], dz, level


@njit(cache=True, error_model="numpy")
def _smooth_jacobian(plant, drive, t0, tau, law, nudges, x, v, z):
    """Jacobian rows of v' and z' over (x, v, z), and their time derivatives."""
    s = 1.0 if v >= 0.0 else -1.0
    vx, zx, level = _slopes(plant, drive, t0, tau, law, nudges, x, v, z, s, 0)
    vv, zv, _ = _slopes(plant, drive, t0, tau, law, nudges, x, v, z, s, 1)
    vt, zt, _ = _slopes(plant, drive, t0, tau, law, nudges, x, v, z, s, 2)
    inverse_mass = plant.numbers[INVERSE_MASS]
    vv -= plant.numbers[VISCOUS] * inverse_mass
    if law[0] == BRISTLE:
        own = 1 - s * law[1] * z / level
        zz = -law[1] * abs(v) / level
        return (
            vx,
            vv - law[2] * own * inverse_mass,
            -(law[1] + law[2] * zz) * inverse_mass,
            (zx, zv + own, zz),
            (vt, zt),
        )
    soft = math.tanh(v * law[1])
    vv -= level * law[1] * (1 - soft * soft) * inverse_mass
    return vx, vv, 0.0, (0.0, 0.0, 0.0), (vt, 0.0)


@njit(cache=True, error_model="numpy")
def _smooth_step(plant, drive, t0, tau, law, nudges, x, v, z, h, stage):
    """One RODAS4 step; the last row of `stage` contains the error estimate."""
    vx, vv, vz, (zx, zv, zz), (vt, zt) = _smooth_jacobian(
        plant, drive, t0, tau, law, nudges, x, v, z
    )
    d = 1 / (_RO_GAMMA * h)
    # (d I - J) k = r with J's first row (0, 1, 0): k1 eliminated, then Cramer's rule.
    m11, m12 = d - vv - vx / d, -vz
    m21, m22 = -zv - zx / d, d - zz
    determinant = m11 * m22 - m12 * m21
    xi, vi, zi = x, v, z
    for i in range(6):
        if 0 < i < 5:
            xi, vi, zi = x, v, z
            for j in range(i):
                xi += _RO_A[i - 1, j] * stage[j, 0]
                vi += _RO_A[i - 1, j] * stage[j, 1]
                zi += _RO_A[i - 1, j] * stage[j, 2]
        elif i == 5:
            xi += stage[4, 0]
            vi += stage[4, 1]
            zi += stage[4, 2]
        r1 = vi
        r2, r3, _ = _smooth_rates(plant, drive, t0, tau + _RO_TIME[i] * h, law, xi, vi, zi)
        r2 += _RO_DRIFT[i] * h * vt
        r3 += _RO_DRIFT[i] * h * zt
        for j in range(i):
            r1 += _RO_C[i - 1, j] / h * stage[j, 0]
            r2 += _RO_C[i - 1, j] / h * stage[j, 1]
            r3 += _RO_C[i - 1, j] / h * stage[j, 2]
        b1 = r2 + vx * r1 / d
        b2 = r3 + zx * r1 / d
        k2 = (b1 * m22 - m12 * b2) / determinant
        stage[i, 0] = (r1 + k2) / d
        stage[i, 1] = k2
        stage[i, 2] = (m11 * b2 - m21 * b1) / determinant
    return xi + stage[5, 0], vi + stage[5, 1], zi + stage[5, 2]


@njit(cache=True, error_model="numpy")
def run_smooth(numbers, integers, law, u, dt, first, x0, v0, tolerance, out):
    """tanh, Dahl and LuGre; `law` is (kind, stiffness or 1 / speed, damping).

    Rows x, v, F, mode of `out` are filled; returns 0, or 1 + the sample that failed.
    """
    plant = point(numbers, integers)
    kind, stiffness, _ = law
    stage = np.empty((6, 3))
    here = np.zeros(2)
    x, v, z = x0, v0, 0.0
    scale = force_scale(plant, 0.0, x0)
    v_scale = scale * dt * numbers[INVERSE_MASS]
    z_scale = scale / stiffness
    v_scale = min(v_scale, z_scale / dt if kind == BRISTLE else 1 / stiffness)
    nudge_v = v_scale
    if numbers[EXCESS] > 0.0:
        nudge_v = min(nudge_v, 1 / numbers[INVERSE_STRIBECK_SPEED])
    h = dt
    n = u.size
    for k in range(n):
        t0 = k * dt
        here[0], here[1] = x, v
        drive = sampled_drive(plant, t0, dt, here, u[k], u[k + 1] if first and k + 1 < n else u[k])
        out[0, k] = x
        out[1, k] = v
        out[2, k] = _smooth_rates(plant, drive, t0, 0.0, law, x, v, z)[2]
        out[3, k] = 0.0 if abs(v) <= numbers[STICK_SPEED] else math.copysign(1.0, v)
        if k == n - 1:
            break
        tau = 0.0
        for substep in range(MOST_SUBSTEPS + 1):
            left = dt - tau
            if left <= 0.0:
                break
            if substep == MOST_SUBSTEPS:
                return k + 1
            longest = min(h, numbers[SHORT_TIME])
            last = longest >= left
            step = left if last else longest
            nudges = (
                1e-8 * abs(x) + 1e-4 * v_scale * dt,
                1e-8 * abs(v) + 1e-4 * nudge_v,
                1e-3 * step,
            )
            xn, vn, zn = _smooth_step(plant, drive, t0, tau, law, nudges, x, v, z, step, stage)
            error = max(
                abs(stage[5, 0]) / (tolerance * (abs(x) + v_scale * dt)),
                abs(stage[5, 1]) / (tolerance * (max(abs(v), abs(vn)) + v_scale)),
            )
            if kind == BRISTLE:
                error = max(error, abs(stage[5, 2]) / (tolerance * (abs(z) + z_scale)))
            if abs(xn - x) > numbers[SHORT_WAY]:
                h = 0.9 * step * numbers[SHORT_WAY] / abs(xn - x)
                continue
            if not error <= 1.0:
                h = step * (max(0.2, 0.9 * error**-0.25) if error < 1e300 else 0.2)
                if h < GIVE_UP * dt:
                    return k + 1
                continue
            x, v, z = xn, vn, zn
            tau = dt if last else tau + step
            grown = step * min(5.0, 0.9 * max(error, 1e-10) ** -0.25)
            h = max(h, grown) if last else grown
    return 0
