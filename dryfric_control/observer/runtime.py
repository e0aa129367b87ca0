"""The functions of the switched PI observer: each calls the method of the design."""

from __future__ import annotations

from typing import Any

import control as ct
from numpy.typing import ArrayLike

from dryfric_control.checks import instance
from dryfric_control.observer.base import ObserverResponse, Stepper
from dryfric_control.observer.design import ObserverDesign


def observe(
    design: ObserverDesign,
    u: Any,
    y: ArrayLike | None = None,
    *,
    xhat0: float | None = None,
    vhat0: float = 0.0,
    what0: float = 0.0,
    switching: str = "reading",
    encoder_quantum: float | None = None,
) -> ObserverResponse:
    """Run the observer over a whole record, compiled.

    Parameters
    ----------
    design : ObserverDesign
    u : array_like, shape (n,), or Record
        Drive force at the samples [N]; a record, whose step and units must be those of the design,
        brings `y`, and its known load, with it.
    y : array_like, shape (n,), optional
        Measured position at the samples [m].
    xhat0 : float, optional
        First estimate of the position [m].  Default: the first reading.
    vhat0, what0 : float, optional
        First velocity [m/s] and integral term [N].
    switching, encoder_quantum
        As for `pi_observer`.

    Returns
    -------
    ObserverResponse
        Outputs xhat, vhat, Fhat, what, mode, each of shape (n,).

    Examples
    --------
    >>> import numpy as np
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    >>> design = dfc.design_pi_observer(axis, dt=1e-3, encoder_quantum=1e-5)
    >>> u = 12.0 * np.sin(np.arange(4000) * 3e-3)
    >>> plant = axis.simulate(u, dt=1e-3)
    >>> estimate = dfc.observe(design, u, plant.y[0], encoder_quantum=1e-5)
    >>> bool(np.mean(estimate.mode != plant.mode) < 0.02)
    True
    """
    instance("design", design, ObserverDesign, "made by dfc.design_pi_observer")
    return design.run(
        u,
        y,
        xhat0=xhat0,
        vhat0=vhat0,
        what0=what0,
        switching=switching,
        encoder_quantum=encoder_quantum,
    )


def pi_observer(
    design: ObserverDesign,
    *,
    switching: str = "reading",
    encoder_quantum: float | None = None,
    name: str = "observer",
) -> ct.NonlinearIOSystem:
    """The switched PI observer as a sampled block.

    Parameters
    ----------
    design : ObserverDesign
        The observer: its gains, its own Coulomb maps, effects and stick velocity.
    switching : {"reading", "paper", "filippov"}, optional
        Rule of the mode, see Notes.
    encoder_quantum : float, optional
        Increment of the position sensor [m], by which "reading" detects motion.  Default: the
        design's.
    name : str, optional

    Returns
    -------
    control.NonlinearIOSystem
        Inputs u, y; outputs xhat, vhat, Fhat, what, mode.  The first three states are xhat, vhat,
        what; the others start at zero.  `observe` is far faster.

    Notes
    -----
    ``switching="reading"``, the default, lets the measurement decide the mode, "paper" the printed
    automaton, "filippov" the same completed as in `FrictionAxis`; the page on the observer has the
    equations and the rules.  None can distinguish creeping below an increment per few samples from
    rest.

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    >>> block = dfc.pi_observer(dfc.design_pi_observer(axis, dt=1e-3))
    >>> block.input_labels, block.output_labels
    (['u', 'y'], ['xhat', 'vhat', 'Fhat', 'what', 'mode'])
    """
    instance("design", design, ObserverDesign, "made by dfc.design_pi_observer")
    return design.block(name, switching=switching, encoder_quantum=encoder_quantum)


class ObserverStepper(Stepper):
    """The observer sample by sample, for your own loop.

    Parameters
    ----------
    design : ObserverDesign
    xhat0, vhat0, what0, switching, encoder_quantum
        As for `observe`.

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    >>> design = dfc.design_pi_observer(axis, dt=1e-3)
    >>> observer = dfc.observer.ObserverStepper(design, encoder_quantum=1e-5)
    >>> observer.step(u=5.0, y=0.0)
    Estimate(x=0.0, v=0.0, F=5.0, w=0.0, mode=0)
    """

    def __init__(
        self,
        design: ObserverDesign,
        *,
        xhat0: float | None = None,
        vhat0: float = 0.0,
        what0: float = 0.0,
        switching: str = "reading",
        encoder_quantum: float | None = None,
    ) -> None:
        instance(
            "design",
            design,
            ObserverDesign,
            "made by dfc.design_pi_observer",
        )
        super().__init__(
            design,
            xhat0=xhat0,
            vhat0=vhat0,
            what0=what0,
            switching=switching,
            encoder_quantum=encoder_quantum,
        )
        self.design = design
