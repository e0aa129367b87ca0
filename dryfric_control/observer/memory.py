"""What the observer remembers of past modes, as a graph.

A node is a memory state; its label is the present mode class.  When the next mode arrives the
observer moves along an edge, which a node and the next mode fix.  Gains and Lyapunov matrices are
indexed by node.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from dataclasses import dataclass

from dryfric_control.observer.error_model import STICK

#: Longest remembered run of sticking, present and previous, in samples: with
#: usual decay rates the remaining velocity is gone after that many.
PRESENT_STICK, PREVIOUS_STICK = 4, 2


@dataclass(frozen=True)
class ModeGraph:
    """Deterministic graph of memory states."""

    labels: tuple[int, ...]  # mode class of each node
    edges: tuple[tuple[int, int], ...]  # allowed steps
    names: tuple[str, ...]  # what each node remembers

    def next_nodes(self) -> dict[tuple[int, int], int]:
        """Next node by (node, class of the next mode)."""
        return {(i, self.labels[j]): j for i, j in self.edges}

    def resting(self) -> dict[int, int]:
        """Node of each class after the mode has lasted for long."""
        return {self.labels[i]: i for i, j in self.edges if i == j}


def allowed_pairs(
    classes: dict[int, int], pairs: Iterable[tuple[int, int]] | None
) -> set[tuple[int, int]]:
    """Pairs of classes that may follow each other."""
    if pairs is None:
        keys = set(classes.values())
        return {(a, b) for a in keys for b in keys}
    if not isinstance(pairs, Iterable):
        raise ValueError(f"pairs must hold changes of mode like (0, 1), got {pairs!r}")
    result = {(key, key) for key in classes.values()}
    for pair in pairs:
        try:
            first, second = pair
            result.add((classes[first], classes[second]))
        except (TypeError, ValueError, KeyError):
            raise ValueError(
                f"pairs must hold changes of mode like (0, 1), with modes 0, 1, -1; got {pair!r}"
            ) from None
    return result


def window_graph(pairs: set[tuple[int, int]], length: int) -> ModeGraph:
    """Memory of the last `length` modes, the present one included."""
    keys = sorted({a for a, _ in pairs})
    every = itertools.product(keys, repeat=length)
    words = [word for word in every if pairs.issuperset(itertools.pairwise(word))]
    index = {word: k for k, word in enumerate(words)}
    following = itertools.product(words, keys)
    edges = [(index[w], index[(*w, key)[1:]]) for w, key in following if (w[-1], key) in pairs]
    names = tuple(",".join(map(str, word)) for word in words)
    return ModeGraph(tuple(word[-1] for word in words), tuple(edges), names)


def dwell_graph(pairs: set[tuple[int, int]], longest: int) -> ModeGraph:
    """Memory of how long the present and the previous mode have lasted.

    Sliding is counted up to `longest` samples, sticking up to a few.
    """
    keys = sorted({a for a, _ in pairs})
    present = {key: min(longest, PRESENT_STICK) if key == STICK else longest for key in keys}
    previous = {key: min(longest, PREVIOUS_STICK) if key == STICK else longest for key in keys}
    into = sorted((key, before) for before, key in pairs if key != before)
    nodes = [
        (key, age, before, length)
        for key, before in into
        for age in range(1, present[key] + 1)
        for length in range(1, previous[before] + 1)
    ]
    # a mode nothing leads to can still be the first one
    entered = {node[0] for node in nodes}
    nodes += [(k, a, k, 0) for k in keys if k not in entered for a in range(1, present[k] + 1)]
    index = {node: k for k, node in enumerate(nodes)}
    edges = []
    for (key, age, before, length), k in index.items():
        edges.append((k, index[key, min(age + 1, present[key]), before, length]))
        lasted = min(age, previous[key])
        edges += [(k, index[other, 1, key, lasted]) for other, left in into if left == key]
    names = tuple(f"{key} for {age} after {before} for {n}" for key, age, before, n in nodes)
    return ModeGraph(tuple(node[0] for node in nodes), tuple(edges), names)
