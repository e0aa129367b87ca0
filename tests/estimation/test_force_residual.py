"""Force residual: what is missing in an axis, and records behind drive and encoder."""

import numpy as np
import pytest

import dryfric_control as dfc
from dryfric_control.estimation.force_residual import Residual, at_the_mass

AXIS = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)


def test_residual_is_the_force_that_the_axis_lacks():
    t = 1e-3 * np.arange(4000)
    u = 20.0 * np.sin(6.0 * t)
    pushed = AXIS.replace(effects=(dfc.effects.BiasForce(force=1.5),))
    x = pushed.simulate(u, dt=1e-3).y[0]
    # Smoothing bends the motion a little.
    assert np.median(Residual(AXIS, dfc.Record(t, u, x)).residual) == pytest.approx(1.5, abs=5e-3)


def test_drive_behind_gain_and_delay_is_that_at_the_mass():
    t = 1e-3 * np.arange(2000)
    effects = (dfc.effects.InputGain(gain=1.2), dfc.effects.InputDelay(delay=4e-3))
    bare, behind = at_the_mass(AXIS.replace(effects=effects), dfc.Record(t, t, np.sin(t)))
    assert bare.effects == ()
    # The ramp, four samples late.
    assert behind.u[1000] == pytest.approx(1.2 * (1.0 - 4e-3), rel=1e-12)
