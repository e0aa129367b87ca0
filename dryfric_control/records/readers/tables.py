"""Spreadsheets and Parquet files, through pandas."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

# Bytes that a spreadsheet may unpack to, at least, and per byte of the file: XML shrinks ten times.
_ROOM, _RATIO = 2**26, 100


def read_xlsx(path: Path) -> Any:
    """First sheet of a spreadsheet as a data frame."""
    try:
        with zipfile.ZipFile(path) as archive:
            size = sum(item.file_size for item in archive.infolist())
    except (zipfile.BadZipFile, OSError, ValueError, NotImplementedError) as problem:
        raise ValueError(f"{path.name} is damaged or no .xlsx file ({problem})") from None
    if size > max(_ROOM, _RATIO * path.stat().st_size):
        raise ValueError(f"{path.name} would unpack to {size} bytes; export the sheet as CSV")
    return _read(path, "read_excel", "openpyxl")


def read_parquet(path: Path) -> Any:
    """A Parquet file as a data frame."""
    return _read(path, "read_parquet", "pyarrow")


def _read(path: Path, function: str, engine: str) -> Any:
    """What pandas makes of a file, its many errors as one."""
    try:
        import pandas

        return getattr(pandas, function)(path, engine=engine)
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
