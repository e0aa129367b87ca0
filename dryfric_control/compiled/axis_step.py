"""Compiled one-sample step of the switched axis.

All functions take and return numbers and arrays: no classes, no Python objects.
The equations of motion are integrated only here; all users of the axis
(`FrictionAxis.simulate`, the python-control blocks, fitting, diagnosis) call this
module.

The modes are those of the hybrid model (paper, eqs. (2) and (3)), with
``s = +1, -1`` the direction of sliding::

    sliding   x' = v,  m v' = w - f v - s F_s(x, v)
              F_s = (C_s(x) + extra levels) (1 + sigma exp(-((s v - Sigma)/vs)^2))
    stuck     x' = v,  v' = -p v,  friction = w

where ``w`` is the net force without friction: the drive after gain, dead zone,
saturation, delay and lag, plus every force effect.

An axis may have inner states.  With an elastic contact (presliding, Prandtl's
element of stiffness k and deflection z) mode 0 is the elastic phase::

    elastic   m v' = w - f v - k z - c v,  z' = v,  until |k z| reaches F_s
    sliding   as above, z = s F_s/k, until v = 0

A contact that springs back slides too, z = s F_s/k, while F_s falls faster than k z.
A contact of bristles (LuGre) has one law in both modes::

    m v' = w - f v - k z - c z',  z' = v - |v| k z/F_s

With a transmission (a play, or a spring and damper) there are two masses: the
motor with the drive and the encoder (x, v), and the load with all friction and
all force effects.  The mode is then that of the load.

Sliding is integrated by the four-stage Runge-Kutta-Nystroem method of order 4
with an error estimate from its own stages; stuck is exact in closed form.  A step
that meets a switching surface is shortened to end there.  Its length is found by
repeating the step itself, not by interpolation, so switching times are as accurate
as the integration.

numba's cache notices only changes of a function's own file: what runs in every sample of a rigid
axis is in this file and `roots`; `elastic`, `two_masses`, `states` and `observer` build on them.
"""

from __future__ import annotations

import functools
import math
from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir
from numba import cfunc, types
from numba.core import cgutils
from numba.extending import intrinsic

from dryfric_control.compiled.cached import njit
from dryfric_control.compiled.roots import (
    illinois_bracket,
    larger_step,
    margin_step,
    secant_point,
    smaller_step,
)

#: Scalar law of an effect: f(t, x, v, u, level, direction, rest, parameters).
LAW = types.float64(
    types.float64,  # t: time [s]
    types.float64,  # x: position
    types.float64,  # v: velocity
    types.float64,  # u: force the law acts on (drive, or the load for friction)
    types.float64,  # level: Coulomb level at this position, 0 for force laws
    types.float64,  # direction: +1, -1; 0 while stuck
    types.float64,  # rest: time at rest [s]
    types.CPointer(types.float64),  # parameters of this effect
)

_NUMBERS, _INTEGERS = types.CPointer(types.float64), types.CPointer(types.int64)
#: Functions that move or inspect an axis, see `_rigid_task` and `_inner_task`.
TASK_CALL = types.void(
    types.int64,  # task
    _NUMBERS,
    _INTEGERS,
    *(types.float64,) * 6,  # drive, t0, h
    *(_NUMBERS, _NUMBERS, _INTEGERS, _NUMBERS),  # memory, events, count, seen
)

#: Values of RULE, the switching rule.
FILIPPOV = 0
PAPER = 1

#: Indices in the array of numbers that describes an axis; the coefficients of
#: the Coulomb levels (for +, then for -) and the effects' parameters follow.
INVERSE_MASS, VISCOUS, EXCESS, INVERSE_STRIBECK_SPEED, STICK_SPEED, STICK_RATE, LOW, HIGH = range(8)
DELAY, LAG, CONTACT_STIFFNESS, HALF_GAP, STIFFNESS, DAMPING, INVERSE_MOTOR = range(8, 15)
#: SHORT_WAY and SHORT_TIME are the shortest length and time over which an effect
#: varies: no step is longer, or all its stages could see the same phase.
#: ALLOWED is a velocity error per step that is allowed in addition to TOLERANCE: 0
#: unless noise hides it.
#: BEHIND is the fraction of the mass that the transmission moves: that of the load behind
#: a play on which friction depends, else 1.
#: STICK_RATE is the rate at which the velocity of a stuck axis decays; with an elastic contact
#: that by its own damping.  BRISTLES is 1 for a contact of bristles.
#: KNOWN_FORCE + KNOWN_RATE t is a force on the mass that the user knows; a run over a record sets
#: it for every sample, see `set_known_force`.
SHORT_WAY, SHORT_TIME, ALLOWED, BEHIND, BRISTLES = range(15, 20)
KNOWN_FORCE, KNOWN_RATE, COULOMB = range(20, 23)

#: Indices in the array of integers; address and first parameter of each law
#: follow, in the order input, force, level.  The first N_PLACE of the N_FORCE
#: force laws depend only on position and time; the first N_PEAKED of the N_LEVEL
#: level laws are raised by the Stribeck peak; N_CARRIED of the level laws depend on the
#: load of the transmission, the last N_DRIVEN of them on the drive alone; the N_READING laws of
#: the encoder come last.
#: STRUCTURE is the set of inner states of the axis, 0 for none.  With two masses
#: the numbers are stored twice, N_NUMBERS each: with the total mass, and with
#: that of the load.  RIGID_TASK and TASK are addresses of the functions that move the
#: axis without its inner states, and with them.
RULE, N_PLUS, N_MINUS, N_INPUT, N_FORCE, N_PLACE, N_LEVEL, N_HISTORY = range(8)
STRUCTURE, N_NUMBERS, RIGID_TASK, TASK, N_PEAKED, N_READING, N_CARRIED = range(8, 15)
#: Number of inputs at which the input laws bend, and the index of the first among the numbers;
#: N_BENDING: number of force and level laws that bend over velocity; N_EDGES: number of places at
#: which they bend, which follow the corners.
#: N_STATES: number of states of effects with a memory; STATES: index among the integers of the
#: first of their rows, see `states`; N_COPIED: length of the numbers.
N_CORNERS, CORNERS, N_DRIVEN, N_BENDING, N_EDGES, N_STATES, STATES, N_COPIED, LAWS = range(15, 24)

#: Places, before the first parameter of a law, of the largest slopes of its force: over time and
#: time at rest, place, velocity, and load.  RELATIVE is 1 where they are parts of the level; BEND
#: is the velocity over which the slope over velocity lasts.
BY_TIME, BY_PLACE, BY_VELOCITY, BY_LOAD, RELATIVE, BEND = range(-6, 0)

#: Flags of STRUCTURE, to be added.
CONTACT = 1
PLAY = 2
#: With a gap, the spring is that of its ends.
SPRING = 4
#: The encoder is on the load.
ON_LOAD = 8
#: Of two masses the motor has the friction, and all forces.
MOTOR_RUBS = 16
#: Effects have states of their own, see `states`.
REMEMBERS = 32
#: Tasks of the functions at RIGID_TASK and TASK.
ADVANCE = 0
_LOOK = 1
SETTLE = 2

#: Indices in the memory of an axis; the delay line follows, then the states of effects.
#: Position and velocity are those of the motor.  Inner states: deflection of the
#: contact; position and velocity of the load minus those of the motor.
X, V, MODE, REST, LAGGED, DEFLECTION, OFFSET, SLIP, HISTORY = range(9)
#: Number of values that describe the inner states: deflection, offset, slip, mode.
N_INNER = 4

# Local error of one step, relative to the velocity scale: far below the accuracy
# guaranteed for switching times (1e-6 s) and far above round-off.
TOLERANCE = 3e-9
# Relative accuracy of a friction level that depends on itself.
_EQUAL_LEVELS = 1e-15
# Most evaluations of the level for that.
_SECANTS = 12
# exp(-40) is below the round-off of 1: the Stribeck term is zero beyond.
_STRIBECK_REACH = 40.0
_STRIBECK_EDGE = math.sqrt(_STRIBECK_REACH)
# Bound of the error that the peak makes in a step, see `peak_error`.
_PEAK_ERROR = 230.0
# Largest number of switches per sample, to bound the work.  Well-posed switching reaches it only
# if a sample contains tens of thousands of oscillations; later switches are counted as lost.
MAX_SWITCHES = 100_000
# Distance of two switches, as a fraction of the interval, below which they are due to a load and
# a level that are equal up to round-off.
CLOSE = 1e-6
# Successive ones after which the mode is held for a pause, which grows each time.
MOST_CLOSE = 64
# Shortest stretch in which a load that nears its level is looked for, as a fraction of the times
# over which it varies: what is left between two looks is found by the parabola through three.
_FINEST_LOOK = 1e-2
#: Part of a step within which the end of another is that of this one.
SAME_END = 1e-6
# The same where the crossing is found by the secant alone.
_SAME_END_OF_SECANT = 1e-3
# Most evaluations of a cubic for its root.
_ROOT_TURNS = 40
# Largest slope of exp(-q^2).
_STEEPEST_PEAK = math.sqrt(2.0 / math.e)
#: Bound of the slopes of a law, so that their products do not overflow; a law whose slope over
#: velocity lasts for so long does not bend.
MOST_SLOPE = 1e100
# What effects may add to a level, as a multiple of it, for the bound of its rate.
_RAISED = 2.0
# Time constants after which a lagged drive is where it goes, to round-off.
_LAG_REACH = 40.0


class TooManySwitchesError(ValueError):
    """A sample that cannot be simulated."""

    def __init__(self) -> None:
        super().__init__(
            "one sample holds more than 100 000 switches: take a shorter dt, or check the units"
        )


#: Least free room of a list of switches before each sample, in numbers.
ROOM = 3 * 400
#: Largest room; a sample that needs more has too many switches.
MOST_ROOM = 8 * 3 * MAX_SWITCHES
#: Indices of the tally of a list of switches: number of switches, room for them, number
#: lost because there was no room, and largest number per stretch.
LISTED, HELD, LOST, MOST = range(4)
#: Largest number of switches per stretch in a search for parameters: an axis with more fits
#: no record, and would be slow.
FEW_SWITCHES = 64
# Iterations of the search for the position of a reading, see `place`.
_TURNS = 12
SHORTEST = 1e-9  # shortest step, as a fraction of the interval


class Plant(NamedTuple):
    """Numbers of one axis and its laws, as addresses for compiled functions."""

    numbers: Any  # pointer to float64, see the places above
    integers: Any  # pointer to int64: counts, then the laws


class Drive(NamedTuple):
    """Drive force inside an interval: start + slope tau + fade exp(-rate tau)."""

    start: float
    slope: float
    fade: float
    rate: float


def internal(function=None, **options):
    """`njit` for functions that compiled code alone calls: no wrappers, less to compile."""
    return njit(
        function, cache=True, error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True,
        **options,
    )  # fmt: skip


@intrinsic
def pointer(typingctx, array):
    """Address of the first element; the caller keeps the array alive, see `keep_alive`."""
    signature = types.CPointer(array.dtype)(array)

    def codegen(context, builder, signature, args):
        return context.make_array(signature.args[0])(context, builder, args[0]).data

    return signature, codegen


@intrinsic
def keep_alive(typingctx, array):
    """Keep an array alive up to here.

    A local array is freed after the last line that names it, whatever points to its memory.
    """
    signature = types.void(array)

    def codegen(context, builder, signature, args):
        return context.get_dummy_value()

    return signature, codegen


@intrinsic
def _call(typingctx, address, t, x, v, u, level, direction, rest, numbers, offset):
    """Call a compiled law by its address: one kernel serves every combination."""
    signature = types.float64(
        types.int64, *LAW.args[:-1], types.CPointer(types.float64), types.int64
    )

    def codegen(context, builder, signature, args):
        double = ir.DoubleType()
        function = ir.FunctionType(double, [double] * 7 + [double.as_pointer()])
        callee = builder.inttoptr(args[0], function.as_pointer())
        parameters = builder.gep(args[8], [args[9]])
        return builder.call(callee, [*args[1:8], parameters])

    return signature, codegen


@intrinsic
def offset_address(typingctx, numbers, count):
    """Address of the number `count` positions further on."""
    signature = numbers(numbers, types.int64)

    def codegen(context, builder, signature, args):
        return builder.gep(args[0], [args[1]])

    return signature, codegen


@intrinsic
def spare_memory(typingctx):
    """A memory without delay line, valid while the calling function runs."""
    signature = types.CPointer(types.float64)()

    def codegen(context, builder, signature, args):
        room = cgutils.alloca_once(builder, ir.ArrayType(ir.DoubleType(), HISTORY))
        return builder.bitcast(room, ir.DoubleType().as_pointer())

    return signature, codegen


@intrinsic
def _call_task(typingctx, address, *arguments):
    """Call `_rigid_task` or `_inner_task` by its address."""
    signature = types.void(types.int64, types.Tuple(TASK_CALL.args))

    def codegen(context, builder, signature, args):
        kinds = [context.get_value_type(kind) for kind in TASK_CALL.args]
        function = ir.FunctionType(ir.VoidType(), kinds)
        callee = builder.inttoptr(args[0], function.as_pointer())
        builder.call(callee, cgutils.unpack_tuple(builder, args[1]))
        return context.get_dummy_value()

    return signature, codegen


@njit(cache=True, error_model="numpy")
def point(numbers, integers):
    """The arrays of an axis as a `Plant`; they must outlive it."""
    return Plant(pointer(numbers), pointer(integers))


@internal(forceinline=True)
def _law(plant, i, t, x, v, u, level, direction, rest):
    address, offset = plant.integers[LAWS + 2 * i], plant.integers[LAWS + 2 * i + 1]
    return _call(address, t, x, v, u, level, direction, rest, plant.numbers, offset)


@njit(cache=True, error_model="numpy", forceinline=True)
def polynomial(coefficients, first, count, x):
    """Value of c[0] + c[1] x + ... by Horner's rule."""
    value = coefficients[first + count - 1]
    for i in range(count - 2, -1, -1):
        value = value * x + coefficients[first + i]
    return value


@njit(cache=True, error_model="numpy", forceinline=True)
def held_force(force):
    """Drive with a constant force."""
    return Drive(force, 0.0, 0.0, 0.0)


@internal(forceinline=True)
def drive_force(drive, tau):
    """Drive force at time tau of the interval."""
    force = drive.start + drive.slope * tau
    if drive.fade != 0.0:
        force += drive.fade * math.exp(-drive.rate * tau)
    return force


@internal(forceinline=True)
def _place_force(plant, t, x, s, rest):
    """Sum of the force laws that depend only on position and time."""
    force = 0.0
    for i in range(plant.integers[N_INPUT], plant.integers[N_INPUT] + plant.integers[N_PLACE]):
        force += _law(plant, i, t, x, 0.0, 0.0, 0.0, s, rest)
    return force


@internal(forceinline=True)
def _motion_force(plant, t, x, v, u, s, rest):
    """Sum of the force laws that depend on velocity or drive as well."""
    force = 0.0
    first = plant.integers[N_INPUT]
    for i in range(first + plant.integers[N_PLACE], first + plant.integers[N_FORCE]):
        force += _law(plant, i, t, x, v, u, 0.0, s, rest)
    return force


@internal(forceinline=True)
def _known_force(plant, t):
    """Force on the mass that the user knows."""
    return plant.numbers[KNOWN_FORCE] + plant.numbers[KNOWN_RATE] * t


@internal
def set_known_force(plant, t, dt, force, k, first):
    """Set the known force of sample k, which begins at t: held, or linear if `first`."""
    n = force.shape[0]
    rate = (force[min(k + 1, n - 1)] - force[k]) / dt if first else 0.0
    second = plant.integers[N_NUMBERS]  # with two masses, of the one with friction; else 0
    for i in (0, second):
        plant.numbers[i + KNOWN_FORCE] = force[k] - rate * t
        plant.numbers[i + KNOWN_RATE] = rate


@internal(forceinline=True)
def load_under(plant, u, t, x, v, s, rest):
    """Net force on the mass without friction, under a drive force."""
    known = u + _known_force(plant, t)
    return (known + _place_force(plant, t, x, s, rest)) + _motion_force(plant, t, x, v, u, s, rest)


@internal(forceinline=True)
def load(plant, drive, t0, tau, x, v, s, rest):
    """The same at time tau of an interval."""
    return load_under(plant, drive_force(drive, tau), t0 + tau, x, v, s, rest)


@internal(forceinline=True)
def base_level(plant, x, s):
    """Coulomb level of the map in direction s."""
    place = min(max(x, plant.numbers[LOW]), plant.numbers[HIGH])
    plus = plant.integers[N_PLUS]
    if s > 0.0:
        return polynomial(plant.numbers, COULOMB, plus, place)
    return polynomial(plant.numbers, COULOMB + plus, plant.integers[N_MINUS], place)


@internal(forceinline=True)
def _transmission_load(plant, t, x, v, w, s, rest):
    """Load of the transmission, given the net force: drive minus force effects."""
    # A drive that holds a weight is loaded by both.  The part of a force effect that depends
    # on the drive counts as drive.
    if plant.integers[N_CARRIED] == 0:
        return w
    return w - 2.0 * load_under(plant, 0.0, t, x, v, s, rest)


@internal(forceinline=True)
def _levels(plant, t, x, v, w, base, s, rest):
    """Level that the Stribeck peak raises, before the peak, and that of other contacts."""
    carried = _transmission_load(plant, t, x, v, w, s, rest)
    first = plant.integers[N_INPUT] + plant.integers[N_FORCE]
    peaked, last = first + plant.integers[N_PEAKED], first + plant.integers[N_LEVEL]
    driven = last - plant.integers[N_DRIVEN]
    own, further = base, 0.0
    for i in range(first, peaked):
        own += _law(plant, i, t, x, v, carried, own, s, rest)
    for i in range(peaked, driven):
        further += _law(plant, i, t, x, v, carried, base, s, rest)
    if driven < last:
        drive = w - load_under(plant, 0.0, t, x, v, s, rest)
        for i in range(driven, last):
            further += _law(plant, i, t, x, v, drive, base, s, rest)
    return max(own, 0.0), further


@internal(forceinline=True)
def coulomb_level(plant, t, x, v, w, s, rest):
    """Friction level without Stribeck peak in direction s, a magnitude."""
    own, further = _levels(plant, t, x, v, w, base_level(plant, x, s), s, rest)
    return max(own + further, 0.0)


@internal
def _holding_level(plant, t, x, v, w, s):
    """Level within which a slow axis stops for good: what rises with velocity does not hold it."""
    level = coulomb_level(plant, t, x, v, w, s, 0.0)
    return min(level, coulomb_level(plant, t, x, 0.0, w, s, 0.0))


@internal(forceinline=True)
def _level_under(plant, t, x, v, slip, w, base, s, rest):
    """Friction level where the transmission carries the whole drive."""
    own, further = _levels(plant, t, x, v, w, base, s, rest)
    if plant.numbers[EXCESS] > 0.0:
        q = (s * slip - plant.numbers[STICK_SPEED]) * plant.numbers[INVERSE_STRIBECK_SPEED]
        q *= q
        if q < _STRIBECK_REACH:
            own *= 1.0 + plant.numbers[EXCESS] * math.exp(-q)
    return max(own + further, 0.0)


@internal
def _level_behind(plant, t, x, v, slip, w, base, s, rest):
    """Friction level where the transmission does not carry the inertia of the motor."""
    # With the fraction r of the mass behind the teeth and m a = w - f v - s F, they carry
    # r w + (1 - r) (f v + s F) instead of w: F is found by secants, exact where it is
    # linear in the load.
    share = plant.numbers[BEHIND]
    given = share * w + (1.0 - share) * plant.numbers[VISCOUS] * v
    by_friction = (1.0 - share) * s
    last, last_level = 0.0, _level_under(plant, t, x, v, slip, given, base, s, rest)
    level = last_level
    for _ in range(_SECANTS):
        new = _level_under(plant, t, x, v, slip, given + by_friction * level, base, s, rest)
        if abs(new - level) <= _EQUAL_LEVELS * new or level == last:
            return new
        bend = 1.0 - (new - last_level) / (level - last)
        last, last_level = level, new
        level = max(level + (new - level) / bend, 0.0) if bend > 0.0 else new
    return level


@internal(forceinline=True)
def peaked_level(plant, t, x, v, slip, w, base, s, rest):
    """Friction level with its Stribeck peak at the velocity `slip`, a magnitude."""
    if plant.numbers[BEHIND] != 1.0:
        return _level_behind(plant, t, x, v, slip, w, base, s, rest)
    return _level_under(plant, t, x, v, slip, w, base, s, rest)


@internal(forceinline=True)
def sliding_level(plant, t, x, v, w, s):
    """Friction magnitude F_s(x, v) while sliding in direction s."""
    return peaked_level(plant, t, x, v, v, w, base_level(plant, x, s), s, 0.0)


@internal
def breakaway_level(plant, t, x, w, s, rest):
    """Friction that a stuck axis can hold against motion in direction s."""
    own, further = _levels(plant, t, x, 0.0, w, base_level(plant, x, s), s, rest)
    return max((1.0 + plant.numbers[EXCESS]) * own + further, 0.0)


@internal(forceinline=True)
def sliding_friction(plant, u, t, x, v, s):
    """Friction force while sliding in direction s under a drive force."""
    return s * sliding_level(plant, t, x, v, load_under(plant, u, t, x, v, s, 0.0), s)


@internal(forceinline=True)
def acceleration(plant, w, v, friction):
    """Acceleration by the net force without friction, and friction."""
    return (w - plant.numbers[VISCOUS] * v - friction) * plant.numbers[INVERSE_MASS]


@internal(forceinline=True)
def _rate(plant, t, x, v, s, u, placed, base):
    """Acceleration, given the drive, the position-dependent forces and the map's level."""
    w = placed + _motion_force(plant, t, x, v, u, s, 0.0)
    return acceleration(plant, w, v, s * peaked_level(plant, t, x, v, v, w, base, s, 0.0))


@internal(forceinline=True)
def _acceleration(plant, drive, t0, tau, x, v, s):
    u = drive_force(drive, tau)
    t = t0 + tau
    placed = (u + _known_force(plant, t)) + _place_force(plant, t, x, s, 0.0)
    return _rate(plant, t, x, v, s, u, placed, base_level(plant, x, s))


@internal
def slide(plant, drive, t0, tau, x, v, s, k1, d):
    """One sliding step of length d: state, stages 2 to 4, position-dependent acceleration."""
    # Stages 2 and 3 have the same position: laws that depend only on position and time
    # are evaluated once for both.
    half = 0.5 * d
    xm = x + half * (v + 0.25 * d * k1)
    t = t0 + tau + half
    u = drive_force(drive, tau + half)
    given = u + _known_force(plant, t)
    placed = given + _place_force(plant, t, xm, s, 0.0)
    base = base_level(plant, xm, s)
    k2 = _rate(plant, t, xm, v + half * k1, s, u, placed, base)
    k3 = _rate(plant, t, xm, v + half * k2, s, u, placed, base)
    k4 = _acceleration(plant, drive, t0, tau + d, x + d * (v + half * k3), v + d * k3, s)
    x1 = x + d * (v + d * (k1 + k2 + k3) / 6.0)
    v1 = v + d * (k1 + 2.0 * (k2 + k3) + k4) / 6.0
    return x1, v1, k2, k3, k4, (placed - given) * plant.numbers[INVERSE_MASS]


@internal(forceinline=True)
def step_error(plant, drive, k1, k2, k3, k4, placed, moved, d, allowed):
    """Estimate of the velocity error of one step from its stages; 0 if surely allowed."""
    # With a rate a' = lambda a the stages give z = lambda d from (k3 - k2)/(k2 - k1) = z/2, and
    # the error is z^5/120 of the velocity.  With a force that varies with position like a sine of
    # phase phi per step, it is at most d A phi^4/120 (a spring; d A phi^4/2880 if the motion is
    # given, Simpson's rule); the second difference is A phi^2/4, and phi is its ratio to the
    # first, A phi, or to the force.  Where such a force passes through zero, the error stems from
    # the new position, and phi^2 is d^2 times the first difference over the distance moved.
    # Without such forces only the first source remains: a linear drive is integrated exactly,
    # and an exponential one by Simpson's rule.
    i = plant.integers
    along = i[N_FORCE] + i[N_LEVEL] > 0 or i[N_PLUS] + i[N_MINUS] > 2
    turn, lean = abs(k3 - k2), abs(k2 - k1)
    bend = abs((k1 - k2) - (k3 - k4))
    # A drive, or a known force, that runs linearly is no variation that a step could miss.
    linear = (drive.slope + plant.numbers[KNOWN_RATE]) * d * plant.numbers[INVERSE_MASS]
    rise = abs(k4 - k1 - linear)
    way = abs(moved)
    stiff = 0.0
    if 0.14 * d * turn * turn * turn > allowed * lean * lean:
        ratio = turn / (lean + 1e-3 * turn)
        stiff = turn * min(1.0, 0.14 * ratio * ratio)
    if not along:
        if drive.fade == 0.0 or bend == 0.0:
            return d * stiff
        # exp(-phi): the second difference over the first is phi/4.
        ratio = min(0.25 * d * drive.rate, 1.0)
        return d * (stiff + 0.53 / 24.0 * bend * ratio * ratio)
    if (
        stiff == 0.0
        and d * d * d * rise * rise <= 40.0 * allowed * way
        and (
            4.0 * d * bend * bend <= 10.0 * allowed * abs(placed)
            or d * bend * bend * bend <= 0.63 * allowed * rise * rise
        )
    ):
        return 0.0
    uneven = 0.0
    coupled = 0.0
    if bend > 0.0:
        ratio = bend / (rise + bend)
        uneven = bend * min(0.53 * ratio * ratio, bend / (7.5 * abs(placed) + bend))
    if way > 0.0:
        coupled = rise * min(1.0, d * d * rise / (120.0 * way))
    return d * (stiff + uneven + coupled)


@internal(forceinline=True)
def _bend_error(force, fades, inverse, k1, k4, d):
    """Bound of the velocity error of one step by a force that bends over 1/inverse of velocity."""
    # With the peak of acceleration A exp(-q^2) the velocity changes by F Stribeck velocities in a
    # step, and by Z = A d of them by the peak alone.  The error of the method is at most
    # d A w F (F + Z)^3/230, w = exp(-q^2) (1 + q^2)^2 where it is largest in the step:
    # up to 0.97 of it over a million random steps with F < 1 (`benchmarks/sampling.py peak`).
    change = max(abs(k1), abs(k4)) * d * inverse
    steep = change + force * d * inverse
    return force * d * fades * change * steep * steep * steep / _PEAK_ERROR


@internal
def _law_bends_error(plant, x, v, v1, s, k1, k4, d):
    """The same by all laws of effects."""
    numbers, i = plant.numbers, plant.integers
    first, level, error = i[N_INPUT], base_level(plant, x, s) * _RAISED, 0.0
    slowest = max(min(s * v, s * v1), 0.0)
    for k in range(first, first + i[N_FORCE] + i[N_LEVEL]):
        law = i[LAWS + 2 * k + 1]
        bend, steepest = numbers[law + BEND], numbers[law + BY_VELOCITY]
        if bend < MOST_SLOPE and steepest > 0.0:
            unit = level if numbers[law + RELATIVE] != 0.0 else 1.0
            force = unit * steepest * bend / _STEEPEST_PEAK * numbers[INVERSE_MASS]
            # Their shapes are not known: a tail longer than that of a tanh.
            tail = 1.0 + slowest * slowest / (bend * bend)
            error += _bend_error(force, 1.0 / (tail * tail), 1.0 / bend, k1, k4, d)
    return error


@internal(forceinline=True)
def peak_error(plant, x, v, v1, s, k1, k4, d):
    """Bound of the velocity error of one step from v to v1 by what bends over a low velocity."""
    excess, inverse = plant.numbers[EXCESS], plant.numbers[INVERSE_STRIBECK_SPEED]
    error = 0.0
    if has_bends(plant):
        error = _law_bends_error(plant, x, v, v1, s, k1, k4, d)
    if excess == 0.0:
        return error
    q = (min(s * v, s * v1) - plant.numbers[STICK_SPEED]) * inverse
    q = q * q if q > 0.0 else 0.0
    if q >= _STRIBECK_REACH:
        return error
    level = base_level(plant, x, s)
    if plant.integers[N_LEVEL] > 0:
        level *= _RAISED
    fades = min(1.0, math.exp(-q) * (1.0 + q) * (1.0 + q))
    force = level * excess * plant.numbers[INVERSE_MASS]
    return error + _bend_error(force, fades, inverse, k1, k4, d)


@internal
def _bend_step(above, then, d):
    """Longest part of a step of length d, from and to these velocities, that skips no bend."""
    # In velocities over which it bends: the friction is constant below 0 and far above.
    change = abs(then - above)
    if change <= 1.0 or max(above, then) <= 0.0 or min(above, then) >= _STRIBECK_EDGE:
        return d
    outside = -above if above < 0.0 else above - _STRIBECK_EDGE
    return d * min(1.0, max(outside, 0.7) / change)


@internal
def _law_bends_step(plant, v, v1, s, d):
    """The same for all laws of effects."""
    numbers, i, first, step = plant.numbers, plant.integers, plant.integers[N_INPUT], d
    for k in range(first, first + i[N_FORCE] + i[N_LEVEL]):
        law = i[LAWS + 2 * k + 1]
        if numbers[law + BEND] < MOST_SLOPE and numbers[law + BY_VELOCITY] > 0.0:
            inverse = 1.0 / numbers[law + BEND]
            step = min(step, _bend_step(s * v * inverse, s * v1 * inverse, d))
    return step


@internal(forceinline=True)
def peak_step(plant, v, v1, s, d):
    """Largest step length that does not skip the Stribeck peak, or a bend of an effect's law."""
    step = d
    if has_bends(plant):
        step = _law_bends_step(plant, v, v1, s, d)
    if plant.numbers[EXCESS] == 0.0:
        return step
    sigma, inverse = plant.numbers[STICK_SPEED], plant.numbers[INVERSE_STRIBECK_SPEED]
    if abs(v1 - v) * inverse <= 1.0:
        return step
    return min(step, _bend_step((s * v - sigma) * inverse, (s * v1 - sigma) * inverse, d))


@internal
def _crossing(a, rate, b, last_rate):
    """Part of a step at which a cubic vanishes: its values and rates at both ends."""
    sign = 1.0 if a > 0.0 else -1.0
    low, flow, high, fhigh, side = 0.0, sign * a, 1.0, sign * b, 0
    for _ in range(_ROOT_TURNS):
        c = secant_point(low, flow, high, fhigh)
        if c == high or high - low < SAME_END * 1e-3:
            break
        left = 1.0 - c
        value = a * left * left * (1.0 + 2.0 * c) + b * c * c * (3.0 - 2.0 * c)
        value += c * left * (rate * left - last_rate * c)
        low, flow, high, fhigh, side = illinois_bracket(
            low, flow, high, fhigh, side, c, sign * value
        )
    return high


@internal
def edge_step(before, v, after, v1, d, cut):
    """Length of a step of length d that ends where a distance vanishes, or `cut` if shorter."""
    if before * after < 0.0:
        part = _crossing(before, v * d, after, v1 * d)
        if SAME_END < part < 1.0 - SAME_END:
            return min(cut, part * d)
    return cut


@internal
def kink_step(plant, t, x, v, w, x1, v1, w1, s, rest, d):
    """Length of a step that ends where a force bends; d without such a place.  w: the load."""
    numbers, i, cut = plant.numbers, plant.integers, d
    first = i[CORNERS] + i[N_CORNERS]
    for k in range(first, first + i[N_EDGES]):
        cut = edge_step(x - numbers[k], v, x1 - numbers[k], v1, d, cut)
    # What depends on the load does on its magnitude.
    if i[N_CARRIED] > 0:
        start = _transmission_load(plant, t, x, v, w, s, rest)
        end = _transmission_load(plant, t + d, x1, v1, w1, s, rest)
        turn = start / (start - end) if start * end < 0.0 else 0.0
        if _SAME_END_OF_SECANT < turn < 1.0 - _SAME_END_OF_SECANT:
            cut = min(cut, turn * d)
    return cut


@internal(forceinline=True)
def has_kinks(plant):
    """Whether a step ends where a force bends: at a place, or where the load changes direction."""
    # What noise hides needs no such step.
    kinks = plant.integers[N_EDGES] + plant.integers[N_CARRIED]
    return kinks > 0 and plant.numbers[ALLOWED] == 0.0


@internal(forceinline=True)
def has_bends(plant):
    """Whether a law of an effect that bends over a low velocity limits a step."""
    return plant.integers[N_BENDING] > 0 and plant.numbers[ALLOWED] == 0.0


@internal
def band_excess(plant, drive, t0, tau, x, v, s):
    """Distance of the load from the Coulomb band, negative inside it."""
    w = load(plant, drive, t0, tau, x, v, s, 0.0)
    t = t0 + tau
    if s * w > 0.0:
        return s * w - _holding_level(plant, t, x, v, w, s)
    return -s * w - _holding_level(plant, t, x, v, w, -s)


#: How a sliding step ends: it goes on, or is to be divided, or reaches a switching surface.
_ON, _DIVIDED, _OUTER, _ZERO, _BAND = range(-2, 3)


@internal
def _surface(plant, drive, t0, tau, x, v, s, kind):
    """Switching function that falls through zero at the switch."""
    if kind == _OUTER:
        return s * v - plant.numbers[STICK_SPEED]
    if kind == _ZERO:
        return s * v
    return band_excess(plant, drive, t0, tau, x, v, s)


@internal
def _cut(plant, drive, t0, tau, x, v, s, k1, d, kind, upper):
    """Length of the step that ends on a switching surface; `upper`: its function, at the end."""
    a, b, fb, side = 0.0, d, upper, 0
    fa = _surface(plant, drive, t0, tau, x, v, s, kind)
    if fa <= 0.0:
        return 0.0
    for _ in range(100):
        c = secant_point(a, fa, b, fb)
        if b - a <= 1e-15 * d or fb == 0.0 or c == b:
            break
        xc, vc, _, _, _, _ = slide(plant, drive, t0, tau, x, v, s, k1, c)
        fc = _surface(plant, drive, t0, tau + c, xc, vc, s, kind)
        a, fa, b, fb, side = illinois_bracket(a, fa, b, fb, side, c, fc)
    return b


@internal
def hold_excess(plant, drive, t0, tau, x, v, rest):
    """Excess of the load over the holding force of a stuck axis, and its direction."""
    w = load(plant, drive, t0, tau, x, v, 0.0, rest)
    s = 1.0 if w > 0.0 else -1.0
    return s * w - breakaway_level(plant, t0 + tau, x, w, s, rest), s


@internal(forceinline=True)
def drive_rate(drive):
    """Largest rate of the drive force in the interval [N/s]."""
    return abs(drive.slope) + abs(drive.fade) * drive.rate


@internal(forceinline=True)
def _slope_rate(numbers, law, speed, acceleration):
    """Largest rate of the force of a law, but for its load; `law`: of its first parameter."""
    by_motion = numbers[law + BY_PLACE] * speed + numbers[law + BY_VELOCITY] * acceleration
    return numbers[law + BY_TIME] + by_motion


@internal
def _map_slope(plant, first, count):
    """Largest slope of the Coulomb map over the travel, given its coefficients."""
    reach = max(abs(plant.numbers[LOW]), abs(plant.numbers[HIGH]))
    slope = 0.0
    power = 1.0
    for i in range(1, count):
        slope += i * abs(plant.numbers[first + i]) * power
        power *= reach
    return slope


@internal(forceinline=True)
def raised_level(plant, x):
    """What the Coulomb level is at most while the axis moves a little."""
    return _RAISED * max(base_level(plant, x, 1.0), base_level(plant, x, -1.0))


@internal(forceinline=True)
def peak_rate(plant, level, acceleration):
    """Largest rate of the Stribeck peak on a Coulomb level [N/s]."""
    numbers = plant.numbers
    if numbers[EXCESS] <= 0.0:
        return 0.0
    steepest = _STEEPEST_PEAK * numbers[EXCESS] * numbers[INVERSE_STRIBECK_SPEED]
    return level * steepest * acceleration


@internal
def hold_rate(plant, changing, x, speed, acceleration):
    """Largest rates of load and of level [N/s], under a drive that is `changing` so fast."""
    numbers, i = plant.numbers, plant.integers
    level = raised_level(plant, x)
    force, friction = i[N_INPUT], i[N_INPUT] + i[N_FORCE]
    by_drive, forces = 1.0, abs(numbers[KNOWN_RATE])
    for k in range(force, friction):
        law = i[LAWS + 2 * k + 1]
        by_drive += numbers[law + BY_LOAD]
        forces += _slope_rate(numbers, law, speed, acceleration)
    by_load, levels, raised = 0.0, 0.0, 1.0 + numbers[EXCESS]
    for k in range(friction, friction + i[N_LEVEL]):
        law = i[LAWS + 2 * k + 1]
        share = raised if k < friction + i[N_PEAKED] else 1.0
        by_load += share * numbers[law + BY_LOAD]
        unit = level if numbers[law + RELATIVE] != 0.0 else 1.0
        levels += share * unit * _slope_rate(numbers, law, speed, acceleration)
    levels += peak_rate(plant, level, acceleration)
    if i[N_PLUS] + i[N_MINUS] > 2:
        plus = _map_slope(plant, COULOMB, i[N_PLUS])
        minus = _map_slope(plant, COULOMB + i[N_PLUS], i[N_MINUS])
        levels += raised * max(plus, minus) * speed
    loads = by_drive * changing + forces
    return loads, levels + by_load * loads


@internal(forceinline=True)
def _rest_rate(plant, drive, x, v):
    """Largest rate of load and level together while the axis is at rest [N/s]."""
    speed = abs(v)
    braking = plant.numbers[STICK_RATE] * speed
    loads, levels = hold_rate(plant, drive_rate(drive), x, speed, braking)
    return loads + levels


@internal
def _decay(plant, x, v, d):
    """Stuck motion over d: exact solution of v' = -p v."""
    if v == 0.0:
        return x, v
    fall = -math.expm1(-plant.numbers[STICK_RATE] * d)
    after = v - v * fall
    # Without a lower limit the velocity would decay into denormal numbers, which are slow.
    return x + v * fall / plant.numbers[STICK_RATE], after if abs(after) > 1e-250 else 0.0


@internal
def resolve(plant, t, x, v, mode, rest, w):
    """Mode and velocity at an instant at which the load may have jumped."""
    if mode == 0:
        if abs(v) > plant.numbers[STICK_SPEED]:
            return (1 if v > 0.0 else -1), v
        s = 1.0 if w > 0.0 else -1.0
        if s * w > breakaway_level(plant, t, x, w, s, rest):
            # An axis that breaks away against its remaining velocity loses it.
            return int(s), (v if s * v > 0.0 else 0.0)
        return 0, v
    s = float(mode)
    if s * v < 0.0:
        # Reached only with the printed rule or a state given from outside.
        mode, s = -mode, -s
    if s * v <= plant.numbers[STICK_SPEED]:
        side = s if s * w > 0.0 else -s
        if abs(w) <= _holding_level(plant, t, x, v, w, side):
            return 0, v
    return mode, v


@internal(forceinline=True)
def begin(plant, drive, t, x, v, mode, rest):
    """Mode, velocity, friction force and acceleration at the start of an interval."""
    w = load(plant, drive, t, 0.0, x, v, float(mode), rest)
    after, v = resolve(plant, t, x, v, mode, rest, w)
    if after == 0:
        return 0, v, w, 0.0
    s = float(after)
    if after != mode:
        w = load(plant, drive, t, 0.0, x, v, s, 0.0)
    friction = s * sliding_level(plant, t, x, v, w, s)
    return after, v, friction, acceleration(plant, w, v, friction)


@internal
def at_zero(plant, t, x, w, mode):
    """Mode after a sliding velocity has fallen to zero (completed rule)."""
    s = float(mode)
    if -s * w > breakaway_level(plant, t, x, w, -s, 0.0):
        return -mode
    if s * w <= sliding_level(plant, t, x, 0.0, w, s):
        return 0
    return mode


@njit(cache=True, error_model="numpy")
def empty_tally(events, most=MAX_SWITCHES):
    """Tally of an empty list of switches."""
    count = np.zeros(4, np.int64)
    count[HELD] = events.shape[0] // 3
    count[MOST] = most
    return count


@njit(cache=True, error_model="numpy")
def record(events, count, t, before, after, nth=0):
    """Append a switch, the nth of its stretch; lost if there is no room or too many."""
    k = count[LISTED]
    if k >= count[HELD] or nth == count[MOST]:
        count[LOST] += 1
        return
    events[3 * k] = t
    events[3 * k + 1] = before
    events[3 * k + 2] = after
    count[LISTED] = k + 1


@njit(cache=True, error_model="numpy", forceinline=True)
def switching_pause(tau, last, h, close, pause):
    """Count of successive close switches, length of the next pause, and when switching resumes."""
    close = close + 1 if tau - last < CLOSE * h else 0
    if close < MOST_CLOSE:
        return close, pause, tau
    return 0, 2.0 * pause, tau + pause


@internal(forceinline=True)
def _breakaway_can_vary(plant, drive):
    """Whether load or level can change while the axis is at rest."""
    i = plant.integers
    return (
        i[N_FORCE] + i[N_LEVEL] > 0
        or i[N_PLUS] + i[N_MINUS] > 2
        or drive.slope != 0.0
        or drive.fade != 0.0
        or plant.numbers[KNOWN_RATE] != 0.0
    )


@internal
def _kinked(plant, drive, t0, tau, x, v, x1, v1, s, d):
    """Length of a sliding step that ends where a force bends, see `kink_step`."""
    w = load(plant, drive, t0, tau, x, v, s, 0.0)
    w1 = load(plant, drive, t0, tau + d, x1, v1, s, 0.0)
    return kink_step(plant, t0 + tau, x, v, w, x1, v1, w1, s, 0.0, d)


@internal(forceinline=True)
def _try_one_step(plant, drive, t0, h, x, v, mode, rest, k1):
    """Try the interval in one step: whether no switch is near, the new state, a length to try."""
    if mode == 0:
        x1, v1 = _decay(plant, x, v, h)
        if _breakaway_can_vary(plant, drive):
            start, _ = hold_excess(plant, drive, t0, 0.0, x, v, rest)
            end, _ = hold_excess(plant, drive, t0, h, x1, v1, rest + h)
            if end > 0.0:
                return False, x, v, h
            return start + end <= -h * _rest_rate(plant, drive, x, v), x1, v1, h
        return True, x1, v1, h
    s = float(mode)
    sigma = plant.numbers[STICK_SPEED]
    if s * v <= sigma:
        return False, x, v, h
    x1, v1, k2, k3, k4, placed = slide(plant, drive, t0, 0.0, x, v, s, k1, h)
    allowed = TOLERANCE * (abs(v) + sigma + h * abs(k1)) + plant.numbers[ALLOWED]
    lowest = s * v1
    if s * k1 < 0.0 and s * k4 > 0.0:
        part = k1 / (k1 - k4)
        lowest = min(lowest, s * (v + 0.5 * part * h * k1))
    error = step_error(plant, drive, k1, k2, k3, k4, placed, x1 - x, h, allowed)
    error += peak_error(plant, x, v, v1, s, k1, k4, h)
    length = min(accurate_step(plant, x1 - x, error, allowed, h), peak_step(plant, v, v1, s, h))
    if length == h and has_kinks(plant):
        length = _kinked(plant, drive, t0, 0.0, x, v, x1, v1, s, h)
    calm = lowest > sigma and h <= plant.numbers[SHORT_TIME] and length == h
    return calm, x1, v1, length


@internal
def _hold_later(plant, drive, t0, tau, x, v, rest, d):
    """Excess of the load over the holding force after d more at rest, and its direction."""
    xd, vd = _decay(plant, x, v, d)
    return hold_excess(plant, drive, t0, tau + d, xd, vd, rest + d)


@internal
def _first_excess(plant, drive, t0, tau, x, v, rest, a, b, s):
    """When the load exceeds the holding force between a, where it does not, and b; direction."""
    for _ in range(60):
        c = 0.5 * (a + b)
        if not a < c < b:
            break
        above, side = _hold_later(plant, drive, t0, tau, x, v, rest, c)
        if above > 0.0:
            b, s = c, side
        else:
            a = c
    return b, s


@internal
def _peak_between(plant, drive, t0, tau, x, v, rest, a, b, start, end):
    """Highest excess on the parabola through both ends and the middle: when, how much, side."""
    c = 0.5 * (a + b)
    middle, s = _hold_later(plant, drive, t0, tau, x, v, rest, c)
    bend = start - 2.0 * middle + end
    if middle > 0.0 or bend >= 0.0 or abs(end - start) >= -2.0 * bend:
        return c, middle, s
    peak = c + 0.25 * (b - a) * (start - end) / bend
    high, s = _hold_later(plant, drive, t0, tau, x, v, rest, peak)
    return peak, high, s


@internal
def _release(plant, drive, t0, tau, x, v, rest, d):
    """Whether a stuck axis breaks away within d, when, and in which direction."""
    # The excess of load over level changes at most at `rate`: where it is so far below zero at
    # both ends of a stretch that it cannot come back in between, nothing happens there.
    rate = _rest_rate(plant, drive, x, v)
    finest = min(d, plant.numbers[SHORT_TIME])
    if drive.fade != 0.0:
        finest = min(finest, 1.0 / drive.rate)
    finest *= _FINEST_LOOK
    a, length = 0.0, d
    start, _ = _hold_later(plant, drive, t0, tau, x, v, rest, 0.0)
    while a < d:
        b = a + length if length < d - a else d
        end, s = _hold_later(plant, drive, t0, tau, x, v, rest, b)
        sure = end <= 0.0 and start + end <= -rate * (b - a)
        if not sure and b - a > 1.01 * finest:
            length = margin_step(b - a, -start, rate, finest)
            continue
        if not sure and end <= 0.0:
            peak, high, side = _peak_between(plant, drive, t0, tau, x, v, rest, a, b, start, end)
            if high > 0.0:
                b, end, s = peak, high, side
        if end > 0.0:
            b, s = _first_excess(plant, drive, t0, tau, x, v, rest, a, b, s)
            return True, b, s
        length, a, start = max(2.0 * (b - a), finest), b, end
    return False, d, 1.0


@internal(forceinline=True)
def accurate_step(plant, way, error, allowed, d):
    """Length of the step to try instead of one of length d; d if that is accurate enough."""
    if not (abs(way) < math.inf and error < math.inf):
        return 0.1 * d  # bristles that a trial step bends back grow without bounds
    if abs(way) > plant.numbers[SHORT_WAY]:
        return 0.9 * d * plant.numbers[SHORT_WAY] / abs(way)
    return smaller_step(d, allowed, error) if error > allowed else d


@njit(cache=True, error_model="numpy", forceinline=True)
def reversal_step(v, v1, s, k1, k4, d, lowest):
    """Length of a step that ends near a reversal, or a minimum below `lowest`, inside d; else d."""
    part = k1 / (k1 - k4) if k1 != k4 else 0.0
    if v == 0.0 and s * k1 > 0.0 and s * v1 <= 0.0:
        # From rest and back to it in one step: stop near the reversal.
        return d * min(max(part, 0.1), 0.9)
    if s * k1 < 0.0 < s * k4 and s * v1 > lowest and 1e-6 < part < 1.0 - 1e-6:
        dip = v + part * d * (k1 + 0.5 * part * (k4 - k1))
        if s * dip < lowest:
            return part * d
    return d


@internal(forceinline=True)
def _sliding_end(plant, drive, t0, tau, x, v, x1, v1, s, k1, d, varies, may, divisible, flips):
    """How a sliding step ends, and its length; _DIVIDED: try that length instead."""
    # `may`: whether it may switch at zero or in the band; `divisible`: whether it may be shorter.
    sigma = plant.numbers[STICK_SPEED]
    inside = s * v <= sigma
    if s * v1 > sigma and not (inside and varies):
        return _ON, d
    end = band_excess(plant, drive, t0, tau + d, x1, v1, s)
    start = band_excess(plant, drive, t0, tau, x, v, s) if varies else end
    if divisible and varies and start > 0.0 and end > 0.0:
        w0 = load(plant, drive, t0, tau, x, v, s, 0.0)
        w1 = load(plant, drive, t0, tau + d, x1, v1, s, 0.0)
        part = w0 / (w0 - w1)
        if w0 * w1 < 0.0 and 1e-6 < part < 1.0 - 1e-6:
            # The load crosses the whole band in this step: stop inside the band, if it has any
            # width.
            return _DIVIDED, part * d
    if not inside and (start <= 0.0 or end <= 0.0):
        return _OUTER, _cut(plant, drive, t0, tau, x, v, s, k1, d, _OUTER, s * v1 - sigma)
    kind, cut = _ON, d
    if may and s * v1 <= 0.0 and (plant.integers[RULE] == FILIPPOV or flips == 0):
        kind = _ZERO
        cut = _cut(plant, drive, t0, tau, x, v, s, k1, d, _ZERO, s * v1)
    if may and inside and end <= 0.0:
        other = _cut(plant, drive, t0, tau, x, v, s, k1, d, _BAND, end)
        if kind == _ON or other < cut:
            kind, cut = _BAND, other
    return kind, cut


@internal(forceinline=True)
def _mode_after(plant, drive, t0, tau, x, v, mode, kind, d):
    """Mode and velocity after a sliding step of length d that ended in a switch."""
    s, sigma = float(mode), plant.numbers[STICK_SPEED]
    if kind == _BAND:
        return (0 if s * v <= sigma else mode), v
    if kind == _OUTER:
        v = s * sigma
        return (0 if band_excess(plant, drive, t0, tau, x, v, s) <= 0.0 else mode), v
    if plant.integers[RULE] == PAPER:
        return -mode, 0.0
    w = load(plant, drive, t0, tau, x, 0.0, s, 0.0)
    after = at_zero(plant, t0 + tau, x, w, mode)
    # Where load and level are equal up to round-off, it rests.
    return (0 if after == mode and d == 0.0 else after), 0.0


@internal(inline="always")
def _walk(plant, drive, t0, h, memory, events, count, x, v, mode, rest, k1, longest):
    """Move over an interval that contains switches or needs more than one step."""
    sigma = plant.numbers[STICK_SPEED]
    varies = _breakaway_can_vary(plant, drive)
    tau = 0.0
    switches = 0
    flips = 0
    close, pause, resume, last = 0, CLOSE * h, 0.0, -h
    fresh = False  # whether k1 must be recomputed
    while tau < h:
        # The mode is held until `resume`, see `switching_pause`.
        bound = h if tau >= resume else min(resume, h)
        may = tau >= resume and switches < count[MOST]
        if mode == 0:
            d = bound - tau
            s = 1.0
            found = False
            if varies and may:
                found, d, s = _release(plant, drive, t0, tau, x, v, rest, d)
            x, v = _decay(plant, x, v, d)
            tau += d
            rest += d
            if found:
                switches += 1
                record(events, count, t0 + tau, 0, int(s), switches)
                mode, rest, fresh, longest = int(s), 0.0, True, h
                close, pause, resume = switching_pause(tau, last, h, close, pause)
                last = tau
                if s * v < 0.0:
                    v = 0.0
            continue

        s = float(mode)
        if fresh:
            k1 = _acceleration(plant, drive, t0, tau, x, v, s)
            fresh = False
        d = min(longest, bound - tau, plant.numbers[SHORT_TIME])
        x1, v1, k2, k3, k4, placed = slide(plant, drive, t0, tau, x, v, s, k1, d)
        allowed = TOLERANCE * (abs(v) + sigma + d * abs(k1)) + plant.numbers[ALLOWED]
        error = step_error(plant, drive, k1, k2, k3, k4, placed, x1 - x, d, allowed)
        error += peak_error(plant, x, v, v1, s, k1, k4, d)
        divisible = d > SHORTEST * h
        if divisible:
            cut = accurate_step(plant, x1 - x, error, allowed, d)
            if cut == d:
                cut = peak_step(plant, v, v1, s, d)
                if cut >= 0.99 * d:
                    cut = reversal_step(v, v1, s, k1, k4, d, 0.0 if s * v <= sigma else sigma)
                if cut >= 0.99 * d and has_kinks(plant):
                    cut = _kinked(plant, drive, t0, tau, x, v, x1, v1, s, d)
            if cut < d:
                longest = cut
                continue
        kind, cut = _sliding_end(
            plant, drive, t0, tau, x, v, x1, v1, s, k1, d, varies, may, divisible, flips
        )
        if kind == _DIVIDED:
            longest = cut
            continue
        if kind == _ON:
            x, v, fresh = x1, v1, True
            tau += d
            if tau + SHORTEST * h >= h:
                tau = h
            if longest < h:
                longest = larger_step(d, allowed, error)
            continue

        x, v, _, _, _, _ = slide(plant, drive, t0, tau, x, v, s, k1, cut)
        tau += cut
        fresh, longest = True, h
        if kind == _ZERO and plant.integers[RULE] == PAPER:
            # The printed rule alone would switch endlessly inside the sample.
            flips += 1
        after, v = _mode_after(plant, drive, t0, tau, x, v, mode, kind, cut)
        if after != mode:
            switches += 1
            record(events, count, t0 + tau, mode, after, switches)
            mode, rest = after, 0.0
            close, pause, resume = switching_pause(tau, last, h, close, pause)
            last = tau

    memory[X], memory[V], memory[MODE], memory[REST] = x, v, mode, rest


@internal(inline="always")
def _advance_rigid(plant, drive, t0, h, memory, events, count):
    """Move an axis without inner states, see `advance`."""
    x, v, mode, rest = memory[X], memory[V], int(memory[MODE]), memory[REST]
    first, v, friction, k1 = begin(plant, drive, t0, x, v, mode, rest)
    if first != mode:
        record(events, count, t0, mode, first)
        mode, rest = first, 0.0
    calm, x1, v1, length = _try_one_step(plant, drive, t0, h, x, v, mode, rest, k1)
    if calm:
        memory[X], memory[V], memory[MODE] = x1, v1, mode
        memory[REST] = rest + h if mode == 0 else 0.0
    else:
        _walk(plant, drive, t0, h, memory, events, count, x, v, mode, rest, k1, length)
    return v, friction, first


def _rigid_task(
    task, numbers, integers, start, slope, fade, rate, t0, h, memory, events, count, seen
):
    """Perform a task of an axis without inner states; velocity, friction, mode."""
    plant, drive = Plant(numbers, integers), Drive(start, slope, fade, rate)
    if task == ADVANCE:
        v, friction, mode = _advance_rigid(plant, drive, t0, h, memory, events, count)
    else:
        mode, v, friction, _ = begin(
            plant, drive, t0, memory[X], memory[V], int(memory[MODE]), memory[REST]
        )
    seen[0], seen[1], seen[2] = v, friction, mode


@functools.cache
def rigid_task():
    """Function that moves an axis without inner states, compiled on first use."""
    return cfunc(TASK_CALL, cache=True, error_model="numpy")(_rigid_task)


@internal
def perform_task(plant, place, task, drive, t0, h, memory, events, count):
    """Perform a task by the function whose address is at index `place` of the integers."""
    # Called by its address, it is compiled once instead of into each of its callers.
    seen = spare_memory()
    _call_task(
        plant.integers[place], task, plant.numbers, plant.integers, drive.start, drive.slope,
        drive.fade, drive.rate, t0, h, memory, events, count, seen,
    )  # fmt: skip
    return seen[0], seen[1], int(seen[2])


@internal
def advance(plant, drive, t0, h, memory, events, count):
    """Move the axis over [t0, t0 + h]; velocity, friction force and mode at t0."""
    # `memory` is changed in place; each switch is appended to `events` (time, mode before, mode
    # after) and counted in `count`.
    return perform_task(plant, TASK, ADVANCE, drive, t0, h, memory, events, count)


@internal
def encoder_reading(plant, t, memory):
    """What an encoder without increments reads."""
    x = memory[X]
    if plant.integers[STRUCTURE] & ON_LOAD:
        x += memory[OFFSET]
    first = plant.integers[N_INPUT] + plant.integers[N_FORCE] + plant.integers[N_LEVEL]
    added = 0.0
    for i in range(first, first + plant.integers[N_READING]):
        added += _law(plant, i, t, x, memory[V], 0.0, 0.0, 0.0, 0.0)
    return x + added


@internal
def place(plant, t, dt, y, memory):
    """Set position and velocity so that the encoder reads y and its derivative."""
    memory[X] = y
    if plant.integers[STRUCTURE] & ON_LOAD:
        memory[X] -= memory[OFFSET]
    if plant.integers[N_READING] > 0:
        # The encoder error varies slowly with position: the fixed-point iteration converges.
        for _ in range(_TURNS):
            memory[X] += y - encoder_reading(plant, t, memory)
        x, way = memory[X], memory[V] * dt
        if way != 0.0:
            memory[X] = x + way
            read = encoder_reading(plant, t, memory) - y
            memory[X] = x
            if 0.1 < read / way < 10.0:
                memory[V] *= way / read


@internal
def input_map(plant, t, memory, u):
    """Drive force after the static input effects."""
    for i in range(plant.integers[N_INPUT]):
        u = _law(plant, i, t, memory[X], memory[V], u, 0.0, 0.0, 0.0)
    return u


@internal
def next_corner(plant, u0, u1, part):
    """First fraction beyond `part` of a way from u0 to u1 at which the input laws bend, or 1."""
    following = 1.0
    for k in range(plant.integers[N_CORNERS]):
        here = (plant.numbers[plant.integers[CORNERS] + k] - u0) / (u1 - u0)
        # What is left of the way is not divided for round-off.
        if part + SHORTEST < here < following - SHORTEST:
            following = here
    return following


@internal
def is_straight(plant, u0, u1):
    """Whether the input laws are linear between two inputs."""
    if plant.integers[N_CORNERS] == 0 or u0 == u1:
        return True
    return next_corner(plant, u0, u1, 0.0) == 1.0


@internal(forceinline=True)
def _advance_straight(plant, t, start, end, h, memory, events, count):
    """Move the axis over h, in which the drive before its lag runs from start to end."""
    slope, lag = (end - start) / h, plant.numbers[LAG]
    if lag <= 0.0:
        return advance(plant, Drive(start, slope, 0.0, 0.0), t, h, memory, events, count)
    return _advance_lagged(plant, t, start - slope * lag, slope, lag, h, memory, events, count)


@internal
def _advance_lagged(plant, t, level, slope, lag, h, memory, events, count):
    """Move the axis over h, in which a lagged drive nears the line level + slope tau."""
    drive = Drive(level, slope, memory[LAGGED] - level, 1.0 / lag)
    near = _LAG_REACH * lag
    if near > 0.5 * h:
        near = h
    seen = advance(plant, drive, t, near, memory, events, count)
    memory[LAGGED] = drive_force(drive, near)
    # A lag far shorter than the sample is over soon, and no bound on its rate is needed after that.
    if near < h:
        line = Drive(level + slope * near, slope, 0.0, 0.0)
        advance(plant, line, t + near, h - near, memory, events, count)
        memory[LAGGED] = level + slope * h
    return seen


@internal
def _advance_bent(plant, t, u0, u1, h, memory, events, count):
    """Move the axis over h, in which the input laws bend between the inputs u0 and u1."""
    # The drive is linear between the inputs at which it bends.
    start, end = input_map(plant, t, memory, u0), input_map(plant, t, memory, u1)
    seen = (0.0, 0.0, 0)
    part = 0.0
    for k in range(plant.integers[N_CORNERS] + 1):
        following = next_corner(plant, u0, u1, part)
        after = end
        if following < 1.0:
            after = input_map(plant, t, memory, u0 + following * (u1 - u0))
        first = _advance_straight(
            plant, t + part * h, start, after, (following - part) * h, memory, events, count
        )
        if k == 0:
            seen = first
        start, part = after, following
        if part == 1.0:
            break
    return seen


@internal(forceinline=True)
def _advance_piece(plant, t, u0, u1, h, memory, events, count):
    """Move the axis over h, in which the input runs from u0 to u1."""
    if is_straight(plant, u0, u1):
        start = input_map(plant, t, memory, u0)
        end = start if u1 == u0 else input_map(plant, t, memory, u1)
        return _advance_straight(plant, t, start, end, h, memory, events, count)
    return _advance_bent(plant, t, u0, u1, h, memory, events, count)


@njit(cache=True, error_model="numpy")
def _whole_samples(delay, dt):
    """Delay as whole samples and the rest as a fraction of a sample."""
    n = int(delay / dt)
    part = delay / dt - n
    if part > 1.0 - 1e-9:
        return n + 1, 0.0
    return n, (part if part > 1e-9 else 0.0)


@internal
def sample(plant, t, dt, u0, u1, memory, events, count):
    """One sample: the input runs from u0 to u1; velocity, friction force and mode at t."""
    # The delay line in `memory` holds pairs of first and last input, newest first.
    if plant.numbers[DELAY] <= 0.0:
        return _advance_piece(plant, t, u0, u1, dt, memory, events, count)

    # The delay is n whole samples and a fraction: the delayed input changes inside the
    # sample, which is therefore integrated in two pieces.
    n, part = _whole_samples(plant.numbers[DELAY], dt)
    seen = (0.0, 0.0, 0)
    last = plant.integers[N_HISTORY] - 1
    for k in range(last, 0, -1):
        memory[HISTORY + 2 * k] = memory[HISTORY + 2 * k - 2]
        memory[HISTORY + 2 * k + 1] = memory[HISTORY + 2 * k - 1]
    memory[HISTORY], memory[HISTORY + 1] = u0, u1
    if part > 0.0:
        old = HISTORY + 2 * (n + 1)
        start = memory[old] + (memory[old + 1] - memory[old]) * (1.0 - part)
        seen = _advance_piece(plant, t, start, memory[old + 1], part * dt, memory, events, count)
    new = HISTORY + 2 * n
    stop = memory[new] + (memory[new + 1] - memory[new]) * (1.0 - part)
    after = _advance_piece(
        plant, t + part * dt, memory[new], stop, (1.0 - part) * dt, memory, events, count
    )
    return seen if part > 0.0 else after


@internal
def drive_now(plant, t, dt, memory, u):
    """Drive force that acts at the sample instant when the input is u."""
    if plant.numbers[LAG] > 0.0:
        return memory[LAGGED]
    if plant.numbers[DELAY] > 0.0:
        n, part = _whole_samples(plant.numbers[DELAY], dt)
        if part > 0.0:
            old = HISTORY + 2 * n
            u = memory[old] + (memory[old + 1] - memory[old]) * (1.0 - part)
        elif n > 0:
            u = memory[HISTORY + 2 * (n - 1)]
    return input_map(plant, t, memory, u)


@internal
def settle(plant, t, dt, memory, u, inertia=0.0):
    """Set the inner states to those at rest or steady sliding.

    `inertia`: force that accelerates the axis, with two masses the one that is free.
    """
    if plant.integers[STRUCTURE] == 0:
        return
    drive = Drive(drive_now(plant, t, dt, memory, u) - inertia, inertia, 0.0, 0.0)
    perform_task(plant, TASK, SETTLE, drive, t, 0.0, memory, memory, plant.integers)


@internal
def outputs(plant, t, dt, memory, u):
    """Velocity, friction force and mode at the sample instant, under the new input."""
    drive = held_force(drive_now(plant, t, dt, memory, u))
    # This task changes no state and needs no list of switches.
    return perform_task(plant, TASK, _LOOK, drive, t, 0.0, memory, memory, plant.integers)


@njit(cache=True, error_model="numpy")
def step(numbers, integers, memory, t, dt, u):
    """One sample of a held input, for a caller that needs no list of switches."""
    plant = point(numbers, integers)
    events = np.empty(3)
    count = empty_tally(events)
    sample(plant, t, dt, u, u, pointer(memory), pointer(events), pointer(count))
    keep_alive(events)
    keep_alive(count)


@njit(cache=True, error_model="numpy")
def outputs_now(numbers, integers, memory, t, dt, u):
    """Velocity, friction force and mode at a sample instant with input u."""
    return outputs(point(numbers, integers), t, dt, pointer(memory), u)


@njit(cache=True, error_model="numpy")
def reading_now(numbers, integers, memory, t):
    """What an encoder without increments reads."""
    return encoder_reading(point(numbers, integers), t, pointer(memory))


@njit(cache=True, error_model="numpy")
def mode_rate(numbers, integers, t, x, v, u, mode):
    """Acceleration and friction force in a given mode, without switching."""
    plant = point(numbers, integers)
    memory = np.array([x, v, float(mode), 0.0, 0.0])
    s = float(mode)
    w = load_under(plant, input_map(plant, t, pointer(memory), u), t, x, v, s, 0.0)
    keep_alive(memory)
    if mode == 0:
        return -plant.numbers[STICK_RATE] * v, w
    friction = s * sliding_level(plant, t, x, v, w, s)
    return acceleration(plant, w, v, friction), friction


@njit(cache=True, error_model="numpy")
def longer_list(events, count):
    """The list of switches in an array twice as long."""
    # Not called for every sample: to hand an array on counts its references.
    longer = np.empty(2 * events.shape[0])
    for i in range(events.shape[0]):
        longer[i] = events[i]
    count[HELD] = longer.shape[0] // 3
    return longer


@njit(cache=True, error_model="numpy")
def switch_rows(events, count):
    """The first switches of the list as rows of time, mode before, mode after."""
    rows = np.empty((count, 3))
    for i in range(count):
        for j in range(3):
            rows[i, j] = events[3 * i + j]
    return rows


@njit(cache=True, error_model="numpy")
def run(numbers, integers, memory, u, known, dt, first, room, out):
    """Simulate a record into `out`, rows x, v, friction, mode; located switches, and how many lost.

    `known`: force on the mass that is known, shape (n,), or (0,) for none; `first` selects
    first-order hold; `room`: for the switches of one sample.
    """
    own = numbers.copy()
    plant = point(own, integers)
    state = pointer(memory)
    n = u.shape[0]
    if known.shape[0] > 0:
        set_known_force(plant, 0.0, dt, known, 0, first)
    # The initial mode is set without recording a switch.
    state[MODE] = outputs(plant, 0.0, dt, state, u[0])[2]
    events = np.empty(64 * room)
    count = empty_tally(events)
    for k in range(n - 1):
        if 3 * count[LISTED] + room > events.shape[0]:
            events = longer_list(events, count)
        t, end = k * dt, u[k + 1] if first else u[k]
        if known.shape[0] > 0:  # to hand an array on counts its references
            set_known_force(plant, t, dt, known, k, first)
        out[0, k] = encoder_reading(plant, t, state)
        out[1, k], out[2, k], out[3, k] = sample(
            plant, t, dt, u[k], end, state, pointer(events), pointer(count)
        )
    t = (n - 1) * dt
    if known.shape[0] > 0:
        set_known_force(plant, t, dt, known, n - 1, first)
    out[0, n - 1] = encoder_reading(plant, t, state)
    out[1, n - 1], out[2, n - 1], out[3, n - 1] = outputs(plant, t, dt, state, u[n - 1])
    keep_alive(own)
    return switch_rows(events, count[LISTED]), count[LOST]
