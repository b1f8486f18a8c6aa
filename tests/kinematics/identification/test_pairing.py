"""Pairing: joints and pose at one instant, interpolated and never extrapolated; all times are made up."""

from __future__ import annotations

import pytest

from gateway.kinematics.identification.pairing import MOST_WAITING, Pair, Pairing
from gateway.values import EePose, ValueRefused

MS = 1_000_000
POSE = EePose(p_m=(0.1, 0.2, 0.3), quat_xyzw=(0.0, 0.0, 0.0, 1.0))


def at(q):
    """Return joints that all have one angle."""
    return (q,) * 7


def test_joints_are_interpolated_to_the_time_of_the_pose():
    """Between the sample before and the one after, in whatever order they arrive."""
    early, late = Pairing(), Pairing()
    early.joints(at(1.0), 100 * MS)
    assert early.pose(POSE, 105 * MS) == ()
    expected = Pair(stamp_ns=105 * MS, q_rad=at(1.25), pose=POSE)
    assert early.joints(at(2.0), 120 * MS) == (expected,)
    late.joints(at(1.0), 100 * MS)
    late.joints(at(2.0), 120 * MS)
    late.joints(at(9.0), 130 * MS)
    assert late.pose(POSE, 105 * MS) == (expected,)


def test_a_pose_at_a_sample_needs_no_other():
    """The first sample of all is enough for a pose of its time."""
    pairing = Pairing()
    pairing.pose(POSE, 100 * MS)
    assert [pair.q_rad for pair in pairing.joints(at(1.0), 100 * MS)] == [at(1.0)]


@pytest.mark.parametrize(("gap_ms", "is_paired"), [(50, True), (51, False)])
def test_joints_too_far_apart_are_no_neighbours(gap_ms, is_paired):
    """What the arm did meanwhile is not known: the pose is dropped."""
    pairing = Pairing()
    pairing.joints(at(1.0), 100 * MS)
    pairing.pose(POSE, 110 * MS)
    assert bool(pairing.joints(at(2.0), (100 + gap_ms) * MS)) is is_paired


def test_a_pose_before_all_joints_is_dropped():
    """Nothing is extrapolated."""
    pairing = Pairing()
    pairing.joints(at(1.0), 100 * MS)
    assert pairing.pose(POSE, 99 * MS) == ()
    assert pairing.joints(at(2.0), 110 * MS) == ()


def test_what_was_there_already_is_skipped():
    """A state that is read more often than it changes gives each pair once."""
    pairing = Pairing()
    assert len([*pairing.joints(at(1.0), MS), *pairing.pose(POSE, MS), *pairing.pose(POSE, MS)]) == 1
    assert pairing.joints(at(2.0), MS) == ()


def test_a_clock_that_goes_back_begins_anew():
    """A restarted robot: nothing is interpolated across, and poses of the new time are welcome."""
    pairing = Pairing()
    pairing.joints(at(1.0), 100 * MS)
    pairing.pose(POSE, 110 * MS)
    assert pairing.joints(at(5.0), 10 * MS) == ()
    pairing.pose(POSE, 20 * MS)
    assert [pair.q_rad[0] for pair in pairing.joints(at(6.0), 30 * MS)] == [5.5]


def test_poses_do_not_pile_up():
    """Without joints only the newest wait."""
    pairing = Pairing()
    for index in range(MOST_WAITING + 7):
        pairing.pose(POSE, index + 1)
    assert pairing.joints(at(1.0), 1) == ()
    assert len(pairing.joints(at(2.0), 1000)) == MOST_WAITING


@pytest.mark.parametrize("q_rad", [(0.0,) * 6, (float("nan"),) * 7])
def test_joints_are_seven_finite_numbers(q_rad):
    """Anything else is refused at once."""
    with pytest.raises(ValueRefused):
        Pairing().joints(q_rad, 1)
    with pytest.raises(ValueRefused):
        Pair(stamp_ns=1, q_rad=q_rad, pose=POSE)
