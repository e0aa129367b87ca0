"""Bounds of the laws of effects hold at every point of a box of their arguments."""

import numpy as np
import pytest
from each_effect import EFFECTS

import dryfric_control as dfc
from dryfric_control import effects as fx
from dryfric_control.compensation.laws import unbounded_effects

#: Arguments of a law and how far they are drawn.
SIZES = {"t": 3.0, "x": 0.05, "v": 0.3, "u": 30.0, "rest": 1.0}
BOUNDED = [one for one in EFFECTS if one.action in ("force", "friction", "input")]


def box_and_points(rng, count=20):
    """A box of random size and place, and arguments within it, at its ends half of the time."""
    ends = {}
    for name, size in SIZES.items():
        pair = rng.uniform(-size, size, 2) * 10.0 ** rng.uniform(-3.0, 0.0)
        ends[name] = np.sort(np.abs(pair) if name in ("t", "rest") else pair)
    levels, direction = np.sort(rng.uniform(2.0, 9.0, 2)), float(rng.choice([-1.0, 1.0]))
    named = {name: fx.Interval.of_argument(name, *pair) for name, pair in ends.items()}
    level = fx.Interval(*levels, np.zeros(5))
    box = fx.Box(named["t"], named["x"], named["v"], named["u"], level, direction, named["rest"])
    rows = [
        {name: rng.choice([rng.uniform(*pair), *pair]) for name, pair in ends.items()}
        for _ in range(count)
    ]
    return box, rows, float(rng.choice(levels)), direction


@pytest.mark.parametrize("effect", BOUNDED, ids=lambda effect: effect.slug)
def test_bounds_hold_all_over_a_box_and_are_not_wide(effect):
    rng, filled = np.random.default_rng(69), 0.0
    for _ in range(100):
        box, rows, level, direction = box_and_points(rng)
        found = effect.bounds(box)
        values = np.array([
            effect.law(r["t"], r["x"], r["v"], r["u"], level, direction, r["rest"], effect.values)
            for r in rows
        ])  # fmt: skip
        slack = 1e-12 * (1.0 + np.abs(values).max())
        assert found.low - slack <= values.min() and values.max() <= found.high + slack
        if np.all(np.isfinite(found.slopes)):
            for one, other, change in zip(rows, rows[1:], np.diff(values), strict=False):
                by = [abs(one[name] - other[name]) for name in SIZES]
                assert abs(change) <= found.slopes @ by * (1.0 + 1e-9) + slack
        if found.high > found.low:
            filled = max(filled, np.ptp(values) / float(found.high - found.low))
    # Twenty points, half of them at the ends, come near to the bounds of some box.
    assert filled > 0.9 or effect.slug in ("bias_force", "coulomb_asymmetry")


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: effect.slug)
def test_an_effect_has_bounds_or_is_not_covered(effect):
    axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0, effects=effect)
    lost = unbounded_effects(axis)
    covered = effect.action in ("force", "friction", "input", "axis", "delay", "lag")
    assert lost == (() if covered else (effect.slug,))


def test_the_sine_of_an_interval_has_its_crests_and_troughs():
    """By the sine itself on a fine grid, for boxes of any width."""
    rng = np.random.default_rng(3)
    for low, width in rng.uniform(0.0, 8.0, (200, 2)) * [1.0, 0.9]:
        angle = fx.Interval.of_argument("x", low - 4.0, low - 4.0 + width).sine()
        truth = np.sin(np.linspace(low - 4.0, low - 4.0 + width, 4001))
        # A grid of a five-hundredth misses a crest by half the square of it.
        assert truth.max() <= angle.high <= truth.max() + 1e-6
        assert truth.min() >= angle.low >= truth.min() - 1e-6
