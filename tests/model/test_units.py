"""One rule for units: every print asks the axis."""

import re

import pytest
from each_effect import BY_SLUG

import dryfric_control as dfc
from dryfric_control.estimation.parameters import Scales, choose
from dryfric_control.units import on_axis, powers

LINEAR, ROTARY, MILLIMETRES = ("m", "N"), ("rad", "N m"), ("mm", "N")
SCALES = Scales(force=10.0, length=0.1, time=0.5, step=1e-3)


def axis_in(units, effects=()):
    return dfc.FrictionAxis(
        mass=2.0, viscous=15.0, coulomb=dfc.CoulombMap([8.0, 1.0, 2.0], [7.0]),
        stribeck=dfc.Stribeck(0.2, 0.01), travel=(-0.1, 0.1), units=units, effects=effects,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("unit", "rotary"),
    [
        ("N", "N m"), ("m", "rad"), ("kg", "kg m^2"), ("m/s", "rad/s"), ("N s/m", "N m s/rad"),
        ("N/m", "N m/rad"), ("N s^2/m^2", "N m s^2/rad^2"), ("1/m^2", "1/rad^2"), ("Hz", "Hz"),
        ("1", "1"), ("m/N", "rad/(N m)"), ("N^2 s", "(N m)^2 s"), ("N m", "N m"), ("V s", "V s"),
        ("N m/rad", "N m/rad"),
    ],
)  # fmt: skip
def test_a_unit_of_a_rotary_axis(unit, rotary):
    assert on_axis(unit, ROTARY) == rotary
    assert powers(rotary) == powers(unit)
    assert on_axis(rotary, ROTARY) == rotary  # in the units of the axis already


def test_units_in_millimetres_and_metres():
    assert on_axis("kg", MILLIMETRES) == "N s^2/mm" and on_axis("N s/m", MILLIMETRES) == "N s/mm"
    for unit in ("N s^2/m^2", "kg", "1/m", "N/m", "1", "Hz", "m/s"):
        assert on_axis(unit, LINEAR) == unit


@pytest.mark.parametrize("slug", BY_SLUG)
def test_every_print_of_an_effect_has_the_units_of_its_axis(slug):
    effect, cls = BY_SLUG[slug], type(BY_SLUG[slug])
    for units in (LINEAR, ROTARY):
        axis = axis_in(units, (effect,))
        declared, printed = cls.parameters(), cls.units(axis.units)
        _, parameters = choose(axis, [f"{slug}.{name}" for name in declared], SCALES)
        for parameter, (name, unit) in zip(parameters, printed.items(), strict=True):
            # The fit, and the diagnosis with it, prints what `describe` prints.
            assert parameter.unit == unit
            shown = "" if unit == "1" else f" {unit}"
            assert f"{name} = {getattr(effect, name):.6g}{shown}" in axis.describe()
            assert powers(unit) == powers(declared[name]["unit"])
            if units == ROTARY:
                # No length, force or mass of a linear axis is left.
                left = unit.replace("kg m^2", "").replace("N m", "")
                assert not re.search(r"\b(m|N|kg)\b", left), unit
            else:
                assert "rad" not in unit or declared[name]["kind"] == "angle"


def test_a_bad_number_is_refused_in_the_units_of_the_axis():
    with pytest.raises(ValueError, match=r"mass .*kg m\^2"):
        dfc.FrictionAxis(mass=-1.0, viscous=0.1, coulomb=1.0, units=ROTARY)
