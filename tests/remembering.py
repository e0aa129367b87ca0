"""Effects with states of their own, each written in one class."""

import math
from dataclasses import dataclass
from typing import ClassVar

import dryfric_control as dfc

parameter = dfc.effects.parameter


class Remembering(dfc.effects.Effect):
    """What all of them say of themselves."""

    action = "memory"
    explanation = "Something of the user's own machine."
    experiment = "Look at it."


@dataclass(frozen=True)
class MaxwellSlip(Remembering):
    """Two springs, each of which slips when its force reaches its level."""

    stiffness_1: float = parameter("N/m", "stiffness of the first spring", bounds=(1.0, 1e9))
    level_1: float = parameter("N", "force at which it slips", bounds=(0.0, math.inf))
    stiffness_2: float = parameter("N/m", "stiffness of the second spring", bounds=(1.0, 1e9))
    level_2: float = parameter("N", "force at which it slips", bounds=(0.0, math.inf))
    slug = "maxwell_slip"
    states: ClassVar = {"spring_1": "m", "spring_2": "m"}

    @staticmethod
    def law(t, x, v, u, level, direction, rest, p):
        return -p[0] * p[4] - p[2] * p[5]

    @staticmethod
    def flow(i, t, x, v, u, level, direction, rest, p):
        return v

    @property
    def limits(self):
        first, second = self.level_1 / self.stiffness_1, self.level_2 / self.stiffness_2
        return (-first, first), (-second, second)


@dataclass(frozen=True)
class BrittleBond(Remembering):
    """Spring that lets go where it is strained most, and holds again at once."""

    stiffness: float = parameter("N/m", "stiffness", bounds=(0.0, math.inf))
    strain: float = parameter("m", "strain at which it lets go", bounds=(1e-9, math.inf))
    slug = "brittle_bond"
    states: ClassVar = {"strain_now": "m"}

    @staticmethod
    def law(t, x, v, u, level, direction, rest, p):
        return -p[0] * p[2]

    @staticmethod
    def flow(i, t, x, v, u, level, direction, rest, p):
        return v

    @staticmethod
    def jump(i, t, x, v, u, level, direction, rest, p):
        return 0.0

    @property
    def limits(self):
        return ((-self.strain, self.strain),)


@dataclass(frozen=True)
class WarmContact(Remembering):
    """Friction that rises with the heat of the last motion."""

    rise: float = parameter("1/K", "relative rise of the level", bounds=(0.0, math.inf))
    heating: float = parameter("K/J", "rise of temperature by work", bounds=(0.0, math.inf))
    cooling: float = parameter("s", "time constant", bounds=(1e-6, math.inf))
    slug = "warm_contact"
    states: ClassVar = {"temperature": "K"}
    adds_to = "friction"

    @staticmethod
    def law(t, x, v, u, level, direction, rest, p):
        return level * p[0] * p[3]

    @staticmethod
    def flow(i, t, x, v, u, level, direction, rest, p):
        return p[1] * level * abs(v) - p[3] / p[2]


SLIP = MaxwellSlip(stiffness_1=4e4, level_1=3.0, stiffness_2=8e3, level_2=2.0)
BOND = BrittleBond(stiffness=2e4, strain=3e-4)
WARM = WarmContact(rise=0.5, heating=20.0, cooling=0.05)
