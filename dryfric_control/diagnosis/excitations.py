"""The small set of bench experiments that a diagnosis chooses from."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dryfric_control.arrays import Floats
from dryfric_control.checks import positive
from dryfric_control.model.axis import FrictionAxis, span_of
from dryfric_control.model.effects import BiasForce
from dryfric_control.records.record import Record
from dryfric_control.ties import samples

# Reference, and feed-forward force where there is any.
Motion = Floats | tuple[Floats, Floats]

# Length of an experiment [s].
_DURATION = 8.0
# Largest number of simulated samples.
_MAX_SAMPLES = 16_000
# Fraction of the travel that motions keep free at each end.
_MARGIN = 0.08
# Clamped-on mass over the mass of the axis.
_ADDED_MASS = 0.5
# Known force over the Coulomb level.
_KNOWN_FORCE = 0.5


@dataclass(frozen=True)
class Limits:
    """Limits of travel, drive and speed for `next_experiment`.

    Parameters
    ----------
    travel : tuple of float
        Lowest and highest position [m].
    drive : float
        Largest drive force [N].
    speed : float
        Largest speed [m/s].

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> dfc.diagnosis.Limits(travel=(0.0, 0.3), drive=20.0, speed=0.5).drive
    20.0
    """

    travel: tuple[float, float]
    drive: float
    speed: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "travel", span_of(self.travel, "limits.travel"))
        positive("limits.drive", self.drive, unit="N")
        positive("limits.speed", self.speed, unit="m/s")

    @classmethod
    def from_record(cls, axis: FrictionAxis, record: Record) -> Limits:
        """Travel of the axis or record, largest drive and speed.

        Parameters
        ----------
        axis : FrictionAxis
            Its travel counts, if it has one.
        record : Record
            What the largest drive and speed are of.

        Returns
        -------
        Limits
        """
        if not record.u.any():
            raise ValueError(
                "limits: the record has no drive that shows the largest one: give "
                "limits=dfc.diagnosis.Limits(travel=..., drive=..., speed=...)"
            )
        return cls(
            axis.travel or (float(record.x.min()), float(record.x.max())),
            float(np.abs(record.u).max()),
            float(np.abs(record.derivatives().v).max()),
        )


class Stage:
    """The axis and the limits for which an excitation is designed, sampled at `dt`."""

    def __init__(self, axis: FrictionAxis, limits: Limits, dt: float) -> None:
        (low, high), drive = limits.travel, limits.drive
        self.limits, self.axis = limits, axis.effective()
        self.t = np.asarray(dt * np.arange(min(samples(_DURATION, dt), _MAX_SAMPLES)))
        self.duration = float(self.t[-1])
        self.middle = 0.5 * (low + high)
        self.reach = (0.5 - _MARGIN) * (high - low)  # largest distance from the middle
        levels = [self.axis.coulomb(np.array([self.middle]), s) for s in (1, -1)]
        self.level = 0.5 * float(np.sum(levels))  # Coulomb level in the middle
        self.spare = max(drive - self.level, 0.2 * drive)  # drive in excess of the friction
        self.added_mass = _ADDED_MASS * self.axis.mass
        self.known_force = _KNOWN_FORCE * min(max(self.level, 0.05 * drive), drive)


def _triangle_wave(stage: Stage, speed: float, reach: float) -> Floats:
    """Triangle at constant speed, from the middle, within `reach`."""
    way = speed * stage.t + reach
    return np.asarray(stage.middle + np.abs(np.mod(way, 4.0 * reach) - 2.0 * reach) - reach)


def _triangle(stage: Stage, scale: float) -> Motion:
    speed = min(8.0 * stage.reach / stage.duration, 0.8 * stage.limits.speed)
    return _triangle_wave(stage, scale * speed, scale * stage.reach)


def _crawl(stage: Stage, scale: float) -> Motion:
    speed = 0.02 * scale * stage.limits.speed
    return _triangle_wave(stage, speed, min(stage.reach, speed * stage.duration / 8.0))


def _reversals(stage: Stage, scale: float) -> Motion:
    turns = 32
    part = stage.duration / turns
    way = scale * min(stage.reach, 0.5 * stage.limits.speed * part)
    places = way * np.tile([1.0, -0.3, 0.6, -1.0], turns // 4)
    number = np.minimum((stage.t / part).astype(int), turns - 1)
    s = np.minimum((stage.t / part - number) / 0.8, 1.0)
    before = np.concatenate(([0.0], places))[number]
    return stage.middle + before + (places[number] - before) * s**3 * (10 - 15 * s + 6 * s * s)


def _steps(stage: Stage, scale: float) -> Motion:
    # Fixed pattern of short and long steps, with time to settle.
    pattern = np.array([0.0, 0.6, 0.0, -0.9, 0.3, 0.9, -0.3, 0.1, -0.6, 0.0, 0.9, -0.9])
    number = (stage.t / stage.duration * pattern.size).astype(int)
    number = np.minimum(number, pattern.size - 1)
    return stage.middle + scale * stage.reach * pattern[number]


def _speeds(stage: Stage, scale: float) -> Motion:
    speeds = scale * np.array([0.08, 0.17, 0.37, 0.8]) * stage.limits.speed
    length = stage.duration / speeds.size
    turns = np.maximum(1.0, np.round(speeds * length / (4.0 * stage.reach)))
    reach = np.minimum(stage.reach, 0.25 * speeds * length / turns)
    part = np.minimum(stage.t / length, speeds.size - 1e-9).astype(int)
    since = stage.t - stage.t[np.searchsorted(part, part)]
    phase = np.mod(since / (length / turns)[part] + 0.25, 1.0)
    return stage.middle + reach[part] * (1.0 - 4.0 * np.abs(phase - 0.5))


def _braking(stage: Stage, scale: float) -> Motion:
    m = stage.axis.mass
    speed = 0.85 * scale * stage.limits.speed
    slow = (stage.level + 0.7 * scale * stage.spare) / m
    # Accelerate more gently than it brakes: only the braking is informative.
    fast = 0.5 * stage.spare / m
    way = 2.0 * stage.reach
    speed = min(speed, float(np.sqrt(way / (0.5 / fast + 0.5 / slow))))
    up = speed / fast
    down = speed / slow
    even = max(min((way - 0.5 * speed * (up + down)) / speed, 0.1 * stage.duration), 0.0)
    one = np.cumsum([0.03 * stage.duration, up, even, down])
    phase = np.mod(stage.t, one[-1])
    v = np.interp(phase, [0.0, *one], [0.0, 0.0, speed, speed, 0.0])
    v *= 1.0 - 2.0 * (np.floor(stage.t / one[-1]) % 2)
    dt = stage.t[1] - stage.t[0]
    x = np.cumsum(v) * dt
    force = m * np.gradient(v, dt) + stage.axis.viscous * v + stage.level * np.sign(v)
    limit = 0.8 * stage.limits.drive
    return stage.middle - 0.5 * float(np.ptp(x)) + x, np.clip(force, -limit, limit)


def _rests(stage: Stage, scale: float) -> Motion:
    # For a duration of 8 s; all ramps are equally slow.
    rests = stage.duration / 8.0 * np.array([0.02, 0.1, 0.3, 0.6, 1.2, 2.0])
    ramp = (stage.duration - rests.sum()) / rests.size
    way = scale * min(0.5, 0.1 * stage.limits.speed * ramp / stage.reach)
    times = np.cumsum([0.0, *np.ravel([(rest, ramp) for rest in rests])])
    path = np.interp(stage.t, times, way * (np.arange(times.size) // 2 % 2))
    return stage.middle + stage.reach * path


def _force_steps(stage: Stage, scale: float) -> Motion:
    # Alternating steps of lengths without a common period.
    edges = np.cumsum(np.tile([0.05, 0.11, 0.07, 0.17, 0.09], 40))
    sign = 1.0 - 2.0 * (np.searchsorted(edges, stage.t, side="right") % 2)
    speed = 0.3 * stage.limits.speed * scale
    size = 0.4 * scale * stage.spare
    return _triangle_wave(stage, speed, stage.reach), np.asarray(size * sign)


def _small_forces(stage: Stage, scale: float) -> Motion:
    part = stage.t / stage.duration
    level = max(stage.level, 0.05 * stage.limits.drive)
    size = np.minimum(1.25 * level * part, 0.8 * stage.limits.drive)
    force = scale * size * np.sin(2.0 * np.pi * 8.0 * part)
    return np.full(stage.t.size, stage.middle), force


def _sine_sweep(stage: Stage, scale: float) -> Motion:
    # From 4 to 64 periods in the duration.
    part = stage.t / stage.duration
    ratio = np.log(16.0)
    low = 8.0 * np.pi / stage.duration
    omega = low * np.exp(ratio * part)
    phase = low * stage.duration * np.expm1(ratio * part) / ratio
    size = np.minimum(stage.reach, 0.8 * stage.limits.speed / omega)
    size = np.minimum(size, 0.5 * stage.spare / stage.axis.mass / omega**2)
    return stage.middle + scale * size * np.sin(phase)


def _coasting(stage: Stage, scale: float) -> Motion:
    m = stage.axis.mass
    level = max(stage.level, 1e-3 * stage.limits.drive)
    far = 0.6 * scale * float(np.sqrt(2.0 * level * stage.reach / m))
    speed = min(0.7 * scale * stage.limits.speed, far)
    part = stage.duration / 8.0
    time = min(m * speed / (0.5 * stage.spare), 0.5 * part)
    sign = 1.0 - 2.0 * (np.floor(stage.t / part) % 2)
    push = min(level + 0.5 * stage.spare, 0.9 * stage.limits.drive)
    force = np.where(np.mod(stage.t, part) < time, sign * push, 0.0)
    # The loop limits the deviation of hypotheses that move differently.
    response = stage.axis.simulate(force, float(stage.t[1]), x0=stage.middle)
    return response.y[0].copy(), force


class KnownForce(BiasForce):
    """Known force added on the bench; no candidate of a diagnosis."""

    slug = "known_force"
    title = "known force"


def _with_mass(stage: Stage, axis: FrictionAxis) -> FrictionAxis:
    return axis.effective().replace(mass=axis.effective().mass + stage.added_mass)


def _with_force(stage: Stage, axis: FrictionAxis) -> FrictionAxis:
    return axis.replace(effects=(*axis.effects, KnownForce(force=stage.known_force)))


@dataclass(frozen=True)
class Excitation:
    """One experiment of the set."""

    name: str
    title: str
    description: str  # instructions; {mass} and {force} are replaced by what is added
    motion: Callable[[Stage, float], Motion]  # at a size
    # The axis with a known change of the bench, such as a mass clamped on.
    change: Callable[[Stage, FrictionAxis], FrictionAxis] | None = None

    def signals_at(self, stage: Stage, size: float) -> tuple[Floats, Floats]:
        """Reference and feed-forward force at a size."""
        found = self.motion(stage, size)
        return found if isinstance(found, tuple) else (found, np.zeros(found.size))

    def bench_axis(self, stage: Stage, axis: FrictionAxis) -> FrictionAxis:
        """The axis on the bench."""
        return axis if self.change is None else self.change(stage, axis)

    def description_at(self, stage: Stage) -> str:
        """The description with the numbers of a stage."""
        mass, force = (stage.axis.unit(unit) for unit in ("kg", "N"))
        return self.description.format(
            mass=f"{stage.added_mass:.3g} {mass}", force=f"{stage.known_force:.3g} {force}"
        )


#: Experiments without a change of the bench first.
EXCITATIONS = (
    Excitation(
        "triangle",
        "slow triangle over the travel",
        "Move slowly and evenly over the whole travel, back and forth.",
        _triangle,
    ),
    Excitation(
        "crawl",
        "crawl",
        "Crawl back and forth over a short distance, at a fiftieth of the top speed.",
        _crawl,
    ),
    Excitation(
        "reversals",
        "quick moves and reversals",
        "Move quickly from point to point with many reversals, long and short.",
        _reversals,
    ),
    Excitation(
        "steps",
        "steps of the reference",
        "Step the reference over short and long ways; let the drive reach its limit.",
        _steps,
    ),
    Excitation(
        "speeds",
        "constant speeds over a decade",
        "Run back and forth at four constant speeds from a twelfth to near the top speed.",
        _speeds,
    ),
    Excitation(
        "braking",
        "braking from speed",
        "Bring the axis to speed gently, then brake hard with the drive, both directions.",
        _braking,
    ),
    Excitation(
        "rests",
        "rests of growing length",
        "Let the axis rest for longer and longer times, and break it away each time with "
        "the same slow ramp.",
        _rests,
    ),
    Excitation(
        "force_steps",
        "steps of force while sliding",
        "While the axis slides back and forth, add steps of force to the drive.",
        _force_steps,
    ),
    Excitation(
        "small_forces",
        "small forces around rest",
        "At rest, raise and lower the force slowly, from far below breakaway to just above it.",
        _small_forces,
    ),
    Excitation(
        "sine_sweep",
        "sweep of a large sine",
        "Follow a sine as large as travel, speed and drive allow, from slow to fast.",
        _sine_sweep,
    ),
    Excitation(
        "coasting",
        "push and coast",
        "Push the axis to speed, drop the force to zero and let it coast to rest, in both "
        "directions.",
        _coasting,
    ),
    Excitation(
        "added_mass",
        "a known mass clamped on",
        "Add a known mass of {mass} to the axis, half of its own, and move quickly from "
        "point to point with many reversals.",
        _reversals,
        _with_mass,
    ),
    Excitation(
        "known_force",
        "a known force added",
        "Pull the axis in positive direction with a known constant force of {force} (a "
        "weight over a pulley, a known tilt), and run back and forth at four constant "
        "speeds.",
        _speeds,
        _with_force,
    ),
)
