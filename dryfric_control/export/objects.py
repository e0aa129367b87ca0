"""What can be exported: its numbers, memory, signals and the kernel of one sample."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dryfric_control.checks import positive
from dryfric_control.compensation.design import Compensation
from dryfric_control.compiled import (
    axis_step,
    compensation,
    elastic,
    observer,
    states,
)
from dryfric_control.export import entries
from dryfric_control.export import translate as c
from dryfric_control.export.translate import Function, Translator
from dryfric_control.model.axis import FrictionAxis, check_pace
from dryfric_control.model.effects.effect import Effect, law_address
from dryfric_control.observer.base import Observer
from dryfric_control.text import rotary_words

Array = NDArray[Any]

#: Switches of one sample that an exported axis lists; more are counted.
ROOM = 16
#: Longest line of delayed drives, in samples.
MOST_DELAY = 4096
#: Words of C that a name must not be.
_TAKEN = c.KEYWORDS | {"main", "real"}


@dataclass(frozen=True)
class Signal:
    """An input, an output or a number that is set."""

    name: str
    unit: str
    meaning: str
    whole: bool = False
    place: bool = False  # a position
    # As a variable of an FMU.
    causality: str = ""  # "input", "output", "parameter"
    start: float | None = None
    low: float = -math.inf
    high: float = math.inf
    fixed: bool = False  # set before the start alone

    def __post_init__(self) -> None:
        object.__setattr__(self, "meaning", rotary_words(self.meaning, self.unit))


@dataclass(frozen=True)
class Exported:
    """One object as numbers, memory, signals and the kernel of one sample.

    Notes
    -----
    Rules for a new object to export; an `Observer` follows them by its class, so none is needed.

    1. A function of this module returns its parts from the object and the step, `_maker_of` names
       that function, the kernel and the words.  Nothing else knows the kind of an object.
    2. The kernel is the compiled function that runs in Python; it is translated, never written
       twice.  It takes numbers, arrays and tuples; its loops are over a range, or searches with a
       bound.  What it uses beyond that goes into `export/translate.py`.
    3. `tables` are constant; everything that changes is in `memory`, whose size is fixed.
    4. Inputs, outputs and starts are `Signal`s with a unit and a meaning, in the order of the
       kernel's arguments.
    5. `places` lists every place of the memory that holds a position, `rest` that of the time at
       rest, `clock` that of a count of samples: single precision moves them.
    6. `promise` says what is certified, or that nothing is.
    7. A test compiles it and compares with the kernel, bit by bit (`tests/export/test_c_code.py`).
    """

    name: str  # prefix of every C name
    kind: str  # in words
    axis: FrictionAxis  # that it is or knows
    dt: float  # [s]
    returns: str  # what a step returns, and of which instant
    entry: Callable[..., Any]
    tables: dict[str, Array]  # constant arrays
    memory: Array  # before the first sample
    inputs: tuple[Signal, ...]
    outputs: tuple[Signal, ...]
    promise: str  # the certificate in words
    #: Positions in the memory, and their unit; the first follows the axis.
    places: tuple[tuple[int, float], ...]
    rest: int  # place of the time at rest in the memory
    starts: tuple[tuple[Signal, int], ...] = ()  # numbers to start from, places in the memory
    clock: int | None = None  # place of the number of samples, where the kernel counts
    more: tuple[FrictionAxis, ...] = ()  # axes that it knows beside

    @property
    def moves(self) -> bool:
        """Whether it is an axis, which lists its switches."""
        return self.entry is entries.move

    @property
    def grid(self) -> float:
        """Step in which the origin of positions moves in single precision, a power of two.

        A sixteenth of a sample's way at the stick speed, a millionth of the shortest period.
        """
        short = [self.axis.effective().stick_speed * self.dt * 2.0**20]
        short += [2.0**4 * length for _, length in self.periods.values()]
        return 2.0 ** math.floor(math.log2(min(short)))

    @property
    def periods(
        self,
    ) -> dict[tuple[tuple[int, ...], int], tuple[float, float]]:
        """Time and length after which each law repeats, by the integers of its axis."""
        kinds = {law_address(kind): kind for kind in self._effects()}
        found = {}
        for name, integers in self.tables.items():
            if not name.endswith("integers") or integers.size < axis_step.LAWS:
                continue
            numbers = self.tables[name.replace("integers", "numbers")]
            i = axis_step
            for k in range(sum(integers[[i.N_INPUT, i.N_FORCE, i.N_LEVEL, i.N_READING]])):
                kind = kinds[integers[i.LAWS + 2 * k]]
                first = integers[i.LAWS + 2 * k + 1]
                values = numbers[first : first + len(kind.parameters())]
                found[tuple(integers.tolist()), k] = kind(*values).periods
        return found

    def _effects(self) -> set[type[Effect]]:
        """Kinds of effects that have a law."""
        return {
            type(effect)
            for axis in (self.axis, *self.more)
            for effect in axis.effective().effects
            if effect.action in ("input", "force", "friction", "reading", "memory")
        }

    def translation(self, single: bool) -> tuple[Translator, Function, Function | None]:
        """The kernels in C: all of them, that of one sample, and that which only looks."""
        laws = {
            axis_step.rigid_task().address: (
                "rigid",
                axis_step._rigid_task,
            )
        }
        for kind in self._effects():
            for name in ("law", "flow", "jump"):
                laws[law_address(kind, name)] = (kind.slug, getattr(kind, name))
        structure = self.tables["integers"][axis_step.STRUCTURE] if self.moves else 0
        if structure & axis_step.REMEMBERS:
            laws[states.states_task().address] = ("states", states._states_task)
        elif structure:
            laws[elastic.inner_task().address] = (
                "inner",
                elastic._inner_task,
            )
        out = Translator(laws, single, self.periods)
        try:
            return out, *self._functions(out)
        except c.NotInC as problem:
            raise ValueError(
                f"{self.name} has no C: {problem}; a law may use numbers, its arguments, if, and "
                "the functions of math: rewrite it, or export the axis without that effect"
            ) from None

    def _functions(self, out: Translator) -> tuple[Function, Function | None]:
        memory = c.Pointer("p")
        table = {n: self._table(n) for n in self.tables}
        if self.moves:
            places = [axis_step.DELAY, axis_step.LAG]
            known = tuple((i, float(self.tables["numbers"][i])) for i in places)
            numbers = c.Pointer("p", "f", True, known)
            plant = (numbers, table["integers"], memory, c.F, c.F, c.F)
            events = (c.Pointer("p"), c.Pointer("p", "i"))
            step = out.function(
                entries.move,
                (*plant, c.BOOL, *events, memory),
                "dfc_sample",
            )
            return step, out.function(entries.axis_outputs, (*plant, memory), "dfc_look")
        given: tuple[c.Kind, ...] = tuple(table.values())
        if self.entry is entries.compensate:
            given = (c.Record("Law", compensation.Law._fields, given),)
        signals = (c.F,) * (1 + len(self.inputs))
        return out.function(self.entry, (*given, memory, *signals, memory), "dfc_sample"), None

    def _table(self, name: str) -> c.Table:
        array = self.tables[name]
        element = "i" if array.dtype.kind == "i" else "f"
        values = tuple(array.ravel().tolist())
        return c.Table("k", f"dfc_{name}", element, array.shape, values)


def export_object(obj: Any, name: str | None = None, dt: float | None = None) -> Exported:
    """An object as it is exported."""
    maker = _maker_of(obj)
    plant = isinstance(obj, FrictionAxis)
    if not plant and dt is not None and dt != obj.dt:
        raise ValueError(
            f"dt is for an axis: {type(obj).__name__} was made for dt = {obj.dt:g} s, got {dt!r}"
        )
    step = positive("dt", 1e-3 if dt is None else dt, unit="s") if plant else obj.dt
    # Before any array is made: a delay in the wrong unit would fill the memory.
    axis = (obj if plant else obj.axis).effective()
    delay = sum(effect.inner(axis).delay for effect in axis.effects if effect.action == "delay")
    if delay > MOST_DELAY * step:
        raise ValueError(
            f"the drive is late by {delay:g} s, {delay / step:.4g} samples of dt = {step:g} s; "
            f"the exported memory holds {MOST_DELAY}: check the units of delay and dt"
        )
    known = obj if plant else obj.axis
    # An axis is named for people: what C does not take becomes "_".
    free = re.sub(r"[^A-Za-z0-9_]+", "_", known.name + maker.suffix) if name is None else name
    own = _identifier(free, name is None)
    return Exported(
        own,
        maker.kind,
        known,
        step,
        maker.returns,
        maker.entry,
        **maker.parts(obj, step),
    )


def _identifier(name: Any, of_axis: bool) -> str:
    """The name, if C takes it."""
    mend = 'pass name="..."' + (" or axis.replace(name=...)" if of_axis else "")
    if not isinstance(name, str) or not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]{0,40}", name):
        raise ValueError(
            f"name {name!r} is no C identifier (letter, letters, digits and _, at most 41): {mend}"
        )
    if name in _TAKEN or name.startswith("dfc_"):
        raise ValueError(f"name {name!r} is taken in C, or by the generated code: {mend}")
    return name


def _estimates(axis: FrictionAxis) -> tuple[Signal, ...]:
    length, force = axis.units
    return (
        Signal("xhat", length, "position", place=True),
        Signal("vhat", f"{length}/s", "velocity"),
        Signal("friction", force, "friction force"),
        Signal("integral", force, "integral term, minus the friction error"),
        Signal("mode", "1", "0 stuck, +1 and -1 sliding", True),
    )


def _drive_and_reading(axis: FrictionAxis) -> tuple[Signal, ...]:
    return (
        Signal("u", axis.units[1], "drive force from this sample on"),
        Signal("y", axis.units[0], "position read at this sample", place=True),
    )


def _of_axis(axis: FrictionAxis, dt: float) -> dict[str, Any]:
    check_pace(axis, dt)
    arrays = axis.arrays(dt)
    length, force = axis.units
    words = "The switched model of the package, its switches located inside the samples:\n"
    return {
        "tables": {
            "numbers": arrays.numbers,
            "integers": arrays.integers,
        },
        "memory": np.zeros(arrays.memory),
        "starts": (
            (
                Signal("x0", length, "position at the start", place=True),
                axis_step.X,
            ),
            (
                Signal("v0", f"{length}/s", "velocity at the start"),
                axis_step.V,
            ),
        ),
        "inputs": (Signal("u", force, "drive force, held to the next sample"),),
        "outputs": (
            Signal(
                "x",
                length,
                "position, as the encoder reads it",
                place=True,
            ),
            Signal("v", f"{length}/s", "velocity"),
            Signal("friction", force, "friction force"),
            Signal("mode", "1", "0 stuck, +1 and -1 sliding", True),
        ),
        "promise": words + axis.effective().describe(),
        "places": ((axis_step.X, 1.0),),
        "rest": axis_step.REST,
    }


def _of_observer(made: Observer, dt: float) -> dict[str, Any]:
    axis = made.axis
    first = {
        "xhat0": Signal(
            "xhat0",
            axis.unit("m"),
            "first estimate of the position",
            place=True,
        ),
        "vhat0": Signal("vhat0", axis.unit("m/s"), "first estimate of the velocity"),
        "what0": Signal("what0", axis.unit("N"), "first integral term"),
    }
    more = (Signal(one.name, axis.unit(one.unit), one.meaning) for one in made.more_outputs)
    return {
        "tables": made.tables()._asdict(),
        "memory": made.memory(),
        "starts": tuple((first[name], place) for name, place in made.starts.items()),
        "inputs": _drive_and_reading(axis),
        "outputs": (*_estimates(axis), *more),
        "promise": made.certificate_text,
        "places": made.position_places,
        "rest": made.rest_place,
    }


def _of_compensation(comp: Compensation, dt: float) -> dict[str, Any]:
    length, force = comp.axis.units
    law = comp.controller.law
    lead = int(law.numbers[compensation.LEAD])
    watch = compensation.LINE + compensation.STRIDE * lead  # the observer's memory
    # The observer of a learning law works on the error, the others on the position.
    learned = law.numbers[compensation.SOURCE] == compensation.LEARNED
    places = (
        *(
            compensation.AHEAD,
            *(() if learned else (compensation.INNER,)),
        ),
        *(compensation.LINE + compensation.STRIDE * i for i in range(lead)),
        *(watch + observer.XHAT, watch + observer.PLACE),
    )
    return {
        "tables": {n: np.asarray(array) for n, array in law._asdict().items()},
        "memory": comp.controller.memory(),
        "inputs": (
            Signal(
                "xref",
                length,
                f"reference of {comp.lead} samples later",
                place=True,
            ),
            Signal("vref", f"{length}/s", "its velocity"),
            Signal("aref", f"{length}/s^2", "its acceleration"),
            Signal("y", length, "position read at this sample", place=True),
        ),
        "outputs": (
            Signal("u", force, "drive force to hold until the next sample"),
            Signal("friction", force, "its part that compensates friction"),
        ),
        "promise": comp.summary(),
        "more": (
            comp.rigid_axis,
            *([comp.observer.axis] if comp.observer is not None else []),
        ),
        "places": tuple((place, 1.0) for place in places),
        "rest": watch + observer.REST,
        "clock": compensation.SAMPLES,
    }


class _Maker(NamedTuple):
    """How an object becomes `Exported`."""

    suffix: str  # end of its names
    kind: str  # in words
    returns: str  # what a step returns
    entry: Callable[..., Any]  # kernel of one sample
    parts: Callable[..., dict[str, Any]]  # its other parts


def _maker_of(obj: Any) -> _Maker:
    if isinstance(obj, FrictionAxis):
        returns = (
            "A step returns the axis at the start of the sample, under the new input; "
            "then it moves."
        )
        return _Maker("", "axis with dry friction", returns, entries.move, _of_axis)
    if isinstance(obj, Observer):
        returns = (
            "A step returns the estimate at the instant of the reading, under the drive from then "
            "on; then it predicts the next sample."
        )
        return _Maker(
            obj.suffix,
            obj.title,
            returns,
            obj.sample_kernel.step,
            _of_observer,
        )
    if isinstance(obj, Compensation):
        return _Maker(
            "_compensation",
            "friction-compensating position controller",
            "A step returns the drive of this sample: give it out at once, and hold it.",
            entries.compensate,
            _of_compensation,
        )
    raise ValueError(
        "obj must be a FrictionAxis, an observer (such as an ObserverDesign or a HybridFilter) or "
        f"a Compensation, got {type(obj).__name__}"
    )
