"""Joint friction of Isaac Lab and Isaac Sim."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from typing import Any

from numpy.typing import ArrayLike

from dryfric_control.simulators import joint_values
from dryfric_control.simulators.files import number, write_values
from dryfric_control.simulators.joint_values import SimulatorValues
from dryfric_control.store.files import file_path

_ISAAC = joint_values.Format(
    lambda c, shape, breakaway, axis: {
        # The engine does not let go of a joint at less than what brakes it once it slides.
        "friction": max(breakaway, float(c[0])),
        "dynamic_friction": float(c[0]),
        "viscous_friction": float(c[1]),
    },
    breakaway=True,
    armature="armature",
)


def to_isaac(
    result: Any,
    path: str | os.PathLike[str],
    joint: str | None = None,
    *,
    load: float | Mapping[str, float] | None = None,
    velocities: ArrayLike | None = None,
) -> SimulatorValues:
    """Write joint friction for Isaac Lab.

    Parameters
    ----------
    result : Fit, Diagnosis, FrictionAxis, or mapping of str to such
        What is known of the joint, or of each joint by its name.
    path : path-like
        Python file to write, with one dictionary ``JOINT_FRICTION``:
        ``ImplicitActuatorCfg(..., **JOINT_FRICTION)``.
    joint, load, velocities
        As for `to_mjcf`; the load is needed.

    Notes
    -----
    `friction` is the breakaway friction force, `dynamic_friction` and `viscous_friction`
    the level and the coefficient of sliding: efforts, as Isaac Sim has had them from 5.0 on.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=0.3, viscous=0.2, coulomb=1.5, units=("rad", "N m"))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "friction.py")
    ...     found = dfc.simulators.to_isaac({"elbow": axis}, path, load=0.1)
    ...     print(path.read_text().splitlines()[1])
        friction={"elbow": 1.5},
    """
    joints = joint_values.joints_of(result, joint, {})
    place = file_path("path", path)
    loads = joint_values.checked_loads(load, result, joints)
    found = joint_values.describe_joints(_ISAAC, joints, velocities, loads)
    names = list(dict.fromkeys(n for values in found.values.values() for n in values))
    lines = []
    for name in names:
        entries = (
            f"{_python_literal(joint)}: {number(v[name])}" for joint, v in found.values.items()
        )
        lines.append(f"    {name}={{{', '.join(entries)}}},\n")
    return write_values(found, place, f"JOINT_FRICTION = dict(\n{''.join(lines)})\n".encode())


def _python_literal(name: str) -> str:
    """A name as text of Python: that of JSON is such, but for halves of a character."""
    return json.dumps(name, ensure_ascii=False)
