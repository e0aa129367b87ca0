"""The certificate: an independent check, spoiled designs, bounds from below."""

import dataclasses
import functools
import itertools

import numpy as np
import pytest
import scipy.linalg

from dryfric_control import FrictionAxis
from dryfric_control.observer import CertificateError, design_pi_observer
from dryfric_control.observer.certificate import LEAST_MARGIN, Block, check_blocks
from dryfric_control.observer.error_model import ErrorModel
from dryfric_control.observer.switching import best_gain, path_of

DT = 1e-3
AXIS = FrictionAxis(mass=1.0, viscous=0.4, coulomb=8.0, stick_rate=500.0, stick_speed=1e-4)
SPEC = {
    "uncertainty": 1.0, "noise": 1e-4, "drift": 0.0, "decay": 0.995,
    "performance": (0.0, 1.0, 0.0), "discretization": "euler", "form": "prediction",
}  # fmt: skip
CURRENT = SPEC | {"form": "current"}
CASES = {
    "paper": {"method": "paper", **SPEC},
    "slack": {"method": "slack", **SPEC},
    "path": {"method": "path", "window": 3, **SPEC},
    "refined": {"method": "path", "window": 2, "refine": 2, **SPEC},
    "all channels": {"encoder_quantum": 1e-6, "discretization": "euler", "form": "prediction"},
    "zero-order hold": {"form": "prediction"},
    "uneven": {"uncertainty": {0: 1.0, 1: 1.0, -1: 1.5}, "encoder_quantum": 1e-6},
    "no rate": {"decay": 1.0, "method": "path", "window": 2, "form": "prediction"},
    "current, paper": {"method": "paper", **CURRENT},
    "current, slack": {"method": "slack", **CURRENT},
    "current, path": {"method": "path", "window": 2, "refine": 1, **CURRENT},
    "current, all channels": {"encoder_quantum": 1e-5},
    "current, no rate": {"decay": 1.0, "method": "path", "window": 2},
}


@functools.cache
def designed(case):
    """A design of the table, or one drawn at random."""
    if isinstance(case, str):
        return design_pi_observer(AXIS, DT, **CASES[case])
    rng = np.random.default_rng([1311, case])
    dt = 10.0 ** rng.uniform(-4.0, -2.7)
    mass = 10.0 ** rng.uniform(-2.0, 1.5)
    level = mass * 10.0 ** rng.uniform(-0.5, 1.0)
    off = 0.1 * level
    uneven = {0: off, 1: off, -1: 1.5 * off if rng.random() < 0.5 else off}
    axis = FrictionAxis(
        mass=mass, viscous=mass * 10.0 ** rng.uniform(-1.0, 1.0), coulomb=level,
        stick_rate=rng.uniform(0.05, 0.9) / dt, stick_speed=1e-4,
    )  # fmt: skip
    method, window = (("slack", None), ("paper", None), ("path", 3), ("path", 2))[case % 4]
    return design_pi_observer(
        axis, dt, method=method, window=window, uncertainty=uneven,
        form=("current", "prediction")[case // 2 % 2],
        discretization=("euler", "zoh")[int(rng.integers(2))],
        encoder_quantum=10.0 ** rng.uniform(-7.0, -5.0),
    )  # fmt: skip


@pytest.fixture(scope="module", params=CASES)
def design(request):
    return designed(request.param)


def open_loop(design, node):
    """Error dynamics without a gain in SI units, written out anew from the axis."""
    mode = design.graph.labels[node]
    m, f, p = design.axis.mass, design.axis.viscous, design.axis.stick_rate
    rate = p if mode == 0 else f / m
    continuous = np.array([[0.0, 1.0, 0.0], [0.0, -rate, 1.0 / m], [0.0, 0.0, 0.0]])
    if design.discretization == "euler":
        A = np.eye(3) + design.dt * continuous
        push = A[:2, 2].copy()
    else:
        A = scipy.linalg.expm(design.dt * continuous)
        continuous[1, 1] = -f / m
        push = scipy.linalg.expm(design.dt * continuous)[:2, 2]
        A[:2, 2] = push
    columns = [np.append(push * design.uncertainty[mode], 0.0), np.zeros(3)]
    if design.drift:
        columns.append(np.array([0.0, 0.0, design.drift]))
    q = np.array(design.performance)
    return A, np.array(columns).T, np.diag(q)[q != 0.0]


def closed_loop(design, node, after=None):
    """Error dynamics of one step; the mode lasts unless another node comes after.

    In the current form the correction follows the step: its error is what remains
    of the error before, less the gain times the noise of the new reading.
    """
    A, W, Z = open_loop(design, node)
    noise = np.zeros(W.shape[1])
    noise[1] = design.noise
    if design.form == "prediction":
        L = design.node_gains[node]
        return A - np.outer(L, [1.0, 0.0, 0.0]), W - np.outer(L, noise), Z
    M = design.node_gains[node if after is None else after]
    keep = np.eye(3) - np.outer(M, [1.0, 0.0, 0.0])
    return keep @ A, keep @ W - np.outer(M, noise), Z


def steps(design):
    """Changes of memory that the observer's own table allows, from modes that have lasted."""
    table, found, todo = design.transition_table(), set(), [*map(int, design.resting_nodes())]
    while todo:
        before = todo.pop()
        new = {(before, int(after)) for after in table[before]} - found
        found |= new
        todo += [after for _, after in new]
    return found


@pytest.mark.parametrize("case", [*CASES, *range(8)])
def test_every_step_holds_by_an_independent_check(case):
    """Scipy alone: generalized eigenvalues of the quadratic forms in SI units."""
    design = designed(case)
    assert steps(design) == set(design.graph.edges)
    T = np.diag(1.0 / design.state_scale)
    P = [design.output_scale**-2 * T @ X @ T for X in design.lyapunov]
    Q = [T @ X @ T for X in design.lyapunov_decay]
    largest = []
    for i, j in steps(design):
        F, G, Z = closed_loop(design, i, j)
        step, quiet = np.hstack([F, G]), np.eye(G.shape[1])
        # Energy after and the output, in units of energy before plus supply, stay below 1.
        after = step.T @ P[j] @ step + scipy.linalg.block_diag(Z.T @ Z, 0.0 * quiet)
        before = scipy.linalg.block_diag(P[i], design.gamma**2 * quiet)
        largest.append(scipy.linalg.eigh(after, before, eigvals_only=True)[-1])
        if design.decay < 1.0:
            ratio = scipy.linalg.eigh(F.T @ Q[j] @ F, Q[i], eigvals_only=True)[-1]
            largest.append(ratio / design.decay**2)
    assert max(largest) < 1.0
    # Rounding of 3 x 3 factors with condition numbers up to 1e4.
    assert 1.0 - max(largest) == pytest.approx(design.certificate.margin, rel=1e-3, abs=1e-6)


def test_report_says_what_was_checked(design):
    check = design.certificate
    kinds = {block.kind for block in check.blocks}
    assert kinds == ({"gain", "decay"} if design.decay < 1.0 else {"gain"})
    assert len(check.blocks) == len(kinds) * len(design.graph.edges)
    assert max(block.eigenvalue for block in check.blocks) == -check.margin < 0.0
    assert check.limit <= check.lower_bound <= check.gamma == design.gamma
    if design.noise == 1e-4 and design.form == "prediction":  # the reference designs
        assert 0.0 <= check.gap < (0.05 if design.method == "paper" else 0.02)
    assert design.lower_bound == check.lower_bound

    for mode, gain in design.gains.items():
        F, _, _ = closed_loop(design, design.resting_nodes()[mode + 1])
        radius = max(abs(np.linalg.eigvals(F)))
        # the same matrix in other units: eigenvalues differ by rounding
        assert check.spectral_radius[mode] == pytest.approx(radius, rel=1e-6)
        assert radius <= design.decay
        assert np.array_equal(gain, design.node_gains[design.resting_nodes()[mode + 1]])
    again = design.check()
    # gains went to physical units and back: rounding only
    assert again.gamma == pytest.approx(check.gamma, rel=1e-12)
    assert again.margin == pytest.approx(check.margin, abs=1e-9)


def refused(design, words, **changes):
    with pytest.raises(CertificateError, match=words):
        dataclasses.replace(design, **changes).check()


def test_a_changed_design_is_refused(design):
    for element, factor in itertools.product(range(3), (0.5, 1.5)):
        gains = design.node_gains.copy()
        gains[-1, element] *= factor
        refused(design, "condition fails", node_gains=gains)
    for name in ("lyapunov", "lyapunov_decay")[: 2 if design.decay < 1.0 else 1]:
        matrices = getattr(design, name).copy()
        values, vectors = np.linalg.eigh(matrices[0])
        values[0] = -values[0]
        matrices[0] = vectors @ np.diag(values) @ vectors.T
        refused(design, "not positive definite", **{name: matrices})
    # a thousandth below what the Lyapunov matrices prove
    refused(design, r"gain condition fails.*relax", gamma=0.999 * design.gamma)
    if design.decay < 1.0:
        # no error can decay faster than the slowest pole of a lasting mode
        faster = 0.999 * max(design.certificate.spectral_radius.values())
        refused(design, r"decay condition fails.*relax decay", decay=faster)
    refused(design, "finite", gamma=float("nan"))
    refused(design, "", axis=design.axis.replace(mass=3.0 * design.axis.mass))


def lifted_gain(design, path, repeats):
    """Largest singular value of the map from all disturbances to all z."""
    pairs = zip(path, path[1:] + path[:1], strict=True)
    steps = [closed_loop(design, *pair) for pair in pairs] * repeats
    nz, nd, n = steps[0][2].shape[0], steps[0][1].shape[1], len(steps)
    T = np.zeros((n * nz, n * nd))
    states = np.zeros((3, n * nd))  # the error now, for each disturbance so far
    for k, (F, G, Z) in enumerate(steps):
        T[k * nz : (k + 1) * nz] = Z @ states
        states = F @ states
        states[:, k * nd : (k + 1) * nd] = G
    return largest_singular_value(T)


def largest_singular_value(T):
    T = T if T.shape[0] <= T.shape[1] else T.T
    last = [len(T) - 1] * 2
    return float(np.sqrt(scipy.linalg.eigh(T @ T.T, eigvals_only=True, subset_by_index=last)[0]))


def test_worst_switching_is_reached_by_an_explicit_disturbance(design):
    """The lifted operator over a finite horizon, singular values by scipy."""
    check = design.certificate
    path = path_of(design.graph, check.worst_sequence)
    period = len(path)
    reached = lifted_gain(design, path, max(2, 500 // period))
    assert reached < check.gamma
    # 500 samples see all but about 1e-3 of the gain of the endless sequence
    assert reached == pytest.approx(check.lower_bound, rel=4e-3)


def test_no_short_sequence_beats_the_one_found():
    """Every word of up to six modes, rotations and repetitions aside, against the search."""
    design = designed("slack")
    for period in range(1, 7):
        for word in itertools.product((0, 1), repeat=period):
            turned = [word[k:] + word[:k] for k in range(1, period)]
            if word >= min(turned, default=word + (0,)):
                continue
            path = path_of(design.graph, word)
            assert lifted_gain(design, path, 120 // period) < design.lower_bound


def test_limit_is_shown_by_an_invisible_disturbance(design):
    """A force whose trace in the measurement the noise cancels is invisible.

    So is its negative, and an observer has to answer both alike: its error is at
    least z on one of them.  The largest ratio of z to the force and the
    cancelling noise is therefore a bound for every observer; by scipy alone.
    """
    check = design.certificate
    model = {mode: open_loop(design, node) for node, mode in enumerate(design.graph.labels)}
    word = check.hardest_sequence * max(2, 300 // len(check.hardest_sequence))
    _, W, Z = model[word[0]]
    quiet = [k for k in range(W.shape[1]) if k != 1]
    n, nd, nz = len(word), len(quiet), Z.shape[0]
    states = np.zeros((3, n * nd))
    T, Y = np.zeros(((n + 1) * nz, n * nd)), np.zeros((n + 1, n * nd))
    for k, mode in enumerate(word):
        A, W, _ = model[mode]
        T[k * nz : (k + 1) * nz], Y[k] = Z @ states, states[0]
        states = A @ states
        states[:, k * nd : (k + 1) * nd] = W[:, quiet]
    T[n * nz :] = Z @ states
    if design.form == "current":
        Y[n] = states[0]  # the last error, too, counts after the reading
    cost = np.eye(n * nd) + Y.T @ Y / design.noise**2
    root = np.linalg.cholesky(cost)
    ratio = largest_singular_value(scipy.linalg.solve_triangular(root, T.T, lower=True))
    # 300 samples see all but about 3e-3 of the endless sequence
    assert ratio == pytest.approx(check.limit, rel=4e-3)
    assert ratio < check.limit * (1.0 + 1e-4)  # longer can only be harder


@pytest.mark.slow
def test_without_a_decay_rate_memory_approaches_the_limit():
    """What separates a design from the limit is memory, and the price of a decay rate."""
    free = SPEC | {"decay": 1.0}
    windows = (1, 3, 5)
    designs = [design_pi_observer(AXIS, DT, method="path", window=w, **free) for w in windows]
    costs = [design.certificate.cost for design in designs]
    assert np.all(np.diff(costs) < -0.05)
    assert costs[2] < 0.1


def test_best_gain_against_an_exhaustive_scalar_case():
    """A scalar integrator: gamma has a closed form.

    e+ = e + d - L (e + n), z = e, unit amplitudes.  The filter Riccati equation
    S = 1 + 1/(1/S + 1 - 1/g^2) has a positive solution with S < g^2 down to the
    g at which 1/S - 1/g^2 -> 0, that is S = g^2: g^2 = 1 + 1 = 2.
    """
    A = np.diag([1.0, 0.0, 0.0])
    W = np.zeros((3, 2))
    W[0, 0] = 1.0
    model = ErrorModel(A, W, np.array([0.0, 1.0]), np.array([[1.0, 0.0, 0.0]]))
    assert best_gain({1: model}, (1,)) == pytest.approx(np.sqrt(2.0), rel=5e-5)  # bisection width
    # After the correction X = 1/(1/S + 1 - 1/g^2) is what counts, S = 1 + X: with
    # q = 1 - 1/g^2 that is q X^2 + q X = 1, which has a solution for every g above 1.
    # Below, S grows by less than one a sample until 1/S < -q: 1e-4 in 20,000 samples.
    assert best_gain({1: model.current_form()}, (1,)) == pytest.approx(1.0, rel=2e-4)


def test_summary_says_what_is_proved():
    check = dataclasses.replace(
        design_pi_observer(AXIS, DT, **SPEC).certificate,
        gamma=3.0, lower_bound=2.0, limit=1.5, worst_sequence=(0, 0, 1, 1, 1),
        hardest_sequence=(-1,),
    )  # fmt: skip
    text = check.summary()
    assert "2 <= true gain <= 3 (gap 50.00 %)" in text
    assert "reached by repeating the modes 0 x 2, +1 x 3" in text
    assert "no observer can be below 1.5, shown by -1 x 1" in text
    assert (check.gap, check.cost) == (0.5, 1.0)
    assert dataclasses.replace(check, limit=0.0).cost == float("inf")


@pytest.mark.parametrize("eigenvalue", [-LEAST_MARGIN, 0.0, float("nan")])
def test_a_block_on_the_edge_proves_nothing(eigenvalue):
    sound, bad = Block("decay", "0", "1", -0.5), Block("gain", "1", "0", eigenvalue)
    assert check_blocks((sound,)) == 0.5
    words = r"gain condition fails from mode \(1\) to mode \(0\)"
    with pytest.raises(CertificateError, match=words):
        check_blocks((sound, bad))
