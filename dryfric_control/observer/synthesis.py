"""Gains of the switched PI observer by the linear matrix inequalities of the theory page.

Each allowed step from memory node i to node j asks for P > 0, Q > 0 with
|e+|^2_Pj - |e|^2_Pi + |z|^2 - gamma^2 |d|^2 < 0 and, for d = 0, |e+|^2_Qj < alpha^2 |e|^2_Qi,
written with slack matrices (Daafouz, Riedinger and Iung, IEEE Trans. Automatic Control 47(11),
2002).  Every error is measured in the amount by which the disturbances alone move it, and z in
units of the gain no observer can beat: gamma is then a number a little above 1.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from dryfric_control.arrays import Floats
from dryfric_control.observer import certificate
from dryfric_control.observer.certificate import CertificateError, Problem
from dryfric_control.observer.error_model import ErrorModel, Weights
from dryfric_control.observer.switching import best_gain
from dryfric_control.text import page_reference

SOLVERS = ("clarabel", "scs")
#: Strictness asked of the solver, raised until the certificate holds; the first-order
#: solver starts from the third, its own accuracy being no better.
MARGINS = (1e-8, 1e-7, 1e-6, 1e-5)

_SYMMETRIC = np.zeros((6, 3, 3))
for _k, (_r, _c) in enumerate(zip(*np.triu_indices(3), strict=True)):
    _SYMMETRIC[_k, _r, _c] = _SYMMETRIC[_k, _c, _r] = 1.0
_FULL = np.eye(9).reshape(9, 3, 3)
_COLUMN = np.eye(3)


class InfeasibleError(ValueError):
    """The solver proved that no design exists."""


@dataclass(frozen=True)
class Scales:
    """Units of position, speed and friction error, shape (3,), and factor of z."""

    state: Floats
    output: float

    def apply(self, models: Mapping[int, ErrorModel]) -> dict[int, ErrorModel]:
        """Scaled error dynamics of each class."""
        return {key: model.in_units(self.state, self.output) for key, model in models.items()}

    def physical_gains(self, gains: Floats) -> Floats:
        """Gains in physical units from scaled ones, shape (n, 3)."""
        return gains * self.state / self.state[0]

    def scaled_gains(self, gains: Floats) -> Floats:
        """Scaled gains from those in physical units, shape (n, 3)."""
        return gains * self.state[0] / self.state


def scales_of(models: Mapping[int, ErrorModel], weights: Weights) -> Scales:
    """Scales that make the design problem a matter of numbers near 1."""
    # With the natural frequency beta per sample, an uncertain force d moves the velocity estimate
    # by about dt d / (m sqrt(beta)), the position by 1 / beta samples of that.
    force = max(weights.uncertainty.values())
    speed = force * weights.kick / np.sqrt(weights.bandwidth)
    state = np.array([speed * weights.dt / weights.bandwidth, speed, force])
    state[0] = max(state[0], weights.noise)
    size = max(float(np.linalg.norm(model.Z * state)) for model in models.values())
    # in these units the bisection takes the same steps whatever the user counts in
    sized = {key: model.in_units(state, 1.0 / size) for key, model in models.items()}
    limit = max(best_gain(sized, (key,)) for key in sized)
    # with nothing but a friction error in z, and no drift, the limit is zero
    return Scales(state, 1.0 / (limit * size) if limit > 1e-6 else 1.0 / size)


@dataclass(frozen=True)
class Candidate:
    """What the solver proposes; the certificate decides."""

    gamma: float
    gains: Floats  # shape (nnodes, 3), in the units of the models given
    lyapunov: Floats  # shape (nnodes, 3, 3)
    lyapunov_decay: Floats  # of the decay condition
    status: str  # the solver's word


def _block(
    model: ErrorModel,
    slack: Floats,
    symmetric: bool,
    factor: float,
    performance: bool,
) -> tuple[Floats, Floats]:
    """Coefficients of one inequality for P_i, the slack, V, P_j (and gamma^2)."""
    # With slack matrix S' = K Y, K = `slack` fixed and Y unknown, and V' = K v: both inequalities
    # of a node share Y and v, and L = Y^-1 v in each.
    nd = model.W.shape[1] if performance else 0
    n = 6 + nd
    last = slice(n - 3, n)
    basis = slack @ (_SYMMETRIC if symmetric else _FULL)
    column = _COLUMN @ slack.T
    ns = len(basis)
    out = np.zeros((6 + ns + 3 + 6 + performance, n, n))
    out[:6, :3, :3] = -factor * _SYMMETRIC
    s = slice(6, 6 + ns)
    v = slice(6 + ns, 9 + ns)
    out[s, :3, last] = (basis @ model.A).transpose(0, 2, 1)
    out[v, :3, last] = -model.C[None, :, None] * column[:, None, :]
    if performance:
        out[s, 3 : 3 + nd, last] = (basis @ model.W).transpose(0, 2, 1)
        out[v, 3 : 3 + nd, last] = -model.D[None, :, None] * column[:, None, :]
        out[-1, 3 : 3 + nd, 3 : 3 + nd] = -np.eye(nd)
    upper = out[6 : 9 + ns]
    out[6 : 9 + ns] = upper + upper.transpose(0, 2, 1)
    out[s, last, last] = -basis - basis.transpose(0, 2, 1)
    out[9 + ns : 15 + ns, last, last] = _SYMMETRIC
    constant = np.zeros((n, n))
    if performance:
        constant[:3, :3] = model.Z.T @ model.Z
    return out, constant


class _Inequality(NamedTuple):
    """Demand that ``constant + sum_k x[places[k]] columns[k]`` is negative: few entries a block.

    cvxpy then has little to analyse, for two memory states as for hundreds.
    """

    places: NDArray[np.intp]
    columns: Floats
    constant: Floats


def _minimise(
    size: int,
    last: int,
    blocks: Sequence[_Inequality],
    margin: float,
    solver: str,
) -> tuple[Floats, str]:
    """Unknowns x, shape (size,), with the smallest x[last] subject to ``block + margin I <= 0``."""
    import cvxpy as cp

    x = cp.Variable(size)
    constraints = []
    for places, columns, constant in blocks:
        n = constant.shape[0]
        entries = sp.csr_array(columns.reshape(len(places), n * n).T)
        matrix = cp.reshape(entries @ x[places] + constant.ravel(), (n, n), order="C")
        constraints.append(matrix << -margin * np.eye(n))
    problem = cp.Problem(cp.Minimize(x[last]), constraints)
    # SCS is a first-order method: at its own tolerances its answer fails the certificate.
    options: dict[str, Any] = {"solver": cp.CLARABEL}
    if solver == "scs":
        options = {
            "solver": cp.SCS,
            "eps_abs": 1e-7,
            "eps_rel": 1e-7,
            "max_iters": 200_000,
        }
    with warnings.catch_warnings():
        # "The solution may be inaccurate": the certificate decides that here.
        warnings.simplefilter("ignore", UserWarning)
        try:
            problem.solve(**options)
        except cp.SolverError as problem_found:
            return np.full(size, np.nan), str(problem_found)
    values = np.full(size, np.nan) if x.value is None else np.asarray(x.value)
    return values, str(problem.status)


def solve_lmi(
    problem: Problem,
    *,
    paper: bool = False,
    around: Candidate | None = None,
    solver: str = "clarabel",
    margin: float = 1e-8,
) -> Candidate:
    """Solve the design inequalities once."""
    models = problem.models
    graph = problem.graph
    decay = problem.decay
    nodes = len(graph.labels)
    with_decay = decay < 1.0
    separate = with_decay and not paper
    offsets = {"P": 0, "Q": 6 if separate else 0}
    slack_at = 0 if paper else (12 if separate else 6)
    gain_at = 6 if paper else slack_at + 9
    size = gain_at + 3
    acts = np.arange(slack_at, gain_at + 3)  # slack and gain stand side by side
    blocks: list[_Inequality] = []
    identity = np.eye(3)
    level = 1.0
    if around is not None:
        # the decay condition fixes its matrices up to a factor only
        level = float(np.trace(around.lyapunov.sum(0)) / np.trace(around.lyapunov_decay.sum(0)))
    cache: dict[tuple[int, bool], tuple[Floats, Floats]] = {}

    def block(i: int, j: int, performance: bool) -> tuple[Floats, Floats]:
        model = models[graph.labels[i]]
        factor = 1.0 if performance else decay**2
        if around is not None:
            at = around.lyapunov[j] if performance else level * around.lyapunov_decay[j]
            return _block(model, at, paper, factor, performance)
        key = (graph.labels[i], performance)
        if key not in cache:
            cache[key] = _block(model, identity, paper, factor, performance)
        return cache[key]

    def index(i: int, j: int, name: str) -> NDArray[np.intp]:
        here = i * size
        there = j * size
        acting = models[graph.labels[i]].node(i, j) * size
        own = offsets[name] + np.arange(6)
        return np.concatenate([here + own, acting + acts, there + own])

    for i in range(nodes):
        for start in sorted(set(offsets.values())):
            at = i * size + start + np.arange(6)
            blocks.append(_Inequality(at, -_SYMMETRIC, np.zeros((3, 3))))
    last = nodes * size
    for i, j in graph.edges:
        blocks.append(_Inequality(np.append(index(i, j, "P"), last), *block(i, j, True)))
        if with_decay:
            blocks.append(_Inequality(index(i, j, "Q"), *block(i, j, False)))

    x, status = _minimise(last + 1, last, blocks, margin, solver)
    if status == "infeasible" or not np.all(np.isfinite(x)) or x[-1] <= 0.0:
        raise InfeasibleError(f"no design exists, says the solver ({status})")
    table = x[:-1].reshape(nodes, size)

    def symmetric(start: int) -> Floats:
        return np.einsum("nk,kij->nij", table[:, start : start + 6], _SYMMETRIC)

    P = symmetric(offsets["P"])
    Q = symmetric(offsets["Q"])
    Y = P if paper else table[:, slack_at : slack_at + 9].reshape(nodes, 3, 3)
    right = table[:, gain_at : gain_at + 3, None]
    gains = np.asarray(np.linalg.solve(Y, right)[:, :, 0], dtype=np.float64)
    return Candidate(float(np.sqrt(x[-1])), gains, P, Q, status)


def certified_solution(
    problem: Problem,
    *,
    paper: bool = False,
    refine: int = 0,
    solver: str = "clarabel",
) -> tuple[Candidate, float]:
    """Solve until the gains that come out prove what they promise."""
    best: tuple[Candidate, float] | None = None
    for _ in range(refine + 1):
        around = best[0] if best else None
        try:
            found = _proven_candidate(problem, paper, around, solver)
        except (CertificateError, InfeasibleError) as failure:
            if best is None:
                raise ValueError(_blocking_specification(problem, paper, solver)) from failure
            break
        if best is not None and found[1] >= best[1]:
            break
        best = found
    assert best is not None
    return best


def _proven_candidate(
    problem: Problem, paper: bool, around: Candidate | None, solver: str
) -> tuple[Candidate, float]:
    """A solution and the gain it proves, at the smallest strictness with which it does."""
    failure: CertificateError
    for margin in MARGINS if solver == "clarabel" else MARGINS[2:]:
        found = solve_lmi(
            problem,
            paper=paper,
            around=around,
            solver=solver,
            margin=margin,
        )
        gains = found.gains
        proofs = (found.lyapunov, found.lyapunov_decay)
        try:
            gamma = certificate.proved_gain(problem, gains, found.lyapunov)
            blocks = certificate.evaluate_blocks(problem, gains, gamma, *proofs)
            certificate.check_blocks(blocks)
        except CertificateError as error:
            failure = error
        else:
            return found, gamma
    raise failure


def _blocking_specification(problem: Problem, paper: bool, solver: str) -> str:
    """Which specification stands in the way."""
    decay = problem.decay
    mend = "or use more memory (method='path', a longer window)" + page_reference("observer")
    with suppress(ValueError):
        if decay < 1.0:
            certified_solution(replace(problem, decay=1.0), paper=paper, solver=solver)
            return (
                f"decay = {decay:.6g} per sample cannot be certified for every allowed switching; "
                f"relax decay towards 1, {mend}"
            )
    return (
        "no gain can be certified for the allowed changes of mode; forbid some by pairs, lower "
        f"stick_rate, {mend}"
    )
