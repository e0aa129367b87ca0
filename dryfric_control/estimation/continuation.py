"""Fits at a large random force first, where the likelihood is smooth, and then at smaller ones."""

from __future__ import annotations

import math

from dryfric_control.arrays import Floats
from dryfric_control.estimation.likelihood import Likelihood
from dryfric_control.estimation.scoring import FEW, SOME, maximise
from dryfric_control.estimation.solution import Solution

#: Random force over the drive at first; its ratio from one to the next; their least number.
LOUD, LOWER, RUNGS = 0.3, 1.0 / 3.0, 2


def with_force(likelihood: Likelihood, z: Floats, part: float) -> Floats:
    """Coordinates with the random force a part of the drive."""
    z = z.copy()
    z[len(likelihood.names) :][::2] = [2.0 * math.log(part * r.drive) for r in likelihood.runs]
    return z


def held(likelihood: Likelihood, z: Floats, turns: int = FEW, until: float = math.inf) -> Solution:
    """Parameters fitted with the noises held, as far as slopes of forces lead."""
    one, noises = likelihood.on(likelihood.runs), slice(len(likelihood.names), None)
    one.low, one.high = likelihood.low.copy(), likelihood.high.copy()
    one.low[noises] = one.high[noises] = z[noises]
    return maximise(one, z, turns, until, True)


def continued(likelihood: Likelihood, z: Floats, until: float = math.inf) -> Floats:
    """Parameters fitted at random forces that are held, each lower, until below the friction."""
    level, drive = likelihood.axis.coulomb.mean, max(r.drive for r in likelihood.runs)
    below = math.log(max(LOUD * drive / level, 1.0), 1.0 / LOWER) if level > 0.0 else 0.0
    for rung in range(max(math.ceil(below), RUNGS)):
        part = LOUD * LOWER**rung
        z = held(likelihood, with_force(likelihood, z, part), SOME, until).z
    return z
