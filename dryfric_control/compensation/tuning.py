"""Numbers of the compensated loop, and what of an axis they depend on."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import control as ct
import numpy as np

from dryfric_control.arrays import Floats
from dryfric_control.compiled import compensation as kernel
from dryfric_control.model.axis import FrictionAxis, without_effects
from dryfric_control.model.friction import middle_level
from dryfric_control.observer.design import ObserverDesign
from dryfric_control.observer.error_model import (
    LEFT_OUT,
    UNCERTAIN_FRACTION,
    coulomb_level,
)

LAWS = ("learned", "fixed", "sign", "pid", "disturbance observer", "adrc")
#: Those with the switched observer, which feed forward all friction and hold the drive at rest.
SWITCHED_LAWS = ("learned", "fixed")
#: Part of the Coulomb level that is fed forward, by law.
LEVEL_SHARES = {"learned": 1.0, "fixed": 1.0, "sign": 0.9}
#: Where the estimate of friction comes from, by law.
SOURCES = {
    "learned": kernel.LEARNED,
    "fixed": kernel.LEARNED,
    "disturbance observer": kernel.DISTURBANCE,
    "adrc": kernel.EXTENDED,
}


class Tuning(NamedTuple):
    """Numbers of the sliding loop, found on plants other than those of the benchmark."""

    phase: float  # bandwidth times the whole delay of the loop
    damping: float  # (kd + f)/(m w)
    share: float  # of the estimated velocity in the one fed back, with a long delay
    residual: float  # share of the friction residual that is fed back
    late: float  # part of the largest delay by which the observer expects the feedforward late


#: With the switched observer.
_SWITCHED = Tuning(0.6, 3.5, 0.45, 0.07, 0.5)
#: Without it.
_BASELINE = Tuning(0.45, 1.86, 0.0, 0.0, 0.0)
#: Share of the estimate that a baseline's disturbance observer feeds back.
ESTIMATE_SHARE = 0.98
#: Integral gain over w kp.
INTEGRAL_GAIN = 0.41
#: Natural frequency of the observer without knowledge of the encoder [rad/sample].
_OBSERVER_FREQUENCY = 0.15
#: Least and largest one with it [rad/sample].
_OBSERVER_FREQUENCY_RANGE = (0.03, 0.3)
#: Largest natural frequency of the observer times the whole delay of the loop: it has
#: no delay in its model, and its velocity, ahead of the axis by it, must stay with it.
OBSERVER_PHASE = 0.83
#: That share falls with the delay of the drive, in samples, as (delay + 2.5)/5.5: without
#: one there is nothing to be ahead of.
SHARE_DELAYS = (2.5, 5.5)
#: Delay of sampling, hold, difference and low-pass, in samples.
SAMPLING_DELAY = 0.5
#: Least time constant of the low-pass on the velocity [samples].
LEAST_FILTER_TIME = 0.3
#: Bandwidth of the estimate of velocity over that of the loop, without a delay, less 1.
ESTIMATE_BANDWIDTH = 0.6
#: Largest step of the drive for an encoder increment, over the Coulomb level.
DRIVE_NOISE = 0.1
#: Largest bandwidth times dt.
LARGEST_BANDWIDTH = 0.2
#: Rate of learning [1/s].
LEARNING_RATE = 12.5
#: Share of the Coulomb level that stays at rest; the integral carries the rest.
REST_SHARE = 0.3
#: Rate at which the observer is expected to follow, over one by its mean delay.
_OBSERVER_SPEED = 2.0
#: Largest excess that is learned.
MOST_EXCESS = 0.8
#: Time at rest after which the drive may be held, times the bandwidth.
SETTLING_TIME = 8.0
#: Largest held drive, as a part of the least Coulomb level within the mismatch.
HOLD_SHARE = 0.9
#: Widening of the tolerance at rest with every correction.
TOLERANCE_GROWTH = 1.5


def rigid_axis(axis: FrictionAxis) -> FrictionAxis:
    """The axis that acts, without effects that need inner states."""
    return without_effects(axis.effective(), LEFT_OUT)


def presliding_distance(axis: FrictionAxis) -> float:
    """Way over which friction builds up at a reversal [m], 0 without presliding."""
    acting = axis.effective()
    stiffness = float(acting.arrays(1.0).numbers[kernel.axis_step.CONTACT_STIFFNESS])
    return middle_level(acting.coulomb, acting.travel) / stiffness if stiffness > 0.0 else 0.0


def observer_lag(observer: ObserverDesign) -> float:
    """Part of a change of friction that the observer states a sample later."""
    # Quicker than the mean delay while sliding: the observer starts from what was learned.
    sliding = observer.error_dynamics(1)
    # Errors of x and v, and of friction, under a unit of unmodelled friction.
    state = np.zeros(3)
    late = 0.0
    for _ in range(100_000):
        left = 1.0 + state[2]
        late += left
        if abs(left) < 1e-9:
            break
        state = sliding.A @ state + sliding.B[:, 0]
    return min(_OBSERVER_SPEED / max(late, 1.0), 1.0)


def extended_gains(axis: FrictionAxis, dt: float, bandwidth: float) -> Floats:
    """Gains of an extended state observer with three equal poles, by the current reading."""
    rate = axis.viscous / axis.mass
    m = axis.mass
    moved = [1.0, dt * (1.0 - 0.5 * dt * rate), 0.5 * dt**2 / m]
    A = np.array([moved, [0.0, 1.0 - dt * rate, dt / m], [0.0, 0.0, 1.0]])
    # (I - M C) A has these poles; C A is the first row of A.
    pole = math.exp(-bandwidth * dt)
    return np.asarray(ct.acker(A.T, A[:1].T, [pole] * 3), dtype=float).ravel()


def tuning_of(law: str) -> Tuning:
    """Numbers of the sliding loop, by law."""
    if law not in SWITCHED_LAWS:
        return _BASELINE
    return _SWITCHED if law == "learned" else _SWITCHED._replace(residual=0.0)


def observer_arrays(
    source: ObserverDesign | FrictionAxis, quantum: float, dt: float
) -> tuple[Any, ...]:
    """Arrays of the observer; of none, such as the compiled law takes all the same."""
    if isinstance(source, ObserverDesign):
        return tuple(source.tables("reading", quantum))
    nothing = (
        np.zeros(6),
        np.zeros((3, 6)),
        np.zeros((1, 3)),
        np.zeros((2, 3), dtype=np.int64),
    )
    return (*nothing, *source.arrays(dt)[:2])


def reading_noise(axis: FrictionAxis, dt: float, quantum: float, fastest: float) -> float:
    """Reading noise [m] for which the observer is as calm as the law was tuned with."""
    # Rounding of the encoder, within limits of the natural frequency [rad/sample], of which
    # `fastest` is one; `benchmarks/compensation.py` sets them.
    step = dt**2 * UNCERTAIN_FRACTION * coulomb_level(axis) / axis.mass
    frequency = _OBSERVER_FREQUENCY
    if quantum:
        slow, fast = _OBSERVER_FREQUENCY_RANGE
        frequency = min(max(math.sqrt(step * math.sqrt(12.0) / quantum), slow), fast)
    return step / min(frequency, fastest) ** 2


def observer_axis(axis: FrictionAxis) -> FrictionAxis:
    """The axis as its observer has it."""
    # Without an elastic contact, which the law compensates by itself, and without delay and
    # lag of the drive: its velocity is then ahead of the axis, as the feedback wants it.
    return without_effects(axis.effective(), ("contact", "delay", "lag"))


def largest_level(axis: FrictionAxis) -> float:
    """Largest Coulomb level of the map over the travel [N]."""
    places = np.linspace(*axis.travel, 101) if axis.travel else np.zeros(1)
    return float(max(axis.coulomb(places, s).max() for s in (1, -1)))


def velocity_share(tuning: Tuning, delay: float) -> float:
    """Share of the estimated velocity in the one fed back, by the delay [samples]."""
    early, late = SHARE_DELAYS
    return tuning.share * min((delay + early) / late, 1.0)


def largest_bandwidth(tuning: Tuning, dt: float, delay: float, filtered: float) -> float:
    """Bandwidth that the whole delay of the loop allows [rad/s]."""
    return tuning.phase / (delay + SAMPLING_DELAY * dt + filtered)


def position_gains(axis: FrictionAxis, tuning: Tuning, w: float) -> tuple[float, float]:
    """Gains kp [N/m] and kd [N s/m] of a bandwidth [rad/s]."""
    return axis.mass * w**2, max(tuning.damping * axis.mass * w - axis.viscous, 0.0)


def estimate_bandwidth(w: float, dt: float, delay: float, filter_time: float) -> float:
    """Bandwidth of the estimate of velocity [rad/s]: higher where there is less delay to lead."""
    return w * (
        1.0 + ESTIMATE_BANDWIDTH * (1.0 - delay / (delay + SAMPLING_DELAY * dt + filter_time))
    )


def filter_time(
    axis: FrictionAxis,
    tuning: Tuning,
    dt: float,
    delay: float,
    given: float | None,
    most: float,
) -> float:
    """Time constant [s] of the low-pass that keeps the noise in the drive; `given`: bandwidth."""

    def step(filtered: float) -> float:
        w = given or min(
            largest_bandwidth(tuning, dt, delay, filtered),
            LARGEST_BANDWIDTH / dt,
        )
        kp, kd = position_gains(axis, tuning, w)
        part = velocity_share(tuning, delay / dt)
        gain = extended_gains(axis, dt, estimate_bandwidth(w, dt, delay, filtered))[1]
        return kp + kd * ((1.0 - part) * -math.expm1(-dt / filtered) / dt + part * float(gain))

    low = LEAST_FILTER_TIME * dt
    if not step(low) > most:
        return low
    high = low
    while step(high) > most and (given is None or high < tuning.phase / given):
        high *= 2.0
    if given is not None:
        high = max(
            min(high, tuning.phase / given - delay - SAMPLING_DELAY * dt),
            low,
        )
    while high - low > 1e-6 * high:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if step(middle) > most else (low, middle)
    return high
