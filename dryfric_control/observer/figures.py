"""Figures 7 to 11 of the paper, drawn from a closed-loop run."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import control as ct
import numpy as np

from dryfric_control import drawing
from dryfric_control.model.axis import FrictionAxis

if TYPE_CHECKING:
    from dryfric_control.observer.closed_loop import ObservedLoop

# Start that the inset of the position shows [s].
_FIRST = 0.15
# The closed loop: boxes by centre, half width and words; arrows by their corners and words.
_BLOCKS = (
    (0.135, 0.72, 0.065, "low-pass\nfilter"),
    (0.365, 0.72, 0.085, "position\ncontroller"),
    (0.615, 0.72, 0.095, "axis with dry\nfriction: stuck,\nsliding +, sliding \N{MINUS SIGN}"),
    (0.835, 0.72, 0.062, "encoder"),
    (0.615, 0.22, 0.095, "switched\nPI observer:\ngains by mode"),
)
_ARROWS = (
    (((0.0, 0.72), (0.07, 0.72)), "r", 0),
    (((0.2, 0.72), (0.28, 0.72)), r"$r_f$", 0),
    (((0.45, 0.72), (0.52, 0.72)), "u", 0),
    (((0.71, 0.72), (0.773, 0.72)), "x", 0),
    (((0.897, 0.72), (1.0, 0.72)), "y", 0),
    (((0.945, 0.72), (0.945, 0.47), (0.365, 0.47), (0.365, 0.575)), "", 1),
    (((0.945, 0.47), (0.945, 0.22), (0.71, 0.22)), "", 1),
    (((0.485, 0.72), (0.485, 0.22), (0.52, 0.22)), "", 0),
    (((0.52, 0.12), (0.3, 0.12)), r"$\hat x,\ \hat v,\ \hat F$, mode", 0),
)
#: Signals of a run: name, unit, row of the plant and of the estimate.
_SIGNALS = {
    "position": ("position", "length", 0, 0),
    "speed": ("velocity", "speed", 1, 1),
    "friction": ("friction", "force", 2, 2),
    "mode": ("mode", "", 3, 4),
}
_JUNCTIONS = ((0.945, 0.72), (0.945, 0.47), (0.485, 0.72))


def draw_block_diagram(ax: Any = None, title: str | None = None) -> ct.ControlPlot:
    """Draw the closed loop of the paper's section 5 as blocks."""
    from matplotlib.patches import FancyBboxPatch

    axes = drawing.axes_of(ax, 1, title, figsize=(7.0, 3.2))
    one = axes[0]
    one.set_axis_off()
    one.set_xlim(-0.01, 1.01)
    one.set_ylim(-0.06, 1.0)
    for x, y, half, words in _BLOCKS:
        box = FancyBboxPatch(
            (x - half, y - 0.145), 2.0 * half, 0.29, fc="0.95", ec="k",
            boxstyle="round,pad=0,rounding_size=0.01", mutation_aspect=2.0,
        )  # fmt: skip
        one.add_patch(box)
        one.text(x, y, words, ha="center", va="center", fontsize="small")
    for corners, words, at in _ARROWS:
        one.plot(*zip(*corners, strict=True), "k", lw=1.1, solid_joinstyle="miter", zorder=0)
        end = {"arrowstyle": "-|>", "color": "k", "shrinkA": 0, "shrinkB": 0}
        one.annotate("", corners[-1], corners[-2], arrowprops=end)
        middle = np.mean(corners[at : at + 2], axis=0)
        one.text(*(middle + (0.0, 0.03)), words, ha="center", va="bottom", fontsize="small")
    one.plot(*zip(*_JUNCTIONS, strict=True), "ko", ms=3.5)
    title = "closed loop: the observer reads drive force and encoder" if title is None else title
    drawing.title_above(one, title)
    return drawing.control_plot(axes)


def draw_coulomb_maps(
    plant: FrictionAxis, own: FrictionAxis, ax: Any = None, title: str | None = None
) -> ct.ControlPlot:
    """Draw the friction of the plant and of the observer (Fig. 7)."""
    axes = drawing.axes_of(ax, 1, title, figsize=(7.0, 3.6))
    one = axes[0]
    plant, own = plant.effective(), own.effective()
    low, high = plant.travel or own.travel or (-1.0, 1.0)
    x = np.linspace(low, high, 201)
    for s in (1, -1):
        level = s * plant.coulomb(x, s)
        names = ("up to breakaway", "system", "observer") if s > 0 else (None,) * 3
        top = s * plant.breakaway(x, s)
        one.fill_between(x, level, top, color="0.9", linewidth=0, label=names[0])
        one.plot(x, level, "k", label=names[1])
        one.plot(x, s * own.coulomb(x, s), "C0--", label=names[2])
    one.axhline(0.0, color="0.7", linewidth=0.8)
    length, force = plant.units
    one.set(xlabel=f"position [{length}]", ylabel=f"friction [{force}]")
    one.margins(x=0.0)
    drawing.legend_above(one)
    drawing.title_above(one, f"{plant.name}: friction over the travel" if title is None else title)
    return drawing.control_plot(axes)


def draw_run(
    run: ObservedLoop, what: str, ax: Any = None, title: str | None = None
) -> ct.ControlPlot:
    """Draw one signal of a run with its error (Figs 8 to 11), or "all" of them without.

    The first 0.1 s do not count for the scales; the band is the plant at rest.
    """
    whole = what == "all"
    axes = drawing.axes_of(ax, len(_SIGNALS) if whole else 2, title)
    t, (length, force) = run.plant.t, run.axis.units
    units = {"length": f" [{length}]", "speed": f" [{length}/s]", "force": f" [{force}]", "": ""}
    shown = list(_SIGNALS.values()) if whole else [_SIGNALS[what]]
    for one, (name, kind, row, mine) in zip(axes, shown, strict=False):
        true, estimate = run.plant.y[row], run.estimate.y[mine]
        if name == "position":
            one.plot(t, run.reference, color="0.55", linewidth=0.8, label="reference")
        style = {} if kind else {"drawstyle": "steps-post"}
        one.plot(t, true, "k", linewidth=1.0, label="system", **style)
        one.plot(t, estimate, "C0--", linewidth=1.0, label="observer", **style)
        drawing.settled_scale(one, t, true, estimate)
        one.set_ylabel(name + units[kind])
        if name == "mode":
            one.set_yticks([-1, 0, 1], ["sliding -", "stuck", "sliding +"])
    if not whole:
        axes[1].plot(t, estimate - true, "C3", linewidth=0.8, **style)
        drawing.settled_scale(axes[1], t, estimate - true)
        axes[1].set_ylabel(f"error{units[kind]}" if kind else "mode error")
        if not kind:
            axes[1].set_yticks([-2, -1, 0, 1, 2])
    for one in axes:
        drawing.shade_stuck(one, t, run.plant.y[3])
    drawing.over_time(axes)
    drawing.legend_above(axes[0])
    words = f"{name} and its estimate" if not whole else "axis and its observer"
    drawing.title_above(axes[0], f"{run.axis.name}: {words}" if title is None else title)
    if what == "position":
        _draw_start(axes[0], run)
    return drawing.control_plot(axes)


def _draw_start(ax: Any, run: ObservedLoop) -> None:
    """Inset of the first 0.15 s, with the position from which the observer started."""
    first = run.plant.t <= _FIRST
    inset = ax.inset_axes((0.055, 0.40, 0.25, 0.46))
    inset.plot(run.plant.t[first], run.plant.y[0][first], "k", linewidth=1.0)
    # Before its first reading the observer is where it was started.
    t, estimate = np.r_[0.0, run.plant.t[first]], np.r_[run.start, run.estimate.y[0][first]]
    inset.plot(t, estimate, "C0.--", linewidth=1.0, ms=3)
    inset.plot(0.0, run.start, "C0o", ms=4, clip_on=False)
    inset.set_xlim(-0.03 * _FIRST, _FIRST)
    inset.set_title(f"observer starts at {run.start:.4g}", fontsize="x-small", pad=2.0)
    inset.tick_params(labelsize="x-small")
