"""Compiled run of the discontinuous friction laws, sign and Karnopp.

They use the numbers, load and friction level of the switched axis; only the law near
v = 0 and the integration differ: explicit Runge-Kutta 5(4) between switches, with
substeps from its error estimate, and switches located by repeating the step.
"""

# mypy: allow-untyped-defs

from __future__ import annotations

import math

import numpy as np
from numba import njit

from dryfric_control.compiled.axis_step import (
    INVERSE_MASS,
    SHORT_TIME,
    SHORT_WAY,
    VISCOUS,
    Drive,
    breakaway_level,
    input_map,
    load,
    point,
    sliding_level,
)
from dryfric_control.compiled.roots import between, narrowed

# A piece shorter than this fraction of a sample is merged with the next one: in a shorter
# one the force that starts a motion is lost in round-off.
_SHORTEST = 1e-9
# Smallest substep, as a fraction of a sample, before the tolerance is called unreachable.
GIVE_UP = 1e-14
MOST_SUBSTEPS = 100_000


@njit(cache=True, error_model="numpy")
def force_scale(plant, t, x):
    plus = sliding_level(plant, t, x, 0.0, 0.0, 1.0)
    return 0.5 * (plus + sliding_level(plant, t, x, 0.0, 0.0, -1.0))


@njit(cache=True, error_model="numpy")
def sampled_drive(plant, t, dt, here, u0, u1):
    """Drive force over one sample, after the static input effects."""
    a = input_map(plant, t, here, u0)
    b = a if u1 == u0 else input_map(plant, t, here, u1)
    return Drive(a, (b - a) / dt, 0.0, 0.0)


# Dormand & Prince 1980, RK5(4)7M.
_DP_A = np.array(
    [
        [1 / 5, 0, 0, 0, 0],
        [3 / 40, 9 / 40, 0, 0, 0],
        [44 / 45, -56 / 15, 32 / 9, 0, 0],
        [19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729, 0],
        [9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656],
    ]
)
_DP_B = np.array([35 / 384, 0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84])
_DP_C = np.array([1 / 5, 3 / 10, 4 / 5, 8 / 9, 1.0])
_DP_E = np.array([71 / 57600, 0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525])


@njit(cache=True, error_model="numpy")
def _slide_rate(plant, drive, t0, tau, x, v, s):
    w = load(plant, drive, t0, tau, x, v, s, 0.0)
    level = sliding_level(plant, t0 + tau, x, v, w, s)
    return (w - plant.numbers[VISCOUS] * v - s * level) * plant.numbers[INVERSE_MASS]


@njit(cache=True, error_model="numpy")
def _slide_step(plant, drive, t0, tau, x, v, s, h, kx, kv):
    """One explicit step in direction s: new state, errors of x and v, final rate."""
    kx[0] = v
    kv[0] = _slide_rate(plant, drive, t0, tau, x, v, s)
    for i in range(5):
        xi = x
        vi = v
        for j in range(i + 1):
            xi += h * _DP_A[i, j] * kx[j]
            vi += h * _DP_A[i, j] * kv[j]
        kx[i + 1] = vi
        kv[i + 1] = _slide_rate(plant, drive, t0, tau + _DP_C[i] * h, xi, vi, s)
    xn = x
    vn = v
    ex = 0.0
    ev = 0.0
    for i in range(6):
        xn += h * _DP_B[i] * kx[i]
        vn += h * _DP_B[i] * kv[i]
        ex += h * _DP_E[i] * kx[i]
        ev += h * _DP_E[i] * kv[i]
    rate = _slide_rate(plant, drive, t0, tau + h, xn, vn, s)
    return xn, vn, ex - h * vn / 40, ev - h * rate / 40, rate


@njit(cache=True, error_model="numpy")
def _time_to_band(plant, drive, t0, tau, x, v, s, h, band, kx, kv):
    """Step length in (0, h] after which s v has fallen to the band (Illinois method)."""
    low, at_low = 0.0, s * v - band
    high = h
    v_high = _slide_step(plant, drive, t0, tau, x, v, s, h, kx, kv)[1]
    at_high = s * v_high - band
    side = 0
    for _ in range(100):
        middle = between(low, at_low, high, at_high)
        if middle == high:
            break
        at = s * _slide_step(plant, drive, t0, tau, x, v, s, middle, kx, kv)[1] - band
        low, at_low, high, at_high, side = narrowed(low, at_low, high, at_high, side, middle, at)
        if at == 0.0:
            break
    return high


@njit(cache=True, error_model="numpy")
def _dip(v, rate, vn, rate_n, s, band, h):
    """Time of a minimum of s v below the band in a step, or 0 (cubic through the ends)."""
    r0 = s * rate * h
    r1 = s * rate_n * h
    if not (r0 < 0.0 < r1):
        return 0.0
    rise = s * (vn - v)
    # s v = a + r0 q + b q^2 + c q^3 on q in [0, 1]; the minimum is where its slope is 0.
    b = 3 * rise - 2 * r0 - r1
    c = r0 + r1 - 2 * rise
    q = -r0 / (b + math.sqrt(max(b * b - 3 * c * r0, 0.0)))
    lowest = s * v + q * (r0 + q * (b + q * c))
    return q * h if lowest < band else 0.0


@njit(cache=True, error_model="numpy")
def _over(plant, drive, t0, tau, x, s, rest, static):
    """Load beyond what friction can hold at rest against motion in direction s."""
    w = load(plant, drive, t0, tau, x, 0.0, 0.0, rest)
    if static:
        return s * w - breakaway_level(plant, t0 + tau, x, w, s, rest)
    return s * w - sliding_level(plant, t0 + tau, x, 0.0, w, s)


@njit(cache=True, error_model="numpy")
def _rest_forces(plant, drive, t0, tau, x, band, rest, static):
    """At rest, for + and -: load beyond friction, and net force at the band's edge."""
    mass = 1 / plant.numbers[INVERSE_MASS]
    return (
        _over(plant, drive, t0, tau, x, 1.0, rest, static),
        _over(plant, drive, t0, tau, x, -1.0, rest, static),
        _slide_rate(plant, drive, t0, tau, x, band, 1.0) * mass,
        -_slide_rate(plant, drive, t0, tau, x, -band, -1.0) * mass,
    )


@njit(cache=True, error_model="numpy")
def _push(now, end, left, room, inverse_mass):
    """Time until the band is left, the side, and the speed gained meanwhile.

    `now` and `end` are the `_rest_forces` at the start and end of the time `left`; in
    between they are assumed linear, which is exact unless an effect depends on time. A
    load beyond friction accelerates the mass up to the band's edge (`room` away). The mass
    leaves the band once the net force at the edge points outwards: otherwise drag that
    begins at the edge could cause endless switching.
    """
    side = -1
    start = left
    for i in range(2):
        # Ignore the round-off left of a load that has just fallen below friction.
        if now[i] > 0.0 and now[i] > -1e-12 * end[i]:
            side, start = i, 0.0
        elif end[i] > 0.0:
            crossing = left * now[i] / (now[i] - end[i])
            if crossing < start:
                side, start = i, crossing
    if side < 0:
        return left, 0, 0.0
    s = 1 - 2 * side
    over = max(now[side], 0.0)
    slope = (end[side] - now[side]) / left
    last = left
    if end[side] < 0.0:
        last = min(last, start - over / slope)
    need = room[side] / inverse_mass
    inside = over * over + 2 * slope * need
    out = last
    if inside >= 0.0:
        root = over + math.sqrt(inside)
        out = start + (2 * need / root if root > 0.0 else 0.0)
    if out > last or inside < 0.0:
        gain = (over + 0.5 * slope * (last - start)) * (last - start) * inverse_mass
        return last, 0, s * gain
    outward, outward_end = now[2 + side], end[2 + side]
    if outward + (outward_end - outward) * out / left < 0.0:
        out = left * outward / (outward - outward_end) if outward_end > 0.0 else last
        if out >= last:
            return last, 0, s * room[side]
    return out, s, 0.0


@njit(cache=True, error_model="numpy")
def run_switched(numbers, integers, band, static, u, dt, first, x0, v0, tolerance, out):
    """Sign (band 0) and Karnopp (static) laws.

    Rows x, v, F, mode of `out` are filled; returns 0, or 1 + the sample that failed.
    """
    plant = point(numbers, integers)
    inverse_mass = numbers[INVERSE_MASS]
    kx = np.empty(6)
    kv = np.empty(6)
    here = np.zeros(2)
    x = x0
    v = v0
    s = 0
    if abs(v) > band:
        s = 1 if v > 0 else -1
    v_scale = force_scale(plant, 0.0, x0) * dt * inverse_mass
    h = dt
    rest = 0.0
    n = u.size
    for k in range(n):
        t0 = k * dt
        here[0], here[1] = x, v if s != 0 else 0.0
        drive = sampled_drive(plant, t0, dt, here, u[k], u[k + 1] if first and k + 1 < n else u[k])
        if s != 0:
            w = load(plant, drive, t0, 0.0, x, v, s, 0.0)
            friction = s * sliding_level(plant, t0, x, v, w, s)
        else:
            w = load(plant, drive, t0, 0.0, x, 0.0, 0.0, rest)
            friction = w
            for side in (1.0, -1.0):
                over = _over(plant, drive, t0, 0.0, x, side, rest, static)
                if over > 0.0:
                    friction = w - side * over
        out[0, k] = x
        out[1, k] = here[1]
        out[2, k] = friction
        out[3, k] = s
        if k == n - 1:
            break
        tau = 0.0
        for substep in range(MOST_SUBSTEPS + 1):
            left = dt - tau
            if left <= _SHORTEST * dt:
                break
            if substep == MOST_SUBSTEPS:
                return k + 1
            if s == 0:
                now = _rest_forces(plant, drive, t0, tau, x, band, rest, static)
                end = _rest_forces(plant, drive, t0, dt, x, band, rest + left, static)
                wait, s, gain = _push(now, end, left, (band - v, band + v), inverse_mass)
                v += gain
                tau += wait
                rest += wait
                if s != 0:
                    v = s * band
                    h = dt
                continue
            step = min(h, left, numbers[SHORT_TIME])
            rate = _slide_rate(plant, drive, t0, tau, x, v, s)
            xn, vn, ex, ev, rate_n = _slide_step(plant, drive, t0, tau, x, v, s, step, kx, kv)
            error = max(
                abs(ex) / (tolerance * (abs(x) + v_scale * dt)),
                abs(ev) / (tolerance * (max(abs(v), abs(vn)) + v_scale)),
            )
            if abs(xn - x) > numbers[SHORT_WAY]:
                h = 0.9 * step * numbers[SHORT_WAY] / abs(xn - x)
                continue
            if not error <= 1.0:
                h = step * (max(0.2, 0.9 * error**-0.2) if error < 1e300 else 0.2)
                if h < GIVE_UP * dt:
                    return k + 1
                continue
            crossed = s * vn < band
            # A motion that starts at the band's edge points outwards, up to round-off.
            if not crossed and s * v > band:
                dip = _dip(v, rate, vn, rate_n, s, band, step)
                if dip > 0.0:
                    vd = _slide_step(plant, drive, t0, tau, x, v, s, dip, kx, kv)[1]
                    if s * vd < band:
                        step, crossed = dip, True
            if crossed:
                step = _time_to_band(plant, drive, t0, tau, x, v, s, step, band, kx, kv)
                x = _slide_step(plant, drive, t0, tau, x, v, s, step, kx, kv)[0]
                v = s * band
                s = 0
                rest = 0.0
            else:
                x = xn
                v = vn
                # A step that was limited by the end of the sample may be longer next time.
                h = max(
                    h if step == left else 0.0, step * min(5.0, 0.9 * max(error, 1e-10) ** -0.2)
                )
            tau += step
    return 0
