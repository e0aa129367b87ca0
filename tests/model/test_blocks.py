"""The python-control faces agree with the compiled path and with theory."""

import control as ct
import numpy as np
import pytest

import dryfric_control as dfc
from dryfric_control import effects as fx

DT = 1e-3


PLAIN = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
AXIS = dfc.FrictionAxis(
    mass=1.0, viscous=1.0, coulomb=dfc.CoulombMap([1.0, 0.5], [1.2, -0.1]), travel=(-1.0, 1.0),
    stribeck=dfc.Stribeck(0.3, 0.01), stick_speed=1e-4,
    effects=(fx.Spring(5.0), fx.CoulombAsymmetry(0.1), fx.Cogging(0.2, 0.01)),
)  # fmt: skip


def dithered(n):
    """A run of the axis under so much noise that it switches all the time."""
    t = np.arange(n) * DT
    noise = 4.0 * np.random.default_rng(0).standard_normal(n)
    return AXIS.simulate(2.0 * np.sin(2.0 * np.pi * 7.0 * t) + noise, DT)


@pytest.mark.slow
@pytest.mark.parametrize("build", [dfc.axis_block, dfc.switched_axis])
def test_blocks_walk_the_compiled_path_through_many_switches(build):
    resp = dithered(6000)
    assert len(resp.events) > 600
    block = ct.input_output_response(build(AXIS, DT), resp.t, resp.u)
    scale = np.abs(resp.y).max(axis=1, keepdims=True)
    # The same kernel: 1e-9 is asked for, nothing but round-off is expected.
    assert np.all(np.abs(block.outputs - resp.y) <= 1e-9 * scale)


def test_supervisor_alone_tells_the_modes_of_a_run():
    resp = dithered(3000)
    signals = np.vstack([resp.u, resp.y[:2]])
    modes = ct.input_output_response(dfc.supervisor(AXIS, DT), resp.t, signals).outputs
    assert np.array_equal(np.ravel(modes), resp.y[3])


def test_closed_loop_by_interconnect_is_the_compiled_loop():
    loop = dfc.PositionController.from_bandwidth(AXIS, 20.0, DT)
    reference = 0.2 * np.sign(np.sin(np.arange(3000) * 3e-3))
    resp = dfc.simulate_loop(AXIS, loop, reference, quantum=1e-5)
    parts = [loop.block(), dfc.axis_block(AXIS, DT), dfc.encoder(1e-5, DT)]
    outputs = ["x", "v", "F", "mode", "u", "y"]
    system = ct.interconnect(parts, inputs=["xref"], outputs=outputs)
    block = ct.input_output_response(system, resp.t, reference)
    np.testing.assert_allclose(block.outputs, resp.y, rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("method", ["euler", "zoh"])
def test_sampled_modes_are_the_printed_ones(method):
    axis = PLAIN.replace(stick_rate=400.0)
    for index, rate, gain in ((0, 400.0, 0.0), (1, 7.5, 0.5), (-1, 7.5, 0.5)):
        system = axis.mode_ss(index, dt=DT, method=method)
        if method == "euler":
            a, b = [[1.0, DT], [0.0, 1.0 - DT * rate]], [[0.0], [DT * gain]]
        else:
            continuous = ct.ss([[0, 1], [0, -rate]], [[0], [gain]], [[1, 0]], 0)
            exact = ct.c2d(continuous, DT, "zoh")
            a, b = exact.A, exact.B
        np.testing.assert_allclose(system.A, a, rtol=1e-12, atol=1e-18)
        np.testing.assert_allclose(system.B, b, rtol=1e-9, atol=1e-18)
        assert np.array_equal(system.C, [[1.0, 0.0]])
        assert system.dt == DT and system.method == method
        assert ("sampled exactly" in str(system)) is (method == "zoh")
    assert axis.mode_ss(1).method == "" and "sampled" not in str(axis.mode_ss(1))
    # The direction of an unknown force is there in every mode.
    assert axis.mode_ss(0, DT, input="force").B[1, 0] == pytest.approx(DT / 2.0)


def test_python_control_works_on_the_modes():
    for index in (0, 1, -1):
        mode = AXIS.mode(index)
        linear = ct.linearize(mode, [0.1, 0.3 * index], [2.0])
        rate = AXIS.viscous / AXIS.mass if index else AXIS.stick_rate
        assert linear.A[1, 1] == pytest.approx(-rate, rel=1e-5)
        resp = ct.input_output_response(mode, np.linspace(0.0, 0.1, 20), 2.0, [0.1, 0.2 * index])
        assert np.all(np.isfinite(resp.outputs))
        for system in (AXIS.mode_ss(index, DT), AXIS.mode_ss(index)):
            assert ct.frequency_response(system).omega.size > 10
            ct.step_response(system, T=np.arange(100) * DT)
    ct.bode_plot(system)
    ct.linearize(dfc.axis_block(AXIS, DT), [0.0, 0.3, 1.0], [2.0])


def test_anti_windup_limits_the_overshoot():
    axis = dfc.FrictionAxis(mass=2.0, viscous=40.0, coulomb=4.0)
    loop = dfc.PositionController.from_bandwidth(axis, 10.0, DT, limit=12.0)
    resp = dfc.simulate_loop(axis, loop, np.full(8000, 0.5))
    assert np.abs(resp.y[4]).max() == 12.0 and resp.y[0].max() < 0.5 * 1.05
    assert resp.y[0, -1] == pytest.approx(0.5, abs=1e-3)


def test_encoder_rounds_to_the_nearest_increment():
    x = np.linspace(-1.0, 1.0, 1001)
    system = dfc.encoder(0.01, DT)
    y = np.array([system.output(0.0, [], [value])[0] for value in x])
    assert np.abs(y - x).max() <= 0.005 + 1e-15
    np.testing.assert_allclose(y / 0.01, np.round(y / 0.01), atol=1e-9)
    assert dfc.encoder(0.0, DT).output(0.0, [], [0.1234])[0] == 0.1234


def test_parameters_that_change_nothing_are_refused():
    """Also through a system all of whose parts have none; those of a user's own part pass."""
    t, block, switched = np.arange(5) * DT, dfc.axis_block(AXIS, DT), dfc.switched_axis(AXIS, DT)
    own = ct.nlsys(
        None, lambda t, x, u, params: [params["k"] * u[0]], inputs=["r"], outputs=["u"],
        dt=DT, name="own", params={"k": 2.0},
    )  # fmt: skip
    parts = [dfc.encoder(1e-6, DT), block]
    loop = ct.interconnect(parts, inputs=["u"], outputs=["y"], warn_duplicate=False)
    for system in (block, switched, loop, AXIS.mode(1)):
        for params in ({"mass": 20.0}, {"k": 3.0}):
            with pytest.raises(ValueError, match=r"params = .* changes nothing: .*axis\.replace"):
                ct.input_output_response(system, t, 2.0, params=params)
        ct.input_output_response(system, t, 2.0, params={})
    for plant in (block, switched):
        driven = ct.interconnect([own, plant], inputs=["r"], outputs=["F"])
        run = ct.input_output_response(driven, t, 0.1, params={"k": 3.0})
        assert run.outputs[0] == pytest.approx(0.3)  # at rest friction is the drive


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e308])
def test_a_loop_that_diverges_ends_with_a_message(value):
    """The compiled step of an elastic contact would not end."""
    block = dfc.axis_block(PLAIN.replace(effects=fx.Presliding(distance=1e-5)), DT)
    with pytest.raises(ValueError, match="beyond 1e100 or no number at 0 s: the loop diverges"):
        ct.input_output_response(block, np.arange(3) * DT, [value] * 3)


@pytest.mark.parametrize("value", [0.5, -7.0, 1e12])
def test_a_start_that_is_no_state_is_refused(value):
    """The compiled observer takes two of its states as places in a table."""
    observer = dfc.pi_observer(dfc.design_pi_observer(PLAIN, DT))
    for block in (observer, dfc.design_compensation(PLAIN, DT).controller.block()):
        u, start = np.zeros((block.ninputs, 3)), np.full(block.nstates, value)
        with pytest.raises(ValueError, match="must be a whole number from -1 to 1, got"):
            ct.input_output_response(block, np.arange(3) * DT, u, start)
