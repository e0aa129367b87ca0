"""The command line: the demo runs, and tells bad input in one line."""

import json
import os
from pathlib import Path

import pytest

from dryfric_control import demo
from dryfric_control.__main__ import main
from dryfric_control.store.axis_file import read_axis

EMPS = Path(__file__).resolve().parents[2] / "shared" / "data" / "emps" / "DATA_EMPS.mat"


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Folder and summary of one run without a record; `.ci/run` has just made one."""
    folder = Path(os.environ.get("DEMO", tmp_path_factory.mktemp("demo") / "out"))
    assert folder.is_dir() or main(["demo", "--out", str(folder)]) == 0
    return folder, json.loads((folder / "summary.json").read_text())


def test_demo_makes_its_own_record_and_recovers_it(made):
    folder, summary = made
    # The record's own axis: mass 12, levels 9 and 7; the encoder of 2 um leaves 1 %.
    assert summary["parameters"]["mass"] == pytest.approx(12.0, rel=0.01)
    assert summary["coulomb_plus"] == pytest.approx(9.0, rel=0.01)
    assert summary["coulomb_minus"] == pytest.approx(7.0, rel=0.01)
    windows = summary["held_out_windows"]
    assert windows["position_rms_after_m"] < 0.01 * windows["position_rms_before_m"]
    excess = summary["bench"]["stick_slip"]["fit"]["parameters"]["stribeck.excess"]
    # The true excess is 0.3: levels are known to 0.1 %, which is 0.0013 of breakaway over level.
    assert excess == pytest.approx(0.3, abs=0.0013)
    measured, replayed = (summary["bench"]["stick_slip"][k] for k in ("measured", "replayed"))
    # The replayed stick-slip is the measured one within 10 %.
    assert replayed["amplitude"] == pytest.approx(measured["amplitude"], rel=0.1)
    assert replayed["period"] == pytest.approx(measured["period"], rel=0.1)
    assert (folder / demo.SYSTEM.name).read_bytes() == demo.SYSTEM.read_bytes()
    assert not [*folder.glob("*.part")]


def test_demo_ends_with_a_diagnosis_and_its_report(made):
    folder, summary = made
    (cause,) = summary["diagnosis"]["causes"]
    assert summary["diagnosis"]["verdict"] == "explained" and cause["effect"] == "stribeck"
    # The peak that was put in; the encoder leaves less than 1 %.
    assert cause["parameters"]["excess"] == pytest.approx(0.4, rel=0.01)
    assert cause["parameters"]["speed"] == pytest.approx(0.03, rel=0.01)
    assert "explained: Stribeck peak" in (folder / "report.html").read_text(encoding="utf-8")
    assert read_axis(folder / "extended.toml").stribeck is not None


@pytest.mark.skipif(not EMPS.exists(), reason="the EMPS record is not there: ../shared/data/emps")
def test_demo_recovers_the_mass_of_the_emps_record():
    _, summary, figures = demo.fit_and_replay(*demo.measured_record(EMPS))
    # 95.1 kg: Janot, Gautier, Brunot, 2019; within 3 %.
    assert summary["parameters"]["mass"] == pytest.approx(95.1, rel=0.03)
    assert summary["held_out_closed_loop"]["relative_force"] < 0.1
    assert "held_out_closed_loop" in figures
