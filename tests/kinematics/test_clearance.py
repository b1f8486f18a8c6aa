"""Ordinary postures are free, and a hull that is in its own way is found."""

from __future__ import annotations

from gateway.kinematics.arm import ArmModel
from gateway.kinematics.clearance import clearances, ordinary
from gateway.kinematics.collision import CollisionModel
from gateway.kinematics.description import nominal
from gateway.robot.limits import JOINT_LOWER_RAD, JOINT_UPPER_RAD
from gateway.values import Side
from tests.kinematics.bodies import nudged


def test_home_hanging_arms_and_places_before_the_body_are_free():
    """With the margin of 2 cm, grippers wide open."""
    rows = clearances(nominal())
    assert [row.name for row in rows if not row.is_good] == []
    assert len(rows) == 3 and " places of both hands" in rows[-1].name


def test_the_places_are_many_and_inside_the_limits():
    """A broad set: reached by the arms' own inverse kinematics."""
    postures = list(ordinary(nominal()))
    assert len(postures) > 50
    for q_rad in postures:
        for side in Side:
            assert all(
                a <= q <= b for q, a, b in zip(q_rad[side], JOINT_LOWER_RAD[side], JOINT_UPPER_RAD[side], strict=True)
            )
    spots = {tuple(round(c, 6) for c in ArmModel(nominal(), Side.LEFT).forward(q[Side.LEFT]).p_m) for q in postures}
    assert len(spots) == len(postures)


def test_an_arm_that_would_hang_in_the_torso_is_found():
    """A shoulder 6 cm further in: hanging arms would touch."""
    bad = [row for row in clearances(nudged(Side.LEFT, 2, xyz_m=(0.0, 0.0, 0.06))) if not row.is_good]
    assert "hanging arms of §6.4 are free" in {row.name for row in bad}
    assert all("left_" in row.found for row in bad)


def test_the_check_uses_the_hull_of_the_guard():
    """The same gap as the model has."""
    posture = CollisionModel(nominal()).posture(next(iter(ordinary(nominal()))))
    assert posture.nearest().gap_m > posture.model.margin_m
