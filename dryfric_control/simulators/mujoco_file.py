"""Joints of an MJCF file, or of a model in MuJoCo."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dryfric_control.model.axis import FrictionAxis
from dryfric_control.model.friction import CoulombMap
from dryfric_control.simulators import files, joint_values
from dryfric_control.simulators.joint_values import SimulatorValues
from dryfric_control.store.files import existing_file
from dryfric_control.text import see

_MJCF = joint_values.Format(
    lambda c, *_: {"frictionloss": float(c[0]), "damping": float(c[1])}, armature="armature"
)
_KINDS = ("free", "ball", "slide", "hinge")
_UNITS = {"hinge": ("rad", "N m"), "slide": ("m", "N")}
#: Friction of MuJoCo is soft: a joint at rest creeps, with these a fiftieth of the default.
_STIFF = {"solreffriction": "0.002 1", "solimpfriction": "0.99 0.999 0.001"}


def to_mjcf(
    result: Any,
    model: Any,
    joint: str | None = None,
    *,
    load: float | Mapping[str, float] | None = None,
    velocities: ArrayLike | None = None,
    stiff: bool = False,
    out: str | os.PathLike[str] | None = None,
) -> SimulatorValues:
    """Set friction, damping and armature of joints in MuJoCo.

    Parameters
    ----------
    result : Fit, Diagnosis, FrictionAxis, or mapping of str to such
        What is known of the joint, or of each joint by its name.
    model : path-like, mujoco.MjSpec or mujoco.MjModel
        MJCF file, of which every other byte stays, or a model, which is changed.
    joint : str, optional
        That of a single result.  Default: the only joint of the model, or the name of the axis.
    load : float or mapping of str to float, optional
        Inertia that the bodies of the model have about the joint [kg m^2]: `armature` is the
        rest of the mass of the axis.  Default: MuJoCo computes it, in the reference pose.
    velocities : array_like, shape (n,), optional
        Velocities over which friction is approximated.  Default: those of the records of
        the result; without a record, as far as the friction curve is drawn.
    stiff : bool, optional
        Whether a joint at rest shall creep fifty times less, by `solreffriction` and the like.
    out : path-like, optional
        File to write.  Default: `model` itself.

    Notes
    -----
    `frictionloss` c and `damping` d are the least-squares approximation of the friction
    F(x, v) of the axis over the sliding samples of its records,

    ::

        min sum (F(x, v) - c sign(v) - d v)^2,    c, d >= 0

    with what depends on position, direction, load and time averaged in the same way.  Whatever they
    cannot say is in `lost`, with the RMS force or position it makes there.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=0.3, viscous=0.2, coulomb=(1.6, 1.4),
    ...                         units=("rad", "N m"))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     arm = pathlib.Path(folder, "arm.xml")
    ...     _ = arm.write_text('<mujoco><worldbody><body><joint name="elbow"/></body>'
    ...                        '</worldbody></mujoco>')
    ...     found = dfc.to_mjcf(axis, arm, load=0.1)
    ...     print(arm.read_text()[25:-28])
    <joint name="elbow" frictionloss="1.5" damping="0.2" armature="0.2"/>
    >>> [(one.what, round(one.error, 3)) for one in found.lost]
    [('Coulomb level 1.6 forwards, 1.4 N m backwards', 0.1)]
    """
    if not isinstance(stiff, bool):
        raise ValueError(f"stiff must be True or False, got {stiff!r}")
    if isinstance(model, (str, os.PathLike)):
        return _in_file(result, model, joint, load, velocities, stiff, out)
    if out is not None:
        raise ValueError(f"out = {out!r} is for a file: a model in MuJoCo is changed itself")
    return _in_model(result, model, joint, load, velocities, stiff)


def _in_file(
    result: Any, model: Any, joint: Any, load: Any, velocities: Any, stiff: bool, out: Any
) -> SimulatorValues:
    path, raw, place = files.read_model(model, out)
    there = _named(path, files.elements(path, raw, "MJCF", "mujoco"))
    joints = _joints(result, joint, {n: one.attributes.get("type") for n, one in there.items()})
    mend = "give load=..., or install mujoco, which computes it"
    loads = joint_values.checked_loads(load, joints, lambda: _computed(path, joints), mend)
    found = joint_values.described(_MJCF, joints, velocities, loads)
    edits = []
    for name, values in found.values.items():
        texts = {n: files.number(v) for n, v in values.items()} | (_STIFF if stiff else {})
        edits.append(files.attributes_set(raw, there[name].at, texts))
    return files.written(found, place, files.applied(raw, edits))


def _named(path: Path, tags: list[files.Element]) -> dict[str, files.Element]:
    """Joints of the bodies by name."""
    there = {
        one.attributes["name"]: one
        for one in tags
        if one.name == "joint" and "name" in one.attributes and "worldbody" in one.path
    }
    if there:
        return there
    others = [one.attributes.get("file", "") for one in tags if one.name == "include"]
    mend = f"give the included file with them ({', '.join(others)})" if others else "name them"
    raise ValueError(
        f"model {path.name} has no joint with a name in a body: {mend}" + see("howto/simulator")
    )


def _joints(result: Any, joint: Any, kinds: Mapping[str, Any]) -> dict[str, joint_values.Joint]:
    """Joints of a result, of one axis each; a class of the file may set their kind (None)."""
    any_kind = tuple(_UNITS.values())
    units = {n: (_UNITS[kind],) if kind in _UNITS else any_kind for n, kind in kinds.items()}
    joints = joint_values.joints_of(result, joint, units)
    for name in joints:
        if kinds[name] not in (None, *_UNITS):
            raise ValueError(f"joint {name!r} is a {kinds[name]} joint: friction is of one axis")
    return joints


def _computed(path: Path, joints: Mapping[str, joint_values.Joint]) -> dict[str, float]:
    """Inertia of the bodies about joints, by MuJoCo."""
    try:
        return inertias(_compiled(path), joints)
    except ImportError:
        return {}
    except ValueError as problem:
        raise ValueError(f"{problem}; it computes inertia of the bodies: give load=...") from None


def _compiled(path: Path) -> Any:
    """The model of a file."""
    import mujoco

    try:
        return mujoco.MjModel.from_xml_path(str(path))
    except ValueError as problem:
        raise ValueError(f"model {path} is refused by MuJoCo: {problem}") from None


def inertias(model: Any, joints: Iterable[str]) -> dict[str, float]:
    """Inertia of the bodies of a compiled model about joints in its reference pose."""
    import mujoco

    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    found = {}
    for name in joints:
        at = int(model.joint(name).dofadr[0])
        unit, answer = np.zeros(model.nv), np.zeros(model.nv)
        unit[at] = 1.0
        mujoco.mj_mulM(model, data, answer, unit)
        found[name] = float(answer[at] - model.dof_armature[at])
    return found


def axes_of(path: str | os.PathLike[str]) -> dict[str, FrictionAxis]:
    """Nominal axes of the joints of an MJCF file, by MuJoCo: inertia, damping, frictionloss."""
    try:
        model = _compiled(existing_file(path))
    except ImportError:
        raise ValueError(
            f"the nominal axes of {path} are computed by MuJoCo, which is not installed: pip "
            "install mujoco, or give a file of axes"
        ) from None
    kinds = {one.name: _KINDS[int(one.type[0])] for one in map(model.joint, range(model.njnt))}
    units = {name: _UNITS[kind] for name, kind in kinds.items() if name and kind in _UNITS}
    if not units:
        raise ValueError(f"model {path} has no hinge or slide joint with a name: name them")
    found = {}
    for name, inertia in inertias(model, units).items():
        at = int(model.joint(name).dofadr[0])
        damping = float(np.ravel(model.dof_damping[at])[0])
        level = CoulombMap.of(float(model.dof_frictionloss[at]))
        mass = inertia + float(model.dof_armature[at])
        found[name] = FrictionAxis(mass, damping, level, name=name, units=units[name])
    return found


def _in_model(
    result: Any, model: Any, joint: Any, load: Any, velocities: Any, stiff: bool
) -> SimulatorValues:
    compiled = hasattr(model, "dof_frictionloss")
    if not compiled and not (hasattr(model, "joints") and hasattr(model, "compile")):
        raise ValueError(
            f"model must be the path of an MJCF file, a mujoco.MjSpec or a mujoco.MjModel, got "
            f"{model!r}"
        )
    made = model if compiled else model.copy().compile()
    kinds = {one.name: _KINDS[int(one.type[0])] for one in map(made.joint, range(made.njnt))}
    joints = _joints(result, joint, {name: kind for name, kind in kinds.items() if name})
    loads = joint_values.checked_loads(load, joints, lambda: inertias(made, joints))
    found = joint_values.described(_MJCF, joints, velocities, loads)
    soft = {n: [float(v) for v in text.split()] for n, text in _STIFF.items()}
    for name, values in found.values.items():
        if compiled:
            at = model.joint(name).dofadr[0]
            for quantity, value in values.items():
                getattr(model, f"dof_{quantity}")[at] = value
            if stiff:
                model.dof_solref[at] = soft["solreffriction"]
                model.dof_solimp[at][:3] = soft["solimpfriction"]
            continue
        one = model.joint(name)
        for quantity, value in values.items():
            # Damping has been a polynomial since MuJoCo 3.5.
            if np.ndim(getattr(one, quantity)):
                value = [value, *np.zeros(np.size(getattr(one, quantity)) - 1)]
            setattr(one, quantity, value)
        if stiff:
            one.solref_friction[:2] = soft["solreffriction"]
            one.solimp_friction[:3] = soft["solimpfriction"]
    return found
