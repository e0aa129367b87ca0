"""Files whose channels have clocks of their own: what all readers of them share."""

from __future__ import annotations

import importlib
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np

from dryfric_control.records.readers.channels import Wanted
from dryfric_control.records.readers.limits import refused_if_damaged, too_long
from dryfric_control.records.readers.tables import numbers


class Channel(NamedTuple):
    """One signal of a log, read at its own moments."""

    values: Any  # shape (n,)
    stamps: Any  # shape (n,), in `unit`: whole ns, or float64
    unit: str = "ns"
    sent: Any = None  # stamps of the sender in ns where it states them, beside those of arrival


class LogFile(Mapping[str, Channel], ABC):
    """Base of the readers of files whose channels have clocks of their own.

    A reader is a mapping from headings to channels, read when they are asked for.  It converts
    nothing, chooses nothing and judges nothing: `assign_columns` finds the drive and the position
    by their headings, `on_position_clock` brings them together, `Record` judges the data.

    To read another format:

    1. Take the library that the field keeps for it; make it an extra in ``pyproject.toml``, add it
       to the extras ``logs`` and ``test``, and to the modules that mypy does not follow. A format
       that numpy alone reads needs none: `modules` is then empty, `extra` ``""``.
    2. Derive a class in a file of its own. Set `kind` (what a message calls the file), `extra` and
       `modules` (those to import, when a file is read and not before: an import of the package
       loads none of them). `_open` gets them in this order.
    3. `_open` opens the file and returns the headings: the names that the library gives, joined by
       "." or "/", with the unit in brackets where the file states one. Of equal names each gets
       what tells it apart in front.
    4. `_read_channel` returns one channel on its own clock, as it is stored: not resampled, not
       interpolated, integers as integers. Stamps are whole ns where the file has whole ones.
    5. Whatever the library raises on a damaged file becomes one error; a `ValueError` of your own
       goes through with its words. Refuse what the library would get wrong in silence, and say how
       to export it instead.
    6. `hint` is appended to the error where no column is recognised: what the file has in a form
       that cannot be read.
    7. Add a row to the table of extensions in ``sources.py``, a line to ``docs/howto/read_csv.md``
       and to the docstring of `read_record`, a file in two layouts to ``tests/log_files.py``, made
       by the library where it can write, their names to `FILES`, `DAMAGED` and `EXTRAS` of
       ``tests/records/test_log_files.py``, and their makers to `log_contents` and `LOGS` of
       ``tests/damage.py``.
    """

    kind: ClassVar[str]
    extra: ClassVar[str] = ""
    modules: ClassVar[tuple[str, ...]] = ()

    def __init__(self, path: Path, wanted: Wanted) -> None:
        self.path = path
        self.wanted = wanted
        self.hint = ""
        libraries = [import_optional(module, self.extra, path) for module in self.modules]
        with refused_if_damaged(path, self.kind):
            self.headings = self._open(*libraries)
        if not self.headings:
            raise ValueError(f"{path.name} holds no channel with numbers")

    @abstractmethod
    def _open(self, *libraries: Any) -> list[str]:
        """Open the file; the headings of its channels."""

    @abstractmethod
    def _read_channel(self, heading: str) -> Channel:
        """One channel on its own clock."""

    def __getitem__(self, heading: str) -> Channel:
        with refused_if_damaged(self.path, self.kind):
            channel = self._read_channel(heading)
        if len(channel.values) > self.wanted.max_rows:
            raise ValueError(too_long(self.path.name, self.wanted.max_rows))
        return channel

    def __iter__(self) -> Iterator[str]:
        return iter(self.headings)

    def __len__(self) -> int:
        return len(self.headings)

    def close(self) -> None:
        """Let go of the file."""


class MessageLog(LogFile):
    """Base of the readers of logs of messages: each number of a message is a channel.

    Rules 1, 2, 5 and 7 of `LogFile` hold; in place of the others, `_messages` yields topic, time of
    arrival [ns] and content: a mapping, or an object with fields. Numbers are found by the path
    that leads to them, those of an array by the names beside it, such as ``position.elbow``. A
    message with a stamp in its header counts as taken then.
    """

    @abstractmethod
    def _messages(self, *libraries: Any) -> Iterator[tuple[str, int, Any]]:
        """Topic, time of arrival and content of every message."""

    def _open(self, *libraries: Any) -> list[str]:
        self._rows: dict[tuple[str, str], list[tuple[int, int, float]]] = {}
        empty: set[str] = set()
        count = 0
        for topic, arrival, content in self._messages(*libraries):
            fields = dict(numbers("", content, 0, empty))
            stamp = _stamp(fields)
            for key, value in fields.items():
                self._rows.setdefault((topic, key), []).append((stamp, arrival, value))
            count += bool(fields)
            if count > self.wanted.max_rows:
                raise ValueError(too_long(self.path.name, self.wanted.max_rows))
        alone = len({topic for topic, _ in self._rows}) == 1
        self._place = {
            key if alone else f"{topic}.{key}": (topic, key) for topic, key in self._rows
        }
        if empty:
            self.hint = f"; without values in this log: {', '.join(sorted(empty)[:10])}"
        return list(self._place)

    def _read_channel(self, heading: str) -> Channel:
        sent, arrivals, values = zip(*self._rows[self._place[heading]], strict=True)
        own = np.array(sent, np.int64) if all(sent) else None
        return Channel(np.array(values), np.array(arrivals, np.int64), sent=own)


def _stamp(fields: dict[str, float]) -> int:
    """Stamp in the header of a message in ns, taken out of its fields; 0 if there is none."""
    parts = [fields.pop(f"header.stamp.{part}", 0.0) for part in ("sec", "nanosec")]
    return 1_000_000_000 * int(parts[0]) + int(parts[1])


def import_optional(module: str, extra: str, path: Path) -> Any:
    """A library that an extra installs, or an error with the line to type."""
    try:
        return importlib.import_module(module)
    except ImportError:
        raise ImportError(
            f"{path.name}: reading {path.suffix} needs {module.partition('.')[0]}: "
            f'pip install "dryfric-control[{extra}]"'
        ) from None
