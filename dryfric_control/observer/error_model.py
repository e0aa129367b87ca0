"""Error dynamics of the switched PI observer, mode by mode, in both forms of the theory page.

The error is e = (x - xhat, v - vhat, b - w), with the friction error b (nominal minus true) and the
integral term w that estimates it.  Disturbances are force uncertainty, measurement noise and drift
of the friction error, each present only if its amplitude is not zero.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from dryfric_control.arrays import Floats
from dryfric_control.checks import one_of, positive
from dryfric_control.model.axis import mode_matrices

STICK, SLIDE = 0, 1
DISCRETIZATIONS = ("euler", "zoh")
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

    def corrected(self) -> ErrorModel:
        """The same dynamics in the current form."""
        return replace(self, C=self.C @ self.A, D=self.C @ self.W + self.D, current=True)

    def node(self, before: int, after: int) -> int:
        """Memory state whose gain acts in the step from one to another."""
        return after if self.current else before

    @property
    def noise(self) -> float:
        """Amplitude of the reading noise."""
        return float(np.linalg.norm(self.D - self.W[0] if self.current else self.D))

    def scaled(self, state: Floats, output: float) -> ErrorModel:
        """The same dynamics in units of `state` and z times `output`."""
        return ErrorModel(
            A=self.A * state[None, :] / state[:, None],
            W=self.W / state[:, None],
            D=self.D / state[0],
            Z=self.Z * state[None, :] * output,
            C=self.C * state / state[0],
            current=self.current,
        )

    def closed(self, gain: Floats) -> tuple[Floats, Floats]:
        """Closed matrices F = A - L C and G = W - L D for a gain (3,)."""
        return self.A - np.outer(gain, self.C), self.W - np.outer(gain, self.D)


def axis_matrices(axis: Any, mode: int, dt: float, discretization: str) -> tuple[Floats, Floats]:
    """State matrix of a mode and the column in which forces act.

    The column is that of the sliding mode also while stuck: there friction cancels the drive, and
    an integral term without effect could not be observed.
    """
    sliding, force = mode_matrices(axis.viscous / axis.mass, 1.0 / axis.mass, dt, discretization)
    stuck, _ = mode_matrices(axis.stick_rate, 1.0 / axis.mass, dt, discretization)
    return sliding if mode else stuck, force


def check_sampling(axis: Any, dt: float, discretization: str) -> None:
    """Refuse a sampling time with which a mode is not stable."""
    one_of("discretization", discretization, DISCRETIZATIONS)
    positive("dt", dt, unit="s")
    rates = {"stick_rate": axis.stick_rate, "viscous / mass": axis.viscous / axis.mass}
    for name, rate in rates.items():
        if discretization == "euler" and dt * rate >= 2.0:
            raise ValueError(
                f"dt * {name} = {dt * rate:.6g} must be below 2 with Euler's rule: lower dt "
                f"(below {2.0 / rate:.3g} s), lower {name}, or use discretization='zoh'"
            )


def mode_classes(uncertainty: Mapping[int, float]) -> dict[int, int]:
    """Which modes share a model: +1 and -1 do if equally uncertain."""
    return {0: STICK, 1: SLIDE, -1: SLIDE if uncertainty[1] == uncertainty[-1] else -1}


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
        A, force = np.eye(3), np.zeros(3)
        A[:2, :2], force[:2] = axis_matrices(axis, mode, dt, discretization)
        A[:2, 2] = force[:2] if mode in integral else 0.0
        # Columns of force, noise and drift, those that there are.
        acting = [any(uncertainty.values()), noise != 0.0, drift != 0.0]
        W = np.column_stack([uncertainty[mode] * force, np.zeros(3), [0.0, 0.0, drift]])
        D = np.array([0.0, noise, 0.0])
        model = ErrorModel(A, W[:, acting], D[acting], weights)
        models[key] = model.corrected() if form == "current" else model
    return models


def check_detectable(models: Mapping[int, ErrorModel], state: Floats, decay: float) -> None:
    """Refuse a mode whose error no gain can make decay fast enough.

    Popov-Belevitch-Hautus: every eigenvalue of A with ``|lambda| >= decay`` must
    leave ``[lambda I - A; C]`` with full column rank.
    """
    for key, model in models.items():
        A = model.scaled(state, 1.0).A
        for value in np.linalg.eigvals(A):
            if abs(value) < decay * (1.0 - 1e-9):
                continue
            singular = np.linalg.svd(
                np.vstack([value * np.eye(3) - A, C[None, :]]), compute_uv=False
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
