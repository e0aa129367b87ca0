"""Inverse dynamics of arms against closed forms, and models that are refused."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

import dryfric_control as dfc

mujoco = pytest.importorskip("mujoco")

from dryfric_control.arm.error_regression import Compact  # noqa: E402
from dryfric_control.arm.rigid_model import Motion, RigidArm  # noqa: E402

RNG = np.random.default_rng(0)


def compiled(bodies, more=""):
    text = f"<mujoco><compiler angle='radian'/><worldbody>{bodies}</worldbody>{more}</mujoco>"
    return mujoco.MjModel.from_xml_string(text)


def link(joint, inside="", kind="hinge", axis="0 1 0", mass=2.0, at="0 0 0", extra=""):
    return (
        f'<body name="{joint}_link" pos="{at}"><joint name="{joint}" type="{kind}" axis="{axis}" '
        f'{extra}/><inertial pos="0.3 0 0.1" mass="{mass}" diaginertia="0.02 0.05 0.05"/>'
        f"{inside}</body>"
    )


def motion(n, joints):
    return Motion(*RNG.standard_normal((3, n, joints)))


def test_a_pendulum_with_a_rotor_by_its_closed_form():
    arm = RigidArm(compiled(link("a", extra='armature="0.7" damping="3" frictionloss="5"')))
    m = motion(20, 1)
    force, inertia = arm.forces(m)
    about = 0.05 + 2.0 * (0.3**2 + 0.1**2) + 0.7
    # The centre of mass is at the angle of (0.3, 0.1), which a rotation about +y lowers.
    weight = -2.0 * 9.81 * (0.3 * np.cos(m.q) + 0.1 * np.sin(m.q))
    np.testing.assert_allclose(force, about * m.a + weight, rtol=1e-12)
    np.testing.assert_allclose(inertia, about)
    assert arm.friction["a"] == (3.0, 5.0) and arm.units["a"] == ("rad", "N m")


def test_a_slide_under_gravity_of_a_base_that_lies():
    model = compiled(link("s", kind="slide", axis="0 0 1"))
    m = motion(5, 1)
    upright = RigidArm(model).forces(m)[0]
    lying = RigidArm(model, gravity=(0.0, 9.81, 0.0)).forces(m)[0]
    np.testing.assert_allclose(upright, 2.0 * (m.a + 9.81))
    np.testing.assert_allclose(lying, 2.0 * m.a)
    assert RigidArm(model).units["s"] == ("m", "N") and model.opt.gravity[2] == -9.81


def chain():
    end = '<body name="hand" pos="0 0.1 0"><inertial pos="0 0 0.05" mass="0.3" diaginertia="1e-3 1e-3 1e-3"/></body>'
    last = link("c", end, axis="1 0 0", at="0.4 0 0")
    return compiled(link("a", link("b", last, at="0.5 0.1 0"), axis="0 0 1", extra='armature="1"'))


def test_the_regressor_times_the_inertial_parameters_is_the_force():
    model, m = chain(), motion(30, 3)
    arm = RigidArm(model)
    links = arm.links()
    assert [one.name for one in links] == ["a_link", "b_link", "c_link"] and links[-1].last
    force = np.einsum(
        "njlp,lp->nj", arm.regression_matrix(m, links), [one.inertial for one in links]
    )
    rotors = model.dof_armature * m.a
    np.testing.assert_allclose(force + rotors, arm.forces(m)[0], atol=1e-10)


def test_the_factor_of_a_links_mass_is_none_of_its_payload():
    place = np.array([0.1, 0.0, 0.2])
    second = np.eye(3) * (place @ place) - np.outer(place, place)
    moments = tuple(0.8 * second[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)))
    payload = SimpleNamespace(
        kind="payload", link="c_link", value=0.8, place=tuple(place), moments=moments
    )
    heavier = SimpleNamespace(kind="mass", link="c_link", value=1.5, place=(), moments=())
    arm, m = RigidArm(chain()), motion(30, 3)
    matrix = arm.regression_matrix(m, arm.links())[:, :, -1]
    more = 0.5 * arm.links()[-1].inertial + [0.8, *(0.8 * place), *moments]
    true = arm.forces(m)[0] + matrix @ more
    for errors in ([payload, heavier], [heavier, payload]):
        np.testing.assert_allclose(arm.without(errors).forces(m)[0], true, atol=1e-10)


def test_a_payload_is_a_mass_at_its_place():
    place, m = np.array([0.02, -0.1, 0.3]), motion(30, 3)
    arm = RigidArm(chain())
    one = RigidArm(chain(), payload={"hand": (0.8, place)}).forces(m)[0]
    last = arm.links()[-1]
    at = place + [0.0, 0.1, 0.0]  # the hand is fixed to the last link
    second = np.eye(3) * (at @ at) - np.outer(at, at)
    added = [1.0, *at, *second[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]]
    by_regressor = arm.regression_matrix(m, [last])[:, :, 0] @ (0.8 * np.array(added))
    np.testing.assert_allclose(one - arm.forces(m)[0], by_regressor, atol=1e-10)


def test_a_coupled_joint_goes_with_its_leader():
    """Two wheels, the second turns at -2 times the first: its inertia counts four times."""
    wheel = '<body><joint name="{0}" axis="0 0 1"/><inertial pos="0 0 0" mass="1" diaginertia="0.5 0.5 {1}"/></body>'
    coupling = '<equality><joint joint1="b" joint2="a" polycoef="0.3 -2 0 0 0"/></equality>'
    arm = RigidArm(compiled(wheel.format("a", 0.5) + wheel.format("b", 0.2), coupling))
    m = motion(5, 1)
    force, inertia = arm.forces(m)
    assert arm.joints == ("a",)
    np.testing.assert_allclose(inertia, 0.5 + 4.0 * 0.2)
    np.testing.assert_allclose(force, 1.3 * m.a)


def test_a_urdf_with_a_mimic_joint_and_a_mesh_that_is_missing(tmp_path):
    part = (
        '<link name="{0}"><visual><geometry><mesh filename="package://x/none.stl"/></geometry>'
        '</visual><inertial><mass value="1"/><origin xyz="0 0 0"/><inertia ixx="0.1" iyy="0.1" '
        'izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    )
    joint = (
        '<joint name="j{0}" type="revolute"><parent link="base"/><child link="{0}"/><axis xyz="0 0 1"/>'
        '<limit lower="-2" upper="2" effort="9" velocity="9"/>{1}</joint>'
    )
    text = '<robot name="r"><link name="base"/>' + part.format("a") + part.format("b")
    text += joint.format("a", '<dynamics damping="0.2" friction="0.4"/>')
    text += joint.format("b", '<mimic joint="ja" multiplier="3"/>') + "</robot>"
    path = tmp_path / "r.urdf"
    path.write_text(text)
    arm = RigidArm(path)
    assert arm.joints == ("ja",) and arm.limits("ja") == (-2.0, 2.0)
    assert arm.friction["ja"] == (0.2, 0.4)
    np.testing.assert_allclose(arm.forces(motion(3, 1))[1], 0.1 * (1.0 + 9.0))


@pytest.mark.parametrize(
    ("bodies", "more", "says"),
    [
        ('<body><freejoint/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body>', "", "floating base .*gravity="),
        (link("a", kind="ball"), "", "ball joint.*three hinges"),
        (link("").replace('name=""', ""), "", "has no name"),
        (link("a") + link("b"), '<equality><connect body1="a_link" body2="b_link" anchor="0 0 0"/></equality>', "closed chain.*Cut it"),
        (link("a") + link("b"), '<equality><joint joint1="a"/></equality>', r'held=\["a"\]'),
    ],
)  # fmt: skip
def test_what_has_no_force_of_its_own_is_refused(bodies, more, says):
    with pytest.raises(ValueError, match=says):
        RigidArm(compiled(bodies, more))


def test_bad_arguments_name_the_mend():
    model = compiled(link("a"))
    for options, says in (
        (dict(held=["b"]), "no joint 'b'"), (dict(held={"a": math.nan}), "held"),
        (dict(held=["a"]), "no joint that moves"), (dict(payload={"hand": 1.0}), "no body 'hand'"),
        (dict(payload={"a_link": -1.0}), "payload.*a_link"), (dict(gravity=(0.0, 1.0)), "three numbers"),
    ):  # fmt: skip
        with pytest.raises(ValueError, match=says):
            RigidArm(model, **options)
    with pytest.raises(ValueError, match="MJCF or URDF file, or a mujoco.MjModel"):
        dfc.arm_records(3, {})


def test_inertias_that_no_body_has_are_refused_with_the_line_that_bounds_them(tmp_path):
    urdf = """<robot name="r">{}<link name="base"/><link name="arm"><inertial>
        <mass value="1"/><inertia ixx="1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>
        </link><joint name="q" type="revolute"><parent link="base"/><child link="arm"/>
        <axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""
    path = tmp_path / "r.urdf"
    path.write_text(urdf.format(""))
    with pytest.raises(ValueError, match="r.urdf is refused by MuJoCo.*within <mujoco> in a") as no:
        RigidArm(path)
    line = str(no.value).partition("<")[2].partition("/>")[0]
    path.write_text(urdf.format(f"<mujoco><{line}/></mujoco>"))
    assert RigidArm(path).joints == ("q",)


def test_a_payload_has_no_less_inertia_than_a_point_of_its_mass():
    place = np.array([0.0, 0.1, 0.0])
    for own in (-1e-3, 2e-3):
        mass, at, second = Compact(0.4, place).body_parameters(np.array([0.4, 0.0, 0.0, 0.0, own]))
        point = np.array([mass * 0.01, 0.0, mass * 0.01, 0.0, 0.0, 0.0])
        assert np.array_equal(at, place)
        assert second == pytest.approx(point + np.array([1, 1, 1, 0, 0, 0]) * max(own, 0.0))
