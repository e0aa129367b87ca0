"""Compiled parts of the fit: windowed free runs and their normal equations.

They release the interpreter lock, so that starts may run in threads.
"""
# mypy: disallow-untyped-defs=False

from __future__ import annotations

import numpy as np
from numba import njit

from dryfric_control.compiled import axis_step


@axis_step.internal
def _held(plant, state, u, k, end):
    """Drive of sample k after the input map; before the record it is u[0]."""
    return axis_step.input_map(plant, 0.0, state, u[min(max(k + end, 0), u.shape[0] - 1)])


@axis_step.internal
def _lagged(plant, u, dt, first, k, state):
    """Lagged drive at sample k, from the inputs of ten time constants before."""
    lag, delay = plant.numbers[axis_step.LAG], plant.numbers[axis_step.DELAY]
    whole = int(delay / dt)
    part = delay / dt - whole
    back = min(k, int(10.0 * lag / dt) + whole + 2)
    value = _held(plant, state, u, k - back - whole, 0)
    for i in range(k - back, k):
        # Input old acts for the part of the sample that the delay takes.
        old = _held(plant, state, u, i - whole - 1, 0)
        new = _held(plant, state, u, i - whole, 0)
        if first:
            old = 0.5 * (old + new)
            new = 0.5 * (new + _held(plant, state, u, i - whole, 1))
        value = old + (value - old) * np.exp(-part * dt / lag)
        value = new + (value - new) * np.exp(-(1.0 - part) * dt / lag)
    return value


@njit(cache=True, error_model="numpy", nogil=True)
def _keep(memory, inner):
    """Inner states at one instant, into a row of `inner`."""
    inner[0], inner[1] = memory[axis_step.DEFLECTION], memory[axis_step.OFFSET]
    inner[2], inner[3] = memory[axis_step.SLIP], memory[axis_step.MODE]


@njit(cache=True, error_model="numpy", nogil=True)
def _restore(integers, inner, memory):
    """Inner states of a row of `inner` at the position and speed in memory.

    A load that was stuck stays so, whatever the speed of the motor.
    """
    memory[axis_step.DEFLECTION], memory[axis_step.OFFSET] = inner[0], inner[1]
    memory[axis_step.SLIP], memory[axis_step.MODE] = inner[2], inner[3]
    kind = integers[axis_step.STRUCTURE]
    if not kind & axis_step.CONTACT and inner[2] != 0.0 and inner[3] == 0.0:
        memory[axis_step.SLIP] = -memory[axis_step.V]


@njit(cache=True, error_model="numpy", nogil=True)
def free_runs(
    numbers, integers, size, u, t0, dt, first, edges, x0, v0, rest, active, inner, carry, out
):
    """Positions of free runs over the active windows.

    Window w covers the samples edges[w] to edges[w+1] - 1 and starts at
    x0[w], v0[w]; out[k] is the position of its run at sample k.  `size` is the
    length of the memory, `rest` the time at rest before each start.

    `inner` has a row for each window: the inner states with which it starts.
    With `carry` (all windows active) row w is filled from the end of run
    w - 1, the first from an axis at rest; without, the rows are used as they
    are.  An axis without inner states leaves them alone.  A run that ends at
    rest hands on for how long, which it knows better than the readings do.
    """
    plant = axis_step.point(numbers, integers)
    memory = np.zeros(size)
    state = axis_step.pointer(memory)
    events = np.empty(axis_step.ROOM)
    count = axis_step.tally(events)
    switches, counted = axis_step.pointer(events), axis_step.pointer(count)
    rested = 0.0
    for w in range(edges.shape[0] - 1):
        if not active[w]:
            rested = 0.0
            continue
        a, b = edges[w], edges[w + 1]
        memory[:] = 0.0
        memory[axis_step.X], memory[axis_step.V] = x0[w], v0[w]
        memory[axis_step.REST] = rested if rested > 0.0 < rest[w] else rest[w]
        for j in range(integers[axis_step.N_HISTORY]):
            memory[axis_step.HISTORY + 2 * j] = _held(plant, state, u, a - 1 - j, 0)
            memory[axis_step.HISTORY + 2 * j + 1] = _held(
                plant, state, u, a - 1 - j, 1 if first else 0
            )
        if numbers[axis_step.LAG] > 0.0:
            memory[axis_step.LAGGED] = _lagged(plant, u, dt, first, a, state)
        if integers[axis_step.STRUCTURE] != 0:
            if carry and w == 0:
                axis_step.settle(plant, t0 + a * dt, dt, state, u[a])
                _keep(memory, inner[w])
            _restore(integers, inner[w], memory)
        _, _, mode = axis_step.outputs(plant, t0 + a * dt, dt, state, u[a])
        memory[axis_step.MODE] = mode
        if mode != 0:
            memory[axis_step.REST] = 0.0
        out[a] = memory[axis_step.X]
        for k in range(a, b - 1):
            count[0] = 0
            end = u[k + 1] if first else u[k]
            axis_step.sample(plant, t0 + k * dt, dt, u[k], end, state, switches, counted)
            out[k + 1] = memory[axis_step.X]
        rested = memory[axis_step.REST] + dt if memory[axis_step.MODE] == 0.0 else 0.0
        if carry and integers[axis_step.STRUCTURE] != 0 and w + 2 < edges.shape[0]:
            # The next window starts one sample later.
            count[0] = 0
            end = u[b] if first else u[b - 1]
            axis_step.sample(plant, t0 + (b - 1) * dt, dt, u[b - 1], end, state, switches, counted)
            _keep(memory, inner[w + 1])


@njit(cache=True, error_model="numpy", nogil=True)
def start_steps(edges, errors, by_x, by_v, starts, scale, x_error, v_error, out):
    """Gauss-Newton steps of the start states, from their corrections so far.

    Lowers sum((errors + by_x dx + by_v dv)^2)/scale^2 + ((x + dx)/x_error)^2 +
    ((v + dv)/v_error)^2 for each window; `starts` has rows x, v, out dx, dv.
    """
    for w in range(edges.shape[0] - 1):
        xx, xv, vv = (scale / x_error[w]) ** 2, 0.0, (scale / v_error[w]) ** 2
        gx, gv = xx * starts[0, w], vv * starts[1, w]
        for k in range(edges[w], edges[w + 1]):
            xx += by_x[k] * by_x[k]
            xv += by_x[k] * by_v[k]
            vv += by_v[k] * by_v[k]
            gx += by_x[k] * errors[k]
            gv += by_v[k] * errors[k]
        det = xx * vv - xv * xv
        out[0, w] = -(vv * gx - xv * gv) / det
        out[1, w] = -(xx * gv - xv * gx) / det


@njit(cache=True, error_model="numpy", nogil=True)
def normal_terms(edges, errors, slopes, by_x, by_v, starts, scale, x_error, v_error, g, h):
    """Gradient and normal matrix of each window, its start state eliminated.

    `slopes` has one row for each parameter.  With start slopes S, prior P and
    M = S'S + P, the normal matrix is D'D - D'S inv(M) S'D, all over scale^2.
    """
    p = slopes.shape[0]
    c = np.empty((p, 2))
    for w in range(edges.shape[0] - 1):
        xx, xv, vv = (scale / x_error[w]) ** 2, 0.0, (scale / v_error[w]) ** 2
        gx, gv = xx * starts[0, w], vv * starts[1, w]
        for k in range(edges[w], edges[w + 1]):
            xx += by_x[k] * by_x[k]
            xv += by_x[k] * by_v[k]
            vv += by_v[k] * by_v[k]
            gx += by_x[k] * errors[k]
            gv += by_v[k] * errors[k]
        det = xx * vv - xv * xv
        for i in range(p):
            c[i, 0], c[i, 1], total = 0.0, 0.0, 0.0
            for k in range(edges[w], edges[w + 1]):
                c[i, 0] += slopes[i, k] * by_x[k]
                c[i, 1] += slopes[i, k] * by_v[k]
                total += slopes[i, k] * errors[k]
            first = (vv * c[i, 0] - xv * c[i, 1]) / det
            second = (xx * c[i, 1] - xv * c[i, 0]) / det
            g[w, i] = (total - first * gx - second * gv) / scale**2
            for j in range(i + 1):
                total = 0.0
                for k in range(edges[w], edges[w + 1]):
                    total += slopes[i, k] * slopes[j, k]
                total -= first * c[j, 0] + second * c[j, 1]
                h[w, i, j] = total / scale**2
                h[w, j, i] = h[w, i, j]


@njit(cache=True, error_model="numpy", nogil=True)
def accelerations(numbers, integers, t, x, v, u, direction, out):
    """Acceleration of the sliding mode at given states, into `out`."""
    for k in range(t.shape[0]):
        out[k] = axis_step.mode_rate(numbers, integers, t[k], x[k], v[k], u[k], direction[k])[0]
