"""What the physics reads of the body's numbers."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.sim.physics.body_numbers import DATA, body_numbers, quat_wxyz, transform
from gateway.sim.robot.geometry import rotation_from_quat

angles = st.floats(-np.pi, np.pi)


def test_every_moving_link_has_a_mass_and_every_parent_stands_before_its_children():
    """Whoever builds a tree from the joints needs both."""
    numbers = body_numbers()
    known = {"base_link"}
    for joint in numbers.joints:
        assert joint.parent in known, joint.name
        known.add(joint.child)
        if joint.kind != "fixed":
            assert numbers.inertias[joint.child].mass_kg > 0.0
            assert np.linalg.norm(joint.axis) == pytest.approx(1.0)
            assert joint.effort > 0.0
    assert set(numbers.inertias) <= known


def test_inertias_are_those_of_bodies():
    """Positive, and no axis has more than both others together."""
    for link, inertia in body_numbers().inertias.items():
        xx, xy, xz, yy, yz, zz = inertia.inertia_kgm2
        a, b, c = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        assert 0.0 < a <= b <= c < a + b, link


def test_an_unknown_joint_is_told_with_those_there_are():
    """The error names the file and what it has."""
    with pytest.raises(KeyError, match=r"no joint 'elbow' in teleavatar2\.toml; there are lift_carriage_joint, "):
        body_numbers().joint("elbow")
    assert body_numbers().joint("armL4_joint").effort == 20.0


def test_the_file_is_the_one_that_the_package_ships():
    """Beside the gateway's kinematics, which reads it too."""
    assert DATA.name == "teleavatar2.toml" and DATA.is_file()
    assert json.dumps(body_numbers().cameras["head"]["baseline_m"]) == "0.065"


@given(roll=angles, pitch=angles, yaw=angles)
def test_origins_turn_about_fixed_axes_and_quaternions_say_the_same(roll, pitch, yaw):
    """First roll, then pitch, then yaw; the quaternion gives the rotation back."""
    turned = transform((1.0, 2.0, 3.0), (roll, pitch, yaw))
    one_by_one = np.eye(4)
    for alone in ((0.0, 0.0, yaw), (0.0, pitch, 0.0), (roll, 0.0, 0.0)):
        one_by_one = one_by_one @ transform((0.0, 0.0, 0.0), alone)
    assert turned[:3, :3] == pytest.approx(one_by_one[:3, :3], abs=1e-12)
    assert turned[:3, 3] == pytest.approx([1.0, 2.0, 3.0])
    w, x, y, z = quat_wxyz(turned)
    assert np.linalg.norm((w, x, y, z)) == pytest.approx(1.0)
    assert rotation_from_quat((x, y, z, w)) == pytest.approx(turned[:3, :3], abs=1e-9)
