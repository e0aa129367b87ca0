"""Clocks: the unit of bare stamps, coarse stamps, several clocks in one table, all reasons at once."""

import re
import warnings

import numpy as np
import pytest
from made_logs import text, write

import dryfric_control as dfc
from dryfric_control.records.clock import even_clock

N = 2000
K = np.arange(N)
T = 1e-3 * K
U = np.sin(7.0 * T)
X = np.sin(3.0 * T)


@pytest.mark.parametrize(
    ("first", "step", "words"),
    [
        (1_720_085_544_312_973_400, 1_000_000, "ns since 1970"),
        (1_720_085_544_312_973, 1000, "us since 1970"),
        (1_720_085_544_312, 1, "ms since 1970"),
        (133_645_591_443_129_734, 10_000, "100 ns since 1601"),
    ],
)
def test_stamps_since_a_date_are_known_by_their_size(first, step, words):
    with warnings.catch_warnings(action="error"):
        record = dfc.read_record({"time": first + step * K, "u": U, "x": X})
    assert record.dt == pytest.approx(1e-3) and f"t taken as {words}" in record.notes
    with pytest.raises(ValueError, match="gives t in 's'|so large"):
        dfc.read_record({"time [s]": first + step * K, "u": U, "x": X}, units={"t": "ms"})


@pytest.mark.parametrize("start", [1000.0, 3000.0, 10_000.0])
@pytest.mark.parametrize("rate", [1e-3, 2e-3, 1.25e-3])
def test_stamps_in_single_precision_lose_nothing(start, rate):
    stamps = (start + rate * np.arange(5000)).astype(np.float32)
    x = np.sin(3.0 * rate * np.arange(5000))
    record = dfc.read_record({"t": stamps, "u": x, "x": x})
    assert record.dt == pytest.approx(rate, rel=1e-9) and len(record) == 5000
    assert any("single precision" in note and "no samples lost" in note for note in record.notes)


def test_samples_that_are_lost_among_coarse_stamps_are_counted():
    kept = np.delete(np.arange(5000), [700, 1500, 1501, 3200])
    stamps = (3000.0 + 2e-3 * kept).astype(np.float32)  # to 0.24 ms
    x = np.sin(6e-3 * kept)
    even = even_clock(stamps.astype(float))
    assert "4 samples lost" in even.note
    np.testing.assert_allclose(even.t - even.t[0], 2e-3 * kept, rtol=0, atol=1e-9)
    with pytest.raises(ValueError, match="3 gaps in t, about 4 samples dropped"):
        dfc.read_record({"t": stamps, "u": x, "x": x})
    with pytest.warns(dfc.RecordWarning, match="4 filled and masked"):
        record = dfc.read_record({"t": stamps, "u": x, "x": x}, dt=2e-3)
    assert np.flatnonzero(~record.good).tolist() == [700, 1500, 1501, 3200]


def test_stamps_in_whole_milliseconds_of_another_rate():
    """800 Hz, written with three decimals."""
    stamps = np.round(1.25e-3 * K, 3)
    record = dfc.read_record({"t": stamps, "u": U, "x": X})
    assert record.dt == pytest.approx(1.25e-3, rel=1e-6)
    # Jitter of the clock itself is none of the rounding, and a few losses are losses.
    rng = np.random.default_rng(0)
    assert even_clock(np.round(T + 2e-4 * rng.standard_normal(N), 6)) is None
    assert even_clock(np.delete(T, [400, 900])) is None
    assert even_clock(T) is None


def test_all_that_must_be_known_is_known_after_one_call(tmp_path):
    """Two joints, stamps with jitter, lost rows, an encoder that wraps: one error, one line."""
    rng = np.random.default_rng(1)
    kept = np.delete(K, np.arange(600, 608))
    stamps = 1_720_085_544_312_973_400 + 2_000_000 * kept + rng.integers(-40_000, 40_000, kept.size)
    t = 2e-3 * kept
    turns = (0.4 * t) % 1.0
    heading = "TIME;pos_1 [rev];pos_2 [rev];torque_1 [N m];torque_2 [N m]"
    content = text(stamps, turns, 0.1 * np.sin(t), np.cos(t), np.sin(t), heading=heading, mark=";")
    path = write(tmp_path, content)
    with pytest.raises(ValueError, match=r"for \d reasons") as refused:
        dfc.read_record(path)
    said = str(refused.value)
    for words in ("could each be u", "jitter|gaps in t", "wraps around", "max_gap="):
        assert re.search(words, said), words
    line = re.search(r"read_record\(.*\)$", said)[0]
    with warnings.catch_warnings(action="ignore"):
        record = eval(f"dfc.{line}")
    assert record.dt == pytest.approx(2e-3) and record.range > 9.0  # rad, over 4 s
    assert record.bad["filled"] >= 7


def test_rows_of_two_rates_that_were_joined(tmp_path):
    """An outer join has a gap where the other channel was read."""
    pd = pytest.importorskip("pandas")
    position = pd.DataFrame({"t": T, "x": X})
    slow = 2.5e-3 * np.arange(800)
    torque = pd.DataFrame({"t": slow, "u": np.sin(7.0 * slow)})
    joined = position.merge(torque, on="t", how="outer").sort_values("t")
    joined.to_csv(tmp_path / "joined.csv", index=False)
    for source in (joined, tmp_path / "joined.csv"):
        record = dfc.read_record(source)
        assert len(record) == N - 1 or len(record) == N
        np.testing.assert_array_equal(record.x, X[: len(record)])
        last = np.floor(record.t / 2.5e-3 + 1e-9) * 2.5e-3
        np.testing.assert_allclose(record.u, np.sin(7.0 * last), atol=1e-12)
        straight = dfc.read_record(source, hold="first")
        # Between readings 2.5 ms apart a line is off by h^2/8 times the second derivative.
        inner = record.t < slow[-1]
        np.testing.assert_allclose(straight.u[inner], np.sin(7.0 * record.t[inner]), atol=4e-5)
    # A number or two that lack are no other rate.
    lacking = joined[joined.x.notna()].assign(u=U)
    lacking.loc[lacking.index[5], "u"] = np.nan
    with pytest.raises(ValueError, match=r"not finite|dt="):
        dfc.read_record(lacking)


def test_a_staircase_is_named_and_read_along_straight_lines():
    axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    t = 1e-3 * np.arange(8000)

    def drive(t):
        return 12.0 * np.sin(8.17 * t) + 5.0 * np.sin(25.8 * t + 1.0)

    x = np.round(axis.simulate(drive(t), dt=1e-3, hold="first").y[0], 6)
    held = drive(np.floor(t / 2.5e-3 + 1e-9) * 2.5e-3)
    record = dfc.read_record({"t": t, "u": held, "x": x})
    assert "changes every 2.5 ms (400 Hz)" in str(record.check())
    straight = dfc.read_record({"t": t, "u": held, "x": x}, hold="first")
    assert "staircase" not in str(straight.check())
    off = [np.std(one.u - drive(one.t)) for one in (record, straight)]
    assert off[1] < 0.05 * off[0]


@pytest.mark.parametrize(
    "u",
    [
        np.sign(U),  # a square wave
        np.repeat(np.random.default_rng(0).normal(size=N // 10), 10),  # steps of the drive's own
        np.round(U, 1),  # coarse
        np.round(np.linspace(0.0, 1.0, N), 2),  # a coarse ramp
        U,
    ],
    ids=["square", "steps", "coarse", "ramp", "smooth"],
)
def test_other_drives_are_no_staircase(u):
    assert "staircase" not in str(dfc.Record(T, u, X).check())


def scope(mark, decimal, filled, full=False):
    """An export of TwinCAT Scope with sample times of 1 and 2 ms."""
    rows = [f"Name{mark}Scope Project", f"Starttime of export{mark}132959733843760000{mark}Monday", "",
            mark.join(["Name", "ActPos", "Name", "ActTorque"]),
            mark.join(["SampleTime[ms]", "1", "SampleTime[ms]", "2"]),
            mark.join(["ScaleFactor", "1", "ScaleFactor", "0.5".replace(".", decimal)]),
            mark.join(["Unit", "mm (Length)", "Unit", "Nm (Torque)"]), ""]  # fmt: skip
    start, ms = (132959733843760000, 10_000) if full else (0, 1)
    for k in range(400):
        row = [str(start + ms * k), f"{1e3 * X[k]:.9f}"]
        if k < 200 or filled:
            at = k // 2 * 2 if filled else 2 * k
            row += [str(start + ms * at), f"{U[at]:.9f}"]
        rows.append(mark.join(row).replace(".", decimal))
    return "\r\n".join(rows) + "\r\nEOF\r\n"


@pytest.mark.parametrize("mark", ["\t", ";", ",", ":"])
@pytest.mark.parametrize("filled", [False, True], ids=["ends earlier", "repeats"])
@pytest.mark.parametrize("full", [False, True], ids=["ms", "100 ns since 1601"])
def test_channels_of_scope_with_sample_times_of_their_own(tmp_path, mark, filled, full):
    decimal = "," if mark in "\t;" else "."
    path = write(tmp_path, scope(mark, decimal, filled, full))
    record = dfc.read_record(path, columns={"u": "ActTorque"})
    assert record.dt == pytest.approx(1e-3) and len(record) == 400
    np.testing.assert_allclose(record.x, np.round(X[:400], 12), atol=1e-12)
    np.testing.assert_allclose(record.u, np.round(U[: 400 // 2 * 2 : 2].repeat(2), 9), atol=1e-9)
    assert dict(record.units) == {"t": "s", "u": "N m", "x": "m"}
    assert any("ActTorque has ScaleFactor" in note for note in record.notes)


def test_tables_of_arrow_and_polars():
    pa, pl = pytest.importorskip("pyarrow"), pytest.importorskip("polars")
    columns = {"t [ms]": 1e3 * T, "u": U, "x": X}
    gap = [None if k % 3 else float(one) for k, one in enumerate(U)]
    for table in (pa.table(columns), pl.DataFrame(columns)):
        record = dfc.read_record(table)
        np.testing.assert_array_equal(record.x, X)
        assert record.dt == pytest.approx(1e-3)
    for table in (pa.table({**columns, "u": gap}), pl.DataFrame({**columns, "u": gap})):
        record = dfc.read_record(table)
        np.testing.assert_array_equal(record.u, U[K // 3 * 3])
    pd = pytest.importorskip("pandas")
    whole = pd.array([None if k == 7 else k for k in K], dtype="Int64")
    with pytest.warns(dfc.RecordWarning, match="1 row without a number"):
        dfc.read_record(pd.DataFrame({"t": T, "u": U, "x": whole}), dt=1e-3)


def test_a_frame_that_needs_a_library_names_the_line():
    class Column:
        dtype = np.dtype(float)

        def to_numpy(self):
            raise ModuleNotFoundError("No module named 'pyarrow'", name="pyarrow")

    class Frame:
        columns = ("t", "u", "x")

        def __getitem__(self, name):
            return Column()

    with pytest.raises(
        ImportError, match=r'needs pyarrow .*pip install "dryfric-control\[tables\]"'
    ):
        dfc.read_record(Frame())


def test_a_run_under_one_force_is_read_with_a_warning():
    """A drop, or a constant velocity; an axis that turns round has another drive."""
    with pytest.warns(dfc.RecordWarning, match="a run under one force"):
        dfc.read_record({"t": T, "u": np.ones(N), "x": 0.5 * T**2})
    with pytest.raises(ValueError, match="u is constant"):
        dfc.read_record({"t": T, "u": np.ones(N), "x": X})


def test_moments_far_from_zero_are_told_apart():
    """Seconds since 1970 have ten digits before the point."""
    start = 1_796_030_000.0
    t = start + 1e-2 * np.arange(400)
    u, x = np.cos(3e-2 * np.arange(400)), np.sin(2e-2 * np.arange(400))
    record = dfc.Record(t, u, x)
    assert "1796030000 s to 1796030003.99 s" in record.summary()
    with pytest.raises(ValueError, match="record runs from 1796030000 s to 1796030003.99 s"):
        record.window(0.0, 4.0)
    kept = np.delete(np.arange(400), range(123, 140))
    with pytest.raises(ValueError, match=r"after t\[122\] = 1796030001.22 s"):
        dfc.Record(t[kept], u[kept], x[kept])
    with pytest.raises(ValueError, match=r"after t\[122\] = 1796030001.22 s"):
        dfc.Record.from_irregular(t[kept], u[kept], x[kept])
    x = x.copy()
    x[37] += 0.5
    with pytest.warns(dfc.RecordWarning, match=r"at t = 1796030000.37 s"):
        dfc.Record(t, u, x)
