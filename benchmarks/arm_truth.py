"""An arm of six joints with friction that holds, simulated by MuJoCo in steps of 0.1 ms.

The size is that of a UR5e, the numbers are our own.  Friction of a joint::

    F = c (1 + s exp(-(v/vs)^2)) + k |u - e|

with the torque e by which the arm acts on the joint: gravity, Coriolis force and the accelerations
of the other joints, as a gear carries them all.  The level is set before each step as
`frictionloss`, which MuJoCo holds at rest, and a viscous part as `damping`.
One joint may have a play between its motor, with drive and encoder, and its link, with friction.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

Floats = Any


class Friction(NamedTuple):
    """Friction of a joint."""

    level: float  # Coulomb level [N m]
    viscous: float  # [N m s/rad]
    excess: float  # Stribeck peak over the level
    speed: float  # Stribeck velocity [rad/s]
    by_load: float  # part of the transmitted torque


JOINTS = ("pan", "lift", "elbow", "wrist1", "wrist2", "wrist3")
FRICTION = (
    Friction(7.0, 9.0, 0.30, 0.04, 0.0),
    Friction(8.0, 10.0, 0.25, 0.04, 0.03),
    Friction(5.0, 6.0, 0.30, 0.04, 0.0),
    Friction(1.8, 1.2, 0.25, 0.05, 0.0),
    Friction(1.6, 1.1, 0.30, 0.05, 0.0),
    Friction(1.4, 0.9, 0.0, 0.05, 0.0),
)
ARMATURE = (0.9, 0.9, 0.6, 0.12, 0.12, 0.12)  # rotors behind their gears [kg m^2]
#: Links: name, place, axis of the joint, mass [kg], centre of mass [m], moments of inertia.
LINKS = (
    ("shoulder", (0, 0, 0.16), (0, 0, 1), 3.8, (0, -0.02, 0), (0.015, 0.014, 0.012)),
    ("upper", (0, 0.14, 0), (0, 1, 0), 8.2, (0.2, 0, 0), (0.03, 0.22, 0.22)),
    ("fore", (0.425, -0.12, 0), (0, 1, 0), 2.3, (0.18, 0, 0), (0.006, 0.05, 0.05)),
    ("wrist_1", (0.39, 0, 0), (0, 1, 0), 1.25, (0, 0.09, 0), (0.003, 0.003, 0.003)),
    ("wrist_2", (0, 0.11, 0), (0, 0, 1), 1.25, (0, 0, 0.09), (0.003, 0.003, 0.003)),
    ("hand", (0, 0, 0.1), (0, 1, 0), 0.3, (0, 0.07, 0.01), (3e-4, 3e-4, 3e-4)),
)
KP, KD = (3000, 3000, 1800, 350, 350, 350), (180, 180, 110, 22, 22, 22)
MIDDLE = (0.0, -0.9, 1.2, -0.5, 0.4, 0.0)
FINE = 1e-4  # step of the simulation [s]
PLAY = 1e-3  # width of the play [rad]
STIFF, DAMPED = 4e4, 8.0  # of the flanks [N m/rad, N m s/rad]


@dataclass(frozen=True)
class Truth:
    """What an arm is, beside its model."""

    friction: tuple[Friction, ...] = FRICTION
    mass_factors: tuple[float, ...] = (1.0,) * 6  # true mass of a link over that of the model
    payload: float = 0.0  # [kg], at the place below in the frame of the hand
    place: tuple[float, float, float] = (0.0, 0.12, 0.0)
    play: str | None = None
    noise: tuple[float, ...] = field(default=(0.10, 0.10, 0.06, 0.02, 0.02, 0.02))  # [N m]
    quantum: float = 1e-5  # [rad]


def mjcf(truth: Truth | None = None, friction: bool = False) -> str:
    """The arm as a user's model, or as it is."""
    factors = (1.0,) * 6 if truth is None else truth.mass_factors
    lines, ends = [], 0
    for i, (name, place, axis, mass, centre, moments) in enumerate(LINKS):
        at, turn, middle = (" ".join(f"{v:g}" for v in one) for one in (place, axis, centre))
        inertia = " ".join(f"{factors[i] * v:.9g}" for v in moments)
        own = truth is not None and truth.play == JOINTS[i]
        armature = 0.3 * ARMATURE[i] if own else ARMATURE[i]
        level = FRICTION[i].level if friction else 0.0
        settings = f'frictionloss="{level or 1e-9:g}" solreffriction="0.0004 1" '
        settings += 'solimpfriction="0.999 0.9999 0.001"'
        if own:
            lines.append(
                f'<body name="rotor" pos="{at}"><joint name="motor" axis="{turn}" '
                f'armature="{0.7 * ARMATURE[i]:g}"/><inertial pos="0 0 0" mass="1e-9" '
                'diaginertia="1e-12 1e-12 1e-12"/></body>'
            )
        lines.append(
            f'<body name="{name}" pos="{at}"><joint name="{JOINTS[i]}" axis="{turn}" '
            f'armature="{armature:g}" {settings if friction else ""}/><inertial pos="{middle}" '
            f'mass="{factors[i] * mass:.9g}" diaginertia="{inertia}"/>'
        )
        ends += 1
    if truth is not None and truth.payload:
        at = " ".join(f"{v:g}" for v in truth.place)
        lines.append(
            f'<body name="load" pos="{at}"><inertial pos="0 0 0" mass="{truth.payload:g}" '
            'diaginertia="1e-6 1e-6 1e-6"/></body>'
        )
    option = f'timestep="{FINE}" integrator="implicitfast" noslip_iterations="4"'
    return (
        f'<mujoco model="six"><compiler angle="radian"/><option {option}/><worldbody>'
        + "\n".join(lines) + "</body>" * ends + "</worldbody></mujoco>"
    )  # fmt: skip


def reference(rng: np.random.Generator) -> Any:
    """A path of all joints, as a function of time."""
    rates = 2.0 * math.pi * rng.uniform([0.06, 0.2, 0.5], [0.12, 0.35, 0.9], (6, 3))
    sizes = np.array([0.55, 0.22, 0.06]) * rng.uniform(0.8, 1.2, (6, 3))
    phases = rng.uniform(0.0, 2.0 * math.pi, (6, 3))
    middle = np.array(MIDDLE)

    def at(t: float) -> tuple[Floats, Floats]:
        angle = rates * t + phases
        return middle + (sizes * np.sin(angle)).sum(1), (sizes * rates * np.cos(angle)).sum(1)

    return at


def torque_of_others(model: Any, data: Any, dofs: Floats) -> Floats:
    """Torque that each joint needs for the accelerations of the others."""
    import mujoco

    found, torque = np.empty(dofs.size), np.empty(model.nv)
    for j, dof in enumerate(dofs):
        others = data.qacc.copy()
        others[dof] = 0.0
        mujoco.mj_mulM(model, data, torque, others)
        found[j] = torque[dof]
    return found


def simulate(truth: Truth, seed: int, seconds: float = 20.0, dt: float = 2e-3) -> dict[str, Floats]:
    """One log of all joints: time, positions and torques."""
    import mujoco

    rng = np.random.default_rng(seed)
    model = mujoco.MjModel.from_xml_string(mjcf(truth, friction=True))
    data, path = mujoco.MjData(model), reference(rng)
    dofs = np.array([int(model.joint(name).dofadr[0]) for name in JOINTS])
    model.dof_damping.reshape(model.nv, -1)[dofs, 0] = [one.viscous for one in truth.friction]
    motor = int(model.joint("motor").dofadr[0]) if truth.play else -1
    behind = JOINTS.index(truth.play) if truth.play else -1
    driven = dofs.copy()
    if truth.play:
        driven[behind] = motor
    data.qpos[dofs] = data.qpos[driven] = path(0.0)[0]
    data.qvel[dofs] = data.qvel[driven] = path(0.0)[1]
    level, _, excess, speed, by_load = (np.array(one) for one in zip(*truth.friction, strict=True))
    kp, kd, q = np.array(KP), np.array(KD), truth.quantum
    n, sub = round(seconds / dt), round(dt / FINE)
    x, u = np.empty((n, 6)), np.empty((n, 6))
    last = data.qpos[driven].copy()
    mujoco.mj_forward(model, data)
    for k in range(n):
        x[k] = q * np.round((data.qpos[driven] + 0.3 * q * rng.standard_normal(6)) / q)
        wanted, rate = path(k * dt)
        u[k] = kp * (wanted - x[k]) + kd * (rate - (x[k] - last) / dt)
        last = x[k]
        for _ in range(sub):
            v = data.qvel[dofs]
            peak = 1.0 + excess * np.exp(-((v / speed) ** 2))
            others = torque_of_others(model, data, dofs)
            carried = np.abs(u[k] + data.qfrc_bias[dofs] + others)
            model.dof_frictionloss[dofs] = level * peak + by_load * carried
            data.qfrc_applied[driven] = u[k]
            if truth.play:
                gap = data.qpos[motor] - data.qpos[dofs[behind]]
                over = gap - math.copysign(min(abs(gap), 0.5 * PLAY), gap)
                push = 0.0
                if over:
                    push = STIFF * over + DAMPED * (data.qvel[motor] - v[behind])
                data.qfrc_applied[motor] = u[k, behind] - push
                data.qfrc_applied[dofs[behind]] = push
            mujoco.mj_step(model, data)
    log = {"time": dt * np.arange(n)}
    for j, name in enumerate(JOINTS):
        log[f"{name}.position"] = x[:, j]
        log[f"{name}.effort"] = u[:, j] + truth.noise[j] * rng.standard_normal(n)
    return log
