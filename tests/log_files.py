"""Logs of one motion in the formats of the field, made by the libraries that the field keeps.

Each function takes a folder and returns the path of a file: position [mm] or counts at 1 kHz, drive
[N m] at 500 Hz, which begins 10 ms before the position, unless it says otherwise.  A module whose
library is not installed raises ImportError.
"""

import io
import json
from pathlib import Path

import numpy as np

N = 400
MS = 1_000_000  # ns
START = 1_770_000_000_000_000_000  # ns since 1970
T = 1e-3 * np.arange(N)
SLOW = np.arange(-10, N, 2)  # ms


def position(t):
    """Position [m]."""
    return 0.02 * np.sin(11.0 * np.asarray(t, float)) + 0.01 * np.sin(5.0 * np.asarray(t, float))


def drive(t):
    """Drive [N m]."""
    return 3.0 * np.cos(40.0 * np.asarray(t, float)) + 1.0


X = position(T)
U = drive(1e-3 * SLOW)
HELD = np.repeat(U[5:], 2)[:N]
COUNTS = np.round(1e6 * X).astype(np.int32)


def mdf(folder: Path, version: str = "4.10") -> Path:
    """Two groups of an MDF file; in version 3 the torque is a whole number with a factor."""
    from asammdf import MDF, Signal

    file = MDF(version=version)
    file.append([Signal(1e3 * X, T + 0.01, name="pos_act", unit="mm")])
    torque = Signal(U, 1e-3 * SLOW + 0.01, name="trq_act", unit="Nm")
    if version < "4":
        torque = Signal(
            np.round(100.0 * U).astype(np.int16), 1e-3 * SLOW + 0.01, name="trq_act", unit="Nm",
            conversion={"a": 0.01, "b": 0.0},
        )  # fmt: skip
    file.append([torque, Signal(0.1 * U, 1e-3 * SLOW + 0.01, name="temperature", unit="degC")])
    path = folder / ("run.mf4" if version >= "4" else "run.mdf")
    file.save(path, overwrite=True)
    file.close()
    return path


def _moment(ns: int) -> np.datetime64:
    return np.datetime64(START + ns, "ns").astype("M8[us]")


def tdms(folder: Path) -> Path:
    """Waveforms of two groups that began apart."""
    from nptdms import ChannelObject, TdmsWriter

    path = folder / "run.tdms"
    with TdmsWriter(str(path)) as file:
        channels = []
        for name, values, step, start, unit in (
            ("axis/position", 1e3 * X, 1e-3, 0, "mm"),
            ("drive/torque", U, 2e-3, -10 * MS, "N m"),
        ):
            timing = {"wf_increment": step, "wf_start_offset": 0.0, "wf_start_time": _moment(start)}
            group, channel = name.split("/")
            channels.append(
                ChannelObject(group, channel, values, properties={**timing, "unit_string": unit})
            )
        file.write_segment(channels)
    return path


def tdms_with_times(folder: Path) -> Path:
    """A group as DIAdem has it: a channel of time beside the others."""
    from nptdms import ChannelObject, TdmsWriter

    path = folder / "diadem.tdms"
    with TdmsWriter(str(path)) as file:
        for name, t, values in (("position", T, X), ("torque", 1e-3 * SLOW, U)):
            file.write_segment(
                [ChannelObject(name, "Time", t), ChannelObject(name, name, values)]
            )  # fmt: skip
    return path


def tdms_restarted(folder: Path) -> Path:
    """A run that was started again at half the rate, in one file."""
    from nptdms import ChannelObject, TdmsWriter

    path = folder / "again.tdms"
    with TdmsWriter(str(path)) as file:
        for start, step, part in ((0, 1e-3, slice(0, 200)), (1000, 2e-3, slice(200, N))):
            timing = {"wf_increment": step, "wf_start_offset": 0.0}
            timing["wf_start_time"] = _moment(start * MS)
            file.write_segment(
                [
                    ChannelObject("g", name, values[part], properties=timing)
                    for name, values in (("position", X), ("torque", HELD))
                ]
            )
    return path


def mat73(folder: Path) -> Path:
    """Variables of the workspace as MATLAB stores them: transposed, text as numbers."""
    import h5py

    path = folder / "run.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in (("t", T), ("u", HELD), ("x", X)):
            file[name] = values[None, :]
            file[name].attrs["MATLAB_class"] = np.bytes_("double")
        file["comment"] = np.frombuffer("a run".encode("utf-16-le"), np.uint16)[:, None]
        file["comment"].attrs["MATLAB_class"] = np.bytes_("char")
        struct = file.create_group("settings")
        struct["gains"] = np.array([[1.0, 2.0]])
    _with_head(path)
    return path


def mat73_of_dspace(folder: Path) -> Path:
    """An array of structs with the names and the data of the signals."""
    import h5py

    path = folder / "dspace.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        inner = file.create_group("#refs#")
        names, data = [], []
        signals = (("time", T), ("ActTorque", HELD), ("ActPos", X))
        for k, (name, values) in enumerate(signals):
            inner[f"n{k}"] = np.frombuffer(name.encode("utf-16-le"), np.uint16)[:, None]
            inner[f"d{k}"] = values[:, None]
            names.append(inner[f"n{k}"].ref)
            data.append(inner[f"d{k}"].ref)
        struct = file.create_group("Y")
        for key, references in (("Name", names), ("Data", data)):
            struct.create_dataset(key, (3, 1), dtype=h5py.ref_dtype)[:, 0] = references
    _with_head(path)
    return path


def _with_head(path: Path) -> None:
    head = b"MATLAB 7.3 MAT-file, Platform: GLNXA64, HDF5 schema 1.00 .".ljust(116) + bytes(8)
    with path.open("r+b") as file:
        file.write(head + b"\x00\x02IM")


def _joint_states(write, kind, header):
    """Messages of a position at 1 kHz that arrive late, as ROS has them, to a function."""
    late = np.random.default_rng(0).integers(5 * MS, size=N)
    for k in range(N):
        stamp = START + k * MS
        message = kind(
            header=header(stamp), name=["a", "b"], position=np.array([0.0, X[k]]),
            velocity=np.zeros(0), effort=np.array([0.0, HELD[k]]),
        )  # fmt: skip
        write(stamp + int(late[k]), message)


def ros1(folder: Path, header_stamps: bool = True) -> Path:
    """A bag of ROS 1: joint states out of order, or two topics of numbers without a header."""
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    kinds = store.types
    path = folder / "run.bag"
    stamp = kinds["builtin_interfaces/msg/Time"]
    head = kinds["std_msgs/msg/Header"]

    def header(ns):
        return head(seq=0, stamp=stamp(sec=ns // 10**9, nanosec=ns % 10**9), frame_id="")

    with Writer(path) as bag:
        if header_stamps:
            _joint_topic(bag, store, store.serialize_ros1, header)
        else:
            _two_topics(bag, store, store.serialize_ros1)
    return path


def _joint_topic(bag, store, serialized, header):
    """Joint states as one topic."""
    kind = "sensor_msgs/msg/JointState"
    topic = bag.add_connection("/joint_states", kind, typestore=store)
    _joint_states(
        lambda at, one: bag.write(topic, at, serialized(one, kind)), store.types[kind], header
    )


def _two_topics(bag, store, serialized):
    """Position and torque as topics of numbers, each on its own clock, in order of arrival."""
    kind = "std_msgs/msg/Float64"
    topics = [bag.add_connection(name, kind, typestore=store) for name in ("/position", "/torque")]
    rows = [(START + k * MS, topics[0], x) for k, x in enumerate(X)]
    rows += [(START + int(k) * MS, topics[1], u) for k, u in zip(SLOW, U, strict=True)]
    for at, topic, value in sorted(rows, key=lambda row: row[0]):
        bag.write(topic, at, serialized(store.types[kind](data=float(value)), kind))


def ros2(folder: Path, header_stamps: bool = True) -> Path:
    """A bag of ROS 2 (sqlite): joint states, or two topics of numbers without a header."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.LATEST)
    kinds = store.types
    path = folder / ("states" if header_stamps else "numbers")
    stamp, head = kinds["builtin_interfaces/msg/Time"], kinds["std_msgs/msg/Header"]

    def header(ns):
        return head(stamp=stamp(sec=ns // 10**9, nanosec=ns % 10**9), frame_id="")

    with Writer(path, version=9, storage_plugin=StoragePlugin.SQLITE3) as bag:
        if header_stamps:
            _joint_topic(bag, store, store.serialize_cdr, header)
            return path
        _two_topics(bag, store, store.serialize_cdr)
    return path


DBC = """VERSION ""

BU_: Drive

BO_ 100 Encoder: 8 Drive
 SG_ Position : 0|32@1- (0.001,0) [0|0] "mm" Vector__XXX
 SG_ Velocity : 32|16@1- (1,0) [0|0] "mm/s" Vector__XXX

BO_ 101 Motor: 4 Drive
 SG_ Torque : 0|16@1- (0.001,0) [0|0] "Nm" Vector__XXX
 SG_ Temperature : 16|16@1- (1,0) [0|0] "degC" Vector__XXX
"""


def database(folder: Path) -> Path:
    """DBC of `can_log`."""
    path = folder / "drive.dbc"
    path.write_text(DBC)
    return path


def _eds() -> str:
    """EDS of a drive of CiA 402 that sends position and torque in one PDO, and its status."""
    rows = {
        "6041": ("Statusword", "0x0006"), "6064": ("Position actual value", "0x0004"),
        "6077": ("Torque actual value", "0x0003"), "1000": ("Device type", "0x0007"),
    }  # fmt: skip
    text = "[FileInfo]\nFileName=drive.eds\n[DeviceInfo]\nVendorName=none\n"
    text += f"[MandatoryObjects]\nSupportedObjects={len(rows)}\n"
    text += "".join(f"{k}=0x{index}\n" for k, index in enumerate(rows, 1))
    for index, (name, kind) in rows.items():
        text += f"[{index}]\nParameterName={name}\nObjectType=0x7\nDataType={kind}\nAccessType=ro\n"
    parts = {
        "1800": ("TPDO", [("0x0005", "2"), ("0x0007", "$NODEID+0x180"), ("0x0005", "255")]),
        "1A00": ("Mapping", [("0x0005", "3"), ("0x0007", "0x60410010"), ("0x0007", "0x60640020"),
                             ("0x0007", "0x60770010")]),
    }  # fmt: skip
    text += "[OptionalObjects]\nSupportedObjects=2\n1=0x1800\n2=0x1A00\n"
    for index, (name, values) in parts.items():
        text += f"[{index}]\nParameterName={name}\nObjectType=0x9\nSubNumber={len(values)}\n"
        for k, (kind, value) in enumerate(values):
            text += (f"[{index}sub{k}]\nParameterName=value {k}\nObjectType=0x7\nDataType={kind}\n"
                     f"AccessType=rw\nDefaultValue={value}\n")  # fmt: skip
    return text


def eds(folder: Path) -> Path:
    """EDS of `canopen_log`."""
    path = folder / "drive.eds"
    path.write_text(_eds())
    return path


def _frames(folder: Path, name: str, frames) -> Path:
    import can

    path = folder / name
    with can.Logger(str(path)) as log:
        for stamp, identifier, data in sorted(frames, key=lambda frame: frame[0]):
            log.on_message_received(
                can.Message(
                    timestamp=stamp, arbitration_id=identifier, data=data, is_extended_id=False
                )
            )
    return path


def can_log(folder: Path, name: str = "run.blf") -> Path:
    """Frames of `database`, in any format of python-can."""
    frames = [(1e3 + t, 100, int(c).to_bytes(4, "little", signed=True) + bytes(4))
              for t, c in zip(T, COUNTS, strict=True)]  # fmt: skip
    frames += [(1e3 + 1e-3 * k, 101, round(1e3 * u).to_bytes(2, "little", signed=True) + bytes(2))
               for k, u in zip(SLOW, U, strict=True)]  # fmt: skip
    frames.append((1e3 + 0.0115, 0x7FF, b"\1\2"))  # nobody knows
    return _frames(folder, name, frames)


def canopen_log(folder: Path, nodes=(5,), name: str = "open.blf") -> Path:
    """Process data of drives of `eds`: 1 count is 1 um, 0.1 % is 1 mN m."""
    frames = [
        (t, 0x180 + node, b"\x37\x02" + int(c * (node == nodes[0])).to_bytes(4, "little", signed=True)
         + round(1e3 * u).to_bytes(2, "little", signed=True))
        for node in nodes for t, c, u in zip(1e3 + T, COUNTS, HELD, strict=True)
    ]  # fmt: skip
    return _frames(folder, name, frames)


def asc_with_relative_stamps(folder: Path) -> Path:
    """The log as ASC whose stamps count from the line before, of which some are no frames."""
    path = can_log(folder, "relative.asc")
    last, out = 0.0, []
    for line in path.read_text().replace("timestamps absolute", "timestamps relative").splitlines():
        words = line.split()
        if words and words[0].replace(".", "").isdigit() and "." in words[0]:
            stamp = float(words[0])
            if len(out) > 20 and stamp - last > 5e-4:  # lines that are no frames
                out.append(" 0.000300 1  Statistic: D 0 R 0 XD 0 XR 0 E 0 O 0 B 0.00%")
                last += 0.0003
            line = line.replace(words[0], f"{stamp - last:.6f}", 1)
            last = stamp
        out.append(line)
    path.write_text("\n".join(out) + "\n")
    return path


def ulog(folder: Path, instances: int = 1) -> Path:
    """A flight log: position of an actuator at 1 kHz, torque at 500 Hz, stamps in us."""
    import struct

    def message(kind: bytes, content: bytes) -> bytes:
        return struct.pack("<Hc", len(content), kind) + content

    data = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0)
    data += message(b"B", bytes(40))
    data += message(b"F", b"servo:uint64_t timestamp;float position;float[2] rate;")
    data += message(b"F", b"motor:uint64_t timestamp;float torque;")
    for k in range(instances):
        data += message(b"A", struct.pack("<BH", k, k) + b"servo")
    data += message(b"A", struct.pack("<BH", 0, 9) + b"motor")
    rows = []
    for k, x in enumerate(X):
        for i in range(instances):
            values = (x if i == 0 else 0.0, 0.0, 0.0)
            rows.append((1000 * k, struct.pack("<HQfff", i, 10**6 + 1000 * k, *values)))
    for k, u in zip(SLOW.tolist(), U, strict=True):
        rows.append((1000 * k, struct.pack("<HQf", 9, 10**6 + 1000 * k, u)))
    data += b"".join(message(b"D", row) for _, row in sorted(rows, key=lambda row: row[0]))
    path = folder / f"run{instances}.ulg"
    path.write_bytes(data)
    return path


def mcap(folder: Path) -> Path:
    """Two topics in JSON."""
    from mcap.writer import CompressionType, Writer

    file = io.BytesIO()
    writer = Writer(file, compression=CompressionType.NONE)
    writer.start()
    rows = [("/axis", START + k * MS, {"position": x}) for k, x in enumerate(X)]
    rows += [("/drive", START + int(k) * MS, {"torque": u}) for k, u in zip(SLOW, U, strict=True)]
    channels = {topic: writer.register_channel(topic, "json", 0) for topic in ("/axis", "/drive")}
    for topic, at, content in sorted(rows, key=lambda row: row[1]):
        data = json.dumps(content).encode()
        writer.add_message(channels[topic], log_time=at, publish_time=at, data=data)
    writer.finish()
    path = folder / "run.mcap"
    path.write_bytes(file.getvalue())
    return path
