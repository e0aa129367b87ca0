"""Reference motions of bounded velocity, acceleration and jerk, in closed form."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dryfric_control.arrays import Floats
from dryfric_control.checks import finite, positive, samples
from dryfric_control.drawing import over_time, panels
from dryfric_control.text import documented, stated


@documented
@dataclass(frozen=True, eq=False)
class MotionProfile:
    """A sampled reference motion with velocity and acceleration.

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> profile = dfc.motion_profile(0.1, dt=1e-3, velocity=0.2, acceleration=2.0, jerk=40.0)
    >>> profile.time.size == profile.position.size
    True
    """

    dt: float = stated("Sampling time [s].")
    position: Floats = stated("Position [m], shape (n,).")
    velocity: Floats = stated("Velocity [m/s].")
    acceleration: Floats = stated("Acceleration [m/s^2].")
    unit: str = stated("Unit of the position, that text and figures show: m or rad.", "m")

    @property
    def time(self) -> Floats:
        """Time of the samples [s], shape (n,)."""
        return np.asarray(np.arange(self.position.size) * self.dt, dtype=float)

    @property
    def duration(self) -> float:
        """Time of the last sample [s]."""
        return (self.position.size - 1) * self.dt

    @property
    def rows(self) -> Floats:
        """Position, velocity and acceleration, shape (3, n)."""
        return np.vstack([self.position, self.velocity, self.acceleration])

    @classmethod
    def of(cls, reference: MotionProfile | ArrayLike, dt: float) -> MotionProfile:
        """Motion from positions at the samples, or a motion itself.

        Parameters
        ----------
        reference : MotionProfile or array_like, shape (n,)
            Motion, or positions [m]; those are differenced.
        dt : float
            Sampling time [s].
        """
        if isinstance(reference, MotionProfile):
            if not math.isclose(reference.dt, dt, rel_tol=1e-9):
                raise ValueError(
                    f"reference was sampled at dt = {reference.dt:g} s and the controller runs at "
                    f"{dt:g} s: make both for one sampling time"
                )
            return reference
        x = samples("reference", reference)
        v, a = np.zeros((2, x.size))
        if x.size > 2:
            v, a[1:-1] = np.gradient(x, dt), np.diff(x, 2) / dt**2
        return cls(dt, x, v, a)

    @panels(3)
    def plot(self, axes: Any) -> str:
        """Draw position, velocity and acceleration over time."""
        unit = self.unit
        for one, values in zip(axes, self.rows, strict=True):
            one.plot(self.time, values, "k", linewidth=1.0)
        over_time(axes, (f"position [{unit}]", f"velocity [{unit}/s]", f"acceleration [{unit}/s²]"))
        return "reference motion"

    def _repr_html_(self) -> str:
        return f"<pre>{self!r}</pre>"

    def __repr__(self) -> str:
        peaks = [np.abs(row).max(initial=0.0) for row in self.rows[1:]]
        unit = self.unit
        return (
            f"MotionProfile of {self.position.size} samples at {self.dt:g} s: "
            f"{self.position.min():.6g} to {self.position.max():.6g} {unit}, at most "
            f"{peaks[0]:.4g} {unit}/s and {peaks[1]:.4g} {unit}/s^2"
        )


def motion_profile(
    points: float | ArrayLike,
    dt: float,
    *,
    velocity: float,
    acceleration: float,
    jerk: float,
    dwell: float | ArrayLike = 0.0,
    unit: str = "m",
) -> MotionProfile:
    """Fastest motion of bounded jerk through points of rest.

    Parameters
    ----------
    points : float or array_like, shape (npoints,)
        A distance, moved from 0 [m], or the points of rest in their order.
    dt : float
        Sampling time [s].
    velocity, acceleration, jerk : float
        Largest magnitudes [m/s], [m/s^2], [m/s^3].
    dwell : float or array_like, shape (npoints,), optional
        Time of rest at every point [s], one for all or one each.
    unit : str, optional
        Unit of the points: "rad" for a rotary axis, whose limits are in rad/s and so on.

    Notes
    -----
    Each move has seven phases of constant jerk +j, 0, -j, 0, -j, 0, +j (some of them empty), and
    begins on a sample.  Sampled is the exact motion: the limits hold between the samples too.

    Examples
    --------
    Back and forth over 100 mm, with half a second of rest at each end:

    >>> import dryfric_control as dfc
    >>> profile = dfc.motion_profile([0.0, 0.1, 0.0], dt=1e-3, velocity=0.2,
    ...                              acceleration=2.0, jerk=40.0, dwell=0.5)
    >>> round(float(profile.velocity.max()), 12), round(profile.duration, 3)
    (0.2, 2.8)
    """
    if unit not in ("m", "rad"):
        raise ValueError(f'unit must be "m" or "rad", got {unit!r}: convert points and limits')
    dt = positive("dt", dt, unit="s")
    limits = (
        positive("velocity", velocity, unit=f"{unit}/s"),
        positive("acceleration", acceleration, unit=f"{unit}/s^2"),
        positive("jerk", jerk, unit=f"{unit}/s^3"),
    )
    if np.ndim(points) == 0:
        points = [0.0, finite("points", points)]
    places = samples("points", points, "npoints")
    rests = samples("dwell", np.atleast_1d(np.asarray(dwell)), "npoints")
    if rests.size not in (1, places.size):
        raise ValueError(
            f"dwell holds {rests.size} times for {places.size} points: give one, or one each"
        )
    if np.any(rests < 0.0):
        raise ValueError(f"dwell must be zero or more [s], got {dwell!r}")
    # Rows of an axis at rest, without the sample at the end.
    counts = np.ceil(np.broadcast_to(rests, places.shape) / dt - 1e-9).astype(int)
    still = [np.repeat([[x], [0.0], [0.0]], n, 1) for x, n in zip(places, counts, strict=True)]
    parts = [still[0]]
    for start, end, rest in zip(places[:-1], places[1:], still[1:], strict=True):
        parts += [_move(start, end, dt, *limits, unit), rest]
    position, speed, rate = np.hstack([*parts, [[places[-1]], [0.0], [0.0]]])
    return MotionProfile(dt, position, speed, rate, unit)


def _state_after_jerk(h: Any, state: Any, jerk: Any) -> tuple[Any, Any, Any]:
    """Position, velocity and acceleration after a time of constant jerk."""
    x, v, a = state
    x = x + h * (v + h * (a / 2.0 + h * jerk / 6.0))
    return x, v + h * (a + h * jerk / 2.0), a + h * jerk


def _move(start: float, end: float, dt: float, v: float, a: float, j: float, unit: str) -> Floats:
    """Rows of one move from rest to rest, without the sample at the end."""
    way = abs(end - start)
    jerks, lengths = move_phases(way, v, a, j)
    ends = np.cumsum(lengths)
    if ends[-1] / dt > 1e9:
        raise ValueError(
            f"a move of {way:g} {unit} takes {ends[-1]:.3g} s at these limits, over 1e9 samples: "
            "check the units of points, velocity, acceleration and jerk"
        )
    # State at the start of every phase.
    states = np.zeros((8, 3))
    for i, (jerk, h) in enumerate(zip(jerks, lengths, strict=True)):
        states[i + 1] = _state_after_jerk(h, states[i], jerk)
    t = np.arange(math.ceil(ends[-1] / dt - 1e-9)) * dt
    phase = np.minimum(np.searchsorted(ends, t, side="right"), 6)
    h = t - np.concatenate([[0.0], ends[:-1]])[phase]
    rows = math.copysign(1.0, end - start) * np.array(
        _state_after_jerk(h, states[phase].T, jerks[phase])
    )
    rows[0] += start
    return rows


def move_phases(way: float, v: float, a: float, j: float) -> tuple[Floats, Floats]:
    """Jerks and lengths of the seven phases of a move from rest to rest."""
    ramp = a / j if v * j >= a * a else math.sqrt(v / j)
    rise = ramp + v / a if v * j >= a * a else 2.0 * ramp
    cruise = way / v - rise
    if cruise < 0.0:
        # The top speed is not reached; nor the acceleration, on a short way.
        cruise = 0.0
        ramp = a / j
        if way >= 2.0 * a * ramp * ramp:
            rise = 0.5 * ramp + math.sqrt(0.25 * ramp * ramp + way / a)
        else:
            ramp = math.cbrt(way / (2.0 * j))
            rise = 2.0 * ramp
    hold = max(rise - 2.0 * ramp, 0.0)
    jerks = j * np.array([1.0, 0.0, -1.0, 0.0, -1.0, 0.0, 1.0])
    return jerks, np.array([ramp, hold, ramp, cruise, ramp, hold, ramp])
