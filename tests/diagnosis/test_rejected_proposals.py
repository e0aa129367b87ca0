"""A joined proposal of which one cause is rejected goes on without it."""

from types import SimpleNamespace

import numpy as np

import dryfric_control as dfc
from dryfric_control.diagnosis import looks
from dryfric_control.diagnosis.gram import Proposal
from dryfric_control.diagnosis.problem import Problem
from dryfric_control.estimation.likelihood import prepare

AXIS = dfc.FrictionAxis(mass=1.0, viscous=2.0, coulomb=3.0)
PLAY, SPRING = dfc.effects.Backlash(1e-3, 0.5), dfc.effects.Spring(stiffness=1.0, rest=0.0)


def test_what_is_left_of_a_joined_proposal_is_fitted(monkeypatch):
    t = 2e-3 * np.arange(1000)
    record = dfc.Record(t, np.sin(9.0 * t), 0.1 * np.sin(9.0 * t))
    problem = Problem(AXIS, (prepare(record),))
    fits = looks.ProposalFits(problem, problem.fit(AXIS, turns=0), {}, print)
    free = ("backlash.gap", "backlash.load_fraction", "spring.stiffness", "spring.rest")
    both = AXIS.replace(effects=(PLAY, SPRING))
    one = Proposal(("backlash", "spring"), both, free, 0.0, 0.0)
    look = looks.PartialFit(one, SimpleNamespace(axis=both, cost=-1.0), 0.0, (0.0, 0.0))
    rejected = {"spring"}

    def reason(problem, fit, name, own):
        return "ended at a bound" if name in rejected else ""

    monkeypatch.setattr(looks, "rejection_reason", reason)
    monkeypatch.setattr(looks.ProposalFits, "_first_fits", lambda self, some, proposals: some)
    (rest,) = fits._without_rejected(look, [one])
    assert rest.names == ("backlash",) and rest.free == free[:2]
    assert rest.axis.effects == (PLAY,)
    rejected.add("backlash")
    assert fits._without_rejected(look, [one]) == []
    rejected.clear()
    assert fits._without_rejected(look, [one]) == []
