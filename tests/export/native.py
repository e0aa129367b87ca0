"""Compile exported C and run it over whole records."""

import ctypes
import shutil
import subprocess
from pathlib import Path

import numpy as np

import dryfric_control as dfc
from dryfric_control.compiled import compensation
from dryfric_control.compiled.windowed_runs import NO_FORCE
from dryfric_control.export import export_c
from dryfric_control.export.objects import ROOM, Exported, export_object

E = dfc.effects
GCC = shutil.which("gcc")
FLAGS = "-std=c99 -Wall -Wextra -Wconversion -Werror -O2 -ffp-contract=off".split()


def driver(made: Exported) -> str:
    """C that runs a whole record: inputs in rows, outputs in rows, switches one after another.

    Macros: NUMBER, the type of the rows, and AFTER, samples that were taken before.
    """
    n = made.name

    def given(signals, array, k=""):
        kinds = ["" if s.place else f"({n}_real)" for s in signals]
        return "".join(f", {kind}{array}[{k}{i}]" for i, kind in enumerate(kinds))

    starts = given([s for s, _ in made.starts], "starts")
    inputs = given(made.inputs, "in", f"{len(made.inputs)} * k + ")
    rows = "\n".join(
        f"        out[{len(made.outputs)} * k + {i}] = (NUMBER)o.{s.name};"
        for i, s in enumerate(made.outputs)
    )
    switches = f"""
        for (int i = 0; i < 3 * state.count[0] && i < {3 * ROOM} && 3 * total + i < most; ++i)
            switches[3 * total + i] = state.switches[i];
        total += state.count[0];
        lost += state.count[2];"""
    return f"""#include "{n}.h"
#ifndef NUMBER
#define NUMBER {n}_real
#endif
int run(int n, const NUMBER *starts, const NUMBER *in, NUMBER *out, {n}_real *switches, int most);
int run(int n, const NUMBER *starts, const NUMBER *in, NUMBER *out, {n}_real *switches, int most)
{{
    {n}_state state;
    {n}_output o;
    int total = 0, lost = 0;
    (void)starts; (void)switches; (void)most;
    {n}_init(&state{starts});
#ifdef AFTER
    state.samples = AFTER;
#endif
    for (int k = 0; k < n; ++k) {{
        if (!{n}_step(&state{inputs}, &o))
            return -1;
{rows}{switches if made.moves else ""}
    }}
    return total + lost;
}}
#ifdef ALONE
#include <stdio.h>
#include <stdlib.h>
int main(void)
{{
    int n = 0;
    NUMBER starts[8] = {{0}}, *in, *out;
    {n}_real *switches;
    if (fread(&n, sizeof n, 1, stdin) != 1 || n < 1)
        return 1;
    in = malloc(sizeof *in * (size_t)n * {len(made.inputs)});
    out = malloc(sizeof *out * (size_t)n * {len(made.outputs)});
    switches = malloc(sizeof *switches * 30000);
    if (fread(in, sizeof *in, (size_t)n * {len(made.inputs)}, stdin) != (size_t)n * {len(made.inputs)})
        return 2;
    if (run(n, starts, in, out, switches, 30000) < 0)
        return 3;
    fwrite(out, sizeof *out, (size_t)n * {len(made.outputs)}, stdout);
    free(in); free(out); free(switches);
    return 0;
}}
#endif
"""


class Native:
    """An exported object, compiled with the flags that are promised."""

    def __init__(self, obj, folder: Path, precision="double", dt=None, flags=(), name=None):
        assert GCC is not None
        self.made = export_object(obj, name, dt)
        self.files = export_c(obj, folder, precision, name=name, dt=dt)
        main = self.files[0].parent / "driver.c"
        main.write_text(driver(self.made))
        self.sources, self.flags = [str(self.files[1]), str(main)], list(flags)
        self.real = np.float32 if precision == "single" else np.float64
        self.inner = np.float64 if precision == "double" else np.float32
        if precision == "mixed":
            self.flags.append("-DNUMBER=double")
        self._run = None

    def compiled(self, target: Path, *options: str) -> Path:
        """Compile with further options."""
        command = [GCC, *FLAGS, *self.flags, *options, *self.sources, "-o", str(target), "-lm"]
        subprocess.run(command, check=True)
        return target

    def run(self, *inputs, starts=None):
        """Outputs, shape (signals, n), and for an axis the rows of its switches."""
        if self._run is None:
            library = self.compiled(self.files[0].parent / "lib.so", "-fPIC", "-shared")
            self._run = ctypes.CDLL(str(library)).run
        given = np.ascontiguousarray(np.column_stack(inputs), dtype=self.real)
        first = np.zeros(8, dtype=self.real)
        if starts is not None:
            first[: len(starts)] = starts
        out = np.empty((len(given), len(self.made.outputs)), dtype=self.real)
        switches = np.zeros((100_000, 3), dtype=self.inner)
        count = self._run(
            len(given), *(a.ctypes.data_as(ctypes.c_void_p) for a in (first, given, out, switches)),
            switches.size,
        )  # fmt: skip
        if count < 0:
            raise ValueError("a step refused its input")
        return out.T.astype(float), switches[:count].astype(float)

    def run_alone(self, *inputs, flags=(), around=()):
        """The outputs of a program of its own, under the given flags and wrapper."""
        program = self.compiled(self.files[0].parent / "alone", "-DALONE", "-g", *flags)
        given = np.ascontiguousarray(np.column_stack(inputs), dtype=self.real)
        done = subprocess.run(
            [*around, str(program)], input=np.int32(len(given)).tobytes() + given.tobytes(),
            capture_output=True, timeout=300,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr.decode(errors="replace")
        return np.frombuffer(done.stdout, self.real).reshape(len(given), -1).T


def by_kernel(obj, *inputs, place=0.0) -> np.ndarray:
    """What the compiled kernel of an observer, a filter or a compensation returns."""
    n = len(inputs[0])
    if isinstance(obj, dfc.Compensation):
        memory, out = obj.controller.memory(), np.empty((n, 2))
        for k, row in enumerate(zip(*inputs, strict=True)):
            out[k, 0] = compensation.step(obj.controller.law, memory, *row)
            out[k, 1] = memory[compensation.FORCE]
    else:
        out = np.empty((n, obj.noutputs))
        obj.sample_kernel.run(*obj.tables(), obj.memory(place), *inputs, NO_FORCE, out)
    return out.T


def ulps(a, b) -> int:
    """Largest distance of two arrays of doubles, in units of the last place."""
    a, b = (np.ascontiguousarray(one, dtype=np.float64).view(np.int64) for one in (a, b))
    a, b = (np.where(one < 0, np.int64(-(2**63)) - one, one) for one in (a, b))
    return int(np.abs(a - b).max(initial=0))


# Random machines -------------------------------------------------------------------------

_EFFECTS = (
    lambda r: E.BiasForce(r.normal(0.0, 1.0)),
    lambda r: E.ViscousAsymmetry(r.uniform(-1.0, 1.0)),
    lambda r: E.QuadraticDrag(r.uniform(0.0, 5.0)),
    lambda r: E.Spring(r.uniform(0.0, 100.0), r.normal(0.0, 0.05)),
    lambda r: E.Gravity(r.uniform(0.0, 2.0), r.uniform(-3.0, 3.0)),
    lambda r: E.Cogging(r.uniform(0.1, 1.0), r.uniform(5e-3, 0.05), r.uniform(-3.0, 3.0)),
    lambda r: E.PositionForce(0.0, r.uniform(0.01, 0.1), *r.normal(0.0, 0.3, 13)),
    lambda r: E.TimePeriodic(r.uniform(0.1, 1.0), r.uniform(0.5, 20.0), r.uniform(-3.0, 3.0)),
    lambda r: E.CoulombAsymmetry(r.uniform(-1.0, 1.0)),
    lambda r: E.PositionDependence(r.normal(0.0, 0.5), r.normal(0.0, 1.0), 0.0),
    lambda r: E.FrictionRipple(r.uniform(0.0, 0.5), r.uniform(5e-3, 0.05), r.uniform(-3.0, 3.0)),
    lambda r: E.LoadDependence(r.uniform(0.0, 0.1)),
    lambda r: E.Drift(r.normal(0.0, 1e-3)),
    lambda r: E.DwellTime(r.uniform(0.1, 2.0), r.uniform(0.05, 1.0)),
    lambda r: E.EndStop(r.uniform(-0.02, 0.0), r.uniform(0.01, 0.03), r.uniform(1e2, 1e4), 10.0),
    lambda r: E.InputGain(r.uniform(0.8, 1.2)),
    lambda r: E.DeadZone(r.uniform(0.0, 0.5)),
    lambda r: E.Saturation(r.uniform(20.0, 60.0)),
    lambda r: E.InputDelay(r.uniform(2e-4, 3e-3)),
    lambda r: E.ActuatorLag(r.uniform(5e-4, 5e-3)),
)
_STRUCTURES = (
    lambda r: (E.Presliding(r.uniform(2e-6, 2e-5)),),
    lambda r: (E.Backlash(r.uniform(1e-5, 1e-4), r.uniform(0.3, 0.7)),),
    lambda r: (E.Compliance(r.uniform(3e4, 3e5), r.uniform(1.0, 20.0), r.uniform(0.3, 0.7)),),
    lambda r: (E.Presliding(1e-5), E.Compliance(1e5, 10.0, 0.5)),
    lambda r: (E.Compliance(1e5, 10.0, 0.5, 1.0),),
    lambda r: (E.Backlash(5e-5, 0.5, 1.0),),
    lambda r: (E.Presliding(1e-5), E.Backlash(5e-5, 0.5)),
    lambda r: (E.Backlash(r.uniform(1e-5, 1e-4), 0.5, 0.0, r.uniform(3e-6, 3e-5), 10.0),),
    lambda r: (E.Presliding(r.uniform(5e-6, 2e-5), r.uniform(0.0, 300.0), 1.0),),
    lambda r: (E.Presliding(1e-5, 200.0, 1.0), E.Compliance(1e5, 10.0, 0.5)),
)


def random_axis(rng, structure=False) -> dfc.FrictionAxis:
    """An axis with random numbers and two to five random effects."""
    chosen = rng.choice(len(_EFFECTS), size=rng.integers(2, 6), replace=False)
    effects = [_EFFECTS[i](rng) for i in chosen]
    if structure:
        effects += _STRUCTURES[rng.integers(len(_STRUCTURES))](rng)
    slope = rng.normal(0.0, 2.0)
    mass, viscous = rng.uniform(0.5, 5.0), rng.uniform(0.0, 30.0)
    levels = dfc.CoulombMap([rng.uniform(6.0, 10.0), slope], [rng.uniform(6.0, 10.0), -slope])
    peaked = rng.random() < 0.7
    return dfc.FrictionAxis(
        mass, viscous, levels, travel=(-0.5, 0.5), effects=effects, name="machine",
        stribeck=dfc.Stribeck(rng.uniform(0.1, 0.6), rng.uniform(5e-4, 1e-2)) if peaked else None,
        switching="filippov" if rng.random() < 0.8 else "paper",
    )  # fmt: skip


def mismatched(axis, rng) -> dfc.FrictionAxis:
    """The axis with a mass and a friction that are off by up to a fifth."""
    mass, level = rng.uniform(0.8, 1.2, 2)
    plus, minus = ([level * c for c in side] for side in (axis.coulomb.plus, axis.coulomb.minus))
    return axis.replace(mass=mass * axis.mass, coulomb=dfc.CoulombMap(plus, minus))


def random_drive(rng, n, dt=1e-3) -> np.ndarray:
    """Two sines and noise, with stretches of rest."""
    t = np.arange(n) * dt
    f, g = rng.uniform(0.3, 2.0), rng.uniform(2.0, 6.0)
    u = rng.uniform(8.0, 20.0) * np.sin(6.28 * f * t) + 4.0 * np.sin(6.28 * g * t)
    return np.where(np.sin(0.9 * t) > -0.7, u, 0.0) + rng.normal(0.0, 0.3, n)


def reading(axis, u, dt=1e-3, quantum=1e-6) -> np.ndarray:
    """Encoder readings of an axis under a drive."""
    return quantum * np.round(axis.simulate(u, dt).y[0] / quantum)
