"""What can be exported: its numbers, memory, signals and the kernel of one sample."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dryfric_control.checks import positive
from dryfric_control.compensation.design import Compensation
from dryfric_control.compiled import axis_step, compensation, elastic, hybrid_filter, observer
from dryfric_control.export import entries
from dryfric_control.export import translate as c
from dryfric_control.export.translate import Function, Translator
from dryfric_control.model.axis import FrictionAxis, check_pace
from dryfric_control.model.effects.effect import Effect, law_address
from dryfric_control.observer.design import ObserverDesign
from dryfric_control.observer.hybrid_filter import HybridFilter
from dryfric_control.observer.runtime import first_memory, tables
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
    """One object as numbers, memory, signals and the kernel of one sample."""

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
    def periods(self) -> dict[tuple[tuple[int, ...], int], tuple[float, float]]:
        """Time and length after which each law repeats, by the integers of its axis."""
        kinds = {law_address(kind): kind for kind in self._effects()}
        found = {}
        for name, integers in self.tables.items():
            if not name.endswith("integers") or integers.size < axis_step.LAWS:
                continue
            numbers, i = self.tables[name.replace("integers", "numbers")], axis_step
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
            if effect.action in ("input", "force", "friction", "reading")
        }

    def translated(self, single: bool) -> tuple[Translator, Function, Function | None]:
        """The kernels in C: all of them, that of one sample, and that which only looks."""
        laws = {axis_step.rigid_task().address: ("rigid", axis_step._rigid_task)}
        laws |= {law_address(kind): (kind.slug, kind.law) for kind in self._effects()}
        if self.moves and self.tables["integers"][axis_step.STRUCTURE]:
            laws[elastic.inner_task().address] = ("inner", elastic._inner_task)
        out = Translator(laws, single, self.periods)
        try:
            return out, *self._functions(out)
        except c.NotInC as problem:
            raise ValueError(
                f"{self.name} has no C: {problem}; a law may use numbers, its arguments, if, and "
                "the functions of math: rewrite it, or export the axis without that effect"
            ) from None

    def _functions(self, out: Translator) -> tuple[Function, Function | None]:
        memory, table = c.Pointer("p"), {n: self._table(n) for n in self.tables}
        if self.moves:
            places = [axis_step.DELAY, axis_step.LAG]
            known = tuple((i, float(self.tables["numbers"][i])) for i in places)
            numbers = c.Pointer("p", "f", True, known)
            plant = (numbers, table["integers"], memory, c.F, c.F, c.F)
            events = (c.Pointer("p"), c.Pointer("p", "i"))
            step = out.function(entries.move, (*plant, c.BOOL, *events, memory), "dfc_sample")
            return step, out.function(entries.look, (*plant, memory), "dfc_look")
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


def exported(obj: Any, name: str | None = None, dt: float | None = None) -> Exported:
    """An object as it is exported."""
    maker = next((made for kind, made in _MAKERS.items() if isinstance(obj, kind)), None)
    if maker is None:
        raise ValueError(
            "obj must be a FrictionAxis, an ObserverDesign, a HybridFilter or a Compensation, "
            f"got {type(obj).__name__}"
        )
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
    tail, kind, returns, entry, parts = maker
    known = obj if plant else obj.axis
    # An axis is named for people: what C does not take becomes "_".
    free = re.sub(r"[^A-Za-z0-9_]+", "_", known.name + tail) if name is None else name
    own = _identifier(free, name is None)
    return Exported(own, kind, known, step, returns, entry, **parts(obj, step))


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
        "tables": {"numbers": arrays.numbers, "integers": arrays.integers},
        "memory": np.zeros(arrays.memory),
        "starts": (
            (Signal("x0", length, "position at the start", place=True), axis_step.X),
            (Signal("v0", f"{length}/s", "velocity at the start"), axis_step.V),
        ),
        "inputs": (Signal("u", force, "drive force, held to the next sample"),),
        "outputs": (
            Signal("x", length, "position, as the encoder reads it", place=True),
            Signal("v", f"{length}/s", "velocity"),
            Signal("friction", force, "friction force"),
            Signal("mode", "1", "0 stuck, +1 and -1 sliding", True),
        ),
        "promise": words + axis.effective().describe(),
        "places": ((axis_step.X, 1.0),),
        "rest": axis_step.REST,
    }


def _of_observer(design: ObserverDesign, dt: float) -> dict[str, Any]:
    length, force = design.axis.units
    return {
        "tables": tables(design)._asdict(),
        "memory": first_memory(design),
        "starts": (
            (Signal("xhat0", length, "first estimate of the position", place=True), observer.XHAT),
            (Signal("vhat0", f"{length}/s", "first estimate of the velocity"), observer.VHAT),
            (Signal("what0", force, "first integral term"), observer.WHAT),
        ),
        "inputs": _drive_and_reading(design.axis),
        "outputs": _estimates(design.axis),
        "promise": design.summary(),
        "places": ((observer.XHAT, 1.0), (observer.PLACE, 1.0)),
        "rest": observer.REST,
    }


def _of_filter(made: HybridFilter, dt: float) -> dict[str, Any]:
    state = observer.LINE + int(made.tables.axis_integers[axis_step.N_HISTORY])
    first, stride = state + hybrid_filter.BELIEFS + hybrid_filter.X, hybrid_filter.GAUSSIAN
    quantum = float(made.tables.numbers[hybrid_filter.QUANTUM])
    cells = [(first + mode * stride, quantum) for mode in range(3)]
    speed, words = f"{made.axis.units[0]}/s", "logarithm of the probability of the reading"
    more = (
        Signal("vhat_sd", speed, "standard deviation of vhat"),
        Signal("log_likelihood", "1", words),
    )
    return {
        "tables": made.tables._asdict(),
        "memory": np.zeros(made.memory_size),
        "inputs": _drive_and_reading(made.axis),
        "outputs": (*_estimates(made.axis), *more),
        "promise": "A filter of three modes carries no certificate: it states its own standard "
        "deviation.",
        "places": ((observer.XHAT, 1.0), (state + hybrid_filter.READING, 1.0), *cells),
        "rest": observer.REST,
    }


def _of_compensation(comp: Compensation, dt: float) -> dict[str, Any]:
    length, force = comp.axis.units
    law = comp.controller.law
    lead = int(law.numbers[compensation.LEAD])
    watch = compensation.LINE + compensation.STRIDE * lead  # the observer's memory
    # The observer of a learning law works on the error, the others on the position.
    learned = law.numbers[compensation.SOURCE] == compensation.LEARNED
    places = (
        *(compensation.AHEAD, *(() if learned else (compensation.INNER,))),
        *(compensation.LINE + compensation.STRIDE * i for i in range(lead)),
        *(watch + observer.XHAT, watch + observer.PLACE),
    )
    return {
        "tables": {n: np.asarray(array) for n, array in law._asdict().items()},
        "memory": comp.controller.memory(),
        "inputs": (
            Signal("xref", length, f"reference of {comp.lead} samples later", place=True),
            Signal("vref", f"{length}/s", "its velocity"),
            Signal("aref", f"{length}/s^2", "its acceleration"),
            Signal("y", length, "position read at this sample", place=True),
        ),
        "outputs": (
            Signal("u", force, "drive force to hold until the next sample"),
            Signal("friction", force, "its part that compensates friction"),
        ),
        "promise": comp.summary(),
        "more": (comp.rigid_axis, *([comp.observer.axis] if comp.observer is not None else [])),
        "places": tuple((place, 1.0) for place in places),
        "rest": watch + observer.REST,
        "clock": compensation.SAMPLES,
    }


_ESTIMATED = (
    "A step returns the estimate at the instant of the reading, under the drive from then on; "
    "then it predicts the next sample."
)
#: What can be exported: end of its name, its kind, what a step returns, kernel, its other parts.
_MAKERS: dict[type, tuple[str, str, str, Callable[..., Any], Callable[..., dict[str, Any]]]] = {
    FrictionAxis: (
        "", "axis with dry friction",
        "A step returns the axis at the start of the sample, under the new input; then it moves.",
        entries.move, _of_axis,
    ),
    ObserverDesign: ("_observer", "switched PI observer", _ESTIMATED, observer.step, _of_observer),
    HybridFilter: ("_filter", "hybrid cell filter", _ESTIMATED, hybrid_filter.step, _of_filter),
    Compensation: (
        "_compensation", "friction-compensating position controller",
        "A step returns the drive of this sample: give it out at once, and hold it.",
        entries.compensate, _of_compensation,
    ),
}  # fmt: skip
