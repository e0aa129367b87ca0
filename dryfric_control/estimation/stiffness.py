"""How stiff an elastic part may be to be seen by samples."""

from __future__ import annotations

from dryfric_control.model.axis import FrictionAxis, elastic_rates

# Natural frequency of a contact, and of a damped transmission, times the sampling time [rad]
# beyond which they are too stiff: a sample takes dozens of steps. How far a contact yields shows
# beyond the frequency of the samples, too; how a transmission swings does not.
_CONTACT, _TRANSMISSION = 30.0, 4.0


def stiffness(axis: FrictionAxis, dt: float) -> float:
    """Rate of the elastic parts over the fastest that samples show; 0 without such parts."""
    rates = elastic_rates(axis, dt)
    turn = rates["transmission"] + rates["damping"]
    return max(rates["contact"] / _CONTACT, turn / _TRANSMISSION) * dt
