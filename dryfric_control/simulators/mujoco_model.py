"""Models in MuJoCo, where it is installed: inertias, nominal axes, and what arrives in one."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from dryfric_control.model.axis import FrictionAxis
from dryfric_control.model.friction import CoulombMap
from dryfric_control.simulators.files import number
from dryfric_control.simulators.mujoco_formats import LUGRE, Stepping, has_bristles
from dryfric_control.store.files import existing_file

KINDS = ("free", "ball", "slide", "hinge")
UNITS = {"hinge": ("rad", "N m"), "slide": ("m", "N")}
#: The version that reads polynomial damping (3.7) and passive motors without a constant (4.0).
RICH = (4, 0)
# Relative difference of a number that was written with six digits.
_WRITTEN = 1e-5


def installed_version() -> tuple[int, int] | None:
    """Version of the MuJoCo that is installed; None without one."""
    try:
        import mujoco
    except ImportError:
        return None
    major, minor = (int(part) for part in mujoco.__version__.split(".")[:2])
    return major, minor


def compile_model(path: Path) -> Any:
    """The model of a file."""
    import mujoco

    try:
        return mujoco.MjModel.from_xml_path(str(path))
    except ValueError as problem:
        raise ValueError(f"model {path} is refused by MuJoCo: {problem}") from None


def step_settings(model: Any) -> Stepping:
    """How a compiled model steps."""
    import mujoco

    name = mujoco.mjtIntegrator(model.opt.integrator).name.removeprefix("mjINT_")
    names = {"euler": "Euler", "rk4": "RK4", "implicitfast": "implicitfast"}
    return Stepping(float(model.opt.timestep), names.get(name.lower(), name.lower()))


def joint_kinds(model: Any) -> dict[str, str]:
    """Kinds of the joints of a compiled model by name."""
    return {one.name: KINDS[int(one.type[0])] for one in map(model.joint, range(model.njnt))}


def copies(model: Any, joint: str, separators: Iterable[str]) -> list[str]:
    """Names in a compiled model of a joint of its file, which stands in <replicate> elements."""
    ends = "".join(rf"{re.escape(one)}\d+" for one in separators)
    return [name for name in joint_kinds(model) if re.fullmatch(re.escape(joint) + ends, name)]


def inertias(model: Any, joints: Mapping[str, str] | Iterable[str]) -> dict[str, float]:
    """Inertia of the bodies of a compiled model about joints in its reference pose.

    A mapping names a joint of the model for each joint of its file.
    """
    import mujoco

    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    found = {}
    names = joints if isinstance(joints, Mapping) else {name: name for name in joints}
    for joint, name in names.items():
        at = int(model.joint(name).dofadr[0])
        unit = np.zeros(model.nv)
        answer = np.zeros(model.nv)
        unit[at] = 1.0
        mujoco.mj_mulM(model, data, answer, unit)
        found[joint] = float(answer[at] - model.dof_armature[at])
    return found


def axes_of(path: str | os.PathLike[str]) -> dict[str, FrictionAxis]:
    """Nominal axes of the joints of an MJCF file, by MuJoCo: inertia, damping, frictionloss."""
    try:
        model = compile_model(existing_file(path))
    except ImportError:
        raise ValueError(
            f"the nominal axes of {path} are computed by MuJoCo, which is not installed: pip "
            "install mujoco, or give a file of axes"
        ) from None
    kinds = joint_kinds(model)
    units = {name: UNITS[kind] for name, kind in kinds.items() if name and kind in UNITS}
    if not units:
        raise ValueError(f"model {path} has no hinge or slide joint with a name: name them")
    found = {}
    for name, inertia in inertias(model, list(units)).items():
        at = int(model.joint(name).dofadr[0])
        damping = float(np.ravel(model.dof_damping[at])[0])
        level = CoulombMap.of(float(model.dof_frictionloss[at]))
        mass = inertia + float(model.dof_armature[at])
        found[name] = FrictionAxis(mass, damping, level, name=name, units=units[name])
    return found


def joint_numbers(model: Any, joint: str) -> dict[str, float]:
    """Numbers of a joint in a compiled model."""
    at = int(model.joint(joint).dofadr[0])
    number_of_joint = int(model.joint(joint).id)
    found = {
        "frictionloss": float(model.dof_frictionloss[at]),
        "damping": float(np.ravel(model.dof_damping[at])[0]),
        "armature": float(model.dof_armature[at]),
    }
    if hasattr(model, "dof_dampingpoly"):
        found["damping_quadratic"], found["damping_cubic"] = map(float, model.dof_dampingpoly[at])
    for i in _actuators(model, number_of_joint):
        stiffness, damping = model.actuator_dynprm[i][5:7]
        if _is_dcmotor(model, i) and stiffness > 0.0:
            lugre = (stiffness, damping, *model.actuator_biasprm[i][3:6])
            found |= dict(zip(LUGRE, map(float, lugre), strict=True))
    return found


def differences(model: Any, joint: str, values: Mapping[str, Any]) -> list[str]:
    """What of a joint is otherwise in a compiled model than it was written."""
    there = joint_numbers(model, joint)
    said = []
    expected = {"damping_quadratic": 0.0, "damping_cubic": 0.0} | dict(values)
    names = [n for n in expected if n in there or n in values]
    for name in names + [n for n in LUGRE if n in there and n not in values]:
        wanted = expected.get(name, 0.0)
        found = there.get(name, 0.0)
        if abs(found - wanted) > _WRITTEN * max(abs(wanted), abs(found)):
            said.append(f"{name} is {number(found)} in MuJoCo, and {number(wanted)} was written")
    said += _actuator_additions(model, int(model.joint(joint).id))
    return said


def _actuators(model: Any, joint: int) -> list[int]:
    """Actuators that act on a joint."""
    return [
        i for i in range(len(model.actuator_trnid))
        if int(model.actuator_trnid[i][0]) == joint and int(model.actuator_trntype[i]) in (0, 1)
    ]  # fmt: skip


def _is_dcmotor(model: Any, actuator: int) -> bool:
    import mujoco

    kind = getattr(mujoco.mjtBias, "mjBIAS_DCMOTOR", None)
    return kind is not None and int(model.actuator_biastype[actuator]) == int(kind)


def _actuator_additions(model: Any, joint: int) -> list[str]:
    """What actuators add to the damping and armature of a joint."""
    said = []
    for i in _actuators(model, joint):
        for name in ("damping", "armature"):
            there = getattr(model, f"actuator_{name}", None)
            added = 0.0 if there is None else float(np.ravel(there[i])[0])
            if added:
                gear = float(model.actuator_gear[i][0])
                who = model.actuator(i).name or i
                said.append(f"actuator {who!r} adds {number(added * gear**2)} to its {name}")
    return said


def put(model: Any, joint: str, values: Mapping[str, Any], soft: Mapping[str, str]) -> None:
    """Set the numbers of a joint in a compiled model."""
    at = model.joint(joint).dofadr[0]
    for name in ("frictionloss", "damping", "armature"):
        getattr(model, f"dof_{name}")[at] = values[name]
    if hasattr(model, "dof_dampingpoly"):
        model.dof_dampingpoly[at] = values.get("damping_quadratic", 0.0), 0.0
    if soft:
        model.dof_solref[at] = _numbers(soft["solreffriction"])
        model.dof_solimp[at][:3] = _numbers(soft["solimpfriction"])


def joint_stiffness(model: Any, joint: str) -> float:
    """Stiffness of the spring of a joint in a compiled model."""
    return float(np.ravel(model.jnt_stiffness[model.joint(joint).id])[0])


def put_stiffness(joint: Any, stiffness: float) -> None:
    """Give a joint of a specification a stiffness in place of its springdamper."""
    # Some versions of MuJoCo have a polynomial here.
    joint.stiffness = [stiffness, 0.0, 0.0] if np.ndim(joint.stiffness) else stiffness
    joint.springdamper = [0.0, 0.0]


def put_in_spec(spec: Any, joint: str, values: Mapping[str, Any], soft: Mapping[str, str]) -> None:
    """Set the numbers of a joint in a specification."""
    one = spec.joint(joint)
    one.frictionloss, one.armature = values["frictionloss"], values["armature"]
    # Damping has been a polynomial since MuJoCo 3.7.
    if np.ndim(one.damping):
        one.damping = [values["damping"], values.get("damping_quadratic", 0.0), 0.0]
    else:
        one.damping = values["damping"]
    if soft:
        one.solref_friction[:2] = _numbers(soft["solreffriction"])
        one.solimp_friction[:3] = _numbers(soft["solimpfriction"])
    for old in [a for a in spec.actuators if a.name == f"{joint}_friction"]:
        spec.delete(old)
    if has_bristles(values):
        import mujoco

        motor = spec.add_actuator(
            name=f"{joint}_friction", target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT
        )
        lugre = [values[name] for name in LUGRE]
        kind = int(mujoco.mjtCtrlInput.mjINPUT_NONE)
        motor.set_to_dcmotor([0.0, 0.0], 1.0, lugre=lugre, ctrlspec=kind)


def _numbers(text: str) -> list[float]:
    return [float(one) for one in text.split()]
