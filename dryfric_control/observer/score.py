"""How well an estimate follows the plant, in the figures the paper shows."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from dryfric_control.arrays import Floats
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.ties import samples

#: Time the observer has to forget its start before position, and before speed
#: and friction, are judged [s].
SETTLED_POSITION, SETTLED = 0.1, 0.2


@dataclass(frozen=True)
class EstimateScore:
    """Errors of an estimate against the plant, after 0.1 s or 0.2 s."""

    position: float  # largest, after 0.1 s [m]
    speed: float  # RMS over the RMS of the speed, after 0.2 s [1]
    friction: float  # mean size in slip over the mean Coulomb level there [1]
    friction_bias: float  # with sign: positive if overestimated [1]
    commutation: float  # samples with another mode than the plant's [1]

    def __repr__(self) -> str:
        figures = ", ".join(f"{name}={value:.4g}" for name, value in asdict(self).items())
        return f"{type(self).__name__}({figures})"

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers."""
        return asdict(self)

    def summary(self, unit: str = "m") -> str:
        """The five figures in words."""
        return (
            f"position     at most {self.position:.3g} {unit} off after {SETTLED_POSITION:g} s\n"
            f"velocity     {100 * self.speed:.2f} % of its RMS after {SETTLED:g} s\n"
            f"friction     {100 * self.friction:.2f} % of the Coulomb level in slip "
            f"(bias {100 * self.friction_bias:+.2f} %)\n"
            f"mode         {100 * self.commutation:.2f} % of the samples in another mode"
        )


def score_estimate(axis: FrictionAxis, dt: float, plant: Floats, estimate: Floats) -> EstimateScore:
    """Score rows xhat, vhat, Fhat, what, mode by rows x, v, F, mode; nan for what they lack."""
    x, v, friction, mode = plant[:4]
    axis = axis.effective()
    near, late = samples(SETTLED_POSITION, dt), samples(SETTLED, dt)
    slip = np.flatnonzero(mode != 0)
    slip = slip[slip >= late]
    place = np.clip(x[slip], *axis.travel) if axis.travel else x[slip]
    direction = mode[slip]
    level = np.where(direction > 0, axis.coulomb(place, 1), axis.coulomb(place, -1))
    wrong = estimate[2, slip] - friction[slip]
    scale = level.mean() if slip.size else np.nan
    moved = np.sqrt(np.mean(v[late:] ** 2)) if v.size > late else 0.0
    return EstimateScore(
        position=float(np.max(np.abs(x - estimate[0])[near:], initial=0.0)),
        speed=float(np.sqrt(np.mean((v - estimate[1])[late:] ** 2)) / moved) if moved else np.nan,
        friction=float(np.mean(np.abs(wrong)) / scale) if slip.size else np.nan,
        friction_bias=float(np.mean(direction * wrong) / scale) if slip.size else np.nan,
        commutation=float(np.mean(mode != estimate[4])),
    )


def switch_delays(mode: Floats, estimated: Floats, dt: float) -> tuple[Floats, Floats]:
    """Time of every switch, and delay of the estimate [s]: negative if before, nan if it misses."""
    places = np.flatnonzero(np.diff(mode)) + 1
    ends = np.append(places, mode.size)[1:]
    starts = np.concatenate([[0], places[:-1]]).astype(int)[: places.size]
    delay: Floats = np.full(places.size, np.nan)
    for i, (start, place, end) in enumerate(zip(starts, places, ends, strict=True)):
        right = estimated[start:end] == mode[place]
        after = np.flatnonzero(right[place - start :])
        if after.size:
            first = place - start + after[0]
            if after[0] == 0:
                before = np.flatnonzero(~right[:first])
                first = before[-1] + 1 if before.size else 0
            delay[i] = (first + start - place) * dt
    return np.asarray(places * dt, dtype=float), delay
