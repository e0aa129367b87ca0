"""One effect of every action, written outside the package in one class each.

Nothing else is touched: each is simulated, fitted, diagnosed, documented,
and written to a file and read back.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from runpy import run_path
from typing import ClassVar

import numpy as np
import pytest

import dryfric_control as dfc
from dryfric_control.diagnosis.candidates import BASE
from dryfric_control.model.effects.columns import simulated_column
from dryfric_control.model.effects.effect import ACTIONS, REGISTRY
from dryfric_control.model.effects.naming import class_of

DT, QUANTUM = 1e-3, 1e-7
AXIS = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
CATALOGUE = Path(__file__).parents[2] / "docs" / "_extensions" / "effects_catalogue.py"
parameter = dfc.effects.parameter


class Foreign(dfc.effects.Effect):
    """What all of them say of themselves."""

    explanation = "Something of the user's own machine."
    experiment = "Look at it."


@dataclass(frozen=True)
class HalfBridge(Foreign):
    """Amplifier with another gain for positive commands."""

    gain: float = parameter("1", "gain for u > 0", bounds=(0.0, math.inf), neutral=1.0)
    slug, action = "half_bridge", "input"
    depends_on_place = False

    @staticmethod
    def law(t, x, v, u, level, direction, rest, p):
        return p[0] * u if u > 0.0 else u


@dataclass(frozen=True)
class Bellows(Foreign):
    """Spring of the third power."""

    strength: float = parameter("N/m^3", "coefficient of x^3", bounds=(0.0, math.inf))
    slug, action = "bellows", "force"

    @staticmethod
    def law(t, x, v, u, level, direction, rest, p):
        return -p[0] * x**3


@dataclass(frozen=True)
class DryCrown(Foreign):
    """Friction that is higher around one place."""

    rise: float = parameter("1", "relative rise of the level", bounds=(0.0, math.inf))
    slug, action = "dry_crown", "friction"

    @staticmethod
    def law(t, x, v, u, level, direction, rest, p):
        return level * p[0] * math.exp(-((x / 0.05) ** 2))


@dataclass(frozen=True)
class OneSidedWear(Foreign):
    """Coulomb level that is lower forwards."""

    lost: float = parameter("1", "part of the level", bounds=(-0.9, 0.9))
    slug, action = "one_sided_wear", "axis"
    depends_on_place = False

    def alter(self, axis):
        plus = [(1.0 - self.lost) * c for c in axis.coulomb.plus]
        return axis.replace(coulomb=dfc.CoulombMap(plus, axis.coulomb.minus))


@dataclass(frozen=True)
class BusCycles(Foreign):
    """Cycles of a field bus, 1 ms each."""

    late: float = parameter("s", "delay of two hops", bounds=(0.0, math.inf), kind="time")
    slug, action = "bus_cycles", "delay"
    depends_on_place, remembers = False, True

    def inner(self, axis):
        return dfc.effects.Inner(delay=0.5 * self.late)


@dataclass(frozen=True)
class Hose(Foreign):
    """Pressure that builds up through a hose."""

    fill: float = parameter("s", "time to fill", bounds=(0.0, math.inf), kind="time")
    slug, action = "hose", "lag"
    depends_on_place, remembers = False, True

    def inner(self, axis):
        return dfc.effects.Inner(lag=self.fill / 3.0)


@dataclass(frozen=True)
class Bristles(Foreign):
    """Contact of given stiffness."""

    stiffness: float = parameter("N/m", "stiffness", bounds=(1.0, math.inf))
    slug, action = "bristles", "contact"
    depends_on_place, remembers = False, True

    def inner(self, axis):
        return dfc.effects.Inner(contact=self.stiffness)

    @classmethod
    def columns(cls, view) -> Iterator:
        for part in np.geomspace(3e-4, 3e-2, 6):
            yield simulated_column(stiffness=view.size / (part * view.span))


@dataclass(frozen=True)
class Belt(Foreign):
    """Belt between halves of the mass, damped by a tenth of what is critical."""

    pitch: float = parameter("Hz", "natural frequency", bounds=(1.0, math.inf))
    slug, action = "belt", "transmission"
    depends_on_place, remembers = False, True

    def inner(self, axis):
        reduced, omega = 0.25 * axis.mass, 2.0 * math.pi * self.pitch
        return dfc.effects.Inner(
            stiffness=reduced * omega**2, damping=0.2 * reduced * omega, load_fraction=0.5
        )

    @classmethod
    def columns(cls, view) -> Iterator:
        for pitch in (8.0, 16.0, 30.0, 60.0):
            yield simulated_column(pitch=pitch)


@dataclass(frozen=True)
class BentScale(Foreign):
    """Scale whose marks stand ever wider apart."""

    bend: float = parameter("1/m", "relative error of a mark per length", bounds=(-1.0, 1.0))
    slug, action = "bent_scale", "reading"

    @staticmethod
    def law(t, x, v, u, level, direction, rest, p):
        return p[0] * x * x


@dataclass(frozen=True)
class RubberSeal(Foreign):
    """Lip that is bent by 0.4 mm before it slips."""

    hold: float = parameter("N", "force at which it slips", bounds=(0.0, math.inf))
    slug, action = "rubber_seal", "memory"
    states: ClassVar = {"bend": "m"}

    @staticmethod
    def law(t, x, v, u, level, direction, rest, p):
        return -p[0] * p[1] / 4e-4

    @staticmethod
    def flow(i, t, x, v, u, level, direction, rest, p):
        return v

    @property
    def limits(self):
        return ((-4e-4, 4e-4),)


TRUE = (
    BentScale(bend=0.2), RubberSeal(hold=5.0),
    HalfBridge(gain=0.8), Bellows(strength=4000.0), DryCrown(rise=0.6), OneSidedWear(lost=0.2),
    BusCycles(late=6e-3), Hose(fill=9e-3), Bristles(stiffness=8e3), Belt(pitch=20.0),
)  # fmt: skip


def only(*classes):
    """Base parameters and the given effects alone; what there was is back after the test."""
    for slug in REGISTRY.keys() - BASE:
        del REGISTRY[slug]
    for cls in classes:
        dfc.effects.register_effect(cls)


def made(axis, seconds=4.0, seed=2):
    """A record of an axis under position control, over steps of random size."""
    rng = np.random.default_rng(seed)
    n = round(seconds / DT)
    target = np.repeat(rng.uniform(-0.1, 0.1, n // 250 + 1), 250)[:n]
    reference = np.convolve(target, np.ones(100) / 100.0, "same")
    loop = dfc.PositionController(kp=2500.0, ki=0.0, kd=110.0, dt=DT, limit=60.0)
    run = dfc.simulate_loop(axis, loop, reference, quantum=QUANTUM)
    return dfc.Record(run.t, run.y[4], run.y[5], quantum=QUANTUM)


def test_every_action_has_one():
    assert {effect.action for effect in TRUE} == set(ACTIONS)


@pytest.mark.slow
@pytest.mark.parametrize("effect", TRUE, ids=lambda effect: effect.action)
def test_an_effect_in_one_class_is_known_everywhere(effect, tmp_path):
    cls = type(effect)
    ((name, true),) = vars(effect).items()
    only(cls, dfc.effects.BiasForce)
    machine = AXIS.replace(effects=effect)
    record = made(machine, seconds=3.0)
    # Simulated: it changes the motion.
    run, without = (axis.simulate(record.u[:1000], DT).y[0] for axis in (machine, AXIS))
    assert np.abs(run - without).max() > 100 * QUANTUM
    # Fitted from numbers that are off.
    found = dfc.fit(AXIS.replace(effects=cls(0.8 * true)), record, free=(cls.slug,))
    assert found.parameters[f"{cls.slug}.{name}"] == pytest.approx(true, rel=0.02)
    # Diagnosed.
    d = dfc.diagnose(AXIS, record, jobs=1)
    assert [cause.effect for cause in d.causes] == [cls.slug], str(d)
    assert d.causes[0].parameters[name] == pytest.approx(true, rel=0.05)
    assert d.causes[0].units == cls.units()
    # Written to a file and read back.
    dfc.write_axis(machine, tmp_path / "axis.toml")
    assert dfc.read_axis(tmp_path / "axis.toml") == machine
    # Documented.
    text = "\n".join(run_path(str(CATALOGUE))["section"](cls))
    assert f"`{cls.slug}`" in text and f"| `{name}` |" in text and cls.explanation in text
    assert cls.slug in machine.describe()
    del REGISTRY[cls.slug]
    assert class_of(cls.slug) is None


FIRST = dfc.effects.Cogging(amplitude=4.0, period=0.05, phase=0.4)
SECOND = dfc.effects.Cogging(amplitude=2.5, period=0.021, phase=-1.0)


@pytest.mark.slow
def test_a_diagnosis_finds_a_second_cogging():
    record = made(AXIS.replace(effects=(FIRST, SECOND)), seconds=8.0)
    only(dfc.effects.BiasForce, dfc.effects.Spring, dfc.effects.Cogging)
    d = dfc.diagnose(AXIS.replace(effects=(FIRST,)), record, jobs=1)
    assert d.verdict == "explained", str(d)
    assert [c.effect for c in d.causes] == ["cogging_2"], str(d)
    (cause,) = d.causes
    assert cause.title == "cogging 2"
    assert cause.parameters["period"] == pytest.approx(SECOND.period, rel=0.01)
    assert cause.parameters["amplitude"] == pytest.approx(SECOND.amplitude, rel=0.05)
    periods = sorted(e.period for e in d.extended.effects)
    assert periods == pytest.approx([SECOND.period, FIRST.period], rel=0.01)
    # Each is fitted by its own name.
    free = ("cogging.amplitude", "cogging_2.amplitude", "cogging_2.phase")
    off = dfc.effects.Cogging(3.0, FIRST.period, 0.4), dfc.effects.Cogging(3.5, SECOND.period, -1.2)
    found = dfc.fit(AXIS.replace(effects=off), record, free=free)
    assert list(found.parameters) == list(free)
    assert list(found.parameters.values()) == pytest.approx([4.0, 2.5, -1.0], rel=0.01)
    assert found.axis.effects[0].phase == FIRST.phase
