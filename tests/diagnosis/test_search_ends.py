"""Where a search has nothing more to say: it is not made, or not made again."""

from types import SimpleNamespace

import numpy as np

import dryfric_control as dfc
from dryfric_control.diagnosis.gram import Gram
from dryfric_control.diagnosis.search import Search

AXIS = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)


def test_no_shape_with_a_memory_is_tried_where_a_force_leaves_nothing(monkeypatch):
    def simulate(self):
        raise AssertionError("a pass for a shape with a memory")

    monkeypatch.setattr(Gram, "simulate", simulate)
    machine = AXIS.replace(stribeck=dfc.Stribeck(excess=0.4, speed=0.03))
    t = 2e-3 * np.arange(3000)
    u = 20.0 * np.sin(6.0 * t) + 12.0 * np.sin(17.0 * t + 1.0)
    x = 1e-6 * np.round(1e6 * machine.simulate(u, dt=2e-3).y[0])
    d = dfc.diagnose(AXIS, dfc.Record(t, u, x), progress=False)
    assert d.verdict == "explained"
    assert [cause.effect for cause in d.causes] == ["stribeck"]


def test_a_search_from_a_nominal_model_that_is_no_likelier_is_the_same():
    runs = [SimpleNamespace(u=np.zeros(3))]
    problem = SimpleNamespace(runs=runs)
    search = Search(problem)
    nominal = SimpleNamespace(cost=-100.0, problem=problem)
    assert not search.has_begun_at(nominal)  # it began elsewhere, beside causes
    search._rounds[frozenset()] = (nominal, [])
    assert search.has_begun_at(nominal)
    assert not search.has_begun_at(SimpleNamespace(cost=-110.0, problem=problem))
    denoised = SimpleNamespace(runs=[SimpleNamespace(u=np.zeros(3))])
    assert not search.has_begun_at(SimpleNamespace(cost=-100.0, problem=denoised))


def test_a_contact_beside_which_the_motion_stays_hidden_is_no_cause():
    muted, heard = SimpleNamespace(), SimpleNamespace()
    search = Search(SimpleNamespace(is_muted=lambda fit: fit is muted))
    contact = {
        name: SimpleNamespace(names=(name,), fit=muted) for name in ("presliding", "cogging")
    }
    assert search._stays_muted(contact["presliding"])
    assert not search._stays_muted(contact["cogging"])  # a force may be one of several causes
    assert not search._stays_muted(SimpleNamespace(names=("presliding",), fit=heard))
