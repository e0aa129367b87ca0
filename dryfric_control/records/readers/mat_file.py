"""Numeric variables of MAT-files, versions 4 to 7.

The file layout is MathWorks' "MAT-File Format", levels 4 and 5. A reader of our own, because the
one in scipy ends the interpreter on some damaged files.
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

_MAT_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8",
              13: "u8"}  # fmt: skip
_MAT_MATRIX, _MAT_COMPRESSED = 14, 15
_MAT_STRUCT, _MAT_NUMERIC = 2, range(6, 16)
# Bytes that compressed variables may hold together: a constant channel shrinks a thousand times, a
# file of measured data not a hundred.
_MAT_ROOM, _MAT_RATIO = 2**26, 100
_V4_TYPES = {0: "f8", 1: "f4", 2: "i4", 3: "i2", 4: "u2", 5: "u1"}
_MAT_DEPTH = 8


class DamagedMatError(Exception):
    """What is wrong with the bytes."""


def mat_variables(data: bytes) -> dict[str, Any]:
    """Numeric variables by name; structs as dicts."""
    if len(data) < 128 or data[126:128] not in (b"IM", b"MI"):
        raise DamagedMatError("its header is not one")
    order = "<" if data[126:128] == b"IM" else ">"
    room = max(_MAT_ROOM, _MAT_RATIO * len(data))
    found: dict[str, Any] = {}
    for kind, payload in _mat_elements(memoryview(data)[128:], order):
        if kind == _MAT_COMPRESSED:
            payload = _inflated(payload, order, room)
            room -= len(payload)
            kind, payload = next(_mat_elements(payload, order), (0, payload))
        if kind == _MAT_MATRIX:
            name, value = _mat_matrix(payload, order, 0)
            if name and value is not None:
                found[name] = value
    return found


def _inflated(payload: memoryview, order: str, room: int) -> memoryview:
    """A compressed variable, refused by the size it claims before it is unpacked."""
    unpack = zlib.decompressobj()
    try:
        head = unpack.decompress(payload, 8)
        claimed = struct.unpack(order + "II", head)[1] + 8 if len(head) == 8 else 0
        if claimed > room:
            raise DamagedMatError(
                f"a compressed variable claims {claimed} bytes, far more than such a file holds; "
                "save it without compression if it is sound"
            )
        content = head + unpack.decompress(unpack.unconsumed_tail, max(claimed, 8))
    except zlib.error as err:
        raise DamagedMatError(str(err)) from err
    if len(content) < claimed:
        raise DamagedMatError("a compressed variable is cut off")
    return memoryview(content)


def mat4_variables(data: bytes) -> dict[str, Any]:
    """Numeric variables of a file of version 4 by name."""
    found: dict[str, Any] = {}
    at = 0
    while at < len(data):
        if len(data) - at < 20:
            raise DamagedMatError("it ends within a heading")
        order = "<" if struct.unpack_from("<I", data, at)[0] < 10_000 else ">"
        kind, rows, columns, is_complex, length = struct.unpack_from(order + "IIIII", data, at)
        machine, rest = divmod(kind, 1000)
        layout, storage = divmod(rest, 10)
        number = np.dtype(order + _V4_TYPES.get(layout, "f8"))
        if machine != (order == ">") or layout not in _V4_TYPES or storage > 2:
            raise DamagedMatError("its header is not one")
        size = rows * columns * number.itemsize * (2 if is_complex else 1)
        start = at + 20 + length
        if is_complex > 1 or not 0 < length <= 1000 or start + size > len(data):
            raise DamagedMatError("it ends within a variable")
        name = data[at + 20 : start].split(b"\0")[0].decode("latin-1")
        values = np.frombuffer(data, number, size // number.itemsize, start)
        if is_complex:
            values = values[: rows * columns] + 1j * values[rows * columns :]
        if storage == 0:  # 1 is text, 2 a sparse matrix
            found[name] = values.reshape((rows, columns), order="F")
        at = start + size
    return found


def _mat_elements(data: memoryview, order: str) -> Iterator[tuple[int, memoryview]]:
    """Type and content of the elements that follow each other."""
    at = 0
    while at < len(data):
        if len(data) - at < 8:
            raise DamagedMatError("it ends within an element")
        head, size = struct.unpack_from(order + "II", data, at)
        if head >> 16:  # small element: size and content within the tag
            head, size, start, step = head & 0xFFFF, head >> 16, at + 4, 8
            if size > 4:
                raise DamagedMatError("a small element is too large")
        else:
            start = at + 8
            step = 8 + (size if head == _MAT_COMPRESSED else -(-size // 8) * 8)
        if start + size > len(data):
            raise DamagedMatError("it ends within an element")
        yield head, data[start : start + size]
        at += step


def _mat_matrix(payload: memoryview, order: str, depth: int) -> tuple[str, Any]:
    """Name and value of a matrix; None for what is neither numbers nor struct."""
    parts = _mat_elements(payload, order)

    def numbers() -> npt.NDArray[Any]:
        kind, content = next(parts, (0, payload[:0]))
        dtype = np.dtype(order + _MAT_TYPES.get(kind, "u1"))
        if kind not in _MAT_TYPES or len(content) % dtype.itemsize:
            raise DamagedMatError(f"an element of type {kind} where numbers belong")
        return np.frombuffer(content, dtype)

    flags = numbers()
    if flags.size != 2:
        raise DamagedMatError("a variable without flags")
    kind, is_complex = int(flags[0]) & 0xFF, bool(int(flags[0]) & 0x800)
    if kind != _MAT_STRUCT and kind not in _MAT_NUMERIC:
        return "", None
    shape = tuple(int(n) for n in numbers())
    name = numbers().tobytes().decode("latin-1")
    if len(shape) < 2 or min(shape) < 0:
        raise DamagedMatError(f"variable {name[:40]!r} has shape {shape[:8]}")
    if kind == _MAT_STRUCT:
        if math.prod(shape) != 1 or depth == _MAT_DEPTH:
            return name, None
        width = int(numbers()[:1].sum())
        text = numbers().tobytes()
        if not 0 < width <= len(text):
            return name, None
        keys = [text[k : k + width].split(b"\0")[0].decode("latin-1")
                for k in range(0, len(text), width)]  # fmt: skip
        fields = {}
        for key, (inner, content) in zip(keys, parts, strict=False):
            value = _mat_matrix(content, order, depth + 1)[1] if inner == _MAT_MATRIX else None
            if value is not None:
                fields[key] = value
        return name, fields
    value = numbers()
    if is_complex:
        imaginary = numbers()
        if imaginary.size != value.size:
            raise DamagedMatError(f"variable {name[:40]!r} has an incomplete imaginary part")
        value = value + 1j * imaginary
    if value.size != math.prod(shape) or len(shape) > 8:
        raise DamagedMatError(
            f"variable {name[:40]!r} has {value.size} numbers for shape {shape[:8]}"
        )
    return name, value.reshape(shape, order="F")


def read_mat(path: Path) -> dict[str, Any]:
    """Numeric variables of a MAT-file of version 4 to 7, structs flattened."""
    with path.open("rb") as file:
        head = file.read(128)
    if head.startswith(b"\x89HDF") or head.startswith(b"MATLAB 7.3"):
        raise ValueError(
            f"{path.name} is a MAT-file of version 7.3 (HDF5), which is not read; save it in "
            "MATLAB with save(..., '-v7'), or read it with h5py and pass a dict of arrays"
        )
    try:
        table: dict[str, Any] = {}
        content = path.read_bytes()
        # Version 4 begins with a small number in one byte order or the other, later ones with text.
        old = content[:4] and 0 in content[:4] and content[126:128] not in (b"IM", b"MI")
        _flatten("", mat4_variables(content) if old else mat_variables(content), table)
    except DamagedMatError as err:
        raise ValueError(
            f"{path.name} is damaged or no MAT-file of version 4 to 7 ({err})"
        ) from err
    if not table:
        raise ValueError(f"{path.name} holds no numeric variable")
    return table


def _flatten(prefix: str, content: Mapping[str, Any], table: dict[str, Any]) -> None:
    """Vectors and scalars as 1-D arrays; matrices as ``name.j``."""
    for key, value in content.items():
        if isinstance(value, dict):
            _flatten(f"{prefix}{key}.", value, table)
        elif value.ndim == 2 and 1 < value.shape[1] <= 64 and value.shape[0] > 1:
            table.update({f"{prefix}{key}.{j}": value[:, j] for j in range(value.shape[1])})
        elif value.size:
            table[f"{prefix}{key}"] = value.ravel() if max(value.shape) == value.size else value
