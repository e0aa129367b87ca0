"""Replay a record: windowed free runs, and the whole closed loop."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from dryfric_control.arrays import Floats
from dryfric_control.checks import finite, instance
from dryfric_control.drawing import MEASURED, TIME_LABEL, label_axes, panels
from dryfric_control.estimation.windows import Windows, cut
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.model.loops import PositionController, simulate_loop
from dryfric_control.model.responses import SimulationResponse
from dryfric_control.records.read import RecordLike, as_record
from dryfric_control.records.record import Record
from dryfric_control.records.record_arguments import HOW_TO_GIVE, axis_first
from dryfric_control.records.resolution import QUANTA
from dryfric_control.text import Result, length_text, prefix_unit
from dryfric_control.units import check_units


@dataclass(frozen=True, eq=False, repr=False)
class Replay(Result):
    """Errors of windowed free runs over a record; made by `replay`."""

    axis: FrictionAxis  # that ran
    windows: Windows  # and their starts
    positions: Floats  # of the free runs at every sample, shape (n,)
    rms_by_window: Floats  # RMS error of position in each window
    quantum: float  # of the encoder, or where it shows none, noise times sqrt(12)

    @property
    def errors(self) -> Floats:
        """Simulated minus measured position at every sample, shape (n,)."""
        return np.asarray(self.positions - self.windows.record.x)

    @property
    def rms(self) -> float:
        """RMS error over all samples."""
        return _rms(self.errors)

    @property
    def median(self) -> float:
        """Median over the windows of the RMS error."""
        return float(np.median(self.rms_by_window))

    @property
    def score(self) -> float:
        """Mean over the windows of log(1 + (RMS error/quantum)^2)."""
        return float(np.mean(np.log1p((self.rms_by_window / self.quantum) ** 2)))

    def _summary_parts(self) -> list[str]:
        record = self.windows.record
        windows = self.windows
        errors = self.rms, self.median, float(self.rms_by_window.max())
        rms, median, most = (length_text(one, self.axis.units[0]) for one in errors)
        name = f"{record.name}: " if record.name else ""
        return [
            f"{name}free runs of {windows.samples[0] * record.dt:.3g} s, started from the smoothed "
            f"record ({len(windows)} windows from {record.t[0]:.4g} s to {record.t[-1]:.4g} s): "
            f"RMS error {rms} ({self.rms / self.quantum:.3g} quanta), median {median}, worst {most}"
        ]

    def to_dict(self) -> dict[str, Any]:
        """Numbers of the replay, ready for JSON."""
        worst = float(self.rms_by_window.max())
        times = self.windows.start_times.tolist()
        numbers = {"rms": self.rms, "median": self.median, "worst": worst, "quantum": self.quantum}
        windows = {"start_times": times, "rms_by_window": self.rms_by_window.tolist()}
        return numbers | {"score": self.score} | windows

    @panels(2)
    def plot(self, axes: Any) -> str:
        """Draw measured position and free runs, and their errors."""
        record = self.windows.record
        length = self.axis.units[0]
        # A gap at each restart, so that a run is not joined to the next.
        ends = self.windows.edges[1:-1]
        lines = (record.t, self.positions, self.errors)
        t, runs, errors = (np.insert(one, ends, np.nan) for one in lines)
        axes[0].plot(record.t, record.x, ".", color=MEASURED, ms=3, label="measured")
        axes[0].plot(t, runs, "k-", lw=1, label="free runs")
        label_axes(axes[0], y=f"position [{length}]")
        _draw_error(axes[1], t, errors, length)
        axes[1].set_xlabel(TIME_LABEL)
        return f"{self.axis.name}: free runs"


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _draw_error(ax: Any, t: Any, error: Any, unit: str) -> None:
    """Error of position over time, in a unit in which it is readable."""
    factor, unit = prefix_unit(0.1 * float(np.nanmax(np.abs(error))), unit)
    ax.plot(t, error / factor, "-", color="C3", lw=0.8, label="simulated - measured")
    label_axes(ax, y=f"error [{unit}]")


@axis_first
def replay(
    axis: FrictionAxis,
    record: RecordLike,
    window: float = 0.25,
    hold: str = "zero",
    *,
    shift: float = 0.0,
) -> Replay:
    """Simulate an axis freely over short windows of a record.

    Parameters
    ----------
    axis : FrictionAxis
        The axis.
    record : Record or path-like
        The record: its input drives the runs, its position judges them.
    window : float, optional
        Length of a window [s].
    hold : {"zero", "first"}, optional
        Whether the recorded input is held or runs linearly between samples.
    shift : float, optional
        Time by which the input acts later than recorded [s].

    Raises
    ------
    ValueError
        If the window holds fewer than 5 samples or more than the record, or for several records.

    Notes
    -----
    Each window starts from the smoothed record: a replay from one start would integrate every
    small force error twice, for the whole time, and measure little else.

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> errors = dfc.replay(dfc.datasets.belt_stage_axis(), dfc.datasets.belt_stage())
    >>> errors.median > 10.0 * errors.quantum
    True
    """
    instance("axis", axis, FrictionAxis, HOW_TO_GIVE)
    shift = finite("shift", shift, unit="s")
    _refuse_several(record, "dfc.replay(axis, one)")
    record = as_record(record)
    windows = cut(record, window, hold)
    check_units(axis, record)
    positions = windows.run(axis, shift)
    quantum = record.quantum or QUANTA * record.resolution.deviation
    rms = np.sqrt(windows.mean_squares(positions - record.x))
    return Replay(axis, windows, positions, rms, float(quantum))


@dataclass(frozen=True, eq=False, repr=False)
class LoopReplay(Result):
    """Whole closed loop replayed from its reference; made by `replay_loop`."""

    record: Record  # what was measured
    response: SimulationResponse  # what the model's loop did; outputs x, v, F, mode, u, y
    units: tuple[str, str]
    _told = ("position_rms", "force_rms", "relative_force")

    @property
    def position_rms(self) -> float:
        """RMS of modelled minus measured position."""
        return _rms(self.response.y[0] - self.record.x)

    @property
    def force_rms(self) -> float:
        """RMS of modelled minus measured drive force."""
        return _rms(self.response.y[4] - self.record.u)

    @property
    def relative_force(self) -> float:
        """RMS error of the drive force relative to its RMS."""
        return self.force_rms / _rms(self.record.u)

    def _summary_parts(self) -> list[str]:
        worst = float(np.max(np.abs(self.response.y[0] - self.record.x)))
        rms, most = (length_text(one, self.units[0]) for one in (self.position_rms, worst))
        return [
            f"closed loop over {self.record.duration:.4g} s: position RMS error {rms}, worst "
            f"{most}; drive force RMS error {self.force_rms:.3g} {self.units[1]} "
            f"({100 * self.relative_force:.2f} %)"
        ]

    @panels(3)
    def plot(self, axes: Any) -> str:
        """Draw position, its error and drive force, measured and replayed."""
        length, force = self.units
        t = self.record.t
        y = self.response.y
        axes[0].plot(t, self.record.x, ".", color=MEASURED, ms=3, label="measured")
        axes[0].plot(t, y[0], "k-", lw=1, label="model")
        label_axes(axes[0], y=f"position [{length}]")
        _draw_error(axes[1], t, y[0] - self.record.x, length)
        axes[2].plot(t, self.record.u, ".", color=MEASURED, ms=4, label="measured")
        axes[2].plot(t, y[4], "k-", lw=0.8, label="model")
        label_axes(axes[2], TIME_LABEL, f"drive force [{force}]")
        return str(self.response.title)


def replay_loop(axis: FrictionAxis, record: Record, controller: PositionController) -> LoopReplay:
    """Replay a record's whole closed loop with its controller.

    Parameters
    ----------
    axis : FrictionAxis
        The axis.
    record : Record
        The record; its `reference` drives the loop.
    controller : PositionController
        The controller that ran when the record was taken, in the record's units of force.

    Raises
    ------
    ValueError
        If the record has no reference, or another sampling time than the controller.

    Examples
    --------
    >>> import numpy as np
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    >>> loop = dfc.PositionController(kp=2000.0, ki=0.0, kd=90.0, dt=1e-3)
    >>> r = 0.1 * np.sin(3e-3 * np.arange(3000))
    >>> done = dfc.simulate_loop(axis, loop, r)
    >>> record = dfc.Record(done.t, done.y[4], done.y[5], r)
    >>> dfc.replay_loop(axis, record, loop).position_rms < 1e-6
    True
    """
    instance("axis", axis, FrictionAxis)
    _refuse_several(record, "dfc.replay_loop(axis, one, controller)")
    instance("record", record, Record)
    instance("controller", controller, PositionController)
    check_units(axis, record)
    if record.reference is None:
        raise ValueError("record has no reference: a closed loop cannot be replayed without")
    if abs(controller.dt - record.dt) > 1e-6 * record.dt:
        raise ValueError(
            f"controller.dt is {controller.dt:g} s and the record's step {record.dt:g} s: they "
            "must agree"
        )
    start = record.derivatives()
    quantum = record.quantum or 0.0
    x0 = float(start.x[0])
    v0 = float(start.v[0])
    response = simulate_loop(axis, controller, record.reference, quantum=quantum, x0=x0, v0=v0)
    return LoopReplay(record, response, axis.units)


def _refuse_several(record: Any, call: str) -> None:
    """Refuse several records, which `fit` and `diagnose` take, with the call for each."""
    if isinstance(record, (list, tuple)):
        raise ValueError(
            f"record must be a single Record, got {len(record)} in a {type(record).__name__}: "
            f"replay one at a time, [{call} for one in records]"
        )
