"""The best existing way to name a cause, as the peer of the diagnosis.

One cause at a time, least squares on the force residual

    r = u - m a - f v - F(v)

of the believed axis, judged on held-out blocks.  It is what a careful
engineer who knows every functional form does with numpy and scipy:

- zero-phase Savitzky-Golay derivatives, the window chosen from the encoder's
  quantum; the force and every other term pass through the very filter that
  the acceleration went through, so that smoothing biases nothing;
- the half-sample shift: a second difference of positions at sample k sees
  (u[k-1] + u[k])/2 of a held input;
- regression on samples that slide through the whole filter window, some way
  past the last standstill; one or two columns per effect, a grid where a
  parameter is not linear, delay and lag at coefficient one;
- fitted on even seconds, scored on odd ones, fewer parameters preferred;
- what lives near standstill is read from the elastic slope dx/du at rest, from
  the residual just after standstill (elastic-plastic friction or Stribeck
  explains it, or else play) and from the force at breakaway;
- every gate tuned on records that are not scored.

Run as a program it prints the gates that its tuning finds (half an hour).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
from harness import import_from
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d, minimum_filter1d
from scipy.signal import lfilter, savgol_coeffs

Array = NDArray[np.float64]
Row = tuple[str | None, dict[str, Any]]  # truth, features

NOISE = 0.02  # acceptable noise of m a, share of the Coulomb level
SETTLED = 0.01  # share of the travel: past it presliding and play are over
BLOCK = 1.0  # s, contiguous blocks: even ones fit, odd ones judge


class Gates(NamedTuple):
    """Thresholds of `decide`; the defaults are where the tuning starts."""

    gain: float = 0.2  # least held-out drop of the log squared residual
    cost: float = 0.03  # what each further parameter must earn
    compliance: float = 1.2  # the same drop, of the elastic coupling
    early: float = 0.5  # the same drop, of presliding and Stribeck after standstill
    slope: float = 3.0  # elastic deflection at the Coulomb level, quanta
    excess: float = 0.06  # residual after standstill, share of the Coulomb level
    dwell: float = 0.06  # breakaway above the believed one, share of it


TUNING = range(5000, 5020)  # seeds that no table counts

# Found by `tune`.
GATES = {
    "exact": Gates(0.055, 0.030, 1.02, 2.9, 3.0, 0.019, 0.217),
    "off": Gates(1.621, 0.335, 0.63, 1.8, 4.1, 0.014, 0.255),
    "coarse": Gates(0.076, 0.030, 1.41, 2.9, 0.60, 0.032, 0.185),
    "short": Gates(0.065, 0.026, 1.02, 2.1, 4.1, 0.0039, 0.255),
}


class Signals(NamedTuple):
    """Filtered record and what the candidates need of it."""

    t: Array
    u: Array  # raw
    x: Array
    v: Array
    a: Array
    r: Array
    filter: Callable[[Array], Array]  # the acceleration's own smoothing
    smooth: Callable[[Array], Array]  # the same for a held input: half a sample later
    sliding: NDArray[np.bool_]  # settled: some way past the last standstill
    early: NDArray[np.bool_]
    fit: NDArray[np.bool_]
    judge: NDArray[np.bool_]
    quantum: float
    slow: float


def quantum_of(x: Array) -> float:
    """Smallest step between readings."""
    steps = np.abs(np.diff(x))
    return float(np.min(steps[steps > 1e-12 * np.ptp(x)], initial=np.ptp(x)))


def window_of(quantum: float, dt: float, believed: dict[str, Any]) -> int:
    """Shortest window whose acceleration noise is below `NOISE`."""
    allowed = NOISE * believed["coulomb"] / believed["mass"]
    for window in range(11, 82, 2):
        g = savgol_coeffs(window, 3, deriv=2, delta=dt)
        if np.linalg.norm(g) * quantum / np.sqrt(12.0) < allowed:
            break
    return window


def shape(v: Array, believed: dict[str, Any]) -> Array:
    """S(|v|) of the believed axis."""
    stribeck = believed["stribeck"]
    if stribeck is None:
        return np.ones_like(v)
    ratio = (np.abs(v) - believed["stick_speed"]) / stribeck["speed"]
    return np.asarray(1.0 + stribeck["excess"] * np.exp(-(ratio**2)))


def signals(t: Array, u: Array, x: Array, believed: dict[str, Any]) -> Signals:
    """Derivatives, force residual, sliding samples and blocks."""
    dt = float(t[1] - t[0])
    quantum = quantum_of(x)
    window = window_of(quantum, dt, believed)
    first = savgol_coeffs(window, 3, deriv=1, delta=dt)
    second = savgol_coeffs(window, 3, deriv=2, delta=dt)
    # The second-derivative filter is the second difference of this kernel.
    kernel = np.cumsum(np.cumsum(second))[:-2] * dt**2
    place = savgol_coeffs(window, 3)

    def keep(signal: Array, taps: Array) -> Array:
        half = taps.size // 2
        return np.convolve(np.pad(signal, half, mode="edge"), taps, mode="valid")

    def smooth(signal: Array) -> Array:
        return keep(signal, kernel)

    def held(signal: Array) -> Array:
        return smooth(0.5 * (signal + np.concatenate((signal[:1], signal[:-1]))))

    xs, v, a = keep(x, place), keep(x, first), keep(x, second)
    noise = float(np.linalg.norm(first)) * quantum / np.sqrt(12.0)
    slow = 5.0 * noise + 2.0 * believed["stick_speed"]
    friction = believed["coulomb"] * shape(v, believed) * np.sign(v)
    r = held(u) - believed["mass"] * a - smooth(believed["viscous"] * v + friction)
    least = minimum_filter1d(v, window)
    most = -minimum_filter1d(-v, window)
    sliding = (least > slow) | (most < -slow)
    sliding[: 2 * window] = sliding[-2 * window :] = False
    even = (t // BLOCK).astype(int) % 2 == 0
    gone = travelled(xs, np.abs(v) < slow, np.sign(v))
    low, high = believed["travel"]
    early = sliding & (gone < SETTLED * (high - low))
    sliding &= ~early
    masks = sliding, early, sliding & even, sliding & ~even
    return Signals(t, u, xs, v, a, r, smooth, held, *masks, quantum, slow)


def travelled(x: Array, still: NDArray[np.bool_], sign: Array) -> Array:
    """Distance since the last standstill or reversal."""
    fresh = still | (np.concatenate(([0.0], np.diff(sign))) != 0.0)
    last = np.maximum.accumulate(np.where(fresh, np.arange(x.size), 0))
    return np.asarray(np.abs(x - x[last]))


def candidates(
    s: Signals, believed: dict[str, Any]
) -> Iterator[tuple[str, int, list[Array], bool]]:
    """Slug, parameter count, columns, and whether their coefficient is one."""
    sign = np.sign(s.v)
    friction = sign * shape(s.v, believed)
    low, high = believed["travel"]
    q = (s.x - 0.5 * (low + high)) / (0.5 * (high - low))
    one = np.ones_like(s.v)
    fast = float(np.max(np.abs(s.v)))
    us = s.smooth(s.u)
    dt = float(s.t[1] - s.t[0])
    yield "bias_force", 1, [one], False
    yield "coulomb", 1, [friction], False
    yield "viscous", 1, [s.v], False
    yield "inertia", 1, [s.a], False
    yield "input_gain", 1, [us], False
    if believed["stribeck"] is not None:
        yield "coulomb_asymmetry", 1, [one * shape(s.v, believed)], False
    yield "quadratic_drag", 1, [s.v * np.abs(s.v)], False
    yield "position_dependence", 2, [friction * q, friction * q * q], False
    yield "spring", 2, [one, s.x], False
    if high - low > 1.0:  # an axis that turns
        yield "gravity", 2, [np.sin(s.x), np.cos(s.x)], False
    yield "load_dependence", 1, [sign * np.abs(us)], False
    yield "drift", 1, [friction * s.t], False
    if believed["stribeck"] is None:
        for speed in fast * np.geomspace(0.008, 0.25, 12):
            yield "stribeck", 2, [sign * np.exp(-((s.v / speed) ** 2))], False
    for delay in np.arange(0.5e-3, 8.01e-3, 0.25e-3):
        whole, part = int(delay / dt), delay / dt - int(delay / dt)
        late = np.convolve(s.u, [0.0] * whole + [1.0 - part, part])[: s.u.size]
        yield "input_delay", 1, [us - s.smooth(late)], True
    for lag in np.arange(0.5e-3, 8.01e-3, 0.25e-3):
        decay = np.exp(-dt / lag)
        end = lfilter([1.0 - decay], [1.0, -decay], s.u)
        start = np.concatenate(([0.0], end[:-1]))
        mean = s.u + (start - s.u) * (1.0 - decay) * lag / dt
        yield "actuator_lag", 1, [us - s.smooth(mean)], True
    for width in believed["coulomb"] * np.geomspace(0.03, 0.7, 24):
        yield "dead_zone", 1, [s.smooth(np.clip(s.u, -width, width))], True
    peak = float(np.max(np.abs(s.u)))
    for limit in peak * np.geomspace(0.05, 0.98, 60):
        yield "saturation", 1, [s.smooth(s.u - np.clip(s.u, -limit, limit))], True
    for wave in _peaks(s, s.x, np.arange(1.5, 120.0, 0.25) / max(np.ptp(s.x), 1e-9)):
        yield "cogging", 3, [np.sin(wave * s.x), np.cos(wave * s.x)], False
    for wave in _peaks(s, s.t, np.arange(0.25, 20.0, 0.25 / s.t[-1])):
        yield "time_periodic", 3, [np.sin(wave * s.t), np.cos(wave * s.t)], False


def _peaks(s: Signals, place: Array, rates: Array) -> list[float]:
    """Angular rates that explain most of r on the fitting blocks, refined."""
    pick = np.flatnonzero(s.fit)[::5]
    if pick.size < 50:
        return []
    z, r = place[pick], s.r[pick]

    def drop(grid: Array) -> Array:
        phase = 2.0 * np.pi * np.outer(grid, z)
        c, d = np.cos(phase), np.sin(phase)
        cc, dd, cd = (c * c).sum(1), (d * d).sum(1), (c * d).sum(1)
        cr, dr = c @ r, d @ r
        return np.asarray((dd * cr**2 - 2 * cd * cr * dr + cc * dr**2) / (cc * dd - cd**2 + 1e-9))

    rate = rates[int(np.argmax(drop(rates)))]
    step = float(rates[1] - rates[0])
    fine = rate + np.linspace(-step, step, 41)
    return [2.0 * np.pi * float(fine[int(np.argmax(drop(fine)))])]


def sliding_scores(
    s: Signals, believed: dict[str, Any], only: str = ""
) -> dict[str, tuple[float, int]]:
    """Held-out drop of log(mean squared residual), best of each effect."""
    best: dict[str, tuple[float, float, int]] = {}
    if s.fit.sum() < 100 or s.judge.sum() < 100:
        return {}
    zero = float(np.mean(s.r[s.judge] ** 2))
    for slug, count, columns, fixed in candidates(s, believed):
        if only and slug != only:
            continue
        block = np.stack(columns, axis=1)
        theta: Array = np.ones(1)
        if not fixed:
            if np.max(np.abs(block[s.fit])) < 1e-3 * np.max(np.abs(block)):
                continue  # the fitting blocks never go there
            theta = np.linalg.lstsq(block[s.fit], s.r[s.fit], rcond=None)[0]
        train = float(np.mean((s.r[s.fit] - block[s.fit] @ theta) ** 2))
        if slug not in best or train < best[slug][0]:
            test = float(np.mean((s.r[s.judge] - block[s.judge] @ theta) ** 2))
            best[slug] = train, float(np.log(zero / test)), count
    return {slug: (gain, count) for slug, (_, gain, count) in best.items()}


def rests(s: Signals, believed: dict[str, Any]) -> list[tuple[int, int]]:
    """First and last sample of every phase of at least 40 ms near standstill."""
    low, high = believed["travel"]
    still = np.abs(s.v) < max(s.slow, 2e-3 * (high - low))
    edges = np.flatnonzero(np.diff(np.concatenate(([0], still.astype(int), [0]))))
    return [(i, j) for i, j in zip(edges[::2], edges[1::2], strict=True) if j - i > 40]


def elastic_slope(s: Signals, believed: dict[str, Any]) -> float:
    """Deflection at rest that the Coulomb level would cause, in quanta."""
    level, us = believed["coulomb"], s.smooth(s.u)
    over, under = 0.0, 0.0
    for i, j in rests(s, believed):
        held = np.abs(us[i:j]) < 0.9 * level
        if held.sum() > 30 and np.ptp(us[i:j][held]) > 0.2 * level:
            du = us[i:j][held] - us[i:j][held].mean()
            over += float(du @ (s.x[i:j][held] - s.x[i:j][held].mean()))
            under += float(du @ du)
    return over / under * level / s.quantum if under > 0.0 else 0.0


def breakaway_excess(s: Signals, x: Array, believed: dict[str, Any]) -> float:
    """Force held before the first motion, above the believed breakaway level.

    The reading needs some time to show that the axis has left; the smallest
    force in that time is a lower bound of the breakaway force.
    """
    stribeck = believed["stribeck"]
    level = believed["coulomb"] * (1.0 if stribeck is None else 1.0 + stribeck["excess"])
    dt = float(s.t[1] - s.t[0])
    show = np.sqrt(5.0 * s.quantum * believed["mass"] / (0.3 * level))
    back = max(4, int(np.ceil(show / dt)))
    found = []
    for i, j in rests(s, believed):
        place = np.median(x[i + 10 : j - 10])
        away = np.flatnonzero(np.abs(x[i + 10 : j + 200] - place) > 2.5 * s.quantum)
        if i > 100 and away.size and away[0] > back + 20:
            k = i + 10 + int(away[0])
            if np.ptp(np.sign(s.u[k - back : k - 1])) == 0.0:
                found.append(float(np.min(np.abs(s.u[k - back : k - 1]))) / level - 1.0)
    return float(np.quantile(found, 0.8)) if found else 0.0


def elastic_drop(s: Signals, believed: dict[str, Any]) -> float:
    """Drop of the log squared residual when friction becomes elastic-plastic."""
    low, high = believed["travel"]
    reach = np.geomspace(2e-5, 2e-3, 16) * (high - low)
    z = np.zeros((s.x.size, reach.size))
    for k, step in enumerate(np.diff(s.x)):
        z[k + 1] = np.clip(z[k] + step, -reach, reach)
    moving = s.sliding | s.early
    if moving.sum() < 100:
        return 0.0
    level = believed["coulomb"] * shape(s.v, believed)
    rigid = s.filter(level * np.sign(s.v))
    zero = np.mean(s.r[moving] ** 2)
    left = [
        np.mean((s.r + rigid - s.filter(level * z[:, i] / reach[i]))[moving] ** 2)
        for i in range(reach.size)
    ]
    return float(np.log(zero / min(left)))


def stribeck_drop(s: Signals, believed: dict[str, Any]) -> float:
    """Held-out drop by a Stribeck term on all sliding, early samples included."""
    if believed["stribeck"] is not None:
        return 0.0
    even = (s.t // BLOCK).astype(int) % 2 == 0
    moving = s.sliding | s.early
    both = s._replace(fit=moving & even, judge=moving & ~even)
    return sliding_scores(both, believed, only="stribeck").get("stribeck", (0.0, 0))[0]


def compliance_drop(s: Signals) -> float:
    """Held-out drop by the second derivatives of u and a, below 20 Hz.

    For a load on a spring, r = -(m2/k) u'' + (m1 m2/k) a'' to first order.
    """
    dt = float(s.t[1] - s.t[0])

    inner = minimum_filter1d(s.sliding.astype(np.uint8), 49).astype(bool)
    fit, judge = inner & s.fit, inner & s.judge
    if fit.sum() < 100 or judge.sum() < 100:
        return 0.0
    r, us, a = gaussian_filter1d(np.stack([s.r, s.smooth(s.u), s.a]), 0.008 / dt)
    block = np.gradient(np.gradient(np.stack([us, a], axis=1), dt, axis=0), dt, axis=0)
    theta = np.linalg.lstsq(block[fit], r[fit], rcond=None)[0]
    left = np.mean((r[judge] - block[judge] @ theta) ** 2)
    return float(np.log(np.mean(r[judge] ** 2) / left))


def features(t: Array, u: Array, x: Array, believed: dict[str, Any]) -> dict[str, Any]:
    """Everything `decide` looks at."""
    s = signals(t, u, x, believed)

    def rms(mask: NDArray[np.bool_]) -> float:
        share = s.r[mask] / believed["coulomb"]
        return float(np.sqrt(np.mean(share**2))) if mask.any() else 0.0

    return {
        "sliding": sliding_scores(s, believed),
        "compliance": compliance_drop(s),
        "elastic": elastic_drop(s, believed),
        "stribeck": stribeck_drop(s, believed),
        "slope": elastic_slope(s, believed),
        "early": rms(s.early),
        "settled": rms(s.sliding),
        "dwell": breakaway_excess(s, x, believed),
    }


def decide(f: dict[str, Any], gates: Gates) -> str | None:
    """The cause, or None."""
    ranked = sorted(
        f["sliding"].items(), key=lambda item: item[1][0] - gates.cost * item[1][1], reverse=True
    )
    best, gain = (ranked[0][0], ranked[0][1][0]) if ranked else ("", 0.0)
    if gain > gates.gain and gain > f["compliance"]:
        return str(best)
    if f["compliance"] > gates.compliance:
        return "compliance"
    if f["slope"] > gates.slope:
        return "presliding"
    if f["early"] > gates.excess + 1.5 * f["settled"]:
        if max(f["elastic"], f["stribeck"]) > gates.early:
            return "presliding" if f["elastic"] > f["stribeck"] else "stribeck"
        return "backlash"
    if gain > gates.gain:
        return str(best)
    return "dwell_time" if f["dwell"] > gates.dwell else None


def tuning_rows(condition: str) -> Iterator[Row]:
    """Hidden effect, None for a clean record, and features of each record that no table counts."""
    from truth import EFFECTS, make_case

    for slug in (None, *EFFECTS):
        for seed in TUNING:
            case = make_case(slug or (), seed, condition)
            yield slug, features(case.t, case.u, case.x, case.believed)


def quality(rows: list[Row], gates: Gates) -> float:
    """Share named right, clean records counting as much as six effects."""
    right = [(slug, decide(f, gates) == slug) for slug, f in rows]
    weight = np.array([6.0 if slug is None else 1.0 for slug, _ in right])
    return float(np.average([ok for _, ok in right], weights=weight))


def tune(rows: list[Row]) -> Gates:
    """Coordinate search of the gates."""
    gates = Gates()
    for _ in range(4):
        for name in Gates._fields:
            trials = [
                gates._replace(**{name: getattr(gates, name) * float(f)})
                for f in np.geomspace(0.2, 5.0, 21)
            ]
            scores = [quality(rows, g) for g in trials]
            best = np.flatnonzero(np.array(scores) >= max(scores) - 1e-9)
            gates = trials[int(best[best.size // 2])]  # middle of the plateau
    return gates


if __name__ == "__main__":
    import_from("tests")
    for condition in GATES:
        print(condition, tune(list(tuning_rows(condition))), flush=True)
