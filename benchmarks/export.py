"""How exactly exported C repeats the kernels (4 min; ``--samples 100000``: 1 min).

Random axes with random effects, observers and compensations of them, readings of mismatched
plants; the C, compiled by gcc with the flags of the how-to page, against the compiled kernels.
Prints for each kind machines, samples, outputs that differ, and the largest distance in units of
the last place.  ``--single`` compares single precision with double: RMS of the difference of each
output, median of the machines, and for observers the velocity error in double precision beside it.

python benchmarks/export.py [kinds] [--single] [--samples N] [--machines N]
"""

from __future__ import annotations

import tempfile
import warnings
from functools import partial
from pathlib import Path

import numpy as np
from harness import import_from, parser_of

import dryfric_control as dfc
from dryfric_control.compiled import compensation

import_from("tests/export")
import native  # noqa: E402

DT, QUANTUM = 1e-3, 1e-6


def axis_case(rng, n, structure=False):
    """An axis, its inputs, and what the kernel returns."""
    axis = native.random_axis(rng, structure)
    u = native.random_drive(rng, n)
    return axis, (u,), axis.simulate(u, DT).y, None


def observer_case(make, rng, n):
    """An observer of a random axis, with the reading of a mismatched plant."""
    axis = native.random_axis(rng)
    made = make(axis, rng)
    u = native.random_drive(rng, n)
    truth = native.mismatched(axis, rng).simulate(u, DT).y
    y = QUANTUM * np.round(truth[0] / QUANTUM)
    return made, (u, y), native.by_kernel(made, u, y), truth


def switched(axis, rng):
    """A design in one of its forms."""
    form = str(rng.choice(["current", "prediction"]))
    return dfc.design_pi_observer(axis, dt=DT, encoder_quantum=QUANTUM, form=form)


def hybrid(axis, rng):
    """A hybrid filter."""
    return dfc.hybrid_filter(axis, DT, QUANTUM)


def extended(axis, rng):
    """An extended state observer, with or without the nominal friction."""
    return dfc.extended_state_observer(axis, DT, QUANTUM, feedforward=bool(rng.integers(2)))


def compensation_case(rng, n):
    """A compensation in a loop with a mismatched plant, its samples taken again."""
    law = str(rng.choice(["learned", "learned", "fixed", "pid", "disturbance observer", "adrc"]))
    while True:
        axis = native.random_axis(rng)
        axis = axis.replace(effects=[e for e in axis.effects if e.slug not in _HARD])
        try:
            comp = dfc.design_compensation(axis, dt=DT, encoder_quantum=QUANTUM, law=law)
            break
        except ValueError:  # no stable loop with the delay of this one
            continue
    points = np.tile([0.0, 0.02, -0.01], 2 + n // 1000)
    rows = dfc.motion_profile(
        points, DT, velocity=0.08, acceleration=1.0, jerk=50.0, dwell=0.1
    ).rows[:, :n]
    plant = native.mismatched(axis, rng)
    stepper, memory = plant.stepper(dt=DT), comp.controller.memory()
    law_arrays, out, y = comp.controller.law, np.empty((2, n)), np.empty(n)
    for k in range(n):
        y[k] = QUANTUM * np.round(stepper.x / QUANTUM)
        out[0, k] = compensation.step(law_arrays, memory, *rows[:, k], y[k])
        out[1, k] = memory[compensation.FORCE]
        stepper.step(out[0, k])
    return comp, (*rows, y), out, None


_HARD = ("input_delay", "actuator_lag", "input_gain", "dead_zone", "saturation")

CASES = {
    "axis": axis_case,
    "axis with inner states": partial(axis_case, structure=True),
    "switched observer": partial(observer_case, switched),
    "hybrid filter": partial(observer_case, hybrid),
    "extended state": partial(observer_case, extended),
    "compensation": compensation_case,
}


def main() -> None:
    """Print the table."""
    parser = parser_of(
        __doc__,
        {
            "--samples": (1_000_000, "of each kind"),
            "--machines": (20, "of each kind"),
            "--single": (False, "single precision beside double"),
        },
    )
    parser.add_argument("kinds", nargs="*", default=list(CASES))
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    n = given.samples // given.machines
    for kind in given.kinds:
        rng = np.random.default_rng(19)
        differ, far, squares = 0, 0, []
        for _ in range(given.machines):
            obj, inputs, expected, truth = CASES[kind](rng, n)
            with tempfile.TemporaryDirectory() as folder:
                code = native.Native(obj, Path(folder), "single" if given.single else "double")
                out, _ = code.run(*inputs)
            differ += int((out != expected).sum())
            far = max(far, native.ulps(out, expected))
            errors = [] if truth is None else [np.mean((expected[1] - truth[1]) ** 2)]
            squares.append([*np.mean((out - expected) ** 2, axis=1), *errors])
        row = f"{differ} values differ, by {far} units in the last place at most"
        if given.single:
            rms = np.sqrt(np.median(squares, axis=0))
            names = [s.name for s in code.made.outputs] + ["error of vhat in double"]
            row = ", ".join(f"{a} {b:.2g}" for a, b in zip(names, rms, strict=False))
        print(f"{kind}: {given.machines} machines, {n * given.machines} samples: {row}", flush=True)


if __name__ == "__main__":
    main()
