"""First guesses where there is nothing to guess from."""

import numpy as np
import pytest

import dryfric_control as dfc
from dryfric_control.diagnosis.candidates import catalogue, guesses
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
