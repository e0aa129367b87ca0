"""Diagnose a measured drive and draw the result: ``python docs/make_emps.py DATA_EMPS.mat``.

The record is the EMPS benchmark (A. Janot, M. Gautier, M. Brunot, "Data set and reference
models of EMPS", Workshop on Nonlinear System Identification Benchmarks, 2019), to be had from
nonlinearbenchmark.org.  The first 40 % are diagnosed from the published symmetric model with
its offset; the picture and the last lines printed are of the other 60 %.
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np

import dryfric_control as dfc
from dryfric_control.diagnosis.evidence import Evidence, evidence
from dryfric_control.model.friction_curve import friction_over_velocity

IMAGE = Path(__file__).resolve().parent / "images" / "emps.png"
DATA = Path(__file__).resolve().parents[2] / "shared" / "data" / "emps" / "DATA_EMPS.mat"


# Slower than this, friction is one of rest, and the smoothing of the readings shows [m/s].
SLOW = 1e-3


def median(seen: Evidence) -> float:
    """Median error of free runs [µm]."""
    return 1e6 * float(np.median(seen.error_by_window))


def draw(before: Evidence, after: Evidence) -> plt.Figure:
    """Friction over velocity, and errors, both before and after, on unseen data."""
    figure, (left, middle, right) = plt.subplots(
        1, 3, figsize=(9.0, 3.4), width_ratios=(2.6, 1.0, 1.0), layout="constrained"
    )
    rows = (
        (before, "C3", "published model, offset included"),
        (after, "C0", "with the causes found in the other 40 %"),
    )
    smooth, record = after.record.derivatives(), after.record
    sliding = np.abs(smooth.v) > SLOW
    friction = (record.u - after.axis.mass * smooth.a)[sliding][::4]
    left.plot(1e3 * smooth.v[sliding][::4], friction, ".", color="0.7", markersize=1.5,
              label="measured: drive force less inertia")  # fmt: skip
    fastest, middle_of_travel = np.abs(smooth.v).max(), float(np.mean(record.x))
    v = np.concatenate([np.linspace(-fastest, -1e-6, 200), np.linspace(1e-6, fastest, 200)])
    for seen, colour, label in rows:
        # What the drive has to overcome: friction, less a force that always acts.
        force = friction_over_velocity(seen.axis, v, middle_of_travel)
        force -= seen.axis.named_effects()["bias_force"].force
        left.plot(1e3 * v, force, color=colour, linewidth=1.5, label=label)
    left.set(xlabel="velocity [mm/s]", ylabel="friction force [N]")
    left.legend(frameon=False, loc="lower right", fontsize="small", markerscale=4)
    pairs = (
        (middle, "force residual\nRMS [N]", [seen.force_rms for seen, *_ in rows], "%.2f"),
        (right, "free runs of 0.25 s\nmedian RMS [µm]", [median(seen) for seen, *_ in rows],
         "%.0f"),
    )  # fmt: skip
    for panel, title, values, form in pairs:
        bars = panel.bar(["before", "after"], values, color=["C3", "C0"], width=0.6)
        panel.bar_label(bars, fmt=form, padding=2)
        panel.set_title(title, fontsize="medium")
        panel.set_yticks([])
        panel.margins(y=0.15)
    for panel in (left, middle, right):
        panel.spines[["top", "right"]].set_visible(False)
    return figure


def main() -> None:
    """Diagnose, print, draw."""
    record = dfc.datasets.emps(sys.argv[1] if len(sys.argv) > 1 else DATA)
    first, rest = record.split(0.4)
    axis = dfc.datasets.emps_axis()
    d = dfc.diagnose(axis, first)
    print(d)
    before, after = evidence(axis, rest), evidence(d.extended, rest)
    print(
        f"other 60 %: force residual {before.force_rms:.2f} N RMS before, "
        f"{after.force_rms:.2f} N after"
    )
    print(
        f"free runs of 0.25 s: median {median(before):.1f} um before, {median(after):.1f} um after"
    )
    figure = draw(before, after)
    figure.suptitle("EMPS linear drive, the 60 % of the record that was not used", fontsize="large")
    figure.savefig(IMAGE, dpi=110)


if __name__ == "__main__":
    main()
