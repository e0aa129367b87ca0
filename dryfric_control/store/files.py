"""Files that are there to read, and files that appear whole or not at all."""

from __future__ import annotations

import json
import os
import tomllib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

from dryfric_control.text import did_you_mean

T = TypeVar("T")
Content = str | bytes

_ROOM = 4_000_000  # bytes, more than a report takes


@contextmanager
def replace_file(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Where to write what takes the place of a file once the block ends without an error."""
    target = file_path("path", path)
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
            near = did_you_mean(
                path.name,
                os.listdir(path.parent) if path.parent.is_dir() else [],
            )
            raise FileNotFoundError(f"there is no file {str(path)!r}{near}")
        if path.stat().st_size == 0:
            raise ValueError(f"{path.name} is empty (0 bytes)")
    except (UnicodeEncodeError, TypeError) as err:
        raise ValueError(f"{source!r} is no file name") from err
    return path


def write_file(path: str | os.PathLike[str], content: Content | Callable[[], Content]) -> None:
    """Write text in UTF-8, or bytes, as a whole or not at all.

    A function makes them once the place is known to be there.
    """
    with replace_file(path) as part:
        content = content() if callable(content) else content
        part.write_bytes(content.encode("utf-8") if isinstance(content, str) else content)


@contextmanager
def name_disk_errors(what: str, done: str = "written") -> Iterator[None]:
    """Whatever a disk refuses as an error that names it."""
    try:
        yield
    except OSError as problem:
        raise ValueError(f"{what} cannot be {done} ({problem.strerror}): name another") from None


def file_path(name: str, path: Any) -> Path:
    """The path of a file that an argument is."""
    if not isinstance(path, (str, os.PathLike)):
        raise ValueError(f"{name} must be the path of a file, got {path!r}")
    return Path(path)


def existing_folder(folder: str | os.PathLike[str]) -> Path:
    """The folder, made if it is not there."""
    if not isinstance(folder, (str, os.PathLike)):
        raise ValueError(f"folder must be a path, got {folder!r}")
    with name_disk_errors(f"folder {str(folder)!r}", "made"):
        Path(folder).mkdir(parents=True, exist_ok=True)
    return Path(folder)


def output_folder(out: str | os.PathLike[str]) -> Path:
    """The folder of a command's results, made and seen to have room before any work."""
    folder = Path(out)
    if folder.exists() and not folder.is_dir():
        raise ValueError(f"--out {folder} is a file: name a folder")
    trial = folder / "report.html.try"
    with name_disk_errors(f"--out {folder}"):
        folder.mkdir(parents=True, exist_ok=True)
        try:
            trial.write_bytes(bytes(_ROOM))
        finally:
            trial.unlink(missing_ok=True)
    return folder


def read_toml(
    path: str | os.PathLike[str],
    read: Callable[[Any], T],
    table: str = "",
) -> T:
    """What `read` makes of a TOML file, or of one table in it; its errors name the file."""
    raw = existing_file(path).read_bytes()
    try:
        data = tomllib.loads(raw.decode("utf-8"))
    except (ValueError, RecursionError) as problem:
        raise ValueError(f"{path} is no TOML: {problem}") from None
    try:
        part = data.get(table, {}) if table else data
        if not isinstance(part, dict):
            raise ValueError(f"{table} must be a table headed [{table}], got {part!r}")
        return read(part)
    except ValueError as problem:
        raise ValueError(f"{path}: {problem}") from None


def read_json(path: str | os.PathLike[str]) -> Any:
    """What a JSON file holds."""
    file = existing_file(path)
    try:
        return json.loads(file.read_text(encoding="utf-8-sig"))
    except (ValueError, RecursionError) as problem:
        what = "damaged: not readable as" if file.suffix.lower() == ".json" else "no"
        raise ValueError(f"{path} is {what} JSON ({str(problem)[:80]})") from None
