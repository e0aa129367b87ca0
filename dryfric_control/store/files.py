"""Files that are there to read, and files that appear whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from dryfric_control.text import did_you_mean


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
    """
    target = Path(path)
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
