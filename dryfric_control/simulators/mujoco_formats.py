"""Joint friction in the words of MuJoCo: those of version 3.2, and those of 4.0."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from dryfric_control.arrays import Floats
from dryfric_control.model import effects
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.model.friction import MOST_EXCESS, Stribeck
from dryfric_control.simulators.files import number, quote_attribute
from dryfric_control.simulators.joint_values import Format

#: Friction of MuJoCo is soft: a joint at rest creeps, with these 500 times less.
STIFF = {"solreffriction": "0.002 1", "solimpfriction": "0.999 0.9999 0.001"}
#: Parts of the attribute `lugre`, in its order.
LUGRE = tuple(f"lugre_{part}" for part in ("stiffness", "damping", "coulomb", "static", "stribeck"))
# Stiffness of bristles times step^2 over inertia: less lets a joint go early, more is no better.
_BRISTLES = 1.0
# The most that an elastic contact may have: at 1, explicit steps do not damp it any more.
_CONTACT = 0.4
# Coulomb level of bristles that carry a peak alone, as a part of it; zero would divide by zero.
_RESIDUE = 1e-4
# Stiffness of Dahl's bristles over that of Prandtl's element whose free runs they are closest to
# (mean over the random joints of benchmarks/simulators.py; 1 and 3 are a fifth worse).
_PRANDTL = 1.5
# From this value of `bristles` on, a contact yields gradually.
_GRADUAL = 0.5
# Stribeck velocities that are tried where the axis has none of its own.
_TRIED = 30


class Stepping(NamedTuple):
    """How a model steps in time."""

    timestep: float = 0.002  # s, MuJoCo's default
    integrator: str = "Euler"

    @property
    def bristles(self) -> bool:
        """Whether bristles are stable in it: RK4 integrates them explicitly."""
        return self.integrator.lower() != "rk4"


def _plain_values(c: Floats, *_: Any) -> dict[str, Any]:
    return {"frictionloss": float(c[0]), "damping": float(c[1])}


#: A level and a viscous coefficient, which every version reads.
PLAIN = Format(_plain_values, armature="armature")


class _Words(NamedTuple):
    """What a joint is described by beside a level and a viscous coefficient."""

    step: float  # s
    drag: bool = False  # damping that grows with the square of velocity
    peak: bool = False  # Stribeck's
    contact: effects.Presliding | None = None  # elastic before it slides

    def columns(self, v: Floats, shape: float) -> Floats:
        """Friction for each coefficient of 1."""
        found = [np.sign(v), v]
        if self.drag:
            found.append(v * np.abs(v))
        if self.peak:
            found.append(np.sign(v) * np.exp(-((v / shape) ** 2)))
        return np.column_stack(found)

    def shapes(self, speed: Floats, axis: FrictionAxis) -> Iterable[float]:
        """Stribeck velocities to choose from."""
        if not self.peak:
            return (1.0,)
        if axis.stribeck is not None:
            return (axis.stribeck.speed,)
        top = float(np.max(speed))
        return np.geomspace(0.01 * top, top, _TRIED)

    def _parts(self, c: Floats) -> tuple[float, float, float, float]:
        """Level, viscous coefficient, drag and peak."""
        drag = float(c[2]) if self.drag else 0.0
        return float(c[0]), float(c[1]), drag, float(c[-1]) if self.peak else 0.0

    def values(self, c: Floats, shape: float, _: float, axis: FrictionAxis) -> dict[str, Any]:
        """Numbers of MuJoCo."""
        level, viscous, drag, peak = self._parts(c)
        found = {"frictionloss": level, "damping": viscous}
        if self.drag:
            found["damping_quadratic"] = drag
        if self.contact is not None:
            stiffness = contact_stiffness(self.contact, level)
            # Explicit steps take from the damping of a spring what is its stiffness times a step.
            damping = self.contact.damping + self.step * stiffness
            found["frictionloss"] = 0.0
            lugre = stiffness, damping, level, level + peak, float(shape)
        elif self.peak:
            # The level stays with the constraint, which holds and damps: bristles without damping
            # of their own carry the peak, so that their force never exceeds it.
            stiffness = _BRISTLES * axis.mass / self.step**2
            found["frictionloss"] = max(level - _RESIDUE * peak, 0.0)
            lugre = stiffness, 0.0, _RESIDUE * peak, peak, float(shape)
        else:
            return found
        return found | dict(zip(LUGRE, lugre, strict=True))

    def stated_axis(self, axis: FrictionAxis, c: Floats, shape: float) -> FrictionAxis:
        """The axis as far as it is stated."""
        level, viscous, drag, peak = self._parts(c)
        stribeck = None
        if peak > 0.0 and level > 0.0:
            stribeck = Stribeck(min(peak / level, MOST_EXCESS), float(shape))
        kept: tuple[Any, ...] = () if self.contact is None else (self.contact,)
        if drag > 0.0:
            kept += (effects.QuadraticDrag(drag=drag),)
        return axis.replace(coulomb=level, viscous=viscous, stribeck=stribeck, effects=kept)

    def format(self) -> Format:
        """The format of these words."""
        return Format(
            self.values,
            armature="armature",
            columns=self.columns,
            shapes=self.shapes,
            reduced=self.stated_axis,
            stated=frozenset({"presliding"} if self.contact is not None else ()),
        )


def contact_stiffness(contact: effects.Presliding, level: float) -> float:
    """Stiffness of bristles for an elastic contact with a Coulomb level."""
    gradual = contact.bristles >= _GRADUAL
    return (1.0 if gradual else _PRANDTL) * level / contact.distance


def formats(stepping: Stepping, bristles: bool) -> Callable[[FrictionAxis], Sequence[Format]]:
    """Formats of version 4.0 for an axis, the simplest first; `bristles`: whether it may have."""
    return functools.partial(_formats, stepping, bristles and stepping.bristles)


def _formats(stepping: Stepping, bristles: bool, axis: FrictionAxis) -> Sequence[Format]:
    step = stepping.timestep
    contact = None
    for effect in axis.effects if bristles else ():
        if isinstance(effect, effects.Presliding):
            stiffness = contact_stiffness(effect, axis.coulomb.mean)
            # A contact that is stiffer than a step can follow is a hard one.
            contact = effect if stiffness * step**2 <= _CONTACT * axis.mass else None
    words = [_Words(step, drag, peak, contact) for peak in (False, True) for drag in (False, True)]
    return [one.format() for one in words if bristles or not one.peak]


def has_bristles(values: Mapping[str, Any]) -> bool:
    """Whether a joint has a friction actuator."""
    return LUGRE[0] in values


def joint_attributes(values: Mapping[str, Any], stiff: bool, full: bool) -> dict[str, str]:
    """Attributes of a joint; with `full`, damping has all coefficients and none is inherited."""
    quadratic = values.get("damping_quadratic", 0.0)
    damping = number(values["damping"])
    if full or quadratic > 0.0:
        damping = f"{damping} {number(quadratic)} 0"
    found = {
        "frictionloss": number(values["frictionloss"]),
        "damping": damping,
        "armature": number(values["armature"]),
    }
    return found | (STIFF if stiff else {})


def lugre_text(values: Mapping[str, Any]) -> str:
    """The attribute of a friction actuator."""
    return " ".join(number(values[name]) for name in LUGRE)


def friction_actuator(joint: str, values: Mapping[str, Any], name: str = "") -> str:
    """Element that carries bristles of a joint."""
    attributes = {"name": name} if name else {}
    attributes |= {
        "joint": joint,
        "input": "none",
        "motorconst": "0",
        "resistance": "1",
        "lugre": lugre_text(values),
        # Defaults of any actuator are those of this one as well.
        "gear": "1",
        "damping": "0",
        "armature": "0",
        "saturation": "0 0 0",
    }
    return f"<dcmotor {' '.join(f'{n}={quote_attribute(v)}' for n, v in attributes.items())}/>"
