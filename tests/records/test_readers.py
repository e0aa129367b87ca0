"""What common programs write, read as it is or refused with its cause."""

import datetime
import functools
import gzip
import io
import json
import struct
import sys
import warnings
import zlib

import damage
import numpy as np
import pytest
from made_logs import text, write
from scipy.io import savemat

import dryfric_control as dfc
from dryfric_control.estimation.plausibility import checked_records
from dryfric_control.records.read import as_record

N = 300
T = 1e-3 * np.arange(N)
U = np.round(3.0 * np.cos(40 * T), 6)
X = np.round(0.02 * np.sin(11 * T), 7)


def same(record, scale=1.0):
    np.testing.assert_allclose(record.x, X * scale, rtol=1e-8)
    np.testing.assert_allclose(record.u, U, rtol=1e-8, atol=1e-9)
    assert record.dt == pytest.approx(1e-3)


TEXTS = {
    "# in a heading": "sample #,t [s],u [N],x [m]\n" + text(np.arange(N), T, U, X),
    "heading behind #, comments behind it": "#t,u,x\n# recorded on a Monday\n" + text(T, U, X),
    "comma and blanks": "t , u, x\n" + text(T, U, X, mark=", "),
    "byte order mark": "\ufefft,u,x\n" + text(T, U, X),
    "comments": "# made by hand\n\n# on a Monday\nt,u,x\n" + text(T, U, X, end="  # ok\n"),
    "quoted": '"t","u","x"\n"' + text(T, U, X, mark='","', end='"\n"')[:-1],
    "trailing delimiter": "t,u,x,\n" + text(T, U, X, end=",\n"),
    "trailing delimiter in rows only": "t,u,x\n" + text(T, U, X, end=",\n"),
    "text in another column": "t,u,x,mode\n" + text(T, U, X, end=",slip\n"),
    "sep= of Excel": "sep=;\nt;u;x\n" + text(T, U, X, mark=";"),
    "per cent comments": "% made by octave\n% t,u,x\n" + text(T, U, X),
    "commented heading of blanks": "# t u x\n" + text(T, U, X, mark=" "),
    "trailing tab": "t\tu\tx\t\n" + text(T, U, X, mark="\t").replace("\n", "\t\n"),
    "trailing tab, no heading": text(T, U, X, mark="\t").replace("\n", "\t\n"),
    "row of units": "Time;Force;Pos\nms;N;mm\n" + text(1e3 * T, U, 1e3 * X, mark=";"),
    "long preamble": "".join(f"Setting {k}: on\n" for k in range(60)) + "t,u,x\n" + text(T, U, X),
}  # fmt: skip


@pytest.mark.parametrize("case", TEXTS)
def test_what_programs_write_is_read(tmp_path, case):
    record = dfc.read_record(write(tmp_path, TEXTS[case]))
    same(record)
    assert record.name == "run" and record.reference is None


@pytest.mark.parametrize(
    ("content", "note"),
    [
        ("Oscilloscope DSO-X\nDate: 2026-03-02\nChannels,3\n\nt,u,x\n" + text(T, U, X),
         "3 lines above the heading were skipped"),
        ("a motion\nt,u,x\n" + text(T, U, X), "1 line above the heading was skipped"),
        ("t,u,x,temp [C],flag\n" + text(T, U, X, X, X), "left out: 'temp [C]', 'flag'"),
        ("t,u,x,target_position,position_demand\n" + text(T, U, X, X, X),
         "left out: 'target_position', 'position_demand'"),
    ],
)  # fmt: skip
def test_what_is_left_out_is_noted(tmp_path, content, note):
    record = dfc.read_record(write(tmp_path, content))
    same(record)
    assert record.notes == (note,) and record.reference is None
    with pytest.raises(ValueError, match="row 2 has 2 columns, row 3 has 3"):
        dfc.read_record(write(tmp_path, "t,u,x\n0.5,1.0\n" + text(T, U, X)))


def test_a_source_without_time_takes_a_rate_or_a_step(tmp_path):
    path = write(tmp_path, "u,x\n" + text(U, X))
    same(dfc.read_record(path, rate=1000.0))
    same(dfc.read_record(path, dt=1e-3))
    same(dfc.read_record(write(tmp_path, text(U, X)), rate=1000.0))
    same(dfc.read_record({"u": U, "x": X}, rate=1000.0))
    with pytest.raises(ValueError, match="or give rate="):
        dfc.read_record(write(tmp_path, "u,x,y0\n" + text(U, X, X)))
    timed = write(tmp_path, "t,u,x\n" + text(T, U, X), "timed.csv")
    same(dfc.read_record(timed, columns={"t": None}, rate=1000.0))


def test_one_channel_per_file(tmp_path):
    files = {name: write(tmp_path, "\n".join(f"{v:.9g}" for v in values), f"{name}.t")
             for name, values in (("t", T), ("u", U), ("x", 1e3 * X))}  # fmt: skip
    same(dfc.read_record(files, units={"x": "mm"}))
    paired = {name: write(tmp_path, f"% {name}\n" + text(T, values, mark="\t"), f"{name}2.t")
              for name, values in (("u", U), ("x", X))}  # fmt: skip
    same(dfc.read_record(paired))
    headed = write(tmp_path, "pos [mm]\n" + text(1e3 * X), "x3.t")
    same(dfc.read_record({**files, "x": headed}))
    late = write(tmp_path, text(T + 1e-4, X), "late.t")
    with pytest.raises(ValueError, match="have other time stamps"):
        dfc.read_record({"u": paired["u"], "x": late})
    with pytest.raises(ValueError, match="has 3 numbers; a file of one channel"):
        dfc.read_record({"t": T, "u": U, "x": write(tmp_path, text(T, U, X), "three.t")})


def test_gzip(tmp_path):
    content = text(T, U, X, heading="t,u,x").encode()
    packed = gzip.compress(content)
    record = dfc.read_record(write(tmp_path, packed, "run.csv.gz"))
    same(record)
    assert record.name == "run"
    for damaged in (content, packed[:-200], packed[:300] + b"\xff" * 300):
        with pytest.raises(ValueError, match="damaged or not compressed by gzip"):
            dfc.read_record(write(tmp_path, damaged, "run.csv.gz"))
    with pytest.raises(ValueError, match="only text such as run.csv.gz"):
        dfc.read_record(write(tmp_path, packed, "run.mat.gz"))


COUNTS = 2**62 + np.round(1e4 * np.sin(11 * T)).astype(np.int64)


def test_whole_numbers_beyond_float64_keep_every_count(tmp_path):
    moved = (COUNTS - COUNTS[0]).astype(float)
    from_arrays = dfc.read_record({"t": T, "u": U, "x": COUNTS, "r": COUNTS + 7})
    np.testing.assert_array_equal(from_arrays.x, moved)
    np.testing.assert_array_equal(from_arrays.reference, moved + 7)
    stamps = 1_700_000_000_123_456_789 + 1_000_000 * np.arange(N)  # of the epoch
    assert dfc.read_record({"t [ns]": stamps, "u": U, "x": X}).dt == 1e-3
    lines = "\n".join(f"{t},{u!r},{x}" for t, u, x in zip(stamps, U.tolist(), COUNTS, strict=True))
    from_file = dfc.read_record(write(tmp_path, "time [ns],u,x [counts]\n" + lines))
    np.testing.assert_array_equal(from_file.x, moved)
    assert from_file.dt == 1e-3
    assert any("counted from" in note for note in from_file.notes)


@pytest.mark.parametrize(
    ("start", "step", "name"),
    [(0.0, 1e6, "nanoseconds"), (1.7e18, 1e6, "nanoseconds"), (1.7e15, 1000.0, "microseconds"),
     (0.0, 1000.0, "microseconds"), (1.7e12, 1.0, "milliseconds"), (1.7e12, 100.0, "milliseconds")],
)  # fmt: skip
def test_the_unit_of_a_clock_is_named(start, step, name):
    with pytest.warns(dfc.RecordWarning, match=f"time suspected in {name}"):
        dfc.Record(start + step * np.arange(N), U, X)


PD = pytest.importorskip("pandas")
CLOCK = PD.Timestamp("2026-03-02 10:00") + PD.to_timedelta(np.arange(N), unit="ms")


@pytest.mark.parametrize(
    "times",
    [CLOCK.as_unit("ns"), CLOCK.as_unit("ms"), CLOCK.tz_localize("Europe/Berlin"), CLOCK - CLOCK[0],
     CLOCK.to_pydatetime()],
    ids=["nanoseconds", "milliseconds", "time zone", "durations", "datetime"],
)  # fmt: skip
@pytest.mark.parametrize("heading", ["t", "time [ms]"])
def test_dates_are_scaled_once(times, heading):
    frame = PD.DataFrame({heading: times, "u": U, "x": X})
    same(dfc.read_record(frame))
    same(dfc.read_record({heading: frame[heading].to_numpy(), "u": U, "x": X}))
    if heading == "t":
        with pytest.raises(ValueError, match="gives t in 's', units= says 'ms'"):
            dfc.read_record(frame, units={"t": "ms"})
        same(dfc.read_record(frame.set_index("t")))


STAMPS = {
    "dates": [str(one) for one in CLOCK],
    "times of day": [f"{one:%H:%M:%S.%f}" for one in CLOCK],
    "counts from 1970": (CLOCK.as_unit("us").asi8).tolist(),
}


@pytest.mark.parametrize("stamps", STAMPS)
@pytest.mark.parametrize("heading", ["記録", "Registro", "tick"])
def test_the_only_column_of_dates_is_the_time(tmp_path, heading, stamps):
    note = f"{heading!r} taken as t: the only column of dates"
    path = write(tmp_path, f"{heading},u,x\n" + text(STAMPS[stamps], U, X))
    record = dfc.read_record(path)
    same(record)
    assert note in record.notes
    # What a rate hides is said; that there is no time may be stated.
    with pytest.warns(dfc.RecordWarning, match=f"dates of '{heading}' are left out.*lost rows"):
        same(dfc.read_record(path, rate=1000.0))
    with warnings.catch_warnings(action="error"):
        same(dfc.read_record(path, rate=1000.0, columns={"t": None}))
    with pytest.raises(ValueError, match="samples dropped"):
        kept = np.arange(N) != 7
        lines = text(*(np.array(c)[kept] for c in (STAMPS[stamps], U, X)))
        dfc.read_record(write(tmp_path, f"{heading},u,x\n{lines}"))
    if stamps == "dates":
        assert note in dfc.read_record(PD.DataFrame({heading: CLOCK, "u": U, "x": X})).notes
    # Of two the line names one.
    path = write(tmp_path, f"{heading},sent,u,x\n" + text(STAMPS[stamps], STAMPS[stamps], U, X))
    with pytest.raises(ValueError, match=f"could each be t.*columns=..t.: .{heading}.}}\\)$"):
        dfc.read_record(path)


@pytest.mark.parametrize(
    "heading",
    [
        "時刻",
        "日時",
        "タイムスタンプ",
        "日期时间",
        "Horodatage",
        "logged at",
        "datum_zeit",
        "epoch",
    ],
)
def test_a_name_for_date_and_time_is_that_of_the_time(tmp_path, heading):
    record = dfc.read_record(write(tmp_path, f"{heading},u,x\n" + text(T, U, X)))
    same(record)
    assert record.notes == ()
    same(dfc.read_record({heading: CLOCK.to_numpy(), "u": U, "x": X}))
    # Beside a time it is left out.
    same(dfc.read_record({heading: 7.0 * T, "time": T, "u": U, "x": X}))


@pytest.mark.parametrize(
    ("headings", "line"),
    [
        ("a,b,c", 'columns={"t": "a", "u": "b", "x": "c"}'),
        ("tick,u,x", 'columns={"t": "tick"}'),
        ("foo,bar,pos", 'columns={"t": "foo", "u": ...}'),
    ],
)
def test_roles_that_no_column_has_are_told_at_once(tmp_path, headings, line):
    path = write(tmp_path, f"{headings}\n" + text(T, U, X))
    with pytest.raises(ValueError, match="no column recognised as t") as refused:
        dfc.read_record(path)
    assert str(refused.value).endswith(f"Read it by read_record({json.dumps(str(path))}, {line})")
    if "..." not in line:
        same(eval(f"dfc.read_record(path, {line})"))
    # The numbers of the rows are no time.
    path = write(tmp_path, "row,u,x\n" + text(np.arange(N), U, X))
    with pytest.raises(ValueError, match=r"run.csv\", rate=\.\.\.\)$"):
        dfc.read_record(path)


FRAME = PD.DataFrame({"t": T, "u": U, "x": X})


@pytest.mark.parametrize("mark", [".", ","])
def test_text_in_a_data_frame_is_read_as_that_of_a_file(mark):
    words = FRAME.astype(str).apply(lambda column: column.str.replace(".", mark))
    same(dfc.read_record(words))
    same(dfc.read_record(words.assign(x=X.astype(object))))
    same(dfc.read_record(words.assign(t=CLOCK.astype(str))))
    lost = words.assign(u=words["u"].where(words.index != 7, "nan"))
    assert dfc.read_record(lost, dt=1e-3).bad["filled"] == 1
    for broken in ("broken", "1,234.5"):
        cells = words.assign(u=words["u"].where(words.index != 7, broken))
        with pytest.raises(ValueError, match=r"u is of dtype object.*read_csv.*decimal=','"):
            dfc.read_record(cells)


def test_an_empty_data_frame_is_told_as_an_empty_file_is():
    with warnings.catch_warnings(action="error"):
        with pytest.raises(ValueError, match="the data frame holds headings and no data rows"):
            dfc.read_record(FRAME.iloc[:0])


def test_headings_of_several_levels_are_paths():
    table = {("time", ""): T, ("axis1", "torque"): U, ("axis1", "pos"): X}
    frame = PD.DataFrame(table | {("axis2", "torque"): X, ("axis2", "pos"): U})
    several = r"'axis1\.torque', 'axis2\.torque' could each be u.*read_record\(source, joint=1\)$"
    with pytest.raises(ValueError, match=several):
        dfc.read_record(frame)
    same(dfc.read_record(frame, joint=1))
    same(dfc.read_record(frame, joint="axis1"))
    same(dfc.read_record(frame, columns={"u": "axis1.torque", "x": "axis1.pos"}))


def test_python_dates_with_a_time_zone_are_read():
    zone = datetime.timezone(datetime.timedelta(hours=2))
    start = datetime.datetime(2026, 3, 2, 10, tzinfo=zone)
    stamps = [start + datetime.timedelta(milliseconds=k) for k in range(N)]
    same(dfc.read_record({"t": stamps, "u": U, "x": X}))
    stamps[5] = stamps[5].replace(tzinfo=None)
    with pytest.raises(ValueError, match="with and without a time zone"):
        dfc.read_record({"t": stamps, "u": U, "x": X})
    times = CLOCK.to_numpy().copy()
    times[7] = np.datetime64("NaT")
    with pytest.raises(ValueError, match=r"t has 1 missing times \(NaT\), the first in row 7"):
        dfc.read_record({"t": times, "u": U, "x": X})


def test_mat_version_4(tmp_path):
    path = tmp_path / "old.mat"
    savemat(path, {"t": T, "u": U[:, None], "x": X, "note": "text"}, format="4")
    same(dfc.read_record(path))
    whole = path.read_bytes()
    for damaged in (whole[:-9], whole[:30], whole[:4] + b"\xff" * 16 + whole[20:]):
        with pytest.raises(ValueError, match="damaged or no MAT-file"):
            dfc.read_record(write(tmp_path, damaged, "damaged.mat"))


def test_a_mat_bomb_is_refused_by_what_it_claims(tmp_path):
    squeezed = zlib.compressobj(9)
    data = squeezed.compress(struct.pack("<II", 14, 2**30))
    data += b"".join(squeezed.compress(bytes(2**20)) for _ in range(64)) + squeezed.flush()
    head = b"MATLAB 5.0".ljust(124) + b"\0\1IM" + struct.pack("<II", 15, len(data))
    with pytest.raises(ValueError, match="claims 1073741832 bytes"):
        dfc.read_record(write(tmp_path, head + data, "b.mat"))
    # A constant channel is none.
    constant = {"t": T, "u": U, "x": X, "unused": np.zeros(2**20)}
    savemat(tmp_path / "run.mat", constant, do_compression=True)
    same(dfc.read_record(tmp_path / "run.mat"))


@pytest.mark.parametrize(("kind", "library"), [("xlsx", "openpyxl"), ("parquet", "pyarrow")])
def test_spreadsheets_and_parquet(tmp_path, kind, library):
    pytest.importorskip(library)
    frame = PD.DataFrame({"t [ms]": 1e3 * T, "u": U, "x": X, "step": 1})
    path = tmp_path / f"run.{kind}"
    (frame.to_excel if kind == "xlsx" else frame.to_parquet)(path, index=False)
    record = dfc.read_record(path)
    same(record)
    assert record.notes[0] == "left out: 'step'"
    with pytest.raises(ValueError, match="is damaged or no"):
        dfc.read_record(write(tmp_path, path.read_bytes()[:-300], path.name))


def test_a_missing_library_is_named(tmp_path, monkeypatch):
    for name, library in (("a.parquet", "pandas"), ("a.mcap", "mcap")):
        for module in (library, f"{library}.reader"):  # the latter may be loaded already
            monkeypatch.setitem(sys.modules, module, None)
        words = rf"reading \.{name[2:]} needs {library}.*pip install"
        with pytest.raises(ImportError, match=words):
            dfc.read_record(write(tmp_path, "x", name))


def mcap_log(messages):
    writer_of = pytest.importorskip("mcap.writer").Writer
    file = io.BytesIO()
    writer = writer_of(file)
    writer.start()
    channel = functools.cache(lambda topic: writer.register_channel(topic, "json", 0))
    for topic, stamp, content in messages:
        data = json.dumps(content).encode()
        writer.add_message(channel(topic), log_time=stamp, publish_time=stamp, data=data)
    writer.finish()
    return file.getvalue()


def test_mcap_of_one_topic(tmp_path):
    log = mcap_log(("/axis", 10**18 + 10**6 * k, {"position": X[k], "effort": U[k], "mode": "on"})
                   for k in range(N))  # fmt: skip
    same(dfc.read_record(write(tmp_path, log, "run.mcap")))
    with pytest.raises(ValueError, match="damaged or no MCAP"):
        dfc.read_record(write(tmp_path, log[:500], "run.mcap"))


def test_stamps_in_headers_go_before_those_of_the_log(tmp_path):
    log = mcap_log(
        ("/joint_states", 10**18 + 10**6 * k + int(late),  # as the logger got to it
         {"header": {"stamp": {"sec": 100, "nanosec": 10**6 * k}}, "name": ["a", "b"],
          "position": [0.0, X[k]], "effort": [0.0, U[k]]})
        for k, late in enumerate(np.random.default_rng(0).integers(10**7, size=N))
    )  # fmt: skip
    same(dfc.read_record(write(tmp_path, log, "run.mcap"), joint="b"))


def test_mcap_of_two_topics_is_brought_onto_the_position(tmp_path):
    log = mcap_log(
        entry
        for k in range(N)
        for entry in (
            ("/drive", 10**6 * k, {"cmd": {"force": [U[k], 0.0]}}),
            ("/encoder", 10**6 * k + 1000, {"x": X[k]}),
        )
    )
    columns = {"u": "/drive.cmd.force.0", "x": "/encoder.x"}
    same(dfc.read_record(write(tmp_path, log, "run.mcap"), columns=columns))
    with pytest.raises(ValueError, match="'/drive.cmd.force.0', .* could each be u"):
        dfc.read_record(write(tmp_path, log, "run.mcap"), columns={"x": "/encoder.x"})


def test_mcap_of_ros_2(tmp_path):
    pytest.importorskip("mcap_ros2")
    log = damage.joint_states({"a": (0.0 * X, 0.0 * U), "b": (X, U)}, 10**6 * np.arange(N))
    path = write(tmp_path, log, "run.mcap")
    for asked in (dict(joint="b"), dict(columns={"x": "position.b"})):
        record = dfc.read_record(path, **asked)
        same(record)
        assert record.notes[0] == "left out: 'position.a', 'effort.a'"
    with pytest.raises(ValueError, match="'effort.a', 'effort.b' could each be u.*joint="):
        dfc.read_record(path)


def test_known_channels_are_kept_and_cut_with_the_rest(tmp_path):
    v, a = np.gradient(X, 1e-3), np.gradient(np.gradient(X, 1e-3), 1e-3)
    heading = "t,u,pos [mm],velocity [mm/s],acc,load_position"
    record = dfc.read_record(write(tmp_path, text(T, U, 1e3 * X, 1e3 * v, a, X, heading=heading)))
    assert list(record.channels) == ["v", "a", "x2"] and record.units["v"] == "m/s"
    np.testing.assert_allclose(record.channels["v"], v, rtol=1e-8)
    assert not record.channels["v"].flags.writeable
    part = record[50:250].decimated(2).resampled(1e-3)
    assert len(part.channels["v"]) == len(part)
    assert record.compare("v").gain == pytest.approx(1.0, abs=0.02)
    assert record.compare("x2").rms < 1e-6


def test_a_delay_of_a_channel_is_measured():
    late = np.interp(T - 5e-3, T, np.gradient(np.sin(30 * T), 1e-3))
    record = dfc.Record(T, U, np.sin(30 * T), channels={"v": 2.0 * late + 1.0})
    found = record.compare("v")
    assert found.delay == pytest.approx(5e-3, abs=1e-3)
    assert found.gain == pytest.approx(2.0, rel=0.02)
    assert found.offset == pytest.approx(1.0, rel=0.1)


def test_a_path_stands_for_its_record(tmp_path):
    axis, record = dfc.datasets.belt_stage_axis(), dfc.datasets.belt_stage()
    path = tmp_path / "run.csv"
    record.to_csv(path)
    assert as_record(path) == as_record(str(path)) == record
    assert checked_records([path]) == checked_records(record) == (record,)
    assert dfc.replay(axis, path).median == dfc.replay(axis, record).median
    with pytest.raises(ValueError, match=r"must be a Record \(or the path of its file"):
        as_record(record.t)
    with pytest.raises(ValueError, match=r"record\[1\] hold the same data"):
        checked_records([path, str(path)])
