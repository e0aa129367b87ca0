"""Records: validation, parts, resampling, resolution, derivatives, files."""

import dataclasses
import json
import math
import warnings

import damage
import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis.extra import numpy as hnp
from made_logs import text, write
from scipy.io import savemat

from dryfric_control.records import Record, RecordWarning, read_bam, read_record

N = 400
T = 1e-3 * np.arange(N)
U = np.cos(40 * T) + 0.3 * np.sin(7 * T)
X = 0.02 * np.sin(11 * T)


def good(**changes) -> dict:
    """Arguments of a sound record with some replaced."""
    return {"t": T, "u": U, "x": X} | changes


def with_value(array, index, value):
    out = np.array(array, dtype=float)
    out[index] = value
    return out


def without(mask):
    """The sound record without the samples of the mask."""
    keep = ~np.asarray(mask)
    return good(t=T[keep], u=U[keep], x=X[keep])


def test_arrays_are_copied_read_only_and_the_arguments_unchanged():
    t, u, x = T.copy(), U.copy(), X.astype(np.float32)
    record = Record(t, u, x, reference=x)
    for given_, kept in ((t, record.t), (u, record.u), (x, record.x), (x, record.reference)):
        assert kept.dtype == np.float64 and not kept.flags.writeable
        assert not np.shares_memory(given_, kept)
        assert given_.flags.writeable
    with pytest.raises(ValueError, match="read-only"):
        record.x[0] = 1.0
    with pytest.raises(dataclasses.FrozenInstanceError):
        record.x = X


def test_sizes_and_labels():
    units = {"u": "Nm", "x": "rad", "t": "sec"}
    record = Record(T, U, X, units=units, name="<b>run 1", notes=["filtered"])
    assert (len(record), record.dt, record.duration) == (N, 0.001, 0.4)
    assert dict(record.units) == {"t": "s", "u": "N m", "x": "rad"}
    assert record.range == X.max() - X.min()
    with pytest.raises(TypeError):
        record.units["x"] = "m"
    assert "run 1" in repr(record) and "400" in repr(record)
    assert "filtered" in record.summary() and "400 at 0.001 s" in record.summary()
    shown = record._repr_html_()
    assert "&lt;b&gt;run" in shown and "<b>" not in shown


def test_equality_looks_at_everything_shown():
    base = Record(T, U, X)
    assert base == Record(T, U, X)
    others = dict(t=T + 1), dict(u=2 * U), dict(x=2 * X), dict(reference=X), dict(name="b")
    for changes in (*others, dict(units={"x": "m"})):
        assert base != Record(**good(**changes))
    assert Record(T, U, X, X) != Record(T, U, X, 2 * X)
    assert base != 3


@pytest.mark.parametrize(
    ("t", "dt", "off"),
    [
        *((start + step * np.arange(N), step, 0)
          for start, step in ((0, 1e-3), (7.3, 1e-3), (7.3, 0.00125), (0, 0.005), (0, 1e-5))),
        # rounded stamps fix the step to their rounding over the length of the record
        (1.7e9 + np.arange(N) * 1e-3, 1e-3, 2e-6),  # clock time, resolved to 2.4e-7 s
        (np.round(np.arange(N) / 3000, 6), 1 / 3000, 2e-6),
        (5 + np.arange(N) * 0.00123456789, 0.00123456789, 2e-6),
        (np.float32(np.arange(N) * 1e-3), 1e-3, 2e-6),
    ],
)  # fmt: skip
def test_step_is_the_one_meant(t, dt, off):
    assert Record(t, U, X).dt == pytest.approx(dt, rel=off, abs=0)


WRAPPED = np.mod(40 * T, 2 * np.pi)
GAP = (T > 0.2) & (T < 0.21)
BAD = {
    "2-D column": (good(x=X[:, None]), r"x must be 1-D, got shape \(400, 1\); use .ravel"),
    "2-D table": (good(u=np.c_[U, U]), r"u must be 1-D, got shape \(400, 2\)$"),
    "scalar": (good(u=3.0), r"u must be 1-D, got shape \(\)"),
    "nan": (good(x=with_value(X, [17, 19], np.nan)), r"x has 2 values .* first x\[17\] = nan"),
    "inf": (good(u=with_value(U, 3, -np.inf)), r"u has 1 values .* first u\[3\] = -inf"),
    "nan time": (good(t=with_value(T, 5, np.nan)), r"t has 1 values that are not finite"),
    "nan reference": (good(reference=with_value(X, 0, np.nan)), "reference has 1 values"),
    "longdouble overflow": (good(u=U.astype(np.longdouble) * np.longdouble("1e400")), "finite"),
    "absurd magnitude": (good(x=with_value(X, 8, 1e200)), r"x\[8\] = 1e\+200 is no physical"),
    "too short": (good(t=T[:9], u=U[:9], x=X[:9]), "9 samples are too few; at least 10"),
    "empty": (good(t=[], u=[], x=[]), "t is empty"), "empty x": (good(x=[]), "x is empty"),
    "none": (good(x=None), "x is missing"),
    "goes back": (good(t=with_value(T, 50, 0.0)), r"goes back 1 times, first from t\[49\]"),
    "joined runs": (good(t=np.r_[T[:200], T[:200]]), r"split where runs were joined"),
    "duplicated": (good(t=with_value(T, 50, T[49])), r"1 duplicated time stamps, first t\[49\]"),
    "all times equal": (good(t=np.zeros(N)), "399 duplicated time stamps"),
    "dropped samples": (without(GAP), r"1 gaps in t, about 9 samples dropped.*split_at_gaps"),
    "one lost": (without(np.arange(N) == 33), r"about 1 samples dropped.* after t\[32\] = 0.032"),
    "jitter": (good(t=T + 2e-4 * np.sin(np.arange(N))), r"jitter 19.* %.*Record.from_irregular"),
    "single-precision clock": (good(t=np.float32(1000 + T)), "not uniform.*subtract the start"),
    "drifting clock": (good(t=T + 4e-6 * np.arange(N) ** 2 * 1e-3 * 5), "clock of t drifts"),
    "constant x": (good(x=np.full(N, 0.1)), r"x is constant \(0.1\): the axis never moved"),
    "x constant but for rounding": (good(x=0.1 + 1e-17 * U), "x is constant"),
    "constant u": (good(u=np.full(N, 0.3)), r"u is constant \(0.3\): without excitation"),
    "complex": (good(u=U + 1j), "u is complex; pass its real part"),
    "text": (good(x=X.astype(str)), "x holds text"), "bytes": (good(x=X.astype("S8")), "x holds text"),
    "object": (good(x=[*X[:-1].tolist(), None]), "x is of dtype object"),
    "ragged": (good(x=[[1.0], [1.0, 2.0]]), "x is no array of numbers"),
    "dates": (good(t=np.arange(N).astype("M8[ms]")), r"t holds dates; pass seconds"),
    "durations": (good(t=np.arange(N).astype("m8[ms]")), r"t holds durations; pass seconds"),
    "structured": (good(x=np.zeros(N, dtype=[("a", float)])), "x is a structured array"),
    "masked": (good(x=np.ma.masked_greater(X, 0.01)), r"x has \d+ masked values"),
    "encoder wrap": (good(x=WRAPPED), r"x jumps 2 times .* wraps around.* unwrap=6.283185307"),
    "encoder wrap in degrees": (good(x=np.degrees(WRAPPED)), "unwrap=360 perhaps"),
    "encoder wrap, 12 bit": (good(x=np.floor(WRAPPED / 2 / np.pi * 4096)), "unwrap=4096 "),
    "wrap in the first sample": (good(x=np.r_[6.2, WRAPPED[:-1]]), r"jumps 3 times.* x\[0\]"),
    "wrap in the last sample": (good(x=np.r_[6.2, WRAPPED[:-1]][::-1]), "jumps 3 times"),
    "unit in ms": (good(units={"t": "ms"}), r"pass t \* 0.001 in s"),
    "unit in mm": (good(units={"x": "mm"}), r"pass x \* 0.001 in m"),
    "unknown unit of time": (good(units={"t": "m"}), "unit 'm' of the time is not known"),
    "unit with brackets": (good(units={"x": "a]b"}), "short word without brackets"),
    "unit no text": (good(units={"x": 3}), "unit of x must be text"),
    "negative quantum": (good(quantum=-1e-6), "quantum must be zero or more"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_told(case):
    arguments, message = BAD[case]
    with pytest.raises(ValueError, match=message):
        Record(**arguments)


@pytest.mark.parametrize(
    "changes",
    [
        {"u": np.round(150 * np.cos(np.pi / 40 * np.arange(N)))},  # crests of three samples
        {"x": np.round(X / 0.01) * 0.01},  # five encoder counts in all
        {"x": np.where(T > 0.2, 1.0, 0.0)},  # a single count
        {"x": np.sin(300 * T)},  # fast, but smooth
        {"t": 0.02 * np.arange(N)},
    ],
)
def test_sound_input_is_not_suspected(changes):
    with warnings.catch_warnings(action="error"):
        Record(**good(**changes))


@pytest.mark.parametrize("period", [2 * np.pi, 360.0, 4096.0])
def test_unwrapping_recovers_the_position(period):
    true = period * (0.3 + 5 * T / T[-1] + 0.2 * np.sin(9 * T))
    lagging = true - 0.35 * period  # starts one turn below the position
    record = Record(T, U, np.mod(true, period), np.mod(lagging, period), unwrap=period)
    # multiples of the period are added: only rounding remains
    np.testing.assert_allclose(record.x, true, rtol=0, atol=1e-12 * period)
    np.testing.assert_allclose(record.reference, lagging, rtol=0, atol=1e-12 * period)
    assert "unwrapped" in record.notes[0]


FULL = Record(T, U, X, 2 * X, units={"u": "N", "x": "m"}, name="run", quantum=1e-6)


def joined(parts):
    columns = [[part.t, part.u, part.x, part.reference] for part in parts]
    return Record(*np.concatenate(columns, axis=1), units=FULL.units, name=FULL.name)


@pytest.mark.parametrize("parts", [0.6, 1, 3, 200, [0.6, 0.2, 0.2], (0.5, 0.5), np.array([1.0])])
def test_split_parts_join_to_the_whole(parts):
    pieces = FULL.split(parts)
    assert joined(pieces) == FULL
    for piece in pieces:
        assert (piece.dt, piece.quantum, piece.units) == (FULL.dt, 1e-6, FULL.units)


def test_sizes_of_parts():
    assert [len(p) for p in FULL.split(0.6)] == [240, 160]
    assert [len(p) for p in FULL.split([0.6, 0.2, 0.2])] == [240, 80, 80]
    assert [len(p) for p in FULL.split(3)] == [133, 134, 133]
    assert FULL.split(0.6)[1].t[0] == T[240]
    of_blocks = {0.1: 4 * [100], 0.15: [150, 150, 100], 0.18: [180, 220], 99: [400]}
    for seconds, sizes in of_blocks.items():
        assert [len(b) for b in FULL.blocks(seconds)] == sizes
        assert joined(FULL.blocks(seconds)) == FULL


def test_window_and_slices():
    part = FULL.window(T[100], T[150])
    assert part == FULL[100:150] and part.t[0] == T[100]
    assert FULL[-50:] == FULL.window(T[350]) and FULL.window() == FULL
    # A part may stand still.
    still = Record(T, U, np.where(T < 0.2, 0.0, X - X[200]))[:150]
    assert still.range == 0 and still.noise == 0


@pytest.mark.parametrize("factor", [1, 2, 7, 200])
def test_decimation_keeps_positions_and_impulse(factor):
    few = FULL.decimated(factor)
    m = N // factor
    assert len(few) == m and few.dt == pytest.approx(factor * 1e-3, rel=1e-15)
    assert np.array_equal(few.x, X[: m * factor : factor])
    assert np.array_equal(few.t, T[: m * factor : factor])
    # sums of a few hundred numbers of order one
    assert few.u.sum() * few.dt == pytest.approx(U[: m * factor].sum() * 1e-3, abs=1e-14)


def irregular(seed=0, n=3000):
    rng = np.random.default_rng(seed)
    t = np.cumsum(rng.uniform(3e-3, 6e-3, n))
    return t, rng.standard_normal(n), np.sin(2 * t)


def test_held_input_keeps_its_impulse():
    t, u, x = irregular()
    record = Record.from_irregular(t, u, x, dt=0.004)
    end = record.t[-1] + record.dt
    # the held input integrated by hand, from the first stamp to the end of the grid
    stamps = np.append(t, max(end, t[-1]))
    true = np.sum(u * np.clip(np.diff(np.minimum(stamps, end)), 0, None))
    # rounding of sums over 3000 samples of order one
    assert record.u.sum() * record.dt == pytest.approx(true, abs=1e-11)
    # between switches: 0.5 to 1 s holds 0 for 0.4 s and 1 for 0.1 s; 1 to 1.5 s holds 1
    t = np.array([0, 0.9, 2.1, 3.4, 4.2, 5.1, 6.3, 7.2, 8.3, 9.1, 10.0])
    with pytest.warns(RecordWarning, match="milliseconds"):  # 0.5 s is slow on purpose
        record = Record.from_irregular(t, np.arange(11.0), np.sin(t), dt=0.5)
    np.testing.assert_allclose(record.u[:4], [0, 0.2, 1, 1], rtol=0, atol=1e-15)
    # nothing is done to a uniform one
    same = Record.from_irregular(T, U, X, dt=1e-3)
    assert np.array_equal(same.u, U) and len(same) == N and "resampled" in same.notes[0]
    np.testing.assert_allclose(same.x, X, rtol=0, atol=1e-17)


@pytest.mark.parametrize(
    ("interpolation", "tolerance"),
    # x'' = 4, h = 6 ms: linear h^2 4 / 8 = 1.8e-5; PCHIP flattens crests to about h^2 4 / 8
    # as well; spline 5/384 h^4 16 = 2.7e-10, more at the ends
    [("linear", 2e-5), ("monotone", 2e-5), ("cubic", 1e-7)],
)
def test_positions_and_a_linear_hold_follow_the_motion(interpolation, tolerance):
    t, _, x = irregular()
    record = Record.from_irregular(t, 3 * t, x, interpolation=interpolation, hold="first")
    inside = record.t <= t[-1]
    assert np.abs(record.x - np.sin(2 * record.t))[inside].max() < tolerance
    np.testing.assert_allclose(record.u, 3 * record.t, rtol=1e-13)


def test_splitting_at_gaps():
    first, second = Record.split_at_gaps(**without(GAP), units={"x": "m"}, name="g")
    assert np.array_equal(np.r_[first.t, second.t], T[~GAP])
    assert np.array_equal(np.r_[first.x, second.x], X[~GAP])
    assert (first.dt, second.dt, second.units["x"], second.name) == (1e-3, 1e-3, "m", "g")
    assert len(Record.split_at_gaps(T, U, X)) == 1
    words = "4 samples in stretches of fewer than 10 were left out"
    with pytest.warns(RecordWarning, match=words) as told:
        assert len(Record.split_at_gaps(**without(GAP | (np.arange(N) == N - 5)))) == 2
    assert told[0].filename == __file__
    with pytest.raises(ValueError, match="longest stretch without a gap has 4 samples"):
        Record.split_at_gaps(**without(np.arange(N) % 5 == 4))


@pytest.mark.parametrize("quantum", [1e-6, 2 * np.pi / 4096, 1.0, 1 / 3])
@pytest.mark.parametrize("span", [3, 40, 3000])
@pytest.mark.parametrize("storage", ["float64", "float32", "offset", "noisy"])
def test_quantum_is_found(quantum, span, storage):
    rng = np.random.default_rng(3)
    t = 1e-3 * np.arange(8000)
    x = span * np.sin(2.1 * t) + span * 0.2 * np.sin(5 * t + 1)
    if storage == "noisy":
        x = x + 2 * rng.standard_normal(t.size)
    counts = np.round(x) + (12345 if storage == "offset" else 0)
    x = (quantum * counts).astype("float32" if storage == "float32" else "float64")
    # single precision holds the largest position, 3600 counts, to 2e-4 of a count, and the
    # longest differences used are some ten counts
    tolerance = 2e-5 if storage == "float32" else 1e-9
    assert Record(t, np.cos(t), x).quantum == pytest.approx(quantum, rel=tolerance)


def test_quantum_survives_rounded_storage_and_bad_samples():
    t = 1e-3 * np.arange(8000)
    x = 1.534e-3 * np.round(np.sin(2 * t) / 1.534e-3)
    written = np.round(x, 6)  # off the grid by 3e-4 of it
    assert Record(t, np.cos(t), written).quantum == pytest.approx(1.534e-3, rel=1e-5)
    rng = np.random.default_rng(0)
    x[rng.integers(0, 8000, 20)] += 1e-3 * rng.standard_normal(20)
    assert Record(t, np.cos(t), x).quantum == pytest.approx(1.534e-3, rel=1e-5)


@pytest.mark.parametrize(
    "x",
    [
        0.1 * np.sin(3 * T),
        np.random.default_rng(0).standard_normal(N),
        0.7 * T,  # constant speed: one step, no encoder
        # run up to in a few samples, with a ripple of 2 %
        0.7e-3 * np.cumsum(np.minimum(T / 0.0053, 1.0) ** 1.3 * (1.0 + 0.02 * np.sin(40 * T))),
        0.1 * np.float32(np.sin(3 * T)),
        np.cumsum(np.random.default_rng(1).uniform(0, 1e-4, N)),
        np.sin(2 * np.pi * np.arange(N) / 100),  # values repeat, but for rounding
    ],
)
def test_no_quantum_is_invented(x):
    with warnings.catch_warnings(action="ignore", category=RecordWarning):  # white noise jumps
        assert Record(T, U, x).quantum is None
        assert Record(T, U, x, quantum=0).quantum is None
        assert Record(T, U, x, quantum=1e-3).quantum == 1e-3


def test_noise_is_measured():
    rng = np.random.default_rng(5)
    t = 1e-3 * np.arange(20_000)
    x = 0.1 * np.sin(6 * t)
    # the median of 20000 correlated fourth differences scatters by 2 %
    record = Record(t, np.cos(t), x + 3e-6 * rng.standard_normal(t.size))
    assert record.noise == pytest.approx(3e-6, rel=0.05)
    coarse = Record(t, np.cos(t), 1e-4 * np.round(1e4 * x))
    # rounding error of a moving axis: at least uniform over one quantum
    assert 0.999e-4 / math.sqrt(12) <= coarse.noise < 2e-4 / math.sqrt(12)


LONG = 1e-3 * np.arange(2000)


def sine(quantum=0.0, noise=0.0):
    x = np.sin(7.0 * LONG) + noise * np.random.default_rng(1).standard_normal(LONG.size)
    return Record(LONG, np.cos(LONG), quantum * np.round(x / quantum) if quantum else x)


def test_the_resolution_is_noise_quantum_and_rounding():
    clean, coarse, noisy = sine(), sine(quantum=1e-3), sine(noise=1e-3)
    assert clean.resolution.quantum == noisy.resolution.quantum == 0.0
    assert coarse.resolution.quantum == pytest.approx(1e-3)
    assert clean.resolution.rounding == 1e-9 * clean.range
    assert noisy.resolution.deviation == pytest.approx(1e-3, rel=0.1)
    assert noisy.resolution.step == pytest.approx(np.sqrt(12) * 1e-3, rel=0.1)
    assert coarse.resolution.step >= coarse.resolution.quantum


def test_a_path_is_read_on_the_grid_and_with_the_noise_of_the_record():
    path = 0.3 * np.sin(5.0 * LONG)
    again = sine(quantum=1e-3).read(path, np.random.default_rng(0), origin=0.0)
    np.testing.assert_allclose(again.x / 1e-3, np.round(again.x / 1e-3), atol=1e-9)
    noisy = sine(noise=1e-3)
    error = noisy.read(path, np.random.default_rng(0)).x - path
    assert np.std(error) == pytest.approx(noisy.noise, rel=0.05)
    still = sine(quantum=1e-3).read(np.zeros(LONG.size), np.random.default_rng(0))
    assert np.ptp(still.x) <= 2e-3


def test_record_with_another_input_or_other_positions():
    one = sine(quantum=1e-3)
    other = one.replace(u=2.0 * one.u)
    np.testing.assert_array_equal(other.u, 2.0 * one.u)
    np.testing.assert_array_equal(other.x, one.x)
    assert other.quantum == one.quantum and one.replace(x=-one.x).x[5] == -one.x[5]
    with pytest.raises(ValueError, match="u has 3 samples"):
        one.replace(u=np.zeros(3))
    with pytest.raises(ValueError, match="x"):
        one.replace(x=np.full(LONG.size, np.nan))


@pytest.mark.parametrize("window", [5, 9, 101])
def test_derivatives_of_a_cubic_are_exact(window):
    x = 0.3 - 0.2 * T + 1.5 * T**2 - 4 * T**3
    d = Record(T, U, x).derivatives(window)
    # weights from powers up to 50^3 carry 1e-13; over dt and dt^2 that grows by 1e3 and 1e6
    np.testing.assert_allclose(d.x, x, rtol=0, atol=1e-13)
    np.testing.assert_allclose(d.v, -0.2 + 3 * T - 12 * T**2, rtol=0, atol=1e-10)
    np.testing.assert_allclose(d.a, 3 - 24 * T, rtol=0, atol=1e-7)


@pytest.mark.parametrize("quantum", [1e-7, 1e-6, 1e-5, 1e-4])
@pytest.mark.parametrize("dt", [2e-4, 1e-3, 5e-3])
def test_default_window_leaves_the_acceleration_usable(quantum, dt):
    t = dt * np.arange(int(10 / dt))
    x = 0.05 * np.sin(5 * t) + 0.01 * np.sin(13 * t)
    record = Record(t, np.cos(t), quantum * np.round(x / quantum))
    d = record.derivatives()
    true = -0.05 * 25 * np.sin(5 * t) - 0.01 * 169 * np.sin(13 * t)
    m = record.smoothing_window
    # 5 % of the large accelerations is aimed at; slow stretches of a coarse encoder are
    # correlated and cost more; at the longest window the noise is what it is
    if m < 101:
        assert np.std((d.a - true)[m:-m]) < 0.15 * np.std(true)
    assert np.std((d.v - np.gradient(x, dt))[m:-m]) < 0.05 * np.std(np.gradient(x, dt))


LOG = text(T, U, X, heading="t,u,x")


@pytest.mark.parametrize(
    ("heading", "factors", "units"),
    [
        ("time (ms),u [kN],x [mm]", (1e-3, 1e3, 1e-3), ("s", "N", "m")),
        ("t_us,force_N,pos_um", (1e-6, 1, 1e-6), ("s", "N", "m")),
        ("t [µs],u [mNm],x [deg]", (1e-6, 1e-3, math.pi / 180), ("s", "N m", "rad")),
        ("t [s],u [N·m],x [°]", (1, 1, math.pi / 180), ("s", "N m", "rad")),
        ("t / s,u / V,x / counts", (1, 1, 1), ("s", "V", "counts")),
        ("t,u,x [counts]", (1, 1, 1), ("s", None, "counts")),
    ],
)
@pytest.mark.parametrize("encoding", ["utf-8", "latin-1"])
def test_units_in_headings_become_si(tmp_path, heading, factors, units, encoding):
    stored = np.c_[T, U, X] / factors
    record = read_record(write(tmp_path, text(*stored.T, heading=heading), encoding=encoding))
    # one division and one multiplication
    np.testing.assert_allclose(record.t, T, rtol=1e-15)
    np.testing.assert_allclose(record.u, U, rtol=1e-15)
    np.testing.assert_allclose(record.x, X, rtol=1e-15)
    assert tuple(record.units.get(k) for k in "tux") == units
    assert len(record.notes) == sum(f != 1 for f in factors)


def test_columns_by_name_and_index(tmp_path):
    path = write(tmp_path, "a,b,c,d\n" + text(U, 2 * X, T, X))
    by_name = read_record(path, {"t": "c", "u": "a", "x": "d", "reference": "b"})
    by_index = read_record(path, {"t": 2, "u": 0, "x": -1, "reference": 1})
    assert by_name == by_index
    assert np.array_equal(by_name.reference, 2 * X) and np.array_equal(by_name.x, X)
    bare = write(tmp_path, text(T, U, X, 2 * X), "bare.csv")
    assert np.array_equal(read_record(bare).reference, 2 * X)
    wide = write(tmp_path, text(U, U, T, U, X), "wide.csv")
    assert np.array_equal(read_record(wide, {"t": 2, "u": 0, "x": 4}).x, X)
    named = write(tmp_path, "t,u,x [mm],ref [mm]\n" + text(T, U, X, X), "n.csv")
    assert read_record(named, {"x": "x", "reference": None}).reference is None
    assert np.array_equal(read_record(named).reference, read_record(named).x)


def lines_with(row, cells):
    lines = LOG.splitlines()
    lines[row - 1] = cells
    return "\n".join(lines)


BAD_TEXT = {
    "empty": ("", "is empty"), "heading only": ("t,u,x\n", "a heading and no data rows"),
    "blank": ("\n \n\n", "no data, only blank or comment lines"),
    "comments only": ("# a\n# b\n", "no data, only blank or comment lines"),
    "text in numbers": (lines_with(7, "0.005,abc,1"), r"row 7, column 'u' \(u\): 'abc' is not"),
    "text in the last row": (lines_with(401, "0.399,1,x"), r"row 401, column 'x' \(x\): 'x'"),
    "empty cell": (lines_with(9, "0.007,,1"), "row 9, column 'u' .* the cell is empty"),
    "too few columns": (lines_with(5, "0.003,1"), "row 5 has 2 columns, the first has 3"),
    "too many columns": (lines_with(5, "0.003,1,2,3"), "row 5 has 4 columns, the first has 3"),
    "thousands": (lines_with(5, '0.003,"1,000.5",2'), "row 5, column 'u' .*'1,000.5'"),
    "underscore": (lines_with(5, "0.003,1_0,2"), "row 5, column 'u' .*'1_0'"),
    "hexadecimal": (lines_with(5, "0.003,0x1F,2"), "row 5, column 'u' .*'0x1F'"),
    "other digits": (lines_with(5, "0.003,\u0661,2"), "row 5, column 'u'"),
    "mixed decimals": (LOG.replace(",", ";").replace("0.012;", "0,012;"),
                       "row 14: '0,012' mixes decimal commas and points"),
    "units contradict": ("t,u,x [mm]\n" + text(T, U, X), "gives x in 'mm', units= says 'm'",
                         dict(units={"x": "m"})),
    "uneven": ("t,u,x\n" + text(T + 2e-4 * np.sin(np.arange(N)), U, X), "not uniform"),
    "nan cell": (lines_with(5, "0.003,nan,2"), r"u has 1 values .* first u\[3\] = nan"),
    "overflow": (lines_with(5, "0.003,1e999,2"), r"u has 1 values .* u\[3\] = inf"),
    "one column": ("\n".join(map(str, T)), "1 column"),
    "many columns, no heading": (text(T, T, U, X, X), "5 columns and no heading"),
    "unknown headings": ("a,b,c\n" + text(T, U, X), "no column recognised as t, u, x; available: 'a', 'b'.*"
                         'columns={"t": "a", "u": "b", "x": "c"}'),
    "same heading twice": ("t,u,u,x\n" + text(T, U, U, X), "'u', 'u' could each"),
    "binary": ("t,u,x\n\0\1\2", "no plain text"),
    "time as position": ("t,u,x [ms]\n" + text(T, U, X), "x cannot be in 'ms'"),
    "units disagree": ("t,u,x [m],r [rad]\n" + text(T, U, X, X),
                       "reference is in rad but x in m"),
    "newer format": ("# dryfric-control record 2 {}\nt,u,x\n" + text(T, U, X), "update the package"),
    "damaged first line": ('# dryfric-control record 1 {"na\nt,u,x\n' + text(T, U, X), "damaged"),
    "wrong first line": ("# dryfric-control record 1 [1]\nt,u,x\n" + text(T, U, X), "damaged"),
    "gap": ("t,u,x\n" + text(T[~GAP], U[~GAP], X[~GAP]), r"about 9 samples dropped.*dt=0.001, max_gap=0.0101\)"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD_TEXT)
def test_bad_text_is_told(tmp_path, case):
    content, message, *options = BAD_TEXT[case]
    with pytest.raises(ValueError, match=message):
        read_record(write(tmp_path, content), **(options[0] if options else {}))


def test_long_files_are_read_in_pieces(tmp_path):
    # two pieces; the decimal mark shows up in the last, text beside the data throughout
    n = 66_000
    u = np.tile([0.0, 1.0], n // 2)
    u[-1] = 2.5
    for end, mark in ((";ok", ","), ("", ".")):
        lines = [f"{2 * k};{v:g};{k % 977}{end}".replace(".", mark) for k, v in enumerate(u)]
        head = "t [ms];u;x" + (";mode" if end else "")
        record = read_record(write(tmp_path, "\n".join([head, *lines])), unwrap=977)
        assert np.array_equal(record.u, u) and record.dt == 2e-3
        assert np.array_equal(record.x, np.arange(n))


VALUES = hnp.arrays(float, 25, elements=st.floats(-1e90, 1e90))
WORDS = st.text(st.characters(codec="utf-8"), max_size=12)


@settings(max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    u=VALUES, x=VALUES, commanded=st.booleans(), start=st.floats(-1e4, 1e4),
    dt=st.sampled_from([1e-5, 1e-3, 1 / 3000, 0.02]), name=st.none() | WORDS, note=WORDS,
    unit=st.sampled_from(["", "m", "rad", "counts", "V"]),
)  # fmt: skip
def test_csv_and_frames_keep_every_bit(tmp_path, u, x, commanded, start, dt, name, note, unit):
    with warnings.catch_warnings(action="ignore", category=RecordWarning):
        t = start + dt * np.arange(25)
        try:
            r = u if commanded else None
            record = Record(t, u, x, r, name=name, notes=[note], units={"x": unit})
        except ValueError:
            return  # constant, or a jump: told elsewhere
        path = tmp_path / "a.csv"
        record.to_csv(path)
        for back in (read_record(path), Record.from_frame(record.to_pandas())):
            assert back == record
            assert back.x.tobytes() == record.x.tobytes()
            assert (back.dt, back.quantum) == (record.dt, record.quantum)
            assert back.notes == record.notes


def test_an_xarray_dataset_has_units_and_no_masked_readings():
    pytest.importorskip("xarray")
    good = np.ones(len(T), bool)
    good[7] = False
    record = Record(T, U, X, X, units={"u": "N", "x": "m"}, name="run", quantum=1e-6, good=good)
    data = record.to_xarray()
    assert {k: v.attrs["units"] for k, v in data.variables.items()} == {
        "time": "s", "u": "N", "x": "m", "reference": "m",
    }  # fmt: skip
    assert np.isnan(data.x[7]) and np.array_equal(data.x[~np.isnan(data.x)], X[good])
    assert np.array_equal(data.time, T) and data.attrs["quantum"] == 1e-6
    data.x[0] = 9.0  # a copy
    assert record.x[0] == X[0]


def test_frames():
    pd = pytest.importorskip("pandas")
    frame = pd.DataFrame({"force [N]": U, "pos [mm]": 1e3 * X}, index=pd.Index(T, name="time"))
    before = frame.copy()
    record = Record.from_frame(frame)
    assert np.array_equal(record.t, T) and dict(record.units) == {"t": "s", "u": "N", "x": "m"}
    np.testing.assert_allclose(record.x, X, rtol=1e-15)
    pd.testing.assert_frame_equal(frame, before)
    own = Record.from_frame(frame.reset_index(), {"u": "force", "x": 2})
    assert own == record
    with pytest.raises(ValueError, match="no column recognised as t"):
        Record.from_frame(frame.reset_index(drop=True))
    with pytest.raises(ValueError, match="two columns"):
        Record.from_frame(pd.DataFrame(np.c_[T, U, X], columns=["t", "u", "u"]))


def test_mat_files(tmp_path):
    path = tmp_path / "run.mat"
    savemat(path, {"t": T[:, None], "u": U[None, :], "x": X, "note": "text", "k": 3.0})
    assert read_record(path) == Record(T, U, X, name="run")
    savemat(path, {"data": {"time": T, "force": U, "pos": X}})
    nested = read_record(path, {"t": "data.time", "u": "data.force", "x": "data.pos"})
    assert np.array_equal(nested.x, X)
    savemat(path, {"log": np.c_[T, U, X]})
    matrix = read_record(path, {"t": "log.0", "u": "log.1", "x": "log.2"})
    assert np.array_equal(matrix.u, U)


def test_emps_layout_applies_its_gain(tmp_path):
    path = tmp_path / "made.mat"
    savemat(path, {"t": T, "qm": X, "qg": 2 * X, "vir": U, "gtau": 35.0, "kp": 160.0})
    record = read_record(path)
    assert np.array_equal(record.u, 35.0 * U) and np.array_equal(record.reference, 2 * X)
    assert dict(record.units) == {"t": "s", "u": "N", "x": "m"}
    assert "35" in record.notes[0]
    raw = read_record(path, {"u": "vir"}, gain=2.0)
    assert np.array_equal(raw.u, 2.0 * U)
    with pytest.raises(ValueError, match=r"'virr' is not in made.mat; .*'gtau'.*mean 'vir'\?"):
        read_record(path, {"u": "virr"})


@settings(max_examples=200, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    rows=hnp.arrays(
        float, st.tuples(st.integers(10, 15), st.just(2)), elements=st.floats(-1e9, 1e9)
    ),
    dialect=st.sampled_from([",.", ";.", ";,", "\t.", "\t,", "  .", " ,"]),
    heading=st.booleans(),
    style=st.sampled_from(["{!r}", "{:.3f}", "{:+.6e}", "{:g}", "{:.0f}"]),
    end=st.sampled_from(["\n", "\r\n", "\r"]),
)
def test_numbers_are_read_as_written_or_refused(tmp_path, rows, dialect, heading, style, end):
    delimiter, decimal = dialect[:-1], dialect[-1]
    cells = [[f"{k * 1e-3:.3f}", *map(style.format, row.tolist())] for k, row in enumerate(rows)]
    head = [delimiter.join("tux")] if heading else []
    lines = head + [delimiter.join(c.replace(".", decimal) for c in line) for line in cells]
    with warnings.catch_warnings(action="ignore", category=RecordWarning):
        try:
            record = read_record(write(tmp_path, end.join(lines) + end))
        except ValueError:
            return  # constant, or a jump: told elsewhere
    true = np.array([[float(c) for c in line] for line in cells])
    assert np.array_equal(np.c_[record.t, record.u, record.x], true)


def test_bam_log(tmp_path):
    path = write(tmp_path, damage.bam_log().decode(), "log.json")
    found = read_bam(path, dt=0.004)
    record = found["record"]
    assert (found["mass"], found["kp"], found["trajectory"], record.dt) == (0.49, 100, "b", 0.004)
    assert record.units["u"] == "V" and record.quantum == pytest.approx(1 / 4096)
    for key in ("volts", "temperature", "torque_enable"):
        assert found[key].shape == (len(record),)
    # forward drive first, then reverse, then none
    assert record.u[0] == pytest.approx(100 / 885 * 7.5)
    stamps = np.array([e["timestamp"] for e in json.loads(damage.bam_log())["entries"]])
    middle = np.searchsorted(record.t, stamps[40]) - 1
    assert -50 / 885 * 7.5 < record.u[middle] < -30 / 885 * 7.5
    off = record.t > stamps[50]
    assert record.u[off] == pytest.approx(0, abs=1e-12) and not found["torque_enable"][off].any()
    assert found["torque_enable"][record.t < stamps[50]].all()
    assert set(found["temperature"]) == {28.0, 29.0}
