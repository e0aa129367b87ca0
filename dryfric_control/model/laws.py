"""Friction laws to compare the switched axis with, each in its published form (bibliography).

Laws that switch are integrated by scipy, a piece of linear input at a time, some thousand times
slower than the axis; smooth ones by compiled code.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, fields
from itertools import pairwise

import numpy as np
from scipy.integrate import solve_ivp

from dryfric_control.arrays import Floats
from dryfric_control.checks import finite, instance, one_of, positive, samples
from dryfric_control.compiled import axis_step, smooth_law
from dryfric_control.compiled.cached import njit
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.text import stated, with_parameters

__all__ = ["Dahl", "Karnopp", "Law", "LuGre", "Sign", "Tanh"]

#: Rounding of a straight input, relative to its largest value.
_STRAIGHT = 4 * np.finfo(float).eps
#: A piece shorter than this fraction of a sample is merged with the next one: in a shorter
#: one the force that starts a motion is lost in round-off.
_SHORTEST = 1e-9
#: Successive switches at one instant at most.
_MOST_SWITCHES = 64


@njit(cache=True, error_model="numpy")
def _drive(numbers, integers, t, x, v, u):  # type: ignore[no-untyped-def]
    """Drive force after the static input effects."""
    memory = np.array([x, v])
    return axis_step.input_map(axis_step.point(numbers, integers), t, axis_step.pointer(memory), u)


@njit(cache=True, error_model="numpy")
def _forces(numbers, integers, drive, t, x, v, s, side, rest):  # type: ignore[no-untyped-def]
    """Load in direction s; friction against motion to `side`, sliding and at breakaway."""
    plant = axis_step.point(numbers, integers)
    w = axis_step.load(plant, axis_step.held_force(drive), t, 0.0, x, v, s, rest)
    sliding = axis_step.sliding_level(plant, t, x, v, w, side)
    return w, sliding, axis_step.breakaway_level(plant, t, x, w, side, rest)


class _Motion:
    """An axis under a sampled input; times count samples, the input is linear between kinks."""

    def __init__(self, axis: FrictionAxis, u: Floats, dt: float, first: bool) -> None:
        numbers, self.integers, _ = axis.arrays(dt)
        # The laws as published have their Stribeck peak at rest, not at the stick velocity.
        self.numbers, self.stick_speed = numbers.copy(), axis.stick_speed
        self.numbers[axis_step.STICK_SPEED] = 0.0
        # With one sample more than is shown, each one that is shown begins a piece or lies in one.
        self.dt, self.u = dt, np.append(u, u[-1])
        self.ends = np.append(self.u[1:], u[-1]) if first else self.u
        #: Speed that a force gives in one sample.
        self.push = float(self.numbers[axis_step.INVERSE_MASS]) * dt
        self.viscous = float(self.numbers[axis_step.VISCOUS])
        self.longest = float(self.numbers[axis_step.SHORT_TIME]) / dt
        straight = (
            (np.abs(np.diff(self.ends - self.u)) <= _STRAIGHT * np.abs(u).max())
            & (self.u[1:] == self.ends[:-1])
            & (self.integers[axis_step.N_INPUT] == 0)
        )
        self.kinks = np.unique([0, *np.flatnonzero(~straight) + 1, u.size]).tolist()

    def start_piece(self, begin: int, end: int, x: float, v: float) -> None:
        """Start the piece of input from sample `begin` to sample `end`."""
        first = float(self.u[begin])
        last = float(self.ends[end - 1])
        #: Whether the input laws bend between the inputs, so that each instant is looked up.
        self.bent = first != last and self.integers[axis_step.N_INPUT] > 0
        if first == last:
            first = last = _drive(self.numbers, self.integers, begin * self.dt, x, v, first)
        self.begin, self.first, self.slope = begin, first, (last - first) / (end - begin)

    def forces(
        self, k: float, x: float, v: float, s: float, side: float, rest: float = 0.0
    ) -> tuple[float, float, float]:
        """Load, and friction against motion to `side`: sliding, and at breakaway."""
        drive = self.first + self.slope * (k - self.begin)
        if self.bent:
            drive = _drive(self.numbers, self.integers, k * self.dt, x, v, drive)
        return _forces(self.numbers, self.integers, drive, k * self.dt, x, v, s, side, rest)


@with_parameters
@dataclass(frozen=True, kw_only=True)
class Law(ABC):
    """Base of friction laws that replace the switched one.

    The error allowed in one step is relative to the state; near rest, to a speed of the law
    itself: what the Coulomb force gives the mass in one sample or, if smaller, the law's own width.

    Notes
    -----
    Each law takes the axis's level ``Fc(x) (1 + sigma exp(-(v/vs)^2))``, other friction effects
    included, and differs near v = 0. The stick velocity of the axis does not shift the peak, as it
    does in the switched axis. Time at rest counts for `Karnopp` alone. Effects that
    delay or filter the drive are refused.

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=0.0, coulomb=4.0)
    >>> law = dfc.laws.Tanh(speed=1e-3)
    >>> isinstance(law, dfc.laws.Law)
    True
    >>> resp = axis.simulate([8.0] * 1001, dt=1e-3, law=law)
    >>> round(float(resp.y[1, -1]), 2)
    2.0
    """

    tolerance: float = stated("Error allowed in one step, see `Law`.", 1e-8)

    def __post_init__(self) -> None:
        for item in fields(self):
            value = positive(f"{type(self).__name__}.{item.name}", getattr(self, item.name))
            object.__setattr__(self, item.name, value)

    @abstractmethod
    def _solve(self, motion: _Motion, level: float, x: float, v: float, out: Floats) -> None:
        """Fill the rows x, v, F, mode of `out`; `level` is the friction at the start."""

    def _step_error(self, k: float) -> RuntimeError:
        return RuntimeError(
            f"{type(self).__name__}: no step from sample {int(k)} on meets tolerance = "
            f"{self.tolerance:g}; raise it or shorten dt"
        )

    def run(
        self,
        axis: FrictionAxis,
        u: Floats,
        dt: float,
        x0: float = 0.0,
        v0: float = 0.0,
        hold: str = "zero",
    ) -> tuple[Floats, Floats, Floats, Floats]:
        """Simulate an axis under this law.

        Parameters
        ----------
        axis : FrictionAxis
            Everything but its switching rule and its stuck-mode decay rate is used.
        u, dt, x0, v0, hold
            As for `FrictionAxis.simulate`; bristles start unloaded.

        Returns
        -------
        x, v, F, mode : ndarray, shape (n,)
            Position [m], velocity [m/s], friction [N] and direction of motion: 0 when stuck and,
            for the smooth laws, up to the stick velocity. A RuntimeError says that no step meets
            the tolerance.
        """
        one_of("hold", hold, ("zero", "first"))
        instance("axis", axis, FrictionAxis)
        force = samples("u", u)
        dt = positive("dt", dt, unit="s")
        x0 = finite("x0", x0)
        v0 = finite("v0", v0)
        for effect in axis.effects:
            if effect.action in ("contact", "transmission", "memory", "reading"):
                raise ValueError(
                    f"law={type(self).__name__}(...) has no place for the effect "
                    f"{effect.slug!r}: leave out the one or the other"
                )
        motion = _Motion(axis, force, dt, hold == "first")
        if motion.numbers[axis_step.DELAY] > 0.0 or motion.numbers[axis_step.LAG] > 0.0:
            raise ValueError(
                f"{type(self).__name__} does not carry input_delay and actuator_lag: remove them "
                "from axis.effects, or delay and filter u yourself"
            )
        motion.start_piece(0, 1, x0, 0.0)
        level = 0.5 * sum(motion.forces(0.0, x0, 0.0, s, s)[1] for s in (1.0, -1.0))
        if not level > 0.0:
            raise ValueError(
                f"coulomb must be positive at x0 = {x0:g} for law={type(self).__name__}(...)"
            )
        out = np.empty((4, force.size))
        self._solve(motion, level, x0, v0, out)
        return out[0], out[1], out[2], out[3]


@dataclass(frozen=True, kw_only=True)
class _Switched(Law):
    """A law with a state of rest, in which friction holds the load up to a level."""

    # Largest velocity at rest, and index of the level there in `_Motion.forces`.
    band = 0.0
    _held_by = 1

    def _solve(self, motion: _Motion, level: float, x: float, v: float, out: Floats) -> None:
        unit = np.array([motion.dt, 1.0]) * level * motion.push
        band = self.band
        s = int(np.sign(v)) if abs(v) > band else 0
        rest = 0.0
        switches = 0
        for begin, end in pairwise(motion.kinks):
            motion.start_piece(begin, end, x, v if s else 0.0)
            k = float(begin)
            while k < end:
                before = k
                start = s
                if s:
                    k, x, v, stopped = self._slide(motion, k, end, x, v, s, unit, out)
                    if stopped:
                        v = s * band
                        s = 0
                        rest = 0.0
                else:
                    if k == int(k):
                        out[:, int(k)] = self._sample_outputs(motion, k, x, v, s, rest)
                    stop = min(math.floor(k) + 1.0, end)
                    wait, s, gain = self._wait(motion, k, stop, x, v, rest)
                    rest += wait * motion.dt
                    v = s * band if s else v + gain
                    k = stop if stop - k - wait <= _SHORTEST else k + wait
                switches = switches + (s != start) if k - before <= _SHORTEST else 0
                if switches > _MOST_SWITCHES:
                    raise self._step_error(k)

    def _sample_outputs(
        self, motion: _Motion, k: float, x: float, v: float, s: int, rest: float
    ) -> tuple[float, float, float, float]:
        """Position, velocity, friction and direction at a sample."""
        if s:
            return x, v, s * motion.forces(k, x, v, s, s)[1], s
        friction, *beyond = self._resting_load(motion, k, x, rest)
        return x, 0.0, friction - max(beyond[0], 0.0) + max(beyond[1], 0.0), 0.0

    def _resting_load(
        self, motion: _Motion, k: float, x: float, rest: float
    ) -> tuple[float, float, float]:
        """Load at rest, and what it has beyond friction to either side."""
        plus, minus = (motion.forces(k, x, 0.0, 0.0, side, rest) for side in (1.0, -1.0))
        return plus[0], plus[0] - plus[self._held_by], -minus[0] - minus[self._held_by]

    def _slide(
        self, motion: _Motion, begin: float, end: float, x: float, v: float, s: int, unit: Floats,
        out: Floats,
    ) -> tuple[float, float, float, bool]:  # fmt: skip
        """Time, position and velocity where the slide or the piece ends; whether it rests."""

        def rates(k: float, y: Floats) -> Floats:
            x, v = (y * unit).tolist()
            w, level, _ = motion.forces(k, x, v, s, s)
            dv = (w - motion.viscous * v - s * level) * motion.push
            return np.array([v * motion.dt, dv]) / unit

        def band_event(k: float, y: Floats) -> float:
            # A motion that starts at the edge of the band leaves it.
            return float(s * y[1] - self.band / unit[1]) if k > begin else 1.0

        def extremum_event(k: float, y: Floats) -> float:
            return float(s * rates(k, y)[1])

        band_event.terminal, band_event.direction = True, -1.0  # type: ignore[attr-defined]
        extremum_event.direction = 1.0  # type: ignore[attr-defined]
        run = solve_ivp(
            rates, (begin, end), np.array([x, v]) / unit, method="DOP853",
            t_eval=np.append(np.arange(math.ceil(begin), end), end),
            events=(band_event, extremum_event),
            rtol=self.tolerance, atol=self.tolerance, first_step=min(1.0, end - begin),
            max_step=motion.longest,
        )  # fmt: skip
        if run.status < 0:
            raise self._step_error(begin)
        for at, y in zip(run.t_events[1], run.y_events[1], strict=True):
            if at < end and band_event(at, y) < 0.0:
                # The velocity has a minimum in the band between two steps: stop there.
                return self._slide(motion, begin, at, x, v, s, unit, out)
        for at, y in zip(run.t, np.transpose(run.y), strict=True):
            if at < end:
                x, v = (y * unit).tolist()
                out[:, int(at)] = self._sample_outputs(motion, at, x, v, s, 0.0)
        k, y = (run.t_events[0][0], run.y_events[0][0]) if run.status else (end, run.y[:, -1])
        x, v = (y * unit).tolist()
        return k, x, v, run.status == 1

    def _wait(
        self, motion: _Motion, k: float, stop: float, x: float, v: float, rest: float
    ) -> tuple[float, int, float]:
        """Time until the band is left, the side, and the velocity gained meanwhile."""
        # Forces are linear up to `stop`, exact unless an effect depends on time.  The mass leaves
        # once the net force at the band's edge points outwards: else drag there switches endlessly.
        left = stop - k
        band = self.band
        now = self._resting_load(motion, k, x, rest)[1:]
        then = self._resting_load(motion, stop, x, rest + left * motion.dt)[1:]
        side = -1
        start = left
        for i in range(2):
            # Ignore the round-off left of a load that has just fallen below friction.
            if now[i] > 0.0 and now[i] > -1e-12 * then[i]:
                side = i
                start = 0.0
            elif then[i] > 0.0 and (crossing := left * now[i] / (now[i] - then[i])) < start:
                side = i
                start = crossing
        if side < 0:
            return left, 0, 0.0
        s = 1 - 2 * side
        over = max(now[side], 0.0)
        slope = (then[side] - now[side]) / left
        last = min(left, start - over / slope) if then[side] < 0.0 else left
        need = (band - s * v) / motion.push
        inside = over * over + 2 * slope * need
        root = over + math.sqrt(max(inside, 0.0))
        out = start + (2 * need / root if root > 0.0 else 0.0)
        if out > last or inside < 0.0:
            gain = (over + 0.5 * slope * (last - start)) * (last - start) * motion.push
            return last, 0, s * gain
        outward, later = (self._outward_force(motion, at, x, s) for at in (k, stop))
        if outward + (later - outward) * out / left < 0.0:
            out = left * outward / (outward - later) if later > 0.0 else last
            if out >= last:
                return last, 0, s * (band - s * v)
        return out, s, 0.0

    def _outward_force(self, motion: _Motion, k: float, x: float, s: int) -> float:
        """Net force at the edge of the band, outwards."""
        w, level, _ = motion.forces(k, x, s * self.band, s, s)
        return s * w - motion.viscous * self.band - level


@dataclass(frozen=True, kw_only=True)
class _Smooth(Law):
    """A law of the velocity and the deflection of bristles alone."""

    @abstractmethod
    def _parameters(self) -> tuple[float, float, float]:
        """Width of tanh (0: bristles), stiffness and damping of the bristles."""

    def _solve(self, motion: _Motion, level: float, x: float, v: float, out: Floats) -> None:
        parameters = np.array(self._parameters())
        width = parameters[smooth_law.WIDTH]
        if width == 0.0:
            width = level / (parameters[smooth_law.STIFFNESS] * motion.dt)
        speed = min(level * motion.push, width)
        unit = np.array([speed * motion.dt, speed, width * motion.dt])
        failed = smooth_law.run(
            motion.numbers, motion.integers, parameters, motion.u[:-1], motion.ends[:-1],
            motion.dt, np.array([x, v, 0.0]), unit, self.tolerance,
            motion.longest * motion.dt, motion.stick_speed, out,
        )  # fmt: skip
        if failed >= 0:
            raise self._step_error(failed)


@with_parameters
@dataclass(frozen=True, kw_only=True)
class Sign(_Switched):
    """Coulomb's law with a sign function, solved exactly.

    At v = 0 the force is any value between the two levels there, the Filippov solution of
    m v' = w - Fc sign(v): the mass rests while they hold the load w.

    Examples
    --------
    A Coulomb mass stops after m v0^2 / (2 Fc):

    >>> import numpy as np
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=0.0, coulomb=4.0)
    >>> x, v, F, mode = dfc.laws.Sign().run(axis, np.zeros(600), dt=1e-3, v0=1.0)
    >>> round(float(x[-1]), 9), float(v[-1])
    (0.25, 0.0)
    """


@with_parameters
@dataclass(frozen=True, kw_only=True)
class Tanh(_Smooth):
    """Coulomb's law smoothed: F = Fc tanh(v / speed).

    It never rests: under a load w below the level it creeps at
    v = speed artanh(w / Fc).

    Examples
    --------
    Half the level as load makes it creep at 0.549 speed:

    >>> import numpy as np
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=0.0, coulomb=4.0)
    >>> x, v, F, mode = dfc.laws.Tanh(speed=1e-3).run(axis, np.full(100, 2.0), dt=1e-3)
    >>> round(float(v[-1]) / 1e-3, 6)
    0.549306
    """

    speed: float = stated("Width of the transition, well below the Stribeck velocity [m/s].")

    def _parameters(self) -> tuple[float, float, float]:
        return self.speed, 0.0, 0.0


@with_parameters
@dataclass(frozen=True, kw_only=True)
class Karnopp(_Switched):
    """Karnopp's law with a zero-velocity band (1985).

    Inside the band the velocity counts as zero and friction balances the load up to the breakaway
    level (1 + sigma) Fc; load beyond that builds up momentum, and the mass slides once its velocity
    is outside the band.

    Examples
    --------
    Below breakaway it rests where it is, whatever the band:

    >>> import numpy as np
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=0.0, coulomb=4.0)
    >>> x, v, F, mode = dfc.laws.Karnopp(band=1e-3).run(axis, np.full(100, 3.9), dt=1e-3)
    >>> float(x[-1]), float(v[-1]), float(F[-1])
    (0.0, 0.0, 3.9)
    """

    band: float = stated("Half width of the band [m/s].")
    _held_by = 2


@with_parameters
@dataclass(frozen=True, kw_only=True)
class Dahl(_Smooth):
    """Dahl's elastic friction (1968), with exponent 1.

    ``F = sigma0 z`` and ``z' = v - sigma0 |v| z / Fc``; a Stribeck peak enters through Fc.

    Examples
    --------
    Friction over position from rest is Fc (1 - exp(-sigma0 x / Fc)):

    >>> import numpy as np
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=0.0, coulomb=4.0)
    >>> x, v, F, mode = dfc.laws.Dahl(stiffness=100.0).run(axis, np.zeros(100), dt=1e-3, v0=1.0)
    >>> bool(abs(F[50] - 4.0 * (1 - np.exp(-25.0 * x[50]))) < 1e-6)
    True
    """

    stiffness: float = stated("sigma0, slope of friction over position at a reversal [N/m].")

    def _parameters(self) -> tuple[float, float, float]:
        return 0.0, self.stiffness, 0.0


@with_parameters
@dataclass(frozen=True, kw_only=True)
class LuGre(Dahl):
    """LuGre (1995): bristles with a stiffness and a damping.

    ``F = sigma0 z + sigma1 z'`` and ``z' = v - sigma0 |v| z / g(x, v)``.  g is the axis's level
    with its Stribeck peak; the viscous part sigma2 v is the axis's own.

    Examples
    --------
    Under a load far below the level it is a spring of stiffness sigma0:

    >>> import numpy as np
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=0.0, coulomb=4.0)
    >>> law = dfc.laws.LuGre(stiffness=1e4, damping=150.0)
    >>> x, v, F, mode = law.run(axis, np.full(1000, 0.01), dt=1e-3)
    >>> round(0.01 / float(x[-1]), -2)
    10000.0
    """

    damping: float = stated("Bristle damping sigma1, often sqrt(stiffness * mass) [N s/m].")

    def _parameters(self) -> tuple[float, float, float]:
        return 0.0, self.stiffness, self.damping
