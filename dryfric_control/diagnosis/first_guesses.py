"""First guesses of a candidate's parameters, from the force residual of sliding samples."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import MISSING, fields

import numpy as np
from numpy.typing import NDArray

from dryfric_control.diagnosis.candidates import holds, other_numbers, with_effect
from dryfric_control.estimation.force_residual import Values, View
from dryfric_control.estimation.parameters import powers
from dryfric_control.model.effects import Effect
from dryfric_control.ties import above, ranked

FloatArray = NDArray[np.float64]

# Set by `benchmarks/diagnosis.py --effects cogging time_periodic` and its run times.
# Points of the search grid for a period within one width of the main lobe.
_FINE = 4
# Periods: the shortest over the smoothing's own reach, the most of them.
_MOST_PERIODS = 400
# Guesses of an effect that has none of its own.
_MOST_GUESSES = 256


def _regress(v: View, columns: list[FloatArray]) -> tuple[FloatArray, FloatArray]:
    """Coefficients of columns and of mass, viscous, coulomb: robust least squares."""
    s = v.direction
    base = [v.a, v.v, v.axis.coulomb(np.asarray(v.x), 1) / v.level * s]
    matrix = np.column_stack([*columns, *base])
    size = np.sqrt(np.mean(matrix**2, axis=0))
    size[size == 0.0] = 1.0
    matrix = matrix / size
    target = v.residual
    weight = np.ones(target.size)
    # A trace of ridge keeps base corrections small where nothing tells them apart.
    ridge = 1e-4 * target.size * np.eye(matrix.shape[1])
    ridge[: len(columns), : len(columns)] *= 1e-3
    c = np.zeros(matrix.shape[1])
    for _ in range(4):
        weighted = matrix * weight[:, None]
        c = np.linalg.solve(matrix.T @ weighted + ridge, weighted.T @ target)
        rest = np.abs(target - matrix @ c)
        weight = 1.0 / np.maximum(rest, np.median(rest) + 1e-12 * v.level)
        weight *= 1.0 / weight.max()
    c = c / size
    return c[: len(columns)], c[len(columns) :]


def _base(v: View, change: FloatArray) -> Values:
    """Base parameters that the regression found, within reason."""
    axis = v.axis
    level = 0.5 * (axis.coulomb.plus[0] + axis.coulomb.minus[0])
    # residual = -(column) for what resists: m a + f v + Fc s is taken from the drive.
    found = {
        "mass": axis.mass + change[0],
        "viscous": axis.viscous - change[1],
        "coulomb": level * (1.0 - change[2] / v.level),
    }
    return {
        "mass": float(np.clip(found["mass"], 0.3 * axis.mass, 3.0 * axis.mass)),
        "viscous": float(max(found["viscous"], 0.2 * axis.viscous)),
        "coulomb": float(np.clip(found["coulomb"], 0.3 * level, 3.0 * level)),
    }


def _periods(v: View, along: FloatArray) -> list[tuple[float, FloatArray, FloatArray]]:
    """Strongest sines along x or t: frequency, coefficients, base change."""
    reach = float(np.ptp(along))
    if reach <= 0.0:
        return []
    # Base columns are taken out of the residual and of the sines alike.
    base = np.column_stack([v.a, v.v, np.sign(v.v)])
    q, _ = np.linalg.qr(base)
    target = np.clip(v.residual, -2.0 * v.level, 2.0 * v.level)
    target = target - q @ (q.T @ target)
    highest = min(_MOST_PERIODS, along.size // 4)
    grid = np.arange(2 * _FINE, highest * _FINE) / (_FINE * reach)
    power = np.empty(grid.size)
    turned = np.exp(-2j * np.pi * grid[0] * along) * target
    turn = np.exp(-2j * np.pi / (_FINE * reach) * along)
    for i in range(grid.size):
        power[i] = abs(turned.sum())
        turned *= turn
    # Of two as high side by side the first is the peak.
    peaks = np.flatnonzero(above(power[1:-1], power[:-2]) & ~above(power[2:], power[1:-1])) + 1
    found = []
    for i in peaks[ranked(-power[peaks])[:2]]:
        f = _refine(along, target, q, grid[i], 1.0 / (_FINE * reach))
        phase = 2.0 * np.pi * f * along
        c, change = _regress(v, [np.sin(phase), np.cos(phase)])
        found.append((float(f), c, change))
    return found


def _refine(along: FloatArray, target: FloatArray, q: FloatArray, f: float, width: float) -> float:
    def left(g: float) -> float:
        phase = 2.0 * np.pi * g * along
        columns = np.column_stack([np.sin(phase), np.cos(phase)])
        columns -= q @ (q.T @ columns)
        c = np.linalg.lstsq(columns, target, rcond=None)[0]
        return float(np.sum((target - columns @ c) ** 2))

    for _ in range(6):
        trial = [f - width, f, f + width]
        f = trial[ranked([left(g) if g > 0.0 else np.inf for g in trial])[0]]
        width *= 0.5
    return f


def _spring(v: View) -> Iterator[tuple[Values, Values]]:
    c, change = _regress(v, [-(v.x - v.middle), np.ones_like(v.x)])
    stiffness = max(c[0], 1e-3 * v.level / v.span)
    rest = v.middle + float(np.clip(c[1] / stiffness, -20.0 * v.span, 20.0 * v.span))
    yield {"stiffness": stiffness, "rest": rest}, _base(v, change)


def _gravity(v: View) -> Iterator[tuple[Values, Values]]:
    c, change = _regress(v, [-np.sin(v.x), np.cos(v.x)])
    amplitude = max(math.hypot(*c), 1e-3 * v.level)
    yield {"amplitude": amplitude, "phase": math.atan2(c[1], c[0])}, _base(v, change)


def _cogging(v: View) -> Iterator[tuple[Values, Values]]:
    for f, c, change in _periods(v, v.x):
        size = max(math.hypot(*c), 1e-3 * v.level)
        yield (
            {"amplitude": size, "period": 1.0 / f, "phase": math.atan2(c[1], c[0])},
            _base(v, change),
        )


def _time_periodic(v: View) -> Iterator[tuple[Values, Values]]:
    for f, c, change in _periods(v, v.t):
        size = max(math.hypot(*c), 1e-3 * v.level)
        yield (
            {"amplitude": size, "frequency": f, "phase": math.atan2(c[1], c[0])},
            _base(v, change),
        )


def _position_dependence(v: View) -> Iterator[tuple[Values, Values]]:
    q = v.x - v.middle
    c, change = _regress(v, [-v.direction * v.level * q, -v.direction * v.level * q**2])
    yield {"slope": c[0], "curvature": c[1], "centre": v.middle}, _base(v, change)


def _linear(column: Callable[[View], FloatArray], name: str, least: float = 0.0):  # type: ignore[no-untyped-def]
    def guess(v: View) -> Iterator[tuple[Values, Values]]:
        bound = -math.inf if least < 0.0 else least
        force = column(v)
        c, change = _regress(v, [force])
        yield {name: max(float(c[0]), bound)}, _base(v, change)
        # Taken alone: the base may be right, and all but the same on this record.
        yield {name: max(float(force @ v.residual / (force @ force)), bound)}, {}

    return guess


def _listed(values: Callable[[View], list[Values]]):  # type: ignore[no-untyped-def]
    def guess(v: View) -> Iterator[tuple[Values, Values]]:
        for one in values(v):
            yield one, {}

    return guess


def _gain(v: View) -> Iterator[tuple[Values, Values]]:
    for c in (_regress(v, [v.u])[0][0], v.u @ v.residual / (v.u @ v.u)):
        yield {"gain": float(np.clip(1.0 + c, 0.2, 5.0))}, {}
    # A gain is the same as all base parameters over it.
    level = 0.5 * (v.axis.coulomb.plus[0] + v.axis.coulomb.minus[0])
    now = {"mass": v.axis.mass, "viscous": v.axis.viscous, "coulomb": level}
    ratios = [v.believed[n] / value for n, value in now.items() if value > 0.0]
    gain = float(np.median(ratios))
    yield {"gain": gain}, {n: gain * value for n, value in now.items()}


def _dead_zones(v: View) -> Iterator[tuple[Values, Values]]:
    for share in (0.05, 0.15, 0.3):
        width = share * v.level
        lost = np.clip(v.u, -width, width)
        yield {"width": width}, _base(v, _regress_fixed(v, -lost))
    # Alone: what the drive loses while it pushes.
    share = float(np.median(-v.residual * np.sign(v.u)) / v.level)
    yield {"width": float(np.clip(share, 0.01, 1.0)) * v.level}, {}


def _saturations(v: View) -> Iterator[tuple[Values, Values]]:
    peak = float(np.abs(v.drive).max())
    for share in (0.97, 0.85, 0.7, 0.5, 0.35, 0.2, 0.12):
        lost = v.u - np.clip(v.u, -share * peak, share * peak)
        yield {"limit": share * peak}, _base(v, _regress_fixed(v, -lost))


def _regress_fixed(v: View, force: FloatArray) -> FloatArray:
    """Base change when a force of known size acts."""
    s = v.direction
    matrix = np.column_stack([v.a, v.v, v.axis.coulomb(np.asarray(v.x), 1) / v.level * s])
    size = np.sqrt(np.mean(matrix**2, axis=0))
    size[size == 0.0] = 1.0
    matrix = matrix / size
    ridge = 1e-4 * v.residual.size * np.eye(3)
    return np.asarray(
        np.linalg.solve(matrix.T @ matrix + ridge, matrix.T @ (v.residual - force)) / size
    )


def _pairs(first: list[float], second: list[float]) -> list[tuple[float, float]]:
    return [(a, b) for a in first for b in second]


def _scaled(v: View) -> float:
    """Elastic length of a contact like this, from the travel."""
    return max(3.0 * v.quantum, 5e-5 * v.span)


def _compliance(v: View) -> list[Values]:
    found: list[Values] = []
    for share, omega in _pairs([0.5], [60.0, 120.0, 200.0, 400.0]):
        reduced = v.axis.mass * share * (1.0 - share)
        found.append(
            {
                "stiffness": reduced * omega**2,
                "damping": 0.1 * reduced * omega,
                "load_fraction": share,
            }
        )
    return found


#: First guesses by slug: values of the effect, and of base parameters if the
#: regression says something on them.
GUESSES: dict[str, Callable[[View], Iterator[tuple[Values, Values]]]] = {
    "bias_force": _linear(lambda v: np.ones_like(v.x), "force", -1.0),
    "coulomb_asymmetry": _linear(lambda v: -np.ones_like(v.x), "force", -1.0),
    "viscous_asymmetry": _linear(lambda v: -np.abs(v.v), "viscous", -1.0),
    "quadratic_drag": _linear(lambda v: -v.v * np.abs(v.v), "drag"),
    "load_dependence": _linear(lambda v: -np.sign(v.v) * np.abs(v.u), "coefficient", 1e-3),
    "drift": _linear(lambda v: -np.sign(v.v) * v.level * v.t, "rate", -1.0),
    "input_gain": _gain,
    "spring": _spring,
    "gravity": _gravity,
    "cogging": _cogging,
    "time_periodic": _time_periodic,
    "position_dependence": _position_dependence,
    "dead_zone": _dead_zones,
    "saturation": _saturations,
    "stribeck": _listed(
        lambda v: [
            {"excess": e, "speed": s * float(np.quantile(np.abs(v.v), 0.9))}
            for e, s in _pairs([0.15, 0.4], [0.02, 0.05, 0.15])
        ]
    ),
    "input_delay": _listed(lambda v: [{"delay": d * v.dt} for d in (1.5, 3.5, 8.0)]),
    "actuator_lag": _listed(lambda v: [{"time_constant": d * v.dt} for d in (1.5, 3.5, 8.0)]),
    # Break-away is all there is to see, and a force read off there is too rough.
    "dwell_time": _listed(
        lambda v: [
            {"rise": r * v.level, "time_constant": c}
            for r, c in _pairs(list(np.geomspace(0.1, 1.2, 8)), list(np.geomspace(0.05, 1.5, 9)))
        ]
    ),
    "presliding": _listed(
        lambda v: [{"distance": r * _scaled(v)} for r in np.geomspace(0.7, 20.0, 8)]
    ),
    "backlash": _listed(
        lambda v: [
            {"gap": r * _scaled(v), "load_fraction": f}
            for r, f in _pairs([1.5, 3.0, 6.0, 12.0, 24.0, 48.0], [0.35, 0.65])
        ]
    ),
    "compliance": _listed(_compliance),
}


def guesses(effect: type[Effect], v: View) -> list[tuple[Values, Values]]:
    """First guesses for one effect: its values, and base values beside it.

    An effect without guesses of its own gets some from its bounds: parts of the
    typical size that the unit of each parameter tells, in every combination; an
    amount that the effect is proportional to comes from regression.
    One that the axis has already starts from the numbers it has there.
    """
    if holds(v.axis, effect.slug):
        return [(values, {}) for values in other_numbers(v.axis, effect)]
    own = GUESSES.get(effect.slug)
    if own is not None:
        return list(own(v))
    return list(_tried(effect, v))


def _tried(effect: type[Effect], v: View) -> Iterator[tuple[Values, Values]]:
    """Guesses over a grid; what the law is proportional to, and the base, by regression."""
    fast = max(float(np.quantile(np.abs(v.v), 0.9)) if v.v.size else 0.0, 1e-12)
    # On a rotary axis the radian is the length.
    rotary = {
        "rad": v.span,
        "rad/s": fast,
        "N m/rad": v.level / v.span,
        "N m s/rad": v.level / fast,
    }
    grid: dict[str, list[float]] = {}
    for item in fields(effect):
        low, high = item.metadata["bounds"]
        if item.default is not MISSING:
            neutral = float(item.default)
        else:
            neutral = float(np.clip(0.0, low, high))
        unit = item.metadata["unit"]
        force, length, time = powers(unit)
        size = v.level**force * v.span**length * (v.span / fast) ** time
        size = rotary.get(unit, size)
        # What may have either sign is an amount, the rest may be a place or a pace.
        parts = (0.3, -0.3) if low < neutral else (0.03, 0.1, 0.3, 1.0)
        grid[item.name] = [float(np.clip(neutral + part * size, low, high)) for part in parts]
    middle = {name: values[len(values) // 2] for name, values in grid.items()}
    column = _column(effect, v, middle)
    amount = None
    for name, value in middle.items():
        twice = _column(effect, v, middle | {name: 2.0 * value})
        if amount is None and np.any(column) and np.allclose(twice, 2.0 * column, rtol=1e-6):
            amount = name
            grid[name] = [value]
    for values in itertools.islice(itertools.product(*grid.values()), _MOST_GUESSES):
        guess = dict(zip(grid, values, strict=True))
        column = _column(effect, v, guess)
        if not np.any(column) or not np.all(np.isfinite(column)):
            yield guess, {}
        elif amount is None:
            yield guess, _base(v, _regress_fixed(v, column))
        else:
            c, change = _regress(v, [column])
            yield guess | {amount: float(c[0]) * guess[amount]}, _base(v, change)
            yield guess, {}


def _column(effect: type[Effect], v: View, values: Values) -> FloatArray:
    """Force that an effect adds to the sliding samples; zeros where it has no such values."""
    try:
        axis = with_effect(v.axis, effect, dict(values)).axis
    except ValueError:
        return np.zeros(v.x.size)
    return np.asarray(v.axis.mass * (v.accelerations(axis) - v.accelerations(v.axis)))
