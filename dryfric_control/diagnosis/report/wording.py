"""What a cause means in the axis: believed and found numbers, levels in newtons."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dryfric_control.diagnosis.candidates import BASE, holds
from dryfric_control.estimation.parameters import values_of
from dryfric_control.model.effects.naming import class_of, title_of

if TYPE_CHECKING:
    from dryfric_control.diagnosis.report.diagnosis import Cause, Diagnosis
    from dryfric_control.model.axis import FrictionAxis

FloatArray = NDArray[np.float64]

#: Relative change of a believed number up to which it is a correction and no
#: finding: datasheets round, and friction changes by as much with the weather.
SMALL = 0.05
#: Directions of motion in words.
WAYS = ((1, "forwards"), (-1, "backwards"))


def believed_values(axis: FrictionAxis, cause: Cause) -> dict[str, float]:
    """Values that an axis already had for the parameters of a cause.

    Parameters
    ----------
    axis : FrictionAxis
        The axis as believed.
    cause : Cause
        What was found.

    Returns
    -------
    dict of str to float
        Empty for a cause that is new to the axis.
    """
    axis = axis.effective()
    if cause.effect in BASE:
        names = {name: name for name in cause.parameters}
    elif holds(axis, cause.effect):
        names = {name: f"{cause.effect}.{name}" for name in cause.parameters}
    else:
        return {}
    values = values_of(axis, list(names.values()))
    return dict(zip(names, map(float, values), strict=True))


def kind_of(effect: str, parameter: str) -> str:
    """Kind of a parameter of a cause; an amount where the class does not know it."""
    cls = class_of(effect)
    known = cls.parameters() if cls else {}
    return str(known.get(parameter, {"kind": "amount"})["kind"])


def is_small(diagnosis: Diagnosis, cause: Cause) -> bool:
    """Whether a cause only corrects believed numbers by a few per cent.

    Places count beside the range of the record, angles beside 1 rad.
    """
    believed = believed_values(diagnosis.axis, cause)
    if not believed:
        return False
    changes = []
    for name, before in believed.items():
        scale = abs(before)
        kind = kind_of(cause.effect, name)
        if kind == "place":
            scale = diagnosis.record.range
        elif kind == "angle":
            scale = 1.0
        changes.append(abs(cause.parameters[name] - before) - SMALL * scale)
    return max(changes) <= 0.0


def with_error(value: float, error: float, unit: str = "1") -> str:
    """A value and its standard error, which is given two digits.

    Parameters
    ----------
    value, error : float
        Value and standard error; an error that is not finite leaves it open.
    unit : str, optional
        Unit, "1" for a ratio.

    Returns
    -------
    str

    Examples
    --------
    >>> with_error(-1.010704, 3.78e-5, "N")
    '-1.010704 +- 0.000038 N'
    >>> with_error(1234.5, 160.0), with_error(2.1e-5, 3e-7, "m")
    ('1230 +- 160', '(2.100 +- 0.030)e-05 m')
    """
    unit = "" if unit == "1" else f" {unit}"
    if not math.isfinite(error):
        return f"{value:.3g}{unit} (undetermined)"
    if error <= 0.0:
        return f"{value:.5g}{unit}"
    last = int(f"{error:.1e}".split("e")[1]) - 1
    size = max(abs(value), error)
    if 1e-3 <= size < 1e6:
        digits = max(-last, 0)
        return f"{round(value, -last):.{digits}f} +- {round(error, -last):.{digits}f}{unit}"
    power = int(f"{size:.15e}".split("e")[1])
    digits, scale = max(power - last, 0), 10.0**power
    return f"({value / scale:.{digits}f} +- {error / scale:.{digits}f})e{power:+03d}{unit}"


def change_text(kind: str, before: float, after: float, unit: str = "1") -> str:
    """How far a believed number is off, in words; nothing where zero was believed.

    Examples
    --------
    >>> change_text("amount", 2.8, 2.87), change_text("place", 0.1, 0.12, "m")
    ('+2.5 %', '+0.02 m')
    """
    if kind in ("place", "angle"):
        return f"{after - before:+.2g} {unit}"
    if before == 0.0:
        return ""
    ratio = after / before
    return f"{100.0 * (ratio - 1.0):+.2g} %" if abs(ratio) < 3.0 else f"{ratio:.3g} times"


def parameter_texts(cause: Cause, axis: FrictionAxis | None = None) -> list[str]:
    """Parameters of a cause, one text each, beside what was believed of them.

    Parameters
    ----------
    cause : Cause
        What was found.
    axis : FrictionAxis, optional
        The axis as believed.

    Returns
    -------
    list of str
    """
    believed = {} if axis is None else believed_values(axis, cause)
    texts = []
    for name, value in cause.parameters.items():
        unit = cause.units[name]
        found = with_error(value, cause.standard_errors[name], unit)
        if name not in believed:
            texts.append(f"{name} = {found}")
            continue
        change = change_text(kind_of(cause.effect, name), believed[name], value, unit)
        text = f"{name} {believed[name]:.5g} -> {found}"
        texts.append(f"{text} ({change})" if change else text)
    return texts


def cause_text(cause: Cause, axis: FrictionAxis | None = None) -> str:
    """Cause, parameters and alternatives in one line."""
    name = cause.title if cause.title == cause.effect else f"{cause.title} ({cause.effect})"
    text = f"{name}: {', '.join(parameter_texts(cause, axis))}"
    if cause.alternatives:
        others = ", ".join(map(title_of, cause.alternatives))
        text += f"; this record cannot tell it from {others}"
    return text


def plain(value: float) -> str:
    """A ratio with three digits and, up to a million, no exponent.

    Examples
    --------
    >>> plain(3884.2), plain(0.12345)
    ('3880', '0.123')
    """
    return f"{float(f'{value:.3g}'):g}"


def times_smaller(gain: float) -> float:
    """Ratio of typical errors that a fall of the mean log score stands for.

    Notes
    -----
    The score log(1 + (error/noise)^2 / 4) falls by 2 log(q) where the error,
    counted together with the noise, becomes q times smaller.
    """
    return math.exp(0.5 * gain)


def levels(axis: FrictionAxis, x: ArrayLike, direction: int) -> FloatArray:
    """Coulomb level with every effect that changes it, without Stribeck peak.

    Parameters
    ----------
    axis : FrictionAxis
        The axis.
    x : array_like, shape (n,)
        Positions.
    direction : int
        +1 or -1.

    Returns
    -------
    ndarray, shape (n,)
        Friction of the axis as it begins to slide there at time zero, without
        load.

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0,
    ...                         effects=(dfc.effects.CoulombAsymmetry(force=1.0),))
    >>> levels(axis, [0.0], 1).tolist(), levels(axis, [0.0], -1).tolist()
    ([9.0], [7.0])
    """
    acting = axis.effective()
    alone = acting.replace(
        stribeck=None, effects=tuple(e for e in acting.effects if e.action == "friction")
    )
    block = alone.mode(direction)
    places = np.atleast_1d(np.asarray(x, dtype=float))
    return np.array([direction * block.output(0.0, [place, 0.0], [0.0])[2] for place in places])


def viscous_coefficient(axis: FrictionAxis, direction: int) -> float:
    """Viscous coefficient in one direction.

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0,
    ...                         effects=(dfc.effects.ViscousAsymmetry(viscous=-3.0),))
    >>> round(viscous_coefficient(axis, 1), 9), round(viscous_coefficient(axis, -1), 9)
    (12.0, 18.0)
    """
    acting = axis.effective()
    return acting.viscous + sum(effect.viscous_in(direction) for effect in acting.effects)


def visited(diagnosis: Diagnosis, points: int = 3) -> FloatArray:
    """Positions over the range that the record visited, from end to end."""
    x = diagnosis.record.x
    return np.linspace(float(x.min()), float(x.max()), points)


def level_table(diagnosis: Diagnosis, points: int = 3) -> dict[str, Any]:
    """Coulomb levels as believed and as found over the range of the record.

    Parameters
    ----------
    diagnosis : Diagnosis
        What was found.
    points : int, optional
        Number of positions.

    Returns
    -------
    dict
        "x", and for "believed" and "found" the levels "forwards" and
        "backwards", lists of `points` numbers.
    """
    x = visited(diagnosis, points)
    sides = {"believed": diagnosis.axis, "found": diagnosis.extended}
    table: dict[str, Any] = {"x": x.tolist()}
    for side, axis in sides.items():
        table[side] = {way: levels(axis, x, s).tolist() for s, way in WAYS}
    return table


def level_varies(table: dict[str, Any]) -> bool:
    """Whether a table's level depends on position or direction, on either side."""
    return any(
        np.ptp([*table[side]["forwards"], *table[side]["backwards"]])
        > 1e-9 * max(table[side]["forwards"])
        for side in ("believed", "found")
    )


def level_moves(table: dict[str, Any]) -> bool:
    """Whether a table's level depends on position, on either side."""
    return any(
        np.ptp(table[side][way]) > 1e-9 * max(table[side][way])
        for side in ("believed", "found")
        for _, way in WAYS
    )


def level_text(table: dict[str, Any], side: str, units: tuple[str, str]) -> str:
    """Levels of one side of a table in words."""
    length, force = units
    told = []
    for _, way in WAYS:
        values = [f"{value:.3g} {force}" for value in table[side][way]]
        if len(set(values)) > 1:
            values = [
                f"{v} at x = {x:.3g} {length}" for v, x in zip(values, table["x"], strict=True)
            ]
        told.append(", ".join(dict.fromkeys(values)))
    if told[0] == told[1]:
        return f"{told[0]}, both ways"
    mark = ": " if "," in "".join(told) else " "
    return (";" if mark == ": " else ",").join(
        f" {way}{mark}{words}" for (_, way), words in zip(WAYS, told, strict=True)
    )[1:]


def meaning(diagnosis: Diagnosis, cause: Cause) -> list[str]:
    """What a cause comes to in the axis: numbers in its units, a line each.

    Parameters
    ----------
    diagnosis : Diagnosis
        What was found.
    cause : Cause
        One of its causes.

    Returns
    -------
    list of str
        Nothing for a cause whose parameters say it themselves.
    """
    d, lines = diagnosis, []
    effect = d.extended.named_effects().get(cause.effect)
    if effect is not None and effect.viscous_in(1) != 0.0:
        unit = d.axis.unit("N s/m")
        sides = []
        for axis in (d.extended, d.axis):
            one, other = (f"{viscous_coefficient(axis, s):.4g} {unit}" for s, _ in WAYS)
            sides.append(
                f"{one}, both ways" if one == other else f"forwards {one}, backwards {other}"
            )
        lines.append(f"viscous friction (x grows forwards): {sides[0]}; believed: {sides[1]}")
    if effect is not None and effect.meaning(d.axis.units):
        lines.append(effect.meaning(d.axis.units))
    # The level is that of all causes: it is told once.
    first = next((one.effect for one in d.main_causes if acts_on_level(one)), None)
    if cause.effect == first:
        table = level_table(d)
        drifts = any(e.action == "friction" and e.depends_on_time for e in d.extended.effects)
        when = ", at the start" if drifts else ""
        for side in ("found", "believed"):
            words = level_text(table, side, d.axis.units)
            lines.append(f"Coulomb level {side} (x grows forwards{when}): {words}")
    return lines


def acts_on_level(cause: Cause) -> bool:
    """Whether a cause makes the Coulomb level depend on place or direction."""
    effect = class_of(cause.effect)
    return (
        effect is not None
        and effect.action == "friction"
        and (effect.depends_on_direction or effect.depends_on_place)
    )
