"""Stribeck peak and stick speed from stick-slip ripple."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from dryfric_control.axis import FrictionAxis
from dryfric_control.friction import Stribeck
from dryfric_control.identification.fit import Fit, fit_windows
from dryfric_control.identification.replay import LoopReplay, replay_loop
from dryfric_control.identification.stick_slip import Ripple, Sticks, ripple, stick_phases
from dryfric_control.identification.windows import cut
from dryfric_control.loops import PositionController
from dryfric_control.records import Record

if TYPE_CHECKING:
    import control as ct

_FEWEST = 5
# The peak is looked for from this part of the slips' speed on.
_SLOWEST = 0.1


@dataclass(frozen=True, eq=False)
class StribeckIdentification:
    """Stribeck peak found in a record, and how well its ripple comes back.

    Made by `identify_stribeck`.

    Attributes
    ----------
    fit : Fit
        The fit: parameters, standard errors, what is not determined.
    measured : Ripple or None
        Ripple of the record.
    replayed : Ripple or None
        Ripple of the model in the same loop, where the controller is known.
    loop : LoopReplay or None
        That replay.
    """

    fit: Fit
    measured: Ripple | None
    replayed: Ripple | None
    loop: LoopReplay | None

    @property
    def axis(self) -> FrictionAxis:
        """The axis with its Stribeck peak and stick speed."""
        return self.fit.axis

    @property
    def stribeck(self) -> Stribeck:
        """The peak found."""
        assert self.axis.stribeck is not None
        return self.axis.stribeck

    def summary(self) -> str:
        """Parameters, and the ripple measured and replayed."""
        lines = [self.fit.summary()]
        for name, one in (("measured", self.measured), ("replayed", self.replayed)):
            if one is not None:
                lines.append(
                    f"ripple {name}: amplitude {one.amplitude:.4g} {self.axis.units[1]}, period "
                    f"{one.period:.4g} s, slip {one.slip:.4g} {self.axis.units[0]}, "
                    f"{one.count} slips"
                )
        return "\n".join(lines)

    def __repr__(self) -> str:
        return self.summary()

    def to_dict(self) -> dict[str, Any]:
        """Numbers of the result, ready for JSON.

        Returns
        -------
        dict
        """
        return {
            "fit": self.fit.to_dict(),
            "measured": self.measured.to_dict() if self.measured else None,
            "replayed": self.replayed.to_dict() if self.replayed else None,
        }

    def plot(self, ax: Any = None) -> ct.ControlPlot:
        """Draw drive force over position, measured and replayed (paper, Fig. 6).

        Parameters
        ----------
        ax : sequence of two Axes, optional
            Where to draw; a new figure when left out.

        Returns
        -------
        control.ControlPlot
        """
        from dryfric_control.identification.figures import plot_stribeck

        return plot_stribeck(self, ax)


def identify_stribeck(
    axis: FrictionAxis,
    record: Record,
    controller: PositionController | None = None,
    *,
    free: Sequence[str] = ("stribeck", "stick_speed", "coulomb_map"),
    starts: int = 6,
    seed: int = 0,
    jobs: int = 1,
    progress: bool = False,
) -> StribeckIdentification:
    """Stick speed Sigma, excess sigma and speed vs from stick-slip.

    Parameters
    ----------
    axis : FrictionAxis
        The axis with its Coulomb levels, see `identify_coulomb`.
    record : Record
        A crawl in which the axis sticks and slips.
    controller : PositionController, optional
        The loop that ran, to replay the ripple with the model.
    free : sequence of str, optional
        What to fit, see `fit`.  The Coulomb levels are fitted again by
        default: a crawl inside the peak has raised them.
    starts : int, optional
        Number of starting points.
    seed : int, optional
        Seed of the starting points.
    jobs : int, optional
        Number of starts that run at the same time.
    progress : bool, optional
        Whether to show a progress bar.

    Returns
    -------
    StribeckIdentification

    Raises
    ------
    ValueError
        If the record holds fewer than five stick phases.

    Notes
    -----
    Free runs as in `fit`, but each window starts in the middle of a stick
    phase and ends in the next: it holds one break-away, which tells the
    excess, and one slip, which tells over what speed the excess dies.

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> from dryfric_control.identification import slow_ramp_experiment
    >>> true = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0, travel=(0.0, 0.1),
    ...                         stribeck=dfc.Stribeck(excess=0.3, speed=0.01))
    >>> ramp = slow_ramp_experiment(true, duration=20.0, quantum=1e-6)
    >>> found = identify_stribeck(true.replace(stribeck=None), ramp.record, starts=2)
    >>> round(found.stribeck.excess, 2), round(found.stribeck.speed, 3)
    (0.3, 0.01)
    """
    if not isinstance(axis, FrictionAxis):
        raise ValueError(f"axis must be a FrictionAxis, got {type(axis).__name__}")
    if not isinstance(record, Record):
        raise ValueError(f"record must be a Record, got {type(record).__name__}")
    sticks = stick_phases(record)
    if sticks.end.size < _FEWEST:
        raise ValueError(
            f"record holds {sticks.end.size} stick phases that end in motion, at least {_FEWEST} "
            "are needed: crawl slower, or with a softer loop"
        )
    middles = (sticks.begin + sticks.end) // 2
    inner = middles[(middles >= 5) & (middles <= len(record) - 5)]
    edges = np.unique([0, *inner, len(record)])
    windows = cut(record, edges=edges)
    if axis.stribeck is None:
        axis = axis.replace(stribeck=_first_guess(axis, record, sticks))
    found = fit_windows(axis, [windows], free, starts, seed=seed, jobs=jobs, progress=progress)
    loop = replayed = None
    if controller is not None:
        loop = replay_loop(found.axis, record, controller)
        y = loop.response.y
        replayed = ripple(
            Record(record.t, y[4], y[5], record.reference, quantum=record.quantum or 0.0)
        )
    return StribeckIdentification(found, ripple(record), replayed, loop)


def _first_guess(axis: FrictionAxis, record: Record, sticks: Sticks) -> Stribeck:
    """Excess from the forces at break-away, speed from that of the slips."""
    ratios = []
    for s in (1, -1):
        at = sticks.end[sticks.direction == s] - 1
        level = np.maximum(axis.coulomb(record.x[at], s), 1e-300)
        ratios.append(s * record.u[at] / level - 1.0)
    excess = float(np.clip(np.median(np.concatenate(ratios)), 0.02, 3.0))
    speed = np.abs(record.derivatives().v)
    slips = [speed[a:b].max() for a, b in zip(sticks.end[:-1], sticks.begin[1:], strict=True)
             if b > a]  # fmt: skip
    return Stribeck(excess, _SLOWEST * float(np.median(slips)) if slips else axis.stick_speed)
