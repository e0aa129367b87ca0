"""Contacts that yield gradually, made by simulators of their own, are found and nothing else."""

import numpy as np
import pytest
from diagnosis_cases import among, causes
from numba import njit

import dryfric_control as dfc

M, F, FC, EXCESS, SPEED = 2.5, 20.0, 9.0, 0.35, 5e-3
DISTANCE, DAMPING = 3e-5, 700.0
AXIS = dfc.FrictionAxis(mass=M, viscous=F, coulomb=FC)


@njit
def controlled(reference, dt, steps, k):
    """Readings and inputs of a LuGre axis under a position loop, implicit in the bristles."""
    h, x, v, z = dt / steps, 0.0, 0.0, 0.0
    y, u, before = np.empty(reference.size), np.empty(reference.size), 0.0
    for i in range(reference.size):
        y[i] = np.floor(x / 1e-6 + 0.5) * 1e-6
        u[i] = np.round(k * (reference[i] - y[i]) - 0.03 * k * (y[i] - before) / dt, 3)
        before = y[i]
        for _ in range(steps):
            level = FC * (1.0 + EXCESS * np.exp(-((v / SPEED) ** 2)))
            new = (z + h * v) / (1.0 + h * FC / DISTANCE * abs(v) / level)
            force = FC / DISTANCE * new + DAMPING * (new - z) / h
            z = new
            v += h * (u[i] - force - F * v) / M
            x += h * v
    return y, u


def swinging(sizes, speeds, samples):
    t = 1e-3 * np.arange(samples)
    reference = sum(a * np.sin(w * t) for a, w in zip(sizes, speeds, strict=True))
    y, u = controlled(reference, 1e-3, 200, 3e3)
    return dfc.Record(t, u, y)


def contact_and_peak(found):
    assert found.verdict == "explained"
    assert {*causes(found)} == {"presliding", "stribeck"}
    effect = found.extended.effects[0]
    assert effect.bristles == 1.0
    assert effect.distance == pytest.approx(DISTANCE, rel=0.03)
    assert effect.damping == pytest.approx(DAMPING, rel=0.05)
    # The peak of the axis begins at its stick velocity, that of the truth at zero.
    assert found.extended.stribeck.excess == pytest.approx(EXCESS, rel=0.05)
    assert found.gain.ratio > 100.0
    assert found.extended.effective().stribeck == found.extended.stribeck


@pytest.mark.long
def test_bristles_and_peak_are_found_and_nothing_else():
    record = swinging((0.1, 0.04, 0.02), (1.7, 4.1, 11.0), 7000)
    contact_and_peak(dfc.diagnose(AXIS, record, progress=False))


@pytest.mark.slow
def test_they_are_found_where_a_straight_line_predicts_as_well_as_a_rigid_axis():
    record = swinging((0.03, 0.01, 0.004), (0.9, 3.1, 7.0), 5000)
    with among("presliding", "stribeck", "backlash", "load_asymmetry", "cogging", "viscous"):
        contact_and_peak(dfc.diagnose(AXIS, record, progress=False))


@njit
def slipping(reference, dt, steps):
    """Readings and inputs of an axis on six Maxwell slip elements, under a position loop."""
    h, x, v = dt / steps, 0.0, 0.0
    share = np.array([0.3, 0.25, 0.18, 0.12, 0.09, 0.06])
    length = 2e-5 * np.array([0.25, 0.5, 0.8, 1.2, 1.8, 2.6])
    z, before = np.zeros(6), 0.0
    y, u = np.empty(reference.size), np.empty(reference.size)
    for i in range(reference.size):
        y[i] = np.floor(x / 3e-6 + 0.5) * 3e-6
        u[i] = 190.0 * (reference[i] - y[i]) - 8.0 * (y[i] - before) / dt
        before = y[i]
        for _ in range(steps):
            new = np.minimum(np.maximum(z + h * v, -length), length)
            stiffness = 0.15 * share / length
            force = np.sum(stiffness * new + 0.02 * np.sqrt(0.2 * stiffness) * (new - z) / h)
            z = new
            v += h * (u[i] - force - 0.03 * v) / 0.2
            x += h * v
    return y, u


@pytest.mark.long
def test_a_contact_that_yields_part_by_part_is_no_play():
    t = 4e-3 * np.arange(2000)
    reference = 0.2 * np.sin(0.6 * t) + 0.08 * np.sin(2.3 * t) + 0.03 * np.sin(7.0 * t)
    y, u = slipping(reference, 4e-3, 200)
    axis = dfc.FrictionAxis(mass=0.2, viscous=0.03, coulomb=0.15)
    with among("presliding", "backlash", "load_encoder_backlash", "compliance", "dwell_time"):
        found = dfc.diagnose(axis, dfc.Record(t, u, y), progress=False)
    assert found.verdict == "explained"
    assert causes(found) == ["presliding"]
