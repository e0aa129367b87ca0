"""Compiled one-sample step of the hybrid cell filter.

Three modes (stuck, sliding +, sliding -), each with a probability and a
Gaussian of six states.  A sample predicts each mode, moves the part of its
density that crosses zero velocity, or breaks away, to another mode, merges
the parts that arrive in a mode, and corrects them by the reading, which is a cell
of one increment rather than a point.

Internally, position is in increments, velocity in increments per sample, and
force in mean Coulomb levels.  The filter's state follows the delay line in the
memory of an observer (`observer.kernel`); its last entries are scratch, so that
a sample allocates no memory.
"""

from __future__ import annotations

import math

from dryfric_control.compiled import axis_step
from dryfric_control.compiled.cached import njit
from dryfric_control.compiled.observer import (
    LINE,
    MODE,
    NODE,
    REST,
    VHAT,
    WHAT,
    XHAT,
    mean_drive,
    shift_drive,
)

#: Indices of the filter's numbers.
(
    DT,
    QUANTUM,
    FORCE,  # unit of force: mean Coulomb level
    A12,  # sliding mode in the filter's units: x+ = x + A12 v + B1 f, v+ = A22 v + B2 f
    A22,
    B1,
    B2,
    FORCE_NOISE,  # white force, standard deviation
    ACCELERATION_NOISE,  # the same as a fraction of the net force
    LEVEL_WALK,  # random-walk step of the level error per sample
    EXCESS,  # spread of the excess at low velocity
    EXCESS_FAST,  # and at any velocity
    EXCESS_SPEED,  # velocity over which the excess changes, increments per sample
    FADE,  # fraction of the excess that remains after a sample at constant velocity
    CELL_NOISE,  # reading noise in addition to the cell
    HAZARD,  # probability per sample to break away above the usual level
    MASS,  # initial variance of the relative mass error
    DECAY_RATE_ERROR,  # uncertainty of the decay rate of the excess, as a fraction of the excess
    START,  # variance of the velocity at which a motion starts
    FIRST_RELEASE,  # breakaway force over the level, until one has been observed
    REPEATED_SHARE,  # part of a tail that has been removed before, and is removed again in a sample
    NUMBERS,
) = range(22)

#: States of a mode: position, velocity, relative error of the level in either
#: direction, excess over the level, relative error of 1 / mass.
X, V, PLUS, MINUS, EXCESS_FORCE, INVERSE_MASS_ERROR, STATES = range(7)
#: A Gaussian: its states, then the lower triangle of its covariance.
COVARIANCE, GAUSSIAN = STATES, STATES + STATES * (STATES + 1) // 2

#: Indices of the filter's state: three probabilities (0, +1, -1), then
(
    RELEASE,  # breakaway force over the level, as last observed
    DRIVE,  # mean drive over the past sample
    READING,  # previous reading
    NOISE,  # reading noise in addition to the cell, estimated variance
    INNOVATION,  # innovation of the likeliest mode
    MODE_STATES,  # one Gaussian per mode
) = range(3, 9)
PREDICTED = MODE_STATES + 3 * GAUSSIAN  # a probability and a Gaussian per mode
TRANSFERRED = PREDICTED + 3 * (GAUSSIAN + 1)  # one Gaussian
SLIDING_PREDICTION = TRANSFERRED + GAUSSIAN  # another, the prediction of a sliding mode
SCRATCH = SLIDING_PREDICTION + GAUSSIAN  # two rows of its covariance
CELL_MASS = SCRATCH + 2 * STATES  # mass that was inside the cell before: of each mode, as arrived
SIZE = CELL_MASS + 6

#: Outputs of a sample: xhat, vhat, Fhat, what, mode, standard deviation of
#: vhat, log-likelihood of the reading.
OUTPUTS = 7

_LEAST_STOP_PROBABILITY = 1e-7  # lower bound of the probability to stop in one sample
_LEAST_PROBABILITY = 1e-30  # lower bound of the probability of a mode
_FIRST_PROBABILITIES = (0.98, 0.01, 0.01)  # of the modes 0, + and - at the first reading
_FIRST_VARIANCE = (0.25, 0.25, 0.04, 0.04, 0.02)  # of the states but the last, in their order
_CELL_VARIANCE = 1.0 / 12.0  # variance of a reading inside its cell
_TAIL_START = 5.0  # standard deviations beyond which the tail is not normal
_NOISE_ADAPTATION = 0.02  # adaptation rate of the reading noise, per sample
_REFUTING_PROBABILITY = 1e-5  # probability of a reading below which rest is refuted
_REFUTING_INNOVATION = 2.0  # and its distance from rest, in cells
_LEVEL_SHARPNESS = 5.0  # inverse relative uncertainty of the level that holds at a reversal
_LEAST_REVERSAL_PROBABILITY = 1e-6  # probability of a reversal below which there is none
_LEAST_PIVOT = 1e-12  # smallest pivot, as a fraction of the variance
_LEAST_VARIANCE = 1e-12  # lower bound of a variance
_LARGEST_VARIANCE = 1e20  # upper bound of a variance
_LARGEST_ERROR_VARIANCE = 0.25  # upper bound of the variance of a relative error


@njit(cache=True, error_model="numpy", forceinline=True)
def _normal_probability(x):
    """Standard normal distribution function."""
    return 0.5 * math.erfc(-x * 0.7071067811865476)


@njit(cache=True, error_model="numpy", forceinline=True)
def _density(x):
    return 0.3989422804014327 * math.exp(-0.5 * x * x)


@njit(cache=True, error_model="numpy", forceinline=True)
def _positive_part(mean, sd):
    """Mass, mean and variance of a normal density above zero."""
    a = mean / sd
    if a < -6.0:
        return 0.0, 0.05 * sd, (0.05 * sd) ** 2
    mass = _normal_probability(a)
    r = _density(a) / mass
    return mass, mean + sd * r, sd * sd * max(1.0 - a * r - r * r, 1e-4)


@njit(cache=True, error_model="numpy", forceinline=True)
def _cell(e, sd):
    """Likelihood, mean and variance of a normal N(0, sd^2) within the cell e -+ 1/2."""
    a = (e - 0.5) / sd
    b = (e + 0.5) / sd
    near = min(abs(a), abs(b))
    if near > _TAIL_START and a * b > 0.0:
        # The tails cancel numerically: use a normal reading of the same variance with a
        # power-law tail, so that of modes that are all wrong the nearest wins.
        S = sd * sd
        total = S + _CELL_VARIANCE
        likelihood = _density(_TAIL_START) / math.sqrt(total) * (_TAIL_START / near) ** 4
        return likelihood, S / total * e, S * _CELL_VARIANCE / total
    mass = max(_normal_probability(b) - _normal_probability(a), 1e-12)
    pa = _density(a)
    pb = _density(b)
    g = (pa - pb) / mass
    return mass, sd * g, sd * sd * max(1.0 + (a * pa - b * pb) / mass - g * g, 1e-6)


@njit(cache=True, error_model="numpy", forceinline=True)
def _tail_share(before, inside, again):
    """Part of a tail to remove, given the masses inside its bound before and after a step.

    A Gaussian in place of a density that has been cut has tails again, although what they
    hold has been removed: to remove it again in every sample would count one observation
    many times, the more often the faster the sampling.  Therefore all that is new is
    removed, and of the rest a part that does not depend on the sampling, `again`.
    """
    if inside >= 1.0 or before <= 0.0:
        return 1.0
    new = min(max((before - inside) / (before * (1.0 - inside)), 0.0), 1.0)
    return new + (1.0 - new) * again


@njit(cache=True, error_model="numpy", forceinline=True)
def _truncated_moments(share, mean, variance, mass, middle, within):
    """Mass, mean and variance of a normal density without a share of its tail.

    `mass`, `middle`, `within`: those of the part that is no tail.
    """
    # Of a density that is all tail nothing is left, and no mean is asked for.
    total = max(1.0 - share + share * mass, 1e-30)
    part = share * mass / total
    rest = (1.0 - share) / total
    return (
        total,
        part * middle + rest * mean,
        part * within + rest * variance + part * rest * (middle - mean) ** 2,
    )


@axis_step.internal(forceinline=True)
def _reset_state(s, at, k, mean, variance):
    """Reset state k of a Gaussian to `mean`, `variance`, independent of the others."""
    P = at + COVARIANCE
    for j in range(k):
        s[P + k * (k + 1) // 2 + j] = 0.0
    for i in range(k + 1, STATES):
        s[P + i * (i + 1) // 2 + k] = 0.0
    s[at + k], s[P + k * (k + 3) // 2] = mean, variance


@axis_step.internal
def _scale_state(s, P, k, factor):
    """Scale the standard deviation of state k, keeping its correlations."""
    for j in range(k):
        s[P + k * (k + 1) // 2 + j] *= factor
    s[P + k * (k + 3) // 2] *= factor * factor
    for i in range(k + 1, STATES):
        s[P + i * (i + 1) // 2 + k] *= factor


@axis_step.internal
def _add_state(s, P, i, k, factor):
    """Add `factor` times state k to state i: the covariance of the sum."""
    both = P + max(i, k) * (max(i, k) + 1) // 2 + min(i, k)
    own = P + i * (i + 3) // 2
    s[own] += factor * (2.0 * s[both] + factor * s[P + k * (k + 3) // 2])
    for j in range(STATES):
        if j != i:
            low = min(j, k)
            high = max(j, k)
            shared = s[P + high * (high + 1) // 2 + low]
            low = min(i, j)
            high = max(i, j)
            s[P + high * (high + 1) // 2 + low] += factor * shared


@axis_step.internal
def _merge(s, source, mode, probability, new):
    """Merge the Gaussian at `new`, of the mode `source`, into the one arrived in a mode."""
    at = PREDICTED + mode * (GAUSSIAN + 1)
    into = at + 1
    s[CELL_MASS + 3 + mode] += probability * s[CELL_MASS + source]
    if s[at] == 0.0:
        s[at] = probability
        for k in range(GAUSSIAN):
            s[into + k] = s[new + k]
        return
    s[at] += probability
    share = probability / s[at]
    keep = 1.0 - share
    P = into + COVARIANCE
    N = new + COVARIANCE
    for i in range(STATES):
        row = i * (i + 1) // 2
        away = keep * share * (s[new + i] - s[into + i])
        for j in range(i + 1):
            k = row + j
            s[P + k] = keep * s[P + k] + share * s[N + k] + away * (s[new + j] - s[into + j])
    for i in range(STATES):
        s[into + i] += share * (s[new + i] - s[into + i])


@axis_step.internal
def _condition(s, at, column, change, removed, variance):
    """Correct a Gaussian by an observation of its position or velocity.

    The mean of that state changes by `change`; `variance`, its own plus that of the
    measurement noise, is reduced by the fraction `removed`.
    """
    P = at + COVARIANCE
    c = SCRATCH
    for i in range(STATES):
        low = min(i, column)
        high = max(i, column)
        s[c + i] = s[P + high * (high + 1) // 2 + low] / variance
    for i in range(STATES):
        row = P + i * (i + 1) // 2
        scaled = removed * s[c + i]
        for j in range(i + 1):
            s[row + j] -= scaled * s[c + j]
        s[at + i] += s[c + i] * change


@axis_step.internal
def _make_positive(s, at):
    """Factor a covariance, L D L', and rebuild it if round-off has made it indefinite.

    A pivot at the level of round-off is set to zero with the column below it, as in
    a semidefinite matrix; a row that explains more than its variance is scaled down
    to it.  Therefore no variance grows.
    """
    P = at + COVARIANCE
    L = TRANSFERRED
    rebuild = False
    for i in range(STATES):
        row = i * (i + 1) // 2
        s[P + row + i] = min(max(s[P + row + i], _LEAST_VARIANCE), _LARGEST_VARIANCE)
        pivot = s[P + row + i]
        for j in range(i):
            other = j * (j + 1) // 2
            value = s[P + row + j]
            for k in range(j):
                value -= s[L + row + k] * s[L + other + k] * s[L + k * (k + 3) // 2]
            below = s[L + other + j]
            value = value / below if below > 0.0 else 0.0
            s[L + row + j] = value
            pivot -= value * value * below
        if pivot < _LEAST_PIVOT * s[P + row + i]:
            fit = math.sqrt(s[P + row + i] / (s[P + row + i] - min(pivot, 0.0)))
            for j in range(i):
                s[L + row + j] *= fit
            pivot = 0.0
            rebuild = True
        s[L + row + i] = pivot
    if not rebuild:
        return
    for i in range(STATES):
        row = i * (i + 1) // 2
        for j in range(i):
            other = j * (j + 1) // 2
            value = s[L + row + j] * s[L + other + j]
            for k in range(j):
                value += s[L + row + k] * s[L + other + k] * s[L + k * (k + 3) // 2]
            s[P + row + j] = value
        value = s[L + row + i]
        for k in range(i):
            value += s[L + row + k] * s[L + row + k] * s[L + k * (k + 3) // 2]
        s[P + row + i] = value + _LEAST_PIVOT * s[P + row + i]


@axis_step.internal
def _initial_state(numbers, s, y):
    """Filter at rest at the first reading."""
    s[0], s[1], s[2] = _FIRST_PROBABILITIES
    s[RELEASE] = numbers[FIRST_RELEASE]
    for mode in range(3):
        at = PREDICTED + mode * (GAUSSIAN + 1)
        s[at] = s[mode]
        at += 1
        s[at + X] = y
        for k in range(STATES):
            s[at + COVARIANCE + k * (k + 3) // 2] = (*_FIRST_VARIANCE, numbers[MASS])[k]


@axis_step.internal
def _predict_stuck(numbers, s, push, hold, level):
    """Advance the stuck mode by one sample: stay, or break away in either direction.

    `push` is the net force without friction; `hold` the breakaway levels and
    `level` the sliding levels at zero velocity, in the order +, -.
    """
    stay = 1.0
    for mode in (1, 2):
        side = 1.0 if mode == 1 else -1.0
        error = s[MODE_STATES + PLUS - 1 + mode]
        ratio = side * push / max(hold[mode - 1] * (1.0 + error), 0.05)
        if ratio < 0.85:
            chance = 1e-6
        elif ratio > 1.7:
            chance = 0.5
        else:
            usual = _normal_probability(25.0 * (ratio - s[RELEASE]))
            chance = min(1e-5 + numbers[HAZARD] * (usual + 0.02), 0.5)
        stay -= chance
        for k in range(GAUSSIAN):
            s[TRANSFERRED + k] = s[MODE_STATES + k]
        # At breakaway friction equals the drive, so the motion starts slowly.
        over = side * push / max(level[mode - 1], 0.05) - 1.0 - error
        _reset_state(s, TRANSFERRED, EXCESS_FORCE, max(over, 0.0), 0.05**2)
        pace = numbers[B2]
        _reset_state(s, TRANSFERRED, V, 0.015 * side * pace, (0.05 * pace) ** 2 + numbers[START])
        _merge(s, 0, mode, max(s[0] * chance, _LEAST_PROBABILITY), TRANSFERRED)
    for k in range(GAUSSIAN):
        s[TRANSFERRED + k] = s[MODE_STATES + k]
    _reset_state(s, TRANSFERRED, V, 0.0, 0.01 * numbers[START])
    s[TRANSFERRED + COVARIANCE] += 1e-5
    _merge(s, 0, 0, max(s[0] * stay, _LEAST_PROBABILITY), TRANSFERRED)


@axis_step.internal
def _predict_sliding(numbers, s, mode, load, level, slope, turns, back):
    """Advance a sliding mode by one sample: continue, stop, or reverse.

    `load` is the net force without friction, `level` the friction level and
    `slope` its derivative with velocity; `turns`: the probability that the load starts
    motion in the other direction, against the level `back`.
    """
    side = 1.0 if mode == 1 else -1.0
    own = PLUS - 1 + mode
    source = MODE_STATES + mode * GAUSSIAN
    v = s[source + V]
    net = load - side * level * (1.0 + s[source + own] + s[source + EXCESS_FORCE])
    ratio = 1.0 + s[source + INVERSE_MASS_ERROR]
    a12 = numbers[A12]
    a22 = numbers[A22]
    b1 = numbers[B1]
    b2 = numbers[B2]
    gain = b2 * ratio
    change = gain * net
    ahead = a22 * v + change
    moved = a12 * v + b1 * ratio * net
    # Covariance A P A' of the first two rows; the others do not change.
    a12 -= b1 * ratio * slope
    a22 -= gain * slope
    f1 = -side * level * b1 * ratio
    f2 = -side * level * gain
    m1 = b1 * net
    m2 = b2 * net
    P = source + COVARIANCE
    N = SLIDING_PREDICTION + COVARIANCE
    w = SCRATCH
    for k in range(STATES):
        pv = s[P + (1 if k == 0 else k * (k + 1) // 2 + 1)]
        px = s[P + k * (k + 1) // 2]
        low = min(k, own)
        high = max(k, own)
        po = s[P + high * (high + 1) // 2 + low]
        low = min(k, EXCESS_FORCE)
        high = max(k, EXCESS_FORCE)
        pe = s[P + high * (high + 1) // 2 + low]
        pr = s[P + 15 + k]
        s[w + k] = px + a12 * pv + f1 * (po + pe) + m1 * pr
        s[w + STATES + k] = a22 * pv + f2 * (po + pe) + m2 * pr
    for k in range(GAUSSIAN):
        s[SLIDING_PREDICTION + k] = s[source + k]
    s[SLIDING_PREDICTION + X] += moved
    s[SLIDING_PREDICTION + V] = ahead
    for k in range(PLUS, STATES):
        s[N + k * (k + 1) // 2] = s[w + k]
        s[N + k * (k + 1) // 2 + 1] = s[w + STATES + k]
    z = w + STATES
    s[N] = (
        s[w]
        + a12 * s[w + V]
        + f1 * (s[w + own] + s[w + EXCESS_FORCE])
        + m1 * s[w + INVERSE_MASS_ERROR]
    )
    s[N + 1] = (
        s[z]
        + a12 * s[z + V]
        + f1 * (s[z + own] + s[z + EXCESS_FORCE])
        + m1 * s[z + INVERSE_MASS_ERROR]
    )
    s[N + 2] = (
        a22 * s[z + V] + f2 * (s[z + own] + s[z + EXCESS_FORCE]) + m2 * s[z + INVERSE_MASS_ERROR]
    )
    # The excess decays with the change of velocity.
    keep = numbers[FADE] * math.exp(-abs(ahead - v) / numbers[EXCESS_SPEED])
    s[SLIDING_PREDICTION + EXCESS_FORCE] *= keep
    _scale_state(s, N, EXCESS_FORCE, keep)
    slow = v / numbers[EXCESS_SPEED]
    spread = numbers[EXCESS] * math.exp(-min(slow * slow, 50.0)) + numbers[EXCESS_FAST]
    over = numbers[DECAY_RATE_ERROR] * s[SLIDING_PREDICTION + EXCESS_FORCE]
    s[N + 14] += (spread * spread + over * over) * (1.0 - keep * keep) + 1e-9
    s[N + own * (own + 3) // 2] += numbers[LEVEL_WALK] ** 2
    noise = numbers[FORCE_NOISE] * b2 + numbers[ACCELERATION_NOISE] * abs(change)
    noise *= noise
    s[N] += 0.25 * noise + 1e-6
    s[N + 1] += 0.5 * noise
    s[N + 2] += noise
    variance = max(s[N + 2], 1e-12)
    part, mean, kept = _positive_part(side * ahead, math.sqrt(variance))
    before = _normal_probability(side * v / math.sqrt(max(s[P + 2], 1e-12)))
    part, mean, kept = _truncated_moments(
        _tail_share(before, part, numbers[REPEATED_SHARE]), side * ahead, variance, part, mean, kept
    )
    # The part that crosses zero velocity stops there, or reverses: another force acts from then on.
    left = max(s[mode] * max(1.0 - part, _LEAST_STOP_PROBABILITY), _LEAST_PROBABILITY)
    past = 0.0
    if side * ahead < 0.0:
        past = min(ahead / (ahead - v), 1.0) if side * v > 0.0 else 1.0
    _transfer(numbers, s, mode, 0, left * (1.0 - turns), ahead, past, 0.0, 0.0)
    if turns > _LEAST_REVERSAL_PROBABILITY:
        after = load + side * back * (1.0 + s[source + MINUS + 1 - mode])
        bend = min(max(after / net, 0.0), 1.0) if net != 0.0 else 0.0
        grip = past * gain * side * back
        _transfer(numbers, s, mode, 3 - mode, left * turns, ahead, past, bend, grip)
    # The part of the density on its side of zero velocity continues.
    if s[mode] * part > _LEAST_PROBABILITY:
        _condition(s, SLIDING_PREDICTION, V, side * mean - ahead, variance - kept, variance)
        _merge(s, mode, mode, s[mode] * part, SLIDING_PREDICTION)


@axis_step.internal
def _transfer(numbers, s, mode, into, probability, ahead, past, bend, grip):
    """Move the part of a sliding mode that has crossed zero velocity to another mode.

    `ahead` is the velocity without the switch, `past` the part of the sample behind it,
    `bend` the net force there over the one before, and `grip` the derivative of the velocity
    with the relative level.
    """
    P = TRANSFERRED + COVARIANCE
    for k in range(GAUSSIAN):
        s[TRANSFERRED + k] = s[SLIDING_PREDICTION + k]
    s[TRANSFERRED + X] += 0.5 * past * (bend - 1.0) * ahead
    _add_state(s, P, X, V, past * (bend - 1.0))
    s[P] += 0.01
    if into != 0:
        _reset_state(s, TRANSFERRED, EXCESS_FORCE, 0.0, numbers[EXCESS] ** 2)
    if into != 0 and past > 0.0:
        s[TRANSFERRED + V] *= bend
        _scale_state(s, P, V, bend)
        _add_state(s, P, V, MINUS + 1 - mode, grip)
        _add_state(s, P, V, EXCESS_FORCE, grip)
        s[P + 2] += numbers[START]
    else:
        _reset_state(s, TRANSFERRED, V, 0.0, numbers[START] * (0.01 if into == 0 else 1.0))
    _merge(s, mode, into, probability, TRANSFERRED)


@axis_step.internal
def _correct(numbers, s, mode, y, repeated):
    """Correct what has arrived in a mode by the reading; the innovation and excess.

    The excess is the squared innovation minus its expected value and minus its
    correlation with the previous one: noise is white, a model error is not.
    """
    at = PREDICTED + mode * (GAUSSIAN + 1)
    weight = s[at]
    at += 1
    P = at + COVARIANCE
    noise = numbers[CELL_NOISE] ** 2 + max(s[NOISE], 0.0)
    e = min(max(y - s[at + X], -1e8), 1e8)
    S = s[P] + noise
    excess = e * (e - s[INNOVATION]) - s[P] - _CELL_VARIANCE - numbers[CELL_NOISE] ** 2
    likelihood, moved, kept = _cell(e, math.sqrt(S))
    if repeated:
        share = _tail_share(s[CELL_MASS + 3 + mode] / weight, likelihood, numbers[REPEATED_SHARE])
        likelihood, moved, kept = _truncated_moments(share, 0.0, S, likelihood, moved, kept)
    if weight > 0.5 and e * e > 12.0 * (S + _CELL_VARIANCE):
        # Far outside the cell the predicted variance was too small: enlarge it.
        grow = min(e * e / (4.0 * (S + _CELL_VARIANCE)), 30.0)
        for k in range(COVARIANCE, GAUSSIAN):
            s[at + k] *= grow
        S = s[P] + noise
        moved = S / (S + _CELL_VARIANCE) * e
        kept = S * _CELL_VARIANCE / (S + _CELL_VARIANCE)
    _condition(s, at, X, moved, S - kept, S)
    for k in range(PLUS, STATES):
        if s[P + k * (k + 3) // 2] > _LARGEST_ERROR_VARIANCE:
            _scale_state(s, P, k, math.sqrt(_LARGEST_ERROR_VARIANCE / s[P + k * (k + 3) // 2]))
    _make_positive(s, at)
    for k in range(PLUS, STATES):
        s[at + k] = min(max(s[at + k], -0.9), 4.0)
    for k in range(GAUSSIAN):
        s[MODE_STATES + mode * GAUSSIAN + k] = s[at + k]
    s[mode] = weight * likelihood
    return e, excess


@axis_step.internal(forceinline=True)
def _load(plant, t, drive, place, v, direction, rest):
    held = axis_step.Drive(drive, 0.0, 0.0, 0.0)
    return axis_step.load(plant, held, t, 0.0, place, v, direction, rest)


@axis_step.internal
def _predict_modes(numbers, plant, memory, s, t, y):
    """Predict every mode to the sample at t; the breakaway ratios +, -."""
    for mode in range(3):
        s[PREDICTED + mode * (GAUSSIAN + 1)] = 0.0
        at = MODE_STATES + mode * GAUSSIAN
        here = y / numbers[QUANTUM] - s[at + X]
        s[CELL_MASS + mode], _, _ = _cell(here, math.sqrt(s[at + COVARIANCE]))
        s[CELL_MASS + 3 + mode] = 0.0
    unit = 1.0 / numbers[FORCE]
    pace = numbers[QUANTUM] / numbers[DT]
    drive = s[DRIVE]
    place = 0.5 * (s[READING] + y)
    rest = memory[REST]
    t -= 0.5 * numbers[DT]
    push = w = _load(plant, t, drive, place, 0.0, 0.0, rest)
    hold = (
        axis_step.breakaway_level(plant, t, place, w, 1.0, rest) * unit,
        axis_step.breakaway_level(plant, t, place, w, -1.0, rest) * unit,
    )
    level = (
        axis_step.sliding_level(plant, t, place, 0.0, w, 1.0) * unit,
        axis_step.sliding_level(plant, t, place, 0.0, w, -1.0) * unit,
    )
    _predict_stuck(numbers, s, w * unit, hold, level)
    for mode in (1, 2):
        side = 1.0 if mode == 1 else -1.0
        v = side * max(side * s[MODE_STATES + mode * GAUSSIAN + V], 0.0) * pace
        w = _load(plant, t, drive, place, v, side, 0.0)
        back = 2 - mode
        error = s[MODE_STATES + mode * GAUSSIAN + PLUS + back]
        ratio = -side * w * unit / max(hold[back] * (1.0 + error), 0.05)
        turns = _normal_probability(_LEVEL_SHARPNESS * (ratio - s[RELEASE]))
        friction = axis_step.sliding_level(plant, t, place, v, w, side)
        slope = 0.0
        if plant.numbers[axis_step.EXCESS] > 0.0:
            # Secant over the spread of the velocity, as the Stribeck peak may be narrower.
            near = 1e-3 / plant.numbers[axis_step.INVERSE_STRIBECK_SPEED]
            spread = math.sqrt(s[MODE_STATES + mode * GAUSSIAN + COVARIANCE + 2]) * pace
            near = max(near, spread)
            slope = axis_step.sliding_level(plant, t, place, v + side * near, w, side) - friction
            slope *= unit * pace / near
        _predict_sliding(numbers, s, mode, w * unit, friction * unit, slope, turns, level[back])
    plus = push * unit / max(hold[0] * (1.0 + s[MODE_STATES + PLUS]), 0.05)
    minus = -push * unit / max(hold[1] * (1.0 + s[MODE_STATES + MINUS]), 0.05)
    return plus, minus


@axis_step.internal
def _sample(numbers, plant, memory, t, u, y, out, row):
    s = axis_step.offset_address(memory, LINE + plant.integers[axis_step.N_HISTORY])
    dt = numbers[DT]
    cell = y / numbers[QUANTUM]
    drive = axis_step.input_map(plant, t, memory, u)
    ratio_plus = 0.0
    ratio_minus = 0.0
    repeated = memory[NODE] != 0.0 and s[READING] == y
    before = int(memory[MODE])
    if memory[NODE] == 0.0:
        memory[NODE] = 1.0
        _initial_state(numbers, s, cell)
    else:
        ratio_plus, ratio_minus = _predict_modes(numbers, plant, memory, s, t, y)
    total = 0.0
    best = 0
    surprise = 0.0
    unexpected = 0.0
    likely = -1.0
    for mode in range(3):
        e, excess = _correct(numbers, s, mode, cell, repeated)
        total += s[mode]
        if s[mode] > likely:
            best = mode
            likely = s[mode]
            surprise = e
            unexpected = excess
    if best == 0 and total < _REFUTING_PROBABILITY and abs(surprise) > _REFUTING_INNOVATION:
        # No mode explains the reading, and rest least: the axis has moved with a velocity of
        # the order of this innovation, at a friction that is not known.
        new = 1 if surprise > 0.0 else 2
        into = MODE_STATES + new * GAUSSIAN
        for k in range(GAUSSIAN):
            s[into + k] = s[MODE_STATES + k]
        _reset_state(s, into, V, surprise, surprise * surprise)
        _reset_state(s, into, EXCESS_FORCE, 0.0, numbers[EXCESS] ** 2)
        total += likely - s[new]
        s[new] = likely
    x = v = square = 0.0
    for mode in range(3):
        s[mode] /= total
        at = MODE_STATES + mode * GAUSSIAN
        x += s[mode] * s[at + X]
        v += s[mode] * s[at + V]
        square += s[mode] * (s[at + V] ** 2 + s[at + COVARIANCE + 2])
    s[NOISE] += _NOISE_ADAPTATION * (min(max(unexpected, -25.0), 25.0) - s[NOISE])
    s[INNOVATION] = surprise
    # The velocity at rest is within the stick velocity, and decays.
    still = plant.numbers[axis_step.STICK_SPEED] * dt / numbers[QUANTUM]
    still *= math.exp(-plant.numbers[axis_step.STICK_RATE] * memory[REST])
    square += s[0] * still * still / 3.0
    now = 0 if best == 0 else 3 - 2 * best
    if before == 0 and now != 0:
        ratio = ratio_plus if now > 0 else ratio_minus
        if 0.9 < ratio < 2.0:
            s[RELEASE] += 0.3 * (ratio - s[RELEASE])
    pace = numbers[QUANTUM] / dt
    memory[XHAT], memory[VHAT], memory[MODE] = x * numbers[QUANTUM], v * pace, now
    memory[REST] = memory[REST] + dt if now == 0 else 0.0
    s[DRIVE], s[READING] = mean_drive(plant, dt, memory, drive), y
    shift_drive(plant, dt, memory, drive)
    w = _load(plant, t, s[DRIVE], y, memory[VHAT], float(now), memory[REST])
    if now == 0:
        friction, memory[WHAT] = w, 0.0
    else:
        at = MODE_STATES + best * GAUSSIAN
        level = now * axis_step.sliding_level(plant, t, y, memory[VHAT], w, float(now))
        memory[WHAT] = -level * (s[at + PLUS - 1 + best] + s[at + EXCESS_FORCE])
        friction = level - memory[WHAT]
    out[row], out[row + 1], out[row + 2] = memory[XHAT], memory[VHAT], friction
    out[row + 3], out[row + 4] = memory[WHAT], memory[MODE]
    out[row + 5] = math.sqrt(max(square - v * v, 0.0)) * pace
    out[row + 6] = math.log(max(total, 1e-300))


@njit(cache=True, error_model="numpy")
def step(numbers, axis_numbers, axis_integers, memory, t, u, y, out):
    """One sample: outputs into `out`, `memory` advanced."""
    plant = axis_step.point(axis_numbers, axis_integers)
    pointers = axis_step.pointer(numbers), axis_step.pointer(memory), axis_step.pointer(out)
    _sample(pointers[0], plant, pointers[1], t, u, y, pointers[2], 0)


@njit(cache=True, error_model="numpy")
def run(numbers, axis_numbers, axis_integers, memory, u, y, known, out):
    """Run over a whole record, outputs into `out`, one row per sample.

    `known`: force on the mass that is known, shape (n,), or (0,) for none.
    """
    own = axis_numbers.copy()
    plant = axis_step.point(own, axis_integers)
    given = axis_step.pointer(numbers)
    state = axis_step.pointer(memory)
    rows = axis_step.pointer(out)
    for k in range(u.shape[0]):
        t = k * numbers[DT]
        if known.shape[0] > 0:
            # The sample before is predicted at its middle, the friction is that of now: a line
            # through both values.
            before = known[max(k - 1, 0)]
            own[axis_step.KNOWN_RATE] = 2.0 * (known[k] - before) / numbers[DT]
            own[axis_step.KNOWN_FORCE] = known[k] - own[axis_step.KNOWN_RATE] * t
        _sample(given, plant, state, t, u[k], y[k], rows, OUTPUTS * k)
