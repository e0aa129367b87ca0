"""More than one cause, causes that can stand for several, and effects the axis has already."""

import pytest
from diagnosis_cases import among, believed, causes, parameter_errors, record
from truth import make_case, make_pair

import dryfric_control as dfc
from dryfric_control.diagnosis.diagnose import diagnose

# Effects that raise or lower all forces, some of them or one way alone.
BESIDE_GAIN = (
    "input_gain", "stribeck", "load_dependence", "load_asymmetry", "coulomb_asymmetry",
    "bias_force", "quadratic_drag", "viscous_asymmetry",
)  # fmt: skip


@pytest.mark.slow
def test_both_causes_of_a_pair_are_found():
    case = make_pair(0, "short", pair=("spring", "input_delay"))
    rivals = (
        "gravity", "position_dependence", "cogging", "bias_force", "actuator_lag", "compliance",
        "presliding", "input_gain",
    )  # fmt: skip
    with among("spring", "input_delay", *rivals):
        found = diagnose(believed(case), record(case), jobs=1)
    assert sorted(causes(found)) == ["input_delay", "spring"], str(found)
    assert found.verdict == "explained"
    assert max(parameter_errors(case, found).values()) < 0.15


@pytest.mark.slow
def test_a_gain_is_not_taken_for_three_wrong_base_parameters():
    # The very same machine; one cause is plainer than three.
    case = make_case("input_gain", 4, "short")
    with among(*BESIDE_GAIN):
        found = diagnose(believed(case), record(case), jobs=1)
    assert causes(found) == ["input_gain"], str(found)


# -- effects in the believed axis ------------------------------------------------------


@pytest.mark.slow
def test_an_effect_in_the_believed_axis_may_have_the_wrong_numbers():
    case = make_case("spring", 0, "short")
    true = case.truth["spring"]
    half = dfc.effects.Spring(stiffness=0.5 * true["stiffness"], rest=true["centre"])
    with among("spring", "gravity", "position_dependence", "bias_force", "cogging"):
        found = diagnose(believed(case).replace(effects=(half,)), record(case), jobs=1)
    assert causes(found) == ["spring"], str(found)
    assert found.causes[0].parameters["stiffness"] == pytest.approx(true["stiffness"], rel=0.05)
    assert "lready in the nominal axis" in found.causes[0].explanation
    assert len(found.extended.effects) == 1


def test_a_nominal_force_of_the_wrong_sign_hides_no_cause():
    case = make_case(("bias_force", "quadratic_drag"), 5, "short")
    force = case.truth["bias_force"]["force"]
    wrong = dfc.effects.BiasForce(force=-0.6 * force)
    rivals = ("viscous_asymmetry", "spring", "stribeck", "end_stop")
    with among("bias_force", "quadratic_drag", *rivals):
        found = diagnose(believed(case).replace(effects=(wrong,)), record(case), jobs=1)
    assert [cause.effect for cause in found.causes] == ["quadratic_drag", "bias_force"], str(found)
    assert found.causes[1].parameters["force"] == pytest.approx(force, rel=1e-3)
