"""Hints on arguments by a wrong name: which one is meant."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Mapping
from functools import wraps
from typing import Any

from dryfric_control.text import did_you_mean

#: What stands for an argument by what users call it, in lower case; empty where nothing is known.
Hint = Callable[[str], str]

# What users call an argument, in lower case, and names by which a callable may have it.
_OTHER_NAMES = {
    **dict.fromkeys(("fixed", "hold_fixed", "frozen", "held", "trusted"), ("known",)),
    **dict.fromkeys(("vary", "params", "parameters", "estimate"), ("free",)),
    **dict.fromkeys(("velocity", "vs", "v_s", "v"), ("speed",)),
    **dict.fromkeys(("pitch", "wavelength"), ("period",)),
    **dict.fromkeys(("y", "pos", "position", "angle", "q"), ("x",)),
    **dict.fromkeys(("force", "torque", "drive", "input", "inputs", "tau"), ("u",)),
    **dict.fromkeys(("time", "timepts", "t"), ("t", "dt")),
    **dict.fromkeys(("ts", "h", "step", "sampling_time", "sample_time"), ("dt",)),
    **dict.fromkeys(("n_jobs", "workers", "processes", "cores"), ("jobs",)),
    **dict.fromkeys(("timeout", "max_time"), ("time_limit",)),
    **dict.fromkeys(("file", "filename", "fname", "folder"), ("path",)),
}


def unknown_argument(owner: str, name: str, known: Iterable[str], meant: str = "") -> str:
    """Message for an argument that a callable does not have; `meant`: what to give instead."""
    known = tuple(known)
    also = next((one for one in _OTHER_NAMES.get(name.lower(), ()) if one in known), "")
    mend = f": give {meant or f'{also}='}" if meant or also else did_you_mean(name, known)
    return f"{owner} has no argument {name!r}{mend or ', it has ' + ', '.join(known)}"


def unknown_name(module: str, name: str, known: Iterable[str]) -> str:
    """Message for a name that a module does not have."""
    return f"module {module!r} has no attribute {name!r}{did_you_mean(name, known)}"


def function_with_hints(function: Any, owner: str = "", meant: Hint = lambda name: "") -> Any:
    """The function, which names the right argument for a wrong one."""
    asked = inspect.signature(function).parameters
    open_end = any(one.kind is one.VAR_KEYWORD for one in asked.values())
    if open_end or "has_hints" in vars(function):
        return function
    known = tuple(name for name in asked if name not in ("self", "cls"))
    owner = owner or function.__name__

    @wraps(function)
    def call_checked(*args: Any, **given: Any) -> Any:
        for name in given:
            if name not in asked:
                raise TypeError(unknown_argument(owner, name, known, meant(name.lower())))
        return function(*args, **given)

    vars(call_checked)["has_hints"] = True
    return call_checked


def with_argument_hints(cls: type[Any], meant: Hint = lambda name: "") -> type[Any]:
    """The class, which names the right argument for a wrong one."""
    setattr(cls, "__init__", function_with_hints(cls.__init__, cls.__name__, meant))  # noqa: B010
    return cls


def with_method_hints(cls: type[Any]) -> type[Any]:
    """The same of its own public methods."""
    for name, one in list(vars(cls).items()):
        owner = f"{cls.__name__}.{name}"
        if name.startswith("_"):
            continue
        if isinstance(one, classmethod):
            setattr(cls, name, classmethod(function_with_hints(one.__func__, owner)))
        elif inspect.isfunction(one):
            setattr(cls, name, function_with_hints(one, owner))
    return cls


def add_argument_hints(
    space: dict[str, Any], names: Iterable[str], meant: Mapping[str, Hint]
) -> None:
    """Give the public names of a package hints on their arguments, classes with their methods.

    `meant` is by the name of a class, or by that of an argument that a function takes.
    """
    for name in names:
        one = space[name]
        if inspect.isclass(one):
            with_method_hints(with_argument_hints(one, meant.get(name, lambda word: "")))
        elif inspect.isfunction(one):
            takes = inspect.signature(one).parameters
            own = next((meant[word] for word in takes if word in meant), lambda word: "")
            space[name] = function_with_hints(one, meant=own)
            if space[name] is not one:
                space[name].__module__ = space["__name__"]  # where pickle finds it
