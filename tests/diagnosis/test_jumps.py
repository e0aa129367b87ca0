"""An axis that moves in jumps of a few samples, as a valve with stiction does."""

import numpy as np
import pytest
from diagnosis_cases import among

import dryfric_control as dfc
from dryfric_control.diagnosis.problem import Problem
from dryfric_control.diagnosis.search import Search
from dryfric_control.estimation.likelihood import prepare
from dryfric_control.estimation.smoothed_motion import SmoothedMotion
from dryfric_control.records.motion import breakaways

DT = 0.02


def valve(seconds=60.0, mass=20.0, viscous=400.0, level=120.0, stiction=180.0, narrow=0.002):
    """Record of a preloaded spring of 3 kN/m, 20 mm from its rest, in steps of 50 us."""
    h = 5e-5
    t = DT * np.arange(round(seconds / DT))
    wanted = 0.008 * np.sin(0.5 * t) + 0.006 * np.sin(0.83 * t + 1.0) - 0.006 * np.sin(1.0)
    u, x_read = np.empty(t.size), np.empty(t.size)
    x = v = 0.0
    for k in range(t.size):
        x_read[k] = 1e-5 * np.round(1e5 * x)
        u[k] = 4e4 * (wanted[k] - x_read[k])
        for _ in range(round(DT / h)):
            force = u[k] - 3000.0 * (x - 0.02) - viscous * v
            if v == 0.0 and abs(force) <= stiction:
                break
            way = np.sign(v) if v != 0.0 else np.sign(force)
            friction = level + (stiction - level) * np.exp(-((v / narrow) ** 2))
            after = v + h / mass * (force - way * friction)
            v = 0.0 if after * v < 0.0 else after
            x += h * v
    return dfc.Record(t, u, x_read, quantum=1e-5)


@pytest.fixture(scope="module")
def record():
    return valve()


def test_breakaways_show_level_and_spring(record):
    starts, ways = breakaways(record)
    assert starts.size > 20
    columns = np.column_stack((ways, np.ones(starts.size), record.x[starts]))
    # The drive between two samples: it has just passed the level.
    drive = 0.5 * (record.u[starts] + record.u[starts - 1])
    level, preload, stiffness = np.linalg.lstsq(columns, drive, rcond=None)[0]
    # Half of what the drive changes by in a sample is 4 N.
    assert level == pytest.approx(180.0, abs=4.0)
    assert preload == pytest.approx(-60.0, abs=4.0)
    assert stiffness == pytest.approx(3000.0, rel=0.1)


def test_the_force_is_read_at_breakaways_where_slips_end_within_the_kernel(record):
    jumps = SmoothedMotion.where_force_shows(record, 20.0)
    assert jumps.in_jumps
    np.testing.assert_array_equal(jumps.places, breakaways(record)[0])
    assert not np.any(jumps.v[jumps.places])
    t = 1e-3 * np.arange(4000)
    slides = dfc.Record(t, np.sin(6.0 * t), 0.01 * np.sin(6.0 * t), quantum=1e-6)
    assert not SmoothedMotion.where_force_shows(slides, 2.0).in_jumps


def with_spring(stiffness):
    peak, spring = dfc.Stribeck(0.5, 0.002), dfc.effects.Spring(stiffness, 0.02)
    return dfc.FrictionAxis(20.0, 400.0, 120.0, stribeck=peak, effects=(spring,))


@pytest.mark.parametrize("stiffness", [2400.0, 3600.0, 4500.0])
def test_wrong_nominal_values_are_those_that_the_force_shows(record, stiffness):
    # From the nominal ones alone a fit ends beside a large random force: 1530 N/m for 4500.
    problem = Problem(with_spring(stiffness), (prepare(record[:1500]),))
    model, _ = Search(problem).by_force()
    assert not model.causes
    assert model.fit.axis.named_effects()["spring"].stiffness == pytest.approx(3000.0, rel=0.02)


@pytest.mark.slow
def test_a_nominal_spring_that_is_half_too_stiff_is_found(record):
    with among("spring", "stribeck", "bias_force", "load_dependence", "cogging"):
        found = dfc.diagnose(with_spring(4500.0), record[:1500], jobs=1, progress=False)
    assert found.causes[0].effect == "spring"
    assert found.extended.named_effects()["spring"].stiffness == pytest.approx(3000.0, rel=0.02)


@pytest.mark.slow
def test_spring_and_stiction_of_a_valve_are_found(record):
    axis = dfc.FrictionAxis(mass=20.0, viscous=300.0, coulomb=100.0)
    with among("spring", "stribeck", "bias_force", "load_dependence", "cogging"):
        found = dfc.diagnose(axis, record, jobs=1, progress=False)
    assert {cause.effect for cause in found.causes} >= {"spring", "stribeck"}, str(found)
    assert found.extended.mass < 40.0
    # At rest 180 N: what it takes to break away.
    coulomb, peak = found.extended.coulomb.mean, found.extended.stribeck
    assert coulomb * (1.0 + peak.excess) == pytest.approx(180.0, rel=0.1)
