"""Logs of robots in MCAP files: messages in JSON or of ROS 2."""

from __future__ import annotations

import io
import json
from collections.abc import Iterator
from typing import Any

from dryfric_control.records.readers.log_file import MessageLog

_SHORT = 1 << 16  # bytes of a read that need no look at what the file holds


class _NoLonger(io.BufferedReader):
    """File that asks for no more memory than it holds, whatever length a damaged record states."""

    def read(self, size: int | None = -1, /) -> bytes:
        if size is not None and size > _SHORT:
            place = self.tell()
            size = max(0, min(size, self.seek(0, io.SEEK_END) - place))
            self.seek(place)
        return super().read(size)


class McapLog(MessageLog):
    """Messages of an MCAP file; those of ROS 2 where their decoder is installed."""

    kind = "MCAP file"
    extra = "mcap"
    modules = ("mcap.reader",)

    def _messages(self, *libraries: Any) -> Iterator[tuple[str, int, Any]]:
        ros2 = _ros2()
        with _NoLonger(io.FileIO(self.path)) as file:
            for schema, channel, message in libraries[0].make_reader(file).iter_messages():
                content = _decode_message(schema, channel, message, ros2)
                yield channel.topic, message.log_time, content


def _ros2() -> Any:
    """Decoders of ROS 2 messages, None where they are not installed."""
    try:
        from mcap_ros2.decoder import DecoderFactory
    except ImportError:
        return None
    return DecoderFactory()


def _decode_message(schema: Any, channel: Any, message: Any, ros2: Any) -> Any:
    """Decoded message, None where nothing here decodes it."""
    if channel.message_encoding == "json":
        return json.loads(message.data)
    decode = ros2 and ros2.decoder_for(channel.message_encoding, schema)
    return decode(message.data) if decode else None
