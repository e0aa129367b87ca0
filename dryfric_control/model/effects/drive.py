"""What the drive makes of its command before it becomes a force."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
from scipy.signal import lfilter

from dryfric_control.arrays import Floats
from dryfric_control.model.effects.columns import (
    Column,
    View,
    delayed_columns,
    proportional_column,
    simulated_column,
)
from dryfric_control.model.effects.effect import BaseAxis, Effect, Inner, parameter, register_effect
from dryfric_control.model.effects.interval import Box, Interval

# Times the noise of the drive that a limit must cut off, and a dead zone must hide
# (`benchmarks/diagnosis.py`).
_PEAKS = 2.0
# Delays and lags tried, in samples.
_LATE = (0.5, 1, 2, 4, 8, 16)
# Part of the samples beyond which a limit takes the drive away, and the random forces that it must
# then exceed.
_NEARLY_ALL = 0.9
_CLEARLY = 10.0


@register_effect
class InputDelay(Effect):
    r"""Drive force that acts a time after the command.

    Notes
    -----
    .. math:: u(t) \to u(t - \text{delay})

    Examples
    --------
    It starts when the force arrives, here between two samples:

    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0,
    ...                         effects=(dfc.effects.InputDelay(delay=4.5e-3),))
    >>> resp = axis.simulate([10.0] * 20, dt=1e-3)
    >>> round(float(resp.events.time[0]), 9)
    0.0045
    """

    delay: float = parameter("s", "delay", bounds=(0.0, math.inf), kind="time")

    action = "delay"
    rank = 5
    explanation = "The drive acts with a delay: computing time, a field bus, a current loop."
    experiment = (
        "Step the force while sliding and compare the time of the change in slope of the velocity "
        "with the command."
    )

    def inner(self, axis: BaseAxis) -> Inner:
        # Its delay.
        return Inner(delay=self.delay)

    @classmethod
    def columns(cls, view: View) -> Iterator[Column]:
        at = np.arange(view.drive.size)
        yield from delayed_columns(
            view, "delay", lambda late: np.interp(at - late, at, view.drive), _LATE
        )


@register_effect
class ActuatorLag(Effect):
    r"""Drive force that follows the command with a first-order lag.

    Notes
    -----
    .. math:: u \to y, \quad \text{time constant} \cdot \dot y = u - y

    Examples
    --------
    It starts when the force has grown to the level, after tau ln 2:

    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0,
    ...                         effects=(dfc.effects.ActuatorLag(time_constant=0.01),))
    >>> resp = axis.simulate([16.0] * 20, dt=1e-3)
    >>> round(float(resp.events.time[0]), 6)
    0.006931
    """

    time_constant: float = parameter("s", "time constant", bounds=(0.0, math.inf), kind="time")

    action = "lag"
    rank = 6
    explanation = "The force builds up gradually: inductance of the winding, or stroke of a valve."
    experiment = "Step the force while sliding: acceleration rises gradually, not after a pause."

    def inner(self, axis: BaseAxis) -> Inner:
        # Its time constant.
        return Inner(lag=self.time_constant)

    @classmethod
    def columns(cls, view: View) -> Iterator[Column]:
        def lag_drive(late: float) -> Floats:
            kept = math.exp(-1.0 / late)
            start = [kept * view.drive[0]]
            return np.asarray(lfilter([1.0 - kept], [1.0, -kept], view.drive, zi=start)[0])

        yield from delayed_columns(view, "time_constant", lag_drive, _LATE)


@register_effect
class InputGain(Effect):
    r"""Drive force that is a multiple of the commanded one.

    Notes
    -----
    .. math:: u \to \text{gain} \cdot u

    Examples
    --------
    A command of 5 N acts with 10 N against a level of 8 N:

    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=0.0, coulomb=8.0,
    ...                         effects=(dfc.effects.InputGain(gain=2.0),))
    >>> round(float(axis.simulate([5.0] * 1001, dt=1e-3).y[1, -1]), 9)
    1.0
    """

    gain: float = parameter(
        "1", "force acting over force commanded", bounds=(0.0, math.inf), neutral=1.0
    )

    action = "input"
    rank = 2
    trades = ("mass", "add a known mass, or measure the force, to separate them")
    explanation = "The drive gives another force than assumed: wrong torque constant or scaling."
    experiment = "Hang a known weight on the axis and read the command that balances it."

    @property
    def corners(self) -> tuple[float, ...]:
        """None: it is linear."""
        return ()

    @staticmethod
    def law(t, x, v, u, level, direction, rest, p):  # type: ignore[no-untyped-def]
        return p[0] * u

    def bounds(self, box: Box) -> Interval:
        return self.gain * box.u

    @classmethod
    def columns(cls, view: View) -> Iterator[Column]:
        # A gain near 0 would predict a straight line, whatever the drive.
        yield Column(lambda c: {"gain": 1.0 + float(c[0])}, (view.drive,), most=0.5)


@register_effect
class DeadZone(Effect):
    r"""Commands to which the drive does not respond.

    Notes
    -----
    .. math:: u \to u - \min(\max(u, -\text{width}), \text{width})

    Examples
    --------
    Of 12 N it takes away 2 N:

    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=0.0, coulomb=8.0,
    ...                         effects=(dfc.effects.DeadZone(width=2.0),))
    >>> round(float(axis.simulate([12.0] * 1001, dt=1e-3).y[1, -1]), 9)
    1.0
    """

    width: float = parameter("N", "half width", bounds=(0.0, math.inf))

    action = "input"
    rank = 11
    explanation = "The drive ignores small commands: valve overlap, or dead time of a bridge."
    experiment = "Sweep the command slowly through zero while a constant load pushes the axis."

    @property
    def corners(self) -> tuple[float, ...]:
        """Both ends of the dead zone."""
        return -self.width, self.width

    @staticmethod
    def law(t, x, v, u, level, direction, rest, p):  # type: ignore[no-untyped-def]
        if u > p[0]:
            return u - p[0]
        if u < -p[0]:
            return u + p[0]
        return 0.0

    def bounds(self, box: Box) -> Interval:
        return (box.u - self.width).clip(low=0.0) + (box.u + self.width).clip(high=0.0)

    def beyond_noise(self, u: Floats, noise: float) -> bool:
        # What is shrunk by less than its noise is nearer to the drive that there was.
        return self.width > _PEAKS * noise

    @classmethod
    def columns(cls, view: View) -> Iterator[Column]:
        for part in (0.02, 0.05, 0.1, 0.2, 0.4, 0.7):
            width = part * view.size
            lost = -np.clip(view.drive, -width, width) / width
            yield proportional_column("width", lost, positive=True)._replace(most=2.0 * width)


@register_effect
class Saturation(Effect):
    r"""Largest force that the drive gives.

    Notes
    -----
    .. math:: u \to \min(\max(u, -\text{limit}), \text{limit})

    Examples
    --------
    However large the command, 10 N act:

    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=0.0, coulomb=8.0,
    ...                         effects=(dfc.effects.Saturation(limit=10.0),))
    >>> round(float(axis.simulate([500.0] * 1001, dt=1e-3).y[1, -1]), 9)
    1.0
    """

    limit: float = parameter("N", "largest magnitude", bounds=(0.0, math.inf), neutral=None)

    action = "input"
    rank = 12
    explanation = "The drive force is limited: current limit, supply voltage, pressure."
    experiment = "Increase the reference step: the acceleration stops growing."

    @property
    def corners(self) -> tuple[float, ...]:
        """Both limits."""
        return -self.limit, self.limit

    @staticmethod
    def law(t, x, v, u, level, direction, rest, p):  # type: ignore[no-untyped-def]
        return min(max(u, -p[0]), p[0])

    def bounds(self, box: Box) -> Interval:
        return box.u.clip(-self.limit, self.limit)

    def beyond_noise(self, u: Floats, noise: float) -> bool:
        # Peaks of a noisy input are cut as if by a limit; what nearly every sample exceeds takes
        # the drive away, unless what is left of it is far more than the random force.
        cut = np.abs(u)[np.abs(u) > self.limit] - self.limit
        if cut.size >= _NEARLY_ALL * u.size:
            both_ways = u.min() < -self.limit and u.max() > self.limit
            return bool(both_ways and self.limit > _CLEARLY * noise)
        if not cut.size:
            return False
        return bool(np.sqrt(np.mean(cut**2)) > _PEAKS * noise)

    @classmethod
    def columns(cls, view: View) -> Iterator[Column]:
        for part in (0.97, 0.9, 0.8, 0.7, 0.5, 0.35, 0.2):
            limit = part * view.top
            cut = np.clip(view.drive, -limit, limit) - view.drive
            yield simulated_column(limit=limit)._replace(force=(cut,), positive=True)


def input_corners(effects: Sequence[Effect]) -> list[float]:
    """Inputs at which a chain of input laws bends; it is linear between them [N]."""
    corners: list[float] = []
    for i, effect in enumerate(effects):
        # Where the laws before it give the inputs at which this one bends.
        before = effects[:i]
        known = sorted(corners)
        ends = [known[0] - 1.0, *known, known[-1] + 1.0] if known else [0.0, 1.0]
        values = [_map_input(before, u) for u in ends]
        for corner in effect.corners:
            corners += _inputs_with(ends, values, corner)
    return sorted(corners)


def _map_input(effects: Sequence[Effect], u: float) -> float:
    """Drive that a chain of input laws makes of an input."""
    for effect in effects:
        u = effect.law(0.0, 0.0, 0.0, u, 0.0, 0.0, 0.0, effect.values)
    return u


def _inputs_with(ends: list[float], values: list[float], wanted: float) -> list[float]:
    """Inputs with a value on a line of straight pieces, the outer ones without an end."""
    found = []
    last = len(ends) - 2
    for k, (a, b, fa, fb) in enumerate(zip(ends, ends[1:], values, values[1:], strict=False)):
        if fa == fb:
            continue
        part = (wanted - fa) / (fb - fa)
        if (part >= 0.0 or k == 0) and (part < 1.0 or k == last):
            found.append(a + part * (b - a))
    return found
