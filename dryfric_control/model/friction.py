"""Static friction description: Coulomb levels and the Stribeck peak."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dryfric_control.arrays import Floats
from dryfric_control.checks import finite, places, positive
from dryfric_control.text import stated, with_parameters


def _coefficients(name: str, values: float | Iterable[float]) -> tuple[float, ...]:
    if isinstance(values, (int, float, np.number)):
        values = (finite(name, values),)
    if isinstance(values, str) or not isinstance(values, Iterable):
        raise ValueError(f"{name} must be a number or coefficients c0, c1, ..., got {values!r}")
    result = tuple(finite(f"{name}[{i}]", c) for i, c in enumerate(values))
    if not result:
        raise ValueError(f"{name} is empty: give at least the constant level c0")
    return result


@dataclass(frozen=True)
class CoulombMap:
    """Coulomb level over position, one polynomial per direction.

    Parameters
    ----------
    plus : float or sequence of float
        Coefficients c0, c1, ... of ``c0 + c1 x + c2 x^2 ...`` for motion in positive direction, a
        magnitude [N or N m]: Fc_plus(x) of the paper, eq. (3).  Outside the travel of an axis the
        level keeps the value at its end.
    minus : float or sequence of float, optional
        The same for negative direction, also a magnitude.  Default: as `plus`.

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> level = dfc.CoulombMap(plus=[8.0, 10.0], minus=7.0)
    >>> float(level(0.1, +1)), float(level(0.1, -1))
    (9.0, 7.0)
    """

    plus: tuple[float, ...]
    minus: tuple[float, ...] = None  # type: ignore[assignment]

    def __post_init__(self) -> None:
        plus = _coefficients("plus", self.plus)
        minus = plus if self.minus is None else _coefficients("minus", self.minus)
        object.__setattr__(self, "plus", plus)
        object.__setattr__(self, "minus", minus)

    @classmethod
    def of(cls, coulomb: CoulombMap | float | Iterable[float]) -> CoulombMap:
        """Map from a number, a pair (plus, minus), or a map itself.

        Parameters
        ----------
        coulomb : CoulombMap, float or pair
        """
        if isinstance(coulomb, CoulombMap):
            return coulomb
        given: Any = coulomb.tolist() if isinstance(coulomb, np.ndarray) else coulomb
        if isinstance(given, (int, float, np.number)) and not isinstance(given, bool):
            return cls(float(given))  # type: ignore[arg-type]
        if isinstance(given, (tuple, list)) and len(given) == 2:
            return cls(*given)
        raise ValueError(
            f"coulomb must be a level, a pair (plus, minus) or a CoulombMap, got {given!r}"
        )

    @property
    def constant(self) -> bool:
        """Whether the level is the same at every position."""
        return len(self.plus) == 1 and len(self.minus) == 1

    @property
    def mean(self) -> float:
        """Mean of the levels of both directions at x = 0, the value of ``"coulomb"``."""
        return 0.5 * (self.plus[0] + self.minus[0])

    def __call__(self, x: ArrayLike, direction: int) -> Floats:
        """Level at positions `x` for motion in `direction` (+1 or -1)."""
        if isinstance(direction, bool) or direction not in (1, -1):
            raise ValueError(f"direction must be +1 or -1, got {direction!r}")
        coefficients = self.plus if direction > 0 else self.minus
        return np.asarray(np.polynomial.polynomial.polyval(places("x", x), coefficients), float)

    def scaled(self, plus: float, minus: float | None = None) -> CoulombMap:
        """Map with each direction multiplied by a factor.

        Parameters
        ----------
        plus : float
        minus : float, optional
            Factor of the negative direction.  Default: as `plus`.
        """
        plus = finite("plus", plus)
        other = plus if minus is None else finite("minus", minus)
        return CoulombMap(tuple(plus * c for c in self.plus), tuple(other * c for c in self.minus))

    def check(self, travel: tuple[float, float] | None) -> None:
        """Refuse levels that are not positive over the travel.

        Parameters
        ----------
        travel : tuple of float, or None
            Lowest and highest position [m]; a map that varies with position needs them.
        """
        for name, direction, c in (("plus", 1, self.plus), ("minus", -1, self.minus)):
            if travel is None and len(c) > 1:
                raise ValueError(
                    f"coulomb.{name} varies with position: give travel=(low, high), the range "
                    "in which the polynomial holds"
                )
            low, high = travel or (0.0, 0.0)
            if _surely_positive(c, (low, high)):
                continue
            roots = np.polynomial.Polynomial(c).deriv().roots().astype(complex)
            turns = roots.real[np.abs(roots.imag) < 1e-9 * np.maximum(1.0, np.abs(roots))]
            places = np.array([low, high, *turns[(turns > low) & (turns < high)]])
            with np.errstate(over="ignore", invalid="ignore"):
                levels = self(places, direction)
            worst = int(np.argmin(levels))
            if not 0.0 <= levels[worst] < np.inf:
                raise ValueError(
                    f"coulomb.{name} falls to {levels[worst]:.6g} at x = {places[worst]:.6g}: a "
                    "Coulomb level is a magnitude and must stay positive over the travel"
                )


def middle_level(level: CoulombMap, travel: tuple[float, float] | None) -> float:
    """Mean of the levels of both directions in the middle of the travel."""
    place = 0.5 * sum(travel or (0.0, 0.0))
    return 0.5 * float(level(place, 1) + level(place, -1))


def _surely_positive(c: tuple[float, ...], travel: tuple[float, float]) -> bool:
    """Whether the value in the middle exceeds all that the other terms can take off."""
    middle = 0.5 * (travel[0] + travel[1])
    half = 0.5 * (travel[1] - travel[0])
    around = list(c)  # Taylor coefficients about the middle, by Horner's rule
    for i in range(len(around) - 1):
        for k in range(len(around) - 2, i - 1, -1):
            around[k] += middle * around[k + 1]
    return around[0] > sum(abs(a) * half**k for k, a in enumerate(around[1:], 1))


#: Largest excess of a Stribeck peak: beyond ten times the Coulomb level, somebody
#: has written per cent.
MOST_EXCESS = 10.0


@with_parameters
@dataclass(frozen=True)
class Stribeck:
    """Stribeck peak: friction that is higher at low velocity.

    Notes
    -----
    F = Fc (1 + sigma exp(-((s v - Sigma)/vs)^2)), with Sigma the stick velocity of
    the axis (paper, eq. (3)); the breakaway friction force is (1 + sigma) Fc.

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> dfc.Stribeck(excess=0.3, speed=0.01)
    Stribeck(excess=0.3, speed=0.01)
    """

    excess: float = stated("Relative excess sigma of breakaway over the Coulomb level [1].")
    speed: float = stated("Stribeck velocity vs, over which the excess decays [m/s or rad/s].")

    def __post_init__(self) -> None:
        excess = positive("stribeck.excess", self.excess, zero=True)
        if excess > MOST_EXCESS:
            raise ValueError(
                f"stribeck.excess is a share of the Coulomb level, at most {MOST_EXCESS:g}: for "
                f"30 % give 0.3, got {excess:g}"
            )
        object.__setattr__(self, "excess", excess)
        object.__setattr__(self, "speed", positive("stribeck.speed", self.speed, unit="m/s"))

    def factor(self, speed: ArrayLike, stick_speed: float = 0.0) -> Floats:
        """Friction over its Coulomb level, by the law of the class.

        Parameters
        ----------
        speed : array_like, shape (n,)
            Velocity in the direction of motion [m/s].
        stick_speed : float, optional
        """
        past = (np.asarray(speed, dtype=float) - stick_speed) / self.speed
        return np.asarray(1.0 + self.excess * np.exp(-(past**2)))
