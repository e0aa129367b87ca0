"""How the estimate holds up when the plant is not the nominal one."""

from __future__ import annotations

import functools
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import astuple, dataclass, fields
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from dryfric_control._version import __version__
from dryfric_control.arrays import Floats
from dryfric_control.checks import (
    finite,
    instance,
    positive,
    samples,
    whole,
)
from dryfric_control.drawing import DASHES, legend_above, panels
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.model.friction import Stribeck
from dryfric_control.model.loops import LoopController, simulate_loop
from dryfric_control.model.profiles import MotionProfile
from dryfric_control.observer.certificate import Certificate
from dryfric_control.observer.closed_loop import (
    EstimateScore,
    check_loop,
    score_estimate,
)
from dryfric_control.observer.design import ObserverDesign
from dryfric_control.observer.runtime import observe
from dryfric_control.store.batch import fingerprint, run_batch
from dryfric_control.text import Result

FIGURES = tuple(field.name for field in fields(EstimateScore))


@dataclass(frozen=True)
class Mismatch:
    """How one plant differs from the nominal axis: ratios of true to nominal."""

    plus: float  # Coulomb level forwards
    minus: float  # backwards
    mass: float
    excess: float  # Stribeck excess of the plant; the observer knows none
    stick_ratio: float  # stick velocity of the observer over that of the plant

    @classmethod
    def draw(cls, rng: np.random.Generator) -> Mismatch:
        """Uniform: levels 20 % off, mass 15 %, excess up to 60 %, stick velocities 0.3 to 1."""
        low = (0.8, 0.8, 0.85, 0.0, 0.3)
        high = (1.2, 1.2, 1.15, 0.6, 1.0)
        return cls(*rng.uniform(low, high).tolist())

    def plant(
        self,
        design: ObserverDesign,
        axis: FrictionAxis,
        stribeck_speed: float | None,
    ) -> FrictionAxis:
        """The plant that differs in this way from an axis; without a Stribeck velocity no peak."""
        return axis.replace(
            mass=self.mass * axis.mass,
            coulomb=axis.coulomb.scaled(self.plus, self.minus),
            stribeck=None if stribeck_speed is None else Stribeck(self.excess, stribeck_speed),
            stick_speed=design.axis.stick_speed / self.stick_ratio,
            name="plant",
        )


class Estimator(Protocol):
    """Anything that estimates from a record of drive and reading."""

    def estimate(self, u: Floats, y: Floats, xhat0: float = 0.0) -> Floats:
        """Rows xhat, vhat, Fhat, what, mode, shape (5, n)."""
        ...


@dataclass(frozen=True)
class SwitchedEstimator:
    """The switched PI observer as one of several estimators, see `pi_observer`."""

    design: ObserverDesign
    switching: str = "reading"
    encoder_quantum: float | None = None

    def estimate(self, u: Floats, y: Floats, xhat0: float = 0.0) -> Floats:
        """Rows xhat, vhat, Fhat, what, mode of a run started at `xhat0`."""
        rule = self.switching
        quantum = self.encoder_quantum
        run = observe(
            self.design,
            u,
            y,
            xhat0=xhat0,
            switching=rule,
            encoder_quantum=quantum,
        )
        return np.asarray(run.y)


@dataclass(frozen=True, repr=False)
class MonteCarlo(Result):
    """Scores of several estimators over random mismatches."""

    mismatches: tuple[Mismatch, ...]
    scores: dict[str, Floats]  # shape (n, 5), columns as in `EstimateScore`
    unit: str = "m"  # of position
    limit: float = np.inf  # position error from which on an estimate counts as diverged

    @property
    def diverged(self) -> dict[str, int]:
        """Runs of each estimator whose position error is not below `limit`."""
        return {name: int((~(one[:, 0] < self.limit)).sum()) for name, one in self.scores.items()}

    def quantiles(self, levels: Sequence[float] = (0.5, 0.9, 0.95, 1.0)) -> dict[str, Floats]:
        """Quantiles of each figure's magnitude, shape (nlevels, 5), by estimator."""
        return {name: np.quantile(np.abs(one), levels, 0) for name, one in self.scores.items()}

    def _summary_parts(self) -> Iterator[str | list[tuple[str, ...]]]:
        yield f"{len(self.mismatches)} random mismatches: median / 95 % / largest"
        heads = "velocity [%]", "friction [%]", "bias [%]", "mode [%]"
        rows: list[tuple[str, ...]] = [("", f"position [{self.unit}]", *heads)]
        for name, table in self.quantiles((0.5, 0.95, 1.0)).items():
            scaled = (table * [1.0, 100.0, 100.0, 100.0, 100.0]).T
            rows.append(
                (
                    name,
                    *(" / ".join(f"{value:.3g}" for value in one) for one in scaled),
                )
            )
        yield rows
        diverged = "; ".join(f"{name}: {count}" for name, count in self.diverged.items())
        yield f"diverged  {diverged}"

    def to_dict(self) -> dict[str, Any]:
        """Mismatches and scores as plain numbers."""
        return {
            "mismatches": [list(astuple(one)) for one in self.mismatches],
            "figures": list(FIGURES),
            "scores": {name: table.tolist() for name, table in self.scores.items()},
        }

    @panels(4, sharex=False)
    def plot(self, axes: Any) -> str:
        """Draw the share of the runs that stays below an error."""
        heads = (
            f"position error, largest [{self.unit}]",
            "velocity error, RMS [% of velocity]",
            "friction error, mean [% of level]",
            "mode-detection error [% of samples]",
        )
        part = (np.arange(len(self.mismatches)) + 1.0) / len(self.mismatches)
        for one, column, factor, head in zip(
            axes,
            (0, 1, 2, 4),
            (1.0, 100.0, 100.0, 100.0),
            heads,
            strict=True,
        ):
            least = np.inf
            for i, (name, table) in enumerate(self.scores.items()):
                value = np.sort(factor * np.abs(table[:, column]))
                dash = DASHES[i % len(DASHES)]
                one.step(
                    value,
                    part,
                    where="post",
                    linewidth=1.3,
                    linestyle=dash,
                    label=name,
                )
                least = min(least, float(value[0]))
            if least > 0.0:
                one.set_xscale("log")
                one.xaxis.set_major_formatter("{x:g}")
                one.xaxis.set_minor_formatter(_minor_label)
            one.set_xlabel(head)
            one.set_ylabel("share of runs")
        legend_above(axes[0])
        return f"{len(self.mismatches)} random mismatches"


def _minor_label(value: float, place: int) -> str:
    """Tick label of every other part of a decade."""
    return f"{value:g}" if f"{value:.0e}"[0] in "235" else ""


def monte_carlo(
    design: ObserverDesign,
    controller: LoopController,
    reference: MotionProfile | ArrayLike,
    *,
    axis: FrictionAxis | None = None,
    quantum: float | None = None,
    stribeck_speed: float | None = None,
    runs: int = 500,
    xhat0: float | None = None,
    estimators: Mapping[str, Estimator] | None = None,
    seed: int = 0,
    store: str | os.PathLike[str] | None = None,
    jobs: int | None = None,
    progress: bool = True,
) -> MonteCarlo:
    """Score estimators on plants that differ at random.

    Coulomb levels differ from those of an axis by up to 20 %, mass by up to 15 %; the
    Stribeck excess is 0 to 60 %.

    Parameters
    ----------
    design : ObserverDesign
    controller : PositionController or CompensatedController
        The controller, the same for all plants.
    reference : MotionProfile or array_like, shape (n,)
        Reference motion, or its positions, already filtered [m].
    axis : FrictionAxis, optional
        The axis from which the plants differ, with its Stribeck velocity and the effects that
        the observer does not follow.  Default: that of the design, which has no Stribeck peak.
    quantum : float, optional
        Encoder increment [m].  Default: that of the design.
    stribeck_speed : float, optional
        Stribeck velocity of the plants [m/s].  Default: that of `axis`; without one, no peak.
    runs : int, optional
    xhat0 : float, optional
        Start of the estimates [m].  Default: that of the plants, as of `simulate_loop`.
    estimators : mapping of str to Estimator, optional
        What is compared.  Default: both rules of the switched observer.
    seed : int, optional
    store : path-like, optional
        File that keeps each finished run, see `run_batch`, for any `runs` and `seed`.
    jobs : int, optional
        Runs at the same time, -1 for one on each core.  Default: what `joblib.parallel_config`
        says, else one.
    progress : bool, optional

    Returns
    -------
    MonteCarlo
        An estimate counts as diverged if its position, after 0.1 s, is off by
        more than at the start and by more than a hundred increments.

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0,
    ...                         stribeck=dfc.Stribeck(excess=0.3, speed=0.01))
    >>> design = dfc.design_pi_observer(axis, dt=1e-3, encoder_quantum=1e-6)
    >>> controller = dfc.design_compensation(axis, dt=1e-3, encoder_quantum=1e-6).controller
    >>> move = dfc.motion_profile(0.03, 1e-3, velocity=0.1, acceleration=2.0, jerk=80.0)
    >>> found = dfc.monte_carlo(design, controller, move, axis=axis, runs=3, progress=False)
    >>> found.diverged
    {'reading': 0, 'paper': 0}
    """
    check_loop(controller, design)
    axis = design.axis if axis is None else axis
    instance("axis", axis, FrictionAxis)
    r = reference if isinstance(reference, MotionProfile) else samples("reference", reference)
    quantum = design.encoder_quantum if quantum is None else quantum
    quantum = positive("quantum", quantum, unit=axis.unit("m"), zero=True)
    if stribeck_speed is not None:
        stribeck_speed = positive("stribeck_speed", stribeck_speed, unit=axis.unit("m/s"))
    elif axis.stribeck is not None:
        stribeck_speed = axis.stribeck.speed
    start = float(r.position[0]) if isinstance(r, MotionProfile) else 0.0
    xhat0 = start if xhat0 is None else finite("xhat0", xhat0)
    runs = whole("runs", runs)
    seed = whole("seed", seed, 0)
    compared = _compared_estimators(estimators, design, quantum)
    rng = np.random.default_rng(seed)
    mismatches = tuple(Mismatch.draw(rng) for _ in range(runs))
    settings: dict[str, Any] = {}
    if store is not None:
        parts = {
            "design": design,
            "controller": controller,
            "axis": axis,
            "reference": r,
        }
        numbers = {
            "quantum": quantum,
            "stribeck_speed": stribeck_speed,
            "xhat0": xhat0,
        }
        settings = _store_settings(parts, numbers, compared)

    def scores(mismatch: Mismatch) -> list[tuple[float, ...]]:
        plant = mismatch.plant(design, axis, stribeck_speed)
        run = simulate_loop(plant, controller, r, quantum=quantum)
        u = np.ascontiguousarray(run.y[4])
        y = np.ascontiguousarray(run.y[5])
        rows = [one.estimate(u, y, xhat0=xhat0) for one in compared.values()]
        return [astuple(score_estimate(plant, controller.dt, run.y, one)) for one in rows]

    tasks = {astuple(one): one for one in mismatches}
    found = run_batch(
        scores,
        tasks,
        store=store,
        settings=settings,
        jobs=jobs,
        progress=progress,
    )
    table = np.array([found[one] for one in tasks])
    by_name = {name: table[:, k] for k, name in enumerate(compared)}
    limit = max(abs(xhat0 - start), 100.0 * quantum) or np.inf
    return MonteCarlo(mismatches, by_name, design.axis.units[0], limit)


def _compared_estimators(
    estimators: Mapping[str, Estimator] | None,
    design: ObserverDesign,
    quantum: float,
) -> Mapping[str, Estimator]:
    """The estimators by name, both rules of the switched observer where there are none."""
    if estimators is None:
        both = (SwitchedEstimator(design, rule, quantum) for rule in ("reading", "paper"))
        return {one.switching: one for one in both}
    if not (isinstance(estimators, Mapping) and estimators):
        raise ValueError(
            f"estimators must be a mapping of names to at least one estimator, got {estimators!r}"
        )
    for name, one in estimators.items():
        if not callable(getattr(one, "estimate", None)):
            raise ValueError(f"estimators[{name!r}] must have a method estimate, got {one!r}")
    return estimators


def _store_settings(
    parts: dict[str, Any],
    numbers: dict[str, Any],
    compared: Mapping[str, Estimator],
) -> dict[str, Any]:
    """What the results in a store depend on."""
    # A certificate follows from the rest of a design, but for its rounding: one that is loaded
    # recomputes it.
    text = functools.partial(fingerprint, without=(Certificate,))
    settings: dict[str, Any] = {
        "task": "monte_carlo",
        "version": __version__,
    }
    settings |= {name: text(one) for name, one in parts.items()} | numbers
    settings["estimators"] = {name: text(one) for name, one in compared.items()}
    return settings
