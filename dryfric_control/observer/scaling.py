"""Units in which the design inequalities are well conditioned.

In SI units at 1 kHz the solver reports success with a gamma many times too
large: gamma^2 lies below its absolute tolerance and the states differ by
orders of magnitude.  So every error is measured in the amount by which the
disturbances alone move it, and z in units of the gain no observer can beat,
which makes the optimal gamma a number a little above 1 whatever the units.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dryfric_control.observer.error_model import ErrorModel
from dryfric_control.observer.switching import best_gain
from dryfric_control.observer.weights import Weights

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Scales:
    """Unit of each error and factor of the performance output.

    Attributes
    ----------
    state : ndarray, shape (3,)
        Unit of position, speed and friction error.
    output : float
        Factor of z.
    """

    state: Array
    output: float

    def apply(self, models: Mapping[int, ErrorModel]) -> dict[int, ErrorModel]:
        """Scaled error dynamics of each class."""
        return {key: model.scaled(self.state, self.output) for key, model in models.items()}

    def physical_gains(self, gains: Array) -> Array:
        """Gains in physical units from scaled ones, shape (n, 3)."""
        return gains * self.state / self.state[0]

    def scaled_gains(self, gains: Array) -> Array:
        """Scaled gains from those in physical units, shape (n, 3)."""
        return gains * self.state[0] / self.state


def scales_of(models: Mapping[int, ErrorModel], weights: Weights) -> Scales:
    """Scales that make the design problem a matter of numbers near 1.

    Notes
    -----
    With the observer's natural frequency beta per sample, an uncertain force d
    on the mass m moves the speed estimate by about ``dt d / (m sqrt(beta))``
    and the position estimate by ``1 / beta`` samples of that.
    """
    force = max(weights.uncertainty.values())
    speed = force * weights.kick / np.sqrt(weights.bandwidth)
    state = np.array([speed * weights.dt / weights.bandwidth, speed, force])
    state[0] = max(state[0], weights.noise)
    size = max(float(np.linalg.norm(model.Z * state)) for model in models.values())
    # in these units the bisection takes the same steps whatever the user counts in
    sized = {key: model.scaled(state, 1.0 / size) for key, model in models.items()}
    limit = max(best_gain(sized, (key,)) for key in sized)
    # with nothing but a friction error in z, and no drift, the limit is zero
    return Scales(state, 1.0 / (limit * size) if limit > 1e-6 else 1.0 / size)
