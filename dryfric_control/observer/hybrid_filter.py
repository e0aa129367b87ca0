"""The hybrid cell filter: three Gaussians, one a mode, and the reading as a cell."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import control as ct
import numpy as np
from numpy.typing import ArrayLike

from dryfric_control.arrays import Floats, Ints
from dryfric_control.checks import increment, positive, sampling_time
from dryfric_control.compiled import axis_step
from dryfric_control.compiled import hybrid_filter as kernel
from dryfric_control.compiled.observer import LINE
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.model.block import Block
from dryfric_control.observer.error_model import axis_matrices, coulomb_level, own_axis
from dryfric_control.observer.runtime import OUTPUTS, ObserverResponse, Stepper, drive_and_reading
from dryfric_control.order import check_quantum_and_dt

#: What has no argument; tuned with the defaults of `hybrid_filter` on plants that
#: are not in the benchmark (`benchmarks/arena.py`), for one sample of 1 ms.
_SAMPLE = 1e-3
_ACCELERATION_NOISE = 4e-3
_EXCESS_FAST = 0.018
_CELL_NOISE = 0.05
_HAZARD = 0.35
_RATE = 0.5
#: Time constant at which the excess is forgotten at constant velocity [s].
_FADE = 0.3
#: Velocity over which the excess changes where no Stribeck velocity is known, in stick velocities.
_STICK_SPEEDS = 11.0


class Tables(NamedTuple):
    """A filter as the arrays that the compiled sample reads."""

    numbers: Floats
    axis_numbers: Floats
    axis_integers: Ints


class HybridResponse(ObserverResponse):
    """Estimates of a hybrid filter: `vhat_sd` [m/s] and `log_likelihood` of each reading too."""

    def __init__(self, time: Floats, rows: Floats, *given: Any) -> None:
        super().__init__(time, np.ascontiguousarray(rows[:, :5].T), *given)
        self.vhat_sd, self.log_likelihood = rows[:, 5].copy(), rows[:, 6].copy()


@dataclass(frozen=True)
class HybridFilter:
    """A filter of three modes for position, velocity, friction and mode; see `hybrid_filter`."""

    axis: FrictionAxis
    dt: float
    encoder_quantum: float
    excess: float
    excess_speed: float
    level_walk: float
    force_noise: float
    mass_error: float
    tables: Tables = field(repr=False, compare=False)

    @property
    def memory_size(self) -> int:
        """Places of the memory: estimate, delay line, filter."""
        return LINE + int(self.tables.axis_integers[axis_step.N_HISTORY]) + kernel.SIZE

    def run(self, u: Any, y: ArrayLike | None = None) -> HybridResponse:
        """Run the filter over a record, or drive u [N] and readings y [m], each shape (n,)."""
        time, inputs, known = drive_and_reading("filter", self, u, y)
        out = np.empty((time.size, kernel.OUTPUTS))
        kernel.run(*self.tables, np.zeros(self.memory_size), *inputs, known, out)
        return HybridResponse(
            time, out, inputs, self.axis.units, f"{self.axis.name}: hybrid filter"
        )

    def block(self, name: str = "observer") -> ct.NonlinearIOSystem:
        """The filter as a sampled block: inputs u, y; outputs xhat, vhat, Fhat, what, mode."""

        def step(t: float, memory: Floats, u: Any) -> Floats:
            out = np.empty(kernel.OUTPUTS)
            kernel.step(*self.tables, memory, t, u[0], u[1], out)
            return out[:5]

        states = ["xhat", "vhat", "what", "mode", *(f"m{k}" for k in range(4, self.memory_size))]
        return Block.stepped(step, "u y", " ".join(OUTPUTS), states, self.dt, name)

    def stepper(self) -> HybridStepper:
        """The filter sample by sample, for a loop of your own."""
        return HybridStepper(self)


class HybridStepper(Stepper):
    """A hybrid filter sample by sample, made by `HybridFilter.stepper`."""

    def __init__(self, filter: HybridFilter) -> None:
        self.filter = filter
        memory = np.zeros(filter.memory_size)
        super().__init__(kernel.step, filter.tables, memory, kernel.OUTPUTS, filter.dt)

    @property
    def vhat_sd(self) -> float:
        """Standard deviation of the velocity after the last sample [m/s]."""
        return float(self._out[5])

    @property
    def log_likelihood(self) -> float:
        """Logarithm of the probability of the last reading."""
        return float(self._out[6])


def hybrid_filter(
    axis: FrictionAxis,
    dt: float = 1e-3,
    encoder_quantum: float = 1e-6,
    *,
    excess: float = 0.07,
    excess_speed: float | None = None,
    level_walk: float = 0.03,
    force_noise: float = 2.4e-3,
    mass_error: float = 0.055,
) -> HybridFilter:
    """Observer that filters position, velocity, friction and mode.

    Its methods are `run`, `block` and `stepper`.

    Parameters
    ----------
    axis : FrictionAxis
        The nominal axis; with a Stribeck peak where one is known.
    dt : float, optional
        Sampling time [s].
    encoder_quantum : float, optional
        Increment of the position sensor [m].
    excess : float, optional
        Spread of the friction above the model at low velocity, as a part of the Coulomb level.
    excess_speed : float, optional
        Velocity over which that excess changes [m/s].  Default: the Stribeck velocity, or eleven
        times the stick velocity without one.
    level_walk : float, optional
        Change of the Coulomb level in 1 s, standard deviation, as a part of it.
    force_noise : float, optional
        Random force, standard deviation of its mean over 1 ms, as a part of the Coulomb level.
    mass_error : float, optional
        Relative uncertainty of the mass, standard deviation.

    Notes
    -----
    The theory page has the equations.  Effects act, or are left out, as in `design_pi_observer`.
    The levels are learned while sliding alone; creeping below an increment in many samples is
    taken for rest.

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    >>> observer = dfc.hybrid_filter(axis, dt=1e-3, encoder_quantum=1e-6)
    >>> observer.stepper().step(u=5.0, y=0.0)
    Estimate(x=0.0, v=0.0, F=5.0, w=0.0, mode=0)
    """
    own = own_axis(axis)
    acting = axis.effective()
    own = own.replace(stribeck=acting.stribeck, stick_speed=acting.stick_speed)
    dt = sampling_time(dt)
    quantum = increment(encoder_quantum, axis.unit("m"))
    check_quantum_and_dt("encoder_quantum", quantum, dt)
    excess = positive("excess", excess)
    if excess_speed is None:
        excess_speed = own.stribeck.speed if own.stribeck else _STICK_SPEEDS * own.stick_speed
    excess_speed = positive("excess_speed", excess_speed, unit=axis.unit("m/s"))
    level_walk = positive("level_walk", level_walk, zero=True)
    force_noise = positive("force_noise", force_noise)
    mass_error = positive("mass_error", mass_error, zero=True)
    level = coulomb_level(own)
    if level <= 0.0:
        raise ValueError(
            "axis has no Coulomb friction: a hybrid filter has no modes then, use "
            "dfc.design_pi_observer with an uncertainty"
        )
    A, B = axis_matrices(own, 1, dt, "zoh")
    pace = dt / _SAMPLE
    numbers = np.zeros(kernel.NUMBERS)
    for place, number in {
        kernel.DT: dt,
        kernel.QUANTUM: quantum,
        kernel.FORCE: level,
        kernel.A12: A[0, 1] / dt,
        kernel.A22: A[1, 1],
        kernel.B1: B[0] * level / quantum,
        kernel.B2: B[1] * level * dt / quantum,
        kernel.FORCE_NOISE: force_noise / math.sqrt(pace),
        kernel.ACCELERATION_NOISE: _ACCELERATION_NOISE,
        kernel.LEVEL_WALK: level_walk * math.sqrt(dt),
        kernel.EXCESS: excess,
        kernel.EXCESS_FAST: _EXCESS_FAST,
        kernel.EXCESS_SPEED: excess_speed * dt / quantum,
        kernel.FADE: math.exp(-dt / _FADE),
        kernel.CELL_NOISE: _CELL_NOISE,
        kernel.HAZARD: -math.expm1(-_HAZARD * pace),
        kernel.MASS: mass_error**2,
        kernel.RATE: _RATE,
        kernel.START: (0.1 * pace) ** 2,
        kernel.AGAIN: min(pace, 1.0),
        kernel.FIRST_RELEASE: 1.0 if own.stribeck else 1.15,
    }.items():
        numbers[place] = number
    numbers.setflags(write=False)
    given = dt, quantum, excess, excess_speed, level_walk, force_noise, mass_error
    return HybridFilter(own, *given, Tables(numbers, *own.arrays(dt)[:2]))
