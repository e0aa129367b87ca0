"""What a compensated loop guarantees: a tracking tube, and rest without hunting."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.linalg import expm
from scipy.signal import lfilter, oaconvolve

from dryfric_control.arrays import Floats
from dryfric_control.compensation.laws import (
    ANYWHERE,
    Change,
    Laws,
    Reach,
    at_rest,
    laws_of,
    unbounded_effects,
)
from dryfric_control.compiled import compensation as kernel
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.model.profiles import MotionProfile
from dryfric_control.text import Result, documented, length_text, stated

if TYPE_CHECKING:
    from dryfric_control.compensation.design import Compensation

#: State of the linear loop that is the drive of the sample before.
DRIVE = 10
#: What friction that brakes slips at reversals adds to the stick-slip gain, as a part of it:
#: linear programs over the courses of friction in `tests/compensation/test_tube.py` find no more.
_TURN = 0.15
#: Lags of the drive after which nothing is left of a change.
_LAGS = 5
#: A response is followed until it has fallen to this part.
_FADED = 1e-6
_LONGEST = 200_000
#: Largest delay margin that is searched for [samples].
_LATEST = 200
#: Largest number of passes in which errors and the laws that they reach settle.
_REPEATS = 60
#: Part of a tube that is not finite as laws and error make each other grow.
_GROWS = "effects that grow with the error"
#: Bounds for which the laws are read, over those of the pass before.
_MARGIN = 1.02
#: Tolerances by which an axis may rest beside the place that the drive is held for.
_BESIDE = 10.0


class LoopGains(NamedTuple):
    """Gains of one linear loop from force and reading to the tracking error."""

    radius: float  # spectral radius
    l1: float  # largest error for a force of 1 N whatever its course [m/N]
    speed: float  # largest velocity of the error for it [m/(N s)]
    drive: float  # largest drive for it [1]
    reading: float  # largest error for reading errors of 1 m [1]
    reading_speed: float  # largest velocity of the error for them [1/s]
    reading_drive: float  # largest drive for them [N/m]


class LawSlopes(NamedTuple):
    """Largest slopes of force effects and friction level over their arguments."""

    place: float  # [N/m]
    speed: float  # [N s/m]
    load: float  # [1]

    def loop_gain(self, gains: LoopGains) -> float:
        """Gain of the loop through the laws: below 1 they cannot make a stable loop unstable."""
        rows = ((self.place, gains.l1), (self.speed, gains.speed), (self.load, gains.drive))
        return sum(slope * gain for slope, gain in rows if slope > 0.0)


class Condition(NamedTuple):
    """One condition of rest without hunting, and whether it holds."""

    name: str
    holds: bool
    detail: str


@documented
@dataclass(frozen=True, eq=False, repr=False)
class TrackingCertificate(Result):
    """Tracking tube and conditions of rest of a compensated loop.

    The tube holds for the `reference` of `Compensation.certify`; without one, for slow references.
    A delay margin of 200 samples is that or more.

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    >>> comp = dfc.design_compensation(axis, dt=1e-3)
    >>> comp.certificate.tube > comp.certify(mismatch=0.1).tube
    True
    >>> print(f"{1e3 * comp.certificate.delay_margin:.1f} ms")
    1.6 ms
    """

    tube: float = stated("Bound of the tracking error [m]; inf if unstable or beyond the drive.")
    parts: dict[str, float] = stated("Contributions to the tube [m].")
    friction_left: float = stated("Largest force that the compensation leaves [N].")
    nominal: LoopGains = stated("Gains of the linear loop of the nominal axis.")
    worst: LoopGains = stated("Gains at the worst axis within the mismatch.")
    mismatch: float = stated("Relative error of every parameter it was computed for.")
    learned: float = stated("Part of the mismatch of the levels that was taken as learned.")
    conditions: tuple[Condition, ...] = stated("Conditions of rest without hunting.")
    units: tuple[str, str] = stated("Units of position and force.", ("m", "N"))
    slow: bool = stated("Whether it holds for slow references only.", False)
    delay_margin: float = stated("Longest additional delay of a stable nominal loop [s].", 0.0)
    drive_needed: float = stated("Force that the drive may need for model and tube [N].", 0.0)
    limit: float = stated("Largest force of the drive [N].", math.inf)
    friction_most: float = stated("The same, stuck or against the reference [N].", 0.0)
    known: tuple[str, ...] = stated("Effects that it takes as they are.", ())
    reasons: tuple[str, ...] = stated("Why no finite tube holds, and what to change.", ())
    uncovered: tuple[str, ...] = stated(
        "Effects without bounds, with which it states nothing: the tube is infinite, no_hunting "
        "False, the delay margin 0.",
        (),
    )

    @property
    def no_hunting(self) -> bool:
        """Whether every condition of rest without hunting holds."""
        return all(condition.holds for condition in self.conditions)

    def _summary_parts(self) -> Iterator[str]:
        length, force = self.units
        covered = f"for {100 * self.mismatch:g} % of mismatch{', slow references' * self.slow}"
        if self.reasons:
            yield f"tube   none is finite {covered}"
        else:
            parts = (f"{name} {length_text(one, length)}" for name, one in self.parts.items())
            yield f"tube   {length_text(self.tube, length)} {covered}: {', '.join(parts)}"
        for reason in self.reasons:
            yield f"why    {reason}"
        yield (
            f"loop   L1 gain {self.nominal.l1:.4g} {length}/{force} nominal, {self.worst.l1:.4g} "
            f"at the worst axis; force left over at most {self.friction_left:.4g} {force} while "
            f"the axis slides with the reference, {self.friction_most:.4g} {force} otherwise"
        )
        if self.known:
            yield f"known  taken to be as the nominal axis has them: {', '.join(self.known)}"
        if self.uncovered:
            yield f"delay  no margin, not covered: {', '.join(self.uncovered)}"
        else:
            yield (
                f"delay  the nominal loop is stable for a drive delay of less than "
                f"{1e3 * self.delay_margin:.3g} ms beyond that of the axis"
            )
        if math.isfinite(self.limit):
            yield (
                f"drive  up to {self.drive_needed:.4g} {force} may be needed, the limit is "
                f"{self.limit:g} {force}"
            )
        for name, holds, detail in self.conditions:
            yield f"rest   {'holds' if holds else 'FAILS'}: {name} ({detail})"


def loop_matrices(
    comp: Compensation, mass: float, viscous: float, delay: float
) -> tuple[Floats, Floats]:
    """Linear loop of the tracking error: state matrix, and columns of force and reading error."""
    # One sample as the compiled law runs it, read off column by column; the axis is sampled
    # exactly.  The integral of a law that bounds it counts among the forces.
    c, dt = comp.numbers, comp.dt
    whole = int(delay / dt + 1e-9)
    # x, v, drive behind its lag; the drive before the delay's fraction is over, and after it.
    part = min(max(delay - whole * dt, 0.0), dt)
    early = _held_response(mass, viscous, comp.drive_lag, part)
    late = _held_response(mass, viscous, comp.drive_lag, dt - part)
    bounded = c[kernel.HOLDS] != 0.0
    own = 3 if comp.drive_lag > 0.0 else 2

    def step(state: Floats, force: float, noise: float) -> Floats:
        after = np.zeros(state.size)
        y = state[0] + noise
        after[4] = c[kernel.KEEP] * state[4] + (1.0 - c[kernel.KEEP]) * (y - state[5]) / dt
        after[5] = y
        speed = after[4]
        u = -c[kernel.KP] * y
        if c[kernel.KI] > 0.0 and not bounded:
            after[3] = state[3] - c[kernel.KI] * dt * y
            u += state[3]
        if c[kernel.SOURCE] != kernel.NOTHING:
            memory = np.zeros(kernel.LINE)
            memory[kernel.INNER : kernel.INNER + 5] = state[6:11]
            if bounded:
                kernel.update_extended_state(c, memory, y)
            else:
                u += c[kernel.RESIDUAL] * kernel.disturbance(c, memory, y)
            if c[kernel.SOURCE] == kernel.EXTENDED:
                speed = memory[kernel.INNER + 1]
            elif bounded:
                speed += c[kernel.SPEED_SHARE] * (memory[kernel.INNER + 1] - speed)
            used = 4 if c[kernel.SOURCE] == kernel.DISTURBANCE else 3
            after[6 : 6 + used] = memory[kernel.INNER : kernel.INNER + used]
        u -= c[kernel.KD] * speed
        after[DRIVE] = u
        drives = np.concatenate([[u], state[DRIVE:], [0.0]])
        after[DRIVE + 1 :] = drives[1 : state.size - DRIVE]
        moving = state[:3]
        for held, drive in ((early, drives[whole + 1]), (late, drives[whole])):
            moving = held @ np.concatenate([moving, [drive, force]])
        after[:own] = moving[:own]
        return after

    n = DRIVE + whole + 2
    zero = np.zeros(n)
    matrix = np.column_stack([step(column, 0.0, 0.0) for column in np.eye(n)])
    return matrix, np.column_stack([step(zero, 1.0, 0.0), step(zero, 0.0, 1.0)])


def _held_response(mass: float, viscous: float, lag: float, time: float) -> Floats:
    """Position, velocity and drive behind its lag after a time, from these, drive and force."""
    rates = np.zeros((5, 5))
    rates[0, 1], rates[1, 1], rates[1, 4] = 1.0, -viscous / mass, 1.0 / mass
    if lag > 0.0:
        rates[1, 2], rates[2, 2], rates[2, 3] = 1.0 / mass, -1.0 / lag, 1.0 / lag
    else:
        rates[1, 3] = 1.0 / mass
    return np.asarray(expm(rates * time)[:3])


def loop_responses(
    comp: Compensation, mass: float, viscous: float, delay: float
) -> tuple[float, Floats]:
    """Spectral radius of the linear loop of one axis, and responses until they have faded."""
    # Shape (n, 3, 2): position, velocity and drive 1 to n samples after a force of 1 N began to
    # act over a sample, and after a reading 1 m off; empty if the loop is unstable.
    A, B = loop_matrices(comp, mass, viscous, delay)
    radius = spectral_radius(A)
    if radius >= 1.0:
        return radius, np.empty((0, 3, 2))
    n = min(int(math.log(_FADED) / math.log(radius)) + A.shape[0], _LONGEST)
    # One sample after the other, a block of samples at a time.
    block = math.isqrt(n) + 1
    shown = np.eye(A.shape[0])[[0, 1, DRIVE]]
    rows = np.empty((block, *shown.shape))
    power = np.eye(A.shape[0])
    for k in range(block):
        rows[k], power = shown @ power, A @ power
    blocks = np.empty((block, block, 3, 2))
    state = B
    for k in range(block):
        blocks[k], state = rows @ state, power @ state
    return radius, blocks.reshape(-1, 3, 2)


def spectral_radius(A: Floats) -> float:
    """Largest magnitude of the eigenvalues."""
    return float(np.abs(np.linalg.eigvals(A)).max())


def loop_gains(radius: float, responses: Floats) -> LoopGains:
    """Gains of a linear loop by its responses; all infinite if it is unstable."""
    if not responses.size:
        return LoopGains(radius, *(math.inf,) * 6)
    return LoopGains(radius, *(float(one) for one in np.abs(responses).sum(axis=0).T.ravel()))


def delay_margin(comp: Compensation, slopes: LawSlopes) -> float:
    """Delay beyond the nominal one below which the linear loop is stable, at most 200 samples."""
    # With the axis' own laws, anywhere within the bounds of their slopes (small-gain theorem).
    axis, most = comp.rigid_axis, _LATEST * comp.dt

    def stable(delay: float) -> bool:
        late = comp.drive_delay + delay
        if not any(slopes):
            A, _ = loop_matrices(comp, axis.mass, axis.viscous, late)
            return spectral_radius(A) < 1.0
        gains = loop_gains(*loop_responses(comp, axis.mass, axis.viscous, late))
        return gains.radius < 1.0 and slopes.loop_gain(gains) < 1.0

    if not stable(0.0):
        return 0.0
    below = 0.0
    above = comp.dt
    while stable(above):
        if above >= most:
            return most
        below = above
        above = min(2.0 * above, most)
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


def stick_slip_gain(force: Floats) -> float:
    """Largest error of an axis that slips and sticks, for 1 N left while it slips [m/N]."""
    # A slip that starts at rest with an error E ends at most at, t samples later, with the step
    # response h and the response g, E abs(1 - h(t) / h(inf)) + D sum_{k < t} abs(g[k]), which
    # stays within E if, for every t, E >= D sum_{k < t} abs(g[k]) / (1 - abs(1 - h(t) / h(inf))):
    # the smallest such E is a fixed point of slips and stops; the map contracts if no denominator
    # vanishes, else the gain is infinite.
    if not force.size:
        return math.inf
    step = np.cumsum(force)
    kept = np.abs(1.0 - step / step[-1])
    # At first, as long as nothing of the error is gone, nothing has been added either.
    begun = step > 1e-9 * step[-1]
    if np.any(kept[begun] >= 1.0) or np.any(step[~begun] < 0.0):
        return math.inf
    return float(np.max(np.cumsum(np.abs(force))[begun] / (1.0 - kept[begun])))


class _Corner(NamedTuple):
    """Gains of the linear loop of one axis within the mismatch."""

    gains: LoopGains
    sticking: float  # largest error of slips and stops, for 1 N left [m/N]
    kick: float  # largest error for an error in velocity that is braked at once [s]
    slip: float  # largest velocity of a slip, for 1 N left [m/(N s)]
    missed: float  # error by what is missing along the reference [m]
    quick: float  # velocity of that error [m/s]
    drive: float  # drive for it, and for what follows [N]
    begun: float  # error by the force that the drive does not hold yet at the start [m]
    pushed: float  # velocity of that error [m/s]


def _mismatch_corners(
    comp: Compensation, mu: float, bounded: bool, reference: MotionProfile | None, held: float
) -> Iterator[_Corner]:
    """Loops at the corners of the mismatch; `held`: force that the drive holds from the start."""
    axis = comp.rigid_axis
    dt = comp.dt
    for m, f, d in itertools.product(
        sorted({1.0 - mu, 1.0, 1.0 + mu}),
        sorted({1.0 - mu, 1.0 + mu}),
        sorted({0.0, 0.5 * comp.input_delay, comp.input_delay}),
    ):
        mass = axis.mass * m
        viscous = axis.viscous * f
        delay = comp.drive_delay + d
        radius, responses = loop_responses(comp, mass, viscous, delay)
        gains = loop_gains(radius, responses)
        if radius >= 1.0:
            yield _Corner(gains, *(math.inf,) * 8)
            continue
        response = responses[..., 0]
        missed = quick = drive = begun = pushed = 0.0
        if reference is not None:
            missing = _missing(comp, reference, mass, viscous, delay)
            missed, quick, drive = np.abs(oaconvolve(missing[:, None], response, axes=0)).max(0)
            # An axis at rest under a reference that moves has the momentum to make up.
            start = mass * abs(float(reference.velocity[0])) / dt * np.abs(response).max(0)
            missed, quick, drive = np.array([missed, quick, drive]) + start
        if held > 0.0:
            # The drive that holds it arrives late.
            absent = _absent_at_start(comp, delay)[:, None]
            begun, pushed, late = held * np.abs(oaconvolve(absent, response, axes=0)).max(0)
            drive += late
        gain = stick_slip_gain(response[:, 0]) if bounded else gains.l1
        kick = mass * float(np.abs(response[:, 0]).max()) / dt
        slip = float(np.abs(np.cumsum(response[:, 1])).max())
        found = map(float, (missed, quick, drive, begun, pushed))
        yield _Corner(gains, gain, kick, slip, *found)


class _Loop(NamedTuple):
    """Bounds of a loop under laws over some reach of their arguments."""

    parts: dict[str, float]  # contributions to the tube [m]
    sliding: float  # force left over, sliding with the reference [N]
    largest: float  # the same otherwise [N]
    speed: float  # largest velocity of the error [m/s]
    feedback: float  # largest force of feedback and integral [N]
    fed: float  # largest friction that is fed forward [N]

    @property
    def tube(self) -> float:
        """Bound of the error [m]."""
        return float(sum(self.parts.values()))

    def is_within(self, other: _Loop) -> bool:
        """Whether no bound on which the laws depend exceeds another's."""
        names = ("tube", "speed", "feedback", "fed")
        return all(getattr(self, name) <= getattr(other, name) for name in names)


def certify_tracking(
    comp: Compensation,
    mismatch: float,
    learned: float,
    excess: float,
    reference: MotionProfile | None = None,
) -> TrackingCertificate:
    """Compute the tracking tube and check the conditions of rest."""
    # The theory page has the bounds, `sliding` (D) and `largest` (W) here.
    axis = comp.rigid_axis
    mu = mismatch
    c = comp.numbers
    bounded = c[kernel.HOLDS] != 0.0
    held = _force_at_start(comp, reference, mu)
    corners = list(_mismatch_corners(comp, mu, bounded, reference, held))
    fast = _peak_feedforward(axis, reference)
    places, guessed = _places(comp, reference)
    loop = _Loop({}, 0.0, 0.0, 0.0, 0.0, 0.0)
    laws = laws_of(axis, places)
    slope = needed = 0.0
    settled = False
    # The laws are read as far as the error takes their arguments: bounds that are no more than
    # those for which the laws were read hold, as the error grows from nothing without a jump.
    for _ in range(_REPEATS):
        wide = _widen_bounds(loop)
        asked = _MARGIN * needed
        pushed = _MARGIN * laws.force
        reach = places._replace(
            low=places.low - wide.tube, high=places.high + wide.tube,
            speed=_peak_speed(reference) + wide.speed, load=asked + pushed,
        )  # fmt: skip
        laws = laws_of(axis, reach)
        slope = laws.slope("x", max(c[kernel.PEAK] * c[kernel.EXCESS], (1.0 + mu) * excess))
        change = _argument_change(comp, reference, laws, wide)
        loop = _bounds(comp, corners, laws, change, (mu, learned, excess), wide.tube, reference)
        needed = float(loop.feedback + loop.fed + fast + laws.force)
        settled = needed <= asked and laws.force <= pushed and loop.is_within(wide)
        if settled or not math.isfinite(loop.tube):
            break
    grows = not settled
    if grows and math.isfinite(loop.tube):
        loop.parts[_GROWS] = math.inf
    lost = unbounded_effects(comp.axis)
    if lost:
        loop.parts[f"not covered: {', '.join(lost)}"] = math.inf
    if needed > c[kernel.LIMIT]:
        loop.parts["drive limit"] = math.inf
    # Each figure at its own worst corner.
    worst = LoopGains(
        *(max(values) for values in zip(*(one.gains for one in corners), strict=True))
    )
    nominal = loop_gains(*loop_responses(comp, axis.mass, axis.viscous, comp.drive_delay))
    gain = max(one.sticking for one in corners)
    slopes = LawSlopes(laws.slope("x"), laws.slope("v"), laws.slope("u"))
    return TrackingCertificate(
        loop.tube, loop.parts, float(loop.sliding), nominal, worst, mu, learned,
        _conditions(comp, places, guessed, worst, slopes, lost, mu), axis.units, reference is None,
        0.0 if lost else delay_margin(comp, slopes), needed, float(c[kernel.LIMIT]),
        float(loop.largest), comp.known,
        tuple(_reasons(comp, worst, gain, laws, slope, needed, lost, grows)), lost,
    )  # fmt: skip


def _widen_bounds(loop: _Loop) -> _Loop:
    """Bounds a little wider, for which the laws are read next."""
    parts = {name: _MARGIN * part for name, part in loop.parts.items()}
    speed, feedback, fed = (_MARGIN * one for one in (loop.speed, loop.feedback, loop.fed))
    return loop._replace(parts=parts, speed=speed, feedback=feedback, fed=fed)


def _argument_change(
    comp: Compensation, reference: MotionProfile | None, laws: Laws, loop: _Loop
) -> Change:
    """How far the arguments of the laws that are fed forward are from those at the axis."""
    c = comp.numbers
    ahead = (c[kernel.LEAD] + 1.0) * comp.dt - comp.drive_delay
    jolt = 0.0 if reference is None else float(np.abs(reference.acceleration).max())
    change = Change(ahead, _peak_speed(reference) * ahead, loop.speed + jolt * ahead)
    # A law of the load is fed forward for the drive that is fed forward with it.
    raised = (c[kernel.PEAK] * c[kernel.EXCESS] + c[kernel.BAND]) * laws.level
    drive = loop.feedback + raised + laws.force_change(change)
    drive += laws.force_slope("x") * loop.tube
    if comp.drive_lag > 0.0:
        # Behind a lag the drive passes through zero where its friction reverses.
        drive += 2.0 * (loop.fed + laws.force)
    return change._replace(load=drive)


def _bounds(
    comp: Compensation,
    corners: list[_Corner],
    laws: Laws,
    change: Change,
    off: tuple[float, float, float],
    tube: float,
    reference: MotionProfile | None,
) -> _Loop:
    """Bounds at the worst corner; `off`: mismatch, learned part of it, largest excess."""
    (mu, learned, excess), c, level = off, comp.numbers, laws.level
    # Other forces that are stronger than friction move the axis against it, at rest as well.
    pushes = laws.force_change(change) + laws.force_slope("x") * tube
    bounded = c[kernel.HOLDS] != 0.0 and pushes <= (1.0 - mu) * laws.least_level
    if not math.isfinite(level + pushes):
        return _Loop({_GROWS: math.inf}, math.inf, math.inf, math.inf, math.inf, math.inf)
    peak = c[kernel.PEAK] * c[kernel.EXCESS]
    highest = max(peak, (1.0 + mu) * excess)
    most = c[kernel.BAND] if bounded else 0.0
    # A stuck axis that still moves loses its velocity, as if friction were larger by as much.
    axis = comp.rigid_axis
    caught = (1.0 + mu) * axis.mass * min(axis.stick_rate, 1.0 / comp.dt) * axis.stick_speed
    friction = (1.0 + mu) * level + max((1.0 + mu) * level * excess, caught)
    fed = level * (c[kernel.COULOMB] + peak + most)
    moved = (1.0 + highest) * laws.level_change(change) + laws.force_change(change)
    largest = friction + fed + 2.0 * moved
    sliding = (1.0 - learned) * (mu + most) * level + max(level * highest, caught) + moved
    sliding = sliding if bounded else largest
    early = 0.0 if reference is None else _peak_speed_unfed(comp, reference)
    half = 0.5 * comp.encoder_quantum
    slope = laws.slope("x", highest)
    parts: dict[str, float] = {}
    speed = feedback = 0.0
    for one in corners:
        if one.gains.radius >= 1.0:
            return _Loop({"unstable loop": math.inf}, sliding, largest, 0.0, 0.0, fed)
        # Where the feedforward changes sides, it and friction brake what the axis is too fast by.
        turning = one.quick + half * one.gains.reading_speed + early
        gain = one.sticking if bounded else one.gains.l1
        made = {
            "sliding": one.gains.l1 * sliding,
            "sticking": (gain - one.gains.l1) * sliding,
            "reversals": one.kick * turning + _TURN * gain * sliding if bounded else 0.0,
            "inertia": one.missed,
            "start": one.begun + (one.kick * one.pushed if bounded else 0.0),
            "encoder": half * one.gains.reading,
        }
        shrink = 1.0 - gain * slope
        made = {
            name: float(size) / shrink if shrink > 0.0 else math.inf
            for name, size in made.items()
            if size > 1e-9 * one.gains.l1 * sliding  # not of rounding alone
        }
        error = sum(made.values())
        if error > sum(parts.values()):
            parts = made
        # What changes with the place of the axis is a force, too.
        left = sliding + slope * error if slope > 0.0 else sliding
        turning += one.pushed
        slip = turning + left * one.slip
        asked = min(one.gains.drive * left, c[kernel.KP] * error + c[kernel.KD] * slip)
        feedback = max(feedback, asked + one.drive + half * one.gains.reading_drive)
        speed = max(speed, turning + left * one.gains.speed, _peak_speed(reference))
    return _Loop(parts, float(sliding), float(largest), speed, float(feedback), float(fed))


def _reasons(
    comp: Compensation,
    worst: LoopGains,
    gain: float,
    laws: Laws,
    slope: float,
    needed: float,
    lost: tuple[str, ...],
    grows: bool,
) -> Iterator[str]:
    """Conditions of a finite tube that fail, each with what to change."""
    length, force = comp.rigid_axis.units
    limit = float(comp.numbers[kernel.LIMIT])
    if worst.radius >= 1.0:
        yield (
            "the linear loop is unstable for an axis within the mismatch (spectral radius "
            f"{worst.radius:.4g}): lower bandwidth, input_delay or mismatch"
        )
    elif math.isinf(gain):
        yield (
            "a slip may end farther from its target than it began, as the loop is not damped "
            "enough: lower bandwidth or input_delay, or give gains with a larger kd"
        )
    elif gain * slope >= 1.0:
        yield (
            f"force effects and levels change with position by up to {slope:.4g} "
            f"{force}/{length}, and the loop can bound the error below {1.0 / gain:.4g} "
            f"{force}/{length} only: raise bandwidth; a shorter dt or input_delay allows more"
        )
    elif grows and not math.isfinite(laws.level + laws.force):
        yield (
            "force effects or levels grow without bound over time: "
            "comp.certify(reference=...) reads them for as long as a move lasts"
        )
    elif grows:
        yield (
            "force effects or levels that depend on velocity, load or place grow with the error "
            "faster than the loop bounds it: raise bandwidth, or lower mismatch or the "
            "acceleration of the reference"
        )
    if lost:
        yield (
            f"not covered: {', '.join(lost)}. Design for axis.replace(effects=...) with "
            "the others only, and see what this one adds with simulate_loop on the full axis"
        )
    if needed > limit:
        yield (
            f"the drive may need {needed:.4g} {force}, more than its limit of {limit:g} {force}: "
            "raise limit, or lower mismatch, bandwidth or the acceleration of the reference"
        )


def _peak_speed(reference: MotionProfile | None) -> float:
    """Largest speed of a reference [m/s]."""
    return 0.0 if reference is None else float(np.abs(reference.velocity).max())


def _feedforward_forces(axis: FrictionAxis, reference: MotionProfile) -> Floats:
    """Inertia and viscous friction that are fed forward, shape (2, n) [N]."""
    return np.array([axis.mass * reference.acceleration, axis.viscous * reference.velocity])


def _peak_feedforward(axis: FrictionAxis, reference: MotionProfile | None) -> float:
    """Largest inertia and viscous friction, each by its size, that are fed forward [N]."""
    if reference is None:
        return 0.0
    return float(np.abs(_feedforward_forces(axis, reference)).sum(axis=0).max())


def _missing(
    comp: Compensation, reference: MotionProfile, mass: float, viscous: float, delay: float
) -> Floats:
    """What lacks of inertia and viscous friction over each sample [N], shape (n,)."""
    dt = comp.dt
    fed = _feedforward_forces(comp.rigid_axis, reference).sum(axis=0)
    whole = int(delay / dt + 1e-9)
    part = delay / dt - whole
    drive = (1.0 - part) * _delay_samples(comp, fed, whole) + part * _delay_samples(
        comp, fed, whole + 1
    )
    if comp.drive_lag > 0.0:
        pole = math.exp(-dt / comp.drive_lag)
        after = lfilter([1.0 - pole], [1.0, -pole], drive)
        # Mean over the sample of what goes from the one before to this one.
        rise = comp.drive_lag / dt * (1.0 - pole)
        before = np.concatenate([[0.0], after[:-1]])
        drive = drive + rise * (before - drive)
    x = np.concatenate([reference.position[:1], reference.position, reference.position[-1:]])
    needed = mass * np.diff(x, 2) / dt**2 + viscous * (x[2:] - x[:-2]) / (2.0 * dt)
    return np.asarray(drive - 0.5 * (needed + np.append(needed[1:], 0.0)))


def _force_at_start(comp: Compensation, reference: MotionProfile | None, mu: float) -> float:
    """Force effects that friction does not hold where a reference begins [N]."""
    if reference is None:
        return 0.0
    place = float(reference.position[0])
    reach = Reach(place - comp.tolerance, place + comp.tolerance, time=comp.dt)
    laws = laws_of(comp.rigid_axis, reach)
    return laws.force if laws.force > (1.0 - mu) * laws.least_level else 0.0


def _absent_at_start(comp: Compensation, delay: float) -> Floats:
    """Part of a drive from the first sample on that is not at the axis yet, mean over samples."""
    samples = math.ceil((delay + _LAGS * comp.drive_lag) / comp.dt) + 1
    ends = comp.dt * np.arange(samples + 1) - delay
    lag = comp.drive_lag
    # Its integral: whole until the delay is over, then fading with the lag.
    late = np.minimum(ends, 0.0) + (
        lag * -np.expm1(-np.maximum(ends, 0.0) / lag) if lag > 0.0 else 0.0
    )
    return np.asarray(np.diff(late) / comp.dt)


def _delay_samples(comp: Compensation, ahead: Floats, back: int) -> Floats:
    """What is fed forward as it was so many samples before, nothing before the first."""
    at = np.arange(ahead.size) - back
    there = np.clip(at + int(comp.numbers[kernel.LEAD]), 0, ahead.size - 1)
    return np.where(at >= 0, ahead[there], 0.0)


def _peak_speed_unfed(comp: Compensation, reference: MotionProfile) -> float:
    """Largest velocity of the reference whose friction is not fed forward at the axis yet."""
    dt = comp.dt
    v = reference.velocity
    way = np.sign(v) * (np.abs(v) > comp.numbers[kernel.REST_SPEED])
    latest = math.ceil((comp.drive_delay + comp.input_delay + _LAGS * comp.drive_lag) / dt) + 1
    unfed = np.zeros(v.size, dtype=bool)
    for back in range(int(comp.drive_delay / dt), latest + 1):
        unfed |= _delay_samples(comp, way, back) * np.sign(v) <= 0.0
    return float(np.abs(v[unfed]).max(initial=0.0))


def _places(comp: Compensation, reference: MotionProfile | None) -> tuple[Reach, bool]:
    """Places and times of a reference, and whether its places are guessed."""
    # Those of the reference and a tenth of its way on either side, else those of the travel.
    travel = comp.rigid_axis.travel
    if reference is None:
        return Reach(*(travel or ANYWHERE)), travel is None
    beside = 0.1 * float(np.ptp(reference.position)) or comp.tolerance
    low = float(reference.position.min())
    high = float(reference.position.max())
    return Reach(low - beside, high + beside, time=reference.duration), False


def _conditions(
    comp: Compensation,
    places: Reach,
    guessed: bool,
    worst: LoopGains,
    slopes: LawSlopes,
    lost: tuple[str, ...],
    mu: float,
) -> tuple[Condition, ...]:
    """Conditions under which an axis at rest stays at rest for ever."""
    length, force = comp.rigid_axis.units
    c = comp.numbers
    distance = _BESIDE * comp.tolerance
    holds = c[kernel.HOLDS] != 0.0
    rest = at_rest(comp.rigid_axis, places, c[kernel.HOLD_SHARE] / (1.0 - mu), distance)
    held = c[kernel.HOLD_SHARE] * rest.held if holds else math.inf
    least = (1.0 - mu) * rest.kept
    unsure = ""
    if guessed and rest.uneven:
        unsure = (
            f"; levels depend on the position and are read from {places.low:g} to {places.high:g} "
            f"{length}, as the axis has no travel: give it, axis.replace(travel=(low, high))"
        )
    left = max(least - held, 0.0)
    loop_gain = slopes.loop_gain(worst)
    # Name, whether it holds, detail, and what to do if it does not.
    corrected = 'the integral goes on at rest: law="learned" and "fixed" hold it'
    if holds:
        corrected = f"each one widens the tolerance {length_text(comp.tolerance, length)} "
        corrected += f"by {c[kernel.GROWTH]:g}"
    rows = [
        (
            "every effect of the axis has bounds",
            not lost,
            f"not covered: {', '.join(lost)}" if lost else "none is left out",
            "",
        ),
        (
            "the linear loop is stable for every axis within the mismatch",
            worst.radius < 1.0 and loop_gain < 1.0,
            f"spectral radius at most {worst.radius:.5f}"
            + f", loop gain through the axis' effects at most {loop_gain:.3g}" * any(slopes),
            "lower bandwidth or mismatch",
        ),
        (
            "the drive is constant at rest after finitely many corrections",
            holds and c[kernel.GROWTH] > 1.0,
            corrected,
            "",
        ),
        (
            "the held drive stays below the least Coulomb level",
            held <= least,
            f"{held:.3g} of {least:.3g} {force}",
            f"the level changes too much over {length_text(distance, length)} or with time, or "
            f"the design was made for a lower mismatch{unsure}"
            if holds
            else "",
        ),
        (
            "other forces and levels do not change with time by more than is left",
            rest.wander <= left,
            f"they change by {rest.wander:.3g} of {left:.3g} {force}",
            "rest is not certain, however the loop is designed",
        ),
        (
            "the drive can give the force that it holds",
            not holds or held + rest.force <= c[kernel.LIMIT],
            f"{held + rest.force:.3g} of {c[kernel.LIMIT]:.3g} {force}",
            "raise the limit of the drive",
        ),
        (
            "the encoder's last digit does not end the hold",
            2.5 * comp.tolerance >= comp.encoder_quantum,
            f"released at {length_text(2.5 * comp.tolerance, length)}",
            "",
        ),
    ]
    return tuple(
        Condition(name, bool(ok), detail if ok or not mend else f"{detail}: {mend}")
        for name, ok, detail, mend in rows
    )
