"""Joints of an MJCF file, or of a model in MuJoCo."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from dryfric_control.checks import check_boolean, one_of, whole
from dryfric_control.simulators import files, joint_values, mujoco_bench, mujoco_formats
from dryfric_control.simulators import mujoco_model as engine
from dryfric_control.simulators.joint_values import Joint, SimulatorValues
from dryfric_control.simulators.mjcf import Mjcf, kind_of
from dryfric_control.simulators.mujoco_formats import Stepping, has_bristles

DIALECTS = ("auto", "3.2", "4.0")
#: What other programs make of the words that a file has; versions in docs/howto/simulator.md.
_NOTES = {
    "frictionloss": "frictionloss: MuJoCo, MJX and MuJoCo Warp use it; Drake drops it with a "
    "warning, Pinocchio keeps it as data that aba leaves out",
    "armature": "armature: Drake drops it in silence where the joint has no actuator",
    "damping_quadratic": "damping with a quadratic part: MuJoCo from 3.7 on and MuJoCo Warp use "
    "it; MJX leaves out b1, b2 and Pinocchio reads all of it as 0, both in silence; Drake, Newton "
    "and older MuJoCo refuse the file",
    "lugre_stiffness": "dcmotor with bristles: MuJoCo 4 and MuJoCo Warp 4 use it, with any "
    "integrator but RK4; MJX, Newton and older MuJoCo refuse the file, Drake and Pinocchio leave "
    "it out in silence",
}
_RK4 = "bristles are not stable with the integrator RK4: they are left out"


def to_mjcf(
    result: Any,
    model: Any,
    joint: str | None = None,
    *,
    load: float | Mapping[str, float] | None = None,
    velocities: ArrayLike | None = None,
    dialect: str = "auto",
    stiff: bool | None = None,
    noslip_iterations: int | None = None,
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
        rest of the mass of the axis; of `arm_records` their `body_inertia`.  Default: MuJoCo
        computes it, in the reference pose.
    velocities : array_like, shape (n,), optional
        Velocities over which friction is approximated.  Default: those of the records of
        the result; without a record, as far as the friction curve is drawn.
    dialect : {"auto", "3.2", "4.0"}, optional
        Version of MuJoCo whose words are used.  "3.2" has one level and one coefficient, "4.0" also
        drag, a Stribeck peak and an elastic contact.  Default: "4.0" where such is installed.
    stiff : bool, optional
        Whether a joint at rest shall creep fifty times less, by `solreffriction` and the like.
        Default: with the words of 4.0.
    noslip_iterations : int, optional
        Iterations of MuJoCo's solver that ends what is left of the creep, an option of the model.
    out : path-like, optional
        File to write.  Default: `model` itself.

    Notes
    -----
    `frictionloss` c and `damping` d are the least-squares approximation of the friction
    F(x, v) of the axis over the sliding samples of its records,

    ::

        min sum (F(x, v) - c sign(v) - d v)^2,    c, d >= 0

    with what depends on position, direction, load and time averaged in the same way.  With the
    words of 4.0, a quadratic part b v|v| of the damping and a peak P sign(v) exp(-(v/vs)^2) are
    added where they make the error of the friction smaller by a tenth.  The peak, or all
    friction of an elastic contact, is that of LuGre bristles, in a passive actuator `dcmotor`.
    Their stiffness is bounded by the time step and the inertia, as MuJoCo integrates them
    explicitly: a peak has m/h^2, which is stable at any step (the bristles give no more than
    the peak, and the constraint damps them), and a contact that is stiffer is a hard one.

    Whatever the words cannot say is in `lost`, with the RMS force or position it makes there.
    Where MuJoCo is installed, the file is read back by it, what arrived otherwise is in
    `messages` and takes its place in `values`, and the second number of `free_runs` is MuJoCo's.

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
    ...     found = dfc.to_mjcf(axis, arm, load=0.1, dialect="3.2")
    ...     print(arm.read_text()[25:-28])
    <joint name="elbow" frictionloss="1.5" damping="0.2" armature="0.2"/>
    >>> [(one.what, round(one.error, 3)) for one in found.lost]
    [('Coulomb level 1.6 forwards, 1.4 N m backwards', 0.1)]
    """
    if stiff is not None:
        stiff = check_boolean("stiff", stiff)
    if noslip_iterations is not None:
        noslip_iterations = whole("noslip_iterations", noslip_iterations, 0)
    rich = _is_dialect_4(dialect)
    options = _Options(rich, rich if stiff is None else stiff, noslip_iterations)
    if isinstance(model, (str, os.PathLike)):
        return _in_file(result, model, joint, load, velocities, options, out)
    if out is not None:
        raise ValueError(f"out = {out!r} is for a file: a model in MuJoCo is changed itself")
    return _in_model(result, model, joint, load, velocities, options)


class _Options(NamedTuple):
    """Words and options that are asked for."""

    rich: bool  # whether the words are those of 4.0
    stiff: bool
    noslip_iterations: int | None

    @property
    def solver_parameters(self) -> dict[str, str]:
        """Solver parameters of a joint."""
        return mujoco_formats.STIFF if self.stiff else {}

    def formats(self, stepping: Stepping, bristles: bool = True) -> joint_values.Formats:
        """Formats of a joint."""
        return mujoco_formats.formats(stepping, bristles) if self.rich else mujoco_formats.PLAIN


def _is_dialect_4(dialect: Any) -> bool:
    """Whether words of 4.0 are to be used."""
    one_of("dialect", dialect, DIALECTS)
    if dialect == "auto":
        return (engine.installed_version() or (0, 0)) >= engine.RICH
    return bool(dialect == "4.0")


def _in_file(
    result: Any, model: Any, joint: Any, load: Any, velocities: Any, options: _Options, out: Any
) -> SimulatorValues:
    path, raw, place = files.read_model(model, out)
    file = Mjcf(path, raw)
    joints = _joints(result, joint, {name: kind_of(file, name) for name in file.joints})
    try:
        there = engine.compile_model(path) if engine.installed_version() else None
        refused = ""
    except ValueError as problem:
        there, refused = None, str(problem)
    mend = "give load=..., or install mujoco, which computes it"
    if refused:
        mend = f"give load=..., as {refused}"
    names = _copy_names(file, joints, there)
    loads = joint_values.checked_loads(
        load, result, joints, lambda: _body_inertias(there, names), mend
    )
    stepping = file.step_settings if there is None else engine.step_settings(there)
    # A copy has no name of its own in the file, to which an actuator could be tied.
    alone = all(not file.separators(name) for name in joints)
    formats = options.formats(stepping, alone)
    found = joint_values.describe_joints(formats, joints, velocities, loads)
    found = _stable(found, joints, velocities, loads, options, stepping)
    edits = []
    said = list(_override_notes(file, joints, there, names))
    for name, values in found.values.items():
        has_spring = there is not None and file.has_springdamper(name)
        stiffness = engine.joint_stiffness(there, names[name][0]) if has_spring else None
        edits.append(file.joint_edit(name, values, options.stiff, stiffness))
    edits += file.actuator_edits(found.values)
    if options.noslip_iterations is not None:
        edits.append(file.option_edit({"noslip_iterations": str(options.noslip_iterations)}))
    content = files.apply_edits(raw, edits)
    if there is not None:
        said += _read_back(path, content, found, names)
    elif refused:
        said.append(f"not read back: {refused}")
    found = replace(found, messages=(*found.messages, *said))
    found = _with_bench(found, joints, loads, options, stepping)
    return files.write_values(found, place, content)


def _joints(result: Any, joint: Any, kinds: Mapping[str, Any]) -> dict[str, Joint]:
    """Joints of a result, of one axis each; None where a file that is included says their kind."""
    any_kind = tuple(engine.UNITS.values())
    units = {n: (engine.UNITS[k],) if k in engine.UNITS else any_kind for n, k in kinds.items()}
    joints = joint_values.joints_of(result, joint, units)
    for name in joints:
        if kinds[name] not in (None, *engine.UNITS):
            raise ValueError(f"joint {name!r} is a {kinds[name]} joint: friction is of one axis")
    return joints


def _copy_names(file: Mjcf, joints: Mapping[str, Joint], there: Any) -> dict[str, list[str]]:
    """Names of each joint of a file in MuJoCo, several where it stands in <replicate> elements."""
    if there is None:
        return {name: [name] for name in joints}
    return {n: engine.copies(there, n, file.separators(n)) or [n] for n in joints}


def _body_inertias(there: Any, names: Mapping[str, list[str]]) -> dict[str, float]:
    """Inertia of the bodies about joints, by MuJoCo."""
    if there is None:
        return {}
    return engine.inertias(there, {name: copies[0] for name, copies in names.items()})


def _override_notes(
    file: Mjcf, joints: Mapping[str, Joint], there: Any, names: Mapping[str, list[str]]
) -> Iterator[str]:
    """What of the file overrides values, and what becomes of it."""
    for name in joints:
        if file.has_springdamper(name):
            yield _springdamper_note(name, there is not None)
        if len(names[name]) > 1:
            yield f"{name}: one of {len(names[name])} copies, which all have these values"


def _springdamper_note(joint: str, keeps_stiffness: bool) -> str:
    """What becomes of a springdamper."""
    spring = "its stiffness stays" if keeps_stiffness else "its spring goes with it"
    return f"{joint}: springdamper, which overrides damping, is removed; {spring}"


def _read_back(
    path: Path, content: bytes, found: SimulatorValues, names: Mapping[str, list[str]]
) -> list[str]:
    """What has arrived otherwise in MuJoCo, which takes its place in the values."""
    trial = path.with_name(f"{path.stem}.{os.getpid()}.part.xml")
    rich = any(
        has_bristles(v) or v.get("damping_quadratic", 0.0) > 0.0 for v in found.values.values()
    )
    try:
        trial.write_bytes(content)
        model = engine.compile_model(trial)
    except OSError as problem:
        return [f"not read back: {problem.strerror} beside {path.name}"]
    except ValueError as problem:
        if rich and (engine.installed_version() or (0, 0)) < engine.RICH:
            return ["not read back: the MuJoCo that is installed does not know the words of 4.0"]
        words = " ".join(str(problem).replace(str(trial), path.name).split())
        raise ValueError(f"{words}; with the new values, so that nothing was written") from None
    finally:
        trial.unlink(missing_ok=True)
    said = []
    for name, values in found.values.items():
        for copy in names[name]:
            said += [f"{copy}: {one}" for one in engine.differences(model, copy, values)]
        there = engine.joint_numbers(model, names[name][0])
        values.update(
            {n: there[n] for n in values if n in there and _is_different(values[n], there[n])}
        )
    return said


def _is_different(wanted: float, found: float) -> bool:
    """Whether a number is another than that which was written with six digits."""
    return files.number(wanted) != files.number(found)


def _stable(
    found: SimulatorValues, joints: Mapping[str, Joint], velocities: Any,
    loads: Mapping[str, float], options: _Options, stepping: Stepping,
) -> SimulatorValues:  # fmt: skip
    """Values with bristles only where each joint comes to rest in MuJoCo, if that can be tried."""
    if not options.rich:
        return found
    if not stepping.bristles:
        usual = options.formats(Stepping(stepping.timestep))
        bare = joint_values.describe_joints(usual, joints, velocities, loads).values
        said = (_RK4,) if any(map(has_bristles, bare.values())) else ()
        return replace(found, messages=(*found.messages, *said))
    restless = [
        name
        for name, values in found.values.items()
        if has_bristles(values) and not _rests(values, joints[name], loads[name], options, stepping)
    ]
    if not restless:
        return found
    found = joint_values.describe_joints(
        options.formats(stepping, bristles=False), joints, velocities, loads
    )
    said = (f"{', '.join(restless)}: bristles are not stable here: they are left out",)
    return replace(found, messages=(*found.messages, *said))


def _rests(
    values: Mapping[str, Any], joint: Joint, load: float, options: _Options, stepping: Stepping
) -> bool:
    """Whether a joint comes to rest in MuJoCo; as computed where none is installed."""
    if (engine.installed_version() or (0, 0)) < engine.RICH:
        return True
    turning = joint.axis.units == engine.UNITS["hinge"]
    model = mujoco_bench.one_joint(values, load, turning, options.stiff, stepping)
    return mujoco_bench.is_stable(model, values, load + values["armature"])


def _with_bench(
    found: SimulatorValues, joints: Mapping[str, Joint], loads: Mapping[str, float],
    options: _Options, stepping: Stepping,
) -> SimulatorValues:  # fmt: skip
    """Free runs measured in MuJoCo, and what other programs make of the values."""
    words = [name for values in found.values.values() for name in values if values[name]]
    notes = tuple(note for name, note in _NOTES.items() if name in words)
    version = engine.installed_version()
    if version is None or (version < engine.RICH and "lugre_stiffness" in words):
        return replace(found, notes=notes)
    runs = dict(found.free_runs)
    for name in runs:
        joint = joints[name]
        values = found.values[name]
        turning = joint.axis.units == engine.UNITS["hinge"]
        errors = []
        for record in joint.records:
            model = mujoco_bench.one_joint(values, loads[name], turning, options.stiff, stepping)
            errors.append(mujoco_bench.free_run_errors(model, record, joint.shift))
        rms = float(np.sqrt(np.mean(np.square(np.concatenate(errors)))))
        runs[name] = runs[name][0], rms
    return replace(found, notes=notes, free_runs=runs)


def _is_compiled(model: Any) -> bool:
    """Whether a model in MuJoCo is compiled; refuses what is none."""
    if hasattr(model, "dof_frictionloss"):
        return True
    if hasattr(model, "joints") and hasattr(model, "compile"):
        return False
    raise ValueError(
        f"model must be the path of an MJCF file, a mujoco.MjSpec or a mujoco.MjModel, got "
        f"{model!r}"
    )


def _in_model(
    result: Any, model: Any, joint: Any, load: Any, velocities: Any, options: _Options
) -> SimulatorValues:
    compiled = _is_compiled(model)
    made = model if compiled else model.copy().compile()
    kinds = {name: kind for name, kind in engine.joint_kinds(made).items() if name}
    joints = _joints(result, joint, kinds)
    loads = joint_values.checked_loads(
        load, result, joints, lambda: engine.inertias(made, list(joints))
    )
    stepping = engine.step_settings(made)
    # No actuator can be added to a compiled model.
    formats = options.formats(stepping, not compiled)
    found = joint_values.describe_joints(formats, joints, velocities, loads)
    if not compiled:
        found = _stable(found, joints, velocities, loads, options, stepping)
    said = []
    for name, values in found.values.items():
        if compiled:
            engine.put(model, name, values, options.solver_parameters)
            continue
        one = model.joint(name)
        if np.all(np.asarray(one.springdamper) > 0.0):
            said.append(_springdamper_note(name, True))
            engine.put_stiffness(one, engine.joint_stiffness(made, name))
        engine.put_in_spec(model, name, values, options.solver_parameters)
    if options.noslip_iterations is not None:
        (model.opt if compiled else model.option).noslip_iterations = options.noslip_iterations
    after = model if compiled else model.copy().compile()
    for name, values in found.values.items():
        said += [f"{name}: {one}" for one in engine.differences(after, name, values)]
    found = replace(found, messages=(*found.messages, *said))
    return _with_bench(found, joints, loads, options, stepping)
