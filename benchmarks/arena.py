"""Which observer follows velocity and friction best, over plants it does not know.

Run ``python benchmarks/arena.py``; words pick observers by name, ``--budget N`` sets the
tuning; ``--wild N`` runs the hybrid filter alone on N random plants.  Three families of
plants (the clutch actuator on one increment, a stage on 1 um and on 20 um), five records
each: the nominal plant and four at random, with levels, mass,
viscous friction, Stribeck peak and stick speed off.  Every peer is tuned per family, with
the same budget, on one more plant that is not scored: half of the budget by a Sobol
sequence over the ranges, half by a random walk from the best.  The package's observers run
with their defaults; "tuned" rows give them the same tuning.

Columns, median of the five: RMS velocity error over the velocity's RMS, RMS friction error
while the plant slides over the Coulomb level, the same in the 30 ms after each start of
motion, samples in another mode, records of 15 on which the row is best in velocity, time a
sample (process time, best of three).
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import observer_peers as peers
import scipy.stats
from plain_estimators import OneModeObserver

import dryfric_control as dfc
from dryfric_control import presets
from dryfric_control.observer import filter_reference
from dryfric_control.observer.error_model import axis_matrices
from dryfric_control.observer.monte_carlo import Mismatch

DT = 1e-3
SETTLED = 200  # samples before the errors count
START = 30  # samples that count as the start of a motion
STAGE = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0, stick_speed=1e-3)


@dataclass(frozen=True)
class Case:
    """One closed-loop record of a plant, and what the observers are told of it."""

    family: str
    name: str
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
        return float(np.mean(self.nominal.coulomb(np.zeros(1), 1)))


def stage_reference(seed: int) -> np.ndarray:
    """Crawl, sine, steps and a slow triangle, 12 s."""
    a = np.random.default_rng(seed).uniform(0.8, 1.2, 8)
    t = np.arange(12000) * DT
    crawl = np.interp(t, [0.25, 1.5, 1.8, 3.0], [0, 2.5e-3 * a[0], 2.5e-3 * a[0], 0.5e-3])
    sine = 0.5e-3 + 0.02 * a[1] * np.sin(2 * np.pi * 0.75 * a[2] * (t - 3))
    steps = np.where((t - 7) % 1.0 < 0.5, 0.05 * a[3], 0.01 * a[4])
    triangle = np.interp(t, [10, 10.5, 11, 11.5, 12], [0, 0.01 * a[5], 0, 0.02 * a[6], 0])
    parts = [t < 3, t < 7, t < 10]
    return filter_reference(np.select(parts, [crawl, sine, steps], triangle), 40.0, DT)


#: The stage as it is when nothing but the Stribeck peak is unknown, and to tune on.
TRUE = STAGE.replace(stribeck=dfc.Stribeck(0.3, 0.01), stick_speed=2e-3)
TRAINING = TRUE.replace(coulomb=(8.6, 7.6), mass=2.1, stribeck=dfc.Stribeck(0.25, 0.012))


def stage(plant: dfc.FrictionAxis | np.random.Generator, quantum: float, seed: int) -> Case:
    """The stage, as given or with everything off at random."""
    if isinstance(plant, np.random.Generator):
        rng = plant
        plus, minus = 8 * rng.uniform(0.8, 1.2), 8 * rng.uniform(0.8, 1.2)
        mass = rng.uniform(0.85, 1.15)
        excess, viscous, speed = rng.uniform(0.02, 0.6), rng.uniform(0.8, 1.2), rng.uniform(0.5, 2)
        plant = dfc.FrictionAxis(
            coulomb=(plus, minus),
            mass=2 * mass,
            viscous=15 * viscous,
            stribeck=dfc.Stribeck(excess, 0.01 * speed),
            stick_speed=1e-3 * rng.uniform(1, 3),
        )
    controller = dfc.PositionController.from_bandwidth(STAGE, 25.0, DT, limit=80.0)
    family = f"stage, {quantum * 1e6:g} um"
    return Case(family, str(seed), plant, STAGE, controller, stage_reference(seed), quantum)


def clutch(plant: dfc.FrictionAxis, seed: int | None = None) -> Case:
    """The clutch actuator of the presets."""
    _, r = presets.crawl_and_steps()
    if seed is not None:
        r = r * np.random.default_rng(seed).uniform(0.8, 1.1)
    reference = filter_reference(r, presets.CORNER, DT)
    nominal, controller = presets.clutch_observer_axis(), presets.clutch_controller()
    return Case("clutch", str(seed), plant, nominal, controller, reference, presets.QUANTUM)


def families() -> dict[str, tuple[Case, list[Case]]]:
    """For each family the plant to tune on, and those that are scored."""
    rng = np.random.default_rng(42)
    design = presets.clutch_observer()
    peak = presets.clutch_actuator().stribeck.speed
    drawn = [clutch(Mismatch.draw(rng).plant(design, design.axis, peak), 100 + k) for k in range(4)]
    train = clutch(Mismatch(0.95, 1.08, 1.05, 0.25, 0.6).plant(design, design.axis, peak), 7)
    result = {"clutch": (train, [clutch(presets.clutch_actuator()), *drawn])}
    for quantum in (1e-6, 2e-5):
        train = stage(TRAINING, quantum, 1)
        scored = [stage(TRUE, quantum, 2), *(stage(rng, quantum, 100 + k) for k in range(4))]
        result[train.family] = train, scored
    return result


def score(case: Case, rows: np.ndarray) -> dict[str, float]:
    """Errors of an estimate, rows position, velocity, friction, mode."""
    _, v, friction, mode = case.record[:4]
    late = np.arange(v.size) >= SETTLED
    slides = (mode != 0) & late
    starts = np.flatnonzero((mode[1:] != 0) & (mode[1:] != mode[:-1])) + 1
    near = np.zeros(v.size, bool)
    for k in starts:
        near[k : k + START] = True
    low, high = case.plant.travel or (-math.inf, math.inf)
    places = np.clip(case.record[0][slides], low, high)
    ahead = mode[slides] > 0
    level = np.mean(np.where(ahead, case.plant.coulomb(places, 1), case.plant.coulomb(places, -1)))

    def rms(error: np.ndarray) -> float:
        return float(np.sqrt(np.mean(error**2)))

    return {
        "velocity": rms((v - rows[1])[late]) / rms(v[late]),
        "friction": rms((friction - rows[2])[slides]) / level,
        "start": rms((friction - rows[2])[slides & near]) / level,
        "mode": float(np.mean((mode != rows[3])[late])),
    }


def loss(errors: dict[str, float]) -> float:
    """What the tuning minimises."""
    value = math.log(errors["velocity"] * errors["friction"]) + 0.5 * math.log(
        errors["mode"] + 0.003
    )
    return value if math.isfinite(value) else 50.0


Estimate = Callable[[Case, list[float]], Callable[[], np.ndarray]]


@dataclass(frozen=True)
class Observer:
    """One row of the table: ranges of its numbers, and how it is made with them."""

    name: str
    ranges: list[tuple[float, float]]
    make: Estimate


def peer(kind: int, band: int | None, own: Callable[[Case, list[float]], list[float]]) -> Estimate:
    """A peer of `observer_peers`; number `band` of its numbers is the band of rest."""

    def make(case: Case, th: list[float]) -> Callable[[], np.ndarray]:
        axis, p = case.nominal, np.zeros(peers.SIZE)
        p[[peers.DT, peers.M, peers.FV, peers.Q]] = DT, axis.mass, axis.viscous, case.quantum
        p[[peers.LO, peers.HI]] = axis.travel or (-1e9, 1e9)
        for place, level in ((peers.CP, axis.coulomb.plus), (peers.CM, axis.coulomb.minus)):
            p[place : place + len(level)] = level
        p[peers.BAND] = axis.stick_speed * (1.0 if band is None else th[band])
        numbers = own(case, th)
        p[peers.OWN : peers.OWN + len(numbers)] = numbers

        def estimate() -> np.ndarray:
            out = np.empty((4, case.record.shape[1]))
            with np.errstate(all="ignore"):
                peers.run(kind, p, case.record[4], case.record[5], out)
            return np.nan_to_num(out, nan=1e9, posinf=1e9, neginf=-1e9)

        return estimate

    return make


def linear(case: Case, walk: float = 0.0, bandwidth: float = 0.0) -> list[float]:
    """Kalman filter with a random-walk force, or an extended state observer."""
    A2, E = axis_matrices(case.nominal, 1, DT, "zoh")
    A = np.block([[A2, E[:, None]], [np.zeros((1, 2)), np.ones((1, 1))]])
    if walk:
        noise = case.quantum / math.sqrt(12.0)
        gain = np.array(OneModeObserver.kalman(case.nominal, DT, noise, walk, 1.0).gain)
    else:
        unit = np.array([1.0, 1.0 / DT, case.nominal.mass / DT**2])
        scaled = A * unit / unit[:, None]
        C = np.array([[1.0, 0.0, 0.0]])
        R = scaled - math.exp(-bandwidth * DT) * np.eye(3)  # three equal poles, Ackermann
        seen = np.vstack([C, C @ scaled, C @ scaled @ scaled])
        gain = (R @ R @ R @ np.linalg.solve(seen, [0.0, 0.0, 1.0])) * unit
    return [A[0, 1], A[1, 1], E[0], E[1], *np.linalg.solve(A, gain)]


def rest(case: Case) -> float:
    return 2.0 * case.nominal.stick_speed


def pull(case: Case) -> float:
    return case.level / case.nominal.mass


def switched(case: Case, th: list[float], **options: str) -> Callable[[], np.ndarray]:
    """The switched PI observer; numbers scale drift, noise and stick speed."""
    axis, given = case.nominal, {"encoder_quantum": case.quantum} | options
    design = dfc.design_pi_observer(axis, DT, **given)
    if th:
        given |= {"drift": design.drift * th[0], "noise": design.noise * th[1]}
        design = dfc.design_pi_observer(axis, DT, stick_speed=axis.stick_speed * th[2], **given)
    u, y = case.record[4:6]
    return lambda: dfc.observe(design, u, y, encoder_quantum=case.quantum).outputs[[0, 1, 2, 4]]


def hybrid(case: Case, th: list[float], known: bool = False) -> Callable[[], np.ndarray]:
    """The hybrid filter; numbers scale what it expects to be wrong."""
    names = ("excess", "excess_speed", "level_walk", "force_noise", "mass_error")
    axis = case.plant if known else case.nominal
    default = dfc.hybrid_filter(axis, DT, case.quantum)
    given = {name: getattr(default, name) * f for name, f in zip(names, th, strict=False)}
    observer = dfc.hybrid_filter(axis, DT, case.quantum, **given)
    return lambda: observer.run(*case.record[4:6]).outputs[[0, 1, 2, 4]]


BAND = (0.2, 30.0)
OBSERVERS = [
    Observer("hybrid filter, default", [], hybrid),
    Observer("hybrid filter, tuned", [(0.3, 3.0)] * 5, hybrid),
    Observer("hybrid filter, knows the plant", [], lambda c, th: hybrid(c, th, known=True)),
    Observer("switched PI, default", [], switched),
    Observer("switched PI, tuned", [(0.1, 10.0), (0.2, 5.0), (0.2, 5.0)], switched),
    Observer("switched PI, prediction", [], lambda c, th: switched(c, th, form="prediction")),
    Observer("filtered difference", [(3e-4, 3e-2), BAND], peer(0, 1, lambda c, th: [th[0]])),
    Observer(
        "Kalman, random-walk force",
        [(1e-4, 1.0), BAND],
        peer(1, 1, lambda c, th: linear(c, walk=th[0] * c.level)),
    ),
    Observer(
        "extended state observer",
        [(20.0, 900.0), BAND],
        peer(1, 1, lambda c, th: linear(c, bandwidth=th[0])),
    ),
    Observer(
        "disturbance observer",
        [(20.0, 900.0), (50.0, 2000.0), BAND],
        peer(2, 2, lambda c, th: th[:2]),
    ),
    Observer(
        "Levant differentiator",
        [(0.01, 100.0), (1e-3, 3e-2), (3e-4, 1e-2), BAND],
        peer(3, 3, lambda c, th: [th[0] * pull(c) / 0.01, *th[1:3]]),
    ),
    Observer(
        "super-twisting, model",
        [(0.03, 30.0), (1e-3, 5e-2), (0.1, 10.0), BAND],
        peer(4, 3, lambda c, th: [th[0] * pull(c), th[1], th[2] * rest(c)]),
    ),
    Observer(
        "high gain, model",
        [(1e-3, 5e-2), (1e-3, 5e-2), (0.1, 10.0), BAND],
        peer(5, 3, lambda c, th: [th[0], th[1], th[2] * rest(c)]),
    ),
    Observer(
        "reduced order (Ruderman)",
        [(20.0, 1500.0), (0.02, 2.0), (0.1, 100.0), BAND],
        peer(
            6,
            3,
            lambda c, th: [
                th[0],
                -0.25 * th[1] * th[0] ** 2 * c.nominal.mass,
                10.0 * th[2] * c.quantum,
            ],
        ),
    ),
    Observer(
        "EKF on LuGre",
        [(0.3, 100.0), (1e-3, 0.3), (1e-4, 0.1), (0.2, 3.0), BAND],
        peer(7, 4, lambda c, th: [th[0] * c.quantum, *th[1:4]]),
    ),
    Observer(
        "IMM, three modes",
        [(1e-4, 0.3), (0.2, 2.0), (1e-3, 0.2), (0.01, 1.0)],
        peer(8, None, lambda c, th: th),
    ),
]


def tune(observer: Observer, case: Case, budget: int, seed: int = 0) -> list[float]:
    """Numbers with the least loss on one record, after `budget` evaluations."""
    if not observer.ranges:
        return []
    low, high = np.log(observer.ranges).T
    rng = np.random.default_rng(seed)

    def evaluate(z: np.ndarray) -> float:
        try:
            return loss(score(case, observer.make(case, np.exp(z).tolist())()))
        except (ValueError, np.linalg.LinAlgError):
            return 60.0  # numbers with which there is no such observer

    first = scipy.stats.qmc.Sobol(len(low), seed=seed).random_base2(7)[: budget // 2]
    start = low + (high - low) * first
    values = [evaluate(z) for z in start]
    best, least, step = start[int(np.argmin(values))], min(values), 0.15 * (high - low)
    for _ in range(budget - len(values)):
        z = np.clip(best + step * rng.standard_normal(len(low)), low, high)
        value = evaluate(z)
        if value < least:
            best, least = z, value
        else:
            step = step * 0.96
    return np.exp(best).tolist()


def rows(names: list[str], budget: int) -> Iterator[tuple[str, str, list[dict[str, float]]]]:
    """Family, observer and its errors on every record."""
    every = families()
    for observer in OBSERVERS:
        if names and not any(name in observer.name for name in names):
            continue
        for family, (train, scored) in every.items():
            numbers = tune(observer, train, budget)
            errors = []
            for case in scored:
                estimate = observer.make(case, numbers)
                one = score(case, estimate())
                times = []
                for _ in range(3):
                    begin = time.process_time()
                    estimate()
                    times.append(time.process_time() - begin)
                errors.append(one | {"us": 1e6 * min(times) / case.record.shape[1]})
            yield family, observer.name, errors


def wild(count: int) -> None:
    """The hybrid filter on random plants, every other far from the nominal one."""
    rng = np.random.default_rng(5)
    errors, broken = [], 0
    for k in range(count):
        quantum = 10 ** rng.uniform(-9, -3.5)
        plant = rng
        if k % 2:
            plant = dfc.FrictionAxis(
                mass=2 * rng.uniform(0.5, 2),
                viscous=15 * rng.uniform(0.1, 5),
                coulomb=8 * rng.uniform(0.4, 2),
                stribeck=dfc.Stribeck(rng.uniform(0.02, 1), 10 ** rng.uniform(-4, -1)),
                stick_speed=10 ** rng.uniform(-5, -2.5),
            )
        case = stage(plant, quantum, k)
        estimate = dfc.hybrid_filter(STAGE, DT, quantum).run(*case.record[4:6])
        every = (estimate.outputs, estimate.vhat_sd, estimate.log_likelihood)
        broken += not all(np.isfinite(one).all() for one in every)
        errors.append(score(case, estimate.outputs[[0, 1, 2, 4]])["velocity"])
    middle, most, worst = 100 * np.quantile(errors, (0.5, 0.95, 1.0))
    print(f"{count} closed loops, encoders of 1 nm to 0.3 mm: {broken} with a number that is none")
    print(f"velocity error: median {middle:.2f} %, 95 % {most:.2f} %, largest {worst:.1f} %")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", help="part of an observer's name")
    parser.add_argument("--budget", type=int, default=80, help="evaluations to tune with")
    parser.add_argument("--wild", type=int, default=0, help="random loops, for robustness alone")
    given = parser.parse_args()
    if given.wild:
        wild(given.wild)
        return
    found: dict[str, dict[str, list[dict[str, float]]]] = {}
    for family, name, errors in rows(given.names, given.budget):
        found.setdefault(name, {})[family] = errors
        middle = {key: np.median([one[key] for one in errors]) for key in errors[0]}
        print(
            f"{family:13s} {name:31s} velocity {100 * middle['velocity']:6.3f} %  friction "
            f"{100 * middle['friction']:6.2f} %  start {100 * middle['start']:6.1f} %  mode "
            f"{100 * middle['mode']:5.2f} %  {middle['us']:6.3f} us",
            flush=True,
        )
    print("\nrecords on which each is best in velocity, of", sum(map(len, errors_of(found))))
    rivals = {name for name in found if "knows" not in name and "tuned" not in name}
    rivals |= {name for name in found if name.startswith("switched")}
    best = [
        min(rivals, key=lambda name: found[name][family][k]["velocity"])
        for family in next(iter(found.values()))
        for k in range(len(next(iter(found.values()))[family]))
    ]
    for name in sorted(set(best), key=best.count, reverse=True):
        print(f"{best.count(name):3d}  {name}")


def errors_of(found: dict) -> list[list[dict[str, float]]]:
    """Errors of the first observer, family by family."""
    return list(next(iter(found.values())).values())


if __name__ == "__main__":
    main()
