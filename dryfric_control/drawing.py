"""What every figure of the package shares: axes, bands, the object it returns."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any

import control as ct
import matplotlib.pyplot as plt
import numpy as np
from numpy.typing import ArrayLike, NDArray

from dryfric_control.checks import positive, string
from dryfric_control.text import rotary_words, typeset_signs

#: Label of an axis of time, in the spelling of python-control.
TIME_LABEL = "Time [s]"
#: Grey of measured dots and lines.
MEASURED = "0.6"
#: Light band behind the time at rest.
STUCK_COLOUR = "0.9"
#: Dashes that distinguish lines in grey.
DASHES = ("-", "--", "-.", ":", (0, (7, 2, 1, 2, 1, 2)))

#: Time before which estimates, off by far more than later, are left out of the scale [s].
_START = 0.1

# Font size of the widths below [pt].
_FONT = 10.0
# Width of a letter of a title [pt].
_LETTER = 6.5
# Width of a letter of a legend [pt].
_SMALL_LETTER = 4.6
# Width of a legend's handle [pt].
_HANDLE = 32.0
# Height of a legend of one row [pt].
_LEGEND = 20.0
# Most columns of a legend.
_MOST_COLUMNS = 6

# Widths of one and of two columns of a journal [in], and the font size of its captions [pt].
_COLUMN = 3.5
_TWO_COLUMNS = 7.16
_CAPTION = 8.0
# Height of a figure over its width, where a plot does not ask for another.
_SHAPE = 0.62
# Least height of one panel, its legend included, and of the axis below [in].
_PANEL = 1.15
_BELOW = 0.45
_JOURNAL: dict[str, Any] = {
    "savefig.dpi": 600.0,
    "font.size": _CAPTION,
    "axes.titlesize": _CAPTION,
    "axes.labelsize": _CAPTION,
    "axes.linewidth": 0.6,
    "lines.linewidth": 1.0,
    "lines.markersize": 3.0,
    "pdf.fonttype": 42,
    "ps.fonttype": 42,
}
# Width that new figures are to have for a journal [in], None for their own.
_journal_width: ContextVar[float | None] = ContextVar("journal_width", default=None)


class PanelPlot(ct.ControlPlot):
    """A `control.ControlPlot` of panels whose title stands above the first one."""

    def set_plot_title(self, title: str, frame: str = "axes") -> None:
        """Replace the title above the first panel, or, of frame "figure", that of the figure."""
        string("title", title)
        # python-control calls `tight_layout`, which ends the constrained layout.
        if frame == "figure":
            self.figure.suptitle(title)
        elif frame == "axes":
            title_above(self.axes[0, 0], title)
        else:
            raise ValueError(f'frame must be "axes" or "figure", got {frame!r}')


def axes_of(ax: Any, rows: int, title: str | None = None, **options: Any) -> NDArray[Any]:
    """Axes to draw in, shape (rows,): the given ones, or those of a new figure.

    The title is looked at and not drawn, so that no figure is made in vain.
    """
    if title is not None:
        string("title", title)
    if ax is None:
        settings: dict[str, Any] = {
            "sharex": True,
            "figsize": (7.0, 1.2 + 1.6 * rows),
            "layout": "constrained",
        }
        settings |= options
        if (width := _journal_width.get()) is not None:
            own_width, own_height = settings["figsize"]
            height = max(own_height * width / own_width, _BELOW + _PANEL * rows)
            settings["figsize"] = width, height
        _, made = plt.subplots(rows, 1, squeeze=False, **settings)
        return np.asarray(made).ravel()
    given = np.atleast_1d(np.asarray(ax, dtype=object)).ravel()
    if given.size != rows:
        raise ValueError(f"ax must hold {rows} axes, one for each row, got {given.size}")
    for one in given:
        if not hasattr(one, "plot"):
            raise ValueError(f"ax must hold matplotlib Axes, got {one!r}")
    return given


def control_plot(axes: NDArray[Any]) -> PanelPlot:
    """What was drawn, as python-control returns it, its labels typeset."""
    lines = np.empty((axes.size, 1), dtype=object)
    for i, one in enumerate(axes):
        lines[i, 0] = list(one.lines)
        legend = one.get_legend()
        unit = one.get_ylabel()
        names = [] if legend is None else legend.get_texts()
        for label in (one.yaxis.label, *names):
            label.set_text(rotary_words(label.get_text(), unit))
        for label in (one.xaxis.label, one.yaxis.label):
            label.set_text(typeset_signs(label.get_text()))
    return PanelPlot(lines, axes.reshape(-1, 1), axes[0].figure)


_COUNTED = {2: "two", 3: "three", 4: "four"}
_ARGUMENTS = """

Parameters
----------
ax : {what}, optional
    Where to draw.  Default: a new figure.
title : str, optional
    Title.  Default: one that names the result.

Returns
-------
control.ControlPlot
"""


def panels(
    rows: int | Callable[[Any], int], **options: Any
) -> Callable[[Callable[..., str]], Callable[..., PanelPlot]]:
    """Make the `plot` of a result out of a method that draws in axes and returns its title."""

    def make_plot(draw: Callable[..., str]) -> Callable[..., PanelPlot]:
        def plot(self: Any, ax: Any = None, title: str | None = None) -> PanelPlot:
            axes = axes_of(ax, rows(self) if callable(rows) else rows, title, **options)
            own = draw(self, axes)
            title_above(axes[0], own if title is None else title)
            return control_plot(axes)

        # Not functools.wraps, whose signature would be that of `draw`.
        plot.__module__, plot.__qualname__ = draw.__module__, draw.__qualname__
        count = "" if callable(rows) else f"{_COUNTED.get(rows)} "
        what = "Axes" if rows == 1 else f"sequence of {count}Axes"
        plot.__doc__ = inspect.cleandoc(draw.__doc__ or "") + _ARGUMENTS.format(what=what)
        return plot

    return make_plot


def shade_stuck(ax: Any, time: ArrayLike, mode: ArrayLike, label: str | None = "stuck") -> None:
    """Lay a light band behind the time at rest, mode 0."""
    look = {"color": STUCK_COLOUR, "linewidth": 0, "step": "post", "zorder": 0}
    place = ax.get_xaxis_transform()
    at_rest = np.asarray(mode) == 0
    ax.fill_between(np.asarray(time), 0.0, 1.0, where=at_rest, transform=place, label=label, **look)


def over_time(axes: Any, names: Sequence[str] = ()) -> None:
    """Label the axes of signals over time from top to bottom, and leave no room beside them."""
    for one, name in zip(axes, names, strict=False):
        one.set_ylabel(name)
    for one in axes:
        one.margins(x=0.0)
    axes[-1].set_xlabel(TIME_LABEL)


def settled_scale(ax: Any, t: Any, *signals: Any) -> None:
    """Fit the scale to what comes after the start, and state what of the start it cuts off."""
    late = t >= _START
    if late.any():
        low = min(float(one[late].min()) for one in signals)
        high = max(float(one[late].max()) for one in signals)
        room = 0.06 * (high - low) or 1.0
        ax.set_ylim(low - room, high + room)
        for end, bound in ((np.min, low - room), (np.max, high + room)):
            extreme = float(end([end(one) for one in signals]))
            if (extreme - bound) * (bound - 0.5 * (low + high)) > 0.0:
                ax.text(
                    0.01, 0.04 if end is np.min else 0.96,
                    f"off the scale at the start: {extreme:.3g}",
                    transform=ax.transAxes, ha="left", va="bottom" if end is np.min else "top",
                    fontsize="x-small", bbox={"fc": "w", "ec": "none", "alpha": 0.8, "pad": 1.0},
                )  # fmt: skip


def legend_above(ax: Any) -> None:
    """Put the legend above the axes, where it hides no data, in as many rows as it needs."""
    # A legend wider than the axes would squeeze them where the layout is constrained.
    scale = float(plt.rcParams["font.size"]) / _FONT
    names = ax.get_legend_handles_labels()[1]
    widths = [scale * (_HANDLE + _SMALL_LETTER * len(name)) for name in names]
    look = {"fontsize": "small", "frameon": False, "markerscale": 2.0, "borderaxespad": 0.1}
    columns = _columns(widths, 72.0 * ax.bbox.width / ax.figure.dpi)
    ax.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=columns, **look)


def label_axes(ax: Any, x: str = "", y: str = "", legend: bool = True) -> None:
    """Label the axes where a label is given, and put the legend above them."""
    if x:
        ax.set_xlabel(x)
    if y:
        ax.set_ylabel(y)
    if legend:
        legend_above(ax)


def _columns(widths: Sequence[float], room: float) -> int:
    """Most columns in which a legend, filled column by column, fits into the room."""
    for columns in range(min(len(widths), _MOST_COLUMNS), 1, -1):
        rows = -(-len(widths) // columns)
        if sum(max(widths[i : i + rows]) for i in range(0, len(widths), rows)) <= room:
            return columns
    return 1


def title_above(ax: Any, title: str) -> None:
    """Put a title at the left, above the legend if both do not fit in one line."""
    if _journal_width.get() is not None:
        return
    legend = ax.get_legend()
    needed = _LETTER * len(title)
    rows = 1
    names = [] if legend is None else [text.get_text() for text in legend.get_texts()]
    if names:
        needed += sum(_HANDLE + _SMALL_LETTER * len(name) for name in names)
        rows = -(-len(names) // legend._ncols)
    room = 72.0 * ax.bbox.width / ax.figure.dpi
    above = bool(names) and (needed > room or rows > 1)
    ax.set_title(title, loc="left", pad=_LEGEND * (0.3 + 0.7 * rows) if above else None)


@contextmanager
def journal(columns: int = 1, width: float | None = None) -> Iterator[None]:
    """Style of figures for a journal, in a ``with`` statement.

    It stands around `plot`: a new figure then has the width of a column and fonts of the size of a
    caption, embedded as TrueType, and no title, whose place is the caption.  The report of a
    diagnosis keeps its size.

    Parameters
    ----------
    columns : {1, 2}, optional
        Columns that the figure spans: 3.5 or 7.16 inches, as the IEEE has them.
    width : float, optional
        Another width [in].

    Returns
    -------
    context manager

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    >>> with dfc.drawing.journal():
    ...     figure = axis.plot_friction().figure
    >>> float(figure.get_figwidth())
    3.5
    """
    if columns not in (1, 2):
        raise ValueError(f"columns must be 1 or 2, got {columns!r}")
    inches = _COLUMN if columns == 1 else _TWO_COLUMNS
    if width is not None:
        inches = positive("width", width, unit="in")
    small = _CAPTION - 1.0
    styles = dict(_JOURNAL)
    styles |= {"figure.figsize": (inches, _SHAPE * inches), "legend.fontsize": small}
    styles |= {"xtick.labelsize": small, "ytick.labelsize": small}
    before = _journal_width.set(inches)
    try:
        with plt.rc_context(styles):
            yield
    finally:
        _journal_width.reset(before)
