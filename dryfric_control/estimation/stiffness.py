"""How stiff the elastic parts of an axis are for the samples of a record."""

from __future__ import annotations

import math

from dryfric_control.model.axis import FrictionAxis, elastic_rates, inverse_masses

# Natural frequency of a contact times the sampling time [rad] beyond which it is too stiff: a
# sample takes dozens of steps. How far it yields shows beyond the frequency of the samples, too.
_MAX_CONTACT_FREQUENCY = 30.0
# The same of a damped transmission: how that swings does not show beyond this frequency.
_MAX_TRANSMISSION_FREQUENCY = 4.0


def stiffness(axis: FrictionAxis, dt: float) -> float:
    """Rate of the elastic parts over the fastest that samples show; 0 without such parts."""
    rates = elastic_rates(axis, dt)
    turn = rates["transmission"] + rates["damping"]
    bent = sum(effect.stiffest for effect in axis.effects if effect.action == "memory")
    contact = max(rates["contact"], math.sqrt(bent * inverse_masses(axis, dt)))
    return max(contact / _MAX_CONTACT_FREQUENCY, turn / _MAX_TRANSMISSION_FREQUENCY) * dt
