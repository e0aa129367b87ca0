"""Certified gain of the observer by method, and bounds from below.

    python benchmarks/gamma_table.py            # the table, under a minute
    python benchmarks/gamma_table.py --long     # with longer memories, minutes
    python benchmarks/gamma_table.py --scaling  # what wrong units do
    python benchmarks/gamma_table.py --time     # against plain cvxpy

Reference problem: m = 1 kg, f = 0.4 N s/m, Te = 1 ms, z = v, force uncertainty
1 N, noise 1e-4 m, decay 0.995 per sample, no drift; gamma in SI units.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
import scipy.optimize

from dryfric_control import FrictionAxis
from dryfric_control.observer import design_pi_observer
from dryfric_control.observer.certificate import Problem
from dryfric_control.observer.error_model import default_weights, error_models, mode_classes
from dryfric_control.observer.switching import allowed_pairs, window_graph
from dryfric_control.observer.synthesis import Scales, certified_solution, scales_of, solve_lmi

DT, DECAY = 1e-3, 0.995
RATES = (200.0, 500.0, 900.0)
SPEC = {
    "uncertainty": 1.0,
    "noise": 1e-4,
    "drift": 0.0,
    "decay": DECAY,
    "performance": (0.0, 1.0, 0.0),
}
#: With them, the observer as the paper samples it.
PAPER = SPEC | {"discretization": "euler", "form": "prediction"}
ROWS = [
    ("paper (Theorem 1, corrected)", {"method": "paper"}),
    ("slack", {"method": "slack"}),
    ("path, window 2", {"method": "path", "window": 2}),
    ("path, window 3", {"method": "path", "window": 3}),
    ("path, window 4", {"method": "path", "window": 4}),
    ("dwell, window 8", {"method": "dwell", "window": 8}),
    ("dwell, window 16", {"method": "dwell", "window": 16}),
]
LONG_ROWS = [
    ("path, window 4, refined", {"method": "path", "window": 4, "refine": 4}),
    ("path, window 5", {"method": "path", "window": 5}),
    ("path, window 6", {"method": "path", "window": 6}),
    ("dwell, window 16, refined", {"method": "dwell", "window": 16, "refine": 4}),
    ("dwell, window 24, refined", {"method": "dwell", "window": 24, "refine": 4}),
    ("dwell, window 24, no decay", {"method": "dwell", "window": 24, "decay": 1.0}),
]


def axis_of(rate: float) -> FrictionAxis:
    return FrictionAxis(mass=1.0, viscous=0.4, coulomb=8.0, stick_rate=rate, stick_speed=1e-4)


def models_of(axis: FrictionAxis, decay: float = DECAY, noise: float = 1e-4):
    weights = default_weights(axis, DT, **(SPEC | {"decay": decay, "noise": noise}))
    models = error_models(
        axis, DT, uncertainty=weights.uncertainty, noise=weights.noise, drift=0.0,
        performance=weights.performance,
    )  # fmt: skip
    return models, weights


def fixed_gain_optimum(rate: float, seeds: int = 3) -> float:
    """Best constant gain in the sliding mode whose poles lie within the decay.

    Every design here has one gain once sliding has lasted, so none is below.
    Three poles, searched globally; the gain on a grid of frequencies.
    """
    models, weights = models_of(axis_of(rate))
    scales = scales_of(models, weights)
    model = scales.apply(models)[1]
    circle = np.exp(1j * np.concatenate([np.geomspace(1e-4, np.pi, 400)]))
    A, C = model.A, np.array([1.0, 0.0, 0.0])
    # place poles through the characteristic polynomial (Ackermann, transposed)
    observable = np.vstack([C, C @ A, C @ A @ A])
    last = np.linalg.solve(observable, [0.0, 0.0, 1.0])

    def gain(q: np.ndarray) -> float:
        # a real pole and a pair: all stable triples within the decay circle
        real, middle, spread = DECAY * q[0], 2.0 * DECAY * q[1], DECAY**2 * q[2]
        pair = np.roots([1.0, -middle, spread])
        if np.max(np.abs(pair)) > DECAY or abs(real) > DECAY:
            return 1e3
        a = np.poly([real, *pair]).real
        L = (A @ A @ A + a[1] * A @ A + a[2] * A + a[3] * np.eye(3)) @ last
        F, G = model.closed(L)
        response = np.linalg.solve(circle[:, None, None] * np.eye(3) - F, G)
        z = model.Z @ response
        return float(np.sqrt(np.max(np.sum(np.abs(z) ** 2, axis=(1, 2)))))

    best = min(
        scipy.optimize.differential_evolution(
            gain, [(-1.0, 1.0)] * 3, seed=seed, tol=1e-10, maxiter=300, popsize=20
        ).fun
        for seed in range(seeds)
    )
    return best / scales.output


def table(rows: list[tuple[str, dict]]) -> None:
    print(
        f"{'gamma [m/s per unit of stacked disturbance]':44s}"
        + "".join(f"{f'p = {rate:g}':>30s}" for rate in RATES)
    )
    print(f"{'':44s}" + f"{'certified  reached   gap   s':>30s}" * len(RATES))
    best = dict.fromkeys(RATES, np.inf)
    free = dict.fromkeys(RATES, 0.0)
    for name, arguments in rows:
        cells = []
        for rate in RATES:
            start = time.perf_counter()
            design = design_pi_observer(axis_of(rate), DT, **(PAPER | arguments))
            spent = time.perf_counter() - start
            free[rate] = max(free[rate], design.certificate.limit)
            if design.decay < 1.0:
                best[rate] = min(best[rate], design.gamma)
            gap = 100.0 * design.certificate.gap
            cells.append(f"{design.gamma:11.5f} {design.lower_bound:.5f} {gap:5.2f}% {spent:4.1f}")
        print(f"{name:44s}" + "".join(f"{cell:>30s}" for cell in cells), flush=True)
    fixed = {rate: fixed_gain_optimum(rate) for rate in RATES}
    for name, bound in (
        ("below: no constant sliding gain, decay 0.995", fixed),
        ("below: no causal observer of any kind", free),
    ):
        print(f"{name:44s}" + "".join(f"{bound[rate]:30.5f}" for rate in RATES))
        print(
            f"{'  best certified with decay is above by':44s}"
            + "".join(f"{100.0 * (best[rate] / bound[rate] - 1.0):28.1f} %" for rate in RATES)
        )


def scaling() -> None:
    """Theorem 1 in three systems of units: what the solver says, what holds."""
    axis = axis_of(500.0)
    print("Theorem 1, p = 500, no noise, no decay rate; solver's gamma and certified gamma")
    models, weights = models_of(axis, decay=1.0, noise=0.0)
    graph = window_graph(allowed_pairs(mode_classes(weights.uncertainty), None), 1)
    for name, scales in (
        ("SI units", Scales(np.ones(3), 1.0)),
        ("per-unit states", Scales(np.array([1.0, 1.0 / DT, 1.0 / DT**2]), 1.0)),
        ("states and channels", scales_of(models, weights)),
    ):
        scaled = scales.apply(models)
        problem = Problem(scaled, graph, 1.0)
        found = solve_lmi(problem, paper=True)
        poles = max(
            np.max(np.abs(np.linalg.eigvals(scaled[key].closed(gain)[0])))
            for key, gain in zip(graph.labels, found.gains, strict=True)
        )
        try:
            _, gamma = certified_solution(problem, paper=True)
            certified = f"{gamma / scales.output:.5f}"
        except ValueError as error:
            certified = f"refused: {error}"
        print(
            f"  {name:22s} {found.status:14s} {found.gamma / scales.output:.5f}  "
            f"slowest pole {poles:.7f}  certified {certified}"
        )


def median_ms(function, repeats: int = 15) -> float:
    spent = []
    for _ in range(repeats):
        start = time.perf_counter()
        function()
        spent.append(time.perf_counter() - start)
    return 1e3 * float(np.median(spent))


def timing() -> None:
    """The `slack` design, warm, against cvxpy on the same inequalities, block by block."""
    import cvxpy as cp

    axis = axis_of(500.0)
    models, weights = models_of(axis)
    scaled = scales_of(models, weights).apply(models)
    graph = window_graph(allowed_pairs(mode_classes(weights.uncertainty), None), 1)
    design = median_ms(lambda: design_pi_observer(axis, DT, **PAPER))
    problem = Problem(scaled, graph, DECAY)
    solve = median_ms(lambda: certified_solution(problem))

    C = np.array([[1.0, 0.0, 0.0]])
    A = {k: cp.Parameter((3, 3), value=m.A) for k, m in scaled.items()}
    W = {k: cp.Parameter(m.W.shape, value=m.W) for k, m in scaled.items()}
    P, Q = ({k: cp.Variable((3, 3), symmetric=True) for k in scaled} for _ in range(2))
    S = {k: cp.Variable((3, 3)) for k in scaled}
    V = {k: cp.Variable((1, 3)) for k in scaled}
    square = cp.Variable()
    limits = [X >> 1e-8 * np.eye(3) for X in [*P.values(), *Q.values()]]
    for i, model in scaled.items():
        X, Y = A[i].T @ S[i] - C.T @ V[i], W[i].T @ S[i] - model.D[:, None] @ V[i]
        n = len(model.D)
        for j in scaled:
            gain = [[-P[i] + model.Z.T @ model.Z, np.zeros((3, n)), X]]
            gain += [[np.zeros((n, 3)), -square * np.eye(n), Y]]
            gain += [[X.T, Y.T, P[j] - S[i] - S[i].T]]
            rate = [[-(DECAY**2) * Q[i], X], [X.T, Q[j] - S[i] - S[i].T]]
            for B in (cp.bmat(gain), cp.bmat(rate)):
                limits.append((B + B.T) / 2 << -1e-8 * np.eye(B.shape[0]))
    problem = cp.Problem(cp.Minimize(square), limits)
    first = median_ms(lambda: problem.solve(solver=cp.CLARABEL), 1)
    raw = []

    def again() -> None:
        A[0].value = scaled[0].A
        problem.solve(solver=cp.CLARABEL)
        raw.append(1e3 * problem.solver_stats.solve_time)

    warm = median_ms(again)
    print("slack, p = 500, milliseconds, median of 15")
    print(f"  design_pi_observer, warm, certificate and searches included {design:8.1f}")
    print(f"  of that: solving until the certificate holds                {solve:8.1f}")
    print(f"  cvxpy, parametrised problem, first / warm              {first:6.1f} / {warm:6.1f}")
    print(f"  cvxpy, the solver alone                                     {np.median(raw):8.1f}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--long", action="store_true", help="longer memories, minutes")
    parser.add_argument("--scaling", action="store_true", help="what wrong units do")
    parser.add_argument("--time", action="store_true", help="against plain cvxpy")
    arguments = parser.parse_args()
    design_pi_observer(axis_of(500.0), DT)  # compile
    if arguments.scaling:
        scaling()
    elif arguments.time:
        timing()
    else:
        table(ROWS + (LONG_ROWS if arguments.long else []))


if __name__ == "__main__":
    main()
