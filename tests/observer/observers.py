"""The observers of the package, for tests of what all have in common."""

import numpy as np

import dryfric_control as dfc

DT = 1e-3
QUANTUM = 1e-5
AXIS = dfc.FrictionAxis(
    mass=2.0,
    viscous=15.0,
    coulomb=dfc.CoulombMap(plus=[8.0, 4.0], minus=[7.0, -3.0]),
    travel=(-0.3, 0.3),
    stick_speed=1e-3,
    effects=(dfc.effects.Gravity(1.0, 0.3), dfc.effects.InputDelay(2.4e-3)),
    name="stage",
)
#: A new observer has its line here.
OBSERVERS = {
    "switched PI": dfc.design_pi_observer(AXIS, DT, encoder_quantum=QUANTUM),
    "hybrid filter": dfc.hybrid_filter(AXIS, DT, QUANTUM),
    "extended state": dfc.extended_state_observer(AXIS, DT, QUANTUM),
    "extended state, feedforward": dfc.extended_state_observer(AXIS, DT, QUANTUM, feedforward=True),
}


def drive_and_reading(n=1500, axis=AXIS, quantum=QUANTUM):
    """Drive with reversals, rests and jumps, and what the encoder reads."""
    t = np.arange(n) * DT
    u = 11.0 * np.sin(9.0 * t) + 6.0 * (np.floor(4.0 * t) % 3.0 - 1.0)
    return u, quantum * np.round(axis.simulate(u, DT).y[0] / quantum)
