"""Compiled hybrid filter: innovations of a record under an axis.

Position and velocity are predicted by the exact step of the axis, with switches
located inside the sample, and with every effect and its memory.  In parallel the
filter propagates the covariance of (x, v), P = p [1 g; g g^2] + d [0 0; 0 1]: p is
the variance of the position, g the slope of the velocity over it, and d the variance
of the velocity given the position.  A reading changes p only, so that P stays
positive.  While a contact sticks, its unstrained position is a third state.  Two masses on
a spring have four states, with the whole covariance.  Where velocities were read, position and
velocity change places in P while it is corrected.

Noises: a random force N(0, force), held over each sample, and noise N(0, reading)
of each reading.
"""
# mypy: disallow-untyped-defs=False

from __future__ import annotations

import math

import numpy as np

from dryfric_control.compiled import axis_step as step
from dryfric_control.compiled import elastic, two_masses
from dryfric_control.compiled.cached import njit
from dryfric_control.compiled.likelihood import FIRST, cost_of
from dryfric_control.compiled.states import (
    keep_states,
    return_states,
    shift_states,
    show_states,
)

#: Squared innovation over its variance beyond which a reading gets a lower weight.
DOUBTED = 9.0
# Squared innovation over its variance from which a reading is an outlier.
_STRANGE = 25.0
# Number of successive outliers on one side that shows that the axis has moved differently.
_IN_A_ROW = 3
# Velocity in encoder cells per sample from which a reading locates the axis within a cell: at
# lower speeds the same cell is read repeatedly, wherever in it the axis is.
_PACE = 0.15
# Fraction of the cell within which a prediction at such a speed is not corrected: there it is no
# evidence.
_INSIDE = 0.5
# Allowed error of the inertia force where inner states are set, as a fraction of the friction
# level.
_SEEN = 0.1
# Longest averaging for it, in multiples of FIRST samples.
_LONGEST = 8
# Error of the velocity there, as a fraction of its change during the averaging.
_CURVED = 0.25
# Slopes and variances of a velocity at rest are zero below this: they decay for ever, and
# denormal numbers are slow.
_NOTHING = 1e-100
# Variance of the creep of a resting axis per sample, as a fraction of the reading's variance.
_CREEP = 0.01
# Standard deviations of the velocity within which its sign is uncertain, and the velocities,
# forces and weights that then represent its distribution, as in an unscented transform (Julier
# and Uhlmann 2004): the mean last. A random force that may break the axis away adds variance
# but does not change the mean: noise recorded with the input does not act on the axis, and a
# creeping mean would be false evidence for effects at rest.
_NEAR = 3.0
_SPEEDS = (math.sqrt(3.0), -math.sqrt(3.0), 0.0, 0.0, 0.0)
_FORCES = (0.0, 0.0, math.sqrt(3.0), -math.sqrt(3.0), 0.0)
_MEANS = (1.0 / 6.0, 1.0 / 6.0, 0.0, 0.0, 2.0 / 3.0)
_WEIGHTS = (1.0 / 6.0, 1.0 / 6.0, 1.0 / 6.0, 1.0 / 6.0, 2.0 / 3.0)
# A drive that has exceeded the breakaway level by less than the first number, in standard
# deviations of the sum of the random force since then, may be noise of the recorded input: the
# mean stays at rest.  Beyond the second number it moves.
_MAY_HOLD = (1.5, 3.0)
# Least stiffness of bristles over that of unstrained ones for which they creep.
_SOFTEST = 0.05
# Margin to breakaway, in standard deviations of the random force, beyond which it is excluded.
_SAFE = 7.0
# Relative error allowed for a smooth step, in addition to the error allowed by the numbers.
_TOLERANCE = 1e-6


@step.internal
def _slopes(plant, t, x, v, held, s, dx, k):
    """Change of the sliding acceleration k with position and velocity."""
    i = plant.integers
    inverse = plant.numbers[step.INVERSE_MASS]
    laws = i[step.N_FORCE] + i[step.N_LEVEL]
    by_v = -plant.numbers[step.VISCOUS] * inverse
    if laws > i[step.N_PLACE] or plant.numbers[step.EXCESS] != 0.0:
        dv = 1e-3 * s * (abs(v) + plant.numbers[step.STICK_SPEED])
        by_v = (_rate(plant, held, t, x, v + dv, s) - k) / dv
    by_x = 0.0
    if laws > 0 or i[step.N_PLUS] + i[step.N_MINUS] > 2:
        by_x = (_rate(plant, held, t, x + dx, v, s) - k) / dx
    return by_x, by_v


@step.internal
def _slope_by_states(plant, t, m, held, s, dx, k):
    """Change of the sliding acceleration k with states that follow the position."""
    way = math.copysign(dx, s)  # along the motion: a state at its limit stays there
    keep_states(plant, m)
    shift_states(plant, t, m, held.start, way)
    slope = (_rate(plant, held, t, m[step.X], m[step.V], s) - k) / way
    return_states(plant, m)
    return slope


@step.internal
def _rate(plant, held, t, x, v, s):
    """Acceleration of the sliding mode."""
    w = step.load(plant, held, t, 0.0, x, v, s, 0.0)
    friction = s * step.sliding_level(plant, t, x, v, w, s)
    return (w - plant.numbers[step.VISCOUS] * v - friction) * plant.numbers[step.INVERSE_MASS]


@step.internal
def _smooth(plant, drive, t, h, x, v, s, k1):
    """Try a sliding sample in one step: whether no switch is near, and the state.

    Same integration step as that of the axis, but its error only needs to be far below
    the noise, not exact enough for switching times.
    """
    sigma = plant.numbers[step.STICK_SPEED]
    x1, v1, k2, k3, k4, placed = step.slide(plant, drive, t, 0.0, x, v, s, k1, h)
    allowed = _TOLERANCE * (abs(v) + sigma + h * abs(k1)) + plant.numbers[step.ALLOWED]
    lowest = min(s * v, s * v1)
    if s * k1 < 0.0 and s * k4 > 0.0:
        part = k1 / (k1 - k4)
        lowest = min(lowest, s * (v + 0.5 * part * h * k1))
    error = step.step_error(plant, drive, k1, k2, k3, k4, placed, x1 - x, h, allowed)
    error += step.peak_error(plant, x, v, v1, s, k1, k4, h)
    calm = (
        lowest > sigma
        and abs(x1 - x) <= plant.numbers[step.SHORT_WAY]
        and h <= plant.numbers[step.SHORT_TIME]
        and step.peak_step(plant, v, v1, s, h) == h
        and error <= allowed
    )
    return calm, x1, v1


@step.internal
def _slides(plant, drive, t, h, m, x, v, x1, v1, s):
    """Whether a contact slides in a sample at the level of each moment, and its deflection then."""
    w = step.load(plant, drive, t, h, x1, v1, s, 0.0)
    after = step.sliding_level(plant, t + h, x1, v1, w, s)
    stiffness = plant.numbers[step.CONTACT_STIFFNESS]
    end = s * after / stiffness
    if plant.numbers[step.BRISTLES] == 0.0:
        return True, end
    w = step.load(plant, drive, t, 0.0, x, v, s, 0.0)
    level = step.sliding_level(plant, t, x, v, w, s)
    # What their force has yet to change, and how much it lags behind a level that changes.
    off = abs(stiffness * m[step.DEFLECTION] - s * level)
    length = level / stiffness
    off = (off + abs(after - level)) * min(length / abs(x1 - x), 1.0)
    allowed = _TOLERANCE * abs(v) + plant.numbers[step.ALLOWED]
    calm = off * h * plant.numbers[step.INVERSE_MASS] <= allowed
    return calm, end if calm else m[step.DEFLECTION]


@step.internal
def _coarse_step(plant, held, t, h, x, v, rest, fall):
    """One sample from a sigma point: position, velocity and mode at its end.

    Assumes constant acceleration between switches; the error is far below the width of
    the distribution.  `fall`: fraction of its velocity that an axis at rest loses in the
    sample.
    """
    sigma = plant.numbers[step.STICK_SPEED]
    if abs(v) > sigma:
        s = 1.0 if v > 0.0 else -1.0
        end = v + h * _rate(plant, held, t, x, v, s)
        if s * end > sigma:
            end = v + h * _rate(plant, held, t, x + 0.5 * h * v, 0.5 * (v + end), s)
        if s * end > sigma:
            return x + 0.5 * h * (v + end), end, s
        moving = h * (v - s * sigma) / (v - end)
        x += 0.5 * (v + s * sigma) * moving
        v = s * sigma
        h -= moving
        fall = -math.expm1(-plant.numbers[step.STICK_RATE] * h)
    w = step.load(plant, held, t, 0.0, x, 0.0, 0.0, rest)
    s = 1.0 if w > 0.0 else -1.0
    if s * w > step.breakaway_level(plant, t, x, w, s, rest):
        v = max(s * v, 0.0) * s
        end = v + h * _rate(plant, held, t, x, s * sigma, s)
        if s * end > 0.0:
            return x + 0.5 * h * (v + end), end, s
    return x + v * fall / plant.numbers[step.STICK_RATE], v - v * fall, 0.0


# Places in the play at which a record that begins at rest may start.
_PLACES = (-1.0, -0.75, -0.5, -0.25, 0.0, 0.25, 0.5, 0.75, 1.0)
# Bounds of a state.  Beyond, the filter gives up: an axis that accelerates by itself, as with
# negative friction, would be integrated through every period of its position-dependent forces.
# Distance from the start over the travel of the record, or that many times as many cells.
_LOST = 10.0
# Velocity over the fastest readings, or that many times as many cells per sample.
_FASTER = 100.0


@njit(cache=True, error_model="numpy")
def _escape(margin, deviation):
    """Mean square effect of a random force on an axis at a margin from breakaway.

    E[(max(n - M, 0) - max(-M, 0))^2] for n ~ N(0, deviation^2): from 0 far below
    breakaway to deviation^2 where the axis slides anyway.
    """
    z = margin / deviation
    if z > _SAFE:
        return 0.0
    beyond = 0.5 * math.erfc(z / math.sqrt(2.0))
    density = math.exp(-0.5 * z * z) / math.sqrt(2.0 * math.pi)
    square = (1.0 + z * z) * beyond - z * density
    if z < 0.0:
        mean = density - z * beyond
        square += 2.0 * z * mean + z * z
    return max(square, 0.0) * deviation * deviation


@step.internal
def _random_force(plant, t, dt, memory, u, deviation):
    """Variance of the random force that can move a resting axis."""
    force = step.drive_now(plant, t, dt, memory, u)
    if plant.integers[step.STRUCTURE] & step.MOTOR_RUBS:
        force += elastic.spring_force(plant, memory[step.OFFSET], memory[step.SLIP])
    drive = step.held_force(force)
    x = memory[step.X]
    v = memory[step.V]
    rest = memory[step.REST]
    w = step.load(plant, drive, t, 0.0, x, v, 0.0, rest)
    total = 0.0
    for s in (1.0, -1.0):
        margin = step.breakaway_level(plant, t, x, w, s, rest) - s * w
        if margin < _SAFE * deviation:
            total += _escape(margin, deviation)
    return min(total, deviation * deviation)


@step.internal
def _is_in_contact(plant, memory):
    """Whether motor and load touch across a play and move together."""
    return elastic.contact_side(plant, memory) != 0.0 and memory[step.SLIP] == 0.0


@step.internal
def _pulled_off(plant, t, dt, memory, u, deviation):
    """Variance of the random force that can pull the motor off a resting load.

    Referred to the sum of both masses, as it then moves the motor alone.
    """
    kind = plant.integers[step.STRUCTURE]
    if not kind & step.PLAY or kind & (step.ON_LOAD | step.MOTOR_RUBS):
        return 0.0
    drive = step.drive_now(plant, t, dt, memory, u)
    press = -math.copysign(1.0, memory[step.OFFSET]) * drive
    more = plant.numbers[step.INVERSE_MOTOR] / plant.numbers[step.INVERSE_MASS]
    return _escape(press, deviation) * more * more


@step.internal
def _breakaway_excess(plant, held, t, x, v, rest):
    """Side to which the drive pulls, and its excess over what friction can hold, negative below."""
    w = step.load(plant, held, t, 0.0, x, v, 0.0, rest)
    s = 1.0 if w > 0.0 else -1.0
    level = step.breakaway_level(plant, t, x, w, s, rest)
    beyond = s * w - level
    if beyond > 0.0:
        # A level that grows with the load falls with the drive.
        less = level - step.breakaway_level(plant, t, x, w - s * beyond, s, rest)
        beyond *= beyond / max(beyond - less, 1e-3 * beyond)
    return s, beyond


@step.internal(forceinline=True)
def _friction_inverse_mass(plant):
    """Inverse mass of the one of two masses that has the friction."""
    return plant.numbers[plant.integers[step.N_NUMBERS] + step.INVERSE_MASS]


@step.internal
def _settle(plant, t, dt, memory, u, y, k, alike):
    """Set inner states from the motion around reading k; the error of its velocity.

    If the motion is not significant, the axis is at rest and its contact is strained by
    the acting force, whatever the scatter of the readings.
    """
    n = y.shape[0]
    inverse = plant.numbers[step.INVERSE_MASS]
    level = step.base_level(plant, y[k], 1.0)
    w = min(FIRST, max((n - 1) // 2, 1))
    while alike > _SEEN * level * inverse * (w * dt) ** 2 and w <= _LONGEST * FIRST and 8 * w < n:
        w *= 2
    a = min(max(k - w, 0), max(n - 1 - 2 * w, 0))
    way = 0.0
    bend = 0.0
    if n > 2 * w:
        way = y[a + 2 * w] - y[a]
        bend = y[a + 2 * w] - 2.0 * y[a + w] + y[a]
    numbers = plant.numbers
    kind = plant.integers[step.STRUCTURE]
    behind = kind & (step.PLAY | step.SPRING) != 0
    v = 0.0
    bent = 0.0
    inertia = 0.0
    if abs(way) > alike:
        v = way / (2.0 * w * dt)
        bent = bend / (w * dt) ** 2
        # With two masses, the inertia of the load only: it is what the transmission carries.
        inertia = bent / numbers[step.INVERSE_MOTOR] if behind else bent / inverse
        inertia += 0.0 if behind else numbers[step.VISCOUS] * v
    memory[step.V] = 0.0
    step.settle(plant, t, dt, memory, u, inertia)
    memory[step.V] = v
    if kind & step.PLAY and not kind & step.ON_LOAD and v != 0.0:
        drive = step.drive_now(plant, t, dt, memory, u)
        net = drive - numbers[step.VISCOUS] * v - math.copysign(level, v)
        rubs = kind & step.MOTOR_RUBS != 0
        alone = net * _friction_inverse_mass(plant) if rubs else drive * numbers[step.INVERSE_MOTOR]
        if abs(bent - alone) < abs(bent - net * inverse):
            # The motor moves alone: its position within the play is unknown.
            memory[step.OFFSET], memory[step.SLIP] = 0.0, 0.0 if rubs else -v
    return alike / (w * dt) + _CURVED * abs(bent) * w * dt


@step.internal
def _rest_count(y, k, gives):
    """Number of samples for which the readings have been no farther from reading k than `gives`."""
    j = k
    while j > 0 and abs(y[j - 1] - y[k]) <= gives:
        j -= 1
    return k - j


@step.internal
def _predict_near(
    plant, m, events, count, points, t, dt, u0, end, x, v, mode, p, g, d, deviation, fall, reading,
    plain, over, pulled, pull,
):  # fmt: skip
    """One sample near breakaway, where the mode at its end is uncertain.

    Simulates sigma points of velocity and random force, each with its own mode.  Returns the
    covariance, and how often and how far the drive has pulled beyond friction, and to which side.
    """
    total = d + g * g * p
    width = math.sqrt(total)
    x_mean = 0.0
    v_mean = 0.0
    resting = 1.0
    slope = g * p / total if total > 0.0 else 0.0
    drive = step.drive_now(plant, t, dt, m, 0.5 * (u0 + end))
    rest = m[step.REST]
    doubt = 0.0
    if mode == 0:
        s, beyond = _breakaway_excess(plant, step.held_force(drive), t, x, v, rest)
        # The excess of so many samples that is noise grows as their root.
        pulled = max(pulled + beyond, 0.0) if s == pull else max(beyond, 0.0)
        over = over + 1 if pulled > beyond else 1
        pull = s
        sure, certain = _MAY_HOLD
        part = (certain - pulled / (deviation * math.sqrt(over))) / (certain - sure)
        doubt = s * max(beyond, 0.0) * min(max(part, 0.0), 1.0) * (1.0 + 1e-9)
    if not plain:
        # This also advances the drive.
        count[0] = 0
        step.sample(plant, t, dt, u0, end, m, events, count)
    for i in range(5):
        c = _SPEEDS[i] * width
        if i < 4 or plain or doubt != 0.0:
            felt = drive - (doubt if _FORCES[i] == 0.0 else 0.0)
            x1, v1, mode1 = _coarse_step(
                plant, step.held_force(felt + _FORCES[i] * deviation), t, dt,
                x + slope * c, v + c, rest, fall,
            )  # fmt: skip
        else:
            x1 = m[step.X]
            v1 = m[step.V]
            mode1 = m[step.MODE]
        if mode1 != 0.0:
            resting = 0.0
        x_mean += _MEANS[i] * x1
        v_mean += _MEANS[i] * v1
        points[i], points[5 + i] = x1, v1
    if plain or doubt != 0.0:
        at_rest = mode == 0 and mode1 == 0.0
        m[step.REST] = rest + dt if at_rest else 0.0
        m[step.MODE] = mode1
    m[step.X], m[step.V] = x_mean, v_mean
    # The variance of the position given the velocity is kept.
    m00 = p * d / total if total > 0.0 else p
    m00 += resting * _CREEP * reading
    m01 = 0.0
    m11 = 0.0
    for i in range(5):
        a = points[i] - x_mean
        b = points[5 + i] - v_mean
        if _MEANS[i] == 0.0:
            a = points[i] - points[4]
            b = points[5 + i] - points[9]
        m00 += _WEIGHTS[i] * a * a
        m01 += _WEIGHTS[i] * a * b
        m11 += _WEIGHTS[i] * b * b
    m00 = max(m00, 1e-6 * reading)
    p = m00
    g = m01 / m00
    d = max(m11 - m01 * g, 1e-9 * m11)
    return p, g, d, over, pulled, pull


@step.internal(forceinline=True)
def _predict(plant, m, events, count, t, dt, u0, end, x, v, mode, two, plain, first, dx):
    """One sample of an axis whose mode is sure; slopes of its acceleration at the start."""
    by_x = 0.0
    by_v = 0.0
    k1 = 0.0
    gives = 1.0
    if mode != 0 and not two:
        held = step.held_force(step.drive_now(plant, t, dt, m, u0))
        if not plant.integers[step.STRUCTURE] & step.MOTOR_RUBS:
            x += m[step.OFFSET]  # of the load, on which all forces act
        k1 = _rate(plant, held, t, x, v, float(mode))
        by_x, by_v = _slopes(plant, t, x, v, held, float(mode), dx, k1)
        if plant.integers[step.N_STATES] > 0:
            by_x += _slope_by_states(plant, t, m, held, float(mode), dx, k1)
    calm = False
    x1 = x
    v1 = v
    if mode != 0 and plain and (not first or step.is_straight(plant, u0, end)):
        start = step.input_map(plant, t, m, u0)
        stop = start if not first else step.input_map(plant, t, m, end)
        drive = step.Drive(start, (stop - start) / dt, 0.0, 0.0)
        calm, x1, v1 = _smooth(plant, drive, t, dt, x, v, float(mode), k1)
        if calm and plant.integers[step.STRUCTURE] != 0:
            calm, m[step.DEFLECTION] = _slides(plant, drive, t, dt, m, x, v, x1, v1, float(mode))
    if calm:
        m[step.X], m[step.V] = x1, v1
        m[step.MODE], m[step.REST] = float(mode), 0.0
    else:
        count[0] = 0
        step.sample(plant, t, dt, u0, end, m, events, count)
    if mode == 0:
        if plant.integers[step.STRUCTURE] & step.CONTACT != 0:
            by_x = -plant.numbers[step.CONTACT_STIFFNESS] * plant.numbers[step.INVERSE_MASS]
            by_v = -plant.numbers[step.VISCOUS] * plant.numbers[step.INVERSE_MASS]
            if plant.numbers[step.BRISTLES] != 0.0:
                gives = _stiff(plant, x, m[step.X] - x, m[step.DEFLECTION])
        by_v -= gives * plant.numbers[step.STICK_RATE]
    return by_x, by_v, gives


@step.internal(forceinline=True)
def _stiff(plant, x, way, z):
    """Stiffness along a way of bristles deflected by z over that of unstrained ones."""
    s = 1.0 if way > 0.0 else -1.0
    return max(1.0 - s * z / _deflection_limit(plant, x, s), 0.0)


@step.internal
def _deflection_limit(plant, x, s):
    """Largest deflection of a contact for motion along s."""
    level = step.base_level(plant, x, s) * (1.0 + plant.numbers[step.EXCESS])
    return max(level, 1e-300) / plant.numbers[step.CONTACT_STIFFNESS]


@step.internal
def _swing(by_x, by_v, dt):
    """How position and velocity of a mass on a spring move in one sample."""
    fall = -0.5 * by_v
    square = -by_x - 0.25 * by_v * by_v
    if square * dt * dt > 1e-6:
        turn = math.sqrt(square)
        still = math.exp(-fall * dt)
        cosine = still * math.cos(turn * dt)
        sine = still * math.sin(turn * dt) / turn
    elif square * dt * dt < -1e-6:
        turn = math.sqrt(-square)
        slow = math.exp((turn - fall) * dt)
        fast = math.exp(-(turn + fall) * dt)
        cosine = 0.5 * (slow + fast)
        sine = 0.5 * (slow - fast) / turn
    else:
        cosine = math.exp(-fall * dt)
        sine = dt * cosine
    return cosine + fall * sine, sine, by_x * sine, cosine - fall * sine


@step.internal(forceinline=True)
def _spread(by_x, by_v, dt, inverse, variance, creep, p, g, d):
    """Covariance after one sample, P = F P F' + variance b b'.

    `by_x`, `by_v`: slopes of the acceleration; `creep`: variance of the position that an axis
    at rest gains, so that the filter stays adaptive.
    """
    z = min(max(by_v * dt, -50.0), 2.0)
    if abs(z) > 1e-3:
        f11 = math.exp(z)
        f01 = dt * (f11 - 1.0) / z
    else:
        f11 = 1.0 + z * (1.0 + 0.5 * z)
        f01 = dt * (1.0 + 0.5 * z)
    h = min(max(by_x * dt * dt, -1.0), 1.0)
    f00 = 1.0 + 0.5 * h
    f10 = h / dt * (f01 / dt)
    f11 = f11 + 0.5 * h
    along = f00 + f01 * g
    across = f10 + f11 * g
    m00 = along * along * p + f01 * f01 * d
    m01 = along * across * p + f01 * f11 * d
    det = (f00 * f11 - f01 * f10) ** 2 * p * d
    if creep > 0.0:
        det += creep * (across * across * p + f11 * f11 * d)
        m00 += creep
    g = m01 / m00
    d = det / m00
    b0 = 0.5 * dt * dt * inverse
    b1 = dt * inverse
    moved = b1 - g * b0
    # Rank-one update: the determinant grows by variance b' adj(M) b.
    d_new = d * m00 + variance * (m00 * moved * moved + d * b0 * b0)
    m01 = g * m00 + variance * b0 * b1
    m00 += variance * b0 * b0
    return m00, m01 / m00, d_new / m00


@step.internal
def _elastic_covariance(by_x, by_v, gives, keeps, dt, inverse, variance, p, g, d, c0, c1, anchor):
    """Covariance after one sample on an elastic contact, with the place where it is unstrained.

    `by_x`, `by_v`: slopes of the acceleration with the deflection and the velocity; the deflection
    changes by `gives` with the position, and `keeps` that part of itself; c0, c1, anchor:
    covariances of the place without strain with position and velocity, and its variance.
    """
    f00, f01, f10, f11 = _swing(gives * by_x, by_v, dt)
    if gives > 1e-6:
        pull0 = (f00 - 1.0) / gives
        pull1 = f10 / gives
    else:
        pull0 = 0.5 * by_x * dt * dt
        pull1 = by_x * f01
    b0 = pull0 / by_x * inverse
    b1 = f01 * inverse
    # Of position x, velocity v, deflection z.
    vv, xv, xz, vz, zz = d + g * g * p, g * p, p - c0, g * p - c1, p - 2.0 * c0 + anchor
    on_x = p + f01 * xv + pull0 * xz
    on_v = f11 * xv + pull1 * xz
    x_z = xz + f01 * vz + pull0 * zz
    v_z = f11 * vz + pull1 * zz
    x_v = xv + f01 * vv + pull0 * vz
    m00 = on_x + f01 * x_v + pull0 * x_z
    m01 = f11 * x_v + pull1 * x_z
    m11 = f11 * (f11 * vv + pull1 * vz) + pull1 * v_z
    zz = keeps * keeps * zz + gives * (2.0 * keeps * (x_z - xz) + gives * (m00 - 2.0 * on_x + p))
    xz = keeps * x_z + gives * (m00 - on_x)
    vz = keeps * v_z + gives * (m01 - on_v)
    det = max(m00 * m11 - m01 * m01, 1e-9 * m00 * m11)
    # What a random force bends does not all come back: it bends them by 1/gives, and back by
    # 1/(2 - gives), half of the time; in one sample by no more than a mass without a contact moves.
    loose = 0.5 * dt * dt * inverse
    softness = -inverse / by_x
    forth = min(softness / max(gives, _SOFTEST), loose)
    back = min(softness / (2.0 - max(gives, _SOFTEST)), loose)
    creep = 0.5 * variance * (forth - back) * (forth - back)
    det += creep * m11
    m00 += creep
    g = m01 / m00
    d = det / m00
    moved = b1 - g * b0
    d_new = d * m00 + variance * (m00 * moved * moved + d * b0 * b0)
    m01 = g * m00 + variance * b0 * b1
    m00 += variance * b0 * b0
    xz = xz + gives * variance * b0 * b0
    vz = vz + gives * variance * b0 * b1
    zz += gives * gives * variance * b0 * b0
    c0 = m00 - xz
    c1 = m01 - vz
    return m00, m01 / m00, d_new / m00, c0, c1, max(2.0 * c0 - m00 + zz, 0.0)


@step.internal
def _swap_states(p, g, d):
    """The same covariance with the states in the other order."""
    total = d + g * g * p
    if total <= 0.0:
        return 0.0, 0.0, p
    return total, g * p / total, p * d / total


@step.internal
def _velocity(plant, t, m, dx):
    """Rate of change of what the encoder reads."""
    on_load = plant.integers[step.STRUCTURE] & step.ON_LOAD != 0
    x = m[step.X]
    v = m[step.V] + (m[step.SLIP] if on_load else 0.0)
    if plant.integers[step.N_READING] > 0:
        here = step.encoder_reading(plant, t, m)
        m[step.X] = x + dx
        v *= (step.encoder_reading(plant, t, m) - here) / (m[step.X] - x)
        m[step.X] = x
    return v


@step.internal(forceinline=True)
def _in_cell(e, step_by, cell, reading):
    """Innovation within increments: for the state, for the likelihood, and the state's share of it.

    While the axis hardly moves a reading says only in which increment the axis is.
    """
    if cell <= 0.0:
        return e, e, 1.0
    paces = step_by / (_PACE * cell)
    slow = 1.0 / (1.0 + paces * paces)
    within = 0.5 * cell * slow
    outside = e - min(max(e, -within), within)
    counts = 1.0 - slow * reading / (reading + outside * outside)
    within *= _INSIDE
    return e - min(max(e, -within), within), outside, counts


@step.internal
def _begin(plant, m, t0, dt, rested, u0, y, v0, place, alike):
    """State at the first reading, from a place in the play, -1 to 1; nan: unknown."""
    m[step.X], m[step.V] = y[0], v0
    held = step.input_map(plant, t0, m, u0)
    for j in range(2 * plant.integers[step.N_HISTORY]):
        m[step.HISTORY + j] = u0
    m[step.LAGGED] = held
    if plant.integers[step.STRUCTURE] != 0:
        _settle(plant, t0, dt, m, u0, y, 0, alike)
        if not math.isnan(place):
            m[step.OFFSET], m[step.SLIP] = place * plant.numbers[step.HALF_GAP], 0.0
    step.place(plant, t0, dt, y[0], m)
    m[step.REST] = rested
    m[step.MODE] = step.outputs(plant, t0, dt, m, u0)[2]
    if m[step.MODE] != 0.0:
        m[step.REST] = 0.0


@step.internal
def _stuck_motion(plant, x, alike):
    """Farthest that the encoder can move while friction holds what it acts on."""
    numbers = plant.numbers
    kind = plant.integers[step.STRUCTURE]
    level = step.base_level(plant, x, 1.0)
    alike += 2.0 * numbers[step.HALF_GAP]
    if kind & step.CONTACT:
        alike += level / numbers[step.CONTACT_STIFFNESS]
    if kind & step.SPRING and not kind & step.ON_LOAD:
        alike += level / numbers[step.STIFFNESS]
    return alike


@step.internal
def _correct_play(m, on_load, x, v, moved, turned):
    """Corrected motion across a play: a reading says nothing about the mass without the encoder."""
    if on_load:
        x = x - moved
        v = v - turned
        moved = -moved
        turned = -turned
    m[step.OFFSET] -= moved
    m[step.SLIP] -= turned
    return x, v


@step.internal
def _not_as_predicted(
    plant, m, cov, strain, t, dt, end, y, k, stood, alike, gives, fast, reading, spot, kept,
    strained, x, v, e, p, g, d,
):  # fmt: skip
    """State and covariance where several readings in a row contradict the prediction.

    `stood`: number of samples without motion.  Returns the variance of the reading, whether the
    axis is kept at rest, whether a contact sticks, the state, the innovation, and the covariance;
    that of two masses, `cov`, is set.
    """
    if plant.integers[step.STRUCTURE] != 0:
        # The inner states were wrong: set them from the readings.
        off = _settle(plant, t + dt, dt, m, end, y, k, alike)
        x = m[step.X] + y[k] - step.encoder_reading(plant, t + dt, m)
        v = m[step.V]
        m[step.MODE] = 0.0
        if v == 0.0:
            m[step.REST] = _rest_count(y, k, gives) * dt
        two_masses.rigid_covariance(cov, spot, off * off, strain, 1.0)
        if fast:
            return reading, kept, False, x, v, 0.0, off * off, 0.0, spot
        return 0.0, kept, False, x, v, 0.0, spot, 0.0, off * off
    if stood > 2 * _IN_A_ROW:
        # The axis has not moved although the drive should have moved it.  This is a single piece
        # of evidence: keep it at rest, and do not count it again with every reading until it moves.
        m[step.MODE], m[step.REST] = 0.0, stood * dt
        if fast:
            return 0.0, True, strained, x, 0.0, 0.0, reading, 0.0, d
        return 0.0, True, strained, x, 0.0, e, reading, 0.0, reading / (stood * dt) ** 2
    # The axis has moved differently: follow the readings.
    p = e * e
    if fast:
        return reading, kept, strained, x, v, e, p, 0.0, d
    g = 1.0 / (_IN_A_ROW * dt)
    return reading, kept, strained, x, v, e, p, g, p * g * g


@step.internal
def _largest_increment(y, least):
    """Largest step from one reading to the next, at least `least`."""
    for k in range(1, y.shape[0]):
        least = max(least, abs(y[k] - y[k - 1]))
    return least


@step.internal(forceinline=True)
def _clip_deflection(plant, x, z):
    """Deflection of bristles up to what they hold: they would let go of it only along a way."""
    s = math.copysign(1.0, z)
    return s * min(s * z, _deflection_limit(plant, x, s))


@step.internal
def _may_break_away(cov, variance, dt, inverse):
    """Add to the covariance of two masses what a random force does that moves the first one."""
    by_x = 0.5 * dt * dt * inverse
    by_v = dt * inverse
    cov[0, 0] += variance * by_x * by_x
    cov[0, 1] += variance * by_x * by_v
    cov[1, 0] = cov[0, 1]
    cov[1, 1] += variance * by_v * by_v


@step.internal(forceinline=True)
def _tells_of_load(m, cov, at, rubs, strained, part):
    """Correct the load of a spring by a reading of its motor."""
    m[step.OFFSET] += (cov[2, at] - cov[0, at]) * part
    m[step.SLIP] += (cov[3, at] - cov[1, at]) * part
    if strained and m[step.MODE] == 0.0:
        m[step.DEFLECTION] += (cov[rubs, at] - cov[4, at]) * part


@njit(cache=True, error_model="numpy", nogil=True)
def innovations(
    numbers, integers, size, u, known, y, w, good, t0, rested, dt, first, force, reading, cell,
    span, state, out,
):  # fmt: skip
    """Innovations and their variances over a whole record.

    A record that begins at rest does not show where in its play a mass rests: of several
    places, the one that makes the readings likeliest until the play is crossed is taken.

    Parameters
    ----------
    numbers, integers, size : arrays and length of memory of the axis
    u, y : ndarray, shape (n,)
        Input and positions.
    known : ndarray, shape (n,) or (0,)
        Known force on the mass.
    w : ndarray, shape (n,) or (0,)
        The readings if they are velocities, of which the positions are the integral.
    good : ndarray of bool, shape (n,)
        Readings that may be used.
    t0, rested, dt : float
        Time of the first sample, time at rest before it, and sampling time [s].
    first : bool
        Whether the input is interpolated linearly between samples.
    force : float
        Variance of the random force, held over a sample [N^2].
    reading : float
        Variance of a reading [m^2, or m^2/s^2].
    cell : float
        Increment of the readings [m, or m/s], 0 for none.
    span : float
        Travel of the record [m], the scale of difference steps in position.
    state : ndarray, shape (6, n)
        Receives position and velocity after each reading, the mode, the correction of the
        velocity by the reading, and the corrections of position and velocity over the
        innovation.
    out : ndarray, shape (2, n)
        Receives innovations and their variances; variance 0 where there is none.
    """
    n = y.shape[0]
    place = np.nan
    scale = FIRST * dt if w.shape[0] > 0 else 1.0
    alike = scale * max(cell, 3.0 * math.sqrt(reading)) * (1.0 + 1e-9)
    if numbers[step.HALF_GAP] > 0.0 and abs(y[min(FIRST, n - 1)] - y[0]) <= alike:
        across = 2.0 * numbers[step.HALF_GAP] + alike
        stop = 0
        while stop < n and abs(y[stop] - y[0]) <= across:
            stop += 1
        stop = min(stop + FIRST, n)
        least = np.inf
        for one in _PLACES:
            _innovations(
                numbers, integers, size, u, known, y, w, good, t0, rested, dt, first, force,
                reading, cell, span, state, out, stop, one,
            )  # fmt: skip
            here = cost_of(out, good, FIRST + 1, stop)
            if here < least:
                least = here
                place = one
    _innovations(
        numbers, integers, size, u, known, y, w, good, t0, rested, dt, first, force, reading, cell,
        span, state, out, n, place,
    )  # fmt: skip


@njit(cache=True, error_model="numpy", nogil=True)
def _innovations(
    given, integers, size, u, known, y, w, good, t0, rested, dt, first, force, reading, cell, span,
    state, out, n, place,
):  # fmt: skip
    """`innovations` of the first n samples from a place in the play, -1 to 1; nan: unknown."""
    numbers = given.copy()
    plant = step.point(numbers, integers)
    if known.shape[0] > 0:
        step.set_known_force(plant, t0, dt, known, 0, first)
    # One array, which the loop keeps alive: an array handed on would be counted at each call.
    memory = np.zeros(size + step.ROOM + 10)
    m = step.pointer(memory)
    events = step.offset_address(m, size)
    points = step.offset_address(m, size + step.ROOM)
    count = step.empty_tally(memory[size : size + step.ROOM], step.FEW_SWITCHES)
    counted = step.pointer(count)
    structure = integers[step.STRUCTURE]
    remembers = structure & step.REMEMBERS != 0
    contact = structure & step.CONTACT != 0
    bristles = contact and numbers[step.BRISTLES] != 0.0
    on_load = structure & step.ON_LOAD != 0
    play = structure & step.PLAY != 0
    spring = structure & step.SPRING != 0 and not on_load
    at_once = numbers[step.DELAY] <= 0.0 and numbers[step.LAG] <= 0.0
    plain = structure == 0 and at_once
    at_once = at_once and structure & ~step.CONTACT == 0
    deviation = math.sqrt(force)
    dx = 1e-6 * span
    fall = -math.expm1(-numbers[step.STICK_RATE] * dt)
    # Of velocities, positions that are the same: what errors of the first would make them.
    fast = w.shape[0] > 0
    at, scale = (1, FIRST * dt) if fast else (0, 1.0)
    spot = scale * scale * reading
    farthest = _FASTER * _largest_increment(y, _FASTER * scale * cell)
    begin = min(FIRST, n - 1)
    v0 = (y[begin] - y[0]) / (begin * dt)
    still = 0
    alike = scale * max(cell, 3.0 * math.sqrt(reading)) * (1.0 + 1e-9)
    _begin(plant, m, t0, dt, rested, u[0], y, v0, place, alike)
    rubs = two_masses.friction_state(structure)
    on_motor = structure & step.MOTOR_RUBS != 0
    two = spring or (play and not on_load)
    inverse = numbers[step.INVERSE_MOTOR if two else step.INVERSE_MASS]
    p = spot
    g = 0.0
    d = 0.1 * v0 * v0 + 4.0 * spot / (begin * dt) ** 2 + force * (dt * inverse) ** 2
    level = step.base_level(plant, y[0], 1.0)
    gives = _stuck_motion(plant, y[0], alike)
    n_states = 5 if contact else 4
    cov = np.zeros((n_states, n_states))
    work = np.zeros((n_states, n_states))
    slides = cov
    rests = cov
    slides_apart = cov
    rests_apart = cov
    touches = True
    strain = 0.0
    if spring:
        slides = two_masses.transition(plant, dt, 1.0, True)
        rests = two_masses.transition(plant, dt, 0.0, True)
        if numbers[step.HALF_GAP] > 0.0:
            slides_apart = two_masses.transition(plant, dt, 1.0, False)
            rests_apart = two_masses.transition(plant, dt, 0.0, False)
        # A load at rest may pull at the spring with any force that friction holds.
        strain = (numbers[step.HALF_GAP] + level / numbers[step.STIFFNESS]) ** 2 / 3.0
        two_masses.rigid_covariance(
            cov, p, d, 0.0 if memory[step.MODE] != 0.0 else strain, memory[step.MODE]
        )
    row = 0
    side = 0.0
    kept = False
    over = 1
    pulled = 0.0
    pull = 0.0
    # The unstrained position of a sticking contact is as uncertain as the position was when it
    # stopped: its covariances with position and velocity, and its variance.
    strained = False
    c0 = 0.0
    c1 = 0.0
    anchor = 0.0
    # At the start of a record it may have any strain that friction holds: a uniform distribution.
    held = contact and memory[step.MODE] == 0.0
    unknown = (level / numbers[step.CONTACT_STIFFNESS]) ** 2 / 3.0 if held else 0.0
    state[0, 0], state[1, 0], state[2, 0], state[3, 0] = y[0], v0, memory[step.MODE], 0.0
    out[0, 0] = 0.0
    out[1, 0] = 0.0
    for k in range(1, n):
        t = t0 + (k - 1) * dt
        if known.shape[0] > 0:
            step.set_known_force(plant, t, dt, known, k - 1, first)
        end = u[k] if first else u[k - 1]
        if remembers:
            show_states(plant, m)
        x = memory[step.X]
        v = memory[step.V]
        mode = int(memory[step.MODE])
        before = v = v + memory[step.SLIP] if on_load else v
        # Motor and load that touch across a play are one mass.
        two = play and not on_load and not _is_in_contact(plant, m)
        loose = two and on_motor
        two = two and not on_motor
        inverse = numbers[step.INVERSE_MOTOR if two else step.INVERSE_MASS]
        if mode == 0 and not contact and abs(v) > numbers[step.STICK_SPEED]:
            mode = 1 if v > 0.0 else -1
        sliding = mode != 0
        total = d + g * g * p
        width = math.sqrt(total)
        near = structure == 0 and width > numbers[step.STICK_SPEED] and abs(v) < _NEAR * width
        variance = force
        if not sliding and not near and not contact and not kept:
            variance = _random_force(plant, t, dt, m, u[k - 1], deviation)
            variance += _pulled_off(plant, t, dt, m, u[k - 1], deviation)
            near = structure == 0 and variance > 0.0
        if not near:
            pulled = 0.0
        if kept:
            # Advance the drive; the axis stays at rest.
            rest = memory[step.REST] + dt
            count[0] = 0
            keep_states(plant, m)
            step.sample(plant, t, dt, u[k - 1], end, m, events, counted)
            return_states(plant, m)
            memory[step.X], memory[step.V] = x, 0.0
            memory[step.MODE], memory[step.REST] = 0.0, rest
            p += _CREEP * spot
        elif near:
            p, g, d, over, pulled, pull = _predict_near(
                plant, m, events, counted, points, t, dt, u[k - 1], end, x, v, mode, p, g, d,
                deviation, fall, spot, plain, over, pulled, pull,
            )  # fmt: skip
        elif spring:
            stops = contact and not sliding and not strained
            unknown = (
                two_masses.stick_contact(cov, rubs, unknown) if stops else unknown * (not sliding)
            )
            strained = contact and not sliding
            count[0] = 0
            touches = elastic.spring_touches(plant, m)
            step.sample(plant, t, dt, u[k - 1], end, m, events, counted)
            touches = touches or elastic.spring_touches(plant, m)
            moves = sliding or memory[step.MODE] != 0.0
            # A load at rest stays where it is, whatever the readings of its motor.
            pinned = rubs if memory[step.MODE] == 0.0 and not contact else -1
            if touches:
                two_masses.predict(slides if moves else rests, cov, force, pinned, work)
            else:
                apart = slides_apart if moves else rests_apart
                two_masses.predict(apart, cov, force, pinned, work)
            if pinned == 0:
                _may_break_away(cov, variance, dt, _friction_inverse_mass(plant))
            p = cov[0, 0] = cov[0, 0] + (_CREEP if pinned == 0 else 1e-6) * spot
        else:
            by_x, by_v, gives_way = _predict(
                plant, m, events, counted, t, dt, u[k - 1], end, x, v, mode, two, at_once, first, dx
            )
            if not sliding and memory[step.MODE] != 0.0:
                variance = force
            if two:
                # Across the play nothing holds the motor.
                by_x = 0.0
                by_v = 0.0
                variance = force
            if loose:
                lighter = _friction_inverse_mass(plant) / inverse if sliding else 1.0
                by_x = lighter * by_x
                by_v = lighter * by_v
                inverse = _friction_inverse_mass(plant)
            sticking = contact and not sliding and not two
            unknown = 0.0 if sliding else unknown
            if sticking and not strained:
                c0 = p
                c1 = g * p
                anchor = p + unknown
                unknown = 0.0
            strained = sticking
            if sticking:
                keeps = 1.0
                if bristles:
                    way = numbers[step.CONTACT_STIFFNESS] * abs(memory[step.X] - x)
                    keeps = math.exp(-way / level)
                p, g, d, c0, c1, anchor = _elastic_covariance(
                    by_x, by_v, gives_way, keeps, dt, inverse, variance, p, g, d, c0, c1, anchor
                )
            else:
                creep = _CREEP * spot if not sliding and not contact else 0.0
                p, g, d = _spread(by_x, by_v, dt, inverse, variance, creep, p, g, d)
            if not sliding and abs(g) < _NOTHING and d < _NOTHING:
                g = 0.0
                d = 0.0
        # Reading.
        x = memory[step.X]
        v = memory[step.V]
        x_free = x
        v_free = v
        out[0, k] = 0.0
        out[1, k] = 0.0
        if good[k]:
            if (scale * abs(w[k]) if fast else abs(y[k] - y[still])) > alike:
                if kept:
                    # The axis has broken away, at an unknown velocity.
                    kept = False
                    g = 0.0
                    d = (alike / dt) ** 2
                still = k
            if fast:
                e = w[k] - _velocity(plant, t + dt, m, dx)
                by = w[k] - e - before
                p, g, d = (cov[1, 1], g, d) if spring else _swap_states(p, g, d)
                c0, c1 = c1, c0
            else:
                e = y[k] - step.encoder_reading(plant, t + dt, m)
                by = v * dt
            s = p + reading
            e, outside, counts = _in_cell(e, by, cell, reading)
            out[0, k], out[1, k] = outside, reading + counts * p
            ratio = e * e / s
            noise = reading
            if ratio > _STRANGE:
                row = row + 1 if side * e > 0.0 else 1
                side = 1.0 if e > 0.0 else -1.0
            else:
                row = 0
            if row == _IN_A_ROW:
                row = 0
                noise, kept, strained, x, v, e, p, g, d = _not_as_predicted(
                    plant, m, cov, strain, t, dt, end, y, k, k - still, alike, gives, fast,
                    reading, spot, kept, strained, x, v, e, p, g, d,
                )  # fmt: skip
            elif ratio > DOUBTED:
                noise = reading * ratio / DOUBTED
            if spring:
                # A reading of the motor tells of the load, too.
                _tells_of_load(m, cov, at, rubs, strained, e / (p + noise))
                g = cov[1, 0] / p
                two_masses.correct(cov, at, p + noise, work)
            gain = p / (p + noise)
            to_anchor = 0.0
            if strained and not spring:
                to_anchor = counts * c0 / (p + noise)
                anchor = max(anchor - to_anchor * c0, 0.0)
                c0, c1 = c0 - gain * c0, c1 - gain * g * c0
            by_x, by_v = (gain * g, gain) if fast else (gain, gain * g)
            state[4, k], state[5, k] = by_x, by_v
            p = gain * noise
            if fast:
                p, g, d = _swap_states(p, g, d)
                c0, c1 = c1, c0
            x += by_x * e
            v += by_v * e
            if play and not _is_in_contact(plant, m):
                x, v = _correct_play(m, on_load, x, v, by_x * e, by_v * e)
            memory[step.X], memory[step.V] = x, v
            if contact and not spring and memory[step.MODE] == 0.0:
                z = memory[step.DEFLECTION] + by_x * e - to_anchor * outside
                memory[step.DEFLECTION] = _clip_deflection(plant, x, z) if bristles else z
            if remembers:
                drive = step.drive_now(plant, t + dt, dt, m, end)
                shift_states(plant, t + dt, m, drive, x - x_free)
        if not (abs(x - y[0]) < _LOST * span and abs(v) * dt < farthest):
            out[0, k:n], out[1, k:n] = np.inf, 1.0
            return
        state[0, k], state[1, k], state[2, k], state[3, k] = x, v, memory[step.MODE], v - v_free
