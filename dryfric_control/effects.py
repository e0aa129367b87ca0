"""Physical effects beyond the base model: one class each.

A class here states what the effect is called, its parameters with units and
bounds, the compiled law by which it acts, what it is in plain words, and the
experiment that would expose it.  Simulation, fitting, diagnosis and the
documentation all read the same class.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import MISSING, dataclass, field, fields
from typing import TYPE_CHECKING, Any, ClassVar

from numba import cfunc

from dryfric_control.friction import Stribeck, finite
from dryfric_control.kernels import LAW

if TYPE_CHECKING:
    from dryfric_control.axis import FrictionAxis

#: What an effect may act on; those of the first row act by a law.
ACTIONS = (
    *("input", "force", "friction"),
    *("axis", "delay", "lag", "contact", "transmission"),
)
_BY_LAW = ACTIONS[:3]


def parameter(
    unit: str,
    doc: str,
    *,
    bounds: tuple[float, float] = (-math.inf, math.inf),
    default: float | None = None,
) -> Any:
    """Declare one parameter of an effect.

    Parameters
    ----------
    unit : str
        Unit, "1" for a ratio.
    doc : str
        What the parameter is.
    bounds : tuple of float
        Smallest and largest allowed value.
    default : float, optional
        Value when the user gives none.

    Returns
    -------
    dataclasses.Field

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> dfc.parameter("N", "force", bounds=(0.0, 10.0)).metadata["unit"]
    'N'
    """
    for name, text in (("unit", unit), ("doc", doc)):
        if not isinstance(text, str):
            raise ValueError(f"{name} must be text, got {text!r}")
    try:
        low, high = bounds
        ordered = float(low) < float(high)
    except (TypeError, ValueError):
        raise ValueError(f"bounds must be (low, high), got {bounds!r}") from None
    if not ordered:
        raise ValueError(f"bounds must run from low to high, got {bounds!r}")
    if default is not None and not low <= finite("default", default) <= high:
        raise ValueError(f"default must lie within bounds = {bounds!r}, got {default!r}")
    metadata = {"unit": unit, "doc": doc, "bounds": (low, high)}
    return field(default=MISSING if default is None else default, metadata=metadata)


@dataclass(frozen=True)
class Effect:
    """Base of every physical effect.

    A subclass is a frozen dataclass whose fields are declared with
    `parameter`.  It sets `slug`, `title`, `action`, `explanation` and
    `experiment`, and, for the actions "input", "force" and "friction", a
    static method `law`; for "axis" a method ``alter(axis)`` that returns the
    axis with other base parameters.

    Notes
    -----
    ``law(t, x, v, u, level, direction, rest, p)`` returns, by `action`:

    - "force": a force added to the drive [N]; `u` is the drive force;
    - "friction": an addition to the Coulomb level [N]; `level` is that level
      here and in this `direction`, `u` the net force, `rest` the time at rest.
      The Stribeck peak raises what it adds, unless `within_peak` is false;
    - "input": the drive force that takes the place of `u` [N].

    `p` holds the parameters in the order of the fields.  The law is compiled
    once for itself; no combination of effects costs a further compilation, and
    one call costs a few nanoseconds.

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> dfc.Spring(stiffness=200.0).describe()
    'spring: stiffness = 200 N/m, rest = 0 m'
    """

    slug: ClassVar[str] = ""
    title: ClassVar[str] = ""
    action: ClassVar[str] = ""
    explanation: ClassVar[str] = ""
    experiment: ClassVar[str] = ""
    #: Whether position, speed and mode do not tell all it does: it looks back.
    remembers: ClassVar[bool] = False
    #: Whether a force law reads v, u or direction; one that does not costs less.
    depends_on_speed: ClassVar[bool] = True
    #: Whether the Stribeck peak raises what a friction law adds; not where it is
    #: the friction of another contact, or of the same one at rest alone.
    within_peak: ClassVar[bool] = True
    law: ClassVar[Callable[..., float]]
    alter: ClassVar[Callable[..., Any]]

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

    @classmethod
    def parameters(cls) -> dict[str, dict[str, Any]]:
        """Unit, bounds and meaning of every parameter, by name."""
        return {item.name: dict(item.metadata) for item in fields(cls)}

    def describe(self) -> str:
        """Slug and parameters with units, in one line."""
        parts = []
        for item in fields(self):
            unit = item.metadata["unit"]
            suffix = "" if unit == "1" else f" {unit}"
            parts.append(f"{item.name} = {getattr(self, item.name):.6g}{suffix}")
        return f"{self.slug}: {', '.join(parts)}"


#: Every known effect by slug, in the order of definition.
REGISTRY: dict[str, type[Effect]] = {}


def register_effect(cls: type[Effect]) -> type[Effect]:
    """Make an effect known to simulation, fitting and diagnosis.

    Used as a class decorator, above ``@dataclass(frozen=True)``.

    Parameters
    ----------
    cls : type of Effect
        The class to register.

    Returns
    -------
    type of Effect
        The same class.

    Raises
    ------
    ValueError
        If the class lacks a slug, a known action, a law or an `alter`, or
        takes the slug of another effect.

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> import dryfric_control as dfc
    >>> @dfc.register_effect
    ... @dataclass(frozen=True)
    ... class Magnet(dfc.Effect):
    ...     strength: float = dfc.parameter("N m^2", "pull times distance squared")
    ...     slug = "magnet"
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
        raise ValueError(f"register_effect takes a class that derives from dfc.Effect, got {cls!r}")
    if not isinstance(cls.slug, str) or not cls.slug.isidentifier():
        raise ValueError(f"{cls.__name__}.slug must be a lower-case word, got {cls.slug!r}")
    if cls.action not in ACTIONS:
        raise ValueError(f"{cls.__name__}.action must be one of {ACTIONS}, got {cls.action!r}")
    if cls.action in _BY_LAW and not callable(getattr(cls, "law", None)):
        raise ValueError(f"{cls.__name__} needs a static method law(t, x, v, u, ..., p)")
    if cls.action == "axis" and not callable(getattr(cls, "alter", None)):
        raise ValueError(f"{cls.__name__} needs a method alter(axis) that returns a FrictionAxis")
    known = REGISTRY.get(cls.slug)
    if known is not None and known.__qualname__ != cls.__qualname__:
        raise ValueError(f"slug {cls.slug!r} belongs to {known.__name__}: choose another")
    REGISTRY[cls.slug] = cls
    return cls


# Compiled laws stay alive here: the kernel holds only their addresses.
_COMPILED: dict[type[Effect], Any] = {}


def law_address(cls: type[Effect]) -> int:
    """Address of an effect's compiled law, valid in this process.

    Parameters
    ----------
    cls : type of Effect
        The effect.

    Returns
    -------
    int
    """
    if cls not in _COMPILED:
        try:
            _COMPILED[cls] = cfunc(LAW, cache=True)(cls.law)
        except RuntimeError as problem:
            # A class typed at the prompt has no file beside which to keep a cache.
            if "cannot cache" not in str(problem):
                raise
            _COMPILED[cls] = cfunc(LAW)(cls.law)
    return int(_COMPILED[cls].address)


@register_effect
@dataclass(frozen=True)
class Inertia(Effect):
    r"""Mass other than the axis' own.

    Parameters
    ----------
    factor : float
        Mass that moves over the axis' `mass` [1].

    Notes
    -----
    .. math:: m \to \text{factor} \cdot m

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    >>> axis.replace(effects=(dfc.Inertia(factor=1.5),)).effective().mass
    3.0
    """

    factor: float = parameter("1", "moving mass over the axis' own", bounds=(1e-9, math.inf))

    slug = "inertia"
    title = "wrong inertia"
    action = "axis"
    explanation = (
        "More or less mass moves than believed: a workpiece, a coupling, a gear ratio "
        "taken wrongly into account."
    )
    experiment = "Accelerate hard both ways while sliding: force over acceleration is the mass."

    def alter(self, axis: FrictionAxis) -> FrictionAxis:
        """Axis with the other mass.

        Parameters
        ----------
        axis : FrictionAxis
            The axis that has the effect.

        Returns
        -------
        FrictionAxis
        """
        return axis.replace(mass=self.factor * axis.mass)


@register_effect
@dataclass(frozen=True)
class ViscousFriction(Effect):
    r"""Viscous coefficient other than the axis' own.

    Parameters
    ----------
    factor : float
        Coefficient over the axis' `viscous` [1].

    Notes
    -----
    .. math:: f \to \text{factor} \cdot f

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    >>> axis.replace(effects=(dfc.ViscousFriction(factor=2.0),)).effective().viscous
    30.0
    """

    factor: float = parameter("1", "coefficient over the axis' own", bounds=(0.0, math.inf))

    slug = "viscous"
    title = "wrong viscous friction"
    action = "axis"
    explanation = (
        "Speed-proportional friction differs from what was believed: other grease, another "
        "temperature, a new seal."
    )
    experiment = "Run at several constant speeds: the slope of force over speed is the coefficient."

    def alter(self, axis: FrictionAxis) -> FrictionAxis:
        """Axis with the other viscous coefficient.

        Parameters
        ----------
        axis : FrictionAxis
            The axis that has the effect.

        Returns
        -------
        FrictionAxis
        """
        return axis.replace(viscous=self.factor * axis.viscous)


@register_effect
@dataclass(frozen=True)
class CoulombFriction(Effect):
    r"""Coulomb level other than the axis' own, the same both ways.

    Parameters
    ----------
    factor : float
        Level over the axis' `coulomb` [1].

    Notes
    -----
    .. math:: F_c \to \text{factor} \cdot F_c

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=(8.0, 6.0))
    >>> axis.replace(effects=(dfc.CoulombFriction(factor=1.5),)).effective().coulomb
    CoulombMap(plus=(12.0,), minus=(9.0,))
    """

    factor: float = parameter("1", "level over the axis' own", bounds=(0.0, math.inf))

    slug = "coulomb"
    title = "wrong Coulomb level"
    action = "axis"
    explanation = (
        "Dry friction as a whole is higher or lower than believed: preload, wear, lubrication."
    )
    experiment = (
        "Crawl both ways at the same speed: half the difference of the forces is the level."
    )

    def alter(self, axis: FrictionAxis) -> FrictionAxis:
        """Axis with the other levels.

        Parameters
        ----------
        axis : FrictionAxis
            The axis that has the effect.

        Returns
        -------
        FrictionAxis
        """
        return axis.replace(coulomb=axis.coulomb.scaled(self.factor))


@register_effect
@dataclass(frozen=True)
class StribeckPeak(Effect):
    r"""Friction that is higher at the slowest motion.

    It takes the place of the axis' own Stribeck peak, if there is one.

    Parameters
    ----------
    excess : float
        Relative excess of the breakaway over the Coulomb level [1].
    speed : float
        Stribeck speed, over which the excess dies [m/s].

    Notes
    -----
    .. math:: F = F_c \left(1 + \text{excess} \cdot e^{-(({|v|} - \Sigma)/\text{speed})^2}\right)

    with Sigma the stick speed of the axis.

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    >>> axis.replace(effects=(dfc.StribeckPeak(excess=0.3, speed=0.01),)).effective().stribeck
    Stribeck(excess=0.3, speed=0.01)
    """

    excess: float = parameter("1", "excess of breakaway over Coulomb", bounds=(0.0, math.inf))
    speed: float = parameter("m/s", "speed over which it dies", bounds=(1e-300, math.inf))

    slug = "stribeck"
    title = "Stribeck peak"
    action = "axis"
    explanation = (
        "At the slowest motion the film of oil breaks down and friction rises: it takes more "
        "to start than to keep going."
    )
    experiment = "Crawl slower and slower through a soft drive: the axis starts to stick and slip."

    def alter(self, axis: FrictionAxis) -> FrictionAxis:
        """Axis with this peak.

        Parameters
        ----------
        axis : FrictionAxis
            The axis that has the effect.

        Returns
        -------
        FrictionAxis
        """
        return axis.replace(stribeck=Stribeck(self.excess, self.speed))


@register_effect
@dataclass(frozen=True)
class BiasForce(Effect):
    r"""Constant force on the mass.

    Parameters
    ----------
    force : float
        Force [N], positive with x.

    Notes
    -----
    .. math:: w \to w + \text{force}

    with w the force on the mass without friction.

    Examples
    --------
    Three newtons against a level of one move 2 kg at 1 m/s^2:

    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=0.0, coulomb=1.0,
    ...                         effects=(dfc.BiasForce(force=3.0),))
    >>> resp = axis.simulate([0.0] * 1001, dt=1e-3)
    >>> round(float(resp.y[1, -1]), 9)
    1.0
    """

    force: float = parameter("N", "force, positive with x")

    slug = "bias_force"
    title = "bias force"
    action = "force"
    depends_on_speed = False
    explanation = (
        "A constant force pulls the axis to one side: gravity on a slope, a preloaded "
        "cable, or an offset of the amplifier."
    )
    experiment = "Crawl both ways at the same speed: the two levels differ by twice the bias."

    @staticmethod
    def law(t, x, v, u, level, direction, rest, p):  # type: ignore[no-untyped-def]
        return p[0]


@register_effect
@dataclass(frozen=True)
class ViscousAsymmetry(Effect):
    r"""Viscous friction that differs between the directions.

    Parameters
    ----------
    viscous : float
        Half the difference of the two coefficients [N s/m]: added for motion
        in positive direction, taken away in negative direction.

    Notes
    -----
    .. math:: w \to w - \text{viscous} \cdot {|v|}

    so that the coefficient is f + viscous forwards and f - viscous backwards.

    Examples
    --------
    The same force gives another speed each way, (13 - 1)/(10 +- 2):

    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=0.1, viscous=10.0, coulomb=1.0,
    ...                         effects=(dfc.ViscousAsymmetry(viscous=2.0),))
    >>> [round(float(axis.simulate([u] * 1000, dt=1e-3).y[1, -1]), 6) for u in (13.0, -13.0)]
    [1.0, -1.5]
    """

    viscous: float = parameter("N s/m", "half the difference, positive less negative")

    slug = "viscous_asymmetry"
    title = "viscous asymmetry"
    action = "force"
    explanation = (
        "Speed-proportional friction is larger one way: a lip seal or a one-sided oil film."
    )
    experiment = "Run at several constant speeds both ways and compare the slopes of force."

    @staticmethod
    def law(t, x, v, u, level, direction, rest, p):  # type: ignore[no-untyped-def]
        return -p[0] * abs(v)


@register_effect
@dataclass(frozen=True)
class CoulombAsymmetry(Effect):
    r"""Coulomb level that differs between the directions.

    Parameters
    ----------
    force : float
        Half the difference of the two levels [N]: added for motion in
        positive direction, taken away in negative direction.

    Notes
    -----
    .. math:: F_c \to F_c + s \cdot \text{force}, \quad s = \pm 1 \text{ the direction}

    Examples
    --------
    With levels of 9 N forwards and 7 N backwards, 8 N move it one way only:

    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0,
    ...                         effects=(dfc.CoulombAsymmetry(force=1.0),))
    >>> [int(axis.simulate([u] * 10, dt=1e-3).mode[-1]) for u in (8.0, -8.0)]
    [0, -1]
    """

    force: float = parameter("N", "half the difference, positive less negative")

    slug = "coulomb_asymmetry"
    title = "Coulomb asymmetry"
    action = "friction"
    explanation = "Dry friction is larger one way: worn or preloaded contact, a wedge, a brush."
    experiment = (
        "Crawl both ways at the same speed and compare the levels; tilt to part it from a bias."
    )

    @staticmethod
    def law(t, x, v, u, level, direction, rest, p):  # type: ignore[no-untyped-def]
        return p[0] if direction > 0.0 else -p[0]


@register_effect
@dataclass(frozen=True)
class QuadraticDrag(Effect):
    r"""Drag that grows with the square of speed.

    Parameters
    ----------
    drag : float
        Coefficient of ``v |v|`` [N s^2/m^2].

    Notes
    -----
    .. math:: w \to w - \text{drag} \cdot v {|v|}

    Examples
    --------
    Eight newtons above the Coulomb level hold sqrt(8/2) m/s:

    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=0.5, viscous=0.0, coulomb=1.0,
    ...                         effects=(dfc.QuadraticDrag(drag=2.0),))
    >>> round(float(axis.simulate([9.0] * 3000, dt=1e-3).y[1, -1]), 6)
    2.0
    """

    drag: float = parameter("N s^2/m^2", "coefficient of v |v|", bounds=(0.0, math.inf))

    slug = "quadratic_drag"
    title = "quadratic drag"
    action = "force"
    explanation = "Air or liquid is thrown aside, so the resistance grows with the square of speed."
    experiment = "Run at several constant speeds up to the fastest: the force curve bends upwards."

    @staticmethod
    def law(t, x, v, u, level, direction, rest, p):  # type: ignore[no-untyped-def]
        return -p[0] * v * abs(v)


@register_effect
@dataclass(frozen=True)
class Spring(Effect):
    r"""Linear spring to the frame.

    Parameters
    ----------
    stiffness : float
        Stiffness [N/m].
    rest : float
        Position without spring force [m].

    Notes
    -----
    .. math:: w \to w - \text{stiffness} \cdot (x - \text{rest})

    Examples
    --------
    At rest friction holds the spring, 200 N/m over 4 mm:

    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0,
    ...                         effects=(dfc.Spring(stiffness=200.0),))
    >>> round(float(axis.simulate([0.0] * 10, dt=1e-3, x0=4e-3).y[2, -1]), 9)
    -0.8
    """

    stiffness: float = parameter("N/m", "stiffness", bounds=(0.0, math.inf))
    rest: float = parameter("m", "position without spring force", default=0.0)

    slug = "spring"
    title = "spring"
    action = "force"
    depends_on_speed = False
    explanation = (
        "An elastic element pulls the axis back: a return spring, a cable loop, a bellows."
    )
    experiment = "Crawl over the whole travel: the mean of the two directions slopes with position."

    @staticmethod
    def law(t, x, v, u, level, direction, rest, p):  # type: ignore[no-untyped-def]
        return -p[0] * (x - p[1])


@register_effect
@dataclass(frozen=True)
class Gravity(Effect):
    r"""Gravity on a rotary axis.

    Parameters
    ----------
    amplitude : float
        Largest torque m g l [N m].
    phase : float
        Position at which the arm hangs [rad].

    Notes
    -----
    .. math:: w \to w - \text{amplitude} \cdot \sin(x - \text{phase})

    Examples
    --------
    A level arm rests on friction, which carries its weight:

    >>> import math
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=0.1, viscous=0.1, coulomb=1.0,
    ...                         effects=(dfc.Gravity(amplitude=0.5),))
    >>> round(float(axis.simulate([0.0] * 10, dt=1e-3, x0=math.pi / 2).y[2, -1]), 9)
    -0.5
    """

    amplitude: float = parameter("N m", "largest torque m g l", bounds=(0.0, math.inf))
    phase: float = parameter("rad", "position at which the arm hangs", default=0.0)

    slug = "gravity"
    title = "gravity on a rotary axis"
    action = "force"
    depends_on_speed = False
    explanation = "The arm's weight pulls it down, with the sine of its angle from hanging."
    experiment = "Crawl through a full turn: the mean of the two directions is a sine of the angle."

    @staticmethod
    def law(t, x, v, u, level, direction, rest, p):  # type: ignore[no-untyped-def]
        return -p[0] * math.sin(x - p[1])


@register_effect
@dataclass(frozen=True)
class Cogging(Effect):
    r"""Force that repeats with position.

    Parameters
    ----------
    amplitude : float
        Amplitude [N].
    period : float
        Period [m].
    phase : float
        Phase at x = 0 [rad].

    Notes
    -----
    .. math:: w \to w + \text{amplitude} \cdot \sin(2\pi x / \text{period} + \text{phase})

    Examples
    --------
    A quarter of a period from zero it pushes with its amplitude:

    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0,
    ...                         effects=(dfc.Cogging(amplitude=3.0, period=0.01),))
    >>> round(float(axis.simulate([0.0] * 10, dt=1e-3, x0=2.5e-3).y[2, -1]), 9)
    3.0
    """

    amplitude: float = parameter("N", "amplitude", bounds=(0.0, math.inf))
    period: float = parameter("m", "period", bounds=(1e-300, math.inf))
    phase: float = parameter("rad", "phase at x = 0", default=0.0)

    slug = "cogging"
    title = "cogging"
    action = "force"
    depends_on_speed = False
    explanation = "The motor's magnets or the screw's pitch push and pull once per tooth."
    experiment = "Crawl slowly over many pitches: the force ripples with position, not with time."

    @staticmethod
    def law(t, x, v, u, level, direction, rest, p):  # type: ignore[no-untyped-def]
        return p[0] * math.sin(2.0 * math.pi * x / p[1] + p[2])


@register_effect
@dataclass(frozen=True)
class InputDelay(Effect):
    r"""Drive force that acts some time after the command.

    Parameters
    ----------
    delay : float
        Delay [s], any length, not only whole samples.

    Notes
    -----
    .. math:: u(t) \to u(t - \text{delay})

    Examples
    --------
    It starts when the force arrives, here between two samples:

    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0,
    ...                         effects=(dfc.InputDelay(delay=4.5e-3),))
    >>> resp = axis.simulate([10.0] * 20, dt=1e-3)
    >>> round(float(resp.events.time[0]), 9)
    0.0045
    """

    delay: float = parameter("s", "delay", bounds=(0.0, math.inf))

    slug = "input_delay"
    title = "input delay"
    action = "delay"
    remembers = True
    explanation = "The drive acts late: computing time, a field bus, or a current loop's dead time."
    experiment = "Step the force while sliding and time the bend in speed against the command."


@register_effect
@dataclass(frozen=True)
class ActuatorLag(Effect):
    r"""Drive force that follows the command with a first-order lag.

    Parameters
    ----------
    time_constant : float
        Time constant [s].

    Notes
    -----
    .. math:: u \to y, \quad \text{time constant} \cdot \dot y = u - y

    Examples
    --------
    It starts when the force has grown to the level, after tau ln 2:

    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0,
    ...                         effects=(dfc.ActuatorLag(time_constant=0.01),))
    >>> resp = axis.simulate([16.0] * 20, dt=1e-3)
    >>> round(float(resp.events.time[0]), 6)
    0.006931
    """

    time_constant: float = parameter("s", "time constant", bounds=(0.0, math.inf))

    slug = "actuator_lag"
    title = "actuator lag"
    action = "lag"
    remembers = True
    explanation = "The force builds up gradually: the winding's inductance or a valve's stroke."
    experiment = "Step the force while sliding: acceleration rises gradually, not after a pause."


@register_effect
@dataclass(frozen=True)
class InputGain(Effect):
    r"""Drive force that is a multiple of the commanded one.

    Parameters
    ----------
    gain : float
        Force acting over force commanded [1].

    Notes
    -----
    .. math:: u \to \text{gain} \cdot u

    Examples
    --------
    A command of 5 N acts with 10 N against a level of 8 N:

    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=0.0, coulomb=8.0,
    ...                         effects=(dfc.InputGain(gain=2.0),))
    >>> round(float(axis.simulate([5.0] * 1001, dt=1e-3).y[1, -1]), 9)
    1.0
    """

    gain: float = parameter("1", "force acting over force commanded", bounds=(0.0, math.inf))

    slug = "input_gain"
    title = "input gain"
    action = "input"
    explanation = "The drive gives more or less force than believed: torque constant or scaling."
    experiment = "Hang a known weight on the axis and read the command that balances it."

    @staticmethod
    def law(t, x, v, u, level, direction, rest, p):  # type: ignore[no-untyped-def]
        return p[0] * u


@register_effect
@dataclass(frozen=True)
class DeadZone(Effect):
    r"""Command below which the drive gives no force.

    Parameters
    ----------
    width : float
        Half width of the dead zone [N]; above it the force is the command
        less this width.

    Notes
    -----
    .. math:: u \to u - \min(\max(u, -\text{width}), \text{width})

    Examples
    --------
    Of 12 N it takes away 2 N:

    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=0.0, coulomb=8.0,
    ...                         effects=(dfc.DeadZone(width=2.0),))
    >>> round(float(axis.simulate([12.0] * 1001, dt=1e-3).y[1, -1]), 9)
    1.0
    """

    width: float = parameter("N", "half width", bounds=(0.0, math.inf))

    slug = "dead_zone"
    title = "dead zone"
    action = "input"
    explanation = "Small commands are lost in the drive: valve overlap or a bridge's blanking time."
    experiment = (
        "Sweep the command slowly through zero while the axis is pushed by a constant load."
    )

    @staticmethod
    def law(t, x, v, u, level, direction, rest, p):  # type: ignore[no-untyped-def]
        if u > p[0]:
            return u - p[0]
        if u < -p[0]:
            return u + p[0]
        return 0.0


@register_effect
@dataclass(frozen=True)
class Saturation(Effect):
    r"""Largest force that the drive gives.

    Parameters
    ----------
    limit : float
        Largest magnitude of the force [N].

    Notes
    -----
    .. math:: u \to \min(\max(u, -\text{limit}), \text{limit})

    Examples
    --------
    However large the command, 10 N act:

    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=0.0, coulomb=8.0,
    ...                         effects=(dfc.Saturation(limit=10.0),))
    >>> round(float(axis.simulate([500.0] * 1001, dt=1e-3).y[1, -1]), 9)
    1.0
    """

    limit: float = parameter("N", "largest magnitude", bounds=(0.0, math.inf))

    slug = "saturation"
    title = "saturation"
    action = "input"
    explanation = "The drive cannot give more than this: current limit, supply voltage, pressure."
    experiment = "Step the reference further and further: the acceleration stops growing."

    @staticmethod
    def law(t, x, v, u, level, direction, rest, p):  # type: ignore[no-untyped-def]
        return min(max(u, -p[0]), p[0])


@register_effect
@dataclass(frozen=True)
class PositionDependence(Effect):
    r"""Coulomb level that changes along the travel.

    Parameters
    ----------
    slope : float
        Relative change of the level per length [1/m].
    curvature : float
        Coefficient of the square [1/m^2].
    centre : float
        Position at which the level is the axis' own [m].

    Notes
    -----
    .. math:: F_c \to F_c \left(1 + \text{slope} \cdot q + \text{curvature} \cdot q^2\right)

    with q = x - centre.

    Examples
    --------
    A drive of 8.5 N moves it where the level is 8 N, not where it is 8.8 N:

    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0,
    ...                         effects=(dfc.PositionDependence(slope=1.0),))
    >>> [int(axis.simulate([8.5] * 10, dt=1e-3, x0=x).mode[-1]) for x in (0.0, 0.1)]
    [1, 0]
    """

    slope: float = parameter("1/m", "relative change per length")
    curvature: float = parameter("1/m^2", "coefficient of the square", default=0.0)
    centre: float = parameter("m", "position of the unchanged level", default=0.0)

    slug = "position_dependence"
    title = "position-dependent friction"
    action = "friction"
    explanation = "Dry friction differs along the travel: wear, misalignment, a bent screw or rail."
    experiment = "Crawl over the whole travel both ways and plot the force over position."

    @staticmethod
    def law(t, x, v, u, level, direction, rest, p):  # type: ignore[no-untyped-def]
        q = x - p[2]
        return level * (p[0] + p[1] * q) * q


@register_effect
@dataclass(frozen=True)
class LoadDependence(Effect):
    r"""Friction that grows with the transmitted force.

    Parameters
    ----------
    coefficient : float
        Added friction over net force [1].

    Notes
    -----
    .. math:: F_c \to F_c + \text{coefficient} \cdot {|w|}

    The Stribeck peak does not raise this part: it is the friction of another
    contact.

    Examples
    --------
    Half of the 20 N that it transmits is lost, and 8 N of its own:

    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=0.0, coulomb=8.0,
    ...                         effects=(dfc.LoadDependence(coefficient=0.5),))
    >>> round(float(axis.simulate([20.0] * 1001, dt=1e-3).y[1, -1]), 9)
    1.0
    """

    coefficient: float = parameter("1", "added friction over net force", bounds=(0.0, 1.0))

    slug = "load_dependence"
    within_peak = False
    title = "load-dependent friction"
    action = "friction"
    explanation = (
        "The force that the gear or screw carries presses its teeth together: more friction."
    )
    experiment = (
        "Repeat one motion with different loads, braking included: friction follows the load."
    )

    @staticmethod
    def law(t, x, v, u, level, direction, rest, p):  # type: ignore[no-untyped-def]
        return p[0] * abs(u)


@register_effect
@dataclass(frozen=True)
class Drift(Effect):
    r"""Friction level that changes over the record.

    Parameters
    ----------
    rate : float
        Relative change of the Coulomb level per time [1/s].

    Notes
    -----
    .. math:: F_c \to F_c \left(1 + \text{rate} \cdot t\right)

    Examples
    --------
    Friction that falls by a tenth a second lets go of 7.6 N after 0.5 s:

    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0,
    ...                         effects=(dfc.Drift(rate=-0.1),))
    >>> round(float(axis.simulate([7.6] * 1000, dt=1e-3).events.time[0]), 6)
    0.5
    """

    rate: float = parameter("1/s", "relative change of the level per time")

    slug = "drift"
    title = "friction drift"
    action = "friction"
    explanation = "Friction rises or falls while the machine runs: warming grease, a drying seal."
    experiment = "Repeat the same crawl every few minutes from cold to warm."

    @staticmethod
    def law(t, x, v, u, level, direction, rest, p):  # type: ignore[no-untyped-def]
        return level * p[0] * t


@register_effect
@dataclass(frozen=True)
class DwellTime(Effect):
    r"""Breakaway level that grows with the time at rest.

    Parameters
    ----------
    rise : float
        Breakaway force gained after a long rest [N].
    time_constant : float
        Time constant of the gain [s].

    Notes
    -----
    .. math:: F_b \to F_b + \text{rise} \cdot \left(1 - e^{-t_r/\text{time constant}}\right)

    with F_b the breakaway level and t_r the time at rest; the Stribeck peak does
    not raise this part.

    Examples
    --------
    Under a slow ramp of force it breaks away half a newton later:

    >>> import numpy as np
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=1.0,
    ...                         effects=(dfc.DwellTime(rise=0.5, time_constant=0.05),))
    >>> ramp = np.arange(2000) * 1e-3
    >>> round(float(axis.simulate(ramp, dt=1e-3, hold="first").events.time[0]), 6)
    1.5
    """

    rise: float = parameter("N", "breakaway gained after a long rest", bounds=(0.0, math.inf))
    time_constant: float = parameter("s", "time constant", bounds=(1e-9, math.inf))

    slug = "dwell_time"
    within_peak = False
    title = "dwell-time dependence"
    action = "friction"
    remembers = True
    explanation = (
        "At rest the contacts creep together and the oil is squeezed out: it sticks harder."
    )
    experiment = "Break away after rests of different lengths with the same slow ramp of force."

    @staticmethod
    def law(t, x, v, u, level, direction, rest, p):  # type: ignore[no-untyped-def]
        return p[0] * -math.expm1(-rest / p[1])


@register_effect
@dataclass(frozen=True)
class TimePeriodic(Effect):
    r"""Force that repeats with time.

    Parameters
    ----------
    amplitude : float
        Amplitude [N].
    frequency : float
        Frequency [Hz].
    phase : float
        Phase at t = 0 [rad].

    Notes
    -----
    .. math::

        w \to w + \text{amplitude} \cdot \sin(2\pi \cdot \text{frequency} \cdot t + \text{phase})

    Examples
    --------
    It overcomes half its amplitude after a twelfth of a period:

    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0,
    ...                         effects=(dfc.TimePeriodic(amplitude=16.0, frequency=0.25),))
    >>> round(float(axis.simulate([0.0] * 1000, dt=1e-3).events.time[0]), 6)
    0.333333
    """

    amplitude: float = parameter("N", "amplitude", bounds=(0.0, math.inf))
    frequency: float = parameter("Hz", "frequency", bounds=(0.0, math.inf))
    phase: float = parameter("rad", "phase at t = 0", default=0.0)

    slug = "time_periodic"
    title = "disturbance periodic in time"
    action = "force"
    depends_on_speed = False
    explanation = (
        "Something else that runs shakes the axis: a pump, a fan, a neighbour machine, mains."
    )
    experiment = "Hold the axis at several speeds and at rest: the frequency stays the same."

    @staticmethod
    def law(t, x, v, u, level, direction, rest, p):  # type: ignore[no-untyped-def]
        return p[0] * math.sin(2.0 * math.pi * p[1] * t + p[2])


@register_effect
@dataclass(frozen=True)
class Presliding(Effect):
    r"""Friction that is elastic before it slides.

    Parameters
    ----------
    distance : float
        Way over which the Coulomb level builds up [m].

    Notes
    -----
    .. math:: F = \frac{F_c}{\text{distance}} z, \quad \dot z = v, \quad {|F|} \le F_c

    Prandtl's element: F = k z with z' = v and k = Fc/distance, up to the
    friction level, at which it slides; when the motion turns back the contact
    unloads elastically from where it is.  Fc is one constant level, the mean
    of both directions in the middle of the travel.  Mode 0 is the elastic
    phase: the axis moves in it, ``m v' = w - f v - k z``, and stick speed and
    stick rate have no part in it.  Without a Coulomb level there is no
    contact.  A simulation starts with the contact unstrained.

    Examples
    --------
    Below breakaway the axis swings about u/k and comes to rest there:

    >>> import numpy as np
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=300.0, coulomb=8.0,
    ...                         effects=(dfc.Presliding(distance=40e-6),))
    >>> resp = axis.simulate(np.full(500, 4.0), dt=1e-3)
    >>> round(1e6 * float(resp.y[0, -1]), 6)
    20.0
    """

    distance: float = parameter(
        "m", "way over which the Coulomb level builds up", bounds=(1e-300, math.inf)
    )

    slug = "presliding"
    title = "presliding"
    action = "contact"
    remembers = True
    explanation = (
        "Before it breaks away the contact bends like a spring: the axis gives way by "
        "micrometres and springs back."
    )
    experiment = (
        "Raise and lower the force slowly below breakaway: the position follows in a loop, "
        "not on a line and not at all."
    )


@register_effect
@dataclass(frozen=True)
class Backlash(Effect):
    r"""Free play between motor and load.

    Parameters
    ----------
    gap : float
        Whole width of the play [m].
    load_fraction : float
        Share of the mass behind the play [1].

    Notes
    -----
    .. math:: {|x - x_l|} \le \tfrac{1}{2}\, \text{gap}, \quad x_l \text{ the load}

    The motor, (1 - load_fraction) m, carries drive and encoder; the load,
    load_fraction m, carries all friction and all force effects.  In contact
    the two move as one until the contact would have to pull; they meet again
    in a plastic impact that keeps the momentum.  Position and speed are the
    motor's, friction and mode the load's.  A simulation starts with the motor
    in the middle of the play.  In contact the net force on both masses counts
    for a friction that depends on it.

    Examples
    --------
    The motor crosses half the play alone, then takes the load along:

    >>> import numpy as np
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=0.0, coulomb=1.0,
    ...                         effects=(dfc.Backlash(gap=2e-3, load_fraction=0.5),))
    >>> resp = axis.simulate(np.full(100, 5.0), dt=1e-3)
    >>> float(resp.events.times(0, 1)[0]).__round__(6)     # sqrt(gap m/2/u)
    0.02
    """

    gap: float = parameter("m", "whole width of the play", bounds=(1e-300, math.inf))
    load_fraction: float = parameter(
        "1", "share of the mass behind the play", bounds=(1e-6, 1.0 - 1e-6)
    )

    slug = "backlash"
    title = "backlash"
    action = "transmission"
    remembers = True
    explanation = (
        "There is play between motor and load: after each reversal the motor runs free, then "
        "strikes the load."
    )
    experiment = (
        "Reverse slowly under a small force: the motor moves by the play before the force rises."
    )


@register_effect
@dataclass(frozen=True)
class Compliance(Effect):
    r"""Elastic transmission between motor and load.

    Parameters
    ----------
    stiffness : float
        Stiffness of the transmission [N/m].
    damping : float
        Its damping [N s/m].
    load_fraction : float
        Share of the mass behind the transmission [1].

    Notes
    -----
    .. math:: F_t = \text{stiffness} \cdot (x - x_l) + \text{damping} \cdot (v - v_l)

    The motor, (1 - load_fraction) m, carries drive and encoder; the load,
    load_fraction m, carries all friction and all force effects; the force
    between them is stiffness (x - xl) + damping (v - vl).  Position and speed
    are the motor's, friction and mode the load's.  A simulation starts with
    the transmission unstrained.  The steps are a fraction of its natural
    period as long as it swings: a very stiff one costs time.

    Examples
    --------
    The load holds, and the motor winds the transmission up to u/stiffness:

    >>> import numpy as np
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(
    ...     mass=2.0, viscous=0.0, coulomb=8.0,
    ...     effects=(dfc.Compliance(stiffness=1e4, damping=60.0, load_fraction=0.5),))
    >>> resp = axis.simulate(np.full(1000, 4.0), dt=1e-3)
    >>> round(1e3 * float(resp.y[0, -1]), 6)
    0.4
    """

    stiffness: float = parameter("N/m", "stiffness", bounds=(1e-300, math.inf))
    damping: float = parameter("N s/m", "damping", bounds=(0.0, math.inf))
    load_fraction: float = parameter(
        "1", "share of the mass behind the transmission", bounds=(1e-6, 1.0 - 1e-6)
    )

    slug = "compliance"
    title = "compliance"
    action = "transmission"
    remembers = True
    explanation = (
        "A belt, a long screw or a soft coupling gives way between motor and load: they swing "
        "against each other."
    )
    experiment = "Step the force while sliding: the motor's speed rings at the natural frequency."
