"""Spreadsheets and Parquet files, through pandas."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from dryfric_control.records.readers.limits import check_room, refused_if_damaged, too_long


def read_frame(path: Path, max_rows: int) -> Any:
    """Data frame of the first sheet of a spreadsheet, or of a Parquet file, errors as one."""
    sheet = path.suffix.lower() == ".xlsx"
    engine = "openpyxl" if sheet else "pyarrow"
    if sheet:
        check_room(path)
    try:
        with refused_if_damaged(path, f"{path.suffix} file"):
            import pandas

            if sheet:
                return pandas.read_excel(path, engine=engine)
            from pyarrow.parquet import read_metadata

            # Equal values take no room in a file, but do in memory.
            if read_metadata(path).num_rows <= max_rows:
                return pandas.read_parquet(path, engine=engine)
    except ImportError:
        raise ImportError(
            f"{path.name}: reading {path.suffix} needs pandas and {engine}: "
            f"pip install pandas {engine}"
        ) from None
    raise ValueError(too_long(path.name, max_rows))
