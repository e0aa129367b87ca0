"""Fit of an axis to the drive of sliding samples, for imposed motion.

If a tight position loop or a bench imposes the motion, it contains no information about
the forces: a straight line predicts the readings better than any model.  The drive then
*is* the force that the motion requires (theory: friction as the input of a slow walk), and
its deviation from the model is the innovation.  This is treated as white although it is
correlated, as a random-walk force would absorb every slow cause.  The evidence that this
overstates is corrected by the blocks of the record, in standard errors and on held-out data.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from dryfric_control.arrays import Floats, Ints
from dryfric_control.compiled.likelihood import FIRST
from dryfric_control.compiled.windowed_runs import contact_deflection
from dryfric_control.estimation.force_residual import Sliding, at_the_samples
from dryfric_control.estimation.likelihood import Likelihood, Run, prepare
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.records.record import Record

# Length of the blocks over which scores are summed, longer than the likely correlation time
# of the innovations [s].
_BLOCK = 1.0


@dataclass(frozen=True, eq=False)
class ForceRun(Run):
    """One record, prepared for the force view."""

    sliding: Sliding  # its sliding samples, with their smoothed motion
    index: Ints  # their indices in the record, shape (nsliding,)
    hold: str  # how the drive runs between samples

    def force_residual(self, axis: FrictionAxis) -> Floats:
        """Force that the axis would need in addition to its drive, shape (nsliding,)."""
        one = self.sliding
        inner = [effect.inner(axis) for effect in axis.effects]
        contact, bristles = max(((i.contact, i.bristles) for i in inner), default=(0.0, 0.0))
        if contact == 0.0 or not one.direction.size:
            return one.force_residual(axis)
        # An elastic contact carries the part of the friction to which the motion since the last
        # reversal has strained it.
        middle = np.mean(self.record.x)
        level = 0.5 * sum(float(axis.coulomb(middle, s)) for s in (1, -1))
        share = np.empty(len(self.record))
        start = float(one.direction[0])
        contact_deflection(self.record.x, level / contact, start, bristles > 0.0, share)
        share = share[self.index]
        ahead = one.force_residual(axis, np.full_like(one.direction, 1))
        back = one.force_residual(axis, np.full_like(one.direction, -1))
        return np.asarray(0.5 * ((1.0 + share) * ahead + (1.0 - share) * back))


def prepare_force(
    record: Record, hold: str = "zero", load_errors: Floats | None = None
) -> ForceRun:
    """A record prepared for the force view: its sliding samples are active.

    `load_errors`: what its known load may be off, see `Run`.
    """
    run = prepare(record, block=_BLOCK)
    if load_errors is not None:
        run = replace(run, load_errors=load_errors)
    sliding = Sliding(record)
    index = np.searchsorted(record.t, sliding.t)
    if hold == "first":
        # The forces at that instant, not their means around it.
        sliding.u, known = record.u[index], record.known_force
        sliding.load = known[index] if known.size else known
    active = np.zeros(len(record), bool)
    active[index] = True
    active[: FIRST + 1] = False
    given: dict[str, Any] = {f.name: getattr(run, f.name) for f in fields(Run)}
    return ForceRun(**given | {"active": active}, sliding=sliding, index=index, hold=hold)


class ForceView(Likelihood):
    """Likelihood whose innovations are the drive that the motion needs minus the measured one.

    A model with a low sensitivity to its drive needs more of it.  Readings have no noise.
    """

    runs: tuple[ForceRun, ...]

    def _bound_noises(self) -> None:
        super()._bound_noises()
        n = len(self.names)
        self.low[n + 1 :: 2] = self.high[n + 1 :: 2] = 0.0

    @property
    def is_recursive(self) -> bool:
        return False

    def _slope_of_force(self, *_: Any) -> bool:
        # Differences are as cheap here, and exact.
        return False

    def innovations(self, z: Floats, i: int) -> tuple[Floats, Floats]:
        """Innovations of record i, and its motion in place of filtered states."""
        run = self.runs[i]
        axis = self.axis_at(z, i)
        n = len(run.record)
        left = run.force_residual(axis)
        error = self.load_error(z, i)
        if error.size:
            left -= at_the_samples(error, run.hold)[run.index]
        left /= run.sliding.answer_to_drive(axis)
        out = np.zeros((2, n))
        state = np.zeros((6, n))
        out[0, run.index], out[1, run.index] = left, self.noises(z, i)[0]
        state[0], state[1, run.index] = run.record.x, run.sliding.v
        state[2, run.index] = run.sliding.direction
        state[3, run.index] = left * run.record.dt / axis.mass
        return out, state
