"""The observer's certificate by another route: numpy and the gains, nothing of the package.

The observer is written out as its equations say, once for each change of mode that its own table of
transitions allows; the energy balance of every step is then an eigenvalue problem.
"""

from __future__ import annotations

import numpy as np
import pytest

import dryfric_control as dfc


def sampled(rate, mass, dt, rule):
    """One sample of ``v' = -rate v + force / mass``: matrix, and column of the force."""
    if rule == "euler":
        return np.array([[1.0, dt], [0.0, 1.0 - dt * rate]]), np.array([0.0, dt / mass])
    # A thousand steps of the midpoint rule, of error 1e-7 (rate dt)^3 at the most.
    parts = 1000
    h = dt / parts
    A, B = np.eye(2), np.zeros(2)
    for _ in range(parts):
        x, v = A
        half = v * (1.0 - 0.5 * h * rate)
        A = np.array([x + h * half, v - h * rate * half])
        half_b = B[1] * (1.0 - 0.5 * h * rate) + 0.5 * h / mass
        B = np.array([B[0] + h * half_b, B[1] + h * (1.0 / mass - rate * half_b)])
    return A, B


def error_step(design, mode, gain):
    """Error after a step as a matrix of error and disturbances (force, reading, drift).

    By the observer's own equations: the axis and the estimate are stepped side by side, from
    each unit of error, and the estimate takes the reading of its form.
    """
    axis, dt = design.axis, design.dt
    rate = axis.viscous / axis.mass if mode else axis.stick_rate
    A, _ = sampled(rate, axis.mass, dt, design.discretization)
    _, force = sampled(axis.viscous / axis.mass, axis.mass, dt, design.discretization)
    columns = []
    for k in range(6):
        unit = np.eye(6)[k]
        # The estimate is at zero: x, v and nominal minus true friction are the error.
        state, b, (push, n, drift) = unit[:2], unit[2], unit[3:]
        true = A @ state + force * (b * (mode in design.integral_modes) + push)
        if design.form == "current":
            y = true[0] + n
            estimate = np.zeros(3) + gain * y
        else:
            estimate = gain * (state[0] + n)
        columns.append(np.append(true, b + drift) - estimate)
    return np.array(columns).T


def margins(design):
    """Largest eigenvalue of every step's energy balance, over what can occur."""
    table = design.transition_table()
    scale = np.asarray(design.state_scale)
    reached, todo = set(), {int(node) for node in design.resting_nodes()}
    modes = {int(node): set() for node in range(len(table))}
    for mode, node in zip((-1, 0, 1), design.resting_nodes(), strict=True):
        modes[int(node)].add(mode)
    found = []
    # Which modes a memory state may hold, by walking the table.
    while todo:
        node = todo.pop()
        reached.add(node)
        for mode in (-1, 0, 1):
            after = int(table[node, mode + 1])
            modes[after].add(mode)
            if after not in reached:
                todo.add(after)
    z = np.diag(design.performance)[np.array(design.performance) != 0.0] * scale
    z = z * design.output_scale
    gamma = design.gamma * design.output_scale
    for before in reached:
        for mode in modes[before]:
            d = np.array([design.uncertainty[mode], design.noise, design.drift])
            for after in {int(table[before, m + 1]) for m in (-1, 0, 1)}:
                gain = design.node_gains[after if design.form == "current" else before]
                step = error_step(design, mode, gain)
                F = step[:, :3] * scale / scale[:, None]
                G = (step[:, 3:] * d / scale[:, None])[:, d > 0.0]
                for P, rate in ((design.lyapunov, None), (design.lyapunov_decay, design.decay)):
                    root = np.linalg.inv(np.linalg.cholesky(P[before]))
                    kept = root @ F.T @ P[after] @ F @ root.T
                    if rate is not None:
                        if rate < 1.0:
                            found.append(np.linalg.eigvalsh(kept / rate**2 - np.eye(3))[-1])
                        continue
                    cross = root @ F.T @ P[after] @ G / gamma
                    corner = G.T @ P[after] @ G / gamma**2
                    out = z @ root.T
                    block = np.block([[kept + out.T @ out, cross], [cross.T, corner]])
                    found.append(np.linalg.eigvalsh(block - np.eye(len(block)))[-1])
    return np.array(found), len(reached)


def drawn(seed):
    """A design drawn at random."""
    rng = np.random.default_rng([1311, seed])
    dt = 10.0 ** rng.uniform(-4.0, -2.7)
    mass = 10.0 ** rng.uniform(-2.0, 1.5)
    level = mass * 10.0 ** rng.uniform(-0.5, 1.0)
    uneven = rng.random() < 0.5
    axis = dfc.FrictionAxis(
        mass=mass, viscous=mass * 10.0 ** rng.uniform(-1.0, 1.0), coulomb=level,
        stick_rate=rng.uniform(0.05, 0.9) / dt, stick_speed=1e-4,
    )  # fmt: skip
    off = 0.1 * level
    return dfc.design_pi_observer(
        axis,
        dt,
        method=("slack", "paper", "dwell", "path")[seed % 4],
        window=(None, None, 3, 2)[seed % 4],
        form=("current", "prediction")[seed // 2 % 2],
        discretization=("euler", "zoh")[int(rng.integers(2))],
        encoder_quantum=10.0 ** rng.uniform(-7.0, -5.0),
        uncertainty={0: off, 1: off, -1: 1.5 * off if uneven else off},
    )


@pytest.mark.parametrize("seed", range(8))
def test_the_certificate_holds_by_numpy_alone(seed):
    design = drawn(seed)
    found, nodes = margins(design)
    assert found.max() < 0.0
    # Each step of the certificate is found, and none beyond it.
    assert nodes == len(design.graph.labels)
    # Rounding of 3 x 3 factors with condition numbers up to 1e4, and the integrated matrices.
    assert -found.max() == pytest.approx(design.certificate.margin, rel=1e-3, abs=1e-6)
