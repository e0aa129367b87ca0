"""What a physical effect is, and the register of all that are known.

The class of an effect states what it is called, its parameters with units and
bounds, the compiled law by which it acts, what it is in plain words, and the
experiment that would expose it.  Simulation, fitting, diagnosis and the
documentation all read the same class.
"""

from __future__ import annotations

import inspect
import itertools
import math
from collections.abc import Callable
from dataclasses import MISSING, dataclass, field, fields
from typing import Any, ClassVar

from numba import cfunc

from dryfric_control.checks import finite
from dryfric_control.compiled.axis_step import LAW

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
    >>> dfc.effects.parameter("N", "force", bounds=(0.0, 10.0)).metadata["unit"]
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
    axis with other base parameters.  A law that varies fast along the way or in
    time says so by `shortest_length` and `shortest_time`.

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
    >>> dfc.effects.Spring(stiffness=200.0).describe()
    'spring: stiffness = 200 N/m, rest = 0 m'
    """

    slug: ClassVar[str] = ""
    title: ClassVar[str] = ""
    action: ClassVar[str] = ""
    explanation: ClassVar[str] = ""
    experiment: ClassVar[str] = ""
    #: Whether position, speed and mode do not tell all it does: it looks back.
    remembers: ClassVar[bool] = False
    #: Whether it reads the position; runs of an axis that does not anywhere are
    #: the same from every place.
    depends_on_place: ClassVar[bool] = True
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

    @property
    def shortest_length(self) -> float:
        """Length over which the law may turn round, as inf where it does not.

        Steps of the integration are not longer: a law that repeats with position would else
        be seen at the same phase by every stage.
        """
        return math.inf

    @property
    def shortest_time(self) -> float:
        """Time over which the law may turn round by itself [s], inf where it does not."""
        return math.inf

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


#: Every known effect by slug, in the order of registration.
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
        If the class lacks a slug, a known action, a law or an `alter`, takes the
        slug of another effect, or its law reads a parameter that it does not declare.

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> import dryfric_control as dfc
    >>> @dfc.effects.register_effect
    ... @dataclass(frozen=True)
    ... class Magnet(dfc.effects.Effect):
    ...     strength: float = dfc.effects.parameter("N m^2", "pull times distance squared")
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
        raise ValueError(
            f"register_effect takes a class that derives from dfc.effects.Effect, got {cls!r}"
        )
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
    _check_numbers(cls)
    REGISTRY[cls.slug] = cls
    return cls


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
    for name in inspect.get_annotations(cls):
        if name not in cls.__dataclass_fields__:
            raise ValueError(
                f"{cls.__name__}.{name} is no field: put @dataclass(frozen=True) above the class "
                "and call dfc.effects.parameter(...) for each parameter"
            )
    if cls.action not in _BY_LAW:
        return
    law = getattr(cls.law, "py_func", cls.law)
    bounds = [item.metadata["bounds"] for item in fields(cls)]
    p = _Numbers(min(max(1.0, low), high) for low, high in bounds)
    has = f"p[0] to p[{len(p) - 1}]" if p else "no parameter"
    for state in itertools.product(*_TRIED):
        try:
            law(*state, p)
        except _NumberError as wrong:
            raise ValueError(
                f"{cls.__name__}.law reads p[{wrong}], but the class declares {has}"
            ) from None
        except Exception:  # its own numbers, or what only the compiler knows
            continue


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
        if REGISTRY.get(cls.slug) is not cls:  # else checked as it was registered
            _check_numbers(cls)
        try:
            _COMPILED[cls] = cfunc(LAW, cache=True)(cls.law)
        except RuntimeError as problem:
            # A class typed at the prompt has no file beside which to keep a cache.
            if "cannot cache" not in str(problem):
                raise
            _COMPILED[cls] = cfunc(LAW)(cls.law)
    return int(_COMPILED[cls].address)
