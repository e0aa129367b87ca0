"""What MuJoCo makes of the files: values that arrive, words of 4.0, motion."""

import numpy as np
import pytest
import simulators as bench

import dryfric_control as dfc
from dryfric_control.simulators import mjcf

mujoco = pytest.importorskip("mujoco", minversion="4.0")

TURNING = ("rad", "N m")
PLAIN = dfc.FrictionAxis(mass=0.3, viscous=0.2, coulomb=1.5, units=TURNING, name="e")
PEAK = PLAIN.replace(stribeck=dfc.Stribeck(0.4, 0.3))
DRAG = PLAIN.replace(effects=(dfc.effects.QuadraticDrag(0.05),))
SOFT = PLAIN.replace(effects=(dfc.effects.Presliding(2e-3, bristles=1.0),))
BODY = '<inertial pos="0 0 0" mass="1" diaginertia="0.1 0.1 0.1"/>'


def text(joint='<joint name="e"/>', before="", after=""):
    return f"<mujoco>{before}<worldbody><body>{joint}{BODY}</body></worldbody>{after}</mujoco>"


@pytest.fixture
def arm(tmp_path):
    return tmp_path / "arm.xml"


def damping(path):
    """All coefficients of the first joint of a file, as MuJoCo has them."""
    model = mujoco.MjModel.from_xml_path(str(path))
    return [model.dof_damping[0], *model.dof_dampingpoly[0]]


@pytest.mark.parametrize(
    ("joint", "before"),
    [
        ('<joint name="e" springdamper="0.1 1"/>', ""),
        ('<joint name="e"/>', '<default><joint springdamper="0.1 1"/></default>'),
        ('<joint name="e" class="a"/>',
         '<default><default class="a"><joint springdamper=".1 1"/></default></default>'),
    ],
)  # fmt: skip
def test_springdamper_does_not_override_what_is_written(arm, joint, before):
    arm.write_text(text(joint, before))
    spring = mujoco.MjModel.from_xml_path(str(arm)).jnt_stiffness[0]
    found = dfc.to_mjcf(PLAIN, arm)
    assert damping(arm) == pytest.approx([0.2, 0.0, 0.0])
    assert mujoco.MjModel.from_xml_path(str(arm)).jnt_stiffness[0] == pytest.approx(spring)
    assert "springdamper" in found.messages[0] and "stiffness stays" in found.messages[0]


def test_springdamper_of_a_spec_does_not_override(arm):
    spec = mujoco.MjSpec.from_string(text('<joint name="e" springdamper="0.1 1"/>'))
    found = dfc.to_mjcf(PLAIN, spec)
    assert spec.compile().dof_damping[0] == pytest.approx(0.2)
    assert "springdamper" in found.messages[0]


@pytest.mark.parametrize("joint", ['<joint name="e" damping="4"/>', '<joint name="e"/>'])
def test_polynomial_damping_of_a_class_is_no_part_of_a_joint(arm, joint):
    arm.write_text(text(joint, '<default><joint damping="1 2 3"/></default>'))
    dfc.to_mjcf(PLAIN, arm, dialect="3.2")
    assert damping(arm) == pytest.approx([0.2, 0.0, 0.0])
    model = mujoco.MjModel.from_xml_string(text('<joint name="e" damping="1 2 3"/>'))
    dfc.to_mjcf(PLAIN, model)
    assert model.dof_dampingpoly[0] == pytest.approx([0.0, 0.0])


def test_words_in_other_attributes_stay(arm):
    joint = """<joint class="x damping='7' y" name='e' damping='4' />"""
    before = """<default><default class="x damping='7' y"/></default>"""
    arm.write_text(text(joint, before))
    dfc.to_mjcf(PLAIN, arm, dialect="3.2")
    assert """<joint class="x damping='7' y" name='e' damping='0.2' """ in arm.read_text()


def test_the_class_of_a_joint_has_its_units(arm):
    sliding = '<default><default class="a"><joint type="slide"/></default></default>'
    arm.write_text(text('<joint name="e" class="a"/>', sliding))
    before = arm.read_bytes()
    with pytest.raises(ValueError, match=r"joint 'e' is in \('m', 'N'\)"):
        dfc.to_mjcf(PLAIN, arm, load=0.1)
    assert arm.read_bytes() == before
    arm.write_text(text('<joint name="e"/>', "<default><joint type='ball'/></default>"))
    with pytest.raises(ValueError, match="'e' is a ball joint"):
        dfc.to_mjcf(PLAIN, arm, load=0.1)


def test_copies_of_a_joint_have_its_values(arm):
    world = f'<body><joint name="e"/>{BODY}</body>'
    for count, sep in ((2, "-"), (3, "_")):
        world = f'<replicate count="{count}" offset="1 0 0" sep="{sep}">{world}</replicate>'
    arm.write_text(f"<mujoco><worldbody>{world}</worldbody></mujoco>")
    found = dfc.to_mjcf(PEAK, arm)
    model = mujoco.MjModel.from_xml_path(str(arm))
    np.testing.assert_allclose(model.dof_armature, np.full(6, 0.2))
    np.testing.assert_allclose(model.dof_frictionloss, found.values["e"]["frictionloss"], 1e-5)
    assert "e: one of 6 copies" in " ".join(found.messages)


def lugre(model, i=0):
    """Parameters of the bristles of an actuator."""
    return [*model.actuator_dynprm[i][5:7], *model.actuator_biasprm[i][3:6]]


def test_a_peak_is_that_of_bristles_and_written_again_once(arm):
    defaults = '<default><motor gear="50" forcerange="-.01 .01"/></default>'
    after = '<actuator><motor name="m" joint="e"/></actuator>'
    arm.write_text(text(before=defaults, after=after))
    plain = arm.read_text()
    for _ in range(2):
        found = dfc.to_mjcf(PEAK, arm)
        assert arm.read_text().count("<dcmotor") == 1
    model = mujoco.MjModel.from_xml_path(str(arm))
    # Stiffness m/h^2; no damping, nearly no level of its own; the peak, its velocity.
    assert lugre(model, 1) == pytest.approx([0.3 / 0.002**2, 0, 6e-5, 0.6, 0.3], rel=1e-3)
    assert model.nu == 1 and model.actuator(0).name == "m"  # no control is added, or moved
    assert model.actuator_gear[1][0] == 1.0 and not model.actuator_forcelimited[1]
    assert [one.what.split(":")[0] for one in found.lost] == []
    assert any("dcmotor" in note for note in found.notes) and "note: dcmotor" in found.summary()
    dfc.to_mjcf(PLAIN, arm, stiff=False)
    attributes = ' frictionloss="1.5" damping="0.2" armature="0.2"'
    kept = f'{attributes} solreffriction="0.002 1" solimpfriction="0.999 0.9999 0.001"'
    bare = arm.read_text().replace("<actuator></actuator>", "")
    assert bare == plain.replace('<joint name="e"', f'<joint name="e"{kept}')


def test_keyframes_have_the_states_of_bristles(arm):
    key = '<keyframe><key name="k" qpos="1" act="0.5"/></keyframe>'
    motor = '<actuator><general name="m" joint="e" dyntype="integrator"/></actuator>'
    arm.write_text(text(after=motor + key))
    dfc.to_mjcf(PEAK, arm)
    model = mujoco.MjModel.from_xml_path(str(arm))
    np.testing.assert_array_equal(model.key_act, [[0.5, 0.0]])


def test_a_spec_gets_the_same_as_a_file(arm):
    arm.write_text(text())
    spec = mujoco.MjSpec.from_string(text())
    for axis in (PEAK, SOFT, DRAG, PLAIN):
        dfc.to_mjcf(axis, arm)
        dfc.to_mjcf(axis, spec)
        one, other = mujoco.MjModel.from_xml_path(str(arm)), spec.compile()
        for name in ("dof_damping", "dof_dampingpoly", "dof_frictionloss", "dof_armature",
                     "dof_solref", "dof_solimp", "actuator_dynprm", "actuator_biasprm"):  # fmt: skip
            np.testing.assert_allclose(getattr(one, name), getattr(other, name), 1e-5, 1e-9, name)


def test_drag_is_polynomial_damping(arm):
    arm.write_text(text())
    found = dfc.to_mjcf(DRAG, arm)
    assert damping(arm) == pytest.approx([0.2, 0.05, 0.0], rel=1e-5) and found.lost == ()
    assert found.values["e"]["damping_quadratic"] == pytest.approx(0.05)
    assert any("MJX leaves out b1, b2" in note for note in found.notes)
    model = mujoco.MjModel.from_xml_string(text())
    dfc.to_mjcf(DRAG, model)
    assert model.dof_dampingpoly[0] == pytest.approx([0.05, 0.0])
    # The words of 3.2 have one coefficient, and say so.
    old = dfc.to_mjcf(DRAG, arm, dialect="3.2")
    assert damping(arm)[1:] == [0.0, 0.0] and "quadratic_drag" in old.lost[0].what


def test_bristles_are_left_out_where_rk4_would_diverge(arm):
    arm.write_text(text(before='<option integrator="RK4"/>'))
    found = dfc.to_mjcf(PEAK, arm)
    assert "RK4" in found.messages[0] and "dcmotor" not in arm.read_text()
    assert any("stribeck" in one.what for one in found.lost)


def test_what_arrives_is_what_is_reported(arm):
    motor = '<actuator><motor name="m" joint="e" damping="0.3" gear="2"/></actuator>'
    arm.write_text(text(after=motor))
    found = dfc.to_mjcf(PLAIN, arm)
    assert "actuator 'm' adds 1.2 to its damping" in found.messages[0]


def test_a_file_that_mujoco_refuses_with_the_values_is_not_written(arm, monkeypatch):
    arm.write_text(text())
    before = arm.read_bytes()
    broken = mjcf.Mjcf.joint_edit

    def edit(*args):
        made = broken(*args)
        return made._replace(new=made.new.replace(b"armature", b"armatur"))

    monkeypatch.setattr(mjcf.Mjcf, "joint_edit", edit)
    with pytest.raises(ValueError, match=r"arm\.xml is refused by MuJoCo.*nothing was written"):
        dfc.to_mjcf(PLAIN, arm)
    assert arm.read_bytes() == before and list(arm.parent.iterdir()) == [arm]


def test_an_actuator_without_a_free_name_has_none(arm):
    arm.write_text(text(after='<actuator><motor name="e_friction" joint="e"/></actuator>'))
    dfc.to_mjcf(PEAK, arm)
    model = mujoco.MjModel.from_xml_path(str(arm))
    assert [model.actuator(i).name for i in range(2)] == ["e_friction", ""]


def test_noslip_iterations_are_an_option(arm):
    for before in ("", '<option timestep="0.001"/>'):
        arm.write_text(text(before=before))
        dfc.to_mjcf(PLAIN, arm, noslip_iterations=3)
        assert mujoco.MjModel.from_xml_path(str(arm)).opt.noslip_iterations == 3
    spec, model = mujoco.MjSpec.from_string(text()), mujoco.MjModel.from_xml_string(text())
    dfc.to_mjcf(PLAIN, spec, noslip_iterations=3)
    dfc.to_mjcf(PLAIN, model, noslip_iterations=3)
    assert spec.option.noslip_iterations == model.opt.noslip_iterations == 3


@pytest.mark.slow
def test_free_runs_are_those_of_mujoco(arm):
    """MuJoCo has the peak in its bristles, and not in the words of 3.2."""
    t = 1e-3 * np.arange(2000)
    u = 3.0 * np.sin(4.0 * t) + 1.2 * np.sin(9.0 * t)
    record = dfc.Record(t, u, PEAK.simulate(u, dt=1e-3).y[0], units={"x": "rad", "u": "N m"})
    fit = dfc.fit(PEAK.replace(mass=0.25), record, free=("mass", "viscous", "coulomb", "stribeck"))
    arm.write_text(text(before='<option timestep="0.001"/>'))
    rich = dfc.to_mjcf(fit, arm, "e").free_runs["e"][1]
    poor = dfc.to_mjcf(fit, arm, "e", dialect="3.2").free_runs["e"][1]
    assert 0.0 < rich < 0.2 * poor


@pytest.mark.slow
@pytest.mark.parametrize("kind", list(bench.MOST))
@pytest.mark.parametrize("dt", bench.STEPS)
def test_mujoco_moves_as_simulate(tmp_path, kind, dt):
    """Two of the joints of benchmarks/simulators.py, which has 20 of each."""
    for seed in (0, 1):
        _, later = bench.errors(kind, seed, dt, tmp_path)
        assert later < bench.MOST[kind], seed


@pytest.mark.parametrize("kind", ["Stribeck", "presliding"])
def test_bristles_stay_stable_at_twice_the_step(tmp_path, kind):
    """As a user may step a file that was written for another step."""
    axis = bench.random_axis(kind, 1)
    u = bench.drive(axis, 2e-3, 1)
    run = bench.mujoco_run(bench.written(axis, tmp_path, 1e-3), u, 2e-3)
    assert bench.off(run, axis.simulate(u, 2e-3).y[0]) < bench.MOST[kind]
