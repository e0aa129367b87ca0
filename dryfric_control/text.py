"""Words for the user: results as text, HTML and plain data, the word that was meant."""

from __future__ import annotations

import dataclasses
import difflib
import functools
import html
import inspect
import math
import os
import re
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, ClassVar

import numpy as np

# Raised signs of exponents.
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")

# Where the documentation is published.
_SITE = "https://dryfric-control.github.io/dryfric-control"

#: Longest line [characters].
WIDTH = 100


def wrap_lines(lines: Iterable[str]) -> str:
    """Lines of at most 100 characters; what is left of a longer one stands under its own indent."""
    found = []
    for line in lines:
        indent = " " * (len(line) - len(line.lstrip()) + 4)
        parts = textwrap.wrap(
            line, WIDTH, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False
        )
        found += parts if len(line) > WIDTH else [line]
    return "\n".join(found)


def page_reference(page: str) -> str:
    """Where a message is explained: the address of a page of the documentation."""
    return f" ({_SITE}/{page}.html)"


def did_you_mean(word: str, choices: Iterable[str]) -> str:
    """Question that names the nearest choice; nothing where none is near."""
    lowered = {c.lower(): c for c in choices}
    close = difflib.get_close_matches(word.lower(), lowered, n=1, cutoff=0.5)
    return f". Did you mean {lowered[close[0]]!r}?" if close else ""


def percent(share: float, sign: str = "") -> str:
    """A share in per cent, two digits below ten; `sign` "+" states that of a gain too."""
    value = 100.0 * share
    return f"{value:{sign}.0f} %" if abs(value) >= 10.0 else f"{value:{sign}.2g} %"


def percent_of_drive(force: float, drive: float) -> str:
    """A force in per cent of the drive; in words where there is none."""
    return f"{percent(force / drive)} of the drive" if drive > 0.0 else "with no drive"


# Units that take a prefix, alone or at the head of a product.
_WITH_PREFIX = ("m", "rad", "deg", "N", "s", "A", "V", "W", "J", "Hz")


def length_text(value: float, unit: str) -> str:
    """A small length with a readable prefix."""
    if abs(value) < 1e-13:  # round-off: no prefix makes it readable
        return f"{value:.0e} {unit}" if value else f"0 {unit}"
    factor, unit = prefix_unit(value, unit)
    return f"{value / factor:.3g} {unit}"


def prefix_unit(value: float, unit: str) -> tuple[float, str]:
    """Factor and name of the unit with the prefix, if it takes one, that makes a value readable."""
    if unit.partition(" ")[0].partition("/")[0] not in _WITH_PREFIX:
        return 1.0, unit
    for factor, prefix in ((1.0, ""), (1e-3, "m"), (1e-6, "u")):
        if abs(value) >= 0.1 * factor:
            return factor, f"{prefix}{unit}"
    return 1e-9, f"n{unit}"


def typeset_signs(text: str) -> str:
    """Plain text with the signs that print has for it."""
    text = re.sub(r"\b(N m|N|kg) (?=[ms]\b)", lambda m: m[0].replace(" ", "\xb7"), text)
    text = re.sub(r"(?<=[\d\[]) ?u(m|rad)\b", lambda m: m[0].replace("u", "\xb5"), text)
    text = re.sub(r"\)e([+-]\d+)", lambda m: f")\xb710{str(int(m[1])).translate(_RAISED)}", text)
    for plain, sign in (("+-", "\xb1"), ("->", "\u2192"), ("^2", "\xb2"), ("^3", "\xb3")):
        text = text.replace(plain, sign)
    return text


# Words of a linear axis that have another one on a rotary axis, but where they are names of
# arguments: in quotes, behind a dot, before an equals sign.
_LINEAR = re.compile(r"(?<![\w.\"'`])(force|mass)(e?s)?(?![\w\"'`]| ?=)", re.IGNORECASE)
_ROTARY = {"force": "torque", "mass": "inertia"}
_TURNING = re.compile(r"\bN[ \xb7]m\b(?![\^\xb2])|\bkg[ \xb7]m[\^\xb2]")


def rotary_words(text: str, unit: str) -> str:
    """Text in the words of a rotary axis where a unit, or a label with it, has N m."""
    if not _TURNING.search(unit):
        return text

    def replace_word(found: re.Match[str]) -> str:
        word = _ROTARY[found[1].lower()]
        return (word.capitalize() if found[1][0].isupper() else word) + "s" * bool(found[2])

    return _LINEAR.sub(replace_word, text)


def table(rows: Sequence[Sequence[str]], as_html: bool = False) -> str:
    """Rows, the headings first, as columns of text, or escaped and typeset as HTML."""
    if not as_html:
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        return "\n".join("  ".join(map(str.ljust, row, widths)).rstrip() for row in rows)
    cells = [[html.escape(typeset_signs(cell)) for cell in row] for row in rows]
    head = "".join(f'<th scope="col">{cell}</th>' for cell in cells[0])
    body = "".join("<tr><td>" + "</td><td>".join(row) + "</td></tr>" for row in cells[1:])
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def plain_data(value: Any) -> Any:
    """A value as JSON has it: lists for arrays, None for what is not finite."""
    if isinstance(value, (float, np.floating)):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, (np.ndarray, np.generic)):
        return plain_data(value.tolist())
    if isinstance(value, Mapping):
        return {key: plain_data(one) for key, one in value.items()}
    if hasattr(value, "to_dict"):
        return value.to_dict()
    if hasattr(value, "_asdict"):  # a named tuple
        return plain_data(value._asdict())
    if isinstance(value, (list, tuple)):
        return [plain_data(one) for one in value]
    if dataclasses.is_dataclass(value):
        return fields_of(value)
    return str(value) if isinstance(value, os.PathLike) else value


class Result:
    """A result that shows itself: as text, as HTML in a notebook, as plain data."""

    #: What `to_dict` gives; all public fields where none is named.
    _told: ClassVar[tuple[str, ...]] = ()

    def _summary_parts(self) -> Iterable[str | Sequence[Sequence[str]]]:
        """Lines of text, and tables as sequences of rows, the headings first."""
        raise NotImplementedError

    def _parts_in_axis_words(self) -> Iterable[str | Sequence[Sequence[str]]]:
        """The same in the words of the axis that it is of."""
        units = getattr(getattr(self, "axis", self), "units", None)
        force = units[1] if isinstance(units, tuple) else ""
        for one in self._summary_parts():
            if isinstance(one, str):
                yield rotary_words(one, force)
            else:
                yield [[rotary_words(cell, force) for cell in row] for row in one]

    def summary(self) -> str:
        """What there is to see, in plain lines."""
        return "\n".join(
            wrap_lines([one]) if isinstance(one, str) else table(one)
            for one in self._parts_in_axis_words()
        )

    def __repr__(self) -> str:
        return Result.summary(self)

    def _repr_html_(self) -> str:
        return "".join(
            f"<p>{html.escape(typeset_signs(one))}</p>"
            if isinstance(one, str)
            else table(one, True)
            for one in self._parts_in_axis_words()
        )

    def to_dict(self) -> dict[str, Any]:
        """Numbers and words, ready for JSON."""
        return {name: plain_data(getattr(self, name)) for name in self._told} or fields_of(self)


def stated(words: str, default: Any = dataclasses.MISSING, **options: Any) -> Any:
    """Field of a dataclass that says what it is, for `documented`."""
    return dataclasses.field(default=default, metadata={"doc": words}, **options)


def documented(cls: type[Any], section: str = "Attributes") -> type[Any]:
    """Put what the fields of a dataclass say of themselves into its docstring."""
    rows = []
    for one in (one for one in dataclasses.fields(cls) if not one.name.startswith("_")):
        kind = re.sub(r"\b(Floats|Ints|Bools)\b", "ndarray", str(one.type))
        rows.append(f"{one.name} : {kind}\n    {one.metadata['doc']}")
    list_in_docstring(cls, section, rows)
    return cls


#: The same of a class that users make: its fields are its parameters.
with_parameters = functools.partial(documented, section="Parameters")


def list_in_docstring(cls: type[Any], section: str, rows: Iterable[str]) -> None:
    """Put a section with these entries before the notes or examples of a docstring without it."""
    text = inspect.cleandoc(cls.__doc__ or "")
    begin = re.search(r"^(Notes|References|Examples)\n-+$", text, re.MULTILINE)
    if begin and f"\n{section}\n" not in text:
        own = "\n".join([section, "-" * len(section), *rows])
        cls.__doc__ = f"{text[: begin.start()]}{own}\n\n{text[begin.start() :]}"


def fields_of(result: Any) -> dict[str, Any]:
    """Public fields of a dataclass as plain data."""
    return {
        one.name: plain_data(getattr(result, one.name))
        for one in dataclasses.fields(result)
        if not one.name.startswith("_")
    }
