"""Numbers in a message or an object, by the path that leads to each."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

_LONGEST = 64  # numbers taken of an array in a message, such as the joints of a robot
_DEEPEST = 8


def numbers(prefix: str, content: Any, depth: int) -> Iterator[tuple[str, float]]:
    """Numbers of a message; those of an array by the names that stand beside it, or by index."""
    if isinstance(content, (int, float)) and not isinstance(content, bool):
        yield prefix, float(content)
    elif depth == _DEEPEST or isinstance(content, (str, bytes, bool, type(None))):
        return
    elif isinstance(content, (Sequence, np.ndarray)):
        for k, value in enumerate(content[:_LONGEST]):
            yield from numbers(f"{prefix}.{k}" if prefix else str(k), value, depth + 1)
    else:
        items = (
            dict(content) if isinstance(content, Mapping)
            else {key: getattr(content, key) for key in getattr(content, "__slots__", ())}
        )  # fmt: skip
        names = items.get("name")
        if not (isinstance(names, (list, tuple)) and all(isinstance(n, str) for n in names)):
            names = ()
        for key, value in items.items():
            path = f"{prefix}.{key}" if prefix else str(key)
            if names and isinstance(value, (Sequence, np.ndarray)) and len(value) == len(names):
                value = dict(zip(names, value, strict=True))
            yield from numbers(path, value, depth + 1)
