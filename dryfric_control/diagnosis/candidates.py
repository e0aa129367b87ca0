"""Candidates of a diagnosis: what may be added to an axis, and where its fit starts.

A candidate has the name that its effect has in the axis: the slug, and "cogging_2"
for a second of a kind.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass

import numpy as np

from dryfric_control.model.axis import FrictionAxis
from dryfric_control.model.effects import Effect
from dryfric_control.model.effects.effect import REGISTRY
from dryfric_control.model.effects.guesses import Guess, View
from dryfric_control.model.effects.naming import class_of, named, put
from dryfric_control.records.record import Record

#: Base parameters by the slug of the cause that a wrong value is.
BASE = {slug: effect.base for slug, effect in REGISTRY.items() if effect.base}
#: The same the other way round.
SLUGS = {name: slug for slug, name in BASE.items()}

# Sliding samples below which no regression is tried: three for each parameter of the largest.
_LEAST_SLIDING = 15
# Part of the travel of the records beyond its ends where a place is still in it.
_OUTSIDE = 0.1
# Velocity over the largest of the records, that of nearly all samples, beyond which what depends
# on it is the same for all.
_FASTER, _NEARLY_ALL = 3.0, 0.995
# Part of a sample below which nothing is late.
_SOONEST = 0.02
# Actions of which an axis holds one.
_SINGLE = ("delay", "lag", "contact", "transmission")


@dataclass(frozen=True)
class Start:
    """An axis with a candidate in it, and names of what is free beside the base."""

    axis: FrictionAxis
    free: tuple[str, ...]


def catalogue(axis: FrictionAxis, found: Sequence[str] = ()) -> tuple[str, ...]:
    """Names of effects that may be tried on an axis: all registered and not found yet.

    One that the axis already has may be there with the wrong numbers; of those that
    repeat one more may be there.
    """
    present = named(axis)
    actions = {e.action for e in axis.effects}
    names = []
    for slug, effect in REGISTRY.items():
        if slug in BASE:
            continue
        alike = [n for n in present if class_of(n) is effect]
        if alike:
            alike += [f"{slug}_{len(alike) + 1}"] if effect.repeats else []
        elif effect.action not in actions.intersection(_SINGLE):
            alike = [slug]
        names += [n for n in alike if n not in found]
    return tuple(names)


def effect_class(name: str) -> type[Effect]:
    """Class of a candidate by its name."""
    effect = class_of(name)
    assert effect is not None, name
    return effect


def holds(axis: FrictionAxis, name: str) -> bool:
    """Whether an axis has an effect, as its own field or in its list."""
    return name in named(axis)


def guesses(name: str, view: View) -> Iterable[Guess]:
    """First guesses for one candidate: its values, and base values beside it.

    One that the axis has already starts from the numbers it has there.
    """
    mine = named(view.axis).get(name)
    if mine is None:
        # A record at rest has no sliding samples to guess from.
        return effect_class(name).guess(view) if view.v.size >= _LEAST_SLIDING else ()
    now = asdict(mine)
    first = next(iter(now))
    factors = (1.0, 0.2, 2.0)
    return [(now | {first: factor * now[first]}, {}) for factor in factors]


def with_effect(axis: FrictionAxis, name: str, values: dict[str, float]) -> Start:
    """Axis with one effect more or another in its place.

    A guess outside the bounds of its parameter is moved to the nearer one.
    """
    effect = effect_class(name)
    kinds = effect.parameters()
    for parameter in values:
        low, high = kinds[parameter]["bounds"]
        values[parameter] = min(max(values[parameter], low), high)
    return Start(put(axis, name, effect(**values)), own_names(name))


def placed(name: str, values: Mapping[str, float], records: Sequence[Record]) -> bool:
    """Whether a cause acts at a place and a velocity that the machine had, over a time that shows.

    `values`: by the names of its free parameters, those of a second of its kind with its own.
    """
    kinds = effect_class(name).parameters()
    low, high = travelled(records)
    shortest = _SOONEST * float(np.median([r.dt for r in records]))
    for own, value in values.items():
        of_kind = kinds[own.partition(".")[2]]
        kind = of_kind["kind"]
        if kind == "place" and not low <= value <= high:
            return False
        if kind == "time" and value < shortest:
            return False
        if of_kind["unit"] == "m/s" and value > _FASTER * max(_fastest(r) for r in records):
            return False
    return True


def travelled(records: Sequence[Record]) -> tuple[float, float]:
    """Lowest and highest place that counts as one where the machine has been."""
    low = min(float(r.x.min()) for r in records)
    high = max(float(r.x.max()) for r in records)
    room = _OUTSIDE * (high - low)
    return low - room, high + room


def _fastest(record: Record) -> float:
    return float(np.quantile(np.abs(record.derivatives().v), _NEARLY_ALL))


def own_names(name: str) -> tuple[str, ...]:
    """Names of the free parameters of a candidate."""
    return tuple(f"{name}.{p}" for p in effect_class(name).named_parameters())
