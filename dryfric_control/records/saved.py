"""Results with everything they hold as sealed JSON files, read back as they were."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from dryfric_control.model.axis import FrictionAxis
from dryfric_control.records.record import Record, restored
from dryfric_control.store.axis_file import axis_from_dict, axis_to_dict
from dryfric_control.store.files import load_document, write_document

_PLAIN = (str, bool, int, type(None))


def save_object(
    value: Any, path: str | os.PathLike[str], kind: str, version: int, classes: Sequence[type]
) -> None:
    """Write a result and everything it holds to a JSON file.

    Parameters
    ----------
    value : object
        A dataclass of plain values, arrays, axes, records and `classes`.
    path : path-like
        File to write, replaced as a whole or not at all.
    kind : str
        What it is, as "fit".
    version : int
        Version of the format.
    classes : sequence of type
        Dataclasses that may stand in the file.
    """
    write_document(path, kind, version, {"content": to_plain(value, classes)})


def to_plain(value: Any, classes: Sequence[type]) -> Any:
    """A result and everything it holds as what JSON has, see `save_object`."""
    return _data(value, {one.__name__ for one in classes})


def from_plain(data: Any, classes: Sequence[type]) -> Any:
    """What `to_plain` was given, bit for bit."""
    return _value(data, {one.__name__: one for one in classes})


def load_object(
    path: str | os.PathLike[str], kind: str, version: int, classes: Sequence[type]
) -> Any:
    """Read back what `save_object` wrote, bit for bit.

    Raises
    ------
    ValueError
        If the file is of another kind or version, or was changed since.
    """

    def rebuild(data: dict[str, Any]) -> Any:
        found = from_plain(data["content"], classes)
        if type(found) is not classes[0]:
            raise ValueError(f"it holds {type(found).__name__}")
        return found

    return load_document(path, kind, version, rebuild)


def _data(value: Any, known: set[str]) -> Any:
    """What JSON holds of a value, with the kind of everything that JSON has no word for."""
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, _PLAIN):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else {"is": "float", "value": repr(value)}
    if isinstance(value, (tuple, list)):
        items = [_data(one, known) for one in value]
        return {"is": "tuple", "items": items} if isinstance(value, tuple) else items
    if isinstance(value, np.ndarray) and value.dtype.kind in "biuf":
        flat = value.ravel().tolist()
        if value.dtype.kind == "f":
            flat = [v if math.isfinite(v) else repr(v) for v in flat]
        return {"is": "array", "dtype": value.dtype.str, "shape": value.shape, "values": flat}
    if isinstance(value, dict):
        return {
            "is": "dict",
            "items": [[_data(k, known), _data(v, known)] for k, v in value.items()],
        }
    if isinstance(value, FrictionAxis):
        return {"is": "axis", "of": axis_to_dict(value)}
    if isinstance(value, Record):
        return {"is": "record", "parts": [_data(part, known) for part in value.__reduce__()[1]]}
    name = type(value).__name__
    if is_dataclass(value) and name in known:
        held = {item.name: _data(getattr(value, item.name), known) for item in fields(value)}
        return {"is": name, "fields": held}
    raise ValueError(f"a {name} cannot be saved: it is none of {', '.join(sorted(known))}")


def _value(data: Any, classes: dict[str, type]) -> Any:
    """The value that `_data` wrote."""
    if isinstance(data, (*_PLAIN, float)):
        return data
    if isinstance(data, list):
        return [_value(one, classes) for one in data]
    kind = data["is"]
    if kind == "float":
        return float(data["value"])
    if kind == "tuple":
        return tuple(_value(one, classes) for one in data["items"])
    if kind == "array":
        return np.array(data["values"], dtype=np.dtype(data["dtype"])).reshape(data["shape"])
    if kind == "dict":
        return {_value(k, classes): _value(v, classes) for k, v in data["items"]}
    if kind == "axis":
        return axis_from_dict(data["of"])
    if kind == "record":
        return restored(*(_value(part, classes) for part in data["parts"]))
    return classes[kind](**{k: _value(v, classes) for k, v in data["fields"].items()})
