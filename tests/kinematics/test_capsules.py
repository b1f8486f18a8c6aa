"""The hull: complete, mirrored, every pair watched or left out for a reason, every size open to a better one."""

from __future__ import annotations

import math
from itertools import combinations

import pytest

from gateway.kinematics.capsules import DATA_FILE, hull
from gateway.kinematics.collision import CollisionModel
from gateway.kinematics.description import nominal
from gateway.robot.limits import HOME_Q_RAD
from gateway.values import Side, ValueRefused

LIMB = {"upper", "forearm", "palm", "wrist_camera", "upper_finger", "lower_finger"}


def test_the_hull_has_both_arms_and_all_that_they_can_meet():
    """Six parts an arm; shoulders, torso, head, carriage, lift column, chassis (requirement)."""
    parts = {capsule.name for capsule in hull().capsules}
    assert {f"{side}_{part}" for side in Side for part in LIMB} <= parts
    assert {"head", "carriage", "column", "left_torso", "right_torso", "left_shoulder", "right_shoulder"} <= parts
    assert {"chassis_left", "chassis_right", "chassis_front"} <= parts
    assert len(parts) == len(hull().capsules) == 22
    assert hull().margin_m == 0.02


def test_every_pair_is_watched_or_has_a_reason():
    """None is forgotten, none is in both lists; the arms are watched against each other entirely."""
    watched = {frozenset((pair.first.name, pair.second.name)) for pair in hull().watched}
    skipped = {frozenset((pair.first.name, pair.second.name)): pair.why for pair in hull().skipped}
    names = [capsule.name for capsule in hull().capsules]
    assert watched | set(skipped) == set(map(frozenset, combinations(names, 2)))
    assert not watched & set(skipped) and all(skipped.values())
    assert all(frozenset((f"left_{one}", f"right_{two}")) in watched for one in LIMB for two in LIMB)
    assert all(frozenset((f"{side}_{part}", "head")) in watched for side in Side for part in LIMB)
    assert skipped[frozenset(("left_upper", "left_forearm"))] == "joint 4 joins them"
    assert skipped[frozenset(("column", "head"))] == "no joint of an arm moves them"


def test_both_sides_are_mirror_images():
    """The same sizes, y the other way round."""
    parts = {capsule.name: capsule for capsule in hull().capsules}
    for name, left in parts.items():
        if left.side is Side.LEFT:
            right = parts[name.replace("left", "right", 1)]
            assert right.radius_m == left.radius_m and right.after == left.after
            for one, two in ((left.from_m, right.from_m), (left.to_m, right.to_m), (left.opens, right.opens)):
                assert two == (one[0], -one[1], one[2])


def test_every_radius_in_the_data_file_says_what_it_rests_on():
    """A guess says that it is one."""
    lines = [line for line in DATA_FILE.read_text(encoding="utf-8").splitlines() if line.startswith("radius_m")]
    assert lines and all("#" in line for line in lines)


def test_a_measured_radius_takes_the_place_of_a_nominal_one():
    """For both sides or for one; a name that there is not, and no size, are refused."""
    other = hull().with_radii({"forearm": 0.06, "left_palm": 0.07})
    radii = {capsule.name: capsule.radius_m for capsule in other.capsules}
    assert radii["left_forearm"] == radii["right_forearm"] == 0.06
    assert radii["left_palm"] == 0.07 and radii["right_palm"] == 0.055
    thick = hull().with_radii({"torso": 0.1})
    before, after = (CollisionModel(nominal(), shape).posture(HOME_Q_RAD).nearest() for shape in (hull(), thick))
    assert after.gap_m == pytest.approx(before.gap_m - 0.01, abs=1e-12)
    with pytest.raises(ValueRefused, match="no part 'tail'; there are"):
        hull().with_radii({"tail": 0.1})
    for bad in (0.0, -1.0, math.nan, math.inf):
        with pytest.raises(ValueRefused, match="radius of head"):
            hull().with_radii({"head": bad})
