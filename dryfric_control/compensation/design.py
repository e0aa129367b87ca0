"""Friction compensation: the design and what it carries."""

from __future__ import annotations

import functools
import html
import math
import os
from dataclasses import dataclass
from typing import Any

import control as ct
import numpy as np
from numpy.typing import NDArray

from dryfric_control.model.axis import FrictionAxis, check_pace

from dryfric_control.compensation.runtime import CompensatedController
from dryfric_control.compiled import compensation as kernel
from dryfric_control.checks import finite, instance, positive
from dryfric_control.observer.design import ObserverDesign, design_pi_observer
from dryfric_control.observer.own_axis import LEFT_OUT
from dryfric_control.observer.runtime import tables
from dryfric_control.text import wrapped

LAWS = ("learned", "fixed", "sign", "pid", "disturbance observer", "adrc")
_SOURCES = {"disturbance observer": kernel.DISTURBANCE, "adrc": kernel.EXTENDED}

#: Gains of the sliding loop over its bandwidth w: kd + f = 1.86 m w, ki = 0.35 w kp.
#: Found on five plants other than those of the benchmark, as are the next ones.
_DAMPING, _INTEGRAL = 1.86, 0.35
#: Bandwidth times the whole delay of the loop: a third of the phase that it has to spare.
_PHASE = 0.55
#: Delay of sampling, hold, difference and low-pass, in samples.
_SAMPLED = 1.3
#: Largest bandwidth times dt.
_FASTEST = 0.2
#: Rate of learning [1/s], share of the residual that is fed back.
_LEARNING, _RESIDUAL = 15.0, 0.26
#: Share of the Coulomb level that stays at rest; the integral carries the rest.
_REST_SHARE = 0.3
#: Largest correction of a level and largest excess.
_BAND, _MOST_EXCESS = 0.5, 0.8
#: Largest held drive, as a part of the least Coulomb level within the mismatch.
_HOLD_SHARE = 0.9
#: Widening of the tolerance at rest with every correction.
_GROWTH = 1.5


@dataclass(frozen=True, eq=False, repr=False)
class Compensation:
    """A position controller that compensates friction, with its certificate.

    Made by `design_compensation`.

    Attributes
    ----------
    axis : FrictionAxis
        The axis that is compensated.
    dt : float
        Sampling time [s].
    law : str
        "learned", or a baseline.
    encoder_quantum : float
        Encoder increment [m].
    input_delay : float
        Largest delay of the drive, beyond the axis' own effects [s].
    bandwidth : float
        Bandwidth of the sliding loop [rad/s].
    kp, ki, kd : float
        Gains [N/m], [N/(m s)], [N s/m].
    filter_time : float
        Time constant of the low-pass on the speed [s].
    lead : int
        Samples by which the feedforward looks ahead.
    limit : float
        Largest drive force [N].
    tolerance : float
        Position error at which the drive is held at rest [m].
    learning : float
        Rate at which levels and excess are learned [1/s].
    disturbance_bandwidth : float
        Bandwidth of a baseline's disturbance observer [rad/s].
    mismatch : float
        Part by which every parameter may be off, for the certificate.
    observer : ObserverDesign or None
        The switched observer, where the law has one.
    certificate : Any
        The tracking tube and the conditions of rest, recomputed from the gains.

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    >>> comp = dfc.design_compensation(axis, dt=1e-3, encoder_quantum=1e-6)
    >>> comp.lead, comp.certificate.no_hunting
    (1, True)
    """

    axis: FrictionAxis
    dt: float
    law: str
    encoder_quantum: float
    input_delay: float
    bandwidth: float
    kp: float
    ki: float
    kd: float
    filter_time: float
    lead: int
    limit: float
    tolerance: float
    learning: float
    disturbance_bandwidth: float
    mismatch: float
    observer: ObserverDesign | None
    certificate: Any

    @functools.cached_property
    def rigid_axis(self) -> FrictionAxis:
        """The axis whose effects the feedforward evaluates: one rigid mass."""
        return rigid(self.axis)

    @functools.cached_property
    def controller(self) -> CompensatedController:
        """The controller, for `simulate_loop` and for a loop of one's own."""
        return CompensatedController(self.dt, self.lead, self._law())

    def block(self, name: str = "controller") -> ct.NonlinearIOSystem:
        """The controller with its observer as one sampled block.

        Parameters
        ----------
        name : str, optional
            Name of the block.

        Returns
        -------
        control.NonlinearIOSystem
            Inputs xref, vref, aref, y; outputs u and friction, see
            `CompensatedController.block`.
        """
        return self.controller.block(name)

    def _law(self) -> kernel.Law:
        axis, dt, w = self.rigid_axis, self.dt, self.bandwidth
        switched = self.law in ("learned", "fixed")
        stribeck = axis.stribeck
        keep = math.exp(-dt / self.filter_time) if self.filter_time > 0.0 else 0.0
        rest_speed = 0.1 * self.encoder_quantum or 1e-6 * axis.stick_speed
        extended = extended_gains(axis, dt, self.disturbance_bandwidth)
        numbers = np.zeros(kernel.LENGTH)
        values = {
            kernel.DT: dt,
            kernel.LEAD: self.lead,
            kernel.KP: self.kp,
            kernel.KI: self.ki,
            kernel.KD: self.kd,
            kernel.KEEP: keep,
            kernel.LIMIT: self.limit,
            kernel.MASS: axis.mass,
            kernel.VISCOUS: axis.viscous,
            kernel.COULOMB: 1.0 if switched else 0.9 if self.law == "sign" else 0.0,
            kernel.PEAK: 1.0 if switched else 0.0,
            kernel.REST_SHARE: _REST_SHARE,
            kernel.REST_SPEED: rest_speed,
            kernel.STICK_SPEED: axis.stick_speed,
            kernel.STRIBECK_SPEED: stribeck.speed if stribeck else 0.0,
            kernel.EXCESS: stribeck.excess if stribeck else 0.0,
            kernel.MOST_EXCESS: max(_MOST_EXCESS, 2.0 * stribeck.excess if stribeck else 0.0),
            kernel.BAND: _BAND,
            kernel.RATE: min(self.learning * dt, 0.5) if self.law == "learned" else 0.0,
            kernel.RESIDUAL: self.residual,
            kernel.BUILD: presliding_distance(self.axis),
            kernel.SOURCE: kernel.LEARNED if switched else _SOURCES.get(self.law, kernel.NOTHING),
            kernel.HOLDS: switched,
            kernel.TOLERANCE: self.tolerance,
            kernel.GROWTH: _GROWTH,
            kernel.HOLD_SHARE: _HOLD_SHARE * (1.0 - self.mismatch),
            kernel.SETTLE: 8.0 / (w * dt),
            kernel.MEAN: -math.expm1(-dt * w / 2.6),
            kernel.GAIN_X: self.disturbance_bandwidth if self.law != "adrc" else extended[0],
            kernel.GAIN_V: extended[1],
            kernel.GAIN_F: extended[2],
        }
        for place, value in values.items():
            numbers[place] = value
        own = axis.arrays(dt)
        watched = _watched(self.observer or axis, self.encoder_quantum, dt)
        return kernel.Law(numbers, own.numbers, own.integers, *watched)

    @property
    def residual(self) -> float:
        """Share of the estimated friction residual that is fed back."""
        return {"learned": _RESIDUAL, "disturbance observer": 1.0, "adrc": 1.0}.get(self.law, 0.0)


def rigid(axis: FrictionAxis) -> FrictionAxis:
    """The axis that acts, without effects that need inner states.

    Parameters
    ----------
    axis : FrictionAxis
        The axis.

    Returns
    -------
    FrictionAxis
    """
    acting = axis.effective()
    return acting.replace(effects=tuple(e for e in acting.effects if e.action not in LEFT_OUT))


def presliding_distance(axis: FrictionAxis) -> float:
    """Way over which friction builds up at a reversal [m], 0 without presliding.

    Parameters
    ----------
    axis : FrictionAxis
        The axis.

    Returns
    -------
    float
    """
    acting = axis.effective()
    stiffness = acting.arrays(1.0).numbers[kernel.axis_step.CONTACT_STIFFNESS]
    middle = 0.5 * sum(acting.travel or (0.0, 0.0))
    level = 0.5 * float(acting.coulomb(middle, 1) + acting.coulomb(middle, -1))
    return level / float(stiffness) if stiffness > 0.0 else 0.0


def drive_delay(axis: FrictionAxis) -> float:
    """Delay and lag of the drive that the axis itself has [s].

    Parameters
    ----------
    axis : FrictionAxis
        The axis.

    Returns
    -------
    float
    """
    numbers = axis.arrays(1.0).numbers
    return float(numbers[kernel.axis_step.DELAY] + numbers[kernel.axis_step.LAG])


def extended_gains(axis: FrictionAxis, dt: float, bandwidth: float) -> NDArray[np.float64]:
    """Gains of an extended state observer with three equal poles.

    Parameters
    ----------
    axis : FrictionAxis
        Mass and viscous coefficient.
    dt : float
        Sampling time [s].
    bandwidth : float
        Its bandwidth [rad/s].

    Returns
    -------
    ndarray, shape (3,)
        Gains of position [1], speed [1/s] and force [N/m], by the current
        reading; a resisting force.
    """
    rate, m = axis.viscous / axis.mass, axis.mass
    A = np.array(
        [
            [1.0, dt * (1.0 - 0.5 * dt * rate), 0.5 * dt**2 / m],
            [0.0, 1.0 - dt * rate, dt / m],
            [0.0, 0.0, 1.0],
        ]
    )
    # (I - M C) A has these poles; C A is the first row of A.
    pole = math.exp(-bandwidth * dt)
    return np.asarray(ct.acker(A.T, A[:1].T, [pole] * 3), dtype=float).ravel()


def _watched(source: ObserverDesign | FrictionAxis, quantum: float, dt: float) -> tuple[Any, ...]:
    """Arrays of the observer; of none, such as the compiled law takes all the same."""
    if isinstance(source, ObserverDesign):
        return tuple(tables(source, "reading", quantum))
    arrays = source.arrays(dt)
    return (
        np.zeros(5), np.zeros((3, 6)), np.zeros((1, 3)), np.zeros((2, 3), dtype=np.int64),
        arrays.numbers, arrays.integers,
    )  # fmt: skip


def design_compensation(
    axis: FrictionAxis,
    dt: float = 1e-3,
    encoder_quantum: float = 1e-6,
    input_delay: float = 0.0,
    bandwidth: float | None = None,
    *,
    law: str = "learned",
    gains: tuple[float, float, float] | None = None,
    limit: float | None = None,
    tolerance: float | None = None,
    learning: float | None = None,
    disturbance_bandwidth: float | None = None,
    mismatch: float = 0.2,
) -> Compensation:
    """Design a position controller that compensates friction.

    Parameters
    ----------
    axis : FrictionAxis
        The axis, e.g. ``diagnosis.extended``.
    dt : float, optional
        Sampling time [s].
    encoder_quantum : float, optional
        Encoder increment [m]; 0 for an exact measurement.
    input_delay : float, optional
        Largest delay of the drive, beyond the axis' own effects [s].
    bandwidth : float, optional
        Bandwidth of the sliding loop [rad/s].  Default: what delay and sampling
        time allow.
    law : str, optional
        "learned" (default): Coulomb and Stribeck feedforward, learned; "fixed":
        the same, not learned.  Baselines: "pid"; "sign", a PID with the nominal
        Coulomb level by the sign of the reference speed; "disturbance
        observer"; "adrc".
    gains : (float, float, float), optional
        kp, ki and kd in place of those that follow from the bandwidth.
    limit : float, optional
        Largest drive force [N].  Default: none.
    tolerance : float, optional
        Position error at which the drive is held at rest [m].  Default: three
        increments, at least a hundredth of the way that friction moves kp.
    learning : float, optional
        Rate of learning [1/s].
    disturbance_bandwidth : float, optional
        Bandwidth of the disturbance observer of a baseline [rad/s].
    mismatch : float, optional
        Part by which mass, viscous coefficient, Coulomb level, Stribeck excess
        and speed may each be off, for the certificate.

    Returns
    -------
    Compensation

    Raises
    ------
    ValueError
        If an argument is out of its range, or the loop is unstable for an axis
        within the mismatch.

    Warns
    -----
    ObserverWarning
        If the axis has a play or a compliance, which the observer leaves out.

    Notes
    -----
    With the reference r looked ahead by the delay, s its direction, L the
    Coulomb level there, g the other force effects there ::

        u = kp e + ki integral(e) + kd e_v + m a_r + f v_r - g(r)
            + s (L + c_s + sigma L exp(-((abs(v_r) - Sigma)/vs)^2)) + 0.26 s l

    c_s and sigma are learned by normalised least mean squares from the switched
    observer's friction while it slides; l is what they leave.  c_s stays within
    half a level.  With presliding, s runs from -1 to 1 as the reference covers
    the presliding distance (Dahl's shape, as Prandtl's element has it).

    At rest of reference and axis the integral is held once the error is within
    the tolerance, and after a settling time the drive itself.  Each correction
    widens the tolerance by half: corrections end, and a constant drive below
    breakaway does not hunt.

    Static input effects (gain, dead zone) are inverted.  Effects that need
    states of their own (a play, a compliance) are not compensated.

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0,
    ...                         stribeck=dfc.Stribeck(excess=0.3, speed=0.01))
    >>> comp = dfc.design_compensation(axis, dt=1e-3, encoder_quantum=1e-6, input_delay=3e-3)
    >>> round(comp.bandwidth)
    128
    """
    instance("axis", axis, FrictionAxis)
    dt = positive("dt", dt, unit="s")
    quantum = positive("encoder_quantum", encoder_quantum, unit="m", zero=True)
    delay = positive("input_delay", input_delay, unit="s", zero=True)
    if not isinstance(law, str) or law not in LAWS:
        raise ValueError(f"law must be one of {', '.join(LAWS)}, got {law!r}")
    mismatch = positive("mismatch", mismatch, zero=True)
    if mismatch >= 1.0:
        raise ValueError(f"mismatch must be below 1 (a part of each parameter), got {mismatch:g}")
    check_pace(axis, dt)
    acting = rigid(axis)
    whole_delay = delay + drive_delay(acting)
    if bandwidth is None:
        bandwidth = min(_PHASE / (whole_delay + _SAMPLED * dt), _FASTEST / dt)
    w = positive("bandwidth", bandwidth, unit="rad/s")
    if w * dt > 0.5:
        raise ValueError(
            f"bandwidth {w:g} rad/s is too high for dt = {dt:g} s: keep bandwidth * dt below 0.5"
        )
    level = largest_level(acting)
    if gains is None:
        kp = acting.mass * w**2
        kd = max(_DAMPING * acting.mass * w - acting.viscous, 0.0)
        ki = 0.0 if law == "adrc" else _INTEGRAL * w * kp
    else:
        kp, ki, kd = _three(gains)
    # An encoder step must not kick harder than friction holds.
    kick = kd * quantum / dt
    keep = max(math.exp(-1.0 / 0.3), 1.0 - level / kick if kick > level > 0.0 else 0.0)
    filter_time = min(-dt / math.log(keep), 0.5 / w)
    reach = level / kp
    observer = None
    if law in ("learned", "fixed"):
        observer = design_pi_observer(
            _watchable(axis), dt, discretization="zoh", encoder_quantum=quantum or None
        )
    made = dict(
        axis=axis,
        dt=dt,
        law=law,
        encoder_quantum=quantum,
        input_delay=delay,
        bandwidth=w,
        kp=kp,
        ki=ki,
        kd=kd,
        filter_time=filter_time,
        lead=round(whole_delay / dt + 1.0),
        limit=math.inf if limit is None else positive("limit", limit, unit="N"),
        tolerance=(
            max(3.0 * quantum, 0.01 * reach, 1e-9 * acting.stick_speed)
            if tolerance is None
            else positive("tolerance", tolerance, unit="m")
        ),
        learning=_LEARNING if learning is None else positive("learning", learning, zero=True),
        disturbance_bandwidth=(
            w
            if disturbance_bandwidth is None
            else positive("disturbance_bandwidth", disturbance_bandwidth, unit="rad/s")
        ),
        mismatch=mismatch,
        observer=observer,
    )
    return Compensation(**made, certificate=None)


def _watchable(axis: FrictionAxis) -> FrictionAxis:
    """The axis without an elastic contact, which the law compensates by itself."""
    acting = axis.effective()
    return acting.replace(effects=tuple(e for e in acting.effects if e.action != "contact"))


def largest_level(axis: FrictionAxis) -> float:
    """Largest Coulomb level of the map over the travel [N].

    Parameters
    ----------
    axis : FrictionAxis
        The axis.

    Returns
    -------
    float
    """
    places = np.linspace(*axis.travel, 101) if axis.travel else np.zeros(1)
    return float(max(axis.coulomb(places, s).max() for s in (1, -1)))


def _three(gains: Any) -> tuple[float, float, float]:
    """Gains kp, ki and kd as given by the user."""
    try:
        kp, ki, kd = gains
    except (TypeError, ValueError):
        raise ValueError(f"gains must be (kp, ki, kd), got {gains!r}") from None
    return (
        positive("gains[0] (kp)", kp, unit="N/m"),
        positive("gains[1] (ki)", ki, zero=True),
        finite("gains[2] (kd)", kd),
    )
