"""Logs of robots in MCAP files: messages in JSON or of ROS 2."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import numpy as np

from dryfric_control.records.readers.channels import Wanted, assign_columns
from dryfric_control.records.readers.limits import refused_if_damaged, too_long
from dryfric_control.records.readers.tables import numbers

_SHORT = 1 << 16  # bytes of a read that need no look at what the file holds


class _NoLonger(io.BufferedReader):
    """File that asks for no more memory than it holds, whatever length a damaged record states."""

    def read(self, size: int | None = -1, /) -> bytes:
        if size is not None and size > _SHORT:
            place = self.tell()
            size = max(0, min(size, self.seek(0, io.SEEK_END) - place))
            self.seek(place)
        return super().read(size)


def read_mcap(path: Path, wanted: Wanted) -> dict[str, Any]:
    """Channels of a log on the time stamps of the position, by topic if there are several."""
    topics = _topics(path, wanted.max_rows)
    if not topics:
        raise ValueError(f"{path.name} holds no messages with numbers in JSON or of ROS 2")
    alone = len(topics) == 1
    place = {
        (key if alone else f"{topic}.{key}"): (topic, key)
        for topic, (_, fields) in topics.items()
        for key in fields
    }
    headings = ["t", *(h for h in place if h != "t")]
    chosen = assign_columns(headings, wanted._replace(timed=True), path.name)
    clock = topics[place[headings[chosen["x" if "x" in chosen else "v"]]][0]][0]
    table: dict[str, Any] = {"t": clock}
    for role, k in chosen.items():
        if k == 0:
            continue
        topic, key = place[headings[k]]
        stamps, fields = topics[topic]
        values = np.asarray(fields[key], dtype=np.float64)
        if stamps is not clock:  # the input is held, everything else runs along straight lines
            after = np.searchsorted(stamps, clock, side="right")
            if role == "u":
                values = values[np.maximum(after - 1, 0)]
            else:
                values = np.interp(clock, stamps, values)
        table[headings[k]] = values
    return table | {h: () for h in headings if h not in table}


def _topics(path: Path, max_rows: int) -> dict[str, tuple[Any, dict[str, Any]]]:
    """Seconds and numeric fields of each topic."""
    try:
        from mcap.reader import make_reader
    except ImportError:
        raise ImportError(
            f'{path.name}: reading .mcap needs mcap: pip install "dryfric-control[mcap]"'
        ) from None
    stamps: dict[str, list[tuple[int, int]]] = {}
    found: dict[str, dict[str, list[float]]] = {}
    rows, ros2 = 0, _ros2()
    with refused_if_damaged(path, "MCAP file"), _NoLonger(io.FileIO(path)) as file:
        for schema, channel, message in make_reader(file).iter_messages():
            fields = dict(numbers("", _content(schema, channel, message, ros2), 0))
            if not fields:
                continue
            rows += 1
            if rows > max_rows:
                break
            both = _stamp(fields), message.log_time
            stamps.setdefault(channel.topic, []).append(both)
            kept = found.setdefault(channel.topic, {key: [] for key in fields})
            for key in list(kept):
                if key in fields:
                    kept[key].append(fields[key])
                else:
                    del kept[key]  # not in every message
    if rows > max_rows:
        raise ValueError(too_long(path.name, max_rows))
    stamps = {topic: times for topic, times in stamps.items() if found[topic]}
    clock = 0 if all(own for times in stamps.values() for own, _ in times) else 1
    start = min((t[clock] for times in stamps.values() for t in times), default=0)
    topics = {}
    for topic, times in stamps.items():
        since = np.array([t[clock] - start for t in times])
        order = np.argsort(since, kind="stable")  # a logger may write one after the next
        columns = {key: np.array(values)[order] for key, values in found[topic].items()}
        topics[topic] = since[order] * 1e-9, columns
    return topics


def _stamp(fields: dict[str, float]) -> int:
    """Stamp in the header of a message in ns, taken out of its fields; 0 if there is none."""
    parts = [fields.pop(f"header.stamp.{part}", 0.0) for part in ("sec", "nanosec")]
    return 1_000_000_000 * int(parts[0]) + int(parts[1])


def _ros2() -> Any:
    """Decoders of ROS 2 messages, None where they are not installed."""
    try:
        from mcap_ros2.decoder import DecoderFactory
    except ImportError:
        return None
    return DecoderFactory()


def _content(schema: Any, channel: Any, message: Any, ros2: Any) -> Any:
    """Decoded message, None where nothing here decodes it."""
    if channel.message_encoding == "json":
        return json.loads(message.data)
    decode = ros2 and ros2.decoder_for(channel.message_encoding, schema)
    return decode(message.data) if decode else None
