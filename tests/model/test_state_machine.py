"""The drawn state machine says what the axis does, and fits its axes."""

from __future__ import annotations

import control as ct
import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch

import dryfric_control as dfc
from dryfric_control import presets


def an_axis(**changes) -> dfc.FrictionAxis:
    return dfc.FrictionAxis(
        mass=2.0, viscous=15.0, coulomb=(8.0, 6.0), stribeck=dfc.Stribeck(excess=0.5, speed=0.01)
    ).replace(**changes)


def words(drawn: ct.ControlPlot) -> str:
    return "\n".join(text.get_text() for text in np.ravel(drawn.axes)[0].texts)


CASES = [
    an_axis(),
    an_axis(stribeck=None),
    an_axis(switching="paper", effects=(dfc.effects.Spring(stiffness=2.0),)),
    presets.clutch_actuator(),
    presets.clutch_observer_axis(),
]


def test_numbers_of_the_axis_stand_in_the_drawing():
    text = words(dfc.plot_state_machine(an_axis()))
    for number in ("m = 2 kg", "f = 15 N\xb7s/m", "= 8 N", "= 6 N", "p = 500 1/s", "0.0001 m/s"):
        assert number in text
    # breakaway is (1 + 0.5) times the Coulomb level
    assert "$F_{b+}$ = 12 N" in text and "$F_{b-}$ = 9 N" in text


def test_a_level_that_varies_is_written_as_a_range():
    axis = an_axis(coulomb=dfc.CoulombMap(plus=[8.0, 10.0], minus=7.0), travel=(0.0, 0.4))
    text = words(dfc.plot_state_machine(axis))
    assert "$F_{c+}$ = 8 to 12 N" in text and "$F_{c-}$ = 7 N" in text


def test_effects_on_base_parameters_are_applied_and_the_others_named():
    axis = an_axis(effects=(dfc.effects.Inertia(factor=3.0), dfc.effects.BiasForce(force=1.0)))
    text = words(dfc.plot_state_machine(axis))
    assert "m = 6 kg" in text
    assert "w > F_{b+}" in text and "u > F_{b+}" not in text
    assert "bias force" in text
    assert "w: net" not in words(dfc.plot_state_machine(an_axis()))


@pytest.mark.parametrize("axis", CASES, ids=range(len(CASES)))
def test_three_boxes_and_six_arrows(axis):
    patches = np.ravel(dfc.plot_state_machine(axis).axes)[0].patches
    assert sum(isinstance(patch, FancyBboxPatch) for patch in patches) == 3
    assert sum(isinstance(patch, FancyArrowPatch) for patch in patches) == 6


def test_the_rule_of_the_paper_changes_direction_as_the_speed_does():
    printed = words(dfc.plot_state_machine(an_axis(switching="paper")))
    completed = words(dfc.plot_state_machine(an_axis()))
    assert "$v < 0$" in printed and "$v = 0$" not in printed
    assert "$v < 0$" not in completed and "$v = 0$" in completed


def test_the_written_conditions_are_those_of_the_simulation():
    axis = an_axis()
    text = words(dfc.plot_state_machine(axis))
    # Just under and just over the level that the drawing names.
    held, gone = (axis.simulate([u] * 5, dt=1e-3).mode[-1] for u in (11.999, 12.001))
    assert "= 12 N" in text and (held, gone) == (0, 1)
    # A mass that comes down to zero under 11 N: more than the 8 N of Coulomb, less than
    # F_+(0) = 8 (1 + 0.5 exp(-1e-4)) N, so the completed rule holds it, the printed one does not.
    assert "$F_+(0)$ = 12 N" in text
    ends = {
        rule: an_axis(switching=rule).simulate([11.0] * 50, dt=1e-3, v0=2e-3)
        for rule in ("filippov", "paper")
    }
    assert ends["filippov"].mode[0] == 1 and ends["filippov"].mode[-1] == 0
    assert 0 not in ends["paper"].mode


@pytest.mark.parametrize("axis", CASES, ids=range(len(CASES)))
def test_no_text_covers_another_or_leaves_the_figure(axis):
    drawn = dfc.plot_state_machine(axis)
    figure = drawn.figure
    figure.canvas.draw()
    renderer = figure.canvas.get_renderer()
    boxes = [text.get_window_extent(renderer) for text in np.ravel(drawn.axes)[0].texts]
    for i, box in enumerate(boxes):
        assert box.x0 >= 0 and box.x1 <= figure.bbox.x1 and box.y0 >= 0, i
        assert not any(box.overlaps(other) for other in boxes[i + 1 :]), i


def test_it_draws_in_axes_given():
    figure, ax = plt.subplots(figsize=(7.0, 4.2))
    drawn = dfc.plot_state_machine(an_axis(), ax=ax)
    assert isinstance(drawn, ct.ControlPlot)
    assert drawn.figure is figure and np.ravel(drawn.axes)[0] is ax
    assert plt.get_fignums() == [figure.number]
