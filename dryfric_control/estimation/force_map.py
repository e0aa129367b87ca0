"""What remains of the drive, over position, velocity, drive, time and distance since a reversal."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from dryfric_control.arrays import Floats
from dryfric_control.checks import instance, one_of
from dryfric_control.drawing import (
    TIME_LABEL,
    PanelPlot,
    axes_of,
    control_plot,
    label_axes,
    title_above,
)
from dryfric_control.estimation.smoothed_motion import (
    SmoothedMotion,
    distance_since_reversal,
    drive_at_the_mass,
    known_force,
    missing_force,
)
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.records.record import Record
from dryfric_control.text import Result, documented, percent, percent_of_drive, stated
from dryfric_control.units import check_units

# Number of bins of a curve.
_BINS = 24
# Fewest samples of a bin that is shown.
_FEWEST = 5
# Quantiles of the force in a bin that its band spans.
_BAND = (0.1, 0.9)
# Opacity of the band.
_SHADE = 0.15

#: Names of the curves and what they are drawn over.
OVER = {
    "place": "position",
    "velocity": "velocity",
    "drive": "drive",
    "time": "time",
    "after_reversal": "distance since reversal",
}


@documented
@dataclass(frozen=True)
class ForceCurve:
    """Force that is missing, over one quantity and in one direction of motion.

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.4, viscous=12.0, coulomb=9.0)
    >>> curve = dfc.datasets.belt_stage().force_map(axis).curves["place"][0]
    >>> curve.direction, curve.at.shape == curve.force.shape
    (1, True)
    """

    direction: int = stated("+1 or -1.")
    at: Floats = stated("Middle of each bin, shape (nbins,).")
    force: Floats = stated("Median force that is missing in each bin [N], shape (nbins,).")
    low: Floats = stated("10 % quantile in each bin [N], shape (nbins,).")
    high: Floats = stated("90 % quantile in each bin [N], shape (nbins,).")


@documented
@dataclass(frozen=True, repr=False)
class ForceMap(Result):
    """What remains of the drive where an axis slides: the force that a model lacks.

    Notes
    -----
    .. math:: S (m a + f v + F(x, v) - u)

    with one smoothing kernel S for all terms: motion and drive are compared in the band in which
    the acceleration is known.  A force that the axis needs beyond its drive is positive where it
    pushes towards positive x.  Rest and a few samples around each reversal are left out.

    Examples
    --------
    The belt stage that ships has a force of its teeth and friction that is higher forwards:

    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.4, viscous=12.0, coulomb=9.0)
    >>> found = dfc.datasets.belt_stage().force_map(axis)
    >>> round(found.rms, 1), found.units
    (1.5, ('m', 'N'))
    """

    rms: float = stated("RMS of the force that is missing [N].")
    drive_rms: float = stated("RMS of the drive in the same samples [N].")
    share_sliding: float = stated("Share of the samples from which the curves are made.")
    width: float = stated("Standard deviation of the smoothing kernel [s].")
    curves: dict[str, tuple[ForceCurve, ...]] = stated(
        'Curves over "place", "velocity", "drive", "time" and "after_reversal", one a direction.'
    )
    units: tuple[str, str] = stated("Units of position and force.")

    _told = ("rms", "drive_rms", "share_sliding", "width", "curves", "units")

    def _summary_parts(self) -> list[str]:
        force = self.units[1]
        return [
            f"force missing in the model: {self.rms:.3g} {force} RMS, "
            f"{percent_of_drive(self.rms, self.drive_rms)}",
            f"from {percent(self.share_sliding)} of the samples: rest and reversals are left out",
        ]

    def unit_over(self, name: str) -> str:
        """Unit of what a curve is drawn over."""
        length, force = self.units
        return {"velocity": f"{length}/s", "drive": force, "time": "s"}.get(name, length)

    def plot(self, ax: Any = None, title: str | None = None) -> PanelPlot:
        """Draw the curves with their bands, one panel each.

        A curve is the median of the force in bins of as many samples each; its band holds the
        samples between the 10 % and the 90 % quantile.

        Parameters
        ----------
        ax : sequence of five Axes, optional
            Where to draw.  Default: a new figure.
        title : str, optional
            Title.  Default: the RMS of the force that is missing.

        Returns
        -------
        control.ControlPlot
        """
        axes = axes_of(ax, len(OVER), title, sharex=False, sharey=True, figsize=(7.0, 9.0))
        self.draw(axes)
        own = f"Force missing in the model: {self.rms:.3g} {self.units[1]} RMS"
        title_above(axes[0], own if title is None else title)
        return control_plot(axes)

    def draw(self, axes: Any, colours: tuple[str, str] = ("C0", "C1"), label: str = "") -> None:
        """Draw the curves in given axes."""
        # One entry for the bands of both directions.
        words = f"{' to '.join(map(percent, _BAND))} of the samples"
        axes[0].fill_between([], [], color="0.5", alpha=_SHADE, lw=0, label=words)
        for one, (name, words) in zip(axes, OVER.items(), strict=True):
            for curve in self.curves[name]:
                colour = colours[0 if curve.direction > 0 else 1]
                way = "forwards" if curve.direction > 0 else "backwards"
                one.fill_between(curve.at, curve.low, curve.high, color=colour, alpha=_SHADE, lw=0)
                one.plot(curve.at, curve.force, color=colour, lw=1.4, label=f"{label}{way}")
            one.axhline(0.0, color="0.7", lw=0.8, zorder=0)
            over = TIME_LABEL if name == "time" else f"{words} [{self.unit_over(name)}]"
            label_axes(one, over, f"force [{self.units[1]}]", legend=one is axes[0])


def force_map(axis: FrictionAxis, record: Record, hold: str = "zero") -> ForceMap:
    """What remains of the drive of a record, see `Record.force_map`."""
    instance("axis", axis, FrictionAxis)
    instance("record", record, Record)
    one_of("hold", hold, ("zero", "first"))
    check_units(axis, record, "record")
    axis = axis.effective()
    motion = SmoothedMotion.from_record(record, axis.mass)
    u = drive_at_the_mass(axis, record, hold)
    known = known_force(record, hold)
    columns = np.stack((missing_force(axis, motion, u, known), u), axis=1)
    missing, drive = motion.smooth_columns(columns).T
    at = motion.places
    way = motion.direction[at]
    over = {
        "place": record.x[at],
        "velocity": motion.v[at],
        "drive": drive,
        "time": record.t[at],
        "after_reversal": distance_since_reversal(record.x, motion.direction)[at],
    }
    curves = {}
    for name, values in over.items():
        sides = [
            _quantile_curve(side, values[way == side], missing[way == side]) for side in (1, -1)
        ]
        curves[name] = tuple(curve for curve in sides if curve is not None)
    length, force = axis.units
    return ForceMap(
        rms=float(np.sqrt(np.mean(missing**2))) if at.size else 0.0,
        drive_rms=float(np.sqrt(np.mean(drive**2))) if at.size else 0.0,
        share_sliding=at.size * max(int(motion.width), 1) / len(record),
        width=motion.width * record.dt,
        curves=curves,
        units=(length, force),
    )


def _quantile_curve(direction: int, at: Floats, force: Floats) -> ForceCurve | None:
    """Quantiles of a force in bins; None where too few samples are."""
    if at.size < _FEWEST:
        return None
    # As many samples in each bin: a few fast ones must not take most of the axis.
    edges = np.unique(np.quantile(at, np.linspace(0.0, 1.0, _BINS + 1)))
    bins = np.clip(np.searchsorted(edges, at, side="right") - 1, 0, edges.size - 2)
    rows = [
        (0.5 * (edges[k] + edges[k + 1]), np.median(part), *np.quantile(part, _BAND))
        for k in range(edges.size - 1)
        if (part := force[bins == k]).size >= _FEWEST
    ]
    return ForceCurve(direction, *np.array(rows).T) if rows else None
