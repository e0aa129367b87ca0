"""Lines of text that fit a page."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable

#: Longest line [characters].
WIDTH = 100


def wrapped(lines: Iterable[str], indent: int = 4) -> str:
    """Lines of at most 100 characters, shorter ones as they are.

    Parameters
    ----------
    lines : iterable of str
        The lines.
    indent : int, optional
        Blanks before what is left of a line that was too long.

    Returns
    -------
    str

    Examples
    --------
    >>> from dryfric_control.text import wrapped
    >>> [len(line) for line in wrapped(["a  table", "many words " * 12]).splitlines()]
    [8, 98, 36]
    """
    return "\n".join(
        textwrap.fill(
            line, WIDTH, subsequent_indent=" " * indent, break_long_words=False,
            break_on_hyphens=False,
        )
        if len(line) > WIDTH
        else line
        for line in lines
    )  # fmt: skip
