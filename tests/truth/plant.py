"""Time-stepping simulation of one dry-friction axis on its test bench.

Scheme: fixed substeps; half a step of position, a full kick of the speed,
half a step of position (Moreau-Jean).  Coulomb friction is set-valued: the
kick may not carry the speed through zero unless the load leaves the friction
set there, i.e. the friction impulse is clipped to breakaway level x time.
No mode automaton and no event solver.

The axis.  With g the Coulomb magnitude that opposes motion of sign s,

    m v' = w + e(t, x, v) - F,            w  the drive force after its chain
    e = bias - f v - c v|v| - k (x - x0) - G sin(x + phi) + A sin(2 pi x/L + phi)
        + A sin(2 pi nu t + phi)
    |F| <= breakaway at v = 0,  F = s g(t, x, |v|, w) in motion,
    g = Fc (1 + s a) (1 + p q + r q^2) (1 + rate t) S(|v|) + eta |w|
    q = (x - middle of travel)/(half of travel)
    S = 1 + sigma exp(-((|v| - Sigma)/vs)^2);  breakaway: S = 1 + sigma

Base parameters, the forces in e and the factors of g are named in `bands.FIELDS`.  The others:

    load_dependence     g = Fc S + coefficient |w - e - f v|
    dwell_time          breakaway + rise (1 - exp(-T/time_constant)), T = time since
                        the axis came to rest; gone as soon as it slides
    presliding          F = (Fc/distance) z, z' = v, |F| <= g: elastic, then slides
    backlash            motor (1 - load_fraction) m with the encoder; load
                        load_fraction m carries all friction and all of e;
                        force between them zero inside a free play of width gap,
                        a stiff, well damped, non-adhesive contact at its ends
    compliance          the same two masses, force between them
                        stiffness (x - xl) + damping (v - vl)
    input_gain          w = gain u
    input_delay         w(t) = u(t - delay), u held between samples
    actuator_lag        time_constant w' = u - w
    dead_zone           w = sign(u) max(|u| - width, 0)
    saturation          w = clip(u, -limit, limit)

Friction sits on the load because that is where guide, seals and ways are; the
encoder sits on the motor because that is where most axes carry it.
Drive chain: delay, saturation, lag, gain, dead zone, in this order.

Added to the catalogue later, and no part of the blind conditions:

    warm_up             g = Fc (1 + rise exp(-t/time_constant)) S
    stribeck_asymmetry  g + s Fc difference exp(-(v/speed)^2); breakaway: at v = 0
    velocity_strengthening  g - Fc deficit (1 - tanh(speed/deficit_speed))
    load_asymmetry      g + s coefficient |w - e - f v|
    eccentric_encoder   the encoder reads x + amplitude sin(2 pi x/period + phase)
    load_encoder_backlash  as backlash, the encoder reads the load's position
    end_stop            e = - max(0, stiffness d + damping v) at d = x - high > 0, and
                        e = + max(0, stiffness d - damping v) at d = low - x > 0
    friction_ripple     g multiplied by 1 + amplitude sin(2 pi x/period + phase)
    viscous_warm_up     e = - rise exp(-t/time_constant) v

Outside the product's catalogue:

    local_defect        g multiplied by 1 + height exp(-((x - place)/width)^2)
    impacts             e = short force bursts at random moments
    lost_steps          the encoder's reading jumps and stays off
    progressive_stop    e = - stiffness max(0, x - place)^2
    wandering_friction  g multiplied by 1 + a slow random process
    speed_ripple        e = + amplitude (v/speed)^3 sin(2 pi x/pitch)
"""

from collections import namedtuple
from math import exp, floor, pi, sin

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]


#: Every number of the bench's mechanics; the defaults switch effects off.
DEFAULTS = dict(
    mass=2.0, viscous=10.0, coulomb=8.0,
    excess=0.0, stribeck_speed=1.0, stick_speed=1e-4,  # sigma, vs, Sigma
    middle=0.0, half_travel=1.0,
    asymmetry=0.0, slope=0.0, curvature=0.0, drift=0.0, load=0.0,
    dwell_rise=0.0, dwell_time=1.0, presliding=0.0, bias=0.0, drag=0.0,
    spring=0.0, spring_centre=0.0, gravity=0.0, gravity_phase=0.0,
    cogging=0.0, cogging_pitch=1.0, cogging_phase=0.0,
    periodic=0.0, periodic_frequency=0.0, periodic_phase=0.0,
    gain=1.0, delay=0.0, lag=0.0, dead_zone=0.0, saturation=np.inf,
    load_fraction=0.0,  # > 0: two masses
    motor_rubs=0.0,  # > 0: friction and e act on the motor
    gap=0.0, coupling_stiffness=0.0, coupling_damping=0.0,
    defect=0.0, defect_place=0.0, defect_width=1.0, stop_stiffness=0.0, stop_place=0.0,
    ripple=0.0, ripple_speed=1.0, ripple_pitch=1.0,
    eccentricity=0.0, eccentricity_period=1.0, eccentricity_phase=0.0, load_difference=0.0,
    deficit=0.0, deficit_speed=1.0, excess_difference=0.0, difference_speed=1.0,
    warm_rise=0.0, warm_time=1.0,
    load_encoder=0.0,  # 1: the encoder is on the load
    wall_stiffness=0.0, wall_damping=0.0, wall_low=0.0, wall_high=0.0,
    viscous_rise=0.0, viscous_time=1.0,
    level_ripple=0.0, level_period=1.0, level_phase=0.0,
)  # fmt: skip
Plant = namedtuple("Plant", DEFAULTS, defaults=DEFAULTS.values())

# Motor position and speed, those of the load, presliding deflection, time at rest, force after lag.
X, V, XL, VL, Z, REST, LAG = range(7)
NSTATES = 7


@njit(cache=True)
def _read(p, state):
    """Position that an encoder without quantum and noise reads."""
    x = state[XL] if p.load_encoder != 0.0 else state[X]
    if p.eccentricity != 0.0:
        x += p.eccentricity * sin(2.0 * pi * x / p.eccentricity_period + p.eccentricity_phase)
    return x


@njit(cache=True)
def _external(p, t, x, v):
    """Force e on the friction-bearing mass, friction and drive apart."""
    e = p.bias - p.viscous * v - p.drag * v * abs(v) - p.spring * (x - p.spring_centre)
    if p.gravity != 0.0:
        e -= p.gravity * sin(x + p.gravity_phase)
    if p.cogging != 0.0:
        e += p.cogging * sin(2.0 * pi * x / p.cogging_pitch + p.cogging_phase)
    if p.periodic != 0.0:
        e += p.periodic * sin(2.0 * pi * p.periodic_frequency * t + p.periodic_phase)
    e -= p.stop_stiffness * max(0.0, x - p.stop_place) ** 2
    if p.wall_stiffness != 0.0:
        if x > p.wall_high:
            e -= max(0.0, p.wall_stiffness * (x - p.wall_high) + p.wall_damping * v)
        elif x < p.wall_low:
            e += max(0.0, p.wall_stiffness * (p.wall_low - x) - p.wall_damping * v)
    if p.viscous_rise != 0.0:
        e -= p.viscous_rise * exp(-t / p.viscous_time) * v
    if p.ripple != 0.0:
        e += p.ripple * (v / p.ripple_speed) ** 3 * sin(2.0 * pi * x / p.ripple_pitch)
    return e


@njit(cache=True)
def _level(p, t, x, speed, w, s, wander):
    """Friction magnitude g against motion of sign s; speed < 0: breakaway."""
    g = p.coulomb * (1.0 + s * p.asymmetry) * (1.0 + wander)
    q = (x - p.middle) / p.half_travel
    g *= 1.0 + p.slope * q + p.curvature * q * q
    g *= 1.0 + p.drift * t
    if p.warm_rise != 0.0:
        g *= 1.0 + p.warm_rise * exp(-t / p.warm_time)
    if p.defect != 0.0:
        g *= 1.0 + p.defect * exp(-(((x - p.defect_place) / p.defect_width) ** 2))
    if p.level_ripple != 0.0:
        g *= 1.0 + p.level_ripple * sin(2.0 * pi * x / p.level_period + p.level_phase)
    if p.excess != 0.0:
        if speed < 0.0:
            g *= 1.0 + p.excess
        else:
            ratio = (speed - p.stick_speed) / p.stribeck_speed
            if ratio < 6.0:
                g *= 1.0 + p.excess * exp(-ratio * ratio)
    carried = 0.0
    if p.load != 0.0 or p.load_difference != 0.0:
        # The teeth carry the drive on one side, all other forces but drag on the other.
        v = s * max(speed, 0.0)
        carried = abs(w - _external(p, t, x, v) - p.viscous * v)
    g += p.load * carried
    if p.excess_difference != 0.0:
        ratio = max(speed, 0.0) / p.difference_speed
        g += s * p.coulomb * p.excess_difference * exp(-ratio * ratio)
    if p.deficit != 0.0:
        fall = exp(-2.0 * max(speed, 0.0) / p.deficit_speed)
        g -= p.coulomb * p.deficit * 2.0 * fall / (1.0 + fall)
    if p.load_difference != 0.0:
        g += s * p.load_difference * carried
    return max(g, 0.0)


@njit(cache=True)
def _released(p, t, x, w, rest, wander, force, speed):
    """Net acceleration force at rest: zero while friction can hold `force`.

    `speed` picks the level that holds: -1 breakaway, 0 that of an arriving axis.
    """
    extra = p.dwell_rise * (1.0 - exp(-rest / p.dwell_time))
    if force > _level(p, t, x, speed, w, 1.0, wander) + extra:
        return force - _level(p, t, x, 0.0, w, 1.0, wander)
    if force < -_level(p, t, x, speed, w, -1.0, wander) - extra:
        return force + _level(p, t, x, 0.0, w, -1.0, wander)
    return 0.0


@njit(cache=True)
def _kick(p, m, t, h, x, v, w, push, wander, state):
    """Speed after h under drive w and burst `push`, friction included.

    `x` is the position in the middle of the substep, `t` its middle time.
    """
    if p.presliding > 0.0:
        return _kick_elastic(p, m, t, h, x, v, w, push, wander, state)
    if v == 0.0:
        net = w + push + _external(p, t, x, 0.0)
        net = _released(p, t, x, w, state[REST], wander, net, -1.0)
        if net == 0.0:
            state[REST] += h
            return 0.0
        s = 1.0 if net > 0.0 else -1.0
    else:
        s = 1.0 if v > 0.0 else -1.0
    state[REST] = 0.0
    a = (w + push + _external(p, t, x, v) - s * _level(p, t, x, abs(v), w, s, wander)) / m
    half = v + 0.5 * h * a
    if half * s < 0.0:
        half = 0.0
    a = (w + push + _external(p, t, x, half) - s * _level(p, t, x, abs(half), w, s, wander)) / m
    new = v + h * a
    if new * s > 0.0:
        return new
    # The speed would change sign: friction s acts until it is zero, then the
    # impulse of the rest of the substep is clipped to the friction set.
    left = h if v == 0.0 else h + v / a
    net = _released(p, t, x, w, 0.0, wander, w + push + _external(p, t, x, 0.0), 0.0)
    if net == 0.0:
        state[REST] = left
        return 0.0
    return left * net / m


@njit(cache=True)
def _kick_elastic(p, m, t, h, x, v, w, push, wander, state):
    """The kick with an elastic contact that slides at level g."""
    k = p.coulomb / p.presliding
    extra = p.dwell_rise * (1.0 - exp(-state[REST] / p.dwell_time))
    zm = state[Z] + 0.5 * h * v
    s = 1.0 if zm > 0.0 else -1.0
    bound = _level(p, t, x, abs(v), w, s, wander) + extra
    force = k * zm
    if abs(force) > bound:
        force = s * bound
    a = (w + push + _external(p, t, x, v) - force) / m
    half = v + 0.5 * h * a
    if abs(k * zm) > bound:
        force = s * (_level(p, t, x, abs(half), w, s, wander) + extra)
    a = (w + push + _external(p, t, x, half) - force) / m
    new = v + h * a
    z = state[Z] + 0.5 * h * (v + new)
    s = 1.0 if z > 0.0 else -1.0
    bound = _level(p, t, x, abs(new), w, s, wander)
    if k * abs(z) > bound + extra:
        z = s * bound / k
        state[REST] = 0.0
    else:
        state[REST] += h
    state[Z] = z
    return new


@njit(cache=True)
def _transmitted(p, dx, dv):
    """Force from motor to load, over the gap or through the compliance."""
    beyond = dx - min(max(dx, -0.5 * p.gap), 0.5 * p.gap)
    force = p.coupling_stiffness * beyond + p.coupling_damping * dv
    pulls = p.gap > 0.0 and beyond * force <= 0.0  # the ends of a play only push
    return 0.0 if pulls else force


@njit(cache=True)
def _advance(p, state, t, dt, substeps, before, now, push, wander):
    """One sample.  The delayed input steps from `before` to `now` inside it."""
    h = dt / substeps
    ratio = p.delay / dt
    part = (ratio - floor(ratio)) * substeps  # substeps before the input steps
    decay = exp(-h / p.lag) if p.lag > 0.0 else 0.0
    before = min(max(before, -p.saturation), p.saturation)
    now = min(max(now, -p.saturation), p.saturation)
    for i in range(substeps):
        share = min(max(part - i, 0.0), 1.0)
        w = share * before + (1.0 - share) * now
        if p.lag > 0.0:
            offset = state[LAG] - w
            state[LAG] = w + offset * decay
            w += offset * (1.0 - decay) * p.lag / h  # mean over the substep
        w *= p.gain
        w -= min(max(w, -p.dead_zone), p.dead_zone)
        tm = t + (i + 0.5) * h
        if p.load_fraction > 0.0:
            x = state[X] + 0.5 * h * state[V]
            xl = state[XL] + 0.5 * h * state[VL]
            force = _transmitted(p, x - xl, state[V] - state[VL])
            motor, load = p.mass * (1.0 - p.load_fraction), p.mass * p.load_fraction
            if p.motor_rubs > 0.0:
                state[V] = _kick(p, motor, tm, h, x, state[V], w - force, push, wander, state)
                state[VL] += h * force / load
            else:
                state[V] += h * (w - force) / motor
                state[VL] = _kick(p, load, tm, h, xl, state[VL], force, push, wander, state)
            state[X] = x + 0.5 * h * state[V]
            state[XL] = xl + 0.5 * h * state[VL]
        else:
            x = state[X] + 0.5 * h * state[V]
            state[V] = _kick(p, p.mass, tm, h, x, state[V], w, push, wander, state)
            state[X] = x + 0.5 * h * state[V]


@njit(cache=True)
def _delayed(p, u, k, dt):
    """Inputs before and after the step of the delayed input in sample k."""
    shift = int(p.delay / dt)
    now = u[k - shift] if k >= shift else 0.0
    before = u[k - shift - 1] if k >= shift + 1 else 0.0
    return before, now


@njit(cache=True)
def closed_loop(
    p, reference, dt, substeps, kp, ki, kd, filter_time, limit, quantum, noise, offset, push, wander
):
    """Record of a position loop on the encoder reading, force held over dt.

    Parameters
    ----------
    p : Plant
    reference, noise, offset, push, wander : ndarray, shape (n,)
        Reference [m]; additive noise [m] before and jumps [m] after the
        quantiser; bursts [N]; relative change of the friction level.
    kp, ki, kd, filter_time, limit : float
        PID gains, time constant [s] of the filtered speed, force limit [N].
    quantum : float
        Encoder quantum [m], 0 for none.

    Returns
    -------
    u, y : ndarray, shape (n,)
        Held force and encoder reading at the start of each sample.
    states : ndarray, shape (n, 7)
        True state at the start of each sample.
    """
    n = reference.size
    u, y = np.zeros(n), np.zeros(n)
    states, state = np.zeros((n, NSTATES)), np.zeros(NSTATES)
    state[X] = state[XL] = reference[0]
    keep = exp(-dt / filter_time)
    rate, total = 0.0, 0.0
    for k in range(n):
        states[k] = state
        reading = _read(p, state) + noise[k]
        if quantum > 0.0:
            reading = quantum * floor(reading / quantum + 0.5)
        y[k] = reading + offset[k]
        error = reference[k] - y[k]
        if k > 0:
            slope = (error - (reference[k - 1] - y[k - 1])) / dt
            rate = keep * rate + (1.0 - keep) * slope
        force = kp * error + total + kd * rate
        if abs(force) < limit:
            total += ki * dt * error
        u[k] = min(max(force, -limit), limit)
        before, now = _delayed(p, u, k, dt)
        _advance(p, state, k * dt, dt, substeps, before, now, push[k], wander[k])
    return u, y, states


@njit(cache=True)
def open_loop(p, u, dt, substeps, start):
    """States, shape (n + 1, 7), under a held force u from state `start`."""
    states = np.zeros((u.size + 1, NSTATES))
    state = start.copy()
    states[0] = state
    for k in range(u.size):
        before, now = _delayed(p, u, k, dt)
        _advance(p, state, k * dt, dt, substeps, before, now, 0.0, 0.0)
        states[k + 1] = state
    return states


@njit(cache=True)
def free_runs(p, u, dt, substeps, true, window):
    """Readings of p, restarted from the true state every `window` samples."""
    x, state = np.zeros(u.size), true[0].copy()
    for k in range(u.size):
        if k % window == 0:
            force = state[LAG]
            state[:] = true[k]
            state[LAG] = force
        x[k] = _read(p, state)
        before, now = _delayed(p, u, k, dt)
        _advance(p, state, k * dt, dt, substeps, before, now, 0.0, 0.0)
    return x
