"""What the observer remembers of past modes, and how bad switching can get.

A node of the graph is a memory state; its label is the present mode class.  When the next mode
arrives the observer moves along an edge, which a node and the next mode fix.  Gains and Lyapunov
matrices are indexed by node.

Recursions on the largest reachable error: with a design's own gains for the true gain of that
design along a sequence of modes; with the best gain at every sample for that of any observer.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from dryfric_control.arrays import Floats
from dryfric_control.compiled.cached import njit
from dryfric_control.observer.error_model import ErrorModel
from dryfric_control.ties import stable_order


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


#: Relative width at which a bisection on gamma stops.
WIDTH = 2e-5
#: Longest sequence tried, in samples; stopping early only lowers the bound.
LONGEST = 20_000
#: Relative width while a search only ranks sequences.
COARSE = 1e-3
#: Longest sequence tried then [samples].
SHORT = 2_000
#: Rounds of changes to the best sequence.
ROUNDS = 3


@njit(cache=True, error_model="numpy")
def _grow(S, Z, level):  # type: ignore[no-untyped-def]
    """``(S^-1 - Z'Z / level)^-1`` in place; False if that is not positive."""
    s = np.empty(3)
    for k in range(Z.shape[0]):
        for i in range(3):
            s[i] = S[i, 0] * Z[k, 0] + S[i, 1] * Z[k, 1] + S[i, 2] * Z[k, 2]
        rest = level - (Z[k, 0] * s[0] + Z[k, 1] * s[1] + Z[k, 2] * s[2])
        if rest <= 0.0:
            return False
        for i in range(3):
            for j in range(3):
                S[i, j] += s[i] * s[j] / rest
    return True


@njit(cache=True, error_model="numpy")
def _move(S, F, N, out):  # type: ignore[no-untyped-def]
    """out = F S F' + N."""
    for i in range(3):
        for j in range(i, 3):
            total = N[i, j]
            for k in range(3):
                row = S[k, 0] * F[j, 0] + S[k, 1] * F[j, 1] + S[k, 2] * F[j, 2]
                total += F[i, k] * row
            out[i, j] = total
            out[j, i] = total


@njit(cache=True, error_model="numpy")
def _correct(S, noise):  # type: ignore[no-untyped-def]
    """Correction by a reading of the first state, with the best gain."""
    power = S[0, 0] + noise * noise
    if power > 0.0:
        column = S[0, 0], S[1, 0], S[2, 0]
        for i in range(3):
            for j in range(3):
                S[i, j] -= column[i] * column[j] / power


class _Game(NamedTuple):
    """One of the two recursions: arrays with a row for each place that a word may name."""

    F: Floats  # shape (n, 3, 3)
    N: Floats  # shape (n, 3, 3)
    Z: Floats  # shape (n, nz, 3)
    noise: Floats  # of the readings, shape (n,)
    # Whether each step corrects by the best gain: after its error counts (1, a predicting
    # observer), before (2), or not (0).
    best: int


@njit(cache=True, error_model="numpy")
def _exceeds(game, word, gamma, longest):  # type: ignore[no-untyped-def]
    """Whether some disturbance along the repeated word, places in `game`, beats `gamma`."""
    S = np.zeros((3, 3))
    out = np.empty((3, 3))
    before = np.zeros(3)
    level = gamma * gamma
    place = 0
    for _ in range(longest):
        i = word[place]
        if game.best == 2:
            _correct(S, game.noise[i])
        if not _grow(S, game.Z[i], level):
            return True
        if game.best == 1:
            _correct(S, game.noise[i])
        _move(S, game.F[i], game.N[i], out)
        S, out = out, S
        place += 1
        if place == word.size:
            place = 0
            still = True
            for i in range(3):
                if abs(S[i, i] - before[i]) > 1e-10 * S[i, i]:
                    still = False
                before[i] = S[i, i]
            if still:
                return False
    return False


@njit(cache=True, error_model="numpy")
def _gain_along(game, word, low, high, width, longest):  # type: ignore[no-untyped-def]
    """Largest gamma in [low, high] that is provably exceeded, else `low`."""
    if not _exceeds(game, word, low, longest):
        return low
    while high > low * (1.0 + width):
        middle = math.sqrt(low * high)
        if _exceeds(game, word, middle, longest):
            low = middle
        else:
            high = middle
    return low


def _recursion(
    at: list[ErrorModel],
    moved: list[tuple[Floats, Floats]],
    noise: list[float],
    best: int,
) -> _Game:
    """Recursion with an error model, and how it moves error and disturbances, for each place."""
    F = np.array([f for f, _ in moved])
    N = np.array([g @ g.T for _, g in moved])
    return _Game(F, N, np.array([model.Z for model in at]), np.array(noise), best)


def _best_recursion(
    models: Mapping[int, ErrorModel],
) -> tuple[list[int], _Game]:
    """Names of the places, and the recursion with the best gain."""
    keys = sorted(models)
    at = [models[key] for key in keys]
    moved = [(model.A, model.W) for model in at]
    return keys, _recursion(
        at,
        moved,
        [model.noise for model in at],
        2 if at[0].current else 1,
    )


def best_gain(models: Mapping[int, ErrorModel], word: tuple[int, ...]) -> float:
    """Gain no observer can be below when the modes repeat `word`."""
    # Riccati recursion of the optimal H-infinity filter from a zero initial error (Hassibi, Sayed
    # and Kailath, SIAM 1999); a breakdown within finitely many samples makes the bound strict.
    keys, game = _best_recursion(models)
    place = np.array([keys.index(key) for key in word])
    high = 1.0
    while _exceeds(game, place, high, LONGEST):
        high *= 2.0
    low = high
    while not _exceeds(game, place, low, LONGEST):
        low /= 2.0
        if low < 1e-12 * high:
            return 0.0
    return float(_gain_along(game, place, low, high, WIDTH, LONGEST))


def _mode_sequences(graph: ModeGraph) -> Iterator[tuple[int, ...]]:
    """Constant modes, then runs of one mode between short runs of another."""
    keys = sorted(set(graph.labels))
    pairs = {(graph.labels[i], graph.labels[j]) for i, j in graph.edges}
    for key in keys:
        yield (key,)
    lengths = list(itertools.product((1, 2, 3, 5), (1, 2, 4, 8, 12, 16, 24, 32, 48)))
    for first, second in itertools.combinations(keys, 2):
        if {(first, second), (second, first)} <= pairs:
            for short, long in lengths:
                yield (first,) * short + (second,) * long
                if short < long:
                    yield (first,) * long + (second,) * short


def runs_of(word: tuple[int, ...]) -> list[tuple[int, int]]:
    """Each run of one mode in a sequence, with its length."""
    return [(key, len(list(run))) for key, run in itertools.groupby(word)]


def _neighbours(word: tuple[int, ...]) -> Iterator[tuple[int, ...]]:
    """Words with one run a little longer or shorter, or doubled up."""
    runs = runs_of(word)
    for k, (key, length) in enumerate(runs):
        for change in (-4, -2, -1, 1, 2, 4):
            if length + change > 0:
                changed = [
                    *runs[:k],
                    (key, length + change),
                    *runs[k + 1 :],
                ]
                yield tuple(mode for mode, count in changed for _ in range(count))


def path_of(graph: ModeGraph, word: tuple[int, ...]) -> list[int] | None:
    """Nodes visited once the word has repeated often enough to settle."""
    following = graph.next_nodes()
    node = graph.resting()[word[-1]]
    seen: list[list[int]] = []
    while True:
        path = []
        for key in word:
            step = following.get((node, key))
            if step is None:
                return None
            node = step
            path.append(node)
        if path in seen:
            # a cycle of several words: take all of it
            return [n for part in seen[seen.index(path) :] for n in part]
        seen.append(path)


def _search(
    game: _Game,
    words: Iterator[tuple[int, ...]],
    places: Callable[[tuple[int, ...]], list[int] | None],
    best: float,
    worst: tuple[int, ...],
    high: float,
) -> tuple[float, tuple[int, ...]]:
    """Word with the largest gain in [best, high]: the words given, then changes to the winner."""
    tried: set[tuple[int, ...]] = set()

    def is_worse(word: tuple[int, ...]) -> bool:
        nonlocal best, worst
        if word in tried:
            return False
        tried.add(word)
        path = places(word)
        if path is None:
            return False
        low = best * (1.0 + COARSE)
        place = np.array(path)
        if not _exceeds(game, place, low, SHORT):
            return False
        best = float(_gain_along(game, place, low, high, COARSE, SHORT))
        worst = word
        return True

    for word in words:
        is_worse(word)
    for _ in range(ROUNDS):
        if not any([is_worse(word) for word in _neighbours(worst)]):
            break
    place = np.array(places(worst), dtype=np.int64)
    return float(_gain_along(game, place, best, high, WIDTH, LONGEST)), worst


def worst_switching(
    models: Mapping[int, ErrorModel],
    graph: ModeGraph,
    gains: Floats,
    high: float,
) -> tuple[float, tuple[int, ...]]:
    """Gain of given gains on the worst sequence found, a lower bound, and the sequence."""
    steps = {edge: place for place, edge in enumerate(graph.edges)}
    at = [models[graph.labels[i]] for i, _ in graph.edges]
    closed = [
        model.closed_loop(gains[model.node(i, j)])
        for model, (i, j) in zip(at, graph.edges, strict=True)
    ]
    game = _recursion(at, closed, [0.0] * len(closed), 0)

    def places(word: tuple[int, ...]) -> list[int] | None:
        path = path_of(graph, word)
        if path is None:
            return None
        return [steps[step] for step in zip(path, path[1:] + path[:1], strict=True)]

    start = (graph.labels[0],)
    return _search(game, _mode_sequences(graph), places, 1e-9 * high, start, high)


def hardest_switching(
    models: Mapping[int, ErrorModel], graph: ModeGraph, high: float
) -> tuple[float, tuple[int, ...]]:
    """Gain that no causal observer is below on the hardest sequence found, and the sequence."""
    keys, game = _best_recursion(models)
    alone = {key: best_gain(models, (key,)) for key in models}
    start = list(alone)[stable_order([-gain for gain in alone.values()])[0]]

    def places(word: tuple[int, ...]) -> list[int] | None:
        allowed = path_of(graph, word) is not None
        return [keys.index(key) for key in word] if allowed else None

    if alone[start] == 0.0:
        return 0.0, (start,)
    found, word = _search(game, _mode_sequences(graph), places, alone[start], (start,), high)
    return max(found, alone[start]), word
