"""Times of a sample by this tree and by another one, in one run, as ratios (15 s a turn).

    python benchmarks/builds.py --other PATH [--turns 5] [--only simulate ...]

PATH is another checkout of the project.  Each turn runs both in fresh processes, which compile into
the cache of each tree, and each work in it several times.  Printed are the shortest times of a
sample (of what is exported, of the C code by gcc), and the median over the turns of this tree's
time over the other's: below 1, this tree is faster.  Outputs that differ are counted, too.
"""

from __future__ import annotations

import hashlib
import json
import sys
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from harness import ROOT, Table, fresh_process, parser_of, race

DT = 1e-3
SAMPLES = 50_000
#: Samples of what runs in Python.
SLOW_SAMPLES = 2_000
#: Calls of each work in one process.
REPEAT = 7

Workloads = dict[str, tuple[Callable[[], object], int]]


def simulations() -> Workloads:
    """Work and samples of simulations."""
    import dryfric_control as dfc
    from dryfric_control import effects as fx

    t = np.arange(SAMPLES) * DT
    sine, steps = 20.0 * np.sin(2.0 * np.pi * t), np.where(t % 0.4 < 0.2, 12.0, -4.0)
    plain = dfc.FrictionAxis(mass=2.0, viscous=6.0, coulomb=8.0)
    peak = plain.replace(stribeck=dfc.Stribeck(excess=0.3, speed=0.01))
    axes = {
        "plain": plain,
        "Stribeck": peak,
        "3 effects": peak.replace(
            effects=(fx.Spring(20.0), fx.Cogging(amplitude=0.5, period=0.01), fx.BiasForce(0.5))
        ),
        "delay": plain.replace(effects=(fx.InputDelay(2.3e-3),)),
        "time periodic": plain.replace(effects=(fx.TimePeriodic(amplitude=2.0, frequency=11.0),)),
        "dwell time": peak.replace(effects=(fx.DwellTime(1.0, 0.1),)),
        "presliding": plain.replace(effects=(fx.Presliding(distance=40e-6),)),
        "backlash": plain.replace(effects=(fx.Backlash(gap=2e-4, load_fraction=0.4),)),
        "compliance": plain.replace(
            effects=(fx.Compliance(stiffness=3e4, damping=12.0, load_fraction=0.4),)
        ),
    }
    works: Workloads = {}
    for name, axis in axes.items():
        works[f"simulate, {name}, sine"] = partial(axis.simulate, sine, DT), SAMPLES
    works["simulate, plain, steps"] = partial(plain.simulate, steps, DT), SAMPLES
    stepper = plain.stepper(DT)
    works["stepper of an axis"] = (lambda: [stepper.step(9.0) for _ in range(SLOW_SAMPLES)],
                                   SLOW_SAMPLES)  # fmt: skip
    return works


def observers() -> Workloads:
    """Work and samples of observers on the record of the presets."""
    import dryfric_control as dfc
    from dryfric_control import presets

    run = presets.clutch_experiment()
    u, y = run.plant.y[4].copy(), run.plant.y[5].copy()
    design = presets.clutch_observer()
    hybrid = dfc.hybrid_filter(presets.clutch_observer_axis(), DT, presets.QUANTUM)
    stepper = hybrid.stepper()
    some = np.vstack([u, y])[:, :SLOW_SAMPLES].T
    return {
        "observer, switched PI": (partial(dfc.observe, design, u, y), u.size),
        "observer, hybrid filter": (partial(hybrid.run, u, y), u.size),
        "stepper of the hybrid filter": (
            lambda: [stepper.step(*one) for one in some], SLOW_SAMPLES,
        ),
    }  # fmt: skip


def compensations() -> Workloads:
    """Work and samples of the compensated loop."""
    import dryfric_control as dfc

    peak = dfc.Stribeck(0.3, 0.01)
    axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0, stribeck=peak, stick_speed=1e-3)
    motion = dfc.motion_profile(
        np.tile([0.0, 0.02, -0.01], 8), DT, velocity=0.08, acceleration=1.0, jerk=50.0, dwell=0.1
    )
    works: Workloads = {}
    for law in ("learned", "pid"):
        comp = dfc.design_compensation(axis, DT, 1e-6, 3e-3, law=law)
        loop = partial(dfc.simulate_loop, axis, comp.controller, motion, quantum=1e-6)
        works[f"compensated loop, {law}"] = loop, motion.time.size
    return works


def exports(folder: Path) -> Workloads:
    """Work and samples of exported C."""
    import dryfric_control as dfc

    sys.path.insert(0, str(Path(dfc.__file__).parents[1] / "tests" / "export"))
    import native

    peak = dfc.Stribeck(0.3, 0.01)
    axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0, stribeck=peak, stick_speed=1e-3)
    u = native.random_drive(np.random.default_rng(1), SAMPLES)
    y = 1e-6 * np.round(1e6 * axis.simulate(u, DT).y[0])
    objects = {
        "axis": (axis, (u,)),
        "switched PI": (dfc.design_pi_observer(axis, DT, encoder_quantum=1e-6), (u, y)),
        "hybrid filter": (dfc.hybrid_filter(axis, DT, 1e-6), (u, y)),
    }
    works: Workloads = {}
    for number, (name, (made, inputs)) in enumerate(objects.items()):
        own = folder / str(number)
        own.mkdir()
        options = {"dt": DT} if name == "axis" else {}
        works[f"C, {name}"] = partial(native.Native(made, own, **options).run, *inputs), SAMPLES
    return works


def fingerprint(result: object) -> str:
    """Digest of what a work returns, where that is arrays."""
    found = result[0] if isinstance(result, tuple) else getattr(result, "y", result)
    if not isinstance(found, np.ndarray):
        found = getattr(result, "outputs", None)
    return "" if found is None else hashlib.sha1(np.ascontiguousarray(found)).hexdigest()


def times(only: list[str]) -> dict[str, tuple[float, str]]:
    """Shortest time of a sample [ns] and digest of the result of each work in this process."""
    with tempfile.TemporaryDirectory() as folder:
        works = {**simulations(), **observers(), **compensations(), **exports(Path(folder))}
        works = {n: w for n, w in works.items() if any(part in n for part in only or [""])}
        raced = race([work for work, _ in works.values()], REPEAT)
    return {
        name: (1e9 * best / samples, fingerprint(result))
        for (name, (_, samples)), (best, _, result) in zip(works.items(), raced, strict=True)
    }


def main() -> None:
    """Print the table of both trees."""
    parser = parser_of(
        __doc__,
        {
            "--other": (Path, "another checkout"),
            "--turns": (5, "processes of each tree"),
            "--here": (False, "print the times of this process alone, as JSON"),
        },
    )
    parser.add_argument("--only", nargs="*", default=[], help="parts of the names of works")
    given = parser.parse_args()
    if given.here:
        print(json.dumps(times(given.only)))
        return
    command = (__file__, "--here", "--only", *given.only)
    trees = (ROOT, given.other.resolve())
    turns = [[fresh_process(*command, tree=tree) for tree in trees] for _ in range(given.turns)]
    table = Table(
        {"a sample": "34s", "ns": "10.1f", "other": "10.1f", "ratio": "8.2f", "output": "12s"}
    )
    for name in turns[0][0]:
        mine, others = np.array([[run[name][0] for run in turn] for turn in turns]).T
        digests = {run[name][1] for turn in turns for run in turn}
        same = "" if digests == {""} else "same" if len(digests) == 1 else "differs"
        table.row(name, mine.min(), others.min(), np.median(mine / others), f"   {same}")


if __name__ == "__main__":
    main()
