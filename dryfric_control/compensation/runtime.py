"""The compensated position controller at work: closed loop, block, stepper."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import control as ct
import numpy as np

from dryfric_control.arrays import Floats
from dryfric_control.checks import finite
from dryfric_control.compiled import compensation as kernel
from dryfric_control.compiled.observer import LINE as OBSERVER_LINE
from dryfric_control.compiled.observer import MODE, NODE
from dryfric_control.model.block import Block
from dryfric_control.model.loops import LoopRun
from dryfric_control.model.profiles import MotionProfile
from dryfric_control.text import documented, stated

_STATES = (
    "samples",
    "integral",
    "speed",
    "error",
    "ahead",
    "direction",
    "contact",
    "still",
    "level_plus",
    "level_minus",
    "excess",
    "mode",
    "corrections",
    "held",
    "held_drive",
    "mean_drive",
    "mean_error",
    "compensation",
    "sliding_integral",
    "expected",
    "level_seen",
    "peak_seen",
    *(f"inner{i}" for i in range(6)),
)


@documented
@dataclass(frozen=True, eq=False)
class CompensatedController:
    """Position controller with friction compensation, ready to run.

    For `simulate_loop`, `control.interconnect` (`block`) and your own loop (`stepper`).

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    >>> controller = dfc.design_compensation(axis, dt=1e-3).controller
    >>> move = dfc.motion_profile(0.01, 1e-3, velocity=0.05, acceleration=1.0, jerk=50.0)
    >>> resp = dfc.simulate_loop(axis, controller, move, quantum=1e-6)
    >>> bool(abs(resp.y[0] - move.position).max() < 2e-5)
    True
    """

    dt: float = stated("Sampling time [s].")
    lead: int = stated("Samples by which block and stepper need the reference ahead.")
    law: kernel.Law = stated("Arrays of the compiled law.")

    def memory(self, motion: MotionProfile | None = None) -> Floats:
        """Memory before the first sample, shape (nstates,).

        Parameters
        ----------
        motion : MotionProfile, optional
            Reference whose first samples it knows.  Default: it rests at the first one it gets.
        """
        history = int(self.law.observer_axis_integers[kernel.axis_step.N_HISTORY])
        memory = np.zeros(kernel.LINE + kernel.STRIDE * self.lead + OBSERVER_LINE + history)
        if motion is not None:
            memory[kernel.DIRECTION] = 1.0
            memory[kernel.SHARE] = self.law.numbers[kernel.EXCESS]
            first = np.minimum(np.arange(self.lead)[::-1], motion.position.size - 1)
            line = memory[kernel.LINE :][: kernel.STRIDE * self.lead].reshape(-1, kernel.STRIDE)
            line[:, 0] = motion.position[first]
            line[:, 1] = motion.velocity[first]
        return memory

    def run(self, loop: LoopRun) -> tuple[Floats, int]:
        """Run the loop: located switches, and how many had no room.

        Parameters
        ----------
        loop : LoopRun
        """
        return kernel.run_loop(
            loop.axis.numbers,
            loop.axis.integers,
            loop.state,
            self.law,
            self.memory(loop.motion),
            loop.motion.rows,
            loop.disturbance,
            loop.quantum,
            self.dt,
            loop.room,
            loop.out,
        )

    def block(self, name: str = "controller") -> ct.NonlinearIOSystem:
        """The controller with its observer as one sampled block.

        Parameters
        ----------
        name : str, optional

        Returns
        -------
        control.NonlinearIOSystem
            Inputs xref, vref, aref, those of `lead` samples later, and y; outputs u and friction,
            the part of u that compensates friction.  There is no algebraic loop.  Zero states are
            a controller at rest at its first reference.
        """

        def step(t: float, memory: Floats, u: Any) -> Floats:
            return np.array([kernel.step(self.law, memory, *u), memory[kernel.FORCE]])

        states = [
            *_STATES,
            *(f"{what}{i + 1}" for i in range(self.lead) for what in "xvf"),
        ]
        states += [f"observer{i}" for i in range(self.memory().size - len(states))]
        nodes = len(self.law.observer_transitions) - 1
        whole = {
            f"observer{MODE}": (-1, 1),
            f"observer{NODE}": (0, nodes),
        }
        return Block.from_step(
            step,
            "xref vref aref y",
            "u friction",
            states,
            self.dt,
            name,
            whole,
        )

    def stepper(self) -> CompensationStepper:
        """Controller to be stepped sample by sample."""
        return CompensationStepper(self)


class CompensationStepper:
    """A compensated controller, sample by sample.

    Parameters
    ----------
    controller : CompensatedController

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    >>> stepper = dfc.design_compensation(axis, dt=1e-3).controller.stepper()
    >>> stepper.step(xref=1e-3, vref=0.05, aref=0.0, y=1e-3) > 8.0   # friction and a little more
    True
    """

    def __init__(self, controller: CompensatedController) -> None:
        self.controller = controller
        self._memory = controller.memory()

    @property
    def learned(self) -> dict[str, float]:
        """Corrections of the Coulomb levels [N] and the Stribeck excess."""
        places = {
            "plus": kernel.PLUS,
            "minus": kernel.MINUS,
            "excess": kernel.SHARE,
        }
        return {name: float(self._memory[place]) for name, place in places.items()}

    def step(self, xref: float, vref: float, aref: float, y: float) -> float:
        """Drive force to hold until the next sample [N].

        Parameters
        ----------
        xref, vref, aref : float
            Reference of `lead` samples later [m], [m/s], [m/s^2].
        y : float
            Position read at this sample [m].
        """
        given = (
            finite("xref", xref),
            finite("vref", vref),
            finite("aref", aref),
            finite("y", y),
        )
        return float(kernel.step(self.controller.law, self._memory, *given))
