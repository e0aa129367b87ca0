"""Files of LabVIEW and DIAdem: TDMS."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from dryfric_control.arrays import Ints
from dryfric_control.records.readers.channels import parse_heading, split_header
from dryfric_control.records.readers.limits import BoundedFile
from dryfric_control.records.readers.log_file import Channel, LogFile


class _Timing(NamedTuple):
    """Timing of a channel from one of its samples on."""

    first: int
    start: int  # ns since 1970, 0 if it is not known
    increment: float  # [s]


class TdmsFile(LogFile):
    """Channels of a TDMS file on absolute time tracks of their own, or that of a time channel.

    ``as_dataframe(time_index=True)`` of the library is not used: it puts channels that began apart
    into one row. Nor is its time track: where a run was started again in one file, it has only the
    last increment and start (1.13.0).
    """

    kind = "TDMS file"
    extra = "tdms"
    modules = ("nptdms", "nptdms.reader")

    def _open(self, *libraries: Any) -> list[str]:
        nptdms, reader = libraries
        self._timings = _read_timings(reader.TdmsReader, self.path)
        self._bytes = BoundedFile(self.path)
        self._file = nptdms.TdmsFile.open(self._bytes)
        groups = self._file.groups()
        self._channels: dict[str, Any] = {}
        self._clocks: dict[str, Any] = {}
        for group in groups:
            self._add(group, several=len(groups) > 1)
        if not self._channels and self.hint:
            raise ValueError(
                f"no channel has a time{self.hint}; read it with nptdms and give rate="
            )
        return list(self._channels)

    def _add(self, group: Any, several: bool) -> None:
        """Channels of a group that have a time."""
        every = [one for one in group.channels() if len(one)]
        times = (one for one in every if parse_heading(split_header(one.name)[0]).role == "t")
        clock = next(times, None)
        for one in every:
            timed = one.path in self._timings
            if one.dtype.kind not in "iuf" or (one is clock and not timed):
                continue
            if not timed and (clock is None or len(clock) != len(one)):
                self.hint += f"; {one.path} has neither an increment nor a channel of time"
                continue
            heading = f"{group.name}/{one.name}" if several else one.name
            unit = str(one.properties.get("unit_string", "")).strip()
            heading = f"{heading} [{unit}]" if unit else heading
            self._channels[heading] = one
            self._clocks[heading] = None if timed else clock

    def _read_channel(self, heading: str) -> Channel:
        one = self._channels[heading]
        clock = self._clocks[heading]
        if clock is None:
            return Channel(one[:], _sample_stamps(self._timings[one.path], len(one)))
        times = clock[:]
        if times.dtype.kind == "M":
            return Channel(one[:], times.astype("M8[ns]").astype(np.int64))
        unit = str(clock.properties.get("unit_string", "")).strip() or "s"
        return Channel(one[:], times, unit)

    def close(self) -> None:
        self._file.close()
        self._bytes.close()


def _read_timings(reader: Any, path: Path) -> dict[str, list[_Timing]]:
    """Timings of each channel with an increment, in order of its samples."""
    found: dict[str, list[_Timing]] = {}

    class Timed(reader):
        """Reader that keeps what each segment says of the timing."""

        def _update_object_metadata(self, segment: Any) -> None:
            self.before = {name: one.num_values for name, one in self.object_metadata.items()}
            super()._update_object_metadata(segment)

        def _update_object_properties(self, properties: Any) -> None:
            super()._update_object_properties(properties)
            for name, changes in (properties or {}).items():
                known = self.object_metadata[name].properties
                if "wf_increment" not in known or not any(key[:3] == "wf_" for key, _ in changes):
                    continue
                timing = _Timing(
                    self.before.get(name, 0),
                    _start_in_ns(known.get("wf_start_time"))
                    + round(1e9 * float(known.get("wf_start_offset", 0.0))),
                    float(known["wf_increment"]),
                )
                if not found.get(name) or found[name][-1][1:] != timing[1:]:
                    found.setdefault(name, []).append(timing)

    with BoundedFile(path) as file:
        Timed(file).read_metadata()
    return {name: every for name, every in found.items() if all(t.increment > 0.0 for t in every)}


def _start_in_ns(start: Any) -> int:
    """Start of a channel in ns since 1970."""
    if start is None:
        return 0
    moment = start.as_datetime64("ns") if hasattr(start, "as_datetime64") else start
    return int(np.datetime64(moment, "ns").astype(np.int64))


def _sample_stamps(timings: list[_Timing], count: int) -> Ints:
    """Stamps of the samples of a channel [ns]."""
    stamps = np.empty(count, np.int64)
    ends = [*(one.first for one in timings[1:]), count]
    for one, end in zip(timings, ends, strict=True):
        number = np.arange(max(0, end - one.first))
        stamps[one.first : end] = one.start + np.rint(1e9 * one.increment * number).astype(np.int64)
    return stamps
