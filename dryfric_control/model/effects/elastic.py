"""Contacts and transmissions that give way, with a state of their own."""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from scipy.signal import cont2discrete, lfilter

from dryfric_control.model.effects.columns import Column, View, simulated_column
from dryfric_control.model.effects.effect import BaseAxis, Effect, Inner, parameter, register_effect
from dryfric_control.model.friction import middle_level
from dryfric_control.units import on_axis

# Damping ratio of a spring between motor and load that is tried.
_RATIO = 0.05
# Part of the mass on the load side that is tried.
_SHARE = 0.45
# What the ends of a gap give way by under the Coulomb level, in parts of the gap.
_GIVES = (0.01, 0.04, 0.16)
# Least gap of a play over what its ends give way by under the Coulomb level.
_LEAST_GAP = 0.1
# Part of the mass behind a gap, of the shapes that are tried with ends that give way, too.
_MIDDLE_SHARE = 0.5
# Lengths over which a soft contact may build up, in parts of the travel.
_SOFT = np.array([0.003, 0.01, 0.03, 0.1])


_LOOSE = "friction is on the motor's side, behind which the load moves freely"


def _on_motor() -> Any:
    return parameter(
        "1", "from 0.5 on the motor has friction and force effects, below it the load",
        bounds=(0.0, 1.0), kind="share", default=0.0, free=False,
    )  # fmt: skip


# Periods that the longest record holds of the slowest load that swings.
_SLOWEST_PERIODS = 2.0
# Number of frequencies at which one is tried.
_SWINGS = 16
# Largest share of the mass that it has.
_LARGEST_SHARE = 0.95
# Resonances that are tried, times the sampling time [rad]: up to half of what samples can show.
_TURNS = np.geomspace(0.02, 1.6, 18)


def _elastic_length(view: View) -> float:
    """Length over which a contact or a play acts, from resolution and travel."""
    return max(3.0 * view.quantum, 5e-5 * view.span)


@register_effect
class Presliding(Effect):
    r"""Friction that is elastic before it slides.

    Notes
    -----
    .. math:: F = k z + \text{damping}\, \dot z, \quad k = \frac{F_c}{\text{distance}},
        \quad \dot z = v \;\text{ until }\; {|k z|} = F_s

    Prandtl's element: elastic up to the friction level, at which it slides (and is not damped
    any more); when the motion reverses, the contact unloads from its present state.  Contacts of
    many bristles yield gradually (``bristles=1``: Dahl 1968; with damping and Stribeck peak that
    of Canudas de Wit, Olsson, Astrom and Lischinsky 1995, LuGre):

    .. math:: \dot z = v - {|v|} \frac{k z}{F_s}

    Fc is one constant level, the mean of both directions in the middle of the travel; Fs is the
    level at which the axis slides now.  Mode 0 is the elastic phase, that of bristles until their
    force is 1 % below the level: the axis moves in it, ``m v' = w - f v - F``, and stick velocity
    and stuck-mode decay rate are not used.  A simulation starts with the contact unstrained.

    Examples
    --------
    Below breakaway the axis swings about u/k and comes to rest there:

    >>> import numpy as np
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=300.0, coulomb=8.0,
    ...                         effects=(dfc.effects.Presliding(distance=40e-6),))
    >>> resp = axis.simulate(np.full(500, 4.0), dt=1e-3)
    >>> round(1e6 * float(resp.y[0, -1]), 6)
    20.0
    """

    distance: float = parameter(
        "m", "displacement over which the Coulomb level builds up", bounds=(1e-300, math.inf)
    )
    damping: float = parameter(
        "N s/m", "damping of the contact before it slides", bounds=(0.0, math.inf), default=0.0,
        free=False,
    )  # fmt: skip
    bristles: float = parameter(
        "1", "from 0.5 on it yields gradually, below it is elastic until it slides",
        bounds=(0.0, 1.0), kind="share", default=0.0, free=False,
    )  # fmt: skip

    action = "contact"
    rank = 18
    explanation = "Before breakaway the contact is elastic: the axis moves a little, and back."
    experiment = "Raise and lower the force slowly below breakaway: the position has a hysteresis."

    def inner(self, axis: BaseAxis) -> Inner:
        # Stiffness of the contact, none without a Coulomb level.
        stiffness = middle_level(axis.coulomb, axis.travel) / self.distance
        return Inner(
            contact=stiffness, contact_damping=self.damping, bristles=float(self.bristles >= 0.5)
        )

    def blind(self, axis: BaseAxis, force: float) -> tuple[float, float]:
        # From one sign of the Coulomb level to the other.
        return 2.0 * self.distance, 0.0

    def meaning(self, units: tuple[str, str]) -> str:
        if self.bristles >= 0.5:
            return "the contact yields gradually, as many bristles do (LuGre)"
        return ""

    def forms(self, axis: BaseAxis) -> tuple[Effect, ...]:
        if self.bristles >= 0.5:
            return (replace(self, bristles=0.0),)
        # Bristles without their damping swing on, which nothing else in a record does.
        stiffness = middle_level(axis.coulomb, axis.travel) / self.distance
        return (replace(self, bristles=1.0, damping=math.sqrt(stiffness * axis.mass)),)

    @classmethod
    def columns(cls, view: View) -> Iterator[Column]:
        # Elastic lengths of metal, and soft ones, as of a seal.
        metal = _elastic_length(view) * np.geomspace(0.7, 20.0, 8)
        for distance in (*metal, *(d for d in _SOFT * view.span if d > metal[-1])):
            yield simulated_column(distance=float(distance))


@dataclass(frozen=True)
class _Play(Effect):
    """What every play between motor and load has."""

    gap: float = parameter("m", "total width of the gap", bounds=(1e-300, math.inf))
    load_fraction: float = parameter(
        "1", "share of the mass behind the gap", bounds=(1e-6, 1.0 - 1e-6), kind="share"
    )
    friction_on_motor: float = _on_motor()

    # Where the friction of the shapes is that are tried.
    _sides: ClassVar[tuple[float, ...]] = (0.0, 1.0)
    action = "transmission"

    def inner(self, axis: BaseAxis) -> Inner:
        # Play and load.
        return Inner(
            half_gap=0.5 * self.gap, load_fraction=self.load_fraction,
            motor_rubs=float(self.friction_on_motor >= 0.5),
        )  # fmt: skip

    def blind(self, axis: BaseAxis, force: float) -> tuple[float, float]:
        # Twice the time in which the drive takes the motor across the play.
        free = (1.0 - self.load_fraction) * axis.mass
        return self.gap, 2.0 * math.sqrt(2.0 * self.gap * free / max(force, 1e-300))

    def meaning(self, units: tuple[str, str]) -> str:
        return _LOOSE if self.friction_on_motor >= 0.5 else ""

    @classmethod
    def columns(cls, view: View) -> Iterator[Column]:
        parts = (1.5, 3.0, 6.0, 12.0, 24.0, 48.0)
        shares = (0.35, _MIDDLE_SHARE, 0.65)
        for part, share, motor in itertools.product(parts, shares, cls._sides):
            gap = part * _elastic_length(view)
            yield simulated_column(gap=gap, load_fraction=share, friction_on_motor=motor)


@register_effect
class Backlash(_Play):
    r"""Free play between motor and load.

    Notes
    -----
    .. math:: {|x - x_l|} \le \tfrac{1}{2}\, \text{gap}, \quad x_l \text{ the load}

    The motor, (1 - load_fraction) m, carries drive and encoder; the load, load_fraction m, carries
    all friction and all force effects, or with ``friction_on_motor=1`` the motor does and the load
    flies freely.  In contact the two move as one until the contact would have to pull.  Where they
    meet again, the impact is plastic and takes no time: both have the velocity

    .. math:: \frac{(1 - \lambda)\, m_m v_m + m_l v_l}{(1 - \lambda)\, m_m + m_l}

    with m_m, v_m of the motor and m_l, v_l of the load.  Friction that grows with the load of
    the transmission, by lambda per newton, takes that part of an impulse along the motion
    (and adds it to one against it: lambda is negative then); without such friction momentum is
    conserved.  Coulomb level and drive do nothing in no time, and nothing rebounds.

    Ends that give way, such as the teeth of a gear, push instead with

    .. math:: F_t = \max\left(\frac{\delta}{\text{compliance}} + \text{damping}\, \dot\delta,\, 0
        \right), \quad \delta = {|x - x_l|} - \tfrac{1}{2}\, \text{gap} > 0

    (the dead zone of Nordin and Gutman, Automatica 38, 2002, with a damper that does not pull),
    and the masses rebound.  Very stiff ones cost time: the steps are a fraction of the period.

    Position and velocity are the motor's, the mode is that of the mass with friction.  A simulation
    starts with the motor in the middle of the gap.  In contact the net force on both masses counts
    for a friction that depends on it.

    Examples
    --------
    The motor crosses half the play alone, then takes the load along:

    >>> import numpy as np
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=0.0, coulomb=1.0,
    ...                         effects=(dfc.effects.Backlash(gap=2e-3, load_fraction=0.5),))
    >>> resp = axis.simulate(np.full(100, 5.0), dt=1e-3)
    >>> float(resp.events.times(0, 1)[0]).__round__(6)     # sqrt(gap m/2/u)
    0.02

    Teeth that give way hand nearly all of its 0.1 m/s to the load, rigid ends a half:

    >>> teeth = dfc.effects.Backlash(gap=2e-3, load_fraction=0.5, compliance=1e-5, damping=1.0)
    >>> resp = axis.replace(effects=(teeth,)).simulate(np.full(100, 5.0), dt=1e-3)
    >>> float(resp.y[1, 27]).__round__(3)
    0.014
    """

    compliance: float = parameter(
        "m/N", "what the ends of the gap give way by, 0 if they are rigid",
        bounds=(0.0, math.inf), default=0.0, neutral=None, free=False,
    )  # fmt: skip
    damping: float = parameter(
        "N s/m", "damping of ends that give way", bounds=(0.0, math.inf), default=0.0,
        neutral=None, free=False,
    )  # fmt: skip

    rank = 20.0
    explanation = (
        "There is free play between motor and load: after each reversal the motor crosses the gap, "
        "then strikes the load."
    )
    experiment = "Reverse slowly with a small force: the motor crosses the gap before it rises."

    def inner(self, axis: BaseAxis) -> Inner:
        # Play and load, and the spring at the ends of the gap.
        found = super().inner(axis)
        if self.compliance == 0.0:
            return found
        return found._replace(stiffness=1.0 / self.compliance, damping=self.damping)

    def plausible(self, axis: BaseAxis) -> bool:
        # A gap far below what its ends give way by does nothing: that is a compliance.
        level = middle_level(axis.coulomb, axis.travel)
        return self.gap >= _LEAST_GAP * self.compliance * level

    def meaning(self, units: tuple[str, str]) -> str:
        said = [super().meaning(units)]
        if self.compliance > 0.0:
            stiffness = f"{1.0 / self.compliance:.3g} {on_axis('N/m', units)}"
            said.append(f"the ends of the gap have a stiffness of {stiffness}")
        return "; ".join(filter(None, said))

    def forms(self, axis: BaseAxis) -> tuple[Effect, ...]:
        other = replace(self, friction_on_motor=1.0 - round(self.friction_on_motor))
        if self.compliance > 0.0:
            return (other, replace(self, compliance=0.0, damping=0.0))
        level = middle_level(axis.coulomb, axis.travel)
        if level <= 0.0:
            return (other,)
        return (other, *(self._with_ends(axis, part * self.gap / level) for part in _GIVES))

    @classmethod
    def columns(cls, view: View) -> Iterator[Column]:
        level = middle_level(view.axis.coulomb, view.axis.travel)
        for one in super().columns(view):
            yield one
            rigid = cls(**one.values((1.0,)))
            if level > 0.0 and rigid.load_fraction == _MIDDLE_SHARE:
                for part in _GIVES:
                    ends = rigid._with_ends(view.axis, part * rigid.gap / level)
                    yield simulated_column(**dict(zip(cls.parameters(), ends.values, strict=True)))

    def _with_ends(self, axis: BaseAxis, compliance: float) -> Backlash:
        """The same with ends that give way, lightly damped."""
        reduced = self.load_fraction * (1.0 - self.load_fraction) * axis.mass
        damping = 2.0 * _RATIO * math.sqrt(reduced / compliance)
        return replace(self, compliance=compliance, damping=damping)


@register_effect
class LoadEncoderBacklash(_Play):
    r"""Free play between motor and load, the encoder on the load.

    Notes
    -----
    .. math:: y = x_l, \quad {|x - x_l|} \le \tfrac{1}{2}\, \text{gap}, \quad x_l \text{ the load}

    The mechanics are those of `Backlash`; what is read, and what `simulate` returns as
    position, is the load's.  Its velocity is still the motor's.

    Examples
    --------
    Nothing is seen to move until the motor has crossed half the play:

    >>> import numpy as np
    >>> import dryfric_control as dfc
    >>> effect = dfc.effects.LoadEncoderBacklash(gap=2e-3, load_fraction=0.5)
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=0.0, coulomb=1.0, effects=(effect,))
    >>> resp = axis.simulate(np.full(100, 5.0), dt=1e-3)
    >>> int(np.flatnonzero(resp.y[0])[0])     # sqrt(gap m/2/u) = 20 ms
    21
    """

    _sides = (0.0,)
    slug = "load_encoder_backlash"
    title = "backlash, encoder on the load"
    rank = 20.5
    explanation = (
        "There is free play between motor and load, and the encoder is on the load: after each "
        "reversal the reading stands still while the motor crosses the gap."
    )
    experiment = (
        "Reverse under forces of different size: the pause before the load moves decreases with "
        "the square root of the force."
    )

    def inner(self, axis: BaseAxis) -> Inner:
        # Play and load, which is what is read.
        return super().inner(axis)._replace(on_load=1.0)

    def forms(self, axis: BaseAxis) -> tuple[Effect, ...]:
        return ()


def _swings(view: View) -> Iterator[Column]:
    """Force of a load that swings slowly on a motor with the friction, by the motion of that.

    With y the stretch of the spring, the load moves by ``y'' + 2 ratio turn y' + turn^2 y = a``
    and pulls, beyond its own inertia, with ``load_fraction mass y''``.
    """
    mass = view.axis.mass
    slowest = 2.0 * math.pi * _SLOWEST_PERIODS / view.duration
    fastest = _TURNS[0] / view.dt
    if slowest >= fastest:
        return
    begins = np.flatnonzero(np.r_[True, np.abs(np.diff(view.t) / view.dt - 1.0) > 0.5])
    for turn in np.geomspace(slowest, fastest, _SWINGS):
        law = ([1.0, 0.0, 0.0], [1.0, 2.0 * _RATIO * turn, turn**2])
        numerator, denominator, _ = cont2discrete(law, view.dt, method="bilinear")
        pulls = [lfilter(np.ravel(numerator), denominator, a) for a in np.split(view.a, begins[1:])]
        yield Column(
            functools.partial(_swinging_load, turn=float(turn), mass=mass),
            (mass * np.concatenate(pulls),), positive=True, most=_LARGEST_SHARE,
        )  # fmt: skip


def _swinging_load(c: Sequence[float], turn: float, mass: float) -> dict[str, float]:
    """Values of a load that swings, for its share of the mass."""
    inertia = float(c[0]) * mass
    return {
        "stiffness": inertia * turn**2, "damping": 2.0 * _RATIO * inertia * turn,
        "load_fraction": float(c[0]), "friction_on_motor": 1.0,
    }  # fmt: skip


@register_effect
class Compliance(Effect):
    r"""Elastic transmission between motor and load.

    Notes
    -----
    .. math:: F_t = \text{stiffness} \cdot (x - x_l) + \text{damping} \cdot (v - v_l)

    The motor, (1 - load_fraction) m, carries drive and encoder; the load is load_fraction m, at
    x_l.  All friction and all force effects, and the mode, are those of the load, as on a belt that
    draws a carriage; with ``friction_on_motor=1`` those of the motor, as of a gear that turns a
    flexible arm.  Position and velocity are the motor's.  A simulation starts with the transmission
    unstrained.  A very stiff one costs time: the steps are a fraction of its natural period.
    `diagnose` names it only where the masses swing: damping below twice the root of the stiffness
    and the mass that swings, load_fraction (1 - load_fraction) m.

    Examples
    --------
    The load holds, and the motor winds the transmission up to u/stiffness:

    >>> import numpy as np
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(
    ...     mass=2.0, viscous=0.0, coulomb=8.0,
    ...     effects=(dfc.effects.Compliance(stiffness=1e4, damping=60.0, load_fraction=0.5),))
    >>> resp = axis.simulate(np.full(1000, 4.0), dt=1e-3)
    >>> round(1e3 * float(resp.y[0, -1]), 6)
    0.4
    """

    stiffness: float = parameter("N/m", "stiffness", bounds=(1e-300, math.inf))
    damping: float = parameter("N s/m", "damping", bounds=(0.0, math.inf), neutral=None)
    load_fraction: float = parameter(
        "1", "share of the mass behind the transmission", bounds=(1e-6, 1.0 - 1e-6), kind="share"
    )
    friction_on_motor: float = _on_motor()

    action = "transmission"
    rank = 21
    explanation = (
        "A belt, a long screw or a soft coupling between motor and load is elastic: the two "
        "oscillate against each other."
    )
    experiment = "Step the force while sliding: the velocity rings at the natural frequency."

    def inner(self, axis: BaseAxis) -> Inner:
        # Spring, damper and load.
        return Inner(
            stiffness=self.stiffness, damping=self.damping, load_fraction=self.load_fraction,
            motor_rubs=float(self.friction_on_motor >= 0.5),
        )  # fmt: skip

    def blind(self, axis: BaseAxis, force: float) -> tuple[float, float]:
        # A period of the swing of motor against load.
        return 0.0, 2.0 * math.pi * math.sqrt(self._reduced_mass(axis) / self.stiffness)

    def plausible(self, axis: BaseAxis) -> bool:
        # Two masses that do not swing against each other are joined by a damper, not by a spring.
        return self.damping < 2.0 * math.sqrt(self.stiffness * self._reduced_mass(axis))

    def _reduced_mass(self, axis: BaseAxis) -> float:
        """Mass that swings, of motor against load."""
        return self.load_fraction * (1.0 - self.load_fraction) * axis.mass

    def meaning(self, units: tuple[str, str]) -> str:
        return _LOOSE if self.friction_on_motor >= 0.5 else ""

    def forms(self, axis: BaseAxis) -> tuple[Effect, ...]:
        return (replace(self, friction_on_motor=1.0 - round(self.friction_on_motor)),)

    @classmethod
    def columns(cls, view: View) -> Iterator[Column]:
        yield from _swings(view)
        for turn, motor in itertools.product(_TURNS / view.dt, (0.0, 1.0)):
            inertia = _SHARE * view.axis.mass
            yield simulated_column(
                stiffness=inertia * turn**2, damping=2.0 * _RATIO * inertia * turn,
                load_fraction=_SHARE, friction_on_motor=motor,
            )  # fmt: skip
