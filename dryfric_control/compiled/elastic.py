"""Inner states of an axis: elastic contact, play, spring between motor and load.

All of it is called through one address, `inner_task`: it is compiled once, and only if
such an axis is used.
"""

from __future__ import annotations

import functools
import math
from typing import NamedTuple

from numba import cfunc

from dryfric_control.compiled import axis_step as step
from dryfric_control.compiled.cached import njit
from dryfric_control.compiled.roots import illinois_bracket, larger_step, margin_step, secant_point

# Error of the cut at a switch, as a fraction of the error allowed for a step.
_CUT = 0.1
# The same where two masses meet, to which a filter is more sensitive.
_MEETING = 0.01
# Phase of mode 0 in which an elastic contact slides although it springs back, because the level
# falls faster than its force: direction of the deflection times _BACK.
_BACK = 2
# Phase of mode 0 of a contact of bristles that bends: direction of motion times _BENDS.
_BENDS = 3
# Deflection that ends this phase, over the one with which the contact would slide for ever.
_BENT = 0.99
# Half the span of a difference in time, as a fraction of the step.
_SPAN = 1e-3
# Shortest stretch of a step that is looked at for what begins and ends in it, as a fraction of the
# step; of a flight inside a play, as a fraction of the piece.
_FINEST_LOOK = 1.0 / 32.0
# Part of a step that ends where two masses part in which the spring between them may pull.
_PULLED = 1e-3
# Longest piece of a flight inside a play, in times in which its largest acceleration crosses it.
_LONGEST_FLIGHT = 4.0
# What friction may grow to in a flight, as a multiple of the breakaway friction force at its start.
_GROWN = 1.5
# Steps of one interval after which the rest of it is divided by phase alone, not by its error: what
# takes more, as fits try it far from any machine, would never end.
_TRIED = 20_000
# Phase of such a step [rad]: what a step of the method carries without growing.
_CARRIED = 1.0
# And its shortest length, as a fraction of the interval.
_SHORTEST_CARRIED = 1e-4
# Error of a step of bristles, as a fraction of that of a level which is off by as much as it
# deviates in the middle of the step from one that changes linearly.
_BEND = 0.1
# Force of an impact, as a multiple of all others.
_HARD = 1e3


class Masses(NamedTuple):
    """Position and velocity of the motor, and of the load; the same of one mass.

    Where the motor rubs, they change places: the second mass is always the one with friction.
    """

    x: float
    v: float
    y: float
    p: float
    touch: float  # side on which the ends of a gap touch, 0 if they do not


class Strain(NamedTuple):
    """Deflection z of a contact where the load is at y, and the one with which it slides there."""

    y: float
    z: float
    most: float


@step.internal
def _shift_drive(drive, tau):
    """The same drive, its time counted from tau."""
    start = drive.start + drive.slope * tau
    if drive.fade == 0.0:
        return step.Drive(start, drive.slope, 0.0, 0.0)
    return step.Drive(start, drive.slope, drive.fade * math.exp(-drive.rate * tau), drive.rate)


@step.internal(forceinline=True)
def _load_side(plant):
    """The plant with only the mass of the load."""
    return step.Plant(
        step.offset_address(plant.numbers, plant.integers[step.N_NUMBERS]), plant.integers
    )


@step.internal(forceinline=True)
def _has_gap(side):
    """Whether the masses are on a spring with a gap."""
    return side.integers[step.STRUCTURE] & step.SPRING != 0 and side.numbers[step.HALF_GAP] > 0.0


@step.internal(forceinline=True)
def _end_push(plant, s, apart, slip):
    """Force by which the end of a gap on side s pushes, negative where its damper would pull."""
    stretch = s * apart - plant.numbers[step.HALF_GAP]
    return plant.numbers[step.STIFFNESS] * stretch + plant.numbers[step.DAMPING] * (s * slip)


@step.internal(forceinline=True)
def spring_force(plant, apart, slip):
    """Force of the spring between two masses on the one behind, by distance and relative velocity.

    With a gap it begins at its ends, and pushes only.
    """
    if not _has_gap(plant):
        return plant.numbers[step.STIFFNESS] * apart + plant.numbers[step.DAMPING] * slip
    s = math.copysign(1.0, apart)
    touches = s * apart > plant.numbers[step.HALF_GAP]
    return s * max(_end_push(plant, s, apart, slip), 0.0) if touches else 0.0


@step.internal(forceinline=True)
def spring_touches(plant, memory):
    """Whether the spring between two masses acts: always, but for a gap."""
    return abs(memory[step.OFFSET]) >= plant.numbers[step.HALF_GAP]


@step.internal
def _touching(side, at, h):
    """The masses with the side on which the ends of a gap between them touch from now on.

    Or next to at once, in an interval of that length.
    """
    apart, slip = at.x - at.y, at.v - at.p
    s = math.copysign(1.0, apart)
    if s * slip > 0.0:
        # No step ends at a meeting that is so near.
        touches = s * (apart + step.SAME_END * h * slip) > side.numbers[step.HALF_GAP]
    else:
        touches = _end_push(side, s, apart, slip) > 0.0
    return Masses(at.x, at.v, at.y, at.p, s if touches else 0.0)


@step.internal(forceinline=True)
def _transmission_force(side, drive, tau, at):
    """Force on the mass with friction: of the spring between two masses, of the drive, or both."""
    kind, force = side.integers[step.STRUCTURE], 0.0
    if kind & step.SPRING:
        half, damping = side.numbers[step.HALF_GAP], side.numbers[step.DAMPING]
        if half == 0.0 or at.touch != 0.0:
            stretch = at.x - at.y - at.touch * half
            force = side.numbers[step.STIFFNESS] * stretch + damping * (at.v - at.p)
    if not kind & step.SPRING or kind & step.MOTOR_RUBS:
        force += step.drive_force(drive, tau)
    return force


@step.internal(forceinline=True)
def _bristles(side):
    """Whether the axis is on an elastic contact of bristles."""
    return side.integers[step.STRUCTURE] & step.CONTACT != 0 and side.numbers[step.BRISTLES] != 0.0


@njit(cache=True, error_model="numpy", forceinline=True)
def _mean_fall(x):
    """Mean of exp(-x) from 0 to x."""
    if abs(x) > 1e-2:
        return -math.expm1(-x) / x
    return 1.0 - x * (0.5 - x * (1.0 / 6.0 - x * (1.0 / 24.0 - x / 120.0)))


@step.internal
def _bristle_deflection(way, start, before, most):
    """Deflection of bristles along a motion after a way; they slid at `before`, at `most` now."""
    # z' = 1 - z/limit over the way, exact for a limit that changes linearly along it.
    change = (most - before) / before
    mean = 1.0 - change * (0.5 - change * (1.0 / 3.0 - 0.25 * change))
    if abs(change) > 1e-3:
        mean = math.log(most / before) / change
    phi = way / before * mean
    return start * math.exp(-phi) + most * phi * _mean_fall(phi + mean * change)


@step.internal(forceinline=True)
def _direction(mode):
    """Direction of motion in a phase."""
    return 1.0 if mode > 0 else -1.0


@step.internal(forceinline=True)
def _stuck_deflection(strain, y):
    """Deflection of a contact that does not slide, where the load is at y."""
    return y - strain.y + strain.z


@step.internal(forceinline=True)
def _deflection(side, drive, t0, tau, at, strain, mode, rest):
    """Deflection of a contact in a phase, and the one with which bristles slide."""
    if not _bristles(side):
        return _stuck_deflection(strain, at.y), math.inf
    s = _direction(mode)
    most = _sliding_deflection(side, drive, t0, tau, at, s, rest)
    z = most
    if most > 0.0 and strain.most > 0.0:
        z = _bristle_deflection(s * (at.y - strain.y), s * strain.z, strain.most, most)
    z *= s
    return z, most


@step.internal(forceinline=True)
def _contact_force(side, z, most, p):
    """Force of an elastic contact at deflection z and velocity p."""
    numbers, rate = side.numbers, p
    force = numbers[step.CONTACT_STIFFNESS] * z
    if numbers[step.STICK_RATE] == 0.0:
        return force
    # Bristles that slide at a constant deflection are not damped.
    if most < math.inf:
        rate = p - abs(p) * z / most if most > 0.0 else 0.0
    return force + numbers[step.STICK_RATE] / numbers[step.INVERSE_MASS] * rate


@step.internal
def _bound(side, t, y, p, w, s, rest):
    """Friction that an elastic contact can carry in direction s at velocity p."""
    return step.peaked_level(side, t, y, p, s * abs(p), w, step.base_level(side, y, s), s, rest)


@step.internal
def _rates(side, drive, t0, tau, at, strain, mode, rest):
    """Accelerations of motor and load in a phase: a mode, or a direction by _BACK or _BENDS."""
    force = _transmission_force(side, drive, tau, at)
    motor = 0.0
    if side.integers[step.STRUCTURE] & step.SPRING:
        motor = (step.drive_force(drive, tau) - force) * side.numbers[step.INVERSE_MOTOR]
    s, t, contact = float(mode), t0 + tau, side.integers[step.STRUCTURE] & step.CONTACT
    if mode == 0 and not contact:
        return motor, -side.numbers[step.STICK_RATE] * at.p
    w = step.load_under(side, force, t, at.y, at.p, s if abs(mode) == 1 else 0.0, rest)
    if contact and (mode == 0 or _bristles(side)):
        z, most = _deflection(side, drive, t0, tau, at, strain, mode, rest)
        friction = _contact_force(side, z, most, at.p)
    elif abs(mode) == _BACK:
        s /= _BACK
        friction = s * _bound(side, t, at.y, at.p, w, s, rest)
    else:
        friction = s * step.sliding_level(side, t, at.y, at.p, w, s)
    return motor, step.acceleration(side, w, at.p, friction)


@njit(cache=True, error_model="numpy", forceinline=True)
def _wave_error(k1, k2, k3, k4, phi, d):
    """Velocity error of one step of an oscillation whose phase advances by phi in it."""
    # An acceleration A cos causes the error d A phi^4/120; A phi is the first difference of the
    # stages, A phi^2/4 the second.
    return d * phi * phi * (phi * abs(k4 - k1) + 4.0 * abs((k1 - k2) - (k3 - k4))) / 120.0


@step.internal(forceinline=True)
def _phase_rate(side, mode):
    """Rate at which contact and spring swing or decay in a phase [1/s]."""
    numbers, turn = side.numbers, 0.0
    if mode == 0 or _bristles(side):
        turn = numbers[step.STICK_RATE]
        if side.integers[step.STRUCTURE] & step.CONTACT:
            turn += math.sqrt(numbers[step.CONTACT_STIFFNESS] * numbers[step.INVERSE_MASS])
    if side.integers[step.STRUCTURE] & step.SPRING:
        inverse = numbers[step.INVERSE_MOTOR] + numbers[step.INVERSE_MASS]
        turn += math.sqrt(numbers[step.STIFFNESS] * inverse) + numbers[step.DAMPING] * inverse
    return turn


@step.internal(forceinline=True)
def _level_can_fall(side):
    """Whether the level can fall while an elastic contact is strained."""
    i = side.integers
    return i[step.STRUCTURE] & step.CONTACT != 0 and (
        side.numbers[step.EXCESS] > 0.0 or i[step.N_LEVEL] + i[step.N_PLUS] + i[step.N_MINUS] > 2
    )


@step.internal
def _bent_after(side, drive, t0, tau, at, strain, mode, rest, middle, after, d):
    """Strain of bristles after a step of length d, its error as that of the step's velocity."""
    s, half = _direction(mode), 0.5 * d
    waited = 0.0 if abs(mode) == 1 else half
    z, most = _deflection(side, drive, t0, tau + d, after, strain, mode, rest + 2.0 * waited)
    if not _level_can_fall(side) or not most > 0.0:
        return Strain(after.y, z, most), 0.0
    # The level is taken to change linearly along the way, and bends by `bow` in its middle.
    between = _sliding_deflection(side, drive, t0, tau + half, middle, s, rest + waited)
    way, part = s * (after.y - at.y), 0.5
    if way > 0.0:
        part = min(max(s * (middle.y - at.y) / way, 0.25), 0.75)
    bow = (between - strain.most - part * (most - strain.most)) / (4.0 * part * (1.0 - part))
    ratio = abs(way) / most
    bent = abs(bow) * min(abs(z), most) / (most * (1.0 + ratio))
    rise = side.numbers[step.CONTACT_STIFFNESS] * side.numbers[step.INVERSE_MASS]
    error = _BEND * d * bent * rise
    exact = side.numbers[step.ALLOWED] == 0.0
    if exact and way > 0.0 and between > 0.0 and strain.most > 0.0:
        # z' = 1 - z/limit with a parabola added to the limit, to first order.
        weight = ratio / (1.0 + ratio * (0.5 + ratio / 6.0)) / 1.5
        z += weight * bow * 0.5 * (strain.z + z) / between
    return Strain(after.y, z, most), error


@step.internal
def _stride(side, drive, t0, tau, at, strain, mode, rest, m1, k1, d):
    """One step of motor and load: states, last stages, the strain after it, the step's error."""
    half, t = 0.5 * d, tau + 0.5 * d
    waited = 0.0 if abs(mode) == 1 else half
    soon, late = rest + waited, rest + 2.0 * waited
    x, v, y, p = at.x, at.v, at.y, at.p
    xm, ym = x + half * (v + 0.25 * d * m1), y + half * (p + 0.25 * d * k1)
    touch = at.touch
    middle = Masses(xm, v + half * m1, ym, p + half * k1, touch)
    m2, k2 = _rates(side, drive, t0, t, middle, strain, mode, soon)
    middle = Masses(xm, v + half * m2, ym, p + half * k2, touch)
    m3, k3 = _rates(side, drive, t0, t, middle, strain, mode, soon)
    end = Masses(x + d * (v + half * m3), v + d * m3, y + d * (p + half * k3), p + d * k3, touch)
    m4, k4 = _rates(side, drive, t0, tau + d, end, strain, mode, late)
    after = Masses(
        x + d * (v + d * (m1 + m2 + m3) / 6.0),
        v + d * (m1 + 2.0 * (m2 + m3) + m4) / 6.0,
        y + d * (p + d * (k1 + k2 + k3) / 6.0),
        p + d * (k1 + 2.0 * (k2 + k3) + k4) / 6.0,
        touch,
    )
    numbers, turn = side.numbers, _phase_rate(side, mode)
    error = 0.0
    if side.integers[step.STRUCTURE] & step.SPRING:
        error = _wave_error(m1, m2, m3, m4, d * turn, d)
    error = max(error, _wave_error(k1, k2, k3, k4, d * turn, d))
    # Position-dependent forces: the elastic force represents their size; their passage
    # through zero is left to the wave error (distance infinite).  The allowed error is
    # 0 here, so that the estimate is not shortened to zero.
    held = numbers[step.CONTACT_STIFFNESS] * abs(_stuck_deflection(strain, y))
    pull = numbers[step.INVERSE_MASS] * (abs(_transmission_force(side, drive, tau, at)) + held)
    error = max(error, step.step_error(side, drive, k1, k2, k3, k4, pull, math.inf, d, 0.0))
    if mode != 0:
        error = max(error, step.peak_error(side, y, p, after.p, _direction(mode), k1, k4, d))
    if _bristles(side):
        strain, bent = _bent_after(side, drive, t0, tau, at, strain, mode, rest, middle, after, d)
        error = max(error, bent)
    return after, m4, k4, strain, error


@step.internal(forceinline=True)
def _open(phase):
    """Mode of a phase."""
    return phase if abs(phase) == 1 else 0


@step.internal
def _sliding_deflection(side, drive, t0, tau, at, s, rest):
    """Deflection in direction s at which an elastic contact slides, a magnitude."""
    t = t0 + tau
    w = step.load_under(side, _transmission_force(side, drive, tau, at), t, at.y, at.p, 0.0, rest)
    return _bound(side, t, at.y, at.p, w, s, rest) / side.numbers[step.CONTACT_STIFFNESS]


@step.internal
def _slip_approach_rate(side, drive, t0, tau, at, m, k, s, rest, d):
    """Rate at which a deflection in direction s nears the limit at which it slides."""
    x, v, y, p, span = at.x, at.v, at.y, at.p, _SPAN * d
    then = Masses(x + span * v, v + span * m, y + span * p, p + span * k, at.touch)
    before = Masses(x - span * v, v - span * m, y - span * p, p - span * k, at.touch)
    later = _sliding_deflection(side, drive, t0, tau + span, then, s, rest)
    earlier = _sliding_deflection(side, drive, t0, tau - span, before, s, rest)
    return s * p - (later - earlier) / (2.0 * span)


@step.internal
def _margin(side, drive, t0, tau, at, strain, mode, rest, flips, length):
    """Distance from the end of a phase, inside a step of that `length`: positive until then."""
    s, t, p = float(mode), t0 + tau, at.p
    if abs(mode) == _BENDS:
        z, most = _deflection(side, drive, t0, tau, at, strain, mode, rest)
        s /= _BENDS
        return min(s * p * length, _BENT * most - s * z) if p != 0.0 else _BENT * most - s * z
    if side.integers[step.STRUCTURE] & step.CONTACT:
        if abs(mode) == 1:
            return s * p
        if mode != 0:
            s /= _BACK
            if s * p > 0.0:
                return -s * p
            m, k = _rates(side, drive, t0, tau, at, strain, mode, rest)
            return _slip_approach_rate(side, drive, t0, tau, at, m, k, s, rest, length)
        held = _stuck_deflection(strain, at.y)
        s = 1.0 if held > 0.0 else -1.0
        return _sliding_deflection(side, drive, t0, tau, at, s, rest) - s * held
    if mode != 0:
        if s * p > side.numbers[step.STICK_SPEED]:
            return math.inf
        if s * p <= 0.0 and (side.integers[step.RULE] == step.FILIPPOV or flips == 0):
            return s * p
    felt = step.held_force(_transmission_force(side, drive, tau, at))
    if mode == 0:
        excess = step.hold_excess(side, felt, t, 0.0, at.y, p, rest)[0]
        # A load that equals the level holds; how far it is from its end, no number says.
        return -excess if excess != 0.0 else math.inf
    # As a velocity, like the margin beyond the reversal: a search sees both.
    excess = step.band_excess(side, felt, t, 0.0, at.y, p, s)
    return length * side.numbers[step.INVERSE_MASS] * excess


@step.internal
def _begin_inner(side, drive, t0, at, z, mode, rest):
    """Mode, velocity and deflection of the load, friction force, accelerations."""
    y, p = at.y, at.p
    force = _transmission_force(side, drive, 0.0, at)
    w = step.load_under(side, force, t0, y, p, float(mode), rest)
    contact = side.integers[step.STRUCTURE] & step.CONTACT != 0
    if not contact:
        mode, p = step.resolve(side, t0, y, p, mode, rest, w)
        z, friction = 0.0, w
    else:
        stiffness = side.numbers[step.CONTACT_STIFFNESS]
        if mode != 0 and mode * p <= 0.0:
            mode = 0
        if mode == 0 and not _bristles(side):
            s = 1.0 if z > 0.0 else -1.0
            bound = _bound(side, t0, y, p, w, s, rest)
            # Start no elastic phase because of round-off in a contact that already slides.
            if s * stiffness * z >= bound * (1.0 - 1e-12):
                z = s * bound / stiffness
                mode = int(s) if s * p > 0.0 else 0
        friction = _contact_force(side, z, math.inf, p)
    now = Masses(at.x, at.v, y, p, at.touch)
    if contact and _bristles(side):
        strain, phase = _bristle_phase(side, drive, t0, 0.0, now, z, mode, rest)
        mode, friction = _open(phase), _contact_force(side, z, strain.most, p)
    else:
        strain, phase = Strain(y, z, 0.0), mode
        if mode != 0:
            friction = step.sliding_friction(side, force, t0, y, p, float(mode))
    motor, rate = _rates(side, drive, t0, 0.0, now, strain, phase, rest)
    return mode, p, z, friction, motor, rate


@step.internal
def _bristle_phase(side, drive, t0, tau, at, z, mode, rest):
    """Strain of bristles deflected by z, and their phase: the mode, or the direction of motion."""
    s = float(mode)
    if mode == 0:
        s = math.copysign(1.0, at.p)
        if at.p == 0.0:
            force = _transmission_force(side, drive, tau, at)
            w = step.load_under(side, force, t0 + tau, at.y, 0.0, 0.0, rest)
            s = math.copysign(1.0, w - side.numbers[step.CONTACT_STIFFNESS] * z)
    most = _sliding_deflection(side, drive, t0, tau, at, s, rest)
    bends = mode == 0 and (at.p == 0.0 or s * z < _BENT * most)
    return Strain(at.y, z, most), int(s) * _BENDS if bends else int(s)


@step.internal
def _slides_back(side, drive, t0, at, z, rest, h):
    """Whether a contact of deflection z slides although it springs back: its limit falls faster."""
    s = math.copysign(1.0, z)
    if s * z < _sliding_deflection(side, drive, t0, 0.0, at, s, rest) * (1.0 - 1e-12):
        return False
    d = min(h, side.numbers[step.SHORT_TIME])
    m, k = _rates(side, drive, t0, 0.0, at, Strain(at.y, z, 0.0), int(s) * _BACK, rest)
    return _slip_approach_rate(side, drive, t0, 0.0, at, m, k, s, rest, d) > 0.0


@step.internal
def _kinked(side, drive, t0, tau, at, after, mode, rest, d):
    """Length of a step that ends where a force bends, see `step.kink_step`."""
    s, t = float(mode) if abs(mode) == 1 else 0.0, t0 + tau
    felt, then = (
        _transmission_force(side, drive, tau, at),
        _transmission_force(side, drive, tau + d, after),
    )
    w = step.load_under(side, felt, t, at.y, at.p, s, rest)
    w1 = step.load_under(side, then, t + d, after.y, after.p, s, rest)
    return step.kink_step(side, t, at.y, at.p, w, after.y, after.p, w1, s, rest, d)


@step.internal(forceinline=True)
def _load_step(side, drive, t0, tau, at, after, mode, rest, fades, k1, k4, d, error, allowed):
    """Length of the step to try instead of one of length d of the load; d if it may stay."""
    cut = step.accurate_step(side, after.y - at.y, error, allowed, d)
    if cut == d and (mode != 0 or fades):
        sight = step.peak_step(side, abs(at.p), abs(after.p), 1.0, d)
        if sight < 0.99 * d:
            return sight
    if cut == d and mode != 0 and abs(mode) != _BACK:
        cut = step.reversal_step(at.p, after.p, _direction(mode), k1, k4, d, 0.0)
    if cut == d and step.has_kinks(side):
        cut = _kinked(side, drive, t0, tau, at, after, mode, rest, d)
    if cut == d and _has_gap(side):
        cut = _meeting_step(side, at, after, d)
    return cut


@step.internal
def _meeting_step(side, at, after, d):
    """Length of a step that ends where two masses on a spring with a gap meet or part."""
    half, s = side.numbers[step.HALF_GAP], at.touch
    apart, left = at.x - at.y, after.x - after.y
    slip, later = at.v - at.p, after.v - after.p
    if s == 0.0:
        cut = step.edge_step(apart - half, slip, left - half, later, d, d)
        return step.edge_step(apart + half, slip, left + half, later, d, cut)
    # Where a damper would pull, they part before the spring is unstrained.
    pushes = _end_push(side, s, apart, slip)
    pulls = -_end_push(side, s, left, later)
    if pushes < 0.0 or pulls <= 0.0:
        return d
    # A little later, so that they have parted then.
    part = (1.0 + _PULLED) * pushes / (pushes + pulls) + _PULLED
    return part * d if part < 1.0 - _PULLED else d


@step.internal
def _margin_rate(side, drive, at, end, m1, k1, m4, k4, d):
    """Largest rate of the distance from the end of mode 0 inside a step, see `_margin`."""
    most = max(abs(k1), abs(k4)) + abs(k4 - k1)
    speed = max(abs(at.p), abs(end.p)) + 0.5 * most * d
    kind, changing = side.integers[step.STRUCTURE], 0.0
    if kind & step.SPRING:
        motor = max(abs(m1), abs(m4)) + abs(m4 - m1)
        slip = max(abs(at.v - at.p), abs(end.v - end.p)) + 0.5 * (motor + most) * d
        changing = side.numbers[step.STIFFNESS] * slip + side.numbers[step.DAMPING] * (motor + most)
    if not kind & step.SPRING or kind & step.MOTOR_RUBS:
        changing += step.drive_rate(drive)
    loads, levels = step.hold_rate(side, changing, at.y, speed, most)
    if kind & step.CONTACT:
        return speed + levels / side.numbers[step.CONTACT_STIFFNESS]
    return loads + levels


@step.internal
def _margin_within(side, drive, t0, tau, at, strain, mode, rest, m1, k1, flips, c, d):
    """Distance from the end of a phase after a part c of a step of length d."""
    then, _, _, _, _ = _stride(side, drive, t0, tau, at, strain, mode, rest, m1, k1, c)
    now = rest + c if abs(mode) != 1 else 0.0
    return _margin(side, drive, t0, tau + c, then, strain, mode, now, flips, d)


@step.internal
def _first_end(side, drive, t0, tau, at, strain, mode, rest, m1, k1, flips, d, start, left, rate):
    """First part of a step in which the phase ends, and the distance then; d if it does not."""
    # The distance is `start` at the beginning, `left` at the end, and changes at most at `rate`.
    finest = _FINEST_LOOK * d
    a, length = 0.0, d
    while a < d:
        b, fb = d, left
        if length < d - a:
            b = a + length
            fb = _margin_within(side, drive, t0, tau, at, strain, mode, rest, m1, k1, flips, b, d)
        if fb <= 0.0:
            return b, fb
        sure = start + fb >= rate * (b - a)
        if not sure and b - a > 1.01 * finest:
            length = margin_step(b - a, start, rate, finest)
            continue
        if not sure:
            c = 0.5 * (a + b)
            fc = _margin_within(side, drive, t0, tau, at, strain, mode, rest, m1, k1, flips, c, d)
            if fc <= 0.0:
                return c, fc
        length, a, start = max(2.0 * (b - a), finest), b, fb
    return d, left


@step.internal
def _phase_end(side, drive, t0, tau, at, strain, mode, rest, m1, k1, flips, d, left, exact):
    """Length of the part of a step of length d that ends with the phase, by repeating the step."""
    a, b, fb, last = 0.0, d, left, 0
    fa = _margin(side, drive, t0, tau, at, strain, mode, rest, flips, d)
    for i in range(200):
        c = secant_point(a, fa, b, fb)
        if b - a <= exact or fb == 0.0 or c == b:
            break
        # The margin may jump: bisect every fourth time, or where it is not known.
        if i % 4 == 3 or fa == math.inf:
            c = 0.5 * (a + b)
        fc = _margin_within(side, drive, t0, tau, at, strain, mode, rest, m1, k1, flips, c, d)
        a, fa, b, fb, last = illinois_bracket(a, fa, b, fb, last, c, fc)
    return b


@step.internal(forceinline=True)
def _back_strain(side, drive, t0, tau, at, mode, rest):
    """Strain of a contact in a phase in which it slides although it springs back."""
    s = float(mode) / _BACK
    return Strain(at.y, s * _sliding_deflection(side, drive, t0, tau, at, s, rest), 0.0)


@step.internal
def _phase_after(side, drive, t0, tau, at, strain, mode, rest, flips, moved):
    """Phase after another, velocity of the load, strain; `moved`: whether the step has a length."""
    s, t, y, p = float(mode), t0 + tau, at.y, at.p
    force = _transmission_force(side, drive, tau, at)
    if _bristles(side):
        s = _direction(mode)
        if abs(mode) == _BENDS and s * p > 0.0:
            return int(s), p, strain
        p = 0.0 if abs(mode) == 1 else p
        now = Masses(at.x, at.v, y, p, at.touch)
        strain, mode = _bristle_phase(side, drive, t0, tau, now, strain.z, 0, rest)
        return mode, p, strain
    if side.integers[step.STRUCTURE] & step.CONTACT:
        if abs(mode) == _BACK:
            s /= _BACK
            strain = _back_strain(side, drive, t0, tau, at, mode, rest)
            return (int(s) if s * p > 0.0 else 0), p, strain
        if mode == 0:
            s = 1.0 if _stuck_deflection(strain, y) > 0.0 else -1.0
            return int(s if s * p > 0.0 else s * _BACK), p, strain
        w = step.load_under(side, force, t, y, 0.0, s, 0.0)
        level = step.sliding_level(side, t, y, 0.0, w, s)
        return 0, 0.0, Strain(y, s * level / side.numbers[step.CONTACT_STIFFNESS], 0.0)
    if mode == 0:
        s = step.hold_excess(side, step.held_force(force), t, 0.0, y, p, rest)[1]
        return int(s), (0.0 if s * p < 0.0 else p), strain
    if s * p > 0.0 or (side.integers[step.RULE] == step.PAPER and flips > 0):
        return 0, p, strain
    if side.integers[step.RULE] == step.PAPER:
        return -mode, 0.0, strain
    force = _transmission_force(side, drive, tau, Masses(at.x, at.v, y, 0.0, at.touch))
    w = step.load_under(side, force, t, y, 0.0, s, 0.0)
    after = step.at_zero(side, t, y, w, mode)
    # Where load and level are equal up to round-off, it rests.
    return (after if moved or after != mode else 0), 0.0, strain


@step.internal(forceinline=True)
def _masses(memory, two, rubs):
    """The masses as memory has them; those of one mass are alike."""
    x, v = memory[step.X], memory[step.V]
    if not two:
        return Masses(x, v, x, v, 0.0)
    y, p = x + memory[step.OFFSET], v + memory[step.SLIP]
    return Masses(y, p, x, v, 0.0) if rubs else Masses(x, v, y, p, 0.0)


@step.internal
def _first_phase(side, drive, t0, at, z, mode, rest, h):
    """Strain of the contact and phase at the start of an interval."""
    if _bristles(side):
        return _bristle_phase(side, drive, t0, 0.0, at, z, mode, rest)
    if mode == 0 and _level_can_fall(side) and z * at.p <= 0.0:
        if _slides_back(side, drive, t0, at, z, rest, h):
            mode = int(math.copysign(_BACK, z))
    return Strain(at.y, z, 0.0), mode


@step.internal(forceinline=True)
def _velocity_scale(side, at, m1, k1, d):
    """Velocity that the error of a step is relative to."""
    scale = abs(at.p) + side.numbers[step.STICK_SPEED] + d * abs(k1)
    if side.integers[step.STRUCTURE] & step.SPRING:
        scale += abs(at.v) + d * abs(m1)
    return scale


@step.internal
def _stable_step(side, at, strain, mode, k1):
    """Longest step that an elastic part carries without growing [s]."""
    turn = _phase_rate(side, mode)
    d = _CARRIED / turn if turn > 0.0 else math.inf
    if _bristles(side) and abs(at.p) <= 2.0 * d * abs(k1):
        # Bristles that a trial step bends back grow exponentially along the way.
        d = min(d, math.sqrt(strain.most / abs(k1)))
    return d


@step.internal
def _store(side, drive, t0, h, at, strain, mode, rest, memory):
    """Put the state at the end of an interval into memory."""
    kind, p = side.integers[step.STRUCTURE], at.p
    if kind & step.CONTACT:
        z = _stuck_deflection(strain, at.y)
        if _bristles(side):
            z = strain.z
        elif abs(mode) == 1:
            force = _transmission_force(side, drive, h, at)
            z = step.sliding_friction(side, force, t0 + h, at.y, p, float(mode))
            z /= side.numbers[step.CONTACT_STIFFNESS]
        memory[step.DEFLECTION] = z
    elif mode == 0 and abs(p) < 1e-9 * side.numbers[step.STICK_SPEED]:
        p = 0.0
    memory[step.X], memory[step.V] = at.y, p
    if kind & step.MOTOR_RUBS:
        memory[step.OFFSET], memory[step.SLIP] = at.x - at.y, at.v - p
    elif kind & step.SPRING:
        memory[step.X], memory[step.V] = at.x, at.v
        memory[step.OFFSET], memory[step.SLIP] = at.y - at.x, p - at.v
    memory[step.MODE], memory[step.REST] = _open(mode), rest


@step.internal
def _advance_inner(side, drive, t0, h, memory, events, count):
    """Move one mass on an elastic contact, or two on a spring; `side`: with the one that rubs."""
    kind = side.integers[step.STRUCTURE]
    two, rubs = kind & step.SPRING != 0, kind & step.MOTOR_RUBS != 0
    before, rest, at = int(memory[step.MODE]), memory[step.REST], _masses(memory, two, rubs)
    if not abs(at.y) < math.inf:  # as it is left by a motion that no step follows
        return at.v, 0.0, before
    gaps = _has_gap(side)
    if gaps:
        at = _touching(side, at, h)
    first, p, z, friction, m1, k1 = _begin_inner(
        side, drive, t0, at, memory[step.DEFLECTION], before, rest
    )
    at = Masses(at.x, at.v, at.y, p, at.touch)
    if first != before:
        step.record(events, count, t0, before, first)
        rest = 0.0
    seen = at.v if two and not rubs else p
    strain, mode = _first_phase(side, drive, t0, at, z, first, rest, h)
    fades = _level_can_fall(side)
    if mode != first:
        m1, k1 = _rates(side, drive, t0, 0.0, at, strain, mode, rest)
    # Distance from the end of mode 0.
    gap = 0.0
    if mode == 0:
        gap = _margin(side, drive, t0, 0.0, at, strain, mode, rest, 0, h)
    tau, longest, switches, flips, tries, fresh = 0.0, h, 0, 0, 0, False
    close, pause, resume, last = 0, step.CLOSE * h, 0.0, -h
    while tau < h:
        if fresh:
            touched = at.touch
            at = _touching(side, at, h) if gaps else at
            if at.touch != touched and mode == 0:
                gap = max(_margin(side, drive, t0, tau, at, strain, mode, rest, flips, h), 0.0)
            m1, k1 = _rates(side, drive, t0, tau, at, strain, mode, rest)
            fresh = False
        # The mode is held until `resume`, see `switching_pause`.
        bound = h if tau >= resume else min(resume, h)
        d = min(longest, bound - tau, side.numbers[step.SHORT_TIME])
        tries += 1
        if tries >= 2 * _TRIED:
            # A motion that no such step follows is refused by those who read it.
            at = Masses(math.inf, math.inf, math.inf, math.inf, 0.0)
            break
        if tries >= _TRIED:
            longest = h
            d = min(
                bound - tau, max(_stable_step(side, at, strain, mode, k1), _SHORTEST_CARRIED * h)
            )
        end, m4, k4, bent, error = _stride(side, drive, t0, tau, at, strain, mode, rest, m1, k1, d)
        scale = _velocity_scale(side, at, m1, k1, d)
        allowed = step.TOLERANCE * scale + side.numbers[step.ALLOWED]
        if d > step.SHORTEST * h and tries < _TRIED:
            cut = _load_step(
                side, drive, t0, tau, at, end, mode, rest, fades, k1, k4, d, error, allowed
            )
            if cut < d:
                longest = cut
                continue
        end_rest = rest + d if abs(mode) != 1 else 0.0
        part, left = d, math.inf
        if tau >= resume and switches < count[step.MOST]:
            left = _margin(side, drive, t0, tau + d, end, strain, mode, end_rest, flips, d)
            if mode == 0:
                rate = _margin_rate(side, drive, at, end, m1, k1, m4, k4, d)
                part, left = _first_end(
                    side, drive, t0, tau, at, strain, mode, rest, m1, k1, flips, d, gap, left, rate
                )
        if left > 0.0:
            at, rest, gap, fresh = end, end_rest, left, True
            tau += d
            strain = bent
            if abs(mode) == _BACK:
                strain = _back_strain(side, drive, t0, tau, at, mode, rest)
            if tau + step.SHORTEST * h >= h:
                tau = h
            if longest < h:
                longest = larger_step(d, allowed, error)
            continue

        exact = (1e-14 + _CUT * side.numbers[step.ALLOWED] / scale) * part
        cut = _phase_end(
            side, drive, t0, tau, at, strain, mode, rest, m1, k1, flips, part, left, exact
        )
        at, _, _, strain, _ = _stride(side, drive, t0, tau, at, strain, mode, rest, m1, k1, cut)
        tau += cut
        if tau + step.SHORTEST * h >= h:
            tau = h
        fresh, longest = True, h
        if abs(mode) != 1:
            rest += cut
        after, p, strain = _phase_after(
            side, drive, t0, tau, at, strain, mode, rest, flips, cut > 2e-14 * part
        )
        at = Masses(at.x, at.v, at.y, p, at.touch)
        if mode != 0 and after == -mode:
            flips += 1
        if after != mode:
            switches += 1
            if abs(mode) == 1 or abs(after) == 1:
                step.record(events, count, t0 + tau, _open(mode), _open(after), switches)
                rest = 0.0
            mode = after
            close, pause, resume = step.switching_pause(tau, last, h, close, pause)
            last = tau
        gap = 0.0
        if mode == 0:
            gap = max(_margin(side, drive, t0, tau, at, strain, mode, rest, flips, h), 0.0)

    _store(side, drive, t0, h, at, strain, mode, rest, memory)
    return seen, friction, first


@step.internal
def _advance_one(plant, drive, t0, h, memory, events, count):
    """Move one mass, on an elastic contact or not."""
    if plant.integers[step.STRUCTURE] & step.CONTACT:
        return _advance_inner(plant, drive, t0, h, memory, events, count)
    return step.perform_task(
        plant, step.RIGID_TASK, step.ADVANCE, drive, t0, h, memory, events, count
    )


@step.internal
def _free(plant, drive, memory, tau):
    """Distance and velocity after tau of the mass without friction, alone: exact."""
    v = memory[step.V]
    if _motor_has_friction(plant):
        v += memory[step.SLIP]
        return v * tau, v
    inverse = plant.numbers[step.INVERSE_MOTOR]
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


@step.internal(forceinline=True)
def _motor_has_friction(plant):
    """Whether friction and forces act on the motor, not on the load."""
    return plant.integers[step.STRUCTURE] & step.MOTOR_RUBS != 0


@step.internal
def _state_of_one(plant, memory, scratch):
    """Copy the state of the mass with friction, as a single mass, into `scratch`."""
    scratch[step.X], scratch[step.V] = memory[step.X], memory[step.V]
    if not _motor_has_friction(plant):
        scratch[step.X] += memory[step.OFFSET]
        scratch[step.V] += memory[step.SLIP]
    scratch[step.MODE], scratch[step.REST] = memory[step.MODE], memory[step.REST]
    scratch[step.DEFLECTION] = memory[step.DEFLECTION]


@step.internal
def _seen_one(plant, drive, t, state):
    """Mode, velocity, friction force and acceleration of one mass at the start."""
    mode, rest, at = int(state[step.MODE]), state[step.REST], _masses(state, False, False)
    if plant.integers[step.STRUCTURE] & step.CONTACT:
        z = state[step.DEFLECTION]
        mode, p, _, friction, _, rate = _begin_inner(plant, drive, t, at, z, mode, rest)
        return mode, p, friction, rate
    mode, p, friction, rate = step.begin(plant, drive, t, at.x, at.v, mode, rest)
    if mode == 0:
        rate = -plant.numbers[step.STICK_RATE] * p
    return mode, p, friction, rate


@step.internal(forceinline=True)
def _pushes(plant, drive, rate, side):
    """Force between motor and load, in contact at `side`, of an acceleration `rate`."""
    inertia = rate / plant.numbers[step.INVERSE_MOTOR]
    return side * (
        inertia if _motor_has_friction(plant) else step.drive_force(drive, 0.0) - inertia
    )


@step.internal
def _push(plant, drive, t, state, side):
    """Contact force as in `_pushes`, for one mass in a given state."""
    return _pushes(plant, drive, _seen_one(plant, drive, t, state)[3], side)


@step.internal
def contact_side(plant, memory):
    """Side on which motor and load touch without moving apart, 0 for none."""
    half = plant.numbers[step.HALF_GAP]
    if abs(memory[step.OFFSET]) < half * (1.0 - 1e-12):
        return 0.0
    side = 1.0 if memory[step.OFFSET] < 0.0 else -1.0
    return side if side * memory[step.SLIP] <= 0.0 else 0.0


@step.internal
def _impulse_loss(plant, t, y, v, side):
    """Part of the impulse of an impact that friction takes from the load: its slope over force."""
    load_side, s = _load_side(plant), math.copysign(1.0, v)
    others = abs(step.load_under(load_side, 0.0, t, y, v, s, 0.0))
    size = step.base_level(plant, y, s) + others
    force = side * (_HARD * size if size > 0.0 else 1.0)
    w = step.load_under(load_side, force, t, y, v, s, 0.0)
    level = step.sliding_level(load_side, t, y, v, w, s)
    w = step.load_under(load_side, 0.5 * force, t, y, v, s, 0.0)
    return s * side * (level - step.sliding_level(load_side, t, y, v, w, s)) / (0.5 * abs(force))


@step.internal
def _common_velocity(plant, t, y, v, p, side):
    """Common velocity after a plastic impact of the free mass (v) and the other one (p, at y)."""
    # Momentum is conserved but for what friction takes that depends on the load.
    free = plant.numbers[step.INVERSE_MASS] / plant.numbers[step.INVERSE_MOTOR]
    rest = 1.0 - free
    momentum = free * v + rest * p
    if plant.numbers[step.BEHIND] != 1.0 and momentum != 0.0:
        free *= 1.0 - _impulse_loss(plant, t, y, momentum, side)
    return (free * v + rest * p) / (free + rest)


@step.internal
def _plastic_impact(plant, t, memory, scratch, side):
    """Plastic impact at the end of the play; `scratch`: state of the mass with friction."""
    v = memory[step.V] + (memory[step.SLIP] if _motor_has_friction(plant) else 0.0)
    memory[step.OFFSET] = -side * plant.numbers[step.HALF_GAP]
    memory[step.V] = _common_velocity(plant, t, scratch[step.X], v, scratch[step.V], side)
    memory[step.SLIP] = 0.0


@step.internal
def _move_one_mass(plant, drive, t, d, memory, side, scratch, events, count):
    """Move motor and load as one mass over d; the contact force at the end."""
    _state_of_one(plant, memory, scratch)
    _advance_one(plant, drive, t, d, scratch, events, count)
    return _push(plant, _shift_drive(drive, d), t + d, scratch, side)


@step.internal
def _move_two_masses(plant, drive, t, d, memory, scratch, events, count):
    """Move motor and load without contact over d; the motor's lead at the end."""
    _state_of_one(plant, memory, scratch)
    start, rubs = scratch[step.X], _motor_has_friction(plant)
    felt = drive if rubs else step.held_force(0.0)
    _advance_one(_load_side(plant), felt, t, d, scratch, events, count)
    # Computed from differences, as the gap is small compared with the position.
    lead = _free(plant, drive, memory, d)[0] - (scratch[step.X] - start)
    return (-lead if rubs else lead) - memory[step.OFFSET]


@step.internal
def _first_switch(t, d, memory, scratch, known, events, count):
    """When the load first stops, turns or starts within d; d if it does not."""
    # There the force between motor and load, and their relative velocity, change abruptly.
    stops = scratch[step.MODE] == 0.0 and memory[step.MODE] != 0.0
    switch = d - scratch[step.REST] if stops else d
    if count[step.LISTED] > known:
        switch = min(switch, events[3 * known] - t)
    return max(switch, step.CLOSE * d) if switch < (1.0 - step.CLOSE) * d else d


class Bounds(NamedTuple):
    """What one mass that the drive moves does at most within a stretch."""

    push: float  # acceleration but for what brakes it at rest, or damps its contact
    braking: float  # acceleration by that
    drift: float  # change of the level but for its peak
    rate: float  # rate of the force but for an elastic contact
    bends: float  # rate of the force of that contact


@step.internal
def _bounds(plant, drive, t, d, state):
    """Bounds over d of one mass that the drive moves."""
    numbers, y, p = plant.numbers, state[step.X], state[step.V]
    s, rest = math.copysign(1.0, p), state[step.REST]
    others = step.load_under(plant, 0.0, t, y, p, s, rest)
    last = drive.start + drive.slope * d
    # A level may grow with all that the teeth carry; what moves the mass is the sum.
    w = abs(others) + max(abs(drive.start), abs(last)) + abs(drive.fade)
    net = max(abs(others + drive.start), abs(others + last)) + abs(drive.fade)
    level = max(
        step.breakaway_level(plant, t, y, w, 1.0, rest),
        step.breakaway_level(plant, t, y, w, -1.0, rest),
    )
    # An elastic contact is damped besides; a rigid one brakes what is left at rest.
    slowest = abs(p) if plant.integers[step.STRUCTURE] & step.CONTACT else numbers[step.STICK_SPEED]
    braking = numbers[step.STICK_RATE] * min(abs(p), slowest)
    by_force = (net + _GROWN * level + numbers[step.VISCOUS] * abs(p)) * numbers[step.INVERSE_MASS]
    speed = abs(p) + d * (by_force + braking)
    loads, levels = step.hold_rate(plant, step.drive_rate(drive), y, speed, by_force + braking)
    rate = loads + levels + numbers[step.VISCOUS] * (by_force + braking)
    bends = 0.0
    if plant.integers[step.STRUCTURE] & step.CONTACT:
        bends = numbers[step.CONTACT_STIFFNESS] * speed
        bends += numbers[step.STICK_RATE] / numbers[step.INVERSE_MASS] * (by_force + braking)
    # The two ends of a swing hold what the peak does.
    level = step.raised_level(plant, y)
    drift = d * (levels - step.peak_rate(plant, level, by_force + braking))
    push = by_force + d * (loads + levels) * numbers[step.INVERSE_MASS]
    return Bounds(push, braking, drift, rate, bends)


@step.internal
def _swing(plant, drive, t, d, state, bounds):
    """Range of the force of an elastic contact over d, infinite if the motion may turn."""
    push, drift = bounds.push, bounds.drift
    numbers, y, v = plant.numbers, state[step.X], state[step.V]
    s, speed, decay = math.copysign(1.0, v), abs(v), numbers[step.STICK_RATE]
    rest = state[step.REST]
    w = step.load_under(plant, step.drive_force(drive, 0.0), t, y, v, s, rest)
    force = s * numbers[step.CONTACT_STIFFNESS] * state[step.DEFLECTION]
    # The impulse of its damping is that of its deflection: at most up to breakaway, or to none.
    further = max(_bound(plant, t, y, 0.0, w, s, rest) + drift - force, 0.0)
    slow = speed - push * d - decay * further / numbers[step.CONTACT_STIFFNESS]
    if not slow > 0.0:
        return math.inf
    fast = speed + push * d + decay * max(force, 0.0) / numbers[step.CONTACT_STIFFNESS]
    # A contact that is dragged on only comes nearer to its level.
    slowest = _bound(plant, t, y, s * slow, w, s, rest)
    fastest = _bound(plant, t, y, s * fast, w, s, rest)
    low, high = min(slowest, fastest) - drift, max(slowest, fastest) + drift
    if rest > 0.0:
        low = min(low, _bound(plant, t, y, s * fast, w, s, 0.0) - drift)
    least, most = min(force, low), max(force, high)
    damped = 1.0
    if _bristles(plant):
        if low <= 0.0:
            return math.inf
        damped = max(abs(1.0 - least / high), abs(most / low - 1.0))
    return most - least + decay / numbers[step.INVERSE_MASS] * damped * fast


@step.internal(forceinline=True)
def _passes(start, end, bend):
    """Whether a gap, positive at both ends of a stretch, may vanish in between."""
    # `bend`: its largest second derivative times the square of the length.  The lowest course is
    # a parabola of that second derivative.
    change = abs(end - start)
    if change >= 0.5 * bend:
        return False
    return 0.5 * (start + end) <= 0.125 * bend + 0.5 * change * change / bend


@step.internal
def _first_touch(plant, drive, t, d, lead, most, known, memory, scratch, events, count):
    """Part of a flight in which motor and load first touch: both ends, and the leads there."""
    # `lead` is that after d, `most` the largest relative acceleration; `known`: listed switches.
    # Between them it looks no closer where the velocities change by less than noise hides.
    half, finest, hidden = (
        plant.numbers[step.HALF_GAP],
        _FINEST_LOOK * d,
        plant.numbers[step.ALLOWED],
    )
    a, start, length, looked = 0.0, -memory[step.OFFSET], d, d
    b, end = d, lead
    while a < d:
        b, end = d, lead
        if length < d - a:
            looked = b = a + length
            count[step.LISTED] = known
            end = _move_two_masses(plant, drive, t, b, memory, scratch, events, count)
        speed = most * (b - a)
        if abs(end) < half:
            may = _passes(half - abs(start), half - abs(end), speed * (b - a))
        else:
            may = abs(end - start) < 0.5 * speed * (b - a)  # they may have met before, and parted
        if may and b - a > 1.01 * finest and speed > hidden:
            length = max(0.5 * (b - a), finest)
            continue
        if abs(end) >= half:
            break
        length = max(2.0 * (b - a), finest)
        if b < d:
            start = end
        a = b
    if looked != b:
        count[step.LISTED] = known
        end = _move_two_masses(plant, drive, t, b, memory, scratch, events, count)
    return (0.0 if a == d else a), start, b, end


@step.internal(forceinline=True)
def _stays_stuck(plant, state, known, scratch, count):
    """Whether a mass on a rigid contact was at rest all the way from `state` to `scratch`."""
    rests = state[step.MODE] == 0.0 and scratch[step.MODE] == 0.0
    rigid = plant.integers[step.STRUCTURE] & step.CONTACT == 0
    return rests and rigid and count[step.LISTED] == known


@step.internal
def _first_pull(plant, drive, t, d, end, side, known, memory, scratch, events, count):
    """Part of a motion in contact in which the contact first pulls: both ends, and forces there."""
    # `end` is the contact force after d; `known`: listed switches.
    # It looks no closer where the pull changes velocities by less than noise hides.
    finest, state, hidden = _FINEST_LOOK * d, step.spare_memory(), plant.numbers[step.ALLOWED]
    _state_of_one(plant, memory, state)
    start = _push(plant, drive, t, state, side)
    rate = step.drive_rate(drive)
    bends = 0.0
    swing = 0.0
    if _stays_stuck(plant, state, known, scratch, count):
        # What is left of its velocity fades.
        fade = plant.numbers[step.STICK_RATE]
        rate += fade * fade * abs(state[step.V]) / plant.numbers[step.INVERSE_MOTOR]
    else:
        bounds = _bounds(plant, drive, t, d, state)
        share = plant.numbers[step.INVERSE_MASS] / plant.numbers[step.INVERSE_MOTOR]
        rate += share * bounds.rate
        bends = share * bounds.bends
        if bends > 0.0 and start + end < (rate + bends) * d:
            swing = share * _swing(plant, drive, t, d, state, bounds)
    a, length, force, b, looked = 0.0, d, end, d, d
    while a < d:
        b, force = d, end
        if length < d - a:
            looked = b = a + length
            count[step.LISTED] = known
            force = _move_one_mass(plant, drive, t, b, memory, side, scratch, events, count)
        change = rate * (b - a) + min(bends * (b - a), 2.0 * swing)
        seen = change * (b - a) * plant.numbers[step.INVERSE_MOTOR] > hidden
        # A contact that pulls at the end may have pulled, and pushed, before.
        if start + abs(force) < change and b - a > 1.01 * finest and seen:
            margin, fastest = start, rate + bends
            if (start - swing) * fastest > start * rate:
                margin, fastest = start - swing, rate
            length = margin_step(b - a, margin, fastest, finest)
            continue
        if force < 0.0:
            break
        length, a, start = max(2.0 * (b - a), finest), b, force
    if looked != b:
        count[step.LISTED] = known
        force = _move_one_mass(plant, drive, t, b, memory, side, scratch, events, count)
    return a, start, b, force


@step.internal
def _left(plant, drive, t, d, memory, side, after, scratch, events, count):
    """Contact force at `side` after d; or, of masses apart (0), their gap at `after`."""
    if side != 0.0:
        return _move_one_mass(plant, drive, t, d, memory, side, scratch, events, count)
    lead = _move_two_masses(plant, drive, t, d, memory, scratch, events, count)
    return plant.numbers[step.HALF_GAP] - after * lead


@step.internal
def _zero_time(
    plant, drive, t, a, fa, b, fb, exact, memory, side, after, known, scratch, events, count
):
    """When `_left` falls to zero between a and b, where it is fa and fb."""
    last = 0
    for i in range(100):
        c = secant_point(a, fa, b, fb)
        if b - a <= exact or fb == 0.0 or c == b:
            break
        # The contact force may jump when the load sticks: bisect every fourth time.
        if side != 0.0 and i % 4 == 3:
            c = 0.5 * (a + b)
        count[step.LISTED] = known
        fc = _left(plant, drive, t, c, memory, side, after, scratch, events, count)
        a, fa, b, fb, last = illinois_bracket(a, fa, b, fb, last, c, fc)
    count[step.LISTED] = known
    return b


@step.internal
def _move_joined(plant, drive, t, d, exact, free, memory, scratch, side, events, count):
    """Move motor and load in contact over at most d: how long, and the side of contact then."""
    # `free`: whether they may part; the motion ends where the load switches.
    known, half, after = count[step.LISTED], plant.numbers[step.HALF_GAP], side
    end = _move_one_mass(plant, drive, t, d, memory, side, scratch, events, count)
    switch = _first_switch(t, d, memory, scratch, known, events, count)
    if switch < d and free:
        count[step.LISTED], d = known, (1.0 - step.CLOSE) * switch
        end = _move_one_mass(plant, drive, t, d, memory, side, scratch, events, count)
        if end >= 0.0:
            count[step.LISTED], d = known, switch
            end = _move_one_mass(plant, drive, t, d, memory, side, scratch, events, count)
    a = 0.0
    start = 0.0
    if free:
        a, start, d, end = _first_pull(
            plant, drive, t, d, end, side, known, memory, scratch, events, count
        )
    if end < 0.0 and free:
        after = 0.0
        d = _zero_time(
            plant, drive, t, a, start, d, end, exact * d, memory, side, 0.0, known, scratch,
            events, count,
        )  # fmt: skip
        _move_one_mass(plant, drive, t, d, memory, side, scratch, events, count)
    offset = -side * half
    memory[step.X] = scratch[step.X] - (0.0 if _motor_has_friction(plant) else offset)
    memory[step.V] = scratch[step.V]
    memory[step.OFFSET], memory[step.SLIP] = offset, 0.0
    return d, after


@step.internal
def _middle_of_flight(plant, drive, t, d, memory, after, scratch, events, count):
    """Time at which masses that part and meet again within d are apart, and their gap."""
    known, c = count[step.LISTED], 0.5 * d
    for _ in range(30):
        count[step.LISTED] = known
        gap = _left(plant, drive, t, c, memory, 0.0, after, scratch, events, count)
        if gap > 0.0:
            return c, gap
        c *= 0.5
    return c, 0.0


@step.internal
def _move_apart(plant, drive, t, d, shortest, exact, free, memory, scratch, events, count):
    """Move motor and load apart over at most d: how long, and the side on which they meet or 0."""
    # `free`: whether they may meet; the motion ends where the load switches.
    known, half, rubs = count[step.LISTED], plant.numbers[step.HALF_GAP], _motor_has_friction(plant)
    lead = _move_two_masses(plant, drive, t, d, memory, scratch, events, count)
    switch = _first_switch(t, d, memory, scratch, known, events, count)
    if switch < d and d > shortest:
        count[step.LISTED], d = known, switch
        lead = _move_two_masses(plant, drive, t, d, memory, scratch, events, count)
    after = 0.0
    if free:
        most = _relative_acceleration(plant, drive, t, d, memory)
        a, start, d, lead = _first_touch(
            plant, drive, t, d, lead, most, known, memory, scratch, events, count
        )
        if abs(lead) > half:
            after = 1.0 if lead > 0.0 else -1.0
            fa, fb, b = half - after * start, half - after * lead, d
            if fa <= 0.0:
                a, fa = _middle_of_flight(plant, drive, t, d, memory, after, scratch, events, count)
            if fa <= 0.0:
                a = b = 0.0
            lead = after * half
            d = _zero_time(
                plant, drive, t, a, fa, b, fb, exact * d, memory, 0.0, after, known, scratch,
                events, count,
            )  # fmt: skip
            if d > 0.0:
                _move_two_masses(plant, drive, t, d, memory, scratch, events, count)
            else:
                _state_of_one(plant, memory, scratch)
    moved, speed = _free(plant, drive, memory, d)
    if rubs:
        memory[step.X], memory[step.V] = scratch[step.X], scratch[step.V]
        memory[step.OFFSET], memory[step.SLIP] = -lead, speed - scratch[step.V]
    else:
        memory[step.X] += moved
        memory[step.V] = speed
        memory[step.OFFSET], memory[step.SLIP] = -lead, scratch[step.V] - speed
    if after != 0.0:
        _plastic_impact(plant, t + d, memory, scratch, after)
    return d, after


@step.internal
def _relative_acceleration(plant, drive, t, d, memory):
    """Largest relative acceleration of motor and load, apart."""
    state, rubs = step.spare_memory(), _motor_has_friction(plant)
    _state_of_one(plant, memory, state)
    felt = drive if rubs else step.held_force(0.0)
    bounds = _bounds(_load_side(plant), felt, t, d, state)
    most = bounds.push + bounds.braking
    if rubs:
        return most
    push = max(abs(drive.start), abs(drive.start + drive.slope * d)) + abs(drive.fade)
    return most + push * plant.numbers[step.INVERSE_MOTOR]


@step.internal(inline="always")
def _advance_play(plant, drive, t0, h, memory, events, count):
    """Move motor and load with a play between them, see `advance`."""
    # In contact they are one mass until the contact would have to pull.  Apart, the mass without
    # friction moves in closed form and the other one under its own forces, until they meet.
    half, scratch = plant.numbers[step.HALF_GAP], step.spare_memory()
    tau, side = 0.0, contact_side(plant, memory)
    if side != 0.0:
        memory[step.OFFSET] = -side * half
        if memory[step.SLIP] != 0.0:
            _state_of_one(plant, memory, scratch)
            _plastic_impact(plant, t0, memory, scratch, side)
    seen, friction, first, side = _seen_play(plant, drive, t0, memory, side)
    v, p = memory[step.V], memory[step.V] + memory[step.SLIP]
    pace = abs(v) + abs(p) + plant.numbers[step.STICK_SPEED]
    exact = 1e-15 + _MEETING * plant.numbers[step.ALLOWED] / pace
    close = 0
    for turn in range(count[step.MOST]):
        if tau >= h:
            break
        # Bound the work and the number of listed switches.
        last_turn = turn == count[step.MOST] - 1
        free = not last_turn and close < step.MOST_CLOSE
        now, piece = t0 + tau, _shift_drive(drive, tau)
        d = h - tau if last_turn else min(h - tau, plant.numbers[step.SHORT_TIME])
        if side != 0.0:
            d, after = _move_joined(
                plant, piece, now, d, exact, free, memory, scratch, side, events, count
            )
        else:
            if free:
                most = _relative_acceleration(plant, piece, now, d, memory)
                d = min(d, _LONGEST_FLIGHT * math.sqrt(8.0 * half / max(most, 1e-300)))
            shortest = step.CLOSE * h if free else math.inf
            d, after = _move_apart(
                plant, piece, now, d, shortest, exact, free, memory, scratch, events, count
            )
        memory[step.MODE], memory[step.REST] = scratch[step.MODE], scratch[step.REST]
        memory[step.DEFLECTION] = scratch[step.DEFLECTION]
        tau += d
        close = close + 1 if d < step.CLOSE * h else 0
        if tau + step.SHORTEST * h >= h:
            tau = h
        if after != 0.0 and side == 0.0 and tau < h:
            _state_of_one(plant, memory, scratch)
            if _push(plant, _shift_drive(drive, tau), t0 + tau, scratch, after) < 0.0:
                after = 0.0
        side = after
    return seen, friction, first


@step.internal
def _seen_play(plant, drive, t, memory, side):
    """Velocity of the motor, friction force, mode, and the side of contact if it holds."""
    scratch = step.spare_memory()
    _state_of_one(plant, memory, scratch)
    if side != 0.0:
        mode, _, friction, rate = _seen_one(plant, drive, t, scratch)
        if memory[step.SLIP] != 0.0 or _pushes(plant, drive, rate, side) >= 0.0:
            return memory[step.V], friction, mode, side
    felt = drive if _motor_has_friction(plant) else step.held_force(0.0)
    mode, _, friction, _ = _seen_one(_load_side(plant), felt, t, scratch)
    return memory[step.V], friction, mode, 0.0


@step.internal
def _settle(plant, force, inertia, t, memory):
    """Inner states of an axis that has come to rest, or to steady sliding."""
    carried = inertia if _motor_has_friction(plant) else force
    # A play is closed on the side of the drive, a spring carries the drive, and an elastic
    # contact carries the load up to the friction level.
    kind, half = plant.integers[step.STRUCTURE], plant.numbers[step.HALF_GAP]
    memory[step.OFFSET] = 0.0
    memory[step.SLIP] = 0.0
    memory[step.DEFLECTION] = 0.0
    if kind & step.PLAY:
        memory[step.OFFSET] = -half if carried >= 0.0 else half
    if kind & step.SPRING:
        memory[step.OFFSET] = -carried / plant.numbers[step.STIFFNESS]
        memory[step.OFFSET] -= half if carried >= 0.0 else -half
    if kind & step.CONTACT:
        y, v = (
            memory[step.X] + (0.0 if _motor_has_friction(plant) else memory[step.OFFSET]),
            memory[step.V],
        )
        w = step.load_under(plant, force, t, y, v, 0.0, memory[step.REST])
        slides = abs(v) > plant.numbers[step.STICK_SPEED]
        s = math.copysign(1.0, v if slides else w)
        bound = _bound(plant, t, y, v, w, s, 0.0)
        pull = s * bound if slides else s * min(abs(w), bound)
        memory[step.DEFLECTION] = pull / plant.numbers[step.CONTACT_STIFFNESS]


def _inner_task(
    task, numbers, integers, start, slope, fade, rate, t0, h, memory, events, count, seen
):
    """Perform a task of an axis with inner states; velocity of the motor, friction, mode."""
    plant, drive = step.Plant(numbers, integers), step.Drive(start, slope, fade, rate)
    if task == step.SETTLE:
        _settle(plant, start, slope, t0, memory)
        return
    kind = integers[step.STRUCTURE]
    play, two, rubs = kind & step.PLAY, kind & step.SPRING != 0, kind & step.MOTOR_RUBS != 0
    side = _load_side(plant) if two else plant
    if task == step.ADVANCE and play:
        v, friction, mode = _advance_play(plant, drive, t0, h, memory, events, count)
    elif task == step.ADVANCE:
        v, friction, mode = _advance_inner(side, drive, t0, h, memory, events, count)
    elif play:
        v, friction, mode, _ = _seen_play(plant, drive, t0, memory, contact_side(plant, memory))
    else:
        at, z, before = _masses(memory, two, rubs), memory[step.DEFLECTION], int(memory[step.MODE])
        if _has_gap(side):
            at = _touching(side, at, h)
        found = _begin_inner(side, drive, t0, at, z, before, memory[step.REST])
        v, friction, mode = found[1] if rubs else at.v, found[3], found[0]
    seen[0], seen[1], seen[2] = v, friction, mode


@functools.cache
def inner_task():
    """Function that moves an axis with inner states, compiled on first use."""
    return cfunc(step.TASK_CALL, cache=True, error_model="numpy")(_inner_task)
