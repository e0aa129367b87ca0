"""Pieces of motion, averaged over the way travelled."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_coeffs, savgol_filter

from dryfric_control.estimation.motion import directions
from dryfric_control.records.record import Record
from dryfric_control.ties import NEAR, above, samples

FloatArray = NDArray[np.float64]

# Longest piece of motion that is averaged, as a part of the travel.
_PIECE = 1.0 / 80.0
# Part of the typical speed to which the speed is to be known.
_KNOWN = 0.02
# Slower than this part of the typical speed, friction may be off its Coulomb level.
_SLOW = 0.6


class Pieces(NamedTuple):
    """Averages over pieces of motion, weighted by the way travelled.

    Attributes
    ----------
    way : ndarray, shape (n,)
        Way travelled in the piece, positive.
    x, u, v : ndarray, shape (n,)
        Means over the way of position, drive force and speed.
    rise : ndarray, shape (n,)
        Rise of v^2/2 over the piece, per way: what inertia multiplies.
    direction : ndarray of int, shape (n,)
    slide : ndarray of int, shape (n,)
        Number of the slide, from rest to rest, that the piece is part of.
    begin, end : ndarray, shape (n,)
        Speed at the ends of the piece.
    t : ndarray, shape (n,)
        Time at its beginning [s].
    """

    way: FloatArray
    x: FloatArray
    u: FloatArray
    v: FloatArray
    rise: FloatArray
    direction: NDArray[np.int64]
    slide: NDArray[np.int64]
    begin: FloatArray
    end: FloatArray
    t: FloatArray

    def only(self, keep: NDArray[np.bool_]) -> Pieces:
        """The pieces marked in `keep`."""
        return Pieces(*(column[keep] for column in self))  # type: ignore[arg-type]


def average(record: Record, piece: float = _PIECE) -> Pieces:
    """Pieces of motion of a record, averaged over the way.

    Parameters
    ----------
    record : Record
    piece : float, optional
        Longest piece, as a part of the range of positions.

    Returns
    -------
    Pieces
    """
    moving = directions(record).astype(int)
    x, v, noise = _smoothed(record, moving)
    # Not the raw readings: their noise is in the drive force too, through the
    # loop, and would do work.
    step = 0.5 * (v[1:] + v[:-1]) * record.dt
    # An interval counts if it slides at both ends, the same way.
    s = np.where(moving[1:] == moving[:-1], moving[1:], 0)
    middle = 0.5 * (v[1:] + v[:-1])
    way = np.abs(np.where(s != 0, step, 0.0))
    if way.sum() == 0.0:
        none = np.empty(0)
        whole = np.empty(0, np.int64)
        return Pieces(none, none, none, none, none, whole, whole, none, none, none)
    typical = np.sum(way * np.abs(middle)) / way.sum()
    s = np.where(s * middle > _SLOW * typical, s, 0)
    longest = piece * record.range
    starts = np.flatnonzero((s != 0) & (np.diff(s, prepend=0) != 0))
    rows = []
    for number, a in enumerate(starts):
        rest = np.flatnonzero(s[a:] != s[a])
        b = a + int(rest[0]) if rest.size else s.size
        total = s[a] * (record.x[b] - record.x[a])
        parts = max(1, samples(total, longest))
        marks = record.x[a] + s[a] * total * np.arange(1, parts) / parts
        inner = a + np.searchsorted(s[a] * record.x[a:b], s[a] * marks - NEAR * record.range)
        for c, d in zip([a, *inner], [*inner, b], strict=True):
            travelled = s[a] * (record.x[d] - record.x[c])
            least = max(10.0 * (record.quantum or 0.0), 10.0 * record.noise)
            if d > c and above(travelled, least, NEAR * record.range):
                w = step[c:d] / step[c:d].sum()
                rows.append(
                    (
                        travelled,
                        w @ (0.5 * (x[c:d] + x[c + 1 : d + 1])),
                        w @ record.u[c:d],
                        # The weights hold the same noise: its square is no speed.
                        w @ middle[c:d] - noise**2 / (w @ middle[c:d]),
                        s[a] * 0.5 * (v[d] ** 2 - v[c] ** 2) / travelled,
                        s[a],
                        number,
                        v[c],
                        v[d],
                        record.t[c],
                    )
                )
    way, place, force, speed, rise, direction, slide, begin, end, t = np.reshape(
        np.array(rows), (-1, 10)
    ).T
    return Pieces(
        way,
        place,
        force,
        speed,
        rise,
        direction.astype(np.int64),
        slide.astype(np.int64),
        begin,
        end,
        t,
    )


def _smoothed(record: Record, moving: NDArray[np.int64]) -> tuple[FloatArray, FloatArray, float]:
    """Position and speed, smoothed to know the speed to 2 %, and its noise.

    Noise of the speed enters the work squared, and through the loop it is in
    the drive force: at 5 % it would bias a smooth crawl by more than its error.
    """
    apart = max(1, len(record) // 2000)
    moves = np.sort(np.abs(np.diff(record.x[::apart])))
    # Half of the way is travelled faster than this.
    half = int(np.searchsorted(np.cumsum(moves), 0.5 * moves.sum()))
    typical = max(float(moves[min(half, moves.size - 1)]), 1e-300) / (apart * record.dt)
    for size in (5, 7, 9, 11, 15, 21, 31, 41, 61, 81, 101):
        spread = record.noise * float(np.linalg.norm(savgol_coeffs(size, 3, 1, record.dt)))
        if spread < _KNOWN * typical or size + 2 > len(record) // 5:
            break
    return (
        savgol_filter(record.x, size, 3, 0, record.dt),
        savgol_filter(record.x, size, 3, 1, record.dt),
        spread,
    )
