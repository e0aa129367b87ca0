"""Every effect against the independent bench, and an encoder that reads otherwise."""

import dataclasses
import math

import numpy as np
import pytest
from diagnosis_cases import believed, machine
from truth import ADDED, EFFECTS, make_case, open_loop
from truth.plant import _read

import dryfric_control as dfc

DT = 1e-3
CLOSE = {
    # The stick band below Sigma <= 1e-4 m/s shortens each stop by up to Sigma/p = 2e-7 m.
    "presliding": 2e-8,
    "compliance": 1e-6,
    # An impact on the truth's contact, made 100 times stiffer, lasts some 60 us, on ours no time:
    # at a closing speed of up to 0.1 m/s the load is 6 um off.
    "backlash": 6e-6,
}
CASES = [(slug, 1) for slug in (*EFFECTS, *ADDED, ())]
CASES += [(slug, 2) for slug in (*ADDED, *CLOSE)]
CASES += [("presliding", 3), ("compliance", 3), ("backlash", 4)]  # the first two beside a peak


def differences(case, axes, damped=1.0, **changes):
    """Largest differences between the readings of axes and those of the bench."""
    n, stiffer, finer = (1500, 100.0, 20) if case.plant.gap else (3000, 1.0, 8)
    plant = case.plant._replace(
        coupling_stiffness=stiffer * case.plant.coupling_stiffness,
        coupling_damping=damped * math.sqrt(stiffer) * case.plant.coupling_damping,
        **changes,
    )
    states = open_loop(plant, case.u[:n], DT, finer * case.substeps, case.states[0])[:n]
    readings = np.array([_read(plant, state) for state in states])
    runs = [axis.simulate(case.u[:n], DT, x0=case.states[0, 0]).y[0] for axis in axes]
    return [np.abs(run - readings).max() for run in runs]


@pytest.mark.parametrize(("slug", "seed"), CASES, ids=lambda one: str(one or "nothing"))
def test_a_run_is_that_of_the_truth(slug, seed):
    """Both are checked: the bench steps impulses without events, the axis modes between them."""
    case = make_case(slug, seed, "short")
    error, without = differences(case, (machine(case), believed(case)))
    closest = CLOSE.get(slug, 1e-5 if slug in ADDED and not case.plant.gap else 2e-5)
    assert error < (closest if slug else 0.1 * case.quantum)
    # The stick band shortens a stop by Sigma/p = 2e-7 m, which friction that falls with velocity
    # magnifies at the next start; an impact takes the bench some time.
    assert not slug or without > (100.0 if seed == 1 else 40.0) * error


@pytest.mark.parametrize(
    ("slug", "seed"), [("compliance", 1), ("compliance", 3), ("backlash", 1), ("backlash", 4)]
)
def test_a_run_of_a_motor_with_friction_is_that_of_the_truth(slug, seed):
    """The same two masses, friction and all forces on the motor."""
    case = make_case(slug, seed, "short")
    effect = dataclasses.replace(machine(case).effects[0], friction_on_motor=1.0)
    axes = believed(case).replace(effects=effect), machine(case)
    # Damped at a ratio of 2.8: at 0.7 a load without friction would rebound a little.
    error, other = differences(case, axes, 4.0 if case.plant.gap else 1.0, motor_rubs=1.0)
    assert error < CLOSE[slug] and other > 40.0 * error


def test_an_encoder_reads_otherwise_than_the_axis_stands():
    encoder = dfc.effects.EccentricEncoder(amplitude=2e-4, period=0.01, phase=0.5)
    axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0, effects=encoder)
    u = 20.0 * np.sin(30.0 * DT * np.arange(200))
    run = axis.simulate(u, DT)
    true = axis.replace(effects=()).simulate(u, DT).y[0]
    wave = 2e-4 * np.sin(2.0 * np.pi * true / 0.01 + 0.5)
    np.testing.assert_allclose(run.y[0], true + wave, rtol=0, atol=1e-15)
    # A loop follows the reading: the axis itself comes to rest elsewhere.
    loop = dfc.PositionController(kp=2500.0, ki=5000.0, kd=110.0, dt=DT, limit=60.0)
    closed = dfc.simulate_loop(axis, loop, np.full(2000, 0.0133))
    assert closed.y[5, -1] == pytest.approx(closed.y[0, -1], abs=1e-12)
    with pytest.raises(ValueError, match="no place for the effect 'eccentric_encoder', which acts"):
        dfc.switched_axis(axis, DT)
    with pytest.raises(ValueError, match="no place for the effect 'eccentric_encoder'"):
        axis.simulate(u, DT, law=dfc.laws.Tanh(speed=1e-3))
