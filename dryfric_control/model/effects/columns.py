"""What an effect would add to a model, as columns of a regression on the innovations."""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import MISSING, fields
from typing import Any, NamedTuple, Protocol

import numpy as np

from dryfric_control.arrays import Floats
from dryfric_control.compiled.windowed_runs import accelerations
from dryfric_control.units import powers

#: A class of `Effect`, which is built upon this module.
EffectClass = type[Any]

#: Velocities over which friction may change, as parts of the usual ones.
PARTS = (0.01, 0.02, 0.05, 0.1, 0.2, 0.4)
# Least number of readings in a row without motion that are a rest.
_SHORTEST_REST = 3
# Largest number of shapes of an effect that has no columns of its own.
_MOST_SHAPES = 256
# Lengths of an effect with a memory, as parts of the travel: a contact gives way by little of it.
_BENDS = (3e-4, 3e-3, 3e-2)
# Its forces, as a part of the usual Coulomb level.
_FORCE = 0.3


class View(Protocol):
    """The states of a model in its records, one after the other, and typical sizes."""

    axis: Any
    t: Floats
    readings: Floats  # recorded positions
    x: Floats
    v: Floats
    a: Floats
    u: Floats
    load: Floats  # known force on the mass [N], shape (0,) for none
    direction: Floats  # +1 or -1; 0 at rest
    level: Floats  # Coulomb level [N]
    lift: Floats  # friction over that level, which a Stribeck peak raises
    drive: Floats  # after its gain and limits [N]
    carried: Floats  # load of the transmission: that less the force effects [N]
    size: float  # typical Coulomb level [N]
    middle: float  # of the travel [m]
    span: float  # of the travel [m]
    fast: float  # largest usual speed [m/s]
    top: float  # largest usual drive [N]
    duration: float  # of the longest record [s]
    quantum: float  # resolution of the readings [m]
    dt: float  # [s]

    def waves(self, kind: str) -> tuple[list[float], float]:
        """Strongest frequencies of a kind, see `sines`, and the number of lobes searched."""


class Column(NamedTuple):
    """One shape of an effect.

    Without force and reading, the effect is simulated with the values for a coefficient of 1.
    """

    #: Parameters of the effect for coefficients.
    values: Callable[[Sequence[float]], dict[str, float]]
    force: Sequence[Floats] = ()  # for a coefficient of 1 [N]
    reading: Sequence[Floats] = ()  # addition to the readings for a coefficient of 1 [m]
    positive: bool = False  # the first coefficient must be
    most: float = math.inf  # largest size of the first coefficient
    shapes: float = 1.0  # searched for this one, if more than columns
    told: bool = False  # whether the record itself tells its values


def proportional_column(
    name: str, force: Floats, positive: bool = False, **others: float
) -> Column:
    """Column of an effect that is proportional to one parameter; `others` are fixed."""
    return Column(lambda c: {name: float(c[0]), **others}, (force,), positive=positive)


def simulated_column(**values: float) -> Column:
    """Shape of an effect without a force column, at these values."""
    return Column(lambda c: dict(values), positive=True)


def sine(**others: float) -> Callable[[Sequence[float]], dict[str, float]]:
    """Values for the coefficients of a sine and a cosine."""

    def values(c: Sequence[float]) -> dict[str, float]:
        return {"amplitude": math.hypot(c[0], c[1]), "phase": math.atan2(c[1], c[0]), **others}

    return values


def sines(view: View, kind: str) -> Iterator[Column]:
    """Sines at the strongest frequencies.

    Of a "force", the "friction" or a "reading" along x, or of a force over "time".
    """
    waves, lobes = view.waves(kind)
    size = friction(view) if kind == "friction" else 1.0
    for wave in waves:
        angle = 2.0 * math.pi * wave * (view.t if kind == "time" else view.x)
        values = sine(frequency=wave) if kind == "time" else sine(period=1.0 / wave)
        pair = (np.sin(angle), np.cos(angle))
        if kind == "reading":
            yield Column(values, (), pair, shapes=lobes)
        else:
            yield Column(values, [size * one for one in pair], shapes=lobes)


def friction(view: View) -> Floats:
    """Force of the Coulomb level, raised by a Stribeck peak [N]."""
    return -view.direction * view.level * view.lift


def peaks(view: View, name: str, force: Floats, positive: bool = False) -> Iterator[Column]:
    """A force that fades over velocity as a Stribeck peak, over parts of the usual speed."""
    for part in PARTS:
        speed = part * view.fast
        yield proportional_column(name, peak_at(view, force, speed), positive, speed=speed)


def fades(view: View) -> Iterator[tuple[float, Floats]]:
    """Time constants up to the length of the record, and what fades with them; longer is drift."""
    for part in (0.05, 0.1, 0.2, 0.4, 0.8):
        time_constant = part * view.duration
        yield time_constant, np.exp(-view.t / time_constant)


def peak_at(view: View, force: Floats, speed: float) -> Floats:
    """A force that fades over velocity as a Stribeck peak."""
    return np.asarray(force * np.exp(-np.minimum((view.v / speed) ** 2, 40.0)))


def breakaway_levels(view: View) -> tuple[Floats, Floats]:
    """Times at rest [s], and forces beyond the level [N], at which the axis breaks away."""
    # The states of a model without this are wrong just there.
    step = np.diff(view.readings)
    moves = np.abs(step) > view.quantum
    index = np.arange(moves.size)
    last = np.maximum.accumulate(np.where(moves, index, -1))
    ends = np.flatnonzero(~moves[:-1] & moves[1:])  # last steps of rests
    ends = ends[ends - last[ends] >= _SHORTEST_REST]
    net = view.drive + view.load if view.load.size else view.drive
    beyond = np.sign(step[ends + 1]) * net[ends + 1] - view.level[ends + 1]
    return np.asarray((ends - last[ends]) * view.dt, dtype=float), beyond


def delayed_columns(
    view: View, name: str, delayed: Callable[[float], Floats], samples: Sequence[float]
) -> Iterator[Column]:
    """Drives that act late by some samples, as a force over the time."""
    for late in samples:
        found = proportional_column(
            name, (delayed(late) - view.drive) / (late * view.dt), positive=True
        )
        yield found._replace(most=2.0 * late * view.dt)


def by_law(effect: EffectClass, view: View) -> Iterator[Column]:
    """Columns of an effect over a grid of its parameters, from its law."""
    if effect.states:
        # What it does follows from the whole motion before: each shape is simulated.
        for shape in _shapes({item.name: _state_parts(item, view) for item in fields(effect)}):
            yield simulated_column(**shape)
        return
    grid = {item.name: _parts(item, view) for item in fields(effect)}
    middle = {name: values[len(values) // 2] for name, values in grid.items()}
    linear = _linear_parameter(effect, middle, view)
    positive = True
    if linear is not None:
        grid[linear] = [middle[linear]]
        positive = effect.parameters()[linear]["bounds"][0] >= 0.0
    for shape in _shapes(grid):
        force = effect_contribution(effect, shape, view)
        values = functools.partial(_linear_values, shape, linear)
        if not np.any(force) or not np.isfinite(force).all():
            yield simulated_column(**shape)
        elif effect.action == "reading":
            yield Column(values, (), (force,), positive)
        else:
            yield Column(values, (force,), (), positive)


def _shapes(grid: Mapping[str, Sequence[float]]) -> Iterator[dict[str, float]]:
    """Values of an effect at the points of a grid, as far as they are tried."""
    for point in itertools.islice(itertools.product(*grid.values()), _MOST_SHAPES):
        yield dict(zip(grid, point, strict=True))


def _linear_parameter(effect: EffectClass, middle: dict[str, float], view: View) -> str | None:
    """The first parameter that an effect is proportional to, None where it is to none."""
    for name, value in middle.items():
        one, two = (
            effect_contribution(effect, middle | {name: f * value}, view) for f in (1.0, 2.0)
        )
        if np.any(one) and np.allclose(two, 2.0 * one, rtol=1e-6):
            return name
    return None


def _linear_values(
    shape: dict[str, float], linear: str | None, c: Sequence[float]
) -> dict[str, float]:
    """Values of a shape for the coefficient of the parameter that it is proportional to."""
    return shape if linear is None else shape | {linear: float(c[0]) * shape[linear]}


def _parts(item: Any, view: View) -> list[float]:
    """Values of one parameter to try: parts of what its kind and unit say."""
    low, high = item.metadata["bounds"]
    default = item.default
    neutral = item.metadata["neutral"]
    neutral = float(default if default is not MISSING else np.clip(neutral or 0.0, low, high))
    kind = item.metadata["kind"]
    if kind == "angle":
        values = [neutral + turn * math.pi for turn in (-0.5, 0.5, 1.0, 0.0)]
    elif kind == "share":
        values = [0.35, 0.5, 0.65]
    elif kind == "time":
        values = [samples * view.dt for samples in (0.3, 1.5, 3.5, 8.0)]
    else:
        force, length, time = powers(item.metadata["unit"])
        size = view.size**force * view.span**length * (view.span / view.fast) ** time
        # What may have either sign is an amount, the rest may be a place or a pace.
        parts = (0.3, -0.3) if low < neutral else (0.03, 0.1, 0.3, 1.0)
        values = [neutral + part * size for part in parts]
    return [float(np.clip(value, low, high)) for value in values]


def _state_parts(item: Any, view: View) -> list[float]:
    """The same of an effect with a memory: forces at one size, lengths over a wide range."""
    force, length, time = powers(item.metadata["unit"])
    if item.metadata["kind"] != "amount" or (force, length) == (0, 0):
        return _parts(item, view)
    low, high = item.metadata["bounds"]
    size = (_FORCE * view.size) ** force * (view.span / view.fast) ** time
    values = [size * (part * view.span) ** length for part in (_BENDS if length else (1.0,))]
    return [float(np.clip(value, low, high)) for value in values]


def effect_contribution(effect: EffectClass, values: dict[str, float], view: View) -> Floats:
    """What an effect adds to the force on the axis or to its readings; zeros if it cannot."""
    bounds = {item.name: item.metadata["bounds"] for item in fields(effect)}
    none = np.zeros(view.x.size)
    within = {name: min(max(v, bounds[name][0]), bounds[name][1]) for name, v in values.items()}
    try:
        one = effect(**within)
        axis = view.axis.replace(effects=(*view.axis.effects, one))
    except ValueError:
        return none
    if effect.action == "reading":
        rows = zip(view.t, view.x, view.v, view.u, view.level, view.direction, strict=True)
        return np.array([effect.law(*row, 0.0, one.values) for row in rows])
    return difference(axis, view)


def difference(axis: Any, view: View) -> Floats:
    """Force that another axis has beyond that of the model while it slides."""
    model = []
    sign = np.sign(view.direction).astype(np.int64)
    for each in (axis, view.axis):
        arrays = each.arrays(1.0)
        states = (view.t, view.x, view.v, view.u, view.load, sign)
        model.append(accelerations(arrays.numbers, arrays.integers, *states))
    return np.where(sign != 0, view.axis.mass * (model[0] - model[1]), 0.0)
