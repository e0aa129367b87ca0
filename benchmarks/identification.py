"""What identification reaches: on the bench, on EMPS, on a servo pendulum (EMPS: 13 s).

    python benchmarks/identification.py [emps | bam | bench | coverage | map | stribeck]
        [--repeats 200] [--condition noise]

Prints tables; every figure comes from the run.  Records are read from
../shared/data and left out with a word where they are not at hand.
"""

from __future__ import annotations

import time
import warnings
from argparse import Namespace

import measured
import numpy as np
from harness import import_from, print_tables
from scipy.signal import butter, decimate, filtfilt

import dryfric_control as dfc
from dryfric_control.identification import (
    FitWarning,
    fit,
    identify_coulomb,
    identify_stribeck,
    replay_loop,
)
from dryfric_control.model.friction_curve import net_force
from dryfric_control.records import Record

import_from("tests", "tests/identification")
import truth  # noqa: E402  (the independent bench lives with the tests)

#: White noise on the recorded drive, in parts of the Coulomb level.
NOISES = (0.0, 0.02, 0.05, 0.1, 0.2)
#: What a record of `coverage` has beside its axis: parts of the Coulomb level as white
#: noise on u and as cogging that the axis of the fit lacks; sampling time [s].
CONDITIONS = {
    "clean": (0.0, 0.0, 1e-3),
    "noise": (0.03, 0.0, 1e-3),
    "cogging": (0.0, 0.05, 1e-3),
    "both": (0.03, 0.05, 1e-3),
    "noise, 250 Hz": (0.03, 0.0, 4e-3),
    "cogging, 250 Hz": (0.0, 0.05, 4e-3),
    "noise, 4 kHz": (0.03, 0.0, 2.5e-4),
    "cogging, 4 kHz": (0.0, 0.05, 2.5e-4),
    "noise, 50 um": (0.03, 0.0, 1e-3),
    "cogging, 50 um": (0.0, 0.05, 1e-3),
    "noise, Stribeck free": (0.03, 0.0, 1e-3),
    **{f"drive noise {100 * part:g} %": (part, 0.0, 1e-3) for part in NOISES},
    **{f"drive noise {100 * part:g} %, Stribeck free": (part, 0.0, 1e-3) for part in NOISES},
}


def spoiled(seed: int, condition: str) -> tuple[truth.Case, Record]:
    """Record of the independent bench in a condition of `coverage`, and what is true."""
    noise, cogging, dt = CONDITIONS[condition]
    rng = np.random.default_rng([seed, 77])
    length = "short"
    if "," in condition and "Hz" not in condition:
        length = "coarse" if "um" in condition else "exact"
    case = truth.make_null(seed, length)
    if cogging > 0.0:
        shape = {"amplitude": 0.0, "pitch": 1.0, "phase": 0.0}
        axis = truth.make_case({"cogging": shape}, seed, length).actual  # the same axis without
        shape["amplitude"] = cogging * axis["coulomb"]
        shape["pitch"] = rng.uniform(0.03, 0.15) * (axis["travel"][1] - axis["travel"][0])
        shape["phase"] = rng.uniform(0.0, 2.0 * np.pi)
        case = truth.make_case({"cogging": shape}, seed, length)
    t, u, x, quantum = case.t, case.u, case.x, case.quantum
    if dt != 1e-3:  # the same drive force, held and read at another rate
        each = round(4 * dt / 1e-3)
        u = np.repeat(u, 4)[: 4 * u.size // each * each].reshape(-1, each).mean(axis=1)
        substeps = max(round(case.substeps * dt / 1e-3), 8)
        states = truth.open_loop(case.plant, u, dt, substeps, case.states[0])
        t, x = dt * np.arange(u.size), quantum * np.round(states[:-1, 0] / quantum)
    if condition == "clean":
        # Noise above what the generator's own time steps leave in its record.
        x, quantum = x + 20e-6 * rng.standard_normal(x.size), 0.0
    u = u + noise * case.actual["coulomb"] * rng.standard_normal(u.size)
    return case, Record(t, u, x, quantum=quantum)


def coverage(given: Namespace) -> None:
    """Share of 90 % intervals that cover the truth, over seeded repeats."""
    repeats, conditions = given.repeats, given.condition
    print(f"90 % intervals of fit, {repeats} records each: cover the truth; median error, and half")
    print("an interval in per cent of the value; the fit says that the model does not fit")
    for condition in conditions:
        names = ["mass", "viscous", "coulomb"]
        start, said, scale = time.perf_counter(), 0, []
        if "Stribeck" in condition:
            names += ["stribeck.excess", "stribeck.speed"]
        hits, drawn, errors = [], [], []
        for seed in range(repeats):
            case, record = spoiled(seed, condition)
            if "Stribeck" in condition and not case.actual["stribeck"]:
                continue
            axis = believed(case).replace(mass=1.1 * case.actual["mass"])
            found = fit(axis, record, names, starts=1)
            true = np.array([values(case)[name] for name in names])
            ends, again = (np.array([e[n] for n in names]) for e in
                           (found.interval(), found.bootstrap()))  # fmt: skip
            hits.append((ends[:, 0] <= true) & (true <= ends[:, 1]))
            drawn.append((again[:, 0] <= true) & (true <= again[:, 1]))
            errors.append(np.abs([found.parameters[n] for n in names] / true - 1.0))
            scale.append(0.5 * (ends[:, 1] - ends[:, 0]) / true)
            said += any(m.startswith("the model does not fit") for m in found.messages)
        print(f"{condition} ({len(hits)} records, {time.perf_counter() - start:.0f} s; "
              f"does not fit: {said})")  # fmt: skip
        rows = (np.mean(hits, axis=0), np.mean(drawn, axis=0), np.median(errors, axis=0),
                np.median(scale, axis=0))  # fmt: skip
        for name, hit, redrawn, error, half in zip(names, *(100 * r for r in rows), strict=True):
            print(f"  {name:16s} {hit:5.1f} %, bootstrap {redrawn:5.1f} %; error {error:.3f} %, "
                  f"half {half:.3f} %")  # fmt: skip


def believed(case: truth.Case) -> dfc.FrictionAxis:
    """The bench's axis without what is hidden in it."""
    a = case.actual
    stribeck = dfc.Stribeck(**a["stribeck"]) if a["stribeck"] else None
    return dfc.FrictionAxis(
        mass=a["mass"], viscous=a["viscous"], coulomb=a["coulomb"], stribeck=stribeck,
        stick_speed=a["stick_speed"], travel=a["travel"],
    )  # fmt: skip


def values(case: truth.Case) -> dict[str, float]:
    """True parameters by their names in a fit."""
    a = case.actual
    peak = {f"stribeck.{n}": v for n, v in (a["stribeck"] or {}).items()}
    return {n: a[n] for n in ("mass", "viscous", "coulomb")} | peak


def coverage_map(given: Namespace) -> None:
    """The same of a Coulomb map from a crawl."""
    hits = []
    for seed in range(given.repeats):
        record, level = crawl(seed)
        levels = identify_coulomb(record, degree=2, axis=BENCH)
        for place in (0.05, 0.15, 0.25):
            for s in (1, -1):
                low, high = levels.band([place], s)
                hits.append(bool(low[0] <= level(place, s) <= high[0]))
    print(f"90 % intervals of a Coulomb map at six places, {given.repeats} crawls: "
          f"{100 * np.mean(hits):.1f} %")  # fmt: skip


def coverage_stribeck(given: Namespace) -> None:
    """The same with the Stribeck peak free, on records of 20 s with crawls."""
    names = ("mass", "viscous", "coulomb", "stribeck.excess", "stribeck.speed")
    hits: dict[str, list[bool]] = {name: [] for name in names}
    start, repeats = time.perf_counter(), 2 * given.repeats
    for seed in range(repeats):
        case = truth.make_null(seed)
        a = case.actual
        if not a["stribeck"] or case.unit != "m":
            continue
        rng = np.random.default_rng(seed)
        noisy = case.x + 80e-6 * rng.standard_normal(case.x.size)
        axis = believed(case).replace(mass=1.1 * a["mass"])
        ends = fit(axis, Record(case.t, case.u, noisy, quantum=0.0), names, starts=1).interval()
        for name in names:
            low, high = ends[name]
            hits[name].append(bool(low <= values(case)[name] <= high))
    count = len(hits["mass"])
    print(f"90 % intervals, Stribeck peak free, {count} axes of {repeats} seeds have one "
          f"({time.perf_counter() - start:.0f} s)")  # fmt: skip
    for name, found in hits.items():
        print(f"  {name:32s} {100 * np.mean(found):5.1f} %")


def bench(given: Namespace) -> None:
    """Levels and ripple from a crawl of the independent bench, over seeds."""
    from test_identification import AXIS, PLACES
    from test_identification import bench as crawling
    from test_identification import level as true

    for title, options in (
        ("smooth", {"excess": 0.0}),
        ("stick-slip, vs 0.01 m/s", {}),
        ("stiffer loop", {"omega": 25.0}),
        ("encoder of 20 um", {"quantum": 2e-5}),
        ("30 s in place of 60 s", {"duration": 30.0}),
    ):
        worst = []
        for seed in range(6):
            levels = identify_coulomb(crawling(seed, **options)[0])
            worst += [np.max(np.abs(levels(PLACES, s) / true(PLACES, s) - 1.0)) for s in (1, -1)]
        print(f"levels from the record alone, {title:24s} worst error {100 * max(worst):.2f} %")
    for options in ({"speed": 0.03}, {}, {"speed": 0.02, "excess": 0.15}, {"omega": 6.0}):
        for seed in range(2):
            record, loop = crawling(seed, **options)
            start = time.perf_counter()
            levels = identify_coulomb(record, axis=AXIS)
            found = identify_stribeck(levels.apply(AXIS), record, loop)
            seconds = time.perf_counter() - start
            one, other = found.measured, found.replayed
            assert one is not None
            off = "no ripple" if other is None else (
                f"amplitude {100 * (other.amplitude / one.amplitude - 1):+.1f} %, period "
                f"{100 * (other.period / one.period - 1):+.1f} %"
            )  # fmt: skip
            low, high = found.fit.interval()["stick_speed"]
            print(
                f"ripple, seed {seed}, {options}: {off}; sigma {found.stribeck.excess:.3f}, vs "
                f"{found.stribeck.speed:.4f}, Sigma {low:.1g} to {high:.1g} m/s ({seconds:.1f} s)"
            )


BENCH = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0, travel=(0.0, 0.3))


def crawl(seed: int):  # type: ignore[no-untyped-def]
    """Smooth crawl of the independent bench, and its true level."""
    rng = np.random.default_rng(seed)
    plant = truth.Plant(
        mass=2.0, viscous=15.0, coulomb=8.0, asymmetry=0.1, slope=0.2, curvature=-0.1,
        middle=0.15, half_travel=0.15,
    )  # fmt: skip
    n = 20_000
    t = 1e-3 * np.arange(n)
    reference = np.interp(t, [0.0, 10.0, 20.0], [0.0, 0.3, 0.0])
    zero = np.zeros(n)
    noise = 5e-6 * rng.standard_normal(n)
    u, y, _ = truth.closed_loop(
        plant, reference, 1e-3, 30, 288.0, 576.0, 19.2, 3e-3, 40.0, 5e-6, noise, zero, zero, zero
    )

    def level(x: float, s: int) -> float:
        q = (x - 0.15) / 0.15
        return float(8.0 * (1.0 + 0.1 * s) * (1.0 + 0.2 * q - 0.1 * q**2))

    return Record(t, u, y, reference, quantum=5e-6), level


def force_error(axis: dfc.FrictionAxis, record: Record) -> float:
    """Relative force error [%]: zero-phase Butterworth at 100 Hz, decimated by 10.

    ||u - (m a + friction(x, v) - effects)|| / ||u||, with filtered position and
    central differences; with these numbers least squares on the whole record
    gives back the published parameters.
    """
    b, a = butter(4, 2.0 * 100.0 * record.dt)
    x = filtfilt(b, a, record.x)
    v = np.gradient(x, record.dt)
    acceleration = np.gradient(v, record.dt)
    direction = np.where(v > 0.0, 1, -1)
    needed = axis.mass * acceleration - net_force(axis, 0.0 * v, x, v, 0.0 * v, direction)
    thin = [decimate(y, 10, zero_phase=True)[7:-7] for y in (record.u, needed)]
    return float(100.0 * np.linalg.norm(thin[0] - thin[1]) / np.linalg.norm(thin[0]))


def emps(given: Namespace) -> None:
    """EMPS: parameters, held-out errors, relative force errors."""
    if not measured.EMPS.exists():
        print("EMPS: no record at", measured.EMPS)
        return
    record = dfc.datasets.emps(measured.EMPS)
    train, test = record.split(0.6)
    loop = dfc.PositionController(
        kp=160.18 * 243.45 * 35.1507, ki=0.0, kd=243.45 * 35.1507, dt=1e-3, limit=351.507, span=2
    )
    published = dfc.FrictionAxis(
        mass=95.11, viscous=203.5, coulomb=20.39, effects=(dfc.effects.BiasForce(3.16),)
    )
    print("EMPS: relative force error by the published measure")
    print(f"{'':36s} whole record  held out  closed loop: force error")
    print("published, symmetric / asymmetric     4.08 / 3.11 %")
    loop_error = replay_loop(published, record, loop).relative_force
    print(f"{'published parameters, our measure':36s} {force_error(published, record):8.2f} %"
          f"{'':13s} {100 * loop_error:6.2f} %")  # fmt: skip
    believed = dfc.FrictionAxis(mass=70.0, viscous=100.0, coulomb=10.0)
    mapped = believed.replace(coulomb=dfc.CoulombMap([10.0, 0.0, 0.0]), travel=(-0.01, 0.26))
    base = ("mass", "viscous", "coulomb", "bias_force")
    sided = (*base, "viscous_asymmetry")
    found = {}
    for title, axis, free in (
        ("symmetric", believed, base),
        ("asymmetric", believed, sided),
        ("asymmetric, input shift", believed, (*sided, "input_shift")),
        ("asymmetric, levels over position", mapped,
         ("mass", "viscous", "coulomb_map", "viscous_asymmetry")),
    ):  # fmt: skip
        start = time.perf_counter()
        whole = found[title] = fit(axis, record, free, starts=1)
        trained = fit(whole.axis, train, free, starts=1)
        error = force_error(whole.axis, record), force_error(trained.axis, test)
        again = replay_loop(whole.axis, record, loop).relative_force
        print(f"{title:36s} {error[0]:8.2f} %    {error[1]:6.2f} % {100 * again:6.2f} %"
              f"  ({time.perf_counter() - start:.1f} s)")  # fmt: skip
    published_values = dict(zip(base, (95.11, 203.5, 20.39, 3.16), strict=True))
    for title in ("symmetric", "asymmetric", "asymmetric, input shift"):
        print(f"\n{title}: value, standard error (published)")
        fitted = found[title]
        for name, value in fitted.parameters.items():
            known = published_values.get(name.partition(".")[0])
            beside = f"({known:g})" if known is not None and title == "symmetric" else ""
            print(f"  {name:28s} {value:10.4g} +- {fitted.standard_errors[name]:.2g} "
                  f"{fitted.units[name]} {beside}")  # fmt: skip


def bam(given: Namespace) -> None:
    """Servo pendulum: fitted at kp = 100, tested at kp = 400."""
    machine = measured.pendulum()
    if not machine.train:
        print("BAM: no logs at", measured.PENDULUM)
        return
    free = ("mass", "viscous", "coulomb", "input_gain", "gravity.phase", "input_delay")
    for title, names in (
        ("gravity, back-EMF, Coulomb, input delay", free),
        ("and load dependence", (*free, "load_dependence")),
    ):
        begun = time.perf_counter()
        found = fit(machine.axis, machine.train, names)
        print(f"\nBAM: {title} ({time.perf_counter() - begun:.1f} s)")
        for name, value in found.parameters.items():
            print(f"  {name:32s} {value:10.4g} +- {found.standard_errors[name]:.2g}")
        squares, ends = [], []
        for trajectory, record in machine.test:
            run = found.replay(record)
            whole = found.axis.simulate(record.u, record.dt, x0=float(record.x[0]))
            error = float(np.sqrt(np.mean((whole.y[0] - record.x) ** 2)))
            squares.append(run.rms**2)
            ends.append(error**2)
            print(f"  held out {trajectory:18s} windows of 0.25 s: RMS {run.rms:.4f} rad, median "
                  f"{run.median:.4f}; whole log, open loop: {error:.3g} rad")  # fmt: skip
        print(f"  all held-out logs: windows {np.sqrt(np.mean(squares)):.4f} rad, whole logs "
              f"{np.sqrt(np.mean(ends)):.3g} rad")  # fmt: skip


if __name__ == "__main__":
    warnings.simplefilter("ignore", FitWarning)  # they are in the summaries
    print_tables(
        __doc__,
        {
            "emps": emps,
            "bam": bam,
            "bench": bench,
            "coverage": coverage,
            "map": coverage_map,
            "stribeck": coverage_stribeck,
        },
        {
            "--repeats": (200, "records of each condition"),
            "--condition": (tuple(CONDITIONS), "of coverage"),
        },
        default=("emps", "bam", "bench", "coverage", "map"),
    )
