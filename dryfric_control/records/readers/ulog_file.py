"""Flight logs of PX4: ULog."""

from __future__ import annotations

import io
from collections import Counter
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

from dryfric_control.records.readers.log_file import Channel, LogFile
from dryfric_control.records.record_warning import warn

# Types of the messages of the section of definitions, and of those that end it
# (https://docs.px4.io/main/en/dev_log/ulog_file_format).
_DEFINITIONS, _DATA = b"BFIMPQ", b"ALC"
# Length of the header of the file, and of that of a message [byte].
_FILE_HEAD = 16
_MESSAGE_HEAD = 3


class UlogFile(LogFile):
    """Fields of the topics of a ULog, each topic on its own stamps."""

    kind = "ULog"
    extra = "ulog"
    modules = ("pyulog",)

    def _open(self, *libraries: Any) -> list[str]:
        _check_definitions(self.path)
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

    def _read_channel(self, heading: str) -> Channel:
        topic, field = self._topics[heading]
        return Channel(topic.data[field], topic.data["timestamp"], "us")


def _check_definitions(path: Path) -> None:
    """Refuse a log with damaged definitions: not every such log comes to an end in the library."""
    size = path.stat().st_size
    with path.open("rb") as file:
        file.seek(_FILE_HEAD)
        while len(head := file.read(_MESSAGE_HEAD)) == _MESSAGE_HEAD and head[2] not in _DATA:
            end = file.tell() + int.from_bytes(head[:2], "little")
            if head[2] not in _DEFINITIONS or end > size:
                raise ValueError(f"damaged definitions at byte {file.tell() - _MESSAGE_HEAD}")
            file.seek(end)
