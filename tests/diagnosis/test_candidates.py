"""First guesses where there is nothing to guess from."""

import numpy as np
import pytest

import dryfric_control as dfc
from dryfric_control.diagnosis.candidates import catalogue, guesses, placed
from dryfric_control.estimation.force_residual import View

AXIS = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)


@pytest.mark.filterwarnings("ignore::dryfric_control.RecordWarning")
@pytest.mark.parametrize("name", catalogue(AXIS))
def test_a_record_without_sliding_gives_no_guesses(name):
    """It used to end in a quantile of nothing."""
    t = 1e-3 * np.arange(400)
    x = np.where(np.arange(400) % 40 < 20, 0.0, 1e-6)
    view = View(AXIS, dfc.Record(t, 4.0 * np.sin(9.0 * t), x, quantum=1e-6))
    assert view.v.size == 0
    assert list(guesses(name, view)) == []


@pytest.mark.parametrize(
    ("name", "values", "expected"),
    [
        ("spring", {"spring.stiffness": 3.0, "spring.rest": 0.109}, True),
        ("spring", {"spring.stiffness": 3.0, "spring.rest": 0.111}, False),
        ("spring", {"spring.stiffness": 3.0, "spring.rest": -0.02}, False),
        ("input_delay", {"input_delay.delay": 3e-5}, True),
        ("input_delay", {"input_delay.delay": 1e-5}, False),
        ("stribeck", {"stribeck.excess": 0.3, "stribeck.speed": 0.44}, True),
        ("stribeck_asymmetry", {"stribeck_asymmetry.speed": 0.47}, False),
        ("cogging_2", {"cogging_2.amplitude": 9.0, "cogging_2.phase": 50.0}, True),
        ("dwell_time", {"dwell_time.rise": 0.1, "dwell_time.time_constant": 1.1e-3}, True),
        ("dwell_time", {"dwell_time.rise": 0.1, "dwell_time.time_constant": 0.9e-3}, False),
        ("backlash", {"backlash.gap": 1.1e-6, "backlash.load_fraction": 0.5}, True),
        ("backlash", {"backlash.gap": 0.9e-6, "backlash.load_fraction": 0.5}, False),
    ],
)
def test_a_cause_acts_where_the_machine_has_been_and_as_the_record_can_show(name, values, expected):
    t = 1e-3 * np.arange(400)
    x = np.linspace(0.0, 0.06, 400)
    records = [dfc.Record(t, np.sin(t), one, quantum=1e-5) for one in (x, x + 0.04)]
    assert placed(name, values, records) is expected


@pytest.mark.parametrize(
    ("units", "way", "tried"),
    [(("m", "N"), 0.4, False), (("m", "N"), 0.8, True), (("rad", "N m"), 0.4, True)],
)
def test_gravity_is_tried_where_a_position_may_be_an_angle(units, way, tried):
    axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0, units=units)
    t = 1e-3 * np.arange(4000)
    x = 0.5 * way * np.sin(3.0 * t)
    view = View(axis, dfc.Record(t, 10.0 * np.cos(3.0 * t), x, quantum=1e-6))
    assert bool(list(guesses("gravity", view))) is tried
