"""Rules of the simulated robot's own kinematics, against the published checks and against itself."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.sim.robot.geometry import (
    POSE_TOLERANCE_M,
    POSE_TOLERANCE_RAD,
    EePose,
    arm_geometry,
    quat_from_rotation,
    rotation_from_quat,
    rotation_vector,
)
from gateway.sim.robot.manual import EXAMPLE_HOME_RAD, LOWER_RAD, UPPER_RAD, Side
from gateway.sim.robot.settings import HANGING_RAD

# Checks published with the numbers (kinematics facts): forward kinematics of the home of §6.6, one solution of §6.1.
HOME = {
    Side.LEFT: ((0.37342, 0.09287, -0.35109), (-0.60615, 0.06309, -0.20164, 0.76678)),
    Side.RIGHT: ((0.40409, -0.11846, -0.22319), (0.27021, 0.25035, 0.38367, 0.84682)),
}
Q_61 = (-0.28608, 1.61868, 0.30022, 0.54233, 0.73653, 0.15890, -0.45533)
POSE_61 = EePose(
    position_m=(-0.014433992985935767, 0.0181230355198717, -0.545),
    quat_xyzw=(-0.651863775688076, 0.260180077341881, 0.7053938323707012, 0.0989923560353721),
)


def inside(side):
    """Joint angles inside the limits, as a strategy."""
    return st.tuples(*(st.floats(low, high) for low, high in zip(LOWER_RAD[side], UPPER_RAD[side], strict=True)))


def distance(one: EePose, other: EePose) -> tuple[float, float]:
    """Distance [m] and angle [rad] between two poses."""
    way = np.subtract(one.position_m, other.position_m)
    turn = rotation_vector(rotation_from_quat(one.quat_xyzw) @ rotation_from_quat(other.quat_xyzw).T)
    return float(np.linalg.norm(way)), float(np.linalg.norm(turn))


@pytest.mark.parametrize("side", Side)
def test_home_of_the_manual_has_the_published_pose(side):
    """Forward kinematics of §6.6's home gives the published figures to their five digits."""
    pose = arm_geometry(side).forward(EXAMPLE_HOME_RAD[side])
    position, quat = HOME[side]
    assert pose.position_m == pytest.approx(position, abs=6e-6)
    assert pose.quat_xyzw == pytest.approx(quat, abs=6e-6)


def test_the_published_solution_reaches_the_target_of_example_6_1():
    """The published joint angles lead to the pose of §6.1 within their rounding."""
    metres, radians = distance(arm_geometry(Side.LEFT).forward(Q_61), POSE_61)
    assert metres < 5e-6
    assert radians < 2e-5


@pytest.mark.parametrize("side", Side)
def test_reach_agrees_with_max_arm_len(side):
    """No pose inside the limits is farther from the shoulder than 0.5527 m, and some come close (§4.0.4)."""
    geometry = arm_geometry(side)
    samples = np.random.default_rng(1).uniform(geometry.lower_rad, geometry.upper_rad, (4000, 7))
    reach = max(float(np.linalg.norm(geometry.forward(q).position_m)) for q in samples)
    assert 0.549 < reach < 0.5528


def test_zero_pose_points_up_and_outboard():
    """With all joints at zero the left hand's +Z is up and its +X outboard, 0.55 m beside the shoulder."""
    pose = arm_geometry(Side.LEFT).forward([0.0] * 7)
    rotation = rotation_from_quat(pose.quat_xyzw)
    assert rotation[:, 2] == pytest.approx([0.0, 0.0, 1.0], abs=1e-9)
    assert rotation[:, 0] == pytest.approx([0.0, 1.0, 0.0], abs=1e-9)
    assert pose.position_m[1] == pytest.approx(0.5495, abs=2e-3)


@given(q_rad=inside(Side.LEFT))
def test_arms_are_mirror_images(q_rad):
    """Negating every angle on the right mirrors the hand in the plane between the arms."""
    left = arm_geometry(Side.LEFT).forward(q_rad)
    right = arm_geometry(Side.RIGHT).forward([-angle for angle in q_rad])
    x, y, z = left.position_m
    assert right.position_m == pytest.approx((x, -y, z), abs=1e-9)


@pytest.mark.parametrize("side", Side)
def test_jacobian_is_the_derivative_of_forward_kinematics(side):
    """The Jacobian that the search uses agrees with finite differences of the independent scalar chain."""
    geometry = arm_geometry(side)
    rng = np.random.default_rng(2)
    for _ in range(20):
        q = rng.uniform(geometry.lower_rad, geometry.upper_rad)
        jacobian = geometry.jacobian(q)
        for joint in range(7):
            step = np.zeros(7)
            step[joint] = 1e-6
            ahead, behind = geometry.forward(q + step), geometry.forward(q - step)
            linear = np.subtract(ahead.position_m, behind.position_m) / 2e-6
            turn = rotation_from_quat(ahead.quat_xyzw) @ rotation_from_quat(behind.quat_xyzw).T
            assert jacobian[:3, joint] == pytest.approx(linear, abs=1e-6)
            assert jacobian[3:, joint] == pytest.approx(rotation_vector(turn) / 2e-6, abs=1e-6)


@pytest.mark.parametrize("side", Side)
def test_inverse_finds_a_near_pose_again(side):
    """From 0.1 rad beside it every reachable pose is found, inside the limits and within the tolerance."""
    geometry = arm_geometry(side)
    rng = np.random.default_rng(3)
    for _ in range(60):
        wanted = geometry.forward(rng.uniform(geometry.lower_rad, geometry.upper_rad))
        beside = geometry.inverse(wanted, rng.uniform(geometry.lower_rad, geometry.upper_rad))
        assert beside is None or distance(geometry.forward(beside), wanted)[0] < 2 * POSE_TOLERANCE_M
    for _ in range(60):
        q = rng.uniform(geometry.lower_rad, geometry.upper_rad)
        wanted = geometry.forward(q)
        found = geometry.inverse(wanted, q + rng.uniform(-0.1, 0.1, 7))
        assert found is not None
        assert np.all(found >= geometry.lower_rad) and np.all(found <= geometry.upper_rad)
        metres, radians = distance(geometry.forward(found), wanted)
        assert metres < 2 * POSE_TOLERANCE_M
        assert radians < 2 * POSE_TOLERANCE_RAD


def test_inverse_reaches_the_target_of_example_6_1_from_where_the_arm_hangs():
    """§6.1 asks the robot's IK for this pose; it must have an answer from the hanging arm."""
    found = arm_geometry(Side.LEFT).inverse(POSE_61, HANGING_RAD[Side.LEFT])
    assert found is not None
    assert distance(arm_geometry(Side.LEFT).forward(found), POSE_61)[0] < 2 * POSE_TOLERANCE_M


@pytest.mark.parametrize("position", [(0.9, 0.0, 0.0), (0.0, 0.0, 0.56), (0.0, 0.0, 0.0)])
def test_unreachable_pose_has_no_solution(position):
    """Beyond the reach, or inside the shoulder, the answer is None instead of something near."""
    pose = EePose(position_m=position, quat_xyzw=(0.0, 0.0, 0.0, 1.0))
    assert arm_geometry(Side.LEFT).inverse(pose, HANGING_RAD[Side.LEFT]) is None


@given(st.lists(st.floats(-1.0, 1.0), min_size=4, max_size=4).filter(lambda v: np.linalg.norm(v) > 1e-3))
def test_quaternion_and_rotation_are_the_same_turn(values):
    """A quaternion of any length survives the way through the matrix, up to sign and length."""
    unit = np.array(values) / np.linalg.norm(values)
    again = np.array(quat_from_rotation(rotation_from_quat(values).tolist()))
    assert abs(float(unit @ again)) == pytest.approx(1.0, abs=1e-9)


def test_rotation_vector_is_exact_at_its_ends():
    """No turn gives zero; half a turn gives pi."""
    assert rotation_vector(np.eye(3)) == pytest.approx([0.0, 0.0, 0.0])
    assert rotation_vector(np.diag([1.0, -1.0, -1.0])) == pytest.approx([np.pi, 0.0, 0.0])
