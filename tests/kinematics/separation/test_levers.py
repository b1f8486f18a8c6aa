"""How far parts can be from the axes that move them: no posture makes it more."""

from __future__ import annotations

import math
import random

from gateway.kinematics.collision import at
from gateway.kinematics.separation.levers import levers
from gateway.values import ARM_DOF
from tests.kinematics.guarded_arms import model, random_joints
from tests.thoroughness import either


def test_no_posture_takes_an_end_further_from_an_axis_and_some_come_near_that():
    """Random postures: the distance of both ends of each part from each axis that moves it, gripper wide open."""
    rng, reach_m = random.Random(4), levers(model())
    most = [[0.0] * ARM_DOF for _ in reach_m]
    for _ in range(either(300, 3000)):
        posture = model().posture(random_joints(rng))
        for number, capsule in enumerate(model().capsules):
            if not capsule.after:
                assert reach_m[number] == ()
                continue
            lines = posture.lines[capsule.side]
            for k in range(capsule.after):
                x, y, z, ax, ay, az = lines[6 * k : 6 * k + 6]
                for end in (0.0, 1.0):
                    px, py, pz = at(posture.segments[number], end)
                    px, py, pz = px - x, py - y, pz - z
                    away_m = math.hypot(ay * pz - az * py, az * px - ax * pz, ax * py - ay * px)
                    assert away_m <= reach_m[number][k] + 1e-9
                    most[number][k] = max(most[number][k], away_m)
    for row, found in zip(reach_m, most, strict=True):
        for lever_m, away_m in zip(row, found, strict=False):
            assert away_m >= 0.7 * lever_m
