"""Free runs over the windows of a record, compiled.

They release the interpreter lock, so that starts and candidates can run in threads.
"""
# mypy: disallow-untyped-defs=False

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from dryfric_control.arrays import Floats
from dryfric_control.compiled import axis_step
from dryfric_control.compiled.cached import njit
from dryfric_control.compiled.states import first_state, follow_motion, forget_states

# Search for a start state (`benchmarks/diagnosis.py`, exact and off).
# Fractions of a step that are tried in turn.
_PARTS = (1.0, 0.25)
# Fall of the cost below which the search of a window ends: its noise is sqrt(2 samples).
_FALL = 0.02
# Difference step over the start's standard deviation.
_SLOPE = 0.1
# Predicted fall of the cost that justifies new slopes.
_NEW_SLOPES = 0.3
# Fall over the predicted one that justifies another step along the old slopes.
_OLD_SLOPES = 0.5
# Largest number of these steps.
_STEPS = 3
# Cost per sample above which other start states of a window are tried: twice that of noise.
_LOST = 2.0
# Positions over the whole play that are tried for such a window (`benchmarks/diagnosis.py
# backlash`).
_PLACES = 9
# Number of further ones closer to the best.
_CLOSER = 12


#: No known force on the mass.
NO_FORCE = np.empty(0)
NO_FORCE.setflags(write=False)


class Windowed(NamedTuple):
    """A record in windows; window i covers the samples edges[i] to edges[i+1] - 1."""

    u: Any  # (n,) drive force
    x: Any  # (n,) readings
    t0: float  # time of the first sample [s]
    dt: float  # sampling time [s]
    first: bool  # whether the drive is interpolated linearly between samples
    edges: Any  # (nwindows + 1,)
    x0: Any  # (nwindows,) state at each start, and its standard deviations
    v0: Any
    x_error: Any
    v_error: Any
    rest: Any  # (nwindows,) time at rest before each start [s]
    known: Any = NO_FORCE  # (n,) known force on the mass, (0,) for none


class Evaluation(NamedTuple):
    """Errors of the active windows for one axis.

    Attributes
    ----------
    errors : ndarray, shape (n,)
        Simulated - measured position.
    starts : ndarray, shape (3, nwindows)
        Corrections of the start states; position of a load in its play (-1 to 1)
        if it does not continue from the previous window, else NaN.
    costs : ndarray, shape (nwindows,)
        Sum of squares over noise^2, plus the cost of the corrections.
    """

    errors: Any
    starts: Any
    costs: Any


class Search(NamedTuple):
    """Settings of the search for start states."""

    active: Any  # (nwindows,) requested windows
    linked: bool  # windows pass on their inner states
    uniform: bool  # the axis is the same at every position
    scale: float  # standard deviation of the errors
    rounds: int  # of new slopes with the start state
    offsets: Any  # other start velocities, in standard deviations


class _Run(NamedTuple):
    """An axis and the memory of its runs."""

    numbers: Any  # what the plant points to
    plant: Any
    memory: Any
    events: Any
    count: Any


class _Found(NamedTuple):
    """Result of the search for one window's start state."""

    dx: float
    dv: float
    cost: float


@axis_step.internal
def _run_of(axis):
    """An axis from its `Arrays`, which must outlive it."""
    numbers = axis.numbers.copy()
    plant = axis_step.point(numbers, axis.integers)
    events = np.empty(axis_step.ROOM)
    count = axis_step.empty_tally(events, axis_step.FEW_SWITCHES)
    return _Run(numbers, plant, np.zeros(axis.memory), events, count)


@axis_step.internal
def _input(u, k, end):
    """Input of sample k at its start or end; before the record it is u[0]."""
    return u[min(max(k + end, 0), u.shape[0] - 1)]


@axis_step.internal
def _mapped_input(plant, state, u, k, end):
    """Drive of sample k after the input map."""
    return axis_step.input_map(plant, 0.0, state, _input(u, k, end))


@axis_step.internal
def _lag_state(plant, w, k, state):
    """Lagged drive at sample k, from the inputs of the ten time constants before."""
    u = w.u
    dt = w.dt
    lag = plant.numbers[axis_step.LAG]
    delay = plant.numbers[axis_step.DELAY]
    whole = int(delay / dt)
    part = delay / dt - whole
    back = min(k, int(10.0 * lag / dt) + whole + 2)
    value = _mapped_input(plant, state, u, k - back - whole, 0)
    for i in range(k - back, k):
        # The older input acts during the fraction of the sample covered by the delay.
        old = _mapped_input(plant, state, u, i - whole - 1, 0)
        new = _mapped_input(plant, state, u, i - whole, 0)
        if w.first:
            old = 0.5 * (old + new)
            new = 0.5 * (new + _mapped_input(plant, state, u, i - whole, 1))
        value = old + (value - old) * np.exp(-part * dt / lag)
        value = new + (value - new) * np.exp(-(1.0 - part) * dt / lag)
    return value


@axis_step.internal
def _copy_inner(plant, memory, inner):
    """Copy the inner states at one instant into `inner`; those of effects come last."""
    inner[0], inner[1] = memory[axis_step.DEFLECTION], memory[axis_step.OFFSET]
    inner[2], inner[3] = memory[axis_step.SLIP], memory[axis_step.MODE]
    for j in range(plant.integers[axis_step.N_STATES]):
        inner[axis_step.N_INNER + 1 + j] = memory[first_state(plant) + j]


@axis_step.internal
def _restore(plant, inner, memory):
    """Restore inner states at the position and velocity in memory; a stuck load stays stuck."""
    memory[axis_step.DEFLECTION], memory[axis_step.OFFSET] = inner[0], inner[1]
    memory[axis_step.SLIP], memory[axis_step.MODE] = inner[2], inner[3]
    for j in range(plant.integers[axis_step.N_STATES]):
        memory[first_state(plant) + j] = inner[axis_step.N_INNER + 1 + j]
    kind = plant.integers[axis_step.STRUCTURE] & (axis_step.CONTACT | axis_step.MOTOR_RUBS)
    if kind == 0 and inner[2] != 0.0 and inner[3] == 0.0:
        memory[axis_step.SLIP] = -memory[axis_step.V]


@axis_step.internal
def _begin(run, w, i, x0, v0, inner):
    """Memory at the first sample of window i; without inner states, an axis at rest.

    `inner` contains the time at rest behind the states that the kernel knows.  The previous run
    knows it more precisely than the readings: it contains the instant of the stop.
    """
    plant = run.plant
    memory = run.memory
    a = w.edges[i]
    rest = w.rest[i]
    state = axis_step.pointer(memory)
    if w.known.shape[0] > 0:
        axis_step.set_known_force(plant, w.t0 + a * w.dt, w.dt, w.known, a, w.first)
    memory[:] = 0.0
    memory[axis_step.X], memory[axis_step.V] = x0, v0
    rested = inner[axis_step.N_INNER]
    hidden = plant.integers[axis_step.STRUCTURE] != 0
    memory[axis_step.REST] = rested if rested > 0.0 and (hidden or rest > 0.0) else rest
    for j in range(plant.integers[axis_step.N_HISTORY]):
        end = 1 if w.first else 0
        memory[axis_step.HISTORY + 2 * j] = _input(w.u, a - 1 - j, 0)
        memory[axis_step.HISTORY + 2 * j + 1] = _input(w.u, a - 1 - j, end)
    if plant.numbers[axis_step.LAG] > 0.0:
        memory[axis_step.LAGGED] = _lag_state(plant, w, a, state)
    if plant.integers[axis_step.STRUCTURE] != 0:
        if np.isnan(inner[0]):
            axis_step.settle(plant, w.t0 + a * w.dt, w.dt, state, w.u[a])
            _copy_inner(plant, memory, inner)
        _restore(plant, inner, memory)
        if plant.integers[axis_step.STRUCTURE] & axis_step.ON_LOAD:
            # The start state is that of the load.
            memory[axis_step.V] = v0 - inner[2]
            memory[axis_step.SLIP] = inner[2]
            if inner[3] == 0.0 and inner[2] != 0.0:
                memory[axis_step.V] = -inner[2]
    axis_step.place(plant, w.t0 + a * w.dt, w.dt, x0, state)
    _, _, mode = axis_step.outputs(plant, w.t0 + a * w.dt, w.dt, state, w.u[a])
    memory[axis_step.MODE] = mode
    if mode != 0:
        memory[axis_step.REST] = 0.0


@axis_step.internal
def _inner_at(run, w, i, place, inner):
    """Set the inner states with which window i starts, in place.

    They do not depend on the start's corrections.  At a position `place` in the play,
    -1 to 1, load and motor have the same velocity.
    """
    if np.isnan(inner[0]):
        _begin(run, w, i, w.x0[i], w.v0[i], inner)
    if not np.isnan(place):
        inner[0], inner[1] = 0.0, place * run.plant.numbers[axis_step.HALF_GAP]
        inner[2] = 0.0
        inner[3] = 0.0


@axis_step.internal
def _free_run(run, w, i, x0, v0, inner, out):
    """One free run over window i from a start state, positions into out[a:b].

    `inner` contains the inner states at the start; those one sample after the end,
    which are passed on, are left in run.memory.
    """
    memory = run.memory
    a = w.edges[i]
    b = w.edges[i + 1]
    last = w.u.shape[0] - 1
    _begin(run, w, i, x0, v0, inner)
    state = axis_step.pointer(memory)
    switches = axis_step.pointer(run.events)
    counted = axis_step.pointer(run.count)
    out[a] = axis_step.encoder_reading(run.plant, w.t0 + a * w.dt, state)
    for k in range(a, b):
        run.count[0] = 0
        end = w.u[min(k + 1, last)] if w.first else w.u[k]
        t = w.t0 + k * w.dt
        if w.known.shape[0] > 0:
            axis_step.set_known_force(run.plant, t, w.dt, w.known, k, w.first)
        axis_step.sample(run.plant, t, w.dt, w.u[k], end, state, switches, counted)
        if k + 1 < b:
            out[k + 1] = axis_step.encoder_reading(run.plant, w.t0 + (k + 1) * w.dt, state)


@axis_step.internal
def _passed_on(axis):
    """Number of values that a window passes on: inner states, time at rest, states of effects."""
    return axis_step.N_INNER + 1 + axis.integers[axis_step.N_STATES]


@axis_step.internal
def _end(plant, memory, after):
    """Copy what a run passes on: its inner states and its time at rest."""
    _copy_inner(plant, memory, after)
    at_rest = memory[axis_step.MODE] == 0.0
    after[axis_step.N_INNER] = memory[axis_step.REST] if at_rest else 0.0


@axis_step.internal
def _copy(source, a, b, target):
    """target[a:b] = source[a:b] without a check of shapes, which is slow to compile."""
    for k in range(a, b):
        target[k] = source[k]


@axis_step.internal
def _last_to_run(active):
    """Number of the last window that is requested, -1 if none is."""
    last = -1
    for i in range(active.shape[0]):
        if active[i]:
            last = i
    return last


@njit(cache=True, error_model="numpy", nogil=True)
def free_runs(axis, w, active, out):
    """Positions of free runs over the active windows from their start states.

    `axis` is the `Arrays` of an axis.  A window continues with the inner states and the
    time at rest at the end of the previous one, if that was run.
    """
    run = _run_of(axis)
    inner = np.full(_passed_on(axis), np.nan)
    for i in range(w.edges.shape[0] - 1):
        if active[i]:
            _inner_at(run, w, i, np.nan, inner)
            _free_run(run, w, i, w.x0[i], w.v0[i], inner, out)
            _end(run.plant, run.memory, inner)
        else:
            inner[:] = np.nan


@axis_step.internal
def _cost(w, i, out, dx, dv, scale):
    """Sum of squares of a window over scale^2, plus the cost of its corrections."""
    total = 0.0
    for k in range(w.edges[i], w.edges[i + 1]):
        e = out[k] - w.x[k]
        total += e * e
    return total / scale**2 + (dx / w.x_error[i]) ** 2 + (dv / w.v_error[i]) ** 2


@axis_step.internal
def _start_terms(w, i, scale, dx, dv, errors, by_x, by_v):
    """Normal equations of a window's start state, (xx, xv, vv, gx, gv), prior included."""
    xx = (scale / w.x_error[i]) ** 2
    xv = 0.0
    vv = (scale / w.v_error[i]) ** 2
    gx = xx * dx
    gv = vv * dv
    for k in range(w.edges[i], w.edges[i + 1]):
        xx += by_x[k] * by_x[k]
        xv += by_x[k] * by_v[k]
        vv += by_v[k] * by_v[k]
        gx += by_x[k] * errors[k]
        gv += by_v[k] * errors[k]
    return xx, xv, vv, gx, gv


@axis_step.internal
def _search_start(run, w, i, search, rounds, dx, dv, inner, scratch, out, tried, after):
    """Search the start state of window i from the corrections dx, dv.

    Leaves the run in out[a:b] and the inner states at its end in `after`.
    """
    errors, by_x, by_v = scratch
    a = w.edges[i]
    b = w.edges[i + 1]
    scale = search.scale
    x0 = w.x0[i]
    v0 = w.v0[i]
    _free_run(run, w, i, x0 + dx, v0 + dv, inner, out)
    _end(run.plant, run.memory, after)
    cost = _cost(w, i, out, dx, dv, scale)
    hx = _SLOPE * w.x_error[i]
    hv = _SLOPE * w.v_error[i]
    for _ in range(rounds):
        if search.uniform:
            by_x[a:b] = 1.0
        else:
            _free_run(run, w, i, x0 + dx + hx, v0 + dv, inner, tried)
            for k in range(a, b):
                by_x[k] = (tried[k] - out[k]) / hx
        _free_run(run, w, i, x0 + dx, v0 + dv + hv, inner, tried)
        for k in range(a, b):
            by_v[k] = (tried[k] - out[k]) / hv
        again = False
        # Steps along fixed slopes as long as they lower the cost enough, then new slopes.
        for _ in range(_STEPS):
            for k in range(a, b):
                errors[k] = out[k] - w.x[k]
            xx, xv, vv, gx, gv = _start_terms(w, i, scale, dx, dv, errors, by_x, by_v)
            det = xx * vv - xv * xv
            sx = -(vv * gx - xv * gv) / det
            sv = -(xx * gv - xv * gx) / det
            # Predicted fall of the cost; a small one does not justify a run.
            promised = -(gx * sx + gv * sv) / scale**2
            if not promised > _FALL:
                break
            fell = 0.0
            for part in _PARTS:
                tx = dx + part * sx
                tv = dv + part * sv
                _free_run(run, w, i, x0 + tx, v0 + tv, inner, tried)
                new = _cost(w, i, tried, tx, tv, scale)
                if new < cost:
                    fell = cost - new
                    again = again or fell > _NEW_SLOPES * promised
                    dx = tx
                    dv = tv
                    cost = new
                    _copy(tried, a, b, out)
                    _end(run.plant, run.memory, after)
                    break
            if fell < _OLD_SLOPES * promised:
                break
        if not again:
            break
    return _Found(dx, dv, cost)


@njit(cache=True, error_model="numpy", nogil=True)
def project(axis, w, search, at):
    """Errors of the active windows from their most likely start states, into `at`.

    `at.starts` contains the start of each window's search and is changed in place.
    A window far above the scale is searched again from other velocities, as breakaways
    make the cost rugged, and from other positions of the load in its play.
    """
    run = _run_of(axis)
    passed_on = _passed_on(axis)
    n = w.x.shape[0]
    inner = np.full(passed_on, np.nan)
    after = np.empty(passed_on)
    other = np.empty(passed_on)
    out = np.empty(n)
    tried = np.empty(n)
    better = np.empty(n)
    scratch = (np.empty(n), np.empty(n), np.empty(n))
    starts = at.starts
    # Of a load that swings slowly, a window knows no more than all those before it.
    last = _last_to_run(search.active) if search.linked else -1
    for i in range(w.edges.shape[0] - 1):
        a = w.edges[i]
        b = w.edges[i + 1]
        active = search.active[i]
        if not (active or i < last):
            inner[:] = np.nan
            continue
        _inner_at(run, w, i, starts[2, i], inner)
        # Of a window that is not requested, only what it passes on matters.
        turns = search.rounds if active else min(search.rounds, 1)
        found = _search_start(
            run, w, i, search, turns, starts[0, i], starts[1, i], inner, scratch, out, tried, after
        )
        best = starts[2, i]
        width = 2.0 / (_PLACES - 1)
        place = np.nan
        tries = search.offsets.shape[0] if active else 0
        play = run.plant.numbers[axis_step.HALF_GAP] > 0.0
        for turn in range(tries + (_PLACES + _CLOSER if play and tries > 0 else 0)):
            dv = 0.0
            if turn < tries:
                if found.cost < _LOST * (b - a):
                    break
                dv = search.offsets[turn] * w.v_error[i]
            else:
                # The position of the load in its play is not measured: try several.
                count = turn - tries
                if count == 0 and not found.cost > _LOST * (b - a):
                    break
                if count < _PLACES:
                    place = -1.0 + width * count
                elif np.isnan(best):
                    break
                else:
                    # Both sides of the best, then at half the distance.
                    if (count - _PLACES) % 2 == 0:
                        width *= 0.5
                    place = best + (width if count % 2 == 0 else -width)
                    place = min(max(place, -1.0), 1.0)
                _inner_at(run, w, i, place, inner)
            new = _search_start(
                run, w, i, search, search.rounds, 0.0, dv, inner, scratch, better, tried, other
            )
            if new.cost < found.cost:
                found = new
                best = place if turn >= tries else best
                _copy(better, a, b, out)
                _copy(other, 0, passed_on, after)
        starts[0, i], starts[1, i], starts[2, i] = found.dx, found.dv, best
        at.costs[i] = found.cost if active else 0.0
        for k in range(a, b):
            at.errors[k] = out[k] - w.x[k]
        _copy(after, 0, passed_on, inner)


def accelerations(numbers, integers, t, x, v, u, known, direction) -> Floats:
    """Acceleration of the sliding mode at given states, shape (n,); `known`: force, or (0,).

    The states of effects follow the motion from one to the next, as long as time goes on.
    """
    out = np.empty(direction.size)
    # One type of array, whether it may be written or not: the kernel is compiled once.
    columns = [np.array(one, float) for one in (t, x, v, u, known)]
    _accelerations(numbers, integers, *columns, direction, out)
    return out


@njit(cache=True, error_model="numpy", nogil=True)
def _accelerations(numbers, integers, t, x, v, u, known, direction, out):
    """`accelerations` into `out`."""
    own = numbers.copy()
    remembers = integers[axis_step.STRUCTURE] & axis_step.REMEMBERS != 0
    plant = axis_step.point(own, integers)
    for k in range(t.shape[0]):
        dt = t[k] - t[k - 1] if k > 0 else 0.0
        if remembers and dt > 0.0:
            way = x[k] - x[k - 1]
            s = float(direction[k - 1])
            follow_motion(plant, t[k - 1], x[k - 1], way / dt, u[k - 1], s, dt)
        elif remembers:
            forget_states(plant)
        if known.shape[0] > 0:
            own[axis_step.KNOWN_FORCE] = known[k]
        out[k] = axis_step.mode_rate(own, integers, t[k], x[k], v[k], u[k], direction[k])[0]
    axis_step.keep_alive(own)


@njit(cache=True, error_model="numpy", nogil=True)
def contact_deflection(x, distance, share, bristles, out):
    """Deflection of an elastic contact along a motion, over that at which it slides."""
    for k in range(x.shape[0]):
        way = (x[k] - x[k - 1]) / distance if k > 0 else 0.0
        if bristles:
            s = 1.0 if way > 0.0 else -1.0
            share = s + (share - s) * np.exp(-abs(way))
        else:
            share = min(max(share + way, -1.0), 1.0)
        out[k] = share


@njit(cache=True, error_model="numpy", nogil=True)
def behind_drive_and_encoder(axis, t0, dt, u, first, y, force, x):
    """Mean drive force of each sample after input map, delay and lag, into `force`.

    The positions at which the encoder reads y go into `x`.
    """
    plant = axis_step.point(axis.numbers, axis.integers)
    memory = np.zeros(axis.memory)
    state = axis_step.pointer(memory)
    last = u.shape[0] - 1
    lag = plant.numbers[axis_step.LAG]
    delay = plant.numbers[axis_step.DELAY] / dt
    whole = int(delay)
    part = delay - whole
    lagged = _mapped_input(plant, state, u, 0, 0)
    for k in range(last + 1):
        mean = 0.0
        for late, share in ((whole, 1.0 - part), (whole + 1, part)):
            start = _mapped_input(plant, state, u, k - late, 0)
            end = _mapped_input(plant, state, u, k - late, 1) if first else start
            mean += 0.5 * share * (start + end)
        if lag > 0.0:
            new = mean + (lagged - mean) * np.exp(-dt / lag)
            mean -= (new - lagged) * lag / dt
            lagged = new
        force[k] = mean
        memory[axis_step.V] = 0.0
        axis_step.place(plant, t0 + k * dt, dt, y[k], state)
        x[k] = memory[axis_step.X]
