"""One cause that leaves nothing ends the search: nothing with a memory is looked for beside it."""

import numpy as np

import dryfric_control as dfc
from dryfric_control.diagnosis.gram import Gram


def test_no_shape_with_a_memory_is_tried_where_a_force_leaves_nothing(monkeypatch):
    def simulate(self):
        raise AssertionError("a pass for a shape with a memory")

    monkeypatch.setattr(Gram, "simulate", simulate)
    axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    machine = axis.replace(stribeck=dfc.Stribeck(excess=0.4, speed=0.03))
    t = 2e-3 * np.arange(3000)
    u = 20.0 * np.sin(6.0 * t) + 12.0 * np.sin(17.0 * t + 1.0)
    x = 1e-6 * np.round(1e6 * machine.simulate(u, dt=2e-3).y[0])
    d = dfc.diagnose(axis, dfc.Record(t, u, x), progress=False)
    assert d.verdict == "explained"
    assert [cause.effect for cause in d.causes] == ["stribeck"]
