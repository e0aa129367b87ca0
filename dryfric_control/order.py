"""Arguments in the wrong order, where their values show it."""

from __future__ import annotations

from typing import Any

import numpy as np

from dryfric_control.arrays import Floats

#: Time over which accelerations are taken [s]: quantisation is small over it.
_SPAN = 0.05
#: Samples that are sufficient.
_ENOUGH = 2000
#: Longest sampling time that may be an increment [s].
_STEP = 1e-5
#: Widest increment that may be a sampling time [m].
_INCREMENT = 0.1


def check_quantum_and_dt(name: str, quantum: float, dt: float) -> None:
    """Refuse an increment and a sampling time of each other's size."""
    if dt <= _STEP < quantum < _INCREMENT:
        raise ValueError(
            f"{name} = {quantum:g} and dt = {dt:g}, which is {1.0 / dt:.3g} readings a second, "
            f"look exchanged: give both by name, {name}={dt:g}, dt={quantum:g}"
        )


def check_bandwidth_and_dt(bandwidth: float, dt: float) -> None:
    """Refuse a bandwidth and a sampling time of each other's size."""
    if bandwidth < dt:
        raise ValueError(
            f"bandwidth = {bandwidth:g} rad/s and dt = {dt:g} s look exchanged: give both by "
            f"name, bandwidth={dt:g}, dt={bandwidth:g}"
        )


def check_drive_and_reading(
    axis: Any, dt: float, u: Floats, y: Floats, names: tuple[str, str] = ("u", "y")
) -> None:
    """Refuse drive and reading if the equation of motion fits them far better exchanged."""
    if any(effect.slug == "input_gain" for effect in axis.effects):
        return  # a drive in any unit
    given = _misfit(axis, dt, u, y)
    exchanged = _misfit(axis, dt, y, u)
    if 2.0 * exchanged < given:  # not so where nothing moves: the misfit is no number
        raise ValueError(
            f"{names[0]} and {names[1]} look exchanged: as drive and position they contradict the "
            f"axis' equation of motion by {given:.0%}, the other way round by {exchanged:.0%}; "
            f"give the drive as {names[0]} and the position as {names[1]}"
        )


def _misfit(axis: Any, dt: float, u: Floats, y: Floats) -> float:
    """Force that the equation of motion lacks while moving, as a part of all its terms."""
    axis = axis.effective()
    n = max(1, min(u.size // 10, round(_SPAN / dt)))
    at = np.arange(n, u.size - n, 1 + u.size // _ENOUGH)
    after = y[at + n]
    before = y[at - n]
    v = (after - before) / (2.0 * n * dt)
    inertia = axis.mass * (after - 2.0 * y[at] + before) / (n * dt) ** 2
    terms = np.array([u[at], -inertia, -axis.viscous * v, -axis.coulomb.mean * np.sign(v)])
    moving = np.abs(v) > 0.1 * np.abs(v).max(initial=0.0)
    with np.errstate(invalid="ignore"):
        return float(np.abs(terms.sum(0))[moving].sum() / np.abs(terms)[:, moving].sum())
