"""Slow ramp, Coulomb maps and the Stribeck peak, from an independent bench."""

import json
import warnings

import numpy as np
import pytest
import truth
from diagnosis_cases import believed

import dryfric_control as dfc
from dryfric_control.identification import (
    FitWarning,
    fit,
    identify_coulomb,
    identify_stribeck,
    ripple,
    slow_ramp_experiment,
)
from dryfric_control.records.record import Record

PLACES = np.linspace(0.01, 0.29, 60)


def bench(seed, excess=0.3, speed=0.01, omega=12.0, quantum=2e-6, duration=60.0, reach=0.3):
    """Crawl of an independent plant: 2 kg, 15 N s/m, 8 N, parabolic levels."""
    rng = np.random.default_rng(seed)
    plant = truth.Plant(
        mass=2.0, viscous=15.0, coulomb=8.0, excess=excess, stribeck_speed=speed,
        stick_speed=1e-4, asymmetry=0.1, slope=0.2, curvature=-0.1, middle=0.15,
        half_travel=0.15,
    )  # fmt: skip
    n = round(duration * 1e3)
    t = 1e-3 * np.arange(n)
    reference = np.interp(t, [0.0, 0.5 * duration, duration], [0.0, reach, 0.0])
    kp, kd, zero = 2.0 * omega**2, 1.6 * omega, np.zeros(n)
    noise = 0.3 * quantum * rng.standard_normal(n)
    u, y, _ = truth.closed_loop(
        plant, reference, 1e-3, 30, kp, 2.0 * kp, kd, 3e-3, 40.0, quantum, noise, zero, zero, zero
    )
    loop = dfc.PositionController(kp=kp, ki=2.0 * kp, kd=kd, dt=1e-3, limit=40.0, filter_time=3e-3)
    return Record(t, u, y, reference, quantum=quantum), loop


def level(x, s):
    """True Coulomb level of `bench`."""
    q = (x - 0.15) / 0.15
    return 8.0 * (1.0 + 0.1 * s) * (1.0 + 0.2 * q - 0.1 * q**2)


AXIS = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0, travel=(0.0, 0.3))


@pytest.mark.parametrize(
    ("seed", "options", "axis"),
    [
        # Knowing the axis: without stick-slip, with it, and with a coarse encoder.
        *((0, o, AXIS) for o in ({"excess": 0.0}, {}, {"omega": 25.0}, {"quantum": 2e-5})),
        # Smooth crawl: what is neglected is f v, 15 N s/m at 0.01 m/s.
        (0, {"excess": 0.0}, None),
        # With stick-slip, what inertia and viscous friction take is found as well.
        *((2, o, None) for o in ({}, {"omega": 25.0}, {"quantum": 2e-5}, {"duration": 30.0})),
    ],
)
def test_levels_within_two_percent(seed, options, axis):
    record, _ = bench(seed, **options)
    found = identify_coulomb(record, axis=axis)
    for s in (1, -1):
        assert np.max(np.abs(found(PLACES, s) / level(PLACES, s) - 1.0)) < 0.02  # the demand


@pytest.mark.slow
def test_errors_of_levels_contain_those_of_mass_and_viscous_friction():
    places, scores = np.array([0.05, 0.15, 0.25]), []
    for seed in range(10):
        found = identify_coulomb(bench(seed)[0])
        for s in (1, -1):
            scores.append((found(places, s) - level(places, s)) / found.standard_error(places, s))
    # One error of the viscous coefficient a record: ten draws; without its share this is 8.
    assert 0.6 < np.sqrt(np.mean(np.square(scores))) < 1.5


def test_an_experiment_within_the_peak_is_told():
    peak = dfc.Stribeck(0.25, 0.02)
    axis = AXIS.replace(mass=4.0, viscous=30.0, coulomb=12.0, stribeck=peak, travel=(0.0, 0.5))
    with pytest.warns(FitWarning, match="stays within the Stribeck peak .* Lower bandwidth"):
        slow_ramp_experiment(axis, duration=300.0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        slow_ramp_experiment(axis, duration=60.0, bandwidth=3.0)
        slow_ramp_experiment(axis, duration=20.0)


def test_few_slips_give_no_polynomial():
    axis = dfc.presets.clutch_actuator()
    ramp = slow_ramp_experiment(axis, quantum=dfc.presets.QUANTUM, bandwidth=4.0)
    with pytest.warns(FitWarning, match="rests on . slips"):
        found = identify_coulomb(ramp.record)
    assert max(found.degrees) <= 1
    with pytest.raises(ValueError, match="needs at least 8 slips"):
        identify_coulomb(ramp.record, degree=5)


def test_result_is_a_coulomb_map():
    record, _ = bench(0, excess=0.0, duration=20.0)
    found = identify_coulomb(record, degree=2)
    assert isinstance(found, dfc.CoulombMap) and found.coulomb(0.1, 1) == found(0.1, 1)
    assert AXIS.replace(coulomb=found, travel=found.travel).coulomb.plus == found.plus
    json.dumps(found.to_dict())


def test_degree_follows_the_data():
    record, _ = bench(0, excess=0.0)
    assert identify_coulomb(record, axis=AXIS).degrees == (2, 2)
    assert identify_coulomb(record, degree=4, axis=AXIS).degrees == (4, 4)


@pytest.mark.long
def test_intervals_cover_the_truth():
    # `benchmarks/identification.py coverage` prints the table of 200 repeats.
    names, repeats = ("mass", "viscous", "coulomb"), 16
    hits = {name: 0 for name in names}
    scores, errors = [], []
    for seed in range(repeats):
        case = truth.make_null(seed, "short")
        noisy = case.x + 20e-6 * np.random.default_rng(seed).standard_normal(case.x.size)
        a = case.actual
        axis = believed(case).replace(mass=1.1 * a["mass"])
        found = fit(axis, Record(case.t, case.u, noisy, quantum=0.0), names, starts=1)
        for name, (low, high) in found.interval().items():
            hits[name] += low <= a[name] <= high
            errors.append((found.parameters[name] - a[name]) / found.standard_errors[name])
        record, _ = bench(seed, excess=0.0, quantum=5e-6, duration=20.0)
        levels = identify_coulomb(record, degree=2, axis=AXIS)
        for s in (1, -1):
            places = np.array([0.05, 0.15, 0.25])
            scores.append((levels(places, s) - level(places, s)) / levels.standard_error(places, s))
    # Binomial: 16 draws at 0.9 fall below 11 once in 300.
    assert min(hits.values()) >= 11, hits
    # Standard errors as large as the errors: 32 curves, 20 blocks each, and 48 parameters.
    assert 0.6 < np.sqrt(np.mean(np.square(scores))) < 1.5
    assert 0.6 < np.sqrt(np.mean(np.square(errors))) < 1.5


@pytest.mark.long
def test_stribeck_and_levels_from_ripple():
    # The crawl, over a third of the travel, runs inside the peak, so the levels of
    # `identify_coulomb` are too high: the fit of the slips puts that right.
    record, loop = bench(1, speed=0.03, duration=20.0, reach=0.1)
    places = PLACES[PLACES < 0.09]
    raised = identify_coulomb(record, degree=2, axis=AXIS)
    assert np.max(np.abs(raised(places, -1) / level(places, -1) - 1.0)) > 0.05
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FitWarning)  # the stick speed is unseen here
        found = identify_stribeck(raised.apply(AXIS), record, loop, starts=1)
    assert found.stribeck.excess == pytest.approx(0.3, rel=0.1)
    assert found.stribeck.speed == pytest.approx(0.03, rel=0.1)
    for s in (1, -1):
        assert np.max(np.abs(found.axis.coulomb(places, s) / level(places, s) - 1.0)) < 0.02
    # The demand: amplitude and period of the replayed ripple within 10 %.
    assert found.replayed.amplitude == pytest.approx(found.measured.amplitude, rel=0.1)
    assert found.replayed.period == pytest.approx(found.measured.period, rel=0.1)
    json.dumps(found.to_dict())


def test_a_crawl_without_ripple_or_without_a_way_back_is_refused():
    record, _ = bench(0, excess=0.0)
    assert ripple(record) is None
    with pytest.raises(ValueError, match="stick phases"):
        identify_stribeck(AXIS, record)
    with pytest.raises(ValueError, match="both ways"):
        identify_coulomb(record.split(0.45)[0])


def test_slow_ramp_reference_and_csv(tmp_path):
    ramp = slow_ramp_experiment(AXIS, duration=10.0, quantum=1e-6)
    # A triangle: up for one half, down for the other, over the whole travel.
    r = ramp.reference
    assert r[0] == 0.0 and r.max() == pytest.approx(0.3) and r.argmax() == 5000
    assert np.allclose(np.diff(r)[:4999], 0.3 / 5000)
    assert np.max(np.abs(ramp.record.x - r)) < 0.05
    path = tmp_path / "ramp.csv"
    ramp.to_csv(path)
    head, *rows = path.read_text().splitlines()
    assert head == "t [s],reference [m]" and len(rows) == 10_000
    assert float(rows[5000].split(",")[1]) == pytest.approx(0.3)
    assert list(tmp_path.iterdir()) == [path]  # nothing half-written beside it


SMOOTH = AXIS.replace(stribeck=dfc.Stribeck(0.25, 0.05), stick_speed=1e-4)


def test_an_axis_without_its_peak_is_told_of_what_a_crawl_cannot_show():
    """At 0.01 m/s friction is 8 (1 + 0.25 exp(-((0.01 - 1e-4) / 0.05)^2)) = 9.923 N."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FitWarning)
        record = slow_ramp_experiment(SMOOTH, quantum=1e-6).record
    words = r"travelled at 0\.01 m/s: .* not in their standard errors"
    with pytest.warns(FitWarning, match=words) as caught:
        raised = identify_coulomb(record, axis=SMOOTH.replace(stribeck=None))
    assert caught[0].filename == __file__
    assert raised.mean == pytest.approx(9.923, rel=1e-3)
    peak = dfc.effects.StribeckPeak(excess=0.25, speed=0.05)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for axis in (SMOOTH, SMOOTH.replace(stribeck=None, effects=peak)):
            assert identify_coulomb(record, axis=axis).mean == pytest.approx(8.0, rel=1e-3)
        # Whoever knows that there is none says so.
        identify_coulomb(record, axis=SMOOTH.replace(stribeck=dfc.Stribeck(0.0, 0.05)))


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({"speed": 0.03, "duration": 20.0, "reach": 0.1}, True),  # slips within the peak
        ({"speed": 0.04, "omega": 25.0}, True),
        ({}, False),  # slips beyond it
        ({"excess": 0.0, "duration": 20.0}, False),
    ],
)
def test_a_peak_shows_where_velocities_differ(options, told):
    record, _ = bench(0, **options)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        found = identify_coulomb(record, axis=AXIS)
    assert any("Stribeck" in str(w.message) for w in caught) == told
    places = PLACES[PLACES < 0.9 * record.x.max()]
    error = max(np.max(np.abs(found(places, s) / level(places, s) - 1.0)) for s in (1, -1))
    assert (error > 0.05) == told


def test_a_negative_level_is_never_returned_in_silence():
    """A constant force of 9 N beside friction of 8 N, at constant velocities both ways."""
    t = 5e-3 * np.arange(6000)
    v = np.where(t < 15.0, 0.02, -0.02)
    record = Record(t, 9.0 + 8.0 * np.sign(v) + 15.0 * v, 0.02 * (15.0 - np.abs(t - 15.0)))
    # 8 N and 15 N s/m x 0.02 m/s, less 9 N.
    beside = r"negative direction is -0\.7 N .* Half of the difference .* 9 N over the travel"
    with pytest.warns(FitWarning, match=beside):
        found = identify_coulomb(record)
    assert "friction is never negative" in " ".join(found.summary().split())
    known = AXIS.replace(stribeck=dfc.Stribeck(0.0, 0.01), effects=dfc.effects.BiasForce(-9.0))
    with warnings.catch_warnings():
        warnings.simplefilter("error", FitWarning)
        held = identify_coulomb(record, axis=known)
    assert "warning" not in held.summary()
