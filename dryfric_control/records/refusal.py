"""The error for data that cannot be used as they are, with the arguments that mend it."""

from __future__ import annotations

from typing import Any


class RefusalError(ValueError):
    """Data that are refused, and the arguments of `read_record` with which they are read.

    An argument whose value only the user knows is ``...``.

    Attributes
    ----------
    mend : dict
        Arguments that mend it.
    reasons : str
        The message without the line that reads the data.
    arguments : dict
        All arguments of that line; none where there is no line.
    """

    def __init__(self, message: str, **mend: Any) -> None:
        super().__init__(message)
        self.mend = mend
        self.reasons = message
        self.arguments: dict[str, Any] = {}

    def with_line(self, line: str, arguments: dict[str, Any]) -> RefusalError:
        """The same with the line that reads the data, and its arguments."""
        found = RefusalError(line, **self.mend)
        found.reasons = self.reasons
        found.arguments = arguments
        return found
