"""Inner states of an axis: elastic contact, play, spring between motor and load.

All of it is called through one address, `inner_task`: it is compiled once, and only if
such an axis is used.
"""

from __future__ import annotations

import functools
import math

from numba import cfunc, njit

from dryfric_control.compiled.axis_step import (
    ADVANCE,
    ALLOWED,
    BEHIND,
    CLOSE,
    CONTACT,
    CONTACT_STIFFNESS,
    DAMPING,
    DEFLECTION,
    EXCESS,
    FILIPPOV,
    HALF_GAP,
    INVERSE_MASS,
    INVERSE_MOTOR,
    LISTED,
    MODE,
    MOST,
    MOST_CLOSE,
    N_LEVEL,
    N_MINUS,
    N_NUMBERS,
    N_PLUS,
    OFFSET,
    PAPER,
    PLAY,
    REST,
    RIGID_TASK,
    RULE,
    SETTLE,
    SHORT_TIME,
    SHORTEST,
    SLIP,
    SPRING,
    STICK_RATE,
    STICK_SPEED,
    STIFFNESS,
    STRUCTURE,
    TASK_CALL,
    TOLERANCE,
    VISCOUS,
    Drive,
    Plant,
    V,
    X,
    at_zero,
    band_excess,
    base_level,
    begin,
    crowded,
    do,
    drive_force,
    further,
    held_force,
    hold_excess,
    internal,
    load,
    peak_step,
    peaked_level,
    record,
    refined,
    resolve,
    sliding_level,
    spare_memory,
    step_error,
    turning,
)
from dryfric_control.compiled.roots import between, larger, narrowed

# Error of the cut at a switch, as a fraction of the error allowed for a step; the same where
# two masses meet, to which a filter is more sensitive.
_CUT, _MEETING = 0.1, 0.01
# Phase of mode 0 in which an elastic contact slides although it springs back, because the level
# falls faster than its force: direction of the deflection times _BACK.
_BACK = 2
# Half the span of a difference in time, as a fraction of the step.
_SPAN = 1e-3
# Distance from sliding, as a fraction of the largest deflection, that one step may bridge and
# come back.
_NEAR = 0.1
# Force of an impact, as a multiple of all others.
_HARD = 1e3


@internal
def _later(drive, tau):
    """The same drive, its time counted from tau."""
    start = drive.start + drive.slope * tau
    if drive.fade == 0.0:
        return Drive(start, drive.slope, 0.0, 0.0)
    return Drive(start, drive.slope, drive.fade * math.exp(-drive.rate * tau), drive.rate)


@internal(forceinline=True)
def _load_side(plant):
    """The plant with only the mass of the load."""
    return Plant(further(plant.numbers, plant.integers[N_NUMBERS]), plant.integers)


@internal(forceinline=True)
def _transmitted(side, drive, tau, x, v, y, p):
    """Force on the load: of the spring between two masses, or of the drive."""
    if side.integers[STRUCTURE] & SPRING:
        return side.numbers[STIFFNESS] * (x - y) + side.numbers[DAMPING] * (v - p)
    return drive_force(drive, tau)


@internal
def _bound(side, t, y, p, w, s, rest):
    """Friction that an elastic contact can carry in direction s at velocity p."""
    return peaked_level(side, t, y, p, s * abs(p), w, base_level(side, y, s), s, rest)


@internal
def _rates(side, drive, t0, tau, x, v, y, p, anchor, mode, rest):
    """Accelerations of motor and load in one phase.

    `mode`: the mode, or a direction times _BACK.  `anchor` is the position of the load
    at which an elastic contact is unstrained: its deflection is y - anchor.
    """
    force = _transmitted(side, drive, tau, x, v, y, p)
    motor = 0.0
    if side.integers[STRUCTURE] & SPRING:
        motor = (drive_force(drive, tau) - force) * side.numbers[INVERSE_MOTOR]
    s, t = float(mode), t0 + tau
    if mode == 0 and not side.integers[STRUCTURE] & CONTACT:
        return motor, -side.numbers[STICK_RATE] * p
    w = load(side, held_force(force), t, 0.0, y, p, s if abs(mode) == 1 else 0.0, rest)
    if mode == 0:
        friction = side.numbers[CONTACT_STIFFNESS] * (y - anchor)
    elif abs(mode) == _BACK:
        s /= _BACK
        friction = s * _bound(side, t, y, p, w, s, rest)
    else:
        friction = s * sliding_level(side, t, y, p, w, s)
    return motor, (w - side.numbers[VISCOUS] * p - friction) * side.numbers[INVERSE_MASS]


@njit(cache=True, error_model="numpy", forceinline=True)
def _wave_error(k1, k2, k3, k4, phi, d):
    """Velocity error of one step of an oscillation whose phase advances by phi in it.

    An acceleration A cos causes the error d A phi^4/120; A phi is the first
    difference of the stages, A phi^2/4 the second.
    """
    return d * phi * phi * (phi * abs(k4 - k1) + 4.0 * abs((k1 - k2) - (k3 - k4))) / 120.0


@internal
def _stride(side, drive, t0, tau, x, v, y, p, anchor, mode, rest, m1, k1, d):
    """One step of motor and load: their states, last stages, and the step's error."""
    half = 0.5 * d
    ym, xm = y + half * (p + 0.25 * d * k1), x + half * (v + 0.25 * d * m1)
    m2, k2 = _rates(
        side, drive, t0, tau + half, xm, v + half * m1, ym, p + half * k1, anchor, mode, rest
    )
    m3, k3 = _rates(
        side, drive, t0, tau + half, xm, v + half * m2, ym, p + half * k2, anchor, mode, rest
    )
    x1, y1 = x + d * (v + half * m3), y + d * (p + half * k3)
    m4, k4 = _rates(side, drive, t0, tau + d, x1, v + d * m3, y1, p + d * k3, anchor, mode, rest)
    x1, y1 = x + d * (v + d * (m1 + m2 + m3) / 6.0), y + d * (p + d * (k1 + k2 + k3) / 6.0)
    v1 = v + d * (m1 + 2.0 * (m2 + m3) + m4) / 6.0
    p1 = p + d * (k1 + 2.0 * (k2 + k3) + k4) / 6.0
    numbers = side.numbers
    turn = 0.0
    if mode == 0:
        turn = numbers[STICK_RATE]
        if side.integers[STRUCTURE] & CONTACT:
            turn = math.sqrt(numbers[CONTACT_STIFFNESS] * numbers[INVERSE_MASS])
    error = 0.0
    if side.integers[STRUCTURE] & SPRING:
        inverse = numbers[INVERSE_MOTOR] + numbers[INVERSE_MASS]
        turn += math.sqrt(numbers[STIFFNESS] * inverse) + numbers[DAMPING] * inverse
        error = _wave_error(m1, m2, m3, m4, d * turn, d)
    error = max(error, _wave_error(k1, k2, k3, k4, d * turn, d))
    # Position-dependent forces: the elastic force represents their size; their passage
    # through zero is left to the wave error (distance infinite).  The allowed error is
    # 0 here, so that the estimate is not shortened to zero.
    pull = numbers[INVERSE_MASS] * (
        abs(_transmitted(side, drive, tau, x, v, y, p))
        + numbers[CONTACT_STIFFNESS] * abs(y - anchor)
    )
    error = max(error, step_error(side, drive, k1, k2, k3, k4, pull, math.inf, d, 0.0))
    return x1, v1, y1, p1, m4, k4, error


@njit(cache=True, error_model="numpy", forceinline=True)
def _touch(gap, rate, end, last, d):
    """When a gap that closes at `rate` at first, and at `last` at the end of d, may vanish.

    Where the tangents of both ends meet, a bound for a smooth course and for a kink; d if
    they meet before the gap vanishes.
    """
    if end <= 0.0 or not rate > 0.0 > last:
        return d
    meet = min(max((gap - end - last * d) / (rate - last), 0.1 * d), 0.9 * d)
    return meet if gap < meet * rate else d


@internal(forceinline=True)
def _open(phase):
    """Mode of a phase."""
    return phase if abs(phase) != _BACK else 0


@internal
def _most(side, drive, t0, tau, x, v, y, p, s, rest):
    """Deflection in direction s at which an elastic contact slides, a magnitude."""
    force = _transmitted(side, drive, tau, x, v, y, p)
    w = load(side, held_force(force), t0 + tau, 0.0, y, p, 0.0, rest)
    return _bound(side, t0 + tau, y, p, w, s, rest) / side.numbers[CONTACT_STIFFNESS]


@internal
def _tightens(side, drive, t0, tau, x, v, y, p, m, k, s, rest, d):
    """Rate at which a deflection in direction s approaches the one at which it slides.

    m and k are the accelerations of motor and load; d is the length of the step.
    """
    span = _SPAN * d
    later = _most(
        side, drive, t0, tau + span, x + span * v, v + span * m, y + span * p, p + span * k, s, rest
    )
    earlier = _most(
        side, drive, t0, tau - span, x - span * v, v - span * m, y - span * p, p - span * k, s, rest
    )
    return s * p - (later - earlier) / (2.0 * span)


@internal
def _margin(side, drive, t0, tau, x, v, y, p, anchor, mode, rest, flips, step):
    """Distance from the end of a phase, inside a step of length `step`: positive until then."""
    s, t = float(mode), t0 + tau
    if side.integers[STRUCTURE] & CONTACT:
        if abs(mode) == 1:
            return s * p
        if mode != 0:
            s /= _BACK
            if s * p > 0.0:
                return -s * p
            m, k = _rates(side, drive, t0, tau, x, v, y, p, anchor, mode, rest)
            return _tightens(side, drive, t0, tau, x, v, y, p, m, k, s, rest, step)
        s = 1.0 if y > anchor else -1.0
        return _most(side, drive, t0, tau, x, v, y, p, s, rest) - s * (y - anchor)
    if mode != 0:
        if s * p > side.numbers[STICK_SPEED]:
            return math.inf
        if s * p <= 0.0 and (side.integers[RULE] == FILIPPOV or flips == 0):
            return s * p
    held = held_force(_transmitted(side, drive, tau, x, v, y, p))
    if mode == 0:
        excess = hold_excess(side, held, t, 0.0, y, p, rest)[0]
        # A load that equals the level holds; how far it is from its end, no number says.
        return -excess if excess != 0.0 else math.inf
    # As a velocity, like the margin beyond the reversal: a search sees both.
    return step * side.numbers[INVERSE_MASS] * band_excess(side, held, t, 0.0, y, p, s)


@internal
def _begin_inner(side, drive, t0, x, v, y, p, z, mode, rest):
    """Mode, velocity and deflection of the load, friction force, accelerations."""
    force = _transmitted(side, drive, 0.0, x, v, y, p)
    w = load(side, held_force(force), t0, 0.0, y, p, float(mode), rest)
    if not side.integers[STRUCTURE] & CONTACT:
        mode, p = resolve(side, t0, y, p, mode, rest, w)
        motor, rate = _rates(side, drive, t0, 0.0, x, v, y, p, y, mode, rest)
        if mode == 0:
            return mode, p, 0.0, w, motor, rate
        s = float(mode)
        w = load(side, held_force(force), t0, 0.0, y, p, s, 0.0)
        return mode, p, 0.0, s * sliding_level(side, t0, y, p, w, s), motor, rate
    stiffness = side.numbers[CONTACT_STIFFNESS]
    if mode != 0 and mode * p <= 0.0:
        mode = 0
    if mode == 0:
        s = 1.0 if z > 0.0 else -1.0
        bound = _bound(side, t0, y, p, w, s, rest)
        # Start no elastic phase because of round-off in a contact that already slides.
        if s * stiffness * z >= bound * (1.0 - 1e-12):
            z = s * bound / stiffness
            mode = int(s) if s * p > 0.0 else 0
    if mode == 0:
        friction = stiffness * z
    else:
        s = float(mode)
        w = load(side, held_force(force), t0, 0.0, y, p, s, 0.0)
        friction = s * sliding_level(side, t0, y, p, w, s)
    motor, rate = _rates(side, drive, t0, 0.0, x, v, y, p, y - z, mode, rest)
    return mode, p, z, friction, motor, rate


@internal(forceinline=True)
def _fades(side):
    """Whether the level can fall while an elastic contact is strained."""
    return side.integers[STRUCTURE] & CONTACT != 0 and (
        side.numbers[EXCESS] > 0.0
        or side.integers[N_LEVEL] + side.integers[N_PLUS] + side.integers[N_MINUS] > 2
    )


@internal
def _slides_back(side, drive, t0, x, v, y, p, z, m1, k1, rest, h):
    """Whether a contact of deflection z slides although it springs back: its limit falls faster."""
    s = math.copysign(1.0, z)
    if s * z < _most(side, drive, t0, 0.0, x, v, y, p, s, rest) * (1.0 - 1e-12):
        return False
    d = min(h, side.numbers[SHORT_TIME])
    return _tightens(side, drive, t0, 0.0, x, v, y, p, m1, k1, s, rest, d) > 0.0


@internal(forceinline=True)
def _shortened(side, y, p, y1, p1, mode, fades, k1, k4, d, error, allowed):
    """Length of the step to try instead of one of length d of the load; d if it may stay."""
    cut = refined(side, y1 - y, error, allowed, d)
    if cut == d and (mode != 0 or fades):
        sight = peak_step(side, abs(p), abs(p1), 1.0, d)
        if sight < 0.99 * d:
            return sight
    if cut == d and abs(mode) == 1:
        return turning(p, p1, float(mode), k1, k4, d, 0.0)
    return cut


@internal
def _touches(
    side, drive, t0, tau, x, v, y, p, x1, v1, y1, p1, anchor, m1, k1, m4, k4, rest, gap, left, d
):
    """When an elastic contact may reach its limit and leave it within a step; d if it does not.

    `gap` and `left` are its distances from the limit at both ends of the step.
    """
    s = math.copysign(1.0, y1 - anchor)
    rate = _tightens(side, drive, t0, tau, x, v, y, p, m1, k1, s, rest, d)
    if rate <= 0.0 or gap >= rate * d:
        return d
    end = _tightens(side, drive, t0, tau + d, x1, v1, y1, p1, m4, k4, s, rest + d, d)
    return _touch(gap, rate, left, end, d)


@internal
def _phase_end(side, drive, t0, tau, x, v, y, p, anchor, mode, rest, m1, k1, flips, d, left, exact):
    """Length of the part of a step of length d that ends with the phase, by repeating the step."""
    a, b, fb, last = 0.0, d, left, 0
    fa = _margin(side, drive, t0, tau, x, v, y, p, anchor, mode, rest, flips, d)
    for i in range(200):
        c = between(a, fa, b, fb)
        if b - a <= exact or fb == 0.0 or c == b:
            break
        # The margin may jump: bisect every fourth time, or where it is not known.
        if i % 4 == 3 or fa == math.inf:
            c = 0.5 * (a + b)
        xc, vc, yc, pc, _, _, _ = _stride(
            side, drive, t0, tau, x, v, y, p, anchor, mode, rest, m1, k1, c
        )
        now = rest + c if abs(mode) != 1 else 0.0
        fc = _margin(side, drive, t0, tau + c, xc, vc, yc, pc, anchor, mode, now, flips, d)
        a, fa, b, fb, last = narrowed(a, fa, b, fb, last, c, fc)
    return b


@internal(forceinline=True)
def _back_anchor(side, drive, t0, tau, x, v, y, p, mode, rest):
    """Where the contact is unstrained in a phase in which it slides although it springs back."""
    s = float(mode) / _BACK
    return y - s * _most(side, drive, t0, tau, x, v, y, p, s, rest)


@internal
def _phase_after(side, drive, t0, tau, x, v, y, p, anchor, mode, rest, flips, moved):
    """Phase after the end of another, velocity of the load, and anchor of the contact.

    `moved`: whether a part of the step came before that end.
    """
    s = float(mode)
    held = held_force(_transmitted(side, drive, tau, x, v, y, p))
    if side.integers[STRUCTURE] & CONTACT:
        if abs(mode) == _BACK:
            s /= _BACK
            anchor = _back_anchor(side, drive, t0, tau, x, v, y, p, mode, rest)
            return (int(s) if s * p > 0.0 else 0), p, anchor
        if mode == 0:
            s = 1.0 if y > anchor else -1.0
            return int(s if s * p > 0.0 else s * _BACK), p, anchor
        w = load(side, held, t0 + tau, 0.0, y, 0.0, s, 0.0)
        level = sliding_level(side, t0 + tau, y, 0.0, w, s)
        return 0, 0.0, y - s * level / side.numbers[CONTACT_STIFFNESS]
    if mode == 0:
        s = hold_excess(side, held, t0 + tau, 0.0, y, p, rest)[1]
        return int(s), (0.0 if s * p < 0.0 else p), anchor
    if s * p > 0.0 or (side.integers[RULE] == PAPER and flips > 0):
        return 0, p, anchor
    if side.integers[RULE] == PAPER:
        return -mode, 0.0, anchor
    held = held_force(_transmitted(side, drive, tau, x, v, y, 0.0))
    w = load(side, held, t0 + tau, 0.0, y, 0.0, s, 0.0)
    after = at_zero(side, t0 + tau, y, w, mode)
    # Where load and level are equal up to round-off, it rests.
    return (after if moved or after != mode else 0), 0.0, anchor


@internal
def _advance_inner(side, drive, t0, h, memory, events, count):
    """Move one mass on an elastic contact, or two masses on a spring.

    `side` is the plant with the mass on which the friction acts.  Otherwise as
    `advance`.
    """
    two = side.integers[STRUCTURE] & SPRING != 0
    contact = side.integers[STRUCTURE] & CONTACT != 0
    stiffness, sigma = side.numbers[CONTACT_STIFFNESS], side.numbers[STICK_SPEED]
    x, v, mode, rest = memory[X], memory[V], int(memory[MODE]), memory[REST]
    y, p = x, v
    if two:
        y, p = x + memory[OFFSET], v + memory[SLIP]
    first, p, z, friction, m1, k1 = _begin_inner(
        side, drive, t0, x, v, y, p, memory[DEFLECTION], mode, rest
    )
    if first != mode:
        record(events, count, t0, mode, first)
        mode, rest = first, 0.0
    seen = v if two else p
    anchor = y - z
    fades = _fades(side)
    if fades and mode == 0 and z * p <= 0.0:
        if _slides_back(side, drive, t0, x, v, y, p, z, m1, k1, rest, h):
            mode = int(math.copysign(_BACK, z))
    # Distance of the contact from its limit.
    gap = 0.0
    if contact and mode == 0:
        gap = _margin(side, drive, t0, 0.0, x, v, y, p, anchor, mode, rest, 0, h)
    tau, longest, switches, flips, fresh = 0.0, h, 0, 0, False
    close, pause, resume, last = 0, CLOSE * h, 0.0, -h
    while tau < h:
        if fresh:
            m1, k1 = _rates(side, drive, t0, tau, x, v, y, p, anchor, mode, rest)
            fresh = False
        # The mode is held until `resume`, see `crowded`.
        bound = h if tau >= resume else min(resume, h)
        d = min(longest, bound - tau, side.numbers[SHORT_TIME])
        x1, v1, y1, p1, m4, k4, error = _stride(
            side, drive, t0, tau, x, v, y, p, anchor, mode, rest, m1, k1, d
        )
        pace = abs(p) + sigma + d * abs(k1)
        if two:
            pace += abs(v) + d * abs(m1)
        allowed = TOLERANCE * pace + side.numbers[ALLOWED]
        divisible = d > SHORTEST * h
        if divisible:
            cut = _shortened(side, y, p, y1, p1, mode, fades, k1, k4, d, error, allowed)
            if cut < d:
                longest = cut
                continue
        after_rest = rest + d if abs(mode) != 1 else 0.0
        left = math.inf
        if bound == h and switches < count[MOST]:
            left = _margin(
                side, drive, t0, tau + d, x1, v1, y1, p1, anchor, mode, after_rest, flips, d
            )
        if contact and mode == 0 and left < math.inf:
            if divisible and left > 0.0 and min(gap, left) < _NEAR * abs(y1 - anchor):
                cut = _touches(
                    side, drive, t0, tau, x, v, y, p, x1, v1, y1, p1, anchor, m1, k1, m4, k4, rest,
                    gap, left, d,
                )  # fmt: skip
                if cut < d:
                    longest = cut
                    continue
            gap = left
        if left > 0.0:
            x, v, y, p, rest, fresh = x1, v1, y1, p1, after_rest, True
            tau += d
            if abs(mode) == _BACK:
                anchor = _back_anchor(side, drive, t0, tau, x, v, y, p, mode, rest)
            if tau + SHORTEST * h >= h:
                tau = h
            if longest < h:
                longest = larger(d, allowed, error)
            continue

        exact = (1e-14 + _CUT * side.numbers[ALLOWED] / pace) * d
        cut = _phase_end(
            side, drive, t0, tau, x, v, y, p, anchor, mode, rest, m1, k1, flips, d, left, exact
        )
        x, v, y, p, _, _, _ = _stride(
            side, drive, t0, tau, x, v, y, p, anchor, mode, rest, m1, k1, cut
        )
        tau += cut
        if tau + SHORTEST * h >= h:
            tau = h
        fresh, longest = True, h
        if abs(mode) != 1:
            rest += cut
        after, p, anchor = _phase_after(
            side, drive, t0, tau, x, v, y, p, anchor, mode, rest, flips, cut > 2e-14 * d
        )
        if mode != 0 and after == -mode:
            flips += 1
        if after != mode:
            switches += 1
            if abs(mode) == 1 or abs(after) == 1:
                record(events, count, t0 + tau, _open(mode), _open(after), switches)
                rest = 0.0
            mode, gap = after, 0.0
            close, pause, resume = crowded(tau, last, h, close, pause)
            last = tau

    if contact:
        z = y - anchor
        if abs(mode) == 1:
            s = float(mode)
            force = _transmitted(side, drive, h, x, v, y, p)
            w = load(side, held_force(force), t0 + h, 0.0, y, p, s, 0.0)
            z = s * sliding_level(side, t0 + h, y, p, w, s) / stiffness
        memory[DEFLECTION] = z
    elif mode == 0 and abs(p) < 1e-9 * sigma:
        p = 0.0
    if two:
        memory[X], memory[V], memory[OFFSET], memory[SLIP] = x, v, y - x, p - v
    else:
        memory[X], memory[V] = y, p
    memory[MODE], memory[REST] = _open(mode), rest
    return seen, friction, first


@internal
def _advance_one(plant, drive, t0, h, memory, events, count):
    """Move one mass, on an elastic contact or not."""
    if plant.integers[STRUCTURE] & CONTACT:
        return _advance_inner(plant, drive, t0, h, memory, events, count)
    return do(plant, RIGID_TASK, ADVANCE, drive, t0, h, memory, events, count)


@internal
def _motor(plant, drive, v, tau):
    """Distance and velocity of the motor alone after tau, exact."""
    inverse = plant.numbers[INVERSE_MOTOR]
    push = tau * (drive.start + 0.5 * drive.slope * tau)
    moved = tau * tau * (0.5 * drive.start + drive.slope * tau / 6.0)
    if drive.fade != 0.0:
        phi = drive.rate * tau
        fall = -math.expm1(-phi) / drive.rate
        push += drive.fade * fall
        if phi > 1e-3:
            moved += drive.fade * (tau - fall) / drive.rate
        else:
            moved += drive.fade * tau * tau * (0.5 - phi / 6.0 + phi * phi / 24.0)
    return v * tau + moved * inverse, v + push * inverse


@njit(cache=True, error_model="numpy")
def _state_of_load(memory, scratch):
    """Copy the state of the load, as a single mass, into `scratch`."""
    scratch[X], scratch[V] = memory[X] + memory[OFFSET], memory[V] + memory[SLIP]
    scratch[MODE], scratch[REST] = memory[MODE], memory[REST]
    scratch[DEFLECTION] = memory[DEFLECTION]


@internal
def _seen_one(plant, drive, t, state):
    """Mode, velocity, friction force and acceleration of one mass at the start."""
    mode = int(state[MODE])
    if plant.integers[STRUCTURE] & CONTACT:
        mode, p, _, friction, _, rate = _begin_inner(
            plant, drive, t, state[X], state[V], state[X], state[V],
            state[DEFLECTION], mode, state[REST],
        )  # fmt: skip
        return mode, p, friction, rate
    mode, p, friction, rate = begin(plant, drive, t, state[X], state[V], mode, state[REST])
    if mode == 0:
        rate = -plant.numbers[STICK_RATE] * p
    return mode, p, friction, rate


@internal(forceinline=True)
def _pushes(plant, drive, rate, side):
    """Force of the motor, in contact at `side`, on a load with acceleration `rate`."""
    return side * (drive_force(drive, 0.0) - rate / plant.numbers[INVERSE_MOTOR])


@internal
def _push(plant, drive, t, state, side):
    """Contact force as in `_pushes`, for one mass in a given state."""
    return _pushes(plant, drive, _seen_one(plant, drive, t, state)[3], side)


@internal
def meeting(plant, memory):
    """Side on which motor and load touch without moving apart, 0 for none."""
    half = plant.numbers[HALF_GAP]
    if abs(memory[OFFSET]) < half * (1.0 - 1e-12):
        return 0.0
    side = 1.0 if memory[OFFSET] < 0.0 else -1.0
    return side if side * memory[SLIP] <= 0.0 else 0.0


@internal
def _lost(plant, t, y, v, side):
    """Part of the impulse of an impact that friction takes from the load: its slope over force."""
    load_side, s = _load_side(plant), math.copysign(1.0, v)
    others = abs(load(load_side, held_force(0.0), t, 0.0, y, v, s, 0.0))
    size = base_level(plant, y, s) + others
    force = side * (_HARD * size if size > 0.0 else 1.0)
    w = load(load_side, held_force(force), t, 0.0, y, v, s, 0.0)
    level = sliding_level(load_side, t, y, v, w, s)
    w = load(load_side, held_force(0.5 * force), t, 0.0, y, v, s, 0.0)
    return s * side * (level - sliding_level(load_side, t, y, v, w, s)) / (0.5 * abs(force))


@internal
def _together(plant, t, y, v, p, side):
    """Common velocity after a plastic impact of motor (v) and load (p, at y).

    Momentum is conserved but for what friction takes that depends on the load.
    """
    motor = plant.numbers[INVERSE_MASS] / plant.numbers[INVERSE_MOTOR]
    rest = 1.0 - motor
    momentum = motor * v + rest * p
    if plant.numbers[BEHIND] != 1.0 and momentum != 0.0:
        motor *= 1.0 - _lost(plant, t, y, momentum, side)
    return (motor * v + rest * p) / (motor + rest)


@internal
def _impact(plant, t, memory, side):
    """Plastic impact of motor and load that are at the end of the play."""
    memory[OFFSET] = -side * plant.numbers[HALF_GAP]
    if memory[SLIP] != 0.0:
        x, v = memory[X], memory[V]
        memory[V] = _together(plant, t, x + memory[OFFSET], v, v + memory[SLIP], side)
        memory[SLIP] = 0.0


@internal
def _joined(plant, drive, t, d, memory, side, scratch, events, count):
    """Move motor and load as one mass over d; the contact force at the end."""
    _state_of_load(memory, scratch)
    _advance_one(plant, drive, t, d, scratch, events, count)
    return _push(plant, _later(drive, d), t + d, scratch, side)


@internal
def _apart(plant, drive, t, d, memory, scratch, events, count):
    """Move motor and load without contact over d; the motor's lead at the end."""
    _state_of_load(memory, scratch)
    _advance_one(_load_side(plant), held_force(0.0), t, d, scratch, events, count)
    moved, _ = _motor(plant, drive, memory[V], d)
    # Computed from differences, as the gap is small compared with the position.
    return moved - memory[OFFSET] - (scratch[X] - (memory[X] + memory[OFFSET]))


@internal
def _stop(d, memory, scratch):
    """When the load stops for the rest of d; d if it does not.

    Where it stops, force and relative velocity of motor and load change abruptly.
    """
    stop = d - scratch[REST]
    stops = scratch[MODE] == 0.0 and memory[MODE] != 0.0
    return stop if stops and stop > CLOSE * d else d


@internal(inline="always")
def _until(plant, drive, t, d, shortest, memory, scratch, events, count):
    """Until when motor and load, apart, are to be moved, and the motor's lead then.

    Over d, or shorter: until the load stops, or to where they may touch and part again.
    """
    known = count[LISTED]
    lead = _apart(plant, drive, t, d, memory, scratch, events, count)
    until = _stop(d, memory, scratch)
    if until == d:
        s, half = math.copysign(1.0, -memory[SLIP]), plant.numbers[HALF_GAP]
        last = s * (_motor(plant, drive, memory[V], d)[1] - scratch[V])
        until = _touch(half + s * memory[OFFSET], abs(memory[SLIP]), half - s * lead, last, d)
    if until < d and d > shortest:
        count[LISTED] = known
        lead = _apart(plant, drive, t, until, memory, scratch, events, count)
        return until, lead
    return d, lead


@internal(inline="always")
def _advance_play(plant, drive, t0, h, memory, events, count):
    """Move motor and load with a play between them, see `advance`.

    In contact they are one mass until the contact would have to pull.  Apart, the
    motor moves in closed form and the load under its own forces, until they meet.
    """
    half = plant.numbers[HALF_GAP]
    scratch = spare_memory()
    tau = 0.0
    side = meeting(plant, memory)
    if side != 0.0:
        _impact(plant, t0, memory, side)
    seen, friction, first, side = _seen_play(plant, drive, t0, memory, side)
    pace = abs(memory[V]) + abs(memory[V] + memory[SLIP]) + plant.numbers[STICK_SPEED]
    exact = 1e-15 + _MEETING * plant.numbers[ALLOWED] / pace
    close = 0
    for turn in range(count[MOST]):
        if tau >= h:
            break
        # Contact is checked at the end of each piece, which is therefore smooth.
        d = min(h - tau, plant.numbers[SHORT_TIME])
        # Bound the work and the number of listed switches.
        last_turn = turn == count[MOST] - 1 or close >= MOST_CLOSE
        if turn == count[MOST] - 1:
            d = h - tau
        now, piece = t0 + tau, _later(drive, tau)
        known = count[LISTED]
        if side != 0.0:
            end = _joined(plant, piece, now, d, memory, side, scratch, events, count)
            stop = _stop(d, memory, scratch)
            if stop < d and not last_turn:
                count[LISTED], d = known, stop
                end = _joined(plant, piece, now, d, memory, side, scratch, events, count)
            if end < 0.0 and not last_turn:
                a, b = 0.0, d
                _state_of_load(memory, scratch)
                fa, fb = _push(plant, piece, now, scratch, side), end
                last = 0
                for i in range(100):
                    c = between(a, fa, b, fb)
                    if b - a <= exact * d or fb == 0.0 or c == b:
                        break
                    # The contact force may jump when the load sticks: bisect every fourth time.
                    if i % 4 == 3:
                        c = 0.5 * (a + b)
                    count[LISTED] = known
                    fc = _joined(plant, piece, now, c, memory, side, scratch, events, count)
                    a, fa, b, fb, last = narrowed(a, fa, b, fb, last, c, fc)
                count[LISTED] = known
                _joined(plant, piece, now, b, memory, side, scratch, events, count)
                d = b
                offset, after = -side * half, 0.0
            else:
                offset, after = -side * half, side
            memory[X], memory[V] = scratch[X] - offset, scratch[V]
            memory[OFFSET], memory[SLIP] = offset, 0.0
        else:
            shortest = math.inf if last_turn else CLOSE * h
            d, lead = _until(plant, piece, now, d, shortest, memory, scratch, events, count)
            after = 0.0
            if abs(lead) > half and not last_turn:
                after = 1.0 if lead > 0.0 else -1.0
                a, b = 0.0, d
                fa, fb = half + after * memory[OFFSET], half - after * lead
                if fa <= 0.0:
                    # They separate and meet in one piece: find an instant in between.
                    c = 0.5 * d
                    for _ in range(30):
                        count[LISTED] = known
                        lead = _apart(plant, piece, now, c, memory, scratch, events, count)
                        if after * lead < half:
                            a, fa = c, half - after * lead
                            break
                        b, fb = c, half - after * lead
                        c *= 0.5
                last = 0
                if fa <= 0.0:
                    b = 0.0
                for _ in range(100):
                    c = between(a, fa, b, fb)
                    if b - a <= exact * d or fb == 0.0 or c == b:
                        break
                    count[LISTED] = known
                    lead = _apart(plant, piece, now, c, memory, scratch, events, count)
                    a, fa, b, fb, last = narrowed(a, fa, b, fb, last, c, half - after * lead)
                count[LISTED] = known
                lead = after * half
                if b > 0.0:
                    _apart(plant, piece, now, b, memory, scratch, events, count)
                else:
                    _state_of_load(memory, scratch)
                d = b
            moved, speed = _motor(plant, piece, memory[V], d)
            memory[X] += moved
            memory[V] = speed
            memory[OFFSET], memory[SLIP] = -lead, scratch[V] - speed
            if after != 0.0:
                memory[OFFSET] = -after * half
                memory[V] = _together(plant, now + d, scratch[X], speed, scratch[V], after)
                memory[SLIP] = 0.0
        memory[MODE], memory[REST] = scratch[MODE], scratch[REST]
        memory[DEFLECTION] = scratch[DEFLECTION]
        tau += d
        close = close + 1 if d < CLOSE * h else 0
        if tau + SHORTEST * h >= h:
            tau = h
        if after != 0.0 and side == 0.0 and tau < h:
            _state_of_load(memory, scratch)
            if _push(plant, _later(drive, tau), t0 + tau, scratch, after) < 0.0:
                after = 0.0
        side = after
    return seen, friction, first


@internal
def _seen_play(plant, drive, t, memory, side):
    """Velocity of the motor, friction force, mode, and the side of contact if it holds."""
    scratch = spare_memory()
    _state_of_load(memory, scratch)
    if side != 0.0:
        mode, _, friction, rate = _seen_one(plant, drive, t, scratch)
        if memory[SLIP] != 0.0 or _pushes(plant, drive, rate, side) >= 0.0:
            return memory[V], friction, mode, side
    mode, _, friction, _ = _seen_one(_load_side(plant), held_force(0.0), t, scratch)
    return memory[V], friction, mode, 0.0


@internal
def _settle(plant, force, t, memory):
    """Inner states of an axis that has come to rest, or to steady sliding.

    A play is closed on the side of the drive, a spring carries the drive, and an
    elastic contact carries the load up to the friction level.
    """
    kind = plant.integers[STRUCTURE]
    memory[OFFSET], memory[SLIP], memory[DEFLECTION] = 0.0, 0.0, 0.0
    if kind & PLAY:
        memory[OFFSET] = -plant.numbers[HALF_GAP] if force >= 0.0 else plant.numbers[HALF_GAP]
    if kind & SPRING:
        memory[OFFSET] = -force / plant.numbers[STIFFNESS]
    if kind & CONTACT:
        y, v = memory[X] + memory[OFFSET], memory[V]
        w = load(plant, held_force(force), t, 0.0, y, v, 0.0, memory[REST])
        slides = abs(v) > plant.numbers[STICK_SPEED]
        s = math.copysign(1.0, v if slides else w)
        bound = _bound(plant, t, y, v, w, s, 0.0)
        pull = s * bound if slides else s * min(abs(w), bound)
        memory[DEFLECTION] = pull / plant.numbers[CONTACT_STIFFNESS]


@internal(inline="always")
def _advance_structure(plant, drive, t0, h, memory, events, count):
    """Move an axis with inner states, see `advance`."""
    kind = plant.integers[STRUCTURE]
    if kind & PLAY:
        return _advance_play(plant, drive, t0, h, memory, events, count)
    if kind & SPRING:
        return _advance_inner(_load_side(plant), drive, t0, h, memory, events, count)
    return _advance_inner(plant, drive, t0, h, memory, events, count)


@internal(inline="always")
def _outputs_structure(plant, drive, t, memory):
    """Velocity of the motor, friction force and mode of the load."""
    kind = plant.integers[STRUCTURE]
    if kind & PLAY:
        v, friction, mode, _ = _seen_play(plant, drive, t, memory, meeting(plant, memory))
        return v, friction, mode
    two = kind & SPRING != 0
    x, v, mode = memory[X], memory[V], int(memory[MODE])
    side_plant, y, p = plant, x, v
    if two:
        side_plant, y, p = _load_side(plant), x + memory[OFFSET], v + memory[SLIP]
    mode, p, _, friction, _, _ = _begin_inner(
        side_plant, drive, t, x, v, y, p, memory[DEFLECTION], mode, memory[REST]
    )
    return v, friction, mode


def _inner_task(
    task, numbers, integers, start, slope, fade, rate, t0, h, memory, events, count, seen
):
    """Perform a task of an axis with inner states; velocity, friction, mode."""
    plant, drive = Plant(numbers, integers), Drive(start, slope, fade, rate)
    if task == SETTLE:
        _settle(plant, start, t0, memory)
        return
    if task == ADVANCE:
        v, friction, mode = _advance_structure(plant, drive, t0, h, memory, events, count)
    else:
        v, friction, mode = _outputs_structure(plant, drive, t0, memory)
    seen[0], seen[1], seen[2] = v, friction, mode


@functools.cache
def inner_task():
    """Function that moves an axis with inner states, compiled on first use."""
    return cfunc(TASK_CALL, cache=True, error_model="numpy")(_inner_task)
