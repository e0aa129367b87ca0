"""A first nominal axis from a record alone, from motions in closed form and an independent bench."""

import re

import numpy as np
import pytest

import dryfric_control as dfc
from dryfric_control.identification import force_regression

T = 1e-3 * np.arange(8000)
POSITION = 0.05 * np.sin(6.0 * T) + 0.01 * np.sin(17.0 * T + 1.0)
VELOCITY = 0.3 * np.cos(6.0 * T) + 0.17 * np.cos(17.0 * T + 1.0)
FORCE = 2.0 * (-1.8 * np.sin(6.0 * T) - 2.89 * np.sin(17.0 * T + 1.0))
FORCE += 15.0 * VELOCITY + 8.0 * np.sign(VELOCITY)


def record_of(u, x=POSITION, noise=0.0, **options):
    rng = np.random.default_rng(3)
    u = u + noise * rng.standard_normal(u.size)
    # The drive acts from sample to sample: its mean over the sample is given.
    held = 0.5 * (u + np.append(u[1:], u[-1]))
    return dfc.Record(T, held, 1e-6 * np.round(x / 1e-6), **options)


@pytest.mark.parametrize(
    ("beside", "noise"), [(0.0, 0.0), (0.0, 0.5), (1.5, 0.0), (-40.0 * POSITION, 0.5)]
)
def test_mass_and_friction_come_out_whatever_constant_or_spring_acts_beside(beside, noise):
    found = force_regression(record_of(FORCE - beside, noise=noise))
    true = {"mass": 2.0, "viscous": 15.0, "coulomb": 8.0}
    for name, value in found.parameters.items():
        # Smoothing and rounding: 0.3 % at most; noise: four standard errors.
        assert value == pytest.approx(
            true[name], abs=3e-3 * true[name] + 4.0 * found.standard_errors[name]
        )
        assert found.standard_errors[name] < 0.02 * true[name]
    assert found.axis.mass == found.parameters["mass"] and not found.messages


def test_a_known_force_on_the_mass_counts_as_drive():
    beside = 6.0 * np.sign(np.sin(2.0 * T))
    known = force_regression(record_of(FORCE - beside, load=beside))
    assert known.parameters["mass"] == pytest.approx(2.0, rel=3e-3)
    assert known.parameters["coulomb"] == pytest.approx(8.0, rel=3e-3)
    unknown = force_regression(record_of(FORCE - beside))
    assert unknown.rms > 10.0 * known.rms


def test_a_path_and_a_rotary_record(tmp_path):
    record = record_of(FORCE, units={"x": "rad", "u": "N m"})
    record.to_csv(tmp_path / "run.csv")
    axis = dfc.axis_from(tmp_path / "run.csv")
    assert axis.units == ("rad", "N m") and axis.inertia == pytest.approx(2.0, rel=3e-3)
    assert "kg m^2" in force_regression(record).table("csv")


def test_what_the_record_does_not_say_is_told():
    v = np.where(T < 4.0, 0.02, -0.02)
    crawl = record_of(8.0 * np.sign(v) + 15.0 * v, 0.02 * (4.0 - np.abs(T - 4.0)), noise=0.1)
    with pytest.warns(dfc.FitWarning, match="mass is hardly determined.*hardly accelerates"):
        axis = dfc.axis_from(crawl)
    # 8 N and 15 N s/m x 0.02 m/s: one velocity does not tell them apart.
    assert axis.viscous == 0.0 and axis.coulomb.mean == pytest.approx(8.3, abs=0.05)
    with pytest.raises(ValueError, match="wrong sign.*gain=-1"):
        dfc.axis_from(record_of(-FORCE))
    short = dfc.Record(T[:40], FORCE[:40], POSITION[:40])
    with pytest.raises(ValueError, match="smoothed samples only, 50 are needed"):
        dfc.axis_from(short)


def test_a_drive_that_shows_no_machine_gives_no_axis():
    rng = np.random.default_rng(1)
    with pytest.raises(ValueError, match=r"neither mass nor friction \(mass .* check columns"):
        dfc.axis_from(record_of(rng.standard_normal(T.size)))


def test_one_way_the_level_has_the_constant_force_and_a_value_that_does_not_show_is_told():
    up = slice(6300, 7300)  # 1 s of the motion below, one way
    x = np.cumsum(1e-3 * np.abs(VELOCITY))
    force = FORCE * np.sign(VELOCITY)
    found = force_regression(record_of(force, x)[up.start : up.stop])
    assert "one way only" in found.messages[0] and found.constant == 0.0
    # Half of it was in a constant that no such record tells from it.
    assert found.parameters["coulomb"] == pytest.approx(8.0, abs=1.0)
    sluggish = record_of(FORCE - 15.0 * VELOCITY, noise=0.5)
    assert any(one.startswith("viscous is hardly determined") for one in
               force_regression(sluggish).messages)  # fmt: skip


def test_errors_of_noise_alone_are_told_for_that_where_more_is_left():
    ripple = 1.5 * np.sin(2.0 * np.pi * POSITION / 8e-3)
    assert "off by more than their errors" in " ".join(str(force_regression(
        record_of(FORCE + ripple))).split())  # fmt: skip
    assert "more than their errors" not in str(force_regression(record_of(FORCE)))


def test_what_is_left_out_of_the_regression_is_zero():
    v = np.where(T < 4.0, 0.02, -0.02)
    found = force_regression(record_of(8.0 * np.sign(v), 0.02 * (4.0 - np.abs(T - 4.0)), noise=0.1))
    assert found.parameters["viscous"] == found.standard_errors["viscous"] == 0.0


def test_a_torque_that_moves_metres_is_refused_with_what_is_missing():
    """A ball screw whose lead was forgotten is not taken for a rotary axis."""
    with pytest.raises(ValueError, match=r"'m' and u in 'N m'.*lead= or pinion_radius="):
        dfc.axis_from(record_of(FORCE, units={"x": "m", "u": "N m"}))


def test_without_a_drive_no_mass_is_made_up():
    with pytest.raises(ValueError, match=r"u = 0.*ratios to the mass.*FrictionAxis\(mass="):
        dfc.axis_from(record_of(np.zeros(T.size)))
    # A known force will do; the kernel, of no drive, is then the widest, which costs 5 %.
    pulled = record_of(np.zeros(T.size), load=record_of(FORCE).u)
    assert dfc.axis_from(pulled).mass == pytest.approx(2.0, rel=0.1)


def test_a_first_axis_prints_with_its_units():
    printed = str(dfc.axis_from(record_of(FORCE))).splitlines()
    assert re.fullmatch(r"  mass [\d.]{3,7} kg", printed[1]) and "  Coulomb + 7.99946 N" in printed


@pytest.mark.parametrize(("scale", "unit"), [(1e-4, "m"), (1e3, "m"), (4e5, "counts"), (1e-4, "V")])
def test_the_stick_velocity_is_slow_for_the_record_in_any_unit(scale, unit):
    """1e-4 m/s is rest for a machine tool, fast for a stage of micrometres; in counts it is nothing."""
    record = record_of(FORCE, scale * POSITION)
    record = dfc.Record(record.t, record.u, scale * POSITION, units={"x": unit, "u": "N"})
    axis = dfc.axis_from(record)
    fastest = scale * np.abs(VELOCITY).max()
    assert axis.stick_speed < 2e-3 * fastest
    assert axis.stick_speed == 1e-4 or axis.stick_speed > 2e-4 * fastest
    assert axis.mass == pytest.approx(2.0 / scale, rel=0.01)
