"""What is said of a cause, whichever judge has found it."""

import math

import pytest
from diagnosis_cases import driven

import dryfric_control as dfc
from dryfric_control.diagnosis.causes import cause_of, hardly_determined

AXIS = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
OWN = {name: f"cogging_2.{name}" for name in ("amplitude", "period", "phase")}


def cause(amplitude_error, axis=AXIS):
    fitted = (0.5, amplitude_error, "N"), (0.01, 0.02, "m"), (0.2, 5.0, "rad")
    fitted = dict(zip(OWN.values(), fitted, strict=True))
    return cause_of(axis, "cogging", OWN, fitted, (2.0, 0.1), ["spring"])


def test_a_cause_has_the_numbers_of_the_fit_under_its_own_names():
    found = cause(0.01)
    assert found.parameters == {"amplitude": 0.5, "period": 0.01, "phase": 0.2}
    assert found.standard_errors["amplitude"] == 0.01
    assert found.units == {"amplitude": "N", "period": "m", "phase": "rad"}
    assert found.interval == pytest.approx((2.0 - 0.1645, 2.0 + 0.1645))
    assert found.held_out_gain == 2.0 and found.alternatives == ("spring",)


def test_an_effect_that_the_axis_has_is_said_to_have_other_values():
    known = AXIS.replace(effects=(dfc.effects.Cogging(amplitude=1.0, period=0.01),))
    assert "Already in the nominal axis" in cause(0.01, known).explanation
    assert "Already" not in cause(0.01).explanation


@pytest.mark.parametrize(
    ("error", "nominal", "open_"),
    [
        *((error, None, True) for error in (0.16, math.inf, math.nan)),
        (0.14, None, False),
        # An amount that has gone is determined beside its nominal value.
        (0.16, dfc.effects.Cogging(amplitude=10.0, period=0.1), False),
    ],
)
def test_what_a_record_leaves_open_is_said(error, nominal, open_):
    axis = AXIS.replace(effects=(nominal,) if nominal else ())
    # The phase, an angle, has no size to hold its error against.
    said = [m for m in hardly_determined(axis, [cause(error)]) if "amplitude" in m or "phase" in m]
    assert said == ["cogging.amplitude is hardly determined by this record"] * open_


def test_a_parameter_called_as_its_cause_is_named_once():
    fitted = {"viscous": (15.0, 9.0, "N s/m")}
    open_ = cause_of(AXIS, "viscous", {"viscous": "viscous"}, fitted, (2.0, 0.1))
    assert hardly_determined(AXIS, [open_]) == ["viscous is hardly determined by this record"]


def test_readings_that_were_left_out_are_listed_and_told():
    sound = driven(AXIS, 6.0)
    x = sound.x.copy()
    x[[700, 2900]] += 0.01
    with pytest.warns(dfc.RecordWarning, match="masked"):
        record = dfc.Record(sound.t, sound.u, x)
    d = dfc.diagnose(AXIS, record)
    (masked,) = d.masked
    assert masked.indices.tolist() == [700, 2900]
    assert masked.reasons == ("jump", "jump")
    assert d.verdict == "nothing to find"
    assert "left out: 2 jump" in d.summary()
    assert d.to_dict()["masked"] == [{"indices": [700, 2900], "reasons": ["jump", "jump"]}]
