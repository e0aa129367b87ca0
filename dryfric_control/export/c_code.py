"""C99 source, header, numbers and README of an exported object."""

from __future__ import annotations

import math
import os
import textwrap
from contextlib import ExitStack
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from dryfric_control._version import __version__
from dryfric_control.compiled import axis_step
from dryfric_control.export.objects import ROOM, Exported, Signal, exported
from dryfric_control.export.translate import MOST_PASSES, SHIFT, Function, Translator
from dryfric_control.store.files import replacing
from dryfric_control.store.saved import write_document
from dryfric_control.text import WIDTH

#: Types of a number, and of a position that goes in or comes out.
PRECISIONS = {
    "double": ("double", "double"),
    "single": ("float", "float"),
    "mixed": ("float", "double"),
}
#: Samples after which single precision looks whether the origin of the positions is still near.
_LOOKS = 64
#: The time at rest that grew by one sample, in several steps, is off by less than this share.
_ROUNDED = 1e-5
_GROUPS = ("add", "multiply", "divide", "compare", "function", "call")


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
        Type of the numbers: `double`; `float`; `float` with positions given and returned as
        `double`.
    name : str, optional
        Prefix of every C name and of the files.  Default: the name of the axis, blanks and
        the like as ``_``, followed by ``_observer``, ``_filter`` or ``_compensation``.
    dt : float, optional
        Sampling time of an axis [s].  Default: 1 ms.  The others have their own.

    Returns
    -------
    list of Path
        Header, source, numbers (JSON) and README.

    Raises
    ------
    ValueError
        If `obj` is none of these, an argument is out of its range, an effect of yours has
        a law without C, the drive is late by more than 4096 samples, or the folder cannot be
        written.  No file is written then.

    Notes
    -----
    The C code is translated from the Python source of the compiled kernels, function by
    function, with the same operations in the same order.  Compiled without contraction of
    products and sums (``-ffp-contract=off``), in double precision, it returns the bits of
    the kernels where both call the same mathematical library.

    The switched observer is exported with ``switching="reading"``, see `pi_observer`.

    The README of another object in the folder stays: then that of this one has its name.

    Nothing is allocated, no variable is global, no function calls itself, and every loop is
    bounded.  Single precision shifts the tolerances of the axis from 3e-9 to 1e-4.

    Samples are counted in 64 bits.  In single precision time and position are counted from an
    origin that follows the axis, and periodic effects know the part of their period exactly: the
    motion is as accurate after days and at many metres as at the start.  Positions themselves
    have the 24 bits of a `float`, 0.2 um at 5 m; take "mixed" where that is too coarse.

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
    if precision not in PRECISIONS:
        words = ", ".join(f'"{name}"' for name in PRECISIONS)
        raise ValueError(f"precision must be one of {words}, got {precision!r}")
    made = exported(obj, name, dt)
    code = Code(made, precision)
    where = existing_folder(folder)
    words, about = code.readme(), where / "README.md"
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
    try:
        with ExitStack() as stack:
            for path, text in texts.items():
                part = stack.enter_context(replacing(path))
                if text is None:
                    write_document(part, "export", code.numbers())
                else:
                    part.write_text(text, encoding="utf-8")
    except OSError as problem:
        raise ValueError(
            f"folder {str(folder)!r} cannot be written ({problem.strerror}): name another"
        ) from None
    return list(texts)


def existing_folder(folder: str | os.PathLike[str]) -> Path:
    """The folder, made if it is not there."""
    try:
        where = Path(folder)
        where.mkdir(parents=True, exist_ok=True)
    except TypeError:
        raise ValueError(f"folder must be a path, got {folder!r}") from None
    except OSError as problem:
        raise ValueError(
            f"folder {str(folder)!r} cannot be made ({problem.strerror}): name another"
        ) from None
    return where


class Code:
    """Texts of one exported object.

    Parameters
    ----------
    made : Exported
        The object.
    precision : str
        One of `PRECISIONS`.
    """

    def __init__(self, made: Exported, precision: str = "double") -> None:
        self.made, self.precision = made, precision
        self.real, self.place = PRECISIONS[precision]
        self.single = self.real == "float"
        self.out: Translator
        self.step: Function
        self.look: Function | None
        self.out, self.step, self.look = made.translated(self.single)
        self.header, self.source = self._header(), self._source()

    @property
    def bytes(self) -> int:
        """Size of a number."""
        return 4 if self.single else 8

    def _header(self) -> str:
        made, n = self.made, self.made.name
        guard = f"{n.upper()}_H"
        fields = "".join(
            f"    {self._type(s)} {s.name}; /* {s.meaning} [{s.unit}] */\n" for s in made.outputs
        )
        switches = ""
        if self.single:
            switches = (
                f"    int64_t steps; /* origin of the positions in the memory, in steps of "
                f"{made.grid:.9g} */\n    {self.place} origin;\n"
            )
        if self.out.shifts:
            size = len(self.out.shifts)
            switches += (
                f"    {n}_real shift[{size}]; /* origin of time and position for the laws */\n"
            )
        if self.rests:
            switches += f"    {n}_real rest; /* what rounding took off the time at rest */\n"
        if made.moves:
            since = " since its start" if self.single else ""
            switches += (
                f"    {n}_real switches[{3 * ROOM}]; /* of the last sample: time{since}, mode "
                "before, mode after */\n"
                "    int32_t count[4]; /* listed, room, not listed, most */\n"
            )
        return f"""{self._comment()}
#ifndef {guard}
#define {guard}

#include <stdbool.h>
#include <stdint.h>

typedef {self.real} {n}_real;

/* State, all of it: copy it to save it. */
typedef struct {{
    {n}_real memory[{made.memory.size}];
    uint64_t samples; /* taken so far */
{switches}}} {n}_state;

/* What one sample returns. */
typedef struct {{
{fields}}} {n}_output;

/* State before the first sample. */
void {n}_init({n}_state *state{self._list(tuple(s for s, _ in made.starts))});

/* One sample; false, and nothing is changed, if an input is no finite number.
{textwrap.indent(textwrap.fill(made.returns, 94), "   ")} */
bool {n}_step({n}_state *state{self._list(made.inputs)}, {n}_output *output);
{self._look_declaration()}
#endif
"""

    def _type(self, signal: Signal) -> str:
        """Type of a signal at the interface."""
        if signal.whole:
            return "int32_t"
        return self.place if self._apart(signal) else f"{self.made.name}_real"

    def _apart(self, signal: Signal) -> bool:
        return signal.place and self.place != self.real

    def _list(self, signals: tuple[Signal, ...]) -> str:
        return "".join(f", {self._type(s)} {s.name}" for s in signals)

    @property
    def rests(self) -> bool:
        """Whether the time at rest is summed up with what rounding takes off."""
        return self.single and self.out.rests

    def _look_declaration(self) -> str:
        if not self.made.moves:
            return ""
        n = self.made.name
        return (
            "\n/* The same sample, but what the axis shows at its end, under the same input. */\n"
            f"bool {n}_next({n}_state *state, {n}_real u, {n}_output *output);\n"
            "\n/* What the axis shows now under an input; nothing moves. */\n"
            f"bool {n}_look(const {n}_state *state, {n}_real u, {n}_output *output);\n"
        )

    @property
    def _numbers(self) -> str:
        apart = f", positions {self.place}" if self.place != self.real else ""
        return f"{self.real}{apart}"

    def _comment(self) -> str:
        """Comment at the head of the header: units, ranges, certificate."""
        made = self.made
        axis = made.axis.effective()
        length, force = axis.units
        low, high = axis.travel or (-math.inf, math.inf)
        rows = [f"{made.name}: {made.kind}, from dryfric-control {__version__}", ""]
        rows += [f"Sampling time {made.dt:.9g} s; numbers are {self._numbers}.", ""]
        rows += ["Inputs, finite numbers:"]
        rows += [f"  {s.name} [{s.unit}]: {s.meaning}" for s in made.inputs]
        rows += ["Outputs:"]
        rows += [f"  {s.name} [{s.unit}]: {s.meaning}" for s in made.outputs]
        rows += ["Ranges:"]
        rows += [f"  position {low:.6g} to {high:.6g} {length} (beyond, the levels of the ends)"]
        middle = 0.5 * (max(low, -1e9) + min(high, 1e9))
        level = max(float(axis.coulomb(middle, s)) for s in (1, -1))
        rows += [f"  Coulomb level {level:.6g} {force} in the middle of it"]
        rows += ["  mode -1, 0 or 1", ""]
        rows += made.promise.splitlines()
        safe = [row.replace("*/", "* /").replace("/*", "/ *") for row in rows]
        lines = [line for row in safe for line in (textwrap.wrap(row, WIDTH) or [""])]
        return "/*\n" + "\n".join(f" * {line}".rstrip() for line in lines) + "\n */"

    def _source(self) -> str:
        made, n = self.made, self.made.name
        functions = self.out.text()
        body = "\n".join(
            part
            for part in (
                f'#include "{n}.h"\n\n#include <math.h>\n#include <stddef.h>\n',
                f"typedef {n}_real real;\n",
                self._tables(functions),
                functions,
                self._near(),
                self._init(),
                self._step(),
                self._look(),
            )
            if part
        )
        return f"/* {made.name}: {made.kind}.  Generated; see {n}.h. */\n{body}"

    def _tables(self, functions: str) -> str:
        """Constant arrays that the functions read."""
        rows = []
        for name, array in self.made.tables.items():
            public = self.made.moves and name == "numbers"
            if f"dfc_{name}" not in functions and not public:
                continue
            whole = array.dtype.kind == "i"
            values = [str(int(v)) if whole else self.out.number(v) for v in array.ravel()]
            kind = "int32_t" if whole else "real"
            inner = textwrap.fill(", ".join(values), 92)
            inner = textwrap.indent(inner, "    ")
            rows.append(f"static const {kind} dfc_{name}[{array.size}] = {{\n{inner}\n}};\n")
        return "\n".join(rows)

    def _init(self) -> str:
        made, n = self.made, self.made.name
        rows = [
            f"    state->memory[{place}] = {f'(real){s.name}' if self._apart(s) else s.name};"
            for s, place in made.starts
        ]
        rows += ["    state->samples = 0;"]
        rows += [
            f"    state->shift[{i}] = {self.out.number(0.0)};" for i in range(len(self.out.shifts))
        ]
        if self.rests:
            rows += [f"    state->rest = {self.out.number(0.0)};"]
        if self.single:
            rows += ["    state->steps = 0;", "    state->origin = 0;"]
        for signal, place in made.starts:
            if signal.place and self.single:
                rows += [
                    f"    dfc_centre(state, state->memory[{place}]);",
                    f"    state->memory[{place}] = (real)({signal.name} - state->origin);",
                ]
        if made.moves:
            rows += [
                f"    for (int32_t i = 0; i < {3 * ROOM}; ++i) {{",
                "        state->switches[i] = " + self.out.number(0.0) + ";",
                "    }",
                "    state->count[0] = 0;",
                f"    state->count[1] = {ROOM};",
                "    state->count[2] = 0;",
                "    state->count[3] = 100000;",
            ]
        given = self._list(tuple(s for s, _ in made.starts))
        return (
            f"void {n}_init({n}_state *state{given})\n{{\n"
            f"    for (int32_t i = 0; i < {made.memory.size}; ++i) {{\n"
            f"        state->memory[i] = {self.out.number(0.0)};\n    }}\n"
            + "\n".join(rows)
            + f"\n{self._parts('x', 'state->shift')}}}\n"
        )

    def _near(self) -> str:
        """Functions that keep time and positions near zero in single precision."""
        if not self.single:
            return ""
        made, n, number = self.made, self.made.name, self.out.number
        rows = [
            f"    state->memory[{place}] -= "
            + (f"moved * {number(1.0 / unit)};" if unit != 1.0 else "moved;")
            for place, unit in made.places
        ]
        text = (
            "/* Moves the origin of the positions to a place. */\n"
            f"static void dfc_centre({n}_state *state, real place)\n{{\n"
            f"    const real far = place * {number(1.0 / made.grid)};\n\n"
            f"    if ((fabsf(far) < {number(1.0)}) || (fabsf(far) > {number(2e9)})) {{\n"
            "        return;\n    }\n"
            "    const int32_t steps = (int32_t)far;\n"
            f"    const real moved = (real)steps * {number(made.grid)};\n"
            "    state->steps += steps;\n"
            f"    state->origin = ({self.place})state->steps * "
            f"{number(made.grid) if self.place == 'float' else repr(made.grid)};\n"
            + "\n".join(rows)
            + f"\n{self._parts('x', 'state->shift')}}}\n"
        )
        if self._timed:
            behind = " - (state->samples != 0u)" if made.clock is not None else ""
            text += (
                "\n/* Time as the laws know it, less whole periods. */\n"
                f"static void dfc_now(const {n}_state *state, real *{SHIFT})\n{{\n"
                f"    const uint64_t samples = state->samples{behind};\n\n"
                + self._parts("t", SHIFT)
                + "}\n"
            )
        return text

    @property
    def _timed(self) -> bool:
        """Whether a law knows the time in single precision."""
        return any(variable == "t" for variable, _ in self.out.shifts)

    def _parts(self, wanted: str, array: str) -> str:
        """Entries of `SHIFT` for time or position."""
        return "".join(
            f"    {array}[{i}] = {self._part(variable, period)};\n"
            for i, (variable, period) in enumerate(self.out.shifts)
            if variable == wanted
        )

    def _part(self, variable: str, period: float) -> str:
        """Time or origin, less whole periods: the part as a fraction of 2^64."""
        count = "samples" if variable == "t" else "(uint64_t)state->steps"
        step = self.made.dt if variable == "t" else self.made.grid
        if math.isfinite(period):
            share = round(Fraction(step) / Fraction(period) * 2**64) % 2**64
            unit = self.out.number(period / 2**32)
            return f"(real)(uint32_t)(({count} * {share}u) >> 32) * {unit}"
        if variable == "x":
            return "(real)state->origin"
        high, low = f"(real)(uint32_t)({count} >> 32)", f"(real)(uint32_t){count}"
        return f"{high} * {self.out.number(step * 2**32)} + {low} * {self.out.number(step)}"

    def _results(self) -> str:
        rows = []
        for i, s in enumerate(self.made.outputs):
            value = f"{'(int32_t)' if s.whole else ''}out[{i}]"
            if s.place and self.single:
                value = f"state->origin + {f'({self.place})' if self._apart(s) else ''}{value}"
            rows.append(f"    output->{s.name} = {value};")
        return "\n".join(rows)

    def _guard(self) -> str:
        names = [f"(real){s.name}" if self._apart(s) else s.name for s in self.made.inputs]
        test = " || ".join(f"!isfinite({name})" for name in names)
        return f"    if ({test}) {{\n        return false;\n    }}\n"

    def _called(self, function: Function, arguments: list[str]) -> str:
        """Call of a kernel, of its arguments those that it takes."""
        given = [a for a, used in zip(arguments, function.used, strict=True) if used]
        if function.shifted:
            given.insert(0, "state->shift" if function is self.step else SHIFT)
        return f"    {function.name}({', '.join(given)});\n"

    def _taken(self, arguments: list[str]) -> str:
        """Call of the kernel of one sample, what it returns, and the count of samples."""
        before, after, state = "", "", "state->memory"
        if self.single:
            read = [self._input(s) for s in self.made.inputs if s.place]
            before = (
                f"    if ((state->samples % {_LOOKS}u) == 0u) {{\n        dfc_centre(state, "
                f"{read[-1] if read else f'{state}[{self.made.places[0][0]}]'});\n    }}\n"
            )
        if self.single and self.made.clock is not None:
            # The kernel's own count ends at 2^24; time is counted here.
            one, zero = self.out.number(1.0), self.out.number(0.0)
            before += f"    {state}[{self.made.clock}] = (state->samples == 0u) ? {zero} : {one};\n"
        if self._timed:
            before += "    dfc_now(state, state->shift);\n"
        if self.rests:
            rest, dt = f"{state}[{self.made.rest}]", self.out.number(self.made.dt)
            before += f"    const real rest = {rest};\n"
            after = (
                f"    if (fabsf({rest} - (rest + {dt})) <= {self.out.number(_ROUNDED)} * rest) {{\n"
                f"        const real more = {dt} + state->rest;\n"
                f"        {rest} = rest + more;\n"
                f"        state->rest = more - ({rest} - rest);\n"
                f"    }} else {{\n        state->rest = {self.out.number(0.0)};\n    }}\n"
            )
        after += f"    ++state->samples;\n{self._results()}\n"
        return f"{before}{self._called(self.step, arguments)}{after}"

    @property
    def _time(self) -> str:
        if self.single:
            return self.out.number(0.0)
        return f"(real)state->samples * {self.out.number(self.made.dt)}"

    def _input(self, signal: Signal) -> str:
        """An input as the kernel takes it."""
        if not (signal.place and self.single):
            return signal.name
        inner = f"{signal.name} - state->origin"
        return f"(real)({inner})" if self._apart(signal) else inner

    def _step(self) -> str:
        made, n = self.made, self.made.name
        inputs = [self._input(s) for s in made.inputs]
        head = f"bool {n}_step({n}_state *state{self._list(made.inputs)}, {n}_output *output)\n{{\n"
        out = f"    real out[{len(made.outputs)}] = {{{self.out.number(0.0)}}};\n\n"
        if not made.moves:
            tables = 1 if len(self.step.used) == 4 + len(inputs) else len(made.tables)
            arguments = [""] * tables + ["state->memory", self._time, *inputs, "out"]
            return f"{head}{out}{self._guard()}{self._taken(arguments)}    return true;\n}}\n"
        arguments = ["numbers", "", "state->memory", "t", "dt", *inputs]
        arguments += ["state->samples == 0u", "state->switches", "state->count", "out"]
        return (
            f"/* One sample of length dt from time t on, with these numbers of the axis. */\n"
            f"static void dfc_move({n}_state *state, const real *numbers, real t, real dt,\n"
            f"    real u, {n}_output *output)\n{{\n{out}    state->count[0] = 0;\n"
            f"    state->count[2] = 0;\n    (void)t;\n{self._taken(arguments)}}}\n\n"
            f"{head}{self._guard()}    dfc_move(state, dfc_numbers, {self._time}, "
            f"{self.out.number(made.dt)}, u, output);\n"
            "    return true;\n}\n"
        )

    def _look(self) -> str:
        if self.look is None:
            return ""
        made, n = self.made, self.made.name
        dt, zero = self.out.number(made.dt), self.out.number(0.0)
        size = made.memory.size
        arguments = ["numbers", "", "memory", "t", "dt", "u", "out"]
        size_of, copied, now = len(self.out.shifts), "", ""
        if self.look.shifted:
            copied = f"    real {SHIFT}[{size_of}];\n"
            now = (
                f"    for (int32_t i = 0; i < {size_of}; ++i) {{\n"
                f"        {SHIFT}[i] = state->shift[i];\n    }}\n"
            ) + (f"    dfc_now(state, {SHIFT});\n" if self._timed else "")
        return (
            f"/* What the axis shows at time t, with these numbers of the axis. */\n"
            f"static void dfc_show(const {n}_state *state, const real *numbers, real t, real dt,\n"
            f"    real u, {n}_output *output)\n{{\n"
            f"    real memory[{size}];\n    real out[{len(made.outputs)}] = {{{zero}}};\n"
            f"{copied}\n{now}"
            f"    for (int32_t i = 0; i < {size}; ++i) {{\n"
            f"        memory[i] = state->memory[i];\n    }}\n"
            f"    (void)t;\n    (void)dt;\n    (void)u;\n{self._called(self.look, arguments)}"
            f"{self._results()}\n}}\n\n"
            f"bool {n}_look(const {n}_state *state, real u, {n}_output *output)\n{{\n"
            f"{self._guard()}    dfc_show(state, dfc_numbers, {self._time}, {dt}, u, output);\n"
            "    return true;\n}\n\n"
            f"bool {n}_next({n}_state *state, real u, {n}_output *output)\n{{\n"
            f"{self._guard()}    dfc_move(state, dfc_numbers, {self._time}, {dt}, u, output);\n"
            f"    dfc_show(state, dfc_numbers, {self._time}, {dt}, u, output);\n"
            "    return true;\n}\n"
        )

    def numbers(self) -> dict[str, Any]:
        """All numbers, for the JSON file."""

        def plain(array: Any) -> Any:
            values = np.asarray(array).ravel().tolist()
            return [v if math.isfinite(v) else str(v) for v in values]

        made = self.made
        signals = {
            which: [{"name": s.name, "unit": s.unit, "meaning": s.meaning} for s in group]
            for which, group in (("inputs", made.inputs), ("outputs", made.outputs))
        }
        tables = {}
        for name, array in made.tables.items():
            kept = array
            if name.endswith("integers"):
                # Addresses are those of this process alone.
                kept = array[: axis_step.LAWS].copy()
                kept[[axis_step.RIGID_TASK, axis_step.TASK]] = 0
            tables[name] = {"shape": list(array.shape), "values": plain(kept)}
        return {
            "name": made.name,
            "kind": made.kind,
            "precision": self.precision,
            "dt": made.dt,
            "units": list(made.axis.units),
            **signals,
            "starts": [s.name for s, _ in made.starts],
            "memory": plain(made.memory),
            "tables": tables,
            "operations": {group: self.step.cost[group] for group in _GROUPS},
        }

    def readme(self) -> str:
        """How to compile and call it, what a sample costs, what it takes of memory."""
        made, n = self.made, self.made.name
        state = self.bytes * made.memory.size
        state += -state % 8 + 8
        if self.single:
            state += 8 + (4 if self.place == "float" else 8)
        state += self.bytes * (self.rests + len(self.out.shifts))
        if made.moves:
            state += self.bytes * 3 * ROOM + 16
        state += -state % 8
        constants = sum(
            array.size * (4 if array.dtype.kind == "i" else self.bytes)
            for name, array in made.tables.items()
            if f"dfc_{name}[" in self.source
        )
        cost = self.step.cost
        rows = "\n".join(f"| {words} | {cost[group]} |" for group, words in _WORDS.items())
        starts = "".join(f", {self.out.number(0.0)}" for _ in made.starts)
        inputs = "".join(f", {s.name}" for s in made.inputs)
        following = ""
        if made.moves:
            following = (
                f"`{n}_next` takes the same sample and returns what the axis shows at its end;\n"
                f"`{n}_look` shows the axis under another input and moves nothing.\n"
            )
            bound = (
                "The axis moves by steps of varied length.  The table counts one step of every "
                f"loop; a loop that searches a switch, or walks a sample, has {MOST_PASSES} "
                "passes at most. It is a simulator: measure it where time is short."
            )
        else:
            bound = (
                "Worst case of one sample: at every branch the dearer side, every loop to its "
                "end (a loop whose length is known at run time alone counts eight times)."
            )
        return f"""# {n}

{made.kind[0].upper()}{made.kind[1:]}, {self.precision} precision, dt = {made.dt:.9g} s.
Generated by dryfric-control {__version__} from the Python source of its compiled kernels.

| file | what |
|---|---|
| {n}.h | types, functions, units, ranges and the certificate |
| {n}.c | all code and constants |
| {n}.json | the numbers, with a checksum |

    gcc -std=c99 -O2 -ffp-contract=off -c {n}.c

```c
{n}_state state;
{n}_output out;
{n}_init(&state{starts});
if ({n}_step(&state{inputs}, &out)) {{ /* use out */ }}
```

{textwrap.fill(made.returns, 100)}
{following}
One state for each instance; functions share nothing and may be called from several threads
with states of their own.

## Operations of one sample

| operation | count |
|---|---|
{rows}

{bound}

## Memory

| what | bytes |
|---|---|
| state | {state} |
| constants | {constants} |

No memory is allocated.  Floating-point contraction (fused multiply-add) changes the last bits.
"""


_WORDS = {
    "add": "additions and subtractions",
    "multiply": "multiplications",
    "divide": "divisions",
    "compare": "comparisons",
    "function": "functions of math.h",
    "call": "calls before inlining",
}
