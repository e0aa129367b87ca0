"""The resolution of a record: what its encoder cannot separate."""

from __future__ import annotations

import math
from typing import NamedTuple

# Part of the range that the arithmetic of a free run may lose.
ROUNDING = 1e-9

#: Encoder quanta in a standard deviation: a reading is off by up to half a quantum, all alike.
QUANTA = math.sqrt(12)


class Resolution(NamedTuple):
    """Smallest differences of position that a record shows [unit of x].

    Noise is at least that of the quantum (0 for none); rounding is arithmetic alone.
    """

    noise: float
    quantum: float
    rounding: float

    @property
    def deviation(self) -> float:
        """Standard deviation below which an error is none [unit of x]."""
        return max(self.noise, self.rounding)

    @property
    def step(self) -> float:
        """Quantum of the encoder that would resolve as much [unit of x]."""
        return max(self.quantum, QUANTA * self.noise, self.rounding)

    @property
    def fast(self) -> float:
        """Standard deviation of the noise net of the quantum's [unit of x]."""
        return math.sqrt(max(self.noise**2 - self.quantum**2 / 12.0, 0.0))
