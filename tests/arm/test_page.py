"""The page on an arm: units as they are printed, and pictures whose numbers can be read."""

import io
from pathlib import Path
from types import SimpleNamespace

import pytest
from matplotlib.figure import Figure

import dryfric_control as dfc
from dryfric_control.arm import report

pytest.importorskip("mujoco")

DATA = Path(__file__).parents[2] / "docs" / "data"


class Found(dict):
    """Diagnoses of joints that found nothing."""

    def __init__(self, records):
        super().__init__(
            {j: SimpleNamespace(extended=axis, record=one) for j, (axis, one) in records.items()}
        )
        self.nominal = self.corrected = records

    def _summary_parts(self):
        yield "elbow: noise of 0.09 N m RMS was recorded with the input"


def test_units_of_the_page_are_as_printed(tmp_path):
    text = report.write_page(Found({}), tmp_path / "arm.html").read_text()
    assert "noise of 0.09 N·m RMS" in text


def test_causes_of_a_joint_are_named_in_words(tmp_path, monkeypatch):
    monkeypatch.setattr(report, "joint_figure", lambda found, joint: "")
    found = Found({"elbow": (dfc.FrictionAxis(inertia=0.3, viscous=0.2, coulomb=1.5), None)})
    found["elbow"].axis = found["elbow"].extended
    found["elbow"].verdict = "explained"
    found["elbow"].causes = (SimpleNamespace(title="bias force", effect="bias_force"),)
    text = report.write_page(found, tmp_path / "arm.html").read_text()
    assert "<p>explained: bias torque</p>" in text


def test_tick_labels_of_a_joint_do_not_run_into_each_other():
    found = Found(dfc.arm_records(DATA / "six_joints.xml", DATA / "six_joints.csv"))
    for joint in found:
        figure = Figure(figsize=report._SIZE, layout="constrained")
        axes = figure.subplots(1, 2, width_ratios=(2, 3))
        report.draw_joint(found, joint, *axes)
        figure.savefig(io.BytesIO(), dpi=report._DPI)
        for one in axes:
            low, high = one.get_xlim()
            boxes = [
                label.get_window_extent()
                for at, label in zip(one.get_xticks(), one.get_xticklabels(), strict=True)
                if low <= at <= high
            ]
            # A gap as wide as a digit.
            assert all(b.x0 - a.x1 > 6.0 for a, b in zip(boxes, boxes[1:], strict=False)), joint
