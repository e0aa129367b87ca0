"""The observer of an axis with effects: what it knows enters, what it cannot is told."""

import math
import warnings

import control as ct
import numpy as np
import pytest

import dryfric_control as dfc
from dryfric_control import effects as fx
from dryfric_control.observer import ObserverStepper, ObserverWarning, simulate_observed_loop

DT, QUANTUM = 1e-3, 1e-5


def axis(*effects, **changes):
    return dfc.FrictionAxis(
        mass=2.0, viscous=15.0, coulomb=8.0, stribeck=dfc.Stribeck(excess=0.1, speed=0.01),
        travel=(-0.3, 0.3), effects=effects,
    ).replace(**changes)  # fmt: skip


def design_of(own, **changes):
    options = {"discretization": "zoh", "encoder_quantum": QUANTUM} | changes
    return dfc.design_pi_observer(own, DT, **options)


def watched(plant, own, seed=0, n=8000):
    """Closed loop round the plant, watched by the observer of another axis."""
    reference = np.repeat(np.random.default_rng(seed).uniform(-0.2, 0.2, n // 500), 500)
    loop = dfc.PositionController.from_bandwidth(axis(), 15.0, DT, limit=60.0)
    return simulate_observed_loop(plant, loop, design_of(own), reference, quantum=QUANTUM)


EVERYTHING = (
    fx.Spring(stiffness=40.0, rest=0.05), fx.BiasForce(force=2.0),
    fx.Cogging(amplitude=1.5, period=0.02), fx.Gravity(amplitude=1.0, phase=0.3),
    fx.QuadraticDrag(drag=5.0), fx.ViscousAsymmetry(viscous=2.0), fx.CoulombAsymmetry(force=1.0),
    fx.PositionDependence(slope=0.5), fx.LoadDependence(coefficient=0.1), fx.Drift(rate=0.02),
    fx.DwellTime(rise=1.0, time_constant=0.2), fx.TimePeriodic(amplitude=0.5, frequency=3.0),
    fx.InputGain(gain=0.9), fx.DeadZone(width=0.5), fx.Saturation(limit=50.0),
    fx.InputDelay(delay=2.6e-3), fx.ActuatorLag(time_constant=4e-3), fx.Inertia(factor=1.2),
    fx.ViscousFriction(factor=0.8), fx.CoulombFriction(factor=1.1),
)  # fmt: skip


def test_knowing_a_lag_pays_in_closed_loop():
    """Bounds lie between the ratio that `benchmarks/observer.py effects` prints and 1."""
    plant = axis(fx.ActuatorLag(time_constant=6e-3))
    before, after = (watched(plant, own).score for own in (axis(), plant))
    assert after.friction < 0.3 * before.friction and after.speed < 0.6 * before.speed


def test_known_forces_enter_at_the_measured_position():
    """Euler's recursion with every force written out: followed to round-off, w = 0."""
    f, m, level = 15.0 * 0.8, 2.0 * 1.3, 8.0 * 1.1
    own = axis(
        fx.Spring(stiffness=40.0, rest=0.05), fx.BiasForce(force=2.0),
        fx.Cogging(amplitude=1.5, period=0.02, phase=0.4), fx.QuadraticDrag(drag=5.0),
        fx.ViscousAsymmetry(viscous=2.0), fx.CoulombAsymmetry(force=1.0),
        fx.PositionDependence(slope=0.5, centre=0.1), fx.Drift(rate=0.02),
        fx.TimePeriodic(amplitude=0.5, frequency=3.0, phase=0.2),
        fx.LoadDependence(coefficient=0.1), fx.Gravity(amplitude=3.0, phase=1.0),
        fx.Saturation(limit=25.0), fx.InputGain(gain=0.9), fx.DeadZone(width=0.5),
        fx.InputDelay(delay=3 * DT), fx.Inertia(factor=1.3), fx.ViscousFriction(factor=0.8),
        fx.CoulombFriction(factor=1.1),
    )  # fmt: skip
    n, t = 400, DT * np.arange(400)
    u = 24.0 + 3.0 * np.sin(20.0 * t)
    x, v, friction = (np.empty(n) for _ in range(3))
    # The observer's line of delayed drives starts at zero, the speed high enough to slide.
    x[0], v[0] = -0.2, 0.5
    for k in range(n):
        drive = 0.9 * min(u[k - 3], 25.0) - 0.5 if k >= 3 else 0.0
        net = drive - 40.0 * (x[k] - 0.05) + 2.0 - 5.0 * v[k] ** 2 - 2.0 * v[k]
        net -= 3.0 * math.sin(x[k] - 1.0)
        net += 1.5 * math.sin(2.0 * math.pi * x[k] / 0.02 + 0.4)
        net += 0.5 * math.sin(2.0 * math.pi * 3.0 * t[k] + 0.2)
        here = (level + 1.0) * (1.0 + 0.5 * (x[k] - 0.1)) * (1.0 + 0.02 * t[k])
        # The load: the drive less all other forces.
        friction[k] = here + 0.1 * abs(drive - (net - drive))
        if k + 1 < n:
            x[k + 1] = x[k] + DT * v[k]
            v[k + 1] = v[k] + DT / m * (net - f * v[k] - friction[k])
    assert v.min() > 0.1
    estimate = dfc.observe(design_of(own, discretization="euler"), u, x, vhat0=0.5)
    assert np.all(estimate.mode == 1)
    # 400 sums of numbers below 40, with errors that the observer's gains spread.
    np.testing.assert_allclose(estimate.y[0], x, atol=1e-12)
    np.testing.assert_allclose(estimate.y[1], v, atol=1e-10)
    np.testing.assert_allclose(estimate.y[2], friction, atol=1e-8)
    np.testing.assert_allclose(estimate.y[3], 0.0, atol=1e-8)


@pytest.mark.parametrize("rule", ["reading", "paper", "filippov"])
def test_faces_agree_with_every_effect(rule, tmp_path):
    """Compiled record, python-control block, stepper and a saved design."""
    plant = axis(*EVERYTHING)
    with warnings.catch_warnings():
        warnings.simplefilter("error", ObserverWarning)
        run = watched(plant, plant, n=1500)
    u, y = run.plant.y[4], run.plant.y[5]
    design = run.design
    assert len(design.axis.effects) == len(EVERYTHING) - 3
    whole = dfc.observe(design, u, y, xhat0=0.0, switching=rule)
    block = dfc.pi_observer(design, switching=rule)
    there = ct.input_output_response(block, whole.t, np.vstack([u, y]), np.zeros(block.nstates))
    stepper = ObserverStepper(design, xhat0=0.0, switching=rule)
    steps = np.array([stepper.step(a, b) for a, b in zip(u, y, strict=True)]).T
    scale = np.maximum(np.abs(whole.y).max(axis=1, keepdims=True), 1e-12)
    assert np.abs((there.outputs - whole.y) / scale).max() < 1e-9
    assert np.abs((steps - whole.y) / scale).max() < 1e-9
    assert set(np.unique(whole.mode)) == {-1, 0, 1}
    design.save(tmp_path / "observer.json")
    loaded = dfc.ObserverDesign.load(tmp_path / "observer.json")
    again = dfc.observe(loaded, u, y, xhat0=0.0, switching=rule)
    np.testing.assert_array_equal(again.y, whole.y)


@pytest.mark.parametrize(
    ("effects", "named"),
    [
        ((fx.Presliding(4e-5),), "presliding"),
        ((fx.Backlash(1e-4, 0.5),), "backlash"),
        ((fx.Presliding(4e-5), fx.BiasForce(2.0), fx.Compliance(1e5, 60.0, 0.5)),
         "presliding, compliance"),
    ],
)  # fmt: skip
def test_what_the_observer_has_no_states_for_is_told_once(effects, named):
    plant = axis(*effects)
    with pytest.warns(ObserverWarning, match=f"leaves out {named}:") as told:
        design = design_of(plant)
    assert [one.filename for one in told] == [__file__]
    rest = tuple(e for e in effects if isinstance(e, fx.BiasForce))
    assert design.axis == design_of(axis(*rest)).axis
    # The axis that was given keeps its effects.
    assert plant.effects == effects


@pytest.mark.parametrize("design", [dfc.design_pi_observer, dfc.hybrid_filter])
def test_milliseconds_taken_for_seconds_are_warned_of(design):
    axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    with pytest.warns(UserWarning, match="dt = 2 s is long .* seconds, 2 ms is dt=0.002") as told:
        design(axis, dt=2, encoder_quantum=1e-6)
    assert told[0].filename == __file__
