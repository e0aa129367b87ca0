"""The switched PI observer at work: block, whole-record run, stepper of one compiled sample."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import control as ct
import numpy as np
from numpy.typing import ArrayLike

from dryfric_control import drawing
from dryfric_control.arrays import Floats, Ints
from dryfric_control.checks import finite, instance, one_of, positive, samples
from dryfric_control.compiled import observer as kernel
from dryfric_control.compiled.windowed_runs import NO_FORCE
from dryfric_control.model.block import Block
from dryfric_control.model.responses import Response
from dryfric_control.observer.design import ObserverDesign
from dryfric_control.order import check_drive_and_reading
from dryfric_control.units import check_units

SWITCHING = {"reading": kernel.READING, "paper": kernel.PAPER, "filippov": kernel.FILIPPOV}
OUTPUTS = ("xhat", "vhat", "Fhat", "what", "mode")
#: How far the reading must leave the place of rest to count as motion, in
#: increments: more than one, since an axis at rest on an edge toggles by one.
_INCREMENTS = 1.5
#: Time over which the error of the Coulomb level is learned, in time constants
#: of the observer: long against its noise, short against one motion.
_LEARNING = 8.0


class Tables(NamedTuple):
    """A design as the arrays that the compiled observer reads."""

    numbers: Floats
    matrices: Floats  # shape (3, 6), one row a mode
    gains: Floats  # shape (nnodes, 3)
    transitions: Ints  # shape (nnodes + 1, 3)
    axis_numbers: Floats
    axis_integers: Ints


class Estimate(NamedTuple):
    """What the observer states at one sample."""

    x: float  # position
    v: float  # speed
    F: float  # friction force
    w: float  # integral term, minus the friction error
    mode: int  # 0 stuck, +1 and -1 sliding


def tables(
    design: ObserverDesign, switching: str = "reading", encoder_quantum: float | None = None
) -> Tables:
    """Arrays of a design for the compiled observer."""
    instance("design", design, ObserverDesign, "made by dfc.design_pi_observer")
    one_of("switching", switching, SWITCHING)
    axis, quantum = design.axis, encoder_quantum
    if quantum is None:
        quantum = design.encoder_quantum
    quantum = positive("encoder_quantum", quantum, unit=axis.unit("m"), zero=True)
    resolution = _INCREMENTS * quantum + axis.stick_speed / axis.stick_rate
    keep = design.certificate.spectral_radius[1] ** (1.0 / _LEARNING)
    rule, current = SWITCHING[switching], design.form == "current"
    numbers = np.array([design.dt, axis.stick_speed, resolution, keep, rule, current], dtype=float)
    matrices = np.empty((3, 6))
    for mode in (-1, 0, 1):
        A, B, E = design.mode_matrices(mode)
        matrices[mode + 1] = A[0, 1], A[1, 1], *B, *E
    gains = np.ascontiguousarray(design.node_gains, dtype=float)
    transitions = np.vstack([design.transition_table(), design.resting_nodes()]).astype(np.int64)
    return Tables(numbers, matrices, gains, transitions, *axis.arrays(design.dt)[:2])


def first_memory(
    design: ObserverDesign, xhat0: float = 0.0, vhat0: float = 0.0, what0: float = 0.0
) -> Floats:
    """Memory of an observer before its first sample, shape (nstates,)."""
    history = int(design.axis.arrays(design.dt).integers[kernel.axis_step.N_HISTORY])
    memory = np.zeros(kernel.LINE + history)
    memory[kernel.XHAT] = finite("xhat0", xhat0)
    memory[kernel.VHAT] = finite("vhat0", vhat0)
    memory[kernel.WHAT] = finite("what0", what0)
    return memory


class ObserverResponse(Response):
    """A `control.TimeResponseData` with outputs xhat, vhat, Fhat, what, mode, and states."""

    def __init__(
        self, time: Floats, outputs: Floats, inputs: Floats, units: tuple[str, str], title: str
    ) -> None:
        labels = {"output_labels": list(OUTPUTS), "input_labels": ["u", "y"]}
        labels["state_labels"] = ["xhat", "vhat", "what"]
        super().__init__(time, outputs, outputs[[0, 1, 3]], inputs, units, title=title, **labels)

    @drawing.panels(3)
    def plot(self, axes: Any) -> str:
        """Draw the estimates over time, scaled after 0.1 s, estimated rest as a light band."""
        length, force = self.units
        axes[0].plot(self.t, self.u[1], ".", color=drawing.MEASURED, markersize=2, label="reading")
        axes[1].plot(self.t, self.y[1], "C0--", linewidth=1.0)
        axes[0].plot(self.t, self.y[0], "C0--", linewidth=1.0, label="estimate")
        axes[2].plot(self.t, self.u[0], color="0.55", linewidth=1.0, label="drive u")
        axes[2].plot(self.t, self.y[2], "C0--", linewidth=1.0, label="friction, estimate")
        names = (f"position [{length}]", f"velocity [{length}/s]", f"force [{force}]")
        shown = ((self.u[1], self.y[0]), (self.y[1],), (self.u[0], self.y[2]))
        for one, signals in zip(axes, shown, strict=True):
            drawing.settled_scale(one, self.t, *signals)
            drawing.shade_stuck(one, self.t, self.y[4])
        drawing.over_time(axes, names)
        drawing.legend_above(axes[0])
        drawing.legend_above(axes[2])
        return str(self.title)


def observe(
    design: ObserverDesign,
    u: Any,
    y: ArrayLike | None = None,
    *,
    xhat0: float | None = None,
    vhat0: float = 0.0,
    what0: float = 0.0,
    switching: str = "reading",
    encoder_quantum: float | None = None,
) -> ObserverResponse:
    """Run the observer over a whole record, compiled.

    Parameters
    ----------
    design : ObserverDesign
    u : array_like, shape (n,), or Record
        Drive force at the samples [N]; a record, whose step and units must be those of the design,
        brings `y`, and its known load, with it.
    y : array_like, shape (n,), optional
        Measured position at the samples [m].
    xhat0 : float, optional
        First estimate of the position [m].  Default: the first reading.
    vhat0, what0 : float, optional
        First velocity [m/s] and integral term [N].
    switching, encoder_quantum
        As for `pi_observer`.

    Returns
    -------
    ObserverResponse
        Outputs xhat, vhat, Fhat, what, mode, each of shape (n,).

    Examples
    --------
    >>> import numpy as np
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    >>> design = dfc.design_pi_observer(axis, dt=1e-3, encoder_quantum=1e-5)
    >>> u = 12.0 * np.sin(np.arange(4000) * 3e-3)
    >>> plant = axis.simulate(u, dt=1e-3)
    >>> estimate = dfc.observe(design, u, plant.y[0], encoder_quantum=1e-5)
    >>> bool(np.mean(estimate.mode != plant.mode) < 0.02)
    True
    """
    arrays = tables(design, switching, encoder_quantum)
    time, inputs, known = drive_and_reading("design", design, u, y)
    memory = first_memory(design, inputs[1, 0] if xhat0 is None else xhat0, vhat0, what0)
    out = np.empty((time.size, kernel.OUTPUTS))
    kernel.run(*arrays, memory, *inputs, known, out)
    title = f"{design.axis.name}: switched PI observer"
    return ObserverResponse(time, np.ascontiguousarray(out.T), inputs, design.axis.units, title)


def drive_and_reading(name: str, made: Any, u: Any, y: Any) -> tuple[Floats, Floats, Floats]:
    """Time, drive and reading, known load, of arrays or a record, for an estimator with axis."""
    start, known = 0.0, NO_FORCE
    if hasattr(u, "units") and hasattr(u, "dt"):  # a record; no room imports both
        if y is not None:
            raise ValueError("y must be left out where u is a record: it holds its positions")
        check_units(made.axis, u)
        if abs(u.dt / made.dt - 1.0) > 1e-6:
            raise ValueError(
                f"record.dt is {u.dt:g} s and {name}.dt {made.dt:g} s: design with "
                f"dt={u.dt:g}, or pass record.resampled({made.dt:g})"
            )
        start, known, u, y = float(u.t[0]), u.known_force, u.u, u.x
    elif y is None:
        raise ValueError("y is missing: give u and y, or a Record in place of both")
    drive, reading = samples("u", u), samples("y", y)
    if drive.size != reading.size:
        raise ValueError(
            f"u has {drive.size} samples and y {reading.size}: give one of each at every sample"
        )
    check_drive_and_reading(made.axis, made.dt, drive, reading)
    return start + np.arange(drive.size) * made.dt, np.vstack([drive, reading]), known


def pi_observer(
    design: ObserverDesign,
    *,
    switching: str = "reading",
    encoder_quantum: float | None = None,
    name: str = "observer",
) -> ct.NonlinearIOSystem:
    """The switched PI observer as a sampled block.

    Parameters
    ----------
    design : ObserverDesign
        The observer: its gains, its own Coulomb maps, effects and stick velocity.
    switching : {"reading", "paper", "filippov"}, optional
        Rule of the mode, see Notes.
    encoder_quantum : float, optional
        Increment of the position sensor [m], by which "reading" detects motion.  Default: the
        design's.
    name : str, optional

    Returns
    -------
    control.NonlinearIOSystem
        Inputs u, y; outputs xhat, vhat, Fhat, what, mode.  The first three states are xhat, vhat,
        what; the others start at zero.  `observe` is far faster.

    Notes
    -----
    ``switching="reading"``, the default, lets the measurement decide the mode, "paper" the printed
    automaton, "filippov" the same completed as in `FrictionAxis`; the page on the observer has the
    equations and the rules.  None can distinguish creeping below an increment per few samples from
    rest.

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    >>> block = dfc.pi_observer(dfc.design_pi_observer(axis, dt=1e-3))
    >>> block.input_labels, block.output_labels
    (['u', 'y'], ['xhat', 'vhat', 'Fhat', 'what', 'mode'])
    """
    arrays = tables(design, switching, encoder_quantum)
    length = first_memory(design).size

    def step(t: float, memory: Floats, u: Any) -> Floats:
        out = np.empty(kernel.OUTPUTS)
        kernel.step(*arrays, memory, t, u[0], u[1], out)
        return out

    states = ["xhat", "vhat", "what", "mode", "memory", "rest", "error_minus", "error_plus"]
    states += ["place", "count", "lagged", *(f"u{k}" for k in range(length - kernel.LINE))]
    whole = {"mode": (-1, 1), "memory": (0, len(arrays.transitions) - 1)}
    return Block.stepped(step, "u y", " ".join(OUTPUTS), states, design.dt, name, whole)


class Stepper:
    """A compiled estimator sample by sample; `at_reading`: it starts at the first reading."""

    def __init__(
        self, sample: Callable[..., None], tables: Any, memory: Floats, outputs: int, dt: float,
        at_reading: bool = False,
    ) -> None:  # fmt: skip
        self._sample, self._tables, self._memory, self._dt = sample, tables, memory, dt
        self._out, self._samples, self._at_reading = np.zeros(outputs), 0, at_reading

    def step(self, u: float, y: float) -> Estimate:
        """Estimate at this sample: drive u [N] from it on, position y [m] read at it.

        After a ValueError the estimator is as before.
        """
        drive, reading = finite("u", u), finite("y", y)
        if self._samples == 0 and self._at_reading:
            self._memory[kernel.XHAT] = reading
        t = self._samples * self._dt
        self._sample(*self._tables, self._memory, t, drive, reading, self._out)
        self._samples += 1
        x, v, friction, w, mode = self._out[:5].tolist()
        return Estimate(x, v, friction, w, int(mode))


class ObserverStepper(Stepper):
    """The observer sample by sample, for your own loop.

    Parameters
    ----------
    design : ObserverDesign
    xhat0, vhat0, what0, switching, encoder_quantum
        As for `observe`.

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    >>> design = dfc.design_pi_observer(axis, dt=1e-3)
    >>> observer = dfc.observer.ObserverStepper(design, encoder_quantum=1e-5)
    >>> observer.step(u=5.0, y=0.0)
    Estimate(x=0.0, v=0.0, F=5.0, w=0.0, mode=0)
    """

    def __init__(
        self,
        design: ObserverDesign,
        *,
        xhat0: float | None = None,
        vhat0: float = 0.0,
        what0: float = 0.0,
        switching: str = "reading",
        encoder_quantum: float | None = None,
    ) -> None:
        self.design = design
        arrays = tables(design, switching, encoder_quantum)
        memory = first_memory(design, 0.0 if xhat0 is None else xhat0, vhat0, what0)
        super().__init__(kernel.step, arrays, memory, kernel.OUTPUTS, design.dt, xhat0 is None)
