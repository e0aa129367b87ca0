"""Effects that the axis has already, with the wrong numbers."""

import pytest
from diagnosis_cases import among, believed, causes, record
from truth import make_case

import dryfric_control as dfc


@pytest.mark.slow
def test_an_effect_in_the_believed_axis_may_have_the_wrong_numbers():
    case = make_case("spring", 0, "short")
    true = case.truth["spring"]
    half = dfc.effects.Spring(stiffness=0.5 * true["stiffness"], rest=true["centre"])
    with among("spring", "gravity", "position_dependence", "bias_force", "cogging"):
        found = dfc.diagnose(believed(case).replace(effects=(half,)), record(case), jobs=1)
    assert causes(found) == ["spring"], str(found)
    assert found.causes[0].parameters["stiffness"] == pytest.approx(true["stiffness"], rel=0.05)
    assert "lready in the nominal axis" in found.causes[0].explanation
    assert len(found.extended.effects) == 1


@pytest.mark.slow
def test_a_nominal_force_of_the_wrong_sign_hides_no_cause():
    case = make_case(("bias_force", "quadratic_drag"), 5, "short")
    force = case.truth["bias_force"]["force"]
    wrong = dfc.effects.BiasForce(force=-0.6 * force)
    rivals = ("viscous_asymmetry", "spring", "stribeck", "end_stop")
    with among("bias_force", "quadratic_drag", *rivals):
        found = dfc.diagnose(believed(case).replace(effects=(wrong,)), record(case), jobs=1)
    assert causes(found) == ["quadratic_drag", "bias_force"], str(found)
    assert found.causes[1].parameters["force"] == pytest.approx(force, rel=1e-3)
