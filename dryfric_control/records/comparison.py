"""A measured channel against what the position says of it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dryfric_control.arrays import Floats

_LONGEST = 0.1  # s, delay that is looked for


class Comparison(NamedTuple):
    """How a channel differs from what is expected of it."""

    gain: float  # factor on the expected channel; far from 1, its unit is another one
    offset: float  # [unit of the channel]
    delay: float  # time by which the channel comes later [s]
    rms: float  # of what is left [unit of the channel]


def compared(expected: Floats, measured: Floats, dt: float) -> Comparison:
    """Gain, offset and delay that bring a channel closest to what is expected."""
    longest = min(round(_LONGEST / dt), expected.size // 4)
    inside = slice(longest, expected.size - longest)
    wanted = expected[inside]
    if wanted.size < 3 or np.ptp(wanted) == 0.0:
        raise ValueError("the position does not move enough to compare a channel with it")
    centred = wanted - wanted.mean()

    def later(lag: int) -> Comparison:
        seen = measured[longest + lag : expected.size - longest + lag]
        gain = float(centred @ seen) / float(centred @ centred)
        offset = float(seen.mean() - gain * wanted.mean())
        rms = float(np.sqrt(np.mean((seen - gain * wanted - offset) ** 2)))
        return Comparison(gain, offset, lag * dt, rms)

    return min(map(later, range(-longest, longest + 1)), key=lambda one: one.rms)
