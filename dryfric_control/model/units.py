"""Units: their powers of force, length and time, and how an axis prints them."""

from __future__ import annotations

import functools
from collections.abc import Iterator

#: Powers of force, length and time; on a rotary axis the radian is the length.
_SYMBOLS = {
    "N": (1, 0, 0),
    "m": (0, 1, 0),
    "rad": (0, 1, 0),
    "s": (0, 0, 1),
    "Hz": (0, 0, -1),
    "kg": (1, -1, 2),
}
# A torque is the force of a rotary axis, and so on.
_TURNING = {("N", "m"): "N", ("kg", "m^2"): "kg"}
_MASS = {("m", "N"): "kg", ("rad", "N m"): "kg m^2"}


def powers(unit: str) -> tuple[int, int, int]:
    """Powers of force, length and time in a unit; zeros for what it does not know.

    Parameters
    ----------
    unit : str
        Such as "N s/m".  Factors after the slash are all in the denominator.

    Examples
    --------
    >>> powers("N s/m"), powers("N m^2"), powers("V"), powers("kg")
    ((1, -1, 1), (1, 2, 0), (0, 0, 0), (1, -1, 2))

    A torque is the force of a rotary axis:

    >>> powers("N m/rad") == powers("N/m")
    True
    """
    total = [0, 0, 0]
    for symbol, power in _factors(unit):
        for i, own in enumerate(_SYMBOLS.get(symbol, (0, 0, 0))):
            total[i] += power * own
    return (total[0], total[1], total[2])


@functools.cache
def on_axis(unit: str, units: tuple[str, str]) -> str:
    """A unit, given for metres and newtons, in the units of an axis.

    Parameters
    ----------
    unit : str
        Such as "N s/m"; "1" for a ratio.  What is neither force, length nor mass
        stays as it is.
    units : tuple of str
        Units of position and force of the axis.

    Examples
    --------
    >>> on_axis("N s/m", ("rad", "N m")), on_axis("kg", ("rad", "N m"))
    ('N m s/rad', 'kg m^2')
    >>> on_axis("m/N", ("rad", "N m")), on_axis("kg", ("mm", "N"))
    ('rad/(N m)', 'N s^2/mm')
    """
    length, force = units
    factors = list(_factors(unit))
    if factors == [("kg", 1)] and units in _MASS:
        return _MASS[units]
    named = {"N": force, "m": length, "rad": length}
    above: list[str] = []
    below: list[str] = []
    for symbol, power in factors:
        parts = [(symbol, power)]
        if symbol == "kg":
            parts = [("N", power), ("s", 2 * power), ("m", -power)]
        for name, p in parts:
            text = named.get(name, name)
            if abs(p) > 1:
                text = f"({text})^{abs(p)}" if " " in text else f"{text}^{abs(p)}"
            elif " " in text and p < 0:
                text = f"({text})"
            (above if p > 0 else below).append(text)
    top = " ".join(above) or "1"
    return f"{top}/{' '.join(below)}" if below else top


def _factors(unit: str) -> Iterator[tuple[str, int]]:
    """Symbols of a unit with their powers."""
    above, _, below = unit.partition("/")
    for sign, side in ((1, above), (-1, below)):
        words = side.replace("(N m)", "N").split()
        while words:
            pair = tuple(words[:2])
            if pair in _TURNING:
                yield _TURNING[pair], sign
                del words[:2]
                continue
            name, _, power = words.pop(0).partition("^")
            if name != "1":
                yield name, sign * int(power) if power.isdigit() else sign
