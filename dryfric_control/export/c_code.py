"""C99 source, header, numbers and README of an exported object."""

from __future__ import annotations

import math
import os
import textwrap
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from dryfric_control._version import __version__
from dryfric_control.export.objects import ROOM, Exported, Signal, exported
from dryfric_control.export.translate import MOST_PASSES, Function, Translator
from dryfric_control.store.files import replacing, write_document
from dryfric_control.text import WIDTH

PRECISIONS = {"double": "double", "single": "float"}
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
    precision : {"double", "single"}, optional
        Type of the numbers, `double` or `float`.
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
        raise ValueError(f'precision must be "double" or "single", got {precision!r}')
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
                    write_document(part, "export", 1, code.numbers())
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
        "double" or "single".
    """

    def __init__(self, made: Exported, precision: str = "double") -> None:
        self.made, self.precision = made, precision
        self.out: Translator
        self.step: Function
        self.look: Function | None
        self.out, self.step, self.look = made.translated(precision == "single")
        self.header, self.source = self._header(), self._source()

    @property
    def bytes(self) -> int:
        """Size of a number."""
        return 8 if self.precision == "double" else 4

    def _header(self) -> str:
        made, n = self.made, self.made.name
        guard = f"{n.upper()}_H"
        fields = "".join(
            f"    {'int32_t' if s.whole else f'{n}_real'} {s.name}; /* {s.meaning} [{s.unit}] */\n"
            for s in made.outputs
        )
        switches = ""
        if made.moves:
            switches = (
                f"    {n}_real switches[{3 * ROOM}]; /* of the last sample: time, mode before, "
                "mode after */\n    int32_t count[4]; /* listed, room, not listed, most */\n"
            )
        return f"""{self._comment()}
#ifndef {guard}
#define {guard}

#include <stdbool.h>
#include <stdint.h>

typedef {PRECISIONS[self.precision]} {n}_real;

/* State, all of it: copy it to save it. */
typedef struct {{
    {n}_real memory[{made.memory.size}];
    uint32_t samples; /* taken so far */
{switches}}} {n}_state;

/* What one sample returns. */
typedef struct {{
{fields}}} {n}_output;

/* State before the first sample. */
void {n}_init({n}_state *state{self._list(tuple(s for s, _ in made.starts), f"{n}_real")});

/* One sample; false, and nothing is changed, if an input is no finite number.
{textwrap.indent(textwrap.fill(made.returns, 94), "   ")} */
bool {n}_step({n}_state *state{self._list(made.inputs, f"{n}_real")}, {n}_output *output);
{self._look_declaration()}
#endif
"""

    @staticmethod
    def _list(signals: tuple[Signal, ...], kind: str) -> str:
        return "".join(f", {kind} {s.name}" for s in signals)

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

    def _comment(self) -> str:
        """Comment at the head of the header: units, ranges, certificate."""
        made = self.made
        axis = made.axis.effective()
        length, force = axis.units
        low, high = axis.travel or (-math.inf, math.inf)
        rows = [f"{made.name}: {made.kind}, from dryfric-control {__version__}", ""]
        rows += [f"Sampling time {made.dt:.9g} s; numbers are {PRECISIONS[self.precision]}.", ""]
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
        rows = [f"    state->memory[{place}] = {s.name};" for s, place in made.starts]
        rows += ["    state->samples = 0;"]
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
        given = self._list(tuple(s for s, _ in made.starts), "real")
        return (
            f"void {n}_init({n}_state *state{given})\n{{\n"
            f"    for (int32_t i = 0; i < {made.memory.size}; ++i) {{\n"
            f"        state->memory[i] = {self.out.number(0.0)};\n    }}\n"
            + "\n".join(rows)
            + "\n}\n"
        )

    def _results(self) -> str:
        rows = []
        for i, s in enumerate(self.made.outputs):
            rows.append(f"    output->{s.name} = {'(int32_t)' if s.whole else ''}out[{i}];")
        return "\n".join(rows)

    def _guard(self) -> str:
        test = " || ".join(f"!isfinite({s.name})" for s in self.made.inputs)
        return f"    if ({test}) {{\n        return false;\n    }}\n"

    def _called(self, function: Function, arguments: list[str]) -> str:
        """Call of a kernel, of its arguments those that it takes."""
        given = [a for a, used in zip(arguments, function.used, strict=True) if used]
        return f"    {function.name}({', '.join(given)});\n"

    @property
    def _time(self) -> str:
        return f"(real)state->samples * {self.out.number(self.made.dt)}"

    def _step(self) -> str:
        made, n = self.made, self.made.name
        inputs = [s.name for s in made.inputs]
        head = (
            f"bool {n}_step({n}_state *state{self._list(made.inputs, 'real')}, "
            f"{n}_output *output)\n{{\n"
        )
        out = f"    real out[{len(made.outputs)}] = {{{self.out.number(0.0)}}};\n\n"
        if not made.moves:
            tables = 1 if len(self.step.used) == 4 + len(inputs) else len(made.tables)
            arguments = [""] * tables + ["state->memory", self._time, *inputs, "out"]
            return (
                f"{head}{out}{self._guard()}{self._called(self.step, arguments)}"
                f"    ++state->samples;\n{self._results()}\n    return true;\n}}\n"
            )
        arguments = ["numbers", "", "state->memory", "t", "dt", *inputs]
        arguments += ["state->samples == 0u", "state->switches", "state->count", "out"]
        return (
            f"/* One sample of length dt from time t on, with these numbers of the axis. */\n"
            f"static void dfc_move({n}_state *state, const real *numbers, real t, real dt,\n"
            f"    real u, {n}_output *output)\n{{\n{out}    state->count[0] = 0;\n"
            f"    state->count[2] = 0;\n    (void)t;\n{self._called(self.step, arguments)}"
            f"    ++state->samples;\n{self._results()}\n}}\n\n"
            f"{head}{self._guard()}    dfc_move(state, dfc_numbers, {self._time}, "
            f"{self.out.number(made.dt)}, u, output);\n    return true;\n}}\n"
        )

    def _look(self) -> str:
        if self.look is None:
            return ""
        made, n = self.made, self.made.name
        dt, zero = self.out.number(made.dt), self.out.number(0.0)
        size = made.memory.size
        arguments = ["numbers", "", "memory", "t", "dt", "u", "out"]
        return (
            f"/* What the axis shows at time t, with these numbers of the axis. */\n"
            f"static void dfc_show(const {n}_state *state, const real *numbers, real t, real dt,\n"
            f"    real u, {n}_output *output)\n{{\n"
            f"    real memory[{size}];\n    real out[{len(made.outputs)}] = {{{zero}}};\n\n"
            f"    for (int32_t i = 0; i < {size}; ++i) {{\n"
            f"        memory[i] = state->memory[i];\n    }}\n"
            f"    (void)t;\n    (void)dt;\n    (void)u;\n{self._called(self.look, arguments)}"
            f"{self._results()}\n}}\n\n"
            f"bool {n}_look(const {n}_state *state, real u, {n}_output *output)\n{{\n"
            f"{self._guard()}    dfc_show(state, dfc_numbers, {self._time}, {dt}, u, output);\n"
            "    return true;\n}\n\n"
            f"bool {n}_next({n}_state *state, real u, {n}_output *output)\n{{\n"
            f"    return {n}_step(state, u, output) && {n}_look(state, u, output);\n}}\n"
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
                kept = array[:_COUNTS]  # addresses follow, of this process alone
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
        state = self.bytes * made.memory.size + 4
        if made.moves:
            state += self.bytes * 3 * ROOM + 16
        state += -state % self.bytes
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

{made.kind[0].upper()}{made.kind[1:]}, {PRECISIONS[self.precision]} precision, dt = {made.dt:.9g} s.
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
with states of their own.  `samples` counts to 2^32 and then starts anew at time zero.

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
_COUNTS = 13
