"""The criterion of the diagnosis: how much likelier one fit makes data that it has not seen."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from dryfric_control.diagnosis.candidates import effect_class
from dryfric_control.diagnosis.thresholds import MIN_EVIDENCE
from dryfric_control.estimation.random_force import long_run
from dryfric_control.estimation.solution import Solution

FloatArray = NDArray[np.float64]


def evidence(less: Solution, more: Solution, odds: Sequence[float] = (0.0,)) -> float:
    """Log-likelihood of held-out data that `more` gains over `less`, net of its assumptions.

    Blocks are predicted with parameters fitted without their half.  Each cause costs MIN_EVIDENCE
    and the logarithm of the number of shapes that were searched, of which held-out data know
    nothing; wrong base parameters cost by their prior.  Coloured innovations count as fewer.
    No cause gains more on data that its parameters have not seen than on those that they have.
    Where there is no axis without the cause, it is infinite.
    """
    if not less.point.out:
        return math.inf
    prior = prior_of(less) - prior_of(more)
    seen = less.cost - more.cost - prior
    costs = sum(MIN_EVIDENCE + one for one in odds)
    if seen + prior <= costs:
        return seen + prior - costs
    fall = less.held_out() - more.held_out()
    gain = min(float(fall[np.isfinite(fall)].sum()), seen)
    return gain / long_run(more) + prior - costs


def odds_of(odds: Mapping[str, float], name: str) -> float:
    """Logarithm of the number of shapes of an effect; another one of a kind has as many."""
    return odds.get(name, odds.get(effect_class(name).slug, 0.0))


def cost_of(fit: Solution) -> float:
    """Cost of a fit, to choose one by it."""
    return fit.cost


def prior_of(fit: Solution) -> float:
    """Prior cost of a fit."""
    return fit.problem.prior(fit.z)


def nominal_error_costs(fit: Solution) -> FloatArray:
    """What each wrong nominal value of a fit costs as an assumption of its own."""
    return fit.problem.nominal_error_costs(fit.z)
