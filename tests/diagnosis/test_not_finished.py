"""Searches that are cut off, and candidates that fail."""

from dataclasses import dataclass

import numpy as np
import pytest
from diagnosis_cases import among, causes, driven

import dryfric_control as dfc

AXIS = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)


SPRUNG = driven(AXIS.replace(effects=(dfc.effects.Spring(stiffness=40.0, rest=0.05),)))


@pytest.mark.parametrize("limit", [1e-3, 0.3])
def test_a_search_that_was_cut_off_says_so(limit):
    told = []
    with among("spring"):
        found = dfc.diagnose(
            AXIS, SPRUNG, jobs=1, time_limit=limit, on_update=lambda *args: told.append(args)
        )
    # A limit that has passed begins no further fit.
    assert limit > 1e-3 or "first cause" not in dict(told)
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
        found = dfc.diagnose(AXIS, SPRUNG, jobs=1, on_update=stop)
    assert found.verdict == "not finished"
    assert causes(found) == ["spring"]
    assert any(message.startswith("interrupted") for message in found.messages)


def test_steps_are_told_with_the_causes_so_far():
    told = []
    with among("spring"):
        found = dfc.diagnose(AXIS, SPRUNG, jobs=1, on_update=lambda *args: told.append(args))
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
        found = dfc.diagnose(AXIS, SPRUNG, jobs=1)
    assert (causes(found), found.verdict) == (["spring"], "explained"), str(found)
    assert found.not_tried["raises"] == "no shape of it suits this record"
    assert found.to_dict()["not_tried"] == found.not_tried
