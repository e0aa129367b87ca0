"""The linear extended state observer: unknown force as a third state, one bandwidth."""

# mypy: allow-untyped-defs

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import control as ct
import numpy as np

from dryfric_control.arrays import Floats, Ints
from dryfric_control.checks import check_boolean, increment, positive, sampling_time
from dryfric_control.compiled import axis_step
from dryfric_control.compiled.cached import njit
from dryfric_control.compiled.observer import (
    LINE,
    MODE,
    NODE,
    REST,
    VHAT,
    WHAT,
    XHAT,
    mean_drive,
    shift_drive,
)
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.observer.base import Kernel, Observer
from dryfric_control.observer.error_model import (
    axis_matrices,
    coulomb_level,
    own_axis,
)
from dryfric_control.order import check_quantum_and_dt
from dryfric_control.text import documented, stated

#: Bandwidth over that at which a change of friction by the Coulomb level moves the axis by one
#: increment, sqrt(F_c / (m q)).
BANDWIDTH_SHARE = 0.65
#: Least and largest bandwidth times the sampling time where none is given [rad/sample].
SLOWEST = 0.03
FASTEST = 0.7
#: What one increment moves the velocity by, times this, is no motion yet [1]: of a position of
#: metres in increments of 1 um the round-off is some 1e-9 of an increment.
REST_MARGIN = 1.001

#: Places of the numbers that the compiled sample reads.
(
    DT,  # sampling time [s]
    A12,  # sliding mode: x+ = x + A12 v + B1 F, v+ = A22 v + B2 F
    A22,
    B1,
    B2,
    GAIN_X,  # gains of position [1], velocity [1/s] and force [N/m]
    GAIN_V,
    GAIN_F,
    REST_SPEED,  # velocity below which the axis counts as resting [m/s]
    FEEDFORWARD,  # 1 with the nominal Coulomb friction, 0 without
    NUMBERS,
) = range(11)


@axis_step.internal
def _nominal_friction(numbers, plant, t, memory, force, y, mode):
    """Nominal Coulomb friction [N]; at rest it balances the other forces, up to its level."""
    if numbers[FEEDFORWARD] == 0.0:
        return 0.0
    direction = float(mode)
    if mode == 0:
        direction = 1.0 if force > 0.0 else -1.0
    level = axis_step.coulomb_level(plant, t, y, memory[VHAT], force, direction, memory[REST])
    if mode == 0:
        level = min(level, abs(force))
    return direction * level


@axis_step.internal
def _sample(numbers, plant, memory, t, u, y, out, row):
    if memory[NODE] == 0.0:
        memory[NODE] = 1.0
        memory[XHAT] = y
    drive = axis_step.input_map(plant, t, memory, u)
    mean = mean_drive(plant, numbers[DT], memory, drive)
    error = y - memory[XHAT]
    memory[XHAT] += numbers[GAIN_X] * error
    memory[VHAT] += numbers[GAIN_V] * error
    memory[WHAT] += numbers[GAIN_F] * error
    v = memory[VHAT]
    mode = 0
    if abs(v) > numbers[REST_SPEED]:
        mode = 1 if v > 0.0 else -1
    memory[MODE] = mode
    force = axis_step.load_under(plant, mean, t, y, v, float(mode), memory[REST])
    nominal = _nominal_friction(numbers, plant, t, memory, force, y, mode)
    out[row] = memory[XHAT]
    out[row + 1] = v
    out[row + 2] = nominal - memory[WHAT]
    out[row + 3] = memory[WHAT]
    out[row + 4] = mode
    net = force - nominal + memory[WHAT]
    memory[XHAT] += numbers[A12] * v + numbers[B1] * net
    memory[VHAT] = numbers[A22] * v + numbers[B2] * net
    memory[REST] = memory[REST] + numbers[DT] if mode == 0 else 0.0
    shift_drive(plant, numbers[DT], memory, drive)


@njit(cache=True, error_model="numpy")
def step(numbers, axis_numbers, axis_integers, memory, t, u, y, out):
    """One sample: outputs into `out`, `memory` advanced."""
    plant = axis_step.point(axis_numbers, axis_integers)
    pointers = (
        axis_step.pointer(numbers),
        axis_step.pointer(memory),
        axis_step.pointer(out),
    )
    _sample(pointers[0], plant, pointers[1], t, u, y, pointers[2], 0)


@njit(cache=True, error_model="numpy")
def run(numbers, axis_numbers, axis_integers, memory, u, y, known, out):
    """Run over a whole record, outputs into `out`, one row per sample."""
    own = axis_numbers.copy()
    plant = axis_step.point(own, axis_integers)
    values = axis_step.pointer(numbers)
    state = axis_step.pointer(memory)
    rows = axis_step.pointer(out)
    for k in range(u.shape[0]):
        t = k * values[DT]
        if known.shape[0] > 0:
            axis_step.set_known_force(plant, t, values[DT], known, k, False)
        _sample(values, plant, state, t, u[k], y[k], rows, out.shape[1] * k)


class Tables(NamedTuple):
    """An extended state observer as the arrays that the compiled sample reads."""

    numbers: Floats
    axis_numbers: Floats
    axis_integers: Ints


@documented
@dataclass(frozen=True)
class ExtendedStateObserver(Observer):
    """A linear observer with an unknown force as its third state.

    Made by `extended_state_observer`.

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    >>> dfc.extended_state_observer(axis, bandwidth=200.0).gains.shape
    (3,)
    """

    axis: FrictionAxis = stated("The nominal axis.")
    dt: float = stated("Sampling time [s].")
    encoder_quantum: float = stated("Increment of the position sensor [m].")
    bandwidth: float = stated("Bandwidth [rad/s].")
    feedforward: bool = stated("Whether the nominal Coulomb friction acts in the model.")
    rest_speed: float = stated("Velocity below which the axis counts as resting [m/s].")
    title = "extended state observer"
    suffix = "_extended_observer"
    sample_kernel = Kernel(step, run)
    certificate_text = (
        "A linear observer with three equal poles carries no certificate: its error is bounded by "
        "the rate at which the unknown force changes."
    )
    _kind = "extended state observer"

    @property
    def gains(self) -> Floats:
        """Gains of position [1], velocity [1/s] and force [N/m], shape (3,)."""
        return bandwidth_gains(self.axis, self.dt, self.bandwidth)

    def tables(self) -> Tables:
        """Arrays that the compiled observer reads."""
        A, B = axis_matrices(self.axis, 1, self.dt, "zoh")
        numbers = np.zeros(NUMBERS)
        numbers[DT] = self.dt
        numbers[A12] = A[0, 1]
        numbers[A22] = A[1, 1]
        numbers[B1] = B[0]
        numbers[B2] = B[1]
        numbers[[GAIN_X, GAIN_V, GAIN_F]] = self.gains
        numbers[REST_SPEED] = self.rest_speed
        numbers[FEEDFORWARD] = self.feedforward
        arrays = self.axis.arrays(self.dt)
        return Tables(numbers, arrays.numbers, arrays.integers)

    def memory(self, reading: float = 0.0) -> Floats:
        """Memory before the first sample, shape (nstates,).

        Parameters
        ----------
        reading : float, optional
            Of no effect: the observer begins at the first reading by itself.
        """
        history = int(self.axis.arrays(self.dt).integers[axis_step.N_HISTORY])
        return np.zeros(LINE + history)

    @classmethod
    def _from_saved(cls, held: Any) -> ExtendedStateObserver:
        # What a file holds passes the checks of `extended_state_observer`.
        found = super()._from_saved(held)
        return extended_state_observer(
            found.axis,
            found.dt,
            found.encoder_quantum,
            bandwidth=found.bandwidth,
            feedforward=found.feedforward,
            rest_speed=found.rest_speed,
        )


def bandwidth_gains(axis: FrictionAxis, dt: float, bandwidth: float) -> Floats:
    """Gains that put the three poles of the error at exp(-bandwidth dt), for the current form."""
    A, B = axis_matrices(axis, 1, dt, "zoh")
    # In units of one position, a position a sample, and the force that moves by it in a sample.
    units = np.array([1.0, 1.0 / dt, axis.mass / dt**2])
    plant = np.eye(3)
    plant[:2, :2] = A
    plant[:2, 2] = B
    scaled = plant * units / units[:, None]
    # The error is (I - L C) A e: C A is the first row of A.
    pole = math.exp(-bandwidth * dt)
    gains = ct.acker(scaled.T, scaled[:1].T, [pole] * 3)
    return np.asarray(gains, dtype=float).ravel() * units


def extended_state_observer(
    axis: FrictionAxis,
    dt: float = 1e-3,
    encoder_quantum: float = 1e-6,
    *,
    bandwidth: float | None = None,
    feedforward: bool = False,
    rest_speed: float | None = None,
) -> ExtendedStateObserver:
    """Linear observer whose third state is the unknown force.

    Its methods are `run`, `block`, `stepper`, `save` and `load`.

    Parameters
    ----------
    axis : FrictionAxis
        The nominal axis.
    dt : float, optional
        Sampling time [s].
    encoder_quantum : float, optional
        Increment of the position sensor [m], for the defaults of the others.
    bandwidth : float, optional
        Bandwidth of the observer [rad/s].  Default: 0.65 of that at which a change of friction
        by the Coulomb level moves the axis by one increment, 0.03 to 0.7 rad a sample.
    feedforward : bool, optional
        Whether the nominal Coulomb friction acts in the model, so that the third state estimates
        what it lacks; otherwise it estimates all of the friction.
    rest_speed : float, optional
        Velocity below which the axis counts as resting [m/s].  Default: just above that by which
        one increment moves the estimate, at least half the stick velocity of `axis`.

    Returns
    -------
    ExtendedStateObserver
        Outputs as of `observe`; `what` is the third state.

    Notes
    -----
    With the exactly sampled sliding mode (A, B) and the nominal friction F (0 without
    `feedforward`), corrected by each reading y and then predicted ::

        e = y - x,    (x, v, w) += L e,    (x, v)+ = A (x, v) + B (u - F + w),    w+ = w

    with L such that all poles of the error lie at exp(-bandwidth dt): Gao's parametrisation by the
    bandwidth (American Control Conference 2003) in its sampled, current form (Miklosovic, Radke and
    Gao, American Control Conference 2006).  It follows a constant force without error.  It has no
    modes: at a reversal friction jumps, and the estimate needs some 3 / bandwidth to follow;
    `design_pi_observer` and `hybrid_filter` switch there.  `mode` is the sign of the velocity.

    Examples
    --------
    Without viscous friction the gains are 1 - b^3, 3 (1 - b)^2 (1 + b) / (2 dt) and
    m (1 - b)^3 / dt^2 with b = exp(-bandwidth dt):

    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=0.0, coulomb=8.0)
    >>> observer = dfc.extended_state_observer(axis, dt=1e-3, bandwidth=693.147181)  # b = 1/2
    >>> print([round(float(gain), 3) for gain in observer.gains])
    [0.875, 562.5, 250000.0]
    """
    own = own_axis(axis)
    dt = sampling_time(dt)
    quantum = increment(encoder_quantum, axis.unit("m"))
    check_quantum_and_dt("encoder_quantum", quantum, dt)
    if bandwidth is None:
        level = coulomb_level(own)
        if level <= 0.0:
            raise ValueError(
                "bandwidth has no default on an axis without Coulomb friction: give it [rad/s]"
            )
        whole = math.sqrt(level / (own.mass * quantum))
        bandwidth = min(max(BANDWIDTH_SHARE * whole, SLOWEST / dt), FASTEST / dt)
    bandwidth = positive("bandwidth", bandwidth, unit="rad/s")
    feedforward = check_boolean("feedforward", feedforward)
    if rest_speed is None:
        one_increment = REST_MARGIN * bandwidth_gains(own, dt, bandwidth)[1] * quantum
        rest_speed = max(one_increment, own.stick_speed)
    rest_speed = positive("rest_speed", rest_speed, unit=axis.unit("m/s"))
    return ExtendedStateObserver(own, dt, quantum, bandwidth, feedforward, rest_speed)
