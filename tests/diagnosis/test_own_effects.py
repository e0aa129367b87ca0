"""A user's own effect is a candidate like any other, and judged like any other."""

from dataclasses import dataclass

import numpy as np
import pytest
from diagnosis_cases import among, causes

import dryfric_control as dfc
from dryfric_control.diagnosis.diagnose import diagnose

DT = 1e-3


def made_record(push):
    """Closed loop over a mass with dry friction and a force push(x, v), 20 steps a sample.

    Semi-implicit Euler, the speed clipped at zero while friction can hold.
    """
    mass, viscous, coulomb, inner = 2.0, 15.0, 8.0, 20
    rng = np.random.default_rng(4)
    reference = np.convolve(np.repeat(rng.uniform(0.05, 0.25, 20), 300), np.ones(150) / 150, "same")
    n, h, quantum = 4000, DT / 20, 2e-6
    x, v = float(reference[0]), 0.0
    u, y = np.zeros(n), np.zeros(n)
    before = 0.0
    for k in range(n):
        y[k] = quantum * round(x / quantum)
        error = reference[k] - y[k]
        u[k] = 2000.0 * error + (90.0 * (error - before) / DT if k else 0.0)
        before = error
        for _ in range(inner):
            x += 0.5 * h * v
            drive = u[k] + push(x, v) - viscous * v
            free = v + h * drive / mass
            v = np.sign(free) * max(abs(free) - h * coulomb / mass, 0.0)
            x += 0.5 * h * v
    return dfc.Record(DT * np.arange(n), u, y)


def brake_law(t, x, v, u, level, direction, rest, p):
    return -2.0 * p[0] * (v / p[1]) / (1.0 + (v / p[1]) ** 2)


@dataclass(frozen=True)
class Brake(dfc.effects.Effect):
    """An eddy-current brake: the drag rises with speed and falls again."""

    force: float = dfc.effects.parameter("N", "largest drag", bounds=(0.0, np.inf))
    speed: float = dfc.effects.parameter(
        "m/s", "speed at which it is reached", bounds=(1e-3, np.inf)
    )

    slug = "brake"
    title = "eddy-current brake"
    action = "force"
    explanation = "A magnet induces currents in a conductor that it passes."
    experiment = "Run at several constant speeds."
    law = staticmethod(brake_law)


@pytest.mark.slow
def test_an_effect_of_the_user_is_found_like_any_other_from_any_start():
    axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    measured = made_record(lambda x, v: -6.0 * (v / 0.12) / (1.0 + (v / 0.12) ** 2))
    with among("quadratic_drag", "viscous_asymmetry", "stribeck"):
        dfc.effects.register_effect(Brake)
        found = diagnose(axis, measured, jobs=1)
    assert causes(found) == ["brake"], str(found)
    # Truth is first order in its step of 50 us: a few permille of force.
    assert found.causes[0].parameters["force"] == pytest.approx(3.0, rel=0.02)
    assert found.causes[0].parameters["speed"] == pytest.approx(0.12, rel=0.02)
