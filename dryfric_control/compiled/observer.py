"""Compiled one-sample step of the switched PI observer.

`_mode_and_friction` takes the new drive u and reading y and determines mode and outputs;
`_predict` advances the estimate to the next sample.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from dryfric_control.compiled import axis_step
from dryfric_control.compiled.cached import njit

#: Rules that determine the mode.
PAPER = 0
READING = 1
FILIPPOV = 2

#: Indices of the observer's memory; the line of delayed drives follows the last.
#: The first two are as in `axis_step`, as the laws of effects read them.
(
    XHAT,
    VHAT,
    WHAT,  # integral term of the present mode
    MODE,
    NODE,  # memory state of the gains, counted from 1; 0 before the first sample
    REST,  # time at rest
    ERROR_MINUS,  # learned error of the Coulomb level: true - nominal
    ERROR_PLUS,
    PLACE,  # mean reading since the axis came to rest
    COUNT,  # number of readings in that mean
    LAGGED,  # drive after an actuator lag
    LINE,
) = range(12)

#: Indices of the observer's numbers.
(DT, STICK_SPEED, RESOLUTION, KEEP, RULE, CURRENT, NUMBERS) = range(7)
#: Columns of the matrices of a mode (rows mode + 1), and their number.
A12, A22, B1, B2, E1, E2, COLUMNS = range(7)
#: Number of outputs.
OUTPUTS = 5


class Tables(NamedTuple):
    """Numbers of one observer, as addresses for compiled functions."""

    numbers: Any
    matrices: Any  # three rows of COLUMNS
    gains: Any  # rows of three, one per node
    transitions: Any  # rows of three, one per node and one for the start
    nodes: int
    plant: axis_step.Plant


# Largest number of readings in the running mean at rest: enough to average noise, and
# few enough to detect that a creeping axis leaves its position.
_MOST_READINGS = 64.0


@axis_step.internal(forceinline=True)
def _delayed_drive(plant, dt, memory, u):
    """Mean over the coming sample of the drive after an input delay."""
    if plant.numbers[axis_step.DELAY] <= 0.0:
        return u
    ratio = plant.numbers[axis_step.DELAY] / dt
    n = int(ratio)
    part = ratio - n
    newer = u if n == 0 else memory[LINE + n - 1]
    return (1.0 - part) * newer + part * memory[LINE + n]


@axis_step.internal(forceinline=True)
def mean_drive(plant, dt, memory, u):
    """Mean drive over the coming sample, after delay and lag."""
    seen = _delayed_drive(plant, dt, memory, u)
    lag = plant.numbers[axis_step.LAG]
    if lag > 0.0:
        seen += (memory[LAGGED] - seen) * (-math.expm1(-dt / lag)) * lag / dt
    return seen


@axis_step.internal(forceinline=True)
def shift_drive(plant, dt, memory, u):
    """Advance delay and lag by one sample."""
    lag = plant.numbers[axis_step.LAG]
    if lag > 0.0:
        seen = _delayed_drive(plant, dt, memory, u)
        memory[LAGGED] = seen + (memory[LAGGED] - seen) * math.exp(-dt / lag)
    last = plant.integers[axis_step.N_HISTORY] - 1
    if last >= 0:
        for k in range(last, 0, -1):
            memory[LINE + k] = memory[LINE + k - 1]
        memory[LINE] = u


@axis_step.internal(forceinline=True)
def _load(plant, t, memory, drive, y, s):
    """Net force on the mass without friction, at the measured position."""
    return axis_step.load_under(plant, drive, t, y, memory[VHAT], s, memory[REST])


@axis_step.internal
def _nominal_level(plant, t, memory, w, y, s):
    """Coulomb level of the observer's own map at the measured position."""
    return axis_step.coulomb_level(plant, t, y, memory[VHAT], w, s, memory[REST])


@njit(cache=True, error_model="numpy", forceinline=True)
def _error_place(mode):
    return ERROR_PLUS if mode > 0 else ERROR_MINUS


@axis_step.internal(forceinline=True)
def _corrected_level(plant, t, memory, w, y, mode):
    """Coulomb level in direction `mode`, with the learned correction."""
    level = _nominal_level(plant, t, memory, w, y, float(mode))
    return max(level + memory[_error_place(mode)], 0.0)


@njit(cache=True, error_model="numpy")
def _mode_of_automaton(numbers, plant, t, memory, w, y):
    """Mode by the automaton (paper, Fig. 2) on (u, y, vhat), as printed or completed."""
    mode = int(memory[MODE])
    v = memory[VHAT]
    above = w > _nominal_level(plant, t, memory, w, y, 1.0)
    below = w < -_nominal_level(plant, t, memory, w, y, -1.0)
    if mode == 0:
        return 1 if above else (-1 if below else 0)
    if abs(v) <= numbers[STICK_SPEED] and not above and not below:
        return 0
    if numbers[RULE] == FILIPPOV:
        # A zero crossing of the velocity reverses the mode only if the load acts that way.
        return -mode if mode * v <= 0.0 and (below if mode > 0 else above) else mode
    return 1 if v > 0.0 else (-1 if v < 0.0 else mode)


@njit(cache=True, error_model="numpy")
def _mode_of_reading(numbers, plant, t, memory, w, y):
    """Mode from the reading; each mode keeps its own integral."""
    mode = int(memory[MODE])
    if mode == 0:
        gone = y - memory[PLACE]
        side = 1 if gone > 0.0 else -1
        moved = abs(gone) > numbers[RESOLUTION]
        if not moved and abs(gone) > 0.5 * numbers[RESOLUTION]:
            moved = side * w > _corrected_level(plant, t, memory, w, y, side)
        if moved:
            memory[WHAT] = -side * memory[_error_place(side)]
            return side
        memory[COUNT] = min(memory[COUNT] + 1.0, _MOST_READINGS)
        memory[PLACE] += gone / memory[COUNT]
        return 0
    ahead = mode * memory[VHAT]
    if ahead > numbers[STICK_SPEED]:
        return mode
    if ahead > 0.0 and -mode * w > _corrected_level(plant, t, memory, w, y, -mode):
        return mode
    memory[WHAT] = 0.0
    memory[PLACE], memory[COUNT] = y, 1.0
    return 0


@njit(cache=True, error_model="numpy")
def _addresses(numbers, matrices, gains, transitions, axis_numbers, axis_integers):
    """Arrays that describe an observer as a `Tables` of addresses."""
    return Tables(
        axis_step.pointer(numbers),
        axis_step.pointer(matrices),
        axis_step.pointer(gains),
        axis_step.pointer(transitions),
        transitions.shape[0] - 1,
        axis_step.point(axis_numbers, axis_integers),
    )


@axis_step.internal(forceinline=True)
def _mode_and_friction(tables, memory, t, u, y):
    """Friction estimate, net force without friction, nominal friction, drive behind effects."""
    plant = tables.plant
    numbers = tables.numbers
    drive = axis_step.input_map(plant, t, memory, u)
    seen = mean_drive(plant, numbers[DT], memory, drive)
    first = memory[NODE] == 0.0
    if first:
        memory[PLACE], memory[COUNT] = y, 1.0
        v = memory[VHAT]
        memory[MODE] = 0.0 if abs(v) <= numbers[STICK_SPEED] else math.copysign(1.0, v)
    before = int(memory[MODE])
    w = _load(plant, t, memory, seen, y, memory[MODE])
    if numbers[RULE] == READING:
        mode = _mode_of_reading(numbers, plant, t, memory, w, y)
    else:
        mode = _mode_of_automaton(numbers, plant, t, memory, w, y)
    # The last row of the table is the initial transition of the gains' memory.
    row = tables.nodes if first else int(memory[NODE]) - 1
    memory[NODE] = tables.transitions[3 * row + mode + 1] + 1
    memory[MODE] = mode
    if mode != before:
        memory[REST] = 0.0
        w = _load(plant, t, memory, seen, y, float(mode))
    if numbers[CURRENT]:
        g = 3 * (int(memory[NODE]) - 1)
        error = y - memory[XHAT]
        memory[XHAT] += tables.gains[g] * error
        memory[VHAT] += tables.gains[g + 1] * error
        memory[WHAT] += tables.gains[g + 2] * error
    if mode == 0:
        return w, w, 0.0, drive
    nominal = mode * _nominal_level(plant, t, memory, w, y, float(mode))
    return nominal - memory[WHAT], w, nominal, drive


@axis_step.internal(forceinline=True)
def _predict(tables, memory, w, nominal, drive, y):
    """Advance the estimate by (7), or without its correction; `memory` in place."""
    numbers = tables.numbers
    matrices = tables.matrices
    gains = tables.gains
    mode = int(memory[MODE])
    node = int(memory[NODE]) - 1
    x = memory[XHAT]
    v = memory[VHAT]
    integral = memory[WHAT]
    error = 0.0 if numbers[CURRENT] else y - x
    force = w - nominal
    a = COLUMNS * (mode + 1)
    g = 3 * node
    memory[XHAT] = (
        x + matrices[a + A12] * v + matrices[a + B1] * force + matrices[a + E1] * integral
        + gains[g] * error
    )  # fmt: skip
    memory[VHAT] = (
        matrices[a + A22] * v + matrices[a + B2] * force + matrices[a + E2] * integral
        + gains[g + 1] * error
    )  # fmt: skip
    memory[WHAT] = integral + gains[g + 2] * error
    if mode == 0:
        memory[REST] += numbers[DT]
    else:
        i = _error_place(mode)
        memory[i] += (1.0 - numbers[KEEP]) * (-mode * integral - memory[i])
    shift_drive(tables.plant, numbers[DT], memory, drive)


@axis_step.internal(forceinline=True)
def _sample(tables, memory, t, u, y, out, row):
    friction, w, nominal, drive = _mode_and_friction(tables, memory, t, u, y)
    out[row], out[row + 1], out[row + 2] = memory[XHAT], memory[VHAT], friction
    out[row + 3], out[row + 4] = memory[WHAT], memory[MODE]
    _predict(tables, memory, w, nominal, drive, y)


@njit(cache=True, error_model="numpy")
def step(numbers, matrices, gains, transitions, axis_numbers, axis_integers, memory, t, u, y, out):
    """One sample: outputs into `out`, `memory` advanced."""
    tables = _addresses(numbers, matrices, gains, transitions, axis_numbers, axis_integers)
    _sample(tables, axis_step.pointer(memory), t, u, y, axis_step.pointer(out), 0)


@njit(cache=True, error_model="numpy")
def run(
    numbers, matrices, gains, transitions, axis_numbers, axis_integers, memory, u, y, known, out
):  # fmt: skip
    """Run over a whole record into `out`, rows xhat, vhat, Fhat, what, mode per sample.

    `known`: force on the mass that is known, shape (n,), or (0,) for none.
    """
    own = axis_numbers.copy()
    tables = _addresses(numbers, matrices, gains, transitions, own, axis_integers)
    state = axis_step.pointer(memory)
    rows = axis_step.pointer(out)
    for k in range(u.shape[0]):
        if known.shape[0] > 0:
            axis_step.set_known_force(tables.plant, k * numbers[DT], numbers[DT], known, k, False)
        _sample(tables, state, k * numbers[DT], u[k], y[k], rows, OUTPUTS * k)
    axis_step.keep_alive(own)
