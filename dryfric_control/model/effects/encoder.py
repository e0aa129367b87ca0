"""What the encoder makes of the position."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

from dryfric_control.model.effects.columns import Column, View, sines
from dryfric_control.model.effects.effect import BaseAxis, Effect, parameter, register_effect


@register_effect
class EccentricEncoder(Effect):
    r"""Encoder with an error that is periodic in position.

    Notes
    -----
    .. math:: y = x + \text{amplitude} \cdot \sin(2\pi x / \text{period} + \text{phase})

    with y the reading.  It is not a force: the motion of the axis does not change, unless a
    controller uses the reading.  The reading must grow with the position: beyond
    2 pi amplitude = period a reading is ambiguous.

    Examples
    --------
    An axis at rest at a quarter of the period reads the amplitude too much:

    >>> import dryfric_control as dfc
    >>> encoder = dfc.effects.EccentricEncoder(amplitude=1e-4, period=0.02)
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0, effects=(encoder,))
    >>> round(float(axis.simulate([0.0] * 3, dt=1e-3, x0=0.005).y[0, -1]), 9)
    0.0051
    """

    amplitude: float = parameter("m", "amplitude of the error", bounds=(0.0, math.inf))
    period: float = parameter("m", "distance after which it repeats", bounds=(1e-300, math.inf))
    phase: float = parameter("rad", "phase at x = 0", default=0.0, kind="angle")

    action = "reading"
    rank = 15.5
    repeats = True
    explanation = (
        "The disc of the encoder, or the wheel that drives it, is mounted off centre: the "
        "reading leads and lags once per turn."
    )
    experiment = (
        "Move at several constant velocities: the ripple of the force grows with the square of "
        "the velocity, that of cogging does not."
    )

    @property
    def periods(self) -> tuple[float, float]:
        """It repeats along the travel."""
        return math.inf, self.period

    @staticmethod
    def law(t, x, v, u, level, direction, rest, p):  # type: ignore[no-untyped-def]
        return p[0] * math.sin(2.0 * math.pi * x / p[1] + p[2])

    @classmethod
    def start(cls, axis: BaseAxis, size: Callable[[str], float]) -> EccentricEncoder:
        # None yet, some turns along the way.
        return cls(0.0, 0.3 * size("m"))

    @classmethod
    def columns(cls, view: View) -> Iterator[Column]:
        yield from sines(view, "reading")
