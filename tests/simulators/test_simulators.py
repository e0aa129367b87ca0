"""Values in simulators' files: the numbers, the other bytes, what is lost, the motion."""

import math
import re
from xml.etree import ElementTree
from xml.sax import saxutils

import numpy as np
import pytest

import dryfric_control as dfc
from dryfric_control.__main__ import main
from dryfric_control.model.friction_curve import friction_over_velocity
from dryfric_control.simulators.mujoco_model import axes_of

DT = 2e-3
T = DT * np.arange(4000)
U = 3.0 * np.sin(2.0 * T) + 1.2 * np.sin(7.0 * T + 0.5)
TURNING = ("rad", "N m")
PLAIN = dfc.FrictionAxis(
    mass=0.25, viscous=0.3, coulomb=1.2, stick_speed=1e-3, units=TURNING, name="elbow"
)
PEAK = PLAIN.replace(stribeck=dfc.Stribeck(0.4, 0.3), coulomb=(1.3, 1.1))

# Comments, quotes of both kinds, blanks and brackets where a reader might stumble.
MJCF = b"""<?xml version="1.0"?>\r
<mujoco model="arm">
  <!-- <joint name="elbow" damping="9"/> -->
  <default><joint damping="5" frictionloss="7"/><default class="x > y"><joint armature="3"/></default></default>
  <option timestep="0.002"/>
  <worldbody>
    <body name="upper > lower">
      <inertial pos="0 0 0" mass="1" diaginertia="0.05 0.05 0.05"/>
      <joint   name='elbow'	axis="0 0 1"
             damping = '0.05' class="x > y" />
      <body pos="1 0 0">
        <inertial pos="0 0 0" mass="1e-3" diaginertia="1e-3 1e-3 1e-3"/>
        <joint name="slider" type="slide" axis="0 0 1" class="x > y"/>
      </body>
    </body>
  </worldbody>
  <actuator><motor name="elbow" joint="elbow"/></actuator>
</mujoco>
"""
URDF = b"""<robot name="arm">
  <link name="a"/><link name="b"/>
  <joint name="elbow" type="revolute">
    <parent link="a"/><child link="b"/>
    <limit effort="1" velocity="1" lower="-1" upper="1"/><dynamics friction='0.1'/>
  </joint>
  <joint name="wrist" type="continuous">
    <parent link="b"/><child link="c"/>
  </joint>
  <transmission name="t"><joint name="elbow"/></transmission>
</robot>
"""
MO = b"""model Arm "BearingFriction elbow(tau_pos=[0, 9])"
  // BearingFriction elbow(tau_pos=[0, 8]);
  Modelica.Mechanics.Rotational.Components.BearingFriction elbow(useSupport=false, tau_pos=[0, 1; 2, 3],
    w(start=0)) "a bearing )" annotation (Placement(transformation(extent={{0,0},{1,1}})));
  Modelica.Mechanics.Rotational.Components.BearingFriction wrist;
end Arm;
"""


@pytest.fixture(scope="module")
def fitted():
    x = PLAIN.simulate(U, dt=DT).y[0]
    record = dfc.Record(T, U, x, units={"x": "rad", "u": "N m"})
    return dfc.fit(PLAIN.replace(mass=0.2, coulomb=1.0), record)


@pytest.fixture
def arm(tmp_path):
    (tmp_path / "arm.xml").write_bytes(MJCF)
    return tmp_path / "arm.xml"


@pytest.fixture
def modelica(tmp_path):
    (tmp_path / "Arm.mo").write_bytes(MO)
    return tmp_path / "Arm.mo"


def test_mjcf_keeps_every_other_byte(arm):
    dfc.to_mjcf(PLAIN, arm, load=0.05, stiff=False)
    old = b"""damping = '0.05' class="x > y" />"""
    new = b"""damping = '0.3' class="x > y" frictionloss="1.2" armature="0.2" />"""
    assert MJCF.count(old) == 1
    assert arm.read_bytes() == MJCF.replace(old, new)


def test_urdf_keeps_every_other_byte(tmp_path):
    path, out = tmp_path / "arm.urdf", tmp_path / "out.urdf"
    path.write_bytes(URDF)
    joints = {"elbow": PLAIN, "wrist": PLAIN.replace(coulomb=0.5)}
    found = dfc.simulators.to_urdf(joints, path, out=out)
    right = URDF.replace(b"friction='0.1'", b"friction='1.2' damping=\"0.3\"")
    added = b'"continuous">\n    <dynamics damping="0.3" friction="0.5"/>\n'
    right = right.replace(b'"continuous">\n', added)
    assert out.read_bytes() == right and path.read_bytes() == URDF
    assert found.files == (out,)


def test_modelica_keeps_every_other_byte(modelica):
    joints, table = {"elbow": PLAIN, "wrist": PLAIN}, b"tau_pos=[0, 1.2; 1, 1.5]"
    dfc.simulators.to_modelica(joints, modelica, velocities=[-1.0, 1.0])
    right = MO.replace(b"tau_pos=[0, 1; 2, 3]", table)
    right = right.replace(b"w(start=0))", b"w(start=0), peak=1)")
    right = right.replace(b"wrist;", b"wrist(" + table + b", peak=1);")
    assert modelica.read_bytes() == right


TABLE = "tau_pos=[0, 1.2; 1, 1.5]"


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("e[3]", f"e[3](each {TABLE}, each peak=1)"),
        ("e[2](tau_pos={[0, 1], [0, 2]})", f"e[2](each {TABLE}, each peak=1)"),
        ("e[2](each final peak=2)", f"e[2](each final peak=1, each {TABLE})"),
        ("a, e, b(w=1)", f"a, e({TABLE}, peak=1), b(w=1)"),
        ("e(w(tau_pos=[0, 9]))", f"e(w(tau_pos=[0, 9]), {TABLE}, peak=1)"),
        ("e(tau_pos(each unit=\"N.m\")=[0, 9], peak=2)",
         f"e(tau_pos(each unit=\"N.m\")={TABLE[8:]}, peak=1)"),
        ("e if on", f"e({TABLE}, peak=1) if on"),
    ],
)  # fmt: skip
def test_modelica_modifiers_of_other_shapes(tmp_path, before, after):
    model = 'model Arm\n  Rotational.Components.BearingFriction {} "friction";\nend Arm;\n'
    path = tmp_path / "Arm.mo"
    path.write_text(model.format(before))
    dfc.simulators.to_modelica({"e": PLAIN}, path, velocities=[-1.0, 1.0])
    assert path.read_text() == model.format(after)


def test_modelica_arrays_of_a_type_and_names_in_quotation_marks(tmp_path):
    model = "model Arm\n  BearingFriction[2] e{};\n  BearingFriction 'a (b'{};\nend Arm;\n"
    path = tmp_path / "Arm.mo"
    path.write_text(model.format("", ""))
    joints = {"e": PLAIN, "'a (b'": PLAIN}
    dfc.simulators.to_modelica(joints, path, velocities=[-1.0, 1.0])
    right = model.format(f"(each {TABLE}, each peak=1)", f"({TABLE}, peak=1)")
    assert path.read_text() == right


def test_a_modelica_component_that_is_there_twice_is_refused(tmp_path):
    path = tmp_path / "Arm.mo"
    path.write_text("model A BearingFriction e; end A; model B BearingFriction e; end B;")
    with pytest.raises(ValueError, match="2 components 'e': give a file with one"):
        dfc.simulators.to_modelica({"e": PLAIN}, path, velocities=[-1.0, 1.0])


# Harmless text that has the signs of the languages it is written in.
NAMES = ["elbow", 'el"bow', "el'bow", "arm\\bow", "a\nb", 'a": 1, str(seen.append(1)): 2, "b',
         "', disp(1), '", "naïve µ", "\u2028", "{x}", "a%b", "\t"]  # fmt: skip


@pytest.mark.parametrize("name", NAMES)
def test_names_of_joints_are_names_in_python(tmp_path, name):
    dfc.simulators.to_isaac({name: PLAIN}, tmp_path / "f.py", load=0.1)
    space = {"seen": []}
    exec((tmp_path / "f.py").read_text("utf-8"), space)
    assert list(space["JOINT_FRICTION"]["friction"]) == [name] and space["seen"] == []


@pytest.mark.parametrize("name", NAMES)
def test_names_of_blocks_are_names_in_matlab(tmp_path, name):
    """Read back by MATLAB's rules for text: '' is a quotation mark, char(n) a character."""
    dfc.simulators.to_simscape({name: PLAIN}, tmp_path / "f.m")
    lines = (tmp_path / "f.m").read_text("utf-8").splitlines()
    assert len(lines) == 4
    for line in lines:
        text = re.match(
            r"set_param\((\[.*?\]|char\(\d+\)|'(?:[^']|'')*'), '\w+', '[^']*', '\w+', '[^']*'\);$",
            line,
        )
        pieces = re.findall(r"'((?:[^']|'')*)'|char\((\d+)\)", text[1])
        assert "".join(t.replace("''", "'") or chr(int(n)) for t, n in pieces) == name


def test_names_that_no_file_can_hold_are_refused(tmp_path):
    with pytest.raises(ValueError, match="no text that a file can hold"):
        dfc.simulators.to_isaac({"\ud800": PLAIN}, tmp_path / "f.py", load=0.1)


@pytest.mark.parametrize("name", ["el'bow", 'el"bow', "a<b & c>", "naïve"])
def test_names_of_joints_are_names_in_xml(tmp_path, name):
    quoted = saxutils.quoteattr(name)
    urdf = tmp_path / "a.urdf"
    urdf.write_text(f'<robot><joint name={quoted} type="continuous"/></robot>', "utf-8")
    urdf.write_text(urdf.read_text("utf-8").replace("/></robot>", "></joint></robot>"), "utf-8")
    dfc.simulators.to_urdf({name: PLAIN}, urdf)
    joint = ElementTree.parse(urdf).find("joint")
    assert joint.get("name") == name and joint.find("dynamics").get("friction") == "1.2"
    mjcf = tmp_path / "a.xml"
    body = f'<body><joint name={quoted}/><inertial pos="0 0 0" mass="1" diaginertia=".1 .1 .1"/></body>'
    mjcf.write_text(f"<mujoco><worldbody>{body}</worldbody></mujoco>", "utf-8")
    dfc.to_mjcf({name: PEAK}, mjcf, load=0.1, dialect="4.0")
    motor = ElementTree.parse(mjcf).find("actuator/dcmotor")
    assert (motor.get("joint"), motor.get("name")) == (name, f"{name}_friction")


def test_modelica_without_a_value_is_refused_and_kept(modelica):
    damaged = MO.replace(b"tau_pos=[0, 1; 2, 3]", b"tau_pos=)0, 1; 2, 3]")
    modelica.write_bytes(damaged)
    with pytest.raises(ValueError, match="'elbow': tau_pos has no value"):
        dfc.simulators.to_modelica({"elbow": PLAIN}, modelica, velocities=[-1.0, 1.0])
    assert modelica.read_bytes() == damaged


def test_modelica_states_a_stribeck_peak(modelica):
    axis = PEAK.replace(coulomb=1.2)
    found = dfc.simulators.to_modelica({"elbow": axis}, modelica)
    rows = np.array(found.values["elbow"]["table"])
    at = rows[rows[:, 0] > 0.0]
    friction = friction_over_velocity(axis, at[:, 0], 0.0)
    np.testing.assert_allclose(at[:, 1], friction, rtol=0.02)  # of a table of 17 rows
    assert rows[0, 1] == pytest.approx(1.4 * 1.2)


def test_simscape_curve_is_that_of_the_axis(tmp_path):
    """The blocks' own equation, written out, at the numbers of the script."""
    axis = PEAK.replace(coulomb=1.2, name="arm/Elbow's friction")
    found = dfc.simulators.to_simscape(axis, tmp_path / "f.m")
    text = (tmp_path / "f.m").read_text()
    assert text.count("set_param('arm/Elbow''s friction', ") == 4
    p = {n: float(v) for n, v in re.findall(r"'(\w+)', '([-\d.e]+)'", text)}
    w = np.linspace(0.01, 2.0, 200)
    near = w / (math.sqrt(2.0) * p["brkwy_vel"])
    curve = (
        math.sqrt(2.0 * math.e) * (p["brkwy_trq"] - p["Col_trq"]) * near * np.exp(-(near**2))
        + p["Col_trq"] * np.tanh(10.0 * w / p["brkwy_vel"])
        + p["visc_coef"] * w
    )
    off = curve - friction_over_velocity(axis, w, 0.0)
    # Stated by the result, over its own velocities; the shapes of the peaks differ.
    assert np.sqrt(np.mean(off**2)) < 2.0 * found.friction_error["arm/Elbow's friction"] < 0.2
    assert p["brkwy_trq"] > p["Col_trq"]


def test_isaac_states_the_breakaway(tmp_path):
    found = dfc.simulators.to_isaac({"elbow": PEAK}, tmp_path / "f.py", load=0.05)
    space = {}
    exec((tmp_path / "f.py").read_text(), space)
    values = {name: one["elbow"] for name, one in space["JOINT_FRICTION"].items()}
    assert values["friction"] == pytest.approx(1.4 * 1.2)
    assert values["armature"] == pytest.approx(0.2)
    dynamic = found.values["elbow"]["dynamic_friction"]
    assert values["dynamic_friction"] == pytest.approx(dynamic, rel=1e-5)
    assert not any("breakaway" in one.what for one in found.lost)


def test_values_are_least_squares_over_the_record(arm):
    """By numpy, at the velocities of the simulation itself."""
    run = PEAK.simulate(U, dt=DT)
    v = run.y[1][np.abs(run.y[1]) > 0.02]
    friction = friction_over_velocity(PEAK, v, 0.0)
    c, d = np.linalg.lstsq(np.column_stack((np.sign(v), v)), friction, rcond=None)[0]
    found = dfc.to_mjcf(PEAK, arm, velocities=v, load=0.05, dialect="3.2")
    assert found.values["elbow"]["frictionloss"] == pytest.approx(c)
    assert found.values["elbow"]["damping"] == pytest.approx(d)
    off = friction - c * np.sign(v) - d * v
    assert found.friction_error["elbow"] == pytest.approx(np.sqrt(np.mean(off**2)))
    # What is lost adds up to the error: a peak, and half the difference of the levels.
    parts = {one.what.split()[0]: one.error for one in found.lost}
    assert parts.keys() == {"stribeck:", "Coulomb", "breakaway"}
    assert parts["Coulomb"] == pytest.approx(0.1, rel=0.3)


def test_a_fit_has_errors_and_free_runs(fitted, arm):
    found = dfc.to_mjcf(fitted, arm, load=0.05, dialect="3.2")
    values, errors = found.values["elbow"], found.standard_errors["elbow"]
    assert values["frictionloss"] == pytest.approx(1.2, rel=1e-3)
    names = {"armature": "mass", "damping": "viscous", "frictionloss": "coulomb"}
    right = {new: fitted.standard_errors[old] for new, old in names.items()}
    assert errors == pytest.approx(right, rel=1e-3)
    whole, less = found.free_runs["elbow"]
    # Nothing is lost of a plain axis, but MuJoCo's own; its steps of 2 ms lead by up to 1 ms.
    assert whole < less < 1e-3 * np.abs(np.gradient(fitted.training[0].windows.record.x, DT)).max()
    assert found.lost == ()
    assert "written: arm.xml" in found.summary()


def test_a_modelica_table_of_few_velocities_is_the_curve(modelica):
    """A knot between the samples would be free, and its friction zero."""
    speeds = np.array([0.1, 0.5, 1.0])
    dfc.simulators.to_modelica(PLAIN, modelica, velocities=np.r_[speeds, -speeds])
    (table,) = re.findall(rb"tau_pos=\[([\d., ;e-]*)\],\s*w\(start", modelica.read_bytes())
    rows = [[float(cell) for cell in row.split(b",")] for row in table.split(b";")]
    expected = [[0.0, 1.2], *([w, 1.2 + 0.3 * w] for w in speeds)]
    np.testing.assert_allclose(rows, expected, rtol=1e-5)


def driven(mujoco, path, u):
    """Positions of the elbow in MuJoCo under a held torque."""
    model = mujoco.MjModel.from_xml_path(str(path))
    model.opt.timestep = DT
    model.opt.gravity[:] = 0.0
    data = mujoco.MjData(model)
    at = model.joint("elbow").dofadr[0]
    x = []
    for one in u:
        x.append(data.qpos[at])
        data.qfrc_applied[at] = one
        mujoco.mj_step(model, data)
    return np.array(x)


@pytest.mark.parametrize(("stiff", "most"), [(False, 4e-2), (True, 4e-3)])
def test_round_trip_through_mujoco(arm, stiff, most):
    """MuJoCo driven as the record against `simulate`; its friction is soft, see howto/simulator."""
    mujoco = pytest.importorskip("mujoco")
    arm.write_bytes(re.sub(rb'<joint name="slider".*/>', b"", MJCF))
    found = dfc.to_mjcf(PLAIN, arm, stiff=stiff)
    # Of the bodies: 0.05 + 1e-3 + 1e-3 m^2 kg of the outer one.
    assert found.values["elbow"]["armature"] == pytest.approx(0.25 - 0.052)
    x = PLAIN.simulate(U, dt=DT).y[0]
    off = driven(mujoco, arm, U) - x
    share = np.sqrt(np.mean(off**2)) / np.std(x)
    print(f"stiff={stiff}: off by {100.0 * share:.2g} % of the standard deviation of the position")
    assert share < most


def test_a_model_gives_the_nominal_axes_of_its_joints(tmp_path):
    """What the command `joints` starts from without a file of axes."""
    pytest.importorskip("mujoco")
    path = tmp_path / "arm.xml"
    path.write_bytes(MJCF)
    elbow, slider = axes_of(path)["elbow"], axes_of(path)["slider"]
    assert (elbow.units, slider.units) == (TURNING, ("m", "N"))
    assert elbow.viscous == 0.05
    # Its own body and, at a metre, that of the slider; armature of the class.
    assert elbow.mass == pytest.approx(0.05 + 1e-3 + 1e-3 + 3.0)
    assert slider.mass == pytest.approx(1e-3 + 3.0)


def test_a_stiff_joint_creeps_less(tmp_path):
    """0.1 kg m^2 at rest under 0.5 N m, of 1 N m that should hold."""
    mujoco = pytest.importorskip("mujoco")
    axis = dfc.FrictionAxis(mass=0.1, viscous=0.0, coulomb=1.0, units=TURNING, name="elbow")
    body = '<joint name="elbow"/><inertial pos="0 0 0" mass="1" diaginertia="0.1 0.1 0.1"/>'
    creeping = []
    for stiff in (False, True):
        path = tmp_path / "arm.xml"
        path.write_text(f"<mujoco><worldbody><body>{body}</body></worldbody></mujoco>")
        dfc.to_mjcf(axis, path, stiff=stiff)
        x = driven(mujoco, path, np.full(4000, 0.5))
        creeping.append((x[-1] - x[2000]) / (DT * 1999))
        print(f"stiff={stiff}: creeps at {1e3 * creeping[-1]:.2g} mrad/s")
    assert 0.0 < creeping[1] < creeping[0] / 30.0


def test_command_line(fitted, arm, tmp_path, capsys):
    fitted.save(tmp_path / "fit.json")
    dfc.write_axis(PLAIN.replace(units=("m", "N")), tmp_path / "slide.toml")
    files = [f"elbow={tmp_path / 'fit.json'}", f"slider={tmp_path / 'slide.toml'}"]
    options = ["--model", str(arm), "--load", "elbow=0.05,slider=0.1"]
    assert main(["simulator", *files, *options, "--out", str(tmp_path / "new.xml")]) == 0
    assert "written: new.xml" in capsys.readouterr().out
    assert arm.read_bytes() == MJCF
    assert (tmp_path / "new.xml").read_bytes().count(b"frictionloss=") == 3
    assert main(["simulator", *files[:1], "--model", str(tmp_path / "f.m"), "--stiff"]) == 2
    assert "--stiff is for mjcf, not simscape" in capsys.readouterr().err
    assert main(["simulator", str(tmp_path / "fit.json"), "--model", str(tmp_path / "f.m")]) == 0
    assert "set_param('elbow'" in (tmp_path / "f.m").read_text()
