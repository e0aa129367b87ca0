"""Numeric variables of MAT-files, versions 4 to 7, and where those of 7.3 are read.

The file layout is MathWorks' "MAT-File Format". Level 5 has a reader of its own here, because the
one in scipy (1.17) ends the interpreter where a damaged file gives an element another type.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from dryfric_control.records.readers.channels import Wanted
from dryfric_control.records.readers.limits import refused_if_damaged
from dryfric_control.records.readers.mat73_file import read_mat73

_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8",
          13: "u8"}  # fmt: skip
# Types of a data element (MAT-file format, table of data types).
_MATRIX = 14
_COMPRESSED = 15
# Classes of an array (the same, table of array types).
_STRUCT = 2
_NUMERIC = range(6, 16)
# Size up to which compressed variables may unpack together [byte].
_ROOM = 2**26
# Largest unpacked size over that of the file: measured data shrink less.
_RATIO = 100
# Deepest nesting of structs.
_DEPTH = 8


def read_mat(path: Path, wanted: Wanted) -> dict[str, Any]:
    """Numeric variables of a MAT-file of version 4 to 7.3, structs flattened."""
    with path.open("rb") as file:
        if file.read(16).startswith((b"\x89HDF", b"MATLAB 7.3")):
            return read_mat73(path, wanted)
    content = path.read_bytes()
    table: dict[str, Any] = {}
    with refused_if_damaged(path, "MAT-file of version 4 to 7"):
        # Version 4 begins with a small number in one byte order or the other, later ones with text.
        if 0 in content[:4] and content[126:128] not in (b"IM", b"MI"):
            from scipy.io import loadmat  # not at an import of the package, which it slows down

            found = loadmat(path, appendmat=False)
        else:
            found = _variables(content)
        _flatten("", found, table)
    if not table:
        raise ValueError(f"{path.name} holds no numeric variable")
    return table


def _flatten(prefix: str, content: Mapping[str, Any], table: dict[str, Any]) -> None:
    """Vectors and scalars as 1-D arrays; matrices as ``name.j``."""
    for key, value in content.items():
        if isinstance(value, dict):
            _flatten(f"{prefix}{key}.", value, table)
        elif not isinstance(value, np.ndarray) or value.dtype.kind not in "iufc":
            continue  # text, or a sparse matrix
        elif value.ndim == 2 and 1 < value.shape[1] <= 64 and value.shape[0] > 1:
            table.update({f"{prefix}{key}.{j}": value[:, j] for j in range(value.shape[1])})
        elif value.size:
            table[f"{prefix}{key}"] = value.ravel() if max(value.shape) == value.size else value


def _variables(data: bytes) -> dict[str, Any]:
    """Numeric variables of a file of level 5 by name; structs as dicts."""
    if data[126:128] not in (b"IM", b"MI"):
        raise ValueError("its header is not one")
    order = "<" if data[126:128] == b"IM" else ">"
    room = max(_ROOM, _RATIO * len(data))
    found: dict[str, Any] = {}
    for kind, payload in _elements(memoryview(data)[128:], order):
        if kind == _COMPRESSED:
            payload = _decompress(payload, order, room)
            room -= len(payload)
            kind, payload = next(_elements(payload, order), (0, payload))
        if kind == _MATRIX:
            name, value = _matrix(payload, order, 0)
            if name and value is not None:
                found[name] = value
    return found


def _decompress(payload: memoryview, order: str, room: int) -> memoryview:
    """A compressed variable, refused by the size it claims before it is unpacked."""
    unpack = zlib.decompressobj()
    head = unpack.decompress(payload, 8)
    claimed = struct.unpack(order + "II", head)[1] + 8 if len(head) == 8 else 0
    if claimed > room:
        raise ValueError(
            f"a compressed variable claims {claimed} bytes, far more than such a file holds; "
            "save it without compression if it is sound"
        )
    content = head + unpack.decompress(unpack.unconsumed_tail, max(claimed, 8))
    if len(content) < claimed:
        raise ValueError("a compressed variable is cut off")
    return memoryview(content)


def _elements(data: memoryview, order: str) -> Iterator[tuple[int, memoryview]]:
    """Type and content of the elements that follow each other."""
    at = 0
    while at < len(data):
        head, size = struct.unpack_from(order + "II", data, at)
        start = at + 8
        step = 8 + (size if head == _COMPRESSED else -(-size // 8) * 8)
        if head >> 16:  # small element: size and content within the tag
            head, size, start, step = head & 0xFFFF, head >> 16, at + 4, 8
        if start + size > min(at + step, len(data)):
            raise ValueError("it ends within an element")
        yield head, data[start : start + size]
        at += step


def _matrix(payload: memoryview, order: str, depth: int) -> tuple[str, Any]:
    """Name and value of a matrix; None for what is neither numbers nor struct."""
    parts = _elements(payload, order)

    def numbers() -> npt.NDArray[Any]:
        kind, content = next(parts, (0, payload[:0]))
        if kind not in _TYPES:
            raise ValueError(f"an element of type {kind} where numbers belong")
        return np.frombuffer(content, order + _TYPES[kind])

    flags = numbers()
    if flags.size != 2:
        raise ValueError("a variable without flags")
    kind, is_complex = int(flags[0]) & 0xFF, bool(int(flags[0]) & 0x800)
    if kind != _STRUCT and kind not in _NUMERIC:
        return "", None
    shape = tuple(int(n) for n in numbers())
    name = numbers().tobytes().decode("latin-1")
    if not 2 <= len(shape) <= 8 or min(shape) < 0:
        raise ValueError(f"variable {name[:40]!r} has shape {shape[:8]}")
    if kind == _STRUCT:
        if math.prod(shape) != 1 or depth == _DEPTH:
            return name, None
        width = int(numbers()[:1].sum())
        return name, _struct_fields(parts, numbers().tobytes(), width, order, depth)
    value = numbers()
    if is_complex:  # which no channel is
        value = value.astype(np.complex128)
    if value.size != math.prod(shape):
        raise ValueError(f"variable {name[:40]!r} has {value.size} numbers for shape {shape}")
    return name, value.reshape(shape, order="F")


def _struct_fields(
    parts: Iterator[tuple[int, memoryview]], text: bytes, width: int, order: str, depth: int
) -> dict[str, Any] | None:
    """Values of the fields of a struct, whose names are `width` bytes of `text` each."""
    if not 0 < width <= len(text):
        return None
    keys = [text[k : k + width] for k in range(0, len(text), width)]
    fields = {
        key.split(b"\0")[0].decode("latin-1"): _matrix(content, order, depth + 1)[1]
        for key, (inner, content) in zip(keys, parts, strict=False)
        if inner == _MATRIX
    }
    return {key: value for key, value in fields.items() if value is not None}
