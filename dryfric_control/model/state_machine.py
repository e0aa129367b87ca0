"""The switching rule of an axis, drawn with its numbers."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import control as ct
import numpy as np
from numpy.typing import ArrayLike

from dryfric_control.checks import instance
from dryfric_control.drawing import axes_of, control_plot
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.model.responses import MODE_NAMES
from dryfric_control.text import typeset_signs

# Boxes of the modes in axes coordinates: left, bottom, width, height.
_BOXES = {-1: (0.0, 0.60, 0.34, 0.33), 1: (0.66, 0.60, 0.34, 0.33), 0: (0.34, 0.12, 0.32, 0.31)}
_SIGNS = {1: "+", -1: "-"}
# Font size of the equations [pt].
_EQUATION = 9.0
# Font size of other text [pt].
_SMALL = 8.0


def plot_state_machine(axis: FrictionAxis, ax: Any = None) -> ct.ControlPlot:
    """Draw the three modes of an axis and their transitions.

    Parameters
    ----------
    axis : FrictionAxis
    ax : Axes, optional
        Where to draw.  Default: a new figure.  The letters keep their size:
        give axes at least 6.5 inches wide and 3.6 high.

    Notes
    -----
    Boxes hold the motion in each mode (paper, eqs. (2) and (3)), arrows what
    leads from one to another (paper, Fig. 2, completed unless the axis has
    ``switching="paper"``).  A level that varies over the travel is written as
    its least and largest value.  Levels are those of the base model: what
    effects add to friction is left out and stated below the drawing.

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0,
    ...                         stribeck=dfc.Stribeck(excess=0.3, speed=0.01))
    >>> drawn = dfc.plot_state_machine(axis)
    >>> words = [text.get_text() for text in drawn.axes.ravel()[0].texts]
    >>> any("10.4 N" in text for text in words)     # breakaway (1 + 0.3) 8 N
    True
    """
    instance("axis", axis, FrictionAxis)
    axes = axes_of(ax, 1, figsize=(7.0, 4.2))
    one = axes[0]
    effects = axis.effects
    axis = axis.effective()
    force = "w" if any(e.action != "axis" for e in effects) else "u"
    one.set_axis_off()
    one.set(xlim=(-0.01, 1.01), ylim=(0.0, 1.0))  # room for the lines of the boxes
    one.set_title(f"{axis.name}: modes and switching", loc="left")
    for mode, rows in _modes(axis, force).items():
        _box(one, mode, rows)
    for s in (1, -1):
        _between_stuck(one, axis, force, s)
        _reversal(one, axis, force, s)
    words = "\n".join(_shared_numbers(axis, force))
    one.text(0.5, 0.0, words, ha="center", va="bottom", fontsize=_SMALL)
    return control_plot(axes)


def _levels(axis: FrictionAxis, level: Callable[[ArrayLike, int], Any], s: int) -> str:
    """Level over the travel with its unit: one number, or least to largest."""
    places = np.linspace(*axis.travel, 1001) if axis.travel else np.zeros(1)
    values = np.asarray(level(places, s), dtype=float)
    low = f"{values.min():.3g}"
    high = f"{values.max():.3g}"
    unit = typeset_signs(axis.units[1])
    return f"{low if low == high else f'{low} to {high}'} {unit}"


def _modes(axis: FrictionAxis, force: str) -> dict[int, list[str]]:
    """Title, equations and numbers of each mode, a row each."""
    rows = {0: [rf"$\dot v = -p\,v$,  $F = {force}$", f"p = {axis.stick_rate:.4g} 1/s"]}
    rows[0] += [
        rf"$F_{{b{sign}}}$ = {_levels(axis, axis.breakaway, s)}" for s, sign in _SIGNS.items()
    ]
    for s, sign in _SIGNS.items():
        # Friction opposes the motion: the level is a magnitude.
        rows[s] = [rf"$m\,\dot v = {force} - f\,v {'-' if s > 0 else '+'} F_{sign}$"]
        peak = rf"-(({'v' if s > 0 else '-v'} - \Sigma)/v_s)^2"
        more = rf"\,(1 + \sigma\,e^{{{peak}}})" if axis.stribeck else ""
        rows[s] += [rf"$F_{sign} = F_{{c{sign}}}{more}$"]
        rows[s] += [rf"$F_{{c{sign}}}$ = {_levels(axis, axis.coulomb, s)}"]
    return rows


def _shared_numbers(axis: FrictionAxis, force: str) -> list[str]:
    """Numbers that all modes share, and what the letters mean."""
    length = axis.units[0]
    shared = [typeset_signs(f"m = {axis.mass:.4g} {axis.unit('kg')}")]
    shared += [typeset_signs(f"f = {axis.viscous:.4g} {axis.unit('N s/m')}")]
    if axis.stribeck:
        shared += [rf"$\sigma$ = {axis.stribeck.excess:.4g}"]
        shared += [rf"$v_s$ = {axis.stribeck.speed:.4g} {length}/s"]
    shared += [rf"$\Sigma$ = {axis.stick_speed:.4g} {length}/s"]
    rows = ["     ".join(shared)]
    if force == "w":
        names = ", ".join(effect.slug.replace("_", " ") for effect in axis.effects)
        rows += [f"w: net force without friction; effects: {names}"]
        if any(effect.action == "friction" for effect in axis.effects):
            rows[-1] += " (levels are without them)"
    return rows


def _box(ax: Any, mode: int, rows: list[str]) -> None:
    """One mode: its name in bold above its rows."""
    from matplotlib.patches import FancyBboxPatch

    left, bottom, width, height = _BOXES[mode]
    look: dict[str, Any] = {"facecolor": "white" if mode else "0.9", "edgecolor": "k", "lw": 1.2}
    shape = "round,pad=0,rounding_size=0.02"
    ax.add_patch(FancyBboxPatch((left, bottom), width, height, shape, **look))
    middle = left + 0.5 * width
    count = len(rows) + 1
    style: dict[str, Any] = {"ha": "center", "va": "center", "fontsize": _EQUATION}
    for i, text in enumerate([MODE_NAMES[mode], *rows]):
        y = bottom + height * (1.0 - (i + 0.5) / count)
        ax.text(middle, y, text, weight="normal" if i else "bold", **style)


def _draw_arrow(ax: Any, start: tuple[float, float], end: tuple[float, float], bend: str) -> None:
    from matplotlib.patches import FancyArrowPatch

    look: dict[str, Any] = {"connectionstyle": bend, "arrowstyle": "-|>", "mutation_scale": 13}
    ax.add_patch(FancyArrowPatch(start, end, color="k", lw=1.1, shrinkA=0, shrinkB=0, **look))


def _excess_load_formula(force: str, s: int) -> str:
    """Load beyond the breakaway level of one direction, as a formula."""
    return rf"{force} > F_{{b+}}" if s > 0 else rf"{force} < -F_{{b-}}"


def _between_stuck(ax: Any, axis: FrictionAxis, force: str, s: int) -> None:
    """Breakaway, and coming to rest, of one direction."""
    sign = _SIGNS[s]

    def mirror_x(x: float) -> float:
        return 0.5 + s * (x - 0.5)

    # Breakaway: from the top of the box at rest up to the sliding one.
    _draw_arrow(ax, (mirror_x(0.62), 0.43), (mirror_x(0.70), 0.60), "arc3")
    ax.text(
        mirror_x(0.64), 0.52, f"${_excess_load_formula(force, s)}$",
        ha="right" if s > 0 else "left", va="center", fontsize=_SMALL,
    )  # fmt: skip
    # Coming to rest: down from the sliding box, then in to the one at rest.
    _draw_arrow(
        ax, (mirror_x(0.93), 0.60), (mirror_x(0.66), 0.22), "angle,angleA=-90,angleB=0,rad=8"
    )
    speed = f"{axis.stick_speed:.4g} {axis.units[0]}/s"
    rows = [rf"$|v| \leq \Sigma$ = {speed}", rf"and  $-F_{{c-}} \leq {force} \leq F_{{c+}}$"]
    if axis.stribeck and axis.switching == "filippov":
        top = float(axis.stribeck.factor(0.0, axis.stick_speed))
        hold = rf"{force} \leq F_+(0)" if s > 0 else rf"{force} \geq -F_-(0)"
        peak = _levels(axis, axis.coulomb.scaled(top), s)
        rows += [rf"or  $v = 0$ and ${hold}$,", rf"$F_{sign}(0)$ = {peak}"]
    ax.text(
        mirror_x(0.915), 0.415, "\n".join(rows),
        ha="right" if s > 0 else "left", va="center", fontsize=_SMALL, linespacing=1.35,
    )  # fmt: skip


def _reversal(ax: Any, axis: FrictionAxis, force: str, s: int) -> None:
    """From one direction of sliding straight to the other."""
    height = 0.835 if s > 0 else 0.695
    start, end = (0.34, 0.66) if s > 0 else (0.66, 0.34)
    _draw_arrow(ax, (start, height), (end, height), "arc3")
    if axis.switching == "filippov":
        text = f"$v = 0$ and ${_excess_load_formula(force, s)}$"
    else:
        text = "$v > 0$" if s > 0 else "$v < 0$"
    ax.text(
        0.5, height + (0.015 if s > 0 else -0.02), text,
        ha="center", va="bottom" if s > 0 else "top", fontsize=_SMALL,
    )  # fmt: skip
