"""Flight logs of PX4: ULog."""

from __future__ import annotations

import io
from collections import Counter
from contextlib import redirect_stdout
from typing import Any

from dryfric_control.records.readers.log_file import Channel, LogFile
from dryfric_control.records.record_warning import warn


class UlogFile(LogFile):
    """Fields of the topics of a ULog, each topic on its own stamps."""

    kind = "ULog"
    extra = "ulog"
    modules = ("pyulog",)

    def _open(self, *libraries: Any) -> list[str]:
        with redirect_stdout(io.StringIO()):  # what the library says of damage
            log = libraries[0].ULog(str(self.path))
        if log.file_corruption:
            warn(f"{self.path.name} is damaged: what could be read of it is taken")
        count = Counter(topic.name for topic in log.data_list)
        self._topics: dict[str, tuple[Any, str]] = {}
        for topic in log.data_list:
            name = f"{topic.name}_{topic.multi_id}" if count[topic.name] > 1 else topic.name
            for field, values in topic.data.items():
                if not field.startswith("timestamp") and values.dtype.kind in "iuf":
                    self._topics[f"{name}.{field}"] = topic, field
        return list(self._topics)

    def _channel(self, heading: str) -> Channel:
        topic, field = self._topics[heading]
        return Channel(topic.data[field], topic.data["timestamp"], "us")
