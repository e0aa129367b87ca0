"""References that excite every effect, within travel and speed limits."""

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

Array = NDArray[np.float64]


class _Path:
    """A polyline in time, grown piece by piece."""

    def __init__(self, rng: np.random.Generator, travel: tuple[float, float], speed: float) -> None:
        margin = 0.08 * (travel[1] - travel[0])
        self.rng, self.speed = rng, speed
        self.low, self.high = travel[0] + margin, travel[1] - margin
        self.span = self.high - self.low
        self.t, self.x = [0.0], [float(rng.uniform(self.low, self.high))]
        self.rest(0.2)

    def rest(self, duration: float) -> None:
        self.t.append(self.t[-1] + duration)
        self.x.append(self.x[-1])

    def go(self, target: float, speed: float) -> None:
        target = min(max(target, self.low), self.high)
        duration = max(abs(target - self.x[-1]) / speed, 1e-3)
        self.t.append(self.t[-1] + duration)
        self.x.append(target)

    def away(self, distance: float) -> float:
        """The point at `distance`, on a random side that has room for it."""
        here = self.x[-1]
        sides = [s for s in (-1.0, 1.0) if self.low <= here + s * distance <= self.high]
        side = self.rng.choice(sides) if sides else np.sign(0.5 * (self.low + self.high) - here)
        return float(here + side * distance)

    def steps(self, duration: float = 2.5) -> None:
        """Fast moves of widely different length, each followed by a rest."""
        end = self.t[-1] + duration
        while self.t[-1] < end:
            distance = self.span * 10.0 ** self.rng.uniform(-2.2, -0.15)
            self.go(self.away(distance), self.speed)
            self.rest(self.rng.uniform(0.25, 0.7))

    def ramps(self, duration: float = 2.0) -> None:
        """Constant speeds over a decade, back and forth."""
        end = self.t[-1] + duration
        while self.t[-1] < end:
            speed = self.speed * 10.0 ** self.rng.uniform(-1.0, 0.0)
            distance = min(speed * self.rng.uniform(0.4, 1.0), 0.8 * self.span)
            self.go(self.away(distance), speed)

    def sine(self, duration: float = 2.4) -> None:
        """Two bursts of different frequency about the present position."""
        for frequency in (self.rng.uniform(0.4, 1.2), self.rng.uniform(1.5, 3.5)):
            omega = 2.0 * np.pi * frequency
            room = min(self.x[-1] - self.low, self.high - self.x[-1])
            if room < 0.15 * self.span:
                self.go(0.5 * (self.low + self.high), self.speed)
                room = min(self.x[-1] - self.low, self.high - self.x[-1])
            amplitude = min(room, self.rng.uniform(0.3, 0.9) * self.speed / omega)
            cycles = max(1, round(0.5 * duration * frequency))
            t = np.linspace(0.0, cycles / frequency, 64 * cycles + 1)[1:]
            start_t, start_x = self.t[-1], self.x[-1]
            self.t.extend(start_t + t)
            self.x.extend(start_x + amplitude * np.sin(omega * t))
            self.x[-1] = start_x

    def crawl(self, duration: float = 4.0) -> None:
        """Creeping moves after rests of different length, both ways."""
        end = self.t[-1] + duration
        while self.t[-1] < end:
            self.rest(10.0 ** self.rng.uniform(-1.5, 0.1))
            speed = self.speed * 10.0 ** self.rng.uniform(-2.2, -1.3)
            self.go(self.away(speed * self.rng.uniform(0.2, 0.6)), speed)

    def triangle(self) -> None:
        """Slowly across the travel and back, with rests on the way."""
        speed = self.span / self.rng.uniform(1.6, 2.2)
        upper = self.x[-1] > 0.5 * (self.low + self.high)
        near, far = (self.high, self.low) if upper else (self.low, self.high)
        self.go(near, self.speed)
        for target in (far, near):
            stop = near + (target - near) * self.rng.uniform(0.3, 0.7)
            self.go(stop, speed)
            self.rest(self.rng.uniform(0.2, 0.5))
            self.go(target, speed)
            self.rest(self.rng.uniform(0.1, 0.3))
            near = target

    def pieces(self, which: NDArray[np.intp]) -> None:
        """Some of the five pieces of a reference, a rest after each."""
        for i in which:
            (self.steps, self.ramps, self.sine, self.crawl, self.triangle)[i]()
            self.rest(self.rng.uniform(0.1, 0.4))


def make_reference(
    rng: np.random.Generator, travel: tuple[float, float], speed: float, dt: float, short: bool
) -> Array:
    """Reference of 20 s (`short`: 6 s of steps), sampled at dt.

    Smoothed by a critically damped second-order low-pass of 25 to 45 rad/s.
    """
    path = _Path(rng, travel, speed)
    if short:
        path.steps(6.0)
        return _sampled(path, 6.0, dt)
    path.pieces(rng.permutation(5))
    path.crawl(2.0)
    return _sampled(path, 20.0, dt)


def make_runs(
    rng: np.random.Generator, travel: tuple[float, float], speed: float, dt: float
) -> list[Array]:
    """References of three runs of 7 to 9 s that share the pieces of one of 20 s."""
    order = rng.permutation(5)
    runs = []
    for i in range(3):
        path = _Path(rng, travel, speed)
        total = round(rng.uniform(7.0, 9.0), 3)
        path.pieces(order[i::3])
        runs.append(_sampled(path, total, dt))
    return runs


def _sampled(path: _Path, total: float, dt: float) -> Array:
    """The path as a smooth reference, with steps for the time that is left."""
    if path.t[-1] < total:
        path.steps(total - path.t[-1])
    line = np.interp(np.arange(round(total / dt)) * dt, path.t, path.x)
    keep = np.exp(-path.rng.uniform(25.0, 45.0) * dt)
    return _lowpass(_lowpass(line, keep), keep)


def _lowpass(x: Array, keep: float) -> Array:
    y, _ = lfilter([1.0 - keep], [1.0, -keep], x, zi=[keep * x[0]])
    return np.asarray(y)
