"""The drawn state machine says what the axis does, and fits its axes."""

import numpy as np
import pytest
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch

import dryfric_control as dfc
from dryfric_control import presets

AXIS = dfc.FrictionAxis(
    mass=2.0, viscous=15.0, coulomb=(8.0, 6.0), stribeck=dfc.Stribeck(0.5, 0.01)
)
RANGE = dfc.CoulombMap(plus=[8.0, 10.0], minus=7.0)
ALTERED = dfc.effects.Inertia(factor=3.0), dfc.effects.BiasForce(force=1.0)


@pytest.mark.parametrize(
    ("changes", "there", "absent"),
    [
        # breakaway is (1 + 0.5) times the Coulomb level
        ({}, ["m = 2 kg", "f = 15 N\xb7s/m", "= 8 N", "= 6 N", "p = 500 1/s", "0.0001 m/s",
              "$F_{b+}$ = 12 N", "$F_{b-}$ = 9 N", "$F_+(0)$ = 12 N", "$v = 0$"], ["w: net", "$v < 0$"]),
        (dict(coulomb=RANGE, travel=(0.0, 0.4)), ["$F_{c+}$ = 8 to 12 N", "$F_{c-}$ = 7 N"], []),
        # Effects on base parameters are applied, others named.
        (dict(effects=ALTERED), ["m = 6 kg", "w > F_{b+}", "bias force"], ["u > F_{b+}"]),
        # The rule of the paper changes direction as the velocity does.
        (dict(switching="paper"), ["$v < 0$"], ["$v = 0$"]),
    ],
)  # fmt: skip
def test_what_stands_in_the_drawing(changes, there, absent):
    ax = np.ravel(dfc.plot_state_machine(AXIS.replace(**changes)).axes)[0]
    text = "\n".join(one.get_text() for one in ax.texts)
    assert all(one in text for one in there), text
    assert not any(one in text for one in absent), text


@pytest.mark.parametrize("axis", [
    AXIS, AXIS.replace(stribeck=None),
    AXIS.replace(switching="paper", effects=dfc.effects.Spring(stiffness=2.0)),
    presets.clutch_actuator(), presets.clutch_observer_axis(),
], ids=range(5))  # fmt: skip
def test_no_text_covers_another_or_leaves_the_figure(axis):
    drawn = dfc.plot_state_machine(axis)
    figure, ax = drawn.figure, np.ravel(drawn.axes)[0]
    assert sum(isinstance(patch, FancyBboxPatch) for patch in ax.patches) == 3
    assert sum(isinstance(patch, FancyArrowPatch) for patch in ax.patches) == 6
    figure.canvas.draw()
    renderer = figure.canvas.get_renderer()
    boxes = [text.get_window_extent(renderer) for text in ax.texts]
    for i, box in enumerate(boxes):
        assert box.x0 >= 0 and box.x1 <= figure.bbox.x1 and box.y0 >= 0, i
        assert not any(box.overlaps(other) for other in boxes[i + 1 :]), i
