"""Beside `mujoco.sysid`: 18 parameters of six joints from one log, and free runs on unseen data.

`mujoco.sysid` fits frictionloss, damping and armature of all joints together, by rollouts of
windows of half a second that begin at the smoothed motion; we fit each joint. The first half of the
log is fitted, the free runs over the second are simulated by MuJoCo for both.
"""

from __future__ import annotations

import time
import warnings
from typing import Any

import arm_truth
import mujoco
import numpy as np

import dryfric_control as dfc

WINDOW = 0.5  # s
QUANTITIES = ("frictionloss", "damping", "armature")


def compare(model: Any, log: dict[str, Any], truth: arm_truth.Truth, seed: int) -> None:
    """Print the errors of both, and the seconds of a core they took."""
    half = len(log["time"]) // 2
    first, rest = (
        {k: v[part] for k, v in log.items()} for part in (slice(half), slice(half, None))
    )
    true = np.array([
        [one.level for one in truth.friction], [one.viscous for one in truth.friction],
        arm_truth.ARMATURE,
    ])  # fmt: skip
    records = dfc.arm_records(model, first)
    test = dfc.arm_records(model, rest)
    for name, find in (("ours", ours), ("mujoco.sysid", by_sysid)):
        start = time.process_time()
        found = find(records)
        seconds = time.process_time() - start
        off, runs = 100.0 * np.abs(found / true - 1.0).mean(axis=1), 1e6 * free_runs(found, test)
        print(
            f"seed {seed} {name:13s} mean error: level {off[0]:.2f} %, damping {off[1]:.2f} %, "
            f"armature {off[2]:.2f} %; unseen free runs {runs:.0f} urad RMS; {seconds:.1f} s of a "
            "core",
            flush=True,
        )


def start_of(records: Any) -> np.ndarray:
    """Where both begin: off by a third."""
    level = np.array([1.3 * one.level for one in arm_truth.FRICTION])
    viscous = np.array([0.7 * one.viscous for one in arm_truth.FRICTION])
    return np.array([level, viscous, 1.2 * np.array(arm_truth.ARMATURE)])


def ours(records: Any) -> np.ndarray:
    """Parameters by `fit` of each joint, shape (3, 6)."""
    begin, found = start_of(records), np.empty((3, 6))
    for j, (axis, record) in enumerate(records.values()):
        links = axis.mass - arm_truth.ARMATURE[j]
        axis = axis.replace(coulomb=begin[0, j], viscous=begin[1, j], mass=links + begin[2, j])
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            fitted = dfc.fit(axis, record, starts=1).axis
        found[:, j] = fitted.coulomb.mean, fitted.viscous, fitted.mass - links
    return found


def by_sysid(records: Any) -> np.ndarray:
    """The same by `mujoco.sysid`, with its own optimiser and defaults."""
    from mujoco import sysid

    begin = start_of(records)
    spec = simulated_spec(begin)
    compiled = spec.compile()
    names, starts, controls, sensors = [], [], [], []
    u, x, t, states = signals(records)
    for k, a, b in windows(t):
        names.append(f"window_{k}")
        starts.append(sysid.create_initial_state(compiled, states.q[a], states.v[a]))
        clock = t[a:b] - t[a]
        controls.append(sysid.TimeSeries.from_control_names(clock, u[a:b], compiled))
        sensors.append(sysid.TimeSeries.from_names(clock, x[a:b], compiled))
    data = sysid.ModelSequences("arm", spec, names, starts, controls, sensors)
    parameters = sysid.ParameterDict()
    for i, quantity in enumerate(QUANTITIES):
        for j, joint in enumerate(arm_truth.JOINTS):

            def put(spec: Any, one: Any, quantity: str = quantity, joint: str = joint) -> None:
                put_value(spec.joint(joint), quantity, float(np.ravel(one.value)[0]))

            name, value = f"{joint}_{quantity}", begin[i, j]
            parameters[name] = sysid.Parameter(name, value, 0.1 * value, 10.0 * value, modifier=put)
    residual = sysid.build_residual_fn(models_sequences=[data])
    found, _ = sysid.optimize(parameters, residual, verbose=False)
    return np.asarray(found.as_vector()).reshape(3, 6)


def put_value(joint: Any, quantity: str, value: float) -> None:
    """Set a quantity of a joint; damping is a polynomial since MuJoCo 3.5."""
    size = np.size(getattr(joint, quantity))
    setattr(joint, quantity, value if size == 1 else [value, *np.zeros(size - 1)])


def simulated_spec(values: np.ndarray) -> Any:
    """The arm as a simulation model at the step of the log, with torque motors and encoders."""
    spec = mujoco.MjSpec.from_string(arm_truth.mjcf())
    spec.option.timestep = 2e-3
    for j, joint in enumerate(arm_truth.JOINTS):
        one = spec.joint(joint)
        for quantity, value in zip(QUANTITIES, values[:, j], strict=True):
            put_value(one, quantity, value)
        motor = spec.add_actuator(name=f"motor_{joint}", target=joint)
        motor.trntype = mujoco.mjtTrn.mjTRN_JOINT
        sensor = spec.add_sensor(name=f"encoder_{joint}", objname=joint)
        sensor.type, sensor.objtype = mujoco.mjtSensor.mjSENS_JOINTPOS, mujoco.mjtObj.mjOBJ_JOINT
    return spec


def signals(records: Any) -> Any:
    """Torques, positions and time of the log, and its smoothed motion."""
    u, x = (np.stack([getattr(r, one) for r in records.records.values()], axis=1) for one in "ux")
    return u, x, next(iter(records.records.values())).t, records.motion


def windows(t: np.ndarray) -> Any:
    """Number, first sample and end of each window."""
    size = round(WINDOW / (t[1] - t[0]))
    return [(k, a, a + size) for k, a in enumerate(range(20, len(t) - size - 20, size))]


def free_runs(values: np.ndarray, records: Any) -> float:
    """RMS error of free runs over windows by MuJoCo, the same for both [rad]."""
    model = simulated_spec(values).compile()
    data = mujoco.MjData(model)
    u, x, t, states = signals(records)
    errors = []
    for _, a, b in windows(t):
        mujoco.mj_resetData(model, data)
        data.qpos[:], data.qvel[:] = states.q[a], states.v[a]
        for k in range(a, b):
            errors.append(data.qpos - x[k])
            data.ctrl[:] = u[k]
            mujoco.mj_step(model, data)
    return float(np.sqrt(np.mean(np.square(errors))))
