"""A record of another unit, sign or column is told before it is taken for friction."""

import re
import warnings

import numpy as np
import pytest
from diagnosis_cases import among

import dryfric_control as dfc
from dryfric_control.estimation.plausibility import (
    check_plausible,
    record_doubts,
    warn_if_implausible,
)

AXIS = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0, travel=(-0.05, 0.25))
T = 1e-3 * np.arange(4000)
U = 20.0 * np.sin(6.0 * T)
X = 1e-6 * np.round(1e6 * AXIS.simulate(U, dt=1e-3).y[0])


@pytest.mark.parametrize(
    ("u", "x", "words"),
    [
        (U, 1e3 * X, r"positions run from .* the axis' travel is .* such as mm"),
        (U, X + 3.0, "counted from elsewhere"),
        (-U, X, "takes energy out of the machine .* sign of u or x reversed"),
        (U, 0.2 - X, "takes energy out of the machine"),
        (1e-3 * U, X, r"Coulomb level is 0.00\d+ N, in the axis 2 kg and 8 N: u seems to be in kN"),
    ],
)
def test_what_cannot_be_of_this_axis_is_told(u, x, words):
    record = dfc.Record(T, u, x)
    with pytest.warns(dfc.RecordWarning, match=words):
        warn_if_implausible(AXIS, record)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        dfc.fit(AXIS, record, anyway=True)
    ours = [w for w in caught if w.category is dfc.RecordWarning]
    assert ours and all(w.filename == __file__ for w in ours)


def test_swapped_columns_are_told():
    with pytest.warns(dfc.RecordWarning, match="exchanged"):
        warn_if_implausible(AXIS.replace(travel=None, coulomb=0.1), dfc.Record(T, X, U))


@pytest.mark.parametrize("scale", [1.0, 1e3, -1e3, 1e-4])
def test_swapped_columns_stop_in_any_unit_and_sign(scale):
    """What a motion shows of mass and friction depends on neither."""
    u = 20.0 * np.sin(6.0 * T) + 12.0 * np.sin(17.0 * T + 1.0)
    x = 1e-6 * np.round(1e6 * AXIS.simulate(u, dt=1e-3).y[0])
    swapped = dfc.Record(T, scale * x, u)
    for find in (dfc.axis_from, lambda r: dfc.diagnose(AXIS.replace(travel=None), r)):
        with pytest.raises(
            ValueError, match='exchanged.*columns={"u"|exchanged.*drive as record.u'
        ):
            find(swapped)
    assert not record_doubts(AXIS, dfc.Record(T, u, x))


def test_a_motion_far_beyond_its_drive_is_told():
    axis = AXIS.replace(travel=None)
    # Too short to regress the drive on: only the largest forces can be compared.
    far, weak = dfc.Record(T[:90], U[:90], 1e3 * X[:90]), dfc.Record(T[:90], 1e-3 * U[:90], X[:90])
    with pytest.warns(
        dfc.RecordWarning, match=r"the motion needs about .* drive is at most 10\.2 N"
    ):
        warn_if_implausible(axis, far)
    with pytest.warns(dfc.RecordWarning, match=r"most 0.0102 N and moves an axis .* least 8 N"):
        warn_if_implausible(axis, weak)
    assert not any(doubt.proof for doubt in (*record_doubts(axis, far), *record_doubts(axis, weak)))
    scaled = axis.replace(effects=dfc.effects.InputGain(1e3))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warn_if_implausible(scaled, dfc.Record(T, U, 1e3 * X))


FREE = AXIS.replace(travel=None)
TURNING = dfc.FrictionAxis(inertia=2.0, viscous=15.0, coulomb=8.0)
REVERSED = r"-1.9\d kg .* -7.8\d N, .*wrong sign.*gain=-1\) turns the drive, .*'x': -1.0"


@pytest.mark.parametrize(
    ("axis", "t", "u", "x", "words"),
    [
        (AXIS, T, -U, X, REVERSED),
        (AXIS, T, U, 0.2 - X, REVERSED),
        (TURNING, T, -U, X, r"inertia is -1.9\d kg m\^2 .* wrong sign"),
        (FREE, T, U, 1e3 * X, r'0.0019\d kg .*, in the axis 2 kg and 8 N: .*units={"x": "mm"}'),
        (FREE, T, 1e-3 * U, X, r'u seems to be in kN, .*units={"u": "kN"}'),
        (FREE, T, 1e3 * U, X, r'u seems to be in mN, .*units={"u": "mN"}'),
        (TURNING, T, 1e-3 * U, X, r'inertia is .* 2 kg m\^2 and 8 N m: .*units={"u": "kN m"}'),
        (FREE, T, U, 20.0 * X, None),
        (FREE.replace(mass=100.0, coulomb=0.5), T, U, X, None),
    ],
)
@pytest.mark.filterwarnings("ignore")
def test_a_certain_sign_or_unit_stops_with_what_to_type(axis, t, u, x, words):
    record = dfc.Record(t, u, x)
    if words is None:  # a nominal axis far off, but by no unit
        return check_plausible(axis, record)
    for estimate in (dfc.fit, dfc.diagnose):
        with pytest.raises(ValueError, match=f"^record: .*{words}.*; anyway=True goes on"):
            estimate(axis, record)
    other = dfc.Record(T, U, X) if axis is AXIS else record[:3900]
    with pytest.raises(ValueError, match=rf"^record\[{int(axis is AXIS)}\]: .*{words}"):
        dfc.fit(axis, [other, record])
    check_plausible(axis, record, anyway=True)


def test_a_wrong_unit_of_the_axis_is_not_looked_for_in_stated_units():
    stated = dfc.Record(T, U, X, units={"x": "m", "u": "N"})
    with pytest.raises(ValueError, match=r"2e\+03 kg and 8 N: a unit is wrong.*dfc.axis_from\(rec"):
        dfc.fit(FREE.replace(mass=2000.0), stated)


def test_a_rotor_that_the_model_of_a_joint_lacks_is_thought_of():
    # As in models of robots without `armature`: friction is right, the inertia a hundredth.
    stated = dfc.Record(T, U, X, units={"x": "rad", "u": "N m"})
    joint = FREE.replace(mass=0.01, units=("rad", "N m"))
    with pytest.raises(ValueError, match="inertia of the axis lacks a part, as of a rotor behind"):
        dfc.fit(joint, stated)


def test_other_units_of_axis_and_record_alike_are_no_wrong_unit():
    # A million times faster than metres a second: the axis says that it is so.
    with pytest.warns(dfc.RecordWarning, match="x has no unit"):
        check_plausible(FREE.replace(mass=2e-6, viscous=15e-6), dfc.Record(T, U, 1e6 * X))


def test_milliseconds_taken_for_seconds_stop():
    with pytest.warns(dfc.RecordWarning, match="milliseconds"):
        slow = dfc.Record(1e3 * T, U, X)
    with pytest.raises(ValueError, match=r't seems to be in ms, .*units={"t": "ms"}'):
        check_plausible(FREE, slow)


def test_a_gain_to_be_found_is_no_wrong_unit():
    amperes = dfc.Record(T, 5e-3 * U, X)
    with pytest.raises(ValueError, match="a unit is wrong|seems to be in"):
        dfc.fit(FREE, amperes, free=("viscous",))
    found = dfc.fit(FREE.replace(effects=dfc.effects.InputGain(200.0)), amperes, free=("viscous",))
    assert found.axis.viscous == pytest.approx(15.0, rel=0.01)
    with pytest.warns(dfc.RecordWarning, match="is u in another unit, such as V"):
        check_plausible(FREE, amperes, gain_free=True)


@pytest.mark.filterwarnings("ignore::dryfric_control.FitWarning")
def test_what_brakes_a_weight_on_its_way_down_has_the_right_sign():
    """One way only, a constant force and the Coulomb level are one; the mass decides."""
    v = -0.1 - 0.05 * np.sin(9.0 * T)
    x = np.cumsum(v) * 1e-3
    u = 2.0 * np.gradient(v, 1e-3) + 15.0 * v - 8.0 + 60.0
    record = dfc.Record(T, u, x)
    assert [doubt.proof for doubt in record_doubts(FREE, record)] == [""]
    assert "takes energy out" in record_doubts(FREE, record)[0].message
    assert dfc.axis_from(record).mass == pytest.approx(2.0, rel=0.05)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_a_certain_doubt_is_one_bad_case_of_a_batch(tmp_path):
    records = {"good": dfc.Record(T, U, X), "bad": dfc.Record(T, -U, X)}
    options = dict(store=tmp_path / "batch.jsonl", progress=False)
    with among("spring"):
        found = dfc.diagnose_batch(AXIS, records, **options)
        joints = dfc.diagnose_joints({n: (AXIS, r) for n, r in records.items()}, progress=False)
        told = dfc.diagnose_batch(AXIS, records, anyway=True, **options)
        again = dfc.diagnose_batch(AXIS, records, **options)
    assert found["good"]["verdict"] == joints["good"].verdict == "nothing to find"
    assert (
        found["bad"]["verdict"] == "not diagnosed" and "records['bad']: " in found["bad"]["reason"]
    )
    assert re.search(REVERSED, found["bad"]["reason"]) and re.search(REVERSED, joints.failed["bad"])
    assert told["bad"]["verdict"] != "not diagnosed"
    assert again == found  # what was stored when told to go on is no answer to who was not


def test_millimetres_without_a_unit_are_told_wherever_they_are_first_seen():
    record = dfc.Record(T, U, 1e3 * X)
    scaled = AXIS.replace(mass=2e-3, viscous=15e-3, travel=None)  # what such a record gives
    words = r'x has no unit, .* m/s over .* m: state it, read_record.*units=.*"mm"'
    assert any(re.match(words, message) for message in record.check().messages)
    for look in (dfc.axis_from, dfc.Record.force_map, lambda r: dfc.fit(scaled, r)):
        with pytest.warns(UserWarning, match=words):
            look(record)
    # One that says its unit, or an axis in radians, is believed.
    for said in (dfc.Record(T, U, 1e3 * X, units={"x": "m"}), dfc.Record(T, U, X)):
        assert not any("no unit" in message for message in said.check().messages)
    turning = dfc.FrictionAxis(inertia=2.0, viscous=15.0, coulomb=8.0)
    assert not any("no unit" in message for message in record.check(turning).messages)


def test_a_check_against_an_axis_begins_with_sign_and_units():
    found = dfc.Record(T, -U, X).check(AXIS)
    assert found.messages[0].startswith("the drive takes energy out of the machine")
    assert len(set(found.messages)) == len(found.messages)
    assert not dfc.Record(T, U, X).check(AXIS).messages
    with pytest.raises(ValueError, match="u is in 'A', the axis has 'N'"):
        dfc.Record(T, U, X, units={"u": "A"}).check(AXIS)
    with pytest.raises(ValueError, match="axis must be a FrictionAxis"):
        dfc.Record(T, U, X).check(2.0)


def test_a_first_picture_needs_no_axis_and_tells_a_wrong_sign():
    record = dfc.Record(T, U, X)
    assert record.force_map().rms == record.force_map(dfc.axis_from(record)).rms
    assert record.explore().axis == dfc.axis_from(record)
    for look in (dfc.Record.force_map, dfc.Record.explore):
        with pytest.warns(dfc.RecordWarning, match="takes energy out of the machine"):
            look(dfc.Record(T, -U, X), AXIS)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("machine", [
    AXIS, AXIS.replace(effects=dfc.effects.Spring(60.0, 0.1)),
    AXIS.replace(coulomb=4.0, mass=3.0, effects=dfc.effects.BiasForce(0.3)),
])  # fmt: skip
def test_a_wrong_model_is_no_wrong_record(machine):
    warn_if_implausible(AXIS, dfc.Record(T, U, machine.simulate(U, dt=1e-3).y[0]))


@pytest.mark.parametrize("estimate", [dfc.diagnose, dfc.fit])
def test_a_record_given_twice_is_refused(estimate):
    record = dfc.Record(T, U, X)
    with pytest.raises(ValueError, match=r"record\[0\] and record\[2\] hold the same data"):
        estimate(AXIS, [record, dfc.Record(T, U, X + 1e-6), dfc.Record(T, U, X)])


def stage_of_micrometres(scale):
    """Axis and record of a stage that moves at up to `scale` times 0.47 mm/s."""
    t = 1e-3 * np.arange(4000)
    x = scale * (5e-5 * np.sin(6.0 * t) + 1e-5 * np.sin(17.0 * t))
    v = scale * (3e-4 * np.cos(6.0 * t) + 1.7e-4 * np.cos(17.0 * t))
    u = (2e3 * np.gradient(v, t) + 1e4 * v) / scale + 8.0 * np.sign(v)
    axis = dfc.FrictionAxis(mass=2e3 / scale, viscous=1e4 / scale, coulomb=8.0)
    return axis, dfc.Record(t, u, x)


@pytest.mark.parametrize("function", [dfc.fit, dfc.diagnose])
def test_a_stick_velocity_that_the_motion_does_not_exceed_stops_with_what_to_type(function):
    """By the default of 0.1 mm/s the axis would rest all the time."""
    words = r"stick velocity of 0.0001 m/s: lower that, axis.replace\(stick_speed=[45]e-08\)"
    with pytest.raises(ValueError, match=words):
        function(*stage_of_micrometres(0.1))


def test_a_stick_velocity_that_the_motion_hardly_exceeds_is_told():
    """By the default of 0.1 mm/s the axis would rest for a fifth of its motion."""
    axis, record = stage_of_micrometres(1.0)
    with pytest.warns(dfc.RecordWarning, match=r"replace\(stick_speed=[45]e-07\)"):
        dfc.fit(axis, record)
    assert "stick velocity" not in str(record.check(axis.replace(stick_speed=5e-7)))
    assert "stick velocity" in str(record.check(axis))


def test_a_fit_that_needs_no_axis_says_so():
    # A force of 60 N that the record does not hold moves it, beside a drive of half a newton.
    u, hidden = 0.5 * np.sin(40.0 * T), 60.0 * np.sin(3.0 * T) + 30.0 * np.sin(7.1 * T)
    x = FREE.simulate(u, dt=1e-3, load=hidden).y[0]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = dfc.fit(FREE, dfc.Record(T, u, x), anyway=True)
        given = dfc.fit(FREE, dfc.Record(T, u, x, load=hidden), anyway=True)
    said = [any("larger than the drive" in one for one in fit.messages) for fit in (found, given)]
    assert said == [True, False]
