"""The error for data that cannot be used as they are, with the arguments that mend it."""

from __future__ import annotations

from typing import Any


class RefusalError(ValueError):
    """Data that are refused, and the arguments of `read_record` with which they are read.

    An argument whose value only the user knows is ``...``.
    """

    def __init__(self, message: str, **mend: Any) -> None:
        super().__init__(message)
        self.mend = mend
