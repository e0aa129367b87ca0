"""Coulomb levels over position from a crawl, with their uncertainty."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.polynomial import Legendre, Polynomial, legendre
from numpy.typing import ArrayLike

from dryfric_control.arrays import Floats
from dryfric_control.checks import instance, warn
from dryfric_control.drawing import MEASURED, label_axes, panels
from dryfric_control.estimation.uncertainty import half_width
from dryfric_control.identification import crawl
from dryfric_control.identification.fit import FitWarning
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.model.friction import CoulombMap
from dryfric_control.model.friction_curve import net_force
from dryfric_control.records.read import RecordLike, as_record
from dryfric_control.records.record import Record
from dryfric_control.text import Result, percent, plain_data
from dryfric_control.ties import NEAR
from dryfric_control.units import check_units

# Directions of motion in words.
_WAYS = {1: "positive", -1: "negative"}
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
    pieces: crawl.Pieces  # the averaged data
    units: tuple[str, str]
    _fits: dict[int, crawl.Level]

    @property
    def coulomb(self) -> CoulombMap:
        """The levels without their uncertainty."""
        return CoulombMap(self.plus, self.minus)

    def standard_error(self, x: ArrayLike, direction: int) -> Floats:
        """Standard error of the level at positions x in direction +1 or -1, shape (n,)."""
        fit = self._fits[direction]
        basis = legendre.legvander(crawl.inner(x, self.travel), fit.coefficients.size - 1)
        return np.sqrt(np.einsum("ij,jk,ik->i", basis, fit.covariance, basis))

    def band(self, x: ArrayLike, direction: int, level: float = 0.9) -> tuple[Floats, Floats]:
        """Lower and upper end of the level at x; `level`: probability of the truth at one place."""
        blocks, coefficients = self._fits[direction].without_each.shape
        reach = half_width(level, blocks - coefficients) * self.standard_error(x, direction)
        middle = self(x, direction)
        return middle - reach, middle + reach

    def apply(self, axis: FrictionAxis) -> FrictionAxis:
        """Axis with these levels over this travel."""
        return axis.replace(coulomb=self.coulomb, travel=self.travel)

    def _summary_parts(self) -> Iterator[str | list[tuple[str, ...]]]:
        length, force = self.units
        rows: list[tuple[str, ...]] = [("direction", "degree", "level", "std. error")]
        places = np.linspace(*self.travel, 101)
        for s, name, degree in zip((1, -1), "+-", self.degrees, strict=True):
            level = self(places, s)
            error = np.mean(self.standard_error(places, s))
            ends = f"{level.min():.4g} to {level.max():.4g} {force}"
            rows.append((name, str(degree), ends, f"{error:.2g}"))
        yield rows
        if self.viscous is not None:
            found = f"viscous {self.viscous:.4g} {force} s/{length}, mass {self.mass:.4g}"
            yield f"also found: {found}"
        if warning := self._negative_level():
            yield f"warning: {warning}"

    def _negative_level(self) -> str:
        """What a level below zero means; empty where there is none."""
        length, force = self.units
        places = np.linspace(*self.travel, 101)
        plus = self(places, 1)
        minus = self(places, -1)
        lower = np.minimum(plus, minus)
        at = int(np.argmin(lower))
        if lower[at] >= 0.0:
            return ""
        way = _WAYS[1 if plus[at] < minus[at] else -1]
        beside = 0.5 * (plus - minus)
        return (
            f"the level in {way} direction is {lower[at]:.3g} {force} at x = {places[at]:.3g} "
            f"{length}, and friction is never negative: a force acts beside it, such as a weight, "
            "a spring or a bias. Half of the difference of the directions, "
            f"{beside.min():.3g} to {beside.max():.3g} {force} over the travel, is that force if "
            "friction is the same both ways. Give axis= with it as an effect (dfc.effects.Gravity, "
            "Spring, BiasForce), or diagnose(axis, record)"
        )

    def to_dict(self) -> dict[str, Any]:
        """Numbers of the result, ready for JSON."""
        places = np.linspace(*self.travel, 21)
        names = ("plus", "minus", "degrees", "travel", "viscous", "mass")
        return {name: plain_data(getattr(self, name)) for name in names} | {
            "positions": places.tolist(),
            "standard_error_plus": self.standard_error(places, 1).tolist(),
            "standard_error_minus": self.standard_error(places, -1).tolist(),
        }

    @panels(1, figsize=(7.0, 4.2))
    def plot(self, axes: Any) -> str:
        """Draw the measured forces and the levels (paper, Fig. 5)."""
        (length, force), (ax,) = self.units, axes
        label = "measured, per piece of motion"
        ax.plot(self.pieces.x, self.pieces.u, ".", color=MEASURED, ms=4, label=label)
        places = np.linspace(*self.travel, 300)
        for s, band, level in ((1, "90 % band", "Coulomb level"), (-1, None, None)):
            low, high = (s * end for end in self.band(places, s))
            ax.fill_between(places, low, high, color="C0", alpha=0.25, lw=0, label=band)
            ax.plot(places, s * self(places, s), "-", color="C0", lw=1.5, label=level)
        label_axes(ax, f"position [{length}]", f"drive force [{force}]")
        return "Coulomb level over the travel"


def identify_coulomb(
    record: RecordLike, degree: int | None = None, axis: FrictionAxis | None = None
) -> CoulombIdentification:
    """Coulomb level over position, per direction, from a crawl.

    Parameters
    ----------
    record : Record or path-like
        A slow ramp over the travel and back, see `slow_ramp_experiment`.
    degree : int, optional
        Degree of the polynomials.  Default: per direction the smallest whose error on held-out
        stretches is within one standard error of the least, at most one coefficient for three.
    axis : FrictionAxis, optional
        Axis whose mass, viscous coefficient, Stribeck peak and force effects are subtracted from
        the drive force.  Default: mass and viscous coefficient are estimated as well where the
        velocity varies enough to show them, otherwise neglected.

    Raises
    ------
    ValueError
        If the record does not move both ways, or the degree is out of range or too high for it.

    Warns
    -----
    FitWarning
        When a level rests on a few slips only, on nearly one velocity (motion slower than 0.6 of
        the typical one is left out), or on velocities that may lie within a Stribeck peak; when one
        is negative somewhere, which shows a force beside friction, such as a weight.

    Notes
    -----
    The drive force is averaged over pieces of motion, weighted by the way travelled: the work of
    friction.  That of inertia is zero over a slip from rest to rest, so stick-slip ripple does not
    bias the level; what is left at the ends of a piece is the rise of v^2/2.

    Where mass and viscous coefficient are estimated as well, the standard errors contain theirs: an
    error of the viscous coefficient is one of the level in proportion to the velocity.

    A crawl with every velocity within a Stribeck peak measures the raised level.  Where it does
    not stick and slip, nothing in the record shows the difference, except that friction may fall
    with velocity.  A warning says so unless the axis has a peak; standard errors are then those
    of friction at the velocity of the crawl.

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, travel=(0.0, 0.3),
    ...                         coulomb=dfc.CoulombMap([8.0, 10.0], 7.0))
    >>> ramp = dfc.slow_ramp_experiment(axis, quantum=1e-6)
    >>> found = dfc.identify_coulomb(ramp.record, axis=axis)
    >>> found.degrees
    (1, 0)
    """
    _check_degree(degree)
    record = as_record(record)
    if axis is not None:
        instance("axis", axis, FrictionAxis)
        check_units(axis, record)
    pieces = crawl.average(record)
    _check_both_ways(pieces)
    travel = (float(record.x.min()), float(record.x.max()))
    viscous = mass = None
    covariance = np.zeros((2, 2))
    fine = crawl.average(record, _FINE)
    if axis is not None:
        pieces = _subtract_known_forces(axis, pieces)
        if axis.effective().stribeck is None:
            _tell_of_a_peak(_subtract_known_forces(axis, fine), record, travel)
    elif (varies := _variation(fine)) > _VARIES:
        viscous, mass = _along_the_way(fine, travel)
        if viscous < 0.0:
            _tell(fine, record, "friction falls with velocity, as within a Stribeck peak")
        viscous = max(viscous, 0.0)
        mass = max(mass, 0.0)
        covariance = _path_covariance(fine, travel)
    else:
        only = f"the velocity varies by {percent(varies)} only (motion slower than {crawl.SLOW:g}"
        _tell(fine, record, f"{only} of the typical velocity is left out)")
    force = pieces.u - (viscous or 0.0) * pieces.v - (mass or 0.0) * pieces.rise
    held_out: dict[int, Floats] = {}
    fits: dict[int, crawl.Level] = {}
    for s, name in _WAYS.items():
        there = pieces.direction == s
        own = pieces.select_pieces(there)
        level, errors = _fit_level(own, s * force[there], travel, degree, name)
        if errors is not None:
            held_out[s] = errors
        fits[s] = replace(level, shared=_shared_covariance(level, own, travel, covariance))
    found = [Legendre(fits[s].coefficients, travel).convert(kind=Polynomial) for s in _WAYS]
    plus, minus = (tuple(one.coef.tolist()) for one in found)
    units = record.units.get("x", "m"), record.units.get("u", "N")
    result = CoulombIdentification(
        plus,
        minus,
        degrees=(fits[1].coefficients.size - 1, fits[-1].coefficients.size - 1),
        travel=travel,
        viscous=viscous,
        mass=mass,
        held_out=held_out,
        pieces=pieces,
        units=units if axis is None else axis.units,
        _fits=fits,
    )
    if warning := result._negative_level():
        warn(warning, FitWarning)
    return result


def _check_degree(degree: int | None) -> None:
    """Refuse what is no degree of a polynomial that may be fitted."""
    if degree is not None and degree not in range(crawl.HIGHEST + 1):
        raise ValueError(
            f"degree must be a whole number from 0 to {crawl.HIGHEST}, or None, got {degree!r}"
        )


def _check_both_ways(pieces: crawl.Pieces) -> None:
    """Refuse a crawl that hardly slides in one direction."""
    for s, name in _WAYS.items():
        count = int(np.sum(pieces.direction == s))
        if count < 10:
            raise ValueError(
                f"record slides in {name} direction over {count} pieces of motion only, 10 are "
                "needed: it must cross the travel both ways"
            )


def _fit_level(
    own: crawl.Pieces, force: Floats, travel: tuple[float, float], degree: int | None, name: str
) -> tuple[crawl.Level, Floats | None]:
    """Level of one direction, and its held-out errors by degree where that is looked for."""
    blocks = crawl.blocks_of(own)
    count = int(blocks.max()) + 1
    errors = None
    if degree is None:
        errors, level = crawl.best_level(own, force, travel, blocks)
    elif degree > count - 3:
        raise ValueError(
            f"degree = {degree} needs at least {degree + 3} slips in {name} direction, record "
            f"has {count}: lower it, or crawl with a stiffer loop"
        )
    else:
        level = crawl.level_of(own, force, travel, blocks, int(degree))
    if count < _ENOUGH:
        warn(
            f"the level in {name} direction rests on {count} slips: a stiffer or faster loop "
            "makes more and smaller ones",
            FitWarning,
        )
    return level, errors


def _shared_covariance(
    level: crawl.Level, own: crawl.Pieces, travel: tuple[float, float], covariance: Floats
) -> Floats:
    """Covariance of a level from that of viscous coefficient and mass, which both ways share."""
    # An error of viscous coefficient or mass is one of the level wherever the axis moves.
    terms = np.column_stack([own.v, own.rise])
    place = crawl.inner(own.x, travel)
    degree = level.coefficients.size - 1
    shares = legendre.legfit(place, terms, degree, w=np.sqrt(own.way))
    return np.asarray(shares @ covariance @ shares.T)


def _tell(pieces: crawl.Pieces, record: Record, what: str) -> None:
    """Warn that levels are friction at the velocity of the crawl."""
    speed = float(np.average(np.abs(pieces.v), weights=pieces.way))
    warn(
        f"{what}: the levels are friction at {speed:.3g} {record.units.get('x', 'm')}/s, with "
        "viscous friction and whatever a Stribeck peak adds there in them. Give axis= to take "
        "both off, or let the axis stick and slip (a softer loop) or move faster",
        FitWarning,
    )


def _tell_of_a_peak(pieces: crawl.Pieces, record: Record, travel: tuple[float, float]) -> None:
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


def _subtract_known_forces(axis: FrictionAxis, pieces: crawl.Pieces) -> crawl.Pieces:
    """Pieces with the Coulomb level in place of the drive: what else the axis has is taken off."""
    axis = axis.effective()
    bare = axis.replace(coulomb=0.0, stribeck=None)
    states = (pieces.x, pieces.v, pieces.u)
    level = net_force(bare, 0.0 * pieces.x, *states, pieces.direction) - axis.mass * pieces.rise
    if axis.stribeck is not None:
        level = level / axis.stribeck.factor(np.abs(pieces.v), axis.stick_speed)
    return pieces._replace(u=level)


def _variation(pieces: crawl.Pieces) -> float:
    """Standard deviation of the speed along the way, relative to its mean."""
    speed = np.abs(pieces.v)
    mean = np.average(speed, weights=pieces.way)
    spread = np.sqrt(np.average((speed - mean) ** 2, weights=pieces.way))
    return float(spread / mean)


def _along_the_way(pieces: crawl.Pieces, travel: tuple[float, float]) -> tuple[float, float]:
    """Viscous coefficient and mass by regression, levels of degree 3 aside."""
    basis = legendre.legvander(crawl.inner(pieces.x, travel), 3)
    columns = [basis * (pieces.direction == s)[:, None] for s in (1, -1)]
    others = np.column_stack([*columns, pieces.v])
    # Columns of size 1: least squares cuts what is small beside the largest, whatever its unit.
    size = np.maximum(np.max(np.abs(others), axis=0), 1e-300)
    root = np.sqrt(pieces.way / pieces.way.sum())
    others *= root[:, None] / size
    rise, force, unsure = (root * one for one in (pieces.rise, pieces.u, pieces.noise))
    apart = rise - others @ np.linalg.lstsq(others, rise, rcond=None)[0]
    # Noise of the velocity adds to the square of the rise, and would make the mass too small.
    noise = float(unsure @ unsure + NEAR**2 * rise @ rise)
    mass = float(apart @ force) / max(float(apart @ apart) - noise, noise, 1e-300)
    found = np.linalg.lstsq(others, force - mass * rise, rcond=None)[0] / size
    return float(found[-1]), mass


def _path_covariance(pieces: crawl.Pieces, travel: tuple[float, float]) -> Floats:
    """Covariance of `_along_the_way`, from leaving out one block at a time."""
    label = np.zeros(pieces.way.size, dtype=np.int64)
    for s in _WAYS:
        own = pieces.direction == s
        label[own] = s * (1 + crawl.blocks_of(pieces.select_pieces(own)))
    left = [_along_the_way(pieces.select_pieces(label != g), travel) for g in np.unique(label)]
    return crawl.spread_without(np.array(left))
