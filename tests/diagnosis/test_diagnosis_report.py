"""What a diagnosis shows: evidence, figures, HTML, the axis as a file, the command."""

import functools
import json
import math
import re
from dataclasses import fields, replace
from html.parser import HTMLParser
from types import SimpleNamespace

import matplotlib
import numpy as np
import pytest
from browser import needs_browser, rendered
from diagnosis_cases import among, driven
from each_effect import EFFECTS
from hypothesis import given, settings
from hypothesis import strategies as st

import dryfric_control as dfc
from dryfric_control.__main__ import main
from dryfric_control.diagnosis.evidence import ENOUGH_IN_BIN, evidence, since_reversal, where
from dryfric_control.diagnosis.joints import JointDiagnoses
from dryfric_control.diagnosis.remaining import Remaining
from dryfric_control.diagnosis.report import figures, findings, wording
from dryfric_control.diagnosis.report.diagnosis import Diagnosis
from dryfric_control.diagnosis.report.findings import LATE, Cause, Gain, Unexplained
from dryfric_control.diagnosis.report.page import html_page, html_summary
from dryfric_control.estimation.windows import cut
from dryfric_control.model.effects.effect import REGISTRY
from dryfric_control.store.axis_file import axis_text, read_axis, write_axis
from dryfric_control.text import typeset_signs

DT, QUANTUM = 1e-3, 4e-6
NAME = '<script>alert("1")</script> & co'
FILES = {"report.html", "report.png", "diagnosis.json", "extended.toml", "saved.json"}


# Stands for an experiment: what the report asks of one.
CRAWL = SimpleNamespace(
    summary=lambda: "crawl & stop, it separates <spring> from gravity",
    to_dict=lambda: {"name": "crawl"},
)


def cause(slug, parameters, errors, alternatives=(), units=None):
    effect = REGISTRY[slug]
    units = units or {name: effect.parameters()[name]["unit"] for name in parameters}
    return Cause(
        slug, effect.title, parameters, errors, units, 1.5, (1.2, 1.8), alternatives,
        effect.explanation, effect.experiment,
    )  # fmt: skip


@pytest.fixture(scope="module")
def found():
    """A diagnosis made by hand: a spring and a bias in a closed loop of 8 s."""
    believed = dfc.FrictionAxis(mass=3.0, viscous=14.0, coulomb=6.0, travel=(0.0, 0.3), name=NAME)
    hidden = dfc.effects.Spring(stiffness=12.0, rest=0.1), dfc.effects.BiasForce(force=0.4)
    machine = believed.replace(effects=hidden)
    target = np.repeat(np.random.default_rng(1).uniform(0.06, 0.24, 10), 800)
    reference = np.convolve(target, np.ones(200) / 200.0, "same")
    loop = dfc.PositionController(kp=4000.0, ki=0.0, kd=220.0, dt=DT, limit=60.0)
    run = dfc.simulate_loop(machine, loop, reference, quantum=QUANTUM, x0=0.15)
    record = dfc.Record(run.t, run.y[4], run.y[5], reference, name="run <7>", quantum=QUANTUM)
    causes = (
        cause("spring", {"stiffness": 12.0, "rest": 0.1}, {"stiffness": 0.1, "rest": math.inf},
              ("gravity",)),
        cause("bias_force", {"force": 0.4}, {"force": 0.01}),
    )  # fmt: skip
    return Diagnosis(
        axis=believed, record=record, verdict="partly explained", causes=causes, extended=machine,
        gain=Gain(9e-4, 1.2e-6, 1.1e-6, (500.0, 900.0), "m"),
        unexplained=Unexplained(0.03, True, ("between x = 0.12 and 0.15 m",)),
        next_experiment=CRAWL, messages=("spring.rest is hardly determined by this record",),
        scores={"": 3.0, "spring": 1.1, "gravity": 1.12, "bias_force": 2.0, "backlash": math.inf},
        window=0.25, roles=np.array([0, 1, 0, 1, 2])[(np.arange(32) // 2) % 5],
    )  # fmt: skip


def test_a_table_of_causes(found):
    rows = found.table("markdown").splitlines()
    assert rows[0] == "| cause | parameter | nominal | value | alternatives |"
    assert rows[2] == "| spring | stiffness | none | 12.00 ± 0.10 N/m | gravity on a rotary axis |"
    assert rows[3] == "| spring | rest | none | 0.1 m (undetermined) | gravity on a rotary axis |"
    assert r"\qty{12.00(10)}{\newton\per\metre}" in found.table("latex")


def test_the_table_of_joints_has_causes_in_words_and_the_inertia_of_what_turns(found):
    units = ("rad", "N m")
    turned = replace(
        found, axis=found.axis.replace(units=units), extended=found.extended.replace(units=units)
    )
    names = "spring, bias force", "spring, bias torque"
    for joints, word, causes in (
        ((found,), "mass", names[:1]),
        ((turned,), "inertia", names[1:]),
        ((found, turned), "mass or inertia", names),
    ):
        table = JointDiagnoses({f"joint{i}": one for i, one in enumerate(joints)}).summary()
        head, *rows = [re.split("  +", line) for line in table.splitlines()]
        assert head[4:7] == [word, "viscous", "coulomb"]
        assert [row[2] for row in rows[: len(joints)]] == list(causes)


@pytest.fixture(scope="module")
def nothing(found):
    """The same record with nothing wrong in the axis."""
    return replace(
        found, axis=found.extended, verdict="nothing to find", causes=(), scores={"": 0.2},
        unexplained=Unexplained(0.0, False, ()), next_experiment=None, messages=(),
    )  # fmt: skip


@pytest.fixture(scope="module")
def uneven(found):
    """Friction uneven in place and direction, and believed numbers a little off."""
    believed = found.axis.replace(stribeck=dfc.Stribeck(0.2, 0.01), name="uneven")
    machine = believed.replace(
        mass=3.06, coulomb=5.4, stribeck=dfc.Stribeck(0.201, 0.0099),
        effects=(
            dfc.effects.PositionDependence(slope=1.5, curvature=3.0, centre=0.15),
            dfc.effects.CoulombAsymmetry(force=-1.0),
            dfc.effects.ViscousAsymmetry(viscous=2.5),
        ),
    )  # fmt: skip
    causes = (
        cause("coulomb_asymmetry", {"force": -1.0}, {"force": 3.8e-5}),
        cause("position_dependence", {"slope": 1.5, "curvature": 3.0},
              {"slope": 4e-4, "curvature": 0.005}),
        cause("viscous_asymmetry", {"viscous": 2.5}, {"viscous": 0.02}),
        cause("stribeck", {"excess": 0.201, "speed": 0.0099}, {"excess": 5e-5, "speed": 4e-5}),
        # 10 % is more than a correction, 2 % is one.
        cause("coulomb", {"coulomb": 5.4}, {"coulomb": 1e-4}, units={"coulomb": "N"}),
        cause("inertia", {"mass": 3.06}, {"mass": 3e-5}, units={"mass": "kg"}),
    )  # fmt: skip
    # The peak alone does worse than other base parameters.
    scores = {"": 6.95, "coulomb_asymmetry": 1.2, "spring": 7.26, "stribeck": 10.0}
    return replace(
        found, axis=believed, extended=machine, causes=causes, scores=scores, verdict="explained",
        unexplained=Unexplained(0.0, False, ()), next_experiment=None, messages=(),
    )  # fmt: skip


page_of = functools.cache(html_page)
plot_of = functools.cache(Diagnosis.plot)


def words_of(text):
    """Text of a page with blanks as they are seen."""
    return re.sub(r"\s+", " ", " ".join(Page(text).text))


@pytest.fixture(scope="module")
def shown(found):
    return evidence(found.axis, found.record, found.window)


@pytest.fixture(scope="module")
def own(found):
    """Evidence of the machine itself."""
    return evidence(found.extended, found.record)


def test_force_residual_is_the_force_that_is_missing(found, shown):
    # The machine has a spring and a bias that the believed axis lacks.
    missing = -12.0 * (shown.x - 0.1) + 0.4
    # The encoder leaves 0.12 N of noise (0.02 of the Coulomb level by design of the smoothing).
    assert np.median(np.abs(shown.residual - missing)) < 0.12
    # The line of one over the other is 1 within five standard errors, 0.12 N / (0.57 N sqrt(2557))
    # each: round-off alone takes a quantised loop elsewhere within its noise.
    slope, offset = np.polyfit(missing, shown.residual, 1)
    assert abs(slope - 1.0) < 0.021
    assert abs(offset) < 5.0 * 0.12 / math.sqrt(shown.residual.size)


def test_free_runs_of_the_machine_itself_err_by_the_encoder_alone(found, shown, own):
    # A rounding error is at most half a quantum, and 0.29 quanta RMS.
    assert np.max(own.error_by_window) < 0.6 * QUANTUM
    assert own.position_rms == pytest.approx(QUANTUM / math.sqrt(12.0), rel=0.2)
    assert shown.position_rms > 50.0 * own.position_rms
    np.testing.assert_allclose(own.positions - found.record.x, own.errors)
    squares = np.add.reduceat(own.errors**2, own.windows.edges[:-1]) / own.windows.samples
    np.testing.assert_allclose(own.error_by_window, np.sqrt(squares))


def test_modes_agree_for_the_machine_and_not_for_the_believed_axis(found, shown, own):
    # A start of motion may be seen a few samples apart, some 20 of them in 8000 samples.
    assert own.stick_slip_mismatch < 0.02
    assert shown.stick_slip_mismatch > 5.0 * own.stick_slip_mismatch
    assert set(np.unique(own.mode_simulated)) == {-1, 0, 1}
    still = evidence(found.axis.replace(coulomb=1000.0), found.record)
    assert np.mean(still.mode_simulated == 0) > 0.8


def test_time_since_reversal():
    t = DT * np.arange(4000)

    def since(*x):
        """Of a motion through places a second apart."""
        path = np.interp(t, np.arange(5.0), x)
        return since_reversal(dfc.Record(t, np.cos(t), 1e-6 * np.round(1e6 * path)))

    found = since(0.1, 0.0, 0.1, 0.0, 0.1)
    assert np.isnan(found[:990]).all()
    # A motion is told from its quantum within a few samples.
    assert found[[1500, 3900]] == pytest.approx([0.5, 0.9], abs=0.01)
    # A rest is no reversal.
    assert np.isnan(since(0.0, 0.1, 0.1, 0.2, 0.3)).all()


PLAIN = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)


def moved(*effects):
    """An axis with effects, and its record under two sines."""
    machine = PLAIN.replace(effects=effects)
    return machine, driven(machine, 6.0)


@pytest.fixture(scope="module")
def smoothed_away():
    """RMS of the residual that the smoothing alone leaves of this motion."""
    return evidence(*moved()).force_rms


@pytest.mark.parametrize(
    "effects",
    [
        (dfc.effects.InputDelay(delay=4e-3),),
        (dfc.effects.InputDelay(delay=4.5e-3), dfc.effects.ActuatorLag(time_constant=3e-3)),
        (dfc.effects.ActuatorLag(time_constant=5e-3), dfc.effects.Saturation(limit=18.0)),
        (dfc.effects.InputGain(gain=1.2), dfc.effects.InputDelay(delay=4e-3)),
        (dfc.effects.EccentricEncoder(amplitude=1e-4, period=0.02),),
    ],
    ids=lambda effects: "+".join(e.slug for e in effects),
)
def test_force_residual_is_behind_the_drive_and_before_the_encoder(effects, smoothed_away):
    machine, record = moved(*effects)
    own, nominal = evidence(machine, record), evidence(PLAIN, record)
    # A drive that was late by 4 ms is no force that is missing: what is left is that of a
    # machine without it, 0.12 N of noise, within what a saturation's corners add.
    assert own.force_rms < 1.3 * smoothed_away < 0.3 * nominal.force_rms
    assert own.hidden == nominal.hidden == 0.0


@pytest.mark.parametrize(
    "effect",
    [dfc.effects.Backlash(gap=1e-3, load_fraction=0.5), dfc.effects.Presliding(distance=5e-5)],
    ids=lambda effect: effect.slug,
)
def test_what_is_no_force_is_left_out_and_said_so(effect, smoothed_away, found):
    machine, record = moved(effect)
    own, nominal = evidence(machine, record), evidence(PLAIN, record)
    assert own.force_rms < 1.3 * smoothed_away < 0.2 * nominal.force_rms
    assert 0.0 < own.hidden < 0.3
    d = replace(found, axis=PLAIN, extended=machine, record=record, causes=())
    before, after = figures.sides(d)
    # Both sides leave out the same, or their sizes would not compare.
    assert before.force_rms == pytest.approx(after.force_rms, rel=0.1)
    assert f"{effect.title} cannot be shown as a force" in wording.hidden_text(d, after.hidden)
    assert wording.hidden_text(replace(d, extended=PLAIN), nominal.hidden) == ""


def test_the_share_of_the_error_that_is_left():
    gain = Gain(4.2e-4, 9e-6, 1.2e-6, (38.0, 56.0), "m")
    assert gain.left == pytest.approx(math.sqrt((9e-6**2 - 1.2e-6**2) / (4.2e-4**2 - 1.2e-6**2)))
    for after, left in ((1e-3, 1.0), (1.1e-6, 0.0)):
        assert Gain(4.2e-4, after, 1.2e-6, (1.0, 1.0), "m").left == left


def test_the_words_of_a_rotary_axis(found):
    """Names of arguments and effects stay: they are what one writes."""
    units = ("rad", "N m")
    mass = Cause(
        "inertia", "inertia error", {"mass": 2.5}, {"mass": 0.1}, {"mass": "kg m^2"}, 1.0,
        (0.5, 1.5), ("bias_force",), "", "",
    )  # fmt: skip
    d = replace(
        found, axis=found.axis.replace(units=units), extended=found.extended.replace(units=units),
        causes=(mass,), remaining=Remaining(0.2, 0.0, True, (), unit="N m"),
    )  # fmt: skip
    said = "inertia 3 -> 2.50 +- 0.10 kg m^2 (-17 %); alternatives: bias torque"
    for words in (" ".join(d.summary().split()), words_of(page_of(d)), repr(d.causes)):
        assert "orque" in words
        rest = re.sub(r"mass = [\d.]+|force = \S+|\w+_force\w*", "", words)
        assert not re.search(r"\b([Ff]orce|mass)\b", rest), rest
    assert said in " ".join(d.summary().split())
    assert str(d.remaining).startswith("random torque left: 0.2 N m")
    assert "Force residual over velocity: the force" in words_of(page_of(found))


def test_parts_of_a_diagnosis_show_themselves(found, nothing):
    causes = found.main_causes
    assert causes == tuple(found.causes) and causes[0] is found.causes[0]
    first, _, second = repr(causes).splitlines()
    assert first.startswith("1. spring: stiffness = 12.00 +- 0.10 N/m, rest = 0.1 m (undetermined)")
    assert second == "2. bias force (bias_force): force = 0.400 +- 0.010 N"
    row = "<td>2</td><td>bias force</td><td>force = 0.400 \xb1 0.010 N</td>"
    assert row in causes._repr_html_()
    assert repr(nothing.causes) == "no causes" and nothing.causes == ()
    left = Remaining(0.2, 0.003, True, ("at <rest>",), (1.0, 10.0), (3e-4, 2e-4))
    assert repr(left) == (
        "random force left: 0.2 N RMS per sample, structured, correlation time 0.003 s\nat <rest>"
    )
    assert "&lt;rest&gt;" in left._repr_html_() and repr(Remaining()) == "no random force left"
    assert repr(found.gain) in wording.gain_text(found)
    said = ["3 % of the error above noise is left", *found.unexplained.where]
    assert repr(found.unexplained).splitlines() == said
    assert repr(nothing.unexplained) == "nothing unexplained beyond noise"
    assert found.unexplained.to_dict()["fraction"] == float(found.unexplained)


@pytest.mark.parametrize(("lead", "doubted"), [(-50.0, True), (1e5, False)])
def test_units_are_doubted_only_where_the_drive_explains_nothing(nothing, lead, doubted):
    level = nothing.extended.coulomb.mean
    loud = replace(
        nothing, verdict="unexplained", remaining=Remaining(5.0 * level),
        references={"nominal axis": 0.0, "straight line": lead},
    )  # fmt: skip
    text = " ".join(loud.details().split())
    assert ("units, signs and clocks" in text) is doubted
    assert ("force_map" in text) is not doubted
    steps = " ".join(wording.next_steps(loud))
    assert ("units, factors and signs" in steps) is doubted and "keep it away" in steps


def test_no_sentence_says_that_all_is_well_where_a_random_force_hides_it(nothing):
    settled = "nothing, as long as it moves"
    assert settled in nothing.details() and not nothing.is_muted
    level = nothing.extended.coulomb.mean
    loud = replace(nothing, verdict="unexplained", remaining=Remaining(5.0 * level))
    text = " ".join(loud.details().split())
    for one in (settled, "no structure found"):
        assert one not in text and one not in words_of(page_of(loud))
    said = (
        f"a random force of {5.0 * level:.3g} N RMS hides what is left, 5 times the Coulomb level"
    )
    assert said in text and said in " ".join(str(loud).split())
    assert loud.unexplained.where[0].startswith(said)
    assert "nothing unexplained" not in repr(loud.unexplained)
    steps = wording.next_steps(loud)
    assert "check(d.axis)" in steps[0] and "load=" in steps[1]
    # Nor where a warning says what is wrong.
    changing = replace(nothing, verdict="unexplained", messages=("something changes",))
    assert settled not in changing.details() and "warnings name" in changing.details()


def test_a_short_rest_between_two_motions_the_same_way_leaves_no_residual():
    machine, record = moved(dfc.effects.Spring(stiffness=40.0, rest=0.05))
    rests = machine.simulate(record.u, dt=DT).events
    # At 4.794 s it comes to rest for 65 ms and goes on the same way.
    assert np.any(np.abs(rests.time[rests.after == 0] - 4.794) < 1e-3)
    assert np.abs(evidence(machine, record).residual).max() < 0.1 * 8.0


def test_friction_that_was_measured_lies_on_the_machine_s_curve(found):
    before, after = figures.sides(found)
    ax = matplotlib.pyplot.figure().subplots()
    figures.draw_friction_curves(found, before, after, ax)
    dots = next(li for li in ax.lines if li.get_marker() == ".")
    v, friction = dots.get_data()
    # 6 N and 14 N s/m; spring and bias are no friction. Noise as in the residual.
    assert np.median(np.abs(friction - 6.0 * np.sign(v) - 14.0 * v)) < 0.12
    assert {"nominal", "with the causes"} <= {li.get_label() for li in ax.lines}


def test_page_shows_what_is_left_and_the_references(found):
    left = Remaining(0.2, 0.003, True, ("x",), (1.0, 10.0, 100.0), (3e-4, 2e-4, 1e-4))
    d = replace(found, remaining=left, references={"nominal axis": 3250.0})
    text = html_page(d)
    words = words_of(text)
    assert "Spectrum of the random force that is left, 0.2 N RMS" in text
    assert "0.2 N RMS per sample, structured, correlation time 0.003 s" in words
    assert "nominal axis +3250" in words and "Spectrum" not in words_of(page_of(found))


@pytest.fixture(scope="module")
def wander():
    """Windows over a motion whose place, speed and time are not tied together."""
    t = DT * np.arange(20_000)
    fast = np.sin(1.7 * t) ** 2 * 0.03 * np.sin(11.0 * t)
    x = 0.15 + 0.06 * np.sin(1.1 * t) + fast
    return cut(dfc.Record(t, np.cos(t), 1e-6 * np.round(1e6 * x)), 0.25)


def parts(windows, mask):
    return np.add.reduceat(mask.astype(float), windows.edges[:-1]) / windows.samples


def near(wander, place):
    """Windows in which the motion is at some place, time, velocity or reversal."""
    x, v, start = wander.record.x, wander.record.derivatives().v, wander.start_times
    return {
        "x": parts(wander, (x > 0.195) & (x < 0.2)) > 0.0,
        "t": (start > 6.0) & (start < 9.0),
        "v": parts(wander, np.abs(v) > 0.2) > 0.3,
        "reversal": parts(wander, np.diff(np.sign(np.gradient(x)), append=0.0) != 0) > 0.0,
    }[place]


@pytest.mark.parametrize(
    ("place", "words", "edges", "off"),
    [
        ("x", "between x = ", [0.195, 0.2], 0.006),  # quantiles, one in forty of the samples
        ("t", "between t = ", [6.25, 9.0], 0.51),  # quantiles of the windows, two windows apart
        ("v", "|v|", [0.2], 0.03),
        ("reversal", "where the motion reverses", [], 0.0),
    ],
)
def test_where_finds_what_bad_windows_share(wander, place, words, edges, off):
    found = where(np.where(near(wander, place), 3.0, 0.2), 1.0, wander, ("rad", "N m"))
    first = next(one for one in found if words in one)
    assert place == "v" or first == found[0]
    numbers = re.findall(r"-?[\d.]+(?:e-?\d+)?", first.split("(")[0])
    np.testing.assert_allclose([float(n) for n in numbers[: len(edges)]], edges, atol=off)
    assert {"x": " rad", "v": " rad/s", "t": " s"}.get(place, "") in first


def test_page_draws_every_panel_with_units(found, nothing, shown):
    plot = plot_of(found)
    axes = plot.axes.ravel()
    assert axes.size == figures.PANELS
    assert "no candidate" not in " ".join(text.get_text() for text in axes[-2].texts)
    for ax in axes:
        data = [np.asarray(line.get_xydata(), float) for line in ax.lines]
        data += [np.array([[patch.get_width(), patch.get_y()]]) for patch in ax.patches
                 if hasattr(patch, "get_width")]  # fmt: skip
        assert data and all(np.isfinite(one).all(axis=1).any() for one in data), ax.get_xlabel()
        assert np.isfinite([*ax.get_xlim(), *ax.get_ylim()]).all()
        assert re.search(r"\[.+\]", ax.get_xlabel())
    ylabels = [ax.get_ylabel() for ax in axes]
    assert ylabels[0].startswith("simulated \N{MINUS SIGN} measured [")
    assert ylabels[1:3] == ["RMS error [\xb5m]", "force residual [N]"]
    assert ylabels[6] == "friction [N]"
    line = next(li for li in axes[1].lines if li.get_label() == "nominal")
    # Motionless windows are drawn at a tenth of the floor.
    np.testing.assert_allclose(
        1e-6 * line.get_ydata(), np.maximum(shown.error_by_window, 0.1 * found.gain.floor)
    )
    words = " ".join(text.get_text() for ax in plot.figure.axes for text in ax.texts)
    assert "partly explained: spring, bias force" in words
    assert "next experiment" in words
    # Without causes one axis is shown.
    axes = nothing.plot().axes.ravel()
    assert "with the causes" not in {line.get_label() for ax in axes for line in ax.lines}
    assert "no candidate had to be tried" in [t.get_text() for t in axes[-2].texts]


def test_no_median_is_drawn_where_there_are_no_samples(found):
    """A machine that rests in between: a line across the rests would show a force in them."""
    t = DT * np.arange(8000)
    u = np.where(t % 1.0 < 0.5, 40.0 * np.sin(8.0 * np.pi * t), 0.0)
    u[:1500] = 0.0
    record = dfc.Record(t, u, found.extended.simulate(u, dt=DT, x0=0.1).y[0])
    side = evidence(found.axis, record)
    _, axes = matplotlib.pyplot.subplots(1, len(figures.AGAINST))
    for by, ax in zip(figures.AGAINST, axes, strict=True):
        figures.draw_residual(side, None, by, ax)
        assert np.isfinite(ax.get_ylim()).all()
    line = next(one for one in axes[list(figures.AGAINST).index("time")].lines
                if one.get_gid() == "median")  # fmt: skip
    at, median = line.get_xdata(), line.get_ydata()
    width = at[1] - at[0]
    inside = [np.count_nonzero(np.abs(side.t - one) <= 0.5 * width) for one in at]
    np.testing.assert_array_equal(np.isfinite(median), np.array(inside) >= ENOUGH_IN_BIN)
    assert np.isnan(median).any() and np.isfinite(median).any()
    matplotlib.pyplot.close("all")


def test_a_median_beside_none_has_a_mark(found):
    t = np.concatenate(([0.0], np.linspace(5.0, 5.01, 20), [10.0]))
    side = evidence(found.axis, found.record)
    few = replace(side, t=t, x=t, v=t, residual=np.ones(t.size), since_reversal=t)
    _, ax = matplotlib.pyplot.subplots()
    figures.draw_residual(few, None, "time", ax)
    line = next(one for one in ax.lines if one.get_gid() == "median")
    assert line.get_marker() == "." and np.count_nonzero(line.get_markevery()) == 1
    matplotlib.pyplot.close("all")


def test_a_record_of_one_direction_is_drawn(found):
    """No sample runs backwards, and none follows a reversal."""
    side = evidence(found.axis, found.record)
    forwards = replace(
        side, v=np.abs(side.v) + 1e-6, since_reversal=np.full_like(side.since_reversal, np.nan)
    )
    for by in ("position", "reversal"):
        _, ax = matplotlib.pyplot.subplots()
        figures.draw_residual(forwards, None, by, ax)
        medians = [one.get_ydata() for one in ax.lines if one.get_gid() == "median"]
        assert medians[-1].size == 0
    matplotlib.pyplot.close("all")


def test_nothing_in_the_page_overlaps(found):
    """However much text stands above the panels."""
    said = tuple(f"message {i} of many" for i in range(30))
    figure = replace(found, messages=said).plot().figure
    figure.canvas.draw()
    boxes = [ax.get_tightbbox() for ax in figure.axes[1:]]
    page = figure.bbox
    for i, one in enumerate(boxes):
        # One pixel: boxes are rounded outwards.
        assert one.x0 > page.x0 - 1 and one.x1 < page.x1 + 1
        assert one.y0 > page.y0 - 1 and one.y1 < page.y1 + 1
        for other in boxes[:i]:
            wide = min(one.x1, other.x1) - max(one.x0, other.x0)
            high = min(one.y1, other.y1) - max(one.y0, other.y0)
            assert wide < 1 or high < 1
    text = [t.get_window_extent() for t in figure.axes[0].texts]
    assert min(t.y0 for t in text) > max(box.y1 for box in boxes)
    assert max(t.x1 for t in text) < page.x1
    assert all(f"warning: {one}" in figure.axes[0].texts[1].get_text() for one in said)


def labels(ax):
    return [tick.get_text() for tick in ax.get_yticklabels()]


def test_bars_are_sorted_and_the_named_stand_out(found, uneven):
    ax = plot_of(found).axes.ravel()[-2]
    bars = [patch for patch in ax.patches if patch.get_width() > 0.0]
    # Finite ones, best on top: half the fall of the score at each of 8000 samples.
    ends = [bar.get_x() + bar.get_width() for bar in bars]
    assert ends == pytest.approx([4000.0 * g for g in (1.9, 1.88, 1.0)])
    assert [bar.get_x() for bar in bars] == [1.0] * 3
    assert labels(ax) == ["1. spring", "gravity on a rotary axis", "2. bias force"]
    assert bars[1].get_hatch() and not bars[0].get_hatch()
    assert bars[0].get_facecolor() == bars[2].get_facecolor() != bars[1].get_facecolor()
    # What does no good alone has no bar.
    ax = uneven.plot().axes.ravel()[-2]
    assert [patch.get_width() > 0.0 for patch in ax.patches if patch.get_width()] == [True]
    assert labels(ax) == ["1. Coulomb asymmetry", "Stribeck peak"]
    assert "No better on their own: spring." in words_of(page_of(uneven))
    assert " useful only in combination" in [text.get_text() for text in ax.texts]
    assert ax.get_xlim()[0] == 1.0


def test_a_bar_is_more_than_chance(found):
    scores = {"": 0.0, "spring": -0.008, "bias_force": -0.004, "gravity": 1e-3, "drift": -1e-3}
    d = replace(found, scores=scores)
    ax = d.plot().axes.ravel()[-2]
    # Half the fall of the score at each of 8000 samples; 4 is no more than chance.
    bars = [patch.get_x() + patch.get_width() for patch in ax.patches]
    assert bars == pytest.approx([32.0, 16.0])
    assert [text.get_text() for text in ax.texts] == [" useful only in combination"]  # gravity
    # Where there is nothing to find no bar is drawn, however long.
    none = replace(d, verdict="nothing to find", causes=())
    assert not none.plot().axes.ravel()[-2].patches
    # Without any bar a sentence stands there.
    flat = replace(found, scores={"": 3.0, "spring": 3.0, "gravity": 3.4})
    ax = flat.plot().axes.ravel()[-2]
    assert not ax.patches and not ax.axison
    sentence = " ".join(ax.texts[0].get_text().split())
    assert sentence.endswith("Coulomb level. In combination: spring + bias force.")
    assert sentence in words_of(page_of(flat)) and "Bars:" not in page_of(flat)


def test_scale_of_the_force_holds_zero_and_every_median(found):
    for ax in plot_of(found).axes.ravel()[2:6]:
        low, high = ax.get_ylim()
        assert low < 0.0 < high
        legend = [line.get_label() for line in ax.lines]
        assert legend.count("its median") + legend.count("with the causes") == 2
        for line in ax.lines:
            if line.get_marker() != ".":
                values = np.asarray(line.get_ydata(), float)
                assert low < np.nanmin(values) and np.nanmax(values) < high, line.get_label()


@pytest.mark.slow
def test_small_corrections_stand_apart_everywhere(uneven, found):
    assert [c.effect for c in uneven.small_corrections] == ["stribeck", "inertia"]
    assert [c.effect for c in uneven.main_causes] == [
        "coulomb_asymmetry", "position_dependence", "viscous_asymmetry", "coulomb",
    ]  # fmt: skip
    assert found.small_corrections == ()
    heading = "small corrections of nominal values"
    for text in (uneven.summary(), words_of(html_summary(uneven))):
        text = re.sub(r"\s+", " ", text).replace("\u2192", "->").replace("\u00b1", "+-")
        causes, _, small = text.partition(heading if heading in text else heading.capitalize())
        for change in (
            "excess 0.2 -> 0.201000 +- 0.000050 (+0.5 %)",
            "speed 0.01 -> 0.009900 +- 0.000040 m/s (-1 %)",
            "mass 3 -> 3.060000 +- 0.000030 kg (+2 %)",
        ):
            assert change in small and change not in causes, change
        assert "coulomb 6 -> 5.40000 +- 0.00010 N (-10 %)" in causes
        assert heading.capitalize() not in words_of(html_summary(found))
    assert uneven.to_dict()["causes"][3]["believed"] == {"excess": 0.2, "speed": 0.01}


def test_the_first_lines_name_every_cause_and_what_differs_between_records(uneven):
    lines = str(uneven).splitlines()
    more = "and 3 more: Coulomb level error (-10 %), Stribeck peak (+0.5 %), inertia error (+2 %)"
    assert more in lines and len(lines) <= 12
    values = {"values": [3.0, 5.5], "standard_errors": [0.01, 0.01]}
    varied = replace(uneven, varies={"mass": values, "coulomb": values}, others=(uneven.record,))
    lines = str(varied).splitlines()
    assert lines[1].startswith("differs from record to record: mass = 3.000 +- 0.010, 5.500")
    assert any(line.startswith("and 5 more: viscous asymmetry, Coulomb level") for line in lines)
    assert "coulomb by record" in " ".join(map(str.strip, lines))


def test_which_way_is_harder_is_told_in_newtons(uneven):
    x = np.array(uneven.to_dict()["coulomb_level"]["x"])
    shape = 1.0 + 1.5 * (x - 0.15) + 3.0 * (x - 0.15) ** 2
    for words in (uneven.summary(), words_of(html_summary(uneven))):
        text = re.sub(r"\s+", " ", words).replace("\xb7", " ")
        for force, name in ((4.4, "forwards"), (6.4, "backwards")):
            rows = zip(force * shape, x, strict=True)
            places = ", ".join(f"{level:.3g} N at x = {p:.3g} m" for level, p in rows)
            assert f"{name}: {places}" in text
        assert "viscous friction (x grows forwards): forwards 16.5 N s/m, backwards 11.5" in text
        # Two causes act on the level: it is told once.
        assert text.count("Coulomb level found") == 1


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        (12.0, 0.1, "12.00 +- 0.10"),
        (-1.010704, 3.78e-5, "-1.010704 +- 0.000038"),
        (5.0, 0.0996, "5.00 +- 0.10"),
        (123456.0, 996.0, "123500 +- 1000"),
        (48.3, 120.0, "50 +- 120"),
        (0.01, 3.162, "0.01 +- 3.2"),
        (0.033, 1100.0, "0.033 (undetermined)"),  # as of a stop that is never reached
        (3.0e-7, 2e-9, "(3.000 +- 0.020)e-07"),
        (2.5e9, 3e7, "(2.500 +- 0.030)e+09"),
        (0.0, 2e-6, "(0.0 +- 2.0)e-06"),
        (0.123456, math.inf, "0.123 (undetermined)"),
        (0.5, 0.0, "0.5"),
    ],
)
def test_errors_have_two_digits(value, error, text):
    assert findings.with_error(value, error) == text


@pytest.mark.slow
def test_what_to_do_next_runs_with_the_numbers_of_the_record(found, tmp_path, monkeypatch):
    text = "".join(Page(page_of(found)).text)
    assert "axis_file" not in text
    code = re.search(r"(import dryfric_control as dfc.*?)The file", text, re.DOTALL)[1]
    asked = []
    monkeypatch.setattr(
        dfc, "design_pi_observer", lambda axis, **given: asked.append((axis, given))
    )
    monkeypatch.chdir(tmp_path)
    write_axis(found.extended, "extended.toml")
    names = {"u": found.record.u[:100]}
    exec(code, names)
    assert asked == [(found.extended, {"dt": DT, "encoder_quantum": QUANTUM})]
    assert names["run"].time[1] == pytest.approx(DT)


class Page(HTMLParser):
    """Checks that tags close in order, and collects what they hold."""

    VOID = frozenset({"meta", "img", "br"})

    def __init__(self, text):
        super().__init__()
        self.open, self.tags, self.attributes, self.text = [], [], [], []
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.attributes += [(tag, *pair) for pair in attrs]
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open and self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)


def test_page_stands_alone_and_escapes(found):
    text = page_of(found)
    page = Page(text)
    assert text.startswith("<!DOCTYPE html>")
    assert "script" not in page.tags and "link" not in page.tags
    for _, name, value in page.attributes:
        if name in ("src", "href"):
            assert value.startswith("data:image/svg+xml;base64,")
    assert not re.search(r"https?://|url\(|@import", text)
    words = " ".join(page.text)
    assert NAME in words and "run <7>" in words
    alts = [value for _, name, value in page.attributes if name == "alt"]
    assert len(alts) == page.tags.count("img") >= 4
    assert all(len(alt) > 20 for alt in alts)
    assert not re.search(r"\bnan\b|\binf\b", words)


# Goes into a copy of the page, and writes down what only the page can see.
PROBE = """
<script>addEventListener("load", () => {
  const page = document.documentElement, probe = document.createElement("script");
  probe.type = "application/json"; probe.id = "probe";
  probe.textContent = JSON.stringify({
    images: [...document.images].map(one => [one.complete, one.naturalWidth]),
    wide: page.scrollWidth - innerWidth});
  document.body.append(probe);
});</script>
"""


def test_a_page_is_drawn_once_there_is_a_place_for_it(found, tmp_path, monkeypatch):
    def refuse(*_):
        raise AssertionError("drawn before the path was looked at")

    monkeypatch.setattr("dryfric_control.diagnosis.report.diagnosis.html_page", refuse)
    look = found.record.explore(found.axis)
    monkeypatch.setattr(look, "_columns", refuse)
    for write in (found.to_html, look.to_html):
        with pytest.raises(FileNotFoundError, match="folder that does not exist"):
            write(tmp_path / "nodir" / "r.html")
        with pytest.raises(IsADirectoryError, match="name a file in it"):
            write(tmp_path)


@pytest.mark.slow
@needs_browser
@pytest.mark.parametrize("width", [1280, 400])
def test_a_browser_shows_the_page_whole(found, tmp_path, width):
    page, copy = page_of(found), tmp_path / "copy.html"
    copy.write_text(page.replace("</head>", PROBE + "</head>"), encoding="utf-8")
    dom = rendered(copy.as_uri(), tmp_path, width)
    seen = re.search(r'<script type="application/json" id="probe">(.*?)</script>', dom)
    seen = json.loads(seen[1])
    assert len(seen["images"]) == page.count("<img ") >= 4
    # As large as a telephone is wide; no pixel that does not fit.
    assert all(complete and pixels >= 400 for complete, pixels in seen["images"])
    assert seen["wide"] <= 0


def test_page_and_summary_show_everything(found, nothing, uneven):
    words = " ".join(Page(page_of(found)).text)
    for part in (
        "partly explained",
        "stiffness = 12.00 \u00b1 0.10 N/m",
        "rest = 0.1 m (undetermined)",
        "gravity on a rotary axis",
        "between x = 0.12 and 0.15 m",
        "separates <spring> from gravity",
        "hardly determined",
        found.causes[0].explanation,
        found.causes[1].experiment,
        "error reduction (factor) 750 (90 %: 500 to 900)",
        "1.2 \u00b5m",
        typeset_signs(found.extended.describe()),
        axis_text(found.extended),
    ):
        assert part in words, part
    page = Page(html_summary(found))
    assert not {"img", "html", "script"} & set(page.tags) and "table" in page.tags
    assert found._repr_html_() == html_summary(found)
    assert "table" not in Page(html_summary(nothing)).tags
    for d in (found, uneven):
        for text in (page_of(d), html_summary(d)):
            assert words_of(text).count("random error of this record, not errors of the model") == 1


def test_json_round_trips_without_nan(found, tmp_path):
    def refuse(name):
        raise AssertionError(name)

    data = json.loads(found.to_json(tmp_path / "d.json"), parse_constant=refuse)
    assert data == json.loads((tmp_path / "d.json").read_text())
    assert data["causes"][0]["standard_errors"] == {"stiffness": 0.1, "rest": None}
    assert "backlash" not in data["scores"]
    json.dumps(evidence(found.axis, found.record).to_dict(), allow_nan=False)


@settings(max_examples=60)
@given(
    mass=st.floats(1e-12, 1e12),
    viscous=st.floats(0.0, 1e9),
    plus=st.lists(st.floats(0.1, 50.0), min_size=1, max_size=4),
    minus=st.lists(st.floats(0.1, 50.0), min_size=1, max_size=4),
    excess=st.floats(0.0, 5.0),
    name=st.text(st.characters(codec="utf-8"), max_size=20),
    peak=st.booleans(),
)
def test_axis_file_round_trips(tmp_path_factory, mass, viscous, plus, minus, excess, name, peak):
    axis = dfc.FrictionAxis(
        mass=mass, viscous=viscous, coulomb=dfc.CoulombMap(plus, minus),
        stribeck=dfc.Stribeck(excess, 0.01) if peak else None, stick_speed=3e-5,
        stick_rate=700.0, travel=(0.0, 0.3), switching="paper", name=name, units=("rad", "N m"),
    )  # fmt: skip
    path = tmp_path_factory.mktemp("axis") / "axis.toml"
    write_axis(axis, path)
    back = read_axis(path)
    for item in fields(axis):
        assert getattr(back, item.name) == getattr(axis, item.name), item.name
    assert [p.name for p in path.parent.iterdir()] == ["axis.toml"]


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: effect.slug)
def test_every_effect_round_trips(effect, tmp_path):
    effects = (effect,) if effect.slug == "spring" else (effect, dfc.effects.Spring(12.0, rest=0.1))
    axis = PLAIN.replace(effects=effects)
    write_axis(axis, tmp_path / "axis.toml")
    assert read_axis(tmp_path / "axis.toml") == axis


@pytest.mark.parametrize(
    ("level", "expected"),
    [
        ("8.0", dfc.CoulombMap(8.0)),
        ("8", dfc.CoulombMap(8.0)),
        ("[8.0, 7.5]", dfc.CoulombMap(8.0, 7.5)),
        ("{plus = [8.0, 1.0], minus = [7.0]}", dfc.CoulombMap([8.0, 1.0], [7.0])),
        ("{plus = 8.0}", dfc.CoulombMap(8.0)),
        ("{plus = 8.0, minus = 0.0}", dfc.CoulombMap(8.0, 0.0)),
    ],
)
def test_levels_in_every_form(tmp_path, level, expected):
    path = tmp_path / "axis.toml"
    path.write_text(f"mass = 2.0\nviscous = 15.0\ncoulomb = {level}\ntravel = [0.0, 0.3]\n")
    assert read_axis(path).coulomb == expected


@pytest.mark.slow
def test_command_writes_the_report(found, tmp_path, monkeypatch, capsys):
    asked = []

    def diagnose(axis, record, **options):
        """A search that answers at once."""
        asked.append((axis, record))
        return found

    monkeypatch.setattr("dryfric_control.__main__.diagnose", diagnose)
    columns = np.column_stack([found.record.t, found.record.u, found.record.x])
    record, axis, out = (tmp_path / name for name in ("run.csv", "axis.toml", "out"))
    np.savetxt(record, columns, delimiter=",", header="t,u,x", comments="", fmt="%.12g")
    write_axis(found.axis, axis)
    # The experiment of these tests is none that a file can hold.
    monkeypatch.setitem(found.__dict__, "next_experiment", None)
    assert main(["diagnose", str(record), "--axis", str(axis), "--out", str(out)]) == 0
    ((given_axis, given_record),) = asked
    assert given_axis == found.axis
    np.testing.assert_allclose(given_record.x, found.record.x, atol=1e-9)
    assert {path.name for path in out.iterdir()} == FILES
    assert found.summary() in capsys.readouterr().out
    assert read_axis(out / "extended.toml") == found.extended
    assert dfc.Diagnosis.load(out / "saved.json").summary() == found.summary()
    assert json.loads((out / "diagnosis.json").read_text())["verdict"] == "partly explained"
    assert (out / "report.png").read_bytes().startswith(b"\x89PNG")
    Page((out / "report.html").read_text())


def test_records_that_were_diagnosed_together_are_named(found):
    r = found.record
    a, b, c = (dfc.Record(r.t, r.u, r.x, quantum=r.quantum, name=name) for name in "abc")
    first = replace(found, record=a, others=(b, c))
    assert str(first).startswith(f"verdict: {found.verdict} (of 3 records: a, b, c)")
    page = html_page(first)
    assert "3 records: a, b, c" in page
    # Curves, table and footer are of the first one, and say so.
    assert '<th scope="col">record a, the first of 3</th>' in page
    captions = re.findall("<figcaption>(.*?)</figcaption>", page)
    assert sum(one.endswith("Record a, the first of 3.") for one in captions) >= 8
    assert "the first of" not in page_of(found)


def test_what_is_advised_next(found):
    """More time before an effect of one's own; no motion where a gain does the same."""
    left = replace(found.unexplained, significant=True)
    steps = wording.next_steps(replace(found, unexplained=left, messages=(LATE,)))
    more, own = (i for i, one in enumerate(steps) if "more time" in one or "register" in one)
    assert more < own and "diagnose(d.extended, record)" in steps[more]
    wrong = cause("inertia", {"mass": 2.5}, {"mass": 0.1},
                  ("input_gain+viscous+coulomb",), {"mass": "kg"})  # fmt: skip
    too = cause("viscous", {"viscous": 20.0}, {"viscous": 0.1},
                ("input_gain+inertia+coulomb",), {"viscous": "N s/m"})  # fmt: skip
    # The same advice for all of them is said once.
    steps = wording.next_steps(replace(found, causes=(wrong, too), next_experiment=None))
    (step,) = [one for one in steps if one.startswith("Separate")]
    assert f"{wrong.title} from" in step and f"{too.title} from" in step
    assert "known mass" in step and 'known=("mass",)' in step
    # A parameter at its bound is no structure that is left.
    loose = replace(
        found, verdict="partly explained", unexplained=replace(left, significant=False),
        messages=(f"{found.causes[0].effect}.any ended at a bound",),
    )  # fmt: skip
    assert any(one.startswith("Determine") for one in wording.next_steps(loose))
    assert "does not determine them" in html_summary(loose)


@pytest.mark.slow
def test_a_level_that_changes_over_the_record_is_told_once():
    t = 1e-3 * np.arange(6000)
    u = 4.0 * np.sin(6.0 * t) + 2.0 * np.sin(15.4 * t)
    plant = dfc.FrictionAxis(
        mass=0.5, viscous=1.0, coulomb=2.25, units=("rad", "N m"),
        effects=(dfc.effects.WarmUp(rise=-0.4, time_constant=1.5),),
    )  # fmt: skip
    x = 1e-5 * np.round(1e5 * plant.simulate(u, dt=1e-3).y[0])
    nominal = plant.replace(coulomb=1.35, effects=())
    with among("warm_up", "drift", "stribeck"):
        d = dfc.diagnose(nominal, dfc.Record(t, u, x), jobs=1, progress=False)
    text = " ".join(str(d).split())
    # 2.25 (1 - 0.4), and 2.25 (1 - 0.4 exp(-4)) at the end.
    assert "1. warm-up (warm_up): Coulomb level 1.35 -> 2.23 N m within 6 s" in text
    assert "2. " not in text and "1. warm-up" in " ".join(d.details().split())


def test_viscous_friction_that_changes_over_the_record_is_told_once(found):
    warm_up = dfc.effects.ViscousWarmUp(rise=20.0, time_constant=4.0)
    machine = found.axis.replace(viscous=10.0, effects=(warm_up,))
    causes = (
        cause("viscous_warm_up", {"rise": 20.0, "time_constant": 4.0},
              {"rise": 0.1, "time_constant": 0.1}),
        cause("viscous", {"viscous": 10.0}, {"viscous": 0.1}, units={"viscous": "N s/m"}),
    )  # fmt: skip
    text = " ".join(str(replace(found, extended=machine, causes=causes)).split())
    # 10 + 20, and 10 + 20 exp(-2) at the end of 8 s; 14 was nominal.
    assert "viscous friction 30 -> 12.7 N s/m within 8 s (rise = 20.00" in text
    assert "2. " not in text and "viscous 14" not in text
