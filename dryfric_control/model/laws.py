"""Friction laws to compare the switched axis with.

Sign, tanh, Karnopp, Dahl and LuGre, each in its published form, on the same mass,
viscous coefficient, Coulomb map, Stribeck peak and effects as the axis. Pass one to
``FrictionAxis.simulate(..., law=...)``. All run in a compiled loop whose substeps
inside each sample follow from a tolerance (`law_events`, `law_stiff`).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from dryfric_control.checks import finite, instance, positive, samples
from dryfric_control.compiled.axis_step import DELAY, LAG
from dryfric_control.compiled.smooth_laws import BRISTLE, TANH, run_smooth
from dryfric_control.compiled.switched_laws import run_switched
from dryfric_control.model.axis import FrictionAxis

__all__ = ["Dahl", "Karnopp", "Law", "LuGre", "Sign", "Tanh"]

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
# Input, sample time, first-order hold or not, x0, v0.
Signal = tuple[Floats, float, bool, float, float]


@dataclass(frozen=True, kw_only=True)
class Law(ABC):
    """Base of friction laws that replace the switched one.

    Parameters
    ----------
    tolerance : float
        Error allowed in one substep, relative to the state; near rest, relative to a
        speed of the law itself: what the Coulomb force gives the mass in one sample or,
        if smaller, the law's own width.

    Notes
    -----
    Each law takes the axis's level ``Fc(x) (1 + sigma exp(-((|v| - Sigma)/vs)^2))``,
    other friction effects included, and differs in what happens near v = 0. A law knows
    nothing of the time at rest except `Karnopp`, whose breakaway may grow with it.
    Effects that delay or filter the drive are refused.

    Examples
    --------
    The same axis under another law, compiled as well:

    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=0.0, coulomb=4.0)
    >>> law = dfc.laws.Tanh(speed=1e-3)
    >>> isinstance(law, dfc.laws.Law)
    True
    >>> resp = axis.simulate([8.0] * 1001, dt=1e-3, law=law)
    >>> round(float(resp.y[1, -1]), 2)
    2.0
    """

    tolerance: float = 1e-8

    def __post_init__(self) -> None:
        for item in fields(self):
            value = positive(f"{type(self).__name__}.{item.name}", getattr(self, item.name))
            object.__setattr__(self, item.name, value)

    @abstractmethod
    def _solve(self, numbers: Floats, integers: Integers, signal: Signal, out: Floats) -> int:
        """Fill the rows x, v, F, mode of `out`; 0, or 1 + the sample that failed."""

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
        u : ndarray, shape (n,)
            Input at t_k = k dt [N].
        dt : float
            Sample time [s].
        x0, v0 : float
            State at the first sample [m], [m/s]; bristles start unloaded.
        hold : "zero" or "first"
            Input between samples: held, or linear to the next one.

        Returns
        -------
        x, v, F, mode : ndarray, shape (n,)
            Position [m], velocity [m/s], friction [N] and direction of motion at t_k. The
            direction is 0 when stuck and, for the smooth laws, when the velocity is at most
            the axis's stick velocity.

        Raises
        ------
        ValueError
            If the axis has an input delay or an actuator lag, if it has no friction at x0
            and the law needs some, or if `hold` is unknown.
        RuntimeError
            If no substep meets the tolerance.
        """
        if hold not in ("zero", "first"):
            raise ValueError(f"hold must be 'zero' or 'first', got {hold!r}")
        instance("axis", axis, FrictionAxis)
        force = samples("u", u)
        dt, x0, v0 = positive("dt", dt, unit="s"), finite("x0", x0), finite("v0", v0)
        for effect in axis.effects:
            if effect.action in ("contact", "transmission", "reading"):
                raise ValueError(
                    f"law={type(self).__name__}(...) has no place for the effect "
                    f"{effect.slug!r}: leave out the one or the other"
                )
        numbers, integers, _ = axis.arrays(dt)
        if numbers[DELAY] > 0.0 or numbers[LAG] > 0.0:
            raise ValueError(
                f"{type(self).__name__} does not carry input_delay and actuator_lag: remove them "
                "from axis.effects, or delay and filter u yourself"
            )
        signal = (force, dt, hold == "first", x0, v0)
        out = np.empty((4, len(signal[0])))
        failed = self._solve(numbers, integers, signal, out)
        if failed:
            raise RuntimeError(
                f"{type(self).__name__}: no substep of sample {failed - 1} meets tolerance = "
                f"{self.tolerance:g}; raise it or shorten dt = {dt:g} s"
            )
        return out[0], out[1], out[2], out[3]


@dataclass(frozen=True, kw_only=True)
class Sign(Law):
    """Coulomb's law with a sign function, solved exactly.

    At v = 0 the force is any value between the two levels there, the Filippov solution
    of m v' = w - Fc sign(v): the mass rests while they hold the load w. This is the
    limit of the tanh law for a vanishing width, without its creep and without the
    chatter of a sampled sign function.

    Parameters
    ----------
    tolerance : float, optional
        Error allowed in one substep, see `Law`.

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

    def _solve(self, numbers: Floats, integers: Integers, signal: Signal, out: Floats) -> int:
        return run_switched(numbers, integers, 0.0, False, *signal, self.tolerance, out)


@dataclass(frozen=True, kw_only=True)
class Tanh(Law):
    """Coulomb's law smoothed: F = Fc tanh(v / speed).

    It never rests: under a load w below the level it creeps at
    v = speed artanh(w / Fc).

    Parameters
    ----------
    tolerance : float, optional
        Error allowed in one substep, see `Law`.
    speed : float
        Width of the transition [m/s]. Keep it well below the Stribeck velocity: a wider
        transition hides the peak.

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

    speed: float

    def _solve(self, numbers: Floats, integers: Integers, signal: Signal, out: Floats) -> int:
        law = (TANH, 1 / self.speed, 0.0)
        return run_smooth(numbers, integers, law, *signal, self.tolerance, out)


@dataclass(frozen=True, kw_only=True)
class Karnopp(Law):
    """Karnopp's law with a zero-velocity band.

    Inside the band the velocity counts as zero and friction balances the load up to the
    breakaway level (1 + sigma) Fc; load beyond that builds up momentum, and the mass
    slides once its velocity is outside the band.

    Parameters
    ----------
    tolerance : float, optional
        Error allowed in one substep, see `Law`.
    band : float
        Half width of the band [m/s].

    References
    ----------
    D. Karnopp, "Computer simulation of stick-slip friction in mechanical dynamic
    systems", J. Dyn. Syst. Meas. Control 107(1), 100-103, 1985.

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

    band: float

    def _solve(self, numbers: Floats, integers: Integers, signal: Signal, out: Floats) -> int:
        return run_switched(numbers, integers, self.band, True, *signal, self.tolerance, out)


@dataclass(frozen=True, kw_only=True)
class Dahl(Law):
    """Dahl's elastic friction, with exponent 1.

    ``F = sigma0 z`` and ``z' = v - sigma0 |v| z / Fc``.  Dahl's own level is constant; a
    Stribeck peak, if the axis has one, enters through Fc.

    Parameters
    ----------
    tolerance : float, optional
        Error allowed in one substep, see `Law`.
    stiffness : float
        sigma0, slope of friction over position at a reversal [N/m].

    References
    ----------
    P. R. Dahl, "A solid friction model", The Aerospace Corporation,
    TOR-0158(3107-18)-1, 1968.

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

    stiffness: float

    def _solve(self, numbers: Floats, integers: Integers, signal: Signal, out: Floats) -> int:
        law = (BRISTLE, self.stiffness, 0.0)
        return run_smooth(numbers, integers, law, *signal, self.tolerance, out)


@dataclass(frozen=True, kw_only=True)
class LuGre(Law):
    """LuGre: bristles with a stiffness and a damping.

    ``F = sigma0 z + sigma1 z'`` and ``z' = v - sigma0 |v| z / g(x, v)``.  g is the axis's
    level with its Stribeck peak; the viscous part sigma2 v is the axis's own.

    Parameters
    ----------
    tolerance : float, optional
        Error allowed in one substep, see `Law`.
    stiffness : float
        Bristle stiffness sigma0 [N/m].
    damping : float
        Bristle damping sigma1 [N s/m]; sqrt(stiffness * mass) is a common choice.

    References
    ----------
    C. Canudas de Wit, H. Olsson, K. J. Astrom and P. Lischinsky, "A new model for control
    of systems with friction", IEEE Trans. Automatic Control 40(3), 419-425, 1995.

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

    stiffness: float
    damping: float

    def _solve(self, numbers: Floats, integers: Integers, signal: Signal, out: Floats) -> int:
        law = (BRISTLE, self.stiffness, self.damping)
        return run_smooth(numbers, integers, law, *signal, self.tolerance, out)
