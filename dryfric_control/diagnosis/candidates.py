"""Candidates of a diagnosis: effects that may be added, and their first guesses.

A candidate has the name of its effect in the axis: the slug, or e.g. "cogging_2" for
the second effect of a kind.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dryfric_control.diagnosis.thresholds import MIN_PERIODS, MIN_VISIBLE_DELAY
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.model.effects import Effect
from dryfric_control.model.effects.effect import KINDS, REGISTRY
from dryfric_control.model.effects.naming import class_of, named, put
from dryfric_control.records.record import Record

#: Base parameters by the slug of the cause that a wrong value represents.
BASE = {slug: effect.base for slug, effect in REGISTRY.items() if effect.base}
#: Slugs by base parameter, the inverse of `BASE`.
SLUGS = {name: slug for slug, name in BASE.items()}

# Margin at each end of the records' travel, as a fraction of it, in which a place is still valid.
_TRAVEL_MARGIN = 0.1
# The same of the rest of a spring, which is preloaded by so many times what it gains over the
# travel; beyond, it is a constant force.
_PRELOAD = 2.0
# Characteristic speed over the fast speed of the records, beyond which it has no visible effect:
# the record looks the same for all such values.
_MAX_SPEED_RATIO = 3.0
# Quantile of |v| that is the fast speed of the records.
_FAST_QUANTILE = 0.995
# Slowest characteristic speed [encoder increments per sample]: slower sliding looks like rest.
_MIN_SPEED = 0.1
# Longest time, over the length of the record, by which a drive may be late.
_MAX_DELAY_FRACTION = 0.03
# Smallest length, as a fraction of an increment of the readings, that has a visible effect: with a
# narrower play the filter differs from that without one, but not the machine.
_MIN_VISIBLE_LENGTH = 0.1
# Error of the readings, as a fraction of their increment, up to which it is their rounding.
_MIN_READING_ERROR = 0.5


@dataclass(frozen=True)
class Start:
    """An axis with a candidate in it, and the names of the candidate's free parameters."""

    axis: FrictionAxis
    free: tuple[str, ...]


def excluded_actions(effects: Iterable[Effect | type[Effect]]) -> set[str]:
    """Actions of effects that an axis cannot have beside some."""
    return {action for effect in effects for action in effect.excluded_actions()}


def catalogue(axis: FrictionAxis, found: Sequence[str] = ()) -> tuple[str, ...]:
    """Names of effects to try on an axis: its own, all others, of repeatable ones one more."""
    present = named(axis)
    excluded = excluded_actions(axis.effects)
    names = []
    for slug, effect in REGISTRY.items():
        if slug in BASE:
            continue
        alike = [n for n in present if class_of(n) is effect]
        if alike:
            alike += [f"{slug}_{len(alike) + 1}"] if effect.repeats else []
        elif effect.action not in excluded:
            alike = [slug]
        names += [n for n in alike if n not in found]
    return tuple(names)


def effect_class(name: str) -> type[Effect]:
    """Class of a candidate by its name."""
    effect = class_of(name)
    assert effect is not None, name
    return effect


def holds(axis: FrictionAxis, name: str) -> bool:
    """Whether an axis has an effect, as a field or in its list of effects."""
    return name in named(axis)


def with_effect(axis: FrictionAxis, name: str, values: dict[str, float]) -> Start:
    """Axis with an effect added, or replaced if it has one of that name, within its bounds."""
    effect = effect_class(name)
    kinds = effect.parameters()
    for parameter in values:
        low, high = kinds[parameter]["bounds"]
        values[parameter] = min(max(values[parameter], low), high)
    return Start(put(axis, name, effect(**values)), own_names(name))


def shown_range(
    name: str, records: Sequence[Record], travel: tuple[float, float] | None
) -> tuple[float, float]:
    """Least and largest value of a parameter, such as "cogging_2.amplitude", that records show."""
    owner, _, own = name.partition(".")
    effect = effect_class(owner)
    item = effect.parameters()[own]
    kind = item["kind"]
    unit = item["unit"]
    if kind == "share":
        # A very light mass would vibrate over thousands of steps while the other rests.
        return KINDS["share"]
    if kind == "place":
        margin = _PRELOAD if own == effect.adds_constant else _TRAVEL_MARGIN
        return _place_range(records, travel, margin)
    dt = float(np.median([r.dt for r in records]))
    if kind == "time":
        return MIN_VISIBLE_DELAY * dt, _MAX_DELAY_FRACTION * max(r.duration for r in records)
    step = min(r.resolution.step for r in records)
    if unit == "s":
        return dt, math.inf
    if unit == "Hz":
        return MIN_PERIODS / max(r.duration for r in records), 0.5 / dt
    if unit == "m" and kind == "amount":
        least = _MIN_READING_ERROR if effect.action == "reading" else _MIN_VISIBLE_LENGTH
        longest = max(r.range for r in records) / MIN_PERIODS
        return least * step, longest if own == "period" else math.inf
    if unit == "m/s":
        fast = max(np.quantile(np.abs(r.derivatives().v), _FAST_QUANTILE) for r in records)
        return _MIN_SPEED * step / dt, _MAX_SPEED_RATIO * float(fast)
    return -math.inf, math.inf


def _place_range(
    records: Sequence[Record], travel: tuple[float, float] | None, margin: float
) -> tuple[float, float]:
    """Ends of the travel, of the records and the axis; `margin`: part of theirs beyond records."""
    low = min(float(r.x.min()) for r in records)
    high = max(float(r.x.max()) for r in records)
    room = margin * (high - low)
    ends = travel or ()
    return min([low - room, *ends]), max([high + room, *ends])


def repeat_apart(one: Effect, other: Effect, records: Sequence[Record]) -> bool:
    """Whether a record holds a beat of two effects that repeat: they are no single one there."""
    time = max(r.duration for r in records)
    travel = max(r.range for r in records)
    rows = zip(one.periods, other.periods, (time, travel), strict=True)
    beats = [shown * abs(1.0 / a - 1.0 / b) for a, b, shown in rows if a + b < math.inf]
    return not beats or max(beats) >= 1.0


def is_within_records(
    values: Mapping[str, float], records: Sequence[Record], travel: tuple[float, float] | None
) -> bool:
    """Whether a cause acts at positions, lengths, speeds and times that the records show."""
    near = 1.0 + 1e-6
    bounds = ((v, *shown_range(n, records, travel)) for n, v in values.items())
    return all((low < v * near and v < high * near) or low <= v <= high for v, low, high in bounds)


def free_amounts(name: str, own: Iterable[str]) -> Iterator[tuple[str, float, bool]]:
    """Free amounts of a candidate, the value at which each vanishes, whether others do without."""
    kinds = effect_class(name).parameters()
    for full in own:
        kind = kinds[full.partition(".")[2]]
        if kind["kind"] == "amount" and kind["neutral"] is not None:
            yield full, kind["neutral"], kind["optional"]


def forms(axis: FrictionAxis, names: Iterable[str]) -> list[FrictionAxis]:
    """The axis, and with one of some effects in another form each."""
    effects = named(axis)
    return [axis, *(put(axis, name, one) for name in names for one in effects[name].forms(axis))]


def _held_amounts(name: str) -> list[str]:
    """Amounts of an effect that stay as they are until it is found."""
    rows = effect_class(name).parameters().items()
    return [p for p, k in rows if k["kind"] == "amount" and not k["free"]]


def form_of(name: str, values: Mapping[str, float]) -> tuple[str, ...]:
    """Amounts of an effect that are held and not zero: what tells its forms apart."""
    return tuple(p for p in _held_amounts(name) if values.get(p, 0.0) != 0.0)


def held_by(axis: FrictionAxis, name: str) -> tuple[str, ...]:
    """Full names of an effect's amounts that stay as they are until it is found."""
    unused = named(axis)[name].unused_parameters
    return tuple(f"{name}.{p}" for p in _held_amounts(name) if p not in unused)


def with_held(axis: FrictionAxis, names: Iterable[str], free: Sequence[str]) -> tuple[str, ...]:
    """Free parameters, with what some effects have held as their form in the axis has it."""
    names = [*names]
    every = {f"{name}.{p}" for name in names for p in _held_amounts(name)}
    held = [full for name in names for full in held_by(axis, name)]
    return (*(n for n in free if n not in every or n in held), *(n for n in held if n not in free))


def own_names(name: str) -> tuple[str, ...]:
    """Names of the free parameters of a candidate."""
    return tuple(f"{name}.{p}" for p in effect_class(name).named_parameters())
