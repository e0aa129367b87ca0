"""Coulomb levels over position from a crawl, with their uncertainty."""

from __future__ import annotations

import html
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.polynomial import Legendre, Polynomial, legendre
from numpy.typing import ArrayLike, NDArray

from dryfric_control.axis import FrictionAxis
from dryfric_control.friction import CoulombMap
from dryfric_control.identification.pieces import Pieces, average
from dryfric_control.identification.uncertainty import half_width
from dryfric_control.records import Record

if TYPE_CHECKING:
    import control as ct

FloatArray = NDArray[np.float64]

_HIGHEST = 8  # degree; polynomials beyond do not behave between the data
# The same where speed must not be averaged away.
_FINE = 1.0 / 160.0
# Speed that varies more than this (relative) tells viscous friction and inertia.
_VARIES = 0.1
_GROUPS = 20


@dataclass(frozen=True, eq=False)
class CoulombIdentification:
    """Coulomb levels found in a record, with confidence bands.

    Made by `identify_coulomb`.

    Attributes
    ----------
    coulomb : CoulombMap
        Polynomial of each direction, in position.
    degrees : tuple of int
        Degree for motion in positive and in negative direction.
    travel : tuple of float
        Positions between which the polynomials hold.
    viscous, mass : float or None
        Viscous coefficient and mass found along the way, None where a steady
        crawl does not show them or an axis gave them.
    held_out : dict of int to ndarray, shape (ndegrees,)
        Held-out RMS error of the force for each degree tried, by direction.
    pieces : Pieces
        The averaged data.
    units : tuple of str
    """

    coulomb: CoulombMap
    degrees: tuple[int, int]
    travel: tuple[float, float]
    viscous: float | None
    mass: float | None
    held_out: dict[int, FloatArray]
    pieces: Pieces
    units: tuple[str, str]
    _fits: dict[int, tuple[FloatArray, FloatArray, int]]

    def __call__(self, x: ArrayLike, direction: int) -> FloatArray:
        """Level at positions, see `CoulombMap`."""
        return self.coulomb(x, direction)

    def standard_error(self, x: ArrayLike, direction: int) -> FloatArray:
        """Standard error of the level.

        Parameters
        ----------
        x : array_like, shape (n,)
            Positions.
        direction : int
            +1 or -1.

        Returns
        -------
        ndarray, shape (n,)
        """
        coefficients, covariance, _ = self._fits[direction]
        basis = legendre.legvander(_inner(x, self.travel), coefficients.size - 1)
        return np.sqrt(np.einsum("ij,jk,ik->i", basis, covariance, basis))

    def band(
        self, x: ArrayLike, direction: int, level: float = 0.9
    ) -> tuple[FloatArray, FloatArray]:
        """Confidence band of the level.

        Parameters
        ----------
        x : array_like, shape (n,)
            Positions.
        direction : int
            +1 or -1.
        level : float, optional
            Probability with which the band covers the truth at one place.

        Returns
        -------
        low, high : ndarray, shape (n,)
        """
        coefficients, _, groups = self._fits[direction]
        reach = half_width(level, groups, coefficients.size) * self.standard_error(x, direction)
        middle = self.coulomb(x, direction)
        return middle - reach, middle + reach

    def apply(self, axis: FrictionAxis) -> FrictionAxis:
        """Axis with these levels over this travel.

        Parameters
        ----------
        axis : FrictionAxis
            The axis.

        Returns
        -------
        FrictionAxis
        """
        return axis.replace(coulomb=self.coulomb, travel=self.travel)

    def _rows(self) -> list[tuple[str, str, str, str]]:
        rows = []
        places = np.linspace(*self.travel, 101)
        for i, (s, name) in enumerate(((1, "+"), (-1, "-"))):
            level = self.coulomb(places, s)
            error = self.standard_error(places, s)
            rows.append(
                (
                    name,
                    str(self.degrees[i]),
                    f"{level.min():.4g} to {level.max():.4g} {self.units[1]}",
                    f"{float(np.mean(error)):.2g}",
                )
            )
        return rows

    def summary(self) -> str:
        """Table of the levels."""
        rows = [("direction", "degree", "level", "std. error"), *self._rows()]
        widths = [max(len(r[i]) for r in rows) for i in range(4)]
        lines = [
            "  ".join(c.ljust(w) for c, w in zip(r, widths, strict=True)).rstrip() for r in rows
        ]
        if self.viscous is not None:
            lines.append(
                f"found along the way: viscous {self.viscous:.4g} {self.units[1]} "
                f"s/{self.units[0]}, mass {self.mass:.4g}"
            )
        return "\n".join(lines)

    def __repr__(self) -> str:
        return self.summary()

    def _repr_html_(self) -> str:
        head = "".join(f"<th>{h}</th>" for h in ("direction", "degree", "level", "std. error"))
        body = "".join(
            "<tr>" + "".join(f"<td>{html.escape(c)}</td>" for c in row) + "</tr>"
            for row in self._rows()
        )
        return f"<table><tr>{head}</tr>{body}</table>"

    def to_dict(self) -> dict[str, Any]:
        """Numbers of the result, ready for JSON.

        Returns
        -------
        dict
        """
        places = np.linspace(*self.travel, 21)
        return {
            "plus": list(self.coulomb.plus),
            "minus": list(self.coulomb.minus),
            "degrees": list(self.degrees),
            "travel": list(self.travel),
            "viscous": self.viscous,
            "mass": self.mass,
            "positions": places.tolist(),
            "standard_error_plus": self.standard_error(places, 1).tolist(),
            "standard_error_minus": self.standard_error(places, -1).tolist(),
        }

    def plot(self, ax: Any = None) -> ct.ControlPlot:
        """Draw the measured forces and the levels (paper, Fig. 5).

        Parameters
        ----------
        ax : Axes, optional
            Where to draw; a new figure when left out.

        Returns
        -------
        control.ControlPlot
        """
        from dryfric_control.identification.figures import plot_coulomb

        return plot_coulomb(self, ax)


def identify_coulomb(
    record: Record, degree: int | None = None, axis: FrictionAxis | None = None
) -> CoulombIdentification:
    """Coulomb level over position, per direction, from a crawl.

    Parameters
    ----------
    record : Record
        A slow ramp over the travel and back, see `slow_ramp_experiment`.
    degree : int, optional
        Degree of the polynomials.  Default: per direction the smallest that
        predicts held-out stretches as well as any.
    axis : FrictionAxis, optional
        Axis whose mass, viscous coefficient and force effects are taken off the
        drive force.  Default: mass and viscous coefficient are found along
        the way where the speed varies enough to show them, else neglected.

    Returns
    -------
    CoulombIdentification

    Raises
    ------
    ValueError
        If the record does not move in both directions, or the degree is out
        of its range.

    Notes
    -----
    The drive force is averaged over pieces of motion, weighted by the way
    travelled: the work of friction.  Whatever inertia does, its work over a
    slip from rest to rest is zero, so stick-slip ripple does not bias the
    level; what is left at the ends of a piece is the rise of v^2/2.  Motion
    slower than 0.4 of the typical speed is left out: there the level may be
    that of the Stribeck peak.

    A crawl in which every speed lies within the peak measures the raised
    level: nothing in the record tells the difference.

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> from dryfric_control.identification import slow_ramp_experiment
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, travel=(0.0, 0.3),
    ...                         coulomb=dfc.CoulombMap([8.0, 10.0], 7.0))
    >>> ramp = slow_ramp_experiment(axis, quantum=1e-6)
    >>> found = identify_coulomb(ramp.record, axis=axis)
    >>> found.degrees
    (1, 0)
    """
    if degree is not None and degree not in range(_HIGHEST + 1):
        raise ValueError(
            f"degree must be a whole number from 0 to {_HIGHEST}, or None, got {degree!r}"
        )
    if not isinstance(record, Record):
        raise ValueError(f"record must be a Record, got {type(record).__name__}")
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
    known = axis is not None
    if axis is not None:
        taken = axis.viscous * pieces.v + axis.mass * pieces.rise + _effects(axis, pieces)
        pieces = pieces._replace(u=pieces.u - taken)
    elif _varies(fine):
        viscous, mass = _along_the_way(fine, travel)
    else:
        known = True  # as far as it matters
    groups = _time_groups(pieces)
    held_out: dict[int, FloatArray] = {}
    degrees: dict[int, int] = {}
    force = pieces.u
    if viscous is not None and mass is not None:
        force = force - viscous * pieces.v - mass * pieces.rise
    for s in (1, -1):
        own = pieces.direction == s
        if degree is not None:
            degrees[s] = int(degree)
        else:
            held_out[s], degrees[s] = _choose(
                _inner(pieces.x[own], travel), s * force[own], pieces.way[own], groups[own]
            )
    full = _levels(pieces, None if known else fine, travel, degrees)
    fine_groups = _time_groups(fine)
    left = [
        _levels(
            _taken(pieces, groups != g),
            None if known else _taken(fine, fine_groups != g),
            travel,
            degrees,
        )
        for g in range(_GROUPS)
    ]
    fits = {}
    for s in (1, -1):
        moved = np.array([one[s] for one in left])
        moved -= moved.mean(axis=0)
        fits[s] = (full[s], (_GROUPS - 1) / _GROUPS * moved.T @ moved, _GROUPS)
    powers = [
        tuple(Legendre(fits[s][0], domain=travel).convert(kind=Polynomial).coef.tolist())
        for s in (1, -1)
    ]
    units = (
        axis.units if axis is not None else (record.units.get("x", "m"), record.units.get("u", "N"))
    )
    return CoulombIdentification(
        CoulombMap(*powers),
        (degrees[1], degrees[-1]),
        travel,
        viscous,
        mass,
        held_out,
        pieces,
        units,
        fits,
    )


def _inner(x: ArrayLike, travel: tuple[float, float]) -> FloatArray:
    """Positions on [-1, 1], those outside held at the ends."""
    low, high = travel
    return np.clip((2.0 * np.asarray(x, dtype=float) - low - high) / (high - low), -1.0, 1.0)


def _effects(axis: FrictionAxis, pieces: Pieces) -> FloatArray:
    """Minus the force of the axis' effects at the pieces, friction aside."""
    from dryfric_control.identification.start import forces

    bare = axis.replace(coulomb=0.0, viscous=0.0, stribeck=None)
    return -forces(bare, pieces.x, pieces.v, pieces.u, pieces.direction)


def _varies(pieces: Pieces) -> bool:
    """Whether the speed varies enough to show viscous friction and inertia."""
    speed = np.abs(pieces.v)
    mean = np.average(speed, weights=pieces.way)
    spread = np.sqrt(np.average((speed - mean) ** 2, weights=pieces.way))
    return bool(spread > _VARIES * mean)


def _along_the_way(pieces: Pieces, travel: tuple[float, float]) -> tuple[float, float]:
    """Viscous coefficient and mass by regression, levels of degree 3 aside."""
    basis = legendre.legvander(_inner(pieces.x, travel), 3)
    columns = [basis * (pieces.direction == s)[:, None] for s in (1, -1)]
    table = np.column_stack([*columns, pieces.v, pieces.rise])
    root = np.sqrt(pieces.way)
    found = np.linalg.lstsq(table * root[:, None], pieces.u * root, rcond=None)[0]
    return max(float(found[-2]), 0.0), max(float(found[-1]), 0.0)


def _time_groups(pieces: Pieces) -> NDArray[np.int64]:
    """Groups that take turns, each of stretches that follow in time.

    Every direction is crossed by every group, so that leaving one out leaves
    no long gap in the travel.
    """
    done = np.cumsum(pieces.way) / pieces.way.sum()
    stretch = np.minimum((done * 2 * _GROUPS).astype(np.int64), 2 * _GROUPS - 1)
    return np.asarray(stretch % _GROUPS)


def _taken(pieces: Pieces, keep: NDArray[np.bool_]) -> Pieces:
    return Pieces(
        pieces.way[keep],
        pieces.x[keep],
        pieces.u[keep],
        pieces.v[keep],
        pieces.rise[keep],
        pieces.direction[keep],
    )


def _levels(
    pieces: Pieces, fine: Pieces | None, travel: tuple[float, float], degrees: dict[int, int]
) -> dict[int, FloatArray]:
    """Legendre coefficients of the level in each direction."""
    force = pieces.u
    if fine is not None:
        viscous, mass = _along_the_way(fine, travel)
        force = force - viscous * pieces.v - mass * pieces.rise
    found = {}
    for s in (1, -1):
        own = pieces.direction == s
        found[s] = _solve(
            _inner(pieces.x[own], travel), s * force[own], pieces.way[own], degrees[s]
        )
    return found


def _solve(z: FloatArray, y: FloatArray, w: FloatArray, degree: int) -> FloatArray:
    """Weighted polynomial fit with Huber's loss, Legendre coefficients."""
    basis = legendre.legvander(z, degree)
    weight = w.copy()
    coefficients: FloatArray = np.zeros(degree + 1)
    for _ in range(20):
        root = np.sqrt(weight)
        new = np.asarray(np.linalg.lstsq(basis * root[:, None], y * root, rcond=None)[0])
        done = np.max(np.abs(new - coefficients)) < 1e-10 * np.max(np.abs(new))
        coefficients = new.astype(np.float64)
        if done:
            break
        # Each piece's error scaled as its average over the way would have it.
        error = np.abs(y - basis @ coefficients) * np.sqrt(w / w.mean())
        scale = 1.4826 * float(np.median(error))
        limit = 1.5 * scale if scale > 0.0 else np.inf
        weight = w * np.minimum(1.0, limit / np.maximum(error, 1e-300))
    return np.asarray(coefficients)


def _choose(
    z: FloatArray, y: FloatArray, w: FloatArray, groups: NDArray[np.int64]
) -> tuple[FloatArray, int]:
    """Held-out error of each degree, and the smallest that is as good as any."""
    highest = min(_HIGHEST, z.size // 4)
    errors = np.zeros((highest + 1, groups.max() + 1))
    for d in range(highest + 1):
        for g in np.unique(groups):
            out = groups == g
            inside = (z >= z[~out].min()) & (z <= z[~out].max())
            out_inside = out & inside  # nothing predicts beyond the data
            if not out_inside.any():
                continue
            left = legendre.legval(z[out_inside], _solve(z[~out], y[~out], w[~out], d))
            errors[d, g] = np.sum(w[out_inside] * (y[out_inside] - left) ** 2)
    best = int(np.argmin(errors.sum(axis=1)))
    for d in range(best + 1):
        worse = errors[d] - errors[best]
        spread = np.sqrt(worse.size) * np.std(worse, ddof=1)
        if worse.sum() <= spread:
            break
    return np.sqrt(errors.sum(axis=1) / w.sum()), d
