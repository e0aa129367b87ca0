"""A continuous controller as a sampled block, which connects to a sampled axis."""

from __future__ import annotations

from typing import Any

import control as ct
import numpy as np
from scipy.integrate import solve_ivp

from dryfric_control.arrays import Floats
from dryfric_control.checks import describe_value, one_of, positive, string

#: How a linear system is discretised, by the names of python-control.
METHODS = ("tustin", "zoh", "foh", "euler", "backward_diff")
# Relative tolerance with which a nonlinear controller is integrated inside a sample.
_TOLERANCE = 1e-9


def sampled(
    controller: Any, dt: float, method: str | None = None, name: str | None = None
) -> ct.NonlinearIOSystem:
    """A controller as a block of the sampling time of the axis.

    python-control connects systems of one time base only, and `axis_block` is sampled.

    Parameters
    ----------
    controller : control.StateSpace, control.TransferFunction or control.NonlinearIOSystem
        A continuous system; one of this sampling time, or of an unspecified one, is taken as it is.
    dt : float
        Sampling time [s], that of the axis block.
    method : {"tustin", "zoh", "foh", "euler", "backward_diff"}, optional
        How a linear system is discretised.  Default: "tustin".  A nonlinear one holds its input
        over a sample, "zoh", and is integrated inside it.
    name : str, optional
        Default: that of the controller.

    Returns
    -------
    control.StateSpace or control.NonlinearIOSystem
        A sampled system whose inputs, outputs and states have the names of the controller's.

    Raises
    ------
    ValueError
        If the controller has another sampling time, cannot be sampled (a pure derivative), or is
        no system.

    Examples
    --------
    >>> import control as ct
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    >>> lead = ct.tf([40.0, 400.0], [0.005, 1.0], inputs="e", outputs="u", name="lead")
    >>> parts = [ct.summing_junction(["r", "-x"], "e"), dfc.sampled(lead, 1e-3),
    ...          dfc.axis_block(axis, 1e-3)]
    >>> loop = ct.interconnect(parts, inputs=["r"], outputs=["x"], check_unused=False)
    >>> loop.dt
    0.001
    """
    dt = positive("dt", dt, unit="s")
    if method is not None:
        one_of("method", method, METHODS)
    if not isinstance(controller, (ct.TransferFunction, ct.NonlinearIOSystem)):
        raise ValueError(
            "controller must be a control.StateSpace, TransferFunction or NonlinearIOSystem, got "
            f"{describe_value(controller)}"
        )
    name = string("name", name or controller.name)
    base = controller.dt
    if base is not None and base is not True and base != 0 and not np.isclose(base, dt, rtol=1e-9):
        raise ValueError(
            f"controller {controller.name!r} has a sampling time of {base:g} s, not dt = {dt:g} s: "
            "give the continuous controller, or sample the axis with it"
        )
    if isinstance(controller, (ct.TransferFunction, ct.StateSpace)):
        return _linear(controller, dt, method or "tustin", name)
    if method not in (None, "zoh"):
        raise ValueError(
            f"method = {method!r} is for linear systems, and {controller.name!r} is nonlinear: its "
            'input is held over a sample, method="zoh"'
        )
    return _as_nonlinear(controller, dt, name)


def _linear(controller: Any, dt: float, method: str, name: str) -> ct.StateSpace:
    names = {"inputs": controller.input_labels, "outputs": controller.output_labels}
    system = controller
    if isinstance(controller, ct.TransferFunction):
        above = [np.trim_zeros(one, "f").size for row in controller.num for one in row]
        below = [np.trim_zeros(one, "f").size for row in controller.den for one in row]
        if any(a > b for a, b in zip(above, below, strict=True)):
            raise ValueError(
                f"controller {controller.name!r} differentiates without a filter, which no "
                "sampled system does: divide by (T s + 1) with T of a few dt"
            )
        system = ct.ss(controller)
    else:
        names["states"] = controller.state_labels
    if system.isdtime(strict=True) or system.nstates == 0:
        return ct.ss(system.A, system.B, system.C, system.D, dt, name=name, **names)
    found = ct.sample_system(system, dt, method)
    return ct.ss(found.A, found.B, found.C, found.D, dt, name=name, **names)


def _as_nonlinear(controller: Any, dt: float, name: str) -> ct.NonlinearIOSystem:
    discrete = controller.isdtime(strict=True)

    def update(t: float, x: Any, u: Any, params: Any) -> Floats:
        if discrete:
            return np.asarray(controller.dynamics(t, x, u, params))
        run = solve_ivp(
            lambda tau, y: controller.dynamics(tau, y, u, params), (t, t + dt), x, "LSODA",
            rtol=_TOLERANCE, atol=1e-3 * _TOLERANCE,
        )  # fmt: skip
        if run.status < 0:
            raise RuntimeError(f"{name!r} cannot be integrated over the sample at {t:g} s")
        return np.asarray(run.y[:, -1])

    def output(t: float, x: Any, u: Any, params: Any) -> Floats:
        return np.asarray(controller.output(t, x, u, params))

    return ct.NonlinearIOSystem(
        update if controller.nstates else None, output, dt=dt, name=name,
        inputs=controller.input_labels, outputs=controller.output_labels,
        states=controller.state_labels or None, params=dict(controller.params),
    )  # fmt: skip
