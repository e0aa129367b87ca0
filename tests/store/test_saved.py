"""Fits and diagnoses, saved and read back as they were."""

import dataclasses
import json
from typing import Any

import numpy as np
import pytest

import dryfric_control as dfc
from dryfric_control.diagnosis import Experiment
from dryfric_control.diagnosis.report.findings import Gain, Unexplained
from dryfric_control.store.saved import Saved, write_document

T = 1e-3 * np.arange(3000)
U = 20.0 * np.sin(6.0 * T) + 10.0 * np.sin(17.0 * T)
AXIS = dfc.FrictionAxis(
    mass=2.0, viscous=15.0, coulomb=(8.0, 7.0), stribeck=dfc.Stribeck(0.1, 0.02),
    effects=(dfc.effects.Spring(40.0),), name="z ü", travel=(-1.0, 1.0),
)  # fmt: skip
RECORD = dfc.Record(
    T, U, 1e-6 * np.round(1e6 * AXIS.simulate(U, dt=1e-3).y[0]), units={"x": "m"}, name="run",
    channels={"v": np.cos(T)}, raw={"x": ("counts", 1e-6)},
)  # fmt: skip


@pytest.fixture(scope="module")
def fit():
    return dfc.fit(AXIS, RECORD, free=("mass", "viscous"))


@pytest.fixture(scope="module")
def diagnosis():
    cause = dfc.diagnosis.Cause(
        "spring", "spring", {"stiffness": 40.0}, {"stiffness": np.inf}, {"stiffness": "N/m"}, 1.0,
        (0.5, 1.5), ("gravity",), "e", "x",
    )  # fmt: skip
    plan = Experiment(
        name="steps", title="steps", description="step it", t=T, reference=np.sin(T),
        separates=("gravity",), score={"gravity": 3.0}, tried={"a": 1.0}, cause="spring",
        positions={"spring": T}, drives={"spring": U}, units=("m", "N"),
    )  # fmt: skip
    return dfc.Diagnosis(
        AXIS, RECORD, "explained", (cause,), AXIS, Gain(1e-3, 1e-6, 1e-6, (0.9, 1.1), "m"),
        Unexplained(0.0, False, ()), plan, ("one",), {"": np.inf, "spring": 0.1}, 0.25,
        np.arange(12) % 3,
    )  # fmt: skip


def test_a_fit_comes_back_as_it_was(fit, tmp_path):
    fit.save(tmp_path / "fit.json")
    again = dfc.Fit.load(tmp_path / "fit.json")
    assert again.axis == fit.axis and again.axis.name == fit.axis.name
    assert again.parameters == fit.parameters and again.interval() == fit.interval()
    assert again.summary() == fit.summary()
    assert again.bootstrap(repeats=20) == fit.bootstrap(repeats=20)
    record = again.training[0].windows.record
    assert record == RECORD and record.raw == RECORD.raw and record.quantum == RECORD.quantum
    assert not record.x.flags.writeable
    assert again.replay(RECORD).rms == fit.replay(RECORD).rms


def test_a_diagnosis_comes_back_as_it_was(diagnosis, tmp_path):
    diagnosis.save(tmp_path / "d.json")
    again = dfc.Diagnosis.load(tmp_path / "d.json")
    assert again.summary() == diagnosis.summary() and again.to_dict() == diagnosis.to_dict()
    assert again.record == RECORD and again.scores == diagnosis.scores
    np.testing.assert_array_equal(again.roles, diagnosis.roles)
    np.testing.assert_array_equal(again.next_experiment.drives["spring"], U)


def test_what_was_changed_or_is_something_else_is_refused(fit, diagnosis, tmp_path):
    fit.save(tmp_path / "fit.json")
    diagnosis.save(tmp_path / "d.json")
    with pytest.raises(ValueError, match="is no diagnosis"):
        dfc.Diagnosis.load(tmp_path / "fit.json")
    with pytest.raises(FileNotFoundError, match="Did you mean 'fit.json'"):
        dfc.Fit.load(tmp_path / "fti.json")
    text = (tmp_path / "fit.json").read_text()
    for changed in (
        text.replace('"mass": 2.0', '"mass": 3.0'),
        text[:-40],
        text.replace("zero", "one"),
    ):
        (tmp_path / "fit.json").write_text(changed)
        if changed != text:
            with pytest.raises(ValueError, match=r"fit\.json (was changed|is damaged)"):
                dfc.Fit.load(tmp_path / "fit.json")


def test_a_sealed_file_that_makes_no_sense_is_refused(tmp_path):
    for content in ({"is": "Fit", "fields": {}}, {"is": "os.system"}, {"no": 1}, [1], 3, "x",
                    {"is": "axis", "of": {"mass": -1}}, {"is": "array", "dtype": "O", "shape": [1],
                                                          "values": [None]}):  # fmt: skip
        write_document(tmp_path / "fit.json", "fit", {"content": content})
        with pytest.raises(ValueError, match="is damaged"):
            dfc.Fit.load(tmp_path / "fit.json")


@dataclasses.dataclass(frozen=True)
class Thing(Saved):
    """Anything that a file may hold."""

    value: Any
    _kind = "thing"
    _holds = (Gain,)


def test_what_the_file_cannot_hold_is_named(tmp_path):
    with pytest.raises(ValueError, match="a complex cannot be saved"):
        Thing((1j,)).save(tmp_path / "a.json")
    assert not (tmp_path / "a.json").exists()
    Thing(Gain(1.0, np.inf, np.nan, (0.0, -0.0), "m")).save(tmp_path / "g.json")
    again = Thing.load(tmp_path / "g.json")
    assert repr(again.value) == repr(Gain(1.0, np.inf, np.nan, (0.0, -0.0), "m"))
    assert json.loads((tmp_path / "g.json").read_text())["format"] == "dryfric-control thing"
