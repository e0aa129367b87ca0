"""Observers: accuracy, certified gain, and time of a sample (all but `robust`: 2 min).

    python benchmarks/observer.py loop     closed loop of the presets, 12 s
    python benchmarks/observer.py robust   the same on 500 random plants, 4 min; --plot FILE
    python benchmarks/observer.py arena    observers on 15 records, each tuned, 1 min
    python benchmarks/observer.py effects  an observer that knows the effects of an axis, 14 s
    python benchmarks/observer.py gamma    certified gain by method, 17 s
    python benchmarks/observer.py speed    time of a sample, and of a design, 5 s

`loop` and `robust` print position error [increments], velocity error over the velocity's RMS,
friction error and bias while sliding over the Coulomb level, samples in another mode.  Estimators
that are not of the package are tuned on that very record, so they are at their best.

`arena` takes three families of plants (clutch actuator on one increment, a stage on 1 um and on
20 um), five records each: the nominal plant and four at random.  Rows marked "tuned", and all
that are not of the package, get ``--budget`` evaluations on one more plant of the family.  It
prints medians of RMS velocity error, RMS friction error while sliding, samples in another mode,
and processor time a sample.

`gamma`: m = 1 kg, f = 0.4 N s/m, Te = 1 ms, z = v, force uncertainty 1 N, noise 1e-4 m, decay
0.995 a sample; certified gain, gain reached by the worst switching found, and the limit of any
observer, for three rates at which a stuck axis decays.
"""

from __future__ import annotations

import math
from argparse import Namespace
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path

import control as ct
import numpy as np
import observer_peers as peers
import scipy.stats
from harness import Table, print_tables, shortest_time

import dryfric_control as dfc
from dryfric_control import presets
from dryfric_control.compiled.windowed_runs import NO_FORCE
from dryfric_control.observer import filter_reference, score_estimate, simulate_observed_loop
from dryfric_control.observer.monte_carlo import Estimator, Mismatch, SwitchedEstimator

DT = 1e-3
#: Samples before the errors of the arena count.
SETTLED = 200
STAGE = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0, stick_speed=1e-3)
#: The stage as it is when nothing but the Stribeck peak is unknown, and that to tune on.
TRUE_STAGE = STAGE.replace(stribeck=dfc.Stribeck(0.3, 0.01), stick_speed=2e-3)
TRAINING_STAGE = TRUE_STAGE.replace(
    coulomb=(8.6, 7.6), mass=2.1, stribeck=dfc.Stribeck(0.25, 0.012)
)


# ------------------------------------------------------------ loop and robust


@dataclass(frozen=True)
class PlainEstimator:
    """An estimator of `observer_peers` on the clutch actuator; it starts at its first reading."""

    kind: str
    numbers: tuple[float, ...]
    band: float = 75.0

    def estimate(self, u: np.ndarray, y: np.ndarray, xhat0: float = 0.0) -> np.ndarray:
        """Rows xhat, vhat, Fhat, what (none), mode."""
        axis = presets.clutch_observer_axis()
        rows = peers.estimates(self.kind, axis, DT, presets.QUANTUM, self.band, self.numbers, u, y)
        return np.insert(rows, 3, np.nan, axis=0)


def tuned(candidates: list[PlainEstimator], figure: str) -> PlainEstimator:
    """The candidate with the smallest figure on the nominal record, its band of rest tuned, too."""
    run = presets.clutch_experiment()
    u, y = run.plant.y[4].copy(), run.plant.y[5].copy()

    def error(name: str, candidate: PlainEstimator) -> float:
        rows = candidate.estimate(u, y)
        return float(getattr(score_estimate(run.axis, DT, run.plant.y, rows), name))

    best = min(candidates, key=partial(error, figure))
    bands = [replace(best, band=band) for band in np.geomspace(5.0, 3000.0, 41)]
    return min(bands, key=partial(error, "commutation"))


def estimators() -> dict[str, Estimator]:
    """The switched observer, the paper's, and tuned estimators without modes."""
    design = presets.clutch_observer()
    printed = presets.clutch_observer(discretization="euler", form="prediction", method="paper")
    axis = presets.clutch_observer_axis()
    differences = [PlainEstimator("difference", (time,)) for time in np.geomspace(3e-4, 3e-2, 41)]
    filters = [
        PlainEstimator("linear", peers.kalman(axis, DT, presets.QUANTUM, walk))
        for walk in np.geomspace(1e-4, 1.0, 41)
    ]
    one_mode = PlainEstimator("linear", peers.linear(axis, DT, design.gains[1]))
    switched = partial(SwitchedEstimator, encoder_quantum=presets.QUANTUM)
    return {
        "switched": switched(design, "reading"),
        "switched, paper's rule": switched(design, "paper"),
        "paper throughout": switched(printed, "paper"),
        "filtered difference": tuned(differences, "speed"),
        "one mode, no switching": tuned([one_mode], "speed"),
        "Kalman, best speed": tuned(filters, "speed"),
        "Kalman, best friction": tuned(filters, "friction"),
    }


def loop_table(given: Namespace) -> None:
    """Errors on the closed loop of the presets."""
    run = presets.clutch_experiment()
    u, y = run.plant.y[4].copy(), run.plant.y[5].copy()
    shares = dict.fromkeys(("velocity %", "friction %", "bias %", "mode %"), "11.2f")
    table = Table({"": "24s", "position inc": "13.2f"} | shares)
    for name, estimator in estimators().items():
        rows = estimator.estimate(u, y, xhat0=presets.FIRST_ESTIMATE)
        s = score_estimate(run.axis, DT, run.plant.y, rows)
        shown = 100.0 * np.array([s.speed, s.friction, s.friction_bias, s.commutation])
        table.row(name, s.position, *shown)


def robust_table(given: Namespace) -> None:
    """The same over random mismatches, plants of 12 s."""
    found = presets.clutch_monte_carlo(runs=given.runs, estimators=estimators())
    print(f"\n{found.summary()}")
    if given.plot:
        found.plot().figure.savefig(given.plot, dpi=110)
    mild = np.array([mismatch.excess < 0.05 for mismatch in found.mismatches])
    errors = 100.0 * found.scores["switched"][:, 4]
    for words, chosen in (("below 5 %", mild), ("above", ~mild)):
        if chosen.any():
            share = np.quantile(errors[chosen], 0.95)
            print(f"mode errors of 'switched', Stribeck excess {words}: 95 % at {share:.2f} %")


# ---------------------------------------------------------------------- arena


@dataclass(frozen=True)
class Case:
    """One closed-loop record of a plant, and what the observers know of it."""

    family: str
    plant: dfc.FrictionAxis
    nominal: dfc.FrictionAxis
    controller: dfc.PositionController
    reference: np.ndarray
    quantum: float

    @cached_property
    def record(self) -> np.ndarray:
        """Rows x, v, F, mode, u, y."""
        run = dfc.simulate_loop(self.plant, self.controller, self.reference, quantum=self.quantum)
        return np.ascontiguousarray(run.outputs)

    @property
    def level(self) -> float:
        """Nominal Coulomb level [N]."""
        return float(self.nominal.coulomb(0.0, 1))


def stage_reference(seed: int) -> np.ndarray:
    """Crawl, sine, steps and a slow triangle, 12 s."""
    a = np.random.default_rng(seed).uniform(0.8, 1.2, 8)
    t = np.arange(12000) * DT
    crawl = np.interp(t, [0.25, 1.5, 1.8, 3.0], [0, 2.5e-3 * a[0], 2.5e-3 * a[0], 0.5e-3])
    sine = 0.5e-3 + 0.02 * a[1] * np.sin(2 * np.pi * 0.75 * a[2] * (t - 3))
    steps = np.where((t - 7) % 1.0 < 0.5, 0.05 * a[3], 0.01 * a[4])
    triangle = np.interp(t, [10, 10.5, 11, 11.5, 12], [0, 0.01 * a[5], 0, 0.02 * a[6], 0])
    return filter_reference(
        np.select([t < 3, t < 7, t < 10], [crawl, sine, steps], triangle), 40.0, DT
    )


def random_stage(rng: np.random.Generator) -> dfc.FrictionAxis:
    """The stage with everything off."""
    plus, minus = 8 * rng.uniform(0.8, 1.2), 8 * rng.uniform(0.8, 1.2)
    mass = 2 * rng.uniform(0.85, 1.15)
    excess, viscous, speed = rng.uniform(0.02, 0.6), rng.uniform(0.8, 1.2), rng.uniform(0.5, 2)
    return dfc.FrictionAxis(
        coulomb=(plus, minus),
        mass=mass,
        viscous=15 * viscous,
        stribeck=dfc.Stribeck(excess, 0.01 * speed),
        stick_speed=1e-3 * rng.uniform(1, 3),
    )


def stage(plant: dfc.FrictionAxis, quantum: float, seed: int) -> Case:
    """A record of the stage."""
    controller = dfc.PositionController.from_bandwidth(STAGE, 25.0, DT, limit=80.0)
    family = f"stage, {quantum * 1e6:g} um"
    return Case(family, plant, STAGE, controller, stage_reference(seed), quantum)


def clutch(plant: dfc.FrictionAxis, seed: int | None = None) -> Case:
    """A record of the clutch actuator of the presets."""
    _, r = presets.crawl_and_steps()
    if seed is not None:
        r = r * np.random.default_rng(seed).uniform(0.8, 1.1)
    reference = filter_reference(r, presets.CORNER, DT)
    nominal, controller = presets.clutch_observer_axis(), presets.clutch_controller()
    return Case("clutch", plant, nominal, controller, reference, presets.QUANTUM)


def families() -> dict[str, tuple[Case, list[Case]]]:
    """For each family the record to tune on, and those that are scored."""
    rng = np.random.default_rng(42)
    design, peak = presets.clutch_observer(), presets.clutch_actuator().stribeck.speed
    drawn = [clutch(Mismatch.draw(rng).plant(design, design.axis, peak), 100 + k) for k in range(4)]
    train = clutch(Mismatch(0.95, 1.08, 1.05, 0.25, 0.6).plant(design, design.axis, peak), 7)
    result = {"clutch": (train, [clutch(presets.clutch_actuator()), *drawn])}
    for quantum in (1e-6, 2e-5):
        train = stage(TRAINING_STAGE, quantum, 1)
        drawn = [stage(random_stage(rng), quantum, 100 + k) for k in range(4)]
        result[train.family] = train, [stage(TRUE_STAGE, quantum, 2), *drawn]
    return result


def errors(case: Case, rows: np.ndarray) -> dict[str, float]:
    """Errors of estimated rows position, velocity, friction, mode."""
    x, v, friction, mode = case.record[:4]
    late = np.arange(v.size) >= SETTLED
    slides = (mode != 0) & late
    places = np.clip(x[slides], *case.plant.travel) if case.plant.travel else x[slides]
    levels = [case.plant.coulomb(places, side) for side in (1, -1)]
    level = np.mean(np.where(mode[slides] > 0, *levels))
    return {
        "velocity": float(np.std((v - rows[1])[late]) / np.std(v[late])),
        "friction": float(np.sqrt(np.mean((friction - rows[2])[slides] ** 2)) / level),
        "mode": float(np.mean((mode != rows[3])[late])),
    }


Estimate = Callable[[], np.ndarray]


@dataclass(frozen=True)
class Row:
    """A row of the arena: ranges of its numbers, and the estimate that they give on a record."""

    name: str
    make: Callable[[Case, list[float]], Estimate]
    ranges: tuple[tuple[float, float], ...] = ()


def rows_of(observer: dfc.observer.Observer, case: Case) -> Estimate:
    """Run of an observer of the package."""
    u, y = case.record[4:6]
    return lambda: observer.run(u, y).outputs[[0, 1, 2, 4]]


def switched(case: Case, numbers: list[float], **options: str) -> Estimate:
    """The switched observer; numbers scale drift, noise and stick velocity."""
    axis, given = case.nominal, {"encoder_quantum": case.quantum} | options
    design = dfc.design_pi_observer(axis, DT, **given)
    if numbers:
        given |= {"drift": design.drift * numbers[0], "noise": design.noise * numbers[1]}
        speed = axis.stick_speed * numbers[2]
        design = dfc.design_pi_observer(axis, DT, stick_speed=speed, **given)
    return rows_of(design, case)


def hybrid(case: Case, numbers: list[float], known: bool = False) -> Estimate:
    """The hybrid filter; numbers scale what it expects to be wrong."""
    axis = case.plant if known else case.nominal
    observer = dfc.hybrid_filter(axis, DT, case.quantum)
    names = ("excess", "excess_speed", "level_walk", "force_noise", "mass_error")[: len(numbers)]
    given = {n: getattr(observer, n) * f for n, f in zip(names, numbers, strict=True)}
    return rows_of(dfc.hybrid_filter(axis, DT, case.quantum, **given), case)


def extended(case: Case, numbers: list[float], **options: bool) -> Estimate:
    """The extended state observer; numbers: bandwidth and share of the velocity of rest."""
    observer = dfc.extended_state_observer(case.nominal, DT, case.quantum, **options)
    if numbers:
        changed = {"bandwidth": numbers[0], "rest_speed": numbers[1] * observer.rest_speed}
        observer = replace(observer, **changed)
    return rows_of(observer, case)


def peer(kind: str, own: Callable[[Case, list[float]], tuple[float, ...]]) -> Callable:
    """An estimator of `observer_peers`; the last number scales the velocity of rest."""

    def make(case: Case, numbers: list[float]) -> Estimate:
        band = case.nominal.stick_speed * numbers[-1]
        given = (kind, case.nominal, DT, case.quantum, band, own(case, numbers))
        return lambda: peers.estimates(*given, *case.record[4:6])

    return make


REST = (0.2, 30.0)
ROWS = (
    Row("hybrid filter, default", hybrid),
    Row("hybrid filter, tuned", hybrid, ((0.3, 3.0),) * 5),
    Row("hybrid filter, knows the plant", partial(hybrid, known=True)),
    Row("switched PI, default", switched),
    Row("switched PI, tuned", switched, ((0.1, 10.0), (0.2, 5.0), (0.2, 5.0))),
    Row("switched PI, prediction", partial(switched, form="prediction")),
    Row("extended state, default", extended),
    Row("extended state, feedforward", partial(extended, feedforward=True)),
    Row("extended state, tuned", extended, ((20.0, 900.0), (0.2, 5.0))),
    Row("filtered difference", peer("difference", lambda c, n: (n[0],)), ((3e-4, 3e-2), REST)),
    Row(
        "Kalman, random-walk force",
        peer("linear", lambda c, n: peers.kalman(c.nominal, DT, c.quantum, n[0] * c.level)),
        ((1e-4, 1.0), REST),
    ),
    Row(
        "disturbance observer",
        peer("disturbance", lambda c, n: tuple(n[:2])),
        ((20.0, 900.0), (50.0, 2000.0), REST),
    ),
    Row(
        "Levant differentiator",
        peer("levant", lambda c, n: (n[0] * c.level / c.nominal.mass / 0.01, *n[1:3])),
        ((0.01, 100.0), (1e-3, 3e-2), (3e-4, 1e-2), REST),
    ),
    Row(
        "EKF on LuGre",
        peer("lugre", lambda c, n: (n[0] * c.quantum, *n[1:4])),
        ((0.3, 100.0), (1e-3, 0.3), (1e-4, 0.1), (0.2, 3.0), REST),
    ),
    Row(
        "IMM, three modes",
        peer("imm", lambda c, n: tuple(n[:4])),
        ((1e-4, 0.3), (0.2, 2.0), (1e-3, 0.2), (0.01, 1.0), (1.0, 1.001)),
    ),
)


def loss(row: Row, case: Case, logarithms: np.ndarray) -> float:
    """What the tuning minimises; large for numbers with which there is no such observer."""
    try:
        found = errors(case, row.make(case, np.exp(logarithms).tolist())())
    except (ValueError, np.linalg.LinAlgError):
        return 60.0
    value = np.log(found["velocity"] * found["friction"]) + 0.5 * np.log(found["mode"] + 0.003)
    return float(value) if math.isfinite(value) else 50.0


def tuned_numbers(row: Row, case: Case, budget: int) -> list[float]:
    """Numbers with the least loss on one record: half a Sobol sequence, half a random walk."""
    if not row.ranges:
        return []
    low, high = np.log(row.ranges).T
    rng = np.random.default_rng(0)
    points = scipy.stats.qmc.Sobol(len(low), seed=0).random_base2(7)[: budget // 2]
    starts = low + (high - low) * points
    losses = [loss(row, case, start) for start in starts]
    best, least = starts[int(np.argmin(losses))], min(losses)
    step = 0.15 * (high - low)
    for _ in range(budget - len(losses)):
        trial = np.clip(best + step * rng.standard_normal(len(low)), low, high)
        value = loss(row, case, trial)
        if value < least:
            best, least = trial, value
        else:
            step = 0.96 * step
    return np.exp(best).tolist()


def arena_table(given: Namespace) -> None:
    """Medians of each row in each family."""
    every = families()
    errors_of = {f"{name} [%]": "24s" for name in ("velocity", "friction", "mode")}
    table = Table({"": "32s"} | errors_of | {"us a sample": "13.3f"})
    for row in ROWS:
        medians, times = [], []
        for train, scored in every.values():
            numbers = tuned_numbers(row, train, given.budget)
            runs = [row.make(case, numbers) for case in scored]
            found = [errors(case, run()) for case, run in zip(scored, runs, strict=True)]
            medians.append({name: np.median([one[name] for one in found]) for name in found[0]})
            times += [shortest_time(runs[0], 3) / scored[0].record.shape[1]]
        cells = (" / ".join(f"{100 * one[n]:.2f}" for one in medians) for n in medians[0])
        table.row(row.name, *cells, 1e6 * np.median(times))


# -------------------------------------------------------------------- effects

#: Effects that an observer may or may not know.
EFFECTS: dict[str, tuple[dfc.effects.Effect, ...]] = {
    "spring": (dfc.effects.Spring(stiffness=40.0, rest=0.05),),
    "bias force": (dfc.effects.BiasForce(force=2.0),),
    "cogging": (dfc.effects.Cogging(amplitude=1.5, period=0.02),),
    "gravity": (dfc.effects.Gravity(amplitude=3.0, phase=1.0),),
    "Coulomb asymmetry": (dfc.effects.CoulombAsymmetry(force=2.0),),
    "position dependence": (dfc.effects.PositionDependence(slope=1.5, curvature=2.0),),
    "load dependence": (dfc.effects.LoadDependence(coefficient=0.2),),
    "input gain": (dfc.effects.InputGain(gain=0.8),),
    "input delay": (dfc.effects.InputDelay(delay=6e-3),),
    "actuator lag": (dfc.effects.ActuatorLag(time_constant=6e-3),),
    "inertia": (dfc.effects.Inertia(factor=1.4),),
}
EFFECTS["spring, bias, cogging"] = sum((EFFECTS[n] for n in list(EFFECTS)[:3]), ())


def effects_table(given: Namespace) -> None:
    """Observer of the plain axis against one that knows the effects, three references each."""
    plain = dfc.FrictionAxis(
        mass=2.0, viscous=15.0, coulomb=8.0, stribeck=dfc.Stribeck(0.1, 0.01), travel=(-0.3, 0.3)
    )
    controller = dfc.PositionController.from_bandwidth(plain, 15.0, DT, limit=60.0)
    table = Table({"": "24s"} | dict.fromkeys(("velocity error", "friction error", "mode"), "22s"))
    for name, effects in EFFECTS.items():
        plant = plain.replace(effects=effects)
        found = np.empty((2, 3, 3))
        for i, own in enumerate((plain, plant)):
            design = dfc.design_pi_observer(own, DT, encoder_quantum=1e-5)
            for seed in range(3):
                r = np.repeat(np.random.default_rng(seed).uniform(-0.2, 0.2, 24), 500)
                run = simulate_observed_loop(plant, controller, design, r, quantum=1e-5)
                found[i, seed] = run.score.speed, run.score.friction, run.score.commutation
        table.row(name, *(f"{b:.2f} -> {a:.2f} %" for b, a in 100.0 * found.mean(axis=1).T))


# ---------------------------------------------------------------------- gamma

#: The reference problem, and the observer as the paper samples it.
SPECIFICATION = {
    "uncertainty": 1.0,
    "noise": 1e-4,
    "drift": 0.0,
    "decay": 0.995,
    "performance": (0.0, 1.0, 0.0),
    "discretization": "euler",
    "form": "prediction",
}
METHODS = {
    "paper (Theorem 1, corrected)": {"method": "paper"},
    "slack": {"method": "slack"},
    **{f"path, window {n}": {"method": "path", "window": n} for n in (2, 3, 4, 6)},
    "path, window 6, no decay rate": {"method": "path", "window": 6, "decay": 1.0},
}


def gamma_axis(rate: float) -> dfc.FrictionAxis:
    """Axis of the reference problem, by the decay rate of its stuck mode [1/s]."""
    return dfc.FrictionAxis(mass=1.0, viscous=0.4, coulomb=8.0, stick_rate=rate, stick_speed=1e-4)


def gamma_table(given: Namespace) -> None:
    """Certified gain and gain reached, for three decay rates of the stuck mode."""
    axes = {rate: gamma_axis(rate) for rate in (200.0, 500.0, 900.0)}
    table = Table({"certified / reached": "32s"} | {f"p = {rate:g}": "20s" for rate in axes})
    limits = dict.fromkeys(axes, 0.0)
    for name, options in METHODS.items():
        cells = []
        for rate, axis in axes.items():
            design = dfc.design_pi_observer(axis, DT, **(SPECIFICATION | options))
            limits[rate] = max(limits[rate], design.certificate.limit)
            cells.append(f"{design.gamma:.5f} / {design.lower_bound:.5f}")
        table.row(name, *cells)
    table.row("limit of any observer", *(f"{one:.5f}" for one in limits.values()))


# ---------------------------------------------------------------------- speed


def face_times(observer: dfc.observer.Observer, u: np.ndarray, y: np.ndarray) -> dict[str, float]:
    """Time of one sample by each face of an observer [ns]."""
    count = 2000  # for the slow ones
    tables, out = observer.tables(), np.empty((u.size, observer.noutputs))
    first, stepper, block = observer.memory(y[0]), observer.stepper(), observer.block()
    t, signals = np.arange(count) * DT, np.vstack([u[:count], y[:count]])
    kernel = observer.sample_kernel.run
    works: dict[str, tuple[Callable[[], object], int]] = {
        "compiled record": (lambda: kernel(*tables, first.copy(), u, y, NO_FORCE, out), u.size),
        "run(u, y)": (lambda: observer.run(u, y), u.size),
        "stepper().step": (lambda: [stepper.step(*one) for one in signals.T], count),
        "block()": (lambda: ct.input_output_response(block, t, signals), count),
    }
    return {face: 1e9 * shortest_time(work) / samples for face, (work, samples) in works.items()}


def speed_table(given: Namespace) -> None:
    """Time of one sample by each face of each observer, and of a design."""
    run = presets.clutch_experiment()
    u, y = run.plant.y[4].copy(), run.plant.y[5].copy()
    axis = presets.clutch_observer_axis()
    table = Table({"observer": "16s", "face": "20s", "ns": "14.1f"})
    for name, observer in {
        "switched PI": presets.clutch_observer(),
        "hybrid filter": dfc.hybrid_filter(axis, DT, presets.QUANTUM),
        "extended state": dfc.extended_state_observer(axis, DT, presets.QUANTUM),
    }.items():
        for face, spent in face_times(observer, u, y).items():
            table.row(name, face, spent)
    design = shortest_time(lambda: dfc.design_pi_observer(gamma_axis(500.0), DT, **SPECIFICATION))
    table.row("switched PI", "slack design", 1e9 * design)


if __name__ == "__main__":
    print_tables(
        __doc__,
        {
            "loop": loop_table,
            "robust": robust_table,
            "arena": arena_table,
            "effects": effects_table,
            "gamma": gamma_table,
            "speed": speed_table,
        },
        {
            "--runs": (500, "plants of table robust"),
            "--plot": (Path, "picture of table robust"),
            "--budget": (80, "evaluations of a tuning"),
        },
    )
