"""What records can show of a cause."""

import numpy as np
import pytest

import dryfric_control as dfc
from dryfric_control.diagnosis.candidates import placed


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ({"spring.stiffness": 3.0, "spring.rest": 0.109}, True),
        ({"spring.stiffness": 3.0, "spring.rest": 0.111}, False),
        ({"spring.stiffness": 3.0, "spring.rest": -0.02}, False),
        ({"input_delay.delay": 3e-5}, True),
        ({"input_delay.delay": 1e-5}, False),
        ({"stribeck.excess": 0.3, "stribeck.speed": 0.44}, True),
        ({"stribeck_asymmetry.speed": 0.47}, False),
        ({"cogging_2.amplitude": 9.0, "cogging_2.phase": 50.0}, True),
        ({"dwell_time.rise": 0.1, "dwell_time.time_constant": 1.1e-3}, True),
        ({"dwell_time.rise": 0.1, "dwell_time.time_constant": 0.9e-3}, False),
        ({"backlash.gap": 1.1e-6, "backlash.load_fraction": 0.5}, True),
        ({"backlash.gap": 0.9e-6, "backlash.load_fraction": 0.5}, False),
    ],
)
def test_a_cause_acts_where_the_machine_has_been_and_as_the_record_can_show(values, expected):
    t = 1e-3 * np.arange(400)
    x = np.linspace(0.0, 0.06, 400)
    records = [dfc.Record(t, np.sin(t), one, quantum=1e-5) for one in (x, x + 0.04)]
    assert placed(values, records, None) is expected
