"""Checks of user input: invalid arguments are rejected by name before any computation."""

from __future__ import annotations

import math
import sys
import warnings
from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike

from dryfric_control.arrays import Floats
from dryfric_control.text import did_you_mean


def warn(message: str, category: type[Warning] = UserWarning) -> None:
    """Warn at the line that called this package, however deep in it the reason is seen."""
    # From Python 3.12 on this is skip_file_prefixes of warnings.warn.
    level = 2
    frame = sys._getframe(1)
    while frame.f_back and frame.f_globals.get("__name__", "").split(".")[0] == __package__:
        level = level + 1
        frame = frame.f_back
    warnings.warn(message, category, stacklevel=level)


def finite(name: str, value: object, *, unit: str = "") -> float:
    """Convert to a finite float; the error names the argument."""
    try:
        if isinstance(value, (str, bytes)):
            raise TypeError
        number = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        raise ValueError(
            f"{name} must be a number{unit and f' in {unit}'}, got {describe_value(value)}"
        ) from None
    if not math.isfinite(number) or isinstance(value, (bool, np.bool_)):
        raise ValueError(f"{name} must be a finite number{unit and f' in {unit}'}, got {value!r}")
    return number


def positive(name: str, value: object, *, unit: str = "", zero: bool = False) -> float:
    """Convert to a finite float above zero (or not below zero, with `zero`)."""
    number = finite(name, value, unit=unit)
    if number < 0.0 or (number == 0.0 and not zero):
        bound = "zero or more" if zero else "more than zero"
        raise ValueError(f"{name} must be {bound}{unit and f' [{unit}]'}, got {value!r}")
    if not zero and math.isinf(1.0 / number):
        raise ValueError(f"{name} = {number:g} is too small to compute with: check its unit")
    return number


def sampling_time(dt: object) -> float:
    """Sampling time of a design [s], with a warning where milliseconds may be meant."""
    number = positive("dt", dt, unit="s")
    if number >= 0.1:
        ms = f"it is in seconds, {number:g} ms is dt={1e-3 * number:g}"
        warn(f"dt = {number:g} s is long for an axis: {ms}")
    return number


def increment(value: object, unit: str, *, zero: bool = False) -> float:
    """`encoder_quantum` of a design, with a warning where counts may be meant."""
    number = positive("encoder_quantum", value, unit=unit, zero=zero)
    if number >= 0.5 and unit in ("m", "rad"):
        warn(
            f"encoder_quantum = {number:g} {unit} is coarse for an axis: it is the length of one "
            f"count in {unit}, not a number of counts",
        )
    return number


def whole(name: str, value: object, least: int = 1) -> int:
    """Convert to an integer not below `least`."""
    number = value if isinstance(value, (int, float, np.number)) else math.nan
    if isinstance(value, bool) or not number >= least or not float(number).is_integer():
        raise ValueError(
            f"{name} must be a whole number of at least {least}, got {describe_value(value)}"
        )
    return int(number)


def check_boolean(name: str, value: object) -> bool:
    """Reject what is neither True nor False."""
    if not isinstance(value, (bool, np.bool_)):
        raise ValueError(f"{name} must be True or False, got {describe_value(value)}")
    return bool(value)


def one_of(name: str, value: object, choices: Iterable[object]) -> None:
    """Reject what is none of some words or numbers."""
    known = list(choices)
    if isinstance(value, bool) or not any(isinstance(value, type(w)) and value == w for w in known):
        raise ValueError(f"{name} must be one of {', '.join(map(str, known))}, got {value!r}")


def instance(name: str, value: object, kind: type, mend: str = "") -> None:
    """Reject an argument of another type; `mend` is a hint how to get the right one."""
    if not isinstance(value, kind):
        article = "an" if kind.__name__[0] in "AEIOU" else "a"
        raise ValueError(
            f"{name} must be {article} {kind.__name__}{mend and f' ({mend})'}, "
            f"got {describe_value(value)}"
        )


def string(name: str, value: object) -> str:
    """Reject what is no text."""
    if not isinstance(value, str):
        raise ValueError(f"{name} must be text, got {describe_value(value)}")
    return value


def known_keys(name: str, given: Iterable[str], known: Iterable[str]) -> None:
    """Refuse keys that nobody reads, with the nearest that somebody does."""
    known = list(known)
    for key in given:
        if key not in known:
            near = did_you_mean(str(key), known)
            raise ValueError(f"{name}{key} is not known{near}; known are {', '.join(known)}")


def describe_value(value: object) -> str:
    """Description of a value for an error message: the value if short, else its type."""
    text = repr(value) if isinstance(value, (bool, int, float, str, type(None))) else ""
    return text if 0 < len(text) <= 60 else f"a value of type {type(value).__name__}"


def places(name: str, values: ArrayLike) -> Floats:
    """Convert numbers to an array of floats of any shape."""
    try:
        array = np.asarray(values)
    except ValueError:  # rows of unequal length
        array = np.asarray(None)
    if array.dtype.kind not in "biuf":
        kind = (
            "complex ones: take the real part"
            if array.dtype.kind == "c"
            else describe_value(values)
        )
        raise ValueError(f"{name} must be an array of numbers, got {kind}")
    if np.ma.is_masked(values):
        raise ValueError(f"{name} holds masked values: fill or remove them first")
    return np.asarray(array, dtype=float)


def samples(name: str, values: ArrayLike, shape: str = "n") -> Floats:
    """Convert to a one-dimensional array of finite floats; a copy."""
    array = np.array(places(name, values))
    if array.ndim != 1 or array.size == 0:
        raise ValueError(
            f"{name} must have shape ({shape},) with at least one sample, got shape {array.shape}"
        )
    bad = np.flatnonzero(~np.isfinite(array))
    if bad.size:
        raise ValueError(
            f"{name} holds {bad.size} value(s) that are not finite, the first at index {bad[0]}: "
            "remove or fill them first"
        )
    return array
