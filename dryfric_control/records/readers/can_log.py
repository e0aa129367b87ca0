"""Logs of a CAN bus, with a DBC or an EDS that says what its frames hold."""

from __future__ import annotations

import io
import re
import zlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from dryfric_control.records.readers.channels import Wanted
from dryfric_control.records.readers.limits import refused_if_damaged
from dryfric_control.records.readers.log_file import MessageLog, import_optional
from dryfric_control.records.refusal import RefusalError
from dryfric_control.store.files import existing_file

# Objects of CiA 402 by index, with the unit that the profile gives them.
_CIA402 = {
    0x6064: "Position actual value [counts]",
    0x606C: "Velocity actual value",
    0x6071: "Target torque [0.1 %]",
    0x6074: "Torque demand value [0.1 %]",
    0x6077: "Torque actual value [0.1 %]",
    0x6078: "Current actual value [0.1 %]",
    0x607A: "Target position [counts]",
    0x6062: "Position demand value [counts]",
}
# First objects of communication and mapping: of what a node sends, and of what it is sent.
_PDOS = ((0x1800, 0x1A00), (0x1400, 0x1600))
_NODES = 0x7F
_VALID = 1 << 31  # bit of an identifier of a PDO that is switched off
# Lengths of the heads of an object of a BLF and of a container [byte]; type and packing of one.
_OBJECT_HEAD = 16
_CONTAINER_HEAD = 16
_CONTAINER = 10
_DEFLATED = 2
_ASC_TIME = re.compile(r"\s*(\d+\.\d+)(\s.*)", re.DOTALL)


class CanLog(MessageLog):
    """Signals of a CAN log by a DBC, or objects of CiA 402 by the EDS of the drive."""

    kind = "log of a CAN bus"
    extra = "can"
    modules = ("can",)

    def __init__(self, path: Path, wanted: Wanted) -> None:
        if wanted.database is None:
            raise RefusalError(
                f"{path.name}: a CAN log needs what its frames hold: database= with a DBC, or "
                "the EDS or DCF of the drive",
                database=...,
            )
        self._decoders = [_read_database(one, path) for one in _paths(wanted.database)]
        super().__init__(path, wanted)

    def _messages(self, *libraries: Any) -> Iterator[tuple[str, int, Any]]:
        if self.path.suffix.lower() == ".blf":
            _check_objects(self.path)
        # Whole files may have several nodes or buses; frames without a meaning are passed over.
        with _reader(libraries[0], self.path) as frames:
            for frame in frames:
                if frame.is_error_frame or frame.is_remote_frame:
                    continue
                for decoder in self._decoders:
                    found = decoder.signals(frame.arbitration_id, bytes(frame.data))
                    for topic, values in found:
                        yield topic, round(1e9 * frame.timestamp), values


def _check_objects(path: Path) -> None:
    """Refuse a BLF with an object shorter than its own head: the library would not get past it."""
    content = path.read_bytes()
    packed = b""
    at = int.from_bytes(content[4:8], "little")
    while content[at : at + 4] == b"LOBJ":
        size = _object_size(content, at)
        if int.from_bytes(content[at + 12 : at + 16], "little") == _CONTAINER:
            inside = content[at + _OBJECT_HEAD + _CONTAINER_HEAD : at + size]
            method = int.from_bytes(content[at + _OBJECT_HEAD :][:2], "little")
            packed += zlib.decompressobj().decompress(inside) if method == _DEFLATED else inside
        at += size + size % 4
    at = packed.find(b"LOBJ", 0, 8)
    while at >= 0:
        at = packed.find(b"LOBJ", at + _object_size(packed, at), at + _object_size(packed, at) + 8)


def _object_size(content: bytes, at: int) -> int:
    """Length of an object of a BLF, its head included."""
    head = content[at : at + _OBJECT_HEAD]
    size = int.from_bytes(head[8:12], "little")
    if len(head) == _OBJECT_HEAD and size < _OBJECT_HEAD:
        raise ValueError(f"an object of {size} bytes is shorter than its own head")
    return max(size, _OBJECT_HEAD)


def _paths(database: Any) -> Sequence[Path]:
    """Files of the argument `database`."""
    several = database if isinstance(database, (list, tuple)) else [database]
    return [existing_file(one) for one in several]


def _reader(can: Any, path: Path) -> Any:
    """Frames of a log of any of the formats that python-can reads."""
    if path.suffix.lower() == ".asc":
        return can.ASCReader(_with_absolute_stamps(path))
    if path.suffix.lower() == ".log":
        return can.CanutilsLogReader(str(path))
    return can.LogReader(str(path))


def _with_absolute_stamps(path: Path) -> io.StringIO:
    """An ASC log whose stamps count from its start.

    Under ``timestamps relative`` each counts from the line before, be it a frame or not, which
    python-can (4.6.1) parses and ignores.
    """
    lines = path.read_text(encoding="latin-1").splitlines(keepends=True)
    head = [line.lower() for line in lines[:20]]
    if not any("timestamps relative" in line for line in head):
        return io.StringIO("".join(lines))
    total = 0.0
    out = []
    for line in lines:
        if found := _ASC_TIME.fullmatch(line):
            total += float(found[1])
            line = f"{total:.6f}{found[2]}"
        out.append(re.sub("timestamps relative", "timestamps absolute", line, flags=re.IGNORECASE))
    return io.StringIO("".join(out))


class _Dbc:
    """Signals by a database of messages; their units are on the signals, not in what is decoded."""

    def __init__(self, cantools: Any, path: Path) -> None:
        with refused_if_damaged(path, "DBC"):
            base = cantools.database.load_file(str(path))
            self._messages = {one.frame_id: one for one in base.messages}
            self._headings = {
                (one.frame_id, signal.name): f"{signal.name} [{signal.unit}]" * bool(signal.unit)
                or signal.name
                for one in base.messages
                for signal in one.signals
            }

    def signals(self, identifier: int, data: bytes) -> Iterator[tuple[str, dict[str, Any]]]:
        """Name and values of the message that a frame is, if it is known and whole."""
        message = self._messages.get(identifier)
        if message is None or len(data) < message.length:
            return
        values = message.decode(data, decode_choices=False)
        yield message.name, {self._headings[identifier, key]: one for key, one in values.items()}


class _Field(NamedTuple):
    """Where an object is in a frame."""

    heading: str
    first: int  # bit
    bits: int
    signed: bool


class _Eds:
    """Objects of CiA 402 in the process data that an EDS or DCF maps."""

    def __init__(self, canopen: Any, path: Path) -> None:
        self._import, self._path = canopen.import_od, path
        self._signed = canopen.objectdictionary.datatypes.SIGNED_TYPES
        self._frames: dict[int, tuple[str, list[_Field]]] = {}
        self._nodes: set[int] = set()
        with refused_if_damaged(path, "EDS"):
            self._add(1)
            self._nodes.clear()
            self._frames.clear()

    def signals(self, identifier: int, data: bytes) -> Iterator[tuple[str, dict[str, Any]]]:
        """Node and values of the objects in a frame."""
        node = identifier & _NODES
        if node and node not in self._nodes and 0x180 < identifier < 0x580:
            self._add(node)
        topic, fields = self._frames.get(identifier, ("", []))
        whole = int.from_bytes(data, "little")
        values = {
            one.heading: _number(whole >> one.first, one)
            for one in fields
            if one.first + one.bits <= 8 * len(data)
        }
        if values:
            yield topic, values

    def _add(self, node: int) -> None:
        """Frames of a node, by the mapping in the EDS."""
        self._nodes.add(node)
        objects = self._import(str(self._path), node)
        for communication, mapping in _PDOS:
            for k in range(4):
                if communication + k not in objects or mapping + k not in objects:
                    continue
                identifier = _value(objects[communication + k][1])
                fields = list(_fields(objects, objects[mapping + k], self._signed))
                if fields and identifier and not identifier & _VALID:
                    self._frames[identifier & 0x7FF] = f"node_{node}", fields


def _fields(objects: Any, mapping: Any, signed: Any) -> Iterator[_Field]:
    """Objects of a mapping that are numbers of CiA 402."""
    first = 0
    for k in range(1, min(64, _value(mapping[0])) + 1):
        entry = _value(mapping[k])
        index = entry >> 16
        bits = entry & 0xFF
        if index in _CIA402 and index in objects:
            kind = getattr(objects[index], "data_type", None)
            yield _Field(_CIA402[index], first, bits, kind in signed)
        first += bits


def _value(entry: Any) -> int:
    """What the file says of an object: the value set, or the default."""
    value = getattr(entry, "value", None)
    return int(entry.default or 0) if value is None else int(value)


def _number(shifted: int, field: _Field) -> int:
    """A whole number of some bits."""
    number = shifted & ((1 << field.bits) - 1)
    return number - (1 << field.bits) if field.signed and number >> (field.bits - 1) else number


def _read_database(path: Path, log: Path) -> _Dbc | _Eds:
    """What a file says of the frames."""
    if path.suffix.lower() in (".eds", ".dcf"):
        return _Eds(import_optional("canopen", "can", log), path)
    return _Dbc(import_optional("cantools", "can", log), path)
