"""Words for the user: lines that fit a page, the word that was meant."""

from __future__ import annotations

import difflib
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


def did_you_mean(word: str, choices: Iterable[str]) -> str:
    """Question that names the nearest choice; nothing where none is near.

    Parameters
    ----------
    word : str
        What was asked for.
    choices : iterable of str
        What there is.

    Returns
    -------
    str

    Examples
    --------
    >>> from dryfric_control.text import did_you_mean
    >>> did_you_mean("posiiton", ["time", "Position"])
    ". Did you mean 'Position'?"
    """
    lowered = {c.lower(): c for c in choices}
    close = difflib.get_close_matches(word.lower(), lowered, n=1, cutoff=0.5)
    return f". Did you mean {lowered[close[0]]!r}?" if close else ""


def length_text(value: float, unit: str) -> str:
    """A small length with a readable prefix."""
    for factor, prefix in ((1.0, ""), (1e-3, "m"), (1e-6, "u")):
        if abs(value) >= 0.1 * factor:
            return f"{value / factor:.3g} {prefix}{unit}"
    if abs(value) < 1e-13:  # round-off: no prefix makes it readable
        return f"{value:.0e} {unit}" if value else f"0 {unit}"
    return f"{value / 1e-9:.3g} n{unit}"
