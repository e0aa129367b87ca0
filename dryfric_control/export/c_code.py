"""C99 source, header, numbers and README of an exported object."""

from __future__ import annotations

import math
import os
import textwrap
from collections.abc import Iterator
from contextlib import ExitStack
from fractions import Fraction
from functools import cached_property
from importlib import resources
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import jinja2
import numpy as np

from dryfric_control._version import __version__
from dryfric_control.checks import one_of
from dryfric_control.compiled import axis_step
from dryfric_control.export.objects import (
    ROOM,
    Exported,
    Signal,
    export_object,
)
from dryfric_control.export.translate import (
    MOST_PASSES,
    SHIFT,
    Function,
    Translator,
)
from dryfric_control.store.files import existing_folder, name_disk_errors, replace_file
from dryfric_control.store.saved import write_document
from dryfric_control.text import WIDTH

#: Types of a number, and of a position that goes in or comes out.
PRECISIONS = {
    "double": ("double",) * 2,
    "single": ("float",) * 2,
    "mixed": ("float", "double"),
}
#: Samples after which single precision looks whether the origin of the positions is still near.
_LOOKS = 64
#: The time at rest that grew by one sample, in several steps, is off by less than this share.
_ROUNDED = 1e-5
#: Operations that are counted.
_OPERATIONS = {
    "add": "additions and subtractions",
    "multiply": "multiplications",
    "divide": "divisions",
    "compare": "comparisons",
    "function": "functions of math.h",
    "call": "calls before inlining",
}


def export_c(
    obj: Any,
    folder: str | os.PathLike[str],
    precision: str = "double",
    *,
    name: str | None = None,
    dt: float | None = None,
) -> list[Path]:
    """Write an axis, an observer or a compensation as C99.

    Parameters
    ----------
    obj : FrictionAxis, ObserverDesign, HybridFilter or Compensation
        What to export.
    folder : str or path
        Where to write; created if it does not exist.  One folder per object.
    precision : {"double", "single", "mixed"}, optional
        Type of the numbers: `double`; `float`; `float` and `double` for positions outside.
    name : str, optional
        Prefix of every C name and of the files.  Default: the name of the axis, blanks and
        the like as ``_``, followed by ``_observer``, ``_filter`` or ``_compensation``.
    dt : float, optional
        Sampling time of an axis [s].  Default: 1 ms.  The others have their own.

    Returns
    -------
    list of Path
        Header, source, numbers (JSON) and README.

    Notes
    -----
    The C code is translated from the Python source of the compiled kernels, with the same
    operations in the same order.  Nothing is allocated, no variable is global, no function calls
    itself, and every loop is bounded.  The switched observer decides by ``switching="reading"``,
    see `pi_observer`.  In single precision tolerances are 1e-4 in place of 3e-9.  A drive late by
    more than 4096 samples, or an effect of yours whose law has no C, is refused.

    Examples
    --------
    >>> import tempfile
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0, name="slide")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     files = dfc.export_c(axis, folder)
    >>> [file.name for file in files]
    ['slide.h', 'slide.c', 'slide.json', 'README.md']
    """
    one_of("precision", precision, PRECISIONS)
    made = export_object(obj, name, dt)
    code = Code(made, precision)
    where = existing_folder(folder)
    words = code.readme_text()
    about = where / "README.md"
    if about.is_file() and about.read_bytes().split(b"\n")[0] != words.split("\n")[0].encode():
        about = where / f"README_{made.name}.md"  # that of another object stays
    texts = {
        where / f"{made.name}.h": code.header,
        where / f"{made.name}.c": code.source,
        where / f"{made.name}.json": None,
        about: words,
    }
    for path in texts:
        if path.is_dir():
            raise ValueError(f"{str(path)!r} is a folder, and a file of that name is written")
    with name_disk_errors(f"folder {str(folder)!r}"), ExitStack() as stack:
        for path, text in texts.items():
            part = stack.enter_context(replace_file(path))
            if text is None:
                write_document(part, "export", code.numbers())
            else:
                part.write_text(text, encoding="utf-8")
    return list(texts)


def source_text(name: str) -> str:
    """Text of a file in the folder `sources`."""
    return resources.files(__package__).joinpath("sources", name).read_text(encoding="utf-8")


def _comment(text: str) -> str:
    """Text as a C comment."""
    safe = text.replace("*/", "* /").replace("/*", "/ *").splitlines()
    lines = [line for row in safe for line in (textwrap.wrap(row, WIDTH) or [""])]
    return "/*\n" + "\n".join(f" * {line}".rstrip() for line in lines) + "\n */"


class Code:
    """Texts of one exported object in one of `PRECISIONS`."""

    def __init__(self, made: Exported, precision: str = "double") -> None:
        self.made = made
        self.precision = precision
        self.real, self.place = PRECISIONS[precision]
        self.single = self.real == "float"
        self.out: Translator
        self.step: Function
        self.look: Function | None
        self.out, self.step, self.look = made.translation(self.single)
        self.functions = self.out.text().rstrip("\n")
        self.starts = tuple(signal for signal, _ in made.starts)
        self.inputs = [self._input(signal) for signal in made.inputs]
        #: Entries of `SHIFT`: "t" or "x", and their C.
        self.shifts = [(what, self._shift(what, period)) for what, period in self.out.shifts]
        #: Whether a law knows the time in single precision.
        self.timed = any(what == "t" for what, _ in self.shifts)
        #: Whether the time at rest is summed up with what rounding takes off.
        self.rests = self.single and self.out.rests
        # Constant arrays are no arguments: the C knows them by name.
        constant = 1 if len(self.step.used) == 4 + len(self.inputs) else len(made.tables)
        self.fixed = [""] * constant

    def render(self, template: str, **values: Any) -> str:
        """A file of the folder `sources`, filled in."""
        environment = jinja2.Environment(
            undefined=jinja2.StrictUndefined,
            trim_blocks=True,
            lstrip_blocks=True,
            keep_trailing_newline=True,
        )
        environment.filters.update(
            number=self.out.number,
            quoted=quoteattr,
            wrap=textwrap.fill,
            comment=_comment,
        )
        given = {
            "code": self,
            "made": self.made,
            "n": self.made.name,
            "room": ROOM,
        }
        return environment.from_string(source_text(template)).render(given | values)

    @cached_property
    def header(self) -> str:
        """Types and functions, with units, ranges and the certificate."""
        axis = self.made.axis.effective()
        low, high = axis.travel or (-math.inf, math.inf)
        middle = 0.5 * (max(low, -1e9) + min(high, 1e9))
        level = max(float(axis.coulomb(middle, s)) for s in (1, -1))
        ranges = {
            "low": low,
            "high": high,
            "level": level,
            "units": axis.units,
        }
        return self.render("object.h.jinja", version=__version__, **ranges)

    @cached_property
    def source(self) -> str:
        """All code and constants."""
        return self.render("object.c.jinja", shift=SHIFT, looks=_LOOKS, rounded=_ROUNDED)

    def readme_text(self) -> str:
        """How to compile and call it, what a sample costs, what it takes of memory."""
        given = {
            "version": __version__,
            "passes": MOST_PASSES,
            "operations": _OPERATIONS,
        }
        return self.render("README.md.jinja", **given)

    def type(self, signal: Signal) -> str:
        """Type of a signal at the interface."""
        if signal.whole:
            return "int32_t"
        return self.place if self._needs_cast(signal) else f"{self.made.name}_real"

    def _needs_cast(self, signal: Signal) -> bool:
        return signal.place and self.place != self.real

    def parameter_list(self, signals: tuple[Signal, ...]) -> str:
        """Parameters of a function, behind others."""
        return "".join(f", {self.type(s)} {s.name}" for s in signals)

    def cast(self, signal: Signal, text: str) -> str:
        """A signal of the interface as a number of the kernels."""
        return f"(real){text}" if self._needs_cast(signal) else text

    def _input(self, signal: Signal) -> str:
        """An input as the kernel takes it."""
        if not (signal.place and self.single):
            return signal.name
        inner = f"{signal.name} - state->origin"
        return f"(real)({inner})" if self._needs_cast(signal) else inner

    def output(self, signal: Signal, text: str) -> str:
        """An output as the interface returns it."""
        if signal.place and self.single:
            return f"state->origin + {f'({self.place})' if self._needs_cast(signal) else ''}{text}"
        return f"(int32_t){text}" if signal.whole else text

    @property
    def origin_position(self) -> str:
        """Position that the origin follows in single precision."""
        read = [c for s, c in zip(self.made.inputs, self.inputs, strict=True) if s.place]
        return read[-1] if read else f"state->memory[{self.made.places[0][0]}]"

    @property
    def time(self) -> str:
        """Time of a sample."""
        if self.single:
            return self.out.number(0.0)
        return f"(real)state->samples * {self.out.number(self.made.dt)}"

    def call_text(self, function: Function, arguments: list[str]) -> str:
        """Call of a kernel, of its arguments those that it takes."""
        given = [a for a, used in zip(arguments, function.used, strict=True) if used]
        if function.shifted:
            given.insert(0, "state->shift" if function is self.step else SHIFT)
        return f"{function.name}({', '.join(given)})"

    def tables(self) -> Iterator[tuple[str, str, list[str]]]:
        """Name, type and numbers of the constant arrays that the functions read."""
        for name, array in self.made.tables.items():
            if f"dfc_{name}" in self.functions or (self.made.moves and name == "numbers"):
                whole = array.dtype.kind == "i"
                kind, text = ("int32_t", str) if whole else ("real", self.out.number)
                yield (
                    name,
                    kind,
                    [text(v) for v in array.ravel().tolist()],
                )

    @property
    def state_size(self) -> int:
        """Bytes of the state."""
        size = 4 if self.single else 8
        state = size * self.made.memory.size
        state += -state % 8 + 8
        if self.single:
            state += 12 if self.place == "float" else 16
        state += size * (self.rests + len(self.shifts))
        if self.made.moves:
            state += size * 3 * ROOM + 16
        return state + -state % 8

    @property
    def constants_size(self) -> int:
        """Bytes of the constant arrays."""
        sizes = {"real": 4 if self.single else 8, "int32_t": 4}
        return sum(len(values) * sizes[kind] for _, kind, values in self.tables())

    def _shift(self, variable: str, period: float) -> str:
        """Time or origin, less whole periods: the part as a fraction of 2^64."""
        count = "samples" if variable == "t" else "(uint64_t)state->steps"
        step = self.made.dt if variable == "t" else self.made.grid
        if math.isfinite(period):
            share = round(Fraction(step) / Fraction(period) * 2**64) % 2**64
            unit = self.out.number(period / 2**32)
            return f"(real)(uint32_t)(({count} * {share}u) >> 32) * {unit}"
        if variable == "x":
            return "(real)state->origin"
        high = f"(real)(uint32_t)({count} >> 32)"
        low = f"(real)(uint32_t){count}"
        return f"{high} * {self.out.number(step * 2**32)} + {low} * {self.out.number(step)}"

    def numbers(self) -> dict[str, Any]:
        """All numbers, for the JSON file."""

        def json_list(array: Any) -> Any:
            values = np.asarray(array).ravel().tolist()
            return [v if math.isfinite(v) else str(v) for v in values]

        made = self.made
        signals = {
            which: [{"name": s.name, "unit": s.unit, "meaning": s.meaning} for s in group]
            for which, group in (
                ("inputs", made.inputs),
                ("outputs", made.outputs),
            )
        }
        tables = {}
        for name, array in made.tables.items():
            kept = array
            if name.endswith("integers"):
                # Addresses are those of this process alone.
                kept = array[: axis_step.LAWS].copy()
                kept[[axis_step.RIGID_TASK, axis_step.TASK]] = 0
            tables[name] = {
                "shape": list(array.shape),
                "values": json_list(kept),
            }
        return {
            "name": made.name,
            "kind": made.kind,
            "precision": self.precision,
            "dt": made.dt,
            "units": list(made.axis.units),
            **signals,
            "starts": [s.name for s, _ in made.starts],
            "memory": json_list(made.memory),
            "tables": tables,
            "operations": {group: self.step.cost[group] for group in _OPERATIONS},
        }
