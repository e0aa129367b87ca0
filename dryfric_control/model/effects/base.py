"""Base parameters of the axis that are not what was believed."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from dryfric_control.model.effects.columns import PARTS, Column, View, peak_at, peaks
from dryfric_control.model.effects.effect import BaseAxis, Effect, parameter, register_effect
from dryfric_control.model.friction import MOST_EXCESS, Stribeck

# Logarithm of the ratio of velocities from which two peaks differ in more than their size.
_OTHER_SPEED = 0.3


class Factor(Effect):
    """A base parameter of the axis, named by `base`, times a factor."""

    factor: float
    action = "axis"
    depends_on_place = False

    def alter(self, axis: BaseAxis) -> BaseAxis:
        """Axis with the other value.

        Parameters
        ----------
        axis : FrictionAxis
        """
        return axis.replace(**{self.base: self.factor * getattr(axis, self.base)})


@register_effect
class Inertia(Factor):
    r"""Mass that differs from that of the axis.

    Notes
    -----
    .. math:: m \to \text{factor} \cdot m

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    >>> axis.replace(effects=(dfc.effects.Inertia(factor=1.5),)).effective().mass
    3.0
    """

    factor: float = parameter(
        "1", "moving mass over the mass of the axis", bounds=(1e-9, math.inf), neutral=1.0
    )

    title = "inertia error"
    base = "mass"
    explanation = "The moving mass differs from the assumed one: a workpiece, a coupling, a gear."
    experiment = "Accelerate hard both ways while sliding: force over acceleration is the mass."


@register_effect
class ViscousFriction(Factor):
    r"""Viscous coefficient that differs from that of the axis.

    Notes
    -----
    .. math:: f \to \text{factor} \cdot f

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    >>> axis.replace(effects=(dfc.effects.ViscousFriction(factor=2.0),)).effective().viscous
    30.0
    """

    factor: float = parameter(
        "1", "coefficient over that of the axis", bounds=(0.0, math.inf), neutral=1.0
    )

    slug = "viscous"
    title = "viscous friction error"
    base = "viscous"
    explanation = "Viscous friction differs from the assumed one: grease, temperature, a new seal."
    experiment = "Run at several constant velocities: force over velocity has it as its slope."


@register_effect
class CoulombFriction(Factor):
    r"""Coulomb level that differs, equally in both directions.

    Notes
    -----
    .. math:: F_c \to \text{factor} \cdot F_c

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=(8.0, 6.0))
    >>> axis.replace(effects=(dfc.effects.CoulombFriction(factor=1.5),)).effective().coulomb
    CoulombMap(plus=(12.0,), minus=(9.0,))
    """

    factor: float = parameter(
        "1", "level over that of the axis", bounds=(0.0, math.inf), neutral=1.0
    )

    slug = "coulomb"
    title = "Coulomb level error"
    base = "coulomb"
    explanation = (
        "Dry friction as a whole differs from the assumed one: preload, wear, lubrication."
    )
    experiment = "Crawl both ways at one speed: half the difference of the forces is the level."

    def alter(self, axis: BaseAxis) -> BaseAxis:
        return axis.replace(coulomb=axis.coulomb.scaled(self.factor))


@register_effect
class StribeckPeak(Effect):
    r"""Friction that is higher at the slowest motion.

    It takes the place of the axis' own Stribeck peak, if there is one.

    Notes
    -----
    .. math:: F = F_c \left(1 + \text{excess} \cdot e^{-(({|v|} - \Sigma)/\text{speed})^2}\right)

    with Sigma the stick velocity of the axis.

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    >>> peak = dfc.effects.StribeckPeak(excess=0.3, speed=0.01)
    >>> axis.replace(effects=(peak,)).effective().stribeck
    Stribeck(excess=0.3, speed=0.01)
    """

    excess: float = parameter(
        "1", "relative excess of breakaway over Coulomb", bounds=(0.0, MOST_EXCESS),
        breaks_away=True, size=1.0,
    )  # fmt: skip
    speed: float = parameter(
        "m/s", "velocity over which it decays", bounds=(1e-300, math.inf), breaks_away=True,
        logarithmic=True, kind="speed",
    )  # fmt: skip

    slug = "stribeck"
    title = "Stribeck peak"
    action = "axis"
    depends_on_place = False
    rank = 9
    axis_field = "stribeck"
    explanation = (
        "At low velocity the oil film breaks down and friction rises: breakaway takes more force "
        "than sliding."
    )
    experiment = "Crawl ever more slowly in a soft position loop: the axis sticks and slips."

    def alter(self, axis: BaseAxis) -> BaseAxis:
        """Axis with this peak.

        Parameters
        ----------
        axis : FrictionAxis
        """
        return axis.replace(stribeck=Stribeck(self.excess, self.speed))

    @classmethod
    def start(cls, axis: BaseAxis, size: Callable[[str], float]) -> StribeckPeak:
        # A small peak, as narrow as the stick band is wide.
        return cls(0.05, max(axis.stick_speed, 0.02 * size("m/s")))

    @classmethod
    def columns(cls, view: View) -> Iterator[Column]:
        yield from peaks(view, "excess", -view.direction * view.level, positive=True)

    def changes(self, view: View) -> Iterator[Column]:
        # More or less of this peak, and beside it one of another velocity.
        level = -view.direction * view.level
        own = peak_at(view, level, self.speed)
        yield Column(functools.partial(self._joined, self.speed), (own,))
        for speed in (part * view.fast for part in PARTS):
            if abs(math.log(speed / self.speed)) > _OTHER_SPEED:
                forces = (own, peak_at(view, level, speed))
                yield Column(functools.partial(self._joined, speed), forces)

    def _joined(self, speed: float, change: Sequence[float]) -> dict[str, float]:
        """Values of one peak for more of this one, and another one of some velocity.

        Parameters
        ----------
        speed : float
            Velocity of the other one.
        change : sequence of float
            Change of the excess of this one, and excess of the other one if there is one.
        """
        parts = np.maximum([self.excess + change[0], *change[1:]], 0.0)
        excess = float(parts.sum())
        if excess == 0.0:
            return {"excess": 0.0, "speed": self.speed}
        middle = float(parts @ np.log([self.speed, speed][: parts.size])) / excess
        return {"excess": excess, "speed": math.exp(middle)}
