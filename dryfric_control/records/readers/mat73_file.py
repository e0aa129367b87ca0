"""Numeric variables of MAT-files of version 7.3, which are HDF5."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from dryfric_control.records.readers.channels import Wanted
from dryfric_control.records.readers.limits import refused_if_damaged, too_long
from dryfric_control.records.readers.log_file import import_optional

_KIND = "MAT-file of version 7.3; save(..., '-v7') writes the plainer version"
_DEEPEST = 8
_COLUMNS = 64  # of a matrix that is taken apart
_SIGNALS = 1000  # of an array of structs


def read_mat73(path: Path, wanted: Wanted) -> dict[str, Any]:
    """Numeric variables, structs flattened; signals of an array of structs by their names.

    Arrays are stored transposed, text as numbers of 16 bits, an object such as a timeseries as
    numbers that point elsewhere: none of them is taken for a channel.
    """
    h5py = import_optional("h5py", "mat73", path)
    objects: list[str] = []
    table: dict[str, Any] = {}
    with refused_if_damaged(path, _KIND), h5py.File(path, "r") as file:
        for name, value in _variables(h5py, file, "", objects, 0):
            if value.size and max(value.shape) > wanted.max_rows:
                raise ValueError(too_long(path.name, wanted.max_rows))
            table.update(_columns(name, value))
    if len(table) < 2 and objects:
        one = objects[0]
        raise ValueError(
            f"{path.name}: {', '.join(objects)} are MATLAB objects (a timeseries or table), whose "
            f"numbers are not laid out in the file; save {one}_t = {one}.Time and {one}_x = "
            f"{one}.Data in MATLAB instead"
        )
    if not table:
        raise ValueError(f"{path.name} holds no numeric variable")
    return table


def _variables(
    h5py: Any, group: Any, prefix: str, objects: list[str], depth: int
) -> Iterator[tuple[str, Any]]:
    """Names and arrays of the numbers in a group, as MATLAB shows them."""
    for key, item in group.items():
        if key.startswith("#") or depth == _DEEPEST:
            continue  # what MATLAB's objects point to
        kind = item.attrs.get("MATLAB_class", b"")
        kind = kind.decode("latin-1") if isinstance(kind, bytes) else str(kind)
        name = f"{prefix}{key}"
        if "MATLAB_object_decode" in item.attrs:
            objects.append(name)
        elif isinstance(item, h5py.Group):
            if isinstance(item.get("Name"), h5py.Dataset) and item["Name"].dtype.kind == "O":
                yield from _signals(h5py, item, name)
            else:
                yield from _variables(h5py, item, f"{name}.", objects, depth + 1)
        elif kind not in ("char", "cell") and not item.attrs.get("MATLAB_empty", 0):
            if item.dtype.kind in "iuf" and item.shape:
                yield name, np.asarray(item[()]).T


def _signals(h5py: Any, group: Any, name: str) -> Iterator[tuple[str, Any]]:
    """Signals of an array of structs with fields Name and Data, as dSPACE writes it."""
    if not isinstance(group.get("Data"), h5py.Dataset):
        return
    file = group.file
    references = zip(group["Name"][()].ravel(), group["Data"][()].ravel(), strict=True)
    for k, (title, data) in enumerate(references):
        values = file[data]
        if k < _SIGNALS and values.dtype.kind in "iuf" and values.shape:
            letters = np.asarray(file[title][()]).ravel()
            text = "".join(map(chr, letters.tolist())).strip('"')
            yield text or f"{name}.{k}", np.asarray(values[()]).T


def _columns(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    """Vectors and scalars as they are, the columns of a matrix by number."""
    if value.ndim == 2 and 1 < value.shape[1] <= _COLUMNS and value.shape[0] > 1:
        yield from ((f"{name}.{j}", value[:, j]) for j in range(value.shape[1]))
    elif value.size:
        yield name, value.ravel() if max(value.shape) == value.size else value
