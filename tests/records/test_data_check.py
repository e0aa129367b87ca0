"""The first look at a record: figures against records whose answer is known."""

import warnings

import numpy as np
import pytest
from diagnosis_cases import record
from truth import make_case, make_outside

import dryfric_control as dfc
from dryfric_control.records.data_check import displacements

DT = 1e-3
T = DT * np.arange(4000)
#: Rests, and moves there and back: 1 s each of rest, way out, rest, way back.
X = np.interp(T, [0.0, 1.0, 2.0, 3.0, 4.0], [0.0, 0.0, 0.2, 0.2, 0.0])
SWAY = 0.1 * np.sin(6.0 * T)


def checked(x, u=None, quantum=1e-5, **options):
    """Check of positions on a grid, driven along their own velocity."""
    u = np.gradient(x) + 1e-6 * np.cos(3.0 * T) if u is None else u
    x = quantum * np.round(x / quantum) if quantum else x
    return dfc.Record(T, u, x, quantum=quantum or 0.0, **options).check()


def about(found, words):
    return [message for message in found.messages if words in message]


def test_figures_of_a_move_there_and_back():
    found = checked(X)
    # One code more or less at the edges of each rest.
    assert found.at_rest == pytest.approx(0.5, abs=0.01)
    assert found.forwards == pytest.approx(0.25, abs=0.01)
    assert found.backwards == pytest.approx(0.25, abs=0.01)
    assert found.longest_rest == pytest.approx(1.0, abs=0.01)
    assert (found.reversals, found.masked, found.clipped) == (1, {}, 0.0)
    assert found.quantum == pytest.approx(1e-5)
    assert found.velocity == pytest.approx((0.2, 0.2), rel=0.05)
    assert found.headline == (
        "1 reversal, 50 % at rest, no samples lost, drive not clipped, resolution 10 um"
    )


def test_samples_lost_and_readings_masked_are_counted():
    kept = np.ones(T.size, bool)
    kept[[1200, 1800, 2500]] = False
    gaps = dfc.Record.from_irregular(T[kept], np.cos(6.0 * T[kept]), SWAY[kept], dt=DT).check()
    assert gaps.masked == {"filled": 3} and "3 samples lost, drive" in gaps.headline
    with pytest.warns(dfc.RecordWarning, match="1 jump"):
        jump = checked(np.where(np.arange(T.size) == 700, 0.2, SWAY), u=np.cos(6.0 * T))
    assert jump.masked == {"jump": 1} and "no samples lost, 1 reading masked" in jump.headline


SWING = 20.0 * np.sin(6.0 * T)
NOISE = np.random.default_rng(5).standard_normal(T.size)


def noisy_check(asked, noise):
    """Check of an axis driven by an input, recorded with noise of so much of its range."""
    axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    x = 1e-6 * np.round(1e6 * axis.simulate(asked, dt=DT).y[0])
    return dfc.Record(T, asked + noise * np.ptp(asked) * NOISE, x).check()


@pytest.mark.filterwarnings("ignore::dryfric_control.RecordWarning")
@pytest.mark.parametrize("noise", [0.0, 1e-4, 1e-3, 5e-3, 0.01])
@pytest.mark.parametrize(("added", "limit"), [(0.0, 14.0), (10.0 * np.sin(17.0 * T), 20.0)])
def test_clipped_drive(added, limit, noise):
    wave = SWING + added
    found = noisy_check(np.clip(wave, -limit, limit), noise)
    # The noise hides where a plateau ends.
    off = 0.05 if noise else 1e-3
    assert found.clipped == pytest.approx(np.mean(np.abs(wave) >= limit), abs=off)
    assert about(found, "rests at both its extremes") and "drive clipped" in found.headline


LAG = np.exp(-np.arange(200) / 20.0)
SQUARE = 15.0 * np.sign(np.sin(12.0 * T + 0.1))


@pytest.mark.parametrize("noise", [0.0, 1e-4, 1e-3, 0.01, 0.03])
@pytest.mark.parametrize(
    "asked",
    [
        SWING, 20.0 * np.sin(60.0 * T), 20.0 * np.sin(2.0 * np.pi * (0.5 * T + T**2)), SQUARE,
        SWING - 2.2 * np.sin(18.0 * T),  # flat crests
        40.0 * np.abs((T + 0.25) % 1.0 - 0.5) - 10.0,  # a triangle
        np.convolve(SQUARE, LAG / LAG.sum())[: T.size],  # a drive that lags
        np.repeat(np.array([1.0, -2.0, 0.0, 2.0, -1.0, 2.0, -2.0, 1.0, 0.0, -2.0]), 400) * 8.0,
        np.clip(SWING, -40.0, 14.0),  # one side only
    ],
)  # fmt: skip
def test_a_drive_at_its_own_levels_is_not_clipped(asked, noise):
    assert noisy_check(asked, noise).clipped == 0.0


@pytest.mark.parametrize("noise", [1e-3, 0.01])
def test_the_friction_of_a_constant_velocity_is_no_limit(noise):
    """The force ramps up while the axis sticks, and stays while it slides."""
    phase = (2.0 * T) % 1.0
    force = 10.0 * np.clip(np.interp(phase, [0.0, 0.25, 0.75, 1.0], [0.0, 2.0, -2.0, 0.0]), -1, 1)
    sliding = 0.05 * np.where(np.abs(force) < 10.0, 0.0, np.sign(force))
    x = 1e-6 * np.round(1e6 * np.cumsum(sliding) * DT)
    assert dfc.Record(T, force + 20.0 * noise * NOISE, x).check().clipped == 0.0


@pytest.mark.parametrize(
    "x, options, words",
    [
        (0.1 * T + 0.02 * np.sin(3.0 * T), {}, "moves forwards only"),
        (-0.1 * T - 0.02 * np.sin(3.0 * T), {}, "moves backwards only"),
        (SWAY, dict(quantum=1e-7), "hardly at rest"),
        (X, {}, "nearly constant speed"),
        (SWAY, dict(quantum=5e-3), "encoder steps"),
        (np.where(T < 0.2, 0.05 * np.sin(31.4 * T), 0.0), {}, "shows little; drive it harder"),
        (SWAY, dict(u=-np.cos(6.0 * T)), "takes energy out"),
        (SWAY + 3e-3 * NOISE, dict(u=np.cos(6.0 * T), quantum=None), "the noise of position"),
    ],
)
def test_says_what_a_record_is_uninformative_about(x, options, words):
    assert about(checked(x, **options), words)


def test_a_rich_record_has_no_message_and_a_part_at_rest_has():
    assert noisy_check(SWING * (np.sin(1.5 * T) > -0.5), 0.0).messages == ()
    found = dfc.Record(T, np.cos(T), 1e-5 * np.round(1e5 * X))[2100:2900].check()
    assert found.at_rest == 1.0 and found.travel == 0.0
    assert about(found, "shows little; drive it harder")


@pytest.mark.parametrize(
    ("units", "said"),
    [
        ({}, "none stated for u, x: taken as those of the axis (N, m by default), time in s"),
        ({"u": "N m"}, "none stated for x: taken as those of the axis (rad by default), time in s"),
        ({"u": "N", "x": "m"}, ""),
    ],
)
def test_units_that_nobody_stated_are_shown_without_a_warning(units, said):
    source = {"t": T, "u": np.gradient(X), "x": X}
    with warnings.catch_warnings(action="error"):
        record = dfc.read_record(source, units=units)
    found = record.check()
    assert found.assumed == found.to_dict()["assumed"] == said and not about(found, "stated")
    for shown in (found.summary(), record.summary(), record._repr_html_()):
        assert (said in shown) and ("none stated" in shown) == bool(said)


def test_units_are_those_of_the_record():
    turned = checked(X, np.gradient(X), units={"x": "rad"})
    assert "resolution 10 urad" in turned.headline and "rad/s" in turned.summary()
    unknown = dfc.Record(T, np.gradient(X), X, units={"u": "N m"}).check()
    assert unknown.units == ("", "N m") and " m" not in unknown.headline.split("resolution")[1]
    assert turned.to_dict()["at_rest"] == turned.at_rest
    assert "\u00b5rad" in turned._repr_html_()


@pytest.mark.parametrize("count", [2, 5, 20])
def test_positions_that_are_read_more_slowly_than_logged_are_told(count):
    x = np.sin(2.0 * T) + 1e-4 * np.random.default_rng(count).normal(size=T.size)
    held = dfc.Record(T[1:], np.cos(T[1:]), np.repeat(x[::count], count)[1:], quantum=0)
    [message] = about(held.check(), "changes only every")
    assert f"every {count} samples" in message
    better = eval(message.rpartition("use ")[2], {"record": held})
    assert np.array_equal(better.x, x[::count][1:])
    assert not about(better.check(), "changes only every")
    # A coarse encoder is no slow one.
    for x in (np.sin(2.0 * T), 0.05 * T, 0.3 * np.sin(0.5 * T) ** 3):
        coarse = dfc.Record(T, np.cos(T), 1e-3 * np.round(1e3 * x), quantum=1e-3)
        assert not about(coarse.check(), "changes only every")


def test_an_encoder_that_slips_is_told_with_its_place():
    slipped = X + 1e-6 * np.random.default_rng(0).standard_normal(T.size)
    slipped[1480:] += 1.5e-3  # in motion, where a sample is 0.2 mm
    slipped[2500:] += 3e-4  # at rest
    found = about(checked(slipped, quantum=1e-6), "encoder slip")
    assert found == [
        "the position is elsewhere by 1.7 mm from one sample to the next, at t = 1.48 s, and "
        "moves on from there: did the encoder slip, or lose steps? Use record[:1480] and "
        "record[1480:]"
    ]
    assert displacements(dfc.Record(T, np.cos(T), slipped)) == [1480, 2500]


@pytest.mark.parametrize("condition", ["short", "coarse", "outliers"])
def test_sound_records_have_no_displacement(condition):
    for slug in ("coulomb", "backlash", "end_stop", "dwell_time"):
        assert displacements(record(make_case(slug, 1, condition))) == []
    # Nor has an axis that moves in jumps shorter than a sample, as a valve does.
    jumps = np.repeat(np.random.default_rng(0).uniform(0.0, 1.0, 80), 50)
    assert displacements(dfc.Record(T, np.cos(T), jumps)) == []


def test_lost_steps_of_an_encoder_are_displacements():
    for seed in range(3):
        case = make_outside(seed, "short", kind="lost_steps")
        assert displacements(record(case))
