"""Logs as they come: headings, dialects, lost rows, bad readings, factors, records without a channel."""

import datetime
import gzip
import json
import math
import warnings

import numpy as np
import pytest
from made_logs import text, write
from scipy.integrate import cumulative_trapezoid

import dryfric_control as dfc
from dryfric_control.records.readers.channels import assign_columns, split_header

N = 400
DT = 0.01
T = DT * np.arange(N)
U = np.round(0.6 * np.sin(3.0 * T) + 0.2 * np.sin(11.0 * T), 6)
X = np.round(1.5 * np.sin(2.0 * T) + 0.4 * np.sin(5.0 * T), 6)
V = np.gradient(X, DT)


def same(record):
    np.testing.assert_allclose(record.x - record.x[0], X - X[0], rtol=0, atol=1e-8)
    np.testing.assert_allclose(record.u, U, rtol=0, atol=1e-8)
    assert record.dt == pytest.approx(DT)


#: Headings of a log; t=, u=, x= and r= mark those that are taken.
HEADINGS = [
    # which of several
    "t=t; u=i_cmd; x=x", "t=time; u=torque_act; x=q_meas; r=q_des; tau_cmd",
    "t=t; u=u; x=x; r=position_command", "t=t; u=u; x=pos_act; r=pos_cmd; encoder",
    "t=t; cmd_torque; u=meas_torque; x=x", "t=t; u=u; x=x; x1; u1",
    # joints
    "t=time; x=q3; dq3; u=q3_tau_J", "t=t; x=q_3; u=tau_3", "t=timestamp; x=pos (5); u=effort (5)",
    "t=t; x=position[2]; u=effort[2]", "t=time; x=joint_2_pos; joint_2_vel; u=joint_2_torque",
    "t=Time; u=Axis 1 Torque; x=Axis 1 Position",
    # Franka, Universal Robots, KUKA, Unitree
    "t=time; x=q; dq; u=tau_J", "t=time; x=q; r=q_d; dq; u=tau_J; tau_J_d",
    "t=timestamp; x=actual_q_0; r=target_q_0; u=actual_current_0; actual_qd_0",
    "t=t; x=q_msr; r=q_cmd; u=tau_msr",
    "t=t; x=motor_state.0.q; motor_state.0.dq; u=motor_state.0.tau_est",
    # ROS, PlotJuggler
    "t=time; x=position.elbow; velocity.elbow; u=effort.elbow",
    "t=time; x=/joint_states/position; u=/joint_states/effort", "t=stamp; x=pos; vel; u=eff",
    "t=rosbagTimestamp; x=position; u=effort",
    # Dynamixel, ODrive, SimpleFOC
    "t=time; r=goal_position; x=present_position; present_velocity; u=present_current",
    "t=time; x=pos_estimate; vel_estimate; Iq_setpoint; u=Iq_measured",
    "t=time; x=axis0.encoder.pos_estimate; u=axis0.motor.current_control.Iq_measured",
    "t=time; x=pos_estimate; r=input_pos; u=torque_estimate; input_torque",
    "t=time; r=target; u=voltage.q; shaft_velocity; x=shaft_angle",
    "t=t; u=current.q; velocity; x=angle",
    # CiA 402, TwinCAT
    "t=t; x=Position actual value; r=Position demand value; u=Torque actual value; Target torque",
    "t=time; x=Axis 1.ActPos; r=Axis 1.SetPos; u=MAIN.fActTorque",
    "t=time; x=Axes.Axis 1.NcToPlc.ActPos; u=GVL.fbDrive.fTorque",
    # English words
    "t=time; u=MotorTorque; x=ActualPosition; r=PositionCommand",
    "t=t; x=actual_position; r=target_position; u=i_q", "t=t; u=pressure; x=position",
    "t=time; x=stroke; u=force", "t=sec; u=force; x=displacement", "t=secs; u=effort; x=position",
    "t=elapsed_time; u=torque; x=angle", "t=time; u=pwm; x=encoder",
    # units
    "t=t_s; u=i_cmd_A; x=pos_act_m; r=pos_cmd_m; i_meas_foo", "t=time; u=torque_nm; x=position_rad",
    "t=time_ms; u=tau_Nm; x=q_rad", "t=time_s; u=torque_N_m; x=pos_rad; vel_rad_s",
    "t=Time s; u=Force N; x=Position mm", "t=t [s]; x=pos (2) [deg]; u=current (2) [A]",
    # German
    "t=Zeit; u=Drehmoment; x=Drehwinkel; Drehzahl",
    "t=Zeit; x=Istposition; r=Sollposition; u=Iststrom",
    "t=Zeitstempel; x=Lageistwert; r=Lagesollwert; u=Drehmomentistwert",
    "t=Zeit; u=Kraft; x=Isthub; r=Sollhub",
    "t=Zeit in ms; u=Druck in bar; x=Hub in mm; r=Soll-Hub in mm",
    "t=Zeit; u=Kraft; r=Hubsollwert; x=Hubistwert", "t=Zeit; u=Stellgröße; x=Winkel",
    # French, Spanish, Italian, Portuguese, Dutch, Swedish, Polish, Czech, Turkish, Finnish,
    # Chinese, Japanese, Russian, Korean
    "t=temps; u=couple; x=angle; vitesse", "t=Temps; u=Courant; x=Position; r=Consigne",
    "t=temps; u=pression; x=position", "t=tiempo; u=fuerza; x=posición; velocidad",
    "t=Tiempo; u=Corriente; x=Ángulo", "t=tempo; u=forza; x=posizione; velocità",
    "t=tempo; u=força; x=posição", "t=tijd; u=kracht; x=positie; snelheid",
    "t=tid; u=kraft; x=position", "t=czas; u=siła; x=położenie", "t=čas; u=síla; x=poloha",
    "t=zaman; u=kuvvet; x=konum", "t=aika; u=voima; x=asema", "t=时间; u=力矩; x=位置",
    "t=時間; u=トルク; x=位置", "t=время; u=момент; x=угол", "t=시간; u=토크; x=위치",
]  # fmt: skip


@pytest.mark.parametrize("line", HEADINGS)
def test_headings_of_logs_are_recognised(line):
    marked = [one.rpartition("=") for one in line.split("; ")]
    found = assign_columns([heading for *_, heading in marked], None, "run.csv")
    taken = {role[0]: found[role] for role in ("t", "u", "x", "reference") if role in found}
    assert taken == {role: k for k, (role, *_) in enumerate(marked) if role}


DOUBTFUL = {
    "t;q1;q2;tau1;tau2": "'tau1', 'tau2' could each be u; say which.*or one joint: joint=",
    "t;force;torque;x": "'force', 'torque' could each be u; say which: columns=.*",
    "t;iq;tau;x": "could each be u",
    "Zeit;Kraft;Isthub;Istweg": "'Isthub', 'Istweg' could each be x",
    **dict.fromkeys(("t;tau_m;x", "t;load (5);x"), "no column recognised as u"),
    **dict.fromkeys(("t;u;imu.gyro.x", "t;u;motor_position", "Zeit;Kraft;Sollhub",
                     "t;u;wheel_hub_temp"), "no column recognised as x"),
}  # fmt: skip


@pytest.mark.parametrize("line", DOUBTFUL)
def test_what_is_not_beyond_doubt_is_asked_for(line):
    with pytest.raises(ValueError, match=DOUBTFUL[line]):
        assign_columns(line.split(";"), None, "run.csv")


def test_the_joint_of_one_channel_is_that_of_the_others():
    source = {"t": T, "q1": 0 * X, "q2": X, "tau1": 0 * U, "tau2": U, "dq1": V, "dq2": V}
    for how in (dict(joint=2), dict(columns={"x": "q2"}), dict(columns={"u": "tau2"})):
        record = dfc.read_record(source, **how)
        same(record)
        assert list(record.channels) == ["v"]
    named = {"t": T, "elbow_pos": X, "elbow_torque": U, "wrist_pos": 0 * X, "wrist_torque": 0 * U}
    same(dfc.read_record(named, joint="elbow"))
    # A number in brackets is no unit.
    assert split_header("pos (5)") == ("pos (5)", "")
    assert "x" not in dfc.read_record({"t": T, "pos (5)": X, "effort (5)": U}).units


START = datetime.datetime(2026, 3, 29, 0, 59, 58, tzinfo=datetime.UTC)
DATES = [START + datetime.timedelta(seconds=float(t)) for t in T]
BERLIN = [datetime.timezone(datetime.timedelta(hours=1 if t < 2.0 else 2)) for t in T]


def scope(pairs, times=T):
    """An export of TwinCAT Scope, with a column of time for each channel or for all."""
    keys = {"Name": ["MAIN.fActTorque", "Axis 1.ActPos"], "SymbolComment": ["", ""],
            "Data-Type": ["REAL64", "REAL64"], "SampleTime[ms]": ["10", "10"],
            "Port": ["851", "501"], "Unit": ["Nm", "rad"]}  # fmt: skip
    head = "Name\tScope Project\nFile\tC:\\a.tcscopex\nStarttime of export\t132\n\n"
    lines = []
    for key, values in keys.items():
        lines.append("\t".join([key, values[0], key, values[1]] if pairs else [key, *values]))
    clock = (1e3 * T, U, 1e3 * times, X) if pairs else (1e3 * T, U, X)
    return head + "\n".join(lines) + "\n\n" + text(*clock, mark="\t", decimal=",") + "EOF\n"


def stamped(how, heading="t,u,x", start=0.0, **marks):
    """The motion over times of day, or dates, that are written like this."""
    stamps = [(d + datetime.timedelta(seconds=start)).strftime(how) for d in DATES]
    return text(stamps, U, X, heading=heading, **marks)


DIALECTS = {
    "UTF-16 of Excel": text(T, U, X, heading="t\tu\tx", mark="\t").encode("utf-16"),
    "UTF-16 without a mark": text(T, U, X, heading="t,u,x").encode("utf-16-le"),
    "minus of Unicode": text(T, U, X, heading="t,u,x").replace("-", "\N{MINUS SIGN}"),
    "exponents of Fortran": text(
        *([f"{v:.9E}".replace("E", "D") for v in c] for c in (T, U, X)), heading="t u x", mark="  "
    ),
    "exponents without a letter": text(
        T, [f"{v:.9e}".replace("e", "D").replace("D-01", "-001") for v in U], X, heading="t u x",
        mark=" ",
    ),
    "ISO 8601": text([d.isoformat() for d in DATES], U, X, heading="t,u,x"),
    "ISO 8601 in UTC": stamped("%Y-%m-%dT%H:%M:%S.%f000Z", "time,u,x"),
    "ISO 8601 with a blank": stamped("%Y-%m-%d %H:%M:%S.%f", "t [ms];u;x", mark=";"),
    "ISO 8601 over the change to summer time": text(
        [d.astimezone(zone).isoformat() for d, zone in zip(DATES, BERLIN, strict=True)], U, X,
        heading="t,u,x",
    ),
    "German dates": stamped("%d.%m.%Y %H:%M:%S,%f", "Zeit;Kraft;Weg", mark=";", decimal=","),
    "times of day over midnight": stamped("%H:%M:%S.%f", start=-3600.0),
    "serial monitor of Arduino": stamped("%H:%M:%S.%f", "", mark="\t").replace("000\t", " -> "),
    "Scope, a time for each": scope(True),
    "Scope, a time for all": scope(False),
    "SimpleFOC, no heading": text(T, X, U, V, X, mark="\t"),
}  # fmt: skip
HOW = {"SimpleFOC, no heading": {"columns": {"t": "0", "u": 2, "x": "1"}}}


@pytest.mark.parametrize("case", DIALECTS)
def test_dialects_are_read(tmp_path, case):
    with warnings.catch_warnings(action="error"):
        same(dfc.read_record(write(tmp_path, DIALECTS[case]), **HOW.get(case, {})))


def test_times_that_are_not_beyond_doubt_are_refused(tmp_path):
    assert dict(dfc.read_record(write(tmp_path, scope(True))).units)["u"] == "N m"
    with pytest.raises(ValueError, match=r"row 2, column 't' .*ISO 8601.*parse_dates"):
        dfc.read_record(write(tmp_path, stamped("%m/%d/%Y %H:%M:%S.%f")))


def test_arrays_of_numpy(tmp_path):
    np.savez_compressed(tmp_path / "run.npz", t=T, u=U, x=X, other=np.eye(3))
    same(dfc.read_record(tmp_path / "run.npz"))
    with pytest.raises(ValueError, match="more than 100 rows"):
        dfc.read_record(tmp_path / "run.npz", max_rows=100)
    file = tmp_path / "run.npy"
    np.save(file, np.c_[X, T, U, X, T])
    same(dfc.read_record(file, columns={"t": 1, "u": 2, "x": 0}))
    fields = np.rec.fromarrays([T, U, X], names="t, effort, position")
    for array in (fields, np.c_[T, U, X].T, np.c_[T, U, X]):
        np.save(file, array)
        same(dfc.read_record(file))
    data = file.read_bytes()
    # One that claims more than there is takes no memory.
    for claim in (b"(9**9,3), }", b"(40000000000, 3), } "):
        file.write_bytes(data.replace(b"(400, 3), }".ljust(len(claim)), claim))
        with pytest.raises(ValueError, match="damaged"):
            dfc.read_record(file)
    np.save(file, np.array([None]), allow_pickle=True)
    with pytest.raises(ValueError, match="damaged or no .npy file of numbers"):
        dfc.read_record(file)


def test_lines_of_json(tmp_path):
    lines = [json.dumps({"time": t, "joints": {"name": ["hip", "knee"], "position": [0.0, x],
                                               "effort": [0.1, u]}, "mode": "on"})
             for t, u, x in zip(T, U, X, strict=True)]  # fmt: skip
    path = write(tmp_path, "\n".join(lines), "run.jsonl")
    same(dfc.read_record(path, joint="knee"))
    with pytest.warns(dfc.RecordWarning, match="line 400, the last, is cut off"):
        record = dfc.read_record(write(tmp_path, "\n".join(lines)[:-9], "run.ndjson"), joint="knee")
    assert len(record) == N - 1
    with pytest.raises(ValueError, match="line 3 is no JSON object"):
        dfc.read_record(write(tmp_path, "\n".join([*lines[:2], "[1]", *lines[3:]]), "run.jsonl"))
    del lines[100]
    lines[200] = json.dumps({"time": float(T[201]), "mode": "off"})
    with pytest.warns(dfc.RecordWarning, match="1 row without a number.*2 filled and masked"):
        record = dfc.read_record(write(tmp_path, "\n".join(lines), "a.jsonl"), joint="knee", dt=DT)
    assert np.flatnonzero(~record.good).tolist() == [100, 201]


@pytest.mark.parametrize("timed", [True, False])
@pytest.mark.parametrize("cell", ["nan", "", "n/a"])
@pytest.mark.parametrize("column", [1, 2])
def test_a_number_that_is_missing_is_bridged_and_masked(tmp_path, cell, column, timed):
    table = [[f"{v:.9g}" for v in c] for c in (T, U, X)]
    table[column][170] = cell
    heading, how = ("t,u,x", dict(dt=DT)) if timed else ("u,x", dict(rate=1 / DT))
    path = write(tmp_path, text(*table[not timed :], heading=heading))
    with pytest.warns(
        dfc.RecordWarning, match="^1 row without a number in the sou.* of 400 .* 1 f"
    ):
        record = dfc.read_record(path, **how)
    assert np.flatnonzero(~record.good).tolist() == [170] and record.bad["filled"] == 1
    assert record.x[170] == pytest.approx(X[170], abs=1e-3)  # 0.01 s of a smooth path
    assert "1 row without a number" in record.notes
    if cell == "" and timed:
        with pytest.raises(ValueError, match=r"row 172, column '[ux]' .*cell is empty; give dt="):
            dfc.read_record(path)


def test_a_repeated_stamp_is_bridged_and_masked():
    stamps = np.where(np.arange(N) == 170, T[169], T)
    with pytest.warns(dfc.RecordWarning, match="1 row with the stamp of the row before"):
        record = dfc.read_record({"t": stamps, "u": U, "x": X}, dt=DT)
    assert len(record) == N and np.flatnonzero(~record.good).tolist() == [170]
    # A row without a number does not make that with its stamp the right one.
    u = np.where(np.arange(N) == 169, np.nan, U)
    with pytest.warns(dfc.RecordWarning, match="1 row without a number and 1 row with the stamp"):
        record = dfc.read_record({"t": stamps, "u": u, "x": X}, dt=DT)
    assert np.flatnonzero(~record.good).tolist() == [169, 170]
    with pytest.raises(ValueError, match="an even clock in coarse stamps, give rate="):
        dfc.read_record({"t": np.repeat(T[::2], 2), "u": U, "x": X}, dt=DT)
    # Clock time, rounded to 2.4e-7 s, loses no sample.
    with warnings.catch_warnings(action="ignore"):
        clock = dfc.read_record({"t": 1.7e9 + np.arange(N) / 60.0, "u": U, "x": X}, dt=1 / 60)
    assert len(clock) == N


@pytest.mark.parametrize(("name", "pack"), [("run.csv", bytes), ("run.csv.gz", gzip.compress)])
def test_a_row_that_was_cut_off_is_left_out(tmp_path, name, pack):
    whole = text(T, U, [f"{v:.6f}" for v in X], heading="t,u,x").encode()
    for cut in (3, 9, 12):
        with pytest.warns(dfc.RecordWarning, match=r"row 401, the last, .*cut off, and left out"):
            record = dfc.read_record(write(tmp_path, pack(whole[:-cut]), name))
        assert len(record) == N - 1 and record.x[-1] == X[-2]
    with warnings.catch_warnings(action="error"):
        same(dfc.read_record(write(tmp_path, pack(whole[:-1]), name)))  # only the end of the line


def test_a_counter_set_to_zero_is_told():
    path = 100.0 * np.sin(0.8 * T) + 3.0
    for offset in (0.0, 0.03):
        x = np.where(np.arange(N) < 300, path, path - path[300] + offset)
        with pytest.warns(
            dfc.RecordWarning, match=r"x\[300\] = .*was the counter set to zero.*record\[:300\]"
        ):
            dfc.Record(T, U, x)
    with warnings.catch_warnings(action="error"):
        dfc.Record(T, U, path - path[300])
    # From one end of the range to the other it could as well be an encoder that wraps.
    ramp = np.where(np.arange(N) < 300, T, T - T[300])
    with pytest.raises(ValueError, match="wraps around.*or the counter was set to zero, split"):
        dfc.Record(T, U, ramp)


FINE = 1e-3 * np.arange(6000)
PUSH = 15.0 * np.sin(6.0 * FINE) + 5.0 * np.sin(17.0 * FINE + 1.0)
PATH = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0).simulate(PUSH, dt=1e-3).y[0]


@pytest.mark.parametrize(
    ("factor", "size"),
    [(1e-6 / 3, 65536), (1e-6, 2**16), (2e-6, 20_000), (7.3e-6, 4096), (1e-6, 12_345)],
)
def test_the_period_that_is_suggested_is_the_right_one(factor, size):
    counts = np.rint(PATH / factor).astype(int) % size
    source = {"t": FINE, "u": PUSH, "x [counts]": counts}
    how = dict(gain={"x": factor}, units={"x": "m"})
    with pytest.raises(ValueError, match="the encoder wraps around") as refused:
        dfc.read_record(source, **how)
    period = float(str(refused.value).split("unwrap=")[1].split()[0])
    # Of a size that no encoder usually has, a count may be missing.
    assert period == pytest.approx(size * factor, abs=1e-9 if size != 12_345 else 3 * factor)
    right = dfc.read_record(source, unwrap=size * factor, **how)
    np.testing.assert_allclose(right.x - right.x[0], PATH - PATH[0], atol=factor)
    words = f"leaves a jump.*is the period unwrap={size * factor:.4g}"[:-1]
    with pytest.raises(ValueError, match=words):
        dfc.read_record(source, unwrap=0.995 * size * factor, **how)


@pytest.mark.parametrize("heading", ["Druck_bar", "Druck [bar]", "u [bar]", "Druck in bar"])
def test_a_gain_converts_the_number_in_the_file(heading):
    source = {"t": T, heading: U, "x [m]": X}
    record = dfc.read_record(source, columns={"u": heading}, gain=120.0, units={"u": "N"})
    np.testing.assert_allclose(record.u, 120.0 * U, rtol=1e-15)
    assert record.raw["u"] == ("bar", 120.0) and record.units["u"] == "N"
    assert "u multiplied by gain 120 per bar" in record.notes
    assert "factors   u 120 per bar" in str(record.check())
    with pytest.raises(ValueError, match=r"120 N per bar, .*units=\{\"u\": \"N\"\}, or 120 times"):
        dfc.read_record(source, columns={"u": heading}, gain=120.0, units={"u": "bar"})


def test_a_gain_beside_a_length_asks_for_the_unit_of_the_product():
    source = {"t": T, "u": U, "x [mm]": X}
    with pytest.warns(dfc.RecordWarning, match="gain 2 alone, not by the 0.001 m per mm as well"):
        assert dfc.read_record(source, gain={"x": 2.0}).x[7] == 2.0 * X[7]
    with warnings.catch_warnings(action="error"):
        for gain, unit, factor in ((1e-3, "m", 1e-3), (2.0, "um", 2e-6)):
            record = dfc.read_record(source, gain={"x": gain}, units={"x": unit})
            np.testing.assert_allclose(record.x, factor * X)
            assert record.raw["x"] == ("mm", pytest.approx(factor)) and record.units["x"] == "m"


def test_pressure_and_pinion_are_numbers_of_the_machine():
    cylinder = dfc.Scaling(piston_area=1.2e-3)
    record = dfc.read_record({"t": T, "Druck [bar]": U, "x [mm]": X}, gain=cylinder)
    np.testing.assert_allclose(record.u, 120.0 * U, rtol=1e-12)  # 1e5 Pa times 1.2e-3 m^2
    assert record.units["u"] == "N" and record.raw["u"] == ("bar", pytest.approx(120.0))
    with pytest.raises(ValueError, match="piston_area is given and u has no unit.*units="):
        dfc.read_record({"t": T, "Druck": U, "x [mm]": X}, gain=cylinder)
    rack = dfc.Scaling(
        pinion_radius=0.02, gear_ratio=5.0, torque_constant=0.1, counts_per_turn=1000
    )
    record = dfc.read_record({"t": T, "u [A]": U, "x [counts]": 1e3 * X}, gain=rack)
    np.testing.assert_allclose(record.x, X / 5.0 * 2 * math.pi * 0.02)
    np.testing.assert_allclose(record.u, 0.1 * U * 5.0 / 0.02)  # torque over radius
    assert record.units["u"] == "N" and dfc.Scaling.from_dict(rack.to_dict()) == rack
    with pytest.warns(dfc.RecordWarning, match=r"pinion of 20 mm has pinion_radius=0\.02"):
        dfc.Scaling(pinion_radius=20)


def test_a_record_comes_back_with_its_mask(tmp_path):
    keep = np.delete(np.arange(N), [70, 150, 151, 250])
    x = np.where(np.arange(N) == 320, 0.3, X)
    source = {"t": T[keep], "u [A]": U[keep], "x [counts]": 1e6 * x[keep], "v": V[keep]}
    how = dict(gain={"u": 2.0, "x": 1e-6}, units={"u": "N m", "x": "rad"}, dt=DT, name="a run")
    with pytest.warns(dfc.RecordWarning):
        masked = dfc.read_record(source, **how)
    assert np.flatnonzero(~masked.good).tolist() == [70, 150, 151, 250, 320]
    masked.save(tmp_path / "run.json")
    masked.to_csv(tmp_path / "run.csv")
    frame = masked.to_pandas()
    with warnings.catch_warnings(action="error"):
        for again in (dfc.load_record(tmp_path / "run.json"), dfc.read_record(tmp_path / "run.csv"),
                      dfc.Record.from_frame(frame)):  # fmt: skip
            assert again == masked and again.masked.reasons == masked.masked.reasons
            np.testing.assert_array_equal(again.masked.readings, masked.masked.readings)
            assert again.units == masked.units and again.raw == masked.raw
            assert again.quantum == masked.quantum and again.notes == masked.notes
            assert again.name == "a run" and list(again.channels) == ["v"]
    assert not dfc.Record(masked.t, masked.u, masked.x, units=masked.units) == masked
    # A reading that was kept is kept when it is read back.
    kept = dfc.Record(T, U, np.where(np.arange(N) == 100, 0.0, X), good=np.ones(N, bool))
    kept.to_csv(tmp_path / "run.csv")
    assert dfc.read_record(tmp_path / "run.csv") == kept


def test_a_column_good_masks(tmp_path):
    flag = (np.arange(N) % 50 != 7).astype(int)
    record = dfc.read_record(write(tmp_path, text(T, U, X, flag, heading="t,u,x,good")))
    assert np.flatnonzero(~record.good).tolist() == list(range(7, N, 50))
    assert set(record.masked.reasons) == {"given"}
    # Once more at another step: readings that were not used are not used now.
    record.to_csv(tmp_path / "saved.csv")
    with pytest.warns(dfc.RecordWarning, match="8 filled and masked"):
        again = dfc.read_record(tmp_path / "saved.csv", dt=DT)
    assert np.array_equal(again.good, record.good)


def test_a_free_motion_needs_no_drive(tmp_path):
    """Decay of an oscillator by dry friction: the amplitude falls by 4 F/k each period."""
    stiffness, mass, level = 40.0, 0.5, 0.8
    omega = math.sqrt(stiffness / mass)
    t = 1e-3 * np.arange(3000)
    half = np.floor(t * omega / math.pi)
    centre = level / stiffness * (-1.0) ** half  # moves down first: friction pushes up
    x = (0.3 - (2 * half + 1) * level / stiffness) * np.cos(omega * t) + centre
    record = dfc.Record(t, None, x, units={"x": "m", "u": "N"})
    assert not record.u.any() and "no drive: u = 0" in record.notes
    assert dfc.Record(t, np.zeros(t.size), x).x.tolist() == record.x.tolist()
    assert any("only ratios to" in message for message in record.check().messages)
    path = write(tmp_path, text(t, x, heading="t,x"))
    assert not dfc.read_record(path, columns={"u": None}).u.any()
    with pytest.raises(ValueError, match=r"no column recognised as u.*\{\"u\": None\} for a free"):
        dfc.read_record(write(tmp_path, text(t, x, 0 * x, heading="t,x,abc")))


def test_a_velocity_alone_gives_the_position(tmp_path):
    v = 2.0 * np.cos(2.0 * T)
    heading = "t;torque [Nm];speed [rpm]"
    path = write(tmp_path, text(T, U, v * 30.0 / math.pi, heading=heading, mark=";"))
    with pytest.warns(dfc.RecordWarning, match="no position: it is the integral of the velocity"):
        record = dfc.read_record(path)
    np.testing.assert_allclose(record.x, cumulative_trapezoid(v, T, initial=0.0), atol=1e-6)
    np.testing.assert_allclose(record.x, np.sin(2.0 * T), atol=1e-4)  # h^2/12 of the trapezoids
    assert dict(record.units) == {"t": "s", "u": "N m", "x": "rad", "v": "rad/s"}
    assert record.quantum is None and any("offset is free" in note for note in record.notes)
    with warnings.catch_warnings(action="error"):
        dfc.read_record(path, columns={"x": None})
    keep = np.arange(N) != 200
    with pytest.warns(dfc.RecordWarning, match="1 filled and masked"):
        again = dfc.Record.from_irregular(T[keep], U[keep], None, dt=DT, channels={"v": v[keep]})
    np.testing.assert_allclose(again.x, record.x, atol=1e-4)


def written(tmp_path, heading, rows):
    path = tmp_path / "run.csv"
    path.write_text("\n".join([heading, *rows, ""]), encoding="utf-8")
    return path


ROWS = [(0.01 * k, math.sin(0.1 * k), math.cos(0.07 * k)) for k in range(60)]


def test_units_in_brackets_between_blanks_belong_to_the_word_before(tmp_path):
    rows = [f"{t:.2f} {u:.4f} {x:.4f}" for t, u, x in ROWS]
    record = dfc.read_record(written(tmp_path, "Tempo (s) Coppia (N m) Posizione (mm)", rows))
    assert dict(record.units) == {"t": "s", "u": "N m", "x": "m"}
    # A line that names other than the columns is not passed over in silence.
    with pytest.warns(dfc.RecordWarning, match=r"does not name each of the 3 columns.*units="):
        dfc.read_record(written(tmp_path, "Messung 3 Kraft [N]", rows))


def test_decimal_commas_between_commas_are_told_for_what_they_are(tmp_path):
    rows = [f"{t:.2f},{u:.4f},{x:.4f}".replace(".", ",") for t, u, x in ROWS]
    with pytest.raises(ValueError, match="6 cells a row under 3 headings: decimal commas.*semicol"):
        dfc.read_record(written(tmp_path, "t,F,x", rows))
    rows = [",".join(f'"{v:.4f}"'.replace(".", ",") for v in row) for row in ROWS]
    with pytest.raises(ValueError, match="'0,0000' is not a number, .*in quotes.*semicolons"):
        dfc.read_record(written(tmp_path, "t,F,x", rows))


@pytest.mark.parametrize("heading", ["Uhrzeit", "Heure", "Hora", "Ora"])
def test_a_time_of_day_with_a_decimal_comma(tmp_path, heading):
    rows = [f"23:59:{59 + t:05.2f};{u:.4f};{x:.4f}".replace(".", ",") for t, u, x in ROWS if t < 1]
    record = dfc.read_record(written(tmp_path, f"{heading};Kraft;Weg", rows))
    assert record.dt == pytest.approx(0.01)


@pytest.mark.parametrize("under", ["s|N|mm|-", "[s]|[N]|[mm]|[-]", "(s)|(N)|(mm)|"])
def test_a_row_of_units_may_have_brackets_and_columns_without_one(tmp_path, under):
    t = 0.01 * np.arange(300)
    rows = "\n".join(f"{a:.2f}|{np.sin(a):.6f}|{np.cos(a):.6f}|1" for a in t)
    record = dfc.read_record(write(tmp_path, f"t|u|x|status\n{under}\n{rows}\n"))
    assert record.units == {"t": "s", "u": "N", "x": "m"}
    np.testing.assert_allclose(record.x, 1e-3 * np.cos(t), atol=1e-9)


def test_a_refusal_that_no_argument_mends_has_no_line_to_copy(tmp_path):
    t = 0.01 * np.arange(300)
    rows = "\n".join(f"{a:.2f},{np.sin(a):.6f},{np.cos(a):.6f}" for a in t)
    with pytest.raises(ValueError, match="split where runs were joined$"):
        dfc.read_record(write(tmp_path, f"t,u,x\n{rows}\n{rows}\n"))


def test_of_two_columns_with_one_heading_the_line_has_the_index(tmp_path):
    t = 0.01 * np.arange(300)
    rows = "\n".join(f"{a:.2f},{np.sin(a):.6f},{np.cos(a):.6f},{np.sin(2 * a):.6f}" for a in t)
    with pytest.raises(ValueError, match=r'csv", columns={"x": 2}\)$'):
        dfc.read_record(write(tmp_path, f"t,u,x,x\n{rows}\n"))


def test_stamps_of_whole_seconds_are_refused_for_what_they_are():
    t = np.arange(3000) // 1000
    table = {"t": t.astype(float), "u": np.sin(0.01 * np.arange(3000)), "x": np.cos(t)}
    with pytest.raises(ValueError, match="duplicated time stamps"):
        dfc.read_record(table)


def test_a_stated_unit_of_the_time_is_not_doubted(recwarn):
    t = 0.01 * np.arange(300)
    record = dfc.read_record({"t [min]": t, "u": np.sin(3 * t), "x": np.cos(2 * t)})
    assert record.dt == pytest.approx(0.6) and not recwarn
