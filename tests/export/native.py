"""Compile exported C and run it over whole records."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from pathlib import Path

import numpy as np

from dryfric_control.export import export_c
from dryfric_control.export.objects import ROOM, Exported, exported

GCC = shutil.which("gcc")
FLAGS = "-std=c99 -Wall -Wextra -Wconversion -Werror -O2 -ffp-contract=off".split()


def driver(made: Exported) -> str:
    """C that runs a whole record: inputs in rows, outputs in rows, switches one after another."""
    n = made.name
    starts = "".join(f", starts[{i}]" for i in range(len(made.starts)))
    inputs = "".join(f", in[{len(made.inputs)} * k + {i}]" for i in range(len(made.inputs)))
    rows = "\n".join(
        f"        out[{len(made.outputs)} * k + {i}] = ({n}_real)o.{s.name};"
        for i, s in enumerate(made.outputs)
    )
    switches = ""
    if made.moves:
        switches = (
            f"        for (int i = 0; i < 3 * state.count[0] && i < {3 * ROOM} && 3 * total + i < most; ++i)\n"
            "            switches[3 * total + i] = state.switches[i];\n"
            "        total += state.count[0];\n"
            "        lost += state.count[2];\n"
        )
    return f"""#include "{n}.h"
int run(int n, const {n}_real *starts, const {n}_real *in, {n}_real *out, {n}_real *switches, int most);
int run(int n, const {n}_real *starts, const {n}_real *in, {n}_real *out, {n}_real *switches, int most)
{{
    {n}_state state;
    {n}_output o;
    int total = 0, lost = 0;
    (void)starts; (void)switches; (void)most;
    {n}_init(&state{starts});
    for (int k = 0; k < n; ++k) {{
        if (!{n}_step(&state{inputs}, &o))
            return -1;
{rows}
{switches}    }}
    return total + lost;
}}
"""


class Native:
    """An exported object, compiled with the flags that are promised."""

    def __init__(self, obj, folder: Path, precision="double", dt=None, flags=(), name=None):
        assert GCC is not None
        self.made = exported(obj, name, dt)
        self.files = export_c(obj, folder, precision, name=name, dt=dt)
        source, main = self.files[1], folder / "driver.c"
        main.write_text(driver(self.made))
        library = folder / "lib.so"
        command = [GCC, *FLAGS, *flags, "-fPIC", "-shared", str(source), str(main)]
        subprocess.run([*command, "-o", str(library), "-lm"], check=True)
        self.real = np.float64 if precision == "double" else np.float32
        self._run = ctypes.CDLL(str(library)).run

    def run(self, *inputs, starts=None):
        """Outputs, shape (signals, n), and for an axis the rows of its switches."""
        given = np.ascontiguousarray(np.column_stack(inputs), dtype=self.real)
        first = np.zeros(8, dtype=self.real)
        if starts is not None:
            first[: len(starts)] = starts
        out = np.empty((len(given), len(self.made.outputs)), dtype=self.real)
        switches = np.zeros((100_000, 3), dtype=self.real)
        count = self._run(
            len(given), *(a.ctypes.data_as(ctypes.c_void_p) for a in (first, given, out, switches)),
            switches.size,
        )  # fmt: skip
        if count < 0:
            raise ValueError("a step refused its input")
        return out.T.astype(float), switches[:count].astype(float)


def ulps(a, b) -> int:
    """Largest distance of two arrays of doubles, in units of the last place."""
    return int(np.abs(_ordered(a) - _ordered(b)).max(initial=0))


def _ordered(values):
    bits = np.ascontiguousarray(values, dtype=np.float64).view(np.int64).copy()
    bits[bits < 0] = np.int64(-(2**63)) - bits[bits < 0]
    return bits
