"""The slow-ramp experiment: a crawl over the travel and back."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Any

import numpy as np

from dryfric_control.arrays import Floats
from dryfric_control.checks import instance, positive, warn
from dryfric_control.drawing import MEASURED, TIME_LABEL, label_axes, panels
from dryfric_control.identification.fit import FitWarning
from dryfric_control.model.axis import FrictionAxis, span_of
from dryfric_control.model.loops import PositionController, simulate_loop
from dryfric_control.model.responses import SimulationResponse
from dryfric_control.records.readers.channels import MAX_ROWS
from dryfric_control.records.record import Record
from dryfric_control.records.record_checks import MIN_SAMPLES
from dryfric_control.store.files import replace_file
from dryfric_control.text import Result

# Stribeck velocities beyond which the excess is gone.
_CLEAR = 2.0
# Fewest switches of stick-slip.
_STEADY = 16


@dataclass(frozen=True, eq=False, repr=False)
class SlowRamp(Result):
    """A slow-ramp experiment and what the model did in it; made by `slow_ramp_experiment`."""

    axis: FrictionAxis  # that was run
    controller: PositionController  # the loop of very low bandwidth
    record: Record  # what a bench would record, the reference with it
    response: SimulationResponse  # the model's own signals, friction and mode among them

    @property
    def reference(self) -> Floats:
        """Position reference at every sample, shape (n,)."""
        return np.asarray(self.record.reference)

    def to_csv(self, path: str | os.PathLike[str]) -> None:
        """Write time and reference to a CSV file for a real bench."""
        head = f"t [s],reference [{self.axis.units[0]}]"
        columns = np.column_stack((self.record.t, self.reference))
        with replace_file(path) as part:
            np.savetxt(part, columns, fmt="%.9g", delimiter=",", header=head, comments="")

    def _summary_parts(self) -> list[str]:
        found = self.to_dict()
        length = self.axis.units[0]
        speed = float(np.max(np.abs(np.diff(self.reference)))) / self.record.dt
        return [
            f"slow ramp over {found['low']:.4g} to {found['high']:.4g} {length} and back in "
            f"{found['duration']:.4g} s, {speed:.3g} {length}/s; {found['switches']} switches"
        ]

    def to_dict(self) -> dict[str, Any]:
        """Numbers of the experiment, ready for JSON."""
        low = float(self.reference.min())
        high = float(self.reference.max())
        run = {"dt": self.record.dt, "duration": self.record.duration, "low": low, "high": high}
        gains = {name: getattr(self.controller, name) for name in ("kp", "ki", "kd")}
        return run | {"switches": len(self.response.events)} | gains

    @panels(2)
    def plot(self, axes: Any) -> str:
        """Draw reference and position, and the drive force (paper, Fig. 4)."""
        length, force = self.axis.units
        record = self.record
        axes[0].plot(record.t, record.x, "-", color=MEASURED, lw=2.5, label="position")
        axes[0].plot(record.t, self.reference, "--", color="C0", lw=1, label="reference")
        label_axes(axes[0], y=f"position [{length}]")
        axes[1].plot(record.t, record.u, "-", color="0.4", lw=0.8)
        label_axes(axes[1], TIME_LABEL, f"drive force [{force}]", legend=False)
        return record.name or "slow ramp"


def slow_ramp_experiment(
    axis: FrictionAxis,
    duration: float = 60.0,
    dt: float = 1e-3,
    *,
    bandwidth: float = 10.0,
    travel: tuple[float, float] | None = None,
    quantum: float = 0.0,
    controller: PositionController | None = None,
) -> SlowRamp:
    """Run a slow triangle over the travel under a soft position loop.

    Parameters
    ----------
    axis : FrictionAxis
        The axis, as far as it is known; used to design the loop.
    duration : float, optional
        Time for the way there and back [s].
    dt : float, optional
        Sampling time [s].
    bandwidth : float, optional
        Bandwidth of the position loop [rad/s]: low, so that the drive force follows friction.
    travel : tuple of float, optional
        Lowest and highest position.  Default: that of the axis.
    quantum : float, optional
        Encoder increment; 0 reads exactly.
    controller : PositionController, optional
        Another loop in place of the one designed from `bandwidth`.

    Returns
    -------
    SlowRamp
        With `record` for `identify_coulomb`, and `to_csv` to run the reference on a bench.

    Raises
    ------
    ValueError
        If no travel is known or an argument is out of its range.

    Warns
    -----
    FitWarning
        If the crawl stays within the Stribeck peak without sticking: it measures raised friction.

    Notes
    -----
    The velocity is small and nearly constant, so in m v' = u - f v - F(x) the terms m v' and f v
    drop out and the drive force is the friction at the place reached (paper, section 3).  Where
    the axis sticks and slips, that holds on average only, see `identify_coulomb`.

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0, travel=(0.0, 0.3))
    >>> ramp = dfc.slow_ramp_experiment(axis, duration=20.0)
    >>> len(ramp.record), round(float(ramp.record.x.max()), 2)
    (20000, 0.3)
    """
    instance("axis", axis, FrictionAxis)
    duration = positive("duration", duration, unit="s")
    dt = positive("dt", dt, unit="s")
    if not MIN_SAMPLES <= duration / dt <= MAX_ROWS:
        raise ValueError(
            f"duration = {duration:g} s is {duration / dt:.3g} samples of dt = {dt:g} s: choose "
            f"between {MIN_SAMPLES} and {MAX_ROWS} samples"
        )
    quantum = positive("quantum", quantum, unit="m", zero=True)
    span = axis.travel if travel is None else travel
    if span is None:
        raise ValueError("travel is not known: give travel=(low, high), or an axis that has one")
    low, high = span_of(span)
    if controller is None:
        controller = PositionController.from_bandwidth(axis, bandwidth, dt)
    instance("controller", controller, PositionController)
    if abs(controller.dt - dt) > 1e-9 * dt:
        raise ValueError(f"controller.dt is {controller.dt:g} s and dt {dt:g} s: they must agree")
    t = np.arange(round(duration / dt)) * dt
    reference = np.interp(t, [0.0, 0.5 * duration, duration], [low, high, low])
    response = simulate_loop(axis, controller, reference, quantum=quantum, x0=low)
    units = dict(zip("xu", axis.units, strict=True))
    name = f"slow ramp of {axis.name}"
    u = response.y[4]
    x = response.y[5]
    record = Record(t, u, x, reference, units=units, name=name, quantum=quantum)
    ramp = SlowRamp(axis, controller, record, response)
    speed = 2.0 * (high - low) / duration
    peak = axis.effective().stribeck
    unit = f"{axis.units[0]}/s"
    if peak is not None and speed < _CLEAR * peak.speed and len(response.events) < _STEADY:
        warn(
            f"the crawl at {speed:.3g} {unit} stays within the Stribeck peak (speed "
            f"{peak.speed:.3g} {unit}) and does not stick: the drive force is the raised friction. "
            f"Lower bandwidth = {bandwidth:g} rad/s until it sticks and slips, or crawl faster "
            f"than {_CLEAR * peak.speed:.3g} {unit} by a shorter duration",
            FitWarning,
        )
    return ramp
