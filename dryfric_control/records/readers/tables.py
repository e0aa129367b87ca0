"""Spreadsheets and Parquet files, through pandas."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from dryfric_control.records.readers.limits import check_room, refused_if_damaged, too_long


def read_xlsx(path: Path) -> Any:
    """First sheet of a spreadsheet as a data frame."""
    check_room(path)
    return _read(path, "read_excel", "openpyxl")


def read_parquet(path: Path, max_rows: int) -> Any:
    """A Parquet file as a data frame, if it does not claim too many rows."""
    return _read(path, "read_parquet", "pyarrow", max_rows)


def _read(path: Path, function: str, engine: str, max_rows: int | None = None) -> Any:
    """What pandas makes of a file, its many errors as one."""
    try:
        with refused_if_damaged(path, f"{path.suffix} file"):
            import pandas

            # Equal values take no room in a file, but do in memory.
            if max_rows is None or _rows(path) <= max_rows:
                return getattr(pandas, function)(path, engine=engine)
    except ImportError:
        raise ImportError(
            f"{path.name}: reading {path.suffix} needs pandas and {engine}: "
            f"pip install pandas {engine}"
        ) from None
    raise ValueError(too_long(path.name, max_rows))


def _rows(path: Path) -> int:
    """Rows that a Parquet file claims."""
    from pyarrow.parquet import read_metadata

    return int(read_metadata(path).num_rows)
