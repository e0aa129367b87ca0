"""The random force that remains with the causes found in the model."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import welch

from dryfric_control.diagnosis.thresholds import MAX_RANDOM_FORCE_RATIO
from dryfric_control.estimation.random_force import integrate_autocorrelation, products
from dryfric_control.estimation.solution import Solution
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.text import Result, documented, rotary_words, stated

# Segment length of the spectrum [samples].
_SEGMENT_LENGTH = 1024
# Largest number of values of the spectrum.
_SPECTRUM_VALUES = 40
# Longest lag of the correlation [samples].
_MAX_LAG = 200


@documented
@dataclass(frozen=True, repr=False)
class Remaining(Result):
    """Random force that remains with the causes found in the model.

    Examples
    --------
    >>> from dryfric_control.diagnosis import Remaining
    >>> left = Remaining(rms=0.24, correlation_time=0.0, structured=False, where=())
    >>> left
    random force left: 0.24 N RMS per sample, no structure found
    >>> left.to_dict()["rms"]
    0.24
    """

    rms: float = stated(
        "Its RMS [N], as a force held over each sample; 0 if the errors of free runs do not exceed "
        "the noise of the readings.",
        0.0,
    )
    correlation_time: float = stated("[s]; 0 for white noise and below one sample.", 0.0)
    structured: bool = stated(
        "Whether free runs have larger errors than a white force of this size causes.", False
    )
    where: tuple[str, ...] = stated("Where they have, in words.", ())
    frequency: tuple[float, ...] = stated("Of the spectrum [Hz]; empty if `rms` is 0.", ())
    spectrum: tuple[float, ...] = stated("Power density of the force while sliding [N^2/Hz].", ())
    unit: str = stated("Unit of the force.", "N")

    @property
    def headline(self) -> str:
        """The force in one line."""
        if self.rms == 0.0:
            return "no random force left"
        kind = "structured" if self.structured else "no structure found"
        if self.correlation_time > 0.0:
            kind += f", correlation time {self.correlation_time:.2g} s"
        name = rotary_words("random force left", self.unit)
        return f"{name}: {self.rms:.3g} {self.unit} RMS per sample, {kind}"

    def _summary_parts(self) -> list[str]:
        return [self.headline, *self.where]


def mutes_friction(force: float, axis: FrictionAxis) -> bool:
    """Whether a random force is too large, beside the friction of an axis, to explain anything."""
    return force > max(MAX_RANDOM_FORCE_RATIO * axis.coulomb.mean, 0.0)


def remaining_force(
    found: Solution, structured: bool, where: Sequence[str], unit: str
) -> Remaining:
    """Random force of a fit, from the filter's corrections of the velocity."""
    force = []
    sizes = []
    lags = np.zeros(_MAX_LAG + 1)
    count = 0
    for i, (state, run) in enumerate(zip(found.point.states, found.problem.runs, strict=True)):
        axis = found.problem.axis_at(found.z, i)
        sliding = (state[2] != 0.0) & run.active
        pushed = np.where(sliding, axis.mass * state[3] / run.record.dt, 0.0)
        # A single impact must not dominate the spectrum.
        size = np.quantile(np.abs(pushed[sliding]), 0.99) if sliding.any() else 0.0
        pushed = np.clip(pushed, -size, size)
        density = welch(pushed, 1.0 / run.record.dt, nperseg=min(_SEGMENT_LENGTH, pushed.size))
        # At rest the force is 0, which has no part in its density while sliding.
        force.append((density[0], density[1] / max(float(sliding.mean()), 1.0 / pushed.size)))
        sizes.append(found.random_force(i))
        last = min(_MAX_LAG, pushed.size - 1)
        lags[: last + 1] += products(pushed, last)
        count += int(sliding.sum())
    frequency, spectrum = force[0]
    edges = np.unique(np.geomspace(1, frequency.size, _SPECTRUM_VALUES + 1).astype(int))
    bands = [slice(a, b) for a, b in itertools.pairwise(edges)]
    middle = tuple(float(frequency[band].mean()) for band in bands)
    power = tuple(float(spectrum[band].mean()) for band in bands)
    time = 0.0
    if lags[0] > 0.0 and count > 10:
        samples = integrate_autocorrelation(lags[:-1] / lags[0], count)
        time = found.problem.runs[0].record.dt * samples if samples >= 1.0 else 0.0
    rms = float(np.sqrt(np.mean(np.square(sizes))))
    return Remaining(rms, time, structured, tuple(where), middle, power, unit)
