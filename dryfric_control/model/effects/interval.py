"""Intervals of laws over boxes of their arguments, with bounds of their partial derivatives."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.polynomial import Chebyshev
from numpy.typing import ArrayLike

from dryfric_control.arrays import Floats

#: Arguments of a law of which it may be a function, in the order of `Interval.slopes`.
ARGUMENTS = ("t", "x", "v", "u", "rest")
# Largest derivative of exp(-q^2).
_BELL_SLOPE = math.sqrt(2.0 / math.e)


def _product(a: ArrayLike, b: ArrayLike) -> Floats:
    """Product in which nothing times anything, infinity included, is nothing."""
    a = np.asarray(a, float)
    b = np.asarray(b, float)
    with np.errstate(invalid="ignore", over="ignore"):
        return np.where((a == 0.0) | (b == 0.0), 0.0, a * b)


@dataclass(frozen=True, eq=False)
class Interval:
    """Values between two bounds, and bounds of their derivatives.

    Interval arithmetic with forward differentiation (R. Moore, R. Kearfott, M. Cloud, Introduction
    to Interval Analysis, 2009): a law written with intervals is bounded over the box of its
    arguments.  Bounds may be arrays, one element a part of the travel.

    Parameters
    ----------
    low, high : float or ndarray, shape (...)
        Bounds of the values.
    slopes : ndarray, shape (5, ...)
        Largest magnitudes of the derivatives by t, x, v, u and rest; infinite at a jump.

    Examples
    --------
    A spring of 200 N/m over 1 mm either way:

    >>> import dryfric_control as dfc
    >>> x = dfc.effects.Interval.of_argument("x", -1e-3, 1e-3)
    >>> force = -200.0 * x
    >>> float(force.low), float(force.high), float(force.slopes[1])
    (-0.2, 0.2, 200.0)
    """

    low: Floats
    high: Floats
    slopes: Floats

    # numpy scalars and arrays on the left leave the operation to this class.
    __array_ufunc__ = None

    @classmethod
    def of_number(cls, value: ArrayLike) -> Interval:
        """A constant.

        Parameters
        ----------
        value : float or array_like
        """
        value = np.asarray(value, float)
        return cls(value, value, np.zeros((len(ARGUMENTS), *value.shape)))

    @classmethod
    def of_argument(cls, name: str, low: ArrayLike, high: ArrayLike) -> Interval:
        """An argument of a law between bounds.

        Parameters
        ----------
        name : {"t", "x", "v", "u", "rest"}
        low, high : float or array_like
        """
        low, high = np.broadcast_arrays(np.asarray(low, float), np.asarray(high, float))
        slopes = np.zeros((len(ARGUMENTS), *low.shape))
        slopes[ARGUMENTS.index(name)] = 1.0
        return cls(low, high, slopes)

    @property
    def magnitude(self) -> Floats:
        """Largest absolute value."""
        return np.maximum(np.abs(self.low), np.abs(self.high))

    def _map_rising(self, function: Callable[[Floats], ArrayLike], slope: ArrayLike) -> Interval:
        """A rising function of it, whose derivative is at most `slope`."""
        low, high = (np.asarray(function(one), float) for one in (self.low, self.high))
        slopes = self.slopes
        if np.ndim(slope) >= slopes.ndim:
            slopes = slopes[:, None]
        return Interval(low, high, _product(slope, slopes))

    def __add__(self, other: Interval | float) -> Interval:
        other = _interval(other)
        slopes = np.add(*_align_slopes(self.slopes, other.slopes))
        return Interval(self.low + other.low, self.high + other.high, slopes)

    __radd__ = __add__

    def __neg__(self) -> Interval:
        return Interval(-self.high, -self.low, self.slopes)

    def __sub__(self, other: Interval | float) -> Interval:
        return self + -_interval(other)

    def __rsub__(self, other: float) -> Interval:
        return _interval(other) - self

    def __mul__(self, other: Interval | float) -> Interval:
        other = _interval(other)
        corners = [_product(a, b) for a in (self.low, self.high) for b in (other.low, other.high)]
        one, two = _align_slopes(self.slopes, other.slopes)
        slopes = _product(self.magnitude, two) + _product(other.magnitude, one)
        return Interval(np.minimum.reduce(corners), np.maximum.reduce(corners), slopes)

    __rmul__ = __mul__

    def __truediv__(self, other: float) -> Interval:
        return self * (1.0 / other)

    def __abs__(self) -> Interval:
        low = np.maximum(np.maximum(self.low, -self.high), 0.0)
        return Interval(low, self.magnitude, self.slopes)

    def square(self) -> Interval:
        """Its square."""
        size = abs(self)
        return Interval(size.low**2, size.high**2, _product(2.0 * size.high, self.slopes))

    def clip(self, low: float = -math.inf, high: float = math.inf) -> Interval:
        """Its values, none below or above a limit.

        Parameters
        ----------
        low, high : float, optional
        """
        inside = (self.high > low) & (self.low < high)
        return self._map_rising(lambda value: np.clip(value, low, high), np.where(inside, 1.0, 0.0))

    def sine(self) -> Interval:
        """Its sine."""
        slope = np.maximum(*(np.abs(one) for one in _sine_bounds(self + 0.5 * math.pi)))
        return Interval(*_sine_bounds(self), _product(slope, self.slopes))

    def exponential(self) -> Interval:
        """Its exponential."""
        return self._map_rising(np.exp, np.exp(self.high))

    def tanh(self) -> Interval:
        """Its hyperbolic tangent."""
        least = np.minimum(abs(self).low, 300.0)
        return self._map_rising(np.tanh, np.cosh(least) ** -2.0)

    def bell(self) -> Interval:
        """exp(-q^2) of its values q."""
        square = self.square()
        low = np.exp(-square.high)
        high = np.exp(-square.low)
        return Interval(low, high, _product(_BELL_SLOPE, self.slopes))

    def chebyshev(self, coefficients: Sequence[float]) -> Interval:
        """A Chebyshev series of its values.

        Parameters
        ----------
        coefficients : sequence of float, length n
            Those of T_0, T_1 and so on.
        """
        series = Chebyshev(coefficients)
        steepest = np.maximum(*(np.abs(one) for one in _series_bounds(series.deriv(), self)))
        return Interval(*_series_bounds(series, self), _product(steepest, self.slopes))

    def where(self, possible: ArrayLike) -> Interval:
        """Its values or none where they are possible, none elsewhere.

        Parameters
        ----------
        possible : bool or ndarray
        """
        share = np.where(possible, 1.0, 0.0)
        low = np.minimum(self.low, 0.0)
        high = np.maximum(self.high, 0.0)
        return Interval(low, high, self.slopes) * share

    def with_jump(self, name: str) -> Interval:
        """The same where one argument may make it jump.

        Parameters
        ----------
        name : {"t", "x", "v", "u", "rest"}
        """
        slopes = self.slopes.copy()
        slopes[ARGUMENTS.index(name)] = np.where(self.high > self.low, math.inf, 0.0)
        return Interval(self.low, self.high, slopes)


def _interval(value: Interval | float) -> Interval:
    return value if isinstance(value, Interval) else Interval.of_number(value)


def _align_slopes(a: Floats, b: Floats) -> tuple[Floats, Floats]:
    """Slopes that are the same everywhere beside those of each part of the travel."""
    if a.ndim == b.ndim:
        return a, b
    return (a[:, None], b) if a.ndim < b.ndim else (a, b[:, None])


def _series_bounds(series: Chebyshev, at: Interval) -> tuple[Floats, Floats]:
    """Least and largest value of a polynomial, but for round-off."""
    ends = series(at.low), series(at.high)
    # Where it turns, and points that round-off takes for such: a value there is one of its values.
    turns = (t for t in series.deriv().roots().real)
    inside = (np.where((at.low < t) & (t < at.high), series(t), ends[0]) for t in turns)
    every = np.stack([*ends, *inside])
    slack = 1e-12 * float(np.abs(series.coef).sum())
    return every.min(axis=0) - slack, every.max(axis=0) + slack


def _sine_bounds(angle: Interval) -> tuple[Floats, Floats]:
    """Least and largest sine."""
    low = angle.low
    high = angle.high
    turn = 2.0 * math.pi
    with np.errstate(invalid="ignore"):
        # Angles of the first crest and the first trough at or behind the lower end.
        crest = low + np.mod(0.5 * math.pi - low, turn)
        trough = low + np.mod(-0.5 * math.pi - low, turn)
        ends = np.sin(low), np.sin(high)
        whole = ~(high - low < turn)
        most = np.where(whole | (crest <= high), 1.0, np.maximum(*ends))
        least = np.where(whole | (trough <= high), -1.0, np.minimum(*ends))
    return np.asarray(least, float), np.asarray(most, float)


class Box(NamedTuple):
    """Arguments of a law as intervals, in the order of the law.

    Parameters
    ----------
    t, x, v, u, level : Interval
        Time [s], position [m], velocity [m/s], the force that the law acts on [N], Coulomb
        level [N].
    direction : float
        +1 or -1; 0 while stuck.
    rest : Interval
        Time at rest [s].

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> of = dfc.effects.Interval.of_argument
    >>> box = dfc.effects.Box(of("t", 0.0, 10.0), of("x", 0.0, 0.1), of("v", -0.2, 0.2),
    ...     of("u", -9.0, 9.0), dfc.effects.Interval.of_number(8.0), 1.0, of("rest", 0.0, 1.0))
    >>> float(dfc.effects.QuadraticDrag(drag=5.0).bounds(box).low)
    -0.2
    """

    t: Interval
    x: Interval
    v: Interval
    u: Interval
    level: Interval
    direction: float
    rest: Interval
