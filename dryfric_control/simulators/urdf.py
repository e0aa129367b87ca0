"""Joints of a URDF file."""

from __future__ import annotations

import itertools
import os
from typing import Any

from numpy.typing import ArrayLike

from dryfric_control.simulators import files, joint_values
from dryfric_control.simulators.joint_values import SimulatorValues

_URDF = joint_values.Format(lambda c, *_: {"damping": float(c[1]), "friction": float(c[0])})
_UNITS = {"revolute": ("rad", "N m"), "continuous": ("rad", "N m"), "prismatic": ("m", "N")}


def to_urdf(
    result: Any,
    model: str | os.PathLike[str],
    joint: str | None = None,
    *,
    velocities: ArrayLike | None = None,
    out: str | os.PathLike[str] | None = None,
) -> SimulatorValues:
    """Set the dynamics of joints in a URDF file.

    Parameters
    ----------
    result : Fit, Diagnosis, FrictionAxis, or mapping of str to such
        What is known of the joint, or of each joint by its name.
    model : path-like
        URDF file; every other byte of it stays.
    joint, velocities, out
        As for `to_mjcf`.

    Notes
    -----
    The attributes `damping` and `friction` of ``<dynamics>`` are set, which is added where a joint
    has none.  The format has no armature: the inertia stays that of the links.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=0.3, viscous=0.2, coulomb=1.5, units=("rad", "N m"))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     arm = pathlib.Path(folder, "arm.urdf")
    ...     _ = arm.write_text('<robot><joint name="a" type="continuous">'
    ...                        '<dynamics damping="0"/></joint></robot>')
    ...     found = dfc.simulators.to_urdf(axis, arm)
    ...     print(arm.read_text()[:-16])
    <robot><joint name="a" type="continuous"><dynamics damping="0.2" friction="1.5"/>
    """
    path, raw, place = files.read_model(model, out)
    tags = files.elements(path, raw, "URDF", "robot")
    there = {
        one.attributes["name"]: i
        for i, one in enumerate(tags)
        if one.name == "joint" and one.path == ("robot",)
        and one.attributes.get("type") in _UNITS and "name" in one.attributes
    }  # fmt: skip
    if not there:
        raise ValueError(f"model {path.name} has no revolute, continuous or prismatic joint")
    units = {name: (_UNITS[tags[i].attributes["type"]],) for name, i in there.items()}
    joints = joint_values.joints_of(result, joint, units)
    found = joint_values.describe_joints(_URDF, joints, velocities)
    edits = []
    for name, values in found.values.items():
        texts = {n: files.number(v) for n, v in values.items()}
        i = there[name]
        inside = itertools.takewhile(lambda one: len(one.path) > 1, tags[i + 1 :])
        dynamics = next((one for one in inside if one.name == "dynamics"), None)
        if dynamics is not None:
            edits.append(files.attributes_set(raw, dynamics.at, texts))
        else:
            words = " ".join(f'{n}="{v}"' for n, v in texts.items())
            edits.append(files.child_added(raw, tags[i].at, f"<dynamics {words}/>"))
    return files.write_values(found, place, files.apply_edits(raw, edits))
