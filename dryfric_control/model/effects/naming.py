"""Effects of an axis by name, so that one axis may hold several of a kind."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import fields
from typing import Any

from dryfric_control.model.effects.effect import REGISTRY, BaseAxis, Effect


def class_of(name: str) -> type[Effect] | None:
    """Class of an effect by its name in an axis, such as "cogging_2"; None if unknown."""
    return REGISTRY.get(_split(name)[0])


def title_of(name: str) -> str:
    """Effect in words by its name in an axis; the name itself if it is none."""
    effect = class_of(name)
    number = _split(name)[1]
    if effect is None:
        return name
    return effect.title if number == 1 else f"{effect.title} {number}"


def titles_of(alternative: str) -> str:
    """Names in words of effects that are joined by "+"."""
    return " + ".join(map(title_of, alternative.split("+")))


def renumber_names(names: Iterable[str], taken: str) -> list[str]:
    """Names of parameters as they are once an effect is taken out of the axis."""
    slug, number = _split(taken)
    found = []
    for name in names:
        owner, dot, part = name.partition(".")
        other, k = _split(owner)
        found.append(
            f"{_numbered_name(slug, k - 1)}{dot}{part}" if other == slug and k > number else name
        )
    return found


def next_of_kind(name: str, taken: Collection[str]) -> str:
    """The name, or that of the next effect of its kind which is not taken."""
    slug, number = _split(name)
    while _numbered_name(slug, number) in taken:
        number += 1
    return _numbered_name(slug, number)


def named(axis: BaseAxis) -> dict[str, Effect]:
    """Effects of an axis by name; a field of it, as its Stribeck peak, is the first of its kind."""
    found: dict[str, Effect] = {}
    listed = [effect.slug for effect in axis.effects]
    for cls in REGISTRY.values():
        if cls.axis_field and cls.slug not in listed:
            own = getattr(axis, cls.axis_field)
            if own is not None:
                found[cls.slug] = cls(*(getattr(own, item.name) for item in fields(cls)))
    return found | dict(zip(_effect_names(axis), axis.effects, strict=True))


def with_named(axis: Any, changed: dict[str, Effect], **changes: Any) -> Any:
    """The axis with other numbers in some of its effects, in their order, and in its fields."""
    names = dict(zip(_effect_names(axis), axis.effects, strict=True))
    for name, effect in changed.items():
        if name not in names:
            axis = effect.alter(axis)
    if not names.keys().isdisjoint(changed):
        changes["effects"] = tuple(changed.get(n, e) for n, e in names.items())
    return axis.replace(**changes) if changes else axis


def put(axis: Any, name: str, effect: Effect | None) -> Any:
    """The axis with an effect in place of the named one, or behind all others; None: without it."""
    # An effect that is there keeps its place: a limit before a gain is not one behind it.
    cls = class_of(name)
    assert cls is not None
    names = _effect_names(axis)
    effects = list(axis.effects)
    if cls.axis_field and cls.slug not in names:
        return axis.replace(**{cls.axis_field: None}) if effect is None else effect.alter(axis)
    place = names.index(name) if name in names else len(names)
    effects[place : place + 1] = [] if effect is None else [effect]
    return axis.replace(effects=tuple(effects))


def _effect_names(axis: BaseAxis) -> list[str]:
    """Names of the effects in the list of an axis, in its order."""
    slugs = [effect.slug for effect in axis.effects]
    return [_numbered_name(slug, slugs[: i + 1].count(slug)) for i, slug in enumerate(slugs)]


def _split(name: str) -> tuple[str, int]:
    """Slug and number, from 1."""
    slug, _, number = name.rpartition("_")
    return (slug, int(number)) if slug and number.isdecimal() else (name, 1)


def _numbered_name(slug: str, number: int) -> str:
    """Name of the first, second, ... of a kind."""
    return slug if number == 1 else f"{slug}_{number}"
