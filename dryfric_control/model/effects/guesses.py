"""First guesses of an effect's parameters, from the force residual of a record."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import MISSING, fields
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from dryfric_control.compiled.windowed_runs import accelerations
from dryfric_control.model.units import powers

FloatArray = NDArray[np.float64]
#: A class of `Effect`, which is built upon this module.
EffectClass = type[Any]

# Guesses of an effect that has none of its own.
_MOST_GUESSES = 256


class View(Protocol):
    """What `Effect.guess` may look at: sliding samples and typical sizes.

    Attributes
    ----------
    axis : FrictionAxis
        The axis that leaves the residual.
    t, x, v, a, u : ndarray, shape (n,)
        Zero-phase motion and drive of sliding samples.
    carried : ndarray, shape (n,)
        Load of the transmission there: the drive less the force effects [N].
    direction : ndarray of int64, shape (n,)
        +1 or -1.
    residual : ndarray, shape (n,)
        Force that the axis would need beside its drive [N].
    level : float
        Typical Coulomb level [N].
    middle, span : float
        Middle and length of the travel in the record [m].
    quantum, dt : float
        Resolution of the readings [m], sampling time [s].
    drive : ndarray
        All samples of the input, sliding or not [N].
    believed : dict of str to float
        Base parameters as the user believes them.
    """

    axis: Any
    t: FloatArray
    x: FloatArray
    v: FloatArray
    a: FloatArray
    u: FloatArray
    direction: NDArray[np.int64]
    residual: FloatArray
    level: float
    middle: float
    span: float
    quantum: float
    dt: float
    drive: FloatArray
    believed: dict[str, float]

    @property
    def carried(self) -> FloatArray:
        """Load of the transmission."""

    def regress(self, columns: Sequence[FloatArray]) -> tuple[FloatArray, dict[str, float]]:
        """Coefficients of force columns, and the base parameters beside them."""

    def beside(self, force: FloatArray) -> dict[str, float]:
        """Base parameters if a force of known size acts."""

    def periods(self, along: FloatArray) -> list[tuple[float, FloatArray, dict[str, float]]]:
        """Strongest sines along x or t: frequency, coefficients, base parameters."""


#: First guess: values of an effect, and of base parameters beside it.
Guess = tuple[dict[str, float], dict[str, float]]


def linear(view: View, force: FloatArray, name: str, least: float = -math.inf) -> Iterator[Guess]:
    """Guesses of the one parameter of a force that is proportional to it.

    Parameters
    ----------
    view : View
        The force residual.
    force : ndarray, shape (n,)
        Force for a parameter of 1.
    name : str
        The parameter.
    least : float, optional
        Smallest guess.

    Yields
    ------
    tuple of dict
        With the base parameters fitted along, and alone: the base may be right,
        and all but the same on this record.
    """
    size = float(force @ force)
    if size == 0.0:
        return
    c, base = view.regress([force])
    yield {name: max(float(c[0]), least)}, base
    yield {name: max(float(force @ view.residual) / size, least)}, {}


def tried(effect: EffectClass, view: View) -> Iterator[Guess]:
    """Guesses over a grid; what the law is proportional to, and the base, by regression."""
    grid = {item.name: _parts(item, view) for item in fields(effect)}
    middle = {name: values[len(values) // 2] for name, values in grid.items()}
    column = force_of(effect, middle, view)
    amount = None
    for name, value in middle.items():
        twice = force_of(effect, middle | {name: 2.0 * value}, view)
        if amount is None and np.any(column) and np.allclose(twice, 2.0 * column, rtol=1e-6):
            amount = name
            grid[name] = [value]
    for values in itertools.islice(itertools.product(*grid.values()), _MOST_GUESSES):
        guess = dict(zip(grid, values, strict=True))
        column = force_of(effect, guess, view)
        if not np.any(column) or not np.all(np.isfinite(column)):
            yield guess, {}
        elif amount is None:
            yield guess, view.beside(column)
        else:
            c, base = view.regress([column])
            yield guess | {amount: float(c[0]) * guess[amount]}, base
            yield guess, {}


def _parts(item: Any, view: View) -> list[float]:
    """Values of one parameter to try: parts of what its kind and unit say."""
    low, high = item.metadata["bounds"]
    default, neutral = item.default, item.metadata["neutral"]
    neutral = float(default if default is not MISSING else np.clip(neutral or 0.0, low, high))
    kind = item.metadata["kind"]
    if kind == "angle":
        values = [neutral + turn * math.pi for turn in (-0.5, 0.5, 1.0, 0.0)]
    elif kind == "share":
        values = [0.35, 0.5, 0.65]
    elif kind == "time":
        values = [samples * view.dt for samples in (0.3, 1.5, 3.5, 8.0)]
    else:
        fast = max(float(np.quantile(np.abs(view.v), 0.9)) if view.v.size else 0.0, 1e-12)
        force, length, time = powers(item.metadata["unit"])
        size = view.level**force * view.span**length * (view.span / fast) ** time
        # What may have either sign is an amount, the rest may be a place or a pace.
        parts = (0.3, -0.3) if low < neutral else (0.03, 0.1, 0.3, 1.0)
        values = [neutral + part * size for part in parts]
    return [float(np.clip(value, low, high)) for value in values]


def force_of(effect: EffectClass, values: dict[str, float], view: View) -> FloatArray:
    """Force that an effect adds to the sliding samples; zeros where it has no such values."""
    bounds = {item.name: item.metadata["bounds"] for item in fields(effect)}
    within = {name: min(max(v, bounds[name][0]), bounds[name][1]) for name, v in values.items()}
    try:
        axis = view.axis.replace(effects=(*view.axis.effects, effect(**within)))
    except ValueError:
        return np.zeros(view.x.size)
    model = []
    for one in (axis, view.axis):
        arrays = one.arrays(1.0)
        model.append(np.empty(view.x.size))
        accelerations(
            arrays.numbers, arrays.integers, view.t, view.x, view.v, view.u, view.direction,
            model[-1],
        )  # fmt: skip
    return np.asarray(view.axis.mass * (model[0] - model[1]))
