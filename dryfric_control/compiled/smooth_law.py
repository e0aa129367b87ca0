"""Compiled solution of an axis under a smooth friction law: tanh, or bristles (Dahl, LuGre).

The states are position, velocity and deflection of the bristles::

    x' = v,  m v' = w - f v - F
    tanh      F = level tanh(v / width),  z' = 0
    bristles  z' = v - sigma0 |v| z / level,  F = sigma0 z + sigma1 z'

They are stiff, and bend at v = 0.  Each sample is integrated by RODAS, a stiffly stable Rosenbrock
method of order 4 with an error estimate of order 3 (E. Hairer, G. Wanner, Solving Ordinary
Differential Equations II, 2nd ed. 1996, section IV.10); no step passes the end of a sample.
"""
# mypy: disallow-untyped-defs=False

from __future__ import annotations

import math

import numpy as np

from dryfric_control.compiled import axis_step as step
from dryfric_control.compiled.cached import njit

#: Parameters of a law: width of tanh (0: bristles), stiffness and damping of bristles.
WIDTH, STIFFNESS, DAMPING = range(3)

# RODAS: the diagonal, stages of the state, of earlier stages, and of the derivative by time.
_GAMMA = 0.25
_STAGES = 6
_A = np.zeros((6, 6))
_A[1, :1] = 1.544
_A[2, :2] = 0.9466785280815826, 0.2557011698983284
_A[3, :3] = 3.314825187068521, 2.896124015972201, 0.9986419139977817
_A[4, :4] = 1.221224509226641, 6.019134481288629, 12.53708332932087, -0.6878860361058950
_A[5, :4] = _A[4, :4]
_A[5, 4] = 1.0
_C = np.zeros((6, 6))
_C[1, :1] = -5.6688
_C[2, :2] = -2.430093356833875, -0.2063599157091915
_C[3, :3] = -0.1073529058151375, -9.594562251023355, -20.47028614809616
_C[4, :4] = 7.496443313967647, -10.24680431464352, -33.99990352819905, 11.70890893206160
_C[5, :4] = 8.083246795921522, -7.981132988064893, -31.52159432874371, 16.31930543123136
_C[5, 4] = -6.058818238834054
_TIMES = np.array([0.0, 0.386, 0.21, 0.63, 1.0, 1.0])
_BY_TIME = np.array([0.25, -0.1043, 0.1035, -0.03620000000000023, 0.0, 0.0])

# Step-size rule: safety factor, and the largest factors by which a step shrinks and grows.
_SAFETY = 0.9
_SHRINK = 0.2
_GROW = 5.0
# Shortest step, relative to a sample.
_SHORTEST = 1e-12
# Step of the differences of the Jacobian, relative to the state and its unit.
_NUDGE = 1e-6


@step.internal
def _friction(law, level, s, v, z):
    """Friction and velocity of the bristles in motion to side s."""
    if law[WIDTH] > 0.0:
        return level * math.tanh(v / law[WIDTH]), 0.0
    rate = v - law[STIFFNESS] * s * v * z / level
    return law[STIFFNESS] * z + law[DAMPING] * rate, rate


@step.internal
def _rates(plant, law, drive, t0, tau, s, y, out):
    """Derivatives of the state `y`, shape (3,), into `out`; friction is returned."""
    x = y[0]
    v = y[1]
    w = step.load(plant, drive, t0, tau, x, v, s, 0.0)
    level = step.sliding_level(plant, t0 + tau, x, v, w, s)
    friction, rate = _friction(law, level, s, v, y[2])
    out[0], out[1], out[2] = v, step.acceleration(plant, w, v, friction), rate
    return friction


@step.internal(forceinline=True)
def _side(v):
    """Direction of motion; the positive one at rest."""
    return 1.0 if v >= 0.0 else -1.0


@step.internal
def _jacobian(plant, law, drive, t0, tau, y, unit, h, slopes, work):
    """Derivatives of the rates by the state and by time, rows of `slopes`, shape (4, 3)."""
    # The side is kept: a difference across v = 0 would be of neither branch.
    s = _side(y[1])
    for i in range(3):
        kept = y[i]
        nudge = _NUDGE * (unit[i] + abs(y[i]))
        y[i] = kept + nudge
        _rates(plant, law, drive, t0, tau, s, y, work[0])
        y[i] = kept - nudge
        _rates(plant, law, drive, t0, tau, s, y, work[1])
        y[i] = kept
        for j in range(3):
            slopes[i, j] = (work[0, j] - work[1, j]) / (2.0 * nudge)
    nudge = _NUDGE * h
    _rates(plant, law, drive, t0, tau + nudge, s, y, work[0])
    _rates(plant, law, drive, t0, tau - nudge, s, y, work[1])
    for j in range(3):
        slopes[3, j] = (work[0, j] - work[1, j]) / (2.0 * nudge)


@step.internal
def _solve_stage(slopes, q, right, out):
    """Solution `out` of (q - J) out = right for a Jacobian whose first row is (0, 1, 0)."""
    bristles = q - slopes[2, 2]
    coupled = slopes[2, 1] / bristles
    pivot = q - slopes[1, 1] - slopes[0, 1] / q - coupled * (slopes[1, 2] + slopes[0, 2] / q)
    third = right[2] + slopes[0, 2] * right[0] / q
    out[1] = (right[1] + slopes[0, 1] * right[0] / q + coupled * third) / pivot
    out[0] = (right[0] + out[1]) / q
    out[2] = (right[2] + slopes[0, 2] * out[0] + slopes[1, 2] * out[1]) / bristles


@step.internal
def _stride(plant, law, drive, t0, tau, y, h, slopes, stages, at, work):
    """One step of RODAS of length h: the state after it into `at`, the error is stages[5]."""
    for i in range(_STAGES):
        for j in range(3):
            at[j] = y[j]
            for k in range(i):
                at[j] += _A[i, k] * stages[k, j]
        _rates(plant, law, drive, t0, tau + _TIMES[i] * h, _side(at[1]), at, work[0])
        for j in range(3):
            right = work[0, j] + h * _BY_TIME[i] * slopes[3, j]
            for k in range(i):
                right += _C[i, k] / h * stages[k, j]
            work[1, j] = right
        _solve_stage(slopes, 1.0 / (h * _GAMMA), work[1], stages[i])
    for j in range(3):
        at[j] += stages[5, j]


@step.internal
def _error(stages, y, at, unit, tolerance):
    """Error of a step relative to what is allowed."""
    total = 0.0
    for j in range(3):
        allowed = tolerance * (unit[j] + max(abs(y[j]), abs(at[j])))
        total += (stages[5, j] / allowed) ** 2
    return math.sqrt(total / 3.0)


@step.internal(forceinline=True)
def _factor(error):
    """Factor of the next step's length after one of this error, of order 4."""
    if not error < math.inf:
        return _SHRINK
    return min(_GROW, max(_SHRINK, _SAFETY * max(error, 1e-300) ** -0.25))


@step.internal
def _sample(plant, law, drive, t0, dt, y, unit, tolerance, length, longest, rows):
    """Move the state over one sample, in place; the length of the next step, 0: too short."""
    slopes = rows[:4]
    stages = rows[4:10]
    work = rows[10:12]
    at = rows[12]
    tau = 0.0
    known = False
    while tau < dt:
        whole = length >= (1.0 - _SHORTEST) * (dt - tau)
        h = dt - tau if whole else length
        if not known:
            _jacobian(plant, law, drive, t0, tau, y, unit, h, slopes, work)
        _stride(plant, law, drive, t0, tau, y, h, slopes, stages, at, work)
        error = _error(stages, y, at, unit, tolerance)
        known = not error <= 1.0
        if known:
            length = h * _factor(error)
            if length < _SHORTEST * dt:
                return 0.0
            continue
        y[:] = at
        tau = dt if whole else tau + h
        # A step cut short by the end of a sample does not shorten the next one.
        length = min(max(h * _factor(error), length if whole else 0.0), longest)
    return length


@njit(cache=True, error_model="numpy")
def run(numbers, integers, law, starts, ends, dt, y, unit, tolerance, longest, slow, out):
    """Integrate sample by sample; the first sample in which no step is short enough, or -1.

    `starts`, `ends`: the drive at both ends of each sample, shape (n,); `y`: the state x, v, z,
    moved in place; `unit`: the size of each near rest; `longest`: step; `slow`: the stick
    velocity; `out`: x, v, F and direction, shape (4, n).
    """
    plant = step.point(numbers, integers)
    rows = np.empty((13, 3))
    memory = np.zeros(2)
    length = min(dt, longest)
    for n in range(starts.size):
        t0 = n * dt
        side = _side(y[1])
        memory[0], memory[1] = y[0], y[1]
        out[0, n], out[1, n], out[3, n] = y[0], y[1], side if abs(y[1]) > slow else 0.0
        # The drive is linear between the inputs at which the laws on it bend.
        part = 0.0
        rise = ends[n] - starts[n]
        after = step.input_map(plant, t0, step.pointer(memory), starts[n])
        while part < 1.0:
            following = step.next_corner(plant, starts[n], ends[n], part) if rise != 0.0 else 1.0
            begin = after
            h = (following - part) * dt
            after = step.input_map(
                plant, t0, step.pointer(memory), starts[n] + following * rise
            )  # fmt: skip
            drive = step.Drive(begin, (after - begin) / h, 0.0, 0.0)
            at = t0 + part * dt
            if part == 0.0:
                out[2, n] = _rates(plant, law, drive, t0, 0.0, side, y, rows[0])
            length = _sample(plant, law, drive, at, h, y, unit, tolerance, length, longest, rows)
            if length == 0.0:
                return n
            part = following
    return -1
