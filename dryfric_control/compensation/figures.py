"""The figure of a compensation: reference, error with its tube, drive."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import control as ct
import numpy as np

from dryfric_control.drawing import (
    axes_of,
    control_plot,
    legend_above,
    shade_stuck,
    title_above,
)
from dryfric_control.model.loops import simulate_loop
from dryfric_control.model.profiles import MotionProfile, motion_profile

if TYPE_CHECKING:
    from dryfric_control.compensation.design import Compensation


def plot_compensation(
    comp: Compensation, ax: Any, title: str | None, reference: MotionProfile | None
) -> ct.ControlPlot:
    """Draw a simulated run of the nominal axis.

    Parameters
    ----------
    comp : Compensation
        What to draw.
    ax : sequence of three Axes or None
        Where to draw.
    title : str or None
        Title.
    reference : MotionProfile or None
        Reference to follow.

    Returns
    -------
    control.ControlPlot
    """
    length, force = comp.axis.units
    if reference is None:
        reference = _there_and_back(comp)
    run = simulate_loop(comp.axis, comp.controller, reference, quantum=comp.encoder_quantum)
    bound = comp.certify(reference=reference).tube
    axes = axes_of(ax, 3)
    axes[0].plot(run.t, reference.position, color="0.55", label="reference")
    axes[0].plot(run.t, run.y[0], "k", linewidth=1.0, label="axis")
    error = reference.position - run.y[0]
    axes[1].plot(run.t, error, "k", linewidth=1.0, label="error")
    if np.isfinite(bound):
        for side in (-bound, bound):
            axes[1].axhline(side, color="C3", linestyle="--", linewidth=1.0)
        axes[1].lines[-1].set_label("tube")
    axes[2].plot(run.t, run.y[4], "k", linewidth=1.0, label="drive u")
    axes[2].plot(run.t, run.y[2], "C0--", linewidth=1.0, label="friction")
    labels = (f"position [{length}]", f"error [{length}]", f"force [{force}]")
    for one, label in zip(axes, labels, strict=True):
        shade_stuck(one, run.t, run.y[3])
        one.set_ylabel(label)
        one.margins(x=0.0)
        legend_above(one)
    axes[-1].set_xlabel("Time [s]")
    title_above(axes[0], f"{comp.axis.name}: compensation" if title is None else title)
    return control_plot(axes)


def _there_and_back(comp: Compensation) -> MotionProfile:
    """Move of about a second, on the scale that the controller's bandwidth gives."""
    axis, w = comp.rigid_axis, comp.bandwidth
    # A tenth of the acceleration that friction could cause, over a third of a second.
    push = max(float(np.max(comp.axis.breakaway(0.0, 1))), axis.mass * comp.tolerance * w**2)
    a = 0.1 * push / axis.mass
    way = 0.02 * a if axis.travel is None else min(0.02 * a, 0.4 * float(np.ptp(axis.travel)))
    middle = 0.0 if axis.travel is None else float(np.mean(axis.travel)) - 0.5 * way
    return motion_profile(
        [middle, middle + way, middle, middle + way], comp.dt, velocity=0.3 * a,
        acceleration=a, jerk=20.0 * a, dwell=[0.1, 0.0, 0.0, 0.4],
    )  # fmt: skip
