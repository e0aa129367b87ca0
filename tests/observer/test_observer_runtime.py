"""The running observer against a textbook version, closed forms and its own faces."""

from collections import deque

import numpy as np
import pytest

import dryfric_control as dfc
from dryfric_control import presets
from dryfric_control.observer import ObserverStepper, design_pi_observer, observe

DT = 1e-3
RULES = ("reading", "paper", "filippov")
# Two ways of writing the same sums differ by round-off, which the observer
# (poles within 0.95) amplifies by far less than 1e4: relative to the signals.
ROUND_OFF = 1e-11


def axis(**changes):
    return dfc.FrictionAxis(
        mass=2.0, viscous=15.0, coulomb=dfc.CoulombMap(plus=[8.0, 4.0, -6.0], minus=[7.0, -3.0]),
        travel=(-0.3, 0.3), stick_speed=2e-3,
    ).replace(**changes)  # fmt: skip


def record(plant, quantum):
    """Drive with rests, reversals and jumps, and what the encoder reads."""
    t, jumps = np.arange(6000) * DT, np.random.default_rng(0).uniform(-1.0, 1.0, 24)
    u = 11.0 * np.sin(5.0 * t) + 6.0 * np.repeat(jumps, 250)
    return u, quantum * np.round(plant.simulate(u, DT).y[0] / quantum)


def textbook(design, u, y, rule, quantum, xhat0, vhat0):
    """Equation (7) in matrices, the modes as a list of rules."""
    own = design.axis

    def level(x, s):
        coefficients = own.coulomb.plus if s > 0 else own.coulomb.minus
        x = min(max(x, own.travel[0]), own.travel[1])
        return sum(c * x**i for i, c in enumerate(coefficients))

    X, w = np.array([xhat0, vhat0]), 0.0
    mode = int(np.sign(vhat0)) if abs(vhat0) > own.stick_speed else 0
    learned = {1: 0.0, -1: 0.0}
    place, count = y[0], 1
    forget = max(abs(np.linalg.eigvals(design.error_dynamics(1).A))) ** (1 / 8)
    away = 1.5 * quantum + own.stick_speed / own.stick_rate
    past = None
    rows = []
    for drive, reading in zip(u, y, strict=True):
        before = mode
        if rule != "reading":
            held = -level(reading, -1) <= drive <= level(reading, 1)
            if mode == 0:
                mode = 0 if held else int(np.sign(drive))
            elif held and abs(X[1]) <= own.stick_speed:
                mode = 0
            elif rule == "paper":
                mode = int(np.sign(X[1])) or mode
            elif mode * X[1] <= 0.0 and not held and np.sign(drive) == -mode:
                mode = -mode
        elif mode == 0:
            gone = reading - place
            s = 1 if gone > 0 else -1
            slides = s * drive > level(reading, s) + learned[s]
            if abs(gone) > (away / 2 if slides else away):
                mode = s
            else:
                count = min(count + 1, 64)
                place += gone / count
        else:
            pushed_back = -mode * drive > level(reading, -mode) + learned[-mode]
            slow = mode * X[1] <= own.stick_speed
            if slow and not (pushed_back and mode * X[1] > 0.0):
                mode, place, count = 0, reading, 1
        if rule == "reading" and mode != before:
            w = -mode * learned[mode] if mode else 0.0
        key = design.classes[mode]
        if past is None:
            past = deque([key] * design.window, maxlen=design.window)
        else:
            past.append(key)
        gain = design.window_gains[",".join(str(one) for one in past)]
        error = reading - X[0]
        if design.form == "current":
            X, w, error = X + gain[:2] * error, w + gain[2] * error, 0.0
        F = drive if mode == 0 else mode * level(reading, mode) - w
        rows.append([X[0], X[1], F, w, mode])
        A, B, E = design.mode_matrices(mode)
        believed = mode * level(reading, mode) if mode else 0.0
        X = A @ X + B * (drive - believed) + E * w + gain[:2] * error
        if mode:
            learned[mode] += (1 - forget) * (-mode * w - learned[mode])
        w = w + gain[2] * error
    return np.array(rows).T


OPTIONS = {
    "default": {},
    "paper": {"discretization": "euler", "form": "prediction"},
    "path": {"method": "path", "window": 3},
    "asymmetric": {"uncertainty": {0: 1.0, 1: 2.0, -1: 3.0}, "form": "prediction"},
}


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("options", OPTIONS.values(), ids=OPTIONS)
def test_observer_is_the_textbook_version(rule, options):
    quantum = 1e-4
    plant = axis(stribeck=dfc.Stribeck(0.3, 2e-3))
    u, y = record(plant, quantum=quantum)
    design = design_pi_observer(
        plant, DT, coulomb=plant.coulomb.scaled(0.85, 1.15), encoder_quantum=quantum, **options
    )
    expected = textbook(design, u, y, rule, quantum, 0.01, -0.1)
    given = {"xhat0": 0.01, "vhat0": -0.1, "switching": rule, "encoder_quantum": quantum}
    got = observe(design, u, y, **given).y
    assert set(np.unique(expected[4])) == {-1.0, 0.0, 1.0}
    np.testing.assert_array_equal(got[4], expected[4])
    scale = np.abs(expected).max(axis=1)
    assert np.all(np.abs(got - expected).max(axis=1) <= ROUND_OFF * scale)


def test_exact_model_of_sliding_is_followed_exactly():
    """Constant drive on a Coulomb mass: x = x0 + v0 t + a t^2/2, no error to correct."""
    plant = axis(viscous=0.0, coulomb=8.0)
    design = design_pi_observer(plant, DT, discretization="zoh", encoder_quantum=1e-5)
    t = np.arange(500) * DT
    a = (14.0 - 8.0) / 2.0
    x, v = 0.1 * t + 0.5 * a * t**2, 0.1 + a * t
    estimate = observe(design, np.full(500, 14.0), x, vhat0=0.1)
    assert np.all(estimate.mode == 1)
    # Round-off of 500 additions of numbers up to 2.
    np.testing.assert_allclose(estimate.y[0], x, atol=1e-12)
    np.testing.assert_allclose(estimate.y[1], v, atol=1e-12)


def test_stuck_friction_is_the_net_force():
    plant = axis(effects=(dfc.effects.Spring(stiffness=20.0, rest=0.05),))
    design = design_pi_observer(plant, DT, encoder_quantum=1e-5)
    u = np.linspace(0.0, 3.0, 200)
    estimate = observe(design, u, np.full(200, 0.1))
    assert np.all(estimate.mode == 0)
    np.testing.assert_allclose(estimate.y[2], u - 20.0 * (0.1 - 0.05), atol=1e-13)


def test_what_is_motion_and_what_is_not():
    """A load of 9 on a level believed to be 8: only "reading" says that the axis rests."""
    design = design_pi_observer(axis(coulomb=8.0), DT, encoder_quantum=1e-5)
    for rule in RULES:
        estimate = observe(design, np.full(300, 9.0), np.zeros(300), switching=rule)
        assert np.all((estimate.mode != 0) == (rule != "reading"))
    # A last digit that toggles is no motion.
    y = 1e-5 * np.random.default_rng(0).integers(0, 2, 5000)
    assert np.all(observe(design, np.zeros(5000), y, encoder_quantum=1e-5).mode == 0)


def test_motion_is_seen_when_the_reading_leaves():
    """2 increments without load, 1 increment once the load exceeds the level."""
    design = design_pi_observer(axis(coulomb=8.0), DT, encoder_quantum=1e-4)
    y = 1e-4 * np.repeat([0.0, 1.0, 2.0], 10)

    def first(load):
        estimate = observe(design, np.full(30, load), y, encoder_quantum=1e-4)
        return int(np.flatnonzero(estimate.mode == 1)[0])

    assert first(0.0) == 20
    assert first(9.0) == 10


def test_stepper_starts_at_the_first_reading():
    design = presets.clutch_observer()
    u, y = presets.clutch_experiment(design, duration=0.2).plant.y[4:6] + [[0.0], [5000.0]]
    whole, stepper = observe(design, u, y).y, ObserverStepper(design)
    steps = [stepper.step(u[0], y[0])]
    # What is no number leaves it as it was.
    with pytest.raises(ValueError, match="y must be a finite number"):
        stepper.step(u[1], np.nan)
    steps += [stepper.step(*one) for one in zip(u[1:], y[1:], strict=True)]
    np.testing.assert_allclose(np.array(steps).T, whole, rtol=1e-9, atol=1e-9)
