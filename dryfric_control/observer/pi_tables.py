"""The numbers of a switched PI observer as its compiled sample reads them."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from dryfric_control.arrays import Floats, Ints
from dryfric_control.checks import finite, one_of, positive
from dryfric_control.compiled import axis_step
from dryfric_control.compiled import observer as kernel

if TYPE_CHECKING:
    from dryfric_control.observer.design import ObserverDesign

#: Rules that determine the mode.
SWITCHING = {
    "reading": kernel.READING,
    "paper": kernel.PAPER,
    "filippov": kernel.FILIPPOV,
}
#: Distance of the reading from the place of rest that counts as motion [increments]: more than
#: one, since an axis at rest on an edge toggles by one.
MOTION_INCREMENTS = 1.5
#: Time over which the error of the Coulomb level is learned [time constants of the observer]:
#: long against its noise, short against one motion.
LEARNING_TIME = 8.0


class Tables(NamedTuple):
    """A design as the arrays that the compiled observer reads."""

    numbers: Floats
    matrices: Floats  # shape (3, 6), one row a mode
    gains: Floats  # shape (nnodes, 3)
    transitions: Ints  # shape (nnodes + 1, 3)
    axis_numbers: Floats
    axis_integers: Ints


def pi_tables(design: ObserverDesign, switching: str, encoder_quantum: float | None) -> Tables:
    """Arrays of a design for the compiled observer, by a rule of the mode and an increment [m]."""
    one_of("switching", switching, SWITCHING)
    axis = design.axis
    quantum = design.encoder_quantum if encoder_quantum is None else encoder_quantum
    quantum = positive("encoder_quantum", quantum, unit=axis.unit("m"), zero=True)
    numbers = np.zeros(kernel.NUMBERS)
    numbers[kernel.DT] = design.dt
    numbers[kernel.STICK_SPEED] = axis.stick_speed
    # Beyond the increments, the way on which the velocity of a stop decays.
    stop = axis.stick_speed / axis.stick_rate
    numbers[kernel.RESOLUTION] = MOTION_INCREMENTS * quantum + stop
    numbers[kernel.KEEP] = design.certificate.spectral_radius[1] ** (1.0 / LEARNING_TIME)
    numbers[kernel.RULE] = SWITCHING[switching]
    numbers[kernel.CURRENT] = design.form == "current"
    matrices = np.empty((3, kernel.COLUMNS))
    for mode in (-1, 0, 1):
        A, B, E = design.mode_matrices(mode)
        matrices[mode + 1] = A[0, 1], A[1, 1], *B, *E
    gains = np.ascontiguousarray(design.node_gains, dtype=float)
    transitions = np.vstack([design.transition_table(), design.resting_nodes()])
    arrays = axis.arrays(design.dt)
    return Tables(
        numbers,
        matrices,
        gains,
        transitions.astype(np.int64),
        arrays.numbers,
        arrays.integers,
    )


def pi_memory(design: ObserverDesign, xhat0: float, vhat0: float, what0: float) -> Floats:
    """Memory of an observer before its first sample, shape (nstates,)."""
    history = int(design.axis.arrays(design.dt).integers[axis_step.N_HISTORY])
    memory = np.zeros(kernel.LINE + history)
    memory[kernel.XHAT] = finite("xhat0", xhat0)
    memory[kernel.VHAT] = finite("vhat0", vhat0)
    memory[kernel.WHAT] = finite("what0", what0)
    return memory
