"""A whole arm is diagnosed: one bad joint does not end the others, and the command writes it all."""

import importlib
import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from diagnosis_cases import among

import dryfric_control as dfc
from dryfric_control.__main__ import main
from dryfric_control.diagnosis.joints import JointDiagnoses

mujoco = pytest.importorskip("mujoco")

# The package has the function under the name of its module.
module = importlib.import_module("dryfric_control.arm.diagnose_arm")

DATA = Path(__file__).parents[2] / "docs" / "data"


def test_a_bad_joint_does_not_end_the_others(monkeypatch):
    failed = {"lift": "the axis does not move", "wrist3": "the axis does not move"}

    def joints(cases, **options):
        # All joints have shown what gravity and the scale of a drive are; the latter only if asked.
        assert options["known"] == ("mass", "gravity.amplitude", "gravity.phase")
        assert options["load_errors"] is None  # the model is right
        return JointDiagnoses({name: None for name in cases if name not in failed}, failed)

    monkeypatch.setattr(module, "diagnose_joints", joints)
    log = DATA / "six_joints.csv"
    found = dfc.diagnose_arm(
        DATA / "six_joints.xml", log, known=("model", "mass"), progress=False
    )  # fmt: skip
    assert list(found) == ["pan", "elbow", "wrist1", "wrist2"]
    assert found.failed == failed and found.model_errors == ()
    monkeypatch.setattr(module, "diagnose_joints", lambda *_, **__: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        dfc.diagnose_arm(DATA / "six_joints.xml", log, known="model", progress=False)


def test_joints_may_have_another_load_as_far_as_the_log_leaves_it_open(monkeypatch):
    given = {}

    def joints(cases, **options):
        given.update(options["load_errors"])
        return JointDiagnoses({}, {})

    monkeypatch.setattr(module, "diagnose_joints", joints)
    found = dfc.diagnose_arm(DATA / "six_joints.xml", DATA / "six_joints.csv", progress=False)
    sizes = {joint: np.sqrt(np.mean(np.square(one), axis=1)) for joint, one in given.items()}
    assert list(given) == list(found.corrected)
    # The lift carries the arm, wrist 3 the payload alone.
    assert all(np.all(np.diff(one) <= 0.0) for one in sizes.values())
    assert sizes["lift"][0] > 10.0 * sizes["wrist3"][0] > 0.0
    assert found.undirected == () and found.to_dict()["undirected"] == []


def test_the_direction_of_a_joint_whose_load_is_within_the_noise_is_not_shown(monkeypatch):
    monkeypatch.setattr(module, "diagnose_joints", lambda *_, **__: JointDiagnoses({}, {}))
    log = dict(pd.read_csv(DATA / "six_joints.csv").items())
    # The tool of wrist 3 is near its axis: which way it turns matters by some mN m.
    noise = 0.05 * np.random.default_rng(1).standard_normal(len(log["wrist3.effort"]))  # [N m]
    log["wrist3.effort"] = log["wrist3.effort"] + noise
    found = dfc.diagnose_arm(DATA / "six_joints.xml", log, progress=False)
    assert found.undirected == ("wrist3",) and found.to_dict()["undirected"] == ["wrist3"]
    assert "does not show the direction of wrist3" in found.summary()


ARM = """<mujoco><option timestep="2e-4" integrator="implicitfast" noslip_iterations="4"/><worldbody>
<body name="link"><joint name="swing" axis="0 1 0" armature="0.1" {0}/>
<inertial pos="0.2 0 0" mass="1.5" diaginertia="0.01 0.02 0.02"/></body></worldbody></mujoco>
"""
LEVEL, VISCOUS = 1.2, 0.5


def write_log(path):
    """A pendulum under a torque, by MuJoCo, whose friction the model does not know."""
    hard = 'solreffriction="0.0008 1" solimpfriction="0.999 0.9999 0.001"'
    model = mujoco.MjModel.from_xml_string(
        ARM.format(f'frictionloss="{LEVEL}" damping="{VISCOUS}" {hard}')
    )
    data, rows = mujoco.MjData(model), []
    data.qpos[:] = 1.2
    for k in range(5000):
        t = 2e-3 * k
        u = 3.5 * np.sin(2.0 * t) + 2.0 * np.sin(7.0 * t + 1.0)
        rows.append((t, 1e-5 * round(1e5 * data.qpos[0]), u))
        data.qfrc_applied[0] = u
        for _ in range(10):
            mujoco.mj_step(model, data)
    text = "\n".join("{:.3f},{:.5f},{:.5f}".format(*row) for row in rows)
    path.write_text(f"time,swing.position,swing.effort\n{text}\n")


@pytest.mark.slow
def test_the_command_writes_page_reports_and_model(tmp_path, capsys):
    log, model, out = tmp_path / "log.csv", tmp_path / "arm.xml", tmp_path / "out"
    write_log(log)
    model.write_text(ARM.format(""))
    with among("bias_force"):
        code = main(["arm", str(log), "--model", str(model), "--out", str(out), "--jobs", "1"])
    printed = capsys.readouterr()
    assert code == 0, printed.err
    assert "masses of the model: nothing to find" in printed.out
    page = (out / "arm.html").read_text()
    assert "<h2>swing</h2>" in page and "<p><table" not in page and "data:image/png;base64," in page
    written = json.loads((out / "arm.json").read_text())["joints"]
    assert list(written) == ["swing"] and written["swing"]["verdict"] != "not diagnosed"
    assert (out / "swing" / "report.html").is_file()
    joint = mujoco.MjModel.from_xml_path(str(out / "arm.xml")).joint("swing")
    # 2 %: a level and a viscous coefficient from 10 s.
    assert float(joint.frictionloss[0]) == pytest.approx(LEVEL, rel=0.02)
    assert float(np.ravel(joint.damping)[0]) == pytest.approx(VISCOUS, rel=0.02)
