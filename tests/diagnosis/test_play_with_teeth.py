"""A play whose ends give way, as the teeth of a gear do, in a record made by plain steps."""

import math

import numpy as np
import pytest

import dryfric_control as dfc

MOTOR, LOAD = 0.084, 0.066  # inertia of both sides [kg m^2]
VISCOUS, COULOMB = 1.2, 1.8  # [N m s/rad], [N m]
GAP = 1e-3  # [rad]
STIFFNESS, DAMPING = 4e4, 8.0  # of the teeth [N m/rad], [N m s/rad]
DT, SUBSTEPS = 2e-3, 80


def record_with_teeth(seconds=5.0, seed=5):
    """The drive and the encoder of the motor, in a loop that follows three sines."""
    rng = np.random.default_rng(seed)
    n, h = round(seconds / DT), DT / SUBSTEPS
    t = DT * np.arange(n)
    rates = 2.0 * math.pi * np.array([0.13, 0.41, 1.1])
    angles = rates * t[:, None] + rng.uniform(0.0, 6.0, 3)
    sizes = np.array([0.4, 0.15, 0.05])
    wanted, pace = (sizes * np.sin(angles)).sum(1), (sizes * rates * np.cos(angles)).sum(1)
    x = y = float(wanted[0])
    v = p = float(pace[0])
    u, seen = np.empty(n), np.empty(n)
    last = x
    for k in range(n):
        seen[k] = 1e-5 * round(x / 1e-5)
        u[k] = 350.0 * (wanted[k] - seen[k]) + 22.0 * (pace[k] - (seen[k] - last) / DT)
        last = seen[k]
        for _ in range(SUBSTEPS):
            over = x - y - math.copysign(min(abs(x - y), 0.5 * GAP), x - y)
            teeth = STIFFNESS * over + DAMPING * (v - p) if over else 0.0
            v += h * (u[k] - teeth) / MOTOR
            if p != 0.0 or abs(teeth) > COULOMB:
                s = math.copysign(1.0, p if p != 0.0 else teeth)
                new = p + h * (teeth - COULOMB * s - VISCOUS * p) / LOAD
                p = 0.0 if p * new < 0.0 else new
            x += h * v
            y += h * p
    noise = 0.02 * rng.standard_normal(n)
    return dfc.Record(t=t, u=u + noise, x=seen, units={"u": "N m", "x": "rad"})


AXIS = dfc.FrictionAxis(mass=MOTOR + LOAD, viscous=VISCOUS, coulomb=COULOMB, units=("rad", "N m"))


@pytest.mark.slow
def test_play_and_stiffness_of_the_teeth_are_one_cause():
    d = dfc.diagnose(AXIS, record_with_teeth(), jobs=1, progress=False)
    assert d.verdict == "explained"
    assert [cause.effect for cause in d.main_causes] == ["backlash"]
    (play,) = d.main_causes
    assert play.parameters["gap"] == pytest.approx(GAP, rel=0.02)
    assert 1.0 / play.parameters["compliance"] == pytest.approx(STIFFNESS, rel=0.1)
    assert play.parameters["load_fraction"] == pytest.approx(LOAD / (MOTOR + LOAD), abs=0.05)
    assert "stiffness of" in d.details()
