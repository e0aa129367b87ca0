"""Friction compensation: the design and what it carries."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import control as ct
import numpy as np

from dryfric_control.arrays import Floats
from dryfric_control.checks import (
    finite,
    increment,
    instance,
    one_of,
    positive,
    whole,
)
from dryfric_control.compensation import certificate as proof
from dryfric_control.compensation import tuning as tuned
from dryfric_control.compensation.certificate import TrackingCertificate
from dryfric_control.compensation.laws import largest_drive, unbounded_effects
from dryfric_control.compensation.runtime import CompensatedController, CompensationStepper
from dryfric_control.compiled import compensation as kernel
from dryfric_control.drawing import (
    legend_above,
    over_time,
    panels,
    shade_stuck,
)
from dryfric_control.model.axis import FrictionAxis, check_pace
from dryfric_control.model.loops import LoopRun, simulate_loop
from dryfric_control.model.profiles import MotionProfile, motion_profile
from dryfric_control.observer.certificate import CertificateError
from dryfric_control.observer.design import (
    ObserverDesign,
    design_pi_observer,
    verified_design,
)
from dryfric_control.order import check_quantum_and_dt
from dryfric_control.store.saved import Saved
from dryfric_control.text import (
    Result,
    documented,
    length_text,
    page_reference,
    prefix_unit,
    stated,
    typeset_signs,
)


@dataclass(frozen=True, eq=False)
class Promise:
    """Contents of a file: a design, and what a reader must come to by computing it anew."""

    design: Compensation
    #: Those of its law, which may change with the package.
    numbers: Floats
    tube: float


@documented
@dataclass(frozen=True, eq=False, repr=False)
class Compensation(Saved, Result):
    """A friction-compensating position controller, certified.

    Made by `design_compensation`; it runs as the observers do: by `block`, by `stepper`, over a
    whole motion (`run`, which `simulate_loop` calls), as C and FMU, and it is kept by `save`.

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    >>> comp = dfc.design_compensation(axis, dt=1e-3, encoder_quantum=1e-6)
    >>> comp.lead, comp.certificate.no_hunting
    (1, True)
    """

    axis: FrictionAxis = stated("The axis that is compensated.")
    dt: float = stated("Sampling time [s].")
    law: str = stated("learned, or a baseline.")
    encoder_quantum: float = stated("Encoder increment [m].")
    input_delay: float = stated("Largest delay of the drive, beyond the axis' own effects [s].")
    bandwidth: float = stated("Bandwidth of the sliding loop [rad/s].")
    kp: float = stated("Position gain [N/m].")
    ki: float = stated("Integral gain [N/(m s)].")
    kd: float = stated("Velocity gain [N s/m].")
    filter_time: float = stated("Time constant of the low-pass on the velocity [s].")
    lead: int = stated("Samples by which the feedforward looks ahead.")
    limit: float = stated("Largest drive force [N].")
    tolerance: float = stated("Position error at which the drive is held at rest [m].")
    learning: float = stated("Rate at which levels and excess are learned [1/s].")
    disturbance_bandwidth: float = stated("Of the velocity, or of a baseline [rad/s].")
    mismatch: float = stated("Relative error of every parameter, for the certificate.")
    correction: float = stated("Largest change of the nominal friction, over the Coulomb level.")
    observer: ObserverDesign | None = stated("The switched observer, where the law has one.")
    certificate: TrackingCertificate = stated("Tracking tube and conditions of rest.")
    _kind = "friction compensation"
    _holds = (Promise, ObserverDesign, *ObserverDesign._holds)
    _broken = CertificateError

    @functools.cached_property
    def rigid_axis(self) -> FrictionAxis:
        """The axis whose effects the feedforward evaluates: one rigid mass."""
        return tuned.rigid_axis(self.axis)

    @functools.cached_property
    def controller(self) -> CompensatedController:
        """The controller, for `simulate_loop` and for a loop of one's own."""
        return CompensatedController(self.dt, self.lead, self._law())

    def block(self, name: str = "controller") -> ct.NonlinearIOSystem:
        """The controller as a block, see `CompensatedController.block`.

        Parameters
        ----------
        name : str, optional
        """
        return self.controller.block(name)

    def run(self, loop: LoopRun) -> tuple[Floats, int]:
        """Run a closed loop, as `simulate_loop` does.

        Parameters
        ----------
        loop : LoopRun
        """
        return self.controller.run(loop)

    def stepper(self) -> CompensationStepper:
        """The controller sample by sample, for a loop of your own."""
        return self.controller.stepper()

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
            Relative error of every parameter.  Default: the design's.
        learned : float, optional
            Fraction of the mismatch of the levels that has been learned, 0 to 1.
        excess : float, optional
            Largest Stribeck excess of the axis.  Default: the nominal one and the mismatch.
        reference : MotionProfile, optional
            Reference, whose inertia and viscous friction widen the tube; on an axis without
            `travel` levels and force effects are read along it.  Default: a slow one.
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
        if reference is not None:
            instance(
                "reference",
                reference,
                MotionProfile,
                "made by dfc.motion_profile",
            )
        return proof.certify_tracking(self, mu, known, peak, reference)

    def _to_saved(self) -> Promise:
        observer = self.observer and self.observer._to_saved()
        bare = replace(self, certificate=None, observer=observer)  # type: ignore[arg-type]
        return Promise(bare, self.numbers, self.certificate.tube)

    @classmethod
    def _from_saved(cls, held: Promise) -> Compensation:
        return _design_of_file(held)

    def _summary_parts(self) -> Iterator[str]:
        length, force = self.axis.units
        yield (
            f"Friction compensation of {self.axis.name}, law {self.law!r}, dt = {self.dt:g} s, "
            f"encoder {length_text(self.encoder_quantum, length)}"
        )
        yield (
            f"loop   {self.bandwidth:.4g} rad/s: kp = {self.kp:.6g} {force}/{length}, "
            f"ki = {self.ki:.6g} {force}/({length} s), kd = {self.kd:.6g} {force} s/{length}"
        )
        yield (
            f"ahead  {self.lead} samples, designed for a drive delay of up to "
            f"{1e3 * self.whole_delay:.3g} ms"
        )
        if self.encoder_quantum > 0.0:
            level = tuned.largest_level(self.rigid_axis)
            step = self.drive_step
            share = f", {100.0 * step / level:.3g} % of the Coulomb level" if level > 0.0 else ""
            yield f"noise  one encoder increment steps the drive by {step:.3g} {force}{share}"
            free = self._without_filter()
            tube = math.inf if free is None else free.certify().tube
            if free is not None and tube < self.certificate.tube:
                yield (
                    "       the low-pass that keeps it so has its price: without it the tube would "
                    f"be {length_text(tube, length)}, and the step "
                    f"{free.drive_step:.3g} {force}"
                )
        effects = ", ".join(effect.slug for effect in self.rigid_axis.effects) or "none"
        yield f"other effects fed forward: {effects}"
        yield from self.certificate._summary_parts()

    def _without_filter(self) -> Compensation | None:
        """The design without a bound on the noise in the drive, if that makes a difference."""
        least = tuned.LEAST_FILTER_TIME * self.dt
        if self.filter_time <= least:
            return None
        delay = self.whole_delay
        slow, quick = (
            min(
                tuned.largest_bandwidth(self.tuning, self.dt, delay, filtered),
                tuned.LARGEST_BANDWIDTH / self.dt,
            )
            for filtered in (self.filter_time, least)
        )
        w = quick if math.isclose(self.bandwidth, slow) else self.bandwidth
        kp, kd = tuned.position_gains(self.rigid_axis, self.tuning, w)
        return replace(
            self,
            bandwidth=w,
            kp=kp,
            kd=kd,
            ki=self.ki * (kp * w) / (self.kp * self.bandwidth),
            filter_time=least,
            disturbance_bandwidth=tuned.estimate_bandwidth(w, self.dt, delay, least),
        )

    @panels(3)
    def plot(self, axes: Any) -> str:
        """Draw a simulated move there and back, with its tube."""
        length, force = self.axis.units
        reference = self._there_and_back()
        run = simulate_loop(
            self.axis,
            self.controller,
            reference,
            quantum=self.encoder_quantum,
        )
        error = reference.position - run.y[0]
        bound = self.certify(reference=reference).tube
        axes[0].plot(run.t, reference.position, color="0.55", label="reference")
        axes[0].plot(run.t, run.y[0], "k", linewidth=1.0, label="axis")
        factor, short = prefix_unit(bound if math.isfinite(bound) else np.abs(error).max(), length)
        axes[1].plot(run.t, error / factor, "k", linewidth=1.0, label="error")
        if math.isfinite(bound):
            for side, label in (
                (-bound / factor, None),
                (bound / factor, "tube"),
            ):
                axes[1].axhline(
                    side,
                    color="C3",
                    linestyle="--",
                    linewidth=1.0,
                    label=label,
                )
        axes[2].plot(run.t, run.y[4], "k", linewidth=1.0, label="drive u")
        axes[2].plot(run.t, run.y[2], "C0--", linewidth=1.0, label="friction")
        labels = (
            f"position [{length}]",
            typeset_signs(f"error [{short}]"),
            f"force [{force}]",
        )
        for one in axes:
            shade_stuck(one, run.t, run.y[3])
            legend_above(one)
        over_time(axes, labels)
        return f"{self.axis.name}: compensation"

    def _there_and_back(self) -> MotionProfile:
        """Move of about a second, on the scale that the controller's bandwidth gives."""
        axis = self.rigid_axis
        w = self.bandwidth
        # A tenth of the acceleration that friction could cause, over a third of a second.
        push = max(
            float(np.max(axis.breakaway(0.0, 1))),
            axis.mass * self.tolerance * w**2,
        )
        a = 0.1 * push / axis.mass
        way = 0.02 * a if axis.travel is None else min(0.02 * a, 0.4 * float(np.ptp(axis.travel)))
        middle = 0.0 if axis.travel is None else float(np.mean(axis.travel)) - 0.5 * way
        return motion_profile(
            [middle, middle + way, middle, middle + way],
            self.dt,
            velocity=0.3 * a,
            acceleration=a,
            jerk=20.0 * a,
            dwell=[0.1, 0.0, 0.0, 0.4],
            unit=axis.units[0],
        )

    @property
    def left_out(self) -> tuple[str, ...]:
        """Effects that the certificate does not cover."""
        return unbounded_effects(self.axis)

    @property
    def known(self) -> tuple[str, ...]:
        """Effects that the certificate takes as they are."""
        laws = ("force", "input", "friction")
        return tuple(e.slug for e in self.rigid_axis.effects if e.action in laws)

    @functools.cached_property
    def largest_force(self) -> float:
        """Largest force of the drive: its limit, or what the axis' own effects let through [N]."""
        return min(self.limit, largest_drive(self.rigid_axis))

    @property
    def drive_step(self) -> float:
        """Step of the drive for one encoder increment [N], while the axis slides."""
        # Of the force that the drive is to make, before gain and dead zone are inverted.
        axis = self.rigid_axis
        _, B = proof.loop_matrices(self, axis.mass, axis.viscous, 0.0)
        return self.encoder_quantum * abs(float(B[proof.DRIVE, 1]))

    def _law(self) -> kernel.Law:
        numbers = np.zeros(kernel.LENGTH)
        values = (
            self._loop_values
            | self._feedforward_values
            | self._estimator_values
            | self._rest_values
        )
        for place, value in values.items():
            numbers[place] = value
        axis = self.rigid_axis
        own = axis.arrays(self.dt)
        watched = tuned.observer_arrays(self.observer or axis, self.encoder_quantum, self.dt)
        return kernel.Law(numbers, own.numbers, own.integers, *watched)

    @property
    def _loop_values(self) -> dict[int, float]:
        """Numbers of the sliding loop by their places."""
        keep = math.exp(-self.dt / self.filter_time) if self.filter_time > 0.0 else 0.0
        late = self.drive_delay + self.drive_lag + self.tuning.late * self.input_delay
        return {
            kernel.DT: self.dt,
            kernel.LEAD: self.lead,
            kernel.KP: self.kp,
            kernel.KI: self.ki,
            kernel.KD: self.kd,
            kernel.KEEP: keep,
            kernel.LIMIT: self.largest_force,
            kernel.LATE: round(late / self.dt),
        }

    @property
    def _feedforward_values(self) -> dict[int, float]:
        """Numbers of the feedforward and of what it learns by their places."""
        axis = self.rigid_axis
        excess = axis.stribeck.excess if axis.stribeck else 0.0
        rate = min(self.learning * self.dt, 0.5)
        return {
            kernel.MASS: axis.mass,
            kernel.VISCOUS: axis.viscous,
            kernel.COULOMB: tuned.LEVEL_SHARES.get(self.law, 0.0),
            kernel.PEAK: self.law in tuned.SWITCHED_LAWS,
            kernel.STICK_SPEED: axis.stick_speed,
            kernel.STRIBECK_SPEED: axis.stribeck.speed if axis.stribeck else 0.0,
            kernel.EXCESS: excess,
            kernel.MOST_EXCESS: max(tuned.MOST_EXCESS, 2.0 * excess),
            kernel.BAND: self.correction,
            kernel.RATE: rate if self.law == "learned" else 0.0,
            kernel.BUILD: tuned.presliding_distance(self.axis),
        }

    @property
    def _estimator_values(self) -> dict[int, float]:
        """Numbers of the estimate of velocity and friction by their places."""
        position_gain, velocity_gain, force_gain = tuned.extended_gains(
            self.rigid_axis, self.dt, self.disturbance_bandwidth
        )
        if self.law == "disturbance observer":
            position_gain = self.disturbance_bandwidth
        estimates = self.law in ("disturbance observer", "adrc")
        return {
            kernel.LAG: 1.0 if self.observer is None else tuned.observer_lag(self.observer),
            kernel.RESIDUAL: tuned.ESTIMATE_SHARE if estimates else self.tuning.residual,
            kernel.SPEED_SHARE: tuned.velocity_share(self.tuning, self.whole_delay / self.dt),
            kernel.SOURCE: tuned.SOURCES.get(self.law, kernel.NOTHING),
            kernel.MEAN: -math.expm1(-self.dt * self.bandwidth / 2.6),
            kernel.GAIN_X: position_gain,
            kernel.GAIN_V: velocity_gain,
            kernel.GAIN_F: force_gain,
        }

    @property
    def _rest_values(self) -> dict[int, float]:
        """Numbers of the hold at rest by their places."""
        axis = self.rigid_axis
        w = self.bandwidth
        most = self.correction * tuned.largest_level(axis)
        return {
            kernel.REST_SHARE: tuned.REST_SHARE,
            kernel.REST_SPEED: 0.1 * self.encoder_quantum or 1e-6 * axis.stick_speed,
            kernel.HOLDS: self.law in tuned.SWITCHED_LAWS,
            kernel.TOLERANCE: self.tolerance,
            kernel.GROWTH: tuned.TOLERANCE_GROWTH,
            kernel.HOLD_SHARE: tuned.HOLD_SHARE * (1.0 - self.mismatch),
            kernel.SETTLE: tuned.SETTLING_TIME / (w * self.dt) + self.lead + 2.0,
            # The error at rest with which the integral goes over its band in a settling time.
            kernel.SLOW: most * w / (tuned.SETTLING_TIME * self.ki) if self.ki > 0.0 else math.inf,
        }

    @property
    def numbers(self) -> Floats:
        """Numbers of the compiled law."""
        return np.asarray(self.controller.law.numbers)

    @property
    def whole_delay(self) -> float:
        """Delay and lag of the axis' drive, and the largest delay beyond them [s]."""
        return self.drive_delay + self.drive_lag + self.input_delay

    @property
    def drive_delay(self) -> float:
        """Delay of the drive that the axis itself has [s]."""
        return float(self.rigid_axis.arrays(self.dt).numbers[kernel.axis_step.DELAY])

    @property
    def drive_lag(self) -> float:
        """Lag of the drive that the axis itself has [s]."""
        return float(self.rigid_axis.arrays(self.dt).numbers[kernel.axis_step.LAG])

    @property
    def tuning(self) -> tuned.Tuning:
        """Numbers of the sliding loop, by law and axis."""
        return tuned.tuning_of(self.law)


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
    learning: float = tuned.LEARNING_RATE,
    disturbance_bandwidth: float | None = None,
    mismatch: float = 0.2,
    correction: float | None = None,
    noise: float = tuned.DRIVE_NOISE,
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
        Bandwidth of the sliding loop [rad/s].  Default: what delay, sampling time and encoder
        allow.
    law : str, optional
        "learned" (default): Coulomb and Stribeck feedforward, learned; "fixed": the same, not
        learned.  Baselines: "pid"; "sign", a PID with the nominal Coulomb level by the sign of
        the reference velocity; "disturbance observer"; "adrc".
    gains : (float, float, float), optional
        kp, ki and kd in place of those that follow from the bandwidth.
    limit : float, optional
        Largest drive force [N].  Default: none.
    tolerance : float, optional
        Position error at which the drive is held at rest [m].  Default: three increments, at
        least a hundredth of the way that friction moves kp.
    learning : float, optional
        Rate of learning [1/s].
    disturbance_bandwidth : float, optional
        Bandwidth of the estimate of velocity, or of a baseline's disturbance observer [rad/s].
    mismatch : float, optional
        Relative error of mass, viscous coefficient, Coulomb level, Stribeck excess and Stribeck
        velocity, each, for the certificate.
    correction : float, optional
        Largest change of the nominal friction by learning and the integral while the reference
        moves, in parts of the Coulomb level; a larger one widens the tube.  Default: what an axis
        within the mismatch needs.
    noise : float, optional
        Largest step of the drive for one increment, in parts of the Coulomb level: a low-pass on
        the velocity keeps it, which makes loop and tube worse.  Not with `gains`.

    Notes
    -----
    With the reference r looked ahead by the delay, s its direction, L the Coulomb level there, g
    the other force effects there ::

        u = kp e + ki integral(e) + kd e_v + m a_r + f v_r - g(r)
            + s (L + c_s + sigma L exp(-((abs(v_r) - Sigma)/vs)^2)) + q s l

    with c_s and sigma learned from the switched observer, and l what they leave; the guide to
    compensation says how it works.  Static input effects (gain, dead zone) are inverted.  Effects
    that need states of their own (backlash, compliance) are not compensated; an ObserverWarning
    names them.

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0,
    ...                         stribeck=dfc.Stribeck(excess=0.3, speed=0.01))
    >>> comp = dfc.design_compensation(axis, dt=1e-3, encoder_quantum=1e-6, input_delay=3e-3)
    >>> round(comp.bandwidth)
    158
    """
    instance("axis", axis, FrictionAxis)
    dt = positive("dt", dt, unit="s")
    quantum = increment(encoder_quantum, axis.unit("m"), zero=True)
    check_quantum_and_dt("encoder_quantum", quantum, dt)
    delay = positive("input_delay", input_delay, unit="s", zero=True)
    one_of("law", law, tuned.LAWS)
    mismatch = positive("mismatch", mismatch, zero=True)
    if mismatch >= 1.0:
        raise ValueError(f"mismatch must be below 1 (a part of each parameter), got {mismatch:g}")
    noise = positive("noise", noise)
    if correction is not None:
        correction = positive("correction", correction, zero=True)
    if bandwidth is not None:
        bandwidth = positive("bandwidth", bandwidth, unit="rad/s")
    check_pace(axis, dt)
    acting = tuned.rigid_axis(axis)
    tuning = tuned.tuning_of(law)
    numbers = acting.arrays(dt).numbers
    whole_delay = delay + float(numbers[kernel.axis_step.DELAY] + numbers[kernel.axis_step.LAG])
    level = tuned.largest_level(acting)
    filter_time = tuned.LEAST_FILTER_TIME * dt
    if gains is None:
        most_step = noise * level / quantum if quantum and level else math.inf
        filter_time = tuned.filter_time(acting, tuning, dt, whole_delay, bandwidth, most_step)
    highest = tuned.largest_bandwidth(tuning, dt, whole_delay, filter_time)
    w = bandwidth or min(highest, tuned.LARGEST_BANDWIDTH / dt)
    if w * dt > 0.5:
        raise ValueError(
            f"bandwidth {w:g} rad/s is too high for dt = {dt:g} s: keep bandwidth * dt below 0.5"
        )
    kp, ki, kd = _usual_gains(law, acting, w) if gains is None else _pid_gains(gains)
    excess = acting.stribeck.excess if acting.stribeck else 0.0
    most = _drive_limit(axis, limit, breakaway=level * (1.0 + excess))
    observer = None
    if law in tuned.SWITCHED_LAWS:
        # A loop that is slower than the delay allows leaves room for a faster observer.
        room = max(highest / w, 1.0)
        observer = _observer_of(axis, dt, quantum, whole_delay, room)
    if tolerance is None:
        tolerance = max(3.0 * quantum, 0.01 * (level / kp), 1e-9 * acting.stick_speed)
    if disturbance_bandwidth is None:
        disturbance_bandwidth = tuned.estimate_bandwidth(w, dt, whole_delay, filter_time)
    made = Compensation(
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
        limit=most,
        tolerance=positive("tolerance", tolerance, unit=axis.unit("m")),
        learning=positive("learning", learning, zero=True),
        disturbance_bandwidth=positive(
            "disturbance_bandwidth", disturbance_bandwidth, unit="rad/s"
        ),
        mismatch=mismatch,
        correction=mismatch * (1.0 + excess) if correction is None else correction,
        observer=observer,
        certificate=None,  # type: ignore[arg-type]
    )
    return with_certificate(made)


_MAY_BE_ZERO = "encoder_quantum input_delay ki filter_time learning mismatch correction".split()
_POSITIVE = (
    "dt",
    "bandwidth",
    "kp",
    "tolerance",
    "disturbance_bandwidth",
    *_MAY_BE_ZERO,
)


def _usual_gains(law: str, axis: FrictionAxis, w: float) -> tuple[float, float, float]:
    """Gains kp, ki and kd of a law that follow from its bandwidth."""
    kp, kd = tuned.position_gains(axis, tuned.tuning_of(law), w)
    ki = 0.0 if law == "adrc" else tuned.INTEGRAL_GAIN * w * kp
    return kp, ki, kd


def _drive_limit(axis: FrictionAxis, limit: float | None, breakaway: float) -> float:
    """Largest drive force [N], above the breakaway friction force."""
    most = math.inf if limit is None else positive("limit", limit, unit=axis.unit("N"))
    if most <= breakaway:
        raise ValueError(
            f"limit = {most:g} {axis.units[1]} is no more than the breakaway friction force of "
            f"{breakaway:.4g} {axis.units[1]}: the axis would stay where it is; give the largest "
            "force of the drive" + page_reference("howto/compensate")
        )
    return most


def _observer_of(
    axis: FrictionAxis,
    dt: float,
    quantum: float,
    whole_delay: float,
    room: float,
) -> ObserverDesign:
    """The switched observer of a law; `room`: bandwidth that the delay allows, over the loop's."""
    nominal = tuned.observer_axis(axis)
    samples = whole_delay / dt + tuned.SAMPLING_DELAY
    noise = tuned.reading_noise(nominal, dt, quantum, tuned.OBSERVER_PHASE / samples * room)
    try:
        return design_pi_observer(nominal, dt, noise=noise)
    except ValueError as problem:
        raise ValueError(
            f"no observer can be designed for dt = {dt:g} s and a drive delay of "
            f"{whole_delay:g} s ({problem}): check dt and input_delay, which are in seconds"
            + page_reference("howto/compensate")
        ) from None


def with_certificate(comp: Compensation) -> Compensation:
    """A compensation with its certificate; ValueError if the nominal loop is unstable."""
    certificate = comp.certify()
    if certificate.nominal.radius >= 1.0:
        raise ValueError(
            f"the loop is unstable on the nominal axis (spectral radius "
            f"{certificate.nominal.radius:.4f}): lower bandwidth or gains, or the delay"
        )
    return replace(comp, certificate=certificate)


def _pid_gains(gains: Any) -> tuple[float, float, float]:
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


#: Under the name beside `design_compensation`.
load_compensation = Compensation.load


def _design_of_file(stated: Promise) -> Compensation:
    """The design of a file, every part in its range, which keeps what the file states."""
    comp = stated.design
    for name in _POSITIVE:
        positive(name, getattr(comp, name), zero=name in _MAY_BE_ZERO)
    finite("kd", comp.kd)
    whole("lead", comp.lead, least=0)
    one_of("law", comp.law, tuned.LAWS)
    if not comp.mismatch < 1.0:
        raise ValueError(f"mismatch must be below 1, got {comp.mismatch!r}")
    if comp.limit != np.inf:
        positive("limit", comp.limit)
    if (comp.observer is None) == (comp.law in tuned.SWITCHED_LAWS):
        raise ValueError(f"law {comp.law!r} and observer do not fit together")
    if comp.observer is not None:
        if comp.observer.dt != comp.dt:
            raise ValueError("dt differs from that of the observer")
        comp = replace(comp, observer=verified_design(comp.observer))
    comp = with_certificate(comp)
    if not np.array_equal(stated.numbers, comp.numbers):
        raise ValueError("numbers of its law are not those that this package gives the design")
    tube = comp.certificate.tube
    if not tube <= stated.tube * (1.0 + 1e-9):
        raise ValueError(f"its numbers give a tube of {tube:.6g}, not {stated.tube:.6g} as stated")
    return comp
