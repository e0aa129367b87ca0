"""Measurement files of INCA, CANape and others: MDF 3 and 4."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np

from dryfric_control.records.readers.log_file import Channel, LogFile


class MdfFile(LogFile):
    """Channels of an MDF file, each on the clock of its group.

    ``to_dataframe(raster=...)`` of the library is not used: where a file does not begin at 0 s,
    half of its rows may be one sample old (8.8.28, ``findings/mdf_raster.sh``).
    """

    kind = "MDF file"
    extra = "mdf"
    modules = ("asammdf",)

    def _open(self, *libraries: Any) -> list[str]:
        try:
            self._file = libraries[0].MDF(str(self.path))
        except Exception as refused:
            _leave_unclosed(refused)
            raise
        count = Counter(
            channel.name for group in self._file.groups for channel in group.channels
        )  # fmt: skip
        self._place: dict[str, tuple[int, int]] = {}
        for k, group in enumerate(self._file.groups):
            master = self._file.masters_db.get(k)
            if master is None:
                continue  # without a clock
            for j, channel in enumerate(group.channels):
                if j == master:
                    continue
                name = channel.name
                if count[name] > 1:
                    name = f"{getattr(group.channel_group, 'acq_name', '') or f'CG{k}'}.{name}"
                unit = _unit(channel)
                self._place.setdefault(f"{name} [{unit}]" if unit else name, (k, j))
        return list(self._place)

    def _read_channel(self, heading: str) -> Channel:
        group, index = self._place[heading]
        signal = self._file.get(group=group, index=index)
        values = np.asarray(signal.samples)
        if values.ndim != 1 or values.dtype.kind not in "iuf":
            raise ValueError(f"channel {heading!r} holds no numbers")
        return Channel(values, np.asarray(signal.timestamps, np.float64), "s")

    def close(self) -> None:
        self._file.close()


def _unit(channel: Any) -> str:
    """Unit of a channel, or of its conversion."""
    conversion = getattr(channel, "conversion", None)
    unit = getattr(channel, "unit", "") or getattr(conversion, "unit", "") or ""
    return unit.decode("latin-1").strip(" \0") if isinstance(unit, bytes) else str(unit).strip()


def _leave_unclosed(refused: Exception) -> None:
    """Let files that could not be opened go without a word.

    The library closes one as it is collected and, where it is half made, complains on the console.
    """
    step = refused.__traceback__
    while step is not None:
        file: Any = step.tb_frame.f_locals.get("self")
        if type(file).__name__.startswith("MDF") and hasattr(file, "close"):
            file.close = lambda: None
        step = step.tb_next
