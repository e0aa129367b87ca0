"""Pictures of what the benchmarks print, for their option ``--plot FILE``."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.text import Text
from matplotlib.transforms import Bbox

from dryfric_control.model.effects.naming import title_of


def _words(answer: str) -> str:
    """A hidden or named cause as a reader calls it; of several the first, and how many more."""
    slug, _, more = answer.partition("+")
    return title_of(slug) + (f" and {more} more" if more else "")


def confusion(
    answers: Sequence[tuple[str, str]], truths: Sequence[str], title: str, path: Path
) -> None:
    """Confusion matrix: what was hidden, what was named.

    Parameters
    ----------
    answers : sequence of (str, str)
        Hidden and named cause of each record.
    truths : sequence of str
        Hidden causes, in the order of the rows; named ones that are none of
        them come last.
    title : str
        What was run.
    path : Path
        Picture to write.
    """
    import matplotlib.pyplot as plt

    count = Counter(answers)
    rows = [what for what in truths if any(hidden == what for hidden, _ in count)]
    named = {one for _, one in count}
    # What is no effect comes last; a record without one should end in the first of these.
    others = sorted(named - set(rows), key=lambda one: (one != "nothing to find", one))
    columns = [what for what in rows if what in named] + others
    table = np.array([[count[hidden, name] for name in columns] for hidden in rows])
    size = 1.6 + 0.24 * np.array([len(columns), len(rows)])
    figure, ax = plt.subplots(figsize=tuple(size), layout="constrained")
    share = table / table.sum(axis=1, keepdims=True)
    ax.imshow(np.where(table > 0, 0.15 + 0.85 * share, 0.0), cmap="Blues", vmin=0.0, vmax=1.25)
    for i, j in zip(*np.nonzero(table), strict=True):
        dark = "white" if share[i, j] > 0.6 else "black"
        ax.text(j, i, table[i, j], ha="center", va="center", fontsize=8, color=dark)
    ax.set_xticks(range(len(columns)), map(_words, columns), rotation=90, fontsize=8)
    ax.set_yticks(range(len(rows)), map(_words, rows), fontsize=8)
    ax.set_xticks(np.arange(len(columns)) - 0.5, minor=True)
    ax.set_yticks(np.arange(len(rows)) - 0.5, minor=True)
    ax.grid(which="minor", color="0.9", linewidth=0.5)
    ax.tick_params(which="both", length=0)
    ax.set_xlabel("named by the diagnosis (records)")
    ax.set_ylabel("hidden in the record")
    ax.set_title(title, fontsize=9, loc="left")
    figure.savefig(path, dpi=110)
    plt.close(figure)


def work_precision(
    rows: Sequence[tuple[str, str, float, float]], laws: dict[str, str], path: Path
) -> None:
    """Time against error of every way to simulate one problem.

    Parameters
    ----------
    rows : sequence of (str, str, float, float)
        Name, law, time [s] and error [s]; those without a finite error are left out.
    laws : dict of str to str
        What each law is called in the legend.
    path : Path
        Picture to write.
    """
    import matplotlib.pyplot as plt

    figure, ax = plt.subplots(figsize=(7.5, 6.0), layout="constrained")
    shown = [row for row in rows if np.isfinite(row[3])]
    for i, (law, words) in enumerate(laws.items()):
        for own in (True, False):
            some = [r for r in shown if r[1] == law and r[0].startswith("ours") == own]
            if some:
                ax.loglog(
                    [r[3] for r in some],
                    [1e3 * r[2] for r in some],
                    "*" if own else "osD^v"[i],
                    color=f"C{i}",
                    markersize=13 if own else 6,
                    label=f"{words}{': this package' if own else ''}",
                )
    ax.set_xlabel("largest error of a switching time [s]")
    ax.set_ylabel("processor time for 40 s of stick-slip [ms]")
    ax.grid(which="major", color="0.9")
    ax.margins(x=0.2)
    ax.legend(frameon=False, fontsize=8, loc="upper center", bbox_to_anchor=(0.5, 1.13), ncols=3)
    # The colour says which law; the star that it is this package.
    colours = {law: f"C{i}" for i, law in enumerate(laws)}
    _labels(figure, ax, [(r[3], 1e3 * r[2], _short(r[0]), colours[r[1]]) for r in shown])
    figure.savefig(path, dpi=110)
    plt.close(figure)


def _short(name: str) -> str:
    """A row's name without what colour and star say."""
    words = ("ours", "LuGre", "tanh", "events", "linear")
    return ", ".join(part for part in name.split(", ") if part not in words)


def _labels(figure, ax, points) -> None:
    """Label each point where nothing else stands, with a line where that is farther off."""
    figure.canvas.draw()
    inside, scale = ax.get_window_extent(), figure.dpi / 72.0
    at = ax.transData.transform([point[:2] for point in points])
    taken = [Bbox.from_bounds(x - 5 * scale, y - 5 * scale, 10 * scale, 10 * scale) for x, y in at]
    cores = [one.shrunk(0.7, 0.7) for one in taken]  # what no line crosses
    lines: list[np.ndarray] = []  # points of each line from a label to its mark
    places = [(1, 0, 7), (-1, 0, 7), (0, 1, 8), (0, -1, 8)]
    places += [
        (np.cos(turn), np.sin(turn), far)
        for far in range(16, 160, 8)
        for turn in np.deg2rad(sorted(range(0, 360, 15), key=lambda turn: turn % 90))
    ]
    marks = zip(points, at, taken[: len(points)], cores[: len(points)], strict=True)
    for (x, y, text, colour), mark, own, core in marks:
        for across, up, far in places:
            side = "center" if abs(across) < 0.2 else "left" if across > 0 else "right"
            label = ax.annotate(
                text, (x, y), (across * far, up * far), textcoords="offset points", ha=side,
                va="center", fontsize=7, color=colour,
                arrowprops={"arrowstyle": "-", "lw": 0.5, "color": colour} if far > 8 else None,
            )  # fmt: skip
            label.update_positions(figure.canvas.get_renderer())
            box = Text.get_window_extent(label).padded(1.0)  # without the line
            line = np.linspace(mark, [0.5 * (box.x0 + box.x1), 0.5 * (box.y0 + box.y1)], 60)
            free = not any(box.overlaps(one) for one in taken if one is not own)
            free = free and not any(one.count_contains(line) for one in cores if one is not core)
            free = free and not any(box.count_contains(one) for one in lines)
            if free and inside.containsx(box.x0) and inside.containsx(box.x1):
                taken.append(box)
                cores.append(box)
                lines.append(line)
                break
            label.remove()
