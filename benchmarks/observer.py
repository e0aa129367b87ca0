"""How well and how fast the switched PI observer runs, against plain estimators.

Run ``python benchmarks/observer.py``; name tables to print only those: loop robust
speed.  With ``--extended`` it prints what an axis with effects gains from an observer that
knows them.  The loop is that of `dryfric_control.presets.clutch_experiment`: plant with a
Stribeck peak, observer without, other Coulomb maps, half the stick speed, encoder of one
increment, started 1000 increments off.  The plain estimators are tuned on this very record
(speed error first, then the band in which an axis counts as stuck), so they are at their
best here; the Kalman filter takes friction for a random walk and is tuned a second time,
to its friction error.  Times are the best of several repetitions, compiled code warmed up,
one thread.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

import control as ct
import numpy as np
from plain_estimators import FilteredDifference, OneModeObserver

import dryfric_control as dfc
from dryfric_control import presets
from dryfric_control.compiled.windowed_runs import NO_FORCE
from dryfric_control.observer import (
    ObserverStepper,
    design_pi_observer,
    observe,
    pi_observer,
    score_estimate,
    simulate_observed_loop,
)
from dryfric_control.observer.monte_carlo import Estimator, SwitchedEstimator
from dryfric_control.observer.runtime import first_memory, kernel, tables

DT = 1e-3
T = TypeVar("T", bound=Estimator)
START = presets.FIRST_ESTIMATE
#: What issue and README promise: position [inc], speed, friction, commutation.
TARGETS = {"position": 2.0, "speed": 0.03, "friction": 0.05, "commutation": 0.02}


def heading(text: str) -> None:
    print(f"\n{text}\n{'-' * len(text)}")


def best_of(work: Callable[[], object], repeat: int = 7) -> float:
    """Shortest processor time of some calls after a first one [s]."""
    work()
    times = []
    for _ in range(repeat):
        begin = time.process_time()
        work()
        times.append(time.process_time() - begin)
    return min(times)


def best_by(candidates: list[T], figure: str) -> T:
    """The candidate with the smallest figure on the nominal record."""
    run = presets.clutch_experiment()
    u, y = run.plant.y[4].copy(), run.plant.y[5].copy()

    def score(one: T) -> float:
        rows = one.estimate(u, y, xhat0=START)
        return float(getattr(score_estimate(run.axis, DT, run.plant.y, rows), figure))

    return min(candidates, key=score)


def estimators() -> dict[str, Estimator]:
    """The switched observer, the paper's, and the tuned plain ones."""
    design = presets.clutch_observer()
    believed = presets.clutch_observer_axis()
    difference = best_by(
        [FilteredDifference(believed, DT, tau, 75.0) for tau in np.geomspace(3e-4, 3e-2, 41)],
        "speed",
    )
    one_mode = OneModeObserver.from_design(design, 75.0)
    filters = [
        OneModeObserver.kalman(believed, DT, presets.QUANTUM / 12**0.5, walk, 75.0)
        for walk in np.geomspace(1e-4, 1.0, 41)
    ]
    bands = np.geomspace(5.0, 3000.0, 41)
    plain: dict[str, FilteredDifference | OneModeObserver] = {
        "filtered difference": difference,
        "one mode, no switching": one_mode,
        "Kalman, best speed": best_by(filters, "speed"),
        "Kalman, best friction": best_by(filters, "friction"),
    }
    tuned: dict[str, Estimator] = {
        name: best_by([replace(one, band=band) for band in bands], "commutation")
        for name, one in plain.items()
    }
    print(
        f"tuned: filter {difference.filter_time * 1e3:.2g} ms; bands "
        + ", ".join(f"{one.band:.3g}" for one in tuned.values())
        + " inc/s"
    )
    euler = presets.clutch_observer(discretization="euler")
    slower = presets.clutch_observer(drift=0.5 * design.drift)
    printed = presets.clutch_observer(discretization="euler", form="prediction", method="paper")
    q = presets.QUANTUM
    return {
        "switched": SwitchedEstimator(design, "reading", q),
        "switched, half drift": SwitchedEstimator(slower, "reading", q),
        "switched, Euler": SwitchedEstimator(euler, "reading", q),
        "switched, paper's rule": SwitchedEstimator(design, "paper", q),
        "switched, rule completed": SwitchedEstimator(design, "filippov", q),
        "paper throughout": SwitchedEstimator(printed, "paper", q),
    } | tuned


def loop_table(every: dict[str, Estimator]) -> None:
    """Figures on the paper's closed loop."""
    heading("Closed loop of section 5, 12 s")
    run = presets.clutch_experiment()
    u, y = run.plant.y[4].copy(), run.plant.y[5].copy()
    print(f"{'':24}{'position':>12}{'speed':>10}{'friction':>10}{'bias':>10}{'commutation':>13}")
    for name, one in every.items():
        s = score_estimate(run.axis, DT, run.plant.y, one.estimate(u, y, xhat0=START))
        print(
            f"{name:24}{s.position:8.2f} inc{100 * s.speed:8.2f} %{100 * s.friction:8.2f} %"
            f"{100 * s.friction_bias:+8.2f} %{100 * s.commutation:11.2f} %"
        )
    for rule in ("reading", "paper", "filippov"):
        print(f"\nswitching={rule!r}\n{presets.clutch_experiment(switching=rule).summary()}")


def robust_table(every: dict[str, Estimator], runs: int, plot: Path | None = None) -> None:
    """Monte Carlo over random mismatches."""
    heading("Random mismatches: Coulomb 20 %, inertia 15 %, Stribeck 0 to 60 %, Sigma 0.3 to 1")
    begin = time.perf_counter()
    found = presets.clutch_monte_carlo(runs=runs, estimators=every)
    spent = time.perf_counter() - begin
    print(found.summary())
    if plot:
        names = {
            "switched": "switched", "switched, paper's rule": "paper's rule",
            "filtered difference": "difference", "one mode, no switching": "one mode",
            "Kalman, best speed": "Kalman",
        }  # fmt: skip
        some = replace(found, scores={name: found.scores[one] for one, name in names.items()})
        some.plot().figure.savefig(plot, dpi=110)
    print(f"{runs} plants of 12 s, {len(every)} estimators each: {spent:.1f} s")
    print("part of the runs within the target of position, speed, friction, commutation:")
    for name, table in found.scores.items():
        within = [
            np.mean(np.abs(table[:, column]) < target)
            for column, target in zip((0, 1, 2, 4), TARGETS.values(), strict=True)
        ]
        print(f"{name:24}" + "".join(f"{100 * part:8.1f} %" for part in within))
    mild = np.array([one.excess < 0.05 for one in found.mismatches])
    worst = found.scores["switched"][:, 4]
    print(
        f"commutation of 'switched', 95 %: {100 * np.quantile(worst[mild], 0.95):.2f} % on the "
        f"{mild.sum()} plants with a Stribeck excess under 5 %, "
        f"{100 * np.quantile(worst[~mild], 0.95):.2f} % on the others"
    )


def speed_table() -> None:
    """Cost of a sample by each face of the observer."""
    heading("Cost of one sample")
    design = presets.clutch_observer()
    run = presets.clutch_experiment()
    u, y = run.plant.y[4].copy(), run.plant.y[5].copy()
    times = {}
    for rule in ("reading", "paper", "filippov"):
        table = tables(design, rule, presets.QUANTUM)
        out = np.empty((u.size, kernel.OUTPUTS))
        start = first_memory(design, START)
        times[f"compiled record, {rule!r}"] = (
            best_of(
                lambda t=table, o=out, s=start: kernel.run(*t, s.copy(), u, y, NO_FORCE, o)  # type: ignore[misc]
            )
            / u.size
        )
    times["observe(), whole call"] = best_of(lambda: observe(design, u, y)) / u.size
    stepper = ObserverStepper(design, xhat0=START)
    times["ObserverStepper.step"] = (
        best_of(lambda: [stepper.step(a, b) for a, b in zip(u[:2000], y[:2000], strict=True)], 3)
        / 2000
    )
    block, n = pi_observer(design), 2000
    t = np.arange(n) * DT
    times["python-control block"] = (
        best_of(lambda: ct.input_output_response(block, t, np.vstack([u[:n], y[:n]])), 2) / n
    )
    base = times["compiled record, 'reading'"]
    for name, spent in times.items():
        print(f"{name:32}{1e9 * spent:12.1f} ns{spent / base:12.1f} x")


#: Effects, alone and together, that an observer may or may not know.
EXTENSIONS: dict[str, tuple[dfc.effects.Effect, ...]] = {
    "spring, bias, cogging": (
        dfc.effects.Spring(stiffness=40.0, rest=0.05),
        dfc.effects.BiasForce(force=2.0),
        dfc.effects.Cogging(amplitude=1.5, period=0.02),
    ),
    "spring": (dfc.effects.Spring(stiffness=40.0, rest=0.05),),
    "bias force": (dfc.effects.BiasForce(force=2.0),),
    "cogging": (dfc.effects.Cogging(amplitude=1.5, period=0.02),),
    "gravity": (dfc.effects.Gravity(amplitude=3.0, phase=1.0),),
    "quadratic drag": (dfc.effects.QuadraticDrag(drag=30.0),),
    "viscous asymmetry": (dfc.effects.ViscousAsymmetry(viscous=5.0),),
    "Coulomb asymmetry": (dfc.effects.CoulombAsymmetry(force=2.0),),
    "position dependence": (dfc.effects.PositionDependence(slope=1.5, curvature=2.0),),
    "load dependence": (dfc.effects.LoadDependence(coefficient=0.2),),
    "drift": (dfc.effects.Drift(rate=0.05),),
    "dwell time": (dfc.effects.DwellTime(rise=3.0, time_constant=0.3),),
    "time periodic": (dfc.effects.TimePeriodic(amplitude=1.5, frequency=5.0),),
    "input gain": (dfc.effects.InputGain(gain=0.8),),
    "dead zone": (dfc.effects.DeadZone(width=2.0),),
    "saturation": (dfc.effects.Saturation(limit=14.0),),
    "input delay": (dfc.effects.InputDelay(delay=6e-3),),
    "actuator lag": (dfc.effects.ActuatorLag(time_constant=6e-3),),
    "inertia": (dfc.effects.Inertia(factor=1.4),),
    "viscous friction": (dfc.effects.ViscousFriction(factor=1.6),),
    "Coulomb level": (dfc.effects.CoulombFriction(factor=1.4),),
}


def extended_table() -> None:
    """Observer of the plain axis against one that knows the effects."""
    heading("Axis with effects, steps of 0.5 s for 12 s, encoder 10 um, three references")
    plain = dfc.FrictionAxis(
        mass=2.0, viscous=15.0, coulomb=8.0, stribeck=dfc.Stribeck(0.1, 0.01), travel=(-0.3, 0.3)
    )
    controller = dfc.PositionController.from_bandwidth(plain, 15.0, DT, limit=60.0)
    print(f"{'':24}{'speed error':>22}{'friction error':>24}{'commutation':>22}")
    for name, effects in EXTENSIONS.items():
        plant = plain.replace(effects=effects)
        found = np.empty((2, 3, 3))
        for i, own in enumerate((plain, plant)):
            design = design_pi_observer(own, DT, discretization="zoh", encoder_quantum=1e-5)
            for seed in range(3):
                r = np.repeat(np.random.default_rng(seed).uniform(-0.2, 0.2, 24), 500)
                run = simulate_observed_loop(plant, controller, design, r, quantum=1e-5)
                found[i, seed] = run.score.speed, run.score.friction, run.score.commutation
        before, after = 100.0 * found.mean(axis=1)
        print(
            f"{name:24}"
            + "".join(f"{b:11.2f} -> {a:5.2f} %" for b, a in zip(before, after, strict=True))
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("tables", nargs="*", help="loop robust speed (default: all)")
    parser.add_argument("--runs", type=int, default=500, help="plants of the Monte Carlo")
    parser.add_argument("--extended", action="store_true", help="only the axes with effects")
    parser.add_argument("--plot", type=Path, metavar="FILE", help="picture of table robust")
    given = parser.parse_args()
    if given.extended:
        extended_table()
        return
    chosen = given.tables or ["loop", "robust", "speed"]
    if {"loop", "robust"} & set(chosen):
        every = estimators()
        if "loop" in chosen:
            loop_table(every)
        if "robust" in chosen:
            robust_table(every, given.runs, given.plot)
    if "speed" in chosen:
        speed_table()


if __name__ == "__main__":
    main()
