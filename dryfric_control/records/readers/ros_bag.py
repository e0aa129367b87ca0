"""Bags of ROS 1 and ROS 2."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

from dryfric_control.records.readers.log_file import MessageLog

# Messages of pictures and point clouds, which take long to decode and hold no channel.
_BULKY = ("Image", "CompressedImage", "PointCloud", "PointCloud2", "LaserScan", "OccupancyGrid")


class RosBag(MessageLog):
    """Messages of a bag of ROS 1 (``.bag``) or ROS 2 (``.db3``, or the folder of the bag)."""

    kind = "bag of ROS"
    extra = "ros"
    modules = ("rosbags.highlevel", "rosbags.typesys")

    def _messages(self, *libraries: Any) -> Iterator[tuple[str, int, Any]]:
        highlevel, typesys = libraries
        if self.path.suffix == ".bag":
            _check_sizes(self.path)
        stores = typesys.Stores
        store = stores.ROS1_NOETIC if self.path.suffix == ".bag" else stores.LATEST
        # Bags of older versions of ROS 2 do not say what their messages hold.
        usual = typesys.get_typestore(store)
        with highlevel.AnyReader([self.path], default_typestore=usual) as bag:
            known = [
                connection
                for connection in bag.connections
                if connection.msgtype in bag.typestore.fielddefs
                and connection.msgtype.rpartition("/")[2] not in _BULKY
            ]
            if not known:
                return
            for connection, arrival, data in bag.messages(connections=known):
                yield connection.topic, arrival, bag.deserialize(data, connection.msgtype)


def _check_sizes(path: Path) -> None:
    """Refuse a bag of ROS 1 with a record that is said to go on beyond the end of the file.

    The library takes room for what a record says, up to 4 GB
    (https://wiki.ros.org/Bags/Format/2.0).
    """
    size = path.stat().st_size
    places = {size}
    wanted = set()
    with path.open("rb") as file:
        file.readline()
        while (place := file.tell()) < size:
            places.add(place)
            header = file.read(_length(file, size))
            for name in (b"index_pos=", b"chunk_pos="):
                if name in header:
                    wanted.add(int.from_bytes(header.partition(name)[2][:8], "little"))
            file.seek(_length(file, size), os.SEEK_CUR)
    if wanted - places - {0}:  # 0: it has no index, as the library says
        raise ValueError("its index points to where no record begins; try rosbag reindex")


def _length(file: BinaryIO, size: int) -> int:
    """Length of what follows, from the four bytes before it."""
    word = file.read(4)
    length = int.from_bytes(word, "little")
    if len(word) < 4 or length > size - file.tell():
        raise ValueError("a record goes on beyond the end of the file; try rosbag reindex")
    return length
