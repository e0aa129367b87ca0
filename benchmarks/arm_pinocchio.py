"""The log of an arm made by Pinocchio: friction by our own steps of 0.1 ms.

In each step the velocity without friction is corrected by impulses of friction, each within its
level, that stop as many joints as they can: projected Gauss-Seidel on the inverse inertia.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import arm_truth
import numpy as np
from numba import njit

_SWEEPS = 30


@njit(cache=True)  # type: ignore[untyped-decorator]
def _stopped(v, inverse, most):  # type: ignore[no-untyped-def]
    """Velocities after friction impulses of at most `most`."""
    v, p = v.copy(), np.zeros(v.size)
    for _ in range(_SWEEPS):
        for j in range(v.size):
            new = min(max(p[j] - v[j] / inverse[j, j], -most[j]), most[j])
            v += inverse[:, j] * (new - p[j])
            p[j] = new
    return v


def simulate(truth: arm_truth.Truth, seed: int, seconds: float = 20.0, dt: float = 2e-3) -> Any:
    """One log of all joints, as `arm_truth.simulate` makes it."""
    import pinocchio as pin

    rng = np.random.default_rng(seed)
    path = arm_truth.reference(rng)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "arm.xml")
        file.write_text(arm_truth.mjcf(truth))
        model = pin.buildModelFromMJCF(str(file))
    model.armature = np.array(arm_truth.ARMATURE)
    for name in ("friction", "damping"):
        if hasattr(model, name):
            getattr(model, name)[:] = 0.0
    data = model.createData()
    level, viscous, excess, speed, by_load = (
        np.array(one) for one in zip(*truth.friction, strict=True)
    )
    kp, kd, quantum = np.array(arm_truth.KP), np.array(arm_truth.KD), truth.quantum
    n, sub, h = round(seconds / dt), round(dt / arm_truth.FINE), arm_truth.FINE
    q, v = (one.copy() for one in path(0.0))
    x, u, last = np.empty((n, 6)), np.empty((n, 6)), q.copy()
    acceleration = np.zeros(6)
    for k in range(n):
        x[k] = quantum * np.round((q + 0.3 * quantum * rng.standard_normal(6)) / quantum)
        wanted, rate = path(k * dt)
        u[k] = kp * (wanted - x[k]) + kd * (rate - (x[k] - last) / dt)
        last = x[k]
        for _ in range(sub):
            bias = pin.nonLinearEffects(model, data, q, v)
            inertia = np.asarray(pin.crba(model, data, q))
            inverse = np.linalg.inv(inertia)
            others = inertia @ acceleration - np.diag(inertia) * acceleration
            carried = np.abs(u[k] + bias + others)
            most = level * (1.0 + excess * np.exp(-((v / speed) ** 2))) + by_load * carried
            free = v + h * inverse @ (u[k] - bias - viscous * v)
            new = _stopped(free, inverse, h * most)
            acceleration = (new - v) / h
            v = new
            q = q + h * v
    log = {"time": dt * np.arange(n)}
    for j, name in enumerate(arm_truth.JOINTS):
        log[f"{name}.position"] = x[:, j]
        log[f"{name}.effort"] = u[:, j] + truth.noise[j] * rng.standard_normal(n)
    return log
