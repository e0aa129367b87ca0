"""What a simulation gives back: python-control's response plus switches."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import control as ct
import numpy as np
from numpy.typing import NDArray

from dryfric_control.arrays import Floats, Ints
from dryfric_control.compiled.axis_step import MOST_ROOM, ROOM, TooManySwitchesError
from dryfric_control.drawing import legend_above, over_time, panels, shade_stuck
from dryfric_control.text import documented, prefix_unit, stated, typeset_signs

if TYPE_CHECKING:
    import pandas

MODE_NAMES = {0: "stuck", 1: "sliding +", -1: "sliding -"}


@documented
@dataclass(frozen=True, eq=False)
class Events:
    """Located switches of a simulation.

    A breakaway at t = 0 is no entry: the first input decides the mode of the start, `mode[0]`.

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=1.0, viscous=0.0, coulomb=2.0)
    >>> resp = axis.simulate([0.0] * 1001, dt=1e-3, v0=1.0)
    >>> len(resp.events), int(resp.events.after[0])
    (1, 0)
    """

    time: Floats = stated("Time of each switch [s], located inside the sample.")
    before: Ints = stated("Mode before: 0 stuck, +1 and -1 sliding.")
    after: Ints = stated("Mode after.")

    def __len__(self) -> int:
        return len(self.time)

    def __iter__(self) -> Iterator[tuple[float, int, int]]:
        for t, before, after in zip(self.time, self.before, self.after, strict=True):
            yield float(t), int(before), int(after)

    def times(self, before: int, after: int) -> Floats:
        """Times of one kind of switch [s].

        Parameters
        ----------
        before, after : int
        """
        check_mode("before", before)
        check_mode("after", after)
        return self.time[(self.before == before) & (self.after == after)]

    def __repr__(self) -> str:
        first = list(self)[:8]
        rows = [f"  {t:.9f} s  {MODE_NAMES[one]} -> {MODE_NAMES[other]}" for t, one, other in first]
        return "\n".join([f"{len(self)} switches", *rows, *["  ..."] * (len(self) > 8)])


# Largest number that a motion may hold: beyond it, products of it are none.
_LARGEST = 1e100


def locate_switches(run: Callable[[int], tuple[Floats, int]]) -> Events:
    """Switches of a run, given the room for those of one sample; it says how many had none."""
    room = ROOM
    while room <= MOST_ROOM:
        rows, lost = run(room)
        if lost == 0:
            before, after = rows[:, 1:].T.astype(np.int64, order="C")
            return Events(rows[:, 0].copy(), before, after)
        room *= 8
    raise TooManySwitchesError


def check_mode(name: str, index: Any) -> None:
    """Refuse what is none of the three modes."""
    if isinstance(index, (bool, str)) or not np.isscalar(index) or index not in MODE_NAMES:
        raise ValueError(f"{name} must be 0 (stuck), +1 or -1 (sliding), got {index!r}")


def check_finite(outputs: Floats) -> None:
    """Refuse to return a motion that has left the range of numbers."""
    # What is not finite once stays so: the last sample tells.
    if not (np.abs(outputs[:3, -1]) < _LARGEST).all():
        first = int(np.argmin((np.abs(outputs[:3]) < _LARGEST).all(axis=0)))
        raise ValueError(
            f"the motion leaves the range of numbers at sample {first}: check the units of dt, of "
            "the input, and of mass, viscous and coulomb, and that a loop is stable"
        )


class Response(ct.TimeResponseData):
    """A `control.TimeResponseData` that takes its arrays without a copy, and units."""

    def __init__(
        self,
        time: NDArray[Any],
        outputs: Floats,
        states: Floats,
        inputs: Floats,
        units: tuple[str, str],
        **labels: Any,
    ) -> None:
        # The base class copies what it is given; a long record must not exist
        # twice, so it is built on one sample and the arrays are put in after.
        first = (array[..., :1] for array in (time, outputs, states, inputs))
        super().__init__(*first, issiso=False, **labels)
        self.t, self.y, self.x, self.u = time, outputs, states, inputs
        self.units = units

    def __repr__(self) -> str:
        names = [", ".join(labels) for labels in (self.output_labels, self.input_labels or ())]
        return (
            f"{type(self).__name__} of {self.t.size} samples from {self.t[0]:g} to "
            f"{self.t[-1]:g} s; outputs {names[0]}" + (f"; inputs {names[1]}" if names[1] else "")
        )

    def to_pandas(self) -> pandas.DataFrame:
        """Data frame of time, inputs and outputs, with the units by column in ``attrs``."""
        length, force = self.units
        units = {"time": "s", "v": f"{length}/s", **dict.fromkeys("uF", force)}
        units |= dict.fromkeys(("x", "y", "r", "xref"), length)
        frame = super().to_pandas()
        frame.attrs["units"] = {name: units[name] for name in frame.columns if name in units}
        return frame

    @property
    def mode(self) -> Ints:
        """Mode at every sample: 0 stuck, +1 and -1 sliding, shape (n,)."""
        return self.y[self.output_labels.index("mode")].astype(np.int64)


class SimulationResponse(Response):
    """Time response of an axis, with located switches.

    A `control.TimeResponseData` with the attribute `events`.

    Parameters
    ----------
    time : ndarray, shape (n,)
        Time [s].
    outputs : ndarray, shape (noutputs, n)
        Rows x, v, F and mode first.
    inputs : ndarray, shape (ninputs, n)
        Input at the samples.
    events : Events
    units : tuple of str, optional
        Units of position and force.
    **labels
        For `control.TimeResponseData`: labels of outputs and inputs, title.

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=1.0, viscous=0.0, coulomb=2.0)
    >>> resp = axis.simulate([3.0] * 1001, dt=1e-3)
    >>> resp.output_labels, round(float(resp.outputs[1, -1]), 9)
    (['x', 'v', 'F', 'mode'], 1.0)
    >>> [str(one.get_ylabel()) for one in resp.plot().axes.ravel()]
    ['position [m]', 'velocity [m/s]', 'force [N]']
    """

    events: Events

    def __init__(
        self,
        time: NDArray[Any],
        outputs: Floats,
        inputs: Floats,
        events: Events,
        units: tuple[str, str] = ("m", "N"),
        **labels: Any,
    ) -> None:
        labels = {"output_labels": ["x", "v", "F", "mode"], "input_labels": ["u"]} | labels
        super().__init__(
            time, outputs, outputs[:2], inputs, units, state_labels=["x", "v"], **labels
        )
        self.events = events

    @property
    def _has_reference(self) -> bool:
        """Whether the input is a reference of the position."""
        return bool(self.input_labels[0] == "r")

    @panels(lambda self: 3 + self._has_reference)
    def plot(self, axes: Any) -> str:
        """Draw position, velocity and force; a grey band at rest.

        In a closed loop the tracking error (reference - position) is a fourth panel.
        """
        length, force = self.units
        labels = self.output_labels
        axes[0].plot(self.t, self.y[0], "k", label="x")
        names = [f"position [{length}]", f"velocity [{length}/s]", f"force [{force}]"]
        if self._has_reference:
            axes[0].plot(self.t, self.u[0], "C0--", linewidth=1.0, label="reference")
            error = self.u[0] - self.y[0]
            factor, short = prefix_unit(float(np.abs(error).max()), length)
            axes[1].plot(self.t, error / factor, "C3", linewidth=1.0)
            axes[1].axhline(0.0, color="k", linewidth=0.6, zorder=0.5)  # on the grey bands
            names.insert(1, typeset_signs(f"error [{short}]"))
        velocity, forces = axes[-2:]
        velocity.plot(self.t, self.y[1], "k", label="v")
        drive = self.y[labels.index("u")] if "u" in labels else self.u[0]
        forces.plot(self.t, drive, color="0.55", linewidth=1.0, label="drive u")
        forces.plot(self.t, self.y[2], "k", linewidth=1.0, label="friction F")
        for one in axes:
            shade_stuck(one, self.t, self.y[3])
        over_time(axes, names)
        legend_above(axes[0])
        legend_above(forces)
        return str(self.title)
