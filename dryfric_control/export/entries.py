"""One sample of what is exported, as the generated C calls it.

Written in the language of the compiled kernels and translated with them.
"""

# mypy: allow-untyped-defs

from __future__ import annotations

from dryfric_control.compiled import axis_step, compensation


def minimum(a, b):
    """The smaller of two numbers."""
    return b if b < a else a


def maximum(a, b):
    """The larger of two numbers."""
    return b if b > a else a


def compensate(law, memory, t, xref, vref, aref, y, out):
    """One sample of the compensated controller: drive, and the part that is friction."""
    out[0] = compensation.step(law, memory, xref, vref, aref, y)
    out[1] = memory[compensation.FORCE]


def move(numbers, integers, memory, t, dt, u, first, events, count, out):
    """One sample of the axis with a held input: what it shows first, then its motion."""
    plant = axis_step.point(numbers, integers)
    if first:
        # The mode at the start is chosen, not switched to.
        memory[axis_step.MODE] = axis_step.outputs(plant, t, dt, memory, u)[2]
    out[0] = axis_step.encoder_reading(plant, t, memory)
    out[1], out[2], out[3] = axis_step.sample(plant, t, dt, u, u, memory, events, count)


def axis_outputs(numbers, integers, memory, t, dt, u, out):
    """What the axis shows under an input, without a motion."""
    plant = axis_step.point(numbers, integers)
    out[0] = axis_step.encoder_reading(plant, t, memory)
    out[1], out[2], out[3] = axis_step.outputs(plant, t, dt, memory, u)
