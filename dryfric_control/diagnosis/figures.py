"""The diagnosis on one page, and its panels one by one."""

from __future__ import annotations

import re
import textwrap
from typing import TYPE_CHECKING, Any

import control as ct
import numpy as np
from numpy.typing import NDArray

from dryfric_control.diagnosis.evidence import Evidence, binned, evidence
from dryfric_control.diagnosis.result import summary_lines
from dryfric_control.drawing import axes_of, control_plot, legend_above

if TYPE_CHECKING:
    from dryfric_control.diagnosis.result import Diagnosis

FloatArray = NDArray[np.float64]

GREY = "0.65"
#: Believed axis and axis with the causes: told apart by colour, dash and marker.
BEFORE = {"color": "#D55E00", "linestyle": "--"}
AFTER = {"color": "#0072B2", "linestyle": "-"}
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
# Range of the candidates' bars, at least.
_LEAST_FALL = 0.5


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


def headline(diagnosis: Diagnosis) -> str:
    """Verdict with the names of the causes, in one line."""
    names = [cause.title or cause.effect for cause in diagnosis.causes]
    return f"{diagnosis.verdict}: {', '.join(names)}" if names else diagnosis.verdict


def typeset(text: str) -> str:
    """Plain text with the signs that print has for it."""
    text = text.replace("+-", "\N{PLUS-MINUS SIGN}")
    return re.sub(r"(?<=\d) um\b", " \N{MICRO SIGN}m", text)


def _page(diagnosis: Diagnosis) -> NDArray[Any]:
    import matplotlib.pyplot as plt

    # The first line is the verdict, which the headline says.
    lines = [
        "\n".join(textwrap.wrap(typeset(line), _TEXT_WIDTH, subsequent_indent="     "))
        for line in summary_lines(diagnosis)[1:]
    ]
    text = "\n".join(lines)
    rows = min(text.count("\n") + 1, 14)
    if text.count("\n") + 1 > rows:
        text = "\n".join(text.splitlines()[: rows - 1]) + "\n..."
    head = 0.45 + 0.165 * rows
    figure = plt.figure(figsize=(10.0, 11.2 + head), layout="constrained")
    figure.get_layout_engine().set(h_pad=0.08, w_pad=0.08)
    grid = figure.add_gridspec(5, 1, height_ratios=(head, 2.0, 1.9, 2.2, 4.0))
    title = figure.add_subplot(grid[0])
    title.set_axis_off()
    # Dollar signs are no formulas here.
    words = {"va": "top", "transform": title.transAxes, "parse_math": False, "in_layout": False}
    name = f"{diagnosis.record.name}: " if diagnosis.record.name else ""
    title.text(0.0, 1.0, name + headline(diagnosis), fontsize=13, weight="bold", **words)
    title.text(0.0, 1.0 - 0.33 / head, text, fontsize=8.5, linespacing=1.25, **words)
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
        found = binned(shown.residual, place(shown), bins)
        ax.plot(found.centre, found.median, **style, lw=1.6, label=name)
    if by == "reversal" and np.any(place(before) > 0.0):
        ax.set_xscale("log")
    if before.residual.size:
        # A few wild samples must not flatten the rest.
        low, high = np.quantile(before.residual, [0.005, 0.995])
        room = 0.15 * max(high - low, 1e-12 * max(abs(high), 1e-12))
        ax.set_ylim(low - room, high + room)
    names = {
        "speed": f"speed [{length}/s]",
        "position": f"position [{length}]",
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


def _reversal_bins(since: FloatArray) -> FloatArray | int:
    known = since[np.isfinite(since) & (since > 0.0)]
    if known.size < 10:
        return _BINS
    return np.geomspace(known.min(), known.max() * (1.0 + 1e-9), 15)


def draw_candidates(diagnosis: Diagnosis, ax: Any) -> None:
    """How much every candidate lowers the held-out score as the first cause.

    Parameters
    ----------
    diagnosis : Diagnosis
    ax : Axes
    """
    d = diagnosis
    table = {slug: s for slug, s in d.scores.items() if slug and np.isfinite(s)}
    # Beside the axis with its base parameters fitted, or else the worst of all.
    reference = d.scores.get("", max(table.values(), default=0.0))
    order = sorted(table, key=table.__getitem__)
    rank = {cause.effect: i for i, cause in enumerate(d.causes, start=1)}
    rivals = {slug for cause in d.causes for slug in cause.alternatives} - set(rank)
    labelled: set[str] = set()
    for row, slug in enumerate(order):
        if slug in rank:
            what, style = "named a cause", {"color": AFTER["color"]}
        elif slug in rivals:
            what, style = "alternative", {"color": "#56B4E9", "hatch": "///"}
        else:
            what, style = "other candidate", {"color": "0.8"}
        # An underscore keeps a second one of a kind out of the legend.
        label = f"_{what}" if what in labelled else what
        labelled.add(what)
        fall = reference - table[slug]
        ax.barh(row, fall, height=0.75, edgecolor="white", lw=0.5, label=label, **style)
    ax.set_xlabel("fall of the held-out score as first cause [1]")
    if not order:
        ax.text(0.5, 0.5, "no candidate had to be tried", ha="center", transform=ax.transAxes)
        ax.set_axis_off()
        return
    ax.set_yticks(
        range(len(order)),
        [f"{rank[slug]}. {slug}" if slug in rank else slug for slug in order],
        fontsize=min(8.0, 180.0 / len(order)),
        parse_math=False,
    )
    for tick, slug in zip(ax.get_yticklabels(), order, strict=True):
        tick.set_weight("bold" if slug in rank else "normal")
    ax.axvline(0.0, color="k", lw=0.8)
    ax.set_ylim(len(order) - 0.4, -0.6)
    # Bars that are next to nothing shall look it.
    ax.set_xlim(right=max(ax.get_xlim()[1], _LEAST_FALL))
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
