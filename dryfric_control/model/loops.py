"""Sampled position loops: the controller's law and the compiled closed loop."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import control as ct
import numpy as np
from numpy.typing import ArrayLike

from dryfric_control.arrays import Floats
from dryfric_control.checks import finite, instance, positive, samples, warn
from dryfric_control.compiled import loop as kernel
from dryfric_control.model.axis import Arrays, FrictionAxis, check_pace, without_effects
from dryfric_control.model.block import Block
from dryfric_control.model.profiles import MotionProfile
from dryfric_control.model.responses import SimulationResponse, check_finite, locate_switches
from dryfric_control.order import check_bandwidth_and_dt
from dryfric_control.text import page_reference, stated, with_parameters
from dryfric_control.units import same_unit


class LoopRun(NamedTuple):
    """One run of a closed loop: plant, motion and what is filled."""

    axis: Arrays
    state: Floats  # memory of the plant, position and velocity first
    motion: MotionProfile
    disturbance: Floats  # shape (n,) [N]
    quantum: float  # [m]
    room: int  # numbers that one sample may write into the list of switches
    out: Floats  # shape (6, n): x, v, F, mode, u, y


class LoopController(Protocol):
    """What `simulate_loop` asks of a controller."""

    @property
    def dt(self) -> float: ...
    def run(self, loop: LoopRun) -> tuple[Floats, int]:
        """Run the loop: located switches, and how many had no room."""


@with_parameters
@dataclass(frozen=True)
class PositionController:
    """Sampled PID position controller, limited, with anti-windup.

    Notes
    -----
    ::

        u = sat(kp (r - y) + ki integral(r - y) - kd v_f)
        v_f: (y[k] - y[k - span]) / (span dt), through a first-order low-pass

    The integral is unwound with the rate kp/ki while the force is limited.

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    >>> loop = dfc.PositionController(kp=400.0, ki=0.0, kd=40.0, dt=1e-3)
    >>> resp = dfc.simulate_loop(axis, loop, [0.1] * 2000)
    >>> round(float(resp.y[0, -1]), 6)     # friction holds it off by Fc / kp
    0.08
    """

    kp: float = stated("Position gain [N/m].")
    ki: float = stated("Integral gain [N/(m s)].")
    kd: float = stated("Velocity gain, on the measured velocity [N s/m].")
    dt: float = stated("Sampling time [s].")
    limit: float = stated("Largest magnitude of the force [N].", math.inf)
    filter_time: float = stated("Time constant of the low-pass on the velocity [s].", 0.0)
    span: int = stated("Samples over which the velocity is differenced, 1 to 8.", 1)

    def __post_init__(self) -> None:
        positive("kp", self.kp, unit="N/m")
        positive("ki", self.ki, zero=True)
        finite("kd", self.kd)
        positive("dt", self.dt, unit="s")
        positive("filter_time", self.filter_time, unit="s", zero=True)
        if self.limit != math.inf:
            positive("limit", self.limit, unit="N")
        if isinstance(self.span, bool) or self.span not in range(1, kernel.LONGEST_SPAN + 1):
            raise ValueError(
                f"span must be a whole number from 1 to {kernel.LONGEST_SPAN}, got {self.span!r}"
            )

    @classmethod
    def from_bandwidth(
        cls,
        axis: FrictionAxis,
        bandwidth: float,
        dt: float,
        limit: float | None = None,
        at: tuple[float, ...] | None = None,
    ) -> PositionController:
        """Controller that puts the sliding mode's poles at a bandwidth.

        Parameters
        ----------
        axis : FrictionAxis
        bandwidth : float
            Closed-loop bandwidth [rad/s].
        dt : float
            Sampling time [s].
        limit : float, optional
            Largest force [N].  Default: five times the largest breakaway friction force.
        at : tuple of float, optional
            Point at which the effects are linearised, see `FrictionAxis.mode_ss`;
            a pendulum needs it.  Default: effects are left out.

        Notes
        -----
        State feedback with integral action on the exactly sampled sliding mode: two poles at
        exp(-w dt), the third at exp(-w3 dt) with w3 = max(w, f/m - 2 w), the slowest that needs no
        negative velocity gain; with `at`, f/m is the damping there.  Keep the bandwidth well below
        that of delay, lag, presliding, backlash and compliance, which are left out.
        """
        instance("axis", axis, FrictionAxis)
        bandwidth = positive("bandwidth", bandwidth, unit="rad/s")
        dt = positive("dt", dt, unit="s")
        check_bandwidth_and_dt(bandwidth, dt)
        if bandwidth * dt > 0.2:
            raise ValueError(
                f"bandwidth {bandwidth:g} rad/s is too high for dt = {dt:g} s: keep "
                "bandwidth * dt below 0.2"
            )
        if limit is None:
            places = np.linspace(*axis.travel, 101) if axis.travel else np.zeros(1)
            level = max(axis.breakaway(places, s).max() for s in (1, -1))
            limit = 5.0 * float(level) if level > 0.0 else math.inf
        bare = without_effects(axis)
        sliding = bare.mode_ss(+1, dt, "zoh", at=at)
        damping = -float(bare.mode_ss(+1, at=at).A[1, 1])
        third = max(bandwidth, damping - 2.0 * bandwidth)
        poles = np.exp(-dt * np.array([bandwidth, bandwidth, third]))
        # States x, v and the integral of -x (reference at zero).
        a = np.block([[sliding.A, np.zeros((2, 1))], [-dt * sliding.C, np.ones((1, 1))]])
        b = np.vstack([sliding.B, [[0.0]]])
        kp, kd, minus_ki = np.asarray(ct.acker(a, b, poles)).ravel()
        gains = float(kp), float(-minus_ki), float(max(kd, 0.0))
        return cls(*gains, dt, limit, filter_time=max(0.05 / bandwidth, 2.0 * dt))

    @property
    def gains(self) -> Floats:
        """Numbers that the compiled law reads, shape (7,)."""
        keep = math.exp(-self.dt / self.filter_time) if self.filter_time > 0.0 else 0.0
        return np.array([self.kp, self.ki, self.kd, self.limit, keep, self.span, self.dt])

    def memory(self, reading: float = 0.0, speed: float = 0.0) -> Floats:
        """Memory of a controller that has seen a steady motion.

        Parameters
        ----------
        reading, speed : float, optional
            Position reading [m] and velocity [m/s].
        """
        reading = finite("reading", reading)
        speed = finite("speed", speed)
        memory = np.zeros(kernel.READINGS + kernel.LONGEST_SPAN)
        memory[kernel.SPEED] = speed
        ago = np.arange(1, kernel.LONGEST_SPAN + 1)
        memory[kernel.READINGS :] = reading - speed * self.dt * ago
        return memory

    def run(self, loop: LoopRun) -> tuple[Floats, int]:
        """Run the loop: located switches, and how many had no room.

        Parameters
        ----------
        loop : LoopRun
        """
        memory = self.memory(kernel.encode(loop.state[0], loop.quantum), loop.state[1])
        return kernel.run_loop(
            loop.axis.numbers, loop.axis.integers, loop.state, self.gains, memory,
            loop.motion.position, loop.disturbance, loop.quantum, self.dt, loop.room, loop.out,
        )  # fmt: skip

    def block(self, name: str = "controller") -> ct.NonlinearIOSystem:
        """The controller as a sampled block: inputs xref, y; output u.

        Parameters
        ----------
        name : str, optional
        """
        gains = self.gains

        def step(t: float, memory: Floats, u: Any) -> Floats:
            return np.array([kernel.control_update(gains, memory, u[0], u[1])])

        states = ["integral", "speed", *(f"y{i + 1}" for i in range(kernel.LONGEST_SPAN))]
        return Block.from_step(step, "xref y", "u", states, self.dt, name)


def simulate_loop(
    axis: FrictionAxis,
    controller: LoopController,
    reference: MotionProfile | ArrayLike,
    quantum: float = 0.0,
    x0: float | None = None,
    v0: float = 0.0,
    disturbance: ArrayLike | None = None,
) -> SimulationResponse:
    """Run plant, encoder and controller in one compiled loop.

    Parameters
    ----------
    axis : FrictionAxis
    controller : PositionController or CompensatedController
        The controller, or that of a compensation; its `dt` is the sampling time.
    reference : MotionProfile or array_like, shape (n,)
        Reference motion, or its positions at the samples [m].
    quantum : float, optional
        Encoder increment [m]; 0 measures exactly.
    x0, v0 : float, optional
        Position and velocity of the plant at the start: by default at rest, where a
        `MotionProfile` starts, and at 0 if the reference is one of positions.  The
        controller starts as one that has followed that motion.
    disturbance : array_like, shape (n,), optional
        Force added to the drive force [N].

    Returns
    -------
    SimulationResponse
        Outputs x, v, F, mode, u, y; input r; with `events`.  A RuntimeWarning says that the loop
        diverges: at the end the error is more than ten times the travel of the reference, and the
        axis still moves.

    Examples
    --------
    >>> import numpy as np
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    >>> loop = dfc.PositionController.from_bandwidth(axis, bandwidth=20.0, dt=1e-3)
    >>> resp = dfc.simulate_loop(axis, loop, np.full(2000, 0.1), quantum=1e-6)
    >>> resp.output_labels
    ['x', 'v', 'F', 'mode', 'u', 'y']
    """
    instance("axis", axis, FrictionAxis)
    check_controller(controller)
    motion = MotionProfile.of(reference, controller.dt)
    if isinstance(reference, MotionProfile) and not same_unit(motion.unit, axis.units[0]):
        raise ValueError(
            f"reference is in {motion.unit!r}, the axis in {axis.units[0]!r}: make it with "
            f"motion_profile(..., unit={axis.units[0]!r})"
        )
    r = motion.position
    quantum = positive("quantum", quantum, unit=axis.unit("m"), zero=True)
    if x0 is None:
        x0 = float(r[0]) if motion is reference else 0.0
    x0, v0 = finite("x0", x0), finite("v0", v0)
    force = np.zeros(r.size) if disturbance is None else samples("disturbance", disturbance)
    if force.size != r.size:
        raise ValueError(
            f"disturbance has {force.size} samples and reference {r.size}: give one for each"
        )
    dt = controller.dt
    check_pace(axis, dt)
    arrays = axis.arrays(dt)
    out = np.empty((6, r.size))

    def run(room: int) -> tuple[Floats, int]:
        memory = arrays.start_memory(x0, v0)
        return controller.run(LoopRun(arrays, memory, motion, force, quantum, room, out))

    events = locate_switches(run)
    check_finite(out)
    _warn_if_divergent(axis, motion, force, out)
    labels = {"output_labels": ["x", "v", "F", "mode", "u", "y"], "input_labels": ["r"]}
    title = f"{axis.name}: closed loop"
    time = np.arange(r.size) * dt
    return SimulationResponse(
        time, out, r.reshape(1, -1), events, axis.units, title=title, sysname=axis.name, **labels
    )


def check_controller(controller: object) -> None:
    """Refuse what `simulate_loop` cannot run."""
    if not callable(getattr(controller, "run", None)) or not hasattr(controller, "dt"):
        instance("controller", controller, PositionController, "or comp.controller")


def _warn_if_divergent(
    axis: FrictionAxis, motion: MotionProfile, disturbance: Floats, out: Floats
) -> None:
    """Warn of a loop whose error is far beyond its reference and does not come to rest."""
    r = motion.position
    lasts = motion.duration
    if lasts <= 0.0:
        return
    # Travel of the reference, and the way that start and disturbance alone would take the mass.
    thrown = abs(out[1, 0]) * lasts + np.abs(disturbance).max() * lasts**2 / (2.0 * axis.mass)
    travel = float(np.ptp(r) + abs(r[0] - out[0, 0]) + thrown)
    late = slice(-max(r.size // 5, 1), None)
    error = float(np.abs(r[late] - out[0, late]).max())
    # A loop that sags under a constant load comes to rest.
    if error <= 10.0 * travel or np.abs(out[1, late]).max() <= 10.0 * travel / lasts:
        return
    length = axis.units[0]
    cause = (
        "It is unstable on this axis, most often because the drive is later than the controller "
        "was designed for: compare the delay of the axis with comp.certificate.delay_margin, and "
        "give it to the design (input_delay=); otherwise lower bandwidth or gains"
    )
    if np.ptp(out[4, late]) == 0.0:
        cause = "The drive stays at its limit, which does not hold the load: raise the limit"
    warn(
        f"the loop diverges: its error reaches {error:.3g} {length}, where reference, start and "
        f"disturbance account for {travel:.3g} {length}. {cause}"
        + page_reference("troubleshooting"),
        RuntimeWarning,
    )
