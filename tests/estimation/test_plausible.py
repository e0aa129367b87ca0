"""A record of another unit, sign or column is told before it is taken for friction."""

import re
import warnings

import numpy as np
import pytest

import dryfric_control as dfc
from dryfric_control.estimation.plausibility import warn_if_implausible

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
        (1e-3 * U, X, r"at most 0.02 N and moves an axis whose Coulomb level is at least 8 N"),
    ],
)
def test_what_cannot_be_of_this_axis_is_told(u, x, words):
    record = dfc.Record(T, u, x)
    with pytest.warns(dfc.RecordWarning, match=words):
        warn_if_implausible(AXIS, record)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        dfc.fit(AXIS, record)
    ours = [w for w in caught if w.category is dfc.RecordWarning]
    assert ours and all(w.filename == __file__ for w in ours)


def test_swapped_columns_are_told():
    with pytest.warns(dfc.RecordWarning, match="swapped"):
        warn_if_implausible(AXIS.replace(travel=None, coulomb=0.1), dfc.Record(T, X, U))


def test_a_motion_far_beyond_its_drive_is_told():
    axis = AXIS.replace(travel=None)
    with pytest.warns(dfc.RecordWarning, match=r"the motion needs about .* drive is at most 20 N"):
        warn_if_implausible(axis, dfc.Record(T, U, 1e3 * X))
    scaled = axis.replace(effects=dfc.effects.InputGain(1e3))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warn_if_implausible(scaled, dfc.Record(T, U, 1e3 * X))


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
