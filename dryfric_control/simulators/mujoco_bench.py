"""One joint in MuJoCo: its free runs beside a record, and whether it comes to rest."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from dryfric_control.arrays import Floats
from dryfric_control.estimation.windows import cut
from dryfric_control.records.record import Record
from dryfric_control.simulators import mujoco_formats
from dryfric_control.simulators.files import number
from dryfric_control.simulators.mujoco_formats import Stepping

# Length of the free runs, that of `replay` [s].
_WINDOW = 0.25
# Steps of MuJoCo that a comparison may take; of a longer record every second window, or fewer.
_MOST_STEPS = 200_000
# Part of the inertia that a body must have.
_LEAST_LOAD = 1e-9
# A joint that is struck: steps until it is looked at, and for how many.
_SETTLING = 3000
_LOOKED_AT = 500
# Of what the Coulomb level gives the joint in one step: speed when struck, and speed that is rest.
_STRUCK = 20.0
_REST = 0.05
# Parts of the Coulomb level that it must hold.
_HELD = (0.0, 0.5, 0.9)
# An elastic contact: force of the swing as a part of the level, and by what it may grow.
_SWING = 0.3
_GROWTH = 1.05


def one_joint(
    values: Mapping[str, Any], load: float, turning: bool, stiff: bool, stepping: Stepping
) -> Any:
    """A model of MuJoCo of one joint that carries a load."""
    import mujoco

    body = number(max(load, _LEAST_LOAD * (load + values["armature"]), _LEAST_LOAD))
    attributes = mujoco_formats.joint_attributes(values, stiff, full=False)
    words = " ".join(f'{n}="{v}"' for n, v in attributes.items())
    kind = "hinge" if turning else "slide"
    mass, inertia = ("1", body) if turning else (body, body)
    actuator = ""
    if mujoco_formats.has_bristles(values):
        actuator = f"<actuator>{mujoco_formats.friction_actuator('joint', values)}</actuator>"
    return mujoco.MjModel.from_xml_string(
        f'<mujoco><option timestep="{stepping.timestep:.17g}" gravity="0 0 0" '
        f'integrator="{stepping.integrator}"/><worldbody><body><joint name="joint" type="{kind}" '
        f'{words}/><inertial pos="0 0 0" mass="{mass}" diaginertia="{" ".join(3 * [inertia])}"/>'
        f"</body></worldbody>{actuator}</mujoco>"
    )


def positions(model: Any, u: Floats, x0: float, v0: float, repeat: int) -> Floats:
    """Positions under a held drive, of `repeat` steps a sample, shape (n,)."""
    import mujoco

    data = mujoco.MjData(model)
    data.qpos[0], data.qvel[0] = x0, v0
    found = np.empty(u.size)
    for k, force in enumerate(u):
        found[k] = data.qpos[0]
        data.qfrc_applied[0] = force
        mujoco.mj_step(model, data, repeat)
    return found


def free_run_errors(model: Any, record: Record, shift: float) -> Floats:
    """Errors of free runs of a joint over a record."""
    windows = cut(record, _WINDOW, "zero")
    repeat = max(1, math.ceil(record.dt / model.opt.timestep - 1e-9))
    model.opt.timestep = record.dt / repeat
    u = windows.arrays(shift).u
    if record.known_force.size:
        u = u + record.known_force
    every = math.ceil(repeat * record.x.size / _MOST_STEPS)
    errors = []
    for i in range(0, len(windows), every):
        part = slice(int(windows.edges[i]), int(windows.edges[i + 1]))
        run = positions(model, u[part], windows.x0[i], windows.v0[i], repeat)
        errors.append(run - record.x[part])
    return np.concatenate(errors)


def is_stable(model: Any, values: Mapping[str, Any], mass: float) -> bool:
    """Whether bristles of a joint let it come to rest, or swing no further than it was struck."""
    step = model.opt.timestep
    elastic = values["frictionloss"] == 0.0
    level = values["lugre_coulomb"] if elastic else values["frictionloss"]
    if elastic:
        v0 = _SWING * level / math.sqrt(values["lugre_stiffness"] * mass)
        return _speed(model, v0, 0.0) <= _GROWTH * v0
    rest = _REST * level * step / mass
    v0 = _STRUCK * level * step / mass
    return all(_speed(model, v0, share * level) <= rest for share in _HELD)


def _speed(model: Any, v0: float, force: float) -> float:
    """Highest speed of a joint that was struck, long after; infinite where it is no number."""
    import mujoco

    data = mujoco.MjData(model)
    data.qvel[0], data.qfrc_applied[0] = v0, force
    mujoco.mj_step(model, data, _SETTLING)
    fastest = 0.0
    for _ in range(_LOOKED_AT):
        mujoco.mj_step(model, data)
        fastest = max(fastest, abs(float(data.qvel[0])))
        if not math.isfinite(data.qvel[0]):
            return math.inf
    return fastest
