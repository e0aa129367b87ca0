"""Compiled motion of an axis whose effects have states of their own.

An effect with a memory declares states z, their flow, and limits between which they stay::

    sliding   x' = v,  m v' = w(z) - f v - s F_s(x, v, z),  z' = flow(t, x, v, u, level, s, z)
    stuck     x' = v,  v' = -p v,                           z' = flow(t, x, v, u, level, 0, z)

A state at a limit stays there while its flow points beyond it; as it gets there, it may jump.  The
laws read the states behind their parameters, in a copy of the numbers of the axis that belongs to
the memory of the run.  Modes and switching rules are those of `axis_step`.

All is integrated by the pair of orders 5(4) of Dormand and Prince (J. Comput. Appl. Math. 6, 1980);
a resting axis loses its velocity in closed form.  A step that meets a limit or a switching surface
is shortened to end there.
"""

from __future__ import annotations

import functools
import math

from llvmlite import ir
from numba import cfunc, types
from numba.extending import intrinsic

from dryfric_control.compiled import axis_step as step
from dryfric_control.compiled.axis_step import LAWS, N_STATES, STATES
from dryfric_control.compiled.roots import (
    illinois_bracket,
    larger_step,
    margin_step,
    secant_point,
    smaller_step,
)

#: Rate of a state, or where it jumps: f(number of the state, then the arguments of a law).
FLOW = types.float64(types.int64, *step.LAW.args)

#: Indices in the row of a state: its place in the numbers, that of its lower limit, which the
#: upper one follows, its number in its effect, the number of the law of the effect, and the
#: addresses of flow and jump, 0 where it does not jump.
PLACE, LIMITS, NUMBER, LAW_OF, FLOW_OF, JUMP_OF = range(6)
#: Length of the row.
STATE_ROW = 6

#: Blocks of the work memory, each with x, v and all states: state at the start and at the end of a
#: step, limits, the sides at which states are held, and states that are kept for later; the rates
#: of the seven stages follow.
_START, _END, _LOW, _HIGH, _HELD, _KEPT, _STAGES = range(7)
#: Number of all blocks.
BLOCKS = _STAGES + 7

# How a step ends beyond the ways of a rigid axis: a state reaches a limit, or a stuck axis breaks
# away.
_LIMIT = 3
_RELEASE = 4
# Most evaluations of a step for the instant at which it ends.
_TURNS = 100
# Part of a step to which that instant is found.
_EXACT = 1e-15
# Shortest stretch at rest in which a load that nears its level is looked for, as a fraction of the
# times over which it varies.
_FINEST_LOOK = 1e-2
# Safety factor of the rate at which states change the load at rest, seen from both ends.
_RATE_MARGIN = 2.0
# Pieces into which a motion is cut that states follow.
_PIECES = 8
# Velocity over the stick speed of the differences by which a flow is linearised.
_DIFFERENCE = 1e-3


@intrinsic
def _call_flow(typingctx, address, i, t, x, v, u, level, direction, rest, numbers, offset):
    """Call a compiled flow by its address."""
    signature = types.float64(
        types.int64, *FLOW.args[:-1], types.CPointer(types.float64), types.int64
    )

    def codegen(context, builder, signature, args):
        double = ir.DoubleType()
        kinds = [ir.IntType(64), *[double] * 7, double.as_pointer()]
        function = ir.FunctionType(double, kinds)
        callee = builder.inttoptr(args[0], function.as_pointer())
        parameters = builder.gep(args[9], [args[10]])
        return builder.call(callee, [*args[1:9], parameters])

    return signature, codegen


@step.internal(forceinline=True)
def _flow(plant, row, t, x, v, u, level, s, rest):
    """Rate of the state of a row."""
    i = plant.integers
    offset = i[LAWS + 2 * i[row + LAW_OF] + 1]
    return _call_flow(
        i[row + FLOW_OF], i[row + NUMBER], t, x, v, u, level, s, rest, plant.numbers, offset
    )


@step.internal(forceinline=True)
def _jump(plant, row, t, x, v, u, level, s, rest):
    """Value of the state of a row that has reached a limit."""
    i = plant.integers
    offset = i[LAWS + 2 * i[row + LAW_OF] + 1]
    return _call_flow(
        i[row + JUMP_OF], i[row + NUMBER], t, x, v, u, level, s, rest, plant.numbers, offset
    )


@step.internal(forceinline=True)
def first_state(plant):
    """Index of the first state in the memory of an axis."""
    return step.HISTORY + 2 * plant.integers[step.N_HISTORY]


@step.internal(forceinline=True)
def _size(plant):
    """Length of a block of the work memory."""
    return plant.integers[N_STATES] + 2


@step.internal
def _show(plant, work, block):
    """Let the laws see the states of a block."""
    own, at = BLOCKS * _size(plant), block * _size(plant) + 2
    for j in range(plant.integers[N_STATES]):
        row = plant.integers[STATES] + STATE_ROW * j
        work[own + plant.integers[row + PLACE]] = work[at + j]


@step.internal
def _level(plant, x, s):
    """Coulomb level in a direction, at rest in that of +."""
    return step.base_level(plant, x, s if s != 0.0 else 1.0)


@step.internal
def _derivative(plant, drive, t0, tau, s, rest, work, out):
    """Rates in the state at the end of a step, into the numbers from index `out` on."""
    _show(plant, work, _END)
    size = _size(plant)
    at, held = _END * size, _HELD * size + 2
    t, x, v, u = t0 + tau, work[at], work[at + 1], step.drive_force(drive, tau)
    work[out] = v
    work[out + 1] = step._acceleration(plant, drive, t0, tau, x, v, s) if s != 0.0 else 0.0
    level = _level(plant, x, s)
    for j in range(plant.integers[N_STATES]):
        row = plant.integers[STATES] + STATE_ROW * j
        rate = _flow(plant, row, t, x, v, u, level, s, rest)
        work[out + 2 + j] = 0.0 if work[held + j] * rate > 0.0 else rate


@step.internal
def _stage(plant, drive, t0, tau, s, rest, work, d, i, node, a0, a1, a2, a3, a4, a5):
    """Stage i of a step of length d, at a part `node` of it: its state, and the rates there."""
    size = _size(plant)
    start, end, k = _START * size, _END * size, _STAGES * size
    for j in range(size):
        rates = a0 * work[k + j] + a1 * work[k + size + j] + a2 * work[k + 2 * size + j]
        rates += a3 * work[k + 3 * size + j] + a4 * work[k + 4 * size + j]
        rates += a5 * work[k + 5 * size + j]
        work[end + j] = work[start + j] + d * rates
    if s == 0.0:
        x, v = step._decay(plant, work[start], work[start + 1], node * d)
        work[end] = x
        work[end + 1] = v
        rest += node * d
    _derivative(plant, drive, t0, tau + node * d, s, rest, work, k + i * size)


@step.internal
def _stride(plant, drive, t0, tau, s, rest, work, d):
    """One step of length d, sliding along s or at rest, whose first stage is known.

    The state at its end goes to its block, and the laws see it.
    """
    _stage(plant, drive, t0, tau, s, rest, work, d, 1, 1.0 / 5.0,
           1.0 / 5.0, 0.0, 0.0, 0.0, 0.0, 0.0)  # fmt: skip
    _stage(plant, drive, t0, tau, s, rest, work, d, 2, 3.0 / 10.0,
           3.0 / 40.0, 9.0 / 40.0, 0.0, 0.0, 0.0, 0.0)  # fmt: skip
    _stage(plant, drive, t0, tau, s, rest, work, d, 3, 4.0 / 5.0,
           44.0 / 45.0, -56.0 / 15.0, 32.0 / 9.0, 0.0, 0.0, 0.0)  # fmt: skip
    _stage(plant, drive, t0, tau, s, rest, work, d, 4, 8.0 / 9.0,
           19372.0 / 6561.0, -25360.0 / 2187.0, 64448.0 / 6561.0, -212.0 / 729.0,
           0.0, 0.0)  # fmt: skip
    _stage(plant, drive, t0, tau, s, rest, work, d, 5, 1.0,
           9017.0 / 3168.0, -355.0 / 33.0, 46732.0 / 5247.0, 49.0 / 176.0, -5103.0 / 18656.0,
           0.0)  # fmt: skip
    _stage(plant, drive, t0, tau, s, rest, work, d, 6, 1.0,
           35.0 / 384.0, 0.0, 500.0 / 1113.0, 125.0 / 192.0, -2187.0 / 6784.0,
           11.0 / 84.0)  # fmt: skip


@step.internal
def _step_error(plant, s, work, d):
    """Error of a step over the allowed one, by the difference of both orders."""
    size = _size(plant)
    start, end, k = _START * size, _END * size, _STAGES * size
    v, first = work[start + 1], work[k + 1]
    scale = abs(v) + plant.numbers[step.STICK_SPEED] + d * abs(first)
    part = step.TOLERANCE + plant.numbers[step.ALLOWED] / scale
    worst = 0.0
    for j in range(size):
        error = 71.0 / 57600.0 * work[k + j] - 71.0 / 16695.0 * work[k + 2 * size + j]
        error += 71.0 / 1920.0 * work[k + 3 * size + j]
        error -= 17253.0 / 339200.0 * work[k + 4 * size + j]
        error += 22.0 / 525.0 * work[k + 5 * size + j] - 1.0 / 40.0 * work[k + 6 * size + j]
        # Of the position, velocity times step; of a state, what it is and changes by.
        unit = scale * d
        if j == 1:
            unit = scale
        elif j > 1:
            rate = max(abs(work[k + j]), abs(work[k + 6 * size + j]))
            unit = max(abs(work[start + j]), abs(work[end + j])) + d * rate
        error = abs(d * error)
        # A resting axis moves in closed form.
        if error > 0.0 and (s != 0.0 or j > 1):
            worst = max(worst, error / (part * unit))
        if not error < math.inf:
            worst = math.inf
    return worst


@step.internal(forceinline=True)
def _margin(work, size, block, j):
    """Distance of state j of a block from the nearer of its limits, negative beyond."""
    z = work[block * size + 2 + j]
    return min(work[_HIGH * size + 2 + j] - z, z - work[_LOW * size + 2 + j])


@step.internal
def _limit_length(plant, drive, t0, tau, s, rest, work, d, j):
    """Length of the step of at most d after which state j reaches its limit."""
    size = _size(plant)
    a, fa, b, fb, side = 0.0, _margin(work, size, _START, j), d, _margin(work, size, _END, j), 0
    for _ in range(_TURNS):
        c = secant_point(a, fa, b, fb)
        if b - a <= _EXACT * d or fb == 0.0 or c == b:
            break
        _stride(plant, drive, t0, tau, s, rest, work, c)
        fc = _margin(work, size, _END, j)
        a, fa, b, fb, side = illinois_bracket(a, fa, b, fb, side, c, fc)
    _stride(plant, drive, t0, tau, s, rest, work, b)
    return b


@step.internal
def _first_limit(plant, drive, t0, tau, s, rest, work, d):
    """Length of the step of at most d after which the first state reaches a limit."""
    size = _size(plant)
    for j in range(plant.integers[step.N_STATES]):
        if _margin(work, size, _START, j) > 0.0 > _margin(work, size, _END, j):
            d = _limit_length(plant, drive, t0, tau, s, rest, work, d, j)
    return d


@step.internal
def _to_limits(plant, drive, t0, tau, s, rest, work):
    """Put states beyond a limit at the end of a step to it, or where they jump; whether any was."""
    size, changed = _size(plant), False
    at = _END * size
    for j in range(plant.integers[N_STATES]):
        row = plant.integers[STATES] + STATE_ROW * j
        low, high = work[_LOW * size + 2 + j], work[_HIGH * size + 2 + j]
        reaches = _margin(work, size, _START, j) > 0.0 >= _margin(work, size, _END, j)
        if reaches or _margin(work, size, _END, j) < 0.0:
            changed = True
            work[at + 2 + j] = min(max(work[at + 2 + j], low), high)
        if plant.integers[row + JUMP_OF] != 0 and reaches:
            _show(plant, work, _END)
            x, v, u = work[at], work[at + 1], step.drive_force(drive, tau)
            after = _jump(plant, row, t0 + tau, x, v, u, _level(plant, x, s), s, rest)
            work[at + 2 + j] = min(max(after, low), high)
    _show(plant, work, _END)
    return changed


@step.internal
def _first_stage(plant, drive, t0, tau, s, rest, work):
    """Which states are held at their limits from the start of a step on, and its first rates."""
    size = _size(plant)
    start, end, held, k = _START * size, _END * size, _HELD * size, _STAGES * size
    for j in range(size):
        work[end + j] = work[start + j]
        work[held + j] = 0.0
    _derivative(plant, drive, t0, tau, s, rest, work, k)
    for j in range(2, size):
        z, rate = work[start + j], work[k + j]
        if z >= work[_HIGH * size + j] and rate > 0.0:
            work[held + j] = 1.0
        elif z <= work[_LOW * size + j] and rate < 0.0:
            work[held + j] = -1.0
        if work[held + j] != 0.0:
            work[k + j] = 0.0


@step.internal
def _shorter_step(plant, drive, t0, tau, s, work, d, error):
    """Length of the sliding step to try instead of one of length d; d if it may stay."""
    size = _size(plant)
    at, end, k = _START * size, _END * size, _STAGES * size
    x, v, x1, v1 = work[at], work[at + 1], work[end], work[end + 1]
    sigma = plant.numbers[step.STICK_SPEED]
    cut = step.accurate_step(plant, x1 - x, error, 1.0, d)
    if cut < d:
        return cut
    cut = step.peak_step(plant, v, v1, s, d)
    if cut >= 0.99 * d:
        lowest = 0.0 if s * v <= sigma else sigma
        cut = step.reversal_step(v, v1, s, work[k + 1], work[k + 6 * size + 1], d, lowest)
    if cut >= 0.99 * d and step.has_kinks(plant):
        w1 = step.load(plant, drive, t0, tau + d, x1, v1, s, 0.0)
        _show(plant, work, _START)
        w = step.load(plant, drive, t0, tau, x, v, s, 0.0)
        cut = step.kink_step(plant, t0 + tau, x, v, w, x1, v1, w1, s, 0.0, d)
    return cut


@step.internal
def _surface(plant, drive, t0, tau, s, rest, work, block, kind):
    """Function of the state of a block that falls through zero where a step ends."""
    at = block * _size(plant)
    _show(plant, work, block)
    if kind == _RELEASE:
        return -step.hold_excess(plant, drive, t0, tau, work[at], work[at + 1], rest)[0]
    return step._surface(plant, drive, t0, tau, work[at], work[at + 1], s, kind)


@step.internal
def _cut(plant, drive, t0, tau, s, rest, work, d, kind, upper):
    """Length of the step that ends on a surface; `upper`: its function, at the end."""
    fa = _surface(plant, drive, t0, tau, s, rest, work, _START, kind)
    if fa <= 0.0:
        return 0.0
    a, b, fb, side = 0.0, d, upper, 0
    for _ in range(_TURNS):
        c = secant_point(a, fa, b, fb)
        if b - a <= _EXACT * d or fb == 0.0 or c == b:
            break
        _stride(plant, drive, t0, tau, s, rest, work, c)
        later = rest + c if s == 0.0 else rest
        fc = _surface(plant, drive, t0, tau + c, s, later, work, _END, kind)
        a, fa, b, fb, side = illinois_bracket(a, fa, b, fb, side, c, fc)
    return b


@step.internal
def _band_crossing(plant, drive, t0, tau, s, work, d):
    """Part of a step after which the load changes its sign; 0 where it does not."""
    size = _size(plant)
    at, end = _START * size, _END * size
    _show(plant, work, _START)
    w0 = step.load(plant, drive, t0, tau, work[at], work[at + 1], s, 0.0)
    _show(plant, work, _END)
    w1 = step.load(plant, drive, t0, tau + d, work[end], work[end + 1], s, 0.0)
    part = w0 / (w0 - w1) if w0 * w1 < 0.0 else 0.0
    return part if 1e-6 < part < 1.0 - 1e-6 else 0.0


@step.internal
def _end_inside(plant, drive, t0, tau, s, work, d, inside, end, flips):
    """How a step below the stick speed ends, and its length; `end`: `_BAND` at its end."""
    v1 = work[_END * _size(plant) + 1]
    kind, cut = step._ON, d
    if s * v1 <= 0.0 and (plant.integers[step.RULE] == step.FILIPPOV or flips == 0):
        kind = step._ZERO
        cut = _cut(plant, drive, t0, tau, s, 0.0, work, d, step._ZERO, s * v1)
    if inside and end <= 0.0:
        other = _cut(plant, drive, t0, tau, s, 0.0, work, d, step._BAND, end)
        if kind == step._ON or other < cut:
            kind, cut = step._BAND, other
    return kind, cut


@step.internal
def _sliding_end(plant, drive, t0, tau, s, work, d, may, divisible, flips):
    """How a sliding step ends, and its length, see `axis_step._sliding_end`."""
    size, sigma = _size(plant), plant.numbers[step.STICK_SPEED]
    v, v1 = work[_START * size + 1], work[_END * size + 1]
    inside = s * v <= sigma
    if s * v1 > sigma and not inside:
        return step._ON, d
    start = _surface(plant, drive, t0, tau, s, 0.0, work, _START, step._BAND)
    end = _surface(plant, drive, t0, tau + d, s, 0.0, work, _END, step._BAND)
    if divisible and start > 0.0 and end > 0.0:
        part = _band_crossing(plant, drive, t0, tau, s, work, d)
        if part > 0.0:
            # Stop inside the band, if it has any width.
            return step._DIVIDED, part * d
    if not inside and (start <= 0.0 or end <= 0.0):
        upper = s * v1 - sigma
        return step._OUTER, _cut(plant, drive, t0, tau, s, 0.0, work, d, step._OUTER, upper)
    if not may:
        return step._ON, d
    return _end_inside(plant, drive, t0, tau, s, work, d, inside, end, flips)


@step.internal
def _sliding_step(plant, drive, t0, tau, h, s, work, d, may, flips):
    """One sliding step of at most d: how it ends, its length, and that of the next one to try."""
    _stride(plant, drive, t0, tau, s, 0.0, work, d)
    error = _step_error(plant, s, work, d)
    divisible = d > step.SHORTEST * h
    if divisible:
        cut = _shorter_step(plant, drive, t0, tau, s, work, d, error)
        if cut < d:
            return step._DIVIDED, cut, cut
    elif error == math.inf:
        return step._ON, h - tau, h  # not finite: no step is short enough
    following = larger_step(d, 1.0, error)
    length = _first_limit(plant, drive, t0, tau, s, 0.0, work, d)
    kind, cut = _sliding_end(plant, drive, t0, tau, s, work, length, may, divisible, flips)
    if kind == step._DIVIDED:
        return kind, cut, cut
    if kind == step._ON:
        return (_LIMIT if length < d else kind), length, following
    _stride(plant, drive, t0, tau, s, 0.0, work, cut)
    return kind, cut, following


@step.internal
def _load_rate(plant, drive, t0, tau, rest, work, d, start):
    """Largest rate of load and level together at rest [N/s]; `start`: excess of the load, there."""
    at = _START * _size(plant)
    x, v = work[at], work[at + 1]
    _show(plant, work, _END)
    moved = step.hold_excess(plant, drive, t0, tau, x, v, rest)[0]
    return step._rest_rate(plant, drive, x, v) + _RATE_MARGIN * abs(moved - start) / d


@step.internal
def _rest_step(plant, drive, t0, tau, h, rest, work, d, may):
    """One step at rest of at most d: how it ends, its length, and that of the next one to try."""
    _stride(plant, drive, t0, tau, 0.0, rest, work, d)
    error = _step_error(plant, 0.0, work, d)
    divisible = d > step.SHORTEST * h
    if error > 1.0 and divisible:
        cut = smaller_step(d, 1.0, error) if error < math.inf else 0.1 * d
        return step._DIVIDED, cut, cut
    length = _first_limit(plant, drive, t0, tau, 0.0, rest, work, d)
    kind, following = (_LIMIT if length < d else step._ON), larger_step(d, 1.0, error)
    if not may:
        return kind, length, following
    end = -_surface(plant, drive, t0, tau + length, 0.0, rest + length, work, _END, _RELEASE)
    start = -_surface(plant, drive, t0, tau, 0.0, rest, work, _START, _RELEASE)
    rate = _load_rate(plant, drive, t0, tau, rest, work, length, start)
    if end <= 0.0 and start + end <= -rate * length:
        return kind, length, following
    finest = _FINEST_LOOK * min(h, plant.numbers[step.SHORT_TIME])
    if drive.fade != 0.0:
        finest = min(finest, _FINEST_LOOK / drive.rate)
    if length > 1.01 * finest and divisible:
        cut = margin_step(length, -start, rate, finest)
        return step._DIVIDED, cut, cut
    if end > 0.0:
        cut = _cut(plant, drive, t0, tau, 0.0, rest, work, length, _RELEASE, -end)
        _stride(plant, drive, t0, tau, 0.0, rest, work, cut)
        return _RELEASE, cut, h
    return kind, length, min(following, 2.0 * length)


@step.internal
def _begin_at_end(plant, work):
    """Begin the next step where the last one ended, with the rates of its last stage."""
    size = _size(plant)
    start, end, k = _START * size, _END * size, _STAGES * size
    for j in range(size):
        work[start + j] = work[end + j]
        work[k + j] = work[k + 6 * size + j]


@step.internal
def _mode_after(plant, drive, t0, tau, work, mode, rest, kind, d):
    """Mode and velocity after a step that ended in a switch, or might have."""
    at = _START * _size(plant)
    x, v = work[at], work[at + 1]
    if kind == _RELEASE:
        s = step.hold_excess(plant, drive, t0, tau, x, v, rest)[1]
        return int(s), (v if s * v > 0.0 else 0.0)
    return step._mode_after(plant, drive, t0, tau, x, v, mode, kind, d)


@step.internal
def _advance(plant, drive, t0, h, memory, work, events, count):
    """Move an axis whose effects have states, see `axis_step.advance`."""
    at = _START * _size(plant)
    before, rest = int(memory[step.MODE]), memory[step.REST]
    mode, seen, friction, _ = step.begin(
        plant, drive, t0, memory[step.X], memory[step.V], before, rest
    )
    if mode != before:
        step.record(events, count, t0, before, mode)
        rest = 0.0
    first = mode
    work[at], work[at + 1] = memory[step.X], seen
    tau, longest, fresh = 0.0, h, True
    switches = flips = close = 0
    # The mode is held from one switch too close to the last one to `resume`, see `switching_pause`.
    pause, resume, last = step.CLOSE * h, 0.0, -h
    while tau < h:
        may = tau >= resume and switches < count[step.MOST]
        s = float(mode)
        if fresh:
            _first_stage(plant, drive, t0, tau, s, rest, work)
            fresh = False
        bound = h if tau >= resume else min(resume, h)
        d = min(longest, bound - tau, plant.numbers[step.SHORT_TIME])
        if mode == 0:
            kind, d, longest = _rest_step(plant, drive, t0, tau, h, rest, work, d, may)
        else:
            kind, d, longest = _sliding_step(plant, drive, t0, tau, h, s, work, d, may, flips)
        if kind == step._DIVIDED:
            continue
        tau += d
        rest = rest + d if mode == 0 else 0.0
        fresh = _to_limits(plant, drive, t0, tau, s, rest, work) or kind != step._ON
        _begin_at_end(plant, work)
        if kind == step._ON or kind == _LIMIT:
            tau = h if tau + step.SHORTEST * h >= h else tau
            continue
        longest = h
        flips += kind == step._ZERO and plant.integers[step.RULE] == step.PAPER
        after, work[at + 1] = _mode_after(plant, drive, t0, tau, work, mode, rest, kind, d)
        if after != mode:
            switches += 1
            step.record(events, count, t0 + tau, mode, after, switches)
            mode, rest = after, 0.0
            close, pause, resume = step.switching_pause(tau, last, h, close, pause)
            last = tau
    memory[step.X], memory[step.V] = work[at], work[at + 1]
    memory[step.MODE], memory[step.REST] = float(mode), rest
    return seen, friction, first


@step.internal
def _begin_work(plant, z, work):
    """Set limits and states of the work memory; the laws see the states."""
    size = _size(plant)
    for j in range(plant.integers[N_STATES]):
        row = plant.integers[STATES] + STATE_ROW * j
        limits = plant.integers[row + LIMITS]
        work[_LOW * size + 2 + j] = plant.numbers[limits]
        work[_HIGH * size + 2 + j] = plant.numbers[limits + 1]
        work[_START * size + 2 + j] = z[j]
    _show(plant, work, _START)


@step.internal
def show_states(plant, memory):
    """Let the laws of a plant, whose numbers are its own, see the states in a memory."""
    z = step.offset_address(memory, first_state(plant))
    for j in range(plant.integers[N_STATES]):
        row = plant.integers[STATES] + STATE_ROW * j
        plant.numbers[plant.integers[row + PLACE]] = z[j]


@step.internal
def keep_states(plant, memory):
    """Keep the states in a memory behind them, where a run works, until `return_states`."""
    z = step.offset_address(memory, first_state(plant))
    n = plant.integers[N_STATES]
    for j in range(n):
        z[n + _KEPT * (n + 2) + j] = z[j]


@step.internal
def return_states(plant, memory):
    """Return what `keep_states` kept; the laws see it."""
    z = step.offset_address(memory, first_state(plant))
    n = plant.integers[N_STATES]
    for j in range(n):
        z[j] = z[n + _KEPT * (n + 2) + j]
    show_states(plant, memory)


@step.internal
def shift_states(plant, t, memory, drive, way):
    """Let the states follow a correction of the position, as far as they flow with the velocity."""
    z = step.offset_address(memory, first_state(plant))
    x, v, s = memory[step.X], memory[step.V], memory[step.MODE]
    level, dv = _level(plant, x, s), _DIFFERENCE * plant.numbers[step.STICK_SPEED]
    dv = math.copysign(dv, v)
    for j in range(plant.integers[N_STATES]):
        row = plant.integers[STATES] + STATE_ROW * j
        limits = plant.integers[row + LIMITS]
        rise = _flow(plant, row, t, x, v + dv, drive, level, s, 0.0)
        rise -= _flow(plant, row, t, x, v, drive, level, s, 0.0)
        after = z[j] + rise / dv * way
        z[j] = min(max(after, plant.numbers[limits]), plant.numbers[limits + 1])
    show_states(plant, memory)


@step.internal
def follow_motion(plant, t, x, v, u, s, dt):
    """Let the states of a plant, whose numbers are its own, follow a motion at a velocity."""
    level, h = _level(plant, x, s), dt / _PIECES
    for _ in range(_PIECES):
        for j in range(plant.integers[N_STATES]):
            row = plant.integers[STATES] + STATE_ROW * j
            place, limits = plant.integers[row + PLACE], plant.integers[row + LIMITS]
            low, high = plant.numbers[limits], plant.numbers[limits + 1]
            before = plant.numbers[place]
            after = before + h * _flow(plant, row, t, x, v, u, level, s, 0.0)
            plant.numbers[place] = min(max(after, low), high)
            if (
                plant.integers[row + JUMP_OF] != 0
                and low < before < high
                and not low < after < high
            ):
                after = _jump(plant, row, t, x, v, u, level, s, 0.0)
                plant.numbers[place] = min(max(after, low), high)


@step.internal
def forget_states(plant):
    """Set the states of a plant, whose numbers are its own, to those at a start."""
    for j in range(plant.integers[N_STATES]):
        row = plant.integers[STATES] + STATE_ROW * j
        plant.numbers[plant.integers[row + PLACE]] = 0.0


def _states_task(
    task, numbers, integers, start, slope, fade, rate, t0, h, memory, events, count, seen
):
    """Perform a task of an axis whose effects have states; velocity, friction, mode."""
    if task == step.SETTLE:
        return
    z = step.offset_address(memory, step.HISTORY + 2 * integers[step.N_HISTORY])
    work = step.offset_address(z, integers[N_STATES])
    own = step.offset_address(work, BLOCKS * (integers[N_STATES] + 2))
    for k in range(integers[step.N_COPIED]):
        own[k] = numbers[k]
    plant, drive = step.Plant(own, integers), step.Drive(start, slope, fade, rate)
    _begin_work(plant, z, work)
    if task == step.ADVANCE:
        v, friction, mode = _advance(plant, drive, t0, h, memory, work, events, count)
        for j in range(integers[N_STATES]):
            z[j] = work[_START * (integers[N_STATES] + 2) + 2 + j]
    else:
        mode, v, friction, _ = step.begin(
            plant, drive, t0, memory[step.X], memory[step.V], int(memory[step.MODE]),
            memory[step.REST],
        )  # fmt: skip
    seen[0], seen[1], seen[2] = v, friction, mode


@functools.cache
def states_task():
    """Function that moves an axis whose effects have states, compiled on first use."""
    return cfunc(step.TASK_CALL, cache=True, error_model="numpy")(_states_task)
