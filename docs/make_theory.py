"""Draw the figures of the theory page, and Fig. 3 of the demo: ``python docs/make_theory.py``."""

from __future__ import annotations

from typing import Any

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from make_effects import IMAGES, save
from matplotlib.patches import Circle, FancyBboxPatch, Polygon, Rectangle

import dryfric_control as dfc
from dryfric_control import demo

AXIS = dfc.FrictionAxis(
    mass=2.0, viscous=15.0, coulomb=8.0, stribeck=dfc.Stribeck(excess=0.3, speed=0.02),
    stick_speed=1e-4,
)  # fmt: skip
DPI = 120
# The closed loop: boxes by centre, half width and words; arrows by their corners and words.
BLOCKS = (
    (0.135, 0.72, 0.065, "low-pass\nfilter"),
    (0.365, 0.72, 0.085, "position\ncontroller"),
    (0.615, 0.72, 0.095, "axis with dry\nfriction: stuck,\nsliding +, sliding \N{MINUS SIGN}"),
    (0.835, 0.72, 0.062, "encoder"),
    (0.615, 0.22, 0.095, "switched\nPI observer:\ngains by mode"),
)
ARROWS = (
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
JUNCTIONS = ((0.945, 0.72), (0.945, 0.47), (0.485, 0.72))


def friction() -> plt.Figure:
    """Friction force over velocity, with the name of every parameter."""
    figure, ax = plt.subplots(figsize=(6.4, 3.4), layout="constrained")
    v = np.linspace(1e-6, 0.2, 2000)
    level = AXIS.coulomb(0.0, 1)
    peak = level * AXIS.stribeck.factor(v, AXIS.stick_speed)
    for s in (1, -1):
        words = ("sliding: friction force", "without Stribeck peak and viscous friction")
        ax.plot(1e3 * s * v, s * (peak + AXIS.viscous * v), "C0", lw=2, label=words[0] * (s > 0))
        ax.plot(1e3 * s * v, s * np.full_like(v, level), "0.5", ls="--", lw=1,
                label=words[1] * (s > 0))  # fmt: skip
    high = float(peak[0])
    ax.plot([0, 0], [-high, high], "C1", lw=3, label="stuck: any force in between")
    ax.set(xlabel="velocity [mm/s]", ylabel="friction force [N]", xlim=(-140, 140), ylim=(-14, 14))
    note = {"fontsize": 8.5, "arrowprops": {"arrowstyle": "-", "color": "0.4", "lw": 0.8}}
    ax.annotate(r"breakaway friction force $(1 + \sigma) F_c$", (0, high), (-132, 12), **note)
    ax.annotate(r"Coulomb level $F_c$", (-60, -level), (-132, -5.5), **note)
    fast = 0.1
    ax.annotate(r"slope: viscous friction $f$", (1e3 * fast, 8 + 15 * fast), (62, 12.3), **note)
    speed = AXIS.stribeck.speed
    there = level * float(AXIS.stribeck.factor(speed, AXIS.stick_speed)) + 15 * speed
    ax.plot([1e3 * speed] * 2, [0.0, there], "0.4", lw=0.8, ls=":")
    ax.annotate(r"Stribeck velocity $v_s$", (1e3 * speed, 0.0), (34, 2.0), **note)
    ax.axhline(0.0, color="0.6", lw=0.6, zorder=0)
    ax.legend(loc="lower right", frameon=False, fontsize=8)
    return figure


def canvas(width: float, height: float) -> tuple[plt.Figure, Any]:
    """Empty axes in which one unit is one inch."""
    figure = plt.figure(figsize=(width, height))
    ax = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    ax.set(xlim=(0.0, width), ylim=(0.0, height))
    ax.set_axis_off()
    return figure, ax


def box(
    ax: Any, x: float, y: float, text: str, w: float = 1.2, h: float = 0.6, face: str = "w"
) -> None:
    """A block around a point."""
    ax.add_patch(plt.Rectangle((x - w / 2, y - h / 2), w, h, facecolor=face, edgecolor="k", lw=1.1))
    ax.text(x, y, text, ha="center", va="center", fontsize=8.5, linespacing=1.35)


def junction(ax: Any, x: float, y: float, signs: dict[str, str]) -> None:
    """A sum, with the sign of what comes from the left, top and bottom."""
    ax.add_patch(plt.Circle((x, y), 0.1, facecolor="w", edgecolor="k", lw=1.1))
    places = {"left": (-0.19, -0.12), "top": (-0.13, 0.19), "bottom": (0.12, -0.2)}
    for side, sign in signs.items():
        dx, dy = places[side]
        ax.text(x + dx, y + dy, sign, ha="center", va="center", fontsize=9)


def line(
    ax: Any,
    *points: tuple[float, float],
    text: str = "",
    at: int = 0,
    dy: float = 0.1,
    **style: Any,
) -> None:
    """A signal along points, with an arrow at its end; its name above one of its pieces."""
    style = {"color": "k", "lw": 1.1} | style
    xs, ys = zip(*points[:-1], strict=True) if len(points) > 2 else ((), ())
    ax.plot(xs, ys, solid_capstyle="butt", **style)
    ax.annotate("", points[-1], points[-2],
                arrowprops={"arrowstyle": "-|>", "shrinkA": 0, "shrinkB": 0, **style})  # fmt: skip
    if text:
        (x0, y0), (x1, y1) = points[at], points[at + 1]
        ax.text((x0 + x1) / 2, (y0 + y1) / 2 + dy, text, ha="center", va="center", fontsize=9)


def dot(ax: Any, x: float, y: float) -> None:
    """A branch of a signal."""
    ax.plot([x], [y], "ko", ms=3.5)


def loop_in(ax: Any) -> None:
    """The closed loop of the paper's section 5 as blocks."""
    ax.set(xlim=(-0.01, 1.01), ylim=(-0.06, 1.0))
    ax.set_axis_off()
    for x, y, half, words in BLOCKS:
        block = FancyBboxPatch(
            (x - half, y - 0.145), 2.0 * half, 0.29, fc="0.95", ec="k",
            boxstyle="round,pad=0,rounding_size=0.01", mutation_aspect=2.0,
        )  # fmt: skip
        ax.add_patch(block)
        ax.text(x, y, words, ha="center", va="center", fontsize="small")
    for corners, words, at in ARROWS:
        ax.plot(*zip(*corners, strict=True), "k", lw=1.1, solid_joinstyle="miter", zorder=0)
        end = {"arrowstyle": "-|>", "color": "k", "shrinkA": 0, "shrinkB": 0}
        ax.annotate("", corners[-1], corners[-2], arrowprops=end)
        middle = np.mean(corners[at : at + 2], axis=0)
        ax.text(*(middle + (0.0, 0.03)), words, ha="center", va="bottom", fontsize="small")
    ax.plot(*zip(*JUNCTIONS, strict=True), "ko", ms=3.5)


def closed_loop() -> plt.Figure:
    """Reference filter, controller, axis, encoder and observer."""
    figure, ax = plt.subplots(figsize=(7.0, 3.2), layout="constrained")
    loop_in(ax)
    return figure


def spring(ax: Any, start: tuple[float, float], end: tuple[float, float], name: str) -> None:
    """A zigzag between two points, its name in the middle."""
    a, along = np.array(start), np.subtract(end, start)
    across = 0.16 * np.array([-along[1], along[0]]) / np.hypot(*along)
    part = np.r_[0.0, np.linspace(0.15, 0.85, 9), 1.0]
    side = np.r_[0.0, 0.0, np.resize([1.0, -1.0], 7), 0.0, 0.0]
    ax.plot(*(a[:, None] + along[:, None] * part + across[:, None] * side), "k", lw=1.1)
    side_by_side = "right" if along[0] == 0.0 else "center"
    ax.text(*(a + 0.5 * along - 2.4 * across), name, ha=side_by_side, va="center", fontsize="small")


def kinematics(ax: Any) -> None:
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
    spring(ax, (0.37, 2.37), (2.0, 2.37), "spring 1")
    spring(ax, (7.6, 4.7), (7.6, 3.01), "spring 2")


def system() -> plt.Figure:
    """Kinematic diagram of the actuator above the closed loop in which it runs (paper, Fig. 3)."""
    figure, (above, below) = plt.subplots(2, 1, figsize=(7.0, 6.4), layout="constrained")
    kinematics(above)
    above.set_title("clutch actuator: motor, rack, two springs, bevel", loc="left")
    loop_in(below)
    below.set_title("closed loop: the observer reads drive force and encoder", loc="left")
    return figure


def observer() -> plt.Figure:
    """Supervisor, model of the mode, integral of the friction error."""
    figure, ax = canvas(7.6, 4.0)
    grey = {"color": "C0", "ls": "--"}
    # Model in the middle row: u less the level, plus what, through the mode's matrices.
    y = 2.35
    junction(ax, 1.5, y, {"left": "+", "top": "\u2212"})
    box(ax, 2.3, y, "$B_i$", 0.6, 0.5)
    junction(ax, 3.1, y, {"left": "+", "top": "+", "bottom": "+"})
    box(ax, 4.1, y, "one sample\nlater", 0.95, 0.6)
    box(ax, 5.6, y, "$C$", 0.5, 0.5)
    junction(ax, 6.6, y, {"left": "\u2212", "top": "+"})
    line(ax, (0.1, y), (1.4, y), text="$u$")
    line(ax, (1.6, y), (2.0, y))
    line(ax, (2.6, y), (3.0, y))
    line(ax, (3.2, y), (3.62, y))
    line(ax, (4.58, y), (5.35, y), text=r"$\hat X = (\hat x, \hat v)$", dy=-0.19)
    line(ax, (5.85, y), (6.5, y), text=r"$\hat x$")
    # The model's own motion, above.
    dot(ax, 5.0, y)
    box(ax, 4.1, 3.1, "$A_i$", 0.6, 0.45)
    line(ax, (5.0, y), (5.0, 3.1), (4.4, 3.1))
    line(ax, (3.8, 3.1), (3.1, 3.1), (3.1, y + 0.1))
    # Friction level at the reading.
    box(ax, 1.5, 3.1, r"level $\bar F_i(y)$", 1.05, 0.45)
    line(ax, (1.5, 2.87), (1.5, y + 0.1))
    line(ax, (7.5, 3.7), (1.5, 3.7), (1.5, 3.33), text="$y$")
    dot(ax, 6.6, 3.7)
    line(ax, (6.6, 3.7), (6.6, y + 0.1))
    # Corrections below.
    box(ax, 4.6, 1.45, "$L_i$", 0.6, 0.45)
    box(ax, 5.6, 0.85, "$G_i$", 0.6, 0.45)
    box(ax, 4.45, 0.85, "sum over\nsamples", 0.85, 0.55)
    box(ax, 3.1, 0.85, "$E_i$", 0.6, 0.45)
    line(ax, (6.6, y - 0.1), (6.6, 0.85), (5.9, 0.85), text="", at=0)
    ax.text(6.68, 1.75, r"$y - C \hat X$", fontsize=9, va="center")
    dot(ax, 6.6, 1.45)
    line(ax, (6.6, 1.45), (4.9, 1.45))
    junction(ax, 3.1, 1.45, {})
    ax.text(3.3, 1.56, "+", fontsize=9, ha="center", va="center")
    ax.text(2.98, 1.26, "+", fontsize=9, ha="center", va="center")
    line(ax, (4.3, 1.45), (3.2, 1.45))
    line(ax, (3.1, 1.55), (3.1, y - 0.1))
    line(ax, (5.3, 0.85), (4.88, 0.85))
    line(ax, (4.02, 0.85), (3.4, 0.85), text=r"$\hat w$")
    line(ax, (3.1, 1.08), (3.1, 1.35))
    # The supervisor chooses the matrices.
    box(ax, 1.0, 0.85, "supervisor:\nstuck or sliding", 1.35, 0.6, "0.93")
    dot(ax, 0.45, y)
    line(ax, (0.45, y), (0.45, 1.15))
    ax.plot([7.2, 7.2, 1.0], [3.7, 0.2, 0.2], "k", lw=1.1)
    line(ax, (7.2, 0.2), (1.0, 0.2), (1.0, 0.55), text="$y$")
    dot(ax, 7.2, 3.7)
    line(ax, (1.68, 0.85), (2.2, 0.85), **grey)
    chosen = "mode $i$ chooses\n$A_i, B_i, E_i, L_i, G_i, \\bar F_i$"
    ax.text(1.72, 1.16, chosen, fontsize=8, color="C0", va="center")
    return figure


def main() -> None:
    save(system(), demo.SYSTEM, dpi=110)
    plt.rcParams.update({"font.size": 9.0, "axes.spines.top": False, "axes.spines.right": False})
    for name, draw in (("friction", friction), ("loop", closed_loop), ("observer", observer)):
        save(draw(), IMAGES / f"theory_{name}.png", DPI)


if __name__ == "__main__":
    main()
