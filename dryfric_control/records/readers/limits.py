"""What no reader takes: damaged files, and those that hold or claim too much."""

from __future__ import annotations

import io
import logging
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

# Size up to which any archive may unpack [byte].
_ROOM = 2**26
# Largest unpacked size over that of the file: XML shrinks ten times.
_RATIO = 100


def too_long(where: str, max_rows: int) -> str:
    """What to say of a source of too many rows."""
    return f"{where} has more than {max_rows} rows; cut or decimate it, or allow more by max_rows="


@contextmanager
def silence_libraries() -> Iterator[None]:
    """Libraries log what they make of a damaged file; what a user must know is in the error."""
    before = logging.root.manager.disable
    logging.disable(logging.WARNING)
    try:
        yield
    finally:
        logging.disable(before)


@contextmanager
def refused_if_damaged(path: Path, what: str) -> Iterator[None]:
    """Whatever a library raises on a damaged file, as one error that names it."""
    try:
        with silence_libraries():
            yield
    except ImportError:
        raise
    except Exception as problem:
        kind = "" if type(problem) is ValueError else f"{type(problem).__name__}: "
        words = " ".join(str(problem).split())[:120]
        raise ValueError(f"{path.name} is damaged or no {what} ({kind}{words})") from None


class BoundedFile(io.BufferedReader):
    """File that takes no room for more than it holds, whatever number of bytes is asked for."""

    def __init__(self, path: Path) -> None:
        super().__init__(io.FileIO(path))
        self._size = path.stat().st_size

    def read(self, size: int | None = -1, /) -> bytes:
        """At most `size` bytes, or all that is left."""
        left = max(0, self._size - self.tell())
        return super().read(left if size is None or size < 0 else min(size, left))


def check_room(path: Path) -> None:
    """Refuse an archive that would unpack to far more than such a file holds."""
    with refused_if_damaged(path, f"{path.suffix} file"), zipfile.ZipFile(path) as archive:
        size = sum(item.file_size for item in archive.infolist())
    if size > max(_ROOM, _RATIO * path.stat().st_size):
        raise ValueError(f"{path.name} would unpack to {size} bytes; export it as CSV")
