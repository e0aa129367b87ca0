"""What a data logger makes of a sound record: noise, few bits, lost samples.

The machine ran as it did; only what was written down is changed.

    noisy      white noise on u, 3 % of the Coulomb level
    10-bit     u in 1023 steps over its range
    decimated  every fourth sample (250 Hz); u is the mean of the four for even
               seeds, the value at that moment for odd ones
    jitter     stamps up to 0.3 ms late, and 0.5 % of the samples lost, up to three
               in a row.  For even seeds the readings were taken at the stamped
               times; for odd seeds they were taken on time and stamped late
    outliers   0.1 % of the readings jump by 0.2 to 20 % of the range; in 0.5 % of
               the samples the reading before is written down once more
"""

import numpy as np
from numpy.typing import NDArray

from .plant import V, X

Array = NDArray[np.float64]

RECORDERS = ("noisy", "10-bit", "decimated", "jitter", "outliers")
FACTOR = 4  # of the decimation
LATE = 0.3  # of one step, largest jitter


def recorded(
    how: str, t: Array, u: Array, x: Array, states: Array, quantum: float, level: float,
    odd: bool, rng: np.random.Generator,
) -> tuple[Array, Array, Array, NDArray[np.intp]]:  # fmt: skip
    """Time, input and reading as written down, and the samples they come from."""
    n, every = t.size, np.arange(t.size)
    if how == "noisy":
        return t, noisy(u, 0.03 * level, rng), x, every
    if how == "10-bit":
        step = np.ptp(u) / 1023.0
        return t, u.min() + step * np.round((u - u.min()) / step), x, every
    if how == "decimated":
        pick = every[: n // FACTOR * FACTOR : FACTOR]
        mean = u[: pick.size * FACTOR].reshape(-1, FACTOR).mean(axis=1)
        return t[pick], u[pick] if odd else mean, x[pick], pick
    if how == "jitter":
        late = rng.uniform(0.0, LATE, n) * (t[1] - t[0])
        starts = 1 + 8 * np.flatnonzero(rng.random((n - 8) // 8) < 0.02)
        lost = np.concatenate([np.arange(k, k + rng.integers(1, 4)) for k in starts])
        keep = np.setdiff1d(every[:-1], lost)
        if not odd:
            x = _read_late(late, t[1] - t[0], x, states, quantum)
        return (t + late)[keep], u[keep], x[keep], keep
    x = x.copy()
    for k in np.flatnonzero(rng.random(n) < 0.005):
        x[k] = x[max(k - 1, 0)]
    for k in 1 + np.flatnonzero(rng.random(n - 2) < 0.001):
        jump = np.ptp(states[:, X]) * 10.0 ** rng.uniform(np.log10(0.002), np.log10(0.2))
        x[k] += quantum * np.round(rng.choice((-1.0, 1.0)) * jump / quantum)
    return t, u, x, every


def noisy(u: Array, size: float, rng: np.random.Generator) -> Array:
    """An input with white noise of a standard deviation."""
    return u + size * rng.standard_normal(u.size)


def _read_late(late: Array, dt: float, x: Array, states: Array, quantum: float) -> Array:
    """Readings that were taken `late`: cubic paths between the true states, rounded."""
    x0, v0 = states[:-1, X], states[:-1, V] * dt
    x1, v1 = states[1:, X], states[1:, V] * dt
    s = late[:-1] / dt
    path = x0 + s * (v0 + s * (3.0 * (x1 - x0) - 2.0 * v0 - v1 + s * (2.0 * (x0 - x1) + v0 + v1)))
    # The noise of the reading, whatever it was, goes with it.
    moved = np.append(path - x0, 0.0)
    return np.asarray(quantum * np.round((x + moved) / quantum))
