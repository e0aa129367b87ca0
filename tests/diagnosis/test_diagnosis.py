"""The diagnosis as a whole; `test_hidden_effects` has a record of every effect."""

import sys
from types import SimpleNamespace

import numpy as np
import pytest
from diagnosis_cases import among, believed, causes, foreign, record
from truth import make_null

import dryfric_control as dfc
from dryfric_control.diagnosis.diagnose import diagnose

DT = 1e-3


@pytest.mark.slow
def test_slightly_wrong_parameters_are_mended_and_nothing_else_is_accused():
    case = make_null(0, "off")
    found = diagnose(believed(case), record(case), jobs=1)
    assert not foreign(causes(found)), str(found)
    for name in ("mass", "viscous"):
        # Believed up to 3 % wrong; what is left is a tenth of that.
        assert getattr(found.extended, name) == pytest.approx(case.actual[name], rel=3e-3)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("shell", "progress", "shown"),
    [(None, None, False), ("imported", None, False), ("running", None, True), (None, True, True)],
)
def test_it_keeps_silent_unless_asked_or_in_a_notebook(capfd, monkeypatch, shell, progress, shown):
    module = SimpleNamespace(get_ipython=lambda: shell if shell == "running" else None)
    monkeypatch.setitem(sys.modules, "IPython", module if shell else None)
    case = make_null(0, "short")
    with among("bias_force"):
        diagnose(believed(case), record(case), jobs=1, progress=progress)
    told = capfd.readouterr()
    assert told.out == "" and bool(told.err) == ("diagnose" in told.err) == shown


AXIS = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)


def test_a_record_without_motion_is_refused():
    rng = np.random.default_rng(0)
    t = DT * np.arange(5000)
    still = dfc.Record(t, np.sin(t), 0.1 + 1e-6 * rng.integers(0, 2, t.size))
    with pytest.raises(ValueError, match="hardly moves"):
        diagnose(AXIS, still)
