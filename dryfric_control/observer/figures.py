"""Figures 7 to 11 of the paper, drawn from a closed-loop run."""

from __future__ import annotations

from typing import Any, Protocol

import control as ct
import numpy as np
from numpy.typing import NDArray

from dryfric_control.drawing import (
    axes_of,
    control_plot,
    legend_above,
    settled_scale,
    shade_stuck,
    title_above,
)
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.model.responses import Response

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
_JUNCTIONS = ((0.945, 0.72), (0.945, 0.47), (0.485, 0.72))


class Run(Protocol):
    """What a figure reads of an observed loop."""

    @property
    def axis(self) -> FrictionAxis: ...
    @property
    def reference(self) -> NDArray[np.float64]: ...
    @property
    def plant(self) -> Response: ...
    @property
    def estimate(self) -> Response: ...
    @property
    def start(self) -> float: ...


def draw_block_diagram(ax: Any = None, title: str | None = None) -> ct.ControlPlot:
    """Draw the closed loop of the paper's section 5 as blocks."""
    from matplotlib.patches import FancyBboxPatch

    axes = axes_of(ax, 1, figsize=(7.0, 3.2))
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
    title_above(one, title)
    return control_plot(axes)


def draw_coulomb_maps(
    plant: FrictionAxis, own: FrictionAxis, ax: Any = None, title: str | None = None
) -> ct.ControlPlot:
    """Draw the friction of the plant and of the observer (Fig. 7)."""
    axes = axes_of(ax, 1, figsize=(7.0, 3.6))
    one = axes[0]
    plant, own = plant.effective(), own.effective()
    low, high = plant.travel or own.travel or (-1.0, 1.0)
    x = np.linspace(low, high, 201)
    for s in (1, -1):
        level = s * plant.coulomb(x, s)
        one.fill_between(
            x,
            level,
            s * plant.breakaway(x, s),
            color="0.9",
            linewidth=0,
            label="up to breakaway" if s > 0 else None,
        )
        one.plot(x, level, "k", label="system" if s > 0 else None)
        one.plot(x, s * own.coulomb(x, s), "C0--", label="observer" if s > 0 else None)
    one.axhline(0.0, color="0.7", linewidth=0.8)
    length, force = plant.units
    one.set_xlabel(f"position [{length}]")
    one.set_ylabel(f"friction [{force}]")
    one.margins(x=0.0)
    legend_above(one)
    title_above(one, f"{plant.name}: friction over the travel" if title is None else title)
    return control_plot(axes)


def _title(run: Run, axes: Any, name: str, title: str | None) -> None:
    """The title of a run's figure, once the legend stands."""
    title_above(axes[0], f"{run.axis.name}: {name} and its estimate" if title is None else title)


def _signal(run: Run, axes: Any, row: int, name: str, unit: str, title: str | None) -> None:
    """Plant and estimate above, the error below."""
    t = run.plant.t
    true, estimate = run.plant.y[row], run.estimate.y[row]
    top, bottom = axes
    top.plot(t, true, "k", linewidth=1.0, label="system")
    top.plot(t, estimate, "C0--", linewidth=1.0, label="observer")
    bottom.plot(t, estimate - true, "C3", linewidth=0.8)
    settled_scale(top, t, true, estimate)
    settled_scale(bottom, t, estimate - true)
    for one in axes:
        shade_stuck(one, t, run.plant.y[3])
        one.margins(x=0.0)
    top.set_ylabel(f"{name} [{unit}]")
    bottom.set_ylabel(f"error [{unit}]")
    legend_above(top)
    _title(run, axes, name, title)
    bottom.set_xlabel("Time [s]")


def draw_position(run: Run, ax: Any = None, title: str | None = None) -> ct.ControlPlot:
    """Draw position, reference and the estimation error (Fig. 8), the plant at rest as a band.

    The first 0.1 s do not count for the scales; the inset shows the first 0.15 s.
    """
    axes = axes_of(ax, 2)
    axes[0].plot(run.plant.t, run.reference, color="0.55", linewidth=0.8, label="reference")
    _signal(run, axes, 0, "position", run.axis.units[0], title)
    first = run.plant.t <= _FIRST
    inset = axes[0].inset_axes((0.055, 0.40, 0.25, 0.46))
    inset.plot(run.plant.t[first], run.plant.y[0][first], "k", linewidth=1.0)
    # Before its first reading the observer is where it was started.
    t, estimate = np.r_[0.0, run.plant.t[first]], np.r_[run.start, run.estimate.y[0][first]]
    inset.plot(t, estimate, "C0.--", linewidth=1.0, ms=3)
    inset.plot(0.0, run.start, "C0o", ms=4, clip_on=False)
    inset.set_xlim(-0.03 * _FIRST, _FIRST)
    inset.set_title(f"observer starts at {run.start:.4g}", fontsize="x-small", pad=2.0)
    inset.tick_params(labelsize="x-small")
    return control_plot(axes)


def draw_speed(run: Run, ax: Any = None, title: str | None = None) -> ct.ControlPlot:
    """Draw velocity and its estimation error (Fig. 9)."""
    axes = axes_of(ax, 2)
    _signal(run, axes, 1, "velocity", f"{run.axis.units[0]}/s", title)
    return control_plot(axes)


def draw_friction(run: Run, ax: Any = None, title: str | None = None) -> ct.ControlPlot:
    """Draw friction, its estimate and the error (Fig. 10)."""
    axes = axes_of(ax, 2)
    _signal(run, axes, 2, "friction", run.axis.units[1], title)
    return control_plot(axes)


def draw_modes(run: Run, ax: Any = None, title: str | None = None) -> ct.ControlPlot:
    """Draw the mode and the mode-detection errors (Fig. 11)."""
    axes = axes_of(ax, 2)
    t, true, estimate = run.plant.t, run.plant.y[3], run.estimate.y[4]
    axes[0].step(t, true, "k", where="post", linewidth=1.0, label="system")
    axes[0].step(t, estimate, "C0--", where="post", linewidth=1.0, label="observer")
    axes[1].step(t, estimate - true, "C3", where="post", linewidth=0.8)
    axes[0].set_yticks([-1, 0, 1], ["sliding -", "stuck", "sliding +"])
    axes[1].set_yticks([-2, -1, 0, 1, 2])
    axes[1].set_ylim(-2.2, 2.2)
    axes[0].set_ylabel("mode")
    axes[1].set_ylabel("mode error")
    for one in axes:
        one.margins(x=0.0)
    legend_above(axes[0])
    _title(run, axes, "mode", title)
    axes[1].set_xlabel("Time [s]")
    return control_plot(axes)


def draw_loop(run: Run, ax: Any = None, title: str | None = None) -> ct.ControlPlot:
    """Draw position, velocity, friction and mode in one figure."""
    axes = axes_of(ax, 4)
    t, length, force = run.plant.t, *run.axis.units
    names = (f"position [{length}]", f"velocity [{length}/s]", f"friction [{force}]", "mode")
    axes[0].plot(t, run.reference, color="0.55", linewidth=0.8, label="reference")
    for row, (one, name) in enumerate(zip(axes, names, strict=True)):
        mine = row if row < 3 else 4
        one.plot(t, run.plant.y[row], "k", linewidth=1.0, label="system")
        one.plot(t, run.estimate.y[mine], "C0--", linewidth=1.0, label="observer")
        settled_scale(one, t, run.plant.y[row], run.estimate.y[mine])
        shade_stuck(one, t, run.plant.y[3])
        one.set_ylabel(name)
        one.margins(x=0.0)
    axes[3].set_yticks([-1, 0, 1], ["sliding -", "stuck", "sliding +"])
    legend_above(axes[0])
    title_above(axes[0], f"{run.axis.name} and its observer" if title is None else title)
    axes[3].set_xlabel("Time [s]")
    return control_plot(axes)
