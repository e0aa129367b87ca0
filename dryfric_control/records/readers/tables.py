"""Tables: arrays of numpy, lines of JSON, and what pandas reads."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dryfric_control.records.readers.channels import Wanted
from dryfric_control.records.readers.limits import check_room, refused_if_damaged, too_long
from dryfric_control.records.record_warning import warn

_LONGEST = 64  # numbers taken of an array in a message, such as the joints of a robot
_DEEPEST = 8


def read_numpy(path: Path, wanted: Wanted) -> dict[str, Any]:
    """Arrays of a .npz file by name, fields or numbered columns of a .npy file."""
    alone = path.suffix.lower() == ".npy"
    if not alone:
        check_room(path)
    with refused_if_damaged(path, f"{path.suffix} file of numbers"):
        # As a map it claims no more memory than there is file.
        loaded = np.load(path, mmap_mode="r" if alone else None, allow_pickle=False)
        found = {path.stem: loaded} if alone else dict(loaded.items())
    table: dict[str, Any] = {}
    for name, array in found.items():
        if array.ndim and array.shape[0] > wanted.max_rows:
            raise ValueError(too_long(path.name, wanted.max_rows))
        if array.dtype.names:
            table |= {field: np.array(array[field]).ravel() for field in array.dtype.names}
        elif array.ndim == 2 and min(array.shape) > 1:
            rows = array if array.shape[0] >= array.shape[1] else array.T
            prefix = "" if len(found) == 1 else f"{name}."
            table |= {f"{prefix}{k}": np.array(rows[:, k]) for k in range(rows.shape[1])}
        else:
            table[name] = np.array(array).ravel()
    return table


def read_json_lines(path: Path, wanted: Wanted) -> dict[str, Any]:
    """One object a line: numbers by the path that leads to each, nan where one is not there."""
    found: dict[str, list[float]] = {}
    rows = 0
    lines = path.read_bytes().splitlines()
    for number, line in enumerate(lines, 1):
        if not line.strip():
            continue
        try:
            content = json.loads(line)
            if not isinstance(content, dict):
                raise ValueError("no object {...}")
        except (ValueError, RecursionError) as problem:
            if number == len(lines) and rows:
                warn(f"{path.name}: line {number}, the last, is cut off, and left out")
                break
            raise ValueError(f"{path.name}: line {number} is no JSON object ({problem})") from None
        for key, value in numbers("", content, 0):
            column = found.setdefault(key, [])
            column.extend([np.nan] * (rows - len(column)))
            column.append(value)
        rows += 1
        if rows > wanted.max_rows:
            raise ValueError(too_long(path.name, wanted.max_rows))
    return {key: np.array(one + [np.nan] * (rows - len(one))) for key, one in found.items()}


def numbers(
    prefix: str, content: Any, depth: int, empty: set[str] | None = None
) -> Iterator[tuple[str, float]]:
    """Numbers of a message; those of an array by the names that stand beside it, or by index.

    Arrays without any are added to `empty`.
    """
    if isinstance(content, (int, float)) and not isinstance(content, bool):
        yield prefix, float(content)
    elif depth == _DEEPEST or isinstance(content, (str, bytes, bool, type(None))):
        return
    elif isinstance(content, (Sequence, np.ndarray)):
        if len(content) == 0 and empty is not None:
            empty.add(prefix)
        for k, value in enumerate(content[:_LONGEST]):
            yield from numbers(f"{prefix}.{k}" if prefix else str(k), value, depth + 1, empty)
    elif isinstance(content, np.generic):
        yield from numbers(prefix, content.item(), depth + 1)
    else:
        for key, value in _name_elements(_fields(content)).items():
            path = f"{prefix}.{key}" if prefix else str(key)
            yield from numbers(path, value, depth + 1, empty)


def _name_elements(items: dict[str, Any]) -> dict[str, Any]:
    """Parts of a message, the elements of its arrays by the names that stand beside them."""
    names = items.get("name")
    if not (isinstance(names, (list, tuple)) and all(isinstance(n, str) for n in names)):
        return items
    found = dict(items)
    for key, value in items.items():
        if names and isinstance(value, (Sequence, np.ndarray)) and len(value) == len(names):
            found[key] = dict(zip(names, value, strict=True))
    return found


def _fields(content: Any) -> dict[str, Any]:
    """Named parts of a message: a mapping, or an object of a decoder's own class."""
    if isinstance(content, Mapping):
        return dict(content)
    names = getattr(content, "__slots__", ()) or getattr(content, "__dataclass_fields__", ())
    return {key: getattr(content, key) for key in names}


def read_frame(path: Path, wanted: Wanted) -> Any:
    """Data frame of the first sheet of a spreadsheet, or of a Parquet file, errors as one."""
    sheet = path.suffix.lower() == ".xlsx"
    engine = "openpyxl" if sheet else "pyarrow"
    if sheet:
        check_room(path)
    try:
        with refused_if_damaged(path, f"{path.suffix} file"):
            import pandas

            if sheet:
                return pandas.read_excel(path, engine=engine)
            from pyarrow.parquet import read_metadata

            # Equal values take no room in a file, but do in memory.
            if read_metadata(path).num_rows <= wanted.max_rows:
                return pandas.read_parquet(path, engine=engine)
    except ImportError:
        raise ImportError(
            f"{path.name}: reading {path.suffix} needs pandas and {engine}: "
            f"pip install pandas {engine}"
        ) from None
    raise ValueError(too_long(path.name, wanted.max_rows))
