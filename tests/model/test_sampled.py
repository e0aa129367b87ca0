"""A continuous controller beside a sampled axis, against closed forms and python-control."""

import control as ct
import numpy as np
import pytest

import dryfric_control as dfc

DT = 1e-2
LEAD = ct.tf([40.0, 400.0], [0.05, 1.0], inputs="e", outputs="u", name="lead")


def names(system):
    return system.name, system.input_labels, system.output_labels, system.state_labels


@pytest.mark.parametrize("method", ["tustin", "zoh", "foh", "euler", "backward_diff"])
def test_a_linear_controller_is_that_of_python_control_and_keeps_its_names(method):
    own = ct.ss([[-1.0, 2.0], [0.0, -3.0]], [[0.0], [1.0]], [[1.0, 0.0]], [[0.5]],
                states=["a", "b"], inputs="e", outputs="u", name="own")  # fmt: skip
    found = dfc.sampled(own, DT, method)
    assert names(found) == names(own) and found.dt == DT
    other = ct.sample_system(own, DT, method)
    assert found(np.exp(0.3j)) == pytest.approx(other(np.exp(0.3j)), rel=1e-12)
    assert dfc.sampled(found, DT).dt == DT  # what is sampled stays as it is


def test_a_transfer_function_connects_to_the_axis():
    axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    lead = dfc.sampled(LEAD, DT)
    s = 2.0 / DT * (1.0 - 1.0 / np.exp(0.3j)) / (1.0 + 1.0 / np.exp(0.3j))  # Tustin
    assert lead(np.exp(0.3j)) == pytest.approx((40.0 * s + 400.0) / (0.05 * s + 1.0), rel=1e-12)
    parts = [ct.summing_junction(["r", "-x"], "e"), lead, dfc.axis_block(axis, DT)]
    loop = ct.interconnect(parts, inputs=["r"], outputs=["x"], check_unused=False)
    x = ct.input_output_response(loop, DT * np.arange(300), np.full(300, 0.1)).outputs
    # At rest within the dead band of a proportional loop: Fc / kp = 20 mm.
    assert abs(x[-1] - 0.1) < 8.0 / 400.0


def test_a_nonlinear_controller_is_integrated_with_a_held_input():
    """z' = -a z + u from rest: z = (1 - exp(-a t))/a, exact at the samples."""
    own = ct.nlsys(
        lambda t, x, u, p: [-p["a"] * x[0] + u[0]], lambda t, x, u, p: [np.tanh(x[0])],
        inputs="e", outputs="u", states=["z"], name="own", params={"a": 2.0},
    )  # fmt: skip
    found, t = dfc.sampled(own, DT), DT * np.arange(50)
    assert names(found) == names(own)
    for a in (2.0, 4.0):
        u = ct.input_output_response(found, t, np.ones(50), params={"a": a}).outputs
        np.testing.assert_allclose(u, np.tanh((1.0 - np.exp(-a * t)) / a), rtol=1e-6, atol=1e-9)
    clip = ct.nlsys(None, lambda t, x, u, p: np.clip(u, -1.0, 1.0), inputs="e", outputs="u")
    assert dfc.sampled(clip, DT).output(0.0, [], [3.0]) == 1.0


@pytest.mark.parametrize(
    ("controller", "options", "words"),
    [
        (ct.tf([1.0, 1.0, 1.0], [1.0, 0.0]), {}, r"without a filter.*divide by \(T s"),
        (ct.tf([1.0], [1.0, 0.5], 2.0), {}, "sampling time of 2 s, not dt = 0.01"),
        (5.0, {}, "must be a control.StateSpace"),
        (LEAD, {"method": "exact"}, "method must be one of tustin"),
        (ct.nlsys(None, lambda t, x, u, p: u, inputs=1, outputs=1), {"method": "tustin"},
         'held over a sample, method="zoh"'),
    ],
)  # fmt: skip
def test_what_cannot_be_sampled_is_refused(controller, options, words):
    with pytest.raises(ValueError, match=words):
        dfc.sampled(controller, DT, **options)
