"""The diagnosis on one page, and its panels one by one."""

from __future__ import annotations

import textwrap
from typing import Any

import control as ct
import numpy as np
from numpy.typing import NDArray

from dryfric_control.arrays import Bools, Floats
from dryfric_control.diagnosis.evidence import Evidence, bin_values, blind_samples, evidence
from dryfric_control.diagnosis.report import wording
from dryfric_control.diagnosis.report.findings import Findings, plain_number
from dryfric_control.diagnosis.thresholds import MIN_EVIDENCE
from dryfric_control.drawing import TIME_LABEL, axes_of, control_plot, label_axes, legend_above
from dryfric_control.model.effects.naming import title_of
from dryfric_control.model.friction_curve import draw_curve, friction_over_velocity
from dryfric_control.text import prefix_unit, rotary_words, typeset_signs

# Dots of what was measured.
_CLOUD: dict[str, Any] = {"color": "0.65", "ms": 1.5, "rasterized": True}
#: Colour of what was found.
FOUND = "#0072B2"
#: Nominal axis and axis with the causes differ in colour, dash and marker.
BEFORE = {"color": "#D55E00", "linestyle": "--"}
AFTER = {"color": FOUND, "linestyle": "-"}
# Label of a position where lines of both directions are drawn.
_BOTH_WAYS = "position [{length}]\n(marks: > forwards, < backwards)"
#: What the force residual is drawn against: column of the evidence and its label.
AGAINST = {
    "velocity": ("v", "velocity [{length}/s]"),
    "position": ("x", _BOTH_WAYS),
    "time": ("t", TIME_LABEL),
    "reversal": ("since_reversal", "time since reversal [s]"),
}
PANELS = 5 + len(AGAINST)

# Free runs shown in the close-up of the position.
_SHOWN = 5
# Least error for its scale [m].
_LEAST_SHOWN = 1e-7
# Bins of the medians of the force residual.
_BINS = 24
# Against what the bins are narrow, as wide ones beat with the pitch of cogging or with a motion,
# and how many lines of medians share the samples there.
_NARROW = {"position": 2, "time": 1}
# Most candidates that get a bar.
_BARS = 8
# Rows that there is room for at least.
_ROWS = 4
# Most dots of measured friction.
_DOTS = 3000
# Stribeck velocities in a closer look at the peak.
_CLOSER = 8.0
# Part of the width from which on the peak needs no such look.
_WIDE = 0.4
# Marks of motion forwards and backwards, for those who see no colour.
_MARKS = {1: ">", -1: "<"}
# Name of the lines that the scale of the force must hold.
_MEDIAN = "median"
# Marks on the scale of the bars of candidates, as many as there is room for, and its name.
_MARKS_OF_GAIN = (1.0, 2.0, 5.0, 10.0, 30.0, 100.0, 300.0, 1e3, 3e3, 1e4, 1e5, 1e6, 1e7, 1e8)
_MOST_TICKS = 6
_BAR_STYLES = {
    "named a cause": {"color": FOUND},
    "small correction": {"color": "#009E73", "hatch": "..."},
    "alternative": {"color": "#56B4E9", "hatch": "///"},
    "other candidate": {"color": "0.8"},
}
MEASURE = "gain of log-likelihood, one-step predictions"


def plot_diagnosis(d: Findings, ax: Any = None) -> ct.ControlPlot:
    """Draw a diagnosis on one page, or in nine given axes; see `Diagnosis.plot`."""
    before, after = sides(d)
    axes = _page(d) if ax is None else axes_of(ax, PANELS)
    draw_difference(d, before, after, axes[0])
    draw_errors(d, before, after, axes[1])
    for i, by in enumerate(AGAINST):
        draw_residual(before, after, by, axes[2 + i], labels=i == 0, wide=True)
    draw_friction_curves(d, before, after, axes[-3])
    draw_candidates(d, axes[-2])
    draw_autocorrelation(before, after, axes[-1])
    return control_plot(axes)


def sides(d: Findings) -> tuple[Evidence, Evidence | None]:
    """Evidence for the nominal axis, and with the causes if there are any."""
    # Both leave out of the force residual what the causes make no force.
    hide = blind_samples(d.extended, d.record)
    before = evidence(d.axis, d.record, d.window, d.hold, hide)
    same = d.extended.effective() == d.axis.effective()
    return before, None if same else evidence(d.extended, d.record, d.window, d.hold, hide)


def shown_sides(
    before: Evidence, after: Evidence | None, first: str = "nominal"
) -> list[tuple[Evidence, dict[str, Any], str]]:
    """The sides there are, each with its style and its name."""
    both = ((before, BEFORE, first), (after, AFTER, "with the causes"))
    return [(side, style, name) for side, style, name in both if side is not None]


def _page(d: Findings) -> NDArray[Any]:
    import matplotlib.pyplot as plt

    # The first line is the verdict, which the headline says.
    said = wording.summary_lines(d)[1:]
    if d.others:
        said.append(f"curves: {wording.shown_record(d)}")
    text = "\n".join(
        textwrap.fill(typeset_signs(one), 132, subsequent_indent=" " * (10 if one[0] == " " else 5))
        for one in said
    )
    # The page grows with the text: no line is lost.
    rows = text.count("\n") + 1
    names = wording.records_text(d)
    words = (f"{names} \N{EN DASH} " if names else "") + wording.verdict_line(d, most=2)
    heading = textwrap.wrap(words, 76, max_lines=2, placeholder=" ...")
    above = 0.08 + 0.25 * len(heading)
    head = 0.12 + above + 0.165 * rows
    figure = plt.figure(figsize=(10.0, 12.4 + head), layout="constrained")
    figure.get_layout_engine().set(h_pad=0.08, w_pad=0.08)
    grid = figure.add_gridspec(5, 1, height_ratios=(head, 2.0, 1.9, 2.2, 5.2))
    title = figure.add_subplot(grid[0])
    title.set_axis_off()
    # Dollar signs are no formulas here.
    style = {"va": "top", "transform": title.transAxes, "parse_math": False, "in_layout": False}
    title.text(0.0, 1.0, "\n".join(heading), fontsize=13, weight="bold", **style)
    title.text(0.0, 1.0 - above / head, text, fontsize=8.5, linespacing=1.25, **style)
    wide = [figure.add_subplot(grid[row]) for row in (1, 2)]
    middle = grid[3].subgridspec(1, len(AGAINST))
    bottom = grid[4].subgridspec(2, 2)
    forces: list[Any] = []
    for i in range(len(AGAINST)):
        forces.append(figure.add_subplot(middle[i], sharey=forces[0] if forces else None))
    places = (np.s_[0, 0], np.s_[:, 1], np.s_[1, 0])
    low = [figure.add_subplot(bottom[place]) for place in places]
    for one in forces[1:]:
        one.tick_params(labelleft=False)
    return np.array([*wide, *forces, *low], dtype=object)


def draw_difference(
    d: Findings, before: Evidence, after: Evidence | None, ax: Any, nominal: bool = True
) -> None:
    """Simulated - measured position around a large error; with the causes alone on request."""
    windows = before.windows
    record = before.record
    # A typical large error: the very worst may be a single mistimed breakaway.
    order = np.argsort(before.error_by_window)
    worst = int(order[round(0.95 * (order.size - 1))])
    first = max(0, min(worst - _SHOWN // 2, len(windows) - _SHOWN))
    edges = windows.edges[first : min(first + _SHOWN, len(windows)) + 1]
    part = slice(edges[0], edges[-1])
    gaps = edges[1:-1] - edges[0]
    lines = shown_sides(before, after)[0 if nominal else -1 :]
    most = max(float(np.abs(one.errors[part]).max()) for one, _, _ in lines)
    factor, unit = prefix_unit(max(0.1 * max(most, windows.floor), _LEAST_SHOWN), d.axis.units[0])
    for one, style, name in lines:
        error = np.insert(one.errors[part] / factor, gaps, np.nan)
        ax.plot(np.insert(record.t[part], gaps, np.nan), error, **style, lw=1.3, label=name)
    noise = 2.0 * windows.floor / factor
    ax.axhspan(-noise, noise, color="0.85", lw=0, zorder=0, label="± twice the reading noise")
    for k in edges[1:-1]:
        ax.axvline(record.t[k], color="0.6", lw=0.6, ls=":", zorder=0)
    ax.margins(x=0.01)
    label_axes(ax, TIME_LABEL, f"simulated \N{MINUS SIGN} measured [{unit}]")


def draw_friction_curves(d: Findings, before: Evidence, after: Evidence | None, ax: Any) -> None:
    """Friction over velocity, nominal and with the causes, and what was measured."""
    last = after or before
    length, force = d.axis.units
    measured = friction_over_velocity(last.axis, last.v, last.x) - last.residual
    some = slice(None, None, max(1, measured.size // _DOTS))
    # A closer look at a narrow peak fits below the curve.
    fastest = 1.02 * float(np.quantile(np.abs(last.v), 0.998)) if last.v.size else 1.0
    peaks = [one.stribeck for one in (before.axis, last.axis) if one.stribeck]
    near = _CLOSER * max((peak.speed for peak in peaks), default=0.0)
    span = float(d.record.x.min()), float(d.record.x.max())
    panels = [(ax, fastest)]
    if peaks and near < _WIDE * fastest:
        panels += [(ax.inset_axes((0.60, 0.17, 0.35, 0.30)), near)]
    for one, reach in panels:
        label = "measured, net of inertia and other effects"
        one.plot(last.v[some], measured[some], ".", **_CLOUD, label=label)
        for (side, style, name), width in zip(shown_sides(before, after), (1.6, 1.4), strict=False):
            draw_curve(side.axis, one, reach, span, name, lw=width, **style)
        one.axhline(0.0, color="0.7", lw=0.6, zorder=0)
        one.set_xlim(-reach if one is ax else 0.0, reach)
    levels = friction_over_velocity(last.axis, np.array([fastest, -fastest]), np.mean(span))
    ends = np.quantile(measured, [0.003, 0.997]) if measured.size else levels
    seen = np.concatenate((ends, levels))
    room = 0.1 * float(np.ptp(seen))
    ax.set_ylim(seen.min() - room, seen.max() + room)
    for one, _ in panels[1:]:
        v = np.linspace(0.0, near, 99)
        both = [friction_over_velocity(e.axis, v, np.mean(span)) for e in (before, last)]
        one.set_ylim(0.9 * np.min(both), 1.06 * np.max(both))
        # The labels stay clear of the frame around.
        one.tick_params(labelsize="x-small", length=2.0, pad=1.5)
    label_axes(ax, f"velocity [{length}/s]", f"friction [{force}]")


def draw_errors(d: Findings, before: Evidence, after: Evidence | None, ax: Any) -> None:
    """RMS error of every free run, the noise floor, and what it was used for."""
    windows = before.windows
    middle = windows.start_times + 0.5 * windows.samples * windows.record.dt
    least = 0.1 * (d.gain.floor if d.gain.floor > 0.0 else float(before.error_by_window.max()))
    factor, unit = prefix_unit(max(d.gain.floor, least), d.axis.units[0])
    ends = np.append(windows.start_times, windows.record.t[-1] + windows.record.dt)
    judged = np.flatnonzero(d.roles == 1)
    for i in judged:
        # An underscore keeps all but the first out of the legend.
        label = "judged by a fit to the rest, and the rest by a fit to these"
        label = label if i == judged[0] else f"_{label}"
        ax.axvspan(ends[i], ends[i + 1], color="0.92", lw=0, zorder=0, label=label)
    marks: tuple[dict[str, Any], ...] = ({"mfc": "white", "ms": 3.5}, {"ms": 3})
    for (side, style, name), mark in zip(shown_sides(before, after), marks, strict=False):
        # A motionless window has hardly any error: it is drawn at the lower edge.
        error = np.maximum(side.error_by_window, least) / factor
        ax.semilogy(middle, error, **style, **mark, marker="o", lw=0.9, label=name)
    if d.gain.floor > 0.0:
        ax.axhline(d.gain.floor / factor, color="k", lw=1.2, ls=":", label="noise floor (RMS)")
    ax.set_xlim(ends[0], ends[-1])
    label_axes(ax, TIME_LABEL, f"RMS error [{unit}]")


def draw_residual(
    before: Evidence,
    after: Evidence | None,
    by: str,
    ax: Any,
    labels: bool = True,
    wide: bool = False,
) -> None:
    """Force residual against one of `AGAINST`; with `wide` the legend runs over the neighbours."""
    length, force = before.axis.units
    column, name_of_place = AGAINST[by]
    place = getattr(before, column)
    ax.plot(place, before.residual, ".", **_CLOUD, label="force residual, nominal model")
    ax.axhline(0.0, color="k", lw=0.6)
    known = place[np.isfinite(place) & (place > 0.0)]
    bins: Floats | int = _BINS
    if by == "reversal" and known.size >= 10:
        bins = np.geomspace(known.min(), known.max() * (1.0 + 1e-9), 15)
    elif by in _NARROW:
        bins = max(_BINS, min(10 * _BINS, place.size // 25) // _NARROW[by])
    for side, style, name in shown_sides(before, after, "its median"):
        # Over position one line for both directions would jump between their branches.
        for way in (1, -1) if by == "position" else (0,):
            here = side.v * way > 0.0 if way else slice(None)
            found = bin_values(side.residual[here], getattr(side, column)[here], bins)
            # An underscore keeps the second one out of the legend.
            label = f"_{name} backwards" if way < 0 else name
            marks = _median_marks(way, np.isfinite(found.median))
            ax.plot(found.centre, found.median, **style, **marks, label=label, gid=_MEDIAN)
    if by == "reversal" and known.size:
        ax.set_xscale("log")
        ax.set_xticks([], minor=True)
    _fit_force(before, ax)
    name = f"force residual [{force}]" if labels else ""
    label_axes(ax, name_of_place.format(length=length), name, legend=labels and not wide)
    if labels and wide:
        # It runs on over the neighbours: room above is kept by an empty title.
        ax.set_title(" ", fontsize="medium")
        style = {"fontsize": "small", "frameon": False, "borderaxespad": 0.1, "markerscale": 4}
        legend = ax.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, **style)
        legend.set_in_layout(False)


def _median_marks(way: int, shown: Bools) -> dict[str, Any]:
    """Line and marks of a median, shown in some bins; of one for each direction, a few marks."""
    neighbours = np.pad(shown, 1)
    # A bin between two empty ones has no line: it gets a mark.
    marked = shown & ~(neighbours[:-2] | neighbours[2:])
    if way:
        seen = np.flatnonzero(shown)
        every = max(1, seen.size // 6)
        marked[seen[every // 2 :: every]] = True
    marks: dict[str, Any] = {"lw": 1.4, "ms": 5} if way else {"lw": 1.6, "ms": 6}
    return marks | {"marker": _MARKS.get(way, "."), "markevery": marked} if marked.any() else marks


def _fit_force(before: Evidence, ax: Any) -> None:
    """Scale of the force: the dots but the wildest, zero, and every median."""
    seen = [np.zeros(1)]
    if before.residual.size:
        # A few wild samples must not flatten the rest.
        seen.append(np.quantile(before.residual, [0.005, 0.995]))
    for one in ax.get_shared_y_axes().get_siblings(ax):
        seen += [np.asarray(li.get_ydata(), float) for li in one.lines if li.get_gid() == _MEDIAN]
    # A median is NaN where there are too few samples.
    low = float(np.nanmin(np.concatenate(seen)))
    high = float(np.nanmax(np.concatenate(seen)))
    room = 0.1 * max(high - low, 1e-12 * max(abs(high), abs(low), 1e-12))
    ax.set_ylim(low - room, high + room)


def draw_levels(d: Findings, ax: Any) -> None:
    """Coulomb level over the range of the record, nominal and with the causes."""
    length, force = d.axis.units
    table = wording.level_table(d, points=49)
    sides = (("believed", BEFORE, "nominal"), ("found", AFTER, "with the causes"))
    for side, style, name in sides:
        for way, word in wording.WAYS:
            # Marks of the two ways stand side by side where their lines coincide; an
            # underscore keeps the second one out of the legend.
            marks = {"marker": _MARKS[way], "ms": 6, "markevery": (2 if way > 0 else 5, 9)}
            label = name if way > 0 else f"_{name}, {word}"
            ax.plot(table["x"], table[side][word], **style, **marks, lw=1.6, label=label)
    most = max(float(np.max(line.get_ydata())) for line in ax.lines)
    ax.set_ylim(0.0, 1.15 * most if most > 0.0 else 1.0)
    ax.margins(x=0.01)
    ax.locator_params(axis="x", nbins=5)
    label_axes(ax, _BOTH_WAYS.format(length=length), f"Coulomb level [{force}]")


def draw_remaining(d: Findings, ax: Any) -> None:
    """Spectrum of the random force that is left, and its level if it were white."""
    left = d.remaining
    ax.loglog(left.frequency, left.spectrum, color=FOUND, lw=1.4, label="random force left")
    # A force held over each sample is white up to half the sampling rate.
    white = 2.0 * d.record.dt * left.rms**2
    ax.axhline(white, color="k", lw=1.0, ls=":", label="white, of its RMS")
    unit = f"({left.unit})" if " " in left.unit else left.unit
    label_axes(ax, "frequency [Hz]", typeset_signs(f"spectrum [{unit}²/Hz]"))


def draw_autocorrelation(before: Evidence, after: Evidence | None, ax: Any) -> None:
    """Autocorrelation of the force residual and the band of white noise."""
    last = after or before
    band = {"color": "0.85", "lw": 0, "label": "95 % of white noise"}
    ax.fill_between(last.lags, -last.white, last.white, **band)
    ax.axhline(0.0, color="k", lw=0.6)
    for (side, style, name), width in zip(shown_sides(before, after), (1.4, 1.2), strict=False):
        ax.plot(side.lags, side.autocorrelation, **style, lw=width, label=name)
    ax.set_ylim(-1.05, 1.05)
    ax.margins(x=0.0)
    label_axes(ax, "lag [s]", "autocorrelation [1]")


def candidate_gains(d: Findings) -> dict[str, float]:
    """What every candidate gains alone, by id, the most first: `MEASURE`."""
    table = {slug: s for slug, s in d.scores.items() if slug and np.isfinite(s)}
    order = sorted(table, key=table.__getitem__)
    return {slug: wording.gain_of(d, d.scores[""] - table[slug]) for slug in order}


def any_bar(d: Findings) -> bool:
    """Whether a candidate alone does more than chance, where there is something to find."""
    found = d.verdict != "nothing to find"
    return found and max(candidate_gains(d).values(), default=0.0) >= MIN_EVIDENCE


def no_bar_text(d: Findings) -> str:
    """What stands in place of the bars, with the causes that help in combination."""
    text = (
        "No candidate alone gains more than chance over refitting mass, viscous friction and "
        "Coulomb level."
    )
    if not d.scores.keys() & {cause.effect for cause in d.causes} or len(d.causes) < 2:
        return text
    return f"{text} In combination: {' + '.join(cause.title for cause in d.causes)}."


def _kinds(d: Findings) -> dict[str, str]:
    """What each candidate that the diagnosis names is, a key of `_BAR_STYLES`."""
    kinds = {slug: "alternative" for cause in d.causes for slug in cause.alternatives}
    kinds |= {cause.effect: "small correction" for cause in d.small_corrections}
    return kinds | {cause.effect: "named a cause" for cause in d.main_causes}


def _top(d: Findings) -> dict[str, float]:
    """The candidates that are drawn: the best ones, and those that are named."""
    times = candidate_gains(d)
    named = _kinds(d)
    best = [slug for slug, value in times.items() if value >= MIN_EVIDENCE][:_BARS]
    return {slug: value for slug, value in times.items() if slug in best or slug in named}


def others_text(d: Findings) -> str:
    """Candidates without a bar, in one line."""
    top = _top(d)
    hidden = {slug: value for slug, value in candidate_gains(d).items() if slug not in top}
    better = {slug: value for slug, value in hidden.items() if value >= MIN_EVIDENCE}
    next_ones = f"Next, at most {plain_number(max(better.values(), default=0.0))}: "
    rest = [slug for slug in hidden if slug not in better]
    lines = {next_ones: [*better], "No better on their own: ": rest}
    return " ".join(f"{head}{', '.join(map(title_of, s))}." for head, s in lines.items() if s)


def draw_candidates(d: Findings, ax: Any) -> None:
    """What every candidate gains as the only cause."""
    ax.set_xlabel(f"{textwrap.fill(MEASURE, 24)} [1]")
    if not any_bar(d):
        words = "no candidate had to be tried"
        if candidate_gains(d):
            words = textwrap.fill(rotary_words(no_bar_text(d), d.axis.units[1]), 44)
        ax.text(0.5, 0.5, words, ha="center", va="center", transform=ax.transAxes)
        ax.set_axis_off()
        return
    rank = {cause.effect: f"{i}. " for i, cause in enumerate(d.main_causes, start=1)}
    kinds = _kinds(d)
    named = set()
    times = _top(d)
    for row, (slug, value) in enumerate(times.items()):
        if value < MIN_EVIDENCE:
            # Alone it does no better than other base parameters: no bar to the left,
            # which would read as if it did harm beside the others.
            if len(d.causes) > 1:
                ax.text(1.0, row, " useful only in combination", fontsize=7, va="center")
            continue
        kind = kinds.get(slug, "other candidate")
        # An underscore keeps a second one of a kind out of the legend.
        style = _BAR_STYLES[kind] | {"label": f"_{kind}" if kind in named else kind}
        named.add(kind)
        ax.barh(row, value - 1.0, 0.75, 1.0, edgecolor="white", lw=0.5, **style)
    names = [rank.get(s, "") + rotary_words(title_of(s), d.axis.units[1]) for s in times]
    ax.set_yticks(range(len(times)), names, parse_math=False)
    for tick, slug in zip(ax.get_yticklabels(), times, strict=True):
        tick.set_weight("bold" if slug in rank else "normal")
    ax.axvline(1.0, color="k", lw=0.8)
    ax.set_ylim(max(len(times), _ROWS) - 0.4, -0.6)
    most = 1.05 * max(times.values())
    ax.set_xscale("log")
    ax.set_xlim(1.0, most)
    marks = [1.0]
    for mark in _MARKS_OF_GAIN:
        if mark <= most and mark > marks[-1] * most ** (1.0 / _MOST_TICKS):
            marks.append(mark)
    ax.set_xticks(marks, [f"{mark:g}" for mark in marks])
    ax.set_xticks([], minor=True)
    legend_above(ax)
