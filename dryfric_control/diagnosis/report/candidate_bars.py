"""What every candidate brings as the only cause, as bars."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING, Any

import numpy as np

from dryfric_control.diagnosis.report.wording import times_smaller, title_of
from dryfric_control.drawing import legend_above

if TYPE_CHECKING:
    from dryfric_control.diagnosis.report.diagnosis import Diagnosis

#: Colour of what was found.
FOUND = "#0072B2"
# Bars of candidates: times by which an error falls that is worth a bar, and the
# range of the scale, at least.
_WORTH, _LEAST_TIMES = 1.05, 1.5
# Marks on that scale, as many as there is room for.
_FINE = (1.0, 1.1, 1.2, 1.5, 2.0, 3.0)
_COARSE = (1.0, 2.0, 5.0, 10.0, 30.0, 100.0, 300.0, 1e3, 3e3, 1e4, 1e5, 1e6, 1e7, 1e8)
_MOST_TICKS = 6
#: Told where no candidate earns a bar.
NO_BAR = (
    "No candidate alone does better than other numbers for mass, viscous friction and Coulomb "
    "level do."
)


def falls(diagnosis: Diagnosis) -> dict[str, float]:
    """By how many times every candidate alone makes the typical error smaller.

    Beside the axis with its base parameters fitted, or where that was not
    tried the worst candidate; below one for a candidate that does worse.

    Parameters
    ----------
    diagnosis : Diagnosis
        What was found.

    Returns
    -------
    dict of str to float
        By slug, the largest first.
    """
    table = {slug: s for slug, s in diagnosis.scores.items() if slug and np.isfinite(s)}
    reference = diagnosis.scores.get("", max(table.values(), default=0.0))
    order = sorted(table, key=table.__getitem__)
    return {slug: times_smaller(reference - table[slug]) for slug in order}


def any_bar(diagnosis: Diagnosis) -> bool:
    """Whether a candidate alone does visibly better than other base parameters."""
    return max(falls(diagnosis).values(), default=0.0) >= _WORTH


def draw_candidates(diagnosis: Diagnosis, ax: Any) -> None:
    """How many times smaller every candidate alone makes the typical error.

    Parameters
    ----------
    diagnosis : Diagnosis
    ax : Axes
    """
    d = diagnosis
    times = falls(d)
    ax.set_xlabel("typical error with this cause alone: times smaller [1]")
    if not any_bar(d):
        words = "\n".join(textwrap.wrap(NO_BAR, 44)) if times else "no candidate had to be tried"
        ax.text(0.5, 0.5, words, ha="center", va="center", transform=ax.transAxes)
        ax.set_axis_off()
        return
    rank = {cause.effect: i for i, cause in enumerate(d.main_causes, start=1)}
    small = {cause.effect for cause in d.small_corrections}
    rivals = {slug for cause in d.causes for slug in cause.alternatives} - set(rank) - small
    labelled: set[str] = set()
    for row, (slug, value) in enumerate(times.items()):
        if slug in rank:
            what, style = "named a cause", {"color": FOUND}
        elif slug in small:
            what, style = "small correction", {"color": "#009E73", "hatch": "..."}
        elif slug in rivals:
            what, style = "alternative", {"color": "#56B4E9", "hatch": "///"}
        else:
            what, style = "other candidate", {"color": "0.8"}
        if value < _WORTH:
            # Alone it does no better than other base parameters: no bar to the left,
            # which would read as if it did harm beside the others.
            if slug in rank or slug in small:
                ax.text(1.0, row, " helps beside the others only", fontsize=7, va="center")
            continue
        # An underscore keeps a second one of a kind out of the legend.
        label = f"_{what}" if what in labelled else what
        labelled.add(what)
        ax.barh(
            row, value - 1.0, left=1.0, height=0.75, edgecolor="white", lw=0.5, label=label, **style
        )
    ax.set_yticks(
        range(len(times)),
        [f"{rank[slug]}. {title_of(slug)}" if slug in rank else title_of(slug) for slug in times],
        fontsize=min(8.0, 180.0 / len(times)),
        parse_math=False,
    )
    for tick, slug in zip(ax.get_yticklabels(), times, strict=True):
        tick.set_weight("bold" if slug in rank else "normal")
    ax.axvline(1.0, color="k", lw=0.8)
    ax.set_ylim(len(times) - 0.4, -0.6)
    # Bars that are next to nothing shall look it.
    most = max(1.05 * max(times.values()), _LEAST_TIMES)
    ax.set_xscale("log")
    ax.set_xlim(1.0, most)
    marks = [mark for mark in (_FINE if most < 4.0 else _COARSE) if mark <= most]
    marks = marks[:: -(-len(marks) // _MOST_TICKS)]
    ax.set_xticks(marks, [f"{mark:g}" for mark in marks])
    ax.set_xticks([], minor=True)
    if min(times.values()) < _WORTH:
        ax.text(
            0.98, 0.02, "no bar: alone no better than other\nnumbers for the base parameters",
            ha="right", va="bottom", fontsize=7, transform=ax.transAxes,
        )  # fmt: skip
    legend_above(ax)
