"""Friction compensation: the design and what it carries."""

from __future__ import annotations

import functools
import html
import math
import os
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import control as ct
import numpy as np
from numpy.typing import NDArray

from dryfric_control.checks import finite, instance, positive
from dryfric_control.compensation.certificate import TrackingCertificate, certify_tracking
from dryfric_control.compensation.runtime import CompensatedController
from dryfric_control.compiled import compensation as kernel
from dryfric_control.model.axis import FrictionAxis, check_pace
from dryfric_control.model.profiles import MotionProfile
from dryfric_control.observer.design import ObserverDesign, design_pi_observer
from dryfric_control.observer.own_axis import LEFT_OUT
from dryfric_control.observer.runtime import tables
from dryfric_control.observer.weights import UNCERTAIN_FRACTION, coulomb_level
from dryfric_control.text import wrapped

LAWS = ("learned", "fixed", "sign", "pid", "disturbance observer", "adrc")
_SOURCES = {"disturbance observer": kernel.DISTURBANCE, "adrc": kernel.EXTENDED}


class _Tuning(NamedTuple):
    """Numbers of the sliding loop, found on plants other than those of the benchmark."""

    phase: float  # bandwidth times the whole delay of the loop
    damping: float  # (kd + f)/(m w)
    share: float  # of the observer's speed in the one fed back
    residual: float  # share of the friction residual that is fed back


#: With the switched observer; with presliding, of which it knows nothing; without.
_RIGID = _Tuning(0.55, 3.2, 0.4, 0.22)
_ELASTIC = _Tuning(0.5, 3.3, 0.5, 0.0)
_BASELINE = _Tuning(0.55, 1.86, 0.0, 0.0)
#: Share of the estimate that a baseline's disturbance observer feeds back.
_ESTIMATE = 0.98
#: Integral gain over w kp.
_INTEGRAL = 0.35
# Natural frequency of the observer [rad/sample] without knowledge of the encoder, and its
# range with it.
_CALM, _CALM_RANGE = 0.15, (0.03, 0.3)
#: Delay of sampling, hold, difference and low-pass, in samples.
_SAMPLED = 1.3
#: Time constant of the low-pass on the speed [samples].
_FILTER = 0.3
#: Largest force by which an encoder step may kick, over the Coulomb level.
_KICK = 1.5
#: Largest bandwidth times dt.
_FASTEST = 0.2
#: Rate of learning [1/s].
_LEARNING = 15.0
#: Share of the Coulomb level that stays at rest; the integral carries the rest.
_REST_SHARE = 0.3
#: Rate at which the observer is expected to follow, over one by its mean delay.
_QUICKER = 2.0
#: Largest correction of a level and largest excess.
_BAND, _MOST_EXCESS = 0.5, 0.8
#: Largest held drive, as a part of the least Coulomb level within the mismatch.
_HOLD_SHARE = 0.9
#: Widening of the tolerance at rest with every correction.
_GROWTH = 1.5


@dataclass(frozen=True, eq=False, repr=False)
class Compensation:
    """A friction-compensating position controller, certified.

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
    certificate: TrackingCertificate

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

    def certify(
        self,
        *,
        mismatch: float | None = None,
        learned: float = 0.0,
        excess: float | None = None,
        reference: MotionProfile | None = None,
    ) -> TrackingCertificate:
        """Compute the certificate for other bounds.

        Parameters
        ----------
        mismatch : float, optional
            Part by which every parameter may be off.  Default: the design's.
        learned : float, optional
            Part of the mismatch of the levels that has been learned, 0 to 1.
        excess : float, optional
            Largest Stribeck excess of the axis.  Default: the nominal one and the
            mismatch.
        reference : MotionProfile, optional
            Reference, for its largest velocity and acceleration.  Default: one so
            slow that inertia and viscous friction do not count.

        Returns
        -------
        TrackingCertificate

        Raises
        ------
        ValueError
            If an argument is out of its range.

        Examples
        --------
        >>> import dryfric_control as dfc
        >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
        >>> comp = dfc.design_compensation(axis, dt=1e-3)
        >>> comp.certify(learned=1.0).tube < comp.certificate.tube
        True
        """
        mu = self.mismatch if mismatch is None else positive("mismatch", mismatch, zero=True)
        known = positive("learned", learned, zero=True)
        stribeck = self.rigid_axis.stribeck
        peak = (1.0 + mu) * stribeck.excess if stribeck else 0.0
        if excess is not None:
            peak = positive("excess", excess, zero=True)
        if mu >= 1.0 or known > 1.0:
            raise ValueError(
                f"mismatch must be below 1 and learned at most 1, got {mu:g} and {known:g}"
            )
        limits = (0.0, 0.0)
        if reference is not None:
            instance("reference", reference, MotionProfile, "made by dfc.motion_profile")
            v, a = reference.velocity, np.abs(reference.acceleration)
            turns = np.flatnonzero(v[1:] * v[:-1] <= 0.0)
            turning = np.maximum(a[turns], a[turns + 1]).max(initial=0.0)
            axis = self.rigid_axis
            asked = axis.mass * a + axis.viscous * np.abs(v)
            limits = (float(asked.max()), float(turning))
        return certify_tracking(self, mu, known, peak, *limits)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the design to a text file.

        Parameters
        ----------
        path : str or path
            File to write, replaced as a whole or not at all; `load_compensation`
            reads it back.
        """
        from dryfric_control.compensation.storage import save_compensation

        save_compensation(self, path)

    def __repr__(self) -> str:
        return self.summary()

    def summary(self) -> str:
        """Gains, delays and certificate in words.

        Returns
        -------
        str
        """
        length, force = self.axis.units
        lines = [
            f"Friction compensation of {self.axis.name}, law {self.law!r}, dt = {self.dt:g} s, "
            f"encoder {self.encoder_quantum:g} {length}",
            f"loop   {self.bandwidth:.4g} rad/s: kp = {self.kp:.6g} {force}/{length}, "
            f"ki = {self.ki:.6g} {force}/({length} s), kd = {self.kd:.6g} {force} s/{length}",
            f"ahead  {self.lead} samples, for a delay of up to "
            f"{self.drive_delay + self.input_delay:g} s",
        ]
        effects = ", ".join(effect.slug for effect in self.rigid_axis.effects) or "none"
        lines.append(f"other effects fed forward: {effects}")
        return f"{wrapped(lines, indent=7)}\n{self.certificate.summary()}"

    def _repr_html_(self) -> str:
        return f"<pre>{html.escape(self.summary())}</pre>"

    def plot(
        self,
        ax: Any = None,
        title: str | None = None,
        reference: MotionProfile | None = None,
    ) -> ct.ControlPlot:
        """Draw a simulated run of the nominal axis with its tube.

        Parameters
        ----------
        ax : sequence of three Axes, optional
            Where to draw.  Default: a new figure.
        title : str, optional
            Title.
        reference : MotionProfile, optional
            Reference to follow.  Default: a move there and back.

        Returns
        -------
        control.ControlPlot
        """
        from dryfric_control.compensation.figures import plot_compensation

        return plot_compensation(self, ax, title, reference)

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
            kernel.LAG: 1.0 if self.observer is None else observer_lag(self.observer),
            kernel.RESIDUAL: self._residual,
            kernel.SPEED_SHARE: self.tuning.share,
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
    def drive_delay(self) -> float:
        """Delay and lag of the drive that the axis itself has [s]."""
        numbers = self.rigid_axis.arrays(self.dt).numbers
        return float(numbers[kernel.axis_step.DELAY] + numbers[kernel.axis_step.LAG])

    @property
    def _residual(self) -> float:
        """Share of the estimated friction, or of its residual, that is fed back."""
        return _ESTIMATE if self.law in _SOURCES else self.tuning.residual

    @property
    def tuning(self) -> _Tuning:
        """Numbers of the sliding loop, by law and axis."""
        return _tuning(self.law, self.axis)


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


def observer_lag(observer: ObserverDesign) -> float:
    """Part of a change of friction that the observer states a sample later.

    Parameters
    ----------
    observer : ObserverDesign
        The switched observer.

    Returns
    -------
    float
        That of a first-order lag, quicker than the mean delay while sliding: the
        observer starts from what was learned.
    """
    A, B, E = observer.mode_matrices(1)
    # Errors of x and v, and the integral, under a unit of unmodelled friction.
    F = np.block([[A, -E[:, None]], [np.zeros((1, 2)), np.eye(1)]])
    F[:, 0] += observer.gains[1] * [-1.0, -1.0, 1.0]
    push = np.array([*B, 0.0])
    state, late = np.zeros(3), 0.0
    for _ in range(100_000):
        left = 1.0 + state[2]  # w goes to -1
        late += left
        if abs(left) < 1e-9:
            break
        state = F @ state - push
    return min(_QUICKER / max(late, 1.0), 1.0)


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


def _tuning(law: str, axis: FrictionAxis) -> _Tuning:
    """Numbers of the sliding loop, by law and axis."""
    if law not in ("learned", "fixed"):
        return _BASELINE
    tuning = _ELASTIC if presliding_distance(axis) > 0.0 else _RIGID
    return tuning if law == "learned" else tuning._replace(residual=0.0)


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
        Bandwidth of the sliding loop [rad/s].  Default: what delay, sampling
        time and encoder allow.
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
    acting, tuning = rigid(axis), _tuning(law, axis)
    numbers = acting.arrays(dt).numbers
    whole_delay = delay + float(numbers[kernel.axis_step.DELAY] + numbers[kernel.axis_step.LAG])
    if bandwidth is None:
        bandwidth = min(tuning.phase / (whole_delay + _SAMPLED * dt), _FASTEST / dt)
        if quantum > 0.0 and largest_level(acting) > 0.0:
            kick = _KICK * largest_level(acting) * dt / quantum + acting.viscous
            bandwidth = min(bandwidth, kick / (tuning.damping * acting.mass))
    w = positive("bandwidth", bandwidth, unit="rad/s")
    if w * dt > 0.5:
        raise ValueError(
            f"bandwidth {w:g} rad/s is too high for dt = {dt:g} s: keep bandwidth * dt below 0.5"
        )
    if gains is None:
        kp = acting.mass * w**2
        kd = max(tuning.damping * acting.mass * w - acting.viscous, 0.0)
        ki = 0.0 if law == "adrc" else _INTEGRAL * w * kp
    else:
        kp, ki, kd = _three(gains)
    reach = largest_level(acting) / kp
    observer = None
    if law in ("learned", "fixed"):
        watched = _watchable(axis)
        # The law learns from estimates before the reading, which they are judged by.
        observer = design_pi_observer(
            watched, dt, form="prediction", noise=_calm_noise(watched, dt, quantum)
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
        filter_time=_FILTER * dt,
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
    return certified(made)


def certified(fields: dict[str, Any]) -> Compensation:
    """Compensation of these fields, its certificate computed from them.

    Parameters
    ----------
    fields : dict
        Every field but the certificate.

    Returns
    -------
    Compensation

    Raises
    ------
    ValueError
        If the loop is unstable for the nominal axis.
    """
    comp = Compensation(**fields, certificate=None)  # type: ignore[arg-type]
    certificate = comp.certify()
    if certificate.nominal.radius >= 1.0:
        raise ValueError(
            f"the loop is unstable on the nominal axis (spectral radius "
            f"{certificate.nominal.radius:.4f}): lower bandwidth or gains, or the delay"
        )
    return replace(comp, certificate=certificate)


def _calm_noise(axis: FrictionAxis, dt: float, quantum: float) -> float:
    """Reading noise [m] for which the observer is as calm as the law was tuned with.

    Rounding of the encoder, as far as the observer's natural frequency stays within
    limits; `benchmarks/compensation.py` sets them.
    """
    step = dt**2 * UNCERTAIN_FRACTION * coulomb_level(axis) / axis.mass
    frequency = _CALM
    if quantum:
        slow, fast = _CALM_RANGE
        frequency = min(max(math.sqrt(step * math.sqrt(12.0) / quantum), slow), fast)
    return step / frequency**2


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
