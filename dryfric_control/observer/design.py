"""Design of the switched PI observer, and the design as an object."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import control
import numpy as np

from dryfric_control.arrays import Floats, Ints
from dryfric_control.checks import one_of, positive, sampling_time, whole
from dryfric_control.compiled import observer as kernel
from dryfric_control.model.axis import MODES, FrictionAxis
from dryfric_control.model.friction import CoulombMap
from dryfric_control.model.responses import check_mode
from dryfric_control.observer import error_model
from dryfric_control.observer.base import Kernel, Observer
from dryfric_control.observer.certificate import (
    Certificate,
    CertificateError,
    Problem,
    certificate_of,
    signed,
)
from dryfric_control.observer.error_model import (
    DISCRETIZATIONS,
    FORMS,
    ErrorModel,
    default_weights,
    mode_classes,
    own_axis,
)
from dryfric_control.observer.pi_tables import (
    Tables,
    pi_memory,
    pi_tables,
)
from dryfric_control.observer.switching import (
    ModeGraph,
    allowed_pairs,
    window_graph,
)
from dryfric_control.observer.synthesis import (
    SOLVERS,
    Scales,
    certified_solution,
    scales_of,
)
from dryfric_control.text import Result, documented, stated

METHODS = ("paper", "slack", "path")
#: Memory in samples where the user names none.
DEFAULT_WINDOW = {"paper": 1, "slack": 1, "path": 4}
#: States of the block before the line of delayed drives.
STATES = (
    "xhat",
    "vhat",
    "what",
    "mode",
    "memory",
    "rest",
    "error_minus",
    "error_plus",
    "place",
    "count",
    "lagged",
)


@documented
@dataclass(frozen=True, eq=False, repr=False)
class ObserverDesign(Observer, Result):
    """A switched PI observer: gains, specifications, certificate.

    Made by `design_pi_observer`.

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    >>> design = dfc.design_pi_observer(axis, dt=1e-3, encoder_quantum=1e-6)
    >>> sorted(design.gains), design.gains[0].shape
    ([-1, 0, 1], (3,))
    >>> design.lower_bound <= design.gamma
    True
    """

    axis: FrictionAxis = stated("Model of the observer: own levels and stick velocity, no peak.")
    dt: float = stated("Sampling time [s].")
    method: str = stated("paper, slack or path.")
    window: int = stated("Memory of past modes [samples].")
    discretization: str = stated("euler or zoh.")
    form: str = stated("current or prediction.")
    uncertainty: dict[int, float] = stated("Amplitude of the force uncertainty in each mode [N].")
    noise: float = stated("Amplitude of the measurement noise [m].")
    encoder_quantum: float = stated("Increment of the sensor, or that of `noise` [m].")
    drift: float = stated("Drift of the friction error per sample [N].")
    decay: float = stated("Certified decay of the error per sample.")
    performance: tuple[float, float, float] = stated("Weights (q_x, q_v, q_w) of the error in z.")
    integral_modes: tuple[int, ...] = stated("Modes in which the integral term acts.")
    graph: ModeGraph = stated("Memory states and the steps between them.")
    node_gains: Floats = stated("Gains L_x [1], L_v [1/s], G [N/m] by memory state, shape (n, 3).")
    gamma: float = stated("Certified gain from the stacked disturbances to z, SI units.")
    state_scale: Floats = stated("Unit of each error in the scaled problem [m, m/s, N].")
    output_scale: float = stated("Factor of z in the scaled problem.")
    lyapunov: Floats = stated("Lyapunov matrices that prove the gain, scaled, shape (n, 3, 3).")
    lyapunov_decay: Floats = stated("Lyapunov matrices that prove the decay.")
    certificate: Certificate = stated("The recomputed check.")
    title = "switched PI observer"
    label = "design"
    sample_kernel = Kernel(kernel.step, kernel.run)
    starts: ClassVar[Mapping[str, int]] = {
        "xhat0": kernel.XHAT,
        "vhat0": kernel.VHAT,
        "what0": kernel.WHAT,
    }
    starts_at_reading = True
    _kind = "observer design"
    _holds = (ModeGraph,)
    _broken = CertificateError

    def tables(
        self,
        switching: str = "reading",
        encoder_quantum: float | None = None,
    ) -> Tables:
        """Arrays of the compiled observer.

        Parameters
        ----------
        switching, encoder_quantum
            As for `pi_observer`.
        """
        return pi_tables(self, switching, encoder_quantum)

    def memory(
        self,
        reading: float = 0.0,
        xhat0: float | None = None,
        vhat0: float = 0.0,
        what0: float = 0.0,
    ) -> Floats:
        """Memory before the first sample, shape (nstates,).

        Parameters
        ----------
        reading : float, optional
            The first reading [m].
        xhat0, vhat0, what0 : float, optional
            As for `observe`.
        """
        return pi_memory(self, reading if xhat0 is None else xhat0, vhat0, what0)

    @property
    def position_places(self) -> tuple[tuple[int, float], ...]:
        """Places of the memory that hold a position, and its unit."""
        return ((kernel.XHAT, 1.0), (kernel.PLACE, 1.0))

    @property
    def certificate_text(self) -> str:
        """What is guaranteed, for the documents of exported code."""
        return self.summary()

    def state_names(self) -> list[str]:
        """Names of the states of `block`."""
        delays = range(self.memory().size - kernel.LINE)
        return [*STATES, *(f"u{k}" for k in delays)]

    def state_ranges(self) -> dict[str, tuple[int, int]]:
        """Least and largest value of states that are whole numbers."""
        return {"mode": (-1, 1), "memory": (0, len(self.graph.labels))}

    @property
    def lower_bound(self) -> float:
        """Gain this design reaches along the worst sequence found."""
        return self.certificate.lower_bound

    @property
    def classes(self) -> dict[int, int]:
        """Class of each mode; +1 and -1 share one by default."""
        return mode_classes(self.uncertainty)

    @property
    def gains(self) -> dict[int, Floats]:
        """Gains (L_x, L_v, G) of each mode once it has lasted."""
        resting = self.graph.resting()
        return {mode: self.node_gains[resting[key]].copy() for mode, key in self.classes.items()}

    @property
    def window_gains(self) -> dict[str, Floats]:
        """Gains of every memory state, by what it remembers."""
        pairs = zip(self.graph.names, self.node_gains, strict=True)
        return {name: gain.copy() for name, gain in pairs}

    def transition_table(self) -> Ints:
        """Next memory state for each state and next mode."""
        # Shape (nnodes, 3), column mode + 1.  A step that `pairs` excludes leads to the state in
        # which the new mode has lasted; the certificate does not cover it.
        following = self.graph.next_nodes()
        resting = self.resting_nodes()
        return np.array(
            [
                [following.get((node, self.classes[m]), resting[m + 1]) for m in (-1, 0, 1)]
                for node in range(len(self.graph.labels))
            ]
        )

    def resting_nodes(self) -> Ints:
        """Memory state at place ``mode + 1`` once a mode has lasted."""
        resting = self.graph.resting()
        return np.array([resting[self.classes[mode]] for mode in (-1, 0, 1)])

    def mode_matrices(self, mode: int) -> tuple[Floats, Floats, Floats]:
        """Matrices A_i, B_i and E_i of a mode.

        Parameters
        ----------
        mode : int
            0, +1 or -1.

        Returns
        -------
        A, B, E : ndarray, shape (2, 2), (2,) and (2,)
            State matrix; column of the known force u minus Fbar, zero while stuck, where friction
            cancels it; column of the integral term.
        """
        check_mode("mode", mode)
        A, force = error_model.axis_matrices(self.axis, mode, self.dt, self.discretization)
        return (
            A,
            force * (mode != 0),
            force * (mode in self.integral_modes),
        )

    def error_dynamics(self, mode: int) -> control.StateSpace:
        """Error dynamics of one mode that lasts, for Bode and step plots.

        Parameters
        ----------
        mode : int
            0, +1 or -1.

        Returns
        -------
        control.StateSpace
            Discrete; inputs `force` (nominal minus true friction [N]), `noise` [m], `drift` [N per
            sample]; outputs `e_x`, `e_v` (true minus estimated) and `e_w` = -w [N].  Estimated
            minus true friction is `force` + `e_w`.
        """
        check_mode("mode", mode)
        unit = dict.fromkeys(MODES, 1.0)
        ones = (1.0, 1.0, 1.0)
        one = replace(
            self,
            uncertainty=unit,
            noise=1.0,
            drift=1.0,
            performance=ones,
            form="prediction",
        )
        model = _models(one)[mode_classes(one.uncertainty)[mode]]
        gain = self.gains[mode]
        output = np.eye(3)
        direct = np.zeros((3, 3))
        if self.form == "current":
            # State: the error before the correction; what counts is the one after it.
            output = output - np.outer(gain, error_model.C)
            direct[:, 1] = -gain
            gain = model.A @ gain
        F, B = model.closed_loop(gain)
        names = {
            "inputs": ["force", "noise", "drift"],
            "outputs": ["e_x", "e_v", "e_w"],
        }
        return control.ss(
            F,
            B,
            output,
            direct,
            self.dt,
            name=f"observer_error_{mode:+d}",
            **names,
        )

    def check(self) -> Certificate:
        """Recompute the certificate from the gains, or refuse it."""
        scales = Scales(np.asarray(self.state_scale, dtype=float), self.output_scale)
        problem = Problem(scales.apply(_models(self)), self.graph, self.decay)
        gains = scales.scaled_gains(self.node_gains)
        gamma = self.gamma * self.output_scale
        proofs = (self.lyapunov, self.lyapunov_decay)
        unit = 1.0 / self.output_scale
        return certificate_of(problem, self.classes, gains, gamma, *proofs, unit)

    def _to_saved(self) -> ObserverDesign:
        # Its certificate is computed anew by who reads it.
        return replace(self, certificate=None)  # type: ignore[arg-type]

    @classmethod
    def _from_saved(cls, held: Any) -> ObserverDesign:
        return verified_design(super()._from_saved(held))

    def _summary_parts(self) -> Iterator[str | list[tuple[str, ...]]]:
        u = self.uncertainty
        length, force = self.axis.units
        yield (
            f"Switched PI observer, method {self.method!r}, memory {self.window} samples, "
            f"dt = {self.dt:g} s, {self.discretization}, {self.form} form"
        )
        yield (
            f"asked  uncertainty {u[0]:.4g} / {u[1]:.4g} / {u[-1]:.4g} {force} (modes 0, +1, -1), "
            f"noise {self.noise:.4g} {length}, drift {self.drift:.4g} {force}/sample, weights "
            + ", ".join(f"{q:.4g}" for q in self.performance)
        )
        radius = self.certificate.spectral_radius
        rows: list[tuple[str, ...]] = [
            (
                "mode",
                "L_x",
                "L_v [1/s]",
                f"G [{force}/{length}]",
                "radius",
            )
        ]
        for mode, (lx, lv, g) in self.gains.items():
            rows.append(
                (
                    signed(mode),
                    f"{lx:.6g}",
                    f"{lv:.6g}",
                    f"{g:.6g}",
                    f"{radius[mode]:.5f}",
                )
            )
        yield rows
        yield from self.certificate._summary_parts()


_WORDS = {
    "method": METHODS,
    "discretization": DISCRETIZATIONS,
    "form": FORMS,
}


#: Fields that determine the error dynamics, but for axis and sampling time.
_GIVEN = (
    *("uncertainty", "noise", "drift", "performance"),
    *("discretization", "integral_modes", "form"),
)


def _models(design: ObserverDesign) -> dict[int, ErrorModel]:
    given: dict[str, Any] = {name: getattr(design, name) for name in _GIVEN}
    return error_model.error_models(design.axis, design.dt, **given)


def design_pi_observer(
    axis: FrictionAxis,
    dt: float,
    *,
    method: str = "slack",
    uncertainty: float | Mapping[int, float] | None = None,
    noise: float | None = None,
    drift: float | None = None,
    decay: float | None = None,
    performance: Iterable[float] | None = None,
    encoder_quantum: float | None = None,
    window: int | None = None,
    pairs: Iterable[tuple[int, int]] | None = None,
    discretization: str = "zoh",
    form: str = "current",
    coulomb: CoulombMap | float | None = None,
    stick_speed: float | None = None,
    integral_modes: Iterable[int] = (0, 1, -1),
    refine: int = 0,
    solver: str = "clarabel",
) -> ObserverDesign:
    """Design a switched proportional-integral observer.

    Parameters
    ----------
    axis : FrictionAxis
        The nominal axis.
    dt : float
        Sampling time [s]; one of 0.1 s or more raises a warning.
    method : str
        "paper" (Theorem 1, corrected), "slack" (a slack matrix per mode, never worse) or "path"
        (everything indexed by the last `window` modes).
    uncertainty : float or mapping of int to float, optional
        Amplitude of the force uncertainty [N], or one for each mode.
    noise : float, optional
        Amplitude of the measurement noise [m].
    drift : float, optional
        Change of the friction error per sample [N].
    decay : float, optional
        Factor by which an initial error must at least shrink per sample; 1 asks for no rate.
    performance : (float, float, float), optional
        Weights of the errors of position, velocity and friction in z.
    encoder_quantum : float, optional
        Resolution of the position sensor [m], for the default of `noise`.
    window : int, optional
        Memory of past modes [samples]: "path" 4 by default.
    pairs : iterable of (int, int), optional
        Allowed changes of mode.  Default: all.
    discretization : str
        "zoh", exact for held input at any sampling time, or "euler", the paper's.
    form : str
        "current": the estimate at a sample uses its reading; or "prediction", the paper's.
    coulomb : CoulombMap or float, optional
        The observer's own Coulomb levels.  Default: those of `axis`.
    stick_speed : float, optional
        The observer's own stick velocity.  Default: half that of `axis`.
    integral_modes : iterable of int
        Modes in which the integral term acts on the velocity estimate.
    refine : int
        Further solutions, none of which raises gamma.  Not for "paper".
    solver : str
        "clarabel", or "scs" (slower, less accurate).

    Notes
    -----
    gamma bounds the energy of z by that of all disturbances, each over its amplitude, for every
    allowed sequence of modes that observer and plant share.  The page on the observer says which
    effects it knows, and how defaults follow from Coulomb level and encoder; an ObserverWarning
    names effects that it leaves out.  A ValueError says so if a mode is not detectable, or the
    specifications cannot be met.

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=1.0, viscous=0.4, coulomb=8.0,
    ...                         stick_rate=500.0, stick_speed=1e-4)
    >>> design = dfc.design_pi_observer(
    ...     axis, dt=1e-3, uncertainty=1.0, noise=1e-4, drift=0.0, decay=0.995,
    ...     performance=(0.0, 1.0, 0.0), form="prediction", discretization="euler")
    >>> print(f"{design.gamma:.4f}")
    0.0160
    """
    one_of("method", method, METHODS)
    one_of("solver", solver, SOLVERS)
    if window is None:
        window = DEFAULT_WINDOW[method]
    if isinstance(window, bool) or window not in range(1, 65):
        raise ValueError(f"window must be a whole number of samples from 1 to 64, got {window!r}")
    if method in ("paper", "slack") and window != 1:
        raise ValueError(f"window = {window} has no meaning for method {method!r}: use 'path'")
    if whole("refine", refine, least=0) and method == "paper":
        raise ValueError(f"refine must be 0 for 'paper', which has no rounds, got {refine!r}")
    one_of("form", form, FORMS)
    own = own_axis(axis, coulomb, stick_speed)
    dt = sampling_time(dt)
    error_model.check_sampling(own, dt, discretization)
    if not isinstance(integral_modes, Iterable):
        raise ValueError(f"integral_modes must hold modes such as (1, -1), got {integral_modes!r}")
    modes = tuple(integral_modes)
    for mode in modes:
        check_mode("mode", mode)
    weights = default_weights(
        own,
        dt,
        uncertainty=uncertainty,
        noise=noise,
        drift=drift,
        decay=decay,
        performance=performance,
        encoder_quantum=encoder_quantum,
    )
    given: dict[str, Any] = {name: getattr(weights, name) for name in _GIVEN[:4]}
    given |= {
        "discretization": discretization,
        "integral_modes": modes,
        "form": form,
    }
    models = error_model.error_models(own, dt, **given)
    classes = mode_classes(weights.uncertainty)
    scales = scales_of(models, weights)
    error_model.check_detectable(models, scales.state, weights.decay)
    allowed = allowed_pairs(classes, pairs)
    graph = window_graph(allowed, int(window))
    problem = Problem(scales.apply(models), graph, weights.decay)
    candidate, gamma = certified_solution(
        problem, paper=method == "paper", refine=refine, solver=solver
    )
    gains = scales.physical_gains(candidate.gains)
    proofs = candidate.lyapunov, candidate.lyapunov_decay
    own_gains = scales.scaled_gains(gains)
    unit = 1.0 / scales.output
    certificate = certificate_of(problem, classes, own_gains, gamma, *proofs, unit)
    quantum = np.sqrt(12.0) * weights.noise if encoder_quantum is None else encoder_quantum
    return ObserverDesign(
        axis=own,
        dt=dt,
        method=method,
        window=int(window),
        encoder_quantum=float(quantum),
        decay=weights.decay,
        graph=graph,
        node_gains=gains,
        gamma=certificate.gamma,
        state_scale=scales.state,
        output_scale=scales.output,
        lyapunov=candidate.lyapunov,
        lyapunov_decay=candidate.lyapunov_decay,
        certificate=certificate,
        **given,
    )


def verified_design(design: ObserverDesign) -> ObserverDesign:
    """A design of a file, every part in its range, with its certificate computed anew."""
    _check_graph(design.graph)
    _check_arrays(design)
    for name in ("encoder_quantum", "gamma", "output_scale"):
        positive(name, getattr(design, name), zero=name == "encoder_quantum")
    for name, known in _WORDS.items():
        one_of(name, getattr(design, name), known)
    for mode in design.integral_modes:
        one_of("integral_modes", mode, MODES)
    labels = design.graph.labels
    if set(labels) != set(mode_classes(design.uncertainty).values()):
        raise ValueError(f"graph.labels do not fit the classes of the modes: {labels!r}")
    error_model.check_sampling(design.axis, design.dt, design.discretization)
    default_weights(
        design.axis,
        design.dt,
        uncertainty=design.uncertainty,
        noise=design.noise,
        drift=design.drift,
        decay=design.decay,
        performance=design.performance,
    )
    whole("window", design.window)
    return replace(design, certificate=design.check())


def _check_graph(graph: ModeGraph) -> None:
    """Refuse a graph in which a change of mode leads nowhere."""
    nodes = len(graph.labels)
    if len(graph.names) != nodes or not all(0 <= k < nodes for edge in graph.edges for k in edge):
        raise ValueError("graph does not fit together")
    following: dict[int, set[int]] = {}
    for node, label in enumerate(graph.labels):
        after = {graph.labels[j] for i, j in graph.edges if i == node}
        if label not in after or following.setdefault(label, after) != after:
            raise ValueError(f"graph.edges: changes of mode are missing after node {node}")


def _check_arrays(design: ObserverDesign) -> None:
    """Refuse arrays of another shape, or with what is no number."""
    nodes = len(design.graph.labels)
    shapes: dict[str, tuple[int, ...]] = {
        "node_gains": (nodes, 3),
        "state_scale": (3,),
        "lyapunov": (nodes, 3, 3),
        "lyapunov_decay": (nodes, 3, 3),
    }
    for name, shape in shapes.items():
        array = getattr(design, name)
        if array.shape != shape or array.dtype.kind != "f" or not np.all(np.isfinite(array)):
            raise ValueError(f"{name} must hold numbers in shape {shape}")
    if not np.all(design.state_scale > 0.0):
        raise ValueError(f"state_scale must be positive, got {design.state_scale.tolist()!r}")
