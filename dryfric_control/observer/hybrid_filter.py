"""The hybrid cell filter: three Gaussians, one a mode, and the reading as a cell."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from dryfric_control.arrays import Floats, Ints
from dryfric_control.checks import increment, positive, sampling_time
from dryfric_control.compiled import axis_step
from dryfric_control.compiled import hybrid_filter as kernel
from dryfric_control.compiled.observer import LINE, XHAT
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.observer.base import (
    OUTPUTS,
    Kernel,
    Observer,
    Output,
    Stepper,
)
from dryfric_control.observer.error_model import (
    axis_matrices,
    coulomb_level,
    own_axis,
)
from dryfric_control.order import check_quantum_and_dt
from dryfric_control.text import documented, stated

# What has no argument; tuned with the defaults of `hybrid_filter` on plants that are not in the
# benchmark (`benchmarks/observer.py arena`).
#: Sampling time that the following numbers are for [s].
_SAMPLE = 1e-3
#: White force as a part of the net force.
_ACCELERATION_NOISE = 4e-3
#: Spread of the excess of friction at any velocity, as a part of the Coulomb level.
_EXCESS_FAST = 0.018
#: Noise of a reading in addition to its cell [increments].
_CELL_NOISE = 0.05
#: Rate at which an axis breaks away above the usual level [1/sample].
_HAZARD = 0.35
#: Relative uncertainty of the rate at which the excess decays.
_RATE = 0.5
#: Velocity at which a motion starts, standard deviation [increments/sample].
_START = 0.1
#: Breakaway force over the level until one was observed, without a Stribeck peak and with one.
_FIRST_RELEASE = 1.15
_PEAK_RELEASE = 1.0
#: Time constant at which the excess is forgotten at constant velocity [s].
_FADE = 0.3
#: Velocity over which the excess changes where no Stribeck velocity is known [stick velocities].
_STICK_SPEEDS = 11.0


class Tables(NamedTuple):
    """A filter as the arrays that the compiled sample reads."""

    numbers: Floats
    axis_numbers: Floats
    axis_integers: Ints


class HybridStepper(Stepper):
    """A hybrid filter sample by sample, made by its `stepper`."""

    @property
    def vhat_sd(self) -> float:
        """Standard deviation of the velocity after the last sample [m/s]."""
        return float(self._out[len(OUTPUTS)])

    @property
    def log_likelihood(self) -> float:
        """Logarithm of the probability of the last reading."""
        return float(self._out[len(OUTPUTS) + 1])


@documented
@dataclass(frozen=True)
class HybridFilter(Observer):
    """A filter of three modes.

    Made by `hybrid_filter`.  Its responses have `vhat_sd` [m/s] and `log_likelihood` of each
    reading, too.

    Examples
    --------
    >>> import numpy as np
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    >>> estimate = dfc.hybrid_filter(axis).run(u=np.full(100, 5.0), y=np.zeros(100))
    >>> bool(estimate.vhat_sd[-1] < 1e-4)
    True
    """

    axis: FrictionAxis = stated("The nominal axis.")
    dt: float = stated("Sampling time [s].")
    encoder_quantum: float = stated("Increment of the position sensor [m].")
    excess: float = stated("Spread of the friction above the model, over the Coulomb level.")
    excess_speed: float = stated("Velocity over which that excess changes [m/s].")
    level_walk: float = stated("Change of the Coulomb level in 1 s, as a part of it.")
    force_noise: float = stated("Mean random force over 1 ms, over the Coulomb level.")
    mass_error: float = stated("Relative uncertainty of the mass.")
    title = "hybrid cell filter"
    label = "filter"
    suffix = "_filter"
    sample_kernel = Kernel(kernel.step, kernel.run)
    more_outputs = (
        Output("vhat_sd", "m/s", "standard deviation of vhat"),
        Output(
            "log_likelihood",
            "1",
            "logarithm of the probability of the reading",
        ),
    )
    certificate_text = (
        "A filter of three modes carries no certificate: it states its own standard deviation."
    )
    stepper_class = HybridStepper
    _kind = "hybrid filter"

    @functools.cached_property
    def _tables(self) -> Tables:
        arrays = self.axis.arrays(self.dt)
        numbers = _numbers(self)
        numbers.setflags(write=False)
        return Tables(numbers, arrays.numbers, arrays.integers)

    def tables(self) -> Tables:
        """Arrays that the compiled filter reads."""
        return self._tables

    def memory(self, reading: float = 0.0) -> Floats:
        """Memory before the first sample, shape (nstates,).

        Parameters
        ----------
        reading : float, optional
            Of no effect: the filter begins at the first reading by itself.
        """
        return np.zeros(self._first_place + kernel.SIZE)

    @property
    def _first_place(self) -> int:
        """First place of the filter's own state: behind the estimate and the delay line."""
        return LINE + int(self._tables.axis_integers[axis_step.N_HISTORY])

    @property
    def position_places(self) -> tuple[tuple[int, float], ...]:
        """Places of the memory that hold a position, and its unit [m]."""
        quantum = float(self._tables.numbers[kernel.QUANTUM])
        first = self._first_place
        means = first + kernel.MODE_STATES + kernel.X
        cells = tuple((means + mode * kernel.GAUSSIAN, quantum) for mode in range(3))
        return ((XHAT, 1.0), (first + kernel.READING, 1.0), *cells)

    @classmethod
    def _from_saved(cls, held: Any) -> HybridFilter:
        # What a file holds passes the checks of `hybrid_filter`.
        found = super()._from_saved(held)
        given = {name: getattr(found, name) for name in _ASSUMPTIONS}
        return hybrid_filter(found.axis, found.dt, found.encoder_quantum, **given)


#: Fields that say what is uncertain, and how much.
_ASSUMPTIONS = (
    "excess",
    "excess_speed",
    "level_walk",
    "force_noise",
    "mass_error",
)


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

    Its methods are `run`, `block`, `stepper`, `save` and `load`.

    Parameters
    ----------
    axis : FrictionAxis
        The nominal axis; with a Stribeck peak where one is known.
    dt : float, optional
        Sampling time [s].
    encoder_quantum : float, optional
        Increment of the position sensor [m]; the standard deviation of its noise where that is
        larger.
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
    if coulomb_level(own) <= 0.0:
        raise ValueError(
            "axis has no Coulomb friction: a hybrid filter has no modes then, use "
            "dfc.design_pi_observer with an uncertainty"
        )
    return HybridFilter(
        axis=own,
        dt=dt,
        encoder_quantum=quantum,
        excess=excess,
        excess_speed=excess_speed,
        level_walk=level_walk,
        force_noise=force_noise,
        mass_error=mass_error,
    )


def _numbers(made: HybridFilter) -> Floats:
    """Numbers of the compiled filter: increments, increments a sample and Coulomb levels."""
    dt = made.dt
    quantum = made.encoder_quantum
    level = coulomb_level(made.axis)
    A, B = axis_matrices(made.axis, 1, dt, "zoh")
    samples = dt / _SAMPLE
    numbers = np.zeros(kernel.NUMBERS)
    for place, number in {
        kernel.DT: dt,
        kernel.QUANTUM: quantum,
        kernel.FORCE: level,
        kernel.A12: A[0, 1] / dt,
        kernel.A22: A[1, 1],
        kernel.B1: B[0] * level / quantum,
        kernel.B2: B[1] * level * dt / quantum,
        kernel.FORCE_NOISE: made.force_noise / math.sqrt(samples),
        kernel.ACCELERATION_NOISE: _ACCELERATION_NOISE,
        kernel.LEVEL_WALK: made.level_walk * math.sqrt(dt),
        kernel.EXCESS: made.excess,
        kernel.EXCESS_FAST: _EXCESS_FAST,
        kernel.EXCESS_SPEED: made.excess_speed * dt / quantum,
        kernel.FADE: math.exp(-dt / _FADE),
        kernel.CELL_NOISE: _CELL_NOISE,
        kernel.HAZARD: -math.expm1(-_HAZARD * samples),
        kernel.MASS: made.mass_error**2,
        kernel.DECAY_RATE_ERROR: _RATE,
        kernel.START: (_START * samples) ** 2,
        kernel.REPEATED_SHARE: min(samples, 1.0),
        kernel.FIRST_RELEASE: _PEAK_RELEASE if made.axis.stribeck else _FIRST_RELEASE,
    }.items():
        numbers[place] = number
    return numbers
