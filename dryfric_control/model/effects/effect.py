"""What a physical effect is, and the register of all that are known."""

from __future__ import annotations

import dis
import functools
import inspect
import itertools
import math
import re
import sys
from collections.abc import Callable, Iterator
from dataclasses import MISSING, dataclass, field, fields
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, dataclass_transform

import numpy as np
from numba import cfunc

from dryfric_control.arguments import with_argument_hints
from dryfric_control.arrays import Floats
from dryfric_control.checks import check_boolean, finite, one_of, positive, string
from dryfric_control.compiled.axis_step import LAW, MOST_SLOPE
from dryfric_control.compiled.states import FLOW
from dryfric_control.model.effects.columns import Column, View, by_law
from dryfric_control.model.effects.interval import Box, Interval
from dryfric_control.text import fields_of, list_in_docstring
from dryfric_control.units import on_axis

if TYPE_CHECKING:
    from dryfric_control.model.axis import FrictionAxis as BaseAxis
else:
    BaseAxis = Any

#: What an effect may act on; those of the first row act by a law.
ACTIONS = (
    *("input", "force", "friction", "reading", "memory"),
    *("axis", "delay", "lag", "contact", "transmission"),
)
_BY_LAW = ACTIONS[:5]
#: Those with a state that the kernel knows, of which an axis holds one each.
WITH_STATE = ACTIONS[6:]
#: Those of them that a spring holds, with a motion of its own.
ELASTIC = WITH_STATE[2:]
#: All that have states beside position and velocity.
REMEMBERING = ("memory", *WITH_STATE)
#: The method that an action needs.
_METHODS = {
    **dict.fromkeys(_BY_LAW, ("law", "a static method law(t, x, v, u, ..., p)")),
    "axis": ("alter", "a method alter(axis) that returns a FrictionAxis"),
    **dict.fromkeys(
        WITH_STATE, ("inner", "a method inner(axis) that returns dfc.effects.Inner(...)")
    ),
}

#: What a parameter is, and the range in which a diagnosis searches it if that is
#: narrower than its bounds: a load next to nothing is an elastic contact, and a
#: drive later than 1 s is no drive for a position loop.
KINDS: dict[str, tuple[float, float]] = {
    "amount": (-math.inf, math.inf),
    "place": (-math.inf, math.inf),
    "angle": (-math.inf, math.inf),
    "share": (0.05, 0.95),
    "time": (0.0, 1.0),
    "speed": (-math.inf, math.inf),
}


def parameter(
    unit: str,
    doc: str,
    *,
    bounds: tuple[float, float] = (-math.inf, math.inf),
    default: float | None = None,
    kind: str = "amount",
    free: bool = True,
    breaks_away: bool = False,
    logarithmic: bool = False,
    neutral: float | None = 0.0,
    size: float | None = None,
) -> Any:
    """Declare one parameter of an effect.

    Parameters
    ----------
    unit : str
        Unit on an axis in metres and newtons, "1" for a ratio; "rad" for an angle.
    doc : str
        What the parameter is.
    bounds : tuple of float
        Smallest and largest allowed value.
    default : float, optional
        Value when the user gives none.
    kind : {"amount", "place", "angle", "share", "time", "speed"}, optional
        "place": a position; "angle": a phase.  A change of either has no percentage.  "share":
        part of the mass, 0 to 1.  "time": by how much the drive acts late.  "speed": that of
        sliding over which something fades.  "amount": any other.
    free : bool, optional
        Whether the name of the effect includes it in a fit and in a diagnosis; else it stays
        where it is unless it is named itself.
    breaks_away : bool, optional
        Whether it acts at breakaway alone: it is fitted from several starts and with longer steps.
    logarithmic : bool, optional
        Whether a fit searches it on a logarithmic scale.
    neutral : float, optional
        Value with which the effect does nothing, where there is no default; None if none does.
    size : float, optional
        Change that matters.  Default: the value a fit starts from.

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> dfc.effects.parameter("N", "force", bounds=(0.0, 10.0)).metadata["unit"]
    'N'
    """
    string("unit", unit)
    string("doc", doc)
    try:
        low, high = bounds
        ordered = float(low) < float(high)
    except (TypeError, ValueError):
        raise ValueError(f"bounds must be (low, high), got {bounds!r}") from None
    if not ordered:
        raise ValueError(f"bounds must run from low to high, got {bounds!r}")
    if default is not None and not low <= finite("default", default) <= high:
        raise ValueError(f"default must lie within bounds = {bounds!r}, got {default!r}")
    one_of("kind", kind, KINDS)
    flags = {"free": free, "breaks_away": breaks_away, "logarithmic": logarithmic}
    flags = {name: check_boolean(name, flag) for name, flag in flags.items()}
    if neutral is not None:
        finite("neutral", neutral)
    if size is not None:
        positive("size", size)
    said: dict[str, Any] = {"unit": unit, "doc": doc, "bounds": (low, high), "kind": kind}
    said |= flags | {"neutral": neutral, "size": size, "optional": default is not None}
    return field(default=MISSING if default is None else default, metadata=said)


class Inner(NamedTuple):
    """Numbers of delay, lag, contact and transmission.

    Parameters
    ----------
    delay, lag : float
        Delay and time constant of the drive force [s].
    contact : float
        Stiffness of an elastic contact [N/m].
    half_gap : float
        Half the gap between motor and load [m].
    stiffness, damping : float
        Of an elastic transmission between them, or of the ends of the gap [N/m], [N s/m].
    load_fraction : float
        Share of the mass behind the gap or transmission.
    on_load : float
        1 if the encoder is on the load, behind the gap or transmission.
    contact_damping : float
        Of an elastic contact [N s/m].
    bristles : float
        1 if the elastic contact consists of bristles.
    motor_rubs : float
        1 if friction and all forces act on the motor, not on the load.

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> dfc.effects.Inner(delay=2e-3).delay
    0.002
    """

    delay: float = 0.0
    lag: float = 0.0
    contact: float = 0.0
    half_gap: float = 0.0
    stiffness: float = 0.0
    damping: float = 0.0
    load_fraction: float = 0.0
    on_load: float = 0.0
    contact_damping: float = 0.0
    bristles: float = 0.0
    motor_rubs: float = 0.0


# Number of states at which a law without slopes of its own is tried.
_STATES = 64
# Step of a difference there, relative.
_DIFFERENCE = 1e-6
# What the largest slope may be beyond that at these states, as a factor.
_MARGIN = 1.5
# Range of the times of these states [s].
_TIMES = (1e-4, 1e2)
# Range of their velocities, over the largest velocity.
_SPEEDS = (1e-3, 1.0)
# Inputs between which an unknown input law counts as linear, and their range [N].
_KNOTS = tuple(s * 10.0 ** (k / 16.0) for s in (-1.0, 1.0) for k in range(-48, 65))


class Slopes(NamedTuple):
    """Largest slopes of the force of a law.

    Parameters
    ----------
    time : float
        Over time, and time at rest [N/s].
    place : float
        Over position [N/m].
    velocity : float
        Over velocity [N s/m].
    load : float
        Over the force it acts on [1].
    relative : float
        1 where they are parts of the Coulomb level, for a level of 1 N.
    bend : float
        Velocity over which the slope over velocity lasts [m/s]; inf where it does not change.

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    >>> dfc.effects.Spring(stiffness=200.0).slopes(axis, speed=1.0).place
    200.0
    """

    time: float = 0.0
    place: float = 0.0
    velocity: float = 0.0
    load: float = 0.0
    relative: float = 0.0
    bend: float = math.inf

    def within_range(self) -> tuple[float, ...]:
        """The same as numbers whose products do not overflow."""
        return tuple(min(slope, MOST_SLOPE) for slope in self)


#: What an effect depends on, by the arguments that its law reads.
_FLAGS = {
    "depends_on_place": {"x"},
    "depends_on_speed": {"v", "u", "direction"},
    "depends_on_load": {"u"},
    "depends_on_time": {"t"},
}
_ARGUMENTS = ("t", "x", "v", "u", "level", "direction", "rest", "p")
#: Those of a flow or a jump: the number of the state comes first.
_FLOW_ARGUMENTS = ("i", *_ARGUMENTS)


def read_by(law: Any, arguments: tuple[str, ...] = _ARGUMENTS) -> set[str]:
    """Arguments that a law, or a flow, reads; all of them if nobody can see."""
    law = getattr(law, "__func__", law)
    code = getattr(getattr(law, "py_func", law), "__code__", None)
    if code is None or code.co_argcount != len(arguments):
        return set(arguments)
    named = (i.argval for i in dis.get_instructions(code) if "FAST" in i.opname)
    read = {one for names in named for one in ([names] if isinstance(names, str) else names)}
    return {a for a, name in zip(arguments, code.co_varnames, strict=False) if name in read}


def read_by_flow(flow: Any) -> set[str]:
    """Arguments that a flow or a jump reads; none where there is none."""
    return read_by(flow, _FLOW_ARGUMENTS) if flow is not None else set()


@dataclass(frozen=True)
class Effect:
    """Base of every physical effect.

    A subclass is a frozen dataclass whose fields are declared with `parameter`, with a `law`, or a
    method `alter` or `inner`; the guide to an effect of your own says what it sets.

    Notes
    -----
    ``law(t, x, v, u, level, direction, rest, p)``, with the parameters p in the order of the
    fields, is compiled once, whatever the combination of effects.  It returns, by `action`:

    - "force": a force added to the drive [N]; `u` is the drive force;
    - "friction": an addition to the Coulomb level [N]; `level` is that level here and in this
      `direction`, `u` the load of the transmission, which is the drive less the force effects,
      `rest` the time at rest.  The Stribeck peak raises what it adds, unless `within_peak` is
      false; of those that it raises, `level` contains what the ones before add, those that depend
      on the direction first: shares of the level multiply;
    - "input": the drive force that replaces `u` [N];
    - "reading": an addition to the encoder reading [m]; it must change by less than the position;
    - "memory": a force added to the drive, or with ``adds_to = "friction"`` an addition to the
      Coulomb level [N], from states of its own, which `p` contains after the parameters.

    An effect with a memory declares, beside its law,

    1. `states`: a dict of names and units; all are zero at the start;
    2. ``flow(i, t, x, v, u, level, direction, rest, p)``, compiled: the rate of state i; `u` is the
       drive force, `level` the Coulomb level of the axis here in this `direction`; at rest
       `direction` is 0, and `level` that of the direction +;
    3. `limits`, a property: lowest and highest value of each state, default none, made from the
       parameters alone.  A state at a limit stays there while its flow points beyond; a step ends
       as one gets there.  What a limit would have to follow, such as the velocity, scales the law
       instead: with z between fixed limits, -stiffness z r(v) slips at a level that r(v) lowers;
    4. ``jump(i, t, x, v, u, level, direction, rest, p)``, compiled, optional: the value of state i
       after it has got to a limit.

    Flow and law are smooth but at the limits, where the velocity changes its sign, and in `edges`.

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> dfc.effects.Spring(stiffness=200.0).describe()
    'spring: stiffness = 200 N/m, rest = 0 m'
    """

    slug: ClassVar[str] = ""
    title: ClassVar[str] = ""
    action: ClassVar[str] = ""
    explanation: ClassVar[str] = ""
    experiment: ClassVar[str] = ""
    #: Whether position, speed and mode do not determine all it does: it looks back.  That, and
    #: that it does not read the position, holds of all with a state unless they say otherwise.
    remembers: ClassVar[bool] = False
    #: Whether it reads the position; runs of an axis that does not anywhere are
    #: the same from every place.  This and the next three are read off a law.
    depends_on_place: ClassVar[bool] = True
    #: Whether a force law reads v, u or direction; one that does not costs less.
    depends_on_speed: ClassVar[bool] = True
    #: Whether a friction law reads u; one that does not costs less, and is tried by a diagnosis
    #: also where the motion is imposed.
    depends_on_load: ClassVar[bool] = True
    #: Whether it changes with time.
    depends_on_time: ClassVar[bool] = False
    #: Whether it differs between the directions of motion beyond its sign.
    depends_on_direction: ClassVar[bool] = False
    #: Whether the Stribeck peak raises what a friction law adds; not where it is
    #: the friction of another contact, or of the same one at rest alone.
    within_peak: ClassVar[bool] = True
    #: How many assumptions it makes: of causes that explain a record equally well,
    #: the one of lowest rank is named.
    rank: ClassVar[float] = math.inf
    #: Whether a diagnosis may find a second one beside it, of another period.
    repeats: ClassVar[bool] = False
    #: Whether its law may have any shape: a diagnosis tries it where none of the others explains.
    any_shape: ClassVar[bool] = False
    #: Base parameter that it multiplies; a diagnosis fits that one instead.
    base: ClassVar[str] = ""
    #: Field of the axis that may hold it in place of `effects`; `alter` sets it.
    axis_field: ClassVar[str] = ""
    #: Parameter that only adds a constant force; beside one that is free, nothing shows it.
    adds_constant: ClassVar[str] = ""
    #: Base parameter with which it trades in a fit, and what separates the two.
    trades: ClassVar[tuple[str, str]] = ("", "")
    #: Names and units of the states of an effect with a memory.
    states: ClassVar[dict[str, str]] = {}
    #: What the law of an effect with a memory adds to: "force" or "friction".
    adds_to: ClassVar[str] = "force"
    law: ClassVar[Callable[..., float]]
    flow: ClassVar[Callable[..., float] | None] = None
    jump: ClassVar[Callable[..., float] | None] = None
    alter: ClassVar[Callable[..., Any]]

    def __init_subclass__(cls) -> None:
        own = vars(cls)
        flags = {}
        if "law" in own:
            read = read_by(own["law"])
            flags = {flag: not read.isdisjoint(names) for flag, names in _FLAGS.items()}
            if cls.action == "memory":
                # Of the other two, the kernel asks for the law alone.
                whole = read | read_by_flow(cls.flow) | read_by_flow(cls.jump)
                some = ("depends_on_place", "depends_on_time")
                flags |= {flag: not whole.isdisjoint(_FLAGS[flag]) for flag in some}
                flags["remembers"] = True
        elif own.get("action") in WITH_STATE:
            flags = {"remembers": True, "depends_on_place": False}
        for flag in flags.keys() - own.keys():
            setattr(cls, flag, flags[flag])

    def __post_init__(self) -> None:
        for item in fields(self):
            value = finite(f"{self.slug}.{item.name}", getattr(self, item.name))
            low, high = item.metadata["bounds"]
            if not low <= value <= high:
                unit = "" if item.metadata["unit"] == "1" else f" {item.metadata['unit']}"
                raise ValueError(
                    f"{self.slug}.{item.name} must lie between {low:g} and {high:g}{unit}, "
                    f"got {value!r}"
                )
            object.__setattr__(self, item.name, value)

    @property
    def values(self) -> tuple[float, ...]:
        """Values of the parameters, in the order of `parameters`."""
        return tuple(getattr(self, item.name) for item in fields(self))

    @property
    def limits(self) -> tuple[tuple[float, float], ...]:
        """Lowest and highest value of each state, infinite where there is none."""
        return ((-math.inf, math.inf),) * len(self.states)

    @property
    def shortest_length(self) -> float:
        """Length over which the law may oscillate, inf where it does not: the longest step."""
        return math.inf

    @property
    def shortest_time(self) -> float:
        """Time over which the law may oscillate by itself [s], inf where it does not."""
        return math.inf

    @property
    def stiffest(self) -> float:
        """Largest stiffness of a force law [N/m]: a sample must not hold too much of its swing."""
        return stiffness_of_states(self) if self.action == "memory" else 0.0

    @property
    def edges(self) -> tuple[float, ...]:
        """Places at which the force bends or jumps [m]: there a step ends."""
        return ()

    @property
    def corners(self) -> tuple[float, ...]:
        """Inputs at which an input law bends; between them it counts as linear [N]."""
        if self.action != "input":
            return ()
        given = np.array([0.0, 1.0, *_KNOTS])
        found = np.array([self.law(0.0, 0.0, 0.0, u, 0.0, 0.0, 0.0, self.values) for u in given])
        straight = found[0] + (found[1] - found[0]) * given
        scale = np.abs(straight).max()
        return () if np.abs(found - straight).max() <= 1e-12 * scale else _KNOTS

    def slopes(self, axis: BaseAxis, speed: float) -> Slopes:
        """Largest slopes of its force, by default at many states.

        Parameters
        ----------
        axis : FrictionAxis
            The axis that has the effect, its base parameters those that act.
        speed : float
            Largest velocity [m/s].
        """
        return slopes_by_law(self, axis, speed)

    def rate_bound(
        self, axis: BaseAxis, velocity: float, acceleration: float = 0.0, load_rate: float = 0.0
    ) -> float:
        """Largest rate of its force while the axis moves as stated.

        Parameters
        ----------
        axis : FrictionAxis
            The axis that has the effect, its base parameters those that act.
        velocity, acceleration : float
            Largest magnitudes [m/s], [m/s^2].
        load_rate : float, optional
            Largest rate of the force that it acts on [N/s].

        Examples
        --------
        >>> import dryfric_control as dfc
        >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
        >>> dfc.effects.WarmUp(rise=0.5, time_constant=2.0).rate_bound(axis, velocity=0.0)
        2.0
        """
        slopes = self.slopes(axis, velocity)
        rate = slopes.time + slopes.place * velocity + slopes.velocity * acceleration
        rate += slopes.load * load_rate
        return rate * (largest_level(axis) if slopes.relative else 1.0)

    @property
    def periods(self) -> tuple[float, float]:
        """Time [s] and length after which the law repeats, inf where it does not."""
        # C in single precision leaves out whole periods: it stays accurate far from zero.
        return math.inf, math.inf

    @classmethod
    def parameters(cls) -> dict[str, dict[str, Any]]:
        """Unit, bounds and meaning of every parameter, by name."""
        return {item.name: dict(item.metadata) for item in fields(cls)}

    @classmethod
    def units(cls, units: tuple[str, str] = ("m", "N")) -> dict[str, str]:
        """Unit of every parameter; angles are in radians on any axis.

        Parameters
        ----------
        units : tuple of str, optional
        """
        return {
            name: said["unit"] if said["kind"] == "angle" else on_axis(said["unit"], units)
            for name, said in cls.parameters().items()
        }

    @classmethod
    def named_parameters(cls) -> tuple[str, ...]:
        """Free parameters that the name of the effect includes."""
        return tuple(item.name for item in fields(cls) if item.metadata["free"])

    @property
    def unused_parameters(self) -> tuple[str, ...]:
        """Parameters that act in another form of it alone: held at zero, which is not neutral."""
        return tuple(
            name
            for name, said in self.parameters().items()
            if not said["free"] and said["neutral"] is None and getattr(self, name) == 0.0
        )

    @property
    def by_drive(self) -> bool:
        """Whether its load is the drive alone, without the force effects that the drive holds."""
        return False

    @classmethod
    def loaded(cls) -> bool:
        """Whether it is friction that depends on the load."""
        return cls.action == "friction" and cls.depends_on_load

    @classmethod
    def acts_as_force(cls) -> bool:
        """Whether it is a force on the mass of a sliding axis."""
        return cls.action not in (*REMEMBERING, "reading")

    @classmethod
    def has_linear_states(cls) -> bool:
        """Whether its states, if any, follow a linear recursion."""
        return cls.action not in ("memory", *ELASTIC)

    @classmethod
    def excluded_actions(cls) -> tuple[str, ...]:
        """Actions of effects that no axis has beside it."""
        if cls.action == "memory":
            return ELASTIC
        if cls.action in ELASTIC:
            return (cls.action, "memory")
        return (cls.action,) if cls.action in WITH_STATE else ()

    @classmethod
    def needs_velocities(cls) -> bool:
        """Whether only motion at different velocities shows it."""
        free = (p for p in cls.parameters().values() if p["free"])
        units = (re.findall("[a-z]+", p["unit"]) for p in free)
        return any({"m", "s"} <= set(names) for names in units)

    def inner(self, axis: BaseAxis) -> Inner:
        """Numbers of its own state: delay, lag, contact, transmission.

        Parameters
        ----------
        axis : FrictionAxis
            The axis that has the effect, its base parameters those that act.
        """
        return Inner()

    def bounds(self, box: Box) -> Interval | None:
        """Bounds of its law over a box of the arguments.

        None, which it is by default, says that there are none: a certificate does not cover it.

        Parameters
        ----------
        box : Box
            The law's arguments, each an interval.
        """
        return None

    @classmethod
    def start(cls, axis: BaseAxis, size: Callable[[str], float]) -> Effect:
        """Effect from which a fit starts, with no influence yet.

        Parameters
        ----------
        axis : FrictionAxis
        size : callable
            Typical size in the records of a quantity with a given unit.
        """
        values: dict[str, float] = {}
        for item in fields(cls):
            low, high = item.metadata["bounds"]
            neutral = item.default if item.default is not MISSING else item.metadata["neutral"]
            if neutral is None or not low <= neutral <= high:
                given = ", ".join(f"{one.name}=..." for one in fields(cls))
                raise ValueError(
                    f"free: {cls.slug}.{item.name} has no neutral value to start from: put the "
                    "effect with first guesses into the axis, axis.replace(effects=("
                    f"{cls.__name__}({given}),))"
                )
            values[item.name] = float(neutral)
        return cls(**values)

    @classmethod
    def columns(cls, view: View) -> Iterator[Column]:
        """What it adds to a model: a column for each of its shapes.

        Parameters
        ----------
        view : View
            The states of the model in the records.
        """
        yield from by_law(cls, view)

    def changes(self, view: View) -> Iterator[Column]:
        """What a change of it adds to a model that has it, in columns.

        None by default: a diagnosis then changes its parameters one by one.

        Parameters
        ----------
        view : View
            The states of the model in the records.
        """
        yield from ()

    def forms(self, axis: BaseAxis) -> tuple[Effect, ...]:
        """The same effect under other laws, none by default.

        Parameters
        ----------
        axis : FrictionAxis
            The axis that has the effect, its base parameters those that act.
        """
        return ()

    def blind(self, axis: BaseAxis, force: float) -> tuple[float, float]:
        """Distance [m] and time [s] after a reversal without its force.

        Parameters
        ----------
        axis : FrictionAxis
        force : float
            RMS of the drive force [N].
        """
        return 0.0, 0.0

    def base_at(self, axis: BaseAxis, t: float) -> tuple[str, float] | None:
        """The base parameter that it changes with time, at a time.

        Parameters
        ----------
        axis : FrictionAxis
            The axis that has the effect.
        t : float
            Time [s].

        Returns
        -------
        tuple of str and float, or None
            "coulomb" with the mean level, or "viscous"; by default none.
        """
        return None

    def plausible(self, axis: BaseAxis) -> bool:
        """Whether an axis may have it, as far as its values tell.

        Parameters
        ----------
        axis : FrictionAxis
        """
        return True

    def beyond_noise(self, u: Floats, noise: float) -> bool:
        """Whether it changes inputs by more than their noise.

        Parameters
        ----------
        u : ndarray, shape (n,)
            Recorded inputs.
        noise : float
            RMS of the random force [N].
        """
        return True

    def told_from_drive(self, u: Floats, dt: float) -> bool:
        """Whether the drive tells its force from that of any law.

        Parameters
        ----------
        u : ndarray, shape (n,)
            Recorded inputs.
        dt : float
            Sampling time [s].
        """
        return True

    def viscous_in(self, direction: int) -> float:
        """Viscous coefficient that it adds in one direction [N s/m].

        Parameters
        ----------
        direction : int
            +1 or -1.
        """
        return 0.0

    def meaning(self, units: tuple[str, str]) -> str:
        """What its parameters amount to, in words; empty if evident.

        Parameters
        ----------
        units : tuple of str
        """
        return ""

    def to_dict(self) -> dict[str, Any]:
        """Id and parameters, ready for JSON."""
        return {"effect": self.slug} | fields_of(self)

    def describe(self, units: tuple[str, str] = ("m", "N")) -> str:
        """Id and parameters with units, in one line.

        Parameters
        ----------
        units : tuple of str, optional
        """
        shown = {name: "" if u == "1" else f" {u}" for name, u in self.units(units).items()}
        parts = (f"{name} = {getattr(self, name):.6g}{unit}" for name, unit in shown.items())
        return f"{self.slug}: {', '.join(parts)}"


def largest_level(axis: BaseAxis) -> float:
    """Largest Coulomb level of an axis over its travel [N]."""
    places = np.linspace(*(axis.travel or (0.0, 0.0)), 33)
    return float(max(axis.coulomb(places, s).max() for s in (1, -1)))


@functools.lru_cache(maxsize=1024)
def stiffness_of_states(effect: Effect) -> float:
    """Stiffness of a law by its states at zero, as far as they flow with the velocity [N/m]."""
    law = getattr(effect.law, "py_func", effect.law)
    flow: Any = getattr(effect.flow, "py_func", effect.flow)
    state = (0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.0)
    moving = (0.0, 0.0, _DIFFERENCE, *state[3:])
    total = 0.0
    for i in range(len(effect.states) if effect.adds_to == "force" else 0):
        bent = [_DIFFERENCE * (i == j) for j in range(len(effect.states))]
        zero = (*effect.values, *(0.0 for _ in bent))
        try:
            force = law(*state, (*effect.values, *bent)) - law(*state, zero)
            total += abs(force * (flow(i, *moving, zero) - flow(i, *state, zero)))
        except Exception:  # where it is not defined nothing can be said
            continue
    return total / _DIFFERENCE**2


@functools.lru_cache(maxsize=1024)
def slopes_by_law(effect: Effect, axis: BaseAxis, speed: float) -> Slopes:
    """Largest slopes of a law at many states of an axis, by differences."""
    law = getattr(effect.law, "py_func", effect.law)
    read = read_by(effect.law)
    level, (low, high) = largest_level(axis), axis.travel or (-1.0, 1.0)
    rng = np.random.default_rng(0)
    sign = rng.choice([-1.0, 1.0], (3, _STATES))
    soon, late = np.log(_TIMES)
    slow, fast = np.log(_SPEEDS)
    times = np.exp(rng.uniform(soon, late, (2, _STATES)))
    states = np.transpose([
        times[0], rng.uniform(low, high, _STATES),
        sign[0] * speed * np.exp(rng.uniform(slow, fast, _STATES)),
        sign[1] * level * rng.uniform(0.0, 3.0, _STATES), np.full(_STATES, level), sign[2],
        times[1],
    ])  # fmt: skip
    within = np.clip(np.array(effect.limits, dtype=float).reshape(-1, 2).T, -1.0, 1.0)
    kept = rng.uniform(0.0, 1.0, (_STATES, len(effect.states))) if effect.states else None
    short = min(effect.shortest_time, 1.0), min(effect.shortest_length, high - low)
    steps = {"t": short[0], "x": short[1], "v": speed, "u": level, "rest": short[0]}
    found = dict.fromkeys(steps, 0.0)
    for name, size in steps.items():
        step = _DIFFERENCE * size * (np.array(_ARGUMENTS[:-1]) == name)
        for k, state in enumerate(states if name in read and size > 0.0 else ()):
            z = () if kept is None else tuple(within[0] + kept[k] * (within[1] - within[0]))
            p = (*effect.values, *z)
            try:
                rise = law(*(state + step), p) - law(*(state - step), p)
            except Exception:  # where it is not defined no axis can be
                continue
            if math.isfinite(rise):
                found[name] = max(found[name], abs(rise) / (2.0 * _DIFFERENCE * size))
    friction = "friction" in (effect.action, effect.adds_to)
    relative = float(friction and "level" in read and level > 0.0)
    unit = _MARGIN / level if relative else _MARGIN
    return Slopes(
        unit * (found["t"] + found["rest"]), unit * found["x"], unit * found["v"],
        unit * found["u"], relative,
    )  # fmt: skip


#: Every known effect by slug, in the order of registration.
REGISTRY: dict[str, type[Effect]] = {}


@dataclass_transform(frozen_default=True, field_specifiers=(parameter,))
def register_effect(cls: type[Effect]) -> type[Effect]:
    """Make an effect known to simulation, fitting and diagnosis.

    Used as a class decorator; it makes the class a frozen dataclass if it is none.

    Parameters
    ----------
    cls : type of Effect
        Where it sets no `slug`, that is its name, as in "end_stop" of ``EndStop``; where it sets no
        `title`, that is the slug in words.  A ValueError if it lacks a known action, a law, an
        `alter` or an `inner`, takes the slug of another effect, or its law reads a parameter that
        it does not declare.

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> @dfc.effects.register_effect
    ... class Magnet(dfc.effects.Effect):
    ...     strength: float = dfc.effects.parameter("N m^2", "pull times distance squared")
    ...     action = "force"
    ...     @staticmethod
    ...     def law(t, x, v, u, level, direction, rest, p):
    ...         return p[0] / (0.1 + x) ** 2
    >>> axis = dfc.FrictionAxis(mass=1.0, viscous=0.0, coulomb=1.0,
    ...                         effects=(Magnet(strength=0.05),))
    >>> bool(axis.simulate([0.0] * 5, dt=1e-3).y[0, -1] > 0)
    True
    """
    if not isinstance(cls, type) or not issubclass(cls, Effect):
        raise ValueError(
            f"register_effect takes a class that derives from dfc.effects.Effect, got {cls!r}"
        )
    if "__dataclass_params__" not in vars(cls):
        dataclass(frozen=True)(cls)
    with_argument_hints(cls)
    own = cls.__name__
    said = {name for one in cls.__mro__ if one is not Effect for name in vars(one)}
    if "slug" not in said:
        cls.slug = re.sub("(?<=[a-z])(?=[A-Z])", "_", own).lower()
    _check_slug(cls)
    if cls.action not in ACTIONS:
        raise ValueError(f"{own}.action must be one of {ACTIONS}, got {cls.action!r}")
    method, needed = _METHODS[cls.action]
    found = getattr(cls, method, None)
    if not callable(found) or found is Effect.inner:
        raise ValueError(f"{own} needs {needed}")
    _check_states(cls)
    _check_numbers(cls)
    _document_parameters(cls)
    if "title" not in said:
        cls.title = cls.slug.replace("_", " ")
    REGISTRY[cls.slug] = cls
    return cls


def _check_slug(cls: type[Effect]) -> None:
    """Refuse a slug that is no word, or that of another effect."""
    slug = cls.slug
    if not isinstance(slug, str) or not slug.isidentifier() or slug.rpartition("_")[2].isdecimal():
        raise ValueError(
            f"{cls.__name__}.slug must be a lower-case word, no number behind it, got {slug!r}"
        )
    known = REGISTRY.get(slug)
    if known is None:
        return
    # A class of a user may be defined anew, also in another notebook or script.
    others = _is_of_package(known) and known.__module__ != cls.__module__
    if others or known.__qualname__ != cls.__qualname__:
        raise ValueError(
            f"{cls.__name__}: the id {slug!r} is that of {known.__module__}.{known.__qualname__}; "
            "rename the class, or choose another slug"
        )


def _is_of_package(cls: type[Effect]) -> bool:
    """Whether a module of the package has the class, not an example in one of its docstrings."""
    module = cls.__module__
    inside = module.partition(".")[0] == __name__.partition(".")[0]
    return inside and getattr(sys.modules.get(module), cls.__name__, None) is cls


def _document_parameters(cls: type[Effect]) -> None:
    """Put what the declarations of the parameters say into the docstring, before its notes."""
    rows = []
    for name, said in cls.parameters().items():
        words = said["doc"].replace("|", r"\|")
        rows.append(f"{name} : float\n    {words[0].upper()}{words[1:]} [{said['unit']}].")
    list_in_docstring(cls, "Parameters", rows)


def _check_states(cls: type[Effect]) -> None:
    """Refuse a memory without states or flow, and states of another effect."""
    own = cls.__name__
    declared = isinstance(cls.states, dict) and all(
        isinstance(name, str) and name.isidentifier() and isinstance(unit, str)
        for name, unit in cls.states.items()
    )
    if not declared:
        raise ValueError(
            f'{own}.states must be a dict of names and units, such as {{"spring": "m"}}, '
            f"got {cls.states!r}"
        )
    if cls.action != "memory":
        if cls.states or cls.flow is not None:
            raise ValueError(f'{own} has states: set action = "memory", got {cls.action!r}')
        return
    if not cls.states:
        raise ValueError(f'{own} needs its states, such as states = {{"spring": "m"}}')
    if not callable(cls.flow):
        raise ValueError(
            f"{own} needs a static method flow(i, t, x, v, u, level, direction, rest, p), the rate "
            "of state i"
        )
    if cls.adds_to not in ("force", "friction"):
        raise ValueError(f'{own}.adds_to must be "force" or "friction", got {cls.adds_to!r}')


class _NumberError(IndexError):
    """A law reads a parameter that its class does not declare."""


class _Numbers(tuple[float, ...]):
    """Parameters as a law may read them: one by one, each that there is."""

    def __getitem__(self, place: Any) -> Any:
        if not 0 <= place < len(self):
            raise _NumberError(place)
        return super().__getitem__(place)


# Where a law is tried: t, x, v, u, level, direction, rest.
_TRIED = ((0.0, 2.5), (-1.0, 1.0), (-1.0, 0.0, 1.0), (-9.0, 9.0), (5.0,), (-1.0, 1.0), (0.0, 1.0))


def _check_numbers(cls: type[Effect]) -> None:
    """Refuse a law that reads numbers which are not its own; compiled, it would take any."""
    for item in fields(cls):
        if hasattr(Effect, item.name):
            raise ValueError(
                f"{cls.__name__}.{item.name} is no name for a parameter, every effect has an "
                "attribute of that name: choose another"
            )
    bare = [name for name in inspect.get_annotations(cls) if name not in cls.__dataclass_fields__]
    for name in bare + [item.name for item in fields(cls) if not item.metadata]:
        raise ValueError(
            f"{cls.__name__}.{name} is no field: put @dataclass(frozen=True) above the class "
            "and call dfc.effects.parameter(...) for each parameter"
        )
    if cls.action not in _BY_LAW:
        return
    for name in ("law", "flow", "jump"):
        if getattr(cls, name, None) is not None:
            _check_numbers_of(cls, name)


def _check_numbers_of(cls: type[Effect], name: str) -> None:
    """Refuse a law, flow or jump that reads a number beyond parameters and states."""
    law: Any = getattr(cls, name)
    law = getattr(law, "py_func", law)
    bounds = [item.metadata["bounds"] for item in fields(cls)]
    values = [min(max(1.0, low), high) for low, high in bounds]
    p = _Numbers([*values, *(0.0 for _ in cls.states)])
    has = f"p[0] to p[{len(p) - 1}]" if p else "no parameter"
    numbers = [()] if name == "law" else [(i,) for i in range(len(cls.states))]
    for number, state in itertools.product(numbers, itertools.product(*_TRIED)):
        try:
            law(*number, *state, p)
        except _NumberError as wrong:
            raise ValueError(
                f"{cls.__name__}.{name} reads p[{wrong}], but the class declares {has}"
            ) from None
        except Exception:  # its own numbers, or what only the compiler knows
            continue


# Compiled laws, flows and jumps stay alive here: the kernel holds only their addresses.
_COMPILED: dict[tuple[type[Effect], str], Any] = {}


def law_address(cls: type[Effect], name: str = "law") -> int:
    """Address of an effect's compiled law, "flow" or "jump", valid in this process; 0 for none."""
    if getattr(cls, name) is None:
        return 0
    if (cls, name) not in _COMPILED:
        if REGISTRY.get(cls.slug) is not cls:  # else checked as it was registered
            _check_states(cls)
            _check_numbers(cls)
        kind = LAW if name == "law" else FLOW
        try:
            _COMPILED[cls, name] = cfunc(kind, cache=True)(getattr(cls, name))
        except RuntimeError as problem:
            # A class typed at the prompt has no file beside which to keep a cache.
            if "cannot cache" not in str(problem):
                raise
            _COMPILED[cls, name] = cfunc(kind)(getattr(cls, name))
    return int(_COMPILED[cls, name].address)
