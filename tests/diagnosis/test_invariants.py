"""What an answer must keep, whatever the nominal values and the number of samples."""

from functools import cache

import pytest
from diagnosis_cases import among, believed, causes, record
from truth import make_case

import dryfric_control as dfc

# A cause of each kind: one way, over position, in the drive, none.
HIDDEN = ("bias_force", "position_dependence", "actuator_lag", ())
CANDIDATES = (
    "bias_force", "coulomb_asymmetry", "position_dependence", "spring", "quadratic_drag",
    "stribeck", "input_delay", "actuator_lag",
)  # fmt: skip


@cache
def case_of(slug):
    return make_case(slug, 3, "short")


def asked(axis, measured):
    with among(*CANDIDATES):
        return dfc.diagnose(axis, measured, jobs=1, progress=False)


@cache
def plain(slug):
    case = case_of(slug)
    return asked(believed(case), record(case))


def main(found):
    """The main causes that are effects."""
    base = {"inertia", "viscous", "coulomb"}
    return sorted(c.effect for c in found.main_causes if c.effect not in base)


@pytest.mark.slow
@pytest.mark.parametrize("slug", HIDDEN, ids=str)
@pytest.mark.parametrize("change", ["nominal", "sample"])
def test_the_same_main_causes(slug, change):
    case = case_of(slug)
    axis, measured = believed(case), record(case)
    if change == "nominal":
        axis = axis.replace(mass=1.1 * axis.mass, viscous=0.9 * axis.viscous)
    else:
        measured = dfc.Record(case.t[:-1], case.u[:-1], case.x[:-1])
    found = asked(axis, measured)
    assert main(found) == main(plain(slug)), str(found)
    if change != "nominal":
        assert found.verdict == plain(slug).verdict
        assert causes(found) == causes(plain(slug))
    assert found.verdict in ("explained", "nothing to find")


# -- one at a time --------------------------------------------------------------------------
