"""Placements: rotations and transforms in plain floats, against their definitions."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from gateway.kinematics.placement import Placement, quat_from_rows, rows_from_quat, rows_from_rpy, turn_rad

angles = st.floats(-3.1, 3.1)
rpys = st.tuples(angles, angles, angles)
points = st.tuples(*[st.floats(-2.0, 2.0)] * 3)


def about(axis: int, angle: float) -> np.ndarray:
    """The textbook's rotation matrix about x, y or z."""
    c, s = math.cos(angle), math.sin(angle)
    matrix = np.eye(3)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    matrix[i, i] = matrix[j, j] = c
    matrix[i, j], matrix[j, i] = -s, s
    return matrix


@given(rpys)
def test_roll_pitch_yaw_turn_about_fixed_axes_in_this_order(rpy):
    """The URDF's convention: Rz(yaw) Ry(pitch) Rx(roll)."""
    assert np.allclose(rows_from_rpy(rpy), about(2, rpy[2]) @ about(1, rpy[1]) @ about(0, rpy[0]), atol=1e-15)


@given(rpys)
def test_a_quaternion_and_its_matrix_are_the_same_orientation(rpy):
    """There and back without loss, w never negative, unit norm."""
    rows = rows_from_rpy(rpy)
    quat = quat_from_rows(rows)
    assert quat[3] >= 0.0
    assert math.hypot(*quat) == pytest.approx(1.0, abs=1e-15)
    assert np.allclose(rows_from_quat(quat), rows, atol=1e-14)


@pytest.mark.parametrize("rpy", [(math.pi, 0, 0), (0, math.pi, 0), (0, 0, math.pi), (math.pi, 0, 1.0), (0, 0, 0)])
def test_half_turns_have_a_quaternion(rpy):
    """Where the trace says nothing, another component does."""
    rows = rows_from_rpy(rpy)
    assert np.allclose(rows_from_quat(quat_from_rows(rows)), rows, atol=1e-15)


@given(rpys, points, rpys, points, points)
def test_placements_chain_and_turn_back(rpy_a, p_a, rpy_b, p_b, point):
    """`a_T_b.after(b_T_c)` takes a point of c to a, and the inverse takes it back."""
    a, b = Placement(p_a, rows_from_rpy(rpy_a)), Placement(p_b, rows_from_rpy(rpy_b))
    there = a.after(b).point(point)
    assert np.allclose(there, a.point(b.point(point)), atol=1e-13)
    assert np.allclose(a.after(b).inverse().point(there), point, atol=1e-13)
    assert np.allclose(Placement.of(a.pose).rows, a.rows, atol=1e-14)


@example((0.3, -0.2, 0.1), 0.0, (1.0, 0.0, 0.0))
@example((0.3, -0.2, 0.1), 1e-9, (1.0, -1.0, 0.5))
@example((0.3, -0.2, 0.1), 2.0, (0.0, 1.0, 0.5))
@example((0.3, -0.2, 0.1), 2.2, (0.0, 1.0, 0.5))
@given(rpys, st.floats(0.0, 3.1), st.tuples(*[st.floats(-1.0, 1.0)] * 3).filter(lambda v: math.hypot(*v) > 0.1))
def test_the_turn_between_orientations_is_axis_times_angle_in_the_parent(rpy, angle, axis):
    """Turned by a known angle about a known axis of the parent, that is what comes out."""
    x, y, z = (c / math.hypot(*axis) for c in axis)
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    rotation = np.eye(3) + math.sin(angle) * k + (1.0 - math.cos(angle)) * k @ k
    rows = rows_from_rpy(rpy)
    assert np.allclose(turn_rad(rows, tuple(map(tuple, rotation @ rows))), np.array([x, y, z]) * angle, atol=1e-9)
