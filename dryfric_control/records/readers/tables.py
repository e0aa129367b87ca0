"""Spreadsheets and Parquet files, through pandas."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

from dryfric_control.records.readers.channels import too_long

# Bytes that a spreadsheet may unpack to, at least, and per byte of the file: XML shrinks ten times.
_ROOM, _RATIO = 2**26, 100


def read_xlsx(path: Path) -> Any:
    """First sheet of a spreadsheet as a data frame."""
    check_room(path)
    return _read(path, "read_excel", "openpyxl")


def check_room(path: Path) -> None:
    """Refuse an archive that would unpack to far more than such a file holds."""
    try:
        with zipfile.ZipFile(path) as archive:
            size = sum(item.file_size for item in archive.infolist())
    except (zipfile.BadZipFile, OSError, ValueError, NotImplementedError) as problem:
        raise ValueError(f"{path.name} is damaged or no {path.suffix} file ({problem})") from None
    if size > max(_ROOM, _RATIO * path.stat().st_size):
        raise ValueError(f"{path.name} would unpack to {size} bytes; export it as CSV")


def read_parquet(path: Path, max_rows: int) -> Any:
    """A Parquet file as a data frame, if it does not claim too many rows."""
    return _read(path, "read_parquet", "pyarrow", max_rows)


def _read(path: Path, function: str, engine: str, max_rows: int | None = None) -> Any:
    """What pandas makes of a file, its many errors as one."""
    try:
        import pandas

        # Equal values take no room in a file, but do in memory.
        rows = 0 if max_rows is None else _rows(path)
        frame = None if rows > (max_rows or 0) else getattr(pandas, function)(path, engine=engine)
    except ImportError:
        raise ImportError(
            f"{path.name}: reading {path.suffix} needs pandas and {engine}: "
            f"pip install pandas {engine}"
        ) from None
    except Exception as problem:  # whatever the library raises on a damaged file
        words = " ".join(str(problem).split())[:120]
        raise ValueError(
            f"{path.name} is damaged or no {path.suffix} file ({type(problem).__name__}: {words})"
        ) from None
    if frame is None:
        raise ValueError(too_long(path.name, max_rows or 0))
    return frame


def _rows(path: Path) -> int:
    """Rows that a Parquet file claims."""
    from pyarrow.parquet import read_metadata

    return int(read_metadata(path).num_rows)
