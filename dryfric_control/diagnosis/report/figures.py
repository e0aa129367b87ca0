"""The diagnosis on one page, and its panels one by one."""

from __future__ import annotations

import re
import textwrap
from typing import TYPE_CHECKING, Any

import control as ct
import numpy as np
from numpy.typing import NDArray

from dryfric_control.diagnosis.evidence import Evidence, binned, evidence
from dryfric_control.diagnosis.report.candidate_bars import FOUND, draw_candidates
from dryfric_control.diagnosis.report.diagnosis import summary_lines
from dryfric_control.diagnosis.report.wording import WAYS, level_table
from dryfric_control.drawing import axes_of, control_plot, legend_above

if TYPE_CHECKING:
    from dryfric_control.diagnosis.report.diagnosis import Diagnosis

FloatArray = NDArray[np.float64]

GREY = "0.65"
#: Believed axis and axis with the causes: told apart by colour, dash and marker.
BEFORE = {"color": "#D55E00", "linestyle": "--"}
AFTER = {"color": FOUND, "linestyle": "-"}
#: What a window was used for, with the grey behind it.
ROLES = ((1, "judge", "0.92"), (2, "measure", "0.80"))
#: What the force residual is drawn against.
AGAINST = ("speed", "position", "time", "reversal")
PANELS = 4 + len(AGAINST)

# Free runs shown in the close-up of the position.
_SHOWN = 5
_TEXT_WIDTH = 132
# Bins of the medians of the force residual.
_BINS = 24
# Letters of the title in a line, its lines, and the causes that it names.
_TITLE_WIDTH, _TITLE_LINES, _NAMED = 76, 2, 2
# Marks of motion forwards and backwards, for those who see no colour.
_MARKS = {1: ">", -1: "<"}
# Name of the lines that the scale of the force must hold.
_MEDIAN = "median"
# Points of the lines of the Coulomb level.
_LEVEL_POINTS = 49


def plot_diagnosis(diagnosis: Diagnosis, ax: Any = None) -> ct.ControlPlot:
    """Draw a diagnosis on one page.

    Parameters
    ----------
    diagnosis : Diagnosis
        What was found.
    ax : sequence of eight Axes, optional
        Where to draw the position, the errors of the free runs, the force
        residual against speed, position, time and time since reversal, the
        candidates and the autocorrelation; a new figure with the verdict in
        words when left out.

    Returns
    -------
    control.ControlPlot

    Raises
    ------
    ValueError
        If another number of axes is given.
    """
    before, after = sides(diagnosis)
    axes = _page(diagnosis) if ax is None else axes_of(ax, PANELS)
    draw_position(diagnosis, before, after, axes[0])
    draw_errors(diagnosis, before, after, axes[1])
    for i, by in enumerate(AGAINST):
        draw_residual(before, after, by, axes[2 + i], legend=i == 0)
    draw_candidates(diagnosis, axes[-2])
    draw_autocorrelation(before, after, axes[-1])
    return control_plot(axes)


def sides(diagnosis: Diagnosis) -> tuple[Evidence, Evidence | None]:
    """Evidence for the axis as believed, and with the causes if there are any."""
    d = diagnosis
    before = evidence(d.axis, d.record, d.window)
    same = d.extended.effective() == d.axis.effective()
    return before, None if same else evidence(d.extended, d.record, d.window)


def headline(diagnosis: Diagnosis, most: int | None = None) -> str:
    """Verdict with the names of the causes, in one line.

    Parameters
    ----------
    diagnosis : Diagnosis
        What was found.
    most : int, optional
        Names given at most; what is left out is counted.

    Returns
    -------
    str
    """
    names = [cause.title or cause.effect for cause in diagnosis.main_causes]
    if not names:
        small = ": small corrections of believed numbers" if diagnosis.causes else ""
        return f"{diagnosis.verdict}{small}"
    shown = ", ".join(names[:most])
    if most is not None and len(names) > most:
        shown += f" and {len(names) - most} more"
    return f"{diagnosis.verdict}: {shown}"


def typeset(text: str) -> str:
    """Plain text with the signs that print has for it."""
    text = text.replace("+-", "\N{PLUS-MINUS SIGN}")
    text = text.replace("->", "\N{RIGHTWARDS ARROW}")
    return re.sub(r"(?<=\d) um\b", " \N{MICRO SIGN}m", text)


def _page(diagnosis: Diagnosis) -> NDArray[Any]:
    import matplotlib.pyplot as plt

    # The first line is the verdict, which the headline says.
    lines = [
        "\n".join(
            textwrap.wrap(
                typeset(line),
                _TEXT_WIDTH,
                subsequent_indent=(10 if line.startswith(" ") else 5) * " ",
            )
        )
        for line in summary_lines(diagnosis)[1:]
    ]
    text = "\n".join(lines)
    rows = min(text.count("\n") + 1, 14)
    if text.count("\n") + 1 > rows:
        text = "\n".join(text.splitlines()[: rows - 1]) + "\n..."
    name = f"{diagnosis.record.name}: " if diagnosis.record.name else ""
    heading = textwrap.wrap(
        name + headline(diagnosis, _NAMED), _TITLE_WIDTH, max_lines=_TITLE_LINES, placeholder=" ..."
    )
    above = 0.08 + 0.25 * len(heading)
    head = 0.12 + above + 0.165 * rows
    figure = plt.figure(figsize=(10.0, 11.2 + head), layout="constrained")
    figure.get_layout_engine().set(h_pad=0.08, w_pad=0.08)
    grid = figure.add_gridspec(5, 1, height_ratios=(head, 2.0, 1.9, 2.2, 4.0))
    title = figure.add_subplot(grid[0])
    title.set_axis_off()
    # Dollar signs are no formulas here.
    words = {"va": "top", "transform": title.transAxes, "parse_math": False, "in_layout": False}
    title.text(0.0, 1.0, "\n".join(heading), fontsize=13, weight="bold", **words)
    title.text(0.0, 1.0 - above / head, text, fontsize=8.5, linespacing=1.25, **words)
    wide = [figure.add_subplot(grid[row]) for row in (1, 2)]
    middle, bottom = grid[3].subgridspec(1, len(AGAINST)), grid[4].subgridspec(1, 2)
    forces: list[Any] = []
    for i in range(len(AGAINST)):
        forces.append(figure.add_subplot(middle[i], sharey=forces[0] if forces else None))
    low = [figure.add_subplot(bottom[i]) for i in range(2)]
    for one in forces[1:]:
        one.tick_params(labelleft=False)
    return np.array([*wide, *forces, *low], dtype=object)


def _runs(shown: Evidence, first: int, last: int) -> tuple[FloatArray, FloatArray]:
    """Times and positions of free runs, with a gap at each restart."""
    edges = shown.windows.edges
    part = slice(edges[first], edges[last])
    gaps = edges[first + 1 : last] - edges[first]
    return (
        np.insert(shown.record.t[part], gaps, np.nan),
        np.insert(shown.positions[part], gaps, np.nan),
    )


def draw_position(diagnosis: Diagnosis, before: Evidence, after: Evidence | None, ax: Any) -> None:
    """Measured position and free runs around the largest error.

    Parameters
    ----------
    diagnosis : Diagnosis
    before, after : Evidence
        Of the axis as believed, and with the causes (None if there are none).
    ax : Axes
    """
    windows, record = before.windows, before.record
    # A typical large error: the very worst may be a single mistimed break-away.
    order = np.argsort(before.error_by_window)
    worst = int(order[round(0.95 * (order.size - 1))])
    first = max(0, min(worst - _SHOWN // 2, len(windows) - _SHOWN))
    last = min(first + _SHOWN, len(windows))
    part = slice(windows.edges[first], windows.edges[last])
    ax.plot(record.t[part], record.x[part], ".", color=GREY, ms=5, label="measured")
    name = "free runs" if after is None else "free runs as believed"
    ax.plot(*_runs(before, first, last), **BEFORE, lw=1.6, label=name)
    if after is not None:
        ax.plot(*_runs(after, first, last), **AFTER, lw=1.2, label="free runs with the causes")
    ax.set_xlabel("Time [s]")
    ax.set_ylabel(f"position [{diagnosis.axis.units[0]}]")
    ax.set_title("close-up", loc="left", fontsize="medium")
    ax.margins(x=0.01)
    legend_above(ax)


def draw_errors(diagnosis: Diagnosis, before: Evidence, after: Evidence | None, ax: Any) -> None:
    """RMS error of every free run, the noise floor, and what it was used for.

    Parameters
    ----------
    diagnosis : Diagnosis
    before, after : Evidence
        Of the axis as believed, and with the causes (None if there are none).
    ax : Axes
    """
    d = diagnosis
    windows = before.windows
    middle = windows.start_times + 0.5 * windows.samples * windows.record.dt
    least = 0.1 * (d.gain.floor if d.gain.floor > 0.0 else float(before.error_by_window.max()))
    ends = np.append(windows.start_times, windows.record.t[-1] + windows.record.dt)
    for role, name, shade in ROLES:
        label: str | None = f"used to {name}"
        for i in np.flatnonzero(d.roles == role):
            ax.axvspan(ends[i], ends[i + 1], color=shade, lw=0, zorder=0, label=label)
            label = None
    # A motionless window has next to no error: it is drawn at the lower edge.
    ax.semilogy(
        middle, np.maximum(before.error_by_window, least), **BEFORE, marker="o", mfc="white",
        ms=3.5, lw=0.9, label="as believed",
    )  # fmt: skip
    if after is not None:
        ax.semilogy(
            middle, np.maximum(after.error_by_window, least), **AFTER, marker="o", ms=3, lw=0.9,
            label="with the causes",
        )  # fmt: skip
    if d.gain.floor > 0.0:
        ax.axhline(d.gain.floor, color="k", lw=1.2, ls=":", label="noise floor (RMS)")
    ax.set_xlim(ends[0], ends[-1])
    ax.set_xlabel("Time [s]")
    ax.set_ylabel(f"RMS error [{d.axis.units[0]}]")
    ax.set_title("free runs", loc="left", fontsize="medium")
    legend_above(ax)


def draw_residual(
    before: Evidence, after: Evidence | None, by: str, ax: Any, legend: bool = True
) -> None:
    """Force residual against speed, position, time or time since reversal.

    Parameters
    ----------
    before, after : Evidence
        Of the axis as believed, and with the causes (None if there are none).
    by : {"speed", "position", "time", "reversal"}
        What to draw it against.
    ax : Axes
    legend : bool, optional
        Whether to draw legend and label of the force.

    Raises
    ------
    ValueError
        If `by` is none of these.
    """
    if by not in AGAINST:
        raise ValueError(f"by must be one of {AGAINST}, got {by!r}")
    length, force = before.axis.units

    def place(shown: Evidence) -> FloatArray:
        return {
            "speed": shown.v,
            "position": shown.x,
            "time": shown.t,
            "reversal": shown.since_reversal,
        }[by]

    ax.plot(
        place(before), before.residual, ".", color=GREY, ms=1.5, rasterized=True,
        label="force missing in the believed axis" if after is not None else "force missing",
    )  # fmt: skip
    ax.axhline(0.0, color="k", lw=0.6)
    bins: FloatArray | int = _BINS
    if by == "reversal":
        bins = _reversal_bins(place(before))
    elif by in ("position", "time"):
        # Narrow ones: wide ones beat with the pitch of cogging, or with a motion.
        bins = max(_BINS, min(10 * _BINS, before.residual.size // 25))
    for shown, style, name in ((before, BEFORE, "its median"), (after, AFTER, "with the causes")):
        if shown is None:
            continue
        if by == "position":
            _draw_both_ways(shown, bins, style, name, ax)
            continue
        found = binned(shown.residual, place(shown), bins)
        ax.plot(found.centre, found.median, **style, lw=1.6, label=name, gid=_MEDIAN)
    if by == "reversal" and np.any(place(before) > 0.0):
        ax.set_xscale("log")
    _fit_force(before, ax)
    names = {
        "speed": f"speed [{length}/s]",
        "position": f"position [{length}]\n(marks: > forwards, < backwards)",
        "time": "Time [s]",
        "reversal": "since reversal [s]",
    }
    ax.set_xlabel(names[by])
    if legend:
        ax.set_ylabel(f"force missing [{force}]")
        # It runs on over the neighbours: room above is kept by an empty title.
        ax.set_title(" ", fontsize="medium")
        ax.legend(
            loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, fontsize="small",
            frameon=False, borderaxespad=0.1, markerscale=4,
        ).set_in_layout(False)  # fmt: skip


def _draw_both_ways(
    shown: Evidence, bins: FloatArray | int, style: dict[str, str], name: str, ax: Any
) -> None:
    """Medians over position, one line for each direction.

    One line for both would jump between their branches.
    """
    for way, _ in WAYS:
        here = shown.v * way > 0.0
        number = max(_BINS, bins // 2) if isinstance(bins, int) else bins
        found = binned(shown.residual[here], shown.x[here], number)
        # An underscore keeps the second one out of the legend.
        label = name if way > 0 else f"_{name} backwards"
        every = max(1, found.centre.size // 6)
        ax.plot(
            found.centre, found.median, **style, lw=1.4, marker=_MARKS[way], ms=5,
            markevery=(every // 2, every), label=label, gid=_MEDIAN,
        )  # fmt: skip


def _fit_force(before: Evidence, ax: Any) -> None:
    """Scale of the force: the dots but the wildest, zero, and every median."""
    seen = [np.zeros(1)]
    if before.residual.size:
        # A few wild samples must not flatten the rest.
        seen.append(np.quantile(before.residual, [0.005, 0.995]))
    for one in ax.get_shared_y_axes().get_siblings(ax):
        seen += [np.asarray(li.get_ydata(), float) for li in one.lines if li.get_gid() == _MEDIAN]
    low, high = float(np.min(np.concatenate(seen))), float(np.max(np.concatenate(seen)))
    room = 0.1 * max(high - low, 1e-12 * max(abs(high), abs(low), 1e-12))
    ax.set_ylim(low - room, high + room)


def _reversal_bins(since: FloatArray) -> FloatArray | int:
    known = since[np.isfinite(since) & (since > 0.0)]
    if known.size < 10:
        return _BINS
    return np.geomspace(known.min(), known.max() * (1.0 + 1e-9), 15)


def draw_levels(diagnosis: Diagnosis, ax: Any) -> None:
    """Coulomb level over the range of the record, as believed and with the causes.

    Parameters
    ----------
    diagnosis : Diagnosis
    ax : Axes
    """
    length, force = diagnosis.axis.units
    table = level_table(diagnosis, _LEVEL_POINTS)
    sides = (("believed", BEFORE, "as believed"), ("found", AFTER, "with the causes"))
    for side, style, name in sides:
        for way, word in WAYS:
            # Marks of the two ways stand side by side where their lines coincide.
            ax.plot(
                table["x"], table[side][word], **style, lw=1.6, marker=_MARKS[way], ms=6,
                markevery=(2 if way > 0 else 5, 9), label=f"{name}, {word}",
            )  # fmt: skip
    most = max(float(np.max(line.get_ydata())) for line in ax.lines)
    ax.set_ylim(0.0, 1.15 * most if most > 0.0 else 1.0)
    ax.margins(x=0.01)
    ax.set_xlabel(f"position [{length}]")
    ax.set_ylabel(f"Coulomb level [{force}]")
    legend_above(ax)


def draw_autocorrelation(before: Evidence, after: Evidence | None, ax: Any) -> None:
    """Autocorrelation of the force residual and the band of white noise.

    Parameters
    ----------
    before, after : Evidence
        Of the axis as believed, and with the causes (None if there are none).
    ax : Axes
    """
    last = before if after is None else after
    ax.fill_between(
        last.lags, -last.white, last.white, color="0.85", lw=0, label="95 % of white noise"
    )
    ax.axhline(0.0, color="k", lw=0.6)
    ax.plot(before.lags, before.autocorrelation, **BEFORE, lw=1.4, label="as believed")
    if after is not None:
        ax.plot(after.lags, after.autocorrelation, **AFTER, lw=1.2, label="with the causes")
    ax.set_ylim(-1.05, 1.05)
    ax.set_xlabel("lag [s]")
    ax.set_ylabel("autocorrelation [1]")
    ax.margins(x=0.0)
    legend_above(ax)
