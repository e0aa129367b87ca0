"""Plots and texts of results: shapes, titles, styles, units, lines that fit a page."""

import functools
import warnings

import matplotlib.pyplot as plt
import numpy as np
import pytest

import dryfric_control as dfc
from dryfric_control import presets
from dryfric_control.drawing import panels
from dryfric_control.text import WIDTH, Result, plain_data, typeset_signs

AXIS = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0, travel=(0.0, 0.3), name="stage")
T = 1e-3 * np.arange(2000)
CONTROLLER = dfc.PositionController.from_bandwidth(AXIS, 20.0, 1e-3)
R = 0.1 + 0.05 * np.sin(6.0 * T)
PLOTS = {
    "record": 2, "response": 4, "fit": 2, "replay": 2, "replayed loop": 3, "slow ramp": 2,
    "levels": 1, "estimate": 3, "observed loop": 4, "maps": 1, "position": 2, "speed": 2,
    "friction": 2, "mode": 2, "monte_carlo": 4,
}  # fmt: skip


@pytest.fixture(scope="module")
def run():
    return presets.clutch_experiment(duration=2.0)


@pytest.fixture(scope="module")
def plots(run):
    """How each result is drawn."""
    loop = dfc.simulate_loop(AXIS, CONTROLLER, R, quantum=1e-6, x0=0.1)
    record = dfc.Record(T, loop.y[4], loop.y[5], R, name="a run")
    with warnings.catch_warnings(action="ignore", category=dfc.FitWarning):
        found = dfc.fit(AXIS, record, free=("mass",), starts=1)
    ramp = dfc.slow_ramp_experiment(AXIS, duration=10.0, quantum=1e-6)
    parts = ("maps", "position", "speed", "friction", "mode")
    return {what: functools.partial(run.plot, what=what) for what in parts} | {
        "record": record.plot, "response": loop.plot, "fit": found.plot,
        "replay": found.training[0].plot, "slow ramp": ramp.plot, "estimate": run.estimate.plot,
        "replayed loop": dfc.replay_loop(AXIS, record, CONTROLLER).plot, "observed loop": run.plot,
        "levels": dfc.identify_coulomb(ramp.record, degree=0, axis=AXIS).plot,
        "monte_carlo": presets.clutch_monte_carlo(runs=2, duration=0.5, progress=False).plot,
    }  # fmt: skip


@pytest.mark.parametrize(("name", "panels"), PLOTS.items())
def test_panels_stand_in_a_column_under_a_title_that_can_be_chosen(name, panels, plots):
    drawn = plots[name]()
    assert drawn.axes.shape == drawn.lines.shape == (panels, 1)
    for lines, one in zip(drawn.lines[:, 0], drawn.axes[:, 0], strict=True):
        assert lines == list(one.lines)
    assert drawn.axes[0, 0].get_title(loc="left")
    words = "a rather long title, so that the legend of the panel has no room"
    drawn = plots[name](title=words)
    top = drawn.axes[0, 0]
    assert top.get_title(loc="left").startswith("a rather long title")
    drawn.figure.canvas.draw()
    title = top._left_title.get_window_extent()
    assert top.get_legend() is None or not title.overlaps(top.get_legend().get_window_extent())


def test_record_says_its_units_and_hides_no_data():
    record = dfc.Record(T, np.sin(T), R, R)
    drawn = record.plot()
    assert drawn.axes[0, 0].get_ylabel() == "position [m]"
    drawn.figure.canvas.draw()
    legend = drawn.axes[0, 0].get_legend().get_window_extent()
    assert legend.y0 >= drawn.axes[0, 0].get_window_extent().y1 - 1.0  # above the panel
    turned = dfc.Record(T, np.sin(T), R, units={"x": "rad"}).plot()
    assert [one.get_ylabel() for one in turned.axes[:, 0]] == ["position [rad]", "input"]


def test_friction_over_velocity_is_that_of_the_laws():
    axis = AXIS.replace(
        coulomb=(8.0, 7.0), stribeck=dfc.Stribeck(excess=0.3, speed=0.01), stick_speed=1e-3,
        effects=(dfc.effects.QuadraticDrag(drag=10.0), dfc.effects.Spring(stiffness=500.0)),
    )  # fmt: skip
    drawn = axis.plot_friction(speed=0.1)
    line = drawn.lines[0, 0][0]
    v, force = line.get_data()
    way = np.where(np.signbit(v), -1.0, 1.0)
    level = np.where(way > 0, 8.0, 7.0)
    peak = 1.0 + 0.3 * np.exp(-(((np.abs(v) - 1e-3) / 0.01) ** 2))
    # A spring is no friction. Rounding alone.
    np.testing.assert_allclose(force, way * level * peak + 15.0 * v + 10.0 * v * np.abs(v))
    assert v[0] == -0.1 and v[-1] == 0.1 and np.any(v == 1e-3)
    assert [text.get_text() for text in drawn.axes[0, 0].texts] == ["10.4 N", "9.1 N"]


def test_friction_that_depends_on_the_position_is_a_band():
    axis = AXIS.replace(effects=(dfc.effects.PositionDependence(slope=2.0, centre=0.15),))
    (band,) = axis.plot_friction(span=(0.1, 0.2)).axes[0, 0].collections
    edge = band.get_paths()[0].vertices
    # 8 (1 + 2 (x - 0.15)) N at both ends of the span, and 15 N s/m.
    reach = edge[:, 1][edge[:, 0] == edge[:, 0].max()]
    assert [reach.min(), reach.max()] == pytest.approx([7.2 + 4.0, 8.8 + 4.0])
    assert not AXIS.plot_friction().axes[0, 0].collections
    for bad in ({"speed": 0.0}, {"span": (0.2, 0.1)}, {"span": 3.0}):
        with pytest.raises(ValueError, match=next(iter(bad))):
            AXIS.plot_friction(**bad)


def test_a_loop_shows_its_tracking_error():
    run = dfc.simulate_loop(AXIS, CONTROLLER, R, quantum=1e-6, x0=0.1)
    drawn = run.plot()
    labels = [one.get_ylabel() for one in drawn.axes[:, 0]]
    assert labels == ["position [m]", "error [mm]", "velocity [m/s]", "force [N]"]
    np.testing.assert_allclose(drawn.lines[1, 0][0].get_ydata(), 1e3 * (R - run.y[0]))
    # What follows no reference has no such error.
    assert AXIS.simulate([9.0] * 10, dt=1e-3).plot().axes.shape == (3, 1)


def test_results_are_shown_in_the_units_of_their_axis(run):
    peak = dfc.Stribeck(0.3, 0.01)
    axis = AXIS.replace(effects=(dfc.effects.Spring(200.0),), stribeck=peak, name="<x>")
    page = axis._repr_html_()
    assert page.count("<tr>") == 11 and "&lt;x&gt;" in page
    for words in ("2 kg", "15 N\xb7s/m", "8 N", "spring: stiffness = 200 N/m", "0 to 0.3 m"):
        assert words in page
    assert "mass 2 kg\n" in AXIS.describe() and "travel 0 to 0.3 m" in AXIS.describe()
    assert "inertia 2 kg m^2\n" in AXIS.replace(units=("rad", "N m")).describe()
    assert "inertia 3e-07 N m s^2/inc\n" in presets.clutch_actuator().describe()
    design = presets.clutch_observer()
    text = design.summary()
    assert "N m/inc" in text and " inc, drift" in text.replace("\n", " ")
    assert "G [N\xb7m/inc]" in design._repr_html_()
    assert "N/m" not in text + design._repr_html_()
    assert repr(design) == text and max(map(len, text.splitlines())) <= WIDTH
    assert repr(design.certificate) == design.certificate.summary()
    score = repr(run.score)
    assert score.startswith("EstimateScore(position=") and len(score) < 110
    assert dir(dfc) == sorted(dfc.__all__)


class Shown(Result):
    """A result as small as can be."""

    def _summary_parts(self):
        yield [("name <1>", "value"), ("drag", "2 N s/m")]
        yield "error 3 um +- 1 um & more"
        yield "    " + "indented words " * 8

    @panels(2, sharex=False)
    def plot(self, axes):
        """Draw nothing much."""
        axes[1].set_xlabel("torque [N m]")
        return "own title"


def test_what_is_shown_is_said_once():
    one = Shown()
    lines = one.summary().splitlines()
    assert lines[:3] == ["name <1>  value", "drag      2 N s/m", "error 3 um +- 1 um & more"]
    # What is left of an indented line stands further in.
    assert lines[3].startswith("    indented") and lines[4].startswith(8 * " " + "indented")
    assert repr(one) == one.summary()
    page = one._repr_html_()
    assert '<th scope="col">name &lt;1&gt;</th>' in page and "<td>2 N\xb7s/m</td>" in page
    assert "<p>error 3 \xb5m \xb1 1 \xb5m &amp; more</p>" in page


def test_panels_make_a_plot_with_a_title():
    drawn = Shown().plot()
    assert drawn.axes.shape == (2, 1)
    assert drawn.axes[0, 0].get_title(loc="left") == "own title"
    assert drawn.axes[1, 0].get_xlabel() == "torque [N\xb7m]"
    given = plt.figure().subplots(2)
    again = Shown().plot(given, title="another")
    assert again.axes[0, 0] is given[0] and given[0].get_title(loc="left") == "another"
    with pytest.raises(ValueError, match="ax must hold 2 axes"):
        Shown().plot(given[:1])


def test_units_are_typeset_and_words_are_not():
    for text, printed in (
        ("N m s^2/rad", "N\xb7m\xb7s\xb2/rad"), ("kg m^2", "kg\xb7m\xb2"), ("[um]", "[\xb5m]"),
        ("-3 um", "-3 \xb5m"), ("8 N on the um scale", "8 N on the um scale"),
    ):  # fmt: skip
        assert typeset_signs(text) == printed


def test_plain_data_is_what_json_takes_and_levels_come_as_arrays():
    value = {"a": np.float64(np.nan), "b": (np.int64(2), np.array([1.0, np.inf])), "c": "text"}
    assert plain_data(value) == {"a": None, "b": [2, [1.0, None]], "c": "text"}
    assert AXIS.replace(coulomb=np.array([8.0, 7.0])).coulomb == dfc.CoulombMap(8.0, 7.0)
    assert AXIS.replace(coulomb=np.array(8.0)).coulomb == dfc.CoulombMap(8.0)


def test_a_figure_for_a_journal_has_its_width_and_nothing_is_cut_off(plots):
    own = plt.rcParams["font.size"]
    for columns, width in ((1, 3.5), (2, 7.16)):
        with dfc.drawing.journal(columns):
            drawn = [plots[name]() for name in ("record", "response", "replay", "levels")]
            for one in drawn:
                one.figure.canvas.draw()
                edge = one.figure.get_tightbbox()
                # Within the page, to a hundredth of an inch; the fonts are those of a caption.
                assert edge.x0 > -0.01 and edge.x1 < width + 0.01
                assert one.figure.get_figwidth() == width
                for ax in one.axes.ravel():
                    assert ax.xaxis.label.get_size() == 8.0 and not ax.get_title("left")
                    assert ax.bbox.height > 0.4 * one.figure.dpi
                plt.close(one.figure)
    assert plt.rcParams["font.size"] == own
    with pytest.raises(ValueError, match="columns must be 1 or 2"), dfc.drawing.journal(3):
        pass
