"""Forces on the axis besides its friction: of place, speed, time or none."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from dryfric_control.arrays import Floats
from dryfric_control.model.effects.columns import (
    Column,
    View,
    fades,
    proportional_column,
    sine,
    sines,
)
from dryfric_control.model.effects.effect import (
    BaseAxis,
    Effect,
    Slopes,
    parameter,
    register_effect,
)
from dryfric_control.model.effects.interval import Box, Interval

# Travel in metres below which no position is taken for an angle that has lost its unit.
_ARC = 0.5
# Depths to which an axis runs into its stops, and how far beyond its travel one is that it does
# not reach, over the travel in the record.
_BEYOND = 0.05
_DEPTHS = tuple(np.geomspace(0.003, 0.3, 12))
# Largest line of a drive by which a loop answers a disturbance, over that.
_LARGEST_ANSWER = 2.0
# Order of the polynomial by which a force may depend on the position.
_HIGHEST_ORDER = 12
# Periods in a record below which a line of the drive is too wide to be told from others.
_SHARP = 10.0


@register_effect
class BiasForce(Effect):
    r"""Constant force on the mass.

    Notes
    -----
    .. math:: w \to w + \text{force}

    with w the force on the mass without friction.

    Examples
    --------
    Three newtons against a level of one move 2 kg at 1 m/s^2:

    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=0.0, coulomb=1.0,
    ...                         effects=(dfc.effects.BiasForce(force=3.0),))
    >>> resp = axis.simulate([0.0] * 1001, dt=1e-3)
    >>> round(float(resp.y[1, -1]), 9)
    1.0
    """

    force: float = parameter("N", "force, positive with x")

    action = "force"
    rank = 1
    trades = (
        "coulomb",
        "a bias and levels that differ between the directions are the same force as long as "
        "neither a Stribeck peak nor the position changes the levels: tilt the axis or turn it "
        "round to separate them",
    )
    explanation = (
        "A constant force pulls the axis to one side: gravity on a slope, a preloaded "
        "cable, or an offset of the amplifier."
    )
    experiment = "Crawl both ways at the same speed: the two levels differ by twice the bias."

    def slopes(self, axis: BaseAxis, speed: float) -> Slopes:
        return Slopes()

    @staticmethod
    def law(t, x, v, u, level, direction, rest, p):  # type: ignore[no-untyped-def]
        return p[0]

    def bounds(self, box: Box) -> Interval:
        return Interval.of_number(self.force)

    @classmethod
    def columns(cls, view: View) -> Iterator[Column]:
        yield proportional_column("force", np.ones_like(view.x))


@register_effect
class ViscousAsymmetry(Effect):
    r"""Viscous friction that differs between the directions.

    Notes
    -----
    .. math:: w \to w - \text{viscous} \cdot {|v|}

    so that the coefficient is f + viscous forwards and f - viscous backwards.

    Examples
    --------
    The same force gives another speed each way, (13 - 1)/(10 +- 2):

    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=0.1, viscous=10.0, coulomb=1.0,
    ...                         effects=(dfc.effects.ViscousAsymmetry(viscous=2.0),))
    >>> [round(float(axis.simulate([u] * 1000, dt=1e-3).y[1, -1]), 6) for u in (13.0, -13.0)]
    [1.0, -1.5]
    """

    viscous: float = parameter("N s/m", "half the difference, positive minus negative direction")

    action = "force"
    depends_on_direction = True
    rank = 17
    explanation = "Viscous friction is larger in one direction: a lip seal or a one-sided oil film."
    experiment = "Run at several constant velocities both ways and compare the slopes of the force."

    def slopes(self, axis: BaseAxis, speed: float) -> Slopes:
        return Slopes(velocity=abs(self.viscous))

    @staticmethod
    def law(t, x, v, u, level, direction, rest, p):  # type: ignore[no-untyped-def]
        return -p[0] * abs(v)

    def bounds(self, box: Box) -> Interval:
        return -self.viscous * abs(box.v)

    def viscous_in(self, direction: int) -> float:
        # Its coefficient with the sign of the direction.
        return direction * self.viscous

    @classmethod
    def columns(cls, view: View) -> Iterator[Column]:
        yield proportional_column("viscous", -np.abs(view.v))


@register_effect
class ViscousWarmUp(Effect):
    r"""Viscous friction that falls while the lubricant warms up.

    Notes
    -----
    .. math:: w \to w - \text{rise} \cdot e^{-t/\text{time constant}} \cdot v

    The viscous coefficient of the axis is that of the warm machine.  A negative rise is
    friction that grows towards it.

    Examples
    --------
    The same force gives twice the speed once it is warm, 5/(5 + 5) and 5/5:

    >>> import dryfric_control as dfc
    >>> warm_up = dfc.effects.ViscousWarmUp(rise=5.0, time_constant=1.0)
    >>> axis = dfc.FrictionAxis(mass=1e-3, viscous=5.0, coulomb=1.0, effects=(warm_up,))
    >>> v = axis.simulate([6.0] * 10001, dt=1e-3).y[1]
    >>> round(float(v[10]), 2), round(float(v[10000]), 2)
    (0.5, 1.0)
    """

    rise: float = parameter("N s/m", "viscous friction beyond that of the warm machine at t = 0")
    time_constant: float = parameter(
        "s", "time constant", bounds=(1e-300, math.inf), logarithmic=True
    )

    title = "viscous warm-up"
    action = "force"
    rank = 12.6
    explanation = (
        "Oil and grease get thinner as they warm up: viscous friction falls, quickly at first and "
        "then more slowly, until the machine is warm."
    )
    experiment = (
        "Repeat the same moves, slow and fast, from cold until the force no longer changes: that "
        "of the fast ones falls, that of a crawl stays."
    )

    def slopes(self, axis: BaseAxis, speed: float) -> Slopes:
        return Slopes(time=abs(self.rise) * speed / self.time_constant, velocity=abs(self.rise))

    @staticmethod
    def law(t, x, v, u, level, direction, rest, p):  # type: ignore[no-untyped-def]
        return -p[0] * math.exp(-t / p[1]) * v

    def bounds(self, box: Box) -> Interval:
        return -self.rise * (-box.t / self.time_constant).exponential() * box.v

    def base_at(self, axis: BaseAxis, t: float) -> tuple[str, float]:
        return "viscous", axis.viscous + self.rise * math.exp(-t / self.time_constant)

    def plausible(self, axis: BaseAxis) -> bool:
        # A cold lubricant resists, too: it does not drive.
        return axis.viscous + self.rise >= 0.0

    @classmethod
    def start(cls, axis: BaseAxis, size: Callable[[str], float]) -> ViscousWarmUp:
        # None yet.
        return cls(0.0, 10.0 * size("s"))

    @classmethod
    def columns(cls, view: View) -> Iterator[Column]:
        for time_constant, fade in fades(view):
            yield proportional_column("rise", -view.v * fade, time_constant=time_constant)


@register_effect
class QuadraticDrag(Effect):
    r"""Drag that grows with the square of velocity.

    Notes
    -----
    .. math:: w \to w - \text{drag} \cdot v {|v|}

    Examples
    --------
    Eight newtons above the Coulomb level hold sqrt(8/2) m/s:

    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=0.5, viscous=0.0, coulomb=1.0,
    ...                         effects=(dfc.effects.QuadraticDrag(drag=2.0),))
    >>> round(float(axis.simulate([9.0] * 3000, dt=1e-3).y[1, -1]), 6)
    2.0
    """

    drag: float = parameter("N s^2/m^2", "coefficient of v |v|", bounds=(0.0, math.inf))

    action = "force"
    rank = 4
    explanation = (
        "Air or liquid is displaced: the resistance grows with the square of the velocity."
    )
    experiment = "Run at constant velocities up to the highest: the force curve bends upwards."

    def slopes(self, axis: BaseAxis, speed: float) -> Slopes:
        return Slopes(velocity=2.0 * self.drag * speed)

    @staticmethod
    def law(t, x, v, u, level, direction, rest, p):  # type: ignore[no-untyped-def]
        return -p[0] * v * abs(v)

    def bounds(self, box: Box) -> Interval:
        return -self.drag * box.v * abs(box.v)

    @classmethod
    def columns(cls, view: View) -> Iterator[Column]:
        yield proportional_column("drag", -view.v * np.abs(view.v), positive=True)


@register_effect
class Spring(Effect):
    r"""Linear spring to the frame.

    Notes
    -----
    .. math:: w \to w - \text{stiffness} \cdot (x - \text{rest})

    Examples
    --------
    At rest friction holds the spring, 200 N/m over 4 mm:

    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0,
    ...                         effects=(dfc.effects.Spring(stiffness=200.0),))
    >>> round(float(axis.simulate([0.0] * 10, dt=1e-3, x0=4e-3).y[2, -1]), 9)
    -0.8
    """

    stiffness: float = parameter("N/m", "stiffness", bounds=(0.0, math.inf))
    rest: float = parameter("m", "position without spring force", default=0.0, kind="place")

    action = "force"
    adds_constant = "rest"
    rank = 3
    explanation = (
        "An elastic element pulls the axis back: a return spring, a cable loop, a bellows."
    )
    experiment = "Crawl over the whole travel: the mean of the two directions slopes with position."

    def slopes(self, axis: BaseAxis, speed: float) -> Slopes:
        return Slopes(place=self.stiffness)

    @staticmethod
    def law(t, x, v, u, level, direction, rest, p):  # type: ignore[no-untyped-def]
        return -p[0] * (x - p[1])

    def bounds(self, box: Box) -> Interval:
        return -self.stiffness * (box.x - self.rest)

    @classmethod
    def columns(cls, view: View) -> Iterator[Column]:
        # A line over position.
        def values(c: Sequence[float]) -> dict[str, float]:
            stiffness = max(float(c[0]), 1e-3 * view.size / view.span)
            away = float(np.clip(c[1] / stiffness, -20.0 * view.span, 20.0 * view.span))
            return {"stiffness": stiffness, "rest": view.middle + away}

        yield Column(values, (view.middle - view.x, np.ones_like(view.x)), positive=True)


@register_effect
class EndStop(Effect):
    r"""Elastic stops at both ends of the travel.

    Notes
    -----
    .. math:: w \to w - \max(0,\ \text{stiffness} \cdot d + \text{damping} \cdot \dot d)
        \quad \text{where } d = x - \text{high} > 0

    and likewise at the lower end: a stop pushes, it never pulls. A diagnosis does not name
    stops that lie closer together than friction holds the axis in both: they are a spring.

    Examples
    --------
    At 1 m/s, 2 kg run d = v sqrt(m/k) = 1 cm into a stop of 20 N/mm:

    >>> import dryfric_control as dfc
    >>> stop = dfc.effects.EndStop(low=-0.1, high=0.1, stiffness=2e4)
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=0.0, coulomb=0.0, effects=(stop,))
    >>> round(float(axis.simulate([0.0] * 200, dt=1e-3, v0=1.0).y[0].max()), 5)
    0.11
    """

    low: float = parameter("m", "position of the lower stop", kind="place")
    high: float = parameter("m", "position of the upper stop", kind="place")
    stiffness: float = parameter(
        "N/m", "stiffness", bounds=(1e-300, math.inf), logarithmic=True, neutral=None
    )
    damping: float = parameter("N s/m", "damping", bounds=(0.0, math.inf), default=0.0)

    action = "force"
    rank = 18
    explanation = "The axis runs into a stop, a buffer or a cable at an end of its travel."
    experiment = "Push the axis slowly against each end: from one position on the force rises."

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.low <= self.high:
            raise ValueError(
                f"end_stop.low = {self.low:g} must not lie above end_stop.high = {self.high:g}: "
                "exchange them, or put a stop that is never reached far away"
            )

    @property
    def stiffest(self) -> float:
        """Stiffness of the stops."""
        return self.stiffness

    @property
    def edges(self) -> tuple[float, ...]:
        """Places of the stops."""
        return self.low, self.high

    def plausible(self, axis: BaseAxis) -> bool:
        # An end has travel before it: where friction holds the axis deeper in both stops than they
        # lie apart, they are a spring.
        return self.stiffness * (self.high - self.low) >= axis.coulomb.mean

    def slopes(self, axis: BaseAxis, speed: float) -> Slopes:
        return Slopes(place=self.stiffness, velocity=self.damping)

    @staticmethod
    def law(t, x, v, u, level, direction, rest, p):  # type: ignore[no-untyped-def]
        if x > p[1]:
            return -max(p[2] * (x - p[1]) + p[3] * v, 0.0)
        if x < p[0]:
            return max(p[2] * (p[0] - x) - p[3] * v, 0.0)
        return 0.0

    def bounds(self, box: Box) -> Interval:
        # Each stop pushes from its place on; where a damped one is met, its force jumps.
        above = (box.x - self.high).clip(low=0.0)
        below = (self.low - box.x).clip(low=0.0)
        pushes = []
        for into, speed in ((above, box.v), (below, -box.v)):
            push = (self.stiffness * into + self.damping * speed).clip(low=0.0)
            pushes.append(push.where(into.high > 0.0))
        force = pushes[1] - pushes[0]
        return force.with_jump("v") if self.damping > 0.0 else force

    @classmethod
    def start(cls, axis: BaseAxis, size: Callable[[str], float]) -> EndStop:
        low, high = axis.travel or (-size("m"), size("m"))
        return cls(low, high, 1e-3 * size("N/m"))

    @classmethod
    def columns(cls, view: View) -> Iterator[Column]:
        # A force may be steep: its place is searched from the ends of the travel inwards. A stop
        # that is not reached stays beyond them.
        low = view.middle - 0.5 * view.span
        high = view.middle + 0.5 * view.span
        for depth, sides in itertools.product(_DEPTHS, ((0, 1), (1, 0), (1, 1))):
            deep = [view.span * (depth if side else -_BEYOND) for side in sides]
            ends = low + deep[0], high - deep[1]
            into = np.minimum(view.x - ends[0], 0.0) + np.maximum(view.x - ends[1], 0.0)

            def values(c: Sequence[float], ends: tuple[float, float] = ends) -> dict[str, float]:
                return {
                    "low": ends[0], "high": ends[1], "stiffness": max(float(c[0]), 1e-300),
                    "damping": max(float(c[1]), 0.0),
                }  # fmt: skip

            if np.any(into):
                yield Column(values, (-into, -view.v * (into != 0.0)), positive=True)


@register_effect
class Gravity(Effect):
    r"""Gravity on a rotary axis.

    Notes
    -----
    .. math:: w \to w - \text{amplitude} \cdot \sin(x - \text{phase})

    A diagnosis does not try it on an axis in metres that moves by less than 0.5 m: what a
    linear axis shows there is a spring.

    Examples
    --------
    A level arm rests on friction, which carries its weight:

    >>> import math
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=0.1, viscous=0.1, coulomb=1.0,
    ...                         effects=(dfc.effects.Gravity(amplitude=0.5),))
    >>> round(float(axis.simulate([0.0] * 10, dt=1e-3, x0=math.pi / 2).y[2, -1]), 9)
    -0.5
    """

    amplitude: float = parameter("N m", "largest torque m g l", bounds=(0.0, math.inf))
    phase: float = parameter("rad", "position at which the arm hangs", default=0.0, kind="angle")

    title = "gravity on a rotary axis"
    action = "force"
    rank = 15
    explanation = "The weight of the arm is a torque with the sine of its angle from hanging."
    experiment = "Crawl through a full turn: the mean of the two directions is a sine of the angle."

    @property
    def shortest_length(self) -> float:
        """A quarter of a turn [rad]."""
        return 0.5 * math.pi if self.amplitude > 0.0 else math.inf

    @property
    def periods(self) -> tuple[float, float]:
        """It repeats with every turn."""
        return math.inf, 2.0 * math.pi

    def slopes(self, axis: BaseAxis, speed: float) -> Slopes:
        return Slopes(place=self.amplitude)

    @staticmethod
    def law(t, x, v, u, level, direction, rest, p):  # type: ignore[no-untyped-def]
        return -p[0] * math.sin(x - p[1])

    def bounds(self, box: Box) -> Interval:
        return -self.amplitude * (box.x - self.phase).sine()

    @classmethod
    def columns(cls, view: View) -> Iterator[Column]:
        if view.axis.units[0] != "m" or view.span >= _ARC:
            # A sine of the position, the other way round.
            yield Column(sine(), (-np.sin(view.x), np.cos(view.x)))


@register_effect
class Cogging(Effect):
    r"""Force that repeats with position.

    Notes
    -----
    .. math:: w \to w + \text{amplitude} \cdot \sin(2\pi x / \text{period} + \text{phase})

    Examples
    --------
    A quarter of a period from zero it pushes with its amplitude:

    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0,
    ...                         effects=(dfc.effects.Cogging(amplitude=3.0, period=0.01),))
    >>> round(float(axis.simulate([0.0] * 10, dt=1e-3, x0=2.5e-3).y[2, -1]), 9)
    3.0
    """

    amplitude: float = parameter("N", "amplitude", bounds=(0.0, math.inf))
    period: float = parameter("m", "period", bounds=(1e-300, math.inf))
    phase: float = parameter("rad", "phase at x = 0", default=0.0, kind="angle")

    action = "force"
    rank = 13
    repeats = True
    explanation = "The magnets of the motor, or the pitch of a screw, cause a force that repeats."
    experiment = "Crawl slowly over many pitches: the force ripples with position, not with time."

    @property
    def shortest_length(self) -> float:
        """A quarter of the period."""
        return 0.25 * self.period if self.amplitude > 0.0 else math.inf

    @property
    def periods(self) -> tuple[float, float]:
        """It repeats along the travel."""
        return math.inf, self.period

    def slopes(self, axis: BaseAxis, speed: float) -> Slopes:
        return Slopes(place=2.0 * math.pi * self.amplitude / self.period)

    @staticmethod
    def law(t, x, v, u, level, direction, rest, p):  # type: ignore[no-untyped-def]
        return p[0] * math.sin(2.0 * math.pi * x / p[1] + p[2])

    def bounds(self, box: Box) -> Interval:
        return self.amplitude * (box.x * (2.0 * math.pi / self.period) + self.phase).sine()

    @classmethod
    def columns(cls, view: View) -> Iterator[Column]:
        yield from sines(view, "force")


@register_effect
class PositionForce(Effect):
    r"""Force of any smooth shape over the travel.

    Notes
    -----
    .. math:: w \to w + \sum_{k=0}^{12} c_k\, T_k(q), \quad
        q = \frac{x - \text{middle}}{\text{reach}}

    with T_k the Chebyshev polynomials; beyond the travel, where q is outside -1 to 1, the force is
    that at its end.  A diagnosis tries it last, where no effect with a law of its own explains the
    records.

    Examples
    --------
    A cable chain whose force falls over the travel, and bends:

    >>> import dryfric_control as dfc
    >>> chain = dfc.effects.PositionForce(middle=0.2, reach=0.2, c1=-3.0, c2=1.0)
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0, effects=(chain,))
    >>> [round(float(axis.simulate([0.0] * 10, dt=1e-3, x0=x).y[2, -1]), 9) for x in (0, 0.2, 0.4)]
    [4.0, -1.0, -2.0]
    """

    middle: float = parameter("m", "middle of the travel", kind="place", free=False)
    reach: float = parameter("m", "half of the travel", bounds=(1e-300, math.inf), free=False)
    c0: float = parameter("N", "constant force", default=0.0)
    c1: float = parameter("N", "coefficient of the line", default=0.0)
    c2: float = parameter("N", "coefficient of the parabola", default=0.0)
    c3: float = parameter("N", "coefficient of T3", default=0.0)
    c4: float = parameter("N", "coefficient of T4", default=0.0)
    c5: float = parameter("N", "coefficient of T5", default=0.0)
    c6: float = parameter("N", "coefficient of T6", default=0.0)
    c7: float = parameter("N", "coefficient of T7", default=0.0)
    c8: float = parameter("N", "coefficient of T8", default=0.0)
    c9: float = parameter("N", "coefficient of T9", default=0.0)
    c10: float = parameter("N", "coefficient of T10", default=0.0)
    c11: float = parameter("N", "coefficient of T11", default=0.0)
    c12: float = parameter("N", "coefficient of T12", default=0.0)

    title = "force that depends on the position"
    action = "force"
    adds_constant = "c0"
    any_shape = True
    rank = 30
    explanation = (
        "A force follows the position by a law of its own: a cable chain, a linkage or a cam, a "
        "counterbalance, magnets."
    )
    experiment = "Crawl over the whole travel: the mean of the two directions is this force."

    @property
    def edges(self) -> tuple[float, ...]:
        """Ends of the travel, beyond which the force stays."""
        return self.middle - self.reach, self.middle + self.reach

    @property
    def shortest_length(self) -> float:
        """The travel over twice the highest order: a quarter of its wave in the middle."""
        return math.inf if not any(self.values[2:]) else self.reach / _HIGHEST_ORDER

    def slopes(self, axis: BaseAxis, speed: float) -> Slopes:
        # The slope of T_k is at most k^2, at the ends.
        steepest = sum(k * k * abs(c) for k, c in enumerate(self.values[2:]))
        return Slopes(place=steepest / self.reach)

    @staticmethod
    def law(t, x, v, u, level, direction, rest, p):  # type: ignore[no-untyped-def]
        q = min(max((x - p[0]) / p[1], -1.0), 1.0)
        # Clenshaw's recurrence.
        later = 0.0
        force = p[14]
        for k in range(13, 2, -1):
            before = later
            later = force
            force = p[k] + 2.0 * q * later - before
        return p[2] + q * force - later

    def bounds(self, box: Box) -> Interval:
        q = ((box.x - self.middle) * (1.0 / self.reach)).clip(low=-1.0, high=1.0)
        return q.chebyshev(self.values[2:])

    def meaning(self, units: tuple[str, str]) -> str:
        places = self.middle + self.reach * np.linspace(-1.0, 1.0, 5)
        forces = (self.law(0.0, x, 0.0, 0.0, 0.0, 0.0, 0.0, self.values) for x in places)
        shown = ", ".join(f"{f:.3g}" for f in forces)
        low, high = (f"{x:.3g}" for x in places[[0, -1]])
        return f"{shown} {units[1]} at five places from x = {low} to {high} {units[0]}"

    @classmethod
    def columns(cls, view: View) -> Iterator[Column]:
        ends = {"middle": view.middle, "reach": 0.5 * view.span}
        names = [f"c{k}" for k in range(_HIGHEST_ORDER + 1)]

        def values(c: Sequence[float]) -> dict[str, float]:
            return ends | dict(zip(names, map(float, c), strict=False))

        q = np.clip((view.x - ends["middle"]) / ends["reach"], -1.0, 1.0)
        yield Column(values, tuple(np.cos(k * np.arccos(q)) for k in range(_HIGHEST_ORDER + 1)))


@register_effect
class TimePeriodic(Effect):
    r"""Force that repeats with time.

    Notes
    -----
    .. math:: w \to w + \text{amplitude}
        \cdot \sin(2\pi \cdot \text{frequency} \cdot t + \text{phase})

    Examples
    --------
    It overcomes half its amplitude after a twelfth of a period:

    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0,
    ...                         effects=(dfc.effects.TimePeriodic(amplitude=16.0, frequency=0.25),))
    >>> round(float(axis.simulate([0.0] * 1000, dt=1e-3).events.time[0]), 6)
    0.333333
    """

    amplitude: float = parameter("N", "amplitude", bounds=(0.0, math.inf))
    frequency: float = parameter("Hz", "frequency", bounds=(0.0, math.inf))
    phase: float = parameter("rad", "phase at t = 0", default=0.0, kind="angle")

    title = "disturbance periodic in time"
    action = "force"
    rank = 14
    repeats = True
    explanation = "Something else excites the axis: a pump, a fan, another machine, the mains."
    experiment = "Run the axis at several velocities and at rest: the frequency stays the same."

    @property
    def shortest_time(self) -> float:
        """An eighth of a period [s]."""
        if self.amplitude == 0.0 or self.frequency < 1e-300:
            return math.inf
        return 0.125 / self.frequency

    def told_from_drive(self, u: Floats, dt: float) -> bool:
        # A loop answers a disturbance by about as large a force: a far larger line of the drive is
        # of the reference, and any law of the motion has a force of its frequency.
        if self.frequency * dt * u.size < _SHARP:
            return True
        window = np.hanning(u.size)
        turn = np.exp(-2j * np.pi * self.frequency * dt * np.arange(u.size))
        line = 2.0 * abs(window @ (u * turn)) / max(float(window.sum()), 1e-300)
        return bool(line < _LARGEST_ANSWER * self.amplitude)

    @property
    def periods(self) -> tuple[float, float]:
        """It repeats in time."""
        return 1.0 / self.frequency if self.frequency > 1e-300 else math.inf, math.inf

    def slopes(self, axis: BaseAxis, speed: float) -> Slopes:
        return Slopes(time=2.0 * math.pi * self.frequency * self.amplitude)

    @staticmethod
    def law(t, x, v, u, level, direction, rest, p):  # type: ignore[no-untyped-def]
        return p[0] * math.sin(2.0 * math.pi * p[1] * t + p[2])

    def bounds(self, box: Box) -> Interval:
        return self.amplitude * (box.t * (2.0 * math.pi * self.frequency) + self.phase).sine()

    @classmethod
    def columns(cls, view: View) -> Iterator[Column]:
        yield from sines(view, "time")
