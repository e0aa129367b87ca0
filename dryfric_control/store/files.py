"""Files that are there to read, and files that appear whole or not at all."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from dryfric_control.text import did_you_mean

T = TypeVar("T")


@contextmanager
def replacing(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Write beside a file, and take its place once everything is written.

    Parameters
    ----------
    path : path-like
        The file to make or to replace.

    Yields
    ------
    Path
        Where to write.  It moves to `path` at the end, and is removed instead
        if the block raises.

    Raises
    ------
    OSError
        If `path` is a folder, or lies in none.
    """
    target = Path(path)
    if target.is_dir():
        raise IsADirectoryError(f"{path} is a folder: name a file in it")
    if not target.parent.is_dir():
        raise FileNotFoundError(f"{path} lies in a folder that does not exist: make it first")
    temporary = target.with_name(f"{target.name}.{os.getpid()}.part")
    try:
        yield temporary
        os.replace(temporary, target)
    finally:
        temporary.unlink(missing_ok=True)


def existing_file(source: str | os.PathLike[str]) -> Path:
    """The path, once it is known to lead to a file with something in it."""
    try:
        path = Path(source)
        if path.is_dir():
            raise IsADirectoryError(f"{path} is a directory; give one file in it")
        if not path.is_file():
            near = os.listdir(path.parent) if path.parent.is_dir() else []
            raise FileNotFoundError(
                f"there is no file {str(path)!r}" + did_you_mean(path.name, near)
            )
        if path.stat().st_size == 0:
            raise ValueError(f"{path.name} is empty (0 bytes)")
    except (UnicodeEncodeError, TypeError) as err:
        raise ValueError(f"{source!r} is no file name") from err
    return path


def write_document(
    path: str | os.PathLike[str], kind: str, version: int, data: Mapping[str, Any]
) -> None:
    """Write a result as JSON, sealed by a checksum, as a whole or not at all.

    Parameters
    ----------
    path : path-like
        File to write.
    kind : str
        What it is, as "observer design".
    version : int
        Version of the format.
    data : mapping
        Plain data; floats survive bit by bit.
    """
    whole = {"format": f"dryfric-control {kind}", "version": version, **data}
    whole["checksum"] = _checksum(whole)
    with replacing(path) as temporary, temporary.open("w", encoding="utf-8") as file:
        json.dump(whole, file, indent=1, allow_nan=False)
        file.write("\n")


def read_document(
    path: str | os.PathLike[str], kind: str, version: int
) -> tuple[dict[str, Any], bool]:
    """Read what `write_document` wrote.

    Parameters
    ----------
    path : path-like
        The file.
    kind : str
        What it must be.
    version : int
        The version that can be read.

    Returns
    -------
    data : dict
        The data, without checksum.
    intact : bool
        Whether the checksum fits.

    Raises
    ------
    ValueError
        If the file is not JSON, of another kind or of another version.
    """
    article = "an" if kind[0] in "aeiou" else "a"
    try:
        data = json.loads(existing_file(path).read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{path} is damaged: not readable as JSON ({error})") from None
    form = f"dryfric-control {kind}"
    if not isinstance(data, dict) or data.get("format") != form:
        found = data.get("format") if isinstance(data, dict) else None
        raise ValueError(f"{path} is no {kind}: it has format = {found!r}, not {form!r}")
    if data.get("version") != version:
        raise ValueError(
            f"{path} has version {data.get('version')!r}, this package reads {version}: make "
            f"{article} {kind} again, or use a newer package"
        )
    seal = data.pop("checksum", None)
    return data, seal == _checksum(data)


def load_document(
    path: str | os.PathLike[str],
    kind: str,
    version: int,
    rebuild: Callable[[dict[str, Any]], T],
    broken: type[ValueError] = ValueError,
) -> T:
    """Make an object of what `write_document` wrote, with errors that name the file.

    Parameters
    ----------
    path, kind, version
        As for `read_document`.
    rebuild : callable
        Makes the object of the data, and checks them.
    broken : type
        Error of `rebuild` for data that fit together and do not keep their promise.

    Raises
    ------
    ValueError
        If the file holds something else, is damaged, or was edited.
    """
    data, intact = read_document(path, kind, version)
    try:
        # Numbers beyond all reason overflow somewhere; sound ones do nowhere.
        with np.errstate(over="raise", divide="raise", invalid="raise"):
            made = rebuild(data)
    except (
        ArithmeticError, AttributeError, IndexError, KeyError, RecursionError, TypeError, ValueError
    ) as error:  # fmt: skip
        if broken is not ValueError and isinstance(error, broken):
            raise broken(f"{path} was changed: {error}") from None
        raise ValueError(
            f"{path} is damaged: {type(error).__name__}: {error}; save the {kind} again"
        ) from None
    if not intact:
        raise ValueError(
            f"{path} was changed after it was written: its checksum does not fit. Make and save "
            "it again in place of editing the file"
        )
    return made


def _checksum(data: Mapping[str, Any]) -> str:
    """Of the data in one fixed spelling, so that white space and order are free."""
    text = json.dumps(data, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode("utf-8")).hexdigest()
