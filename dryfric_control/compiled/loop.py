"""Compiled law of the position controller, and the closed loop with the axis."""

from __future__ import annotations

import math

import numpy as np

from dryfric_control.compiled import axis_step
from dryfric_control.compiled.cached import njit

# Largest span of the velocity estimate [samples]; it sizes the controller's memory.
LONGEST_SPAN = 8
# Indices of the memory, the last readings newest first.
INTEGRAL, SPEED, READINGS = range(3)
# Indices of the gains.
KP, KI, KD, LIMIT, KEEP, SPAN, STEP = range(7)


@njit(cache=True, error_model="numpy")
def encode(x, quantum):
    """Reading of an encoder: the nearest whole number of quanta."""
    return quantum * math.floor(x / quantum + 0.5) if quantum > 0.0 else x


@njit(cache=True, error_model="numpy")
def control_update(gains, memory, reference, y):
    """Advance the controller by one sample; returns its drive force."""
    span = gains[SPAN]
    difference = (y - memory[READINGS + int(span) - 1]) / (span * gains[STEP])
    speed = gains[KEEP] * memory[SPEED] + (1.0 - gains[KEEP]) * difference
    wanted = gains[KP] * (reference - y) + gains[KI] * memory[INTEGRAL] - gains[KD] * speed
    given = min(max(wanted, -gains[LIMIT]), gains[LIMIT])
    if gains[KI] > 0.0:
        # Back-calculation: a saturated drive unwinds the integral at the rate
        # kp/ki at which the integral would have wound up.
        memory[INTEGRAL] += gains[STEP] * (reference - y + (given - wanted) / gains[KP])
    memory[SPEED] = speed
    for i in range(LONGEST_SPAN - 1, 0, -1):
        memory[READINGS + i] = memory[READINGS + i - 1]
    memory[READINGS] = y
    return given


@axis_step.internal
def advance_plant(plant, k, dt, state, u, disturbance, y, events, count, out):
    """Sample k of a closed loop with the axis, into column k of `out`."""
    t = k * dt
    force = u + disturbance
    if k == 0:
        state[axis_step.MODE] = axis_step.outputs(plant, t, dt, state, force)[2]
    out[0, k], out[4, k], out[5, k] = axis_step.encoder_reading(plant, t, state), u, y
    out[1, k], out[2, k], out[3, k] = axis_step.sample(
        plant, t, dt, force, force, state, axis_step.pointer(events), axis_step.pointer(count)
    )


@njit(cache=True, error_model="numpy")
def run_loop(
    numbers, integers, memory, gains, controller, reference, disturbance, quantum, dt, room, out
):
    """Closed loop into `out`, rows x, v, friction, mode, u, y; switches, and how many lost.

    `room`: for the switches of one sample.
    """
    plant = axis_step.point(numbers, integers)
    state = axis_step.pointer(memory)
    control = axis_step.pointer(gains)
    past = axis_step.pointer(controller)
    n = reference.shape[0]
    events = np.empty(64 * room)
    count = axis_step.empty_tally(events)
    for k in range(n):
        if 3 * count[axis_step.LISTED] + room > events.shape[0]:
            events = axis_step.longer_list(events, count)
        y = encode(axis_step.encoder_reading(plant, k * dt, state), quantum)
        u = control_update(control, past, reference[k], y)
        advance_plant(plant, k, dt, state, u, disturbance[k], y, events, count, out)
    return axis_step.switch_rows(events, count[axis_step.LISTED]), count[axis_step.LOST]
