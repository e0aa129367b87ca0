"""What a compensated loop guarantees: a tracking tube, and rest without hunting."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import minimum_filter1d
from scipy.signal import oaconvolve

from dryfric_control.compiled import compensation as kernel
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.model.profiles import MotionProfile
from dryfric_control.observer.design import ObserverDesign
from dryfric_control.text import Result, length_text

Array = NDArray[np.float64]

#: State of the linear loop that is the drive of the sample before.
DRIVE = 12
#: A response is followed until it has fallen to this part.
_FADED = 1e-7
_LONGEST = 200_000
#: Largest delay margin that is searched for [samples].
_LATEST = 200
#: Places, times and times at rest at which the axis' own laws are read.
_PLACES, _TIMES = 401, (0.0, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0)
#: Tolerances by which an axis may rest beside the place that the drive is held for.
_BESIDE = 10.0


class Loop(NamedTuple):
    """What the certificate reads of a compensation."""

    numbers: Any  # of the compiled law
    axis: FrictionAxis  # one rigid mass
    observer: ObserverDesign | None
    drive_delay: float  # of the axis itself [s]
    input_delay: float  # beyond it, at most [s]
    encoder_quantum: float
    tolerance: float

    @property
    def dt(self) -> float:
        """Sampling time [s]."""
        return float(self.numbers[kernel.DT])


class LoopGains(NamedTuple):
    """Gains of one linear loop from force and reading to the tracking error."""

    radius: float  # spectral radius
    l1: float  # largest error for a force of 1 N whatever its course [m/N]
    above: float  # largest error of one sign for a step of 1 N [m/N]
    below: float  # and of the other
    impulse: float  # largest error for an impulse of 1 N s [m/(N s)]
    reading: float  # largest error for reading errors of 1 m [1]
    asked: float = 0.0  # largest error if a reference's m a and f v are missing [m]

    @property
    def turn(self) -> float:
        """Largest error for a force that goes from -1 N to 1 N once [m/N]."""
        return min(self.l1, 2.0 * max(self.above, self.below))

    @property
    def pulse(self) -> float:
        """Largest error for a force that rises to 1 N and falls once [m/N]."""
        return min(self.l1, self.above + self.below)


class Condition(NamedTuple):
    """One condition of rest without hunting, and whether it holds."""

    name: str
    holds: bool
    detail: str


@dataclass(frozen=True, eq=False, repr=False)
class TrackingCertificate(Result):
    """Tracking tube and conditions of rest of a compensated loop.

    Attributes
    ----------
    tube : float
        Bound of the tracking error [m]; infinite if the loop is unstable for an
        axis within the mismatch, or the drive may need more than its limit.  It holds
        for the `reference` of `Compensation.certify`; without one, for references so slow
        that inertia and viscous friction do not count, and a faster one has a wider tube.
    parts : dict of str to float
        Contributions to the tube [m].
    friction_left : float
        Largest force that the compensation leaves [N].
    nominal, worst : LoopGains
        Gains of the linear loop, nominal and at the worst axis within the mismatch.
    mismatch, learned : float
        The bounds it was computed for.
    conditions : tuple of Condition
        Conditions of rest without hunting.
    units : tuple of str
        Units of position and force.
    slow : bool
        Whether it holds for slow references only.
    delay_margin : float
        Delay of the drive beyond that of the nominal axis [s] below which the linear loop
        of that axis is stable; 200 samples if it is more than that.
    drive_needed : float
        Force that the drive may need: inertia, viscous friction, the largest Coulomb level,
        its peak while the reference is slow, force effects, and kp times the tube [N].
    limit : float
        Largest force of the drive [N].

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    >>> comp = dfc.design_compensation(axis, dt=1e-3)
    >>> comp.certificate.tube > comp.certify(mismatch=0.1).tube
    True
    >>> print(f"{1e3 * comp.certificate.delay_margin:.1f} ms")
    1.9 ms
    """

    tube: float
    parts: dict[str, float]
    friction_left: float
    nominal: LoopGains
    worst: LoopGains
    mismatch: float
    learned: float
    conditions: tuple[Condition, ...]
    units: tuple[str, str] = ("m", "N")
    slow: bool = False
    delay_margin: float = 0.0
    drive_needed: float = 0.0
    limit: float = math.inf

    @property
    def no_hunting(self) -> bool:
        """Whether every condition of rest without hunting holds."""
        return all(condition.holds for condition in self.conditions)

    def _shown(self) -> Iterator[str]:
        length, force = self.units
        yield (
            f"tube   {length_text(self.tube, length)} for {100 * self.mismatch:g} % of mismatch"
            f"{', slow references' * self.slow}: "
            + ", ".join(f"{name} {length_text(one, length)}" for name, one in self.parts.items())
        )
        yield (
            f"loop   L1 gain {self.nominal.l1:.4g} {length}/{force} nominal, {self.worst.l1:.4g} "
            f"at the worst axis; force left over at most {self.friction_left:.4g} {force}"
        )
        yield (
            f"delay  the nominal loop is stable for a drive delay of less than "
            f"{1e3 * self.delay_margin:.3g} ms beyond that of the axis"
        )
        if math.isfinite(self.limit):
            enough = self.drive_needed <= self.limit
            yield (
                f"drive  up to {self.drive_needed:.4g} {force} may be needed, the limit is "
                f"{self.limit:g} {force}" + ("" if enough else ": TOO LOW, no error is certified")
            )
        for name, holds, detail in self.conditions:
            yield f"rest   {'holds' if holds else 'FAILS'}: {name} ({detail})"


def loop_matrices(loop: Loop, mass: float, viscous: float, delay: float) -> tuple[Array, Array]:
    """Linear loop while the axis slides, reference at zero.

    Parameters
    ----------
    loop : Loop
        The controller.
    mass, viscous : float
        Those of the axis [kg], [N s/m].
    delay : float
        Delay of the drive [s].

    Returns
    -------
    A : ndarray, shape (n, n)
        State matrix; the first two states are position and velocity.
    B : ndarray, shape (n, 2)
        Columns of a force on the mass, held over a sample [N], and of an error of
        the reading [m].

    Notes
    -----
    One sample written out as the compiled law and the observer run it, read off
    column by column; the axis is sampled exactly.
    """
    c = loop.numbers
    dt = loop.dt
    longest = math.ceil(delay / dt) + 1
    rate = viscous / mass
    fall = math.exp(-rate * dt)
    moved = -math.expm1(-rate * dt) / rate if rate * dt > 1e-9 else dt
    pushed = (dt - moved) / (rate * mass) if rate * dt > 1e-6 else 0.5 * dt**2 / mass
    observer = loop.observer
    if observer is not None:
        A, B, E = observer.mode_matrices(1)
        # Of the estimate before a reading, in either form.
        gain = [1.0, 0.0, 0.0] - observer.error_dynamics(1).A[:, 0]
    # x, v, integral, filtered speed, last reading, observer (3), baseline (6), past drives
    first = 14

    def seen(drives: Array, late: float) -> float:
        whole = int(late / dt + 1e-9)
        part = late / dt - whole
        return float((1.0 - part) * drives[whole] + part * drives[whole + 1])

    def step(state: Array, force: float, noise: float) -> Array:
        after = np.zeros(state.size)
        y = state[0] + noise
        after[3] = c[kernel.KEEP] * state[3] + (1.0 - c[kernel.KEEP]) * (y - state[4]) / dt
        after[4] = y
        speed, u = after[3], -c[kernel.KP] * y + state[2]
        if c[kernel.KI] > 0.0:
            after[2] = state[2] - c[kernel.KI] * dt * y
        if observer is not None:
            speed += c[kernel.SPEED_SHARE] * (state[6] - speed)
            u -= c[kernel.RESIDUAL] * state[7]
        elif c[kernel.SOURCE] != kernel.NOTHING:
            memory = np.zeros(kernel.LINE)
            memory[kernel.INNER : kernel.INNER + 6] = state[8:14]
            memory[kernel.SPEED] = speed
            estimate, speed = kernel.disturbance(c, memory, y)
            u += c[kernel.RESIDUAL] * estimate
            used = 4 if c[kernel.SOURCE] == kernel.DISTURBANCE else 3
            after[8 : 8 + used] = memory[kernel.INNER : kernel.INNER + used]
        u -= c[kernel.KD] * speed
        after[DRIVE] = u
        drives = np.concatenate([[u], state[first:], [0.0]])
        after[first:] = drives[: state.size - first]
        if observer is not None:
            error = y - state[5]
            after[5:7] = A @ state[5:7] + B * u + E * state[7] + gain[:2] * error
            after[7] = state[7] + gain[2] * error
        total = seen(drives, delay) + force
        after[0] = state[0] + moved * state[1] + pushed * total
        after[1] = fall * state[1] + moved / mass * total
        return after

    n = first + longest + 1
    zero = np.zeros(n)
    matrix = np.column_stack([step(column, 0.0, 0.0) for column in np.eye(n)])
    return matrix, np.column_stack([step(zero, 1.0, 0.0), step(zero, 0.0, 1.0)])


def loop_gains(
    loop: Loop, mass: float, viscous: float, delay: float, courses: Array | None = None
) -> LoopGains:
    """Gains of the linear loop of one axis.

    Parameters
    ----------
    loop : Loop
        The controller.
    mass, viscous : float
        Those of the axis [kg], [N s/m].
    delay : float
        Delay of the drive [s].
    courses : ndarray, shape (2, n), optional
        Inertia and viscous friction along a reference [N].

    Returns
    -------
    LoopGains
        All infinite if the loop is unstable.
    """
    A, B = loop_matrices(loop, mass, viscous, delay)
    radius = float(np.abs(np.linalg.eigvals(A)).max())
    if radius >= 1.0:
        return LoopGains(radius, *(math.inf,) * 6)
    n = min(int(math.log(_FADED) / math.log(radius)) + 2, _LONGEST) if radius > 0.0 else 50
    # Position of one sample after the other, a block of samples at a time.
    block = math.isqrt(n) + 1
    rows, power = np.empty((block, A.shape[0])), np.eye(A.shape[0])
    for k in range(block):
        rows[k], power = power[0], A @ power
    blocks, state = np.empty((block, block, 2)), B
    for k in range(block):
        blocks[k], state = rows @ state, power @ state
    response = blocks.reshape(-1, 2)
    l1, reading = np.abs(response).sum(axis=0)
    force = response[:, 0]
    stepped = np.cumsum(force)
    asked = np.zeros((2, 1)) if courses is None else oaconvolve(courses, force[None], axes=1)
    return LoopGains(
        radius,
        float(l1),
        float(max(stepped.max(), 0.0)),
        float(max(-stepped.min(), 0.0)),
        float(np.abs(force).max()) / loop.dt,
        float(reading),
        float(np.abs(asked).sum(axis=0).max()),
    )


def delay_margin(loop: Loop) -> float:
    """Delay beyond that of the nominal axis below which its linear loop is stable.

    Parameters
    ----------
    loop : Loop
        The controller.

    Returns
    -------
    float
        Delay margin [s]: 0 if the loop is unstable as it is, at most 200 samples.
    """
    axis, most = loop.axis, _LATEST * loop.dt

    def stable(delay: float) -> bool:
        A, _ = loop_matrices(loop, axis.mass, axis.viscous, loop.drive_delay + delay)
        return bool(np.abs(np.linalg.eigvals(A)).max() < 1.0)

    if not stable(0.0):
        return 0.0
    below, above = 0.0, loop.dt
    while stable(above):
        if above >= most:
            return most
        below, above = above, min(2.0 * above, most)
    # A loop may be stable again at longer delays: the shortest unstable one counts.
    for delay in np.linspace(0.0, above, 17)[1:-1]:
        if not stable(delay):
            above = float(delay)
            break
        below = float(delay)
    while above - below > 1e-3 * above:
        middle = 0.5 * (below + above)
        below, above = (middle, above) if stable(middle) else (below, middle)
    return below


def certify_tracking(
    loop: Loop,
    mismatch: float,
    learned: float,
    excess: float,
    reference: MotionProfile | None = None,
    nominal_error: float = 0.0,
) -> TrackingCertificate:
    """Compute the tracking tube and check the conditions of rest.

    Parameters
    ----------
    loop : Loop
        The controller.
    mismatch : float
        Part by which every parameter may be off.
    learned : float
        Part of the mismatch of the levels that has been learned.
    excess : float
        Largest Stribeck excess of the axis.
    reference : MotionProfile, optional
        Default: one so slow that inertia and viscous friction do not count.
    nominal_error : float, optional
        Largest error along the reference with nothing off but the delay [m].

    Notes
    -----
    The force left over is at most ::

        F = (1 - l) mu L + S + mu (m abs(a) + f abs(v))

    with L the largest level, mu the mismatch, l what was learned, and S the whole
    Stribeck peak of an axis within the mismatch: axis and reference may be at
    different speeds.  A law that feeds no level or peak forward leaves all of it.
    With g the response of the position to that force, in the worst of the linear
    loops within the mismatch (corners of mass, viscous coefficient and delay), ::

        abs(e) <= L1(g) F

    whatever the force does.  At a reversal it does less: with h the step response,
    a level error that changes sign once gives at most 2 max abs(h) times its size,
    a peak that rises and falls once at most max h - min h.  The
    smaller bound of each part is taken: the certificate holds for reversals
    further apart than the memory of the loop.  The forces m a and f v of a reference
    are known sample by sample: what lacks of them is mu g * (m a) and mu g * (f v),
    whose signs are taken as they add.  The error of the nominal axis itself, whose
    feedforward is early and whose speed is filtered, is simulated along the reference and
    added.  Force effects that depend on place enter by their slope, as a small gain, and
    otherwise count as known; a feedforward that is early by the whole delay pushes with
    m a at a reversal; the encoder is off by half an increment.
    """
    axis, mu = loop.axis, mismatch
    c = loop.numbers
    courses, motion, turning = None, 0.0, 0.0
    if reference is not None:
        v, a = reference.velocity, np.abs(reference.acceleration)
        courses = np.array([axis.mass * reference.acceleration, axis.viscous * v])
        motion = float(np.abs(courses).sum(axis=0).max())
        turns = np.flatnonzero(v[1:] * v[:-1] <= 0.0)
        turning = float(np.maximum(a[turns], a[turns + 1]).max(initial=0.0))
    corners = [
        loop_gains(loop, axis.mass * m, axis.viscous * f, loop.drive_delay + d, courses)
        for m, f, d in itertools.product(
            sorted({1.0 - mu, 1.0, 1.0 + mu}),
            sorted({1.0 - mu, 1.0 + mu}),
            sorted({0.0, 0.5 * loop.input_delay, loop.input_delay}),
        )
    ]
    nominal = loop_gains(loop, axis.mass, axis.viscous, loop.drive_delay)
    laws = _laws(axis, loop.dt, reference, _BESIDE * loop.tolerance,
                 loop.numbers[kernel.HOLD_SHARE] / (1.0 - mu))  # fmt: skip
    level = laws.level
    left = {
        "levels": (1.0 - learned) * (1.0 + mu - c[kernel.COULOMB]) * level,
        "Stribeck peak": (1.0 + mu) * excess * level,
        "inertia": mu * motion,
    }  # fmt: skip
    late = loop.input_delay + loop.dt

    def tube_parts(corner: LoopGains) -> dict[str, float]:
        made = {name: (corner.pulse, force) for name, force in left.items()}
        made["levels"] = corner.turn, left["levels"]
        made["inertia"], made["nominal axis"] = (corner.asked, mu), (1.0, nominal_error)
        made["reversal"] = corner.impulse, axis.mass * (1.0 + mu) * turning * late
        made["encoder"] = corner.reading, 0.5 * loop.encoder_quantum
        shrink = 1.0 - corner.l1 * laws.slope if laws.slope else 1.0
        return {
            name: gain * size / shrink if shrink > 0.0 else math.inf
            for name, (gain, size) in made.items()
            if size > 0.0 and gain > 0.0
        }

    parts = max((tube_parts(corner) for corner in corners), key=lambda made: sum(made.values()))
    tube = sum(parts.values())
    needed = laws.forces + c[kernel.KP] * tube
    friction, fast = np.full(1, (1.0 + mu) * level * (1.0 + (1.0 + mu) * excess)), np.zeros(1)
    if reference is not None and courses is not None:
        fast = (1.0 + mu) * np.abs(courses).sum(axis=0)
        # Three Stribeck velocities on, nothing of the peak is left.
        slow = np.abs(reference.velocity) <= 3.0 * (1.0 + mu) * c[kernel.STRIBECK_SPEED]
        friction = (1.0 + mu) * level * (1.0 + (1.0 + mu) * excess * slow)
    needed = float(needed + np.max(friction + fast))
    if needed > c[kernel.LIMIT]:
        parts, tube = parts | {"drive limit": math.inf}, math.inf
    # Each figure at its own worst corner.
    worst = LoopGains(*(max(values) for values in zip(*corners, strict=True)))
    return TrackingCertificate(
        float(tube), parts, float(sum(left.values())), nominal, worst, mu, learned,
        _conditions(loop, laws, worst, mu), axis.units, reference is None, delay_margin(loop),
        needed, float(c[kernel.LIMIT]),
    )  # fmt: skip


class _Laws(NamedTuple):
    """Levels and force effects of an axis, over its travel or along a reference."""

    level: float  # largest Coulomb level [N]
    held: float  # lesser level of both directions, where it changes most within the reach [N]
    kept: float  # smallest level within the reach of that place [N]
    slope: float  # largest slope of the force effects over place [N/m]
    forces: float  # largest of the force effects [N]
    wander: float  # largest change of force and level with time at rest [N]
    guessed: tuple[float, float] | None  # range, if none is known and the level depends on place


def _laws(
    axis: FrictionAxis, dt: float, reference: MotionProfile | None, reach: float, share: float
) -> _Laws:
    """Read levels and force effects of an axis over place and over time.

    Levels are compared within a `reach` [m], where the held drive is a `share` of them.

    Places are those of the travel.  Without one they are those of the reference and a tenth of
    its way on either side.
    """
    arrays = axis.arrays(dt)
    low, high = axis.travel or (-1.0, 1.0)
    known = axis.travel is not None
    if reference is not None and not known and np.ptp(reference.position) > 0.0:
        beside = 0.1 * float(np.ptp(reference.position))
        low = float(reference.position.min()) - beside
        high = float(reference.position.max()) + beside
        known = True
    places = np.linspace(low, high, _PLACES)
    near = 1e-6 * (high - low)

    def read(t: float, x: float) -> tuple[float, float, float]:
        return kernel.read_laws(arrays.numbers, arrays.integers, t, x)

    table = np.array([[read(t, x) for x in places] for t in _TIMES])
    slopes = [abs(read(0.0, x + near)[0] - read(0.0, x)[0]) / near for x in places]
    lesser = table[..., 1:].min(axis=2)
    near_by = 2 * math.ceil(reach * (_PLACES - 1) / (high - low)) + 1
    held, kept = lesser.max(axis=0), minimum_filter1d(lesser.min(axis=0), near_by)
    worst = int(np.argmin(kept - share * held))
    return _Laws(
        float(table[..., 1:].max()),
        float(held[worst]),
        float(kept[worst]),
        float(max(slopes)),
        float(np.abs(table[..., 0]).max()),
        float(np.ptp(table, axis=0).max()),
        None if known or np.ptp(table[..., 1:], axis=1).max() == 0.0 else (low, high),
    )


def _conditions(loop: Loop, laws: _Laws, worst: LoopGains, mu: float) -> tuple[Condition, ...]:
    """Conditions under which an axis at rest stays at rest for ever."""
    length, force = loop.axis.units
    c = loop.numbers
    holds = c[kernel.HOLDS] != 0.0
    held = c[kernel.HOLD_SHARE] * laws.held if holds else math.inf
    least = (1.0 - mu) * laws.kept
    reach = length_text(_BESIDE * loop.tolerance, length)
    places = ""
    if laws.guessed:
        low, high = laws.guessed
        places = (
            f"; levels depend on the position and are read from {low:g} to {high:g} {length}, as "
            "the axis has no travel: give it, axis.replace(travel=(low, high))"
        )
    return (
        Condition(
            "the linear loop is stable for every axis within the mismatch",
            worst.radius < 1.0,
            f"spectral radius at most {worst.radius:.5f}"
            + ("" if worst.radius < 1.0 else ": lower bandwidth or mismatch"),
        ),
        Condition(
            "the drive is constant at rest after finitely many corrections",
            bool(holds and c[kernel.GROWTH] > 1.0),
            f"each one widens the tolerance {length_text(loop.tolerance, length)} "
            f"by {c[kernel.GROWTH]:g}"
            if holds
            else 'the integral goes on at rest: law="learned" and "fixed" hold it',
        ),
        Condition(
            "the held drive stays below the least Coulomb level",
            held <= least,
            f"{held:.3g} of {least:.3g} {force}"
            + (
                ""
                if held <= least or not holds
                else f": the level changes too much over {reach}, or the design was made for a "
                f"lower mismatch{places}"
            ),
        ),
        Condition(
            "other forces and levels do not change with time by more than is left",
            bool(laws.wander <= max(least - held, 0.0)),
            f"they change by {laws.wander:.3g} of {max(least - held, 0.0):.3g} {force}"
            + (
                ""
                if laws.wander <= max(least - held, 0.0)
                else ": rest is not certain, however the loop is designed"
            ),
        ),
        Condition(
            "the encoder's last digit does not end the hold",
            bool(2.5 * loop.tolerance >= loop.encoder_quantum),
            f"released at {length_text(2.5 * loop.tolerance, length)}",
        ),
    )
