"""The paper's closed loop: filter, controller, plant, encoder and observer."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import control as ct
import numpy as np
from numpy.typing import ArrayLike

from dryfric_control.arrays import Floats
from dryfric_control.checks import finite, instance, one_of, samples
from dryfric_control.model import loops
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.model.blocks import axis_block, encoder, reference_filter
from dryfric_control.model.loops import LoopController, PositionController
from dryfric_control.model.responses import SimulationResponse
from dryfric_control.observer import figures, runtime
from dryfric_control.observer.design import ObserverDesign
from dryfric_control.observer.score import EstimateScore, score_estimate, switch_delays
from dryfric_control.text import Result, plain_data

_PLANT = ("x", "v", "F", "mode", "u", "y")


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
    estimate: runtime.ObserverResponse  # outputs xhat, vhat, Fhat, what, mode
    start: float  # observer at the start [m]

    @property
    def score(self) -> EstimateScore:
        """Errors of position, velocity, friction and mode."""
        return score_estimate(self.axis, self.design.dt, self.plant.y, self.estimate.y)

    @property
    def delays(self) -> tuple[Floats, Floats]:
        """Time of each switch of the plant and the observer's delay [s]."""
        return switch_delays(self.plant.y[3], self.estimate.y[4], self.design.dt)

    def _shown(self) -> Iterator[str]:
        yield from self.score.summary(self.axis.units[0]).splitlines()
        _, delay = self.delays
        seen, spread = delay[np.isfinite(delay)] * 1e3, ""
        if seen.size:
            spread = f", delay {np.median(seen):.1f} ms in the middle, {seen.max():.1f} ms at most"
        if delay.size:
            yield f"switches     {delay.size}, missed {delay.size - seen.size}{spread}"

    def to_dict(self) -> dict[str, Any]:
        """Score and delays as plain numbers."""
        _, delay = self.delays
        missed = int(np.isnan(delay).sum())
        found = {"score": self.score, "switches": delay.size, "missed": missed, "delay": delay}
        return {name: plain_data(value) for name, value in found.items()}

    def plot(self, ax: Any = None, title: str | None = None, what: str = "all") -> ct.ControlPlot:
        """Draw the plant against its estimate.

        `what` is "all", "maps" (friction over the travel; paper, Fig. 7), "position", "speed",
        "friction" or "mode" with its error (Figs 8 to 11); `ax` four axes, one, or two.
        """
        one_of("what", what, ("all", "position", "speed", "friction", "mode", "maps"))
        if what == "maps":
            return figures.draw_coulomb_maps(self.axis, self.design.axis, ax, title)
        return figures.draw_run(self, what, ax, title)


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
    runtime.tables(design, switching, quantum)
    runtime.first_memory(design, 0.0 if xhat0 is None else finite("xhat0", xhat0), vhat0, what0)
    x0 = finite("x0", x0)
    r = samples("reference", reference)
    if bandwidth is not None:
        r = filter_reference(r, bandwidth, design.dt, x0)
    plant = loops.simulate_loop(axis, controller, r, quantum=quantum, x0=x0, v0=v0)
    estimate = runtime.observe(
        design, plant.y[4], plant.y[5], xhat0=xhat0, vhat0=vhat0, what0=what0,
        switching=switching, encoder_quantum=quantum,
    )  # fmt: skip
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
    sources |= {"u": "controller.u", "y": "encoder.y", "xref": "reference_filter.xref"}
    sources |= {name: f"observer.{name}" for name in runtime.OUTPUTS[:4]}
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
