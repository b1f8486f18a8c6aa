"""Tests of transforms: names are checked, products are those of matrices, quaternions are xyzw."""

from __future__ import annotations

import numpy as np
import pytest

from gateway.kinematics.transform import FrameMismatch, Points, Transform, frames_of, nearest_rigid
from gateway.values import ValueRefused


def random_transform(rng, name="a_T_b"):
    """Return a transform with a uniformly random orientation."""
    return Transform.of_quaternion(name, rng.normal(size=3), rng.normal(size=4))


def test_a_product_of_matching_frames_is_the_product_of_the_matrices():
    """a_T_b @ b_T_c is a_T_c (A.1), and takes points of c to a."""
    rng = np.random.default_rng(1)
    a_T_b, b_T_c = random_transform(rng, "a_T_b"), random_transform(rng, "b_T_c")
    a_T_c = a_T_b @ b_T_c
    assert a_T_c.name == "a_T_c"
    np.testing.assert_allclose(a_T_c.matrix, a_T_b.matrix @ b_T_c.matrix, atol=1e-15)
    xyz_m = rng.normal(size=(4, 5, 3))
    moved = a_T_c @ Points("c", xyz_m)
    assert moved.frame == "a"
    homogeneous = np.concatenate((xyz_m, np.ones((4, 5, 1))), axis=-1)
    np.testing.assert_allclose(moved.xyz_m, (homogeneous @ a_T_c.matrix.T)[..., :3], atol=1e-14)


def test_frames_that_do_not_meet_are_a_type_error():
    """Neither two transforms nor a transform and points of another frame can be multiplied; other types cannot at all."""
    rng = np.random.default_rng(2)
    a_T_b, c_T_d = random_transform(rng, "a_T_b"), random_transform(rng, "c_T_d")
    for product in (lambda: a_T_b @ c_T_d, lambda: a_T_b @ a_T_b, lambda: a_T_b @ Points("a", np.zeros(3))):
        with pytest.raises(FrameMismatch) as caught:
            product()
        assert isinstance(caught.value, TypeError)
    for difference in (a_T_b.distance_to_m, a_T_b.angle_to_rad):
        with pytest.raises(FrameMismatch, match="not of the same frames"):
            difference(c_T_d)
    for product in (lambda: a_T_b @ np.eye(4), lambda: np.eye(4) @ a_T_b, lambda: a_T_b @ 2.0):
        with pytest.raises(TypeError):
            product()


def test_the_inverse_undoes_and_has_the_names_swapped():
    """a_T_b @ its inverse is a in a."""
    rng = np.random.default_rng(3)
    for _ in range(50):
        a_T_b = random_transform(rng)
        inverse = a_T_b.inverse
        assert inverse.name == "b_T_a"
        np.testing.assert_allclose((a_T_b @ inverse).matrix, np.eye(4), atol=1e-14)


def test_quaternions_are_xyzw_and_survive_a_round_trip():
    """A quarter turn about z is (0, 0, √½, √½) (§4.0.2); any orientation comes back, w not negative."""
    turned = Transform.of_quaternion("a_T_b", (0, 0, 0), (0, 0, 1, 1))
    np.testing.assert_allclose(turned.rotation, [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-15)
    rng = np.random.default_rng(4)
    tried = [rng.normal(size=4) for _ in range(300)]
    tried += [
        np.array(q, dtype=float) for q in ((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1), (0, 0, 1, 1e-9))
    ]
    for quat in tried:
        quat = quat / np.linalg.norm(quat)
        found = Transform.of_quaternion("a_T_b", (0, 0, 0), quat).quat_xyzw
        assert found[3] >= 0.0
        assert min(np.abs(found - quat).max(), np.abs(found + quat).max()) < 1e-14


def test_angle_and_distance_are_what_lies_between():
    """By a known turn and step, small and near π."""
    start = random_transform(np.random.default_rng(5))
    for angle in (0.0, 1e-9, 0.3, 3.1):
        half = angle / 2
        step = Transform.of_quaternion("b_T_b2", (0.03, 0, 0.04), (0, np.sin(half), 0, np.cos(half)))
        end = Transform("a", "b", (start @ step).matrix)
        assert start.angle_to_rad(end) == pytest.approx(angle, abs=1e-14)
        assert start.distance_to_m(end) == pytest.approx(0.05, abs=1e-14)


@pytest.mark.parametrize("name", ["", "a", "a_T_", "_T_b", "a_T_b_T_c", "a T b", "1_T_b", "a_t_b", "a_T_b c"])
def test_a_name_says_parent_and_child(name):
    """Anything but parent_T_child is refused (A.1)."""
    with pytest.raises(ValueRefused, match="parent_T_child"):
        frames_of(name)


def test_underscores_belong_to_the_frames():
    """The manual's own names have many."""
    assert frames_of("virtual_base_T_head_camera_center") == ("virtual_base", "head_camera_center")


@pytest.mark.parametrize(
    ("matrix", "match"),
    [
        (np.eye(3), "shape"),
        (np.full((4, 4), np.nan), "finite"),
        (np.diag([1.0, 1.0, -1.0, 1.0]), "mirror"),
        (np.diag([1.01, 1.0, 1.0, 1.0]), "orthonormal"),
        (np.vstack((np.eye(4)[:3], [[0, 0, 0.1, 1]])), "column-major"),
    ],
    ids=["shape", "nan", "mirror", "stretched", "last row"],
)
def test_only_rigid_right_handed_transforms_exist(matrix, match):
    """All frames are right-handed (A.1); what is no rotation says by how much."""
    with pytest.raises(ValueRefused, match=match):
        Transform.named("a_T_b", matrix)


@pytest.mark.parametrize("quat", [(0, 0, 0, 0), (np.nan, 0, 0, 1), (np.inf, 0, 0, 1), (0, 0, 1)])
def test_no_orientation_is_refused(quat):
    """A quaternion of zeros, NaN or three numbers turns nothing."""
    with pytest.raises(ValueRefused, match="xyzw"):
        Transform.of_quaternion("a_T_b", (0, 0, 0), quat)


def test_points_need_three_coordinates():
    """Other shapes are refused; a single point is fine."""
    assert Points("a", np.zeros(3)).xyz_m.shape == (3,)
    for shape in ((), (4,), (3, 2)):
        with pytest.raises(ValueRefused, match="shape"):
            Points("a", np.zeros(shape))


def test_what_is_handed_out_cannot_be_changed():
    """Matrices and points are read-only copies."""
    matrix = np.eye(4)
    made = Transform.named("a_T_b", matrix)
    matrix[0, 3] = 5.0
    assert made.p_m[0] == 0.0
    for array in (made.matrix, made.p_m, made.rotation, made.inverse.matrix, Points("a", np.zeros(3)).xyz_m):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0


def test_four_digits_are_mended_to_the_nearest_rotation():
    """A.3 as printed is some 3e-5 off; the nearest rotation keeps every printed digit."""
    printed = np.array([[0, -0.4384, 0.8988, 0], [-1, 0, 0, 0], [0, -0.8988, -0.4384, 0], [0, 0, 0, 1.0]])
    rigid, error = nearest_rigid(printed)
    assert 1e-5 < error < 1e-4
    Transform.named("a_T_b", rigid)
    np.testing.assert_allclose(rigid, printed, atol=5e-5)
    assert nearest_rigid(np.eye(4))[1] == 0.0
