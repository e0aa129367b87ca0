"""Logs whose channels have clocks of their own: made by the libraries of the field, read on one clock."""

import functools
import gc
import sys

import damage
import log_files as logs
import numpy as np
import pytest
from made_logs import write

import dryfric_control as dfc
from dryfric_control.records.readers.can_log import _object_size
from dryfric_control.records.readers.limits import BoundedFile
from dryfric_control.records.readers.sources import _TABLES

#: Files by name: what makes them, the library, and how they are read.
FILES = {
    "mdf 4": (logs.mdf, "asammdf", {}),
    "tdms": (logs.tdms, "nptdms", {}),
    "tdms of DIAdem": (logs.tdms_with_times, "nptdms", {}),
    "ros 1": (logs.ros1, "rosbags", dict(joint="b")),
    "ros 1, no headers": (
        functools.partial(logs.ros1, header_stamps=False), "rosbags",
        dict(columns={"u": "/torque.data", "x": "/position.data"}),
    ),
    "ros 2": (logs.ros2, "rosbags", dict(joint="b")),
    "ros 2, no headers": (
        functools.partial(logs.ros2, header_stamps=False), "rosbags",
        dict(columns={"u": "/torque.data", "x": "/position.data"}),
    ),
    "ulog": (logs.ulog, "pyulog", {}),
    "ulog of two": (
        functools.partial(logs.ulog, instances=2), "pyulog", dict(columns={"x": "servo_0.position"}),
    ),
    "mat 7.3": (logs.mat73, "h5py", {}),
    "mat 7.3 of dSPACE": (logs.mat73_of_dspace, "h5py", {}),
    "mcap": (logs.mcap, "mcap", {}),
}  # fmt: skip
# What single precision leaves of a position of 0.03 m, and of a torque of 4 N m.
SINGLE = (2e-9, 3e-7)
# The start of a TDMS file comes back 1 ns off; the drive changes by 120 N m/s.
NANOSECOND = (1e-12, 2e-7)


@pytest.fixture
def made(name, tmp_path):
    """A file, and how it is read."""
    make, library, how = FILES[name]
    pytest.importorskip(library)
    return make(tmp_path), how


def check(record, x=logs.X, u=logs.HELD, off=(1e-12, 1e-12)):
    assert record.dt == pytest.approx(1e-3, rel=1e-9) and len(record) == logs.N
    np.testing.assert_allclose(record.x - record.x[0], x - x[0], rtol=0, atol=off[0])
    np.testing.assert_allclose(record.u, u, rtol=0, atol=off[1])


@pytest.mark.parametrize("name", FILES)
def test_the_input_is_held_onto_the_clock_of_the_position(name, made):
    path, how = made
    record = dfc.read_record(path, **how)
    check(record, off=SINGLE if "ulog" in name else (1e-12, 1e-12))
    if name.startswith(("mdf", "tdms", "ulog")):
        assert "u, read every 2 ms, held" in " ".join(record.notes)


@pytest.mark.parametrize("name", ["mdf 4", "tdms", "ros 2, no headers", "ulog", "mcap"])
def test_or_runs_along_straight_lines(name, made):
    path, how = made
    record = dfc.read_record(path, **how, hold="first")
    straight = np.interp(logs.T, 1e-3 * logs.SLOW, logs.U)
    check(record, u=straight, off={"ulog": SINGLE, "tdms": NANOSECOND}.get(name, (1e-12, 1e-12)))


def test_a_faster_input_is_averaged_over_each_step(tmp_path):
    """The impulse of a push of 0.2 ms at 10 kHz is kept."""
    asammdf = pytest.importorskip("asammdf")
    fine = 1e-4 * np.arange(10 * logs.N)
    push = np.where((fine > 0.1002) & (fine < 0.1005), 5.0, np.cos(20.0 * fine))
    file = asammdf.MDF()
    file.append([asammdf.Signal(logs.X, logs.T, name="position")])
    file.append([asammdf.Signal(push, fine, name="torque")])
    path = file.save(tmp_path / "run.mf4")
    record = dfc.read_record(path)
    np.testing.assert_allclose(record.u, push.reshape(-1, 10).mean(axis=1), atol=1e-9)


def test_a_whole_number_with_a_factor_is_what_it_stands_for(tmp_path):
    pytest.importorskip("asammdf")
    check(dfc.read_record(logs.mdf(tmp_path, "3.30")), u=np.round(logs.HELD, 2))


def test_a_measurement_file_that_breaks_off_is_refused_without_a_word_on_the_console(tmp_path):
    pytest.importorskip("asammdf")
    path = logs.mdf(tmp_path)
    content, found = path.read_bytes(), []
    hook, sys.unraisablehook = sys.unraisablehook, found.append
    try:
        # Within its head, and within the list of its blocks.
        for part in (0.02, 0.2, 0.5):
            path.write_bytes(content[: round(part * len(content))])
            with pytest.raises(ValueError, match="MDF file"):
                dfc.read_record(path)
            gc.collect()
    finally:
        sys.unraisablehook = hook
    assert found == []


def test_counts_of_another_channel_are_never_interpolated(tmp_path):
    asammdf = pytest.importorskip("asammdf")
    file = asammdf.MDF()
    file.append([asammdf.Signal(logs.X, logs.T, name="position"),
                 asammdf.Signal(logs.HELD, logs.T, name="torque")])  # fmt: skip
    slow = logs.COUNTS[::4].astype(np.int32)
    file.append([asammdf.Signal(slow, logs.T[::4], name="load_position")])
    record = dfc.read_record(file.save(tmp_path / "run.mf4"))
    np.testing.assert_array_equal(record.channels["x2"], np.repeat(slow, 4))


def test_channels_that_began_apart_are_not_put_into_one_row(tmp_path):
    """The first 30 ms of the position have no torque: they are left out, and the rest is in place."""
    nptdms = pytest.importorskip("nptdms")
    path = tmp_path / "apart.tdms"
    start = np.datetime64("2026-03-02T10:00:00", "ms")
    with nptdms.TdmsWriter(str(path)) as file:
        for name, values, late in (("position", logs.X, 0), ("torque", logs.HELD[30:], 30)):
            timing = dict(wf_increment=1e-3, wf_start_offset=0.0, wf_start_time=start + late)
            file.write_segment([nptdms.ChannelObject("g", name, values, properties=timing)])
    record = dfc.read_record(path)
    np.testing.assert_allclose(record.x, logs.X[30:], rtol=0, atol=1e-12)
    np.testing.assert_allclose(record.u, logs.HELD[30:], rtol=0, atol=1e-12)
    assert any("30 readings of x left out" in note for note in record.notes)


def test_a_run_that_was_started_again_has_its_own_times(tmp_path):
    pytest.importorskip("nptdms")
    path = logs.tdms_restarted(tmp_path)
    with pytest.raises(ValueError, match=r"gap of 0.801 s after t\[199\]"):
        dfc.read_record(path, dt=1e-3)


@pytest.mark.parametrize("name", ["run.blf", "run.asc", "run.trc", "run.log", "relative.asc"])
def test_frames_of_a_bus_by_their_database(tmp_path, name):
    pytest.importorskip("cantools")
    relative = name == "relative.asc"
    path = logs.asc_with_relative_stamps(tmp_path) if relative else logs.can_log(tmp_path, name)
    record = dfc.read_record(path, database=logs.database(tmp_path))
    check(record, x=1e-6 * logs.COUNTS, u=np.round(logs.HELD, 3))
    assert dict(record.units) == {"t": "s", "u": "N m", "x": "m", "v": "m/s"}
    with pytest.raises(ValueError, match="needs what its frames hold.*database=\\.\\.\\."):
        dfc.read_record(path)


def test_objects_of_cia_402(tmp_path):
    pytest.importorskip("canopen")
    how = dict(database=logs.eds(tmp_path))
    machine = dfc.Scaling(counts_per_turn=4096, rated_torque=1.0)
    record = dfc.read_record(logs.canopen_log(tmp_path), gain=machine, **how)
    check(record, x=2 * np.pi / 4096 * logs.COUNTS, u=np.round(logs.HELD, 3))
    assert record.raw["u"][0] == "0.1 %"
    two = logs.canopen_log(tmp_path, nodes=(5, 9), name="two.blf")
    check(dfc.read_record(two, joint=5, gain=machine, **how), x=record.x, u=record.u)
    with pytest.raises(ValueError, match=r"could each be u.*joint=5"):
        dfc.read_record(two, **how)


def test_joint_states_of_several_senders_and_without_efforts(tmp_path):
    """Messages of a gripper on the same topic take nothing from those of the arm."""
    pytest.importorskip("mcap")
    from test_readers import mcap_log

    rows = []
    for k in range(logs.N):
        arm = {"name": ["a"], "position": [logs.X[k]], "effort": [logs.HELD[k]]}
        grip = {"name": ["g"], "position": [0.0], "effort": []}
        rows += [
            ("/joint_states", 10**9 + 10**6 * k, arm),
            ("/joint_states", 10**9 + 10**6 * k + 7, grip),
        ]
    path = write(tmp_path, mcap_log(rows), "run.mcap")
    check(dfc.read_record(path, joint="a"))
    rows = [(topic, at, {**content, "effort": []}) for topic, at, content in rows]
    path = write(tmp_path, mcap_log(rows), "none.mcap")
    with pytest.raises(ValueError, match="no column recognised as u.*without values in.*: effort"):
        dfc.read_record(path, joint="a")


def test_what_matlab_keeps_elsewhere_is_named(tmp_path):
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "series.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        for name in ("torque", "angle"):
            file[name] = np.arange(6, dtype=np.uint32)[None, :]
            file[name].attrs["MATLAB_class"] = np.bytes_("timeseries")
            file[name].attrs["MATLAB_object_decode"] = np.int32(3)
        file["#refs#/a"] = logs.X
    logs._with_head(path)
    with pytest.raises(ValueError, match="angle, torque are MATLAB objects.*angle_x = angle.Data"):
        dfc.read_record(path)


EXTRAS = {
    ".mf4": ("asammdf", "mdf"), ".tdms": ("nptdms", "tdms"), ".bag": ("rosbags.highlevel", "ros"),
    ".db3": ("rosbags.highlevel", "ros"), ".ulg": ("pyulog", "ulog"), ".mcap": ("mcap.reader", "mcap"),
}  # fmt: skip


@pytest.mark.parametrize("suffix", EXTRAS)
def test_a_missing_extra_names_the_line_to_type(suffix, tmp_path, monkeypatch):
    module, extra = EXTRAS[suffix]
    monkeypatch.setitem(sys.modules, module, None)
    words = rf'reading {suffix} needs .*: pip install "dryfric-control\[{extra}\]"'
    with pytest.raises(ImportError, match=words):
        dfc.read_record(write(tmp_path, "x", f"run{suffix}"))


def test_a_missing_extra_of_a_database_and_of_hdf5(tmp_path, monkeypatch):
    for module, name, content, how in (
        ("cantools", "run.blf", "x", dict(database=logs.database(tmp_path))),
        ("h5py", "run.mat", b"MATLAB 7.3 MAT-file".ljust(512), {}),
    ):
        monkeypatch.setitem(sys.modules, module, None)
        with pytest.raises(ImportError, match=rf"needs {module}: pip install"):
            dfc.read_record(write(tmp_path, content, name), **how)


def test_every_reader_of_a_log_states_its_extra():
    import tomllib
    from pathlib import Path

    from dryfric_control.records.readers.log_file import LogFile

    project = tomllib.loads((Path(dfc.__file__).parents[1] / "pyproject.toml").read_text())
    extras = project["project"]["optional-dependencies"]
    readers = {
        one for one in _TABLES.values() if isinstance(one, type) and issubclass(one, LogFile)
    }
    assert len(readers) >= 6
    for one in (one for one in readers if one.modules):
        assert one.extra in extras and set(extras[one.extra]) <= set(extras["logs"]), one


@pytest.mark.slow
def test_an_import_loads_none_of_the_libraries():
    import subprocess

    libraries = "asammdf nptdms h5py rosbags can cantools canopen pyulog mcap pandas polars pyarrow"
    code = f"import sys, dryfric_control; print(set({libraries.split()}) & set(sys.modules))"
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert said.stdout.strip() == "set()"


DAMAGED = ("mdf", "tdms", "mat73", "ros1", "ros2", "blf", "asc", "trc", "candump", "ulog")


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # the library's
@pytest.mark.parametrize("kind", DAMAGED)
def test_a_damaged_log_is_refused_or_what_is_read_is_sound(kind, tmp_path):
    contents = damage.log_contents(tmp_path).get(kind)
    if not contents:
        pytest.skip("library not installed")
    rng = np.random.default_rng(DAMAGED.index(kind))
    for k in range(10):
        content = bytearray(contents[k % len(contents)])
        if k < 4:  # cut off
            content = content[: int(rng.integers(1, len(content)))]
        else:
            for place in rng.integers(len(content), size=2 ** (k - 3)):
                content[place] = rng.integers(256)
        said = damage.verdict(kind, bytes(content), tmp_path)
        assert said in ("taken", "refused"), f"{kind}, {k}: {said}"


def test_a_bag_with_a_record_longer_than_the_file_is_refused(tmp_path):
    pytest.importorskip("rosbags")
    path = logs.ros1(tmp_path)
    content = path.read_bytes()
    path.write_bytes(content[:-1])
    with pytest.raises(ValueError, match="record goes on beyond the end of the file; try rosbag"):
        dfc.read_record(path, joint="b")


def test_a_bounded_file_takes_no_room_for_more_than_it_holds(tmp_path):
    path = tmp_path / "file"
    path.write_bytes(b"0123456789")
    with BoundedFile(path) as file:
        assert file.read(3) == b"012"
        assert file.read(10**15) == b"3456789"
        assert file.read() == b""


def test_a_flight_log_cut_off_in_its_definitions_is_refused(tmp_path):
    pytest.importorskip("pyulog")
    path = logs.ulog(tmp_path)
    content = path.read_bytes()
    first = content.index(b"F", 16)  # a message: its length, its type
    path.write_bytes(content[: first + 10])
    with pytest.raises(ValueError, match=f"damaged definitions at byte {first - 2}"):
        dfc.read_record(path)


def test_an_object_of_a_blf_that_is_shorter_than_its_head_is_refused():
    head = b"LOBJ" + (16).to_bytes(2, "little") + (1).to_bytes(2, "little")
    with pytest.raises(ValueError, match="an object of 8 bytes is shorter than its own head"):
        _object_size(head + (8).to_bytes(4, "little") + bytes(4), 0)
    assert _object_size(head + (40).to_bytes(4, "little") + bytes(4), 0) == 40
