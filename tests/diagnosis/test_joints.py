"""Joints are diagnosed each as it would be alone, resumable, with a table of what was found."""

import json
import re

import numpy as np
import pytest
from diagnosis_cases import among

import dryfric_control as dfc
from dryfric_control.__main__ import main
from dryfric_control.diagnosis import joints as module

pytestmark = pytest.mark.slow

DT = 2e-3
T = DT * np.arange(4000)
U = 4.0 * np.sin(3.0 * T) + 2.0 * np.sin(11.0 * T)
AXIS = dfc.FrictionAxis(mass=0.3, viscous=0.2, coulomb=1.5, units=("rad", "N m"))
MACHINES = {
    "elbow": AXIS.replace(coulomb=1.8),
    "wrist": AXIS.replace(effects=(dfc.effects.BiasForce(0.3),)),
}


def log():
    """One table with columns of each joint."""
    columns = {"time": T}
    for name, machine in MACHINES.items():
        columns[f"{name}.effort"] = U
        columns[f"{name}.position"] = 1e-5 * np.round(1e5 * machine.simulate(U, dt=DT).y[0])
    return columns


@pytest.fixture(scope="module")
def cases():
    return {name: (AXIS, dfc.read_record(log(), joint=name)) for name in MACHINES}


@pytest.fixture(autouse=True)
def few():
    with among("bias_force", "stribeck"):
        yield


def test_joints_are_diagnosed_each_as_alone(cases, tmp_path, monkeypatch):
    store = tmp_path / "joints.jsonl"
    first = dfc.diagnose_joints({"elbow": cases["elbow"]}, store=store, progress=False)
    found = dfc.diagnose_joints(cases, store=store, progress=False)
    assert list(found) == ["elbow", "wrist"] and len(store.read_text().splitlines()) == 3
    assert first["elbow"].to_dict() == found["elbow"].to_dict()
    for name, (axis, record) in cases.items():
        alone = dfc.diagnose(axis, record, jobs=1, progress=False)
        assert json.dumps(found[name].to_dict()) == json.dumps(alone.to_dict())
        np.testing.assert_array_equal(found[name].record.x, record.x)
    assert [c.effect for c in found["elbow"].causes] == ["coulomb"]
    assert [c.effect for c in found["wrist"].causes] == ["bias_force"]

    asked = []
    monkeypatch.setattr(module, "_diagnose_joint", lambda options, case: asked.append(case))
    again = dfc.diagnose_joints(cases, store=store, progress=False)
    assert asked == [] and again.summary() == found.summary()
    # Another nominal axis is another case.
    other = {"elbow": (AXIS.replace(mass=0.31), cases["elbow"][1])}
    dfc.diagnose_joints(other, store=store, progress=False)
    assert len(asked) == 1
    with pytest.raises(ValueError, match="other settings: known is"):
        dfc.diagnose_joints(cases, store=store, known=("mass",), progress=False)


def test_the_table_has_parameters_with_errors(cases):
    found = dfc.diagnose_joints(cases, known=("mass",), progress=False)
    for name, machine in MACHINES.items():
        parameters = found.parameters(name)
        assert parameters["mass"] == (0.3, None, "kg m^2")
        level, error, unit = parameters["coulomb"]
        assert unit == "N m" and 0.0 < error < 0.02
        assert level == pytest.approx(machine.coulomb.mean, abs=max(4.0 * error, 1e-3))
        assert name in found.summary()
    force, error, unit = found.parameters("wrist")["bias_force.force"]
    assert unit == "N m" and force == pytest.approx(0.3, abs=max(4.0 * error, 1e-3))
    with pytest.raises(ValueError, match="joint 'knee' is not there"):
        found.parameters("knee")


def still():
    """A joint that moves by one increment, once: nothing of it can be determined."""
    x = np.zeros(T.size)
    x[100] = 1e-5
    return dfc.Record(T, np.zeros(T.size), x, units={"x": "rad", "u": "N m"})


def test_a_joint_that_cannot_be_diagnosed_ends_no_other(cases):
    bad = {"gripper": (AXIS, still()), "knee": (AXIS, cases["elbow"][1].window(0.0, 0.2))}
    found = dfc.diagnose_joints({**bad, "elbow": cases["elbow"]}, window=0.3, progress=False)
    assert list(found) == ["elbow"] and [c.effect for c in found["elbow"].causes] == ["coulomb"]
    assert "hardly moves" in found.failed["gripper"] and "window" in found.failed["knee"]
    assert re.search("gripper +not diagnosed", found.summary())
    assert found.to_dict()["gripper"]["reason"] == found.failed["gripper"]
    with pytest.raises(KeyError, match="gripper.*hardly moves"):
        found["gripper"]


def test_joints_none_of_which_can_be_diagnosed_are_refused():
    with pytest.raises(ValueError, match="hardly moves"):
        dfc.diagnose_joints({"gripper": (AXIS, still())}, progress=False)


def test_one_bad_record_ends_no_other_of_a_batch(cases):
    records = {"still": still(), "elbow": cases["elbow"][1]}
    found = dfc.diagnose_batch(AXIS, records, progress=False)
    assert found["still"]["verdict"] == "not diagnosed" and "hardly" in found["still"]["reason"]
    assert found["elbow"]["verdict"] == "explained"


def test_one_command_from_a_log_to_the_model(tmp_path, capsys, monkeypatch):
    table = log()
    rows = np.column_stack([*table.values()])
    np.savetxt(tmp_path / "run.csv", rows, delimiter=",", header=",".join(table), comments="")
    text = "".join(
        f"[{name}]\nmass = 0.3\nviscous = 0.2\ncoulomb = 1.5\nunits = ['rad', 'N m']\n"
        for name in MACHINES
    )
    (tmp_path / "axes.toml").write_text(text)
    body = '<body><joint name="{}"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body>'
    model = "".join(map(body.format, MACHINES))
    (tmp_path / "arm.xml").write_text(f"<mujoco><worldbody>{model}</worldbody></mujoco>")
    monkeypatch.chdir(tmp_path)
    command = ["joints", "run.csv", "--axes", "axes.toml", "--model", "arm.xml", "--jobs", "1"]
    assert main([*command, "--load", "elbow=0.1,wrist=0", "--known", "mass", "--quiet"]) == 0
    said = capsys.readouterr().out
    assert "run.csv, wrist: " in said and "written: arm.xml" in said
    out = tmp_path / "joints"
    joint = '<joint name="([^"]*)"[^>]* frictionloss="([^"]*)"'
    levels = re.findall(joint, (out / "arm.xml").read_text())
    true = {name: machine.coulomb.mean for name, machine in MACHINES.items()}
    assert {name: float(level) for name, level in levels} == pytest.approx(true, rel=1e-2)
    assert all((out / name / "report.html").is_file() for name in MACHINES)
    assert set(json.loads((out / "joints.json").read_text())) == {*MACHINES}
    # A joint that was not used is named, and leaves those that were.
    table["elbow.position"] = np.zeros(T.size)
    rows = np.column_stack([*table.values()])
    np.savetxt(tmp_path / "run.csv", rows, delimiter=",", header=",".join(table), comments="")
    assert main([*command, "--load", "0", "--known", "mass", "--quiet"]) == 1
    told = capsys.readouterr()
    assert re.search("elbow +not diagnosed", told.out) and "not diagnosed: elbow" in told.err
    assert json.loads((out / "joints.json").read_text())["elbow"]["verdict"] == "not diagnosed"
    assert main([*command, "--joints", "elbw"]) == 2
    assert "--joints elbw is not there. Did you mean 'elbow'?" in capsys.readouterr().err
    assert main(["joints", "run.csv", "--model", "arm.urdf"]) == 2
    assert "give --axes" in capsys.readouterr().err


def test_an_effect_that_is_known_to_be_none_is_no_cause(cases):
    wrist = {"wrist": cases["wrist"]}
    found = dfc.diagnose_joints(wrist, known=("bias_force.force",), progress=False)["wrist"]
    assert "bias_force" not in [cause.effect for cause in found.causes]
    with pytest.raises(ValueError, match="'bias_force.width' is no base parameter"):
        dfc.diagnose_joints(wrist, known=("bias_force.width",), progress=False)
