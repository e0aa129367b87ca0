"""Draw the figures of the theory page: ``python docs/make_theory.py``."""

from __future__ import annotations

from typing import Any

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from make_effects import IMAGES, save

import dryfric_control as dfc
from dryfric_control.observer.closed_loop import draw_block_diagram

AXIS = dfc.FrictionAxis(
    mass=2.0, viscous=15.0, coulomb=8.0, stribeck=dfc.Stribeck(excess=0.3, speed=0.02),
    stick_speed=1e-4,
)  # fmt: skip
DPI = 120


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


def closed_loop() -> plt.Figure:
    """Reference filter, controller, axis, encoder and observer."""
    return draw_block_diagram(title="").figure


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
    plt.rcParams.update({"font.size": 9.0, "axes.spines.top": False, "axes.spines.right": False})
    for name, draw in (("friction", friction), ("loop", closed_loop), ("observer", observer)):
        save(draw(), IMAGES / f"theory_{name}.png", DPI)


if __name__ == "__main__":
    main()
