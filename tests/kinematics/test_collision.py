"""Distances of the body's parts: against the simulation's own geometry and brute force, differences, and the mirror."""

from __future__ import annotations

import math
import random

import numpy as np
import pytest

from gateway.errors import Code, ConfigError
from gateway.kinematics.capsules import hull
from gateway.kinematics.collision import CollisionModel
from gateway.kinematics.description import nominal
from gateway.robot.limits import HOME_Q_RAD
from gateway.sim.robot import manual
from gateway.sim.robot.geometry import arm_geometry
from gateway.values import Side, ValueRefused
from tests.changed import replace
from tests.kinematics.bodies import ARMS
from tests.kinematics.guarded_arms import OWN, calibrated, free_posture, model, random_joints, really
from tests.thoroughness import either


def test_the_hand_is_where_the_simulations_own_geometry_has_it():
    """The palm's line begins at the end effector and runs along its x axis; shoulders are 0.22 m off the middle (A.3)."""
    rng = random.Random(2)
    for _ in range(50):
        q_rad = random_joints(rng)
        posture = model().posture(q_rad)
        for side in Side:
            number = [capsule.name for capsule in model().capsules].index(f"{side}_palm")
            x, y, z, *way, square = posture.segments[number]
            pose = arm_geometry(manual.Side(side.value)).forward(q_rad[side])
            shoulder_y = 0.22 if side is Side.LEFT else -0.22
            assert (x, y - shoulder_y, z) == pytest.approx(pose.position_m, abs=1e-12)
            i, j, k, w = pose.quat_xyzw
            along = (1.0 - 2.0 * (j * j + k * k), 2.0 * (i * j + k * w), 2.0 * (i * k - j * w))
            assert way == pytest.approx([0.11 * c for c in along], abs=1e-12)
            assert square == pytest.approx(0.11**2)


def test_the_nearest_pair_is_that_of_brute_force():
    """Points strewn along all lines, in an array library: the same pair, the same gap to the strewing's width."""
    rng, parts = random.Random(4), np.linspace(0.0, 1.0, 60)
    names = {capsule.name: number for number, capsule in enumerate(model().capsules)}
    for _ in range(either(10, 60)):
        posture = model().posture(random_joints(rng), rng.uniform(0.0, 0.74))
        pieces = np.array(posture.segments)
        points = pieces[:, None, :3] + parts[:, None] * pieces[:, None, 3:6]
        least = math.inf
        for pair in hull().watched:
            a, b = points[names[pair.first.name]], points[names[pair.second.name]]
            gap = np.linalg.norm(a[:, None] - b[None], axis=2).min() - pair.first.radius_m - pair.second.radius_m
            least = min(least, gap)
        assert posture.nearest().gap_m <= least + 1e-12
        assert posture.nearest().gap_m == pytest.approx(least, abs=0.008)


def test_all_pairs_inside_a_horizon_are_found_and_sorted():
    """The spheres that tell far pairs apart lose none."""
    rng = random.Random(6)
    for _ in range(30):
        posture = model().posture(random_joints(rng))
        every = posture.within(math.inf)
        assert len(every) == len(model().pairs) and every == sorted(every)
        assert posture.within(0.15) == ([row for row in every if row[0] <= 0.15] or every[:1])
        assert posture.nearest().gap_m == every[0][0]


def test_slopes_are_the_differences_of_the_gap():
    """By each of 14 joints, against central differences; parts that are parallel or inside each other have none."""
    rng, step, compared = random.Random(8), 1e-6, 0
    for _ in range(either(30, 200)):
        q_rad = free_posture(rng, 0.0)
        posture = model().posture(q_rad)
        _, number = posture.within(math.inf)[rng.randrange(40)]
        near = posture.told(number)
        for side in Side:
            for k in range(7):
                gaps = []
                for sign in (1.0, -1.0):
                    moved = {s: list(q_rad[s]) for s in Side}
                    moved[side][k] += sign * step
                    gaps.append(model().posture(moved).told(number).gap_m)
                assert near.slopes[side][k] == pytest.approx((gaps[0] - gaps[1]) / (2.0 * step), abs=2e-5)
                compared += near.slopes[side][k] != 0.0
    assert compared > 50


def test_the_closing_speed_is_that_of_the_next_moment():
    """Both arms moving: the gap after a ten-thousandth of a second."""
    rng, time_s = random.Random(9), 1e-5
    for _ in range(50):
        q_rad = free_posture(rng, 0.0)
        dq = {side: [rng.uniform(-1.0, 1.0) for _ in range(7)] for side in Side}
        _, number = model().posture(q_rad).within(0.3)[0]
        near = model().posture(q_rad).told(number)
        later = {side: [q + v * time_s for q, v in zip(q_rad[side], dq[side], strict=True)] for side in Side}
        gap_m = model().posture(later).told(number).gap_m
        assert near.closing_mps(dq) == pytest.approx((near.gap_m - gap_m) / time_s, abs=1e-3)


def test_the_mirrored_posture_has_the_mirrored_distances():
    """Left for right: every gap has a twin."""
    rng = random.Random(10)
    swap = {"left": "right", "right": "left"}
    signs = _mirror()
    for _ in range(20):
        q_rad = random_joints(rng)
        mirrored = {
            Side.LEFT: [s * q for s, q in zip(signs, q_rad[Side.RIGHT], strict=True)],
            Side.RIGHT: [s * q for s, q in zip(signs, q_rad[Side.LEFT], strict=True)],
        }
        gaps = []
        for joints, is_swapped in ((q_rad, False), (mirrored, True)):
            posture = model().posture(joints)
            found = {}
            for gap, number in posture.within(math.inf):
                told = posture.told(number)
                names = [told.first, told.second]
                if is_swapped:
                    names = ["_".join(swap.get(word, word) for word in name.split("_")) for name in names]
                found[frozenset(names)] = gap
            gaps.append(found)
        assert gaps[0] == pytest.approx(gaps[1], abs=1e-9)


def _mirror():
    """Return the signs by which the right arm's joints make the left arm's mirror image, found from the axes."""
    signs = []
    for left, right in zip(*(model().chains[side].lines for side in Side), strict=True):
        x, y, z = left[1]
        # A mirror of y turns the sense of rotations: the axis (x, y, z) becomes (-x, y, -z).
        signs.append(1.0 if np.allclose((-x, y, -z), right[1]) else -1.0)
    return signs


def test_an_arm_that_swings_down_meets_the_torso_where_a_third_party_found_it():
    """A straight arm, joint 2 alone: contact at 1.716 rad (published); hanging straight it is free."""

    def gap_m(q2):
        return model().posture({**HOME_Q_RAD, Side.LEFT: (0.0, q2, 0.0, 0.25, 0.0, 0.0, 0.0)}).nearest().gap_m

    assert gap_m(1.716) == pytest.approx(0.0, abs=0.003)
    assert gap_m(1.5708) > 0.02


def test_the_lift_takes_the_arms_down_to_the_chassis():
    """Hanging arms, the lift at its lowest: the hands are at the chassis; at the top they are far from it."""
    hanging = {Side.LEFT: (0.0, 1.57, 0.0, 0.3, 0.0, 0.0, 0.0), Side.RIGHT: (0.0, -1.57, 0.0, -0.3, 0.0, 0.0, 0.0)}

    def chassis_m(lowered_m):
        posture = model().posture(hanging, lowered_m)
        return min(gap for gap, number in posture.within(9.0) if posture.told(number).second.startswith("chassis"))

    assert chassis_m(0.0) > 0.3 > 0.02 > chassis_m(0.74)
    assert chassis_m(0.3) - chassis_m(0.4) == pytest.approx(0.1, abs=0.02)


def test_grippers_count_as_wide_open():
    """Each finger goes outward by half of the opening, since nobody tells how wide it is."""
    seen = {capsule.name: (capsule, line) for capsule, line in
            zip(model().capsules, model().posture(HOME_Q_RAD).segments, strict=True)}  # fmt: skip
    for side in Side:
        (upper, above), (lower, below) = (seen[f"{side}_{finger}_finger"] for finger in ("upper", "lower"))
        assert math.dist(above[:3], below[:3]) == pytest.approx(math.dist(upper.from_m, lower.from_m) + 0.087)


def test_parts_in_the_same_place_have_a_direction_between_them():
    """Lines that cross: the gap is minus both radii, and the slopes are finite."""
    crossing = [replace(c, from_m=(0.0, 0.0, 0.0), to_m=(0.0, 0.0, 0.1)) for c in hull().capsules]
    posture = CollisionModel(nominal(), replace(hull(), capsules=tuple(crossing))).posture(HOME_Q_RAD)
    for _, number in posture.within(math.inf):
        assert all(math.isfinite(slope) for row in posture.told(number).slopes.values() for slope in row)


@pytest.mark.parametrize(
    "bad",
    [
        lambda: model().posture({**HOME_Q_RAD, Side.LEFT: (0.0,) * 6}),
        lambda: model().posture({**HOME_Q_RAD, Side.LEFT: (math.nan,) * 7}),
        lambda: model().posture(HOME_Q_RAD, math.nan),
    ],
)
def test_what_is_no_number_is_refused(bad):
    """A distance from a NaN would compare as far away."""
    with pytest.raises(ValueRefused):
        bad()


def test_shoulders_that_are_not_parallel_are_refused():
    """The chest's frame would not be one."""
    ours = nominal()
    name = "right_shoulder_base_joint"
    turned = replace(ours.joints[name], rpy_rad=(0.1, 0.0, 0.0))
    with pytest.raises(ConfigError, match=r"by 0\.1 rad, not parallel") as refused:
        CollisionModel(replace(ours, joints={**ours.joints, name: turned}))
    told = refused.value
    assert (told.code, told.field, told.value, told.bound) == (Code.BAD_CONFIG, "model.urdf", "0.1", "0") and told.hint


def test_the_parts_of_a_calibrated_body_are_where_its_joints_really_are():
    """Zeros, hands and shoulders of its own: lines, gaps and slopes are those of the body as described at its real joints."""
    rng, own = random.Random(12), CollisionModel(calibrated(OWN))
    palms = {side: [capsule.name for capsule in own.capsules].index(f"{side}_palm") for side in Side}
    for _ in range(either(30, 300)):
        q_rad, lowered_m = random_joints(rng), rng.uniform(0.0, 0.74)
        reported, real = own.posture(q_rad, lowered_m), model().posture(really(q_rad), lowered_m)
        for line, other in zip(reported.segments, real.segments, strict=True):
            assert line == pytest.approx(other, abs=1e-9)
        for side, number in palms.items():
            x, y, z = ARMS[side].forward(really(q_rad)[side]).p_m
            assert reported.segments[number][:3] == pytest.approx((x, y + own.shoulders[side][1], z), abs=1e-9)
        near, other = reported.nearest(), real.nearest()
        assert (near.first, near.second, near.gap_m) == (
            other.first,
            other.second,
            pytest.approx(other.gap_m, abs=1e-9),
        )
        assert all(near.slopes[side] == pytest.approx(other.slopes[side], abs=1e-6) for side in Side)
