"""Compiled parts of the diagnosis: free runs with their start states projected out.

They release the interpreter lock, so that candidates may run in threads.
"""
# mypy: disallow-untyped-defs=False

from __future__ import annotations

import numpy as np
from numba import njit

from dryfric_control.compiled import axis_step
from dryfric_control.compiled.free_runs import _held, _keep, _lagged, _restore

# Parts of a step towards the best start state that are tried in turn.
_PARTS = (1.0, 0.25)
# A window whose cost fell by less than this has found its start state.
_FALL = 0.02
# Step of the slopes over the start's error.
_SLOPE = 0.1
# Places within a play that are tried for a window that no other start explains:
# the first so many over the whole play, the others ever closer to the best.
_PLACES, _CLOSER = 9, 12


@axis_step.internal
def begin_window(plant, memory, u, t0, dt, first, a, x0, v0, rest, inner):
    """Memory at the first sample of a window; without inner states, an axis at rest.

    The last place of `inner` is the time at rest, which the run before knows
    better than the readings do: it stopped at an instant, they stand still.
    """
    state = axis_step.pointer(memory)
    memory[:] = 0.0
    memory[axis_step.X], memory[axis_step.V] = x0, v0
    memory[axis_step.REST] = (
        inner[axis_step.N_INNER] if inner[axis_step.N_INNER] > 0.0 < rest else rest
    )
    for j in range(plant.integers[axis_step.N_HISTORY]):
        memory[axis_step.HISTORY + 2 * j] = _held(plant, state, u, a - 1 - j, 0)
        memory[axis_step.HISTORY + 2 * j + 1] = _held(plant, state, u, a - 1 - j, 1 if first else 0)
    if plant.numbers[axis_step.LAG] > 0.0:
        memory[axis_step.LAGGED] = _lagged(plant, u, dt, first, a, state)
    if plant.integers[axis_step.STRUCTURE] != 0:
        if np.isnan(inner[0]):
            axis_step.settle(plant, t0 + a * dt, dt, state, u[a])
            _keep(memory, inner)
        _restore(plant.integers, inner, memory)
    _, _, mode = axis_step.outputs(plant, t0 + a * dt, dt, state, u[a])
    memory[axis_step.MODE] = mode
    if mode != 0:
        memory[axis_step.REST] = 0.0


@njit(cache=True, error_model="numpy", nogil=True)
def _end(memory, after):
    """What a run hands on: its inner states and for how long it has been at rest."""
    _keep(memory, after)
    at_rest = memory[axis_step.MODE] == 0.0
    after[axis_step.N_INNER] = memory[axis_step.REST] if at_rest else 0.0


@axis_step.internal
def _placed(plant, place, inner):
    """Inner states with the load at a place of the play, -1 to 1, as fast as the motor."""
    inner[0], inner[1] = 0.0, place * plant.numbers[axis_step.HALF_GAP]
    inner[2], inner[3] = 0.0, 0.0


@axis_step.internal
def _free_run(plant, memory, events, count, u, t0, dt, first, a, b, x0, v0, rest, inner, out):
    """One free run over the samples a to b - 1, positions into out[a:b].

    `inner` is the internal memory at the start; the one at the end is left in
    `memory`.
    """
    state = axis_step.pointer(memory)
    begin_window(plant, memory, u, t0, dt, first, a, x0, v0, rest, inner)
    out[a] = memory[axis_step.X]
    switches, counted = axis_step.pointer(events), axis_step.pointer(count)
    for k in range(a, b - 1):
        count[0] = 0
        end = u[k + 1] if first else u[k]
        axis_step.sample(plant, t0 + k * dt, dt, u[k], end, state, switches, counted)
        out[k + 1] = memory[axis_step.X]
    # The next window starts one sample later.
    count[0] = 0
    end = u[b] if first and b < u.shape[0] else u[b - 1]
    axis_step.sample(plant, t0 + (b - 1) * dt, dt, u[b - 1], end, state, switches, counted)


@njit(cache=True, error_model="numpy", nogil=True)
def _copy(source, a, b, target):
    """target[a:b] = source[a:b], whose check of shapes would take long to compile."""
    for k in range(a, b):
        target[k] = source[k]


@njit(cache=True, error_model="numpy", nogil=True)
def _cost(x, out, a, b, dx, dv, scale, x_error, v_error):
    total = 0.0
    for k in range(a, b):
        e = out[k] - x[k]
        total += e * e
    return total / scale**2 + (dx / x_error) ** 2 + (dv / v_error) ** 2


@axis_step.internal
def _settle(
    plant, uniform, memory, events, count, u, x, t0, dt, first, a, b, x0, v0, rest, inner, scale,
    xe, ve, rounds, dx, dv, out, tried, by_x, by_v, after,
):  # fmt: skip
    """Search the start state of one window from the corrections dx, dv.

    Leaves the run in out[a:b], its slopes in by_x and by_v and the internal
    memory at its end in `after`; returns the corrections and the cost.  With
    rounds < 0 there is one run from the corrections given, and no slopes.
    """
    _free_run(
        plant, memory, events, count, u, t0, dt, first, a, b, x0 + dx, v0 + dv, rest, inner, out
    )
    _end(memory, after)
    cost = _cost(x, out, a, b, dx, dv, scale, xe, ve)
    if rounds < 0:
        return dx, dv, cost
    hx, hv = _SLOPE * xe, _SLOPE * ve
    for turn in range(rounds + 1):
        if uniform:
            by_x[a:b] = 1.0
        else:
            _free_run(
                plant, memory, events, count, u, t0, dt, first, a, b, x0 + dx + hx, v0 + dv, rest,
                inner, tried,
            )  # fmt: skip
            for k in range(a, b):
                by_x[k] = (tried[k] - out[k]) / hx
        _free_run(
            plant, memory, events, count, u, t0, dt, first, a, b, x0 + dx, v0 + dv + hv, rest,
            inner, tried,
        )  # fmt: skip
        for k in range(a, b):
            by_v[k] = (tried[k] - out[k]) / hv
        if turn == rounds:
            break
        again = False
        # Along fixed slopes as long as that pays, then with new ones.
        for _ in range(3):
            xx, xv, vv = (scale / xe) ** 2, 0.0, (scale / ve) ** 2
            gx, gv = xx * dx, vv * dv
            for k in range(a, b):
                e = out[k] - x[k]
                xx += by_x[k] * by_x[k]
                xv += by_x[k] * by_v[k]
                vv += by_v[k] * by_v[k]
                gx += by_x[k] * e
                gv += by_v[k] * e
            det = xx * vv - xv * xv
            sx = -(vv * gx - xv * gv) / det
            sv = -(xx * gv - xv * gx) / det
            # What the slopes promise; less than this is not worth a run.
            promised = -(gx * sx + gv * sv) / scale**2
            if not promised > _FALL:
                break
            fell = 0.0
            for part in _PARTS:
                tx, tv = dx + part * sx, dv + part * sv
                _free_run(
                    plant, memory, events, count, u, t0, dt, first, a, b, x0 + tx, v0 + tv, rest,
                    inner, tried,
                )  # fmt: skip
                new = _cost(x, tried, a, b, tx, tv, scale, xe, ve)
                if new < cost:
                    fell = cost - new
                    again = again or fell > 0.3 * promised
                    dx, dv, cost = tx, tv, new
                    _copy(tried, a, b, out)
                    _end(memory, after)
                    break
            if fell < 0.5 * promised:
                break
        if not again:
            break
    return dx, dv, cost


@njit(cache=True, error_model="numpy", nogil=True)
def _needed(active, w, linked):
    """Whether a window must run: asked for, or linked to the next that is."""
    return active[w] or (linked and w + 1 < active.shape[0] and active[w + 1])


@njit(cache=True, error_model="numpy", nogil=True)
def project(
    numbers, integers, size, linked, uniform, u, x, t0, dt, first, edges, x0, v0, x_error,
    v_error, rest, active, scale, rounds, offsets, starts, errors, by_x, by_v, costs,
):  # fmt: skip
    """Errors of the active windows from their most likely start states.

    `starts` (rows dx, dv, place) holds where the search of each window's start
    begins and is changed in place; `errors`, `by_x`, `by_v` get the errors of
    position and their slopes with the start state, `costs` the sum of squares
    over scale^2 and what the corrections cost.  A window far above the scale
    is searched again from speeds that differ by `offsets` of their error:
    a break-away makes the cost rugged.  `linked`: windows hand on their
    internal memory, so that the one before an active window runs as well;
    `place` is where in its play a load starts instead (-1 to 1), NaN where it
    goes on from the window before.  `uniform`: the axis is the same at every
    position, so that a run from elsewhere need not be made.
    """
    plant = axis_step.point(numbers, integers)
    memory = np.zeros(size)
    events = np.empty(axis_step.ROOM)
    count = axis_step.tally(events)
    n_inner = axis_step.N_INNER
    inner, after, other = np.full(n_inner + 1, np.nan), np.empty(n_inner + 1), np.empty(n_inner + 1)
    n = x.shape[0]
    out, tried, better = np.empty(n), np.empty(n), np.empty(n)
    for w in range(edges.shape[0] - 1):
        a, b = edges[w], edges[w + 1]
        if not _needed(active, w, linked):
            inner[:] = np.nan
            continue
        if np.isnan(inner[0]):
            # What a first window starts with does not depend on its corrections.
            begin_window(plant, memory, u, t0, dt, first, a, x0[w], v0[w], rest[w], inner)
        if not np.isnan(starts[2, w]):
            _placed(plant, starts[2, w], inner)
        # Of a window not asked for, only what it hands on matters.
        turns = rounds if active[w] else min(rounds, 1)
        dx, dv, cost = _settle(
            plant, uniform, memory, events, count, u, x, t0, dt, first, a, b, x0[w], v0[w], rest[w],
            inner, scale, x_error[w], v_error[w], turns, starts[0, w], starts[1, w], out, tried,
            by_x, by_v, after,
        )  # fmt: skip
        for offset in offsets:
            if cost < 2.0 * (b - a) or not active[w]:
                break
            tx, tv, new = _settle(
                plant, uniform, memory, events, count, u, x, t0, dt, first, a, b, x0[w], v0[w],
                rest[w], inner, scale, x_error[w], v_error[w], rounds, 0.0, offset * v_error[w],
                better, tried, by_x, by_v, other,
            )  # fmt: skip
            if new < cost:
                dx, dv, cost = tx, tv, new
                _copy(better, a, b, out)
                _copy(other, 0, n_inner + 1, after)
        play = plant.integers[axis_step.STRUCTURE] & axis_step.PLAY != 0
        if play and offsets.shape[0] > 0 and active[w] and cost > 2.0 * (b - a):
            # Nobody measures where in its play the load is.
            best, width = starts[2, w], 2.0 / (_PLACES - 1)
            for turn in range(_PLACES + _CLOSER):
                if turn < _PLACES:
                    place = -1.0 + width * turn
                elif np.isnan(best):
                    break
                else:
                    # Either side of the best, then half as far.
                    if (turn - _PLACES) % 2 == 0:
                        width *= 0.5
                    place = best + (width if turn % 2 == 0 else -width)
                    place = min(max(place, -1.0), 1.0)
                _placed(plant, place, inner)
                tx, tv, new = _settle(
                    plant, uniform, memory, events, count, u, x, t0, dt, first, a, b, x0[w], v0[w],
                    rest[w], inner, scale, x_error[w], v_error[w], rounds, 0.0, 0.0, better,
                    tried, by_x, by_v, other,
                )  # fmt: skip
                if new < cost:
                    dx, dv, cost, best = tx, tv, new, place
                    _copy(better, a, b, out)
                    _copy(other, 0, n_inner + 1, after)
            starts[2, w] = best
        starts[0, w], starts[1, w] = dx, dv
        costs[w] = cost if active[w] else 0.0
        for k in range(a, b):
            errors[k] = out[k] - x[k]
        _copy(after, 0, n_inner + 1, inner)


@njit(cache=True, error_model="numpy", nogil=True)
def moved(
    numbers, integers, size, linked, u, x, t0, dt, first, edges, x0, v0, rest, active, starts,
    errors, width, slope,
):  # fmt: skip
    """Slopes of the errors with a parameter, from runs of a moved axis."""
    plant = axis_step.point(numbers, integers)
    memory = np.zeros(size)
    events = np.empty(axis_step.ROOM)
    count = axis_step.tally(events)
    inner = np.full(axis_step.N_INNER + 1, np.nan)
    out = np.empty(x.shape[0])
    for w in range(edges.shape[0] - 1):
        a, b = edges[w], edges[w + 1]
        if not _needed(active, w, linked):
            inner[:] = np.nan
            continue
        if np.isnan(inner[0]):
            begin_window(plant, memory, u, t0, dt, first, a, x0[w], v0[w], rest[w], inner)
        if not np.isnan(starts[2, w]):
            _placed(plant, starts[2, w], inner)
        _free_run(
            plant, memory, events, count, u, t0, dt, first, a, b, x0[w] + starts[0, w],
            v0[w] + starts[1, w], rest[w], inner, out,
        )  # fmt: skip
        _end(memory, inner)
        if active[w]:
            for k in range(a, b):
                slope[k] = (out[k] - x[k] - errors[k]) / width


@njit(cache=True, error_model="numpy", nogil=True)
def normal_terms(
    edges, active, errors, slopes, by_x, by_v, starts, scale, x_error, v_error, g, h, back,
):  # fmt: skip
    """Gradient and normal matrix of each active window, its start state eliminated.

    With start slopes S, their prior P and M = S'S + P, the normal matrix is
    D'D - D'S inv(M) S'D, all over scale^2; zero for windows not active.
    `back` gets, for dx and dv, the best correction where it is (first column)
    and its slope with each parameter.
    """
    p = slopes.shape[0]
    c = np.empty((p, 2))
    for w in range(edges.shape[0] - 1):
        if not active[w]:
            g[w], h[w] = 0.0, 0.0
            continue
        a, b = edges[w], edges[w + 1]
        xx, xv, vv = (scale / x_error[w]) ** 2, 0.0, (scale / v_error[w]) ** 2
        gx, gv = xx * starts[0, w], vv * starts[1, w]
        for k in range(a, b):
            xx += by_x[k] * by_x[k]
            xv += by_x[k] * by_v[k]
            vv += by_v[k] * by_v[k]
            gx += by_x[k] * errors[k]
            gv += by_v[k] * errors[k]
        det = xx * vv - xv * xv
        back[w, 0, 0] = -(vv * gx - xv * gv) / det
        back[w, 1, 0] = -(xx * gv - xv * gx) / det
        for i in range(p):
            c[i, 0], c[i, 1], total = 0.0, 0.0, 0.0
            for k in range(a, b):
                c[i, 0] += slopes[i, k] * by_x[k]
                c[i, 1] += slopes[i, k] * by_v[k]
                total += slopes[i, k] * errors[k]
            first = (vv * c[i, 0] - xv * c[i, 1]) / det
            second = (xx * c[i, 1] - xv * c[i, 0]) / det
            back[w, 0, i + 1], back[w, 1, i + 1] = -first, -second
            g[w, i] = (total - first * gx - second * gv) / scale**2
            for j in range(i + 1):
                total = 0.0
                for k in range(a, b):
                    total += slopes[i, k] * slopes[j, k]
                total -= first * c[j, 0] + second * c[j, 1]
                h[w, i, j] = total / scale**2
                h[w, j, i] = h[w, i, j]
