"""Searches that are cut off, and candidates that fail."""

from dataclasses import dataclass

import numpy as np
import pytest
from diagnosis_cases import among, believed, causes, record
from truth import make_case

import dryfric_control as dfc

DT = 1e-3
AXIS = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)


def sprung(seconds=3.0):
    """A record of an axis with a spring that nobody believes in."""
    machine = AXIS.replace(effects=(dfc.effects.Spring(stiffness=40.0, rest=0.05),))
    t = DT * np.arange(round(seconds / DT))
    u = 20.0 * np.sin(6.0 * t) + 12.0 * np.sin(17.0 * t + 1.0)
    return dfc.Record(t, u, 1e-6 * np.round(1e6 * machine.simulate(u, dt=DT).y[0]))


@pytest.mark.parametrize("limit", [1e-3, 0.3])
def test_a_search_that_was_cut_off_says_so(limit):
    with among("spring"):
        found = dfc.diagnose(AXIS, sprung(), jobs=1, time_limit=limit)
    assert found.verdict == "not finished"
    assert found.next_experiment is None
    assert any("time limit" in message for message in found.messages)
    # What is there can be used, and nothing that has not been compared is a cause.
    assert set(causes(found)) <= {"spring", "inertia", "viscous", "coulomb"}
    assert np.isfinite(found.gain.after)
    assert found.to_dict()["verdict"] == "not finished"


@pytest.mark.parametrize("where", ["cause 2", "all data", "replays", "next experiment"])
def test_an_interrupt_returns_the_best_answer_so_far(where):
    stopped = []

    def stop(step, so_far):
        if step == where and not stopped:
            stopped.append(step)
            raise KeyboardInterrupt

    with among("spring"):
        found = dfc.diagnose(AXIS, sprung(), jobs=1, on_update=stop)
    assert found.verdict == "not finished"
    assert causes(found) == ["spring"]
    assert any(message.startswith("interrupted") for message in found.messages)


def test_steps_are_told_with_the_causes_so_far():
    told = []
    with among("spring"):
        found = dfc.diagnose(AXIS, sprung(), jobs=1, on_update=lambda *args: told.append(args))
    assert causes(found) == ["spring"]
    assert told[0] == ("base parameters", ())
    assert ("all data", ("spring",)) in told
    assert [len(args[1]) for args in told] == sorted(len(args[1]) for args in told)


def bad_law(t, x, v, u, level, direction, rest, p):
    return p[0] * np.nan


@dataclass(frozen=True)
class Nowhere(dfc.effects.Effect):
    """A force that is no number."""

    size: float = dfc.effects.parameter("N", "size", bounds=(0.0, np.inf))

    slug = "nowhere"
    title = "nowhere"
    action = "force"
    explanation = "A mistake of the user's."
    experiment = "None."
    law = staticmethod(bad_law)


@dataclass(frozen=True)
class Raises(Nowhere):
    """An effect whose shapes cannot be computed."""

    slug = "raises"
    title = "raises"

    @classmethod
    def columns(cls, view):
        raise ValueError("no shape of it suits this record")


def test_a_candidate_that_fails_is_listed_and_ends_nothing():
    with among("spring"):
        dfc.effects.register_effect(Nowhere)
        dfc.effects.register_effect(Raises)
        found = dfc.diagnose(AXIS, sprung(), jobs=1)
    assert (causes(found), found.verdict) == (["spring"], "explained"), str(found)
    assert found.not_tried["raises"] == "no shape of it suits this record"
    assert found.to_dict()["not_tried"] == found.not_tried


def test_the_time_limit_is_kept():
    """By the clock of the search: a limit that has passed begins no further fit."""
    case = make_case("spring", 0, "short")
    steps = []
    found = dfc.diagnose(
        believed(case), record(case), jobs=1, time_limit=1e-3,
        on_update=lambda step, so_far: steps.append(step),
    )  # fmt: skip
    assert found.verdict == "not finished"
    assert "first cause" not in steps
