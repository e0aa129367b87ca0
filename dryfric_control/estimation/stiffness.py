"""How stiff an elastic part may be to be seen by samples."""

from __future__ import annotations

import math

from dryfric_control.compiled.axis_step import (
    CONTACT_STIFFNESS,
    DAMPING,
    INVERSE_MASS,
    INVERSE_MOTOR,
    N_NUMBERS,
    STIFFNESS,
)
from dryfric_control.model.axis import FrictionAxis

# Natural frequency of a contact, and of a damped transmission, times the sampling time [rad]
# beyond which they are too stiff: the samples do not show it, and it takes dozens of steps.
_CONTACT, _TRANSMISSION = 3.0, 4.0


def sum_of_inverses(axis: FrictionAxis, dt: float) -> float:
    """Sum of the inverse masses of motor and load [1/kg]."""
    arrays = axis.arrays(dt)
    numbers = arrays.numbers
    # With two masses the numbers are stored twice, those of the load second.
    load = arrays.integers[N_NUMBERS] if numbers[STIFFNESS] > 0.0 else 0
    return float(numbers[INVERSE_MOTOR] + numbers[load + INVERSE_MASS])


def stiffness(axis: FrictionAxis, dt: float) -> float:
    """Rate of the elastic parts over the fastest that samples show; 0 without such parts."""
    numbers, inverse = axis.arrays(dt).numbers, sum_of_inverses(axis, dt)
    turn = math.sqrt(numbers[STIFFNESS] * inverse) + numbers[DAMPING] * inverse
    contact = math.sqrt(numbers[CONTACT_STIFFNESS] * numbers[INVERSE_MASS])
    return max(contact / _CONTACT, turn / _TRANSMISSION) * dt
