"""Standard errors and intervals against closed forms, refits and distributions."""

import numpy as np
import pytest
from scipy import stats

from dryfric_control.estimation import uncertainty
from dryfric_control.estimation.uncertainty import degrees_of_freedom, jackknife


def test_standard_error_of_a_mean():
    """That of n values is s / sqrt(n)."""
    y, none = np.random.default_rng(1).standard_normal(12), np.empty((0, 1))
    covariance = jackknife(-(y - y.mean())[:, None], np.ones((12, 1, 1)), np.zeros(1), none)
    # A block is left out but for 1e-6 of it.
    assert covariance[0, 0] == pytest.approx(np.var(y, ddof=1) / 12, rel=1e-5)


def test_jackknife_is_that_of_refits_without_one_block():
    rng = np.random.default_rng(2)
    columns, labels = rng.standard_normal((40, 2)), np.repeat(np.arange(8), 5)
    y = columns @ [1.0, -2.0] + rng.standard_normal(8)[labels] + 0.1 * rng.standard_normal(40)
    full = np.linalg.lstsq(columns, y, rcond=None)[0]
    gradients = (-columns * (y - columns @ full)[:, None]).reshape(8, 5, 2).sum(axis=1)
    normals = (columns[:, :, None] * columns[:, None, :]).reshape(8, 5, 2, 2).sum(axis=1)
    covariance = jackknife(gradients, normals, np.zeros(2), np.empty((0, 2)))
    others = [labels != b for b in range(8)]
    refits = np.array([np.linalg.lstsq(columns[o], y[o], rcond=None)[0] for o in others])
    np.testing.assert_allclose(covariance, 7.0 * np.cov(refits.T, ddof=0), rtol=1e-4)


def test_degrees_of_freedom_of_equal_blocks_and_of_one_that_rules():
    """Of n equal blocks n - 1 are left beside a mean; of one that determines it alone, one."""
    none, blocks = np.empty((0, 1)), np.ones((12, 1, 1))
    assert degrees_of_freedom(blocks, np.zeros(1), none) == pytest.approx(11.0, rel=1e-4)
    blocks[3] = 1e4
    assert degrees_of_freedom(blocks, np.zeros(1), none) == pytest.approx(1.0, abs=1e-2)


def test_intervals_of_few_blocks_are_those_of_student():
    """Of normal steps; a quantile of 100 000 at 2 % is known to 0.01."""
    steps = np.random.default_rng(4).standard_normal((100_000, 2))
    low, high = uncertainty.bootstrap_bounds(steps, 0.9, np.array([5.0, 1e9]))
    ends = stats.t.ppf(0.95, [5.0, 1e9])
    np.testing.assert_allclose([-low, high], [ends, ends], rtol=0, atol=0.04)


def test_interval_of_a_ratio_of_errors():
    """Of chi-square values, 400 a side: the ratio of their sums has an F distribution."""
    rows = np.random.default_rng(3).chisquare(1.0, (2, 400))
    low, high = uncertainty.ratio_interval(9.0 * rows[0], rows[1])
    ratio = 3.0 * np.sqrt(rows[0].sum() / rows[1].sum())
    expected = 0.5 * np.log(stats.f.ppf(0.95, 400, 400))
    # 400 values know their spread to some 10 %, 2000 draws a quantile to some 4 %.
    assert np.log([high / ratio, ratio / low]) == pytest.approx(expected, rel=0.2)
