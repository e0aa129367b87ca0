"""Files that are damaged in every way, and what a reader may do with them.

A reader may take a damaged file, if what it returns is sound, or refuse it
with a ValueError that says something.  Anything else is a find.
"""

import contextlib
import functools
import gzip
import importlib.util
import io
import json
import math
import re
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.parsers import expat

import log_files
import numpy as np
from hypothesis import strategies as st
from scipy.io import savemat

import dryfric_control as dfc
from dryfric_control.compiled.axis_step import HIGH, LOW, SHORT_TIME, SHORT_WAY
from dryfric_control.store.axis_file import read_axes

# A file of a few kilobytes is read in milliseconds.  A call that takes longer than this
# hangs for the user, on a machine with other work too.
SLOWEST = 20.0
# Endless where an axis has no limits of travel, and no effect that varies fast.
FREE = (LOW, HIGH, SHORT_WAY, SHORT_TIME)

N = 60
T = 1e-3 * np.arange(N)
U = np.round(8.0 * np.cos(30.0 * T) + 3.0 * np.cos(110.0 * T), 6)
X = 1e-6 * np.round(2e4 * np.sin(25.0 * T))
REFERENCE = np.round(0.02 * np.sin(25.0 * T + 0.05), 6)


# ------------------------------------------------------------- sound files


def _csv(rows: np.ndarray, heading: str, mark: str = ",") -> bytes:
    lines = [mark.join(f"{value:.9g}" for value in row) for row in rows]
    return "\n".join([heading, *lines, ""]).encode()


def _written(folder: Path, name: str, write: Callable[[Path], object]) -> bytes:
    path = folder / name
    write(path)
    return path.read_bytes()


def bam_log() -> bytes:
    """Log of a servo: its drive forwards, backwards, and off; stamps of 3.5 to 5.3 ms."""
    stamps = np.cumsum(np.random.default_rng(2).uniform(0.0035, 0.0053, 60)).tolist()
    entries = [
        {"timestamp": s, "position": round(4096 * math.sin(9 * s)) / 4096, "speed": 0.0,
         "goal_position": math.sin(9 * s), "load": 100 + k if k < 30 else 65536 - k,
         "input_volts": 7.5, "temp": 28 + k // 30, "torque_enable": k < 50}
        for k, s in enumerate(stamps)
    ]  # fmt: skip
    head = {"mass": 0.49, "length": 0.1, "kp": 100, "vin": 7.4, "motor": "a", "trajectory": "b"}
    return json.dumps(head | {"entries": entries}).encode()


#: Models of simulators with a joint "elbow".
_MODELS = {
    "mjcf": [
        b"<?xml version='1.0'?>\n<mujoco>\n <!-- <joint name='elbow'/> -->\n <worldbody>\n  <body>\n"
        b"   <joint name='elbow' damping = \"1\" user='a > b'/>\n   <geom size='1'/>\n  </body>\n"
        b" </worldbody>\n</mujoco>\n"
    ],
    "urdf": [
        b"<robot name='a'>\n <joint name='elbow' type='revolute'>\n  <parent link='a'/>\n"
        b"  <dynamics friction='0.1'/>\n </joint>\n</robot>\n",
        b"<robot>\n <joint name='elbow' type='continuous'>\n  <parent link='a'/>\n </joint></robot>",
    ],
    "modelica": [
        b'model Arm "a (model"\n  // BearingFriction elbow;\n  BearingFriction elbow(\n'
        b"    tau_pos=[0, 1; 2, 3], useSupport=true) annotation (Placement());\nend Arm;\n",
        b"model Arm\n  Modelica.Rotational.BearingFriction elbow;\nend Arm;\n",
    ],
}
_ELBOW = dfc.FrictionAxis(mass=0.3, viscous=0.2, coulomb=1.5, units=("rad", "N m"))
_AXIS = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)


def _mcap() -> list[bytes]:
    """A log of robots in plain chunks; none without the library."""
    if importlib.util.find_spec("mcap") is None:
        return []
    from mcap.writer import CompressionType, Writer

    file = io.BytesIO()
    writer = Writer(file, compression=CompressionType.NONE)
    writer.start()
    channel = writer.register_channel(topic="/axis", message_encoding="json", schema_id=0)
    for k in range(N):
        data = json.dumps({"position": X[k], "effort": U[k], "mode": "on"}).encode()
        writer.add_message(channel, log_time=10**6 * k, publish_time=10**6 * k, data=data)
    writer.finish()
    return [file.getvalue()]


def joint_states(joints: dict[str, tuple[np.ndarray, np.ndarray]], stamps: np.ndarray) -> bytes:
    """A log of ROS 2: positions and efforts of joints at stamps [ns] since the first."""
    from mcap_ros2.writer import Writer

    file = io.BytesIO()
    writer = Writer(file)
    text = "string[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort"
    schema = writer.register_msgdef("sensor_msgs/msg/JointState", text)
    for k, stamp in enumerate(10**18 + stamps.astype(int)):
        x, u = zip(*((float(x[k]), float(u[k])) for x, u in joints.values()), strict=True)
        message = {"name": [*joints], "position": [*x], "velocity": [], "effort": [*u]}
        writer.write_message(
            "/joint_states", schema, message, log_time=int(stamp), publish_time=int(stamp)
        )
    writer.finish()
    return file.getvalue()


def _tables(folder: Path) -> dict[str, list[bytes]]:
    """Spreadsheet and Parquet file; none without the libraries."""
    found: dict[str, list[bytes]] = {"xlsx": [], "parquet": []}
    if importlib.util.find_spec("pandas") is None:
        return found
    import pandas

    frame = pandas.DataFrame({"t": T, "u": U, "x [mm]": 1e3 * X, "flag": 1})
    for kind, library, write in (
        ("xlsx", "openpyxl", frame.to_excel), ("parquet", "pyarrow", frame.to_parquet),
    ):  # fmt: skip
        if importlib.util.find_spec(library) is not None:
            found[kind] = [_written(folder, f"a.{kind}", lambda p, w=write: w(p, index=False))]
    return found


def sound_files(folder: Path) -> dict[str, list[bytes]]:
    """Files that can be read, by the name of their reader."""
    rows = np.column_stack([T, U, X, REFERENCE])
    record = dfc.Record(T, U, X, REFERENCE, units={"x": "m", "u": "N"}, name="run", quantum=1e-6)
    named = {"t": T, "u": U, "x": X}
    emps = {"t": T, "qm": X, "qg": REFERENCE, "vir": U, "gtau": 35.0}
    axis = _AXIS.replace(
        coulomb=dfc.CoulombMap(plus=[8.0, 3.0], minus=[7.0]), stribeck=dfc.Stribeck(0.3, 0.01),
        effects=(dfc.effects.Spring(stiffness=40.0), dfc.effects.InputDelay(delay=2e-3)),
        travel=(0.0, 0.3), name="z axis",
    )  # fmt: skip
    plain = _AXIS.replace(effects=(dfc.effects.BiasForce(1.0),))
    design = dfc.design_pi_observer(plain, dt=1e-3, encoder_quantum=1e-6)
    numbers = b"mass = 0.3\nviscous = 0.2\ncoulomb = [1.5, 1.4]\nunits = ['rad', 'N m']\n"
    files = {
        "csv": [
            _csv(rows, "time [ms],force [N],pos [mm],ref [mm]"),
            _csv(rows, "t;u;x;reference", ";").replace(b".", b",").replace(b",,", b",0"),
            b"# a comment\n" + _csv(rows[:, :3], "t\tu\tx", "\t"),
            _written(folder, "own.csv", record.to_csv),
            b"sep=;\nMeasured on a Monday\nt;u;x;v\ns;N;mm;m/s\n" + _csv(rows, "", ";").lstrip(),
            b"% t u x\n" + _csv(rows[:, :3], "", " ").lstrip().replace(b"\n", b" \n"),
            "\n".join(["t,u,x [counts]", *(f"{T[k]},{U[k]},{2**62 + k**2 % 97}"
                                           for k in range(N))]).encode(),
        ],
        "log": [
            _csv(rows[:, :3], "2026-03-02T10:00:00Z,u,x").replace(b"\n0.0", b"\n12:00:00.0"),
            _csv(rows[:, :3], "t\tu\tx", "\t").decode().replace("-", "\N{MINUS SIGN}").encode("utf-16"),
            b"Name\tScope\n\nName\tActTorque\tName\tActPos\nSampleTime[ms]\t1\tSampleTime[ms]\t1\n"
            + _csv(np.c_[1e3 * T, U, 1e3 * T, X], "", "\t").lstrip(),
            _csv(rows[:, :3], "time,q3_tau_J,q3").replace(b"\n", b"D+00\n").replace(b"q3D+00", b"q3"),
            _csv(np.where(np.arange(N)[:, None] == 30, np.nan, rows[:, :3]), "t,u,x"),
        ],
        "arrays": [_written(folder, "a.npz", lambda p: np.savez(p, **named))],
        "array": [_written(folder, "a.npy", lambda p: np.save(p, rows[:, :3]))],
        "lines": [
            b"\n".join(json.dumps({"t": T[k], "name": ["a", "b"], "position": [0.0, X[k]],
                                   "effort": [0.1, U[k]]}).encode() for k in range(N))
        ],
        "record": [_written(folder, "record.json", record.save)],
        "gz": [gzip.compress(_csv(rows, "t,u,x,r"), mtime=0)],
        "column": [b"pos [mm]\n" + b"\n".join(b"%.6f" % v for v in X), _csv(rows[:, :2], "% t u", " ")],
        "mcap": _mcap(),
        **_tables(folder),
        "fit": [_written(folder, "fit.json", lambda p: _fit().save(p))],
        "mat": [
            _written(folder, "d.mat", lambda p: savemat(p, named, format="4")),
            _written(folder, "a.mat", lambda p: savemat(p, named)),
            _written(folder, "b.mat",
                     lambda p: savemat(p, named | {"s": {"a": [1, 2]}}, do_compression=True)),
            _written(folder, "c.mat", lambda p: savemat(p, emps)),
        ],
        "axis": [
            _written(folder, "a.toml", lambda p: dfc.write_axis(axis, p)),
            _written(folder, "b.toml", lambda p: dfc.write_axis(plain, p)),
        ],
        "axes": [b"".join(b"[%s]\n%s" % (name, numbers) for name in (b"elbow", b"wrist"))],
        **_MODELS,
        **log_contents(folder),
        "design": [_written(folder, "observer.json", lambda p: design.save(str(p)))],
        "bam": [bam_log()],
    }  # fmt: skip
    return {kind: contents for kind, contents in files.items() if contents}


def log_contents(folder: Path) -> dict[str, list[bytes]]:
    """Logs of the formats of the field; none of those without the library."""
    makers: dict[str, list[Callable[[Path], Path]]] = {
        "mdf": [log_files.mdf],
        "tdms": [log_files.tdms, log_files.tdms_with_times],
        "mat73": [log_files.mat73, log_files.mat73_of_dspace],
        "ros1": [log_files.ros1],
        "ros2": [lambda f: next(log_files.ros2(f).glob("*.db3"))],
        "blf": [log_files.can_log],
        "asc": [lambda f: log_files.can_log(f, "run.asc"), log_files.asc_with_relative_stamps],
        "trc": [lambda f: log_files.can_log(f, "run.trc")],
        "candump": [lambda f: log_files.can_log(f, "run.log")],
        "ulog": [log_files.ulog],
    }
    found: dict[str, list[bytes]] = {}
    for kind, several in makers.items():
        inner = folder / f"sound_{kind}"
        inner.mkdir(exist_ok=True)
        with contextlib.suppress(ImportError):
            found[kind] = [make(inner).read_bytes() for make in several]
    return found


# ----------------------------------------------------------------- damage

_WORDS = re.compile(rb"[A-Za-z_]+|[-+0-9.eE]+|[^\sA-Za-z0-9]")
_TOKENS = [
    *(b"nan", b"inf", b"-inf", b"NaN", b"Infinity", b"1e999", b"-1e308", b"1e-320", b"-0.0"),
    *(b"", b"0", b"-1", b"1.5", b"9" * 30, b"9" * 5000, b"1" * 400 + b".0", b"0x1f", b"1_000"),
    *(b"null", b"true", b"false", b"{}", b"[]", b"[[]]", b'""', b'"x"', b"{", b"}", b"[" * 2000),
    *(b"\xff\xfe", b"\x00", b"\xef\xbb\xbf", b"\r", b"\n", b"#", b'"', b"'", b",", b";", b"="),
    *(b"mass", b"effects", b"entries", b"stribeck", b"backlash", b"version", b"__class__"),
    *("µ".encode(), "\u202e".encode(), "\ud800".encode("utf-8", "surrogatepass")),
    *(b"2026-11-21T10:00:00Z", b"12:00:00", b"1 2 3", b"1,2", b"%s", b"../..", b"\x1b[31m"),
]

_PLACE = st.integers(0, 2**20)
_WHAT = {
    **dict.fromkeys(("word", "token"), st.sampled_from(_TOKENS)),
    **dict.fromkeys(("write", "insert"), st.binary(min_size=1, max_size=8)),
    **dict.fromkeys(("remove", "repeat"), st.integers(1, 200)),
    **dict.fromkeys(("swap", "line"), _PLACE), "flip": st.integers(0, 7), "cut": st.just(0),
}  # fmt: skip
_CHANGES = st.one_of(st.tuples(st.just(kind), _PLACE, what) for kind, what in _WHAT.items())
#: One to four changes of a file.
damages = st.lists(_CHANGES, min_size=1, max_size=4)


@functools.lru_cache(maxsize=64)
def _words(content: bytes) -> list[tuple[int, int]]:
    """Where each word begins and ends."""
    return [word.span() for word in _WORDS.finditer(content)]


def damaged(content: bytes, changes: list[tuple[str, int, Any]]) -> bytes:
    """A file after some changes."""
    for kind, number, what in changes:
        place = number % (len(content) + 1)
        end = place
        put = b""
        if kind in ("word", "swap"):
            words = _words(content)
            if not words:
                continue
            word = words[number % len(words)]
            place, end = word
            put = what if kind == "word" else content[slice(*words[what % len(words)])]
        elif kind == "write":
            end, put = place + len(what), what
        elif kind in ("insert", "token"):
            put = what
        elif kind == "flip":
            end = place + 1
            put = bytes(byte ^ (1 << what) for byte in content[place:end])
        elif kind == "remove":
            end = place + what
        elif kind == "repeat":
            put = content[place : place + what]
        elif kind == "line":
            lines = content.split(b"\n")
            a, b = number % len(lines), what % len(lines)
            lines[a], lines[b] = lines[b], lines[a]
            content = b"\n".join(lines)
            continue
        else:
            end = len(content)
        content = content[:place] + put + content[end:]
    return content


# ---------------------------------------------------------------- verdict


@dataclass(frozen=True)
class Reader:
    """How a kind of file is read, and what makes the result sound."""

    suffix: str
    read: Callable[[Path], Any]
    sound: Callable[[Any], bool]


def _fit() -> dfc.Fit:
    t = 1e-3 * np.arange(600)
    u = 20.0 * np.sin(30.0 * t)
    record = dfc.Record(t, u, _AXIS.simulate(u, dt=1e-3).y[0], name="run")
    return dfc.fit(_AXIS, record, free=("mass",), window=0.1)


def _bridged(path: Path) -> dfc.Record:
    return dfc.read_record(
        path, dt=1e-3, max_gap=1.0, joint="b" if path.suffix == ".jsonl" else None
    )


def _log(path: Path) -> dfc.Record:
    """A log of the field, of a bus by its database, of a robot by a joint."""
    how: dict[str, Any] = {}
    if path.suffix in (".blf", ".asc", ".trc", ".log"):
        how = {"database": log_files.database(path.parent)}
    elif path.suffix in (".bag", ".db3"):
        how = {"joint": "b"}
    return dfc.read_record(path, dt=1e-3, **how)


LOGS = {"mdf": ".mf4", "tdms": ".tdms", "ros1": ".bag", "ros2": ".db3", "blf": ".blf",
        "asc": ".asc", "trc": ".trc", "candump": ".log", "ulog": ".ulg"}  # fmt: skip


def _record_sound(record: dfc.Record) -> bool:
    channels = [record.t, record.u, record.x]
    channels += [] if record.reference is None else [record.reference]
    finite = all(np.isfinite(c).all() and c.shape == record.t.shape for c in channels)
    steady = 0.0 < record.dt < math.inf and bool(np.all(np.diff(record.t) > 0.0))
    return finite and steady and len(record.summary()) > 0


def _log_sound(log: dict[str, Any]) -> bool:
    return _record_sound(log["record"]) and all(
        log[key].shape == log["record"].t.shape for key in ("volts", "temperature")
    )


def _axis_sound(axis: dfc.FrictionAxis) -> bool:
    numbers = axis.arrays(1e-3).numbers
    finite = bool(np.isfinite(np.delete(numbers, FREE)).all())
    return axis.mass > 0.0 and finite and len(axis.describe()) > 0


def _design_sound(design: dfc.ObserverDesign) -> bool:
    # The certificate has just been recomputed: it must hold and enclose its gain.
    finite = bool(np.isfinite(design.node_gains).all())
    return design.lower_bound <= design.gamma * (1 + 1e-9) and finite and len(design.summary()) > 0


def _edited(path: Path) -> tuple[bytes, bytes, str]:
    """A model before and after, and the text that must be in it now."""
    before = path.read_bytes()
    if path.suffix == ".mo":
        dfc.simulators.to_modelica({"elbow": _ELBOW}, path, velocities=[-1.0, 1.0])
        return before, path.read_bytes(), "tau_pos=[0, 1.5; 1, 1.7]"
    if path.suffix == ".urdf":
        dfc.simulators.to_urdf({"elbow": _ELBOW}, path)
        return before, path.read_bytes(), "friction=1.5 damping=0.2"
    dfc.to_mjcf({"elbow": _ELBOW}, path, load=0.1)
    return before, path.read_bytes(), "frictionloss=1.5 damping=0.2 armature=0.2"


def _attributes(xml: bytes) -> list[dict[str, str]]:
    """Those of every element; names with colons are names, as simulators read them."""
    found: list[dict[str, str]] = []
    parser = expat.ParserCreate()
    parser.StartElementHandler = lambda name, attributes: found.append(attributes)
    parser.Parse(xml, True)
    return found


def _edit_sound(edit: tuple[bytes, bytes, str]) -> bool:
    """The values are there, and the beginning and the end of the file as before."""
    before, after, words = edit
    if words.startswith("tau_pos"):
        return words.encode() in after and before[:4] == after[:4]
    elements = _attributes(after)
    wanted = dict(part.split("=") for part in words.split())
    there = any(wanted.items() <= attributes.items() for attributes in elements)
    same = (before[:8], before[-8:]) == (after[:8], after[-8:])
    return there and same and len(elements) - len(_attributes(before)) in (0, 1)


PLAIN = {"csv": ".csv", "mat": ".mat", "gz": ".csv.gz", "xlsx": ".xlsx", "parquet": ".parquet",
         "mcap": ".mcap", "arrays": ".npz", "array": ".npy"}  # fmt: skip
READERS = {
    **{kind: Reader(suffix, dfc.read_record, _record_sound) for kind, suffix in PLAIN.items()},
    "mat73": Reader(".mat", dfc.read_record, _record_sound),
    **{kind: Reader(suffix, _log, _record_sound) for kind, suffix in LOGS.items()},
    "column": Reader(".t", lambda p: dfc.read_record({"t": T, "u": U, "x": p}), _record_sound),
    "fit": Reader(".json", dfc.Fit.load, lambda fit: len(fit.summary()) > 0),
    "log": Reader(".csv", _bridged, _record_sound),
    "lines": Reader(".jsonl", _bridged, _record_sound),
    "record": Reader(".json", dfc.load_record, _record_sound),
    "axis": Reader(".toml", dfc.read_axis, _axis_sound),
    "axes": Reader(".toml", read_axes, lambda axes: all(map(_axis_sound, axes.values()))),
    "mjcf": Reader(".xml", _edited, _edit_sound),
    "urdf": Reader(".urdf", _edited, _edit_sound),
    "modelica": Reader(".mo", _edited, _edit_sound),
    "design": Reader(".json", dfc.ObserverDesign.load, _design_sound),
    "bam": Reader(".json", dfc.read_bam, _log_sound),
}


def verdict(kind: str, content: bytes, folder: Path) -> str:
    """ "taken", "refused", or in words what the reader did wrong."""
    reader = READERS[kind]
    path = folder / f"file{reader.suffix}"
    path.write_bytes(content)
    begin = time.thread_time()  # of the reader alone, not of what else the process does
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", dfc.RecordWarning)
            warnings.simplefilter("error", RuntimeWarning)
            found = reader.read(path)
            answer = "taken" if reader.sound(found) else "took what is not sound"
    except ValueError as problem:
        # Its own words, with something of the user's in them, not those of a library in passing.
        answer = "refused" if len(str(problem)) > 15 else f"says only {str(problem)!r}"
    except Exception as problem:
        answer = f"raised {type(problem).__name__}: {str(problem)[:120]}"
    took = time.thread_time() - begin
    return f"took {took:.0f} s" if took > SLOWEST else answer
