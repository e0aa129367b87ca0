"""Uncertainty of a fit: block jackknife, block bootstrap, undetermined directions."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike
from scipy import stats

from dryfric_control.arrays import Floats

# Eigenvalue over the largest one below which a direction may be undetermined.
_WEAK_EIGENVALUE = 1e-2
# The same below which it is undetermined, as in no record of a determined one.
_ZERO_EIGENVALUE = 1e-6
# A block is left out almost entirely: it may be the only one that determines a direction.
_LEFT_OUT = 1.0 - 1e-6


def null_directions(normal: Floats, again: Callable[[Floats], Floats]) -> Floats:
    """Directions in which the cost does not change, unit vectors as rows; none if all are known.

    `normal`: normal matrix in search coordinates; `again`: that of some steps, one a row, from
    differences along these: those of the coordinates do not cancel to the last digits.
    """
    size = np.sqrt(np.diag(normal))
    largest = size.max() if size.max() > 0.0 else 1.0
    size = np.where(size > 1e-9 * largest, size, 0.0)
    rows = list(np.eye(size.size)[size == 0.0])
    seen = np.flatnonzero(size)
    if seen.size:
        steps = np.eye(size.size)[seen] / size[seen, None]
        values, vectors = np.linalg.eigh(steps @ normal @ steps.T)
        if values[0] < _WEAK_EIGENVALUE * values[-1]:
            steps = vectors.T @ steps
            values, vectors = np.linalg.eigh(again(steps))
        for row in (vectors.T @ steps)[values < _ZERO_EIGENVALUE * values[-1]]:
            rows.append(row / np.linalg.norm(row))
    return np.asarray(rows, dtype=np.float64).reshape(-1, size.size)


def _inverse(normal: Floats, away: Floats) -> Floats:
    """Inverse of normal matrices, without the directions in `away`."""
    if away.size == 0:
        return np.asarray(np.linalg.inv(normal), dtype=np.float64)
    basis = np.linalg.svd(away)[2][away.shape[0] :].T
    inner = np.linalg.inv(basis.T @ normal @ basis)
    return np.asarray(basis @ inner @ basis.T)


def newton_step(g: Floats, h: Floats, prior: Floats, away: Floats) -> Floats:
    """Step of the parameters against which blocks with gradients g and normal matrices h push."""
    total = h.sum(axis=0)
    if away.shape[0] == total.shape[0]:
        return np.zeros(total.shape[0])
    return np.asarray(_inverse(total + np.diag(prior), away) @ g.sum(axis=0))


def jackknife(g: Floats, h: Floats, prior: Floats, away: Floats) -> Floats:
    """Covariance from leaving out one block at a time, linearised.

    Of blocks with gradients g and normal matrices h, a prior with this precision of each
    parameter, and without the directions `away`, which the record does not determine.
    """
    total = h.sum(axis=0)
    count = g.shape[0]
    if away.shape[0] == total.shape[0] or count < 2:
        return np.full(total.shape, np.inf)
    left = total - h * _LEFT_OUT + np.diag(prior)
    moved = np.einsum("bij,bj->bi", _inverse(left, away), g)
    moved -= moved.mean(axis=0)
    return np.asarray((count - 1) / count * moved.T @ moved)


def bootstrap(g: Floats, h: Floats, prior: Floats, away: Floats, repeats: int, seed: int) -> Floats:
    """Gauss-Newton steps of the parameters when blocks are drawn with replacement, one a row."""
    rng = np.random.default_rng(seed)
    blocks = g.shape[0]
    counts = rng.multinomial(blocks, np.full(blocks, 1.0 / blocks), size=repeats)
    # A resampling may miss the only block that determines a direction.
    weights = counts + 1e-6
    inverse = _inverse(np.einsum("rb,bij->rij", weights, h) + np.diag(prior), away)
    return np.asarray(-np.einsum("rij,rj->ri", inverse, weights @ g))


def degrees_of_freedom(h: Floats, prior: Floats, away: Floats) -> Floats:
    """Degrees of freedom, at least 1, of the variances found by `jackknife`.

    If only a few blocks determine a parameter, its variance is as uncertain as one estimated from
    that many samples.  If the gradients of the blocks have their normal matrices H_b as
    covariances, leaving out block b changes a parameter by d_b with covariance

        W_bc = r_b (H_b delta_bc - H_b inv(H) H_c) r_c',  r_b = row of inv(H - H_b),

    and Satterthwaite's formula gives tr(W)^2/tr(W^2) for the sum of d_b^2: a block that
    determines a parameter nearly alone is fitted closely, so that its residual says
    little about the error (R. Bell, D. McCaffrey, Survey Methodology 28, 2002).
    """
    total = h.sum(axis=0)
    inverse = _inverse(total + np.diag(prior), away)
    without = _inverse(total - h * _LEFT_OUT + np.diag(prior), away)
    moves = without @ h
    own = np.einsum("bij,bji->bi", moves, without)
    found = np.ones(total.shape[0])
    for i in range(found.size):
        spread = np.diag(own[:, i]) - moves[:, i] @ inverse @ moves[:, i].T
        squares = float(np.sum(spread**2))
        if squares > 0.0:
            found[i] = np.trace(spread) ** 2 / squares
    return np.maximum(found, 1.0)


def ratio_interval(before: Floats, after: Floats) -> tuple[float, float]:
    """90 % interval of the ratio of RMS errors, from blocks of squares drawn with replacement."""
    blocks = np.column_stack([before, after])
    picks = np.random.default_rng(0).integers(0, len(blocks), size=(2000, len(blocks)))
    sums = blocks[picks].sum(axis=1)
    ratios = np.sqrt(sums[:, 0] / sums[:, 1])
    low, high = np.quantile(ratios, [0.05, 0.95])
    return float(low), float(high)


def half_width(level: float, freedom: ArrayLike) -> Floats:
    """Half-width of a confidence interval in standard errors (Student's t)."""
    return np.asarray(stats.t.ppf(0.5 + 0.5 * level, freedom), dtype=np.float64)


def bootstrap_bounds(steps: Floats, level: float, freedom: Floats) -> tuple[Floats, Floats]:
    """Bounds of bootstrap intervals of steps, one a row, expanded for few blocks.

    A plain percentile interval corresponds to normal quantiles; the expanded one
    corresponds to Student's t (T. Hesterberg, The American Statistician 69, 2015).
    """
    tail = stats.norm.cdf(-half_width(level, freedom))
    columns = list(zip(steps.T, tail, strict=True))
    low = np.array([np.quantile(column, p) for column, p in columns])
    high = np.array([np.quantile(column, 1.0 - p) for column, p in columns])
    return low, high
