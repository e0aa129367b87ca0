"""What every figure of the package shares: axes, bands, the object it returns."""

from __future__ import annotations

from typing import Any

import control as ct
import numpy as np
from numpy.typing import ArrayLike, NDArray

#: Light band behind the time at rest.
STUCK_COLOUR = "0.9"


def axes_of(ax: Any, rows: int, **options: Any) -> NDArray[Any]:
    """Axes to draw in: the given ones, or those of a new figure.

    Parameters
    ----------
    ax : Axes, sequence of Axes, or None
        Axes given by the user; None makes a figure.
    rows : int
        Number of axes needed, one above the other.
    **options
        For `matplotlib.pyplot.subplots`.

    Returns
    -------
    ndarray of Axes, shape (rows,)

    Raises
    ------
    ValueError
        If fewer or more axes are given than needed.
    """
    if ax is None:
        import matplotlib.pyplot as plt

        settings = {"sharex": True, "figsize": (7.0, 1.2 + 1.6 * rows), "layout": "constrained"}
        _, made = plt.subplots(rows, 1, squeeze=False, **(settings | options))
        return np.asarray(made).ravel()
    given = np.atleast_1d(np.asarray(ax, dtype=object)).ravel()
    if given.size != rows:
        raise ValueError(f"ax must hold {rows} axes, one for each row, got {given.size}")
    for one in given:
        if not hasattr(one, "plot"):
            raise ValueError(f"ax must hold matplotlib Axes, got {one!r}")
    return given


def control_plot(axes: NDArray[Any]) -> ct.ControlPlot:
    """What was drawn, as python-control returns it.

    Parameters
    ----------
    axes : ndarray of Axes, shape (rows,)
        The axes drawn in.

    Returns
    -------
    control.ControlPlot
        Lines, axes and figure.
    """
    lines = np.empty(axes.shape, dtype=object)
    for i, one in enumerate(axes):
        lines[i] = list(one.lines)
    return ct.ControlPlot(lines, axes, axes[0].figure)


def shade_stuck(ax: Any, time: ArrayLike, mode: ArrayLike, label: str | None = "stuck") -> None:
    """Lay a light band behind the time at rest.

    Parameters
    ----------
    ax : Axes
        Where to draw.
    time : array_like, shape (n,)
        Time [s].
    mode : array_like, shape (n,)
        Mode, 0 while stuck.
    label : str or None
        Legend entry.
    """
    ax.fill_between(
        np.asarray(time),
        0.0,
        1.0,
        where=np.asarray(mode) == 0,
        transform=ax.get_xaxis_transform(),
        color=STUCK_COLOUR,
        linewidth=0,
        step="post",
        label=label,
        zorder=0,
    )


def legend_above(ax: Any) -> None:
    """Put the legend above the axes, where it hides no data.

    Parameters
    ----------
    ax : Axes
        Axes whose labelled artists are listed.
    """
    ax.legend(
        loc="lower right",
        bbox_to_anchor=(1.0, 1.0),
        ncols=6,
        fontsize="small",
        frameon=False,
        borderaxespad=0.1,
    )
