"""The diagnosis as a whole, and when it is cut off; `test_hidden_effects` has every effect."""

import math
import sys
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest
from diagnosis_cases import among, believed, causes, driven, foreign, record
from truth import make_case, make_null

import dryfric_control as dfc

AXIS = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
SPRUNG = driven(AXIS.replace(effects=(dfc.effects.Spring(stiffness=40.0, rest=0.05),)))


@pytest.mark.slow
def test_slightly_wrong_parameters_are_mended_and_nothing_else_is_accused():
    case = make_null(0, "off")
    found = dfc.diagnose(believed(case), record(case), jobs=1)
    assert not foreign(causes(found)), str(found)
    for name in ("mass", "viscous"):
        # Believed up to 3 % wrong; what is left is a tenth of that.
        assert getattr(found.extended, name) == pytest.approx(case.actual[name], rel=3e-3)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("shell", "progress", "shown"),
    # A shell without the kernel of a notebook is a terminal, as its stream says.
    [(None, None, False), ("imported", None, False), ("running", None, False), (None, True, True)],
)
def test_it_keeps_silent_unless_asked_or_in_a_terminal(capfd, monkeypatch, shell, progress, shown):
    module = SimpleNamespace(get_ipython=lambda: shell if shell == "running" else None)
    monkeypatch.setitem(sys.modules, "IPython", module if shell else None)
    case = make_null(0, "short")
    with among("bias_force"):
        dfc.diagnose(believed(case), record(case), jobs=1, progress=progress)
    told = capfd.readouterr()
    assert told.out == "" and bool(told.err) == ("diagnose" in told.err) == shown


def test_a_record_without_motion_is_refused():
    t = 1e-3 * np.arange(5000)
    still = dfc.Record(t, np.sin(t), 0.1 + 1e-6 * np.random.default_rng(0).integers(0, 2, t.size))
    with pytest.raises(ValueError, match="hardly moves"):
        dfc.diagnose(AXIS, still)


def test_a_record_below_breakaway_is_refused_whatever_the_noise_of_its_readings():
    # The noise moves readings from window to window, but no sample slides.
    t = 1e-3 * np.arange(6000)
    noise = 2e-6 * np.random.default_rng(0).standard_normal(t.size)
    held = dfc.Record(t, 0.9 * AXIS.coulomb.mean * np.sin(t), 0.1 + noise)
    with pytest.raises(ValueError, match="hardly moves"):
        dfc.diagnose(AXIS, held)


def test_friction_is_diagnosed_from_a_coast_down_for_the_mass_that_is_known():
    machine = AXIS.replace(viscous=20.0, coulomb=6.0)
    x = 1e-6 * np.round(1e6 * machine.simulate(np.zeros(3000), dt=1e-3, v0=4.0).y[0])
    record = dfc.Record(1e-3 * np.arange(3000), None, x)
    d = dfc.diagnose(AXIS, record, jobs=1)
    assert d.verdict == "explained" and {*causes(d)} == {"viscous", "coulomb"}
    assert d.extended.mass == AXIS.mass and "ratios to the mass" in d.messages[0]
    # Of a record that a micrometre resolves in a thousand steps.
    assert d.extended.viscous == pytest.approx(20.0, rel=1e-3)
    assert d.extended.coulomb.mean == pytest.approx(6.0, rel=1e-3)
    with pytest.raises(ValueError, match="no drive that shows the largest.*limits="):
        dfc.next_experiment(AXIS, [machine], record)


def test_readings_that_were_left_out_are_listed_and_told():
    sound = driven(AXIS, 6.0)
    x = sound.x.copy()
    x[[700, 2900]] += 0.01
    with pytest.warns(dfc.RecordWarning, match="masked"):
        d = dfc.diagnose(AXIS, dfc.Record(sound.t, sound.u, x))
    (masked,) = d.masked
    assert masked.indices.tolist() == [700, 2900]
    assert masked.reasons == ("jump", "jump")
    assert d.verdict == "nothing to find"
    assert "left out: 2 jump" in d.summary()
    assert d.to_dict()["masked"] == [{"indices": [700, 2900], "reasons": ["jump", "jump"]}]


@dataclass(frozen=True)
class Film(dfc.effects.Effect):
    """Friction that a film lowers at rest, as a user writes it."""

    lost: float = dfc.effects.parameter("1", "share missing at rest", bounds=(0.0, 0.95))
    speed: float = dfc.effects.parameter("m/s", "velocity over which it rises", bounds=(1e-3, 9.0))

    slug = title = "film"
    action = "friction"
    explanation = "A film of grease."
    experiment = "Crawl ever more slowly."

    @staticmethod
    def law(t, x, v, u, level, direction, rest, p):
        return -level * p[0] * (1.0 - math.tanh(abs(v) / p[1]))


@pytest.mark.slow
def test_an_effect_of_the_user_is_found_like_any_other_from_any_start():
    case = make_case("velocity_strengthening", 2, "short")
    true = case.truth["velocity_strengthening"]
    with among("quadratic_drag", "viscous_asymmetry", "stribeck"):
        dfc.effects.register_effect(Film)
        found = dfc.diagnose(believed(case), record(case), jobs=1)
    assert causes(found) == ["film"], str(found)
    assert found.causes[0].parameters["lost"] == pytest.approx(true["deficit"], rel=0.02)
    assert found.causes[0].parameters["speed"] == pytest.approx(true["speed"], rel=0.02)


# -- searches that are cut off, and candidates that fail ---------------------------------


@pytest.mark.parametrize("limit", [1e-3, 0.3])
def test_a_search_that_was_cut_off_says_so(limit):
    told = []
    with among("spring"):
        found = dfc.diagnose(
            AXIS, SPRUNG, jobs=1, time_limit=limit, on_update=lambda *args: told.append(args)
        )
    # A limit that has passed begins no further fit.
    assert limit > 1e-3 or "first cause" not in dict(told)
    assert found.verdict == found.to_dict()["verdict"] == "not finished"
    assert found.next_experiment is None
    assert any("time limit" in message for message in found.messages)
    # What is there can be used, and nothing that has not been compared is a cause.
    assert set(causes(found)) <= {"spring", "inertia", "viscous", "coulomb"}
    assert np.isfinite(found.gain.after)


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


@dataclass(frozen=True)
class Nowhere(dfc.effects.Effect):
    """A force that is no number."""

    size: float = dfc.effects.parameter("N", "size", bounds=(0.0, np.inf))

    slug = title = "nowhere"
    action = "force"
    explanation = "A mistake of the user's."
    experiment = "None."

    @staticmethod
    def law(t, x, v, u, level, direction, rest, p):
        return p[0] * np.nan


@dataclass(frozen=True)
class Raises(Nowhere):
    """An effect whose shapes cannot be computed."""

    slug = title = "raises"

    @classmethod
    def columns(cls, view):
        raise ValueError("no shape of it suits this record")


def test_steps_are_told_and_a_candidate_that_fails_is_listed_and_ends_nothing():
    told = []
    with among("spring"):
        dfc.effects.register_effect(Nowhere)
        dfc.effects.register_effect(Raises)
        found = dfc.diagnose(AXIS, SPRUNG, jobs=1, on_update=lambda *args: told.append(args))
    assert (causes(found), found.verdict) == (["spring"], "explained"), str(found)
    assert found.not_tried["raises"] == "no shape of it suits this record"
    assert found.to_dict()["not_tried"] == found.not_tried
    # Each step with the causes so far.
    assert told[0] == ("base parameters", ())
    assert ("all data", ("spring",)) in told
    assert [len(args[1]) for args in told] == sorted(len(args[1]) for args in told)
