"""Units end to end: names, factors of the machine, and records held against axes."""

import inspect
import math
import warnings

import numpy as np
import pytest

import dryfric_control as dfc
from dryfric_control.units import si_unit

T = 1e-3 * np.arange(2000)
U = 20.0 * np.sin(6.0 * T) + 12.0 * np.sin(17.0 * T)
AXIS = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
X = AXIS.simulate(U, dt=1e-3).y[0]
LBF = 4.4482216152605  # 0.45359237 kg times 9.80665 m/s^2


@pytest.mark.parametrize(
    ("role", "unit", "factor", "si"),
    [
        ("x", "in", 0.0254, "m"), ("x", "ft", 0.3048, "m"), ("x", "µm", 1e-6, "m"),
        ("x", "deg", math.pi / 180, "rad"), ("x", "rev", 2 * math.pi, "rad"),
        ("x", "counts", 1.0, "counts"), ("x", "inc", 1.0, "counts"),
        ("u", "lbf", LBF, "N"), ("u", "kNm", 1e3, "N m"), ("u", "N·m", 1.0, "N m"),
        ("u", "lbf-in", LBF * 0.0254, "N m"),
        ("u", "mA", 1e-3, "A"), ("u", "%", 1.0, "%"), ("u", "‰", 0.1, "%"),
        ("v", "rpm", math.pi / 30, "rad/s"), ("v", "mm/min", 1e-3 / 60, "m/s"),
        ("v", "tr/min", math.pi / 30, "rad/s"), ("v", "U/min", math.pi / 30, "rad/s"),
        ("v", "giri/min", math.pi / 30, "rad/s"), ("v", "1/min", math.pi / 30, "rad/s"),
        ("x", "grados", math.pi / 180, "rad"), ("x", "Inkremente", 1.0, "counts"),
        ("u", "0,1%", 0.1, "%"), ("u", "0,1 A", 0.1, "A"), ("x", "0.01 mm", 1e-5, "m"),
        ("u", "0.01Nm", 0.01, "N m"), ("t", "10 us", 1e-5, "s"),
        ("a", "g", 9.80665, "m/s^2"),
        ("x", "meters", 1.0, "m"), ("x", "Millimetre", 1e-3, "m"), ("x", "radians", 1.0, "rad"),
        ("x", "度", math.pi / 180, "rad"), ("x", "mdeg", math.pi / 180e3, "rad"),
        ("u", "newton", 1.0, "N"), ("u", "Newton metres", 1.0, "N m"), ("u", "N・m", 1.0, "N m"),
        ("u", "cNm", 1e-2, "N m"), ("u", "daN", 10.0, "N"), ("u", "kilonewtons", 1e3, "N"),
        ("t", "secondes", 1.0, "s"), ("t", "segundos", 1.0, "s"), ("t", "Sekunden", 1.0, "s"),
        ("t", "秒", 1.0, "s"), ("t", "毫秒", 1e-3, "s"), ("t", "milliseconds", 1e-3, "s"),
        ("v", "meters per second", 1.0, "m/s"), ("v", "degrees/second", math.pi / 180, "rad/s"),
    ],
)  # fmt: skip
def test_units_are_known_by_their_names(role, unit, factor, si):
    assert si_unit(role, unit) == (pytest.approx(factor, rel=1e-15), si)


@pytest.mark.parametrize("role", ["t", "u", "x", "v", "a", "x2"])
@pytest.mark.parametrize("unit", ["MM", "Ft", "furlong", "kg", "N/m", "1", "foo", "2 mm", "0.5 N"])
def test_an_unknown_unit_is_never_taken_with_factor_1(role, unit):
    with pytest.raises(ValueError, match=rf"unit '{unit}' of .* not known.*use "):
        dfc.read_record({"t": T, "u": U, "x": X, "v": X, "a": X, "x2": X}, units={role: unit})


@pytest.mark.parametrize(
    ("role", "unit", "meant"),
    [
        ("u", "KN", "kN"), ("x", "MM", "mm"), ("u", "kilonewten", "kilonewton"),
        ("u", "mn", ""),  # mN or MN
        ("u", "cNn", ""), ("x", "mdegg", ""), ("x", "picometer", ""), ("u", "permil", ""),
        ("x", "kilometer", ""), ("x", "grad", ""),  # 1/400 of a turn is no Grad
    ],
)  # fmt: skip
def test_a_hint_at_a_unit_is_of_its_size_and_quantity(role, unit, meant):
    with pytest.raises(ValueError, match=f"'{unit}' of {role} is not known") as refused:
        si_unit(role, unit)
    hint = f"Did you mean '{meant}'?"
    assert hint in str(refused.value) if meant else "Did you mean" not in str(refused.value)


def test_words_of_units_are_read_in_headings():
    table = {"Zeit (Sekunden)": T, "Kraft [Newton]": U, "Weg in Millimeter": 1e3 * X}
    record = dfc.read_record(table)
    assert record.units == {"t": "s", "u": "N", "x": "m"}
    np.testing.assert_allclose(record.x, X)
    record = dfc.read_record({"时间(毫秒)": 1e3 * T, "扭矩[N・m]": U, "角度(度)": X})
    assert record.units == {"t": "s", "u": "N m", "x": "rad"} and record.dt == 1e-3


def test_a_stated_unit_stands_in_for_one_of_a_heading_that_is_not_known(tmp_path):
    source = tmp_path / "run.csv"
    np.savetxt(
        source, np.stack([T, U, X, X], axis=1), "%.17g", ";", header="t;u (hN);x;Vitesse (tours)",
        comments="",
    )  # fmt: skip
    with pytest.raises(ValueError, match=r"unit 'hN' of u is not known.* units=.\"u\": \"...\""):
        dfc.read_record(source)
    record = dfc.read_record(source, units={"u": "N"})
    np.testing.assert_array_equal(record.u, U)
    assert record.units["u"] == "N" and "u is in N, as stated, not in 'hN'" in record.notes
    # A velocity is left out for its unit, and it is said how to have it.
    mend = 'to read it, columns={"v": \'Vitesse (tours)\'}, units={"v": "..."}'
    assert any(note.endswith(mend) for note in record.notes)
    stated = {"columns": {"v": "Vitesse (tours)"}, "units": {"u": "N", "v": "rpm"}}
    record = dfc.read_record(source, **stated)
    np.testing.assert_allclose(record.channels["v"], X * math.pi / 30)


@pytest.mark.parametrize(("role", "unit"), [("x", "s"), ("u", "mm"), ("u", "rad"), ("v", "m")])
def test_a_unit_of_another_quantity_is_refused(role, unit):
    with pytest.raises(ValueError, match=f"{role} cannot be in '{unit}', a unit of"):
        dfc.Record(T, U, X, units={role: unit})


def test_counts_turns_gear_and_lead_make_a_position():
    counts = np.round(1e5 * np.sin(3.0 * T))
    scaling = dfc.Scaling(counts_per_turn=4096, gear_ratio=4.0, lead=5e-3, torque_constant=0.05)
    record = dfc.read_record(
        {"t": T, "u [mA]": 1e3 * U, "x [counts]": counts, "r [rev]": counts / 4096}, gain=scaling
    )
    turns = counts / 4096 / 4.0
    np.testing.assert_allclose(record.x, 5e-3 * turns)
    np.testing.assert_allclose(record.reference, record.x)
    # Power is the same on both sides of gear and screw: torque times turning is force times way.
    np.testing.assert_allclose(record.u * 5e-3, 0.05 * U * 4.0 * 2 * math.pi)
    assert record.units["x"] == "m" and record.units["u"] == "N"
    assert record.raw["x"] == ("counts", pytest.approx(5e-3 / 4096 / 4.0))
    assert record.quantum == pytest.approx(5e-3 / 4096 / 4.0)
    # An encoder on the load knows no gear.
    load = dfc.Scaling(counts_per_turn=1000, gear_ratio=50.0, load_encoder=True)
    record = dfc.read_record({"t": T, "u": U, "x": counts}, gain=load)
    np.testing.assert_allclose(record.x, counts / 1000 * 2 * math.pi)


@pytest.mark.parametrize(
    ("options", "stored", "factor", "unit"),
    [
        ({"rated_torque": 1.27}, "u [%]", 1.27e-2, "N m"),
        ({"rated_torque": 1.27, "gear_ratio": 10}, "u [permille]", 1.27e-2, "N m"),
        ({"rated_force": 200.0}, "u [%]", 2.0, "N"),
        ({"rated_force": 200.0}, "u", 2.0, "N"),
        ({"force_constant": 38.0}, "u [A]", 38.0, "N"),
        ({"torque_constant": 0.2, "gear_ratio": 50}, "u", 10.0, "N m"),
        ({"gear_ratio": 50}, "u [N m]", 50.0, "N m"),
    ],
)
def test_per_cent_and_current_make_a_force(options, stored, factor, unit):
    record = dfc.read_record({"t": T, stored: U, "x": X}, gain=dfc.Scaling(**options))
    np.testing.assert_allclose(record.u, factor * U, rtol=1e-12)
    assert record.units["u"] == unit and record.raw["u"][1] == pytest.approx(factor)


@pytest.mark.parametrize(
    "heading",
    [
        "iq",
        "Motorstrom",
        "current",
        "iq_meas",
        "Iststrom",
        "电机电流",
        "モータ電流",
        "I",
        "corriente",
    ],
)
def test_a_current_is_no_force(heading):
    table = {"t": T, heading: U, "x": X}
    with pytest.warns(dfc.RecordWarning, match=f"'{heading}' is a current.*torque_constant="):
        record = dfc.read_record(table)
    assert record.units["u"] == "A" and f"u is in A: {heading!r} is a current" in record.notes
    assert any("the drive is a current" in message for message in record.check().messages)
    with pytest.raises(ValueError, match="u is in 'A', the axis has 'N'"):
        dfc.replay(AXIS, record)
    # Whoever says what it is, is not told.
    with warnings.catch_warnings(action="error"):
        said = dfc.read_record(table, gain=dfc.Scaling(force_constant=38.0))
        assert said.units["u"] == "N" and said.raw["u"] == ("A", 38.0)
        assert dfc.read_record(table, gain=dfc.Scaling(rated_torque=2.0)).raw["u"][0] == "%"
        assert "u" not in dfc.read_record(table, gain=35.0).units
        assert dfc.read_record(table, units={"u": "N"}).units["u"] == "N"
        assert "u" not in dfc.read_record({"t": T, "torque": U, "x": X}).units


@pytest.mark.parametrize(
    "heading", ["voltage", "motor_voltage", "Spannung", "voltage.q", "Motorspannung"]
)
def test_a_voltage_is_no_force(heading):
    table, which = {"t": T, heading: U, "x": X}, {"u": heading}
    with pytest.warns(dfc.RecordWarning, match=rf"'{heading}' is a voltage.*\[N/V\]"):
        record = dfc.read_record(table, which)
    assert record.units["u"] == "V" and f"u is in V: {heading!r} is a voltage" in record.notes
    assert any("the drive is a voltage" in message for message in record.check().messages)
    with pytest.raises(ValueError, match="u is in 'V', the axis has 'N'"):
        dfc.replay(AXIS, record)
    with warnings.catch_warnings(action="error"):
        assert "u" not in dfc.read_record(table, which, gain=35.0).units
        assert dfc.read_record(table, which, units={"u": "N"}).units["u"] == "N"


@pytest.mark.parametrize("heading", ["pressure", "Druck", "Zylinderdruck", "pression"])
def test_a_pressure_without_a_unit_is_taken_as_a_force_and_that_is_said(heading):
    """It may be in bar or in pascals: no unit of a pressure can be assumed."""
    table, which = {"t": T, heading: U, "x": X}, {"u": heading}
    with pytest.warns(dfc.RecordWarning, match=f"'{heading}' is a pressure.*taken as N.*piston"):
        record = dfc.read_record(table, which)
    assert "u" not in record.units
    (note,) = [one for one in record.notes if "is a pressure" in one]
    assert note.startswith("u is taken as N: ") and "piston_area=" in note
    with warnings.catch_warnings(action="error"):
        area = dfc.Scaling(piston_area=2e-3)
        said = dfc.read_record(table, which, gain=area, units={"u": "bar"})
        assert said.units["u"] == "N" and said.raw["u"] == ("bar", pytest.approx(200.0))
        assert dfc.read_record(table, which, units={"u": "N"}).units["u"] == "N"
        bare = dfc.read_record(table, which, units={"u": "bar"})
    assert any("the drive is a pressure" in message for message in bare.check().messages)


@pytest.mark.parametrize("heading", ["pwm", "duty", "duty_cycle", "PWM duty"])
def test_a_duty_cycle_without_a_unit_is_taken_as_a_force_and_that_is_said(heading):
    table = {"t": T, heading: U, "x": X}
    said = f"'{heading}' is a duty cycle, not a force, and is taken as N: give the force"
    with pytest.warns(dfc.RecordWarning, match=said):
        record = dfc.read_record(table)
    assert any("is a duty cycle without a unit" in note for note in record.notes)
    with warnings.catch_warnings(action="error"):
        np.testing.assert_allclose(dfc.read_record(table, gain={"u": 12.0}).u, 12.0 * U)
        assert dfc.read_record(table, units={"u": "N"}).units["u"] == "N"


@pytest.mark.parametrize("heading", ["force", "Druckkraft", "Presskraft", "torque", "u"])
def test_a_force_is_no_pressure(heading):
    with warnings.catch_warnings(action="error"):
        record = dfc.read_record({"t": T, heading: U, "x": X}, {"u": heading})
    assert "u" not in record.units and not any("taken as" in note for note in record.notes)


def test_a_velocity_without_a_unit_that_makes_the_position_is_told():
    table = {"t": T, "u [N m]": U, "speed": X}
    said = r"v has no unit: taken in rad/s; give it, units=\{\"v\": \"rpm\"\}"
    with pytest.warns(dfc.RecordWarning, match=said):
        record = dfc.read_record(table)
    assert any(note.startswith("v has no unit: taken in rad/s") for note in record.notes)
    with pytest.warns(dfc.RecordWarning, match="integral of the velocity$"):
        turned = dfc.read_record(table, units={"v": "rpm"})
    assert turned.units["v"] == "rad/s" and not any("no unit" in note for note in turned.notes)
    with warnings.catch_warnings(action="error"):
        quiet = dfc.read_record(table, {"x": None})
    assert any(note.startswith("v has no unit: taken in rad/s") for note in quiet.notes)


def test_the_force_of_an_axis_that_turns_is_a_torque():
    counts = np.round(1e5 * X)
    record = dfc.read_record({"t": T, "u": U, "x": counts}, gain=dfc.Scaling(counts_per_turn=4096))
    assert "none stated for u: taken as those of the axis (N m by default)" in record.summary()
    record = dfc.read_record({"t": T, "u [N m]": U, "x": X})
    assert "none stated for x: taken as those of the axis (rad by default)" in record.summary()


LOOP = dfc.PositionController.from_bandwidth(AXIS, 20.0, dt=1e-3)
DESIGN = dfc.design_pi_observer(AXIS, dt=1e-3)
#: How each public name is called that takes a record and an axis, or what holds one.
TAKES = {
    "diagnose": lambda axis, record: dfc.diagnose(axis, record),
    "diagnose_batch": lambda axis, record: dfc.diagnose_batch(axis, {"a": record}, progress=False),
    "fit": lambda axis, record: dfc.fit(axis, [record]),
    "identify_coulomb": lambda axis, record: dfc.identify_coulomb(record, axis=axis),
    "identify_stribeck": lambda axis, record: dfc.identify_stribeck(axis, record),
    "next_experiment": lambda axis, record: dfc.next_experiment(axis, [axis], record),
    "observe": lambda axis, record: dfc.observe(DESIGN, record),
    "replay": lambda axis, record: dfc.replay(axis, record),
    "replay_loop": lambda axis, record: dfc.replay_loop(axis, record, LOOP),
}


def test_the_table_names_every_public_function_that_takes_an_axis_and_a_record():
    functions = {name: one for name in dfc.__all__ if inspect.isfunction(one := getattr(dfc, name))}
    asked = {name: {*inspect.signature(one).parameters} for name, one in functions.items()}
    # One that makes the axis of a record takes its units from it.
    takes = {name for name in asked if asked[name] & {"record", "records"}} - {"axis_from"}
    assert takes <= set(TAKES)


@pytest.mark.parametrize("units", [{"x": "rad"}, {"u": "N m"}, {"x": "counts"}, {"u": "V"}])
@pytest.mark.parametrize("name", TAKES)
def test_a_record_in_other_units_than_the_axis_is_refused(name, units):
    record = dfc.Record(T, U, X, X, units=units)
    (role, unit), wanted = *units.items(), {"x": "m", "u": "N"}
    words = rf"{role} is in '{unit}', the axis has '{wanted[role]}'.*gain="
    with pytest.raises(ValueError, match=words):
        TAKES[name](AXIS, record)


def test_an_axis_with_an_input_gain_takes_a_drive_in_any_unit():
    axis = AXIS.replace(effects=(dfc.effects.InputGain(0.2),))
    dfc.replay(axis, dfc.Record(T, U, X, units={"u": "V"}))
    with pytest.raises(ValueError, match="or an effect InputGain .N per V"):
        dfc.replay(AXIS, dfc.Record(T, U, X, units={"u": "V"}))
    with pytest.raises(ValueError, match="x is in 'rad'"):
        dfc.replay(axis, dfc.Record(T, U, X, units={"x": "rad"}))


@pytest.mark.parametrize(
    ("wrong", "right"),
    [
        ("pitch", r"give lead=, Travel of a linear axis per turn of the load \[m\]"),
        ("counts_per_rev", "give counts_per_turn=, Encoder counts per turn"),
        ("kt", r"give torque_constant=, Torque .*\[N m/A\]"),
        ("torque_constnat", "Did you mean 'torque_constant'"),
        ("foo", "it has gain, counts_per_turn"),
    ],
)
def test_a_wrong_argument_of_a_scaling_is_told_the_right_one(wrong, right):
    with pytest.raises(TypeError, match=f"Scaling has no argument {wrong!r}.*{right}"):
        dfc.Scaling(**{wrong: 0.01})


def test_a_heading_in_place_of_a_channel_is_told_its_channel():
    source = {"t": T, "u": U, "posición": X}
    for wrong in ({"units": {"posición": "mm"}}, {"columns": {"Position": "posición"}}):
        with pytest.raises(
            ValueError, match="Did you mean 'x', the channel that '(posición|Position)' is"
        ):
            dfc.read_record(source, **wrong)
