"""Everything that is saved: JSON files with a version and a checksum, read back bit by bit."""

from __future__ import annotations

import hashlib
import json
import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from typing import Any, ClassVar, Self

import numpy as np

from dryfric_control.model.axis import FrictionAxis
from dryfric_control.store.axis_file import (
    axis_from_dict,
    axis_to_dict,
    read_axis,
)
from dryfric_control.store.files import (
    existing_file,
    file_path,
    read_json,
    replace_file,
)

#: Version of the files that are written.
VERSION = 1
#: By a version, what makes the data of a kind those of the next version.
MIGRATIONS: dict[int, Callable[[str, dict[str, Any]], dict[str, Any]]] = {}

_PLAIN = (str, bool, int, type(None))
# What senseless data make their class or a check raise.
_SENSELESS = (
    ArithmeticError,
    AttributeError,
    IndexError,
    KeyError,
    RecursionError,
    SyntaxError,
    TypeError,
    ValueError,
)


class Saved:
    """Something that a file keeps: as it was, or not at all.

    Notes
    -----
    Rules for a new kind of file:

    1. Its class is a dataclass that inherits this one and names its `_kind`, which the file states.
    2. `_holds` names the dataclasses that may stand in the file beside it; no other is read.
    3. What follows from the rest is not kept: `_to_saved` leaves it out, and `_from_saved` computes
       it anew.
    4. `_from_saved` refuses what the function that makes the object would refuse.
    5. Where fields change, `VERSION` is raised and `MIGRATIONS` gets what makes the data of the
       version before into those of the next.
    """

    _kind: ClassVar[str]  # what the file says that it is
    _holds: ClassVar[tuple[type, ...]] = ()  # classes of what stands in it beside
    _otherwise: ClassVar[str] = ""  # what to say of a file that is none of these
    _broken: ClassVar[type[ValueError] | None] = None  # raised where it promises too much

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write all that it holds to a JSON file for `load`.

        Parameters
        ----------
        path : path-like
            File to write, replaced as a whole or not at all.
        """
        file_path("path", path)  # before a large result is converted
        content = to_plain(self._to_saved(), (type(self), *self._holds))
        write_document(path, self._kind, {"content": content})

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Self:
        """Read back what `save` wrote, as it was.

        The certificate of an observer or a compensation is computed anew.

        Parameters
        ----------
        path : path-like
            A file of another kind or version, that was changed, or whose gains fail their
            certificate, is refused.

        Examples
        --------
        >>> import pathlib, tempfile
        >>> import numpy as np
        >>> import dryfric_control as dfc
        >>> t = 1e-3 * np.arange(2000)
        >>> record = dfc.Record(t, np.cos(t), np.sin(t), name="run")
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     record.save(pathlib.Path(folder, "run.json"))
        ...     dfc.Record.load(pathlib.Path(folder, "run.json")) == record
        True
        """
        data, intact = read_document(path, cls._kind, cls._otherwise)
        try:
            # Numbers beyond all reason overflow somewhere; sound ones do nowhere.
            with np.errstate(over="raise", divide="raise", invalid="raise"):
                found = cls._from_saved(from_plain(data["content"], (cls, *cls._holds)))
        except _SENSELESS as error:
            if cls._broken is not None and isinstance(error, cls._broken):
                raise cls._broken(f"{path} was changed: {error}") from None
            raise ValueError(
                f"{path} is damaged: {type(error).__name__}: {error}; save the {cls._kind} again"
            ) from None
        if not intact:
            raise ValueError(
                f"{path} was changed after it was written: its checksum does not fit. Make and "
                "save it again in place of editing the file"
            )
        return found

    def _to_saved(self) -> Any:
        """What the file holds of it."""
        return self

    @classmethod
    def _from_saved(cls, held: Any) -> Self:
        """What a file held, checked."""
        if type(held) is not cls:
            raise ValueError(f"it holds {type(held).__name__}")
        return held


def write_document(path: str | os.PathLike[str], kind: str, data: Mapping[str, Any]) -> None:
    """Write plain data as JSON with a checksum, as a whole or not at all."""
    whole = {
        "format": f"dryfric-control {kind}",
        "version": VERSION,
        **data,
    }
    whole["checksum"] = _checksum(whole)
    with (
        replace_file(path) as temporary,
        temporary.open("w", encoding="utf-8") as file,
    ):
        json.dump(whole, file, indent=1, allow_nan=False)
        file.write("\n")


def read_document(
    path: str | os.PathLike[str], kind: str, otherwise: str = ""
) -> tuple[dict[str, Any], bool]:
    """Data that `write_document` wrote, in this version, and whether the checksum fits."""
    try:
        data = read_json(path)
    except ValueError as problem:
        raise ValueError(f"{problem}{otherwise}") from None
    form = f"dryfric-control {kind}"
    found = data.get("format") if isinstance(data, dict) else None
    if found != form:
        raise ValueError(f"{path} is no {kind}: it has format = {found!r}, not {form!r}{otherwise}")
    version = data.get("version")
    if version not in (VERSION, *MIGRATIONS):
        article = "an" if kind[0] in "aeiou" else "a"
        raise ValueError(
            f"{path} has version {version!r}, this package reads {VERSION}: make "
            f"{article} {kind} again, or use a newer package"
        )
    intact = data.pop("checksum", None) == _checksum(data)
    for older in range(version, VERSION):
        data = MIGRATIONS[older](kind, data)
    return data, intact


def load_any(
    path: str | os.PathLike[str],
    classes: Sequence[type[Saved]],
    mend: str,
) -> Any:
    """An axis (TOML), or an object that one of some classes saved."""
    source = existing_file(path)
    if source.suffix == ".toml":
        return read_axis(source)
    try:
        found = read_json(source)["format"]
    except (ValueError, TypeError, KeyError):
        found = None
    for cls in classes:
        if found == f"dryfric-control {cls._kind}":
            return cls.load(source)
    raise ValueError(f"{source} {mend}")


def _checksum(data: Mapping[str, Any]) -> str:
    """Of the data in one fixed spelling, so that white space and order are free."""
    text = json.dumps(data, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode("utf-8")).hexdigest()


def to_plain(value: Any, classes: Sequence[type]) -> Any:
    """What JSON holds of a value, with the kind of everything that JSON has no word for."""
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, _PLAIN):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else {"is": "float", "value": repr(value)}
    if isinstance(value, Mapping):
        pairs = [[to_plain(k, classes), to_plain(v, classes)] for k, v in value.items()]
        return {"is": "dict", "items": pairs}
    if isinstance(value, FrictionAxis):
        return {"is": "axis", "of": axis_to_dict(value)}
    if is_dataclass(value) and type(value) in classes:
        held = {item.name: to_plain(getattr(value, item.name), classes) for item in fields(value)}
        return {"is": type(value).__name__, "fields": held}
    return _plain_sequence(value, classes)


def _plain_sequence(value: Any, classes: Sequence[type]) -> Any:
    """What JSON holds of a tuple, list or array."""
    if isinstance(value, (tuple, list)):
        items = [to_plain(one, classes) for one in value]
        return {"is": "tuple", "items": items} if isinstance(value, tuple) else items
    if isinstance(value, np.ndarray) and value.dtype.kind in "biuf":
        return _plain_array(value)
    known = ", ".join(sorted(one.__name__ for one in classes))
    raise ValueError(f"a {type(value).__name__} cannot be saved: it is none of {known}")


def _plain_array(array: np.ndarray) -> dict[str, Any]:
    """What JSON holds of an array: numbers that are not finite as text."""
    values = array.ravel().tolist()
    if array.dtype.kind == "f":
        values = [value if math.isfinite(value) else repr(value) for value in values]
    return {
        "is": "array",
        "dtype": array.dtype.str,
        "shape": array.shape,
        "values": values,
    }


def from_plain(data: Any, classes: Sequence[type]) -> Any:
    """What `to_plain` was given, bit for bit."""
    if isinstance(data, (*_PLAIN, float)):
        return data
    if isinstance(data, list):
        return [from_plain(one, classes) for one in data]
    kind = data["is"]
    if kind == "float":
        return float(data["value"])
    if kind == "tuple":
        return tuple(from_plain(one, classes) for one in data["items"])
    if kind == "array":
        return np.array(data["values"], dtype=np.dtype(data["dtype"])).reshape(data["shape"])
    if kind == "dict":
        return {from_plain(k, classes): from_plain(v, classes) for k, v in data["items"]}
    if kind == "axis":
        return axis_from_dict(data["of"])
    cls = {one.__name__: one for one in classes}[kind]
    held = {name: from_plain(one, classes) for name, one in data["fields"].items()}
    if not hasattr(cls, "__setstate__"):
        return cls(**held)
    made: Any = object.__new__(cls)  # its state is not what its constructor takes
    made.__setstate__(held)
    return made
