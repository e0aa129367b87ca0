"""What is no cause, and a joined proposal of which one is rejected: it goes on without that."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np

import dryfric_control as dfc
from dryfric_control.diagnosis import looks
from dryfric_control.diagnosis.gram import Proposal
from dryfric_control.diagnosis.invariants import _is_like_another
from dryfric_control.diagnosis.problem import Problem
from dryfric_control.diagnosis.search import _first_effects
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


def test_a_sine_at_a_far_larger_line_of_the_drive_may_be_of_any_law_of_the_motion():
    t = 2e-3 * np.arange(5000)
    sine = dfc.effects.TimePeriodic(amplitude=1.0, frequency=2.0)
    drive = np.sin(2.0 * np.pi * 2.0 * t)
    assert not sine.told_from_drive(5.0 * drive, 2e-3)
    assert sine.told_from_drive(1.5 * drive, 2e-3)  # as large as a loop answers it
    assert sine.told_from_drive(50.0 * np.sin(2.0 * np.pi * 3.0 * t), 2e-3)
    assert sine.told_from_drive(np.zeros(5000), 2e-3)
    assert sine.told_from_drive(5.0 * drive[:2000], 2e-3)  # 8 periods: a line of 1 Hz


def test_two_of_a_kind_without_a_beat_in_the_record_are_one():
    t = 2e-3 * np.arange(5000)  # 10 s
    record = dfc.Record(t, np.sin(9.0 * t), 0.1 * np.sin(9.0 * t))

    def alike(*effects, name):
        return _is_like_another(AXIS.replace(effects=effects), name, [record])

    sine, cogs = dfc.effects.TimePeriodic, dfc.effects.Cogging
    assert alike(sine(1.0, 2.0), sine(1.0, 2.05), name="time_periodic_2")
    assert not alike(sine(1.0, 2.0), sine(1.0, 2.05), name="time_periodic")  # the first stays
    assert not alike(sine(1.0, 2.0), sine(1.0, 2.2), name="time_periodic_2")
    assert alike(cogs(1.0, 0.05), cogs(1.0, 0.055), name="cogging_2")  # over 0.2 m
    assert not alike(cogs(1.0, 0.05), cogs(1.0, 0.08), name="cogging_2")
    assert not alike(cogs(1.0, 0.05), SPRING, name="spring")


def test_a_gap_far_below_what_its_ends_give_way_by_is_no_play():
    ends = dfc.effects.Backlash(1e-4, 0.5, compliance=1e-4, damping=1.0)  # 0.3 mm under 3 N
    assert ends.plausible(AXIS) and PLAY.plausible(AXIS)
    assert not replace(ends, gap=1e-5).plausible(AXIS)


def test_all_forms_of_the_first_effects_are_proposed():
    def start(*names, cost):
        return Proposal(names, AXIS, (), cost, 0.0)

    some = [
        start("presliding", cost=-9.0), start("presliding", cost=-8.0),
        start("presliding", "spring", cost=-7.0), start("spring", cost=-6.0),
        start("presliding", cost=5.0),
    ]  # fmt: skip
    assert _first_effects(some, 2) == [*some[:3], some[4]]
