"""A log that MuJoCo made: records with the coupling, errors of the model, and logs that are wrong."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import dryfric_control as dfc

mujoco = pytest.importorskip("mujoco")


from dryfric_control.arm.error_regression import _halves_of_windows  # noqa: E402
from dryfric_control.arm.model_errors import load_errors  # noqa: E402

DATA = Path(__file__).parents[2] / "docs" / "data"
MODEL, LOG = DATA / "six_joints.xml", DATA / "six_joints.csv"
#: Coulomb level, viscous coefficient and payload with which `docs/make_arm.py` made the log.
TRUE = {
    "pan": (7.0, 9.0), "lift": (8.0, 10.0), "elbow": (5.0, 6.0), "wrist1": (1.8, 1.2),
    "wrist2": (1.6, 1.1), "wrist3": (1.4, 0.9),
}  # fmt: skip
#: Noise of its torques [N m].
NOISE = (0.10, 0.10, 0.06, 0.02, 0.02, 0.02)
PAYLOAD, PLACE = 0.8, (0.0, 0.12, 0.0)


def arm_noise(joint):
    return NOISE[list(TRUE).index(joint)]


@pytest.fixture(scope="module")
def log():
    names = LOG.read_text().split("\n", 1)[0].split(",")
    return dict(zip(names, np.loadtxt(LOG, delimiter=",", skiprows=1).T, strict=True))


@pytest.fixture(scope="module")
def nominal():
    return dfc.arm_records(MODEL, LOG)


@pytest.fixture(scope="module")
def errors(nominal):
    return nominal.model_errors()


def test_a_payload_that_the_model_lacks_is_named_once(errors):
    assert [(one.kind, one.link) for one in errors] == [("payload", "hand")]
    assert errors[0].value == pytest.approx(PAYLOAD, rel=0.02)
    np.testing.assert_allclose(errors[0].place, PLACE, atol=3e-3)  # 2 % of the lever
    assert f"payload {errors[0].value:.3g} ±" in errors[0].sentence


@pytest.fixture(scope="module")
def fits(nominal, errors):
    pairs = nominal.without(errors).items()
    return {joint: dfc.fit(axis, record, starts=1) for joint, (axis, record) in pairs}


def test_without_it_the_friction_is_that_of_each_joint(nominal, errors, fits):
    for joint, (axis, record) in nominal.without(errors).items():
        found = fits[joint]
        level, viscous = TRUE[joint]
        # 1 %: at 100 Hz a breakaway of another joint is smeared over five samples.
        assert found.parameters["coulomb"] == pytest.approx(level, rel=0.01)
        assert found.parameters["viscous"] == pytest.approx(viscous, rel=0.01)
        assert found.parameters["mass"] == pytest.approx(axis.mass, rel=0.01)
        assert "coupling of the model" in record.notes[-1]


def test_the_rotors_of_the_model_are_written_as_they_are(nominal, errors, fits, tmp_path):
    # The mean inertia over the motion is not that of the reference pose: less the latter, the
    # rotor of the pan had no inertia left, and that of the lift half of its own.
    coupled, path = nominal.without(errors), tmp_path / "found.xml"
    written = dfc.to_mjcf(fits, MODEL, load=coupled.body_inertia, out=path)
    there = mujoco.MjModel.from_xml_path(str(MODEL))
    for joint, values in written.values.items():
        # 2 %: the mass of the axis, of which the rotor is a third, within 1 %.
        rotor = float(there.joint(joint).armature[0])
        assert values["armature"] == pytest.approx(rotor, rel=0.02)
        own, simulated = written.free_runs[joint]
        assert simulated < 1.5 * own  # the load of the record acts in MuJoCo, too
    with pytest.raises(ValueError, match=r"load=records\.body_inertia"):
        dfc.to_mjcf(fits, MODEL, out=path)


def test_what_a_load_may_be_off_holds_what_it_is_off(nominal, errors):
    right = nominal.without(errors)
    true = dfc.arm_records(MODEL, LOG, payload={"hand": (PAYLOAD, PLACE)})
    found = load_errors(right)
    assert list(found) == list(right)
    for j, (joint, (_, record)) in enumerate(right.items()):
        a = right.motion.a[:, j]
        rows = np.vstack((found[joint], 0.5 * (a + np.append(a[1:], a[-1:]))))
        off = record.known_load - true[joint][1].known_load
        amounts = np.linalg.lstsq(rows.T, off, rcond=None)[0]
        assert found[joint].shape == (4, len(record))
        assert np.abs(amounts[:4]).max() < 3.0
        # The inertia of the joint is its own; what else is left is a part of the noise of the log.
        left = off - amounts @ rows
        assert np.sqrt(np.mean(left**2)) < 0.02 * arm_noise(joint)


def test_a_known_payload_leaves_nothing_to_find():
    records = dfc.arm_records(MODEL, LOG, payload={"hand": (PAYLOAD, PLACE)})
    assert records.model_errors() == ()
    table = records.summary()
    assert re.match(r"joint +inertia +least +largest", table) and "load RMS" in table
    sliding = records.axes | {"pan": records.axes["pan"].replace(units=("m", "N"))}
    assert "mass or inertia" in replace(records, axes=sliding).summary()
    assert "pan" in table and records.to_dict()["lift"]["load_rms"] > 30.0


def test_a_link_that_is_heavier_than_its_model():
    lighter, factor = MODEL.read_text(), 6.9 / 8.2
    for old, new in (
        ('mass="8.2"', 'mass="6.9"'),
        ('"0.03 0.22 0.22"', f'"{0.03 * factor} {0.22 * factor} {0.22 * factor}"'),
    ):
        assert old in lighter
        lighter = lighter.replace(old, new)
    model = mujoco.MjModel.from_xml_string(lighter)
    records = dfc.arm_records(model, LOG, payload={"hand": (PAYLOAD, PLACE)})
    (found,) = records.model_errors()
    assert (found.kind, found.link) == ("mass", "upper")
    assert found.value == pytest.approx(1.0 / factor, rel=0.02)


def test_a_joint_whose_clock_is_behind_is_named_and_its_coupling_put_right(log):
    late = {k: np.roll(v, 1)[1:] if k.startswith("lift.") else v[1:] for k, v in log.items()}
    records = dfc.arm_records(MODEL, late, payload={"hand": (PAYLOAD, PLACE)})
    (found,) = records.model_errors()
    assert (found.kind, found.link) == ("clock", "lift")
    assert found.value == pytest.approx(0.01, abs=6e-4)  # three standard errors of 0.2 ms
    assert "samples of lift are" in found.sentence and "behind" in found.sentence
    right = records.without([found])
    for joint, (axis, record) in right.items():
        # 1 %, as where the clocks are one.
        fitted = dfc.fit(axis, record, starts=1).parameters["coulomb"]
        assert fitted == pytest.approx(TRUE[joint][0], rel=0.01)
    assert right.late == {"lift": found.value} and right.model_errors() == ()


def test_a_clock_that_is_behind_by_a_tenth_of_a_sample_is_right(log):
    before = log["time"] - 1e-3
    late = {
        k: np.interp(before, log["time"], v) if k.startswith("lift.") else v for k, v in log.items()
    }
    records = dfc.arm_records(MODEL, late, payload={"hand": (PAYLOAD, PLACE)})
    assert "clock" not in [one.kind for one in records.model_errors()]


def test_a_drive_logged_at_another_scale_is_named_and_put_right(log):
    weak = log | {"lift.effort": 0.5 * log["lift.effort"]}
    records = dfc.arm_records(MODEL, weak, payload={"hand": (PAYLOAD, PLACE)})
    (found,) = records.model_errors()
    assert (found.kind, found.link) == ("drive", "lift")
    assert found.value == pytest.approx(0.5, rel=0.01)
    assert f"drive of lift is logged at {found.value:.3g} ±" in found.sentence
    axis, record = records.without([found])["lift"]
    assert f"u: over {found.value:.4g}, " in record.notes[-2]
    fitted = dfc.fit(axis, record, starts=1).parameters["coulomb"]
    assert fitted == pytest.approx(TRUE["lift"][0], rel=0.01)


def exchanged(log, one, other):
    pairs = {f"{a}.{k}": log[f"{b}.{k}"] for a, b in ((one, other), (other, one))
             for k in ("position", "effort")}  # fmt: skip
    return log | pairs


@pytest.mark.slow
@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"lift.position": lambda x: -x}, r"positions of lift have the opposite sign"),
        (
            {"lift.position": lambda x: -x, "lift.effort": lambda u: -u},
            r"the axis of lift has the opposite direction",
        ),
        (
            {"lift.position": lambda x: x + 0.5 * np.pi},
            r"the zero of lift is another one \(x -90 deg\)",
        ),
        ({"lift.effort": lambda u: 1000.0 * u}, r"another unit.*lift 1e\+03\)"),
    ],
)
def test_a_reading_that_was_meant_otherwise_is_named(log, changes, says):
    wrong = log | {name: change(log[name]) for name, change in changes.items()}
    records = dfc.arm_records(MODEL, wrong, payload={"hand": (PAYLOAD, PLACE)})
    with pytest.raises(ValueError, match=rf"the log fits the model if .*{says}"):
        records.model_errors()


@pytest.mark.long
@pytest.mark.parametrize(("one", "other"), [("wrist1", "wrist2")])
def test_joints_that_are_exchanged_are_named(log, one, other):
    records = dfc.arm_records(MODEL, exchanged(log, one, other), payload={"hand": (PAYLOAD, PLACE)})
    with pytest.raises(ValueError, match=f"if {one} and {other} are exchanged; anyway=True"):
        records.model_errors()
    with pytest.warns(dfc.RecordWarning, match="are exchanged"):
        assert records.model_errors(anyway=True)


def test_a_log_of_another_robot_is_refused(log):
    # All masses of this model are half, and all lengths 0.6 of those of the robot.
    model = mujoco.MjModel.from_xml_path(str(MODEL))
    model.body_mass[:] *= 0.5
    model.body_inertia[:] *= 0.5 * 0.6**2
    model.body_pos[:] *= 0.6
    model.body_ipos[:] *= 0.6
    records = dfc.arm_records(model, log)
    with pytest.raises(ValueError, match=r"does not fit the model, or only .*another robot"):
        records.model_errors()


def without(log, *joints):
    return {k: v for k, v in log.items() if k.split(".")[0] not in joints}


def test_joints_that_are_missing_or_held(log):
    with pytest.raises(
        ValueError, match="joint 'wrist3' and the log has none.*held=.*another robot"
    ):
        dfc.arm_records(MODEL, without(log, "wrist3"))
    held = dfc.arm_records(MODEL, without(log, "wrist3"), held={"wrist3": 0.3})
    assert list(held) == ["pan", "lift", "elbow", "wrist1", "wrist2"]
    still = log | {"pan.position": np.full(log["time"].size, 0.2)}
    with pytest.raises(ValueError, match="constant") as caught:
        dfc.arm_records(MODEL, still)
    assert 'held={"pan": its position}' in caught.value.__notes__[0]


def test_units_that_are_not_those_of_the_model(log):
    limited = mujoco.MjModel.from_xml_string(
        MODEL.read_text().replace('name="lift"', 'name="lift" range="-3 1"')
    )
    degrees = {k: np.rad2deg(v) if "position" in k else v for k, v in log.items()}
    with pytest.raises(ValueError, match='lift: positions run .* degrees .*"x": "deg"'):
        dfc.arm_records(limited, degrees)
    amperes = {k.replace("effort", "effort [A]"): v for k, v in log.items()}
    with pytest.raises(ValueError, match="pan: u is in 'A', the model needs 'N m'.*Scaling"):
        dfc.arm_records(MODEL, amperes)
    by_joint = {joint: dfc.Scaling(torque_constant=1.0) for joint in TRUE}
    found = dfc.arm_records(MODEL, amperes, scaling=by_joint)
    np.testing.assert_allclose(found.records["lift"].u, log["lift.effort"])
    weak = log | {"lift.effort": 0.01 * log["lift.effort"]}
    with pytest.raises(ValueError, match="lift: the model needs .* another robot's"):
        dfc.arm_records(MODEL, weak)


def test_numbers_and_rows_that_are_lost(log, nominal):
    hole = log | {
        "elbow.position": np.where(np.arange(log["time"].size) == 50, np.nan, log["elbow.position"])
    }
    with pytest.raises(ValueError, match=r"row|sample|x\[50\]") as caught:
        dfc.arm_records(MODEL, hole)
    assert "in joint elbow" in caught.value.__notes__[0]
    kept = np.random.default_rng(1).random(log["time"].size) > 0.01
    kept[[0, -1]] = True
    found = dfc.arm_records(MODEL, {k: v[kept] for k, v in log.items()}, dt=0.01)
    assert found.records["pan"].bad["filled"] > 10
    a, b = (one.records["lift"].known_load for one in (found, nominal))
    assert np.sqrt(np.mean((a - b) ** 2)) < 0.03 * np.sqrt(np.mean(b**2))


def test_stamps_that_jitter_are_refused_with_the_line_that_reads_all_joints(log, nominal):
    t = log["time"] + 5e-4 * np.random.default_rng(1).uniform(-1.0, 1.0, log["time"].size)
    jittered = {name: np.interp(t, log["time"], values) for name, values in log.items()}
    jittered["time"] = t
    line = r"not uniform.*Read all joints by arm_records\(model, log, dt=0.01\)"
    with pytest.raises(ValueError, match=line) as caught:
        dfc.arm_records(MODEL, jittered)
    assert "in joint pan" in caught.value.__notes__[0]
    found = dfc.arm_records(MODEL, jittered, dt=0.01)
    a, b = (one.records["lift"].known_load[:2390] for one in (found, nominal))
    assert np.sqrt(np.mean((a - b) ** 2)) < 0.03 * np.sqrt(np.mean(b**2))


def test_joints_with_stamps_of_their_own_are_put_on_one_clock(log, nominal):
    records = {joint: dfc.read_record(log, joint=joint, name=joint) for joint in TRUE}
    fine = records["elbow"]
    # The same motion, read 5 ms later by a clock that says so.
    later = fine.t + 5e-3
    x = np.interp(later, fine.t, fine.x)
    records["elbow"] = dfc.Record(
        later, np.interp(later, fine.t, fine.u), x, units=dict(fine.units)
    )
    with pytest.warns(
        dfc.RecordWarning, match="stamps of their own .*elbow begins 0.005 s after pan"
    ):
        found = dfc.arm_records(MODEL, records)
    at = found.records["lift"].t
    np.testing.assert_allclose(at, found.records["elbow"].t)
    expected = np.interp(at, nominal.records["lift"].t, nominal.records["lift"].known_load)
    off = found.records["lift"].known_load - expected
    assert np.sqrt(np.mean(off**2)) < 0.05 * np.std(expected)  # the acceleration between samples


def test_steps_and_stretches_that_do_not_fit(log):
    records = {joint: dfc.read_record(log, joint=joint, name=joint) for joint in TRUE}
    with pytest.raises(
        ValueError, match="lift has a step of 0.02 s and pan one of 0.01 s: give one"
    ):
        dfc.arm_records(MODEL, records | {"lift": records["lift"].decimated(2)})
    moved = dfc.Record(records["lift"].t + 20.0, records["lift"].u, records["lift"].x)
    with pytest.raises(ValueError, match="only .* s in common"):
        dfc.arm_records(MODEL, records | {"lift": moved})
    with pytest.raises(ValueError, match="scaling must be"):
        dfc.arm_records(MODEL, log, scaling=3.0)
    with pytest.raises(ValueError, match="scaling: the model has no joint 'hip'"):
        dfc.arm_records(MODEL, log, scaling={"hip": dfc.Scaling()})


def test_rows_are_means_over_windows_in_which_a_joint_slides_in_one_direction():
    at = np.array([0, 5, 10, 15, 20, 35, 40, 45, 50])  # one missing between 20 and 35
    direction = np.array([1, 1, 1, 1, 1, 1, 1, -1, -1])
    rows = _halves_of_windows(at, direction, 5)
    assert rows.tolist() == [0, 1, 2, 3, 5, 6, 7, 8]
