"""The certificate of an observer design, recomputed from its gains.

Each inequality of the design is evaluated for each allowed step between memory states, on the
gains that will run, in its original form (no slack matrix), and made dimensionless by the Cholesky
factors of the Lyapunov matrices, so that no choice of units hides a violation.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from dryfric_control.arrays import Floats
from dryfric_control.observer.error_model import ErrorModel
from dryfric_control.observer.switching import (
    ModeGraph,
    hardest_switching,
    runs_of,
    worst_switching,
)
from dryfric_control.text import Result, documented, stated
from dryfric_control.ties import stable_order

#: Smallest margin that counts as negative: 3x3 factors with condition numbers
#: up to 1e4 leave rounding errors of about 1e-12.
LEAST_MARGIN = 1e-10
#: Room left above the smallest gamma the Lyapunov matrices prove.
HEADROOM = 1e-6


class CertificateError(ValueError):
    """A design, or a file of one, fails its certificate.

    Examples
    --------
    A promise that the gains do not keep is refused:

    >>> from dataclasses import replace
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    >>> design = dfc.design_pi_observer(axis, dt=1e-3, encoder_quantum=1e-6)
    >>> try:
    ...     replace(design, gamma=0.5 * design.gamma).check()
    ... except dfc.CertificateError as problem:
    ...     print(str(problem)[:24])
    the gain condition fails
    """


@dataclass(frozen=True)
class Block:
    """One inequality of the certificate, from memory state to memory state."""

    kind: str  # "gain" or "decay"
    before: str
    after: str
    eigenvalue: float  # largest of the dimensionless block; must be negative


@documented
@dataclass(frozen=True, repr=False)
class Certificate(Result):
    """Certified and reached gain of a design.

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=1.0, viscous=0.4, coulomb=8.0,
    ...                         stick_rate=500.0, stick_speed=1e-4)
    >>> check = dfc.design_pi_observer(axis, dt=1e-3).certificate
    >>> check.limit <= check.lower_bound <= check.gamma
    True
    """

    gamma: float = stated("Certified gain from the stacked disturbances to z, SI units.")
    lower_bound: float = stated("Gain actually reached along `worst_sequence`.")
    worst_sequence: tuple[int, ...] = stated("Repeated sequence of modes found by search.")
    limit: float = stated("Lower limit of the gain of any causal observer, with or without decay.")
    hardest_sequence: tuple[int, ...] = stated("Repeated sequence of modes that shows it.")
    decay: float = stated("Certified decay of the error per sample; 1 if none was asked for.")
    spectral_radius: dict[int, float] = stated("Largest pole magnitude of each mode when it lasts.")
    margin: float = stated("Smallest distance of a block's largest eigenvalue from zero.")
    blocks: tuple[Block, ...] = stated("Every block evaluated.")

    @property
    def gap(self) -> float:
        """Relative distance from the gain reached to the gain certified."""
        return self.gamma / self.lower_bound - 1.0

    @property
    def cost(self) -> float:
        """Relative distance from the limit of any observer."""
        return self.gamma / self.limit - 1.0 if self.limit else float("inf")

    def _summary_parts(self) -> Iterator[str]:
        radii = (f"mode {signed(m)}: {r:.5f}" for m, r in self.spectral_radius.items())
        yield (
            f"gain  {self.lower_bound:.6g} <= true gain <= {self.gamma:.6g} "
            f"(gap {100 * self.gap:.2f} %)"
        )
        yield f"      reached by repeating the modes {_run_lengths(self.worst_sequence)}"
        shown = _run_lengths(self.hardest_sequence)
        yield f"      no observer can be below {self.limit:.6g}, shown by {shown}"
        yield f"decay {self.decay:.6g} per sample for every allowed switching"
        yield f"poles {', '.join(radii)}"
        yield f"check {len(self.blocks)} inequalities hold with margin {self.margin:.3g}"


def signed(mode: int) -> str:
    """A mode as text: 0, +1 or -1."""
    return f"{mode:+d}" if mode else "0"


def _run_lengths(word: tuple[int, ...]) -> str:
    return ", ".join(f"{signed(key)} x {n}" for key, n in runs_of(word))


@dataclass(frozen=True)
class Problem:
    """What gains have to meet: error dynamics by class, allowed steps, decay per sample."""

    models: Mapping[int, ErrorModel]
    graph: ModeGraph
    decay: float

    def steps(
        self, gains: Floats, factors: Floats
    ) -> Iterator[tuple[int, int, Floats, Floats, Floats, Floats]]:
        """Each step i to j, its closed F and G, R_i^-T, and Z R_i^-T."""
        for i, j in self.graph.edges:
            model = self.models[self.graph.labels[i]]
            F, G = model.closed_loop(gains[model.node(i, j)])
            inverse = np.linalg.inv(factors[i]).T
            yield i, j, F, G, inverse, model.Z @ inverse


def _factors(matrices: Floats, graph: ModeGraph, what: str) -> Floats:
    result = np.empty_like(matrices)
    for k, P in enumerate((matrices + matrices.transpose(0, 2, 1)) / 2.0):
        try:
            result[k] = np.linalg.cholesky(P)
        except np.linalg.LinAlgError:
            raise CertificateError(
                f"the Lyapunov matrix of the {what} condition at memory state ({graph.names[k]}) "
                "is not positive definite: relax decay, or design again"
            ) from None
    return result


def proved_gain(problem: Problem, gains: Floats, lyapunov: Floats) -> float:
    """Smallest gamma that given Lyapunov matrices prove."""
    graph = problem.graph
    worst = 0.0
    factors = _factors(lyapunov, graph, "gain")
    for i, j, F, G, inverse, out in problem.steps(gains, factors):
        step = factors[j].T @ F @ inverse
        enter = factors[j].T @ G
        kept = np.eye(3) - out.T @ out - step.T @ step
        if np.linalg.eigvalsh(kept)[0] < LEAST_MARGIN:
            raise CertificateError(
                f"from ({graph.names[i]}) to ({graph.names[j]}) the error energy does not "
                "decrease: no gamma is certified; relax decay or the uncertainty, or design again"
            )
        total = np.eye(3) + step @ np.linalg.solve(kept, step.T)
        worst = max(worst, float(np.linalg.eigvalsh(enter.T @ total @ enter)[-1]))
    return float(np.sqrt(worst)) * (1.0 + HEADROOM)


def evaluate_blocks(
    problem: Problem,
    gains: Floats,
    gamma: float,
    lyapunov: Floats,
    lyapunov_decay: Floats,
) -> tuple[Block, ...]:
    """Largest eigenvalue of every inequality, from the gains."""
    # With P = R R' the gain block of a step i to j is, dimensionless,
    # T'T + U'U - I, T = R_j' [F R_i^-T, G / gamma], U = [Z R_i^-T, 0].
    graph = problem.graph
    decay = problem.decay
    P = _factors(lyapunov, graph, "gain")
    Q = _factors(lyapunov_decay, graph, "decay") if decay < 1.0 else P
    blocks = []

    def add(kind: str, i: int, j: int, T: Floats, U: Floats) -> None:
        top = np.linalg.eigvalsh(T.T @ T + U.T @ U - np.eye(T.shape[1]))[-1]
        blocks.append(Block(kind, graph.names[i], graph.names[j], float(top)))

    for i, j, F, G, inverse, out in problem.steps(gains, P):
        T = P[j].T @ np.hstack([F @ inverse, G / gamma])
        add(
            "gain",
            i,
            j,
            T,
            np.hstack([out, np.zeros((len(out), G.shape[1]))]),
        )
        if decay < 1.0:
            T = Q[j].T @ F @ np.linalg.inv(Q[i]).T / decay
            add("decay", i, j, T, np.zeros((1, 3)))
    return tuple(blocks)


def check_blocks(blocks: tuple[Block, ...]) -> float:
    """Margin by which all inequalities hold."""
    # what is not a number is no proof: the worst of all, wherever it stands in the list
    sizes = [np.inf if np.isnan(b.eigenvalue) else b.eigenvalue for b in blocks]
    worst = blocks[stable_order([-size for size in sizes])[0]]
    if not worst.eigenvalue < -LEAST_MARGIN:
        relax = (
            "relax decay towards 1"
            if worst.kind == "decay"
            else "the stated gamma does not hold; relax gamma, uncertainty or noise"
        )
        raise CertificateError(
            f"the {worst.kind} condition fails from mode ({worst.before}) to mode "
            f"({worst.after}): largest eigenvalue {worst.eigenvalue:.3g}, must be below "
            f"{-LEAST_MARGIN:.0e}; {relax}, or design again"
        )
    return -worst.eigenvalue


def certificate_of(
    problem: Problem,
    classes: Mapping[int, int],
    gains: Floats,
    gamma: float,
    lyapunov: Floats,
    lyapunov_decay: Floats,
    unit: float,
) -> Certificate:
    """Certificate of a design, or an error that says what fails."""
    models = problem.models
    graph = problem.graph
    if not (np.all(np.isfinite(gains)) and np.isfinite(gamma) and gamma > 0.0):
        raise CertificateError(
            f"gains and gamma must be finite numbers, got gamma = {gamma!r}: design again"
        )
    blocks = evaluate_blocks(problem, gains, gamma, lyapunov, lyapunov_decay)
    margin = check_blocks(blocks)
    resting = graph.resting()
    radius = {}
    for mode, key in classes.items():
        F, _ = models[key].closed_loop(gains[resting[key]])
        radius[mode] = float(np.max(np.abs(np.linalg.eigvals(F))))
    lower, sequence = worst_switching(models, graph, gains, gamma)
    limit, hardest = hardest_switching(models, graph, gamma)
    gains_found = (
        gamma * unit,
        lower * unit,
        sequence,
        limit * unit,
        hardest,
    )
    return Certificate(*gains_found, problem.decay, radius, margin, blocks)
