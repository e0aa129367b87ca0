"""The rigid-body model of an arm: inverse dynamics without friction, by MuJoCo."""

from __future__ import annotations

import copy
import math
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike

from dryfric_control.arrays import Floats
from dryfric_control.checks import finite, positive
from dryfric_control.store.files import existing_file
from dryfric_control.text import did_you_mean

# Kinds of joints by MuJoCo's number, and units of those with one axis.
_KINDS = ("free", "ball", "slide", "hinge")
_UNITS = {"hinge": ("rad", "N m"), "slide": ("m", "N")}
# Ten inertial parameters of a link about the origin of its frame: mass, first moments, and the
# six second moments xx, yy, zz, xy, xz, yz.
N_INERTIAL = 10
_SECOND = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
# Types of constraints between bodies or tendons, each with what it is.
_CLOSED = {
    "mjEQ_CONNECT": "a closed chain", "mjEQ_WELD": "a closed chain", "mjEQ_TENDON": "coupled "
    "tendons", "mjEQ_DISTANCE": "a closed chain", "mjEQ_FLEX": "a flexible body",
}  # fmt: skip


class Motion(NamedTuple):
    """Positions, velocities and accelerations of the joints, each shape (n, njoints)."""

    q: Floats
    v: Floats
    a: Floats


def means_of_samples(forces: Floats) -> Floats:
    """Mean over each sample of forces at its instants, shape (..., n): the load of a record."""
    return 0.5 * (forces + np.append(forces[..., 1:], forces[..., -1:], axis=-1))


class Follower(NamedTuple):
    """A joint that a coupling moves along with another: a polynomial of its deflection."""

    follower: int  # number of the joint in the model
    leader: int
    coefficients: Floats  # of powers 0 to 4


class Payload(NamedTuple):
    """A mass in the frame of a body."""

    mass: float  # [kg]
    place: Floats  # of its centre [m], shape (3,)
    second: Floats | None = None  # moments of inertia about the frame [kg m^2]; None for a point


#: Kinds of errors of the model; the others are of the log.
OF_LINKS = ("mass", "centre", "payload")


class Change(Protocol):
    """What is wrong with the masses of a link, see `ModelError`."""

    @property
    def kind(self) -> str:
        """Such as "mass"."""

    @property
    def link(self) -> str:
        """Name of the link."""

    @property
    def value(self) -> float:
        """Factor of the mass, or the mass of a payload."""

    @property
    def place(self) -> tuple[float, ...]:
        """Shift of the centre of mass, or place of the payload."""

    @property
    def moments(self) -> tuple[float, ...]:
        """Second moments of a payload."""


@dataclass(frozen=True, eq=False)
class Link:
    """Bodies that move as one, behind a joint."""

    name: str
    bodies: tuple[int, ...]
    inertial: Floats  # shape (10,), about the origin of the frame of its first body
    last: bool  # no joint is behind it

    @property
    def mass(self) -> float:
        """Mass [kg]."""
        return float(self.inertial[0])


class RigidArm:
    """Inverse dynamics of an arm whose joints have no friction.

    Parameters
    ----------
    model : path-like or mujoco.MjModel
        MJCF or URDF file, or a compiled model, which stays as it is.
    held : mapping or sequence, optional
        Joints that do not move, with their positions; a sequence: at their reference positions.
    gravity : array_like, shape (3,), optional
        Gravity in the frame of the base [m/s^2], for a base that is not upright.
    payload : mapping, optional
        Body to its payload: a mass [kg], or (mass, place in the frame of the body [m]).

    Raises
    ------
    ValueError
        If the model is of another kind than a tree of hinges and slides on a fixed base.
    """

    def __init__(
        self,
        model: Any,
        held: Mapping[str, float] | Sequence[str] = (),
        gravity: ArrayLike | None = None,
        payload: Mapping[str, Any] | None = None,
    ) -> None:
        opened = _load_model(model)
        #: Viscous coefficient and Coulomb level that the model states for each of its joints.
        self.friction = _stated_friction(opened)
        self.model = _without_friction(opened)
        kinds = [_KINDS[int(kind)] for kind in self.model.jnt_type]
        names = [self.model.joint(i).name for i in range(self.model.njnt)]
        _refuse_others(names, kinds)
        self._followers = _find_followers(self.model, names)
        still = _held_joints(held, self.model, names)
        moved = {one.follower for one in self._followers} | still.keys()
        self._joints = [i for i in range(self.model.njnt) if i not in moved]
        #: Names of the joints that move by themselves, and units of position and force.
        self.joints = tuple(names[i] for i in self._joints)
        self.units = {names[i]: _UNITS[kinds[i]] for i in self._joints}
        if not self.joints:
            raise ValueError("the model has no joint that moves: leave out held")
        self._still = {int(self.model.jnt_qposadr[i]): x for i, x in still.items()}
        if gravity is not None:
            self.model.opt.gravity[:] = _place("gravity", gravity)
        if payload is not None and not isinstance(payload, Mapping):
            raise ValueError(f'payload must be a mapping such as {{"hand": 0.8}}, got {payload!r}')
        for body, load in (payload or {}).items():
            add_payload(self.model, _body_index(self.model, body), _parse_payload(body, load))
        self._data = _import_mujoco().MjData(self.model)

    @property
    def rotor_inertia(self) -> Floats:
        """Inertia of each joint's rotor behind its gear (`armature`), shape (joints,)."""
        own = self.model.jnt_dofadr[self._joints]
        return np.array(self.model.dof_armature[own], float)

    def limits(self, joint: str) -> tuple[float, float]:
        """Lowest and highest position of a joint [rad or m], infinite without limits."""
        one = self.model.joint(joint)
        if not bool(np.ravel(self.model.jnt_limited[one.id])[0]):
            return -math.inf, math.inf
        low, high = self.model.jnt_range[one.id]
        return float(low), float(high)

    def forces(self, motion: Motion) -> tuple[Floats, Floats]:
        """Force of each joint along a motion, and inertia about it, each shape (n, njoints)."""
        mujoco = _import_mujoco()
        n = len(motion.q)
        count = len(self.joints)
        force = np.empty((n, count))
        inertia = np.empty((n, count))
        answer = np.empty(self.model.nv)
        for k, ways in self._set_positions(motion):
            mujoco.mj_inverse(self.model, self._data)
            force[k] = ways @ self._data.qfrc_inverse
            for j in range(count):
                mujoco.mj_mulM(self.model, self._data, answer, ways[j])
                inertia[k, j] = ways[j] @ answer
        return force, inertia

    def force_alone(self, motion: Motion) -> Floats:
        """Force of each joint along a motion, shape (n, njoints)."""
        mujoco = _import_mujoco()
        force = np.empty((len(motion.q), len(self.joints)))
        for k, ways in self._set_positions(motion):
            mujoco.mj_inverse(self.model, self._data)
            force[k] = ways @ self._data.qfrc_inverse
        return force

    def regression_matrix(self, motion: Motion, links: Sequence[Link]) -> Floats:
        """Forces of the joints per inertial parameter, shape (n, njoints, nlinks, 10)."""
        mujoco = _import_mujoco()
        n = len(motion.q)
        model = self.model
        data = self._data
        kind = mujoco.mjtObj.mjOBJ_XBODY
        bodies = [link.bodies[0] for link in links]
        # Of each link, in its own frame: velocity, acceleration less gravity, and Jacobian.
        velocity, acceleration = np.empty((2, n, len(links), 6))
        jacobian = np.empty((n, len(links), 2, 3, model.nv))
        turns = np.empty((n, len(links), 9))
        ways = np.empty((n, len(self.joints), model.nv))
        for k, now in self._set_positions(motion):
            ways[k] = now
            mujoco.mj_inverse(model, data)
            mujoco.mj_rnePostConstraint(model, data)
            turns[k] = data.xmat[bodies]
            for i, body in enumerate(bodies):
                mujoco.mj_objectVelocity(model, data, kind, body, velocity[k, i], 1)
                mujoco.mj_objectAcceleration(model, data, kind, body, acceleration[k, i], 1)
                mujoco.mj_jacBody(model, data, *jacobian[k, i], body)
        turn = turns.reshape(n, len(links), 3, 3)
        lever = np.einsum("njd,nlsad,nlab->njlsb", ways, jacobian, turn, optimize=True)
        wrench = _wrench_regressor(velocity[..., :3], acceleration)
        return np.einsum("njlsb,nlsbp->njlp", lever, wrench, optimize=True)

    def links(self) -> list[Link]:
        """Links that joints move, in the order of the model."""
        model = self.model
        members = dict[int, list[int]]()
        for body in range(1, model.nbody):
            first = int(model.body_weldid[body])
            if first:
                members.setdefault(first, []).append(body)
        parents = {int(model.body_weldid[model.body_parentid[first]]) for first in members}
        data = _import_mujoco().MjData(model)
        _import_mujoco().mj_kinematics(model, data)
        return [
            Link(
                model.body(first).name or f"body {first}", tuple(bodies),
                np.sum([_inertial_parameters(model, data, b, first) for b in bodies], axis=0),
                first not in parents,
            )
            for first, bodies in members.items()
        ]  # fmt: skip

    def without(self, errors: Sequence[Change]) -> RigidArm:
        """The arm with some errors of its model corrected."""
        other = copy.copy(self)
        other.model = copy.copy(self.model)
        other._data = _import_mujoco().MjData(other.model)
        links = {link.name: link for link in self.links()}
        # A payload comes last: the factor of a link's mass is not one of what it carries.
        for error in sorted(errors, key=lambda one: one.kind == "payload"):
            if error.kind in OF_LINKS:
                other._change_link(links[error.link], error)
        return other

    def _change_link(self, link: Link, error: Change) -> None:
        """Scale the mass of a link, shift its centre of mass, or add a payload to it."""
        model = self.model
        first = link.bodies[0]
        kind = error.kind
        value = error.value
        if kind == "payload":
            second = _symmetric(error.moments)
            add_payload(model, first, Payload(value, np.array(error.place), second))
            return
        data = _import_mujoco().MjData(model)
        _import_mujoco().mj_kinematics(model, data)
        for body in link.bodies:
            if kind == "mass":
                model.body_mass[body] *= value
                model.body_inertia[body] *= value
            else:
                own, frame = (data.xmat[one].reshape(3, 3) for one in (body, first))
                model.body_ipos[body] += own.T @ frame @ np.array(error.place)
        _import_mujoco().mj_setConst(model, data)

    def _set_positions(self, motion: Motion) -> Iterator[tuple[int, Floats]]:
        """Put the model to each sample; the ways of all degrees of freedom per joint, (nj, nv)."""
        model = self.model
        data = self._data
        places, dofs = (one[self._joints] for one in (model.jnt_qposadr, model.jnt_dofadr))
        ways = np.zeros((len(self.joints), model.nv))
        ways[np.arange(len(self.joints)), dofs] = 1.0
        data.qpos[:], data.qvel[:], data.qacc[:] = model.qpos0, 0.0, 0.0
        for place, x in self._still.items():
            data.qpos[place] = x
        for k in range(len(motion.q)):
            data.qpos[places] = motion.q[k]
            data.qvel[dofs], data.qacc[dofs] = motion.v[k], motion.a[k]
            for one in self._followers:
                self._move_follower(one, ways)
            yield k, ways

    def _move_follower(self, one: Follower, ways: Floats) -> None:
        """Move a joint along with its leader."""
        model = self.model
        data = self._data
        numbers = (one.follower, one.leader)
        places, dofs = ([int(a[i]) for i in numbers] for a in (model.jnt_qposadr, model.jnt_dofadr))
        far = data.qpos[places[1]] - model.qpos0[places[1]]
        c = one.coefficients[::-1]
        slope = np.polyval(np.polyder(c), far)
        bend = np.polyval(np.polyder(c, 2), far)
        data.qpos[places[0]] = model.qpos0[places[0]] + np.polyval(c, far)
        v = data.qvel[dofs[1]]
        a = data.qacc[dofs[1]]
        data.qvel[dofs[0]], data.qacc[dofs[0]] = slope * v, slope * a + bend * v * v
        ways[:, dofs[0]] = slope * ways[:, dofs[1]]


def _import_mujoco() -> Any:
    """The engine, imported when it is needed."""
    try:
        import mujoco
    except ImportError:
        raise ImportError(
            "a model of an arm needs MuJoCo: pip install mujoco (from 4.0 on, mujoco-core is "
            "enough)"
        ) from None
    return mujoco


def _load_model(model: Any) -> Any:
    """A compiled model of its own."""
    if isinstance(model, (str, os.PathLike)):
        return _compile_file(existing_file(model))
    if isinstance(model, _import_mujoco().MjModel):
        return copy.copy(model)
    raise ValueError(
        f"model must be the path of an MJCF or URDF file, or a mujoco.MjModel, got {model!r}"
    )


# What MuJoCo says of inertias that no body can have, and what to put into the file.
_OF_INERTIAS = ("balanceinertia", "mjMINVAL")
_BOUNDS = (
    '; its smallest inertias are placeholders: <compiler balanceinertia="true" boundmass="1e-3" '
    'boundinertia="1e-6"/> bounds them, in an MJCF, or within <mujoco> in a URDF'
)


def _without_friction(model: Any) -> Any:
    """The model without friction, limits and contacts."""
    model.opt.disableflags |= int(_import_mujoco().mjtDisableBit.mjDSBL_CONSTRAINT)
    for part in ("dof", "tendon"):
        for name in ("frictionloss", "damping", "dampingpoly"):  # a polynomial since MuJoCo 3.5
            if hasattr(model, f"{part}_{name}"):
                getattr(model, f"{part}_{name}")[:] = 0.0
    return model


def _compile_file(path: Path) -> Any:
    """The model of a file; meshes that are missing are not needed where inertias are given."""
    mujoco = _import_mujoco()
    try:
        spec = mujoco.MjSpec.from_file(str(path))
        spec.compiler.fusestatic = False  # keeps the names of links that do not move
        try:
            return spec.compile()
        except ValueError:
            for geom in list(spec.geoms):
                if geom.parent.explicitinertial:
                    spec.delete(geom)
            for mesh in list(spec.meshes):
                spec.delete(mesh)
            return spec.compile()
    except ValueError as problem:
        said = ", ".join(str(problem).split("\n"))
        mend = _BOUNDS if any(word in said for word in _OF_INERTIAS) else ""
        raise ValueError(f"model {path.name} is refused by MuJoCo: {said}{mend}") from None


def _stated_friction(model: Any) -> dict[str, tuple[float, float]]:
    """Viscous coefficient and Coulomb level of each joint of a model."""
    levels = {}
    for i in range(model.njnt):
        at = int(model.jnt_dofadr[i])
        damping = float(np.ravel(model.dof_damping[at])[0])
        levels[model.joint(i).name] = damping, float(model.dof_frictionloss[at])
    return levels


def _refuse_others(names: Sequence[str], kinds: Sequence[str]) -> None:
    """Refuse joints that have no single axis or no name."""
    for i, (name, kind) in enumerate(zip(names, kinds, strict=True)):
        if kind == "free":
            raise ValueError(
                f"joint {name or i} is free: the forces on a floating base are not in the log. Fix "
                "the base: take the free joint out of the model, and give gravity=(x, y, z) of a "
                "base that is not upright"
            )
        if kind == "ball":
            raise ValueError(
                f"joint {name or i} is a ball joint: friction is of one axis; model it as three "
                "hinges"
            )
        if not name:
            raise ValueError(f"joint {i} of the model ({kind}) has no name: give it the log's")


def _find_followers(model: Any, names: Sequence[str]) -> list[Follower]:
    """Joints that couplings of the model move; what closes a chain is refused."""
    mujoco = _import_mujoco()
    found = []
    for i in range(model.neq):
        if not bool(np.ravel(model.eq_active0)[i]):
            continue
        kind = mujoco.mjtEq(int(model.eq_type[i])).name
        if kind != "mjEQ_JOINT":
            what = _CLOSED.get(kind, "a constraint")
            raise ValueError(
                f"the model has {what} (<equality> {kind.removeprefix('mjEQ_').lower()}): its "
                "forces do not follow from the motion alone. Cut it: take the constraint out and "
                "keep the joints of one branch, the bodies of the other as masses of that branch"
            )
        first = int(model.eq_obj1id[i])
        second = int(model.eq_obj2id[i])
        if second < 0:
            raise ValueError(
                f"joint {names[first]} is locked by an equality: take it out, and give "
                f'held=["{names[first]}"]'
            )
        found.append(Follower(first, second, np.array(model.eq_data[i, :5])))
    # Each leader must be put before those that follow it.
    for _ in found:
        followers = {one.follower for one in found}
        found.sort(key=lambda one: one.leader in followers)
    return found


def _held_joints(
    held: Mapping[str, float] | Sequence[str], model: Any, names: Sequence[str]
) -> dict[int, float]:
    """Joints that stand still, by their number, and where."""
    given = (held,) if isinstance(held, str) else held
    if not isinstance(given, Iterable):
        raise ValueError(
            f'held must be names such as ["gripper"], or a mapping to positions, got {held!r}'
        )
    found = {}
    for name in given:
        if name not in names:
            raise ValueError(
                f"held: the model has no joint {name!r}{did_you_mean(str(name), names)}"
            )
        i = list(names).index(name)
        place = float(model.qpos0[model.jnt_qposadr[i]])
        found[i] = finite(f"held[{name!r}]", given[name]) if isinstance(given, Mapping) else place
    return found


def _body_index(model: Any, name: str) -> int:
    """Number of a body."""
    names = [model.body(i).name for i in range(model.nbody)]
    if name not in names:
        raise ValueError(f"payload: the model has no body {name!r}{did_you_mean(name, names)}")
    return names.index(name)


def _place(name: str, values: ArrayLike) -> Floats:
    """Three finite numbers."""
    array = np.array(values, dtype=float)
    if array.shape != (3,) or not np.isfinite(array).all():
        raise ValueError(f"{name} must be three numbers (x, y, z), got {values!r}")
    return array


def _parse_payload(body: str, given: Any) -> Payload:
    """A payload as a user states it."""
    name = f"payload[{body!r}]"
    if isinstance(given, (int, float)):
        return Payload(positive(name, given, unit="kg"), np.zeros(3))
    if not isinstance(given, (tuple, list)) or len(given) != 2:
        raise ValueError(f"{name} must be a mass [kg] or (mass, (x, y, z)), got {given!r}")
    return Payload(positive(f"{name}[0]", given[0], unit="kg"), _place(f"{name}[1]", given[1]))


def add_payload(model: Any, body: int, load: Payload) -> None:
    """Add a point mass to a body of a compiled model, which may be negative."""
    mujoco = _import_mujoco()
    turn = np.empty(9)
    mujoco.mju_quat2Mat(turn, model.body_iquat[body])
    axes = turn.reshape(3, 3)
    own = float(model.body_mass[body])
    centre = np.array(model.body_ipos[body])
    total = own + load.mass
    new = (own * centre + load.mass * load.place) / total
    second = axes @ np.diag(model.body_inertia[body]) @ axes.T + own * _point_inertia(centre)
    second += load.mass * _point_inertia(load.place) if load.second is None else load.second
    moments, axes = np.linalg.eigh(second - total * _point_inertia(new))
    axes[:, 2] *= np.sign(np.linalg.det(axes))
    mujoco.mju_mat2Quat(model.body_iquat[body], np.ascontiguousarray(axes).ravel())
    model.body_mass[body], model.body_ipos[body] = total, new
    model.body_inertia[body] = np.maximum(moments, 0.0)
    mujoco.mj_setConst(model, mujoco.MjData(model))


def _point_inertia(place: Floats) -> Floats:
    """Moments of inertia of 1 kg at a place, shape (3, 3)."""
    return np.asarray(place @ place * np.eye(3) - np.outer(place, place))


def _symmetric(moments: Sequence[float]) -> Floats:
    """The matrix of second moments."""
    found = np.zeros((3, 3))
    for value, (i, j) in zip(moments, _SECOND, strict=True):
        found[i, j] = found[j, i] = value
    return found


def _inertial_parameters(model: Any, data: Any, body: int, frame: int) -> Floats:
    """Ten inertial parameters of a body about the origin of the frame of another one."""
    turn = data.xmat[frame].reshape(3, 3).T
    centre = turn @ (data.xipos[body] - data.xpos[frame])
    axes = np.empty(9)
    _import_mujoco().mju_quat2Mat(axes, model.body_iquat[body])
    own = turn @ data.xmat[body].reshape(3, 3) @ axes.reshape(3, 3)
    mass = float(model.body_mass[body])
    second = own @ np.diag(model.body_inertia[body]) @ own.T
    second += mass * _point_inertia(centre)
    return np.array([mass, *(mass * centre), *(second[i, j] for i, j in _SECOND)])


def _wrench_regressor(turning: Floats, acceleration: Floats) -> Floats:
    """Force and moment per inertial parameter, in the frame of the link, shape (..., 2, 3, 10).

    ::

        force   m a + (spin x + w x w x) h,      a the acceleration of the origin less gravity
        moment  h x a + I spin + w x I w,        h the first moments, I the second ones
    """
    spin = acceleration[..., :3]
    push = acceleration[..., 3:]
    rate = _cross_matrix(turning)
    change = _cross_matrix(spin)
    found = np.zeros((*turning.shape[:-1], 2, 3, N_INERTIAL))
    found[..., 0, :, 0] = push
    found[..., 0, :, 1:4] = change + rate @ rate
    found[..., 1, :, 1:4] = -_cross_matrix(push)
    for column, (i, j) in enumerate(_SECOND, start=4):
        unit = np.zeros((3, 3))
        unit[i, j] = unit[j, i] = 1.0
        gyroscopic = (rate @ (turning @ unit)[..., None])[..., 0]
        found[..., 1, :, column] = spin @ unit + gyroscopic
    return found


def _cross_matrix(a: Floats) -> Floats:
    """Matrix of the product with a vector from the left, shape (..., 3, 3)."""
    x = a[..., 0]
    y = a[..., 1]
    z = a[..., 2]
    zero = np.zeros(a.shape[:-1])
    rows = [[zero, -z, y], [z, zero, -x], [-y, x, zero]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
