"""A first look at a record, before any fit: what it holds, and what it cannot show."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dryfric_control.records.bad_readings import FILLED, REASONS, held_for
from dryfric_control.records.motion import (
    ONE_VELOCITY,
    Record,
    directions,
    is_undriven,
    reversals,
    usual_speeds,
)
from dryfric_control.records.staircase import find_staircase
from dryfric_control.text import Result, documented, length_text, stated
from dryfric_control.units import usual_units

# Least displacement within a sample [standard deviations of the noise].
_DISPLACED = 30.0
# The same, over the largest step beside it.
_ALONE = 4.0
# Samples before and after it that are beside it.
_BESIDE = 4
# Largest step of noise [standard deviations of the noise].
_SCATTER = 6.0
# Part of the path from which displacements are how the axis moves.
_UNUSUAL = 0.1
# What a record must have.
# Duration of its longest rest [s].
_REST = 0.05
# The same [samples].
_REST_SAMPLES = 5
# Part of the samples that slide.
_SLIDING = 0.1
# Part of these in the rarer direction.
_EITHER_WAY = 0.02
# Travel [encoder increments].
_STEPS = 200
# Travel over the noise of the position.
_OVER_NOISE = 100.0
# Largest part of the readings that may be masked.
_MASKED = 0.01
# Work taken out of the machine, as a part of all that passed, which no measurement error makes.
_TAKEN = 0.2
# Velocity [m/s], exceeded in 5 % of the motion, beyond which positions that nobody gave a unit are
# not in metres.
_FAST = 30.0


@documented
@dataclass(frozen=True, repr=False)
class RecordCheck(Result):
    """Contents and gaps of a record; made by `Record.check`.

    Examples
    --------
    >>> import numpy as np
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    >>> t = 1e-3 * np.arange(4000)
    >>> u = 20.0 * np.sin(6.0 * t)
    >>> x = 1e-6 * np.round(1e6 * axis.simulate(u, dt=1e-3).y[0])
    >>> print(dfc.Record(t, u, x).check())
    7 reversals, 9 % at rest, no samples lost, drive not clipped, resolution 1 um
              record
    time      4 s in 4000 samples, 0.001 s apart
    travel    0.166 m, 166035 steps of 1 um
    noise     0.289 um
    motion    48 % forwards, 42 % backwards, longest rest 0.073 s
    velocity  0.013 to 0.592 m/s in 90 % of the motion
    units     none stated for u, x: taken as those of the axis (N, m by default), time in s
    """

    samples: int = stated("Number of samples.")
    dt: float = stated("Sampling step [s].")
    duration: float = stated("Time covered [s].")
    travel: float = stated("Distance between the extreme positions [unit of x].")
    reversals: int = stated("Changes of direction, with or without a rest between them.")
    at_rest: float = stated("Share of the samples at which the readings show no motion [1].")
    forwards: float = stated("Share of the samples at which the position grows [1].")
    backwards: float = stated("Share of the samples at which the position falls [1].")
    longest_rest: float = stated("Longest time without motion [s].")
    velocity: tuple[float, float] = stated("Magnitudes around 90 % of the motion [unit of x/s].")
    masked: Mapping[str, int] = stated("Readings that are not used, by reason, see `Record.bad`.")
    clipped: float = stated("Share of the samples at which the drive rests at its extremes [1].")
    quantum: float = stated("Encoder quantum, 0 for none [unit of x].")
    noise: float = stated("Spread of the position noise, at least quantum / sqrt(12) [unit of x].")
    units: tuple[str, str] = stated("Units of position and drive; empty where unknown.")
    messages: tuple[str, ...] = stated("What is missing for a fit, and what looks wrong.")
    assumed: str = stated("What is taken for units that nobody stated; empty where all are.", "")
    raw: Mapping[str, tuple[str, float]] = stated(
        "Unit in which a channel was stored, and the factor on it.", default_factory=dict
    )

    @property
    def headline(self) -> str:
        """The record in one line."""
        lost = self.masked.get(FILLED, 0)
        left_out = sum(self.masked.values()) - lost
        words = [
            f"{self.reversals} reversal{'s' * (self.reversals != 1)}",
            f"{_percent(self.at_rest)} at rest",
            f"{lost or 'no'} sample{'s' * (lost != 1)} lost",
            *[f"{left_out} reading{'s' * (left_out != 1)} masked"] * bool(left_out),
            f"drive clipped {_percent(self.clipped)}" if self.clipped else "drive not clipped",
            f"resolution {self._length(self.quantum or self.noise)}",
        ]
        return ", ".join(words)

    def _length(self, value: float) -> str:
        return length_text(value, self.units[0]) if self.units[0] else f"{value:.3g}"

    def _steps(self) -> float:
        """Encoder steps of the travel; infinite without an encoder."""
        return self.travel / self.quantum if self.quantum else np.inf

    def _summary_parts(self) -> Iterator[str | list[tuple[str, ...]]]:
        yield self.headline
        slow, fast = self.velocity
        speed = f" {self.units[0]}/s" if self.units[0] else ""
        ways = f"{_percent(self.forwards)} forwards, {_percent(self.backwards)} backwards"
        steps = f", {self._steps():.0f} steps of {self._length(self.quantum)}" * bool(self.quantum)
        rows: list[tuple[str, ...]] = [
            ("", "record"),
            ("time", f"{self.duration:.4g} s in {self.samples} samples, {self.dt:.4g} s apart"),
            ("travel", f"{self._length(self.travel)}{steps}"),
            ("noise", self._length(self.noise)),
            ("motion", f"{ways}, longest rest {self.longest_rest:.3g} s"),
            ("velocity", f"{slow:.3g} to {fast:.3g}{speed} in 90 % of the motion"),
        ]
        more = [("factors", factors(self.raw)), ("units", self.assumed)]
        yield rows + [row for row in more if row[1]]
        for message in self.messages:
            yield f"warning: {message}"


def _percent(share: float) -> str:
    """A share as a percentage; one that is not zero does not look like it."""
    return "less than 1 %" if 0.0 < share < 0.005 else f"{100.0 * share:.0f} %"


def factors(raw: Mapping[str, tuple[str, float]]) -> str:
    """What the numbers of a source were multiplied by."""
    return ", ".join(f"{role} {f:.6g} per {unit or 'unit'}" for role, (unit, f) in raw.items())


def assumed_units(units: Mapping[str, str]) -> str:
    """What is taken for units that nobody stated; empty where all are."""
    by_role = dict(zip("xu", usual_units(units), strict=True))
    usual = {role: by_role[role] for role in "ux" if role not in units}
    if not usual:
        return ""
    return (
        f"none stated for {', '.join(usual)}: taken as those of the axis "
        f"({', '.join(usual.values())} by default), time in s"
    )


def energy_message(record: Record, units: tuple[str, str]) -> str | None:
    """What to say of a drive that takes energy out of the machine; None if it does not."""
    passed = record.net_input[:-1] * np.diff(record.x)
    total = float(np.abs(passed).sum())
    work = float(passed.sum())
    if work >= -_TAKEN * total:
        return None
    return (
        f"the drive takes energy out of the machine ({work:.3g} of {total:.3g} {units[1]} "
        f"{units[0]} exchanged): is the sign of u or x reversed (gain=-1), or are the two "
        "swapped? Only a load that pulls the axis along can do that"
    )


def speed_message(record: Record) -> str | None:
    """What to say of positions without a unit that are too fast for metres, if they are."""
    if "x" in record.units:
        return None
    moving = directions(record) != 0
    fast = usual_speeds(record.derivatives().v[moving])[1]
    if fast <= _FAST:
        return None
    return (
        f"x has no unit, and in metres would run at {fast:.3g} m/s over {record.range:.3g} m: "
        'state it, read_record(..., units={"x": "mm"}) or "rad", or convert counts by '
        "gain=dfc.Scaling(...)"
    )


def displacements(record: Record) -> list[int]:
    """Samples before which the position is suddenly elsewhere, though it does not move that fast.

    No axis moves within one sample alone, unless that is how it always moves.
    """
    steps = np.abs(np.diff(record.x))
    around = np.pad(steps, _BESIDE)
    beside = [around[k : k + steps.size] for k in range(2 * _BESIDE + 1) if k != _BESIDE]
    least = _DISPLACED * record.noise + _ALONE * np.max(beside, axis=0)
    found = np.flatnonzero(steps > least)
    path = float(steps[steps > _SCATTER * record.noise].sum())
    return (found + 1).tolist() if steps[found].sum() < _UNUSUAL * path else []


def check_record(record: Record, units: tuple[str, str], told: Sequence[str] = ()) -> RecordCheck:
    """Look a record over; `units` are those of position and drive, empty if not known.

    What is `told` of it already is said first.
    """
    moving = directions(record)
    edges = np.flatnonzero(np.diff(moving == 0, prepend=False, append=False))
    rests = edges[1::2] - edges[::2]
    bad = record.bad
    found = RecordCheck(
        samples=len(record),
        dt=record.dt,
        duration=record.duration,
        travel=record.range,
        reversals=int(np.count_nonzero(reversals(record))),
        at_rest=float(np.mean(moving == 0)),
        forwards=float(np.mean(moving > 0)),
        backwards=float(np.mean(moving < 0)),
        longest_rest=float(rests.max(initial=0) * record.dt),
        velocity=usual_speeds(record.derivatives().v[moving != 0]),
        masked={reason: bad[reason] for reason in REASONS if bad[reason]},
        clipped=bad["clipped"] / len(record),
        quantum=record.quantum or 0.0,
        noise=record.noise,
        units=units,
        messages=(),
        assumed=assumed_units(record.units),
        raw=dict(record.raw),
    )
    own = [message for message in _messages(found, record) if message not in told]
    return replace(found, messages=(*told, *own))


# Drives that are no force, by unit: in words, their unit in words, and what makes a force of them.
_NO_FORCES = {
    "A": ("current", "amperes", "gain=dfc.Scaling(torque_constant=...)"),
    "V": ("voltage", "volts", 'gain={"u": ...} [N/V]'),
    "Pa": ("pressure", "pascals", "gain=dfc.Scaling(piston_area=...)"),
}


def _messages(found: RecordCheck, record: Record) -> Iterator[str]:
    """What a user has to know before a fit."""
    if is_undriven(record):
        yield "no drive: only ratios to the mass can be determined; give it as known"
    if found.units[1] in _NO_FORCES:
        drive, units, mend = _NO_FORCES[found.units[1]]
        yield (
            f"the drive is a {drive}: forces and mass are in {units} until {mend} of read_record "
            "makes a force of it"
        )
    if (taken := energy_message(record, found.units)) is not None:
        yield taken
    if found.units[0] in ("m", "") and (unit := speed_message(record)) is not None:
        yield unit
    if (steps := find_staircase(record.u, record.input_quantum)) is not None:
        age = steps.period * record.dt
        yield (
            f"the drive is a staircase: it changes every {1e3 * age:.4g} ms "
            f"({1.0 / age:.4g} Hz) and is repeated in between, so its age is 0 to {1e3 * age:.4g} "
            'ms. If it was measured at that rate, read the file with hold="first", which brings '
            "it along straight lines; if the drive held it, all is well"
        )
    count, first = held_for(record.x, found.quantum)
    if count > 1:
        yield (
            f"the position changes only every {count} samples and is repeated in between: use "
            f"record[{first}:].decimated({count})"
        )
    if found.clipped:
        yield (
            f"the drive rests at both its extremes for {_percent(found.clipped)} of the time: make "
            "sure that u is the force that acted, not the one commanded"
        )
    for k in displacements(record)[:1]:
        way = found._length(abs(float(record.x[k] - record.x[k - 1])))
        yield (
            f"the position is elsewhere by {way} from one sample to the next, at t = "
            f"{record.t[k]:.5g} s, and moves on from there: did the encoder slip, or lose steps? "
            f"Use record[:{k}] and record[{k}:]"
        )
    masked = sum(found.masked.values())
    if masked > _MASKED * found.samples:
        yield f"{_percent(masked / found.samples)} of the readings are masked: see record.plot()"
    if found._steps() < _STEPS:
        yield (
            f"the travel is {found._steps():.0f} encoder steps: velocity and "
            "acceleration are coarse; use a finer encoder or a longer travel"
        )
    elif 0.0 < found.travel < _OVER_NOISE * found.noise:
        yield (
            f"the noise of position is {_percent(found.noise / found.travel)} of the travel: "
            "velocity and acceleration are coarse"
        )
    yield from _motion_messages(found)


def _motion_messages(found: RecordCheck) -> Iterator[str]:
    """What the motion does not show."""
    sliding = found.forwards + found.backwards
    if sliding < _SLIDING:
        yield f"moves for {_percent(sliding)} of the time only: shows little; drive it harder"
        return
    if min(found.forwards, found.backwards) < _EITHER_WAY * sliding:
        way = "forwards" if found.forwards > found.backwards else "backwards"
        yield (
            f"moves {way} only: friction, bias force and asymmetry cannot be separated; drive it "
            "both ways"
        )
    elif found.longest_rest < max(_REST, _REST_SAMPLES * found.dt):
        yield (
            f"hardly at rest ({found.longest_rest:.2g} s at most): uninformative about breakaway, "
            "presliding and dwell time; include a few stops"
        )
    if found.velocity[1] < ONE_VELOCITY * found.velocity[0]:
        yield (
            "nearly constant speed: viscous friction and Coulomb level cannot be separated; vary it"
        )
