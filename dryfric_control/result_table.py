"""Fitted numbers as a table for a paper (LaTeX), a spreadsheet (CSV) or a page (Markdown)."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Sequence
from typing import NamedTuple

from dryfric_control.checks import one_of
from dryfric_control.text import typeset_signs

FORMS = ("latex", "csv", "markdown")

# Powers of ten that are written out; beyond them a number has an exponent.
_SMALLEST = -3
_LARGEST = 5
# Digits of a number without an error.
_DIGITS = 4

# Macros of the LaTeX package siunitx.
_SIUNITX = {
    "N": r"\newton",
    "m": r"\metre",
    "rad": r"\radian",
    "s": r"\second",
    "kg": r"\kilogram",
    "Hz": r"\hertz",
    "V": r"\volt",
    "A": r"\ampere",
    "Pa": r"\pascal",
    "%": r"\percent",
}
_POWERS = {"": "", "2": r"\squared", "3": r"\cubed"}
_ESCAPED = {"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}"}
_ESCAPED |= {sign: f"\\{sign}" for sign in "&%$#_{}"}


class Quantity(NamedTuple):
    """A number with its standard error, None where it has none, infinite where undetermined."""

    value: float
    error: float | None = None
    unit: str = "1"


#: What stands in a cell.
Cell = str | Quantity


def format_table(headings: Sequence[str], rows: Sequence[Sequence[Cell]], form: str) -> str:
    """A table as text of one of `FORMS`; each row has a cell for each heading."""
    one_of("form", form, FORMS)
    if form == "csv":
        return _csv(headings, rows)
    if form == "latex":
        return _latex_table(headings, rows)
    lines = [
        headings,
        ["---"] * len(headings),
        *([_plain_cell(cell) for cell in row] for row in rows),
    ]
    return "\n".join(f"| {' | '.join(cell.replace('|', '/') for cell in line)} |" for line in lines)


def round_to_error(value: float, error: float | None) -> tuple[str, str, int]:
    """Value, its error in units of the last digit ("" for none), and a power of ten."""
    if error is None or not 0.0 < error < math.inf or not math.isfinite(value):
        mantissa, _, power = f"{value:.{_DIGITS - 1}e}".partition("e")
        exponent = int(power or 0)
        if _SMALLEST <= exponent < _LARGEST:
            return f"{value:.{_DIGITS}g}", "", 0
        return mantissa.rstrip("0").rstrip("."), "", exponent
    exponent = int(f"{max(abs(value), error):.9e}".partition("e")[2])
    if _SMALLEST <= exponent < _LARGEST:
        exponent = 0
    scale = 10.0**exponent
    last = int(f"{error / scale:.1e}".partition("e")[2]) - 1
    digits = max(-last, 0)
    uncertain = round(error / scale, -last) * 10.0**digits
    return f"{round(value / scale, -last):.{digits}f}", f"{uncertain:.0f}", exponent


def _plain_cell(cell: Cell) -> str:
    if isinstance(cell, str):
        return cell
    text, uncertain, power = round_to_error(cell.value, cell.error)
    unit = "" if cell.unit == "1" else f" {cell.unit}"
    if uncertain:
        digits = len(text.partition(".")[2])
        text = f"{text} +- {int(uncertain) / 10**digits:.{digits}f}"
    if power:
        text = f"({text})e{power:+03d}" if uncertain else f"{text}e{power:+03d}"
    left = "" if cell.error is None or cell.error < math.inf else " (undetermined)"
    return typeset_signs(f"{text}{unit}{left}")


def _latex_table(headings: Sequence[str], rows: Sequence[Sequence[Cell]]) -> str:
    body = [" & ".join(map(_latex_cell, row)) + r" \\" for row in rows]
    head = " & ".join(map(_escape_latex, headings)) + r" \\"
    parts = [r"\toprule", head, r"\midrule", *body, r"\bottomrule"]
    columns = "l" * len(headings)
    begin = r"% \usepackage{booktabs, siunitx}", rf"\begin{{tabular}}{{{columns}}}"
    return "\n".join([*begin, *parts, r"\end{tabular}"])


def _latex_cell(cell: Cell) -> str:
    if isinstance(cell, str):
        return _escape_latex(cell)
    text, uncertain, power = round_to_error(cell.value, cell.error)
    number = f"{text}{uncertain and f'({uncertain})'}{(power and f'e{power}') or ''}"
    left = "" if cell.error is None or cell.error < math.inf else " (undetermined)"
    if cell.unit == "1":
        return rf"\num{{{number}}}{left}"
    return rf"\qty{{{number}}}{{{siunitx_unit(cell.unit)}}}{left}"


def siunitx_unit(unit: str) -> str:
    r"""A unit such as "N s/m" in the macros of siunitx, ``\newton\second\per\metre``."""
    top, _, below = unit.replace("(", "").replace(")", "").partition("/")
    found = []
    for side, before in ((top, ""), (below, r"\per")):
        for factor in side.split():
            name, _, power = factor.partition("^")
            if name == "1":
                continue
            if name not in _SIUNITX or power not in _POWERS:
                return _escape_latex(unit)
            found.append(f"{before}{_SIUNITX[name]}{_POWERS[power]}")
    return "".join(found)


def _escape_latex(text: str) -> str:
    return re.sub(r"[\\~^&%$#_{}]", lambda sign: _ESCAPED[sign[0]], text)


def _csv(headings: Sequence[str], rows: Sequence[Sequence[Cell]]) -> str:
    """Numbers in full, with columns for their standard errors and units where there are any."""
    columns: list[list[object]] = []
    for heading, *cells in zip(headings, *rows, strict=True):
        numbers = [cell if isinstance(cell, Quantity) else None for cell in cells]
        texts = [
            cell if one is None else one.value for cell, one in zip(cells, numbers, strict=True)
        ]
        columns.append([heading, *texts])
        if any(one is not None and one.error is not None for one in numbers):
            errors = ["" if one is None or one.error is None else one.error for one in numbers]
            columns.append([f"{heading} std. error", *errors])
            units = ["" if one is None else one.unit for one in numbers]
            columns.append([f"{heading} unit", *units])
    out = io.StringIO()
    csv.writer(out, lineterminator="\n").writerows(zip(*columns, strict=True))
    return out.getvalue()
