"""Dry friction whose level depends on direction, place, load, time or rest."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import least_squares

from dryfric_control.arrays import Floats
from dryfric_control.model.effects.columns import (
    PARTS,
    Column,
    View,
    breakaway_levels,
    fades,
    friction,
    peaks,
    proportional_column,
    simulated_column,
    sines,
)
from dryfric_control.model.effects.effect import (
    BaseAxis,
    Effect,
    Slopes,
    parameter,
    register_effect,
)
from dryfric_control.model.effects.forces import BiasForce
from dryfric_control.model.effects.interval import Box, Interval
from dryfric_control.model.effects.naming import named

# Largest slope of exp(-q^2).
_STEEPEST_PEAK = math.sqrt(2.0 / math.e)
# Largest fraction of the load that may be lost to friction.
_NEARLY_ALL = 0.5
# Half the difference of the levels of both directions over their mean, at most: three to one.
_ONE_SIDED = 0.5
# Least number of rests of different lengths that tell how a level grows.
_LEAST_RESTS = 4
# Largest scatter of the levels about how they grow, over that about their median, that tells it.
_TOLD_SCATTER = 0.5


@register_effect
class CoulombAsymmetry(Effect):
    r"""Coulomb level that differs between the directions.

    Notes
    -----
    .. math:: F_c \to F_c + s \cdot \text{force}, \quad s = \pm 1 \text{ the direction}

    Examples
    --------
    With levels of 9 N forwards and 7 N backwards, 8 N move it one way only:

    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0,
    ...                         effects=(dfc.effects.CoulombAsymmetry(force=1.0),))
    >>> [int(axis.simulate([u] * 10, dt=1e-3).mode[-1]) for u in (8.0, -8.0)]
    [0, -1]
    """

    force: float = parameter("N", "half the difference, positive minus negative direction")

    title = "Coulomb asymmetry"
    action = "friction"
    depends_on_direction = True
    rank = 16
    trades = BiasForce.trades
    explanation = "Dry friction is larger in one direction: a worn or preloaded contact, a wedge."
    experiment = (
        "Crawl in both directions at the same speed and compare the levels; tilt the axis to "
        "separate it from a bias."
    )

    def slopes(self, axis: BaseAxis, speed: float) -> Slopes:
        return Slopes()

    @staticmethod
    def law(t, x, v, u, level, direction, rest, p):  # type: ignore[no-untyped-def]
        return p[0] if direction > 0.0 else -p[0]

    def bounds(self, box: Box) -> Interval:
        return Interval.of_number(box.direction * self.force)

    def plausible(self, axis: BaseAxis) -> bool:
        # Friction resists both ways; nearly all of it one way is a constant force.
        return abs(self.force) <= _ONE_SIDED * axis.coulomb.mean

    @classmethod
    def columns(cls, view: View) -> Iterator[Column]:
        yield proportional_column("force", -np.abs(view.direction) * view.lift)


@register_effect
class PositionDependence(Effect):
    r"""Coulomb level that changes along the travel.

    Notes
    -----
    .. math:: F_c \to F_c \left(1 + \text{slope} \cdot q + \text{curvature} \cdot q^2\right)

    with q = x - centre.

    Examples
    --------
    A drive of 8.5 N moves it where the level is 8 N, not where it is 8.8 N:

    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0,
    ...                         effects=(dfc.effects.PositionDependence(slope=1.0),))
    >>> [int(axis.simulate([8.5] * 10, dt=1e-3, x0=x).mode[-1]) for x in (0.0, 0.1)]
    [1, 0]
    """

    slope: float = parameter("1/m", "relative change per length")
    curvature: float = parameter("1/m^2", "coefficient of the square", default=0.0)
    centre: float = parameter(
        "m", "position of the unchanged level", default=0.0, kind="place", free=False
    )

    title = "position-dependent friction"
    action = "friction"
    rank = 7
    explanation = "Dry friction differs along the travel: wear, misalignment, a bent screw or rail."
    experiment = "Crawl over the whole travel in both directions and plot the force over position."

    def slopes(self, axis: BaseAxis, speed: float) -> Slopes:
        # Without a travel up to where the curvature alone adds the level once more.
        steepest = 2.0 * math.sqrt(abs(self.curvature))
        if axis.travel is not None:
            reach = max(abs(end - self.centre) for end in axis.travel)
            steepest = 2.0 * abs(self.curvature) * reach
        return Slopes(place=abs(self.slope) + steepest, relative=1.0)

    @staticmethod
    def law(t, x, v, u, level, direction, rest, p):  # type: ignore[no-untyped-def]
        q = x - p[2]
        return level * (p[0] + p[1] * q) * q

    def bounds(self, box: Box) -> Interval:
        q = box.x - self.centre
        return box.level * (self.slope * q + self.curvature * q.square())

    def meaning(self, units: tuple[str, str]) -> str:
        # The level as a formula.
        return (
            "level = Coulomb level of the axis * (1 + slope q + curvature q^2) with "
            f"q = x - centre, centre = {self.centre:.4g} {units[0]}"
        )

    @classmethod
    def columns(cls, view: View) -> Iterator[Column]:
        # A parabola over position, about the middle of the travel.
        q = view.x - view.middle
        level = friction(view)

        def values(c: Sequence[float]) -> dict[str, float]:
            return {"slope": float(c[0]), "curvature": float(c[1]), "centre": view.middle}

        yield Column(values, (level * q, level * q**2))


@register_effect
class FrictionRipple(Effect):
    r"""Coulomb level that repeats along the travel.

    Notes
    -----
    .. math:: F_c \to F_c \left(1 + \text{amplitude} \cdot
        \sin(2\pi x / \text{period} + \text{phase})\right)

    Examples
    --------
    A drive of 7 N moves it where the level is 6 N, not where it is 10 N:

    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0,
    ...                         effects=(dfc.effects.FrictionRipple(amplitude=0.25, period=0.04),))
    >>> [int(axis.simulate([7.0] * 10, dt=1e-3, x0=x).mode[-1]) for x in (0.01, 0.03)]
    [0, 1]
    """

    amplitude: float = parameter("1", "amplitude over the level", bounds=(0.0, 1.0), size=0.1)
    period: float = parameter("m", "period", bounds=(1e-300, math.inf))
    phase: float = parameter("rad", "phase at x = 0", default=0.0, kind="angle")

    action = "friction"
    rank = 13.5
    repeats = True
    explanation = (
        "Dry friction repeats along the travel: a bent screw, a shaft or seal that is not round, "
        "the waves of a harmonic drive."
    )
    experiment = (
        "Crawl both ways over many periods: half the difference of the two forces ripples with "
        "position; their mean does so with cogging."
    )

    @property
    def shortest_length(self) -> float:
        """A quarter of the period."""
        return 0.25 * self.period if self.amplitude > 0.0 else math.inf

    @property
    def periods(self) -> tuple[float, float]:
        """It repeats along the travel."""
        return math.inf, self.period

    def slopes(self, axis: BaseAxis, speed: float) -> Slopes:
        return Slopes(place=2.0 * math.pi * self.amplitude / self.period, relative=1.0)

    @staticmethod
    def law(t, x, v, u, level, direction, rest, p):  # type: ignore[no-untyped-def]
        return level * p[0] * math.sin(2.0 * math.pi * x / p[1] + p[2])

    def bounds(self, box: Box) -> Interval:
        wave = (box.x * (2.0 * math.pi / self.period) + self.phase).sine()
        return box.level * (self.amplitude * wave)

    @classmethod
    def columns(cls, view: View) -> Iterator[Column]:
        for one in sines(view, "friction"):
            yield one._replace(most=1.0)


class LoadFriction(Effect):
    """Friction under the force that a transmission carries, or under the drive alone."""

    coefficient: float
    of_drive: float

    action = "friction"
    within_peak = False

    def slopes(self, axis: BaseAxis, speed: float) -> Slopes:
        return Slopes(load=abs(self.coefficient))

    @property
    def by_drive(self) -> bool:
        """Whether its load is the drive alone."""
        return self.of_drive >= 0.5

    def meaning(self, units: tuple[str, str]) -> str:
        return "it grows with the drive alone, as the loss of a gear" if self.by_drive else ""

    def forms(self, axis: BaseAxis) -> tuple[Effect, ...]:
        return (replace(self, **{"of_drive": 1.0 - round(self.of_drive)}),)

    @classmethod
    def of_loads(cls, view: View, sign: Floats, positive: bool) -> Iterator[Column]:
        """Columns under the load of the transmission, and under the drive.

        Parameters
        ----------
        view : View
        sign : ndarray
            Sign of the force for a positive coefficient, shape (n,).
        positive : bool
            Whether the coefficient must be.
        """
        for load, of_drive in ((view.carried, 0.0), (view.drive, 1.0)):
            force = sign * np.abs(load)
            one = proportional_column("coefficient", force, positive, of_drive=of_drive)
            yield one._replace(most=_NEARLY_ALL)


@register_effect
class LoadDependence(LoadFriction):
    r"""Friction that grows with the transmitted force.

    Notes
    -----
    .. math:: F_c \to F_c + \text{coefficient} \cdot {|u - e|}

    with the drive u and the sum e of the force effects, or with ``of_drive=1`` the drive alone,
    whether it lifts or lowers a weight; the former as in the load-dependent model of
    Duclusaud, Passault, Padois and Ly (2025).  The Stribeck peak does not raise this part: it is
    the friction of another contact.  Behind a play or a compliance u is what the transmission
    carries: without the inertia of the motor, and nothing inside the play.

    Examples
    --------
    Half of the 20 N that it transmits is lost, and 8 N of its own:

    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=0.0, coulomb=8.0,
    ...                         effects=(dfc.effects.LoadDependence(coefficient=0.5),))
    >>> round(float(axis.simulate([20.0] * 1001, dt=1e-3).y[1, -1]), 9)
    1.0
    """

    coefficient: float = parameter("1", "added friction over the load", bounds=(0.0, 1.0), size=0.1)
    of_drive: float = parameter(
        "1", "from 0.5 on the load is the drive alone, as of a gear that a motor turns",
        bounds=(0.0, 1.0), kind="share", default=0.0, free=False,
    )  # fmt: skip

    title = "load-dependent friction"
    rank = 10
    explanation = "The force transmitted by a gear or screw presses its teeth together: friction."
    experiment = "Repeat a motion with different loads, also braking: friction follows the load."

    @staticmethod
    def law(t, x, v, u, level, direction, rest, p):  # type: ignore[no-untyped-def]
        return p[0] * abs(u)

    def bounds(self, box: Box) -> Interval:
        return self.coefficient * abs(box.u)

    @classmethod
    def columns(cls, view: View) -> Iterator[Column]:
        yield from cls.of_loads(view, -view.direction, positive=True)


def equivalent_values(axis: BaseAxis, scale: float) -> dict[str, float]:
    """Values of an axis that moves alike beside load-dependent friction of 1 - scale.

    Friction of F_c + c (N - e) under N = m_l a + f v + F - e, the force that the teeth carry,
    looks like the mass of the load, viscous friction and level over (1 - c), and like the forces
    e times (1 + c)/(1 - c), while the drive does not brake; a motor's mass before a play or a
    spring stays.
    """
    now = {"mass": axis.mass, "viscous": axis.viscous, "coulomb": axis.coulomb.mean}
    changed = {name: scale * value for name, value in now.items()}
    factors = {"force": scale / (2.0 - scale), "friction": scale}
    for name, effect in named(axis).items():
        for own, kind in effect.parameters().items():
            value = getattr(effect, own)
            if kind["kind"] == "share" and kind["free"]:
                rest = 1.0 - value + scale * value
                changed |= {"mass": rest * axis.mass, f"{name}.{own}": scale * value / rest}
            elif kind["unit"][:1] == "N" and effect.action in factors:
                changed[f"{name}.{own}"] = factors[effect.action] * value
    return changed


@register_effect
class LoadAsymmetry(LoadFriction):
    r"""Load-dependent friction that differs between the directions.

    Notes
    -----
    .. math:: F_c \to F_c + s \cdot \text{coefficient} \cdot {|u - e|}, \quad s = \pm 1
        \text{ the direction}

    with the drive u and the sum e of the force effects, or with ``of_drive=1`` the drive alone.
    The Stribeck peak does not raise this part, and no level falls below zero.

    Examples
    --------
    Of 20 N a quarter is lost forwards, and a quarter gained backwards:

    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=0.0, coulomb=8.0,
    ...                         effects=(dfc.effects.LoadAsymmetry(coefficient=0.25),))
    >>> [round(float(axis.simulate([u] * 1001, dt=1e-3).y[1, -1]), 9) for u in (20.0, -20.0)]
    [3.5, -8.5]
    """

    coefficient: float = parameter(
        "1", "half the difference of added friction over the load", bounds=(-1.0, 1.0), size=0.1
    )
    of_drive: float = parameter(
        "1", "from 0.5 on the load is the drive alone, as of a gear that a motor turns",
        bounds=(0.0, 1.0), kind="share", default=0.0, free=False,
    )  # fmt: skip

    title = "load-dependent friction by direction"
    depends_on_direction = True
    rank = 17
    explanation = (
        "The force transmitted by a worm or a screw presses one flank more than the other: "
        "friction depends on the load more in one direction."
    )
    experiment = "Repeat a motion both ways under other loads: friction over load has two slopes."

    @staticmethod
    def law(t, x, v, u, level, direction, rest, p):  # type: ignore[no-untyped-def]
        return p[0] * abs(u) if direction > 0.0 else -p[0] * abs(u)

    def bounds(self, box: Box) -> Interval:
        return box.direction * self.coefficient * abs(box.u)

    @classmethod
    def columns(cls, view: View) -> Iterator[Column]:
        yield from cls.of_loads(view, -np.abs(view.direction), positive=False)


@register_effect
class StribeckAsymmetry(Effect):
    r"""Stribeck peak that differs between the directions.

    Notes
    -----
    .. math:: F_c \to F_c \left(1 + s \cdot \text{difference} \cdot
        e^{-(v/\text{speed})^2}\right), \quad s = \pm 1 \text{ the direction}

    F_c is the level of the axis' own Coulomb map, at that place and in that direction: neither
    the Stribeck peak nor what other effects add counts.  With a Stribeck peak of the same
    velocity, each direction has its own excess, difference added to or subtracted from it.

    Examples
    --------
    Breakaway takes 10 N forwards and 6 N backwards:

    >>> import dryfric_control as dfc
    >>> peak = dfc.effects.StribeckAsymmetry(difference=0.25, speed=0.01)
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0, effects=(peak,))
    >>> [int(axis.simulate([u] * 10, dt=1e-3).mode[-1]) for u in (9.9, 10.1, -5.9, -6.1)]
    [0, 1, 0, -1]
    """

    difference: float = parameter(
        "1", "half the difference of the excess of the own Coulomb level, positive minus negative",
        bounds=(-10.0, 10.0), breaks_away=True, size=1.0,
    )  # fmt: skip
    speed: float = parameter(
        "m/s", "velocity over which it decays", bounds=(1e-300, math.inf), breaks_away=True,
        logarithmic=True, kind="speed",
    )  # fmt: skip

    title = "Stribeck peak by direction"
    action = "friction"
    depends_on_direction = True
    within_peak = False
    rank = 22
    explanation = (
        "At low velocity friction is higher in one direction than in the other: a lip seal that "
        "scrapes the oil off in one direction only."
    )
    experiment = "Crawl ever more slowly in both directions and compare the levels at equal speed."

    def slopes(self, axis: BaseAxis, speed: float) -> Slopes:
        steepest = _STEEPEST_PEAK * abs(self.difference) / self.speed
        return Slopes(velocity=steepest, relative=1.0, bend=self.speed)

    @staticmethod
    def law(t, x, v, u, level, direction, rest, p):  # type: ignore[no-untyped-def]
        q = v / p[1]
        if q * q > 40.0:
            return 0.0
        rise = level * p[0] * math.exp(-q * q)
        return rise if direction > 0.0 else -rise

    def bounds(self, box: Box) -> Interval:
        return box.direction * self.difference * box.level * (box.v / self.speed).bell()

    @classmethod
    def start(cls, axis: BaseAxis, size: Callable[[str], float]) -> StribeckAsymmetry:
        # None yet, as narrow as a Stribeck peak starts.
        return cls(0.0, max(axis.stick_speed, 0.02 * size("m/s")))

    @classmethod
    def columns(cls, view: View) -> Iterator[Column]:
        yield from peaks(view, "difference", -np.abs(view.direction) * view.level)


@register_effect
class VelocityStrengthening(Effect):
    r"""Friction that is lower at rest and rises to its level.

    Notes
    -----
    .. math:: F_c \to F_c \left(1 - \text{deficit} \cdot
        (1 - \tanh({|v|}/\text{speed}))\right)

    F_c is the level of the axis' own Coulomb map, at that place and in that direction: neither
    the Stribeck peak nor what other effects add counts.  At constant force motion is stable at
    every velocity: an axis does not stick and slip.

    Examples
    --------
    Five newtons move an axis whose friction is 8 N at speed:

    >>> import dryfric_control as dfc
    >>> film = dfc.effects.VelocityStrengthening(deficit=0.5, speed=0.02)
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0, effects=(film,))
    >>> run = axis.simulate([5.0] * 4000, dt=1e-3)
    >>> int(run.mode[-1]), bool(run.y[1, -1] < 0.01)
    (1, True)
    """

    deficit: float = parameter(
        "1", "share of the axis' own Coulomb level missing at rest", bounds=(0.0, 1.0)
    )
    speed: float = parameter(
        "m/s",
        "velocity over which it rises",
        bounds=(1e-300, math.inf),
        logarithmic=True,
        kind="speed",
    )

    action = "friction"
    within_peak = False
    rank = 9.5
    explanation = (
        "Friction rises with velocity from a lower level at rest: a film of grease, or a soft "
        "seal, that resists more the faster it is sheared."
    )
    experiment = "Crawl ever more slowly in both directions: the level falls towards rest."

    def slopes(self, axis: BaseAxis, speed: float) -> Slopes:
        return Slopes(velocity=self.deficit / self.speed, relative=1.0, bend=self.speed)

    @staticmethod
    def law(t, x, v, u, level, direction, rest, p):  # type: ignore[no-untyped-def]
        return -level * p[0] * (1.0 - math.tanh(abs(v) / p[1]))

    def bounds(self, box: Box) -> Interval:
        return -self.deficit * box.level * (1.0 - (abs(box.v) / self.speed).tanh())

    @classmethod
    def start(cls, axis: BaseAxis, size: Callable[[str], float]) -> VelocityStrengthening:
        # None yet, within a part of the speeds of the record.
        return cls(0.0, max(axis.stick_speed, 0.1 * size("m/s")))

    @classmethod
    def columns(cls, view: View) -> Iterator[Column]:
        for part in PARTS:
            missing = 1.0 - np.tanh(np.abs(view.v) / (part * view.fast))
            force = view.direction * view.level * missing
            yield proportional_column("deficit", force, positive=True, speed=part * view.fast)


@register_effect
class WarmUp(Effect):
    r"""Friction that falls exponentially while the machine warms up.

    Notes
    -----
    .. math:: F_c \to F_c \left(1 + \text{rise} \cdot e^{-t/\text{time constant}}\right)

    The level of the axis is that of the warm machine.  A negative rise is friction
    that grows towards it.

    Examples
    --------
    Of an excess of one half, ln 2 time constants leave a quarter, 10 N in all:

    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0,
    ...                         effects=(dfc.effects.WarmUp(rise=0.5, time_constant=0.5),))
    >>> round(float(axis.simulate([10.0] * 1000, dt=1e-3).events.time[0]), 6)
    0.346574
    """

    rise: float = parameter("1", "relative excess of the level at t = 0", bounds=(-1.0, math.inf))
    time_constant: float = parameter(
        "s", "time constant", bounds=(1e-300, math.inf), logarithmic=True
    )

    title = "warm-up"
    action = "friction"
    rank = 12.5
    explanation = (
        "A cold machine has stiffer grease: friction falls, quickly at first and then more slowly, "
        "until it is warm."
    )
    experiment = "Repeat the same crawl from cold until the force no longer changes."

    def slopes(self, axis: BaseAxis, speed: float) -> Slopes:
        return Slopes(time=abs(self.rise) / self.time_constant, relative=1.0)

    @staticmethod
    def law(t, x, v, u, level, direction, rest, p):  # type: ignore[no-untyped-def]
        return level * p[0] * math.exp(-t / p[1])

    def base_at(self, axis: BaseAxis, t: float) -> tuple[str, float]:
        factor = 1.0 + self.rise * math.exp(-t / self.time_constant)
        return "coulomb", factor * axis.coulomb.mean

    def bounds(self, box: Box) -> Interval:
        return self.rise * box.level * (-box.t / self.time_constant).exponential()

    @classmethod
    def start(cls, axis: BaseAxis, size: Callable[[str], float]) -> WarmUp:
        # None yet.
        return cls(0.0, 10.0 * size("s"))

    @classmethod
    def columns(cls, view: View) -> Iterator[Column]:
        for time_constant, fade in fades(view):
            force = -view.direction * view.level * view.lift * fade
            yield proportional_column("rise", force, time_constant=time_constant)


@register_effect
class Drift(Effect):
    r"""Friction level that changes over the record.

    Notes
    -----
    .. math:: F_c \to F_c \left(1 + \text{rate} \cdot t\right)

    Examples
    --------
    Friction that falls by a tenth a second lets go of 7.6 N after 0.5 s:

    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0,
    ...                         effects=(dfc.effects.Drift(rate=-0.1),))
    >>> round(float(axis.simulate([7.6] * 1000, dt=1e-3).events.time[0]), 6)
    0.5
    """

    rate: float = parameter("1/s", "relative change of the level per time")

    title = "friction drift"
    action = "friction"
    rank = 8
    explanation = "Friction rises or falls while the machine runs: warming grease, a drying seal."
    experiment = "Repeat the same crawl every few minutes from cold to warm."

    def slopes(self, axis: BaseAxis, speed: float) -> Slopes:
        return Slopes(time=abs(self.rate), relative=1.0)

    @staticmethod
    def law(t, x, v, u, level, direction, rest, p):  # type: ignore[no-untyped-def]
        return level * p[0] * t

    def base_at(self, axis: BaseAxis, t: float) -> tuple[str, float]:
        return "coulomb", (1.0 + self.rate * t) * axis.coulomb.mean

    def bounds(self, box: Box) -> Interval:
        return self.rate * box.level * box.t

    @classmethod
    def columns(cls, view: View) -> Iterator[Column]:
        yield proportional_column("rate", -view.direction * view.level * view.lift * view.t)


def _grown_levels(rests: Floats, beyond: Floats, error: float) -> Iterator[Column]:
    """Shape of a dwell time that fits forces beyond the level after rests, if these tell one.

    Forces that differ from it by more than an `error` hardly count.
    """
    if np.unique(rests).size < _LEAST_RESTS or not beyond.max() > error:
        return

    def left(z: Floats) -> Floats:
        return np.asarray(z[0] * -np.expm1(-rests / z[1]) - beyond)

    longest = float(rests.max())
    ends = (0.0, 1e-2 * float(rests.min())), (math.inf, 10.0 * longest)
    best = min(
        (
            least_squares(left, (beyond.max(), part * longest), "2-point", ends, loss="cauchy",
                          f_scale=error)
            for part in (0.03, 0.1, 0.3)
        ),
        key=lambda one: one.cost,
    )  # fmt: skip
    if best.x[0] > error:
        rise, time_constant = map(float, best.x)
        scatter, rest = (np.median(np.abs(z - np.median(z))) for z in (beyond, best.fun))
        told = bool(rest < _TOLD_SCATTER * scatter)
        yield simulated_column(rise=rise, time_constant=time_constant)._replace(told=told)


@register_effect
class DwellTime(Effect):
    r"""Breakaway level that grows with the time at rest.

    Notes
    -----
    .. math:: F_b \to F_b + \text{rise} \cdot \left(1 - e^{-t_r/\text{time constant}}\right)

    with F_b the breakaway level and t_r the time at rest; the Stribeck peak does
    not raise this part.

    Examples
    --------
    Under a slow ramp of force it breaks away half a newton later:

    >>> import numpy as np
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=1.0,
    ...                         effects=(dfc.effects.DwellTime(rise=0.5, time_constant=0.05),))
    >>> ramp = np.arange(2000) * 1e-3
    >>> round(float(axis.simulate(ramp, dt=1e-3, hold="first").events.time[0]), 6)
    1.5
    """

    rise: float = parameter(
        "N", "breakaway gained after a long rest", bounds=(0.0, math.inf), breaks_away=True
    )
    time_constant: float = parameter(
        "s", "time constant", bounds=(1e-9, math.inf), breaks_away=True, neutral=None
    )

    title = "dwell-time dependence"
    action = "friction"
    within_peak = False
    remembers = True
    rank = 19
    explanation = "At rest contacts creep together, oil is squeezed out: the breakaway force grows."
    experiment = "Break away after rests of different lengths with the same slow ramp of force."

    def slopes(self, axis: BaseAxis, speed: float) -> Slopes:
        return Slopes(time=self.rise / self.time_constant)

    @staticmethod
    def law(t, x, v, u, level, direction, rest, p):  # type: ignore[no-untyped-def]
        return p[0] * -math.expm1(-rest / p[1])

    def bounds(self, box: Box) -> Interval:
        return self.rise * (1.0 - (-box.rest / self.time_constant).exponential())

    @classmethod
    def columns(cls, view: View) -> Iterator[Column]:
        # Breakaway is all that shows it: after rests of several lengths the record itself.
        yield from _grown_levels(*breakaway_levels(view), 0.1 * view.size)
        for part in (0.15, 0.4, 1.0, 2.0):
            for time_constant in (0.05, 0.2, 0.8):
                yield simulated_column(rise=part * view.size, time_constant=time_constant)
