"""Figures 1, 3 and 5 of the paper, as the demo draws them."""

from __future__ import annotations

from typing import Any

import control as ct
import numpy as np
from matplotlib.patches import Circle, Polygon, Rectangle

from dryfric_control.drawing import MEASURED, axes_of, control_plot, legend_above, title_above
from dryfric_control.identification import CoulombIdentification, SlowRamp
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.observer.figures import draw_block_diagram


def marked_friction(axis: FrictionAxis) -> ct.ControlPlot:
    """Friction over velocity with Fs, Fc and Sigma (Fig. 1)."""
    drawn = axis.plot_friction()
    one = drawn.axes[0, 0]
    places = np.mean(axis.travel or (0.0, 0.0))
    breakaway, level = axis.breakaway(places, 1), axis.coulomb(places, 1)
    left, sigma = one.get_xlim()[0], axis.stick_speed
    for force, name in ((breakaway, r"$F_s$"), (level, r"$F_c$")):
        one.plot([left, 0.0], [force, force], ":", color="0.3", lw=1.0)
        one.text(0.96 * left, force, name, va="bottom", ha="left")
    for s, name in ((-1, r"$-\Sigma$"), (1, r"$\Sigma$")):
        low = -axis.breakaway(places, -1) if s < 0 else breakaway
        one.plot([s * sigma, s * sigma], [0.0, low], ":", color="0.3", lw=1.0)
        one.text(s * sigma, 0.0, name, va="bottom" if s < 0 else "top", ha="center")
    return drawn


def _spring(ax: Any, start: tuple[float, float], end: tuple[float, float], name: str) -> None:
    """A zigzag between two points, its name in the middle."""
    a, along = np.array(start), np.subtract(end, start)
    across = 0.16 * np.array([-along[1], along[0]]) / np.hypot(*along)
    part = np.r_[0.0, np.linspace(0.15, 0.85, 9), 1.0]
    side = np.r_[0.0, 0.0, np.resize([1.0, -1.0], 7), 0.0, 0.0]
    ax.plot(*(a[:, None] + along[:, None] * part + across[:, None] * side), "k", lw=1.1)
    side_by_side = "right" if along[0] == 0.0 else "center"
    ax.text(*(a + 0.5 * along - 2.4 * across), name, ha=side_by_side, va="center", fontsize="small")


def draw_kinematics(ax: Any) -> None:
    """Motor, toothed rack, two springs and a bevel: the system of the paper's Fig. 3."""
    ax.set(xlim=(0.0, 9.6), ylim=(1.4, 5.2), aspect="equal")
    ax.set_axis_off()
    for shape in (
        Circle((3.8, 3.62), 0.75, fc="0.95", ec="k"),
        Circle((3.8, 3.62), 0.1, fc="k"),
        Rectangle((2.0, 2.05), 4.0, 0.65, fc="0.9", ec="k"),
        # The bevel moves with the rack: where spring 1 is compressed, spring 2 is not.
        Polygon([(6.0, 2.05), (9.0, 2.05), (9.0, 2.2), (6.0, 3.2)], fc="0.75", ec="k"),
        Circle((7.6, 2.84), 0.17, fc="w", ec="k"),
        Rectangle((0.23, 1.92), 0.14, 0.9, fc="w", ec="k", hatch="////"),
        Rectangle((7.15, 4.7), 0.9, 0.14, fc="w", ec="k", hatch="////"),
    ):
        ax.add_patch(shape)
    for x, y, words in (
        (3.8, 4.62, "motor and pinion, torque u"),
        (4.0, 2.36, "toothed rack"),
        (3.15, 1.75, "x"),
        (6.9, 2.36, "bevel"),
    ):
        ax.text(x, y, words, ha="center", va="center", fontsize="small")
    ax.plot(np.linspace(2.0, 6.0, 41), 2.7 + 0.17 * (np.arange(41) % 2), "k", lw=1.0)
    ax.annotate("", (3.0, 1.75), (2.0, 1.75), arrowprops={"arrowstyle": "-|>", "color": "k"})
    _spring(ax, (0.37, 2.37), (2.0, 2.37), "spring 1")
    _spring(ax, (7.6, 4.7), (7.6, 3.01), "spring 2")


def draw_system() -> ct.ControlPlot:
    """Kinematic diagram of the actuator above the closed loop in which it runs (Fig. 3)."""
    axes = axes_of(None, 2, sharex=False, figsize=(7.0, 6.4))
    draw_kinematics(axes[0])
    title_above(axes[0], "clutch actuator: motor, rack, two springs, bevel")
    draw_block_diagram(axes[1])
    return control_plot(axes)


def over_crawl(levels: CoulombIdentification, ramp: SlowRamp) -> ct.ControlPlot:
    """Levels found over the crawl as recorded, and those of the simulated bench (Fig. 5)."""
    drawn = levels.plot(title="Coulomb level over the travel: crawl, levels found, truth")
    one, record = drawn.axes[0, 0], ramp.record
    some = slice(None, None, max(1, len(record) // 10_000))
    crawl = {"color": MEASURED, "lw": 0.8, "zorder": 0, "label": "crawl, measured"}
    one.plot(record.x[some], record.u[some], "--", **crawl)
    x = np.linspace(*levels.travel, 201)
    for s in (1, -1):
        truth = s * ramp.axis.coulomb(x, s)
        one.plot(x, truth, "k:", lw=1.2, label="truth" if s > 0 else None)
    one.set_xlabel(f"position [{ramp.axis.units[0]}]")
    legend_above(one)
    title_above(one, one.get_title(loc="left"))
    return drawn
