"""Bags of ROS 1 and ROS 2."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

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
