"""The motion through poses: it passes them in time, the shorter way, and what it asks for is what it really does."""

from __future__ import annotations

import math
import random
from itertools import pairwise

import pytest

from gateway.core.motion.poses.pose_trajectory import interpolate_poses, with_signs
from gateway.core.motion.poses.quaternion import angle_rad, dot
from tests.core.pose_judge import about

TIMES = [0.1 * n for n in range(30)]
POSES = [
    (0.3 + 0.05 * math.sin(t), 0.1, -0.2 + 0.03 * math.cos(2.0 * t), *about((0.0, 1.0, 1.0), 0.4 * math.sin(t)))
    for t in TIMES
]


def test_the_motion_passes_every_pose_in_time_whatever_its_sign_and_norm():
    """Positions exactly, orientations as they are; the signs of one motion belong together."""
    rng = random.Random(3)
    given = [(*p[:3], *(sign * 1.02 * c for sign in (rng.choice((-1.0, 1.0)),) for c in p[3:])) for p in POSES]
    trajectory = interpolate_poses(given, TIMES)
    assert trajectory.times_s == pytest.approx(TIMES) and trajectory.duration_s == pytest.approx(2.9)
    for pose, time_s in zip(POSES, TIMES, strict=True):
        values, _, _ = trajectory.at(time_s)
        assert values[:3] == pytest.approx(pose[:3], abs=1e-12) and angle_rad(values[3:], pose[3:]) < 1e-9
        assert math.hypot(*values[3:]) == pytest.approx(1.0, abs=1e-15)
    points = trajectory.points
    assert all(dot(a[3:], b[3:]) > 0.0 for a, b in pairwise(points))


def test_its_rates_are_the_derivatives():
    """Linear velocity, and angular speed as the angle between near poses."""
    trajectory = interpolate_poses(POSES, TIMES)
    hair = 1e-5
    for time_s in (0.33, 1.0, 1.77, 2.5):
        (before, _, _), (_, v, w), (after, _, _) = (trajectory.at(time_s + d) for d in (-hair, 0.0, hair))
        assert v == pytest.approx([(b - a) / (2 * hair) for a, b in zip(before[:3], after[:3], strict=True)], abs=1e-6)
        assert w == pytest.approx(angle_rad(before[3:], after[3:]) / (2 * hair), abs=1e-5)


def test_what_it_asks_for_is_told_piece_by_piece():
    """The highest of each at the poses and between them, as norms."""
    trajectory = interpolate_poses(POSES, TIMES)
    dense = [trajectory.at(2.9 * n / 2000) for n in range(2001)]
    assert max(trajectory.reach_m) == pytest.approx(max(math.hypot(*p[:3]) for p, _, _ in dense), abs=1e-4)
    assert max(trajectory.v_mps) == pytest.approx(max(math.hypot(*v) for _, v, _ in dense), abs=1e-3)
    assert max(trajectory.w_radps) == pytest.approx(max(w for _, _, w in dense), abs=1e-3)
    assert max(trajectory.w_radps) == pytest.approx(0.4, abs=0.01)
    assert len(trajectory.v_mps) == len(POSES) - 1 and max(trajectory.a_mps2) < 0.15 and max(trajectory.dw_radps2) < 0.5


def test_signs_and_norms_are_put_right():
    """The first pose keeps its sign; what follows is nearer to it than its opposite."""
    first = (0.0, 0.0, 0.1, 0.0, 0.0, 0.0, -2.0)
    rows = with_signs([first, (0.0, 0.0, 0.2, 0.0, 0.0, 0.1, 0.995)])
    assert rows[0] == (0.0, 0.0, 0.1, 0.0, 0.0, 0.0, -1.0) and rows[1][6] < 0.0
