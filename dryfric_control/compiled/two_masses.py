"""Compiled covariance of two masses on a spring, of which the encoder sees the motor.

Its four states are position and velocity of the motor and the same of the load; with an elastic
contact the position at which the contact is unstrained is a fifth.  One of the masses has the
friction, see `friction_state`.
"""
# mypy: disallow-untyped-defs=False

from __future__ import annotations

import numpy as np

from dryfric_control.compiled import axis_step as step

# Halvings of a sample for the matrix exponential of two masses on a spring.
_SQUARED = 6


@step.internal(forceinline=True)
def friction_state(kind):
    """State that is the position of the mass with friction."""
    return 0 if kind & step.MOTOR_RUBS else 2


@step.internal
def transition(plant, dt, mode, touches):
    """How n states, and two random forces, move in one sample, shape (n + 2, n + 2).

    `touches`: whether the spring acts, which within a gap it does not.
    """
    # The last two rows and columns: random forces on the free mass and on that with friction.
    numbers = plant.numbers
    kind = plant.integers[step.STRUCTURE]
    stiffness = numbers[step.STIFFNESS] if touches else 0.0
    damping = numbers[step.DAMPING] if touches else 0.0
    free = numbers[step.INVERSE_MOTOR]
    rubs = numbers[plant.integers[step.N_NUMBERS] + step.INVERSE_MASS]
    contact = kind & step.CONTACT != 0
    b = friction_state(kind)
    n = 5 if contact else 4
    a = 2 - b
    rates = np.zeros((n + 2, n + 2))
    rates[a, a + 1] = 1.0
    rates[a + 1, a], rates[a + 1, a + 1] = -stiffness * free, -damping * free
    rates[a + 1, b], rates[a + 1, b + 1] = stiffness * free, damping * free
    rates[a + 1, n] = free
    holds = numbers[step.CONTACT_STIFFNESS] if contact and mode == 0.0 else 0.0
    if mode != 0.0 or holds > 0.0:
        rates[b, b + 1] = 1.0
        rates[b + 1, a], rates[b + 1, a + 1] = stiffness * rubs, damping * rubs
        rates[b + 1, b] = -(stiffness + holds) * rubs
        rates[b + 1, b + 1], rates[b + 1, n + 1] = -(damping + numbers[step.VISCOUS]) * rubs, rubs
    if holds > 0.0:
        rates[b + 1, 4] = holds * rubs
        rates[b + 1, b + 1] -= numbers[plant.integers[step.N_NUMBERS] + step.STICK_RATE]
    # exp(rates dt) by squaring.
    moves = np.eye(n + 2)
    term = np.eye(n + 2)
    rates *= dt / 2.0**_SQUARED
    for i in range(1, 6):
        term = term @ rates / i
        moves += term
    for _ in range(_SQUARED):
        moves = moves @ moves
    return moves


@step.internal
def predict(moves, cov, force, pinned, work):
    """Covariance of two masses one sample later, in place; `pinned`: one known to rest, or -1."""
    # The random force, of variance `force`, moves the motor, as noise of the drive, and the load
    # by as much, as what is not modelled: a load whose model is wrong would else be followed as
    # if it were known.
    n = cov.shape[0]
    for i in range(n):
        for j in range(n):
            work[i, j] = 0.0
            for k in range(n):
                work[i, j] += moves[i, k] * cov[k, j]
    for i in range(n):
        for j in range(i + 1):
            total = force * (moves[i, n] * moves[j, n] + moves[i, n + 1] * moves[j, n + 1])
            for k in range(n):
                total += work[i, k] * moves[j, k]
            cov[i, j] = cov[j, i] = total
    if pinned >= 0:
        for i in range(n):
            cov[pinned + 1, i] = cov[i, pinned + 1] = 0.0


@step.internal
def stick_contact(cov, at, unknown):
    """Set a contact that begins to stick in cov; its strain is uncertain by `unknown` besides."""
    for i in range(5):
        cov[4, i] = cov[at, i]
    for i in range(5):
        cov[i, 4] = cov[i, at]
    cov[4, 4] = cov[at, at] + unknown
    return 0.0


@step.internal
def correct(cov, at, variance, work):
    """Covariance of two masses after a reading of a state, in place; `variance`: expected."""
    for i in range(cov.shape[0]):
        work[0, i] = cov[i, at]
    for i in range(cov.shape[0]):
        for j in range(i + 1):
            cov[i, j] -= work[0, i] * work[0, j] / variance
            cov[j, i] = cov[i, j]


@step.internal
def rigid_covariance(cov, place, speed, strain, mode):
    """Covariance of two masses that move as one, by variances; `strain`: of their distance."""
    cov[:] = 0.0
    cov[0, 0] = cov[0, 2] = cov[2, 0] = place
    cov[2, 2] = place + strain
    cov[1, 1] = speed
    if mode != 0.0:
        cov[1, 3] = cov[3, 1] = cov[3, 3] = speed
