"""Figures of identification results."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from dryfric_control.drawing import axes_of, control_plot, legend_above, title_above
from dryfric_control.estimation.force_residual import Sliding
from dryfric_control.model.axis import FrictionAxis

if TYPE_CHECKING:
    import control as ct

    from dryfric_control.identification.coulomb import CoulombIdentification
    from dryfric_control.identification.replay import LoopReplay, Replay
    from dryfric_control.identification.slow_ramp import SlowRamp
    from dryfric_control.identification.stribeck import StribeckIdentification

GREY = "0.6"
# Part of the encoder quantum below which an error is none.
_NOTHING = 1e-2


def plot_fit(
    axis: FrictionAxis, training: Sequence[Replay], ax: Any, title: str | None = None
) -> ct.ControlPlot:
    """Friction over speed; error of the free runs over time."""
    axes = axes_of(ax, 2, sharex=False, figsize=(7.0, 6.0))
    length, force = axis.units
    top, bottom = axes
    bare = axis.replace(coulomb=0.0, viscous=0.0, stribeck=None)
    fastest = 0.0
    for i, run in enumerate(training):
        slide = Sliding(run.windows.record, 3000)
        friction = -slide.force_residual(bare)
        fastest = max(fastest, float(np.max(np.abs(slide.v), initial=0.0)))
        top.plot(slide.v, friction, ".", color=GREY, ms=2,
                 label="measured, inertia and effects taken off" if i == 0 else None)  # fmt: skip
    middle = float(np.mean([np.mean(run.windows.record.x) for run in training]))
    for s in (1, -1):
        v = np.linspace(0.0, fastest, 400)
        level = axis.coulomb([middle], s)[0] * np.ones_like(v)
        if axis.stribeck is not None:
            level = level * axis.stribeck.factor(v, axis.stick_speed)
        top.plot(s * v, s * (level + axis.viscous * v), "k-", lw=1.5,
                 label="fitted" if s == 1 else None)  # fmt: skip
    top.set_xlabel(f"speed [{length}/s]")
    top.set_ylabel(f"friction [{force}]")
    legend_above(top)
    title_above(top, f"{axis.name}: fit" if title is None else title)
    _window_errors(bottom, training, length)
    return control_plot(axes)


def _window_errors(ax: Any, runs: Sequence[Replay], unit: str) -> None:
    for i, run in enumerate(runs):
        label = run.windows.record.name if len(runs) > 1 else "error of each free run"
        ax.semilogy(run.windows.start_times, run.rms_by_window, "o-", ms=3, lw=0.8,
                    color=f"C{i}", label=label)  # fmt: skip
    ax.axhline(runs[0].quantum, color="k", lw=0.8, ls=":", label="encoder quantum")
    least = min(float(run.rms_by_window.min()) for run in runs)
    if least < _NOTHING * runs[0].quantum:
        # Windows at rest, which every model holds, must not squeeze the others together.
        ax.set_ylim(bottom=_NOTHING * runs[0].quantum)
    ax.set_xlabel("Time [s]")
    ax.set_ylabel(f"RMS error [{unit}]")
    legend_above(ax)


def plot_replay(run: Replay, ax: Any, title: str | None = None) -> ct.ControlPlot:
    """Measured position with the free runs; their errors."""
    axes = axes_of(ax, 2)
    record, windows = run.windows.record, run.windows
    length = run.axis.units[0]
    axes[0].plot(record.t, record.x, ".", color=GREY, ms=3, label="measured")
    # A gap at each restart, so that a run is not joined to the next.
    ends = windows.edges[1:-1]
    axes[0].plot(np.insert(record.t, ends, np.nan), np.insert(run.positions, ends, np.nan), "k-",
                 lw=1, label="free runs")  # fmt: skip
    axes[0].set_ylabel(f"position [{length}]")
    legend_above(axes[0])
    title_above(axes[0], f"{run.axis.name}: free runs" if title is None else title)
    axes[1].plot(np.insert(record.t, ends, np.nan), np.insert(run.errors, ends, np.nan), "-",
                 color="C3", lw=0.8, label="free runs less measured")  # fmt: skip
    axes[1].set_ylabel(f"error [{length}]")
    legend_above(axes[1])
    axes[1].set_xlabel("Time [s]")
    return control_plot(axes)


def plot_loop(run: LoopReplay, ax: Any, title: str | None = None) -> ct.ControlPlot:
    """Position, its error, and drive force of a replayed loop."""
    axes = axes_of(ax, 3)
    length, force = run.units
    t, y = run.record.t, run.response.y
    axes[0].plot(t, run.record.x, ".", color=GREY, ms=3, label="measured")
    axes[0].plot(t, y[0], "k-", lw=1, label="model")
    axes[0].set_ylabel(f"position [{length}]")
    axes[1].plot(t, y[0] - run.record.x, "-", color="C3", lw=0.8, label="model less measured")
    axes[1].set_ylabel(f"error [{length}]")
    axes[2].plot(t, run.record.u, ".", color=GREY, ms=4, label="measured")
    axes[2].plot(t, y[4], "k-", lw=0.8, label="model")
    axes[2].set_ylabel(f"drive force [{force}]")
    for one in axes:
        legend_above(one)
    title_above(axes[0], str(run.response.title) if title is None else title)
    axes[2].set_xlabel("Time [s]")
    return control_plot(axes)


def plot_slow_ramp(ramp: SlowRamp, ax: Any, title: str | None = None) -> ct.ControlPlot:
    """Reference and position; drive force."""
    axes = axes_of(ax, 2)
    length, force = ramp.axis.units
    record = ramp.record
    axes[0].plot(record.t, record.x, "-", color=GREY, lw=2.5, label="position")
    axes[0].plot(record.t, ramp.reference, "--", color="C0", lw=1, label="reference")
    axes[0].set_ylabel(f"position [{length}]")
    legend_above(axes[0])
    title_above(axes[0], (record.name or "slow ramp") if title is None else title)
    axes[1].plot(record.t, record.u, "-", color="0.4", lw=0.8)
    axes[1].set_ylabel(f"drive force [{force}]")
    axes[1].set_xlabel("Time [s]")
    return control_plot(axes)


def plot_coulomb(found: CoulombIdentification, ax: Any, title: str | None = None) -> ct.ControlPlot:
    """Forces of the pieces of motion, levels with their bands."""
    axes = axes_of(ax, 1, figsize=(7.0, 4.2))
    length, force = found.units
    pieces = found.pieces
    axes[0].plot(pieces.x, pieces.u, ".", color=GREY, ms=4, label="measured, per piece of motion")
    places = np.linspace(*found.travel, 300)
    for s in (1, -1):
        low, high = found.band(places, s)
        axes[0].fill_between(places, s * low, s * high, color="C0", alpha=0.25, lw=0,
                             label="90 % band" if s == 1 else None)  # fmt: skip
        axes[0].plot(places, s * found(places, s), "-", color="C0", lw=1.5,
                     label="Coulomb level" if s == 1 else None)  # fmt: skip
    axes[0].set_xlabel(f"position [{length}]")
    axes[0].set_ylabel(f"drive force [{force}]")
    legend_above(axes[0])
    title_above(axes[0], "Coulomb level over the travel" if title is None else title)
    return control_plot(axes)


def plot_stribeck(
    found: StribeckIdentification, ax: Any, title: str | None = None
) -> ct.ControlPlot:
    """Drive force over position and over time, measured and replayed."""
    axes = axes_of(ax, 2, sharex=False, figsize=(7.0, 6.0))
    length, force = found.axis.units
    record = found.fit.training[0].windows.record
    some = slice(None, None, max(1, len(record) // 20_000))
    axes[0].plot(record.x[some], record.u[some], ".", color=GREY, ms=2, label="measured")
    axes[1].plot(record.t[some], record.u[some], ".", color=GREY, ms=2)
    if found.loop is not None:
        y = found.loop.response.y
        axes[0].plot(y[0][some], y[4][some], "k-", lw=0.8, label="model in the same loop")
        axes[1].plot(record.t[some], y[4][some], "k-", lw=0.8)
    places = np.linspace(float(record.x.min()), float(record.x.max()), 200)
    for s in (1, -1):
        axes[0].plot(places, s * found.axis.coulomb(places, s), "--", color="C2", lw=1,
                     label="Coulomb level" if s == 1 else None)  # fmt: skip
        axes[0].plot(places, s * found.axis.breakaway(places, s), ":", color="C3", lw=1,
                     label="break-away level" if s == 1 else None)  # fmt: skip
    axes[0].set_xlabel(f"position [{length}]")
    axes[1].set_xlabel("Time [s]")
    for one in axes:
        one.set_ylabel(f"drive force [{force}]")
    legend_above(axes[0])
    title_above(axes[0], f"{found.axis.name}: stick-slip" if title is None else title)
    if found.measured is not None:
        # A dozen periods: the whole record would hide the ripple.
        middle = float(record.t[len(record) // 4])
        reach = 6.0 * found.measured.period
        shown = (record.t > middle - reach) & (record.t < middle + reach)
        axes[1].set_xlim(record.t[shown][0], record.t[shown][-1])
        low, high = record.u[shown].min(), record.u[shown].max()
        axes[1].set_ylim(low - 0.2 * (high - low), high + 0.2 * (high - low))
    return control_plot(axes)
