"""Model and specifications of the observer, and defaults that suit any axis.

Everything follows from two amplitudes, the uncertain force d and the measurement noise n.  Their
dimensionless ratio dt^2 d / (m n) is the square of the observer's natural frequency [rad/sample].
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from dryfric_control.checks import finite, increment, instance, positive, warn
from dryfric_control.model.axis import MODES, FrictionAxis
from dryfric_control.model.friction import CoulombMap

#: What acts through states that the observer does not have, or on what it reads.
LEFT_OUT = ("contact", "transmission", "reading")
#: Uncertain force as a fraction of the Coulomb level.
UNCERTAIN_FRACTION = 0.2
#: Natural frequency [rad/sample] without knowledge of the sensor, and its range
#: with it: above, the observer is near-deadbeat and copies the noise into the
#: velocity; below, it takes thousands of samples to forget its start.
BANDWIDTH, SLOWEST, FASTEST = 0.15, 0.03, 0.7
#: With a known increment, the natural frequency that force and rounding amount to is
#: lowered to this share of itself: rounding is no white noise while the axis is slow.
QUANTIZED = 0.5
#: Drift of the friction error per sample, relative to bandwidth times d.
DRIFT_FRACTION = 0.5
#: Certified decay: an error shrinks at this fraction of the bandwidth.
DECAY_FRACTION = 0.05
#: Weights of position, speed and friction, each as a speed at that frequency.
PERFORMANCE = (2.0, 1.0, 0.3)


@dataclass(frozen=True)
class Weights:
    """Specifications of the observer in SI units."""

    dt: float  # [s]
    kick: float  # speed gained in one sample per force, dt / mass [s/kg]
    uncertainty: dict[int, float]  # of the force by mode [N]
    noise: float  # [m]
    drift: float  # of the friction error per sample [N]
    decay: float  # per sample
    performance: tuple[float, float, float]  # of position, velocity and friction errors in z
    bandwidth: float  # natural frequency that the amplitudes amount to [rad/sample]


class ObserverWarning(UserWarning):
    """Part of an axis that its observer leaves out."""


def own_axis(
    axis: FrictionAxis, coulomb: CoulombMap | float | None = None, stick_speed: float | None = None
) -> FrictionAxis:
    """Axis that the observer believes in."""
    instance("axis", axis, FrictionAxis)
    acting = axis.effective()
    if stick_speed is None:
        stick_speed = acting.stick_speed / 2.0
    speed = positive("stick_speed", stick_speed, unit="m/s")
    left = [effect for effect in acting.effects if effect.action in LEFT_OUT]
    if left:
        names = ", ".join(effect.slug for effect in left)
        warn(
            f"the observer leaves out {names}: it runs the axis as one rigid mass that either "
            "rests or slides, and what that misses goes into its integral term and its mode",
            ObserverWarning,
        )
    return acting.replace(
        stribeck=None,
        stick_speed=speed,
        coulomb=acting.coulomb if coulomb is None else CoulombMap.of(coulomb),
        effects=tuple(effect for effect in acting.effects if effect not in left),
    )


def coulomb_level(axis: Any) -> float:
    """Mean Coulomb level of both directions over the travel [N]."""
    low, high = (0.0, 0.0) if axis.travel is None else axis.travel
    places = np.linspace(low, high, 65)
    return float(np.mean([axis.coulomb(places, direction) for direction in (1, -1)]))


def _uncertainty(axis: Any, value: float | Mapping[int, float] | None) -> dict[int, float]:
    if value is None:
        level = coulomb_level(axis)
        if level <= 0.0:
            raise ValueError(
                "uncertainty has no default on an axis without Coulomb friction: give the "
                "amplitude of the unknown force"
            )
        value = UNCERTAIN_FRACTION * level
    if not isinstance(value, Mapping):
        return dict.fromkeys(MODES, positive("uncertainty", value, unit="N", zero=True))
    if set(value) != set(MODES):
        raise ValueError(f"uncertainty must name the modes 0, 1 and -1, got {sorted(value)!r}")
    return {m: positive(f"uncertainty[{m}]", value[m], unit="N", zero=True) for m in MODES}


def default_weights(
    axis: Any,
    dt: float,
    *,
    uncertainty: float | Mapping[int, float] | None = None,
    noise: float | None = None,
    drift: float | None = None,
    decay: float | None = None,
    performance: Iterable[float] | None = None,
    encoder_quantum: float | None = None,
) -> Weights:
    """Fill in the specifications the user left open.

    With d = 0.2 Fc and beta = sqrt(dt^2 d / (m n)): noise n = 4 quantum / sqrt(12),
    moved if need be until 0.03 <= beta <= 0.7, or such that beta = 0.15 if no
    quantum is given; drift = beta d / 2 per sample; decay = 1 - beta / 20; and
    z weighs the speed error by 1 and, by what they are worth as a speed at the
    frequency beta, the position error by 2 and the friction error by 0.3:
    (2 beta / dt, 1, 0.3 dt / (beta m)).
    """
    kick = dt / axis.mass
    amplitudes = _uncertainty(axis, uncertainty)
    d = max(amplitudes.values())
    if drift is not None:
        drift = positive("drift", drift, unit=axis.unit("N"), zero=True)
    if d == 0.0:
        raise ValueError(
            "uncertainty is zero in every mode: an observer of an exactly known axis need not "
            "look at the measurement; give a small force instead"
        )
    step, bandwidth = dt * kick * d, BANDWIDTH
    if noise is not None:
        noise = positive("noise", noise, unit=axis.unit("m"), zero=True)
        bandwidth = FASTEST if noise == 0.0 else math.sqrt(step / noise)
        bandwidth = min(max(bandwidth, 1e-4), 1.0)
    else:
        if encoder_quantum is not None:
            quantum = increment(encoder_quantum, axis.unit("m"))
            bandwidth = QUANTIZED * math.sqrt(step * math.sqrt(12.0) / quantum)
            bandwidth = min(max(bandwidth, SLOWEST), FASTEST)
        noise = step / bandwidth**2
    if drift is None:
        drift = DRIFT_FRACTION * bandwidth * d
    if decay is None:
        decay = 1.0 - DECAY_FRACTION * bandwidth
    decay = finite("decay", decay)
    if not 0.0 < decay <= 1.0:
        raise ValueError(f"decay must lie above 0 and up to 1 (no rate asked for), got {decay!r}")
    if performance is None:
        q_x, q_v, q_w = PERFORMANCE
        performance = (q_x * bandwidth / dt, q_v, q_w * kick / bandwidth)
    given = tuple(performance) if isinstance(performance, Iterable) else ()
    weights = tuple(positive(f"performance[{k}]", q, zero=True) for k, q in enumerate(given))
    if len(weights) != 3 or not any(weights):
        raise ValueError(
            "performance must hold three weights (q_x, q_v, q_w), not all zero, got "
            f"{performance!r}"
        )
    return Weights(dt, kick, amplitudes, noise, drift, decay, weights, bandwidth)
