"""Effects, their parameters, and the bands their strengths are drawn from.

A strength is relative to the axis: a share of its Coulomb level, of its travel,
of its mass.  `stretch` widens a band that turned out too faint in a record.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Effects = dict[str, dict[str, float]]

DT = 1e-3


def _fields(*rows: str) -> dict[str, dict[str, str]]:
    """Effects with their parameters, and the plant's name of each where it is another."""
    table = {}
    for row in rows:
        slug, *names = row.split()
        table[slug] = {name.split("=")[0]: name.split("=")[-1] for name in names}
    return table


FIELDS = _fields(
    "inertia mass",
    "viscous viscous",
    "coulomb coulomb",
    "coulomb_asymmetry asymmetry",
    "bias_force force=bias",
    "stribeck excess speed=stribeck_speed",
    "quadratic_drag coefficient=drag",
    "position_dependence slope curvature",
    "spring stiffness=spring centre=spring_centre",
    "gravity amplitude=gravity phase=gravity_phase",
    "cogging amplitude=cogging pitch=cogging_pitch phase=cogging_phase",
    "load_dependence coefficient=load",
    "drift rate=drift",
    "dwell_time rise=dwell_rise time_constant=dwell_time",
    "presliding distance=presliding",
    "backlash gap load_fraction",
    "compliance stiffness=coupling_stiffness damping=coupling_damping load_fraction",
    "input_gain gain",
    "input_delay delay",
    "actuator_lag time_constant=lag",
    "dead_zone width=dead_zone",
    "saturation limit=saturation",
    "time_periodic amplitude=periodic frequency=periodic_frequency phase=periodic_phase",
)
EFFECTS = tuple(FIELDS)

# In the catalogue, but drawn for no blind pair and no machine: these stay as they are.
ADDED_FIELDS = _fields(
    "warm_up rise=warm_rise time_constant=warm_time",
    "stribeck_asymmetry difference=excess_difference speed=difference_speed",
    "velocity_strengthening deficit speed=deficit_speed",
    "load_asymmetry coefficient=load_difference",
    "eccentric_encoder amplitude=eccentricity period=eccentricity_period phase=eccentricity_phase",
    "load_encoder_backlash gap load_fraction",
    "end_stop stiffness=wall_stiffness damping=wall_damping low=wall_low high=wall_high",
    "friction_ripple amplitude=level_ripple period=level_period phase=level_phase",
    "viscous_warm_up rise=viscous_rise time_constant=viscous_time",
)
ADDED = tuple(ADDED_FIELDS)

OUTSIDE_FIELDS = _fields(
    "local_defect height=defect place=defect_place width=defect_width",
    "impacts",
    "lost_steps",
    "progressive_stop stiffness=stop_stiffness place=stop_place",
    "wandering_friction",
    "speed_ripple amplitude=ripple speed=ripple_speed pitch=ripple_pitch",
)
OUTSIDE = tuple(OUTSIDE_FIELDS)
KNOWN = FIELDS | ADDED_FIELDS | OUTSIDE_FIELDS


def slowest(excess: float, coulomb: float, mass: float) -> float:
    """Smallest Stribeck speed drawn.

    Below vs the falling friction makes constant speed unstable, at the rate
    0.86 sigma Fc/(m vs).  At 40 1/s a free run of 0.25 s that starts there
    magnifies its first error by up to exp(10); at 300 1/s, as some draws would
    have it, rounding errors become visible and no model could replay the record.
    """
    return 0.86 * excess * coulomb / (mass * 40.0)


@dataclass
class Bands:
    """Draws of the parameters of effects on one axis.

    The disturbances that are no function of the state are written into
    `push` [N], `wander` [1] and `offset` [m], arrays over the record.
    """

    rng: np.random.Generator
    axis: dict[str, Any]
    scale: float  # units of travel per metre: 1, or 12 for a rotary axis
    speed: float  # of fast moves
    coarse: bool
    peak: float  # of the drive force on the clean axis, for the saturation
    quantum: float
    reference: Array
    push: Array
    wander: Array
    offset: Array

    def _signed(self, low: float, high: float) -> float:
        return float(self.rng.uniform(low, high) * self.rng.choice((-1.0, 1.0)))

    def draw(self, slug: str, stretch: float) -> dict[str, float]:
        """Parameters of `slug`; its strength is drawn from its band x stretch."""
        if slug in OUTSIDE_FIELDS:
            return self._outside(slug, stretch)
        uniform, signed = self.rng.uniform, self._signed
        axis, scale = self.axis, self.scale
        low, high = axis["travel"]
        span, force = high - low, axis["coulomb"]
        phase = float(uniform(0.0, 2.0 * np.pi))
        record = self.reference.size * DT
        micro = 4.0 if self.coarse else 1.0  # lengths that must outgrow the encoder
        if slug == "inertia":
            return {"mass": axis["mass"] * (1.0 + signed(0.08, 0.25) * stretch)}
        if slug == "viscous":
            return {"viscous": axis["viscous"] * max(1.0 + signed(0.25, 0.7) * stretch, 0.05)}
        if slug == "coulomb":
            return {"coulomb": force * max(1.0 + signed(0.06, 0.2) * stretch, 0.2)}
        if slug == "coulomb_asymmetry":
            return {"asymmetry": signed(0.05, 0.2) * stretch}
        if slug == "bias_force":
            return {"force": signed(0.05, 0.2) * stretch * force}
        if slug == "stribeck":
            excess = float(uniform(0.2, 0.6) * stretch)
            least = slowest(excess, force, axis["mass"])
            return {"excess": excess, "speed": max(float(uniform(0.006, 0.025) * scale), least)}
        if slug == "quadratic_drag":
            return {"coefficient": float(uniform(0.15, 0.5) * stretch) * force / self.speed**2}
        if slug == "position_dependence":
            slope = signed(0.1, 0.35) * stretch
            return {"slope": slope, "curvature": float(uniform(-0.5, 0.5)) * slope}
        if slug == "spring":
            stiffness = float(uniform(0.12, 0.4) * stretch) * force / (0.5 * span)
            return {"stiffness": stiffness, "centre": float(low + span * uniform(0.3, 0.7))}
        if slug == "gravity":
            return {"amplitude": float(uniform(0.12, 0.4) * stretch) * force, "phase": phase}
        if slug == "cogging":
            amplitude = float(uniform(0.08, 0.25) * stretch) * force
            pitch = float(uniform(0.03, 0.15)) * span
            return {"amplitude": amplitude, "pitch": pitch, "phase": phase}
        if slug == "load_dependence":
            return {"coefficient": float(uniform(0.07, 0.25)) * stretch}
        if slug == "drift":
            return {"rate": signed(0.12, 0.35) * stretch / record}
        if slug == "dwell_time":
            rise = float(uniform(0.3, 0.8)) * stretch * force
            return {"rise": rise, "time_constant": float(uniform(0.1, 0.5))}
        if slug == "presliding":
            return {"distance": float(uniform(20e-6, 70e-6) * stretch * micro) * scale}
        if slug == "eccentric_encoder":
            amplitude = float(uniform(30e-6, 150e-6) * stretch * micro) * scale
            period = float(uniform(0.02, 0.08)) * span
            return {"amplitude": amplitude, "period": period, "phase": phase}
        if slug in ("backlash", "load_encoder_backlash"):
            gap = float(uniform(60e-6, 250e-6) * stretch * micro) * scale
            return {"gap": gap, "load_fraction": float(uniform(0.3, 0.7))}
        if slug == "compliance":
            share = float(uniform(0.3, 0.7))
            reduced = axis["mass"] * share * (1.0 - share)
            omega = 2.0 * np.pi * float(uniform(15.0, 40.0)) / stretch
            damping = 2.0 * float(uniform(0.03, 0.1)) * reduced * omega
            return {"stiffness": reduced * omega**2, "damping": damping, "load_fraction": share}
        if slug == "input_gain":
            return {"gain": 1.0 + signed(0.06, 0.2) * stretch}
        if slug == "input_delay":
            return {"delay": float(uniform(1e-3, 6e-3))}
        if slug == "actuator_lag":
            return {"time_constant": float(uniform(1.5e-3, 6e-3))}
        if slug == "dead_zone":
            return {"width": float(uniform(0.08, 0.25) * stretch) * force}
        if slug == "saturation":
            least = 1.2 * force * (1.0 + (axis["stribeck"] or {"excess": 0.0})["excess"])
            return {"limit": max(float(uniform(0.6, 0.85)) * self.peak / stretch, least)}
        if slug == "warm_up":
            rise = float(uniform(0.15, 0.5) * stretch)
            return {"rise": rise, "time_constant": float(uniform(0.1, 0.3)) * record}
        if slug == "stribeck_asymmetry":
            difference = signed(0.15, 0.4) * stretch
            least = slowest(abs(difference), force, axis["mass"])
            speed = max(float(uniform(0.006, 0.025) * scale), least)
            return {"difference": difference, "speed": speed}
        if slug == "velocity_strengthening":
            deficit = min(float(uniform(0.15, 0.4) * stretch), 0.9)
            return {"deficit": deficit, "speed": float(uniform(0.01, 0.04) * scale)}
        if slug == "load_asymmetry":
            return {"coefficient": signed(0.05, 0.2) * stretch}
        if slug == "end_stop":
            low, high = float(self.reference.min()), float(self.reference.max())
            depth = float(uniform(0.05, 0.15)) * (high - low)
            stiffness = float(uniform(1.0, 3.0) * stretch) * force / depth
            damping = float(uniform(0.1, 0.4)) * np.sqrt(stiffness * axis["mass"])
            ends = {"low": low + depth, "high": high - depth}
            return {"stiffness": stiffness, "damping": damping} | ends
        if slug == "friction_ripple":
            period = float(uniform(0.03, 0.15)) * span
            return {
                "amplitude": float(uniform(0.1, 0.3)) * stretch,
                "period": period,
                "phase": phase,
            }
        if slug == "viscous_warm_up":
            rise = float(uniform(0.5, 1.5) * stretch) * axis["viscous"]
            return {"rise": rise, "time_constant": float(uniform(0.15, 0.5)) * record}
        amplitude = float(uniform(0.1, 0.3) * stretch) * force
        return {"amplitude": amplitude, "frequency": float(uniform(0.5, 8.0)), "phase": phase}

    def _outside(self, slug: str, stretch: float) -> dict[str, float]:
        rng, uniform, scale = self.rng, self.rng.uniform, self.scale
        micro = 4.0 if self.coarse else 1.0
        low, high = self.axis["travel"]
        span, force = high - low, self.axis["coulomb"]
        n = self.reference.size
        visited = np.quantile(self.reference, (0.2, 0.8))
        if slug == "local_defect":
            height, place = float(uniform(0.5, 1.5) * stretch), float(uniform(*visited))
            return {"height": height, "place": place, "width": float(uniform(0.008, 0.025)) * span}
        if slug == "impacts":
            self.push[:] = 0.0
            count = int(rng.integers(5, 12))
            for start in rng.integers(200, n - 50, size=count):
                length = int(rng.integers(4, 15))
                burst = np.sin(np.pi * (np.arange(length) + 0.5) / length)
                size = self._signed(1.5, 4.0) * force * stretch
                self.push[start : start + length] += size * burst
            return {"count": float(count)}
        if slug == "lost_steps":
            self.offset[:] = 0.0
            count = int(rng.integers(3, 7))
            for start in rng.integers(300, n - 300, size=count):
                size = self._signed(60e-6, 300e-6) * stretch * scale * micro
                self.offset[start:] += self.quantum * np.round(size / self.quantum)
            return {"count": float(count)}
        if slug == "progressive_stop":
            top = float(self.reference.max())
            depth = float(uniform(0.1, 0.2)) * span
            stiffness = float(uniform(0.5, 2.0) * stretch) * force / depth**2
            return {"stiffness": stiffness, "place": top - depth}
        if slug == "wandering_friction":
            time_constant, share = uniform(0.2, 0.6), uniform(0.12, 0.3) * stretch
            keep = np.exp(-DT / time_constant)
            walk = 0.0
            for k, kick in enumerate(np.sqrt(1.0 - keep**2) * rng.standard_normal(n)):
                walk = keep * walk + kick
                self.wander[k] = share * np.clip(walk, -2.5, 2.5)
            return {"share": float(share), "time_constant": float(time_constant)}
        amplitude = float(uniform(0.3, 0.8) * stretch) * force
        pitch = float(uniform(0.02, 0.08)) * span
        return {"amplitude": amplitude, "speed": self.speed, "pitch": pitch}
