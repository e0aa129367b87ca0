"""Coulomb levels over position from a crawl, with their uncertainty."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.polynomial import Legendre, Polynomial, legendre
from numpy.typing import ArrayLike

from dryfric_control.arrays import Floats, Ints
from dryfric_control.checks import instance, warn
from dryfric_control.drawing import MEASURED, legend_above, panels
from dryfric_control.estimation.uncertainty import half_width
from dryfric_control.identification.crawl import (
    HIGHEST,
    SLOW,
    Level,
    Pieces,
    average,
    blocks_of,
    choose_degree,
    inner,
    level_of,
)
from dryfric_control.identification.fit import FitWarning
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.model.friction import CoulombMap
from dryfric_control.records.record import Record
from dryfric_control.text import Result, percent, plain_data
from dryfric_control.units import check_units

# Longest piece, as a part of the travel, where speed must not be averaged away.
_FINE = 1.0 / 160.0
# Blocks of the way, or slips, from which a level over position can be found.
_ENOUGH = 8
# Speed that varies more than this (relative) shows viscous friction and inertia.
_VARIES = 0.1
# Fall of friction, over the spread of the velocity and relative to the level, beyond what
# smoothing of the motion brings about (0.002 on a crawl without a peak).
_FALLS = 0.005


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class CoulombIdentification(Result, CoulombMap):
    """Coulomb levels found in a record, with confidence bands; made by `identify_coulomb`.

    It is a `CoulombMap`, so an axis takes it as its ``coulomb``.
    """

    degrees: tuple[int, int]  # for motion in positive and in negative direction
    travel: tuple[float, float]  # positions between which the polynomials hold
    # Found along the way, None where a steady crawl does not show them or an axis gave them.
    viscous: float | None
    mass: float | None
    held_out: dict[int, Floats]  # RMS error of the force for each degree tried, by direction
    pieces: Pieces  # the averaged data
    units: tuple[str, str]
    _fits: dict[int, tuple[Floats, Floats, int]]

    @property
    def coulomb(self) -> CoulombMap:
        """The levels without their uncertainty."""
        return CoulombMap(self.plus, self.minus)

    def standard_error(self, x: ArrayLike, direction: int) -> Floats:
        """Standard error of the level at positions x in direction +1 or -1, shape (n,)."""
        coefficients, covariance, _ = self._fits[direction]
        basis = legendre.legvander(inner(x, self.travel), coefficients.size - 1)
        return np.sqrt(np.einsum("ij,jk,ik->i", basis, covariance, basis))

    def band(self, x: ArrayLike, direction: int, level: float = 0.9) -> tuple[Floats, Floats]:
        """Lower and upper end of the level at x; `level`: probability of the truth at one place."""
        coefficients, _, groups = self._fits[direction]
        reach = half_width(level, groups - coefficients.size) * self.standard_error(x, direction)
        middle = self(x, direction)
        return middle - reach, middle + reach

    def apply(self, axis: FrictionAxis) -> FrictionAxis:
        """Axis with these levels over this travel."""
        return axis.replace(coulomb=self.coulomb, travel=self.travel)

    def _shown(self) -> Iterator[str | list[tuple[str, ...]]]:
        length, force = self.units
        rows: list[tuple[str, ...]] = [("direction", "degree", "level", "std. error")]
        places = np.linspace(*self.travel, 101)
        for s, name, degree in ((1, "+", self.degrees[0]), (-1, "-", self.degrees[1])):
            level = self(places, s)
            error = float(np.mean(self.standard_error(places, s)))
            ends = f"{level.min():.4g} to {level.max():.4g} {force}"
            rows.append((name, str(degree), ends, f"{error:.2g}"))
        yield rows
        if self.viscous is not None:
            yield (
                f"also found: viscous {self.viscous:.4g} {force} s/{length}, mass {self.mass:.4g}"
            )

    def to_dict(self) -> dict[str, Any]:
        """Numbers of the result, ready for JSON."""
        places = np.linspace(*self.travel, 21)
        return {
            **{
                name: plain_data(getattr(self, name))
                for name in ("plus", "minus", "degrees", "travel", "viscous", "mass")
            },
            "positions": places.tolist(),
            "standard_error_plus": self.standard_error(places, 1).tolist(),
            "standard_error_minus": self.standard_error(places, -1).tolist(),
        }

    @panels(1, figsize=(7.0, 4.2))
    def plot(self, axes: Any) -> str:
        """Draw the measured forces and the levels (paper, Fig. 5)."""
        length, force = self.units
        pieces = self.pieces
        axes[0].plot(
            pieces.x, pieces.u, ".", color=MEASURED, ms=4, label="measured, per piece of motion"
        )
        places = np.linspace(*self.travel, 300)
        for s in (1, -1):
            low, high = self.band(places, s)
            axes[0].fill_between(
                places, s * low, s * high, color="C0", alpha=0.25, lw=0,
                label="90 % band" if s == 1 else None,
            )  # fmt: skip
            axes[0].plot(
                places, s * self(places, s), "-", color="C0", lw=1.5,
                label="Coulomb level" if s == 1 else None,
            )  # fmt: skip
        axes[0].set_xlabel(f"position [{length}]")
        axes[0].set_ylabel(f"drive force [{force}]")
        legend_above(axes[0])
        return "Coulomb level over the travel"


def identify_coulomb(
    record: Record, degree: int | None = None, axis: FrictionAxis | None = None
) -> CoulombIdentification:
    """Coulomb level over position, per direction, from a crawl.

    Parameters
    ----------
    record : Record
        A slow ramp over the travel and back, see `slow_ramp_experiment`.
    degree : int, optional
        Degree of the polynomials.  Default: per direction the smallest whose
        error on held-out stretches is within one standard error of the least,
        and at most one coefficient for three independent stretches.
    axis : FrictionAxis, optional
        Axis whose mass, viscous coefficient, Stribeck peak and force effects are
        subtracted from the drive force.  Default: mass and viscous coefficient are estimated as
        well where the velocity varies enough to show them, otherwise neglected.

    Returns
    -------
    CoulombIdentification

    Raises
    ------
    ValueError
        If the record does not move in both directions, or the degree is out
        of its range or too high for the number of slips.

    Warns
    -----
    FitWarning
        When a level rests on a few slips only, or on nearly one velocity, slower motion left
        out, or on velocities that may lie within a Stribeck peak.

    Notes
    -----
    The drive force is averaged over pieces of motion, weighted by the way
    travelled: the work of friction.  Whatever inertia does, its work over a
    slip from rest to rest is zero, so stick-slip ripple does not bias the
    level; what is left at the ends of a piece is the rise of v^2/2.  Motion
    slower than 0.6 of the typical velocity is left out: there the level may be
    that of the Stribeck peak.

    A crawl in which every velocity lies within the peak measures the raised
    level.  Where it does not stick and slip, nothing in the record shows the
    difference, except that friction may fall with velocity.  A warning says so unless the axis
    has a peak, and standard errors are then those of friction at the velocity of the crawl.

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> from dryfric_control.identification import slow_ramp_experiment
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, travel=(0.0, 0.3),
    ...                         coulomb=dfc.CoulombMap([8.0, 10.0], 7.0))
    >>> ramp = slow_ramp_experiment(axis, quantum=1e-6)
    >>> found = dfc.identify_coulomb(ramp.record, axis=axis)
    >>> found.degrees
    (1, 0)
    """
    if degree is not None and degree not in range(HIGHEST + 1):
        raise ValueError(
            f"degree must be a whole number from 0 to {HIGHEST}, or None, got {degree!r}"
        )
    instance("record", record, Record)
    if axis is not None:
        instance("axis", axis, FrictionAxis)
        check_units(axis, record)
    pieces = average(record)
    for s, name in ((1, "positive"), (-1, "negative")):
        count = int(np.sum(pieces.direction == s))
        if count < 10:
            raise ValueError(
                f"record slides in {name} direction over {count} pieces of motion only, 10 are "
                "needed: it must cross the travel both ways"
            )
    travel = (float(record.x.min()), float(record.x.max()))
    viscous = mass = None
    fine = average(record, _FINE)
    if axis is not None:
        pieces = _levelled(axis, pieces)
        if axis.effective().stribeck is None:
            _tell_of_a_peak(_levelled(axis, fine), record, travel)
    elif (varies := _variation(fine)) > _VARIES:
        viscous, mass = _along_the_way(fine, travel)
        if viscous < 0.0:
            _tell(fine, record, "friction falls with velocity, as within a Stribeck peak")
        viscous, mass = max(viscous, 0.0), max(mass, 0.0)
    else:
        _tell(
            fine,
            record,
            f"the velocity varies by {percent(varies)} only (motion slower than {SLOW:g} of the "
            "typical velocity is left out)",
        )
    force = pieces.u
    if viscous is not None and mass is not None:
        force = force - viscous * pieces.v - mass * pieces.rise
    held_out: dict[int, Floats] = {}
    fits: dict[int, tuple[Floats, Floats, int]] = {}
    for s, name in ((1, "positive"), (-1, "negative")):
        own = pieces.only(pieces.direction == s)
        friction = s * force[pieces.direction == s]
        blocks = blocks_of(own)
        count = int(blocks.max()) + 1
        if degree is None:
            held_out[s], chosen = choose_degree(own, friction, travel, blocks)
        elif degree > count - 3:
            raise ValueError(
                f"degree = {degree} needs at least {degree + 3} slips in {name} direction, record "
                f"has {count}: lower it, or crawl with a stiffer loop"
            )
        else:
            chosen = int(degree)
        if count < _ENOUGH:
            warn(
                f"the level in {name} direction rests on {count} slips: a stiffer or faster loop "
                "makes more and smaller ones",
                FitWarning,
            )
        fits[s] = _with_covariance(level_of(own, friction, travel, chosen), blocks)
    powers = [
        tuple(Legendre(fits[s][0], domain=travel).convert(kind=Polynomial).coef.tolist())
        for s in (1, -1)
    ]
    units = (
        axis.units if axis is not None else (record.units.get("x", "m"), record.units.get("u", "N"))
    )
    return CoulombIdentification(
        *powers,
        degrees=(fits[1][0].size - 1, fits[-1][0].size - 1),
        travel=travel,
        viscous=viscous,
        mass=mass,
        held_out=held_out,
        pieces=pieces,
        units=units,
        _fits=fits,
    )


def _tell(pieces: Pieces, record: Record, what: str) -> None:
    """Warn that levels are friction at the velocity of the crawl."""
    speed = float(np.average(np.abs(pieces.v), weights=pieces.way))
    warn(
        f"{what}: the levels are friction at {speed:.3g} {record.units.get('x', 'm')}/s, with "
        "viscous friction and whatever a Stribeck peak adds there in them. Give axis= to take "
        "both off, or let the axis stick and slip (a softer loop) or move faster",
        FitWarning,
    )


def _tell_of_a_peak(pieces: Pieces, record: Record, travel: tuple[float, float]) -> None:
    """Warn where levels may be raised by a Stribeck peak that the axis does not have."""
    speed = np.abs(pieces.v)
    order = np.argsort(speed)
    passed = (np.cumsum(pieces.way[order]) - 0.5 * pieces.way[order]) / pieces.way.sum()
    low, usual, high = np.interp((0.1, 0.5, 0.9), passed, speed[order])
    level = np.average(np.abs(pieces.u), weights=pieces.way)
    spread = _variation(pieces) * np.average(speed, weights=pieces.way)
    fall = -_along_the_way(pieces, travel)[0] * spread / level
    if high - low < _VARIES * usual:
        what = f"four fifths of the way are travelled at {usual:.3g}"
    elif fall > _FALLS:
        what = f"friction falls with velocity, by {percent(fall)} of the level around {usual:.3g}"
    else:
        return
    warn(
        f"{what} {record.units.get('x', 'm')}/s: the levels hold there, and contain whatever a "
        "Stribeck peak adds, which is not in their standard errors. Give the axis its peak, "
        "axis.replace(stribeck=dfc.Stribeck(...)), with an excess of 0 where there is none, or "
        "let it stick and slip (a softer loop), or move faster",
        FitWarning,
    )


def _levelled(axis: FrictionAxis, pieces: Pieces) -> Pieces:
    """Pieces with the Coulomb level in place of the drive: what else the axis has is taken off."""
    from dryfric_control.estimation.force_residual import forces

    axis = axis.effective()
    bare = axis.replace(coulomb=0.0, viscous=0.0, stribeck=None)
    added = forces(bare, pieces.x, pieces.v, pieces.u, pieces.direction)
    level = pieces.u - axis.viscous * pieces.v - axis.mass * pieces.rise + added
    if axis.stribeck is not None:
        level = level / axis.stribeck.factor(np.abs(pieces.v), axis.stick_speed)
    return pieces._replace(u=level)


def _variation(pieces: Pieces) -> float:
    """Standard deviation of the speed along the way, relative to its mean."""
    speed = np.abs(pieces.v)
    mean = np.average(speed, weights=pieces.way)
    spread = np.sqrt(np.average((speed - mean) ** 2, weights=pieces.way))
    return float(spread / mean)


def _along_the_way(pieces: Pieces, travel: tuple[float, float]) -> tuple[float, float]:
    """Viscous coefficient and mass by regression, levels of degree 3 aside."""
    basis = legendre.legvander(inner(pieces.x, travel), 3)
    columns = [basis * (pieces.direction == s)[:, None] for s in (1, -1)]
    table = np.column_stack([*columns, pieces.v, pieces.rise])
    root = np.sqrt(pieces.way)
    found = np.linalg.lstsq(table * root[:, None], pieces.u * root, rcond=None)[0]
    return float(found[-2]), float(found[-1])


def _with_covariance(level: Level, blocks: Ints) -> tuple[Floats, Floats, int]:
    """Legendre coefficients, covariance from leaving out one block at a time, and their number."""
    count = int(blocks.max()) + 1
    left = [blocks != g for g in range(count)]
    moved = np.array([np.linalg.lstsq(level.rows[k], level.values[k], rcond=None)[0] for k in left])
    moved -= moved.mean(axis=0)
    return level.coefficients, (count - 1) / count * moved.T @ moved, count
