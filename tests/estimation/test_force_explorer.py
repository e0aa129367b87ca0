"""The force that a model lacks, redrawn while its numbers are turned."""

import io
import json
import re

import numpy as np
import pytest
from browser import needs_browser, rendered
from matplotlib.image import imread

import dryfric_control as dfc

T = 1e-3 * np.arange(4000)
AXIS = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)


@pytest.fixture(scope="module")
def record():
    u = 20.0 * np.sin(6.0 * T) + 12.0 * np.sin(17.0 * T + 1.0)
    spring = dfc.effects.Spring(stiffness=40.0)
    x = AXIS.replace(effects=(spring,)).simulate(u, 1e-3).y[0]
    return dfc.Record(T, u, 1e-6 * np.round(1e6 * x))


def test_the_right_numbers_leave_nothing_and_are_an_axis(record):
    look = record.explore(AXIS.replace(mass=1.5, coulomb=6.0))
    before = look.rms
    middle = 0.5 * (record.x.min() + record.x.max())
    # A spring at rest at 0 is one at rest in the middle and a constant force.
    look.set(mass=2.0, coulomb=8.0, stiffness=40.0, constant=-40.0 * middle)
    assert look.rms < 0.05 * before
    assert look.rms == pytest.approx(record.force_map(look.axis).rms, rel=0.2)  # another kernel
    spring, push = look.axis.effects
    assert (spring.stiffness, spring.rest, push.force) == (40.0, middle, -40.0 * middle)
    with pytest.raises(ValueError, match="explore.mas is not known. Did you mean 'mass'"):
        look.set(mas=1.0)
    assert [ax.get_xlabel() for ax in look.plot().axes.ravel()] == [
        "velocity [m/s]",
        "position [m]",
    ]


def test_only_the_dots_of_the_picture_move(record):
    look = record.explore(AXIS)
    one = imread(io.BytesIO(look.png()))
    again = imread(io.BytesIO(look.png()))
    look.set(coulomb=8.4)
    other = imread(io.BytesIO(look.png()))
    assert np.array_equal(one, again) and one.shape == other.shape
    changed = np.any(one != other, axis=2)
    assert changed.any() and not changed[-20:].any()  # the axis below is the frame
    assert "coulomb = 8.4" in repr(look) and look._repr_png_() == look.png()


def test_sliders_turn_the_numbers(record):
    widgets = pytest.importorskip("ipywidgets")
    look = record.explore(AXIS)
    panel = look.panel(widgets)
    *rows, picture = panel.children
    labels = [row.children[0].description for row in rows]
    assert labels == [one.label for one in look.sliders.values()]
    assert labels[0] == "mass" and rows[3].children[1].value == "of Coulomb level"
    before = picture.value
    rows[2].children[0].value = 6.0
    assert look.axis.coulomb.mean == 6.0 and picture.value != before
    assert rows[2].children[1].value == "N"


def test_a_rotary_axis_has_inertia_and_torque(record, tmp_path):
    turning = dfc.FrictionAxis(inertia=2.0, viscous=15.0, coulomb=8.0)
    look = record.explore(turning)
    labels = {name: (one.label, one.unit) for name, one in look.sliders.items()}
    assert labels["mass"] == ("inertia", "kg m^2") and labels["constant"][0] == "constant torque"
    assert labels["excess"] == ("Stribeck peak", "of Coulomb level")
    text = look.to_html(tmp_path / "look.html").read_text()
    shown = dict(re.findall(r'<label for="(\w+)">(.*?)</label>', text))
    assert shown == {name: label for name, (label, _) in labels.items()}
    look.set(inertia=3.0)
    assert look.axis.inertia == 3.0
    assert "\ninertia = 3, viscous" in repr(look) and ".set(inertia=...)" in repr(look)
    assert "\nmass = 2, viscous" in repr(record.explore(AXIS))


TURNED = {"mass": 2.0, "viscous": 15.0, "coulomb": 9.0, "excess": 0.3, "stiffness": 3.0,
          "constant": -0.4}  # fmt: skip


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    """The page, and the RMS of its dots with other numbers."""
    axis = dfc.FrictionAxis(mass=2.4, viscous=12.0, coulomb=7.0)
    look = dfc.datasets.belt_stage().explore(axis)
    path = look.to_html(tmp_path_factory.mktemp("page") / "look.html")
    data = json.loads(re.search(r'id="data">(.*?)</script>', path.read_text())[1])
    speed = data["speeds"][8]
    look.set(stribeck_speed=speed, **TURNED)
    dots = look.missing[look._shown]
    return path, data, TURNED | {"stribeck_speed": speed}, dots


def test_the_page_holds_the_force_as_a_sum_over_the_numbers(page):
    _, data, values, dots = page
    left = np.array(data["base"])
    for name, column in data["columns"].items():
        left += values[name] * np.array(column)
    left += values["excess"] * values["coulomb"] * np.array(data["peaks"][8])
    # Six digits of each column.
    np.testing.assert_allclose(left, dots, atol=1e-3)


@pytest.mark.slow
@needs_browser
def test_a_browser_draws_the_page_with_the_numbers_of_its_address(page, tmp_path):
    path, _, values, dots = page
    numbers = "&".join(f"{name}={value}" for name, value in values.items())
    dom = rendered(f"{path.as_uri()}#{numbers}", tmp_path)
    rms = np.sqrt(np.mean(dots**2))
    assert f"force missing in the model: {rms:.3g} N RMS" in dom
