"""Bounds of the force effects and friction levels of an axis, for its certificate."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from scipy.ndimage import minimum_filter1d

from dryfric_control.arrays import Floats
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.model.effects import Box, Effect, Interval
from dryfric_control.model.effects.interval import ARGUMENTS

#: Parts of the travel over which laws are bounded one by one.
_PARTS = 400
#: Travel of an axis without one, where no reference says more [m].
ANYWHERE = (-1.0, 1.0)
#: Effects of the drive that are part of the linear loop.
_LINEAR = ("delay", "lag")


class Reach(NamedTuple):
    """How far the arguments of the laws go."""

    low: float  # least position [m]
    high: float  # largest position [m]
    speed: float = 0.0  # largest speed [m/s]
    load: float = 0.0  # largest force on the transmission, drive less force effects [N]
    time: float = math.inf  # longest time since the start [s]
    rest: float = math.inf  # longest time at rest [s]


class Change(NamedTuple):
    """By how much the arguments differ between the law fed forward and the axis."""

    time: float = 0.0  # [s]
    place: float = 0.0  # of the reference meanwhile; the error counts by `Laws.slope` [m]
    speed: float = 0.0  # [m/s]
    load: float = 0.0  # [N]
    rest: float = math.inf  # [s]


class Laws(NamedTuple):
    """Bounds of the laws of an axis."""

    forces: tuple[Interval, ...]  # of each force effect, over the parts of the travel
    levels: dict[int, tuple[Interval, ...]]  # of map and level effects, by direction

    @property
    def force(self) -> float:
        """Largest sum of the force effects [N]."""
        return float(_sum(self.forces).magnitude.max())

    @property
    def level(self) -> float:
        """Largest friction level without Stribeck peak [N]."""
        return max(0.0, *(float(_sum(one).high.max()) for one in self.levels.values()))

    @property
    def least_level(self) -> float:
        """Least friction level [N]."""
        return max(0.0, min(float(_sum(one).low.min()) for one in self.levels.values()))

    def force_slope(self, name: str) -> float:
        """Largest slope of the force effects over an argument."""
        return _slope(self.forces, name)

    def level_slope(self, name: str) -> float:
        """Largest slope of the level over an argument."""
        return max(_slope(one, name) for one in self.levels.values())

    def slope(self, name: str, peak: float = 0.0) -> float:
        """Largest slope of forces and level, raised by a relative `peak`, over an argument."""
        return self.force_slope(name) + (1.0 + peak) * self.level_slope(name)

    def force_change(self, change: Change) -> float:
        """Largest difference of the force effects under a change of their arguments [N]."""
        return sum(_difference(law, change) for law in self.forces)

    def level_change(self, change: Change) -> float:
        """The same of the level, of the direction in which it is larger [N]."""
        return max(sum(_difference(law, change) for law in one) for one in self.levels.values())


def _sum(laws: tuple[Interval, ...]) -> Interval:
    return sum(laws, Interval.of_number(0.0))


def _slope(laws: tuple[Interval, ...], name: str) -> float:
    return sum(float(law.slopes[ARGUMENTS.index(name)].max()) for law in laws)


def _difference(law: Interval, change: Change) -> float:
    """Largest difference of two values of a law: by its slopes, at most from end to end."""
    total = 0.0
    for slope, by in zip(law.slopes, change, strict=True):
        largest = float(slope.max())
        total += largest * by if largest > 0.0 and by > 0.0 else 0.0
    return min(total, float(law.high.max() - law.low.min()))


def unbounded_effects(axis: FrictionAxis) -> tuple[str, ...]:
    """Effects of which no bounds are known."""
    acting = axis.effective()
    box = _box(Reach(*(acting.travel or ANYWHERE)), 1.0)
    rows = (effect for effect in acting.effects if effect.action not in _LINEAR)
    return tuple(effect.slug for effect in rows if effect.bounds(box) is None)


def largest_drive(axis: FrictionAxis) -> float:
    """Largest force that the drive's own effects let through, in both directions [N]."""
    drive = Interval.of_argument("u", -math.inf, math.inf)
    box = _box(Reach(*(axis.travel or ANYWHERE), speed=math.inf), 1.0)
    for effect in axis.effects:
        if effect.action == "input":
            found = effect.bounds(box._replace(u=drive))
            if found is None:
                return math.inf
            drive = found
    return float(min(np.min(drive.high), np.min(-drive.low)))


def laws_of(axis: FrictionAxis, reach: Reach) -> Laws:
    """Bounds of the laws of an axis, those that have none left out."""
    forces = []
    for effect in _effects_on(axis, "force"):
        # The directions, and rest, are one range: nothing says in which of them the axis is.
        found = (effect.bounds(_box(reach, s)) for s in (1.0, -1.0, 0.0))
        sides = [one for one in found if one is not None]
        if sides:
            forces.append(_interval_union(sides))
    return Laws(tuple(forces), {s: tuple(_levels(axis, reach, s)) for s in (1, -1)})


def _effects_on(axis: FrictionAxis, action: str) -> list[Effect]:
    return [effect for effect in axis.effects if effect.action == action]


def _levels(axis: FrictionAxis, reach: Reach, s: int) -> Iterator[Interval]:
    """Bounds of the map in one direction, and of what each effect adds to it."""
    # In the order, and with the levels, of `axis_step`.
    base = _map(axis, reach, s)
    yield base
    own = base
    box = _box(reach, float(s))
    effects = sorted(
        _effects_on(axis, "friction"),
        key=lambda e: (not e.within_peak, e.by_drive, not e.depends_on_direction),
    )
    for effect in effects:
        found = effect.bounds(box._replace(level=own if effect.within_peak else base))
        if found is None:
            continue
        found = _over_travel(found)
        own = own + found if effect.within_peak else own
        yield found


def _places(reach: Reach) -> Floats:
    return np.linspace(reach.low, reach.high, _PARTS + 1)


def _over_travel(law: Interval) -> Interval:
    """The law with an element for each part of the travel."""
    shape = (_PARTS,)
    low = np.broadcast_to(law.low, shape)
    high = np.broadcast_to(law.high, shape)
    slopes = law.slopes if law.slopes.ndim == 2 else law.slopes[:, None]
    return Interval(low, high, np.broadcast_to(slopes, (len(ARGUMENTS), *shape)))


def _interval_union(laws: list[Interval]) -> Interval:
    rows = [_over_travel(law) for law in laws]
    return Interval(
        np.minimum.reduce([law.low for law in rows]),
        np.maximum.reduce([law.high for law in rows]),
        np.maximum.reduce([law.slopes for law in rows]),
    )


def _box(reach: Reach, direction: float) -> Box:
    """Arguments of the laws, one element a part of the travel."""
    places = _places(reach)
    return Box(
        Interval.of_argument("t", 0.0, reach.time),
        Interval.of_argument("x", places[:-1], places[1:]),
        Interval.of_argument("v", -reach.speed, reach.speed),
        Interval.of_argument("u", -reach.load, reach.load),
        Interval.of_number(0.0),
        direction,
        Interval.of_argument("rest", 0.0, reach.rest),
    )


def _map(axis: FrictionAxis, reach: Reach, s: int) -> Interval:
    """Bounds of the Coulomb map in one direction, constant outside the travel."""
    coefficients = axis.coulomb.plus if s > 0 else axis.coulomb.minus
    low, high = axis.travel or (-math.inf, math.inf)
    places = np.clip(_places(reach), low, high)
    middle = 0.5 * (places[1:] + places[:-1])
    half = 0.5 * (places[1:] - places[:-1])
    level = np.polynomial.Polynomial(coefficients)
    # Taylor's polynomial about the middle of each part: value and slope at most so far off.
    derivatives = [level.deriv(k)(middle) if k else level(middle) for k in range(len(coefficients))]
    value = _taylor_remainder(derivatives, half, 1)
    slopes = np.zeros((len(ARGUMENTS), middle.size))
    if len(derivatives) > 1:
        steepest = np.abs(derivatives[1]) + _taylor_remainder(derivatives, half, 2)
        slopes[ARGUMENTS.index("x")] = steepest
    return Interval(derivatives[0] - value, derivatives[0] + value, slopes)


def _taylor_remainder(derivatives: list[Floats], half: Floats, first: int) -> Floats:
    """Terms of Taylor's polynomial from `first` on, of the derivative of order `first` - 1."""
    total = np.zeros(half.size)
    for k, one in enumerate(derivatives[first:], 1):
        total += np.abs(one) * half**k / math.factorial(k)
    return total


class Rest(NamedTuple):
    """Levels and forces at rest, where the held drive is nearest to the least level."""

    held: float  # largest level of which the held drive is a share [N]
    kept: float  # smallest level within the distance of that place [N]
    wander: float  # largest change of the force effects with time and within the distance [N]
    force: float  # largest sum of the force effects [N]
    uneven: bool  # whether levels depend on the place


def at_rest(axis: FrictionAxis, reach: Reach, share: float, distance: float) -> Rest:
    """Bounds of levels and force effects of an axis that rests for ever.

    The held drive is a `share` of the level, read up to a `distance` away.
    """
    still = reach._replace(speed=0.0, load=0.0, time=math.inf)
    forces = laws_of(axis, still).forces
    force = float(_sum(forces).magnitude.max())
    # A held drive is that of a law which knows no time at rest; the drive itself is a load, too.
    high = _lesser_level(axis, still._replace(load=2.0 * force, rest=0.0)).high
    load = 2.0 * force + share * float(high.max())
    low = np.maximum(_lesser_level(axis, still._replace(load=load)).low, 0.0)
    parts = math.ceil(distance * _PARTS / (reach.high - reach.low)) + 1
    kept = minimum_filter1d(low, min(2 * parts, 2 * _PARTS) + 1)
    worst = int(np.argmin(kept - share * high))
    wander = sum(_largest_change(law, distance) for law in forces)
    uneven = laws_of(axis, still).level_slope("x") > 0.0
    return Rest(float(high[worst]), float(kept[worst]), wander, force, uneven)


def _lesser_level(axis: FrictionAxis, reach: Reach) -> Interval:
    """Lesser level of both directions."""
    one, other = (_over_travel(_sum(levels)) for levels in laws_of(axis, reach).levels.values())
    low = np.minimum(one.low, other.low)
    high = np.minimum(one.high, other.high)
    return Interval(low, high, np.maximum(one.slopes, other.slopes))


def _largest_change(law: Interval, distance: float) -> float:
    """Largest change of a force effect with time, and over a distance [N]."""
    lasting = [ARGUMENTS.index(name) for name in ("t", "rest")]
    timed = math.inf if np.any(law.slopes[lasting] > 0.0) else 0.0
    return _difference(law, Change(time=timed, place=distance, rest=timed))
