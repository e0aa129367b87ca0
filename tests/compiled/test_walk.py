"""Steps of the exact simulation near places where they could become endless."""

import numpy as np
from scipy.integrate import solve_ivp

import dryfric_control as dfc
from dryfric_control.compiled import axis_step


def test_a_load_that_changes_its_sign_without_a_level_is_passed():
    # Without dry friction the band around zero load has no width to stop in; while parameters
    # are searched, a step may be off by more than it would be otherwise.  Round-off of these
    # numbers made an end of the steps impossible.
    cogging = dfc.effects.Cogging(0.10037269687374795, 0.011194895705521474, -1.7562308709715575)
    axis = dfc.FrictionAxis(mass=1.0, viscous=940.3783435314627, coulomb=0.0, effects=cogging)
    dt, u = 0.01, np.array([0.24286985793950053, -0.05316289110100975])
    start = 0.03361219675132647, -0.006907789665386662
    arrays = axis.arrays(dt)
    numbers, memory = arrays.numbers.copy(), np.zeros(max(arrays.memory, 8))
    numbers[axis_step.ALLOWED] = 0.00027000000000000006
    numbers.setflags(write=False)  # as an axis': the run is compiled for each type of array
    memory[axis_step.X], memory[axis_step.V] = start
    axis_step.run(
        numbers, arrays.integers, memory, u, np.empty(0), dt, True, axis_step.ROOM, np.zeros((4, 2))
    )

    def rate(t, state):
        x, v = state
        force = u[0] + (u[1] - u[0]) * t / dt
        force += cogging.amplitude * np.sin(2.0 * np.pi * x / cogging.period + cogging.phase)
        return [v, force - axis.viscous * v]

    truth = solve_ivp(rate, (0.0, dt), start, method="LSODA", rtol=1e-9, atol=1e-12).y[:, -1]
    assert abs(memory[axis_step.X] - truth[0]) < 1e-7
    assert abs(memory[axis_step.V] - truth[1]) < 2.7e-4
