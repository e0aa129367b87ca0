"""Headings of public logs: read as they are, or refused with the line that reads them.

Each row has the repository whose log (or the code that writes it) has these headings, the arguments
of the line that the refusal gives, none where the log is read as it is, and the headings, marked
with what they are taken as. Only names of columns are from there; the numbers are made here.
"""

import re

import numpy as np
import pytest

import dryfric_control as dfc
from dryfric_control.records.readers.channels import split_header

LOGS = [
    # yukunlin1124/Orin-Motor-Control
    ("", "t=time (s); motor_id; x=position (deg); velocity (rpm); u=current (A); temperature(C)"),
    # schn27/servosetup
    ('columns={"u": ...}, rate=...', "Pos; Spd; Uin; Iout"),
    # EvaZillen/3D-printed-pneumatic-actuator
    ("", "t=Time (in ms); Laser (in V); Pressure (in V); Force (in V); x=Laser (in mm); Pressure (in bar); u=Force (in N)"),
    # KonradMnich/friction-identification
    ('columns={"u": ..., "x": ...}', "Time; Analog 1; Analog 2; Analog 3; Digital 1; Digital 2"),
    # eliasoa/TTK4900_CDPR
    ("joint=0", "t=time; x=ODrive 0 Position; ODrive 1 Position; ODrive 2 Position; ODrive 3 Position; ODrive 0 Velocity; ODrive 1 Velocity; ODrive 2 Velocity; ODrive 3 Velocity; u=ODrive 0 Current; ODrive 1 Current; ODrive 2 Current; ODrive 3 Current"),
    # Amirjf/single-rod-pendulum
    ('columns={"u": ..., "x": "newPosition"}', "xAccl; yAccl; zAccl; newPosition; time; pcTime"),
    ('columns={"u": ...}', "time_sec; theta_kalman; theta_dot_kalman; theta_ddot_kalman; x_pivot_m"),
    ('columns={"u": ...}', "time_s; alpha_m_rad_s2; omega_m_rad_s; theta_m_rad"),
    ('columns={"u": ...}', "time; theta; x_pivot"),
    ('columns={"u": ...}', "time; theta; x_pivot; dt; theta_rad; theta_kalman; theta_dot_kalman"),
    # Royginald/small-controls-project
    ('columns={"x": ...}', "Time (s); Voltage (V); Speed (steps/s)"),
    # bk-poudel/Unitree_Z1
    ('columns={"u": None}, rate=..., joint=1', "q1; q2; q3; q4; q5; q6; q7; dq1; dq2; dq3; dq4; dq5; dq6; dq7"),
    # ersaraujo/motors-data-collect
    ('columns={"x": ...}, joint=1', "# CURRENT_M1; CURRENT_M2; PWM_M1; PWM_M2; DESIRED_M1; DESIRED_M2; TIMESTAMP"),
    # liamjosephnolan/thesis_matlab
    ('columns={"u": "pitch_effort", "x": "pitch_position"}', "t=time; u=pitch_effort; x=pitch_position; pitch_velocity"),
    ('columns={"u": ..., "x": "pitch_position"}', "time; pitch_position; pitch_velocity"),
    ('columns={"u": "/psm_joint_telemetry/insertion/effort", "x": "/psm_joint_telemetry/insertion/position"}', "t=__time; /psm_joint_telemetry/header/stamp; u=/psm_joint_telemetry/insertion/effort; x=/psm_joint_telemetry/insertion/position; /psm_joint_telemetry/insertion/velocity; /psm_joint_telemetry/pitch/effort; /psm_joint_telemetry/pitch/position; /psm_joint_telemetry/pitch/velocity; /psm_joint_telemetry/roll/effort; /psm_joint_telemetry/roll/position; /psm_joint_telemetry/roll/velocity"),
    ('columns={"u": "/psm_joint_telemetry/insertion/effort", "x": "/psm_joint_telemetry/insertion/position"}', "t=time; /psm_joint_telemetry/header/stamp; u=/psm_joint_telemetry/insertion/effort; x=/psm_joint_telemetry/insertion/position; /psm_joint_telemetry/pitch/effort; /psm_joint_telemetry/pitch/position; roll_effort; roll_position; roll_velocity"),
    ('columns={"u": None}', "t=__time; x=/psm_joint_telemetry/roll/position; /psm_joint_telemetry/roll/velocity"),
    # moelyaakoubi/GUI-RTDE
    ("joint=0", "t=timestamp; x=actual_q_0; actual_q_1; actual_q_2; u=actual_current_0; actual_current_1; actual_current_2; target_qd_0; target_qdd_0; target_current_0"),
    # Buobm/RobotLog
    ('columns={"u": ..., "x": "GlobalX"}', "Timestamp; GlobalX; GlobalY; GlobalYaw; XVelocity; YVelocity; YawVelocity; MotorTemp; BodyTemp; BatteryLevel; TimeToTarget; Mode"),
    # Cobular/LKMTechCanDriver-Rust
    ("", "t=Time; x=Position; Velocity; Position Error; Velocity Setpoint; Velocity Error; u=Target Torque; r=Target Pos"),
    ("", "t=Time; x=Position; Velocity; u=input; action"),
    # EMendezJ/Lab8
    ('columns={"u": ..., "x": ...}', "timestamp; rpm; velocidad_lineal"),
    # MatWieckowski/anti_gravity
    ("", "t=Timestamp; x=Output Angle [deg]; Angular Velocity [dps]; Gravity Torque [Nm]; Friction Torque [Nm]; Damping Torque [Nm]; Target Torque [Nm]; u=Applied Torque [Nm]; Is Holding"),
    # Palinho-gum/dashboardmonitoringmotordc
    ('columns={"u": "voltage", "x": ...}', "timestamp; rpm; voltage; current; pwm"),
    # atifmoh11-commits/6DOF-Python-Files
    ('columns={"x": ...}', "# Time (s); Thrust (N)"),
    ('columns={"u": ...}', "Time; X; Y; Z; Q0; Q1; Q2; Q3; Velocity; Acceleration; Mach"),
    # dfki-ric-underactuated-lab/double_pendulum
    ("joint=1", "t=time; x=pos1; pos2; vel1; vel2; u=tau1; tau2"),
    ("joint=1", "t=time; x=pos1; pos2; vel1; vel2; u=tau1; tau2"),
    ("joint=1", "t=time; x=pos1; pos2; vel1; vel2; u=tau1; tau2; K11; K12; K13; K14; K21; K22; K23; K24; k1; k2"),
    ("joint=1", "t=time; x=pos_meas1; pos_meas2; vel_meas1; vel_meas2; pos_filt1; pos_filt2; vel_filt1; vel_filt2; tau_con1; tau_con2; tau_fric1; tau_fric2; u=tau_meas1; tau_meas2"),
    ("joint=1", "t=time; x=pos_meas1; pos_meas2; vel_meas1; vel_meas2; pos_filt1; pos_filt2; r=pos_des1; pos_des2; vel_des1; vel_des2; tau_con1; tau_con2; tau_fric1; tau_fric2; u=tau_meas1; tau_meas2; tau_des1; tau_des2"),
    ("joint=1", "t=time; x=pos1; vel1; acc1; jerk1; u=tau1; pos2; vel2; acc2; jerk2; tau2"),
    ('columns={"u": "shoulder_torque", "x": "shoulder_pos"}', "t=time; x=shoulder_pos; shoulder_vel; shoulder_acc; shoulder_jerk; u=shoulder_torque; elbow_pos; elbow_vel; elbow_acc; elbow_jerk; elbow_torque"),
    ("joint=1", "t=time; x=pos1; pos2; vel1; vel2; u=tau1; tau2; meas_pos1; meas_pos2; meas_vel1; meas_vel2"),
    ('columns={"u": None}, joint=1', "t=time; x=pos1; pos2; vel1; vel2; acc1; acc2"),
    # dfki-ric-underactuated-lab/torque_limited_simple_pendulum
    ("", "t=time; x=pos; vel; u=torque"),
    ("", "t=time; x=position; velocity; u=torque"),
    ("", "; t=time; x=pos; vel; u=torque"),
    # haibara-hsu/Mujocolearn
    ('columns={"u": ...}, joint=1', "Time; Tip_X; Tip_Y; Tip_Z; J1_Angle; J2_Angle; J3_Angle"),
    # koyomimono/OMUNI
    ('columns={"u": ...}', "time[s]; mouse_x[mm]; mouse_y[mm]; angle_rad"),
    ('columns={"x": "ex[mm]", "u": ...}', "time[s]; dt[s]; fps; ex[mm]; ey[mm]; ix; iy; cmd1; cmd2; cmd3"),
    ('columns={"u": ...}', "Time; Error_X; Error_Y; Theta"),
    # benitoriba/Finger_servo_control
    ("", "t=time_ms; r=command_angle; x=feedback_angle; u=current_mA"),
    # jn89b/mechatronics
    ('columns={"u": ...}', "Time; EncoderPosition; TargetCounts"),
    ('columns={"u": ..., "x": ...}', "Time; roll_dg; pitch_dg; yaw_dg; accel_x_normal; accel_y_normal; accel_z_normal"),
    # maido-39/free-dog-sdk-dev
    ('columns={"u": ..., "x": ...}', "timestamp; real_time; FR_0_target; FR_0_actual; FR_0_error; FR_1_target; FR_1_actual; FR_1_error"),
    # umagaba/eyantra-balancing-robot
    ('columns={"u": ..., "x": ...}', "Time (s); pidOutput; pitch"),
    ('columns={"u": ..., "x": ...}', "integral; derivateive; tilterror; Time (s); pidOutput; pitch"),
    ('columns={"x": "current_position", "u": ...}', "Time (s); kp_tilt; ki_tilt; kd_tilt; kp_pos; ki_pos; kd_pos; current_position; tilt_angle; filteredAngle; pidOutput; currentAngle"),
    # frankaemika/libfranka
    ("joint=0", "t=time; success_rate; x=state.q[0]; state.q[1]; state.q_d[0]; state.q_d[1]; state.dq[0]; state.dq[1]; state.dq_d[0]; state.dq_d[1]; u=state.tau_J[0]; state.tau_J[1]; state.tau_ext_hat_filtered[0]; state.tau_ext_hat_filtered[1]; cmd.q_d[0]; cmd.q_d[1]; cmd.dq_d[0]; cmd.dq_d[1]; cmd.tau_J_d[0]; cmd.tau_J_d[1]"),
    # dongdaming1966/mcar_simulate
    ('columns={"u": ...}', "time; angle_velocity; angle; motor_velocity"),
    ('columns={"u": ...}', "time; angle_velocity; angle; motor_acc; motor_velocity; controller_output"),
    # neurobionics/opensourceleg
    ('columns={"x": ...}', "Time; Output_Current; Command_Current"),
    # Rhoban/bam
    ('columns={"u": ...}', "timestamp; position; speed; goal_position; load; input_volts; temp; torque_enable"),
    # dongdaming1966/mcar_simulate
    ('columns={"u": ...}', "time; angle_velocity; angle; motor_output(velocity); controller_output(acc); gyro_raw; acc_raw"),
    # EnKJneer/Masters-thesis
    ('joint="x"', "Unnamed: 0; t=time; x=pos_x; pos_y; pos_z; pos_sp; r=cmd_pos_x; cmd_pos_y; cmd_pos_z; cmd_pos_sp; cmd_v_x; cont_dev_x; v_x; a_x; v_y; a_y; time_diff; f_x; f_y; a_p; a_e; phi; u=curr_x; curr_y; curr_z; curr_sp; f_x_sim; materialremoved_sim"),
    # ArduPilot/ardupilot
    ('columns={"t": "TimeUS"}', "t=TimeUS; Id; x=Pos; u=Force; Speed; Pow; r=PosCmd; V; A; MotT; PCBT; Err"),
    # akhil22/data_processing
    ('columns={"u": ...}', "v; w; t"),
]  # fmt: skip
N = 400
T = 0.01 * np.arange(N)


def source(headings):
    """A log with these columns, each another motion, and a time where one is named."""
    table = {one: (k + 1.0) * np.sin((1.0 + 0.37 * k) * T + k) for k, one in enumerate(headings)}
    for one in headings:
        if re.match(r"[# _]*(timeus|time|timestamp|t)(?![a-z])", one, re.IGNORECASE):
            return {**table, one: T.copy()}
    return table


@pytest.mark.filterwarnings("ignore::dryfric_control.RecordWarning")
@pytest.mark.parametrize(("line", "headings"), LOGS)
def test_a_public_log_is_read_or_refused_with_the_line_to_copy(line, headings):
    marked = [one.rpartition("=") for one in headings.split("; ")]
    table = source([name for *_, name in marked])
    if line:
        with pytest.raises(ValueError) as refused:
            dfc.read_record(table)
        said = re.search(r"read_record\(source, (.*)\)$", str(refused.value))
        assert said and said[1] == line
    if "..." in line:
        return  # what only the user knows
    record = eval(f"dfc.read_record(table, {line})")
    channels = {"t": record.t, "u": record.u, "x": record.x, "r": record.reference}
    for mark, _, name in marked:
        if mark:
            # A unit in the heading is a factor.
            assert abs(np.corrcoef(channels[mark], table[name])[0, 1]) > 1.0 - 1e-9, name
    taken = {mark for mark, *_ in marked if mark}
    none = {"u"} if "None" in line else set()
    assert taken | none >= {"t", "u", "x"} and ("r" in taken) == (record.reference is not None)


# Headings in other languages, marked as above, the wanted one after the one that was asked for.
SPOKEN = [
    "t=tiempo; u=fuerza medida; r=posición deseada; x=posición medida",
    "t=temps; force consigne; u=force mesurée; r=consigne de position; x=position mesurée",
    "t=tempo; u=forza; r=posizione comandata; x=posizione misurata",
    "t=tempo; u=força; r=posição desejada; x=posição",
    "t=tijd; u=kracht; r=gewenste positie; x=verplaatsing",
    "t=Zeit; u=Kraft; x=Auslenkung",
    "t=temps; u=effort; x=déplacement",
    "t=tempo; u=coppia; x=spostamento",
    "t=tempo; u=coppia; x=quota reale; r=quota teorica",
    "t=tiempo; u=par; x=posición; velocidad",
    "t=czas; u=prąd; x=położenie",
    "t=采样时间; r=指令位置; x=实际位置; u=实际转矩; 位置偏差",
    "t=时间; x=电机位置; 电机速度; u=电机电流; 母线电压",
    "t=時間; r=位置指令; x=現在位置; u=トルク",
    "t=時間; x=フィードバック位置; u=モータ電流; 位置偏差",
    "t=시간; r=목표위치; x=현재위치; u=토크",
]


@pytest.mark.parametrize("headings", SPOKEN)
def test_measured_and_commanded_are_told_apart_in_each_language(headings):
    marked = [one.rpartition("=") for one in headings.split("; ")]
    table = source([name for *_, name in marked])
    table[marked[0][2]] = T.copy()
    record = dfc.read_record(table)
    channels = {"t": record.t, "u": record.u, "x": record.x, "r": record.reference}
    for mark, _, name in marked:
        if mark:
            np.testing.assert_allclose(channels[mark], table[name], err_msg=name)


@pytest.mark.parametrize(
    ("role", "headings"),
    [
        ("x", "time; torque; position error"),
        ("x", "time; torque [N m]; following error [mm]"),
        ("x", "Zeit; Kraft; Schleppfehler [mm]"),
        ("x", "tempo; forza; errore posizione"),
        ("u", "time; torque limit; position"),
        ("u", "time [s]; friction torque [N m]; position"),
    ],
)
def test_an_error_or_a_limit_is_not_taken_for_the_channel(role, headings):
    table = source(headings.split("; "))
    table[next(iter(table))] = T.copy()
    with pytest.raises(ValueError, match=f"no column recognised as {role}") as refused:
        dfc.read_record(table)
    assert f'columns={{"{role}": ' in str(refused.value)


LETTERS = {
    "t [s], F [N], x [m]": ("u", "F [N]", "by its letter"),
    "t,F,x": ("u", "F", "by its letter"),
    "t [s],u [N],s [mm]": ("x", "s [mm]", "by its letter"),
    "t,p [bar],x [mm]": ("u", "p [bar]", "by its letter"),
    "t [s],Zylinderdruck [bar],Weg [mm]": ("u", "Zylinderdruck [bar]", "in a unit of pressure"),
    "t,u,carriage [mm]": ("x", "carriage [mm]", "in a unit of length"),
    "Messzeit [ms],Kraft,Weg": ("t", "Messzeit [ms]", "in a unit of time"),
}


@pytest.mark.parametrize("line", LETTERS)
def test_what_a_letter_or_a_unit_shows_is_taken_and_noted(line, tmp_path):
    role, heading, why = LETTERS[line]
    path = tmp_path / "run.csv"
    rows = "\n".join(f"{t:.2f},{np.sin(t):.6f},{np.cos(2 * t):.6f}" for t in T)
    path.write_text(f"{line}\n{rows}\n")
    record = dfc.read_record(path)
    assert any(f"{heading!r} taken as {role}" in note and why in note for note in record.notes)
    assert len(record) == N


def test_a_quantity_over_its_unit_and_a_unit_behind_any_name_are_read():
    """I/A is the way of ISO 80000-1; mA, deg and mm are no words."""
    record = dfc.read_record({"t/ms": 1e3 * T, "I/A": np.sin(T), "x/µm": np.cos(T)})
    assert record.units == {"t": "s", "u": "A", "x": "m"} and record.x[0] == 1e-6
    record = dfc.read_record({"t_s": T, "Cur_mA": np.sin(T), "disp_mm": np.cos(T), "n_rpm": T})
    assert record.units == {"t": "s", "u": "A", "x": "m"} and record.x[0] == 1e-3
    assert sum("the only column in a unit of" in note for note in record.notes) == 2
    record = dfc.read_record({"t (s)": T, "Effort (daN)": np.sin(T), "POS_DEG": np.cos(T)})
    assert record.units["x"] == "rad" and record.u[7] == 10.0 * np.sin(T[7])


@pytest.mark.parametrize(
    "heading",
    ["Hubkraft [N]", "Hubkraft (N)", "Hubkraft / N", "Hubkraft/N", "Hubkraft_N", "Hubkraft in N"],
)
def test_a_unit_is_one_however_it_stands_behind_a_name_that_is_not_known(heading):
    record = dfc.read_record({"t": T, heading: np.sin(T), "Spindelweg / mm": np.cos(T)})
    assert record.units == {"t": "s", "u": "N", "x": "m"} and record.x[0] == 1e-3
    assert f"{heading!r} taken as u: the only column in a unit of force" in record.notes
    # Two that fit are told, each with its line.
    with pytest.raises(ValueError, match="could each be u") as refused:
        dfc.read_record({"t": T, heading: np.sin(T), "Last_N": np.sin(2 * T), "x": np.cos(T)})
    assert f'columns={{"u": {heading!r}}} or columns={{"u": \'Last_N\'}}' in str(refused.value)


@pytest.mark.parametrize(
    ("heading", "parts"),
    [
        ("Last_N_m", ("Last", "N m")), ("swing_rad_s2", ("swing", "rad/s2")),
        ("Ausgang in lbf", ("Ausgang", "lbf")), ("swing / (rad/s)", ("swing", "rad/s")),
        # Words, labels and parts of a path are no units.
        ("Sensor_A", None), ("wheel_nm", None), ("flange_min", None), ("lift_rev", None),
        ("arm/bench/m", None), ("arm/rev", None), ("N/A", None), ("plug in bay", None),
        ("force_n", None), ("_N", None), ("tau_m", None),
    ],
)  # fmt: skip
def test_a_word_or_a_label_behind_a_name_is_no_unit(heading, parts):
    assert split_header(heading) == (parts or (heading, ""))


@pytest.mark.parametrize(
    ("columns", "headings"),
    [
        ({"u": ...}, "Time; T; theta"),  # T may be the torque: not "none"
        ({"x": "Weg1"}, "Zeit; Weg1; Weg2; Kraft"),  # the one drive is of no joint
    ],
)
def test_the_line_to_copy_loses_no_drive(columns, headings):
    table = source(headings.split("; "))
    table[next(iter(table))] = T.copy()
    with pytest.raises(ValueError) as refused:
        dfc.read_record(table)
    role, name = next(iter(columns.items()))
    shown = "..." if name is ... else f'"{name}"'
    assert f'"{role}": {shown}}})' in str(refused.value)
    assert "joint=" not in str(refused.value).rpartition("read_record(")[2]


def test_columns_of_one_joint_go_before_another_usual_name():
    """The angle phi beside pos_x and pos_y is none of the axis whose current is asked for."""
    names = ["time", "pos_x", "pos_y", "phi", "curr_x", "curr_y"]
    table = source(names)
    record = dfc.read_record(table, columns={"u": "curr_x"})
    np.testing.assert_array_equal(record.x, table["pos_x"])


@pytest.mark.parametrize(
    ("encoding", "heading"),
    [
        ("cp932", "時間(ms),位置指令(mm),現在位置(mm),トルク(%)"),
        (
            "cp932",
            "時間\uff3bms\uff3d,指令位置\uff3bmm\uff3d,実位置\uff3bmm\uff3d,モータ電流\uff3bA\uff3d",
        ),
        ("gb18030", "采样时间(ms),指令位置(mm),实际位置(mm),实际转矩(%)"),
        (
            "gb18030",
            "时间\uff08ms\uff09,目标位置\uff08mm\uff09,反馈位置\uff08mm\uff09,电流\uff08A\uff09",
        ),
        ("big5", "時間(ms),目標位置(mm),位置(mm),電流(A)"),
        ("euc_kr", "시간(ms),목표위치(mm),현재위치(mm),토크(%)"),
        ("cp1251", "время (ms),r (mm),положение (mm),момент (%)"),
        ("latin-1", "Zeit (ms),Sollwert (mm),Länge über Maß (mm),Drehmoment (%)"),
    ],
)
def test_headings_of_old_encodings_are_read(tmp_path, encoding, heading):
    path = tmp_path / "run.csv"
    rows = "\n".join(
        f"{1e3 * t:.0f},{np.sin(3 * t):.6f},{np.cos(2 * t):.6f},{np.sin(t):.6f}" for t in T
    )
    path.write_bytes(f"{heading}\n{rows}\n".encode(encoding))
    record = dfc.read_record(path)
    np.testing.assert_allclose(record.t, T, atol=1e-9)
    np.testing.assert_allclose(record.x, 1e-3 * np.cos(2 * T), atol=1e-9)
    np.testing.assert_allclose(record.u, np.sin(T), atol=1e-6)
    np.testing.assert_allclose(record.reference, 1e-3 * np.sin(3 * T), atol=1e-9)
    assert record.units["x"] == "m"


def test_the_position_of_a_valve_is_in_per_cent():
    record = dfc.read_record({"t": T, "p [bar]": np.sin(T), "stem [%]": 50.0 * np.cos(T)})
    assert record.units["x"] == "%"
    record = dfc.read_record({"t": T, "trq [0.1 %]": np.sin(T), "pos": np.cos(T)})
    assert record.raw["u"] == ("0.1 %", 0.1) and record.units["u"] == "%"


def test_of_two_that_fit_both_are_shown_with_a_line_each():
    table = {"t [s]": T, "front [N]": np.sin(T), "rear [N]": np.cos(3.0 * T), "x [m]": np.cos(T)}
    with pytest.raises(ValueError, match="'front', 'rear' could each be u") as refused:
        dfc.read_record(table)
    for name in ("front [N]", "rear [N]"):
        assert f'columns={{"u": {name!r}}}' in str(refused.value)
    record = dfc.read_record(table, columns={"u": "rear [N]"})
    np.testing.assert_array_equal(record.u, np.cos(3.0 * T))


def test_metres_beside_radians_are_no_milliradians():
    """theta_m_rad is the angle of a motor in rad."""
    record = dfc.read_record({"t": T, "u": np.sin(T), "theta_rad": np.cos(T)})
    assert record.x[7] == np.cos(T[7])
    table = {"t": T, "u": np.sin(T), "theta_m_rad": np.cos(T)}
    record = dfc.read_record(table, columns={"x": "theta_m_rad"})
    assert record.x[7] == np.cos(T[7]) and record.units["x"] == "rad"
