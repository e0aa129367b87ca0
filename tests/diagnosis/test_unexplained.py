"""What no candidate explains is admitted, and chance is not accused."""

import importlib
from types import SimpleNamespace

import pytest
from diagnosis_cases import among, believed, record
from truth import make_outside

from dryfric_control.diagnosis import selection
from dryfric_control.diagnosis.diagnose import diagnose

# The package exports the function under the module's own name.
module = importlib.import_module("dryfric_control.diagnosis.diagnose")

FLAGGED = ("partly explained", "unexplained")
OUTSIDE = [("impacts", 1), ("lost_steps", 3)]


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "seed"), OUTSIDE)
def test_what_no_candidate_explains_is_admitted(kind, seed):
    case = make_outside(seed, "short", kind=kind)
    found = diagnose(believed(case), record(case), jobs=1)
    assert found.verdict in FLAGGED, str(found)
    assert found.unexplained.significant
    assert found.unexplained.where


class OnFitted(module.Race):
    """A race that judges on the very windows it fitted on."""

    def __init__(self, bench, axis, fit, judge, *rest, **options):
        super().__init__(bench, axis, fit, fit, *rest, **options)


def wanders(seed, condition):
    """A friction level that wanders at random, so that nothing may be accused."""
    case = make_outside(seed, condition, kind="wandering_friction")
    with among("position_dependence", "cogging", "drift", "time_periodic", "spring", "stribeck"):
        return diagnose(believed(case), record(case), jobs=1)


@pytest.mark.slow
@pytest.mark.parametrize("judge", ["held out", "fitted"])
def test_without_the_held_out_step_chance_is_accused(monkeypatch, judge):
    """Fits always lower the error they were fitted on; unseen data tell."""
    if judge == "fitted":
        monkeypatch.setattr(module, "Race", OnFitted)
    # One accusation is enough, and so is the step of the free runs: what a random force makes
    # of it is another judge's matter.
    monkeypatch.setattr(selection, "_MOST_CAUSES", 1)
    monkeypatch.setattr(module, "_nothing", lambda *_: True)
    monkeypatch.setattr(module, "_blind", lambda _: False)
    monkeypatch.setattr(module, "answer", lambda *_: SimpleNamespace(verdict="unexplained"))
    found = wanders(1, "short")
    assert found.verdict in FLAGGED
    assert bool(found.causes) == (judge == "fitted"), str(found)
