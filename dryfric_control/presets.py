"""Ready axes, and the experiment the paper runs on its device.

The paper prints no parameter values: those here are ours, chosen to be those
of a small geared drive, and none of them is measured.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from dryfric_control.arrays import Floats
from dryfric_control.checks import instance, positive
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.model.friction import CoulombMap, Stribeck
from dryfric_control.model.loops import PositionController
from dryfric_control.observer.closed_loop import (
    ObservedLoop,
    filter_reference,
    simulate_observed_loop,
)
from dryfric_control.observer.design import ObserverDesign, design_pi_observer
from dryfric_control.observer.monte_carlo import MonteCarlo, monte_carlo

#: Travel of the clutch actuator [increments].
TRAVEL = 10_000.0
#: Increment of its encoder, the unit of position.
QUANTUM = 1.0
#: Corner frequency of the low-pass on the reference (paper, section 5) [rad/s].
CORNER = 20.0
#: Bandwidth of the loop [rad/s].
BANDWIDTH = 20.0
#: Where the observer believes the axis to be at the start (paper, section 5).
FIRST_ESTIMATE = 1000.0
_FIRST = {"quantum": QUANTUM, "xhat0": FIRST_ESTIMATE}
_UNITS = ("inc", "N m")


def _over_travel(*coefficients: float) -> tuple[float, ...]:
    """Coefficients of a polynomial in x from those of one in x / TRAVEL."""
    return tuple(c / TRAVEL**power for power, c in enumerate(coefficients))


def clutch_actuator() -> FrictionAxis:
    """Motor, rack and springs: dry friction that depends on position.

    Notes
    -----
    Position in encoder increments, force as torque at the motor [N m]. An encoder of 4000
    increments a turn and an inertia of 1.9e-4 kg m^2 make 3e-7 N m s^2 per increment; the travel is
    two and a half turns. Two springs through a bevel leave a torque level between 0.14 and 0.22 N m
    that varies along the travel and differs between the directions. Breakaway lies 30 % above it.
    Stribeck and stick velocity are equal, as the paper advises at first: 150 increments a second.

    Examples
    --------
    >>> from dryfric_control import presets
    >>> axis = presets.clutch_actuator()
    >>> axis.coulomb([0.0, 5000.0, 10000.0], +1).round(4).tolist()
    [0.2, 0.205, 0.22]
    """
    return FrictionAxis(
        mass=3e-7,
        viscous=6e-7,
        coulomb=CoulombMap(
            plus=_over_travel(0.20, 0.10, -0.28, 0.20), minus=_over_travel(0.16, 0.18, -0.22, 0.02)
        ),
        stribeck=Stribeck(excess=0.3, speed=150.0),
        stick_speed=150.0,
        stick_rate=500.0,
        travel=(0.0, TRAVEL),
        name="clutch actuator",
        units=_UNITS,
    )


def clutch_observer_axis() -> FrictionAxis:
    """The clutch actuator in the model of its observer.

    As `clutch_actuator` with other Coulomb maps (paper, Fig. 7: 6 to 15 % too low forwards, 6 to
    21 % too high backwards), half the stick velocity and no Stribeck peak.

    Examples
    --------
    >>> from dryfric_control import presets
    >>> axis = presets.clutch_observer_axis()
    >>> axis.stribeck is None, axis.stick_speed
    (True, 75.0)
    """
    plant = clutch_actuator()
    return plant.replace(
        coulomb=CoulombMap(
            plus=_over_travel(0.17, 0.10, -0.16, 0.08), minus=_over_travel(0.19, 0.10, -0.12, 0.00)
        ),
        stribeck=None,
        stick_speed=0.5 * plant.stick_speed,
        name="clutch_observer",
    )


def clutch_observer(dt: float = 1e-3, **options: Any) -> ObserverDesign:
    """Observer of the clutch actuator, designed on a wrong axis.

    Parameters
    ----------
    dt : float, optional
        Sampling time [s].
    **options
        For `design_pi_observer`.

    Examples
    --------
    >>> from dryfric_control import presets
    >>> presets.clutch_observer().axis.stick_speed
    75.0
    """
    axis = clutch_observer_axis()
    settings: dict[str, Any] = {"encoder_quantum": QUANTUM, "stick_speed": axis.stick_speed}
    return design_pi_observer(axis, dt, **(settings | options))


def crawl_and_steps(dt: float = 1e-3, duration: float = 12.0) -> tuple[Floats, Floats]:
    """Reference of the paper's closed loop: crawls, then steps.

    Parameters
    ----------
    dt, duration : float, optional
        Sampling time and length [s].

    Returns
    -------
    time, reference : ndarray, shape (n,)
        Time [s], and position before the low-pass [increments]: for 4 s it crawls up, back and
        up again at 225 to 300 increments a second, slow enough for stick-slip; after that it
        jumps between 7000 and 3000 increments with a period of 2 s.

    Examples
    --------
    >>> from dryfric_control import presets
    >>> time, reference = presets.crawl_and_steps(dt=0.5)
    >>> reference[[3, 9, 11]].tolist()
    [375.0, 7000.0, 3000.0]
    """
    dt = positive("dt", dt, unit="s")
    duration = positive("duration", duration, unit="s")
    time = np.asarray(np.arange(round(duration / dt)) * dt, dtype=float)
    crawl = np.interp(time, [0.25, 1.5, 2.5, 4.0], [0.0, 375.0, 150.0, 600.0])
    steps = np.where((time - 4.0) % 2.0 < 1.0 - 0.5 * dt, 7000.0, 3000.0)
    return time, np.where(time < 4.0 - 0.5 * dt, crawl, steps)


def clutch_controller(dt: float = 1e-3) -> PositionController:
    """Position controller that is slow enough to stick and slip.

    Parameters
    ----------
    dt : float, optional
        Sampling time [s].

    Examples
    --------
    >>> from dryfric_control import presets
    >>> presets.clutch_controller().dt
    0.001
    """
    return PositionController.from_bandwidth(clutch_actuator(), BANDWIDTH, dt)


def clutch_experiment(
    design: ObserverDesign | None = None, *, switching: str = "reading", duration: float = 12.0
) -> ObservedLoop:
    """The closed loop of the paper's section 5.

    The plant starts at rest at 0, its observer at 1000 increments.

    Parameters
    ----------
    design : ObserverDesign, optional
        The observer.  Default: `clutch_observer`.
    switching : {"reading", "paper", "filippov"}, optional
        Rule of the observer's mode, see `pi_observer`.
    duration : float, optional
        Length [s].

    Examples
    --------
    >>> from dryfric_control import presets
    >>> run = presets.clutch_experiment(duration=2.0)
    >>> bool(0.0 < run.estimate.y[0, 0] < 100.0)  # after the first reading
    True
    """
    design, controller, reference = _parts_of_loop(design, duration)
    options: dict[str, Any] = {"bandwidth": CORNER, "switching": switching, **_FIRST}
    return simulate_observed_loop(clutch_actuator(), controller, design, reference, **options)


def _parts_of_loop(
    design: ObserverDesign | None, duration: float
) -> tuple[ObserverDesign, PositionController, Floats]:
    """Observer, controller and reference of the closed loop."""
    design = clutch_observer() if design is None else design
    instance("design", design, ObserverDesign, "made by dfc.design_pi_observer")
    return design, clutch_controller(design.dt), crawl_and_steps(design.dt, duration)[1]


def clutch_monte_carlo(
    design: ObserverDesign | None = None, *, runs: int = 500, duration: float = 12.0, **options: Any
) -> MonteCarlo:
    """The same closed loop with plants that differ at random.

    Parameters
    ----------
    design, runs, duration : optional
        As for `clutch_experiment`; number of plants.
    **options
        For `monte_carlo`: estimators, seed, store, jobs, progress.

    Examples
    --------
    >>> from dryfric_control import presets
    >>> presets.clutch_monte_carlo(runs=2, duration=0.5, progress=False).scores["paper"].shape
    (2, 5)
    """
    design, controller, wanted = _parts_of_loop(design, duration)
    options = {"stribeck_speed": 150.0, "runs": runs, **_FIRST, **options}
    return monte_carlo(design, controller, filter_reference(wanted, CORNER, design.dt), **options)
