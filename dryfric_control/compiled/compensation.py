"""Compiled law of the compensated position loop: block, stepper and closed loop call `step`.

The reference leads the motion by `lead` samples.  The feedforward uses it at once: that compensates
the delay of the drive; the feedback compares the reading with the reference `lead` samples ago.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from dryfric_control.compiled import axis_step, observer
from dryfric_control.compiled.cached import njit
from dryfric_control.compiled.loop import advance_plant, encode

#: Source of the friction estimate.
NOTHING, LEARNED, DISTURBANCE, EXTENDED = range(4)

#: Indices of the law's numbers.
(
    DT,
    LEAD,  # lead of the reference [samples]
    KP,
    KI,
    KD,
    KEEP,  # coefficient of the velocity low-pass
    LIMIT,
    MASS,
    VISCOUS,
    COULOMB,  # share of the Coulomb level that is fed forward
    PEAK,  # share of the Stribeck peak that is fed forward
    REST_SHARE,  # share of the Coulomb level kept at rest
    REST_SPEED,  # speed below which the reference counts as resting
    STICK_SPEED,
    STRIBECK_SPEED,
    EXCESS,  # nominal Stribeck excess
    MOST_EXCESS,
    BAND,  # largest correction of nominal friction, as a fraction of the Coulomb level
    RATE,  # learning rate per sample
    LAG,  # first-order coefficient with which the observer's friction follows, per sample
    RESIDUAL,  # share of the friction residual that is fed back
    SPEED_SHARE,  # share of the estimated velocity of the error in the one fed back
    BUILD,  # distance over which friction builds up at a reversal, 0 for none
    SOURCE,
    HOLDS,  # whether the integral and the drive are held at rest
    TOLERANCE,  # position error at which the drive is held
    GROWTH,  # growth of the tolerance with every correction
    HOLD_SHARE,  # share of the Coulomb level that a held drive may use
    SETTLE,  # samples of rest before the drive is held
    SLOW,  # largest error that the integral takes at rest
    MEAN,  # weight of a new sample in the means at rest
    GAIN_X,  # gains of the extended state observer, or the corner frequency
    GAIN_V,
    GAIN_F,
    LATE,  # expected delay of the feedforward at the axis [samples]
    LENGTH,
) = range(36)

#: Indices of the law's memory; the line of past samples (reference, its velocity,
#: feedforward) follows the last, then the memory of the observer.
(
    SAMPLES,
    INTEGRAL,
    SPEED,  # filtered velocity of the error
    ERROR,  # last error
    AHEAD,  # last reference
    DIRECTION,
    CONTACT,  # friction built up, -1 to 1
    STILL,  # number of samples since the reference came to rest
    PLUS,  # learned corrections of the Coulomb levels
    MINUS,
    SHARE,  # learned Stribeck excess
    MODE,  # mode of the observer one sample before
    CORRECTIONS,  # number of corrections since the reference came to rest
    HELD,
    HELD_DRIVE,  # without the other forces, which go on where they change with time
    MEAN_DRIVE,
    MEAN_ERROR,
    FORCE,  # friction compensation of the last sample
    SLIDING,  # mean of the integral while the reference moves
    EXPECTED,  # friction beyond the map that the observer should have reached by now
    LEVEL_SEEN,  # its response so far to a unit error of level, and of excess
    PEAK_SEEN,
    INNER,  # six states of a disturbance observer; the fifth is the drive that it knows
) = range(23)
LINE = INNER + 6
STRIDE = 3

#: The Stribeck term is evaluated down to exp(-50).
_LARGEST_EXPONENT = 50.0
#: Force of the position error, over the Coulomb level, below which a contact holds the axis.
_CONTACT_FORCE = 0.5
#: Largest number of steps to invert the static input effects.
_MOST_SECANTS = 30
#: Largest number of secants to a level that depends on the drive.
_MOST_LEVEL_SECANTS = 12
#: Least part of a level that does not depend on the drive: below it the axis locks itself.
_LEAST_BEND = 0.02


class Law(NamedTuple):
    """Arrays that describe a law; those of the axis are without inner states."""

    numbers: Any
    axis_numbers: Any
    axis_integers: Any
    observer_numbers: Any
    observer_matrices: Any
    observer_gains: Any
    observer_transitions: Any
    observer_axis_numbers: Any
    observer_axis_integers: Any


@njit(cache=True, error_model="numpy")
def _peak(numbers, v):
    """Fraction of the Stribeck peak that remains at a speed."""
    if numbers[STRIBECK_SPEED] == 0.0:
        return 0.0
    z = max(v - numbers[STICK_SPEED], 0.0) / numbers[STRIBECK_SPEED]
    return math.exp(-min(z * z, _LARGEST_EXPONENT))


@axis_step.internal
def _loaded_level(plant, t, x, v, w, s):
    """Coulomb level where the drive overcomes it in addition to a force w."""
    # A level that grows with the load is a load itself: by secants, exact where it is linear.
    level = axis_step.coulomb_level(plant, t, x, v, w, s, 0.0)
    if plant.integers[axis_step.N_CARRIED] == 0:
        return level
    last = 0.0
    last_level = level
    for _ in range(_MOST_LEVEL_SECANTS):
        new = axis_step.coulomb_level(plant, t, x, v, w + s * level, s, 0.0)
        if abs(new - level) <= 1e-12 * new or level == last:
            break
        bend = 1.0 - (new - last_level) / (level - last)
        last = level
        last_level = new
        level = max(level + (new - level) / bend, 0.0) if bend > _LEAST_BEND else new
    return level


@axis_step.internal
def _levels(numbers, plant, t, x, v, w, s):
    """Coulomb level in direction s, and the Stribeck peak for an excess of 1."""
    level = _loaded_level(plant, t, x, v, w, s)
    w += s * level
    if numbers[EXCESS] == 0.0:
        return level, 0.0
    return level, (axis_step.breakaway_level(plant, t, x, w, s, 0.0) - level) / numbers[EXCESS]


@axis_step.internal
def _force_effects(plant, t, x, v, u, s):
    """Force effects of the axis in a given state."""
    return axis_step.load_under(plant, u, t, x, v, s, 0.0) - u


@axis_step.internal
def _inverse_input(plant, t, seen, wanted):
    """Drive that the static input effects map to the required force, by secants."""
    if plant.integers[axis_step.N_INPUT] == 0:
        return wanted
    u = wanted
    got = axis_step.input_map(plant, t, seen, wanted)
    slope = 1.0
    for _ in range(_MOST_SECANTS):
        error = wanted - got
        if abs(error) <= 1e-12 * (1.0 + abs(wanted)):
            break
        following = u + error / slope
        after = axis_step.input_map(plant, t, seen, following)
        if abs(following - u) > 0.0:
            slope = min(max((after - got) / (following - u), 0.1), 10.0)
        u = following
        got = after
    return u


@njit(cache=True, error_model="numpy")
def _low_pass(memory, at, corner, dt, value):
    """Second-order low-pass of damping 0.7; its value, slope and curvature."""
    a = corner * math.sqrt(0.5)
    fade = math.exp(-a * dt)
    c = math.cos(a * dt)
    s = math.sin(a * dt)
    x = memory[at] - value
    v = memory[at + 1]
    gone = fade * (x * c + (v / a + x) * s)
    slope = fade * (v * c - (v + 2.0 * a * x) * s)
    memory[at], memory[at + 1] = gone + value, slope
    return gone + value, slope, -2.0 * a * (a * gone + slope)


@njit(cache=True, error_model="numpy")
def update_extended_state(c, memory, y):
    """Extended state observer: position, velocity and resisting force in memory from INNER."""
    rate = c[VISCOUS] / c[MASS]
    dt = c[DT]
    x = memory[INNER]
    v = memory[INNER + 1]
    force = memory[INNER + 4] - memory[INNER + 2]
    x += dt * (v + 0.5 * dt * (force / c[MASS] - rate * v))
    v += dt * (force / c[MASS] - rate * v)
    error = y - x
    memory[INNER], memory[INNER + 1] = x + c[GAIN_X] * error, v + c[GAIN_V] * error
    memory[INNER + 2] -= c[GAIN_F] * error


@njit(cache=True, error_model="numpy")
def disturbance(c, memory, y):
    """Resisting force other than inertia and viscous friction; a baseline."""
    if c[SOURCE] == DISTURBANCE:
        _, v, a = _low_pass(memory, INNER, c[GAIN_X], c[DT], y)
        u, _, _ = _low_pass(memory, INNER + 2, c[GAIN_X], c[DT], memory[INNER + 4])
        return u - c[MASS] * a - c[VISCOUS] * v
    update_extended_state(c, memory, y)
    return memory[INNER + 2]


@axis_step.internal
def _learn(c, plant, t, memory, y, mode, v, what):
    """Correct levels and excess by the observer's friction; the residual [N]."""
    # Normalised least mean squares over (1, peak), both filtered like the observer's
    # estimate: its lag must not be learned as an error.
    s = float(mode)
    level, excess = _levels(c, plant, t, y, v, c[VISCOUS] * v, s)
    phi = _peak(c, s * v)
    place = PLUS if mode > 0 else MINUS
    if memory[MODE] != mode:
        memory[EXPECTED], memory[LEVEL_SEEN], memory[PEAK_SEEN] = -s * what, 0.0, 0.0
    now = memory[place] + memory[SHARE] * excess * phi
    memory[EXPECTED] += c[LAG] * (now - memory[EXPECTED])
    memory[LEVEL_SEEN] += c[LAG] * (1.0 - memory[LEVEL_SEEN])
    memory[PEAK_SEEN] += c[LAG] * (phi - memory[PEAK_SEEN])
    left = -s * what - memory[EXPECTED]
    one = memory[LEVEL_SEEN]
    peak = memory[PEAK_SEEN]
    gain = c[RATE] / (1.0 + peak * peak) * left
    band = c[BAND] * level
    memory[place] = min(max(memory[place] + gain * one, -band), band)
    if excess > 0.0:
        memory[SHARE] = min(max(memory[SHARE] + gain * peak / excess, 0.0), c[MOST_EXCESS])
    left = -s * what - now
    return min(max(left, -c[BAND] * level), c[BAND] * level)


@axis_step.internal
def _friction(c, plant, t, memory, x, v, w, moving, learned):
    """Friction for the reference's direction; `learned`: with what was learned (1) or not (0)."""
    s = memory[DIRECTION]
    level, excess = _levels(c, plant, t, x, v, w, s)
    level += learned * (memory[PLUS] if s > 0.0 else memory[MINUS])
    force = c[COULOMB] * level
    if not moving:
        force *= c[REST_SHARE]
    elif c[PEAK] > 0.0:
        share = c[EXCESS] + learned * (memory[SHARE] - c[EXCESS])
        force += c[PEAK] * share * excess * _peak(c, s * v)
    return force * (memory[CONTACT] if c[BUILD] > 0.0 else s)


@njit(cache=True, error_model="numpy")
def _follow_reference(c, memory, x, v):
    """Store the leading reference; the current reference and whether one of them moves."""
    moving = abs(v) > c[REST_SPEED]
    if moving:
        if c[HOLDS] != 0.0 and memory[STILL] > c[LEAD] + 2.0:
            # The integral that friction balanced at rest must not act on the next motion.
            memory[INTEGRAL] = memory[SLIDING]
        memory[DIRECTION] = 1.0 if v > 0.0 else -1.0
        memory[STILL] = 0.0
    else:
        memory[STILL] += 1.0
    if c[BUILD] > 0.0:
        built = memory[CONTACT] + (x - memory[AHEAD]) / c[BUILD]
        memory[CONTACT] = min(max(built, -1.0), 1.0)
    memory[AHEAD] = x
    lead = int(c[LEAD])
    if lead == 0:
        return x, v, moving
    last = LINE + STRIDE * (lead - 1)
    now = memory[last]
    speed = memory[last + 1]
    for i in range(last + STRIDE - 1, LINE + STRIDE - 1, -1):
        memory[i] = memory[i - STRIDE]
    memory[LINE], memory[LINE + 1] = x, v
    return now, speed, moving


@njit(cache=True, error_model="numpy")
def _rest(c, memory, mode, error, moving, forces, level):
    """Whether the integral is held at this sample, and whether the drive is."""
    # The held drive differs from the one that balances the other `forces` by at most a
    # fraction of the smaller Coulomb `level`.  Every slip, and every release of the held
    # drive, widens the tolerance, so that corrections end and the drive becomes constant.
    if c[HOLDS] == 0.0:
        return False, False
    if moving or memory[STILL] <= c[LEAD] + 2.0:
        memory[CORRECTIONS], memory[HELD], memory[MEAN_ERROR] = 0.0, 0.0, error
        return False, False
    memory[MEAN_ERROR] += c[MEAN] * (error - memory[MEAN_ERROR])
    if memory[HELD] == 0.0 and mode != 0 and memory[MODE] == 0.0:
        memory[CORRECTIONS] += 1.0
    # Ringing counts as slips, too: farther than that from its place no axis rests.
    farthest = max(2.0 * (1.0 + c[PEAK] * c[EXCESS] + c[BAND]) * level / c[KP], c[TOLERANCE])
    wide = min(c[TOLERANCE] * c[GROWTH] ** memory[CORRECTIONS], farthest)
    if memory[HELD] != 0.0:
        if abs(memory[MEAN_ERROR]) > 2.5 * wide:
            memory[HELD] = 0.0
            memory[CORRECTIONS] += 1.0
    elif (
        # An axis that swings about its place is not at rest, however small its mean error.
        memory[STILL] > c[SETTLE] and mode == 0 and max(abs(error), abs(memory[MEAN_ERROR])) <= wide
    ):
        most = c[HOLD_SHARE] * level
        held = min(max(memory[MEAN_DRIVE] - forces, -most), most)
        memory[HELD], memory[HELD_DRIVE] = 1.0, held
    return mode == 0 and abs(error) <= wide, memory[HELD] != 0.0


@njit(cache=True, error_model="numpy")
def _feedforward_delay(c, memory, forward):
    """Feedforward that reaches the axis now minus the present one, which is stored."""
    if c[LATE] == 0.0:
        return 0.0
    first = LINE + STRIDE - 1
    memory[first] = forward
    if memory[SAMPLES] == 0.0:
        for i in range(1, int(c[LEAD])):
            memory[first + STRIDE * i] = forward
    return memory[first + STRIDE * int(c[LATE])] - forward


@axis_step.internal
def _initial_state(c, memory, x, v, y, watch):
    """First sample: assumes that the axis has followed the reference so far, or rests."""
    if memory[DIRECTION] == 0.0:
        v = 0.0
        memory[DIRECTION] = 1.0
        memory[SHARE] = c[EXCESS]
        for i in range(int(c[LEAD])):
            memory[LINE + STRIDE * i] = x
    elif c[LEAD] > 0.0:
        v = memory[watch - STRIDE + 1]
    memory[AHEAD] = x
    if c[SOURCE] == EXTENDED:
        memory[INNER], memory[INNER + 1] = y, v
    memory[watch + observer.XHAT], memory[watch + observer.VHAT] = y, v


@njit(cache=True, error_model="numpy")
def step(law, memory, ahead, speed_ahead, acceleration_ahead, y):
    """Drive of one sample; `memory` is advanced.  The reference is that LEAD samples ahead."""
    c = law.numbers
    plant = axis_step.point(law.axis_numbers, law.axis_integers)
    watch = LINE + STRIDE * int(c[LEAD])
    seen = memory[watch:]
    t = memory[SAMPLES] * c[DT]
    if memory[SAMPLES] == 0.0:
        _initial_state(c, memory, ahead, speed_ahead, y, watch)
    x, v, moving = _follow_reference(c, memory, ahead, speed_ahead)
    error = x - y
    if memory[SAMPLES] == 0.0:
        memory[ERROR] = error
        if c[SOURCE] == LEARNED:
            memory[INNER] = -error
    # The feedback reads nothing but the error: its loop is linear in it, whatever the mode.
    difference = (error - memory[ERROR]) / c[DT]
    memory[SPEED] = c[KEEP] * memory[SPEED] + (1.0 - c[KEEP]) * difference
    memory[ERROR] = error
    speed = memory[SPEED]
    mode = 0

    # Feedforward for the required motion of the axis with its effects.
    later = t + c[LEAD] * c[DT]
    w = c[MASS] * acceleration_ahead + c[VISCOUS] * speed_ahead
    friction = _friction(c, plant, later, memory, ahead, speed_ahead, w, moving, 1.0)
    s = memory[DIRECTION] if moving else 0.0
    forward = w - _force_effects(plant, later, ahead, speed_ahead, w + friction, s)
    late = _feedforward_delay(c, memory, forward + friction)

    if c[SOURCE] == LEARNED:
        mode = int(seen[observer.MODE])
        update_extended_state(c, memory, -error)
        speed -= c[SPEED_SHARE] * (memory[INNER + 1] + speed)
        if mode != 0:
            left = _learn(
                c, plant, t, memory, y, mode, seen[observer.VHAT], seen[observer.WHAT]
            )  # fmt: skip
            if moving and mode == memory[DIRECTION]:
                friction += c[RESIDUAL] * mode * left
    elif c[SOURCE] != NOTHING:
        friction += c[RESIDUAL] * disturbance(c, memory, y)
        if c[SOURCE] == EXTENDED:
            speed = v - memory[INNER + 1]
    memory[FORCE] = friction

    level = axis_step.coulomb_level(plant, later, ahead, 0.0, 0.0, memory[DIRECTION], 0.0)
    # The direction in which the axis would break away is unknown: take the smaller level.
    other = axis_step.coulomb_level(plant, later, ahead, 0.0, 0.0, -memory[DIRECTION], 0.0)
    least = min(level, other)
    integral_held, drive_held = _rest(c, memory, mode, error, moving, forward, least)
    damping = c[KD]
    if (
        c[BUILD] > 0.0
        and memory[STILL] > c[LEAD] + 2.0
        and abs(c[KP] * error) < _CONTACT_FORCE * level
    ):
        # The elastic contact brakes; a delayed velocity feedback would excite it.
        damping = 0.0
    linear = c[KP] * error + damping * speed
    known = linear + forward + friction
    resting = c[HOLDS] != 0.0 and memory[STILL] > c[SETTLE]
    if c[HOLDS] != 0.0 and not resting:
        # Learning and integral together: what they may do wrong is bounded.
        plain = _friction(c, plant, later, memory, ahead, speed_ahead, w, moving, 0.0) - friction
        most = c[BAND] * max(level, other)
        memory[INTEGRAL] = min(max(memory[INTEGRAL], plain - most), plain + most)
    wanted = known + memory[INTEGRAL]
    if drive_held:
        wanted = forward + memory[HELD_DRIVE]
        memory[INTEGRAL] = min(max(wanted - known, -c[LIMIT]), c[LIMIT])
    given = min(max(wanted, -c[LIMIT]), c[LIMIT])
    if not (integral_held or drive_held) and wanted == given:
        taken = min(max(error, -c[SLOW]), c[SLOW]) if resting else error
        memory[INTEGRAL] += c[KI] * c[DT] * taken
    if moving:
        memory[SLIDING] += c[MEAN] * (memory[INTEGRAL] - memory[SLIDING])
    keep = 1.0 - c[MEAN] if memory[STILL] > 0.0 else 0.0
    memory[MEAN_DRIVE] = keep * memory[MEAN_DRIVE] + (1.0 - keep) * given
    memory[INNER + 4] = linear if c[SOURCE] == LEARNED else given
    inner = axis_step.pointer(seen)
    u = _inverse_input(plant, t, inner, given)
    if c[SOURCE] == LEARNED:
        stated = np.empty(observer.OUTPUTS)
        observer.step(
            law.observer_numbers, law.observer_matrices, law.observer_gains,
            law.observer_transitions, law.observer_axis_numbers, law.observer_axis_integers,
            seen, t, _inverse_input(plant, t, inner, given + late), y, stated,
        )  # fmt: skip
    memory[MODE] = mode
    memory[SAMPLES] += 1.0
    return u


@njit(cache=True, error_model="numpy")
def read_laws(numbers, integers, t, x, v):
    """Force effects at x and v, and the Coulomb levels + and - at rest at x."""
    plant = axis_step.point(numbers, integers)
    plus = axis_step.coulomb_level(plant, t, x, 0.0, 0.0, 1.0, t)
    minus = axis_step.coulomb_level(plant, t, x, 0.0, 0.0, -1.0, t)
    s = 1.0 if v > 0.0 else -1.0 if v < 0.0 else 0.0
    return _force_effects(plant, t, x, v, 0.0, s), plus, minus


@njit(cache=True, error_model="numpy")
def run_loop(numbers, integers, state, law, memory, reference, disturbance, quantum, dt, room, out):
    """Closed loop into `out`, as `loop.run_loop`; `reference`: position, velocity, acceleration."""
    plant = axis_step.point(numbers, integers)
    at = axis_step.pointer(state)
    n = reference.shape[1]
    lead = int(law.numbers[LEAD])
    events = np.empty(64 * room)
    count = axis_step.empty_tally(events)
    for k in range(n):
        if 3 * count[axis_step.LISTED] + room > events.shape[0]:
            events = axis_step.longer_list(events, count)
        y = encode(axis_step.encoder_reading(plant, k * dt, at), quantum)
        j = min(k + lead, n - 1)
        u = step(law, memory, reference[0, j], reference[1, j], reference[2, j], y)
        advance_plant(plant, k, dt, at, u, disturbance[k], y, events, count, out)
    return axis_step.switch_rows(events, count[axis_step.LISTED]), count[axis_step.LOST]
