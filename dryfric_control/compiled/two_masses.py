"""Compiled covariance of two masses on a spring, of which the encoder sees the motor.

Its four states are position and velocity of the motor and the same of the load; with an elastic
contact the position at which the contact of the load is unstrained is a fifth.
"""
# mypy: disallow-untyped-defs=False

from __future__ import annotations

import numpy as np

from dryfric_control.compiled import axis_step as step

# Halvings of a sample for the matrix exponential of two masses on a spring.
_SQUARED = 6


@step.internal
def transition(plant, dt, mode):
    """How n states, and two random forces, move in one sample, shape (n + 2, n + 2)."""
    # The last two rows and columns: random forces on the motor and on the load.
    numbers, kind = plant.numbers, plant.integers[step.STRUCTURE]
    stiffness, damping = numbers[step.STIFFNESS], numbers[step.DAMPING]
    motor = numbers[step.INVERSE_MOTOR]
    load = numbers[plant.integers[step.N_NUMBERS] + step.INVERSE_MASS]
    contact = kind & step.CONTACT != 0
    n = 5 if contact else 4
    rates = np.zeros((n + 2, n + 2))
    rates[0, 1] = 1.0
    rates[1, 0], rates[1, 1] = -stiffness * motor, -damping * motor
    rates[1, 2], rates[1, 3], rates[1, n] = stiffness * motor, damping * motor, motor
    holds = numbers[step.CONTACT_STIFFNESS] if contact and mode == 0.0 else 0.0
    if mode != 0.0 or holds > 0.0:
        rates[2, 3] = 1.0
        rates[3, 0], rates[3, 1] = stiffness * load, damping * load
        rates[3, 2] = -(stiffness + holds) * load
        rates[3, 3], rates[3, n + 1] = -(damping + numbers[step.VISCOUS]) * load, load
    if holds > 0.0:
        rates[3, 4] = holds * load
        rates[3, 3] -= numbers[plant.integers[step.N_NUMBERS] + step.STICK_RATE]
    # exp(rates dt) by squaring.
    moves, term = np.eye(n + 2), np.eye(n + 2)
    rates *= dt / 2.0**_SQUARED
    for i in range(1, 6):
        term = term @ rates / i
        moves += term
    for _ in range(_SQUARED):
        moves = moves @ moves
    return moves


@step.internal
def predict(moves, cov, force, pinned, work):
    """Covariance of two masses one sample later, in place; `pinned`: the load is known to rest."""
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
    if pinned:
        for i in range(n):
            cov[3, i] = cov[i, 3] = 0.0


@step.internal
def stopped(cov, unknown):
    """Set a contact that begins to stick in cov; its strain is uncertain by `unknown` besides."""
    for i in range(5):
        cov[4, i] = cov[2, i]
    for i in range(5):
        cov[i, 4] = cov[i, 2]
    cov[4, 4] = cov[2, 2] + unknown
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
def joined(cov, place, speed, strain, mode):
    """Covariance of two masses that move as one, by variances; `strain`: of their distance."""
    cov[:] = 0.0
    cov[0, 0] = cov[0, 2] = cov[2, 0] = place
    cov[2, 2] = place + strain
    cov[1, 1] = speed
    if mode != 0.0:
        cov[1, 3] = cov[3, 1] = cov[3, 3] = speed
