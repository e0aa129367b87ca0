"""Plain estimators to compare the switched observer with.

Each takes the drive u and the reading y and gives the rows of an observer:
xhat, vhat, Fhat, what, mode.  None of them knows a friction model; the mode is
"stuck" while the estimated speed is within a band. `observer.py` and `arena.py` run them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numba import njit
from numpy.typing import NDArray

from dryfric_control.checks import positive
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.observer.design import ObserverDesign
from dryfric_control.observer.error_model import axis_matrices

Array = NDArray[np.float64]


@njit(cache=True, error_model="numpy")
def _difference(u, y, dt, mass, viscous, keep, band, out):  # type: ignore[no-untyped-def]
    v = 0.0
    a = 0.0
    for k in range(u.shape[0]):
        before = v
        if k > 0:
            v = keep * v + (1.0 - keep) * (y[k] - y[k - 1]) / dt
            a = keep * a + (1.0 - keep) * (v - before) / dt
        out[0, k], out[1, k], out[3, k] = y[k], v, 0.0
        # The acceleration belongs to the drive of the sample before.
        out[2, k] = u[max(k - 1, 0)] - mass * a - viscous * v
        out[4, k] = 0.0 if abs(v) <= band else math.copysign(1.0, v)


@njit(cache=True, error_model="numpy")
def _one_mode(u, y, A, E, gain, band, x, out):  # type: ignore[no-untyped-def]
    v = 0.0
    w = 0.0
    for k in range(u.shape[0]):
        out[0, k], out[1, k], out[2, k], out[3, k] = x, v, -w, w
        out[4, k] = 0.0 if abs(v) <= band else math.copysign(1.0, v)
        error, force = y[k] - x, u[k] + w
        x, v, w = (
            x + A[0, 1] * v + E[0] * force + gain[0] * error,
            A[1, 1] * v + E[1] * force + gain[1] * error,
            w + gain[2] * error,
        )


@dataclass(frozen=True)
class FilteredDifference:
    """Backward difference through a low-pass.

    Parameters
    ----------
    axis : FrictionAxis
        Mass and viscous coefficient, for the friction estimate.
    dt : float
        Sampling time [s].
    filter_time : float
        Time constant of the low-pass [s].
    band : float
        Speed up to which the axis counts as stuck [m/s].

    Notes
    -----
    Friction is ``u - m a - f v`` with the low-pass used again for a.
    """

    axis: FrictionAxis
    dt: float
    filter_time: float
    band: float

    def estimate(self, u: Array, y: Array, xhat0: float = 0.0) -> Array:
        """Rows xhat, vhat, Fhat, what, mode; the start is not used."""
        out = np.empty((5, u.size))
        keep = math.exp(-self.dt / self.filter_time)
        _difference(u, y, self.dt, self.axis.mass, self.axis.viscous, keep, self.band, out)
        return out


@dataclass(frozen=True)
class OneModeObserver:
    """Observer of the sliding mode alone, friction as an unknown force.

    Parameters
    ----------
    axis : FrictionAxis
        Mass and viscous coefficient.
    dt : float
        Sampling time [s].
    gain : tuple of float
        Gains L_x [1], L_v [1/s] and G [N/m].
    band : float
        Speed up to which the axis counts as stuck [m/s].
    discretization : str
        "euler" or "zoh".
    """

    axis: FrictionAxis
    dt: float
    gain: tuple[float, float, float]
    band: float
    discretization: str = "euler"

    @classmethod
    def from_design(cls, design: ObserverDesign, band: float) -> OneModeObserver:
        """The sliding mode's observer of a switched design, not switched.

        Parameters
        ----------
        design : ObserverDesign
            Its gains of mode +1 are taken.
        band : float
            Speed up to which the axis counts as stuck [m/s].
        """
        gain = design.gains[1]
        if design.form == "current":  # the prediction that starts after that correction
            A, _, E = design.mode_matrices(1)
            gain = np.append(A @ gain[:2] + E * gain[2], gain[2])
        lx, lv, g = (float(value) for value in gain)
        return cls(design.axis, design.dt, (lx, lv, g), band, design.discretization)

    @classmethod
    def kalman(
        cls, axis: FrictionAxis, dt: float, noise: float, walk: float, band: float
    ) -> OneModeObserver:
        """Stationary Kalman filter with friction as a random walk.

        Parameters
        ----------
        axis : FrictionAxis
            Mass and viscous coefficient.
        dt : float
            Sampling time [s].
        noise : float
            Standard deviation of the measurement noise [m].
        walk : float
            Standard deviation of the change of friction per sample [N].
        band : float
            Speed up to which the axis counts as stuck [m/s].

        Raises
        ------
        ValueError
            If `noise` or `walk` is not positive.
        """
        noise = positive("noise", noise, unit="m")
        walk = positive("walk", walk, unit="N")
        A2, E = axis_matrices(axis, 1, dt, "zoh")
        A = np.eye(3)
        A[:2, :2], A[:2, 2] = A2, E
        # Per unit: in SI units the Riccati equation is badly scaled.
        unit = np.array([noise, noise / dt, noise / (dt * dt) * axis.mass])
        scaled = A * unit / unit[:, None]
        C = np.array([[1.0, 0.0, 0.0]])
        P = scipy.linalg.solve_discrete_are(
            scaled.T, C.T, np.diag([0.0, 0.0, (walk / unit[2]) ** 2]), np.eye(1)
        )
        gain = (scaled @ P @ C.T)[:, 0] / (P[0, 0] + 1.0) * unit / unit[0]
        return cls(axis, dt, (float(gain[0]), float(gain[1]), float(gain[2])), band, "zoh")

    def estimate(self, u: Array, y: Array, xhat0: float = 0.0) -> Array:
        """Rows xhat, vhat, Fhat, what, mode of a run started at `xhat0`."""
        A, E = axis_matrices(self.axis, 1, self.dt, self.discretization)
        out = np.empty((5, u.size))
        _one_mode(u, y, A, E, np.array(self.gain), self.band, float(xhat0), out)
        return out
