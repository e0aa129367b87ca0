"""Draw stick-slip as it happens, the state machine lit: ``python docs/make_animation.py``."""

from __future__ import annotations

from typing import Any

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from make_effects import IMAGES
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch, Rectangle
from PIL import Image

import dryfric_control as dfc
from dryfric_control.drawing import TIME_LABEL, shade_stuck
from dryfric_control.model.responses import MODE_NAMES

DT, SECONDS, FRAMES, RATE = 1e-3, 12.0, 120, 12
SPRING = dfc.effects.Spring(stiffness=60.0)
AXIS = dfc.FrictionAxis(
    mass=1.0, viscous=4.0, coulomb=3.0, stribeck=dfc.Stribeck(excess=0.7, speed=0.02),
    effects=(SPRING,),
)  # fmt: skip
PLACES = {-1: 0.15, 0: 0.5, 1: 0.85}
LIT, DARK = {-1: "C1", 0: "0.75", 1: "C0"}, "white"
#: Length of the spring at rest in the picture [m].
LENGTH = 0.3


def states(ax: Any) -> dict[int, FancyBboxPatch]:
    """Boxes of the three modes, and what leads from one to the other."""
    ax.set_axis_off()
    ax.set(xlim=(0, 1), ylim=(0, 1))
    boxes = {}
    for mode, x in PLACES.items():
        style = "round,pad=0,rounding_size=0.03"
        boxes[mode] = FancyBboxPatch((x - 0.12, 0.3), 0.24, 0.4, style, ec="k", fc=DARK, lw=1.2)
        ax.add_patch(boxes[mode])
        ax.text(x, 0.5, MODE_NAMES[mode], ha="center", va="center", fontsize=10)
    for s in (1, -1):
        for y, start, end, words in (
            (0.6, 0.5 + 0.12 * s, 0.5 + 0.23 * s, "breaks away"),
            (0.4, 0.5 + 0.23 * s, 0.5 + 0.12 * s, "comes to rest"),
        ):
            arrow = FancyArrowPatch((start, y), (end, y), arrowstyle="-|>", mutation_scale=11,
                                    shrinkA=0, shrinkB=0, color="k")  # fmt: skip
            ax.add_patch(arrow)
            ax.text(0.5 + 0.175 * s, y + (0.22 if y > 0.5 else -0.22), words, ha="center",
                    va="center", fontsize=7.5)  # fmt: skip
    return boxes


def coil(start: float, end: float) -> tuple[np.ndarray, np.ndarray]:
    """A spring between two places."""
    turns = np.concatenate(([0.0, 0.1], np.linspace(0.14, 0.86, 17), [0.9, 1.0]))
    height = np.concatenate(([0.0, 0.0], 0.5 * (-1.0) ** np.arange(17), [0.0, 0.0]))
    return start + (end - start) * turns, 0.5 + 0.4 * height


def main() -> None:
    plt.rcParams.update({"font.size": 8.5, "axes.spines.top": False, "axes.spines.right": False})
    t = DT * np.arange(round(SECONDS / DT) + 1)
    pull = np.interp(t, [0.0, 5.5, 6.5, SECONDS], [0.0, 0.33, 0.33, 0.0])
    run = AXIS.simulate(SPRING.stiffness * pull, DT, hold="first")
    x, v, mode = run.y[0], run.y[1], run.mode

    figure = plt.figure(figsize=(6.0, 4.4), dpi=90)
    top = figure.add_axes((0.03, 0.77, 0.94, 0.2))
    middle = figure.add_axes((0.03, 0.49, 0.94, 0.27))
    below = figure.add_axes((0.11, 0.11, 0.86, 0.34))
    top.set_axis_off()
    top.set(xlim=(-0.12, 0.78), ylim=(-0.12, 1.1))
    top.axhline(0.0, color="k", lw=1.2)
    block = Rectangle((0.0, 0.0), 0.12, 1.0, fc="0.75", ec="k", lw=1.2)
    top.add_patch(block)
    (spring,) = top.plot([], [], color="k", lw=1.0)
    (hand,) = top.plot([], [], "k>", ms=9)
    boxes = states(middle)
    shade_stuck(below, t, mode)
    below.text(7.1, 200.0, "stuck", ha="center", va="center")
    below.plot(t, 1e3 * v, color="0.6", lw=1.0)
    (now,) = below.plot([], [], "o", ms=7, mec="k")
    below.set(xlabel=TIME_LABEL, ylabel="velocity [mm/s]", xlim=(0.0, SECONDS))

    def frame(i: int) -> Image.Image:
        """One picture of the film."""
        k = min(round(i / FRAMES * SECONDS / DT), t.size - 1)
        colour = LIT[int(mode[k])]
        block.set_x(x[k] - 0.12)
        block.set_facecolor(colour)
        spring.set_data(*coil(x[k], pull[k] + LENGTH))
        hand.set_data([pull[k] + LENGTH], [0.5])
        hand.set_marker(">" if k < 6.0 / DT else "<")
        for one, box in boxes.items():
            box.set_facecolor(colour if one == mode[k] else DARK)
        now.set_data([t[k]], [1e3 * v[k]])
        now.set_color(colour)
        figure.canvas.draw()
        return Image.fromarray(np.asarray(figure.canvas.buffer_rgba())).convert("RGB")

    # One palette for all, from a frame of each colour: what stays the same is stored once.
    frames = [frame(i) for i in range(FRAMES)]
    shown = np.concatenate([np.asarray(frames[i]) for i in (0, 18, 88)])
    palette = Image.fromarray(shown).quantize(16)
    few = [one.quantize(palette=palette, dither=Image.Dither.NONE) for one in frames]
    path = IMAGES / "stick_slip.gif"
    few[0].save(path, save_all=True, append_images=few[1:], duration=1000 // RATE, loop=0)
    print(f"{len(run.events)} switches; {path.name}: {path.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main()
