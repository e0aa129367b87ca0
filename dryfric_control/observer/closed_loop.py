"""The paper's closed loop with its observer, how well that follows the plant, its figures."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

import control as ct
import numpy as np
from numpy.typing import ArrayLike

from dryfric_control import drawing
from dryfric_control.arrays import Floats
from dryfric_control.checks import finite, instance, one_of, samples
from dryfric_control.model import loops
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.model.blocks import (
    axis_block,
    encoder,
    reference_filter,
)
from dryfric_control.model.loops import LoopController, PositionController
from dryfric_control.model.responses import SimulationResponse
from dryfric_control.observer import runtime
from dryfric_control.observer.base import OUTPUTS, ObserverResponse
from dryfric_control.observer.design import ObserverDesign
from dryfric_control.text import Result, plain_data
from dryfric_control.ties import samples as steps_in

_PLANT = ("x", "v", "F", "mode", "u", "y")
# Start that the inset of the position shows [s].
_FIRST = 0.15
#: Signals of a run: name, unit, row of the plant and of the estimate.
_SIGNALS = {
    "position": ("position", "length", 0, 0),
    "speed": ("velocity", "speed", 1, 1),
    "friction": ("friction", "force", 2, 2),
    "mode": ("mode", "", 3, 4),
}
#: Time that the observer has to forget its start before the position is judged [s].
SETTLED_POSITION = 0.1
#: The same before velocity and friction are judged [s].
SETTLED = 0.2


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
    near = steps_in(SETTLED_POSITION, dt)
    late = steps_in(SETTLED, dt)
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


def filter_reference(
    reference: ArrayLike, bandwidth: float, dt: float, start: float = 0.0
) -> Floats:
    """Reference behind the Butterworth low-pass of `reference_filter`, shape (n,)."""
    # Steps the very block that `observed_loop` contains: through an encoder a difference in
    # the last digit can grow to a whole increment.
    start = finite("start", start)
    r = samples("reference", reference) - start
    block = reference_filter(bandwidth, dt)
    state = np.zeros(block.nstates)
    out = np.empty(r.size)
    for k in range(r.size):
        out[k] = block.output(0.0, state, r[k : k + 1])[0]
        state = block.dynamics(0.0, state, r[k : k + 1])
    return out + start


@dataclass(frozen=True, repr=False)
class ObservedLoop(Result):
    """A closed loop and what an observer made of it."""

    axis: FrictionAxis
    design: ObserverDesign
    reference: Floats  # behind the low-pass [m]
    plant: SimulationResponse  # outputs x, v, F, mode, u, y
    estimate: ObserverResponse  # outputs xhat, vhat, Fhat, what, mode
    start: float  # observer at the start [m]

    @property
    def score(self) -> EstimateScore:
        """Errors of position, velocity, friction and mode."""
        return score_estimate(self.axis, self.design.dt, self.plant.y, self.estimate.y)

    @property
    def delays(self) -> tuple[Floats, Floats]:
        """Time of each switch of the plant and the observer's delay [s]."""
        return switch_delays(self.plant.y[3], self.estimate.y[4], self.design.dt)

    def _summary_parts(self) -> Iterator[str]:
        yield from self.score.summary(self.axis.units[0]).splitlines()
        _, delay = self.delays
        seen = delay[np.isfinite(delay)] * 1e3
        spread = ""
        if seen.size:
            spread = f", delay {np.median(seen):.1f} ms in the middle, {seen.max():.1f} ms at most"
        if delay.size:
            yield f"switches     {delay.size}, missed {delay.size - seen.size}{spread}"

    def to_dict(self) -> dict[str, Any]:
        """Score and delays as plain numbers."""
        _, delay = self.delays
        missed = int(np.isnan(delay).sum())
        found = {
            "score": self.score,
            "switches": delay.size,
            "missed": missed,
            "delay": delay,
        }
        return {name: plain_data(value) for name, value in found.items()}

    def plot(self, ax: Any = None, title: str | None = None, what: str = "all") -> ct.ControlPlot:
        """Draw the plant against its estimate.

        `what` is "all", "maps" (friction over the travel; paper, Fig. 7), "position", "speed",
        "friction" or "mode" with its error (Figs 8 to 11); `ax` four axes, one, or two.
        """
        one_of(
            "what",
            what,
            ("all", "position", "speed", "friction", "mode", "maps"),
        )
        if what == "maps":
            return draw_coulomb_maps(self.axis, self.design.axis, ax, title)
        return draw_run(self, what, ax, title)


def simulate_observed_loop(
    axis: FrictionAxis,
    controller: LoopController,
    design: ObserverDesign,
    reference: ArrayLike,
    *,
    bandwidth: float | None = 20.0,
    quantum: float = 0.0,
    x0: float = 0.0,
    v0: float = 0.0,
    xhat0: float | None = None,
    vhat0: float = 0.0,
    what0: float = 0.0,
    switching: str = "reading",
) -> ObservedLoop:
    """Run the closed loop with an observer in parallel, compiled.

    Parameters
    ----------
    axis : FrictionAxis
    controller : PositionController or CompensatedController
        It uses the readings, not the estimate.
    design : ObserverDesign
    reference : array_like, shape (n,)
        Position reference at the samples [m].
    bandwidth : float or None, optional
        Corner of the low-pass on the reference [rad/s], at `x0` at first; None leaves it out.
    quantum : float, optional
        Encoder increment [m]; 0 measures exactly.
    x0, v0 : float, optional
        Start of the plant [m], [m/s].
    xhat0, vhat0, what0, switching
        As for `observe`.

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    >>> design = dfc.design_pi_observer(axis, dt=1e-3, encoder_quantum=1e-5)
    >>> controller = dfc.PositionController.from_bandwidth(axis, 20.0, 1e-3)
    >>> r = [0.1] * 2000
    >>> run = dfc.observer.simulate_observed_loop(axis, controller, design, r, quantum=1e-5)
    >>> run.score.speed < 0.03
    True
    """
    check_loop(controller, design)
    instance("axis", axis, FrictionAxis)
    design.tables(switching, quantum)
    design.memory(
        0.0,
        None if xhat0 is None else finite("xhat0", xhat0),
        vhat0,
        what0,
    )
    x0 = finite("x0", x0)
    r = samples("reference", reference)
    if bandwidth is not None:
        r = filter_reference(r, bandwidth, design.dt, x0)
    plant = loops.simulate_loop(axis, controller, r, quantum=quantum, x0=x0, v0=v0)
    estimate = runtime.observe(
        design,
        plant.y[4],
        plant.y[5],
        xhat0=xhat0,
        vhat0=vhat0,
        what0=what0,
        switching=switching,
        encoder_quantum=quantum,
    )
    start = float(plant.y[5, 0] if xhat0 is None else xhat0)
    return ObservedLoop(axis, design, r, plant, estimate, start)


def observed_loop(
    axis: FrictionAxis,
    controller: PositionController,
    design: ObserverDesign,
    *,
    bandwidth: float = 20.0,
    quantum: float = 0.0,
    switching: str = "reading",
) -> ct.InterconnectedSystem:
    """The closed loop with its observer, by `control.interconnect`.

    Parameters
    ----------
    axis, controller, design, bandwidth, quantum, switching
        As in `simulate_observed_loop`.

    Returns
    -------
    control.InterconnectedSystem
        Input r; outputs x, v, F, mode, u, y of the plant, xref, and xhat, vhat, Fhat, what,
        mode_hat of the observer.

    Examples
    --------
    >>> import control as ct
    >>> import numpy as np
    >>> import dryfric_control as dfc
    >>> from dryfric_control import presets
    >>> axis = presets.clutch_actuator()
    >>> controller, design = presets.clutch_controller(), presets.clutch_observer()
    >>> loop = dfc.observer.observed_loop(axis, controller, design)
    >>> start = np.zeros(loop.nstates)
    >>> start[loop.find_state("observer_xhat")] = 1000.0
    >>> run = ct.input_output_response(loop, np.arange(3) * 1e-3, 0.0, start)
    >>> bool(run.outputs[loop.find_output("xhat"), 0] < 100.0)  # after the first reading
    True
    """
    instance("controller", controller, PositionController)
    check_loop(controller, design)
    dt = design.dt
    parts = [
        reference_filter(bandwidth, dt),
        controller.block("controller"),
        axis_block(axis, dt, name="plant"),
        encoder(quantum, dt),
        runtime.pi_observer(design, switching=switching, encoder_quantum=quantum),
    ]
    sources = {name: f"plant.{name}" for name in _PLANT[:4]}
    sources |= {
        "u": "controller.u",
        "y": "encoder.y",
        "xref": "reference_filter.xref",
    }
    sources |= {name: f"observer.{name}" for name in OUTPUTS[:4]}
    sources["mode_hat"] = "observer.mode"
    # Signals of one name are connected.
    return ct.interconnect(
        parts,
        inplist=["reference_filter.r"],
        outlist=list(sources.values()),
        inputs=["r"],
        outputs=list(sources),
        dt=dt,
        name="observed_loop",
    )


def check_loop(controller: LoopController, design: ObserverDesign) -> None:
    """Refuse what is no controller or no design, or two that do not fit."""
    loops.check_controller(controller)
    instance("design", design, ObserverDesign, "made by dfc.design_pi_observer")
    if controller.dt != design.dt:
        raise ValueError(
            f"controller.dt = {controller.dt:g} s and design.dt = {design.dt:g} s differ: "
            "make both for one sampling time"
        )


def draw_coulomb_maps(
    plant: FrictionAxis,
    own: FrictionAxis,
    ax: Any = None,
    title: str | None = None,
) -> ct.ControlPlot:
    """Draw the friction of the plant and of the observer (Fig. 7)."""
    axes = drawing.axes_of(ax, 1, title, figsize=(7.0, 3.6))
    one = axes[0]
    plant = plant.effective()
    own = own.effective()
    low, high = plant.travel or own.travel or (-1.0, 1.0)
    x = np.linspace(low, high, 201)
    for s in (1, -1):
        level = s * plant.coulomb(x, s)
        names = ("up to breakaway", "system", "observer") if s > 0 else (None,) * 3
        top = s * plant.breakaway(x, s)
        one.fill_between(x, level, top, color="0.9", linewidth=0, label=names[0])
        one.plot(x, level, "k", label=names[1])
        one.plot(x, s * own.coulomb(x, s), "C0--", label=names[2])
    one.axhline(0.0, color="0.7", linewidth=0.8)
    length, force = plant.units
    one.set(xlabel=f"position [{length}]", ylabel=f"friction [{force}]")
    one.margins(x=0.0)
    drawing.legend_above(one)
    drawing.title_above(
        one,
        f"{plant.name}: friction over the travel" if title is None else title,
    )
    return drawing.control_plot(axes)


def draw_run(
    run: ObservedLoop, what: str, ax: Any = None, title: str | None = None
) -> ct.ControlPlot:
    """Draw one signal of a run with its error (Figs 8 to 11), or "all" of them without."""
    whole = what == "all"
    axes = drawing.axes_of(ax, len(_SIGNALS) if whole else 2, title)
    t, (length, force) = run.plant.t, run.axis.units
    units = {
        "length": f" [{length}]",
        "speed": f" [{length}/s]",
        "force": f" [{force}]",
        "": "",
    }
    shown = list(_SIGNALS.values()) if whole else [_SIGNALS[what]]
    for one, (name, kind, row, mine) in zip(axes, shown, strict=False):
        true = run.plant.y[row]
        estimate = run.estimate.y[mine]
        if name == "position":
            one.plot(
                t,
                run.reference,
                color="0.55",
                linewidth=0.8,
                label="reference",
            )
        style = {} if kind else {"drawstyle": "steps-post"}
        one.plot(t, true, "k", linewidth=1.0, label="system", **style)
        one.plot(t, estimate, "C0--", linewidth=1.0, label="observer", **style)
        drawing.settled_scale(one, t, true, estimate)
        one.set_ylabel(name + units[kind])
        if name == "mode":
            one.set_yticks([-1, 0, 1], ["sliding -", "stuck", "sliding +"])
    if not whole:
        axes[1].plot(t, estimate - true, "C3", linewidth=0.8, **style)
        drawing.settled_scale(axes[1], t, estimate - true)
        axes[1].set_ylabel(f"error{units[kind]}" if kind else "mode error")
        if not kind:
            axes[1].set_yticks([-2, -1, 0, 1, 2])
    for one in axes:
        drawing.shade_stuck(one, t, run.plant.y[3])
    drawing.over_time(axes)
    drawing.legend_above(axes[0])
    words = f"{name} and its estimate" if not whole else "axis and its observer"
    drawing.title_above(axes[0], f"{run.axis.name}: {words}" if title is None else title)
    if what == "position":
        _draw_start(axes[0], run)
    return drawing.control_plot(axes)


def _draw_start(ax: Any, run: ObservedLoop) -> None:
    """Inset of the first 0.15 s, with the position from which the observer started."""
    first = run.plant.t <= _FIRST
    inset = ax.inset_axes((0.055, 0.40, 0.25, 0.46))
    inset.plot(run.plant.t[first], run.plant.y[0][first], "k", linewidth=1.0)
    # Before its first reading the observer is where it was started.
    t = np.r_[0.0, run.plant.t[first]]
    estimate = np.r_[run.start, run.estimate.y[0][first]]
    inset.plot(t, estimate, "C0.--", linewidth=1.0, ms=3)
    inset.plot(0.0, run.start, "C0o", ms=4, clip_on=False)
    inset.set_xlim(-0.03 * _FIRST, _FIRST)
    inset.set_title(f"observer starts at {run.start:.4g}", fontsize="x-small", pad=2.0)
    inset.tick_params(labelsize="x-small")
