"""The axis and its loop as sampled python-control blocks.

Discrete and continuous blocks do not interconnect in python-control, so the plant is sampled too:
it is integrated inside its own step.  Signals connect by name: r -> `reference_filter` -> xref ->
controller -> u -> axis -> x -> `encoder` -> y -> controller.
"""

from __future__ import annotations

from typing import Any

import control as ct
import numpy as np
import scipy.signal

from dryfric_control.arrays import Floats
from dryfric_control.checks import instance, positive, string
from dryfric_control.compiled import axis_step
from dryfric_control.compiled.loop import encode
from dryfric_control.model.axis import MODE_LABELS, FrictionAxis, check_pace
from dryfric_control.model.block import Block
from dryfric_control.model.loops import PositionController
from dryfric_control.order import check_bandwidth_and_dt, check_quantum_and_dt


def axis_block(axis: FrictionAxis, dt: float, name: str | None = None) -> ct.NonlinearIOSystem:
    """The switched axis as one sampled block.

    A continuous controller connects to it as ``dfc.sampled(controller, dt)``: python-control
    refuses systems of unlike time bases ("incompatible timebases").

    Parameters
    ----------
    axis : FrictionAxis
    dt : float
        Sampling time [s].
    name : str, optional
        Name of the block.  Default: the axis' name.

    Returns
    -------
    control.NonlinearIOSystem
        Input u, held over the sample; outputs x, v, F, mode; states x, v, mode.  Effects with a
        memory (input delay, actuator lag, or states of their own) add states.

    Notes
    -----
    Give `control.input_output_response` exactly the samples ``np.arange(n) * dt``.

    Examples
    --------
    >>> import control as ct
    >>> import numpy as np
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    >>> t = np.arange(200) * 1e-3
    >>> resp = ct.input_output_response(dfc.axis_block(axis, 1e-3), t, 10.0 + 0 * t)
    >>> float(resp.outputs[3, -1])
    1.0
    """
    instance("axis", axis, FrictionAxis)
    dt = positive("dt", dt, unit="s")
    check_pace(axis, dt)
    arrays = axis.arrays(dt)
    size = arrays.states if any(effect.remembers for effect in axis.effects) else 3

    def full(x: Any) -> Floats:
        memory = np.zeros(arrays.memory)
        memory[:size] = x
        return memory

    def update(t: float, x: Any, u: Any) -> Floats:
        memory = full(x)
        arrays.step(memory, t, dt, u[0])
        return memory[:size]

    def output(t: float, x: Any, u: Any) -> Floats:
        memory = full(x)
        return np.array(
            [arrays.encoder_reading(memory, t), *arrays.outputs_at(memory, t, dt, u[0])]
        )

    states = ["x", "v", "mode", "rest", "lagged", "deflection", "offset", "slip"]
    states += [f"u{i}" for i in range(2 * arrays.integers[axis_step.N_HISTORY])]
    for own, effect in axis.effective().named_effects().items():
        states += [f"{own}_{state}" for state in effect.states]
    return Block.from_functions(
        update, output, "u", "x v F mode", states[:size], dt, name or axis.name
    )


def supervisor(axis: FrictionAxis, dt: float, name: str = "supervisor") -> ct.NonlinearIOSystem:
    """The switching rule (paper, Figure 2) as a sampled block.

    Parameters
    ----------
    axis : FrictionAxis
    dt : float
        Sampling time [s].
    name : str, optional

    Returns
    -------
    control.NonlinearIOSystem
        Inputs u, x, v; output mode (0 stuck, +1, -1 sliding) under the new input; state mode, at
        the end of the sample, so that a switch inside is not missed.  Effects with a memory
        (delay, lag) are refused: u, x and v do not determine their force.

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    >>> rule = dfc.supervisor(axis, dt=1e-3)
    >>> float(rule.output(0.0, [0.0], [9.0, 0.0, 0.0])[0])
    1.0
    """
    dt = positive("dt", dt, unit="s")
    _require_memoryless(axis, "supervisor")
    arrays = axis.arrays(dt)

    def memory(state: Any, u: Any) -> Floats:
        return np.array([u[1], u[2], state[0], 0.0, 0.0])

    def update(t: float, x: Any, u: Any) -> Floats:
        after = memory(x, u)
        arrays.step(after, t, dt, u[0])
        return after[2:3]

    def output(t: float, x: Any, u: Any) -> Floats:
        return np.array(arrays.outputs_at(memory(x, u), t, dt, u[0])[2:], dtype=float)

    return Block.from_functions(update, output, "u x v", "mode", ["mode"], dt, name)


def _mode_flow(axis: FrictionAxis, index: int, dt: float) -> ct.NonlinearIOSystem:
    """One sample that begins in one mode; zeros while another is active."""
    arrays = axis.arrays(dt)

    def output(t: float, x: Any, u: Any) -> Floats:
        force, position, speed, active = u
        if round(active) != index:
            return np.zeros(4)
        # An axis that breaks away against its remaining velocity loses that velocity.
        speed = 0.0 if index * speed < 0.0 else speed
        memory = np.array([position, speed, float(index), 0.0, 0.0])
        now, friction, _ = arrays.outputs_at(memory, t, dt, force)
        arrays.step(memory, t, dt, force)
        return np.array([memory[0], memory[1], now, friction])

    name = MODE_LABELS[index]
    return Block.from_functions(None, output, "u x v mode", "x_next v_next v_now F", (), dt, name)


def switched_axis(
    axis: FrictionAxis, dt: float, name: str | None = None
) -> ct.InterconnectedSystem:
    """The switched axis, put together from modes and supervisor.

    Parameters
    ----------
    axis : FrictionAxis
    dt : float
        Sampling time [s].
    name : str, optional
        Name of the system.  Default: the axis' name.

    Returns
    -------
    control.InterconnectedSystem
        Input u; outputs x, v, F, mode; subsystems ``stuck``, ``plus``, ``minus`` (each the motion
        over one sample that begins in its mode), ``supervisor`` and ``state``.  The numbers are
        those of `axis_block`, which is far faster, and takes effects with a memory too.

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    >>> [part.name for part in dfc.switched_axis(axis, 1e-3).syslist]
    ['state', 'supervisor', 'stuck', 'plus', 'minus']
    """
    dt = positive("dt", dt, unit="s")
    _require_memoryless(axis, "switched_axis")
    name = string("name", name or axis.name)
    zero = np.zeros((2, 2))
    one = np.eye(2)
    names = {"inputs": ["x_next", "v_next"], "outputs": ["x", "v"], "states": ["x", "v"]}
    state = ct.ss(zero, one, one, zero, dt, name="state", **names)
    modes = [_mode_flow(axis, index, dt) for index in MODE_LABELS]

    def of_modes(signal: str) -> list[str]:
        return [f"{label}.{signal}" for label in MODE_LABELS.values()]

    connections = [[f"state.{signal}", *of_modes(signal)] for signal in ("x_next", "v_next")]
    for signal, source in (("x", "state.x"), ("v", "state.v"), ("mode", "supervisor.mode")):
        connections += [[entry, source] for entry in of_modes(signal)]
    connections += [["supervisor.x", "state.x"], ["supervisor.v", "state.v"]]
    return ct.interconnect(
        [state, supervisor(axis, dt), *modes],
        connections=connections,
        inplist=[["supervisor.u", *of_modes("u")]],
        outlist=["state.x", of_modes("v_now"), of_modes("F"), "supervisor.mode"],
        inputs=["u"],
        outputs=["x", "v", "F", "mode"],
        dt=dt,
        name=name,
    )


def encoder(quantum: float, dt: float, name: str = "encoder") -> ct.NonlinearIOSystem:
    """Position encoder: the nearest whole number of increments.

    Parameters
    ----------
    quantum : float
        Increment [m]; 0 measures exactly.
    dt : float
        Sampling time [s].
    name : str, optional

    Returns
    -------
    control.NonlinearIOSystem
        Input x; output y.

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> reading = dfc.encoder(quantum=0.5, dt=1e-3).output(0.0, [], [1.3])
    >>> float(reading[0])
    1.5
    """
    quantum = positive("quantum", quantum, unit="m", zero=True)
    dt = positive("dt", dt, unit="s")
    check_quantum_and_dt("quantum", quantum, dt)
    return Block.from_functions(
        None, lambda t, x, u: np.array([encode(u[0], quantum)]), "x", "y", (), dt, name
    )


def reference_filter(
    bandwidth: float, dt: float, order: int = 2, name: str = "reference_filter"
) -> ct.StateSpace:
    """Butterworth low-pass for the reference (paper, section 5).

    Parameters
    ----------
    bandwidth : float
        Corner frequency, below that of Nyquist [rad/s]; the paper uses 20.
    dt : float
        Sampling time [s].
    order : int, optional
    name : str, optional

    Returns
    -------
    control.StateSpace
        Input r; output xref; unit gain at rest.

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> round(float(dfc.reference_filter(20.0, 1e-3).dcgain()), 9)
    1.0
    """
    bandwidth = positive("bandwidth", bandwidth, unit="rad/s")
    dt = positive("dt", dt, unit="s")
    check_bandwidth_and_dt(bandwidth, dt)
    string("name", name)
    if isinstance(order, bool) or order not in range(1, 9):
        raise ValueError(f"order must be a whole number from 1 to 8, got {order!r}")
    if bandwidth >= np.pi / dt:
        raise ValueError(
            f"bandwidth {bandwidth:g} rad/s is not below the Nyquist frequency "
            f"{np.pi / dt:g} rad/s: lower it or dt"
        )
    zeros, poles, gain = scipy.signal.butter(order, bandwidth, output="zpk", fs=2.0 * np.pi / dt)
    a, b, c, d = scipy.signal.zpk2ss(zeros, poles, gain)
    return ct.ss(a, b, c, d, dt, inputs=["r"], outputs=["xref"], name=name)


def position_controller(
    axis: FrictionAxis,
    bandwidth: float,
    dt: float,
    limit: float | None = None,
    name: str = "controller",
) -> ct.NonlinearIOSystem:
    """Position controller of given bandwidth as a sampled block.

    Parameters
    ----------
    axis, bandwidth, dt, limit
        As for `PositionController.from_bandwidth`, which has the gains.
    name : str, optional

    Returns
    -------
    control.NonlinearIOSystem
        Inputs xref, y; output u.

    Examples
    --------
    >>> import control as ct
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    >>> parts = [dfc.reference_filter(20.0, 1e-3), dfc.position_controller(axis, 5.0, 1e-3),
    ...          dfc.axis_block(axis, 1e-3), dfc.encoder(1e-6, 1e-3)]
    >>> loop = ct.interconnect(parts, inputs=["r"], outputs=["x", "v", "F", "mode", "u"])
    >>> loop.ninputs, loop.noutputs
    (1, 5)
    """
    return PositionController.from_bandwidth(axis, bandwidth, dt, limit).block(name)


def _require_memoryless(axis: FrictionAxis, what: str) -> None:
    instance("axis", axis, FrictionAxis)
    for effect in axis.effects:
        if effect.remembers or effect.action == "reading":
            why = "remembers the past" if effect.remembers else "acts on the encoder"
            raise ValueError(
                f"{what} has no place for the effect {effect.slug!r}, which {why}: "
                "take axis_block(axis, dt)"
            )
