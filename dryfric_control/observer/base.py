"""The base class of the observers: rules for a new one, and what all have in common."""

from __future__ import annotations

import functools
from abc import abstractmethod
from collections.abc import Callable, Mapping
from typing import Any, ClassVar, NamedTuple

import control as ct
import numpy as np
from numpy.typing import ArrayLike

from dryfric_control import drawing
from dryfric_control.arrays import Floats
from dryfric_control.checks import finite, samples
from dryfric_control.compiled import observer as places
from dryfric_control.compiled.windowed_runs import NO_FORCE
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.model.block import Block
from dryfric_control.model.responses import Response
from dryfric_control.order import check_drive_and_reading
from dryfric_control.store.saved import Saved
from dryfric_control.units import check_units

#: Outputs that every observer has, in this order.
OUTPUTS = ("xhat", "vhat", "Fhat", "what", "mode")
#: Largest relative difference of two sampling times that count as one.
SAME_STEP = 1e-6


class Output(NamedTuple):
    """An output of an observer beyond the common five."""

    name: str
    unit: str  # of a linear axis, such as "m/s"
    meaning: str


class Kernel(NamedTuple):
    """The compiled functions of an observer."""

    step: Callable[..., None]  # step(*tables, memory, t, u, y, out)
    # run(*tables, memory, u, y, known, out): known force on the mass, shape (n,) or (0,) for none;
    # out of shape (n, noutputs)
    run: Callable[..., None]


class Estimate(NamedTuple):
    """What the observer states at one sample."""

    x: float  # position
    v: float  # speed
    F: float  # friction force
    w: float  # integral term, minus the friction error
    mode: int  # 0 stuck, +1 and -1 sliding


class ObserverResponse(Response):
    """A `control.TimeResponseData` with outputs xhat, vhat, Fhat, what, mode, and states.

    What an observer gives beyond these is an attribute of that name, shape (n,).
    """

    def __init__(
        self,
        time: Floats,
        outputs: Floats,
        inputs: Floats,
        units: tuple[str, str],
        title: str,
        more_outputs: tuple[Output, ...] = (),
    ) -> None:
        labels = {
            "output_labels": list(OUTPUTS),
            "input_labels": ["u", "y"],
            "state_labels": ["xhat", "vhat", "what"],
        }
        estimates = outputs[: len(OUTPUTS)]
        states = estimates[[0, 1, 3]]
        super().__init__(time, estimates, states, inputs, units, title=title, **labels)
        for output, row in zip(more_outputs, outputs[len(OUTPUTS) :], strict=True):
            setattr(self, output.name, row.copy())

    @drawing.panels(3)
    def plot(self, axes: Any) -> str:
        """Draw the estimates over time, scaled after 0.1 s, estimated rest as a light band."""
        length, force = self.units
        axes[0].plot(
            self.t,
            self.u[1],
            ".",
            color=drawing.MEASURED,
            markersize=2,
            label="reading",
        )
        axes[1].plot(self.t, self.y[1], "C0--", linewidth=1.0)
        axes[0].plot(self.t, self.y[0], "C0--", linewidth=1.0, label="estimate")
        axes[2].plot(
            self.t,
            self.u[0],
            color="0.55",
            linewidth=1.0,
            label="drive u",
        )
        axes[2].plot(
            self.t,
            self.y[2],
            "C0--",
            linewidth=1.0,
            label="friction, estimate",
        )
        labels = (
            f"position [{length}]",
            f"velocity [{length}/s]",
            f"force [{force}]",
        )
        signals = (
            (self.u[1], self.y[0]),
            (self.y[1],),
            (self.u[0], self.y[2]),
        )
        for ax, drawn in zip(axes, signals, strict=True):
            drawing.settled_scale(ax, self.t, *drawn)
            drawing.shade_stuck(ax, self.t, self.y[4])
        drawing.over_time(axes, labels)
        drawing.legend_above(axes[0])
        drawing.legend_above(axes[2])
        return str(self.title)


class Stepper:
    """An observer sample by sample.

    Parameters
    ----------
    observer : Observer
    **options
        As for its `run`.
    """

    def __init__(self, observer: Observer, **options: Any) -> None:
        self.observer = observer
        self._step = observer.sample_kernel.step
        self._tables, first_memory = observer._options(options)
        self._memory = first_memory(0.0)
        self._out = np.zeros(observer.noutputs)
        self._samples = 0
        self._at_reading = observer.starts_at_reading and options.get("xhat0") is None

    def step(self, u: float, y: float) -> Estimate:
        """Estimate at this sample: drive u [N] from it on, position y [m] read at it.

        After a ValueError the observer is as before.
        """
        drive = finite("u", u)
        reading = finite("y", y)
        if self._samples == 0 and self._at_reading:
            self._memory[places.XHAT] = reading
        t = self._samples * self.observer.dt
        self._step(*self._tables, self._memory, t, drive, reading, self._out)
        self._samples += 1
        x, v, friction, w, mode = self._out[: len(OUTPUTS)].tolist()
        return Estimate(x, v, friction, w, int(mode))


class Observer(Saved):
    """Base class of the observers: from drive and reading to motion.

    One compiled sample has several faces, which this class makes: `run` over a record, `block` for
    python-control, `stepper` for a loop of your own, C and FMU by `export_c` and `export_fmu`;
    `save` and `load` keep it.

    Notes
    -----
    Rules for a new observer; ``observer/extended_state.py`` follows them in one file.

    1. It is a frozen dataclass derived from this class.  Its fields are what determines it: among
       them `axis`, the nominal axis without what the observer does not know, and `dt`.
    2. A function named after the method makes it and checks every argument before any work;
       the docstring states the equation with its source, and where the method stops being true.
    3. One sample is one function compiled by numba, ``step(*tables, memory, t, u, y, out)``: it
       takes the drive `u` that acts from this sample on and the position `y` read at it, writes the
       outputs into `out` and advances `memory` to the next sample.  A second function,
       ``run(*tables, memory, u, y, known, out)``, repeats it over a record, with the force on the
       mass that the record knows set before each sample (`axis_step.set_known_force`); both
       stand in `sample_kernel`.
    4. The first five outputs are `OUTPUTS`: position, velocity, friction (viscous friction is no
       part of it), integral term (minus the friction error) and mode; `more_outputs` names others.
    5. `tables` gives the arrays that the kernel reads, made from the fields alone; no number of an
       observer stands anywhere else.
    6. All that changes is in `memory`, an array of floats whose first places are those of
       `compiled.observer` (position, velocity, integral, mode, ...), as the laws of effects read
       them.  Zeros are an observer before its first sample.  Delay and lag of the drive are kept
       from `LAGGED` on by `mean_drive` and `shift_drive`: then its length is `LINE` and the history
       of the axis, and numbers of its own lie between `REST` and `LAGGED`.
    7. The kernel allocates nothing and uses numbers, arrays, ``if`` and ``for`` over a range only,
       as what is exported to C must.
    8. `position_places` names the places of the memory that hold positions, with their units,
       `rest_place` that of the time at rest: exported code in single precision needs them.
    9. It is registered by its imports in `observer/__init__.py` and `dryfric_control/__init__.py`,
       by its entries in `docs/reference.rst`, its class also in `RESULTS` of
       `docs/_extensions/public_names.py`; tests of what all have in common follow from its place in
       `tests/observer/observers.py`.
    10. The nominal axis goes through `error_model.own_axis`, which leaves out, with a warning, what
        a rigid mass cannot have, and the Stribeck peak.

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    >>> observer = dfc.extended_state_observer(axis, dt=1e-3)
    >>> isinstance(observer, dfc.observer.Observer)
    True
    >>> observer.stepper().step(u=5.0, y=0.0)
    Estimate(x=0.0, v=0.0, F=0.0, w=0.0, mode=0)
    """

    axis: FrictionAxis
    dt: float

    #: What it is, in words, and the end of the names of exported code.
    title: ClassVar[str] = "observer"
    label: ClassVar[str] = "observer"  # in errors
    suffix: ClassVar[str] = "_observer"
    sample_kernel: ClassVar[Kernel]
    more_outputs: ClassVar[tuple[Output, ...]] = ()
    #: Arguments of `memory` with which a run may start, and their places in the memory.
    starts: ClassVar[Mapping[str, int]] = {}
    #: Whether an observer in a loop starts at the first reading where its start is not given.
    starts_at_reading: ClassVar[bool] = False
    stepper_class: ClassVar[type[Stepper]] = Stepper
    #: Place of the time at rest in the memory.
    rest_place: ClassVar[int] = places.REST

    @abstractmethod
    def tables(self) -> Any:
        """Arrays that the kernel reads, a named tuple."""
        raise NotImplementedError

    @abstractmethod
    def memory(self, reading: float = 0.0) -> Floats:
        """Memory before the first sample, shape (nstates,).

        Parameters
        ----------
        reading : float, optional
            The first reading [m].
        """
        raise NotImplementedError

    @property
    def position_places(self) -> tuple[tuple[int, float], ...]:
        """Places of the memory that hold a position, and its unit [m]; the estimate comes first."""
        return ((places.XHAT, 1.0),)

    @property
    def certificate_text(self) -> str:
        """What is guaranteed, for the documents of exported code."""
        return "It carries no certificate."

    def state_names(self) -> list[str]:
        """Names of the places of the memory, as states of `block`."""
        first = ["xhat", "vhat", "what", "mode"]
        return first + [f"m{place}" for place in range(len(first), self.memory().size)]

    def state_ranges(self) -> dict[str, tuple[int, int]]:
        """Least and largest value of states that are whole numbers."""
        return {}

    def run(self, u: Any, y: ArrayLike | None = None, **options: Any) -> ObserverResponse:
        """Run the observer over a whole record, compiled.

        Parameters
        ----------
        u : array_like, shape (n,), or Record
            Drive force at the samples [N]; a record, whose step and units must be those of the
            observer, brings `y`, and its known load, with it.
        y : array_like, shape (n,), optional
            Measured position at the samples [m].
        **options
            Start and rules of the class, if it has any; see the function of that name.

        Returns
        -------
        ObserverResponse
            Outputs xhat, vhat, Fhat, what, mode, each of shape (n,).
        """
        arrays, first_memory = self._options(options)
        time, inputs, known = drive_and_reading(self, u, y)
        out = np.empty((time.size, self.noutputs))
        self.sample_kernel.run(*arrays, first_memory(inputs[1, 0]), *inputs, known, out)
        return ObserverResponse(
            time,
            np.ascontiguousarray(out.T),
            inputs,
            self.axis.units,
            f"{self.axis.name}: {self.title}",
            self.more_outputs,
        )

    def block(self, name: str = "observer", **options: Any) -> ct.NonlinearIOSystem:
        """The observer as a sampled block.

        Parameters
        ----------
        name : str, optional
        **options
            Rules of the class, if it has any.

        Returns
        -------
        control.NonlinearIOSystem
            Inputs u, y; outputs xhat, vhat, Fhat, what, mode.  `run` is far faster.
        """
        arrays, _ = self._options(options)
        count = self.noutputs
        step_kernel = self.sample_kernel.step

        def step(t: float, memory: Floats, u: Any) -> Floats:
            out = np.empty(count)
            step_kernel(*arrays, memory, t, u[0], u[1], out)
            return out[: len(OUTPUTS)]

        states = self.state_names()
        ranges = self.state_ranges()
        return Block.from_step(step, "u y", " ".join(OUTPUTS), states, self.dt, name, ranges)

    def stepper(self, **options: Any) -> Stepper:
        """The observer sample by sample, for a loop of your own.

        Parameters
        ----------
        **options
            Start and rules of the class, if it has any.
        """
        return self.stepper_class(self, **options)

    @property
    def noutputs(self) -> int:
        """Number of outputs of one sample."""
        return len(OUTPUTS) + len(self.more_outputs)

    def _options(self, options: dict[str, Any]) -> tuple[Any, Callable[[float], Floats]]:
        """Tables, and memory as a function of the first reading, with the options of a run."""
        start = {name: options[name] for name in self.starts if name in options}
        rules = {name: value for name, value in options.items() if name not in start}
        return self.tables(**rules), functools.partial(self.memory, **start)


def drive_and_reading(observer: Any, u: Any, y: Any) -> tuple[Floats, Floats, Floats]:
    """Time [s], drive [N] and reading [m] in rows, and known load [N], of arrays or a record.

    `observer` has the axis and the step that they must fit.
    """
    start = 0.0
    known = NO_FORCE
    if hasattr(u, "units") and hasattr(u, "dt"):  # a record; no room imports both
        if y is not None:
            raise ValueError("y must be left out where u is a record: it holds its positions")
        check_units(observer.axis, u)
        if abs(u.dt / observer.dt - 1.0) > SAME_STEP:
            raise ValueError(
                f"record.dt is {u.dt:g} s and {observer.label}.dt {observer.dt:g} s: design with "
                f"dt={u.dt:g}, or pass record.resampled({observer.dt:g})"
            )
        start, known, u, y = float(u.t[0]), u.known_force, u.u, u.x
    elif y is None:
        raise ValueError("y is missing: give u and y, or a Record in place of both")
    drive = samples("u", u)
    reading = samples("y", y)
    if drive.size != reading.size:
        raise ValueError(
            f"u has {drive.size} samples and y {reading.size}: give one of each at every sample"
        )
    check_drive_and_reading(observer.axis, observer.dt, drive, reading)
    return start + np.arange(drive.size) * observer.dt, np.vstack([drive, reading]), known
