"""Friction of an axis over its velocity, as numbers and as a curve."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dryfric_control.arrays import Floats
from dryfric_control.compiled.windowed_runs import NO_FORCE, accelerations
from dryfric_control.text import typeset_signs

#: A `FrictionAxis`, which is built upon this module.
Axis = Any

# Number of velocities of one direction.
_POINTS = 241
# Number of positions over the travel.
_PLACES = 49
# Largest velocity shown by default, over the Stribeck velocity;
_STRIBECK = 8.0
# without one, that at which the viscous force is this part of the Coulomb level;
_SHARE = 0.5
# without that, over the stick velocity.
_STICK = 1e3


def net_force(axis: Axis, t: Any, x: Any, v: Any, u: Any, way: Any, load: Any = NO_FORCE) -> Floats:
    """Force on the mass of a rigid axis at states, `way` the direction of each, shape (n,).

    `load`: known force on the mass at each state.
    """
    arrays = axis.arrays(1.0, moved=False)
    way = way.astype(np.int64)
    return axis.mass * accelerations(arrays.numbers, arrays.integers, t, x, v, u, load, way)


def friction_over_velocity(axis: Axis, v: ArrayLike, x: ArrayLike) -> Floats:
    """Friction of a sliding axis, and effects that depend on velocity; no load, at time zero."""
    axis = axis.effective()
    levels = [e for e in axis.effects if e.action == "friction"]
    forces = [e for e in axis.effects if e.action == "force" and e.depends_on_speed]
    alone = axis.replace(effects=(*levels, *forces))
    velocity, place = (np.array(a, dtype=float) for a in np.broadcast_arrays(v, x))
    rest = np.zeros(velocity.size)
    way = np.where(np.signbit(velocity), -1, 1).ravel()  # -0.0 is backwards
    found = net_force(alone, rest, place.ravel(), velocity.ravel(), rest, way)
    return np.asarray(0.0 - found.reshape(velocity.shape))


def usual_speed(axis: Axis) -> float:
    """Largest velocity that a curve shows if none is asked for."""
    axis = axis.effective()
    if axis.stribeck is not None and axis.stribeck.excess > 0.0:
        return _STRIBECK * max(axis.stribeck.speed, axis.stick_speed)
    level = float(max(axis.coulomb(np.mean(axis.travel or 0.0), s) for s in (1, -1)))
    if axis.viscous > 0.0 and level > 0.0:
        return _SHARE * level / axis.viscous
    return _STICK * axis.stick_speed


def draw_curve(
    axis: Axis, ax: Any, speed: float, span: tuple[float, float], label: str, **style: Any
) -> None:
    """Draw friction over velocity in mid-travel, a band over positions, breakaway at zero."""
    places = np.linspace(*span, _PLACES)
    # The peak lies at the stick velocity: dense there.
    grid = np.concatenate(
        ([0.0, axis.stick_speed], speed * np.linspace(0.0, 1.0, _POINTS)[1:] ** 3)
    )
    grid = np.unique(np.minimum(grid, speed))
    v = np.concatenate((-grid[::-1], grid))
    force = friction_over_velocity(axis, v[:, None], places[None, :])
    low = force.min(axis=1)
    high = force.max(axis=1)
    colour = style.get("color", "k")
    if np.any(high - low > 1e-9 * np.abs(force).max()):
        ax.fill_between(
            v, low, high, color=colour, alpha=0.18, lw=0, label=f"{label}, over the travel"
        )
    ax.plot(v, force[:, _PLACES // 2], label=label, **style)


def draw_friction(axis: Axis, ax: Any, speed: float, span: tuple[float, float]) -> None:
    """Draw friction over velocity with what it is made of."""
    axis = axis.effective()
    draw_curve(axis, ax, speed, span, "friction", color="k", lw=1.6)
    middle, (length, force) = float(np.mean(span)), axis.units
    peak = axis.stribeck is not None and axis.stribeck.excess > 0.0
    for s in (1, -1):
        ways = s * np.array([0.0, speed])
        if peak:
            smooth = friction_over_velocity(axis.replace(stribeck=None), ways, middle)
            ax.plot(ways, smooth, "C0--", lw=1.0, label="without Stribeck peak" if s > 0 else None)
        start = s * (axis.stick_speed if peak else 0.0)
        level = float(friction_over_velocity(axis, start, middle))
        name = "breakaway friction force" if s > 0 else None
        ax.plot(start, level, "o", color="C3", ms=4, label=name)
        ax.annotate(
            typeset_signs(f"{abs(level - axis.viscous * start):.3g} {force}"), (start, level),
            (8 * s, 5 * s), textcoords="offset points", fontsize="small", color="C3",
            ha="left" if s > 0 else "right", va="bottom" if s > 0 else "top",
        )  # fmt: skip
    ax.axhline(0.0, color="0.7", lw=0.8, zorder=0)
    ax.set_xlabel(f"velocity [{length}/s]")
    ax.set_ylabel(f"friction [{force}]")
    ax.margins(x=0.0, y=0.14)
