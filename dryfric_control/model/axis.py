"""The axis with dry friction as immutable data, its modes, its simulation."""

from __future__ import annotations

import functools
import math
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple, Protocol, runtime_checkable

import control as ct
import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike, NDArray

from dryfric_control.arrays import Floats, Ints
from dryfric_control.checks import (
    check_boolean,
    finite,
    instance,
    one_of,
    places,
    positive,
    samples,
    string,
)
from dryfric_control.compiled import axis_step, elastic
from dryfric_control.compiled.states import BLOCKS, states_task
from dryfric_control.compiled.windowed_runs import NO_FORCE
from dryfric_control.drawing import axes_of, control_plot, legend_above, title_above
from dryfric_control.model.axis_arguments import with_inertia, with_mass
from dryfric_control.model.block import Block
from dryfric_control.model.effects import Effect
from dryfric_control.model.effects.drive import input_corners
from dryfric_control.model.effects.effect import (
    ELASTIC,
    REMEMBERING,
    WITH_STATE,
    Inner,
    Slopes,
    law_address,
)
from dryfric_control.model.effects.naming import named
from dryfric_control.model.friction import CoulombMap, Stribeck, middle_level
from dryfric_control.model.friction_curve import draw_friction, usual_speed
from dryfric_control.model.responses import (
    Events,
    SimulationResponse,
    check_finite,
    check_mode,
    locate_switches,
)
from dryfric_control.text import page_reference, rotary_words, table
from dryfric_control.units import axis_units, on_axis

SWITCHING = {"filippov": axis_step.FILIPPOV, "paper": axis_step.PAPER}
#: Names of the modes that can be part of a signal or system name.
MODE_LABELS = {0: "stuck", 1: "plus", -1: "minus"}
MODES = tuple(MODE_LABELS)
#: Fields that must be positive, with their units.
_POSITIVE = {"mass": "kg", "viscous": "N s/m", "stick_speed": "m/s", "stick_rate": "1/s"}

#: Most time constants of viscous friction in one sample: the steps inside it resolve that change,
#: and beyond this a sample takes milliseconds.
MOST_VISCOUS = 1e5
#: The same of the Stribeck peak.
MOST_STRIBECK = 1e8
#: Most samples of delay, and most turns of an effect in one sample.
MOST_SAMPLES = 1e6
#: Most samples of delay that become states of a linear system.
MOST_STATES = 1000

#: Most that an elastic part may swing in one sample [rad]: samples show up to pi, and each
#: radian costs steps.
MOST_SWING = 100.0


class Arrays(NamedTuple):
    """An axis as the arrays that the compiled kernel reads."""

    numbers: Floats
    integers: Ints
    memory: int  # length of the memory that a run needs

    @property
    def states(self) -> int:
        """Length of its part that contains the state; what follows is room to work in."""
        history = int(self.integers[axis_step.N_HISTORY])
        return axis_step.HISTORY + 2 * history + int(self.integers[axis_step.N_STATES])

    def start_memory(self, x0: float, v0: float) -> Floats:
        """Memory of an axis that starts at a position with a velocity."""
        memory = np.zeros(self.memory)
        memory[:2] = x0, v0
        return memory

    def step(self, memory: Floats, t: float, dt: float, u: float) -> None:
        """Move the axis, whose memory is changed, over one sample of a held input."""
        axis_step.step(*self[:2], memory, t, dt, u)

    def outputs_at(self, memory: Floats, t: float, dt: float, u: float) -> tuple[float, float, int]:
        """Velocity, friction and mode at an instant at which the input is u."""
        return axis_step.outputs_now(*self[:2], memory, t, dt, u)

    def encoder_reading(self, memory: Floats, t: float) -> float:
        """Position, as an encoder reads it."""
        return float(axis_step.reading_now(*self[:2], memory, t))

    def rate(self, t: float, x: float, v: float, u: float, mode: int) -> tuple[float, float]:
        """Acceleration and friction in a mode, without switching."""
        return axis_step.mode_rate(*self[:2], t, x, v, u, mode)


@runtime_checkable
class Law(Protocol):
    """What `simulate` takes in place of the switched model: a law of `dfc.laws`."""

    tolerance: float

    def run(
        self, axis: FrictionAxis, u: Any, dt: float, x0: float, v0: float, hold: str
    ) -> tuple[Any, Any, Any, Any]:
        """Position, velocity, friction and direction of motion, each of shape (n,)."""


@with_inertia
@dataclass(frozen=True)
class FrictionAxis:
    """One axis with dry friction: a hybrid model of three modes.

    Parameters
    ----------
    mass : float
        Mass [kg].  A rotary axis takes ``inertia=`` [kg m^2] instead; its units are then
        ("rad", "N m") by default.
    viscous : float
        Viscous coefficient f [N s/m].
    coulomb : float, tuple of float, or CoulombMap
        Coulomb level [N]: one value, (plus, minus), or a map over position.
    stribeck : Stribeck, optional
        Stribeck peak.  Default: none.
    stick_speed : float, optional
        Stick velocity Sigma, below which the axis counts as motionless [m/s].
    stick_rate : float, optional
        Stuck-mode decay rate p of the remaining velocity of a stuck axis [1/s].
    travel : tuple of float, optional
        Lowest and highest position [m].  Coulomb maps hold inside it and keep
        their end values outside; motion itself is not limited.
    switching : {"filippov", "paper"}, optional
        Rule by which a sliding axis comes to rest, see Notes.
    effects : tuple of Effect, optional
        Effects beyond the base model; force effects add, in any combination.
    name : str, optional
        Name of the axis, for blocks and plots.
    units : tuple of str, optional
        Units of position and force: ("m", "N") or ("rad", "N m"); raw ones, such as
        ("counts", "V"), and names that are not known are taken as they are.

    Notes
    -----
    The modes are (paper, eqs. (2), (3); w is the net force without friction) ::

        sliding s   m v' = w - f v - s F_s(x, v)
                    F_s = Fc_s(x) (1 + sigma exp(-((s v - Sigma)/vs)^2))
        stuck       v' = -p v,  friction = w

    A stuck axis breaks away when w leaves [-Fb_minus, Fb_plus], with Fb = (1 + sigma) Fc, and
    loses a remaining velocity against that direction.  A sliding axis sticks when abs(v) <= Sigma
    and w lies in [-Fc_minus, Fc_plus].  That is the printed rule, ``switching="paper"``, which may
    chatter with a Stribeck peak; "filippov" completes it, see the theory page.

    The model is not valid below Sigma: it has no presliding displacement, unless the effect
    `Presliding` adds it.  With `Backlash` or `Compliance` there are two masses; x and v are the
    motor's, F and mode the load's.

    Examples
    --------
    A mass sliding on dry friction stops after v0^2 m / (2 Fc) = 0.25 m:

    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=1.0, viscous=0.0, coulomb=2.0, stick_speed=1e-9)
    >>> resp = axis.simulate([0.0] * 1001, dt=1e-3, v0=1.0)
    >>> round(float(resp.y[0, -1]), 9)
    0.25

    A rotary axis:

    >>> dfc.FrictionAxis(inertia=0.02, viscous=0.1, coulomb=0.5).units
    ('rad', 'N m')
    """

    mass: float
    viscous: float
    coulomb: CoulombMap
    stribeck: Stribeck | None = None
    stick_speed: float = 1e-4
    stick_rate: float = 500.0
    travel: tuple[float, float] | None = None
    switching: str = "filippov"
    effects: tuple[Effect, ...] = ()
    name: str = "axis"
    units: tuple[str, str] = field(default=("m", "N"), compare=False)

    def __post_init__(self) -> None:
        put = functools.partial(object.__setattr__, self)
        string("name", self.name)
        put("units", axis_units(self.units))
        for name, unit in _POSITIVE.items():
            value = getattr(self, name)
            shown = self.unit(unit)
            put(name, positive(name, value, unit=shown, zero=name == "viscous"))
        put("coulomb", CoulombMap.of(self.coulomb))
        if self.stribeck is not None and not isinstance(self.stribeck, Stribeck):
            raise ValueError(
                "stribeck must be dfc.Stribeck(excess=..., speed=...) or None, "
                f"got {self.stribeck!r}"
            )
        if self.travel is not None:
            put("travel", span_of(self.travel))
        self.coulomb.check(self.travel)
        if not isinstance(self.switching, str) or self.switching not in SWITCHING:
            raise ValueError(f'switching must be "filippov" or "paper", got {self.switching!r}')
        given = self.effects
        alone = isinstance(given, (Effect, str)) or not isinstance(given, Iterable)
        put("effects", (given,) if alone else tuple(given))
        _check_effects(self.effects)

    def replace(self, **changes: Any) -> FrictionAxis:
        """Axis with some of its fields changed.

        Parameters
        ----------
        **changes
        """
        return replace(self, **with_mass(changes, self.units))

    @property
    def inertia(self) -> float:
        """The mass, as a rotary axis calls it [kg m^2]."""
        return self.mass

    def effective(self) -> FrictionAxis:
        """Axis with its effective base parameters.

        Effects on a base parameter (inertia, viscous, coulomb, stribeck) are applied, in their
        order, and leave the list.  Simulations do this themselves; call it before reading `mass`,
        `viscous`, `coulomb` or `stribeck`.
        """
        changing = [effect for effect in self.effects if effect.action == "axis"]
        axis = without_effects(self, ["axis"]) if changing else self
        for effect in changing:
            axis = effect.alter(axis)
        return axis

    def named_effects(self) -> dict[str, Effect]:
        """Effects, and the own peak, by the names that a fit uses.

        A second one of a kind has a number, as in "cogging_2".
        """
        return named(self)

    def unit(self, unit: str) -> str:
        """A unit for metres and newtons, in the units of this axis.

        Parameters
        ----------
        unit : str
            Such as "N s/m", "kg" or "1".
        """
        return on_axis(unit, self.units)

    def arrays(self, dt: float, moved: bool = True) -> Arrays:
        """Arrays that describe this axis to the compiled kernel.

        Parameters
        ----------
        dt : float
            Sampling time [s]; it sets the length of the delay line.
        moved : bool, optional
            Whether it is moved by them. If not, only forces and rates can be asked for, and what
            moves an axis, which takes longest to compile, is left out.
        """
        check_boolean("moved", moved)
        return _arrays(self, positive("dt", dt, unit="s"), moved)

    def breakaway(self, x: ArrayLike, direction: int) -> Floats:
        """Breakaway friction force (1 + sigma) Fc of the base model.

        Parameters
        ----------
        x : array_like, shape (n,)
            Positions [m].
        direction : int
            +1 or -1.

        Returns
        -------
        ndarray, shape (n,)
            Magnitude [N].
        """
        axis = self.effective()
        place = places("x", x)
        if axis.travel is not None:
            place = np.clip(place, *axis.travel)
        excess = axis.stribeck.excess if axis.stribeck else 0.0
        return (1.0 + excess) * axis.coulomb(place, direction)

    def simulate(
        self,
        u: ArrayLike,
        dt: float,
        x0: float = 0.0,
        v0: float = 0.0,
        hold: str = "zero",
        law: Law | None = None,
        *,
        load: ArrayLike | None = None,
    ) -> SimulationResponse:
        """Run the axis on a sampled input, switches located inside.

        Parameters
        ----------
        u : array_like, shape (n,)
            Drive force at the samples 0, dt, 2 dt, ... [N].
        dt : float
            Sampling time [s].
        x0, v0 : float, optional
            Position [m] and velocity [m/s] at the start.  The mode at the start
            follows from them and u[0].
        hold : {"zero", "first"}, optional
            Whether the input is held or runs linearly between samples.
        law : Law, optional
            Another friction law to compare with, e.g. ``dfc.laws.LuGre(...)``, in
            place of the switched one.
        load : array_like, shape (n,), optional
            Known force on the mass beside the drive [N], positive as `u` is; of two masses, on
            that with friction.

        Returns
        -------
        SimulationResponse
            Outputs x, v, F, mode, each of shape (n,), and `events`.  F and mode at a sample are
            those that the new input u[k] brings about.
        """
        force = samples("u", u)
        known = known_force(load, force.size)
        dt = positive("dt", dt, unit="s")
        x0, v0 = finite("x0", x0), finite("v0", v0)
        one_of("hold", hold, ("zero", "first"))
        outputs = np.empty((4, force.size))
        if law is not None:
            # A class has the attributes of its instances.
            given = law.__name__ if isinstance(law, type) else law
            if known.size:
                raise ValueError("load cannot be used with law=...: add it to u")
            instance("law", given, Law, "such as dfc.laws.LuGre(stiffness=1e5, damping=100.0)")
            outputs[:] = law.run(self, force, dt, x0, v0, hold)
            places = np.flatnonzero(np.diff(outputs[3])) + 1
            before, after = outputs[3, [places - 1, places]].astype(np.int64)
            events = Events(dt * places.astype(float), before, after)
        else:
            check_pace(self, dt)
            a, first = self.arrays(dt), hold == "first"
            events = locate_switches(
                lambda room: axis_step.run(
                    a.numbers,
                    a.integers,
                    a.start_memory(x0, v0),
                    force,
                    known,
                    dt,
                    first,
                    room,
                    outputs,
                )
            )
        check_finite(outputs)
        time = np.arange(force.size, dtype=float)
        time *= dt  # in place: a long record has no room for a second copy
        title = f"{self.name}: {type(law).__name__ if law else 'switched model'}"
        labels = {"title": title, "sysname": self.name}
        return SimulationResponse(time, outputs, force[None, :], events, self.units, **labels)

    def stepper(self, dt: float, x0: float = 0.0, v0: float = 0.0) -> AxisStepper:
        """Axis to be stepped sample by sample from your own loop.

        Parameters
        ----------
        dt, x0, v0
            As for `simulate`.
        """
        return AxisStepper(self, dt, x0, v0)

    def mode(self, index: int) -> ct.NonlinearIOSystem:
        """One mode as a continuous-time block.

        Parameters
        ----------
        index : int
            0 stuck, +1 or -1 sliding.

        Returns
        -------
        control.NonlinearIOSystem
            Input u; outputs x (as an encoder reads it), v, F; states x, v, and the lagged
            drive where there is a lag.  The block stays in its mode whatever happens.
            Presliding, backlash, compliance and a delay are refused.
        """
        check_mode("mode", index)
        axis = self.effective()
        inner = rigid_inner(axis)
        if inner.delay > 0.0:
            raise _no_states(inner.delay, f"take mode_ss({index}, dt, at=...)")
        # The lag is behind the other effects on the drive, and the mode behind the lag.
        before = [e for e in axis.effects if e.action == "input" and inner.lag > 0.0]
        arrays = axis.replace(effects=tuple(e for e in axis.effects if e not in before)).arrays(1.0)

        def rate(t: float, x: Any, u: Any) -> tuple[float, float]:
            return arrays.rate(t, x[0], x[1], x[2] if inner.lag > 0.0 else u[0], index)

        def update(t: float, x: Any, u: Any) -> Floats:
            drive = u[0]
            for effect in before:
                drive = effect.law(t, x[0], x[1], drive, 0.0, 0.0, 0.0, effect.values)
            lagged = [(drive - x[2]) / inner.lag] if inner.lag > 0.0 else []
            return np.array([x[1], rate(t, x, u)[0], *lagged])

        def output(t: float, x: Any, u: Any) -> Floats:
            return np.array([_read(arrays, t, x[0]), x[1], rate(t, x, u)[1]])

        states = ["x", "v", "lagged"] if inner.lag > 0.0 else ["x", "v"]
        name = f"{self.name}_{MODE_LABELS[index]}"
        return Block.from_functions(update, output, "u", "x v F", states, 0, name)

    def mode_ss(
        self,
        index: int,
        dt: float = 0.0,
        method: str = "euler",
        input: str = "drive",
        at: tuple[float, ...] | None = None,
    ) -> ct.StateSpace:
        """Linear part of one mode as a state-space system.

        Parameters
        ----------
        index : int
            0 stuck, +1 or -1 sliding.
        dt : float, optional
            Sampling time [s]; 0 for continuous time.
        method : {"euler", "zoh"}, optional
            The paper's Euler approximation (4), an error of first order in dt, or the exact
            discretisation with a held input.  The system prints which, its attribute
            `method` has it.
        input : {"drive", "force"}, optional
            "drive": the matrix B_i of the known input, zero in mode 0, where
            friction cancels the drive.  "force": the matrix E_i of an unknown
            force on the mass, (0, dt/m) in every mode; the integral action of
            an observer enters here.
        at : (float, float) or (float, float, float), optional
            Position [m], velocity [m/s] and drive [N] at which effects and Stribeck peak are
            linearised.  Without the drive: the one that keeps the velocity.  Default: they are
            left out, but for delay and lag of the drive.

        Returns
        -------
        control.StateSpace
            States x, v; output x, as an encoder reads it; input u (or the force d).  With the
            input u, a lag adds the state lagged, and a delay the inputs of the samples before:
            u_1, u_2 and so on.  Unstable Euler steps, a delay without `dt`, presliding, backlash
            and compliance are refused.

        Notes
        -----
        ``A = [[1, dt], [0, 1 - dt a]]`` with a = f/m when sliding and a = p when stuck (Euler);
        the Coulomb level is the constant Q_i of (4), and not included.  With `at` the states
        are deviations from that point, ::

            x' = v,  v' = a_x x + a_v v + b u

        with the slopes of the acceleration that `mode` gives: gravity, spring and cogging enter
        a_x, drag and the Stribeck peak a_v, input gain b.  At rest friction cancels all of these.

        Examples
        --------
        >>> import dryfric_control as dfc
        >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
        >>> print(axis.mode_ss(0, dt=1e-3).A)
        [[1.    0.001]
         [0.    0.5  ]]
        """
        check_mode("mode", index)
        dt = positive("dt", dt, unit="s", zero=True)
        one_of("method", method, ("euler", "zoh"))
        one_of("input", input, ("drive", "force"))
        axis = self.effective()
        inner = rigid_inner(axis)
        slopes = None if at is None else self._slopes(index, at)
        pull, rate, gain, read = _mode_coefficients(axis, index, input, slopes)
        states = ["x", "v"]
        rates = {"stick_rate" if index == 0 else "viscous / mass": rate}
        a = np.array([[0.0, 1.0], [pull, -rate]])
        b = np.array([[0.0], [gain]])
        if input == "drive" and inner.lag > 0.0:
            a = np.block([[a, b], [np.zeros((1, 2)), np.full((1, 1), -1.0 / inner.lag)]])
            b = np.array([[0.0], [0.0], [1.0 / inner.lag]])
            states = [*states, "lagged"]
            rates = rates | {"1 / lag": 1.0 / inner.lag}
        if method == "euler":
            _check_euler(rates, dt)
        if input == "drive" and inner.delay > 0.0:
            a, b = _delay_matrices(a, b, inner.delay, dt, method)
            states += [f"u_{k}" for k in range(1, len(a) - len(states) + 1)]
        elif dt > 0.0:
            a, b = _hold_matrices(a, b, dt, method)
        names = {"inputs": ["u" if input == "drive" else "d"], "outputs": ["x"], "states": states}
        name = f"{self.name}_{MODE_LABELS[index]}"
        system = ModeStateSpace(a, b, np.eye(1, len(a)) * read, [[0.0]], dt, name=name, **names)
        system.method = method if dt > 0.0 else ""
        return system

    def _slopes(self, index: int, at: Any) -> tuple[float, float, float, float]:
        """Slopes of a mode's acceleration by position, velocity and drive; of the reading."""
        try:
            x, v, *drive = at
        except (TypeError, ValueError):
            drive = [0.0, 0.0]
        if len(drive) > 1:
            raise ValueError(f"at must be (position, velocity) or with a drive, got {at!r}")
        x, v = finite("at[0]", x), finite("at[1]", v)
        if index * v < 0.0:
            raise ValueError(
                f"at[1] = {v:g} moves against mode {index:+d}: give it the sign of the mode"
            )
        arrays = self.arrays(1.0)
        far = float(max(self.breakaway(np.array([x]), s)[0] for s in (1, -1))) or self.mass

        def rate(x: float, v: float, u: float) -> float:
            return arrays.rate(0.0, x, v, u, index)[0]

        def by_drive(u: float) -> float:
            return _slope(lambda change: rate(x, v, u + change), 0.1 * far)

        if drive:
            u = finite("at[2]", drive[0])
        else:
            u = 2.0 * index * far
            for _ in range(8 * abs(index)):  # Newton; one step where the drive acts linearly
                gain = by_drive(u)
                u -= rate(x, v, u) / gain if gain > 0.0 else 0.0
        low, high = self.travel or (0.0, 0.0)
        reach = 1e-2 * (max(high - low, abs(x)) or 1.0)
        return (
            _slope(lambda change: rate(x + change, v, u), reach),
            _slope(lambda change: rate(x, v + change, u), 0.1 * max(abs(v), self.stick_speed)),
            by_drive(u),
            _slope(lambda change: _read(arrays, 0.0, x + change), reach),
        )

    def plot_friction(
        self,
        speed: float | None = None,
        span: tuple[float, float] | None = None,
        ax: Any = None,
        title: str | None = None,
    ) -> ct.ControlPlot:
        """Draw friction over velocity, with all that effects add to it.

        Parameters
        ----------
        speed : float, optional
            Largest velocity shown [m/s].  Default: eight Stribeck velocities; without a
            peak, the velocity at which the viscous part is half the Coulomb level.
        span : tuple of float, optional
            Positions of the band, where friction depends on them [m].  Default: the travel.
        ax : Axes, optional
            Where to draw.  Default: a new figure.
        title : str, optional

        Notes
        -----
        Friction and viscous part of the model, and effects that depend on the velocity, such as a
        quadratic drag; no spring, gravity or load, and what depends on time at time zero.
        """
        fastest = usual_speed(self) if speed is None else positive("speed", speed, unit="m/s")
        places = (self.travel or (0.0, 0.0)) if span is None else span_of(span, "span")
        axes = axes_of(ax, 1, title, figsize=(7.0, 4.2))
        draw_friction(self, axes[0], fastest, places)
        legend_above(axes[0])
        title_above(axes[0], f"{self.name}: friction over velocity" if title is None else title)
        return control_plot(axes)

    def _rows(self) -> list[tuple[str, str]]:
        """Names and values with units."""
        length = self.unit("m")
        force = self.unit("N")
        speed = self.unit("m/s")
        rows = [
            (rotary_words("mass", force), f"{self.mass:.6g} {self.unit('kg')}"),
            ("viscous", f"{self.viscous:.6g} {self.unit('N s/m')}"),
            ("Coulomb +", f"{_polynomial(self.coulomb.plus)} {force}"),
            ("Coulomb -", f"{_polynomial(self.coulomb.minus)} {force}"),
        ]
        if self.stribeck:
            peak = f"{self.stribeck.excess:.6g}, velocity {self.stribeck.speed:.6g} {speed}"
            rows.append(("Stribeck excess", peak))
        rows += [
            ("stick velocity", f"{self.stick_speed:.6g} {speed}"),
            ("stuck-mode decay rate", f"{self.stick_rate:.6g} 1/s"),
        ]
        if self.travel is not None:
            rows.append(("travel", f"{self.travel[0]:.6g} to {self.travel[1]:.6g} {length}"))
        rows.append(("switching", self.switching))
        return rows + [("effect", effect.describe(self.units)) for effect in self.effects]

    def describe(self) -> str:
        """Parameters with units, one a line."""
        return "\n".join([self.name, *(f"  {name} {value}" for name, value in self._rows())])

    def __str__(self) -> str:
        return self.describe()

    def _repr_html_(self) -> str:
        return table([(self.name, ""), *self._rows()], as_html=True)


def _slope(function: Callable[[float], float], reach: float) -> float:
    """Derivative at zero: central differences, extrapolated, where two steps agree best."""
    ratio = 3.7  # no whole number: steps must not all be multiples of one period
    steps = reach * ratio ** -np.arange(14.0)
    plain = np.array([(function(h) - function(-h)) / (2.0 * h) for h in steps])
    better = plain[1:] + (plain[1:] - plain[:-1]) / (ratio**2 - 1.0)
    return float(better[1:][np.argmin(np.abs(np.diff(better)))])


def _read(arrays: Arrays, t: float, x: float) -> float:
    """Position as an encoder reads it."""
    return arrays.encoder_reading(arrays.start_memory(x, 0.0), t)


def _no_states(delay: float, mend: str) -> ValueError:
    return ValueError(
        f"a delay of {delay:g} s has no states in continuous time: {mend}, or put "
        f"control.pade({delay:g}) before the mode of an axis without it"
    )


def mode_matrices(
    rate: float, inverse_mass: float, dt: float, discretization: str
) -> tuple[Floats, Floats]:
    """State matrix and force column of ``v' = -rate v + force / mass``, "euler" or "zoh"."""
    if discretization == "euler":
        return np.array([[1.0, dt], [0.0, 1.0 - dt * rate]]), np.array([0.0, dt * inverse_mass])
    z = rate * dt
    fall = -np.expm1(-rate * dt)
    # ways of a velocity of 1, and of an acceleration of 1, by series where they cancel
    moved = fall / rate if z > 1e-8 else dt * (1.0 - 0.5 * z)
    drift = (dt - moved) / rate if z > 1e-4 else dt**2 * (0.5 - z / 6.0 + z * z / 24.0)
    A = np.array([[1.0, moved], [0.0, 1.0 - fall]])
    return A, np.array([inverse_mass * drift, inverse_mass * moved])


def _hold_matrices(a: Floats, b: Floats, h: float, method: str) -> tuple[Floats, Floats]:
    """Matrices of a time h over which the input is held."""
    n = len(a)
    rate = -float(a[1, 1])
    if method == "zoh" and n == 2 and a[1, 0] == 0.0 and rate >= 0.0:
        held, column = mode_matrices(rate, float(b[1, 0]), h, method)
        return held, column[:, None]
    rates = h * np.block([[a, b], [np.zeros((1, n + 1))]])
    held = np.eye(n + 1) + rates if method == "euler" else scipy.linalg.expm(rates)
    return held[:n, :n], held[:n, n:]


def _delay_matrices(
    a: Floats, b: Floats, delay: float, dt: float, method: str
) -> tuple[Floats, Floats]:
    """Matrices of one sample whose input is that of a while ago; earlier inputs are states."""
    if dt == 0.0:
        raise _no_states(delay, "give dt")
    if delay > MOST_STATES * dt:
        raise ValueError(
            f"a delay of {delay:g} s is {delay / dt:.3g} states at dt = {dt:g} s, at most "
            f"{MOST_STATES} are made: check the units of delay and dt, or raise dt"
        )
    # In the sample the older input acts first, for a part of it, then the newer one.
    whole, part = axis_step._whole_samples(delay, dt)
    n = len(a)
    length = whole + (part > 0.0)
    a_new, b_new = _hold_matrices(a, b, (1.0 - part) * dt, method)
    a_old, b_old = _hold_matrices(a, b, part * dt, method)
    if method == "euler":
        a_old, _ = _hold_matrices(a, b, dt, method)
        a_new = np.eye(n)
    given = np.zeros((n, whole + 2))  # columns of the inputs, the newest first
    given[:, [whole]], given[:, [whole + 1]] = b_new, a_new @ b_old
    older = given[:, 1 : length + 1]
    shift = np.eye(length, k=-1)
    big = np.block([[a_new @ a_old, older], [np.zeros((length, n)), shift]])
    return big, np.vstack([given[:, :1], np.eye(length, 1)])


class ModeStateSpace(ct.StateSpace):
    """State space of one mode; where B = 0 (stuck) it is drawn without its transmission zeros."""

    #: How it was sampled, "euler" or "zoh"; empty in continuous time.
    method = ""

    def __str__(self) -> str:
        """Matrices, and how they were sampled."""
        how = {
            "euler": '\nsampled by Euler\'s rule, first order in dt; method="zoh" is exact',
            "zoh": "\nsampled exactly, the input held",
        }
        return f"{super().__str__()}{how.get(self.method, '')}"

    def zeros(self) -> NDArray[np.complex128]:
        """Transmission zeros, none where the input has no effect."""
        if not np.any(self.B):
            return np.empty(0, dtype=complex)
        return np.asarray(super().zeros(), dtype=complex)


class AxisStepper:
    """An axis that is stepped sample by sample.

    x, v, F, mode and time are the state after the last step; F and mode under the last input.

    Parameters
    ----------
    axis, dt, x0, v0
        As for `FrictionAxis.stepper`.

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=0.0, coulomb=8.0)
    >>> stepper = axis.stepper(dt=1e-3)
    >>> for _ in range(1000):
    ...     stepper.step(10.0)
    >>> stepper.mode, round(stepper.v, 9)
    (1, 1.0)
    """

    def __init__(self, axis: FrictionAxis, dt: float, x0: float = 0.0, v0: float = 0.0) -> None:
        instance("axis", axis, FrictionAxis)
        self.axis = axis
        self.dt = positive("dt", dt, unit="s")
        check_pace(axis, self.dt)
        self._arrays = axis.arrays(self.dt)
        self._memory = self._arrays.start_memory(finite("x0", x0), finite("v0", v0))
        self._samples = 0
        self.F = 0.0

    @property
    def x(self) -> float:
        """Position, as an encoder reads it [m]."""
        return self._arrays.encoder_reading(self._memory, self.time)

    @property
    def v(self) -> float:
        """Velocity [m/s]."""
        return float(self._memory[1])

    @property
    def mode(self) -> int:
        """Mode: 0 stuck, +1 or -1 sliding."""
        return int(self._memory[2])

    @property
    def time(self) -> float:
        """Time since the start [s]."""
        return self._samples * self.dt

    def step(self, u: float) -> None:
        """Hold the drive force u for one sample.

        Parameters
        ----------
        u : float
            Drive force [N], a finite number.
        """
        force = finite("u", u)
        self._arrays.step(self._memory, self.time, self.dt, force)
        self._samples += 1
        _, self.F, _ = self._arrays.outputs_at(self._memory, self.time, self.dt, force)


def known_force(load: ArrayLike | None, size: int, name: str = "load") -> Floats:
    """A known force on the mass as kernels take it: one value a sample, or empty for none."""
    if load is None:
        return NO_FORCE
    force = samples(name, load)
    if force.size != size:
        raise ValueError(f"{name} has {force.size} samples and u {size}: give one at each sample")
    force = force.copy()
    force.setflags(write=False)  # as that of a record: kernels are compiled for each type
    return force


def check_pace(axis: FrictionAxis, dt: float) -> None:
    """Refuse an axis whose velocity changes too fast to be followed: a wrong unit."""
    axis = axis.effective()
    rate = axis.viscous / axis.mass
    if rate * dt > MOST_VISCOUS:
        raise ValueError(
            f"viscous / mass = {rate:.3g} 1/s makes {rate * dt:.3g} time constants in one sample "
            f"of dt = {dt:g} s: check the units of viscous and mass"
        )
    if axis.stribeck is not None:
        middle = 0.5 * sum(axis.travel or (0.0, 0.0))
        peak = axis.stribeck.excess * float(max(axis.coulomb(middle, 1), axis.coulomb(middle, -1)))
        rate = peak / (axis.mass * axis.stribeck.speed)
        if rate * dt > MOST_STRIBECK:
            raise ValueError(
                f"stribeck.speed = {axis.stribeck.speed:g} is crossed {rate * dt:.3g} times in one "
                f"sample of dt = {dt:g} s: check the units of stribeck.speed and mass"
            )
    for effect in axis.effects:
        if dt > MOST_SAMPLES * effect.shortest_time:
            raise ValueError(
                f"{effect.describe(axis.units)} turns round {dt / effect.shortest_time:.3g} times "
                f"in one sample of dt = {dt:g} s: check its units"
            )
    rates = elastic_rates(axis, dt)
    for effect in axis.effects:
        swing = rates.get(effect.action, 0.0) * dt
        if effect.stiffest > 0.0:
            swing = math.sqrt(effect.stiffest * inverse_masses(axis, dt)) * dt
        decay = rates["damping"] * dt if effect.action == "transmission" else 0.0
        if swing > MOST_SWING:
            inner = effect.inner(axis)
            unit = axis.unit("N/m")
            stiffness = inner.contact + inner.stiffness
            less = MOST_SWING / swing
            stiffness = max(stiffness, effect.stiffest)
            raise ValueError(
                f"{effect.describe(axis.units)} is too stiff: with {stiffness:.3g} {unit} it "
                f"swings by {swing:.3g} rad in one sample of dt = {dt:g} s. Use at most "
                f"{stiffness * less**2:.3g} {unit}, a dt of at most {dt * less:.3g} s, or leave it "
                "out: the samples show a rigid axis"
            )
        if decay > MOST_VISCOUS:
            raise ValueError(
                f"{effect.describe(axis.units)} is damped by {decay:.3g} time constants in one "
                f"sample of dt = {dt:g} s: check the units of its damping"
            )


def inverse_masses(axis: FrictionAxis, dt: float) -> float:
    """Sum of the inverse masses of motor and load [1/kg]."""
    arrays = axis.arrays(dt)
    numbers = arrays.numbers
    # With two masses the numbers are stored twice, those of the load second.
    load = arrays.integers[axis_step.N_NUMBERS] if numbers[axis_step.STIFFNESS] > 0.0 else 0
    return float(numbers[axis_step.INVERSE_MOTOR] + numbers[load + axis_step.INVERSE_MASS])


def elastic_rates(axis: FrictionAxis, dt: float) -> dict[str, float]:
    """Frequencies of "contact" and "transmission", decay by its "damping" [1/s]; 0 without."""
    numbers = axis.arrays(dt).numbers
    inverse = inverse_masses(axis, dt)
    return {
        "contact": math.sqrt(
            numbers[axis_step.CONTACT_STIFFNESS] * numbers[axis_step.INVERSE_MASS]
        ),
        "transmission": math.sqrt(numbers[axis_step.STIFFNESS] * inverse),
        "damping": float(numbers[axis_step.DAMPING]) * inverse,
    }


def inner_of(axis: FrictionAxis) -> Inner:
    """Numbers of delay, lag, contact and transmission of an axis with its effective base."""
    # An axis holds one of each kind that has a state, so that adding is collecting.
    states = [e.inner(axis) for e in axis.effects if e.action in WITH_STATE]
    return Inner(*map(sum, zip(*states, strict=True))) if states else Inner()


def rigid_inner(axis: FrictionAxis) -> Inner:
    """The same of an axis whose modes are linear systems; others are refused."""
    inner = inner_of(axis)
    remembering = any(e.action == "memory" for e in axis.effects)
    if inner.contact > 0.0 or _has_transmission(inner) or remembering:
        elastic = [e.slug for e in axis.effects if not e.has_linear_states()]
        raise ValueError(
            f"a mode has no place for {' and '.join(elastic)}: leave it out, as in "
            "axis.replace(effects=...), or linearise the whole axis where it moves, "
            "control.linearize(dfc.axis_block(axis, dt), states, [u])"
            + page_reference("howto/modes")
        )
    return inner


def without_effects(axis: FrictionAxis, actions: Iterable[str] = REMEMBERING) -> FrictionAxis:
    """Axis without effects of some actions; by default without all that have states."""
    return axis.replace(effects=tuple(e for e in axis.effects if e.action not in actions))


def span_of(travel: Any, name: str = "travel") -> tuple[float, float]:
    """Lowest and highest position, checked."""
    try:
        low, high = travel
    except (TypeError, ValueError):
        raise ValueError(f"{name} must be (low, high), got {travel!r}") from None
    low = finite(f"{name}[0]", low)
    high = finite(f"{name}[1]", high)
    if not low < high:
        raise ValueError(f"{name} must run from low to high, got {travel!r}")
    return low, high


def _polynomial(coefficients: tuple[float, ...]) -> str:
    terms = [f"{coefficients[0]:.6g}"]
    for power, c in enumerate(coefficients[1:], start=1):
        terms.append(f"{'+' if c >= 0 else '-'} {abs(c):.6g} x{f'^{power}' if power > 1 else ''}")
    return " ".join(terms)


def _mode_coefficients(
    axis: FrictionAxis, index: int, input: str, slopes: tuple[float, float, float, float] | None
) -> tuple[float, float, float, float]:
    """Slope by position, decay rate and gain of a mode's acceleration, slope of the reading."""
    pull = 0.0
    rate = axis.stick_rate if index == 0 else axis.viscous / axis.mass
    gain = 0.0 if index == 0 and input == "drive" else 1.0 / axis.mass
    if slopes is None:
        return pull, rate, gain, 1.0
    if index != 0:
        pull = slopes[0]
        rate = -slopes[1]
        gain = slopes[2] if input == "drive" else gain
    return pull, rate, gain, slopes[3]


def _check_euler(rates: Mapping[str, float], dt: float) -> None:
    """Refuse a step with which Euler's method is unstable."""
    for what, fall in rates.items():
        if dt * fall >= 2.0:
            raise ValueError(
                f"Euler needs dt * {what} < 2, got {dt * fall:.4g}: "
                f'lower dt or {what}, or take method="zoh"'
            )


def _usual_speed(axis: FrictionAxis, inner: Inner) -> float:
    """Velocity that an axis at rest, or on its elastic contact, does not exceed [m/s]."""
    if inner.contact == 0.0:
        return axis.stick_speed
    # That with which its breakaway force takes it over the distance in which the level builds up.
    excess = axis.stribeck.excess if axis.stribeck else 0.0
    level = (1.0 + excess) * middle_level(axis.coulomb, axis.travel)
    return max(axis.stick_speed, 2.0 * level / math.sqrt(inner.contact * axis.mass))


def _history_length(axis: FrictionAxis, inner: Inner, dt: float) -> int:
    """Inputs that the delay line of an axis holds."""
    if inner.delay > MOST_SAMPLES * dt:
        late = next(name for name, e in named(axis).items() if e.action == "delay")
        raise ValueError(
            f"{late}.delay = {inner.delay:g} s is {inner.delay / dt:.3g} samples of dt = {dt:g} s: "
            "check the units of delay and dt"
        )
    return int(np.ceil(inner.delay / dt)) + 2 if inner.delay > 0.0 else 0


def _has_transmission(inner: Inner) -> bool:
    """Whether a gap or a spring is before the load."""
    return inner.half_gap > 0.0 or inner.stiffness > 0.0


def _is_rigid_play(inner: Inner) -> bool:
    """Whether a gap before the load has rigid ends."""
    return inner.half_gap > 0.0 and inner.stiffness == 0.0


def _structure_flags(inner: Inner, remembers: bool) -> int:
    """Flags of the inner states of an axis; `remembers`: whether effects have some."""
    return (
        axis_step.CONTACT * (inner.contact > 0.0)
        | axis_step.PLAY * _is_rigid_play(inner)
        | axis_step.SPRING * (inner.stiffness > 0.0)
        | axis_step.ON_LOAD * (_has_transmission(inner) and inner.on_load > 0.0)
        | axis_step.MOTOR_RUBS * (inner.motor_rubs > 0.0)
        | axis_step.REMEMBERS * remembers
    )


def _check_effects(effects: tuple[Effect, ...]) -> None:
    """Refuse what is no effect, and several that need the same state."""
    for effect in effects:
        if not isinstance(effect, Effect):
            raise ValueError(
                "effects must be a sequence of effects, such as "
                f"[dfc.effects.Spring(stiffness=200.0)], got {effect!r}"
            )
    for action in WITH_STATE:
        alike = _effect_names(effects, action)
        if len(alike) > 1:
            mend = "keep one" if action in ELASTIC else "add them up"
            raise ValueError(f"effects holds more than one {action} ({', '.join(alike)}): {mend}")
    memories = _effect_names(effects, "memory")
    elastic = _effect_names(effects, *ELASTIC)
    if memories and elastic:
        raise ValueError(
            f"effects holds states of {' and '.join(memories)} beside {' and '.join(elastic)}: "
            "an axis has either; keep one"
        )
    for effect in effects:
        if effect.action == "memory":
            _check_limits(effect)


def _effect_names(effects: tuple[Effect, ...], *actions: str) -> list[str]:
    """Names of the effects of some actions."""
    return [effect.slug for effect in effects if effect.action in actions]


def _check_limits(effect: Effect) -> None:
    """Refuse limits that do not fit the states, which begin at zero."""
    given = np.array(effect.limits, dtype=float)
    fits = given.shape == (len(effect.states), 2)
    if not fits or not np.all((given[:, 0] <= 0.0) & (given[:, 1] >= 0.0)):
        raise ValueError(
            f"{effect.slug}.limits must be (low, high) for each of {', '.join(effect.states)}, "
            f"low <= 0 <= high, got {effect.limits!r}"
        )


def _base_numbers(axis: FrictionAxis, inner: Inner, friction_mass: float) -> list[float]:
    """Numbers of an axis before those of its laws; `friction_mass`: share of the mass with it."""
    low, high = axis.travel or (-np.inf, np.inf)
    stribeck = axis.stribeck
    return [
        1.0 / axis.mass,
        axis.viscous,
        stribeck.excess if stribeck else 0.0,
        1.0 / stribeck.speed if stribeck else 0.0,
        axis.stick_speed,
        inner.contact_damping / axis.mass if inner.contact > 0.0 else axis.stick_rate,
        low,
        high,
        *inner[: Inner._fields.index("load_fraction")],
        1.0 / (axis.mass * (1.0 - friction_mass)) if _has_transmission(inner) else 0.0,
        min((effect.shortest_length for effect in axis.effects), default=np.inf),
        min((effect.shortest_time for effect in axis.effects), default=np.inf),
        0.0,
    ]


def _edges(axis: FrictionAxis) -> list[float]:
    """Positions at which a force bends."""
    # Beyond its travel an axis has the levels of its ends.
    bent = max(len(axis.coulomb.plus), len(axis.coulomb.minus)) > 1
    ends = axis.travel or ()
    return [*(ends if bent else ()), *(x for e in axis.effects for x in e.edges)]


def _task_addresses(structure: int) -> tuple[int, int]:
    """Addresses of the functions that move an axis without, and with, its inner states."""
    rigid = axis_step.rigid_task().address
    if structure & axis_step.REMEMBERS:
        return rigid, states_task().address
    return rigid, elastic.inner_task().address if structure else rigid


def _append_load_side(
    numbers: list[float], integers: list[int], inner: Inner, friction_mass: float
) -> None:
    """Append the numbers again for the mass with friction alone, behind a transmission."""
    load = len(numbers)
    integers[axis_step.N_NUMBERS] = load
    numbers += numbers
    numbers[load + axis_step.INVERSE_MASS] /= friction_mass
    if inner.contact > 0.0:
        numbers[load + axis_step.STICK_RATE] /= friction_mass
    numbers[load + axis_step.BEHIND] = 1.0


def _append_states(numbers: list[float], effect: Effect, law: int) -> list[int]:
    """Append room for the states of an effect, and their limits; the rows of the states."""
    first, n = len(numbers), len(effect.states)
    if n == 0:
        return []
    numbers += [0.0] * n
    numbers += [value for limits in effect.limits for value in limits]
    flow, jump = (law_address(type(effect), name) for name in ("flow", "jump"))
    rows = ((first + i, first + n + 2 * i, i, law, flow, jump) for i in range(n))
    return [entry for row in rows for entry in row]


def _state_room(integers: list[int]) -> int:
    """Numbers that effects with a memory need in that of a run: states, and room to work in."""
    n = integers[axis_step.N_STATES]
    return n + BLOCKS * (n + 2) + integers[axis_step.N_COPIED] if n else 0


class _Laws(NamedTuple):
    """Effects of an axis by what their laws add to, in the order of the arrays."""

    inputs: list[Effect]
    forces: list[Effect]
    levels: list[Effect]
    readings: list[Effect]

    @classmethod
    def from_axis(cls, axis: FrictionAxis) -> _Laws:
        """Laws of an axis, those that steps treat alike side by side."""
        by_action: defaultdict[str, list[Effect]] = defaultdict(list)
        for effect in axis.effects:
            action = effect.adds_to if effect.action == "memory" else effect.action
            by_action[action].append(effect)
        forces = sorted(by_action["force"], key=lambda effect: effect.depends_on_speed)
        # A share of the level, by place or time, is a share of the level of each direction.
        levels = sorted(
            by_action["friction"],
            key=lambda e: (not e.within_peak, e.by_drive, not e.depends_on_direction),
        )
        return cls(by_action["input"], forces, levels, by_action["reading"])

    @property
    def effects(self) -> list[Effect]:
        """All of them in one list."""
        return [*self.inputs, *self.forces, *self.levels, *self.readings]


def _friction_mass(inner: Inner) -> float:
    """Share of the mass on which friction acts, where there are two."""
    return 1.0 - inner.load_fraction if inner.motor_rubs else inner.load_fraction


def _transmitted_mass(inner: Inner, loaded: int) -> float:
    """Share of the mass that the transmission moves; `loaded`: levels that depend on its load."""
    is_behind = _is_rigid_play(inner) and not inner.motor_rubs
    return inner.load_fraction if is_behind and loaded else 1.0


@functools.lru_cache(maxsize=1024)
def _arrays(axis: FrictionAxis, dt: float, moved: bool) -> Arrays:
    axis = axis.effective()
    laws = _Laws.from_axis(axis)
    effects = laws.effects
    inner = inner_of(axis)
    friction_mass = _friction_mass(inner)
    loaded = sum(effect.depends_on_load for effect in laws.levels)
    corners = input_corners(laws.inputs)
    usual = _usual_speed(axis, inner)
    slopes = {effect: effect.slopes(axis, usual) for effect in (*laws.forces, *laws.levels)}
    edges = _edges(axis)
    states = sum(len(effect.states) for effect in effects)
    numbers = [
        *_base_numbers(axis, inner, friction_mass),
        _transmitted_mass(inner, loaded),
        inner.bristles,
        0.0,
        0.0,
        *axis.coulomb.plus,
        *axis.coulomb.minus,
    ]
    history = _history_length(axis, inner, dt)
    structure = _structure_flags(inner, states > 0)
    integers = [
        SWITCHING[axis.switching],
        len(axis.coulomb.plus),
        len(axis.coulomb.minus),
        len(laws.inputs),
        len(laws.forces),
        sum(not effect.depends_on_speed for effect in laws.forces),
        len(laws.levels),
        history,
        structure,
        0,
        *(_task_addresses(structure) if moved else (0, 0)),
        sum(effect.within_peak for effect in laws.levels),
        len(laws.readings),
        loaded,
        len(corners),
        len(numbers),
        sum(effect.by_drive for effect in laws.levels),
        sum(math.isfinite(slope.bend) for slope in slopes.values()),
        len(edges),
        states,
        axis_step.LAWS + 2 * len(effects),
        0,
    ]
    numbers += [*corners, *edges]
    rows: list[int] = []
    for k, effect in enumerate(effects):
        numbers += slopes.get(effect, Slopes()).within_range()
        integers += [law_address(type(effect)), len(numbers)]
        numbers += effect.values
        rows += _append_states(numbers, effect, k)
    integers[axis_step.N_COPIED] = len(numbers)
    integers += rows
    if _has_transmission(inner):
        _append_load_side(numbers, integers, inner, friction_mass)
    result = Arrays(
        np.array(numbers, dtype=float),
        np.array(integers, dtype=np.int64),
        axis_step.HISTORY + 2 * history + _state_room(integers),
    )
    result.numbers.setflags(write=False)
    result.integers.setflags(write=False)
    return result
