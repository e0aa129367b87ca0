"""Error dynamics and specifications of the switched PI observer.

The error is e = (x - xhat, v - vhat, b - w), with the friction error b (nominal minus true) and the
integral term w that estimates it.  Disturbances are force uncertainty, measurement noise and drift
of the friction error, each present only if its amplitude is not zero.  Defaults follow from two
amplitudes, the uncertain force d and the measurement noise n: their dimensionless ratio
dt^2 d / (m n) is the square of the observer's natural frequency [rad/sample].
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from dryfric_control.arrays import Floats
from dryfric_control.checks import (
    finite,
    increment,
    instance,
    one_of,
    positive,
    warn,
)
from dryfric_control.model.axis import MODES, FrictionAxis, mode_matrices
from dryfric_control.model.friction import CoulombMap

#: Classes of modes: stuck, and sliding in either direction.
STICK = 0
SLIDE = 1
#: How a mode is sampled.
DISCRETIZATIONS = ("euler", "zoh")
#: Whether the estimate at a sample uses the reading of that sample.
FORMS = ("current", "prediction")
#: What is measured: the position alone.
C = np.array([1.0, 0.0, 0.0])


@dataclass(frozen=True)
class ErrorModel:
    """Matrices of the open error dynamics in one mode."""

    A: Floats  # [A_i E_i; 0 1], shape (3, 3)
    W: Floats  # disturbances into the error, shape (3, nd)
    D: Floats  # disturbances into the measurement, shape (nd,)
    Z: Floats  # performance output, shape (nz, 3)
    C: Floats = field(default_factory=lambda: C)  # error into the measurement, shape (3,)
    current: bool = False  # current form: C and D of the reading to come

    def current_form(self) -> ErrorModel:
        """The same dynamics in the current form."""
        return replace(
            self,
            C=self.C @ self.A,
            D=self.C @ self.W + self.D,
            current=True,
        )

    def node(self, before: int, after: int) -> int:
        """Memory state whose gain acts in the step from one to another."""
        return after if self.current else before

    @property
    def noise(self) -> float:
        """Amplitude of the reading noise."""
        return float(np.linalg.norm(self.D - self.W[0] if self.current else self.D))

    def in_units(self, state: Floats, output: float) -> ErrorModel:
        """The same dynamics in units of `state` and z times `output`."""
        return ErrorModel(
            A=self.A * state[None, :] / state[:, None],
            W=self.W / state[:, None],
            D=self.D / state[0],
            Z=self.Z * state[None, :] * output,
            C=self.C * state / state[0],
            current=self.current,
        )

    def closed_loop(self, gain: Floats) -> tuple[Floats, Floats]:
        """Closed matrices F = A - L C and G = W - L D for a gain (3,)."""
        return self.A - np.outer(gain, self.C), self.W - np.outer(gain, self.D)


def axis_matrices(axis: Any, mode: int, dt: float, discretization: str) -> tuple[Floats, Floats]:
    """State matrix of a mode, and the column in which forces act while sliding."""
    # While stuck too: there friction cancels the drive, and an integral term without effect could
    # not be observed.
    sliding, force = mode_matrices(axis.viscous / axis.mass, 1.0 / axis.mass, dt, discretization)
    stuck, _ = mode_matrices(axis.stick_rate, 1.0 / axis.mass, dt, discretization)
    return sliding if mode else stuck, force


def check_sampling(axis: Any, dt: float, discretization: str) -> None:
    """Refuse a sampling time with which a mode is not stable."""
    one_of("discretization", discretization, DISCRETIZATIONS)
    positive("dt", dt, unit="s")
    rates = {
        "stick_rate": axis.stick_rate,
        "viscous / mass": axis.viscous / axis.mass,
    }
    for name, rate in rates.items():
        if discretization == "euler" and dt * rate >= 2.0:
            raise ValueError(
                f"dt * {name} = {dt * rate:.6g} must be below 2 with Euler's rule: lower dt "
                f"(below {2.0 / rate:.3g} s), lower {name}, or use discretization='zoh'"
            )


def mode_classes(uncertainty: Mapping[int, float]) -> dict[int, int]:
    """Which modes share a model: +1 and -1 do if equally uncertain."""
    return {
        0: STICK,
        1: SLIDE,
        -1: SLIDE if uncertainty[1] == uncertainty[-1] else -1,
    }


def error_models(
    axis: Any,
    dt: float,
    *,
    uncertainty: Mapping[int, float],
    noise: float,
    drift: float,
    performance: tuple[float, float, float],
    discretization: str = "euler",
    integral_modes: Iterable[int] = (0, 1, -1),
    form: str = "prediction",
) -> dict[int, ErrorModel]:
    """Error dynamics of each class of modes, in physical units."""
    models = {}
    integral = set(integral_modes)
    weights = np.diag(performance)[np.array(performance) != 0.0]
    for mode, key in mode_classes(uncertainty).items():
        if key in models:
            continue
        A = np.eye(3)
        force = np.zeros(3)
        A[:2, :2], force[:2] = axis_matrices(axis, mode, dt, discretization)
        A[:2, 2] = force[:2] if mode in integral else 0.0
        # Columns of force, noise and drift, those that there are.
        acting = [any(uncertainty.values()), noise != 0.0, drift != 0.0]
        W = np.column_stack([uncertainty[mode] * force, np.zeros(3), [0.0, 0.0, drift]])
        D = np.array([0.0, noise, 0.0])
        model = ErrorModel(A, W[:, acting], D[acting], weights)
        models[key] = model.current_form() if form == "current" else model
    return models


def check_detectable(models: Mapping[int, ErrorModel], state: Floats, decay: float) -> None:
    """Refuse a mode whose error no gain can make decay fast enough."""
    # Popov-Belevitch-Hautus: eigenvalues of that size must leave [lambda I - A; C] of full rank.
    for key, model in models.items():
        A = model.in_units(state, 1.0).A
        for value in np.linalg.eigvals(A):
            if abs(value) < decay * (1.0 - 1e-9):
                continue
            singular = np.linalg.svd(
                np.vstack([value * np.eye(3) - A, C[None, :]]),
                compute_uv=False,
            )
            # 1e-9 of the largest: gains of that size would be all rounding error
            if singular[-1] < 1e-9 * singular[0]:
                name = "0 (stuck)" if key == 0 else f"{key:+d} (sliding)"
                cause = (
                    "the integral term must act there (E_i = 0 now): add the mode to integral_modes"
                    if not model.A[:2, 2].any()
                    else "relax decay, or lower stick_rate"
                )
                raise ValueError(
                    f"mode {name} is not detectable: no gain moves its eigenvalue {value:.6g}, "
                    f"and decay = {decay:.6g} asks for less; {cause}"
                )


#: What acts through states that the observer does not have, or on what it reads.
LEFT_OUT = ("contact", "transmission", "memory", "reading")
#: Uncertain force as a fraction of the Coulomb level.
UNCERTAIN_FRACTION = 0.2
#: Natural frequency without knowledge of the sensor [rad/sample].
BANDWIDTH = 0.15
#: Least one with it: below, the observer takes thousands of samples to forget its start.
SLOWEST = 0.03
#: Largest one with it: above, the observer is near-deadbeat and copies noise into the velocity.
FASTEST = 0.7
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
    axis: FrictionAxis,
    coulomb: CoulombMap | float | None = None,
    stick_speed: float | None = None,
) -> FrictionAxis:
    """Axis that the observer believes in: no Stribeck peak, and what a rigid mass cannot have.

    `stick_speed`: by default half that of the axis.
    """
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
    """Fill in the specifications the user left open, by the constants above."""
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
    step = dt * kick * d
    bandwidth = BANDWIDTH
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
