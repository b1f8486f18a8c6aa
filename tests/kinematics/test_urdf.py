"""A user's URDF in place of our numbers: found by name, and refused with all that is missing."""

from __future__ import annotations

import numpy as np
import pytest

from gateway.errors import Code, ConfigError
from gateway.kinematics.description import nominal
from gateway.kinematics.nominal_frames import nominal_edges
from gateway.kinematics.solving.chain import ArmChain
from gateway.kinematics.urdf import from_urdf
from gateway.values import Side
from tests.changed import replace
from tests.kinematics.bodies import nudged, samples
from tests.kinematics.urdfs import written


def test_a_urdf_of_our_numbers_is_our_description(tmp_path):
    """Every joint and every mass comes back as it was, parents first, whatever order the file has."""
    ours, read = nominal(), from_urdf(written(nominal(), tmp_path / "robot.urdf"))
    assert {name: read.joints[name] for name in ours.joints} == ours.joints
    assert set(read.joints) == set(ours.joints)
    assert {link: i.mass_kg for link, i in read.inertias.items()} == {
        link: i.mass_kg for link, i in ours.inertias.items()
    }
    for link, inertia in read.inertias.items():
        assert inertia.inertia_kgm2 == pytest.approx(ours.inertias[link].inertia_kgm2, rel=1e-15, abs=1e-20)
    known = {"base_link"}
    for joint in read.joints.values():
        assert joint.parent in known
        known.add(joint.child)
    assert read.cameras == ours.cameras and "robot.urdf" in read.source


def test_the_robots_own_joint_names_are_understood(tmp_path):
    """`l_joint1` is `armL1_joint`: a URDF written for the robot's topics needs no renaming."""
    path = written(nominal(), tmp_path / "robot.urdf")
    text = path.read_text()
    for number in range(1, 8):
        text = text.replace(f'"armL{number}_joint"', f'"l_joint{number}"').replace(
            f'"armR{number}_joint"', f'"r_joint{number}"'
        )
    path.write_text(text)
    assert from_urdf(path).joints == nominal().joints


def test_links_of_other_names_have_our_cameras_all_the_same(tmp_path):
    """Only joints and frames are named; hands and head may be called anything, and every frame of the tree is there."""
    path = written(nominal(), tmp_path / "robot.urdf")
    text = path.read_text()
    for link in ("lg_base_link", "rg_base_link", "body_link"):
        assert f'"{link}"' in text
        text = text.replace(f'"{link}"', f'"my_{link}"')
    path.write_text(text)
    body = from_urdf(path)
    places, wanted = (
        {edge.transform.name: edge.transform.matrix.tolist() for edge in nominal_edges(one)}
        for one in (body, nominal())
    )
    assert body.cameras == nominal().cameras and places == wanted


@pytest.mark.parametrize("side", list(Side))
def test_other_numbers_are_used_as_they_are(tmp_path, side):
    """A displaced axis in the file is a displaced axis in the arm; pinocchio's own reader sees the same arm."""
    body = nudged(side, 5, xyz_m=(0.002, 0.0, 0.001), rpy_rad=(0.01, -0.02, 0.03))
    path = written(body, tmp_path / "robot.urdf")
    chain, wanted = ArmChain(from_urdf(path), side), ArmChain(body, side)
    for q in samples(side, 20):
        assert chain.forward(q) == wanted.forward(q)
    pin = pytest.importorskip("pinocchio", reason="the extra `body` is not installed")
    model = pin.buildModelFromUrdf(str(path))
    data = model.createData()
    first = model.joints[model.getJointId(body.arm(side)[0].name)].idx_q
    for q in samples(side, 20):
        everything = pin.neutral(model)
        everything[first : first + 7] = q
        pin.framesForwardKinematics(model, data, everything)
        shoulder, ee = (data.oMf[model.getFrameId(name)] for name in (f"{side}_shoulder_base", f"{side}_ee"))
        assert np.allclose(chain.forward(q).p_m, (shoulder.inverse() * ee).translation, atol=1e-12)


def test_a_model_for_pinocchio_is_what_pinocchio_reads_itself(tmp_path):
    """Masses, centres, inertias and limits of every joint, ours against the ones of pinocchio's own URDF reader."""
    pin = pytest.importorskip("pinocchio", reason="the extra `body` is not installed")
    from gateway.kinematics.pin_model import pin_model

    ours, theirs = pin_model(nominal()), pin.buildModelFromUrdf(str(written(nominal(), tmp_path / "robot.urdf")))
    assert pin.computeTotalMass(ours) == pytest.approx(pin.computeTotalMass(theirs))
    for name in list(ours.names)[1:]:
        a, b = ours.getJointId(name), theirs.getJointId(name)
        assert np.allclose(ours.inertias[a].matrix(), theirs.inertias[b].matrix(), atol=1e-12), name
        if theirs.joints[b].nq == 1:
            for limits in ("lowerPositionLimit", "upperPositionLimit", "effortLimit", "velocityLimit"):
                i, j = (m.joints[k].idx_v for m, k in ((ours, a), (theirs, b)))
                assert getattr(ours, limits)[ours.joints[a].idx_q] == getattr(theirs, limits)[
                    theirs.joints[b].idx_q
                ] or (
                    limits in ("effortLimit", "velocityLimit")
                    and getattr(ours, limits)[i] == getattr(theirs, limits)[j]
                )


def test_an_inertia_in_a_turned_frame_is_turned_into_the_links(tmp_path):
    """URDFs may give the tensor in a frame of its own."""
    path = written(nominal(), tmp_path / "robot.urdf")
    ours = nominal().inertias["base_link"]
    plain = f'<origin xyz="{" ".join(map(repr, ours.com_m))}"/>'
    turned = plain.replace("/>", ' rpy="0 0 1.5707963267948966"/>')
    assert plain in path.read_text()
    path.write_text(path.read_text().replace(plain, turned))
    xx, xy, xz, yy, yz, zz = ours.inertia_kgm2
    assert from_urdf(path).inertias["base_link"].inertia_kgm2 == pytest.approx((yy, -xy, -yz, xx, xz, zz), abs=1e-12)


def test_everything_that_is_missing_is_named_at_once(tmp_path):
    """Two joints and a frame that are not there: one error that names the three, and how they must be called."""
    ours = nominal()
    gone = {"left_ee_joint", "armR7_joint", "right_ee_joint"}
    cut = replace(ours, joints={name: joint for name, joint in ours.joints.items() if name not in gone})
    with pytest.raises(ConfigError) as told:
        from_urdf(written(cut, tmp_path / "robot.urdf"))
    assert told.value.code is Code.BAD_CONFIG
    for word in ("lacks 3", "'armR7_joint' (or 'r_joint7')", "link 'left_ee'", "link 'right_ee'", "robot.urdf"):
        assert word in told.value.message
    assert "names must be these" in told.value.hint


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('type="revolute"', 'type="floating"', "'floating'; known: fixed, revolute, continuous, prismatic"),
        ('lower="0.0" upper="1.8"', 'lower="2.0" upper="1.8"', "range [2, 1.8]"),
        ('rpy="0.0 1.5707963267948966 0.0"', 'rpy="0.0 nan 0.0"', "3 finite numbers are needed"),
        ('rpy="0.0 1.5707963267948966 0.0"', 'rpy="0.0 1.57"', "3 finite numbers are needed"),
        ('<axis xyz="0.0 0.0 -1.0"/>', '<axis xyz="0 0 0"/>', "axis without length"),
        ('<parent link="body_link"/>', "", "no parent link"),
        ('<child link="armL1_link"/>', '<child link="armR1_link"/>', "hang on several joints"),
        ('link="base_link"/><child link="lift_c', 'link="x"/><child link="lift_c', "the roots base_link, x"),
        ('link="base_link"/><child link="lift_c', 'link="left_ee"/><child link="lift_c', "hang on each other"),
        ("</robot>", "", "is not XML"),
        ('<robot name="teleavatar">', '<robots name="teleavatar">', "is not XML"),
    ],
)  # fmt: skip
def test_what_is_wrong_in_a_urdf_is_told_with_its_place(tmp_path, old, new, said):
    """Nothing is guessed: a type, a range, a number, an axis, a tree that is none."""
    path = written(nominal(), tmp_path / "robot.urdf")
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(ConfigError) as told:
        from_urdf(path)
    assert said in told.value.message and told.value.hint


def test_an_arm_joint_that_does_not_turn_is_refused(tmp_path):
    """A fixed elbow is another robot."""
    ours = nominal()
    stiff = replace(ours.joints["armL4_joint"], kind=type(ours.joints["armL4_joint"].kind).FIXED, axis=(0.0, 0.0, 0.0))
    path = written(replace(ours, joints={**ours.joints, "armL4_joint": stiff}), tmp_path / "robot.urdf")
    with pytest.raises(ConfigError, match="armL4_joint"):
        from_urdf(path)


def test_a_file_that_is_not_there_and_one_of_another_kind_are_refused(tmp_path):
    """With the path, and what to give instead."""
    with pytest.raises(ConfigError, match="cannot be read"):
        from_urdf(tmp_path / "none.urdf")
    other = tmp_path / "other.xml"
    other.write_text("<html/>")
    with pytest.raises(ConfigError, match="its root is <html>"):
        from_urdf(other)
